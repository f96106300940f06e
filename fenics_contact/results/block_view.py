"""Blocks, how they move in a collapse, and what their contacts do: in space and in the plane.

A meshed scene and a structure of rigid blocks are seen alike. Places, forces and motions have three
components, z is up. In the plane y is 0: what people give as (x, y) is (x, 0, z), and a positive
rotation, counterclockwise, is one about -y.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import Any, NamedTuple, Protocol, Self

import numpy as np

from fenics_contact.geometry.mesh import Array, Flags, Indices

#: Largest displacement of a collapse mode in pictures and files, over the structure's size.
AMPLITUDE = 0.08
#: Contacts that open or slide by up to this part of the largest displacement are closed.
AS_ONE = 0.01
#: Length of the longest arrow of a load, over the structure's size: of the live one, of others.
PUSH, REST = 0.16, 0.09
#: Contacts crush from this part of what they carry at most.
CRUSHES = 0.99
#: Of the largest friction bound: contacts with less carry nothing, and use nothing.
NOTHING = 1e-6
#: What the live load is in pictures.
LIVE = "live load", "live forces"


class ContactState(IntEnum):
    """What a contact, or a joint point, does in a collapse; points do one of the first three."""

    OPEN = 0
    SLIP = 1
    STICK = 2
    ROCKS = 3
    CRUSHES = 4


#: What joint points and facets do.
JOINT_STATES = ContactState.STICK, ContactState.SLIP, ContactState.OPEN
#: What contacts do, for result.json.
STATES: Mapping[ContactState, str] = {
    ContactState.STICK: "closed",
    ContactState.SLIP: "slides",
    ContactState.ROCKS: "rocks",
    ContactState.OPEN: "opens",
    ContactState.CRUSHES: "crushes",
}


class Piece(Protocol):
    """A part of a block, or all of it: a convex body in space, or its outline in the plane."""

    @property
    def corners(self) -> Array:
        """Shape (corners, 3), m."""

    @property
    def sides(self) -> Sequence[Any]:
        """Loops of corners, counterclockwise seen from outside; in the plane from the front."""

    @property
    def normals(self) -> Array:
        """Of sides, outwards, shape (sides, 3)."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Blocks and their pieces as arrays.

    Attributes:
        names: Of blocks; empty where they have none.
        groups: Of blocks.
        fixed: Whether a block is ground, shape (blocks,).
        centroid: Of blocks, m, shape (blocks, 3).
        volume: Of blocks, m3, in the plane area, m2, shape (blocks,); 0 of ground.
        pieces: Of all blocks, in turn.
        of_piece: Number of a piece's block, shape (pieces,).
        dimension: 2 or 3.
    """

    names: Sequence[str]
    groups: Sequence[str]
    fixed: Flags
    centroid: Array
    volume: Array
    pieces: Sequence[Piece]
    of_piece: Indices
    dimension: int

    @cached_property
    def group_names(self) -> tuple[str, ...]:
        """Every group once, those of blocks that are no ground first."""
        order = np.argsort(self.fixed, kind="stable").tolist()
        return tuple(dict.fromkeys(self.groups[block] for block in order))

    @property
    def group(self) -> Indices:
        """Number of a block's group, shape (blocks,)."""
        return np.array([self.group_names.index(name) for name in self.groups])

    @cached_property
    def counts(self) -> Indices:
        """Number of a piece's corners, shape (pieces,)."""
        return np.array([len(piece.corners) for piece in self.pieces])

    @cached_property
    def first(self) -> Indices:
        """Number of the first of these, shape (pieces,)."""
        return np.asarray(np.cumsum(self.counts) - self.counts)

    @cached_property
    def corner(self) -> Array:
        """Corners of all pieces, one piece after the other, m, shape (corners, 3)."""
        return np.vstack([piece.corners for piece in self.pieces])

    @cached_property
    def block(self) -> Indices:
        """Number of a corner's block, shape (corners,)."""
        return np.repeat(self.of_piece, self.counts)

    @cached_property
    def side_piece(self) -> Indices:
        """Number of a side's piece, shape (sides,)."""
        sides = [len(piece.sides) for piece in self.pieces]
        return np.repeat(np.arange(len(sides)), sides)

    @property
    def side_block(self) -> Indices:
        """Number of a side's block, shape (sides,)."""
        return self.of_piece[self.side_piece]

    @cached_property
    def sides(self) -> list[Indices]:
        """Loops of corners of all pieces."""
        loops = [loop for piece in self.pieces for loop in piece.sides]
        starts = self.first[self.side_piece]
        return [start + np.array(loop) for start, loop in zip(starts, loops, strict=True)]

    @cached_property
    def normal(self) -> Array:
        """Of sides, outwards, shape (sides, 3)."""
        return np.vstack([piece.normals for piece in self.pieces])

    def largest(self, values: Array) -> Array:
        """Largest of the corners' values of every block, shape (blocks,)."""
        first = np.flatnonzero(np.diff(self.block, prepend=-1))
        return np.asarray(np.maximum.reduceat(values, first))


