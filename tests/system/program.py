"""The program as a user runs it: subprocesses, small meshes, scene files."""

from __future__ import annotations

import copy
import json
import logging
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.meshing import model_from_arrays, polygons, running_bond, wall
from tests.bank import sides
from tests.drawing import rectangle

ROOT = Path(__file__).resolve().parents[2]

#: A hang is a failure; nothing here takes more than a few seconds.
TIMEOUT = 180.0

#: A block of 1 m x 0.5 m on rigid ground, its weight times the load factor pushing to the right.
BLOCK: dict[str, Any] = {
    "mesh": {"file": "block.msh"},
    "materials": {"default": {"young": 1.0e9, "poisson": 0.2, "density": 1000.0}},
    "joints": {"default": {"friction": 0.3}},
    "foundations": {"base": {"friction": 0.3}},
    "loads": {"dead": {"body": [0.0, -9.81]}, "live": {"body": [9.81, 0.0]}},
}

#: Neither fields nor pictures: a start then takes half the time.
QUIET: dict[str, Any] = {"output.paraview": False, "output.pictures": False}

#: In place of a value: leave the key out.
LEFT_OUT = object()


@dataclass(frozen=True)
class Run:
    """What a run of the program left behind."""

    code: int
    out: str
    err: str


def launcher(ranks: int) -> list[str]:
    """What a command line on so many ranks begins with."""
    return [] if ranks == 1 else ["mpirun", "--oversubscribe", "-n", str(ranks)]


def command(arguments: Sequence[str | Path], ranks: int = 1) -> list[str]:
    """The command line of the program on so many ranks."""
    return [*launcher(ranks), sys.executable, "-m", "fenics_contact", *map(str, arguments)]


def environment() -> dict[str, str]:
    """Environment of the program: this checkout, one thread, and no trace of an outer MPI.

    Compiled modules are kept: a start then takes a third of the time.
    """
    outer = ("OMPI_", "PMIX_", "PRTE_", "PYTHONDONTWRITEBYTECODE")
    ours = {name: value for name, value in os.environ.items() if not name.startswith(outer)}
    return ours | {
        "PYTHONPATH": str(ROOT),
        "OMP_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_btl": "^tcp",  # one machine: no network, which containers may lack
        "OMPI_MCA_mpi_yield_when_idle": "1",  # ranks that wait leave the core to others
    }


def run(arguments: Sequence[str | Path], folder: Path, ranks: int = 1) -> Run:
    """Run the program in a folder; a run that hangs raises `subprocess.TimeoutExpired`."""
    return run_command(command(arguments, ranks), folder)


def run_command(line: Sequence[str], folder: Path, time_out: float = TIMEOUT) -> Run:
    """Run a command in a folder and the environment of the program.

    Raises:
        subprocess.TimeoutExpired: If it takes longer than `time_out` seconds; it is ended then.
    """
    with subprocess.Popen(
        line,
        cwd=folder,
        env=environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            out, err = process.communicate(timeout=time_out)
        except subprocess.TimeoutExpired:
            stop(process)
            raise
    return Run(process.returncode, out, err)


def stop(process: subprocess.Popen) -> None:
    """End a hanging run; mpirun must be asked, so that it ends its ranks first."""
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(timeout=10.0)
    except subprocess.TimeoutExpired:
        process.kill()


def run_here(arguments: Sequence[str | Path], capsys: Any) -> Run:
    """Run the command line in this process, which saves the start of another."""
    from fenics_contact.cli import main

    loggers = [logging.getLogger(), logging.getLogger("fenics_contact")]
    before = [(log.level, log.propagate, log.handlers[:]) for log in loggers]
    capsys.readouterr()
    try:
        code = main([str(argument) for argument in arguments])
    except SystemExit as stopped:  # from argparse
        code = int(stopped.code or 0)
    finally:
        for log, (level, propagate, handlers) in zip(loggers, before, strict=True):
            log.setLevel(level)
            log.propagate, log.handlers[:] = propagate, handlers
    printed = capsys.readouterr()
    return Run(code, printed.out, printed.err)


def files(folder: Path) -> set[str]:
    """All files and folders below a folder."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def result(folder: Path) -> dict[str, Any]:
    """result.json of a folder, which must be strict JSON."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not JSON")

    return json.loads((folder / "result.json").read_text(), parse_constant=refuse)


