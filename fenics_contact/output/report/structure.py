"""The structure in the report: its picture, materials, joints, supports and loads with units."""

from __future__ import annotations

from collections.abc import Iterator

from fenics_contact.output.report.content import Content, Record
from fenics_contact.output.report.html import (
    heading,
    paragraph,
    picture,
    table,
    value_text,
)
from fenics_contact.output.report.words import KEYS, PICTURES
from fenics_contact.results.words import counted
from fenics_contact.scene.units import Units

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
