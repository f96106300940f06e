"""States by the interior point method: elastic branch, plateau, starts from far away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import SolverError, limit_load
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.interior_point import (
    Tolerances,
    solve_interior_point,
)
from tests.bank import block_recipe
from tests.core.problems import BOND, Array, conditions, dense, prepared, solved
from tests.property.scenes import Draw

bond, block = prepared(BOND), prepared(block_recipe(0.4, 0.4, 0.5), 2)


def program(case: LoadCase, bound: Array) -> float:
    """Limit load of rigid blocks with given friction."""
    return case.blocks.collapse(case.discretization.all_points(bound))[0]


@pytest.mark.parametrize("friction", [0.05, 0.5, 2.0])
def test_plateau_is_the_rigid_limit_load(bond, friction):
    bound, tally = friction * bond.first_pressure, bond.discretization.tally
    before = tally.count
    found = solved(bond, given=bound)
    assert found.state.load_factor == pytest.approx(program(bond, bound), rel=1e-8)
    assert found.steps == tally.count - before <= 40
    near = conditions(bond, given=1.001 * bound)
    warm = solve_interior_point(near, found.state, 1e-6, Tolerances())
    assert warm.state.load_factor == pytest.approx(program(bond, 1.001 * bound), rel=1e-8)
    assert warm.steps < found.steps


def test_elastic_branch_is_the_response_with_closed_joints(block):
    """Small load, high friction: nothing opens or slips, and the load factor follows from K."""
    problem = block.problem
    b_n, stiffness = dense(problem.normal), dense(problem.stiffness)
    rows, count = np.vstack([b_n, dense(problem.tangential)]), len(stiffness)
    system = np.block([[stiffness, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    loads = np.concatenate([problem.dead + 0.05 * problem.live, np.zeros(len(rows))])
    u, forces = np.split(np.linalg.solve(system, loads), [count])
    pressure = -forces[: len(b_n)]
    assert np.all(pressure > 0.0)
    work, bound = float(problem.live @ u), np.full(len(pressure), 1e2 * block.scales.force)
    kkt = block.given(bound, work, block.scales_at(work))
    state = solve_interior_point(kkt, block.bonded_state(work), 1.0, Tolerances()).state
    assert state.load_factor == pytest.approx(0.05, rel=1e-7)
    assert state.displacement == pytest.approx(u, abs=1e-7 * np.abs(u).max())
    assert state.pressure == pytest.approx(pressure, abs=1e-6 * pressure.max())


def test_too_few_steps_and_no_numbers_are_errors(bond):
    kkt = conditions(bond)
    start, tolerances = bond.bonded_state(kkt.work), Tolerances()
    with pytest.raises(SolverError, match=r"residual \d.*e.* after 3 steps, asked 1.0e-12"):
        solve_interior_point(kkt, start, 1.0, tolerances, replace(SEARCH, interior_steps=3))
    few = replace(SEARCH, interior_steps=6, exact_state=1.0)
    assert solve_interior_point(kkt, start, 1.0, tolerances, few).steps == 6
    nothing = replace(start, pressure=np.full_like(start.pressure, np.nan))
    with pytest.raises(SolverError, match="interior point: residual"):
        solve_interior_point(kkt, nothing, 1.0, tolerances)


def test_a_stalled_state_whose_load_factor_still_changes_is_not_taken():
    """Its residuals are small and its certificate passes, but its load factor belongs to no state.

    Two states are near: rounding leads to either. Both are found with a tolerance of 1e-9, too.
    """
    draw = Draw.of_seed(283)
    result = limit_load(draw.recipe().scene(draw.elements))
    assert result.status == "limit"
    states = np.array([1.0837441, 1.0842564])
    assert np.abs(result.load_factor / states - 1.0).min() <= 1e-6
    assert result.positive.certificate.residuals["equilibrium"] <= 1e-9
