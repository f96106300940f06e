"""What the groups of a drawing are: joints, free edges, and the ground on which it stands."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.errors import InputError
from fenics_contact.geometry.drawing import Drawing
from fenics_contact.geometry.dxf.blocks import DxfContents
from fenics_contact.geometry.meshing import (
    divided_outlines,
    lowest_level,
    sides_of_outlines,
    sides_on,
)
from fenics_contact.geometry.planar_cells import Flags, Indices

#: Words in names of layers on which a structure stands.
GROUND = frozenset(
    "base ground foundation foundations support supports springing springings abutment abutments"
    " terreno fondazione fondazioni appoggio appoggi imposta imposte boden fundament auflager"
    " kämpfer widerlager sol fondation fondations appui appuis suelo cimiento cimientos apoyo"
    " apoyos".split()
)


@dataclass(frozen=True)
class GroupRoles:
    """Groups of a drawing by what their sides are.

    Attributes:
        ground: Groups on which the structure stands.
        why: How they were guessed.
        joints: Groups whose sides all lie between two blocks.
        edges: Groups whose sides all have one block alone, but for the ground.
    """

    ground: Sequence[str]
    why: str
    joints: Sequence[str]
    edges: Sequence[str]


def with_ground(read: DxfContents) -> tuple[DxfContents, GroupRoles]:
    """A drawing with a group for the ground, which is "base" if none was drawn; its groups' roles.

    The ground is the layers with such a name along which no two blocks touch; else those that lie
    on the lowest level as a whole; else "base" is the lowest level. Of layers that share sides the
    first is taken.

    Raises:
        InputError: If no layer has the name of a ground, and no side lies on the lowest level.
    """
    kinds = _kinds(read.drawing)
    free = {name: kind for name, kind in kinds.items() if not kind.shared.any()}
    named = {name for name in free if GROUND & set(re.findall(r"[^\W\d_]+", name.lower()))}
    level = {name for name, kind in free.items() if kind.low.all()}
    ground: list[str] = []
    for name in sorted(named or level):
        if not _share(free, name, ground):
            ground.append(name)
    if not ground:
        read = _with_lowest_level(read)
        ground = ["base"]
        level.add("base")
    why = "the lowest level" if level.issuperset(ground) else "by its name"
    joints = [name for name, kind in kinds.items() if kind.shared.all()]
    edges = [name for name in free if not _share(free, name, ground)]
    return read, GroupRoles(ground, why, joints, edges)


@dataclass(frozen=True)
class _Kind:
    """Sides of a group, and which of them lie between two blocks and on the lowest level."""

    sides: Indices
    shared: Flags
    low: Flags


def _share(kinds: Mapping[str, _Kind], name: str, others: Sequence[str]) -> bool:
    """Whether a group has sides of others."""
    known = (kinds[other].sides for other in others if other in kinds)
    return any(np.intersect1d(kinds[name].sides, sides).size for sides in known)


def _kinds(drawing: Drawing) -> dict[str, _Kind]:
    """Sides of every group."""
    blocks, near = divided_outlines(list(drawing.blocks), drawing.groups)
    sides = sides_of_outlines(blocks)
    low = np.all(sides[:, :, 1] <= sides[:, :, 1].min() + near, axis=1)
    order = np.lexsort(sides.transpose(2, 0, 1)[::-1], axis=1)
    rows = np.take_along_axis(sides, order[:, :, None], axis=1).reshape(-1, 4)
    _, label, count = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    shared = count[label.reshape(-1)] > 1
    found = {n: np.flatnonzero(on) for n, on in sides_on(blocks, drawing.groups, near).items()}
    return {name: _Kind(on, shared[on], low[on]) for name, on in found.items()}


def _with_lowest_level(read: DxfContents) -> DxfContents:
    """A drawing with the group "base" along its lowest level."""
    level = lowest_level(list(read.drawing.blocks))["base"]
    drawing = read.drawing.with_group("base", *level)
    length = drawing.lengths()["base"]
    if "base" in read.drawing.groups or length == 0.0:
        raise InputError(
            "no layer is the ground on which the structure stands: draw lines there on a layer"
            " 'ground'"
        )
    return replace(read, drawing=drawing, lengths={**read.lengths, "base": length})
