"""Ways after the peak against closed solutions, in the plane and in space."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tests.motion.closed import CASES, HIGH, SLENDER, THICK, spread
from tests.motion.structures import arch, box, in_plane, way_down

#: Cases that are asked always.
QUICK = ["free wall"]


@cache
def followed(name):
    """A case's way, and by how much its load factors are off."""
    return CASES[name]()


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CASES],
)
def test_load_factors_are_those_by_hand(name):
    found, off = followed(name)
    assert max(off) < 1e-6
    assert len(off) > 5
    assert found.fine.energy < 1e-2


def test_free_wall_falls_where_its_centre_is_above_its_toe():
    found, _ = followed("free wall")
    assert found.zero == pytest.approx(HIGH * np.sin(SLENDER), rel=1e-6)
    assert found.fine.energy < 1e-4
    assert found.fine.overlap < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wall with a tie of 0.1 MN/m", "wall with a tie of 1 MN/m"])
def test_wall_with_a_tie_rises_and_falls(name):
    found, _ = CASES[name]()
    factor = [point.load_factor for point in found.fine.points]
    assert factor[0] == pytest.approx(1.0 / 6.0, abs=1e-6)
    assert max(factor) > 0.68
    assert found.zero == pytest.approx(1.8847, abs=1e-4)


@pytest.mark.slow
def test_reversed_load_goes_the_other_way():
    scene = in_plane([box(0, 0, THICK, HIGH)], push=1.0)
    mirrored = in_plane([box(0, 0, THICK, HIGH)], push=-1.0)
    there, back = way_down(scene), way_down(mirrored)
    assert back.zero == pytest.approx(there.zero, rel=1e-9)
    assert back.place[0] == pytest.approx(THICK - there.place[0], abs=1e-12)


def test_tie_without_stiffness_begins_at_the_limit():
    tie = {"from": [0.0, 2.7], "ground": [-4.0, 2.7], "yield": 8e3}
    scene = in_plane([box(0, 0, 0.5, 3.0)], friction=0.8, density=1800.0, ties={"t": tie})
    found = way_down(scene)
    assert found.fine.points[0].load_factor == pytest.approx(0.71032960, abs=1e-6)
    assert found.zero == pytest.approx(1.8847, abs=1e-4)
    assert found.fine.energy < 1e-3


@pytest.mark.slow
def test_tie_is_shorter_again_as_the_upper_storey_turns():
    """Two mechanisms share the motion: the load factor of the upper storey sets the tension.

    A wall of two storeys of 0.5 x 3 m, tied below its middle: the lower one leans on until the
    upper one turns, and goes back as less is left; the end is that of the upper one alone.
    """
    tie = {"from": [0.0, 2.9], "ground": [-4.0, 2.9], "yield": 8e3, "stiffness": 1e6}
    blocks = [box(0, 3.0 * k, 0.5, 3.0 * (k + 1)) for k in range(2)]
    found = way_down(in_plane(blocks, friction=0.7, ties={"t": tie}))
    assert found.agrees
    assert found.zero == pytest.approx(3.0 * np.sin(np.arctan(0.5 / 3.0)), abs=1e-5)
    assert found.fine.energy < 1e-3
    factors = [point.load_factor for point in found.fine.points]
    assert factors[0] == pytest.approx(0.5 / 6.0, abs=1e-7)
    assert max(factors) == pytest.approx(1.0 / 6.0, rel=0.03)
    assert max(point.gap for point in found.fine.points) < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("thickness", "end"),
    [(0.12, 1.675), (0.15, 7.012), (0.2, 13.472)],
)
def test_semicircle_on_spreading_springers(thickness, end):
    """Per cent of the span at which it falls, by the exact three-hinge arch."""
    found, weight = spread(30, thickness)
    assert found.fine.why == "support lost"
    assert 100.0 * found.end == pytest.approx(end, abs=2e-3)
    assert found.driven
    thrust = [point.load_factor / weight for point in found.fine.points]
    assert np.all(np.diff(thrust) > 0.0)
    assert "it is pressed with" in found.head


@pytest.mark.slow
def test_arch_rolls_on_hinges_that_change():
    """15 voussoirs, t/R 0.15, sideways: nothing is left at 15.769 mm of the crown."""
    blocks = arch(15, 0.15)
    found = way_down(in_plane(blocks, fixed=[15, 16], friction=1.0, density=2400.0))
    assert found.fine.points[0].load_factor == pytest.approx(0.150465309, abs=1e-7)
    assert found.zero == pytest.approx(0.015769, abs=2e-6)
    assert found.agrees


@pytest.mark.slow
def test_units_and_size_change_nothing():
    """A wall a tenth as large, of another density: the same curve."""
    small = in_plane([0.1 * np.array(box(0, 0, THICK, HIGH))], density=7.0)
    found = way_down(small)
    assert found.zero == pytest.approx(0.1 * HIGH * np.sin(SLENDER), rel=1e-6)
