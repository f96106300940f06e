"""Points of blocks in motion, and the planes of others that they touch or soon will.

A unit is a corner of the common part of two sides that face each other: a material point P of one
block, and the plane of a side of the other one, which turns with its block. Its gap is the distance
of P from the plane, its place the coordinates of P along the plane. Both are exact in any pose, so
that hinges roll and slide without drift.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import near_pairs
from fenics_contact.motion.poses import Poses
from fenics_contact.spatial.contacts import Contact, clipped, frame, polygon_width
from fenics_contact.spatial.points import ends_of, points_of
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.structure import Structure

#: Cosine of the angle up to which sides that face each other may touch: 60 degrees.
FACING = 0.5
#: Sides overlap by this at most to be in contact, in parts of the thinnest piece.
DEPTH = 0.02
#: Width of a common part, in the same parts, below which it is none.
NARROW = 2e-3
#: Rigid ground reaches so many times the structure's extent.
GROUND = 10.0
#: Units are looked for farther than asked, so many times.
WIDER = 1.6


@dataclass(frozen=True)
class PointUnits:
    """Points of blocks against planes of others, fixed to these.

    Attributes:
        point: Blocks of the points, shape (units,).
        plane: Blocks of the planes.
        arm: Points, from the centroids as drawn, m, shape (units, 3).
        origin: Places in the planes, likewise.
        axes: Normals out of the planes and two tangents, in the blocks as drawn, (units, 3, 3).
        area: m2.
        friction: Coefficients.
        key: Which corner of which two sides it is.
    """

    point: Indices
    plane: Indices
    arm: Array
    origin: Array
    axes: Array
    area: Array
    friction: Array
    key: tuple[tuple[int, ...], ...]

    def at(self, poses: Poses) -> tuple[Array, Array, Array]:
        """Places, m, axes, and gap and places along the planes, shape (units, 3)."""
        place = poses.placed(self.point, self.arm)
        from_plane = place - poses.placed(self.plane, self.origin)
        axes = np.einsum("uij,ukj->uki", poses.rotation[self.plane], self.axes)
        return place, axes, np.einsum("uki,ui->uk", axes, from_plane)

    def some(self, kept: Any) -> PointUnits:
        """Some of the units."""
        numbers = np.flatnonzero(kept)
        arrays = {n: v[numbers] for n, v in vars(self).items() if n != "key"}
        return replace(self, **arrays, key=tuple(self.key[k] for k in numbers))


class Present(NamedTuple):
    """A piece in its present pose: its block, corners, m, normals and levels of sides."""

    block: int
    corners: Array
    normals: Array
    levels: Array


class MovingSides:
    """Sides of all pieces of a structure, fixed to their blocks.

    Attributes:
        law_of: Law of a contact between two blocks by their numbers; None where there is none.
    """

    def __init__(self, structure: Structure, start: Poses) -> None:
        self.structure = structure
        contacts = zip(structure.contacts, structure.laws, strict=True)
        drawn = {frozenset((one.first, one.second)): law for one, law in contacts}
        self.law_of = structure.law_of or (lambda *pair: drawn.get(frozenset(pair)))
        bodies = [_without_end(block, structure) for block in structure.blocks]
        self.pieces = [piece for body in bodies for piece in body]
        count = [len(body) for body in bodies]
        self.owner = np.repeat(np.arange(len(count)), count)
        self.fixed = np.array([block.fixed for block in structure.blocks])
        self.corners = [
            piece.corners - start.centroid[k]
            for k, piece in zip(self.owner, self.pieces, strict=True)
        ]
        self.middle = np.array([corners.mean(axis=0) for corners in self.corners])
        self.radius = np.array(
            [
                np.linalg.norm(corners - middle, axis=1).max()
                for corners, middle in zip(self.corners, self.middle, strict=True)
            ]
        )
        self.reach = np.zeros(len(count))  # of corners from the centroid
        far = [np.linalg.norm(corners, axis=1).max() for corners in self.corners]
        np.maximum.at(self.reach, self.owner, far)
        thinnest = min(
            p.thickness for p, k in zip(self.pieces, self.owner, strict=True) if not self.fixed[k]
        )
        self.depth = DEPTH * thinnest
        self.narrow = NARROW * thinnest
        self.loops = [[list(side) for side in piece.sides] for piece in self.pieces]
        self.first = [[side[0] for side in piece.sides] for piece in self.pieces]
        self._known: tuple[Poses, float, PointUnits] | None = None
        self.frames = [_frames(piece.normals) for piece in self.pieces]
        self.points = ends_of if structure.dimension == 2 else self._points

    def _points(self, contact: Contact) -> tuple[Array, Array]:
        return points_of(contact, self.structure.quick)

    def near(self, poses: Poses, reach: float) -> PointUnits:
        """Units of all sides that face each other and are as near as `reach`, m."""
        known = self._known
        if known is None or known[0] is not poses or known[1] < reach:
            wider = WIDER * reach  # the next step from these poses is often longer
            self._known = known = poses, wider, self._found(poses, wider)
        units = known[2]
        return units.some(units.at(poses)[2][:, 0] <= reach)

    def _found(self, poses: Poses, reach: float) -> PointUnits:
        present = [self._present(k, poses) for k in range(len(self.pieces))]
        rows = [
            row
            for one, two in self._pairs(poses, present, reach)
            for row in self._meetings((one, two), (present[one], present[two]), poses, reach)
        ]
        if not rows:
            none = np.zeros((0, 3))
            empty = np.zeros(0, dtype=int)
            flat = np.zeros(0)
            return PointUnits(empty, empty, none, none, np.zeros((0, 3, 3)), flat, flat, ())
        columns = list(zip(*rows, strict=True))
        names = "point", "plane", "arm", "origin", "axes", "area", "friction"
        arrays: Any = (np.array(column) for column in columns[:-1])
        return PointUnits(**dict(zip(names, arrays, strict=True)), key=columns[-1])

    def _present(self, number: int, poses: Poses) -> Present:
        """A piece in its present pose."""
        block = int(self.owner[number])
        turn = poses.rotation[block].T
        corners = poses.centroid[block] + self.corners[number] @ turn
        normals = self.pieces[number].normals @ turn
        return Present(block, corners, normals, (corners[self.first[number]] * normals).sum(axis=1))

    def _pairs(self, poses: Poses, present: list[Present], reach: float) -> list[list[int]]:
        """Pieces of two blocks whose boxes are as near as that."""
        low = np.array([piece.corners.min(axis=0) for piece in present])
        high = np.array([piece.corners.max(axis=0) for piece in present])
        middle = poses.placed(self.owner, self.middle)
        every = np.arange(len(middle))
        portions = near_pairs(middle, self.radius + 0.5 * reach, every, every)
        one, two = np.concatenate([np.stack(part, axis=1) for part in portions]).T
        apart = np.maximum(low[one] - high[two], low[two] - high[one]).max(axis=1)
        first, second = self.owner[one], self.owner[two]
        wanted = (one < two) & (apart <= reach) & (first != second)
        wanted &= ~(self.fixed[first] & self.fixed[second])
        pairs: list[list[int]] = np.unique(np.column_stack([one, two])[wanted], axis=0).tolist()
        return pairs

    def _meetings(
        self, pair: tuple[int, int], present: tuple[Present, Present], poses: Poses, reach: float
    ) -> Iterator[tuple[Any, ...]]:
        """Units of two pieces, as rows of arrays."""
        one, two = present
        law = self.law_of(one.block, two.block)
        beyond = [
            (b.corners @ a.normals.T).min(axis=0) - a.levels for a, b in ((one, two), (two, one))
        ]
        if law is None or max(part.max() for part in beyond) > reach:
            return
        parts = (beyond[0] >= -self.depth)[:, None] | (beyond[1] >= -self.depth)
        facing = np.argwhere(parts & (one.normals @ two.normals.T < -FACING))
        for sides in facing.tolist():
            loops = [
                piece.corners[self.loops[k][side]]
                for k, piece, side in zip(pair, present, sides, strict=True)
            ]
            normals = [piece.normals[side] for piece, side in zip(present, sides, strict=True)]
            levels = [piece.levels[side] for piece, side in zip(present, sides, strict=True)]
            along = poses.rotation[one.block] @ self.frames[pair[0]][sides[0]][1]
            axes = frame(normals[0] - normals[1], along)
            start = loops[0][0]
            flat = [(loop - start) @ axes[1:].T for loop in (loops[0], loops[1][::-1])]
            common = clipped(flat[0], flat[1])
            if len(common) < 3 or polygon_width(common) <= self.narrow:
                continue
            contact = Contact(one.block, two.block, axes, start + common @ axes[1:])
            places, areas = self.points(contact)
            at = (places - start) @ axes[1:].T
            inner = [_distance(loop, at) for loop in flat]
            for number, place in enumerate(places):
                mine = int(inner[0][number] > inner[1][number])  # whose corner it is
                other = 1 - mine
                rise = (levels[mine] - place @ normals[mine]) / (normals[mine] @ axes[0])
                point = place + rise * axes[0]
                gap = float(point @ normals[other] - levels[other])
                if -self.depth <= gap <= reach:
                    ends = np.array([present[mine].block, present[other].block])
                    arms = poses.local(ends, np.array([point, point - gap * normals[other]]))
                    local = self.frames[pair[other]][sides[other]]
                    key = (*pair, *sides, number)
                    yield *ends, *arms, local, areas[number], law.friction, key


def _without_end(block: Block, structure: Structure) -> tuple[Polyhedron, ...]:
    """Pieces of a block; of rigid ground below blocks, one that reaches farther than these go."""
    under = block.pieces[0].under
    if under is None:
        return block.pieces
    piece = block.pieces[0]
    side = int(np.argmax(piece.normals @ (under.centroid - piece.centroid)))
    low, high = np.transpose([other.extent for other in structure.blocks], (1, 0, 2))
    middle = 0.5 * (low.min(axis=0) + high.max(axis=0))
    reach = GROUND * float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    normal, across, along = _frames(piece.normals[[side]])[0]
    middle = middle - (middle @ normal - piece.levels[side]) * normal
    corners = [
        middle + reach * (a * across + b * along - c * normal)
        for a in (-1, 1)
        for b in (-1, 1)
        for c in (0, 1)
    ]
    return (Polyhedron.hull(corners),)


def _frames(normals: Array) -> Array:
    """Axes of sides, shape (sides, 3, 3): the first tangent is across y, where the normal is."""
    found = []
    for normal in normals:
        along = np.cross([0.0, 1.0, 0.0], normal)
        upright = np.linalg.norm(along) < FACING
        found.append(frame(normal, np.array([1.0, 0.0, 0.0]) if upright else along))
    return np.array(found)


def _distance(loop: Array, places: Array) -> Array:
    """Distances of places from the outline of a polygon, shape (places,)."""
    edge = np.roll(loop, -1, axis=0) - loop
    from_start = places[:, None] - loop
    part = np.einsum("pei,ei->pe", from_start, edge) / np.einsum("ei,ei->e", edge, edge)
    foot = np.clip(part, 0.0, 1.0)[:, :, None] * edge
    return np.asarray(np.linalg.norm(from_start - foot, axis=2).min(axis=1))
