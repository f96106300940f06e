"""The command line: `fenics-contact solve`, `check`, `stands`, `sweep`, and so on."""

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
import traceback
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenics_contact.errors import (
    BAD_INPUT,
    FAILED,
    INTERRUPTED,
    ContactError,
    SolverError,
    raised_together,
)
from fenics_contact.requirements import MissingError, missing_requirements
from fenics_contact.version import __version__
from fenics_contact.workers import InPlace, Once, Processes

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from mpi4py import MPI

    Command = Callable[[argparse.Namespace, MPI.Comm], int]

#: Characters of a message.
LONGEST_LINE = 1000
#: What people do one after the other, and what the program ends with.
STEPS = """from a drawing to a report:
  fenics-contact mesh wall.dxf                    blocks of a drawing; then write wall.toml
  fenics-contact check wall.toml                  what is in the scene
  fenics-contact stands wall.toml                 does it stand under its own weight?
  fenics-contact solve wall.toml -o out           how much load until it collapses?
  fenics-contact report out --pdf wall.pdf        to hand over

exit codes: 0 solved, 2 wrong input, 3 the dead load has no equilibrium, 4 not converged
units of scene files: N, m, Pa, kg; `fenics-contact COMMAND --help` has the options of a command"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 solved, 2 bad input, 3 unstable, 4 not)."""
    if message := missing_requirements(mesh=False):
        _parser().parse_args(arguments)  # answers --help and --version
        print(f"fenics-contact: {message}", file=sys.stderr)
        return BAD_INPUT
    from fenics_contact.parallel import MPI

    atexit.register(gc.freeze)  # the last search for garbage: all is freed with the process
    comm = MPI.COMM_WORLD
    with _output_may_close():
        with open(os.devnull, "w") as nothing, contextlib.ExitStack() as stack:
            if comm.rank != 0:  # rank 0 alone prints what argparse has to say
                stack.enter_context(contextlib.redirect_stdout(nothing))
                stack.enter_context(contextlib.redirect_stderr(nothing))
            options = _parser().parse_args(arguments)
        logging.getLogger().setLevel(logging.WARNING)  # form compilers are talkative
        log = logging.getLogger("fenics_contact")
        log.propagate = False
        handler = logging.StreamHandler(sys.stdout)
        handler.addFilter(Once())
        log.handlers[:] = [handler]
        level = logging.INFO if options.verbose else logging.WARNING
        log.setLevel(level if comm.rank == 0 and not options.quiet else logging.CRITICAL)
        return _run(options, comm)


