"""A second program for structures in space, which shares no geometry with the first.

It reads the tables of a scene, finds sides by convex hulls and contacts by common parts of the
points that lie in a separating plane, and builds equilibrium on its own. With Clarabel it asks what
can be carried, and holds a result against that:

    python3 -m tests.spatial.judge --seeds 0-149

Of the result it takes the places and areas of points, once it found each inside a contact of its
own and each corner of its contacts at one of them; the forces there; and the motions of blocks.
"""

from __future__ import annotations

import argparse
import logging
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import clarabel
import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csc_matrix, diags, identity, vstack
from scipy.spatial import ConvexHull
from shapely.geometry import MultiPoint, Point, box

Array = npt.NDArray[np.float64]

#: Points this near are in contact, in parts of the structure's size.
TOUCH = 1e-7
#: Common parts of sides narrower than this are none, in parts of the structure's size.
NARROW = 1e-5
#: Equilibrium and laws, in parts of the forces on a block.
FORCES = 1e-5
#: Closing of points in a mode, in parts of its largest relative motion.
CLOSING = 2e-5
#: Ends of programs agree, in parts of a load factor.
ENDS = 1e-5
#: What an upper end may be above the program's.
LOOSE = 1e-3
#: Rounds of given strengths by which a state of the dead load is looked for.
ROUNDS = 60
#: Strengths are those of the state's own pressures, in parts of the largest.
SETTLED = 1e-2
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
        shared = [self.on[:, a] & self.on[:, b] for a, b in combinations(range(len(self.levels)), 2)]
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
    points = np.array(next(table[kind] for kind in ("box", "hexahedron", "vertices") if kind in table))
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


