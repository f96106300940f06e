"""Structures as people draw them: they are whole, and loads at places follow a scene's units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import EdgeForce, JointLaw, limit_load
from tests.bank import WEIGHT, Variant, block_recipe, known
from tests.structures import arch_wall, facade, gable, rubble


def area(corners: np.ndarray) -> float:
    x, y = corners.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def test_rubble_fills_its_wall():
    stones = rubble().blocks
    assert len(stones) == 300
    assert sum(map(area, stones)) == pytest.approx(8.0 * 3.75, rel=1e-12)
    assert min(map(area, stones)) > 0.2 * 0.1
    assert rubble().lengths()["base"] == pytest.approx(8.0)


def test_the_facade_is_as_drawn():
    assert len(facade().blocks) == 383
    assert sum(map(area, facade().blocks)) == pytest.approx(49.9175, rel=1e-5)
    assert facade().lengths()["base"] == pytest.approx(7.4)


def test_gable_and_arch_wall_are_symmetric():
    for row in gable():
        assert row == row[::-1]
        assert sum(map(abs, row)) == 8.0
    middles = np.array([block.mean(axis=0) for block in arch_wall().blocks])
    assert np.sort(middles[:, 0]) + np.sort(middles[:, 0])[::-1] == pytest.approx(3.0)


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


def test_the_bank_has_real_structures():
    assert len(known("real")) == 14
    assert len(known("real", without=("slow",))) == 6
