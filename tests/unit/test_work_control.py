"""The collapse at growing work: the loop of attempts, what is verified, and where it begins."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Load, SolverError
from fenics_contact.analysis.certificate import state_residuals
from fenics_contact.analysis.history import History
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.result import Collapse
from fenics_contact.analysis.strategy import (
    COULOMB,
    GIVEN,
    Attempt,
    Strategy,
    Task,
    WorkOptions,
    interior_point,
)
from fenics_contact.analysis.work_control import find_collapse, find_lowest
from fenics_contact.meshing import running_bond
from fenics_contact.solvers.interior_point import Solution
from fenics_contact.solvers.joint_stiffness import GENERAL, SYMMETRIC
from tests.bank import BANK, Recipe, block_recipe, coulomb, tresca, wall_recipe
from tests.unit.core import load_case

Answer = tuple[Solution, History]

TOLERANCE = 1e-6


@pytest.fixture(scope="module")
def block() -> Iterator[LoadCase]:
    with load_case(block_recipe(0.4, 0.4, 0.3).scene(2)) as made:
        yield made


def finds_nothing(task: Task) -> Answer:
    raise SolverError("made up")


def with_load_factor(times: float) -> Attempt:
    """An attempt whose load factor is not what it should be."""

    def attempt(task: Task) -> Answer:
        solution, history = interior_point(task)
        state = replace(solution.state, load_factor=times * solution.state.load_factor)
        return replace(solution, state=state), history

    return attempt


def collapse(case: LoadCase, *attempts: Attempt, **options: float) -> Collapse:
    strategy = Strategy(attempts, GENERAL, work=WorkOptions(**options))
    return find_collapse(case, strategy, TOLERANCE)


# ---- the loop of attempts


def test_next_attempt_is_made_where_one_finds_nothing(block):
    tried: list[Task] = []

    def noted(task: Task) -> Answer:
        tried.append(task)
        return interior_point(task)

    found = collapse(block, finds_nothing, noted, finds_nothing)
    assert found.status == "limit"
    assert found.load_factor == pytest.approx(0.3, rel=1e-7)
    assert len(tried) == len(found.history)
    assert tried[0].work == pytest.approx(300.0 * block.bonded_work)
    assert tried[0].last is None and tried[0].tolerance == TOLERANCE
    assert found.work_ratio == 300.0
    assert found.certificate.passed


def test_work_grows_where_no_attempt_finds_a_state(block):
    works: list[float] = []

    def second(task: Task) -> Answer:
        works.append(task.work / block.bonded_work)
        return interior_point(task) if len(works) > 1 else finds_nothing(task)

    found = collapse(block, second, first=100.0, growth=5.0)
    assert works == pytest.approx([100.0, 500.0])
    assert (found.status, found.work_ratio) == ("limit", 500.0)


def test_nothing_found_is_no_limit_load(block):
    found = collapse(block, finds_nothing)
    assert found.status == "not_converged"
    assert np.isnan(found.load_factor)
    assert found.state is found.certificate is found.joints is None
    assert found.history == ()
    assert found.bounds.upper == pytest.approx(0.3)


@pytest.mark.parametrize("times", [0.5, 0.999, 1.001, 2.0])
def test_wrong_load_factors_are_never_limit_loads(block, times):
    found = collapse(block, with_load_factor(times))
    assert found.status == "not_converged"
    assert not found.certificate.passed
    assert "equilibrium" in found.certificate.failures


def test_states_on_the_way_are_no_limit_loads(block):
    """At so little work that the load factor still rises."""
    found = collapse(block, interior_point, first=0.01, largest=5.0)
    assert found.status == "not_converged"
    assert 0.0 < found.load_factor < 0.29
    assert "limit" in found.certificate.failures


def test_best_of_several_states_is_reported(block):
    """A worse one at more work does not replace it."""
    count: list[int] = []

    def attempt(task: Task) -> Answer:
        count.append(1)
        return (interior_point if len(count) == 1 else with_load_factor(1.1))(task)

    found = collapse(block, attempt, gap=0.0)
    assert len(count) == 2
    assert (found.status, found.work_ratio) == ("limit", 300.0)
    assert found.load_factor == pytest.approx(0.3, rel=1e-7)


def test_states_further_along_are_tried_before_those_from_afar(block):
    """And they alone once a state is verified."""
    order: list[str] = []

    def further(task: Task) -> Answer:
        order.append("further")
        assert task.last.load_factor == pytest.approx(0.3, rel=1e-3)
        raise SolverError("made up")

    def afar(task: Task) -> Answer:
        order.append("afar")
        return interior_point(task)

    strategy = Strategy((afar,), GENERAL, further)
    found = find_collapse(block, replace(strategy, work=WorkOptions(gap=0.0)), TOLERANCE)
    assert order == ["afar", "further"]
    assert found.status == "limit"


# ---- scenes


@pytest.mark.parametrize("method", COULOMB)
@pytest.mark.parametrize("name", ["block 0.39", "block 0.7", "stack of 5 0.7"])
def test_closed_forms_by_all_methods(name, method):
    with load_case(BANK[name].scene(), COULOMB[method].kind) as case:
        found = find_collapse(case, COULOMB[method], TOLERANCE)
    assert BANK[name].right(found.status, found.load_factor)


@pytest.mark.parametrize("name", ["W1 tresca 2 kPa", "W4 tresca 8 kPa"])
def test_walls_with_given_friction(name):
    with load_case(BANK[name].scene(), SYMMETRIC) as case:
        found = find_collapse(case, GIVEN, TOLERANCE)
        assert found.load_factor == pytest.approx(case.blocks.limit(), rel=TOLERANCE)
    assert BANK[name].right(found.status, found.load_factor)


@pytest.mark.parametrize("law", [coulomb(0.5), tresca(1e3)])
def test_nothing_limits_a_load_that_presses_on_the_ground(law):
    recipe = replace(block_recipe(0.4, 0.4, 0.5, live=Load((0.1, -9.81))), law=law)
    strategy = COULOMB["auto"] if law.friction else GIVEN
    with load_case(recipe.scene(2), strategy.kind) as case:
        found = find_collapse(case, strategy, TOLERANCE)
        limit = case.blocks.limit()
    if limit == np.inf:
        assert (found.status, found.load_factor) == ("unbounded", np.inf)
    else:
        assert found.load_factor == pytest.approx(limit, rel=1e-6)


@pytest.mark.parametrize("name", ["W1", "block"])
def test_state_is_that_where_the_collapse_begins(name):
    """Every joint that moves in the mode has moved so; one of them has not yet."""
    recipe = wall_recipe("W1", coulomb(0.65)) if name == "W1" else block_recipe(0.4, 1.0, 0.7)
    with load_case(recipe.scene(1)) as case:
        found, problem = find_collapse(case, COULOMB["auto"], TOLERANCE), case.problem
        state, mode = found.state, found.mode
        assert found.status == "limit"
        work = problem.dot(problem.live, state.displacement)
        assert work == pytest.approx(state.work, rel=1e-9)
        assert state.work < found.work_ratio * case.bonded_work
        assert max(state_residuals(problem, state, case.scales_at(state.work)).values()) < 1e-4
        rates, moved = problem.normal @ mode, problem.normal @ state.displacement
        opens = rates > 1e-3 * problem.max(np.abs(rates))
        slip_rates, slipped = problem.tangential @ mode, problem.tangential @ state.displacement
        slips = (np.abs(slip_rates) > 1e-3 * problem.max(np.abs(mode))) & (state.pressure > 0.0)
        at = [*(moved / rates)[opens], *(slipped / slip_rates)[slips]]
        assert min(at) == pytest.approx(0.0, abs=1e-9 * found.work_ratio * case.bonded_work)
        assert np.array_equal(found.joints.gap, case.discretization.all_points(moved))


# ---- the lowest of several states


def test_states_from_all_starts_are_told():
    with load_case(block_recipe(0.4, 1.0, 0.3).scene(1)) as case:
        lowest = find_lowest(case, TOLERANCE)
    assert [state.start for state in lowest.states] == [
        *("auto", "dead load", "half of that", "no friction", "associative program", "monolithic")
    ]
    for state in lowest.states:
        assert (state.status, state.load_factor) == ("limit", pytest.approx(0.3, rel=1e-6))
    assert lowest.certificate.passed


@pytest.mark.slow
def test_lowest_of_several_states():
    """The courses roll off at 5/7; the state of the associative program slides, at 1."""
    recipe = Recipe(lambda n, quads: running_bond(2, 3, (0.4, 0.2), n), coulomb(1.0))
    with load_case(recipe.scene(1)) as case:
        lowest = find_lowest(case, TOLERANCE)
        first = find_collapse(case, COULOMB["auto"], TOLERANCE)
    found = {state.start: state.load_factor for state in lowest.states}
    assert lowest.status == "limit"
    assert lowest.load_factor == pytest.approx(5.0 / 7.0, rel=1e-6)
    assert found["auto"] == pytest.approx(first.load_factor, rel=TOLERANCE)
    assert found["associative program"] == pytest.approx(1.0, rel=1e-6)
    assert found["monolithic"] == pytest.approx(1.0, rel=1e-6)
