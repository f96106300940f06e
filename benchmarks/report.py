"""Pictures and a table of what benchmarks/run.py and benchmarks/peers.py measured.

    python3 benchmarks/report.py CSV [CSV ...] --output FOLDER [--only PATTERN]

`time_error.png`: run time against the error of the load factor, a panel per scene. Where the
tolerance varies, or other programs answer, errors are relative to the reference of the same mesh;
where the mesh varies, relative to the finest one. `cost_size.png`: seconds and bonded solves
against the number of displacements, with the exponent fitted. Shown are medians of verified runs,
and what other programs say as it is. The table of medians is printed as markdown.
"""

from __future__ import annotations

import argparse
import fnmatch
import math
import re
import sys
import textwrap
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.run import REFERENCE_TOLERANCE, SIZES, Row, medians, read_rows
from fenics_contact.scene import METHODS

#: Smaller errors are drawn as this one.
LEAST_ERROR = 1e-12

#: Colours and markers of this package's methods, and of other programs as they come.
OWN = {
    "auto": ("#1f77b4", "o"),
    "fixed-point": ("#ff7f0e", "s"),
    "monolithic": ("#2ca02c", "D"),
    "splitting": ("#9467bd", "^"),
    "active-set": ("#8c564b", "v"),
}
OTHERS = (
    ("#d62728", "X"),
    ("#555555", "P"),
    ("#e377c2", "*"),
    ("#17becf", "h"),
    ("#bcbd22", "p"),
)

#: Line styles by number of ranks.
DASHES: Mapping[int, Any] = {1: "-", 2: "--"}

#: Panels side by side at most, and size of one, inches.
COLUMNS, WIDTH, HEIGHT = 4, 3.3, 3.0

#: Least ratio of the ends of an axis.
LEAST_RANGE = 100.0

Style = Mapping[str, tuple[str, str]]


def style(rows: Iterable[Row]) -> Style:
    """Colour and marker of every method in the rows; this package's first."""
    named = {row.method for row in rows}
    others = sorted(named - set(METHODS))
    found = {method: OWN[method] for method in METHODS if method in named}
    return found | {name: OTHERS[k % len(OTHERS)] for k, name in enumerate(others)}


def usual_tolerance(rows: Iterable[Row]) -> float:
    """The tolerance of most of this package's rows."""
    counts = Counter(row.tolerance for row in rows if row.own)
    return max(counts, key=lambda tolerance: (counts[tolerance], -tolerance), default=math.nan)


def grouped(rows: Iterable[Row], key: Callable[[Row], Any]) -> dict[Any, list[Row]]:
    """Rows by a key, in the order in which it occurs."""
    groups: dict[Any, list[Row]] = defaultdict(list)
    for row in rows:
        groups[key(row)].append(row)
    return dict(groups)


# Time against error


@dataclass(frozen=True)
class Panel:
    """Rows on common axes; `over` is what varies along a curve, "tolerance" or "elements"."""

    title: str
    rows: Sequence[Row]
    over: str

    @property
    def curves(self) -> bool:
        """Whether there are curves, or points alone."""
        return len({getattr(row, self.over) for row in self.rows if row.own}) > 1

    def error(self, row: Row) -> float:
        """Error of a row as the panel means it."""
        return max(row.error if self.over == "tolerance" else row.error_finest, LEAST_ERROR)


def panels(rows: Sequence[Row], most: int = 12) -> list[Panel]:
    """What there is to see, by case: curves over tolerance, curves over mesh size, other programs.

    Args:
        rows: Medians.
        most: Number of panels; those without curves, of small scenes, are left out.
    """
    tolerance, found = usual_tolerance(rows), []
    for case, group in grouped(rows, lambda row: row.case).items():
        coarser = [
            row
            for row in group
            if math.isfinite(row.error_finest)
            and (not row.own or (row.elements < SIZES[-1] and row.tolerance == tolerance))
        ]
        sizes = sorted({row.elements for row in coarser if row.own})
        refined = len(sizes) > 1
        for same in grouped(group, lambda row: row.elements).values():
            shown = [row for row in same if math.isfinite(row.error)]
            several = len({row.tolerance for row in shown if row.own}) > 1
            if several or (not refined and any(not row.own for row in shown)):
                found.append(Panel(f"{case}, {_size(shown)}", shown, "tolerance"))
        if refined:
            title = f"{case}, {sizes[0]}\u2013{sizes[-1]} elements, against {SIZES[-1]}"
            found.append(Panel(title, coarser, "elements"))
    kept = sorted(found, key=lambda panel: (not panel.curves, -panel.rows[0].dofs))[:most]
    for panel in found:
        if panel not in kept:
            print(f"no panel for: {panel.title}", file=sys.stderr)
    return [panel for panel in found if panel in kept]


