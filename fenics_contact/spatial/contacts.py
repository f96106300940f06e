"""Where blocks touch: common parts of sides that face each other, by clipping convex polygons.

Convex bodies that do not overlap are separated by the plane of a side, or by one along an edge of
each. They touch in a polygon if two sides that face each other are such planes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.errors import require
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import connected, near_pairs
from fenics_contact.spatial.polyhedra import Block, Polyhedron

#: Sides this far apart touch, and blocks may overlap by it, in parts of the thinner's thickness.
APART = 5e-4
#: A contact must be wider than this; it is a sliver otherwise, an edge below the distance above.
NARROW = 2e-3
#: Sides that face each other within this distance, and do not touch, are told of.
NEARLY = 0.1
#: Cosine of the largest angle between sides that face each other.
FACING = np.cos(np.radians(2.0))

#: What is wrong with two blocks (or one), by a measure in m; the last ones are warned of.
REFUSED = {
    "same": "blocks '{0}' and '{1}' are the same{more}: leave one out",
    "pieces": "pieces of block '{0}' overlap by {by:.3g} m{more}: cut them apart",
    "overlap": "blocks '{0}' and '{1}' overlap by {by:.3g} m{more}: move them apart, or set"
    " tolerance = {above:.3g}",
}
TOLD = {
    "gap": "sides of blocks '{0}' and '{1}' are {by:.3g} m apart{more}: no force passes; if they"
    " touch, set tolerance = {above:.3g}",
    "sliver": "the contact of blocks '{0}' and '{1}' is {by:.3g} m wide{more}: it is left out",
    "warped": "sides of block '{0}' are warped by {by:.3g} m{more}: they are taken as plane",
    "alone": "block '{0}' touches nothing{more}: it falls, if no tie holds it",
    "loose": "block '{0}' touches others, but none of them is held by a fixed block{more}",
}


@dataclass(frozen=True)
class Contact:
    """A convex polygon in which two blocks touch.

    Attributes:
        first: Number of a block.
        second: Number of the other one.
        axes: Unit normal from the first to the second, and two tangents, shape (3, 3).
        corners: m, counterclockwise about the normal, shape (corners, 3).
    """

    first: int
    second: int
    axes: Array
    corners: Array

    @property
    def in_plane(self) -> Array:
        """Corners from the first one along the tangents, m, shape (corners, 2)."""
        return np.asarray((self.corners - self.corners[0]) @ self.axes[1:].T)

    @property
    def area(self) -> float:
        """m2."""
        return polygon_area(self.in_plane)


def checked_contacts(
    blocks: Sequence[Block], tolerance: float | None = None
) -> tuple[tuple[Contact, ...], tuple[str, ...]]:
    """All contacts between blocks of which one moves at least, and what is odd about them.

    Args:
        blocks: Bodies; those of the same block may touch each other.
        tolerance: Sides touch that are as near as this, m; by default a part of the thickness of
            the thinner body.

    Returns:
        Contacts, sorted by numbers of blocks, and warnings.

    Raises:
        InputError: If blocks overlap by more than the tolerance.
    """
    pieces = [piece for block in blocks for piece in block.pieces]
    owner = np.repeat(np.arange(len(blocks)), [len(block.pieces) for block in blocks]).tolist()
    fixed = np.array([block.fixed for block in blocks])
    contacts = []
    found = defaultdict(list)  # measures and numbers of blocks by what is wrong with them
    for one, two in _near_pieces(pieces, tolerance).tolist():
        first, second = owner[one], owner[two]
        if (fixed[first] and fixed[second]) or (first == second and blocks[first].cut):
            continue
        for kind, measure, axes, corners in _meetings(pieces[one], pieces[two], tolerance):
            if first == second:
                kind = "pieces" if kind in REFUSED else "within"
            if kind == "contact":
                contacts.append(Contact(first, second, axes, corners))
            found[kind].append((measure, first, second))
    for number, piece in zip(owner, pieces, strict=True):
        if piece.warp > APART * piece.thickness:
            found["warped"].append((piece.warp, number, number))
    pairs = np.array([[contact.first, contact.second] for contact in contacts], dtype=np.int64)
    label = connected(pairs.reshape(-1, 2), len(blocks))
    for number in np.flatnonzero(~np.isin(label, label[fixed])).tolist():
        found["loose" if number in pairs else "alone"].append((-number, number, number))
    warnings = []
    for kind, text in (REFUSED | TOLD).items():
        if kind in found:
            measure, first, second = max(found[kind])
            more = f" (and {len(found[kind]) - 1} more)" if len(found[kind]) > 1 else ""
            names = (blocks[first].name, blocks[second].name)
            warnings.append(text.format(*names, by=measure, above=1.01 * measure, more=more))
            require(kind in TOLD, warnings[-1])
    return tuple(contacts), tuple(warnings)


def _near_pieces(pieces: Sequence[Polyhedron], tolerance: float | None) -> Indices:
    """Sorted pairs of bodies whose boxes are as near as sides that are told of."""
    low = np.array([piece.corners.min(axis=0) for piece in pieces])
    high = np.array([piece.corners.max(axis=0) for piece in pieces])
    reach = np.maximum([NEARLY * piece.thickness for piece in pieces], tolerance or 0.0)
    radius = 0.5 * np.linalg.norm(high - low, axis=1) + reach
    every = np.arange(len(pieces))
    portions = near_pairs(0.5 * (low + high), radius, every, every)
    pairs = np.concatenate([np.stack(portion, axis=1) for portion in portions])
    one, two = pairs.T
    apart = np.maximum(low[one] - high[two], low[two] - high[one]).max(axis=1)
    close = (one < two) & (apart <= np.minimum(reach[one], reach[two]))
    return np.unique(pairs[close], axis=0)


def _meetings(
    one: Polyhedron, two: Polyhedron, tolerance: float | None
) -> Iterator[tuple[str, float, Array, Array]]:
    """Where two bodies overlap, or have sides that face each other.

    Returns:
        "overlap", "gap", "sliver" or "contact"; depth, distance or width, m; axes and corners of
        the common polygon, halfway between the sides.
    """
    thinner = min(one.thickness, two.thickness)
    near = APART * thinner if tolerance is None else tolerance
    near += one.warp + two.warp
    nearly = max(NEARLY * thinner, near)
    beyond_one = (two.corners @ one.normals.T).min(axis=0) - one.levels
    beyond_two = (one.corners @ two.normals.T).min(axis=0) - two.levels
    apart = max(beyond_one.max(), beyond_two.max())
    if apart > nearly:
        return
    if apart < -near:
        depth = _depth(one, two)
        shift = np.linalg.norm(one.centroid - two.centroid)
        alike = shift < near and abs(one.volume - two.volume) < APART * one.volume
        if depth > near:
            yield "same" if alike else "overlap", depth, np.empty(0), np.empty(0)
        return
    separates = (beyond_one >= -near)[:, None] | (beyond_two >= -near)
    for side, opposite in np.argwhere(separates & (one.normals @ two.normals.T < -FACING)):
        normals = np.array([one.normals[side], two.normals[opposite]])
        levels = np.array([one.levels[side], two.levels[opposite]])
        loop = one.corners[list(one.sides[side])]
        other = two.corners[list(two.sides[opposite])][::-1]
        axes = frame(normals[0] - normals[1], loop[1] - loop[0])
        common = clipped((loop - loop[0]) @ axes[1:].T, (other - loop[0]) @ axes[1:].T, near)
        if len(common) < 3:
            continue
        corners = loop[0] + common @ axes[1:]
        height = (levels - corners @ normals.T) / (normals @ axes[0])
        distance = height[:, 1] - height[:, 0]
        corners = corners + np.outer(height.mean(axis=1), axes[0])
        width = polygon_width(common)
        if np.abs(distance).max() <= near:
            kind = "contact" if width > NARROW * thinner else "sliver"
            yield kind, width, axes, corners
        elif distance.min() >= -near and distance.max() < min(0.5 * width, nearly):
            yield "gap", float(distance.max()), axes, corners


def _depth(one: Polyhedron, two: Polyhedron) -> float:
    """Depth, m, by which bodies overlap; below 0 if they are apart.

    The distance from the origin to the outside of all differences of their points.
    """
    from scipy.spatial import ConvexHull

    differences = (one.corners[:, None] - two.corners).reshape(-1, 3)
    return -float(ConvexHull(differences).equations[:, 3].max())


def frame(normal: Array, along: Array) -> Array:
    """Unit vector of a normal and two tangents, right-handed, shape (3, 3).

    The first tangent is a direction less its part along the normal, so that axes turn with bodies.
    """
    up = normal / np.linalg.norm(normal)
    across = along - (along @ up) * up
    across = across / np.linalg.norm(across)
    return np.array([up, across, np.cross(up, across)])


def polygon_area(points: Array) -> float:
    """Area of a polygon, shape (corners, 2), positive if counterclockwise."""
    x, y = points.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def polygon_width(points: Array) -> float:
    """Least distance between two parallel lines that have a convex polygon between them."""
    along = np.roll(points, -1, axis=0) - points
    normal = np.stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)
    return float(np.ptp(points @ normal, axis=0).min())


def clipped(polygon: Array, by: Array, near: float = 1e-9) -> Array:
    """Part of a convex polygon inside another one, both counterclockwise; empty if there is none.

    Corners outside of it by less than `near`, m, are kept. Then corners are dropped that are as
    near to the line between their neighbours. Points are complex numbers here.
    I.E. Sutherland, G.W. Hodgman, Commun. ACM 17 (1974) 32.
    """
    points = (polygon @ [1.0, 1.0j]).tolist()
    lines = (by @ [1.0, 1.0j]).tolist()
    for start, end in zip(lines, lines[1:] + lines[:1], strict=True):
        heights = [_height(start, end, point) for point in points]
        kept = []
        for k, height in enumerate(heights):
            before = heights[k - 1]
            if min(height, before) < -near and max(height, before) > near:
                part = before / (before - height)
                kept.append(points[k - 1] + part * (points[k] - points[k - 1]))
            if height >= -near:
                kept.append(points[k])
        points = kept
    kept = []
    for k, point in enumerate(points):
        following = points[(k + 1) % len(points)]
        if _height((kept or points)[-1], following, point) < -near:
            kept.append(point)
    return np.array([[point.real, point.imag] for point in kept]).reshape(-1, 2)


def _height(start: complex, end: complex, point: complex) -> float:
    """Distance of a point to the left of a line; 0 if the line has no length."""
    along = end - start
    return (along.conjugate() * (point - start)).imag / (abs(along) or 1.0)
