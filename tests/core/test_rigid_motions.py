"""Rigid motions: which of them supports leave free, and what holds a structure as a whole."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import InputError, Load, Scene
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.elasticity import assemble
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.materials import displacement_space
from fenics_contact.discretization.rigid_motions import RigidBodies, rigid_bodies
from fenics_contact.discretization.supports import find_supports
from fenics_contact.meshing import wall
from tests.helpers import PUSH, STONE, coulomb, grid_blocks, mesh_of


def bodies_of(model, kinds: dict[str, str]) -> RigidBodies:
    """Rigid motions of blocks on supports."""
    scene = Scene(mesh_of(model), {"default": STONE}, live=PUSH, supports=kinds)
    space = displacement_space(scene)
    boundary = collect_boundary(scene.mesh, space)
    supports = find_supports(scene, boundary)
    return rigid_bodies(assemble(scene, space, boundary, supports), supports, boundary)


def square(angle: float = 0.0):
    return grid_blocks(((0, 0), (1, 1), (2, 2))).turned(angle).model()


def free_motions(bodies: RigidBodies) -> list[int]:
    return [int(np.any(free != 0.0, axis=0).sum()) for free in bodies.free]


@pytest.mark.parametrize("degrees", [0.0, 30.0])
@pytest.mark.parametrize(
    ("kinds", "free"),
    [
        ({}, 3),
        ({"bottom0": "roller"}, 1),
        ({"bottom0": "roller", "top0": "roller"}, 1),
        ({"bottom0": "roller", "left0": "roller"}, 0),
        ({"bottom0": "fixed"}, 0),
    ],
)
def test_number_of_free_motions(kinds, free, degrees):
    bodies = bodies_of(square(np.radians(degrees)), kinds)
    assert free_motions(bodies) == [free]
    assert bodies.floating.tolist() == [free > 0]
    gram = bodies.free[0].T @ bodies.free[0]
    assert gram == pytest.approx(np.diag(np.diag(gram)), abs=1e-14)
    assert np.trace(gram) == pytest.approx(free, abs=1e-14)


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