def write_scene(
    folder: Path,
    changes: Mapping[str, Any] | None = None,
    mesh: str = "block",
    name: str = "scene.toml",
) -> Path:
    """Write a mesh and a scene: `BLOCK` with changes, given as values by dotted key."""
    write_mesh(folder / f"{mesh}.msh", mesh)
    path = folder / name
    path.write_text(toml(changed({"mesh.file": f"{mesh}.msh", **(changes or {})})))
    return path


def changed(changes: Mapping[str, Any]) -> dict[str, Any]:
    """`BLOCK` with other values at dotted keys."""
    scene = copy.deepcopy(BLOCK)
    for key, value in changes.items():
        *tables, last = key.split(".")
        table = scene
        for name in tables:
            table = table.setdefault(name, {})
        table[last] = value
        if value is LEFT_OUT:
            del table[last]
    return scene


def toml(scene: Mapping[str, Any]) -> str:
    """A scene as TOML, a line for every key of the first level."""
    return "".join(f"{name} = {_value(value)}\n" for name, value in scene.items())


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name} = {_value(v)}" for name, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value) if isinstance(value, (str, bool)) else repr(value)


def write_mesh(path: Path, name: str) -> None:
    """Write one of `MESHES`."""
    import gmsh

    MESHES[name]()  # starts gmsh
    try:
        gmsh.write(str(path))
    finally:
        gmsh.option.setNumber("Mesh.SaveAll", 0)
        gmsh.model.remove()


def _stack() -> Any:
    """Two blocks of 1 m x 0.5 m, "low" and "high"; "side" is the left of the low one."""
    groups = sides(base=(0, 0, 1, 0), bed=(0, 0.5, 1, 0.5), side=(0, 0, 0, 0.5))
    blocks = [rectangle(0, 0, 1, 0.5), rectangle(0, 0.5, 1, 1)]
    return polygons(blocks, 0.25, ["low", "high"], groups)


def _apart() -> Any:
    """A block on the ground and one in the air above it."""
    return polygons([rectangle(0.0, 0.0, 1.0, 0.5), rectangle(0.0, 1.0, 1.0, 1.5)], 0.25)


def _overhang() -> Any:
    """Three blocks, each 0.4 m further out than the one below: the upper two must fall."""
    steps = [(0.4 * k, 0.2 * k) for k in range(3)]
    return polygons([rectangle(x, y, x + 1.0, y + 0.2) for x, y in steps], 0.1)


def _incline(slope: float) -> Any:
    """A block of 1 m x 0.25 m on ground that falls to the right with a slope."""
    along = np.array([1.0, -slope]) / np.hypot(1.0, slope)
    up = 0.25 * np.array([-along[1], along[0]])
    outline = [np.zeros(2), along, along + up, up]
    return polygons([outline], 0.125, groups={"base": [(outline[0], outline[1])]})


def _almost() -> Any:
    """Two blocks 3 mm apart, with one facet below and two of 1 m above."""
    low, high = [(0, 0), (2, 0), (2, 1), (0, 1)], [(0, 1.003), (1, 1.003), (2, 1.003)]
    points = [*low, *high, (2, 2), (0, 2)]
    cells = [(0, 1, 2), (0, 2, 3), (4, 5, 8), (5, 7, 8), (5, 6, 7)]
    facets = {"base": [(0, 1)], "bed": [(2, 3), (4, 5), (5, 6)]}
    return model_from_arrays(points, {"blocks": cells}, facets)


def _no_surface_group() -> Any:
    """The block without the group of its surface."""
    import gmsh

    model = wall([[1.0]], (1.0, 0.5))
    model.removePhysicalGroups(model.getPhysicalGroups(2))
    gmsh.option.setNumber("Mesh.SaveAll", 1)
    return model


MESHES: dict[str, Callable[[], Any]] = {
    "block": lambda: wall([[1.0]], (1.0, 0.5)),
    "tower": lambda: wall([[1.0], [1.0]], (0.5, 0.5)),
    "wall": lambda: running_bond(2, 2),
    "long wall": lambda: running_bond(20, 20),
    "stack": _stack,
    "apart": _apart,
    "overhang": _overhang,
    "steep": lambda: _incline(0.4),
    "gentle": lambda: _incline(0.2),
    "almost": _almost,
    "no_surface_group": _no_surface_group,
}
