"""Drawings of walls for the benchmarks: ashlar with openings under lintels, and random walls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fenics_contact import Load, Material, Tie
from fenics_contact.builders import bridge, facade
from fenics_contact.drawing import Drawing
from tests.bank import GRAVITY, LEFTWARDS, PUSH, Recipe, coulomb, drawn_recipe, rectangle
from tests.structures import rubble

Random = np.random.Generator
Pair = tuple[float, float]

STONE = Material(3e9, 0.2, 2000.0)


@dataclass(frozen=True)
class Opening:
    """Of a wall in courses, under a lintel.

    Attributes:
        left: Its left end, m.
        right: Its right end, m.
        courses: The first one that it interrupts, and the first one above it.
    """

    left: float
    right: float
    courses: tuple[int, int]


@dataclass(frozen=True)
class Ashlar:
    """A wall of stones in courses.

    Attributes:
        width: Of the wall, m.
        heights: Of the courses from the ground up, m.
        lengths: Of the stones, from and to, m.
        openings: Apart from each other and from the ends by more than `bearing`.
        bearing: Of lintels on either side, m.
    """

    width: float
    heights: Sequence[float]
    lengths: Pair
    openings: Sequence[Opening] = ()
    bearing: float = 0.3

    def drawing(self, random: Random) -> Drawing:
        """The wall, its head joints at random places, but not above each other; "base"."""
        levels = np.concatenate([[0.0], np.cumsum(self.heights)])
        blocks: list[npt.NDArray[np.float64]] = []
        below: list[float] = []
        for course in range(len(self.heights)):
            joints: list[float] = []
            for left, right in self._solid(course, joints):
                ends = self._cuts(random, (left, right), below)
                joints += ends
                for start, end in pairwise(ends):
                    corners = rectangle(start, levels[course], end, levels[course + 1])
                    blocks.append(np.array(corners))
            blocks += [
                np.array(rectangle(left, levels[course], right, levels[course + 1]))
                for left, right in self._lintels(course)
            ]
            below = joints
        base = [((0.0, 0.0), (self.width, 0.0))]
        return Drawing(blocks, ["stones"] * len(blocks), {"base": base})

    def _lintels(self, course: int) -> list[Pair]:
        over = [one for one in self.openings if one.courses[1] == course]
        return [(one.left - self.bearing, one.right + self.bearing) for one in over]

    def _solid(self, course: int, joints: list[float]) -> list[Pair]:
        """Stretches of a course that stones fill; ends of lintels are joints."""
        lintels = self._lintels(course)
        joints += [end for lintel in lintels for end in lintel]
        void = [
            (one.left, one.right)
            for one in self.openings
            if one.courses[0] <= course < one.courses[1]
        ]
        taken = sorted(lintels + void)
        ends = [0.0, *(end for stretch in taken for end in stretch), self.width]
        return [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if b > a]

    def _cuts(self, random: Random, stretch: Pair, below: Sequence[float]) -> list[float]:
        """Both ends of a stretch, and joints between them."""
        least, most = self.lengths
        ends = [stretch[0]]
        while stretch[1] - ends[-1] > most:
            tried = ends[-1] + random.uniform(least, most, 5)
            clear = [min((abs(x - other) for other in below), default=1.0) for x in tried]
            ends.append(float(tried[int(np.argmax(clear))]))
        if len(ends) > 1 and stretch[1] - ends[-1] < 0.5 * least:
            ends.pop()
        return [*ends, stretch[1]]


def ashlar(seed: int, stones: int) -> Drawing:
    """A plain wall of about so many stones of all sizes, twice as wide as it is high."""
    random = np.random.default_rng(seed)
    courses = max(2, round(np.sqrt(0.85 * stones)))
    heights = random.uniform(0.2, 0.35, courses)
    width = 0.5 * stones / courses
    return Ashlar(width, heights.tolist(), (0.35, 0.65)).drawing(random)


def palazzo() -> Drawing:
    """Three storeys of five windows."""
    return facade(3, 5, (1.1, 1.8), 1.2, (0.6, 0.3), 0.9)


def floor_ties(drawing: Drawing, strength: float) -> dict[str, Tie]:
    """Bars through the floors of a facade, from end to end; their yield, N/m."""
    floors = [b for b, name in zip(drawing.blocks, drawing.names, strict=True) if name == "floors"]
    width = max(float(block[:, 0].max()) for block in floors)
    levels = sorted({round(float(block[:, 1].mean()), 6) for block in floors})
    return {f"{y:g} m": Tie((0.3, y), strength, (width - 0.3, y)) for y in levels}


def three_spans() -> Drawing:
    """A bridge of three arches."""
    return bridge(6.0, 2.0, 0.5, 21, 3, pier=(1.8, 3.0), cover=0.5, parapet=0.6)


def tower() -> Drawing:
    """Fifty courses, four stones wide, with a narrow window every ten courses."""
    windows = [Opening(1.0, 1.4, (6 + 10 * k, 10 + 10 * k)) for k in range(4)]
    wall = Ashlar(2.4, [0.3] * 50, (0.45, 0.75), windows)
    return wall.drawing(np.random.default_rng(50))


# ---- random walls


def random_recipe(seed: int) -> Recipe:
    """A wall of 100 to 500 blocks: its kind, sizes, law, loads and ties are random."""
    random = np.random.default_rng([seed, 38])
    blocks = float(np.exp(random.uniform(np.log(120.0), np.log(470.0))))
    kind = str(random.choice(list(KINDS)))
    drawing = KINDS[kind](random, blocks)
    friction = float(random.uniform(0.35, 0.9))
    law = coulomb(max(friction, 0.55) if kind == "rubble" else friction)
    if random.random() < 0.2:
        law = replace(law, cohesion=float(random.uniform(5e3, 3e4)))
    stone = STONE
    if random.random() < 0.35:
        stone = replace(stone, compressive_strength=float(random.uniform(1e6, 5e6)))
    live = PUSH if random.random() < 0.5 else LEFTWARDS
    parts = {"materials": {"default": stone}, "live": live, "dead": Load((0.0, -GRAVITY))}
    if random.random() < 0.25:
        parts["ties"] = _ties(random, drawing)
    return drawn_recipe(lambda: drawing, law, **parts)


def _ties(random: Random, drawing: Drawing) -> dict[str, Tie]:
    """Bars from the first to the last block of a course or two."""
    middles = np.array([np.mean(block, axis=0) for block in drawing.blocks])
    top = float(middles[:, 1].max())
    found = {}
    for name, part in (("upper", 0.85), ("lower", 0.5))[: int(random.integers(1, 3))]:
        level = middles[np.argmin(np.abs(middles[:, 1] - part * top)), 1]
        row = middles[np.abs(middles[:, 1] - level) < 1e-6 * top]
        first, last = row[np.argmin(row[:, 0])], row[np.argmax(row[:, 0])]
        if last[0] - first[0] > 0.5:
            ends = (float(first[0]), float(first[1])), (float(last[0]), float(last[1]))
            found[name] = Tie(ends[0], float(random.uniform(1e4, 8e4)), ends[1])
    return found


def _shape(random: Random, blocks: float, block: Pair) -> tuple[int, float]:
    """Courses and width of a wall that is .6 to 2.5 times as wide as high."""
    ratio = random.uniform(0.6, 2.5)
    courses = max(5, round(np.sqrt(blocks * block[0] / (ratio * block[1]))))
    return courses, blocks * block[0] / courses


def _random_ashlar(random: Random, blocks: float) -> Drawing:
    courses, width = _shape(random, blocks, (0.5, 0.27))
    heights = random.uniform(0.2, 0.34, courses).tolist()
    return Ashlar(width, heights, (0.35, 0.65)).drawing(random)


def _random_bond(random: Random, blocks: float) -> Drawing:
    block = (0.4, float(random.uniform(0.1, 0.3)))
    courses, width = _shape(random, blocks, block)
    bricks = max(3, round(width / block[0]))
    overlap = float(random.uniform(0.25, 0.75))
    found = []
    for level in range(courses):
        inner = np.arange(1, bricks) + (overlap - 0.5) * (level % 2)
        ends = np.concatenate([[0.0], inner, [bricks]]) * block[0]
        low, high = level * block[1], (level + 1) * block[1]
        for a, b in pairwise(ends):
            found.append(np.array(rectangle(a, low, b, high)))
    base = [((0.0, 0.0), (bricks * block[0], 0.0))]
    return Drawing(found, ["stones"] * len(found), {"base": base})


def _random_openings(random: Random, blocks: float) -> Drawing:
    courses, width = _shape(random, 1.2 * blocks, (0.5, 0.27))
    courses = max(courses, 8)
    count = max(1, int(width / random.uniform(2.6, 4.0)))
    step = width / count
    rows = [(int(0.25 * courses), int(0.25 * courses) + max(2, courses // 5))]
    if courses > 14:
        rows.append((int(0.65 * courses), int(0.65 * courses) + max(2, courses // 6)))
    openings = []
    for k in range(count):
        clear = min(float(random.uniform(0.7, 1.4)), 0.5 * step)
        middle = (k + 0.5) * step
        openings += [Opening(middle - 0.5 * clear, middle + 0.5 * clear, row) for row in rows]
    heights = random.uniform(0.22, 0.32, courses).tolist()
    return Ashlar(width, heights, (0.35, 0.65), openings, 0.25).drawing(random)


def _random_rubble(random: Random, blocks: float) -> Drawing:
    courses = max(6, round(np.sqrt(blocks / random.uniform(0.6, 2.0))))
    return rubble(max(4, round(blocks / courses)), courses, int(random.integers(1_000_000)))


def _random_facade(random: Random, blocks: float) -> Drawing:
    storeys = int(random.integers(1, 4))
    sizes = (1.0, float(random.uniform(1.0, 1.8))), float(random.uniform(0.8, 1.4))
    block = (0.5, float(random.uniform(0.22, 0.3)))
    made = facade(storeys, 1, *sizes, block, float(random.choice([0.0, 0.8])))
    for bays in range(2, 12):
        more = facade(storeys, bays, *sizes, block, 0.8)
        if len(more.blocks) > blocks:
            break
        made = more
    return made


KINDS: dict[str, Callable[[Random, float], Drawing]] = {
    "ashlar": _random_ashlar,
    "bond": _random_bond,
    "openings": _random_openings,
    "rubble": _random_rubble,
    "facade": _random_facade,
}
