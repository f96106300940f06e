"""Equilibrium under the dead load alone, where the live load leads past it.

Where both ends of the range of load factors have one sign, the states on the way to them leave out
the dead load alone. Then it is looked for directly: the dead load is the one that does the work,

    K u = lambda f_D + B_N^T r_N + B_T^T r_T,   f_D . u = T > 0,   the joints' laws as ever.

Without strengths of their own the laws hold for every multiple of a state. So (u, r) / lambda is a
state of equilibrium under f_D if lambda > 0. With lambda = 0 the dead load moves the blocks as a
mechanism, and this state says nothing of others.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.strategy import Strategy, Task
from fenics_contact.errors import SolverError
from fenics_contact.solvers.problem import Scales, State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class DeadLoadOptions:
    """Numbers of the search.

    Attributes:
        least: Least lambda, with the work on the bonded structure: blocks that would have to move
            by its reciprocal, in units of the bonded displacement, are a mechanism.
    """

    least: float = 1e-4


OPTIONS = DeadLoadOptions()


def dead_load_state(case: LoadCase, strategy: Strategy, tolerance: float) -> State | None:
    """State of equilibrium under the dead load alone; None if none is found.

    Args:
        case: The load case; its joints have no strength of their own.
        strategy: How states are found.
        tolerance: On the load factor, relative.
    """
    problem, bonded = case.problem, case.bonded
    work = problem.dot(problem.dead, bonded.dead)
    if work <= 0.0 or problem.max(problem.strength) > 0.0:
        return None
    none = np.zeros_like(problem.dead)
    displacement = work / problem.sum(np.abs(problem.dead))
    scales = Scales(displacement, case.scales.force, 1.0, displacement)
    alone = replace(
        case,
        problem=replace(problem, dead=none, live=problem.dead),
        bonded=replace(bonded, dead=none, live=bonded.dead, live_pressure=bonded.dead_pressure),
        scales=scales,
        monitor=lambda step: None,
    )
    task = Task(alone, work, scales, tolerance)
    for attempt in strategy.attempts:
        try:
            state = attempt(task)[0].state
        except SolverError as error:
            _log.info("  dead load alone: %s", error)
            continue
        part = state.load_factor
        _log.info("  dead load alone: %.3g of it does the work on the bonded structure", part)
        if part > OPTIONS.least:
            u = state.displacement / part
            return problem.state(u, 0.0, state.pressure / part, state.shear / part)
    return None
