"""gmsh builders: walls in courses, arches, and blocks given by their corners, as in drawings.

Every builder returns `gmsh.model`, meshed; it replaces an earlier model of the same name, so that
drawing many does not fill the memory. Arguments in common: `size`, the largest length of an element
along the sides, m, and `quadrilaterals`, for quadrilateral cells in place of triangles. Builders
raise `InputError` for sizes or numbers that are not positive.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import check_types, checked, require
from fenics_contact.geometry.gmsh_mesh import GmshMesh, bodies_of_cells, extract, gmsh_session
from fenics_contact.geometry.outlines import (
    COINCIDENT,
    Polygons,
    Segments,
    divided_outlines,
    inside_outlines,
    outline_area,
    outline_problem,
    points_near_segments,
    sides_of_outlines,
    sides_on,
)
from fenics_contact.geometry.planar_cells import Array, Indices, sides_of

#: Corners this close to another block without touching it are told of, relative to the side of a
#: square of the blocks' mean area, or as far as mortar joints are thick.
GAP = 0.06


@checked
def model_from_arrays(
    points: npt.ArrayLike,
    cells: Mapping[str, npt.ArrayLike],
    facets: Mapping[str, npt.ArrayLike],
    name: str = "blocks",
) -> Any:
    """Make a gmsh model with named physical groups out of arrays.

    Args:
        points: Coordinates, shape (points, 2).
        cells: Nodes of the cells by group name, each of shape (cells, 3) or (cells, 4).
        facets: Nodes of facets by group name, each of shape (facets, 2).
        name: Name of the model.

    Raises:
        InputError: If an array has another shape, or numbers of nodes that are not there.
    """
    shape = np.shape(points)
    require(shape[1:] == (2,), f"points has the shape {shape}; give (points, 2)")
    given = []
    for key, dim, widths, groups in (("cells", 2, (3, 4), cells), ("facets", 1, (2,), facets)):
        wanted = " or ".join(f"({key}, {width})" for width in widths)
        for group, table in groups.items():
            array = np.asarray(table)
            if not array.size:
                continue
            good = array.ndim == 2 and array.shape[1] in widths
            require(good, f"{key}.{group} has the shape {array.shape}; give {wanted}")
            there = array.min() >= 0 and array.max() < shape[0]
            require(there, f"{key}.{group} has nodes that are not among {shape[0]} points")
            given.append((dim, group, array.astype(np.int64)))
    coordinates = np.pad(np.asarray(points, dtype=float), ((0, 0), (0, 1)))
    with gmsh_session() as gmsh:
        model = _new_model(gmsh, name)
        first = 1
        for dim, group, table in given:
            entity = model.addDiscreteEntity(dim)
            if first == 1:  # all nodes are classified on the first entity
                model.mesh.addNodes(dim, entity, [], coordinates.ravel())
            kind = table.shape[1] - 1  # gmsh's number of a line, triangle, quadrilateral
            tags = np.arange(first, first + len(table))
            first += len(table)
            model.mesh.addElementsByType(entity, kind, tags, table.ravel() + 1)
            model.setPhysicalName(dim, model.addPhysicalGroup(dim, [entity]), group)
        return model


def _new_model(gmsh: Any, name: str) -> Any:
    """An empty model in place of those of the same name."""
    while name in gmsh.model.list():
        gmsh.model.setCurrent(name)
        gmsh.model.remove()
    gmsh.model.add(name)
    return gmsh.model


@checked
def wall(
    courses: Sequence[Sequence[float]],
    block: tuple[float, float] = (0.4, 0.175),
    elements: int = 2,
    quadrilaterals: bool = False,
) -> Any:
    """Mesh a wall laid in courses.

    The groups are "blocks" (all cells) and, of facets, "base", "top", "left", "right" (outline),
    "bed" and "head" (both sides of horizontal and vertical joints), "opening" (other free edges).

    Args:
        courses: Block lengths of every course in units of the block, bottom first; a negative
            number is a void of that length.
        block: Length and height of one block, m.
        elements: Number of elements along half a block.
        quadrilaterals: In place of triangles.
    """
    length, height = block
    good = min(length, height) > 0.0 and elements >= 1
    require(good, "wall: block sizes and elements must be positive")
    ends = [np.cumsum([0.0, *np.abs(row)]) for row in courses]
    good = bool(ends) and all(np.all(np.diff(row) > 0.0) for row in ends)
    require(good, "wall: every course needs lengths other than zero")
    rectangles = [
        (left * length, level * height, right * length, (level + 1) * height)
        for level, (row, course) in enumerate(zip(ends, courses, strict=True))
        for left, right, size in zip(row[:-1], row[1:], course, strict=True)
        if size > 0.0
    ]
    require(bool(rectangles), "wall: there is no block, all lengths are negative")
    step = 0.5 * length / elements
    on_grid = np.concatenate(ends) * 2.0 * elements
    if np.allclose(on_grid, np.round(on_grid), rtol=0.0, atol=1e-9):
        steps = (step, height / max(1, round(height / step)))
        points, cells = _grid_wall(rectangles, steps, quadrilaterals)
    else:
        outlines = [[(x0, y0), (x1, y0), (x1, y1), (x0, y1)] for x0, y0, x1, y1 in rectangles]
        free = polygons(outlines, step, quadrilaterals=quadrilaterals)
        mesh = extract(free, "the wall")
        free.remove()
        points = mesh.points
        cells = mesh.cells
    return model_from_arrays(points, {"blocks": cells}, _groups_of_facets(points, cells), "wall")


@checked
def running_bond(
    bricks: int,
    courses: int,
    block: tuple[float, float] = (0.4, 0.2),
    elements: int = 2,
    quadrilaterals: bool = False,
) -> Any:
    """Mesh a `wall` in running bond with half bricks at the ends of every second course.

    The wall is `bricks` long and `courses` high; the other arguments are those of `wall`.
    """
    require(min(bricks, courses) >= 1, "running_bond: give at least one brick and one course")
    rows = ([1.0] * bricks, [0.5] + [1.0] * (bricks - 1) + [0.5])
    return wall([rows[level % 2] for level in range(courses)], block, elements, quadrilaterals)


def _grid_wall(
    rectangles: Sequence[tuple[float, float, float, float]],
    steps: tuple[float, float],
    quadrilaterals: bool,
) -> tuple[Array, Indices]:
    """Points and cells of rectangles (x0, y0, x1, y1) on one grid.

    Diagonals of triangles alternate so that no side is preferred.
    """
    points: list[Array] = []
    cells = []
    count = 0
    for x0, y0, x1, y1 in rectangles:
        nx = round((x1 - x0) / steps[0])
        ny = round((y1 - y0) / steps[1])
        x, y = np.meshgrid(np.linspace(x0, x1, nx + 1), np.linspace(y0, y1, ny + 1))
        points.append(np.column_stack([x.ravel(), y.ravel()]))
        grid = count + np.arange(x.size).reshape(x.shape)
        count += x.size
        around = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2)
        around = around.reshape(-1, 4)
        if not quadrilaterals:
            rising = np.indices((ny, nx)).sum(axis=0).reshape(-1, 1) % 2 == 0
            halves = np.where(rising, [0, 1, 2, 0, 2, 3], [0, 1, 3, 1, 2, 3])
            around = np.take_along_axis(around, halves, axis=1).reshape(-1, 3)
        cells.append(around)
    return np.concatenate(points), np.concatenate(cells)


def _groups_of_facets(points: Array, cells: Indices) -> dict[str, Indices]:
    """Sort the blocks' facets into joints (two coincide) and the outline of the wall."""
    from scipy.spatial import cKDTree

    facets = np.sort(sides_of(cells), axis=1)
    facets, count = np.unique(facets, axis=0, return_counts=True)
    facets = facets[count == 1]  # of one cell only: blocks share no nodes
    ends = points[facets]
    middle = ends.mean(axis=1)
    near = 1e-6 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min()
    joint = np.zeros(len(facets), dtype=bool)
    joint[cKDTree(middle).query_pairs(near, output_type="ndarray").ravel()] = True
    level = np.abs(ends[:, 1, 1] - ends[:, 0, 1]) <= near
    left, base = (middle <= points.min(axis=0) + near).T
    right, top = (middle >= points.max(axis=0) - near).T
    masks = {"bed": joint & level, "head": joint & ~level}
    masks |= {"base": ~joint & level & base, "top": ~joint & level & top}
    masks |= {"left": ~joint & ~level & left, "right": ~joint & ~level & right}
    masks["opening"] = ~np.any(list(masks.values()), axis=0)
    return {name: facets[mask] for name, mask in masks.items()}


