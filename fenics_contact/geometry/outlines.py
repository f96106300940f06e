"""Outlines over each other: points within them, and outlines that overlap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_contact.geometry.planar_cells import Array, Indices

#: Part of the area of two outlines by which they may differ and be drawn as one.
SAME = 1e-3


def boxes(outlines: Sequence[Array]) -> tuple[Array, Array]:
    """Lower and upper corners of the boxes around outlines, each of shape (outlines, 2)."""
    low = np.array([outline.min(axis=0) for outline in outlines]).reshape(-1, 2)
    high = np.array([outline.max(axis=0) for outline in outlines]).reshape(-1, 2)
    return low, high


def inside_outlines(points: Array, outlines: Sequence[Array]) -> Indices:
    """The smallest outline around each point, by its index, -1 for none, shape (points,)."""
    from matplotlib.path import Path

    low, high = boxes(outlines)
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

    low, high = boxes(outlines)
    pairs = _box_pairs(low, high, depth)
    shapes = {k: Polygon(outlines[k]) for k in np.unique(pairs).tolist()}
    found = []
    places = []
    for first, second in pairs.tolist():
        common = shapes[first].intersection(shapes[second])
        if common.area > 0.5 * depth * common.length:
            place = common.representative_point()
            found.append((first, second))
            places.append((place.x, place.y))
    return np.array(found, dtype=np.int64).reshape(-1, 2), np.array(places).reshape(-1, 2)


def equal_outlines(outlines: Sequence[Array], near: float) -> list[tuple[int, int]]:
    """Outlines that are the same but for a distance between points: the first, and each other."""
    from scipy.spatial import cKDTree
    from shapely.geometry import Polygon

    tree = cKDTree(np.concatenate(boxes(outlines), axis=1))
    found: dict[int, int] = {}
    for first, second in sorted(tree.query_pairs(2.0 * near)):
        one, two = Polygon(outlines[first]), Polygon(outlines[second])
        same = one.symmetric_difference(two).area <= SAME * one.area
        if first not in found and second not in found and same:
            found[second] = first
    return [(first, second) for second, first in found.items()]


def _box_pairs(low: Array, high: Array, depth: float) -> Indices:
    """Pairs of boxes that overlap by more than a depth in x and y, shape (pairs, 2)."""
    order = np.argsort(low[:, 0], kind="stable")
    ends = np.searchsorted(low[order, 0], high[order, 0] - depth)
    found = []
    for place, (box, end) in enumerate(zip(order.tolist(), ends.tolist(), strict=True)):
        others = order[place + 1 : end]
        common = np.minimum(high[others, 1], high[box, 1]) - np.maximum(low[others, 1], low[box, 1])
        wide = np.minimum(high[others, 0], high[box, 0]) - low[others, 0]
        others = others[(common > depth) & (wide > depth)]
        found.append(np.column_stack([np.full(len(others), box), others]))
    return np.concatenate(found) if found else np.zeros((0, 2), dtype=np.int64)
