"""How good the error estimate is: estimate over true error, scene by scene, as a table.

    python3 benchmarks/effectivity.py out.csv --jobs 2

The truth is the limit for point hinges on a finer mesh with displacements of degree 2. Changes of
state that are reported, with their load factors, count as found. Scenes whose load factor does not
change from mesh to mesh have no effectivity. Times are CPU times.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections.abc import Iterator, Sequence
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
from fenics_contact import Load, limit_load
from fenics_contact.meshing import buttress, wall
from tests.bank import WEIGHT, Recipe, Variant, coulomb, wall_recipe

#: Elements along half a block on the finer mesh, of degree 2.
FINER = 8
#: True errors below this are none.
NONE = 2e-5
COLUMNS = (
    *("scene", "elements", "degree", "load_factor", "point_hinges", "hinge_error"),
    *("algebraic_error", "estimate", "truth", "true_error", "effectivity", "state_changes"),
    *("solve_seconds", "error_seconds", "cost"),
)


def pushed(recipe: Recipe, **tractions: tuple[float, float]) -> Recipe:
    """A live load by tractions in place of the weight acting sideways."""
    return replace(recipe, parts={**recipe.parts, "live": Load(traction=tractions)})


def loaded(recipe: Recipe, pressure: float) -> Recipe:
    """A dead load on top besides the weight, Pa."""
    dead = replace(WEIGHT, traction={"top": (0.0, -pressure)})
    return replace(recipe, parts={**recipe.parts, "dead": dead})


def scenes() -> Iterator[tuple[str, Recipe]]:
    """Scenes by name."""
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


def row(name: str, elements: int, degree: int, truths: dict[str, float]) -> dict[str, Any]:
    """One scene's line of the table, with the truth if it is known."""
    recipe = dict(scenes())[name]
    found: dict[str, Any] = {"scene": name, "elements": elements, "degree": degree}
    time.perf_counter = time.process_time  # others on this machine do not count
    result = limit_load(recipe.scene(elements, variant=Variant(degree=degree), error=True))
    end = result.positive
    error = end.mesh_error if end is not None else None
    if end is None or error is None:
        return found | {"load_factor": result.status}
    found |= {
        "load_factor": result.load_factor,
        "point_hinges": error.load_factor_point_hinges,
        "hinge_error": error.hinge_error,
        "algebraic_error": error.algebraic_error,
        "estimate": error.estimate,
        "state_changes": len(error.state_changes),
        "solve_seconds": round(result.seconds["solve"], 2),
        "error_seconds": round(result.seconds["error"], 2),
        "cost": round(result.seconds["error"] / result.seconds["solve"], 2),
    }
    truth = truths[name] if name in truths else true_load_factor(recipe)
    true_error = abs(truth - result.load_factor) / abs(result.load_factor)
    found |= {"truth": truth, "true_error": true_error}
    if true_error > NONE:
        hinges = abs(error.load_factor_point_hinges / result.load_factor - 1.0)
        found["effectivity"] = (hinges + error.algebraic_error) / true_error
    return found


def true_load_factor(recipe: Recipe) -> float:
    """Limit for point hinges on the finer mesh; nan if it is not found."""
    finer = limit_load(recipe.scene(FINER, variant=Variant(degree=2), error=True))
    error = finer.positive.mesh_error if finer.positive is not None else None
    return math.nan if error is None else error.load_factor_point_hinges


def known_truths(table: Path | None) -> dict[str, float]:
    """Truths of an earlier table by scene."""
    if table is None:
        return {}
    with table.open() as file:
        return {one["scene"]: float(one["truth"]) for one in csv.DictReader(file) if one["truth"]}


def main() -> None:
    """Write the table, and print what it says in all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path)
    parser.add_argument("--truths", type=Path, help="an earlier table: they take most of the time")
    parser.add_argument("--elements", type=int, default=4)
    parser.add_argument("--degree", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    rows = []
    with (
        ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool,
        options.table.open("w", newline="") as file,
    ):
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        truths = known_truths(options.truths)
        solve = partial(row, elements=options.elements, degree=options.degree, truths=truths)
        for found in pool.map(solve, dict(scenes())):
            rows.append(found)
            table.writerow(found)
            file.flush()
    print_summary(rows)


def print_summary(rows: Sequence[dict[str, Any]]) -> None:
    """Say how many estimates are good, and what they cost."""
    depend = [one for one in rows if one.get("true_error", 0.0) > NONE]
    known = [one for one in depend if not math.isnan(one["effectivity"])]
    good = sum(0.7 <= one["effectivity"] <= 1.5 for one in known)
    low = [r["scene"] for r in known if r["effectivity"] < 0.3 and not r["state_changes"]]
    print(f"{len(depend)} scenes depend on the mesh, {len(known)} of them have an estimate")
    print(f"{good} within 0.7 to 1.5; below 0.3 without a change of state: {low}")
    silent = [r["scene"] for r in depend if r not in known and not r["state_changes"]]
    print(f"no estimate and no change of state: {silent}")
    costs = [one["cost"] for one in rows if "cost" in one]
    print(f"cost in solves: median {median(costs):.2f}, largest {max(costs):.2f}")


if __name__ == "__main__":
    main()
