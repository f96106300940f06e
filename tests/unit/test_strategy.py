"""Attempts at a state: each finds the same one, or says that it finds none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fenics_contact import SolverError
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.strategy import (
    COULOMB,
    GIVEN,
    JOINT_FORCES,
    Task,
    along_block_modes,
    along_falling_products,
    coulomb_equilibrium,
    fixed_point,
    fixed_point_equilibrium,
    further_along_rising_work,
    interior_point,
    large_products,
    next_to,
    rising_work,
    states_along_rising_work,
    strategy_of,
)
from fenics_contact.solvers.joint_stiffness import GENERAL, SYMMETRIC
from tests.bank import BANK, block_recipe, coulomb, tresca, wall_recipe
from tests.unit.core import FAR, conditions, load_case, misses, solved


@pytest.fixture(scope="module")
def wall() -> Iterator[LoadCase]:
    """A wall with one state."""
    with load_case(wall_recipe("W4", coulomb(0.4)).scene(1)) as made:
        yield made


BY_MODES = [partial(along_block_modes, approach=way) for way in (rising_work, large_products)]


def task_of(case: LoadCase, ratio: float = FAR, tolerance: float = 1e-6) -> Task:
    kkt = conditions(case, ratio)
    return Task(case, kkt.work, kkt.scales, tolerance)


@pytest.mark.parametrize(
    "attempt",
    [interior_point, *BY_MODES, along_falling_products, fixed_point],
    ids=["interior point", "rising work", "falling products", "without modes", "fixed point"],
)
def test_all_attempts_find_the_same_state(wall, attempt):
    count = wall.discretization.factorizations
    before = count()
    solution, history = attempt(task_of(wall))
    assert history.converged
    assert sum(step.factorizations for step in history.steps) == count() - before
    assert history.steps[-1].load_factor == solution.state.load_factor
    state = solution.state
    left = misses(wall, state, wall.problem.bound(state.pressure))
    assert max(left.values()) < 1e-5, left
    exact = solved(wall, state.work / wall.bonded_work).state.load_factor
    assert state.load_factor == pytest.approx(exact, rel=1e-6)


def test_rising_work_leads_past_folds_to_the_low_state():
    """Where the interior point method finds nothing."""
    item, attempt = BANK["W3 coulomb 0.65"], BY_MODES[0]
    with load_case(item.scene()) as case:
        with pytest.raises(SolverError):
            interior_point(task_of(case))
        factor = attempt(task_of(case))[0].state.load_factor
    assert item.error(factor) <= 1e-3


def test_states_further_along(wall):
    first = task_of(wall, 10.0)
    with pytest.raises(SolverError, match="no state at less work"):
        further_along_rising_work(first)
    last = interior_point(first)[0].state
    on = replace(task_of(wall, 40.0), last=last)
    state = further_along_rising_work(on)[0].state
    assert state.work == pytest.approx(on.work, rel=2e-3)
    exact = solved(wall, state.work / wall.bonded_work).state.load_factor
    assert state.load_factor == pytest.approx(exact, rel=1e-6)


def test_states_next_to_one(wall):
    task, state = task_of(wall), solved(wall, 0.9 * FAR).state
    other = solved(wall, 0.8 * FAR).state
    direction = (state.displacement - other.displacement) / (state.work - other.work)
    found = next_to(state, direction)(task)[0].state
    assert found.work == task.work
    assert found.load_factor == pytest.approx(solved(wall).state.load_factor, rel=1e-7)
    with pytest.raises(SolverError, match="no direction"):
        next_to(state, None)(task)


@pytest.mark.parametrize("equilibrium", [coulomb_equilibrium, fixed_point_equilibrium])
def test_equilibrium_at_a_load_factor(equilibrium):
    with load_case(block_recipe(0.4, 1.0, 0.7).scene(2)) as case:
        start, task = solved(case, 0.5).state, task_of(case, 0.5)
        state = equilibrium(task, start, 0.2)
        assert state.load_factor == 0.2
        left = misses(case, state, case.problem.bound(state.pressure))
        assert max(left.values()) < 1e-5, left
        with pytest.raises(SolverError):
            equilibrium(task, start, 0.6)


def test_states_at_rising_work_have_rising_load_factors(wall):
    works = [ratio * wall.bonded_work for ratio in (0.2, 1.0, 5.0, 30.0)]
    found = list(states_along_rising_work(task_of(wall, 30.0), works))
    assert [number for number, _ in found] == [1, 2, 3, 4]
    factors = [state.load_factor for _, state in found]
    assert np.all(np.diff(factors) > -1e-6)
    for work, (_, state) in zip(works, found, strict=True):
        assert state.work == pytest.approx(work, rel=1e-2)


@pytest.mark.parametrize("method", COULOMB)
def test_strategy_of_a_scene(method):
    recipe = block_recipe(0.4, 0.4, 0.5)
    assert strategy_of(recipe.scene(1, method=method)) is COULOMB[method]
    given = replace(recipe, law=tresca(1e3))
    by_forces = method in JOINT_FORCES
    assert strategy_of(given.scene(1, method=method)) is (COULOMB[method] if by_forces else GIVEN)
    assert len(COULOMB[method].attempts) >= 1
    symmetric = by_forces or method == "fixed-point"
    assert COULOMB[method].kind == (SYMMETRIC if symmetric else GENERAL)
