"""Drawings of blocks: outlines with named sides, read from DXF, meshed and written for gmsh."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, Flags, bodies_of_cells, extract, gmsh_session
from fenics_contact.geometry.meshing import (
    Segments,
    default_size,
    divided_outlines,
    lowest_level,
    outline_problem,
    polygons,
    sides_on,
)
from fenics_contact.geometry.planar_cells import check_apart

#: Length of the units of a drawing, m, by name, and by number in DXF ($INSUNITS).
UNITS = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "in": 0.0254, "ft": 0.3048}
DXF_UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 14: "dm"}


@dataclass(frozen=True)
class DrawingLimits:
    """How drawings are read.

    Attributes:
        arc: Largest angle of a straight side that replaces a part of an arc, degrees; it leaves
            the arc by 0.1 % of the radius.
        gap: Corners this close to another block without touching it are told of, relative to the
            side of a square of the blocks' mean area; mortar joints of brickwork are 0.05 thick.
        cells: Largest number of cells; a limit load of more takes days.
    """

    arc: float = 5.0
    gap: float = 0.06
    cells: float = 2e6


LIMITS = DrawingLimits()


@dataclass(frozen=True)
class Drawing:
    """Straight-sided blocks of a planar structure, and lines that name their sides.

    Attributes:
        blocks: Corners of every block in order, either way round, each of shape (corners, 2), m.
        names: Two-dimensional group of every block.
        groups: Segments ((x0, y0), (x1, y1)), m, by name of the one-dimensional group of all sides
            that lie on them. Where two blocks touch, both sides do.
    """

    blocks: Sequence[Array]
    names: Sequence[str]
    groups: Segments = field(default_factory=dict)

    def with_group(self, name: str, *segments: npt.ArrayLike) -> Drawing:
        """The drawing with one more group, of what lies on `segments`; see `groups`."""
        return replace(self, groups={**self.groups, name: segments})

    def mesh(self, size: float | None = None, quadrilaterals: bool = False) -> Any:
        """Gmsh model of the drawing; arguments and errors are those of `meshing.polygons`."""
        return polygons(self.blocks, size, self.names, self.groups, quadrilaterals)

    def lengths(self) -> dict[str, float]:
        """Length of the sides in every group, m, both sides where blocks touch."""
        blocks, near = divided_outlines(list(self.blocks), self.groups)
        sides = [np.linalg.norm(np.roll(b, -1, axis=0) - b, axis=1) for b in blocks]
        return {
            name: sum(
                float(length[sides_on(block, segments, near)].sum())
                for block, length in zip(blocks, sides, strict=True)
            )
            for name, segments in self.groups.items()
        }

    def gaps(self) -> Array:
        """Corners that lie close to another block without touching it, shape (corners, 3).

        The columns are x, y and the distance, m; see `DrawingLimits.gap`.
        """
        from matplotlib.path import Path as Outline

        blocks, near = divided_outlines(list(self.blocks), {})
        reach = 4.0 * LIMITS.gap * default_size(blocks)
        corners = np.unique(np.concatenate(blocks), axis=0)
        found = []
        middles = []
        for block in blocks:
            close = corners[_in_box(corners, block, reach)]
            way = _way_to(close, block)
            distance = np.linalg.norm(way, axis=1)
            some = (distance > near) & (distance < reach)
            found.append(np.column_stack([close, distance])[some])
            middles.append((close + 0.5 * way)[some])
        rows = np.concatenate(found)
        middle = np.concatenate(middles)
        empty = np.ones(len(rows), dtype=bool)  # between corner and block there is no block
        for block in blocks:
            within = np.flatnonzero(_in_box(middle, block, near))
            points = middle[within]
            on = np.linalg.norm(_way_to(points, block), axis=1) <= near
            empty[within[on | Outline(block).contains_points(points)]] = False
        return rows[empty]


def _in_box(points: Array, outline: Array, margin: float) -> Flags:
    """Which points lie in the box around an outline, with a margin."""
    low = outline.min(axis=0) - margin
    high = outline.max(axis=0) + margin
    return np.all((points >= low) & (points <= high), axis=1)


def _way_to(points: Array, outline: Array) -> Array:
    """Vectors from points to the nearest place on an outline, shape (points, 2), m."""
    along = np.roll(outline, -1, axis=0) - outline
    arm = points[:, None] - outline
    at = np.clip(np.sum(arm * along, axis=2) / np.sum(along**2, axis=1), 0.0, 1.0)
    way = at[:, :, None] * along - arm
    nearest = np.argmin(np.linalg.norm(way, axis=2), axis=1)
    return way[np.arange(len(points)), nearest]


# ---- DXF


@dataclass(frozen=True)
class DxfContents:
    """A DXF file as a drawing, with what is to be told of it.

    Attributes:
        drawing: Closed polylines as blocks, lines and open polylines as groups.
        unit: Unit of its coordinates.
        notes: What was left out.
    """

    drawing: Drawing
    unit: str
    notes: tuple[str, ...]


def read_dxf(path: str | Path, unit: str | None = None) -> DxfContents:
    """Read a DXF drawing: closed polylines are blocks, lines and open polylines name sides.

    The layer of a closed polyline is the two-dimensional group of its block; that of a line, the
    one-dimensional group of the sides that lie on it. Without such lines, "base" is the lowest
    level. Arcs in polylines become straight sides of at most 5 degrees, which leave the arc by
    0.1 % of its radius. Layers that are off or frozen are left out.

    Args:
        path: The file.
        unit: One of `UNITS`; by default that of the file ($INSUNITS).

    Raises:
        InputError: If ezdxf is missing, the file is no DXF, has no unit, or no block, or a block
            has no area or crosses itself.
    """
    document = _open_dxf(Path(path))
    source = f"'{path}'"
    unit = unit or DXF_UNITS.get(document.units, "")
    if unit not in UNITS:
        known = ", ".join(UNITS)
        raise InputError(f"{source} does not say its unit; give one of {known}, as in --unit mm")
    blocks: list[Array] = []
    names: list[str] = []
    lines: dict[str, list[npt.ArrayLike]] = {}
    left_out = Counter[str]()
    for entity, layer in _visible(document):
        if entity.dxftype() not in _KINDS:
            left_out[entity.dxftype()] += 1
            continue
        corners, closed = _corners(entity)
        if not closed:
            lines.setdefault(layer, []).extend(pairwise(UNITS[unit] * corners))
            continue
        if problem := outline_problem(corners):
            place = "({:g}, {:g})".format(*corners[0])
            raise InputError(f"{source}: the block on layer '{layer}' at {place} {problem}")
        blocks.append(UNITS[unit] * corners)
        names.append(layer)
    if not blocks:
        count = sum(map(len, lines.values()))
        raise InputError(
            f"{source} has no closed polyline, which would be a block, but {count} lines; join the"
            " sides of every block into a closed polyline"
        )
    notes = [f"left out: {count} {kind}" for kind, count in left_out.items()]
    return _with_used_groups(blocks, names, lines, notes, unit)


def _with_used_groups(
    blocks: list[Array], names: list[str], lines: Segments, notes: list[str], unit: str
) -> DxfContents:
    """Without the groups whose lines touch no block."""
    drawing = Drawing(blocks, names, lines)
    lengths = drawing.lengths()
    notes += [
        f"left out: layer '{name}', on whose lines no side of a block lies"
        for name, length in lengths.items()
        if length == 0.0
    ]
    groups: Segments = {name: lines[name] for name in sorted(lines) if lengths[name] > 0.0}
    if not groups:
        groups = lowest_level(blocks)
        notes.append('no lines on sides of blocks: the group "base" is the lowest level')
    return DxfContents(replace(drawing, groups=groups), unit, tuple(notes))


def _open_dxf(path: Path) -> Any:
    try:
        import ezdxf
    except ImportError:
        problem = "to read DXF drawings install ezdxf: python3-ezdxf on Debian"
        raise InputError(f"{problem}, or pip install ezdxf") from None
    if not path.is_file():
        raise InputError(f"'{path}' does not exist or is no file; give the path of a DXF file")
    try:
        return ezdxf.readfile(path)
    except OSError as error:  # ezdxf's own word for a file of another kind, too
        reason = error.strerror or "it is no DXF file"
    except Exception as error:  # damaged files fail anywhere in ezdxf
        reason = str(error) or type(error).__name__
    raise InputError(f"'{path}' cannot be read: {reason}; save the drawing as DXF")


_KINDS = ("LWPOLYLINE", "POLYLINE", "LINE")


def _visible(document: Any) -> Iterator[tuple[Any, str]]:
    """Entities of the model space with their layers; inserted blocks as their parts."""
    shown = {}
    for layer in document.layers:
        shown[layer.dxf.name.lower()] = not (layer.is_off() or layer.is_frozen())
    spelling: dict[str, str] = {}  # names of layers have no case

    def parts(entities: Iterable[Any], outer: str) -> Iterator[tuple[Any, str]]:
        for entity in entities:
            layer = entity.dxf.get("layer", "0")
            layer = outer if layer == "0" and outer else layer  # as CAD programs do
            if entity.dxftype() == "INSERT":
                yield from parts(entity.virtual_entities(), layer)
            elif shown.get(layer.lower(), True):
                yield entity, spelling.setdefault(layer.lower(), layer)

    yield from parts(document.modelspace(), "")


def _corners(entity: Any) -> tuple[Array, bool]:
    """Corners of a line or polyline in the drawing's unit, arcs divided, and whether it closes."""
    if entity.dxftype() == "LINE":
        return np.array([tuple(entity.dxf.start)[:2], tuple(entity.dxf.end)[:2]]), False
    if entity.dxftype() == "LWPOLYLINE":
        rows = entity.get_points("xyb")
        closed = bool(entity.closed)
    else:
        places = [(v.dxf.location, v.dxf.get("bulge", 0.0)) for v in entity.vertices]
        rows = [(place.x, place.y, bulge) for place, bulge in places]
        closed = bool(entity.is_closed)
    table = np.array(rows, dtype=float).reshape(-1, 3)
    if entity.dxf.get("extrusion", (0, 0, 1))[2] < 0.0:  # drawn on the back of the plane
        table *= (-1.0, 1.0, -1.0)
    ends = table[:, :2]
    size = float(np.ptp(table[:, :2], axis=0).max()) if len(table) else 0.0
    if len(table) > 2 and np.linalg.norm(ends[0] - ends[-1]) <= 1e-6 * size:
        # ends where it began
        table = table[:-1]
        closed = True
    following = np.roll(table[:, :2], -1, axis=0)
    sides = list(zip(table[:, :2], following, table[:, 2], strict=True))
    pieces = [_arc(start, end, bulge) for start, end, bulge in sides]
    return np.concatenate(pieces if closed else [*pieces[:-1], table[-1:, :2]]), closed


