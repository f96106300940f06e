"""Attempts at a state: each finds the same one, or says that it finds none."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest

from fenics_contact import SolverError, limit_load
from fenics_contact.collapse import strategy as attempts
from fenics_contact.collapse.load_case import LoadCase, Task
from fenics_contact.collapse.strategy import (
    COULOMB,
    GIVEN,
    JOINT_FORCES,
    strategy_of,
)
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.joint_stiffness import GENERAL, SYMMETRIC
from tests.bank import BANK, block_recipe, coulomb, tresca, wall_recipe
from tests.core.problems import FAR, conditions, load_case, misses, prepared, solved

#: A wall with one state.
wall = prepared(wall_recipe("W4", coulomb(0.4)))


def task_of(case: LoadCase, ratio: float = FAR) -> Task:
    kkt = conditions(case, ratio)
    return Task(case, kkt.work, kkt.scales, 1e-6)


@pytest.mark.parametrize(
    "attempt",
    [
        attempts.interior_point,
        attempts.along_block_modes,
        attempts.along_falling_products,
        attempts.fixed_point,
    ],
)
def test_all_attempts_find_the_same_state(wall, attempt):
    count = wall.discretization.factorizations
    before = count()
    solution, history = attempt(task_of(wall))
    assert history.converged
    assert sum(step.factorizations for step in history.steps) == count() - before
    state = solution.state
    assert history.steps[-1].load_factor == state.load_factor
    left = misses(wall, state)
    assert max(left.values()) < 1e-5, left
    exact = solved(wall, state.work / wall.bonded_work).state.load_factor
    assert state.load_factor == pytest.approx(exact, rel=1e-6)


def test_rising_work_leads_past_folds_to_the_low_state():
    """Where the interior point method finds nothing."""
    item = BANK["W3 coulomb 0.65"]
    with load_case(item.scene()) as case:
        with pytest.raises(SolverError):
            attempts.interior_point(task_of(case))
        assert item.error(attempts.along_block_modes(task_of(case))[0].state.load_factor) <= 1e-3


def test_a_path_without_an_end_answers_to_the_tolerance(wall, monkeypatch):
    """The last point found is the state, if what is left changes the load factor little enough."""
    never = replace(SEARCH, interior_steps=0)
    monkeypatch.setattr(attempts, "finishing", lambda: never)
    task = task_of(wall)
    start = wall.bonded_state(task.work)
    near = attempts.to_end(replace(task, tolerance=1e-3), start, 1.0)
    exact = solved(wall, task.work / wall.bonded_work).state.load_factor
    assert 0.0 < near.change <= 1e-3
    assert abs(near.state.load_factor - exact) <= near.change * abs(exact)
    assert max(misses(wall, near.state).values()) < 1e-5
    with pytest.raises(SolverError):
        attempts.to_end(replace(task, tolerance=1e-12), start, 1.0)


@pytest.mark.parametrize(
    "equilibrium", [attempts.coulomb_equilibrium, attempts.fixed_point_equilibrium]
)
def test_equilibrium_at_a_load_factor(equilibrium):
    with load_case(block_recipe(0.4, 1.0, 0.7).scene(2)) as case:
        start, task = solved(case, 0.5).state, task_of(case, 0.5)
        state = equilibrium(task, start, 0.2)
        assert state.load_factor == 0.2
        assert max(misses(case, state).values()) < 1e-5
        with pytest.raises(SolverError):
            equilibrium(task, start, 0.6)


@pytest.mark.parametrize("method", COULOMB)
def test_strategy_of_a_scene(method):
    recipe = block_recipe(0.4, 0.4, 0.5)
    assert strategy_of(recipe.scene(1, method=method)) is COULOMB[method]
    given = strategy_of(replace(recipe, law=tresca(1e3)).scene(1, method=method))
    assert given is JOINT_FORCES.get(method, GIVEN)
    assert COULOMB[method].kind == (GENERAL if method in ("auto", "monolithic") else SYMMETRIC)


def test_looser_tolerances_ask_for_less_work_of_large_walls():
    begin = partial(attempts.first_work, SEARCH)
    assert begin(400, 1e-6) == begin(400, 1e-9) == 0.2 * 400**2
    assert begin(400, 1e-4) == pytest.approx(0.1 * begin(400, 1e-6))
    assert begin(10, 1e-6) == begin(10, 1e-2) == SEARCH.first_work


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.4, 0.75])
def test_a_loose_tolerance_is_kept_and_saves_factorisations(friction):
    recipe = wall_recipe("20x20", coulomb(friction))
    exact, loose = (limit_load(recipe.scene(2, tolerance=one)) for one in (1e-6, 1e-3))
    assert exact.status == loose.status == "limit"
    assert loose.load_factor == pytest.approx(exact.load_factor, rel=1e-3)
    assert loose.positive.certificate.gap <= 1e-3
    assert loose.factorizations < exact.factorizations