class Programs:
    """What points of a case carry: programs for Clarabel.

    Unknowns are a load factor, forces of points along normal and tangents, tensions of bars. Forces
    are in parts of `unit`, moments in parts of it times the size.
    """

    def __init__(self, case: Case, points: Points, held: Sequence[int] = ()) -> None:
        self.case, self.points = case, points
        laws = np.array([contact.law for contact in case.contacts]).reshape(-1, 4)[points.contact]
        self.friction, cohesion, self.dilatancy, tensile = laws.T
        self.axes = np.array([c.place.axes for c in case.contacts])[points.contact]
        ends = np.array([(c.first, c.second) for c in case.contacts])[points.contact]
        self.ends = np.vstack([ends, *(bar[0] for bar in case.bars)])
        lines = [np.diff(bar[1], axis=0)[0] for bar in case.bars]
        self.lines = np.array([line / np.linalg.norm(line) for line in lines]).reshape(-1, 3)
        self.places = [np.vstack([points.place, *(bar[1][e] for bar in case.bars)]) for e in (0, 1)]
        self.moving = [k for k in case.moving if k not in held]
        self.unit = max(float(np.abs(case.dead[:, :3]).max()), 1e-300)
        self.push = max(float(np.abs(case.live[:, :3]).max()), 1e-300)
        self.cohesion = cohesion * points.area / self.unit
        self.tensile = tensile * points.area / self.unit
        self.yields = np.array([bar[2] for bar in case.bars]) / self.unit
        self.count = len(points.area)
        self.matrix = self._equilibrium()

    def _equilibrium(self) -> Any:
        """Forces of points and bars to those on bodies that move."""
        count, bars = self.count, len(self.lines)
        row = np.full(len(self.case.bodies) + 1, -1)
        row[self.moving] = np.arange(len(self.moving))
        unknown = np.repeat(np.arange(count), 3) * 3 + np.tile(np.arange(3), count)
        unit = np.repeat(np.arange(count + bars), [3] * count + [1] * bars)
        unknown = np.append(unknown, 3 * count + np.arange(bars))
        way = np.vstack([self.axes.reshape(-1, 3), -self.lines])  # on the second end
        parts = []
        centroid = np.array([*(body.centroid for body in self.case.bodies), np.zeros(3)])
        for end, sign in ((0, -1.0), (1, 1.0)):
            body = self.ends[unit, end]
            arm = (self.places[end][unit] - centroid[body]) / self.case.size
            values = sign * np.hstack([way, np.cross(arm, way)])
            acts = row[body] >= 0
            index = 6 * row[body][acts, None] + np.arange(6)
            column = np.broadcast_to(unknown[acts, None], index.shape)
            parts.append((values[acts].ravel(), index.ravel(), column.ravel()))
        value, index, column = (np.concatenate(part) for part in zip(*parts, strict=True))
        return coo_matrix((value, (index, column)), (6 * len(self.moving), 3 * count + bars)).tocsc()

    def relative(self, motion: Array) -> Array:
        """Motions of second ends against first ones, m, shape (points + bars, 3).

        Along normal and tangents of points; of bars, that along them is first.
        """
        centroid = np.array([*(body.centroid for body in self.case.bodies), np.zeros(3)])
        moved = np.zeros((len(self.ends), 3))
        for end, sign in ((0, -1.0), (1, 1.0)):
            body = self.ends[:, end]
            arm = self.places[end] - centroid[body]
            moved += sign * (motion[body, :3] + np.cross(motion[body, 3:], arm))
        count = self.count
        found = np.zeros_like(moved)
        found[:count] = np.einsum("pki,pi->pk", self.axes, moved[:count])
        found[count:, 0] = np.einsum("bi,bi->b", self.lines, moved[count:])
        return found

    def scaled(self, load: Array, unit: float) -> Array:
        """A load of the bodies that move in the program's units."""
        return (load[self.moving] / (unit * np.repeat([1.0, self.case.size], 3))).ravel()

    def most(
        self, dead: Array, live: Array, strength: Array, slope: Array, cap: float = np.inf
    ) -> float:
        """The largest load factor, in units of `unit / push`; nan where nothing is carried."""
        cost = np.zeros(1 + self.matrix.shape[1])
        cost[0] = -1.0
        found = self._solve(0.0 * cost, cost, dead, live, strength, slope, cap)
        return found if isinstance(found, float) else float(found[0])

    def elastic(self, strength: Array, slope: Array, offset: Array) -> Array | None:
        """Forces of least energy under the dead load; None where there are none."""
        area = np.maximum(self.points.area, 1e-3 * max(self.points.area.max(), 1e-300))
        softness = np.median(area) / area
        bars = np.full(len(self.lines), 2.5)
        energy = np.concatenate([[1.0], np.outer(softness, [1.0, 2.5, 2.5]).ravel(), bars])
        cost = np.append(0.0, offset)
        none = np.zeros(self.matrix.shape[0])
        dead = self.scaled(self.case.dead, self.unit)
        found = self._solve(energy, cost, dead, none, strength, slope, 1.0)
        return None if isinstance(found, float) else found[1:]

    def _solve(
        self,
        energy: Array,
        cost: Array,
        dead: Array,
        live: Array,
        strength: Array,
        slope: Array,
        cap: float,
    ) -> Array | float:
        """Minimum of a cost over forces inside the cones; nan or infinity where there is none."""
        count, size = self.count, len(cost)
        every = identity(size, format="csr")
        normal, first, second = (every[1 + k : 1 + 3 * count : 3] for k in range(3))
        bars = every[1 + 3 * count :]
        rows = [vstack([csc_matrix(live).reshape(1, -1), self.matrix.T]).T, -normal, -bars, bars]
        most = [-dead, self.tensile, np.zeros(bars.shape[0]), self.yields]
        if math.isfinite(cap):
            rows.append(every[:1])
            most.append(np.array([cap]))
        signs = sum(len(part) for part in most[1:])
        cones = [clarabel.ZeroConeT(len(dead)), clarabel.NonnegativeConeT(signs)]
        still = (slope <= 0.0) & (strength <= 1e-12)
        if still.any():
            rows += [first[still], second[still]]
            most.append(np.zeros(2 * int(still.sum())))
            cones.append(clarabel.ZeroConeT(2 * int(still.sum())))
        free = np.flatnonzero(~still)
        if len(free):
            order = np.arange(3 * len(free)).reshape(3, -1).T.ravel()
            disc = vstack([-diags(slope[free]) @ normal[free], -first[free], -second[free]]).tocsr()
            rows.append(disc[order])
            most.append((strength[free, None] * [1.0, 0.0, 0.0]).ravel())
            cones += [clarabel.SecondOrderConeT(3)] * len(free)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads, settings.max_iter = False, 1, 300
        for accuracy in (1e-10, 1e-8, 1e-6):
            for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
                setattr(settings, name, accuracy)
            found = clarabel.DefaultSolver(
                csc_matrix(diags(energy)), cost, csc_matrix(vstack(rows)), np.concatenate(most),
                cones, settings,
            ).solve()
            status = str(found.status)
            if status == "Solved":
                return np.array(found.x)
            if status in ("PrimalInfeasible", "DualInfeasible"):
                return np.nan if status == "PrimalInfeasible" else np.inf
        raise ArithmeticError(f"Clarabel: {status}")


