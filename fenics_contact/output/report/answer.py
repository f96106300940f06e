"""Page 1 of the report: the answer in one sentence, the collapse, and what was assumed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fenics_contact.output.report.content import Content, Record
from fenics_contact.output.report.html import heading, paragraph, picture, table, value_text
from fenics_contact.output.report.words import PICTURES, STATUS, STATUS_OF_ONE, direction_words
from fenics_contact.scene.units import PER_METRE, Units

#: Acceleration that is written as 1 g, m/s2.
GRAVITY = 9.81
#: A component of an acceleration below this part of the other one is none.
LEVEL = 1e-9
#: Height of a structure over its width from which the assumptions are beside its picture.
TALL = 1.6


@dataclass(frozen=True)
class PrintedPicture:
    """Height of the picture in print, such that page 1 (A4) has the assumptions too, cm.

    Attributes:
        beside: With the assumptions beside it.
        most: Largest above the assumptions.
        least: Smallest above them: the picture is to be seen.
        page: What picture and assumptions have together.
        line: Height of a line of the assumptions; all but the first of a row have a little less.
        letters: That a line has room for.
    """

    beside: float = 17.0
    most: float = 12.5
    least: float = 6.0
    page: float = 17.0
    line: float = 0.54
    letters: int = 75

    def above(self, rows: Sequence[tuple[str, str]]) -> float:
        """Height of a picture above the assumptions, cm."""
        lines = sum(math.ceil(len(value) / self.letters) for _, value in rows)
        return min(max(self.page - self.line * lines, self.least), self.most)


PICTURE = PrintedPicture()
#: Groups of one kind that page 1 has room for; the tables of the structure have all.
SHOWN = 4


def first_page(content: Content) -> Iterator[str]:
    """Title, project, author and date, answer, collapse picture, assumptions."""
    record = content.record
    status = record["status"]
    yield heading(record["title"] or "Limit load", 1)
    yield paragraph(_labels(content), kind="labels")
    yield paragraph(answer(record), kind=f"status {status}")
    yield paragraph(*_verdict(record))
    proofs = [end.get("proof") for end in record["ends"].values()]
    yield from (paragraph(f"{text[0].upper()}{text[1:]}.") for text in proofs if text)
    rows = list(_assumptions(record, content.units))
    size = record["scene"]["size"]
    beside = size["height"] > TALL * size["width"]
    height = PICTURE.beside if beside else PICTURE.above(rows)
    yield f'<div class="{"beside" if beside else "above"}" style="--picture: {height:.1f}cm">'
    direction = next(iter(record["ends"]), "positive")
    if address := content.picture_of("collapse", direction):
        yield picture(address, _caption(record, direction))
    yield f"<div>{heading('Assumptions', 2)}{table(rows)}</div></div>"


def _verdict(record: Record) -> Iterator[str]:
    """How much the answer is worth, for each direction where these differ."""
    ends = record["ends"]
    if len({end["status"] for end in ends.values()}) < 2:
        status = record["status"]
        name = "verified" if status == "limit" else status.replace("_", " ")
        if any(end.get("rolling") for end in ends.values()):
            name = "verified as drawn, but blocks roll (see the warnings)"
        yield f"{name.capitalize()}: {STATUS[status]}"
        return
    for direction, end in ends.items():
        yield f"{direction_words(direction).capitalize()}: {STATUS_OF_ONE[end['status']]}"


def _labels(content: Content) -> str:
    """Project, author, date and program in one line."""
    record = content.record
    made = f"Computed on {str(record['date'])[:10]} with fenics-contact {record['version']}"
    return " \N{MIDDLE DOT} ".join([*content.labels.named(), made])


def _caption(record: Record, direction: str) -> str:
    """What the picture of one end shows."""
    if record["status"] == "unstable":
        return "Blocks that move under the dead load, by number."
    if record["ends"][direction]["status"] == "unbounded":
        return "Blocks that wedge, by number."
    one = "collapse" if direction == "positive" or len(record["ends"]) == 1 else "collapse_negative"
    return PICTURES[one]


def answer(record: Record) -> str:
    """What the structure stands, in one sentence, or why that is not known."""
    status = record["status"]
    if status == "unstable":
        return "The structure does not stand under its dead load."
    if not record["ends"] or status == "no_equilibrium":
        return "No equilibrium was found under the dead load alone."
    acceleration = sideways(record)
    known: list[str] = []
    lost: list[str] = []
    for direction, end in record["ends"].items():
        part = _stands(end, direction, acceleration)
        if part and end.get("searched"):
            lost.append(f"The {end['searched']}, is at {part}.")
            continue
        beyond = None if _tears(record) else _beyond(end, direction)
        (known if part else lost).append(part or _lost(beyond, direction, acceleration))
    verb = "carries" if acceleration is None else "stands"
    sentence = [f"The structure {verb} {' and '.join(known)}."] if known else []
    return " ".join(sentence + lost)


def sideways(record: Record) -> float | None:
    """Horizontal acceleration of the live load at load factor 1, m/s2; None for other loads.

    The live load is then the horizontal body force alone, and the dead load has the weight.
    """
    dead = record["scene"]["loads"]["dead"]
    live = record["scene"]["loads"]["live"]
    x, y = live["body"]
    others = [live.get(name) for name in ("traction", "force", "earth", "form", "tilt")]
    uniform = live.get("profile") in (None, "uniform")
    level = abs(y) <= LEVEL * abs(x)
    weight = dead["body"][1] < 0.0
    # Floors without mass are weights that are not pushed.
    others += [not one["mass"] for one in (record["scene"].get("floors") or {}).values()]
    return x if x and level and weight and uniform and not any(others) else None


def _stands(end: Record, direction: str, acceleration: float | None) -> str:
    """What is carried in one direction; empty if it is not known."""
    way = _way(direction, acceleration)
    if end["status"] == "unbounded":
        return f"any load {way}"
    if end["status"] != "limit":
        return ""
    factor = abs(end["load_factor"])
    if acceleration is None:
        return f"{_amount(factor, acceleration)} {way.removeprefix('for ')}"
    return f"{_amount(factor, acceleration)} {way}"


def _tears(record: Record) -> bool:
    """Whether joints may lose their strength, so that brackets are those without it."""
    laws = (law for kind in ("joints", "foundations") for law in record["scene"][kind].values())
    return any(law.get("opened") == "lost" for law in laws)


def _beyond(end: Record, direction: str) -> float | None:
    """The load factor beyond which nothing is carried in one direction; None if not known."""
    found: float | None = end["bounds"]["lower" if direction == "negative" else "upper"]
    return found


def _lost(beyond: float | None, direction: str, acceleration: float | None) -> str:
    """What is known of one direction where no limit load was found."""
    most = "" if beyond is None else f"; it is at most {_amount(abs(beyond), acceleration)}"
    if most and acceleration is None:
        most += " this load"
    return f"No limit load was found {_way(direction, acceleration)}{most}."


def _amount(factor: float, acceleration: float | None) -> str:
    """A load factor as an acceleration in g, or as a multiple."""
    if acceleration is None:
        return f"{factor:.3g} times"
    return f"{factor * abs(acceleration) / GRAVITY:.3g} g"


def _way(direction: str, acceleration: float | None) -> str:
    """A direction of the live load, in words."""
    if acceleration is None:
        return f"for the live load{' reversed' if direction == 'negative' else ''}"
    right = (acceleration > 0.0) == (direction == "positive")
    return f"to the {'right' if right else 'left'}"


def _assumptions(record: Record, units: Units) -> Iterator[tuple[str, str]]:
    """What the answer rests on, in kN, MPa, and m or mm."""
    scene = record["scene"]
    width = units.length(scene["size"]["width"], 4)
    height = units.length(scene["size"]["height"], 4)
    thickness = scene.get("thickness")
    yield "blocks", f"{record['mesh']['bodies']}, together {width} wide and {height} high"
    if thickness:
        yield "thickness", f"{units.length(thickness)}; forces are those of all of it"
    else:
        yield "thickness", "not given; forces are per metre of thickness"
    yield "dead load", units.forces(scene["resultants"]["dead"], 4)
    live = units.forces(scene["resultants"]["live"], 4)
    same = sideways(record)
    share = f", {abs(same) / GRAVITY:.3g} g sideways on all masses" if same else ""
    yield "live load at load factor 1", live + share
    down = math.hypot(*scene["loads"]["dead"]["body"])
    rows = [
        *(
            (f"material {name}", _material(one, down, units))
            for name, one in _some(scene, "materials")
        ),
        *((f"joints {name}", _law(one, units)) for name, one in _some(scene, "joints")),
        *((f"foundation {name}", _law(one, units)) for name, one in _some(scene, "foundations")),
    ]
    yield from rows
    if names := scene.get("supports"):
        yield "supports", ", ".join(names)
    for name, tie in list((scene.get("ties") or {}).items())[:SHOWN]:
        yield f"tie {name}", _tie(tie, units)


def _some(scene: Record, kind: str) -> list[tuple[str, Record]]:
    """Groups of a kind, as many as there is room for."""
    return list(scene[kind].items())[:SHOWN]


def _material(one: Record, gravity: float, units: Units) -> str:
    """Density and weight, stiffness, strength."""
    weight = f" ({units.text(one['density'] * gravity, 'N/m3', 4)})" if gravity else ""
    parts = [
        f"{one['density']:g} kg/m3{weight}",
        f"Young's modulus {units.stress(one['young'])}",
        f"Poisson's ratio {one['poisson']:g}",
    ]
    if one.get("compressive_strength"):
        parts.append(f"compressive strength {units.stress(one['compressive_strength'])}")
    return ", ".join(parts)


def _tie(one: Record, units: Units) -> str:
    """Tension at which a tie yields, prestress and spacing."""
    force = "N" if one.get("spacing") else f"N {PER_METRE}"
    parts = [f"yields at {units.text(one['yield'], force)}"]
    if one.get("prestress"):
        parts.append(f"prestress {units.text(one['prestress'], force)}")
    if one.get("spacing"):
        parts.append(f"one every {units.length(one['spacing'])}")
    return ", ".join(parts)


def _law(one: Record, units: Units) -> str:
    """Friction and strengths of joints."""
    law = one["law"]
    parts = ["no friction"] if law == "frictionless" else []
    if law == "coulomb":
        friction = one["friction"] or 0.0
        angle = math.degrees(math.atan(friction))
        parts.append(f"coefficient of friction {friction:g} ({angle:.3g} degrees)")
    named = {"bound": "shear strength"} | {
        key: key.replace("_", " ")
        for key in ("cohesion", "tensile_strength", "compressive_strength")
    }
    parts += [f"{words} {units.stress(one[key])}" for key, words in named.items() if one.get(key)]
    if not one.get("tensile_strength"):
        parts.append("no tensile strength")
    if one.get("dilatancy"):
        parts.append(f"dilatancy {value_text(one['dilatancy'], 'degrees')}")
    return ", ".join(parts)
