"""Round blocks that may roll: what small displacements know of them, and what not."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import JointLaw, Load, Material, Scene, equilibrium, limit_load
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons
from tests.helpers import mesh_of, rectangle
from tests.quick import slow


def disc(x: float, y: float, radius: float, chords: int = 120) -> np.ndarray:
    """Outline with a node at the lowest place."""
    angle = np.linspace(-0.5 * np.pi, 1.5 * np.pi, chords + 1)[:-1]
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def on_floor(
    outlines: list, slope: float, friction: float, gap: float = 1e-3, degree: int = 1
) -> Scene:
    """Discs on a floor; the weight leans by a slope in degrees."""
    width = max(abs(one[:, 0]).max() for one in outlines) + 1.0
    floor = rectangle(-width, -0.5, width, 0)
    ground = {"fix": [((-width, -0.5), (width, -0.5))]}
    angle = np.radians(slope)
    return Scene(
        mesh_of(polygons([*outlines, np.array(floor, float)], 0.2, groups=ground)),
        {"default": Material(5e9, 0.2, 2000.0)},
        dead=Load((10.0 * float(np.sin(angle)), -10.0 * float(np.cos(angle)))),
        live=Load((10.0, 0.0)),
        joints={"default": JointLaw(friction=friction, gap=gap)},
        supports={"fix": "fixed"},
        degree=degree,
    )


@pytest.mark.parametrize("degree", [1, *slow(2)])
@pytest.mark.parametrize(("radius", "slope"), [(1.0, 3.0), (1.0, 1.0), (0.5, 2.0), (2.0, 1.0)])
def test_disc_on_a_slope_is_not_said_to_stand(radius, slope, degree):
    scene = on_floor([disc(0.0, radius, radius)], slope, 0.6, degree=degree)
    found = equilibrium(scene, 0.0)
    assert found.status != "equilibrium"
    assert "roll" in found.reason or found.status == "unstable"
    assert any("sqrt(2 gap / R)" in text for text in found.layout.warnings)


@pytest.mark.parametrize("degree", [1, *slow(2)])
@pytest.mark.parametrize("chords", [120, 121, 90])
def test_disc_on_level_ground_stands(chords, degree):
    scene = on_floor([disc(0.0, 1.0, 1.0, chords)], 0.0, 0.6, degree=degree)
    assert equilibrium(scene, 0.0).status == "equilibrium"


def test_disc_that_is_pushed_is_not_verified_without_a_warning():
    # By hand 0: what is found is the arm that the gap allows, with a warning.
    result = limit_load(on_floor([disc(0.0, 1.0, 1.0)], 0.0, 0.6))
    assert result.load_factor < np.sqrt(2.0 * 1e-3) + 2.0 * np.pi / 120
    assert "radius" in result.collapse.contradiction
    assert "verified as drawn, but blocks roll" in result.summary()
    assert "no other collapse state" not in result.summary()


def test_disc_that_touches_at_a_node_rolls_off():
    # A node on a flat side is a point, and any push rolls it.
    result = limit_load(on_floor([disc(0.0, 1.0, 1.0, 40)], 0.0, 0.6, gap=0.0))
    assert result.load_factor == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("friction", "stands"), [(0.25, False), (0.29, True)])
def test_three_discs_stand_with_friction_tan_15_degrees(friction, stands):
    # Two on the floor, one on top: tan 15 degrees = 0.268.
    pile = [disc(-1.0, 1.0, 1.0), disc(1.0, 1.0, 1.0), disc(0.0, 1.0 + np.sqrt(3.0), 1.0)]
    found = equilibrium(on_floor(pile, 0.0, friction, gap=1e-3), 0.0)
    assert (found.status == "equilibrium") == stands


def test_arcs_that_lie_along_each_other_do_not_roll():
    angle = np.radians(np.linspace(60.0, 120.0, 13))
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    lower = np.vstack([ray, [[-0.5, 0.0], [0.5, 0.0]]])
    upper = np.vstack([1.002 * ray[::-1], [[0.501, 1.5], [-0.501, 1.5]]])
    scene = on_floor([upper, lower], 0.0, 0.6, gap=5e-3)
    with Discretization(scene) as made:
        assert not np.any(made.joints.curvature > 0.0)
        assert not any("curved" in text for text in made.warnings)
    assert equilibrium(scene, 0.0).status == "equilibrium"


@pytest.mark.parametrize("corners", [10, 13, 19])
def test_straight_side_beside_a_curved_one_does_not_roll(corners):
    # A beam with rounded ends lies on its flat side.
    angle = np.radians(np.linspace(-90.0, 90.0, corners))
    end = 0.2 * np.column_stack([np.cos(angle), np.sin(angle)])
    beam = np.vstack([np.add(end, [1.0, 0.2]), np.subtract([-1.0, 0.2], end)])
    result = limit_load(on_floor([beam], 0.0, 0.3, gap=1e-3))
    assert result.load_factor == pytest.approx(0.3, rel=1e-4)
    assert not result.collapse.contradiction
