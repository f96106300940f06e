"""Loads in space: what a user gives, and the forces and moments of the blocks that come of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fenics_contact.errors import InputError, require
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.results.bounds import counted
from fenics_contact.scene import scene
from fenics_contact.scene.rules import (
    FINITE,
    MOST_TILT,
    NOT_NEGATIVE,
    Checked,
    listed,
    require_profile,
    require_vector,
    rule,
    ruled,
)
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.contacts import clipped, polygon_area
from fenics_contact.spatial.points import polygon_centroid
from fenics_contact.spatial.polyhedra import Block

Vector = tuple[float, float, float]
#: Number of the ground where an anchor ends, which is no block.
GROUND = -1
#: Acceleration of a live load that is given by its direction, and of a floor's mass, m/s2.
GRAVITY = 9.81
#: Cosine of the largest angle between a side and the direction by which it is chosen: 1 degree.
SAME_DIRECTION = 0.99985
#: Distance from a plane or a block that is rounding, in parts of a typical block's size.
NEAR = 1e-5
#: From the front of a prism to its back.
MIRRORED = np.array([1.0, -1.0, 1.0])
#: Places and weight in a tetrahedron that integrate quadratic functions.
FAR, CLOSE = 0.1381966011250105, 0.5854101966249685

DIRECTION = rule(any, "must be a direction, not zero", require_vector)


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
    normal: tuple[float, float, float] | None = ruled(DIRECTION, None)
    point: tuple[float, float, float] | None = ruled(require_vector, None)
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
                    wished = np.array(self.normal) / np.linalg.norm(self.normal)
                    chosen &= piece.normals @ wished >= SAME_DIRECTION
                if self.point is not None:
                    height = piece.normals @ np.array(self.point) - piece.levels
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
            line = np.array(places) - start * [1.0, 0.0, 1.0]
            length = float(np.linalg.norm(front[1] - start))
            along = (front[1] - start) / length
            low, high = np.clip(np.sort(line @ along), 0.0, length)
            if np.abs(np.cross(line, along)).max() <= near and high - low > near:
                low, high = start + low * along, start + high * along
                yield np.array([low, high, high * MIRRORED, low * MIRRORED])


@dataclass(frozen=True)
class Force(Checked):
    """A force on one block or on sides.

    Attributes:
        force: N.
        block: Name of the block that it acts on; by default the one at `at`.
        at: Where, m; by default the block's centroid.
        sides: Name of sides that it is spread over evenly, in place of a block.
    """

    force: tuple[float, float, float] = ruled(require_vector)
    block: str | None = None
    at: tuple[float, float, float] | None = ruled(require_vector, None)
    sides: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        placed = self.block is not None or self.at is not None
        require(placed != (self.sides is not None), "give either block or at, or sides")


@dataclass(frozen=True)
class Movement(Checked):
    """A small movement of the ground: settlement, spreading, tilt.

    Attributes:
        displacement: Of the centroid, m.
        rotation: About axes through the centroid, degrees.
    """

    displacement: tuple[float, float, float] = ruled(require_vector, (0.0, 0.0, 0.0))
    rotation: tuple[float, float, float] = ruled(require_vector, (0.0, 0.0, 0.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        small = max(abs(angle) for angle in self.rotation) <= MOST_TILT
        text = f"rotation = {list(self.rotation)} must lie in -{MOST_TILT:g} ... {MOST_TILT:g}"
        require(small, f"{text} degrees")

    @property
    def motion(self) -> Array:
        """Displacement and rotation, m and rad, shape (6,)."""
        return np.append(self.displacement, np.radians(self.rotation))


@dataclass(frozen=True)
class Tie(scene.Bar):
    """A bar of the structure in space, see `scene.scene.Bar`; forces are N.

    Attributes:
        from_: Where it begins: a place in a block, m.
        to: Where it ends: a place in another block.
        ground: The place in the ground where it ends, m, in place of `to`.
        stiffness: E A / L, N/m; None: as stiff as a typical point of the joints.
    """

    from_: tuple[float, float, float] = ruled(require_vector)
    to: tuple[float, float, float] | None = ruled(require_vector, None)
    ground: tuple[float, float, float] | None = ruled(require_vector, None)

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.from_ != (self.to or self.ground), "to: it ends where it begins")

    def bar(self, key: str, blocks: Sequence[Block], near: float) -> Bar:
        """The bar between the blocks that are at its ends."""
        first = numbered(f"{key}.from", blocks, None, self.from_, near)
        to = self.to and numbered(f"{key}.to", blocks, None, self.to, near)
        second = GROUND if to is None else to
        text = f"{key}: both ends are in block '{blocks[first].name}'; a tie joins two"
        require(first != second, text)
        return Bar(self, (first, second))

    @property
    def ends(self) -> Array:
        """M, shape (2, 3)."""
        return np.array([self.from_, self.to or self.ground], dtype=float)


@dataclass(frozen=True)
class Bar:
    """A tie, and the numbers of the two blocks that it holds together; `GROUND` is the ground."""

    tie: Tie
    blocks: tuple[int, int]


@dataclass(frozen=True)
class Load(Checked):
    """Body force, tractions and forces.

    Attributes:
        body: Acceleration, m/s2, times density.
        direction: That of `body` in place of it: 9.81 m/s2 this way.
        traction: Force per area, Pa, by name of sides.
        force: Forces by any name.
        movement: Of fixed blocks and foundations by their names; of the dead load only.
        profile: Factor on `body` over the height above the lowest point of what moves, of the live
            load only: "uniform"; "triangular", which grows from 0 and leaves the total as it is; or
            pairs (height, factor), m and 1, with straight lines between, constant beyond.
    """

    body: tuple[float, float, float] = ruled(require_vector, (0.0, 0.0, 0.0))
    direction: tuple[float, float, float] | None = ruled(DIRECTION, None)
    traction: Mapping[str, Vector] = field(default_factory=dict)
    force: Mapping[str, Force] = field(default_factory=dict)
    movement: Mapping[str, Movement] = field(default_factory=dict)
    profile: tuple[tuple[float, float], ...] | str = ruled(require_profile, "uniform")

    def __post_init__(self) -> None:
        super().__post_init__()
        both = self.direction is not None and any(self.body)
        require(not both, "direction: give either body or direction")
        for name, value in self.traction.items():
            require_vector(f"traction.{name}", value)

    @property
    def acceleration(self) -> Array:
        """The body force per mass, m/s2."""
        if self.direction is None:
            return np.array(self.body)
        return GRAVITY * np.array(self.direction) / np.linalg.norm(self.direction)

    def factors(self, height: Array, mass: Array) -> Array:
        """Factors of the profile at heights, m, of masses."""
        if self.profile == "uniform":
            return np.ones(len(height))
        if self.profile == "triangular":
            return np.asarray(height * mass.sum() / (height @ mass))
        heights, factors = np.array(self.profile, dtype=float).T
        return np.interp(height, heights, factors)


@dataclass(frozen=True)
class Floor(Checked):
    """A floor or roof that lies on top sides of blocks; its weight is part of the dead load.

    Its plan is `x` by `y`, by default the rectangle around the top sides that carry it. Each of
    these gets weight by the area on which the floor lies on it.

    Attributes:
        z: Height of the top sides, m.
        force: Its weight per area of its plan, N/m2.
        x: From where to where it reaches, m.
        y: Likewise.
        group: Only blocks of this group carry it.
        mass: Whether the live body force acts on its mass, weight / 9.81 m/s2, too.
    """

    z: float = ruled(FINITE)
    force: float = ruled(NOT_NEGATIVE)
    x: tuple[float, float] | None = ruled(require_vector, None)
    y: tuple[float, float] | None = ruled(require_vector, None)
    group: str | None = None
    mass: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("x", "y"):
            low, high = getattr(self, name) or (0.0, 1.0)
            require(low < high, f"{name} = [{low:g}, {high:g}] must rise, [from, to]")

    def masses(self, key: str, blocks: Sequence[Block], near: float) -> tuple[Masses, str]:
        """Its mass on the blocks that carry it, and on what it lies."""
        tops = Sides(self.group, normal=(0.0, 0.0, 1.0), point=(0.0, 0.0, self.z))
        found = list(tops.of(blocks, near))
        require(bool(found), f"{key}: no block has a top side at z = {self.z:g}; move it")
        corners = np.vstack([loop[:, :2] for _, loop in found])
        low = corners.min(axis=0)
        high = corners.max(axis=0)
        for axis, wished in enumerate((self.x, self.y)):
            if wished is not None:
                low[axis], high[axis] = wished
        plan = np.where([[0, 0], [1, 0], [1, 1], [0, 1]], high, low)
        parts = [(number, clipped(loop[:, :2], plan)) for number, loop in found]
        parts = [(number, part) for number, part in parts if len(part)]
        require(bool(parts), f"{key}: no top side at z = {self.z:g} lies within x and y")
        area = np.array([polygon_area(part) for _, part in parts])
        mass = self.force * polygon_area(plan) / GRAVITY * area / area.sum()
        places = [[*polygon_centroid(part), self.z] for _, part in parts]
        return Masses(
            np.array([number for number, _ in parts]), np.array(places), mass
        ), sides_told(area.tolist())


@dataclass(frozen=True)
class Acting:
    """Forces at places of blocks.

    Attributes:
        block: Number of the block, shape (forces,).
        place: m, shape (forces, 3).
        force: N, shape (forces, 3).
        on: What they act on, in words; empty for body forces.
    """

    block: Indices
    place: Array
    force: Array
    on: str


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
    if np.any(pushed) and np.all(left[pushed] <= SEARCH.nothing * given[pushed]):
        parts = "; ".join(f"{name} on {one.on}" for name, one in acting.items() if one.on)
        raise InputError(f"{key}: what is given cancels on every block: {parts or 'its profile'}")
    return loads


def surface_loads(
    key: str, load: Load, blocks: Sequence[Block], sides: Mapping[str, Sides], near: float
) -> Iterator[tuple[str, Acting]]:
    """Tractions and forces, by their keys."""
    given = {f"{key}.traction.{n}": (n, np.array(t), True) for n, t in load.traction.items()}
    for name, force in load.force.items():
        vector = np.array(force.force)
        place = f"{key}.force.{name}"
        if force.sides is not None:
            given[place] = (force.sides, vector, False)
            continue
        number = numbered(place, blocks, force.block, force.at, near)
        at = blocks[number].centroid if force.at is None else np.array(force.at)
        yield (
            place,
            Acting(np.array([number]), at[None], vector[None], f"block {blocks[number].name}"),
        )
    for place, (name, vector, per_area) in given.items():
        require(name in sides, f"{place}: there is no [sides.{name}]; it has {listed(sides)}")
        found = list(sides[name].of(blocks, near))
        require(bool(found), f"{place}: no side of a block is as [sides.{name}] says")
        areas, centres = zip(*(_middle(corners) for _, corners in found), strict=True)
        share = np.array(areas) / (1.0 if per_area else sum(areas))
        numbers = np.array([block for block, _ in found])
        yield place, Acting(numbers, np.array(centres), np.outer(share, vector), sides_told(areas))


def sides_told(areas: Sequence[float]) -> str:
    """Sides in words, from their areas, m2."""
    return f"{counted(len(areas), 'side')}, area {sum(areas):.6g} m2"


def _middle(corners: Array) -> tuple[float, Array]:
    """Area, m2, and centroid, m, of a convex polygon in space."""
    fan = _fan(corners)
    areas = 0.5 * np.linalg.norm(np.cross(fan[:, 1] - fan[:, 0], fan[:, 2] - fan[:, 0]), axis=1)
    return float(areas.sum()), np.asarray(areas @ fan.mean(axis=1) / areas.sum())


def numbered(
    key: str, blocks: Sequence[Block], name: str | None, at: Sequence[float] | None, near: float
) -> int:
    """Number of the block with a name, or of the one at a place, m.

    Raises:
        InputError: If there is none, or more than one.
    """
    where = f"'{name}'"
    numbers = [k for k, block in enumerate(blocks) if block.name == name]
    if name is None:
        where = "at (" + ", ".join(f"{value:g}" for value in at or ()) + ")"
        place = np.array(at)
        numbers = [
            number
            for number, block in enumerate(blocks)
            if any(np.all(one.normals @ place - one.levels <= near) for one in block.pieces)
        ]
    require(bool(numbers), f"{key}: there is no block {where}")
    names = listed(blocks[k].name or str(k) for k in numbers)
    text = f"{key}: there are {len(numbers)} blocks {where}, {names}; give a place inside of one"
    require(len(numbers) < 2, text)
    return numbers[0]
