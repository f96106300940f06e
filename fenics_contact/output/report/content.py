"""What the report is made from: result.json and the files beside it, read on one rank."""

from __future__ import annotations

import base64
import csv
import json
import math
import os
import tempfile
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fenics_contact.errors import InputError
from fenics_contact.output.figures import FIGURES, draw_figures, read_figures
from fenics_contact.output.folder import replace_file
from fenics_contact.output.report.html import PICTURES
from fenics_contact.scene.units import Units

#: The file of a result that the page is made from.
RECORD = "result.json"
#: The page that moves blocks.
VIEWER = "viewer.html"
#: Pictures that a page can hold, by ending; the first that exists.
IMAGES = {".png": "image/png", ".svg": "image/svg+xml"}
#: Files of a sweep, and what its folder has behind the name of the result's.
SWEEP, SWEEP_RECORD, SWEEP_FOLDER = "sweep.csv", "sweep.json", "_sweep"
MECHANISMS = "mechanisms.json"
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

    def line(self, made: str) -> str:
        """Those that are given and how the result was made, in one line."""
        names = {"Project": self.project, "Author": self.author}
        given = [f"{name}: {text}" for name, text in names.items() if text]
        return " \N{MIDDLE DOT} ".join([*given, made])


@dataclass(frozen=True)
class SweepRecord:
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


def start(row: Mapping[str, str]) -> float:
    """The lower a0* of both directions in a row, m/s2; infinite if it has none."""
    return min(float(row.get(name) or "inf") for name in ("a0", "a0_negative"))


@dataclass(frozen=True)
class Content:
    """All that a report shows.

    Attributes:
        record: Content of result.json.
        pictures: Data URIs by stem of the file.
        viewer: The page that moves blocks; empty if there is none.
        sweep: A sweep beside the result.
        labels: Project and author.
        missing: Pictures that could not be drawn from what is there, and why; empty if none.
    """

    record: Record
    pictures: Mapping[str, str] = field(default_factory=dict)
    sweep: SweepRecord | None = None
    labels: Labels = field(default_factory=Labels)
    missing: str = ""
    viewer: str = ""

    @property
    def units(self) -> Units:
        """Units of the report: kN, MPa, and m or mm."""
        scene = self.record["scene"]
        thickness = 1.0 if self.record.get("dimension") == 3 else scene.get("thickness")
        return Units(scene.get("output", {}).get("units", "m"), thickness).of_report

    @property
    def made(self) -> str:
        """Whom the report is for and from, and when and by what the result was made."""
        date, version = str(self.record["date"])[:10], self.record["version"]
        return self.labels.line(f"Computed on {date} with fenics-contact {version}")

    def picture_of(self, stem: str, direction: str) -> str:
        """Data URI of a picture of one end; empty if there is none."""
        apart = len(self.record["directions"]) == 2 and direction == "negative"
        return self.pictures.get(f"{stem}_negative" if apart else stem, "")


def read_content(folder: Path, labels: Labels) -> Content:
    """What lies in the folder of a result.

    Raises:
        InputError: If the folder holds no result, or one of a version that kept less.
    """
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
    if not isinstance(record, dict) or "directions" not in record or "scene" not in record:
        raise InputError(
            f"{path} is not of this version, or is no result; solve the scene again for a report"
        )
    files = record.get("files", ())
    pictures = _pictures(folder, files)
    missing = ""
    if FIGURES in files:
        with tempfile.TemporaryDirectory() as made:
            missing = _draw_kept(record, folder, Path(made), pictures)
            drawn = _pictures(Path(made), os.listdir(made))
        pictures = {stem: (pictures | drawn)[stem] for stem in PICTURES if stem in pictures | drawn}
    beside = folder.with_name(f"{folder.name}{SWEEP_FOLDER}") if folder.name else folder
    sweep = read_sweep(folder) or read_sweep(beside)
    viewer = ""
    if VIEWER in files:
        with suppress(OSError, ValueError):  # the page does without
            viewer = (folder / VIEWER).read_text(encoding="utf-8")
    return Content(record, pictures, sweep, labels, missing, viewer)


def _pictures(folder: Path, files: Collection[str]) -> dict[str, str]:
    """Data URIs of the pictures in a folder, of these files, by stem in the order of the page."""
    found: dict[str, str] = {}
    for stem in PICTURES:
        for suffix in IMAGES:
            path = folder / f"{stem}{suffix}"
            if path.name in files and stem not in found and path.is_file():
                found[stem] = address_of(path)
    return found


def _draw_kept(record: Record, folder: Path, made: Path, there: Collection[str]) -> str:
    """Draw the pictures that the run did not, into `made`, and put them beside the others.

    Returns:
        Which are missing, and why; empty if none.
    """
    try:
        figures = [one for one in read_figures(folder / FIGURES) if one.name not in there]
        formats = record["scene"]["output"]["formats"]
        lost = "; ".join(draw_figures(figures, made, formats))
    except ValueError as error:
        lost = str(error) * ("scene" not in there)
    with suppress(OSError):  # the folder is read-only: the page has them all the same
        for path in made.iterdir():
            replace_file(folder / path.name, path.read_bytes())
    return f"pictures that are missing: {lost}" if lost else ""


def address_of(path: Path) -> str:
    """Data URI of a picture; empty if there is none."""
    if not path.is_file():
        return ""
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f"data:{IMAGES[path.suffix]};base64,{data}"


def read_mechanisms(folder: Path) -> Record | None:
    """The table of mechanisms in a folder; None if there is none."""
    with suppress(OSError, ValueError):
        record: Record = json.loads((folder / MECHANISMS).read_text(encoding="utf-8"))
        return record
    return None


def read_sweep(folder: Path) -> SweepRecord | None:
    """The sweep in a folder; None if there is none, or one that was touched by hand.

    Rows without all that is shown are left out.
    """
    try:
        record = json.loads((folder / SWEEP_RECORD).read_text(encoding="utf-8"))
        keys = tuple(key for names in record["vary"] for key in names.split(", "))
        needed = (*keys, "status", "load_factor")
        with (folder / SWEEP).open(encoding="utf-8-sig", newline="") as file:
            table = list(csv.DictReader(file))
        rows = tuple(row for row in table if all(isinstance(row.get(key), str) for key in needed))
        for row in rows:
            least(row)  # is a number, or left out
        points = math.prod(map(len, record["vary"].values()))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, csv.Error):
        return None
    if not rows:
        return None
    shown = address_of(folder / SWEEP_PICTURE)
    worst = address_of(folder / WORST_PICTURE)
    return SweepRecord(
        keys, rows, points, shown, worst, folder.resolve().name, f"{record.get('version')}"
    )
