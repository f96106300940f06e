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

from fenics_contact.errors import InputError
from fenics_contact.geometry.planar_cells import Array

#: Length of the units of a drawing, m, by name, and by number in DXF ($INSUNITS).
UNITS = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "in": 0.0254, "ft": 0.3048}
DXF_UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 14: "dm"}


@dataclass(frozen=True)
class ReaderLimits:
    """What a drawing of a building keeps to; more is a mistake or would take hours.

    Attributes:
        coordinate: Largest coordinate, in the drawing's unit; map coordinates have 1e10 mm.
        parts: Largest number of entities with all inserted blocks.
        depth: Largest number of inserts in each other.
        name: Most bytes of the name of a layer; gmsh keeps 127.
        bulge: Largest bulge: that of a full circle but for a quarter of a degree.
        chords: Points along an ellipse or a span of a spline from which its chords are chosen.
    """

    coordinate: float = 1e12
    parts: int = 200_000
    depth: int = 16
    name: int = 100
    bulge: float = 1e3
    chords: int = 72


LIMITS = ReaderLimits()


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


def read_curves(path: Path, unit: str | None) -> Curves:
    """Curves on the visible layers of a DXF file, with those of inserted blocks.

    Args:
        path: The file.
        unit: One of `UNITS`; by default that of the file ($INSUNITS).

    Raises:
        InputError: If ezdxf is missing, the file is no DXF, has no unit, or has a damaged entity.
    """
    with _warnings_of_ezdxf() as said:
        found = _read_curves(path, unit)
    found.notes += [f"warning: damaged file: {text}" for text in list(dict.fromkeys(said))[:5]]
    return found


@contextmanager
def _warnings_of_ezdxf() -> Iterator[list[str]]:
    """What ezdxf says about a damaged file, in a list instead of on stderr."""
    said: list[str] = []

    class Collector(logging.Handler):
        """Appends messages to the list, each as one printable line."""

        def emit(self, record: logging.LogRecord) -> None:
            """Append a message."""
            said.append("".join(c for c in record.getMessage()[:200] if c.isprintable()))

    logger = logging.getLogger("ezdxf")
    handler = Collector(logging.WARNING)
    before = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield said
    finally:
        logger.propagate = before
        logger.removeHandler(handler)


def _read_curves(path: Path, unit: str | None) -> Curves:
    """Curves of a file; see `read_curves`."""
    document = _open_dxf(path)
    source = f"'{path}'"
    given = unit is not None
    unit = unit or DXF_UNITS.get(document.units, "")
    if unit not in UNITS:
        known = ", ".join(UNITS)
        raise InputError(f"{source} does not say its unit; give one of {known}, as in --unit mm")
    found = Curves(source, unit, given)
    left_out = Counter[str]()
    parts = _Parts(document, source, left_out)
    for entity, layer in parts.visible():
        kind = entity.dxftype()
        if kind not in _READERS:
            left_out[kind] += 1
            continue
        curve = _curve(entity, layer, source)
        if curve is None:
            left_out[f"{kind} of no length on layer '{layer}'"] += 1
        elif np.abs(curve.points).max() <= LIMITS.coordinate:
            found.curves.append(curve)
        elif curve.closed:
            size = np.abs(curve.points).max()
            raise InputError(
                f"{source}: the {kind} on layer '{layer}' has a coordinate of {size:g} {unit};"
                " delete it or draw it anew"
            )
        else:
            size = np.abs(curve.points).max()
            left_out[f"{kind} on layer '{layer}' with a coordinate of {size:g} {unit}"] += 1
    found.notes += [f"left out: {count} {kind}" for kind, count in left_out.items()]
    found.notes += parts.renamed()
    return found


def _open_dxf(path: Path) -> Any:
    try:
        import ezdxf
        import shapely  # noqa: F401 (finds faces and overlaps later)
    except ImportError:
        problem = "to read DXF drawings install python3-ezdxf and python3-shapely (Debian)"
        raise InputError(f"{problem}, or pip install ezdxf shapely") from None
    if not path.is_file():
        raise InputError(f"'{path}' does not exist or is no file; give the path of a DXF file")
    try:
        return ezdxf.readfile(path)
    except OSError as error:  # ezdxf's own word for a file of another kind, too
        reason = error.strerror or "it is no DXF file"
    except Exception as error:  # damaged files fail anywhere in ezdxf
        reason = str(error) or type(error).__name__
    raise InputError(f"'{path}' cannot be read: {reason}; save the drawing as DXF")


