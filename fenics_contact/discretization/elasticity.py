"""Linear elasticity of the blocks by UFL forms: stiffness K, dead load f_D, live load f_L.

    int_Omega sigma(u) : eps(v) dx = int_Omega rho b . v dx + int_Gamma t . v ds,
    sigma(u) = 2 mu eps(u) + lambda tr(eps(u)) I,

in plane strain, or in plane stress with lambda replaced by 2 lambda mu / (lambda + 2 mu)
(O.C. Zienkiewicz, R.L. Taylor, The Finite Element Method, vol. 1, 5th ed., section 4.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.discretization.facets import Boundary
from fenics_contact.scene import Load, Scene
from fenics_contact.discretization.supports import Supports


@dataclass(frozen=True)
class Elasticity:
    """Assembled elasticity of all blocks.

    The matrix and vectors are in the supports' coordinates: rotated where a roller is inclined,
    with the rows and columns of what is held replaced by a diagonal.

    Attributes:
        space: Displacement space.
        stiffness: K, N/m per metre of thickness.
        dead: f_D, N per metre of thickness.
        live: f_L, likewise.
        lame: Lame's lambda (of the plane state) and mu by cell, Pa.
        dead_resultant: Force and moment about `centre` on every body, shape (bodies, 3), on all
            ranks.
        live_resultant: Likewise.
        centre: Mean position of the nodes of every body, shape (bodies, 2), m; on all ranks.
        node_body: Body of every local node.
    """

    space: Any
    stiffness: PETSc.Mat
    dead: PETSc.Vec
    live: PETSc.Vec
    lame: tuple[fem.Function, fem.Function]
    dead_resultant: npt.NDArray[np.float64]
    live_resultant: npt.NDArray[np.float64]
    centre: npt.NDArray[np.float64]
    node_body: npt.NDArray[np.int32]


def displacement_space(scene: Scene) -> Any:
    """Continuous displacements inside every block, of the scene's degree."""
    return compat.function_space(scene.mesh.domain, "Lagrange", scene.degree, (2,))


def assemble(scene: Scene, space: Any, boundary: Boundary, supports: Supports) -> Elasticity:
    """Assemble K, f_D and f_L of a scene.

    Args:
        scene: Materials and loads.
        space: From `displacement_space`.
        boundary: From `collect_boundary` on that space.
        supports: From `find_supports`.
    """
    young, poisson, density = _material_fields(scene)
    lame_lambda, lame_mu = _lame(scene, young, poisson)
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    stiffness = fem_petsc.assemble_matrix(
        fem.form(ufl.inner(stress(u, lame_lambda, lame_mu), strain(v)) * ufl.dx)
    )
    stiffness.assemble()

    node_body, centre = _bodies_of_nodes(scene, space)
    loads = [_load(scene, space, boundary, load, density) for load in (scene.dead, scene.live)]
    resultants = [_resultants(scene, space, load, node_body, centre) for load in loads]
    stiffness = supports.constrain_matrix(stiffness)
    for load in loads:
        supports.constrain_vector(load)
    return Elasticity(
        space=space,
        stiffness=stiffness,
        dead=loads[0].array.copy(),
        live=loads[1].array.copy(),
        lame=(lame_lambda, lame_mu),
        dead_resultant=resultants[0],
        live_resultant=resultants[1],
        centre=centre,
        node_body=node_body,
    )


def strain(u: Any) -> Any:
    """eps(u) = sym grad u."""
    return ufl.sym(ufl.grad(u))


def stress(u: Any, lame_lambda: Any, lame_mu: Any) -> Any:
    """sigma(u) in the plane, Pa."""
    return 2.0 * lame_mu * strain(u) + lame_lambda * ufl.tr(strain(u)) * ufl.Identity(2)


def _material_fields(scene: Scene) -> list[fem.Function]:
    space = compat.function_space(scene.mesh.domain, "DG", 0)
    materials = [scene.material(groups) for groups in scene.mesh.cell_sets]
    fields = []
    for key in ("young", "poisson", "density"):
        values = np.array([getattr(material, key) for material in materials])
        field = fem.Function(space)
        field.x.array[compat.cell_dofs(space)[:, 0]] = values[scene.mesh.cell_groups]
        fields.append(field)
    return fields


def _lame(
    scene: Scene, young: fem.Function, poisson: fem.Function
) -> tuple[fem.Function, fem.Function]:
    e, nu = young.x.array, poisson.x.array
    lame_lambda, lame_mu = fem.Function(young.function_space), fem.Function(young.function_space)
    lame_mu.x.array[:] = e / (2.0 * (1.0 + nu))
    if scene.plane == "strain":
        lame_lambda.x.array[:] = e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    else:
        lame_lambda.x.array[:] = e * nu / (1.0 - nu**2)
    return lame_lambda, lame_mu


def _load(
    scene: Scene, space: Any, boundary: Boundary, load: Load, density: fem.Function
) -> PETSc.Vec:
    domain = scene.mesh.domain
    v = ufl.TestFunction(space)
    force = fem.Constant(domain, PETSc.ScalarType(load.body))
    vector = fem_petsc.assemble_vector(fem.form(density * ufl.inner(force, v) * ufl.dx))
    for name, traction in load.traction.items():
        if name in boundary.interior:
            boundary.role([name])  # raises: a traction acts on the outside of a block
        facets = np.sort(boundary.local_facets[boundary.in_group(name)[boundary.local]])
        tags = dolfinx_mesh.meshtags(domain, 1, facets, np.ones(len(facets), dtype=np.int32))
        ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)
        force = fem.Constant(domain, PETSc.ScalarType(traction))
        fem_petsc.assemble_vector(vector, fem.form(ufl.inner(force, v) * ds(1)))
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return vector


def _bodies_of_nodes(
    scene: Scene, space: Any
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """Body of every local node, and the mean node position of every body."""
    position = space.tabulate_dof_coordinates()[:, :2]
    node_body = np.zeros(len(position), dtype=np.int32)
    node_body[compat.cell_dofs(space)] = scene.mesh.body[:, None]
    owned = node_body[: space.dofmap.index_map.size_local]
    sums = np.column_stack(
        [np.bincount(owned, w, scene.mesh.body_count) for w in (None, *position[: len(owned)].T)]
    )
    sums = scene.comm.allreduce(sums)
    return node_body, sums[:, 1:] / sums[:, :1]


def _resultants(
    scene: Scene,
    space: Any,
    load: PETSc.Vec,
    node_body: npt.NDArray[np.int32],
    centre: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Force and moment of nodal forces on every body, shape (bodies, 3)."""
    force = load.array_r.reshape(-1, 2)
    body = node_body[: len(force)]
    arm = space.tabulate_dof_coordinates()[: len(force), :2] - centre[body]
    moment = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
    columns = [np.bincount(body, w, scene.mesh.body_count) for w in (*force.T, moment)]
    return scene.comm.allreduce(np.column_stack(columns))
