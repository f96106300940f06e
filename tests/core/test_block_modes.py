"""Blocks that only move, stretch and bend: the reduced structure, and states of both."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.block_modes import BlockModes, modes
from fenics_contact.solvers.effort import Tally
from fenics_contact.solvers.interior_point import Tolerances, solve_interior_point
from fenics_contact.solvers.joint_stiffness import GENERAL
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import State
from tests.bank import coulomb, outlined
from tests.core.problems import (
    THREE_BLOCKS,
    Array,
    conditions,
    dense,
    load_case,
    on_an_inclined_roller,
    solved,
    whole,
)


@pytest.fixture(scope="module", params=["ground", "roller"])
def case(request) -> Iterator[LoadCase]:
    on_ground = request.param == "ground"
    scene = THREE_BLOCKS.scene(2) if on_ground else on_an_inclined_roller(2, "fixed")
    with load_case(scene) as made:
        yield made


def basis(made: BlockModes) -> Array:
    """P: the displacements for every unknown, without joint forces."""
    problem, columns = made.full, []
    none = np.zeros(made.reduced.points)
    for a in np.eye(made.reduced.size):
        u = made.prolonged(State(a, a, 0.0, none, none, 0.0)).displacement
        columns.append(whole(problem, u))
    return np.array(columns).T


def node_bodies(case: LoadCase) -> Array:
    body = case.discretization.elasticity.node_body
    return whole(case.problem, body[: len(case.problem.dead) // 2])


def indentation(case: LoadCase) -> Array:
    """C_ii of all displacements, m per N/m."""
    nodes = np.bincount(node_bodies(case))[np.repeat(node_bodies(case), 2)]
    stiffness = np.diag(dense(case.problem.stiffness))
    return SEARCH.indentation * np.log(nodes / 3.0) / stiffness


def test_modes_are_rigid_motions_strains_and_bendings():
    arm, step = np.random.default_rng(1).normal(size=(5, 2)), 0.1
    (x, y), none, one = arm.T, np.zeros(5), np.ones(5)
    # Central differences of quadratics are exact.
    slopes = [(modes(arm + d) - modes(arm - d)) / (2.0 * step) for d in step * np.eye(2)]
    gradient = np.stack(slopes, axis=2)  # (points, component, direction, mode)
    strain = 0.5 * (gradient + np.swapaxes(gradient, 1, 2))
    for place, columns in {
        (0, 0): [none, none, none, one, none, none, y, none],
        (1, 1): [none, none, none, none, one, none, none, x],
        (0, 1): [none, none, none, none, none, one, none, none],
    }.items():
        assert strain[:, *place] == pytest.approx(np.transpose(columns), abs=1e-12)
    assert modes(arm)[:, :, 2] == pytest.approx(np.column_stack([-y, x]))


@pytest.mark.mpi
def test_reduced_structure_is_that_of_the_formula(case):
    made, problem = case.discretization.block_modes, case.problem
    columns, reduced, stiffness = basis(made), made.reduced, dense(made.reduced.stiffness)
    expected = columns.T @ dense(problem.stiffness) @ columns
    unit, is_mode = np.abs(expected).max(), np.sum(columns**2, axis=0) > 0.5
    own = np.ix_(is_mode, is_mode)
    assert stiffness[own] == pytest.approx(expected[own], abs=1e-12 * unit)
    assert np.all(np.diag(stiffness)[~is_mode] > 0.0)
    order = np.argsort(whole(problem, case.discretization.operators.points))
    for name in ("dead", "live"):
        full, less = whole(problem, getattr(problem, name)), getattr(reduced, name)
        assert less == pytest.approx(columns.T @ full, abs=1e-12 * np.abs(full).max())
    for name, soft in zip(("normal", "tangential"), reduced.compliance, strict=True):
        full, less = dense(getattr(problem, name))[order], dense(getattr(reduced, name))
        assert less == pytest.approx(full @ columns, abs=1e-12)
        assert soft == pytest.approx(full**2 @ indentation(case), rel=1e-12)
    rigid = dense(reduced.rigid)
    assert rigid == pytest.approx(columns.T @ dense(problem.rigid), abs=1e-12)
    assert stiffness @ rigid == pytest.approx(np.zeros_like(rigid), abs=1e-9 * unit)


@pytest.mark.parametrize("friction", [2.0, 3.0])
def test_structure_of_single_triangles_is_reproduced_exactly(friction):
    """Their modes are all that they have: the same state, to the last digits."""
    triangles = [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)], [(1, 0), (2, 0), (1, 1)]]
    with load_case(outlined(triangles, coulomb(friction), 4.0).scene(1)) as case:
        made, kkt, exact = case.discretization.block_modes, conditions(case), solved(case).state
        assert case.problem.size == 2 * 3 * 3
        assert np.all(made.reduced.compliance == 0.0)
        stiffness = made.stiffness(GENERAL, Tally())
        reduced = PerturbedKKT.coulomb(made.reduced, stiffness, kkt.scales, kkt.work)
        start = made.restricted(case.bonded_state(kkt.work))
        found = solve_interior_point(reduced, start, 1.0, Tolerances(load_factor=1e-9))
        state = made.prolonged(found.state)
    assert state.load_factor == pytest.approx(exact.load_factor, rel=1e-9)
    for name in ("displacement", "pressure", "shear"):
        one, other = getattr(state, name), getattr(exact, name)
        assert one == pytest.approx(other, abs=1e-7 * np.abs(other).max())
