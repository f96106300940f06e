"""Contact laws with equal products: what they solve, and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.solvers.smoothing import (
    Growth,
    JointStates,
    SmoothedLaws,
    distance_from_bound,
    normal_law,
)

MU = 1e-3
P, Q = (array.ravel() for array in np.meshgrid([-2.0, -0.03, 0.0, 0.04, 1.5], [-1.2, -0.01, 0.3]))


def laws(growth: Growth | None = None) -> SmoothedLaws:
    """Points with friction, with a given strength, and with neither, in turn."""
    kind = np.arange(len(P)) % 3
    friction, strength = np.where(kind == 0, 0.6, 0.0), np.where(kind == 1, 0.2, 0.0)
    return SmoothedLaws(friction, strength, kind < 2, 1e-3, growth)


@pytest.mark.parametrize("growth", [None, Growth(1e-4, 0.2)])
def test_states_solve_the_laws(growth):
    law = laws(growth)
    states = law.states(P, Q, MU)
    y, r, w, shear = states.values
    assert states.p == pytest.approx(P) and states.q == pytest.approx(Q)
    assert y * r == pytest.approx(np.full_like(y, MU))
    assert np.all(r > 0.0)
    part = 1.0 if growth is None else growth.part(MU)
    bound = part * law.friction * r + law.strength
    stick = law.sticky
    assert np.all(np.abs(shear[stick]) < bound[stick])
    # w = z2 - z1 with s1 z1 = s2 z2 = mu
    slip = MU / (bound + shear)[stick] - MU / (bound - shear)[stick]
    assert w[stick] == pytest.approx(slip, rel=1e-9, abs=1e-12)
    assert np.all(shear[~stick] == 0.0)


def test_laws_without_products_are_those_of_signorini_and_coulomb():
    y, r, w, shear = laws().states(P, Q, 1e-16).values
    assert np.minimum(y, r) == pytest.approx(np.zeros_like(y), abs=1e-7)
    slides = np.abs(w) > 1e-6
    friction = laws().friction > 0.0
    assert np.any(slides & friction) and np.any(~slides & friction)
    at_bound = slides & friction
    assert np.abs(shear[at_bound]) == pytest.approx(0.6 * r[at_bound], abs=1e-7)
    assert np.all(shear[at_bound] * w[at_bound] <= 0.0)


@pytest.mark.parametrize("growth", [None, Growth(1e-4, 0.2)])
def test_distances_from_the_laws(growth):
    """Forces and displacements that change alike leave p and q as they are."""
    law = laws(growth)
    states = law.states(P, Q, MU)
    of_p, of_q = law.sizes(states, MU)
    assert np.all(law.distances(states.values, MU) < 1e-6)
    normal, shear = np.array([1.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, 1.0])
    for part in (0.1, -0.3):
        values = states.values + part * normal[:, None] * of_p
        assert law.distances(values, MU) == pytest.approx(abs(part), abs=1e-6)
        values = states.values + part * shear[:, None] * of_q
        expected = np.where(law.sticky, abs(part), 0.0)
        assert law.distances(values, MU) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("growth", [None, Growth(1e-4, 0.2)])
def test_derivatives_are_those_of_differences(growth):
    law, h = laws(growth), 1e-6
    states, found = law.linearised(P, Q, MU)
    assert states.values == pytest.approx(law.states(P, Q, MU).values, rel=1e-6, abs=1e-9)
    for name, (p, q, mu) in {"p": (h, 0.0, 0.0), "q": (0.0, h, 0.0), "mu": (0.0, 0.0, h)}.items():
        ahead = law.states(P + p, Q + q, MU * np.exp(mu)).values
        behind = law.states(P - p, Q - q, MU * np.exp(-mu)).values
        slope = (ahead - behind) / (2.0 * h)
        assert getattr(found, name) == pytest.approx(slope, rel=1e-5, abs=1e-7)


def test_part_of_the_points():
    law, points = laws(), np.array([4, 1])
    states = law.states(P, Q, MU)
    some = law.at(points).states(P[points], Q[points], MU)
    assert np.array_equal(some.values, states.at(points).values)
    sizes = law.sizes(states, MU)
    assert np.array_equal(law.at(points).sizes(some, MU), sizes[:, points])
    assert np.all(sizes >= law.smallest)
    assert sizes[0] == pytest.approx(states.values[0] + states.values[1])


def test_differences_of_states():
    values = np.array([[1.0], [3.0], [0.5], [2.0]])
    assert JointStates(values).p == pytest.approx(2.0)
    assert JointStates(values).q == pytest.approx(1.5)


@pytest.mark.parametrize("mu", [1.0, 1e-6, 1e-12])
def test_normal_law_keeps_digits_of_both(mu):
    p = np.array([-9.0, -1e-3, 0.0, 1e-3, 9.0])
    y, r = normal_law(p, mu)
    assert y * r == pytest.approx(np.full_like(p, mu), rel=1e-14)
    assert r - y == pytest.approx(p, abs=1e-12)


@pytest.mark.parametrize("products", [1.0, 1e-6, 1e-12])
def test_distance_of_shear_from_its_bound(products):
    gamma, q = (array.ravel() for array in np.meshgrid([1e-6, 1e-2, 1.0, 50.0], [0.0, 1e-3, 1, 9]))
    s = distance_from_bound(q, gamma, products)
    assert np.all(s > 0.0) and np.all(s <= gamma)
    left = s - products / s + products / (2.0 * gamma - s)
    size = products / s + gamma + q
    assert (gamma - q - left) / size == pytest.approx(np.zeros_like(s), abs=1e-12)


def test_growth_of_friction():
    growth = Growth(1e-3, 0.5)
    assert growth.part(1e-1) == pytest.approx(0.1)
    assert growth.part(1e-4) == 1.0
    step = 1e-6
    slope = (growth.part(1e-1 * (1.0 + step)) / growth.part(1e-1) - 1.0) / step
    assert growth.rate(1e-1) == pytest.approx(slope, rel=1e-5)
    assert growth.rate(1e-4) == 0.0


def test_growth_where_a_tangent_leads_anywhere():
    growth = Growth(1e-3, 0.5)
    assert growth.part(0.0) == 1.0
    assert growth.part(np.inf) == 0.0
