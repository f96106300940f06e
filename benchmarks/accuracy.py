"""True error of the load factor against displacements and run time: docs/accuracy.png.

    python3 benchmarks/accuracy.py               # measure (some minutes) and draw
    python3 benchmarks/accuracy.py --draw        # draw what was measured

Uniform meshes are compared with those refined at hinges, with uniform meshes whose hinges are
points by their compliance, with the passes of `solve.accuracy`, and with other programs.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.peers import PEERS, peer  # noqa: E402
from benchmarks.pictures import LOOKS as PEER_LOOKS  # noqa: E402
from benchmarks.scenes import wall_blocks  # noqa: E402
from benchmarks.worker import save  # noqa: E402
from fenics_contact import Load, Scene, compat, limit_load  # noqa: E402
from fenics_contact.geometry.refinement import refine  # noqa: E402
from tests.bank import Recipe, Variant, coulomb, wall_recipe  # noqa: E402

TABLE = ROOT / "benchmarks" / "results" / "accuracy.csv"
PICTURE = ROOT / "docs" / "accuracy.png"
W3, W4 = (wall_recipe(name, coulomb(0.65)) for name in ("W3", "W4"))


@dataclass(frozen=True)
class Case:
    """A scene whose load factor is known.

    Attributes:
        recipe: The scene.
        exact: Its load factor.
        source: Where that comes from.
        wall: Its name for peers, which know no tractions; empty: they are not asked.
    """

    recipe: Recipe
    exact: float
    source: str
    wall: str = ""


CASES = {
    "W4, weight acts sideways": Case(W4, 0.279515, "point hinges, the same on six meshes", "W4"),
    "W3, weight acts sideways": Case(W3, 0.361952, "point hinges, the same on six meshes", "W3"),
    "W4, pushed from the left": Case(
        replace(W4, parts={"live": Load(traction={"left": (1e3, 0.0)})}),
        4.96588,
        "two refined meshes, degree 2, 125 000 displacements: alike to 3e-6",
    ),
}
#: Elements along half a block, by degree.
UNIFORM = {1: (1, 2, 4, 8, 16, 32), 2: (1, 2, 4, 8, 16)}
#: Refinements at hinges.
TIMES = 6
#: Seconds for a peer.
TIME_OUT = 30.0

#: Colour, marker and line of every kind.
LOOKS = {
    "uniform, degree 1": ("#7f7f7f", "o", "-"),
    "uniform, degree 2": ("#7f7f7f", "s", "--"),
    "refined at hinges, degree 2": ("#e67300", "^", "-"),
    "point hinges, degree 1": ("#4aa3df", "o", ":"),
    "point hinges, degree 2": ("#4aa3df", "s", ":"),
    "solve.accuracy = 3e-4": ("#0b3c6f", "D", "-"),
    **{PEER_LOOKS[name][2]: (*PEER_LOOKS[name][:2], ":") for name in PEERS},
}
Row = dict[str, Any]


def at_hinges(scene: Scene, places: np.ndarray) -> Scene:
    """The scene with the cells refined that have a corner at one of the places."""
    domain = scene.mesh.domain
    corners = domain.geometry.x[compat.geometry_dofs(domain)][:, :, None, :2]
    apart = np.linalg.norm(corners - places, axis=3).min(axis=(1, 2), initial=np.inf)
    return replace(scene, mesh=refine(scene.mesh, apart < 1e-9))


def row_of(kind: str, result: Any, seconds: float = 0.0) -> Row:
    """A row for a result, after some seconds that were spent before."""
    count, seconds = result.layout.size, seconds + result.seconds["total"]
    found = {"displacements": count, "load_factor": result.load_factor, "seconds": seconds}
    return {"kind": kind, **found}


def rows_on_meshes(recipe: Recipe) -> Iterator[Row]:
    """Rows of this program."""
    for degree, counts in UNIFORM.items():
        variant = Variant(degree=degree)
        for count in counts:
            plain = limit_load(recipe.scene(count, variant=variant, error=False))
            yield row_of(f"uniform, degree {degree}", plain)
        for count in counts[:3]:
            points = limit_load(recipe.scene(count, variant=variant, error=True, lowest=False))
            found = row_of(f"point hinges, degree {degree}", points)
            yield found | {"load_factor": points.hinges.points}
    scene, seconds = recipe.scene(2, variant=Variant(degree=2), error=False), 0.0
    for _ in range(TIMES):
        result = limit_load(scene)
        yield (row := row_of("refined at hinges, degree 2", result, seconds))
        seconds, joints = row["seconds"], result.layout.joints
        turning = result.positive.joints.hinges(joints.neighbours)
        if not len(turning):
            break
        scene = at_hinges(scene, joints.position[turning])
    result, seconds, before = limit_load(recipe.scene(2, accuracy=3e-4)), 0.0, 0
    for one in result.passes:
        seconds += one.seconds if one.displacements != before else 0.0
        before = one.displacements
        found = {"displacements": before, "load_factor": one.load_factor, "seconds": seconds}
        yield {"kind": "solve.accuracy = 3e-4", **found}


def rows_of_peers(wall: str, earlier: Sequence[Row]) -> Iterator[Row]:
    """Rows of other programs, which have no displacements that could be compared.

    Those of programs that are not there are the earlier ones.
    """
    for name in PEERS if wall else ():
        try:
            for resolution in peer(name).RESOLUTIONS[:2]:
                start = time.perf_counter()
                answer = peer(name).solve(wall_blocks(wall, 0.65), resolution, start + TIME_OUT)
                seconds = time.perf_counter() - start
                yield {"kind": name, "load_factor": answer.load_factor, "seconds": seconds}
        except (ModuleNotFoundError, FileNotFoundError) as missing:
            print(f"{name} is not there: {missing}", flush=True)
            for row in earlier:
                if row["kind"] == name:
                    numbers = {key: float(row[key]) for key in ("load_factor", "seconds")}
                    yield {"kind": name, **numbers}


def measure() -> None:
    """Measure everything and write the table."""
    for degree in (1, 2):  # compiles the forms, and imports what is imported late
        limit_load(W4.scene(1, variant=Variant(degree=degree)))
    rows = []
    with TABLE.open() as file:
        earlier = list(csv.DictReader(file))
    for name, case in CASES.items():
        known = [row for row in earlier if row["case"] == name]
        for found in (rows_on_meshes(case.recipe), rows_of_peers(case.wall, known)):
            for row in found:
                rows.append({"case": name, **row})
                print(
                    *rows[-1].values(), f"{row['load_factor'] / case.exact - 1.0:.1e}", flush=True
                )
                save(TABLE, rows)


def draw() -> None:
    """Draw the table."""
    from matplotlib.figure import Figure

    with TABLE.open() as file:
        rows = list(csv.DictReader(file))
    name_of = {name: PEER_LOOKS[name][2] for name in PEERS}
    figure = Figure(figsize=(10.5, 11.0))
    panels = figure.subplots(3, 2, sharex="col", sharey="row")
    labels: dict[str, Any] = {}
    for line, (name, case) in zip(panels, CASES.items(), strict=True):
        for place, column in zip(line, ("displacements", "seconds"), strict=True):
            for kind, (colour, marker, dashes) in LOOKS.items():
                mine = [row for row in rows if row["case"] == name and row[column]]
                mine = [row for row in mine if name_of.get(row["kind"], row["kind"]) == kind]
                error = [abs(float(row["load_factor"]) / case.exact - 1.0) for row in mine]
                style = {"color": colour, "marker": marker, "ls": dashes, "lw": 1.3, "ms": 5}
                if mine:
                    labels[kind] = place.plot([float(r[column]) for r in mine], error, **style)[0]
            place.axhline(1e-3, color="k", lw=0.8, ls=":")
            place.set(xscale="log", yscale="log")
            place.grid(alpha=0.3)
        line[0].set_ylabel("true error of the load factor (-)")
        line[0].set_title(f"{name}: {case.exact:g}", loc="left", fontsize=11)
        line[1].set_title(f"({case.source})", loc="left", fontsize=9, color="#444444")
    panels[-1][0].set_xlabel("displacements (-)")
    panels[-1][1].set_xlabel("run time, meshes before included (s)")
    shown = [kind for kind in LOOKS if kind in labels]
    figure.legend([labels[kind] for kind in shown], shown, ncol=3, loc="upper center", fontsize=9)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.93))
    figure.savefig(PICTURE, dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draw", action="store_true", help="draw only")
    if not parser.parse_args().draw:
        measure()
    draw()
