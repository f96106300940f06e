"""Points of a sweep shared among processes, each with a mesh and a structure of its own."""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from fenics_contact.errors import ContactError, InputError, SolverError
from fenics_contact.sweeps.parameters import Family, Values
from fenics_contact.sweeps.points import Point, Structure, solve_point

#: Variables by which launchers of MPI know their ranks: a worker is none of them.
_LAUNCHED = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")


def solved_by_workers(family: Family, points: Sequence[Values], jobs: int) -> Iterator[Point]:
    """Points in the order in which they end; scenes are read from their file by each process.

    Raises:
        InputError: If the scene was made in Python.
        SolverError: If a process ends before its answer.
    """
    if family.file is None:
        raise InputError(
            f"jobs = {jobs} needs a scene file, which every process reads; give jobs = 1"
        )
    todo: queue.SimpleQueue[Values] = queue.SimpleQueue()
    done: queue.SimpleQueue[Point | ContactError] = queue.SimpleQueue()
    for values in points:
        todo.put(values)
    workers = [_Worker(family) for _ in range(min(jobs, len(points)))]
    try:
        for worker in workers:
            threading.Thread(target=worker.work, args=(todo, done), daemon=True).start()
        for _ in points:
            answer = done.get()
            if isinstance(answer, ContactError):
                raise answer
            yield answer
    finally:
        for worker in workers:
            worker.stop()


class _Worker:
    """A process that answers values with points, through pipes."""

    def __init__(self, family: Family) -> None:
        environment = {k: v for k, v in os.environ.items() if not k.startswith(_LAUNCHED)}
        kept = {k: v for k, v in os.environ.items() if k.startswith(("OMPI_MCA_", "OMPI_ALLOW_"))}
        self._process = subprocess.Popen(
            [sys.executable, "-c", f"from {__name__} import answer; answer()"],
            env=environment | kept | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for the process that has the table
        )
        pickle.dump(family.file, self._input)

    @property
    def _input(self):  # type: ignore[no-untyped-def]
        return self._process.stdin

    def work(
        self, todo: queue.SimpleQueue[Values], done: queue.SimpleQueue[Point | ContactError]
    ) -> None:
        """Have points solved until there are no more."""
        while True:
            try:
                values = todo.get_nowait()
            except queue.Empty:
                return
            try:
                pickle.dump(values, self._input)
                self._input.flush()
                done.put(pickle.load(self._process.stdout))  # type: ignore[arg-type]
            except (OSError, EOFError, ValueError, pickle.UnpicklingError):
                code = self._process.wait()
                done.put(SolverError(f"a process of the sweep ended early (exit code {code})"))
                return

    def stop(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                stream.close()  # type: ignore[union-attr]


def answer() -> None:
    """Read a scene file's name and then values from standard input, and answer with points."""
    with os.fdopen(os.dup(0), "rb") as asked, os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)  # what libraries have to say is no answer
        file: tuple[Path, tuple[str, ...]] = pickle.load(asked)
        family, structure = Family.of_file(file[0], overrides=file[1]), Structure()
        with suppress(EOFError, BrokenPipeError):
            while True:
                values = pickle.load(asked)
                pickle.dump(solve_point(family, structure, values), answers)
                answers.flush()
        structure.close()
