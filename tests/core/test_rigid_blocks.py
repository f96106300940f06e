"""Limit loads of rigid blocks: closed forms, collapse modes, independence of the mesh."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import JointLaw, Load
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import running_bond, wall
from tests.bank import GRAVITY, STONE, Known, Recipe, block_recipe, coulomb

WIDTH, HEIGHT = 0.4, 1.0
BLOCK_WEIGHT = STONE.density * GRAVITY * WIDTH * HEIGHT

#: Two bricks long and three courses high; and an opening under a lintel.
BOND = Recipe(lambda n, quads: running_bond(2, 3, (0.4, 0.2), n), coulomb(0.6))
COURSES = [[1, 1, 1], [1, -1, 1], [0.5, 2, 0.5]]
LINTEL = Recipe(lambda n, quads: wall(COURSES, elements=n), coulomb(0.6))


def block(law: JointLaw, **parts: object) -> Recipe:
    """A block on the ground; arguments as those of a scene."""
    return replace(block_recipe(WIDTH, HEIGHT, 0.0, **parts), law=law)


@contextmanager
def programs(recipe: Recipe | Known, elements: int = 1, degree: int = 1) -> Iterator:
    with Discretization(replace(recipe.scene(elements), degree=degree)) as made:
        yield RigidBlocks.of(made), made


@pytest.mark.parametrize(
    ("friction", "live", "expected"),
    [
        (0.5, (0.0, -GRAVITY), np.inf),  # pressed on the ground
        (0.5, (0.0, GRAVITY), 1.0),  # lifted
        (0.2, (GRAVITY, -GRAVITY), 0.25),  # down and to the right
        (1.1, (0.3 * GRAVITY, -GRAVITY), np.inf),  # within the cone
        (0.2, (1e-6 * GRAVITY, 0.0), 2e5),  # a small part of the weight
    ],
)
def test_directions_of_the_live_load(friction, live, expected):
    with programs(block(coulomb(friction), live=Load(live))) as (blocks, _):
        bounds = blocks.bounds()
        assert blocks.limit() == bounds.upper == pytest.approx(expected, rel=1e-9)
        assert blocks.stands() and blocks.frictionless.stands() and bounds.lower >= 0.0


def test_loads_a_billion_times_the_weight_have_an_answer():
    """Lifted: HiGHS goes round in circles where its iterations are not bounded."""
    with programs(replace(BOND, parts={"live": Load((GRAVITY, 1e9))})) as (blocks, _):
        assert blocks.limit() == pytest.approx(GRAVITY / 1e9, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize(("live", "wedges"), [((0.3, -1.0), True), ((0.3, -0.2), False)])
def test_wedging_forces_balance_the_live_load(live, wedges):
    recipe = block(coulomb(0.7), live=Load(tuple(GRAVITY * part for part in live)))
    with programs(recipe) as (blocks, made):
        forces = blocks.wedging()
        assert (forces is not None) == wedges
        if forces is not None:
            normal, shear = forces
            assert np.all(normal >= 0.0) and np.all(np.abs(shear) <= 0.7 * normal + 1e-9)
            total = normal @ made.joints.normal + shear @ made.joints.tangent
            assert total == pytest.approx(-made.bodies.live[0, :2], rel=1e-7)


@pytest.mark.mpi
@pytest.mark.parametrize("strength", [300.0, 3e3, 1e5])
@pytest.mark.parametrize("recipe", [block(coulomb(0.6)), BOND, LINTEL])
def test_collapse_mode_proves_its_load_factor(recipe, strength):
    """Admissible, f_L.v = 1, and it dissipates what the loads do, whatever Coulomb's friction."""
    with programs(recipe) as (blocks, made):
        problem, strengths = made.problem, strength * made.joints.length
        factor, motion = blocks.collapse(strengths)
        mode = made.rigid_motion(motion)
        assert problem.dot(problem.live, mode) == pytest.approx(1.0, rel=1e-9)
        assert problem.max(-(problem.normal @ mode)) < 1e-9 * problem.max(np.abs(mode))
        slip = np.abs(problem.tangential @ mode)
        dissipation = problem.sum(strengths[made.operators.points] * slip)
        power = factor + problem.dot(problem.dead, mode)
        assert dissipation == pytest.approx(power, abs=1e-9 * max(dissipation, factor))
        if len(motion) == 1:
            slides = strength * WIDTH / BLOCK_WEIGHT
            assert factor == pytest.approx(min(slides, WIDTH / HEIGHT), rel=1e-9)
    with programs(replace(recipe, law=coulomb(0.1))) as (blocks, _):
        assert blocks.collapse(strengths)[0] == pytest.approx(factor, rel=1e-9)
