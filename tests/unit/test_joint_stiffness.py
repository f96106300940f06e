"""Blocks with joint springs: the factored matrix is the one of the formula."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from fenics_contact import Scene, SolverError
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.solvers.joint_stiffness import (
    GENERAL,
    SYMMETRIC,
    Factor,
    JointRows,
    JointStiffness,
    MumpsOptions,
    Tally,
)
from tests.bank import PUSH, STONE
from tests.drawing import Drawing
from tests.unit.core import THREE_BLOCKS, Array, dense, load_case, part, sparse, whole

KINDS = [SYMMETRIC, GENERAL]


def on_an_inclined_roller() -> Scene:
    """The three blocks turned by 30 degrees, on a roller and held by another at their left."""
    usual = THREE_BLOCKS.scene(1)
    drawn = Drawing.of(THREE_BLOCKS.draw(1, False)).moved(lambda x: x @ TURN.T)
    mesh = type(usual.mesh).from_model(drawn.model(), usual.comm)
    supports = {"base": "roller", "left": "roller"}
    return Scene(mesh, {"default": STONE}, PUSH, joints=usual.joints, supports=supports)


TURN = np.array([[np.sqrt(3.0), -1.0], [1.0, np.sqrt(3.0)]]) / 2.0


@dataclass(frozen=True)
class Sprung:
    """Blocks with springs over six decades, and the dense matrix that they make.

    Attributes:
        case: The blocks.
        kind: Of factorisation.
    """

    case: LoadCase
    kind: str

    def springs(self, seed: int) -> list[Array]:
        """Normal, tangential and, where the kind allows, coupling springs of all points."""
        random, problem = np.random.default_rng(seed), self.case.problem
        count = int(problem.sum(np.ones_like(problem.friction)))
        mean = self.stiffness.mean_diagonal
        normal, tangential = mean * 10.0 ** random.uniform(-3, 3, (2, count))
        coupling = random.uniform(-0.8, 0.8, count) * np.minimum(normal, tangential)
        return [normal, tangential, coupling][: 3 if self.kind == GENERAL else 2]

    @property
    def stiffness(self) -> JointStiffness:
        """Of these blocks."""
        return self.case.discretization.stiffness(self.kind)

    def factor(self, springs: list[Array]) -> Factor:
        """A factored."""
        problem = self.case.problem
        return self.stiffness.factor(*(part(problem, k, problem.friction) for k in springs))

    def formula(self, normal: Array, tangential: Array, coupling: Array | None = None) -> Array:
        """A by dense algebra."""
        problem = self.case.problem
        b_n, b_t = dense(problem.normal), dense(problem.tangential)
        matrix = dense(problem.stiffness)
        matrix = matrix + b_n.T @ np.diag(normal) @ b_n + b_t.T @ np.diag(tangential) @ b_t
        return matrix if coupling is None else matrix + b_t.T @ np.diag(coupling) @ b_n

    def part(self, values: Array) -> Array:
        """This rank's part of displacements."""
        return part(self.case.problem, values, self.case.problem.dead)


@pytest.fixture(scope="module", params=["ground", "inclined roller"])
def case(request) -> Iterator[LoadCase]:
    scene = THREE_BLOCKS.scene(1) if request.param == "ground" else on_an_inclined_roller()
    with load_case(scene) as made:
        yield made


@pytest.fixture(params=KINDS)
def sprung(case, request) -> Sprung:
    return Sprung(case, request.param)


@pytest.mark.mpi
def test_solution_is_that_of_the_dense_system(sprung):
    for seed in (1, 2):  # the second replaces the first
        springs = sprung.springs(seed)
        matrix = sprung.formula(*springs)
        exact = np.random.default_rng(2).standard_normal(len(matrix))
        found = sprung.factor(springs).solve(sprung.part(matrix @ exact))
        rounding = 1e-16 * np.linalg.cond(matrix) + 1e-12
        assert whole(sprung.case.problem, found) == pytest.approx(exact, abs=rounding)


