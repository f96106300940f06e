"""Equilibrium under the live load alone, and what it says of loads that nothing limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Load, SolverError
from fenics_contact.collapse.live_load import slope_without_dead_load
from fenics_contact.collapse.load_case import Task
from fenics_contact.collapse.strategy import (
    COULOMB,
    along_falling_products,
    interior_point,
)
from fenics_contact.collapse.work_control import find_collapse
from tests.bank import GRAVITY, block_recipe, coulomb, tresca
from tests.core.problems import load_case

TOLERANCE = 1e-6

#: Presses a block on the ground within the cone of friction; pushes it over.
DOWN, ASIDE = Load((0.1 * GRAVITY, -GRAVITY)), Load((GRAVITY, 0.0))


#: What looks for states under the live load alone.
ALONE = interior_point, along_falling_products


def no_state(task: Task):
    raise SolverError("none")


def test_load_factors_approach_the_line_of_the_live_load():
    with load_case(block_recipe(0.4, 0.4, 0.5, live=DOWN).scene(2)) as case:
        slope = slope_without_dead_load(case, TOLERANCE, ALONE)
        works = np.array([3.0, 100.0]) * case.bonded_work
        tasks = [Task(case, work, case.scales_at(work), TOLERANCE) for work in works]
        factors = [interior_point(task)[0].state.load_factor for task in tasks]
    missed = np.abs(factors / (slope * works) - 1.0)
    assert missed[1] < 0.1 * missed[0] < 0.1


@pytest.mark.parametrize(
    ("live", "law"), [(ASIDE, coulomb(0.5)), (DOWN, tresca(1e3)), (Load((0.0, GRAVITY)), None)]
)
def test_no_line_where_the_live_load_alone_moves_the_block(live, law):
    """Given strengths do not help against a load of any size."""
    recipe = block_recipe(0.4, 0.4, 0.5, live=live)
    recipe = recipe if law is None else replace(recipe, law=law)
    with load_case(recipe.scene(2)) as case:
        assert slope_without_dead_load(case, TOLERANCE, ALONE) is None


def test_record_tells_of_the_live_load_alone():
    strategy = replace(COULOMB["auto"], attempts=(no_state,))
    with load_case(block_recipe(0.4, 0.4, 0.5, live=DOWN).scene(2)) as case:
        find_collapse(case, strategy, TOLERANCE)
    names = [trial.name for trial in case.record.attempts]
    assert names[-1].startswith("live load alone") and case.record.attempts[-1].found
