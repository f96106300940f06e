"""What a sweep that lies beside a result says of its sensitivity."""

from __future__ import annotations

from collections.abc import Iterator

from fenics_contact.output.report.content import Content
from fenics_contact.output.report.html import heading, paragraph, picture, table

#: Rows that a page has room for.
ROWS = 30


def sensitivity(content: Content) -> Iterator[str]:
    """Load factors over what a sweep varied; nothing without a sweep."""
    sweep = content.sweep
    if sweep is None:
        return
    yield heading("Sensitivity")
    solved = [float(row["load_factor"]) for row in sweep.rows if row["status"] == "limit"]
    count = f"The sweep in '{sweep.folder}' varies {' and '.join(sweep.keys)}."
    if solved:
        span = f"Over its {len(solved)} limit loads the load factor goes from {min(solved):.4g}"
        yield paragraph(count, f"{span} to {max(solved):.4g}.")
    else:
        yield paragraph(count, "It has no limit load.")
    if sweep.picture:
        yield picture(sweep.picture, "Load factor over what the sweep varies.")
    negative = any(row.get("load_factor_negative") for row in sweep.rows)
    columns = ["load_factor", *(["load_factor_negative"] if negative else [])]
    head = [*sweep.keys, "status", "load factor", *(["live load reversed"] if negative else [])]
    rows = [
        [*(row[key] for key in sweep.keys), row["status"].replace("_", " ")]
        + [_short(row.get(name) or "") for name in columns]
        for row in sweep.rows[:ROWS]
    ]
    yield table(rows, head)
    if len(sweep.rows) > ROWS:
        yield paragraph(f"These are the first {ROWS} of {len(sweep.rows)} rows of sweep.csv.")


def _short(number: str) -> str:
    """A number of the table with five digits; nothing for none."""
    try:
        return f"{float(number):.5g}" if number else "-"
    except ValueError:
        return number
