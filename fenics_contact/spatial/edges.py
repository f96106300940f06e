"""Where two convex bodies touch in an edge or a corner, and the normal of that contact.

Bodies that touch are parted by a plane: that of a side, or one along an edge of each, which is a
facet of the hull of all differences of their points. They touch in a segment or a point of it. The
force there has the plane's normal; where several planes part them, it may have any between these.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.polyhedra import TINY, Polyhedron

#: Cosines of the largest angle between sides that face each other, and between those that people
#: may have meant to: normals between these are one, their mean.
FACING, INCLINED = np.cos(np.radians([2.0, 10.0])).tolist()
#: One plane parts two bodies; several do, whose normals are nearly one; that differ; no side is one
#: of these: no normal is known.
KINDS = ("edge", "shared", "doubt", "unclear")


class PartingPlane(NamedTuple):
    """A plane that parts two bodies.

    Attributes:
        normal: From the first body to the second.
        loop: Corners of the side, or of the edge, that lies in it, m, shape (corners, 3).
        outwards: Normal out of the body of that side.
        other: The other body.
    """

    normal: Array
    loop: Array
    outwards: Array
    other: Polyhedron


def planes_of_sides(one: Polyhedron, two: Polyhedron, least: float) -> list[PartingPlane]:
    """Planes of sides that the other body is beyond by so much at least, m."""
    planes = []
    for sign, body, other in ((1.0, one, two), (-1.0, two, one)):
        beyond = (other.corners @ body.normals.T).min(axis=0) - body.levels
        for side in np.flatnonzero(beyond >= least):
            normal = body.normals[side]
            loop = body.corners[list(body.sides[side])]
            planes.append(PartingPlane(sign * normal, loop, normal, other))
    return planes


def planes_of_edges(
    one: Polyhedron, two: Polyhedron, near: float
) -> tuple[float, list[PartingPlane]]:
    """How far bodies are apart, m, below 0 if they overlap, and planes that part them.

    The depth is the distance from the origin to the outside of all differences of their points.
    """
    from scipy.spatial import ConvexHull

    differences = (one.corners[:, None] - two.corners).reshape(-1, 3)
    facets = np.unique(ConvexHull(differences).equations, axis=0)
    apart = float(facets[:, 3].max())
    planes = []
    for normal in facets[facets[:, 3] >= max(apart, 0.0) - near, :3]:
        height = one.corners @ normal
        edge = _farthest(one.corners[height >= height.max() - near])
        planes.append(PartingPlane(normal, edge, normal, two))
    return apart, planes


def alike(planes: Sequence[PartingPlane], cosine: float) -> list[list[PartingPlane]]:
    """Planes by their normals: those of a list are along its first one."""
    normals = np.array([plane.normal for plane in planes])
    first = np.argmax(normals @ normals.T > cosine, axis=1)
    return [[planes[k] for k in np.flatnonzero(first == one)] for one in np.unique(first)]


def touching(plane: PartingPlane, near: float, narrow: float) -> Array:
    """Ends of what a side, or an edge, has in common with an edge or corner of the other body.

    Returns:
        Ends, m, halfway between the bodies, shape (2, 3); (1, 3) if it is shorter than `narrow`;
        (0, 3) if they are beside each other by more than `near`, m.
    """
    height = (plane.other.corners - plane.loop[0]) @ plane.outwards
    lowest = height <= height.min() + near
    ends = _farthest(plane.other.corners[lowest])
    across = np.cross(plane.outwards, np.roll(plane.loop, -1, axis=0) - plane.loop)  # inwards
    size = np.maximum(np.linalg.norm(across, axis=1), TINY)
    inside = np.einsum("lk,elk->le", across, ends[:, None] - plane.loop) / size[:, None]
    low, high = 0.0, 1.0
    for start, end in inside[inside.min(axis=1) < -near]:
        part = min(max(start / (start - end or 1.0), 0.0), 1.0)
        low, high = (max(low, part), high) if start < end else (low, min(high, part))
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    if (low - high) * length > near or inside.max(axis=1).min() < -near:
        return np.empty((0, 3))
    ends = ends[0] + np.outer([low, high], along)
    ends -= 0.5 * np.outer((ends - plane.loop[0]) @ plane.outwards, plane.outwards)
    return ends if (high - low) * length > narrow else ends.mean(axis=0)[None]


def edge_contacts(
    planes: Sequence[PartingPlane], near: float, narrow: float
) -> Iterator[tuple[str, PartingPlane, Array, Array]]:
    """Contacts in the planes that part two bodies.

    Returns:
        One of `KINDS`, the plane, the normal from the first body, and ends, m, shape (1 or 2, 3).
    """
    groups = alike(planes, INCLINED)
    kind = "edge" if len(alike(planes, FACING)) == 1 else "shared"
    if len(groups) > 1:
        kind = "doubt" if len(planes[0].loop) > 2 else "unclear"
    for group in groups[: 1 if kind == "unclear" else None]:
        ends = touching(group[0], near, narrow)
        if len(ends):
            yield kind, group[0], np.sum([plane.normal for plane in group], axis=0), ends


def inclined(plane: PartingPlane) -> float:
    """Angle to the side of the other body that faces it, degrees; 0 if there is none.

    Sides that face each other within the least angle count as parallel.
    """
    cosine = -float((plane.other.normals @ plane.outwards).min())
    return float(np.degrees(np.arccos(cosine))) if INCLINED < cosine <= FACING else 0.0


def _farthest(points: Array) -> Array:
    """The two points that are farthest apart, shape (2, 3); twice the same one of one."""
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    return points[list(np.unravel_index(distance.argmax(), distance.shape))]
