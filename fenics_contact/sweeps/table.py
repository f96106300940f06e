"""The table of a sweep in its folder: a row as each point ends, and what it is a sweep of."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from fenics_contact.errors import InputError
from fenics_contact.exit_codes import EXIT_CODES
from fenics_contact.output.folder import replace_file
from fenics_contact.sweeps.parameters import Family, Parameter
from fenics_contact.sweeps.points import WRONG_INPUT, Point, value_text
from fenics_contact.version import __version__

TABLE, RECORD = "sweep.csv", "sweep.json"
#: Columns after those of the keys.
COLUMNS = tuple(item.name for item in fields(Point) if item.name != "values")
_FLOATS = tuple(item.name for item in fields(Point) if item.type == "float")
#: Load factors are in their brackets up to this times the tolerance: certificates leave some.
AGREE = 10.0
_STATUSES = (*EXIT_CODES, WRONG_INPUT)


class Table:
    """Rows of a sweep on the disk, of one process.

    Its methods raise `OSError` where the folder cannot be written to.
    """

    def __init__(self, folder: Path, keys: Sequence[str], tolerance: float) -> None:
        """Name the folder and the varied keys; the tolerance is that of load factors, relative."""
        self.path = folder / TABLE
        self._tolerance = tolerance
        self._keys = tuple(keys)

    def begin(self, record: Mapping[str, Any]) -> list[Point]:
        """Rows of the same sweep that are there already; the folder is made if need be.

        Raises:
            InputError: If the folder has another sweep, or files that were changed by hand and
                cannot be read.
        """
        folder = self.path.parent
        described = folder / RECORD
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
        replace_file(described, (json.dumps(record, indent=2) + "\n").encode())
        return rows

    def append(self, point: Point) -> None:
        """Add a row; it is on the disk when this returns."""
        with self.path.open("a", encoding="utf-8", newline="") as file:
            self._put(file, [point])
            file.flush()
            os.fsync(file.fileno())

    def write(self, points: Sequence[Point]) -> None:
        """Replace all rows."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow([*self._keys, *COLUMNS])
        self._put(text, points)
        replace_file(self.path, text.getvalue().encode())

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
        try:
            text = self.path.read_bytes().decode("utf-8-sig")
            table = csv.DictReader(io.StringIO(text[: text.rfind("\n") + 1]))
            rows = [(table.line_num, row) for row in table]
        except (UnicodeDecodeError, csv.Error) as error:
            raise InputError(
                f"'{self.path}' is no table in UTF-8 ({error}); save it as CSV in UTF-8, or remove"
                " it to solve all points again"
            ) from None
        if table.fieldnames is None:
            return []
        if list(table.fieldnames) != [*self._keys, *COLUMNS]:
            raise InputError(
                f"'{self.path}' has other columns than this sweep; put its first line right, or"
                " remove the file to solve all points again"
            )
        return [self._point(number, row) for number, row in rows if None not in row.values()]

    def _point(self, number: int, row: Mapping[str, str]) -> Point:
        """Point of a row, which has a number for messages."""
        try:
            numbers: dict[str, Any] = {name: float(row[name] or math.nan) for name in _FLOATS}
            numbers["factorizations"] = int(float(row["factorizations"]))  # 14.0 by a spreadsheet
            if row["status"] not in _STATUSES:
                raise ValueError(f"unknown status '{row['status']}'")
            values = {key: _value(row[key]) for key in self._keys}
            point = Point(values, row["status"], reason=row["reason"], **numbers)
            if text := point.contradiction(AGREE * self._tolerance):
                raise ValueError(text)
        except (ValueError, OverflowError) as error:
            raise InputError(
                f"'{self.path}', line {number}, cannot be read: {error}; remove the line to solve"
                " its point again"
            ) from None
        return point


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
