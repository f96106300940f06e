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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.analysis.load_case import SIGNS, LoadCase
from fenics_contact.analysis.load_control import raise_load
from fenics_contact.analysis.result import Collapse
from fenics_contact.analysis.strategy import Strategy, Task, strategy_of
from fenics_contact.analysis.work_control import find_collapse
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


def reaching_zero(
    cases: Mapping[str, LoadCase], found: Mapping[str, Collapse], asked: Sequence[str]
) -> dict[str, Collapse]:
    """Ends of the range of load factors, from a state under the dead load alone where need be.

    An end below zero leaves out the dead load alone, which then has no equilibrium on the way
    there. Another one is looked for, and the load factor rises from it.
    """
    case = next(iter(cases.values()))
    scene = case.discretization.scene
    options, strategy = scene.solve, strategy_of(scene)
    margin = -options.tolerance * case.scales.load_factor
    short = {n for n, end in found.items() if end.status == "limit" and end.load_factor < margin}
    if not short:
        return dict(found)
    factors = sorted(SIGNS[name] * end.load_factor for name, end in found.items())
    reason = (
        "no equilibrium was found under the dead load alone, only with load factors from"
        f" {factors[0]:.6g} to {factors[-1]:.6g}"
    )
    state = dead_load_state(case, strategy, options.tolerance)
    if state is None:
        return {n: replace(end, status="not_converged", reason=reason) for n, end in found.items()}
    ends = dict(found)
    for name in short.intersection(asked):
        problem = cases[name].problem
        start = problem.state(state.displacement, 0.0, state.pressure, state.shear)
        end = raise_load(cases[name], strategy, options, find_collapse, start)
        if end.load_factor < margin and end.path is not None:
            reason = (
                f"equilibrium was found up to a load factor of {SIGNS[name] * end.path.lower:.6g},"
                f" and a collapse only at {SIGNS[name] * end.load_factor:.6g}"
            )
            end = replace(end, status="not_converged", reason=reason)
        ends[name] = end
    return ends
