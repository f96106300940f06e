"""Peaks of the loading path of random scenes against load control, and what looking for them costs.

    python3 benchmarks/peaks.py --count 150 --seed 0 [--control]

Every scene with a limit is a row: the load factor of the collapse, the peak or why there is none,
with `--control` the load factors with and without equilibrium from load control, and the cost of
the collapse and of the search in units of one factorisation of the structure.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact import OutputOptions, limit_load
from fenics_contact.answers.peak import find_peak
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.strategy import strategy_of
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.scene import Scene
from tests.property.scenes import Draw

FORM = "{:>6} {:>9} {:>10} {:>10} {:>10} {:>22} {:>6} {:>6}"


def row(scene: Scene, control: bool) -> tuple[str, ...] | None:
    """What is found in a scene, as texts; None without a limit."""
    strategy = strategy_of(scene)
    with Discretization(scene) as made:
        case = LoadCase.of(made, made.bonded(strategy.kind), 1.0, strategy.kind, lambda step: None)
        before = made.effort.spent
        end = find_collapse(case, strategy, scene.solve.tolerance)
        if end.status != "limit" or end.state is None or not case.problem.coulomb:
            return None
        solve, before = made.effort.spent - before, made.effort.spent
        peak = find_peak(case, end, solve)
        cost = (made.effort.spent - before) / solve
    numbers = end.load_factor, peak.load_factor, peak.not_found_at
    path = by_load_control(scene) if control else ""
    return (peak.status, *(f"{x:.6g}" for x in numbers), path, f"{solve:.1f}", f"{cost:.2f}")


def by_load_control(scene: Scene) -> str:
    """Load factors with and without equilibrium as the load factor rises."""
    by_load = replace(scene.solve, control="load", error=False)
    end = limit_load(replace(scene, solve=by_load)).positive
    return "" if end is None or end.path is None else f"{end.path.lower:.6g} {end.path.upper:.6g}"


def main() -> None:
    """Print a row for every scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=150, help="number of scenes")
    parser.add_argument("--seed", type=int, default=0, help="of the first one")
    parser.add_argument("--control", action="store_true", help="compare with load control")
    options = parser.parse_args()
    print(FORM.format("seed", "peak", "collapse", "carried", "not at", "control", "solve", "cost"))
    for seed in range(options.seed, options.seed + options.count):
        draw = Draw.of_seed(seed)
        scene = draw.recipe().scene(draw.elements, fast=False)
        scene = replace(scene, output=OutputOptions(pictures=False))
        if found := row(scene, options.control):
            print(FORM.format(seed, *found), flush=True)


if __name__ == "__main__":
    main()
