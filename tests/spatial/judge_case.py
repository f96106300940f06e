"""Scenes in space as bodies, contacts and loads, for the judge: no code of the program's own.

Sides are those of convex hulls. Two bodies meet where points of both lie in a plane that separates
them: in a polygon, a line or a point.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull
from shapely.geometry import MultiPoint, Point, box

Array = npt.NDArray[np.float64]

#: Points this near are in contact, in parts of the structure's size.
TOUCH = 1e-7
#: Common parts of sides narrower than this are none, in parts of the structure's size.
NARROW = 1e-5
CORNERS = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])


def plane_axes(normal: Array) -> Array:
    """A unit normal and two tangents, shape (3, 3)."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    return np.array([normal, across, np.cross(normal, across)])


def unlike(vectors: Array, near: float = 1e-7) -> Array:
    """Vectors without those that are near to one before them."""
    kept: list[Array] = []
    for vector in vectors:
        if all(np.abs(vector - other).max() > near for other in kept):
            kept.append(vector)
    return np.array(kept).reshape(-1, vectors.shape[1])


class Piece:
    """A convex body: the hull of points."""

    def __init__(self, points: Array) -> None:
        middle = points.mean(axis=0)
        hull = ConvexHull(points - middle)
        self.points = points[hull.vertices]
        self.extent = self.points.min(axis=0), self.points.max(axis=0)
        size = float(np.ptp(self.points, axis=0).max())
        planes = unlike(hull.equations / [1.0, 1.0, 1.0, size])
        self.normals = planes[:, :3]
        self.levels = self.normals @ middle - size * planes[:, 3]
        self.on = np.abs(self.points @ self.normals.T - self.levels) < 1e-7 * size
        corners = (points - middle)[hull.simplices]
        volumes = np.abs(np.linalg.det(corners)) / 6.0  # the origin is inside
        self.volume = float(volumes.sum())
        self.centroid = middle + volumes @ corners.sum(axis=1) / 4.0 / self.volume

    @property
    def edges(self) -> Array:
        """Directions of edges, shape (edges, 3)."""
        shared = [
            self.on[:, a] & self.on[:, b] for a, b in combinations(range(len(self.levels)), 2)
        ]
        ends = [self.points[both] for both in shared if both.sum() == 2]
        return np.array([(b - a) / np.linalg.norm(b - a) for a, b in ends])

    def side(self, number: int) -> tuple[float, Array]:
        """Area and centroid of a side."""
        axes = plane_axes(self.normals[number])
        flat = MultiPoint(self.points[self.on[:, number]] @ axes[1:].T).convex_hull
        x, y = flat.centroid.coords[0]
        return flat.area, self.levels[number] * axes[0] + x * axes[1] + y * axes[2]


class Meeting(NamedTuple):
    """Where two bodies meet: a polygon, a line or a point, with its normal from the first."""

    axes: Array
    level: float
    shape: Any
    sure: bool

    @property
    def flat(self) -> list[Any]:
        """Its extreme points in its plane."""
        outline = self.shape.exterior.coords[:-1] if self.shape.area else self.shape.coords
        return [Point(place) for place in outline]

    @property
    def corners(self) -> Array:
        """Its extreme points, shape (corners, 3)."""
        flat = np.array([(place.x, place.y) for place in self.flat])
        return self.level * self.axes[0] + flat @ self.axes[1:]

    def has(self, points: Array, near: float) -> bool:
        """Whether points lie in it."""
        height = np.abs(points @ self.axes[0] - self.level).max()
        flat = (Point(place) for place in points @ self.axes[1:].T)
        return height < near and max(self.shape.distance(place) for place in flat) < near


def flat_part(points: Array, axes: Array, level: float, near: float) -> Any:
    """Hull of the points in a plane, along its tangents."""
    in_plane = points[np.abs(points @ axes[0] - level) <= 2.0 * near]
    return MultiPoint(in_plane @ axes[1:].T).convex_hull


