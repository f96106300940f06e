"""Forces and moments of rigid blocks, of the loads and floors that a scene gives them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from fenics_contact.errors import InputError, Vector, require
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.results.bounds import counted
from fenics_contact.scene.rules import Checked, listed, require_vector, ruled
from fenics_contact.scene.scene import DIRECTION, GRAVITY, Floor, Force, Load, Movement
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.contacts import clipped, polygon_area
from fenics_contact.spatial.points import polygon_centroid
from fenics_contact.spatial.polyhedra import Block, Polyhedron

#: Cosine of the largest angle between a side and the direction by which it is chosen: 1 degree.
SAME_DIRECTION = 0.99985
#: Distance from a plane or a block that is rounding, in parts of a typical block's size.
NEAR = 1e-5
#: From the front of a prism to its back.
MIRRORED = np.array([1.0, -1.0, 1.0])
#: Upwards, and where the places (x, y) of the plane are in space.
UP = np.array([0.0, 0.0, 1.0])
#: Places and weight in a tetrahedron that integrate quadratic functions.
FAR, CLOSE = 0.1381966011250105, 0.5854101966249685


def lifted(vector: Vector) -> Array:
    """A place or direction in space; that of the plane, (x, y), is (x, 0, y)."""
    x, *others = vector
    return np.array([x, *others] if len(vector) == 3 else [x, 0.0, *others], dtype=float)


def motion_of(movement: Movement) -> Array:
    """Displacement and rotation, m and rad, shape (6,); anticlockwise is about -y."""
    turn = movement.rotation
    about = turn if isinstance(turn, tuple) else (0.0, -turn, 0.0)
    return np.append(lifted(movement.displacement), np.radians(about))


def factors_of(load: Load, height: Array, mass: Array) -> Array:
    """Factors of the profile of a load at heights, m, of masses."""
    if load.profile == "uniform":
        return np.ones(len(height))
    if isinstance(load.profile, str):
        return np.asarray(height * mass.sum() / (height @ mass))
    heights, factors = np.transpose(load.profile)
    return np.interp(height, heights, factors)


@dataclass(frozen=True)
class Sides(Checked):
    """Sides of blocks: those of which all holds that is given.

    Attributes:
        group: They are of blocks of this group.
        block: They are of this block.
        normal: They look this way, within one degree.
        point: This point lies in their plane.
        lines: In the plane: they, or parts of them, lie on one of these lines between two places.
    """

    group: str | None = None
    block: str | None = None
    normal: Vector | None = ruled(DIRECTION, None)
    point: Vector | None = ruled(require_vector, None)
    lines: tuple[tuple[Vector, Vector], ...] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        given = any(value not in (None, ()) for value in vars(self).values())
        require(given, "no side is named: give group, block, normal, point or lines")

    def of(self, blocks: Sequence[Block], near: float) -> Iterator[tuple[int, Array]]:
        """Numbers of blocks, and corners of their sides, m, shape (corners, 3)."""
        for number, block in enumerate(blocks):
            if self.group not in (None, block.group) or self.block not in (None, block.name):
                continue
            for piece in block.pieces:
                chosen = np.ones(len(piece.sides), dtype=bool)
                if self.normal is not None:
                    wished = lifted(self.normal) / np.linalg.norm(self.normal)
                    chosen &= piece.normals @ wished >= SAME_DIRECTION
                if self.point is not None:
                    height = piece.normals @ lifted(self.point) - piece.levels
                    chosen &= np.abs(height) <= near
                for side in np.flatnonzero(chosen):
                    corners = piece.corners[list(piece.sides[side])]
                    parts = [corners] if self.lines is None else self._stretches(corners, near)
                    yield from ((number, part) for part in parts)

    def _stretches(self, corners: Array, near: float) -> Iterator[Array]:
        """Parts of a side of a prism, a metre deep, that lie on the lines."""
        front = corners[corners[:, 1] < 0.0]
        if len(front) != 2:
            return
        start = front[0]
        for places in self.lines or ():
            line = np.array([lifted(place) for place in places]) - start * [1.0, 0.0, 1.0]
            length = float(np.linalg.norm(front[1] - start))
            along = (front[1] - start) / length
            low, high = np.clip(np.sort(line @ along), 0.0, length)
            if np.abs(np.cross(line, along)).max() <= near and high - low > near:
                low, high = start + low * along, start + high * along
                yield np.array([low, high, high * MIRRORED, low * MIRRORED])


@dataclass(frozen=True)
class Acting:
    """Forces at places of blocks.

    Attributes:
        block: Number of the block, shape (forces,).
        place: m, shape (forces, 3).
        force: N, shape (forces, 3).
        on: What they act on, in words; empty for body forces.
        sides: Corners of the sides over which each is spread, m; none where they act at places.
        around: How far each reaches around its place, m, shape (forces, 3).
    """

    block: Indices
    place: Array
    force: Array
    on: str
    sides: Sequence[Array] = ()
    around: Array | float = 0.0


@dataclass(frozen=True)
class Masses:
    """Point masses that move with blocks.

    Attributes:
        block: Number of the block, shape (masses,).
        position: m, shape (masses, 3).
        mass: kg.
    """

    block: Indices
    position: Array
    mass: Array

    @classmethod
    def of_blocks(cls, blocks: Sequence[Block], density: Mapping[int, float]) -> Masses:
        """Points in the blocks of some numbers, whose sums are integrals of quadratic functions."""
        rule_of_four = np.full((4, 4), FAR) + (CLOSE - FAR) * np.eye(4)
        corners = [_tetrahedra(blocks[number]) for number in density]
        count = [len(part) for part in corners]
        every = np.concatenate(corners)
        edges = every[:, 1:] - every[:, :1]
        mass = np.repeat(list(density.values()), count) * np.linalg.det(edges) / 24.0
        number = np.repeat(list(density), count)
        points = np.einsum("pk,tkd->tpd", rule_of_four, every).reshape(-1, 3)
        return cls(np.repeat(number, 4), points, np.repeat(mass, 4))

    def with_(self, *others: Masses) -> Masses:
        """These and others."""
        every = zip(*(vars(one).values() for one in (self, *others)), strict=True)
        return Masses(*(np.concatenate(parts) for parts in every))

    def acting(self, acceleration: Array, factors: Array | float = 1.0, on: str = "") -> Acting:
        """Forces of weight or inertia."""
        return Acting(self.block, self.position, np.outer(self.mass * factors, acceleration), on)


def masses_of_floor(
    key: str, floor: Floor, blocks: Sequence[Block], near: float
) -> tuple[Masses, Acting]:
    """Mass of a floor on the blocks that carry it, and its thrust, with on what it lies.

    Its plan is `x` by `y`, by default the rectangle around the top sides at its height.
    """
    height = floor.height or 0.0
    at = f"{floor.axis} = {height:g}"
    tops = Sides(floor.group, normal=(0.0, 0.0, 1.0), point=(0.0, 0.0, height))
    found = list(tops.of(blocks, near))
    other = replace(tops, point=None).of(blocks, near)
    levels = {round(float(loop[0, 2]), 6) for _, loop in other}
    nearest = sorted(levels, key=lambda level: abs(level - height))[:4]
    text = f"{key}: no block has a top side at {at}; the nearest are at {sorted(nearest)} m"
    require(bool(found), text)
    corners = np.vstack([loop[:, :2] for _, loop in found])
    low = corners.min(axis=0)
    high = corners.max(axis=0)
    for axis, wished in enumerate((floor.x, floor.y)):
        if isinstance(wished, tuple):
            low[axis], high[axis] = wished
    plan = _rectangle(low, high)
    parts = [(number, clipped(loop[:, :2], plan)) for number, loop in found]
    parts = [(number, part) for number, part in parts if len(part)]
    more = " and y" * (floor.axis == "z")
    there = reach_told(corners[:, : 1 + bool(more)])
    require(bool(parts), f"{key}: no top side at {at} lies within x{more}; {there}")
    area = np.array([polygon_area(part) for _, part in parts])
    told = sides_told(area.tolist())
    if floor.span:
        parts, area = _along_span(key, parts, (low, high), "xy".index(floor.span), near)
    mass = floor.force * polygon_area(plan) / GRAVITY * area / area.sum()
    places = [[*polygon_centroid(part), height] for _, part in parts]
    masses = Masses(np.array([number for number, _ in parts]), np.array(places), mass)
    thrust = np.append(floor.thrust or 0.0, [0.0, 0.0])[:3]
    pushes = np.outer(area / area.sum(), thrust * [*(high - low)[::-1], 0.0])
    sides_of = [np.insert(part, 2, height, axis=1) for _, part in parts]
    return masses, Acting(masses.block, masses.position, pushes, told, sides_of)


def _rectangle(low: Array, high: Array) -> Array:
    """Corners of a rectangle in plan between its lowest and its highest one, anticlockwise."""
    return np.where([[0, 0], [1, 0], [1, 1], [0, 1]], high, low)


def _along_span(
    key: str, tops: Sequence[tuple[int, Array]], ends: Sequence[Array], axis: int, near: float
) -> tuple[list[tuple[int, Array]], Array]:
    """Parts of top sides with their blocks, and the area of a floor that lies on each, m2.

    The plan is cut along the span at all corners of tops. A strip with walls at both of its ends
    lies on all of its walls: on each from the middle of the gap before to that of the gap behind.
    Strips without, as at windows, are carried by those that span, in proportion.

    Args:
        key: Of the floor.
        tops: Numbers of blocks, and corners of their top sides in plan, m.
        ends: Lowest and highest corner of the plan, m.
        axis: Number of that along which the floor spans.
        near: Distance that is rounding, m.
    """
    low, high = (float(corner[axis]) for corner in ends)
    found: list[tuple[int, Array]] = []
    areas: list[float] = []
    spans: list[bool] = []
    cuts = np.unique(np.concatenate([top[:, 1 - axis] for _, top in tops]))
    for sides in pairwise(cuts[np.diff(cuts, prepend=-np.inf) > near]):
        corners = np.array(ends)
        corners[:, 1 - axis] = sides
        strip = _rectangle(*corners)
        cut = ((number, clipped(top, strip)) for number, top in tops)
        parts = [(number, part) for number, part in cut if len(part)]
        parts.sort(key=lambda part: float(part[1][:, axis].min()))
        start = np.array([part[:, axis].min() for _, part in parts])
        reach = np.maximum.accumulate([part[:, axis].max() for _, part in parts])
        if not parts or start[0] > low + near or reach[-1] < high - near:
            continue
        gaps = np.flatnonzero(start[1:] > reach[:-1] + near)
        middles = [low, *(0.5 * (reach[gaps] + start[gaps + 1])), high]
        wall = np.searchsorted(gaps, np.arange(len(parts)))
        area = np.array([polygon_area(part) for _, part in parts])
        width = np.diff(middles) * np.diff(sides) / np.bincount(wall, area)
        found += parts
        areas += (width[wall] * area).tolist()
        spans += [len(gaps) > 0] * len(parts)
    name = "xy"[axis]
    text = f"no wall is at both ends, {name} = {low:g} and {high:g}; give {name} from wall to wall"
    require(any(spans), f"{key}.span: {text}")
    area = np.array(areas)
    area[spans] *= (np.prod(np.subtract(*ends)) - area[~np.array(spans)].sum()) / area[spans].sum()
    return found, area


def _fan(corners: Array) -> Array:
    """Triangles of a convex polygon in space, shape (triangles, 3, 3)."""
    first = np.broadcast_to(corners[0], corners[2:].shape)
    return np.stack([first, corners[1:-1], corners[2:]], axis=1)


def _tetrahedra(block: Block) -> Array:
    """Tetrahedra of a block's pieces, each on an inner point, shape (tetrahedra, 4, 3)."""
    corners = []
    for piece in block.pieces:
        outer = np.concatenate([_fan(piece.corners[list(side)]) for side in piece.sides])
        inner = np.broadcast_to(piece.centroid, (len(outer), 1, 3))
        corners.append(np.concatenate([inner, outer], axis=1))
    return np.concatenate(corners)


