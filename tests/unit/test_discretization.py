"""A scene discretised: what is made once, the bonded response, and typical sizes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import InputError, Load
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.discretization.discretization import (
    BONDED_SPRING,
    Discretization,
)
from fenics_contact.meshing import wall
from fenics_contact.solvers.joint_stiffness import GENERAL, SYMMETRIC
from tests.bank import GRAVITY, STONE, WALLS, Recipe, block_recipe, coulomb, tresca
from tests.unit.core import BOND, THREE_BLOCKS, dense, load_case, whole


@pytest.fixture(scope="module")
def case() -> Iterator[LoadCase]:
    with load_case(THREE_BLOCKS.scene(2)) as made:
        yield made


@pytest.mark.mpi
def test_bonded_structure_hardly_opens(case):
    problem, bonded = case.problem, case.bonded
    b_n, b_t = dense(problem.normal), dense(problem.tangential)
    response = whole(problem, bonded.live)
    assert 0.0 < np.abs(b_n @ response).max() < 1e-2 * np.abs(response).max()
    spring = BONDED_SPRING * case.stiffness.mean_diagonal
    matrix = dense(problem.stiffness) + spring * (b_n.T @ b_n + b_t.T @ b_t)
    for load, found, pressure in (
        (problem.dead, bonded.dead, bonded.dead_pressure),
        (problem.live, bonded.live, bonded.live_pressure),
    ):
        exact = np.linalg.solve(matrix, whole(problem, load))
        assert whole(problem, found) == pytest.approx(exact, abs=1e-10 * np.abs(exact).max())
        expected = np.maximum(-spring * (b_n @ exact), 0.0)
        assert whole(problem, pressure) == pytest.approx(expected, abs=1e-8 * expected.max())
    assert bonded.seconds > 0.0


def test_bonded_response_is_that_of_both_factorisations():
    with Discretization(BOND.scene(1)) as made:
        one, other = (made.bonded(kind) for kind in (SYMMETRIC, GENERAL))
        assert made.tally.count == made.factorizations() == 2
    for name in ("dead", "live", "dead_pressure", "live_pressure"):
        expected = getattr(one, name)
        assert getattr(other, name) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


@pytest.mark.mpi
def test_loads_are_the_weights_of_the_blocks(case):
    problem = case.problem
    weight = STONE.density * GRAVITY * case.discretization.bodies_area()
    assert case.discretization.bodies_area() == pytest.approx(2 * 0.4 * 0.175, rel=1e-12)
    assert problem.sum(problem.dead) == pytest.approx(-weight, rel=1e-12)
    assert problem.sum(problem.live) == pytest.approx(weight, rel=1e-12)


@pytest.mark.mpi
def test_rigid_motions_open_no_joint_within_a_body_and_strain_nothing(case):
    problem, random = case.problem, np.random.default_rng(1)
    motion = random.normal(size=(case.block_count, 3))
    u = case.discretization.rigid_motion(motion)
    assert problem.max(np.abs(problem.elastic_part(u))) <= 1e-14 * problem.max(np.abs(u))
    together = np.tile([0.3, -0.2, 0.0], (case.block_count, 1))
    moved = case.discretization.rigid_motion(together).reshape(-1, 2)
    assert moved == pytest.approx(np.tile([0.3, -0.2], (len(moved), 1)), abs=1e-14)
    resultants = case.discretization.bodies.live
    work = np.sum(resultants[:, :2] * motion[:, :2])
    work += np.sum(resultants[:, 2] * case.discretization.bodies.size * motion[:, 2])
    assert problem.dot(problem.live, u) == pytest.approx(work, rel=1e-10)


def test_stiffnesses_are_made_once_and_counted():
    with Discretization(BOND.scene(1)) as made:
        assert made.stiffness(GENERAL) is made.stiffness(GENERAL)
        assert made.stiffness(GENERAL) is not made.stiffness(SYMMETRIC)
        assert made.block_modes is made.block_modes
        none = np.ones_like(made.problem.friction)
        made.stiffness(GENERAL).factor(none, none)
        with made.block_modes.stiffness(GENERAL, made.mode_tally) as stiffness:
            stiffness.factor(none, none)
        assert (made.tally.count, made.mode_tally.count, made.factorizations()) == (1, 1, 2)
        assert made.seconds > 0.0


def test_live_load_on_nothing_is_an_input_error():
    for recipe in (
        replace(BOND, parts={"live": Load()}),
        Recipe(
            lambda n, quads: wall(WALLS["W1"][:2], elements=n),
            coulomb(0.5),
            {"live": Load((0.0, 0.0))},
        ),
    ):
        with pytest.raises(InputError, match=r"loads.live: the live load is zero"):
            Discretization(recipe.scene(1))


# ---- typical sizes


def test_typical_load_factor_stores_as_much_energy_as_the_dead_load(case):
    problem, bonded, scales = case.problem, case.bonded, case.scales
    live = scales.load_factor**2 * problem.dot(problem.live, bonded.live)
    assert live == pytest.approx(problem.dot(problem.dead, bonded.dead), rel=1e-12)
    assert scales.force == problem.max(bonded.dead_pressure)
    moved = scales.load_factor * problem.dot(problem.live, bonded.live)
    assert scales.displacement == pytest.approx(moved / problem.sum(np.abs(problem.live)))
    assert scales.elastic == scales.displacement


def test_typical_sizes_without_a_dead_load_are_those_of_the_strength():
    recipe = block_recipe(0.4, 0.4, 0.5, dead=Load(), joints={}, foundations={"base": tresca(2e3)})
    with load_case(recipe.scene(2)) as case:
        assert case.scales.force == case.problem.strength.max() > 0.0
        force = case.scales.load_factor * case.problem.max(case.bonded.live_pressure)
        assert force == pytest.approx(case.scales.force, rel=1e-12)
