"""Contact laws: points with equal products solve them, and bound and dissipation fit together."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.solvers.compiled import call
from fenics_contact.solvers.joint_law import PointLaws, Slacks

MU = 1e-3
P, Q = (array.ravel() for array in np.meshgrid([-2.0, -0.03, 0.0, 0.04, 1.5], [-1.2, -0.01, 0.3]))

#: Points with friction, with a given strength, and with neither, in turn.
KIND = np.arange(len(P)) % 3
ROUGH = np.where(KIND == 0, 0.6, 0.0)
LAW = PointLaws(ROUGH, np.where(KIND == 1, 0.2, 0.0), 0.4 * ROUGH)
CARRIED = KIND < 2


def next_to(law: PointLaws, carried, difference, q, mu: float) -> Slacks:
    """Slacks with products mu, and r_N - w_N and q as given; units are one."""
    found, none = np.empty((7, len(q))), np.zeros(len(q))
    state = np.maximum(-difference, 0.0), none, np.maximum(difference, 0.0), q
    call("slacks_next_to", law.compiled(1.0, carried), mu, 1.0, 0.0, *state, found)
    return Slacks(*found)


def test_states_solve_the_laws():
    at = next_to(LAW, CARRIED, P, Q, MU)
    assert np.all(at.positive > 0.0)
    for product in (at.y * at.pressure, at.s1 * at.z1, at.s2 * at.z2):
        assert product == pytest.approx(np.full_like(product, MU))
    bound = LAW.bound(at.pressure)[CARRIED]
    assert (at.s1 + at.shear)[CARRIED] == pytest.approx(bound)
    assert (at.s2 - at.shear)[CARRIED] == pytest.approx(bound)
    assert np.all(at.shear[~CARRIED] == 0.0)
    opening = at.y + LAW.dilation(at.z1, at.z2)
    assert (at.pressure - opening) == pytest.approx(P)
    assert (at.shear - at.slip)[CARRIED] == pytest.approx(Q[CARRIED])


def test_laws_without_products_are_those_of_signorini_and_coulomb():
    law = PointLaws(LAW.friction, LAW.strength)
    at = next_to(law, CARRIED, P, Q, 1e-16)
    assert np.minimum(at.y, at.pressure) == pytest.approx(np.zeros_like(P), abs=1e-7)
    slides, friction = np.abs(at.slip) > 1e-6, law.friction > 0.0
    assert np.any(slides & friction) and np.any(~slides & friction)
    at_bound = slides & friction
    assert np.abs(at.shear[at_bound]) == pytest.approx(0.6 * at.pressure[at_bound], abs=1e-7)
    assert np.all(at.shear[at_bound] * at.slip[at_bound] <= 0.0)


@pytest.mark.parametrize("mu", [1.0, 1e-6, 1e-16])
def test_states_with_given_forces_less_displacements(mu):
    """Of any sizes; where a joint dilates, p = r_N - w_N + D (z1 + z2) is solved for."""
    random = np.random.default_rng(0)
    friction, size = random.uniform(0.05, 2.0, 500), 10.0 ** random.uniform(-9.0, 2.0, (2, 500))
    dilatancy = friction * random.choice([0.0, 0.01, 0.3, 1.0], 500)
    strength = random.choice([0.0, 1e-3, 1.0], 500)
    difference, q = size * random.normal(size=(2, 500))
    law = PointLaws(friction, strength, dilatancy)
    at = next_to(law, law.frictional, difference, q, mu)
    assert at.y * at.pressure == pytest.approx(np.full(500, mu), rel=1e-13)
    left = at.pressure - (at.y + law.dilation(at.z1, at.z2)) - difference
    assert np.abs(left / (np.abs(difference) + np.abs(q) + np.sqrt(mu))).max() <= 1e-13
    left = at.shear - at.slip - q
    assert np.abs(left / (np.abs(difference) + np.abs(q) + np.sqrt(mu))).max() <= 1e-7
