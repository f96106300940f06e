"""Structures from a few lengths: walls, houses, towers, vaults, domes and bridges of blocks.

Every function returns all blocks, those that are ground among them, and takes keywords alone: m,
degrees, numbers. z is upwards. Walls stand on z = 0; arches spring from z = 0. Heights are made of
whole courses, so that bricks may become a little higher or lower than asked for.

Groups, for materials and joints: "walls", "lintels", "floors", "vault", "ground"; of `viaduct`
"voussoirs", "skewbacks", "piers", "spandrels" and "fill".
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import wraps
from itertools import pairwise
from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import InputError, checked, require
from fenics_contact.geometry.builders import bridge as section
from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.contacts import clipped
from fenics_contact.spatial.polyhedra import Block, Polyhedron

Blocks = tuple[Block, ...]
Pair = tuple[float, float]
Rows = Sequence[Sequence[float]]
Interval = tuple[float, float, str]
F = TypeVar("F", bound=Callable[..., Blocks])

#: Length and height of a brick, m.
BRICK = (0.4, 0.2)
#: Least length of a piece of brick, in bricks; a shorter one is part of its neighbour.
LEAST_PIECE = 0.3
#: Depth of the ground below walls, and how far it reaches beyond them, m.
GROUND = 0.2
MARGIN = 0.5
#: Angle that a springer takes of its arch, degrees.
SPRINGER = 5.0
#: Walls about a plan: their axis, 0 for x, and whether they are at the end of the other one.
SIDES = {"south": (0, 0), "north": (0, 1), "west": (1, 0), "east": (1, 1)}
#: What inner walls are called, by their axis.
INNER = ("inner_x", "inner")
#: Least difference of lengths, in parts of them.
SAME = 1e-9


def _builder(function: F) -> F:
    """A function that refuses arguments of other types, and numbers that are not positive."""
    of_types = checked(function)

    @wraps(function)
    def positive(**given: Any) -> Blocks:
        for name, value in given.items():
            is_number = isinstance(value, (int, float, np.number)) and value is not False
            if is_number and value <= 0:
                raise InputError(f"{name} = {value:g} must be positive")
        return of_types(**given)

    return cast(F, positive)


# ---- walls


@_builder
def wall(
    *,
    length: float,
    height: float,
    thickness: float,
    brick: Pair = BRICK,
    openings: Rows = (),
    gable: float | None = None,
) -> Blocks:
    """A straight wall in running bond along x, between y = 0 and its thickness.

    Args:
        length: m; likewise the other lengths.
        height: Of the wall; the courses are equally high.
        thickness: Of the wall and of every brick.
        brick: Length of a brick, and about its height. Pieces at ends and openings are shorter.
        openings: Rows of [from, to, bottom, top]. Bottom and top move to the nearest joints. A
            lintel as high as a course lies above, with half a brick of bearing at both ends.
        gable: Height of a triangular gable on top; None for none.

    Raises:
        InputError: If a length is not positive, or an opening does not fit.
    """
    size = (("length", length), ("thickness", thickness))
    gables = {} if gable is None else {"south": gable}
    return _masonry({"south": "wall"}, size, height, thickness, brick, openings, gables=gables)


@_builder
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
    size = (("length_x", length_x), ("length_y", length_y))
    return _masonry({"south": "wall_x", "west": "wall_y"}, size, height, thickness, brick)


@_builder
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
    size = (("length", length), ("side", side))
    names = {"south": "facade", "west": "left", "east": "right"}
    return _masonry(names, size, height, thickness, brick, openings)


@_builder
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
    inner: Sequence[float] = (),
    inner_x: Sequence[float] = (),
    gables: Mapping[str, float] | None = None,
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
        floor_strips: Blocks of a floor in a room, side by side; 1 is a stiff slab.
        inner: Western faces, x, of inner walls along y, toothed with both walls along x: "inner_1"
            and so on.
        inner_x: Southern faces, y, of inner walls along x: "inner_x_1" and so on. Floors run
            through them.
        gables: Heights of triangular gables above `height`, by the names of walls; the crown is
            above the middle of the wall.

    Raises:
        InputError: See `wall`; or if a floor is outside the walls, or cuts an opening, or inner
            walls are less than a brick from openings, or half of one from walls.
    """
    size = (("length", length), ("width", width))
    names = {side: side for side in SIDES}
    more: dict[str, Any] = {"floors": floors, "floor_strips": floor_strips, "gables": gables}
    more |= {"openings": openings or {}, "inner": (inner_x, inner)}
    return _masonry(names, size, height, thickness, brick, **more)


