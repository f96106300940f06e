"""Blocks whose limit load is known in closed form."""

from __future__ import annotations

import math

import pytest
from mpi4py import MPI

from fenics_contact import BlockMesh, JointLaw, LimitLoad, Load, Material, Scene, limit_load
from fenics_contact.meshing import polygons, wall
from tests.regression.scenes import rectangle, wedge_scene

GRAVITY = 9.81


def solve(model, friction: float, live: Load, dead: Load | None = None, **materials) -> LimitLoad:
    """Blocks on the ground "base", one law everywhere."""
    law = JointLaw("coulomb", friction)
    scene = Scene(
        BlockMesh.from_model(model, MPI.COMM_WORLD),
        materials or {"default": Material(1e9, 0.2, 2000.0)},
        live=live,
        dead=dead or Load((0.0, -GRAVITY)),
        joints={"default": law},
        foundations={"base": law},
    )
    return limit_load(scene)


PUSH = Load((GRAVITY, 0.0))


@pytest.mark.parametrize("friction", [0.05, 0.2, 0.39, 0.41, 0.7, 5.0])
def test_block_slides_or_tips(friction):
    result = solve(polygons([rectangle(0, 0, 0.4, 1.0)], 0.1), friction, PUSH)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(min(friction, 0.4), rel=1e-6)


@pytest.mark.parametrize("friction", [0.1, 0.7])
@pytest.mark.parametrize("count", [2, 5])
def test_stack(count, friction):
    model = wall([[1.0]] * count, block=(0.5, 0.2))
    result = solve(model, friction, PUSH)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(min(friction, 0.5 / (count * 0.2)), rel=1e-6)


@pytest.mark.parametrize("friction", [0.1, 0.7])
def test_trilith(friction):
    columns = [rectangle(0, 0, 0.3, 1.0), rectangle(1, 0, 1.3, 1.0)]
    model = polygons([*columns, rectangle(0, 1.0, 1.3, 1.3)], 0.1)
    result = solve(model, friction, PUSH)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(min(friction, 0.3), rel=1e-6)


def turned(points, angle: float):
    c, s = math.cos(angle), math.sin(angle)
    return [(c * x - s * y, s * x + c * y) for x, y in points]


def test_tilting_table():
    """A block on a table tilted just below the friction angle needs no push, above it slides."""
    for degrees, status in ((16.0, "limit"), (17.5, "unstable")):
        angle = math.radians(degrees)
        block, table = turned(rectangle(0, 0, 1.0, 0.2), angle), turned([(0, 0), (1.0, 0)], angle)
        model = polygons([block], 0.1, groups={"base": [table]})
        down = Load((-GRAVITY * math.cos(angle), -GRAVITY * math.sin(angle)))
        result = solve(model, 0.3, down)
        assert result.status == status
        if status == "limit":
            exact = 0.3 * math.cos(angle) - math.sin(angle)
            assert result.load_factor == pytest.approx(exact, rel=1e-6)


def test_block_pushed_up_an_incline():
    """Force over weight is (tan a + F) / (1 - F tan a) for a horizontal push (NAFEMS CGS-4)."""
    angle, friction = math.atan(0.1), 0.3
    block, ground = turned(rectangle(0, 0, 1.0, 0.2), angle), turned([(0, 0), (1.0, 0)], angle)
    model = polygons([block], 0.1, groups={"base": [ground]})
    result = solve(model, friction, PUSH)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.4123711, rel=1e-6)


@pytest.mark.parametrize(
    ("friction", "exact"), [(0.1, 0.1549061349), (0.2, 0.4264946007), (0.3, 0.9340306116)]
)
def test_wedge_drives_blocks_apart(friction, exact):
    """P / W = 2 F / (cot(a + phi) - F)."""
    result = limit_load(wedge_scene(friction))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(exact, rel=1e-8)


def test_locked_wedge_is_unbounded():
    """Where cot(a + phi) < F the wedge cannot move, whatever the load."""
    result = limit_load(wedge_scene(0.8))
    assert result.status == "unbounded"
    assert math.isinf(result.load_factor)
