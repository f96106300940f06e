"""Run times, errors and costs: tables of rows, pictures and the page that are made of them.

    python3 benchmarks/run.py --quick --write         # one commit, 12 minutes; docs/cost.md
    python3 benchmarks/run.py [--tables time_error,cost_size,tolerance,parts,command_line]
        [--only "W4*"] [--methods "auto,jobs*"] [--repeat 3] [--time-out 300]

A row is the median of runs in a process in which a small scene was solved first, so that no time is
for compiling forms or loading libraries; the mesh is there before the clock starts. `parts` has its
processor time. Rows of the command line are whole runs, the least of several. --quick runs others
once, and the command line up to 10 s. Meshes and tolerances get finer along a curve, which ends
where a run takes too long. Rows are kept in RESULTS/<table>.csv; a run replaces rows of its own
scenes and methods, one by one; each says what made it, of which commit and when. The page and the
pictures have rows of this program of the last commit alone.
"""

from __future__ import annotations

import argparse
import csv
import gc
import json
import math
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import scenes
from benchmarks.cost_page import write_page
from benchmarks.peers import PEERS, peer
from benchmarks.pictures import draw, newest
from benchmarks.scenes import (
    COST_SIZE,
    FILES,
    TIME_ERROR,
    TOLERANCE,
    comparison,
    matching,
    wall_blocks,
)
from benchmarks.worker import ENVIRONMENT, HOME, Worker, save
from fenics_contact import __version__, limit_load
from fenics_contact.collapse import strategy
from fenics_contact.collapse.load_case import LoadingPath
from fenics_contact.search_options import SearchOptions
from tests.bank import Recipe, Variant, coulomb, wall_recipe

#: Rows of --quick: by table, scenes and methods.
QUICK = {
    "time_error": {
        1: "auto,splitting,rigid-lp,gilbert*",
        2: "auto,splitting,fixed-point",
        4: "auto",
    },
    "cost_size": {4: "auto,path,faces"},
    "tolerance": {2: "*"},
    "parts": {4: "*"},
    "command_line": {4: "*"},
}
TABLES = tuple(QUICK)
#: Solver's options, by method of a row; others are `SolveOptions.method`.
OPTIONS: dict[str, dict[str, Any]] = {
    "path": {"engine": "path", "fast": True},
    "faces": {"engine": "faces", "fast": True},
    "1e-3": {"engine": "path", "fast": True, "tolerance": 1e-3},
    "1e-6": {"engine": "path", "fast": True, "tolerance": 1e-6},
}

#: What is switched off, with the first of each group as the measure: numbers of the searches and
#: options of the scene, and with them how the path is followed.
PARTS: dict[str, dict[str, Any]] = {
    "load factor alone": {"fast": True},
    "block modes": {"fast": True, "modes": False},
    "nonlinear elimination": {"fast": True, "points": 0, "late_rounds": 0},
    "points chosen late": {"fast": True, "late_rounds": 0},
    "interior point method at the end": {"fast": True, "finish": False},
    "indentation of blocks": {"fast": True, "indentation": 1e-9},
    "larger products on large walls": {"fast": True, "products_of_many": 0.0},
    "second solve where digits cancel": {"fast": True, "cancellation": math.inf},
    "face engine": {"fast": True, "engine": "path"},
    "default": {},
    "peak": {"peak": False},
    "lower states": {"lowest": False},
    "error of the mesh": {"error": False},
}

#: Arguments of the command line, and processes of mpirun, by method of a row.
COMMANDS: dict[str, tuple[list[str], int]] = {
    "fast": (["--fast"], 1),
    "default": ([], 1),
    "mpirun 2": ([], 2),
    "jobs 2": (["--jobs", "2"], 1),
    "mpirun 3": ([], 3),
    "mpirun 4": ([], 4),
}
#: A sweep of 21 frictions.
SWEPT = ["--vary", "joints.default.friction,foundations.base.friction=0.4:0.8:21"]


@dataclass(frozen=True)
class Task:
    """One row.

    Attributes:
        table: One of `TABLES`.
        scene: Name in the table.
        method: As in the scene file, or a peer's name.
        resolution: Elements along half a block (through an arch); a peer's own resolution.
        degree: Of the displacements.
        ranks: Processes.
    """

    table: str
    scene: str
    method: str
    resolution: float = 2
    degree: int = 1
    ranks: int = 1

    @property
    def curve(self) -> tuple[Any, ...]:
        """What rows of one curve share; scenes of different size are on one curve."""
        scene = self.scene.split()[-1] if self.table == "cost_size" else self.scene
        return scene, self.method, self.degree, self.ranks


