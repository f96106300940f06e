"""Steps on which few joint points follow their laws, and all others their tangents."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.solvers.arclength import FALLING_PRODUCTS, ArclengthOptions, Continuation
from fenics_contact.solvers.nonlinear_elimination import (
    ChosenPoints,
    EliminationOptions,
    Line,
    TangentModel,
)
from fenics_contact.solvers.smoothing import JointStates, SmoothedLaws
from tests.bank import coulomb, wall_recipe
from tests.unit.core import FAR, Place, conditions, dense, load_case

#: Products at which the tests' steps begin.
MU = 1e-3

#: All points are chosen, and solved for to many digits.
ALL = EliminationOptions(points=10**6, chosen=-1.0, solved=1e-9, newton_steps=20)


@pytest.fixture(scope="module")
def case() -> Iterator[LoadCase]:
    """A wall with so much friction that its path turns back."""
    with load_case(wall_recipe("W1", coulomb(1.0)).scene(2)) as made:
        yield made


@pytest.fixture(scope="module", params=[0.0, 0.3], ids=["stiff", "compliant"])
def place(case, request) -> Place:
    """Some way down the path, of points with and without a compliance of their own."""
    kkt = conditions(case)
    unit, count = kkt.scales.displacement / kkt.scales.force, len(case.problem.friction)
    compliance = request.param * unit * np.linspace(0.5, 1.0, 2 * count).reshape(2, -1)
    kkt = replace(kkt, problem=replace(case.problem, compliance=compliance))
    path = Continuation(kkt, FALLING_PRODUCTS, ArclengthOptions(corrections=2))
    point = path.follow(path.begin(case.bonded_state(FAR * case.bonded_work), 1.0), MU)
    return Place.at(kkt, point.iterate, point.mu)


# ---- points on their tangents


@pytest.fixture(scope="module")
def model() -> TangentModel:
    """Six points of all laws, with forces that move all of them."""
    random, count = np.random.default_rng(1), 6
    laws = SmoothedLaws(
        np.array([0.6, 0.6, 0.0, 0.3, 0.0, 0.8]),
        np.array([0.0, 0.0, 0.5, 0.1, 0.0, 0.0]),
        np.array([True, True, True, True, False, True]),
        smallest=1e-3,
    )
    start = laws.states(random.normal(size=count), random.normal(size=count), 1e-2)
    root = random.normal(size=(2 * count, 2 * count))
    c = root @ root.T
    answers = np.array([c[:count].T, c[count:].T])  # for normal forces, then shear forces
    answers = np.stack([answers[:, :count], answers[:, count:]], axis=2).reshape(2, -1, count)
    return TangentModel(
        laws,
        start.values,
        0.1 * random.normal(size=(4, count)),
        0.1 * random.normal(size=(4, count)),
        random.uniform(0.1, 2.0, (3, count)),
        random.uniform(0.0, 0.5, (2, count)),
        answers,
        1e-2,
        -1.0,
    )


def test_start_solves_the_equations_without_forces(model):
    curve = ChosenPoints(model, Line((0.0, 0.0), (1.0, 0.3)), EliminationOptions())
    start = JointStates(model.start)
    begin = curve.at(np.concatenate([start.p, start.q, [0.0]]))
    assert begin.error < 1e-6
    assert np.abs(begin.forces).max() < 1e-5
    assert begin.tau == 0.0


@pytest.mark.parametrize("line", [Line((0.0, 0.0), (1.0, 0.3)), Line((1.0, 0.2), (0.0, 1.0))])
def test_slopes_are_those_of_differences(model, line):
    curve = ChosenPoints(model, line, EliminationOptions())
    start = JointStates(model.start)
    x = 1.01 * np.concatenate([start.p, start.q, [0.4]])
    here = curve.at(x)
    for k in range(len(x)):
        h = np.zeros_like(x)
        h[k] = 1e-5 * max(abs(x[k]), 1e-2)
        slope = (curve.at(x + h).rest - curve.at(x - h).rest) / (2.0 * h[k])
        size = np.abs(here.slopes[:, k]).max()
        assert here.slopes[:, k] == pytest.approx(slope, abs=1e-4 * size)


def test_steps_along_a_curve_stay_on_it(model):
    options = EliminationOptions(solved=1e-8, newton_steps=20)
    curve = ChosenPoints(model, Line((0.0, 0.0), (1.0, 0.3)), options)
    start = JointStates(model.start)
    begin = curve.at(np.concatenate([start.p, start.q, [0.0]]))
    along = curve.direction(begin, np.eye(len(begin.x))[-1])
    assert np.abs(along / begin.sizes).max() == pytest.approx(1.0)
    assert along[-1] > 0.0
    assert begin.slopes @ along == pytest.approx(np.zeros(len(begin.rest)), abs=1e-8)
    new, _ = curve.step(begin, along, 0.1, (-1.0, 1.0))
    assert new.error <= 1e-8
    assert 0.0 < new.tau < 1.0
    end, _ = curve.step(new, curve.direction(new, along), 3.0, (-1.0, new.tau + 1e-3))
    assert end.tau == pytest.approx(new.tau + 1e-3, rel=1e-12)
    assert end.error <= 1e-8


# ---- steps of a wall


def test_answers_are_displacements_that_do_no_work_on_the_live_load(place):
    made, problem = place.elimination(1.0), place.kkt.problem
    assert 2 * EliminationOptions().points >= made.model.answers.shape[1] > 0
    b = np.concatenate([dense(problem.normal), dense(problem.tangential)])
    moved = np.array([place.linear.hold_work(place.linear.factor.solve(row))[0] for row in b]).T
    work = np.abs(problem.live)[:, None] * np.abs(moved)
    assert np.all(np.abs(problem.live @ moved) <= 1e-8 * work.sum(axis=0))
    unit = place.kkt.scales.force / place.kkt.scales.displacement
    exact = unit * (b @ moved)  # openings and slips for unit normal and shear forces
    count = len(problem.friction)
    found = np.concatenate([made.model.answers[0].T, made.model.answers[1].T])
    for k in range(0, found.shape[1], 2):
        missed = [
            np.abs(found[:, [k, k + 1]] - exact[:, [point, count + point]]).max()
            for point in range(count)
        ]
        assert min(missed) <= 1e-8 * np.abs(found[:, [k, k + 1]]).max()


@pytest.mark.mpi
@pytest.mark.parametrize("reach", [None, (-0.5, 0.5), (-3.0, 3.0)])
def test_step_with_all_points_chosen_is_exact(place, reach):
    """Whatever its length, it ends on the path."""
    made = place.elimination(1.0, ALL)
    step = made.step(reach, place.linear.orientation, 0.3)
    assert step.reached
    (now, mu), kkt = place.arrived(step), place.kkt
    assert kkt.mean_product(now) == pytest.approx(mu, rel=1e-9)
    sizes = kkt.sizes(now, kkt.residual(now))
    sizes.pop("complementarity")
    assert max(sizes.values()) <= 1e-7
    if reach is not None:
        assert abs(step.s) > 0.1


def test_step_without_chosen_points_is_one_along_tangents(place):
    made = place.elimination(1.0, EliminationOptions(points=0))
    step = made.step((-3.0, 3.0), place.linear.orientation, 0.3)
    assert made.model.answers.shape[1] == 0
    assert step.reached
    before = place.linear.now.load_factor
    expected = before + place.across.load_factor + step.s * place.along.load_factor
    assert step.moved.load_factor == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("solved", [1e-2, 1e-6])
def test_no_point_is_farther_from_its_law_than_allowed(place, solved):
    """Chosen points follow theirs; what is left of equilibrium is what their forces changed by."""
    options = EliminationOptions(solved=solved, newton_steps=20)
    made = place.elimination(place.linear.orientation, options)
    step = made.step((-3.0, 3.0), place.linear.orientation, options.allowed)
    assert step.reached
    mu = place.mu * np.exp(-step.s)
    distances = made.model.laws.distances(step.states, mu)
    assert distances.max() <= options.allowed * (1.0 + 1e-6)
    (now, _), kkt = place.arrived(step), place.kkt
    sizes = kkt.sizes(now, kkt.residual(now))
    assert sizes["equilibrium"] <= 0.1 * options.allowed
    assert sizes["work"] <= 1e-9


def test_smaller_limit_leads_less_far_and_the_same_one_to_the_same_place(place):
    made, orientation = place.elimination(place.linear.orientation), place.linear.orientation
    far, near, again = (made.step((-3.0, 3.0), orientation, limit) for limit in (0.3, 0.06, 0.3))
    assert near.reached
    assert 0.0 < abs(near.s - made.back) < abs(far.s - made.back)
    assert made.model.laws.distances(near.states, place.mu * np.exp(-near.s)).max() <= 0.06 * 1.001
    assert again.s == pytest.approx(far.s, rel=0.3)
    assert again.moved.load_factor == pytest.approx(far.moved.load_factor, rel=1e-2)


def test_tangent_leaves_the_path_with_the_square_of_the_step(case):
    kkt = conditions(case)
    path = Continuation(
        kkt, FALLING_PRODUCTS, ArclengthOptions(close=1e-9, corrections=30, elimination=ALL)
    )
    point = path.follow(path.begin(case.bonded_state(kkt.work), 1.0), 1e-1)
    model = Place.at(kkt, point.iterate, point.mu).elimination(0.0).model
    left = [case.problem.max(model.distances(1.0, s)) for s in (1e-1, 1e-2)]
    assert left[0] < 0.1
    assert left[1] < 0.02 * left[0]
