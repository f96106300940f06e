"""Random scenes of many kinds, each made from four numbers.

    Draw("rubble", blocks=12, elements=1, seed=7).recipe().scene(1)

A `Draw` says how large a scene is; its seed decides everything else. The same draw always makes the
same scene, here, in the tests with hypothesis and in `benchmarks/random_scenes.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact import JointLaw, Load, Material
from fenics_contact.meshing import polygons
from tests.bank import GRAVITY, Recipe, coulomb, tresca
from tests.drawing import rectangle, turned

Array = npt.NDArray[np.float64]
Random = np.random.Generator
Segment = Any  # ((x0, y0), (x1, y1)), arrays or tuples

YOUNG, DENSITY = 1e9, 2000.0  # Pa, kg/m3

#: Lines are one if direction and offset agree to this, m; drawings are about 1 m to 10 m large.
COLLINEAR = 1e-7


@dataclass(frozen=True)
class Outline:
    """Blocks without materials, laws and loads.

    Attributes:
        blocks: Corners of every block, anticlockwise, m, each of shape (corners, 2).
        groups: Sides by name: "base" stands on the ground, the others may be loaded or held.
        slope: Angle of the ground, degrees.
    """

    blocks: Sequence[Array]
    groups: dict[str, list[Segment]]
    slope: float = 0.0

    @classmethod
    def of(cls, blocks: Sequence[npt.ArrayLike], slope: float = 0.0) -> Outline:
        """Blocks with the groups that a wall has: "base", "top", "left" and "right"."""
        corners = [np.asarray(block, dtype=float) for block in blocks]
        (x0, y0), (x1, y1) = (f(np.concatenate(corners), axis=0) for f in (np.min, np.max))
        box = rectangle(x0, y0, x1, y1)
        sides = zip(("base", "right", "top", "left"), box, [*box[1:], box[0]], strict=True)
        return cls(corners, {n: [(a, b)] for n, a, b in sides if on(corners, (a, b))}, slope)


def on(blocks: Sequence[Array], line: Segment) -> bool:
    """Whether some side of a block lies on a segment."""
    first, last = np.asarray(line, dtype=float)

    def near(points: Array) -> npt.NDArray[np.bool_]:
        way = np.linalg.norm(points - first, axis=1) + np.linalg.norm(points - last, axis=1)
        return way <= np.linalg.norm(last - first) * (1.0 + 1e-12)

    start, end, _ = sides_of(blocks)
    return bool(np.any(near(start) & near(end)))


def sides_of(blocks: Sequence[Array]) -> tuple[Array, Array, npt.NDArray[np.int64]]:
    """Starts and ends of all sides, shape (sides, 2), and their blocks."""
    ends = np.concatenate([np.roll(block, -1, axis=0) for block in blocks])
    return np.concatenate(blocks), ends, np.repeat(np.arange(len(blocks)), list(map(len, blocks)))


def shared_stretches(blocks: Sequence[Array]) -> list[Segment]:
    """Stretches that the sides of two blocks have in common."""
    start, end, block = sides_of(blocks)
    length = np.linalg.norm(end - start, axis=1)
    way = (end - start) / length[:, None]
    found: list[Segment] = []
    for one in range(len(block)):
        across = (start - start[one]) @ np.array([-way[one, 1], way[one, 0]])
        facing = (way @ way[one] < -1.0 + COLLINEAR) & (np.abs(across) < COLLINEAR)
        for other in np.flatnonzero(facing & (block > block[one])):
            along = [(point[other] - start[one]) @ way[one] for point in (end, start)]
            low, high = max(along[0], 0.0), min(along[1], length[one])
            if high - low > 1e-6:
                found.append((start[one] + low * way[one], start[one] + high * way[one]))
    return found


# Kinds of outlines; each takes random numbers and the number of blocks, which is approximate


def bond(random: Random, blocks: int) -> Outline:
    """A wall in courses with random overlap, out of which single blocks are left."""
    courses = int(np.clip(round(np.sqrt(blocks) * random.uniform(0.6, 1.6)), 1, blocks))
    bricks, height = max(1, round(blocks / courses)), random.uniform(0.3, 0.7)
    overlap, missing = random.uniform(0.2, 0.8), random.choice([0.0, 0.08, 0.2])
    found: list[list[tuple[float, float]]] = []
    below: list[tuple[float, float]] = []
    for level in range(courses):
        inside = np.arange(1, bricks) + (overlap - 0.5) * (level % 2)
        cuts = np.concatenate([[0.0], inside if bricks > 1 else [], [bricks]])
        stays = random.random(bricks) >= missing if level else np.ones(bricks, dtype=bool)
        row = [ends for ends, there in zip(pairwise(cuts), stays, strict=True) if there]
        # Nothing hangs in the air: what stays has something below.
        row = [(a, b) for a, b in row if not level or any(c < b and a < d for c, d in below)]
        below = row
        found += [rectangle(a, level * height, b, (level + 1) * height) for a, b in below]
    return Outline.of(found)


def stack(random: Random, blocks: int) -> Outline:
    """Blocks on top of each other, of random widths, shifted sideways."""
    blocks = min(blocks, 12)
    found, left, right, y = [], 0.0, random.uniform(0.6, 1.6), 0.0
    for _ in range(blocks):
        height = random.uniform(0.2, 0.8)
        found.append(rectangle(left, y, right, y + height))
        y += height
        width = (right - left) * random.uniform(0.75, 1.15)
        middle = 0.5 * (left + right) + random.uniform(-0.12, 0.12) * width
        left, right = middle - 0.5 * width, middle + 0.5 * width
    return Outline.of(found)


def incline(random: Random, blocks: int) -> Outline:
    """A wall or a stack on sloping ground."""
    kind = bond if random.random() < 0.5 else stack
    return replace(kind(random, blocks), slope=random.uniform(-30.0, 30.0))


def posts_and_beams(random: Random, blocks: int) -> Outline:
    """Storeys of posts with a lintel over every bay."""
    bays = int(random.integers(1, max(2, blocks // 4)))
    storeys = max(1, round(blocks / (2 * bays + 1)))
    axis = np.concatenate([[0.0], np.cumsum(random.uniform(0.8, 1.8, bays))])
    width, found, y = random.uniform(0.2, 0.45), [], 0.0
    for _ in range(storeys):
        high, depth = random.uniform(0.4, 1.4), random.uniform(0.2, 0.5)
        found += [rectangle(x - 0.5 * width, y, x + 0.5 * width, y + high) for x in axis]
        ends = np.concatenate([[axis[0] - 0.5 * width], axis[1:-1], [axis[-1] + 0.5 * width]])
        found += [rectangle(a, y + high, b, y + high + depth) for a, b in pairwise(ends)]
        y += high + depth
    return Outline.of(found)


def cut_rubble(random: Random, blocks: int) -> Outline:
    """A rectangle, cut again and again along random lines."""
    whole = np.array(rectangle(0.0, 0.0, random.uniform(0.5, 2.0) * 2.0, 2.0))
    pieces = [whole]
    for _ in range(20 * blocks):
        if len(pieces) >= blocks:
            break
        largest = int(np.argmax([area(piece) for piece in pieces]))
        halves = cut(random, pieces[largest])
        shortest = min(
            np.linalg.norm(np.subtract(*sides_of([h])[:2]), axis=1).min() for h in halves
        )
        if shortest > 0.15 * np.sqrt(area(halves[0])):
            pieces[largest : largest + 1] = halves
    return Outline.of(pieces)


def cut(random: Random, piece: Array) -> list[Array]:
    """Two parts of a convex polygon, cut about across its longer extension."""
    middle = piece.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((piece - middle).T))
    normal = turned(vectors[:, 1], random.uniform(-25.0, 25.0))
    offset = random.uniform(-0.3, 0.3) * np.sqrt(values[1])
    height = (piece - middle) @ normal - offset
    halves: list[list[Array]] = [[], []]
    for k, after in enumerate(np.roll(np.arange(len(piece)), -1)):
        halves[int(height[k] > 0.0)].append(piece[k])
        if (height[k] > 0.0) != (height[after] > 0.0):
            share = height[k] / (height[k] - height[after])
            point = piece[k] + share * (piece[after] - piece[k])
            halves[0].append(point)
            halves[1].append(point)
    return [np.array(half) for half in halves]


def area(corners: Array) -> float:
    """Area of a polygon, anticlockwise."""
    after = np.roll(corners, -1, axis=0)
    return 0.5 * float(np.sum(corners[:, 0] * after[:, 1] - after[:, 0] * corners[:, 1]))


def cells_of_points(random: Random, blocks: int) -> Outline:
    """Voronoi's cells of random points in a rectangle, the points moved apart a little."""
    from scipy.spatial import Voronoi

    size = np.array([random.uniform(0.5, 2.0) * 2.0, 2.0])
    points = random.uniform(0.0, 1.0, (blocks, 2)) * size
    for _ in range(3):
        # With their mirror images about all sides, the cells inside end at the sides.
        images = [points] + [points * sign + shift for sign, shift in mirrors(size)]
        diagram = Voronoi(np.concatenate(images))
        regions = [diagram.regions[diagram.point_region[k]] for k in range(blocks)]
        corners = np.round(diagram.vertices, 9)
        cells = [convex(corners[region]) for region in regions]
        points = np.array([cell.mean(axis=0) for cell in cells])
    return Outline.of(without_short_sides(cells, 0.03 * np.sqrt(size.prod() / blocks)))


