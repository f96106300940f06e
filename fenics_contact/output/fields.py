"""Finite element fields of a result, and the ParaView files that hold them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fenics_contact import compat
from fenics_contact.discretization.forms import stress_expression
from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.materials import cell_field
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.lazily import fem
from fenics_contact.output.folder import writing
from fenics_contact.parallel import MPI
from fenics_contact.results.block_view import AMPLITUDE, ContactState
from fenics_contact.results.history import CapacityPoint
from fenics_contact.results.values import JointValues

#: Squares of the raster along the longer side of the structure.
SQUARES = 240


def displacement_function(layout: Layout, values: Array, name: str) -> fem.Function:
    """Displacement field in x and y, from this rank's part in the supports' coordinates."""
    function = fem.Function(layout.space, name=name)
    function.x.array[: len(values)] = layout.cartesian(values).ravel()
    function.x.scatter_forward()
    return function


def at_nodes(layout: Layout, values: Array, nodes: Indices) -> Array:
    """Displacements at a table of nodes, on all ranks, shape (*nodes.shape, 2); 0 on the ground.

    Collective. `values` are this rank's in the supports' coordinates.
    """
    displacement = layout.cartesian(values)
    first = layout.first_node
    end = first + len(displacement)
    mine = (nodes >= first) & (nodes < end)
    found = np.zeros((*nodes.shape, 2))
    found[mine] = displacement[nodes[mine] - first]
    layout.scene.comm.Allreduce(MPI.IN_PLACE, found, MPI.SUM)
    return found


def at_sides(layout: Layout, values: Array) -> Array:
    """Displacements of both sides at all joint points and ties, on all ranks, (points, 2, 2).

    They are zero on rigid ground. Collective; `values` as for `at_nodes`.
    """
    stencil = layout.joints.stencil
    of_nodes = at_nodes(layout, values, stencil.nodes)
    return np.asarray(np.einsum("psk,pskd->psd", stencil.weights, of_nodes))


def middle(joints: Joints, sides: Array, ground: Array | float = 0.0) -> Array:
    """Mean displacement of both sides at joint points; on rigid ground that of `ground`."""
    on_ground = joints.bodies[:, :1] == GROUND
    return np.where(on_ground, ground, sides.mean(axis=1))


def mode_scale(layout: Layout, mode: Array) -> float:
    """Factor that makes the largest displacement of a mode `AMPLITUDE` of the structure's size."""
    boundary = layout.boundary
    fastest = np.linalg.norm(at_nodes(layout, mode, boundary.nodes), axis=2).max()
    size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
    return AMPLITUDE * size / (float(fastest) or 1.0)


def cell_stresses(layout: Layout, displacement: Array) -> Array:
    """sigma_xx, sigma_yy, sigma_xy and von Mises stress in this rank's cells, Pa, shape (cells, 4).

    At the centres of the cells. In plane strain, von Mises has the stress out of the plane,
    nu (sigma_x + sigma_y). With a stress law of the scene it is left out, shape (cells, 3).
    """
    scene = layout.scene
    law = layout.law
    function = displacement_function(layout, displacement, "displacement")
    expression, space = stress_expression(function, law, scene.plane)
    together = fem.Function(space)
    together.interpolate(expression)
    return together.x.array.reshape(-1, space.dofmap.bs)[compat.cell_dofs(space)[:, 0]]


def principal_stresses(stress: Array) -> tuple[Array, Array]:
    """Principal stresses in the plane, the larger first, and the direction of the first.

    From sigma_xx, sigma_yy, sigma_xy, shape (..., 3); both results have the shape (..., 2). The
    second direction is normal to the first.
    """
    xx, yy, xy = np.moveaxis(stress, -1, 0)
    mean = 0.5 * (xx + yy)
    radius = np.hypot(0.5 * (xx - yy), xy)
    angle = 0.5 * np.arctan2(xy, 0.5 * (xx - yy))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.stack([mean + radius, mean - radius], axis=-1), direction


