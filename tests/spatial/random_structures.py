"""Random structures in space as tables of scenes: 5 to 60 blocks, drawn by a seed.

Kinds take turns. Blocks touch exactly; what touches by edges and corners alone does so inside of
sides. Loads, laws, ties, floors and movements are drawn for each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise, product
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

Array = npt.NDArray[np.float64]
Blocks = dict[str, dict[str, Any]]
Random = np.random.Generator


def block(points: Iterable[Any], **more: Any) -> dict[str, Any]:
    """A block around points."""
    return {"vertices": np.asarray(list(points), dtype=float).tolist(), **more}


def box(low: Iterable[float], high: Iterable[float], **more: Any) -> dict[str, Any]:
    """A block along the axes."""
    return {"box": [[float(v) for v in low], [float(v) for v in high]], **more}


def prism(profile: Iterable[tuple[float, float]], y: tuple[float, float], **more: Any) -> Any:
    """A block with a profile in x and z, between two y."""
    return block([(a, b, c) for b in y for a, c in profile], **more)


def slab(x: tuple[float, float], y: tuple[float, float], top: float = 0.0) -> dict[str, Any]:
    """Ground below a height."""
    return box((x[0] - 0.5, y[0] - 0.5, top - 0.3), (x[1] + 0.5, y[1] + 0.5, top), fixed=True)


def around(angle: float, axis: int = 2) -> Array:
    """A turn about an axis."""
    c, s = math.cos(angle), math.sin(angle)
    return np.roll(np.roll([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], axis - 2, 0), axis - 2, 1)


def moved(blocks: Blocks, matrix: Array, shift: Any = (0.0, 0.0, 0.0)) -> Blocks:
    """Blocks turned and shifted."""

    def one(table: dict[str, Any]) -> dict[str, Any]:
        if "pieces" in table:
            return {**table, "pieces": [one(piece) for piece in table["pieces"]]}
        points = np.array(table["box"] if "box" in table else table["vertices"])
        if "box" in table:
            points = np.array(list(product(*points.T)))
        rest = {key: value for key, value in table.items() if key not in ("box", "vertices")}
        return block(points @ matrix.T + shift, **rest)

    return {name: one(table) for name, table in blocks.items()}


def bond(r: Random, length: float, height: float, gap: float = 0.0) -> Any:
    """Rectangles of a wall in running bond, by courses: from, to, bottom, top."""
    courses = int(r.integers(2, 5))
    for course in range(courses):
        count = int(r.integers(2, 5))
        inner = np.sort(r.uniform(0.15, 0.85, count - 1)) * length
        ends = np.array([0.0, *inner, length])
        low, high = height * course / courses, height * (course + 1) / courses
        for k, (start, end) in enumerate(pairwise(ends)):
            opening = gap and 0 < course < courses - 1 and 0 < k < count - 1
            if end - start > 0.08 * length and not opening:
                yield f"{course}_{k}", (start, end, low, high)


def wall(r: Random) -> Blocks:
    """A wall in bond, maybe with openings."""
    length, height, thick = r.uniform(1.5, 3.0), r.uniform(1.0, 2.0), r.uniform(0.15, 0.4)
    found = {"ground": slab((0.0, length), (0.0, thick))}
    for name, (a, b, low, high) in bond(r, length, height, float(r.random() < 0.5)):
        found[f"w{name}"] = box((a, 0.0, low), (b, thick, high))
    return found


def corner(r: Random) -> Blocks:
    """Two walls that interlock at a corner."""
    thick, long, courses = r.uniform(0.2, 0.4), r.uniform(1.2, 2.0), int(r.integers(3, 6))
    high = r.uniform(0.2, 0.35)
    found = {"ground": slab((0.0, long), (0.0, long))}
    for n in range(courses):
        low, top = n * high, (n + 1) * high
        cut = r.uniform(0.4, 0.6, 2) * long
        first, second = (0.0, thick) if n % 2 else (thick, 0.0)
        found[f"x{n}a"] = box((first, 0.0, low), (cut[0], thick, top), group="xs")
        found[f"x{n}b"] = box((cut[0], 0.0, low), (long, thick, top), group="xs")
        found[f"y{n}a"] = box((0.0, second, low), (thick, cut[1], top), group="ys")
        found[f"y{n}b"] = box((0.0, cut[1], low), (thick, long, top), group="ys")
    return found


def leaning(r: Random) -> Blocks:
    """A wall that leans as a whole on ground that leans with it."""
    flat = wall(r)
    return moved(flat, around(r.uniform(-0.15, 0.15), 0) @ around(r.uniform(-0.1, 0.1), 1))


def stack(r: Random) -> Blocks:
    """Blocks on each other, shifted and turned, narrower upwards or not."""
    found = {"ground": slab((-1.0, 1.0), (-1.0, 1.0))}
    top, shift = 0.0, np.zeros(2)
    for k in range(int(r.integers(3, 8))):
        half, high = r.uniform(0.25, 0.6, 2), r.uniform(0.15, 0.5)
        shift = shift + r.uniform(-0.1, 0.1, 2)
        one = {"one": box((-half[0], -half[1], 0.0), (half[0], half[1], high))}
        turned = moved(one, around(r.uniform(0.0, np.pi)), (*shift, top))
        found[f"s{k}"] = turned["one"]
        top += high
    return found


def arch(r: Random) -> Blocks:
    """An arch or a barrel of strips, its first and last stones ground or on ground."""
    count, strips = int(r.integers(5, 14)), int(r.integers(1, 4))
    inner = 1.0
    outer = inner + r.uniform(0.1, 0.35)
    start = r.uniform(0.0, 0.5)
    angles = np.linspace(start, np.pi - start, count + 1)
    width = r.uniform(0.3, 1.0) / strips
    found: Blocks = {}
    for strip in range(strips):
        shift = 0.5 * (angles[1] - angles[0]) * (strip % 2)
        inside = [angles[0], *(angles[1:-1] + shift), angles[-1]]
        for k, (a, b) in enumerate(pairwise(inside)):
            rim = [
                (q * math.cos(t), q * math.sin(t))
                for q, t in ((inner, a), (outer, a), (outer, b), (inner, b))
            ]
            ends = (strip * width, (strip + 1) * width)
            found[f"v{strip}_{k}"] = prism(rim, ends, fixed=k in (0, len(inside) - 2))
    return found


def dome(r: Random) -> Blocks:
    """A dome of plane stones with an oculus, or a part of it."""
    around_, rings = int(r.integers(5, 9)), int(r.integers(2, 5))
    thick = r.uniform(0.08, 0.3)
    heights = np.linspace(r.uniform(0.0, 0.4), r.uniform(1.0, 1.3), rings + 1)
    found: Blocks = {}
    kept = around_ if r.random() < 0.7 else around_ // 2
    for ring, k in product(range(rings), range(kept)):
        turns = 2.0 * np.pi * np.array([k, k + 1]) / around_
        points = [
            (q * math.cos(h) * math.cos(t), q * math.cos(h) * math.sin(t), q * math.sin(h))
            for q, h, t in product((1.0, 1.0 + thick), heights[ring : ring + 2], turns)
        ]
        found[f"d{ring}_{k}"] = block(points, fixed=ring == 0)
    return found


def cut(points: Array, normal: Array, level: float) -> Array | None:
    """Corners of the part of a convex body below a plane."""
    hull = ConvexHull(points)
    height = points @ normal - level
    edges = {
        tuple(sorted((s[a], s[b]))) for s in hull.simplices for a, b in ((0, 1), (1, 2), (0, 2))
    }
    kept = [points[k] for k in hull.vertices if height[k] <= 1e-9]
    for a, b in edges:
        if min(height[a], height[b]) < -1e-9 and max(height[a], height[b]) > 1e-9:
            part = height[a] / (height[a] - height[b])
            kept.append(points[a] + part * (points[b] - points[a]))
    if len(kept) < 4:
        return None
    kept_points = np.array(kept)
    try:
        hull = ConvexHull(kept_points)
    except Exception:
        return None
    unique = np.unique(np.round(kept_points[hull.vertices], 12), axis=0)
    return unique if hull.volume > 1e-3 else None


def rubble(r: Random) -> Blocks:
    """A body that random planes cut into stones."""
    size = r.uniform(0.8, 1.6, 3)
    found = {"ground": slab((0.0, size[0]), (0.0, size[1]))}
    stones = [np.array(list(product((0.0, size[0]), (0.0, size[1]), (0.0, size[2]))))]
    for _ in range(int(r.integers(4, 12))):
        largest = max(range(len(stones)), key=lambda k: ConvexHull(stones[k]).volume)
        stone = stones.pop(largest)
        for _ in range(50):
            normal = r.normal(size=3) * [0.6, 0.6, 1.0]
            normal /= np.linalg.norm(normal)
            level = float(normal @ stone.mean(axis=0)) + r.uniform(-0.1, 0.1)
            parts = [cut(stone, normal, level), cut(stone, -normal, -level)]
            if all(part is not None and _thick(part) for part in parts):
                stones += [part for part in parts if part is not None]
                break
        else:
            stones.append(stone)
    if r.random() < 0.3 and len(stones) > 3:
        stones.pop(int(r.integers(len(stones))))
    return found | {f"r{k}": block(stone) for k, stone in enumerate(stones)}


def _thick(points: Array) -> bool:
    """Whether a stone is no splinter."""
    hull = ConvexHull(points)
    lengths = np.linalg.norm(points[:, None] - points, axis=2)[np.triu_indices(len(points), 1)]
    return bool(6.0 * hull.volume / hull.area > 0.12 and lengths.min() > 0.03)


def rocks(r: Random) -> Blocks:
    """Rocks, each on three tips of the ground, one more on the flat top of some."""
    found: Blocks = {}
    count = int(r.integers(2, 5))
    found["ground"] = slab((0.0, 2.0 * count), (-1.0, 1.0))
    for k in range(count):
        middle = np.array([1.0 + 2.0 * k, 0.0])
        tilt = r.uniform(-0.15, 0.15, 2)
        turns = np.cumsum(r.uniform(1.8, 2.4, 3))
        for n, turn in enumerate(turns):
            at = 0.35 * np.array([math.cos(turn), math.sin(turn)])
            high = 0.3 + at @ tilt
            foot = 0.12 * np.array([(math.cos(t), math.sin(t)) for t in np.arange(4) * 1.6 + turn])
            tip = [(*(middle + at + f), 0.0) for f in foot] + [(*(middle + at), high)]
            found[f"tip{k}_{n}"] = block(tip, fixed=True)
        disc = [0.55 * np.array([math.cos(t), math.sin(t)]) for t in np.arange(7) * 0.9]
        low = [(*(middle + d), 0.3 + d @ tilt) for d in disc]
        high_ = [(*(middle + 0.6 * d + r.uniform(-0.1, 0.1, 2)), r.uniform(0.7, 1.0)) for d in disc]
        found[f"rock{k}"] = block([*low, *high_])
    return found


def stairs(r: Random) -> Blocks:
    """Steps that lie on each other and are held in a wall at one end."""
    tread, rise, width = r.uniform(0.25, 0.35), r.uniform(0.15, 0.2), r.uniform(0.8, 1.4)
    count, over, held = int(r.integers(4, 9)), r.uniform(0.03, 0.12), r.uniform(0.05, 0.2)
    found = {"ground": slab((0.0, count * tread), (0.0, width))}
    for k in range(count):
        low = (k * tread, 0.0, k * rise)
        found[f"step{k}"] = box(low, ((k + 1) * tread + over, width, (k + 1) * rise))
        start, end = (k * tread, (k + 1) * tread + over)
        if k:
            found[f"below{k}"] = box(
                (start + over + 0.01, -0.3, 0.0), (end - over - 0.01, held, k * rise), fixed=True
            )
        if r.random() < 0.9:
            top = (k + 1) * rise
            fixed = bool(r.random() < 0.5)
            low, high = (start, -0.3 * fixed, top), (start + tread, held, top + 1.0 - 0.9 * fixed)
            found[f"above{k}"] = box(low, high, fixed=fixed)
    return found


def cards(r: Random) -> Blocks:
    """Planks that lean on walls with their edges."""
    found: Blocks = {}
    for k in range(int(r.integers(2, 4))):
        lean = math.radians(r.uniform(45.0, 75.0))
        long, thick, wide = r.uniform(1.0, 2.0), r.uniform(0.05, 0.15), r.uniform(0.3, 0.8)
        c, s = math.cos(lean), math.sin(lean)
        rim = [
            (c * a - s * b, s * a + c * b)
            for a, b in ((0, 0), (long, 0), (long, thick), (0, thick))
        ]
        right = max(a for a, _ in rim)
        low = min(b for _, b in rim)
        y = 1.5 * k
        found[f"wall{k}"] = box((0.0, y - 0.2, 0.0), (0.3, y + wide + 0.2, 3.0), fixed=True)
        found[f"plank{k}"] = prism([(a - right, b - low) for a, b in rim], (y, y + wide))
        if r.random() < 0.5:
            found[f"stop{k}"] = box((-1.9, y, 0.0), (-1.5, y + wide, 0.3))
    return found | {"ground": slab((-2.5, 0.3), (0.0, 5.0))}


def knives(r: Random) -> Blocks:
    """Beams on knife edges; plates on keels across ridges."""
    found = {"ground": slab((-1.0, 3.0), (-1.0, 3.0))}
    high = r.uniform(0.3, 0.5)
    ridges = np.sort(np.array([0.0, 1.0]) + r.uniform(0.1, 0.9, 2))
    for k, x in enumerate(ridges):
        found[f"ridge{k}"] = prism([(x - 0.15, 0.0), (x + 0.15, 0.0), (x, high)], (-0.2, 2.2))
    if r.random() < 0.5:
        for k in range(int(r.integers(1, 4))):
            y = 0.7 * k
            found[f"beam{k}"] = box((-0.2, y, high), (2.2, y + 0.5, high + 0.3))
            found[f"load{k}"] = box((0.5, y + 0.1, high + 0.3), (1.5, y + 0.4, high + 0.6))
        return found
    plate = [box((-0.1, 0.0, high + 0.2), (2.1, 2.0, high + 0.4))]
    for y in (0.4, 1.6):
        rim = [(y - 0.1, high + 0.2), (y + 0.1, high + 0.2), (y, high)]
        plate.append(block([(x, a, b) for x in (-0.1, 2.1) for a, b in rim]))
    found["plate"] = {"pieces": plate}
    return found


def groove(r: Random) -> Blocks:
    """Prisms in a groove, one after the other, and stones on top."""
    half = math.radians(r.uniform(35.0, 60.0))
    c, s = math.cos(half), math.sin(half)
    found: Blocks = {}
    count = int(r.integers(2, 5))
    ends = np.cumsum([0.0, *r.uniform(0.3, 0.8, count)])
    long, deep = 0.6, 0.2
    for name, side in (("left", -1.0), ("right", 1.0)):
        rim = [(0.0, 0.0), (side * s * long, c * long), (side * s * long, -deep), (0.0, -deep)]
        found[name] = prism(rim, (-0.2, ends[-1] + 0.2), fixed=True)
    top = c * 0.5
    for k, (a, b) in enumerate(pairwise(ends)):
        found[f"prism{k}"] = prism([(0.0, 0.0), (s * 0.5, top), (-s * 0.5, top)], (a, b))
        if r.random() < 0.6:
            found[f"top{k}"] = box(
                (-0.2, a + 0.02, top), (0.2, b - 0.02, top + r.uniform(0.1, 0.5))
            )
    return found


def logs(r: Random) -> Blocks:
    """Beams crosswise in layers."""
    found = {"ground": slab((0.0, 2.0), (0.0, 2.0))}
    high = r.uniform(0.15, 0.3)
    for n in range(int(r.integers(2, 6))):
        for k, place in enumerate(np.sort(np.array([0.1, 1.0]) + r.uniform(0.0, 0.7, 2))):
            wide = r.uniform(0.12, 0.2)
            low, end = r.uniform(0.0, 0.1), r.uniform(1.9, 2.0)
            a, b = (place, low, n * high), (place + wide, end, (n + 1) * high)
            swap = (0, 1, 2) if n % 2 else (1, 0, 2)
            found[f"log{n}_{k}"] = box([a[i] for i in swap], [b[i] for i in swap])
    return found


def wedges(r: Random) -> Blocks:
    """Wedges between stones on ground, with walls at the ends or without."""
    found = {"ground": slab((0.0, 3.0), (0.0, 0.5))}
    slope, high, x, lean = (
        r.choice([-1.0, 1.0]) * r.uniform(0.03, 0.25),
        r.uniform(0.4, 0.8),
        0.0,
        0.0,
    )
    for k in range(int(r.integers(3, 6))):
        wide = r.uniform(0.5, 0.8)
        after = slope if k % 2 == 0 else -slope
        low = 0.0 if k % 2 == 0 else 0.1
        rim = [(x + lean * low, low), (x + wide + after * low, low)]
        rim += [(x + wide + after * high, high), (x + lean * high, high)]
        found[f"stone{k}"] = prism(rim, (0.0, 0.5), group="wedges" if k % 2 else "default")
        x, lean = x + wide, after
    if r.random() < 0.6:
        for name, at, side in (("first", 0.0, -1.0), ("last", x, 1.0)):
            tilt = 0.0 if side < 0.0 else lean
            rim = [(at, 0.0), (at + tilt, 1.0), (at + side * 0.8, 1.0), (at + side * 0.8, 0.0)]
            found[name] = prism(rim, (-0.1, 0.6), fixed=True)
    return found


def frame(r: Random) -> Blocks:
    """Piers with lintels in one or two storeys."""
    count = int(r.integers(2, 4))
    found: Blocks = {"ground": slab((0.0, 3.0), (0.0, 0.6))}
    low = 0.0
    for storey in range(int(r.integers(1, 3))):
        high = r.uniform(0.8, 1.6)
        for k in range(count):
            found[f"pier{storey}_{k}"] = box(
                (1.2 * k, 0.0, low), (1.2 * k + 0.4, 0.5, low + high), group="piers"
            )
        for k in range(count - 1):
            start = 0.0 if k == 0 else 1.2 * k + 0.2
            end = 1.2 * (k + 1) + (0.2 if k < count - 2 else 0.4)
            found[f"lintel{storey}_{k}"] = box(
                (start, 0.0, low + high), (end, 0.5, low + high + 0.3)
            )
        low += high + 0.3
    return found


KINDS: dict[str, Callable[[Random], Blocks]] = {
    kind.__name__: kind
    for kind in (
        wall,
        corner,
        leaning,
        stack,
        arch,
        dome,
        rubble,
        rocks,
        stairs,
        cards,
        knives,
        groove,
        logs,
        wedges,
        frame,
    )
}
DIRECTIONS = [
    (1, 0, 0),
    (-1, 0, 0),
    (0, 1, 0),
    (0, -1, 0),
    (1, 1, 0),
    (1, -2, 0.5),
    (0, 0, -1),
    (0, 0, 1),
]
WEIGHTS = [0.16, 0.1, 0.2, 0.1, 0.16, 0.16, 0.06, 0.06]


def structure(seed: int) -> dict[str, Any]:
    """Tables of a scene, by a seed; its title is the kind."""
    r = np.random.default_rng(seed)
    names = list(KINDS)
    kind = names[seed % len(names)]
    blocks = KINDS[kind](r)
    friction = float(r.choice([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.2, 1.5]))
    joints: dict[str, Any] = {"default": {"friction": friction}}
    groups = {table.get("group", "default") for table in blocks.values()}
    for group in sorted(groups - {"default"}):
        joints[group] = {
            "between": ["default", group],
            "friction": round(friction * r.uniform(0.5, 1.2), 3),
        }
    tables: dict[str, Any] = {
        "dimension": 3,
        "title": kind,
        "blocks": blocks,
        "materials": {"default": {"density": 2000.0}},
        "joints": joints,
        "loads": {"dead": {"body": [0.0, 0.0, -9.81]}},
        "solve": {"quick": bool(r.random() < 0.4), "time": 60.0},
    }
    moving = [name for name, table in blocks.items() if not table.get("fixed")]
    live: dict[str, Any] = {}
    if r.random() < 0.8:
        live["direction"] = [float(v) for v in DIRECTIONS[r.choice(len(DIRECTIONS), p=WEIGHTS)]]
    if not live or r.random() < 0.15:
        name = str(r.choice(moving))
        live["force"] = {"push": {"block": name, "force": r.normal(size=3).round(2).tolist()}}
        live["force"]["push"]["force"] = (1000.0 * r.normal(size=3)).round(0).tolist()
        if r.random() < 0.5:
            live["force"]["push"]["at"] = _within(blocks[name], r)
    tables["loads"]["live"] = live
    if r.random() < 0.15:
        tables["solve"]["direction"] = "both"
    elif r.random() < 0.15:
        tables["solve"]["direction"] = "negative"
    _more(r, tables, moving)
    return tables


def _within(table: dict[str, Any], r: Random) -> list[float]:
    """A place in a block."""
    if "pieces" in table:
        table = table["pieces"][0]
    points = np.array(table["box"] if "box" in table else table["vertices"])
    share = r.dirichlet(np.ones(len(points)))
    return [float(v) for v in 0.5 * points.mean(axis=0) + 0.5 * share @ points]


def _more(r: Random, tables: dict[str, Any], moving: list[str]) -> None:
    """Dilatancy, cohesion, ties, floors, movements, each in some scenes."""
    joints = tables["joints"]
    if r.random() < 0.2:
        angle = math.degrees(math.atan(min(law["friction"] for law in joints.values())))
        part = float(r.choice([0.2, 0.5, 1.0]))
        for law in joints.values():
            law["dilatancy"] = part * angle
    if r.random() < 0.2:
        joints["default"]["cohesion"] = float(r.choice([500.0, 3000.0, 2e4]))
        if r.random() < 0.4:
            joints["default"]["tensile_strength"] = (
                0.3 * joints["default"]["cohesion"] / joints["default"]["friction"]
            )
    if r.random() < 0.2 and len(moving) > 1:
        first, second = (str(name) for name in r.choice(moving, 2, replace=False))
        tie: dict[str, Any] = {"from": _within(tables["blocks"][first], r)}
        tie["yield"] = float(r.choice([500.0, 5000.0, 1e5]))
        tie["to"] = _within(tables["blocks"][second], r)
        if r.random() < 0.5:
            tie["ground"] = [float(v) for v in np.array([-2.0, 0.5, 1.0]) + tie.pop("to")]
        tables["ties"] = {"tie": tie}
    boxes = [tables["blocks"][name] for name in moving if "box" in tables["blocks"][name]]
    if r.random() < 0.2 and boxes:
        top = max(table["box"][1][2] for table in boxes)
        mass = bool(r.random() < 0.5)
        tables["floors"] = {"floor": {"z": top, "force": float(r.uniform(1e3, 8e3)), "mass": mass}}
    fixed = [name for name, table in tables["blocks"].items() if table.get("fixed")]
    if r.random() < 0.15:
        shift = (1e-3 * r.normal(size=3)).round(6).tolist()
        tables["loads"]["dead"]["movement"] = {str(r.choice(fixed)): {"displacement": shift}}
