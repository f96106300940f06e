"""Words and pieces of the report's page: what states, residuals, keys and pictures mean.

All text passes through `text`, which escapes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from fenics_contact.scene.units import Units

#: How much an answer is worth, by its status.
STATUS: Mapping[str, str] = {
    "limit": "verified, see the appendix.",
    "unbounded": "nothing limits it.",
    "unstable": "there is no equilibrium. The motion of its blocks proves this.",
    "no_equilibrium": "no equilibrium was found, which is no proof that there is none.",
    "not_converged": "not converged, no verified state was found. Its numbers below are not a limit"
    " load.",
}

#: Name and meaning of every residual of the verification.
RESIDUALS: Mapping[str, tuple[str, str]] = {
    "equilibrium": ("equilibrium", "Forces and moments on every block and node balance."),
    "tension": ("no tension", "No joint pulls beyond its tensile strength."),
    "pressure": ("no tension", "No contact pulls beyond its tensile strength."),
    "ties": ("ties", "No tie pushes, or pulls beyond the tension at which it yields."),
    "penetration": ("no penetration", "No block enters another one, or the ground."),
    "complementarity": ("contact", "Where a joint is open, it carries no force."),
    "friction": ("friction", "No shear force is larger than the joint allows."),
    "slip_direction": (
        "direction of slip",
        "Where a joint has slipped, the full friction acts, and it acts against the slip.",
    ),
    "work": ("work", "The live load does the work that was prescribed."),
    "mode_work": ("work of the mode", "The live load does work 1 on the collapse mode."),
    "mode_penetration": ("mode without penetration", "The blocks can move by the collapse mode."),
    "mode_elastic": ("mode of rigid blocks", "The collapse mode does not deform the blocks."),
    "mode_power": ("power", "Friction takes up all the work that the loads do on the mode."),
    "limit": (
        "limit load",
        "Rigid blocks with the friction forces of this state have the same limit load.",
    ),
    "bracket": ("bracket", "The load factor lies in its bracket."),
    "crushing": ("compressive strength", "No joint carries more than its strength."),
}

KEYS: dict[str, str] = {
    "body": "body force",
    "profile": "factor on the body force over the height above the foot, (m, factor)",
    "method": "method asked for",
    "tolerance": "tolerance on the load factor, relative",
    "control": "what is prescribed (work of the live load, or load factor)",
    "slip": "slip is measured from",
    "engine": "what finds the load factor",
    "gap": "width of gaps",
    "states": "collapse state reported",
    "accuracy": "accuracy wished",
    "time": "limit of time",
    "fast": "the load factor and its bracket alone",
}

MEANING: Mapping[str, str] = {
    "cells": "cells of the mesh",
    "dofs": "displacements (unknowns)",
    "joint_points": "joint points",
    "fixed_point": "passes of the fixed point",
    "factorizations": "factorisations",
}

_SHOWN = {
    "collapse": "How the blocks move in the collapse",
    "forces": "Joint forces at collapse, each through its centre of pressure",
    "thrust": "Lines of thrust",
    "stress": "Principal stresses",
    "stresses": "Largest pressure and tension on the sides of blocks",
    "beyond": "What is left as the structure leans on, and its poses",
}

#: What pictures show, by name of the file without its ending, in the order of the page.
PICTURES: Mapping[str, str] = {
    **{name: f"{words}." for name, words in _SHOWN.items()},
    **{f"{name}_negative": f"{words}, live load reversed." for name, words in _SHOWN.items()},
    "scene": "Materials, groups and loads.",
    "capacity": "Capacity curve: load factor against displacement.",
}

RANGE = (
    "With friction a structure can have several collapse states. The load factor is that of the"
    " state that was found and verified. The bracket holds for all of them: below its lower end"
    " none exists, and beyond its upper end nothing is carried. Where the ends meet the load factor"
    " is the only one. A structure with less friction forces than this state has falls earlier, but"
    " not before the lower end."
)

NOTES = (
    "What is carried without any friction is surely carried.",
    "Displacements are small.",
)
IN_PLANE = "Loads and blocks of a planar model do not leave its plane."
#: What the blocks do, without and with a compressive strength.
WITHOUT_STRENGTH = "The blocks are elastic. They do not crush or crack."
WITH_STRENGTH = (
    "The blocks are elastic and do not crack. Straight joints crush at the compressive strength;"
    " elsewhere nothing crushes."
)
RIGID = "The blocks are rigid and do not crack. Their joints are elastic."

#: How the page looks.
STYLE = Path(__file__).with_name("style.css").read_text(encoding="utf-8")
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
    above = f"<thead><tr>{above}</tr></thead>" if head else ""
    whole = f"<table>{above}<tbody>{''.join(lines)}</tbody></table>"
    return heading(title, 3) + whole if title else whole


def picture(address: str, words: str) -> str:
    """A picture with what it shows; `address` is a data URI."""
    image = f'<img src="{escape(address)}" alt="{text(words)}">'
    return f"<figure>{image}<figcaption>{text(words)}</figcaption></figure>"


def viewer_frame(page: str) -> str:
    """The page inside of another one."""
    style = "width: 100%; height: 36em; border: 0"
    return f'<iframe title="Blocks that move" style="{style}" srcdoc="{escape(page)}"></iframe>'


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


def direction_words(name: str) -> str:
    """A direction of the live load in words."""
    return "live load reversed" if name == "negative" else "live load as given"
