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
from itertools import groupby
from typing import Any

import numpy as np

from fenics_contact.errors import require
from fenics_contact.geometry.mesh import Array
from fenics_contact.geometry.outlines import welded
from fenics_contact.geometry.planar_cells import SIZES, connected
from fenics_contact.spatial.contacts import APART
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
#: Lower side of the ground below a face, in parts of it: it touches what is above alone.
NARROWER = 0.9
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
        rounding: Distance of the numbers that the file can hold there, m; 0 if of no account.
        cells: See `Block`.
    """

    name: str
    faces: list[Any]
    group: str = "default"
    fixed: bool = False
    rounding: float = 0.0
    cells: Array | None = None


def is_flat(surface: Surface) -> bool:
    """Whether all faces of a surface lie in one plane, and it has an extent there."""
    points = np.vstack(surface.faces)
    if len(points) < 3 or not np.isfinite(points).all():
        return False
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(sizes[-1] <= FLAT * sizes[0] < sizes[1])


def ground_of(surface: Surface, blocks: Sequence[Block], source: str) -> Block:
    """The fixed block below a flat surface that blocks lie on.

    Raises:
        InputError: If none do, or they do on both sides; or if they are below it, along the axis
            to which it is nearest, and nothing says that it is ground.
    """
    points = np.vstack(surface.faces)
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][-1]
    across = points - np.outer((points - middle) @ normal, normal)
    thickness = []
    sides = set()
    for piece in (piece for block in blocks for piece in block.pieces):
        height = (piece.corners - middle) @ normal
        foot = piece.corners[np.abs(height) <= APART * piece.thickness]
        within = len(foot) > 2 and (foot.min(axis=0) <= across.max(axis=0)).all()
        if within and (foot.max(axis=0) >= across.min(axis=0)).all():
            thickness.append(piece.thickness)
            sides.add(float(np.sign(height.sum())))
    up = normal * (sides.pop() if len(sides) == 1 else 0.0)
    above = up.any() and (surface.fixed or up.max() > -up.min())
    where = f"{source}: block '{surface.name}'"
    require(bool(above), f"{where} has no volume; draw its whole surface, or delete it")
    down = -min(thickness) / 3.0 * up  # a plate of this depth has three times its thickness
    pieces = []
    for face in surface.faces:
        low = face.mean(axis=0) * (1.0 - NARROWER) + face * NARROWER + down
        pieces.append(Polyhedron.hull(np.vstack([face, low])))
        require(not pieces[-1].problem, f"{where} has a face without area; delete it")
        edges = np.roll(face, -1, axis=0) - middle
        area = 0.5 * abs(float(np.cross(face - middle, edges).sum(axis=0) @ normal))
        top = pieces[-1].areas[np.argmax(pieces[-1].normals @ up)]
        require(abs(top - area) < AREA * top, f"{where} has a face that is not convex; cut it")
    return Block(tuple(pieces), surface.name, surface.group, fixed=True)


def blocks_of(surface: Surface, source: str, left_out: Counter[str]) -> list[Block]:
    """Blocks of a surface: every closed set of faces is one.

    Faces that are there again are counted as left out.

    Raises:
        InputError: If there are none, or one is open, touches itself, or has no volume.
    """
    where = f"{source}: block '{surface.name}'"
    points = np.vstack([np.empty((0, 3)), *surface.faces])
    require(len(points) > 0, f"{where} has no faces; delete it, or draw its surface")
    finite = np.isfinite(points).all()
    require(bool(finite), f"{where} has a coordinate that is no number; draw it anew")
    width = np.ptp(points, axis=0).max()
    largest = np.abs(points).max()
    text = f"{where} is {width:g} m wide, {largest:g} m from the origin; give another unit"
    require(SIZES[0] <= width and largest <= SIZES[1], text)
    points, place = welded(points, WELD * width)
    loops: list[Loop] = []
    for numbers in np.split(place, np.cumsum([len(face) for face in surface.faces])[:-1]):
        loop = tuple(k for k, _ in groupby(numbers.tolist()))
        loop = loop[:-1] if loop[:1] == loop[-1:] else loop
        if len(set(loop)) > 2:
            loops.append(loop)
    once = _once(loops)
    left_out["faces written again"] += len(loops) - len(once)
    bodies = _bodies(once)
    require(bool(bodies), f"{where} has no faces with an area; draw it anew")
    blocks = []
    for number, body in enumerate(bodies, start=1):
        name = surface.name if len(bodies) == 1 else f"{surface.name} {number}"
        pieces = _pieces_of(points, body, f"{source}: block '{name}'")
        for piece in pieces:
            require(not piece.problem, f"{source}: block '{name}': {piece.problem}")
            rough = f"{surface.rounding:.2g} m, too far from the origin for its numbers"
            text = f"{source}: block '{name}' has corners rounded to {rough}; save it nearer to it"
            require(surface.rounding <= APART * piece.thickness, f"{text}, or as text")
        cells = surface.cells if len(bodies) == 1 else None
        parts = tuple(pieces), name, surface.group, surface.fixed, len(pieces) > 1
        blocks.append(Block(*parts, cells))
    return blocks


def _once(loops: list[Loop]) -> list[Loop]:
    """Faces without those written again, if that closes the surface: bodies may share a face."""
    once = list({frozenset(loop): loop for loop in loops}.values())
    edges = Counter(edge for loop in once for edge in edges_of(loop))
    return once if set(edges.values()) == {2} else loops


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
            pieces.append(Polyhedron.hull(welded(corners, flat)[0]))
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
