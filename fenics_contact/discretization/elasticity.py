"""Linear elasticity of the blocks, assembled: stiffness K, dead load f_D, live load f_L."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.discretization import forms
from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.layout import RigidBodies, free_motions, held_motions, motions
from fenics_contact.discretization.loads import nodal_forces
from fenics_contact.discretization.materials import material_field, stress_law
from fenics_contact.discretization.supports import Supports
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, Labels
from fenics_contact.lazily import fem, fem_petsc
from fenics_contact.parallel import PETSc
from fenics_contact.scene.scene import Scene


@dataclass(frozen=True)
class Elasticity:
    """Assembled elasticity of all blocks.

    Matrix and vectors are in the supports' coordinates, with held rows and columns a diagonal.

    Attributes:
        space: Displacement space.
        stiffness: K, N/m per metre of thickness.
        dead: f_D, N per metre of thickness, this rank's part.
        live: f_L, likewise.
        law: Stress by strain.
        node_body: Body of every node of this rank.
        arm: From the centre of its body to every node of this rank, m, shape (nodes, 2).
        centre: Mean position of the nodes of every body, m, shape (bodies, 2), on all ranks.
        dead_resultant: Force and moment about `centre` on every body, shape (bodies, 3).
        live_resultant: Likewise.
    """

    space: Any
    stiffness: PETSc.Mat
    dead: Array
    live: Array
    law: forms.Law
    node_body: Labels
    arm: Array
    centre: Array
    dead_resultant: Array
    live_resultant: Array

    @property
    def lame(self) -> tuple[fem.Function, fem.Function]:
        """Lame's lambda (of the plane state) and mu by cell, Pa.

        Raises:
            InputError: If the scene has a law of its own.
        """
        if not isinstance(self.law, tuple):
            raise InputError("stress: a law of its own has no Lame's numbers; leave it out here")
        first, second = self.law
        return first, second


def assemble(scene: Scene, space: Any, boundary: Boundary, supports: Supports) -> Elasticity:
    """Assemble K, f_D and f_L of a scene on its displacement space.

    Raises:
        InputError: If a load does not fit the mesh.
    """
    nodes = space.dofmap.index_map
    position = space.tabulate_dof_coordinates()[:, :2]
    body = np.zeros(len(position), dtype=np.int32)
    body[compat.cell_dofs(space)] = scene.mesh.body[:, None]
    body = body[: nodes.size_local]
    position = position[: nodes.size_local]
    sums = _sums_over_bodies(scene, body, np.ones(len(body)), *position.T)
    centre = sums[:, 1:] / sums[:, :1]
    arm = position - centre[body]
    law = stress_law(scene)
    stiffness = fem_petsc.assemble_matrix(forms.stiffness(space, law))
    stiffness.assemble()
    stiffness = supports.constrain_matrix(stiffness)
    none = np.zeros(2 * len(body))
    made = Elasticity(space, stiffness, none, none, law, body, arm, centre, none, none)
    return with_loads(made, scene, boundary, supports)


def with_loads(
    elasticity: Elasticity, scene: Scene, boundary: Boundary, supports: Supports
) -> Elasticity:
    """The blocks of an elasticity under the loads of a scene with the same materials.

    Raises:
        InputError: If a load does not fit the mesh.
    """
    space = elasticity.space
    body = elasticity.node_body
    arm = elasticity.arm
    like = elasticity.law[0] if isinstance(elasticity.law, tuple) else None
    body_load = forms.BodyLoad(
        space, material_field(scene, lambda material: material.density, like)
    )
    loads = []
    resultants = []
    for kind in ("dead", "live"):
        force = nodal_forces(scene, space, boundary, kind, body_load)
        x, y = force.reshape(-1, 2).T
        resultants.append(_sums_over_bodies(scene, body, x, y, arm[:, 0] * y - arm[:, 1] * x))
        first = space.dofmap.index_map.local_range[0]
        loads.append(supports.constrain_vector(force, first))
    dead, live = resultants
    return replace(
        elasticity, dead=loads[0], live=loads[1], dead_resultant=dead, live_resultant=live
    )


def internal_forces(elasticity: Elasticity, supports: Supports, displacement: Array) -> Array:
    """K u where nothing is held, but zero in held entries; both in the supports' coordinates."""
    space = elasticity.space
    count = len(displacement)
    first = space.dofmap.index_map.local_range[0]
    u = fem.Function(space)
    force = fem.Function(space)
    u.x.array[:count] = supports.to_cartesian(displacement, first)
    u.x.scatter_forward()
    fem.assemble_vector(force.x.array, forms.internal_forces(u, elasticity.law))
    compat.add_ghosts(force.x)
    return supports.constrain_vector(force.x.array[:count], first)


def _sums_over_bodies(scene: Scene, body: Labels, *columns: Array) -> Array:
    """Sums of nodal values over every body on all ranks, shape (bodies, columns)."""
    sums = [np.bincount(body, column, scene.mesh.body_count) for column in columns]
    return scene.comm.allreduce(np.column_stack(sums))


def rigid_bodies(elasticity: Elasticity, supports: Supports, boundary: Boundary) -> RigidBodies:
    """Motions that supports leave free, and resultants of the loads."""
    size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
    scale = np.array([1.0, 1.0, 1.0 / size])
    centre = elasticity.centre
    motion = motions(supports.points - centre[supports.body], size)
    gram = held_motions(motion, supports.frame, supports.held, supports.body, len(centre))
    dead = elasticity.dead_resultant * scale
    live = elasticity.live_resultant * scale
    return RigidBodies(centre, size, free_motions(gram), dead, live)
