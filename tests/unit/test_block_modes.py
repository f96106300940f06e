"""Blocks that only move, stretch and bend: the reduced structure, and states of both."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Scene
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.solvers.block_modes import (
    MODES,
    BlockModes,
    BlockModesOptions,
    Blocks,
    modes,
)
from fenics_contact.solvers.interior_point import Tolerances, solve_interior_point
from fenics_contact.solvers.joint_stiffness import GENERAL, SYMMETRIC, Tally
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import State
from tests.bank import PUSH, STONE, block_recipe, coulomb, outlined
from tests.drawing import Drawing
from tests.unit.core import (
    THREE_BLOCKS,
    Array,
    conditions,
    dense,
    load_case,
    part,
    solved,
    whole,
)


def on_a_roller_and_held() -> Scene:
    """The three blocks turned by 30 degrees, on a roller and fixed at their left."""
    turn = np.array([[np.sqrt(3.0), -1.0], [1.0, np.sqrt(3.0)]]) / 2.0
    usual = THREE_BLOCKS.scene(2)
    drawn = Drawing.of(THREE_BLOCKS.draw(2, False)).moved(lambda x: x @ turn.T)
    mesh = type(usual.mesh).from_model(drawn.model(), usual.comm)
    supports = {"base": "roller", "left": "fixed"}
    return Scene(mesh, {"default": STONE}, PUSH, joints=usual.joints, supports=supports)


@pytest.fixture(scope="module", params=["ground", "roller"])
def case(request) -> Iterator[LoadCase]:
    scene = THREE_BLOCKS.scene(2) if request.param == "ground" else on_a_roller_and_held()
    with load_case(scene) as made:
        yield made


def state_of(problem, u: Array, pressure: Array, shear: Array) -> State:
    return State(u, problem.elastic_part(u), 0.5, pressure, shear, 7.0)


def basis(made: BlockModes) -> Array:
    """P: the displacements for every unknown, without joint forces."""
    problem = made.full
    none, columns = np.zeros_like(problem.friction), []
    for row in np.eye(made.reduced.size):
        a = part(problem, row, made.reduced.dead)
        u = made.prolonged(State(a, a, 0.0, none, none, 0.0)).displacement
        columns.append(whole(problem, u))
    return np.array(columns).T


def node_bodies(case: LoadCase) -> Array:
    elasticity, problem = case.discretization.elasticity, case.problem
    return whole(problem, elasticity.node_body[: len(problem.dead) // 2])


# ---- modes


def test_modes_are_rigid_motions_strains_and_bendings():
    arm = np.random.default_rng(1).normal(size=(5, 2))
    x, y = arm.T
    # Central differences of quadratics are exact.
    step = 0.1
    gradient = np.stack(
        [(modes(arm + d) - modes(arm - d)) / (2.0 * step) for d in step * np.eye(2)], axis=2
    )  # (points, component, direction, mode)
    strain = 0.5 * (gradient + np.swapaxes(gradient, 1, 2))
    none, one = np.zeros(5), np.ones(5)
    expected = {
        (0, 0): [none, none, none, one, none, none, y, none],
        (1, 1): [none, none, none, none, one, none, none, x],
        (0, 1): [none, none, none, none, none, one, none, none],
    }
    for (i, j), columns in expected.items():
        assert strain[:, i, j] == pytest.approx(np.transpose(columns), abs=1e-12)
    assert modes(arm)[:, :, 2] == pytest.approx(np.column_stack([-y, x]))


@pytest.mark.mpi
def test_columns_are_orthonormal_or_zero_and_of_one_block_each(case):
    columns, body = basis(case.discretization.block_modes), np.repeat(node_bodies(case), 2)
    product = columns.T @ columns
    is_mode = np.diag(product) > 0.5
    assert product == pytest.approx(np.diag(is_mode.astype(float)), abs=1e-12)
    assert is_mode.sum() >= len(is_mode) - MODES
    for block in range(len(is_mode) // MODES):
        own = columns[:, MODES * block : MODES * (block + 1)]
        assert len(set(body[np.any(own != 0.0, axis=1)])) <= 1


@pytest.mark.mpi
def test_linear_displacements_of_free_blocks_come_back(case):
    """Restricted and prolonged: they are among the modes."""
    discretization, problem = case.discretization, case.problem
    count = len(problem.dead) // 2
    body = discretization.elasticity.node_body[:count]
    free = ~np.isin(body, discretization.supports.body)
    position = discretization.elasticity.space.tabulate_dof_coordinates()[:count, :2]
    random = np.random.default_rng(2)
    slope, shift = random.normal(size=(2, 2)), random.normal(size=(case.block_count, 2))
    u = np.where(free[:, None], position @ slope + shift[body], 0.0).ravel()
    assert problem.max(np.abs(u)) > 0.1
    none, made = np.zeros_like(problem.friction), discretization.block_modes
    back = made.prolonged(made.restricted(state_of(problem, u, none, none)))
    assert back.displacement == pytest.approx(u, abs=1e-12 * problem.max(np.abs(u)))
    assert back.elastic == pytest.approx(problem.elastic_part(u), abs=1e-12)


def test_prolonged_states_have_the_indentation_of_their_joint_forces(case):
    """Moved by their modes, and by what blocks give next to joint forces."""
    made, problem = case.discretization.block_modes, case.problem
    amplitudes = np.random.default_rng(4).normal(size=made.reduced.size)
    pressure = np.arange(1.0, len(problem.friction) + 1.0)
    state = made.prolonged(state_of(made.reduced, amplitudes, pressure, -pressure))
    nodes, body = np.bincount(node_bodies(case)), np.repeat(node_bodies(case), 2)
    soft = BlockModesOptions().indentation * np.log(nodes[body] / 3.0)
    indented = soft / problem.stiffness.diagonal() * problem.joint_forces(pressure, -pressure)
    assert np.abs(indented).max() > 0.0
    moved = basis(made) @ amplitudes
    assert state.displacement == pytest.approx(moved + indented, abs=1e-12)
    assert state.elastic == pytest.approx(
        basis(made) @ made.reduced.elastic_part(amplitudes) + problem.elastic_part(indented),
        abs=1e-12,
    )
    assert np.array_equal(state.pressure, pressure) and np.array_equal(state.shear, -pressure)


# ---- the reduced structure


@pytest.mark.mpi
def test_reduced_structure_is_that_of_the_formula(case):
    made, problem = case.discretization.block_modes, case.problem
    columns, reduced = basis(made), made.reduced
    stiffness = columns.T @ dense(problem.stiffness) @ columns
    is_mode = np.diag(columns.T @ columns) > 0.5
    found, unit = dense(reduced.stiffness), np.abs(stiffness).max()
    own = np.ix_(is_mode, is_mode)
    assert found[own] == pytest.approx(stiffness[own], abs=1e-12 * unit)
    assert np.all(np.diag(found) > -1e-12 * unit) and np.all(np.diag(found)[~is_mode] > 0.0)
    for full, less in ((problem.dead, reduced.dead), (problem.live, reduced.live)):
        expected = columns.T @ whole(problem, full)
        assert whole(problem, less) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
    for name in ("normal", "tangential"):
        full, less = dense(getattr(problem, name)), dense(getattr(reduced, name))
        assert less == pytest.approx(full @ columns, abs=1e-12)
    rigid = dense(reduced.rigid)
    assert rigid == pytest.approx(columns.T @ dense(problem.rigid), abs=1e-12)
    assert found @ rigid == pytest.approx(np.zeros_like(rigid), abs=1e-9 * unit)
    assert np.array_equal(reduced.friction, problem.friction)


@pytest.mark.mpi
def test_joint_points_have_the_compliance_of_their_nodes(case):
    problem, reduced = case.problem, case.discretization.block_modes.reduced
    nodes, body = np.bincount(node_bodies(case)), np.repeat(node_bodies(case), 2)
    soft = BlockModesOptions().indentation * np.log(nodes[body] / 3.0)
    soft = soft / np.diag(dense(problem.stiffness))
    for found, name in zip(reduced.compliance, ("normal", "tangential"), strict=True):
        rows = dense(getattr(problem, name))
        assert whole(problem, found) == pytest.approx((rows**2) @ soft, rel=1e-12)


@pytest.mark.parametrize("elements", [2, 4, 8])
def test_compliance_is_what_the_modes_of_a_block_lack(elements):
    """On average, of a brick: K^+ less its part in the modes, below each joint point."""
    with load_case(block_recipe(0.4, 0.2, 0.5).scene(elements)) as case:
        problem, made = case.problem, case.discretization.block_modes
        columns, stiffness = basis(made), dense(problem.stiffness)
        inverse = np.linalg.pinv(stiffness, rcond=1e-9, hermitian=True)
        of_modes = np.linalg.pinv(dense(made.reduced.stiffness), rcond=1e-9, hermitian=True)
        rigid = dense(problem.rigid)
        elastic = np.eye(len(rigid)) - rigid @ rigid.T
        lacking = inverse - elastic @ columns @ of_modes @ columns.T @ elastic
        for soft, matrix in zip(
            made.reduced.compliance, (problem.normal, problem.tangential), strict=True
        ):
            rows = dense(matrix)
            exact = np.einsum("ij,jk,ik->i", rows, lacking, rows)
            assert soft.mean() == pytest.approx(exact.mean(), rel=0.35)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", [SYMMETRIC, GENERAL])
def test_springs_of_the_reduced_structure_are_those_of_the_formula(case, kind):
    random, problem = np.random.default_rng(3), case.problem
    reduced, tally = case.discretization.block_modes.reduced, Tally()
    count = int(problem.sum(np.ones_like(problem.friction)))
    with case.discretization.block_modes.stiffness(kind, tally) as stiffness:
        normal, tangential = stiffness.mean_diagonal * 10.0 ** random.uniform(-3, 3, (2, count))
        coupling = random.uniform(-0.8, 0.8, count) * np.minimum(normal, tangential)
        coupling *= kind == GENERAL
        b_n, b_t = dense(reduced.normal), dense(reduced.tangential)
        matrix = dense(reduced.stiffness) + b_n.T @ np.diag(normal) @ b_n
        matrix += b_t.T @ (np.diag(tangential) @ b_t + np.diag(coupling) @ b_n)
        springs = [part(problem, k, problem.friction) for k in (normal, tangential, coupling)]
        right = random.normal(size=len(matrix))
        factor = stiffness.factor(*springs[: 3 if kind == GENERAL else 2])
        found = whole(problem, factor.solve(part(problem, right, reduced.dead)))
    assert matrix @ found == pytest.approx(right, abs=1e-8 * np.abs(right).max())
    assert tally.count == 1


def test_live_load_and_origin_of_slip_of_another_load_case(case):
    made, problem = case.discretization.block_modes, case.problem
    origin = np.arange(float(len(problem.friction)))
    other = made.under(replace(problem, live=-2.0 * problem.live, slip_origin=origin))
    assert other.live == pytest.approx(-2.0 * made.reduced.live)
    assert np.array_equal(other.slip_origin, origin)
    assert other.stiffness is made.reduced.stiffness
    assert np.array_equal(other.compliance, made.reduced.compliance)


@pytest.mark.parametrize(("kept", "expected"), [(3, 6), (1, 2), (0, 0)])
def test_a_block_on_few_nodes_or_held_has_fewer_modes(kept, expected):
    """A single triangle has six displacements; a fixed one none that are free."""
    with load_case(block_recipe(0.4, 0.2, 0.5).scene(1)) as case:
        problem, discretization = case.problem, case.discretization
        nodes = len(problem.dead) // 2
        position = discretization.elasticity.space.tabulate_dof_coordinates()[:nodes, :2]
        shapes = np.where((np.arange(nodes) < kept)[:, None, None], modes(position), 0.0)
        sides = discretization.joints.bodies[discretization.operators.points]
        body = np.zeros(nodes, dtype=np.int32)
        blocks = Blocks.numbered_by_rank(problem.comm, body, sides, 1)
        with BlockModes(problem, shapes, blocks) as made:
            assert np.linalg.matrix_rank(basis(made)) == expected
            assert np.all(np.diag(dense(made.reduced.stiffness)) >= 0.0)


# ---- states


@pytest.mark.parametrize("friction", [1.5, 2.0])
def test_structure_of_single_triangles_is_reproduced_exactly(friction):
    """Their modes are all that they have: the same state, to the last digits."""
    triangles = [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)], [(1, 0), (2, 0), (1, 1)]]
    recipe = outlined(triangles, coulomb(friction), 4.0)
    with load_case(recipe.scene(1)) as case:
        made, problem = case.discretization.block_modes, case.problem
        assert problem.size == 2 * 3 * 3
        assert np.all(made.reduced.compliance == 0.0)
        kkt, exact = conditions(case), solved(case).state
        with made.stiffness(GENERAL, Tally()) as stiffness:
            reduced = PerturbedKKT.coulomb(made.reduced, stiffness, kkt.scales, kkt.work)
            start = made.restricted(case.bonded_state(kkt.work))
            assert made.prolonged(start).displacement == pytest.approx(
                case.bonded_state(kkt.work).displacement, abs=1e-12
            )
            found = solve_interior_point(reduced, start, 1.0, Tolerances(load_factor=1e-9))
        state = made.prolonged(found.state)
        assert state.load_factor == pytest.approx(exact.load_factor, rel=1e-9)
        for name in ("displacement", "pressure", "shear"):
            one, other = getattr(state, name), getattr(exact, name)
            assert one == pytest.approx(other, abs=1e-7 * np.abs(other).max())
