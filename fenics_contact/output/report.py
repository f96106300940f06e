"""A result on one page: report.html, made from result.json and the pictures beside it.

The page needs no other file and no script. All texts of the user are escaped.
"""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from fenics_contact.errors import InputError, OutputError
from fenics_contact.output.plotting import rounded_alike
from fenics_contact.output.report_words import (
    KEYS,
    MEANING,
    NOTES,
    PHASES,
    PICTURES,
    RESIDUALS,
    STATUS,
    STYLE,
)
from fenics_contact.output.seismic_words import TITLE, seismic_rows

#: The file of a result that the page is made from, and the page.
RECORD, PAGE = "result.json", "report.html"
#: Pictures that a page can hold, by ending; the first that exists.
IMAGES = {".png": "image/png", ".svg": "image/svg+xml"}
#: Blocks that are listed by number.
LISTED = 40
#: Values that are 0 where they are not used.
UNUSED = {"body", "tilt", "cohesion", "dilatancy", "tensile_strength", "opened", "profile"}
NOTHING = (0.0, [0.0, 0.0], "kept", "uniform")

Record = Mapping[str, Any]


def write_report(folder: Path, target: Path | None = None) -> Path:
    """Write the page on the result in a folder, on this rank.

    Args:
        folder: Where a result was written to.
        target: The page; report.html in the folder by default.

    Returns:
        Where the page is.

    Raises:
        InputError: If the folder holds no result, or one of a version that kept less.
        OutputError: If the page cannot be written.
    """
    record = _read(folder)
    target = target or folder / PAGE
    try:
        page = report_page(record, _pictures(folder, record.get("files", ())))
    except (AttributeError, IndexError, KeyError, TypeError) as error:
        raise InputError(
            f"{folder / RECORD} is damaged ({error!r}); solve the scene again"
        ) from error
    unfinished = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        unfinished.write_text(page, encoding="utf-8")
        os.replace(unfinished, target)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise OutputError(f"cannot write '{target}': {error.strerror}; choose with -o") from None
    return target


def report_page(record: Record, pictures: Mapping[str, str]) -> str:
    """The page, as HTML, of the content of result.json and data URIs of pictures by stem."""
    parts = [
        *_answer(record),
        *_mechanisms(record),
        *_figures(pictures),
        *_scene(record),
        *_verification(record),
        _heading("Warnings"),
        _list(record["warnings"]) if record["warnings"] else _paragraph("None."),
        *_computation(record),
        _heading("What to know when you use these numbers"),
        _list(NOTES),
    ]
    title = _text(record["title"] or "Limit load")
    head = f'<meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>\n' + "\n".join(
        [f"<h1>{title}</h1>", *parts, "</body></html>\n"]
    )


def _read(folder: Path) -> Record:
    """The content of result.json."""
    path = folder / RECORD
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        there = "cannot be read" if path.exists() else "is not there"
        raise InputError(
            f"{path} {there}; give the folder that `fenics-contact solve` wrote to"
        ) from error
    if isinstance(record, dict) and record.get("status") == "equilibrium":
        raise InputError(f"{path} is that of a state at a given load factor; give a limit load")
    if not isinstance(record, dict) or "ends" not in record or "scene" not in record:
        raise InputError(
            f"{path} is not of this version, or is no result; solve the scene again for a report"
        )
    return record


def _pictures(folder: Path, files: Iterable[str]) -> dict[str, str]:
    """Data URIs of the known pictures among the files of a result, by stem."""
    found = {}
    for stem in PICTURES:
        for suffix, kind in IMAGES.items():
            path = folder / f"{stem}{suffix}"
            if path.name in files and stem not in found and path.is_file():
                data = base64.b64encode(path.read_bytes()).decode("ascii")
                found[stem] = f"data:{kind};base64,{data}"
    return found


# ---- pieces of a page; all text passes through one of these