def _curve(row: Row) -> tuple[str, int]:
    """What the points of a curve share."""
    return row.method, row.ranks


def _size(rows: Iterable[Row]) -> str:
    return f"{max(row.dofs for row in rows):,} displacements".replace(",", "\u2009")


def draw_time_error(rows: Sequence[Row], path: Path) -> None:
    """Draw run time against error, a panel per scene.

    Args:
        rows: Medians.
        path: A file name ending in .png.
    """
    drawn = panels(rows)
    rows = [row for panel in drawn for row in panel.rows]
    looks = style(rows)
    figure, axes = _grid(len(drawn))
    for place, panel in zip(axes, drawn, strict=False):
        for curve in grouped(panel.rows, _curve).values():
            _draw_curve(place, panel, curve, looks)
        place.set_title(panel.title, fontsize=9)
        place.set_xscale("log")
        place.set_yscale("log")
        _widen(place)
        low, _ = place.get_ylim()
        if low < REFERENCE_TOLERANCE and any(" to " in row.reference_kind for row in panel.rows):
            place.axhspan(low, REFERENCE_TOLERANCE, color="#000000", alpha=0.07, linewidth=0.0)
            place.set_ylim(bottom=low)
        place.set_xlabel("run time (s)", fontsize=8)
        which = "reference, same mesh" if panel.over == "tolerance" else "finest mesh"
        place.set_ylabel(f"error ({which})", fontsize=8)
    kinds = [kind for kind in ("tolerance", "elements") if kind in {p.over for p in drawn}]
    note = (
        f"{small_print(rows)} Numbers at the points of auto: {' or '.join(kinds)}. Grey: below the"
        f" tolerance of the reference. Errors below {LEAST_ERROR:g} are drawn there."
    )
    _finish(figure, looks, rows, note, path)


def _draw_curve(axes: Any, panel: Panel, curve: Sequence[Row], looks: Style) -> None:
    curve = sorted(curve, key=lambda row: (-row.tolerance, row.elements))
    first = curve[0]
    colour, marker = looks[first.method]
    x, y = [row.seconds for row in curve], [panel.error(row) for row in curve]
    axes.plot(
        x,
        y,
        color=colour,
        marker=marker,
        markersize=5 if first.own else 7,
        markerfacecolor=colour if first.ranks == 1 else "white",
        linestyle=DASHES.get(first.ranks, ":") if first.own else "none",
        linewidth=1.2,
        zorder=3 if first.own else 2,
    )
    if first.method != "auto" or first.ranks != 1 or len(curve) < 2:
        return
    told: list[tuple[float, float, str]] = []
    for row, a, b in zip(curve, x, y, strict=True):
        value = getattr(row, panel.over)
        text = power(value) if panel.over == "tolerance" else f"{value}"
        near = [k for k, point in enumerate(told) if _close((a, b), point)]
        if near:  # points that coincide share a label
            c, d, before = told[near[0]]
            told[near[0]] = (c, d, f"{before}, {text}")
        else:
            told.append((a, b, text))
    for a, b, text in told:
        axes.annotate(text, (a, b), (4, 5), textcoords="offset points", fontsize=6, color=colour)


def _close(point: tuple[float, float], label: tuple[float, float, str]) -> bool:
    """Whether labels of two points would overlap."""
    x, y = (math.log10(a / b) for a, b in zip(point, label[:2], strict=True))
    return abs(x) < 0.4 and abs(y) < 0.5


# Cost against size


def family(row: Row) -> str:
    """Name of the scenes that differ in size only; running bonds grow, other walls are refined."""
    if re.match(r"\d+x\d+", row.case):
        return f"running bonds, {row.elements} elements per half block"
    return "walls, meshes of different size" if re.match(r"W\d", row.case) else ""


def member(row: Row) -> str:
    """Within a family, the scenes on one curve."""
    return re.sub(r"^\d+x\d+ ", "", row.case)


def exponent(curves: Iterable[Sequence[Row]]) -> float:
    """P of seconds ~ dofs^p, with a factor of its own for every curve; nan if there is none."""
    above = below = 0.0
    for curve in curves:
        size = np.log([row.dofs for row in curve])
        above += float(np.dot(size - size.mean(), np.log([row.seconds for row in curve])))
        below += float(np.sum((size - size.mean()) ** 2))
    return above / below if below else math.nan


