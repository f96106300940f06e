"""Parts of a structure whose mechanisms engineers look at: walls, what is above floors, corners."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.results.block_view import BlockView
from fenics_contact.results.words import walls_of

#: A wall is so many times as long as it is thick.
SLENDER = 1.5
#: What is above a floor begins so far above it, m.
ABOVE = 1e-3


@dataclass(frozen=True, eq=False)
class PushedPart:
    """Blocks that are looked at together.

    Attributes:
        name: What tables call it.
        blocks: Which ones, shape (blocks,).
        ways: Horizontal unit vectors by what people call them.
    """

    name: str
    blocks: Flags
    ways: dict[str, Array]


@dataclass(frozen=True, eq=False)
class _Wall(PushedPart):
    """A straight, upright wall.

    Attributes:
        normal: Out of the structure, or across an inner wall.
        is_outer: Whether the structure is on one side of it.
    """

    normal: Array
    is_outer: bool


def parts_of(
    view: BlockView, floors: Iterable[float], angles: Sequence[float] = ()
) -> list[PushedPart]:
    """The whole, its walls, what is above floors at their heights, m, and corners.

    The whole goes along the axes, or at angles in plan, degrees.
    """
    moves = ~view.bodies.fixed
    axes = np.eye(3)[: view.bodies.dimension - 1]
    every = dict(_told("", way) for axis in axes for way in (axis, -axis))
    turned = np.radians(np.array(angles, dtype=float))
    plan = np.column_stack([np.cos(turned), np.sin(turned), np.zeros(len(turned))])
    ways = {f"{angle:g} degrees": to for angle, to in zip(angles, plan, strict=True)}
    parts = [PushedPart("whole", moves, ways or every)]
    named = walls_of(view)
    walls: list[_Wall] = []
    if len(axes) > 1:
        walls = [wall for name, mine in named.items() for wall in _straight(view, name, mine)]
        parts += walls
    else:
        parts += [PushedPart(name, mine, every) for name, mine in named.items()]
    for level in sorted(set(floors), reverse=True):
        above = moves & (view.bodies.centroid[:, 2] > level + ABOVE)
        name = f"above z = {level:g} m"
        parts += [
            PushedPart(
                f"{wall.name} {name}", wall.blocks & above, dict(list(wall.ways.items())[:1])
            )
            for wall in walls
            if wall.is_outer
        ]
        parts.append(PushedPart(name, above, every))
    for pair in combinations(walls, 2):
        parts += _corner(view, *pair)
    return [part for part in parts if part.blocks.any()]


def _told(word: str, way: Array) -> tuple[str, Array]:
    """A direction with its name: a word, and the axis that it is nearest to."""
    axis = int(np.argmax(np.abs(way)))
    return f"{word} {'+-'[int(way[axis] < 0.0)]}{'xyz'[axis]}".strip(), way


def _straight(view: BlockView, name: str, mine: Flags) -> Iterator[_Wall]:
    """A wall of some blocks; none if they are not straight and upright."""
    bodies = view.bodies
    corners = bodies.corner[mine[bodies.block]]
    plan = corners[:, :2] - corners[:, :2].mean(axis=0)
    along, normal = np.column_stack([np.linalg.svd(plan, full_matrices=False)[2], np.zeros(2)])
    length, thickness = np.ptp(corners @ np.transpose([along, normal]), axis=0)
    if min(length / SLENDER, np.ptp(corners[:, 2])) < thickness:
        return
    centre = np.average(bodies.centroid, axis=0, weights=bodies.volume)
    aside = float((np.average(corners, axis=0) - centre) @ normal)
    normal = normal * (np.sign(aside) or 1.0)
    is_outer = abs(aside) > thickness
    words = ("outwards", "inwards") if is_outer else ("across", "across")
    ways = zip((*words, "along", "along"), (normal, -normal, along, -along), strict=True)
    yield _Wall(name, mine, dict(_told(*way) for way in ways), normal, is_outer)


def _corner(view: BlockView, one: _Wall, two: _Wall) -> Iterator[PushedPart]:
    """Stones by which two outer walls touch at an angle, outwards."""
    pairs = view.touching.pairs
    meets = (one.blocks[pairs].any(axis=1)) & (two.blocks[pairs].any(axis=1))
    if not (meets.any() and one.is_outer and two.is_outer) or abs(one.normal @ two.normal) > 0.5:
        return
    near = np.isin(np.arange(len(one.blocks)), pairs[meets])
    out = (one.normal + two.normal) / np.linalg.norm(one.normal + two.normal)
    name = f"corner of {one.name} and {two.name}"
    yield PushedPart(name, (one.blocks | two.blocks) & near, {"outwards": out})
