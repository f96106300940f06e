"""A collapse in space in words: which parts move as one, how, and which walls crack."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.output.fields import AMPLITUDE
from fenics_contact.results.parts import (
    AS_ONE,
    NEAR,
    SHIFTS,
    STEEP,
    Part,
    parts_in_words,
    place_in_words,
)
from fenics_contact.spatial.view import ContactState, SpatialView

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
#: Parts of less than this, over the volume of the largest, are told of together.
SMALL = 0.15
#: A wall cracks if so much of it moves and so much rests.
BOTH = 0.1
#: Cosines of the angles to the upright below and above which an axis is level and upright.
LEVEL, UPRIGHT = 0.35, 0.9
#: A crack has a direction if it is so many times as long as it is wide.
LONG = 1.5


def mechanism_in_words(view: SpatialView) -> str:
    """The largest parts and what they do, and walls that crack, in one sentence."""
    parts = moving_parts(view)
    total = sum(not block.fixed for block in view.structure.blocks)
    large = [part for part in parts if part.area > SMALL * parts[0].area]
    told = parts_in_words(large, total, {}, len(parts) - len(large))
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
    pairs = np.array([(contact.first, contact.second) for contact in view.structure.contacts])
    names = _names(view)
    slides = view.contacts.state == ContactState.SLIDES
    found = []
    for those in _alike(view, pairs, names):
        outer = np.isin(pairs, those).sum(axis=1) == 1
        motion = _motion(view, those, bool(np.any(slides & outer)))
        volume = sum(view.structure.blocks[k].volume for k in those)
        name = _called(view, those, names)
        place = place_in_words(_box(view, those), view.box, PLACES)
        found.append(Part(those.tolist(), place, motion, volume, name))
    return sorted(found, key=lambda part: -part.area)


def _alike(view: SpatialView, pairs: Indices, names: Sequence[str]) -> Iterator[Indices]:
    """Blocks that move alike: walls that move as a whole; then blocks that touch, the most first.

    Args:
        view: What moves.
        pairs: Blocks of the contacts, shape (contacts, 2).
        names: Of the walls of all blocks.
    """
    blocks = view.structure.blocks
    volume = np.array([block.volume for block in blocks])
    rigid = connected(pairs[view.contacts.state == ContactState.CLOSED], len(blocks))
    free = (view.share > AS_ONE) & ~np.isin(rigid, rigid[[block.fixed for block in blocks]])
    if free.any() and np.all(_away(view, np.flatnonzero(free))[free] < ALIKE):
        names = []  # all is one part
    for name in filter(None, dict.fromkeys(names)):
        wall = np.array([other == name for other in names])
        mine = free & wall
        if volume[mine].sum() > CALLED * volume[wall].sum():
            mine &= _away(view, np.flatnonzero(mine)) < LEANS
            if volume[mine].sum() > CALLED * volume[wall].sum():
                free &= ~mine
                yield np.flatnonzero(mine)
    while free.any():
        largest = np.argmax(np.bincount(rigid, volume * free))
        those = np.flatnonzero(free & (rigid == largest))
        like = free & (_away(view, those) < ALIKE)
        like[those] = True
        part = connected(pairs[like[pairs].all(axis=1)], len(blocks))
        like &= part == part[those[0]]
        free &= ~like
        yield np.flatnonzero(like)


def _rigid(view: SpatialView, those: Indices) -> tuple[Array, Array, Array]:
    """Centre of some blocks and the rigid motion that fits theirs best: velocity and turn."""
    bodies = view.bodies
    mine = np.isin(bodies.block, those)
    volume = np.array([view.structure.blocks[k].volume for k in those])
    centroid = np.array([view.structure.blocks[k].centroid for k in those])
    centre = volume @ centroid / volume.sum()
    x, y, z = (bodies.corner[mine] - centre).T
    one, no = np.ones_like(x), np.zeros_like(x)
    rows = [[one, no, no, no, z, -y], [no, one, no, -z, no, x], [no, no, one, y, -x, no]]
    matrix = np.transpose(rows, (2, 0, 1)).reshape(-1, 6)
    fit = np.linalg.lstsq(matrix, view.displacement[mine].ravel(), rcond=None)[0]
    return centre, fit[:3], fit[3:]


def _away(view: SpatialView, those: Indices) -> Array:
    """How far all blocks move away from a rigid motion of some, over the largest displacement."""
    centre, velocity, turn = _rigid(view, those)
    bodies = view.bodies
    field = velocity + np.cross(turn, bodies.corner - centre)
    away = np.zeros(len(view.structure.blocks))
    np.maximum.at(away, bodies.block, np.linalg.norm(view.displacement - field, axis=1))
    return away / (AMPLITUDE * view.size)


def _names(view: SpatialView) -> list[str]:
    """Names of the walls of all blocks: what builders call them, or their groups; may be empty."""
    blocks = view.structure.blocks
    volume = np.array([0.0 if block.fixed else block.volume for block in blocks])
    names = np.array([""] * len(blocks), dtype=object)
    for called in (
        [block.group for block in blocks],
        [re.sub(r"(_?\d+)*$", "", block.name) for block in blocks],
    ):
        for name in set(called):
            mine = np.array([other == name for other in called])
            if mine.sum() > 1 and volume[mine].sum() < CALLED * volume.sum():
                kind = blocks[np.argmax(mine)].group.removesuffix("s")
                names[mine] = f"{name} {kind}" if name in SIDES else name.replace("_", " ")
    return names.tolist()


def _box(view: SpatialView, blocks: Indices) -> Array:
    """Lowest and highest coordinates of some blocks, m, shape (2, 3)."""
    extents = np.array([view.structure.blocks[block].extent for block in blocks])
    return np.array([extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)])


def _called(view: SpatialView, those: Indices, names: Sequence[str]) -> str:
    """What a part is called by the names of its blocks; empty if they are of several."""
    volume = np.array([block.volume for block in view.structure.blocks])
    shares = {name: volume[[k for k in those if names[k] == name]].sum() for name in names}
    name = max(shares, key=lambda name: shares[name])
    if not name or shares[name] < CALLED * volume[those].sum():
        return ""
    wall = np.array([k for k, other in enumerate(names) if other == name])
    if shares[name] > CALLED * volume[wall].sum():
        return f"the {name}"
    mine = those[np.isin(those, wall)]
    place = place_in_words(_box(view, mine), _box(view, wall), PLACES)
    return f"the {place} part of the {name}" if place else f"a part of the {name}"


def _motion(view: SpatialView, those: Indices, slides: bool) -> str:
    """What a part does, from the rigid motion that fits best."""
    centre, velocity, turn = _rigid(view, those)
    box = _box(view, those)
    half = 0.5 * float(np.linalg.norm(box[1] - box[0]))
    pace, spin = np.linalg.norm(velocity), np.linalg.norm(turn)
    if spin * half < SHIFTS * pace:
        across = float(np.hypot(*velocity[:2]))
        if -velocity[2] > STEEP * across:
            return "falls"
        steep = "" if abs(velocity[2]) * STEEP < across else " and up"
        upright = steep if velocity[2] > 0.0 else steep.replace("up", "down")
        return f"{'slides' if slides else 'moves'} to {_compass(velocity)}{upright}"
    if abs(turn[2]) > UPRIGHT * spin:
        return "twists about an upright axis"
    axis = centre + np.cross(turn, velocity) / spin**2
    over = np.cross(turn, [0.0, 0.0, 1.0])  # where the upper end goes
    near = NEAR * 2.0 * half
    middle = view.box[:, 2].mean()
    tall = view.box[1, 2] - view.box[0, 2]
    twists = ", twisting" if abs(turn[2]) > LEVEL * spin else ""
    if abs(axis[2] - box[0, 2]) < near and axis[2] - box[0, 2] < 0.5 * (box[1, 2] - box[0, 2]):
        return f"turns about its foot to {_compass(over)}{twists}"
    if abs(axis[2] - view.box[0, 2]) < NEAR * tall:
        return f"turns about the foot of the structure to {_compass(over)}{twists}"
    if abs(axis[2] - box[1, 2]) < near:
        return f"swings about its top to {_compass(-over)}{twists}"
    about = f" about an axis at z = {axis[2]:.3g} m" if abs(axis[2] - middle) < 0.5 * tall else ""
    return f"turns to {_compass(over)}{about}{twists}"


def _compass(vector: Array) -> str:
    """A level direction by the axes that it is along."""
    x, y = vector[:2]
    along = {"x": x if abs(x) * STEEP > abs(y) else 0.0, "y": y if abs(y) * STEEP > abs(x) else 0.0}
    return " and ".join(
        f"{'+' if part > 0.0 else '-'}{name}" for name, part in along.items() if part
    )


def _cracks(view: SpatialView) -> str:
    """Walls that crack: a part of each moves and a part rests."""
    blocks = view.structure.blocks
    names = _names(view)
    volume = np.array([block.volume for block in blocks])
    told: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        mine = np.array([other == name for other in names]) & (view.structure.number >= 0)
        moves = float(volume[mine & (view.share > AS_ONE)].sum() / (volume[mine].sum() or 1.0))
        if name and BOTH < moves < 1.0 - BOTH:
            told.setdefault(_crack(view, np.flatnonzero(mine)), []).append(f"the {name}")
    return ", ".join(
        f"{' and '.join(walls)} crack{'s' * (len(walls) == 1)}{way}" for way, walls in told.items()
    )


def _crack(view: SpatialView, wall: Indices) -> str:
    """Which way a crack goes, by the places of contacts that open or slide."""
    places = [
        contact.corners.mean(axis=0)
        for contact, state in zip(view.structure.contacts, view.contacts.state, strict=True)
        if state != ContactState.CLOSED and contact.first in wall and contact.second in wall
    ]
    if len(places) < 3:
        return ""
    spread, axes = np.linalg.svd(places - np.mean(places, axis=0), full_matrices=False)[1:]
    if spread[0] < LONG * spread[1]:
        return ""
    up = abs(axes[0, 2])
    return " upright" if up > UPRIGHT else " along its courses" if up < LEVEL else " diagonally"