@checked
def polygons(
    outlines: Sequence[npt.ArrayLike],
    size: float | Sequence[float] | None = None,
    names: Sequence[str] | None = None,
    groups: Segments | None = None,
    quadrilaterals: bool = False,
) -> Any:
    """Mesh straight-sided blocks given by their corners.

    Where a corner of one block lies on the side of another (a T-joint) that side gets a node
    there, and shared stretches are divided alike, so that facets on both sides coincide. With a
    size for every block they are meshed one by one, and nodes of joints do not match. Corners
    within `COINCIDENT` of each other become one. Sides are also divided at the ends of segments.

    Args:
        outlines: Corners of every block in order, either way round, each of shape (corners, 2), m.
        size: Of elements, one for all or one for every block; by default a quarter of the side of
            a square of the blocks' mean area.
        names: Two-dimensional group of every block; by default "blocks" for all.
        groups: Segments ((x0, y0), (x1, y1)) by name of the group of all sides that lie on them; by
            default, "base" is what lies at the least height of the drawing.
        quadrilaterals: In place of triangles.

    Raises:
        InputError: If a block has fewer than three corners or no area, crosses itself, or a group
            has no side.
    """
    blocks = [np.asarray(outline, dtype=float) for outline in outlines]
    given = np.atleast_1d(1.0 if size is None else size)
    good = bool(blocks) and bool(np.all((given > 0.0) & np.isfinite(given)))
    require(good, "polygons: give at least one block, and a positive size")
    for number, problem in enumerate(map(outline_problem, blocks)):
        require(not problem, f"polygons: block {number} {problem}")
    by_block = isinstance(size, Sequence)
    for some, what in ((names, "names"), (size if by_block else None, "sizes")):
        count = len(some) if isinstance(some, Sequence) else len(blocks)
        require(count == len(blocks), f"polygons: {count} {what} for {len(blocks)} blocks")
    names = ["blocks"] * len(blocks) if names is None else names
    groups = ground_level(blocks) if groups is None else groups
    sizes = np.broadcast_to(np.array(size or default_size(blocks)), len(blocks))
    divided, near = divided_outlines(blocks, groups)
    if by_block:  # without the corners of others
        divided = [divided_outlines([block], {})[0][0] for block in blocks]
    # Lengths are set on the sides; splitting triangles into quadrilaterals halves them.
    halved = {"SubdivisionAlgorithm": 1, "RecombineAll": 1} if quadrilaterals else {}
    with gmsh_session(MeshSizeMax=sizes.max(), **halved) as gmsh:
        model = _new_model(gmsh, "polygons")
        geo = model.geo
        surfaces: dict[str, list[int]] = {name: [] for name in names}
        sides: list[int] = []
        for block, name, length in zip(divided, names, sizes, strict=True):
            points = [geo.addPoint(x, y, 0.0) for x, y in block]
            lines = [geo.addLine(*pair) for pair in itertools.pairwise([*points, points[0]])]
            along = np.linalg.norm(np.roll(block, -1, axis=0) - block, axis=1)
            # Both blocks of a joint must come to the same number, whatever their rounding.
            counts = np.maximum(1, np.ceil(along / length - 1e-6).astype(int)) + 1
            for line, count in zip(lines, counts.tolist(), strict=True):
                geo.mesh.setTransfiniteCurve(line, count)
            surfaces[name].append(geo.addPlaneSurface([geo.addCurveLoop(lines)]))
            sides += lines
        geo.synchronize()
        on = sides_on(divided, groups, near)
        for dim, name, tags in (
            *((2, name, tags) for name, tags in surfaces.items()),
            *((1, name, np.array(sides)[some].tolist()) for name, some in on.items()),
        ):
            require(bool(tags), f"polygons: no side of a block lies on group '{name}'")
            model.setPhysicalName(dim, model.addPhysicalGroup(dim, tags), name)
        model.mesh.generate(2)
    return model


