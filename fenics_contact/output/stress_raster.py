"""Mean stresses on a raster of fixed size: what a picture of any mesh needs, and no more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.discretization.layout import Layout
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.output.fields import cell_stresses

#: Squares of the raster along the longer side of the structure.
SQUARES = 240


@dataclass(frozen=True)
class StressRaster:
    """Mean stresses in squares, alike on all ranks.

    Attributes:
        corner: Lower left corner of the raster, m, shape (2,).
        step: Side of a square, m.
        area: Area of blocks in every square, m2, about, shape (rows, columns), from below.
        stress: sigma_xx, sigma_yy, sigma_xy, Pa; nan where there is no block, shape (rows,
            columns, 3).
    """

    corner: Array
    step: float
    area: Array
    stress: Array

    def coarser(self, factor: int) -> StressRaster:
        """Means over squares of `factor` times the size."""
        rows, columns = (np.arange(0, size, factor) for size in self.area.shape)
        area = self.area[:, :, None]
        total = np.concatenate([area, area * np.nan_to_num(self.stress)], axis=2)
        sums = np.add.reduceat(np.add.reduceat(total, rows, axis=0), columns, axis=1)
        return StressRaster(self.corner, factor * self.step, *_means(sums))


def stress_raster(layout: Layout, elastic: Array) -> StressRaster:
    """Mean stresses of a displacement field, this rank's part in the supports' coordinates.

    Collective. What the ranks send does not grow with the mesh.
    """
    points = layout.boundary.points[:, :2].reshape(-1, 2)
    corner = points.min(axis=0)
    extent = np.ptp(points, axis=0)
    step = float(extent.max()) / SQUARES
    columns, rows = (int(n) for n in np.maximum(np.ceil(extent / step - 1e-9), 1))
    stress = cell_stresses(layout, elastic)[:, :3]
    domain = layout.scene.mesh.domain
    corners = domain.geometry.x[compat.geometry_dofs(domain)][:, :, :2]
    sums = np.zeros((rows * columns, 4))  # area, and area times stresses
    for cells, shapes in _samples(corners, step):
        places = (shapes @ corners[cells, :, axis].T for axis in (0, 1))
        column, row = (
            ((place - start) / step).astype(np.int64)
            for place, start in zip(places, corner, strict=True)
        )
        square = np.clip(row, 0, rows - 1) * columns + np.clip(column, 0, columns - 1)
        share = _areas(corners[cells]) / len(shapes)
        for total, weight in zip(sums.T, [share, *(share * stress[cells].T)], strict=True):
            weights = np.broadcast_to(weight, square.shape).ravel()
            total += np.bincount(square.ravel(), weights, rows * columns)
    layout.scene.comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
    return StressRaster(corner, step, *_means(sums.reshape(rows, columns, 4)))


def _means(sums: Array) -> tuple[Array, Array]:
    """Areas, and mean stresses: nan where there is no area."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return sums[:, :, 0], sums[:, :, 1:] / sums[:, :, :1]


def _samples(corners: Array, step: float) -> list[tuple[Indices, Array]]:
    """Cells, and shape functions at points that divide them finer than the squares, by number."""
    size = np.ptp(corners, axis=1).max(axis=1)
    least = np.maximum(2.0 * size / step, 1.0)
    # Powers of two and 1.5 times these, so that there are few kinds of cells.
    power = 2 ** np.ceil(np.log2(least)).astype(np.int64)
    divisions = np.where(least <= 0.75 * power, 3 * power // 4, power)
    kinds = np.unique(divisions).tolist()
    return [(np.flatnonzero(divisions == n), _shapes(n, corners.shape[1])) for n in kinds]


def _shapes(n: int, count: int) -> Array:
    """Shape functions of a cell with 3 or 4 corners at the centres of n^2 equal parts of it."""
    i, j = (index.ravel() for index in np.indices((n, n)))
    if count == 3:
        lower = i + j < n
        upper = i + j < n - 1
        x = np.concatenate([i[lower] + 1.0 / 3.0, i[upper] + 2.0 / 3.0]) / n
        y = np.concatenate([j[lower] + 1.0 / 3.0, j[upper] + 2.0 / 3.0]) / n
        return np.column_stack([1.0 - x - y, x, y])
    x = (i + 0.5) / n
    y = (j + 0.5) / n
    return np.column_stack([(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y])


def _areas(corners: Array) -> Array:
    """Areas of cells; the corners of quadrilaterals are in the order of a product."""
    one = corners[:, -1] - corners[:, 0]
    other = corners[:, 2] - corners[:, 1]
    if corners.shape[1] == 3:
        other = corners[:, 1] - corners[:, 0]
    return 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
