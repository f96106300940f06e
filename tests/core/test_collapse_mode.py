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
