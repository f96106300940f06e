"""Pieces of the report's page. All text passes through `text`, which escapes it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from fenics_contact.scene.units import Units

#: Blocks that are listed by number.
LISTED = 40


def text(value: object) -> str:
    """A text of the user, or ours, for HTML; characters that are not printable are spelled out."""
    return escape("".join(c if c.isprintable() else repr(c)[1:-1] for c in str(value)))


def paragraph(*sentences: str, kind: str = "") -> str:
    """A paragraph of sentences."""
    attribute = f' class="{escape(kind)}"' if kind else ""
    return f"<p{attribute}>{text(' '.join(filter(None, sentences)))}</p>"


def heading(words: str, level: int = 2) -> str:
    """A heading."""
    return f"<h{level}>{text(words)}</h{level}>"


def bullets(items: Iterable[str]) -> str:
    """A list."""
    return "<ul>" + "".join(f"<li>{text(item)}</li>" for item in items) + "</ul>"


def table(rows: Iterable[Sequence[object]], head: Sequence[str] = (), title: str = "") -> str:
    """A table below its title, or nothing without rows; the first cell of a row names it."""
    lines = []
    for name, *values in rows:
        cells = "".join(f"<td>{text(value)}</td>" for value in values)
        lines.append(f'<tr><th scope="row">{text(name)}</th>{cells}</tr>\n')
    if not lines:
        return ""
    above = "".join(f'<th scope="col">{text(cell)}</th>' for cell in head)
    whole = f"<table>{f'<tr>{above}</tr>' if head else ''}{''.join(lines)}</table>"
    return heading(title, 3) + whole if title else whole


def picture(address: str, words: str) -> str:
    """A picture with what it shows; `address` is a data URI."""
    image = f'<img src="{escape(address)}" alt="{text(words)}">'
    return f"<figure>{image}<figcaption>{text(words)}</figcaption></figure>"


def value_text(value: Any, unit: str = "", units: Units | None = None) -> str:
    """A number, word, or list of them, with its unit, that of SI or what `units` make of it."""
    if isinstance(value, (list, tuple)):
        parts = [value_text(item, unit, units) for item in value]
        name = "" if units is None else units.converted(0.0, unit)[1]
        inside = ", ".join(part.removesuffix(f" {name or unit}") for part in parts)
        return f"({inside}) {name or unit}".strip()
    if isinstance(value, bool) or value is None:
        words = {True: "yes", False: "no", None: "-"}[value]
    elif isinstance(value, (int, float)) and units is not None and unit:
        number, unit = units.converted(value, unit)
        words = f"{number:.6g}"
    else:
        words = f"{value:.6g}" if isinstance(value, float) else str(value)
    return f"{words} {unit}" if unit else words


def numbers(blocks: Sequence[int]) -> str:
    """Blocks by number, as far as there is room."""
    rest = f" and {len(blocks) - LISTED} more" if len(blocks) > LISTED else ""
    return ", ".join(map(str, blocks[:LISTED])) + rest
