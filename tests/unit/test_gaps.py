"""Initial gaps of joints: facets that face each other at a distance, which must close first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import (
    EdgeForce,
    InputError,
    JointLaw,
    Load,
    Material,
    Scene,
    equilibrium,
    limit_load,
)
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.planar_cells import arc_heights
from tests.helpers import Drawing, coulomb, grid_blocks, mesh_of, node_positions, rotation

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
    made = found.discretization
    motion = made.cartesian(found.state.displacement) @ rotation(angle)
    first = made.elasticity.space.dofmap.index_map.local_range[0]
    x = node_positions(made.elasticity.space)[first : first + len(motion)] @ rotation(angle)
    height = x[:, 1]
    shortened = -PRESSURE / MODULUS * np.where(height > 2.0 + 0.5 * GAP, height - GAP, height)
    expected = shortened - np.where(height > 2.0 + 0.5 * GAP, GAP, 0.0)
    assert motion[:, 1] == pytest.approx(expected, abs=1e-9 * GAP)
    assert motion[:, 0] == pytest.approx(np.zeros(len(motion)), abs=1e-9 * GAP)


def test_gap_that_is_refused_without_a_law_for_it():
    drawing = columns(3, gap=1e-3)
    scene = pressed(drawing)
    place = EdgeForce((0.0, -1.0), x=0.5)
    found = equilibrium(replace(scene, live=replace(scene.live, force={"place": place})))
    assert found.status == "equilibrium"
    with pytest.raises(InputError, match=r"apart by up to 0\.001 m.*give their joint a gap"):
        Discretization(pressed(drawing, law=JointLaw("frictionless")))


@pytest.mark.parametrize("divisions", [3, 5])
def test_openings_are_measured_from_the_gaps(divisions):
    with Discretization(pressed(columns(divisions, 0.3), 0.3)) as made:
        problem, none = made.problem, np.zeros_like(made.problem.dead)
        opening, slip = problem.openings(none), problem.slips(none)
    assert opening == pytest.approx(np.full(len(opening), GAP), rel=1e-12)
    assert np.abs(slip).max(initial=0.0) == 0.0
    assert made.joints.gap == pytest.approx(np.full(len(made.joints.gap), GAP), rel=1e-12)


def test_facets_further_apart_than_the_gap_are_free():
    with pytest.raises(
        InputError, match=r"\(0\.5, 3\.002\), touch neither"
    ):  # nothing holds the upper block
        law = replace(SMOOTH, gap=0.5 * GAP)
        scene = pressed(columns(3), law=law)
        limit_load(replace(scene, supports={"bottom0": "fixed"}))


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
    between = result.discretization.joints.bodies[:, 0] == 0
    grounded = result.discretization.joints.bodies[:, 1]
    slip = [np.abs(joints.slip[~between & (grounded == body)]).min() for body in (0, 1)]
    assert slip[0] > slip[1] + 0.99 * GAP
    assert np.abs(joints.gap[between]).min() < 1e-6 * GAP
    assert result.load_factor == pytest.approx(0.6, rel=1e-6)
    apart = replace(scene, joints={})
    assert limit_load(apart).load_factor == pytest.approx(0.3, rel=1e-6)


def test_heights_of_arcs():
    angle = np.cumsum([0.0, 5.0, 7.0, 6.0, 3.0, 4.0]) * np.pi / 180.0
    points = 2.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    nodes = np.column_stack([np.arange(5), np.arange(1, 6)])
    ends = points[nodes]
    along = ends[:, 1] - ends[:, 0]
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    exact = 2.0 * (1.0 - np.cos(0.5 * np.diff(angle)))
    assert arc_heights(ends, nodes, normal) == pytest.approx(exact, rel=2e-3)
    assert arc_heights(ends, nodes, -normal) == pytest.approx(-exact, rel=2e-3)  # concave
    straight = np.tile(normal[:1], (5, 1))
    assert np.abs(arc_heights(ends, nodes, straight)).max() == 0.0


def test_gaps_that_are_refused():
    with pytest.raises(InputError, match="gap"):
        JointLaw("frictionless", gap=-1e-3)
    scene = pressed(columns(3))
    with pytest.raises(InputError, match=r"foundations\.left0 takes no gap"):
        replace(scene, foundations={"left0": SMOOTH})
