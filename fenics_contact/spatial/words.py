"""A collapse in space in words: which parts move as one, how, and which walls crack."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.output.fields import AMPLITUDE
from fenics_contact.results.parts import (
    AS_ONE,
    NAMED,
    NEAR,
    SHIFTS,
    STEEP,
    Part,
    by_size,
    parts_in_words,
    place_in_words,
)
from fenics_contact.spatial.view import ContactState, SpatialView

#: Words for directions along x, y and z, by dimension.
WAYS = {
    2: (("the left", "the right"), ("", ""), ("down", "up")),
    3: (("-x", "+x"), ("-y", "+y"), ("down", "up")),
}
#: Words for places along z, y and x: the front is where y is least.
PLACES = {2: ("lower", "middle", "upper"), 1: ("front", "", "back"), 0: ("left", "", "right")}
#: Names that are adjectives: of the left wall, the western vault.
SIDES = {"left", "right", "front", "back", "north", "south", "east", "west"}
#: A part is called by a name that so much of its volume has; a name that more of all has says
#: nothing.
CALLED = 0.8
#: Blocks move alike if they differ by up to this part of the largest displacement; those of a wall
#: that moves as a whole, if by up to the other: a wall that leans cracks a little in many courses.
ALIKE, LEANS = 0.05, 0.2
#: Parts of less than this, over the volume of the largest, are told of together; so are all but the
#: first ones where a structure goes to pieces, as domes and vaults do.
SMALL, FIRST = 0.15, 2
#: A wall cracks if so much of it moves and so much rests.
BOTH = 0.1
#: Cosines of the angles to the upright below and above which an axis is level and upright.
LEVEL, UPRIGHT = 0.35, 0.9
#: A crack has a direction if it is so many times as long as it is wide.
LONG = 1.5


def mechanism_in_words(view: SpatialView) -> str:
    """The largest parts and what they do, ties that yield, walls that crack, in one sentence."""
    parts = moving_parts(view)
    total = int(np.sum(view.structure.number >= 0))
    large = [part for part in parts if part.area > SMALL * parts[0].area]
    named = large if len(parts) <= NAMED else large[:FIRST]
    told = parts_in_words(named, total, view.ties, len(parts) - len(named))
    return "; ".join(filter(None, (told, _cracks(view))))


def mechanism_record(view: SpatialView) -> dict[str, Any]:
    """What result.json has of a collapse: in words, parts, and what contacts do."""
    states = view.contacts.state
    return {
        "words": mechanism_in_words(view),
        "parts": [vars(part) for part in moving_parts(view)],
        "moving": np.flatnonzero(view.share > AS_ONE).tolist(),
        "contacts": {
            "states": {kind.name.lower(): int(np.sum(states == kind)) for kind in ContactState},
            "pressure": float(view.contacts.pressure.max()),
        },
    }


def moving_parts(view: SpatialView) -> list[Part]:
    """Parts of the blocks that move alike, the largest first."""
    walls = _walls(view)
    slides = view.contacts.state == ContactState.SLIDES
    found = []
    for those in _alike(view, walls):
        outer = those[view.bodies.pairs].sum(axis=1) == 1
        motion = _motion(view, those, bool(np.any(slides & outer)))
        place = place_in_words(view.box_of(those), view.box, PLACES)
        volume = float(view.bodies.volume[those].sum())
        numbers = np.flatnonzero(those).tolist()
        found.append(Part(numbers, place, motion, volume, _called(view, those, walls)))
    return by_size(found)


def _alike(view: SpatialView, walls: Mapping[str, Flags]) -> Iterator[Flags]:
    """Blocks that move alike: walls that move as a whole; then blocks that touch, the most first.

    Args:
        view: What moves.
        walls: Blocks of walls by name.
    """
    pairs = view.bodies.pairs
    rigid = connected(pairs[view.contacts.state == ContactState.CLOSED], len(view.share))
    free = (view.share > AS_ONE) & ~np.isin(rigid, rigid[view.structure.number < 0])
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
        part = connected(pairs[like[pairs].all(axis=1)], len(free))
        like &= part == part[np.argmax(largest)]
        free &= ~like
        yield like


def _is_most(view: SpatialView, some: Flags, those: Flags) -> bool:
    """Whether some blocks have nearly all of the volume of those that they are of."""
    return bool(view.bodies.volume[some].sum() > CALLED * view.bodies.volume[those].sum())


def _rigid(view: SpatialView, those: Flags) -> tuple[Array, Array, Array]:
    """Centre of some blocks and the rigid motion that fits theirs best: velocity and turn."""
    centre = np.average(view.bodies.centroid[those], axis=0, weights=view.bodies.volume[those])
    mine = those[view.bodies.block]
    turned = np.cross(np.eye(3), (view.bodies.corner[mine] - centre)[:, None]).transpose(0, 2, 1)
    matrix = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned], axis=2)
    fit = np.linalg.lstsq(matrix.reshape(-1, 6), view.displacement[mine].ravel(), rcond=None)[0]
    return np.asarray(centre), fit[:3], fit[3:]


def _away(view: SpatialView, those: Flags) -> Array:
    """How far all blocks move away from a rigid motion of some, over the largest displacement."""
    centre, velocity, turn = _rigid(view, those)
    field = velocity + np.cross(turn, view.bodies.corner - centre)
    away = view.bodies.largest(np.linalg.norm(view.displacement - field, axis=1))
    return away / (AMPLITUDE * view.size)


def _walls(view: SpatialView) -> dict[str, Flags]:
    """Blocks of walls, by what builders call them, or by their groups."""
    blocks = view.structure.blocks
    names = np.full(len(blocks), "", dtype=object)
    bare = [re.sub(r"(_?\d+)*$", "", block.name) for block in blocks]
    for called in (np.array([block.group for block in blocks]), np.array(bare)):
        for name in set(called.tolist()):
            mine = (called == name) & (view.bodies.volume > 0.0)
            if mine.sum() > 1 and not _is_most(view, mine, view.bodies.volume > 0.0):
                kind = blocks[np.argmax(mine)].group.removesuffix("s")
                names[mine] = f"{name} {kind}" if name in SIDES else name.replace("_", " ")
    return {name: names == name for name in dict.fromkeys(names) if name}


def _called(view: SpatialView, those: Flags, walls: Mapping[str, Flags]) -> str:
    """What a part is called by the walls of its blocks; empty if they are of several."""
    for name, wall in walls.items():
        mine = those & wall
        if _is_most(view, mine, those):
            place = place_in_words(view.box_of(mine), view.box_of(wall), PLACES)
            part = f"the {place} part of " if place else "a part of "
            return f"{'' if _is_most(view, mine, wall) else part}the {name}"
    return ""


def _motion(view: SpatialView, those: Flags, slides: bool) -> str:
    """What a part does, from the rigid motion that fits best."""
    centre, velocity, turn = _rigid(view, those)
    box = view.box_of(those)
    size = float(np.linalg.norm(box[1] - box[0]))
    spin = float(np.linalg.norm(turn))
    if 0.5 * size * spin < SHIFTS * np.linalg.norm(velocity):
        way = _way(view, velocity)
        moves = f"{'slides' if slides else 'moves'} to {way}".replace("to up", "up")
        return "falls" if way == "down" else moves
    if abs(turn[2]) > UPRIGHT * spin:
        return "twists about an upright axis"
    axis = float(centre[2] + np.cross(turn, velocity)[2] / spin**2)
    over = np.array([turn[1], -turn[0], 0.0])  # where the upper end goes
    twists = ", twisting" * bool(abs(turn[2]) > LEVEL * spin)
    (foot, top), (ground, crown) = box[:, 2], view.box[:, 2]
    levels = {"its foot": foot, "the foot of the structure": ground, "its top": top}
    for name, level in levels.items():
        if abs(axis - level) < NEAR * size:
            verb, way = (
                ("swings", _way(view, -over)) if name == "its top" else ("turns", _way(view, over))
            )
            return f"{verb} about {name} to {way}{twists}"
    up = "y" if view.structure.dimension == 2 else "z"
    about = f" about an axis at {up} = {axis:.3g} m" * bool(ground < axis < crown)
    return f"turns to {_way(view, over)}{about}{twists}"


def _way(view: SpatialView, vector: Array) -> str:
    """A direction by the axes that it is along."""
    least = np.abs(vector).max() / STEEP
    parts = zip(WAYS[view.structure.dimension], vector, strict=True)
    return " and ".join(names[int(part > 0.0)] for names, part in parts if abs(part) > least)


def _cracks(view: SpatialView) -> str:
    """Walls that crack: a part of each moves and a part rests."""
    parted = view.contacts.state != ContactState.CLOSED
    places = np.array([contact.corners.mean(axis=0) for contact in view.structure.contacts])
    told: dict[str, list[str]] = {}
    for name, mine in _walls(view).items():
        moves = np.average(view.share > AS_ONE, weights=view.bodies.volume * mine)
        if BOTH < moves < 1.0 - BOTH:
            way = _crack(places[parted & mine[view.bodies.pairs].all(axis=1)])
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
