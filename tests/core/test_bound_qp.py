"""Bound-constrained programs: known minimisers, by the solver of its own and those of PETSc."""

from __future__ import annotations

import numpy as np
import pytest
from petsc4py import PETSc

from fenics_contact import SolverError
from fenics_contact.solvers.bound_qp import BoundQP
from tests.core.problems import qp_options

#: The solver that is used, and one of TAO and of SNES that options choose: they reach round-off.
SOLVERS = {"faces": {}, "tron": {"tao_type": "tron"}, "vi": {"snes_type": "vinewtonrsls"}}

INF = np.inf
Program = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def solved(program: Program, solver="faces", tolerance=1e-10, start=0.0) -> np.ndarray:
    a, b, lower, upper = program
    matrix = PETSc.Mat().createDense(a.shape, array=a.copy(), comm=PETSc.COMM_SELF)
    matrix.convert(PETSc.Mat.Type.AIJ)
    with qp_options(**SOLVERS[solver]), BoundQP(matrix) as qp:
        return qp.solve(b, lower, upper, np.full(len(b), start), tolerance)


def residual(program: Program, x: np.ndarray) -> float:
    """The residual that `bound_qp` states, in units in which diag A and max |b| are one."""
    a, b, lower, upper = program
    unit = 1.0 / np.sqrt(np.diag(a))
    size = np.abs(b * unit).max() or 1.0
    scaled, gradient = x / (unit * size), (a @ x - b) * unit / size
    low, high = lower / (unit * size), upper / (unit * size)
    return float(np.abs(np.minimum(scaled - low, np.maximum(scaled - high, gradient))).max())


def random_program(size: int, seed: int = 1, condition: float = 10.0) -> Program:
    """A with eigenvalues between 1 and `condition`; bounds that many unknowns meet."""
    random = np.random.default_rng(seed)
    basis = np.linalg.qr(random.standard_normal((size, size)))[0]
    a = basis @ np.diag(np.geomspace(1.0, condition, size)) @ basis.T
    x = random.standard_normal(size)
    return a, a @ x, np.full(size, -0.5), np.full(size, 0.5)


def obstacle(count: int) -> Program:
    """A string pulled down onto the floor: 1/2 |u'|^2 + 16 u, u >= -1/2."""
    h = 1.0 / (count + 1)
    a = (np.diag(np.full(count, 2.0)) - np.eye(count, k=1) - np.eye(count, k=-1)) / h
    return a, np.full(count, -16.0 * h), np.full(count, -0.5), np.full(count, INF)


def sagging(count: int) -> np.ndarray:
    """The string: parabolas that meet the floor at a quarter of the span."""
    x = np.linspace(0.0, 1.0, count + 2)[1:-1]
    x = np.minimum(x, 1.0 - x)
    return np.where(x < 0.25, 8.0 * x**2 - 4.0 * x, -0.5)


DIAGONAL = (
    np.diag([1.0, 2.0, 4.0, 8.0]),
    np.array([3.0, -1.0, 1.0, -80.0]),
    np.array([0.0, -1.0, 0.0, -2.0]),
    np.array([1.0, 1.0, 1.0, 2.0]),
)
SIX = random_program(6)
FREE = (*SIX[:2], np.full(6, -INF), np.full(6, INF))
ONE_FIXED = (*SIX[:2], np.array([-INF] * 5 + [0.25]), np.array([INF] * 5 + [0.25]))


@pytest.mark.parametrize(
    ("solver", "start"),
    [("faces", 0.0), ("faces", 1e3), ("faces", -1e3), ("tron", 0.0), ("vi", 1e3)],
)
@pytest.mark.parametrize(
    ("program", "x"),
    [
        (DIAGONAL, [1.0, -0.5, 0.25, -2.0]),
        (obstacle(59), sagging(59)),
        (FREE, np.linalg.solve(*SIX[:2])),
        ((*SIX[:2], np.full(6, 0.25), np.full(6, 0.25)), np.full(6, 0.25)),
        ((SIX[0], np.zeros(6), *SIX[2:]), np.zeros(6)),
    ],
    ids=["diagonal", "obstacle", "free", "fixed", "no force"],
)
def test_known_minimiser(solver, start, program, x):
    """From inside and outside the bounds."""
    found = solved(program, solver, start=start)
    assert residual(program, found) <= 1e-9
    assert found == pytest.approx(x, abs=1e-8)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("program", [random_program(30, 7), obstacle(19), ONE_FIXED])
def test_conditions_of_a_minimum_hold(solver, program):
    x = solved(program, solver, 1e-9)
    assert np.all(x >= program[2] - 1e-12) and np.all(x <= program[3] + 1e-12)
    assert residual(program, x) <= 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_faces_solve_badly_conditioned_programs(seed):
    program = random_program(60, seed, condition=1e10)
    assert residual(program, solved(program, tolerance=1e-9)) <= 1e-9


def test_a_diagonal_that_is_not_positive_is_refused():
    with pytest.raises(SolverError, match="diagonal is not positive"):
        solved((np.diag([1.0, 0.0]), *[np.zeros(2)] * 3))