@checked
def default_size(blocks: Polygons) -> float:
    """A quarter of the side of a square of the blocks' mean area, m.

    Raises:
        InputError: If there is no block, or one has no corners (x, y).
    """
    good = len(blocks) > 0 and all(np.shape(block)[1:] == (2,) for block in blocks)
    require(good, "blocks: give at least one, each with corners of shape (corners, 2)")
    return 0.25 * float(np.sqrt(np.mean([abs(outline_area(block)) for block in blocks])))


def ground_level(blocks: Polygons) -> Segments:
    """The group "base" as a segment along the least height of blocks."""
    corners = np.concatenate(blocks)
    low = corners.min(axis=0)
    return {"base": [(low, (corners[:, 0].max(), low[1]))]}


@checked
def arch(
    voussoirs: int,
    thickness: float,
    radius: float = 1.0,
    embrace: float = 180.0,
    elements: int = 2,
    quadrilaterals: bool = False,
) -> Any:
    """Mesh an arch of equal voussoirs with straight sides and radial joints.

    The corners lie at radius -+ thickness / 2. The groups are "blocks", and of facets "springings"
    (both ends, to stand on rigid ground), "extrados" and "intrados".

    Args:
        voussoirs: Number of blocks.
        thickness: Of the ring, m.
        radius: Of the middle of the ring, m.
        embrace: Angle between the springings, degrees, at most 360.
        elements: Number of elements through the thickness.
        quadrilaterals: In place of triangles.

    Raises:
        InputError: If the thickness reaches the centre.
    """
    good = min(voussoirs, elements) >= 1 and 0.0 < embrace <= 360.0
    require(good, "arch: voussoirs, elements and embrace must be positive")
    good = 0.0 < thickness < 2.0 * radius
    require(good, "arch: the thickness must lie between 0 and twice the radius")
    half = 0.5 * np.radians(embrace)
    angles = np.pi / 2.0 + np.linspace(half, -half, voussoirs + 1)
    ray = np.column_stack([np.cos(angles), np.sin(angles)])
    inner = (radius - 0.5 * thickness) * ray
    outer = (radius + 0.5 * thickness) * ray
    groups = {
        "springings": [(inner[0], outer[0]), (inner[-1], outer[-1])],
        "intrados": list(itertools.pairwise(inner)),
        "extrados": list(itertools.pairwise(outer)),
    }
    blocks = blocks_between(inner, outer)
    return polygons(blocks, thickness / elements, None, groups, quadrilaterals)


