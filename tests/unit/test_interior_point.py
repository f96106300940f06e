"""States under work control: elastic branch, plateau, rates, starts from far away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import JointLaw, Load, Scene, SolverError
from fenics_contact.analysis.rigid_blocks import RigidBlocks
from fenics_contact.solvers.interior_point import (
    BALANCING,
    FOLLOWED,
    WorkControl,
    _Best,
    _InteriorPoint,
)
from fenics_contact.meshing import polygons, running_bond, wall
from fenics_contact.solvers.kkt import PathEquations, State, Workspace
from fenics_contact.analysis.work_control import FIRST_WORK
from tests.helpers import (
    GRAVITY,
    PUSH,
    STONE,
    Loaded,
    coulomb,
    dense,
    joint_rows,
    on_ground,
    vector_like,
    whole,
)

LIFT = Load((0.0, GRAVITY))  # the weight upwards


@pytest.fixture(scope="module")
def bond() -> Loaded:
    """A small wall in running bond on rigid ground."""
    return Loaded.of(on_ground(running_bond(2, 2, elements=1), coulomb(0.5)))


@pytest.fixture(scope="module")
def block() -> Loaded:
    """A block as wide as high, of several elements."""
    return Loaded.of(on_ground(wall([[1]], (0.4, 0.4), 2), coulomb(0.5)))


def program(loaded: Loaded, bound: np.ndarray) -> tuple[float, np.ndarray]:
    """Limit load and collapse motions of rigid blocks with given friction."""
    structure = loaded.structure
    blocks = RigidBlocks(structure.joints, structure.bodies, structure.scene.comm)
    factor, motion = blocks.collapse(structure.all_points(bound))
    assert factor is not None and motion is not None
    return factor, motion


def control_of(loaded: Loaded) -> WorkControl:
    return WorkControl(loaded.structure.problem, loaded.structure.springs)


def leftovers(loaded: Loaded, state: State, bound: np.ndarray) -> dict[str, float]:
    """All optimality conditions, recomputed by dense algebra."""
    problem, all_points = loaded.structure.problem, loaded.structure.all_points
    b_n, b_t = joint_rows(loaded.structure)
    u = whole(state.displacement)
    pressure, shear, g = map(all_points, (state.pressure, state.shear, bound))
    forces = whole(problem.dead) + state.load_factor * whole(problem.live)
    rest = dense(problem.stiffness) @ u - forces - b_n.T @ pressure - b_t.T @ shear
    opening, slip = b_n @ u, b_t @ u
    force = np.abs(forces).max()
    return {
        "equilibrium": np.abs(rest).max() / force,
        "penetration": max(0.0, -opening.min()) / np.abs(u).max(),
        "tension": max(0.0, -pressure.min()) / force,
        "complementarity": np.abs(opening * pressure).max() / (force * np.abs(u).max()),
        "friction": max(0.0, (np.abs(shear) - g).max()) / force,
        "slip": np.abs(g * np.abs(slip) + shear * slip).max() / (force * np.abs(u).max()),
        "work": abs(whole(problem.live) @ u / state.work - 1.0),
    }


@pytest.mark.parametrize("friction", [0.05, 0.1, 0.5, 2.0])
def test_plateau_is_the_rigid_limit_load(bond, friction):
    bound = friction * bond.bonded.dead_pressure
    start, scales = bond.start(FIRST_WORK)
    point = control_of(bond).solve(bound, start.work, start, scales)
    expected, _ = program(bond, bound)
    assert point.state.load_factor == pytest.approx(expected, rel=1e-8)
    assert np.array_equal(point.bound, bound)
    assert point.steps <= 40


@pytest.mark.parametrize("degree", [1, 2])
def test_plateau_of_a_wall_with_a_lintel(degree):
    model = wall([[1, 1, 1], [1, -1, 1], [0.5, 2, 0.5]], elements=1)
    loaded = Loaded.of(on_ground(model, coulomb(0.6), degree=degree))
    bound = 0.6 * loaded.bonded.dead_pressure
    start, scales = loaded.start(FIRST_WORK)
    point = control_of(loaded).solve(bound, start.work, start, scales)
    expected, _ = program(loaded, bound)
    assert point.state.load_factor == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("ratio", [1.0, 10.0, FIRST_WORK])
def test_state_meets_all_conditions(bond, ratio):
    bound = 0.5 * bond.bonded.dead_pressure
    start, scales = bond.start(ratio)
    point = control_of(bond).solve(bound, start.work, start, scales)
    assert max(point.residuals.values()) <= 1e-12
    assert set(point.residuals) == {"equilibrium", "opening", "slip", "work", "complementarity"}
    left = leftovers(bond, point.state, bound)
    assert left.pop("equilibrium") < 1e-8
    assert max(left.values()) < 1e-10, left


def test_large_motion_takes_no_digits_from_the_stresses(bond):
    bound = 0.5 * bond.bonded.dead_pressure
    start, scales = bond.start(1e4 * FIRST_WORK)
    state = control_of(bond).solve(bound, start.work, start, scales).state
    lost = leftovers(bond, state, bound).pop("equilibrium")
    kept = leftovers(bond, replace(state, displacement=state.strained), bound).pop("equilibrium")
    assert kept < 1e-9 < lost
    # They are of the same displacements, but for a rigid motion.
    rest = whole(bond.structure.problem.strained(state.displacement)) - whole(state.strained)
    assert np.abs(rest).max() < 1e-14 * np.abs(whole(state.displacement)).max()


def test_strains_beside_motions_of_many_nodes():
    """Blocks of 81 nodes: rounding in sums over them is no strain."""
    problem = Loaded.of(on_ground(running_bond(2, 2, elements=8), coulomb(0.5))).structure.problem
    rigid, random = dense(problem.rigid), np.random.default_rng(3)
    strains = 1e-6 * random.normal(size=len(rigid))
    u = rigid @ (1e5 * random.normal(size=rigid.shape[1])) + strains
    expected = strains - rigid @ (rigid.T @ strains)
    found = whole(problem.strained(vector_like(problem.dead, u)))
    assert np.abs(found - expected).max() < 3e-16 * np.abs(u).max()


def test_state_is_of_displacements_and_strains_that_belong_together(bond):
    """Both are summed up step by step, and rounding parts them."""
    run, best = out_of_balance(bond, 0.0)
    control, problem = control_of(bond), bond.structure.problem
    u, strained = whole(best.iterate.u), whole(best.iterate.strained)
    noise = 1e-9 * np.abs(u).max() * np.random.default_rng(0).normal(size=len(u))
    best.iterate.u.axpy(1.0, vector_like(problem.dead, noise))
    state = control._point(run, best, 1.0).state
    largest = np.abs(u).max()
    strains = whole(problem.strained(state.displacement))
    assert np.array_equal(whole(state.strained), strained)
    assert np.abs(strains - strained).max() < 3e-16 * largest
    moved = whole(state.displacement) - (u + noise)  # by strains alone
    assert whole(problem.strained(vector_like(problem.dead, moved))) == pytest.approx(
        moved, abs=1e-15 * largest
    )


def test_elastic_branch_is_the_response_with_closed_joints(block):
    # Small load, high friction: nothing opens or slips. The load factor follows from K alone.
    problem = block.structure.problem
    b_n, b_t = joint_rows(block.structure)
    stiffness, rows = dense(problem.stiffness), np.vstack([b_n, b_t])
    count = len(stiffness)
    system = np.block([[stiffness, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    dead, live = whole(problem.dead), whole(problem.live)
    loads = np.zeros((len(system), 2))
    loads[:count] = np.column_stack([dead, live])
    # Columns: response to the dead and to the live load; below, minus the joint forces.
    response = np.linalg.solve(system, loads)
    factor = 0.05
    together = response @ [1.0, factor]
    assert np.all(together[count : count + len(b_n)] < 0.0)  # pressed everywhere
    work = float(live @ together[:count])

    start, scales = block.start(1.0)
    bound = np.full(len(problem.friction), 1e2 * scales.force)
    start = replace(start, work=work)
    point = control_of(block).solve(bound, work, start, scales)
    assert point.state.load_factor == pytest.approx(factor, rel=1e-7)
    found = whole(point.state.displacement)
    assert found == pytest.approx(together[:count], abs=1e-7 * np.abs(found).max())
    pressure = block.structure.all_points(point.state.pressure)
    expected = -together[count : count + len(b_n)]
    assert pressure == pytest.approx(expected, abs=1e-6 * expected.max())


def test_load_factor_rises_to_the_plateau_and_stays(block):
    bound = 0.3 * block.bonded.dead_pressure
    control = control_of(block)
    factors = []
    for ratio in (0.05, 0.2, 1.0, 5.0, 50.0, 500.0):
        start, scales = block.start(ratio)
        factors.append(control.solve(bound, start.work, start, scales).state.load_factor)
    assert np.all(np.diff(factors) > -1e-9)
    assert factors[1] > 1.05 * factors[0]
    expected = block.structure.problem.sum(bound) / (STONE.density * GRAVITY * 0.4 * 0.4)
    assert factors[-2:] == pytest.approx([expected] * 2, rel=1e-8)


def test_coulomb_bound_follows_the_pressure(block):
    start, scales = block.start(FIRST_WORK)
    point = control_of(block).solve(None, start.work, start, scales)
    # Half of the weight: sliding, whatever the distribution of pressure.
    assert point.state.load_factor == pytest.approx(0.5, rel=1e-8)
    assert point.bound == pytest.approx(0.5 * point.state.pressure, rel=1e-12)
    left = leftovers(block, point.state, point.bound)
    assert left.pop("equilibrium") < 1e-8
    assert max(left.values()) < 1e-10, left


def test_frictionless_joints_have_no_shear():
    # A wedge in a notch, lifted by its weight.
    notch = [(0, 0), (4, 0), (4, 2), (2, 1), (0, 2)]
    model = polygons([notch, [(2, 1), (4, 2), (0, 2)]], 0.8)
    smooth, rough = JointLaw("frictionless"), {"base": coulomb(1.0)}
    loaded = Loaded.of(on_ground(model, smooth, live=LIFT, foundations=rough))
    start, scales = loaded.start(FIRST_WORK)
    point = control_of(loaded).solve(None, start.work, start, scales)
    assert point.state.load_factor == pytest.approx(1.0, rel=1e-8)
    shear = loaded.structure.all_points(point.state.shear)
    assert np.all(shear[loaded.structure.joints.law == 0] == 0.0)


@pytest.mark.parametrize(("live", "expected"), [(PUSH, 0.0), (LIFT, 1.0)])
def test_frictionless_blocks_on_level_ground(live, expected):
    # Nothing holds them sideways, but the states under work control are well defined.
    law = JointLaw("frictionless")
    loaded = Loaded.of(on_ground(wall([[1], [1]], (0.4, 0.2), 1), law, live=live))
    start, scales = loaded.start(FIRST_WORK)
    bound = np.zeros_like(loaded.bonded.dead_pressure)
    point = control_of(loaded).solve(bound, start.work, start, scales)
    assert point.state.load_factor == pytest.approx(expected, abs=1e-8)


def test_rate_at_the_limit_load_is_the_collapse_mode(bond):
    bound = 0.5 * bond.bonded.dead_pressure
    start, scales = bond.start(FIRST_WORK)
    control = control_of(bond)
    point = control.solve(bound, start.work, start, scales)
    mode, slope = control.rate(point.state, point.bound, scales)
    live, dead = whole(bond.structure.problem.live), whole(bond.structure.problem.dead)
    v = whole(mode)
    assert live @ v == pytest.approx(1.0, rel=1e-10)
    assert abs(slope) * start.work < 1e-5 * point.state.load_factor
    b_n, b_t = joint_rows(bond.structure)
    assert (b_n @ v).min() > -1e-6 * np.abs(v).max()
    power = bond.structure.all_points(bound) @ np.abs(b_t @ v)
    assert power == pytest.approx(point.state.load_factor + dead @ v, rel=1e-6)


def test_rate_at_the_limit_load_is_the_rigid_mode(block):
    bound = 0.3 * block.bonded.dead_pressure
    start, scales = block.start(FIRST_WORK)
    control = control_of(block)
    point = control.solve(bound, start.work, start, scales)
    mode, _ = control.rate(point.state, point.bound, scales)
    _, motion = program(block, bound)
    rigid = whole(block.structure.rigid_motion(motion))
    assert whole(mode) == pytest.approx(rigid, abs=1e-6 * np.abs(rigid).max())


def test_rate_on_the_elastic_branch_is_the_slope_of_the_path(block):
    bound = np.full(len(block.structure.problem.friction), 1e2 * block.scales.force)
    control = control_of(block)
    points = []
    for ratio in (0.02, 0.03):
        start, scales = block.start(ratio)
        points.append(control.solve(bound, start.work, start, scales))
    mode, slope = control.rate(points[0].state, bound, scales)
    rise = points[1].state.load_factor - points[0].state.load_factor
    run = points[1].state.work - points[0].state.work
    # The springs of closed joints are large, not rigid.
    assert slope == pytest.approx(rise / run, rel=5e-3)
    change = whole(points[1].state.displacement) - whole(points[0].state.displacement)
    assert whole(mode) == pytest.approx(change / run, abs=5e-3 * np.abs(change / run).max())


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_start_from_far_away(bond, seed):
    bound = 0.5 * bond.bonded.dead_pressure
    start, scales = bond.start(FIRST_WORK)
    expected, _ = program(bond, bound)
    random = np.random.default_rng(seed)
    size = bond.structure.problem.dead.getSize()
    noise = random.standard_normal(size) * 10.0 * scales.displacement
    points = bond.structure.operators.points
    count = len(bond.structure.joints.length)
    pressure, shear = 20.0 * scales.force * random.standard_normal((2, count))
    far = State(
        vector_like(bond.structure.problem.dead, noise),
        -3.0,
        pressure[points],
        shear[points],
        start.work,
    )
    point = control_of(bond).solve(bound, start.work, far, scales)
    assert point.state.load_factor == pytest.approx(expected, rel=1e-8)
    # The start itself is left as it was.
    assert np.array_equal(whole(far.displacement), noise)


def test_warm_start_takes_fewer_steps(bond):
    bound = 0.5 * bond.bonded.dead_pressure
    start, scales = bond.start(FIRST_WORK)
    control = control_of(bond)
    cold = control.solve(bound, start.work, start, scales)
    warm = control.solve(1.001 * bound, start.work, cold.state, scales, centring=1e-6)
    expected, _ = program(bond, 1.001 * bound)
    assert warm.state.load_factor == pytest.approx(expected, rel=1e-8)
    assert warm.steps < cold.steps


def test_every_step_is_one_factorisation(bond):
    bound = 0.5 * bond.bonded.dead_pressure
    start, scales = bond.start(FIRST_WORK)
    before = bond.structure.springs.factorizations
    point = control_of(bond).solve(bound, start.work, start, scales)
    assert bond.structure.springs.factorizations - before == point.steps


def test_what_cannot_be_reached_is_a_solver_error(bond):
    bound = 0.5 * bond.bonded.dead_pressure
    start, scales = bond.start(FIRST_WORK)
    nothing = replace(start, pressure=np.full_like(start.pressure, np.nan))
    with pytest.raises(SolverError, match="interior point: residual"):
        control_of(bond).solve(bound, start.work, nothing, scales)


def out_of_balance(bond: Loaded, part: float) -> tuple[_InteriorPoint, _Best]:
    """A state with products of 1e-12, and a part of its strains that belongs to no force."""
    start, scales = bond.start(FIRST_WORK)
    point = control_of(bond).solve(None, start.work, start, scales)
    structure = bond.structure
    workspace = Workspace(structure.problem)
    run = _InteriorPoint(structure.problem, structure.springs, workspace, None, start.work, scales)
    now = run.centred(point.state, 1e-12, point.state.strained.copy())
    noise = np.random.default_rng(0).normal(size=now.strained.getSize())
    largest = np.abs(whole(now.strained)).max()
    now.strained.axpy(part * largest, vector_like(now.strained, noise))
    sizes = run.sizes(now, run.residual(now))
    return run, _Best(now, sizes, max(sizes.values()), 0, now.copy())


def test_steps_towards_equilibrium_alone(bond):
    run, best = out_of_balance(bond, 1e-6)
    assert best.error == best.sizes["equilibrium"] > 1e-9
    products = best.sizes["complementarity"]
    assert 1 <= run.balance(best, 1e-10) <= 3
    assert best.error <= 1e-10
    assert best.sizes["complementarity"] == pytest.approx(products, rel=0.1)


def test_equilibrium_is_restored_though_other_residuals_are_larger(bond):
    """Where these are small enough: a state is verified by all of them."""
    run, best = out_of_balance(bond, 1e-6)
    best.sizes["opening"] = best.error = 10.0 * best.sizes["equilibrium"]
    assert 1e-9 < best.error < FOLLOWED
    assert run.balance(best, 1e-10) >= 1
    assert best.sizes["equilibrium"] <= 1e-10


def test_no_steps_where_equilibrium_is_not_what_is_missing(bond):
    run, best = out_of_balance(bond, 0.0)
    best.sizes["opening"] = best.error = 1e-3
    assert run.balance(best, 1e-10) == 0
    assert run.balance(best, 1.0) == 0


def test_the_last_iterate_counts_where_only_equilibrium_is_missing(bond):
    """Though another had a smaller error before: steps to balance are all that it needs."""
    run, best = out_of_balance(bond, 1e-6)
    larger = 0.5 * best.error
    assert best.joints < 1e-10 < larger
    said = iter([{"equilibrium": 1e-12, "opening": larger, "complementarity": 1e-12}])
    sizes = run.sizes
    # The first iterate is said to be near, the others are told as they are.
    run.sizes = lambda now, residual: next(said, None) or sizes(now, residual)
    run.step = lambda now, residual, close: None
    found = run.converge(best.iterate.copy(), False, 1e-10, window=1)
    assert found.error <= 1e-10
    assert found.sizes["equilibrium"] <= 1e-10


@pytest.mark.parametrize(
    ("falls", "cold", "window", "steps"),
    [(0.85, False, 8, 1), (0.5, False, 8, 34), (0.95, True, 8, 8), (0.95, False, 0, 6)],
)
def test_last_steps_end_where_one_leaves_most(bond, falls, cold, window, steps):
    run, best = out_of_balance(bond, 0.0)
    left = iter(falls**k for k in range(100))
    run.sizes = lambda now, residual: {"opening": next(left), "complementarity": 1e-12}
    run.step = lambda now, residual, close: None
    assert run.converge(best.iterate.copy(), cold, 1e-10, window=window).steps == steps


@pytest.mark.parametrize("larger", [1e2, 1e3, 1e4])
def test_large_motion_takes_no_digits_from_the_directions(bond, larger):
    """A^-1 b and A^-1 f_L are as large as the motion; what is left of both balances the forces."""
    start, scales = bond.start(larger * FIRST_WORK)
    point = control_of(bond).solve(None, start.work, start, scales)
    assert point.residuals["equilibrium"] <= 1e-13


@pytest.mark.parametrize("bound", [None, 1.0], ids=["coulomb", "given"])
def test_directions_solve_the_linearised_equations_of_points_that_give(bond, bound):
    """Written out: blocks, openings, slips and products, each with what it is to change by."""
    start, scales = bond.start(FIRST_WORK)
    structure, random = bond.structure, np.random.default_rng(5)
    count = len(structure.problem.friction)
    give = scales.displacement / scales.force * random.uniform(0.1, 10.0, (2, count))
    problem = replace(structure.problem, give=give)
    given = None if bound is None else np.full(count, bound * scales.force)
    run = PathEquations(problem, structure.springs, Workspace(problem), given, start.work, scales)
    now = run.start(start, 0.1)
    residual, springs = run.residual(now), run.factor(now)
    opening, slip = run.joint_displacements(now.u)
    assert residual.opening == pytest.approx(now.y - opening - give[0] * now.pressure)
    assert residual.slip == pytest.approx(now.z2 - now.z1 - slip - give[1] * now.shear)
    changes = tuple(run.unit * random.normal(size=(3, count)))
    missing = replace(residual, equilibrium=residual.equilibrium.copy())
    (step,) = run.directions(now, springs, [(missing, changes)], first=True)
    opening, slip = run.joint_displacements(step.u)
    friction = run.friction if bound is None else 0.0

    def same(one: np.ndarray, other: np.ndarray) -> None:
        assert one == pytest.approx(other, abs=1e-8 * np.abs(other).max())

    same(step.y - opening - give[0] * step.pressure, -residual.opening)
    same(step.z2 - step.z1 - slip - give[1] * step.shear, -residual.slip)
    same(now.y * step.pressure + now.pressure * step.y, changes[0])
    same(now.s1 * step.z1 + now.z1 * step.s1, changes[1])
    same(now.s2 * step.z2 + now.z2 * step.s2, changes[2])
    same(step.s1, friction * step.pressure - step.shear)
    same(step.s2, friction * step.pressure + step.shear)
    balance = missing.equilibrium.duplicate()
    problem.stiffness.mult(step.u, balance)
    run.add_joint_forces(balance, -step.pressure, -step.shear)
    balance.axpy(-step.load_factor, problem.live)
    same(whole(balance), -whole(missing.equilibrium))
    assert problem.live.dot(step.u) == pytest.approx(-residual.work, abs=1e-9 * start.work)


@pytest.mark.parametrize("cancelling", [0.0, np.inf])
def test_digits_are_kept_from_where_they_cancel(bond, cancelling, monkeypatch):
    """One more solve per factor, from the first direction on that is a small difference."""
    monkeypatch.setattr("fenics_contact.solvers.kkt.CANCELLING", cancelling)
    start, scales = bond.start(1e4 * FIRST_WORK)
    springs, factors = bond.structure.springs, []

    def noted(right, solution):
        factors.append(springs.factorizations)
        original(right, solution)

    original = springs.solve_transposed
    monkeypatch.setattr(springs, "solve_transposed", noted)
    point = control_of(bond).solve(None, start.work, start, scales, tolerance=1e-9)
    assert len(set(factors)) == len(factors)  # once per factor
    if cancelling:
        assert point.residuals["equilibrium"] <= 1e-9
        assert len(factors) <= BALANCING  # those steps keep digits in any case
    else:
        assert len(factors) == point.steps  # the first step's corrector is a direction too
        assert point.residuals["equilibrium"] <= 1e-13


def test_of_iterates_within_the_tolerance_the_last_counts(bond):
    """Though rounding left less of an earlier one: the load factor had not settled."""
    run, best = out_of_balance(bond, 0.0)
    left = iter((1e-4, 1e-10, 5e-10, 8e-10, 6e-10))
    run.sizes = lambda now, residual: {"opening": next(left), "complementarity": 1e-12}

    def step(now, residual, close):
        now.load_factor = 1.0 - (1.0 - now.load_factor) ** 2

    run.step = step
    best.iterate.load_factor = 0.9
    found = run.converge(best.iterate, False, 1e-9, settled=1e-6)
    assert found.steps == 4
    assert found.iterate.load_factor == pytest.approx(1.0, abs=1e-14)


def test_corrector_has_the_weight_that_makes_the_step_longest(bond):
    """What is left of openings tells how long a step was."""
    start, scales = bond.start(FIRST_WORK)
    point = control_of(bond).solve(None, start.work, start, scales)
    structure = bond.structure
    parts = structure.problem, structure.springs, Workspace(structure.problem)
    run = _InteriorPoint(*parts, None, start.work, scales)
    parts_taken = []
    for seed in range(10):
        noise = 1.0 + np.random.default_rng(seed).normal(size=point.state.pressure.size)
        moved = replace(point.state, pressure=np.abs(noise) * point.state.pressure)
        for close in (False, True):
            now = run.centred(moved, 1e-6)
            before = run.residual(now)
            run.step(now, before, close)
            after = run.sizes(now, run.residual(now))["opening"]
            parts_taken.append(1.0 - after / run.sizes(now, before)["opening"])
    whole, weighted = np.reshape(parts_taken, (-1, 2)).T
    assert np.all(weighted >= whole - 1e-9)
    assert np.any(weighted > 1.2 * whole)


@pytest.mark.parametrize("products", [1e-10, 1e-16])
def test_slip_keeps_its_digits_next_to_the_bound(bond, products):
    """Newton's directions change slips by what the displacements do, to rounding."""
    start, scales = bond.start(FIRST_WORK)
    point = control_of(bond).solve(None, start.work, start, scales)
    structure = bond.structure
    parts = structure.problem, structure.springs, Workspace(structure.problem)
    run = _InteriorPoint(*parts, None, start.work, scales)
    now = run.centred(point.state, products, point.state.strained.copy())
    sliding = np.abs(now.z2 - now.z1) > 1e-3 * scales.displacement
    assert np.any(sliding)
    residual = run.residual(now)
    wanted = 0.1 * products * run.unit
    changes = wanted - now.y * now.pressure, wanted - now.s1 * now.z1, wanted - now.s2 * now.z2
    springs = run.factor(now, 1e10, 1e-8)
    (change,) = run.directions(now, springs, [(residual, changes)], first=True)
    _, slip = run.joint_displacements(change.u)
    left = residual.slip + change.z2 - change.z1 - slip
    assert np.abs(left[sliding]).max() <= 1e-13 * scales.displacement
    # The other equations hold as well: those of the products, and of the bound.
    for one, other, change_of_one, change_of_other, asked in (
        (now.s1, now.z1, change.s1, change.z1, changes[1]),
        (now.s2, now.z2, change.s2, change.z2, changes[2]),
    ):
        product = change_of_one * other + one * change_of_other
        size = np.abs(change_of_one * other) + np.abs(one * change_of_other) + np.abs(asked)
        assert np.abs(product - asked)[sliding] == pytest.approx(0.0, abs=1e-12 * size.max())
    bound = structure.problem.friction * change.pressure
    forces = np.abs(change.pressure).max() + scales.force
    assert np.abs(bound - change.shear - change.s1).max() <= 1e-12 * forces
    assert np.abs(bound + change.shear - change.s2).max() <= 1e-12 * forces


def test_mixed_laws():
    # A head joint with shear strength between two blocks that slide by Coulomb's law.
    model = wall([[1, 1]], (0.4, 0.4), 1)
    usual = on_ground(model, coulomb(0.3))
    scene = Scene(
        usual.mesh,
        usual.materials,
        dead=usual.dead,
        live=usual.live,
        joints={"head": JointLaw("tresca", bound=1e3)},
        foundations={"base": coulomb(0.3)},
    )
    loaded = Loaded.of(scene)
    start, scales = loaded.start(FIRST_WORK)
    point = control_of(loaded).solve(None, start.work, start, scales)
    assert point.state.load_factor == pytest.approx(0.3, rel=1e-8)
    bound = loaded.structure.all_points(point.bound)
    on_base = loaded.structure.joints.law == 1
    head_strength = 1e3 * loaded.structure.joints.length
    assert bound[~on_base] == pytest.approx(head_strength[~on_base], rel=1e-12)
