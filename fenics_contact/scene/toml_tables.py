"""TOML tables -> checked dataclasses, by their fields and defaults; messages name the key."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from fenics_contact.errors import (
    InputError,
    as_mapping,
    check_type,
    key_of,
    kind_of,
    raised_together,
    require,
    shown,
    with_floats,
)
from fenics_contact.parallel import MPI

T = TypeVar("T")

#: Tables within tables that a file may have.
DEEPEST = 20
#: Bytes that a file may have: 60 000 blocks by their corners, which take a minute to read.
LARGEST = 32_000_000
#: Tables of tables in which one can be named "default".
WITH_DEFAULT = ("materials", "joints")
#: Points in one dotted key that the parser takes in less than a second.
DOTTED = 1000


def read_toml(path: Path, comm: MPI.Comm, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Tables of a TOML file, read on rank 0, with assignments "a.b=1" made on top of it.

    Raises:
        InputError: On all ranks, if the file is missing or not TOML, or an assignment is wrong.
    """
    tables: dict[str, Any] = {}
    with raised_together(comm):
        if comm.rank == 0:
            tables = _read(path)
            _check_depth(tables, f"file '{path}'")
    tables = comm.bcast(tables)
    for assignment in overrides:
        key, equals, text = assignment.partition("=")
        names = [name.strip() for name in key.split(".")]
        given = f"'--set {assignment}'"
        require(bool(equals) and all(names), f"{given} is not of the form key=value")
        problem = "has more than one line, or characters of control"
        require(assignment.isprintable(), f"{given} {problem}")
        value = value_of(text)
        _check_depth([value], f"'--set {names[0]}'")
        deep = f"'--set {key}' has more than {DEEPEST} tables in tables"
        require(len(names) <= DEEPEST, deep)
        try:
            assign(tables, key, value)
        except InputError as error:
            raise InputError(f"{given}: {error}") from None
    return tables


def _read(path: Path) -> dict[str, Any]:
    """Tables of a file; a byte order mark, as some editors write, is left out."""
    try:
        pipe = path.is_fifo()  # nobody may ever write to it
        require(not pipe, f"'{path}' is a pipe; give a scene file")
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
        text = f"file '{path}' has more than {LARGEST} bytes; give a scene file"
        require(len(data) <= LARGEST, text)
        keys = re.split(rb"[\r\n,=\[\]{}]", data.translate(None, b" \t"))
        if max(key.count(b".") for key in keys) > DOTTED:
            raise RecursionError
        return tomllib.loads(data.decode("utf-8-sig"))
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"file '{path}' does not exist") from None
    except IsADirectoryError:
        raise InputError(f"'{path}' is a folder; give a scene file") from None
    except OSError as error:
        raise InputError(f"file '{path}' cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        problem = f"is not UTF-8 text: byte {error.start}; save it as UTF-8"
        raise InputError(f"file '{path}' {problem}") from None
    except RecursionError:
        raise InputError(f"file '{path}' has more than {DEEPEST} tables in tables") from None
    except ValueError as error:  # tomllib's own, and that of a whole number too long for Python
        hint = "" if path.suffix == ".toml" else "; give a scene file"
        raise InputError(f"file '{path}' is not TOML: {error}{hint}") from None


def _check_depth(tables: Any, source: str) -> None:
    """Refuse what cannot be sent to other ranks, nor printed."""
    level = [tables]
    for _ in range(DEEPEST):
        level = [x for item in level for x in (item.values() if isinstance(item, dict) else item)]
        level = [item for item in level if isinstance(item, (dict, list))]
    require(not level, f"{source} has more than {DEEPEST} tables in tables")


def is_of_blocks(tables: Mapping[str, Any]) -> bool:
    """Whether the tables of a file are of rigid blocks without a mesh.

    Raises:
        InputError: If they are of a structure in neither the plane nor space, or have a mesh, too.
    """
    dimension = tables.get("dimension", 2)
    require(dimension in (2, 3), f"dimension = {shown(dimension)} must be 2 or 3")
    both = dimension == 2 and "blocks" in tables and "mesh" in tables
    require(not both, "blocks: give either [mesh], or [blocks] without one")
    return dimension == 3 or "blocks" in tables


def from_table(kind: type[T], table: Any, key: str = "") -> T:
    """A dataclass from a TOML table; `key` is the table's name, empty for a whole file.

    A field is read by its type: a number, string, flag, pair of numbers, list of pairs or strings,
    another dataclass, or a mapping of names to any of these. A dataclass with a default may be left
    out like its fields.

    Raises:
        InputError: If a key is unknown or missing, or a value is wrong for its type or dataclass.
    """
    prefix = f"{key}." if key else ""
    table = as_mapping(key, table)
    kinds = get_type_hints(kind)
    refuse_unknown(key, table, [key_of(item.name) for item in fields(kind)])  # type: ignore[arg-type]
    values = {}
    for item in fields(kind):  # type: ignore[arg-type]
        name = key_of(item.name)
        inner = prefix + name
        nested = is_dataclass(kinds[item.name])
        if name in table:
            values[item.name] = _value(inner, table[name], kinds[item.name])
        elif item.default is MISSING and item.default_factory is MISSING:
            cure = f"; give [{inner}]{item.metadata.get('hint', '')}" if nested else ""
            raise InputError(f"{inner} is missing{cure}")
        elif nested:
            values[item.name] = from_table(kinds[item.name], {}, inner)
    try:
        return kind(**values)
    except InputError as error:
        raise InputError(f"{prefix}{error}") from None


def refuse_unknown(key: str, table: Iterable[str], known: Collection[str]) -> None:
    """Refuse keys of a table that are none of those known.

    Raises:
        InputError: The message names the nearest one, or all.
    """
    prefix = f"{key}." if key else ""
    for name in [name for name in table if name not in known]:
        close = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(sorted(known))}"
        raise InputError(f"unknown key '{prefix}{name}'; {hint}")


def _value(key: str, value: Any, kind: Any) -> Any:
    """A value of a file as its field has it."""
    kind = kind_of(value, kind)
    if is_dataclass(kind):
        return from_table(kind, value, key)  # type: ignore[arg-type]
    if get_origin(kind) is Mapping:
        inner = get_args(kind)[1]
        table = as_mapping(key, value)
        # What belongs into one of these tables is refused beside them.
        known = [key_of(item.name) for item in fields(inner)] if is_dataclass(inner) else []
        default = f" or [{key}.default]" if key in WITH_DEFAULT else ""
        for name, item in table.items():
            if name in known and not isinstance(item, Mapping):
                text = f"[{key}] has no name; give [{key}.NAME]{default}"
                raise InputError(f"{key}.{name} = {shown(item)}: {text}")
        return {name: _value(f"{key}.{name}", item, inner) for name, item in table.items()}
    if get_origin(kind) is tuple and is_dataclass(get_args(kind)[0]) and isinstance(value, list):
        inner = get_args(kind)[0]
        return tuple(_value(f"{key}[{n}]", item, inner) for n, item in enumerate(value))
    check_type(key, value, kind)
    return with_floats(value, kind)


def value_of(text: str) -> Any:
    """A TOML value; a string may go without quotes."""
    try:
        return tomllib.loads(f"value = {text.strip()}")["value"]
    except (ValueError, RecursionError):
        return text.strip()


def assign(table: dict[str, Any], key: str, value: Any) -> None:
    """Give a key "a.b.c" of tables a value; tables that are missing are made.

    Raises:
        InputError: If there is no table where the key has one.
    """
    *names, last = (name.strip() for name in key.split("."))
    for name in names:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise InputError(f"'{name}' is not a table")
    table[last] = value
