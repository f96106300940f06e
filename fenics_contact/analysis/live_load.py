"""Equilibrium under the live load alone, which tells how a load goes on that nothing limits.

Without dead load, given strengths, gaps and movements all conditions are homogeneous,

    K u = lambda f_L + B_N^T r_N + B_T^T r_T,   f_L . u = T,   |r_T| <= F r_N,

so that every multiple of a state is one. Far along, the rest is small beside the live load: where
that has a state of its own, with lambda > 0, load factors grow like lambda T' / T with the work T'.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.analysis.certificate import TOLERANCES, state_residuals
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.strategy import (
    Task,
    along_falling_products,
    interior_point,
)
from fenics_contact.errors import SolverError

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


def slope_without_dead_load(case: LoadCase, tolerance: float) -> float | None:
    """Lambda / T of a verified state under the live load alone; None if none is found."""
    problem, none, still = case.problem, np.zeros_like(case.problem.dead), np.zeros_like
    alone = replace(
        problem,
        dead=none,
        strength=still(problem.strength),
        opening_origin=still(problem.opening_origin),
        slip_origin=still(problem.slip_origin),
    )
    bonded = replace(case.bonded, dead=none, dead_pressure=still(case.bonded.dead_pressure))
    case = replace(case, problem=alone, bonded=bonded, monitor=lambda step: None)
    work = case.bonded_work
    task = Task(case, work, case.scales_at(work), tolerance)
    for attempt in (interior_point, along_falling_products):
        try:
            with case.discretization.effort.at_most(OPTIONS.cost):
                state = attempt(task)[0].state
        except SolverError as error:
            _log.info("  live load alone: %s", error)
            continue
        residuals = state_residuals(alone, state, task.scales)
        holds = all(residuals[name] <= TOLERANCES[name] for name in residuals)
        _log.info("  live load alone: load factor %.6g, %s", state.load_factor, residuals)
        if holds and state.load_factor > OPTIONS.least * case.scales.load_factor:
            return state.load_factor / work
    return None
