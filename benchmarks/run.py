"""Run times: named cases, methods, tolerances and numbers of ranks, a row per run in a CSV file.

    python3 benchmarks/run.py [--only PATTERN] [--elements 1,2] [--methods a,b] [--ranks 1,2]
        [--repeat 3] [--tolerances 1e-3,1e-6] [--time-out 600] [--csv FILE] [--list]

Every run has a process of its own (or several, by mpirun), in which a small scene of the same kind
is solved first, so that no time is for compiling forms or loading libraries. The mesh is there
before the clock starts. Methods take turns, so that a slow moment of the machine is not one
method's alone. A row is written as soon as its run ends; benchmarks/report.py draws them.

A row counts if its load factor is verified. Errors are relative to a reference: the closed form for
the wedge; the linear program of rigid blocks for arches, where friction is more than hinges need;
for walls, on the same mesh, the verified load factor of "fixed-point" to 1e-10 (of "auto" where
that takes too long), once more relative to the finest mesh of the same wall. With Coulomb friction
load factors are not unique: a verified one that differs may be another collapse state.
"""

from __future__ import annotations

import argparse
import csv
import fnmatch
import gc
import json
import math
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import scipy

from benchmarks.stability import number, relative_error, wedge_factor
from fenics_contact import JointLaw, Scene, SolveOptions, limit_load
from fenics_contact.analysis.certificate import TOLERANCES
from fenics_contact.scene import METHODS
from tests.regression.scenes import WALLS, arch_scene, wall_scene, wedge_scene
from tests.system.program import run_command

#: References that are computed: the upper bound of the rigid-block programs; methods.
PROGRAM, FIXED_POINT, AUTO = "program", "fixed-point", "auto"

#: Tolerance of computed references, and seconds at most for one by "fixed-point".
REFERENCE_TOLERANCE, REFERENCE_TIME = 1e-10, 120.0

#: Walls on which the fixed point ends before the load factor's plateau, or takes too long.
LARGE = ("20x20", "40x40", "80x80")

#: Elements along half a block in the curves over mesh size.
SIZES = (1, 2, 4, 8, 16)

#: What a process prints before the row that it measured.
MARK = "measured row: "


@dataclass(frozen=True)
class Row:
    """One run; a line of the CSV file.

    Attributes:
        case: Name of the case.
        elements: Along half a block (through the thickness of an arch, the height of the wedge).
        friction: Coefficient of all joints.
        dofs: Displacements.
        bodies: Blocks.
        joint_points: Points at which joint forces act.
        ranks: Processes.
        method: As in the scene file, or the name of another program.
        tolerance: On the load factor, relative.
        status: Of the result; or "time-out", "crash", the name of an exception.
        verified: Whether the status is "limit" and the certificate passed.
        seconds: Of `limit_load` with the mesh made before.
        seconds_assemble: Assembling, part of `seconds`; likewise the next ones.
        seconds_bonded: One solve of the same mesh with all joints closed: assemble, analyse,
            factor, solve.
        seconds_bounds: Linear programs of rigid blocks.
        seconds_solve: Everything after.
        bonded_solves: `seconds` in units of `seconds_bonded`.
        factorizations: Numeric factorisations.
        mode_factorizations: Those among them of the blocks' modes, which are small.
        load_factor: nan if none was found.
        upper_bound: Of the load factor, by associative friction of rigid blocks; nan where it was
            not asked for.
        reference: What the load factor is compared with.
        reference_kind: "closed form", "rigid-block program", or the method and its tolerance.
        error: Of the load factor relative to the reference.
        reference_finest: Load factor on the finest mesh of the same case.
        error_finest: Relative to that.
        residual: The certificate's worst, relative to what is tolerated.
        residual_name: Its name.
        peak_memory: MB, sum over ranks, with that of the libraries.
        repeat: Number of the run, from 1; 0 for one that was made for a reference.
        versions: Of the programs.
        machine: Processor and number of its cores.
    """

    case: str
    elements: int = 0
    friction: float = math.nan
    dofs: int = 0
    bodies: int = 0
    joint_points: int = 0
    ranks: int = 1
    method: str = ""
    tolerance: float = math.nan
    status: str = ""
    verified: bool = False
    seconds: float = math.nan
    seconds_assemble: float = 0.0
    seconds_bonded: float = 0.0
    seconds_bounds: float = 0.0
    seconds_solve: float = 0.0
    bonded_solves: float = math.nan
    factorizations: int = 0
    mode_factorizations: int = 0
    load_factor: float = math.nan
    upper_bound: float = math.nan
    reference: float = math.nan
    reference_kind: str = ""
    error: float = math.nan
    reference_finest: float = math.nan
    error_finest: float = math.nan
    residual: float = math.nan
    residual_name: str = ""
    peak_memory: float = math.nan
    repeat: int = 1
    versions: str = ""
    machine: str = ""

    @property
    def own(self) -> bool:
        """Whether it is of this package, which verifies its results; others cannot."""
        return self.method in METHODS

    @property
    def counts(self) -> bool:
        """Whether its time and load factor mean anything."""
        return self.verified if self.own else math.isfinite(self.load_factor)

    @property
    def key(self) -> tuple[str, int, int, str, str]:
        """What repeated runs share."""
        return self.case, self.elements, self.ranks, self.method, f"{self.tolerance:g}"


