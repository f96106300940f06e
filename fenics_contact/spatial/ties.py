"""Ties of rigid blocks as bars: single ones, those of anchor plates, and those along a line.

An anchor plate presses evenly: each stone below it has a bar of its own, along the tie, with the
part of its forces that the stone has of the plate's area. With plates at both ends these parts are
those of the areas that two stones have in common, seen along the tie. A tie along a line is
fastened to every stone on it, and has a bar from each to the next one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fenics_contact.errors import InputError, Vector, require
from fenics_contact.geometry.mesh import Array
from fenics_contact.scene.rules import listed
from fenics_contact.scene.scene import Tie
from fenics_contact.spatial.loads import UP, inside_of, lifted, middle_of, numbered
from fenics_contact.spatial.polyhedra import Block

#: Number of the ground where an anchor ends, which is no block.
GROUND = -1


@dataclass(frozen=True)
class Bar:
    """A tie between two blocks, or a part of one.

    Attributes:
        key: Of the tie in a scene; along a line with a number.
        tie: Its law, with the forces of this part.
        blocks: Numbers of the blocks that it holds together; `GROUND` is the ground.
        ends: m, shape (2, 3).
    """

    key: str
    tie: Tie
    blocks: tuple[int, int]
    ends: Array


def bars_of(ties: Mapping[str, Tie], blocks: Sequence[Block], near: float) -> tuple[Bar, ...]:
    """Bars of ties.

    Raises:
        InputError: If ends are in no block, or in several; the message has all of them.
    """
    bars: list[Bar] = []
    wrong = []
    for name, tie in ties.items():
        key = f"ties.{name}"
        ways = _along if tie.line is not None else _between if tie.plate is None else _of_plates
        try:
            bars += ways(key, tie, blocks, near)
        except InputError as error:
            wrong.append(str(error))
    require(not wrong, "; ".join(wrong))
    return tuple(bars)


def _ends(key: str, tie: Tie) -> dict[str, Vector]:
    """Places of both ends by their keys, m.

    Raises:
        InputError: If one is a name.
    """
    ends = {f"{key}.from": tie.from_, f"{key}.to": tie.to, f"{key}.ground": tie.ground}
    given = {place: end for place, end in ends.items() if end is not None}
    names = [f"{place} = '{end}'" for place, end in given.items() if isinstance(end, str)]
    require(not names, f"{'; '.join(names)} must be a place in a block, without a mesh")
    return {place: end for place, end in given.items() if not isinstance(end, str)}


def _among(key: str, tie: Tie, blocks: Sequence[Block]) -> dict[int, Block]:
    """Blocks that a tie may hold, by their numbers."""
    known = {number: {block.name, block.group} for number, block in enumerate(blocks)}
    mine = {k: blocks[k] for k, names in known.items() if tie.group is None or tie.group in names}
    groups = listed(sorted({block.group for block in blocks}))
    require(bool(mine), f"{key}.group: there is no group '{tie.group}'; it has {groups}")
    return mine


def _between(key: str, tie: Tie, blocks: Sequence[Block], near: float) -> Iterator[Bar]:
    """The bar of a tie between the blocks that are at its ends."""
    ends = _ends(key, tie)
    numbers = [_number(place, tie, end, blocks, near) for place, end in ends.items()]
    _check_apart(key, numbers, blocks)
    yield Bar(key, tie, (numbers[0], numbers[1]), np.array(list(map(lifted, ends.values()))))


def _check_apart(key: str, numbers: Sequence[int], blocks: Sequence[Block]) -> None:
    """Refuse a tie within one block."""
    text = f"{key}: both ends are in block '{blocks[numbers[0]].name}'; a tie joins two"
    require(numbers[0] != numbers[1], text)


def _number(key: str, tie: Tie, end: Vector, blocks: Sequence[Block], near: float) -> int:
    """Number of the block at an end: the one that it is in, or the nearest one of the group.

    An end is no farther away than that block is wide.
    """
    if end is tie.ground:
        return GROUND
    if tie.group is None:
        return numbered(key, blocks, None, end, near)
    place = lifted(end)
    away = {
        number: min(float(np.max(one.normals @ place - one.levels)) for one in block.pieces)
        for number, block in _among(key.rpartition(".")[0], tie, blocks).items()
    }
    nearest = min(away, key=away.__getitem__)
    width = float(np.ptp(blocks[nearest].extent, axis=0).max())
    text = f"{key}: the nearest stone of '{tie.group}', {blocks[nearest].name}, is"
    require(away[nearest] <= width, f"{text} {away[nearest]:.3g} m away")
    return nearest


def _of_plates(key: str, tie: Tie, blocks: Sequence[Block], near: float) -> Iterator[Bar]:
    """Bars between the stones below the plates at both ends, or from these to the ground."""
    mine = _among(key, tie, blocks)
    start, end = map(lifted, _ends(key, tie).values())
    line = end - start
    along = line / np.linalg.norm(line)
    across = np.cross(UP, along)
    across = across / np.linalg.norm(across) if np.any(across) else np.array([0.0, 1.0, 0.0])
    half = 0.5 * float(tie.plate or 0.0)
    deep = 0.5 if len(tie.from_) == 2 else half  # a metre in the plane
    square = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    up = np.cross(along, across)
    plate = np.array([start + a * deep * across + b * half * up for a, b in square])
    first = list(_covered(plate, mine, near))
    require(bool(first), f"{key}.from: the plate lies on no block")
    pairs = [(number, GROUND, loop) for number, loop in first]
    if tie.ground is None:
        last = [(one, list(_covered(loop + line, mine, near))) for one, loop in first]
        pairs = [(one, two, loop - line) for one, found in last for two, loop in found]
        require(bool(pairs), f"{key}.to: the plate lies on no block")
    whole = sum(middle_of(loop)[0] for *_, loop in pairs)
    for one, two, loop in pairs:
        _check_apart(key, (one, two), blocks)
        area, middle = middle_of(loop)
        part = part_of(tie, area / whole, area / whole)
        yield Bar(key, part, (one, two), np.array([middle, middle + line]))


def part_of(tie: Tie, share: float, stiffer: float = 1.0) -> Tie:
    """A tie with its forces times one number, and its stiffness times another."""
    stiffness = None if tie.stiffness is None else stiffer * tie.stiffness
    forces = {"yield_": share * tie.yield_, "prestress": share * tie.prestress}
    return replace(tie, stiffness=stiffness, **forces)


def _covered(loop: Array, blocks: Mapping[int, Block], near: float) -> Iterator[tuple[int, Array]]:
    """Numbers of blocks and the parts of a plane loop inside of them, m, shape (corners, 3)."""
    for number, block in blocks.items():
        for part in (inside_of(loop, piece, near) for piece in block.pieces):
            twice = np.cross(part, np.roll(part, -1, axis=0)).sum(axis=0)
            width = np.abs(part - part[:1]).max(initial=0.0)
            if np.linalg.norm(twice) > near * width:
                yield number, part


def _along(key: str, tie: Tie, blocks: Sequence[Block], near: float) -> Iterator[Bar]:
    """Bars from stone to stone along a line."""
    start, end = map(lifted, _ends(key, tie).values())
    corners = [start, *map(lifted, tie.line or ()), end]
    mine = _among(key, tie, blocks)
    stones = [stone for two in pairwise(corners) for stone in _on_line(key, *two, mine, near)]
    held = [stone for one, stone in pairwise([(GROUND, start), *stones]) if one[0] != stone[0]]
    require(len(held) > 1, f"{key}: its line meets fewer than two blocks")
    length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(corners))
    for number, ((one, place), (two, other)) in enumerate(pairwise(held), 1):
        part = part_of(tie, 1.0, length / float(np.linalg.norm(other - place)))
        yield Bar(f"{key}[{number}]", part, (one, two), np.array([place, other]))


def _on_line(
    key: str, start: Array, end: Array, blocks: Mapping[int, Block], near: float
) -> Iterator[tuple[int, Array]]:
    """Blocks on a straight line, in order, and the middle of the line in each."""
    way = (end - start) / np.vdot(end - start, end - start)
    least = near * float(np.linalg.norm(way))
    found = []
    for number, block in blocks.items():
        for piece in block.pieces:
            part = (inside_of(np.array([start, end]), piece, near) - start) @ way
            if len(part) and np.ptp(part) > least:
                found.append((float(part.min()), float(part.max()), number))
    found.sort()
    for (_, high, one), (low, _, two) in pairwise(found):
        names = f"'{blocks[one].name}' and '{blocks[two].name}'"
        text = f"{key}: its line runs along the joint of {names}; move it into one of them"
        require(low > high - least or one == two, text)
    yield from ((number, start + 0.5 * (low + high) * (end - start)) for low, high, number in found)
