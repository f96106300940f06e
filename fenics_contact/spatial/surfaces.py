"""From faces as files have them to rigid blocks: welded, closed, with plane convex pieces.

A convex body is the hull of its points: its sides are the hull's, however its faces are cut up or
turned. A body that is not convex is cut along planes of its own faces (a binary space partition, H.
Fuchs, Z.M. Kedem, B.F. Naylor, SIGGRAPH 1980, 124); a cell is a piece of it where a ray from its
middle crosses the surface an odd number of times.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from fenics_contact.errors import require
from fenics_contact.geometry.mesh import Array
from fenics_contact.geometry.planar_cells import SIZES, connected
from fenics_contact.spatial.polyhedra import Block, PlaneSides, Polyhedron, edges_of, not_closed

#: Points of a surface that are nearer to each other than this are one, in parts of its width.
WELD = 1e-6
#: Points lie in a plane up to this distance, in parts of the width of their body.
FLAT = 1e-5
#: Sides of four corners and more may be bent by this, and are made plane; beyond they are folded.
BENT = 0.1
#: Area of faces that may be missing or too much, and volume of a body that has none, relative.
AREA = 1e-4
VOLUME = 1e-8
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
        faces: Their corners, m, in either sense, each of shape (corners, 3).
        group: Key of materials and joints.
        fixed: Whether the block is ground.
    """

    name: str
    faces: list[Any]
    group: str = "default"
    fixed: bool = False


def blocks_of(surface: Surface, source: str) -> list[Block]:
    """Blocks of a surface: every closed set of faces is one.

    Raises:
        InputError: If there are none, or one is open, touches itself, or has no volume.
    """
    from scipy.spatial import cKDTree

    where = f"{source}: block '{surface.name}'"
    points = np.vstack([np.empty((0, 3)), *surface.faces])
    require(len(points) > 0, f"{where} has no faces; delete it, or draw its surface")
    finite = np.isfinite(points).all()
    require(bool(finite), f"{where} has a coordinate that is no number; draw it anew")
    width = np.ptp(points, axis=0).max()
    largest = np.abs(points).max()
    text = f"{where} is {width:g} m wide, {largest:g} m from the origin; give another unit"
    require(SIZES[0] <= width and largest <= SIZES[1], text)
    near = cKDTree(points).query_pairs(WELD * width, output_type="ndarray")
    label = connected(near, len(points))
    _, first, place = np.unique(label, return_index=True, return_inverse=True)
    points = points[first]
    loops: list[Loop] = []
    for numbers in np.split(place, np.cumsum([len(face) for face in surface.faces])[:-1]):
        loop = tuple(k for k, _ in groupby(numbers.tolist()))
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
        cut = len(pieces) > 1
        blocks.append(Block(tuple(pieces), name, surface.group, surface.fixed, cut))
    return blocks


def _bodies(loops: list[Loop]) -> list[list[Loop]]:
    """Faces by body: every edge joins two of them; where it is used again it is another body's."""
    once: dict[tuple[int, int], int] = {}
    pairs = []
    for number, loop in enumerate(loops):
        for edge in edges_of(loop):
            if edge in once:
                pairs.append((once.pop(edge), number))
            else:
                once[edge] = number
    label = connected(np.array(pairs, dtype=np.int64).reshape(-1, 2), len(loops))
    return [[loops[k] for k in np.flatnonzero(label == one)] for one in np.unique(label)]


def _pieces_of(points: Array, loops: list[Loop], where: str) -> list[Polyhedron]:
    """Convex pieces of a body: one, if it is convex."""
    used, numbers = np.unique(np.concatenate(loops), return_inverse=True)
    ends = np.cumsum([len(loop) for loop in loops])[:-1]
    loops = [tuple(loop.tolist()) for loop in np.split(numbers, ends)]
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
        return [Polyhedron.hull(points)]
    problem = not_closed(points, loops)
    cure = "close its surface, or give every block a layer, object or file of its own"
    require(not problem, f"{where} {problem}; {cure}")
    planes = PlaneSides(points, loops)
    bent = np.abs(planes.heights[planes.at_sides]).max() / size
    if WELD < bent < BENT:
        for body in (Polyhedron(points, loops), _between(planes, points, hull.volume)):
            if not body.problem:
                return [body]
    return _cut(points, loops, where, size)


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
    return hull


def _between(planes: PlaneSides, points: Array, volume: float) -> Polyhedron:
    """The body between the mean planes of bent sides of a hull; a problem if it is another one.

    Blocks that share the corners of a bent side share its mean plane, too.
    """
    from scipy.spatial import HalfspaceIntersection, QhullError

    halfspaces = np.column_stack([planes.normals, -planes.levels])
    try:
        corners = HalfspaceIntersection(halfspaces, points.mean(axis=0)).intersections
    except (QhullError, ValueError):
        corners = points[:0]
    body = Polyhedron.hull(corners)
    same = not body.problem and abs(body.volume - volume) < BENT * volume
    return body if same else Polyhedron(points, ())


def _cut(points: Array, loops: list[Loop], where: str, size: float) -> list[Polyhedron]:
    """Convex pieces of a body that is not convex."""
    triangles = points[[(x[0], *x[k : k + 2]) for x in loops for k in range(1, len(x) - 1)]]
    flat = FLAT * size
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    order = np.argsort(-areas)
    order = order[areas[order] > 1e-10 * size**2]
    normals, large = normals[order] / areas[order, None], triangles[order]
    heights = np.sum(normals * large[:, 0], axis=1)
    cells = [points]
    pieces: list[Polyhedron] = []
    while cells:
        corners = cells.pop()
        hull = _hull(corners, size)
        if hull is None:
            continue
        corners = corners[hull.vertices]
        depth = large @ hull.equations[:, :3].T + hull.equations[:, 3]
        through = (depth.min(axis=1) < -flat).all(axis=1)
        above = normals[through] @ corners.T - heights[through, None]
        cuts = (above.max(axis=1) > flat) & (above.min(axis=1) < -flat)
        if cuts.any():
            height = above[np.argmax(cuts)]
            cells += [_part(corners, sign * height, flat) for sign in (1.0, -1.0)]
        elif hull.volume > 10.0 * flat * hull.area and _inside(corners.mean(axis=0), triangles):
            pieces.append(Polyhedron.hull(corners))
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


def _inside(place: Array, triangles: Array) -> bool:
    """Whether a ray from a place crosses a surface an odd number of times."""
    a, b, c = np.moveaxis(triangles - place, 1, 0)
    turns = np.array([np.cross(p, q) @ RAY for p, q in ((a, b), (b, c), (c, a))])
    crossed = (turns > 0.0).all(axis=0) | (turns < 0.0).all(axis=0)
    ahead = np.linalg.det(triangles - place) * turns.sum(axis=0) > 0.0
    return bool(np.sum(crossed & ahead) % 2)