# CSV files


def append_row(path: Path, row: Row) -> None:
    """Write a row at the end of a file, which is begun if need be.

    Raises:
        ValueError: If the file has other columns.
    """
    names = [field.name for field in fields(Row)]
    if not path.exists() or path.stat().st_size == 0:
        path.write_text(",".join(names) + "\n")
    with path.open(newline="") as file:
        if next(csv.reader(file)) != names:
            raise ValueError(f"{path} has other columns; take another file")
    with path.open("a", newline="") as file:
        csv.DictWriter(file, names).writerow(asdict(row))


def read_rows(path: Path) -> list[Row]:
    """Rows of a file; columns that it has not keep their defaults."""
    kinds: Mapping[str, Callable[[str], Any]] = {
        "int": lambda text: int(float(text)),
        "float": float,
        "bool": lambda text: text == "True",
        "str": str,
    }
    with path.open(newline="") as file:
        return [
            Row(
                **{
                    f.name: kinds[str(f.type)](line[f.name])
                    for f in fields(Row)
                    if line.get(f.name)
                }
            )
            for line in csv.DictReader(file)
        ]


def medians(rows: Iterable[Row]) -> list[Row]:
    """One row for repeated runs: medians of the numbers of those that count, `repeat` their number.

    Runs that were made for a reference are left out.
    """
    groups: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in rows:
        if row.counts and row.repeat:
            groups[row.key].append(row)
    typical = []
    for group in groups.values():
        names = [f.name for f in fields(Row) if f.type == "float" and f.name != "tolerance"]
        middle = {name: statistics.median(getattr(row, name) for row in group) for name in names}
        typical.append(replace(group[-1], **middle, repeat=len(group)))
    return typical


# Cases


@dataclass(frozen=True)
class Case:
    """A scene on one mesh.

    Attributes:
        name: Of the case; meshes of different size share it.
        elements: As in `Row`.
        friction: Of all joints.
        make: Builds mesh and scene.
        small: Builds a small one of the same kind.
        reference: The load factor if it is known, or how to compute it.
        finest: Elements of the finest mesh where there are several, else 0.
    """

    name: str
    elements: int
    friction: float
    make: Callable[[], Scene]
    small: Callable[[], Scene]
    reference: float | str = FIXED_POINT
    finest: int = 0

    def row(self) -> Row:
        """A row of this case, to be filled in."""
        return Row(self.name, self.elements, self.friction, machine=machine())


def cases() -> list[Case]:
    """Every case, in the order of the table."""
    listed = [
        wall_case(name, friction, 4, AUTO if name in LARGE else FIXED_POINT)
        for name in ("W4", "10x10", "20x20", "40x40", "80x80")
        for friction in (0.4, 0.75)
    ]
    listed += [
        wall_case(name, 0.65, elements, finest=SIZES[-1]) for name in WALLS for elements in SIZES
    ]
    for friction in (0.1, 0.2, 0.3):
        make, exact = partial(wedge_scene, friction), wedge_factor(friction)
        listed.append(Case(f"wedge F={friction:g}", 2, friction, make, make, exact))
    for voussoirs in (15, 51):
        make, small = (partial(arch_scene, count, 0.15) for count in (voussoirs, 7))
        listed.append(Case(f"arch of {voussoirs} t/R=0.15", 2, 1.0, make, small, PROGRAM))
    return listed


