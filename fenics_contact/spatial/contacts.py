"""Where blocks touch: common parts of coplanar sides, by clipping convex polygons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.polyhedra import Block

#: How far two sides that touch may lie apart, in parts of a typical block's size.
APART = 1e-5
#: Cosine of the largest angle between them, less 1.
TURNED = 1e-6
#: Least area of a contact, in parts of a typical block's size squared.
LEAST_AREA = 1e-5


@dataclass(frozen=True)
class Contact:
    """A convex polygon in which two blocks touch.

    Attributes:
        first: Number of a block.
        second: Number of the other one.
        axes: Unit normal from the first to the second, and two tangents, shape (3, 3).
        corners: m, counterclockwise about the normal, shape (corners, 3).
    """

    first: int
    second: int
    axes: Array
    corners: Array

    @property
    def in_plane(self) -> Array:
        """Corners from the first one along the tangents, m, shape (corners, 2)."""
        return np.asarray((self.corners - self.corners[0]) @ self.axes[1:].T)

    @property
    def area(self) -> float:
        """m2."""
        return polygon_area(self.in_plane)


def contacts_of(blocks: Sequence[Block]) -> tuple[Contact, ...]:
    """All contacts between blocks of which one moves at least, by numbers of blocks."""
    size = float(np.median([block.volume for block in blocks])) ** (1.0 / 3.0)
    near = APART * size
    low, high = (np.array([block.extent[k] for block in blocks]) for k in (0, 1))
    contacts: list[Contact] = []
    for first, block in enumerate(blocks):
        touching = np.all((low[first + 1 :] <= high[first] + near), axis=1)
        touching &= np.all(high[first + 1 :] >= low[first] - near, axis=1)
        for second in first + 1 + np.flatnonzero(touching):
            other = blocks[second]
            if not (block.fixed and other.fixed):
                contacts += _between(first, int(second), block, other, near, size)
    return tuple(contacts)


def _between(
    first: int, second: int, block: Block, other: Block, near: float, size: float
) -> list[Contact]:
    """Contacts of two blocks."""
    contacts = []
    for piece in block.pieces:
        for opposite in other.pieces:
            facing = np.argwhere(piece.normals @ opposite.normals.T < TURNED - 1.0)
            for side, reverse in facing:
                one = piece.corners[list(piece.sides[side])]
                two = opposite.corners[list(opposite.sides[reverse])]
                axes = frame(piece.normals[side])
                if np.abs((two - one[0]) @ axes[0]).max() > near:
                    continue
                flat = [(loop - one[0]) @ axes[1:].T for loop in (one, two[::-1])]
                common = clipped(flat[0], flat[1])
                if len(common) > 2 and polygon_area(common) > LEAST_AREA * size**2:
                    corners = one[0] + common @ axes[1:]
                    contacts.append(Contact(first, second, axes, corners))
    return contacts


def frame(normal: Array) -> Array:
    """A unit normal and two tangents, right-handed, shape (3, 3)."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    return np.array([normal, across, np.cross(normal, across)])


def polygon_area(points: Array) -> float:
    """Area of a polygon, shape (corners, 2), positive if counterclockwise."""
    x, y = points.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def clipped(polygon: Array, by: Array) -> Array:
    """Part of a convex polygon inside another one, both counterclockwise; empty if there is none.

    I.E. Sutherland, G.W. Hodgman, Commun. ACM 17 (1974) 32.
    """
    points: Any = polygon
    for start, end in zip(by, np.roll(by, -1, axis=0), strict=True):
        if len(points) < 3:
            return np.zeros((0, 2))
        along = end - start
        inside = along[0] * (points[:, 1] - start[1]) - along[1] * (points[:, 0] - start[0])
        least = -1e-9 * (along @ along)
        kept = []
        for point, value, other, next_value in zip(
            points, inside, np.roll(points, -1, axis=0), np.roll(inside, -1), strict=True
        ):
            if value >= least:
                kept.append(point)
            if (value - least) * (next_value - least) < 0.0 and max(value, next_value) > -least:
                kept.append(point + (other - point) * value / (value - next_value))
        points = np.array(kept).reshape(-1, 2)
    if len(points) < 3:
        return np.zeros((0, 2))
    sides = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    return np.asarray(points[sides > 1e-7 * sides.max()])
