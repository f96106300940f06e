"""The command line: `fenics-contact solve`, `check`, `sweep`, `report` and `mesh`."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import gc
import io
import logging
import os
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

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
from fenics_contact.drawing import UNITS, mesh_drawing
from fenics_contact.errors import InputError, OutputError, SolverError, raised_together
from fenics_contact.limit_load import limit_load
from fenics_contact.output.report import write_report
from fenics_contact.scene import Scene
from fenics_contact.sweeps.parameters import Family, Parameter
from fenics_contact.sweeps.points import WRONG_INPUT
from fenics_contact.sweeps.sweep import Told, run_sweep, silent
from fenics_contact.version import __version__

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
#: Characters of a message.
LONGEST_LINE = 1000

#: Signals that end a run early, with what is known by then; the exit code is this and the number.
STOPPING, BY_SIGNAL = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1), 128

#: Exit codes by status of the result.
EXIT_CODES = {"limit": 0, "unbounded": 0, "unstable": 3, "no_equilibrium": 3, "not_converged": 4}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 solved, 2 bad input, 3 unstable, 4 not)."""
    gc.freeze()  # modules stay: no search for garbage need look at them again
    atexit.register(gc.freeze)  # nor the last one at anything: all is freed with the process
    comm = MPI.COMM_WORLD
    with _output_may_close():
        with _only_on_root(comm):
            options = _parser().parse_args(arguments)
        _set_up_logging(options, comm)
        return _run(options, comm)


def _run(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Exit code of a command; an error that is no bug of the program is one line."""
    try:
        return int(options.run(options, comm))
    except InputError as error:
        _complain(str(error), comm)
        return BAD_INPUT
    except OutputError as error:
        _complain(str(error), comm)
        return EXIT_CODES["not_converged"]
    except SolverError as error:
        _complain(f"not solved: {error}", comm)
        return EXIT_CODES["not_converged"]
    except KeyboardInterrupt:
        return _stopped_alone(comm, INTERRUPTED)
    except OSError as error:
        print("fenics-contact:", " ".join(str(error).split()), file=sys.stderr)
        return _stopped_alone(comm, FAILED)
    except Exception:
        if comm.size == 1:
            raise
        traceback.print_exc()
        return _stopped_alone(comm, FAILED)


def _stopped_alone(comm: MPI.Comm, code: int) -> int:
    """Exit code of a rank that leaves its work; the others, which would wait for it, are ended."""
    sys.stderr.flush()
    if comm.size > 1:
        comm.Abort(code)
    return code


class _Output:
    """A stream that goes nowhere once it cannot be written to, so that the run goes on."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        with self._lost():
            return self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with self._lost():
            self._stream.flush()

    @contextlib.contextmanager
    def _lost(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if not isinstance(error, BrokenPipeError):
                with contextlib.suppress(OSError):
                    os.write(2, f"fenics-contact: cannot print: {error.strerror}\n".encode())
            # What is in the buffer is written once more when Python ends.
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, self._stream.fileno())
            os.close(nothing)


@contextlib.contextmanager
def _output_may_close() -> Iterator[None]:
    """Go on where nobody reads what is printed, as in `fenics-contact solve ... | head`."""
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # PETSc's handler ends the program
    # MPI takes a second to end, in which Ctrl-C would be a traceback.
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_DFL)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names may have letters that it lacks
            stream.reconfigure(errors="backslashreplace")
    out, err = _Output(sys.stdout), _Output(sys.stderr)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):  # type: ignore[type-var]
        try:
            yield
        finally:
            out.flush()
            err.flush()


def _complain(message: str, comm: MPI.Comm) -> None:
    """Print one line, whatever names and texts of the user are in the message."""
    if comm.rank == 0:
        line = "".join(c if c.isprintable() else repr(c)[1:-1] for c in message)
        if len(line) > LONGEST_LINE:
            line = f"{line[: LONGEST_LINE // 2]} ... {line[-LONGEST_LINE // 2 :]}"
        print(f"fenics-contact: {line}", file=sys.stderr)


