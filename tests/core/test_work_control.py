"""The state of a collapse is that where it begins."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.collapse.strategy import COULOMB
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.results.certificate import state_residuals
from tests.bank import block_recipe, coulomb, wall_recipe
from tests.core.problems import load_case


@pytest.mark.parametrize("name", ["W1", "block"])
def test_state_is_that_where_the_collapse_begins(name):
    """Every joint that moves in the mode has moved so; one of them has not yet."""
    recipe = wall_recipe("W1", coulomb(0.65)) if name == "W1" else block_recipe(0.4, 1.0, 0.7)
    with load_case(recipe.scene(1)) as case:
        found, problem = find_collapse(case, COULOMB["auto"], 1e-6), case.problem
        state, mode = found.state, found.mode
        work = problem.dot(problem.live, state.displacement)
        assert found.status == "limit" and work == pytest.approx(state.work, rel=1e-9)
        assert max(state_residuals(problem, state, case.scales_at(work)).values()) < 1e-4
        far = found.work_ratio * case.bonded_work
        rates, moved = ((problem.normal @ u) for u in (mode, state.displacement))
        slip_rates, slipped = ((problem.tangential @ u) for u in (mode, state.displacement))
        assert np.array_equal(found.joints.gap, case.discretization.all_points(moved))
    opens = rates > 1e-3 * np.abs(rates).max()
    slips = (np.abs(slip_rates) > 1e-3 * np.abs(mode).max()) & (state.pressure > 0.0)
    since = [*(moved / rates)[opens], *(slipped / slip_rates)[slips]]
    assert min(since) == pytest.approx(0.0, abs=1e-9 * far) and state.work < far
