"""Pictures of what benchmarks/run.py measured."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.scenes import TIME_ERROR

Row = Mapping[str, Any]

#: Colour, marker and name of methods and peers, the same in all pictures; this program's first.
LOOKS = {
    "auto": ("#0b62a4", "o", "auto (default)"),
    "path": ("#5ba3d9", "v", "loading path alone"),
    "faces": ("#2e8b57", "h", "face engine alone"),
    "fixed-point": ("#e67300", "s", "fixed-point"),
    "splitting": ("#8e44ad", "^", "splitting"),
    "rigid-lp": ("#7f7f7f", "P", "rigid blocks, associative: one linear program"),
    "gilbert": ("#c0392b", "X", "rigid blocks: Gilbert's linear programs"),
    "gilbert-clarabel": ("#e08283", "X", "rigid blocks: the same by Clarabel"),
    "siconos": ("#16877a", "*", "rigid blocks: Siconos, bisection"),
    "calculix": ("#3d3d3d", "D", "elastic blocks: CalculiX, load steps"),
}
OWN = ("auto", "path", "faces", "fixed-point", "splitting")

#: Tolerance asked of the load factor; errors below the least are drawn there.
TOLERANCE, LEAST = 1e-6, 1e-7

NOTES = {
    "time_error": "Error against the best value known, not that of the same mesh. Numbers: elements"
    " along half a block (through the arch). Rigid-block programs have no mesh; they are refined by"
    " their tolerance. Rigid and elastic blocks may have other collapse states. Curves end where a"
    " run takes too long.",
    "cost_size": "Walls of 10 x 10 bricks and more in running bond, 4 elements along half a brick."
    " Bonded solve: assemble, analyse, factor and solve the same mesh with all joints closed. n^p:"
    " fitted to the run times.",
}


def curves(rows: Iterable[Row], *names: str) -> dict[tuple[Any, ...], list[Row]]:
    """Rows with a load factor by what they share, methods in the order of the legend."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in sorted(rows, key=lambda row: list(LOOKS).index(row["method"])):
        if row["status"] != "not_converged" and row["load_factor"] > 0.0:
            found.setdefault(tuple(row[name] for name in names), []).append(row)
    return found


def line(method: str, hollow: bool, dashes: str) -> dict[str, Any]:
    """How a curve is drawn."""
    colour, marker, _ = LOOKS[method]
    size = {"*": 10.0, "P": 8.0, "X": 8.0}.get(marker, 6.0)
    style = {"color": colour, "marker": marker, "markersize": size, "linestyle": dashes}
    return style | {"linewidth": 1.4, "markerfacecolor": "white" if hollow else colour}


def draw_panel(place: Any, rows: Iterable[Row]) -> dict[str, Line2D]:
    """Draw run time against error for one scene; returns what the legend shows."""
    handles = {}
    for (method, degree), curve in curves(rows, "method", "degree").items():
        own, label = method in OWN, LOOKS[method][2]
        look = line(method, degree == 2, "--" if degree == 2 else "-" if own else ":")
        x, y = [row["seconds"] for row in curve], [max(row["error"], LEAST) for row in curve]
        place.plot(x, y, zorder=3 if own else 2, **look)
        label += f", degree {degree:.0f}" if own else ""
        handles[label] = Line2D([], [], label=label, **look)
        shift = {"textcoords": "offset points", "xytext": (0, 6 if degree == 1 else -12)}
        shift |= {"color": look["color"], "fontsize": 7.5, "ha": "center"}
        for row, a, b in zip(curve, x, y, strict=True) if method in ("auto", "calculix") else ():
            place.annotate(f"{row['resolution']:.0f}", (a, b), **shift)
    place.set(xscale="log", yscale="log", ylabel="error of the load factor (-)")
    low, high = place.get_ylim()
    place.set_ylim(min(0.5 * low, 1e-3), max(high, 1.0))
    if low < TOLERANCE:
        place.axhspan(0.1 * LEAST, TOLERANCE, color="#000000", alpha=0.06, linewidth=0.0)
        place.text(0.01, 0.12, "below the tolerance asked", transform=place.transAxes, size=8)
        place.set_ylim(bottom=0.4 * LEAST)
    place.grid(alpha=0.3)
    return handles


