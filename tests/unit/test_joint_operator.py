"""The flexibility of blocks as their joints see it, against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.solvers.delassus import JointOperator, Slots
from fenics_contact.discretization.joints import GROUND
from fenics_contact.meshing import running_bond
from tests.helpers import Loaded, coulomb, dense, on_ground, vector_like, whole


@pytest.fixture(scope="module")
def bond() -> Loaded:
    """A small wall in running bond on rigid ground."""
    return Loaded.of(on_ground(running_bond(2, 2, elements=1), coulomb(0.5)))


def everything(loaded: Loaded) -> tuple[JointOperator, np.ndarray, np.ndarray]:
    """The operator, S = (B_N, B_T, f_L) in its order of rows, and K_rho, dense."""
    problem = loaded.structure.problem
    rho = 1e-3 * loaded.structure.springs.mean_diagonal
    operator = JointOperator(problem, loaded.structure.operators, rho)
    stiffness = dense(problem.stiffness)
    comm = problem.comm
    rows = []
    normal, tangential = dense(problem.normal), dense(problem.tangential)
    start = 0
    for count in comm.allgather(operator.points):
        rows += [normal[start : start + count], tangential[start : start + count]]
        start += count
    rows.append(whole(problem.live)[None, :])
    return operator, np.concatenate(rows), stiffness + rho * np.eye(len(stiffness))


def test_matrix_is_the_flexibility(bond):
    operator, s, k = everything(bond)
    exact = s @ np.linalg.solve(k, s.T)
    found = dense(operator.matrix)
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert np.abs((found - exact) / scale).max() <= 1e-12
    assert np.abs(found - found.T).max() <= 1e-12 * np.abs(found).max()
    unit = 1.0 / np.sqrt(np.diag(found))
    assert np.linalg.eigvalsh(found * unit[:, None] * unit).min() >= -1e-10


def test_gradient_is_what_joints_see(bond):
    """A x - b = (B u - w_0, f_L.u - T) with u the displacements that belong to x."""
    operator, s, _ = everything(bond)
    problem, random = bond.structure.problem, np.random.default_rng(2)
    near = vector_like(problem.dead, 1e-6 * random.standard_normal(problem.dead.getSize()))
    problem.slip_origin[:] = 1e-7
    right, free = operator.right(near, 3.0)
    points = operator.points
    pressure, shear = random.uniform(0.0, 1e3, points), random.uniform(-1e3, 1e3, points)
    x = operator.join(pressure, shear, 0.7)
    u = operator.displacement(x, free)
    gradient = operator.matrix.createVecLeft()
    operator.matrix.mult(x, gradient)
    gradient.axpy(-1.0, right)
    seen = s @ whole(u)
    origin = operator.join(np.zeros(points), np.full(points, 1e-7), 3.0)
    problem.slip_origin[:] = 0.0
    assert whole(gradient) == pytest.approx(seen - whole(origin), rel=1e-8, abs=1e-12)


def test_displacements_are_in_equilibrium(bond):
    operator, s, k = everything(bond)
    problem, random = bond.structure.problem, np.random.default_rng(3)
    near = vector_like(problem.dead, 1e-6 * random.standard_normal(problem.dead.getSize()))
    _, free = operator.right(near, 1.0)
    points = operator.points
    x = operator.join(random.uniform(0.0, 1e3, points), random.uniform(-1e3, 1e3, points), -0.4)
    u = whole(operator.displacement(x, free))
    loads = whole(problem.dead) + operator.rho * whole(near) + s.T @ whole(x)
    assert k @ u == pytest.approx(loads, rel=1e-9, abs=1e-9 * np.abs(loads).max())


def test_join_and_split(bond):
    operator, _, _ = everything(bond)
    pressure, shear = np.arange(operator.points) + 1.0, -np.arange(operator.points) - 0.5
    parts = operator.split(operator.join(pressure, shear, 0.25))
    assert np.array_equal(parts[0], pressure)
    assert np.array_equal(parts[1], shear)
    assert parts[2] == 0.25


def test_blocks_of_unknowns(bond):
    operator, _, _ = everything(bond)
    points = len(bond.structure.joints.length)
    assert operator.block(True, True).getSize() == 2 * points + 1
    assert operator.block(True, False).getSize() == points + 1
    assert operator.block(False, True, load_factor=False).getSize() == points


def test_slots_number_the_points_of_every_body():
    body = np.array([[GROUND, 0], [0, 1], [1, 0], [GROUND, 1]], dtype=np.int32)
    slots = Slots.of(body)
    assert slots.table.tolist() == [[0, 1, 2], [1, 2, 3]]
    assert slots.slot.tolist() == [[-1, 0], [1, 0], [1, 2], [-1, 2]]


def test_slots_without_joints():
    slots = Slots.of(np.empty((0, 2), dtype=np.int32))
    assert slots.table.shape[1] == 0
