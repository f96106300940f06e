"""The command line: `fenics-contact solve SCENE.toml` and `fenics-contact check SCENE.toml`."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import sys
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpi4py import MPI

    from fenics_contact.limit_load import LimitLoad

SOLVED, BAD_INPUT, UNSTABLE, NOT_CONVERGED = 0, 2, 3, 4


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 solved, 2 bad input, 3 unstable, 4 not)."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    with _only_on_root(comm):
        options = _parser().parse_args(arguments)
    _set_up_logging(options, comm)
    from fenics_contact.errors import InputError

    try:
        return _solve(options, comm) if options.command == "solve" else _check(options, comm)
    except InputError as error:
        if comm.rank == 0:
            print(f"fenics-contact: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return 130
    except Exception:
        if comm.size == 1:
            raise
        # A rank that stops alone would leave the others waiting.
        traceback.print_exc()
        sys.stderr.flush()
        comm.Abort(1)
        raise


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
    commands = parser.add_subparsers(dest="command", required=True)
    solve = commands.add_parser("solve", help="compute the limit load of a scene")
    check = commands.add_parser("check", help="read a scene, say what is in it, solve nothing")
    for command in (solve, check):
        command.add_argument("scene", type=Path, help="scene file (TOML)")
        command.add_argument(
            "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
            help="change a value of the scene file, e.g. joints.default.friction=0.5",
        )  # fmt: skip
        loud = command.add_mutually_exclusive_group()
        loud.add_argument("-v", "--verbose", action="store_true", help="say more")
        loud.add_argument("-q", "--quiet", action="store_true", help="say nothing but errors")
    solve.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="where to write (SCENE without ending)"
    )
    return parser


def _set_up_logging(options: argparse.Namespace, comm: MPI.Comm) -> None:
    logging.getLogger().setLevel(logging.WARNING)  # form compilers are talkative
    log = logging.getLogger("fenics_contact")
    log.propagate = False
    handler = logging.StreamHandler(sys.stdout)
    handler.setFormatter(logging.Formatter("%(message)s"))
    log.handlers[:] = [handler]
    level = logging.INFO if options.verbose else logging.WARNING
    log.setLevel(level if comm.rank == 0 and not options.quiet else logging.CRITICAL)


def _solve(options: argparse.Namespace, comm: MPI.Comm) -> int:
    import time

    start = time.perf_counter()
    loud = comm.rank == 0 and not options.quiet
    if loud:
        print(f"reading {options.scene}", flush=True)
    from fenics_contact.limit_load import limit_load
    from fenics_contact.progress import Progress
    from fenics_contact.scene import read_scene

    folder = _output_folder(options, comm)
    scene = read_scene(options.scene, comm, options.overrides)
    read = time.perf_counter() - start
    if loud:
        print(
            f"{_count(scene.mesh.body_count, 'block')} on {_count(comm.size, 'rank')}", flush=True
        )
    # mpirun passes a terminal on even where its own output goes to a file.
    bar = comm.size == 1 and sys.stdout.isatty()
    with Progress(loud, bar, scene.solve.tolerance) as progress:
        result = limit_load(scene, progress)
    result.seconds["read"] = read
    result.seconds["total"] += read
    result.hold_against_brackets()
    if loud:
        print(_summary(result), flush=True)
    result.write(folder)
    if loud:
        print(f"written to {folder}", flush=True)
    return {"unstable": UNSTABLE, "not_converged": NOT_CONVERGED}.get(result.status, SOLVED)


def _output_folder(options: argparse.Namespace, comm: MPI.Comm) -> Path:
    """Where to write; checked before the work is done.

    Raises:
        InputError: On all ranks, if a file is in the way or the folder cannot be made.
    """
    from fenics_contact.errors import InputError, raised_together

    folder: Path = options.output or options.scene.with_suffix("")
    with raised_together(comm):
        if comm.rank == 0:
            there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
            if not there.is_dir():
                raise InputError(f"cannot write to '{folder}': '{there}' is a file; choose with -o")
            if not os.access(there, os.W_OK):
                raise InputError(f"cannot write to '{folder}': no right to; choose another with -o")
    return folder


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _summary(result: LimitLoad) -> str:
    """The answer in a few lines."""
    if result.status == "unstable":
        return "unstable: there is no equilibrium under the dead load alone"
    lines = []
    for name, end in (("", result.positive), (" (live load reversed)", result.negative)):
        if end is None:
            continue
        if end.status == "unbounded":
            lines.append(f"load factor{name}: unbounded, nothing limits the live load")
            continue
        if end.state is None:
            lines.append(f"load factor{name}: NOT CONVERGED, no state was found")
            continue
        lines.append(
            f"load factor{name} = {end.load_factor:.8g}   {end.bounds} (rigid blocks without"
            " friction, and with associative friction)"
        )
        if end.status != "limit":
            failures = {} if end.certificate is None else end.certificate.failures
            names = ", ".join(f"{k} {v:.1e}" for k, v in failures.items()) or "no convergence"
            lines.append(f"NOT CONVERGED: this is not a limit load ({names})")
        elif end.certificate is not None:
            lines.append(
                f"verified: equilibrium {end.certificate.residuals['equilibrium']:.0e}, friction"
                f" {end.certificate.residuals['friction']:.0e}, error of the load factor at most"
                f" {end.certificate.error_estimate:.0e}"
            )
    bonded = result.seconds.get("bonded", 0.0)
    if bonded:
        ratio = result.seconds["solve"] / bonded
        lines.append(
            f"{result.factorizations} factorisations, {result.seconds['total']:.2f} s; solving took"
            f" {ratio:.1f} bonded solves"
        )
    return "\n".join(lines)


def _check(options: argparse.Namespace, comm: MPI.Comm) -> int:
    from fenics_contact.report import describe
    from fenics_contact.scene import read_scene
    from fenics_contact.discretization.discretization import Structure

    scene = read_scene(options.scene, comm, options.overrides)
    structure = Structure.build(scene)
    text = describe(structure)
    if comm.rank == 0 and not options.quiet:
        print(text)
    return SOLVED
