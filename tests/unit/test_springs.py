"""Blocks with joint springs: the factored matrix is the one of the formula."""

from __future__ import annotations

import numpy as np
import pytest
from petsc4py import PETSc

from fenics_contact import SolverError
from fenics_contact.discretization.joints import JointOperators
from fenics_contact.solvers.joint_stiffness import (
    MINIMUM_FILL,
    SINGULAR,
    SMALLEST_PIVOT,
    JointRows,
    SpringStiffness,
)
from fenics_contact.discretization.discretization import Structure
from tests.helpers import (
    dense,
    joint_rows,
    three_blocks,
    vector_like,
    whole,
)


@pytest.fixture(scope="module", params=["ground", "inclined roller"])
def structure(request) -> Structure:
    return three_blocks(request.param, elements=1, left="roller")


def random_springs(structure: Structure, seed: int) -> list[np.ndarray]:
    """Normal, tangential and coupling springs of all points, over six decades."""
    random = np.random.default_rng(seed)
    count = len(structure.joints.length)
    mean = structure.springs.mean_diagonal
    normal, tangential = mean * 10.0 ** random.uniform(-3, 3, (2, count))
    coupling = random.uniform(-0.8, 0.8, count) * np.minimum(normal, tangential)
    return [normal, tangential, coupling]


def formula(structure: Structure, normal, tangential, coupling=None) -> np.ndarray:
    b_n, b_t = joint_rows(structure)
    matrix = dense(structure.problem.stiffness)
    matrix = matrix + b_n.T @ np.diag(normal) @ b_n + b_t.T @ np.diag(tangential) @ b_t
    if coupling is not None:
        matrix = matrix + b_t.T @ np.diag(coupling) @ b_n
    return matrix


def solved(structure: Structure, springs: SpringStiffness, right: np.ndarray) -> np.ndarray:
    load = vector_like(structure.problem.dead, right)
    solution = load.duplicate()
    springs.solve(load, solution)
    return whole(solution)


def factor(structure: Structure, springs: SpringStiffness, *values: np.ndarray) -> None:
    points = structure.operators.points
    springs.factor(*(value[points] for value in values))


@pytest.fixture
def springs(structure):
    """A fresh factorisation, with its counter at zero."""
    made = SpringStiffness(structure.problem.stiffness, JointRows.of(structure.operators))
    yield made
    made.destroy()


@pytest.mark.parametrize("coupled", [False, True])
def test_solution_is_that_of_the_dense_system(structure, springs, coupled):
    values = random_springs(structure, 1)[: 3 if coupled else 2]
    matrix = formula(structure, *values)
    exact = np.random.default_rng(2).standard_normal(len(matrix))
    factor(structure, springs, *values)
    found = solved(structure, springs, matrix @ exact)
    rounding = 1e-16 * np.linalg.cond(matrix) + 1e-12
    assert found == pytest.approx(exact, abs=rounding)
    right = vector_like(structure.problem.dead, matrix.T @ exact)
    transposed = right.duplicate()
    springs.solve_transposed(right, transposed)
    assert whole(transposed) == pytest.approx(exact, abs=rounding)


def test_coupling_makes_a_difference(structure, springs):
    values = random_springs(structure, 1)
    right = np.random.default_rng(3).standard_normal(structure.problem.dead.getSize())
    factor(structure, springs, *values)
    with_coupling = solved(structure, springs, right)
    factor(structure, springs, *values[:2])
    without = solved(structure, springs, right)
    difference = np.linalg.norm(with_coupling - without) / np.linalg.norm(without)
    assert difference > 1e-3


def test_factoring_again_replaces_the_springs(structure, springs):
    right = np.random.default_rng(4).standard_normal(structure.problem.dead.getSize())
    for seed, coupled in ((5, False), (6, False), (7, True), (8, True), (5, False)):
        values = random_springs(structure, seed)[: 3 if coupled else 2]
        factor(structure, springs, *values)
        exact = np.linalg.solve(formula(structure, *values), right)
        found = solved(structure, springs, right)
        assert found == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())


def test_factorisations_are_counted(structure, springs):
    assert springs.factorizations == 0
    assert springs.seconds == 0.0
    for count, coupled in enumerate((False, True, False), start=1):
        factor(structure, springs, *random_springs(structure, count)[: 3 if coupled else 2])
        assert springs.factorizations == count
    solved(structure, springs, np.ones(structure.problem.dead.getSize()))
    assert springs.factorizations == 3


