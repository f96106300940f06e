"""Equilibrium under the live load alone, which tells how a load goes on that nothing limits.

Without dead load, given strengths, gaps and movements all conditions are homogeneous,

    K u = lambda f_L + B_N^T r_N + B_T^T r_T,   f_L . u = T,   |r_T| <= F r_N,

so that every multiple of a state is one. Far along, the rest is small beside the live load: where
that has a state of its own, with lambda > 0, load factors grow like lambda T' / T with the work T'.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.collapse.load_case import Attempt, LoadCase, Task
from fenics_contact.collapse.record import name_of
from fenics_contact.errors import SolverError
from fenics_contact.results.certificate import TOLERANCES, state_residuals

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class LiveLoadOptions:
    """Numbers of the search.

    Attributes:
        least: Least lambda at the work on the bonded structure, in units of the typical one: less
            is a mechanism.
        cost: At most, in units of one factorisation of the structure.
    """

    least: float = 1e-4
    cost: float = 100.0


OPTIONS = LiveLoadOptions()


def slope_without_dead_load(
    case: LoadCase, tolerance: float, attempts: Sequence[Attempt]
) -> float | None:
    """Lambda / T of a verified state under the live load alone; None if no attempt finds one."""
    still = np.zeros_like
    problem = case.problem
    none = still(case.problem.dead)
    alone = replace(
        problem,
        dead=none,
        law=problem.law.homogeneous(),
    )
    bonded = replace(case.bonded, dead=none, dead_pressure=still(case.bonded.dead_pressure))
    discretization = case.discretization
    record = case.record
    work = case.bonded_work
    case = replace(case.unrecorded, problem=alone, bonded=bonded, monitor=lambda step: None)
    task = Task(case, work, case.scales_at(work), tolerance)
    count = discretization.factorizations
    effort = discretization.effort
    for attempt in attempts:
        name = f"live load alone, {name_of(attempt)}"
        try:
            with effort.at_most(OPTIONS.cost), record.attempt(name, work, count, effort) as ended:
                state = attempt(task)[0].state
                residuals = state_residuals(alone, state, task.scales)
                holds = all(residuals[law] <= TOLERANCES[law] for law in residuals)
                least = OPTIONS.least * case.scales.load_factor
                if holds and state.load_factor > least:
                    ended("an equilibrium, and so at any size of this load")
                    return state.load_factor / work
                ended("no equilibrium")
        except SolverError as error:
            _log.info("  live load alone: %s", error)
    return None