def draw_cost_size(rows: Sequence[Row], path: Path) -> None:
    """Draw seconds and bonded solves against displacements, a column per family of scenes.

    Args:
        rows: Medians.
        path: A file name ending in .png.
    """
    tolerance = usual_tolerance(rows)
    rows = [row for row in rows if row.tolerance == tolerance or not row.own]
    families = {}
    for name, group in grouped(rows, family).items():
        several = {
            key for key, one in grouped(group, member).items() if len({row.dofs for row in one}) > 1
        }
        if name and several:
            families[name] = [row for row in group if member(row) in several]
    rows = [row for group in families.values() for row in group]
    looks, count = style(rows), max(len(families), 1)
    figure, axes = plt.subplots(
        2, count, figsize=(6.2 * count, 7.4), squeeze=False, sharex="col", layout="constrained"
    )
    for column, (name, group) in zip(axes.T, families.items(), strict=False):
        members = list(grouped(group, member))
        shades = dict(zip(members, np.linspace(1.0, 0.4, len(members)), strict=True))
        handles = []
        for (method, ranks), own in grouped(group, _curve).items():
            curves = [
                sorted(curve, key=lambda row: row.dofs) for curve in grouped(own, member).values()
            ]
            for curve in curves:
                _draw_growth(column, curve, looks[method], shades[member(curve[0])])
            text = f"{method}, {ranks} ranks" if ranks > 1 else method
            slope = exponent(curve for curve in curves if len(curve) > 1)
            text += f": $n^{{{slope:.2f}}}$" if math.isfinite(slope) else ""
            handles.append(_handle(text, *looks[method], ranks))
        order = (
            f" (dark to light: {', '.join(members)})" if len(members) > 1 else f" ({members[0]})"
        )
        column[0].set_title(f"{name}\n{order.strip()}", fontsize=9)
        column[1].set_xlabel("displacements $n$", fontsize=9)
        for place, text in zip(column, ("run time (s)", "bonded solves"), strict=True):
            place.set_xscale("log")
            place.set_yscale("log")
            _widen(place)
            place.set_ylabel(text, fontsize=9)
        column[0].legend(
            handles=handles, fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.02), frameon=False
        )
    note = (
        f"{small_print(rows)} A bonded solve: assemble, analyse, factor, solve with all joints"
        f" closed. Exponents are fitted to the run times, with a factor of its own for every curve."
    )
    _finish(figure, {}, rows, note, path)


def _draw_growth(
    column: Sequence[Any], curve: Sequence[Row], look: tuple[str, str], shade: float
) -> None:
    """One method on scenes that grow: run times above, bonded solves below."""
    ranks, (colour, marker) = curve[0].ranks, look
    for axes, name in zip(column, ("seconds", "bonded_solves"), strict=True):
        values = [getattr(row, name) for row in curve]
        if not all(map(math.isfinite, values)):
            continue
        axes.plot(
            [row.dofs for row in curve],
            values,
            color=colour,
            alpha=shade,
            marker=marker,
            markersize=5,
            markerfacecolor=colour if ranks == 1 else "white",
            linestyle=DASHES.get(ranks, ":"),
            linewidth=1.2,
        )


# Axes


def _grid(count: int) -> tuple[Any, Sequence[Any]]:
    """A figure with so many axes, row by row."""
    columns = min(COLUMNS, max(count, 1))
    lines = -(-max(count, 1) // columns)
    figure, axes = plt.subplots(
        lines,
        columns,
        figsize=(max(WIDTH * columns, 6.6), HEIGHT * lines + 0.9),
        squeeze=False,
        layout="constrained",
    )
    flat = list(axes.ravel())
    for place in flat[count:]:
        place.set_visible(False)
    return figure, flat


def _widen(axes: Any) -> None:
    """Room for two ticks at least, a grid at the decades, small numbers."""
    axes.margins(0.12)
    for axis, limits, change in (
        (axes.xaxis, axes.get_xlim, axes.set_xlim),
        (axes.yaxis, axes.get_ylim, axes.set_ylim),
    ):
        low, high = limits()
        if 0.0 < low < high < LEAST_RANGE * low:
            middle = math.sqrt(low * high)
            change(middle / math.sqrt(LEAST_RANGE), middle * math.sqrt(LEAST_RANGE))
        axis.set_major_locator(LogLocator(numticks=7))
        axis.set_minor_formatter(NullFormatter())
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.3)


def _handle(text: str, colour: str, marker: str, ranks: int = 1, line: bool = True) -> Line2D:
    return Line2D(
        [],
        [],
        color=colour,
        marker=marker,
        markersize=6,
        markerfacecolor=colour if ranks == 1 else "white",
        linestyle=DASHES.get(ranks, ":") if line else "none",
        label=text,
    )


