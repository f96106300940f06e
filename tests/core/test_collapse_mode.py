"""The motion that follows a state, and how a state is verified."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.collapse.collapse_mode import elastic_mode, verify
from tests.bank import block_recipe
from tests.core.problems import BOND, conditions, prepared, solved

block, bond = prepared(block_recipe(0.4, 0.4, 0.5), 2), prepared(BOND)


def test_mode_at_the_limit_load_is_admissible_and_dissipates_what_the_loads_do(bond):
    bound, problem = 0.5 * bond.first_pressure, bond.problem
    state = solved(bond, given=bound).state
    mode = elastic_mode(conditions(bond, given=bound), state)
    assert problem.dot(problem.live, mode) == pytest.approx(1.0, rel=1e-10)
    assert problem.max(-(problem.normal @ mode)) < 1e-6 * problem.max(np.abs(mode))
    dissipation = problem.sum(bound * np.abs(problem.tangential @ mode))
    power = state.load_factor + problem.dot(problem.dead, mode)
    assert dissipation == pytest.approx(power, rel=1e-6)


def test_mode_at_the_limit_load_is_the_rigid_one(block):
    bound = 0.3 * block.first_pressure
    mode = elastic_mode(conditions(block, given=bound), solved(block, given=bound).state)
    _, motion = block.blocks.collapse(block.discretization.all_points(bound))
    rigid = block.discretization.rigid_motion(motion)
    assert mode == pytest.approx(rigid, abs=1e-6 * np.abs(rigid).max())


def test_mode_on_the_elastic_branch_is_the_slope_of_the_path(block):
    bound = np.full(block.problem.points, 1e2 * block.scales.force)
    one, other = (solved(block, ratio, bound).state for ratio in (0.02, 0.03))
    mode = elastic_mode(conditions(block, 0.02, bound), one)
    slope = (other.displacement - one.displacement) / (other.work - one.work)
    # The springs of closed joints are large, not rigid.
    assert mode == pytest.approx(slope, abs=5e-3 * np.abs(slope).max())


@pytest.mark.parametrize("gap", [0.0, 1e-6])
def test_static_factor_is_that_of_the_state_or_of_the_program(block, gap):
    """Where the mode confirms the load factor no program is solved."""
    state, scales = solved(block).state, conditions(block).scales
    certificate = verify(block, state, scales, 1e-6, gap).certificate
    assert certificate.passed
    assert (certificate.static_factor == state.load_factor) == (gap > 0.0)
    bound = block.discretization.all_points(block.problem.law.bound(state.pressure))
    program = block.blocks.collapse(bound)[0]
    assert certificate.static_factor == pytest.approx(program, rel=1e-7)
    assert certificate.worst_joint is not None


def test_modes_that_are_not_unique_are_left_to_the_program(bond):
    """All courses are about to slide; which does is open."""
    state, scales = solved(bond).state, conditions(bond).scales
    verified = verify(bond, state, scales, 1e-6, 1e-6)
    assert verified.certificate.passed
    elastic = elastic_mode(conditions(bond), state)
    assert bond.problem.max(-(bond.problem.normal @ elastic)) > 1e-6 * np.abs(elastic).max()
    assert np.abs(bond.problem.elastic_part(verified.mode)).max() <= 1e-12 * np.abs(elastic).max()
