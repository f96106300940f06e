"""Load factors in the report: brackets, peak, lowest state, errors, and what they mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fenics_contact.output.report.content import Content, Record
from fenics_contact.output.report.html import heading, paragraph, table
from fenics_contact.output.report.words import RANGE, STATUS, direction_words
from fenics_contact.results.proof import WITHOUT_PATH
from fenics_contact.results.words import alike
from fenics_contact.scene.units import PER_METRE

#: Joints that crush that are listed.
CRUSHED = 8


def load_factors(content: Content) -> Iterator[str]:
    """Load factors with their brackets, ties, what was tried, and what the numbers mean."""
    record = content.record
    yield heading("The range of load factors")
    if record["status"] == "limit":
        yield paragraph(RANGE)
    for direction, end in record["ends"].items():
        yield heading(f"Load factor, {direction_words(direction)}", 3)
        if end["status"] != record["status"]:
            yield paragraph(STATUS[end["status"]])
        if end["reason"]:
            yield paragraph(_reason(end))
        yield table(_rows(direction, end, content))
        yield _ties(content, direction)
        yield _crushing(content, direction)
        yield from (
            table(one["rows"], title=one["title"]) for one in end["answers"] if one["title"]
        )
    if not record["ends"]:
        yield paragraph(f"Reason: {record['reason']}.")


def _reason(end: Record) -> str:
    """Why there is no limit load; what was tried is in the appendix."""
    if end["status"] != "not_converged" or not end["attempts"]:
        return f"Reason: {end['reason']}."
    return f"Reason: {end['reason'].partition('; ')[0]}. The appendix has what was tried."


def _ties(content: Content, direction: str) -> str:
    """Forces of ties at one end."""
    units = content.units
    forces = [
        (tie["name"], units.force(tie["force"], 4), units.force(tie["yield"], 4), tie["state"])
        for tie in content.details(direction).get("ties", [])
    ]
    per = "tension" if units.thickness else f"tension {PER_METRE}"
    return table(forces, ("tie", per, "yields at", "state"), "Ties")


def _crushing(content: Content, direction: str) -> str:
    """Where joints crush at one end, the longest lengths first."""
    places = content.details(direction).get("crushing")
    if places is None:
        return ""
    title = "Joints that crush"
    if not places:
        return heading(title, 3) + paragraph("No joint is at its compressive strength.")
    units = content.units
    ordered = sorted(places, key=lambda one: one["length"], reverse=True)
    rows = [
        (
            units.place(one["position"], 3),
            one["group"],
            units.small(one["length"]),
            units.force(one["normal_force"], 3),
        )
        for one in ordered[:CRUSHED]
    ]
    per = "normal force" if units.thickness else f"normal force {PER_METRE}"
    found = table(rows, ("end of the joint", "group", "crushes over", per), title)
    less = len(places) - CRUSHED
    return found + (paragraph(f"{less} more crush over less.") if less > 0 else "")


def _rows(direction: str, end: Record, content: Content) -> Iterator[Sequence[str]]:
    """Load factor, bracket and errors of one end."""
    details = content.details(direction)
    factor = end["load_factor"]
    bounds = end["bounds"]
    sides = ("lower", "upper")
    if direction == "negative":
        sides = sides[::-1]
    name = "load factor" if end["status"] == "limit" else "load factor reached, not verified"
    if end["status"] == "unbounded":
        yield "load factor", "no limit"
        return
    yield name, "none" if factor is None else alike(factor, factor)
    torn = details.get("torn")
    if torn:
        length = content.units.length(torn["length_m"])
        yield from _torn_rows(factor, torn, [bounds[side] for side in sides], length)
    else:
        yield from _bracket_rows(end, factor, bounds, sides)
    if end["status"] != "limit":
        return
    if end.get("proof"):
        yield "model", WITHOUT_PATH
    else:
        gap = details["error_estimate"]
        apart = "not known" if gap is None else f"{gap:.0e}"
        yield "difference from rigid blocks with the friction forces of this state", apart
    yield from (row for one in end["answers"] if not one["title"] for row in one["rows"])


def _bracket_rows(
    end: Record, factor: float, bounds: Record, sides: Sequence[str]
) -> Iterator[Sequence[str]]:
    """What the rigid-block programs say of the load factor."""
    sure = bounds.get("frictionless")
    first, beyond = (bounds[side] for side in sides)
    if sure is not None:
        yield "carried without any friction", alike(sure, factor) if sure else "nothing"
    yield "no collapse state below", "not known" if first is None else alike(first, factor)
    yield "surely not carried beyond", alike(beyond, factor)
    if bounds.get("meet") and end["status"] == "limit":
        yield "other collapse states", "none exists: the bracket is closed"


def _torn_rows(
    factor: float, torn: Record, bounds: Sequence[float | None], length: str
) -> Iterator[Sequence[str]]:
    """Joints that have lost their strength, and what is known of the load factor without it."""
    ends = ["not known" if bound is None else alike(bound, factor) for bound in bounds]
    yield "joints that have lost their strength", length
    yield "load factor with all strengths", alike(torn["load_factor_whole"], factor)
    yield "bracket of the blocks with these joints torn", f"{ends[0]} to {ends[1]}"