def tasks(table: str) -> Iterator[Task]:
    """Rows of a table, coarse to fine."""
    for method in ("auto", "path", "faces", "fixed-point") if table == "cost_size" else ():
        yield from (Task(table, name, method, 4) for name in COST_SIZE)
    for name in TOLERANCE if table == "tolerance" else ():
        yield from (Task(table, name, method) for method in ("1e-3", "1e-6"))
    for name in matching(comparison(), scenes.MIXED) if table == "parts" else ():
        yield from (Task(table, name, part, 4) for part in PARTS)
    for name in FILES if table == "command_line" else ():
        yield from (Task(table, name, method, 4) for method in COMMANDS)
        if name == "10x10 0.75":
            yield Task(table, name, "sweep", 4)
    for name in TIME_ERROR if table == "time_error" else ():
        for method, degree in (("auto", 1), ("auto", 2), ("fixed-point", 1), ("splitting", 1)):
            yield from (Task(table, name, method, n, degree) for n in (1, 2, 4, 8))
        for method in PEERS:
            yield from (Task(table, name, method, n) for n in peer(method).RESOLUTIONS)


# Measuring, in a process of its own


def measure(task: dict[str, Any], time_out: float) -> dict[str, Any]:
    """What a run takes and finds; collective."""
    chosen = Task(**task)
    if chosen.table == "parts":
        return solve_without(chosen)
    return ask(chosen, time_out) if chosen.method in PEERS else solve(chosen)


def solve_without(task: Task) -> dict[str, Any]:
    """Solve a scene of `comparison` with a part switched off, and undo that."""
    warm()
    off = dict(PARTS[task.method])
    recipe, elements = comparison()[task.scene]
    numbers = {name: off.pop(name) for name in list(off) if hasattr(SearchOptions, name)}
    # An answer that is named would ask for it alone.
    modes, finish = off.pop("modes", True), off.pop("finish", True)
    scene = recipe.scene(elements, fast=off.pop("fast", False))
    scene = replace(scene, solve=replace(scene.solve, **off))
    with ExitStack() as undo:
        if not modes:
            undo.enter_context(mock.patch.object(LoadingPath, "on_modes", on_structure))
        if not finish:
            never = replace(strategy.FINISHING, interior_steps=0)
            undo.enter_context(mock.patch.object(strategy, "FINISHING", never))
        for options in [one for one in gc.get_objects() if isinstance(one, SearchOptions)]:
            undo.callback(vars(options).update, {name: getattr(options, name) for name in numbers})
            vars(options).update(numbers)
        gc.collect()
        start = time.process_time()
        result = limit_load(scene)
        seconds = time.process_time() - start
    return found(result) | {"seconds": seconds, "cost": result.cost}


def on_structure(task: Any, name: str = "") -> LoadingPath:
    """The path on the structure in place of that on block modes."""
    return LoadingPath(task, name=name)


@cache
def warm() -> None:
    """Compile forms and load libraries."""
    for fast in (True, False):
        limit_load(wall_recipe("W1", coulomb(0.65)).scene(2, fast=fast))


def found(result: Any) -> dict[str, Any]:
    """What a result says of a row."""
    end = next(iter(result.ends.values()), None)
    return {
        "status": result.status,
        "load_factor": result.load_factor,
        "gap": end and end.as_state.gap,
        "bonded_seconds": result.seconds.get("bonded", math.nan),
        "factorizations": result.factorizations,
        "mode_factorizations": result.mode_factorizations,
        "made_with": f"fenics_contact {__version__}; {machine()}",
    }