def total(key: str, blocks: Sequence[Block], acting: Mapping[str, Acting]) -> Array:
    """Forces and moments about the centroids, N and N m, shape (blocks, 6), of forces at places.

    Raises:
        InputError: If they cancel on every block that moves.
    """
    loads = np.zeros((len(blocks), 6))
    given = np.zeros(len(blocks))
    centroid = np.array([block.centroid for block in blocks])
    for one in acting.values():
        np.add.at(loads[:, :3], one.block, one.force)
        arm = one.place - centroid[one.block]
        np.add.at(loads[:, 3:], one.block, np.cross(arm, one.force))
        np.add.at(given, one.block, np.linalg.norm(one.force, axis=1))
    size = np.cbrt([block.volume for block in blocks])
    left = np.linalg.norm(loads[:, :3], axis=1) + np.linalg.norm(loads[:, 3:], axis=1) / size
    pushed = np.array([not block.fixed for block in blocks]) & (given > 0.0)
    if np.any(pushed) and np.all(left[pushed] <= SEARCH.digits * given[pushed]):
        parts = "; ".join(f"{name} on {one.on}" for name, one in acting.items() if one.on)
        raise InputError(f"{key}: what is given cancels on every block: {parts or 'its profile'}")
    return loads


def surface_loads(
    key: str, load: Load, blocks: Sequence[Block], sides: Mapping[str, Sides], near: float
) -> Iterator[tuple[str, Acting]]:
    """Tractions and forces, by their keys."""
    given = {f"{key}.traction.{n}": (n, lifted(t), True) for n, t in load.traction.items()}
    for name, force in load.force.items():
        vector = lifted(force.force)
        place = f"{key}.force.{name}"
        if force.sides is not None:
            given[place] = (force.sides, vector, False)
        elif force.x is not None:
            yield place, _from_above(place, force, blocks, near)
        else:
            number = numbered(place, blocks, force.block, force.at, near)
            at = blocks[number].centroid if force.at is None else lifted(force.at)
            on = f"block {blocks[number].name}"
            yield place, Acting(np.array([number]), at[None], vector[None], on)
    for place, (name, vector, per_area) in given.items():
        require(name in sides, f"{place}: there is no [sides.{name}]; it has {listed(sides)}")
        found = list(sides[name].of(blocks, near))
        require(bool(found), f"{place}: no side of a block is as [sides.{name}] says")
        areas, centres = zip(*(middle_of(corners) for _, corners in found), strict=True)
        share = np.array(areas) / (1.0 if per_area else sum(areas))
        numbers = np.array([block for block, _ in found])
        forces = np.outer(share, vector)
        sides_of = [corners for _, corners in found]
        yield place, Acting(numbers, np.array(centres), forces, sides_told(areas), sides_of)


