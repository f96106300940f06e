"""What a scene may combine: laws, supports, tractions, materials, planes and directions of load."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, SolveOptions, limit_load
from fenics_contact.analysis.rigid_blocks import RigidBlocks
from fenics_contact.meshing import buttress, polygons, wall
from tests.regression.scenes import rectangle

GRAVITY = 9.81
STONE = Material(1e9, 0.2, 2000.0)
WEIGHT = Load((0.0, -GRAVITY))
PUSH = Load((GRAVITY, 0.0))
SMOOTH = JointLaw("frictionless")
UNIT_WEIGHT = STONE.density * GRAVITY


def turned(points: Sequence[tuple[float, float]], degrees: float) -> list[tuple[float, float]]:
    """Points turned anticlockwise about the origin."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return [(c * x - s * y, s * x + c * y) for x, y in points]


def linear_program(result) -> float:
    """Limit load of the rigid blocks with associative friction."""
    structure = result.structure
    return RigidBlocks(structure.joints, structure.bodies, structure.scene.comm).limit()


# Laws of joints


def test_row_of_blocks_on_grounds_of_three_laws():
    """Pushed at its left end: friction of the first block and strength of the second add up."""
    length, height, friction, bound = 1.0, 0.3, 0.4, 3000.0
    model = polygons(
        [rectangle(x, 0, x + length, height) for x in (0.0, 1.0, 2.0)],
        0.15,
        groups={
            "rough": [((0, 0), (1, 0))],
            "glued": [((1, 0), (2, 0))],
            "smooth": [((2, 0), (3, 0))],
            "left": [((0, 0), (0, height))],
        },
    )
    scene = Scene(
        BlockMesh.from_model(model),
        {"default": STONE},
        live=Load(traction={"left": (1.0, 0.0)}),
        dead=WEIGHT,
        joints={"default": SMOOTH},
        foundations={
            "rough": JointLaw("coulomb", friction),
            "glued": JointLaw("tresca", bound=bound),
            "smooth": SMOOTH,
        },
    )
    result = limit_load(scene)
    exact = (friction * UNIT_WEIGHT * length * height + bound * length) / height
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(exact, rel=1e-6)
    assert result.load_factor == pytest.approx(linear_program(result), rel=1e-6)


@pytest.mark.parametrize(
    ("friction", "bound", "slides"), [(0.30, 1e5, "rough"), (5.0, 900.0, "glued")]
)
def test_stack_with_a_law_for_every_joint(friction, bound, slides):
    """The weakest joint above a block held by a roller on smooth ground slides."""
    length, height = 2.0, 0.25
    model = polygons(
        [rectangle(0, level * height, length, (level + 1) * height) for level in range(3)],
        0.125,
        groups={
            "ground": [((0, 0), (length, 0))],
            "stop": [((length, 0), (length, height))],
            "rough": [((0, height), (length, height))],
            "glued": [((0, 2 * height), (length, 2 * height))],
            "pushed": [((0, 2 * height), (0, 3 * height))],
        },
    )
    scene = Scene(
        BlockMesh.from_model(model),
        {"default": STONE},
        live=Load(traction={"pushed": (1.0, 0.0)}),
        dead=WEIGHT,
        joints={
            "rough": JointLaw("coulomb", friction),
            "glued": JointLaw("tresca", bound=bound),
        },
        foundations={"ground": SMOOTH},
        supports={"stop": "roller"},
    )
    result = limit_load(scene)
    weight = UNIT_WEIGHT * length * height
    resistance = {"rough": friction * 2.0 * weight, "glued": bound * length}
    assert min(resistance, key=lambda name: resistance[name]) == slides
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(resistance[slides] / height, rel=1e-6)
    assert result.load_factor == pytest.approx(linear_program(result), rel=1e-6)


# Supports


@pytest.mark.parametrize("degrees", [10.0, 30.0, 60.0])
def test_block_on_an_inclined_roller_plane_leaves_its_stop(degrees):
    """Nothing but the weight along the plane holds a block against a push up the plane."""
    block, plane, stop = (
        turned(points, degrees)
        for points in (rectangle(0, 0, 1.0, 0.4), [(0, 0), (1.0, 0)], [(0, 0), (0, 0.4)])
    )
    scene = Scene(
        BlockMesh.from_model(polygons([block], 0.1, groups={"plane": [plane], "stop": [stop]})),
        {"default": STONE},
        live=PUSH,
        dead=WEIGHT,
        foundations={"stop": SMOOTH},
        supports={"plane": "roller"},
        solve=SolveOptions(direction="both"),
    )
    result = limit_load(scene)
    assert result.load_factor == pytest.approx(math.tan(math.radians(degrees)), rel=1e-6)
    assert result.negative.status == "unbounded"
    assert result.load_factor_negative == -math.inf


