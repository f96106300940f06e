"""Steps on which few joint points follow their laws, and all others their tangents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.arclength import FALLING_PRODUCTS, Continuation
from fenics_contact.solvers.compiled import call, structure
from tests.bank import coulomb, wall_recipe
from tests.core.problems import Place, conditions, prepared

#: All points are chosen, and solved for to many digits.
ALL = replace(SEARCH, points=10**6, chosen_from=-1.0, points_solved=1e-9)

#: A wall with so much friction that its path turns back.
case = prepared(wall_recipe("W1", coulomb(1.0)), 2)


@pytest.fixture(scope="module", params=[0.0, 0.3], ids=["stiff", "compliant"])
def place(case, request) -> Place:
    """Some way down the path, of points with and without a compliance of their own."""
    kkt, count = conditions(case), case.problem.points
    unit = kkt.scales.displacement / kkt.scales.force
    compliance = request.param * unit * np.linspace(0.5, 1.0, 2 * count).reshape(2, -1)
    kkt = replace(kkt, problem=replace(case.problem, compliance=compliance))
    path = Continuation(kkt, FALLING_PRODUCTS, ALL)
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


# ---- steps of a wall


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
        made = place.elimination(replace(SEARCH, allowed_distance=allowed, points_solved=solved))
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
