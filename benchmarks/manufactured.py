"""Orders of convergence: a limit load with a known smooth solution.

Two blocks on top of each other fill the gap between a rigid floor and a rigid ceiling. The joint
between them sticks; floor and ceiling slide as the live load pushes the blocks to the right. The
displacement field and the pressures on floor, joint and ceiling are chosen, and so is the load
factor, 1. The dead load is what then keeps the balance, f_D(v) = a(u, v) - contact forces - f_L(v).
Nothing but the elasticity of the blocks says how much of the normal force floor and ceiling carry:
the limit load depends on it through their friction.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, compat
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.strategy import strategy_of
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.discretization import forms
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import wall
from fenics_contact.output.fields import displacement_function
from fenics_contact.results.result import Collapse
from tests.drawing import Drawing

Array = npt.NDArray[np.float64]

#: Typical displacement (m), Young's modulus (Pa), pressure (Pa), and friction at floor and ceiling.
DELTA, YOUNG, PRESSURE, FRICTION = 1e-3, 1e9, 1e6, 0.1

#: Order of each error by theory, for degree p of the displacements.
THEORY = {
    "displacement": lambda p: p + 1,
    "energy": lambda p: p,
    "traction": lambda p: p,
    "load factor": lambda p: 2 * p,
}


def exact_displacement(x: Any) -> Any:
    """The displacement field, m, up to a motion of both blocks along floor and ceiling."""
    along = 1.0 + 0.3 * ufl.sin(1.3 * x[0] + 0.4) * ufl.cos(1.1 * x[1])
    return DELTA * ufl.as_vector([along, 0.4 * ufl.sin(0.5 * np.pi * x[1]) * ufl.cos(1.2 * x[0])])


def exact_traction(x: Any, sin: Any = ufl.sin) -> dict[float, tuple[Any, Any]]:
    """Pressure and shear on what lies above, Pa, by height of floor, joint and ceiling."""
    floor = PRESSURE * (1.0 + 0.3 * sin(2.0 * x))
    joint = PRESSURE * (1.05 + 0.3 * sin(1.5 * x + 1.0)), 0.2 * PRESSURE * sin(2.0 * x)
    ceiling = PRESSURE * (1.1 + 0.2 * sin(2.0 * x + 1.5))
    return {0.0: (floor, -FRICTION * floor), 1.0: joint, 2.0: (ceiling, FRICTION * ceiling)}


def waisted(points: Array) -> Array:
    """Points of a column of width 1 with a waist on its right, at right angles to its ends.

    With straight sides the share of floor and ceiling would be exact on every mesh.
    """
    width = 0.65 + 0.35 * np.cos(np.pi * points[:, 1])
    return np.column_stack([points[:, 0] * width, points[:, 1]])


def column(elements: tuple[int, int]) -> Drawing:
    """Two blocks of 1 m x 1 m with a waist, each with an even number of elements along a side."""
    low, high = (Drawing.of(wall([[1.0]], (1.0, 1.0), count // 2)) for count in elements)
    count = len(low.points)
    return Drawing(
        waisted(np.concatenate([low.points, high.points + np.array([0.0, 1.0])])),
        {"blocks": np.concatenate([low.cells["blocks"], high.cells["blocks"] + count])},
        {"base": low.facets["base"], "top": high.facets["top"] + count},
    )


def scene_of(elements: tuple[int, int], degree: int) -> Scene:
    """The column on a floor and below a ceiling; elements of the lower and of the upper block."""
    slides, area = JointLaw(friction=FRICTION), 1.3
    return Scene(
        BlockMesh.from_model(column(elements).model(), MPI.COMM_WORLD),
        {"default": Material(YOUNG, 0.3, 1.0)},
        live=Load((2.0 * FRICTION * PRESSURE / area, 0.0)),
        joints={"default": JointLaw(friction=0.7)},
        foundations={"base": slides, "top": slides},
        degree=degree,
    )


class Manufactured(Discretization):
    """The scene with the dead load for which the chosen fields are its limit state."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        made = self.elasticity
        v = ufl.TestFunction(made.space)
        dead = fem.Function(made.space)
        x, n = ufl.SpatialCoordinate(made.space.mesh), ufl.FacetNormal(made.space.mesh)
        inner = ufl.inner(self.exact_stress(x), forms.strain(v)) * ufl.dx(degree=8)
        fem.assemble_vector(dead.x.array, fem.form(inner))
        for height, (pressure, shear) in exact_traction(x[0]).items():
            here = ufl.conditional(ufl.lt(abs(x[1] - height), 1e-6), 1.0, 0.0)
            force = here * n[1] * ufl.as_vector([-shear, -pressure])
            fem.assemble_vector(dead.x.array, fem.form(-ufl.inner(force, v) * ufl.ds(degree=8)))
        compat.add_ghosts(dead.x)
        values = dead.x.array[: len(made.dead)] - made.live
        self.problem = replace(self.problem, dead=values)
        self.bodies = replace(self.bodies, dead=self.resultants(values))

    def exact_stress(self, x: Any) -> Any:
        """Stress of the chosen displacements, Pa."""
        return forms.stress(exact_displacement(x), *self.elasticity.lame)

    def resultants(self, values: Array) -> Array:
        """Force, and moment over the structure's size, of nodal forces on every body."""
        (x, y), arm = values.reshape(-1, 2).T, self.elasticity.arm
        parts = x, y, (arm[:, 0] * y - arm[:, 1] * x) / self.bodies.size
        count = len(self.bodies.centre)
        sums = [np.bincount(self.elasticity.node_body, part, count) for part in parts]
        return self.scene.comm.allreduce(np.column_stack(sums))


