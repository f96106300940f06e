"""What pictures, ParaView files and the viewer show: blocks, how they move, what contacts do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import Any, Self

import numpy as np

from fenics_contact.errors import plain
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.output.fields import AMPLITUDE
from fenics_contact.output.files import FALLS, LONGEST_TITLE
from fenics_contact.results.parts import AS_ONE
from fenics_contact.results.wording import four
from fenics_contact.spatial.certificate import relative_motions
from fenics_contact.spatial.crushing import Crushing
from fenics_contact.spatial.result import SpatialCollapse, SpatialLimit
from fenics_contact.spatial.structure import Structure

#: Length of the live load's arrow, over the structure's size.
PUSH = 0.16
#: Contacts crush from this part of what they carry at most.
CRUSHES = 0.99
#: Of the largest friction bound: contacts with less carry nothing, and use nothing.
NOTHING = 1e-6
#: Tensions over the yield of ties below and above which these are slack and yield.
SLACK, YIELDS = 1e-6, 0.999


class ContactState(IntEnum):
    """What a contact does in a collapse."""

    CLOSED = 0
    SLIDES = 1
    ROCKS = 2
    OPENS = 3
    CRUSHES = 4


@dataclass(frozen=True, eq=False)
class SpatialView:
    """A structure and its collapse in one direction of the live load.

    Attributes:
        structure: Blocks and contacts.
        motion: Displacements of centroids, m, and rotations of all blocks, shape (blocks, 6); the
            largest displacement of a corner is 8 % of the structure's size. 0 without a collapse.
        force: Forces of the points along their contact's axes, N, shape (points, 3); or None.
        marked: Numbers of blocks that fall or are wedged.
        sign: Of the live load.
        ties: Names, forces, yields and states of ties; empty if there are none, or no forces.
        title: Of the scene.
        caption: Of the collapse.
        suffix: What names of files have behind them.
    """

    structure: Structure
    motion: Array
    force: Array | None
    marked: tuple[int, ...] = ()
    sign: float = 1.0
    ties: Mapping[str, Any] = field(default_factory=dict)
    title: str = ""
    caption: str = ""
    suffix: str = ""

    @classmethod
    def of(cls, structure: Structure, collapse: SpatialCollapse, names: Sequence[str] = ()) -> Self:
        """For an answer to one direction, with the names of ties."""
        ties: dict[str, Any] = {}
        if names and collapse.tension is not None:
            pull = collapse.tension
            limit = np.array([bar.tie.yield_ for bar in structure.bars])
            state = np.digitize(pull / limit, [SLACK, YIELDS])  # numbers of TieState
            ties = {"name": np.array(names), "force": pull, "yield": limit, "state": state}
        mode = np.zeros((len(structure.blocks), 6)) if collapse.mode is None else collapse.mode
        marked = collapse.falling * (collapse.mode is None)  # a collapse shows what moves
        view = cls(structure, mode, collapse.force, marked, collapse.sign, ties)
        fastest = float(np.linalg.norm(view.displacement, axis=1).max()) or 1.0
        told = collapse_in_short(collapse)
        return replace(view, motion=AMPLITUDE * view.size / fastest * mode, caption=told)

    @cached_property
    def bodies(self) -> Bodies:
        """Blocks as arrays."""
        return Bodies(self.structure)

    def box_of(self, blocks: Flags) -> Array:
        """Lowest and highest coordinates of some blocks, m, shape (2, 3)."""
        corners = self.bodies.corner[blocks[self.bodies.block]]
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    @cached_property
    def box(self) -> Array:
        """That of the blocks that move."""
        return self.box_of(self.structure.number >= 0)

    @property
    def size(self) -> float:
        """Largest side of the box, m."""
        return float(np.ptp(self.box, axis=0).max())

    def displacements(self, points: Array, block: Indices | int) -> Array:
        """Those of points that move with blocks, or with the ground, m, shape (points, 3)."""
        motion = np.vstack([self.motion, np.zeros(6)])[block]  # the last one: GROUND
        arm = points - self.bodies.centroid[block]
        return np.asarray(motion[..., :3] + np.cross(motion[..., 3:], arm))

    @cached_property
    def displacement(self) -> Array:
        """That of all corners, m, shape (corners, 3)."""
        return self.displacements(self.bodies.corner, self.bodies.block)

    @property
    def tie_ends(self) -> list[Array]:
        """Ends of ties, displaced, m, shape (2, 3) each."""
        bars = self.structure.bars
        return [b.ends + self.displacements(b.ends, np.array(b.blocks)) for b in bars]

    @cached_property
    def share(self) -> Array:
        """Largest displacement of every block over that of all, shape (blocks,)."""
        size = self.bodies.largest(np.linalg.norm(self.displacement, axis=1))
        return np.asarray(size / (size.max() or 1.0))

    @cached_property
    def push(self) -> Array:
        """Ends of an arrow for the resultant of the live load, m, shape (2, 3)."""
        live = self.sign * self.structure.live[:, :3]
        size = np.linalg.norm(live, axis=1)
        total = live.sum(axis=0)
        resultant = np.linalg.norm(total)
        if not resultant > 1e-6 * size.sum():
            return np.zeros((2, 3))
        arrow = PUSH * self.size * total / resultant
        return np.asarray(size @ self.bodies.centroid / size.sum() + np.outer([0.0, 1.0], arrow))

    @cached_property
    def contacts(self) -> ContactValues:
        """What the contacts carry and do."""
        return ContactValues(self)

    @cached_property
    def utilisation(self) -> Array:
        """Largest part of its friction that a contact of every block takes up, shape (blocks,)."""
        used = np.zeros(len(self.structure.blocks))
        np.maximum.at(used, self.bodies.pairs, self.contacts.utilisation[:, None])
        return used


def views_of(result: SpatialLimit) -> dict[str, SpatialView]:
    """Views of all directions."""
    title = plain(getattr(result.scene, "title", "") or "", LONGEST_TITLE)
    ties = tuple(getattr(result.scene, "ties", ()))
    views = {
        name: replace(SpatialView.of(result.structure, collapse, ties), title=title)
        for name, collapse in result.ends.items()
    }
    if len(views) == 2:
        views["negative"] = replace(views["negative"], suffix="_negative")
    return views


def collapse_in_short(collapse: SpatialCollapse) -> str:
    """Status, load factor and gap, as titles of pictures have them."""
    reversal = ", live load reversed" * (collapse.sign < 0.0)
    gap = f", gap {collapse.gap:.0e}" if collapse.gap > 0.0 else ""
    found = f"load factor {four(collapse.load_factor)}{reversal}{gap}"
    told = {"limit": found, "unstable": FALLS}
    return told.get(collapse.status, f"{collapse.status.replace('_', ' ')}{reversal}")


class Bodies:
    """Blocks and their convex pieces as arrays.

    Attributes:
        centroid: Of blocks, m, shape (blocks, 3).
        volume: Of blocks, m3, shape (blocks,); 0 of ground.
        pairs: Blocks of the contacts, shape (contacts, 2).
        pieces: Of all blocks, in turn.
        of_piece: Number of a piece's block, shape (pieces,).
        corner: Corners of all pieces, one piece after the other, m, shape (corners, 3).
        counts: Number of a piece's corners, shape (pieces,).
        first: Number of the first of these.
        block: Number of a corner's block, shape (corners,).
        sides: Loops of corners, counterclockwise from outside.
        side_piece: Number of a side's piece, shape (sides,).
        side_block: Number of its block.
        normal: Outwards, shape (sides, 3).
    """

    def __init__(self, structure: Structure) -> None:
        """Take those of all blocks."""
        blocks = structure.blocks
        self.centroid = np.array([block.centroid for block in blocks])
        self.volume = np.array([0.0 if block.fixed else block.volume for block in blocks])
        self.pairs = np.array([(one.first, one.second) for one in structure.contacts])
        self.pieces = [piece for block in blocks for piece in block.pieces]
        self.counts = np.array([len(piece.corners) for piece in self.pieces])
        sides = [len(piece.sides) for piece in self.pieces]
        self.of_piece = np.repeat(np.arange(len(blocks)), [len(b.pieces) for b in blocks])
        self.corner = np.vstack([piece.corners for piece in self.pieces])
        self.first = np.cumsum(self.counts) - self.counts
        self.block = np.repeat(self.of_piece, self.counts)
        self.side_piece = np.repeat(np.arange(len(sides)), sides)
        self.side_block = self.of_piece[self.side_piece]
        loops = [loop for piece in self.pieces for loop in piece.sides]
        starts = self.first[self.side_piece]
        self.sides = [start + np.array(loop) for start, loop in zip(starts, loops, strict=True)]
        self.normal = np.vstack([piece.normals for piece in self.pieces])

    def largest(self, values: Array) -> Array:
        """Largest of the corners' values of every block, shape (blocks,)."""
        first = np.flatnonzero(np.diff(self.block, prepend=-1))
        return np.asarray(np.maximum.reduceat(values, first))


