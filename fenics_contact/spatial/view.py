"""What pictures, ParaView files and the viewer show: blocks, how they move, what contacts do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Self

import numpy as np

from fenics_contact.errors import plain
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.output.fields import AMPLITUDE
from fenics_contact.results.parts import AS_ONE
from fenics_contact.results.wording import four
from fenics_contact.spatial.crushing import Crushing
from fenics_contact.spatial.loads import GROUND
from fenics_contact.spatial.result import SpatialCollapse, SpatialLimit
from fenics_contact.spatial.structure import Structure

#: Characters of a title that a picture has room for.
LONGEST_TITLE = 60
#: Length of the live load's arrow, over the structure's size.
PUSH = 0.16
#: Contacts crush from this part of what they carry at most.
CRUSHES = 0.99
#: Of the largest friction bound: contacts with less carry nothing, and use nothing.
NOTHING = 1e-6


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
        title: Of pictures.
    """

    structure: Structure
    motion: Array
    force: Array | None
    marked: tuple[int, ...] = ()
    sign: float = 1.0
    title: str = ""

    @classmethod
    def of(cls, structure: Structure, collapse: SpatialCollapse, title: str = "") -> Self:
        """For an answer to one direction, with the title of the scene."""
        rest = cls(structure, np.zeros((len(structure.blocks), 6)), collapse.force)
        mode = rest.motion if collapse.mode is None else collapse.mode
        fastest = np.linalg.norm(rest.bodies.displacement(mode), axis=1).max()
        scale = AMPLITUDE * rest.size / (float(fastest) or 1.0)
        told = "\n".join(filter(None, (title, collapse_in_short(collapse))))
        marked = tuple(collapse.falling)
        return cls(structure, scale * mode, collapse.force, marked, collapse.sign, told)

    @cached_property
    def bodies(self) -> Bodies:
        """Convex pieces of all blocks."""
        return Bodies.of(self.structure)

    @cached_property
    def box(self) -> Array:
        """Lowest and highest coordinates of the blocks that move, m, shape (2, 3)."""
        extents = np.array([block.extent for block in self.structure.blocks if not block.fixed])
        return np.array([extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)])

    @property
    def size(self) -> float:
        """Largest side of the box, m."""
        return float(np.ptp(self.box, axis=0).max())

    @cached_property
    def displacement(self) -> Array:
        """That of all corners, m, shape (corners, 3)."""
        return self.bodies.displacement(self.motion)

    def displaced(self, points: Array, block: int) -> Array:
        """Points that move with a block, or with the ground, shape (points, 3)."""
        if block == GROUND:
            return points
        arm = points - self.structure.blocks[block].centroid
        velocity, turn = np.split(self.motion[block], 2)
        return np.asarray(points + velocity + np.cross(turn, arm))

    @property
    def ties(self) -> list[Array]:
        """Ends of ties, displaced, m, shape (2, 3) each."""
        return [
            np.vstack(
                [self.displaced(p[None], b) for p, b in zip(bar.tie.ends, bar.blocks, strict=True)]
            )
            for bar in self.structure.bars
        ]

    @cached_property
    def share(self) -> Array:
        """Largest displacement of every block over that of all, shape (blocks,)."""
        size = np.zeros(len(self.structure.blocks))
        np.maximum.at(size, self.bodies.block, np.linalg.norm(self.displacement, axis=1))
        return np.asarray(size / (size.max() or 1.0))

    @cached_property
    def push(self) -> Array:
        """Ends of an arrow for the resultant of the live load, m, shape (2, 3)."""
        live = self.sign * self.structure.live[:, :3]
        size = np.linalg.norm(live, axis=1)
        centroid = np.array([block.centroid for block in self.structure.blocks])
        total = live.sum(axis=0)
        if np.linalg.norm(total) < 1e-6 * size.sum() or not size.any():
            return np.zeros((2, 3))
        arrow = PUSH * self.size * total / np.linalg.norm(total)
        return np.asarray(size @ centroid / size.sum() + np.outer([0.0, 1.0], arrow))

    @cached_property
    def contacts(self) -> ContactValues:
        """What the contacts carry and do."""
        return ContactValues.of(self.structure, self.motion, self.force)

    @cached_property
    def utilisation(self) -> Array:
        """Largest part of its friction that a contact of every block takes up, shape (blocks,)."""
        used = np.zeros(len(self.structure.blocks))
        for name in ("first", "second"):
            numbers = [getattr(contact, name) for contact in self.structure.contacts]
            np.maximum.at(used, numbers, self.contacts.utilisation)
        return used


def views_of(result: SpatialLimit) -> dict[str, SpatialView]:
    """Views of all directions, by what names of files have behind them."""
    title = plain(getattr(result.scene, "title", "") or "", LONGEST_TITLE)
    both = len(result.ends) == 2
    return {
        "_negative" * (both and name == "negative"): SpatialView.of(
            result.structure, collapse, title
        )
        for name, collapse in result.ends.items()
    }


