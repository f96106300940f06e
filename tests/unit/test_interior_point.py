"""States by the interior point method: elastic branch, plateau, starts from far away."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import JointLaw, Load, Scene, SolverError
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.meshing import wall
from fenics_contact.solvers.interior_point import (
    InteriorPointOptions,
    Tolerances,
    solve_interior_point,
)
from fenics_contact.solvers.kkt import PerturbedKKT
from tests.bank import BANK, GRAVITY, PUSH, Recipe, coulomb, outlined, tresca
from tests.unit.core import BOND, FAR, Array, conditions, dense, load_case, misses, solved

LIFT = Load((0.0, GRAVITY))  # the weight upwards


@pytest.fixture(scope="module")
def bond() -> Iterator[LoadCase]:
    """A small wall in running bond on rigid ground."""
    with load_case(BOND.scene(1)) as made:
        yield made


@pytest.fixture(scope="module")
def block() -> Iterator[LoadCase]:
    """A block as wide as high."""
    recipe = Recipe(lambda n, quads: wall([[1]], (0.4, 0.4), n, quads), coulomb(0.5))
    with load_case(recipe.scene(2)) as made:
        yield made


def program(case: LoadCase, bound: Array) -> float:
    """Limit load of rigid blocks with given friction."""
    return case.blocks.collapse(case.discretization.all_points(bound))[0]


@pytest.mark.parametrize("friction", [0.05, 0.1, 0.5, 2.0])
def test_plateau_is_the_rigid_limit_load(bond, friction):
    bound = friction * bond.first_pressure
    found = solved(bond, given=bound)
    assert found.state.load_factor == pytest.approx(program(bond, bound), rel=1e-8)
    assert found.steps <= 40


@pytest.mark.parametrize("degree", [1, 2])
def test_plateau_of_a_wall_with_a_lintel(degree):
    courses = [[1, 1, 1], [1, -1, 1], [0.5, 2, 0.5]]
    usual = Recipe(lambda n, quads: wall(courses, elements=n), coulomb(0.6)).scene(1)
    with load_case(replace(usual, degree=degree)) as case:
        bound = 0.6 * case.first_pressure
        assert solved(case, given=bound).state.load_factor == pytest.approx(
            program(case, bound), rel=1e-8
        )


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("ratio", [1.0, 10.0, FAR])
def test_state_meets_all_conditions(bond, ratio, given):
    bound = 0.5 * bond.first_pressure
    found = solved(bond, ratio, bound if given else None)
    assert found.error <= 1e-11
    assert set(found.residuals) == {"equilibrium", "opening", "slip", "work", "complementarity"}
    bound = bound if given else bond.problem.bound(found.state.pressure)
    left = misses(bond, found.state, bound)
    assert left.pop("equilibrium") < 1e-8
    assert max(left.values()) < 1e-10, left


def test_elastic_branch_is_the_response_with_closed_joints(block):
    """Small load, high friction: nothing opens or slips, and the load factor follows from K."""
    problem = block.problem
    b_n, stiffness = dense(problem.normal), dense(problem.stiffness)
    rows = np.vstack([b_n, dense(problem.tangential)])
    count = len(stiffness)
    system = np.block([[stiffness, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    loads = np.zeros((len(system), 2))
    loads[:count] = np.column_stack([problem.dead, problem.live])
    # Columns: response to the dead and to the live load; below, minus the joint forces.
    together = np.linalg.solve(system, loads) @ [1.0, 0.05]
    pressure = -together[count : count + len(b_n)]
    assert np.all(pressure > 0.0)
    work = float(problem.live @ together[:count])
    bound = np.full(len(problem.friction), 1e2 * block.scales.force)
    kkt = block.given(bound, work, block.scales_at(work))
    state = solve_interior_point(kkt, block.bonded_state(work), 1.0, Tolerances()).state
    assert state.load_factor == pytest.approx(0.05, rel=1e-7)
    u = together[:count]
    assert state.displacement == pytest.approx(u, abs=1e-7 * np.abs(u).max())
    assert state.pressure == pytest.approx(pressure, abs=1e-6 * pressure.max())


def test_load_factor_rises_to_the_plateau_and_stays(block):
    bound = 0.3 * block.first_pressure
    ratios = (0.05, 0.2, 1.0, 5.0, 50.0, 500.0)
    factors = [solved(block, ratio, bound).state.load_factor for ratio in ratios]
    assert np.all(np.diff(factors) > -1e-9)
    assert factors[1] > 1.05 * factors[0]
    exact = block.problem.sum(bound) / -block.problem.dead[1::2].sum()
    assert factors[-2:] == pytest.approx([exact] * 2, rel=1e-8)


def test_coulomb_bound_follows_the_pressure(block):
    """Half of the weight: sliding, whatever the distribution of pressure."""
    assert solved(block).state.load_factor == pytest.approx(0.5, rel=1e-8)


def test_prescribed_load_factor(block):
    """Below the limit load the state is the one whose work leads to that load factor."""
    state = solved(block, 1.0).state
    assert state.load_factor < 0.49
    kkt = replace(conditions(block, 1.0), work=0.0, load_factor=state.load_factor)
    start = block.bonded_state(0.3 * state.work)
    found = solve_interior_point(kkt, start, 1.0, Tolerances()).state
    assert found.load_factor == state.load_factor
    assert found.work == pytest.approx(state.work, rel=1e-7)
    above = replace(kkt, load_factor=0.6)
    with pytest.raises(SolverError, match="interior point: residual"):
        solve_interior_point(above, start, 1.0, Tolerances())


def test_frictionless_joints_have_no_shear():
    """A wedge in a notch, lifted by its weight."""
    notch = [(0, 0), (4, 0), (4, 2), (2, 1), (0, 2)]
    base = {"foundations": {"base": coulomb(1.0)}, "live": LIFT}
    outlines = [notch, [(2, 1), (4, 2), (0, 2)]]
    with load_case(outlined(outlines, JointLaw("frictionless"), 0.8, **base).scene(2)) as case:
        state = solved(case).state
        joints, points = case.discretization.joints, case.discretization.operators.points
        assert state.load_factor == pytest.approx(1.0, rel=1e-8)
        assert np.all(state.shear[joints.law[points] == 0] == 0.0)


@pytest.mark.parametrize(("live", "expected"), [(PUSH, 0.0), (LIFT, 1.0)])
def test_frictionless_blocks_on_level_ground(live, expected):
    """Nothing holds them sideways, but the states under work control are well defined."""
    recipe = Recipe(lambda n, quads: wall([[1], [1]], (0.4, 0.2), n), parts={"live": live})
    with load_case(recipe.scene(1)) as case:
        none = np.zeros_like(case.first_pressure)
        factor = solved(case, given=none).state.load_factor
        assert factor == pytest.approx(expected, abs=1e-8)


def test_mixed_laws():
    """A head joint with shear strength between two blocks that slide by Coulomb's law."""
    usual = Recipe(lambda n, quads: wall([[1, 1]], (0.4, 0.4), n), coulomb(0.3)).scene(1)
    parts = {"joints": {"head": tresca(1e3)}, "foundations": {"base": coulomb(0.3)}}
    scene = Scene(usual.mesh, usual.materials, usual.live, dead=usual.dead, **parts)
    with load_case(scene) as case:
        assert solved(case).state.load_factor == pytest.approx(0.3, rel=1e-8)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_start_from_far_away(bond, seed):
    bound, random = 0.5 * bond.first_pressure, np.random.default_rng(seed)
    kkt = conditions(bond, given=bound)
    u = 10.0 * kkt.scales.displacement * random.standard_normal(len(bond.problem.dead))
    forces = 20.0 * kkt.scales.force * random.standard_normal((2, len(bound)))
    far = bond.problem.state(u, -3.0, *forces)
    kept = [far.displacement.copy(), far.pressure.copy()]
    state = solve_interior_point(kkt, far, 1.0, Tolerances()).state
    assert state.load_factor == pytest.approx(program(bond, bound), rel=1e-8)
    assert np.array_equal(far.displacement, kept[0]) and np.array_equal(far.pressure, kept[1])


