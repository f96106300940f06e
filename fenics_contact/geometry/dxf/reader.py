"""Curves of a DXF file by layer: lines, polylines, arcs, circles, ellipses and splines."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import InputError, require
from fenics_contact.geometry.planar_cells import Array

#: Length of the units of a drawing, m, by name, and by number in DXF ($INSUNITS).
UNITS = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "in": 0.0254, "ft": 0.3048}
DXF_UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 14: "dm"}


# What a drawing of a building keeps to; more is a mistake or would take hours.
#: Largest coordinate, in the drawing's unit; map coordinates have 1e10 mm.
LARGEST = 1e12
#: Largest number of entities with all inserted blocks, and of inserts in each other.
PARTS = 200_000
DEPTH = 16
#: Most bytes of the name of a layer; gmsh keeps 127.
NAME = 100
#: Largest bulge: that of a full circle but for a quarter of a degree.
BULGE = 1e3
#: Points along an ellipse or a span of a spline from which its chords are chosen.
CHORDS = 72
#: Entities that are curves, by their names in DXF.
KINDS = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE")


@dataclass(frozen=True)
class Curve:
    """A chain of straight pieces and arcs on a layer.

    Attributes:
        points: Ends of the pieces, in the drawing's unit, shape (points, 2).
        bulges: Tangent of a quarter of the angle of the piece that begins at every point, positive
            anticlockwise, 0 if straight, shape (points,); the last counts if closed.
        closed: Whether a last piece leads back to the first point.
        layer: Its layer.
        kind: Its name in DXF.
        smooth: Whether the points stand for a smooth curve, of which few are needed.
    """

    points: Array
    bulges: Array
    closed: bool
    layer: str
    kind: str
    smooth: bool = False

    @property
    def ends(self) -> Array:
        """Points at which other curves may end: all of a polyline, the two ends of a spline."""
        return self.points[[0, -1]] if self.smooth else self.points


@dataclass
class Curves:
    """Curves of a drawing.

    Attributes:
        source: The file, for messages.
        unit: Unit of the coordinates, one of `UNITS`.
        unit_given: Whether the user says so, else the file.
        curves: Curves on visible layers.
        notes: What was left out.
    """

    source: str
    unit: str
    unit_given: bool = False
    curves: list[Curve] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@contextmanager
def visible_entities(path: Path, unit: str | None) -> Iterator[tuple[Entities, str, list[str]]]:
    """Entities on the visible layers of a DXF file, its unit, and what ezdxf says meanwhile.

    Args:
        path: The file.
        unit: One of `UNITS`; by default that of the file ($INSUNITS).

    Raises:
        InputError: If ezdxf is missing, or the file is no DXF or has no unit.
    """
    said: list[str] = []

    def collected(record: logging.LogRecord) -> bool:
        """Keep what ezdxf says about a damaged file, as one printable line, from stderr."""
        said.append("".join(c for c in record.getMessage()[:200] if c.isprintable()))
        return False

    source = f"'{path}'"
    logger = logging.getLogger("ezdxf")
    handler = logging.Handler(logging.WARNING)
    handler.addFilter(collected)
    before = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        document = _open_dxf(path)
        known = unit or DXF_UNITS.get(document.units) or ""
        text = f"does not say its unit; give one of {', '.join(UNITS)}: --unit mm (or blocks.unit)"
        require(known in UNITS, f"{source} {text}")
        yield Entities(document, source), known, said
    finally:
        logger.propagate = before
        logger.removeHandler(handler)


def read_curves(path: Path, unit: str | None) -> Curves:
    """Curves on the visible layers of a DXF file, with those of inserted blocks.

    Args:
        path: The file.
        unit: One of `UNITS`; by default that of the file ($INSUNITS).

    Raises:
        InputError: If ezdxf is missing, the file is no DXF, has no unit, or has a damaged entity.
    """
    source = f"'{path}'"
    with visible_entities(path, unit) as (parts, known, said):
        found = Curves(source, known, unit is not None)
        for entity, layer in parts.visible():
            kind = entity.dxftype()
            curve = _curve(entity, layer, source) if kind in KINDS else None
            size = 0.0 if curve is None else np.abs(curve.points).max()
            where = f"{kind} on layer '{layer}'"
            much = f"a coordinate of {size:g} {known}"
            if curve is None:
                parts.left_out[
                    f"{kind} of no length on layer '{layer}'" if kind in KINDS else kind
                ] += 1
            elif size <= LARGEST:
                found.curves.append(curve)
            elif curve.closed:
                raise InputError(f"{source}: the {where} has {much}; delete it or draw it anew")
            else:
                parts.left_out[f"{where} with {much}"] += 1
    found.notes += [f"left out: {count} {kind}" for kind, count in parts.left_out.items()]
    found.notes += [
        f"layer '{key}' is called '{name}': gmsh does not keep its name"
        for key, name in parts.spelling.items()
        if name.lower() != key and key.isprintable()
    ]
    found.notes += [f"warning: damaged file: {text}" for text in list(dict.fromkeys(said))[:5]]
    return found


def _open_dxf(path: Path) -> Any:
    try:
        import ezdxf
        import shapely  # noqa: F401 (finds faces and overlaps later)
    except ImportError:
        problem = "to read DXF drawings install python3-ezdxf and python3-shapely (Debian)"
        raise InputError(f"{problem}, or pip install ezdxf shapely") from None
    text = "does not exist or is no file; give the path of a DXF file"
    require(path.is_file(), f"'{path}' {text}")
    try:
        return ezdxf.readfile(path)
    except OSError as error:  # ezdxf's own word for a file of another kind, too
        reason = error.strerror or "it is no DXF file"
    except Exception as error:  # damaged files fail anywhere in ezdxf
        reason = " ".join(str(error).split()) or type(error).__name__
    raise InputError(f"'{path}' cannot be read: {reason}; save the drawing as DXF")


class Entities:
    """Entities of a document with those of inserted blocks, counted.

    Attributes:
        left_out: Number of entities that are left out, by what they are.
        spelling: Names of layers as groups of gmsh, by their names in small letters: they have no
            case.
    """

    def __init__(self, document: Any, source: str) -> None:
        self.left_out = Counter[str]()
        self.spelling: dict[str, str] = {}
        self._document = document
        self._source = source
        self._count = 0

    def visible(self) -> Iterator[tuple[Any, str]]:
        """Entities of the model space on visible layers, with their layers.

        gmsh keeps no quotes in names, and cuts long ones.
        """
        layers = self._document.layers
        hidden = {str(one.dxf.name).lower() for one in layers if one.is_off() or one.is_frozen()}
        for entity, layer in self._parts(self._document.modelspace(), "", ()):
            key = layer.lower()
            if key in hidden:
                self.left_out[f"on layer '{layer}', which is off or frozen"] += 1
                continue
            if key not in self.spelling:
                name = layer.encode("utf-8", "replace").decode().replace('"', "'")
                name = "".join(c if c.isprintable() else "?" for c in name)
                short = name.encode()[:NAME].decode("utf-8", "ignore")
                number = 1
                while short.lower() in {known.lower() for known in self.spelling.values()}:
                    number += 1
                    short = f"{name.encode()[: NAME - 5].decode('utf-8', 'ignore')}~{number}"
                self.spelling[key] = short
            yield entity, self.spelling[key]

    def _parts(
        self, entities: Iterable[Any], outer: str, inside: tuple[str, ...]
    ) -> Iterator[tuple[Any, str]]:
        """Entities and their layers, with those of inserted blocks.

        Those on layer 0 of a block have the layer of its insert, as in CAD programs.

        Args:
            entities: Entities of the document or of a block.
            outer: Layer of the block's insert.
            inside: Blocks that this one is in.
        """
        for entity in entities:
            self._add(1)
            # ezdxf does not know the layer of some entities
            layer = str(entity.dxf.layer) if entity.dxf.is_supported("layer") else "0"
            layer = outer if layer == "0" and outer else layer
            if entity.dxftype() != "INSERT":
                yield entity, layer
                continue
            name = str(entity.dxf.get("name", ""))
            shown = name.encode("utf-8", "replace").decode()
            if name not in self._document.blocks:
                self.left_out[f"insert of '{shown}', a block that the drawing lacks"] += 1
            elif name.lower() in inside:
                self.left_out[f"insert of '{shown}' in itself"] += 1
            elif len(inside) >= DEPTH:
                self.left_out[f"insert of '{shown}' in {DEPTH} others"] += 1
            else:
                count = max(1, entity.mcount)
                self._add(count * len(self._document.blocks[name]))
                try:
                    for copy in entity.multi_insert() if count > 1 else [entity]:
                        parts = list(copy.virtual_entities())
                        yield from self._parts(parts, layer, (*inside, name.lower()))
                except InputError:
                    raise
                except Exception as error:
                    reason = str(error) or type(error).__name__
                    raise InputError(
                        f"{self._source}: the insert of '{shown}' cannot be read: {reason};"
                        " explode it"
                    ) from None

    def _add(self, count: int) -> None:
        self._count += count
        text = "entities with its inserted blocks; delete what is no block of the structure"
        require(self._count <= PARTS, f"{self._source} has more than {PARTS} {text}")


def _curve(entity: Any, layer: str, source: str) -> Curve | None:
    """Curve of an entity; none if it has no length."""
    kind = entity.dxftype()
    try:
        with np.errstate(all="ignore"):
            points, bulges, closed = _pieces(entity)
        finite = np.all(np.isfinite(points)) and np.all(np.isfinite(bulges))
        require(bool(finite), "a coordinate is no number")
        most = np.abs(bulges).max(initial=0.0)
        require(most <= BULGE, f"an arc has a bulge of {most:g}")
    except Exception as error:  # damaged entities fail anywhere in ezdxf
        reason = f"{str(error) or type(error).__name__}; delete it or draw it anew"
        text = f"the {kind} on layer '{layer}' cannot be read: {reason}"
        raise InputError(f"{source}: {text}") from None
    if len(points) > 2 and not closed:
        size = np.linalg.norm(np.ptp(points, axis=0))
        if np.linalg.norm(points[0] - points[-1]) <= 1e-6 * size:
            points = points[:-1]  # ends where it began
            bulges = bulges[:-1]
            closed = True
    if len(points) < 2 or not np.any(points != points[0]):
        return None
    return Curve(points, bulges, closed, layer, kind, kind in ("ELLIPSE", "SPLINE"))


def _pieces(entity: Any) -> tuple[Array, Array, bool]:
    """Points and bulges of an entity of `KINDS`, and whether it is closed; see `Curve`."""
    dxf = entity.dxf
    kind = entity.dxftype()
    if kind == "LINE":
        return np.array([tuple(dxf.start)[:2], tuple(dxf.end)[:2]]), np.zeros(2), False
    if kind == "ELLIPSE":
        sweep = (dxf.end_param - dxf.start_param) % (2.0 * np.pi)
        closed = sweep < 1e-9 or sweep > 2.0 * np.pi - 1e-9
        sweep = 2.0 * np.pi if closed else sweep
        parameters = dxf.start_param + sweep * np.linspace(0.0, 1.0, 4 * CHORDS + 1)
        points = np.array([tuple(p)[:2] for p in entity.vertices(parameters.tolist())])
        return points[:-1] if closed else points, np.zeros(len(points) - closed), closed
    if kind == "SPLINE":
        try:
            curve = entity.construction_tool()
        except ZeroDivisionError:  # ezdxf's tangents at fit points whose distances are alike
            from ezdxf.math import global_bspline_interpolation

            fit = entity.fit_points
            curve = global_bspline_interpolation(fit, min(3, len(fit) - 1), method="chord")
        spans = min(max(1, curve.count - curve.degree), 1000)
        points = np.array([tuple(p)[:2] for p in curve.approximate(spans * CHORDS)])
        return points, np.zeros(len(points)), False
    if kind in ("ARC", "CIRCLE"):  # two arcs, each of half of a sweep
        closed = kind == "CIRCLE"
        degrees = 0.0 if closed else (dxf.end_angle - dxf.start_angle) % 360.0
        sweep = np.radians(degrees) or 2.0 * np.pi
        start = 0.0 if closed else np.radians(dxf.start_angle)
        angles = start + 0.5 * sweep * np.arange(3 - closed)
        around = np.column_stack([np.cos(angles), np.sin(angles)])
        points = np.array(tuple(dxf.center)[:2]) + dxf.radius * around
        bulges = np.full(len(points), np.tan(sweep / 8.0))
    else:
        if kind == "LWPOLYLINE":
            rows = entity.get_points("xyb")
            closed = bool(entity.closed)
        else:
            places = [(v.dxf.location, v.dxf.get("bulge", 0.0)) for v in entity.vertices]
            rows = [(place.x, place.y, bulge) for place, bulge in places]
            closed = bool(entity.is_closed)
        points, bulges = np.split(np.array(rows, dtype=float).reshape(-1, 3), [2], axis=1)
        bulges = bulges[:, 0]
    if dxf.get("extrusion", (0, 0, 1))[2] < 0.0:  # drawn on the back of the plane
        return points * (-1.0, 1.0), -bulges, closed
    return points, bulges, closed
