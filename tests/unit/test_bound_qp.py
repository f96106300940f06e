"""Bound-constrained programs: what every back end can do, and that none is believed."""

from __future__ import annotations

import re

import numpy as np
import pytest
from petsc4py import PETSc

from fenics_contact import SolverError
from fenics_contact.solvers.bound_qp import (
    PREFIX,
    SOLVERS,
    BoundQP,
    BoundQPOptions,
)

#: Back ends that reach round-off on small well-conditioned problems; the others stop earlier or
#: fail, and must then say so.
SURE = ("tron", "bnls", "bntr", "vinewtonrsls")

#: What back ends must reach on the problems of `PROBLEMS`. One that is not here may fail.
REACHED = {
    **dict.fromkeys((*SURE, "gpcg", "bqpip"), 1e-10),
    **dict.fromkeys(("bqnls", "blmvm"), 1e-6),
}

#: Problems that are too much for some back ends, which then have to say so.
TOO_MUCH = {
    "free variables and a fixed one": ("gpcg",),
    "singular": ("bnls", "bntr", "vinewtonrsls"),
    "singular, free variables": ("bntr", "gpcg", "bqpip"),
}

#: Back ends that a start far outside the bounds may throw off.
THROWN_OFF = ("bqpip",)

#: Back ends that do without an assembled matrix.
MATRIX_FREE = ("tron", "bnls", "bntr", "bqnls", "blmvm", "gpcg", "vinewtonrsls")

INF = np.inf


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


def obstacle(count: int) -> tuple[np.ndarray, ...]:
    """A string pulled down onto the floor: 1/2 |u'|^2 + 16 u, u >= -1/2."""
    h = 1.0 / (count + 1)
    a = (np.diag(np.full(count, 2.0)) - np.eye(count, k=1) - np.eye(count, k=-1)) / h
    return a, np.full(count, -16.0 * h), np.full(count, -0.5), np.full(count, INF)


def sagging(count: int) -> np.ndarray:
    """The string: parabolas that meet the floor at a quarter of the span."""
    x = np.arange(1, count + 1) / (count + 1)
    nearest, edge = np.minimum(x, 1.0 - x), 0.25  # 8 edge^2 = 1/2
    return np.where(nearest < edge, 8.0 * nearest**2 - 16.0 * edge * nearest, -0.5)


def singular(bound: float) -> tuple[np.ndarray, ...]:
    """Eight unknowns, an operator of rank four, b in its range."""
    root = np.random.default_rng(5).standard_normal((8, 4))
    return root @ root.T, 3.0 * root.sum(axis=1), np.full(8, -bound), np.full(8, bound)


def box(problem: tuple[np.ndarray, ...], lower, upper) -> tuple[np.ndarray, ...]:
    """A problem with other bounds."""
    size = len(problem[1])
    return *problem[:2], np.broadcast_to(lower, size) * 1.0, np.broadcast_to(upper, size) * 1.0


SIX = random_problem(6)
DIAGONAL = (
    np.diag([1.0, 2.0, 4.0, 8.0]),
    np.array([3.0, -1.0, 1.0, -80.0]),
    np.array([0.0, -1.0, 0.0, -2.0]),
    np.array([1.0, 1.0, 1.0, 2.0]),
)
PROBLEMS = {
    "diagonal": DIAGONAL,
    "random": random_problem(12),
    "larger": random_problem(30, 7),
    "obstacle": obstacle(19),
    "free": box(SIX, -INF, INF),
    "bounded on one side": box(SIX, [-INF, -INF, -INF, -0.3, -0.3, -0.3], INF),
    "wide bounds": box(SIX, -10.0, 10.0),
    "free variables and a fixed one": box(SIX, [-INF] * 5 + [0.25], [INF] * 5 + [0.25]),
    "fixed": box(SIX, 0.25, 0.25),
    "no force": box((SIX[0], np.zeros(6)), -1.0, 1.0),
    "singular": (np.ones((2, 2)), np.ones(2), np.zeros(2), np.full(2, 0.7)),
    "singular, bounded": singular(0.35),
    "singular, free variables": singular(INF),
}

#: What is known of the solutions.
KNOWN = {
    "diagonal": np.clip(DIAGONAL[1] / np.diag(DIAGONAL[0]), *DIAGONAL[2:]),
    "obstacle": sagging(19),
    "free": np.linalg.solve(*SIX[:2]),
    "wide bounds": np.linalg.solve(*SIX[:2]),
    "fixed": np.full(6, 0.25),
    "no force": np.zeros(6),
}


@pytest.mark.parametrize("start", [None, 1e3, -1e3])
@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("solver", SOLVERS)
def test_problem_is_solved_or_there_is_an_error(solver, name, start):
    """From inside and outside the bounds; `residual` here knows nothing of the back end."""
    a, b, lower, upper = PROBLEMS[name]
    tolerance = REACHED.get(solver, 1e-10)
    sure = solver in REACHED and solver not in TOO_MUCH.get(name, ())
    sure = sure and (start is None or solver not in THROWN_OFF)
    program, options = BoundQP(matrix(a)), BoundQPOptions(solver, tolerance)
    first = None if start is None else np.full(len(b), start)
    try:
        answer = program.solve(b, lower, upper, first, options)
    except SolverError as error:
        assert not sure, error
        words = rf"{solver} stopped for reason -?\d+ after \d+ iterations at a residual of .*e"
        assert re.search(words, str(error))
        return
    assert residual(a, b, lower, upper, answer.x) <= 2.0 * tolerance
    assert np.all(answer.x >= lower - 1e-9) and np.all(answer.x <= upper + 1e-9)
    if name in KNOWN:
        assert answer.x == pytest.approx(KNOWN[name], abs=1e3 * tolerance)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", [name for name in PROBLEMS if name != "singular"])
