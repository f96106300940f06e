"""Joint points, their weights and laws, and the opening and slip that B_N and B_T give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import InputError, Load, Scene
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.joints import (
    Joints,
    find_joints,
)
from fenics_contact.discretization.materials import displacement_space
from fenics_contact.meshing import polygons
from tests.helpers import (
    PUSH,
    STONE,
    coulomb,
    grid_blocks,
    mesh_of,
    on_ground,
)

TWO = (((0, 0), (1, 1), (2, 1)), ((0, 1), (1, 1), (2, 1)))  # one block on another


def joints_of(scene: Scene) -> Joints:
    return find_joints(scene, collect_boundary(scene.mesh, displacement_space(scene)))


def free_scene(model, joints=None, foundations=None) -> Scene:
    """Blocks of stone with the laws given, without asking what holds them."""
    laws = {"default": coulomb(0.5)} if joints is None else joints
    return Scene(
        mesh_of(model), {"default": STONE}, live=PUSH, joints=laws, foundations=foundations or {}
    )


def at(joints: Joints, x: float, y: float) -> np.ndarray:
    """Points of the joints at a place."""
    return np.flatnonzero(np.abs(joints.position - [x, y]).max(axis=1) < 1e-9)


@pytest.mark.parametrize(("kink", "points"), [(10.0, 1), (14.0, 1), (16.0, 2), (40.0, 2)])
def test_gently_curved_joint_has_one_point_per_node(kink, points):
    rise = np.tan(np.radians(0.5 * kink))
    lower = [(-1, -1), (1, -1), (1, 0), (0, rise), (-1, 0)]
    upper = [(-1, 0), (0, rise), (1, 0), (1, 2), (-1, 2)]
    joints = joints_of(free_scene(polygons([lower, upper], 3.0)))
    crown = at(joints, 0.0, rise)
    assert len(crown) == points
    assert joints.length.sum() == pytest.approx(2 * np.hypot(1, rise), rel=1e-12)
    mean = joints.normal[crown].mean(axis=0)
    assert mean / np.linalg.norm(mean) == pytest.approx([0, 1], abs=1e-12)


ROUGH, SMOOTH = coulomb(0.5), coulomb(0.1)
IN_ONE_PLACE = (*TWO, TWO[1])  # two blocks in one place on a third


@pytest.mark.parametrize(
    ("blocks", "laws", "grounds", "message"),
    [
        (TWO, {}, {}, r"no joint group of their own; add \[joints\.default\]"),
        (TWO, {"default": ROUGH, "bottom0": ROUGH}, {},
         "joint group 'bottom0': 2 facets have no facet opposite"),
        (TWO, {"top0": ROUGH, "bottom1": SMOOTH}, {},
         "'top0' and 'bottom1' are the two sides of 2 facets"),
        (TWO, {"default": ROUGH}, {"top0": ROUGH},
         "foundation 'top0': 2 facets touch another block"),
        (TWO, {"default": ROUGH}, {"bottom0": ROUGH, "foot": ROUGH},
         "'bottom0' and 'foot' share 2 facets"),
        (IN_ONE_PLACE, {"default": ROUGH}, {}, r"blocks overlap at \(0\.25, 1\.5\)"),
    ],
)  # fmt: skip
def test_joints_refuse(blocks, laws, grounds, message):
    drawing = grid_blocks(*blocks)
    drawing.facets["foot"] = drawing.facets["bottom0"]
    with pytest.raises(InputError, match=message):
        joints_of(free_scene(drawing.model(), laws, grounds))


def test_traction_inside_a_block():
    drawing = grid_blocks(((0, 0), (2, 2), (2, 2)))
    drawing.facets["seam"] = np.array([[3, 4]])
    scene = replace(free_scene(drawing.model()), live=Load(traction={"seam": (1.0, 0.0)}))
    with pytest.raises(InputError, match="'seam': 1 facets lie inside a body"):
        Discretization(scene)


@pytest.mark.parametrize(("gap", "count"), [(0.0, 0), (1e-4, 1)])
def test_warning_of_a_gap(gap, count):
    drawing = grid_blocks(((0, 0), (1, 1), (2, 2)), ((0, 1 + gap), (1, 1), (3, 2)))
    drawing.facets = {"base": drawing.facets["bottom0"]}
    with Discretization(on_ground(drawing.model(), coulomb(0.5))) as made:
        found = [text for text in made.warnings if "gaps or overlaps up to 0.0001 m" in text]
    assert len(found) == count
