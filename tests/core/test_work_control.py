"""The collapse at growing work: the loop of attempts, what is verified, and where it begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Load, SolverError
from fenics_contact.collapse.load_case import Attempt, LoadCase, Task
from fenics_contact.collapse.strategy import (
    COULOMB,
    Strategy,
    interior_point,
)
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.results.certificate import state_residuals
from fenics_contact.results.history import History
from fenics_contact.results.result import Collapse
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.interior_point import Solution
from fenics_contact.solvers.joint_stiffness import GENERAL
from tests.bank import GRAVITY, block_recipe, coulomb, wall_recipe
from tests.core.problems import load_case, prepared

Answer = tuple[Solution, History]

TOLERANCE = 1e-6

#: Presses a block on the ground within the cone of friction; pushes it over.
DOWN, ASIDE = Load((0.1 * GRAVITY, -GRAVITY)), Load((GRAVITY, 0.0))

block = prepared(block_recipe(0.4, 0.4, 0.3), 2)


def finds_nothing(task: Task) -> Answer:
    raise SolverError("made up")


def with_load_factor(times: float, converged: bool = True) -> Attempt:
    """An attempt whose answer is not what it should be."""

    def attempt(task: Task) -> Answer:
        solution, history = interior_point(task)
        state = replace(solution.state, load_factor=times * solution.state.load_factor)
        return replace(solution, state=state), replace(history, converged=converged)

    return attempt


def collapse(case: LoadCase, *attempts: Attempt, **options: float) -> Collapse:
    strategy = Strategy(attempts, GENERAL, options=replace(SEARCH, **options))
    return find_collapse(case, strategy, TOLERANCE)


def test_nothing_found_is_no_limit_load(block):
    found = collapse(block, finds_nothing)
    assert found.status == "not_converged" and np.isnan(found.load_factor)
    assert found.state is found.certificate is found.joints is None and found.history == ()
    assert found.bounds.upper == pytest.approx(0.3)


@pytest.mark.parametrize("times", [0.5, 0.999, 1.001, 2.0])
def test_wrong_load_factors_are_never_limit_loads(block, times):
    found = collapse(block, with_load_factor(times))
    assert found.status == "not_converged"
    assert "equilibrium" in found.certificate.failures


# ---- scenes


@pytest.mark.parametrize("name", ["W1", "block"])
def test_state_is_that_where_the_collapse_begins(name):
    """Every joint that moves in the mode has moved so; one of them has not yet."""
    recipe = wall_recipe("W1", coulomb(0.65)) if name == "W1" else block_recipe(0.4, 1.0, 0.7)
    with load_case(recipe.scene(1)) as case:
        found, problem = find_collapse(case, COULOMB["auto"], TOLERANCE), case.problem
        state, mode = found.state, found.mode
        work = problem.dot(problem.live, state.displacement)
        assert found.status == "limit" and work == pytest.approx(state.work, rel=1e-9)
        assert max(state_residuals(problem, state, case.scales_at(work)).values()) < 1e-4
        far = found.work_ratio * case.bonded_work
        rates, moved = ((problem.normal @ u) for u in (mode, state.displacement))
        slip_rates, slipped = ((problem.tangential @ u) for u in (mode, state.displacement))
        assert np.array_equal(found.joints.gap, case.discretization.all_points(moved))
    opens = rates > 1e-3 * np.abs(rates).max()
    slips = (np.abs(slip_rates) > 1e-3 * np.abs(mode).max()) & (state.pressure > 0.0)
    since = [*(moved / rates)[opens], *(slipped / slip_rates)[slips]]
    assert min(since) == pytest.approx(0.0, abs=1e-9 * far) and state.work < far


def test_unbounded_is_said_at_once_where_no_state_is_found():
    strategy = replace(COULOMB["auto"], attempts=(finds_nothing,))
    with load_case(block_recipe(0.4, 0.4, 0.5, live=DOWN).scene(2)) as case:
        assert case.blocks.frictionless.limit() < np.inf  # no proof without friction
        found = find_collapse(case, strategy, TOLERANCE)
        assert case.discretization.effort.spent <= 40.0
    assert (found.status, found.load_factor) == ("unbounded", np.inf)
    assert found.wedging is not None


@pytest.mark.parametrize("live", [ASIDE, Load((0.6 * GRAVITY, -GRAVITY))])
def test_a_limited_load_is_never_unbounded(live):
    strategy = replace(COULOMB["auto"], attempts=(finds_nothing,))
    with load_case(block_recipe(0.4, 0.4, 0.5, live=live).scene(2)) as case:
        assert find_collapse(case, strategy, TOLERANCE).status == "not_converged"


@pytest.mark.parametrize("limits", [{"attempt_cost": 3.0}, {"collapse_cost": 4.0}])
def test_search_ends_at_its_limit_of_cost(limits):
    strategy = replace(COULOMB["auto"], options=replace(SEARCH, **limits))
    with load_case(wall_recipe("W4", coulomb(0.4)).scene(1)) as case:
        effort = case.discretization.effort
        before = effort.spent
        found = find_collapse(case, strategy, TOLERANCE)
        spent = effort.spent - before
    assert found.status == "not_converged"
    tried = SEARCH.missing_works
    assert spent <= (limits.get("collapse_cost") or tried * limits["attempt_cost"]) + 1e-6
