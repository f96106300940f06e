"""Load factors in the report: brackets, peak, lowest state, errors, and what they mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fenics_contact.output.report.content import Content, Record
from fenics_contact.output.report.html import alike, heading, paragraph, table
from fenics_contact.output.report.words import RANGE, STATUS, direction_words
from fenics_contact.output.seismic_words import TITLE, seismic_rows
from fenics_contact.results.proof import NOT_FROM_REST, SELF_STRESS, WITHOUT_PATH
from fenics_contact.scene.units import PER_METRE, Units

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
        check = (record.get("seismic") or {}).get(direction)
        yield table(seismic_rows(check, content.units), title=TITLE)
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
        yield from _peak_rows(factor, details["peak"])
        yield from _error_rows(factor, details, content.record)
    yield from _lowest_rows(end, details)


def _lowest_rows(end: Record, details: Record) -> Iterator[Sequence[str]]:
    """Whether a lower collapse state is known, and all that were found where there are several."""
    factor = end["load_factor"]
    lowest = details.get("lowest")
    if not lowest:
        return
    searches = f"{lowest['starts']} search{'es' * (lowest['starts'] != 1)}"
    proved = end["bounds"].get("meet")
    text = {
        "lower": (
            f"{alike(lowest['load_factor'], factor)}, {SELF_STRESS}; {NOT_FROM_REST}. Its gap is"
            f" {lowest['gap'] or 0.0:.0e}."
        ),
        "none": (
            "there is no lower one, as the bracket proves"
            if proved
            else f"no lower state found by {searches}"
        ),
        "not_known": f"not known: {lowest['reason']}",
    }
    yield "lowest collapse state found", text[lowest["status"]]
    states = details.get("states", [])
    for number, state in enumerate(states if len(states) > 1 else [], start=1):
        where = f"{alike(state['load_factor'], factor)}, gap {state['gap'] or 0.0:.0e}"
        yield f"collapse state {number}", f"{where} (from: {state['start']})"


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


def _peak_rows(factor: float, peak: Record | None) -> Iterator[Sequence[str]]:
    """What the loading path carries before it falls to the collapse."""
    if peak is None or peak["status"] == "none":
        return
    if peak["status"] == "not_known":
        yield "carried on the way to the collapse", f"not known: {peak['reason']}"
        return
    carried = alike(peak["load_factor"], factor)
    moved = Units().small(peak["displacement_m"])
    yield (
        "carried on the way to the collapse, at least",
        f"{carried}, at {moved}; then joints slip and the load falls. This depends on the"
        " stiffness and on the mesh: the load factor above is the one to quote.",
    )


def _error_rows(factor: float, details: Record, record: Record) -> Iterator[Sequence[str]]:
    """What is known of the error of a load factor."""
    gap = details["error_estimate"]
    mesh = details["discretization"]
    apart = "not known" if gap is None else f"{gap:.0e}"
    yield "difference from rigid blocks with the friction forces of this state", apart
    if not mesh:
        yield "error by the mesh", "not estimated"
        return
    length = mesh["hinge_length"]
    error = mesh["hinge_error"]
    if length is not None:
        yield "length of hinges in this mesh", Units().small(length)
    yield "load factor for point hinges", alike(mesh["load_factor_point_hinges"], factor)
    small = error is not None and abs(error) <= record["scene"]["solve"]["tolerance"]
    percent = "not known" if error is None else f"{100 * error:.2g} %"
    yield "error by the length of hinges", "below the tolerance" if small else percent
    if mesh["unknown"]:
        yield "what is not known of the error by the mesh", mesh["unknown"]
    for change in mesh["state_changes"]:
        before, after = (alike(change[key], factor) for key in ("before", "after"))
        yield "another collapse state for shorter hinges", f"{before} to {after}"