def _text(value: object) -> str:
    """A text of the user, or ours, for HTML; characters that are not printable are spelled out."""
    return escape("".join(c if c.isprintable() else repr(c)[1:-1] for c in str(value)))


def _paragraph(*sentences: str, kind: str = "") -> str:
    attribute = f' class="{escape(kind)}"' if kind else ""
    return f"<p{attribute}>{_text(' '.join(sentences))}</p>"


def _heading(text: str, level: int = 2) -> str:
    return f"<h{level}>{_text(text)}</h{level}>"


def _list(items: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{_text(item)}</li>" for item in items) + "</ul>"


def _table(rows: Iterable[Sequence[object]], head: Sequence[str] = (), title: str = "") -> str:
    """A table below its title, or nothing without rows; the first cell of a row names it."""
    lines = []
    for name, *values in rows:
        cells = "".join(f"<td>{_text(value)}</td>" for value in values)
        lines.append(f'<tr><th scope="row">{_text(name)}</th>{cells}</tr>\n')
    if not lines:
        return ""
    above = "".join(f'<th scope="col">{_text(cell)}</th>' for cell in head)
    table = f"<table>{f'<tr>{above}</tr>' if head else ''}{''.join(lines)}</table>"
    return _heading(title, 3) + table if title else table


def _value(value: Any, unit: str = "") -> str:
    """A number, word, or list of them, with its unit."""
    if isinstance(value, (list, tuple)):
        text = "(" + ", ".join(_value(item) for item in value) + ")"
    elif isinstance(value, bool) or value is None:
        text = {True: "yes", False: "no", None: "-"}[value]
    else:
        text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}" if unit else text


def _alike(value: float | None, leading: float | None) -> str:
    """A load factor rounded to the decimals of the leading one."""
    if value is None:
        return "not known"
    return rounded_alike([leading if leading else value, value])[1]


def _counted(number: int, what: str) -> str:
    """A number of blocks or joints."""
    return f"{number} {what}{'s' * (number != 1)}"


def _numbers(blocks: Sequence[int]) -> str:
    """Blocks by number, as far as there is room."""
    rest = f" and {len(blocks) - LISTED} more" if len(blocks) > LISTED else ""
    return ", ".join(map(str, blocks[:LISTED])) + rest


# ---- the sections


def _direction(name: str) -> str:
    return "live load reversed" if name == "negative" else "live load as given"


def _details(record: Record, direction: str) -> Record:
    """Where result.json has the verification of one end."""
    return record["negative"] if direction == "negative" and "negative" in record else record


def _answer(record: Record) -> Iterator[str]:
    """Status, load factors, brackets, and what the mesh does to them."""
    status = record["status"]
    yield _paragraph(f"{status.replace('_', ' ')}:", STATUS[status], kind=f"status {status}")
    for direction, end in record["ends"].items():
        yield _heading(f"Load factor, {_direction(direction)}")
        if end["status"] != status:
            yield _paragraph(STATUS[end["status"]])
        if end["reason"]:
            yield _paragraph(f"Reason: {end['reason']}.")
        yield _table(_load_factor_rows(direction, end, record))
        forces = [
            (tie["name"], _value(tie["force"], "N/m"), tie["state"])
            for tie in _details(record, direction).get("ties", [])
        ]
        head = "tie", "tension per metre of thickness", "state"
        yield _table(forces, head, "Ties")
        check = (record.get("seismic") or {}).get(direction)
        yield _table(seismic_rows(check), title=TITLE)
        if end["status"] == "not_converged" and end["attempts"]:
            head = "attempt", "how it ended", "factorisations"
            keys = "name", "outcome", "factorizations"
            rows = [[one[key] for key in keys] for one in end["attempts"]]
            yield _table(rows, head, "What was tried")
    if not record["ends"]:
        yield _paragraph(f"Reason: {record['reason']}.")


