"""How a structure fails, in the report: in words, and as blocks that a slider moves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from fenics_contact.output.report.content import Content, Record
from fenics_contact.output.report.html import heading, numbers, paragraph, picture, text
from fenics_contact.output.report.words import PICTURES, direction_words
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

#: Moves all blocks of the page by its sliders; without it the page shows them displaced.
SCRIPT = """
document.querySelectorAll("figure.moving").forEach(function (figure) {
  var slider = figure.querySelector("input");
  var blocks = figure.querySelectorAll("[data-motion]");
  function move() {
    var s = Number(slider.value);
    blocks.forEach(function (block) {
      var m = block.getAttribute("data-motion").split(" ").map(Number);
      block.setAttribute("transform", "matrix(1 " + s * m[0] + " " + -s * m[0] + " 1 " +
        s * m[1] + " " + s * m[2] + ")");
    });
  }
  figure.querySelector(".slider").hidden = false;
  slider.addEventListener("input", move);
  move();
});
"""


def how_it_fails(content: Content) -> Iterator[str]:
    """How the blocks move: in words, and drawn with their numbers."""
    record = content.record
    yield heading("How it fails")
    total = record["mesh"]["bodies"]
    if record["falling_blocks"]:
        falling = record["falling_blocks"]
        words = f"{len(falling)} of {counted(total, 'block')} move: {numbers(falling)}."
        yield paragraph(words, f"The reason: {record['reason']}. No joint resists this motion.")
        yield from _moving(content, "fall", falling)
    for place, (direction, end) in enumerate(record["ends"].items()):
        prefix = f"With the {direction_words(direction)}:"
        if end["wedged_blocks"]:
            wedged = end["wedged_blocks"]
            words = f"{len(wedged)} of {counted(total, 'block')} wedge: {numbers(wedged)}."
            yield paragraph(prefix, words)
        elif end["mechanism"]:
            doubt = "This motion is not verified." if end["status"] != "limit" else ""
            yield paragraph(prefix, *_motion(end["mechanism"], total, content.units), doubt)
            yield from _moving(content, direction, end["mechanism"]["moving"])
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
    yield f"Of {counted(moves['joints'], 'joint')} {_joints(moves)}."


def _joints(moves: Record) -> str:
    """How many joints do what, as far as any does."""
    parts = [
        f"{moves[key]} {words}"
        for key, words in (
            ("parting", "open over their whole length"),
            ("rocking", "open over a part of it (the blocks rock there)"),
            ("sliding", "slide while closed"),
        )
        if moves[key]
    ]
    if not parts:
        return "none opens or slides"
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last


def _moving(content: Content, direction: str, moving: Sequence[int]) -> Iterator[str]:
    """The blocks with their numbers, displaced, and the slider that moves them."""
    motion = content.motions.get(direction)
    if motion:
        yield moving_figure(motion, moving)


def moving_figure(motion: Mapping[str, Any], moving: Sequence[int]) -> str:
    """Blocks as SVG, at rest and displaced, with a slider that the page's script brings to life.

    `motion` is one entry of motion.json; `moving` are the blocks that are shaded.
    """
    outlines = motion["outlines"]
    frame = _Frame.of(outlines)
    side = frame.scale * math.sqrt(sum(map(_area, outlines)) / len(outlines))
    width = f'stroke-width="{min(1.0, LINE * side):.2f}"'
    marked = set(moving)
    rest = "".join(f'<path d="{frame.path(loops)}"/>' for loops in outlines)
    blocks = []
    for number, loops in enumerate(outlines):
        colour = MOVES if number in marked else STAYS
        moved = frame.motion(motion["centres"][number], motion["motions"][number])
        label = _label(
            number, frame.point(motion["centres"][number]), frame.scale**2 * _area(loops)
        )
        blocks.append(
            f'<g fill="{colour}" data-motion="{" ".join(f"{part:.5g}" for part in moved)}"'
            f' transform="{_matrix(*moved)}"><path d="{frame.path(loops)}"/>{label}</g>'
        )
    words = "How the blocks move, with their numbers; grey outlines: at rest."
    slider = (
        '<p class="slider" hidden><label>motion <input type="range" min="0" max="1.5" step="0.01"'
        ' value="1"></label></p>'
    )
    return (
        f'<figure class="moving"><svg xmlns="http://www.w3.org/2000/svg" viewBox="{frame.box}"'
        f' role="img" aria-label="{text(words)}"><g {REST} {width}>{rest}</g>'
        f'<g stroke="#555" {width}>{"".join(blocks)}</g></svg>{slider}'
        f"<figcaption>{text(words)}</figcaption></figure>\n"
    )


def _label(number: int, place: tuple[float, float], area: float) -> str:
    """The number of a block in its middle; place and area are those of the drawing."""
    size = min(NUMBER * math.sqrt(area), TALLEST)
    middle = f'x="{place[0]:.1f}" y="{place[1] + 0.36 * size:.1f}" font-size="{size:.1f}"'
    return f"<text {middle} {NUMBERS}>{number}</text>"


def _matrix(turn: float, shift_x: float, shift_y: float) -> str:
    """A small rigid motion as SVG has it; the page's script does the same."""
    return f"matrix(1 {turn:.5g} {-turn:.5g} 1 {shift_x:.5g} {shift_y:.5g})"


def script() -> str:
    """The script of the page."""
    return f"<script>{SCRIPT}</script>"


class _Frame:
    """From coordinates of the mesh to those of the drawing, in which y points down.

    Attributes:
        scale: Units of the drawing to a metre.
        box: The part that is shown, as SVG has it.
    """

    def __init__(self, low: Sequence[float], high: Sequence[float]) -> None:
        """Fit the structure between two corners into the drawing."""
        self._left = low[0]
        self._top = high[1]
        size = [end - start for start, end in zip(low, high, strict=True)]
        self.scale = SIZE / max(size)
        margin = MARGIN * SIZE
        wide, tall = (self.scale * part + 2.0 * margin for part in size)
        self.box = f"{-margin:.0f} {-margin:.0f} {wide:.0f} {tall:.0f}"

    @classmethod
    def of(cls, outlines: Sequence[Any]) -> _Frame:
        """Around all outlines."""
        points = [point for loops in outlines for loop in loops for point in loop]
        x, y = zip(*points, strict=True)
        return cls((min(x), min(y)), (max(x), max(y)))

    def point(self, place: Sequence[float]) -> tuple[float, float]:
        """A place in the drawing."""
        return self.scale * (place[0] - self._left), self.scale * (self._top - place[1])

    def motion(self, centre: Sequence[float], given: Sequence[float]) -> tuple[float, float, float]:
        """A motion (u_x, u_y, angle) about a centre: angle, and displacement of the origin."""
        x, y = self.point(centre)
        turn = -given[2]  # y points down
        return turn, self.scale * given[0] + turn * y, -self.scale * given[1] - turn * x

    def path(self, loops: Sequence[Any]) -> str:
        """Closed loops as a path of SVG."""
        parts = []
        for loop in loops:
            corners = (self.point(place) for place in loop)
            parts.append("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in corners) + "Z")
        return "".join(parts)


def _area(loops: Sequence[Any]) -> float:
    """Area inside closed loops; those around holes run the other way round."""
    total = 0.0
    for loop in loops:
        following = [*loop[1:], loop[0]]
        total += sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(loop, following, strict=True))
    return abs(0.5 * total)
