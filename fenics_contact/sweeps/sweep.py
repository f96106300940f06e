"""Limit loads over values of a scene's keys: the function that users call."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact import console
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import InputError
from fenics_contact.errors.checks import checked
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.folder import going_on, writing
from fenics_contact.scene.scene import Scene
from fenics_contact.sweeps.parameters import Family, Parameter, Values, grid
from fenics_contact.sweeps.picture import draw_sweep, save_picture, save_worst
from fenics_contact.sweeps.points import Point, value_text
from fenics_contact.sweeps.solving import Structure, solve, solve_point
from fenics_contact.sweeps.table import Table, described
from fenics_contact.sweeps.workers import solved_by_workers

#: Attributes of points.
_ATTRIBUTES = (*(item.name for item in fields(Point)), "solved", "least")

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
        if worst is not None:
            place = ", ".join(dict.fromkeys(map(value_text, worst.values.values())))
            found = f", lowest load factor {worst.least:.8g} at {place}"
        return f"<Sweep: {console.counted(len(self), 'point')} over {keys}{found}>"

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
    family = Family.of_scene(scene) if isinstance(scene, Scene) else Family.of_file(Path(scene))
    parameters = [Parameter.of(keys, values) for keys, values in vary.items()]
    tell: Told = silent
    if progress and family.comm.rank == 0:
        tell = console.SweepProgress()
    return run_sweep(family, parameters, None if folder is None else Path(folder), jobs, tell)


def silent(done: int, total: int, point: Point | None) -> None:
    """Say nothing."""


def run_sweep(
    family: Family,
    parameters: Sequence[Parameter],
    folder: Path | None = None,
    jobs: int = 1,
    tell: Told = silent,
) -> Sweep:
    """Limit loads over a grid of parameters; see `sweep`. Collective."""
    points = grid(parameters)
    comm = family.comm
    tolerance = _check(family, points, jobs)
    rows = None if folder is None or comm.rank != 0 else Table(folder, list(points[0]), tolerance)
    there: list[Point] = []
    with writing(comm, folder):
        if rows is not None:
            there = rows.begin(described(family, parameters))
    found = {_key(point.values): point for point in comm.bcast(there)}
    todo = [values for values in points if _key(values) not in found]
    tell(len(found), len(points), None)
    for point in _solved(family, todo, jobs):
        with writing(comm, folder):
            if rows is not None:
                rows.append(point)
        found[_key(point.values)] = point
        tell(len(found), len(points), point)
    done = Sweep(parameters, [found[_key(values)] for values in points])
    with going_on([]), writing(comm, folder):
        if rows is not None and folder is not None:
            rows.write(done)  # in the order of the values
            save_picture(parameters, done, str(family.tables.get("title", "")), folder)
    worst = done.worst
    if folder is not None and worst is not None:
        if any(key.startswith("loads.") for key in worst.values):
            _draw_worst(family, worst, folder)
    return done


def _draw_worst(family: Family, worst: Point, folder: Path) -> None:
    """Draw the mechanism of a point into a folder. Collective: it is solved again."""
    structure = Structure()
    try:
        result = solve(family.scene(worst.values), structure)
    finally:
        structure.close()
    save_worst(result, worst.values, folder)


def _check(family: Family, points: Sequence[Values], jobs: int) -> float:
    """Refuse what is wrong in any scene, or in how they are to be solved.

    Returns:
        The largest tolerance of a load factor, relative.

    Raises:
        InputError: The message names it.
    """
    if jobs < 1:
        raise InputError(f"jobs = {jobs} must be at least 1")
    if jobs > 1 and family.comm.size > 1:
        raise InputError(
            f"--jobs {jobs} under mpirun: the ranks share every point; leave out one of both"
        )
    if jobs > 1:
        family.to_send()
    tolerances = [family.scene(values).solve.tolerance for values in points[1:]]
    first = family.scene(points[0])
    with Discretization(first) as made:
        made.check_pushed()
    return max([first.solve.tolerance, *tolerances])


def _key(values: Values) -> tuple[str, ...]:
    return tuple(map(value_text, values.values()))


def _solved(family: Family, points: Sequence[Values], jobs: int) -> Iterator[Point]:
    """Points as they end."""
    if jobs > 1 and points:
        yield from solved_by_workers(family, points, jobs)
        return
    structure = Structure()
    try:
        for values in points:
            yield solve_point(family, structure, values)
    finally:
        structure.close()
