"""What the joints of a result do: forces, gap, slip and state at every joint point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.solvers.kkt import State
from fenics_contact.discretization.discretization import Structure

Array = npt.NDArray[np.float64]

OPEN, SLIP, STICK = 0, 1, 2
STATES = ("open", "slip", "stick")

#: A joint point with less than this fraction of the largest normal force is open.
NO_PRESSURE = 1e-6

#: A joint point that moves more than this fraction of the fastest one slips.
SLIPPING = 1e-4


@dataclass(frozen=True)
class JointFields:
    """Joint points of a result; on all ranks.

    Attributes:
        normal_force: r_N >= 0, N per metre of thickness, shape (points,).
        shear_force: r_T on the second side along the tangent, likewise.
        pressure: r_N over the length of the point, Pa.
        shear: r_T over the length of the point, Pa.
        gap: Opening, m.
        slip: Slip, m.
        opening_rate: Opening in the collapse mode.
        slip_rate: Slip in the collapse mode.
        state: `OPEN`, `SLIP` or `STICK`.
    """

    normal_force: Array
    shear_force: Array
    pressure: Array
    shear: Array
    gap: Array
    slip: Array
    opening_rate: Array
    slip_rate: Array
    state: npt.NDArray[np.int64]


def joint_fields(structure: Structure, state: State, mode: PETSc.Vec) -> JointFields:
    """Gather the joints' share of a state and its mode (joint-sized data) on all ranks."""
    problem = structure.problem
    everything = structure.all_points
    gap, slip = map(everything, problem.joint_displacements(state.displacement))
    opening_rate, slip_rate = map(everything, problem.joint_displacements(mode))
    normal_force, shear_force = everything(state.pressure), everything(state.shear)
    fastest = max(np.abs(opening_rate).max(initial=0.0), np.abs(slip_rate).max(initial=0.0))
    moving = np.abs(slip_rate) > SLIPPING * fastest
    parting = opening_rate > SLIPPING * fastest
    loaded = normal_force > NO_PRESSURE * normal_force.max(initial=0.0)
    kind = np.where(moving, SLIP, STICK)
    kind[~loaded | parting] = OPEN
    length = structure.joints.length
    return JointFields(
        normal_force,
        shear_force,
        normal_force / length,
        shear_force / length,
        gap,
        slip,
        opening_rate,
        slip_rate,
        kind,
    )
