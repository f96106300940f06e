"""Tables of docs/cost.md and benchmarks/README.md, from the rows that benchmarks/run.py measured.

Each stands between marks that name it; `run.py --write` writes them, tests compare them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.pictures import made_with, newest

Row = Mapping[str, Any]
Rows = Mapping[str, Sequence[Row]]

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "docs" / "cost.md", ROOT / "benchmarks" / "README.md")
#: Parts with which the others of their group are compared.
MEASURES = ("load factor alone", "default")
ONE_CORE = "default"


def number(value: float, digits: int = 2) -> str:
    """A number with so many digits; "-" where there is none."""
    if not math.isfinite(value):
        return "-"
    places = max(digits - 1 - math.floor(math.log10(abs(value))), 0) if value else 0
    return f"{value:.{places}f}"


def small(value: float) -> str:
    """A gap."""
    return f"{value:.0e}".replace("e-0", "e-") if math.isfinite(value) else "-"


def table(head: str, rows: Iterable[Sequence[str]], measured: Iterable[Row]) -> list[str]:
    """A table, and what measured it."""
    names, rows = head.split(" | "), list(rows)
    if not rows:
        return ["Not measured yet."]
    lines = [f"| {head} |", "|" + "---|" * len(names)]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    return [*lines, "", f"Measured: {made_with(measured)}."]


def factors(row: Row) -> str:
    """Factorisations of the structure and of block modes."""
    modes = row["mode_factorizations"]
    return f"{row['factorizations'] - modes:.0f} + {modes:.0f}"


def sizes(rows: Rows, method: str) -> list[str]:
    """Walls that grow, by one engine, or by default."""
    found = [row for row in rows["cost_size"] if row["method"] == method]
    found = [row for row in found if row["status"] == "limit"]
    cells = [
        [
            row["scene"].replace(" friction", ", friction"),
            f"{row['blocks']:.0f}",
            f"{row['displacements']:.0f}",
            f"{row['load_factor']:.6f}",
            small(row.get("gap", math.nan)),
            number(row["seconds"]),
            number(row["seconds"] / row["bonded_seconds"]),
            factors(row),
        ]
        for row in found
    ]
    head = (
        "scene | blocks | displacements | load factor | gap | seconds | bonded solves"
        " | structure + block modes"
    )
    return table(head, cells, found)


def tolerances(rows: Rows) -> list[str]:
    """Load factors at two tolerances."""
    by = {(row["scene"], row["method"]): row for row in rows["tolerance"]}
    cells = []
    for scene in dict.fromkeys(row["scene"] for row in rows["tolerance"]):
        loose, usual = (by[scene, method] for method in ("1e-3", "1e-6"))
        apart = abs(loose["load_factor"] / usual["load_factor"] - 1.0)
        sides = [(f"{row['load_factor']:.6f}", factors(row)) for row in (loose, usual)]
        name = scene.replace(" friction", ", friction")
        cells.append([name, sides[0][0], small(loose["gap"]), sides[0][1], *sides[1], small(apart)])
    head = (
        "scene | 1e-3: load factor | gap | structure + block modes"
        " | 1e-6: load factor | structure + block modes | apart"
    )
    return table(head, cells, rows["tolerance"])


def parts(rows: Rows) -> list[str]:
    """What switching off a part costs."""
    by = {(row["scene"], row["method"]): row for row in rows["parts"]}
    cells, measure = [], MEASURES[0]
    for part in dict.fromkeys(row["method"] for row in rows["parts"]):
        measure = part if part in MEASURES else measure
        ratios: dict[str, float] = {}
        costs, lost, other = [], [], []
        for scene, name in by:
            row, whole = by[scene, name], by.get((scene, measure))
            if name != part or part in MEASURES or whole is None or whole["status"] != "limit":
                continue
            if row["status"] != "limit":
                lost.append(scene)
                continue
            ratios[scene] = row["seconds"] / whole["seconds"]
            costs.append(max(row["cost"], 1e-3) / max(whole["cost"], 1e-3))
            if abs(row["load_factor"] / whole["load_factor"] - 1.0) > 1e-5:
                other.append(scene)
        if ratios:
            worst = max(ratios, key=lambda scene: ratios[scene])
            cells.append(
                [
                    f"{part}{'' if measure == MEASURES[0] else ' (of the default)'}",
                    number(mean(ratios.values())),
                    number(mean(costs)),
                    f"{number(ratios[worst])} ({worst})",
                    ", ".join(lost) or "-",
                    ", ".join(other) or "-",
                ]
            )
    head = "without | CPU | factorisations | worst CPU | not solved | other load factor"
    return table(head, cells, rows["parts"])


def mean(values: Iterable[float]) -> float:
    """Geometric mean."""
    logarithms = [math.log(value) for value in values]
    return math.exp(sum(logarithms) / len(logarithms))


def command_line(rows: Rows) -> list[str]:
    """Whole runs: seconds of CPU with and without `--fast`, of small scenes."""
    found = {(row["scene"], row["method"]): row for row in rows["command_line"]}
    cells = []
    for scene in dict.fromkeys(scene for scene, _ in found):
        fast, usual = (found.get((scene, method)) for method in ("fast", ONE_CORE))
        if fast and usual:
            ratio = usual["cpu"] / fast["cpu"]
            cells.append([scene, *(number(x) for x in (fast["cpu"], usual["cpu"], ratio))])
    swept = [row for row in found.values() if row["method"] == "sweep"]
    cells += [
        [f"{row['scene']}, sweep of 21 frictions", "-", number(row["cpu"]), "-"] for row in swept
    ]
    return table("scene | `--fast`, s | default, s | default / fast", cells, rows["command_line"])


def two_cores(rows: Rows) -> list[str]:
    """Wall time of a default run, and that of others in units of it."""
    others = ("mpirun 2", "jobs 2")
    found = {(row["scene"], row["method"]): row for row in rows["command_line"]}
    cells = []
    for scene in dict.fromkeys(scene for scene, method in found if method in others):
        if (scene, ONE_CORE) not in found:
            continue
        one = found[scene, ONE_CORE]["seconds"]
        times = [found.get((scene, other), {}).get("seconds", math.nan) for other in others]
        cells.append([scene, number(one), *(number(x / one) for x in times)])
    head = "scene | one core, s | `mpirun -n 2` | `--jobs 2`"
    return table(head, cells, rows["command_line"])


#: What stands between the marks of a name.
SECTIONS: dict[str, Callable[[Rows], list[str]]] = {
    "default": lambda rows: sizes(rows, "auto"),
    "faces": lambda rows: sizes(rows, "faces"),
    "path": lambda rows: sizes(rows, "path"),
    "tolerance": tolerances,
    "parts": parts,
    "command line": command_line,
    "two cores": two_cores,
}


def page(text: str, rows: Rows) -> str:
    """A page with its tables of these rows."""
    rows = {name: newest(found) for name, found in rows.items()}
    for name, lines in SECTIONS.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        if begin not in text:
            continue
        first, last = text.index(begin) + len(begin), text.index(end)
        text = text[:first] + "\n\n" + "\n".join(lines(rows)) + "\n\n" + text[last:]
    return text


def write_page(rows: Rows) -> None:
    """Write the tables into the pages."""
    for path in PAGES:
        path.write_text(page(path.read_text(), rows))
