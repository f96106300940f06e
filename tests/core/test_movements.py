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
from fenics_contact.discretization.discretization import Discretization, typical_sizes
from fenics_contact.meshing import polygons
from fenics_contact.results.certificate import state_residuals
from fenics_contact.solvers.joint_stiffness import GENERAL
from tests.helpers import STONE, Drawing, coulomb, grid_blocks, mesh_of, node_positions, rotation

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


def force_at(found, x: float) -> tuple[float, float, float]:
    """Force on the right of a section and its moment about the axis of a row."""
    position, force = found.joints["position"], found.joints["force"]
    here = np.abs(position[:, 0] - x) < 1e-9
    moment = (position[here, 1] - 0.5 * HEIGHT) @ -force[here, 0]
    return (*force[here].sum(axis=0), float(moment))


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


def test_clamped_row_is_a_beam_whose_end_settles():
    inertia, shear = HEIGHT**3 / 12.0, 5.0 / 6.0 * 0.5 * YOUNG * HEIGHT
    soft = 12.0 * YOUNG * inertia / (shear * LENGTH**2)
    end = 12.0 * YOUNG * inertia * DROP / LENGTH**3 / (1.0 + soft)
    errors = []
    for fineness in (1, 2, 4):
        found = equilibrium(clamped(row(fineness)), 0.0)
        for x in np.linspace(0.0, LENGTH, BLOCKS + 1)[1:-1]:
            thrust, force, moment = force_at(found, x)
            assert thrust == pytest.approx(YOUNG * HEIGHT * SQUEEZE / LENGTH, rel=1e-9)
            # Beams leave out that the ends do not warp.
            assert force == pytest.approx(end, rel=1e-3)
            assert moment == pytest.approx(force * (0.5 * LENGTH - x), abs=1e-8 * end)
        errors.append(force / end - 1.0)
    assert abs(errors[2] - errors[1]) < 0.3 * abs(errors[1] - errors[0])


def beam_on_piers(drop: float, ground: bool, degree: int = 1) -> Scene:
    """Blocks in a row, pressed together at both ends, on two piers, or on the ground."""
    beam = [((x, 1.0), (1.0, 0.4), (5, 2)) for x in (0.0, 1.0, 2.0)]
    piers = [] if ground else [((x, 0.0), (0.4, 1.0), (2, 5)) for x in (0.0, 2.6)]
    drawing = grid_blocks(*beam, *piers)
    at = drawing.points[:, 0]
    for name, block, inside in (("a", 0, at < 0.4 + 1e-9), ("b", 2, at > 2.6 - 1e-9)):
        side = drawing.facets[f"bottom{block}"]
        drawing.facets[name] = side[np.all(inside[side], axis=1)]
    rough, smooth = coulomb(0.6), coulomb(0.0)
    below, stands = {"a": rough, "b": smooth}, {"bottom3": "fixed", "bottom4": "fixed"}
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        live=Load(traction={"top1": (0.0, -1.0)}),
        dead=Load((0.0, -9.81), traction={"left0": (1e6, 0.0), "right2": (-1e6, 0.0)}),
        joints={"default": rough} if ground else {"default": rough} | below,
        foundations=below if ground else {},
        supports={} if ground else stands,
        degree=degree,
    )
    return moving(scene, **{"b" if ground else "bottom4": Movement((0.0, -drop))})


@pytest.mark.mpi
@pytest.mark.parametrize(("ground", "degree"), [(True, 1), (True, 2), (False, 1)])
def test_simply_supported_row_turns_and_nothing_else(ground, degree):
    drops = 5e-3, 9e-3
    before, after = (equilibrium(beam_on_piers(drop, ground, degree), 0.0) for drop in drops)
    assert before.status == after.status == "equilibrium"
    force = after.joint_values.normal_force
    assert force == pytest.approx(before.joint_values.normal_force, abs=1e-9 * force.max())
    joints = after.layout.joints
    weight, arm = STONE.density * 9.81 * 3.0 * 0.4, 2.6
    # It rests on the inner edge of one pier and the outer one of the other.
    for name, share, x in (("a", 1.5, 0.4), ("b", 1.1, 3.0)):
        mine = joints.law == joints.names.index(name)
        held = weight * share / arm
        assert force[mine].sum() == pytest.approx(held, rel=1e-9)
        assert force[mine] @ joints.position[mine, 0] == pytest.approx(held * x, rel=1e-9)
    (place, first), (_, second) = displacements(before), displacements(after)
    turn, row = (drops[0] - drops[1]) / arm, place[:, 1] > 1.0 + 1e-9
    expected = turn * np.column_stack([1.0 - place[:, 1], place[:, 0] - 0.4])[row]
    assert (second - first)[row] == pytest.approx(expected, abs=1e-9 * drops[1])