def write_blocks(
    path: Path, layout: Layout, displacement: Array, elastic: Array, mode: Array | None
) -> None:
    """Write displacement and collapse mode by node, stresses and numbers by cell, as a .pvd file.

    Collective. `elastic` is the displacement without a large motion, in which digits of stresses
    would be lost. The mode is scaled by `mode_scale`, which is in the files too; without a mode
    both are left out.

    Raises:
        OutputError: On all ranks, with the reason, if a file cannot be written.
    """
    comm = layout.scene.comm
    moving = {"displacement": displacement}
    numbers = {}
    if mode is not None:
        scale = mode_scale(layout, mode)
        moving["collapse_mode"] = scale * mode
        numbers["mode_scale"] = scale
    mesh = layout.scene.mesh
    stress = cell_stresses(layout, elastic)
    values, first = principal_stresses(stress[:, :3])
    names = "stress_xx", "stress_yy", "stress_xy", "von_mises"
    columns = dict(zip(names[: stress.shape[1]], stress.T, strict=True))
    columns |= {"principal_1": values[:, 0], "principal_2": values[:, 1]}
    # dolfinx 0.5 writes no vectors by cell.
    columns |= {"direction_2_x": -first[:, 1], "direction_2_y": first[:, 0]}
    columns |= {"body": mesh.body, "material": material_numbers(layout)[mesh.cell_groups]}
    functions = [displacement_function(layout, u, name) for name, u in moving.items()]
    functions += [cell_field(mesh.domain, name, value) for name, value in columns.items()]
    _write(path, comm, [(0.0, functions)], [numbers])


def write_series(path: Path, layout: Layout, points: Sequence[CapacityPoint]) -> None:
    """Write the displacements along a capacity curve as a .pvd file with a time for every point.

    Collective. The time is the mean displacement along the live load, mm, or the number of the
    point where that does not rise; "load_factor" is in the files too.

    Raises:
        OutputError: On all ranks, with the reason, if a file cannot be written.
    """
    points = [point for point in points if point.motion is not None]
    comm = layout.scene.comm
    times = [1e3 * point.displacement for point in points]
    if np.any(np.diff(times) <= 0.0):
        times = [float(number) for number in range(len(points))]
    steps = (
        (time, [displacement_function(layout, point.motion, "displacement")])
        for time, point in zip(times, points, strict=True)
        if point.motion is not None
    )
    _write(path, comm, steps, [{"load_factor": point.load_factor} for point in points])


def _write(
    path: Path,
    comm: MPI.Comm,
    steps: Iterable[tuple[float, list[fem.Function]]],
    numbers: Sequence[Mapping[str, float]],
) -> None:
    """Write functions at times as a .pvd file, with numbers of every time. Collective."""
    with writing(comm):
        compat.write_vtk(path, comm, steps)
    with writing(comm):
        if comm.rank == 0:
            compat.tidy_vtk(path, numbers)


def material_numbers(layout: Layout) -> Indices:
    """Number of the material, in the scene's order, for every set of groups of cells."""
    scene = layout.scene
    names = list(scene.materials)
    found = [names.index(scene.material_name(groups)) for groups in scene.mesh.cell_sets]
    return np.array(found, dtype=np.int64)


def facet_contact(values: JointValues, segments: Indices) -> npt.NDArray[np.int64]:
    """`ContactState` of joint facets: open if an end is open, else slipping if an end slips."""
    contact = values.contact[segments]
    state = np.where(
        np.any(contact == ContactState.SLIP, axis=1), ContactState.SLIP, ContactState.STICK
    )
    return np.where(np.any(contact == ContactState.OPEN, axis=1), ContactState.OPEN, state)


# ---- stresses on a raster of fixed size: what a picture of any mesh needs, and no more


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
    # Areas of cells; the corners of quadrilaterals are in the order of a product.
    one = corners[:, -1] - corners[:, 0]
    other = corners[:, 1] - corners[:, 0 if corners.shape[1] == 3 else 2]
    areas = 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    sums = np.zeros((rows * columns, 4))  # area, and area times stresses
    for cells, shapes in _samples(corners, step):
        places = (shapes @ corners[cells, :, axis].T for axis in (0, 1))
        column, row = (
            ((place - start) / step).astype(np.int64)
            for place, start in zip(places, corner, strict=True)
        )
        square = np.clip(row, 0, rows - 1) * columns + np.clip(column, 0, columns - 1)
        share = areas[cells] / len(shapes)
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