def _load_factor_rows(direction: str, end: Record, record: Record) -> Iterator[Sequence[str]]:
    """Load factor, bracket and errors of one end."""
    factor = end["load_factor"]
    bounds = end["bounds"]
    sides = ("lower", "upper")
    if direction == "negative":
        sides = sides[::-1]
    name = "load factor" if end["status"] == "limit" else "load factor reached, not verified"
    if end["status"] == "unbounded":
        yield "load factor", "no limit"
        return
    yield name, "none" if factor is None else _alike(factor, factor)
    torn = _details(record, direction).get("torn")
    if torn:
        yield from _torn_rows(factor, torn, [bounds[side] for side in sides])
    else:
        yield from _bracket_rows(end, factor, bounds, sides)
    if end["status"] == "limit":
        details = _details(record, direction)
        yield from _peak_rows(factor, details["peak"])
        yield from _lowest_rows(factor, details)
        yield from _error_rows(factor, details, record)


def _lowest_rows(factor: float, details: Record) -> Iterator[Sequence[str]]:
    """Whether a lower collapse state is known, and all that were found where there are several."""
    lowest = details.get("lowest")
    if not lowest:
        return
    searches = f"{lowest['starts']} search{'es' * (lowest['starts'] != 1)}"
    text = {
        "lower": (
            f"{_alike(lowest['load_factor'], factor)}: another collapse state, verified. A load"
            " that rises may end there: the capacity curve tells."
        ),
        "none": (
            f"no lower state found by {searches}"
            if lowest["starts"]
            else "there is no lower one, as the bracket proves"
        ),
        "not_known": f"not known: {lowest['reason']}",
    }
    yield "lowest collapse state found", text[lowest["status"]]
    for number, state in enumerate(details.get("states", [])[1:], start=2):
        yield f"collapse state {number}", _alike(state["load_factor"], factor)


def _bracket_rows(
    end: Record, factor: float, bounds: Record, sides: Sequence[str]
) -> Iterator[Sequence[str]]:
    """What the rigid-block programs say of the load factor."""
    sure = bounds.get("frictionless")
    first, beyond = (bounds[side] for side in sides)
    lost = "not known, or the dead load needs friction to stand"
    yield "surely carried, from 0 to", lost if sure is None else _alike(sure, factor)
    yield "no collapse state before", "not known" if first is None else _alike(first, factor)
    yield "surely not carried beyond", _alike(beyond, factor)
    if bounds.get("meet") and end["status"] == "limit":
        yield "other collapse states", "none exists: the bracket is closed"


def _torn_rows(
    factor: float, torn: Record, bounds: Sequence[float | None]
) -> Iterator[Sequence[str]]:
    """Joints that have lost their strength, and what is known of the load factor without it."""
    ends = ["not known" if bound is None else _alike(bound, factor) for bound in bounds]
    yield "joints that have lost their strength", _value(torn["length_m"], "m")
    yield "load factor with all strengths", _alike(torn["load_factor_whole"], factor)
    yield "bracket of the blocks with these joints torn", f"{ends[0]} to {ends[1]}"


def _peak_rows(factor: float, peak: Record | None) -> Iterator[Sequence[str]]:
    """What the loading path carries before it falls to the collapse."""
    if peak is None or peak["status"] == "none":
        return
    if peak["status"] == "not_known":
        yield "carried on the way to the collapse", f"not known: {peak['reason']}"
        return
    carried = _alike(peak["load_factor"], factor)
    moved = _value(1e3 * peak["displacement_m"], "mm")
    yield (
        "carried on the way to the collapse, at least",
        f"{carried}, at {moved}; then joints slip and the load falls. This depends on the"
        " stiffness and on the mesh: the load factor above is the one to quote.",
    )