def test_operator_is_left_as_it_was(solver, name):
    """Or the programs after this one, and the residuals, would be those of another operator."""
    a, b, lower, upper = PROBLEMS[name]
    program = BoundQP(matrix(a))
    program.attempt(b, lower, upper, options=BoundQPOptions(solver))
    after = program.attempt(b, lower, upper, options=BoundQPOptions("tron"))
    assert residual(a, b, lower, upper, after.x) <= 1e-10


def test_operator_is_left_as_it_was_by_a_back_end_that_breaks_down():
    """Newton's method with a zero pivot shifts the diagonal."""
    a, b, lower, upper = PROBLEMS["singular"]
    program = BoundQP(matrix(a))
    broken = program.attempt(b, lower, upper, options=BoundQPOptions("bnls"))
    assert broken.reason < 0
    assert broken.residual == pytest.approx(residual(a, b, lower, upper, broken.x))
    after = program.attempt(b, lower, upper, options=BoundQPOptions("tron"))
    assert residual(a, b, lower, upper, after.x) <= 1e-10


@pytest.mark.parametrize("solver", SOLVERS)
def test_problem_without_a_solution_is_an_error(solver):
    """Down for ever: x - y costs nothing and is pulled."""
    free = np.full(2, INF)
    with pytest.raises(SolverError, match=f"{solver} stopped for reason"):
        BoundQP(matrix(np.ones((2, 2)))).solve(
            np.array([1.0, 0.0]), -free, free, options=BoundQPOptions(solver)
        )


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


@pytest.mark.parametrize("solver", SOLVERS)
def test_back_end_that_stops_early_is_an_error(solver):
    """With its name, its reason and the residual."""
    a, b, lower, upper = obstacle(59)
    options = BoundQPOptions(solver, 1e-12, max_iterations=1)
    with pytest.raises(SolverError) as error:
        BoundQP(matrix(a)).solve(b, lower, upper, options=options)
    words = rf"{solver} stopped for reason (-?\d+) after \d+ iter.* residual of (.*), asked 1.0e-12"
    found = re.search(words, str(error.value))
    attempt = BoundQP(matrix(a)).attempt(b, lower, upper, options=options)
    assert found is not None
    assert int(found[1]) == attempt.reason
    exact = residual(a, b, lower, upper, attempt.x)
    assert float(found[2]) == pytest.approx(exact, rel=0.06)
    assert exact > 0.1


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


@pytest.mark.parametrize("solver", SURE)
def test_fine_obstacle(solver):
    answer = BoundQP(matrix(obstacle(199)[0])).solve(
        *obstacle(199)[1:], options=BoundQPOptions(solver)
    )
    assert answer.x == pytest.approx(sagging(199), abs=1e-9)


@pytest.mark.parametrize(("stiffer", "heavier"), [(1e9, 1e-3), (1e-9, 1e6)])
@pytest.mark.parametrize("solver", REACHED)
def test_units_do_not_matter(solver, stiffer, heavier):
    a, b, lower, upper = random_problem(15)
    options = BoundQPOptions(solver, REACHED[solver])
    plain = BoundQP(matrix(a)).solve(b, lower, upper, options=options)
    ratio = heavier / stiffer
    other = BoundQP(matrix(stiffer * a)).solve(
        heavier * b, ratio * lower, ratio * upper, options=options
    )
    assert other.x / ratio == pytest.approx(plain.x, rel=1e-9, abs=10.0 * options.tolerance)
    if solver in SURE:
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


@pytest.mark.parametrize("solver", SOLVERS)
def test_operator_without_a_matrix(solver):
    a, b, lower, upper = random_problem(10)
    shell = PETSc.Mat().createPython((10, 10), Multiplies(a), comm=PETSc.COMM_SELF)
    shell.setUp()
    program, options = BoundQP(shell), BoundQPOptions(solver, REACHED.get(solver, 1e-10))
    assert not program.assembled
    if solver in MATRIX_FREE:
        answer = program.solve(b, lower, upper, options=options)
        assert residual(a, b, lower, upper, answer.x) <= 2.0 * options.tolerance
    else:
        with pytest.raises(SolverError, match=rf"{solver} stopped for reason -\d+ .* residual"):
            program.solve(b, lower, upper, options=options)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", ["random", "singular"])
def test_petsc_options_are_left_as_they_were(solver, name):
    before = PETSc.Options().getAll()
    a, b, lower, upper = PROBLEMS[name]
    BoundQP(matrix(a)).attempt(b, lower, upper, options=BoundQPOptions(solver))
    assert PETSc.Options().getAll() == before
    assert not any(name.startswith(PREFIX) for name in before)
