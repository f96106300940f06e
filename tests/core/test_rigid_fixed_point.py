"""The fixed point of rigid blocks: a state far from the path, and what does not settle."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import limit_load
from fenics_contact.collapse.rigid_blocks import fixed_point as rigid_fixed_point
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import SolverError
from tests.bank import BANK, block_recipe
from tests.property.scenes import Draw


def test_a_block_that_slides_needs_one_value_of_its_normal_force():
    """lambda = friction: the normal force of the base is the weight, where it began with less."""
    with Discretization(block_recipe(0.4, 1.0, 0.3).scene(2)) as made:
        blocks = RigidBlocks.of(made)
        for first in (np.zeros(len(made.joints.length)), 1e3 * made.joints.length):
            state = blocks.rigid_state(first)
            assert state.load_factor == pytest.approx(0.3, rel=2e-3)
            assert blocks.of_faces(state.pressure) == pytest.approx(
                abs(made.bodies.dead[0, 1]), rel=1e-6
            )


def test_what_does_not_settle_is_no_state(monkeypatch):
    with Discretization(BANK["W1 coulomb 0.65"].scene()) as made:
        blocks = RigidBlocks.of(made)
        options = rigid_fixed_point.RigidFixedPointOptions(programs=2, pivots=1_000_000)
        monkeypatch.setattr(rigid_fixed_point, "OPTIONS", options)
        with pytest.raises(SolverError, match="not settled by 2 programs"):
            blocks.rigid_state(made.joints.length)


def test_a_structure_too_large_for_it_is_refused_at_once():
    with Discretization(BANK["W1 coulomb 0.65"].scene()) as made:
        with pytest.raises(SolverError, match="too dear with 99 equations"):
            RigidBlocks.of(made).rigid_state(made.joints.length)


def test_it_ends_where_the_load_factor_stays_above_what_is_asked_for():
    """The load factor rises from 0.15 towards 0.3: it stays above 0.1, but not above 0.2."""
    with Discretization(block_recipe(0.4, 1.0, 0.3).scene(2)) as made:
        blocks = RigidBlocks.of(made)
        points = len(made.joints.length)
        weight = abs(made.bodies.dead[0, 1])
        first = np.full(points, 0.5 * weight / points)
        ends = [blocks.rigid_state(first, low).load_factor for low in (0.1, 0.2)]
    assert ends == pytest.approx([0.225, 0.3], rel=2e-3)


def test_a_state_that_only_rigid_blocks_lead_to():
    """Two collapse states .393 and .289: the second is a fixed point for itself."""
    draw = Draw.of_seed(136)
    end = limit_load(draw.recipe().scene(draw.elements, fast=False, error=False)).positive
    assert end.load_factor == pytest.approx(0.393109, rel=1e-5)
    assert end.lowest.status == "lower"
    assert end.lowest.load_factor == pytest.approx(0.288941, rel=1e-5)
    assert [state.start for state in end.states] == ["path", "fixed point of rigid blocks"]
    assert all(state.status == "limit" for state in end.states)
