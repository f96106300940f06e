"""Body forces with a profile over the height h above the foot of the structure.

The acceleration is c(h) b. A profile in straight lines is a sum of ramps,

    c(h) = c_0 + sum_i s_i max(h - h_i, 0),

each of which is one assembly of the same form. The height is measured against the dead body
force, or along y where there is none; the foot is the lowest corner of all blocks. "triangular" is
c = h / H, with the height H of the centre of mass, so that the total is that of the uniform load:
F_i = F z_i m_i / sum(z_j m_j) of EN 1998-1:2004, (4.11), and of NTC 2018, (7.3.7).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.discretization import forms
from fenics_contact.geometry.mesh import Array
from fenics_contact.scene.scene import Load, Scene

#: Level, m, and slope, 1/m, of a ramp.
Ramp = tuple[float, float]


def add_body_force(
    forces: fem.Function, scene: Scene, load: Load, body_load: forms.BodyLoad
) -> None:
    """Add the nodal forces of a body force with its profile, those at ghosts too. Collective."""
    space = forces.function_space
    body = np.array(load.acceleration)
    if load.profile == "uniform":
        _add(forces, body_load.form(load.acceleration))
    elif isinstance(load.profile, str):
        forces.x.array[:] += _triangular(scene, space, body, body_load)
    else:
        first, ramps = _table(load.profile)
        _add(forces, body_load.form((first * body[0], first * body[1])))
        forces.x.array[:] += _ramps(scene, space, body, body_load.density, ramps)


def up_and_foot(scene: Scene) -> tuple[Array, float]:
    """Unit vector against the dead body force, and the lowest height along it, m. Collective."""
    weight = np.array(scene.dead.acceleration)
    size = float(np.linalg.norm(weight))
    up = -weight / size if size > 0.0 else np.array([0.0, 1.0])
    height = scene.mesh.domain.geometry.x[:, :2] @ up
    foot = scene.comm.allreduce(float(height.min(initial=np.inf)), MPI.MIN)
    return up, foot


def _add(forces: fem.Function, form: fem.Form) -> None:
    fem.assemble_vector(forces.x.array, form)


def _table(pairs: Sequence[tuple[float, float]]) -> tuple[float, list[Ramp]]:
    """Factor below the first height, and where the slope changes by how much."""
    slopes = [(b - a) / (high - low) for (low, a), (high, b) in pairwise(pairs)]
    changes = np.diff([0.0, *slopes, 0.0])
    levels = [height for height, _ in pairs]
    return pairs[0][1], [(h, float(c)) for h, c in zip(levels, changes, strict=True) if c != 0.0]


def _triangular(scene: Scene, space: Any, body: Array, body_load: forms.BodyLoad) -> Array:
    """Nodal forces that grow from the foot, with the total of the uniform body force."""
    uniform = fem.Function(space)
    _add(uniform, body_load.form((body[0], body[1])))
    rising = _ramps(scene, space, body, body_load.density, [(0.0, 1.0)])
    along = np.array([values.reshape(-1, 2).sum(axis=0) for values in (uniform.x.array, rising)])
    total, per_slope = scene.comm.allreduce(along @ body)
    return rising * (total / per_slope) if per_slope > 0.0 else rising


def _ramps(
    scene: Scene, space: Any, body: Array, density: fem.Function, ramps: Sequence[Ramp]
) -> Array:
    """Nodal forces of a sum of ramps times a body force."""
    up, foot = up_and_foot(scene)
    forces = fem.Function(space)
    force = fem.Constant(space.mesh, PETSc.ScalarType(body))
    upward = fem.Constant(space.mesh, PETSc.ScalarType(up))
    level = fem.Constant(space.mesh, PETSc.ScalarType(0.0))  # in this order, as forms are cached
    form = forms.ramp_load(density, space, force, upward, level)
    for height, slope in ramps:
        level.value = foot + height
        force.value = slope * body
        _add(forces, form)
    return np.asarray(forces.x.array)