@pytest.mark.mpi
def test_several_right_hand_sides_at_once(sprung):
    factor, random = sprung.factor(sprung.springs(5)), np.random.default_rng(1)
    rights = [sprung.part(row) for row in random.normal(size=(3, sprung.case.problem.size))]
    apart = [factor.solve(right) for right in rights]
    for count in (3, 2, 3):
        together = factor.solve_all(rights[:count])
        assert len(together) == count
        for one, other in zip(together, apart, strict=False):
            assert one == pytest.approx(other, rel=1e-9, abs=1e-12 * np.abs(other).max(initial=0))


@pytest.mark.mpi
def test_sparse_right_hand_sides(sprung):
    problem = sprung.case.problem
    springs = sprung.springs(6)
    columns = [
        (np.array([1, 4], dtype=np.int32), np.array([2.0, -3.0])),
        (np.array([problem.size - 1], dtype=np.int32), np.array([1.0])),
        (np.array([0], dtype=np.int32), np.array([5.0])),
    ]
    rights = np.zeros((problem.size, 3))
    for column, (rows, values) in enumerate(columns):
        rights[rows, column] = values
    solutions = sprung.factor(springs).solve_sparse(columns)
    found = np.concatenate(problem.comm.allgather(solutions.getDenseArray()))
    solutions.destroy()
    exact = np.linalg.solve(sprung.formula(*springs), rights)
    assert found == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())


def test_coupling_makes_a_difference(case):
    sprung = Sprung(case, GENERAL)
    springs = sprung.springs(1)
    with_coupling = sprung.factor(springs).solve(case.problem.live)
    without = sprung.factor(springs[:2]).solve(case.problem.live)
    assert np.linalg.norm(with_coupling - without) > 1e-3 * np.linalg.norm(without)


@pytest.mark.mpi
@pytest.mark.parametrize("seed", range(4))
def test_sign_of_the_determinant(case, seed):
    """That of a coupled matrix, which a large coupling turns; without coupling it is positive."""
    sprung, random = Sprung(case, GENERAL), np.random.default_rng(seed)
    normal = np.full(len(sprung.springs(0)[0]), sprung.stiffness.mean_diagonal)
    springs = [normal, normal, normal * random.normal(scale=20.0, size=len(normal))]
    sign, _ = np.linalg.slogdet(sprung.formula(*springs))
    assert sprung.factor(springs).determinant_sign == sign
    assert Sprung(case, SYMMETRIC).factor(springs[:2]).determinant_sign == 1.0


@pytest.mark.parametrize("use", ["solve", "solve_all", "solve_sparse"])
def test_factor_used_after_another_one_is_an_error(sprung, use):
    right = sprung.case.problem.live
    column = np.array([0], dtype=np.int32), np.array([1.0])
    asked = {"solve": right, "solve_all": [right], "solve_sparse": [column]}[use]
    first = sprung.factor(sprung.springs(1))
    assert first.current
    second = sprung.factor(sprung.springs(2))
    assert second.current and not first.current
    with pytest.raises(SolverError, match="after another one"):
        getattr(first, use)(asked)
    second.solve(right)


def test_sign_of_a_determinant_asked_for_too_late_is_an_error(case):
    sprung = Sprung(case, GENERAL)
    first = sprung.factor(sprung.springs(1))
    sprung.factor(sprung.springs(2))
    with pytest.raises(SolverError, match="after another one"):
        _ = first.determinant_sign


def test_factorisations_are_counted(sprung):
    tally = sprung.case.discretization.tally
    assert sprung.stiffness.tally is tally
    before = tally.count
    for seed in range(3):
        sprung.factor(sprung.springs(seed)).solve(sprung.case.problem.live)
    assert tally.count == before + 3


def test_stiffness_itself_is_left_alone(sprung):
    problem = sprung.case.problem
    before = dense(problem.stiffness)
    sprung.factor(sprung.springs(1))
    assert np.array_equal(dense(problem.stiffness), before)
    assert sprung.stiffness.mean_diagonal == pytest.approx(np.diag(before).mean(), rel=1e-14)


def test_both_orderings_give_the_same(case):
    """Minimum fill orders small matrices; larger ones are left to MUMPS' own choice."""
    sprung = Sprung(case, GENERAL)
    springs, right = sprung.springs(5), case.problem.live
    exact = np.linalg.solve(sprung.formula(*springs), right)
    operators = case.discretization.operators
    rows = JointRows.single(operators.dofs, operators.normal_rows, operators.tangential_rows)
    for largest in (0, 10**9):
        options = MumpsOptions(minimum_fill_up_to=largest)
        with JointStiffness(case.problem.stiffness, rows, GENERAL, Tally(), options) as made:
            found = made.factor(*springs).solve(right)
        assert found == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())