def _arc(start: Array, end: Array, bulge: float) -> Array:
    """Points from the start of an arc on, without its end, shape (points, 2).

    The bulge of DXF is the tangent of a quarter of the arc's angle, positive anticlockwise.
    """
    angle = 4.0 * np.arctan(bulge)
    count = max(1, int(np.ceil(abs(angle) / np.radians(LIMITS.arc) - 1e-9)))
    if count == 1:
        return start[None]
    centre = 0.5 * (start + end) + 0.5 / np.tan(0.5 * angle) * _turned(end - start)
    turn = angle * np.arange(count)[:, None] / count
    return centre + np.cos(turn) * (start - centre) + np.sin(turn) * _turned(start - centre)


def _turned(arm: Array) -> Array:
    """A vector turned by a right angle, anticlockwise."""
    return np.array([-arm[1], arm[0]])


# ---- from a file to a file


def mesh_drawing(
    path: Path, output: Path | None = None, size: float | None = None, unit: str | None = None
) -> str:
    """Mesh a DXF drawing and write it for gmsh; returns what was made, for people.

    Args:
        path: The drawing; see `read_dxf`.
        output: The .msh file; by default beside the drawing, with its name.
        size: Largest length of an element along the sides, m; see `meshing.polygons`.
        unit: See `read_dxf`.

    Raises:
        InputError: If the drawing is wrong or blocks overlap, or the mesh cannot be written; no
            file is written then.
    """
    output = path.with_suffix(".msh") if output is None else output
    if output.suffix != ".msh":
        raise InputError(f"'{output}' must end with .msh, for gmsh")
    if size is not None and not 0.0 < size < np.inf:
        raise InputError(f"size = {size:g} must be a positive length, m")
    contents = read_dxf(path, unit)
    drawing = contents.drawing
    width, height = np.ptp(np.concatenate(drawing.blocks), axis=0)
    size = size or default_size(list(drawing.blocks))
    if size > max(width, height):
        raise InputError(
            f"elements of {size:g} m are larger than the drawing, {width:g} m x {height:g} m; give"
            " --size in m"
        )
    # Two triangles or more for each square, and the squares of four elements by default.
    cells = 32.0 * len(drawing.blocks) * (default_size(list(drawing.blocks)) / size) ** 2
    if cells > LIMITS.cells:
        raise InputError(f"elements of {size:g} m would be {cells:.1g} cells; give a larger --size")
    model = drawing.mesh(size)
    mesh = extract(model, f"'{path}'")
    check_apart(mesh.points, mesh.cells, bodies_of_cells(mesh), mesh.source)
    _write(output)
    lines = [
        f"{path}: {len(drawing.blocks)} blocks, {width:g} m x {height:g} m ({contents.unit})",
        f"blocks by layer: {_listed(Counter(drawing.names))}",
        f"sides by layer: {_listed({n: f'{v:g} m' for n, v in drawing.lengths().items()})}",
        f"mesh: {len(mesh.cells)} triangles, elements of at most {size:.3g} m along the sides",
        *contents.notes,
        *_gap_warning(drawing),
        f"written to {output}",
        f'next: write a scene with mesh.file = "{output.name}", then: fenics-contact check SCENE',
    ]
    return "\n".join(lines)


def _gap_warning(drawing: Drawing) -> Iterator[str]:
    gaps = drawing.gaps()
    if len(gaps):
        x, y, distance = gaps[0]
        yield (
            f"warning: {len(gaps)} corners lie beside another block without touching it, the first"
            f" at ({x:g}, {y:g}) m, {distance:.2g} m away; gaps above a"
            " thousandth of an element's side are no closed joints: snap them together"
        )


def _listed(values: Mapping[str, object]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items()) or "none"


def _write(output: Path) -> None:
    """Write the current gmsh model, as a whole or not at all."""
    part = output.with_name(f".{output.stem}.{os.getpid()}.msh")
    try:
        if output.is_dir():
            raise InputError(f"cannot write to '{output}': it is a folder")
        part.touch()  # gmsh does not say why it cannot
        with gmsh_session() as gmsh:
            gmsh.write(str(part))
        part.replace(output)
    except OSError as error:
        raise InputError(f"cannot write to '{output}': {error.strerror}") from None
    finally:
        part.unlink(missing_ok=True)
