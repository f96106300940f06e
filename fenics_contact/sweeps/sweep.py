"""Limit loads over values of a scene's keys: the function for users, its table and its picture.

The table has a row as each point ends; a sweep that was stopped goes on with the rows that are
there.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact import console
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import EXIT_CODES, InputError, checked, plain, require
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.files import strict
from fenics_contact.output.folder import drawing, going_on, replace_file, writing
from fenics_contact.output.plotting import (
    BLUE,
    VERMILLION,
    check_axes,
    draw_forces,
    draw_mode,
    new_axes,
    save,
)
from fenics_contact.output.view import planar, view_of_collapse
from fenics_contact.parallel import MPI
from fenics_contact.results.bounds import counted, equal
from fenics_contact.scene.scene import Scene
from fenics_contact.sweeps.points import (
    WRONG_INPUT,
    Family,
    KeptStructure,
    Parameter,
    Point,
    Values,
    grid,
    solve,
    solved_points,
    value_text,
    views_of,
    worst_of,
)
from fenics_contact.version import __version__
from fenics_contact.workers import InPlace, Processes, told_once

TABLE, RECORD = "sweep.csv", "sweep.json"
PICTURE, WORST = "sweep.png", "worst.png"
#: The key of the live load's direction in plan, degrees.
ANGLE = "loads.live.angle"
#: Curves that one picture has room for; beyond them all points are drawn as one.
CURVES = 7
#: What the legend calls a curve that is alone.
ONE_CURVE = "load factor"
#: Characters of a title, and of values of which there are many.
TITLE, TICK = 60, 20
#: Columns after those of the keys.
COLUMNS = tuple(item.name for item in fields(Point) if item.name != "values")
#: Attributes of points.
_ATTRIBUTES = ("values", *COLUMNS, "solved", "least")
#: Load factors are in their brackets up to this times the tolerance: certificates leave some.
AGREE = 10.0

#: Is told how many points are there, of how many, and of the point that ended, None at first.
Told = Callable[[int, int, Point | None], None]


class Sweep(Sequence[Point]):
    """Limit loads at all points of a sweep, the last parameter changing fastest.

    Attributes:
        parameters: What varies.
    """

    def __init__(self, parameters: Sequence[Parameter], points: Sequence[Point]) -> None:
        """Points in the order of `grid`."""
        self.parameters = tuple(parameters)
        self._points = tuple(points)

    def __getitem__(self, index: Any) -> Any:
        return self._points[index]

    def __len__(self) -> int:
        return len(self._points)

    def __repr__(self) -> str:
        keys = ", ".join(key for parameter in self.parameters for key in parameter.keys)
        found = ""
        worst = self.worst
        if worst is not None and equal([p.least for p in self if math.isfinite(p.least)]):
            found = f", load factor {worst.least:.5g} at all that are solved"
        elif worst is not None:
            load = f" ({worst.load})" * bool(worst.load)
            found = f", lowest load factor {worst.least:.8g}{load} at {worst.place}"
        fallen = [p.place for p in self if p.status in ("unstable", "no_equilibrium")]
        more = f" and {len(fallen) - 1} more" * (len(fallen) > 1)
        found += f", does not stand at {fallen[0]}{more}" if fallen else ""
        starts = [point for point in self if math.isfinite(point.start)]
        first = min(starts, key=lambda point: point.start, default=None)
        if worst and first and not worst.start <= first.start:
            found += f", lowest a0* {first.start:.4g} m/s2 at {first.place}"
        return f"<Sweep: {counted(len(self), 'point')} over {keys}{found}>"

    @checked
    def column(self, name: str) -> Array:
        """An attribute of all points, for example `load_factor`, or the values of a key or keys.

        Raises:
            InputError: If points have no such attribute or key.
        """
        keys = tuple(part.strip() for part in name.split(","))
        if keys in (one.keys for one in self.parameters):
            name = keys[0]  # keys that vary together have the same values
        known = [*(key for one in self.parameters for key in one.keys), *_ATTRIBUTES]
        if name not in known:
            raise InputError(f"name = '{name}' must be one of {', '.join(map(repr, known))}")
        return np.array([p.values[name] if name in p.values else getattr(p, name) for p in self])

    @property
    def worst(self) -> Point | None:
        """The point with the lowest load factor; None if none is solved and finite."""
        found = [point for point in self if math.isfinite(point.least)]
        return min(found, key=lambda point: point.least) if found else None

    def plot(self, axes: Any = None) -> Any:
        """Draw the load factor with its bracket over the parameter; returns the axes."""
        return draw_sweep(self.parameters, self, axes)


@checked
def sweep(
    scene: Scene | str | Path,
    vary: Mapping[str, Iterable[Any]],
    folder: str | Path | None = None,
    *,
    jobs: int = 1,
    progress: bool = False,
) -> Sweep:
    """Limit loads of a scene over values of its keys, the product of them if there are several.

    Args:
        scene: A scene, or its file.
        vary: Values by key of a scene file, for example `{"joints.default.friction": [0.3, 0.4]}`,
            or a text "0.3:1.0:15" for 15 values. "a, b" in place of a key gives both keys the
            same values.
        folder: Where the table and pictures are written, a row as each point ends. Rows of the
            same sweep that are there are not computed again: this needs a scene file.
        jobs: Processes among which the points are shared. Functions of a scene made in Python must
            be in a module that these can import.
        progress: Print every point, on rank 0.

    Raises:
        InputError: If a key or value is wrong; then nothing is written.
        OutputError: If the folder cannot be written to.
    """
    family = Family(scene if isinstance(scene, Scene) else (Path(scene), ()))
    parameters = [Parameter.of(keys, values) for keys, values in vary.items()]
    tell = console.SweepProgress() if progress and family.comm.rank == 0 else None
    require(jobs >= 1, f"jobs = {jobs} must be at least 1")
    text = f"jobs = {jobs} under mpirun: the ranks share every point; leave it out"
    require(jobs == 1 or family.comm.size == 1, text)
    if jobs > 1:
        family.to_send()
    with Processes(jobs) if jobs > 1 else InPlace() as beside:
        return run_sweep(family, parameters, None if folder is None else Path(folder), beside, tell)


def run_sweep(
    family: Family,
    parameters: Sequence[Parameter],
    folder: Path | None = None,
    beside: Executor | None = None,
    tell: Told | None = None,
) -> Sweep:
    """Limit loads over a grid of parameters, shared with workers; see `sweep`. Collective.

    If a load varies, the mechanism of the point with the lowest load factor is drawn: that point is
    solved again.
    """
    from matplotlib.figure import Figure

    points = grid(parameters)
    comm = family.comm
    # What is wrong in any scene is refused before the first is solved.
    scenes = [family.scene(values) for values in reversed(points)]
    tolerance = max(one.solve.tolerance for one in scenes)
    if not family.of_blocks:
        with Discretization(scenes[-1]) as made:
            made.check_pushed()
    tell = tell or (lambda done, total, point: None)
    rows = SweepTable(folder or Path(), list(points[0]), tolerance)
    there: list[Point] = []
    with writing(comm, folder):
        if comm.rank == 0 and folder is not None:
            there = rows.begin(described(family, parameters))

    def key(values: Values) -> tuple[str, ...]:
        return tuple(map(value_text, values.values()))

    found = {key(point.values): point for point in comm.bcast(there)}
    todo = [values for values in points if key(values) not in found]
    tell(len(found), len(points), None)
    with told_once():
        for point in solved_points(family, todo, beside or InPlace()):
            with writing(comm, folder):
                if comm.rank == 0 and folder is not None:
                    rows.append(point)
            found[key(point.values)] = point
            tell(len(found), len(points), point)
    done = Sweep(parameters, [found[key(values)] for values in points])
    if folder is None:
        return done
    with going_on([]), writing(comm, folder):
        if comm.rank == 0:
            rows.write(done)  # in the order of the values
            rows.write_record(described(family, parameters), done)
            file = io.BytesIO()
            with drawing(PICTURE):
                figure = Figure(figsize=(7.0, 4.5), layout="constrained")
                polar = any(ANGLE in parameter.keys for parameter in parameters)
                axes = draw_sweep(parameters, done, figure.add_subplot(polar=polar))
                axes.set_title(plain(str(family.tables.get("title", "")), TITLE), fontsize=11)
                figure.savefig(file, dpi=150)
            replace_file(folder / PICTURE, file.getvalue())
    worst = done.worst
    if worst is not None and any(key.startswith("loads.") for key in worst.values):
        with closing(KeptStructure()) as structure:
            result = solve(family.scene(worst.values), structure)
            if result.limits:
                _save_worst(result, worst.values, folder, comm)
    return done


def _save_worst(result: Any, values: Values, folder: Path, comm: MPI.Comm) -> None:
    """Draw the worst mechanism of a solved point into worst.png of a folder. Collective."""
    name = worst_of(result)
    end = result.limits[name]
    title = f"lowest load factor {end.load_factor:.5g}: {plain(_said(values), TITLE)}"
    view = view_of_collapse(result.layout, end) if isinstance(result.scene, Scene) else None
    with going_on([]), writing(comm, folder):
        if comm.rank == 0:
            file = io.BytesIO()
            blocks = views_of(result)[name] if view is None else view.blocks
            with drawing(WORST):
                if blocks.bodies.dimension == 3:
                    from fenics_contact.spatial.picture import save_view

                    save_view(replace(blocks, title="", caption=title), [file])
                else:
                    view = view or planar(blocks, known=True, thickness=result.scene.thickness)
                    save(view, title, [file], draw_mode, draw_forces)
            replace_file(folder / WORST, file.getvalue())


# ---- the table on the disk


class SweepTable:
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
        before = None
        if described.exists():
            try:
                before = json.loads(described.read_text())
            except (ValueError, RecursionError) as error:  # a byte that is no text is a ValueError
                raise InputError(
                    f"'{described}' cannot be read: {error}; choose another folder (-o on the"
                    " command line), or remove that one"
                ) from None
        if isinstance(before, dict):
            before.pop("rows", None)
        same = "mesh" in record and before == json.loads(json.dumps(record))
        if before is not None and not same:  # the mesh of a scene made in Python has no record
            raise InputError(
                f"'{folder}' has a sweep of another scene or other values; choose another"
                " folder (-o on the command line), or remove that one"
            )
        rows = self._rows() if before is not None else []
        self.write(rows)  # without a half-written line
        self.write_record(record)
        return rows

    def write_record(self, record: Mapping[str, Any], points: Iterable[Point] = ()) -> None:
        """Replace sweep.json: what the folder is a sweep of, with rows once all are there."""
        rows = [vars(point) | {"values": dict(point.values)} for point in points]
        text = json.dumps(strict({**record, "rows": rows} if rows else record), indent=2)
        replace_file(self.path.with_name(RECORD), f"{text}\n".encode())

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
            rows = [(table.line_num, row) for row in table if None not in row.values()]
        except (UnicodeDecodeError, csv.Error) as error:
            raise InputError(
                f"'{self.path}' is no table in UTF-8 ({error}); save it as CSV in UTF-8, or remove"
                " it to solve all points again"
            ) from None
        if list(table.fieldnames or ()) not in ([], [*self._keys, *COLUMNS]):
            raise InputError(
                f"'{self.path}' has other columns than this sweep; put its first line right, or"
                " remove the file to solve all points again"
            )
        points = []
        for number, row in rows:
            try:
                points.append(self._point(row))
            except (ValueError, OverflowError) as error:
                raise InputError(
                    f"'{self.path}', line {number}, cannot be read: {error}; remove the line to"
                    " solve its point again"
                ) from None
        return points

    def _point(self, row: Mapping[str, str]) -> Point:
        """Point of a row.

        Raises:
            ValueError, OverflowError: If it cannot be one.
        """
        given: dict[str, Any] = {}
        for item in fields(Point)[1:]:
            cell = row[item.name]
            if item.type == "float":
                given[item.name] = float(cell or math.nan)
            else:  # 14.0 by a spreadsheet
                given[item.name] = int(float(cell)) if item.type == "int" else cell
        if given["status"] not in (*EXIT_CODES, WRONG_INPUT):
            raise ValueError(f"unknown status '{given['status']}'")
        values = {}
        for key in self._keys:
            values[key] = row[key]
            with suppress(ValueError, RecursionError):
                values[key] = json.loads(row[key])
        point = Point(values, **given)
        if text := point.contradiction(AGREE * self._tolerance):
            raise ValueError(text)
        return point


def described(family: Family, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """What tells a sweep from others: version, scene, meshes and values. On one rank."""
    table = "blocks" if family.of_blocks else "mesh"
    meshes = {str(family.tables.get(table, {}).get("file", ""))}
    for parameter in parameters:
        if f"{table}.file" in parameter.keys:
            meshes = {str(value) for value in parameter.values}
    solved = {k: v for k, v in family.tables.items() if k not in ("title", "output")}
    tables = json.dumps(solved, sort_keys=True, default=str).encode()
    record = {"version": __version__, "scene": hashlib.sha256(tables).hexdigest()}
    if not isinstance(family.origin, Scene):
        folder = family.origin[0].parent
        paths = [folder / name for name in sorted(meshes)]
        files = [hashlib.sha256(path.read_bytes()) for path in paths if path.is_file()]
        record["mesh"] = " ".join(one.hexdigest() for one in files)
    vary = {", ".join(parameter.keys): list(parameter.values) for parameter in parameters}
    return {**record, "vary": vary}


# ---- the picture


def draw_sweep(parameters: Sequence[Parameter], points: Sequence[Point], axes: Any = None) -> Any:
    """Draw the load factor over the parameter with most values, a curve for each of the others.

    Over angles in plan it is the radius, where axes are polar, as those of a new figure then are. A
    ring is around the lowest one, where not all are equal.

    Args:
        parameters: What varies.
        points: In the order of their grid.
        axes: To draw into; by default those of a new figure.
    """
    check_axes(axes)
    turning = [k for k, one in enumerate(parameters) if ANGLE in one.keys]
    axes = new_axes(polar=bool(turning)) if axes is None else axes
    sizes = [len(parameter.values) for parameter in parameters]
    along = turning[0] if turning else int(np.argmax(sizes))
    order = np.moveaxis(np.arange(len(points)).reshape(sizes), along, -1)
    curves = [[points[k] for k in row] for row in order.reshape(-1, sizes[along])]
    at, label, names = _places(parameters[along])
    polar = bool(turning) and axes.name == "polar"
    if polar:
        at = np.radians(at)
        first, last = np.argmin(at), np.argmax(at)
        if at[first] + 2.0 * np.pi - at[last] < 1.5 * np.diff(np.sort(at)).max(initial=0.0):
            at = np.append(at, at[first] + 2.0 * np.pi)
            curves = [[*curve, curve[first]] for curve in curves]
    elif len(curves) > CURVES:
        curves = [list(points)]
        at = np.arange(float(len(points)))
        label = "point"
        names = []
    others = [p.keys[0] for p in parameters if p is not parameters[along]]
    for number, curve in enumerate(curves):
        given = _said({key: curve[0].values[key] for key in others})
        style = (BLUE, ONE_CURVE) if len(curves) == 1 else (f"C{number}", plain(given))
        _draw_curve(axes, at, curve, *style)
    places = [(x, p) for curve in curves for x, p in zip(at, curve, strict=True)]
    places = [(x, point) for x, point in places if np.isfinite(point.least)]
    if places and not equal([point.least for _, point in places]):
        x, worst = min(places, key=lambda place: place[1].least)
        factor = worst.least if worst.least == worst.load_factor else worst.load_factor_negative
        if polar and factor < 0.0:
            x, factor = x + np.pi, -factor
        where = ", ".join(dict.fromkeys(map(_short, worst.values.values())))
        text = plain(f"lowest: {factor:.5g} at {where}", TITLE)
        ring = {"ms": 11, "mfc": "none", "color": VERMILLION, "ls": "none"}
        axes.plot(x, factor, "o", label=text, **ring)
    axes.set(xlabel=plain(label), ylabel="" if polar else "load factor")
    if polar:
        axes.set(rmin=0.0, rlabel_position=67.5)  # one label above the other
        axes.tick_params(axis="y", labelsize=8)
    if names:
        axes.set_xticks(at, list(map(plain, names)))
    axes.grid(alpha=0.3)
    beside = {"loc": "upper left", "bbox_to_anchor": (1.1, 1.0)} if polar else {"loc": "best"}
    axes.legend(fontsize=8, **beside)
    return axes


def _places(parameter: Parameter) -> tuple[Array, str, list[str]]:
    """Places of values along an axis, its label, and names of values that are no numbers.

    Points in a plane are placed along their path.
    """
    label = " = ".join(map(_name, parameter.keys))
    values = [np.asarray(value) for value in parameter.values]
    if any(value.dtype.kind not in "if" or value.shape != values[0].shape for value in values):
        names = [textwrap.shorten(value_text(value), TICK) for value in parameter.values]
        return np.arange(float(len(values))), label, names
    table = np.array(values, dtype=float).reshape(len(values), -1)
    moving = np.flatnonzero(np.ptp(table, axis=0))
    if len(moving) > 1:
        steps = np.linalg.norm(np.diff(table, axis=0), axis=1)
        return np.append(0.0, np.cumsum(steps)), f"{label}, distance from the first", []
    component = moving[0] if len(moving) else 0
    axis = f", {'xy'[component]}" if table.shape[1] == 2 else ""
    return table[:, component], label + axis, []


def _draw_curve(axes: Any, at: Array, curve: Sequence[Point], colour: str, label: str) -> None:
    """Load factors of both directions with their brackets; points without one as crosses."""
    order = np.argsort(at, kind="stable")
    x = at[order]
    points = [curve[k] for k in order]
    solved = np.array([point.solved for point in points])
    names = ("at least", "at most", "bracket") if label == ONE_CURVE else ("_",) * 3
    polar = axes.name == "polar"
    for suffix in ("", "_negative"):
        columns = [f"{name}{suffix}" for name in ("load_factor", "lower", "upper")]
        values = np.array([[getattr(point, name) for point in points] for name in columns])
        factor, lower, upper = np.where(np.isfinite(values), values, np.nan)
        factor[~solved] = np.nan
        if suffix and np.all(np.isnan(factor)):
            continue
        if suffix and polar:
            x, factor, lower, upper = x + np.pi, -factor, -upper, -lower
        axes.plot(x, factor, "o-", color=colour, markersize=4, label=label)
        known = ~np.isnan(lower + upper)
        if np.any(known):
            axes.fill_between(x, lower, upper, color=colour, alpha=0.12, lw=0, label=names[2])
        for end, name in zip((lower, upper), names, strict=False):
            alone = np.where(known, np.nan, end)
            if not np.all(np.isnan(alone)):
                axes.plot(x, alone, ":", color=colour, label=name)
        # named once
        label = "_"
        names = ("_",) * 3
    x = at[order]
    axes.plot(x[~solved], np.zeros(np.count_nonzero(~solved)), "x", color=VERMILLION)
    if not polar:  # invisible, so that the axis has room for all values
        axes.plot(x, np.full(len(x), 0.5), " ", transform=axes.get_xaxis_transform())
    for place, point in zip(x, points, strict=True):
        if point.status == "unbounded":
            coordinates = "data" if polar else ("data", "axes fraction")
            style = {"xycoords": coordinates, "ha": "center", "va": "top", "fontsize": 8}
            top = axes.get_rmax() if polar else 0.96
            axes.annotate("unbounded", (place, top), rotation=90, **style)


def _said(values: Values) -> str:
    """Values of keys, as there is room for in a picture."""
    return ", ".join(f"{_name(key)} = {_short(value)}" for key, value in values.items())


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else value_text(value)


def _name(key: str) -> str:
    """A key as people say it: "friction of joints.default"."""
    table, _, last = key.rpartition(".")
    return f"{last} of {table}" if table else last
