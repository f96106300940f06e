"""Displacement space, and what the materials of a scene say in every cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from ufl.corealg.traversal import traverse_unique_terminals
from ufl.domain import extract_domains

from fenics_contact import compat
from fenics_contact.discretization.forms import Law
from fenics_contact.discretization.stress_law import asked, checked_matrices, numbers
from fenics_contact.errors import InputError, raised_together
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
    """D of the cells by a law of the user. Collective.

    Raises:
        InputError: On all ranks, if the law is not that of linear elastic materials.
    """
    mesh = scene.mesh
    place = ufl.SpatialCoordinate(mesh.domain)
    names = np.array([scene.material_name(groups) for groups in mesh.cell_sets])
    with raised_together(scene.comm):
        stresses = {str(n): asked(law, scene.materials[n], n, place) for n in np.unique(names)}
        varies = {name: _varies(given, mesh, name) for name, given in stresses.items()}
    space = compat.function_space(mesh.domain, "DG", 0, (9,))
    rows = np.zeros((len(mesh.cell_groups), 9))
    for name, given in stresses.items():
        cells = names[mesh.cell_groups] == name
        # The cells' centres tell where a law is refused.
        found = _in_cells(mesh, [*given, *place])[cells] if varies[name] else None
        with raised_together(scene.comm):
            if found is None:
                matrices = checked_matrices(numbers(given, name)[None], name)
            else:
                matrices = checked_matrices(found[:, :-2], name, found[:, -2:])
            rows[cells] = matrices.reshape(-1, 9)
    field = fem.Function(space, name="law")
    field.x.array.reshape(-1, 9)[compat.cell_dofs(space)[:, 0]] = rows
    return field


def _varies(stresses: Any, mesh: BlockMesh, name: str) -> bool:
    """Whether what a law gives depends on the place.

    Raises:
        InputError: If it does so on another mesh.
    """
    domains: set[Any] = set()
    for terminal in traverse_unique_terminals(stresses):
        domains.update(extract_domains(terminal))
    if domains - {ufl.SpatialCoordinate(mesh.domain).ufl_domain()}:
        raise InputError(
            f"stress: the law of material '{name}' uses another mesh than that of its blocks,"
            " scene.mesh.domain; take the place from a third parameter, (strain, material, x)"
        )
    return bool(domains)


def _in_cells(mesh: BlockMesh, values: Sequence[Any]) -> Array:
    """UFL values at the centres of this rank's cells, shape (cells, values). Collective.

    Raises:
        InputError: If they cannot be compiled.
    """
    space = compat.function_space(mesh.domain, "DG", 0, (len(values),))
    field = fem.Function(space)
    # dolfinx compiles on rank 0, while the others wait.
    cache = compat.form_cache() if mesh.comm.rank == 0 else nullcontext()
    try:
        with compat.quiet_compiler(), cache:
            points = compat.interpolation_points(space)
            field.interpolate(fem.Expression(ufl.as_vector(values), points))
    except (RuntimeError, ValueError) as error:
        raise InputError(f"stress: the law cannot be compiled: {error}") from error
    rows = field.x.array.reshape(-1, len(values))
    return np.asarray(rows[compat.cell_dofs(space)[:, 0]])


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
