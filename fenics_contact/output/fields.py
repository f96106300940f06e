"""Finite element fields of a result: displacements, stresses, bodies."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.discretization.elasticity import stress
from fenics_contact.discretization.discretization import Structure


def displacement_function(structure: Structure, vector: PETSc.Vec, name: str) -> fem.Function:
    """A vector in the supports' coordinates as a displacement field in x and y.

    Args:
        structure: Where the vector comes from.
        vector: Displacements or mode.
        name: Name of the field.
    """
    first = vector.getOwnershipRange()[0] // 2
    cartesian = structure.supports.to_cartesian(vector.array_r, first)
    function = fem.Function(structure.elasticity.space, name=name)
    function.x.array[: len(cartesian)] = cartesian
    function.x.scatter_forward()
    return function


def stress_fields(structure: Structure, displacement: fem.Function) -> list[fem.Function]:
    """Stress components, von Mises stress and body number by cell, as scalars.

    The stresses are those at the centre of a cell, Pa; von Mises with the stress out of the plane,
    nu (sigma_x + sigma_y) in plane strain and zero in plane stress.
    """
    domain = structure.scene.mesh.domain
    lame_lambda, lame_mu = structure.elasticity.lame
    sigma = stress(displacement, lame_lambda, lame_mu)
    if structure.scene.plane == "strain":
        poisson = lame_lambda / (2.0 * (lame_lambda + lame_mu))
        out_of_plane = poisson * ufl.tr(sigma)
    else:
        out_of_plane = ufl.as_ufl(0.0)
    in_3d = ufl.as_matrix(
        [
            [sigma[0, 0], sigma[0, 1], 0.0],
            [sigma[1, 0], sigma[1, 1], 0.0],
            [0.0, 0.0, out_of_plane],
        ]
    )
    deviator = ufl.dev(in_3d)
    vector = compat.function_space(domain, "DG", 0, (4,))
    scalar = compat.function_space(domain, "DG", 0)
    cells = compat.cell_dofs(scalar)[:, 0]
    von_mises = ufl.sqrt(1.5 * ufl.inner(deviator, deviator))
    all_values = ufl.as_vector([sigma[0, 0], sigma[1, 1], sigma[0, 1], von_mises])
    together = fem.Function(vector)
    together.interpolate(fem.Expression(all_values, compat.interpolation_points(vector)))
    columns = together.x.array.reshape(-1, 4)[compat.cell_dofs(vector)[:, 0]]
    values = {
        "stress_xx": columns[:, 0],
        "stress_yy": columns[:, 1],
        "stress_xy": columns[:, 2],
        "von_mises": columns[:, 3],
        "body": structure.scene.mesh.body.astype(np.float64),
    }
    fields = []
    for name, column in values.items():
        field = fem.Function(scalar, name=name)
        field.x.array[cells] = column
        fields.append(field)
    return fields
