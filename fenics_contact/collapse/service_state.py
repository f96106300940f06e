"""The state under a given multiple of the live load, verified from the problem itself.

K u = f_D + lambda f_L + B_N^T r_N + B_T^T r_T,   lambda given,   the joints' laws as ever.

The load factor rises from the dead load to the one given, in as few steps as find equilibrium.
"""

from __future__ import annotations

from dataclasses import replace

from fenics_contact.collapse.dead_load import dead_load_state
from fenics_contact.collapse.face_collapse import force_residuals, strained_state
from fenics_contact.collapse.least_forces import least_forces
from fenics_contact.collapse.load_case import LoadCase, joint_values
from fenics_contact.collapse.load_control import raise_load_to
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.collapse.strategy import Strategy
from fenics_contact.discretization.layout import Layout
from fenics_contact.errors import NoEquilibriumError, SolverError
from fenics_contact.faces.given_load import state_under
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.results.certificate import TOLERANCES, state_residuals
from fenics_contact.results.moving_blocks import fall_reason
from fenics_contact.results.service_state import ServiceState
from fenics_contact.scene.scene import SolveOptions
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


def service_state(
    case: LoadCase, strategy: Strategy, options: SolveOptions, load_factor: float, steps: int
) -> ServiceState:
    """State of a load case at a load factor >= 0, reached in steps from the dead load."""
    if case.blocks.crushes:
        return _by_faces(case, load_factor)
    try:
        dead = dead_load_state(case, strategy, options.tolerance) if case.has_dead_load else None
        reached = raise_load_to(case, strategy, options, (load_factor, steps), dead)
    except NoEquilibriumError as error:
        return ServiceState("no_equilibrium", case.sign * load_factor, reason=str(error))
    except SolverError as error:
        return ServiceState("not_converged", case.sign * load_factor, reason=str(error))
    larger = max(1.0, reached.state.load_factor / case.scales.load_factor)
    sizes = case.scales.elastic, case.scales.force  # elastic: not those of moving supports
    scales = replace(case.scales, displacement=larger * sizes[0], force=larger * sizes[1])
    residuals = state_residuals(reached.problem, reached.state, scales)
    return _verified(case, reached.problem, reached.state, residuals)


def _by_faces(case: LoadCase, load_factor: float) -> ServiceState:
    """The state of faces that crush, with the strains of the blocks under their forces."""
    faces = PlanarFaces.of(case.discretization, case.sign)
    found = None
    if case.problem.comm.rank == 0:
        found = state_under(faces.model, load_factor)
    found = case.problem.comm.bcast(found)
    if found is None:
        reason = "no elastic state was found by the forces of joint faces"
        return ServiceState("not_converged", case.sign * load_factor, reason=reason)
    state = strained_state(case, faces, found.force, load_factor)
    return _verified(case, case.problem, state, force_residuals(case, faces, found.force, state))


def _verified(
    case: LoadCase, problem: ContactProblem, state: State, residuals: dict[str, float]
) -> ServiceState:
    """A state held against the problem in which it was found, in the user's sign of the load."""
    missed = [name for name, value in residuals.items() if not value <= TOLERANCES[name]]
    sign = case.sign
    written = case.written(state)
    whole = case.discretization
    values = joint_values(problem, whole, state, state.displacement)
    if not case.blocks.crushes:  # else forces at a corner are bound by the strength of their faces
        values = least_forces(whole, values)
    return ServiceState(
        "not_converged" if missed else "equilibrium",
        sign * state.load_factor,
        replace(written, load_factor=sign * state.load_factor, work=sign * written.work),
        values,
        residuals,
        f"not verified: {', '.join(missed)}" if missed else "",
    )
