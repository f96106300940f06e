"""Equilibrium under the dead load alone, where the live load leads past it.

Where both ends of the range of load factors have one sign, the states on the way to them leave out
the dead load alone. Then it is looked for directly: the dead load is the one that does the work,

    K u = lambda f_D + B_N^T r_N + B_T^T r_T,   f_D . u = T > 0,   the joints' laws as ever.

If no joint has a strength of its own or an initial gap, and no support moves, the laws hold for
every multiple of a state: (u, r) / lambda is one of equilibrium under f_D if lambda > 0. With
lambda = 0 the dead load moves the blocks as a mechanism, and this state says nothing of others.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.collapse.load_case import SIGNS, LoadCase, Task
from fenics_contact.collapse.load_control import (
    closed_under_the_dead_load,
    equilibrium_next_to,
    raise_load,
)
from fenics_contact.collapse.strategy import Strategy, strategy_of
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.errors import NoEquilibriumError, SolverError
from fenics_contact.results.result import Collapse
from fenics_contact.results.service_state import NOT_KNOWN
from fenics_contact.solvers.problem import Scales, State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class DeadLoadOptions:
    """Numbers of the search.

    Attributes:
        near: Cost of the search next to the closed joints at most, in units of that which one
            collapse may take: some 60 factorisations, or 12 bonded solves.
        alone: Cost of the search with the dead load in place of the live load: 8 bonded solves.
        least: Least lambda, with the work on the bonded structure: blocks that would have to move
            by its reciprocal, in units of the bonded displacement, are a mechanism.
        missing: Works in a row at which no state is found next to the last one under a rising load:
            those at more work are further away.
        cost: Of a rising load at most, and of the collapse next to its end, in units of one
            factorisation of the structure.
    """

    near: float = 0.12
    alone: float = 0.08
    least: float = 1e-4
    missing: int = 1
    cost: float = 250.0


OPTIONS = DeadLoadOptions()


def dead_load_state(case: LoadCase, strategy: Strategy, tolerance: float) -> State:
    """Equilibrium under the dead load alone, if it is found in 20 bonded solves or so.

    It is looked for next to the closed joints, and then under a load that does some work. With
    strengths, gaps or movements of supports the second does not apply.

    Args:
        case: The load case.
        strategy: How states are found.
        tolerance: On the load factor, relative.

    Raises:
        NoEquilibriumError: If none is found with Coulomb friction.
        SolverError: If none is found otherwise: the rigid-block program proves that there is one.
    """
    effort = case.discretization.effort
    try:
        with effort.at_most(OPTIONS.near * strategy.work.cost):
            closed = closed_under_the_dead_load(case)
            return equilibrium_next_to(case, strategy, tolerance, closed, 0.0)
    except SolverError as error:
        _log.info("  dead load alone: %s", error)
    problem = case.problem
    work = problem.dot(problem.dead, case.bonded.dead)
    given = problem.max(np.abs(problem.law.origins)) + problem.max(problem.law.strength)
    if work > 0.0 and given == 0.0:
        with effort.at_most(OPTIONS.alone * strategy.work.cost):
            state = _under_a_part(_under_the_dead_load(case, work, tolerance), strategy)
        if state is not None:
            part = state.load_factor
            forces = state.pressure / part, state.shear / part
            return problem.state(state.displacement / part, 0.0, *forces)
    if not problem.coulomb:
        raise SolverError("no equilibrium was found under the dead load")
    raise NoEquilibriumError(NOT_KNOWN)


def _under_a_part(task: Task, strategy: Strategy) -> State | None:
    """Equilibrium under a part of the dead load that does the work on the bonded structure."""
    for attempt in strategy.attempts:
        try:
            state = attempt(task)[0].state
        except SolverError as error:
            _log.info("  dead load alone: %s", error)
            continue
        part = state.load_factor
        _log.info("  dead load alone: %.3g of it does the work on the bonded structure", part)
        if part > OPTIONS.least:
            return state
    return None


def _under_the_dead_load(case: LoadCase, work: float, tolerance: float) -> Task:
    """State in which the dead load, in place of the live load, does some work."""
    problem = case.problem
    bonded = case.bonded
    none = np.zeros_like(case.problem.dead)
    displacement = work / problem.sum(np.abs(problem.dead))
    scales = Scales(displacement, case.scales.force, 1.0, displacement)
    alone = replace(
        case,
        problem=replace(problem, dead=none, live=problem.dead),
        bonded=replace(bonded, dead=none, live=bonded.dead, live_pressure=bonded.dead_pressure),
        scales=scales,
        monitor=lambda step: None,
    )
    return Task(alone, work, scales, tolerance)


def reaching_zero(
    cases: Mapping[str, LoadCase], found: Mapping[str, Collapse], asked: Sequence[str]
) -> dict[str, Collapse]:
    """Ends of the range of load factors, from a state under the dead load alone where need be.

    An end below zero leaves out the dead load alone, which then has no equilibrium on the way
    there; an end that is not found may be one at which the live load does negative work. For both
    an equilibrium under the dead load is looked for, from which the load factor rises.

    Args:
        cases: By direction.
        found: Their ends; those that were not asked for tell whether zero is left out.
        asked: Directions asked for.
    """
    case = next(iter(cases.values()))
    scene = case.discretization.scene
    options = scene.solve
    strategy = strategy_of(scene)
    margin = -options.tolerance * case.scales.load_factor
    short = {n for n, end in found.items() if end.status == "limit" and end.load_factor < margin}
    lost = {n for n, end in found.items() if end.status == "not_converged"}
    if case.blocks.crushes:  # a state for a part of the dead load crushes elsewhere
        return _unknown(found, short, _without_equilibrium(found))
    if not (short or lost) or not case.problem.coulomb:
        return dict(found)
    try:
        dead = dead_load_state(case, strategy, options.tolerance)
    except SolverError:
        reason = _without_equilibrium(found) if short else ""
        # Ends on both sides of zero, or one of them lost, do not leave it out.
        return _unknown(found, set(found) if short else lost, reason)
    ends = dict(found)
    for name in (short | lost).intersection(asked):
        # From afar nothing was found before.
        alone = replace(strategy.work, missing=OPTIONS.missing, cost=OPTIONS.cost)
        near = replace(strategy, attempts=(), work=alone) if name in lost else strategy
        ends[name] = _raised_from(dead, cases[name], near, margin)
    return ends


def _unknown(found: Mapping[str, Collapse], names: set[str], reason: str) -> dict[str, Collapse]:
    """The ends found, some of them not converged for a reason."""
    changed = {n: replace(found[n], status="not_converged", reason=reason) for n in names}
    return {**found, **changed}


def _raised_from(state: State, case: LoadCase, strategy: Strategy, margin: float) -> Collapse:
    """The collapse under a load that rises from a state under the dead load alone."""
    start = case.problem.state(state.displacement, 0.0, state.pressure, state.shear)
    options = case.discretization.scene.solve
    end = raise_load(case, strategy, options, find_collapse, start, OPTIONS.cost)
    if end.path is not None and (end.load_factor < margin or end.status == "not_converged"):
        reached = f"{case.sign * end.path.lower:.6g}, and no collapse there"
        reason = f"under a rising load equilibrium was found up to a load factor of {reached}"
        end = replace(end, status="not_converged", reason=reason)
    return end


def _without_equilibrium(found: Mapping[str, Collapse]) -> str:
    """That the dead load alone has no equilibrium, and load factors that have one."""
    factors = sorted(SIGNS[n] * end.load_factor for n, end in found.items() if end.state)
    text = "no equilibrium was found under the dead load alone"
    if len(factors) < 2 or not np.all(np.isfinite(factors)):
        return text
    return f"{text}, only with load factors from {factors[0]:.6g} to {factors[-1]:.6g}"
