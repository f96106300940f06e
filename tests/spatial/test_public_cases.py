"""Public examples that can be drawn by hand, as docs/verification.md shows them."""

from __future__ import annotations

import math

import pytest

from benchmarks.public_cases import (
    LINE,
    falling_wedge,
    figures,
    scene,
    sliding_wedge,
    stands,
    wedge_reactions,
)
from fenics_contact.spatial import limit_load
from tests.quick import some

FIGURES = figures()


@pytest.mark.parametrize("name", some(list(FIGURES), 3))
def test_public_case(name):
    figure = FIGURES[name]()
    assert figure.passed, figure.row()


def test_sliding_wedge_by_hoek_and_bray():
    """F = (R_A + R_B) tan(phi) / (W sin(psi)) is 1 at 33.357 degrees; psi = 37.058 degrees."""
    critical = math.degrees(math.atan(-LINE[2] / wedge_reactions()))
    assert math.degrees(-math.asin(LINE[2])) == pytest.approx(37.058, abs=1e-3)
    assert critical == pytest.approx(33.357, abs=1e-3)
    falls, holds = (math.tan(math.radians(critical + more)) for more in (-0.5, 0.5))
    assert stands(sliding_wedge(), holds)
    assert not stands(sliding_wedge(), falls)


@pytest.mark.parametrize("degrees", [20.0, 31.0, 45.0])
def test_wedge_in_a_roof_falls_without_stresses(degrees):
    """3DEC's falling wedge: the force that holds it is its weight, whatever the friction."""
    friction = math.tan(math.radians(degrees))
    assert not stands(falling_wedge(), friction)
    found = limit_load(scene(falling_wedge(), friction)).ends["positive"]
    assert found.status in ("unstable", "no_equilibrium")
