"""Every method on walls: Coulomb's law, given shear strengths, no friction."""

from __future__ import annotations

import pytest

from fenics_contact import JointLaw, limit_load
from tests.bank import WALLS, coulomb, tresca, wall_recipe
from tests.quick import each_once

METHODS = ("auto", "fixed-point", "monolithic", "splitting", "active-set")


def solved(name: str, law: JointLaw, method: str):
    """The limit load of a wall with one element in half a brick, without other answers."""
    result = limit_load(wall_recipe(name, law).scene(1, method=method, fast=True))
    assert result.status == "limit" and result.positive.certificate.passed
    return result


@pytest.mark.parametrize(("name", "bound", "method"), each_once([*WALLS], [2e3, 8e3], METHODS))
def test_given_shear_strengths(name, bound, method):
    """The load factor is unique: both ends of the linear program of rigid blocks."""
    result = solved(name, tresca(bound), method)
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=1e-6)


@pytest.mark.parametrize(("name", "method"), each_once([*WALLS], METHODS))
def test_without_friction_nothing_pushes(name, method):
    result = solved(name, JointLaw("frictionless"), method)
    assert result.load_factor == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("name", "method"), each_once([*WALLS], METHODS))
def test_coulomb(name, method):
    """Collapse states are several: each is verified, and in the bracket."""
    result = solved(name, coulomb(0.65), method)
    bounds = result.bounds
    assert bounds.lower * (1.0 - 1e-6) <= result.load_factor <= bounds.upper * (1.0 + 1e-6)
