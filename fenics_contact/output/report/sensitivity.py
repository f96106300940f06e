"""What a sweep says: beside a result its sensitivity, or on a page of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from fenics_contact.output.report.content import Content, Sweep, least
from fenics_contact.output.report.html import heading, paragraph, picture, table

#: Rows that the report of a result has room for, and that of a sweep.
ROWS, MOST_ROWS = 30, 1000


def sensitivity(content: Content) -> Iterator[str]:
    """Load factors over what a sweep varied; nothing without a sweep."""
    if content.sweep is not None:
        yield heading("Sensitivity")
        yield from of_sweep(content.sweep, ROWS)


def sweep_parts(sweep: Sweep, labels: Sequence[str]) -> Iterator[str]:
    """The page of a sweep alone: its picture, the worst case, its table."""
    yield heading(f"Load factors over {' and '.join(sweep.keys)}", 1)
    version = f"Computed with fenics-contact {sweep.version}"
    yield paragraph(" \N{MIDDLE DOT} ".join([*labels, version]), kind="labels")
    yield from of_sweep(sweep, MOST_ROWS)


def of_sweep(sweep: Sweep, most: int) -> Iterator[str]:
    """What a sweep found, with at most so many rows of its table."""
    solved = sorted((row for row in sweep.rows if row["status"] == "limit"), key=least)
    count = f"The sweep in '{sweep.folder}' varies {' and '.join(sweep.keys)}."
    if len(sweep.rows) < sweep.points:
        count += f" It was stopped: {len(sweep.rows)} of {sweep.points} points are there."
    if solved:
        span = f"from {least(solved[0]):.4g} to {least(solved[-1]):.4g}."
        over = f"Over its {len(solved)} limit loads the load factor goes {span}"
        yield paragraph(count, over, _lowest(sweep.keys, solved[0]))
    else:
        yield paragraph(count, "It has no limit load.")
    if sweep.picture:
        yield picture(sweep.picture, "Load factor over what the sweep varies.")
    if sweep.worst:
        yield picture(sweep.worst, "Mechanism where the load factor is lowest.")
    negative = any(row.get("load_factor_negative") for row in sweep.rows)
    columns = ["load_factor", *(["load_factor_negative"] if negative else [])]
    head = [*sweep.keys, "status", "load factor", *(["live load reversed"] if negative else [])]
    rows = [
        [*(row[key] for key in sweep.keys), row["status"].replace("_", " ")]
        + [_short(row.get(name) or "") for name in columns]
        for row in sweep.rows[:most]
    ]
    yield table(rows, head)
    if len(sweep.rows) > most:
        yield paragraph(f"These are the first {most} of {len(sweep.rows)} rows of sweep.csv.")


def _lowest(keys: Sequence[str], row: Mapping[str, str]) -> str:
    """The worst case: where the load factor is lowest, and its bracket."""
    where = ", ".join(f"{key} = {row[key]}" for key in keys)
    end = "" if least(row) == float(row["load_factor"] or "inf") else "_negative"
    reversed_load = " with the live load reversed" if end else ""
    ends = [_short(row.get(f"{side}{end}") or "") for side in ("lower", "upper")]
    found = f"{_short(row[f'load_factor{end}'])} at {where}{reversed_load}"
    return f"The lowest is {found}; its bracket is {ends[0]} to {ends[1]}."


def _short(number: str) -> str:
    """A number of the table with five digits; nothing for none."""
    try:
        return f"{float(number):.5g}" if number else "-"
    except ValueError:
        return number