def _finish(figure: Any, looks: Style, rows: Sequence[Row], note: str, path: Path) -> None:
    """Common legend on top, small print below, file."""
    width, height = figure.get_size_inches()
    lines = textwrap.wrap(note, int(17.5 * width))
    handles = [
        _handle(name, colour, marker, line=name in METHODS)
        for name, (colour, marker) in looks.items()
    ]
    several = sorted({row.ranks for row in rows} - {1}) if looks else []
    handles += [_handle(f"{ranks} ranks", "#000000", "o", ranks) for ranks in several]
    columns = max(min(len(handles), int(width / 1.25)), 1)
    bottom, top = 0.13 * len(lines) + 0.1, 0.05 + 0.25 * -(-len(handles) // columns)
    figure.get_layout_engine().set(
        rect=(0.0, bottom / height, 1.0, (height - bottom - top) / height)
    )
    figure.text(
        *(0.08 / width, 0.06 / height, "\n".join(lines)),
        fontsize=7,
        color="#444444",
        va="bottom",
    )
    if handles:
        figure.legend(handles=handles, ncol=columns, loc="upper center", fontsize=9, frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def small_print(rows: Sequence[Row]) -> str:
    """Machine, versions and settings."""
    machines = dict.fromkeys(row.machine for row in rows if row.machine)
    known = dict.fromkeys(part for row in rows for part in row.versions.split(", ") if part)
    own = [row for row in rows if row.own]
    tolerances = ", ".join(power(t) for t in sorted({row.tolerance for row in own}, reverse=True))
    repeats = sorted({row.repeat for row in own})
    runs = "\u2013".join(map(str, dict.fromkeys((repeats[0], repeats[-1])))) if own else ""
    taken = f"medians of {runs} runs" if repeats and repeats[-1] > 1 else "single runs"
    return (
        f"{'; '.join(machines)}. {', '.join(known)}. Tolerance {tolerances}; {taken} in"
        " processes of their own, one thread per rank."
    )


def power(value: float) -> str:
    """A power of ten, short."""
    return f"{value:.0e}".replace("e-0", "e-")


# Table

HEAD = (
    "case | friction | elements | displacements | method | tolerance | ranks | seconds |"
    " bonded solves | factorisations | error | time / auto"
)


def table(rows: Sequence[Row]) -> list[str]:
    """Medians as lines of a markdown table; a status where no run counts.

    Args:
        rows: All runs.
    """
    typical = {row.key: row for row in medians(rows)}
    tolerance = usual_tolerance(rows)
    lines = [f"| {HEAD} |", "|" + "|".join(["---"] * (HEAD.count("|") + 1)) + "|"]
    places = {case: place for place, case in enumerate(grouped(rows, lambda row: row.case))}
    rows = sorted(
        (row for row in rows if row.repeat),
        key=lambda row: (places[row.case], row.elements, row.ranks, not row.own, -row.tolerance),
    )
    for key, group in grouped(rows, lambda row: row.key).items():
        row = typical.get(key, replace(group[-1], seconds=math.nan))
        same = tolerance if math.isnan(row.tolerance) or not row.own else row.tolerance
        auto = typical.get(replace(row, method="auto", tolerance=same).key)
        ratio = math.nan if auto is None else row.seconds / auto.seconds
        lines.append(f"| {' | '.join(_cells(row, key in typical, ratio))} |")
    return lines


def _cells(row: Row, counts: bool, ratio: float) -> list[str]:
    def number(value: float, form: str = ".3g") -> str:
        return format(value, form) if math.isfinite(value) else "\u2013"

    status = "not verified" if row.status == "limit" else row.status.replace("_", " ")
    return [
        row.case,
        number(row.friction),
        str(row.elements),
        str(row.dofs or "\u2013"),
        row.method,
        power(row.tolerance) if row.own else number(row.tolerance, ".1g"),
        str(row.ranks),
        number(row.seconds) if counts else status,
        number(row.bonded_solves if counts else math.nan),
        str(row.factorizations) if counts and row.own else "\u2013",
        number(row.error if counts else math.nan, ".1e"),
        number(ratio if counts else math.nan),
    ]


def main() -> int:
    """Read, draw, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("csv", type=Path, nargs="+", metavar="CSV")
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="cases whose name holds it")
    choice = parser.parse_args()
    match = re.compile(fnmatch.translate(f"*{choice.only}*"), re.IGNORECASE).match
    rows = [row for path in choice.csv for row in read_rows(path) if match(row.case)]
    typical = medians(rows)
    if not typical:
        print("no row counts", file=sys.stderr)
        return 1
    choice.output.mkdir(parents=True, exist_ok=True)
    draw_time_error(typical, choice.output / "time_error.png")
    draw_cost_size(typical, choice.output / "cost_size.png")
    print("\n".join(table(rows)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
