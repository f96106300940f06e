"""A result on one page: report.html, made from result.json and the files beside it; and as PDF.

The page needs no other file. A page inside of it moves the blocks and has the only script; print
has pictures instead. All texts of the user are escaped. WeasyPrint makes the PDF.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from fenics_contact.errors import InputError, OutputError
from fenics_contact.output.folder import replace_file
from fenics_contact.output.report.answer import (
    assumptions,
    first_page,
    given_rows,
    gravity_of,
    how_it_fails,
    picture_height,
    sentence,
    way_of,
)
from fenics_contact.output.report.content import (
    RECORD,
    Content,
    Labels,
    Record,
    SweepRecord,
    address_of,
    least,
    read_content,
    read_mechanisms,
    read_sweep,
    start,
)
from fenics_contact.output.report.html import (
    IN_PLANE,
    KEYS,
    MEANING,
    NOTES,
    PICTURES,
    RANGE,
    RESIDUALS,
    RIGID,
    STATUS,
    STYLE,
    WITH_STRENGTH,
    WITHOUT_STRENGTH,
    bullets,
    direction_words,
    heading,
    paragraph,
    picture,
    table,
    text,
    value_text,
)
from fenics_contact.results.bounds import counted, equal
from fenics_contact.scene.units import PER_METRE
from fenics_contact.scene.words import floor_text, law_text, material_text, tie_ends, tie_text

_log = logging.getLogger("fenics_contact")

#: The page.
PAGE = "report.html"
#: What `solve.gap` is; joints have gaps, too.
GAP = "gap asked for, relative"
#: Headings of curves, by name of the picture.
CURVES = {
    "capacity": "Capacity curve",
    "beyond": "After the peak",
    "beyond_negative": "After the peak, live load reversed",
}
#: Rows that the report of a result has room for, and that of a sweep.
ROWS, MOST_ROWS = 30, 1000
NO_WRITER = (
    "--pdf needs WeasyPrint, which is not there: install the Debian package 'weasyprint' (apt"
    " install weasyprint) or `pip install weasyprint`, or leave --pdf out and print the HTML page"
    " from a browser"
)

#: A part of the page, as HTML.
Section = Callable[[Content], Iterator[str]]


def write_report(
    folder: Path,
    target: Path | None = None,
    pdf: Path | None = None,
    labels: Labels | None = None,
) -> list[Path]:
    """Write the page on the result, or the sweep, in a folder, on this rank.

    Args:
        folder: Where a result was written to, or a sweep.
        target: The page; report.html in the folder by default.
        pdf: The same as PDF, if it is wished.
        labels: Project and author.

    Returns:
        What was written.

    Raises:
        InputError: If the folder holds no result, or one of a version that kept less, if a file
            has another ending or its folder is read-only, or if WeasyPrint, which makes the PDF,
            is not installed. Nothing is written then.
        OutputError: If a file cannot be written.
    """
    labels = labels or Labels()
    targets = {"-o": target or folder / PAGE, **({"--pdf": pdf} if pdf else {})}
    for option, path in targets.items():
        ending = ".pdf" if option == "--pdf" else ".html"
        if path.suffix.lower() != ending:
            raise InputError(f"{option} {path}: a file that ends with {ending} is written")
        there = path.parent.is_dir()
        if path.is_dir() or (there and not os.access(path.parent, os.W_OK)):
            reason = "it is a folder" if path.is_dir() else "no right to, or a read-only disk"
            raise InputError(f"cannot write '{path}': {reason}; choose with {option}")
    writer: Any = None
    if pdf:
        try:
            writer = import_module("weasyprint")
        except (ImportError, OSError) as error:
            raise InputError(NO_WRITER) from error
        for name in ("weasyprint", "fontTools"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        apart = not (folder / RECORD).exists()
        sweep = read_sweep(folder) if apart else None
        rows = read_mechanisms(folder) if apart and sweep is None else None
        if rows is not None:
            title = f"Mechanisms: {rows['title']}"
            page = _page(title, _of_mechanisms(title, Content(rows, labels=labels), folder))
        elif sweep is None:
            content = read_content(folder, labels)
            page = report_page(content)
            if content.missing:
                _log.warning("warning: %s", content.missing)
        else:
            title = heading(f"Load factors over {' and '.join(sweep.keys)}", 1)
            made = labels.line(f"Computed with fenics-contact {sweep.version}")
            parts = [title, paragraph(made, kind="labels"), *_of_sweep(sweep, MOST_ROWS)]
            page = _page(f"Sweep: {sweep.folder}", parts)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{folder / RECORD} is damaged ({error!r}); solve the scene again"
        ) from error
    for option, path in targets.items():
        data = pdf_of(writer, page) if option == "--pdf" else page.encode("utf-8")
        try:
            replace_file(path, data)
        except OSError as error:
            reason = f"{error.strerror}; choose with {option}"
            raise OutputError(f"cannot write '{path}': {reason}") from None
    return list(targets.values())


def pdf_of(writer: Any, page: str) -> bytes:
    """A page of HTML as PDF by WeasyPrint; nothing but what the page holds itself is read."""

    def data_alone(address: str) -> Any:
        if not address.startswith("data:"):
            raise ValueError("a report reads no other file")
        return writer.default_url_fetcher(address)

    known = getattr(writer, "URLFetcher", None)  # from WeasyPrint 68 on
    fetcher = data_alone if known is None else known(allowed_protocols=("data",))
    pdf: bytes = writer.HTML(string=page, url_fetcher=fetcher).write_pdf()
    return pdf


def report_page(content: Content) -> str:
    """The page on a result, as HTML."""
    parts: list[str] = []
    for section, kind in SECTIONS.items():
        parts.append(f'<section class="{kind}">' if kind else "<section>")
        parts += [*section(content), "</section>"]
    return _page(content.record["title"] or "Limit load", parts)


def _page(name: str, parts: Iterable[str]) -> str:
    """A page of parts with a title, as HTML."""
    title = text(name)
    wide = '<meta name="viewport" content="width=device-width, initial-scale=1">'  # of a phone
    head = f'<meta charset="utf-8">{wide}<title>{title}</title><style>{STYLE}</style>'
    body = "\n".join(parts)
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>\n{body}\n</body></html>\n'


def loads_and_groups(content: Content) -> Iterator[str]:
    """A picture of the scene, and the loads with their resultants."""
    scene = content.record["scene"]
    units = content.units
    yield heading("Loads and groups")
    if address := content.pictures.get("scene"):
        yield picture(address, PICTURES["scene"])
    loads = {name: scene["loads"][name] for name in ("dead", "live")}
    rows: list[tuple[str, ...]] = [*given_rows(loads, scene["units"], units)]
    floors = (scene.get("floors") or {}).items()
    rows += [(f"floor {name}", "force", floor_text(floor, units)) for name, floor in floors]
    soils = {f"soil {name}": soil for name, soil in (scene.get("soil") or {}).items()}
    rows += given_rows(soils, scene["units"], units)
    for name, force in scene["resultants"].items():
        rows.append((name, "resultant", units.forces(force, 4)))
    yield table(rows, ("load", "what", "value"))
    yield paragraph(
        "The dead load acts first and stays. The live load is multiplied by the load factor."
        " A body force is an acceleration; the force is density times it."
    )


def structure(content: Content) -> Iterator[str]:
    """What was solved: materials, groups, laws of contacts, supports and ties."""
    record = content.record
    scene = record["scene"]
    mesh = record["mesh"]
    units = content.units
    size = scene["size"]
    held = mesh["bodies"] - mesh["floating_bodies"]
    sides = (f"{name} {units.length(size[name], 4)}" for name in size if name != "area")
    yield heading("Appendix: the structure")
    yield paragraph(
        f"{counted(mesh['bodies'], 'block')}, {held or 'none'} held by supports or ground.",
        f"{', '.join(sides).capitalize()}.",
        f"Area {size['area']:.4g} m2. Plane {scene['plane']}." if "area" in size else "",
        f"Thickness {units.length(scene['thickness'])}." if scene["thickness"] else "",
        "" if units.thickness else "Forces are per metre of thickness.",
    )
    stones = scene["materials"].items()
    rows = [(name, material_text(one, gravity_of(scene), units)) for name, one in stones]
    yield table(rows, title="Materials")
    parts = scene.get("groups", ())
    groups = [(one["group"], one["blocks"], units.bulk(one["volume"], "m3", 4)) for one in parts]
    yield table(groups, ("group", "blocks", "volume"), "Groups")
    laws = []
    for kind in ("joint", "foundation"):
        found = {at["group"]: at for at in scene["contacts"] if at["kind"] == kind}
        for name, law in scene[f"{kind}s"].items():
            *_, count, extent = found.get(name, {"none": 0, "at all": 0.0}).values()
            many = units.length(extent, 4) if "area" in size else units.bulk(extent, "m2", 4)
            laws.append((f"{kind} {name}", law_text(law, units), count, many))
    where = ("joint points", "length") if "area" in size else ("contacts", "area")
    yield table(laws, ("", "law", *where), "Where the blocks touch")
    yield table(scene.get("supports", {}).items(), ("group", "kind"), "Supports")
    ties = scene["ties"].items()
    held_by = [(name, tie_ends(one, units), tie_text(one, units)) for name, one in ties]
    yield table(held_by, ("tie", "where", "what it carries"), "Ties")


def load_factors(content: Content) -> Iterator[str]:
    """Load factors with their brackets, ties, what was tried, and what the numbers mean."""
    record = content.record
    units = content.units
    per = "tension" if units.thickness else f"tension {PER_METRE}"
    yield heading("The range of load factors")
    if record["status"] == "limit":
        yield paragraph(RANGE)
    told: dict[str, dict[str, str]] = {}  # by title and direction: one beside the other
    for direction, end in record["directions"].items():
        first, *others = end["tables"]
        told.setdefault("Load factor", {})[direction] = _load_factor(record, end, first["rows"])
        forces = [
            (tie["name"], units.force(tie["force"], 4), units.force(tie["yield"], 4), tie["state"])
            for tie in end["ties"]
        ]
        if forces:
            head = ("tie", per, "yields at", "state")
            told.setdefault("Ties", {})[direction] = table(forces, head)
        for one in others:
            note = paragraph(one["note"]) if one["note"] else ""
            told.setdefault(one["title"], {})[direction] = table(one["rows"], one["head"]) + note
    both = len(record["directions"]) > 1
    words = {name: way_of(record, name) for name in record["directions"]}
    for title, parts in told.items():
        yield '<div class="halves">' * both
        for direction, part in parts.items():
            yield f"<div>{heading(f'{title}, {words[direction]}', 3)}{part}</div>"
        yield "</div>" * both
    if not record["directions"]:
        yield paragraph(f"Reason: {record['reason']}.")


def _load_factor(record: Record, end: Record, rows: Sequence[Sequence[str]]) -> str:
    """What one end of the range of load factors is, how it was found, or why not."""
    parts = [paragraph(sentence(STATUS[end["status"]]))] * (end["status"] != record["status"])
    if end["reason"]:
        reason = f"{end['reason']}."
        if end["status"] == "not_converged" and end["attempts"]:
            reason = f"{reason.partition('; ')[0]}. The appendix has what was tried."
        parts.append(paragraph(f"Reason: {reason}"))
    if end["proof"]:
        parts.append(paragraph(sentence(end["proof"])))
    return "".join(parts) + table(row for row in rows if row[1] != "0")


def forces(content: Content) -> Iterator[str]:
    """Pictures of forces and stresses that say something, and of what is carried on the way."""
    first = ("collapse", "collapse_negative", "scene", *CURVES)
    found = {stem: shown for stem, shown in content.pictures.items() if stem not in first}
    if found or content.missing:
        yield heading("Forces and stresses")
    if content.missing:
        yield paragraph(sentence(content.missing))
    for stem, address in found.items():
        per_metre = stem.startswith("forces") and not content.units.thickness
        more = " Forces are per metre of thickness." * per_metre
        direction = "negative" if stem.endswith("_negative") else "positive"
        end = content.record["directions"].get(direction, {})
        if end.get("engine") == "faces" and stem.startswith("stress"):
            more = " They are those of elastic blocks under the joint forces of the state."
        yield picture(address, PICTURES[stem] + more)
    for stem, name in CURVES.items():
        if address := content.pictures.get(stem, ""):
            yield heading(name)
            yield picture(address, PICTURES[stem])


def sensitivity(content: Content) -> Iterator[str]:
    """Load factors over what a sweep varied; nothing without a sweep."""
    if content.sweep is not None:
        yield heading("Sensitivity")
        yield from _of_sweep(content.sweep, ROWS)


def _of_mechanisms(title: str, content: Content, folder: Path) -> Iterator[str]:
    """Page 1 with the worst mechanism and assumptions, the table, and pictures of the others."""
    columns = {"load_factor": "load factor, g", "a0": "a0*, m/s2", "over_demand": "a0* / demand"}
    record = content.record
    rows = record["rows"]
    given = [key for key in columns if any(row[key] is not None for row in rows)]
    yield f'<section class="first">{heading(title, 1)}'
    yield paragraph(content.made, kind="labels")
    rests = [row for row in assumptions(content) if not row[0].startswith("live load")]
    for worst in rows[:1]:
        yield paragraph(f"The worst of {len(rows)}: {worst['line']}.", kind="status limit")
        yield paragraph(sentence(worst["moves"]))
        height = picture_height(rests, [worst["moves"]])
        yield f'<div class="above" style="--picture: {height:.1f}cm">'
        yield f"{_picture_of(worst, folder)}</div>"
    yield f"{heading('Assumptions')}{table(rests)}</section>"
    yield f'<section class="long break">{heading("All mechanisms")}'
    yield paragraph(
        "Each is a limit load by itself, verified: what is named is pushed with what moves with it,"
        " the worst first.",
        record["stopped"] and sentence(record["stopped"]),
    )
    cells = [
        [f"{number} {row['part']} {row['way']}" + f"; also {row['also']}" * bool(row["also"])]
        + ["-" if row[key] is None else f"{row[key]:.4g}" for key in given]
        + [row["moves"], row["ties_in_report"]]
        for number, row in enumerate(rows, 1)
    ]
    yield table(cells, ["", *(columns[key] for key in given), "what moves", "ties"])
    yield paragraph(*map(sentence, record["remarks"]))
    yield from (*warnings(content), *notes(content))
    yield from (_picture_of(row, folder, f"{number} ") for number, row in enumerate(rows[1:], 2))
    yield "</section>"


def _picture_of(row: Record, folder: Path, number: str = "") -> str:
    """The picture of a row of the table of mechanisms; nothing without."""
    address = address_of(folder / row.get("picture", ""))
    return picture(address, f"{number}{row['part']} {row['way']}: {row['moves']}.") * bool(address)


def _of_sweep(sweep: SweepRecord, most: int) -> Iterator[str]:
    """What a sweep found, with at most so many rows of its table."""

    def short(row: Mapping[str, str], name: str) -> str:
        """A number of the table with five digits; a dash for none."""
        number = row.get(name) or ""
        try:
            return f"{float(number):.5g}" if number else "-"
        except ValueError:
            return number

    def at(row: Mapping[str, str]) -> str:
        """Values of what varies."""
        return ", ".join(f"{key} = {row[key]}" for key in sweep.keys)

    solved = sorted((row for row in sweep.rows if row["status"] == "limit"), key=least)
    count = f"The sweep in '{sweep.folder}' varies {' and '.join(sweep.keys)}."
    if len(sweep.rows) < sweep.points:
        count += f" It was stopped: {len(sweep.rows)} of {sweep.points} points are there."
    if solved:
        row = solved[0]
        span = f"goes from {least(row):.4g} to {least(solved[-1]):.4g}"
        one = equal([least(row) for row in solved])
        span = f"is {least(row):.5g}" if one else span
        over = f"Over its {len(solved)} limit loads the load factor {span}."
        end = "" if least(row) == float(row["load_factor"] or "inf") else "_negative"
        where = at(row) + " with the live load reversed" * bool(end)
        bounds = {"at least": f"lower{end}", "at most": f"upper{end}"}
        known = {word: short(row, key) for word, key in bounds.items() if row.get(key)}
        bracket = " to ".join(known.values()) if len(known) != 1 else " ".join(*known.items())
        worst = f"The lowest is {short(row, f'load_factor{end}')} at {where}"
        worst += f"; its bracket is {bracket}." if known else "."
        worst += f" It carries {row['load']}." if row.get("load") else ""
        first = min(solved, key=start)
        early = f"The lowest a0* is {start(first):.4g} m/s2 at {at(first)}."
        yield paragraph(
            count, over, "" if one else worst, early if start(first) < start(row) else ""
        )
    else:
        yield paragraph(count, "It has no limit load.")
    if sweep.picture:
        yield picture(sweep.picture, "Load factor over what the sweep varies.")
    if sweep.worst:
        yield picture(sweep.worst, "Mechanism where the load factor is lowest.")
    more = {"load_factor_negative": "live load reversed", "load": "load"}
    more |= {"a0": "a0*, m/s2", "a0_negative": "a0*, reversed, m/s2", "moves": "what moves"}
    given = {key: told for key, told in more.items() if any(row.get(key) for row in sweep.rows)}
    columns = {"load_factor": "load factor"} | given
    rows = [
        [*(row[key] for key in sweep.keys), row["status"].replace("_", " ")]
        + [short(row, name) for name in columns]
        for row in sweep.rows[:most]
    ]
    yield table(rows, [*sweep.keys, "status", *columns.values()])
    if len(sweep.rows) > most:
        yield paragraph(f"These are the first {most} of {len(sweep.rows)} rows of sweep.csv.")


def warnings(content: Content) -> Iterator[str]:
    """Warnings of the run; nothing without any."""
    if told := content.record["warnings"]:
        yield heading("Warnings")
        yield bullets(told)


def notes(content: Content) -> Iterator[str]:
    """What readers should know of the theory."""
    scene = content.record["scene"]
    kinds = "materials", "joints", "foundations"
    given = [one.get("compressive_strength") for kind in kinds for one in scene[kind].values()]
    yield heading("What to know when you use these numbers")
    rigid = "cells" not in content.record["mesh"]
    planar = [IN_PLANE] * (content.record.get("dimension") != 3)
    blocks = RIGID if rigid else WITH_STRENGTH if any(given) else WITHOUT_STRENGTH
    yield bullets([*NOTES, *planar, blocks])


def verification(content: Content) -> Iterator[str]:
    """Every condition of a collapse state: what it means, by how much it is missed."""
    yield heading("Appendix: verification")
    yield paragraph(
        "All conditions are computed again from the problem. How the state was found plays no part."
        " A residual is what a condition is missed by, relative to a typical force, displacement"
        " or power of the structure."
    )
    shown = False
    for direction, end in content.record["directions"].items():
        if not end["residuals"]:
            continue
        shown = True
        allowed = end["tolerances"]
        rows = []
        for name, value in end["residuals"].items():
            good = value is not None and value <= allowed[name]
            # One below zero has room left.
            amount = "not known" if value is None else f"{value:.1e}" if value > 0.0 else "0"
            label, meaning = RESIDUALS.get(name, (name.replace("_", " "), ""))
            rows.append((label, meaning, amount, f"{allowed[name]:.0e}", "yes" if good else "NO"))
        head = ("condition", "what it means", "residual", "allowed", "passed")
        yield table(rows, head, f"State with the {direction_words(direction)}")
    if not shown:
        yield paragraph("There is no collapse state to verify.")


def computation(content: Content) -> Iterator[str]:
    """Method, counts, times and versions."""
    record = content.record
    scene = record["scene"]
    mesh = record["mesh"]
    iterations = record["iterations"]
    yield heading("Appendix: how it was computed")
    words = record["words"]
    keys = KEYS | {name: option for name, (option, _) in words.items() if option} | {"gap": GAP}
    rows: list[tuple[object, ...]] = [
        (keys.get(key, key), value_text(value))
        for key, value in scene["solve"].items()
        if value is not None
    ]
    if record["method"]:
        rows += [("method of the state reported", value_text(record["method"]))]
        rows += [("degree of the displacements", scene["degree"])]
    counts = mesh | iterations
    rows += [(words, value_text(counts[key])) for key, words in MEANING.items() if key in counts]
    rows += [("processes (MPI ranks)", record["ranks"]), ("date (UTC)", record["date"])]
    yield table([*rows, ("time without writing", f"{record['seconds']['total']:.3g} s")])
    for direction, end in record["directions"].items():
        if end["status"] == "not_converged" and end["attempts"]:
            names = "name", "outcome", "factorizations"
            tried = [[one[name] for name in names] for one in end["attempts"]]
            head = "attempt", "how it ended", "factorisations"
            yield table(tried, head, f"What was tried, {direction_words(direction)}")
            yield paragraph(f"In short: {end['reason']}.")
    if record.get("skipped"):
        yield heading("What was left out", 3)
        yield bullets(record["skipped"])
    named = {"fenics-contact": record["version"], **record["versions"]}
    used = "area" in record["scene"]["size"] or record["scene"]["output"].get("stress")
    lacking = "not known" if used else "not used"
    yield table([(k, version or lacking) for k, version in named.items()], title="Versions")


#: Parts of the page in their order, each of which begins with its heading, and their classes:
#: "break" begins on a new page in print.
SECTIONS: Mapping[Section, str] = {
    first_page: "first",
    loads_and_groups: "break",
    how_it_fails: "",
    load_factors: "",
    warnings: "",
    notes: "",
    forces: "pairs",
    sensitivity: "",
    structure: "appendix columns",
    verification: "appendix",
    computation: "appendix columns",
}
