"""What the commands do: solve, check, stands, sweep and so on; each returns its exit code."""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import signal
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from fenics_contact.console import Progress, ProgressLine, SweepProgress
from fenics_contact.errors import (
    BAD_INPUT,
    EXIT_CODES,
    ContactError,
    InputError,
    raised_together,
    require,
)
from fenics_contact.parallel import MPI
from fenics_contact.results.bounds import counted
from fenics_contact.scene.toml_tables import is_of_blocks, read_toml
from fenics_contact.workers import InPlace, Signals, ranks, ranks_of

#: The exit code of a run that a signal ended is this and its number.
BY_SIGNAL = 128
#: Size of a mesh file, bytes, from which on no rank holds the whole mesh unless asked to.
LARGE_FILE = 250_000_000
#: Endings of files that runs write.
WRITTEN = (".json", ".csv", ".png", ".svg", ".pdf", ".html")

Tasked = Callable[[argparse.Namespace, MPI.Intracomm, Executor], int]


def _with_workers(command: Tasked) -> Callable[[argparse.Namespace, MPI.Intracomm], int]:
    """A command on one rank that hands tasks to the others, or to processes (`--jobs`).

    Where a scene shares its mesh out among the ranks, all of them run the command.
    """

    def run(options: argparse.Namespace, comm: MPI.Intracomm) -> int:
        if options.jobs < 1:
            raise InputError(f"jobs = {options.jobs} must be at least 1")
        if comm.size > 1 and options.jobs > 1:
            raise InputError(
                f"--jobs {options.jobs} under mpirun: the ranks share the tasks; leave out one of"
                " both"
            )
        if comm.size == 1:
            return command(options, comm, options.beside)
        if _shares_mesh(options, comm):
            return command(options, comm, InPlace())
        code = 0
        failure: ContactError | None = None
        with contextlib.ExitStack() as stack:
            if comm.rank != 0:
                stack.enter_context(Signals())
            others = stack.enter_context(ranks(comm))
            if others is not None:
                try:
                    code = command(options, MPI.COMM_SELF, others)
                except ContactError as error:
                    failure = error
        code, failure = comm.bcast((code, failure))
        if failure is not None:
            raise failure
        return code

    return run


def _shares_mesh(options: argparse.Namespace, comm: MPI.Intracomm) -> bool:
    """Whether a scene's mesh is shared out among the ranks: if it says so, or if it is large."""
    tables = read_toml(options.scene, comm, options.overrides)
    size = 0
    with contextlib.suppress(AttributeError, KeyError, TypeError, ValueError, OSError):
        asked = tables.get("solve", {}).get("distribute")
        if isinstance(asked, bool):
            return asked
        if comm.rank == 0:  # what is wrong with scene or file is said when they are read
            size = (options.scene.parent / tables["mesh"]["file"]).stat().st_size
    return bool(comm.bcast(size) > LARGE_FILE)


@_with_workers
def solve(options: argparse.Namespace, comm: MPI.Intracomm, beside: Executor) -> int:
    """Read a scene, find its limit load, print it and write its files."""
    start = time.perf_counter()
    loud = comm.rank == 0 and not options.quiet

    def say(text: str, wished: bool = True) -> None:
        if loud and wished:
            print(f"{text}\n", end="", flush=True)  # in one piece: see `Progress.phase`

    more = options.verbose
    say(f"reading {options.scene}", more)
    folder = _output_folder(options, comm)
    fast = ["solve.fast=true", "output.capacity=0"] if options.fast else []
    every = ["output.pictures=all"] if options.pictures else []
    tables = read_toml(options.scene, comm, [*options.overrides, *fast, *every])
    kind = _kind(tables)
    scene = kind.read(tables, options.scene.parent, comm)
    read = time.perf_counter() - start
    count = comm.size * ranks_of(beside)
    ranks_told = f" on {counted(count, 'rank')}" if count > 1 else ""
    say(f"{counted(kind.count(scene), 'block')}{ranks_told}", more)
    # mpirun passes a terminal on even where its own output goes to a file.
    over = MPI.COMM_WORLD.size == 1 and sys.stdout.isatty()
    shown = ProgressLine if over and not more else Progress
    with Signals() as signals:
        with contextlib.ExitStack() as stack:
            progress = shown(scene.solve.tolerance)
            monitor = progress if loud and (more or over) else None
            if monitor is not None:
                stack.callback(progress.close)
            result = kind.solved(scene, monitor, signals, beside)
        seconds = {"read": read, "total": result.seconds["total"] + read}
        result = replace(result, seconds={**result.seconds, **seconds})
        say(result.summary(more))
        result.write(folder, lambda: _first(signals, comm) > 0, beside)
        say(f"written to {folder}", more)
        code = EXIT_CODES[result.status]
        say(_next("report", folder), code == 0)
        number = _first(signals, comm)
    return BY_SIGNAL + number if number else code


def _next(command: str, of: Path, overrides: Sequence[str] = ()) -> str:
    """What people do next."""
    settings = (part for text in overrides for part in ("--set", text))
    return f"next: {shlex.join(['fenics-contact', command, f'{of}', *settings])}"


def _kind(tables: dict[str, Any]) -> Any:
    """The module that knows scenes of this kind, with a mesh or of rigid blocks."""
    return import_module(f"fenics_contact.cli.{'blocks' if is_of_blocks(tables) else 'meshed'}")


def _first(signals: Signals, comm: MPI.Comm) -> int:
    """Number of a signal that asked some rank to end the run; 0 for none. Collective."""
    return int(comm.allreduce(signals.number, MPI.MAX))


