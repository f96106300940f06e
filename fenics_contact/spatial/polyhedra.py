"""Convex polyhedra and the rigid blocks that are made of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import InputError, check_type, require, shown
from fenics_contact.geometry.mesh import Array, Indices

#: Sides of a hexahedron whose first four corners are its bottom, the others above them in order.
HEXAHEDRON = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
#: Corners that are as near as this are one, in parts of the body's extent.
SAME = 1e-6
#: Area of a side that has none, in parts of the body's surface.
NO_AREA = 1e-9
#: Sides this near to the plane of a larger one are part of it, in parts of the body's thickness.
IN_PLANE = 1e-4
#: How far corners may lie off the planes of their sides and outside of others, in the same parts.
WARPED = 1e-2
#: Sides at most: a body of more was a curved one.
MOST_SIDES = 2000
#: Instead of 0 in a denominator.
TINY = 1e-300


class PlaneSides:
    """Sides of a convex body, and what they enclose.

    Attributes:
        corners: m, shape (corners, 3).
        sides: Loops of corners, counterclockwise seen from outside.
        at_sides: Numbers of corners, side after side, and of their sides: an index of heights.
        areas: m2, shape (sides,).
        normals: Unit vectors outwards, shape (sides, 3).
        levels: Of planes through the means of corners, n . x = level, m, shape (sides,).
        volume: m3.
        centroid: m, shape (3,).
        thickness: Six times the volume over the surface, m: the side of a cube.
    """

    def __init__(self, points: Array, sides: Sequence[Sequence[int]]) -> None:
        """Take sides of a convex body as loops of points, m, shape (points, 3)."""
        count = np.array([len(side) for side in sides])
        self._start = np.cumsum(count) - count
        side = np.repeat(np.arange(len(sides)), count)
        used, corner = np.unique(np.concatenate(sides), return_inverse=True)
        self.at_sides = corner, side
        loops = np.split(corner, self._start[1:])
        self.corners = points[used]
        points = self.corners[corner]
        edge = self.corners[np.concatenate([np.roll(loop, -1) for loop in loops])] - points
        inside = points.mean(axis=0)
        middle = np.add.reduceat(points, self._start) / count[:, None] - inside
        apex = middle[side]
        twice = np.cross(points - inside - apex, edge)  # areas of triangles on edges
        vector = 0.5 * np.add.reduceat(twice, self._start)
        sign = np.where(np.einsum("sk,sk->s", vector, middle) > 0.0, 1, -1)
        turned = zip(loops, sign.tolist(), strict=True)
        self.sides = tuple(tuple(loop[::step].tolist()) for loop, step in turned)
        self.areas = np.linalg.norm(vector, axis=1)
        self.normals = vector * (sign / np.maximum(self.areas, TINY))[:, None]
        self.levels = np.einsum("sk,sk->s", self.normals, middle + inside)
        pyramids = sign[side] * np.einsum("ek,ek->e", apex, twice) / 6.0
        self.volume = float(pyramids.sum())
        moment = 0.25 * pyramids @ (apex + 2.0 * (points - inside) + edge)
        self.centroid = np.asarray(inside + moment / max(self.volume, TINY))
        self.thickness = 6.0 * self.volume / max(float(self.areas.sum()), TINY)

    @property
    def heights(self) -> Array:
        """Of corners above the planes of sides, m, shape (corners, sides)."""
        return np.asarray(self.corners @ self.normals.T - self.levels)

    def joined(self) -> list[tuple[int, ...]]:
        """Sides; those in the plane of a larger one are part of it.

        Raises:
            InputError: Without the name of the block.
        """
        flat = f"it has a volume of {self.volume:.3g} m3: its corners lie in a plane"
        require(self.thickness > SAME * float(self.areas.sum()) ** 0.5, flat)
        in_plane = np.abs(self.heights[self.at_sides[0]]) < IN_PLANE * self.thickness
        lies_in = np.logical_and.reduceat(in_plane, self._start)
        np.fill_diagonal(lies_in, True)
        largest = np.argmax(lies_in * self.areas, axis=1)
        joined = []
        for number in np.unique(largest[largest]):
            parts = np.flatnonzero(largest[largest] == number)
            side = self.sides[number]
            crosses = f"side {list(side)} crosses itself; give its corners in a loop"
            require(self.areas[number] > NO_AREA * self.areas.sum(), crosses)
            joined.append(side if len(parts) == 1 else self._outline(parts, self.normals[number]))
        return joined

    def _outline(self, parts: Indices, normal: Array) -> tuple[int, ...]:
        """Convex hull of sides in one plane, counterclockwise about its normal."""
        from scipy.spatial import ConvexHull

        numbers = np.unique(np.concatenate([self.sides[part] for part in parts]))
        points = self.corners[numbers] - self.corners[numbers[0]]
        tangents = np.array([points[1], np.cross(normal, points[1])])
        loop = numbers[ConvexHull(points @ tangents.T).vertices]
        return tuple(np.roll(loop, -loop.argmin()).tolist())


class Polyhedron(PlaneSides):
    """A convex body with plane sides.

    Corners that coincide become one, sides turn their outside outwards, and sides in one plane, as
    triangles of a surface, become one. Sides that are a little warped are taken as plane.

    Attributes:
        warp: How far corners lie off the planes of their sides, or outside of others, m.
        problem: Why this is no convex body, in words; empty if it is one. No block is made of it.
        under: Of ground: the only body that it touches, which lies on it; None: it touches any.
    """

    under: Polyhedron | None = None

    def __init__(self, corners: Any, sides: Iterable[Any]) -> None:
        """Take corners, m, shape (corners, 3), and sides as loops of their numbers."""
        self.problem = ""
        try:
            given = PlaneSides(*_closed(corners, sides))
            super().__init__(given.corners, given.joined())
            self._check_convex()
        except InputError as error:
            self.problem = str(error)

    def _check_convex(self) -> None:
        """Refuse corners off the planes of their sides, or outside of others.

        Raises:
            InputError: Without the name of the block.
        """
        off = self.heights
        off[self.at_sides] = np.abs(off[self.at_sides])
        corner, side = np.unravel_index(off.argmax(), off.shape)
        self.warp = float(off[corner, side])
        allowed = WARPED * self.thickness
        place = _place(self.corners[corner])
        middle = _place(self.corners[list(self.sides[side])].mean(axis=0))
        text = f"corner {place} lies {self.warp:.3g} m off the side about {middle}"
        cure = "cut it into convex pieces, or a warped side into triangles"
        require(self.warp <= allowed, f"it is not convex: {text}, above {allowed:.2g} m; {cure}")

    @classmethod
    def hexahedron(cls, corners: npt.ArrayLike) -> Self:
        """A body of eight corners: four of the bottom in a loop, and those above them.

        Corners may coincide, as in wedges.
        """
        return cls(corners, HEXAHEDRON)

    @classmethod
    def box(cls, low: npt.ArrayLike, high: npt.ArrayLike) -> Self:
        """A body between two opposite corners, with sides along the axes."""
        plan = ((0, 0), (1, 0), (1, 1), (0, 1))
        return cls([np.where([x, y, z], high, low) for z in (0, 1) for x, y in plan], HEXAHEDRON)

    @classmethod
    def hull(cls, points: npt.ArrayLike) -> Self:
        """The smallest convex body around points, shape (points, 3)."""
        from scipy.spatial import ConvexHull, QhullError

        try:
            return cls(points, ConvexHull(points).simplices.tolist())
        except (QhullError, ValueError):  # points in a plane, or that are none
            return cls(points, ())


@dataclass(frozen=True)
class Block:
    """A rigid block: convex pieces that move as one.

    Attributes:
        pieces: At least one; they may touch each other.
        name: What messages call it.
        group: Key of materials and joints.
        fixed: Whether it is ground, which does not move.
        cut: Whether a whole body was cut into its pieces: they may be slivers, and overlap.
        cells: Corners of the tetrahedra that a file has for it, m, shape (cells, 4, 3); None: gmsh
            makes some where stresses are asked for.
    """

    pieces: tuple[Polyhedron, ...]
    name: str = ""
    group: str = "default"
    fixed: bool = False
    cut: bool = False
    cells: Array | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        """Refuse pieces that are no convex bodies.

        Raises:
            InputError: The message has the block's name and a measure.
        """
        require(len(self.pieces) > 0, f"block '{self.name}' has no pieces")
        for number, piece in enumerate(self.pieces):
            which = f", piece {number}" if len(self.pieces) > 1 else ""
            require(not piece.problem, f"block '{self.name}'{which}: {piece.problem}")

    def thickness(self, piece: Polyhedron) -> float:
        """Of a piece, m, by which tolerances are measured: that of the largest, if it was cut."""
        return max(p.thickness for p in self.pieces) if self.cut else piece.thickness

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


class ReadBlocks(NamedTuple):
    """Blocks of the table [blocks], or of files.

    Attributes:
        blocks: Of a file, of a builder, or one by one.
        told: How many bodies files name, how many blocks were read, how many things left out.
        notes: What of a file was left out, or taken otherwise than written.
        sides: Names of sides that a drawing gives, and lines on which they lie.
        size: Length of edges of tetrahedra, m; None: by the blocks.
        elastic: Whether blocks strain in the search.
    """

    blocks: tuple[Block, ...]
    told: str = ""
    notes: tuple[str, ...] = ()
    sides: Mapping[str, Any] = {}
    size: float | None = None
    elastic: bool = False


def _closed(corners: Any, sides: Iterable[Any]) -> tuple[Array, list[list[int]]]:
    """Corners and sides of a closed surface.

    Corners that coincide have the number of the first of them; sides that are lines are left out.

    Raises:
        InputError: Without the name of the block.
    """
    from scipy.spatial.distance import cdist

    check_type("corners", corners, npt.ArrayLike)
    points = np.array(corners, dtype=float)
    right = points.ndim == 2 and points.shape[1] == 3 and 3 < len(points) <= 3 * MOST_SIDES
    what = f"corners must be 4 to {3 * MOST_SIDES} finite points [x, y, z]"
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
    problem = not_closed(points, loops)
    require(not problem, f"it {problem}")
    return points, loops


def edges_of(loop: Sequence[int]) -> list[tuple[int, int]]:
    """Edges of a side, the smaller number first."""
    return [(min(a, b), max(a, b)) for a, b in pairwise([*loop, loop[0]])]


def not_closed(points: Array, loops: Sequence[Sequence[int]]) -> str:
    """Which edge of a surface is not in two sides, in words; empty if it is closed."""
    uses = Counter(edge for loop in loops for edge in edges_of(loop))
    (start, end), count = max(uses.items(), key=lambda use: abs(use[1] - 2))
    ends = f"{_place(points[start])} and {_place(points[end])}"
    return (
        "" if count == 2 else f"is not closed: the edge between {ends} is in {count} sides, not 2"
    )


def _place(point: Array) -> str:
    """Coordinates in words."""
    return "({:g}, {:g}, {:g})".format(*point)