def inside_of(loop: Array, piece: Polyhedron, near: float) -> Array:
    """Part of a plane loop inside of a convex body, or on a side of it."""
    for normal, level in zip(piece.normals, piece.levels, strict=True):
        height = loop @ normal - level
        if np.abs(height).max(initial=0.0) <= near:  # the loop lies in this side
            continue
        kept = []
        for k, high in enumerate(height):
            before = height[k - 1]
            if before * high < 0.0:
                kept.append(loop[k - 1] + before / (before - high) * (loop[k] - loop[k - 1]))
            if high <= 0.0:
                kept.append(loop[k])
        loop = np.array(kept).reshape(-1, 3)
    return loop


def _from_above(key: str, force: Force, blocks: Sequence[Block], near: float) -> Acting:
    """A force on the highest side at its place, or those of a train's axles."""
    text = f"{key}.y: the highest side at x is meant; give either x alone, or at"
    require(force.y is None or len(force.force) == 3, text)
    first, y = float(force.x or 0.0), force.y or 0.0
    width = np.append(force.width or 0.0, 0.0)[:2]
    corners = np.vstack([p.corners for b in blocks if not b.fixed for p in b.pieces])
    axles = [
        (number, place, part * share, around)
        for behind, part in force.axles or ((0.0, 1.0),)
        for at, share, around in _spread((first - behind, y), width, corners, near)
        for number, place in _top_at(at, blocks, near)
    ]
    there = reach_told(corners[:, : len(force.force) - 1])
    whole = sum(part for _, _, part, _ in axles) > 1.0 - SEARCH.digits
    text = f"{key}: there is no block above or below ({first:g}, {y:g}), or a part of its width"
    require(whole or bool(force.axles and axles), f"{text}; {there}")
    numbers, places, parts, around = zip(*axles, strict=True)
    told = "block " + ", ".join(blocks[number].name for number in dict.fromkeys(numbers))
    forces = np.outer(parts, lifted(force.force))
    return Acting(np.array(numbers), np.array(places), forces, told, around=np.array(around))