@_builder
def tower(
    *,
    width: float,
    height: float,
    thickness: float,
    top_width: float | None = None,
    brick: Pair = BRICK,
) -> Blocks:
    """A square tower; a tapering one narrows in proportion, its walls and bricks too.

    Args:
        width: At the ground, from edge to edge.
        height: See `wall`.
        thickness: Of the walls at the ground.
        top_width: That at the top; None for the same as at the ground.
        brick: See `wall`; its length is that at the ground.

    Raises:
        InputError: See `wall`; or if the top is wider than the ground.
    """
    top = width if top_width is None else top_width
    require(top <= width, f"top_width = {top:g} must be at most width = {width:g}")
    size = (("width", width), ("width", width))
    names = {side: side for side in SIDES}

    def narrowed(block: Block) -> Block:
        corners = block.pieces[0].corners.copy()
        part = 1.0 - (1.0 - top / width) * corners[:, 2:] / height
        corners[:, :2] = 0.5 * width + part * (corners[:, :2] - 0.5 * width)
        return _hexahedron(corners, block.name, block.group)

    straight = _masonry(names, size, height, thickness, brick)
    return tuple(block if block.fixed else narrowed(block) for block in straight)


# ---- vaults


@_builder
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
    joints = _joints(span, rise, thickness, voussoirs, springers=True)
    blocks = _barrel(joints[1:-1], length, strips, bonded)
    for name, ends in (("left", joints[:2]), ("right", joints[-2:])):
        blocks.append(_prism(_between(*ends), (0.0, length), f"springer_{name}", "ground", True))
    return tuple(blocks)


@_builder
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
    joints = _joints(span, 0.5 * span, thickness, voussoirs)
    require(voussoirs % 2 == 0, f"voussoirs = {voussoirs} must be even: a joint is at the crown")
    _check_more("length", length, span + 2.0 * thickness)
    half = 0.5 * length
    blocks = [_ground((-half, -half), (half, half))]
    webs = {"south": (-1, [0, 1]), "west": (-1, [1, 0]), "north": (1, [0, 1]), "east": (1, [1, 0])}
    for number, ends in enumerate(pairwise(joints)):
        x, z = _between(*ends).T
        for piece, parts in enumerate(pairwise(np.linspace(0.0, 1.0, pieces + 1))):
            along = [np.abs(x) + part * (half - np.abs(x)) for part in parts]
            for name, (sign, axes) in webs.items():
                corners = np.vstack([np.column_stack([x, sign * y, z]) for y in along])
                title = f"{name}_{number + 1}_{piece + 1}"
                blocks.append(_hexahedron(corners[:, [*axes, 2]], title, "vault"))
    return tuple(blocks)


@_builder
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
    require(meridians >= 3, f"meridians = {meridians} must be at least 3")
    require(embrace <= 90.0, f"embrace = {embrace:g} must be at most 90 degrees")
    _check_more("radius", radius, thickness)
    opening = radius * np.sin(np.radians(5.0)) if oculus is None else oculus
    widest = radius * np.sin(np.radians(embrace))
    require(opening < widest, f"oculus = {opening:g} must be less than {widest:g}, the dome's own")
    springing = np.radians(90.0 - embrace)
    angles = np.linspace(springing, np.arccos(opening / radius), rings + 1)
    radii = (radius - 0.5 * thickness, radius + 0.5 * thickness)
    beds = _ring([springing - np.radians(SPRINGER), *angles], radii, -radius * np.sin(springing))
    halves = 2 if bonded else 1  # pieces of a block
    azimuths = np.linspace(0.0, 2.0 * np.pi, halves * meridians, endpoint=False)
    blocks = []
    for ring, ends in enumerate(pairwise(beds)):
        x, z = _between(*ends).T
        loops = [np.column_stack([x * np.cos(a), x * np.sin(a), z]) for a in azimuths]
        loops += loops[: ring % halves + 1]
        cells = [Polyhedron.hexahedron(np.vstack(two)) for two in pairwise(loops)]
        for column in range(meridians):
            first = halves * column + ring % halves
            solids = tuple(cells[first : first + halves])
            name = f"ring_{ring}_{column + 1}" if ring else f"springer_{column + 1}"
            blocks.append(Block(solids, name, "vault" if ring else "ground", not ring))
    if keystone:
        solid = Polyhedron.hull(np.vstack([loop[1:3] for loop in loops]))
        blocks.append(Block((solid,), "keystone", "vault"))
    return tuple(blocks)


