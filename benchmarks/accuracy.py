"""True error of the load factor of wall W4 against displacements and run time: docs/accuracy.png.

    python3 benchmarks/accuracy.py               # measure (some minutes) and draw
    python3 benchmarks/accuracy.py --draw        # draw what was measured

Meshes refined everywhere are compared with those refined at hinges only, and with what
`solve.accuracy` does: hinges as points, then degree 2 and refinement where it promises most.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from fenics_contact import Load, Scene, limit_load  # noqa: E402
from fenics_contact.analysis.hinges import hinges  # noqa: E402
from fenics_contact.refinement import refine  # noqa: E402
from tests.bank import Recipe, Variant, coulomb, wall_recipe  # noqa: E402

TABLE = ROOT / "benchmarks" / "results" / "accuracy.csv"
PICTURE = ROOT / "docs" / "accuracy.png"
W4 = wall_recipe("W4", coulomb(0.65))


@dataclass(frozen=True)
class Case:
    """A load on wall W4.

    Attributes:
        recipe: The scene.
        exact: Its load factor.
        source: Where that comes from.
    """

    recipe: Recipe
    exact: float
    source: str


CASES = {
    "weight acts sideways": Case(W4, 0.279514, "point hinges, alike from six meshes to 1e-5"),
    "pushed from the left": Case(
        replace(W4, parts={"live": Load(traction={"left": (1e3, 0.0)})}),
        4.9656,
        "degree 2, refined from three meshes, alike to 5e-5",
    ),
}
#: Elements along half a block, by degree.
UNIFORM = {1: (2, 4, 8, 16, 32), 2: (1, 2, 4, 8, 16)}
#: Refinements at hinges.
TIMES = 6

#: Colour, marker and line of every kind of mesh.
LOOKS = {
    "uniform, degree 1": ("#7f7f7f", "o", "-"),
    "uniform, degree 2": ("#7f7f7f", "s", "--"),
    "refined at hinges, degree 1": ("#e67300", "o", "-"),
    "refined at hinges, degree 2": ("#e67300", "s", "--"),
    "solve.accuracy": ("#0b62a4", "D", "-"),
}
Row = dict[str, Any]


def at_hinges(scene: Scene, places: np.ndarray) -> Scene:
    """The scene with the cells refined that have a corner at one of the places."""
    domain = scene.mesh.domain
    table = domain.geometry.dofmap
    corners = np.asarray(getattr(table, "array", table)).reshape(-1, 3)
    apart = domain.geometry.x[corners][:, :, None, :2] - places
    cells = np.linalg.norm(apart, axis=3).min(axis=(1, 2), initial=np.inf) < 1e-9
    return replace(scene, mesh=refine(scene.mesh, cells))


def solved(kind: str, scene: Scene) -> tuple[Row, Any]:
    """A row for one mesh, and its result."""
    start = time.perf_counter()
    result = limit_load(scene)
    seconds = time.perf_counter() - start
    count = result.discretization.size
    row = {"kind": kind, "displacements": count, "load_factor": result.load_factor}
    return row | {"seconds": seconds}, result


def rows_of(recipe: Recipe) -> Iterator[Row]:
    """Rows of all kinds of meshes."""
    for degree, counts in UNIFORM.items():
        variant = Variant(degree=degree)
        for count in counts:
            scene = recipe.scene(count, variant=variant, error=False)
            yield solved(f"uniform, degree {degree}", scene)[0]
        scene, total = recipe.scene(4 // degree, variant=variant, error=False), 0.0
        for _ in range(TIMES):
            row, result = solved(f"refined at hinges, degree {degree}", scene)
            total += row["seconds"]
            yield row | {"seconds": total}
            joints = result.discretization.joints
            turning = hinges(joints, result.positive.joints)
            if not len(turning):
                break
            scene = at_hinges(scene, joints.position[turning])
    result = limit_load(recipe.scene(2, accuracy=3e-4))
    total, before = 0.0, 0
    for one in result.positive.passes:
        total += one.seconds if one.displacements != before else 0.0
        before = one.displacements
        row = {"displacements": before, "load_factor": one.load_factor, "seconds": total}
        yield {"kind": "solve.accuracy", **row}


def measure() -> None:
    """Measure everything and write the table."""
    limit_load(W4.scene(2))  # compiles the forms, and imports what is imported late
    limit_load(W4.scene(1, variant=Variant(degree=2)))
    rows = []
    for name, case in CASES.items():
        for row in rows_of(case.recipe):
            rows.append({"case": name, **row})
            print(*rows[-1].values(), f"{row['load_factor'] / case.exact - 1.0:.1e}", flush=True)
    with TABLE.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def draw() -> None:
    """Draw the table."""
    from matplotlib.figure import Figure

    with TABLE.open() as file:
        rows = list(csv.DictReader(file))
    figure = Figure(figsize=(10.5, 8.0))
    panels = figure.subplots(2, 2, sharex="col", sharey="row")
    for line, (name, case) in zip(panels, CASES.items(), strict=True):
        for place, column in zip(line, ("displacements", "seconds"), strict=True):
            for kind, (colour, marker, dashes) in LOOKS.items():
                mine = [row for row in rows if row["case"] == name and row["kind"] == kind]
                if len(mine) < 2:
                    continue
                error = [abs(float(row["load_factor"]) / case.exact - 1.0) for row in mine]
                style = {"color": colour, "marker": marker, "ls": dashes, "lw": 1.5}
                label = kind if place is panels[0][0] else None
                place.plot([float(row[column]) for row in mine], error, label=label, **style)
            place.axhline(1e-3, color="k", lw=0.8, ls=":")
            place.set(xscale="log", yscale="log")
            place.grid(alpha=0.3)
        line[0].set_ylabel("true error of the load factor (-)")
        line[0].set_title(f"W4, {name}: {case.exact:g}", loc="left", fontsize=11)
        line[1].set_title(f"({case.source})", loc="left", fontsize=9, color="#444444")
    panels[1][0].set_xlabel("displacements (-)")
    panels[1][1].set_xlabel("run time, passes before included (s)")
    figure.legend(ncol=3, loc="upper center", fontsize=10)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.92))
    figure.savefig(PICTURE, dpi=120)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draw", action="store_true", help="draw only")
    if not parser.parse_args().draw:
        measure()
    draw()