def errors(elements: int, degree: int, matching: bool = True) -> dict[str, float]:
    """Relative errors of the limit state, by name, with a number of elements along a block.

    Where nodes do not match, the upper block has half as many elements again.
    """
    scene = scene_of((elements, elements if matching else 3 * elements // 2), degree)
    with Manufactured(scene) as made:
        bonded = made.bonded()
        case = LoadCase.of(made, bonded, 1.0, lambda step: None)
        found = find_collapse(case, strategy_of(scene), 1e-10)
        if found.status != "limit":
            raise RuntimeError(f"{found.status}: {found.certificate}")
        u = displacement_function(made, found.state.displacement, "displacement")
        return {
            **_field_errors(made, u),
            "traction": _traction_error(made, found),
            "load factor": abs(found.load_factor - 1.0),
        }


def _field_errors(made: Manufactured, u: fem.Function) -> dict[str, float]:
    x = ufl.SpatialCoordinate(u.function_space.mesh)
    exact, dx = exact_displacement(x), ufl.dx(degree=8)

    def total(integrand: Any) -> float:
        part = fem.assemble_scalar(fem.form(integrand * dx))
        return float(made.scene.comm.allreduce(part))

    miss = u - exact
    one = fem.Constant(u.function_space.mesh, 1.0)
    along = fem.Constant(u.function_space.mesh, total(miss[0]) / total(one))
    miss = miss - ufl.as_vector([along, 0.0])
    stress = forms.stress(miss, *made.elasticity.lame)
    energy = total(ufl.inner(stress, forms.strain(miss)))
    whole = total(ufl.inner(made.exact_stress(x), forms.strain(exact)))
    return {
        "displacement": np.sqrt(total(ufl.inner(miss, miss)) / total(ufl.inner(exact, exact))),
        "energy": np.sqrt(energy / whole),
    }


def _traction_error(made: Manufactured, found: Collapse) -> float:
    """L2 error of pressure and shear over floor, joint and ceiling, relative."""
    joints, values = made.joints, found.joints
    # Force on what lies above, whichever side comes first.
    force = values.force(joints.normal, joints.tangent) / joints.length[:, None]
    force *= np.where(joints.normal[:, 1] > 0.0, 1.0, -1.0)[:, None]
    exact = np.zeros_like(force)
    for height, (pressure, shear) in exact_traction(joints.position[:, 0], np.sin).items():
        here = np.abs(joints.position[:, 1] - height) < 1e-6
        exact[here] = np.column_stack([shear, pressure])[here]
    weight = joints.length[:, None]
    return float(np.sqrt(np.sum(weight * (force - exact) ** 2) / np.sum(weight * exact**2)))