@dataclass(frozen=True, eq=False)
class Contacts:
    """Where blocks touch, and the forces there.

    Attributes:
        pairs: First and second block of every contact, -1 for rigid ground, shape (contacts, 2).
        corners: Of every contact, m, shape (corners, 3) each.
        normal: Unit normal from the first to the second block, shape (contacts, 3).
        position: Of the points of all contacts, m, shape (points, 3).
        area: Of points, m2, in the plane length, m, shape (points,).
        of_point: Number of a point's contact, ascending, shape (points,).
        force: On the second block at points, N, shape (points, 3); 0 where none are known.
        friction: Of contacts, shape (contacts,).
        strength: Shear forces that contacts carry without pressure, N, shape (contacts,).
        crushes: Whether a contact is at its compressive strength, shape (contacts,).
    """

    pairs: Indices
    corners: Sequence[Array]
    normal: Array
    position: Array
    area: Array
    of_point: Indices
    force: Array
    friction: Array
    strength: Array
    crushes: Flags

    def parted(self, vectors: Array) -> tuple[Array, Array]:
        """Vectors at points along the normal, shape (points,), and across it, (points, 3)."""
        normal = self.normal[self.of_point]
        along = np.einsum("pi,pi->p", vectors, normal)
        return along, vectors - along[:, None] * normal

    @property
    def ends(self) -> Array:
        """Ends of contacts in the plane, m, (x, y), shape (contacts, 2, 2)."""
        flat = [corners[:, ::2] for corners in self.corners]
        far = [np.linalg.norm(one - one[0], axis=1).argmax() for one in flat]
        ends = [one[[0, k]] for one, k in zip(flat, far, strict=True)]
        return np.array(ends).reshape(-1, 2, 2)

    @cached_property
    def pressing(self) -> Array:
        """Forces of points along the normal, N, shape (points,)."""
        return self.parted(self.force)[0]

    def sums(self, values: Array) -> Array:
        """Sums of points' values by contact, shape (contacts,)."""
        return np.bincount(self.of_point, values, len(self.pairs)).astype(float)

    def extreme(self, values: Array, kind: Any) -> Array:
        """Largest or smallest, by `np.maximum` or `np.minimum`, of points' values by contact."""
        first = np.flatnonzero(np.diff(self.of_point, prepend=-1))
        return np.asarray(kind.reduceat(values, first)) if len(first) else np.empty(0)

    def any_of(self, blocks: Flags) -> Indices:
        """How many of a contact's two blocks are among some, shape (contacts,)."""
        return np.append(blocks, False)[self.pairs].sum(axis=1)


class Pushes(NamedTuple):
    """Forces at places of blocks; that of a body force, by its resultant, is on no block.

    Attributes:
        block: Number of the block, -1 for none, shape (forces,).
        place: m, shape (forces, 3).
        force: N, shape (forces, 3).
    """

    block: Indices
    place: Array
    force: Array


