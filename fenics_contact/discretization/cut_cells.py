"""Integrals over the blocks of what is linear between some heights: cells are cut there.

Between two heights, of its corners or of cuts, a convex cell is a strip with two straight sides.
Gauss's rule along the height and across takes a strip: exactly in triangles, and to rounding in
quadrilaterals, whose shape functions are no polynomials of the place, but their resultant and
moment exactly. Quadrilaterals without cuts are integrated as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.geometry.mesh import Array, Indices

#: Cells of strips; points of integration in the reference cell, shape (strips or 1, points, 2);
#: weights, m2, shape (strips, points); heights up . x there, m.
Rule = tuple[Indices, Array, Array, Array]

#: Gauss points along each side of a strip, by corners of the cell.
POINTS = {3: 3, 4: 16}
#: Strips thinner than this are none, over the height of their cell.
THIN = 1e-12
#: Cells that are cut at a time, which bounds the memory.
PORTION = 300


def rules(domain: Any, up: Array, levels: Array) -> Iterator[Rule]:
    """Rules for this rank's cells, cut at levels of the height up . x, m."""
    corners = domain.geometry.x[compat.geometry_dofs(domain)][:, :, :2]
    height = corners @ up
    low = height.min(axis=1, keepdims=True)
    part = (levels - low) / (height.max(axis=1, keepdims=True) - low)
    cut = np.any((part > THIN) & (part < 1.0 - THIN), axis=1) | (corners.shape[1] == 3)
    yield _whole(np.flatnonzero(~cut), corners[~cut], up)
    for cells in np.array_split(np.flatnonzero(cut), cut.sum() // PORTION + 1):
        yield _cut(cells, corners[cells], up, levels)


def shape_functions(space: Any, place: Array) -> Array:
    """Lagrange functions of a cell's nodes at reference places, shape (..., nodes)."""
    nodes = compat.interpolation_points(space)
    count = 2 if len(nodes) < 6 else 3
    simplex = len(nodes) in (3, 6)
    powers = [(i, j) for i in range(count) for j in range(count - i * simplex)]

    def monomials(at: Array) -> Array:
        return np.stack([at[..., 0] ** i * at[..., 1] ** j for i, j in powers], axis=-1)

    return np.asarray(monomials(place) @ np.linalg.inv(monomials(nodes)))


def _whole(cells: Indices, corners: Array, up: Array) -> Rule:
    """A rule for whole quadrilaterals; corners as dolfinx has them, row by row."""
    abscissa, weight = np.polynomial.legendre.leggauss(POINTS[3])  # polynomials, as in triangles
    place = 0.5 * (1.0 + np.stack(np.meshgrid(abscissa, abscissa), axis=-1).reshape(1, -1, 2))
    b, c, d = _sides(corners)
    area = np.abs(_cross(b + d * place[..., 1:], c + d * place[..., :1]))
    arm = b * place[..., :1] + c * place[..., 1:] + d * place.prod(axis=-1, keepdims=True)
    area *= 0.25 * np.outer(weight, weight).ravel()
    return cells, place, area, corners[:, :1] @ up + arm @ up


def _cut(cells: Indices, corners: Array, up: Array, levels: Array) -> Rule:
    """A rule for cells cut into strips; corners as dolfinx has them, row by row."""
    # From the first corner, so that far-away origins cost no digits.
    base = corners[:, :1] @ up
    corners = corners - corners[:, :1]
    axes = np.column_stack([up, [up[1], -up[0]]])  # along the height, and across
    outline = corners[:, [0, 1, 3, 2] if corners.shape[1] == 4 else [0, 1, 2]] @ axes
    low = outline[..., 0].min(axis=1, keepdims=True)
    high = outline[..., 0].max(axis=1, keepdims=True)
    ends = np.sort(np.hstack([outline[..., 0], np.clip(levels - base, low, high)]), axis=1)
    row, number = np.nonzero(np.diff(ends, axis=1) > THIN * (high - low))
    extent = ends[row, number + 1] - ends[row, number]
    abscissa, weight = np.polynomial.legendre.leggauss(POINTS[corners.shape[1]])
    share = 0.5 * (1.0 + abscissa)
    height = ends[row, number][:, None] + extent[:, None] * share
    left, width = _across(outline[row], height)
    across = left[..., None] + width[..., None] * share
    area = np.einsum("r,h,rh,a->rha", 0.25 * extent, weight, width, weight)
    flat = len(row), len(share) ** 2
    arm = np.stack(np.broadcast_arrays(height[..., None], across), axis=-1).reshape(*flat, 2)
    place = _reference(corners[row], arm @ axes.T)
    return cells[row], place, area.reshape(flat), arm[..., 0] + base[row]


def _across(outline: Array, height: Array) -> tuple[Array, Array]:
    """Where cells begin across at heights inside them, and how wide they are there, m.

    `outline` has heights and places across of the corners, shape (rows, corners, 2).
    """
    first = outline[:, :, None]
    step = np.roll(outline, -1, axis=1)[:, :, None] - first
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (height[:, None] - first[..., 0]) / step[..., 0]
        across = first[..., 1] + share * step[..., 1]
    meets = (share >= 0.0) & (share <= 1.0)
    left = np.where(meets, across, np.inf).min(axis=1)
    return left, np.where(meets, across, -np.inf).max(axis=1) - left


def _reference(corners: Array, arm: Array) -> Array:
    """Places in the reference cell of places from the first corner, shape (rows, points, 2).

    These are b xi + c eta + d xi eta: what is left without c eta is along b + d eta, an equation of
    the second degree for eta.
    """
    b, c, d = _sides(corners)
    constant = _cross(arm, b)
    linear = _cross(arm, d) + _cross(b, c)
    root = np.sqrt(np.maximum(linear**2 + 4.0 * _cross(c, d) * constant, 0.0))
    eta = -2.0 * constant / (linear + np.sign(_cross(b, c)) * root)
    side = b + d * eta[..., None]
    xi = np.sum((arm - c * eta[..., None]) * side, axis=-1) / np.sum(side**2, axis=-1)
    return np.stack([xi, eta], axis=-1)


def _sides(corners: Array) -> tuple[Array, Array, Array]:
    """Vectors b, c, d of x = a + b xi + c eta + d xi eta in cells, shape (cells, 1, 2)."""
    a, b, c = np.moveaxis(corners[:, :3, None], 1, 0)
    rest = corners[:, 3, None] - b - c + a if corners.shape[1] == 4 else 0.0 * a
    return b - a, c - a, rest


def _cross(one: Array, other: Array) -> Array:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
