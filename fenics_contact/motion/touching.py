"""Points of blocks in motion, and the planes of others that they touch or soon will.

A unit is a corner of the common part of two sides that face each other: a material point P of one
block, and the plane of a side of the other one, which turns with its block. Its gap is the distance
of P from the plane, its place the coordinates of P along the plane. Both are exact in any pose, so
that hinges roll and slide without drift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import near_pairs
from fenics_contact.motion.poses import Poses
from fenics_contact.spatial.contacts import Contact
from fenics_contact.spatial.points import points_of
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.structure import Structure

#: Cosine of the angle up to which sides that face each other may touch: 60 degrees.
FACING = 0.5
#: Sides overlap by this at most to be in contact, in parts of the thinnest piece.
DEPTH = 0.02
#: Width of a common part, in the same parts, below which it is none; corners nearer are one.
NARROW, SAME = 2e-3, 1e-9
#: Rigid ground reaches so many times the structure's extent.
GROUND = 10.0


@dataclass(frozen=True)
class PointUnits:
    """Points of blocks against planes of others, fixed to these.

    Attributes:
        point: Blocks of the points, shape (units,).
        plane: Blocks of the planes.
        arm: Points, from the centroids as drawn, m, shape (units, 3).
        origin: Places in the planes, likewise.
        axes: Normals out of the planes and two tangents, in the blocks as drawn, (units, 3, 3).
        friction: Coefficients.
    """

    point: Indices
    plane: Indices
    arm: Array
    origin: Array
    axes: Array
    friction: Array

    def __len__(self) -> int:
        return len(self.point)

    def at(self, poses: Poses) -> tuple[Array, Array, Array]:
        """Places, m, axes, and gap and places along the planes, shape (units, 3)."""
        place = poses.placed(self.point, self.arm)
        from_plane = place - poses.placed(self.plane, self.origin)
        axes = np.einsum("uij,ukj->uki", poses.rotation[self.plane], self.axes)
        return place, axes, np.einsum("uki,ui->uk", axes, from_plane)


class Present(NamedTuple):
    """Corners of pieces, axes and levels of sides in some poses, and these as loops of corners."""

    corners: Array
    axes: Array
    levels: Array
    loops: Array


class MovingSides:
    """Sides of all pieces of a structure, fixed to their blocks.

    Attributes:
        owner: Blocks of the pieces.
        corners: Of pieces, from the centroids as drawn, m, shape (pieces, ., 3); the last one of a
            piece is repeated until all have as many.
        reach: Largest distances of corners from the centroids of blocks, m.
    """

    def __init__(self, structure: Structure, start: Poses) -> None:
        self.structure = structure
        contacts = zip(structure.contacts, structure.laws, strict=True)
        drawn = {frozenset((one.first, one.second)): law for one, law in contacts}
        self._law_of = structure.law_of or (lambda *pair: drawn.get(frozenset(pair)))
        self._moves = moves = structure.number >= 0
        bodies = [_without_end(block, structure) for block in structure.blocks]
        pieces = [piece for body in bodies for piece in body]
        self.owner = np.repeat(np.arange(len(bodies)), [len(body) for body in bodies])
        centroid = start.centroid[self.owner]
        self.corners = _padded([piece.corners for piece in pieces]) - centroid[:, None]
        self.reach = np.zeros(len(bodies))
        np.maximum.at(self.reach, self.owner, np.linalg.norm(self.corners, axis=2).max(axis=1))
        thinnest = min(p.thickness for p, k in zip(pieces, self.owner, strict=True) if moves[k])
        self._depth, self._narrow, self._same = (part * thinnest for part in (DEPTH, NARROW, SAME))
        # Sides, one after the other; in the plane those across it.
        normals = np.vstack([piece.normals for piece in pieces])
        kept = np.flatnonzero((np.abs(normals[:, 1]) < FACING) | (structure.dimension == 3))
        normals = normals[kept]
        self._piece = np.repeat(np.arange(len(pieces)), [len(one.sides) for one in pieces])[kept]
        self._block = self.owner[self._piece]
        self._loops = _padded([np.array(side) for one in pieces for side in one.sides])[kept]
        self._frames = _frames(normals)
        levels = np.concatenate([piece.levels for piece in pieces])[kept]
        self._levels = levels - _dot(normals, start.centroid[self._block])

    def near(self, poses: Poses, reach: float) -> PointUnits:
        """Units of all sides that face each other and are as near as `reach`, m."""
        present = self._present(poses)
        normals = present.axes[:, 0]
        pairs = self._facing(present, reach)
        pair, second, place, across = self._common(present, pairs)
        mine, other = pairs[pair, second], pairs[pair, 1 - second]
        rise = present.levels[mine] - _dot(place, normals[mine])
        place = place + (rise / _dot(across, normals[mine]))[:, None] * across
        gap = _dot(place, normals[other]) - present.levels[other]
        foot = place - gap[:, None] * normals[other]
        ends = self._block[mine], self._block[other]
        friction = self._friction(*ends)
        kept = (gap >= -self._depth) & (gap <= reach) & np.isfinite(friction)
        arms = poses.local(ends[0], place), poses.local(ends[1], foot)
        every = (*ends, *arms, self._frames[other], friction)
        return PointUnits(*(array[kept] for array in every))

    def placed(self, poses: Poses) -> Array:
        """Corners of all pieces, m, shape (pieces, ., 3)."""
        turned = np.einsum("pij,pcj->pci", poses.rotation[self.owner], self.corners)
        return np.asarray(poses.centroid[self.owner][:, None] + turned)

    def _present(self, poses: Poses) -> Present:
        corners = self.placed(poses)
        axes = np.einsum("sij,skj->ski", poses.rotation[self._block], self._frames)
        levels = self._levels + _dot(axes[:, 0], poses.centroid[self._block])
        return Present(corners, axes, levels, corners[self._piece[:, None], self._loops])

    def _facing(self, present: Present, reach: float) -> Indices:
        """Pairs of sides that face each other, as near as that, one of which parts its pieces."""
        corners, axes, levels, loops = present
        low, high = loops.min(axis=1), loops.max(axis=1)
        every = np.arange(len(loops))
        radius = 0.5 * (np.linalg.norm(high - low, axis=1) + reach)
        portions = near_pairs(0.5 * (low + high), radius, every, every)
        one, two = np.concatenate([np.stack(part, axis=1) for part in portions]).T
        near = np.all(np.maximum(low[one] - high[two], low[two] - high[one]) <= reach, axis=1)
        first, second = self._block[one], self._block[two]
        wanted = near & (one < two) & (first != second) & (self._moves[first] | self._moves[second])
        wanted &= _dot(axes[one, 0], axes[two, 0]) < -FACING
        pairs = np.unique(np.column_stack([one, two])[wanted], axis=0)
        apart = np.full(len(pairs), -np.inf)
        for side, other in (pairs.T, pairs.T[::-1]):
            heights = np.einsum("pci,pi->pc", corners[self._piece[other]], axes[side, 0])
            apart = np.maximum(apart, heights.min(axis=1) - levels[side])
        return np.asarray(pairs[(apart >= -self._depth) & (apart <= reach)])

    def _common(self, present: Present, pairs: Indices) -> tuple[Indices, Indices, Array, Array]:
        """Points of the common parts of sides, halfway between these.

        Returns:
            Numbers of pairs; 0 for points of the first sides, 1 for those of the second; places, m;
            and unit vectors across.
        """
        one, two = pairs.T
        axes = present.axes
        between = _frames(axes[one, 0] - axes[two, 0], axes[one, 1])
        start = present.loops[one, 0]
        loops = [
            np.einsum("pci,pki->pck", loop - start[:, None], between[:, 1:]) @ [1.0, 1.0j]
            for loop in (present.loops[one], present.loops[two, ::-1])
        ]
        pair, point, second = _corners(loops, self._same)
        wide = (_width(pair, point, np.hstack(loops)) > self._narrow)[pair]
        if self.structure.dimension == 2:  # in the middle of the front and back corners
            middle = loops[0].imag.mean(axis=1)[pair]
            wide &= point.imag < middle
            point = point.real + 1.0j * middle
        pair, point, second = pair[wide], point[wide], second[wide]
        if not self.structure.quick and self.structure.dimension == 3:
            pair, point, second = _filled(pair, point, loops)
        along = point.real[:, None] * between[pair, 1] + point.imag[:, None] * between[pair, 2]
        return pair, second, start[pair] + along, between[pair, 0]

    def _friction(self, one: Indices, two: Indices) -> Array:
        """Of pairs of blocks; infinite where nothing is between them."""
        pairs, number = np.unique(np.column_stack([one, two]), axis=0, return_inverse=True)
        laws = [self._law_of(*pair) for pair in pairs.tolist()]
        return np.array([np.inf if law is None else law.friction for law in laws])[number]


def _corners(loops: Sequence[Any], near: float) -> tuple[Indices, Any, Indices]:
    """Corners of the common parts of convex polygons, counterclockwise, shape (pairs, corners).

    Points are complex numbers here. Crossings of edges count to the first polygons.

    Returns:
        Numbers of pairs, in order; points; 0 for corners of the first polygon, 1 of the second.
    """
    one, two = loops
    above, below = _heights(one, two), _heights(two, one)
    inside = [np.all(heights >= -near, axis=2) for heights in (above, below)]
    inside[0] &= one != np.roll(one, 1, axis=1)  # those that are repeated
    inside[1] &= two != np.roll(two, 1, axis=1)
    inside[1] &= np.all(np.abs(one[:, :, None] - two[:, None]) >= near, axis=1)
    passes = []
    for heights in (above, below):
        ends = np.array([heights, np.roll(heights, -1, axis=1)])
        passes.append((ends.min(axis=0) < -near) & (ends.max(axis=0) > near))
    crosses = passes[0] & passes[1].transpose(0, 2, 1)
    with np.errstate(all="ignore"):
        part = above / (above - np.roll(above, -1, axis=1))
        crossing = one[:, :, None] + part * (np.roll(one, -1, axis=1) - one)[:, :, None]
    shape = (len(one), -1)
    kept = np.hstack([*inside, crosses.reshape(shape)])
    points = np.hstack([one, two, crossing.reshape(shape)])
    pair, number = np.nonzero(kept)
    second = (number >= one.shape[1]) & (number < one.shape[1] + two.shape[1])
    return pair, points[pair, number], second.astype(int)


def _heights(points: Any, loops: Any) -> Array:
    """Of points above the edges of polygons, shape (pairs, points, edges); repeated ones: none."""
    edge = np.roll(loops, -1, axis=1) - loops
    length = np.abs(edge)[:, None]
    along = (points[:, :, None] - loops[:, None]) * np.conj(edge)[:, None]
    return np.where(length > 0.0, along.imag / np.where(length > 0.0, length, 1.0), np.inf)


def _width(pair: Indices, point: Any, loops: Any) -> Array:
    """Least extents of the points of pairs across edges of polygons, by pairs."""
    width = np.zeros(len(loops))
    some, begin = np.unique(pair, return_index=True)
    if len(some):
        heights = _heights(point[:, None], loops[pair])[:, 0]
        high = np.maximum.reduceat(heights, begin)
        low = np.minimum.reduceat(np.where(np.isfinite(heights), heights, 0.0), begin)
        width[some] = (high - low).min(axis=1)
    return width


def _filled(pair: Indices, point: Any, loops: Sequence[Any]) -> tuple[Indices, Any, Indices]:
    """Points in common parts in place of corners: of the polygon whose outline is nearer."""
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    numbers, begin = np.unique(pair, return_index=True)
    found = [np.zeros(0, complex)]
    for corners in np.split(point, begin[1:]) if len(numbers) else ():
        loop = corners[np.argsort(np.angle(corners - corners.mean()))]
        flat = np.column_stack([loop.real, loop.imag, np.zeros(len(loop))])
        found.append(points_of(Contact(0, 1, axes, flat))[0][:, :2] @ [1.0, 1.0j])
    every = np.concatenate(found)
    pair = np.repeat(numbers, [len(points) for points in found[1:]])
    inner = [_heights(every[:, None], loop[pair]).min(axis=(1, 2)) for loop in loops]
    return pair, every, (inner[0] > inner[1]).astype(int)


def _without_end(block: Block, structure: Structure) -> tuple[Polyhedron, ...]:
    """Pieces of a block; of rigid ground below blocks, one that reaches farther than these go."""
    under = block.pieces[0].under
    if under is None:
        return block.pieces
    piece = block.pieces[0]
    side = int(np.argmax(piece.normals @ (under.centroid - piece.centroid)))
    low, high = np.transpose([other.extent for other in structure.blocks], (1, 0, 2))
    low, high = low.min(axis=0), high.max(axis=0)
    reach = GROUND * float(np.linalg.norm(high - low))
    axes = _frames(piece.normals[[side]])[0]
    middle = 0.5 * (low + high)
    middle = middle - (middle @ axes[0] - piece.levels[side]) * axes[0]
    signs = np.array([[-c, a, b] for a in (-1, 1) for b in (-1, 1) for c in (0, 1)])
    return (Polyhedron.hull(middle + reach * signs @ axes),)


def _frames(normals: Array, along: Array | None = None) -> Array:
    """Unit normals and two tangents, shape (., 3, 3): the first one along a direction.

    By default it is in the plane x-z, or x where that is across the normal.
    """
    if along is None:
        along = np.cross([0.0, 1.0, 0.0], normals)
        along[np.linalg.norm(along, axis=1) < FACING] = [1.0, 0.0, 0.0]
    up = normals / np.linalg.norm(normals, axis=1)[:, None]
    across = along - _dot(along, up)[:, None] * up
    across = across / np.linalg.norm(across, axis=1)[:, None]
    return np.stack([up, across, np.cross(up, across)], axis=1)


def _padded(rows: Sequence[Any]) -> Any:
    """Arrays as one; the last entry of each is repeated until all have as many."""
    most = max(len(row) for row in rows)
    return np.array([[*row, *[row[-1]] * (most - len(row))] for row in rows])


def _dot(one: Array, two: Array) -> Array:
    """Products of vectors, shape (.,)."""
    return np.asarray(np.einsum("ni,ni->n", one, two))