def _run(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Exit code of a command; an error that is no bug of the program is one line."""
    try:
        with _beside(options, comm) as options.beside:
            return _command(options.command)(options, comm)
    except ContactError as error:
        if comm.rank == 0:
            text = f"not solved: {error}" if isinstance(error, SolverError) else str(error)
            # One line, whatever names and texts of the user are in it.
            line = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
            if len(line) > LONGEST_LINE:
                line = f"{line[: LONGEST_LINE // 2]} ... {line[-LONGEST_LINE // 2 :]}"
            print(f"fenics-contact: {line}", file=sys.stderr)
        return error.exit_code
    except MissingError as error:
        print(str(error).replace("fenics_contact", "fenics-contact", 1), file=sys.stderr)
        code = BAD_INPUT
    except KeyboardInterrupt:
        code = INTERRUPTED
    except OSError as error:
        print("fenics-contact:", " ".join(str(error).split()), file=sys.stderr)
        code = FAILED
    except Exception:
        if comm.size == 1:
            raise
        traceback.print_exc()
        code = FAILED
    # This rank leaves its work; the others would wait for it.
    sys.stderr.flush()
    if comm.size > 1:
        comm.Abort(code)
    return code


def _beside(options: argparse.Namespace, comm: MPI.Comm) -> Executor:
    """Processes for `--jobs`, which import what they need while this one does.

    A sweep waits for its processes, so that a row is on the disk as its point ends; so does the
    table of mechanisms.
    """
    count = getattr(options, "jobs", 1)
    if comm.size > 1 or count < 2:
        return InPlace()
    return Processes(count if options.command in ("sweep", "mechanisms") else count - 1)


def _command(name: str) -> Command:
    """What a command does, imported only now: to parse a command line takes a tenth of the time."""
    gc.disable()
    found: Command = _mesh
    if name != "mesh":
        found = getattr(import_module("fenics_contact.cli.commands"), name)
    gc.freeze()  # modules stay: no search for garbage need look at them
    gc.enable()
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # PETSc, just imported, ends the program at it
    return found


def _mesh(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Mesh a drawing on rank 0 and say what was made; it needs no solver."""
    from fenics_contact.geometry.dxf.command import MeshOrder, mesh_drawing
    from fenics_contact.geometry.dxf.roles import LayerRoles

    layers = {
        role: tuple(
            name.strip()
            for text in getattr(options, role)  # names with commas between them, or one by one
            for name in text.split(",")
            if name.strip()
        )
        for role in ("blocks", "lines", "voids", "ignore")
    }
    order = MeshOrder(
        options.drawing,
        options.output,
        options.size,
        options.unit,
        LayerRoles(**layers),
        options.picture,
        options.scene,
        options.close,
        options.snap,
    )
    with raised_together(comm):
        if comm.rank == 0:
            lines = mesh_drawing(order).lines
            if not options.quiet:
                print("\n".join(lines))
    return 0


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
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    # MPI takes a second to end, in which Ctrl-C would be a traceback.
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_DFL)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names may have letters that it lacks
            stream.reconfigure(errors="backslashreplace")
    out = _Output(sys.stdout)
    err = _Output(sys.stderr)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):  # type: ignore[type-var]
        try:
            yield
        finally:
            out.flush()
            err.flush()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fenics-contact",
        description="Limit loads of blocks in contact with friction: how much load a wall, arch or"
        "\nbridge of blocks stands before it collapses, and how it fails.",
        epilog=STEPS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)

    def command(name: str, what: str) -> Callable[..., Any]:
        made = commands.add_parser(name, help=what)
        loud = made.add_mutually_exclusive_group()
        text = "say all: path, brackets, residuals, work"
        loud.add_argument("-v", "--verbose", action="store_true", help=text)
        loud.add_argument("-q", "--quiet", action="store_true", help="say nothing but errors")
        return made.add_argument

    def of_scene(name: str, what: str, folder: str = "") -> Callable[..., Any]:
        add = command(name, what)
        add("scene", type=Path, help="scene file (TOML)")
        text = "change a value of the scene file, e.g. joints.default.friction=0.5"
        style = {"metavar": "KEY=VALUE", "dest": "overrides", "default": []}
        add("--set", action="append", help=text, **style)
        if folder:
            text = f"where to write ({folder})"
            add("-o", "--output", type=Path, metavar="DIR", help=text)
        return add

    add = of_scene("solve", "compute the limit load of a scene", "SCENE without ending")
    add("--fast", action="store_true", help="the load factor and its bracket alone, verified")
    text = "draw all pictures now, in the plane forces and thrust, of a mesh scene and stress, too"
    add("--pictures", action="store_true", help=text)
    add("--jobs", type=int, default=1, metavar="N", help="processes that share its tasks (1)")

    of_scene("check", "read a scene, say what is in it, solve nothing")

    add = of_scene("stands", "does it stand: the state under the dead load", "SCENE_state")
    text = "multiple of the live load that acts too (0: none, and the scene needs none)"
    add("--load-factor", type=float, default=0.0, metavar="X", help=text)

    add = command("report", "put the result in a folder on one page (HTML)")
    add("folder", type=Path, metavar="DIR", help="where `solve` wrote to")
    add("-o", "--output", type=Path, metavar="FILE.html", help="(DIR/report.html)")
    add("--pdf", type=Path, metavar="FILE", help="PDF too (needs WeasyPrint)")
    add("--project", default="", metavar="TEXT", help="project, on page 1")
    add("--author", default="", metavar="TEXT", help="author, on page 1")

    add = command("mesh", "mesh a DXF drawing of blocks for gmsh")
    text = "drawing: closed polylines or faces between lines are blocks"
    add("drawing", type=Path, help=text)
    for role, text in (
        ("blocks", "whose closed polylines are blocks"),
        ("lines", "of joints and outlines: the faces between their lines are blocks"),
        ("voids", "of openings"),
        ("ignore", "that are no part of the structure"),
    ):
        style = {"action": "append", "default": [], "metavar": "LAYERS"}
        add(f"--{role}", help=f"layers {text}", **style)
    add("--size", type=float, metavar="M", help="length of elements, m")
    add("--unit", help="of the drawing, if it says none: mm, cm, dm, m, in or ft")
    text = "let stones grow to the middle of their mortar joints"
    add("--close", action="store_true", help=text)
    text = "ends of lines go to where they meet another within it, in the drawing's unit"
    add("--snap", type=float, default=0.0, metavar="LENGTH", help=text)
    add("-o", "--output", type=Path, metavar="FILE", help="the mesh, .msh")
    add("--picture", type=Path, metavar="FILE", help="picture of what was read")
    add("--scene", type=Path, metavar="FILE", help="write a scene to begin with, .toml")

    goes_on = "SCENE_sweep; a sweep that was stopped goes on there"
    add = of_scene("sweep", "compute the limit load over values of a scene's keys", goes_on)
    text = (
        "N values from A to B, or KEY=A,B,C; KEY,KEY=... gives keys the same values; several"
        " --vary: all combinations"
    )
    add("--vary", action="append", required=True, metavar="KEY=A:B:N", help=text)
    add("--jobs", type=int, default=1, metavar="N", help="processes (1)")

    what = "mechanisms of the walls, corners and storeys of rigid blocks, and of the whole"
    add = of_scene("mechanisms", what, "SCENE_mechanisms")
    text = "part, group or block whose contacts are repaired; * stands for anything"
    add("--exclude", action="append", default=[], metavar="NAME", help=text)
    text = "directions of the whole in plan, degrees from x to y, or A,B,C (along the axes)"
    add("--angles", default="", metavar="A:B:N", help=text)
    add("--jobs", type=int, default=1, metavar="N", help="processes (1)")
    return parser