def _error_rows(factor: float, details: Record, record: Record) -> Iterator[Sequence[str]]:
    """What is known of the error of a load factor."""
    gap = details["error_estimate"]
    mesh = details["discretization"]
    yield "difference from rigid blocks with the friction forces of this state", _value(gap)
    if not mesh:
        yield "error by the mesh", "not estimated"
        return
    length = mesh["hinge_length"]
    error = mesh["hinge_error"]
    if length is not None:
        yield "length of hinges in this mesh", _value(1e3 * length, "mm")
    yield "load factor for point hinges", _alike(mesh["load_factor_point_hinges"], factor)
    small = error is not None and abs(error) <= record["scene"]["solve"]["tolerance"]
    percent = "not known" if error is None else f"{100 * error:.2g} %"
    yield "error by the length of hinges", "below the tolerance" if small else percent
    if mesh["unknown"]:
        yield "what is not known of the error by the mesh", mesh["unknown"]
    for change in mesh["state_changes"]:
        before, after = (_alike(change[key], factor) for key in ("before", "after"))
        yield "another collapse state for shorter hinges", f"{before} to {after}"


def _mechanisms(record: Record) -> Iterator[str]:
    """How the blocks move, in words."""
    yield _heading("How it fails")
    total = record["mesh"]["bodies"]
    if record["falling_blocks"]:
        falling = record["falling_blocks"]
        text = f"{len(falling)} of {_counted(total, 'block')} fall: {_numbers(falling)}."
        yield _paragraph(text, "No joint resists this motion.")
    for direction, end in record["ends"].items():
        prefix = f"With the {_direction(direction)}:"
        if end["wedged_blocks"]:
            wedged = end["wedged_blocks"]
            text = f"{len(wedged)} of {_counted(total, 'block')} wedge: {_numbers(wedged)}."
            yield _paragraph(prefix, text)
        elif end["mechanism"]:
            doubt = "This motion is not verified." if end["status"] != "limit" else ""
            yield _paragraph(prefix, *_motion(end["mechanism"], total), doubt)
        else:
            yield _paragraph(prefix, "no collapse mode is known.")


def _motion(moves: Record, total: int) -> Iterator[str]:
    """Sentences on a collapse mode."""
    moving = moves["moving"]
    turning = moves["turning"]
    x, y = moves["centre"]
    way = ", ".join(f"{part:+.2f}" for part in moves["direction"])
    yield f"{len(moving)} of {_counted(total, 'block')} move."
    if len(turning) == len(moving):
        yield "All of these turn."
    else:
        yield f"{len(turning)} of these turn; the others shift without turning."
    yield f"The moving blocks are: {_numbers(moving)}."
    yield f"The fastest is block {moves['fastest']} with its centre at ({x:.4g}, {y:.4g}) m."
    if any(moves["direction"]):
        yield f"Its centre moves in the direction ({way})."
    else:
        yield "It turns about its centre."
    yield f"Of {_counted(moves['joints'], 'joint')}:"
    yield f"{moves['parting']} open over their whole length,"
    yield f"{moves['rocking']} open over a part of it (the blocks rock there),"
    yield f"and {moves['sliding']} slide while closed."


def _figures(pictures: Mapping[str, str]) -> Iterator[str]:
    """All pictures that there are, each with what it shows."""
    if pictures:
        yield _heading("Pictures")
    for stem, address in pictures.items():
        words = _text(PICTURES[stem])
        image = f'<img src="{escape(address)}" alt="{words}">'
        yield f"<figure>{image}<figcaption>{words}</figcaption></figure>"