class _Parts:
    """Entities of a document with those of inserted blocks, counted.

    Attributes:
        document: The document.
        source: The file, for messages.
        left_out: Number of entities that are left out, by what they are; inserts are added.
    """

    def __init__(self, document: Any, source: str, left_out: Counter[str]) -> None:
        self.document = document
        self.source = source
        self.left_out = left_out
        self._count = 0
        self._hidden = set()
        for layer in document.layers:
            if layer.is_off() or layer.is_frozen():
                self._hidden.add(str(layer.dxf.name).lower())
        self._spelling: dict[str, str] = {}  # names of layers have no case

    def visible(self) -> Iterator[tuple[Any, str]]:
        """Entities of the model space on visible layers, with their layers."""
        for entity, layer in self._parts(self.document.modelspace(), "", ()):
            if layer.lower() in self._hidden:
                self.left_out[f"on layer '{layer}', which is off or frozen"] += 1
            else:
                yield entity, self._name(layer)

    def _name(self, layer: str) -> str:
        """Name of a layer as a group of gmsh, which keeps no quotes and cuts long names."""
        key = layer.lower()
        if key not in self._spelling:
            name = layer.encode("utf-8", "replace").decode().replace('"', "'")
            name = "".join(c if c.isprintable() else "?" for c in name)
            short = name.encode()[: LIMITS.name].decode("utf-8", "ignore")
            number = 1
            while short.lower() in {known.lower() for known in self._spelling.values()}:
                number += 1
                short = f"{name.encode()[: LIMITS.name - 5].decode('utf-8', 'ignore')}~{number}"
            self._spelling[key] = short
        return self._spelling[key]

    def renamed(self) -> Iterator[str]:
        """Layers that have another name as groups."""
        for key, name in self._spelling.items():
            if name.lower() != key and key.isprintable():
                yield f"layer '{key}' is called '{name}': gmsh does not keep its name"

    def _parts(
        self, entities: Iterable[Any], outer: str, inside: tuple[str, ...]
    ) -> Iterator[tuple[Any, str]]:
        """Entities and their layers; those on layer 0 of a block have the layer of its insert."""
        for entity in entities:
            self._add(1)
            layer = _layer_of(entity)
            layer = outer if layer == "0" and outer else layer  # as CAD programs do
            if entity.dxftype() == "INSERT":
                yield from self._inserted(entity, layer, inside)
            else:
                yield entity, layer

    def _inserted(self, insert: Any, layer: str, inside: tuple[str, ...]) -> Iterator:
        """Parts of all copies of an inserted block."""
        name = str(insert.dxf.get("name", ""))
        shown = name.encode("utf-8", "replace").decode()
        if name not in self.document.blocks:
            self.left_out[f"insert of '{shown}', a block that the drawing lacks"] += 1
        elif name.lower() in inside:
            self.left_out[f"insert of '{shown}' in itself"] += 1
        elif len(inside) >= LIMITS.depth:
            self.left_out[f"insert of '{shown}' in {LIMITS.depth} others"] += 1
        else:
            count = max(1, insert.mcount)
            self._add(count * len(self.document.blocks[name]))
            try:
                for copy in insert.multi_insert() if count > 1 else [insert]:
                    parts = list(copy.virtual_entities())
                    yield from self._parts(parts, layer, (*inside, name.lower()))
            except InputError:
                raise
            except Exception as error:
                reason = str(error) or type(error).__name__
                raise InputError(
                    f"{self.source}: the insert of '{shown}' cannot be read: {reason}; explode it"
                ) from None

    def _add(self, count: int) -> None:
        self._count += count
        if self._count > LIMITS.parts:
            raise InputError(
                f"{self.source} has more than {LIMITS.parts} entities with its inserted blocks;"
                " delete what is no block of the structure"
            )


def _layer_of(entity: Any) -> str:
    """Name of an entity's layer; "0" for entities that ezdxf does not know."""
    return str(entity.dxf.layer) if entity.dxf.is_supported("layer") else "0"


