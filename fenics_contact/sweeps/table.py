"""The table of a sweep in its folder: a row as each point ends, and what it is a sweep of."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

from fenics_contact.errors import InputError, OutputError
from fenics_contact.exit_codes import EXIT_CODES
from fenics_contact.sweeps.parameters import Family, Parameter
from fenics_contact.sweeps.points import WRONG_INPUT, Point, value_text
from fenics_contact.version import __version__

TABLE, RECORD = "sweep.csv", "sweep.json"
#: Columns after those of the keys.
COLUMNS = tuple(item.name for item in fields(Point) if item.name != "values")
_FLOATS = tuple(item.name for item in fields(Point) if item.type == "float")
_STATUSES = (*EXIT_CODES, WRONG_INPUT)


class Table:
    """Rows of a sweep on the disk, of one process.

    Its methods raise `OutputError` where the folder cannot be written to.
    """

    def __init__(self, folder: Path, keys: Sequence[str]) -> None:
        """Name the folder and the varied keys."""
        self.path = folder / TABLE
        self._keys = tuple(keys)

    def begin(self, record: Mapping[str, Any]) -> list[Point]:
        """Rows of the same sweep that are there already; the folder is made if need be.

        Raises:
            InputError: If the folder has another sweep, or files that were changed by hand and
                cannot be read.
        """
        folder = self.path.parent
        described = folder / RECORD
        with self._told():
            folder.mkdir(parents=True, exist_ok=True)
            before = _record(described) if described.exists() else None
            same = "mesh" in record and before == json.loads(json.dumps(record))
            if before is not None and not same:  # the mesh of a scene made in Python has no record
                raise InputError(
                    f"'{folder}' has a sweep of another scene or other values; choose another"
                    " folder (-o on the command line), or remove that one"
                )
            rows = self._rows() if before is not None else []
            self.write(rows)  # without a half-written line
            _replace(described, json.dumps(record, indent=2) + "\n")
        return rows

    def append(self, point: Point) -> None:
        """Add a row; it is on the disk when this returns."""
        with self._told(), self.path.open("a", newline="") as file:
            self._put(file, [point])
            file.flush()
            os.fsync(file.fileno())

    def write(self, points: Sequence[Point]) -> None:
        """Replace all rows."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow([*self._keys, *COLUMNS])
        self._put(text, points)
        with self._told():
            _replace(self.path, text.getvalue())

    def _put(self, file: Any, points: Sequence[Point]) -> None:
        """Write rows: numbers with all their digits, nothing for nan."""
        for point in points:
            cells = [getattr(point, name) for name in COLUMNS]
            cells = ["" if isinstance(x, float) and math.isnan(x) else x for x in cells]
            values = [value_text(point.values[key]) for key in self._keys]
            csv.writer(file, lineterminator="\n").writerow(values + cells)

    def _rows(self) -> list[Point]:
        """Complete rows of the file."""
        if not self.path.exists():
            return []
        text = self.path.read_text()
        rows = csv.DictReader(io.StringIO(text[: text.rfind("\n") + 1]))
        if rows.fieldnames is None:
            return []
        if list(rows.fieldnames) != [*self._keys, *COLUMNS]:
            raise InputError(
                f"'{self.path}' has other columns than this sweep; put its first line right, or"
                " remove the file to solve all points again"
            )
        return [self._point(rows.line_num, row) for row in rows if None not in row.values()]

    def _point(self, number: int, row: Mapping[str, str]) -> Point:
        """Point of a row, which has a number for messages."""
        try:
            numbers: dict[str, Any] = {name: float(row[name] or math.nan) for name in _FLOATS}
            numbers["factorizations"] = int(float(row["factorizations"]))  # 14.0 by a spreadsheet
            if row["status"] not in _STATUSES:
                raise ValueError(f"unknown status '{row['status']}'")
        except (ValueError, OverflowError) as error:
            raise InputError(
                f"'{self.path}', line {number}, cannot be read: {error}; remove the line to solve"
                " its point again"
            ) from None
        values = {key: _value(row[key]) for key in self._keys}
        return Point(values, row["status"], reason=row["reason"], **numbers)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Name the folder where a file cannot be read or written."""
        try:
            yield
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            reason = getattr(error, "strerror", None) or error
            other = "choose another folder (-o on the command line)"
            raise OutputError(f"cannot write to '{self.path.parent}': {reason}; {other}") from None


def described(family: Family, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """What tells a sweep from others: version, scene, meshes and values. On one rank."""
    meshes = {str(family.tables.get("mesh", {}).get("file", ""))}
    for parameter in parameters:
        if "mesh.file" in parameter.keys:
            meshes = {str(value) for value in parameter.values}
    solved = {k: v for k, v in family.tables.items() if k not in ("title", "output")}
    tables = json.dumps(solved, sort_keys=True, default=str).encode()
    record = {"version": __version__, "scene": hashlib.sha256(tables).hexdigest()}
    if family.file is not None:
        folder = family.file.parent
        files = [hashlib.sha256((folder / name).read_bytes()) for name in sorted(meshes)]
        record["mesh"] = " ".join(one.hexdigest() for one in files)
    vary = {", ".join(parameter.keys): list(parameter.values) for parameter in parameters}
    return {**record, "vary": vary}


def _record(path: Path) -> Any:
    """What a file says that a sweep is of."""
    try:
        return json.loads(path.read_text())
    except (ValueError, RecursionError) as error:  # a byte that is no text is a ValueError
        raise InputError(
            f"'{path}' cannot be read: {error}; choose another folder (-o on the command line), or"
            " remove that one"
        ) from None


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


def _replace(path: Path, text: str) -> None:
    """Write a file that is complete whenever it is there."""
    hidden = path.with_name(f".{path.name}.new")
    hidden.write_text(text)
    os.replace(hidden, path)
