"""Ways after the peak that are known by hand, and what is missed of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from fenics_contact.motion.beyond import Beyond, beyond
from fenics_contact.spatial import builders
from tests.motion.structures import GRAVITY, arch, box, in_plane, in_space, turned, way_down

#: Thickness and height of a free wall, m.
THICK, HIGH = 0.4, 2.0
SLENDER = np.arctan2(THICK, HIGH)
#: Of a wall with a tie, m, and the tie's height, length, m, and yield, N.
WALL, TIE_AT, TIE_FAR, TIE_YIELD = (0.5, 3.0), 2.7, 4.0, 8e3
#: Of a wall of two blocks that is held near its top, m.
LOWER, UPPER, HOLD = 1.9, 1.3, 3.15

#: A way, and by how much its load factors are off, by points.
Case = tuple[Beyond, list[float]]


def _off(found: Beyond, exact: Callable[..., float]) -> Case:
    return found, [abs(point.load_factor - exact(point)) for point in found.fine.points]


def _turns(found: Beyond) -> Case:
    """R (a - theta): lambda = tan(a - theta)."""
    return _off(found, lambda point: np.tan(SLENDER - turned(point)))


def free_wall() -> Case:
    return _turns(way_down(in_plane([box(0, 0, THICK, HIGH)])))


def free_wall_in_space() -> Case:
    wall = {"w": {"box": [[0, 0, 0], [3, THICK, HIGH]]}}
    return _turns(way_down(in_space(wall, (0, -1, 0))))


def stack() -> Case:
    return _turns(way_down(in_plane([box(0, 0, THICK, 1.2), box(0, 1.2, THICK, HIGH)])))


def sliding_block() -> Case:
    """Friction alone, 0.3, until the block leaves its support and topples over the edge."""
    found = way_down(in_plane([box(0, 0, 1, 1), box(-5, -0.5, 3, 0)], fixed=[1], friction=0.3))
    off = [abs(p.load_factor - 0.3) for p in found.fine.points if p.displacement < 2.3]
    return found, off


def tie(stiffness: float) -> Case:
    """The balance of moments about the toe, at every angle."""
    thick, high = WALL
    bar = {"from": [0.0, TIE_AT], "ground": [-TIE_FAR, TIE_AT], "yield": TIE_YIELD}
    ties = {"t": {**bar, "stiffness": stiffness}}
    scene = in_plane([box(0, 0, thick, high)], friction=0.8, density=1800.0, ties=ties)
    weight = 1800.0 * thick * high * GRAVITY
    slender, radius = np.arctan2(thick, high), 0.5 * np.hypot(thick, high)

    def exact(point):
        angle = turned(point)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        arm = turn @ [-thick, TIE_AT]
        line = np.array([-TIE_FAR - thick, TIE_AT]) - arm
        length = np.hypot(*line)
        pull = min(TIE_YIELD, max(0.0, stiffness * (length - TIE_FAR))) * line / length
        held = arm[0] * pull[1] - arm[1] * pull[0]
        moment = weight * radius * np.sin(slender - angle) + held
        return moment / (weight * radius * np.cos(slender - angle))

    return _off(way_down(scene), exact)


def soft_tie() -> Case:
    return tie(1e5)


def stiff_tie() -> Case:
    return tie(1e6)


def two_blocks_held() -> Case:
    """Hinges at the foot, between the blocks, and at the hold: virtual work at finite rotations."""
    top = LOWER + UPPER
    blocks = [
        box(0, 0, THICK, LOWER),
        box(0, LOWER, THICK, top),
        box(-3, -0.5, 6, 0),
        box(THICK, HOLD, THICK + 0.3, top + 1.0),
    ]
    smooth = {"friction": 0.0, "between": ["b1", "b3"]}
    joints = {"default": {"friction": 0.8}, "smooth": smooth}
    found = way_down(in_plane(blocks, fixed=[2, 3], joints=joints), control=[0.0, LOWER])
    weights = np.array([LOWER, UPPER])
    foot = np.array([THICK, 0.0])

    def turn(angle):
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def places(angle):
        """Of the centres of mass, as the lower block turns, times weights."""
        first = foot + turn(-angle) @ ([0.5 * THICK, 0.5 * LOWER] - foot)
        middle = foot + turn(-angle) @ ([0.0, LOWER] - foot)

        def off(back):
            to_hold = [THICK, HOLD] - middle - turn(back) @ [THICK, 0.0]
            return to_hold @ (turn(back) @ [1.0, 0.0])

        second = middle + turn(brentq(off, -0.1, 1.0)) @ [0.5 * THICK, 0.5 * UPPER]
        return weights @ [first, second]

    def exact(point):
        change = places(turned(point) + 1e-5) - places(turned(point) - 1e-5)
        return change[1] / change[0]

    return _off(found, exact)


def spread(count: int, thickness: float) -> tuple[Beyond, float]:
    """Springers of a semicircle that move apart together, and the weight of the arch."""
    blocks = arch(count, thickness)
    scene = in_plane(blocks, fixed=[count, count + 1], friction=1.0, density=2400.0)
    structure = scene.structure()
    moved = np.zeros((count + 2, 6))
    moved[count, 0], moved[count + 1, 0] = -0.5, 0.5
    found = beyond(replace(structure, moved=moved))
    assert found is not None
    return found, float(-structure.dead[:, 2].sum())


def dome() -> Case:
    """Springers of a dome of 8 lunes x 5 rings move out: thrust over the weight of a lune.

    A lune leans on the hinge of its crown, on that of the bed with most thrust.
    """
    shape = {"radius": 2.0, "thickness": 0.4, "meridians": 8, "rings": 5, "oculus": 0.3}
    blocks = builders.dome(**shape)
    structure = in_space({"builder": "dome", **shape}, (1, 0, 0), friction=0.8).structure()
    moved = np.zeros((len(structure.blocks), 6))
    for number, block in enumerate(structure.blocks):
        if block.fixed:
            moved[number, :2] = block.centroid[:2] / np.linalg.norm(block.centroid[:2])
    found = beyond(replace(structure, moved=moved), until=0.35)
    assert found is not None
    lune = [block for block in blocks if block.name.endswith("_1") and not block.fixed]
    out = np.append(np.mean([block.centroid[:2] for block in lune], axis=0), 0.0)
    out /= np.linalg.norm(out)
    weights = np.array([block.volume for block in lune])
    centres = np.array([[block.centroid @ out, block.centroid[2]] for block in lune])

    def across(points):
        return np.column_stack([points @ out, points[:, 2]])

    top = across(lune[-1].pieces[0].corners)
    crown = top[np.argmax(top[:, 1])]

    def hinge(block):
        points = block.pieces[0].corners
        radius = np.linalg.norm(points, axis=1)
        inner = across(points)[radius < radius.mean()]
        return inner[np.argmin(inner[:, 1])]

    def thrust(bed, moved_out):
        foot = hinge(lune[bed])
        line = crown - foot
        flat = line[0] - moved_out
        height = np.sqrt(line @ line - flat**2)
        angle = np.arctan2(height, flat) - np.arctan2(line[1], line[0])
        centre = weights[bed:] @ centres[bed:] / weights[bed:].sum() - foot
        inwards = np.sin(angle) * centre[1] - np.cos(angle) * centre[0]
        return weights[bed:].sum() * inwards / height / weights.sum()

    bed = max(range(len(lune)), key=lambda k: thrust(k, 0.0))
    weight = float(-structure.dead[:, 2].sum())
    points = found.fine.points
    return found, [abs(p.load_factor / weight - thrust(bed, p.displacement)) for p in points]


CASES = {
    "free wall": free_wall,
    "free wall in space": free_wall_in_space,
    "stack of two": stack,
    "block that slides off": sliding_block,
    "wall with a tie of 0.1 MN/m": soft_tie,
    "wall with a tie of 1 MN/m": stiff_tie,
    "wall of two blocks, held near its top": two_blocks_held,
    "dome on springers that move out": dome,
}