@_builder
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
    joints = _joints(span, rise, thickness, voussoirs)
    _check_more("height", height, rise + thickness)
    _check_more("width", width, 2.0 * spandrel)
    blocks = _barrel(joints, width, strips, True)
    edges = {"near": (0.0, spandrel), "far": (width - spandrel, width)}
    for number, (left, right) in enumerate(pairwise(joints[:, 1])):  # of the extrados
        levels = np.linspace(max(left[1], right[1]), height, courses + 1)
        beds = [[(left[0], level), (right[0], level)] for level in levels]
        beds[0] = [left, right]
        for course, (bottom, top) in enumerate(pairwise(beds)):
            for name, edge in edges.items():
                title = f"spandrel_{name}_{number + 1}_{course + 1}"
                blocks.append(_prism([*bottom, *top[::-1]], edge, title, "walls"))
    for name, (inner, outer) in (("left", joints[0]), ("right", joints[-1])):
        far = outer[0] + np.copysign(abutment, outer[0])
        below = [inner, outer, (outer[0], -thickness), (inner[0], -thickness)]
        beside = [(outer[0], -thickness), (far, -thickness), (far, height), (outer[0], height)]
        solids = [_prism(loop, (0.0, width), "", "").pieces[0] for loop in (below, beside)]
        blocks.append(Block(tuple(solids), f"abutment_{name}", "ground", True))
    return tuple(blocks)


@_builder
def viaduct(
    *,
    span: float,
    rise: float,
    ring: float,
    width: float,
    voussoirs: int = 15,
    spans: int = 1,
    pier: Pair = (1.5, 2.0),
    cover: float = 0.3,
    strips: int = 3,
    spandrel: float = 0.3,
    abutments: bool = True,
) -> Blocks:
    """Arches on piers along x, which stand on the ground, between abutments, with a level road.

    Its section is that of the planar builder `bridge`. Between the spandrel walls are blocks of the
    group "fill", one over every voussoir, which spread loads and push back as the walls do.

    Args:
        span: Clear width of an arch; the first one is from x = 0 on and springs at z = 0.
        rise: Of the intrados.
        ring: Thickness of the arches.
        width: Of the bridge, from y = 0.
        voussoirs: Number around an arch.
        spans: Number of arches.
        pier: Width and height of piers and abutments.
        cover: Height of the road above the crown.
        strips: Number of voussoirs across the bridge, bonded.
        spandrel: Thickness of the spandrel walls.
        abutments: Whether the piers at both ends, x from -pier[0] to 0 and behind the last arch,
            are fixed, with their skewbacks: "abutment_left", "abutment_right". What is above may
            slide: a road between walls that do not move would wedge. Else they stand free.

    Raises:
        InputError: If lengths or numbers make no bridge.
    """
    _check_more("width", width, 2.0 * spandrel)
    drawn = section(span, rise, ring, voussoirs, spans, pier=pier, cover=cover)
    whole = np.linspace(0.0, width, strips + 1)
    shifted = np.array([0.0, *(0.5 * (whole[1:] + whole[:-1])), width]) if strips > 1 else whole
    walled = np.array([0.0, spandrel, width - spandrel, width])
    blocks = []
    for number, (outline, name) in enumerate(zip(drawn.blocks, drawn.names, strict=True), 1):
        cuts = {"voussoirs": [whole, shifted][number % 2], "spandrels": walled}
        for strip, along in enumerate(pairwise(cuts.get(name, whole[[0, -1]])), 1):
            group = "fill" if (name, strip) == ("spandrels", 2) else name
            solid = Polyhedron.hull([(x, y, z) for y in along for x, z in outline])
            blocks.append(Block((solid,), f"{name[:-1]}_{number}_{strip}", group))
    return abutted(blocks) if abutments else tuple(blocks)


