"""What the commands do: solve, check, stands, sweep and report; each returns its exit code."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

from fenics_contact.console import (
    Progress,
    ProgressBar,
    SweepProgress,
    counted,
    description,
    summary,
)
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import InputError, raised_together
from fenics_contact.exit_codes import BAD_INPUT, BY_SIGNAL, EXIT_CODES, STOPPING
from fenics_contact.limit_load import limit_load
from fenics_contact.scene.scene import Scene


class _Signals:
    """Signals that ask to end a run: what is known by then is written.

    They are Ctrl-C, SIGTERM (batch systems), and SIGUSR1, which mpirun passes on to its ranks
    without killing them. Ctrl-C once more ends at once.

    Attributes:
        number: Of the first signal that came; 0 for none.
    """

    def __init__(self) -> None:
        self.number = 0

    def __enter__(self) -> _Signals:
        self._before = {number: signal.signal(number, self._note) for number in STOPPING}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> str:
        """Who asked to end the run; empty if nobody did."""
        return signal.Signals(self.number).name if self.number else ""

    def _note(self, number: int, _: object) -> None:
        if self.number and number == signal.SIGINT:
            raise KeyboardInterrupt
        self.number = self.number or number


def solve(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Read a scene, find its limit load, print it and write its files."""
    start = time.perf_counter()
    loud = comm.rank == 0 and not options.quiet

    def say(text: str) -> None:
        if loud:
            print(f"{text}\n", end="", flush=True)  # in one piece: see `Progress.phase`

    say(f"reading {options.scene}")
    folder = _output_folder(options, comm)
    fast = ["solve.fast=true", "output.capacity=0"] if options.fast else []
    scene = Scene.from_file(options.scene, comm, [*options.overrides, *fast])
    read = time.perf_counter() - start
    say(f"{counted(scene.mesh.body_count, 'block')} on {counted(comm.size, 'rank')}")
    # mpirun passes a terminal on even where its own output goes to a file.
    shown = ProgressBar if comm.size == 1 and sys.stdout.isatty() else Progress
    with _Signals() as signals:
        with contextlib.closing(shown(scene.solve.tolerance)) as progress:
            monitor = progress if loud else None
            result = limit_load(scene, monitor, stop=signals)
            if scene.output.capacity and not result.stopped:
                result = result.with_capacity(monitor, stop=signals)
        seconds = {"read": read, "total": result.seconds["total"] + read}
        result = replace(result, seconds={**result.seconds, **seconds}).hold_against_brackets()
        say(summary(result) if loud else "")
        result.write(folder, lambda: _first_signal(signals, comm) > 0)
        say(f"written to {folder}")
        number = _first_signal(signals, comm)
    return BY_SIGNAL + number if number else EXIT_CODES[result.status]


def _first_signal(signals: _Signals, comm: MPI.Comm) -> int:
    """Number of a signal that asked some rank to end the run; 0 for none. Collective."""
    return int(comm.allreduce(signals.number, MPI.MAX))


def sweep(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Find the limit loads of a scene over values of its keys."""
    from fenics_contact.sweeps.parameters import Family, Parameter
    from fenics_contact.sweeps.points import WRONG_INPUT
    from fenics_contact.sweeps.sweep import Told, run_sweep, silent

    loud = comm.rank == 0 and not options.quiet
    parameters = [Parameter.parse(text) for text in options.vary]
    folder = _output_folder(options, comm, "_sweep")
    family = Family.of_file(options.scene, comm, options.overrides)
    tell: Told = silent
    if loud:
        tell = SweepProgress()
    try:
        found = run_sweep(family, parameters, folder, options.jobs, tell)
    except KeyboardInterrupt:
        if loud:
            print(f"stopped; what is in {folder} is kept: the same command goes on", flush=True)
        raise
    if loud:
        print(f"{repr(found)[1:-1]}\nwritten to {folder}", flush=True)
    codes = {BAD_INPUT if p.status == WRONG_INPUT else EXIT_CODES[p.status] for p in found}
    return max(codes)


def _output_folder(options: argparse.Namespace, comm: MPI.Comm, ending: str = "") -> Path:
    """Where to write; checked on all ranks before the work is done."""
    scene: Path = options.scene
    with raised_together(comm):
        if not scene.name:
            raise InputError(f"'{scene}' is a folder; give a scene file")
        folder: Path = options.output or scene.with_name(scene.with_suffix("").name + ending)
        if comm.rank == 0:
            try:
                _check_folder(folder)
            except (OSError, ValueError) as error:  # a ValueError: a name with a NUL
                reason = getattr(error, "strerror", error)
                raise InputError(f"cannot write to '{folder}': {reason}") from None
    return folder


#: Endings of files that runs write.
_WRITTEN = (".json", ".csv", ".png", ".svg", ".pdf", ".html")


def _check_folder(folder: Path) -> None:
    """Refuse a folder that is a file, or that cannot be written to."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        folder.stat()  # refuses names that cannot be
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise InputError(f"cannot write to '{folder}': '{there}' is a file; choose with -o")
    if not os.access(there, os.W_OK):
        raise InputError(f"cannot write to '{folder}': no right to; choose another with -o")
    for path in folder.iterdir() if there == folder else ():
        if path.suffix in _WRITTEN and path.is_dir():
            text = f"cannot write to '{folder}': '{path.name}' is a folder; choose another with -o"
            raise InputError(text)


def check(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Read a scene and say what is in it."""
    with Discretization(Scene.from_file(options.scene, comm, options.overrides)) as discretization:
        discretization.check_pushed()
        lines = [description(discretization)]
        lines += [f"warning: {text}" for text in discretization.warnings]
    if comm.rank == 0 and not options.quiet:
        print("\n".join(lines))
    return 0


def stands(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Find the state under the dead load, or at a load factor, print it and write its files."""
    from fenics_contact.cli.standing import exit_code, find_state, told

    loud = comm.rank == 0 and not options.quiet
    folder = _output_folder(options, comm, "_state")
    found = find_state(options, comm)
    text = told(found)
    found.write(folder)
    if loud:
        print(f"{text}\nwritten to {folder}", flush=True)
    return exit_code(found)


def report(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Write the page on a result that was written before."""
    from fenics_contact.output.report.content import Labels
    from fenics_contact.output.report.page import write_report

    labels = Labels(options.project, options.author)
    with raised_together(comm):
        if comm.rank == 0:
            written = write_report(options.folder, options.output, options.pdf, labels)
            if not options.quiet:
                print("\n".join(f"written to {target}" for target in written))
    return 0


COMMANDS = {"solve": solve, "check": check, "stands": stands, "sweep": sweep, "report": report}
