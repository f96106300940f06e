"""From faces as files have them to rigid blocks: welded, closed, with plane convex pieces.

A convex body is the hull of its points: its sides are the hull's, however its faces are cut up or
turned. A body that is not convex is cut along planes of its own faces (a binary space partition, H.
Fuchs, Z.M. Kedem, B.F. Naylor, SIGGRAPH 1980, 124); a cell is a piece of it where a ray from its
middle crosses the surface an odd number of times.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Any

import numpy as np

from fenics_contact.errors import require
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import SIZES, connected
from fenics_contact.spatial.polyhedra import Block, PlaneSides, Polyhedron

#: Points of a surface that are nearer to each other than this are one, in parts of its width.
WELD = 1e-6
#: Points lie in a plane up to this distance, in parts of the width of their body.
FLAT = 1e-5
#: Sides of four corners and more may be bent by this, and are made plane; beyond they are folded.
BENT = 0.1
#: Area of faces that may be missing or too much, and volume of a body that has none, relative.
AREA = 1e-4
VOLUME = 1e-8
#: Parts of an edge, at its ends, that may be on other sides.
BARELY = 1e-6
#: Convex pieces of a body.
MOST_PIECES = 200
#: Direction of a ray that meets no edge of what people draw.
RAY = np.array([0.4791, 0.5417, 0.6907])

Loop = tuple[int, ...]


@dataclass(frozen=True)
class Surface:
    """Faces of one block, or of several one after the other.

    Attributes:
        name: Of the block.
        points: m, shape (points, 3).
        loops: Corners of the faces, in either sense.
        group: Key of materials and joints.
        fixed: Whether the block is ground.
    """

    name: str
    points: Array
    loops: Sequence[Sequence[int]]
    group: str = "default"
    fixed: bool = False


def blocks_of(surface: Surface, source: str) -> list[Block]:
    """Blocks of a surface: every closed set of faces is one.

    Raises:
        InputError: If there are none, or one is open, touches itself, or has no volume.
    """
    where = f"{source}: block '{surface.name}'"
    require(len(surface.loops) > 0, f"{where} has no faces; delete it, or draw its surface")
    points = surface.points
    finite = np.isfinite(points).all()
    require(bool(finite), f"{where} has a coordinate that is no number; draw it anew")
    width = np.ptp(points, axis=0).max()
    largest = np.abs(points).max()
    text = f"{where} is {width:g} m wide, {largest:g} m from the origin; give another unit"
    require(SIZES[0] <= width and largest <= SIZES[1], text)
    points, place = _welded(points, WELD * width)
    loops: list[Loop] = []
    for given in surface.loops:
        loop = tuple(k for k, _ in groupby(place[list(given)].tolist()))
        loop = loop[:-1] if loop[:1] == loop[-1:] else loop
        if len(set(loop)) > 2:
            loops.append(loop)
    bodies = _bodies(loops)
    require(bool(bodies), f"{where} has no faces with an area; draw it anew")
    blocks = []
    for number, body in enumerate(bodies, start=1):
        name = surface.name if len(bodies) == 1 else f"{surface.name} {number}"
        pieces = _pieces_of(points, body, f"{source}: block '{name}'")
        for piece in pieces:
            require(not piece.problem, f"{source}: block '{name}': {piece.problem}")
        blocks.append(Block(tuple(pieces), name, surface.group, surface.fixed))
    return blocks


def _welded(points: Array, near: float) -> tuple[Array, Indices]:
    """Points of which none are near each other, and the number in them of every point given."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(near, output_type="ndarray")
    label = connected(pairs, len(points))
    _, first, number = np.unique(label, return_index=True, return_inverse=True)
    return points[first], number


def edges_of(loop: Loop) -> list[tuple[int, int]]:
    """Edges of a face, the smaller number first."""
    return [(min(a, b), max(a, b)) for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]


