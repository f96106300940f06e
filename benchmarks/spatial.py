"""Structures in space: gaps, factorisations, time; certificates recomputed by Clarabel.

    python3 benchmarks/spatial.py [--only "facade*,random 1?"] [--laws quick] [--check 0.25]

59 scenes of 1 to 2 000 blocks, among them hand values, and random ones of 50 to 1 000: walls,
corners, houses, domes and vaults, with friction of 0.3 to 1 under oblique loads. No scene is drawn
twice: its number is its seed. Rows are added to the table as they come. A certificate says that
with the friction forces of its state nothing carries more than its upper end: Clarabel solves that
program again, from the same forces and nothing else, on a share of the scenes.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.peers.associative_sequence import cone_program
from benchmarks.scenes import matching
from benchmarks.worker import HOME, save
from fenics_contact.errors import Stopped
from fenics_contact.faces.model import FaceModel
from fenics_contact.results.result import Collapse
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial import builders
from fenics_contact.spatial.limit import collapse_of
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from tests.bank import WALLS
from tests.spatial.bank import Array, Pushed, barrel, extruded, towards

Row = dict[str, Any]
NAMES = (
    *("kind", "scene", "law", "blocks", "contacts", "status", "load_factor", "gap"),
    *("factorizations", "seconds", "attempts", "recomputed"),
)
FORM = "{:8} {:28} {:8} {:>5} {:>5} {:10} {:>10} {:>8} {:>4} {:>6} {:>2} {}"
HEADS = {"factorizations": "fact", "seconds": "s", "attempts": "n"}
#: Blocks from which on a gap five times as large is asked for.
MANY = 1500
#: Blocks of the random scenes.
LEAST, MOST = 50, 1000


# ---- scenes by name


def block(height: float) -> tuple[Block, ...]:
    """A block of 1 m x 1 m on the ground."""
    ground = Block((Polyhedron.box(np.array([-3, -3, -0.2]), np.array([3, 3, 0])),), fixed=True)
    return ground, Block((Polyhedron.box(np.zeros(3), np.array([1.0, 1.0, height])),))


def front(bricks: int, side: int, rows: int) -> builders.Blocks:
    """A facade with side walls, in bricks and courses."""
    length, depth = 0.4 * bricks, 0.4 * side + 0.2
    return builders.facade(length=length, side=depth, height=0.2 * rows, thickness=0.2)


def house(bricks: int, side: int, rows: int) -> builders.Blocks:
    """Four walls, in bricks and courses, with windows of two bricks."""
    windows = 1 if bricks < 10 else 2
    length, width = 0.4 * bricks, 0.4 * side
    low, high = 0.2 * (rows // 3), 0.2 * (rows // 3 + rows // 4 + 1)
    places = [length * (k + 1) / (windows + 1) for k in range(windows)]
    long = [[place - 0.4, place + 0.4, low, high] for place in places]
    short = [[0.5 * width - 0.4, 0.5 * width + 0.4, low, high]]
    openings = {"south": long, "north": long, "west": short, "east": short}
    size = {"length": length, "width": width, "height": 0.2 * rows}
    return builders.house(**size, thickness=0.2, openings=openings)


def corner(bricks: int, rows: int) -> builders.Blocks:
    """Two walls of the same length, in bricks and courses."""
    length = 0.4 * bricks
    return builders.corner(length_x=length, length_y=length, height=0.2 * rows, thickness=0.2)


def shell(
    meridians: int, rings: int, thickness: float = 0.1, bonded: bool = False
) -> builders.Blocks:
    """A hemisphere of radius 1 m."""
    counts = {"meridians": meridians, "rings": rings}
    return builders.dome(radius=1.0, thickness=thickness, bonded=bonded, **counts)


def groin(voussoirs: int, pieces: int) -> builders.Blocks:
    """A cross vault of a mean radius of 1 m."""
    size = {"span": 1.85, "thickness": 0.15, "length": 2.5}
    return builders.cross_vault(**size, voussoirs=voussoirs, pieces=pieces)


def bridge() -> builders.Blocks:
    """A bridge with rigid abutments."""
    springing = np.radians(20.0)
    return builders.bridge(
        span=4.0 * float(np.cos(springing)),
        rise=2.0 * (1.0 - float(np.sin(springing))),
        thickness=0.3,
        width=2.0,
        height=2.8 - 2.0 * float(np.sin(springing)),
        voussoirs=20,
        strips=4,
        spandrel=0.25,
    )


def lorry(centroid: Array) -> bool:
    """Blocks of a bridge on which a lorry stands."""
    return bool(0.5 < centroid[0] < 1.3 and centroid[2] > 0.52)


def named_scenes() -> Iterator[tuple[str, str, Pushed]]:
    """Kind, name and scene of the 59."""
    for degrees in (0.0, 20.0, 45.0):
        made = Pushed(partial(block, 2.0), 0.3, towards(degrees))
        yield "hand", f"block slides {degrees:g}", made
        yield "hand", f"block tilts {degrees:g}", replace(made, friction=0.8)
    yield "hand", "block twisted", Pushed(partial(block, 1.0), 0.5, twist=1.0)
    free = partial(builders.wall, length=2.0, height=0.875, thickness=0.2, brick=(0.4, 0.175))
    for degrees in (90.0, 45.0):
        yield "wall", f"free wall {degrees:g}", Pushed(free, 0.6, towards(degrees))
    for strips in (1, 3, 10, 19):
        across = Pushed(partial(barrel, strips), 0.6, towards(0.0))
        yield "vault", f"barrel 25x{strips}", across
    for degrees in (45.0, 90.0):
        oblique = Pushed(partial(barrel, 3), 0.6, towards(degrees))
        yield "vault", f"barrel 25x3 {degrees:g}", oblique
    for name, courses in WALLS.items():
        long = partial(extruded, courses, 0.2)
        yield "wall", name, Pushed(long, 0.65, towards(0.0))
    facades = {
        (4, 2, 6): (0.3, 0.5, 0.7, 1.0),
        (6, 3, 10): (0.4, 0.6, 0.8),
        (8, 4, 15): (0.4, 0.6, 0.8),
        (9, 4, 14): (0.6,),
        (12, 6, 20): (0.4, 0.6, 0.8),
        (18, 8, 28): (0.8,),
        (26, 12, 40): (0.6,),
    }
    for size, frictions in facades.items():
        name = "x".join(map(str, size))
        for friction in frictions:
            off = Pushed(partial(front, *size), friction, towards(-90.0))
            yield "facade", f"facade {name} {friction:g}", off
    for size in ((8, 4, 15), (12, 6, 20)):
        name = "x".join(map(str, size))
        off = Pushed(partial(front, *size), 0.6, towards(-60.0))
        yield "facade", f"facade {name} 0.6 oblique", off
    for meridians, rings in ((8, 6), (16, 8), (24, 12), (32, 16)):
        pushed = Pushed(partial(shell, meridians, rings), 0.7, towards(0.0))
        yield "dome", f"dome {meridians}x{rings}", pushed
    bonded = partial(shell, 16, 8, bonded=True)
    yield "dome", "dome 16x8 bonded", Pushed(bonded, 0.7, towards(0.0))
    for friction in (0.4, 0.7, 1.0):
        thick = Pushed(partial(shell, 12, 6, 0.15), friction, towards(0.0))
        yield "dome", f"dome 12x6 thick {friction:g}", thick
    for degrees in (180.0, 225.0):
        pushed = Pushed(partial(corner, 6, 10), 0.6, towards(degrees))
        yield "corner", f"corner 6x10 {degrees:g}", pushed
    for degrees in (0.0, 45.0, 90.0):
        pushed = Pushed(partial(house, 8, 6, 12), 0.6, towards(degrees))
        yield "house", f"house 8x6x12 {degrees:g}", pushed
    for size in ((12, 8, 16), (16, 10, 20), (24, 16, 28)):
        name = "x".join(map(str, size))
        yield "house", f"house {name}", Pushed(partial(house, *size), 0.6, towards(0.0))
    for voussoirs, pieces, degrees in ((16, 2, 0.0), (16, 2, 45.0), (24, 3, 0.0)):
        crossed = Pushed(partial(groin, voussoirs, pieces), 0.6, towards(degrees))
        yield "vault", f"cross vault {voussoirs}x{pieces} {degrees:g}", crossed
    down = (0.0, 0.0, -1.0)
    for friction in (0.3, 0.6):
        loaded = Pushed(bridge, friction, down, where=lorry)
        yield "bridge", f"bridge lorry {friction:g}", loaded
    yield "bridge", "bridge across 0.6", Pushed(bridge, 0.6, towards(90.0))


# ---- random scenes


def random_scene(seed: int) -> tuple[str, str, Pushed]:
    """Kind, name and scene: sizes are drawn until the number of blocks is within its range."""
    draw = np.random.default_rng([42, seed])
    kind = ("wall", "corner", "house", "dome", "vault")[seed % 5]
    while True:
        aimed = LEAST * (MOST / LEAST) ** draw.random()
        make = {
            "wall": random_wall,
            "corner": random_corner,
            "house": random_house,
            "dome": random_dome,
            "vault": random_vault,
        }[kind](draw, aimed)
        count = sum(not block.fixed for block in make())
        if LEAST <= count <= MOST and 0.5 < count / aimed < 2.0:
            break
    friction = float(draw.uniform(0.3, 1.0))
    direction = towards(float(draw.uniform(0.0, 360.0)), float(draw.uniform(-20.0, 20.0)))
    return "random", f"random {seed} {kind}", Pushed(make, friction, direction)


Make = Callable[[], builders.Blocks]


def random_brick(draw: np.random.Generator) -> tuple[float, float, float]:
    """Length and height of a brick, and the thickness of a wall, m."""
    length = float(draw.uniform(0.3, 0.6))
    return length, length * float(draw.uniform(0.3, 0.7)), length * float(draw.uniform(0.4, 1.0))


def random_openings(
    draw: np.random.Generator, length: float, height: float, brick: tuple[float, float], most: int
) -> list[list[float]]:
    """Windows in a row, or none where there is no room for them."""
    count = int(draw.integers(0, most + 1))
    bay = length / max(count, 1)
    wide = float(draw.uniform(0.25, 0.45)) * bay
    low, high = (float(part) * height for part in (draw.uniform(0.1, 0.4), draw.uniform(0.6, 0.8)))
    if bay - wide < 4.0 * brick[0] or high - low < 2.0 * brick[1] or height - high < 2.0 * brick[1]:
        return []
    return [
        [bay * (k + 0.5) - 0.5 * wide, bay * (k + 0.5) + 0.5 * wide, low, high]
        for k in range(count)
    ]


def random_wall(draw: np.random.Generator, aimed: float) -> Make:
    """A wall with windows, or a facade with side walls."""
    length, height, thickness = random_brick(draw)
    slender = float(draw.uniform(0.7, 2.0))  # courses for each brick of length
    sides = float(draw.uniform(0.3, 0.8)) if draw.random() < 0.5 else 0.0
    bricks = max(np.sqrt(aimed / (slender * (1.0 + 2.0 * sides))), 4.0)
    size = (length * bricks, height * max(round(slender * bricks), 3))
    brick = (length, height)
    openings = random_openings(draw, *size, brick, 3)
    if not sides:
        return partial(
            builders.wall,
            length=size[0],
            height=size[1],
            thickness=thickness,
            brick=brick,
            openings=openings,
        )
    return partial(
        builders.facade,
        length=size[0],
        side=sides * size[0] + thickness,
        height=size[1],
        thickness=thickness,
        brick=brick,
        openings=openings,
    )


def random_corner(draw: np.random.Generator, aimed: float) -> Make:
    """Two walls that meet."""
    length, height, thickness = random_brick(draw)
    slender, other = float(draw.uniform(0.7, 2.0)), float(draw.uniform(0.5, 1.5))
    bricks = max(np.sqrt(aimed / (slender * (1.0 + other))), 3.0)
    return partial(
        builders.corner,
        length_x=length * bricks,
        length_y=other * length * bricks + thickness,
        height=height * max(round(slender * bricks), 3),
        thickness=thickness,
        brick=(length, height),
    )


def random_house(draw: np.random.Generator, aimed: float) -> Make:
    """Four walls with windows, with or without a floor."""
    length, height, thickness = random_brick(draw)
    slender, other = float(draw.uniform(0.5, 1.5)), float(draw.uniform(0.5, 1.0))
    bricks = max(np.sqrt(aimed / (slender * 2.0 * (1.0 + other))), 5.0)
    rows = max(round(slender * bricks), 4)
    size = (length * bricks, other * length * bricks + 2.0 * thickness, height * rows)
    brick = (length, height)
    openings = {
        name: random_openings(draw, along, size[2], brick, most)
        for name, along, most in (
            *((name, size[0], 3) for name in ("south", "north")),
            *((name, size[1], 2) for name in ("west", "east")),
        )
    }
    floors = [height * (rows - 1)] if draw.random() < 0.5 else []
    return partial(
        builders.house,
        length=size[0],
        width=size[1],
        height=size[2],
        thickness=thickness,
        brick=brick,
        openings=openings,
        floors=floors,
        floor_strips=int(draw.integers(1, 9)),
    )


def random_dome(draw: np.random.Generator, aimed: float) -> Make:
    """A dome, bonded or not, open or with a keystone."""
    shape = float(draw.uniform(1.2, 3.0))
    rings = max(round(np.sqrt(aimed / shape)), 4)
    radius = float(draw.uniform(2.0, 8.0))
    return partial(
        builders.dome,
        radius=radius,
        thickness=radius * float(draw.uniform(0.07, 0.2)),
        meridians=max(round(aimed / rings), 6),
        rings=rings,
        embrace=float(draw.uniform(50.0, 90.0)),
        oculus=radius * float(draw.uniform(0.05, 0.3)),
        keystone=bool(draw.random() < 0.5),
        bonded=bool(draw.random() < 0.5),
    )


def random_vault(draw: np.random.Generator, aimed: float) -> Make:
    """A barrel or a cross vault."""
    span = float(draw.uniform(2.0, 8.0))
    thickness = span * float(draw.uniform(0.06, 0.12))
    if draw.random() < 0.5:
        pieces = int(draw.integers(1, 5))
        voussoirs = 2 * max(round(aimed / (8.0 * pieces)), 4)
        length = (span + 2.0 * thickness) * float(draw.uniform(1.05, 1.5))
        return partial(
            builders.cross_vault,
            span=span,
            thickness=thickness,
            length=length,
            voussoirs=voussoirs,
            pieces=pieces,
        )
    strips = max(round(np.sqrt(aimed) * float(draw.uniform(0.3, 1.0))), 1)
    return partial(
        builders.barrel_vault,
        span=span,
        rise=span * float(draw.uniform(0.2, 0.5)),
        thickness=thickness,
        length=span * float(draw.uniform(0.3, 2.0)),
        voussoirs=max(round(aimed / strips), 8),
        strips=strips,
        bonded=bool(draw.random() < 0.7),
    )


# ---- rows


def measure(kind: str, name: str, scene: Pushed, law: str, share: float, most: float) -> Row:
    """The row of a scene; its certificate is recomputed with a probability."""
    structure = scene.structure(law == "quick")
    model = structure.face_model()
    blocks = int(structure.number.max()) + 1
    start = time.process_time()

    def in_time() -> None:
        if time.process_time() - start > most:
            raise Stopped(f"more than {most:g} s")

    asked = SEARCH.gap * (1.0 if blocks < MANY else 5.0)
    found = collapse_of(structure, 1.0, asked, in_time)
    row: Row = dict.fromkeys(NAMES, "") | {
        "kind": kind,
        "scene": name,
        "law": law,
        "blocks": blocks,
        "contacts": len(structure.contacts),
        "status": found.status,
        "load_factor": found.load_factor,
        "gap": math.nan if found.gap is None else found.gap,
        "factorizations": found.factorizations,
        "seconds": round(time.process_time() - start, 2),
        "attempts": len(found.attempts),
    }
    drawn = np.random.default_rng(list((name + law).encode())).random()
    if found.status in ("unstable", "unbounded"):
        row["recomputed"] = "right" if no_limit(model) == found.status else "wrong: it has a limit"
    elif found.status == "limit" and drawn < share and model.shape[0] < 12000:
        row["recomputed"] = recomputed(model, found)
    return row


def no_limit(model: FaceModel) -> str:
    """Why there is no limit, by Clarabel within Coulomb's cones: "unstable", "unbounded" or "".

    The dead load has no equilibrium, not the least part of it; or any multiple of the live load
    has one.
    """
    alone = replace(model, live=model.dead, dead=np.zeros_like(model.dead))
    carried, said = cone_limit(alone, model.strength, model.friction)
    if said == "Solved" and carried < 1e-6:
        return "unstable"
    _, said = cone_limit(model, model.strength, model.friction)
    return "unbounded" if said == "DualInfeasible" else ""


def recomputed(model: FaceModel, found: Collapse) -> str:
    """What Clarabel says of a certificate: "right", or what is wrong."""
    force, least = found.force, found.load_factor
    assert force is not None
    normal, shear = model.normal(force), np.linalg.norm(force[:, 1:], axis=1)
    beyond = (shear - model.strength - model.friction * normal).max() / model.force
    missing = np.abs(model.missing(force, least)).max() / model.force
    outside = max(float(beyond), float(-normal.min()) / model.force)
    if missing > 1e-7 or outside > 1e-7:
        return f"wrong: equilibrium misses {missing:.1e}, the cone {outside:.1e}"
    end, said = cone_limit(model, model.own_strength(force), model.dilatancy)
    size = model.size(least)
    most = least + found.gap * size
    if least - 1e-5 * size <= end <= most + 1e-5 * size:
        return "right"
    return f"wrong: {end:.7g} ({said}) is not in {least:.7g} ... {most:.7g}"


def cone_limit(
    model: FaceModel, strength: Array, friction: Array, sign: float = 1.0
) -> tuple[float, str]:
    """The largest load factor of |t| <= strength + friction n by Clarabel, and its status."""
    found = cone_program(model, strength, friction, sign)
    return sign * float(found.x[0]) * model.force / model.load, str(found.status)


def show(row: Row) -> None:
    """Print a row."""
    shown = row | {"load_factor": f"{row['load_factor']:.5g}", "gap": f"{row['gap']:.1e}"}
    print(FORM.format(*(shown[name] for name in NAMES)).rstrip(), flush=True)


def closing(rows: list[Row]) -> Iterator[str]:
    """A line for each law; what is unstable or unbounded has no limit."""
    for law in dict.fromkeys(row["law"] for row in rows):
        of_law = [row for row in rows if row["law"] == law]
        limits = [row for row in of_law if row["status"] not in ("unstable", "unbounded")]
        gap, seconds = (
            np.array([row[name] for row in limits], dtype=float) for name in ("gap", "seconds")
        )
        checked = [row["recomputed"] for row in of_law if row["recomputed"]]
        yield (
            f"{law}: {len(of_law)} scenes, {len(of_law) - len(limits)} without a limit; gap <= 5e-3"
            f" on {np.sum(gap <= 5e-3)}, <= 1e-3 on {np.sum(gap <= 1e-3)} of {len(limits)};"
            f" seconds: median {np.median(seconds):.2f}, most {seconds.max():.1f};"
            f" recomputed {len(checked)}, wrong {sum(one != 'right' for one in checked)}"
        )


def main() -> None:
    """Search the scenes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="*", metavar="PATTERNS", help="scenes, with commas")
    parser.add_argument("--laws", default="quick,lobatto", help="points of contacts")
    parser.add_argument("--count", type=int, default=200, help="number of random scenes")
    parser.add_argument("--largest", type=int, default=10000, help="number of blocks")
    parser.add_argument("--check", type=float, default=0.2, metavar="SHARE", help="recomputed")
    parser.add_argument("--most", type=float, default=300.0, metavar="SECONDS", help="for a row")
    parser.add_argument("--csv", type=Path, default=HOME / "benchmarks/results/spatial.csv")
    options = parser.parse_args()
    print(FORM.format(*(HEADS.get(name, name) for name in NAMES)))
    made: dict[str, Callable[[], tuple[str, str, Pushed]]] = {
        name: partial(tuple, (kind, name, scene)) for kind, name, scene in named_scenes()
    }
    for seed in range(options.count):
        kind = ("wall", "corner", "house", "dome", "vault")[seed % 5]
        made[f"random {seed} {kind}"] = partial(random_scene, seed)
    laws = options.laws.split(",")
    names = matching(made, options.only)
    kept: list[Row] = []
    if options.csv.exists():
        with options.csv.open(newline="") as file:
            old = csv.DictReader(file)
            kept = [row for row in old if row["scene"] not in names or row["law"] not in laws]
    rows: list[Row] = []
    for name in names:
        scene = made[name]()
        if len(scene[2].blocks) > options.largest:
            continue
        for law in laws:
            rows.append(measure(*scene, law, options.check, options.most))
            show(rows[-1])
            save(options.csv, kept + rows)
    if rows:
        print(*closing(rows), sep="\n")


if __name__ == "__main__":
    main()
