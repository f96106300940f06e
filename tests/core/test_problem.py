"""The discrete contact problem: maps, reductions over ranks, and what strains the blocks."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.problems import BOND, dense, load_case, part, prepared, whole

pytestmark = pytest.mark.mpi

case = prepared(BOND, 2)


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
