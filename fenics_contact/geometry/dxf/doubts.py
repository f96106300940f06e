"""What looks wrong in a drawing: places with what is there, in words for a user."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.geometry.drawing import LIMITS as DRAWING_LIMITS
from fenics_contact.geometry.meshing import default_size
from fenics_contact.geometry.outlines import inside_outlines, overlaps
from fenics_contact.geometry.planar_cells import Array
from fenics_contact.geometry.point_pairs import points_near_segments


@dataclass(frozen=True)
class DrawingDoubts:
    """From where on something is suspicious.

    Attributes:
        open: Distance between the ends of an open polyline, over its length, below which it might
            be a block that was not closed.
        small: Area of a block over the median one below which it might be a mistake.
        large: Mean area of the blocks of a layer over the median one above which they might be
            openings.
    """

    open: float = 0.25
    small: float = 1e-3
    large: float = 4.0


DOUBTS = DrawingDoubts()

#: A suspicious place, in the unit of the drawing, and what is there.
Doubt = tuple[Array, str]


def open_polyline(chain: Array, layer: str, unit: str) -> Iterator[Doubt]:
    """An open polyline on a layer of blocks, if its ends are near each other."""
    length = float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum())
    distance = float(np.linalg.norm(chain[-1] - chain[0]))
    if len(chain) > 2 and distance < DOUBTS.open * length:
        yield (
            chain[0],
            f"an open polyline on layer '{layer}' with its ends {distance:.3g} {unit} apart is no"
            " block: close it if it is one",
        )


def free_ends(
    free: Array, edges: Array, blocks: list[Array], near: float, unit: str
) -> Iterator[Doubt]:
    """Ends of lines that stop short of another line, or within a block.

    Args:
        free: Edges that end in the air, that end first, shape (ends, 2, 2).
        edges: All edges, shape (edges, 2, 2).
        blocks: Outlines of blocks.
        near: Distance within which points are the same.
        unit: Of all coordinates.
    """
    ends = free[:, 0]
    reach = 4.0 * DRAWING_LIMITS.gap * default_size(blocks)
    pairs = points_near_segments(ends, edges, reach)
    length = np.linalg.norm(free[:, 1] - ends, axis=1)[pairs.point]
    short = (pairs.distance > near) & (pairs.distance < 0.5 * length)
    order = np.argsort(pairs.distance[short])
    point = pairs.point[short][order]
    _, first = np.unique(point, return_index=True)
    for row in first.tolist():
        distance = pairs.distance[short][order][row]
        text = f"a line ends {distance:.3g} {unit} short of another: extend it, or blocks are one"
        yield ends[point[row]], text
    others = np.delete(ends, np.unique(point), axis=0)
    for end in others[inside_outlines(others, blocks) >= 0]:
        yield end, "a line ends within a block, which it does not divide: extend it"


def small_blocks(blocks: Sequence[Array], names: Sequence[str], unit: str) -> Iterator[Doubt]:
    """Blocks that are much smaller than most."""
    areas = np.array([_area(block) for block in blocks])
    median = float(np.median(areas))
    for k in np.flatnonzero(areas < DOUBTS.small * median).tolist():
        yield (
            inner_point(blocks[k]),
            f"a block of {areas[k]:.2g} {unit}2 on layer '{names[k]}', the median has"
            f" {median:.2g}: a sliver between lines that do not meet?",
        )


def large_blocks(blocks: Sequence[Array], names: Sequence[str]) -> Iterator[str]:
    """Warnings on layers of blocks so large that they may be openings."""
    areas = np.array([_area(block) for block in blocks])
    median = float(np.median(areas))
    for name, count in Counter(names).items():
        large = areas[np.array(names) == name].mean() / median
        if large > DOUBTS.large and count < 0.5 * len(names):
            yield (
                f"warning: the {count} blocks on layer '{name}' are {large:.1f} times as large as"
                f" the median; if they are openings, give --voids {name}"
            )


def openings_over_blocks(
    blocks: Sequence[Array], voids: Sequence[Array], depth: float
) -> Iterator[Doubt]:
    """Openings that lie over closed blocks by more than a depth: blocks are not cut."""
    if not voids:
        return
    pairs, places = overlaps([*blocks, *voids], depth)
    for (first, second), place in zip(pairs, places, strict=True):
        if min(first, second) < len(blocks) <= max(first, second):
            yield (
                place,
                "an opening lies over a block, which is not cut: draw the block around it, or give"
                " --lines for the lines around blocks",
            )


def inner_point(outline: Array) -> Array:
    """A point within an outline."""
    from shapely.geometry import Polygon

    point = Polygon(outline).representative_point()
    return np.array([point.x, point.y])


def _area(outline: Array) -> float:
    x, y = (outline - outline[0]).T
    return 0.5 * abs(float(x[:-1] @ y[1:] - y[:-1] @ x[1:]))