def test_mean_diagonal_is_that_of_the_stiffness(structure, springs):
    diagonal = np.diag(dense(structure.problem.stiffness))
    assert springs.mean_diagonal == pytest.approx(diagonal.mean(), rel=1e-14)


def test_stiffness_itself_is_left_alone(structure, springs):
    before = dense(structure.problem.stiffness)
    factor(structure, springs, *random_springs(structure, 1))
    assert np.array_equal(dense(structure.problem.stiffness), before)


@pytest.mark.parametrize("largest", [10**9, 0])
def test_minimum_fill_orders_small_unsymmetric_matrices(structure, springs, largest, monkeypatch):
    """The solution is the same with MUMPS' own choice, which larger ones are left to."""
    monkeypatch.setattr("fenics_contact.solvers.joint_stiffness.FILL_UNKNOWNS", largest)
    values = random_springs(structure, 5)
    factor(structure, springs, *values)
    factored = springs._factors["lu"][1].getPC().getFactorMatrix()
    assert factored.getMumpsIcntl(7) == (MINIMUM_FILL if largest else 7)
    for name, value in ((6, 0), (8, 0), (33, 1)):  # plain elimination, with the determinant
        assert factored.getMumpsIcntl(name) == value
    assert factored.getMumpsCntl(1) == 0.0
    matrix = formula(structure, *values)
    exact = np.random.default_rng(6).standard_normal(len(matrix))
    found = solved(structure, springs, matrix @ exact)
    assert found == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())


def loose_node() -> tuple[SpringStiffness, PETSc.Vec]:
    """Two nodes with one joint point; nothing but its normal spring holds the second upright."""
    stiffness = PETSc.Mat().createAIJ((4, 4), nnz=1, comm=PETSc.COMM_SELF)
    for dof, value in enumerate((3.0, 3.0, 3.0, 0.0)):
        stiffness.setValue(dof, dof, value)
    stiffness.assemble()
    point = JointOperators(
        normal=None,
        tangential=None,
        points=np.array([0]),
        dofs=np.array([[0, 1, 2, 3]], dtype=PETSc.IntType),
        normal_rows=np.array([[0.0, -1.0, 0.0, 1.0]]),
        tangential_rows=np.array([[-1.0, 0.0, 1.0, 0.0]]),
        sides=np.array([[0, 1]]),
    )
    load = stiffness.createVecLeft()
    load.array[:] = [0.0, 0.0, 0.0, 6.0]
    return SpringStiffness(stiffness, JointRows.of(point)), load


NONE, SOME = np.array([0.0]), np.array([2.0])
LOOSE_NODE_MOVES = [0.0, 2.0, 0.0, 5.0]  # 6 / 3 below, and 6 / 2 more in the spring


@pytest.mark.parametrize("coupling", [(), (NONE,)])
def test_node_that_no_spring_holds_cannot_be_factored(coupling):
    springs, _ = loose_node()
    with pytest.raises(SolverError, match="MUMPS cannot factor"):
        springs.factor(NONE, SOME, *coupling)


@pytest.mark.parametrize("coupling", [(), (NONE,)])
def test_failure_is_that_of_these_springs_and_not_of_the_last(coupling):
    springs, load = loose_node()
    springs.factor(SOME, SOME, *coupling)
    moved = load.duplicate()
    springs.solve(load, moved)
    assert moved.array == pytest.approx(LOOSE_NODE_MOVES, rel=1e-14)
    with pytest.raises(SolverError, match="MUMPS cannot factor"):
        springs.factor(NONE, SOME, *coupling)


@pytest.mark.parametrize("coupling", [(), (NONE,)])
def test_after_a_failure_the_next_springs_are_factored(coupling):
    springs, load = loose_node()
    with pytest.raises(SolverError):
        springs.factor(NONE, SOME, *coupling)
    springs.factor(SOME, SOME, *coupling)
    moved = load.duplicate()
    springs.solve(load, moved)
    assert moved.array == pytest.approx(LOOSE_NODE_MOVES, rel=1e-14)


def test_bonded_structure_hardly_opens(structure):
    bonded = structure.bonded()
    b_n, b_t = joint_rows(structure)
    response = whole(bonded.live)
    jump = max(np.abs(b_n @ response).max(), np.abs(b_t @ response).max())
    assert 0.0 < jump < 1e-2 * np.abs(response).max()
    stiff = np.full(len(structure.joints.length), 1e2 * structure.springs.mean_diagonal)
    matrix = formula(structure, stiff, stiff)
    exact = np.linalg.solve(matrix, whole(structure.problem.live))
    assert response == pytest.approx(exact, abs=1e-10 * np.abs(exact).max())
    pressure = structure.all_points(bonded.live_pressure)
    expected = np.maximum(-stiff * (b_n @ response), 0.0)
    assert pressure == pytest.approx(expected, abs=1e-8 * expected.max())