def _bodies(loops: list[Loop]) -> list[list[Loop]]:
    """Faces by body: those that close, one after the other, and in each those joined by edges."""
    closed: list[list[Loop]] = [[]]
    once: set[tuple[int, int]] = set()
    for loop in loops:
        closed[-1].append(loop)
        for edge in edges_of(loop):
            once ^= {edge}
        if not once and len(closed[-1]) > 3:
            closed.append([])
    bodies = []
    known: set[frozenset[int]] = set()
    for several in closed:
        faces = {frozenset(loop) for loop in several}
        if faces <= known:  # drawn twice, or none
            continue
        known |= faces
        first: dict[tuple[int, int], int] = {}
        pairs = [(first.setdefault(e, k), k) for k, x in enumerate(several) for e in edges_of(x)]
        label = connected(np.array(pairs), len(several))
        bodies += [[several[k] for k in np.flatnonzero(label == one)] for one in np.unique(label)]
    return bodies


def _pieces_of(points: Array, loops: list[Loop], where: str) -> list[Polyhedron]:
    """Convex pieces of a body: one, if it is convex."""
    used, numbers = np.unique(np.concatenate(loops), return_inverse=True)
    ends = np.cumsum([0, *map(len, loops)])
    loops = [tuple(numbers[start:end].tolist()) for start, end in pairwise(ends)]
    points = points[used]
    size = np.ptp(points, axis=0).max()
    hull = _hull(points, size)
    require(hull is not None, f"{where} has no volume; draw its whole surface, or delete it")
    on = np.abs(hull.equations[:, :3] @ points.T + hull.equations[:, 3:]) <= FLAT * size
    if all(on[:, loop].all(axis=1).any() for loop in loops):
        area = PlaneSides(points, loops).areas.sum()
        text = f"has faces of {area:.4g} m2 for a surface of {hull.area:.4g} m2"
        cure = "draw those that are missing" if area < hull.area else "delete those drawn twice"
        require(abs(area - hull.area) < AREA * hull.area, f"{where} {text}; {cure}")
        return [_convex(points, loops)]
    uses = Counter(edge for loop in loops for edge in edges_of(loop)).most_common()
    cure = "close its surface, or give every block a layer, object or file of its own"
    for edge, count in (uses[-1], uses[0]):
        x, y, z = points[list(edge)].mean(axis=0)
        text = f"has an edge of {count} faces instead of two, at ({x:g}, {y:g}, {z:g}); {cure}"
        require(count == 2, f"{where} {text}")
    planes = PlaneSides(points, loops)
    bent = np.abs(planes.heights[planes.at_sides]).max() / size
    body = Polyhedron(points, tuple(loops)) if bent > WELD else None
    if body is not None and body.problem and bent < BENT:
        body = _between(planes, hull, size)
    if body is not None and not body.problem:
        return [body]
    return _cut(points, loops, hull, where, size)


