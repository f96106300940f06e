"""What load factors owe to the mesh: what is said of it, and what meshes show.

    python3 benchmarks/effectivity.py benchmarks/results/effectivity.csv
    python3 benchmarks/effectivity.py benchmarks/results/effectivity.csv --accuracy 1e-3

For walls and for random scenes outside the bank: the range of the mechanism and the load factor
for point hinges from a coarse mesh, against load factors of degrees 1 and 2 on that mesh and finer
ones, and against point hinges on half the element size with degree 2, the truth. With `--accuracy`
walls of that table are solved to an accuracy, and compared with the truth.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.scenes import opening_courses
from fenics_contact import Load, Scene, limit_load
from fenics_contact.meshing import buttress, wall
from tests.bank import PLAIN, WEIGHT, Recipe, Variant, coulomb, wall_recipe
from tests.property.scenes import Draw

#: Walls; first seed of the random scenes, and how many with a limit load are taken.
WALLS, FIRST_SEED, RANDOM = 80, 3000, 80
#: True changes below this part of the load factor are none.
NONE = 1e-4
#: By how much load factors of meshes may be outside the range: their tolerance.
OUTSIDE = 1e-5
#: W3 under its weight: from graded meshes at friction 0.65.
W3 = 0.36195
#: Meshes that are compared, in elements of the coarse one, and degrees.
FINER = ((1, 2), (2, 1), (2, 2), (4, 1))
COLUMNS = (
    *("scene", "load_factor", "lower", "upper", "physical", "points", "truth", "least", "largest"),
    *("cost", "seconds", "reason"),
)


def pushed(recipe: Recipe, **tractions: tuple[float, float]) -> Recipe:
    """A live load by tractions in place of the weight acting sideways."""
    return replace(recipe, parts={**recipe.parts, "live": Load(traction=tractions)})


def loaded(recipe: Recipe, pressure: float) -> Recipe:
    """A dead load on top besides the weight, Pa."""
    dead = replace(WEIGHT, traction={"top": (0.0, -pressure)})
    return replace(recipe, parts={**recipe.parts, "dead": dead})


def scenes() -> Iterator[tuple[str, Recipe]]:
    """Walls by name."""
    for name, friction in product(("W3", "W4"), (0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8)):
        recipe = wall_recipe(name, coulomb(friction))
        yield f"{name} {friction:g}", recipe
        yield f"{name} side traction {friction:g}", pushed(recipe, left=(1e3, 0.0))
        yield f"{name} loaded on top {friction:g}", loaded(recipe, 2e4)
    for friction, courses in product((0.5, 0.7), (4, 5, 6)):
        draw = partial(_buttress, courses)
        yield f"buttress {courses} {friction:g}", Recipe(draw, coulomb(friction))
    for friction in (0.5, 0.6, 0.7):
        yield f"stepped buttress {friction:g}", Recipe(_stepped, coulomb(friction))
    for seed in (0, 2, 5, *range(10, 24)):
        friction = (0.5, 0.65, 0.8)[seed % 3]
        draw = partial(_opening, seed)
        yield f"openings {seed} {friction:g}", Recipe(draw, coulomb(friction))


def _buttress(courses: int, elements: int, quadrilaterals: bool) -> Any:
    return buttress(courses, 1.0, 1.5, 0.5, 0.5 / elements, quadrilaterals)


def _stepped(elements: int, quadrilaterals: bool) -> Any:
    """Five courses of square blocks, each half a block shorter than that below."""
    courses = [[1, 1, 1], [-0.25, 0.5, 1, 1], [-0.5, 1, 1], [-0.75, 0.5, 1], [-1, 1]]
    return wall(courses, (0.4, 0.4), elements, quadrilaterals)


def _opening(seed: int, elements: int, quadrilaterals: bool) -> Any:
    return wall(opening_courses(seed), (0.4, 0.175), elements, quadrilaterals)


def scene_of(name: str, elements: int, variant: Variant = PLAIN, **options: Any) -> Scene:
    """A scene by its name, with so many elements along half a block of walls."""
    options = {"lowest": False, "fast": False, **options}
    if not name.startswith("random"):
        return dict(scenes())[name].scene(elements, variant=variant, **options)
    draw = Draw.of_seed(int(name.split()[1]))
    return draw.recipe().scene(elements * draw.elements, variant=variant, **options)


def row(name: str, elements: int, finer: bool) -> dict[str, Any]:
    """One scene's line of the table; without load factors where it has no limit."""
    time.perf_counter = time.process_time  # others on this machine do not count
    elements = 1 if name.startswith("random") else elements
    result = limit_load(scene_of(name, elements)).with_brackets()
    end = result.positive
    if end is None or end.status != "limit" or end.engine != "path" or end.hinges is None:
        return {"scene": name}
    seconds = result.seconds
    found = {"scene": name, "load_factor": end.load_factor, "reason": end.hinges.reason}
    found |= {"lower": end.range.lower, "upper": end.range.upper}
    found |= {"physical": end.hinges.physical, "points": end.hinges.points}
    found["seconds"] = (seconds["error"] + seconds["range"]) / seconds["solve"]
    alone = limit_load(scene_of(name, elements, error=False)).cost
    found["cost"] = (result.cost - alone) / alone
    factors = [end.load_factor]
    for times, degree in FINER if finer else ():
        asked = (times, degree) == (2, 2)
        variant = Variant(degree=degree)
        other = limit_load(scene_of(name, times * elements, variant, error=asked)).positive
        if other is not None and other.status == "limit":
            factors.append(other.load_factor)
            if asked and other.hinges is not None:
                found["truth"] = other.hinges.points
    if name.startswith("W3 0") and name != "W3 0.4":  # finer meshes of degree 2 do not find it
        found["truth"] = W3
    return found | {"least": min(factors), "largest": max(factors)}