def run_command(task: Task, repeat: int, time_out: float, enough: float) -> dict[str, Any]:
    """The least wall time and the least processor time of whole runs of the command line."""
    folder = Path(tempfile.mkdtemp())
    file = scenes.write_scene(*FILES[task.scene], folder / "scene.toml")
    out = folder / "out"
    program = [sys.executable, "-m", "fenics_contact"]
    arguments, ranks = COMMANDS.get(task.method, (SWEPT, 1))
    kind = "sweep" if task.method == "sweep" else "solve"
    line = [*program, kind, "-q", str(file), "-o", str(out), *arguments]
    if "both" in task.scene:
        line += ["--set", "solve.direction=both"]
    if ranks > 1:
        line = ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", str(ranks), *line]
    rest: dict[str, Any] = {"cwd": HOME, "env": {**os.environ, **ENVIRONMENT}, "check": False}
    walls, cpus = [], []
    status = "limit"
    try:
        while len(walls) < repeat and sum(walls) < enough:
            shutil.rmtree(out, ignore_errors=True)
            start, before = time.perf_counter(), children()
            code = subprocess.run(line, timeout=time_out, **rest).returncode
            walls.append(time.perf_counter() - start)
            cpus.append(children() - before)
            status = "limit" if code == 0 else f"exit code {code}"
    except subprocess.TimeoutExpired:
        status = "time-out"
    record = json.loads((out / "result.json").read_text()) if kind == "solve" and walls else {}
    shutil.rmtree(folder)
    factor = record.get("load_factor")
    return {
        **asdict(task),
        "status": status,
        "load_factor": factor if isinstance(factor, float) else math.nan,
        "seconds": min(walls, default=math.nan),
        "cpu": min(cpus, default=math.nan),
        "made_with": f"fenics_contact {__version__}; {machine()}",
        "runs": len(walls),
    }


def children() -> float:
    """Processor time of the processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def ask(task: Task, time_out: float) -> dict[str, Any]:
    """Ask a peer; its time is from the blocks' outlines to its answer."""
    program = peer(task.method)
    if not program.version():
        return {"status": "not installed"}
    program.solve(wall_blocks("4x5", 0.5), program.RESOLUTIONS[0])
    blocks, start = TIME_ERROR[task.scene].blocks(), time.perf_counter()
    answer = program.solve(blocks, task.resolution, start + time_out)
    return {
        "blocks": len(blocks.outlines),
        "status": answer.status,
        "load_factor": answer.load_factor,
        "seconds": time.perf_counter() - start,
        "made_with": f"{program.version()}; {machine()}",
    }


def solve(task: Task) -> dict[str, Any]:
    """Solve a scene with this program."""
    options = OPTIONS.get(task.method, {"method": task.method, "fast": False})
    limit_load(wall_recipe("2x2", coulomb(0.5)).scene(1, **options))
    scene = recipe_of(task).scene(
        int(task.resolution), variant=Variant(degree=task.degree), **options
    )
    gc.collect()
    scene.comm.barrier()
    result = limit_load(scene)
    memory = scene.comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    topology = scene.mesh.domain.topology
    topology.create_entities(1)
    nodes = sum(topology.index_map(dim).size_global for dim in range(task.degree))
    return {
        "blocks": scene.mesh.body_count,
        "displacements": 2 * nodes,
        **found(result),
        "seconds": result.seconds["total"],
        "memory_mb": memory / 1024.0,
    }


def recipe_of(task: Task) -> Recipe:
    """How the scene of a row is made."""
    entries = {"cost_size": COST_SIZE, "time_error": TIME_ERROR, "tolerance": TOLERANCE}
    return entries[task.table][task.scene].recipe