@pytest.mark.mpi
def test_joint_on_a_settling_support_opens_by_the_settlement():
    """A cantilever lies on a pier that sinks away."""
    blocks = (((0.0, 1.0), (3.0, 0.4), (15, 3)), ((2.6, 0.0), (0.4, 1.0), (2, 4)))
    drawing = grid_blocks(*blocks, ((0.0, 1.4), (0.4, 0.2), (2, 1)))
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        live=Load(traction={"top2": (0.0, 1.0)}),
        dead=Load((0.0, -9.81)),
        joints={"default": coulomb(0.5)},
        supports={"left0": "fixed", "bottom1": "fixed"},
    )
    drops = 0.03, 0.05
    found = [equilibrium(moving(scene, bottom1=Movement((0.0, -drop))), 0.0) for drop in drops]
    gaps, made = [one.joints["gap"] for one in found], found[0].layout
    pier = made.joints.position[:, 1] < 1.2
    assert gaps[0][pier].min() > 0.0
    assert (gaps[1] - gaps[0])[pier] == pytest.approx(np.full(pier.sum(), 0.02), rel=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
def test_structure_moved_as_a_whole_has_the_same_forces(degree):
    angle, turn, shift = 0.3, 1e-3, np.array([2e-3, 1e-3])
    scene = clamped(row(1).turned(angle), degree)
    end = f"right{BLOCKS - 1}"
    middle = np.array([[0.0, 0.5 * HEIGHT], [LENGTH, 0.5 * HEIGHT]]) @ rotation(angle).T
    axis = rotation(angle)[:, 0]
    whole = shift + turn * np.column_stack([-middle[:, 1], middle[:, 0]])
    ends = whole - [[0.0], [SQUEEZE]] * axis, [[0.0, 0.0], -SQUEEZE * axis]
    rest, moved = (
        equilibrium(
            replace(
                moving(scene, left0=Movement(tuple(d[0]), t), **{end: Movement(tuple(d[1]), t)}),
                supports={"left0": "fixed", end: "roller"},
            ),
            0.0,
        )
        for d, t in zip(np.asarray(ends)[::-1], (0.0, np.degrees(turn)), strict=True)
    )
    assert moved.status == "equilibrium"
    scale = np.abs(rest.joint_values.normal_force).max()
    assert moved.joint_values.normal_force == pytest.approx(
        rest.joint_values.normal_force, abs=1e-9 * scale
    )
    place, u = displacements(moved)
    expected = displacements(rest)[1] + shift
    expected += turn * np.column_stack([-place[:, 1], place[:, 0]])
    assert u == pytest.approx(expected, abs=1e-9 * DROP)


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


def test_verification_counts_the_movement():
    with Discretization(arch(0.0)) as still, Discretization(arch(5e-3)) as moved:
        state = equilibrium(arch(0.0), 0.0).state
        scales = typical_sizes(still.problem, still.bonded(GENERAL))
        good, bad = (
            max(state_residuals(made.problem, state, scales).values()) for made in (still, moved)
        )
    assert good < 1e-8
    assert bad > 1e-3


@pytest.mark.mpi
@pytest.mark.parametrize("make", [lambda: arch(0.0), lambda: beam_on_piers(0.0, ground=False)])
def test_kept_matrices_give_the_numbers_of_new_ones(make):
    first = make()
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


@pytest.mark.mpi
def test_block_on_ground_that_breaks_under_it():
    """It stands on what stays, and the rest of the ground goes down by any amount."""
    drawing = grid_blocks(((0.0, 0.0), (2.0, 0.5), (8, 2)))
    side, at = drawing.facets["bottom0"], drawing.points[:, 0]
    for name, inside in (("stays", at < 1.25 + 1e-9), ("sinks", at > 1.25 - 1e-9)):
        drawing.facets[name] = side[np.all(inside[side], axis=1)]
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        live=Load((1.0, 0.0)),
        dead=Load((0.0, -9.81)),
        foundations={"stays": coulomb(0.5), "sinks": coulomb(0.5)},
    )
    few, more = (
        equilibrium(moving(scene, sinks=Movement((0.0, -drop))), 0.0) for drop in (1e-2, 3e-2)
    )
    sinks, force = few.joints["group"] == "sinks", few.joints["force"][:, 1]
    assert force[sinks] == pytest.approx(np.zeros(sinks.sum()), abs=1e-6)
    assert force[~sinks].sum() == pytest.approx(STONE.density * 9.81, rel=1e-9)
    opened = more.joints["gap"] - few.joints["gap"]
    assert opened[sinks] == pytest.approx(np.full(sinks.sum(), 2e-2), rel=1e-9)


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


def test_roller_moves_across_its_edge_alone():
    block = grid_blocks(((0.0, 0.0), (1.0, 1.0), (2, 2)), ((0.0, 1.0), (1.0, 1.0), (2, 2)))
    scene = Scene(
        mesh_of(block.turned(0.4).model()),
        {"default": STONE},
        live=Load((1.0, 0.0)),
        joints={"default": coulomb(0.5)},
        supports={"left0": "roller", "bottom0": "roller"},
    )
    across, along = rotation(0.4) @ [1e-3, 0.0], rotation(0.4) @ [0.0, 5e-3]
    with Discretization(moving(scene, left0=Movement(tuple(across)))) as one:
        with Discretization(moving(scene, left0=Movement(tuple(across + along)))) as other:
            pass
    assert other.supports.motion == pytest.approx(one.supports.motion, abs=1e-15)
    rows = np.abs(one.supports.motion).max(axis=1) > 1e-9
    assert one.supports.motion[rows] == pytest.approx(np.tile(across, (rows.sum(), 1)), abs=1e-15)