def print_accuracy(table: Path, elements: int, accuracy: float) -> None:
    """Solve walls of a table to an accuracy, and say by how much their load factors are off."""
    with table.open() as file:
        rows = [one for one in csv.DictReader(file) if one["truth"] not in ("", "nan")]
    for one in rows:
        if not one["scene"].startswith("random"):
            result = limit_load(scene_of(one["scene"], elements, accuracy=accuracy))
            off = abs(result.load_factor / float(one["truth"]) - 1.0)
            said = "NOT REACHED" if result.inaccurate else "kept" if off <= accuracy else "BROKEN"
            size = result.layout.size
            print(f"{one['scene']}: {off:.1e} with {size} displacements, {said}", flush=True)


def print_summary(kind: str, rows: list[dict[str, Any]]) -> None:
    """Say how much is known, right, and contained in the ranges, and what it costs."""

    def change(one: dict[str, Any], key: str) -> float:
        value = one.get(key)
        return math.nan if value is None else abs(value / one["load_factor"] - 1.0)

    known = [one for one in rows if not math.isnan(one["points"]) and one["lower"] is not None]
    depend = [one for one in rows if change(one, "truth") > NONE]
    right = [one for one in depend if 0.5 <= change(one, "points") / change(one, "truth") <= 2.0]
    missed = [one["scene"] for one in depend if one not in right]
    outside = [
        f"{one['scene']} {one['least']:.6g} {one['largest']:.6g}"
        for one in rows
        if one["lower"] is not None
        and not (
            one["lower"] - OUTSIDE * abs(one["lower"]) <= one["least"]
            and one["largest"] <= one["upper"] + OUTSIDE * abs(one["upper"])
        )
    ]
    print(f"{kind}: {len(rows)} with a limit load, {len(known)} known")
    print(
        f"  {len(depend)} depend on the mesh, {len(right)} right within a factor 2; not: {missed}"
    )
    print(f"  load factors of meshes outside the range: {outside}")
    for key, unit in (("cost", "factorisations"), ("seconds", "CPU time")):
        parts = [one[key] for one in rows]
        print(f"  {unit} over those of the solve: median {median(parts):.2f}, max {max(parts):.2f}")
    for one in rows:
        if one not in known:
            print(f"  not known: {one['scene']}: {one['reason']}")


def main() -> None:
    """Write the table, and print what it says in all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path)
    parser.add_argument("--elements", type=int, default=2, help="of walls, along half a block")
    parser.add_argument("--coarse", action="store_true", help="no finer meshes: no truth")
    parser.add_argument("--every", type=int, default=1, help="only one of so many scenes")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--accuracy", type=float, help="solve walls of the table to this")
    options = parser.parse_args()
    if options.accuracy:
        print_accuracy(options.table, options.elements, options.accuracy)
        return
    solve = partial(row, elements=options.elements, finer=not options.coarse)
    random = (f"random {seed}" for seed in range(FIRST_SEED, FIRST_SEED + 2 * RANDOM))
    with (
        ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool,
        options.table.open("w", newline="") as file,
    ):
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        for kind, names, most in (("walls", dict(scenes()), WALLS), ("random", random, RANDOM)):
            rows: list[dict[str, Any]] = []
            for found in pool.map(solve, list(names)[:: options.every]):
                if "load_factor" in found and len(rows) < most:
                    rows.append(found)
                    table.writerow(found)
                    file.flush()
            print_summary(kind, rows)


if __name__ == "__main__":
    main()
