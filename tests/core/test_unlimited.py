"""Loads that nothing limits: what the forces of joint faces say of the live load alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Load, limit_load
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
