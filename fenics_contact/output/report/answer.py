"""What was found, in the report: page 1, and how the structure fails.

Page 1 has the answer in one sentence, the collapse, and what was assumed. How it fails is told in
words, and by the page that moves the blocks.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence

from fenics_contact.output.report.content import Content, Record
from fenics_contact.output.report.html import (
    KEYS,
    PICTURES,
    STATUS,
    bullets,
    direction_words,
    heading,
    numbers,
    paragraph,
    picture,
    table,
    value_text,
    viewer_frame,
)
from fenics_contact.results.bounds import counted
from fenics_contact.scene.scene import GRAVITY
from fenics_contact.scene.units import PER_METRE, Units
from fenics_contact.scene.words import floor_text, law_text, material_text, tie_text

#: Height of a structure over its width from which the assumptions are beside its picture.
TALL = 1.6


#: Height of the picture in print, such that page 1 (A4) has the assumptions too, cm: with these
#: beside it; largest and smallest above them; what both have together, and what a line of them has.
BESIDE, MOST, LEAST, PAGE, LINE = 17.0, 13.5, 6.0, 18.6, 0.54
#: Letters that a line of the assumptions has room for, and one without a name beside it, more.
LETTERS, MORE = 75, 10
#: Sides in a mirror.
SIDES = {"left": "right", "right": "left"}
#: What is not in the model, where a client asks what decides.
UNCRACKED = "Blocks do not crack: that is not in the model."
#: Groups of one kind that page 1 has room for, and names of those that are alike; the tables of
#: the structure have all.
SHOWN, NAMES = 4, 8
#: Lines that say whether a demand is met.
VERDICTS = "seismic check", "non-linear check"
#: Values that are not shown where they are not used: these keys with these values.
UNUSED = {"body", "tilt", "profile", "surcharge", "wall_friction"}
NOTHING = (0.0, [0.0, 0.0], "uniform")
#: Pressures of loads, which are written in kN/m2 where strengths are in MPa.
PRESSURES = {"traction", "surcharge"}


def first_page(content: Content) -> Iterator[str]:
    """Title, project, author and date, question and answer, collapse picture, assumptions."""
    record = content.record
    status = record["status"]
    ends = record["directions"]
    yield heading(record["title"] or "Limit load", 1)
    yield paragraph(content.made, kind="labels")
    yield paragraph(record["answer"]["question"], kind="question")
    more = record["answer"]["more"]
    verdicts = [line for line in more if line.startswith(VERDICTS)]
    found = [sentence(line) for line in (*record["answer"]["found"], *verdicts)]
    yield paragraph(*found, kind=f"status {status}")
    # How much the answer is worth, where it is none, or differs between the directions.
    words = {name: direction_words(name).capitalize() for name in ends}
    told = [f"{words[name]}: {STATUS[end['status']]}" for name, end in ends.items()]
    if len({end["status"] for end in ends.values()}) > 1:
        yield paragraph(*told)
    elif status != "limit":
        yield paragraph(sentence(STATUS[status]))
    how = list(_collapses(record))
    decides = [sentence(line) for line in more if line not in verdicts] + [UNCRACKED]
    rows = list(assumptions(content))
    yield from (paragraph(one) for one in how)
    size = record["scene"]["size"]
    beside = size["height"] > TALL * size["width"] and "depth" not in size  # which has three views
    height = BESIDE if beside else picture_height(rows, [*how, *decides])
    yield f'<div class="{"beside" if beside else "above"}" style="--picture: {height:.1f}cm">'
    direction = next(iter(ends), "positive")
    if address := content.picture_of("collapse", direction):
        negative = direction == "negative" and len(ends) == 2
        caption = PICTURES["collapse_negative" if negative else "collapse"]
        if status == "unstable":
            caption = "Blocks that fall."
        elif ends[direction]["status"] == "unbounded":
            caption = "Blocks that wedge."
        yield picture(address, caption)
    yield f"<div>{heading('What decides', 2)}{bullets(decides)}"
    yield f"{heading('Assumptions', 2)}{table(rows)}</div></div>"


def picture_height(rows: Sequence[tuple[str, str]], said: Sequence[str]) -> float:
    """Height of a picture above the assumptions, with what is said on the page, cm."""
    texts = [value for _, value in rows] + [line[MORE:] for line in said]
    lines = sum(math.ceil(len(value) / LETTERS) for value in texts)
    return min(max(PAGE - LINE * lines, LEAST), MOST)


def _collapses(record: Record) -> Iterator[str]:
    """What the blocks do in the collapse of each direction, in a sentence."""
    before = ""
    ends = record["directions"]
    for direction, end in ends.items():
        if end["mechanism"] and (words := end["mechanism"]["words"]):
            way = f"{sentence(way_of(record, direction))[:-1]}: " if len(ends) > 1 else ""
            alone = len(end["mechanism"]["moving"]) == 1 < record["mesh"]["floating_bodies"]
            words = f"a mechanism of one block alone: {words}" if alone else words
            mirrored = re.sub("left|right", lambda side: SIDES[side[0]], words)
            yield sentence(f"{way}{'the same, mirrored' if mirrored == before else words}")
            before = words


def sentence(words: str) -> str:
    """Words as a sentence."""
    return f"{words[:1].upper()}{words[1:]}{'' if words.endswith('.') else '.'}"


def way_of(record: Record, direction: str) -> str:
    """Where the live load pushes, or that it is as given, or reversed."""
    way: str = record["ways"][direction]
    return direction_words(direction) if way in ("", "as given", "reversed") else way


def assumptions(content: Content) -> Iterator[tuple[str, str]]:
    """What the answer rests on, in kN, MPa, and m or mm."""
    record, units = content.record, content.units
    scene = record["scene"]
    width, height, *deep = (
        units.length(scene["size"][name], 4)
        for name in ("width", "height", "depth")
        if name in scene["size"]
    )
    size = f"{width} wide, {deep[0]} deep and" if deep else f"{width} wide and"
    yield "blocks", f"{record['mesh']['floating_bodies']}, together {size} {height} high"
    if thickness := scene.get("thickness"):
        yield "thickness", f"{units.length(thickness)}; forces are those of all of it"
    elif not deep:
        yield "thickness", "not given; forces are per metre of thickness"
    yield "dead load", units.forces(scene["resultants"]["dead"], 4)
    live = units.forces(scene["resultants"]["live"], 4)
    same = record["acceleration"]
    share = f", {abs(same) / GRAVITY:.3g} g sideways on all masses" if same else ""
    yield "live load at load factor 1", live + share
    acting = {
        name: {key: scene["loads"][name].get(key) for key in ("traction", "force")}
        for name in ("dead", "live")
    }
    for name, what, value in list(given_rows(acting, scene["units"], units))[:SHOWN]:
        yield f"{what}, {name} load", value
    kinds: dict[str, Callable[[Record], str]] = {
        "material": lambda one: material_text(one, gravity_of(scene), units),
        "joint": lambda one: law_text(one, units),
        "foundation": lambda one: law_text(one, units),
        "floor": lambda one: floor_text(one, units),
        "tie": lambda one: tie_text(one, units),
    }
    for noun, told in kinds.items():
        alike: dict[str, list[str]] = {}
        for name, one in (scene.get(f"{noun}s") or {}).items():
            alike.setdefault(told(one), []).append(name)
        for words, names in list(alike.items())[:SHOWN]:
            more = f" and {len(names) - NAMES} more" * (len(names) > NAMES)
            several = "s" * (len(names) > 1 or noun == "joint")
            yield f"{noun}{several} {', '.join(names[:NAMES])}{more}", words
    if names := scene.get("supports"):
        yield "supports", ", ".join(names)
    given = {key: (scene.get("seismic") or {}).get(key) for key in ("confidence_factor", "demand")}
    for name, what, value in given_rows({"seismic": given}, scene["units"], units):
        yield f"{name} {what}", value
    for one in list(record.get("soil") or [])[:SHOWN]:
        least, most = (units.text(one[key], f"N {PER_METRE}", 4) for key in ("active", "passive"))
        yield f"soil {one['name']}", f"presses with {least} to {most}, level"


def given_rows(tables: Record, names: Record, units: Units) -> Iterator[tuple[str, str, str]]:
    """Name, property and value of everything that was given in tables of one kind."""

    def told(key: str, value: object) -> tuple[str, str]:
        unit = "N/m2" if key in PRESSURES else names.get(key, "") * (value is not True)
        return KEYS.get(key, key.replace("_", " ")), value_text(value, unit, units)

    for name, given in tables.items():
        for key, value in given.items():
            label, words = told(key, value)
            if isinstance(value, dict):
                for place, part in value.items():
                    inside = part if isinstance(part, dict) else {key: part}
                    pairs = (told(k, v) for k, v in inside.items() if _used(k, v))
                    yield name, f"{label} {place}", ", ".join(" ".join(pair) for pair in pairs)
            elif _used(key, value):
                yield name, label, words


def _used(key: str, value: object) -> bool:
    """Whether a value says something: it is not shown where it switches nothing on."""
    return value is not None and not (key in UNUSED and value in NOTHING)


def gravity_of(scene: Record) -> float:
    """Acceleration of the dead load, m/s2."""
    return math.hypot(*scene["loads"]["dead"]["body"])


# ---- how it fails


def how_it_fails(content: Content) -> Iterator[str]:
    """How the blocks move: in numbers, and drawn with their numbers.

    Print has the picture of page 1 alone; the other direction has its picture there, too.
    """
    record = content.record
    shown = content.picture_of("collapse", next(iter(record["directions"]), "positive"))
    yield f'<div class="{"again" if shown else ""}">{heading("How it fails")}'
    total = record["mesh"]["bodies"]
    if record["falling_blocks"]:
        falling = record["falling_blocks"]
        words = f"{len(falling)} of {counted(total, 'block')} move: {numbers(falling)}."
        yield paragraph(words, f"The reason: {record['reason']}. No joint resists this motion.")
    for direction, end in record["directions"].items():
        prefix = f"With the {direction_words(direction)}:"
        if end["wedged_blocks"]:
            wedged = end["wedged_blocks"]
            words = f"{len(wedged)} of {counted(total, 'block')} wedge: {numbers(wedged)}."
            yield paragraph(prefix, words)
        elif end["mechanism"]:
            doubt = "This motion is not verified." if end["status"] != "limit" else ""
            yield paragraph(prefix, *_motion(end["mechanism"], total, content.units), doubt)
        else:
            yield paragraph(prefix, "no collapse mode is known.")
    if content.viewer:
        yield viewer_frame(content.viewer)
    yield "</div>"
    for direction in list(record["directions"])[1:]:
        if address := content.picture_of("collapse", direction):
            yield picture(address, PICTURES["collapse_negative"])


def _motion(moves: Record, total: int, units: Units) -> Iterator[str]:
    """Sentences on a collapse mode."""
    moving = len(moves["moving"])
    yield f"{moving} of {counted(total, 'block')} move, {len(moves['turning']) or 'none'} turn."
    contacts = moves["contacts"]
    counted_as = {
        "open{} over the whole length": moves["parting"],
        "open{} over a part of it (the blocks rock there)": moves["rocking"],
        "slide{} while closed": moves["sliding"],
        "yield{} by crushing": contacts["states"]["crushes"],
    }
    joints = [f"{n} {words.format('s' * (n == 1))}" for words, n in counted_as.items() if n]
    *first, last = joints or ["none opens or slides"]
    what = f"{', '.join(first)} and {last}" if first else last
    yield f"Of {counted(moves['joints'], 'joint')} {what}."
    if contacts["pressure"] > 0.0:
        yield f"The largest mean pressure of a joint is {units.stress(contacts['pressure'], 3)}."
