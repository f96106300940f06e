"""The capacity curve: load factor against the displacement that does the live load's work."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

from petsc4py import PETSc

from fenics_contact.analysis.coulomb import CoulombFriction
from fenics_contact.analysis.result import CapacityPoint
from fenics_contact.errors import SolverError
from fenics_contact.solvers.interior_point import WorkControl
from fenics_contact.solvers.kkt import Scales, State
from fenics_contact.solvers.problem import ContactProblem
from fenics_contact.solvers.joint_stiffness import SpringStiffness

_log = logging.getLogger("fenics_contact")

#: The curve ends at this multiple of the work at which the collapse begins.
BEYOND_ONSET = 1.4


def capacity_curve(
    problem: ContactProblem,
    springs: SpringStiffness,
    scales: Scales,
    start: State,
    onset: float,
    points: int,
    tolerance: float,
    monitor: Callable[[int, int, CapacityPoint], None] | None = None,
) -> list[CapacityPoint]:
    """Follow the load path at rising T, each state starting from the one before.

    Slip is measured from the stress-free state at every T.

    Args:
        problem: Structure with its live load.
        springs: Its stiffness with joint springs.
        scales: Typical sizes on the elastic part of the path.
        start: Bonded response, with the pressures that give the first bound on friction.
        onset: Work at which the collapse begins.
        points: Number of points.
        tolerance: On load factor and bound.
        monitor: Called after every point with its number, the number of points, and the point.

    Returns:
        The points found; one that is not found is left out.
    """
    control = WorkControl(problem, springs)
    unit = problem.live.norm(PETSc.NormType.N1)
    state, bound = start, problem.bound(start.pressure)
    curve: list[CapacityPoint] = []
    # Denser at first, where the path bends.
    for number in range(1, points + 1):
        fraction = (number / points) ** 1.5
        work = float(BEYOND_ONSET * onset * fraction)
        displacement = state.displacement.copy()
        displacement.scale(work / state.work)
        guess = replace(state, displacement=displacement, work=work)
        sizes = replace(scales, displacement=max(work / unit, scales.displacement))
        friction = CoulombFriction(control, sizes, tolerance, monolithic=True)
        try:
            point, history = friction.solve(guess, bound, work, warm=bool(curve))
        except SolverError as error:
            _log.info("capacity curve: no state with T = %.3g: %s", work, error)
            continue
        finally:
            displacement.destroy()
        state, bound = point.state, point.bound
        curve.append(CapacityPoint(work / unit, state.load_factor, work, history.converged))
        if monitor is not None:
            monitor(number, points, curve[-1])
    control.destroy()
    return curve
