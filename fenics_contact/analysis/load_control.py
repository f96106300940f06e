"""Equilibrium at load factors that rise from the dead load: the limit load between two of them.

The load factor is prescribed and raised in steps, each starting from the state before. Where no
equilibrium is found the step is shortened, until the last load factor with a state of equilibrium
and the first without are close. Slip is measured from the stress-free state, or from the step
before, the dead load first (L.A. Mihai, M. Ainsworth, Comput. Struct. 88 (2010) 859).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.analysis.coulomb import CoulombFriction, FixedPointHistory
from fenics_contact.analysis.result import LoadStep
from fenics_contact.errors import SolverError
from fenics_contact.solvers.kkt import Scales, State
from fenics_contact.solvers.problem import ContactProblem

Array = npt.NDArray[np.float64]

_log = logging.getLogger("fenics_contact")

#: First step as a fraction of the upper bound, or of the typical load factor if that is less.
FIRST_STEP = 0.25

#: Factor by which steps grow where the last one was found.
STEP_GROWTH = 1.5

#: Load factors beyond this multiple of the typical one are not looked at.
LARGEST = 1e3

#: States that moved this many typical displacements are a mechanism in motion.
FAR = 1e6

MAX_STEPS = 200


@dataclass(frozen=True)
class LoadPath:
    """What the continuation found.

    Attributes:
        steps: States of equilibrium at rising load factors, that of the dead load first.
        lower: Largest load factor with a state of equilibrium.
        upper: Least load factor at which none was found; infinite if none failed below the bound.
        state: State at `lower`.
        direction: Direction in which the displacements moved last, f_L.v = 1; None if there is no
            state besides that of the dead load.
    """

    steps: tuple[LoadStep, ...]
    lower: float
    upper: float
    state: State
    direction: PETSc.Vec | None


def follow_load(
    problem: ContactProblem,
    friction: Callable[[Scales, float], CoulombFriction],
    start: State,
    scales: Scales,
    upper: float,
    width: float,
    by_steps: bool,
    monitor: Callable[[LoadStep], None] | None = None,
) -> LoadPath:
    """Raise the load factor from zero until the limit load lies between two close load factors.

    Args:
        problem: The structure; its origin of slip is moved if slip is measured by steps.
        friction: Makes a solver for typical sizes and a prescribed load factor.
        start: Bonded state under the dead load.
        scales: Typical sizes.
        upper: Bound above which there is no equilibrium; infinite if there is none.
        width: Distance of the two load factors relative to the lower one.
        by_steps: Measure slip from the step before, not from the stress-free state.
        monitor: Called after every state found.

    Returns:
        The path.

    Raises:
        SolverError: If no equilibrium is found under the dead load.
    """
    unit = problem.live.norm(PETSc.NormType.N1)
    state, direction = start, start.displacement.copy()
    bound = problem.bound(start.pressure)
    steps: list[LoadStep] = []
    step = FIRST_STEP * min(upper, scales.load_factor)
    lower, failed, target = 0.0, np.inf, 0.0
    again = False
    sizes = scales
    for _ in range(MAX_STEPS):
        solver = friction(sizes, target)
        try:
            point, history = solver.solve(state, bound, state.work, warm=bool(steps))
        except SolverError as error:
            _log.debug("  %s", error)
            point, history = None, FixedPointHistory()
        far = FAR * scales.displacement * unit
        moving = point is not None and abs(problem.live.dot(point.state.displacement)) > far
        if point is None or moving or not history.converged:
            if not steps:
                raise SolverError("no equilibrium was found under the dead load")
            _log.info("  load factor %.8g: no equilibrium found", target)
            failed = target
            if again:
                break
        else:
            if again:
                failed, step = np.inf, 2.0 * (target - lower)
            again = False
            lower = target
            work = problem.live.dot(point.state.displacement)
            steps.append(LoadStep(target, work / unit, work))
            _log.info("  load factor %.8g: equilibrium, f_L.u = %.4g", target, work)
            if monitor is not None:
                monitor(steps[-1])
            direction = point.state.displacement.copy()
            direction.axpy(-1.0, state.displacement)
            state, bound = point.state, problem.bound(point.state.pressure)
            if by_steps:
                problem.measure_slip_from(state.displacement)
            sizes = replace(scales, displacement=max(scales.displacement, abs(work) / unit))
            step = STEP_GROWTH * step if len(steps) > 2 else step
        end = min(failed, upper)
        narrow = max(width * lower, 1e-3 * width * scales.load_factor)
        if lower > LARGEST * scales.load_factor or upper - lower <= narrow:
            break
        # A step that was too long for the solver is tried once more from close by.
        again = end - lower <= narrow
        target = failed if again else lower + min(step, 0.5 * (end - lower))
    moved = problem.live.dot(direction)
    if len(steps) < 2 or not moved > 0.0:
        return LoadPath(tuple(steps), lower, failed, state, None)
    direction.scale(1.0 / moved)
    return LoadPath(tuple(steps), lower, failed, state, direction)