@contextlib.contextmanager
def _only_on_root(comm: MPI.Comm) -> Iterator[None]:
    """Let rank 0 alone print what argparse has to say."""
    with open(os.devnull, "w") as nothing, contextlib.ExitStack() as stack:
        if comm.rank != 0:
            stack.enter_context(contextlib.redirect_stdout(nothing))
            stack.enter_context(contextlib.redirect_stderr(nothing))
        yield


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fenics-contact",
        description="Limit loads of blocks in contact with friction: how much load a wall, arch or"
        " bridge of blocks stands before it collapses, and how it fails.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    solve = commands.add_parser("solve", help="compute the limit load of a scene")
    check = commands.add_parser("check", help="read a scene, say what is in it, solve nothing")
    report = commands.add_parser("report", help="put the result in a folder on one page (HTML)")
    report.add_argument("folder", type=Path, metavar="DIR", help="where `solve` wrote to")
    report.add_argument("-o", "--output", type=Path, metavar="FILE.html", help="(DIR/report.html)")
    mesh = commands.add_parser("mesh", help="mesh a DXF drawing of blocks for gmsh")
    mesh.add_argument("drawing", type=Path, help="drawing: closed polylines are blocks (DXF)")
    mesh.add_argument("--size", type=float, metavar="M", help="length of elements, m")
    mesh.add_argument("--unit", choices=sorted(UNITS), help="of the drawing, if it says none")
    mesh.add_argument("-o", "--output", type=Path, metavar="FILE", help="the mesh, .msh")
    sweep = commands.add_parser(
        "sweep", help="compute the limit load over values of a scene's keys"
    )
    for command in (solve, check, sweep):
        command.add_argument("scene", type=Path, help="scene file (TOML)")
        command.add_argument(
            "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
            help="change a value of the scene file, e.g. joints.default.friction=0.5",
        )  # fmt: skip
    made = (solve, _solve), (check, _check), (sweep, _sweep), (report, _report), (mesh, _mesh)
    for command, run in made:
        command.set_defaults(run=run)
        loud = command.add_mutually_exclusive_group()
        loud.add_argument("-v", "--verbose", action="store_true", help="say more")
        loud.add_argument("-q", "--quiet", action="store_true", help="say nothing but errors")
    where = "where to write (SCENE_sweep); a sweep that was stopped goes on there"
    solve.add_argument(
        "--fast", action="store_true", help="the load factor and its bracket alone, verified"
    )
    for command, text in ((solve, "where to write (SCENE without ending)"), (sweep, where)):
        command.add_argument("-o", "--output", type=Path, metavar="DIR", help=text)
    sweep.add_argument(
        "--vary", action="append", required=True, metavar="KEY=A:B:N",
        help="N values from A to B, or KEY=A,B,C; KEY,KEY=... gives keys the same values; several"
        " --vary: all combinations",
    )  # fmt: skip
    sweep.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (1)")
    return parser


def _set_up_logging(options: argparse.Namespace, comm: MPI.Comm) -> None:
    logging.getLogger().setLevel(logging.WARNING)  # form compilers are talkative
    log = logging.getLogger("fenics_contact")
    log.propagate = False
    log.handlers[:] = [logging.StreamHandler(sys.stdout)]
    level = logging.INFO if options.verbose else logging.WARNING
    log.setLevel(level if comm.rank == 0 and not options.quiet else logging.CRITICAL)


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


def _solve(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Read a scene, find its limit load, print it and write its files."""
    start = time.perf_counter()
    loud = comm.rank == 0 and not options.quiet

    def say(text: str) -> None:
        if loud:
            print(f"{text}\n", end="", flush=True)  # in one piece: see `Progress.phase`

    say(f"reading {options.scene}")
    folder = _output_folder(options, comm)
    fast = ["solve.fast=true"] if options.fast else []
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
                result.trace_capacity(monitor, stop=signals)
        result.seconds["read"] = read
        result.seconds["total"] += read
        result.hold_against_brackets()
        say(summary(result) if loud else "")
        result.write(folder, lambda: _first_signal(signals, comm) > 0)
        say(f"written to {folder}")
        number = _first_signal(signals, comm)
    return BY_SIGNAL + number if number else EXIT_CODES[result.status]


def _first_signal(signals: _Signals, comm: MPI.Comm) -> int:
    """Number of a signal that asked some rank to end the run; 0 for none. Collective."""
    return int(comm.allreduce(signals.number, MPI.MAX))


def _sweep(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Find the limit loads of a scene over values of its keys."""
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
        print(f"{found!r}\nwritten to {folder}", flush=True)
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


def _check_folder(folder: Path) -> None:
    """Refuse a folder that is a file, or that cannot be written to."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        folder.stat()  # refuses names that cannot be
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise InputError(f"cannot write to '{folder}': '{there}' is a file; choose with -o")
    if not os.access(there, os.W_OK):
        raise InputError(f"cannot write to '{folder}': no right to; choose another with -o")


def _check(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Read a scene and say what is in it."""
    with Discretization(Scene.from_file(options.scene, comm, options.overrides)) as discretization:
        lines = [description(discretization)]
        lines += [f"warning: {text}" for text in discretization.warnings]
    if comm.rank == 0 and not options.quiet:
        print("\n".join(lines))
    return 0


def _report(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Write the page on a result that was written before."""
    with raised_together(comm):
        if comm.rank == 0:
            target = write_report(options.folder, options.output)
            if not options.quiet:
                print(f"written to {target}")
    return 0


def _mesh(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Mesh a drawing on rank 0 and say what was made."""
    with raised_together(comm):
        if comm.rank == 0:
            made = mesh_drawing(options.drawing, options.output, options.size, options.unit)
            if not options.quiet:
                print(made)
    return 0
