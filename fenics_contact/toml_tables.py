"""Scene files: TOML in, `Scene` out; every message names the key that is wrong."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.errors import InputError, raised_together
from fenics_contact.mesh import BlockMesh
from fenics_contact.scene import JointLaw, Load, Material, OutputOptions, Scene, SolveOptions

Table = Mapping[str, Any]


def read_scene(
    path: str | Path, comm: MPI.Comm | None = None, overrides: Sequence[str] = ()
) -> Scene:
    """Read a scene file and its mesh.

    Args:
        path: The TOML file; its mesh is found relative to it.
        comm: Communicator; the one PETSc was started with when not given.
        overrides: Assignments "joints.default.friction=0.5" made on top of the file.

    Raises:
        InputError: On all ranks, if the file or its mesh is missing or wrong.
    """
    comm = compat.default_comm() if comm is None else comm
    path = Path(path)
    text = ""
    with raised_together(comm):
        if comm.rank == 0:
            text = _read_text(path)
    table = _parse(comm.bcast(text), path)
    for override in overrides:
        _override(table, override)
    parts = _parts(table)
    file = parts.pop("file")
    return Scene(mesh=BlockMesh.from_file(path.parent / file, comm), **parts)


def _read_text(path: Path) -> str:
    try:
        return path.read_text()
    except FileNotFoundError:
        raise InputError(f"scene file '{path}' does not exist") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"scene file '{path}' cannot be read: {error}") from None


def _parse(text: str, path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"scene file '{path}' is not TOML: {error}") from None


def _override(table: dict[str, Any], assignment: str) -> None:
    key, equals, text = assignment.partition("=")
    names = [name.strip() for name in key.split(".")]
    if not equals or not all(names):
        raise InputError(f"'--set {assignment}' is not of the form key=value")
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()  # a string without quotes
    for name in names[:-1]:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise InputError(f"'--set {assignment}': '{name}' is not a table")
    table[names[-1]] = value


def _parts(table: Table) -> dict[str, Any]:
    """Keyword arguments of `Scene`, and the mesh's file."""
    _known("", table, {"title", "mesh", "plane", "materials", "supports", "joints",
                       "foundations", "loads", "solve", "output"})  # fmt: skip
    mesh = _table(table, "mesh")
    _known("mesh", mesh, {"file", "degree"})
    plane = _table(table, "plane")
    _known("plane", plane, {"state"})
    loads = _table(table, "loads")
    _known("loads", loads, {"dead", "live"})
    if "file" not in mesh:
        raise InputError('mesh.file is missing; name the gmsh file, [mesh] file = "wall.msh"')
    if not mesh["file"]:
        raise InputError("mesh.file is empty; name the gmsh file")
    if "live" not in loads:
        raise InputError("loads.live is missing; give the load to be multiplied, [loads.live]")
    if not _table(table, "materials"):
        raise InputError("materials is missing; give at least [materials.default]")
    return {
        "file": _text("mesh.file", mesh["file"]),
        "degree": _whole("mesh.degree", mesh.get("degree", 1)),
        "plane": _text("plane.state", plane.get("state", "strain")),
        "title": _text("title", table.get("title", "")),
        "materials": _each(table, "materials", _material),
        "supports": _each(table, "supports", _text),
        "joints": _each(table, "joints", _law),
        "foundations": _each(table, "foundations", _law),
        "dead": _load("loads.dead", _table(loads, "dead", "loads.")),
        "live": _load("loads.live", _table(loads, "live", "loads.")),
        "solve": _solve(_table(table, "solve")),
        "output": _output(_table(table, "output")),
    }


def _material(key: str, value: Any) -> Material:
    table = _as_table(key, value)
    _known(key, table, {"young", "poisson", "density"})
    for name in ("young", "poisson"):
        if name not in table:
            raise InputError(f"{key}.{name} is missing")
    with _named(key):
        return Material(**{name: _number(f"{key}.{name}", v) for name, v in table.items()})


def _law(key: str, value: Any) -> JointLaw:
    table = _as_table(key, value)
    _known(key, table, {"friction", "law", "bound"})
    with _named(key):
        return JointLaw(
            law=_text(f"{key}.law", table.get("law", "coulomb")),
            friction=_number(f"{key}.friction", table["friction"]) if "friction" in table else None,
            bound=_number(f"{key}.bound", table["bound"]) if "bound" in table else None,
        )


def _load(key: str, table: Table) -> Load:
    _known(key, table, {"body", "traction"})
    traction = _as_table(f"{key}.traction", table.get("traction", {}))
    with _named(key):
        return Load(
            body=_pair(f"{key}.body", table.get("body", (0.0, 0.0))),
            traction={n: _pair(f"{key}.traction.{n}", v) for n, v in traction.items()},
        )


def _solve(table: Table) -> SolveOptions:
    _known("solve", table, {"method", "direction", "tolerance", "control", "slip", "states"})
    with _named("solve"):
        return SolveOptions(
            method=_text("solve.method", table.get("method", "auto")),
            direction=_text("solve.direction", table.get("direction", "positive")),
            tolerance=_number("solve.tolerance", table.get("tolerance", 1e-6)),
            control=_text("solve.control", table.get("control", "work")),
            slip=_text("solve.slip", table.get("slip", "stress-free")),
            states=_text("solve.states", table.get("states", "first")),
        )


def _output(table: Table) -> OutputOptions:
    _known("output", table, {"paraview", "pictures", "capacity"})
    with _named("output"):
        return OutputOptions(
            paraview=_flag("output.paraview", table.get("paraview", True)),
            pictures=_flag("output.pictures", table.get("pictures", True)),
            capacity=_whole("output.capacity", table.get("capacity", 0)),
        )


@contextmanager
def _named(key: str) -> Iterator[None]:
    """Put the key before messages of the scene's own checks."""
    try:
        yield
    except InputError as error:
        message = str(error)
        raise InputError(message if message.startswith(key) else f"{key}.{message}") from None


def _known(key: str, table: Table, names: set[str]) -> None:
    for name in table:
        if name not in names:
            close = difflib.get_close_matches(name, names, 1)
            hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(sorted(names))}"
            raise InputError(f"unknown key '{f'{key}.' if key else ''}{name}'; {hint}")


def _table(table: Table, name: str, prefix: str = "") -> Table:
    return _as_table(prefix + name, table.get(name, {}))


def _as_table(key: str, value: Any) -> Table:
    if not isinstance(value, Mapping):
        raise InputError(f"{key} = {value!r} must be a table, [{key}]")
    return value


def _each(table: Table, name: str, read: Callable[[str, Any], Any]) -> dict[str, Any]:
    return {key: read(f"{name}.{key}", value) for key, value in _table(table, name).items()}


def _number(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{key} = {value!r} must be a number")
    try:
        return float(value)
    except OverflowError:
        raise InputError(f"{key} is too large a number") from None


def _whole(key: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{key} = {value!r} must be a whole number")
    return value


def _flag(key: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{key} = {value!r} must be true or false")
    return value


def _text(key: str, value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(f"{key} = {value!r} must be a string")
    return value


def _pair(key: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise InputError(f"{key} = {value!r} must be two numbers, [x, y]")
    return _number(key, value[0]), _number(key, value[1])
