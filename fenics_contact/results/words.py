"""A collapse in words: which parts move as one, how, where they are, and which walls crack."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.results.block_view import AMPLITUDE, AS_ONE, STATES, BlockView, ContactState
from fenics_contact.results.bounds import counted
from fenics_contact.results.values import TieState

#: A block moves, or turns, from this part of the largest displacement on.
MOVES = 1e-3
#: A part spans a structure from more than this part of its width or height on.
SPANS = 0.701
#: Its middle is in the middle of the structure this near to it, over width or height.
MIDDLE = 0.12
#: A part shifts where it turns by less than this, relative to its motion: over its half diagonal.
SHIFTS = 0.1
#: A part rocks about a corner where the centre of its turn is this near to it, over its diagonal.
NEAR = 0.12
#: Motions steeper than this tangent go up or down, those less steep than its inverse sideways.
STEEP = 2.4
#: Parts that a sentence names.
NAMED = 4
#: Words for directions along x, y and z, by dimension.
WAYS = {
    2: (("the left", "the right"), ("", ""), ("down", "up")),
    3: (("-x", "+x"), ("-y", "+y"), ("down", "up")),
}
#: Words for places along z, y and x, by dimension: the front is where y is least.
PLACES: Mapping[int, Mapping[int, Sequence[str]]] = {
    2: {2: ("lower", "middle", "upper"), 0: ("left", "middle", "right")},
    3: {2: ("lower", "middle", "upper"), 1: ("front", "", "back"), 0: ("left", "", "right")},
}
#: Names that are adjectives: of the left wall, the western vault.
SIDES = {"left", "right", "front", "back", "north", "south", "east", "west"}
#: A part is called by a name that so much of its volume has; a name that more of all has says
#: nothing.
CALLED = 0.8
#: Blocks move alike if they differ by up to this part of the largest displacement; those of a wall
#: that moves as a whole, if by up to the other: a wall that leans cracks a little in many courses.
ALIKE, LEANS = 0.05, 0.2
#: Parts of less than this, over the volume of the largest, are told of together; so are all but the
#: first ones where a structure goes to pieces, as domes and vaults do; by dimension.
SMALL: Mapping[int, float] = {2: 0.0, 3: 0.15}
FIRST: Mapping[int, int | None] = {2: None, 3: 2}
#: A wall cracks if so much of it moves and so much rests.
BOTH = 0.1
#: Cosines of the angles to the upright below and above which an axis is level and upright.
LEVEL, UPRIGHT = 0.35, 0.9
#: A crack has a direction if it is so many times as long as it is wide.
LONG = 1.5


@dataclass(frozen=True)
class Part:
    """Blocks that move as one.

    Attributes:
        blocks: Their numbers.
        place: Where they are in the structure; empty for a part that spans it.
        motion: What they do.
        area: Of all of them, m2; in space their volume, m3.
        name: What the blocks are called; empty: the part is told by its place.
        of: What it is made of, by names: a block's own, or those of groups and walls.
    """

    blocks: list[int]
    place: str
    motion: str
    area: float
    name: str = ""
    of: str = ""


def mechanism_in_words(view: BlockView) -> str:
    """The largest parts and what they do, ties that yield, walls that crack, in one sentence."""
    return _in_words(view, moving_parts(view))


def _in_words(view: BlockView, parts: Sequence[Part]) -> str:
    """The same, for given parts."""
    total = int(np.sum(~view.bodies.fixed))
    dimension = view.bodies.dimension
    large = [part for part in parts if part.area > SMALL[dimension] * parts[0].area]
    named = large if len(parts) <= NAMED else large[: FIRST[dimension]]
    told = parts_in_words(named, total, view.ties, len(parts) - len(named))
    return "; ".join(filter(None, (told, _cracks(view))))


def mechanism_record(view: BlockView) -> dict[str, Any]:
    """What result.json has of a collapse: in words, parts, and what blocks and contacts do.

    A block moves, or turns, from a part of the largest displacement on: elastic motions are
    smaller. "centre" and "direction" are those of the fastest block; the direction is 0 if that
    turns about its centre.
    """
    states = view.contacts.state
    count = {does: int(np.sum(states == kind)) for kind, does in STATES.items()}
    count["crushes"] = int(view.touching.crushes.sum())  # those that open or slide, too
    parts = moving_parts(view)
    bodies = view.bodies
    speed = view.share
    reach = bodies.largest(np.linalg.norm(bodies.corner - bodies.centroid[bodies.block], axis=1))
    displacement, rotation = view.motion[:, :3], view.motion[:, 3:]
    turning = np.linalg.norm(rotation, axis=1) * reach > MOVES * AMPLITUDE * view.size
    fastest = int(np.argmax(speed))
    pace = float(np.linalg.norm(displacement[fastest]))
    shifts = pace > MOVES * AMPLITUDE * view.size
    way = displacement[fastest] / pace if shifts else np.zeros(3)
    given = slice(None, None, 4 - bodies.dimension)  # components that people give
    return {
        "words": _in_words(view, parts),
        "parts": [vars(part) for part in parts],
        "moving": np.flatnonzero(speed > MOVES).tolist(),
        "turning": np.flatnonzero(turning).tolist(),
        "fastest": fastest,
        "centre": (bodies.centroid[fastest, given] + 0.0).tolist(),
        "direction": (way[given] + 0.0).tolist(),
        "joints": len(states),
        "parting": count["opens"],
        "rocking": count["rocks"],
        "sliding": count["slides"],
        "contacts": {
            "states": count,
            "pressure": float(view.contacts.pressure.max(initial=0.0)),
        },
    }


def moving_parts(view: BlockView) -> list[Part]:
    """Parts of the blocks that move alike, the largest first."""
    walls = walls_of(view)
    slides = view.contacts.state == ContactState.SLIP
    found = []
    for those in _alike(view, walls):
        outer = view.touching.any_of(those) == 1
        motion = _motion(view, those, bool(np.any(slides & outer)))
        place = place_in_words(view.box_of(those), view.box, PLACES[view.bodies.dimension])
        volume = float(view.bodies.volume[those].sum())
        numbers = np.flatnonzero(those).tolist()
        called = _called(view, those, walls)
        found.append(Part(numbers, place, motion, volume, called, _made_of(view, numbers, walls)))
    return by_size(found)


def _alike(view: BlockView, walls: Mapping[str, Flags]) -> Iterator[Flags]:
    """Blocks that move alike: walls that move as a whole; then blocks that touch, the most first.

    Args:
        view: What moves.
        walls: Blocks of walls by name.
    """
    count = len(view.share)
    pairs = np.where(view.touching.pairs < 0, count, view.touching.pairs)  # the last: rigid ground
    rigid = connected(pairs[view.contacts.state == ContactState.STICK], count + 1)
    stays = np.isin(rigid, rigid[np.append(view.bodies.fixed, True)])
    rigid = rigid[:count]
    free = (view.share > AS_ONE) & ~stays[:count]
    inside = pairs[(pairs < count).all(axis=1)]
    one = free.any() and np.all(_away(view, free)[free] < ALIKE)
    for wall in () if one else walls.values():
        mine = free & wall
        if _is_most(view, mine, wall):
            mine &= _away(view, mine) < LEANS
        if _is_most(view, mine, wall):
            free &= ~mine
            yield mine
    while free.any():
        largest = free & (rigid == np.argmax(np.bincount(rigid, view.bodies.volume * free)))
        like = largest | free & (_away(view, largest) < ALIKE)
        part = connected(inside[like[inside].all(axis=1)], count)
        like &= part == part[np.argmax(largest)]
        free &= ~like
        yield like


def _is_most(view: BlockView, some: Flags, those: Flags) -> bool:
    """Whether some blocks have nearly all of the volume of those that they are of."""
    return bool(view.bodies.volume[some].sum() > CALLED * view.bodies.volume[those].sum())


def _rigid(view: BlockView, those: Flags) -> tuple[Array, Array, Array]:
    """Centre of some blocks and the rigid motion that fits theirs best: velocity and turn."""
    centre = np.average(view.bodies.centroid[those], axis=0, weights=view.bodies.volume[those])
    mine = those[view.bodies.block]
    turned = np.cross(np.eye(3), (view.bodies.corner[mine] - centre)[:, None]).transpose(0, 2, 1)
    matrix = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned], axis=2)
    fit = np.linalg.lstsq(matrix.reshape(-1, 6), view.displacement[mine].ravel(), rcond=None)[0]
    return np.asarray(centre), fit[:3], fit[3:]


def _away(view: BlockView, those: Flags) -> Array:
    """How far all blocks move away from a rigid motion of some, over the largest displacement."""
    centre, velocity, turn = _rigid(view, those)
    field = velocity + np.cross(turn, view.bodies.corner - centre)
    away = view.bodies.largest(np.linalg.norm(view.displacement - field, axis=1))
    return away / (AMPLITUDE * view.size)


def walls_of(view: BlockView) -> dict[str, Flags]:
    """Blocks of walls, by what builders call them, or by their groups."""
    groups = view.bodies.groups
    names = np.full(len(groups), "", dtype=object)
    bare = [re.sub(r"(_?\d+)*$", "", name) for name in view.bodies.names]
    for called in (np.array(groups), np.array(bare)):
        for name in set(called.tolist()):
            mine = (called == name) & (view.bodies.volume > 0.0)
            if mine.sum() > 1 and not _is_most(view, mine, view.bodies.volume > 0.0):
                group = groups[int(np.argmax(mine))]
                kind = "part" if group == "default" else group.removesuffix("s")
                told = group if name == kind else name  # stones of a kind: piers
                is_wall = name in {*SIDES, "inner"}
                names[mine] = f"{name} {kind}" if is_wall else told.replace("_", " ")
    return {name: names == name for name in dict.fromkeys(names) if name}


def _called(view: BlockView, those: Flags, walls: Mapping[str, Flags]) -> str:
    """What a part is called by the walls of its blocks; empty if they are of several."""
    for name, wall in walls.items():
        mine = those & wall
        if _is_most(view, mine, those):
            places = PLACES[view.bodies.dimension]
            place = place_in_words(view.box_of(mine), view.box_of(wall), places)
            part = f"the {place} part of " if place else "a part of "
            return f"{'' if _is_most(view, mine, wall) else part}the {name}"
    return ""


def _made_of(view: BlockView, blocks: Sequence[int], walls: Mapping[str, Flags]) -> str:
    """Name of a block, or those of groups and walls that have a good part of some blocks."""
    if len(blocks) == 1 or not any(view.bodies.names):
        return view.bodies.names[blocks[0]]
    volume = view.bodies.volume[blocks]
    large = [name for name, wall in walls.items() if volume @ wall[blocks] > BOTH * volume.sum()]
    return f" of the {' and the '.join(large)}" * bool(large)


def _motion(view: BlockView, those: Flags, slides: bool) -> str:
    """What a part does, from the rigid motion that fits best."""
    centre, velocity, turn = _rigid(view, those)
    box = view.box_of(those)
    size = float(np.linalg.norm(box[1] - box[0]))
    spin = float(np.linalg.norm(turn))
    way = _way(view, velocity)
    shifts = "falls" if way == "down" and not slides else f"{'slides' if slides else 'moves'} {way}"
    turns = 0.5 * size * spin / (np.linalg.norm(velocity) or 1e-300)
    if turns < SHIFTS:
        return shifts
    over = np.array([turn[1], -turn[0], 0.0])  # where the upper end goes
    pole = centre + np.cross(turn, velocity) / spin**2
    if view.bodies.dimension == 2:
        corner = _nearest_corner(box, pole, NEAR * size)
        return (
            f"rocks {_way(view, over)} about its {corner} corner"
            if corner
            else f"turns {_way(view, over)}"
        )
    if abs(turn[2]) > UPRIGHT * spin:
        return "twists about an upright axis" if turns > 1.0 else f"{shifts}, twisting"
    axis = float(pole[2])
    twists = ", twisting" * bool(abs(turn[2]) > LEVEL * spin)
    (foot, top), (ground, crown) = box[:, 2], view.box[:, 2]
    levels = {"its foot": foot, "the foot of the structure": ground, "its top": top}
    for name, level in levels.items():
        if abs(axis - level) < NEAR * size:
            verb, way = (
                ("swings", _way(view, -over)) if name == "its top" else ("turns", _way(view, over))
            )
            return f"{verb} about {name} {way}{twists}"
    about = f" about an axis at z = {axis:.3g} m" * bool(ground < axis < crown)
    return f"turns {_way(view, over)}{about}{twists}"


def _nearest_corner(box: Array, place: Array, near: float) -> str:
    """Which corner of a box in the plane is near to a place; empty if none is."""
    corners = {
        f"{upright} {level}": math.hypot(box[row, 2] - place[2], box[column, 0] - place[0])
        for row, upright in enumerate(("lower", "upper"))
        for column, level in enumerate(("left", "right"))
    }
    corner = min(corners, key=lambda name: corners[name])
    return corner if corners[corner] <= near else ""


def _way(view: BlockView, vector: Array) -> str:
    """A direction by the axes that it is along."""
    least = np.abs(vector).max() / STEEP
    parts = zip(WAYS[view.bodies.dimension], vector, strict=True)
    *level, up = [names[int(part > 0.0)] if abs(part) > least else "" for names, part in parts]
    sideways = " and ".join(filter(None, level))
    return " ".join(filter(None, (up, sideways and f"to {sideways}")))


def _cracks(view: BlockView) -> str:
    """Walls that crack: a part of each moves and a part rests."""
    parted = view.contacts.state != ContactState.STICK
    places = np.array([corners.mean(axis=0) for corners in view.touching.corners])
    told: dict[str, list[str]] = {}
    for name, mine in walls_of(view).items():
        moves = np.average(view.share > AS_ONE, weights=view.bodies.volume * mine)
        if BOTH < moves < 1.0 - BOTH and not name.endswith("s"):  # stones of a kind
            way = _crack(places[parted & (view.touching.any_of(mine) == 2)])
            told.setdefault(way, []).append(f"the {name}")
    return ", ".join(
        f"{' and '.join(those)} crack{'s' * (len(those) == 1)}{way}" for way, those in told.items()
    )


def _crack(places: Array) -> str:
    """Which way a crack goes, by the places of contacts that open or slide."""
    if len(places) > 2:
        spread, axes = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)[1:]
        ways = " along its courses", " diagonally", " upright"
        if spread[0] > LONG * spread[1]:
            return ways[np.digitize(abs(axes[0, 2]), [LEVEL, UPRIGHT])]
    return ""


def by_size(parts: list[Part]) -> list[Part]:
    """The largest part first; those alike in size by their first blocks, whatever the rounding."""
    most = max((part.area for part in parts), default=1.0) or 1.0
    return sorted(parts, key=lambda part: (-round(part.area / most, 6), part.blocks))


def place_in_words(box: Array, whole: Array, names: Mapping[int, Sequence[str]]) -> str:
    """Where a box is in another one; boxes are lowest and highest coordinates, shape (2, d).

    Args:
        box: The one.
        whole: The other one.
        names: Words for a low, middle and high place along axes, in the order of the words.
    """
    size = np.maximum(whole[1] - whole[0], np.finfo(float).tiny)
    middle = (box.mean(axis=0) - whole[0]) / size - 0.5
    spans = box[1] - box[0] > SPANS * size
    words = []
    for axis, of_axis in names.items():
        side = int(np.sign(middle[axis])) if abs(middle[axis]) > MIDDLE else 0
        words.append("" if spans[axis] else of_axis[side + 1])
    if words.count("middle") == 1 and all(words) and words[0] == "middle":
        words[0] = ""
    return " ".join(dict.fromkeys(word for word in words if word))


def parts_in_words(
    parts: Sequence[Part], total: int, ties: Mapping[str, Any], others: int = 0
) -> str:
    """A collapse in one sentence: the largest parts and what they do, and ties that yield.

    Args:
        parts: The largest first.
        total: Blocks of the structure.
        ties: Names and states; empty without ties.
        others: Smaller parts beside these.
    """
    told: list[str] = []
    alike: dict[tuple[str, str, str], list[Part]] = {}
    for part in parts:
        alike.setdefault((part.place, part.motion, part.name), []).append(part)
    for (place, motion, called), those in list(alike.items())[:NAMED]:
        blocks = [block for one in those for block in one.blocks]
        plural = len(those) > 1
        if len(blocks) == total and len(those) == 1:
            name = "the whole structure" if total > 1 else "the block"
        elif called and len(those) == 1:
            name = f"{called} ({counted(len(blocks), 'block')})"
            plural = called.endswith("s") and " part of " not in called
        elif len(blocks) == 1:
            label = those[0].of or blocks[0]
            name = f"the {place} block ({label})" if place else f"block {label}"
        elif len(those) == 1:
            name = f"the {place or 'main'} part ({len(blocks)} blocks{those[0].of})"
        else:
            name = f"{len(those)} {f'{place} ' * bool(place)}parts"
            motion = motion.replace(" corner", " corners")
        if plural:
            verb, _, way = motion.replace(" its ", " their ").partition(" ")
            motion = f"{verb.removesuffix('s')} {way}"
        told.append(f"{name} {motion}")
    rest = others + sum(map(len, list(alike.values())[NAMED:]))
    told += (
        [f"{counted(rest, 'smaller part')} move{'s' * (rest == 1)} between these"] if rest else []
    )
    if "state" in ties:
        yielding = list(dict.fromkeys(ties["name"][ties["state"] == TieState.YIELDS]))
        if yielding:
            plural = len(yielding) > 1
            told.append(f"tie{'s' * plural} {', '.join(yielding)} yield{'s' * (not plural)}")
    return ", ".join(told)
