"""The record of a solve: attempts, the path, and why no limit load was found."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fenics_contact import SolverError, limit_load
from fenics_contact.collapse.load_case import LoadCase, Task
from fenics_contact.collapse.reasons import explained
from fenics_contact.collapse.strategy import (
    Strategy,
    along_falling_products,
    interior_point,
)
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.output.files import result_record, strict
from fenics_contact.scene.scene import SolveOptions
from fenics_contact.search_options import SEARCH
from tests.bank import coulomb, wall_recipe
from tests.core.problems import BOND, load_case


def finds_nothing(task: Task) -> None:
    task.case.discretization.tally.add()
    raise SolverError("made up")


def not_settled(task: Task):
    solution, history = interior_point(task)
    return solution, replace(history, converged=False)


def collapse_of(case: LoadCase, *attempts):
    work = replace(SEARCH, works=2)
    return explained(case, find_collapse(case, Strategy(attempts, options=work), 1e-6))


@pytest.fixture(scope="module")
def found():
    """Wall W1 with friction .65, on one element along half a block."""
    recipe = wall_recipe("W1", coulomb(0.65))
    options = SolveOptions(error=False, lowest=False, peak=False)
    return limit_load(replace(recipe.scene(1), solve=options))


def test_attempts_of_a_limit_load(found):
    attempts = found.collapse.attempts
    assert attempts[-1].found and attempts[-1].outcome == "a state, verified"
    assert sum(trial.factorizations for trial in attempts) == found.factorizations - 1  # bonded
    record = strict(result_record(found))
    assert record["attempts"][-1]["name"] == "along block modes"
    assert {"name", "work", "outcome", "factorizations"} <= set(record["attempts"][0])
    assert record["reason"] is None


def test_load_factors_of_the_path_have_the_users_sign():
    scene = replace(BOND.scene(1), solve=SolveOptions(direction="negative", error=False))
    end = limit_load(scene).collapse
    assert end.load_factor < 0.0
    assert min(point.load_factor for point in end.trace) < 0.5 * end.load_factor


def test_reason_where_nothing_is_found():
    with load_case(BOND.scene(1)) as case:
        end = collapse_of(case, finds_nothing)
    assert end.status == "not_converged"
    assert [trial.outcome for trial in end.attempts] == ["made up"] * 2
    assert end.reason.startswith("no state was found; finds nothing found no state (2 times")
    assert "try solve.method = 'fixed-point', solve.method = 'monolithic' or a f" in end.reason


def test_reason_where_nothing_is_verified():
    with load_case(BOND.scene(1)) as case:
        end = collapse_of(case, not_settled)
    assert end.status == "not_converged" and end.attempts[0].found
    assert "not settled" in end.attempts[0].outcome
    assert f"the best one, with load factor {end.load_factor:.6g}" in end.reason


def test_reason_where_the_limit_of_factorisations_ends_the_search():
    """It is named, with all attempts of the method; more time would not help."""
    work = replace(SEARCH, collapse_cost=6.0)
    attempts = interior_point, along_falling_products
    with load_case(wall_recipe("W3", coulomb(0.65)).scene(1)) as case:
        strategy = Strategy(attempts, options=work)
        end = explained(case, find_collapse(case, strategy, 1e-6))
    assert end.status == "not_converged" and "more time" not in end.reason
    assert end.reason.startswith("the search ended at its limit of 6 factorisations; no state was ")
    assert "the interior point method found no state" in end.reason
    assert "the path of falling products found no state" in end.reason
    assert len(end.attempts) == 2


@pytest.mark.parametrize("stopped", [True, False])
def test_more_time_is_advised_where_the_time_ended_this_direction(stopped):
    """Not where another direction was stopped after this one had come to its end."""
    with load_case(BOND.scene(1)) as case:
        found = find_collapse(case, Strategy((finds_nothing,)), 1e-6)
        watch = case.discretization.effort.watch
        watch.reason = "stopped after 1 s (solve.time)"
        end = explained(case, replace(found, reason=watch.reason) if stopped else found)
    assert end.reason.endswith("try more time") is stopped
    assert ("finds nothing found no state" in end.reason) is not stopped