@dataclass(frozen=True, eq=False)
class BlockView:
    """A structure and its collapse in one direction of the live load.

    Attributes:
        bodies: Blocks.
        touching: Where they touch.
        live: Live load, as it acts: forces and moments about centroids, shape (blocks, 6).
        motion: Displacements of centroids, m, and rotations of all blocks, shape (blocks, 6).
        tie_ends: Of ties, at rest, m, shape (bars, 2, 3).
        tie_blocks: Of these, -1 for the ground, shape (bars, 2).
        ties: Names, forces, yields and states of ties; empty if there are none, or no forces.
        marked: Numbers of blocks that fall or are wedged.
        title: Of the scene.
        caption: Of the collapse.
        suffix: What names of files have behind them.
        way: After the peak: displacements, m, what is carried, and true poses of all blocks, their
            shifts, m, and vectors of their rotations, shape (blocks, 6); empty if it is not known.
        way_unit: Behind what is carried.
        loads: What pushes blocks: "live load" (body force), "live forces", "dead forces", "floors",
            "thrust of floors".
        stresses: Largest "pressure" and "tension" of blocks, MPa, shape (blocks,), if known.
    """

    bodies: Bodies
    touching: Contacts
    live: Array
    motion: Array
    tie_ends: Array
    tie_blocks: Indices
    ties: Mapping[str, Any] = field(default_factory=dict)
    marked: tuple[int, ...] = ()
    title: str = ""
    caption: str = ""
    suffix: str = ""
    way: Sequence[tuple[float, float, Array]] = ()
    way_unit: str = ""
    loads: Mapping[str, Pushes] = field(default_factory=dict)
    stresses: Mapping[str, Array] = field(default_factory=dict)

    def scaled(self) -> Self:
        """The same, with a largest displacement of a corner of 8 % of the structure's size."""
        fastest = float(np.linalg.norm(self.displacement, axis=1).max()) or 1.0
        return replace(self, motion=AMPLITUDE * self.size / fastest * self.motion)

    @property
    def whole_title(self) -> str:
        """Title of a picture of the collapse, below that of its scene."""
        return "\n".join(filter(None, (self.title, self.caption)))

    def box_of(self, blocks: Flags) -> Array:
        """Lowest and highest coordinates of some blocks, m, shape (2, 3)."""
        corners = self.bodies.corner[blocks[self.bodies.block]]
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    @cached_property
    def box(self) -> Array:
        """That of the blocks that are no ground."""
        return self.box_of(~self.bodies.fixed)

    @property
    def size(self) -> float:
        """Largest side of the box, m."""
        return float(np.ptp(self.box, axis=0).max())

    def displacements(self, points: Array, block: Indices | int) -> Array:
        """Those of points that move with blocks, or with the ground, m, shape (points, 3)."""
        motion = np.vstack([self.motion, np.zeros(6)])[block]  # the last one: ground
        arm = points - self.bodies.centroid[block]
        return np.asarray(motion[..., :3] + np.cross(motion[..., 3:], arm))

    @cached_property
    def displacement(self) -> Array:
        """That of all corners, m, shape (corners, 3)."""
        return self.displacements(self.bodies.corner, self.bodies.block)

    @property
    def moved_ties(self) -> Array:
        """Ends of ties, displaced, m, shape (bars, 2, 3)."""
        return self.tie_ends + self.displacements(self.tie_ends, self.tie_blocks)

    @cached_property
    def share(self) -> Array:
        """Largest displacement of every block over that of all, shape (blocks,)."""
        size = self.bodies.largest(np.linalg.norm(self.displacement, axis=1))
        return np.asarray(size / (size.max() or 1.0))

    @property
    def arrows(self) -> dict[str, Array]:
        """Tails and tips of the loads' arrows, displaced, m, shape (forces, 2, 3) each.

        Tips are where forces act; the arrow of a body force begins at its centre.
        """
        ends = {}
        for name, (block, place, force) in self.loads.items():
            length = (PUSH if name in LIVE else REST) * self.size
            reach = length * force / np.linalg.norm(force, axis=1).max()
            tip = place + self.displacements(place, block) + (block < 0)[:, None] * reach
            ends[name] = np.stack([tip - reach, tip], axis=1)
        return ends

    @cached_property
    def contacts(self) -> ContactValues:
        """What the contacts carry and do."""
        return ContactValues(self)


class ContactValues:
    """What contacts carry and do; all of shape (contacts,).

    Attributes:
        pressure: Mean, Pa; 0 in edges and corners, which have no area.
        shear_stress: Mean of the size of shear stresses, Pa; likewise.
        utilisation: Shear over what friction and cohesion allow, 0 ... 1; a twist counts, too.
        opening: Largest one of a point, m.
        slip: Likewise.
        state: A `ContactState`; that of what opens or slides, too, where it crushes.
    """

    def __init__(self, view: BlockView) -> None:
        """Take those of a view's motion and forces."""
        at = view.touching
        shear_force = np.linalg.norm(at.parted(at.force)[1], axis=1)
        pressing, shear, area = map(at.sums, (at.pressing, shear_force, at.area))
        allowed = at.friction * pressing + at.strength
        acts = allowed > NOTHING * allowed.max(initial=0.0)
        self.pressure = pressing / np.where(area > 0.0, area, np.inf)
        self.shear_stress = shear / np.where(area > 0.0, area, np.inf)
        self.utilisation = np.minimum(shear / np.where(acts, allowed, np.inf), 1.0)
        first, second = (view.displacements(at.position, side[at.of_point]) for side in at.pairs.T)
        opening, slip = at.parted(second - first)
        self.opening = at.extreme(opening, np.maximum)
        self.slip = at.extreme(np.linalg.norm(slip, axis=1), np.maximum)
        least = AS_ONE * float(np.linalg.norm(view.displacement, axis=1).max()) or np.inf
        does = {
            ContactState.OPEN: at.extreme(opening, np.minimum) > least,
            ContactState.ROCKS: self.opening > least,
            ContactState.SLIP: self.slip > least,
            ContactState.CRUSHES: at.crushes,
        }
        self.state: Indices = np.select(list(does.values()), list(does), ContactState.STICK)
