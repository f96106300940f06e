"""The discrete contact problem: maps, reductions over ranks, and what strains the blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.core.problems import BOND, dense, load_case, part, prepared, whole

pytestmark = pytest.mark.mpi

case = prepared(BOND, 2)


@pytest.mark.parametrize("name", ["stiffness", "normal", "tangential", "rigid"])
def test_maps_multiply_like_dense_matrices(case, name):
    problem, matrix = case.problem, getattr(case.problem, name)
    exact, random = dense(matrix), np.random.default_rng(1)
    rows, columns = (np.empty(matrix.matrix.getLocalSize()[k]) for k in (0, 1))
    x, y = random.normal(size=exact.shape[1]), random.normal(size=exact.shape[0])
    size = 1e-14 * np.abs(exact).max() * len(x)
    product = whole(problem, matrix @ part(problem, x, columns))
    assert product == pytest.approx(exact @ x, abs=size)
    product = whole(problem, matrix.T @ part(problem, y, rows))
    assert product == pytest.approx(exact.T @ y, abs=size)
    first = sum(problem.comm.allgather(len(rows))[: problem.comm.rank])
    assert matrix.first_row == first
    if name == "stiffness":
        assert np.array_equal(whole(problem, matrix.diagonal()), np.diag(exact))
        assert problem.size == len(exact)


def test_reductions_are_those_of_whole_arrays(case):
    problem = case.problem
    live, dead = whole(problem, problem.live), whole(problem, problem.dead)
    assert problem.dot(problem.live, problem.dead) == pytest.approx(live @ dead, abs=1e-9)
    assert problem.dot(problem.live, problem.live) == pytest.approx(live @ live, rel=1e-14)
    assert problem.sum(problem.live) == pytest.approx(live.sum(), rel=1e-13)
    assert problem.max(problem.live) == live.max()
    assert problem.max(np.zeros(0)) == 0.0
    last = problem.comm.rank == problem.comm.size - 1  # the only rank that has no number
    assert np.isnan(problem.max(np.array([1.0, np.nan if last else 0.0])))


def test_bound_on_friction_is_that_of_both_laws(case):
    count = case.problem.points
    friction, strength = np.where(np.arange(count) % 2, 0.3, 0.0), np.full(count, 2.0)
    problem = case.problem.with_law(friction=friction, strength=strength)
    assert problem.law.bound(np.full(count, 10.0)) == pytest.approx(10.0 * friction + 2.0)
    assert np.all(problem.law.frictional) and problem.coulomb
    smooth = replace(problem, law=problem.law.frictionless())
    assert not np.any(smooth.law.frictional) and not smooth.coulomb


def test_rigid_motions_strain_nothing(case):
    problem, rigid = case.problem, dense(case.problem.rigid)
    columns = problem.rigid.matrix.getLocalSize()[1]
    motion = problem.rigid @ np.random.default_rng(3).normal(size=columns)
    size = problem.max(np.abs(motion))
    assert problem.max(np.abs(problem.elastic_part(motion))) <= 1e-15 * size
    forces = problem.max(np.abs(problem.stiffness @ motion))
    assert forces <= 1e-12 * problem.max(problem.stiffness.diagonal()) * size
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
