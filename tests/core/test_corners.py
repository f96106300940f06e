"""Contacts at a point: corners that meet flat sides, by hand; corners that meet are refused."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from fenics_contact import (
    InputError,
    JointLaw,
    Load,
    Material,
    Scene,
    SolveOptions,
    equilibrium,
    limit_load,
)
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons
from tests.helpers import Drawing, mesh_of, rectangle, rotation
from tests.quick import slow

FLOOR = rectangle(-4, -0.3, 4, 0)


def scene(
    outlines: Sequence,
    joints: dict[str, JointLaw] | float,
    size: float = 0.1,
    *,
    groups: dict | None = None,
    turned: float = 0.0,
    degree: int = 1,
    material: Material | None = None,
) -> Scene:
    """Blocks on the floor, which is the last one and held; the live load pushes sideways."""
    base = (tuple(outlines[-1][0]), tuple(outlines[-1][1]))
    model = polygons(
        [np.array(one, float) for one in outlines], size, groups={"fix": [base]} | (groups or {})
    )
    laws = joints if isinstance(joints, dict) else {"default": JointLaw(friction=joints)}
    weight, push = (tuple(map(float, rotation(turned) @ one)) for one in ([0, -10.0], [10.0, 0]))
    return Scene(
        mesh_of(Drawing.of(model).turned(turned).model()),
        {"default": material or Material(5e9, 0.2, 2000.0)},
        dead=Load(weight),
        live=Load(push),
        joints=laws,
        supports={"fix": "fixed"},
        degree=degree,
        solve=SolveOptions(fast=True),
    )


def on_corner(points: Sequence, angle: float, lift: float = 0.0) -> np.ndarray:
    """An outline turned by degrees, its lowest corner above the origin."""
    turned = np.array(points) @ rotation(np.radians(angle)).T
    low = np.argmin(turned[:, 1])
    return turned - turned[low] + [0.0, lift]


SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
OCTAGON = [(np.cos(a), np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 9)[:-1]]
KITE = [(0, 0), (0.5, 0.6), (0, 0.9), (-0.5, 0.6)]


@pytest.mark.parametrize("size", [0.25, *slow(0.1)])
@pytest.mark.parametrize("gap", [0.0, 1e-3])
@pytest.mark.parametrize(
    ("points", "angle", "friction"), [(SQUARE, 45.0, 0.0), (OCTAGON, 0.0, 0.6), (KITE, 0.0, 0.4)]
)
def test_block_that_stands_on_one_corner_carries_no_push(points, angle, friction, gap, size):
    law = {"default": JointLaw(friction=friction, gap=2.0 * gap)}
    result = limit_load(scene([on_corner(points, angle, gap), FLOOR], law, size))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("gap", [0.0, 1e-3, 5e-3])
@pytest.mark.parametrize("angle", [5.0, 10.0, 30.0])
def test_tilted_block_falls_over(angle, gap):
    # A wider gap pairs no facets with the floor that are far from lying on it.
    law = {"default": JointLaw(friction=0.6, gap=gap)}
    assert equilibrium(scene([on_corner(SQUARE, angle), FLOOR], law), 0.0).status == "unstable"


TABLE = [(0, 0), (0.15, 0.3), (0.85, 0.3), (1, 0), (1, 1), (0, 1)]


@pytest.mark.mpi
@pytest.mark.parametrize("size", [0.3, *slow(0.1)])
@pytest.mark.parametrize(("gap", "turned"), [(0.0, 0.0), (1e-3, 0.0), (0.0, 0.8)])
@pytest.mark.parametrize("degree", [1, *slow(2)])
def test_table_on_two_points_rocks_and_slides(size, gap, turned, degree):
    # By hand: areas and heights of a square less a trapezium; it rocks about a point.
    cut = 0.5 * (1.0 + 0.7) * 0.3
    middle = 0.1 * (2 * 0.7 + 1.0) / (0.7 + 1.0)
    height = (0.5 - cut * middle) / (1.0 - cut)
    table = np.add(TABLE, [0.0, gap])
    for friction, expected in ((2.0, 0.5 / height), (0.3, 0.3)):
        law = {"default": JointLaw(friction=friction, gap=2.0 * gap)}
        result = limit_load(scene([table, FLOOR], law, size, turned=turned, degree=degree))
        result = result.hold_against_brackets()
        assert result.status == "limit"
        assert result.load_factor == pytest.approx(expected, rel=1e-6)
        assert result.bounds.upper == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("gap", [0.0, 1e-3])
@pytest.mark.parametrize(("points", "angle"), [(SQUARE, 45.0), (OCTAGON, 0.0), (KITE, 180.0)])
def test_two_corners_that_meet_are_refused(points, angle, gap):
    lower = np.array([(-0.5, 0.0), (0.5, 0.0), (0.0, 1.4)])
    law = {"default": JointLaw(friction=0.5, gap=2.0 * gap)}
    upper = on_corner(points, angle, 1.4 + gap)
    with pytest.raises(InputError, match=r"corners of blocks 0 and 1 meet at \(0, 1\.4\d*\)"):
        Discretization(scene([upper, lower, FLOOR], law))


def test_corners_of_bricks_do_not_meet():
    # A void at one side of the joint, a brick at the other: the diagonal ones touch at a corner.
    bricks = [rectangle(0, 0, 1, 1), rectangle(1, 0, 2, 1), rectangle(1, 1, 2, 2), FLOOR]
    with Discretization(scene(bricks, 0.6)) as made:
        assert made.joints.corners == 0


def test_corner_has_no_area_to_stick_with():
    law = {"default": JointLaw(friction=0.6, cohesion=1e6, tensile_strength=1e5)}
    result = limit_load(scene([on_corner(SQUARE, 45.0), FLOOR], law))
    assert result.load_factor == pytest.approx(0.0, abs=1e-9)


def test_law_of_a_corner_is_that_of_the_side_that_it_meets():
    groups = {"foot": [((-4, 0), (4, 0))]}
    laws = {"default": JointLaw(friction=0.6), "foot": JointLaw(friction=0.2)}
    result = limit_load(scene([np.array(TABLE), FLOOR], laws, groups=groups))
    assert result.load_factor == pytest.approx(0.2, rel=1e-6)


def test_corner_between_two_groups_asks_for_the_law():
    block = on_corner(SQUARE, 45.0)
    sides = {name: [(tuple(block[0]), tuple(block[k]))] for name, k in (("left", 3), ("right", 1))}
    laws = {"default": JointLaw(friction=0.6)}
    laws |= {name: JointLaw(friction=mu) for name, mu in (("left", 0.2), ("right", 0.4))}
    with pytest.raises(InputError, match="between two joint groups"):
        Discretization(scene([block, FLOOR], laws, groups=sides))
    meant = sides | {"right": [*sides["right"], ((-4, 0), (4, 0))]}
    with Discretization(scene([block, FLOOR], laws, groups=meant)) as made:
        assert made.joints.friction == pytest.approx([0.4])