def meeting(one: Piece, two: Piece, size: float) -> Meeting | None:
    """Where two bodies touch; None if they are apart.

    It is sure where only one plane separates them: where the middle of the common part is inside a
    side of one of them, or two edges cross. Where edges or corners meet edges, no normal is given.
    """
    near = TOUCH * size
    if np.any(
        np.maximum(one.extent[0], two.extent[0]) > near + np.minimum(one.extent[1], two.extent[1])
    ):
        return None
    ways = np.vstack([one.normals, -two.normals])
    gap = (two.points @ ways.T).min(axis=0) - (one.points @ ways.T).max(axis=0)
    if gap.max() > near:
        return None
    if gap.max() < -near:
        ways = np.cross(one.edges[:, None], two.edges).reshape(-1, 3)
        length = np.linalg.norm(ways, axis=1)
        ways = ways[length > 1e-6] / length[length > 1e-6, None]
        ways = np.vstack([ways, -ways])
        gap = (two.points @ ways.T).min(axis=0) - (one.points @ ways.T).max(axis=0)
        assert gap.max() > -near, "bodies overlap"
        if gap.max() > near:
            return None
    found: Meeting | None = None
    for way in unlike(ways[np.abs(gap) <= near], 1e-6):
        axes = plane_axes(way)
        level = float((one.points @ way).max())
        both = [flat_part(part.points, axes, level, near) for part in (one, two)]
        common = both[0].intersection(both[1])
        if common.is_empty or common.geom_type == "MultiPoint":
            continue
        if common.area > NARROW * size * max(common.length, NARROW * size):
            return Meeting(axes, level, common, True)
        if common.geom_type == "Polygon":
            continue
        inner = [part.buffer(-10.0 * near) for part in both]
        middle = common.centroid
        sure = any(part.contains(middle) for part in inner)
        if all(part.geom_type == "LineString" for part in both) and common.geom_type == "Point":
            ends = [Point(end) for part in both for end in part.coords]
            sure = min(end.distance(middle) for end in ends) > 10.0 * near
        if found is None or sure > found.sure:
            found = Meeting(axes, level, common, sure)
    return found


class Law(NamedTuple):
    """Coulomb's law of a contact: F, cohesion, tangent of dilatancy, tensile strength."""

    friction: float
    cohesion: float
    dilatancy: float
    tensile: float

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> Law:
        """From a table of joints or foundations."""
        assert not {"compressive_strength", "glued"} & set(table), "not judged"
        slope = math.tan(math.radians(table.get("dilatancy", 0.0)))
        shear = table.get("cohesion", 0.0) + table.get("bound", 0.0)
        return cls(table.get("friction", 0.0), shear, slope, table.get("tensile_strength", 0.0))


@dataclass
class Body:
    """A block, or ground."""

    name: str
    group: str
    fixed: bool
    pieces: list[Piece]

    def __post_init__(self) -> None:
        volumes = np.array([piece.volume for piece in self.pieces])
        self.volume = float(volumes.sum())
        self.centroid = volumes @ [piece.centroid for piece in self.pieces] / self.volume


@dataclass
class Contact:
    """A meeting of two bodies and its law."""

    first: int
    second: int
    place: Meeting
    law: Law


@dataclass
class Points:
    """Where contacts carry forces: places, areas, numbers of contacts."""

    place: Array
    area: Array
    contact: npt.NDArray[np.int64]


class Weight(NamedTuple):
    """Of a floor on a body, N; whether the live load pushes its mass."""

    body: int
    place: Array
    weight: float
    mass: bool


def pieces_of(table: Mapping[str, Any]) -> list[Piece]:
    """Convex bodies of a block's table."""
    if "pieces" in table:
        return [piece for part in table["pieces"] for piece in pieces_of(part)]
    points = np.array(
        next(table[kind] for kind in ("box", "hexahedron", "vertices") if kind in table)
    )
    if "box" in table:
        points = np.where(CORNERS, points.max(axis=0), points.min(axis=0))
    return [Piece(points.astype(float))]