@pytest.mark.parametrize("seed", range(6))
def test_sign_of_the_determinant(structure, seed):
    """That of a coupled matrix, which a large coupling turns; without coupling it is positive."""
    random = np.random.default_rng(seed)
    stiff = np.full(len(structure.problem.friction), structure.springs.mean_diagonal)
    coupling = stiff * random.normal(scale=20.0, size=len(stiff))
    structure.springs.factor(stiff, stiff, coupling)
    sign, _ = np.linalg.slogdet(formula(structure, stiff, stiff, coupling))
    assert structure.springs.determinant_sign == sign
    structure.springs.factor(stiff, stiff)
    assert structure.springs.determinant_sign == 1.0


def test_two_right_hand_sides_at_once(structure):
    springs = structure.springs
    springs.factor(*random_springs(structure, 5))
    size = structure.problem.live.getSize()
    rights = tuple(
        vector_like(structure.problem.live, np.random.default_rng(k).normal(size=size))
        for k in (1, 2)
    )
    apart = [right.duplicate() for right in rights]
    for right, solution in zip(rights, apart, strict=True):
        springs.solve(right, solution)
    for _ in range(2):  # the second time in the same matrices
        together = rights[0].duplicate(), rights[1].duplicate()
        springs.solve_together(rights, together)
        for one, other in zip(apart, together, strict=True):
            assert one.norm() > 0.0
            assert other.array == pytest.approx(one.array, rel=1e-9, abs=1e-12 * one.norm())


@pytest.mark.parametrize("soft", [2.0, 0.0])
def test_pivot_that_rounding_makes_zero_is_no_failure_unless_a_spring_is(soft, monkeypatch):
    """Where MUMPS says that a pivot is zero, pivots get a smallest size and it is asked again."""
    springs, load = loose_node()
    tried = []

    def zero_first(*values):
        tried.append(springs._smallest_pivot)
        return original(*values) if len(tried) > 1 else SINGULAR

    original = springs._factored
    monkeypatch.setattr(springs, "_factored", zero_first)
    if soft:
        springs.factor(np.array([soft]), SOME, NONE)
        moved = load.duplicate()
        springs.solve(load, moved)
        assert moved.array == pytest.approx(LOOSE_NODE_MOVES, rel=1e-14)
        assert tried == [0.0, SMALLEST_PIVOT * springs.mean_diagonal]
    else:
        with pytest.raises(SolverError, match="MUMPS cannot factor"):
            springs.factor(NONE, SOME, NONE)
        assert tried == [0.0]
    assert springs.factorizations == 1


def test_pivots_of_rounding_leave_a_mechanism_its_direction():
    """A spring so stiff that the 3 N/m of the first node are lost: both nodes move as one.

    With a power of two the pivot is zero exactly.
    """
    springs, load = loose_node()
    springs.factor(np.array([2.0**100]), SOME, NONE)
    assert springs._smallest_pivot == SMALLEST_PIVOT * springs.mean_diagonal
    moved = load.duplicate()
    springs.solve(load, moved)
    assert moved.array[3] > 2.0  # how far is not known any more
    assert moved.array == pytest.approx(moved.array[3] * np.array([0.0, 1.0, 0.0, 1.0]), rel=1e-14)


def test_second_factor_is_in_memory_only_for_a_series(structure, springs):
    """A single symmetric matrix after others is factored with the analysis made for those."""
    *symmetric, coupling = random_springs(structure, 7)
    exact = np.random.default_rng(8).standard_normal(structure.problem.dead.getSize())
    coupled = [*symmetric, coupling]
    for values, kinds in (
        (symmetric, ["cholesky"]),
        (coupled, ["lu"]),
        (symmetric, ["lu"]),
        (symmetric, ["lu", "cholesky"]),
        (coupled, ["lu", "cholesky"]),
    ):
        factor(structure, springs, *values)
        assert list(springs._factors) == kinds
        found = solved(structure, springs, formula(structure, *values) @ exact)
        assert found == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())
    springs.forget()
    assert not springs._factors
    factor(structure, springs, *symmetric)
    assert list(springs._factors) == ["cholesky"]
