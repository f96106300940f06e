"""Walls by the face engine: gaps, factorisations, time, and certificates recomputed by HiGHS.

    python3 benchmarks/face_walls.py [--only "facade*,40x40*"] [--check 0.2] [--drawing]

Every scene is meshed coarsely, since the engine sees faces alone, and searched with the options of
the program. The search is timed, CPU seconds. A certificate says that with the friction forces of
its state nothing carries more than its upper end: HiGHS solves that program again, from the same
forces and nothing else, on a share of the scenes without crushing. `--drawing` draws a facade of
about 1 560 bricks, 10 mm apart, and times `mesh --close` and `solve` from the DXF file.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, diags, hstack, identity, kron, vstack

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import masonry
from benchmarks.scenes import matching
from benchmarks.worker import HOME, save
from fenics_contact import Tie
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.meshing import wall
from fenics_contact.search_options import SEARCH
from tests.bank import (
    FACADE_STONE,
    LEFTWARDS,
    PUSH,
    Recipe,
    coulomb,
    drawn_recipe,
    wall_recipe,
)
from tests.structures import facade, gable, rubble

Array = npt.NDArray[np.float64]
Row = dict[str, Any]
Make = Callable[[], Recipe]
NAMES = (
    *("kind", "scene", "blocks", "faces", "status", "load_factor", "gap"),
    *("factorizations", "seconds", "attempts", "recomputed"),
)
FORM = "{:9} {:38} {:>6} {:>6} {:8} {:>10} {:>8} {:>5} {:>7} {:>3} {}"
HEADS = {"factorizations": "fact.", "seconds": "s", "attempts": "tried"}

CRUSHED = replace(FACADE_STONE, compressive_strength=3e6)
TIES = {f"at {y:g} m": Tie((0.15, y), 5e4, (7.7, y)) for y in (3.6, 5.9)}
WAYS = {"right": PUSH, "left": LEFTWARDS}

#: Structures by name, beside the gable.
DRAWN: dict[str, Callable[[], Any]] = {
    "palazzo": masonry.palazzo,
    "bridge": masonry.three_spans,
    "tower": masonry.tower,
    "rubble": rubble,
    "ashlar 400": partial(masonry.ashlar, 400, 400),
    "ashlar 1000": partial(masonry.ashlar, 1000, 1000),
}

#: A facade of about 1 560 bricks: columns and courses of `tests.mortar.Facade`.
BRICKS = 30, 56


def facade_recipe(friction: float, way: str, kind: str) -> Recipe:
    """The facade of 383 stones."""
    law = coulomb(friction)
    if kind == "cohesion":
        law = replace(law, cohesion=2e4)
    parts: dict[str, Any] = {"live": WAYS[way]}
    parts["materials"] = {"default": CRUSHED if "crushing" in kind else FACADE_STONE}
    if "ties" in kind:
        parts["ties"] = TIES
    return drawn_recipe(facade, law, **parts)


def real(name: str, friction: float, way: str, crushes: bool) -> Recipe:
    """Palazzo, gable, bridge, tower, rubble and ashlar."""
    law = coulomb(friction)
    stone = CRUSHED if crushes else FACADE_STONE
    parts: dict[str, Any] = {"materials": {"default": stone}, "live": WAYS[way]}
    if name == "gable":
        return Recipe(lambda n, quads: wall(gable(14, 20), (0.4, 0.2), n, quads), law, parts)
    if name == "palazzo":
        parts["ties"] = masonry.floor_ties(masonry.palazzo(), 6e4)
    return drawn_recipe(DRAWN[name], law, **parts)


def scenes(walls: int) -> Iterator[tuple[str, str, Make]]:
    """Kind, name and recipe of all scenes; so many random walls."""
    for kind in ("plain", "ties", "cohesion", "crushing", "ties, crushing"):
        for friction in (0.4, 0.6, 0.7, 0.8):
            for way in WAYS:
                name = f"facade {friction:g} {way} {kind}"
                yield "facade", name, partial(facade_recipe, friction, way, kind)
    for name, frictions in (
        ("20x20", (0.6, 0.7, 0.75, 0.8)),
        ("28x28", (0.6, 0.7, 0.75, 0.8)),
        ("40x40", (0.6, *np.linspace(0.7, 0.8, 11))),
        ("60x60", (0.75,)),
    ):
        for friction in frictions:
            yield name, f"{name} {friction:g}", partial(wall_recipe, name, coulomb(friction))
    for name in ("gable", *DRAWN):
        for friction in (0.6, 0.75):
            for way, crushes in (("right", False), ("left", True)):
                title = f"{name} {friction:g} {way}" + " crushing" * crushes
                yield "real", title, partial(real, name, friction, way, crushes)
    for seed in range(walls):
        yield "random", f"random {seed}", partial(masonry.random_recipe, seed)


def measure(kind: str, name: str, make: Make, share: float) -> Row:
    """The row of a scene; its certificate is recomputed with a probability."""
    scene = make().scene(1)
    blocks = scene.mesh.body_count
    with Discretization(scene) as made:
        model = PlanarFaces.of(made).model
    start = time.process_time()
    search = FaceSearch(model, SEARCH.gap if blocks < 10 * SEARCH.large_wall else 5.0 * SEARCH.gap)
    state = search.run()
    row: Row = dict.fromkeys(NAMES, "") | {
        "kind": kind,
        "scene": name,
        "blocks": blocks,
        "faces": model.shape[0],
        "status": "limit",
        "load_factor": np.nan if state is None else state.load_factor,
        "gap": np.inf if state is None else state.gap,
        "factorizations": search.equations.factorizations,
        "seconds": round(time.process_time() - start, 3),
        "attempts": len(search.attempts),
    }
    if state is None or state.load_factor < 0.0:
        row["status"] = "none" if stands(model) else "unstable"
    drawn = np.random.default_rng(list(name.encode())).random()
    if state is not None and drawn < share and not np.any(model.kappa):
        row["recomputed"] = recomputed(model, state)
    return row


def recomputed(model: FaceModel, state: FaceState) -> str:
    """What HiGHS says of a certificate: "right", or what is wrong."""
    typical, size = model.force, model.size(state.load_factor)
    beyond = np.abs(state.force[:, 2]) - model.strength - model.friction * model.normal(state.force)
    missing = np.abs(model.missing(state.force, state.load_factor)).max() / typical
    outside = max(beyond.max(), -state.force[:, :2].min()) / typical
    if missing > 1e-7 or outside > 1e-7:
        return f"wrong: equilibrium misses {missing:.1e}, the cone {outside:.1e}"
    end = program_end(model, model.own_strength(state.force), model.dilatancy, state.sign)
    low, high = sorted((state.load_factor, state.upper))
    within = low - 1e-6 * size <= end <= high + 1e-6 * size
    return "right" if within else f"wrong: {end:.7g} is not in {low:.7g} ... {high:.7g}"


def program_end(model: FaceModel, strength: Array, friction: Array, sign: float = 1.0) -> float:
    """The largest load factor, or the least, of |t| <= strength + friction N; nan if none."""
    units = model.shape[0]
    normal = kron(diags(friction), [[1.0, 1.0, 0.0]])
    shear = kron(identity(units), [[0.0, 0.0, 1.0]])
    above = vstack([shear - normal, -shear - normal])
    typical, unit = model.force, model.force / model.load
    live = csr_matrix(model.live[:, None] / model.load)
    cost = np.zeros(3 * units + 1)
    cost[-1] = -sign
    found = linprog(
        cost,
        hstack([above, csr_matrix((2 * units, 1))]).tocsr(),
        np.concatenate([strength, strength]) / typical,
        hstack([model.transposed, live]).tocsr(),
        -model.dead / typical,
        [(0.0, None), (0.0, None), (None, None)] * units + [(None, None)],
        "highs",
    )
    return np.nan if found.x is None else float(found.x[-1] * unit)


def stands(model: FaceModel) -> bool:
    """Whether the dead load alone has an equilibrium inside the cones, if nothing crushes."""
    alone = replace(model, live=model.dead)  # the whole of it and a multiple of it, -1 at least
    return not program_end(alone, model.strength, model.friction) < -1e-9


def show(row: Row) -> None:
    """Print a row."""
    shown = row | {"load_factor": f"{row['load_factor']:.6g}", "gap": f"{row['gap']:.1e}"}
    print(FORM.format(*(shown[name] for name in NAMES)).rstrip(), flush=True)


def closing(rows: list[Row]) -> Iterator[str]:
    """A line for each kind, and for all; what its dead load fells has no limit."""
    rows = [row for row in rows if row["status"] != "unstable"]
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    for kind in [*kinds, "all"]:
        some = [row for row in rows if kind in (row["kind"], "all")]
        gap, spent, seconds = (
            np.array([row[name] for row in some], dtype=float)
            for name in ("gap", "factorizations", "seconds")
        )
        asked = [
            SEARCH.gap if row["blocks"] < 10 * SEARCH.large_wall else 5.0 * SEARCH.gap
            for row in some
        ]
        checked = [row["recomputed"] for row in some if row["recomputed"]]
        yield (
            f"{kind}: {np.sum(gap <= asked)} of {len(some)} within the gap asked for, largest"
            f" {gap.max():.1e}; factorisations: median {np.median(spent):g}, 90 %"
            f" {np.quantile(spent, 0.9):g}, most {spent.max():g}; seconds: median"
            f" {np.median(seconds):.2f}, most {seconds.max():.2f}; recomputed {len(checked)},"
            f" wrong {sum(one != 'right' for one in checked)}"
        )


# ---- from a drawing


def time_drawing() -> None:
    """CPU seconds of `mesh --close` and `solve` on a drawing of bricks."""
    import ezdxf

    from tests.mortar import Facade

    stones = Facade(*BRICKS).stones()
    document = ezdxf.new()
    document.header["$INSUNITS"] = 4
    for corners, layer in stones:
        points = (np.asarray(corners) * [1e3, 1e3, 1.0]).tolist()
        attributes = {"layer": layer}
        document.modelspace().add_lwpolyline(points, "xyb", close=True, dxfattribs=attributes)
    program = [sys.executable, "-m", "fenics_contact"]
    with tempfile.TemporaryDirectory() as folder:
        document.saveas(Path(folder, "bricks.dxf"))
        drawn = ["mesh", "--close", "bricks.dxf", "-o", "bricks.msh", "--scene", "bricks.toml"]
        for words in (drawn, ["solve", "bricks.toml"]):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            end = subprocess.run([*program, *words], cwd=folder, capture_output=True, text=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            said = [line for line in end.stdout.splitlines() if line.startswith("load factor")]
            print(f"{len(stones)} bricks, {words[0]}: exit {end.returncode}, {spent:.1f} s", *said)


def main() -> None:
    """Search the scenes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="*", metavar="PATTERNS", help="scenes, with commas")
    parser.add_argument("--walls", type=int, default=200, help="number of random walls")
    parser.add_argument("--check", type=float, default=0.2, metavar="SHARE", help="recomputed")
    parser.add_argument("--drawing", action="store_true", help="from a DXF file, too")
    parser.add_argument("--csv", type=Path, default=HOME / "benchmarks/results/face_walls.csv")
    options = parser.parse_args()
    print(FORM.format(*(HEADS.get(name, name) for name in NAMES)))
    made = {name: (kind, name, make) for kind, name, make in scenes(options.walls)}
    rows: list[Row] = []
    for name in matching(made, options.only):
        rows.append(measure(*made[name], options.check))
        show(rows[-1])
        save(options.csv, rows)
    if rows:
        print(*closing(rows), sep="\n")
    if options.drawing:
        time_drawing()


if __name__ == "__main__":
    main()
