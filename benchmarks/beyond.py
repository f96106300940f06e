"""Ways after the peak: load factors by hand, and ends by three sizes of steps, as tables.

    python3 benchmarks/beyond.py [hand | steps] [NAME ...]

The first one has the largest error of the load factor along a way that is known by hand, the second
one the displacement at its end for steps of a size, of half and of a quarter of it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact.geometry import builders
from fenics_contact.motion import beyond as following
from fenics_contact.spatial import Scene
from fenics_contact.spatial.limit import collapse_of
from meshes.make_meshes import WALLS
from tests.motion.closed import CASES, spread
from tests.motion.structures import arch, box, in_plane, in_space

#: Spread at which a semicircle falls, % of its span, by thickness over radius: three-hinge arch.
SPREAD = {0.12: 1.675, 0.15: 7.012, 0.2: 13.472}


def standing(blocks: list[Any], friction: float, **tables: Any) -> Scene:
    """Blocks on ground."""
    low, left, right = min(y for b in blocks for _, y in b), *_sides(blocks)
    ground = box(left - 4.0, low - 0.5, right + 4.0, low)
    return in_plane([*blocks, ground], fixed=[len(blocks)], friction=friction, **tables)


def _sides(blocks: list[Any]) -> tuple[float, float]:
    every = [x for block in blocks for x, _ in block]
    return min(every), max(every)


def wall(name: str) -> Scene:
    """A wall in bond."""
    bricks = []
    for row, course in enumerate(WALLS[name]):
        x = 0.0
        for length in course:
            if length > 0:
                bricks.append(box(x, 0.175 * row, x + 0.4 * length, 0.175 * (row + 1)))
            x += 0.4 * abs(length)
    return standing(bricks, 0.65)


def facade() -> Scene:
    """Two storeys and two bays, 148 blocks."""
    drawn = builders.facade(storeys=2, bays=2, opening=(1.0, 1.25), pier=1.0, block=(0.5, 0.25))
    return standing([block.tolist() for block in drawn.blocks], 0.6)


def held_by_a_tie() -> Scene:
    """A wall of two storeys in courses, with a tie at its floor."""
    courses = [box(0, 0.25 * k, 0.5, 0.25 * (k + 1)) for k in range(24)]
    tie = {"from": [0.0, 2.9], "ground": [-4.0, 2.9], "yield": 8e3, "stiffness": 1e6}
    return standing(courses, 0.7, ties={"tie": tie})


def built(builder: str, push: tuple[float, ...], friction: float = 0.6, **shape: Any) -> Scene:
    """A structure of a builder in space."""
    return in_space({"builder": builder, **shape}, push, friction=friction)


BRICK = {"thickness": 0.4, "brick": [0.6, 0.4]}
STRUCTURES: dict[str, Callable[[], Scene]] = {
    **{name.upper(): (lambda name=name: wall(name)) for name in WALLS},
    "arch of 15": lambda: in_plane(arch(15, 0.15), fixed=[15, 16], friction=1.0, density=2400.0),
    "buttress of 8": lambda: standing(
        [box(0, 0.5 * k, 1.2 - 0.1 * k, 0.5 * (k + 1)) for k in range(8)], 0.6
    ),
    "facade of 148": facade,
    "tower of 40 courses": lambda: standing(
        [box(0.01 * k, 0.25 * k, 2.0 - 0.01 * k, 0.25 * (k + 1)) for k in range(40)], 0.6
    ),
    "gate": lambda: standing(
        [box(x, 0.4 * k, x + 0.6, 0.4 * (k + 1)) for x in (0, 2.0) for k in range(6)]
        + [box(-0.1, 2.4, 2.7, 2.8), box(0.2, 2.8, 2.4, 3.2)],
        0.6,
    ),
    "wall of 2 storeys with a tie": held_by_a_tie,
    "facade with side walls": lambda: built(
        "facade", (0, -1, 0), length=3.0, side=1.5, height=2.4, **BRICK
    ),
    "corner": lambda: built(
        "corner", (-(2**-0.5), -(2**-0.5), 0), length_x=2.0, length_y=2.0, height=2.4, **BRICK
    ),
    "barrel vault": lambda: built(
        "barrel_vault",
        (1, 0, 0),
        0.7,
        span=2.0,
        rise=1.0,
        thickness=0.2,
        length=1.0,
        voussoirs=13,
        strips=2,
        bonded=True,
    ),
    "house": lambda: built(
        "house", (0, -1, 0), length=6.0, width=4.0, height=3.0, thickness=0.5, brick=[0.6, 0.3]
    ),
}


def by_hand(names: list[str]) -> None:
    """Print ways that are known by hand."""
    print(
        "| way | largest error of the load factor | end | points | CPU, s |\n|---|---|---|---|---|"
    )
    for name in names or CASES:
        start = time.process_time()
        found, off = CASES[name]()
        cpu = time.process_time() - start
        end = f"{found.fine.why}, {found.end:.4g} m"
        print(f"| {name} | {max(off):.0e} | {end} | {len(off)} | {cpu:.1f} |", flush=True)
    for thickness, end in SPREAD.items() if not names else ():
        found, _ = spread(30, thickness)
        off = abs(100.0 * found.end - end)
        print(f"| semicircle, t/R = {thickness} | {100 * found.end:.3f} % | {end} % | {off:.0e} |")


def by_steps(names: list[str]) -> None:
    """Print ends for steps of a size, of half and of a quarter of it."""
    print("| structure | blocks | first | ends, m | energy | overlap, m | CPU, s, of two |")
    print("|---|---|---|---|---|---|---|")
    first = following.FIRST
    for name in names or STRUCTURES:
        structure = STRUCTURES[name]().structure()
        collapse = collapse_of(structure)
        ends, cpu = [], []
        for part in (1.0, 0.5):
            following.FIRST = part * first
            start = time.process_time()
            found = following.beyond(structure, collapse)
            cpu.append(time.process_time() - start)
            if found is None:
                continue
            both = [found.coarse, found.fine] if part == 1.0 else [found.fine]
            ends += [f"{one.points[-1].displacement:.5g} ({one.why})" for one in both]
            worst = [max(getattr(one, key) for one in both) for key in ("energy", "overlap")]
            told = [f"{collapse.load_factor:.5f}", *(f"{value:.0e}" for value in worst)]
        blocks = int((structure.number >= 0).sum())
        cells = [name, str(blocks), told[0], ", ".join(ends), *told[1:], f"{cpu[0]:.1f}"]
        print(f"| {' | '.join(cells)} |", flush=True)
    following.FIRST = first


if __name__ == "__main__":
    kind, *chosen = sys.argv[1:] or ["hand"]
    {"hand": by_hand, "steps": by_steps}[kind](chosen)