def _hull(points: Array, size: float) -> Any:
    """Convex hull of points; None if it has no volume to speak of."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points - points[0])
    except (QhullError, ValueError):  # too few points, or all in a plane
        return None
    if hull.volume < VOLUME * size**3:
        return None
    hull.equations[:, 3] -= hull.equations[:, :3] @ points[0]
    hull.corners = points
    return hull


def _convex(points: Array, loops: Sequence[Loop] = ()) -> Polyhedron:
    """The body around points; its corners are those of three of its sides at least."""
    body = Polyhedron(points, tuple(loops))
    if body.problem:  # it has no sides yet, or some end within others
        body = Polyhedron.hull(points)
    if body.problem:
        return body
    corner = np.bincount(np.concatenate(body.sides)) > 2
    simpler = body if corner.all() else Polyhedron.hull(body.corners[corner])
    same = not simpler.problem and abs(simpler.volume - body.volume) < AREA * body.volume
    return simpler if same else body


def _between(planes: PlaneSides, hull: Any, size: float) -> Polyhedron | None:
    """The body between the mean planes of bent sides; None if its corners are others.

    Blocks that share the corners of a bent side share its mean plane, too.
    """
    from scipy.spatial import HalfspaceIntersection, QhullError

    inside = hull.corners[hull.vertices].mean(axis=0)
    halfspaces = np.column_stack([planes.normals, -planes.levels])
    try:
        corners = HalfspaceIntersection(halfspaces, inside).intersections
    except (QhullError, ValueError):
        return None
    found = _hull(corners[np.isfinite(corners).all(axis=1)], size)
    for one, other in ((hull, found), (found, hull)):
        if found is None or _beyond(one.corners, other) > BENT * size:
            return None
    return _convex(found.corners)


def _beyond(points: Array, hull: Any) -> float:
    """How far the farthest of some points is outside a hull."""
    return float((points @ hull.equations[:, :3].T + hull.equations[:, 3]).max())


def _cut(points: Array, loops: list[Loop], hull: Any, where: str, size: float) -> list[Polyhedron]:
    """Convex pieces of a body that is not convex."""
    fans = [[(x[0], x[k], x[k + 1]) for k in range(1, len(x) - 1)] for x in loops]
    triangles = points[np.array([corner for fan in fans for corner in fan])]
    face = np.repeat(np.arange(len(fans)), [len(fan) for fan in fans])
    for start, end in {edge for loop in loops for edge in edges_of(loop)}:
        along, inner = _crossings(points[start], points[end] - points[start], triangles)
        hits = np.bincount(face, inner & (along > BARELY) & (along < 1.0 - BARELY))
        apart = np.array([start not in loop and end not in loop for loop in loops])
        text = "has a surface that cuts itself, or bent sides at a hollow; give them as triangles"
        require(not np.any(apart & (hits % 2 > 0.5)), f"{where} {text}")
    flat = FLAT * size
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-300)[:, None]
    heights = np.sum(normals * triangles[:, 0], axis=1)
    order = np.argsort(-areas)
    order = order[areas[order] > 1e-10 * size**2]
    cells = [hull]
    pieces: list[Polyhedron] = []
    while cells:
        cell = cells.pop()
        depth = triangles[order] @ cell.equations[:, :3].T + cell.equations[:, 3]
        through = order[(depth.min(axis=1) < -flat).all(axis=1)]
        corners = cell.corners[cell.vertices]
        above = normals[through] @ corners.T - heights[through, None]
        cuts = (above.max(axis=1) > flat) & (above.min(axis=1) < -flat)
        if not cuts.any():
            middle = corners.mean(axis=0)
            along, inner = _crossings(middle, RAY, triangles)
            thick = cell.volume > 10.0 * flat * cell.area
            if thick and np.sum(inner & (along > 0.0)) % 2:
                pieces.append(_convex(corners))
        else:
            first = np.argmax(cuts)
            halves = (
                _hull(_part(corners, sign * above[first], flat), size) for sign in (1.0, -1.0)
            )
            cells += [half for half in halves if half is not None]
        text = "give it as several blocks, or simpler"
        many = f"{where} is not convex and has more than {MOST_PIECES} convex pieces; {text}"
        require(len(pieces) + len(cells) <= MOST_PIECES, many)
    require(bool(pieces), f"{where} has no volume; draw its whole surface, or delete it")
    return pieces


def _part(corners: Array, above: Array, flat: float) -> Array:
    """Corners of a convex cell on the side of a plane where `above`, their height, is positive."""
    up = np.flatnonzero(above > flat)
    down = np.flatnonzero(above < -flat)
    share = above[up, None] / (above[up, None] - above[None, down])
    cut = corners[up, None] + share[..., None] * (corners[down] - corners[up, None])
    return np.vstack([corners[above >= -flat], cut.reshape(-1, 3)])


def _crossings(start: Array, along: Array, triangles: Array) -> tuple[Array, Any]:
    """Where a line meets the planes of triangles, in parts of `along`, and whether inside them.

    T. Moeller, B. Trumbore, J. Graphics Tools 2 (1997) 21.
    """
    one = triangles[:, 1] - triangles[:, 0]
    two = triangles[:, 2] - triangles[:, 0]
    across = np.cross(along, two)
    factor = np.sum(one * across, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        arm = start - triangles[:, 0]
        u = np.sum(arm * across, axis=1) / factor
        turned = np.cross(arm, one)
        v = turned @ along / factor
        place = np.sum(two * turned, axis=1) / factor
        inner = (u > 0.0) & (v > 0.0) & (u + v < 1.0)
    sizes = np.linalg.norm(one, axis=1) * np.linalg.norm(across, axis=1)
    return place, inner & (np.abs(factor) > 1e-9 * sizes)
