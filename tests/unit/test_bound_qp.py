"""Bound-constrained programs: what every back end can do, and that none is believed."""

from __future__ import annotations

import numpy as np
import pytest
from petsc4py import PETSc

from fenics_contact import SolverError
from fenics_contact.bound_qp import (
    PREFIX,
    SOLVERS,
    TAO_SOLVERS,
    BoundQP,
    BoundQPOptions,
)

#: Back ends that reach round-off on small well-conditioned problems; the others stop earlier or
#: fail, and must then say so.
SURE = ("tron", "bnls", "bntr", "vinewtonrsls")


def matrix(values: np.ndarray) -> PETSc.Mat:
    size = len(values)
    result = PETSc.Mat().createAIJ((size, size), nnz=size, comm=PETSc.COMM_SELF)
    for row in range(size):
        result.setValues([row], list(range(size)), values[row])
    result.assemble()
    return result


def random_problem(size: int, seed: int = 1) -> tuple[np.ndarray, ...]:
    """A symmetric positive definite A, b, lower and upper."""
    random = np.random.default_rng(seed)
    root = random.standard_normal((size, size))
    a = root @ root.T + size * np.eye(size)
    b = random.standard_normal(size) * size
    return a, b, np.full(size, -0.3), np.full(size, 0.4)


def residual(a, b, lower, upper, x) -> float:
    """The residual that `bound_qp` states, in units in which diag A and max |b| are one."""
    unit = 1.0 / np.sqrt(np.diag(a))
    size = np.abs(b * unit).max() or 1.0
    scaled, gradient = x / (unit * size), (a @ x - b) * unit / size
    low, high = lower / (unit * size), upper / (unit * size)
    return float(np.abs(np.minimum(scaled - low, np.maximum(scaled - high, gradient))).max())