def collapse_in_short(collapse: SpatialCollapse) -> str:
    """Status, load factor and gap, as titles of pictures have them."""
    reversal = ", live load reversed" * (collapse.sign < 0.0)
    if collapse.status == "unstable":
        return "does not stand under its dead load"
    if collapse.status != "limit":
        return f"{collapse.status.replace('_', ' ')}{reversal}"
    gap = f", gap {collapse.gap:.0e}" if collapse.gap > 0.0 else ""
    return f"load factor {four(collapse.load_factor)}{reversal}{gap}"


@dataclass(frozen=True, eq=False)
class Bodies:
    """Convex pieces of blocks as arrays.

    Attributes:
        corner: Corners of all pieces, one piece after the other, m, shape (corners, 3).
        block: Number of a corner's block, shape (corners,).
        piece: Number of its piece.
        arm: From its block's centroid, m.
        sides: Loops of corners, counterclockwise from outside.
        of_piece: Number of a piece's block, shape (pieces,).
        side_piece: Number of a side's piece, shape (sides,).
        side_block: Number of its block.
        normal: Outwards, shape (sides, 3).
    """

    corner: Array
    block: Indices
    piece: Indices
    arm: Array
    sides: tuple[Indices, ...]
    of_piece: Indices
    side_piece: Indices
    side_block: Indices
    normal: Array

    @classmethod
    def of(cls, structure: Structure) -> Self:
        """Those of all blocks."""
        pieces = [
            (number, piece)
            for number, block in enumerate(structure.blocks)
            for piece in block.pieces
        ]
        counts = [len(piece.corners) for _, piece in pieces]
        first = np.cumsum([0, *counts])
        corner = np.vstack([piece.corners for _, piece in pieces])
        of_piece = np.array([number for number, _ in pieces])
        block = np.repeat(of_piece, counts)
        centroid = np.array([one.centroid for one in structure.blocks])
        side_piece = np.repeat(np.arange(len(pieces)), [len(piece.sides) for _, piece in pieces])
        return cls(
            corner=corner,
            block=block,
            piece=np.repeat(np.arange(len(pieces)), counts),
            arm=corner - centroid[block],
            sides=tuple(
                start + np.array(side)
                for start, (_, piece) in zip(first, pieces, strict=False)
                for side in piece.sides
            ),
            of_piece=of_piece,
            side_piece=side_piece,
            side_block=of_piece[side_piece],
            normal=np.vstack([piece.normals for _, piece in pieces]),
        )

    def displacement(self, motion: Array) -> Array:
        """That of all corners, m, shape (corners, 3), from motions of blocks, shape (blocks, 6)."""
        return np.asarray(motion[self.block, :3] + np.cross(motion[self.block, 3:], self.arm))


@dataclass(frozen=True, eq=False)
class ContactValues:
    """What contacts carry and do; all of shape (contacts,).

    Attributes:
        pressure: Mean, Pa.
        shear: Mean of the size of shear stresses, Pa.
        utilisation: Shear over what friction and cohesion allow, 0 ... 1; a twist counts, too.
        opening: Largest one of a point, m.
        slip: Likewise.
        state: A `ContactState`.
    """

    pressure: Array
    shear: Array
    utilisation: Array
    opening: Array
    slip: Array
    state: Indices

    @classmethod
    def of(cls, structure: Structure, motion: Array, force: Array | None) -> Self:
        """Those of a motion, shape (blocks, 6), and of forces of points, or none."""
        points = structure.points
        count = len(structure.contacts)

        def total(values: Array) -> Array:
            return np.asarray(np.bincount(points.contact, values, count))

        def largest(values: Array) -> Array:
            found = np.full(count, -np.inf)
            np.maximum.at(found, points.contact, values)
            return found

        force = np.zeros((len(points.position), 3)) if force is None else force[: len(points.area)]
        laws = [structure.laws[k] for k in points.contact]
        friction = np.array([law.friction for law in laws])
        bound = friction * force[:, 0] + [law.cohesion for law in laws] * points.area
        area = total(points.area)
        shear = total(np.linalg.norm(force[:, 1:], axis=1))
        allowed = total(bound)
        acts = allowed > NOTHING * allowed.max(initial=0.0)
        used = np.minimum(shear / np.where(acts, allowed, np.inf), 1.0)
        moved = motion[structure.number >= 0] * [1.0, 1.0, 1.0, *[structure.size] * 3]
        relative = (structure.relative_motion() @ moved.ravel()).reshape(-1, 3)
        relative = relative[: len(points.area)]
        slip = np.linalg.norm(relative[:, 1:], axis=1)
        speed = Bodies.of(structure).displacement(motion)
        least = AS_ONE * float(np.linalg.norm(speed, axis=1).max()) or np.inf
        opening = largest(relative[:, 0])
        closing = -largest(-relative[:, 0])
        rocks = np.where(closing > least, ContactState.OPENS, ContactState.ROCKS)
        slides = np.where(largest(slip) > least, ContactState.SLIDES, ContactState.CLOSED)
        state = np.where(opening > least, rocks, slides)
        strong = structure.crushes
        if strong.any():
            carried, most = Crushing.of(structure).strengths(force[:, 0])
            crushes = (carried > CRUSHES * most) & (carried > NOTHING * carried.max())
            state[strong] = np.where(crushes, ContactState.CRUSHES, state[strong])
        return cls(total(force[:, 0]) / area, shear / area, used, opening, largest(slip), state)
