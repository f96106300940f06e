"""What looks wrong in a drawing: places with what is there, in words for a user.

And what the slips of its lines cost: stones joined or lost and openings filled.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.geometry.dxf.faces import Faces
from fenics_contact.geometry.dxf.reader import UNITS
from fenics_contact.geometry.outlines import (
    inner_points,
    inside_outlines,
    outline_area,
    overlaps,
    points_near_segments,
)
from fenics_contact.geometry.planar_cells import Array

# From where on something is suspicious.
#: Area of a block over the median one below which it might be a mistake.
SMALL = 1e-3
#: Mean area of the blocks of a layer over the median one above which they might be openings.
LARGE = 4.0
#: Distance from an end to a line, over the root of the median face's area, below which the end
#: misses the line.
SHORT = 0.06
#: Part of the area within a closed curve that no face between lines covers, from which it is a
#: block of its own.
ALONE = 0.9
#: Widths of the median block, m, outside which its unit is doubtful, and for which one is proposed.
SIZES = 0.02, 3.0
USUAL = 0.08, 2.0

#: A suspicious place, in the unit of the drawing, and what is there.
Doubt = tuple[Array, str]


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
    return SHORT * float(np.sqrt(np.median(areas or np.max(lengths, initial=0.0) ** 2)))


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
    return bool(rest.area > ALONE * whole.area)


def free_ends(faces: Faces, blocks: list[Array], near: float, stub: float) -> Iterator[Doubt]:
    """Ends of lines that stop short of another line, or within a block; see `missed_ends`."""
    ends, distance = missed_ends(faces, near, stub)
    for end in ends[np.isfinite(distance)]:
        yield end, "a line ends short of another: extend it, or blocks are one"
    others = ends[np.isinf(distance)]
    for end in others[inside_outlines(others, blocks) >= 0]:
        yield end, "a line ends within a block, which it does not divide: extend it"


def doubtful_sizes(
    blocks: Sequence[Array], names: Sequence[str], unit: str, given: bool
) -> tuple[list[Doubt], list[str]]:
    """Blocks much smaller than most; warnings on layers of large ones, and on the unit.

    Args:
        blocks: Outlines.
        names: Their layers.
        unit: Of the drawing.
        given: Whether the user gave it; a file that says inch may not have set it.
    """
    areas = np.array([abs(outline_area(block)) for block in blocks])
    median = float(np.median(areas))
    small = [
        (
            inner_points([blocks[k]])[0],
            f"a block on layer '{names[k]}' has less than a thousandth of the median area: a sliver"
            " between lines that do not meet?",
        )
        for k in np.flatnonzero(areas < SMALL * median).tolist()
    ]
    notes = []
    for name, count in Counter(names).items():
        large = areas[np.array(names) == name].mean() / median
        if large > LARGE and count < 0.5 * len(names):
            notes.append(
                f"warning: the {count} blocks on layer '{name}' are {large:.1f} times as large as"
                f" the median; if they are openings, give --voids {name}"
            )
    width = float(np.sqrt(median))
    size = width * UNITS[unit]
    if not SIZES[0] <= size <= SIZES[1] or (unit == "in" and not given):
        likely = [
            f"--unit {name} makes it {width * metres:.3g} m"
            for name, metres in UNITS.items()
            if name != unit and USUAL[0] <= width * metres <= USUAL[1]
        ]
        notes.append(
            f"warning: is the unit {unit}? The median block is {size:.3g} m wide (the root of its"
            f" area); {', '.join(likely) or 'if not, give --unit'}"
        )
    return small, notes


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


# ---- what slips cost


@dataclass(frozen=True)
class Slips:
    """What a drawing loses because ends of lines miss each other.

    Attributes:
        text: All of it in a line; empty if nothing is lost.
        snap: What mends it, in the drawing's unit; 0 for nothing.
    """

    text: str = ""
    snap: float = 0.0


def slips_between(
    blocks: Sequence[Array], mended: tuple[Sequence[Array], Sequence[Array]], snap: float
) -> Slips:
    """What blocks as drawn lack of the blocks and openings of the drawing mended by `snap`."""
    stones, openings = (inside_outlines(inner_points(some), blocks) for some in mended)
    count = np.bincount(np.concatenate([stones, openings]) + 1, minlength=len(blocks) + 1)
    parts = [
        f"{number} {what}"
        for number, what in (
            (
                np.sum((stones >= 0) & (count[stones + 1] > 1)),
                "stones are joined to their neighbours",
            ),
            (np.sum(stones < 0), "stones are lost"),
            (np.sum(openings >= 0), "openings filled"),
        )
        if number
    ]
    return Slips(f"{', '.join(parts)}: --snap {snap:g} mends them", snap)


def values_to_try(missed: Array) -> list[float]:
    """Lengths of one digit that are as large as those missed, each once, from the smallest on."""
    missed = missed[np.isfinite(missed)]
    step = 10.0 ** np.floor(np.log10(missed))
    return sorted({float(f"{value:.1g}") for value in np.ceil(missed / step - 1e-9) * step})