def machine() -> str:
    """Processor and number of its cores."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return f"{', '.join(dict.fromkeys(names))}, {os.cpu_count()} cores"


# Running

#: The process of all rows but those that have its memory: it compiles and loads once.
KEPT = Worker()


def median_row(task: Task, repeat: int, time_out: float) -> dict[str, Any]:
    """A task's row: the run of median time; once where it takes half a minute."""
    runs: list[dict[str, Any]] = []
    arguments = {"task": asdict(task), "time_out": time_out}
    while len(runs) < repeat and not (runs and runs[-1].get("seconds", math.inf) > 30.0):
        worker = Worker(task.ranks) if task.table == "cost_size" else KEPT
        # The time before the clock starts is not counted, within reason.
        runs.append(worker.call("benchmarks.run:measure", 1.2 * time_out + 60.0, **arguments))
        if worker is not KEPT:
            worker.close()
    runs.sort(key=lambda run: run.get("seconds", math.inf))
    return {**asdict(task), **runs[(len(runs) - 1) // 2], "runs": len(runs)}


def read(path: Path) -> list[dict[str, Any]]:
    """Rows of a CSV file, numbers as numbers; none if there is no file."""
    words = ("table", "scene", "method", "status", "made_with", "commit", "date")
    lines = path.read_text().splitlines() if path.exists() else []
    return [
        {name: text if name in words else float(text or "nan") for name, text in row.items()}
        for row in csv.DictReader(lines)
    ]


def key(row: dict[str, Any]) -> tuple[Any, ...]:
    """What a row is told by from others of its table."""
    return tuple(row[name] for name in ("scene", "method", "degree", "ranks", "resolution"))


def error(row: dict[str, Any]) -> float:
    """Distance of a load factor from the best value known, relative."""
    factor = row.get("load_factor", math.nan)
    if row["scene"] in TIME_ERROR:
        return abs(factor / TIME_ERROR[row["scene"]].best - 1.0)
    return math.nan


@cache
def commit() -> str:
    """The commit of this checkout, with "+" where files of the program have changed."""

    def git(*line: str) -> str:
        asked = ["git", "-C", str(HOME), *line]
        return subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()

    changed = git("status", "--porcelain", "--", "fenics_contact")
    return git("rev-parse", "--short", "HEAD") + "+" * bool(changed)


def quick(task: Task) -> bool:
    """Whether a task is one of --quick."""
    methods = QUICK[task.table].get(int(task.resolution) if task.resolution >= 1 else 1, "")
    if task.method.startswith("gilbert"):
        methods = "gilbert*" if task.resolution >= 1e-4 else ""
    if task.table == "parts" and not matching([task.scene], scenes.FEW):
        return False
    if task.table == "command_line" and task.method in ("mpirun 3", "mpirun 4"):
        return task.scene == "10x10 0.75"
    if task.table == "command_line" and task.scene.startswith(("2x2", "W3", "10x10 0.4")):
        return task.method in ("fast", "default")
    if task.table == "cost_size" and matching([task.scene], "14*,28*75,40*75"):
        return task.method == "faces"
    return bool(matching([task.method], methods))


def main() -> int:
    """Run tables and draw; exit code 1 if a row of this program is not verified."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tables", default=",".join(TABLES), metavar="A,B", help="or none")
    parser.add_argument("--only", default="*", metavar="PATTERNS", help="scenes, by commas")
    parser.add_argument("--methods", default="*", metavar="PATTERNS", help="and peers, by commas")
    parser.add_argument("--quick", action="store_true", help="the rows of the page, 12 minutes")
    parser.add_argument("--write", action="store_true", help="docs/cost.md and its pictures")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="runs of a row")
    parser.add_argument("--time-out", type=float, default=300.0, metavar="S", help="per run")
    parser.add_argument("--results", type=Path, default=HOME / "benchmarks" / "results")
    choice = parser.parse_args()
    missed = 0
    for table in matching(TABLES, choice.tables):
        path, ended = choice.results / f"{table}.csv", set()
        rows = {key(row): row for row in read(path)}
        order = [key(asdict(task)) for task in tasks(table)]
        for task in tasks(table):
            if choice.quick and not quick(task):
                continue
            wanted = matching([task.scene], choice.only) and matching([task.method], choice.methods)
            if not wanted or task.curve in ended:
                continue
            if table == "command_line":
                enough = 10.0 if choice.quick else math.inf
                row = run_command(task, choice.repeat, choice.time_out, enough)
            else:
                repeat = 1 if choice.quick else choice.repeat
                row = median_row(task, repeat, choice.time_out)
            if not row.get("seconds", math.inf) <= choice.time_out:
                ended.add(task.curve)
            if row["status"] == "not installed" and key(row) in rows:
                continue  # the row says by which version and when
            missed += task.method not in (*PEERS, *PARTS) and row["status"] != "limit"
            today = {"commit": commit(), "date": date.today().isoformat()}
            rows[key(row)] = row = {**row, "error": error(row), **today}
            save(path, [rows[name] for name in order if name in rows])
            shown = (f"{row.get(n, math.nan):.4g}" for n in ("load_factor", "error", "seconds"))
            print(*key(row), row["status"], *shown, sep="\t", flush=True)
    KEPT.close()
    if choice.write:
        for name in ("time_error", "cost_size"):
            draw(name, newest(read(choice.results / f"{name}.csv")), HOME / "docs")
        write_page({name: read(choice.results / f"{name}.csv") for name in TABLES})
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
