"""Rigid motions: which of them supports leave free, and what holds a structure as a whole."""

from __future__ import annotations

import pytest

from fenics_contact import InputError, Load, Scene
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import wall
from tests.helpers import PUSH, STONE, coulomb, grid_blocks, mesh_of


def build(model, supports=None, foundations=None, live=PUSH) -> Discretization:
    joints = {"default": coulomb(0.5)}
    ground = {name: coulomb(0.5) for name in foundations or ()}
    scene = Scene(mesh_of(model), {"default": STONE}, live, joints=joints, foundations=ground,
                  supports=supports or {})  # fmt: skip
    return Discretization(scene)


STACK = grid_blocks(((0, 0), (1, 1), (1, 1)), ((0, 1), (1, 1), (1, 1)))
STACK_AND_ONE = grid_blocks(*(((x, y), (1, 1), (1, 1)) for x, y in ((0, 0), (0, 1), (5, 0))))


@pytest.mark.parametrize(
    ("drawing", "holds", "message"),
    [
        (STACK, {}, r"2 blocks, .* touch neither a support"),
        (STACK_AND_ONE, {"foundations": ["bottom0"]},
         r"1 blocks, the first around \(5\.5, 0\.5\), touch neither"),
        (STACK, {"supports": {"bottom0": "roller"}}, "can move all together even with closed"),
        (STACK, {"supports": {"bottom0": "fixed"}, "live": Load(traction={"left0": (1.0, 0.0)})},
         "live load is zero on every free body"),
    ],
)  # fmt: skip
def test_structure_that_is_not_held_or_not_pushed(drawing, holds, message):
    with pytest.raises(InputError, match=message), build(drawing.model(), **holds) as built:
        built.check_pushed()


@pytest.mark.parametrize("holds", ["rollers", "foundation"])
def test_rollers_or_a_foundation_hold_a_stack_as_a_whole(holds):
    rollers = holds == "rollers"
    supports, ground = ({"base": "roller", "left": "roller"}, []) if rollers else ({}, ["base"])
    with build(wall([[1], [1]], elements=1), supports, ground) as built:
        assert built.bodies.floating.tolist() == [not rollers, True]
