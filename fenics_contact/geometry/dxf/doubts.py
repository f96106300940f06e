"""What looks wrong in a drawing: places with what is there, in words for a user."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.geometry.dxf.faces import Faces
from fenics_contact.geometry.dxf.reader import UNITS
from fenics_contact.geometry.meshing import outline_area
from fenics_contact.geometry.outlines import inside_outlines, overlaps
from fenics_contact.geometry.planar_cells import Array
from fenics_contact.geometry.point_pairs import points_near_segments


@dataclass(frozen=True)
class DrawingDoubts:
    """From where on something is suspicious.

    Attributes:
        small: Area of a block over the median one below which it might be a mistake.
        large: Mean area of the blocks of a layer over the median one above which they might be
            openings.
        short: Distance from an end to a line, over the root of the median face's area, below which
            the end misses the line.
        alone: Part of the area within a closed curve that no face between lines covers, from which
            it is a block of its own.
        least: Width of the median block, m, below which its unit is doubtful.
        most: The same above which it is.
        usual: Widths of the median block, m, from which on and up to which a unit is proposed.
    """

    small: float = 1e-3
    large: float = 4.0
    short: float = 0.06
    alone: float = 0.9
    least: float = 0.02
    most: float = 3.0
    usual: tuple[float, float] = (0.08, 2.0)


DOUBTS = DrawingDoubts()

#: A suspicious place, in the unit of the drawing, and what is there.
Doubt = tuple[Array, str]


def open_polyline(chain: Array, layer: str) -> Doubt:
    """An open polyline on a layer of blocks."""
    return chain[0], f"an open polyline on layer '{layer}' is no block: close it if it is one"


def missed_ends(faces: Faces, near: float, stub: float = 0.0) -> tuple[Array, Array]:
    """Ends in the air, shape (ends, 2), and the distance of each to a line it stops short of.

    Args:
        faces: Faces between lines, with the edges that end in the air.
        near: Distance within which points are the same.
        stub: Length up to which a line that goes beyond another is no doubt.

    Returns:
        The ends, and the distances, infinite where no line is near, shape (ends,).
    """
    length = np.linalg.norm(faces.free[:, 1] - faces.free[:, 0], axis=1)
    ends = faces.free[length > stub, 0]
    pairs = points_near_segments(ends, faces.edges, _reach(faces))
    short = (pairs.distance > near) & (pairs.distance < 0.5 * length[length > stub][pairs.point])
    distance = np.full(len(ends), np.inf)
    np.minimum.at(distance, pairs.point[short], pairs.distance[short])
    return ends, distance


def _reach(faces: Faces) -> float:
    """Distance from an end to a line below which it misses the line."""
    areas = [abs(outline_area(outline)) for outline in faces.outlines]
    lengths = np.linalg.norm(faces.free[:, 1] - faces.free[:, 0], axis=1)
    return DOUBTS.short * float(np.sqrt(np.median(areas or np.max(lengths, initial=0.0) ** 2)))


def bounds_faces(ring: Array, faces: Faces, near: float) -> bool:
    """Whether a closed curve bounds blocks that the faces between lines alone lack.

    Lines end on it that would end in the air, or it goes around next to no face.
    """
    from shapely.geometry import Polygon
    from shapely.ops import unary_union

    ends, missed = missed_ends(faces, near)
    sides = np.stack([ring[:-1], ring[1:]], axis=1)
    if len(points_near_segments(ends[np.isinf(missed)], sides, _reach(faces)).point):
        return True
    whole = Polygon(ring).buffer(0.0)
    rest = whole.difference(unary_union([Polygon(outline) for outline in faces.outlines]))
    return bool(rest.area > DOUBTS.alone * whole.area)


def free_ends(faces: Faces, blocks: list[Array], near: float, stub: float) -> Iterator[Doubt]:
    """Ends of lines that stop short of another line, or within a block; see `missed_ends`."""
    ends, distance = missed_ends(faces, near, stub)
    for end in ends[np.isfinite(distance)]:
        yield end, "a line ends short of another: extend it, or blocks are one"
    others = ends[np.isinf(distance)]
    for end in others[inside_outlines(others, blocks) >= 0]:
        yield end, "a line ends within a block, which it does not divide: extend it"


def unit(blocks: Sequence[Array], unit: str, given: bool) -> Iterator[str]:
    """A warning where blocks are no stones in the unit, or the file says inch, as if not set."""
    width = float(np.sqrt(np.median([abs(outline_area(block)) for block in blocks])))
    size = width * UNITS[unit]
    if DOUBTS.least <= size <= DOUBTS.most and (given or unit != "in"):
        return
    likely = [
        f"--unit {name} makes it {width * metres:.3g} m"
        for name, metres in UNITS.items()
        if name != unit and DOUBTS.usual[0] <= width * metres <= DOUBTS.usual[1]
    ]
    yield (
        f"warning: is the unit {unit}? The median block is {size:.3g} m wide (the root of its"
        f" area); {', '.join(likely) or 'if not, give --unit'}"
    )


def small_blocks(blocks: Sequence[Array], names: Sequence[str]) -> Iterator[Doubt]:
    """Blocks that are much smaller than most."""
    areas = np.array([abs(outline_area(block)) for block in blocks])
    for k in np.flatnonzero(areas < DOUBTS.small * np.median(areas)).tolist():
        yield (
            inner_point(blocks[k]),
            f"a block on layer '{names[k]}' has less than a thousandth of the median area: a sliver"
            " between lines that do not meet?",
        )


def large_blocks(blocks: Sequence[Array], names: Sequence[str]) -> Iterator[str]:
    """Warnings on layers of blocks so large that they may be openings."""
    areas = np.array([abs(outline_area(block)) for block in blocks])
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
