"""Movements of supports and foundations: settlement, spreading, tilt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import LinearProblem
from scipy.optimize import linprog

from fenics_contact import (
    InputError,
    Load,
    Material,
    Movement,
    Scene,
    SolveOptions,
    equilibrium,
    limit_load,
)
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons
from tests.helpers import STONE, Drawing, coulomb, grid_blocks, mesh_of, node_positions

YOUNG, LENGTH, HEIGHT, BLOCKS = 1e9, 3.0, 0.3, 6
SQUEEZE, DROP = 3e-3, 1e-3


def moving(scene: Scene, **movements: Movement) -> Scene:
    return replace(scene, dead=replace(scene.dead, movement=movements))


def row(fineness: int) -> Drawing:
    """Blocks beside each other."""
    step, divisions = LENGTH / BLOCKS, (2 * fineness, 2 * fineness)
    return grid_blocks(*(((k * step, 0.0), (step, HEIGHT), divisions) for k in range(BLOCKS)))


def clamped(drawing: Drawing, degree: int = 2) -> Scene:
    """A row between fixed ends, pressed together by one of them, which also settles."""
    end = f"right{BLOCKS - 1}"
    return Scene(
        mesh_of(drawing.model()),
        {"default": Material(YOUNG, 0.0)},
        live=Load(traction={"top2": (0.0, -1.0)}),
        dead=Load(movement={end: Movement((-SQUEEZE, -DROP))}),
        joints={"default": coulomb(0.6)},
        supports={"left0": "fixed", end: "fixed"},
        plane="stress",
        degree=degree,
    )


def displacements(found) -> tuple[np.ndarray, np.ndarray]:
    """Positions of all nodes and their displacements, on all ranks."""
    made = found.layout
    mine = made.cartesian(found.state.displacement)
    parts = made.scene.comm.allgather(mine)
    return node_positions(made.space), np.concatenate(parts)


def bar_without_joints(fineness: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and displacements of the same bar in one piece, by dolfinx alone."""
    drawing = grid_blocks(((0.0, 0.0), (LENGTH, HEIGHT), (2 * fineness * BLOCKS, 2 * fineness)))
    domain = mesh_of(drawing.model()).domain
    space = fem.VectorFunctionSpace(domain, ("Lagrange", 2))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    energy = YOUNG * ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))) * ufl.dx
    nothing = ufl.inner(fem.Constant(domain, (0.0, 0.0)), v) * ufl.dx
    held = []
    for x, value in ((0.0, (0.0, 0.0)), (LENGTH, (-SQUEEZE, -DROP))):
        dofs = fem.locate_dofs_geometrical(space, lambda p, x=x: np.abs(p[0] - x) < 1e-9)
        held.append(fem.dirichletbc(np.array(value), dofs, space))
    options = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
    solved = LinearProblem(energy, nothing, held, petsc_options=options).solve()
    owned = space.dofmap.index_map.size_local
    parts = domain.comm.allgather(solved.x.array[: 2 * owned].reshape(-1, 2))
    return node_positions(space), np.concatenate(parts)


@pytest.mark.mpi
def test_clamped_row_is_the_bar_in_one_piece():
    found = equilibrium(clamped(row(1)), 0.0)
    assert found.status == "equilibrium"
    (place, u), (points, bar) = displacements(found), bar_without_joints(1)
    distance = np.linalg.norm(place[:, None] - points[None], axis=2)
    assert distance.min(axis=1).max() < 1e-9
    assert u == pytest.approx(bar[distance.argmin(axis=1)], abs=1e-8 * DROP)


def arch(spread: float, degree: int = 1) -> Scene:
    """Nine voussoirs; their right springing moves."""
    angle = np.radians(90.0 + np.linspace(70.0, -70.0, 10))
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    inner, outer = 0.85 * ray, 1.15 * ray
    voussoirs = np.stack([inner[:-1], inner[1:], outer[1:], outer[:-1]], axis=1)
    sides = {"left": [(inner[0], outer[0])], "right": [(inner[-1], outer[-1])]}
    law = coulomb(0.8)
    scene = Scene(
        mesh_of(polygons(voussoirs, 0.15, None, sides)),
        {"default": Material(5e9, 0.2, 2000.0)},
        live=Load((9.81, 0.0)),
        dead=Load((0.0, -9.81)),
        joints={"default": law},
        foundations={"left": law, "right": law},
        degree=degree,
        solve=SolveOptions(direction="both"),
    )
    return moving(scene, right=Movement((spread, 0.0)))


