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
from fenics_contact.collapse.load_control import raise_load
from fenics_contact.collapse.strategy import Strategy, strategy_of
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.errors import SolverError
from fenics_contact.results.result import Collapse
from fenics_contact.solvers.problem import Scales, State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class DeadLoadOptions:
    """Numbers of the search.

    Attributes:
        least: Least lambda, with the work on the bonded structure: blocks that would have to move
            by its reciprocal, in units of the bonded displacement, are a mechanism.
        missing: Works in a row at which no state is found next to the last one under a rising load:
            those at more work are further away.
        cost: Of a rising load at most, and of the collapse next to its end, in units of one
            factorisation of the structure.
    """

    least: float = 1e-4
    missing: int = 1
    cost: float = 250.0


OPTIONS = DeadLoadOptions()


@dataclass(frozen=True)
class DeadLoadState:
    """What was found under the dead load alone.

    Attributes:
        state: A state of equilibrium; None if none was found. With strengths in the joints it is
            looked for next to the bonded response alone.
        falls: Whether the dead load was found to move the blocks as a mechanism.
    """

    state: State | None
    falls: bool


def dead_load_state(case: LoadCase, strategy: Strategy, tolerance: float) -> DeadLoadState:
    """Equilibrium under the dead load alone, searched for.

    Args:
        case: The load case.
        strategy: How states are found.
        tolerance: On the load factor, relative.
    """
    problem = case.problem
    bonded = case.bonded
    work = problem.dot(problem.dead, bonded.dead)
    origin = problem.max(np.abs(problem.law.origins))
    if work <= 0.0 or origin > 0.0 or problem.max(problem.law.strength) > 0.0:
        none = np.zeros_like(case.first_pressure)
        start = problem.state(bonded.dead, 0.0, case.first_pressure, none)
        task = Task(case, start.work, case.scales, tolerance)
        try:
            return DeadLoadState(strategy.equilibrium(task, start, 0.0), falls=False)
        except SolverError as error:
            _log.info("  dead load alone: %s", error)
            return DeadLoadState(None, falls=False)
    task = _under_the_dead_load(case, work, tolerance)
    falls = False
    for attempt in strategy.attempts:
        try:
            with case.discretization.effort.at_most(strategy.work.attempt):
                state = attempt(task)[0].state
        except SolverError as error:
            _log.info("  dead load alone: %s", error)
            continue
        part = state.load_factor
        _log.info("  dead load alone: %.3g of it does the work on the bonded structure", part)
        if part > OPTIONS.least:
            u = state.displacement / part
            found = problem.state(u, 0.0, state.pressure / part, state.shear / part)
            return DeadLoadState(found, falls=False)
        falls = True
    return DeadLoadState(None, falls)


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
    if case.blocks.crushing is not None:  # a state for a part of the dead load crushes elsewhere
        return _unknown(found, short, "not_converged", _without_equilibrium(found))
    if not (short or lost) or not case.problem.coulomb:
        return dict(found)
    dead = dead_load_state(case, strategy, options.tolerance)
    if dead.state is None:
        status = "no_equilibrium" if dead.falls else "not_converged"
        reason = _without_equilibrium(found) if short or dead.falls else ""
        # Ends on both sides of zero, or one of them lost, do not leave it out.
        return _unknown(found, set(found) if short else lost, status, reason)
    ends = dict(found)
    for name in (short | lost).intersection(asked):
        # From afar nothing was found before.
        alone = replace(strategy.work, missing=OPTIONS.missing, cost=OPTIONS.cost)
        near = replace(strategy, attempts=(), once=(), work=alone) if name in lost else strategy
        ends[name] = _raised_from(dead.state, cases[name], near, margin)
    return ends


def _unknown(
    found: Mapping[str, Collapse], names: set[str], status: str, reason: str
) -> dict[str, Collapse]:
    """The ends found, some of them with another status and its reason."""
    changed = {n: replace(found[n], status=status, reason=reason) for n in names}
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
