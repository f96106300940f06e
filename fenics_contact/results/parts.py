"""A collapse mode in words: which parts move as one, how, and where they are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact.discretization.layout import Layout
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.results.bounds import counted
from fenics_contact.results.values import Contact, JointValues, TieState

#: Blocks whose joint opens or slides by up to this part of the largest speed are told of as one.
AS_ONE = 0.01
#: A part spans a structure from this part of its width or height on.
SPANS = 0.7
#: Its middle is in the middle of the structure this near to it, over width or height.
MIDDLE = 0.12
#: A part shifts where it turns by less than this, relative to its motion: over its half diagonal.
SHIFTS = 0.1
#: A part rocks about a corner where the centre of its turn is this near to it, over its diagonal.
NEAR = 0.12
#: Motions steeper than this tangent go up or down, those less steep than its inverse sideways.
STEEP = 2.4
#: Words for places along y and x.
PLACES = {1: ("lower", "middle", "upper"), 0: ("left", "middle", "right")}
#: Parts that a sentence names.
NAMED = 4


@dataclass(frozen=True)
class Part:
    """Blocks that move as one.

    Attributes:
        blocks: Their numbers.
        place: Where they are in the structure; empty for a part that spans it.
        motion: What they do.
        area: Of all of them, m2; in space their volume, m3.
        name: What the blocks are called; empty: the part is told by its place.
    """

    blocks: list[int]
    place: str
    motion: str
    area: float
    name: str = ""


def rigid_parts(layout: Layout, motion: Array, centre: Array, as_one: float) -> Indices:
    """Number of the rigid part of every block: blocks that touch and move as one share it.

    Args:
        layout: Of the blocks.
        motion: Displacements and rotations of all blocks about their centres, shape (blocks, 3).
        centre: Shape (blocks, 2), m.
        as_one: Blocks whose joint opens or slides by up to this part of the largest speed do so.
    """
    joints = layout.joints.without_ties()
    between = np.all(joints.bodies >= 0, axis=1)
    sides = joints.bodies[between]
    arm = joints.position[between][:, None] - centre[sides]
    turned = np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
    velocity = motion[sides][..., :2] + motion[sides][..., 2:] * turned
    fastest = np.linalg.norm(velocity, axis=-1).max(initial=0.0)
    parted = np.linalg.norm(velocity[:, 1] - velocity[:, 0], axis=-1)
    pairs, pair = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
    most = np.zeros(len(pairs))
    np.maximum.at(most, pair.ravel(), parted)
    return connected(pairs[most <= as_one * fastest], len(centre))


def moving_parts(
    layout: Layout, mode: Array, values: JointValues, moving: Sequence[int]
) -> list[Part]:
    """Parts of the blocks that move in a collapse mode, the largest first. Collective.

    Args:
        layout: Of the blocks.
        mode: This rank's part in the supports' coordinates.
        values: Of the joints.
        moving: Numbers of the blocks that move.
    """
    motion = layout.centroid_motions(mode)
    part = rigid_parts(layout, motion, layout.centroid, AS_ONE)
    boxes = _boxes(layout)
    whole = np.array([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])
    joints = layout.joints.without_ties()
    slips = values.first(layout.joints.joint_count).contact == Contact.SLIP
    area = layout.boundary.areas(layout.bodies.centre)
    found = []
    for number in np.unique(part[list(moving)]):
        blocks = np.flatnonzero(part == number)
        share = area[blocks, None] / area[blocks].sum()
        centre = np.sum(share * layout.centroid[blocks], axis=0)
        box = np.vstack([boxes[blocks, :2].min(axis=0), boxes[blocks, 2:].max(axis=0)])
        inside = np.isin(joints.bodies, blocks)
        slides = bool(np.any(slips & (inside[:, 0] != inside[:, 1])))
        one = int(blocks[np.argmax(area[blocks])])
        turn = float(np.sum(share[:, 0] * motion[blocks, 2]))
        arm = centre - layout.centroid[one]
        velocity = motion[one, :2] + turn * np.array([-arm[1], arm[0]])
        told = _motion(velocity, turn, centre, box, slides)
        place = place_in_words(box, whole, PLACES)
        found.append(Part(blocks.tolist(), place, told, float(area[blocks].sum())))
    return by_size(found)


def by_size(parts: list[Part]) -> list[Part]:
    """The largest part first; those alike in size by their first blocks, whatever the rounding."""
    most = max((part.area for part in parts), default=1.0) or 1.0
    return sorted(parts, key=lambda part: (-round(part.area / most, 6), part.blocks))


def _boxes(layout: Layout) -> Array:
    """Least x and y, and largest x and y, of every body, shape (bodies, 4). Collective."""
    place = layout.centroid[layout.node_body] + layout.arm
    largest = np.full((len(layout.centroid), 4), -np.inf)
    np.maximum.at(largest, layout.node_body, np.column_stack([-place, place]))
    layout.scene.comm.Allreduce(MPI.IN_PLACE, largest, MPI.MAX)
    return largest * [-1.0, -1.0, 1.0, 1.0]


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


def _motion(velocity: Array, turn: float, centre: Array, box: Array, slides: bool) -> str:
    """What a part does, from the velocity of its centre and its turn."""
    across, up = velocity
    half = 0.5 * float(np.linalg.norm(box[1] - box[0]))
    pace = float(np.linalg.norm(velocity))
    if abs(turn) * half < SHIFTS * pace:
        sideways = ("right" if across > 0.0 else "left") if abs(up) < STEEP * abs(across) else ""
        upright = ("up" if up > 0.0 else "down") if abs(across) < STEEP * abs(up) else ""
        verb = "slides" if slides else "moves"
        return " ".join(filter(None, (verb, upright, f"to the {sideways}" * bool(sideways))))
    side = "left" if turn > 0.0 else "right"
    pole = centre + np.array([-up, across]) / turn
    corners = {
        f"{upright} {sideways}": np.array([box[column, 0], box[row, 1]])
        for row, upright in enumerate(("lower", "upper"))
        for column, sideways in enumerate(("left", "right"))
    }
    corner, place = min(corners.items(), key=lambda one: math.dist(one[1], pole))
    if math.dist(place, pole) <= NEAR * 2.0 * half:
        return f"rocks to the {side} about its {corner} corner"
    return f"turns to the {side}"


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
        if len(blocks) == total and len(those) == 1:
            name = "the whole structure" if total > 1 else "the block"
        elif called and len(those) == 1:
            name = f"{called} ({counted(len(blocks), 'block')})"
        elif len(blocks) == 1:
            name = f"the {place} block ({blocks[0]})" if place else f"block {blocks[0]}"
        elif len(those) == 1:
            name = f"the {place or 'main'} part ({len(blocks)} blocks)"
        else:
            name = f"{len(those)} {f'{place} ' * bool(place)}parts"
            verb, _, way = motion.partition(" ")
            way = way.replace("its ", "their ").replace(" corner", " corners")
            motion = f"{verb.removesuffix('s')} {way}"
        told.append(f"{name} {motion}")
    rest = others + sum(map(len, list(alike.values())[NAMED:]))
    told += (
        [f"{counted(rest, 'smaller part')} move{'s' * (rest == 1)} between these"] if rest else []
    )
    if "state" in ties:
        yielding = [
            n for n, s in zip(ties["name"], ties["state"], strict=True) if s == TieState.YIELDS
        ]
        if yielding:
            plural = len(yielding) > 1
            told.append(f"tie{'s' * plural} {', '.join(yielding)} yield{'s' * (not plural)}")
    return ", ".join(told)
