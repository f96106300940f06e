"""Blocks of a scene file's table [blocks]: of a file, of a builder, or one by one."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fenics_contact.errors import InputError, require
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.bounds import counted
from fenics_contact.scene.rules import Checked, listed
from fenics_contact.scene.toml_tables import from_table, refuse_unknown
from fenics_contact.spatial.polyhedra import Block, Polyhedron

#: Shapes of blocks: how many corners they have, 0 for any number, and the body of these.
SHAPES: dict[str, tuple[int, Callable[[Array], Polyhedron]]] = {
    "box": (2, lambda corners: Polyhedron.box(corners.min(axis=0), corners.max(axis=0))),
    "hexahedron": (8, Polyhedron.hexahedron),
    "vertices": (0, Polyhedron.hull),
}
#: Which axes of a file become x, y and z, by the one that points upwards, with their signs.
UPWARDS = {"x": ((2, 1, 0), (-1, 1, 1)), "y": ((0, 2, 1), (1, -1, 1)), "z": ((0, 1, 2), (1, 1, 1))}

Corners = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class _Shape(Checked):
    """A convex body, in one of three ways; corners in m."""

    box: Corners | None = None
    hexahedron: Corners | None = None
    vertices: Corners | None = None
    faces: tuple[tuple[int, ...], ...] | None = None

    @property
    def given(self) -> list[str]:
        """In which ways it is given."""
        return [kind for kind in (*SHAPES, "faces") if getattr(self, kind) is not None]

    def polyhedron(self, key: str) -> Polyhedron:
        """The body.

        Raises:
            InputError: If it is given in none of the ways, or in more than one.
        """
        kind, *more = self.given or ["none"]
        text = f"{key}: give one of {', '.join(SHAPES)}, pieces"
        require(kind in SHAPES and more in ([], ["faces"]), text)
        require(kind == "vertices" or not more, f"{key}: faces go with vertices")
        count, body = SHAPES[kind]
        points = np.array(getattr(self, kind), dtype=float)
        text = f"{key}: {kind} has {counted(len(points), 'corner')}; give {count}"
        require(count in (0, len(points)), text)
        return body(points) if self.faces is None else Polyhedron(points, self.faces)


@dataclass(frozen=True)
class _Block(_Shape):
    """A table [blocks.NAME]."""

    pieces: tuple[_Shape, ...] | None = None
    group: str = "default"
    fixed: bool = False

    def block(self, name: str) -> Block:
        """The block, of its pieces or its own shape.

        Raises:
            InputError: If it is none.
        """
        key = f"blocks.{name}"
        text = f"{key}: give either pieces or {', '.join(self.given)}"
        require(self.pieces is None or not self.given, text)
        pieces = {f"{key}.pieces[{k}]": piece for k, piece in enumerate(self.pieces or ())}
        shapes = pieces if self.pieces is not None else {key: self}
        bodies = tuple(shape.polyhedron(place) for place, shape in shapes.items())
        return Block(bodies, name, self.group, self.fixed)


@dataclass(frozen=True)
class _Changes(Checked):
    """Patterns of names: of blocks that are fixed, and of those of groups."""

    fixed: tuple[str, ...] = ()
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


class ReadBlocks(NamedTuple):
    """Blocks of the table [blocks].

    Attributes:
        blocks: Of a file, of a builder, or one by one.
        told: How many a file names, how many were read.
        notes: What of a file was left out, or taken otherwise than written.
        sides: Names of sides that a drawing gives, and lines on which they lie.
    """

    blocks: tuple[Block, ...]
    told: str = ""
    notes: tuple[str, ...] = ()
    sides: Mapping[str, Any] = {}


def blocks_of_table(table: Mapping[str, Any], folder: Path) -> ReadBlocks:
    """Blocks of the table [blocks].

    Raises:
        InputError: If they are wrong.
    """
    if isinstance(up := table.get("up"), str):
        require(up in UPWARDS, f"blocks.up = '{up}' must be one of {listed(UPWARDS)}")
        order, signs = UPWARDS[up]
        blocks, read, notes, _ = blocks_of_table(
            {k: v for k, v in table.items() if k != "up"}, folder
        )
        turned = [
            replace(
                block,
                pieces=tuple(
                    Polyhedron(p.corners[:, order] * signs, p.sides) for p in block.pieces
                ),
            )
            for block in blocks
        ]
        return ReadBlocks(tuple(turned), read, notes)
    if isinstance(table.get("file"), str) or isinstance(table.get("builder"), str):
        return _made(table, folder)
    shapes = {name: from_table(_Block, item, f"blocks.{name}") for name, item in table.items()}
    return ReadBlocks(tuple(shape.block(name) for name, shape in shapes.items()))


def _made(table: Mapping[str, Any], folder: Path) -> ReadBlocks:
    """Blocks of a file or builder; patterns of names say which are fixed, and their groups."""
    given = dict(table)
    changes = from_table(
        _Changes, {k: given.pop(k) for k in ("fixed", "groups") if k in given}, "blocks"
    )
    if "file" in given:
        refuse_unknown("blocks", given, {"file", "unit", "fixed", "groups"})
        readers = import_module("fenics_contact.spatial.readers")
        blocks, read, notes = readers.read_blocks(folder / given["file"], given.get("unit"))
    else:
        blocks, read, notes = built(str(given.pop("builder")), given), "", ()
    names = [name for block in blocks for name in (block.name, block.group)]
    wished: list[tuple[str, Any]] = [(pattern, {"fixed": True}) for pattern in changes.fixed]
    wished += [(p, {"group": g}) for g, patterns in changes.groups.items() for p in patterns]
    for pattern, change in wished:
        chosen = set(fnmatch.filter(names, pattern))
        first = listed(list(dict.fromkeys(names))[:6])
        text = f"blocks: no block or group is called '{pattern}'; the first ones are {first}"
        require(bool(chosen), text)
        blocks = tuple(replace(b, **change) if {b.name, b.group} & chosen else b for b in blocks)
    return ReadBlocks(blocks, read, notes)


def built(name: str, given: Mapping[str, Any]) -> tuple[Block, ...]:
    """Blocks by a function of `builders`."""
    builders = import_module("fenics_contact.spatial.builders")
    known = {
        key: function
        for key, function in vars(builders).items()
        if getattr(function, "__annotations__", {}).get("return") == "Blocks" and key[0] != "_"
    }
    text = f"blocks.builder = '{name}' must be one of {listed(sorted(known))}"
    require(name in known, text)
    return tuple(called(name, known[name], given))


def called(name: str, builder: Callable[..., Any], given: Mapping[str, Any]) -> Any:
    """What a builder makes of keys of the table.

    Raises:
        InputError: If one is unknown or missing, or has a wrong value.
    """
    inner = getattr(builder, "__wrapped__", builder)
    inner = getattr(inner, "__wrapped__", inner)
    code = inner.__code__
    known = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    refuse_unknown("blocks", given, known)
    usual = known[code.co_argcount - len(inner.__defaults__ or ()) : code.co_argcount]
    missing = sorted(set(known) - {*usual, *(inner.__kwdefaults__ or ()), *given})
    text = f"blocks.{min(missing, default='')} is missing; the builder '{name}' needs it"
    require(not missing, text)
    try:
        return builder(**given)
    except InputError as error:
        raise InputError(f"blocks.{error}") from None
