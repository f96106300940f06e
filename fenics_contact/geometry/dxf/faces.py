"""Faces of the planar graph that lines draw: the blocks between them.

Lines are cut where they meet and cross; the parts are the edges of a planar graph. Its bounded
faces are found by shapely (polygonize). Ends of lines that bound no face hang in the air; those
that stop short of a line miss it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.errors import InputError
from fenics_contact.geometry.outlines import (
    divided_segments,
    outline_area,
    points_near_segments,
    snapped,
    undirected,
)
from fenics_contact.geometry.planar_cells import Array, Flags

#: Faces thinner than so many times the distance of points that are the same are none: twice the
#: area over the length of the outline is the thickness.
SLIVER = 5.0
#: Distance from an end to a line, over the root of the median face's area, below which the end
#: misses the line.
SHORT = 0.06
#: Part of the area within a closed curve that no face between lines covers, from which it is a
#: block of its own.
ALONE = 0.9


@dataclass(frozen=True)
class DrawnFaces:
    """Bounded faces between lines.

    Attributes:
        outlines: Corners of every face, each of shape (corners, 2).
        holes: Which faces have another set of lines within that they do not touch, shape (faces,).
        edges: Parts of the lines, shape (edges, 2, 2).
        outer: Which edges have a face on one side only, shape (edges,).
        free: Edges that end in the air, that end first, shape (ends, 2, 2).
        reach: Distance from an end to a line below which it misses the line.
    """

    outlines: list[Array]
    holes: Flags
    edges: Array
    outer: Flags
    free: Array
    reach: float


def faces_between(chains: Sequence[Array], near: float) -> DrawnFaces:
    """Faces between chains of straight lines.

    Args:
        chains: Corners of every chain, each of shape (corners, 2); closed ones end as they begin.
        near: Distance within which points are the same, and ends lie on lines.

    Raises:
        InputError: If no line is longer than that.
    """
    from shapely.geometry import MultiLineString
    from shapely.ops import polygonize, unary_union

    # Cut where corners lie on lines, each once: shapely finds the crossings.
    corners = snapped(np.concatenate(chains), near)
    parts = np.split(corners, np.cumsum([len(chain) for chain in chains])[:-1])
    segments = np.concatenate([np.stack([p[:-1], p[1:]], axis=1) for p in parts])
    segments = segments[np.any(segments[:, 0] != segments[:, 1], axis=1)]
    if not len(segments):
        raise InputError(
            "the drawing has no block: no line is longer than the distance of points that are the"
            f" same, {near:g} m; delete what is drawn far away, or check --snap and the unit"
        )
    starts, owner = divided_segments(segments, np.unique(corners, axis=0), near)
    ends = np.concatenate([starts[1:], starts[:1]])
    last = np.append(owner[1:] != owner[:-1], True)
    ends[last] = segments[owner[last], 1]
    cut = np.unique(undirected(np.stack([starts, ends], axis=1)), axis=0)
    whole = unary_union(MultiLineString(cut.reshape(-1, 2, 2).tolist()))

    lines = list(getattr(whole, "geoms", [whole]))
    rows = [np.asarray(line.coords) for line in lines]
    edges = np.concatenate([np.stack([row[:-1], row[1:]], axis=1) for row in rows])
    faces = [face for face in polygonize(lines) if face.area > SLIVER * near * face.length]
    rings = [np.asarray(ring.coords) for f in faces for ring in (f.exterior, *f.interiors)]
    sides = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings]
    _, label = np.unique(undirected(np.concatenate([edges, *sides])), axis=0, return_inverse=True)
    label = label.reshape(-1)
    count = np.bincount(label[len(edges) :], minlength=label.max() + 1)
    outer = count[label[: len(edges)]] == 1
    _, label, count = np.unique(
        edges.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True
    )
    alone = (count[label.reshape(-1)] == 1).reshape(-1, 2)
    free = np.concatenate([edges[alone[:, 0]], edges[alone[:, 1], ::-1]])
    outlines = [np.asarray(face.exterior.coords)[:-1] for face in faces]
    holes = np.array([len(face.interiors) > 0 for face in faces], dtype=bool)
    lengths = np.linalg.norm(free[:, 1] - free[:, 0], axis=1)
    areas = [abs(outline_area(outline)) for outline in outlines]
    size = float(np.sqrt(np.median(areas or np.max(lengths, initial=0.0) ** 2)))
    return DrawnFaces(outlines, holes, edges, outer, free, SHORT * size)


def missed_ends(faces: DrawnFaces, near: float, stub: float = 0.0) -> tuple[Array, Array]:
    """Ends in the air, shape (ends, 2), and the distance of each to a line it stops short of.

    Args:
        faces: DrawnFaces between lines, with the edges that end in the air.
        near: Distance within which points are the same.
        stub: Length up to which a line that goes beyond another is no doubt.

    Returns:
        The ends, and the distances, infinite where no line is near, shape (ends,).
    """
    length = np.linalg.norm(faces.free[:, 1] - faces.free[:, 0], axis=1)
    ends = faces.free[length > stub, 0]
    pairs = points_near_segments(ends, faces.edges, faces.reach)
    short = (pairs.distance > near) & (pairs.distance < 0.5 * length[length > stub][pairs.point])
    distance = np.full(len(ends), np.inf)
    np.minimum.at(distance, pairs.point[short], pairs.distance[short])
    return ends, distance


def bounds_faces(ring: Array, faces: DrawnFaces, near: float) -> bool:
    """Whether a closed curve bounds blocks that the faces between lines alone lack.

    Lines end on it that would end in the air, or it goes around next to no face.
    """
    from shapely.geometry import Polygon
    from shapely.ops import unary_union

    ends, missed = missed_ends(faces, near)
    sides = np.stack([ring[:-1], ring[1:]], axis=1)
    if len(points_near_segments(ends[np.isinf(missed)], sides, faces.reach).point):
        return True
    whole = Polygon(ring).buffer(0.0)
    rest = whole.difference(unary_union([Polygon(outline) for outline in faces.outlines]))
    return bool(rest.area > ALONE * whole.area)


def on_lines(edges: Array, chains: Sequence[Array], near: float) -> Flags:
    """Which edges lie on chains of lines, by their middles."""
    segments = [np.stack([chain[:-1], chain[1:]], axis=1) for chain in chains]
    on = np.zeros(len(edges), dtype=bool)
    if segments:
        middles = edges.mean(axis=1)
        on[points_near_segments(middles, np.concatenate(segments), near).point] = True
    return on


def openings(faces: DrawnFaces, drawn: Flags) -> list[Array]:
    """Outlines of openings whose lines are drawn, maybe only up to the outer edge of the whole.

    The drawn edges and the outer ones bound regions. One that is bounded by drawn edges alone is an
    opening; so is one with the outer edge as a part, as a door, if most of its outline is drawn and
    it is not the largest of them, which is the structure.

    Args:
        faces: All faces.
        drawn: Which edges are drawn as outlines of openings.
    """
    from shapely.geometry import LineString
    from shapely.ops import polygonize

    some = faces.edges[drawn | faces.outer]
    regions = polygonize([LineString(edge) for edge in some.tolist()])
    is_drawn = set(map(tuple, undirected(faces.edges[drawn]).tolist()))
    found = []
    touching = []
    for region in regions:
        ring = np.asarray(region.exterior.coords)
        sides = np.stack([ring[:-1], ring[1:]], axis=1)
        of_void = np.array([tuple(side) in is_drawn for side in undirected(sides).tolist()])
        length = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1)
        if of_void.all():
            found.append(ring[:-1])
        else:
            mostly = length[of_void].sum() > 0.5 * length.sum()
            touching.append((region.area, mostly, ring[:-1]))
    touching.sort(key=lambda row: -row[0])
    return found + [ring for _, mostly, ring in touching[1:] if mostly]
