"""Pictures of a sweep: load factor with its bracket over what varies; the worst place."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import plain
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.drawing import BLUE, VERMILLION
from fenics_contact.output.folder import drawing, going_on, replace_file, writing
from fenics_contact.output.plotting import check_axes, draw_forces, draw_mode, new_axes, save
from fenics_contact.output.view import view_of
from fenics_contact.results.result import Result
from fenics_contact.sweeps.parameters import Parameter, Values
from fenics_contact.sweeps.points import Point, value_text

PICTURE, WORST = "sweep.png", "worst.png"
#: Curves that one picture has room for; beyond them all points are drawn as one.
CURVES = 7
#: What the legend calls a curve that is alone.
ONE_CURVE = "load factor"
#: Characters of a title, and of values of which there are many.
TITLE, TICK = 60, 20


def save_picture(
    parameters: Sequence[Parameter], points: Sequence[Point], title: str, folder: Path
) -> None:
    """Draw a sweep into sweep.png of a folder, on this rank.

    Raises:
        DrawingError: If it cannot be drawn.
        OSError: If it cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    file = io.BytesIO()
    with drawing(PICTURE):
        axes = draw_sweep(parameters, points, figure.subplots())
        axes.set_title(plain(title, TITLE), fontsize=11)
        figure.savefig(file, dpi=150)
    replace_file(folder / PICTURE, file.getvalue())


def save_worst(result: Result, values: Values, folder: Path) -> None:
    """Draw the mechanism of a solved point into worst.png of a folder. Collective."""
    end = result.collapse
    if end is None or end.mode is None or end.joints is None or end.status != "limit":
        return
    sign = 1.0 if result.positive is not None else -1.0
    view = view_of(result.layout, end.mode, end.joints, sign)
    title = f"lowest load factor {end.load_factor:.5g}: {plain(_said(values), TITLE)}"
    with going_on([]), writing(result.scene.comm, folder):
        if result.scene.comm.rank == 0:
            file = io.BytesIO()
            with drawing(WORST):
                save(view, title, [file], draw_mode, draw_forces)
            replace_file(folder / WORST, file.getvalue())


def draw_sweep(parameters: Sequence[Parameter], points: Sequence[Point], axes: Any = None) -> Any:
    """Draw the load factor over the parameter with most values, a curve for each of the others.

    A ring is around the lowest one.

    Args:
        parameters: What varies.
        points: In the order of their grid.
        axes: To draw into; by default those of a new figure.
    """
    check_axes(axes)
    axes = new_axes() if axes is None else axes
    sizes = [len(parameter.values) for parameter in parameters]
    along = int(np.argmax(sizes))
    order = np.moveaxis(np.arange(len(points)).reshape(sizes), along, -1)
    curves = [[points[k] for k in row] for row in order.reshape(-1, sizes[along])]
    at, label, names = _places(parameters[along])
    if len(curves) > CURVES:
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
    if places:
        x, worst = min(places, key=lambda place: place[1].least)
        factor = worst.least if worst.least == worst.load_factor else worst.load_factor_negative
        where = ", ".join(dict.fromkeys(map(_short, worst.values.values())))
        text = plain(f"lowest: {factor:.5g} at {where}", TITLE)
        ring = {"ms": 11, "mfc": "none", "color": VERMILLION, "ls": "none"}
        axes.plot(x, factor, "o", label=text, **ring)
    axes.set(xlabel=plain(label), ylabel="load factor")
    if names:
        axes.set_xticks(at, list(map(plain, names)))
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize=8)
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
    for suffix in ("", "_negative"):
        columns = [f"{name}{suffix}" for name in ("load_factor", "lower", "upper")]
        values = np.array([[getattr(point, name) for point in points] for name in columns])
        factor, lower, upper = np.where(np.isfinite(values), values, np.nan)
        factor[~solved] = np.nan
        if suffix and np.all(np.isnan(factor)):
            continue
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
    axes.plot(x[~solved], np.zeros(np.count_nonzero(~solved)), "x", color=VERMILLION)
    # Invisible, so that the axis has room for all values.
    axes.plot(x, np.full(len(x), 0.5), " ", transform=axes.get_xaxis_transform())
    for place, point in zip(x, points, strict=True):
        if point.status == "unbounded":
            style = {"xycoords": ("data", "axes fraction"), "ha": "center", "fontsize": 8}
            axes.annotate("unbounded", (place, 0.96), rotation=90, va="top", **style)


def _said(values: Values) -> str:
    """Values of keys, as there is room for in a picture."""
    return ", ".join(f"{_name(key)} = {_short(value)}" for key, value in values.items())


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else value_text(value)


def _name(key: str) -> str:
    """A key as people say it: "friction of joints.default"."""
    table, _, last = key.rpartition(".")
    return f"{last} of {table}" if table else last
