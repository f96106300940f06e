"""Displacement space, and what the materials of a scene say in every cell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from dolfinx import fem

from fenics_contact import compat
from fenics_contact.discretization.forms import Law
from fenics_contact.discretization.stress_law import law_matrix
from fenics_contact.errors import raised_together
from fenics_contact.geometry.mesh import Array, BlockMesh
from fenics_contact.scene.scene import Material, Scene, StressLaw


def displacement_space(scene: Scene) -> Any:
    """Continuous displacements inside every block, of the scene's degree."""
    return compat.function_space(scene.mesh.domain, "Lagrange", scene.degree, (2,))


def stress_law(scene: Scene) -> Law:
    """Stress by strain in every cell, by the materials. Collective."""
    return _given_law(scene, scene.stress) if scene.stress else _lame(scene)


def _lame(scene: Scene) -> tuple[fem.Function, fem.Function]:
    """Lame's numbers of the materials."""
    nus = 2.0 if scene.plane == "strain" else 1.0
    first = material_field(
        scene, lambda m: m.young * m.poisson / ((1.0 + m.poisson) * (1.0 - nus * m.poisson))
    )
    return first, material_field(scene, lambda m: m.young / (2.0 * (1.0 + m.poisson)), first)


def _given_law(scene: Scene, law: StressLaw) -> fem.Function:
    """D of the materials by a law of the user."""
    mesh = scene.mesh
    names = [scene.material_name(groups) for groups in mesh.cell_sets]
    with raised_together(scene.comm):
        rows = [law_matrix(law, scene.materials[name], name).ravel() for name in names]
    space = compat.function_space(mesh.domain, "DG", 0, (9,))
    field = fem.Function(space, name="law")
    field.x.array.reshape(-1, 9)[compat.cell_dofs(space)[:, 0]] = np.array(rows)[mesh.cell_groups]
    return field


def law_matrices(law: Law) -> Array:
    """D of a law that was given as such, in this rank's cells, Pa, shape (cells, 3, 3)."""
    given: Any = law
    rows = given.x.array.reshape(-1, 3, 3)
    return np.asarray(rows[compat.cell_dofs(given.function_space)[:, 0]])


def cell_field(
    mesh: BlockMesh, name: str, values: Array, like: fem.Function | None = None
) -> fem.Function:
    """Function that is constant in every cell, from the local cells' values.

    It is on the space of another one where one is given.
    """
    space = like.function_space if like else compat.function_space(mesh.domain, "DG", 0)
    field = fem.Function(space, name=name)
    field.x.array[compat.cell_dofs(space)[:, 0]] = values
    return field


def material_field(
    scene: Scene, value: Callable[[Material], float], like: fem.Function | None = None
) -> fem.Function:
    """A value of the materials, constant by cell; see `cell_field`."""
    values = [value(scene.material(groups)) for groups in scene.mesh.cell_sets]
    return cell_field(scene.mesh, "material", np.array(values)[scene.mesh.cell_groups], like)
