"""Outlines of blocks: points near their sides, corners where others meet them, overlaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import require
from fenics_contact.geometry.planar_cells import Array, Flags, Indices, connected, near_pairs

Segments = Mapping[str, Sequence[npt.ArrayLike]]
Polygons = list[Array]

#: Corners closer than this, relative to the size of the drawing, are the same point: drawings come
#: with six or more digits.
COINCIDENT = 1e-6
#: Segments that are compared with points at a time, which bounds the memory.
PORTION = 2000
#: Part of the area of two outlines by which they may differ and be drawn as one.
SAME = 1e-3


# ---- points and segments


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


def points_near_segments(points: Array, segments: Array, reach: float) -> PointsNearSegments:
    """Pairs of points, shape (points, 2), and segments, (segments, 2, 2), within a distance."""
    from scipy.spatial import cKDTree

    none = np.zeros(0, dtype=np.int64)
    found = [(none, none, np.zeros(0), np.zeros((0, 2)), np.zeros(0))]
    tree = cKDTree(points)
    middle = segments.mean(axis=1)
    along = segments[:, 1] - segments[:, 0]
    square = np.sum(along**2, axis=1)
    radius = 0.5 * np.sqrt(square) + 1.001 * reach
    for start in range(0, len(segments), PORTION):
        part = slice(start, start + PORTION)
        close = tree.query_ball_point(middle[part], radius[part])
        segment = np.repeat(start + np.arange(len(close)), [len(some) for some in close])
        point = np.fromiter(chain.from_iterable(close), dtype=np.int64, count=len(segment))
        arm = points[point] - segments[segment, 0]
        length = np.where(square > 0.0, square, 1.0)[segment]
        at = np.sum(arm * along[segment], axis=1) / length
        way = np.clip(at, 0.0, 1.0)[:, None] * along[segment] - arm
        distance = np.linalg.norm(way, axis=1)
        keep = distance <= reach
        found.append((segment[keep], point[keep], at[keep], way[keep], distance[keep]))
    columns: list[Any] = [np.concatenate(column) for column in zip(*found, strict=True)]
    return PointsNearSegments(*columns)


def welded(points: Array, near: float) -> tuple[Array, Indices]:
    """Points without those that are near to others, and numbers of those instead of all."""
    from scipy.spatial import cKDTree

    label = connected(cKDTree(points).query_pairs(near, output_type="ndarray"), len(points))
    _, first, place = np.unique(label, return_index=True, return_inverse=True)
    return points[first], place


def snapped(points: Array, near: float) -> Array:
    """Points, of which those that are near each other have the place of the first of them."""
    kept, place = welded(points, near)
    return kept[place]


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


def undirected(segments: Array) -> Array:
    """Segments with that end first which comes first in x, then in y, shape (segments, 4)."""
    return np.sort(segments @ [1.0, 1.0j], axis=1).view(float)


# ---- outlines


def outline_area(corners: Array) -> float:
    """Area of a polygon, negative if its corners run clockwise, in the square of their unit."""
    x, y = (corners - corners[0]).T
    return 0.5 * float(x[:-1] @ y[1:] - y[:-1] @ x[1:])


def outline_problem(corners: Array) -> str:
    """What keeps corners from being the outline of a block; empty if nothing does."""
    from shapely.geometry import MultiPoint, Polygon
    from shapely.ops import snap
    from shapely.validation import explain_validity

    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        return "needs at least three corners (x, y)"
    if not np.all(np.isfinite(corners)):
        return "has a corner that is not finite"
    size = float(np.ptp(corners, axis=0).max())
    if abs(outline_area(corners)) <= 1e-12 * size**2:
        return "has no area; check its corners"
    # A side that passes a corner closer than points that are the same goes through it.
    outline = snap(Polygon(corners), MultiPoint(corners), COINCIDENT * size)
    problem, _, place = explain_validity(outline).partition("[")
    where = (float(value) for value in place.removesuffix("]").split())
    return "crosses itself at ({:g}, {:g})".format(*where) if problem != "Valid Geometry" else ""


def sides_of_outlines(blocks: Polygons) -> Array:
    """Starts and ends of the sides of blocks, one after the other, shape (sides, 2, 2)."""
    corners = np.concatenate(blocks)
    return np.stack([corners, corners[_following(blocks)]], axis=1)


def _following(blocks: Polygons) -> Indices:
    """The next side of the same block, of every side, shape (sides,)."""
    counts = np.array([len(block) for block in blocks])
    last = np.cumsum(counts) - 1
    following = np.arange(1, counts.sum() + 1)
    following[last] = last - counts + 1
    return following


def sides_on(blocks: Polygons, groups: Segments, near: float) -> dict[str, Flags]:
    """Which sides of the blocks, one block after the other, lie on the segments of each group."""
    starts = np.concatenate(blocks)
    following = _following(blocks)
    found = {}
    for name, segments in groups.items():
        lines = np.array([np.reshape(segment, (2, 2)) for segment in segments]).reshape(-1, 2, 2)
        lines = lines[np.any(lines[:, 0] != lines[:, 1], axis=1)]
        pairs = points_near_segments(starts, lines, near)
        of_segment = pairs.segment * len(starts)
        both = np.isin(of_segment + following[pairs.point], of_segment + pairs.point)
        found[name] = np.isin(np.arange(len(starts)), pairs.point[both])
    return found


def divided_outlines(outlines: Polygons, groups: Segments) -> tuple[Polygons, float]:
    """Outlines anticlockwise, with a corner wherever another block or a segment ends on a side.

    Corners within the distance `near`, m, which is returned too, are moved onto each other.
    """
    ends = [np.reshape(segment, (2, 2)) for some in groups.values() for segment in some]
    corners = np.concatenate(outlines)
    near = COINCIDENT * float(np.ptp(corners, axis=0).max())
    corners = snapped(np.concatenate([corners, *ends]), near)
    blocks = []
    for part in np.split(corners, np.cumsum([len(outline) for outline in outlines]))[:-1]:
        block = part[np.hypot(*(part - part[np.arange(len(part)) - 1]).T) > near]
        place = f"({part[0, 0]:g}, {part[0, 1]:g}) m"
        text = f"a block at {place} is too small beside the whole, {near / COINCIDENT:g} m"
        require(len(block) >= 3, text)
        blocks.append(block if outline_area(block) > 0.0 else block[::-1])
    starts, side = divided_segments(sides_of_outlines(blocks), np.unique(corners, axis=0), near)
    first_side = np.cumsum([len(block) for block in blocks])[:-1]
    return np.split(starts, np.searchsorted(side, first_side)), near


# ---- outlines over each other


def inner_points(outlines: Sequence[Array]) -> Array:
    """A point within each outline, shape (outlines, 2)."""
    from shapely.geometry import Polygon

    points = [Polygon(outline).representative_point() for outline in outlines]
    return np.array([(point.x, point.y) for point in points]).reshape(-1, 2)


def _boxes(outlines: Sequence[Array]) -> tuple[Array, Array]:
    """Lower and upper corners of the boxes around outlines, each of shape (outlines, 2)."""
    low = np.array([outline.min(axis=0) for outline in outlines]).reshape(-1, 2)
    high = np.array([outline.max(axis=0) for outline in outlines]).reshape(-1, 2)
    return low, high


def inside_outlines(points: Array, outlines: Sequence[Array]) -> Indices:
    """The smallest outline around each point, by its index, -1 for none, shape (points,)."""
    from matplotlib.path import Path

    low, high = _boxes(outlines)
    owner = np.full(len(points), -1, dtype=np.int64)
    order = np.argsort(points[:, 0], kind="stable")
    x = points[order, 0]
    for number in np.argsort(-np.prod(high - low, axis=1)).tolist():
        strip = order[np.searchsorted(x, low[number, 0]) : np.searchsorted(x, high[number, 0])]
        some = strip[(points[strip, 1] > low[number, 1]) & (points[strip, 1] < high[number, 1])]
        if len(some):
            owner[some[Path(outlines[number]).contains_points(points[some])]] = number
    return owner


def overlaps(outlines: Sequence[Array], depth: float) -> tuple[Indices, Array]:
    """Pairs of outlines that reach into each other by more than a depth, and where.

    The depth of an overlap is twice its area over its perimeter.

    Returns:
        Indices of the outlines, shape (pairs, 2), and a place in each overlap, shape (pairs, 2).
    """
    from shapely.geometry import Polygon

    low, high = _boxes(outlines)
    size = 0.5 * np.linalg.norm(high - low, axis=1)
    every = np.arange(len(outlines))
    near = [np.stack(pair, axis=1) for pair in near_pairs(0.5 * (low + high), size, every, every)]
    pairs = np.concatenate(near)
    rank = np.argsort(np.argsort(low[:, 0], kind="stable"))[pairs]  # from left to right
    wide = high[pairs].min(axis=1) - low[pairs].max(axis=1)
    some = (rank[:, 0] < rank[:, 1]) & np.all(wide > depth, axis=1)
    pairs = pairs[some][np.lexsort(rank[some].T[::-1])]
    shapes = {k: Polygon(outlines[k]) for k in np.unique(pairs).tolist()}
    common = [shapes[first].intersection(shapes[second]) for first, second in pairs.tolist()]
    deep = [k for k, one in enumerate(common) if one.area > 0.5 * depth * one.length]
    places = [common[k].representative_point().coords[0] for k in deep]
    return pairs[deep].reshape(-1, 2), np.array(places).reshape(-1, 2)


def equal_outlines(outlines: Sequence[Array], near: float) -> dict[int, int]:
    """Outlines that are one before them but for a distance between points, with that one."""
    from scipy.spatial import cKDTree
    from shapely.geometry import Polygon

    tree = cKDTree(np.concatenate(_boxes(outlines), axis=1))
    found: dict[int, int] = {}
    for first, second in sorted(tree.query_pairs(2.0 * near)):
        one = Polygon(outlines[first])
        same = one.symmetric_difference(Polygon(outlines[second])).area <= SAME * one.area
        if first not in found and second not in found and same:
            found[second] = first
    return found
