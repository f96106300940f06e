"""How a structure fails, in the report: in words, and as blocks that a slider moves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from fenics_contact.output.report.content import Content, Record
from fenics_contact.output.report.html import (
    PICTURES,
    direction_words,
    heading,
    numbers,
    paragraph,
    picture,
    text,
)
from fenics_contact.results.bounds import counted
from fenics_contact.scene.units import Units

#: Width or height of the drawing, whichever is larger, in units of SVG.
SIZE = 1000.0
#: Free around the structure: the blocks move by 8 % of its size, by 1.5 times that at the
#: slider's end.
MARGIN = 0.125
#: Height of a number over the side of a square with the area of its block, and at most.
NUMBER, TALLEST = 0.38, 26.0
#: Width of lines over the side of a block of mean area; 1 at most.
LINE = 0.015
#: Colours of blocks that move and that do not, as attributes: WeasyPrint has no styles in SVG.
MOVES, STAYS = "#c3d5e3", "#f2f4f5"
REST = 'fill="none" stroke="#bbb"'
NUMBERS = 'text-anchor="middle" stroke="none" fill="#222" font-family="sans-serif"'


def how_it_fails(content: Content) -> Iterator[str]:
    """How the blocks move: in words, and drawn with their numbers."""
    record = content.record
    yield heading("How it fails")
    total = record["mesh"]["bodies"]
    if record["falling_blocks"]:
        falling = record["falling_blocks"]
        words = f"{len(falling)} of {counted(total, 'block')} move: {numbers(falling)}."
        yield paragraph(words, f"The reason: {record['reason']}. No joint resists this motion.")
        if motion := content.motions.get("fall"):
            yield moving_figure(motion, falling)
    for place, (direction, end) in enumerate(record["ends"].items()):
        prefix = f"With the {direction_words(direction)}:"
        if end["wedged_blocks"]:
            wedged = end["wedged_blocks"]
            words = f"{len(wedged)} of {counted(total, 'block')} wedge: {numbers(wedged)}."
            yield paragraph(prefix, words)
        elif end["mechanism"]:
            doubt = "This motion is not verified." if end["status"] != "limit" else ""
            yield paragraph(prefix, *_motion(end["mechanism"], total, content.units), doubt)
            if motion := content.motions.get(direction):
                yield moving_figure(motion, end["mechanism"]["moving"])
        else:
            yield paragraph(prefix, "no collapse mode is known.")
        if place and (address := content.picture_of("collapse", direction)):
            yield picture(address, PICTURES["collapse_negative"])


def _motion(moves: Record, total: int, units: Units) -> Iterator[str]:
    """Sentences on a collapse mode."""
    moving = moves["moving"]
    turning = moves["turning"]
    way = ", ".join(f"{part:+.2f}" for part in moves["direction"])
    yield f"{len(moving)} of {counted(total, 'block')} move."
    if len(turning) == len(moving):
        yield "All of these turn."
    elif turning:
        yield f"{len(turning)} of these turn; the others shift without turning."
    else:
        yield "None of these turns."
    staying = sorted(set(range(total)) - set(moving))
    if len(moving) <= len(staying):
        yield f"The moving blocks are: {numbers(moving)}."
    elif staying:
        yield f"The blocks that stay are: {numbers(staying)}."
    centre = units.place(moves["centre"])
    yield f"The fastest is block {moves['fastest']} with its centre at {centre}."
    if any(moves["direction"]):
        yield f"Its centre moves in the direction ({way})."
    else:
        yield "It turns about its centre."
    joints = [
        f"{moves[key]} {words}"
        for key, words in (
            ("parting", "open over their whole length"),
            ("rocking", "open over a part of it (the blocks rock there)"),
            ("sliding", "slide while closed"),
        )
        if moves[key]
    ]
    *first, last = joints or ["none opens or slides"]
    what = f"{', '.join(first)} and {last}" if first else last
    yield f"Of {counted(moves['joints'], 'joint')} {what}."


def moving_figure(motion: Mapping[str, Any], moving: Sequence[int]) -> str:
    """Blocks as SVG, at rest and displaced, with a slider that the page's script brings to life.

    A displaced block is turned and shifted by a matrix of SVG, as the script does. In the drawing
    y points down.

    Args:
        motion: One entry of motion.json.
        moving: Numbers of the blocks that are shaded.
    """
    outlines = motion["outlines"]
    corners = np.concatenate([loop for loops in outlines for loop in loops])
    left, low = corners.min(axis=0)
    right, top = corners.max(axis=0)
    scale = SIZE / max(right - left, top - low)
    margin = MARGIN * SIZE
    wide = scale * (right - left) + 2.0 * margin
    tall = scale * (top - low) + 2.0 * margin
    box = f"{-margin:.0f} {-margin:.0f} {wide:.0f} {tall:.0f}"

    def drawn(places: Any) -> Any:
        x, y = np.transpose(places)
        return scale * np.column_stack([x - left, top - y])

    paths: list[str] = []
    areas: list[float] = []
    for loops in outlines:
        path = ""
        area = 0.0  # of loops around holes, which run the other way round, below 0
        for points in map(drawn, loops):
            path += "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + "Z"
            area += 0.5 * float(np.cross(points, np.roll(points, -1, axis=0)).sum())
        paths.append(f'<path d="{path}"/>')
        areas.append(abs(area))
    blocks: list[str] = []
    for number, (path, area) in enumerate(zip(paths, areas, strict=True)):
        colour = MOVES if number in moving else STAYS
        ((x, y),) = drawn([motion["centres"][number]])
        across, up, turn = motion["motions"][number]
        moved = -turn, scale * across - turn * y, -scale * up + turn * x
        angle, shift_x, shift_y = (f"{part:.5g}" for part in moved)
        matrix = f"matrix(1 {angle} {turn:.5g} 1 {shift_x} {shift_y})"
        size = min(NUMBER * math.sqrt(area), TALLEST)
        middle = f'x="{x:.1f}" y="{y + 0.36 * size:.1f}" font-size="{size:.1f}"'
        blocks.append(
            f'<g fill="{colour}" data-motion="{angle} {shift_x} {shift_y}" transform="{matrix}">'
            f"{path}<text {middle} {NUMBERS}>{number}</text></g>"
        )
    side = math.sqrt(sum(areas) / len(areas))
    width = f'stroke-width="{min(1.0, LINE * side):.2f}"'
    words = "How the blocks move, with their numbers; grey outlines: at rest."
    slider = (
        '<p class="slider" hidden><label>motion <input type="range" min="0" max="1.5" step="0.01"'
        ' value="1"></label></p>'
    )
    return (
        f'<figure class="moving"><svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}"'
        f' role="img" aria-label="{text(words)}"><g {REST} {width}>{"".join(paths)}</g>'
        f'<g stroke="#555" {width}>{"".join(blocks)}</g></svg>{slider}'
        f"<figcaption>{text(words)}</figcaption></figure>\n"
    )
