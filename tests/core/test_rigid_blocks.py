"""Limit loads of rigid blocks under live loads of all directions and sizes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Load
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import running_bond
from tests.bank import GRAVITY, Recipe, block_recipe, coulomb

#: Two bricks long and three courses high.
BOND = Recipe(lambda n, quads: running_bond(2, 3, (0.4, 0.2), n), coulomb(0.6))


@contextmanager
def programs(recipe: Recipe) -> Iterator[RigidBlocks]:
    with Discretization(recipe.scene(1)) as made:
        yield RigidBlocks.of(made)


@pytest.mark.parametrize(
    ("friction", "live", "expected"),
    [
        (0.5, (0.0, -GRAVITY), np.inf),  # pressed on the ground
        (0.5, (0.0, GRAVITY), 1.0),  # lifted
        (0.2, (GRAVITY, -GRAVITY), 0.25),  # down and to the right
        (1.1, (0.3 * GRAVITY, -GRAVITY), np.inf),  # within the cone
        (0.2, (1e-6 * GRAVITY, 0.0), 2e5),  # a small part of the weight
    ],
)
def test_directions_of_the_live_load(friction, live, expected):
    with programs(block_recipe(0.4, 1.0, friction, live=Load(live))) as blocks:
        bounds = blocks.bounds()
        assert blocks.limit() == bounds.upper == pytest.approx(expected, rel=1e-9)
        assert blocks.stands() and blocks.frictionless.stands() and bounds.lower >= 0.0


def test_loads_a_billion_times_the_weight_have_an_answer():
    """Lifted: HiGHS goes round in circles where its iterations are not bounded."""
    with programs(replace(BOND, parts={"live": Load((GRAVITY, 1e9))})) as blocks:
        assert blocks.limit() == pytest.approx(GRAVITY / 1e9, rel=1e-6)
