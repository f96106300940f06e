"""What the report is made from: result.json and the files beside it, read on one rank."""

from __future__ import annotations

import base64
import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fenics_contact.errors import InputError
from fenics_contact.output.report.words import MOTION, PICTURES
from fenics_contact.scene.units import Units

#: The file of a result that the page is made from.
RECORD = "result.json"
#: Pictures that a page can hold, by ending; the first that exists.
IMAGES = {".png": "image/png", ".svg": "image/svg+xml"}
#: Files of a sweep, and what its folder has behind the name of the result's.
SWEEP, SWEEP_RECORD, SWEEP_FOLDER = "sweep.csv", "sweep.json", "_sweep"
SWEEP_PICTURE, WORST_PICTURE = "sweep.png", "worst.png"

Record = Mapping[str, Any]


@dataclass(frozen=True)
class Labels:
    """Whom a report is for and from.

    Attributes:
        project: Name of the project.
        author: Who hands the report over.
    """

    project: str = ""
    author: str = ""

    def named(self) -> list[str]:
        """Those that are given, in words."""
        names = {"Project": self.project, "Author": self.author}
        return [f"{name}: {text}" for name, text in names.items() if text]


@dataclass(frozen=True)
class Sweep:
    """A sweep, beside a result or alone.

    Attributes:
        keys: That vary.
        rows: Of the table, by column.
        points: That it has once it is done.
        picture: Data URI; empty if there is none.
        worst: The mechanism of the least load factor, likewise.
        folder: Name of that where it is.
        version: Of the program.
    """

    keys: tuple[str, ...]
    rows: tuple[Mapping[str, str], ...]
    points: int
    picture: str
    worst: str
    folder: str
    version: str


def least(row: Mapping[str, str]) -> float:
    """The lower load factor of both directions in a row; infinite if it has none."""
    known = float(row["load_factor"] or "inf"), -float(row.get("load_factor_negative") or "-inf")
    return min(known)


@dataclass(frozen=True)
class Content:
    """All that a report shows.

    Attributes:
        record: Content of result.json.
        pictures: Data URIs by stem of the file.
        motions: Content of motion.json: outlines and motions of blocks by direction.
        sweep: A sweep beside the result.
        labels: Project and author.
    """

    record: Record
    pictures: Mapping[str, str] = field(default_factory=dict)
    motions: Mapping[str, Any] = field(default_factory=dict)
    sweep: Sweep | None = None
    labels: Labels = field(default_factory=Labels)

    @property
    def units(self) -> Units:
        """Units of the report: kN, MPa, and m or mm."""
        scene = self.record["scene"]
        wished = scene.get("output", {}).get("units", "m")
        return Units("mm" if wished == "mm" else "m", scene.get("thickness"))

    @property
    def has_strength(self) -> bool:
        """Whether some material or joint has a compressive strength."""
        scene = self.record["scene"]
        kinds = "materials", "joints", "foundations"
        given = (one.get("compressive_strength") for kind in kinds for one in scene[kind].values())
        return any(given)

    def details(self, direction: str) -> Record:
        """Where result.json has the verification of one end."""
        record = self.record
        apart = direction == "negative" and "negative" in record
        details: Record = record["negative"] if apart else record
        return details

    def picture_of(self, stem: str, direction: str) -> str:
        """Data URI of a picture of one end; empty if there is none."""
        both = len(self.record["ends"]) == 2
        return self.pictures.get(
            f"{stem}_negative" if both and direction == "negative" else stem, ""
        )


def read_content(folder: Path, labels: Labels) -> Content:
    """What lies in the folder of a result.

    Raises:
        InputError: If the folder holds no result, or one of a version that kept less.
    """
    record = _read(folder)
    files = record.get("files", ())
    beside = folder.with_name(f"{folder.name}{SWEEP_FOLDER}") if folder.name else folder
    sweep = read_sweep(folder) or read_sweep(beside)
    return Content(record, _pictures(folder, files), _motions(folder, files), sweep, labels)


def _read(folder: Path) -> Record:
    """The content of result.json."""
    path = folder / RECORD
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        there = "cannot be read" if path.exists() else "is not there"
        table = folder / SWEEP
        if table.exists():
            there += f" and {table} cannot be read as a sweep"
        raise InputError(
            f"{path} {there}; give the folder that `fenics-contact solve` or `sweep` wrote to"
        ) from error
    if isinstance(record, dict) and record.get("status") == "equilibrium":
        raise InputError(f"{path} is that of a state at a given load factor; give a limit load")
    if not isinstance(record, dict) or "ends" not in record or "scene" not in record:
        raise InputError(
            f"{path} is not of this version, or is no result; solve the scene again for a report"
        )
    return record


def _pictures(folder: Path, files: Iterable[str]) -> dict[str, str]:
    """Data URIs of the known pictures among the files of a result, by stem."""
    found: dict[str, str] = {}
    for stem in PICTURES:
        for suffix in IMAGES:
            path = folder / f"{stem}{suffix}"
            if path.name in files and stem not in found and path.is_file():
                found[stem] = _address(path)
    return found


def _address(path: Path) -> str:
    """Data URI of a picture."""
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f"data:{IMAGES[path.suffix]};base64,{data}"


def _motions(folder: Path, files: Iterable[str]) -> Mapping[str, Any]:
    """Content of motion.json, if it is of this result and whole."""
    if MOTION not in files:
        return {}
    try:
        found: Mapping[str, Any] = json.loads((folder / MOTION).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # the page does without
        return {}
    return found


def read_sweep(folder: Path) -> Sweep | None:
    """The sweep in a folder; None if there is none, or one that was touched by hand."""
    try:
        record = json.loads((folder / SWEEP_RECORD).read_text(encoding="utf-8"))
        keys = tuple(key for names in record["vary"] for key in names.split(", "))
        with (folder / SWEEP).open(encoding="utf-8-sig", newline="") as file:
            rows = _whole_rows(list(csv.DictReader(file)), keys)
        points = math.prod(map(len, record["vary"].values()))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, csv.Error):
        return None
    if not rows:
        return None
    paths = [folder / name for name in (SWEEP_PICTURE, WORST_PICTURE)]
    shown, worst = (_address(path) if path.is_file() else "" for path in paths)
    place = folder.resolve().name
    return Sweep(keys, rows, points, shown, worst, place, f"{record.get('version')}")


def _whole_rows(
    rows: Sequence[Mapping[str, str]], keys: Sequence[str]
) -> tuple[Mapping[str, str], ...]:
    """Rows with all that is shown, whose load factor is a number or left out."""
    needed = (*keys, "status", "load_factor")
    whole = []
    for row in rows:
        if all(isinstance(row.get(name), str) for name in needed):
            least(row)
            whole.append(row)
    return tuple(whole)