@pytest.mark.parametrize("solver", SURE)
def test_diagonal_problem(solver):
    a, b = np.diag([1.0, 2.0, 4.0, 8.0]), np.array([3.0, -1.0, 1.0, -80.0])
    lower, upper = np.array([0.0, -1.0, 0.0, -2.0]), np.array([1.0, 1.0, 1.0, 2.0])
    answer = BoundQP(matrix(a)).solve(b, lower, upper, options=BoundQPOptions(solver))
    assert answer.x == pytest.approx([1.0, -0.5, 0.25, -2.0], abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("solver", SURE)
def test_random_problem(solver, seed):
    a, b, lower, upper = random_problem(12, seed)
    answer = BoundQP(matrix(a)).solve(b, lower, upper, options=BoundQPOptions(solver))
    assert residual(a, b, lower, upper, answer.x) <= 1e-10
    assert answer.residual == pytest.approx(residual(a, b, lower, upper, answer.x), abs=1e-13)
    assert np.any(answer.x == lower) or np.any(answer.x == upper)


@pytest.mark.parametrize("solver", SOLVERS)
def test_no_back_end_is_believed(solver):
    """Either the residual is as small as asked for, or there is an error that says how large."""
    a, b, lower, upper = random_problem(30, 7)
    program, options = BoundQP(matrix(a)), BoundQPOptions(solver, 1e-9)
    attempt = program.attempt(b, lower, upper, options=options)
    assert attempt.residual == pytest.approx(residual(a, b, lower, upper, attempt.x), rel=1e-6)
    if attempt.residual <= 1e-9:
        assert program.solve(b, lower, upper, options=options).residual <= 1e-9
    else:
        with pytest.raises(SolverError, match=f"{solver} stopped for reason .* residual"):
            program.solve(b, lower, upper, options=options)


@pytest.mark.parametrize("solver", ["bnls", "tron"])
def test_back_end_that_stops_early_is_an_error(solver):
    a, b, lower, upper = random_problem(40, 3)
    options = BoundQPOptions(solver, 1e-14, max_iterations=1)
    with pytest.raises(SolverError, match=rf"{solver} stopped for reason -?\d+ after \d+ iter"):
        BoundQP(matrix(a)).solve(b, lower, upper, options=options)


def test_unknown_back_end():
    a, b, lower, upper = random_problem(3)
    with pytest.raises(SolverError, match="unknown solver 'simplex'; known: tron"):
        BoundQP(matrix(a)).solve(b, lower, upper, options=BoundQPOptions("simplex"))


def test_diagonal_must_be_positive():
    with pytest.raises(SolverError, match="diagonal is not positive"):
        BoundQP(matrix(np.diag([1.0, 0.0])))


@pytest.mark.parametrize("solver", SURE)
def test_free_variables_and_a_fixed_one(solver):
    a, b, _, _ = random_problem(6)
    lower = np.array([-np.inf] * 5 + [0.25])
    upper = np.array([np.inf] * 5 + [0.25])
    answer = BoundQP(matrix(a)).solve(b, lower, upper, options=BoundQPOptions(solver))
    assert answer.x[5] == pytest.approx(0.25, abs=1e-14)
    free = np.linalg.solve(a[:5, :5], b[:5] - 0.25 * a[:5, 5])
    assert answer.x[:5] == pytest.approx(free, rel=1e-7)


@pytest.mark.parametrize("solver", ["tron", "gpcg"])
def test_semi_definite_operator(solver):
    """x + y is all that matters; any pair that minimises will do."""
    a, b = np.array([[1.0, 1.0], [1.0, 1.0]]), np.array([1.0, 1.0])
    bounds = np.zeros(2), np.full(2, 0.7)
    answer = BoundQP(matrix(a)).solve(b, *bounds, options=BoundQPOptions(solver))
    assert answer.x.sum() == pytest.approx(1.0, abs=1e-9)


def test_back_end_that_breaks_down_is_an_error():
    """Gaussian elimination meets a zero pivot."""
    a, b = np.array([[1.0, 1.0], [1.0, 1.0]]), np.array([1.0, 1.0])
    with pytest.raises(SolverError, match=r"bnls stopped for reason -\d+"):
        BoundQP(matrix(a)).solve(b, np.zeros(2), np.ones(2), options=BoundQPOptions("bnls"))


def test_obstacle():
    """A string pulled down onto the floor: 1/2 |u'|^2 + 16 u, u >= -1/2, flat in the middle."""
    count = 199
    h = 1.0 / (count + 1)
    a = (np.diag(np.full(count, 2.0)) - np.eye(count, k=1) - np.eye(count, k=-1)) / h
    answer = BoundQP(matrix(a)).solve(
        np.full(count, -16.0 * h), np.full(count, -0.5), np.full(count, np.inf)
    )
    x = np.linspace(h, 1.0 - h, count)
    edge = 0.25  # 8 edge^2 = 1/2
    nearest = np.minimum(x, 1.0 - x)
    exact = np.where(nearest < edge, 8.0 * nearest**2 - 16.0 * edge * nearest, -0.5)
    assert answer.x == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize(("stiffer", "heavier"), [(1e9, 1e-3), (1e-9, 1e6)])
def test_units_do_not_matter(stiffer, heavier):
    a, b, lower, upper = random_problem(15)
    plain = BoundQP(matrix(a)).solve(b, lower, upper)
    ratio = heavier / stiffer
    other = BoundQP(matrix(stiffer * a)).solve(heavier * b, ratio * lower, ratio * upper)
    assert other.x == pytest.approx(ratio * plain.x, rel=1e-9)
    assert other.iterations == plain.iterations


def test_start_outside_the_bounds_is_moved_inside():
    a, b, lower, upper = random_problem(8)
    program = BoundQP(matrix(a))
    far = program.solve(b, lower, upper, start=np.full(8, 1e3))
    assert far.x == pytest.approx(program.solve(b, lower, upper).x, abs=1e-10)


class Multiplies:
    """An operator that only multiplies, and knows its diagonal."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def mult(self, _matrix, x, y):
        y.array[:] = self.values @ x.array_r

    def getDiagonal(self, _matrix, y):
        y.array[:] = np.diag(self.values)


@pytest.mark.parametrize("solver", ["tron", "bnls", "blmvm"])
def test_operator_without_a_matrix(solver):
    assert solver in TAO_SOLVERS
    a, b, lower, upper = random_problem(10)
    shell = PETSc.Mat().createPython((10, 10), Multiplies(a), comm=PETSc.COMM_SELF)
    shell.setUp()
    options = BoundQPOptions(solver, 1e-6)
    answer = BoundQP(shell).solve(b, lower, upper, options=options)
    assert residual(a, b, lower, upper, answer.x) <= 1e-6


def test_petsc_options_are_left_as_they_were():
    before = PETSc.Options().getAll()
    a, b, lower, upper = random_problem(5)
    for solver in ("bnls", "vinewtonrsls"):
        BoundQP(matrix(a)).solve(b, lower, upper, options=BoundQPOptions(solver))
    assert PETSc.Options().getAll() == before
    assert not any(name.startswith(PREFIX) for name in before)
