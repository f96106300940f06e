"""Where blocks are and what they do, for people: centres of area, and words for their motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import JointLaw, Load, equilibrium, limit_load
from fenics_contact.meshing import polygons, wall
from fenics_contact.output.view import view_of
from fenics_contact.results.words import mechanism_record
from tests.drawing import rectangle
from tests.helpers import on_ground

ROUGH = JointLaw(friction=0.5)
SMOOTH = JointLaw(friction=0.1)

#: Corners, finer towards one side, and centre of area by hand.
SHAPES = {
    "L": ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], (2.5 / 3, 2.5 / 3)),
    "triangle": ([(0, 0), (3, 0), (0, 1.5)], (1.0, 0.5)),
    "trapezium": ([(0, 0), (2, 0), (1, 1), (0, 1)], (7.0 / 9.0, 4.0 / 9.0)),
    "many points on one side": (
        [(0, 0), (1, 0), *((1.0, 0.5 * (k / 20) ** 2) for k in range(1, 20)), (1, 0.5), (0, 0.5)],
        (0.5, 0.25),
    ),
}


@pytest.mark.mpi
@pytest.mark.parametrize("name", SHAPES)
def test_the_place_of_a_block_is_its_centre_of_area(name):
    """A block that slides on the ground moves by 1 over its live load, without turning."""
    corners, centre = SHAPES[name]
    found = limit_load(on_ground(polygons([corners], 0.3), SMOOTH))
    assert found.load_factor == pytest.approx(0.1, rel=1e-6)
    assert found.blocks["centre"][0] == pytest.approx(centre, rel=1e-12)
    end = found.collapse
    moves = mechanism_record(view_of(found.layout, end.mode, end.joints).blocks)
    assert moves["centre"] == pytest.approx(centre, rel=1e-12)
    assert found.blocks["mode"][0] * found.blocks["live_load"][0] == pytest.approx([1.0, 0.0])


def overhang():
    """Each block 0.4 m further out than the one below: the upper two tip."""
    steps = [(0.4 * k, 0.2 * k) for k in range(3)]
    return polygons([rectangle(x, y, x + 1.0, y + 0.2) for x, y in steps], 0.2)


def wedge():
    """A smooth block between two that stand, wider above: it slides down neither."""
    outer = [rectangle(0.0, 0.0, 1.0, 1.0), rectangle(1.5, 0.0, 2.5, 1.0)]
    return polygons([*outer, rectangle(1.0, 0.4, 1.5, 0.9)], 0.25)


@pytest.mark.parametrize(
    ("model", "body", "words"),
    [
        (lambda: wall([[1.0]], (1.0, 0.5)), (4.0, -10.0), "block 0 at (0.5, 0.25) slides"),
        (lambda: wall([[1.0]], (1.0, 0.5)), (-9.0, -10.0), "block 0 at (0.5, 0.25) slides"),
        (lambda: wall([[1.0]], (0.2, 1.0)), (3.0, -10.0), "block 0 at (0.1, 0.5) turns"),
        (overhang, (0.0, -10.0), "blocks 1 at (0.9, 0.3), 2 at (1.3, 0.5) turn"),
        (lambda: wall([[1.0], [1.0]], (1.0, 0.5)), (0.0, 10.0), "fall"),
        (wedge, (0.0, -10.0), "block 2 at (1.25, 0.65) falls"),
    ],
)
def test_blocks_that_do_not_stand_do_what_is_said(model, body, words):
    law = JointLaw(friction=0.35)
    scene = on_ground(model(), law, dead=Load(body))
    if model is wedge:
        scene = replace(scene, joints={"default": JointLaw(law="frictionless")})
    reason = equilibrium(scene, 0.0).reason
    assert reason.startswith("there is no equilibrium under the dead load alone: ")
    assert reason.endswith(words)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("friction", "body"), [(0.0, (9.81, 0.0)), (0.0, (-3.0, 0.0)), (0.0, (0.01, 0.0))]
)
def test_a_load_factor_of_0_is_0(friction, body):
    """Blocks on smooth ground carry nothing sideways, in either direction."""
    smooth = {"base": JointLaw(friction=friction)}
    scene = on_ground(wall([[1.0], [1.0]], (1.0, 0.5)), ROUGH, live=Load(body), foundations=smooth)
    found = limit_load(replace(scene, solve=replace(scene.solve, direction="both")))
    assert (found.load_factor, found.load_factor_negative) == (0.0, 0.0)
    text = found.summary(verbose=True)
    assert text.splitlines()[1] == "no other collapse state exists"
    assert text.count("= 0   bracket: between 0 and 0") == 2
    assert not np.signbit([found.load_factor, found.load_factor_negative]).any()