def abutted(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """A bridge whose piers at both ends are fixed, with their skewbacks, on ground below all."""
    low, high = (f([b.extent[k] for b in blocks], axis=0) for k, f in enumerate((np.min, np.max)))
    below = [block for block in blocks if block.group in ("piers", "skewbacks")]
    held = [_ground(low[:2], high[:2], low[2])]
    for k, (end, x) in enumerate((("left", low[0]), ("right", high[0]))):
        back = [block for block in below if abs(block.extent[k][0] - x) <= SAME * high[0]]
        blocks = [block for block in blocks if block not in back]
        pieces = tuple(piece for block in back for piece in block.pieces)
        held.append(Block(pieces, f"abutment_{end}", "ground", True))
    return (*blocks, *held)


# ---- courses of bricks


def _masonry(
    names: Mapping[str, str],
    size: Sequence[tuple[str, float]],
    height: float,
    thickness: float,
    brick: Pair,
    openings: Rows | Mapping[str, Rows] = (),
    floors: Sequence[float] = (),
    floor_strips: int = 1,
    inner: Sequence[Sequence[float]] = ((), ()),
    gables: Mapping[str, float] | None = None,
) -> Blocks:
    """Walls about a plan, toothed where they meet, on the ground.

    Walls along x run through in even courses, those along y in odd ones. Beside a floor, walls
    along x run through, in half of their thickness.

    Args:
        names: Of the walls, by their sides of the plan.
        size: Of the plan, along x and y, with what messages call it.
        height: See `wall`.
        thickness: Of all walls.
        brick: See `wall`.
        openings: See `wall`, in its only wall along x; or see `house`.
        floors: See `house`.
        floor_strips: Blocks of a floor in a room.
        inner: Near faces of inner walls along x and along y, see `house`.
        gables: See `house`.
    """
    require(min(brick) > 0.0, f"brick = {list(brick)} must be positive")
    count = max(round(height / brick[1]), 1)
    rise = height / count
    plan = (size[0][1], size[1][1])
    walls = {SIDES[side] for side in names}

    def ends(axis: int, inset: float) -> Pair:
        start, end = (inset * ((1 - axis, end) in walls) for end in (0, 1))
        return start, plan[axis] - end

    for axis, _ in walls:
        low, high = ends(axis, thickness)
        _check_more(*size[axis], low + plan[axis] - high)
    given = openings if isinstance(openings, Mapping) else {"south": openings}
    floor_courses = {round(level / rise): f"floors: {level:g}" for level in floors}
    lines = {side: (*SIDES[side], SIDES[side][1] * plan[1 - SIDES[side][0]]) for side in names}
    for axis, (kind, faces) in enumerate(zip(INNER, inner, strict=True)):
        lines |= {f"{kind}_{number}": (axis, 0, at) for number, at in enumerate(faces, 1)}
        edges = [thickness, *(x for near in faces for x in (near, near + thickness))]
        edges.append(plan[1 - axis] - thickness)
        rooms = list(zip(edges[::2], edges[1::2], strict=True))
        for low, high in rooms if faces else ():
            _check_more(kind, high, low + 0.5 * brick[0])
    names = {side: names.get(side, side) for side in lines}
    taken = {
        side: {
            course: [(near, near + thickness, "") for near in inner[1 - axis]]
            for course in range(1 - axis, count, 2)
            if course not in floor_courses
        }
        for side, (axis, *_) in lines.items()
    }
    for kind, of in (("openings", given), ("gables", gables or {})):
        unknown = ", ".join(sorted(set(of) - set(names)))
        require(not unknown, f"{kind}.{unknown}: the walls are {', '.join(names)}")
    for side, rows in given.items():
        key = f"openings.{side}" if given is openings else "openings"
        run = ends(lines[side][0], thickness)
        taken[side] = _openings(key, rows, run, count, rise, brick[0], taken[side])
    for course, name in floor_courses.items():
        text = f"must be between {rise:g} and {height - rise:g}, the last course"
        require(1 <= course < count, f"{name} {text}")
        cut = " and ".join(side for side, courses in taken.items() if courses.get(course))
        require(not cut, f"{name} is in an opening of {cut} or in its lintel")
    blocks = [_ground((0.0, 0.0), plan)]
    for course in range(count):
        low, high = course * rise, (course + 1) * rise
        is_floor = course in floor_courses
        deep = 0.5 * thickness if is_floor else thickness
        through = 0 if is_floor else course % 2
        for side, (axis, far, at) in lines.items():
            if is_floor and side.startswith(INNER[0]):
                continue
            across = thickness if axis else deep
            near = at - far * across
            run = ends(axis, 0.0 if axis == through else deep)
            holes = taken[side].get(course, [])
            bricks = _bricks(run, holes, brick[0], (course + axis) % 2)
            for number, (start, end, group) in enumerate(bricks):
                corners = np.array([[start, near, low], [end, near + across, high]])
                lowest, highest = corners[:, [1, 0, 2]] if axis else corners
                title = f"{names[side]}_{course + 1}_{number + 1}"
                blocks.append(_box(lowest, highest, title, group))
        cuts = [np.linspace(*room, floor_strips + 1) for room in rooms * is_floor]
        slabs = [slab for some in cuts for slab in pairwise(some)]
        for number, (start, end) in enumerate(slabs):
            name = f"floor_{course + 1}_{number + 1}"
            blocks.append(_box((start, deep, low), (end, plan[1] - deep, high), name, "floors"))
    for side, above in (gables or {}).items():
        axis, far, at = lines[side]
        faces = (at - far * thickness, at + (1 - far) * thickness)
        blocks += _gable(names[side], axis, faces, plan[axis], (height, above), brick[0], count)
    return tuple(blocks)


def _gable(
    name: str, axis: int, across: Pair, length: float, heights: Pair, brick: float, count: int
) -> Iterator[Block]:
    """Bricks of a triangle on top of so many courses of a wall of some height, as high as these."""
    height, above = heights
    require(above > 0.0, f"gables = {above:g} must be positive")
    slopes = np.array([[0.0, height], [length, height], [0.5 * length, height + above]])
    courses = max(round(above * count / height), 1)
    for course in range(courses):
        low, high = height + above * np.array([course, course + 1]) / courses
        inset = 0.5 * length * (course + 0.5) / courses  # at half of the course's height
        bricks = _bricks((inset, length - inset), [], brick, (count + course + axis) % 2)
        joints = [0.0, *(end for _, end, _ in bricks[:-1]), length]
        for number, (start, end) in enumerate(pairwise(joints)):
            loop = clipped(np.array([[start, low], [end, low], [end, high], [start, high]]), slopes)
            corners = np.array([(u, v, z) for v in across for u, z in loop])
            solid = Polyhedron.hull(corners[:, [1, 0, 2] if axis else [0, 1, 2]])
            yield Block((solid,), f"{name}_{count + course + 1}_{number + 1}", "walls")


def _openings(
    key: str,
    rows: Rows,
    ends: Pair,
    count: int,
    rise: float,
    brick: float,
    walled: Mapping[int, list[Interval]],
) -> dict[int, list[Interval]]:
    """What openings, lintels and inner walls take of courses, apart by a brick."""
    taken: dict[int, list[Interval]] = defaultdict(list, walled)
    least, most = ends[0] + 0.5 * brick, ends[1] - 0.5 * brick
    room = (count - 1) * rise
    for number, row in enumerate(rows):
        name = f"{key}[{number}]"
        require(len(row) == 4, f"{name} must be [from, to, bottom, top]")
        start, end, bottom, top = row
        require(start < end, f"{name}: from = {start:g} must be less than to = {end:g}")
        within = least - SAME * brick <= start and end <= most + SAME * brick
        require(
            within, f"{name} must be between {least:g} and {most:g}, half a brick from its ends"
        )
        first, lintel = round(bottom / rise), round(top / rise)
        text = f"bottom = {bottom:g} and top = {top:g} must be between 0 and {room:g}"
        fits = 0 <= first < lintel < count
        require(fits, f"{name}: {text}, a course of {rise:g} apart; a lintel lies above")
        for course in range(first, lintel + 1):
            apart = [max(start - b, a - end) for a, b, _ in taken[course]]
            beside = min(apart, default=brick) > (1.0 - 2.0 * SAME) * brick
            require(
                beside,
                f"{name} is less than {brick:g} m, a brick, from an opening or an inner wall",
            )
            taken[course].append((start, end, "lintels" if course == lintel else ""))
    return taken


def _bricks(ends: Pair, taken: Sequence[Interval], brick: float, half: int) -> list[Interval]:
    """Ends and groups of bricks and lintels along a run of wall, in order.

    Vertical joints are half a brick away from those of the other courses; lintels rest on as much.
    """
    start, end = ends
    cuts = [(start, start, ""), (end, end, "")]
    for low, high, group in taken:
        rest = 0.5 * brick if group else 0.0
        cuts.append((max(low - rest, start), min(high + rest, end), group))
    bricks = [cut for cut in cuts if cut[2]]
    least = (LEAST_PIECE - SAME) * brick
    joints = brick * (np.arange(np.ceil(end / brick)) + 0.5 * half)
    for (_, low, _), (high, _, _) in pairwise(sorted(cuts)):
        inside = joints[(joints - low > least) & (high - joints > least)]
        if high - low > SAME * brick:
            bricks += [(float(a), float(b), "walls") for a, b in pairwise([low, *inside, high])]
    return sorted(bricks)


# ---- arches


def _joints(
    span: float, rise: float, thickness: float, voussoirs: int, springers: bool = False
) -> Array:
    """Joints of a circular ring, from the left; its intrados springs from z = 0.

    Returns:
        x and z on the intrados and on the extrados, m, shape (joints, 2, 2); with springers, the
        first and last joints are their feet.
    """
    half = 0.5 * span
    require(rise <= half * (1.0 + SAME), f"rise = {rise:g} must be at most span / 2 = {half:g}")
    inner = (half**2 + rise**2) / (2.0 * rise)
    springing = np.arctan2(inner - rise, half)
    angles = np.linspace(np.pi - springing, springing, voussoirs + 1)
    if springers:
        foot = springing - np.radians(SPRINGER)
        angles = np.array([np.pi - foot, *angles, foot])
    return _ring(angles, (inner, inner + thickness), rise - inner)


def _ring(angles: npt.ArrayLike, radii: Pair, centre: float) -> Array:
    """Ends of joints, x and z, m, at angles from the horizontal, shape (joints, 2, 2)."""
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    return np.stack([radius * rays + [0.0, centre] for radius in radii], axis=1)


def _between(one: Array, two: Array) -> Array:
    """Corners of a voussoir between two joints, in x and z, shape (4, 2)."""
    return np.array([one[0], two[0], two[1], one[1]])


def _barrel(joints: Array, length: float, strips: int, bonded: bool) -> list[Block]:
    """Blocks of a barrel from y = 0, in strips."""
    whole = np.linspace(0.0, length, strips + 1)
    shifted = np.array([0.0, *(0.5 * (whole[1:] + whole[:-1])), length])
    blocks = []
    for number, ends in enumerate(pairwise(joints)):
        cuts = shifted if bonded and strips > 1 and number % 2 else whole
        for strip, along in enumerate(pairwise(cuts)):
            name = f"voussoir_{number + 1}_{strip + 1}"
            blocks.append(_prism(_between(*ends), along, name, "vault"))
    return blocks


# ---- blocks, and a check of lengths


def _box(low: Any, high: Any, name: str, group: str, fixed: bool = False) -> Block:
    """A block along the axes."""
    return Block((Polyhedron.box(low, high),), name, group, fixed)


def _prism(loop: Any, along: Pair, name: str, group: str, fixed: bool = False) -> Block:
    """A block over a quadrilateral in x and z, between two y."""
    return _hexahedron([[x, y, z] for y in along for x, z in loop], name, group, fixed)


def _hexahedron(corners: Any, name: str, group: str, fixed: bool = False) -> Block:
    """A block of eight corners."""
    return Block((Polyhedron.hexahedron(corners),), name, group, fixed)


def _ground(low: Pair, high: Pair, level: float = 0.0) -> Block:
    """A fixed block below a level, with a margin around a plan."""
    bottom = (low[0] - MARGIN, low[1] - MARGIN, level - GROUND)
    return _box(bottom, (high[0] + MARGIN, high[1] + MARGIN, level), "ground", "ground", True)


def _check_more(name: str, length: float, least: float) -> None:
    """Refuse a length that is not more than another one."""
    require(length > least * (1.0 + SAME), f"{name} = {length:g} must be more than {least:g}")
