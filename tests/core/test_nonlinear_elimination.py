"""Steps on which few joint points follow their laws, and all others their tangents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.solvers.arclength import FALLING_PRODUCTS, ArclengthOptions, Continuation
from fenics_contact.solvers.joint_law import JointStates, PointLaws
from fenics_contact.solvers.nonlinear_elimination import (
    ChosenPoints,
    EliminationOptions,
    Line,
    TangentModel,
)
from tests.bank import coulomb, wall_recipe
from tests.core.problems import Place, conditions, dense, prepared

#: All points are chosen, and solved for to many digits.
ALL = EliminationOptions(points=10**6, chosen=-1.0, solved=1e-9, newton_steps=20)

#: A wall with so much friction that its path turns back.
case = prepared(wall_recipe("W1", coulomb(1.0)), 2)


@pytest.fixture(scope="module", params=[0.0, 0.3], ids=["stiff", "compliant"])
def place(case, request) -> Place:
    """Some way down the path, of points with and without a compliance of their own."""
    kkt, count = conditions(case), case.problem.points
    unit = kkt.scales.displacement / kkt.scales.force
    compliance = request.param * unit * np.linspace(0.5, 1.0, 2 * count).reshape(2, -1)
    kkt = replace(kkt, problem=replace(case.problem, compliance=compliance))
    path = Continuation(kkt, FALLING_PRODUCTS, ArclengthOptions(elimination=ALL))
    point = path.follow(path.begin(case.bonded_state(kkt.work), 1.0), 1e-3)
    return Place.at(kkt, point.iterate, point.mu)


# ---- points on their tangents


@pytest.fixture(scope="module")
def model() -> TangentModel:
    """Six points of all laws, with forces that move all of them."""
    random, count = np.random.default_rng(1), 6
    friction, strength = [0.6, 0.6, 0.0, 0.3, 0.0, 0.8], [0.0, 0.0, 0.5, 0.1, 0.0, 0.0]
    dilatancy = [0.0, 0.2, 0.0, 0.3, 0.0, 0.1]
    law = PointLaws(np.array(friction), np.array(strength), np.array(dilatancy))
    laws = law.smoothed(1.0, np.arange(6) != 4, smallest=1e-3)
    start = laws.states(random.normal(size=count), random.normal(size=count), 1e-2)
    root = random.normal(size=(2 * count, 2 * count))
    c = (root @ root.T).reshape(2, count, 2, count)  # openings and slips at all points
    return TangentModel(
        laws,
        start.values,
        correction=0.1 * random.normal(size=(5, count)),
        tangent=0.1 * random.normal(size=(5, count)),
        springs=random.uniform(0.1, 2.0, (5, count)),
        compliance=random.uniform(0.0, 0.5, (2, count)),
        answers=c.transpose(0, 3, 2, 1).reshape(2, -1, count),
        mu=1e-2,
        log_mu_rate=-1.0,
    )


def test_curve_begins_without_forces_and_steps_along_it_stay_on_it(model):
    options, start = EliminationOptions(solved=1e-8, newton_steps=20), JointStates(model.start)
    curve = ChosenPoints(model, Line((0.0, 0.0), (1.0, 0.3)), options)
    begin = curve.at(np.concatenate([start.p, start.q, [0.0]]))
    assert begin.error < 1e-6 and np.abs(begin.forces).max() < 1e-5
    along = curve.direction(begin, np.eye(len(begin.x))[-1])
    assert np.abs(along / begin.sizes).max() == pytest.approx(1.0)
    assert begin.slopes @ along == pytest.approx(np.zeros(len(begin.rest)), abs=1e-8)
    new, _ = curve.step(begin, along, 0.1, (-1.0, 1.0))
    assert new.error <= 1e-8 and 0.0 < new.tau < 1.0
    end, _ = curve.step(new, curve.direction(new, along), 3.0, (-1.0, new.tau + 1e-3))
    assert end.error <= 1e-8 and end.tau == pytest.approx(new.tau + 1e-3, rel=1e-12)


@pytest.mark.parametrize("line", [Line((0.0, 0.0), (1.0, 0.3)), Line((1.0, 0.2), (0.0, 1.0))])
def test_slopes_are_those_of_differences(model, line):
    curve, start = ChosenPoints(model, line, EliminationOptions()), JointStates(model.start)
    x = 1.01 * np.concatenate([start.p, start.q, [0.4]])
    for k, slopes in enumerate(curve.at(x).slopes.T):
        h = 1e-5 * max(abs(x[k]), 1e-2) * np.eye(len(x))[k]
        difference = (curve.at(x + h).rest - curve.at(x - h).rest) / (2.0 * h[k])
        assert slopes == pytest.approx(difference, abs=1e-4 * np.abs(slopes).max())


# ---- steps of a wall


def test_answers_are_displacements_that_do_no_work_on_the_live_load(place):
    made, problem = place.elimination(), place.kkt.problem
    made.step((-1.0, 1.0), 1.0)
    rows = np.concatenate([dense(problem.normal), dense(problem.tangential)])
    moved = [place.linear.hold_work(place.linear.factor.solve(row))[0] for row in rows]
    assert np.all(np.abs(moved @ problem.live) <= 1e-8 * (np.abs(moved) @ np.abs(problem.live)))
    unit = place.kkt.scales.force / place.kkt.scales.displacement
    exact = unit * (moved @ rows.T)  # openings and slips for unit normal and shear forces
    count = problem.points
    found = np.concatenate([made.model.answers[0], made.model.answers[1]], axis=1)
    assert 2 * EliminationOptions().points >= len(found) > 0
    for pair in found.reshape(-1, 2, 2 * count):
        missed = [np.abs(pair - exact[[point, count + point]]).max() for point in range(count)]
        assert min(missed) <= 1e-8 * np.abs(pair).max()


@pytest.mark.mpi
@pytest.mark.parametrize("reach", [(-0.5, 0.5), (-3.0, 3.0)])
def test_step_with_all_points_chosen_is_exact(place, reach):
    """Whatever its length, it ends on the path."""
    step = place.elimination(ALL).step(reach, place.linear.orientation)
    assert step.reached and abs(step.s) > 0.1
    now, mu = place.arrived(step)
    sizes = place.kkt.sizes(now, place.kkt.residual(now))
    assert sizes.pop("complementarity") == pytest.approx(mu, rel=1e-9)
    assert max(sizes.values()) <= 1e-7


@pytest.mark.parametrize("solved", [1e-2, 1e-6])
def test_no_point_is_farther_from_its_law_than_allowed(place, solved):
    """And a smaller limit leads less far."""
    orientation, lengths = place.linear.orientation, []
    for allowed in (0.3, 0.06):
        made = place.elimination(EliminationOptions(allowed=allowed, solved=solved))
        step = made.step((-3.0, 3.0), orientation)
        assert step.reached
        lengths.append(abs(step.s - made.back))
        distances = made.model.laws.distances(step.states, place.mu * np.exp(-step.s))
        assert 0.0 < distances.max() <= allowed * (1.0 + 1e-3)
        now, _ = place.arrived(step)
        sizes = place.kkt.sizes(now, place.kkt.residual(now))
        assert sizes["equilibrium"] <= 0.1 * allowed and sizes["work"] <= 1e-9
    assert 0.0 < lengths[1] < lengths[0]


def test_tangent_leaves_the_path_with_the_square_of_the_step(case):
    kkt = conditions(case)
    path = Continuation(kkt, FALLING_PRODUCTS, ArclengthOptions(elimination=ALL))
    point = path.follow(path.begin(case.bonded_state(kkt.work), 1.0), 1e-1)
    model = Place.at(kkt, point.iterate, point.mu).elimination().model
    left = [case.problem.max(model.distances(1.0, s)) for s in (1e-1, 1e-2)]
    assert left[0] < 0.1
    assert left[1] < 0.02 * left[0]
