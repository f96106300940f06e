"""Processes that call functions for the benchmarks and are replaced when they take too long.

A worker reads calls as lines of JSON and answers with lines of JSON, on one rank or several by
mpirun. It can use the package of another checkout; scenes and measures are those of this one.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import gc
import importlib
import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

#: This checkout.
HOME = Path(__file__).resolve().parents[1]

ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OMPI_ALLOW_RUN_AS_ROOT": "1"}
ENVIRONMENT["OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"] = "1"


class Worker:
    """A process, or several by mpirun, that calls functions of this checkout's benchmarks."""

    def __init__(self, ranks: int = 1, root: Path = HOME) -> None:
        """Say what to start by the first call; `root` has the package to use."""
        self.ranks, self.root = ranks, root
        self._process: subprocess.Popen[str] | None = None

    def call(self, function: str, seconds: float, **arguments: Any) -> dict[str, Any]:
        """What a function returns; {"status": "time-out", "crash" or the exception's name} if not.

        Args:
            function: As "benchmarks.run:measure"; called on all ranks, returns a dictionary.
            seconds: Time that it may take.
            arguments: Of the function.
        """
        process, status = self._process or self._start(), "crash"
        self._process = process
        assert process.stdin and process.stdout
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps([function, arguments]) + "\n")
            process.stdin.flush()
            if not select.select([process.stdout], [], [], seconds)[0]:
                status = "time-out"
            elif line := process.stdout.readline():
                return dict(json.loads(line))
        self.close()
        return {"status": status}

    def close(self) -> None:
        """End the process; mpirun must be asked, so that it ends its ranks first."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.communicate(timeout=10.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._process = None

    def _start(self) -> subprocess.Popen[str]:
        several = ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", str(self.ranks)]
        line = [sys.executable, str(Path(__file__).resolve()), str(self.root.resolve())]
        return subprocess.Popen(
            several * (self.ranks > 1) + line,
            env={**os.environ, **ENVIRONMENT},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )


def solve_file(
    path: str, effort: str, warm: str, method: str = "auto", tolerance: float = 1e-6
) -> dict[str, Any]:
    """The limit load of a scene file, by any version; `effort` "fast" asks for nothing beside it.

    The file `warm` is solved first, by the first call: compiles forms and loads libraries.
    """
    from fenics_contact import Scene, limit_load

    def read(file: str) -> Any:
        scene = Scene.from_file(file)
        options: dict[str, Any] = {"method": method, "tolerance": tolerance}
        if hasattr(scene.solve, "fast"):
            options["fast"] = effort == "fast"
        return dataclasses.replace(scene, solve=dataclasses.replace(scene.solve, **options))

    if warm not in _WARM:
        limit_load(read(warm))
        _WARM.add(warm)
    scene = read(path)
    gc.collect()
    start = time.process_time()
    result = limit_load(scene)
    modes = result.mode_factorizations
    return {
        "status": result.status,
        "load_factor": result.load_factor,
        "structure": result.factorizations - modes,
        "modes": modes,
        "cpu": time.process_time() - start,
        "bonded": result.seconds["solve"] / result.seconds["bonded"],
    }


#: Files that were solved before the clock started.
_WARM: set[str] = set()


def save(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to a CSV file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(key for row in rows for key in row)))
        writer.writeheader()
        writer.writerows(rows)


def serve(root: str) -> None:
    """Answer calls until there are no more; what functions print goes to the standard error."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    sys.path[0] = root
    package = importlib.import_module("fenics_contact")
    if not Path(str(package.__file__)).is_relative_to(root):
        raise ImportError(f"there is no package fenics_contact in {root}")
    sys.path[0] = str(HOME)
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    while line := comm.bcast(sys.stdin.readline() if comm.rank == 0 else None):
        function, arguments = json.loads(line)
        try:
            module, name = function.split(":")
            answer = getattr(importlib.import_module(module), name)(**arguments)
        except Exception as error:  # one row must not stop a table
            print(f"{function} {arguments}: {error!r}", file=sys.stderr, flush=True)
            answer = {"status": type(error).__name__}
        if comm.rank == 0:
            answers.write(json.dumps(answer) + "\n")
            answers.flush()


if __name__ == "__main__":
    serve(sys.argv[1])