@dataclass
class Verdict:
    """What is judged of one direction: what is wrong, or why there is no answer."""

    status: str
    load_factor: float
    wrong: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    none: str = ""

    @property
    def word(self) -> str:
        """In a word."""
        return "WRONG" if self.wrong else "none" if self.none else "right"


class Judge:
    """Judges the result of a scene's tables."""

    def __init__(self, tables: Mapping[str, Any], result: Any) -> None:
        self.case = case = Case(tables)
        self.structure = result.structure
        self.asked = tables.get("solve", {}).get("gap", 1e-3)
        points, self.unlike = case.points_of(self.structure)
        self.points = case.own_points() if np.any(points.contact < 0) else points
        self.alike = self.points is points
        self.programs = programs = Programs(case, self.points)
        self.dead = programs.scaled(case.dead, programs.unit)
        self.live = programs.scaled(case.live, programs.push)
        self.factor = programs.unit / programs.push
        self.known = {body.name: k for k, body in enumerate(case.bodies)}
        none = np.zeros_like(self.dead)
        laws = programs.cohesion, programs.friction
        self.falls = not programs.most(none, self.dead, *laws, cap=1.0) > 1.0 - 1e-6

    def has_state(self) -> bool:
        """Whether a state of the dead load is found in which each friction is of its own pressure.

        States of least energy with strengths given by the one before, from that of free dilatancy.
        """
        programs = Programs(self.case, self.case.own_points())
        offset = self._offset(programs)
        free = programs.friction - programs.dilatancy

        def own(force: Array) -> Array:
            pressed = np.maximum(force[: 3 * programs.count : 3], -programs.tensile)
            return programs.cohesion + free * pressed

        force = programs.elastic(programs.cohesion, programs.friction, offset)
        if force is None:
            return False
        given = own(force)
        step = 1.0
        for _ in range(ROUNDS):
            after = own(force)
            if np.abs(after - given).max() < SETTLED * max(1.0, float(given.max())) and step < 1.0:
                return True
            tried = given + step * (after - given)
            found = programs.elastic(tried, programs.dilatancy, offset)
            if found is None:
                step *= 0.5
            else:
                given, force = tried, found
                step = min(0.5, 2.0 * step)
            if step < 1e-4:
                break
        return False

    def _offset(self, programs: Programs) -> Array:
        """Cost of forces where the ground moves: its work, in a unit that is as good as any."""
        moved = np.zeros((len(self.case.bodies) + 1, 6))
        for name, table in self.case.tables["loads"].get("dead", {}).get("movement", {}).items():
            turn = np.radians(table.get("rotation", np.zeros(3)))
            moved[self.known[name]] = np.append(table.get("displacement", np.zeros(3)), turn)
        young = max(m.get("young", 5e9) for m in self.case.tables["materials"].values())
        moving = [self.case.bodies[k].volume for k in self.case.moving]
        stiffness = young * np.median(programs.points.area) / np.mean(moving) ** (1.0 / 3.0)
        motion = programs.relative(moved)
        count = 3 * programs.count
        bars = motion[programs.count :, 0]
        return np.append(motion[: programs.count].ravel()[:count], bars) * stiffness / programs.unit

    def judged(self, found: Any) -> Verdict:
        """What is wrong with the result of one direction."""
        verdict = Verdict(found.status, found.load_factor)
        self.sign = found.sign
        verdict.wrong += self.unlike
        if not self.alike:
            verdict.doubts.append("judged with own points")
        if self.case.doubtful:
            verdict.doubts.append(f"{len(self.case.doubtful)} meetings of edges")
        if found.status in ("unstable", "no_equilibrium"):
            self._judge_fall(found, verdict)
        elif found.status in ("limit", "unbounded"):
            if self.falls:
                verdict.wrong.append("the dead load is not carried")
                return verdict
            if not self.has_state():
                verdict.wrong.append("nothing presses what would carry the dead load")
            self._judge_end(found, verdict)
        else:
            verdict.none = found.reason or found.status
            if self.falls:
                verdict.doubts.append("the dead load is not carried")
            else:
                end = self._associative()
                verdict.doubts.append(f"stands {self.has_state()}, nothing above {end:.6g}")
        return verdict

    def _associative(self) -> float:
        """The largest load factor with slip normal to the cones, in the direction asked."""
        programs = self.programs
        laws = programs.cohesion, programs.friction
        return self.factor * programs.most(self.dead, self.sign * self.live, *laws)

    def _judge_fall(self, found: Any, verdict: Verdict) -> None:
        """It falls, and the others stand where those that fall are held."""
        if not self.falls:
            if self.has_state():
                verdict.wrong.append("it stands under its dead load")
            else:
                verdict.doubts.append("carried by forces that nothing presses")
            return
        held = [self.known[self.structure.blocks[k].name] for k in found.falling]
        rest = Programs(self.case, self.points, held)
        if held and rest.moving:
            dead = rest.scaled(self.case.dead, rest.unit)
            part = rest.most(0.0 * dead, dead, rest.cohesion, rest.friction, cap=1.0)
            if not part > 1.0 - 1e-6:
                verdict.wrong.append("more blocks fall than are named")

    def _judge_end(self, found: Any, verdict: Verdict) -> None:
        """Upper end, forces, mode and gap."""
        end = self._associative()
        if found.status == "unbounded":
            if math.isfinite(end):
                verdict.wrong.append(f"nothing above {end:.6g}")
            return
        factor = self.sign * found.load_factor
        size = max(abs(factor), 1e-2 * self.factor)
        upper = self.sign * found.upper if math.isfinite(found.upper) else np.inf
        if factor < -max(self.asked, found.gap) * size:
            verdict.wrong.append("the load factor has the wrong sign")
        if factor > end + (ENDS + found.gap) * size:
            verdict.wrong.append(f"above what anything carries, {end:.7g}")
        if upper < end - ENDS * size:
            verdict.wrong.append(f"upper end {upper:.7g} is below {end:.7g}")
        elif upper > end + LOOSE * max(abs(end), 1e-2 * self.factor):
            verdict.doubts.append(f"upper end {upper:.6g} for {end:.6g}")
        if not math.isfinite(end):
            verdict.doubts.append("blocks wedge: no load is excluded")
        if self.alike:
            verdict.wrong += self._forces(found)
            verdict.wrong += self._mode(found, size)

    def _forces(self, found: Any) -> Iterator[str]:
        """What forces miss of equilibrium and laws, in parts of the forces on their bodies."""
        case, programs, count = self.case, self.programs, self.programs.count
        turned = [self.known[self.structure.blocks[c.first].name] for c in self.structure.contacts]
        given = self.structure.points.contact
        sign = np.where(np.array(turned)[given] == programs.ends[:count, 0], 1.0, -1.0)
        vectors = np.einsum("pk,pki->pi", found.force, self.structure.axes[:count])
        local = np.einsum("pki,pi->pk", programs.axes, sign[:, None] * vectors) / programs.unit
        self.normal = local[:, 0]
        shear = np.linalg.norm(local[:, 1:], axis=1)
        tension = found.tension / programs.unit
        unknown = np.append(local.ravel(), tension)
        loads = self.dead + found.load_factor / self.factor * self.live
        missing = np.abs(programs.matrix @ unknown + loads).reshape(-1, 6).max(axis=1)
        works = np.append(np.linalg.norm(local, axis=1), np.abs(tension))
        around = np.zeros(len(case.bodies) + 1)
        for end in (0, 1):
            np.add.at(around, programs.ends[:, end], works)
        each = np.abs(self.dead) + np.abs(found.load_factor / self.factor * self.live)
        around[programs.moving] += each.reshape(-1, 6)[:, :3].max(axis=1)
        around[[k for k, body in enumerate(case.bodies) if body.fixed]] = np.inf
        least = around[programs.ends[:count]].min(axis=1)
        for name, miss in {
            "equilibrium": missing / around[programs.moving],
            "pressure": (-self.normal - programs.tensile) / least,
            "friction": (shear - programs.cohesion - programs.friction * self.normal) / least,
            "ties": np.maximum(-tension, tension - programs.yields),
        }.items():
            if miss.max(initial=0.0) > FORCES:
                yield f"{name} missed by {miss.max():.1e}"

    def _mode(self, found: Any, size: float) -> Iterator[str]:
        """What the mode misses, and what can be carried with the friction of the state's forces."""
        programs, count = self.programs, self.programs.count
        motion = np.zeros((len(self.case.bodies) + 1, 6))
        for block, moved in zip(self.structure.blocks, found.mode, strict=True):
            motion[self.known[block.name]] = moved
        relative = programs.relative(motion)
        slip = np.linalg.norm(relative[:count, 1:], axis=1)
        opening = relative[:count, 0] - programs.dilatancy * slip
        own = programs.cohesion
        pressed = np.maximum(self.normal, -programs.tensile)
        own = own + (programs.friction - programs.dilatancy) * pressed
        power = own @ slip + programs.tensile @ np.maximum(opening, 0.0)
        power += programs.yields @ np.maximum(relative[count:, 0], 0.0)
        power -= float(np.vdot(self.case.dead, motion[:-1])) / programs.unit
        work = self.sign * float(np.vdot(self.case.live, motion[:-1])) / programs.push
        if -opening.min() > CLOSING * np.abs(relative).max():
            yield f"the mode closes by {-opening.min() / np.abs(relative).max():.1e}"
        if not work > 0.0:
            yield "the live load does no work"
        factor = self.sign * found.load_factor
        if not abs(self.factor * power / work - factor) < (found.gap + 1e-4) * size:
            yield f"power over work is {self.sign * self.factor * power / work:.7g}"
        most = self.factor * programs.most(self.dead, self.sign * self.live, own, programs.dilatancy)
        if not (most - factor) / size < found.gap * (1.0 + LOOSE) + ENDS:
            yield f"gap {found.gap:.1e} for {(most - factor) / size:.1e}"
        if most < factor - ENDS * size:
            yield f"its friction carries {self.sign * most:.7g} only"


