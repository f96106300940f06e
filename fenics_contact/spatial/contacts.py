"""Where blocks touch: common parts of sides that face each other, by clipping convex polygons.

Convex bodies that do not overlap are separated by the plane of a side, or by one along an edge of
each. They touch in a polygon if two sides that face each other are such planes, else in an edge or
a corner (`edges`).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.errors import require
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import connected, near_pairs
from fenics_contact.spatial import edges
from fenics_contact.spatial.edges import FACING
from fenics_contact.spatial.polyhedra import Block, Polyhedron

#: Sides this far apart touch, and blocks may overlap by it, in parts of the thinner's thickness.
APART = 5e-4
#: A contact must be wider than this; it is a sliver otherwise, an edge below the distance above.
NARROW = 2e-3
#: Sides that face each other within this distance, and do not touch, are told of.
NEARLY = 0.1
#: Pairs of blocks that are named beside the worst one.
NAMED = 5

#: What is wrong with two blocks (or one), by a measure in m; the last ones are warned of.
REFUSED = {
    "same": "blocks '{0}' and '{1}' are the same{more}: leave one out",
    "pieces": "pieces of block '{0}' overlap by {by:.3g} m{more}: cut them apart",
    "deep": "blocks '{0}' and '{1}' overlap by {by:.3g} m{more}: move them apart",
    "overlap": "blocks '{0}' and '{1}' overlap by {by:.3g} m{more}: move them apart, or set"
    " tolerance = {above:.3g}",
}
TOLD = {
    "doubt": "blocks '{0}' and '{1}' touch in an edge or corner{more} where more than one plane"
    " parts them: how they press is not known, nothing that falls is proved",
    "edge": "blocks '{0}' and '{1}' touch in an edge or corner{more}: it carries, without cohesion,"
    " tensile strength or crushing",
    "gap": "sides of blocks '{0}' and '{1}' are {by:.3g} m apart{more}: no force passes; if they"
    " touch, set tolerance = {above:.3g}",
    "off": "an edge or corner of blocks '{0}' and '{1}' is {by:.3g} m off the other one{more}: no"
    " force passes; if they touch, set tolerance = {above:.3g}",
    "inclined": "sides of blocks '{0}' and '{1}' are inclined by {by:.3g} degrees{more}: they touch"
    " in an edge; if they lie on each other, make them parallel",
    "sliver": "the contact of blocks '{0}' and '{1}' is {by:.3g} m wide{more}: it is left out",
    "warped": "sides of block '{0}' are warped by {by:.3g} m{more}: they are taken as plane",
    "alone": "block '{0}' touches nothing{more}: it falls, if no tie holds it",
    "loose": "block '{0}' touches others, but none of them is held by a fixed block{more}",
}


class Doubt(str):
    """A warning of what is not understood: no block is proved to fall while it stands."""


@dataclass(frozen=True)
class Contact:
    """A convex polygon in which two blocks touch, or an edge or corner, which has no area.

    Attributes:
        first: Number of a block.
        second: Number of the other one.
        axes: Unit normal from the first to the second, and two tangents, shape (3, 3).
        corners: m, counterclockwise about the normal, shape (corners, 3); two ends of an edge, or
            one corner.
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

    def covers(self, point: Array, near: float) -> bool:
        """Whether a point is nearer to it than `near`, m, across its plane and in it."""
        if len(self.corners) < 3:
            return bool(np.linalg.norm(self.corners - point, axis=1).min() <= near)
        off, *at = self.axes @ (point - self.corners[0])
        lines = [complex(*corner) for corner in self.in_plane]
        inside = (_height(lines[k - 1], end, complex(*at)) >= -near for k, end in enumerate(lines))
        return abs(off) <= near and all(inside)

    def within(self, others: Sequence[Contact], near: float) -> bool:
        """Whether all of its corners are in others."""
        return all(any(one.covers(point, near) for one in others) for point in self.corners)


