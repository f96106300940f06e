"""Brackets of random scenes against the collapse states found in them.

    python3 benchmarks/lower_ends.py --count 1000 --seed 0 [--csv FILE]

The scenes are those of `tests/property/scenes.py`, loaded in both directions. No verified state
may be outside its bracket: `outside` is its distance from there, relative, beyond its own error.
The times are those of the processor, s.
"""

from __future__ import annotations

import argparse
import csv
import gc
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact import limit_load
from fenics_contact.errors import ContactError
from fenics_contact.results.bounds import signed
from fenics_contact.results.result import Collapse
from tests.property.scenes import Draw

NAMES = ("seed", "kind", "blocks", "direction", "status", "load_factor", "frictionless", "lower")
NAMES += ("upper", "meet", "outside", "solve", "bounds")

#: A state is outside its bracket from this relative distance on.
OUTSIDE = 1e-6


def rows(seed: int) -> Iterator[dict[str, Any]]:
    """One row for each direction of a scene, load factors with the sign of their direction."""
    draw = Draw.of_seed(seed)
    scene = draw.recipe().scene(draw.elements)
    scene = replace(scene, solve=replace(scene.solve, direction="both", error=False))
    start = time.process_time()
    about = {"seed": seed, "kind": draw.kind, "blocks": draw.blocks}
    try:
        result = limit_load(scene)
    except ContactError as error:
        yield about | {"status": str(error)[:80]}
        return
    seconds = time.process_time() - start
    for direction, end in result.ends.items():
        end = end if direction == "positive" else signed(end, -1.0)
        yield about | {"direction": direction} | row(end) | {"solve": seconds}


def row(end: Collapse) -> dict[str, Any]:
    """Bracket of a collapse, and how far outside of it the load factor is."""
    start = time.process_time()
    bounds, factor, outside = end.bounds, end.load_factor, 0.0
    seconds = time.process_time() - start
    if end.status == "limit" and end.certificate is not None:
        below = -1.0 if bounds.lower is None else bounds.lower - factor
        above = -1.0 if bounds.upper is None else factor - bounds.upper
        outside = max(below, above) - end.certificate.error_estimate
        outside = max(outside, 0.0) / end.size
    named = {name: getattr(bounds, name) for name in ("frictionless", "lower", "upper", "meet")}
    found = {"status": end.status, "load_factor": factor, "outside": outside}
    return found | named | {"bounds": seconds}


def main() -> int:
    """Run the scenes; exit code 1 if a verified state is outside its bracket."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="number of scenes")
    parser.add_argument("--seed", type=int, default=0, help="of the first one")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there")
    options = parser.parse_args()
    made: list[dict[str, Any]] = []
    for seed in range(options.seed, options.seed + options.count):
        for one in rows(seed):
            made.append(dict.fromkeys(NAMES, "") | one)
            print(" ".join(str(made[-1][name]) for name in NAMES), flush=True)
        gc.collect()
    limits = [one for one in made if one["status"] == "limit"]
    wrong = [one["seed"] for one in limits if one["outside"] > OUTSIDE]
    closed = sum(one["meet"] is True for one in limits)
    better = sum(one["lower"] not in (None, one["frictionless"]) for one in limits)
    print(
        f"{len(limits)} limits, lower end better than no friction in {better}, bracket closed in"
        f" {closed}, states outside: {wrong or 'none'}"
    )
    if options.csv is not None:
        with options.csv.open("w", newline="") as file:
            table = csv.DictWriter(file, NAMES)
            table.writeheader()
            table.writerows(made)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