class ContactValues:
    """What contacts carry and do; all of shape (contacts,).

    Attributes:
        pressure: Mean, Pa; 0 in edges and corners, which have no area.
        shear_stress: Mean of the size of shear stresses, Pa; likewise.
        utilisation: Shear over what friction and cohesion allow, 0 ... 1; a twist counts, too.
        opening: Largest one of a point, m.
        slip: Likewise.
        state: A `ContactState`.
    """

    def __init__(self, view: SpatialView) -> None:
        """Take those of a view's motion and forces."""
        structure = view.structure
        points = structure.points
        first = np.flatnonzero(np.diff(points.contact, prepend=-1))
        force = np.zeros((len(points.area), 3)) if view.force is None else view.force
        pressing = np.add.reduceat(force[:, 0], first)
        shear = np.add.reduceat(np.linalg.norm(force[:, 1:], axis=1), first)
        area = np.add.reduceat(points.area, first)
        friction = np.array([law.friction for law in structure.laws])
        allowed = friction * pressing + [law.cohesion for law in structure.laws] * area
        acts = allowed > NOTHING * allowed.max(initial=0.0)
        self.pressure = pressing / np.where(area > 0.0, area, np.inf)
        self.shear_stress = shear / np.where(area > 0.0, area, np.inf)
        self.utilisation = np.minimum(shear / np.where(acts, allowed, np.inf), 1.0)
        moved = relative_motions(structure, view.motion)[: len(points.area)]
        self.opening = np.maximum.reduceat(moved[:, 0], first)
        self.slip = np.maximum.reduceat(np.linalg.norm(moved[:, 1:], axis=1), first)
        least = AS_ONE * float(np.linalg.norm(view.displacement, axis=1).max()) or np.inf
        crushes = structure.crushes.copy()
        if crushes.any():
            carried, most = Crushing.of(structure).strengths(force[:, 0])
            crushes[crushes] = (carried > CRUSHES * most) & (carried > NOTHING * carried.max())
        does = {
            ContactState.CRUSHES: crushes,
            ContactState.OPENS: np.minimum.reduceat(moved[:, 0], first) > least,
            ContactState.ROCKS: self.opening > least,
            ContactState.SLIDES: self.slip > least,
        }
        self.state: Indices = np.select(list(does.values()), list(does), ContactState.CLOSED)