#: Kind of a contact in an edge or corner, tolerance, m, and the contact.
Narrow = tuple[str, float, Contact]


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
    thickness = [block.thickness(piece) for block in blocks for piece in block.pieces]
    fixed = np.array([block.fixed for block in blocks])
    contacts = []
    narrow = []
    found = defaultdict(list)  # measures and numbers of blocks by what is wrong with them
    for one, two in _near_pieces(pieces, thickness, tolerance).tolist():
        first, second = owner[one], owner[two]
        cut = first == second and (fixed[first] or blocks[first].cut)
        if cut or pieces[two].under not in (None, pieces[one]):
            continue
        thinner = min(thickness[one], thickness[two])
        meetings = _meetings(pieces[one], pieces[two], thinner, tolerance)
        for kind, measure, axes, corners in meetings:
            if first == second:
                kind = "pieces" if kind in ("same", "overlap", "deep") else "within"
            if kind == "contact":
                contacts.append(Contact(first, second, axes, corners))
            elif fixed[first] and fixed[second]:
                continue
            elif kind in edges.KINDS:
                narrow.append((kind, measure, Contact(first, second, axes, corners)))
            else:
                found[kind].append((measure, first, second))
    for kind, measure, contact in (bare := _bare(contacts, narrow)):
        told = "doubt" if kind in ("doubt", "unclear") else "edge"
        found[told].append((measure, contact.first, contact.second))
        contacts += [contact] * (kind != "unclear")
    # Those of two fixed blocks only tell what lies around an edge.
    contacts = [one for one in contacts if not (fixed[one.first] and fixed[one.second])]
    if bare:
        contacts.sort(key=lambda contact: (contact.first, contact.second))
    carry = {(contact.first, contact.second) for _, _, contact in bare}
    found["inclined"] = [place for place in found["inclined"] if place[1:] in carry]
    for number, piece in zip(owner, pieces, strict=True):
        if piece.warp > APART * piece.thickness:
            found["warped"].append((piece.warp, number, number))
    met = [*contacts, *(contact for _, _, contact in bare)]
    pairs = np.array([[contact.first, contact.second] for contact in met], dtype=np.int64)
    label = connected(pairs.reshape(-1, 2), len(blocks))
    for number in np.flatnonzero(~np.isin(label, label[fixed])).tolist():
        found["loose" if number in pairs else "alone"].append((-number, number, number))
    return tuple(contacts), tuple(_told(found, [block.name for block in blocks]))


def _told(found: dict[str, list[tuple[float, int, int]]], names: Sequence[str]) -> Iterator[str]:
    """Warnings, by measures and numbers of blocks of what is wrong.

    Raises:
        InputError: If it is wrong enough; all places are counted, and some are named.
    """
    if found["deep"]:
        found["deep"] += found.pop("overlap", [])
    for kind, text in (REFUSED | TOLD).items():
        if places := sorted(set(found[kind]), reverse=True):
            by, *pair = places[0]
            more = f" (and {len(places) - 1} more)" if len(places) > 1 else ""
            told = text.format(*(names[k] for k in pair), by=by, above=1.01 * by, more=more)
            others = dict.fromkeys(f"'{names[a]}' and '{names[b]}'" for _, a, b in places)
            if len(others) > 1 and kind in {*REFUSED, "doubt", "edge"}:
                told += f"; likewise {', '.join([*others][1 : 1 + NAMED])}"
                told += ", ..." * (len(others) > 1 + NAMED)
            require(kind not in REFUSED, told)
            yield Doubt(told) if kind == "doubt" else told


def _bare(faces: Sequence[Contact], narrow: Sequence[Narrow]) -> list[Narrow]:
    """Contacts in edges and corners that are no part of polygons, or others, of the same blocks.

    Where several planes part two blocks, one counts if sides of one of them touch nothing at all
    there: stones around an edge hold each other by their sides.
    """
    touched = defaultdict(list)  # contacts of a block, and of a pair
    for face in faces if narrow else ():
        for key in (face.first, face.second, (face.first, face.second)):
            touched[key].append(face)
    bare = []
    for kind, near, edge in sorted(narrow, key=lambda one: -len(one[2].corners)):
        pair = edge.first, edge.second
        mine = [one for one in touched[pair] if one.area or one.axes[0] @ edge.axes[0] > FACING]
        around = all(edge.within(touched[block], near) for block in pair)
        if not (edge.within(mine, near) or (kind != "edge" and around)):
            touched[pair].append(edge)
            bare.append((kind, near, edge))
    return bare


