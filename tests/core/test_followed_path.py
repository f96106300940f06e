"""The loading path of elastic blocks by the kernel of the face engine."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import limit_load
from fenics_contact.collapse.followed_path import points_model
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.faces.kernel import elastic_response
from fenics_contact.faces.system import Equations
from tests.bank import coulomb, wall_recipe
from tests.quick import slow


@pytest.mark.parametrize("name", ["W3", *slow("W1", "W2", "W4")])
def test_it_ends_in_the_state_of_the_path(name):
    """Both are verified by the same certificate; on coarse bricks W2 has states as near as 1e-5."""
    recipe = wall_recipe(name, coulomb(0.65))
    path, follow = (
        limit_load(recipe.scene(1, engine=engine, fast=True)) for engine in ("path", "follow")
    )
    end = follow.positive
    assert follow.status == "limit" and end.certificate.passed
    assert (end.engine, end.way, end.as_state.start) == ("path", "follow", "follow")
    assert follow.load_factor == pytest.approx(path.load_factor, rel=2e-5)
    assert end.state is not None and end.trace


def test_closed_points_and_stiffness_carry_the_loads():
    """K d + B^T C^-1 B d = f: the live load's displacements, and the energy of the dead load."""
    with Discretization(wall_recipe("W3", coulomb(0.65)).scene(1)) as whole:
        model = points_model(whole.problem)
    response = elastic_response(model, Equations(model))

    def internal(motion):
        force = model.relative(motion) / model.compliance
        return model.transposed @ force.ravel() + model.stiffness @ motion

    assert internal(response.live) == pytest.approx(model.live, abs=1e-8 * np.abs(model.live).max())
    springs = np.sum(model.compliance * response.dead_force**2)
    assert 0.0 < springs < response.dead_work