# ---- rows of points that share their dofs


def test_grouped_rows_make_the_same_matrix(case):
    """Points in any order, each with the dofs of its two blocks' first nodes."""
    random, problem = np.random.default_rng(7), case.problem
    dofs = np.array([[0, 1, 2, 3], [4, 5, -1, -1], [0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 2, 3]])
    normal, tangential = random.normal(size=(2, 5, 4)) * (dofs >= 0)
    springs = problem.stiffness.diagonal().mean() * random.uniform(0.1, 2.0, (3, 5))
    rows = JointRows.grouped(dofs.astype(np.int32), normal, tangential)
    expected = dense(problem.stiffness)
    for k, own in enumerate(dofs):
        at, b_n, b_t = own[own >= 0], normal[k][own >= 0], tangential[k][own >= 0]
        expected[np.ix_(at, at)] += springs[0, k] * np.outer(b_n, b_n)
        expected[np.ix_(at, at)] += springs[1, k] * np.outer(b_t, b_t)
        expected[np.ix_(at, at)] += springs[2, k] * np.outer(b_t, b_n)
    stiff = 1e-3 * np.eye(len(expected)) * np.abs(expected).max()
    base = sparse(dense(problem.stiffness) + stiff)
    right = random.normal(size=len(expected))
    with JointStiffness(base, rows, GENERAL, Tally()) as made:
        found = made.factor(*springs).solve(right)
    exact = np.linalg.solve(expected + stiff, right)
    assert found == pytest.approx(exact, abs=1e-10 * np.abs(exact).max())
    base.close()


# ---- singular matrices


@pytest.fixture(params=KINDS)
def loose(request) -> Iterator[JointStiffness]:
    """Two nodes with one joint point; nothing but its normal spring holds the second upright."""
    stiffness = sparse(np.diag([3.0, 3.0, 3.0, 0.0]))
    rows = JointRows.single(
        np.array([[0, 1, 2, 3]], dtype=np.int32),
        np.array([[0.0, -1.0, 0.0, 1.0]]),
        np.array([[-1.0, 0.0, 1.0, 0.0]]),
    )
    with JointStiffness(stiffness, rows, request.param, Tally()) as made:
        yield made
    stiffness.close()


NONE, SOME, LOAD = np.array([0.0]), np.array([2.0]), np.array([0.0, 0.0, 0.0, 6.0])
MOVES = [0.0, 2.0, 0.0, 5.0]  # 6 / 3 below, and 6 / 2 more in the spring


def test_after_a_singular_matrix_the_next_springs_are_factored(loose):
    """Without a spring the second node moves freely: an error, or farther than anything else."""
    for _ in range(2):
        try:
            moved = loose.factor(NONE, SOME).solve(LOAD)
            assert np.abs(moved).max() > 1e15 or not np.all(np.isfinite(moved))
        except SolverError as error:
            assert "cannot factor the blocks with joint springs" in str(error)
        assert loose.factor(SOME, SOME).solve(LOAD) == pytest.approx(MOVES, rel=1e-14)
    assert loose.tally.count == 4


@pytest.mark.parametrize("loose", [SYMMETRIC], indirect=True)
def test_symmetric_singular_matrix_is_an_error(loose):
    loose.factor(SOME, SOME)
    with pytest.raises(SolverError, match="MUMPS cannot factor"):
        loose.factor(NONE, SOME)


@pytest.mark.parametrize("loose", [GENERAL], indirect=True)
def test_pivots_of_rounding_leave_a_mechanism_its_direction(loose):
    """A spring so stiff that the 3 N/m of the first node are lost: both nodes move as one.

    With a power of two the pivot is zero exactly.
    """
    moved = loose.factor(np.array([2.0**100]), SOME, NONE).solve(LOAD)
    assert moved[3] > 2.0  # how far is not known any more
    assert moved == pytest.approx(moved[3] * np.array([0.0, 1.0, 0.0, 1.0]), rel=1e-14)