def _near_pieces(
    pieces: Sequence[Polyhedron], thickness: Sequence[float], tolerance: float | None
) -> Indices:
    """Sorted pairs of bodies whose boxes are as near as sides that are told of."""
    low = np.array([piece.corners.min(axis=0) for piece in pieces])
    high = np.array([piece.corners.max(axis=0) for piece in pieces])
    reach = np.maximum(NEARLY * np.array(thickness), tolerance or 0.0)
    radius = 0.5 * np.linalg.norm(high - low, axis=1) + reach
    every = np.arange(len(pieces))
    portions = near_pairs(0.5 * (low + high), radius, every, every)
    pairs = np.concatenate([np.stack(portion, axis=1) for portion in portions])
    one, two = pairs.T
    apart = np.maximum(low[one] - high[two], low[two] - high[one]).max(axis=1)
    close = (one < two) & (apart <= np.minimum(reach[one], reach[two]))
    return np.unique(pairs[close], axis=0)


def _meetings(
    one: Polyhedron, two: Polyhedron, thinner: float, tolerance: float | None
) -> Iterator[tuple[str, float, Array, Array]]:
    """Where two bodies overlap, have sides that face each other, or touch in an edge or corner.

    Args:
        one: A body.
        two: Another one.
        thinner: Thickness of the thinner one, m.
        tolerance: See `checked_contacts`.

    Returns:
        "contact", a kind of `edges`, or a key of `REFUSED` or `TOLD`; depth, distance or width, m;
        axes and corners of the common polygon or edge, halfway between the bodies.
    """
    near = APART * thinner if tolerance is None else tolerance
    near += one.warp + two.warp
    nearly = max(NEARLY * thinner, near)
    beyond_one = (two.corners @ one.normals.T).min(axis=0) - one.levels
    beyond_two = (one.corners @ two.normals.T).min(axis=0) - two.levels
    apart = float(max(beyond_one.max(), beyond_two.max()))
    if apart > nearly:
        return
    met = False
    planes: list[edges.PartingPlane] = []
    if apart < -near:
        apart, planes = edges.planes_of_edges(one, two, near)
        if apart < -near:
            same = np.linalg.norm(one.centroid - two.centroid) < near
            same &= abs(one.volume - two.volume) < APART * one.volume
            kind = "overlap" if -apart <= NEARLY * thinner else "deep"
            yield "same" if same else kind, -apart, np.empty(0), np.empty(0)
            return
    separates = (beyond_one >= -near)[:, None] | (beyond_two >= -near)
    facing = np.argwhere(separates & (one.normals @ two.normals.T < -FACING))
    for side, opposite in facing:
        normals = np.array([one.normals[side], two.normals[opposite]])
        levels = np.array([one.levels[side], two.levels[opposite]])
        loop = one.corners[list(one.sides[side])]
        other = two.corners[list(two.sides[opposite])][::-1]
        axes = frame(normals[0] - normals[1], loop[1] - loop[0])
        flat = [(corners - loop[0]) @ axes[1:].T for corners in (loop, other)]
        common = clipped(flat[0], flat[1], near)
        if len(common) < 3:
            continue
        corners = loop[0] + common @ axes[1:]
        height = (levels - corners @ normals.T) / (normals @ axes[0])
        distance = height[:, 1] - height[:, 0]
        corners = corners + np.outer(height.mean(axis=1), axes[0])
        width = polygon_width(common)
        if np.abs(distance).max() <= near:
            if min(map(polygon_width, flat)) > NARROW * thinner:  # else a blunt edge
                met = True
                yield "contact" if width > NARROW * thinner else "sliver", width, axes, corners
        elif distance.min() >= -near and distance.max() < min(0.5 * width, nearly):
            yield "gap", float(distance.max()), axes, corners
    if met:
        return
    planes = planes or edges.planes_of_sides(one, two, max(apart, 0.0) - near)
    beside = len(facing) > 0 and len(edges.alike(planes, edges.INCLINED)) > 1
    for kind, plane, normal, corners in edges.edge_contacts(planes, near, NARROW * thinner):
        along = (corners if len(corners) > 1 else plane.loop)[:2]
        axes = frame(normal, along[1] - along[0])
        if apart <= near:
            yield "unclear" if beside else kind, near, axes, corners
        elif kind == "edge" and not len(facing):
            yield "off", apart, axes, corners
        if kind == "edge" and not len(facing) and (angle := edges.inclined(plane)):
            yield "inclined", angle, axes, corners
        if beside:
            return


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
