"""Random scenes of many kinds, each solved, and judged by independent programs of rigid blocks.

    python3 benchmarks/random_scenes.py --count 1000 --seed 0 [--jobs 2] [--csv FILE]

The scenes are those of `tests/property/scenes.py`, numbered by their seeds: `--seed 17 --count 1`
runs one of them again. Written files are read again and checked block by block. Verdicts:

    ok             limit, unbounded or unstable, as the independent programs and files say
    WRONG          they say something else
    not proved     "unstable" where the dead load stands with associative friction
    not converged  no verified state
    traceback      an exception
    time-out       longer than --time-out

The cost is the run time over that of one bonded solve: assemble, analyse, factor and solve with
all joints closed.
"""

from __future__ import annotations

import argparse
import gc
import math
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.worker import Worker, save
from fenics_contact import OutputOptions, limit_load
from tests.property.independent import STATUSES, UNPROVED, faults, read, written_faults
from tests.property.scenes import Draw

Row = dict[str, Any]

VERDICTS = ("ok", "WRONG", "not proved", "not converged", "traceback", "time-out")

#: Bonded solves above which a scene counts as dear, and how many of the dearest are listed.
DEAR, LISTED = 100.0, 10

COLUMNS = "{:>6} {:15} {:>6} {:>8} {:13} {:>13} {:>8} {:>7} {:>9} {:13} {}"
FORMS = {"load_factor": ".6g", "seconds": ".2f", "cost": ".1f"}
NAMES = (
    *("seed", "kind", "blocks", "elements", "status", "load_factor", "seconds", "cost"),
    *("factoris.", "verdict", "why"),
)


def measure(seed: int) -> Row:
    """The row of one scene."""
    draw = Draw.of_seed(seed)
    row: Row = asdict(draw)
    try:
        return row | solved(draw)
    except Exception as error:  # an exception is what this program looks for
        return row | {"status": "traceback", "why": f"{type(error).__name__}: {error}"}


def solved(draw: Draw) -> Row:
    """What a scene's solution is and costs, and what is wrong with it."""
    gc.collect()
    scene = replace(
        draw.recipe().scene(draw.elements, fast=False), output=OutputOptions(pictures=False)
    )
    blocks, result = read(scene), limit_load(scene)
    seconds = result.seconds["total"]
    why = faults(blocks, result.status, result.load_factor)
    if result.status == "limit":
        with tempfile.TemporaryDirectory() as folder:
            result.write(folder)  # which holds it against its own bracket as well
            # Displacements of the face engine are those of blocks under its forces: no joint law.
            if result.status == "limit" and result.collapse.engine == "path":
                why += written_faults(blocks, Path(folder), result.load_factor)
    return {
        "blocks": len(blocks.centre),
        "status": result.status,
        "load_factor": result.load_factor,
        "seconds": seconds,
        "cost": seconds / result.seconds.get("bonded", math.nan),
        "factoris.": result.factorizations,
        "why": "; ".join(why),
    }


def verdict(row: Row) -> str:
    """What to think of a row."""
    status, why = row["status"], row.get("why", "")
    if status == "time-out":
        return status
    if status not in STATUSES:
        return "traceback"
    if why:
        return "not proved" if why == UNPROVED else "WRONG"
    return "not converged" if status == "not_converged" else "ok"


def rows_of(seeds: Sequence[int], jobs: int, time_out: float) -> list[Row]:
    """Rows of all seeds, shown as they come, from some processes."""
    own = threading.local()
    workers: list[Worker] = []

    def row_of(seed: int) -> Row:
        if not hasattr(own, "worker"):
            own.worker = Worker()
            workers.append(own.worker)
        blank: Row = {**dict.fromkeys(NAMES, ""), **asdict(Draw.of_seed(seed))}
        row = blank | dict.fromkeys(FORMS, math.nan)
        row |= own.worker.call("benchmarks.random_scenes:measure", time_out, seed=seed)
        row["verdict"] = verdict(row)
        show(row)
        return row

    with ThreadPoolExecutor(jobs) as pool:
        rows = list(pool.map(row_of, seeds))
    for worker in workers:
        worker.close()
    return rows


def show(row: Row) -> None:
    """Print a row."""
    shown = [format(row[name], FORMS.get(name, "")) for name in NAMES]
    print(COLUMNS.format(*shown).rstrip(), flush=True)


def closing(rows: Sequence[Row]) -> str:
    """The shares of verdicts and of dear scenes."""
    counts, total = Counter(row["verdict"] for row in rows), len(rows)
    dear = sum(row["cost"] > DEAR for row in rows)
    shares = [f"{counts[name]} {name} ({counts[name] / total:.1%})" for name in VERDICTS]
    return f"{', '.join(shares)}; {dear / total:.1%} over {DEAR:g} bonded solves; of {total}"


def main() -> int:
    """Run the scenes; exit code 1 if one is wrong or ends in a traceback."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="number of scenes")
    parser.add_argument("--seed", type=int, default=0, help="of the first one")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--time-out", type=float, default=60.0, metavar="S", help="per scene")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there too")
    options = parser.parse_args()
    print(COLUMNS.format(*NAMES))
    seeds = range(options.seed, options.seed + options.count)
    rows = rows_of(seeds, options.jobs, options.time_out)
    print("\nthe dearest:")
    known = [row for row in rows if not math.isnan(row["cost"])]
    for row in sorted(known, key=lambda row: -row["cost"])[:LISTED]:
        show(row)
    print(closing(rows))
    if options.csv:
        save(options.csv, rows)
    return int(any(row["verdict"] in ("WRONG", "traceback") for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
