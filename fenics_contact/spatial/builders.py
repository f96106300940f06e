"""Structures from a few lengths: walls, houses, towers, vaults, domes and bridges of blocks.

Every function returns all blocks, those that are ground among them, and takes keywords alone: m,
degrees, numbers. z is upwards. Walls stand on z = 0; arches spring from z = 0. Heights are made of
whole courses, so that bricks may become a little higher or lower than asked for.

Groups, for materials and joints: "walls", "lintels", "floors", "vault", "ground".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fenics_contact.errors import checked, require
from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.polyhedra import Block, Polyhedron

Blocks = tuple[Block, ...]
Pair = tuple[float, float]
Rows = Sequence[Sequence[float]]
Intervals = list[tuple[float, float, str]]

#: Length and height of a brick, m.
BRICK = (0.4, 0.2)
#: Least length of a piece of brick, in bricks; a shorter one is part of its neighbour.
LEAST_PIECE = 0.3
#: Depth of the ground below walls, and how far it reaches beyond them, m.
GROUND = 0.2
MARGIN = 0.5
#: Angle that a springer takes of its arch, degrees.
SPRINGER = 5.0


# ---- walls


@checked
def wall(
    *, length: float, height: float, thickness: float, brick: Pair = BRICK, openings: Rows = ()
) -> Blocks:
    """A straight wall in running bond along x, between y = 0 and its thickness.

    Args:
        length: m; likewise the other lengths.
        height: Of the wall; the courses are equally high.
        thickness: Of the wall and of every brick.
        brick: Length of a brick, and about its height. Pieces at ends and openings are shorter.
        openings: Rows of [from, to, bottom, top]. Bottom and top move to the nearest joints. A
            lintel as high as a course lies above, with half a brick of bearing at both ends.

    Raises:
        InputError: If a length is not positive, or an opening does not fit.
    """
    courses = _Courses.of(height, brick)
    _check_positive(length=length, thickness=thickness)
    made = courses.openings("openings", openings, 0.0, length)
    side = _Side("wall", 0, (0.0, thickness), length, (0.0, 0.0), openings=made)
    return courses.built([side], (length, thickness))


@checked
def corner(
    *, length_x: float, length_y: float, height: float, thickness: float, brick: Pair = BRICK
) -> Blocks:
    """Two walls from the origin along x and y, toothed where they meet.

    Args:
        length_x: Of the wall along x, from the outer edge of the corner.
        length_y: Of the wall along y.
        height: See `wall`.
        thickness: Of both walls.
        brick: See `wall`.

    Raises:
        InputError: If a length is not positive, or shorter than the walls are thick.
    """
    courses = _Courses.of(height, brick)
    _check_longer("length_x", length_x, thickness=thickness)
    _check_longer("length_y", length_y, thickness=thickness)
    across = (0.0, thickness)
    x_side = _Side("wall_x", 0, across, length_x, (0.0, thickness), (1, 0))
    y_side = _Side("wall_y", 1, across, length_y, (thickness, 0.0), (1, 0))
    return courses.built([x_side, y_side], (length_x, length_y))


@checked
def facade(
    *,
    length: float,
    side: float,
    height: float,
    thickness: float,
    brick: Pair = BRICK,
    openings: Rows = (),
) -> Blocks:
    """A facade along x with two side walls along y, toothed at both corners.

    The outer plane of the facade is y = 0: a load towards negative y pushes it off.

    Args:
        length: Of the facade, from edge to edge.
        side: Length of the side walls, the facade's thickness in it.
        height: See `wall`.
        thickness: Of all walls.
        brick: See `wall`.
        openings: Of the facade; see `wall`.

    Raises:
        InputError: See `wall`.
    """
    courses = _Courses.of(height, brick)
    _check_longer("length", length, thickness=2.0 * thickness)
    _check_longer("side", side, thickness=thickness)
    made = courses.openings("openings", openings, thickness, length - thickness)
    front = _Side("facade", 0, (0.0, thickness), length, (0.0, thickness), openings=made)
    sides = [
        _Side(name, 1, (low, low + thickness), side, (thickness, 0.0), (1, 0))
        for name, low in (("left", 0.0), ("right", length - thickness))
    ]
    return courses.built([front, *sides], (length, side))


@checked
def house(
    *,
    length: float,
    width: float,
    height: float,
    thickness: float,
    brick: Pair = BRICK,
    openings: Mapping[str, Rows] | None = None,
    floors: Sequence[float] = (),
    floor_strips: int = 1,
) -> Blocks:
    """Four toothed walls with openings, and floors that rest on the two walls along x.

    Args:
        length: Of the walls "south", at y = 0, and "north", along x, from edge to edge.
        width: Of the walls "west", at x = 0, and "east".
        height: See `wall`.
        thickness: Of all walls.
        brick: See `wall`.
        openings: By the names of walls, rows of [from, to, bottom, top], from the edges x = 0 and
            y = 0; see `wall`.
        floors: Heights of their undersides. A floor takes the inner half of the walls along x, in
            a course of its own.
        floor_strips: Blocks of a floor, side by side; 1 is a stiff slab.

    Raises:
        InputError: See `wall`; or if a floor is outside the walls, or cuts an opening.
    """
    courses = _Courses.of(height, brick)
    _check_counts(floor_strips=floor_strips)
    _check_longer("length", length, thickness=2.0 * thickness)
    _check_longer("width", width, thickness=2.0 * thickness)
    lengths = {"south": length, "north": length, "west": width, "east": width}
    given = openings or {}
    unknown = ", ".join(sorted(set(given) - set(lengths)))
    require(not unknown, f"openings.{unknown}: the walls are south, north, west and east")
    made = {
        name: courses.openings(f"openings.{name}", rows, thickness, lengths[name] - thickness)
        for name, rows in given.items()
    }
    floor_courses = [courses.floor(height, made) for height in floors]

    def sides(deep: float, x_insets: Pair, y_insets: Pair) -> list[_Side]:
        places = (
            ("south", 0, (0.0, deep), x_insets),
            ("north", 0, (width - deep, width), x_insets),
            ("west", 1, (0.0, thickness), y_insets),
            ("east", 1, (length - thickness, length), y_insets),
        )
        return [
            _Side(name, axis, across, lengths[name], insets, openings=made.get(name, ()))
            for name, axis, across, insets in places
        ]

    around = sides(thickness, (0.0, thickness), (thickness, 0.0))
    deep = 0.5 * thickness
    beside_floor = sides(deep, (0.0, 0.0), (deep, deep))
    blocks = [_ground((0.0, 0.0), (length, width))]
    for course in range(courses.count):
        is_floor = course in floor_courses
        blocks += courses.laid(course, beside_floor if is_floor else around)
        low, high = course * courses.height, (course + 1) * courses.height
        cuts = np.linspace(thickness, length - thickness, floor_strips + 1)
        for number, (start, end) in enumerate(pairwise(cuts if is_floor else cuts[:0])):
            name = f"floor_{course + 1}_{number + 1}"
            blocks.append(_box((start, deep, low), (end, width - deep, high), name, "floors"))
    return tuple(blocks)


@checked
def tower(
    *,
    width: float,
    height: float,
    thickness: float,
    top_width: float | None = None,
    brick: Pair = BRICK,
    openings: Mapping[str, Rows] | None = None,
    floors: Sequence[float] = (),
) -> Blocks:
    """A square tower; a tapering one narrows in proportion, its walls and bricks too.

    Args:
        width: At the ground, from edge to edge.
        height: See `wall`.
        thickness: Of the walls at the ground.
        top_width: That at the top; None for the same as at the ground.
        brick: See `wall`; its length is that at the ground.
        openings: See `house`; lengths along the walls are those at the ground.
        floors: See `house`.

    Raises:
        InputError: See `house`; or if the top is wider than the ground.
    """
    top = width if top_width is None else top_width
    _check_positive(top_width=top)
    require(top <= width, f"top_width = {top:g} must be at most width = {width:g}")
    made = house(
        length=width,
        width=width,
        height=height,
        thickness=thickness,
        brick=brick,
        openings=openings,
        floors=floors,
    )

    def narrowed(block: Block) -> Block:
        corners = block.pieces[0].corners.copy()
        part = 1.0 - (1.0 - top / width) * corners[:, 2:] / height
        corners[:, :2] = 0.5 * width + part * (corners[:, :2] - 0.5 * width)
        return Block((Polyhedron.hexahedron(corners),), block.name, block.group)

    return tuple(block if block.fixed else narrowed(block) for block in made)


@checked
def extruded(*, courses: Rows, thickness: float, brick: Pair = BRICK) -> Blocks:
    """A wall from the courses of a planar one, along x.

    Args:
        courses: From the bottom, lengths of blocks in bricks; negative ones are left out.
        thickness: Of the wall, m.
        brick: Length, and height of every course, m.

    Raises:
        InputError: If there is no course, or a length is zero.
    """
    _check_positive(brick_length=brick[0], brick_height=brick[1], thickness=thickness)
    good = len(courses) > 0 and all(len(course) and all(course) for course in courses)
    require(good, "courses must be lists of lengths that are not zero")
    blocks: list[Block] = []
    longest = 0.0
    for number, course in enumerate(courses):
        ends = brick[0] * np.concatenate([[0.0], np.cumsum(np.abs(course))])
        longest = max(longest, float(ends[-1]))
        low, high = number * brick[1], (number + 1) * brick[1]
        for place, (start, end) in enumerate(pairwise(ends)):
            if course[place] > 0.0:
                name = f"wall_{number + 1}_{place + 1}"
                blocks.append(_box((start, 0.0, low), (end, thickness, high), name, "walls"))
    return (_ground((0.0, 0.0), (longest, thickness)), *blocks)


# ---- vaults


@checked
def barrel_vault(
    *,
    span: float,
    rise: float,
    thickness: float,
    length: float,
    voussoirs: int,
    strips: int = 1,
    bonded: bool = True,
) -> Blocks:
    """A barrel vault along y with a circular arch, between fixed springers.

    Args:
        span: Of the intrados at the springings, x from -span / 2 to span / 2.
        rise: Of the intrados; half of the span for a semicircle.
        thickness: Of the ring.
        length: From y = 0.
        voussoirs: Number of them around the arch.
        strips: Number of them along the vault.
        bonded: Whether joints across are shifted by half a block from voussoir to voussoir.

    Raises:
        InputError: If a length or number is not positive, or the rise more than half of the span.
    """
    arch = _Arch.of(span, rise, thickness, voussoirs)
    blocks = list(arch.voussoirs(length, strips, bonded))
    for name, end in (("left", 0), ("right", -1)):
        beyond = arch.angles[end] + np.radians(SPRINGER) * (1.0 if end == 0 else -1.0)
        quadrilateral = arch.quadrilateral(arch.angles[end], beyond)
        blocks.append(_prism(quadrilateral, (0.0, length), f"springer_{name}", "ground", True))
    return tuple(blocks)


@checked
def cross_vault(
    *, span: float, thickness: float, length: float, voussoirs: int, pieces: int = 2
) -> Blocks:
    """Two semicircular barrels of the same span that cross on a square, along x and y.

    The webs meet in the vertical planes |x| = |y| and stand on the ground at z = 0.

    Args:
        span: Of the intrados.
        thickness: Of the webs.
        length: Of both barrels, from arch to arch; more than span + 2 thickness.
        voussoirs: Number around an arch, even.
        pieces: Number of blocks of a voussoir from the groin to the arch at the end.

    Raises:
        InputError: If a length or number is not positive, the number of voussoirs is odd, or the
            barrels end before they cross.
    """
    arch = _Arch.of(span, 0.5 * span, thickness, voussoirs)
    _check_counts(pieces=pieces)
    require(voussoirs % 2 == 0, f"voussoirs = {voussoirs} must be even: a joint is at the crown")
    _check_longer("length", length, thickness=span + 2.0 * thickness)
    half = 0.5 * length
    blocks = [_ground((-half, -half), (half, half))]
    parts = np.linspace(0.0, 1.0, pieces + 1)
    for number, (start, end) in enumerate(pairwise(arch.angles)):
        x, z = arch.quadrilateral(start, end).T
        for sign, y_name, x_name in ((-1.0, "south", "west"), (1.0, "north", "east")):
            for piece, (low, high) in enumerate(pairwise(parts)):
                ends = [sign * (np.abs(x) + part * (half - np.abs(x))) for part in (low, high)]
                along_y = np.vstack([np.column_stack([x, y, z]) for y in ends])
                along_x = along_y[:, [1, 0, 2]]
                for name, corners in ((y_name, along_y), (x_name, along_x)):
                    solid = Polyhedron.hexahedron(corners)
                    title = f"{name}_{number + 1}_{piece + 1}"
                    blocks.append(Block((solid,), title, "vault"))
    return tuple(blocks)


@checked
def dome(
    *,
    radius: float,
    thickness: float,
    meridians: int,
    rings: int,
    embrace: float = 90.0,
    oculus: float | None = None,
    keystone: bool = False,
    bonded: bool = False,
) -> Blocks:
    """A spherical dome about the z axis, on fixed springers.

    Blocks have plane sides: rings are regular polygons. Beds are conical, as the radii.

    Args:
        radius: Of the middle surface at the corners of blocks.
        thickness: Of the shell.
        meridians: Number of blocks of a ring.
        rings: Number of rings.
        embrace: Angle of the springing from the vertical, degrees; 90 for a hemisphere.
        oculus: Radius of the opening at the crown, in the middle surface; None for that of 5
            degrees.
        keystone: Whether a block closes the opening.
        bonded: Whether joints are shifted by half a block from ring to ring.

    Raises:
        InputError: If a length or number is not positive, or the opening is wider than the dome.
    """
    _check_positive(radius=radius, thickness=thickness, embrace=embrace)
    _check_counts(rings=rings)
    require(meridians >= 3, f"meridians = {meridians} must be at least 3")
    require(thickness < radius, f"thickness = {thickness:g} must be less than radius = {radius:g}")
    require(embrace <= 90.0, f"embrace = {embrace:g} must be at most 90 degrees")
    opening = radius * np.sin(np.radians(5.0)) if oculus is None else oculus
    _check_positive(oculus=opening)
    widest = radius * np.sin(np.radians(embrace))
    require(opening < widest, f"oculus = {opening:g} must be less than {widest:g}, the dome's own")
    crown = np.arcsin(opening / radius)
    beds = np.linspace(np.radians(embrace), crown, rings + 1)
    azimuths = np.linspace(0.0, 2.0 * np.pi, 2 * meridians + 1)  # of halves of blocks
    if not bonded:
        azimuths = azimuths[::2]
    height = radius * np.cos(beds[0])
    shell = (radius - 0.5 * thickness, radius + 0.5 * thickness)

    def corner_at(distance: float, bed: float, azimuth: float) -> list[float]:
        across = distance * np.sin(bed)
        up = distance * np.cos(bed) - height
        return [across * np.cos(azimuth), across * np.sin(azimuth), up]

    def cell(low: float, high: float, column: int) -> Polyhedron:
        sides = azimuths[column % (len(azimuths) - 1) :][:2]
        profile = [(shell[0], low), (shell[1], low), (shell[1], high), (shell[0], high)]
        return Polyhedron.hexahedron(
            np.array([corner_at(*at, azimuth) for azimuth in sides for at in profile])
        )

    ground = beds[0] + np.radians(SPRINGER)
    blocks = []
    for number, (low, high) in enumerate(pairwise([ground, *beds])):
        fixed = number == 0
        for column in range(meridians):
            columns = [column]
            if bonded:
                first = 2 * column + number % 2
                columns = [first, first + 1]
            solids = tuple(cell(low, high, place) for place in columns)
            name = f"springer_{column + 1}" if fixed else f"ring_{number}_{column + 1}"
            blocks.append(Block(solids, name, "ground" if fixed else "vault", fixed))
    if keystone:
        loops = [[corner_at(r, crown, azimuth) for azimuth in azimuths[:-1]] for r in shell]
        blocks.append(Block((_frustum(*loops),), "keystone", "vault"))
    return tuple(blocks)


@checked
def bridge(
    *,
    span: float,
    rise: float,
    thickness: float,
    width: float,
    height: float,
    voussoirs: int,
    strips: int = 3,
    spandrel: float = 0.3,
    courses: int = 2,
    abutment: float = 1.0,
) -> Blocks:
    """A barrel with spandrel walls on both edges, between fixed abutments; along x.

    A spandrel wall has a column of blocks over every voussoir.

    Args:
        span: Of the intrados, x from -span / 2 to span / 2.
        rise: Of the intrados.
        thickness: Of the barrel.
        width: Of the bridge, from y = 0.
        height: Of the top of the spandrel walls above the springing of the intrados.
        voussoirs: Number around the arch.
        strips: Number of them across the bridge, bonded.
        spandrel: Thickness of the spandrel walls.
        courses: Number of blocks of a column.
        abutment: Length of the abutments.

    Raises:
        InputError: If a length or number is not positive, the walls are lower than the crown, or
            thicker than half of the bridge.
    """
    arch = _Arch.of(span, rise, thickness, voussoirs)
    _check_positive(width=width, spandrel=spandrel, abutment=abutment)
    _check_counts(courses=courses)
    crown = rise + thickness
    require(height > crown, f"height = {height:g} must be more than rise + thickness = {crown:g}")
    half = f"spandrel = {spandrel:g} must be less than half of width = {width:g}"
    require(2.0 * spandrel < width, half)
    blocks = list(arch.voussoirs(width, strips, True))
    edges = (("near", (0.0, spandrel)), ("far", (width - spandrel, width)))
    for number, (start, end) in enumerate(pairwise(arch.angles)):
        _, _, right, left = arch.quadrilateral(end, start)  # of the extrados
        levels = np.linspace(max(left[1], right[1]), height, courses + 1)
        for course, top in enumerate(levels[1:]):
            floor = levels[course] if course else None
            bottom = [point if floor is None else (point[0], floor) for point in (left, right)]
            loop = [*bottom, (right[0], top), (left[0], top)]
            for name, edge in edges:
                title = f"spandrel_{name}_{number + 1}_{course + 1}"
                blocks.append(_prism(loop, edge, title, "walls"))
    for name, end, sign in (("left", 0, -1.0), ("right", -1, 1.0)):
        inner, outer = (arch.at(r, arch.angles[end]) for r in (arch.inner, arch.outer))
        foot = inner[1] - thickness
        far = outer[0] + sign * abutment
        below = [inner, outer, (outer[0], foot), (inner[0], foot)]
        beside = [(outer[0], foot), (far, foot), (far, height), (outer[0], height)]
        solids = [_prism(loop, (0.0, width), "", "").pieces[0] for loop in (below, beside)]
        blocks.append(Block(tuple(solids), f"abutment_{name}", "ground", True))
    return tuple(blocks)


# ---- courses of bricks


@dataclass(frozen=True)
class _Opening:
    """A hole from one course to before another, over which its lintel lies."""

    start: float
    end: float
    first: int
    lintel: int


@dataclass(frozen=True)
class _Side:
    """A straight run of wall.

    Attributes:
        name: Of the wall.
        axis: 0 along x, 1 along y.
        across: Its faces.
        length: From the outer edge.
        insets: What walls that it meets take of its ends, in even and in odd courses.
        meets: At its start, at its end: 0 or 1.
        openings: In it.
    """

    name: str
    axis: int
    across: Pair
    length: float
    insets: Pair
    meets: tuple[int, int] = (1, 1)
    openings: tuple[_Opening, ...] = ()


@dataclass(frozen=True)
class _Courses:
    """Courses of bricks: their number and height, and the length of a brick."""

    count: int
    height: float
    brick: float

    @classmethod
    def of(cls, height: float, brick: Pair) -> _Courses:
        """Whole courses that fill a height."""
        _check_positive(height=height, brick_length=brick[0], brick_height=brick[1])
        count = max(round(height / brick[1]), 1)
        return cls(count, height / count, brick[0])

    def built(self, sides: Sequence[_Side], size: Pair) -> Blocks:
        """All courses of some walls, on the ground."""
        blocks = [_ground((0.0, 0.0), size)]
        for course in range(self.count):
            blocks += self.laid(course, sides)
        return tuple(blocks)

    def laid(self, course: int, sides: Sequence[_Side]) -> Iterator[Block]:
        """Bricks of a course; vertical joints are half a brick away from those below."""
        low, high = course * self.height, (course + 1) * self.height
        for side in sides:
            half = (course + side.axis) % 2
            for number, (start, end, group) in enumerate(self._bricks(course, side, half)):
                corners = np.array([[start, side.across[0]], [end, side.across[1]]])
                near, far = corners[:, ::-1] if side.axis else corners
                name = f"{side.name}_{course + 1}_{number + 1}"
                yield _box((*near, low), (*far, high), name, group)

    def _bricks(self, course: int, side: _Side, half: int) -> Intervals:
        """Ends and groups of bricks along a side, in order."""
        inset = side.insets[course % 2]
        start, end = inset * side.meets[0], side.length - inset * side.meets[1]
        rests = 0.5 * self.brick
        taken: Intervals = []
        for opening in side.openings:
            if opening.first <= course < opening.lintel:
                taken.append((opening.start, opening.end, ""))
            elif course == opening.lintel:
                ends = max(opening.start - rests, start), min(opening.end + rests, end)
                taken.append((*ends, "lintels"))
        bricks = [interval for interval in taken if interval[2]]
        around = sorted([(start, start, ""), *taken, (end, end, "")])
        least = (LEAST_PIECE - 1e-9) * self.brick
        for (_, low, _), (high, _, _) in pairwise(around):
            joints = self.brick * (np.arange(np.ceil(side.length / self.brick)) + 0.5 * half)
            inside = joints[(joints - low > least) & (high - joints > least)]
            if high - low > 1e-9 * self.brick:
                bricks += [(float(a), float(b), "walls") for a, b in pairwise([low, *inside, high])]
        return sorted(bricks)

    def openings(self, key: str, rows: Rows, low: float, high: float) -> tuple[_Opening, ...]:
        """Openings between two walls, each between piers of half a brick, below a lintel."""
        pier = (0.5 - 1e-9) * self.brick
        made: list[_Opening] = []
        for number, row in enumerate(rows):
            name = f"{key}[{number}]"
            require(len(row) == 4, f"{name} must be [from, to, bottom, top]")
            start, end, bottom, top = row
            first, lintel = round(bottom / self.height), round(top / self.height)
            require(start < end, f"{name}: from = {start:g} must be less than to = {end:g}")
            within = low + pier <= start and end <= high - pier
            least, most = low + 0.5 * self.brick, high - 0.5 * self.brick
            require(
                within, f"{name} must be between {least:g} and {most:g}, half a brick from ends"
            )
            room = (self.count - 1) * self.height
            text = f"bottom = {bottom:g} and top = {top:g} must be between 0 and {room:g}"
            fits = 0 <= first < lintel < self.count
            require(fits, f"{name}: {text}, a course of {self.height:g} apart; a lintel lies above")
            for other in made:
                beside = max(start - other.end, other.start - end) > 2.0 * pier
                above = first > other.lintel or other.first > lintel
                require(beside or above, f"{name} is less than a brick away from another opening")
            made.append(_Opening(start, end, first, lintel))
        return tuple(made)

    def floor(self, height: float, openings: Mapping[str, Sequence[_Opening]]) -> int:
        """The course of a floor."""
        course = round(height / self.height)
        top = (self.count - 1) * self.height
        text = f"floors: {height:g} must be between {self.height:g} and {top:g}, the last course"
        require(1 <= course < self.count, text)
        for name, holes in openings.items():
            cut = any(hole.first <= course <= hole.lintel for hole in holes)
            require(not cut, f"floors: {height:g} is in an opening of {name} or in its lintel")
        return course


# ---- arches


@dataclass(frozen=True)
class _Arch:
    """A circular ring in the plane of x and z, its intrados springing from z = 0.

    Attributes:
        inner: Radius of the intrados.
        outer: That of the extrados.
        centre: Height of the centre.
        angles: Of the joints, from the left, about the centre.
    """

    inner: float
    outer: float
    centre: float
    angles: Array

    @classmethod
    def of(cls, span: float, rise: float, thickness: float, voussoirs: int) -> _Arch:
        """A ring of some rise."""
        _check_positive(span=span, rise=rise, thickness=thickness)
        _check_counts(voussoirs=voussoirs)
        most = 0.5 * span
        require(rise <= most * (1.0 + 1e-9), f"rise = {rise:g} must be at most span / 2 = {most:g}")
        inner = (most**2 + rise**2) / (2.0 * rise)
        springing = np.arctan2(inner - rise, most)
        angles = np.linspace(np.pi - springing, springing, voussoirs + 1)
        return cls(inner, inner + thickness, rise - inner, angles)

    def at(self, radius: float, angle: float) -> tuple[float, float]:
        """Coordinates x and z."""
        return radius * np.cos(angle), self.centre + radius * np.sin(angle)

    def quadrilateral(self, start: float, end: float) -> Array:
        """Corners of a voussoir between two joints, inside first, shape (4, 2)."""
        radii = self.inner, self.inner, self.outer, self.outer
        angles = start, end, end, start
        return np.array([self.at(*both) for both in zip(radii, angles, strict=True)])

    def voussoirs(self, length: float, strips: int, bonded: bool) -> Iterator[Block]:
        """Blocks of a barrel from y = 0, in strips."""
        _check_positive(length=length)
        _check_counts(strips=strips)
        whole = np.linspace(0.0, length, strips + 1)
        shifted = np.concatenate([[0.0], 0.5 * (whole[1:] + whole[:-1]), [length]])
        for number, (start, end) in enumerate(pairwise(self.angles)):
            loop = self.quadrilateral(start, end)
            cuts = shifted if bonded and strips > 1 and number % 2 else whole
            for strip, along in enumerate(pairwise(cuts)):
                yield _prism(loop, along, f"voussoir_{number + 1}_{strip + 1}", "vault")


# ---- blocks, and checks of lengths


def _box(low: Sequence[float], high: Sequence[float], name: str, group: str) -> Block:
    """A block along the axes."""
    return Block((Polyhedron.box(np.array(low), np.array(high)),), name, group)


def _prism(loop: Rows | Array, along: Pair, name: str, group: str, fixed: bool = False) -> Block:
    """A block over a quadrilateral in x and z, between two y."""
    corners = np.array([[x, y, z] for y in along for x, z in loop])
    return Block((Polyhedron.hexahedron(corners),), name, group, fixed)


def _frustum(bottom: Rows, top: Rows) -> Polyhedron:
    """A body between two loops of as many corners, both counterclockwise seen from above."""
    count = len(bottom)
    sides = [tuple(range(count))[::-1], tuple(range(count, 2 * count))]
    for k in range(count):
        following = (k + 1) % count
        sides.append((k, following, count + following, count + k))
    return Polyhedron(np.array([*bottom, *top]), tuple(sides))


def _ground(low: Pair, high: Pair) -> Block:
    """A fixed block below z = 0, with a margin around a plan."""
    bottom = [low[0] - MARGIN, low[1] - MARGIN, -GROUND]
    top = [high[0] + MARGIN, high[1] + MARGIN, 0.0]
    return Block((Polyhedron.box(np.array(bottom), np.array(top)),), "ground", "ground", True)


def _check_positive(**lengths: float) -> None:
    for name, length in lengths.items():
        require(length > 0.0, f"{name} = {length:g} must be positive")


def _check_counts(**counts: int) -> None:
    for name, count in counts.items():
        require(count >= 1, f"{name} = {count} must be at least 1")


def _check_longer(name: str, length: float, thickness: float) -> None:
    _check_positive(thickness=thickness)
    require(
        length > thickness * (1.0 + 1e-9), f"{name} = {length:g} must be more than {thickness:g}"
    )