def wall_case(
    name: str, friction: float, elements: int, reference: str = FIXED_POINT, finest: int = 0
) -> Case:
    """A wall with Coulomb friction."""
    law = JointLaw("coulomb", friction)
    make = partial(wall_scene, name, law, elements=elements)
    small = partial(wall_scene, "2x2", law, elements=1)
    return Case(f"{name} F={friction:g}", elements, friction, make, small, reference, finest)


def case_named(name: str, elements: int) -> Case:
    """The case of a name on one of its meshes."""
    return next(case for case in cases() if (case.name, case.elements) == (name, elements))


def selected(pattern: str = "*", elements: Sequence[int] = ()) -> list[Case]:
    """Cases whose name holds a pattern of the shell, on meshes of some sizes or all."""
    match = re.compile(fnmatch.translate(f"*{pattern}*"), re.IGNORECASE).match
    return [
        case for case in cases() if match(case.name) and (not elements or case.elements in elements)
    ]


# Measuring, in a process of its own


@dataclass(frozen=True)
class Task:
    """One run."""

    case: str
    elements: int
    method: str
    tolerance: float
    ranks: int = 1
    repeat: int = 1


def measure(task: Task) -> Row:
    """Solve a case and say what it took; collective."""
    case = case_named(task.case, task.elements)
    options = SolveOptions(method=task.method, tolerance=task.tolerance)
    limit_load(replace(case.small(), solve=options)).structure.destroy()
    scene = replace(case.make(), solve=options)
    gc.collect()
    scene.comm.barrier()
    result = limit_load(scene)
    seconds, collapse, structure = result.seconds, result.positive, result.structure
    certificate = None if collapse is None else collapse.certificate
    row = replace(
        task_row(case, task),
        dofs=int(structure.problem.dead.getSize()),
        bodies=int(scene.mesh.body_count),
        joint_points=len(structure.joints.length),
        status=result.status,
        verified=result.status == "limit" and certificate is not None and certificate.passed,
        seconds=seconds["total"],
        factorizations=result.factorizations,
        mode_factorizations=result.mode_factorizations,
        load_factor=result.load_factor,
        peak_memory=peak_memory(scene),
        versions=versions(),
    )
    for phase in ("assemble", "bonded", "bounds", "solve"):
        row = replace(row, **{f"seconds_{phase}": seconds.get(phase, 0.0)})
    if row.seconds_bonded:
        row = replace(row, bonded_solves=row.seconds / row.seconds_bonded)
    if case.reference == PROGRAM and collapse is not None and collapse.bounds.upper is not None:
        row = replace(row, upper_bound=collapse.bounds.upper)
    if certificate is not None:
        parts = {name: value / TOLERANCES[name] for name, value in certificate.residuals.items()}
        worst = max(parts, key=parts.__getitem__)
        row = replace(row, residual=parts[worst], residual_name=worst)
    return row


def task_row(case: Case, task: Task) -> Row:
    """The row of a task before it is run."""
    return replace(
        case.row(),
        ranks=task.ranks,
        method=task.method,
        tolerance=task.tolerance,
        repeat=task.repeat,
    )


def peak_memory(scene: Scene) -> float:
    """Most memory that was resident, MB, sum over ranks; collective."""
    kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(scene.comm.allreduce(kilobytes)) / 1024.0


def versions() -> str:
    """Of this package and what it stands on; MUMPS and BLAS as far as their libraries say it."""
    import dolfinx
    from petsc4py import PETSc

    from fenics_contact import __version__

    maps = Path("/proc/self/maps")
    libraries = maps.read_text() if maps.exists() else ""
    mumps = re.search(r"libdmumps[^/\s]*?-([0-9.]*[0-9])\.so", libraries)
    blas = re.search(r"([\w-]+)/libblas\.so", libraries)
    known = {
        "fenics_contact": __version__,
        "dolfinx": dolfinx.__version__,
        "PETSc": ".".join(map(str, PETSc.Sys.getVersion())),
        "MUMPS": mumps[1] if mumps else "",
        "BLAS": blas[1] if blas else "",
        "scipy": scipy.__version__,
        "numpy": np.__version__,
        "Python": platform.python_version(),
    }
    return ", ".join(f"{name} {version}" for name, version in known.items() if version)