def _curve(entity: Any, layer: str, source: str) -> Curve | None:
    """Curve of an entity; none if it has no length."""
    kind = entity.dxftype()
    try:
        with np.errstate(all="ignore"):
            points, bulges, closed = _READERS[kind](entity)
        reason = ""
        if not np.all(np.isfinite(points)) or not np.all(np.isfinite(bulges)):
            reason = "a coordinate is no number"
        elif np.any(np.abs(bulges) > LIMITS.bulge):
            reason = f"an arc has a bulge of {np.abs(bulges).max():g}"
    except Exception as error:  # damaged entities fail anywhere in ezdxf
        reason = str(error) or type(error).__name__
    if reason:
        raise InputError(
            f"{source}: the {kind} on layer '{layer}' cannot be read: {reason}; delete it or draw"
            " it anew"
        )
    if len(points) > 1 and not closed:
        size = np.linalg.norm(np.ptp(points, axis=0))
        if len(points) > 2 and np.linalg.norm(points[0] - points[-1]) <= 1e-6 * size:
            points = points[:-1]  # ends where it began
            bulges = bulges[:-1]
            closed = True
    if len(points) < 2 or not np.any(points != points[0]):
        return None
    return Curve(points, bulges, closed, layer, kind, kind in ("ELLIPSE", "SPLINE"))


_Pieces = tuple[Array, Array, bool]


def _line(entity: Any) -> _Pieces:
    points = np.array([tuple(entity.dxf.start)[:2], tuple(entity.dxf.end)[:2]])
    return points, np.zeros(2), False


def _polyline(entity: Any) -> _Pieces:
    if entity.dxftype() == "LWPOLYLINE":
        rows = entity.get_points("xyb")
        closed = bool(entity.closed)
    else:
        places = [(v.dxf.location, v.dxf.get("bulge", 0.0)) for v in entity.vertices]
        rows = [(place.x, place.y, bulge) for place, bulge in places]
        closed = bool(entity.is_closed)
    table = np.array(rows, dtype=float).reshape(-1, 3)
    return _unmirrored(entity, table[:, :2], table[:, 2], closed)


def _arc(entity: Any) -> _Pieces:
    start = np.radians(entity.dxf.start_angle)
    sweep = np.radians((entity.dxf.end_angle - entity.dxf.start_angle) % 360.0) or 2.0 * np.pi
    angles = start + 0.5 * sweep * np.arange(3)
    return _on_circle(entity, angles, sweep, False)


def _circle(entity: Any) -> _Pieces:
    return _on_circle(entity, np.array([0.0, np.pi]), 2.0 * np.pi, True)


def _on_circle(entity: Any, angles: Array, sweep: float, closed: bool) -> _Pieces:
    """Two arcs, each of half of a sweep."""
    centre = np.array(tuple(entity.dxf.center)[:2])
    points = centre + entity.dxf.radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return _unmirrored(entity, points, np.full(len(points), np.tan(sweep / 8.0)), closed)


def _unmirrored(entity: Any, points: Array, bulges: Array, closed: bool) -> _Pieces:
    """Pieces as seen from the front, where they are drawn on the back of the plane."""
    if entity.dxf.get("extrusion", (0, 0, 1))[2] < 0.0:
        return points * (-1.0, 1.0), -bulges, closed
    return points, bulges, closed


def _ellipse(entity: Any) -> _Pieces:
    start = entity.dxf.start_param
    sweep = (entity.dxf.end_param - start) % (2.0 * np.pi)
    closed = sweep < 1e-9 or sweep > 2.0 * np.pi - 1e-9
    sweep = 2.0 * np.pi if closed else sweep
    parameters = start + sweep * np.linspace(0.0, 1.0, 4 * LIMITS.chords + 1)
    points = np.array([tuple(p)[:2] for p in entity.vertices(parameters.tolist())])
    return points[:-1] if closed else points, np.zeros(len(points) - closed), closed


def _spline(entity: Any) -> _Pieces:
    try:
        curve = entity.construction_tool()
    except ZeroDivisionError:  # ezdxf's tangents at fit points whose distances are alike
        curve = _spline_through(entity.fit_points)
    spans = min(max(1, curve.count - curve.degree), 1000)
    points = np.array([tuple(p)[:2] for p in curve.approximate(spans * LIMITS.chords)])
    return points, np.zeros(len(points)), False


def _spline_through(points: Any) -> Any:
    """Spline by chord lengths through fit points."""
    from ezdxf.math import global_bspline_interpolation

    return global_bspline_interpolation(points, min(3, len(points) - 1), method="chord")


_READERS = {
    "LINE": _line,
    "LWPOLYLINE": _polyline,
    "POLYLINE": _polyline,
    "ARC": _arc,
    "CIRCLE": _circle,
    "ELLIPSE": _ellipse,
    "SPLINE": _spline,
}