def _spread(
    place: Sequence[float], width: Array, corners: Array, near: float
) -> Iterator[tuple[Array, float, Array]]:
    """Middles of parts of a rectangle around a place, cut at corners of blocks, shares and reach.

    The first moment of the shares about the place is zero.
    """
    sides = []
    for middle, across, cuts in zip(place, width, corners.T, strict=False):
        ends = middle + across * np.array([-0.5, 0.5])
        inside = np.unique(cuts[(cuts > ends[0] + near) & (cuts < ends[1] - near)])
        edges = np.insert(ends, 1, inside[np.diff(inside, prepend=-np.inf) > near])
        shares = np.diff(edges) / across if across else [1.0]
        sides.append(list(zip(0.5 * (edges[1:] + edges[:-1]), shares, strict=True)))
    for (x, part), (y, other) in product(*sides):
        yield np.array([x, y]), float(part * other), 0.5 * np.append(width * [part, other], 0.0)


def _top_at(plan: Array, blocks: Sequence[Block], near: float) -> Iterator[tuple[int, Array]]:
    """Number of the block with the highest top at a place in plan, and the place on it, m."""
    extent = np.array([block.extent for block in blocks])
    line = np.insert(np.tile(plan, (2, 1)), 2, [extent.min() - 1.0, extent.max() + 1.0], axis=1)
    beside = np.maximum(extent[:, 0, :2] - plan, plan - extent[:, 1, :2]).max(axis=1)
    tops = [
        (float(part[:, 2].max()), number)
        for number in np.flatnonzero(beside <= near).tolist()
        for part in (inside_of(line, piece, near) for piece in blocks[number].pieces)
        if len(part) and not blocks[number].fixed
    ]
    if tops:
        height, number = max(tops)
        yield number, np.append(plan, height)