def _scene(record: Record) -> Iterator[str]:
    """What was solved: materials, joints, supports and loads with their units."""
    scene = record["scene"]
    mesh = record["mesh"]
    units = scene["units"]
    yield _heading("The structure")
    size = scene["size"]
    plane = scene["plane"]
    yield _paragraph(
        f"{_counted(mesh['bodies'], 'block')}.",
        f"Supports do not hold {mesh['floating_bodies']} of them.",
        f"Width {_value(size['width'])} m, height {_value(size['height'])} m,",
        f"area {_value(size['area'])} m2. Plane {plane}.",
        "Forces are per metre of thickness.",
    )
    for name in ("materials", "joints", "foundations"):
        yield _table(_rows(scene[name], units), ("group", "property", "value"), KEYS[name])
    yield _table(scene["supports"].items(), ("group", "kind"), KEYS["supports"])
    yield _table(_rows(scene.get("ties", {}), units), ("tie", "property", "value"), KEYS["ties"])
    contacts = [
        (at["group"], at["kind"], at["points"], _value(at["length"])) for at in scene["contacts"]
    ]
    head = ("group", "kind", "joint points", "length (m)")
    yield _table(contacts, head, "Where the blocks touch")
    rows: list[tuple[str, ...]] = [*_rows(scene["loads"], units)]
    for name, force in scene["resultants"].items():
        rows.append((name, "resultant", _value(force, units["resultants"])))
    yield _table(rows, ("load", "what", "value"), "Loads")
    yield _paragraph(
        "The dead load acts first and stays. The live load is multiplied by the load factor."
        " A body force is an acceleration; the force is density times it."
    )


def _rows(tables: Record, units: Record) -> Iterator[tuple[str, str, str]]:
    """Name, property and value of everything that was given in tables of one kind."""
    for name, table in tables.items():
        for key, value in table.items():
            label = KEYS.get(key, key.replace("_", " "))
            if isinstance(value, dict):
                for place, part in value.items():
                    inside = part if isinstance(part, dict) else {key: part}
                    texts = (
                        f"{KEYS.get(k, k.replace('_', ' '))} {_value(v, units.get(k, ''))}"
                        for k, v in inside.items()
                        if v is not None
                    )
                    yield name, f"{label} {place}", ", ".join(texts)
            elif value is not None and not (key in UNUSED and value in NOTHING):
                yield name, label, _value(value, units.get(key, ""))


def _verification(record: Record) -> Iterator[str]:
    """Every condition of a collapse state: what it means, by how much it is missed."""
    yield _heading("Verification")
    yield _paragraph(
        "All conditions are computed again from the problem. How the state was found plays no part."
        " A residual is what a condition is missed by, relative to a typical force, displacement"
        " or power of the structure."
    )
    shown = False
    for direction in record["ends"]:
        details = _details(record, direction)
        if not details.get("residuals"):
            continue
        shown = True
        allowed = details["tolerances"]
        rows = []
        for name, value in details["residuals"].items():
            good = value is not None and value <= allowed[name]
            # One below zero has room left.
            amount = "not known" if value is None else f"{value:.1e}" if value > 0.0 else "0"
            label, meaning = RESIDUALS.get(name, (name.replace("_", " "), ""))
            rows.append((label, meaning, amount, f"{allowed[name]:.0e}", "yes" if good else "NO"))
        head = ("condition", "what it means", "residual", "allowed", "passed")
        yield _table(rows, head, f"State with the {_direction(direction)}")
    if not shown:
        yield _paragraph("There is no collapse state to verify.")


def _computation(record: Record) -> Iterator[str]:
    """Method, counts, times and versions."""
    scene = record["scene"]
    mesh = record["mesh"]
    iterations = record["iterations"]
    yield _heading("How it was computed")
    rows = [(KEYS.get(key, key), _value(value)) for key, value in scene["solve"].items()]
    rows += [("method of the state reported", _value(record["method"]))]
    rows += [(MEANING[key], mesh[key]) for key in ("cells", "dofs", "joint_points")]
    rows += [("degree of the displacements", scene["degree"])]
    rows += [(MEANING[key], _value(iterations[key])) for key in ("fixed_point", "factorizations")]
    rows += [("processes (MPI ranks)", record["ranks"]), ("date (UTC)", record["date"])]
    yield _table(rows)
    seconds = record["seconds"].items()
    times = [(PHASES.get(name, name), _value(value, "s")) for name, value in seconds]
    yield _table(times, title="Times")
    if record["skipped"]:
        yield _heading("What the scene did not need", 3)
        yield _list(record["skipped"])
    named = {"fenics-contact": record["version"], **record["versions"]}
    yield _table([(k, version or "not known") for k, version in named.items()], title="Versions")
