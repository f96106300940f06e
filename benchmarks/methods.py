"""The methods against each other: load factors, iterations, factorisations and times.

    python3 benchmarks/methods.py [--only PATTERN] [--methods a,b] [--repeat N] [--csv FILE]

One row per scene and method. Load factors are compared with the linear program of rigid blocks for
given friction and for arches, where friction is more than hinges need; with the closed form for the
wedge; and with the method "fixed-point" for walls with Coulomb friction, whose load factors are not
unique: a verified one that differs may be another state.
"""

from __future__ import annotations

import argparse
import csv
import fnmatch
import gc
import math
import re
import statistics
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from functools import cache, partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.stability import Process, number, relative_error, worst_residual
from fenics_contact import JointLaw, Scene, SolveOptions, limit_load
from fenics_contact.scene import METHODS
from tests.regression.scenes import WALLS, arch_scene, wall_scene, wedge_scene

#: References that are computed: the upper bound of the rigid-block programs, the method.
PROGRAM, FIXED_POINT = "program", "fixed-point"

#: Options of a method alone.
PLAIN: Sequence[Mapping[str, str]] = tuple({"method": method} for method in METHODS)

#: Continuation in the load factor, with slip from the step before, and several states.
BY_LOAD = {"method": "auto", "control": "load"}
BY_STEPS = {**BY_LOAD, "slip": "load-steps"}
LOWEST = {"method": "auto", "states": "lowest"}

#: Seconds that one solve may take.
TIME_OUT = 300.0


@dataclass(frozen=True)
class Case:
    """A scene, what it is compared with, and how it is solved."""

    scene: str
    law: str
    make: Callable[[], Scene]
    reference: float | str
    options: Sequence[Mapping[str, str]] = PLAIN


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    scene: str
    law: str
    method: str
    status: str
    load_factor: float = math.nan
    difference: float = math.nan
    iterations: int = 0
    factorizations: int = 0
    seconds: float = math.nan
    gap: float = math.nan
    residual: str = "-"
    program: float = math.nan
    states: tuple[tuple[str, str, float], ...] = ()


def all_cases() -> Iterator[Case]:
    """Every scene, in the order of the table."""
    for name in WALLS:
        for strength in (500.0, 2000.0, 8000.0):
            make = partial(wall_scene, name, JointLaw("tresca", bound=strength))
            options = (*PLAIN, BY_LOAD) if strength == 2000.0 else PLAIN
            yield Case(name, f"{strength / 1e3:g} kPa", make, PROGRAM, options)
    for name in WALLS:
        make = partial(wall_scene, name, JointLaw("coulomb", 0.65))
        more = (BY_LOAD, BY_STEPS) if name in ("W2", "W4") else (BY_LOAD,)
        yield Case(name, "F=0.65", make, FIXED_POINT, (*PLAIN, *more))
    make = partial(wall_scene, "W1", JointLaw("coulomb", 1.0))
    yield Case("W1", "F=1", make, math.nan, (LOWEST,))
    for friction, exact in ((0.1, 0.1549061349), (0.2, 0.4264946007), (0.3, 0.9340306116)):
        yield Case("wedge", f"F={friction}", partial(wedge_scene, friction), exact)
    for thickness in (0.15, 0.2):
        for voussoirs in (7, 15, 27, 51):
            name = f"arch {voussoirs} t/R={thickness:.2f}"
            options = PLAIN if voussoirs < 51 else PLAIN[:1]
            if (voussoirs, thickness) != (51, 0.2):
                yield Case(name, "F=1", partial(arch_scene, voussoirs, thickness), PROGRAM, options)


def named(options: Mapping[str, str]) -> str:
    """Options in words."""
    return ", ".join(options.values())


@cache
def warm() -> None:
    """Load everything that the first solve needs."""
    limit_load(wall_scene("2x2", JointLaw("coulomb", 0.5)))


