"""The perturbed conditions: points with equal products, and Newton's directions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import JointLaw
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.solvers.kkt import COLD, Iterate, PerturbedKKT, Products, Residual
from tests.bank import Recipe, coulomb, tresca
from tests.unit.core import BOND, FAR, Array, conditions, load_case, noisy, solved


@pytest.fixture(scope="module")
def case() -> Iterator[LoadCase]:
    with load_case(BOND.scene(1)) as made:
        yield made


@pytest.fixture(scope="module")
def mixed() -> Iterator[LoadCase]:
    """Frictionless joints, and given strength on the ground."""
    parts = {"foundations": {"base": tresca(1e3)}}
    with load_case(Recipe(BOND.draw, JointLaw("frictionless"), parts).scene(1)) as made:
        yield made


def start_of(kkt: PerturbedKKT, case: LoadCase, mu: float, nearest: float = 0.0) -> Iterate:
    return kkt.on_central_path(case.bonded_state(kkt.work), mu, nearest)


def unit_of(kkt: PerturbedKKT) -> float:
    return kkt.scales.force * kkt.scales.displacement


def same(one: Array, other: Array, of: Array | None = None, rel: float = 1e-8) -> None:
    size = np.abs(other if of is None else of).max()
    assert one == pytest.approx(other, abs=rel * size)


# ---- points with equal products


@pytest.mark.parametrize("mu", [1.0, 1e-6])
@pytest.mark.parametrize("given", [False, True])
def test_all_products_are_equal(case, given, mu):
    kkt = conditions(case, given=case.first_pressure if given else None)
    now = start_of(kkt, case, mu)
    products = kkt.products(now)
    expected, rough = np.full_like(now.y, mu * unit_of(kkt)), kkt.frictional
    for product in (products.normal, products.lower, products.upper):
        assert product == pytest.approx(expected, rel=1e-9)
    assert np.all(now.positive > 0.0)
    assert kkt.mean_product(now) == pytest.approx(mu, rel=1e-9)
    assert (now.s1 + now.s2)[rough] == pytest.approx(
        2.0 * kkt.bound(now.pressure)[rough], rel=1e-12
    )
    assert (now.s2 - now.s1)[rough] == pytest.approx(
        2.0 * now.shear[rough], abs=1e-9 * kkt.scales.force
    )


def test_point_next_to_a_state_keeps_forces_less_displacements(case):
    kkt, state = conditions(case), solved(case).state
    now, problem = kkt.on_central_path(state, 1e-3), case.problem
    d, f = kkt.scales.displacement, kkt.scales.force
    opening, slip = problem.normal @ state.displacement, problem.tangential @ state.displacement
    p, q = state.pressure / f - opening / d, state.shear / f - slip / d
    assert now.pressure / f - now.y / d == pytest.approx(p, abs=1e-12 * np.abs(p).max())
    assert now.shear / f - now.slip / d == pytest.approx(q, abs=1e-9 * np.abs(q).max())
    assert np.array_equal(now.u, state.displacement)
    assert now.load_factor == state.load_factor
    assert kkt.state(now).load_factor == state.load_factor
    forced = replace(kkt, load_factor=0.25).on_central_path(state, 1e-3)
    assert forced.load_factor == 0.25


def test_state_from_elsewhere_keeps_a_distance_from_its_bound(case):
    kkt = conditions(case)
    far = replace(case.bonded_state(kkt.work), shear=1e3 * kkt.scales.force + case.first_pressure)
    now = kkt.on_central_path(far, 1e-12, COLD)
    assert np.minimum(now.s1, now.s2).min() >= COLD * kkt.bound(now.pressure).min()
    near = kkt.on_central_path(far, 1e-12)
    assert near.s1.min() < now.s1.min()


def test_points_without_friction_have_no_shear(mixed):
    kkt = conditions(mixed)
    now = start_of(kkt, mixed, 1e-2)
    smooth = ~mixed.problem.frictional
    assert np.array_equal(kkt.frictional, ~smooth)
    assert np.any(smooth) and np.any(~smooth)
    assert np.all(now.shear[smooth] == 0.0)
    assert kkt.count == len(smooth) + 2 * np.count_nonzero(~smooth)
    linear = kkt.linearize(now)
    assert np.all(linear.k_t[smooth] == 0.0) and np.all(linear.k_t[~smooth] > 0.0)
    zero = np.zeros_like(now.y)
    (step,) = linear.directions([(kkt.residual(now), Products(zero, zero, zero))])
    for name in ("shear", "s1", "s2", "z1", "z2"):
        assert np.all(getattr(step, name)[smooth] == 0.0)


# ---- residuals


def test_residual_of_a_state_is_nothing_and_of_another_is_what_it_lacks(case):
    kkt, state = conditions(case), solved(case).state
    now = kkt.on_central_path(state, 1e-12)
    sizes = kkt.sizes(now, kkt.residual(now))
    assert set(sizes) == {"equilibrium", "opening", "slip", "work", "complementarity"}
    assert max(sizes.values()) < 1e-5
    moved = replace(now, load_factor=now.load_factor + 0.1)
    change = kkt.residual(moved).equilibrium - kkt.residual(now).equilibrium
    same(change, -0.1 * case.problem.live)
    more = replace(kkt, work=0.5 * kkt.work)
    assert more.sizes(now, more.residual(now))["work"] == pytest.approx(1.0, rel=1e-9)
    assert replace(kkt, load_factor=0.1).residual(now).work == 0.0


def test_slip_is_measured_from_its_origin(case):
    origin = np.linspace(-1.0, 1.0, len(case.problem.friction)) * case.scales.displacement
    kkt = conditions(case)
    moved = replace(kkt, problem=replace(case.problem, slip_origin=origin))
    now = start_of(kkt, case, 1.0)
    change = moved.residual(now).slip - kkt.residual(now).slip
    same(change, origin)


# ---- directions


@pytest.mark.parametrize("compliance", [0.0, 1.0], ids=["stiff points", "points with compliance"])
@pytest.mark.parametrize("control", ["work", "load"])
@pytest.mark.parametrize("friction", ["coulomb", "given"])
def test_directions_solve_the_linearised_equations(case, friction, control, compliance):
    """Written out: blocks, openings, slips and products, each with what it is to change by."""
    random, kkt = np.random.default_rng(5), conditions(case)
    count, scales = len(case.problem.friction), kkt.scales
    soft = scales.displacement / scales.force * random.uniform(0.1, 10.0, (2, count))
    problem = replace(case.problem, compliance=compliance * soft)
    kkt = replace(kkt, problem=problem, load_factor=None if control == "work" else 0.3)
    if friction == "given":
        kkt = replace(kkt, given=np.full(count, scales.force), friction=np.zeros(count))
    now = noisy(start_of(kkt, case, 0.1), 1)
    residual, linear = kkt.residual(now), kkt.linearize(now)
    changes = Products(*(unit_of(kkt) * random.normal(size=(3, count))))
    zero = np.zeros(count)
    rest = Residual(np.zeros_like(now.u), zero, zero, 0.0)
    asked = [(residual, changes), (rest, Products(zero, zero, changes.upper))]
    together = linear.directions(asked)
    for (missing, change), step in zip(asked, together, strict=True):
        c_n, c_t = problem.compliance
        opening, slip = problem.normal @ step.u, problem.tangential @ step.u
        same(step.y - opening - c_n * step.pressure, -missing.opening, step.y)
        same(step.slip - slip - c_t * step.shear, -missing.slip, slip)
        same(now.y * step.pressure + now.pressure * step.y, change.normal, changes.upper)
        same(now.s1 * step.z1 + now.z1 * step.s1, change.lower, changes.upper)
        same(now.s2 * step.z2 + now.z2 * step.s2, change.upper, changes.upper)
        same(step.s1, kkt.friction * step.pressure - step.shear)
        same(step.s2, kkt.friction * step.pressure + step.shear)
        balance = problem.stiffness @ step.u - problem.joint_forces(step.pressure, step.shear)
        balance -= step.load_factor * problem.live
        same(balance, -missing.equilibrium, problem.joint_forces(step.pressure, step.shear))
        if control == "work":
            work = problem.dot(problem.live, step.u)
            assert work == pytest.approx(-missing.work, abs=1e-9 * kkt.work)
        else:
            assert step.load_factor == 0.0
        same(step.elastic, problem.elastic_part(step.u))
    again = linear.directions(asked[:1])[0]
    same(again.u, together[0].u)


@pytest.mark.parametrize("given", [False, True])
def test_directions_are_those_of_differences(case, given):
    """Residuals fall in proportion to a step, and products change as asked, to first order."""
    kkt = conditions(case, given=case.first_pressure + 1.0 if given else None)
    now = noisy(start_of(kkt, case, 0.1), 2)
    before, products = kkt.residual(now), kkt.products(now)
    change = Products(*(0.5 * unit_of(kkt) - p for p in vars(products).values()))
    (step,) = kkt.linearize(now).directions([(before, change)])
    for h in (0.5, 1e-5):  # residuals are linear
        after = kkt.residual(now.moved(h, step))
        for name in ("opening", "slip", "equilibrium"):
            old, new = getattr(before, name), getattr(after, name)
            size = kkt.scales.force if name == "equilibrium" else kkt.scales.displacement
            assert new == pytest.approx((1.0 - h) * old, abs=1e-9 * size)
    slope = kkt.products(now.moved(h, step)), kkt.products(now.moved(-h, step))
    for name, asked in vars(change).items():
        found = (getattr(slope[0], name) - getattr(slope[1], name)) / (2.0 * h)
        same(found, asked, rel=1e-6)


def test_response_to_the_live_load_and_work_that_is_held(case):
    kkt = conditions(case)
    linear = kkt.linearize(start_of(kkt, case, 0.1))
    problem, random = case.problem, np.random.default_rng(3)
    exact = problem.dot(problem.live, linear.live_response)
    assert linear.flexibility == pytest.approx(exact, rel=1e-14)
    assert linear.orientation == 1.0
    u = case.scales.displacement * random.normal(size=len(problem.live))
    held, factor = linear.hold_work(u, excess=0.1 * kkt.work)
    assert problem.dot(problem.live, held) == pytest.approx(-0.1 * kkt.work, rel=1e-9)
    same(held - u, factor * linear.live_response)


@pytest.mark.parametrize("mu", [1e-10, 1e-16])
def test_slip_keeps_its_digits_next_to_the_bound(case, mu):
    """Directions change slips by what the displacements do, to rounding."""
    kkt = conditions(case)
    now, d = kkt.on_central_path(solved(case).state, mu), kkt.scales.displacement
    sliding = np.abs(now.slip) > 1e-3 * d
    assert np.any(sliding)
    residual, products = kkt.residual(now), kkt.products(now)
    asked = Products(*(0.1 * mu * unit_of(kkt) - p for p in vars(products).values()))
    (step,) = kkt.linearize(now).directions([(residual, asked)])
    left = residual.slip + step.slip - case.problem.tangential @ step.u
    assert np.abs(left[sliding]).max() <= 1e-13 * d
    # The other equations hold as well: those of the products, and of the bound.
    for s, z, ds, dz, change in (
        (now.s1, now.z1, step.s1, step.z1, asked.lower),
        (now.s2, now.z2, step.s2, step.z2, asked.upper),
    ):
        size = np.abs(ds * z) + np.abs(s * dz) + np.abs(change)
        assert np.abs(ds * z + s * dz - change)[sliding].max() <= 1e-12 * size.max()
    bound = case.problem.friction * step.pressure
    forces = np.abs(step.pressure).max() + kkt.scales.force
    assert np.abs(bound - step.shear - step.s1).max() <= 1e-12 * forces
    assert np.abs(bound + step.shear - step.s2).max() <= 1e-12 * forces


@pytest.mark.parametrize("larger", [1e2, 1e3, 1e4])
def test_large_motion_takes_no_digits_from_equilibrium(case, larger):
    """A^-1 b and A^-1 f_L are as large as the motion; what is left of both balances the forces."""
    kkt, found = conditions(case, larger * FAR), solved(case, larger * FAR)
    state, problem = found.state, case.problem
    # Of a typical force; residuals count equilibrium with a weight of 1e-3.
    assert found.residuals["equilibrium"] <= 1e-12
    rest = problem.stiffness @ state.elastic - problem.dead - state.load_factor * problem.live
    rest -= problem.joint_forces(state.pressure, state.shear)
    assert np.abs(rest).max() <= 1e-9 * kkt.scales.force
    largest = np.abs(state.displacement).max()
    same(problem.elastic_part(state.displacement), state.elastic, np.array([largest]), 1e-15)


def test_units_do_not_matter(case):
    """The same iterate in other typical sizes has the same directions."""
    kkt = conditions(case)
    now = start_of(kkt, case, 0.1)
    other = replace(kkt, scales=replace(kkt.scales, displacement=7.0 * kkt.scales.displacement))
    zero = np.zeros_like(now.y)
    asked = [(kkt.residual(now), Products(zero, zero, zero))]
    one, two = (conditions.linearize(now).directions(asked)[0] for conditions in (kkt, other))
    same(one.u, two.u)
    assert one.load_factor == pytest.approx(two.load_factor, rel=1e-9)


def test_coulomb_bound_follows_the_pressure_and_a_given_one_stays(case):
    law = coulomb(0.5)
    pressure = case.first_pressure
    assert conditions(case).bound(pressure) == pytest.approx(law.friction * pressure)
    assert np.array_equal(conditions(case, given=pressure).bound(2.0 * pressure), pressure)