def machine() -> str:
    """Processor and number of its cores."""
    path = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*:\s*(.+)", path.read_text()) if path.exists() else None
    model = found[1].strip() if found else platform.machine()
    count = os.cpu_count() or 1
    return f"{model}, {count} core{'s' if count > 1 else ''}"


def serve(text: str) -> int:
    """Measure a task that comes as JSON, and print the row as JSON on rank 0."""
    from mpi4py import MPI

    row = measure(Task(**json.loads(text)))
    if MPI.COMM_WORLD.rank == 0:
        print(MARK + json.dumps(asdict(row)), flush=True)
    return 0


# Running


def run(task: Task, time_out: float) -> Row:
    """The row of a task, measured in a process of its own."""
    line = [sys.executable, str(Path(__file__).resolve()), "--task", json.dumps(asdict(task))]
    if task.ranks > 1:
        several = ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", str(task.ranks)]
        line = several + line
    failed = task_row(case_named(task.case, task.elements), task)
    try:
        done = run_command(line, Path.cwd(), time_out)
    except subprocess.TimeoutExpired:
        return replace(failed, status="time-out")
    rows = [line for line in done.out.splitlines() if line.startswith(MARK)]
    if done.code == 0 and rows:
        return Row(**json.loads(rows[-1].removeprefix(MARK)))
    said = re.findall(r"^([\w.]+(?:Error|Exception)): (.*)", done.err, re.MULTILINE)
    if said:
        print(f"{task}: {said[-1][1]}", file=sys.stderr)
    return replace(failed, status=said[-1][0].split(".")[-1] if said else "crash")


class References:
    """What load factors are compared with; each is looked up or computed once."""

    def __init__(
        self, rows: Iterable[Row], time_out: float, record: Callable[[Row], None] | None = None
    ) -> None:
        """Prepare.

        Args:
            rows: Earlier ones, whose references are taken over.
            time_out: Seconds for a run that computes a reference; 0 for none.
            record: Is given the rows of such runs, and of others that go with them.
        """
        self.time_out = time_out
        self.record = record or (lambda row: None)
        self.known: dict[tuple[str, int], tuple[float, str]] = {
            (row.case, row.elements): (row.reference, row.reference_kind)
            for row in rows
            if math.isfinite(row.reference)
        }

    @classmethod
    def of_file(cls, path: Path | None, time_out: float) -> References:
        """Those of a file of rows, to which rows are added; without one they are not kept."""
        if path is None:
            return cls([], time_out)
        return cls(read_rows(path) if path.exists() else [], time_out, partial(append_row, path))

    def of(self, case: Case) -> tuple[float, str]:
        """The reference of a case and its kind; nan and "none" if there is none."""
        key = case.name, case.elements
        if isinstance(case.reference, float):
            return case.reference, "closed form"
        if key not in self.known and self.time_out > 0.0:
            self.known[key] = self._computed(case)
        return self.known.get(key, (math.nan, "none"))

    def compare(self, row: Row, case: Case) -> Row:
        """A row with its errors."""
        value, kind = self.of(case)
        row = replace(
            row,
            reference=value,
            reference_kind=kind,
            error=relative_error(row.load_factor, value, 0.0),
        )
        if not case.finest:
            return row
        finest, _ = self.of(case_named(case.name, case.finest))
        error = relative_error(row.load_factor, finest, 0.0)
        return replace(row, reference_finest=finest, error_finest=error)

    def _computed(self, case: Case) -> tuple[float, str]:
        methods = (FIXED_POINT, AUTO) if case.reference == FIXED_POINT else (AUTO,)
        for method in methods:
            task = Task(case.name, case.elements, method, REFERENCE_TOLERANCE, repeat=0)
            late = REFERENCE_TIME if method == FIXED_POINT else math.inf
            row = run(task, min(self.time_out, late))
            value, kind = row.load_factor, f"{method} to {REFERENCE_TOLERANCE:g}"
            if case.reference == PROGRAM:
                value, kind = row.upper_bound, "rigid-block program"
            found = row.verified and math.isfinite(value)
            known = {"reference": value, "reference_kind": kind} if found else {}
            self.record(replace(row, **known))
            if found:
                return value, kind
        return math.nan, "none"