def draw_time_error(figure: Figure, rows: Sequence[Row]) -> None:
    """Draw run time against error, a panel per scene."""
    axes, handles = figure.subplots(2, 2, sharex=True), {}
    for place, (name, scene) in zip(axes.ravel(), TIME_ERROR.items(), strict=True):
        handles |= draw_panel(place, [row for row in rows if row["scene"] == name])
        place.set_title(f"{name}\nbest known {scene.best:g}: {scene.source}", fontsize=10)
    for place in axes[1]:
        place.set_xlabel("run time (s)")
    figure.legend(handles=list(handles.values()), ncol=3, loc="upper center", fontsize=9)


def draw_cost_size(figure: Figure, rows: Sequence[Row]) -> None:
    """Draw seconds and bonded solves against the number of displacements."""
    left, right = figure.subplots(1, 2)
    rows = [{**row, "friction": row["scene"].split()[-1]} for row in rows]
    for (method, ranks, friction), curve in curves(rows, "method", "ranks", "friction").items():
        look = line(method, ranks > 1, "-" if friction == "0.4" else "--")
        names = ("displacements", "seconds", "bonded_seconds")
        n, seconds, bonded = (np.array([row[name] for row in curve]) for name in names)
        power = f": n^{np.polyfit(np.log(n), np.log(seconds), 1)[0]:.2f}" if len(n) > 2 else ""
        several = f", {ranks:.0f} ranks" if ranks > 1 else ""
        left.plot(n, seconds, label=f"{method}, friction {friction}{several}{power}", **look)
        right.plot(n, seconds / bonded, **look)
        if (method, ranks, friction) == ("auto", 1, "0.4"):
            left.plot(n, bonded, "k:", label="one bonded solve")
    for place, label in ((left, "run time (s)"), (right, "run time / one bonded solve (-)")):
        place.set(xscale="log", yscale="log", ylabel=label, xlabel="displacements n (-)")
        place.grid(alpha=0.3)
    figure.legend(ncol=3, loc="upper center", fontsize=9)


def newest(rows: Sequence[Row]) -> list[Row]:
    """Rows of other programs, and those of this one that are of the commit measured last."""
    states: dict[tuple[str, str], int] = {}
    for row in rows:
        if row["made_with"].startswith("fenics_contact"):
            state = row["date"], row["commit"]
            states[state] = states.get(state, 0) + 1
    last = max(states, key=lambda state: (state[0], states[state]), default=("", ""))
    return [
        row
        for row in rows
        if not row["made_with"].startswith("fenics_contact") or (row["date"], row["commit"]) == last
    ]


def made_with(rows: Iterable[Row]) -> str:
    """What made rows, of which commit and when, and the machines."""
    programs, machines = set(), set()
    for row in rows:
        if row["made_with"]:
            program, machine = row["made_with"].split("; ")
            state = (
                f", commit {row['commit']}" * bool(row["commit"]) if row["method"] in OWN else ""
            )
            programs.add(f"{program}{state}, {row['date']}")
            machines.add(machine)
    return "; ".join([*sorted(programs), *sorted(machines)])


def draw(name: str, rows: Sequence[Row], folder: Path) -> None:
    """Draw time_error.png or cost_size.png in a folder, with its small print."""
    height, top, function = {
        "time_error": (8.6, 0.8, draw_time_error),
        "cost_size": (5.6, 0.75, draw_cost_size),
    }[name]
    figure = Figure(figsize=(11.5, height))
    function(figure, rows)
    small = f"{NOTES[name]} Medians. {made_with(rows)}."
    lines = textwrap.wrap(small, 175)
    figure.text(0.01, 0.01, "\n".join(lines), fontsize=8, color="#444444", va="bottom")
    figure.tight_layout(rect=(0.0, 0.2 * len(lines) / height, 1.0, 1.0 - top / height))
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"{name}.png", dpi=130)
