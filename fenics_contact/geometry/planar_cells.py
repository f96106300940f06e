"""Planar cells by their corners: what cells of a mesh must be, and cells that overlap."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import InputError, require

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

#: Smallest and largest size of a structure, m, and its largest distance from the origin.
SIZES = 1e-9, 1e9
#: Area of a cell below which it has none, over its longest side squared.
FLAT = 1e-10
#: Blocks may reach into each other by this fraction of a cell: at joints they do by 1e-3.
PENETRATION = 2e-3
#: Normals that differ by less than this angle are those of one (curved) boundary.
SMOOTH_ANGLE = np.radians(15.0)
#: Cells that are compared with others at a time, which bounds the memory.
PORTION = 20_000


def check_coordinates(coordinates: Array, source: str) -> None:
    """Refuse coordinates that are no numbers, not in a plane, or of no structure's size.

    `coordinates` are x, y, z of the nodes in use, shape (nodes, 3), m.

    Raises:
        InputError: With the first node that is wrong.
    """
    wrong = np.flatnonzero(~np.isfinite(coordinates).all(axis=1))
    if len(wrong):
        place = ", ".join(f"{x:g}" for x in coordinates[wrong[0]])
        raise InputError(f"{source}: {len(wrong)} nodes have no place, the first is at ({place})")
    largest = np.abs(coordinates).max()
    text = f"{source} has a coordinate of {largest:g}; give coordinates in m"
    require(largest <= SIZES[1], text)
    spread = np.ptp(coordinates, axis=0)
    text = f"{source} is not planar: z varies by {spread[2]:.3g}; draw it in x and y"
    require(spread[2] <= 1e-9 * spread.max(), text)
    text = f"{source} is {spread.max():g} m wide; give coordinates in m"
    require(spread.max() >= SIZES[0], text)


def anticlockwise(points: Array, cells: Indices, source: str) -> Indices:
    """Cells with their nodes in anticlockwise order; those given clockwise are turned.

    Raises:
        InputError: If cells have no area, are no convex quadrilaterals, are given twice, or lie on
            the same side of a facet.
    """
    corners = points[cells]
    # Relative to the first corner, so that far-away origins cost no digits.
    shifted = corners - corners[:, :1]
    sides = np.roll(shifted, -1, axis=1) - shifted
    area = 0.5 * np.linalg.det(np.stack([shifted, np.roll(shifted, -1, axis=1)], axis=2)).sum(1)
    # Twice the area at every corner; both signs occur where a quadrilateral is folded.
    turn = np.linalg.det(np.stack([sides, np.roll(sides, -1, axis=1)], axis=2))
    least = FLAT * (sides**2).sum(axis=2).max(axis=1)
    folded = np.any(turn * np.sign(area)[:, None] <= least[:, None], axis=1)
    turned = np.where((area < 0.0)[:, None], cells[:, ::-1], cells)
    same_side = _repeated(sides_of(turned)).reshape(cells.shape).any(axis=1)
    for wrong, what, cure in (
        (np.abs(area) <= least, "cells have no area", ""),
        (folded, "cells are no convex quadrilaterals", ""),
        (_repeated(np.sort(cells, axis=1)), "cells are given twice", "; delete the copies"),
        (same_side, "cells overlap others on the same nodes", ""),
    ):
        if np.any(wrong):
            x, y = corners[np.argmax(wrong)].mean(axis=0)
            raise InputError(f"{source}: {np.sum(wrong)} {what}, the first at ({x:g}, {y:g}){cure}")
    return turned


def _repeated(rows: Indices) -> Flags:
    """Which rows of whole numbers came before, shape (rows,)."""
    order = np.lexsort(rows.T)
    found = np.zeros(len(rows), dtype=bool)
    found[order[1:]] = np.all(rows[order[1:]] == rows[order[:-1]], axis=1)
    return found


def check_apart(points: Array, cells: Indices, body: npt.NDArray[np.int32], source: str) -> None:
    """Refuse blocks that lie over each other.

    Cells of two bodies overlap if no side of either separates them. Where the outlines of two
    bodies meet, cells at the outlines overlap; else one body lies inside the other, with all cells.
    Along a curved joint facets of unlike length overlap by the heights of their arcs.

    Args:
        points: Coordinates, m, shape (points, 2).
        cells: Corners of convex cells, anticlockwise, shape (cells, 3 or 4).
        body: Body of every cell.
        source: For the message.

    Raises:
        InputError: With the place where the first two blocks overlap.
    """
    corners = points[cells]
    size = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    low = corners.min(axis=1)
    high = corners.max(axis=1)
    ends = sides_of(cells)
    key = np.sort(ends, axis=1) @ [len(points), 1]
    _, side, count = np.unique(key, return_inverse=True, return_counts=True)
    free = np.flatnonzero(count[side] == 1)  # at the outline of a body
    along = points[ends[free, 1]] - points[ends[free, 0]]
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    heights = np.zeros(len(ends))  # twice those of the arcs
    heights[free] = 2.0 * np.abs(arc_heights(points[ends[free]], ends[free], normal))
    height = heights.reshape(cells.shape).max(axis=1)
    outer = np.isin(cells, ends[free]).any(axis=1)
    rim = np.flatnonzero(outer)
    inside = np.flatnonzero(~outer)
    _, one_of_each = np.unique(body[rim], return_index=True)
    for some, others in ((rim, rim), (rim[one_of_each], inside)):
        for one, two in near_pairs(corners.mean(axis=1), size, some, others):
            allowed = PENETRATION * np.minimum(size[one], size[two]) + height[one] + height[two]
            common = np.minimum(high[one], high[two]) - np.maximum(low[one], low[two])
            keep = (body[one] != body[two]) & np.all(common > allowed[:, None], axis=1)
            one = one[keep]
            two = two[keep]
            allowed = allowed[keep]
            bad = np.flatnonzero(_penetration(corners[one], corners[two]) > allowed)
            if len(bad):
                x, y = corners[[one[bad[0]], two[bad[0]]]].mean(axis=(0, 1))
                place = f"blocks overlap at ({x:g}, {y:g})"
                raise InputError(f"{source}: {place}; draw them side by side")


def arc_heights(points: Array, nodes: Indices, normal: Array) -> Array:
    """Heights of the arcs that facets are chords of, outward, m, shape (facets,).

    Where two facets of lengths L and M meet at a small angle a, the tangent is at a L / (L + M)
    from the first one, as on a circle. A chord with such angles b and c at its ends has the height
    L (b + c) / 8; at a corner the angle is taken to be that of the other end.

    Args:
        points: Ends of the facets, m, shape (facets, 2, 2).
        nodes: Their numbers, shape (facets, 2).
        normal: Outward unit normals, shape (facets, 2).
    """
    length = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    places, turn = turns(points, nodes, normal)
    one, two = places // 2
    turn[np.abs(turn) > SMOOTH_ANGLE] = np.nan
    angle = np.full(2 * len(nodes), np.nan)
    for here, other, place in ((one, two, places[0]), (two, one, places[1])):
        angle[place] = turn * length[here] / (length[here] + length[other])
    angle = angle.reshape(-1, 2)
    angle = np.where(np.isnan(angle), angle[:, ::-1], angle)
    return 0.125 * length * np.nan_to_num(angle).sum(axis=1)


def turns(points: Array, nodes: Indices, normal: Array) -> tuple[Indices, Array]:
    """Angles by which outlines turn at nodes of two facets; arguments as of `arc_heights`.

    Returns:
        Ends of facets that meet, 2 * facet + end, shape (2, nodes); angles, rad, above 0 where the
        corner is convex.
    """
    ends = nodes.ravel()
    order = np.argsort(ends, kind="stable")
    _, first, count = np.unique(ends[order], return_index=True, return_counts=True)
    first = first[count == 2]
    places = np.stack([order[first], order[first + 1]])
    one, two = places // 2
    cross = normal[one, 0] * normal[two, 1] - normal[one, 1] * normal[two, 0]
    turn = np.arctan2(np.abs(cross), np.sum(normal[one] * normal[two], axis=1))
    apart = points[one].mean(axis=1) - points[two].mean(axis=1)
    turn *= np.sign(np.sum((normal[one] - normal[two]) * apart, axis=1))
    return places, turn


def near_pairs(
    centre: Array, size: Array, some: Indices, others: Indices
) -> Iterator[tuple[Indices, Indices]]:
    """Pairs of cells or facets whose circles of a size about a centre meet, in portions.

    They are sorted into classes of half the size, so that small ones do not find all small ones
    within the reach of a large one.
    """
    from scipy.spatial import cKDTree

    if not len(some) or not len(others):
        return
    level = np.ceil(np.log2(size / size.max())).astype(int)
    trees = []
    for k in np.unique(level[others]):
        partners = others[level[others] == k]
        trees.append((k, partners, cKDTree(centre[partners])))
    for j in np.unique(level[some]):
        cells = some[level[some] == j]
        portions = [cells[start : start + PORTION] for start in range(0, len(cells), PORTION)]
        for part, (k, partners, tree) in product(portions, trees):
            reach = size.max() * (2.0**j + 2.0**k)
            table = cKDTree(centre[part]).sparse_distance_matrix(tree, reach, output_type="ndarray")
            one = part[table["i"]]
            two = partners[table["j"]]
            meet = table["v"] < size[one] + size[two]
            yield one[meet], two[meet]


def connected(pairs: Indices, count: int) -> Indices:
    """Number of the connected set that each of so many things is in, shape (count,)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(pairs)), pairs.T), (count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def sides_of(cells: Indices) -> Indices:
    """Nodes at the ends of the sides of cells, side after side, shape (sides, 2)."""
    return np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)


def _penetration(first: Array, second: Array) -> Array:
    """Depth, m, by which convex cells reach into each other, below 0 if apart, shape (pairs,).

    The least overlap of the projections on the normals of all sides (separating axis theorem).
    """
    depth = np.full(len(first), np.inf)
    for cells in (first, second):
        for side in range(cells.shape[1]):
            along = cells[:, (side + 1) % cells.shape[1]] - cells[:, side]
            normal = np.column_stack([along[:, 1], -along[:, 0]])
            normal /= np.linalg.norm(along, axis=1)[:, None]
            origin = cells[:, side, None]
            one, two = (np.einsum("nek,nk->ne", some - origin, normal) for some in (first, second))
            common = np.minimum(one.max(1), two.max(1)) - np.maximum(one.min(1), two.min(1))
            depth = np.minimum(depth, common)
    return depth
