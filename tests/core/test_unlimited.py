"""Loads that nothing limits: what the forces of joint faces say of the live load alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Load, SolverError, limit_load
from fenics_contact.collapse.load_case import Task
from fenics_contact.collapse.work_control import growth
from tests.bank import GRAVITY, block_recipe, coulomb, tresca
from tests.core.problems import load_case

TOLERANCE = 1e-6

#: Presses a block on the ground within the cone of friction; pushes it over.
DOWN, ASIDE = Load((0.1 * GRAVITY, -GRAVITY)), Load((GRAVITY, 0.0))


def no_state(task: Task):
    raise SolverError("none")


@pytest.mark.mpi
def test_a_block_pressed_within_its_cone_is_as_stiff_as_closed_faces():
    """Load and weight meet the ground .02 m from its middle: both ends press, nothing slips."""
    with load_case(block_recipe(0.4, 0.4, 0.5, live=DOWN).scene(2)) as case:
        assert growth(case) == pytest.approx(case.scales.load_factor, rel=1e-6)


@pytest.mark.parametrize(
    ("live", "law"), [(ASIDE, coulomb(0.5)), (DOWN, tresca(1e3)), (Load((0.0, GRAVITY)), None)]
)
def test_no_growth_where_the_live_load_alone_moves_the_block(live, law):
    """Given strengths do not help against a load of any size."""
    recipe = block_recipe(0.4, 0.4, 0.5, live=live)
    recipe = recipe if law is None else replace(recipe, law=law)
    with load_case(recipe.scene(2)) as case:
        assert growth(case) is None


@pytest.mark.parametrize(
    ("live", "status", "factor"), [(DOWN, "unbounded", np.inf), (ASIDE, "limit", 0.5)]
)
@pytest.mark.parametrize("engine", ["path", "faces"])
def test_both_engines_tell_what_limits_a_block(engine, live, status, factor):
    scene = block_recipe(0.4, 0.4, 0.5, live=live).scene(2)
    found = limit_load(replace(scene, solve=replace(scene.solve, engine=engine)))
    assert (found.status, found.load_factor) == (status, pytest.approx(factor, rel=1e-6))
