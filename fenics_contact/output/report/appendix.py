"""The appendix of the report: verification, and how the result was computed."""

from __future__ import annotations

from collections.abc import Iterator

from fenics_contact.output.report.content import Content, Record
from fenics_contact.output.report.html import bullets, heading, paragraph, table, value_text
from fenics_contact.output.report.words import (
    KEYS,
    LEFT_OUT,
    MEANING,
    PHASES,
    RESIDUALS,
    direction_words,
)


def verification(content: Content) -> Iterator[str]:
    """Every condition of a collapse state: what it means, by how much it is missed."""
    yield heading("Appendix: verification")
    yield paragraph(
        "All conditions are computed again from the problem. How the state was found plays no part."
        " A residual is what a condition is missed by, relative to a typical force, displacement"
        " or power of the structure."
    )
    shown = False
    for direction in content.record["ends"]:
        details = content.details(direction)
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
    rows = [(KEYS.get(key, key), _option(key, scene["solve"])) for key in scene["solve"]]
    rows += [("method of the state reported", value_text(record["method"]))]
    rows += [(MEANING[key], mesh[key]) for key in ("cells", "dofs", "joint_points")]
    rows += [("degree of the displacements", scene["degree"])]
    counts = ("fixed_point", "factorizations")
    rows += [(MEANING[key], value_text(iterations[key])) for key in counts]
    rows += [("processes (MPI ranks)", record["ranks"]), ("date (UTC)", record["date"])]
    yield table(rows)
    seconds = record["seconds"].items()
    times = [(PHASES.get(name, name), f"{value:.3g} s") for name, value in seconds]
    yield table(times, title="Times")
    yield from _tried(record)
    if record["skipped"]:
        yield heading("What was left out", 3)
        yield bullets(record["skipped"])
    named = {"fenics-contact": record["version"], **record["versions"]}
    yield table([(k, version or "not known") for k, version in named.items()], title="Versions")


def _option(key: str, options: Record) -> str:
    """The value of a key of `solve`, or what leaving it out means."""
    if options[key] is not None or key not in LEFT_OUT:
        return value_text(options[key])
    return "no" if options.get("fast") and LEFT_OUT[key] != "none" else LEFT_OUT[key]


def _tried(record: Record) -> Iterator[str]:
    """What was tried in a direction without a verified state, and how it ended."""
    for direction, end in record["ends"].items():
        if end["status"] == "not_converged" and end["attempts"]:
            keys = "name", "outcome", "factorizations"
            rows = [[one[key] for key in keys] for one in end["attempts"]]
            head = "attempt", "how it ended", "factorisations"
            yield table(rows, head, f"What was tried, {direction_words(direction)}")
            yield paragraph(f"In short: {end['reason']}.")
