"""Blocks of a scene file's table [blocks]: of a file, of a builder, or one by one."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import InputError, check_type, require, types_of
from fenics_contact.geometry import builders
from fenics_contact.geometry.dxf.blocks import read_dxf
from fenics_contact.geometry.gmsh_mesh import read_file
from fenics_contact.geometry.mesh import Array
from fenics_contact.geometry.meshing import Drawing, drawing_of
from fenics_contact.geometry.outlines import outline_problem
from fenics_contact.results.bounds import counted
from fenics_contact.scene.rules import Checked, listed
from fenics_contact.scene.toml_tables import as_mapping, from_table, refuse_unknown
from fenics_contact.spatial.polyhedra import Block, Polyhedron, ReadBlocks
from fenics_contact.spatial.surfaces import Surface, blocks_of

#: Shapes of blocks: how many corners they have, 0 for any number, and the body of these.
SHAPES: dict[str, tuple[int, Callable[[Array], Polyhedron]]] = {
    "box": (2, lambda corners: Polyhedron.box(corners.min(axis=0), corners.max(axis=0))),
    "hexahedron": (8, Polyhedron.hexahedron),
    "vertices": (0, Polyhedron.hull),
}
#: Which axes of a file become x, y and z, by the one that points upwards, with their signs.
UPWARDS = {"x": ((2, 1, 0), (-1, 1, 1)), "y": ((0, 2, 1), (1, -1, 1))}
#: Builders that draw outlines; and those of space that make prisms, with what makes them so.
DRAWN = ("facade", "bridge", "retaining_wall")
BUILT: dict[str, tuple[str, dict[str, Any]]] = {
    "wall": ("wall", {"thickness": 1.0}),
    "arch": ("barrel_vault", {"length": 1.0, "strips": 1}),
}
#: From builders of space to the plane, m.
MIDDLE = np.array([0.0, -0.5, 0.0])

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
class _Polygon(Checked):
    """A table [blocks.NAME] in the plane: corners in m."""

    polygon: tuple[tuple[float, float], ...]
    group: str = "default"
    fixed: bool = False

    def block(self, name: str) -> Block:
        """The block, a prism."""
        return prism(self.polygon, name, self.group, self.fixed)


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
    named = [(group, f"{group}_{groups[: k + 1].count(group)}") for k, group in enumerate(groups)]
    every = zip(outlines, named, strict=True)
    return tuple(prism(outline, name, group) for outline, (group, name) in every)


@dataclass(frozen=True)
class _Changes(Checked):
    """Patterns of names: of blocks that are fixed, and of those of groups."""

    fixed: tuple[str, ...] = ()
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def blocks_of_table(table: Mapping[str, Any], folder: Path, dimension: int) -> ReadBlocks:
    """Blocks of the table [blocks]; those of the plane are prisms a metre deep.

    Raises:
        InputError: If they are wrong.
    """
    given = dict(table)
    axes = tuple("xyz"[:dimension])
    up = given.pop("up") if isinstance(given.get("up"), str) else axes[-1]
    require(up in axes, f"blocks.up = '{up}' must be one of {listed(axes)}")
    options = {
        key: given.pop(key)
        for key in ("size", "elastic")
        if not isinstance(given.get(key, {}), Mapping)
    }
    if _is_made(given):
        read = _made(given, folder, dimension == 2)
    else:
        read = _joined([_part(name, item, folder, dimension) for name, item in given.items()])
    read = read._replace(**options)
    return read if up == axes[-1] else _upright(read, *UPWARDS[up])


def _is_made(given: Mapping[str, Any]) -> bool:
    """Whether a table is of a file or builder."""
    return any(isinstance(given.get(key), str) for key in ("file", "builder"))


def _part(name: str, table: Any, folder: Path, dimension: int) -> ReadBlocks:
    """A block by its shape, or the blocks of a file or builder at a place, called after it."""
    given = dict(as_mapping(f"blocks.{name}", table))
    if not _is_made(given):
        kind: Any = _Polygon if dimension == 2 else _Block
        return ReadBlocks((from_table(kind, given, f"blocks.{name}").block(name),))
    place = given.pop("at", [0.0] * dimension)
    check_type(f"blocks.{name}.at", place, tuple[float, ...])
    at = np.array(place)
    require(len(at) == dimension, f"blocks.{name}.at must be {dimension} numbers, m")
    try:
        read = _made(given, folder, dimension == 2)
    except InputError as error:
        raise InputError(f"blocks.{name}: {error}") from None
    shift = at if dimension == 3 else np.insert(at, 1, 0.0)
    moved = (_moved(block, lambda corners: corners + shift) for block in read.blocks)
    blocks = tuple(replace(block, name=f"{name}_{block.name}") for block in moved)
    sides = {side: (np.array(lines) + at).tolist() for side, lines in read.sides.items()}
    return read._replace(blocks=blocks, sides=sides)


def _joined(parts: Sequence[ReadBlocks]) -> ReadBlocks:
    """Blocks of all parts; sides of one name are one."""
    sides: dict[str, Any] = {}
    for name, lines in (item for part in parts for item in part.sides.items()):
        sides[name] = [*sides.get(name, []), *lines]
    told = "; ".join(part.told for part in parts if part.told)
    notes = tuple(note for part in parts for note in part.notes)
    return ReadBlocks(tuple(b for part in parts for b in part.blocks), told, notes, sides)


def _upright(read: ReadBlocks, order: Sequence[int], signs: Sequence[int]) -> ReadBlocks:
    """Blocks and lines of sides with other axes."""

    def turned(places: Array) -> Array:
        return np.asarray(places[..., order] * signs)

    sides = {
        name: turned(np.insert(np.array(lines), 1, 0.0, axis=-1))[..., ::2].tolist()
        for name, lines in read.sides.items()
    }
    return read._replace(blocks=tuple(_moved(b, turned) for b in read.blocks), sides=sides)


def _moved(block: Block, change: Callable[[Array], Array]) -> Block:
    """A block whose corners are elsewhere."""
    pieces = (Polyhedron(change(piece.corners), piece.sides) for piece in block.pieces)
    cells = None if block.cells is None else change(block.cells)
    return replace(block, pieces=tuple(pieces), cells=cells)


def _made(given: dict[str, Any], folder: Path, in_plane: bool) -> ReadBlocks:
    """Blocks of a file or builder; patterns of names say which are fixed, and their groups."""
    changes = from_table(
        _Changes, {k: given.pop(k) for k in ("fixed", "groups") if k in given}, "blocks"
    )
    if "file" in given:
        refuse_unknown("blocks", given, {"file", "unit", "fixed", "groups"})
        path = folder / given["file"]
        unit = given.get("unit")
        if in_plane:
            is_mesh = path.suffix.lower() == ".msh"
            require(not (is_mesh and unit), f"blocks.unit: {path.name} is in m, as all meshes")
            drawn = None if is_mesh else read_dxf(path, unit)
            read = _drawn(drawn.drawing if drawn else drawing_of(read_file(path)))
            told = f"{path.name}: {counted(len(read.blocks), 'block')}"
            read = read._replace(told=told, notes=tuple(map(_here, drawn.notes)) if drawn else ())
        else:
            readers = import_module("fenics_contact.spatial.readers")
            read = readers.read_blocks(path, unit)
    else:
        name = given.pop("builder")
        read = _built_in_plane(name, given) if in_plane else ReadBlocks(built(name, given))
    blocks = read.blocks
    names = [name for block in blocks for name in (block.name, block.group)]
    wished: list[tuple[str, Any]] = [(pattern, {"fixed": True}) for pattern in changes.fixed]
    wished += [(p, {"group": g}) for g, patterns in changes.groups.items() for p in patterns]
    for pattern, change in wished:
        chosen = set(fnmatch.filter(names, pattern))
        first = listed(list(dict.fromkeys(names))[:6])
        text = f"blocks: no block or group is called '{pattern}'; the first ones are {first}"
        require(bool(chosen), text)
        blocks = tuple(replace(b, **change) if {b.name, b.group} & chosen else b for b in blocks)
    return read._replace(blocks=blocks)


def _here(note: str) -> str:
    """A note on a drawing, with what works in place of options that a table has not."""
    note = note.replace("--unit ", "blocks.unit = ")
    way = " (options of `fenics-contact mesh`; here freeze layers that are no stones)"
    return note + way * (" --" in note)


def _drawn(drawing: Drawing) -> ReadBlocks:
    """Blocks of a drawing, and its groups as sides."""
    lines = {name: np.array(some, dtype=float).tolist() for name, some in drawing.groups.items()}
    return ReadBlocks(prisms(drawing.blocks, drawing.names), sides=lines)


def _built_in_plane(name: str, given: Mapping[str, Any]) -> ReadBlocks:
    """Blocks by a builder of drawings, or by one of space that makes prisms."""
    known = [*DRAWN, *BUILT]
    require(name in known, f"blocks.builder = '{name}' must be one of {listed(known)}")
    if name in BUILT:
        kind, fixed = BUILT[name]
        again = sorted(fixed.keys() & given.keys())
        text = f"blocks.{min(again, default='')}: structures in the plane are a metre deep"
        require(not again, text)
        blocks = built(kind, {**given, **fixed})
        return ReadBlocks(
            tuple(_moved(block, lambda corners: corners + MIDDLE) for block in blocks)
        )
    pairs = {k: tuple(v) if isinstance(v, list) else v for k, v in given.items()}
    abutments = pairs.pop("abutments", True) if name == "bridge" else False
    check_type("blocks.abutments", abutments, bool)
    read = _drawn(called(name, getattr(builders, name), pairs))
    abutted = import_module("fenics_contact.spatial.builders").abutted
    return read._replace(blocks=abutted(read.blocks)) if abutments else read


def built(name: str, given: Mapping[str, Any]) -> tuple[Block, ...]:
    """Blocks by a function of `builders`."""
    known = {
        key: function
        for key, function in vars(import_module("fenics_contact.spatial.builders")).items()
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
    for key, value in given.items():
        check_type(f"blocks.{key}", value, types_of(builder)[key])
    try:
        return builder(**given)
    except InputError as error:
        raise InputError(f"blocks.{error}") from None
