"""The state under a given multiple of the live load, verified from the problem itself.

K u = f_D + lambda f_L + B_N^T r_N + B_T^T r_T,   lambda given,   the joints' laws as ever.

Programs of rigid blocks tell first whether there may be one. The fields of elastic blocks come from
a load factor that rises to the one given, in as few steps as find equilibrium. Where none is found
so, and at once for the program `stands`, blocks are strained by the forces of their faces.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_contact.collapse.face_collapse import force_residuals, strained_state
from fenics_contact.collapse.least_forces import least_forces
from fenics_contact.collapse.load_case import LoadCase, joint_values
from fenics_contact.collapse.load_control import raise_load_to
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.discretization.layout import Layout
from fenics_contact.errors import NoEquilibriumError, SolverError
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.faces.programs import state_under
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.certificate import state_residuals, tolerances
from fenics_contact.results.result import ServiceState
from fenics_contact.results.values import fall_reason
from fenics_contact.solvers.problem import ContactProblem, State


def without_equilibrium(
    layout: Layout, blocks: RigidBlocks, load_factor: float, sign: float
) -> ServiceState | None:
    """The answer for a load that rigid blocks with associative friction prove to be too large.

    None if they carry it. No matrix is factored.

    Args:
        layout: Of the blocks.
        blocks: Rigid-block programs of one direction of the live load.
        load_factor: Not negative.
        sign: 1 for the live load as given, -1 for that load reversed.
    """
    fall = blocks.fall(load_factor)
    if fall is None:
        return None
    if load_factor == 0.0:
        return ServiceState("unstable", 0.0, reason=fall_reason(layout, fall), fall=fall)
    reason = "with associative friction rigid blocks do not stand under the dead load alone"
    if blocks.stands():
        upper = blocks.limit()
        most = "do not stand" if upper is None else f"carry {sign * upper:.6g} at most"
        reason = f"with associative friction rigid blocks {most}"
    return ServiceState("no_equilibrium", sign * load_factor, reason=reason)


def rests(layout: Layout) -> bool:
    """Whether joint faces tell of an elastic state under the dead load alone. Collective.

    It is only asked where rigid blocks with associative friction have an equilibrium. Faces do not
    tell where strains decide: what a support that moves presses on, how far a curved side rolls.
    """
    faces = PlanarFaces.of(layout)
    model = faces.model
    strains = layout.scene.dead.movement or np.any(layout.joints.curvature > 0.0)
    if strains and not np.any(model.kappa):  # elastic blocks have no strength
        return False
    if not (np.any(model.free_friction) and np.any(model.dead)):
        return True  # as the programs say
    return _forces_under(layout, faces, 0.0) is not None


def _forces_under(layout: Layout, faces: PlanarFaces, load_factor: float) -> Array | None:
    """Forces of the faces in an elastic state, shape (faces, 3), on all ranks; None without one."""
    comm = layout.scene.comm
    found = state_under(faces.model, load_factor) if comm.rank == 0 else None
    return comm.bcast(None if found is None else found.force)


def service_state(case: LoadCase, load_factor: float, steps: int = 1) -> ServiceState:
    """State of elastic blocks at a load factor >= 0, reached in steps from the dead load.

    Or that of their faces, where none is found.
    """
    try:
        if case.blocks.has_strength:
            raise SolverError("no elastic state was found by the forces of joint faces")
        problem, state = raise_load_to(case, load_factor, steps)
    except SolverError as error:
        none = "no_equilibrium" if isinstance(error, NoEquilibriumError) else "not_converged"
        nothing = ServiceState(none, case.sign * load_factor, reason=str(error))
        return face_state(case, load_factor) or nothing
    larger = max(1.0, state.load_factor / case.scales.load_factor)
    sizes = case.scales.elastic, case.scales.force  # elastic: not those of moving supports
    scales = replace(case.scales, displacement=larger * sizes[0], force=larger * sizes[1])
    return _verified(case, problem, state, state_residuals(problem, state, scales))


def face_state(case: LoadCase, load_factor: float) -> ServiceState | None:
    """The state of joint faces with the strains of the blocks under their forces, if verified."""
    whole = case.discretization
    faces = PlanarFaces.of(whole, case.sign)
    # What only the live load holds falls before.
    force = _forces_under(whole, faces, load_factor) if rests(whole) else None
    if force is None:
        return None
    state = strained_state(case, faces, force, load_factor)
    found = _verified(case, case.problem, state, force_residuals(case, faces, force, state))
    return replace(found, engine="faces") if found.status == "equilibrium" else None


def _verified(
    case: LoadCase, problem: ContactProblem, state: State, residuals: dict[str, float]
) -> ServiceState:
    """A state held against the problem in which it was found, in the user's sign of the load."""
    allowed = tolerances()
    missed = [name for name, value in residuals.items() if not value <= allowed[name]]
    sign = case.sign
    written = case.written(state)
    whole = case.discretization
    values = joint_values(problem, whole, state, state.displacement)
    if not case.blocks.has_strength:  # that binds forces at a corner
        values = least_forces(whole, values)
    return ServiceState(
        "not_converged" if missed else "equilibrium",
        sign * state.load_factor,
        replace(written, load_factor=sign * state.load_factor, work=sign * written.work),
        values,
        residuals,
        f"not verified: {', '.join(missed)}" if missed else "",
    )
