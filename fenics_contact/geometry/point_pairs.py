"""Points near each other and near straight segments, found with a k-d tree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from fenics_contact.geometry.planar_cells import Array, Indices, connected

#: Segments that are compared with points at a time, which bounds the memory.
PORTION = 2000


@dataclass(frozen=True)
class PointsNearSegments:
    """Pairs of a segment and a point near it.

    Attributes:
        segment: Index of the segment, shape (pairs,).
        point: Index of the point, shape (pairs,).
        at: Place of the point's projection along the segment, 0 at its start and 1 at its end; not
            limited to the segment, shape (pairs,).
        way: Vector from the point to the nearest place of the segment, shape (pairs, 2).
        distance: Its length, shape (pairs,).
    """

    segment: Indices
    point: Indices
    at: Array
    way: Array
    distance: Array


def snapped(points: Array, near: float) -> Array:
    """Points, of which those that are near each other have the place of the first of them."""
    from scipy.spatial import cKDTree

    label = connected(cKDTree(points).query_pairs(near, output_type="ndarray"), len(points))
    _, first = np.unique(label, return_index=True)
    return points[first[label]]


def points_near_segments(points: Array, segments: Array, reach: float) -> PointsNearSegments:
    """Pairs of points, shape (points, 2), and segments, (segments, 2, 2), within a distance."""
    empty = np.zeros(0, dtype=np.int64)
    found = [_pair(points, segments, empty, empty, reach), *_portions(points, segments, reach)]
    columns = (f"{name}" for name in PointsNearSegments.__dataclass_fields__)
    joined = {name: np.concatenate([getattr(part, name) for part in found]) for name in columns}
    return PointsNearSegments(**joined)


def _portions(points: Array, segments: Array, reach: float) -> Iterator[PointsNearSegments]:
    from scipy.spatial import cKDTree

    if not len(points):
        return
    tree = cKDTree(points)
    middle = segments.mean(axis=1)
    radius = 0.5 * np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) + 1.001 * reach
    for start in range(0, len(segments), PORTION):
        part = slice(start, start + PORTION)
        close = tree.query_ball_point(middle[part], radius[part])
        counts = np.fromiter(map(len, close), dtype=np.int64, count=len(close))
        segment = start + np.repeat(np.arange(len(close)), counts)
        point = np.fromiter(chain.from_iterable(close), dtype=np.int64, count=counts.sum())
        yield _pair(points, segments, segment, point, reach)


def _pair(
    points: Array, segments: Array, segment: Indices, point: Indices, reach: float
) -> PointsNearSegments:
    """The pairs of given candidates that are within reach."""
    along = (segments[:, 1] - segments[:, 0])[segment]
    arm = points[point] - segments[segment, 0]
    square = np.sum(along**2, axis=1)
    at = np.sum(arm * along, axis=1) / np.where(square > 0.0, square, 1.0)
    way = np.clip(at, 0.0, 1.0)[:, None] * along - arm
    distance = np.linalg.norm(way, axis=1)
    keep = distance <= reach
    return PointsNearSegments(segment[keep], point[keep], at[keep], way[keep], distance[keep])


def divided_segments(segments: Array, points: Array, near: float) -> tuple[Array, Indices]:
    """Segments cut at the points that lie on them.

    Args:
        segments: Starts and ends, shape (segments, 2, 2).
        points: Where to cut, shape (points, 2).
        near: Distance within which a point lies on a segment or on one of its ends.

    Returns:
        Starts of the parts, in the order of the segments and along each, shape (parts, 2), and the
        segment of every part.
    """
    pairs = points_near_segments(points, segments, near)
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    place = pairs.at * length[pairs.segment]
    inside = (place > near) & (place < length[pairs.segment] - near)
    owner = np.concatenate([np.arange(len(segments)), pairs.segment[inside]])
    place = np.concatenate([np.zeros(len(segments)), place[inside]])
    starts = np.concatenate([segments[:, 0], points[pairs.point[inside]]])
    order = np.lexsort([place, owner])
    owner = owner[order]
    place = place[order]
    new = (np.diff(place, prepend=-np.inf) > near) | (np.diff(owner, prepend=-1) > 0)
    return starts[order][new], owner[new]
