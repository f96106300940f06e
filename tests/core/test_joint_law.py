"""Contact laws with equal products: what they solve, and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.solvers.joint_law import PointLaws, distance_from_bound, normal_law

MU = 1e-3
P, Q = (array.ravel() for array in np.meshgrid([-2.0, -0.03, 0.0, 0.04, 1.5], [-1.2, -0.01, 0.3]))

#: Points with friction, with a given strength, and with neither, in turn.
KIND = np.arange(len(P)) % 3
ROUGH = np.where(KIND == 0, 0.6, 0.0)
LAW = PointLaws(ROUGH, np.where(KIND == 1, 0.2, 0.0), 0.4 * ROUGH)
LAWS = LAW.smoothed(1.0, KIND < 2, smallest=1e-3)


def test_states_solve_the_laws():
    states = LAWS.states(P, Q, MU)
    y, r, w, shear, dilation = states.values
    assert states.p == pytest.approx(P) and states.q == pytest.approx(Q)
    assert y * r == pytest.approx(np.full_like(y, MU))
    assert np.all(r > 0.0)
    bound = LAWS.friction * r + LAWS.strength
    rough = LAWS.frictional
    assert np.all(np.abs(shear[rough]) < bound[rough])
    # w = z2 - z1 with s1 z1 = s2 z2 = mu
    slip = MU / (bound + shear)[rough] - MU / (bound - shear)[rough]
    assert w[rough] == pytest.approx(slip, rel=1e-9, abs=1e-12)
    both = MU / (bound + shear)[rough] + MU / (bound - shear)[rough]
    assert dilation[rough] == pytest.approx(LAW.dilatancy[rough] * both, rel=1e-9)
    assert np.all(shear[~rough] == 0.0)


def test_laws_without_products_are_those_of_signorini_and_coulomb():
    y, r, w, shear, _ = LAWS.states(P, Q, 1e-16).values
    assert np.minimum(y, r) == pytest.approx(np.zeros_like(y), abs=1e-7)
    slides, friction = np.abs(w) > 1e-6, LAWS.friction > 0.0
    assert np.any(slides & friction) and np.any(~slides & friction)
    at_bound = slides & friction
    assert np.abs(shear[at_bound]) == pytest.approx(0.6 * r[at_bound], abs=1e-7)
    assert np.all(shear[at_bound] * w[at_bound] <= 0.0)


@pytest.mark.parametrize("by", range(3), ids=["p", "q", "log mu"])
def test_derivatives_are_those_of_differences(by):
    h = 1e-6
    states, found = LAWS.linearized(P, Q, MU)
    assert states.values == pytest.approx(LAWS.states(P, Q, MU).values, rel=1e-6, abs=1e-9)
    p, q, mu = h * np.eye(3)[by]
    ahead = LAWS.states(P + p, Q + q, MU * np.exp(mu)).values
    behind = LAWS.states(P - p, Q - q, MU * np.exp(-mu)).values
    slope = (ahead - behind) / (2.0 * h)
    assert found[by] == pytest.approx(slope, rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("mu", [1.0, 1e-6, 1e-12])
def test_normal_law_keeps_digits_of_both(mu):
    p = np.array([-9.0, -1e-3, 0.0, 1e-3, 9.0])
    y, r = normal_law(p, mu)
    assert y * r == pytest.approx(np.full_like(p, mu), rel=1e-14)
    assert r - y == pytest.approx(p, abs=1e-12)


@pytest.mark.parametrize("mu", [1.0, 1e-6, 1e-12])
def test_distance_of_shear_from_its_bound(mu):
    gamma, q = (array.ravel() for array in np.meshgrid([1e-6, 1e-2, 1.0, 50.0], [0.0, 1e-3, 1, 9]))
    s = distance_from_bound(q, gamma, mu)
    assert np.all(s > 0.0) and np.all(s <= gamma)
    left = s - mu / s + mu / (2.0 * gamma - s)
    size = mu / s + gamma + q
    assert (gamma - q - left) / size == pytest.approx(np.zeros_like(s), abs=1e-12)
    four = distance_from_bound(q, gamma, mu, newton_steps=4)
    assert four == pytest.approx(s, rel=2e-6)


@pytest.mark.parametrize("mu", [1.0, 1e-6, 1e-16])
def test_states_with_given_forces_less_displacements(mu):
    """Where a joint dilates, p = r_N - w_N + D (z1 + z2) is solved for."""
    random = np.random.default_rng(0)
    friction, size = random.uniform(0.05, 2.0, 500), 10.0 ** random.uniform(-9.0, 2.0, (2, 500))
    dilatancy = friction * random.choice([0.01, 0.3, 1.0], 500)
    strength = random.choice([0.0, 1e-3, 1.0], 500)
    difference, q = size * random.normal(size=(2, 500))
    laws = PointLaws(friction, strength, dilatancy).smoothed(1.0, friction > 0.0, np.sqrt(mu))
    y, r, _, _, dilation = laws.states(laws.p_of(difference, q, mu), q, mu).values
    left = r - (y + dilation) - difference
    assert np.abs(left / (np.abs(difference) + np.abs(q) + np.sqrt(mu))).max() <= 1e-13


def test_bound_and_dissipation_share_the_friction():
    """What slip takes up is less than F r_N by what it lifts: D r_N."""
    law = PointLaws(np.array([0.5]), np.array([2.0]), np.array([0.2]))
    pressure, slip = np.array([10.0]), np.array([-3.0])
    assert law.bound(pressure) == pytest.approx([7.0]) and law.given(pressure) == [5.0]
    assert law.clearance(np.array([1.0]), slip) == pytest.approx([0.4])
    work = -pressure * law.dilation(-slip, np.zeros(1)) - law.bound(pressure) * slip
    assert law.dissipation(pressure, slip) == pytest.approx(work)
    given = law.with_given(law.given(pressure))
    assert given.bound(pressure) == law.bound(pressure) and given.dissipative == [0.0]
    assert len(law.each(lambda values: values[:0]).opening_origin) == 0
