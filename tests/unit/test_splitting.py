"""States with given friction by joint forces, against the interior point method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import SolverError
from fenics_contact.solvers.interior_point import WorkControl
from fenics_contact.meshing import running_bond, wall
from fenics_contact.solvers.splitting import ACCEPTABLE, JointForces
from tests.helpers import Loaded, on_ground, tresca, whole

RATIO = 30.0

#: Which steps are taken: sweeps, joint steps.
WAYS = [(True, True), (True, False), (False, True)]


@pytest.fixture(scope="module")
def block() -> Loaded:
    """A block that slides before it tips."""
    return Loaded.of(on_ground(wall([[1]], (0.4, 0.4), 2), tresca(2e3)))


@pytest.fixture(scope="module")
def bond() -> Loaded:
    """A small wall in running bond on rigid ground."""
    return Loaded.of(on_ground(running_bond(2, 3, elements=1), tresca(1e3)))


def joint_forces(loaded: Loaded, sweeps: bool = True, joint_steps: bool = True) -> JointForces:
    structure = loaded.structure
    return JointForces(
        structure.problem, structure.operators, structure.springs, sweeps, joint_steps
    )


@pytest.mark.parametrize(("sweeps", "joint_steps"), WAYS)
def test_sliding_block(block, sweeps, joint_steps):
    problem = block.structure.problem
    start, scales = block.start(RATIO)
    method = joint_forces(block, sweeps, joint_steps)
    point = method.solve(problem.strength, start.work, start, scales)
    # Strength times length over weight.
    weight = 0.4 * 0.4 * 2000.0 * 9.81
    assert point.state.load_factor == pytest.approx(2e3 * 0.4 / weight, rel=1e-7)
    assert max(point.residuals.values()) <= ACCEPTABLE
    assert (method.history.sweeps > 0) == sweeps
    assert method.history.joint_steps == 0 or joint_steps
    assert method.history.steps > 0
    method.destroy()


@pytest.mark.parametrize(("sweeps", "joint_steps"), [(True, True), (False, True)])
def test_wall_like_the_interior_point_method(bond, sweeps, joint_steps):
    structure = bond.structure
    start, scales = bond.start(RATIO)
    control = WorkControl(structure.problem, structure.springs)
    exact = control.solve(structure.problem.strength, start.work, start, scales).state
    method = joint_forces(bond, sweeps, joint_steps)
    found = method.solve(structure.problem.strength, start.work, start, scales).state
    assert found.load_factor == pytest.approx(exact.load_factor, rel=1e-7)
    size = np.abs(whole(exact.displacement)).max()
    assert whole(found.displacement) == pytest.approx(whole(exact.displacement), abs=1e-5 * size)
    assert found.work == start.work
    method.destroy()


def test_load_factor_can_be_prescribed(bond):
    structure = bond.structure
    start, scales = bond.start(1.0)
    factor = 0.3 * structure.problem.max(structure.problem.strength) / scales.force
    control = WorkControl(structure.problem, structure.springs)
    exact = control.solve(structure.problem.strength, 0.0, start, scales, load_factor=factor).state
    method = joint_forces(bond)
    found = method.solve(structure.problem.strength, 0.0, start, scales, load_factor=factor).state
    assert found.load_factor == exact.load_factor == factor
    assert found.work == pytest.approx(exact.work, rel=1e-5)
    method.destroy()


def test_slip_is_measured_from_its_origin(bond):
    """Forces and load factor depend on the slip since the origin alone."""
    structure = bond.structure
    start, scales = bond.start(RATIO)
    moved = replace(structure.problem, slip_origin=np.full_like(structure.problem.strength, 1e-9))
    control = WorkControl(moved, structure.springs)
    exact = control.solve(moved.strength, start.work, start, scales).state
    method = JointForces(moved, structure.operators, structure.springs)
    found = method.solve(moved.strength, start.work, start, scales).state
    assert found.load_factor == pytest.approx(exact.load_factor, rel=1e-7)
    method.destroy()


def test_warm_start_takes_few_steps(bond):
    structure = bond.structure
    start, scales = bond.start(RATIO)
    method = joint_forces(bond)
    state = method.solve(structure.problem.strength, start.work, start, scales).state
    before = method.history.steps
    again = method.solve(structure.problem.strength, start.work, state, scales, centring=1e-8)
    assert again.state.load_factor == pytest.approx(state.load_factor, rel=1e-8)
    assert method.history.steps - before <= 5
    method.destroy()


def test_bound_must_be_given(bond):
    start, scales = bond.start(RATIO)
    with pytest.raises(SolverError, match="needs a given bound"):
        joint_forces(bond).solve(None, start.work, start, scales)


def test_contraction_is_the_mean_of_the_sweeps(bond):
    history = joint_forces(bond).history
    assert history.contraction is None
    history.contractions += [0.25, 1.0]
    assert history.contraction == pytest.approx(0.5)