def mirrors(size: Array) -> Iterator[tuple[Array, Array]]:
    """Signs and shifts that mirror points about the four sides of a rectangle."""
    for axis in (0, 1):
        sign = np.where(np.arange(2) == axis, -1.0, 1.0)
        for place in (0.0, 2.0):
            yield sign, np.where(np.arange(2) == axis, place * size, 0.0)


def convex(corners: Array) -> Array:
    """Corners of a convex polygon, anticlockwise."""
    x, y = (corners - corners.mean(axis=0)).T
    return corners[np.argsort(np.arctan2(y, x))]


def without_short_sides(cells: Sequence[Array], shortest: float) -> list[Array]:
    """Cells whose corners that are close to each other are made one, in all cells alike."""
    corners = np.unique(np.concatenate(cells), axis=0)
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    # Corners on the outline stay where they are.
    inside = (corners > [x0 + 1e-6, y0 + 1e-6]) & (corners < [x1 - 1e-6, y1 - 1e-6])
    order = np.argsort(inside.sum(axis=1), kind="stable")
    kept: list[Array] = []
    place: dict[tuple[float, ...], Array] = {}
    for corner in corners[order]:
        near = [one for one in kept if np.linalg.norm(one - corner) < shortest]
        kept += [] if near else [corner]
        place[tuple(corner)] = near[0] if near else corner
    moved = [np.array([place[tuple(corner)] for corner in cell]) for cell in cells]
    apart = [cell[np.any(cell != np.roll(cell, 1, axis=0), axis=1)] for cell in moved]
    return [cell for cell in apart if len(cell) > 2 and area(cell) > 0.0]


