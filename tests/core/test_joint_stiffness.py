"""Blocks with joint springs: the factored matrix is the one of the formula."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from fenics_contact import SolverError
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.solvers.effort import Tally
from fenics_contact.solvers.joint_stiffness import (
    GENERAL,
    SYMMETRIC,
    Factor,
    JointRows,
    JointStiffness,
)
from tests.core.problems import (
    THREE_BLOCKS,
    Array,
    load_case,
    on_an_inclined_roller,
    part,
    sparse,
    sprung,
)

KINDS = [SYMMETRIC, GENERAL]


@pytest.fixture(scope="module", params=["ground", "inclined roller"])
def case(request) -> Iterator[LoadCase]:
    on_ground = request.param == "ground"
    scene = THREE_BLOCKS.scene(1) if on_ground else on_an_inclined_roller(1, "roller")
    with load_case(scene) as made:
        yield made


def springs_of(case: LoadCase, kind: str, seed: int) -> list[Array]:
    """Normal, tangential and coupling springs of all points over six decades."""
    random, problem = np.random.default_rng(seed), case.problem
    count = int(problem.sum(np.ones(problem.points)))
    mean = case.discretization.stiffness(kind).mean_diagonal
    normal, tangential = mean * 10.0 ** random.uniform(-3, 3, (2, count))
    coupling = random.uniform(-0.8, 0.8, count) * np.minimum(normal, tangential)
    return [normal, tangential, (kind == GENERAL) * coupling]


def factor_of(case: LoadCase, kind: str, springs: list[Array]) -> Factor:
    mine = [part(case.problem, k, case.problem.law.friction) for k in springs]
    return case.discretization.stiffness(kind).factor(*mine[: 3 if kind == GENERAL else 2])


@pytest.mark.mpi
@pytest.mark.parametrize("seed", range(4))
def test_sign_of_the_determinant(case, seed):
    """That of a coupled matrix, which a large coupling turns; without coupling it is positive."""
    normal, shear, _ = springs_of(case, GENERAL, 0)
    mean = np.full_like(normal, np.median(normal))
    springs = [mean, mean, mean * np.random.default_rng(seed).normal(scale=20.0, size=len(mean))]
    sign, _ = np.linalg.slogdet(sprung(case.problem, *springs))
    assert factor_of(case, GENERAL, springs).determinant_sign == sign
    assert factor_of(case, SYMMETRIC, [normal, shear]).determinant_sign == 1.0


# ---- singular matrices


@pytest.fixture
def loose(request) -> Iterator[JointStiffness]:
    """Two nodes with one joint point; nothing but its normal spring holds the second upright."""
    stiffness = sparse(np.diag([3.0, 3.0, 3.0, 0.0]))
    dofs, upright, level = [[0, 1, 2, 3]], [[0.0, -1.0, 0.0, 1.0]], [[-1.0, 0.0, 1.0, 0.0]]
    rows = JointRows.single(np.array(dofs, np.int32), np.array(upright), np.array(level))
    with JointStiffness(stiffness, [rows], request.param, Tally()) as made:
        yield made
    stiffness.close()


NONE, SOME, LOAD = np.array([0.0]), np.array([2.0]), np.array([0.0, 0.0, 0.0, 6.0])
MOVES = [0.0, 2.0, 0.0, 5.0]  # 6 / 3 below, and 6 / 2 more in the spring


@pytest.mark.parametrize(("loose", "kind"), [(k, k) for k in KINDS], indirect=["loose"])
def test_after_a_singular_matrix_the_next_springs_are_factored(loose, kind):
    """Without a spring the second node moves freely: an error, or farther than anything else."""
    for _ in range(2):
        try:
            moved = loose.factor(NONE, SOME).solve(LOAD)
            assert np.abs(moved).max() > 1e15 or not np.all(np.isfinite(moved))
            assert kind == GENERAL
        except SolverError as error:
            assert "MUMPS cannot factor the blocks with joint springs" in str(error)
        assert loose.factor(SOME, SOME).solve(LOAD) == pytest.approx(MOVES, rel=1e-14)


@pytest.mark.parametrize("loose", [GENERAL], indirect=True)
def test_pivots_of_rounding_leave_a_mechanism_its_direction(loose):
    """A spring so stiff that the 3 N/m of the first node are lost: both nodes move as one."""
    moved = loose.factor(np.array([2.0**100]), SOME, NONE).solve(LOAD)
    assert moved[3] > 2.0  # how far is not known any more: the pivot is zero exactly
    assert moved == pytest.approx(moved[3] * np.array([0.0, 1.0, 0.0, 1.0]), rel=1e-14)