def solve(task: tuple[str, str, Mapping[str, str], int]) -> Row:
    """Solve a scene with a law and options, several times."""
    scene, law, options, repeat = task
    warm()
    case = next(case for case in all_cases() if (case.scene, case.law) == (scene, law))
    seconds = []
    for _ in range(repeat):
        try:
            result = limit_load(replace(case.make(), solve=SolveOptions(**options)))
        except Exception as error:  # one row must not stop the table
            print(f"{scene} {law} {named(options)}: {error}", file=sys.stderr)
            return Row(scene, law, named(options), type(error).__name__)
        seconds.append(result.seconds["total"])
        collapse, bounds = result.positive, result.bounds
        row = Row(scene, law, named(options), result.status, result.load_factor)
        if collapse is not None:
            row = replace(
                row,
                iterations=sum(len(history.steps) for history in collapse.history),
                states=tuple((s.start, s.status, s.load_factor) for s in collapse.states),
                program=math.nan if bounds is None else bounds.upper,
            )
            if collapse.certificate is not None:
                gap, residuals = collapse.certificate.gap, collapse.certificate.residuals
                row = replace(row, gap=gap, residual=worst_residual(residuals))
        row = replace(row, factorizations=result.factorizations)
        result.structure.destroy()
        gc.collect()
    return replace(row, seconds=statistics.median(seconds))


class Table:
    """Solves row by row, each in a process that may not take too long."""

    def __init__(self, time_out: float, repeat: int) -> None:
        self.time_out = time_out
        self.repeat = repeat
        self.process = Process(solve)
        self.known: dict[tuple[str, str, str], Row] = {}

    def row(self, case: Case, options: Mapping[str, str]) -> Row:
        """A row with its difference to the reference."""
        row = self._solved(case, options)
        if isinstance(case.reference, float):
            reference = case.reference
        elif case.reference == PROGRAM:
            reference = row.program
        else:
            found = self._solved(case, {"method": case.reference})
            reference = found.load_factor if found.status == "limit" else math.nan
        return replace(row, difference=relative_error(row.load_factor, reference, 0.0))

    def _solved(self, case: Case, options: Mapping[str, str]) -> Row:
        key = case.scene, case.law, named(options)
        if key not in self.known:
            task = case.scene, case.law, options, self.repeat
            row = self.process.run(task, self.repeat * self.time_out)
            self.known[key] = Row(*key, row) if isinstance(row, str) else row
        return self.known[key]


COLUMNS = "{:16} {:8} {:22} {:13} {:>12} {:>9} {:>5} {:>5} {:>7} {:>8} {}"


def line(row: Row) -> str:
    """A row of the table."""
    return COLUMNS.format(
        row.scene,
        row.law,
        row.method,
        row.status,
        number(row.load_factor, ".8f"),
        number(row.difference, ".1e"),
        row.iterations,
        row.factorizations,
        number(row.seconds, ".2f"),
        number(row.gap, ".1e"),
        row.residual,
    )


def main() -> int:
    """Run the table; exit code 1 if a row is not a limit load."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="*", metavar="PATTERN", help="scene and law hold it")
    parser.add_argument("--methods", metavar="A,B", help="these alone, without the extra rows")
    parser.add_argument("--repeat", type=int, default=1, metavar="N", help="median time of N runs")
    parser.add_argument("--time-out", type=float, default=TIME_OUT, metavar="S", help="per solve")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there too")
    choice = parser.parse_args()
    wanted = None if choice.methods is None else choice.methods.split(",")
    for method in wanted or ():
        SolveOptions(method=method)
    match = re.compile(fnmatch.translate(f"*{choice.only}*"), re.IGNORECASE).match
    head = ("scene", "law", "method", "status", "load factor", "diff.", "iter", "fact", "s")
    print(COLUMNS.format(*head, "gap", "worst residual"))
    table, rows = Table(choice.time_out, choice.repeat), []
    for case in all_cases():
        for options in case.options if match(f"{case.scene} {case.law}") else ():
            if wanted is not None and named(options) not in wanted:
                continue
            rows.append(table.row(case, options))
            print(line(rows[-1]), flush=True)
            for start, status, factor in rows[-1].states:
                print(f"{'':24} from {start:20} {status:10} {factor:.8f}")
    table.process.stop()
    if choice.csv:
        names = [field.name for field in fields(Row) if field.name not in ("program", "states")]
        with choice.csv.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(names)
            writer.writerows(astuple(row)[: len(names)] for row in rows)
    return 0 if all(row.status == "limit" for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