class Case:
    """A scene's tables as bodies, contacts and loads."""

    def __init__(self, tables: Mapping[str, Any]) -> None:
        self.tables = tables
        self.bodies = [
            Body(name, table.get("group", "default"), table.get("fixed", False), pieces_of(table))
            for name, table in tables["blocks"].items()
        ]
        moving = [body for body in self.bodies if not body.fixed]
        every = np.vstack([piece.points for body in moving for piece in body.pieces])
        self.size = float(np.ptp(every, axis=0).max())
        self.bodies += self._ground(every)
        self.moving = [k for k, body in enumerate(self.bodies) if not body.fixed]
        self.doubtful: list[tuple[str, str]] = []
        self.contacts = list(self._contacts())
        self.floors: list[Weight] = []
        for floor in tables.get("floors", {}).values():
            self.floors += self._floor(floor)
        loads = tables["loads"]
        self.dead = self._load(loads.get("dead", {}), dead=True)
        self.live = self._load(loads["live"], dead=False)
        self.bars = [self._bar(tie) for tie in tables.get("ties", {}).values()]

    def _ground(self, every: Array) -> Iterator[Body]:
        """Slabs below foundations, or below the lowest point along the weight."""
        given = dict(self.tables.get("foundations", {}))
        if not given and not any(body.fixed for body in self.bodies):
            given = {"ground": {}}
        weight = np.array(self.tables["loads"].get("dead", {}).get("body", (0.0, 0.0, -1.0)))
        for name, table in given.items():
            up = -weight / np.linalg.norm(weight)
            level = float((every @ up).min())
            if "plane" in table:
                up = np.array(table["plane"].get("normal", (0.0, 0.0, 1.0)), dtype=float)
                up /= np.linalg.norm(up)
                level = float(up @ np.array(table["plane"]["point"]))
            level = table.get("z", level)
            flat = (every @ plane_axes(up)[1:].T).mean(axis=0)
            reach = self.size * np.array([1.0, 4.0, 4.0])
            middle = np.array([level - 0.5 * reach[0], *flat])
            points = (middle + (CORNERS - 0.5) * reach) @ plane_axes(up)
            yield Body(name, f"foundations.{name}", True, [Piece(points)])

    def _contacts(self) -> Iterator[Contact]:
        for (a, one), (b, two) in combinations(enumerate(self.bodies), 2):
            if one.fixed and two.fixed:
                continue
            law = self._law(one, two)
            for first in one.pieces:
                for second in two.pieces:
                    place = meeting(first, second, self.size)
                    if place and not place.sure:
                        self.doubtful.append((one.name, two.name))
                    elif place and law is not None:
                        yield Contact(a, b, place, law)

    def _law(self, one: Body, two: Body) -> Law | None:
        """Ground's own law, that of a pair, or the default one; None if it is off."""
        joints = self.tables.get("joints", {})
        for body in (one, two):
            if body.group.startswith("foundations.") and "foundations" in self.tables:
                return Law.of(self.tables["foundations"][body.name])
        for name, table in joints.items():
            ends = set(table.get("between", (name,)))
            pairs = [{p, q} for p in (one.name, one.group) for q in (two.name, two.group)]
            if name != "default" and ends in pairs:
                return None if table.get("off") else Law.of(table)
        return None if joints["default"].get("off") else Law.of(joints["default"])

    def _sides(self, table: Mapping[str, Any]) -> Iterator[tuple[int, float, Array, Piece, int]]:
        """Bodies, areas, centroids, pieces and numbers of sides that a table names."""
        for number, body in enumerate(self.bodies[: len(self.tables["blocks"])]):
            if table.get("group", body.group) != body.group:
                continue
            if table.get("block", body.name) != body.name:
                continue
            for piece in body.pieces:
                for k, normal in enumerate(piece.normals):
                    wished = np.array(table.get("normal", normal), dtype=float)
                    if normal @ wished / np.linalg.norm(wished) < math.cos(math.radians(1.0)):
                        continue
                    if "point" in table:
                        away = normal @ np.array(table["point"]) - piece.levels[k]
                        if abs(away) > 1e-5 * self.size:
                            continue
                    yield number, *piece.side(k), piece, k

    def _floor(self, table: Mapping[str, Any]) -> list[Weight]:
        """Weights of a floor: by the areas of top sides within its plan."""
        tops = {"normal": (0.0, 0.0, 1.0), "point": (0.0, 0.0, table["z"])}
        if "group" in table:
            tops["group"] = table["group"]
        flats = [
            (number, MultiPoint(piece.points[piece.on[:, k]][:, :2]).convex_hull)
            for number, _, _, piece, k in self._sides(tops)
        ]
        corners = np.array([flat.bounds for _, flat in flats])
        x0, y0 = corners[:, :2].min(axis=0)
        x1, y1 = corners[:, 2:].max(axis=0)
        (x0, x1), (y0, y1) = table.get("x", (x0, x1)), table.get("y", (y0, y1))
        plan = box(x0, y0, x1, y1)
        parts = [(number, flat.intersection(plan)) for number, flat in flats]
        parts = [(number, part) for number, part in parts if part.area > 0.0]
        share = table["force"] * plan.area / sum(part.area for _, part in parts)
        mass = bool(table.get("mass", False))
        return [
            Weight(k, np.array([*part.centroid.coords[0], table["z"]]), share * part.area, mass)
            for k, part in parts
        ]

    def _load(self, table: Mapping[str, Any], dead: bool) -> Array:
        """Forces and moments about centroids, shape (bodies, 6)."""
        assert table.get("profile", "uniform") == "uniform", "not judged"
        found = np.zeros((len(self.bodies), 6))

        def add(number: int, place: Array, force: Array) -> None:
            found[number, :3] += force
            found[number, 3:] += np.cross(place - self.bodies[number].centroid, force)

        way = np.array(table.get("body", (0.0, 0.0, 0.0)), dtype=float)
        if "direction" in table:
            way = np.array(table["direction"], dtype=float)
            way *= 9.81 / np.linalg.norm(way)
        materials = self.tables["materials"]
        for number in self.moving:
            body = self.bodies[number]
            density = materials.get(body.group, materials.get("default", {})).get("density", 0.0)
            add(number, body.centroid, density * body.volume * way)
        for floor in self.floors:
            if dead:
                add(floor.body, floor.place, np.array([0.0, 0.0, -floor.weight]))
            elif floor.mass:
                add(floor.body, floor.place, floor.weight / 9.81 * way)
        for name, pressure in table.get("traction", {}).items():
            for number, area, centre, *_ in self._sides(self.tables["sides"][name]):
                add(number, centre, area * np.array(pressure))
        for force in table.get("force", {}).values():
            vector = np.array(force["force"], dtype=float)
            if "sides" in force:
                sides = list(self._sides(self.tables["sides"][force["sides"]]))
                for number, area, centre, *_ in sides:
                    add(number, centre, area / sum(side[1] for side in sides) * vector)
                continue
            number = self._at(force["at"]) if "block" not in force else self._named(force["block"])
            add(number, np.array(force.get("at", self.bodies[number].centroid)), vector)
        found[[body.fixed for body in self.bodies]] = 0.0
        return found

    def _named(self, name: str) -> int:
        return next(k for k, body in enumerate(self.bodies) if body.name == name)

    def _at(self, place: Sequence[float]) -> int:
        """The block at a place."""
        return next(
            number
            for number, body in enumerate(self.bodies)
            for piece in body.pieces
            if np.all(piece.normals @ np.array(place) - piece.levels <= 1e-5 * self.size)
        )

    def _bar(self, tie: Mapping[str, Any]) -> tuple[tuple[int, int], Array, float]:
        """Numbers of the bodies at its ends, -1 for ground; the ends; the yield."""
        first = self._at(tie["from"])
        second = self._at(tie["to"]) if "to" in tie else -1
        ends = np.array([tie["from"], tie.get("to", tie.get("ground"))], dtype=float)
        return (first, second), ends, tie["yield"]

    def own_points(self) -> Points:
        """Corners of contacts, which share the area."""
        corners = [contact.place.corners for contact in self.contacts]
        count = [len(some) for some in corners]
        area = [contact.place.shape.area for contact in self.contacts]
        number = np.repeat(np.arange(len(corners)), count)
        return Points(np.vstack(corners), np.repeat(np.divide(area, count), count), number)

    def points_of(self, structure: Any) -> tuple[Points, list[str]]:
        """Points of a result, each inside a contact found here; and what does not fit."""
        given = structure.points
        known = {body.name: number for number, body in enumerate(self.bodies)}
        number = np.full(len(given.area), -1)
        near = 100.0 * TOUCH * self.size
        wrong = []
        for k, contact in enumerate(structure.contacts):
            mine = given.contact == k
            names = [structure.blocks[end].name for end in (contact.first, contact.second)]
            ends = [known[name] for name in names]
            for n, other in enumerate(self.contacts):
                along = other.place.axes[0] @ contact.axes[0]
                same = {other.first, other.second} == set(ends) and 1.0 - abs(along) < 1e-9
                if same and other.place.has(given.position[mine], near):
                    number[mine] = n
            if np.any(number[mine] < 0):
                wrong.append(f"contact {names[0]}-{names[1]} is none")
        for n, other in enumerate(self.contacts):
            mine = number == n
            names = [self.bodies[end].name for end in (other.first, other.second)]
            what = f"{other.place.shape.geom_type} {names[0]}-{names[1]}"
            area = other.place.shape.area
            if not np.any(mine):
                wrong.append(f"{what} carries nothing")
            elif abs(given.area[mine].sum() - area) > 1e-6 * self.size**2:
                wrong.append(f"{what} has area {given.area[mine].sum():.4g} for {area:.4g}")
            else:
                hull = MultiPoint(given.position[mine] @ other.place.axes[1:].T).convex_hull
                if max(hull.distance(corner) for corner in other.place.flat) > near:
                    wrong.append(f"{what} has a corner beyond all points")
        return Points(given.position, given.area, number), wrong
