"""Points of a sweep shared among processes, each with a mesh and a structure of its own."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

from fenics_contact.errors import SolverError
from fenics_contact.sweeps.parameters import Family, Values
from fenics_contact.sweeps.points import Point

#: Module whose `answer` a process runs.
ANSWERS = "fenics_contact.sweeps.solving"
#: Variables by which launchers of MPI know their ranks: a worker is none of them.
_LAUNCHED = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")
_KEPT = ("OMPI_MCA_", "OMPI_ALLOW_")


def solved_by_workers(family: Family, points: Sequence[Values], jobs: int) -> Iterator[Point]:
    """Points in the order in which they end; each process has the scene, or reads it.

    Raises:
        InputError: If the scene cannot be given to other processes.
        SolverError: If a process ends before its answer.
    """
    origin = family.to_send()
    workers = [_Worker(origin) for _ in range(min(jobs, len(points)))]
    free: SimpleQueue[_Worker] = SimpleQueue()
    for worker in workers:
        free.put(worker)

    def solved(values: Values) -> Point:
        worker = free.get()
        try:
            return worker.point(values)
        finally:
            free.put(worker)

    pool = ThreadPoolExecutor(len(workers))
    try:
        for future in as_completed([pool.submit(solved, values) for values in points]):
            yield future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.stop()


class _Worker:
    """A process that answers values with points, through pipes.

    It has a session of its own, so that Ctrl-C is for the process that has the table.
    """

    def __init__(self, origin: bytes) -> None:
        """Start it; `origin` is that of the family of scenes, pickled."""
        environment = {
            name: value
            for name, value in os.environ.items()
            if name.startswith(_KEPT) or not name.startswith(_LAUNCHED)
        }
        self._process = subprocess.Popen(
            [sys.executable, "-c", f"from {ANSWERS} import answer; answer()"],
            env=environment | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        pipes: Any = self._process.stdin, self._process.stdout
        self._asked, self._answers = pipes
        self._asked.write(origin)

    def point(self, values: Values) -> Point:
        """The point with these values."""
        try:
            pickle.dump(values, self._asked)
            self._asked.flush()
            found: Point = pickle.load(self._answers)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):
            code = self._process.wait()
            raise SolverError(f"a process of the sweep ended early (exit code {code})") from None
        return found

    def stop(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.wait()
        for pipe in (self._asked, self._answers):
            with suppress(OSError):
                pipe.close()
