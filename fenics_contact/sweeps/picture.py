"""Pictures of a sweep: load factor with its bracket over what varies; the worst place."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.mesh import Array
from fenics_contact.output.drawing import BLUE, VERMILLION
from fenics_contact.output.folder import writing
from fenics_contact.output.plotting import new_axes, save_collapse
from fenics_contact.output.view import view_of
from fenics_contact.sweeps.parameters import Family, Parameter
from fenics_contact.sweeps.points import Point, Structure, solve, value_text

PICTURE, WORST = "sweep.png", "worst.png"
#: Curves that one picture has room for; beyond them two numbers are drawn as a map.
CURVES = 7
#: What the legend calls a curve that is alone.
ONE_CURVE = "load factor"
#: Characters of a title, and of values of which there are many.
TITLE, TICK = 60, 20


def save_picture(
    parameters: Sequence[Parameter], points: Sequence[Point], title: str, folder: Path
) -> None:
    """Draw a sweep into sweep.png of a folder, on this rank."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = draw_sweep(parameters, points, figure.subplots())
    axes.set_title(_drawn(title), fontsize=11)
    figure.savefig(folder / PICTURE, dpi=150)


def draw_sweep(parameters: Sequence[Parameter], points: Sequence[Point], axes: Any = None) -> Any:
    """Draw the load factor over the parameter with most values, a curve for each of the others.

    Two numbers of many values each are drawn as a map.

    Args:
        parameters: What varies.
        points: In the order of their grid.
        axes: To draw into; by default those of a new figure.
    """
    axes = axes or new_axes()
    sizes = [len(parameter.values) for parameter in parameters]
    along = int(np.argmax(sizes))
    table = np.empty(len(points), dtype=object)
    table[:] = list(points)
    names: list[str]
    curves = np.moveaxis(table.reshape(sizes), along, -1).reshape(-1, sizes[along])
    if len(curves) > CURVES and len(parameters) == 2:
        _draw_map(axes, parameters, table.reshape(sizes))
        return axes
    if len(curves) > CURVES:
        curves, where = table[None, :], np.arange(len(points), dtype=float)
        names, label = [], "point"
    else:
        where, names, label = _places(parameters[along])
    others = [p.keys[0] for k, p in enumerate(parameters) if k != along]
    for number, curve in enumerate(curves):
        given = ", ".join(f"{_name(key)} = {_short(curve[0].values[key])}" for key in others)
        colour = BLUE if len(curves) == 1 else f"C{number}"
        _draw_curve(axes, where, curve, colour, given if len(curves) > 1 else ONE_CURVE)
    _mark_worst(axes, where, curves)
    axes.set(xlabel=label, ylabel="load factor")
    if names:
        axes.set_xticks(where, [textwrap.shorten(name, TICK) for name in names])
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize=8)
    return axes


def _places(parameter: Parameter) -> tuple[Array, list[str], str]:
    """Where the values of a parameter are along an axis, their names there, and its label."""
    label = " = ".join(map(_name, parameter.keys))
    values = [np.asarray(value) for value in parameter.values]
    if any(value.dtype.kind not in "if" or value.shape != values[0].shape for value in values):
        return np.arange(len(values), dtype=float), list(map(value_text, parameter.values)), label
    table = np.array(values, dtype=float).reshape(len(values), -1)
    moving = np.flatnonzero(np.ptp(table, axis=0))
    if len(moving) == 1 or table.shape[1] == 1:
        component = moving[0] if len(moving) else 0
        axis = f", {'xy'[component]}" if table.shape[1] == 2 else ""
        return table[:, component], [], label + axis
    steps = np.linalg.norm(np.diff(table, axis=0), axis=1)
    return np.append(0.0, np.cumsum(steps)), [], f"{label}, distance from the first"


