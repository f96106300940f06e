"""Loads that nothing limits, and live loads that relieve what slides."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Load, limit_load
from fenics_contact.discretization.discretization import Discretization
from tests.bank import GRAVITY, block_recipe

#: Presses a block on the ground within the cone of friction; pushes it over.
DOWN, ASIDE = Load((0.1 * GRAVITY, -GRAVITY)), Load((GRAVITY, 0.0))


@pytest.mark.parametrize(
    ("live", "status", "factor"), [(DOWN, "unbounded", np.inf), (ASIDE, "limit", 0.5)]
)
@pytest.mark.parametrize("engine", ["path", "faces"])
def test_both_engines_tell_what_limits_a_block(engine, live, status, factor):
    scene = block_recipe(0.4, 0.4, 0.5, live=live).scene(2)
    found = limit_load(replace(scene, solve=replace(scene.solve, engine=engine)))
    assert (found.status, found.load_factor) == (status, pytest.approx(factor, rel=1e-6))


@pytest.mark.slow
@pytest.mark.parametrize("lean", [0.05, 0.2])
def test_live_load_that_relieves_a_sliding_joint_does_negative_work(lean):
    """The block slides down its slope of 20 degrees as the live load g (-lean, 1) lifts it.

    With friction 0.5: 0.5 (cos 20 - lambda) = sin 20 - lean lambda.
    """
    sine, cosine = math.sin(math.radians(20.0)), math.cos(math.radians(20.0))
    dead, live = Load((GRAVITY * sine, -GRAVITY * cosine)), Load((-GRAVITY * lean, GRAVITY))
    recipe = block_recipe(4.0, 0.5, 0.5, dead=dead, live=live)
    result = limit_load(recipe.scene(2))
    assert result.status == "limit"
    exact = (0.5 * cosine - sine) / (0.5 - lean)
    gap = result.collapse.as_state.gap
    assert gap <= 1e-6 and result.load_factor == pytest.approx(exact, rel=max(gap, 1e-8))
    with Discretization(result.scene) as made:
        work = result.collapse.mode @ made.problem.live
    assert work == pytest.approx(-1.0, rel=1e-9)