def blocks_between(low: Array, high: Array) -> Polygons:
    """Blocks in a row between two lines, each of shape (blocks + 1, 2): four corners of each."""
    return list(np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1))


@checked
def wedge(
    half_angle: float,
    height: float = 0.5,
    length: float = 3.0,
    size: float = 0.25,
    quadrilaterals: bool = False,
) -> Any:
    """Mesh a symmetric wedge, tip down, between two blocks that stand on the ground.

    The groups are "blocks" and "wedge", and of facets "base" (under the blocks), "top" (of the
    wedge) and "flanks" (both sides of the joints).

    `half_angle` is half the angle at the tip, degrees, `height` that of wedge and blocks, m, and
    `length` that of a block along the ground, m, at least half the width of the wedge.
    """
    half = height * np.tan(np.radians(half_angle)) if 0.0 < half_angle < 90.0 else np.inf
    good = height > 0.0 and 0.0 < half < length
    require(good, "wedge: the sizes must be positive and the wedge narrower than the blocks")
    left = (-half, height)
    right = (half, height)
    tip = (0.0, 0.0)
    ground = [(-length, 0.0), (length, 0.0)]
    blocks = [
        [ground[0], tip, left, (-length, height)],
        [tip, ground[1], (length, height), right],
        [tip, right, left],
    ]
    groups: Segments = {
        "base": [ground],
        "top": [(left, right)],
        "flanks": [(tip, left), (tip, right)],
    }
    return polygons(blocks, size, ["blocks", "blocks", "wedge"], groups, quadrilaterals)


@checked
def buttress(
    courses: int,
    wall_width: float = 1.0,
    foot: float = 1.0,
    height: float = 0.5,
    size: float = 0.25,
    quadrilaterals: bool = False,
) -> Any:
    """Mesh a wall in courses with a buttress of raking courses that leans on it.

    The buttress is a triangle on the right of the wall, cut by level joints. The groups are "wall"
    and "buttress", and of facets "base", "left" (the wall's free face) and "back" (both sides of
    the joint between wall and buttress).

    There are `courses` of either, each `height` high; `wall_width` and `foot` are the widths of the
    wall and of the buttress at the ground, m.
    """
    good = courses >= 1 and min(wall_width, foot, height) > 0.0
    require(good, "buttress: courses and sizes must be positive")
    total = courses * height
    blocks: list[list[tuple[float, float]]] = []
    for low, high in itertools.pairwise(height * np.arange(courses + 1)):
        blocks.append([(0.0, low), (wall_width, low), (wall_width, high), (0.0, high)])
        right, above = (wall_width + foot * (1.0 - level / total) for level in (low, high))
        corners = [(wall_width, low), (right, low), (above, high), (wall_width, high)]
        blocks.append(corners if high < total else corners[:3])  # the last one is a triangle
    groups = {
        "base": [((0.0, 0.0), (wall_width + foot, 0.0))],
        "left": [((0.0, 0.0), (0.0, total))],
        "back": [((wall_width, 0.0), (wall_width, total))],
    }
    return polygons(blocks, size, ["wall", "buttress"] * courses, groups, quadrilaterals)