@_with_workers
def sweep(options: argparse.Namespace, comm: MPI.Intracomm, beside: Executor) -> int:
    """Find the limit loads of a scene over values of its keys."""
    from fenics_contact.sweeps.points import WRONG_INPUT, Family, Parameter
    from fenics_contact.sweeps.sweep import run_sweep

    loud = comm.rank == 0 and not options.quiet
    parameters = [Parameter.parse(text) for text in options.vary]
    folder = _output_folder(options, comm, "_sweep")
    family = Family((options.scene, tuple(options.overrides)), comm)
    tell = SweepProgress() if loud else None
    alone = MPI.COMM_WORLD.size == 1  # mpirun ends its ranks itself
    before = signal.signal(signal.SIGTERM, signal.default_int_handler) if alone else None
    try:
        found = run_sweep(family, parameters, folder, beside, tell)
    except KeyboardInterrupt:
        if loud:
            print(f"stopped; what is in {folder} is kept: the same command goes on", flush=True)
        raise
    finally:
        if alone:
            signal.signal(signal.SIGTERM, before)
    if loud:
        lines = [repr(found)[1:-1], f"written to {folder}"]
        lines += [_next("report", folder)] if any(point.solved for point in found) else []
        print("\n".join(lines), flush=True)
    return max((EXIT_CODES | {WRONG_INPUT: BAD_INPUT})[point.status] for point in found)


@_with_workers
def mechanisms(options: argparse.Namespace, comm: MPI.Intracomm, beside: Executor) -> int:
    """Find the mechanisms of all parts of a scene of rigid blocks."""
    from fenics_contact.sweeps.mechanisms import mechanisms as mechanisms_of
    from fenics_contact.sweeps.points import Parameter

    folder = _output_folder(options, comm, "_mechanisms")
    tables = read_toml(options.scene, comm, options.overrides)
    text = "mechanisms are of rigid blocks: give [blocks] in place of [mesh]; see docs/spatial.md"
    require(is_of_blocks(tables), text)
    scene = _kind(tables).read(tables, options.scene.parent, comm)

    angles = Parameter.of("--angles", options.angles).values if options.angles else ()
    loud = comm.rank == 0 and not options.quiet
    tell = {"tell": SweepProgress()} if loud else {}
    with Signals() as signals:
        found = mechanisms_of(
            scene, options.exclude, angles=angles, stop=signals, beside=beside, **tell
        )
        found.write(folder)
        number = _first(signals, comm)
    if loud:
        lines = ["", repr(found), *([found.stopped] * bool(found.stopped)), f"written to {folder}"]
        lines += [_next("report", folder)] * any(row.result.limits for row in found.rows)
        print("\n".join(lines), flush=True)
    code = max((EXIT_CODES[row.end.status] for row in found.rows), default=0)
    return BY_SIGNAL + number if number else code


def _output_folder(options: argparse.Namespace, comm: MPI.Comm, ending: str = "") -> Path:
    """Where to write; refused, before the work is done, if it is a file or cannot be written to."""
    scene: Path = options.scene
    with raised_together(comm):
        if not scene.name:
            raise InputError(f"'{scene}' is a folder; give a scene file")
        folder: Path = options.output or scene.with_name(scene.with_suffix("").name + ending)
        if comm.rank != 0:
            return folder
        refused = f"cannot write to '{folder}'"
        try:
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                folder.stat()  # refuses names that cannot be
            there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
            if not there.is_dir():
                raise InputError(f"{refused}: '{there}' is a file; choose with -o")
            if not os.access(there, os.W_OK):
                raise InputError(f"{refused}: no right to; choose another with -o")
            for path in folder.iterdir() if there == folder else ():
                if path.suffix in WRITTEN and path.is_dir():
                    raise InputError(
                        f"{refused}: '{path.name}' is a folder; choose another with -o"
                    )
        except (OSError, ValueError) as error:  # a ValueError: a name with a NUL
            raise InputError(f"{refused}: {getattr(error, 'strerror', error)}") from None
    return folder


def check(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Read a scene and say what is in it."""
    tables = read_toml(options.scene, comm, options.overrides)
    kind = _kind(tables)
    text, warnings = kind.checked(kind.read(tables, options.scene.parent, comm), options.verbose)
    lines = [text, *(f"warning: {one}" for one in warnings)]
    lines.append(_next("stands", options.scene, options.overrides))
    if comm.rank == 0 and not options.quiet:
        print("\n".join(lines))
    return 0


def stands(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Find the state under the dead load, or at a load factor, print it and write its files."""
    folder = _output_folder(options, comm, "_state")
    factor = options.load_factor
    tables = read_toml(options.scene, comm, options.overrides)
    loads = tables.get("loads")
    pushed = isinstance(loads, dict) and "live" in loads
    if factor == 0.0 and isinstance(loads, dict) and "live" not in loads:
        # A live load that acts on the blocks, to be multiplied by 0: as the dead load.
        dead = loads.get("dead")
        if not dead:
            raise InputError(
                "loads.dead is missing; give [loads.dead], which the structure is to stand"
            )
        is_table = isinstance(dead, dict)
        loads["live"] = {k: v for k, v in dead.items() if k != "movement"} if is_table else dead
    kind = _kind(tables)
    found = kind.standing(kind.read(tables, options.scene.parent, comm), factor)
    acting = "loads." if factor else "loads.dead."
    goes_on = pushed and found.status == "equilibrium"  # `solve` comes next and tells warnings
    lines = [
        f"warning: {text}"
        for text in found.warnings
        if not goes_on and (text.startswith(acting) or not text.startswith("loads."))
    ]
    lines.append(found.summary(options.verbose))
    found.write(folder)
    lines.append(f"written to {folder}")
    if goes_on:
        lines.append(_next("solve", options.scene, options.overrides))
    if comm.rank == 0 and not options.quiet:
        print("\n".join(lines), flush=True)
    return EXIT_CODES.get(found.status, 0)


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
