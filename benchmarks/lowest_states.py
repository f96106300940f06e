"""Lower collapse states of random scenes: what the second opinion finds of them, and its cost.

    python3 benchmarks/lowest_states.py --count 150 --seed 0 [--only 83,136] [--csv FILE]

Every scene of `tests/property/scenes.py` with Coulomb friction is solved without and with the
second opinion, as by default, which begins at one start, and with `states = "lowest"`, which takes
all starts. `share` and `list` are the CPU times of these searches in units of that of the collapse.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.worker import Worker, save
from fenics_contact import LimitLoad, Scene, limit_load
from tests.property.scenes import Draw

Row = dict[str, Any]
NAMES = ("seed", "blocks", "status", "path", "second", "all", "gap", "share", "list", "starts")
COLUMNS = "{:>5} {:>6} {:13} {:>11} {:>11} {:>11} {:>8} {:>6} {:>6} {}"
FORMS = dict.fromkeys(("path", "second", "all"), ".6g") | {
    "gap": ".0e",
    "share": ".2f",
    "list": ".2f",
}
#: Load factors that differ by more are those of two states, relative.
APART = 2e-3


def measure(seed: int, most: int) -> Row:
    """The row of one scene with at most so many blocks."""
    draw = Draw.of_seed(seed)
    scene = draw.recipe().scene(draw.elements, fast=False)
    row: Row = {"seed": seed, "blocks": scene.mesh.body_count, "status": "large"}
    if row["blocks"] > most:
        return row
    alone, seconds = _timed(scene, lowest=False)
    row |= {"status": alone.status, "path": alone.load_factor}
    if alone.status != "limit":
        return row
    second, with_second = _timed(scene, lowest=True)
    every, with_all = _timed(scene, states="lowest")
    end = every.collapse
    if end.lowest is None:
        return row | {"status": "given friction"}
    found = [second.collapse.lowest, end.lowest]
    factors = [math.nan if one.status == "not_known" else one.load_factor for one in found]
    return row | {
        "second": factors[0],
        "all": factors[1],
        "gap": math.nan if end.lowest.gap is None else end.lowest.gap,
        "share": with_second / seconds - 1.0,
        "list": with_all / seconds - 1.0,
        "starts": " | ".join(f"{one.load_factor:.5g}: {one.start}" for one in end.states),
    }


def _timed(scene: Scene, **options: Any) -> tuple[LimitLoad, float]:
    """Result with some options, and its CPU time, s."""
    given = replace(scene.solve, error=False, peak=False, **options)
    start = time.process_time()
    result = limit_load(replace(scene, solve=given))
    return result, time.process_time() - start


def show(row: Row) -> None:
    """Print a row."""
    shown = [format(row[name], FORMS.get(name, "")) for name in NAMES]
    print(COLUMNS.format(*shown).rstrip(), flush=True)


def closing(rows: list[Row]) -> str:
    """How many lower states there are, how many of them the second opinion finds, and the cost."""
    known = [row for row in rows if not math.isnan(row["share"])]
    lower = {
        name: [row["seed"] for row in known if row["path"] - row[name] > APART * abs(row["path"])]
        for name in ("second", "all")
    }
    lost = sum(math.isnan(row["second"]) for row in known)
    share, ratio = (np.mean([row[name] for row in known] or [0.0]) for name in ("share", "list"))
    return (
        f"{len(known)} scenes; lower states by all starts: {lower['all']}; by the second opinion:"
        f" {lower['second']}, not known: {lost}; CPU of the second opinion {share:.2f} of the"
        f" collapse in the mean, of all starts {ratio:.2f}"
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
