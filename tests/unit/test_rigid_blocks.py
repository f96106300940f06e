"""Limit loads of rigid blocks: closed forms, collapse modes, independence of the mesh."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import JointLaw, Load
from fenics_contact.analysis.rigid_blocks import LimitBounds, RigidBlocks, straight_faces
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import running_bond, wall
from tests.bank import (
    BANK,
    GRAVITY,
    PUSH,
    STONE,
    WEIGHT,
    Known,
    Recipe,
    block_recipe,
    coulomb,
    known,
    on_slope,
    stack_recipe,
    tresca,
)
from tests.unit.core import dense

WIDTH, HEIGHT = 0.4, 1.0
BLOCK_WEIGHT = STONE.density * GRAVITY * WIDTH * HEIGHT
SMOOTH = JointLaw("frictionless")

#: Closed forms that do not depend on whether slip is associative.
SIMPLE = ("bloc", "stac", "tril", "tilt")


def block(law: JointLaw, **parts) -> Recipe:
    """A block on the ground; arguments as those of a scene."""
    parts.setdefault("live", PUSH)
    return replace(block_recipe(WIDTH, HEIGHT, 0.0, **parts), law=law)


def bond(law: JointLaw) -> Recipe:
    """Two bricks long and three courses high."""
    return Recipe(lambda n, quads: running_bond(2, 3, (0.4, 0.2), n), law)


@contextmanager
def programs(recipe: Recipe | Known, **how) -> Iterator[tuple[RigidBlocks, Discretization]]:
    with Discretization(recipe.scene(**{"elements": 1, **how})) as made:
        yield RigidBlocks(made.joints, made.bodies, made.scene.comm), made


# ---- load factors


CLOSED = [item for item in known("closed-form", without=("wedge",)) if item.name[:4] in SIMPLE]


@pytest.mark.mpi
@pytest.mark.parametrize("item", CLOSED, ids=lambda item: item.name)
def test_statically_determinate_blocks(item):
    with programs(item) as (blocks, _):
        assert blocks.stands() == (item.status != "unstable")
        if blocks.stands():
            assert blocks.limit() == pytest.approx(item.expected, rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("name", ["W1", "W2", "W3", "W4"])
@pytest.mark.parametrize("law", ["tresca 0.5 kPa", "tresca 8 kPa", "bracket 0.65", "bracket 10"])
def test_walls_of_the_literature(name, law):
    item = BANK[f"{name} {law}"]
    with programs(item) as (blocks, _):
        assert blocks.limit() == pytest.approx(item.interval[1], abs=5.1e-6)


@pytest.mark.parametrize("strength", [100.0, 2000.0, 1e5])
def test_given_shear_strength(strength):
    expected = min(strength * WIDTH / BLOCK_WEIGHT, WIDTH / HEIGHT)
    with programs(block(tresca(strength))) as (blocks, _):
        assert blocks.limit() == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("friction", "strength"), [(0.2, 2e4), (0.9, 2e3), (0.0, 2e3)])
def test_rough_joint_on_a_base_of_given_strength(friction, strength):
    """Faces of both kinds in one program: either slides, or all tips."""
    weight = 2.0 * STONE.density * GRAVITY * 0.5 * 0.2
    expected = min(friction, strength * 0.5 / weight, 0.5 / 0.4)
    recipe = stack_recipe(2, friction, foundations={"base": tresca(strength)})
    with programs(recipe) as (blocks, _):
        assert blocks.limit() == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("friction", "live", "expected"),
    [
        (0.5, WEIGHT, np.inf),  # pressed on the ground
        (0.5, Load((0.0, GRAVITY)), 1.0),  # lifted
        (0.2, Load((GRAVITY, -GRAVITY)), 0.25),  # down and to the right
        (1.1, Load((0.3 * GRAVITY, -GRAVITY)), np.inf),  # within the cone
        (0.2, Load((0.1 * GRAVITY, 0.0)), 2.0),  # a tenth of the weight
    ],
)
def test_directions_of_the_live_load(friction, live, expected):
    with programs(block(coulomb(friction), live=live)) as (blocks, _):
        assert blocks.limit() == pytest.approx(expected, rel=1e-9)
        assert blocks.bounds().upper == pytest.approx(expected, rel=1e-9)
        assert (blocks.associative_pressure() is None) == (expected == np.inf)
        strength = np.zeros(len(blocks.associative_pressure())) if expected < np.inf else None
        if strength is not None:
            assert blocks.collapse(strength)[0] is not None


@pytest.mark.parametrize("held", ["fixed sill", "roller at the back"])
def test_blocks_on_supports_take_part(held):
    """A roller takes no shear: a push up along it lifts the whole weight."""
    if held == "fixed sill":
        sill = Recipe(lambda n, quads: wall([[2], [1]], (0.5, 0.2), n), coulomb(0.3))
        recipe, free = replace(sill, parts={"foundations": {}, "supports": {"base": "fixed"}}), 1
        expected = 0.3
    else:
        lift = {"live": Load((0.0, GRAVITY)), "supports": {"left": "roller"}}
        drawn = Recipe(lambda n, quads: wall([[1]], (0.5, 0.5), n), coulomb(0.3))
        recipe, free, expected = replace(drawn, parts=lift), 1, 1.0
    with programs(recipe) as (blocks, made):
        assert np.count_nonzero(made.bodies.floating) == free
        assert blocks.limit() == pytest.approx(expected, rel=1e-9)


# ---- bounds


@pytest.mark.parametrize(("degrees", "stands"), [(10.0, True), (16.0, True), (17.5, False)])
def test_block_on_a_slope_needs_its_friction(degrees, stands):
    """tan(16.7) = 0.3 is the friction."""
    recipe = block(coulomb(0.3), **on_slope(degrees, (-GRAVITY, 0.0)))
    with programs(recipe) as (blocks, _):
        bounds = blocks.bounds()
        assert bounds.lower is None and not bounds.stands_frictionless
        assert bounds.stands == blocks.stands() == stands
        assert not blocks.stands(friction=False)


@pytest.mark.parametrize(
    ("bounds", "text"),
    [
        (LimitBounds(0.0, 0.5, True, True), "between 0 and 0.5"),
        (LimitBounds(None, 0.5, True, False), "at most 0.5"),
        (LimitBounds(0.25, None, True, True), "at least 0.25"),
        (LimitBounds(None, None, True, False), "with unknown bounds"),
    ],
)
def test_bounds_are_shown_and_reversed(bounds, text):
    assert str(bounds) == text
    back = bounds.reversed()
    assert back.reversed() == bounds
    assert back.lower == (None if bounds.upper is None else -bounds.upper)


# ---- collapse with given friction


@pytest.mark.mpi
@pytest.mark.parametrize("strength", [300.0, 3e3, 1e5])
@pytest.mark.parametrize("shape", ["block", "bond", "lintel"])
def test_collapse_mode_proves_its_load_factor(shape, strength):
    """Admissible, f_L.v = 1, and it dissipates what the loads do."""
    courses = [[1, 1, 1], [1, -1, 1], [0.5, 2, 0.5]]
    recipe = {
        "block": block(coulomb(0.6)),
        "bond": bond(coulomb(0.6)),
        "lintel": Recipe(lambda n, quads: wall(courses, elements=n), coulomb(0.6)),
    }[shape]
    with programs(recipe) as (blocks, made):
        problem = made.problem
        factor, motion = blocks.collapse(strength * made.joints.length)
        mode = made.rigid_motion(motion)
        assert problem.dot(problem.live, mode) == pytest.approx(1.0, rel=1e-9)
        assert problem.max(-(problem.normal @ mode)) < 1e-9 * problem.max(np.abs(mode))
        bound = strength * made.joints.length[made.operators.points]
        dissipation = problem.sum(bound * np.abs(problem.tangential @ mode))
        power = factor + problem.dot(problem.dead, mode)
        assert dissipation == pytest.approx(power, abs=1e-9 * max(dissipation, factor))


@pytest.mark.parametrize("friction", [0.1, 5.0])
def test_collapse_ignores_coulombs_coefficient(friction):
    with programs(block(coulomb(friction))) as (blocks, made):
        factor, motion = blocks.collapse(500.0 * made.joints.length)
        assert factor == pytest.approx(500.0 * WIDTH / BLOCK_WEIGHT, rel=1e-9)
        # Sliding: to the right, without rotation.
        assert motion[0] == pytest.approx([1.0 / BLOCK_WEIGHT, 0.0, 0.0], rel=1e-9, abs=1e-15)
        factor, motion = blocks.collapse(1e6 * made.joints.length)
        assert factor == pytest.approx(WIDTH / HEIGHT, rel=1e-9)
        (a, b, c), (x, y) = motion[0], made.bodies.centre[0]
        assert c < 0.0  # clockwise, about its right edge
        assert np.abs([a + c * y, b + c * (WIDTH - x)]).max() < 1e-9 * np.abs(motion[0]).max()


@pytest.mark.parametrize("associative", [True, False])
def test_limit_does_not_depend_on_the_mesh(associative):
    limits = []
    for elements, degree in ((1, 1), (2, 1), (4, 1), (1, 2)):
        usual = bond(coulomb(0.55)).scene(elements)
        with Discretization(replace(usual, degree=degree)) as made:
            blocks = RigidBlocks(made.joints, made.bodies, made.scene.comm)
            strength = 800.0 * made.joints.length
            limits.append(blocks.limit() if associative else blocks.collapse(strength)[0])
    assert limits[1:] == pytest.approx([limits[0]] * 3, rel=1e-9)
    assert 0.0 < limits[0] < 1.0


# ---- faces


def test_straight_faces_are_the_joints_between_two_blocks():
    recipe = Recipe(lambda n, quads: running_bond(2, 2, (0.4, 0.2), n), coulomb(0.5))
    with programs(recipe, elements=3) as (_, made):
        joints = made.joints
        faces = straight_faces(joints, 1e3 * joints.length)
    # 2 on the ground, 1 + 2 head joints, and 4 stretches of the bed joint.
    assert len(faces.ends) == 2 + 3 + 4
    ends = joints.position[faces.ends]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert sorted(np.round(length, 12)) == [0.2] * 7 + [0.4] * 2
    assert faces.strength == pytest.approx(1e3 * length, rel=1e-12)
    assert np.array_equal(np.bincount(faces.of_point), np.where(length > 0.3, 7, 4))
    assert np.all(faces.friction == 0.5)


# ---- normal forces of the associative limit state


@pytest.mark.mpi
@pytest.mark.parametrize("law", [coulomb(0.3), coulomb(1.0), tresca(2e3), SMOOTH])
def test_associative_pressure_of_a_block_balances_it(law):
    """It acts at the ends of the face, where weight and load have their resultant."""
    with programs(block(law), elements=4) as (blocks, made):
        pressure, x = blocks.associative_pressure(), made.joints.position[:, 0]
        moment = BLOCK_WEIGHT * 0.5 * (WIDTH + blocks.limit() * HEIGHT)
    assert np.all(pressure >= 0.0)
    assert pressure.sum() == pytest.approx(BLOCK_WEIGHT, rel=1e-9)
    assert pressure @ (x - x.min()) == pytest.approx(moment, rel=1e-7)
    assert np.all(pressure[(x > x.min() + 1e-9) & (x < x.max() - 1e-9)] == 0.0)


def test_no_associative_pressure_without_equilibrium():
    recipe = block(SMOOTH, **on_slope(10.0, (0.0, GRAVITY)))
    with programs(recipe) as (blocks, made):
        assert blocks.limit() is None
        assert blocks.associative_pressure() is None
        assert dense(made.problem.normal).shape[0] == len(made.joints.length)
