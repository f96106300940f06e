"""Steps on which few joint points follow their laws, and all others their tangents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.solvers.arclength import FALLING_PRODUCTS, ArclengthOptions, Continuation
from fenics_contact.solvers.compiled import call, structure
from fenics_contact.solvers.nonlinear_elimination import EliminationOptions
from tests.bank import coulomb, wall_recipe
from tests.core.problems import Place, conditions, dense, prepared

#: All points are chosen, and solved for to many digits.
ALL = EliminationOptions(points=10**6, chosen=-1.0, solved=1e-9)

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
def table() -> np.ndarray:
    """Six points of all laws, with forces that move all of them: rows as in `curve.c`."""
    random, count = np.random.default_rng(1), 6
    friction, strength = [0.6, 0.6, 0.0, 0.3, 0.0, 0.8], [0.0, 0.0, 0.5, 0.1, 0.0, 0.0]
    dilatancy, carried = [0.0, 0.2, 0.0, 0.3, 0.0, 0.1], [1.0, 1.0, 1.0, 1.0, 0.0, 1.0]
    moved = random.normal(size=(15, count))
    springs, compliance = random.uniform(0.1, 2.0, (5, count)), random.uniform(0.0, 0.5, (2, count))
    return np.array([friction, strength, dilatancy, carried, *moved, *springs, *compliance])


@pytest.mark.parametrize("line", [(0.0, 0.0, 1.0, 0.3), (1.0, 0.2, 0.0, 1.0)])
def test_slopes_are_those_of_differences(table, line):
    count = table.shape[1]
    points = structure("points", count=count, table=table, mu=1e-2, log_mu_rate=-1.0, smallest=1e-3)
    root = np.random.default_rng(2).normal(size=(2 * count, 2 * count))
    c = root @ root.T

    def equations(x):
        (moved, forces), sizes = np.empty((2, 2, 2 * count)), np.empty(2 * count + 1)
        slopes, (part, s, *direction) = np.empty((2 * count + 1, 2 * count)), line
        place = part + x[-1] * direction[0], s + x[-1] * direction[1], *direction
        call("chosen_points", points, c, *place, x, moved, forces, sizes, slopes)
        slopes[-1] = moved[1] - c @ forces[1]
        return moved[0] - c @ forces[0], slopes

    x = np.append(np.random.default_rng(3).normal(size=2 * count), 0.4)
    for k, slopes in enumerate(equations(x)[1]):
        h = 1e-5 * max(abs(x[k]), 1e-2) * np.eye(len(x))[k]
        difference = (equations(x + h)[0] - equations(x - h)[0]) / (2.0 * h[k])
        assert slopes == pytest.approx(difference, abs=1e-4 * np.abs(slopes).max())


def test_points_that_a_tangent_leads_nowhere_are_infinitely_far(table):
    table = table.copy()
    table[14:19, 3] = np.nan  # the tangent
    count = table.shape[1]
    points = structure("points", count=count, table=table, mu=1e-2, log_mu_rate=-1.0, smallest=1e-3)
    found = np.empty(count)
    call("distances", points, 1.0, 0.5, np.zeros((2, count)), found)
    assert np.isinf(found[3]) and np.all(np.isfinite(np.delete(found, 3)))


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
    found = np.concatenate([made.answers[0], made.answers[1]], axis=1)
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
        now, _ = place.arrived(step)  # on the laws, with equal p and q
        d, f = place.kkt.scales.displacement, place.kkt.scales.force
        y, _, w, _, _ = step.states
        missed = np.abs(now.y / d - y) / (now.pressure / f + now.y / d)
        bound = 0.5 * (now.s1 + now.s2) / f
        missed = np.maximum(missed, np.abs(now.slip / d - w) / (bound + np.abs(now.slip) / d))
        assert 0.0 < missed.max() <= allowed * (1.0 + 1e-3)
        sizes = place.kkt.sizes(now, place.kkt.residual(now))
        assert sizes["equilibrium"] <= 0.1 * allowed and sizes["work"] <= 1e-9
    assert 0.0 < lengths[1] < lengths[0]


def test_tangent_leaves_the_path_with_the_square_of_the_step(case):
    kkt = conditions(case)
    path = Continuation(kkt, FALLING_PRODUCTS, ArclengthOptions(elimination=ALL))
    point = path.follow(path.begin(case.bonded_state(kkt.work), 1.0), 1e-1)
    step = Place.at(kkt, point.iterate, point.mu).elimination()
    left = [case.problem.max(step.distances(1.0, s)) for s in (1e-1, 1e-2)]
    assert left[0] < 0.1
    assert left[1] < 0.02 * left[0]
