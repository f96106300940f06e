"""Loads at places follow the units of a scene."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fenics_contact import EdgeForce, JointLaw, limit_load
from tests.bank import WEIGHT, Variant, block_recipe


@pytest.mark.parametrize(
    "variant", [Variant(), Variant(length=1e-3, force=1e3), Variant(mirrored=True, angle=20.0)]
)
def test_a_force_at_a_place_and_cohesion_follow_the_units(variant):
    """Sliding: (F W + F P + c b) / W, P pressing on the top of a block of 1 m x 0.2 m."""
    weight = 1.0 * 0.2 * 1.0e4
    pressed = replace(WEIGHT, force={"top": EdgeForce((0.0, -800.0), 0.5, 0.2, 0.2)})
    law = JointLaw("coulomb", friction=0.3, cohesion=500.0)
    recipe = replace(block_recipe(1.0, 0.2, 0.3, dead=pressed), law=law)
    result = limit_load(recipe.scene(variant=variant))
    expected = (0.3 * (weight + 800.0) + 500.0) / weight
    assert (result.status, result.load_factor) == ("limit", pytest.approx(expected, rel=1e-6))
