"""A scene discretised: what is made once, the bonded response, and typical sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import InputError, Load
from fenics_contact.discretization.discretization import BONDED_SPRING, Discretization
from fenics_contact.solvers.joint_stiffness import GENERAL, SYMMETRIC
from tests.bank import block_recipe, tresca
from tests.core.problems import BOND, THREE_BLOCKS, load_case, prepared, sprung, whole

case = prepared(THREE_BLOCKS, 2)


@pytest.mark.mpi
def test_bonded_structure_hardly_opens(case):
    problem, bonded = case.problem, case.bonded
    spring = BONDED_SPRING * case.stiffness.mean_diagonal
    opening = problem.max(np.abs(problem.normal @ bonded.live))
    assert 0.0 < opening < 1e-2 * problem.max(np.abs(bonded.live))
    springs = whole(problem, np.full(problem.points, spring))
    matrix = sprung(problem, springs, springs, 0.0 * springs)
    for name in ("dead", "live"):
        found = getattr(bonded, name)
        exact = np.linalg.solve(matrix, whole(problem, getattr(problem, name)))
        assert whole(problem, found) == pytest.approx(exact, abs=1e-10 * np.abs(exact).max())
        pressure = np.maximum(-spring * (problem.normal @ found), 0.0)
        assert getattr(bonded, f"{name}_pressure") == pytest.approx(pressure, rel=1e-9)


def test_what_is_made_once_is_counted_and_arrays_outlive_it():
    with Discretization(BOND.scene(1)) as made:
        one, other = (made.bonded(kind) for kind in (SYMMETRIC, GENERAL))
        assert made.stiffness(GENERAL) is made.stiffness(GENERAL) is not made.stiffness(SYMMETRIC)
        assert made.block_modes is made.block_modes
        none = np.ones(made.problem.points)
        stiffness = made.block_modes.stiffness(GENERAL, made.mode_tally)
        stiffness.factor(none, none)
        assert (made.tally.count, made.mode_tally.count, made.factorizations()) == (2, 1, 3)
    for name in ("dead", "live", "dead_pressure", "live_pressure"):
        expected = getattr(one, name)
        assert getattr(other, name) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
    assert made.problem.points == len(made.joints.length) == len(none)


def test_live_load_on_nothing_is_an_input_error():
    with pytest.raises(InputError, match=r"loads\.live: the live load is zero"):
        Discretization(replace(BOND, parts={"live": Load()}).scene(1))


def test_typical_sizes(case):
    """The live load stores as much energy as the dead load; without one strengths count."""
    problem, bonded, scales = case.problem, case.bonded, case.scales
    live = scales.load_factor**2 * problem.dot(problem.live, bonded.live)
    assert live == pytest.approx(problem.dot(problem.dead, bonded.dead), rel=1e-12)
    assert scales.force == problem.max(bonded.dead_pressure)
    moved = live / scales.load_factor / problem.sum(np.abs(problem.live))
    assert scales.displacement == scales.elastic == pytest.approx(moved)
    weightless = replace(block_recipe(0.4, 0.4, 0.0, dead=Load()), law=tresca(2e3))
    with load_case(weightless.scene(2)) as other:
        assert other.scales.force == other.problem.law.strength.max() > 0.0
        force = other.scales.load_factor * other.problem.max(other.bonded.live_pressure)
        assert force == pytest.approx(other.scales.force, rel=1e-12)