def test_block_on_a_block_fixed_along_an_incline():
    """The block that is fixed carries whatever the other needs to slide."""
    angle, friction = math.radians(20.0), 0.35
    slope = math.tan(angle)
    low = [(0.0, 0.0), (1.0, slope), (1.0, 0.6), (0.0, 0.6)]
    model = polygons(
        [low, rectangle(0, 0.6, 1.0, 0.9)], 0.15, groups={"hill": [((0.0, 0.0), (1.0, slope))]}
    )
    scene = Scene(
        BlockMesh.from_model(model),
        {"default": STONE},
        live=PUSH,
        dead=WEIGHT,
        joints={"default": JointLaw("coulomb", friction)},
        supports={"hill": "fixed"},
        solve=SolveOptions(direction="both"),
    )
    result = limit_load(scene)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(friction, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(-friction, rel=1e-6)


@pytest.mark.parametrize("degrees", [0.0, 25.0, -40.0])
def test_rollers_on_two_sides_of_a_turned_scene(degrees):
    """Half a wedge between a roller in its plane of symmetry and a block on a smooth roller.

    The flank, at 30 degrees to the axis, slides when P / S = tan(30 degrees + phi), with the force
    P down on the wedge and the force S from the side on the block; without P it locks.
    """
    friction, half, height, side = 0.7, 0.3, 0.3 / math.tan(math.radians(30.0)), 5000.0
    wedge = [(0.0, 0.0), (half, height), (0.0, height)]
    block = [(0.0, 0.0), (1.0, 0.0), (1.0, height), (half, height)]
    axis, ground = [(0.0, 0.0), (0.0, height)], [(0.0, 0.0), (1.0, 0.0)]
    top, far = [(0.0, height), (half, height)], [(1.0, 0.0), (1.0, height)]
    segments = {"axis": axis, "ground": ground, "top": top, "far": far}
    ((down_x, down_y), (left_x, left_y)) = turned([(0.0, -1.0), (-1.0, 0.0)], degrees)
    pressure = side / height
    scene = Scene(
        BlockMesh.from_model(
            polygons(
                [turned(wedge, degrees), turned(block, degrees)],
                0.1,
                groups={name: [turned(ends, degrees)] for name, ends in segments.items()},
            )
        ),
        {"default": Material(1e9, 0.2)},
        live=Load(traction={"top": (down_x / half, down_y / half)}),
        dead=Load(traction={"far": (pressure * left_x, pressure * left_y)}),
        joints={"default": JointLaw("coulomb", friction)},
        supports={"axis": "roller", "ground": "roller"},
    )
    result = limit_load(scene)
    exact = side * math.tan(math.radians(30.0) + math.atan(friction))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(exact, rel=1e-6)


# Tractions


def block_under_tractions(friction: float, dead: Load, live: Load, density: float) -> Scene:
    """A block of 0.4 m by 1 m on the ground with a group "top"."""
    groups = {"base": [((0, 0), (0.4, 0))], "top": [((0, 1), (0.4, 1))]}
    return Scene(
        BlockMesh.from_model(polygons([rectangle(0, 0, 0.4, 1.0)], 0.1, groups=groups)),
        {"default": Material(1e9, 0.2, density)},
        live=live,
        dead=dead,
        foundations={"base": JointLaw("coulomb", friction)},
        solve=SolveOptions(direction="both"),
    )


@pytest.mark.parametrize("density", [0.0, 2000.0])
@pytest.mark.parametrize("friction", [0.1, 0.5])
def test_live_traction_on_a_top_edge_under_a_dead_one(friction, density):
    """It slides at F, or tips where the lever arm of the push is the height: at width / 2 / height.

    The push is the traction of 1 Pa on 0.4 m.
    """
    pressure = 2e4
    dead = Load((0.0, -GRAVITY), {"top": (0.0, -pressure)})
    live = Load(traction={"top": (1.0, 0.0)})
    result = limit_load(block_under_tractions(friction, dead, live, density))
    down = density * GRAVITY * 0.4 + pressure * 0.4
    exact = min(friction, 0.5 * 0.4 / 1.0) * down / 0.4
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(exact, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(-exact, rel=1e-6)


def test_dead_traction_to_one_side_leaves_more_on_the_other():
    """A dead push on the top edge takes from the load factor one way and adds to it the other."""
    push, friction = 1500.0, 0.1
    dead = Load((0.0, -GRAVITY), {"top": (push, 0.0)})
    result = limit_load(block_under_tractions(friction, dead, PUSH, 2000.0))
    share = push * 0.4 / (2000.0 * GRAVITY * 0.4)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(friction - share, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(-friction - share, rel=1e-6)


# Materials and plane


@pytest.mark.parametrize("stiff", [1e7, 1e9, 1e11])
def test_stack_of_two_materials_tips_by_its_weights(stiff):
    """Light over heavy block of the same size: (W1 + W2) b / 2 = load factor (W1 + 3 W2) h / 2."""
    width, height = 0.5, 0.6
    model = polygons(
        [rectangle(0, 0, width, height), rectangle(0, height, width, 2 * height)],
        0.125,
        names=["heavy", "light"],
    )
    law = JointLaw("coulomb", 2.0)
    scene = Scene(
        BlockMesh.from_model(model),
        {"heavy": Material(1e9, 0.2, 2600.0), "light": Material(stiff, 0.3, 700.0)},
        live=PUSH,
        dead=WEIGHT,
        joints={"default": law},
        foundations={"base": law},
    )
    result = limit_load(scene)
    exact = (2600.0 + 700.0) * width / ((2600.0 + 3.0 * 700.0) * height)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("friction", [0.3, 0.7])
def test_plane_stress_and_plane_strain_have_the_same_limit_load(friction):
    law = JointLaw("coulomb", friction)
    stress, strain = (
        limit_load(
            Scene(
                BlockMesh.from_model(wall([[1.0]] * 4, block=(0.5, 0.25))),
                {"default": Material(1e9, 0.3, 2000.0)},
                live=PUSH,
                dead=WEIGHT,
                joints={"default": law},
                foundations={"base": law},
                plane=plane,
            )
        )
        for plane in ("stress", "strain")
    )
    assert stress.status == strain.status == "limit"
    assert strain.load_factor == pytest.approx(min(friction, 0.5), rel=1e-6)
    assert stress.load_factor == pytest.approx(strain.load_factor, rel=1e-9)
    moved = [np.abs(result.displacement.x.array).max() for result in (stress, strain)]
    assert moved[0] != pytest.approx(moved[1], rel=1e-3)  # the elastic parts differ


# Both directions of the live load


def test_block_with_a_toe_tips_more_easily_away_from_it():
    """Its weight acts at (x, y): it tips to the right at (right - x) / y, to the left at x / y."""
    body, toe = (0.4 * 1.0, 0.2, 0.5), (0.3 * 0.2, 0.55, 0.1)  # area and centre of either part
    area = body[0] + toe[0]
    x, y = ((body[0] * body[k] + toe[0] * toe[k]) / area for k in (1, 2))
    outline = [(0, 0), (0.7, 0), (0.7, 0.2), (0.4, 0.2), (0.4, 1.0), (0, 1.0)]
    scene = Scene(
        BlockMesh.from_model(polygons([outline], 0.1)),
        {"default": STONE},
        live=PUSH,
        dead=WEIGHT,
        foundations={"base": JointLaw("coulomb", 5.0)},
        solve=SolveOptions(direction="both"),
    )
    result = limit_load(scene)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx((0.7 - x) / y, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(-x / y, rel=1e-6)
    assert result.collapse is result.positive


@pytest.mark.parametrize("friction", [0.4, 0.5, 0.7])
def test_buttress_holds_its_wall_on_one_side_only(friction):
    """To the left the wall tips alone, at width over height = 1 / 3, and leaves the buttress."""
    law = JointLaw("coulomb", friction)
    scene = Scene(
        BlockMesh.from_model(buttress(6, wall_width=1.0, foot=1.5, height=0.5)),
        {"default": STONE},
        live=PUSH,
        dead=WEIGHT,
        joints={"default": law},
        foundations={"base": law},
        solve=SolveOptions(direction="both"),
    )
    result = limit_load(scene)
    assert result.status == "limit"
    for end in (result.positive, result.negative):
        assert end.status == "limit"
        assert end.certificate.passed
        slack = 1e-8 * abs(end.load_factor)  # digits that springs leave, whatever the BLAS
        assert end.bounds.lower - slack <= end.load_factor <= end.bounds.upper + slack
    assert result.load_factor_negative == pytest.approx(-1.0 / 3.0, rel=1e-6)
    assert result.load_factor > 0.36