def reach_told(places: Array) -> str:
    """From where to where places, m, reach along the first axes."""
    ends = zip("xyz", places.min(axis=0), places.max(axis=0), strict=False)
    return "they reach from " + ", ".join(f"{axis} = {a:g} to {b:g}" for axis, a, b in ends)


def sides_told(areas: Sequence[float]) -> str:
    """Sides in words, from their areas, m2."""
    return f"{counted(len(areas), 'side')}, area {sum(areas):.6g} m2"


def middle_of(corners: Array) -> tuple[float, Array]:
    """Area, m2, and centroid, m, of a convex polygon in space."""
    fan = _fan(corners)
    areas = 0.5 * np.linalg.norm(np.cross(fan[:, 1] - fan[:, 0], fan[:, 2] - fan[:, 0]), axis=1)
    return float(areas.sum()), np.asarray(areas @ fan.mean(axis=1) / areas.sum())


def numbered(
    key: str, blocks: Sequence[Block], name: str | None, at: Vector | None, near: float
) -> int:
    """Number of the block with a name, or of the one at a place, m.

    Raises:
        InputError: If there is none, or more than one.
    """
    where, there = f"'{name}'", ""
    numbers = [k for k, block in enumerate(blocks) if block.name == name]
    if name is None:
        where = "at (" + ", ".join(f"{value:g}" for value in at or ()) + ")"
        place = lifted(at or ())
        every = np.vstack([block.extent for block in blocks])
        there = f"; {reach_told(every if len(at or ()) == 3 else every[:, ::2])}"
        numbers = [
            number
            for number, block in enumerate(blocks)
            if any(np.all(one.normals @ place - one.levels <= near) for one in block.pieces)
        ]
    require(bool(numbers), f"{key}: there is no block {where}{there}")
    names = listed(blocks[k].name or str(k) for k in numbers)
    text = f"{key}: there are {len(numbers)} blocks {where}, {names}; give a place inside of one"
    require(len(numbers) < 2, text)
    return numbers[0]