def judge(tables: Mapping[str, Any]) -> tuple[dict[str, Verdict], float]:
    """Solve a scene and judge its directions; and the seconds that the solve took."""
    from fenics_contact.errors import InputError
    from fenics_contact.spatial import Scene, limit_load

    start = time.perf_counter()
    try:
        result = limit_load(Scene.from_tables(tables, Path(".")))
    except InputError as error:
        return {"": Verdict("refused", np.nan, none=str(error))}, time.perf_counter() - start
    seconds = time.perf_counter() - start
    judging = Judge(tables, result)
    return {name: judging.judged(found) for name, found in result.ends.items()}, seconds


def main() -> None:
    """Judge structures by their seeds, and print a table."""
    from tests.spatial.random_structures import structure

    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", default="0-149", help="FIRST-LAST, or seeds with commas")
    seeds = parser.parse_args().seeds
    first, _, last = seeds.partition("-")
    chosen = range(int(first), int(last) + 1) if last else map(int, seeds.split(","))
    logging.disable(logging.WARNING)
    words: dict[str, int] = {}
    for seed in chosen:
        tables = structure(seed)
        start = time.perf_counter()
        try:
            found, seconds = judge(tables)
        except (ArithmeticError, AssertionError) as error:
            found, seconds = {"": Verdict("", np.nan, doubts=[f"not judged: {error}"])}, 0.0
        spent = time.perf_counter() - start - seconds
        for name, one in found.items():
            words[one.word] = words.get(one.word, 0) + 1
            told = "; ".join([*one.wrong, one.none, *(f"({doubt})" for doubt in one.doubts)])
            head = f"{seed:4d} {tables['title']:14s} {name[:3]:3s} {one.status:14s}"
            print(f"{head} {one.load_factor:12.6g} {one.word:5s} {seconds:5.1f} {spent:4.1f} {told}", flush=True)
    print(", ".join(f"{count} {word}" for word, count in sorted(words.items())))


if __name__ == "__main__":
    main()