def test_warm_start_takes_fewer_steps(bond):
    bound = 0.5 * bond.first_pressure
    cold = solved(bond, given=bound)
    kkt = conditions(bond, given=1.001 * bound)
    warm = solve_interior_point(kkt, cold.state, 1e-6, Tolerances())
    assert warm.state.load_factor == pytest.approx(program(bond, 1.001 * bound), rel=1e-8)
    assert warm.steps < cold.steps


def test_every_step_is_one_factorisation(bond):
    tally = bond.discretization.tally
    before = tally.count
    assert solved(bond).steps == tally.count - before


# ---- where it ends


def last(kkt: PerturbedKKT, case: LoadCase, tolerances: Tolerances, **options: float):
    start = case.bonded_state(kkt.work)
    return solve_interior_point(kkt, start, 1.0, tolerances, InteriorPointOptions(**options))


def test_looser_tolerances_take_fewer_steps(bond):
    kkt = conditions(bond, given=0.5 * bond.first_pressure)
    found = [last(kkt, bond, Tolerances(tolerance)) for tolerance in (1e-4, 1e-8, 1e-12)]
    assert found[0].steps < found[1].steps < found[2].steps
    for solution, tolerance in zip(found, (1e-4, 1e-8, 1e-12), strict=True):
        assert solution.error <= tolerance


def test_load_factor_comes_to_rest_where_that_is_asked_for(bond):
    """On the elastic branch residuals may be small while the load factor still changes."""
    kkt, exact = conditions(bond, 3.0), solved(bond, 3.0).state.load_factor
    loose, rest = (last(kkt, bond, Tolerances(1e-5, rest)) for rest in (np.inf, 1e-6))
    assert rest.steps > loose.steps
    error = abs(rest.state.load_factor - exact)
    assert error <= 2e-6 < abs(loose.state.load_factor - exact)


def test_too_few_steps_are_an_error_that_says_how_far_they_led(bond):
    with pytest.raises(SolverError, match=r"residual \d.*e.* after 3 steps, asked 1.0e-12"):
        last(conditions(bond), bond, Tolerances(), max_steps=3)


def test_what_is_acceptable_is_no_error(bond):
    found = last(conditions(bond), bond, Tolerances(), max_steps=6, acceptable=1.0)
    assert 1e-12 < found.error <= 1.0 and found.steps == 6


def test_state_that_is_not_a_number_is_an_error(bond):
    kkt = conditions(bond)
    start = bond.bonded_state(kkt.work)
    nothing = replace(start, pressure=np.full_like(start.pressure, np.nan))
    with pytest.raises(SolverError, match="interior point: residual"):
        solve_interior_point(kkt, nothing, 1.0, Tolerances())


def test_stall_at_a_fold_of_the_central_path():
    """Friction so high that the path turns back; `arclength` passes it."""
    with load_case(BANK["W1 bracket 1"].scene()) as case:
        before = case.discretization.tally.count
        with pytest.raises(SolverError, match="interior point: residual"):
            solved(case)
        steps = case.discretization.tally.count - before
        assert steps < InteriorPointOptions().max_steps
