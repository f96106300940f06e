"""Run times, errors and costs: tables of rows, and the pictures drawn from them.

    python3 benchmarks/run.py [--tables time_error,cost_size,methods,real] [--only "W4*"]
        [--repeat 3] [--time-out 300] [--results FOLDER] [--pictures FOLDER]

A row is the median of runs in processes of their own, in which a small scene was solved first, so
that no time is for compiling forms or loading libraries; the mesh is there before the clock starts.
Meshes and tolerances get finer along a curve, which ends where a run takes too long. Rows are kept
in RESULTS/<table>.csv; a run replaces rows of its own scenes and methods, one by one.
"""

from __future__ import annotations

import argparse
import csv
import gc
import math
import os
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.peers import PEERS, peer
from benchmarks.pictures import draw
from benchmarks.scenes import COST_SIZE, REAL, TIME_ERROR, matching, wall_blocks
from benchmarks.worker import HOME, Worker, save
from fenics_contact import __version__, limit_load
from tests.bank import BANK, Recipe, Variant, coulomb, wall_recipe

TABLES = ("time_error", "cost_size", "methods", "real")
METHODS = ("auto", "fixed-point", "monolithic", "splitting", "active-set")

#: Scenes of the bank on which all methods are compared.
COMPARED = "W? tresca 2 kPa, W? coulomb 0.65, wedge 0.[123], arch 7 0.15, arch 15 0.15"


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
    for name in matching(BANK, COMPARED) if table == "methods" else ():
        yield from (Task(table, name, method) for method in METHODS)
    for method, ranks in (("auto", 1), ("auto", 2), ("fixed-point", 1)):
        if table == "cost_size":
            yield from (Task(table, name, method, 4, ranks=ranks) for name in COST_SIZE)
    yield from (Task(table, name, "auto") for name in REAL if table == "real")
    for name in TIME_ERROR if table == "time_error" else ():
        for method, degree in (("auto", 1), ("auto", 2), ("fixed-point", 1), ("splitting", 1)):
            yield from (Task(table, name, method, n, degree) for n in (1, 2, 4, 8))
        for method in PEERS:
            yield from (Task(table, name, method, n) for n in peer(method).RESOLUTIONS)


# Measuring, in a process of its own


def measure(task: dict[str, Any], time_out: float) -> dict[str, Any]:
    """What a run takes and finds; collective."""
    chosen = Task(**task)
    return ask(chosen, time_out) if chosen.method in PEERS else solve(chosen)


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
    options = {"variant": Variant(degree=task.degree), "method": task.method, "fast": False}
    limit_load(wall_recipe("2x2", coulomb(0.5)).scene(1, **options))
    scene = recipe_of(task).scene(int(task.resolution), **options)
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
        "status": result.status,
        "load_factor": result.load_factor,
        "seconds": result.seconds["total"],
        "bonded_seconds": result.seconds.get("bonded", math.nan),
        "factorizations": result.factorizations,
        "mode_factorizations": result.mode_factorizations,
        "memory_mb": memory / 1024.0,
        "made_with": f"fenics_contact {__version__}; {machine()}",
    }


def recipe_of(task: Task) -> Recipe:
    """How the scene of a row is made."""
    if task.table == "real":
        return REAL[task.scene]
    entries = {"methods": BANK, "cost_size": COST_SIZE, "time_error": TIME_ERROR}[task.table]
    return entries[task.scene].recipe


def machine() -> str:
    """Processor and number of its cores."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return f"{', '.join(dict.fromkeys(names))}, {os.cpu_count()} cores"


# Running


def median_row(task: Task, repeat: int, time_out: float) -> dict[str, Any]:
    """A task's row: the run of median time; once where it takes half a minute."""
    runs: list[dict[str, Any]] = []
    arguments = {"task": asdict(task), "time_out": time_out}
    while len(runs) < repeat and not (runs and runs[-1].get("seconds", math.inf) > 30.0):
        worker = Worker(task.ranks)
        # The time before the clock starts is not counted, within reason.
        runs.append(worker.call("benchmarks.run:measure", 1.2 * time_out + 60.0, **arguments))
        worker.close()
    runs.sort(key=lambda run: run.get("seconds", math.inf))
    return {**asdict(task), **runs[(len(runs) - 1) // 2], "runs": len(runs)}


def read(path: Path) -> list[dict[str, Any]]:
    """Rows of a CSV file, numbers as numbers; none if there is no file."""
    words = ("table", "scene", "method", "status", "made_with")
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
    return BANK[row["scene"]].error(factor) if row["scene"] in BANK else math.nan


def main() -> int:
    """Run tables and draw; exit code 1 if a row of this program is not verified."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tables", default=",".join(TABLES), metavar="A,B", help="or none")
    parser.add_argument("--only", default="*", metavar="PATTERNS", help="scenes, by commas")
    parser.add_argument("--methods", default="*", metavar="PATTERNS", help="and peers, by commas")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="runs of a row")
    parser.add_argument("--time-out", type=float, default=300.0, metavar="S", help="per run")
    parser.add_argument("--results", type=Path, default=HOME / "benchmarks" / "results")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="draw there")
    choice = parser.parse_args()
    missed = 0
    for table in matching(TABLES, choice.tables):
        path, ended = choice.results / f"{table}.csv", set()
        rows = {key(row): row for row in read(path)}
        order = [key(asdict(task)) for task in tasks(table)]
        for task in tasks(table):
            wanted = matching([task.scene], choice.only) and matching([task.method], choice.methods)
            if not wanted or task.curve in ended:
                continue
            row = median_row(task, choice.repeat, choice.time_out)
            if not row.get("seconds", math.inf) <= choice.time_out:
                ended.add(task.curve)
            missed += task.method in METHODS and row["status"] != "limit"
            rows[key(row)] = row = {**row, "error": error(row)}
            save(path, [rows[name] for name in order if name in rows])
            shown = (f"{row.get(n, math.nan):.4g}" for n in ("load_factor", "error", "seconds"))
            print(*key(row), row["status"], *shown, sep="\t", flush=True)
    if choice.pictures:
        for name in ("time_error", "cost_size"):
            draw(name, read(choice.results / f"{name}.csv"), choice.pictures)
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