def _draw_curve(axes: Any, where: Array, curve: Sequence[Point], colour: str, label: str) -> None:
    """Load factors of both directions with their brackets; points without one as crosses."""
    order = np.argsort(where, kind="stable")
    x = where[order]
    columns = ("load_factor", "lower", "upper")
    for suffix in ("", "_negative"):
        factor, lower, upper = (
            np.array([getattr(curve[k], name + suffix) for k in order]) for name in columns
        )
        unsolved = np.array([not curve[k].solved for k in order])
        shown = np.where(np.isfinite(factor) & ~unsolved, factor, np.nan)
        if suffix and not np.any(np.isfinite(shown)):
            continue
        axes.plot(x, shown, "o-", color=colour, markersize=4, label=None if suffix else label)
        known = np.isfinite(lower) & np.isfinite(upper)
        alone = label == ONE_CURVE and not suffix
        if np.any(known):
            style = {"color": colour, "alpha": 0.12, "lw": 0}
            label_of_both = "bracket" if alone else None
            axes.fill_between(x, lower, upper, where=known, label=label_of_both, **style)
        for bound, name in ((lower, "at least"), (upper, "at most")):
            shown = np.where(np.isfinite(bound) & ~known, bound, np.nan)
            if np.any(np.isfinite(shown)):
                axes.plot(x, shown, ":", color=colour, label=name if alone else None)
    for k in np.flatnonzero([not point.solved for point in curve]):
        axes.plot(where[k], 0.0, "x", color=VERMILLION)
    for k in np.flatnonzero([point.status == "unbounded" for point in curve]):
        place = {"xycoords": ("data", "axes fraction"), "ha": "center", "fontsize": 8}
        axes.annotate("unbounded", (where[k], 0.96), rotation=90, va="top", **place)


def _mark_worst(axes: Any, where: Array, curves: Any) -> None:
    """A ring around the lowest load factor."""
    least = np.array([[point.least for point in curve] for curve in curves])
    least[~np.isfinite(least)] = np.inf
    if not np.any(np.isfinite(least)):
        return
    row, column = np.unravel_index(np.argmin(least), least.shape)
    worst = curves[row][column]
    factor = worst.load_factor if worst.least == worst.load_factor else worst.load_factor_negative
    style = {"markersize": 11, "markerfacecolor": "none", "color": VERMILLION, "linestyle": "none"}
    place = ", ".join(dict.fromkeys(map(_short, worst.values.values())))
    label = f"lowest: {factor:.5g} at {_drawn(place)}"
    axes.plot(where[column], factor, "o", label=label, **style)


def _draw_map(axes: Any, parameters: Sequence[Parameter], table: Any) -> None:
    """The lowest load factor over two parameters."""
    least = np.array([[point.least for point in row] for row in table])
    least[~np.isfinite(least)] = np.nan
    (y, y_names, y_label), (x, x_names, x_label) = map(_places, parameters)
    mesh = axes.pcolormesh(x, y, least, shading="nearest", cmap="viridis")
    axes.figure.colorbar(mesh, ax=axes, label="load factor")
    axes.set(xlabel=x_label, ylabel=y_label)
    if x_names:
        axes.set_xticks(x, [textwrap.shorten(name, TICK) for name in x_names])
    if y_names:
        axes.set_yticks(y, [textwrap.shorten(name, TICK) for name in y_names])


def picture_of_worst(family: Family, worst: Point, folder: Path) -> None:
    """Draw the mechanism of a point into worst.png of a folder. Collective: it is solved again."""
    structure = Structure()
    try:
        result = solve(family.scene(worst.values), structure)
    finally:
        structure.close()
    end = result.collapse
    if end is None or end.mode is None or end.joints is None or end.status != "limit":
        return
    sign = 1.0 if result.positive is not None else -1.0
    view = view_of(result.discretization, end.mode, end.joints, sign)
    given = ", ".join(f"{_name(key)} = {_short(value)}" for key, value in worst.values.items())
    title = f"lowest load factor {end.load_factor:.5g}: {_drawn(given)}"
    with writing(family.comm):
        if family.comm.rank == 0:
            save_collapse(view, title, [folder / WORST])


def _short(value: Any) -> str:
    """A value as there is room for in a picture."""
    return f"{value:.4g}" if isinstance(value, float) else value_text(value)


def _name(key: str) -> str:
    """A key as people say it: "friction of joints.default"."""
    table, _, last = key.rpartition(".")
    return f"{last} of {table}" if table else last


def _drawn(text: str) -> str:
    line = "".join(c if c.isprintable() else " " for c in text)
    return textwrap.shorten(line, TITLE, placeholder=" ...").replace("$", r"\$")
