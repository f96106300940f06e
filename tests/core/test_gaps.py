"""Initial gaps of joints: facets that face each other at a distance, which must close first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import (
    InputError,
    JointLaw,
    Load,
    Material,
    Scene,
    equilibrium,
    limit_load,
)
from fenics_contact.meshing import polygons
from tests.helpers import (
    Drawing,
    coulomb,
    grid_blocks,
    mesh_of,
    node_positions,
    on_ground,
    rotation,
)
from tests.quick import slow

GAP, MODULUS, PRESSURE = 2e-3, 1e8, 1e5
SMOOTH = JointLaw("frictionless", gap=1.5 * GAP)


def columns(divisions: int, angle: float = 0.0, gap: float = GAP) -> Drawing:
    """A block of 1 m x 2 m above another, a gap between them, all turned."""
    drawing = grid_blocks(((0, 0), (1, 2), (3, 4)), ((0, 2 + gap), (1, 2), (divisions, 4)))
    drawing.facets["sides"] = np.concatenate([drawing.facets["left1"], drawing.facets["right1"]])
    return drawing.turned(angle)


def pressed(drawing: Drawing, angle: float = 0.0, law: JointLaw = SMOOTH, degree: int = 1) -> Scene:
    """Without Poisson's ratio, so that the stress is the pressure everywhere."""
    down = rotation(angle) @ [0.0, -PRESSURE]
    return Scene(
        mesh_of(drawing.model()),
        {"default": Material(MODULUS, 0.0)},
        live=Load(traction={"top1": (float(down[0]), float(down[1]))}),
        joints={"default": law},
        supports={"bottom0": "fixed", "sides": "roller"},
        degree=degree,
    )


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("divisions", "angle"), [(3, 0.0), (5, 0.0), (2, 0.7)])
def test_gap_closes_before_columns_carry(divisions, angle, degree):
    found = equilibrium(pressed(columns(divisions, angle), angle, degree=degree))
    assert found.status == "equilibrium"
    pressure = found.joints["pressure"]
    assert pressure == pytest.approx(np.full(len(pressure), PRESSURE))
    assert np.abs(found.joints["gap"]).max() < 1e-9 * GAP
    made = found.layout
    motion = made.cartesian(found.state.displacement) @ rotation(angle)
    first = made.space.dofmap.index_map.local_range[0]
    x = node_positions(made.space)[first : first + len(motion)] @ rotation(angle)
    height = x[:, 1]
    shortened = -PRESSURE / MODULUS * np.where(height > 2.0 + 0.5 * GAP, height - GAP, height)
    expected = shortened - np.where(height > 2.0 + 0.5 * GAP, GAP, 0.0)
    assert motion[:, 1] == pytest.approx(expected, abs=1e-9 * GAP)
    assert motion[:, 0] == pytest.approx(np.zeros(len(motion)), abs=1e-9 * GAP)


def test_block_slides_up_to_the_next_one():
    # The first block slides by the gap, then both slide: friction times the weight of both.
    drawing = grid_blocks(((0, 0), (1, 1), (2, 2)), ((1 + GAP, 0), (1, 1), (3, 3)))
    drawing.facets["base"] = np.concatenate([drawing.facets[f"bottom{k}"] for k in (0, 1)])
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": Material(1e9, 0.2, 1000.0)},
        dead=Load((0.0, -10.0)),
        live=Load(traction={"left0": (1e4, 0.0)}),
        joints={"default": replace(SMOOTH, gap=1.5 * GAP)},
        foundations={"base": coulomb(0.3)},
    )
    result = limit_load(scene)
    assert result.status == "limit"
    joints = result.collapse.joints
    between = result.layout.joints.bodies[:, 0] == 0
    grounded = result.layout.joints.bodies[:, 1]
    slip = [np.abs(joints.slip[~between & (grounded == body)]).min() for body in (0, 1)]
    assert slip[0] > slip[1] + 0.99 * GAP
    assert np.abs(joints.gap[between]).min() < 1e-6 * GAP
    assert result.load_factor == pytest.approx(0.6, rel=1e-6)
    apart = replace(scene, joints={})
    assert limit_load(apart).load_factor == pytest.approx(0.3, rel=1e-6)


def test_gaps_that_are_refused():
    with pytest.raises(InputError, match="gap"):
        JointLaw("frictionless", gap=-1e-3)
    scene = pressed(columns(3))
    with pytest.raises(InputError, match=r"foundations\.left0 takes no gap"):
        replace(scene, foundations={"left0": SMOOTH})


def arc(half_angle: float, chords: int) -> np.ndarray:
    """Points on a circle of radius 1 about the origin, around its top, from the right."""
    angle = np.linspace(0.5 * np.pi - half_angle, 0.5 * np.pi + half_angle, chords + 1)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def centroid(outline: np.ndarray) -> tuple[float, float]:
    """Area of a polygon and height of its centroid."""
    (x, y), (x1, y1) = outline.T, np.roll(outline, -1, axis=0).T
    cross = x * y1 - x1 * y
    area = 0.5 * float(np.sum(cross))
    return area, float(np.sum((y + y1) * cross)) / (6.0 * area)


def saddle(chords: tuple[int, int]) -> tuple[Drawing, float, float]:
    """A stone on a round one, drawn with some chords each, and the load factors at which they rock.

    These are arm of the weight / arm of the push about the end of the arc, of the upper one alone,
    and about the foot, of both.
    """
    below, above = (arc(np.radians(15.0), count) for count in chords)
    foot = np.array([[below[-1, 0], 0.0], [below[0, 0], 0.0]])
    top = foot[::-1] + np.array([0.0, 2.5])
    outlines = [np.concatenate([below, foot]), np.concatenate([above[::-1], top])]
    (area, height), (of_upper, above_foot) = map(centroid, outlines)
    whole = (area * height + of_upper * above_foot) / (area + of_upper)
    drawing = Drawing.of(polygons(outlines, 0.1, groups={"base": [(foot[0], foot[1])]}))
    edge = above[0, 0]
    return drawing, edge / (above_foot - above[0, 1]), edge / whole


@pytest.mark.parametrize("chords", [(5, 7), *slow((6, 6), (11, 6))])
def test_stone_on_arcs_of_unlike_chords_rocks_at_its_hand_value(chords):
    drawing, alone, together = saddle(chords)
    fixed = {"foundations": {}, "supports": {"base": "fixed"}}
    # Where the arcs are a little apart, so are the two sides' normal forces.
    for held, expected, allowed in ((fixed, alone, 1e-6), ({}, together, 1e-3)):
        result = limit_load(on_ground(drawing.model(), coulomb(1.2), **held))
        result = result.hold_against_brackets()
        assert result.status == "limit"
        assert result.load_factor == pytest.approx(expected, rel=allowed)
        assert result.load_factor <= result.bounds.upper * (1.0 + 1e-6)
