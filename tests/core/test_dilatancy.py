"""Joints that open as they slide: hand values, the associative limit, and the certificate."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import InputError, JointLaw, Load, Scene, SolveOptions, limit_load, sweep
from fenics_contact.meshing import polygons
from tests.bank import GRAVITY, Variant, wall_recipe
from tests.helpers import STONE, coulomb, mesh_of, on_ground
from tests.quick import each_once

FRICTION = 0.65
#: The angle of friction, degrees.
ASSOCIATIVE = math.degrees(math.atan(FRICTION))


def law(angle: float, friction: float = FRICTION) -> JointLaw:
    return JointLaw(friction=friction, dilatancy=angle)


def block() -> object:
    """A flat block, 2 m x 0.5 m."""
    return polygons([[(0.0, 0.0), (2.0, 0.0), (2.0, 0.5), (0.0, 0.5)]], 0.25)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("angle", "direction"),
    each_once([0.0, 5.0, 20.0, math.degrees(math.atan(0.4))], [1.0, -1.0]),
)
def test_block_slides_up_its_joint(angle, direction):
    """By statics at F, whatever the angle; it moves by tan(angle) upwards for each slip."""
    live = Load((direction * GRAVITY, 0.0))
    result = limit_load(on_ground(block(), law(angle, 0.4), live=live, solve=SolveOptions()))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.4, rel=1e-7)
    joints = result.joints
    slip_rate, opening_rate = joints["slip_rate"], joints["opening_rate"]
    assert np.abs(slip_rate).min() > 0.0
    slope = math.tan(math.radians(angle))
    assert opening_rate == pytest.approx(
        slope * np.abs(slip_rate), abs=1e-6 * np.abs(slip_rate).max()
    )
    assert np.all(joints["state"] == 1)  # it slips, and is not open


def between_a_wall_and_a_block(angle: float) -> Scene:
    """A block of 1 m x 1 m that hangs between a wall and a long block on the ground."""
    hanging = [(0.0, 0.5), (1.0, 0.5), (1.0, 1.0), (1.0, 1.5), (0.0, 1.5)]
    long = [(1.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 0.5)]
    lines = {
        "wall": [((0.0, 0.5), (0.0, 1.5))],
        "base": [((1.0, 0.0), (3.0, 0.0))],
        "top": [((0.0, 1.5), (1.0, 1.5))],
    }
    model = polygons([hanging, long], 0.25, groups=lines)
    rough = law(angle, 0.6)
    return Scene(
        mesh_of(model),
        {"default": STONE},
        dead=Load((0.0, -GRAVITY)),
        live=Load(traction={"top": (0.0, -STONE.density * GRAVITY)}),
        joints={"default": rough},
        foundations={"wall": rough, "base": coulomb(0.5)},
    )


@pytest.mark.parametrize("angle", [5.0, 20.0, math.degrees(math.atan(0.6))])
def test_block_wedges_itself_between_others(angle):
    """N = m (2 W + F N) moves the long block, 2 F N = (1 + lambda) W holds the other: by hand."""
    pressed = 0.5 * 2.0 / (1.0 - 0.5 * 0.6)
    result = limit_load(between_a_wall_and_a_block(angle))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(2.0 * 0.6 * pressed - 1.0, rel=1e-6)


def test_without_dilatancy_the_block_between_others_falls():
    assert limit_load(between_a_wall_and_a_block(0.0)).status != "limit"


@pytest.mark.mpi
@pytest.mark.parametrize("wall", ["W1", "W3"])
def test_with_the_angle_of_friction_the_load_factor_is_the_associative_one(wall):
    result = limit_load(wall_recipe(wall, law(ASSOCIATIVE)).scene(1))
    associative = limit_load(wall_recipe(wall, coulomb(FRICTION)).scene(1)).bounds.upper
    assert result.status == "limit"
    assert result.bounds.meet
    assert result.bounds.upper == pytest.approx(associative, rel=1e-9)
    assert result.load_factor == pytest.approx(associative, rel=1e-7)


@pytest.mark.slow
@pytest.mark.mpi
def test_variants_and_methods_agree_on_a_wall():
    """Mirrored, stiffer, of degree 2, and by the fixed point on the bound."""
    recipe = wall_recipe("W4", law(5.0))
    result = limit_load(recipe.scene(1))
    assert result.status == "limit"
    assert result.bounds.lower <= result.load_factor <= result.bounds.upper
    assert result.bounds.lower > 0.05  # without dilatancy it is 0
    others = [
        recipe.scene(1, variant=Variant(mirrored=True), direction="negative"),
        recipe.scene(1, variant=Variant(young=100.0, length=10.0)),
        recipe.scene(1, method="fixed-point"),
    ]
    for other in others:
        found = limit_load(other)
        factor = found.load_factor_negative if other.solve.direction == "negative" else None
        factor = abs(found.load_factor if factor is None else factor)
        assert factor == pytest.approx(result.load_factor, rel=2e-6)


def test_a_sweep_changes_the_dilatancy():
    recipe = wall_recipe("W4", law(0.0))
    keys = "joints.default.dilatancy, foundations.base.dilatancy"
    table = sweep(recipe.scene(1), {keys: [0.0, 10.0]})
    alone = [limit_load(wall_recipe("W4", law(angle)).scene(1)) for angle in (0.0, 10.0)]
    expected = [result.load_factor for result in alone]
    assert table.column("load_factor") == pytest.approx(expected, rel=1e-6)
    assert expected[1] > 1.1 * expected[0]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: law(-1.0), "dilatancy = -1.0 must lie in 0"),
        (lambda: law(34.0), "must not exceed the angle of friction, 33.0239 degrees"),
        (lambda: JointLaw("tresca", bound=1.0, dilatancy=5.0), "'tresca' takes no dilatancy"),
        (lambda: wall_recipe("W1", law(5.0)).scene(1, method="splitting"), "default.dilatancy"),
        (
            lambda: wall_recipe("W1", law(5.0)).scene(1, control="load", slip="load-steps"),
            "use solve.slip = 'stress-free'",
        ),
    ],
)
def test_what_is_refused(wrong, words):
    with pytest.raises(InputError, match=words):
        wrong()


def test_six_digits_of_the_angle_of_friction_are_associative():
    assert law(33.0239).dilation == law(33.0238).dilation == FRICTION
    assert replace(law(30.0)).dilation == pytest.approx(math.tan(math.radians(30.0)))
