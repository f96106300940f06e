"""Ways after the peak against closed solutions, in the plane and in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.motion.beyond import beyond
from tests.motion.structures import GRAVITY, arch, box, in_plane, in_space, turned, way_down

#: Thickness and height of a free wall, m.
THICK, HIGH = 0.4, 2.0
SLENDER = np.arctan2(THICK, HIGH)


def test_free_wall_turns_about_its_toe():
    """R (a - theta): lambda = tan(a - theta) down to 0."""
    found = way_down(in_plane([box(0, 0, THICK, HIGH)]))
    for point in found.fine.points:
        assert point.load_factor == pytest.approx(np.tan(SLENDER - turned(point)), abs=1e-6)
    assert found.zero == pytest.approx(HIGH * np.sin(SLENDER), rel=1e-6)
    assert found.fine.energy < 1e-4
    assert found.fine.overlap < 1e-12


def test_box_in_space_turns_alike():
    wall = {"w": {"box": [[0, 0, 0], [3, THICK, HIGH]]}}
    found = way_down(in_space(wall, (0, -1, 0)))
    for point in found.fine.points:
        assert point.load_factor == pytest.approx(np.tan(SLENDER - turned(point)), abs=1e-6)
    assert found.zero == pytest.approx(HIGH * np.sin(SLENDER), rel=1e-6)


@pytest.mark.slow
def test_stack_turns_as_one():
    found = way_down(in_plane([box(0, 0, THICK, 1.2), box(0, 1.2, THICK, HIGH)]))
    for point in found.fine.points:
        assert point.load_factor == pytest.approx(np.tan(SLENDER - turned(point)), abs=1e-6)


@pytest.mark.slow
def test_reversed_load_goes_the_other_way():
    scene = in_plane([box(0, 0, THICK, HIGH)], push=1.0)
    mirrored = in_plane([box(0, 0, THICK, HIGH)], push=-1.0)
    there, back = way_down(scene), way_down(mirrored)
    assert back.zero == pytest.approx(there.zero, rel=1e-9)
    assert back.place[0] == pytest.approx(THICK - there.place[0], abs=1e-12)


def test_block_slides_until_it_leaves_its_support():
    """Friction alone, 0.3, until the centroid is near the edge; then it topples over it."""
    found = way_down(in_plane([box(0, 0, 1, 1), box(-5, -0.5, 3, 0)], fixed=[1], friction=0.3))
    sliding = [p for p in found.fine.points if p.displacement < 2.3]
    assert [p.load_factor for p in sliding] == pytest.approx([0.3] * len(sliding), abs=1e-6)
    assert len(sliding) > 5
    assert found.end > 2.35


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [1e5, 1e6])
def test_tie_turns_and_yields(stiffness):
    thick, high, at, far, yields = 0.5, 3.0, 2.7, 4.0, 8e3
    tie = {"from": [0.0, at], "ground": [-far, at], "yield": yields, "stiffness": stiffness}
    scene = in_plane([box(0, 0, thick, high)], friction=0.8, density=1800.0, ties={"t": tie})
    found = way_down(scene)
    weight = 1800.0 * thick * high * GRAVITY
    slender, radius = np.arctan2(thick, high), 0.5 * np.hypot(thick, high)
    for point in found.fine.points:
        angle = turned(point)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        arm = turn @ [-thick, at]
        line = np.array([-far, at]) - [thick, 0.0] - arm
        length = np.hypot(*line)
        pull = min(yields, max(0.0, stiffness * (length - far))) * line / length
        held = arm[1] * -pull[0] + arm[0] * pull[1]
        exact = (weight * radius * np.sin(slender - angle) + held) / (
            weight * radius * np.cos(slender - angle)
        )
        assert point.load_factor == pytest.approx(exact, abs=1e-6)
    factor = [point.load_factor for point in found.fine.points]
    assert factor[0] == pytest.approx(1.0 / 6.0, abs=1e-6)
    assert max(factor) > 0.68
    assert found.zero == pytest.approx(1.8847, abs=1e-4)


def test_tie_without_stiffness_begins_at_the_limit():
    tie = {"from": [0.0, 2.7], "ground": [-4.0, 2.7], "yield": 8e3}
    scene = in_plane([box(0, 0, 0.5, 3.0)], friction=0.8, density=1800.0, ties={"t": tie})
    found = way_down(scene)
    assert found.fine.points[0].load_factor == pytest.approx(0.71032960, abs=1e-6)
    assert found.zero == pytest.approx(1.8847, abs=1e-4)
    assert found.fine.energy < 1e-3


def spread(count, thickness):
    """Springers of a semicircle that move apart together."""
    blocks = arch(count, thickness)
    scene = in_plane(blocks, fixed=[count, count + 1], friction=1.0, density=2400.0)
    structure = scene.structure()
    moved = np.zeros((count + 2, 6))
    moved[count, 0], moved[count + 1, 0] = -0.5, 0.5
    found = beyond(replace(structure, moved=moved))
    assert found is not None
    weight = -structure.dead[:, 2].sum()
    return found, weight


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