# ---- drawings


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

    def __post_init__(self) -> None:
        check_types(self)

    @checked
    def with_group(self, name: str, *segments: npt.ArrayLike) -> Drawing:
        """The drawing with one more group, of what lies on `segments`; see `groups`."""
        return replace(self, groups={**self.groups, name: segments})

    @checked
    def mesh(self, size: float | None = None, quadrilaterals: bool = False) -> Any:
        """Gmsh model of the drawing; arguments and errors are those of `polygons`."""
        return polygons(self.blocks, size, self.names, self.groups, quadrilaterals)

    def lengths(self) -> dict[str, float]:
        """Length of the sides in every group, m, both sides where blocks touch."""
        blocks, near = divided_outlines(list(self.blocks), self.groups)
        sides = np.linalg.norm(np.diff(sides_of_outlines(blocks), axis=1)[:, 0], axis=1)
        found = sides_on(blocks, self.groups, near)
        return {name: float(sides[on].sum()) for name, on in found.items()}

    def gaps(self, thickness: float = 0.0) -> Array:
        """Corners that lie close to another block without touching it, shape (corners, 4).

        The columns are x, y and the distance, m, and 1 where it is the distance of a side that the
        corner faces, 0 where the nearest is another corner; see `GAP`. `thickness` is
        that of mortar joints, m.
        """
        blocks, near = divided_outlines(list(self.blocks), {})
        ends = sides_of_outlines(blocks)
        owner = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])
        reach = max(4.0 * GAP * default_size(blocks), 1.01 * thickness)
        corners = np.unique(ends[:, 0], axis=0)
        pairs = points_near_segments(corners, ends, reach)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[pairs.segment]
        beyond = np.abs(pairs.at - np.clip(pairs.at, 0.0, 1.0)) * length
        order = np.lexsort([beyond > near, pairs.distance, owner[pairs.segment], pairs.point])
        key = np.column_stack([pairs.point, owner[pairs.segment]])[order]
        first = order[np.any(np.diff(key, axis=0, prepend=-1) != 0, axis=1)]  # of corner and block
        first = first[pairs.distance[first] > near]
        place = corners[pairs.point[first]]
        middle = place + 0.5 * pairs.way[first]
        empty = inside_outlines(middle, blocks) < 0  # between corner and block there is no block
        empty[points_near_segments(middle, ends, near).point] = False
        rows = np.column_stack([place, pairs.distance[first], beyond[first] <= near])
        return rows[empty]


def drawing_of(mesh: GmshMesh) -> Drawing:
    """Outlines of the blocks of a mesh, and its groups, without nodes within straight sides.

    Raises:
        InputError: If a block has a hole.
    """
    from shapely.geometry import MultiLineString, Polygon
    from shapely.ops import linemerge, unary_union

    near = COINCIDENT * float(np.ptp(mesh.points, axis=0).max())
    body = bodies_of_cells(mesh)
    _, first = np.unique(body, return_index=True)
    outlines = []
    for cells in (mesh.cells[body == number] for number in range(len(first))):
        whole = unary_union([Polygon(corners) for corners in mesh.points[cells]])
        outline = whole.normalize().simplify(near)
        x, y = mesh.points[cells[0, 0]]
        text = f"{mesh.source}: the block at ({x:g}, {y:g}) has a hole; draw it as two halves"
        require(outline.geom_type == "Polygon" and not outline.interiors, text)
        outlines.append(np.array(outline.exterior.coords)[:-1])
    groups: dict[str, list[Any]] = {}
    for number, names in enumerate(mesh.facet_sets):
        facets = mesh.points[mesh.facets[mesh.facet_groups == number]]
        merged = linemerge(MultiLineString(list(facets))).simplify(near)
        for line in getattr(merged, "geoms", [merged]):
            for name in names:
                groups.setdefault(name, []).extend(itertools.pairwise(np.array(line.coords)))
    kinds = [min(mesh.cell_sets[number]) for number in mesh.cell_groups[first]]
    return Drawing(outlines, kinds, groups)
