"""Sections of the report: load factors, forces, sensitivity, structure and appendix."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from fenics_contact.output.report.content import Content, Record, Sweep, least
from fenics_contact.output.report.html import (
    bullets,
    heading,
    paragraph,
    picture,
    table,
    value_text,
)
from fenics_contact.output.report.words import (
    KEYS,
    LEFT_OUT,
    MEANING,
    PHASES,
    PICTURES,
    RANGE,
    RESIDUALS,
    STATUS,
    direction_words,
)
from fenics_contact.results.bounds import counted
from fenics_contact.scene.units import PER_METRE, Units

#: Values that are not shown where they are not used: these keys with these values.
UNUSED = {"body", "tilt", "cohesion", "dilatancy", "tensile_strength", "opened", "profile"}
NOTHING = (0.0, [0.0, 0.0], "kept", "uniform")
#: Pressures of loads, which are written in kN/m2 where strengths are in MPa.
PRESSURES = {"traction", "surcharge"}


def loads_and_groups(content: Content) -> Iterator[str]:
    """A picture of the scene, and the loads with their resultants."""
    scene = content.record["scene"]
    units = content.units
    yield heading("Loads and groups")
    if address := content.pictures.get("scene"):
        yield picture(address, PICTURES["scene"])
    rows: list[tuple[str, ...]] = [*_rows(scene["loads"], scene["units"], units)]
    floors = {f"floor {name}": floor for name, floor in (scene.get("floors") or {}).items()}
    rows += _rows(floors, {**scene["units"], "force": "N/m2"}, units)
    for name, force in scene["resultants"].items():
        rows.append((name, "resultant", units.forces(force, 4)))
    yield table(rows, ("load", "what", "value"))
    yield paragraph(
        "The dead load acts first and stays. The live load is multiplied by the load factor."
        " A body force is an acceleration; the force is density times it."
    )


def structure(content: Content) -> Iterator[str]:
    """What was solved: materials, joints and supports with their units."""
    record = content.record
    scene = record["scene"]
    mesh = record["mesh"]
    names = scene["units"]
    units = content.units
    size = scene["size"]
    held = mesh["bodies"] - mesh["floating_bodies"]
    yield heading("The structure")
    yield paragraph(
        f"{counted(mesh['bodies'], 'block')}, {held or 'none'} held by supports.",
        f"Width {units.length(size['width'], 4)}, height {units.length(size['height'], 4)},",
        f"area {size['area']:.4g} m2. Plane {scene['plane']}.",
        f"Thickness {units.length(units.thickness)}." if units.thickness else "",
        "" if units.thickness else "Forces are per metre of thickness.",
    )
    for kind in ("materials", "joints", "foundations"):
        rows = _rows(scene[kind], names, units)
        yield table(rows, ("group", "property", "value"), KEYS[kind])
    yield table(scene["supports"].items(), ("group", "kind"), KEYS["supports"])
    ties = [
        row
        for name, tie in (scene.get("ties") or {}).items()
        for row in _rows({name: tie}, _tie_units(names, tie), units)
    ]
    yield table(ties, ("tie", "property", "value"), KEYS["ties"])
    contacts = [
        (at["group"], at["kind"], at["points"], units.length(at["length"], 4))
        for at in scene["contacts"]
    ]
    yield table(contacts, ("group", "kind", "joint points", "length"), "Where the blocks touch")


def _tie_units(names: Record, tie: Record) -> Record:
    """Units of the numbers of a tie: of one tie with a spacing, else per metre of thickness."""
    both = {key: names[key].split(", ") for key in ("yield", "stiffness", "prestress")}
    chosen = {key: texts[-1] if tie.get("spacing") else texts[0] for key, texts in both.items()}
    units = {key: text.removesuffix(" with a spacing") for key, text in chosen.items()}
    return {**names, **units, "from": "m", "to": "m", "ground": "m"}


def _rows(tables: Record, names: Record, units: Units) -> Iterator[tuple[str, str, str]]:
    """Name, property and value of everything that was given in tables of one kind."""
    for name, given in tables.items():
        for key, value in given.items():
            label = _label(key)
            if isinstance(value, dict):
                for place, part in value.items():
                    inside = part if isinstance(part, dict) else {key: part}
                    texts = (
                        f"{_label(k)} {_value(k, v, names, units)}"
                        for k, v in inside.items()
                        if v is not None
                    )
                    yield name, f"{label} {place}", ", ".join(texts)
            elif value is not None and not (key in UNUSED and value in NOTHING):
                yield name, label, _value(key, value, names, units)


def _label(key: str) -> str:
    return KEYS.get(key, key.replace("_", " "))


def _value(key: str, value: object, names: Record, units: Units) -> str:
    """A value of a key with its unit."""
    return value_text(value, "N/m2" if key in PRESSURES else names.get(key, ""), units)


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
        first, *others = end["tables"]
        yield table(first["rows"])
        yield _ties(content, direction)
        for one in others:
            yield table(one["rows"], one["head"], one["title"]) or heading(one["title"], 3)
            yield paragraph(one["note"]) if one["note"] else ""
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


#: Forces on the joints of more blocks are too small in a picture on a page.
LEGIBLE = 120


def forces(content: Content) -> Iterator[str]:
    """Pictures of forces and stresses that say something."""
    many = content.record["mesh"]["bodies"] > LEGIBLE
    first = ("collapse", "collapse_negative", "scene", "capacity")
    found = {
        stem: address
        for stem, address in content.pictures.items()
        if stem not in first and not (many and stem.startswith("forces"))
    }
    if found:
        yield heading("Forces and stresses")
    for stem, address in found.items():
        more = " Forces are per metre of thickness." if stem.startswith("forces") else ""
        direction = "negative" if stem.endswith("_negative") else "positive"
        if content.details(direction).get("engine") == "faces" and stem.startswith("stress"):
            more = " They are those of elastic blocks under the joint forces of the state."
        yield picture(address, PICTURES[stem] + more)
    if many and "forces" in content.pictures:
        yield paragraph(
            f"The joint forces of more than {LEGIBLE} blocks are too small for this page;"
            " the picture 'forces' in the folder of the result has them."
        )
    if address := content.pictures.get("capacity", ""):
        yield heading("Capacity curve")
        yield picture(address, PICTURES["capacity"])


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
    words = record["words"]
    keys = KEYS | {name: option for name, (option, _, _) in words.items() if option}
    left_out = LEFT_OUT | {name: default for name, (_, default, _) in words.items() if default}
    phases = PHASES | {name: begins for name, (_, _, begins) in words.items() if begins}
    options = scene["solve"]
    rows = [(keys.get(key, key), _option(key, options, left_out)) for key in options]
    rows += [("method of the state reported", value_text(record["method"]))]
    rows += [(MEANING[key], mesh[key]) for key in ("cells", "dofs", "joint_points")]
    rows += [("degree of the displacements", scene["degree"])]
    counts = ("fixed_point", "factorizations")
    rows += [(MEANING[key], value_text(iterations[key])) for key in counts]
    rows += [("processes (MPI ranks)", record["ranks"]), ("date (UTC)", record["date"])]
    yield table(rows)
    seconds = record["seconds"].items()
    times = [(phases.get(name, name), f"{value:.3g} s") for name, value in seconds]
    yield table(times, title="Times")
    yield from _tried(record)
    if record["skipped"]:
        yield heading("What was left out", 3)
        yield bullets(record["skipped"])
    named = {"fenics-contact": record["version"], **record["versions"]}
    yield table([(k, version or "not known") for k, version in named.items()], title="Versions")


def _option(key: str, options: Record, left_out: Mapping[str, str]) -> str:
    """The value of a key of `solve`, or what leaving it out means."""
    if options[key] is not None or key not in left_out:
        return value_text(options[key])
    return "no" if options.get("fast") and left_out[key] != "none" else left_out[key]


def _tried(record: Record) -> Iterator[str]:
    """What was tried in a direction without a verified state, and how it ended."""
    for direction, end in record["ends"].items():
        if end["status"] == "not_converged" and end["attempts"]:
            keys = "name", "outcome", "factorizations"
            rows = [[one[key] for key in keys] for one in end["attempts"]]
            head = "attempt", "how it ended", "factorisations"
            yield table(rows, head, f"What was tried, {direction_words(direction)}")
            yield paragraph(f"In short: {end['reason']}.")
