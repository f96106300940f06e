"""The discrete contact problem: maps, reductions over ranks, and what strains the blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.solvers.problem import ContactProblem, Scales
from tests.bank import wall_recipe
from tests.unit.core import BOND, Array, dense, load_case, part, sparse, whole

pytestmark = pytest.mark.mpi


@pytest.fixture(scope="module")
def case() -> Iterator[LoadCase]:
    with load_case(BOND.scene(2)) as made:
        yield made


def made_up(problem: ContactProblem, **changes: Array) -> ContactProblem:
    return replace(problem, **changes)


@pytest.mark.parametrize("name", ["stiffness", "normal", "tangential", "rigid"])
def test_maps_multiply_like_dense_matrices(case, name):
    problem, matrix = case.problem, getattr(case.problem, name)
    exact, random = dense(matrix), np.random.default_rng(1)
    rows, columns = (matrix.matrix.getLocalSize()[k] for k in (0, 1))
    x, y = random.normal(size=exact.shape[1]), random.normal(size=exact.shape[0])
    size = np.abs(exact).max() * len(x)
    product = whole(problem, matrix @ part(problem, x, np.empty(columns)))
    assert product == pytest.approx(exact @ x, abs=1e-14 * size)
    product = whole(problem, matrix.T @ part(problem, y, np.empty(rows)))
    assert product == pytest.approx(exact.T @ y, abs=1e-14 * size)


def test_diagonal_and_first_row(case):
    problem, stiffness = case.problem, case.problem.stiffness
    assert np.array_equal(whole(problem, stiffness.diagonal()), np.diag(dense(stiffness)))
    counts = problem.comm.allgather(len(problem.dead))
    assert stiffness.first_row == sum(counts[: problem.comm.rank])
    assert problem.size == sum(counts)


def test_products_are_new_arrays():
    double = sparse(np.diag([2.0, 3.0]))
    x = np.ones(2)
    first, second = double @ x, double @ (2.0 * x)
    assert first == pytest.approx([2.0, 3.0]) and second == pytest.approx([4.0, 6.0])
    assert x == pytest.approx([1.0, 1.0])
    double.close()


def test_reductions_are_those_of_whole_arrays(case):
    problem = case.problem
    live, dead = whole(problem, problem.live), whole(problem, problem.dead)
    assert problem.dot(problem.live, problem.dead) == pytest.approx(live @ dead, abs=1e-9)
    assert problem.dot(problem.live, problem.live) == pytest.approx(live @ live, rel=1e-14)
    assert problem.sum(problem.live) == pytest.approx(live.sum(), rel=1e-13)
    assert problem.max(problem.live) == live.max()
    assert problem.max(np.zeros(0)) == 0.0
    assert problem.max(np.zeros(0), initial=-3.0) == -3.0


def test_maximum_of_what_is_not_a_number_is_none(case):
    values = np.zeros(3)
    if case.problem.comm.rank == case.problem.comm.size - 1:
        values[1] = np.nan
    assert np.isnan(case.problem.max(values))


def test_slip_and_compliance_start_from_none(case):
    points = len(case.problem.friction)
    assert np.array_equal(case.problem.slip_origin, np.zeros(points))
    assert np.array_equal(case.problem.compliance, np.zeros((2, points)))


def test_bound_on_friction_is_that_of_both_laws(case):
    count = len(case.problem.friction)
    friction, strength = np.where(np.arange(count) % 2, 0.3, 0.0), np.full(count, 2.0)
    problem = made_up(case.problem, friction=friction, strength=strength)
    assert problem.bound(np.full(count, 10.0)) == pytest.approx(10.0 * friction + 2.0)
    assert np.all(problem.frictional) and problem.coulomb
    smooth = made_up(problem, friction=np.zeros(count), strength=0.0 * strength)
    assert not np.any(smooth.frictional) and not smooth.coulomb
    assert not made_up(problem, friction=np.zeros(count)).coulomb


def test_joint_forces_are_in_balance_with_each_other(case):
    """Those of joints between blocks sum up to nothing; the rest is the ground's."""
    problem, random = case.problem, np.random.default_rng(2)
    pressure, shear = random.normal(size=(2, len(problem.friction)))
    forces = problem.joint_forces(pressure, shear)
    b_n, b_t = dense(problem.normal), dense(problem.tangential)
    expected = b_n.T @ whole(problem, pressure) + b_t.T @ whole(problem, shear)
    assert whole(problem, forces) == pytest.approx(expected, abs=1e-12)
    discretization = case.discretization
    ground = discretization.joints.bodies[discretization.operators.points, 0] < 0
    total = problem.sum((forces).reshape(-1, 2)[:, 1])
    assert total == pytest.approx(problem.sum(pressure[ground]), abs=1e-10)


def test_rigid_motions_strain_nothing(case):
    problem = case.problem
    columns = problem.rigid.matrix.getLocalSize()[1]
    motion = problem.rigid @ np.random.default_rng(3).normal(size=columns)
    size = problem.max(np.abs(motion))
    assert problem.max(np.abs(problem.elastic_part(motion))) <= 1e-15 * size
    forces = problem.max(np.abs(problem.stiffness @ motion))
    assert forces <= 1e-12 * problem.max(problem.stiffness.diagonal()) * size
    rigid = dense(problem.rigid)
    assert rigid.T @ rigid == pytest.approx(np.eye(rigid.shape[1]), abs=1e-13)


def test_strains_beside_motions_of_many_nodes():
    """Blocks of 81 nodes: rounding in sums over them is no strain."""
    with load_case(BOND.scene(8)) as case:
        problem, random = case.problem, np.random.default_rng(3)
        rigid = dense(problem.rigid)
        strains = 1e-6 * random.normal(size=len(rigid))
        u = rigid @ (1e5 * random.normal(size=rigid.shape[1])) + strains
        found = whole(problem, problem.elastic_part(part(problem, u, problem.dead)))
    expected = strains - rigid @ (rigid.T @ strains)
    assert np.abs(found - expected).max() < 3e-16 * np.abs(u).max()


def test_state_of_displacements(case):
    problem, u = case.problem, case.bonded.live
    none = np.zeros_like(problem.friction)
    state = problem.state(u, 0.3, none, none)
    assert state.work == pytest.approx(problem.dot(problem.live, u), rel=1e-14)
    assert np.array_equal(state.elastic, problem.elastic_part(u))
    assert state.load_factor == 0.3


def test_elastic_part_of_scales_is_at_most_one():
    assert Scales(2.0, 1.0, 1.0, 0.5).elastic_part == 0.25
    assert Scales(2.0, 1.0, 1.0, 5.0).elastic_part == 1.0


def test_arrays_and_maps_fit(case):
    with load_case(wall_recipe("W1", BOND.law).scene(1)) as other:
        problem = other.problem
        points = len(problem.friction)
        assert problem.normal.matrix.getLocalSize() == (points, len(problem.dead))
        assert (problem.normal @ problem.live).shape == (points,)
        assert (problem.normal.T @ problem.friction).shape == problem.dead.shape