def arch(random: Random, blocks: int) -> Outline:
    """Voussoirs with radial joints between two springings, of any rise."""
    count, thickness = int(np.clip(blocks, 2, 21)), random.uniform(0.1, 0.4)
    half = 0.5 * np.radians(random.uniform(80.0, 180.0))
    angles = np.pi / 2.0 + np.linspace(half, -half, count + 1)
    ray = np.column_stack([np.cos(angles), random.uniform(0.6, 1.5) * np.sin(angles)])
    inner, outer = (1.0 - 0.5 * thickness) * ray, (1.0 + 0.5 * thickness) * ray
    corners = np.stack([inner[:-1], inner[1:], outer[1:], outer[:-1]], axis=1)
    springings = [(inner[0], outer[0]), (inner[-1], outer[-1])]
    lines = list(pairwise(outer))
    groups: dict[str, list[Segment]] = {"base": springings, "top": lines}
    groups["left"] = lines[: max(1, count // 3)]
    return Outline(list(corners), {**groups, "top": lines[len(groups["left"]) :]})


def flat_arch(random: Random, blocks: int) -> Outline:
    """Wedges between two piers, level above and below."""
    count, depth = int(np.clip(blocks - 2, 1, 15)), random.uniform(0.3, 0.8)
    span, lean = random.uniform(1.0, 3.0), random.uniform(0.1, 0.6)
    pier, foot = random.uniform(0.8, 2.5), random.uniform(0.0, 0.6)
    low = np.linspace(-0.5, 0.5, count + 1) * span
    high = low * (1.0 + 2.0 * lean * depth / span)
    y0, y1 = foot, foot + depth
    found = [
        [(low[k], y0), (low[k + 1], y0), (high[k + 1], y1), (high[k], y1)] for k in range(count)
    ]
    end = 0.5 * span + pier
    right = [(low[-1], 0.0), (end, 0.0), (end, y1), (high[-1], y1), (low[-1], y0)]
    right = right if foot > 0.05 else [(low[-1], y0), (end, y0), (end, y1), (high[-1], y1)]
    found += [right, [(-x, y) for x, y in right][::-1]]
    made = Outline.of(found)
    ground = min(y for x, y in right)
    made.groups["base"] = [((low[-1], ground), (end, ground)), ((-end, ground), (low[0], ground))]
    return made


KINDS: dict[str, Callable[[Random, int], Outline]] = {
    "bond": bond,
    "stack": stack,
    "incline": incline,
    "posts and beams": posts_and_beams,
    "cut rubble": cut_rubble,
    "cells of points": cells_of_points,
    "arch": arch,
    "flat arch": flat_arch,
}


# Materials, laws and loads


def materials(random: Random) -> dict[str, Material]:
    """Two materials, alike or with any contrast of stiffness and weight."""
    stone = Material(YOUNG, random.uniform(0.0, 0.4), DENSITY)
    young, density = (10.0 ** random.uniform(-3.0, 3.0, 2)) ** (random.random(2) < 0.35)
    return {"one": stone, "other": replace(stone, young=YOUNG * young, density=DENSITY * density)}


def law(random: Random, stress: float) -> JointLaw:
    """Coulomb's law mostly; a given strength is a part of a typical stress, Pa."""
    kind = random.random()
    if kind < 0.15:
        return tresca(stress * random.uniform(0.05, 1.0))
    return JointLaw("frictionless") if kind < 0.22 else coulomb(random.uniform(0.2, 1.2))


def direction(random: Random, size: float) -> tuple[float, float]:
    """A vector of a length; to either side, or at any angle."""
    angle = random.choice([0.0, 180.0, random.uniform(0.0, 360.0)])
    x, y = turned((size, 0.0), angle).tolist()
    return x, y


@dataclass(frozen=True)
class Parts:
    """Loads, laws and supports of an outline, and the groups they need.

    Attributes:
        outline: The blocks.
        random: Where the numbers come from.
        stress: Pressure under the highest column of stone, Pa.
        groups: Sides by name that have a role.
    """

    outline: Outline
    random: Random
    stress: float
    groups: dict[str, list[Segment]] = field(default_factory=dict)

    def free(self) -> str | None:
        """Name of a group that has no role yet, from now on with one; None if there is none."""
        names = sorted(set(self.outline.groups) - {"base"} - set(self.groups))
        if not names:
            return None
        name = str(self.random.choice(names))
        self.groups[name] = self.outline.groups[name]
        return name

    def leaves_some(self, names: Sequence[str]) -> bool:
        """Whether some block lies on none of some groups."""
        lines = [line for name in names for line in self.outline.groups[name]]
        return any(not any(on([b], line) for line in lines) for b in self.outline.blocks)

    def loads(self, live_body: bool) -> dict[str, Load]:
        """Weight, often with pressure on a side; a live load on all blocks or on a side."""
        random, dead, live = self.random, {}, {}
        if random.random() < 0.25 and (name := self.free()):
            x, y = turned((0.0, -self.stress), random.uniform(-20.0, 20.0)) * random.uniform(0.1, 2)
            dead[name] = (float(x), float(y))
        body = direction(random, GRAVITY)
        if not live_body and random.random() < 0.4 and (name := self.free()):
            live[name], body = direction(random, self.stress), (0.0, 0.0)
        x, y = turned((0.0, -GRAVITY), self.outline.slope).tolist()
        return {"dead": Load((x, y), dead), "live": Load(body, live)}

    def supports(self) -> dict[str, str]:
        """A side on rollers, or the ground fixed to the blocks; some block is always free."""
        random, held = self.random, {}
        if random.random() < 0.12 and (name := self.free()):
            held[name] = "roller"
        if random.random() < 0.08:
            held["base"] = "fixed"
        return held if self.leaves_some(list(held)) else {}

    def laws(self) -> dict[str, dict[str, JointLaw]]:
        """One law everywhere, or others on the ground and at some joints."""
        random, joint = self.random, coulomb(self.random.uniform(0.2, 1.2))
        mixed = random.random() < 0.4
        joints = {"default": law(random, self.stress) if mixed else joint}
        ground = {"base": law(random, self.stress) if mixed else joint}
        stretches = [s for s in shared_stretches(self.outline.blocks) if random.random() < 0.4]
        if mixed and stretches:
            self.groups["some"] = stretches
            joints["some"] = law(random, self.stress)
        self.groups["base"] = self.outline.groups["base"]
        return {"joints": joints, "foundations": ground}


@dataclass(frozen=True)
class Draw:
    """What a random scene is made from.

    Attributes:
        kind: One of `KINDS`.
        blocks: About how many blocks.
        elements: Along a typical side of a block.
        seed: Of all other numbers.
    """

    kind: str
    blocks: int
    elements: int
    seed: int

    @classmethod
    def of_seed(cls, seed: int) -> Draw:
        """A draw whose kind and size are random as well."""
        random = np.random.default_rng([seed, 1])
        blocks = int(np.clip(round(np.exp(random.uniform(np.log(2.0), np.log(40.0)))), 2, 40))
        return cls(str(random.choice(list(KINDS))), blocks, int(random.integers(1, 3)), seed)

    def recipe(self) -> Recipe:
        """The scene, to be made in any variant."""
        random = np.random.default_rng(self.seed)
        outline = KINDS[self.kind](random, self.blocks)
        height = float(np.ptp(np.concatenate(outline.blocks)[:, 1]))
        named = random.choice(["one", "other"], len(outline.blocks)).tolist()
        named[0] = "one"  # no group without blocks
        parts = Parts(outline, random, DENSITY * GRAVITY * height)
        stones, supports = materials(random), parts.supports()
        # A live load on one side could act on held blocks alone.
        chosen: dict[str, Any] = {
            "supports": supports,
            **parts.loads(live_body=bool(supports)),
            **parts.laws(),
        }
        if "base" in supports:
            chosen["foundations"] = {}
        chosen["materials"] = {name: stones[name] for name in sorted(set(named))}
        span = float(np.sqrt(np.median([area(block) for block in outline.blocks])))

        def draw(elements: int, quadrilaterals: bool) -> Any:
            size = span / elements * (2.0 if quadrilaterals else 1.0)
            return polygons(outline.blocks, size, named, parts.groups, quadrilaterals)

        return Recipe(draw, parts=chosen)