def tasks(
    case: Case,
    methods: Sequence[str],
    tolerances: Sequence[float],
    ranks: Sequence[int],
    repeat: int,
) -> list[Task]:
    """Runs of a case, methods in turns, every other turn backwards."""
    turn = [
        (method, tolerance, count)
        for count in ranks
        for tolerance in tolerances
        for method in methods
    ]
    return [
        Task(case.name, case.elements, *choice, repeat=number)
        for number in range(1, repeat + 1)
        for choice in (turn if number % 2 else turn[::-1])
    ]


# Table

COLUMNS = "{:24}{:>4}{:>8} {:12}{:>8}{:>6} {:14}{:>9}{:>9}{:>6}{:>6} {:>13}{:>9}{:>9}{:>8}"
HEAD = COLUMNS.format(
    *("case", "el.", "dofs", "method", "tol.", "ranks", "status", "s", "bonded"),
    *("fact", "modes", "load factor", "error", "residual", "MB"),
)


def line(row: Row) -> str:
    """A row of the table."""
    return COLUMNS.format(
        row.case,
        row.elements,
        row.dofs,
        row.method,
        number(row.tolerance, ".0e"),
        row.ranks,
        row.status if row.verified or row.status != "limit" else "unverified",
        number(row.seconds, ".3g"),
        number(row.bonded_solves, ".3g"),
        row.factorizations,
        row.mode_factorizations,
        number(row.load_factor, ".9f"),
        number(row.error, ".1e"),
        number(row.residual, ".1e"),
        number(row.peak_memory, ".0f"),
    )


def listed(text: str, kind: Callable[[str], Any] = str) -> list[Any]:
    """Values separated by commas."""
    return [kind(part) for part in text.split(",") if part]


def arguments() -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="*", metavar="PATTERN", help="cases whose name holds it")
    parser.add_argument("--elements", default="", metavar="N,M", help="these meshes alone")
    parser.add_argument(
        "--methods", default="auto,fixed-point,monolithic", metavar="A,B", help="or all"
    )
    parser.add_argument("--ranks", default="1", metavar="N,M", help="numbers of processes")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="runs of each kind")
    parser.add_argument(
        "--tolerance", "--tolerances", default="1e-6", metavar="X,Y", help="on the load factor"
    )
    parser.add_argument("--time-out", type=float, default=600.0, metavar="S", help="per run")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="rows are added there")
    parser.add_argument("--list", action="store_true", help="list the cases and run nothing")
    parser.add_argument("--task", help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> int:
    """Run what was asked for; exit code 1 if a row is not verified."""
    choice = arguments()
    if choice.task:
        return serve(choice.task)
    chosen = selected(choice.only, listed(choice.elements, int))
    if choice.list:
        for case in chosen:
            print(f"{case.name:24}{case.elements:4d}  reference: {case.reference}")
        return 0
    methods = list(METHODS) if choice.methods == "all" else listed(choice.methods)
    tolerances = listed(choice.tolerance, float)
    for method in methods:
        for tolerance in tolerances:
            SolveOptions(method=method, tolerance=tolerance)
    references = References.of_file(choice.csv, choice.time_out)
    rows = []
    print(HEAD)
    for case in chosen:
        references.of(case)  # first, so that an interrupted table has it
        ranks = listed(choice.ranks, int)
        for task in tasks(case, methods, tolerances, ranks, choice.repeat):
            row = references.compare(run(task, choice.time_out), case)
            references.record(row)
            rows.append(row)
            print(line(row), flush=True)
    print(f"\nmedians of verified runs\n{HEAD}")
    for row in medians(rows):
        print(line(row))
    missed = [row for row in rows if not row.counts]
    if missed:
        print(f"\nnot verified\n{HEAD}")
    for row in missed:
        print(line(row))
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