def least_thrust(scene: Scene, sign: float) -> float:
    """Least of `sign` times the thrust of rigid voussoirs, by a linear program."""
    with Discretization(scene) as made:
        joints, bodies = made.joints, made.bodies
    count = len(joints.length)
    balance = np.zeros((len(bodies.centre), 3, 2, count))
    for side, way in ((0, -1.0), (1, 1.0)):
        for point in np.flatnonzero(joints.bodies[:, side] >= 0):
            body = joints.bodies[point, side]
            x, y = joints.position[point] - bodies.centre[body]
            for k, axis in enumerate((joints.normal[point], joints.tangent[point])):
                moment = (x * axis[1] - y * axis[0]) / bodies.size
                balance[body, :, k, point] = [way * axis[0], way * axis[1], way * moment]
    points = np.diag(joints.friction)
    cone = np.block([[-points, np.eye(count)], [-points, -np.eye(count)]])
    springing = joints.law == joints.names.index("left")
    thrust = [np.where(springing, axis[:, 0], 0.0) for axis in (joints.normal, joints.tangent)]
    unit = np.abs(bodies.dead).max()
    found = linprog(
        sign * np.concatenate(thrust),
        A_ub=cone,
        b_ub=np.zeros(2 * count),
        A_eq=balance.reshape(-1, 2 * count),
        b_eq=-bodies.dead.ravel() / unit,
        bounds=[(0.0, None)] * count + [(None, None)] * count,
    )
    return float(sign * found.fun * unit)


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("spread", [2e-3, -2e-3])
def test_arch_on_moving_springings_has_three_hinges(spread, degree):
    scene = arch(spread, degree)
    found = equilibrium(scene, 0.0)
    assert found.status == "equilibrium"
    thrust = found.joints["force"][found.joints["group"] == "left", 0].sum()
    assert thrust == pytest.approx(least_thrust(scene, np.sign(spread)), rel=1e-8)


@pytest.mark.mpi
def test_limit_load_of_a_spread_arch_is_verified_and_the_same():
    spread, still = limit_load(arch(5e-3)), limit_load(arch(0.0))
    assert spread.status == still.status == "limit"
    assert spread.load_factor == pytest.approx(still.load_factor, rel=1e-6)
    assert spread.load_factor_negative == pytest.approx(still.load_factor_negative, rel=1e-6)
    assert spread.positive.certificate.passed
    # The last voussoir stands on the ground that moved.
    assert spread.blocks["displacement"][-1, 0] > 2e-3


@pytest.mark.mpi
def test_kept_matrices_give_the_numbers_of_new_ones():
    first = arch(0.0)
    name = next(iter(first.dead.movement))
    there = moving(first, **{name: Movement((1e-3, -2e-3), 0.1)})
    with Discretization(first) as made, Discretization(there) as new:
        assert made.shares_matrices(there)
        changed = made.with_(scene=there)
        for one, other in (
            (changed.problem.dead, new.problem.dead),
            (changed.problem.law.slip_origin, new.problem.law.slip_origin),
            (changed.problem.law.opening_origin, new.problem.law.opening_origin),
            (changed.imposed, new.imposed),
        ):
            assert one == pytest.approx(other, rel=1e-12, abs=1e-12 * np.abs(other).max(initial=0))
        largest = new.problem.max(np.abs(new.problem.law.opening_origin))
    assert largest > 1e-3


def test_movements_that_are_refused():
    scene = arch(0.0)
    with pytest.raises(InputError, match=r"movement\.crown: 'crown' is neither .* 'left', 'right'"):
        moving(scene, crown=Movement((1e-3, 0.0)))
    with pytest.raises(InputError, match=r"loads\.live\.movement: supports move with the dead"):
        replace(scene, live=replace(scene.live, movement={"left": Movement((1e-3, 0.0))}))
    with pytest.raises(InputError, match="rotation"):
        Movement(rotation=30.0)
    with pytest.raises(InputError, match="displacement"):
        Movement((np.nan, 0.0))
    block = grid_blocks(((0.0, 0.0), (1.0, 1.0), (2, 2)), ((0.0, 1.0), (1.0, 1.0), (2, 2)))
    held = Scene(
        mesh_of(block.model()),
        {"default": STONE},
        live=Load((1.0, 0.0)),
        joints={"default": coulomb(0.5)},
        supports={"bottom0": "fixed", "left0": "roller"},
    )
    with pytest.raises(InputError, match=r"supports that meet at \(.*\) move apart"):
        limit_load(moving(held, left0=Movement((1e-3, 0.0))))
