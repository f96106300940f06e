"""Lower collapse states of random scenes: what the second opinion finds of them, and its cost.

    python3 benchmarks/lowest_states.py --count 150 --seed 0 [--only 83,136] [--csv FILE]

Every scene of `tests/property/scenes.py` with Coulomb friction is solved twice: with the second
opinion, as by default, and with `states = "lowest"`, whose searches are more. Costs are in units
of one factorisation of the structure: the collapse, and in units of that the second opinion and
the other searches of `states = "lowest"`.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.worker import Worker, save
from fenics_contact import Scene, limit_load
from tests.property.scenes import Draw

Row = dict[str, Any]
NAMES = ("seed", "blocks", "status", "path", "second", "all", "cost", "share", "list", "starts")
COLUMNS = "{:>5} {:>6} {:13} {:>11} {:>11} {:>11} {:>6} {:>6} {:>6} {}"
FORMS = dict.fromkeys(("path", "second", "all"), ".6g") | dict.fromkeys(
    ("cost", "share", "list"), ".2f"
)
#: Load factors that differ by more are those of two states, relative.
APART = 1e-3


def measure(seed: int, most: int) -> Row:
    """The row of one scene with at most so many blocks."""
    draw = Draw.of_seed(seed)
    scene = draw.recipe().scene(draw.elements, fast=False)
    row: Row = {"seed": seed, "blocks": scene.mesh.body_count, "status": "large"}
    if row["blocks"] > most:
        return row
    alone = _spent(scene, lowest=False)
    row |= {"status": alone[0].status, "path": alone[0].load_factor}
    if alone[0].status != "limit":
        return row
    second, states = _spent(scene, lowest=True), _spent(scene, states="lowest")
    lowest = second[0].positive.lowest
    if lowest is None:
        return row | {"status": "given friction"}
    cost = sum(trial.cost for trial in alone[0].positive.attempts)
    factor = lowest.load_factor if lowest.status == "lower" else row["path"]
    return row | {
        "second": factor if lowest.status != "not_known" else math.nan,
        "all": states[0].load_factor,
        "cost": cost,
        "share": (second[1] - alone[1]) / cost,
        "list": (states[1] - alone[1]) / cost,
        "starts": " | ".join(f"{s.load_factor:.5g}: {s.start}" for s in states[0].positive.states),
    }


def _spent(scene: Scene, **options: Any) -> tuple[Any, float]:
    """Result with some options, and the cost of all factorisations."""
    result = limit_load(replace(scene, solve=replace(scene.solve, error=False, **options)))
    return result, result.cost


def show(row: Row) -> None:
    """Print a row."""
    shown = [format(row[name], FORMS.get(name, "")) for name in NAMES]
    print(COLUMNS.format(*shown).rstrip(), flush=True)


def closing(rows: list[Row]) -> str:
    """How many lower states there are, how many of them were found, and the cost."""
    known = [row for row in rows if not math.isnan(row["cost"])]
    size = [max(abs(row["path"]), 1e-3) for row in known]
    low = [row for row, s in zip(known, size, strict=True) if row["all"] < row["path"] - APART * s]
    told = [row for row in known if row["second"] < row["path"] - APART * abs(row["path"])]
    lost = [row for row in known if math.isnan(row["second"])]
    share, ratio = (np.mean([row[name] for row in known] or [0.0]) for name in ("share", "list"))
    return (
        f"{len(known)} scenes; lower states by states = 'lowest': {[r['seed'] for r in low]};"
        f" by the second opinion: {[r['seed'] for r in told]}, not known: {len(lost)};"
        f" cost of the second opinion {share:.2f} of the collapse in the mean, of all states"
        f" {ratio:.1f} times the collapse"
    )


def main() -> None:
    """Run the scenes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="number of scenes")
    parser.add_argument("--seed", type=int, default=0, help="of the first one")
    parser.add_argument("--only", default="", help="these seeds, with commas between")
    parser.add_argument("--most", type=int, default=40, help="blocks at most")
    parser.add_argument("--time-out", type=float, default=120.0, metavar="S", help="per scene")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there too")
    options = parser.parse_args()
    print(COLUMNS.format(*NAMES))
    seeds = range(options.seed, options.seed + options.count)
    rows: list[Row] = []
    worker = Worker()
    for seed in map(int, options.only.split(",")) if options.only else seeds:
        row: Row = dict.fromkeys(NAMES, "") | dict.fromkeys(FORMS, math.nan) | {"seed": seed}
        arguments = {"seed": seed, "most": options.most}
        row |= worker.call("benchmarks.lowest_states:measure", options.time_out, **arguments)
        rows.append(row)
        show(row)
    worker.close()
    print(closing(rows))
    if options.csv:
        save(options.csv, rows)


if __name__ == "__main__":
    main()
