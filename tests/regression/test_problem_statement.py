"""What a scene may combine: laws, supports, tractions, materials, planes and directions of load.

Every expected value follows from the equilibrium of rigid blocks.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fenics_contact import JointLaw, LimitLoad, Load, Material, OutputOptions, limit_load
from tests.bank import (
    GRAVITY,
    PLAIN,
    PUSH,
    STONE,
    WEIGHT,
    Recipe,
    Variant,
    block_recipe,
    coulomb,
    outlined,
    rectangle,
    sides,
    tresca,
    turned,
)
from tests.quick import each_once

SMOOTH = JointLaw("frictionless")
UNIT_WEIGHT = STONE.density * GRAVITY


def solved(recipe: Recipe, variant: Variant = PLAIN, **options: Any) -> LimitLoad:
    """The result, which must be a limit load."""
    result = limit_load(recipe.scene(variant=variant, **options))
    assert result.status == "limit"
    return result


def check(recipe: Recipe, exact: float, negative: float | None = None, **how: Any) -> LimitLoad:
    """The result, whose load factor must be right, and that of the negative direction if given."""
    result = solved(recipe, **how, direction="positive" if negative is None else "both")
    assert result.load_factor == pytest.approx(exact, rel=1e-6)
    expected = math.nan if negative is None else negative  # nan: not asked for
    assert result.load_factor_negative == pytest.approx(expected, rel=1e-6, nan_ok=True)
    return result


# Laws of joints


def test_row_of_blocks_on_grounds_of_three_laws():
    """Pushed at its left end: friction of the first block and strength of the second add up."""
    length, height, friction, bound = 1.0, 0.3, 0.4, 3000.0
    recipe = outlined(
        [rectangle(x, 0, x + length, height) for x in (0.0, 1.0, 2.0)],
        SMOOTH,
        0.15,
        groups=sides(
            rough=(0, 0, 1, 0), glued=(1, 0, 2, 0), smooth=(2, 0, 3, 0), left=(0, 0, 0, height)
        ),
        live=Load(traction={"left": (1.0, 0.0)}),
        foundations={"rough": coulomb(friction), "glued": tresca(bound), "smooth": SMOOTH},
    )
    result = check(recipe, (friction * UNIT_WEIGHT * length * height + bound * length) / height)
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=1e-6)


@pytest.mark.parametrize(
    ("friction", "bound", "slides"), [(0.30, 1e5, "rough"), (5.0, 900.0, "glued")]
)
def test_stack_with_a_law_for_every_joint(friction, bound, slides):
    """The weakest joint above a block held by a roller on smooth ground slides."""
    length, height = 2.0, 0.25
    recipe = outlined(
        [rectangle(0, level * height, length, (level + 1) * height) for level in range(3)],
        SMOOTH,
        0.125,
        groups=sides(
            ground=(0, 0, length, 0),
            stop=(length, 0, length, height),
            rough=(0, height, length, height),
            glued=(0, 2 * height, length, 2 * height),
            pushed=(0, 2 * height, 0, 3 * height),
        ),
        live=Load(traction={"pushed": (1.0, 0.0)}),
        joints={"rough": coulomb(friction), "glued": tresca(bound)},
        foundations={"ground": SMOOTH},
        supports={"stop": "roller"},
    )
    weight = UNIT_WEIGHT * length * height
    resistance = {"rough": friction * 2.0 * weight, "glued": bound * length}
    assert min(resistance, key=lambda name: resistance[name]) == slides
    result = check(recipe, resistance[slides] / height)
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=1e-6)


# Supports


@pytest.mark.parametrize("degrees", [10.0, 30.0, 60.0])
def test_block_on_an_inclined_roller_plane_leaves_its_stop(degrees):
    """Nothing but the weight along the plane holds a block against a push up the plane."""
    weight, push = (tuple(turned(load.body, -degrees)) for load in (WEIGHT, PUSH))
    recipe = outlined(
        [rectangle(0, 0, 1.0, 0.4)],
        SMOOTH,
        0.1,
        groups=sides(plane=(0, 0, 1, 0), stop=(0, 0, 0, 0.4)),
        dead=Load(weight),
        live=Load(push),
        foundations={"stop": SMOOTH},
        supports={"plane": "roller"},
    )
    check(recipe, math.tan(math.radians(degrees)), -math.inf, variant=Variant(angle=degrees))


def test_block_on_a_block_fixed_along_an_incline():
    """The block that is fixed carries whatever the other needs to slide."""
    friction, slope = 0.35, math.tan(math.radians(20.0))
    low = [(0.0, 0.0), (1.0, slope), (1.0, 0.6), (0.0, 0.6)]
    recipe = outlined(
        [low, rectangle(0, 0.6, 1.0, 0.9)],
        coulomb(friction),
        0.15,
        groups=sides(hill=(0, 0, 1, slope)),
        foundations={},
        supports={"hill": "fixed"},
    )
    check(recipe, friction, -friction)


@pytest.mark.parametrize("degrees", [0.0, 25.0, -40.0])
def test_rollers_on_two_sides_of_a_turned_scene(degrees):
    """Half a wedge between a roller in its plane of symmetry and a block on a smooth roller.

    The flank, at 30 degrees to the axis, slides when P / S = tan(30 degrees + phi), with the force
    P down on the wedge and the force S from the side on the block; without P it locks.
    """
    friction, half, height, side = 0.7, 0.3, 0.3 / math.tan(math.radians(30.0)), 5000.0
    recipe = outlined(
        [
            [(0.0, 0.0), (half, height), (0.0, height)],
            [(0.0, 0.0), (1.0, 0.0), (1.0, height), (half, height)],
        ],
        coulomb(friction),
        0.1,
        groups=sides(
            axis=(0, 0, 0, height),
            ground=(0, 0, 1, 0),
            top=(0, height, half, height),
            far=(1, 0, 1, height),
        ),
        materials={"default": Material(1e9, 0.2)},
        live=Load(traction={"top": (0.0, -1.0 / half)}),
        dead=Load(traction={"far": (-side / height, 0.0)}),
        foundations={},
        supports={"axis": "roller", "ground": "roller"},
    )
    exact = side * math.tan(math.radians(30.0) + math.atan(friction))
    check(recipe, exact, variant=Variant(angle=degrees))


# Tractions


def block_under_tractions(friction: float, density: float, dead: Load, live: Load) -> Recipe:
    """A block of 0.4 m by 1 m on the ground with a group "top"."""
    groups = sides(base=(0, 0, 0.4, 0), top=(0, 1, 0.4, 1))
    material = {"default": Material(1e9, 0.2, density)}
    return block_recipe(0.4, 1.0, friction, groups=groups, materials=material, dead=dead, live=live)


@pytest.mark.parametrize("density", [0.0, 2000.0])
@pytest.mark.parametrize("friction", [0.1, 0.5])
def test_live_traction_on_a_top_edge_under_a_dead_one(friction, density):
    """It slides at F, or tips where the lever arm of the push is the height: at width / 2 / height.

    The push is the traction of 1 Pa on 0.4 m.
    """
    pressure = 2e4
    dead = Load(WEIGHT.body, {"top": (0.0, -pressure)})
    live = Load(traction={"top": (1.0, 0.0)})
    down = density * GRAVITY * 0.4 + pressure * 0.4
    exact = min(friction, 0.5 * 0.4 / 1.0) * down / 0.4
    check(block_under_tractions(friction, density, dead, live), exact, -exact)


def test_dead_traction_to_one_side_leaves_more_on_the_other():
    """A dead push on the top edge takes from the load factor one way and adds to it the other."""
    push, friction = 1500.0, 0.1
    dead = Load(WEIGHT.body, {"top": (push, 0.0)})
    share, recipe = push / (2000.0 * GRAVITY), block_under_tractions(friction, 2000.0, dead, PUSH)
    check(recipe, friction - share, -friction - share)


# Materials and plane


@pytest.mark.parametrize("stiff", [1e7, 1e11])
def test_stack_of_two_materials_tips_by_its_weights(stiff):
    """Light over heavy block of the same size: (W1 + W2) b / 2 = load factor (W1 + 3 W2) h / 2."""
    width, height = 0.5, 0.6
    recipe = outlined(
        [rectangle(0, 0, width, height), rectangle(0, height, width, 2 * height)],
        coulomb(2.0),
        0.125,
        names=["heavy", "light"],
        groups=sides(base=(0, 0, width, 0)),
        materials={"heavy": Material(1e9, 0.2, 2600.0), "light": Material(stiff, 0.3, 700.0)},
    )
    check(recipe, (2600.0 + 700.0) * width / ((2600.0 + 3.0 * 700.0) * height))


# Both directions of the live load


def test_block_with_a_toe_tips_more_easily_away_from_it():
    """Its weight acts at (x, y): it tips to the right at (right - x) / y, to the left at x / y."""
    body, toe = (0.4 * 1.0, 0.2, 0.5), (0.3 * 0.2, 0.55, 0.1)  # area and centre of either part
    area = body[0] + toe[0]
    x, y = ((body[0] * body[k] + toe[0] * toe[k]) / area for k in (1, 2))
    outline = [(0, 0), (0.7, 0), (0.7, 0.2), (0.4, 0.2), (0.4, 1.0), (0, 1.0)]
    recipe = outlined([outline], coulomb(5.0), 0.1, groups=sides(base=(0, 0, 0.7, 0)))
    result = check(recipe, (0.7 - x) / y, -x / y)
    assert result.bounds.lower >= 0.0, "of the direction as given"


# Stresses


PATCH = {  # blocks of 2.4 m by 0.8 m with joints of several lengths: gmsh's own irregular cells
    "aligned": [(0, 0, 1.3, 0.4), (1.3, 0, 2.4, 0.4), (0, 0.4, 1.3, 0.8), (1.3, 0.4, 2.4, 0.8)],
    "bonded": [(0, 0, 1.3, 0.5), (1.3, 0, 2.4, 0.5), (0, 0.5, 0.7, 0.8), (0.7, 0.5, 2.4, 0.8)],
}


def patch_recipe(bond: str, pressure: float) -> Recipe:
    """Blocks between smooth walls, pressed from above and half as much from the side.

    The live load takes off the pressure from the side.
    """
    return outlined(
        [rectangle(*block) for block in PATCH[bond]],
        SMOOTH,
        0.2,
        groups=sides(
            base=(0, 0, 2.4, 0),
            left=(0, 0, 0, 0.8),
            right=(2.4, 0, 2.4, 0.8),
            top=(0, 0.8, 2.4, 0.8),
        ),
        materials={"default": Material(1e9, 0.2)},
        live=Load(traction={"right": (1.0, 0.0)}),
        dead=Load(traction={"top": (0.0, -pressure), "right": (-0.5 * pressure, 0.0)}),
        foundations={},
        supports={"base": "roller", "left": "roller"},
    )


SHAPES = [Variant(degree=d, quadrilaterals=q) for d in (1, 2) for q in (False, True)]
#: Number of VTK's Lagrange cell, and its nodes.
VTK_CELLS = [(69, 3), (70, 4), (69, 6), (70, 9)]


@pytest.mark.parametrize(
    ("shape", "plane", "bond"), each_once(range(len(SHAPES)), ["strain", "stress"], [*PATCH])
)
def test_uniform_pressure_goes_through_any_joints(bond, shape, plane, tmp_path):
    """What is left at the limit is the pressure from above alone, in files for ParaView too."""
    pressure = 2e4
    variant, cell = replace(SHAPES[shape], plane=plane), VTK_CELLS[shape]
    scene = patch_recipe(bond, pressure).scene(variant=variant)
    result = limit_load(replace(scene, output=OutputOptions(pictures=False)))
    assert (result.status, result.load_factor) == ("limit", pytest.approx(0.5 * pressure, rel=1e-9))
    result.write(tmp_path)
    (file,) = tmp_path.glob("blocks*.vtu")
    arrays = vtk_arrays(file.read_text())
    for name, value in {"stress_xx": 0.0, "stress_yy": -pressure, "stress_xy": 0.0}.items():
        assert arrays[name] == pytest.approx(value, abs=1e-8 * pressure)
    assert set(arrays["types"]) == {cell[0]}
    assert set(np.diff(arrays["offsets"], prepend=0.0)) == {cell[1]}


def vtk_arrays(text: str) -> dict[str, np.ndarray]:
    """Data arrays of a .vtu file by name."""
    found = re.findall(r'<DataArray[^>]*Name="(\w+)"[^>]*>([^<]*)<', text)
    return {name: np.array(numbers.split(), dtype=float) for name, numbers in found}
