"""The Delassus operator against dense algebra."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import running_bond
from fenics_contact.solvers import joint_forces
from fenics_contact.solvers.joint_forces import DelassusOperator, JointPoints
from fenics_contact.solvers.problem import ContactProblem
from tests.helpers import coulomb, dense, on_ground

RHO, ORIGIN = 1e6, 1e-7


@pytest.fixture(scope="module")
def bond() -> Iterator[tuple[ContactProblem, DelassusOperator]]:
    """A small wall in running bond, slip measured from a constant."""
    scene = on_ground(running_bond(2, 2, elements=1), coulomb(0.5))
    with Discretization(scene) as wall:
        rows = wall.operators
        points = JointPoints(rows.sides, rows.dofs, rows.normal_rows, rows.tangential_rows)
        origin = np.full(len(rows.points), ORIGIN)
        problem = wall.problem.with_law(slip_origin=origin)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(joint_forces, "FORCE_HOLD", 0.0)
            with DelassusOperator(problem, points, RHO) as operator:
                yield problem, operator


def whole(problem: ContactProblem, values: np.ndarray) -> np.ndarray:
    """All ranks' parts of an array."""
    return np.concatenate(problem.comm.allgather(values))


def exact(problem: ContactProblem) -> tuple[np.ndarray, np.ndarray]:
    """S = (B_N, B_T, f_L) in the operator's order of rows, and K_rho, dense."""
    stiffness = dense(problem.stiffness.matrix)
    normal, tangential = (dense(map.matrix) for map in (problem.normal, problem.tangential))
    rows, start = [], 0
    for count in problem.comm.allgather(problem.points):
        rows += [normal[start : start + count], tangential[start : start + count]]
        start += count
    rows.append(whole(problem, problem.live)[None, :])
    return np.concatenate(rows), stiffness + RHO * np.eye(len(stiffness))


def some(problem: ContactProblem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacements near by, pressure and shear."""
    random, points = np.random.default_rng(problem.comm.rank), problem.points
    near = 1e-6 * random.standard_normal(len(problem.dead))
    return near, random.uniform(0.0, 1e3, points), random.uniform(-1e3, 1e3, points)


@pytest.mark.mpi
def test_matrix_is_the_flexibility(bond):
    problem, operator = bond
    s, k = exact(problem)
    flexibility, found = s @ np.linalg.solve(k, s.T), dense(operator.matrix.matrix)
    unit = 1.0 / np.sqrt(np.diag(flexibility))
    assert np.abs((found - flexibility) * np.outer(unit, unit)).max() <= 1e-12
    assert np.linalg.eigvalsh(found * np.outer(unit, unit)).min() >= -1e-10


@pytest.mark.mpi
def test_gradient_is_what_joints_see(bond):
    """A x - b = (B u - w_0, f_L.u - T) with u the displacements that belong to x."""
    problem, operator = bond
    near, pressure, shear = some(problem)
    x = operator.join(pressure, shear, 0.7)
    right, free = operator.right(near, np.zeros_like(x), 3.0)
    u = operator.displacement(x, free)
    work = problem.dot(problem.live, u) - 3.0
    seen = operator.join(problem.normal @ u, problem.tangential @ u - ORIGIN, work)
    assert operator.matrix @ x - right == pytest.approx(seen, rel=1e-8, abs=1e-12)


@pytest.mark.mpi
def test_displacements_are_in_equilibrium(bond):
    problem, operator = bond
    near, pressure, shear = some(problem)
    x = operator.join(pressure, shear, -0.4)
    _, free = operator.right(near, np.zeros_like(x), 1.0)
    u = operator.displacement(x, free)
    loads = problem.dead - 0.4 * problem.live + problem.joint_forces(pressure, shear)
    rest = problem.stiffness @ u + RHO * (u - near) - loads
    assert problem.max(np.abs(rest)) <= 1e-9 * problem.max(np.abs(loads))


@pytest.mark.mpi
def test_parts_of_the_unknowns(bond):
    problem, operator = bond
    _, pressure, shear = some(problem)
    parts = operator.split(operator.join(pressure, shear, 0.25))
    assert np.array_equal(parts[0], pressure) and np.array_equal(parts[1], shear)
    assert parts[2] == 0.25
    points = problem.sum(np.ones(problem.points))
    for kinds, count in (((0, 1), 2 * points + 1), ((1,), points + 1)):
        assert problem.sum(np.ones(len(operator.program(kinds)[0]))) == count
