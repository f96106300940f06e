"""Scenes in the plane without a mesh: their blocks are prisms a metre deep between x and z.

What people give as (x, y) is (x, 0, z), so that blocks, contacts, grounds, floors and loads are
those of space; a positive rotation, counterclockwise, is one about -y. `Structure` takes of them
what moves in the plane.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import require
from fenics_contact.geometry import builders
from fenics_contact.geometry.dxf.blocks import read_dxf
from fenics_contact.geometry.mesh import Array
from fenics_contact.geometry.meshing import Drawing
from fenics_contact.geometry.outlines import outline_problem
from fenics_contact.results.bounds import counted
from fenics_contact.scene.rules import Checked, listed
from fenics_contact.scene.toml_tables import from_table, refuse_unknown
from fenics_contact.spatial.block_tables import ReadBlocks, built, called
from fenics_contact.spatial.contacts import Contact
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.surfaces import Surface, blocks_of

#: Builders that draw outlines; and those of space that make prisms, with what makes them so.
DRAWN = ("facade", "bridge", "retaining_wall")
BUILT: dict[str, tuple[str, dict[str, Any]]] = {
    "wall": ("wall", {"thickness": 1.0}),
    "arch": ("barrel_vault", {"length": 1.0, "strips": 1}),
}
#: Which way the axis of a drawing goes that points upwards: to x and y, from those of the drawing.
UPWARDS = {"x": ((0, -1), (1, 0)), "y": ((1, 0), (0, 1))}
#: From builders of space to the plane, m.
MIDDLE = np.array([0.0, -0.5, 0.0])


def upright(contact: Contact) -> Contact:
    """A contact with its first tangent in the plane, the second one along y."""
    normal = contact.axes[0]
    across = np.array([0.0, 1.0, 0.0])
    return replace(contact, axes=np.array([normal, np.cross(across, normal), across]))


# ---- blocks


def prism(outline: Any, name: str = "", group: str = "default", fixed: bool = False) -> Block:
    """A block a metre deep with an outline, m, shape (corners, 2), either way round.

    Raises:
        InputError: If the outline crosses itself, or has no area.
    """
    corners = np.array(outline, dtype=float)
    right = corners.ndim == 2 and corners.shape[1] == 2 and np.isfinite(corners).all()
    require(bool(right), f"block '{name}': a polygon is a list of finite points [x, y]")
    problem = outline_problem(corners)
    require(not problem, f"block '{name}' {problem}")
    front, back = (np.insert(corners, 1, y, axis=1) for y in (-0.5, 0.5))
    sides = np.stack([front, np.roll(front, -1, axis=0), np.roll(back, -1, axis=0), back], axis=1)
    surface = Surface(name, [front, back, *sides], group, fixed)
    return blocks_of(surface, "blocks", Counter())[0]


def prisms(outlines: Sequence[Array], groups: Sequence[str]) -> tuple[Block, ...]:
    """Blocks of a drawing, called by their groups and numbers."""
    count: Counter[str] = Counter()
    blocks = []
    for outline, group in zip(outlines, groups, strict=True):
        count[group] += 1
        blocks.append(prism(outline, f"{group}_{count[group]}", group))
    return tuple(blocks)


@dataclass(frozen=True)
class _Polygon(Checked):
    """A table [blocks.NAME]: corners in m."""

    polygon: tuple[tuple[float, float], ...]
    group: str = "default"
    fixed: bool = False


def blocks_of_table(table: Mapping[str, Any], folder: Path) -> ReadBlocks:
    """Blocks of the table [blocks]: of a DXF drawing, of a builder, or one by one.

    Raises:
        InputError: If they are wrong.
    """
    if isinstance(file := table.get("file"), str):
        refuse_unknown("blocks", table, {"file", "unit", "up"})
        up = table.get("up", "y")
        require(up in UPWARDS, f"blocks.up = '{up}' must be one of {listed(UPWARDS)}")
        read = read_dxf(folder / file, table.get("unit"))
        found = _drawn(read.drawing, np.array(UPWARDS[up]))
        told = f"{file}: {counted(len(found.blocks), 'block')}"
        return found._replace(told=told, notes=read.notes)
    if isinstance(name := table.get("builder"), str):
        return _built(name, {k: v for k, v in table.items() if k != "builder"})
    shapes = {name: from_table(_Polygon, item, f"blocks.{name}") for name, item in table.items()}
    return ReadBlocks(
        tuple(prism(one.polygon, name, one.group, one.fixed) for name, one in shapes.items())
    )


def _in_middle(block: Block) -> Block:
    """A block of a builder of space, half of it on either side of the plane."""
    pieces = (Polyhedron(piece.corners + MIDDLE, piece.sides) for piece in block.pieces)
    return replace(block, pieces=tuple(pieces))


def _drawn(drawing: Drawing, turn: Array) -> ReadBlocks:
    """Blocks of a drawing, turned, and its groups as sides."""
    lines = {
        name: (np.array(some, dtype=float) @ turn.T).tolist()
        for name, some in drawing.groups.items()
    }
    outlines = [np.array(outline) @ turn.T for outline in drawing.blocks]
    return ReadBlocks(prisms(outlines, drawing.names), sides=lines)


def _built(name: str, given: Mapping[str, Any]) -> ReadBlocks:
    """Blocks by a builder."""
    known = [*DRAWN, *BUILT]
    require(name in known, f"blocks.builder = '{name}' must be one of {listed(known)}")
    if name in BUILT:
        kind, fixed = BUILT[name]
        again = sorted(fixed.keys() & given.keys())
        text = f"blocks.{min(again, default='')}: structures in the plane are a metre deep"
        require(not again, text)
        return ReadBlocks(tuple(map(_in_middle, built(kind, {**given, **fixed}))))
    function = getattr(builders, name)
    pairs = {k: tuple(v) if isinstance(v, list) else v for k, v in given.items()}
    return _drawn(called(name, function, pairs), np.eye(2))
