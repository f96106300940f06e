"""Convex polyhedra and the rigid blocks that are made of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np

from fenics_contact.geometry.mesh import Array

#: Sides of a hexahedron whose first four corners are its bottom, the others above them in order.
HEXAHEDRON = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


@dataclass(frozen=True)
class Polyhedron:
    """A convex body with plane sides.

    Attributes:
        corners: m, shape (corners, 3).
        sides: Loops of corners, counterclockwise seen from outside.
    """

    corners: Array
    sides: tuple[tuple[int, ...], ...]

    @classmethod
    def hexahedron(cls, corners: Array) -> Self:
        """A body of eight corners: four of the bottom in a loop, and those above them."""
        points = np.asarray(corners, dtype=float)
        middle = points.mean(axis=0)
        sides = []
        for loop in HEXAHEDRON:
            side = points[list(loop)]
            normal = np.cross(side[2] - side[0], side[3] - side[1])
            outwards = normal @ (side.mean(axis=0) - middle) > 0.0
            sides.append(loop if outwards else loop[::-1])
        return cls(points, tuple(sides))

    @classmethod
    def box(cls, low: Array, high: Array) -> Self:
        """A body between two opposite corners, with sides along the axes."""
        plan = ((0, 0), (1, 0), (1, 1), (0, 1))
        points = [np.where([x, y, z], high, low) for z in (0, 1) for x, y in plan]
        return cls.hexahedron(np.array(points, dtype=float))

    @cached_property
    def normals(self) -> Array:
        """Unit normals of the sides, outwards, shape (sides, 3)."""
        sums = [_area_vector(self.corners[list(side)]) for side in self.sides]
        vectors = np.array(sums)
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])

    @cached_property
    def _moments(self) -> tuple[float, Array]:
        """Volume and its first moment, by tetrahedra on an inner point."""
        inside = self.corners.mean(axis=0)
        volume = 0.0
        moment = np.zeros(3)
        for side in self.sides:
            a = self.corners[side[0]]
            for second, third in pairwise(side[1:]):
                b = self.corners[second]
                c = self.corners[third]
                piece = np.linalg.det(np.array([a, b, c]) - inside) / 6.0
                volume += piece
                moment += piece * 0.25 * (a + b + c + inside)
        return float(volume), moment

    @property
    def volume(self) -> float:
        """m3."""
        return self._moments[0]

    @property
    def centroid(self) -> Array:
        """m, shape (3,)."""
        volume, moment = self._moments
        return np.asarray(moment / volume)


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


def _area_vector(loop: Array) -> Array:
    """Normal of a plane polygon, as long as its area is large."""
    following = np.roll(loop, -1, axis=0)
    return np.asarray(0.5 * np.cross(loop - loop[0], following - loop[0]).sum(axis=0))
