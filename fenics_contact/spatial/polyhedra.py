"""Convex polyhedra and the rigid blocks that are made of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import InputError, check_type, require, shown
from fenics_contact.geometry.mesh import Array, Indices

#: Sides of a hexahedron whose first four corners are its bottom, the others above them in order.
HEXAHEDRON = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
#: Corners that are as near as this are one, in parts of the body's extent.
SAME = 1e-6
#: Volume of a body that has none, in parts of its extent cubed; area of a side, of the surface.
NO_VOLUME, NO_AREA = 1e-9, 1e-9
#: Sides this near to the plane of a larger one are part of it, in parts of the body's thickness.
IN_PLANE = 1e-4
#: How far corners may lie off the planes of their sides and outside of others, in the same parts.
WARPED = 1e-2
#: Sides at most: a body of more was a curved one.
MOST_SIDES = 2000
#: Instead of 0 in a denominator.
TINY = 1e-300


@dataclass(frozen=True)
class Polyhedron:
    """A convex body with plane sides.

    Corners that coincide become one, sides turn their outside outwards, and sides in one plane, as
    triangles of a surface, become one. Sides that are a little warped are taken as plane.

    Attributes:
        corners: m, shape (corners, 3).
        sides: Loops of corners, counterclockwise seen from outside.
        problem: Why this is no convex body, in words; empty if it is one. No block is made of it.
    """

    corners: Array
    sides: tuple[tuple[int, ...], ...]
    problem: str = field(default="", init=False)

    def __post_init__(self) -> None:
        """Tidy up corners and sides."""
        try:
            corners, sides = _convex(*_closed(self.corners, self.sides))
            object.__setattr__(self, "corners", corners)
            object.__setattr__(self, "sides", sides)
        except InputError as error:
            object.__setattr__(self, "problem", str(error))

    @classmethod
    def hexahedron(cls, corners: Array) -> Self:
        """A body of eight corners: four of the bottom in a loop, and those above them.

        Corners may coincide, as in wedges.
        """
        return cls(corners, HEXAHEDRON)

    @classmethod
    def box(cls, low: Array, high: Array) -> Self:
        """A body between two opposite corners, with sides along the axes."""
        plan = ((0, 0), (1, 0), (1, 1), (0, 1))
        points = [np.where([x, y, z], high, low) for z in (0, 1) for x, y in plan]
        return cls.hexahedron(np.array(points, dtype=float))

    @classmethod
    def hull(cls, points: Array) -> Self:
        """The smallest convex body around points, shape (points, 3)."""
        from scipy.spatial import ConvexHull, QhullError

        try:
            triangles = ConvexHull(points).simplices
        except (QhullError, ValueError):  # points in a plane, or that are none
            triangles = ()
        return cls(points, tuple(tuple(triangle) for triangle in triangles))

    @cached_property
    def planes(self) -> Planes:
        """Planes of the sides, and what they enclose."""
        return Planes(self.corners, self.sides)

    @property
    def normals(self) -> Array:
        """Unit normals of the sides, outwards, shape (sides, 3)."""
        return self.planes.normal

    @property
    def volume(self) -> float:
        """m3."""
        return self.planes.volume

    @property
    def centroid(self) -> Array:
        """m, shape (3,)."""
        return self.planes.centroid


@dataclass(frozen=True)
class Block:
    """A rigid block: convex pieces that move as one.

    Attributes:
        pieces: At least one; they may touch each other.
        name: What messages call it.
        group: Key of materials and joints.
        fixed: Whether it is ground, which does not move.
    """

    pieces: tuple[Polyhedron, ...]
    name: str = ""
    group: str = "default"
    fixed: bool = False

    def __post_init__(self) -> None:
        """Refuse pieces that are no convex bodies.

        Raises:
            InputError: The message has the block's name and a measure.
        """
        require(len(self.pieces) > 0, f"block '{self.name}' has no pieces")
        for number, piece in enumerate(self.pieces):
            which = f", piece {number}" if len(self.pieces) > 1 else ""
            require(not piece.problem, f"block '{self.name}'{which}: {piece.problem}")

    @cached_property
    def volume(self) -> float:
        """m3."""
        return sum(piece.volume for piece in self.pieces)

    @cached_property
    def centroid(self) -> Array:
        """m, shape (3,)."""
        moments = [piece.volume * piece.centroid for piece in self.pieces]
        return np.asarray(np.sum(moments, axis=0) / self.volume)

    @cached_property
    def extent(self) -> tuple[Array, Array]:
        """Lowest and highest coordinates, m."""
        corners = np.vstack([piece.corners for piece in self.pieces])
        return corners.min(axis=0), corners.max(axis=0)


class Planes:
    """Planes of the sides of a body, and what they enclose.

    Attributes:
        points: m, shape (points, 3).
        corner: Numbers of the points at the sides, side after side, shape (ends,).
        side: Numbers of their sides, shape (ends,).
        start: Where each side begins among them, shape (sides,).
        edge: To the following corner of the side, m, shape (ends, 3).
        outwards: Whether a loop is counterclockwise seen from outside, shape (sides,).
        area: m2, shape (sides,).
        normal: Unit vectors outwards, shape (sides, 3).
        level: Of planes through the means of corners, n . x = level, m, shape (sides,).
        volume: m3.
        centroid: m, shape (3,).
        thickness: Six times the volume over the surface, m: the side of a cube.
    """

    def __init__(self, points: Array, loops: Sequence[Sequence[int]]) -> None:
        """Take points and loops of them around the sides of a convex body."""
        count = np.array([len(loop) for loop in loops])
        self.points = points
        self.corner = np.concatenate(loops)
        self.side = np.repeat(np.arange(len(loops)), count)
        self.start = np.cumsum(count) - count
        self.edge = points[np.concatenate([(*loop[1:], loop[0]) for loop in loops])]
        self.edge -= points[self.corner]
        inside = points[self.corner].mean(axis=0)
        middle = np.add.reduceat(points[self.corner], self.start) / count[:, None] - inside
        arm = points[self.corner] - inside
        across = middle[self.side]
        twice = np.cross(arm - across, self.edge)  # areas of triangles on edges, with the middle
        vector = 0.5 * np.add.reduceat(twice, self.start)
        self.outwards = np.einsum("sk,sk->s", vector, middle) > 0.0
        sign = np.where(self.outwards, 1.0, -1.0)
        self.area = np.linalg.norm(vector, axis=1)
        self.normal = vector * (sign / np.maximum(self.area, TINY))[:, None]
        self.level = np.einsum("sk,sk->s", self.normal, middle + inside)
        pyramids = sign[self.side] * np.einsum("ek,ek->e", across, twice) / 6.0
        self.volume = float(pyramids.sum())
        moment = 0.25 * pyramids @ (across + 2.0 * arm + self.edge)
        self.centroid = np.asarray(inside + moment / max(self.volume, TINY))
        self.thickness = 6.0 * self.volume / max(float(self.area.sum()), TINY)

    @cached_property
    def height(self) -> Array:
        """Of all points above the planes, m, shape (points, sides)."""
        return np.asarray(self.points @ self.normal.T - self.level)

    @cached_property
    def outside(self) -> Array:
        """How far points lie off the planes of their sides, or outside of others, m."""
        outside = self.height.copy()
        outside[self.corner, self.side] = np.abs(outside[self.corner, self.side])
        return outside

    @cached_property
    def warp(self) -> float:
        """The largest of these distances, m."""
        return float(self.outside.max())


def _closed(corners: Any, sides: Iterable[Any]) -> tuple[Array, list[list[int]]]:
    """Points and loops of them around the sides of a closed surface.

    Points that coincide have the number of the first of them; sides that are lines are left out.

    Raises:
        InputError: Without the name of the block.
    """
    from scipy.spatial.distance import cdist

    check_type("corners", corners, npt.ArrayLike)
    points = np.array(corners, dtype=float)
    right = points.ndim == 2 and points.shape[1] == 3 and 3 < len(points) <= 3 * MOST_SIDES
    what = f"corners must be 4 to {3 * MOST_SIDES} points [x, y, z]"
    require(bool(right and np.isfinite(points).all()), what)
    distance = cdist(points, points)
    first = np.argmax(distance <= SAME * distance.max(), axis=1)
    loops = []
    for side in sides:
        known = all(isinstance(k, (int, np.integer)) and 0 <= k < len(points) for k in side)
        require(known, f"side {shown(side)} must be numbers of corners, 0 to {len(points) - 1}")
        loop = [int(first[k]) for k in side]
        loop = [corner for k, corner in enumerate(loop) if corner != loop[k - 1]]
        if len(loop) > 2:
            loops.append(loop)
    what = f"it has {len(loops)} sides with an area; give 4 to {MOST_SIDES}"
    require(3 < len(loops) <= MOST_SIDES, what)
    edges = [tuple(sorted((loop[k - 1], loop[k]))) for loop in loops for k in range(len(loop))]
    for edge, count in Counter(edges).items():
        where = f"the edge between corners {edge[0]} and {edge[1]}"
        require(count == 2, f"it is not closed: {where} is in {count} sides, not 2")
    return points, loops


def _convex(points: Array, loops: list[list[int]]) -> tuple[Array, tuple[tuple[int, ...], ...]]:
    """Corners and sides of a convex body, with one side in each plane.

    Raises:
        InputError: If it is not convex; without the name of the block.
    """
    given = Planes(points, loops)
    extent = float(np.ptp(points[given.corner], axis=0).max())
    thin = f"its volume of {given.volume:.3g} m3 is as good as none at a length of {extent:.3g} m"
    require(given.volume > NO_VOLUME * extent**3, thin)
    near = np.abs(given.height[given.corner]) < IN_PLANE * given.thickness
    lies_in = np.logical_and.reduceat(near, given.start)
    np.fill_diagonal(lies_in, True)
    host = np.argmax(lies_in * given.area, axis=1)
    joined = []
    for number in np.unique(host[host]):
        crossed = f"side {loops[number]} crosses itself; give its corners in a loop"
        require(given.area[number] > NO_AREA * given.area.sum(), crossed)
        parts = np.flatnonzero(host[host] == number)
        loop = loops[number] if given.outwards[number] else loops[number][::-1]
        joined.append(
            loop if len(parts) == 1 else _outline(points, loops, parts, given.normal[number])
        )
    planes = Planes(points, joined)
    used = np.unique(planes.corner)
    row, side = np.unravel_index(planes.outside[used].argmax(), (len(used), len(joined)))
    off = planes.outside[used[row], side]
    what, cure = "is not convex", "block into convex pieces"
    if used[row] in joined[side]:
        what, cure = "is warped", "side into triangles"
    allowed = WARPED * planes.thickness
    measure = f"corner {used[row]} lies {off:.3g} m off side {joined[side]}, above {allowed:.2g} m"
    require(bool(off <= allowed), f"it {what}: {measure}; cut the {cure}")
    number = np.zeros(len(points), dtype=int)
    number[used] = np.arange(len(used))
    return points[used], tuple(tuple(number[loop].tolist()) for loop in joined)


def _outline(points: Array, loops: list[list[int]], parts: Indices, normal: Array) -> list[int]:
    """Convex hull of sides in one plane, counterclockwise about its normal."""
    from scipy.spatial import ConvexHull

    corners = np.unique(np.concatenate([loops[part] for part in parts]))
    along = points[corners[1]] - points[corners[0]]
    tangents = np.array([along, np.cross(normal, along)])
    loop = corners[ConvexHull((points[corners] - points[corners[0]]) @ tangents.T).vertices]
    return np.roll(loop, -loop.argmin()).tolist()
