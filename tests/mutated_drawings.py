"""Walls drawn as people draw them, with mistakes, and the stones and openings that they show.

A wall has courses of stones, windows below flat lintels and a doorway below a ring of voussoirs.
It is drawn as lines and arcs, as closed polylines, with mortar, or as a mixture. What it shows is
found from the same curves without slips of the pen, with shapely. Lengths are in mm.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import ezdxf
import numpy as np
from shapely.affinity import translate
from shapely.geometry import LineString, Point, Polygon, box
from shapely.ops import polygonize, unary_union

from fenics_contact.errors import InputError
from fenics_contact.geometry.dxf.command import MeshOrder, mesh_drawing

Pair = tuple[float, float]
KINDS = ("lines", "polylines", "mortar", "mixed")


@dataclass
class Wall:
    """A wall as lines and stones.

    Attributes:
        lines: Straight lines by layer.
        arcs: Layer, centre, radius, first and last angle, degrees.
        openings: Their outlines; the doorway is open below.
        outline: Of the whole.
    """

    lines: list[tuple[str, Pair, Pair]] = field(default_factory=list)
    arcs: list[tuple[str, Pair, float, float, float]] = field(default_factory=list)
    openings: list[Polygon] = field(default_factory=list)
    outline: Polygon = field(default_factory=Polygon)

    def curves(self) -> list[LineString]:
        """Lines and chords of arcs without slips; arcs have the corners where lines end on them."""
        ends = [Point(end) for _, *line in self.lines for end in line]
        found = [LineString([start, end]) for _, start, end in self.lines]
        for _, (x, y), radius, first, last in self.arcs:
            angles = set(np.linspace(first, last, 61).tolist())
            for end in ends:
                if abs(math.hypot(end.x - x, end.y - y) - radius) < 1e-6:
                    angles.add(math.degrees(math.atan2(end.y - y, end.x - x)) % 360.0)
            inside = sorted(a for a in angles if first <= a <= last)
            places = [
                (x + radius * math.cos(math.radians(a)), y + radius * math.sin(math.radians(a)))
                for a in inside
            ]
            found.append(LineString(places))
        return found

    def stones(self) -> list[Polygon]:
        """Faces between the curves that are no openings."""
        rounded = [
            LineString([(round(x, 6), round(y, 6)) for x, y in curve.coords])
            for curve in self.curves()
        ]
        faces = polygonize(unary_union(rounded))
        return [
            face
            for face in faces
            if face.area > 1.0
            and not any(o.contains(face.representative_point()) for o in self.openings)
        ]


def wall(dice: random.Random) -> Wall:
    """A wall of random sizes."""
    made = Wall()
    width = 500.0 * dice.randint(7, 11)
    heights = [dice.choice((200.0, 250.0, 300.0, 350.0)) for _ in range(dice.randint(6, 9))]
    levels = [0.0, *np.cumsum(heights).tolist()]
    made.outline = box(0.0, 0.0, width, levels[-1])
    solid = made.outline
    arch = None
    if dice.random() < 0.7:
        inner = dice.choice((400.0, 500.0))
        arch = ((0.5 * width, levels[2]), inner, inner + 250.0)
        solid = solid.difference(_add_doorway(made, dice, *arch))
    window = dice.randint(3, len(levels) - 3)
    for x in (500.0, width - 1100.0):
        if dice.random() < 0.8 and (arch is None or abs(x + 300.0 - 0.5 * width) > 1200.0):
            solid = solid.difference(_add_window(made, x, levels[window], levels[window + 1]))
    for level in levels[1:-1]:
        across = LineString([(-10.0, level), (width + 10.0, level)])
        made.lines += [("BED", *piece) for piece in _within(across, solid, arch)]
    for low, high in pairwise(levels):
        x = dice.choice((250.0, 375.0, 500.0))
        while x < width - 200.0:
            upright = LineString([(x, low), (x, high)])
            made.lines += [("HEAD", *piece) for piece in _within(upright, solid, arch)]
            x += dice.choice((350.0, 500.0, 650.0))
    _add_outline(made, width, levels[-1], arch)
    return made


def _add_window(made: Wall, x: float, low: float, high: float) -> Polygon:
    """A window with a lintel of one stone; returns what both take from the wall."""
    made.openings.append(box(x, low, x + 600.0, high))
    corners = [(x, low), (x + 600.0, low), (x + 600.0, high), (x, high), (x, low)]
    made.lines += [("WINDOW", *pair) for pair in pairwise(corners)]
    lintel = [(x, high), (x - 150.0, high), (x - 150.0, high + 150.0), (x + 750.0, high + 150.0)]
    lintel += [(x + 750.0, high), (x + 600.0, high)]
    made.lines += [("LINTEL", *pair) for pair in pairwise(lintel)]
    return box(x, low, x + 600.0, high).union(box(x - 150.0, high, x + 750.0, high + 150.0))


def _add_doorway(
    made: Wall, dice: random.Random, centre: Pair, inner: float, outer: float
) -> Polygon:
    """A doorway with a half ring of voussoirs; returns what both take from the wall."""
    x, y = centre
    made.arcs += [("DOOR", centre, inner, 0.0, 180.0), ("RING", centre, outer, 0.0, 180.0)]
    for angle in np.radians(np.linspace(0.0, 180.0, dice.choice((6, 8, 10)))):
        ray = np.array([math.cos(angle), math.sin(angle)])
        start, end = (tuple((np.array(centre) + r * ray).tolist()) for r in (inner, outer))
        made.lines.append(("RING", start, end))
    for side in (-inner, inner):
        made.lines.append(("DOOR", (x + side, 0.0), (x + side, y)))
    upper = box(x - outer, y, x + outer, y + outer)
    disc = Point(centre).buffer(outer, 256).intersection(upper)
    hole = Point(centre).buffer(inner, 256).intersection(upper)
    made.openings.append(hole.union(box(x - inner, 0.0, x + inner, y)))
    return disc.union(box(x - inner, 0.0, x + inner, y))


def _within(
    line: LineString, solid: Polygon, arch: tuple[Pair, float, float] | None
) -> Iterator[tuple[Pair, Pair]]:
    """Parts of a level or upright line within the wall, that end on the ring as a circle."""
    common = line.intersection(solid)
    for part in getattr(common, "geoms", [common]):
        if part.geom_type == "LineString" and part.length > 60.0:
            first, last = (_on_ring(end, line, arch) for end in (part.coords[0], part.coords[-1]))
            yield first, last


def _on_ring(end: Pair, line: LineString, arch: tuple[Pair, float, float] | None) -> Pair:
    """An end, on the circle of the ring if it is near that."""
    x, y = (round(value, 6) for value in end)
    if arch is None:
        return x, y
    (middle, level), _, outer = arch
    if y < level or abs(math.hypot(x - middle, y - level) - outer) > 0.5:
        return x, y
    if line.coords[0][1] == line.coords[1][1]:
        half = math.sqrt(outer**2 - (y - level) ** 2)
        return middle + math.copysign(half, x - middle), y
    return x, level + math.sqrt(outer**2 - (x - middle) ** 2)


def _add_outline(
    made: Wall, width: float, height: float, arch: tuple[Pair, float, float] | None
) -> None:
    """The outline, open where the doorway is."""
    made.lines.append(("OUTLINE", (0.0, 0.0), (0.0, height)))
    made.lines.append(("OUTLINE", (width, 0.0), (width, height)))
    made.lines.append(("OUTLINE", (0.0, height), (width, height)))
    if arch is None:
        made.lines.append(("GROUND", (0.0, 0.0), (width, 0.0)))
    else:
        (middle, _), inner, _ = arch
        made.lines.append(("GROUND", (0.0, 0.0), (middle - inner, 0.0)))
        made.lines.append(("GROUND", (middle + inner, 0.0), (width, 0.0)))


# ---- how it is drawn


@dataclass(frozen=True)
class Drawn:
    """A drawing in a file, and what it shows.

    Attributes:
        path: The DXF file.
        stones: Its stones, mm.
        openings: Its openings, mm.
        shift: Where its origin lies in the file, mm.
    """

    path: Path
    stones: list[Polygon]
    openings: list[Polygon]
    shift: Pair = (0.0, 0.0)


class Pen:
    """Draws walls with mistakes.

    Attributes:
        dice: What decides on mistakes.
        often: Part of the ends of lines that are missed.
        slip: Least and largest length by which an end is missed, mm.
    """

    def __init__(
        self, dice: random.Random, often: float = 0.25, slip: tuple[float, float] = (1.0, 3.0)
    ) -> None:
        self.dice = dice
        self.often = often
        self.slip = slip
        self.document = ezdxf.new("R2010", units=4)
        self.space = self.document.modelspace()

    def miss(self) -> float:
        """How far a line goes beyond its end, mm."""
        if self.dice.random() >= self.often:
            return 0.0
        return self.dice.uniform(*self.slip) * self.dice.choice((-1.0, 1.0))

    def line(self, layer: str, start: Pair, end: Pair) -> None:
        """A line with slips along itself."""
        first, last = np.array(start), np.array(end)
        length = np.linalg.norm(last - first)
        if length > 1500.0 and self.dice.random() < self.often:  # in two pieces
            middle = first + self.dice.uniform(0.3, 0.7) * (last - first)
            self.line(layer, start, tuple(middle.tolist()))
            self.line(layer, tuple(middle.tolist()), end)
            return
        along = (last - first) / length
        ends = (first - self.miss() * along, last + self.miss() * along)
        self.space.add_line(*(tuple(e) for e in ends), dxfattribs={"layer": layer})

    def arc(self, layer: str, centre: Pair, radius: float, first: float, last: float) -> None:
        """An arc with slips along itself."""
        turns = [math.degrees(self.miss() / radius) for _ in range(2)]
        ends = (first - turns[0], last + turns[1])
        self.space.add_arc(centre, radius, *ends, dxfattribs={"layer": layer})

    def lines(self, drawn: Wall) -> None:
        """All curves of a wall."""
        for row in drawn.lines:
            self.line(*row)
        for arc in drawn.arcs:
            self.arc(*arc)

    def stone(self, stone: Polygon, layer: str = "STONE") -> None:
        """A polyline around a stone: closed, ending as begun, going on over its sides, or twice."""
        corners = list(stone.exterior.coords)[:-1]
        turn = self.dice.randrange(len(corners))
        corners = corners[turn:] + corners[:turn]
        if self.dice.random() < 0.5:
            corners.reverse()
        way = self.dice.random() / max(4.0 * self.often, 1e-9)
        style = {"layer": layer}
        if way < 0.1:
            self.space.add_lwpolyline(corners + corners[:1], dxfattribs=style)
        elif way < 0.2:
            self.space.add_lwpolyline(
                corners + corners[: self.dice.randint(2, 3)], dxfattribs=style
            )
        elif way < 0.25:  # not closed
            self.space.add_lwpolyline(corners, dxfattribs=style)
        elif way < 0.3:  # begins in the middle of a side, and goes on over that
            middle = tuple(np.mean(corners[:2], axis=0))
            self.space.add_lwpolyline([middle, *corners[1:], *corners[:2]], dxfattribs=style)
        else:
            self.space.add_lwpolyline(corners, close=True, dxfattribs=style)
        if way < 0.05:
            self.space.add_lwpolyline(corners[::-1], close=True, dxfattribs=style)


def mutated_drawing(seed: int, path: Path, kind: str | None = None) -> Drawn:
    """Draw a wall with mistakes, all of which come from the seed."""
    dice = random.Random(seed)
    kind = kind or KINDS[seed % len(KINDS)]
    made = wall(dice)
    if kind != "polylines" and kind != "mortar" and dice.random() < 0.5:
        heads = [k for k, (layer, *_) in enumerate(made.lines) if layer == "HEAD"]
        for k in sorted(dice.sample(heads, min(3, len(heads))), reverse=True):
            del made.lines[k]  # two stones are one
    pen = Pen(dice, dice.choice((0.0, 0.1, 0.25, 0.5)))
    stones = made.stones()
    if kind == "mixed" and dice.random() < 0.3 and not any(row[0] == "DOOR" for row in made.lines):
        made.lines = [row for row in made.lines if row[0] not in ("OUTLINE", "GROUND")]
        corners = list(made.outline.exterior.coords)[:-1]
        pen.space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "OUTLINE"})
    if kind in ("lines", "mixed"):
        pen.lines(made)
    if kind == "mixed":
        _add_closed(pen, made, stones)
    if kind == "polylines":
        for stone in stones:
            pen.stone(stone)
    if kind == "mortar":
        stones = [s for stone in stones if (s := _inner(stone)) is not None]
        for stone in stones:
            pen.stone(stone)
    if dice.random() < 0.3:
        sheet = made.outline.buffer(2000.0, join_style=2)
        corners = list(sheet.exterior.coords)[:-1]
        pen.space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "SHEET"})
    shift = dice.choice(((0.0, 0.0), (0.0, 0.0), (432_512_300.0, 5_081_774_900.0)))
    for entity in list(pen.space):
        entity.translate(*shift, 0.0)
    pen.document.saveas(path)
    return Drawn(path, stones, made.openings, shift)


def _inner(stone: Polygon) -> Polygon | None:
    """A stone with half of a joint of 10 mm taken from all sides."""
    found = stone.buffer(-5.0, join_style=2)
    return found if found.geom_type == "Polygon" and found.area > 0.5 * stone.area else None


def _add_closed(pen: Pen, made: Wall, stones: list[Polygon]) -> None:
    """Closed polylines among lines: around a band of courses, around all, or around stones."""
    way = pen.dice.randrange(3)
    levels = sorted({start[1] for layer, start, _ in made.lines if layer == "BED"})
    low, high = sorted(pen.dice.sample(levels, 2))
    width = made.outline.bounds[2]
    if way == 0:
        band = box(0.0, low, width, high)
        pen.space.add_lwpolyline(
            list(band.exterior.coords)[:-1], close=True, dxfattribs={"layer": "STOREY"}
        )
    elif way == 1:
        pen.space.add_lwpolyline(
            list(made.outline.exterior.coords)[:-1], close=True, dxfattribs={"layer": "WALL"}
        )
    else:
        for stone in pen.dice.sample(stones, min(3, len(stones))):
            pen.stone(stone, "QUOIN")


# ---- what became of it


#: What tells of a stone or an opening that is not as drawn.
WORDS = ("--snap", "open polyline", "a line ends")


@dataclass(frozen=True)
class Read:
    """A drawing as it was read.

    Attributes:
        stones: Number of its stones that are a block.
        openings: Number of its openings that are none.
        blocks: Number of blocks.
        told: Whether something is said of stones or openings that are not as drawn.
        said: All that was said.
    """

    stones: int
    openings: int
    blocks: int
    told: bool
    said: str


def read_again(drawn: Drawn, snap: float = 0.0) -> Read:
    """A drawing as the command `mesh` reads it, against what it shows."""
    order = MeshOrder(drawn.path, drawn.path.with_suffix(".msh"), snap=snap)
    try:
        made = mesh_drawing(order)
    except InputError as error:
        return Read(0, 0, 0, True, str(error))
    origin = made.read.origin
    blocks = [Polygon(1e3 * (block + origin)) for block in made.read.drawing.blocks]
    moved = [translate(block, -drawn.shift[0], -drawn.shift[1]) for block in blocks]
    kept = 0
    for stone in drawn.stones:
        at = stone.representative_point()
        areas = [block.area for block in moved if block.contains(at)]
        kept += len(areas) == 1 and 0.75 < areas[0] / stone.area < 1.25
    empty = sum(
        not any(block.contains(opening.centroid) for block in moved) for opening in drawn.openings
    )
    said = "\n".join(made.lines)
    return Read(kept, empty, len(blocks), any(word in said for word in WORDS), said)
