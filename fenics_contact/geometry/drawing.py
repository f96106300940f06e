"""Drawings of blocks: outlines with named sides, as arrays; see `read_dxf` for those of CAD."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import check_types, checked
from fenics_contact.geometry.meshing import default_size, polygons
from fenics_contact.geometry.outlines import (
    Segments,
    divided_outlines,
    inside_outlines,
    points_near_segments,
    sides_of_outlines,
    sides_on,
)
from fenics_contact.geometry.planar_cells import Array

#: Corners this close to another block without touching it are told of, relative to the side of a
#: square of the blocks' mean area, or as far as mortar joints are thick.
GAP = 0.06


@dataclass(frozen=True)
class Drawing:
    """Straight-sided blocks of a planar structure, and lines that name their sides.

    Attributes:
        blocks: Corners of every block in order, either way round, each of shape (corners, 2), m.
        names: Two-dimensional group of every block.
        groups: Segments ((x0, y0), (x1, y1)), m, by name of the one-dimensional group of all sides
            that lie on them. Where two blocks touch, both sides do.
    """

    blocks: Sequence[Array]
    names: Sequence[str]
    groups: Segments = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_types(self)

    @checked
    def with_group(self, name: str, *segments: npt.ArrayLike) -> Drawing:
        """The drawing with one more group, of what lies on `segments`; see `groups`."""
        return replace(self, groups={**self.groups, name: segments})

    @checked
    def mesh(self, size: float | None = None, quadrilaterals: bool = False) -> Any:
        """Gmsh model of the drawing; arguments and errors are those of `meshing.polygons`."""
        return polygons(self.blocks, size, self.names, self.groups, quadrilaterals)

    def lengths(self) -> dict[str, float]:
        """Length of the sides in every group, m, both sides where blocks touch."""
        blocks, near = divided_outlines(list(self.blocks), self.groups)
        sides = np.linalg.norm(np.diff(sides_of_outlines(blocks), axis=1)[:, 0], axis=1)
        found = sides_on(blocks, self.groups, near)
        return {name: float(sides[on].sum()) for name, on in found.items()}

    def gaps(self, thickness: float = 0.0) -> Array:
        """Corners that lie close to another block without touching it, shape (corners, 4).

        The columns are x, y and the distance, m, and 1 where it is the distance of a side that the
        corner faces, 0 where the nearest is another corner; see `GAP`. `thickness` is
        that of mortar joints, m.
        """
        blocks, near = divided_outlines(list(self.blocks), {})
        ends = sides_of_outlines(blocks)
        owner = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])
        reach = max(4.0 * GAP * default_size(blocks), 1.01 * thickness)
        corners = np.unique(ends[:, 0], axis=0)
        pairs = points_near_segments(corners, ends, reach)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[pairs.segment]
        beyond = np.abs(pairs.at - np.clip(pairs.at, 0.0, 1.0)) * length
        order = np.lexsort([beyond > near, pairs.distance, owner[pairs.segment], pairs.point])
        key = np.column_stack([pairs.point, owner[pairs.segment]])[order]
        first = order[np.any(np.diff(key, axis=0, prepend=-1) != 0, axis=1)]  # of corner and block
        first = first[pairs.distance[first] > near]
        place = corners[pairs.point[first]]
        middle = place + 0.5 * pairs.way[first]
        empty = inside_outlines(middle, blocks) < 0  # between corner and block there is no block
        empty[points_near_segments(middle, ends, near).point] = False
        rows = np.column_stack([place, pairs.distance[first], beyond[first] <= near])
        return rows[empty]
