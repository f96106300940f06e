"""Displacements as a field, stresses of the cells, and how far they are from continuous ones."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from fenics_contact import compat
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.forms import stress_expression
from fenics_contact.mesh import Array

#: Corners of a cell one after the other, by their number.
AROUND = {3: [0, 1, 2], 4: [0, 1, 3, 2]}


def displacement_function(discretization: Discretization, values: Array, name: str) -> fem.Function:
    """Displacement field in x and y, from this rank's part in the supports' coordinates."""
    function = fem.Function(discretization.elasticity.space, name=name)
    function.x.array[: len(values)] = discretization.cartesian(values).ravel()
    function.x.scatter_forward()
    return function


def cell_stresses(discretization: Discretization, displacement: Array) -> Array:
    """sigma_xx, sigma_yy, sigma_xy and von Mises stress in this rank's cells, Pa, shape (cells, 4).

    At the centres of the cells. In plane strain, von Mises has the stress out of the plane,
    nu (sigma_x + sigma_y).
    """
    scene, lame = discretization.scene, discretization.elasticity.lame
    function = displacement_function(discretization, displacement, "displacement")
    expression, space = stress_expression(function, lame, scene.plane)
    together = fem.Function(space)
    together.interpolate(expression)
    return together.x.array.reshape(-1, 4)[compat.cell_dofs(space)[:, 0]]


def recovery_energy(discretization: Discretization, displacement: Array) -> Array:
    """Energy of the difference of stresses from continuous ones in this rank's cells, N.

    The continuous stresses are linear between means of the cells at every node (O.C. Zienkiewicz,
    J.Z. Zhu, Int. J. Numer. Meth. Eng. 24 (1987) 337).
    """
    domain = discretization.scene.mesh.domain
    corners = compat.geometry_dofs(domain)
    area = _areas(domain.geometry.x[corners, :2])
    stress = cell_stresses(discretization, displacement)
    weighted = np.column_stack([area[:, None] * stress[:, :3], area])
    sums = np.zeros((len(domain.geometry.x), 4))
    np.add.at(sums, corners, weighted[:, None])
    sums = compat.summed(domain.geometry.index_map(), sums)
    off = (sums[:, :3] / sums[:, 3:])[corners] - stress[:, None, :3]
    first, mu = (field.x.array for field in discretization.elasticity.lame)
    cell = compat.cell_dofs(discretization.elasticity.lame[0].function_space)[:, 0]
    first, mu = first[cell, None], mu[cell, None]
    trace = off[..., 0] + off[..., 1]
    square = off[..., 0] ** 2 + off[..., 1] ** 2 + 2.0 * off[..., 2] ** 2
    density = (square - first / (2.0 * (first + mu)) * trace**2) / (2.0 * mu)
    return np.asarray(area * density.mean(axis=1))


def _areas(corners: Array) -> Array:
    """Areas of cells from their corners, shape (cells, corners, 2)."""
    points = corners[:, AROUND[corners.shape[1]]]
    following = np.roll(points, -1, axis=1)
    cross = points[..., 0] * following[..., 1] - points[..., 1] * following[..., 0]
    return np.asarray(0.5 * np.abs(cross.sum(axis=1)))
