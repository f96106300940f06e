"""Joint points, their weights and laws, and the opening and slip that B_N and B_T give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import InputError, JointLaw, Load, Material, Scene
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.elasticity import displacement_space
from fenics_contact.discretization.joints import GROUND, Joints, find_joints
from fenics_contact.meshing import polygons, wall
from fenics_contact.discretization.discretization import Structure
from tests.helpers import (
    PUSH,
    STONE,
    WEIGHT,
    Drawing,
    coulomb,
    grid_blocks,
    joint_rows,
    mesh_of,
    node_bodies,
    node_positions,
    on_ground,
    rectangle,
    rotation,
    tresca,
    vector_like,
    whole,
)

ANGLES = np.radians([0.0, 90.0, 180.0, 30.0, -110.0])


def joints_of(scene: Scene) -> Joints:
    return find_joints(scene, collect_boundary(scene.mesh, displacement_space(scene)))


def free_scene(model, joints=None, foundations=None, supports=None) -> Scene:
    """Blocks of stone with the laws given, without asking what holds them."""
    return Scene(
        mesh_of(model),
        {"default": STONE},
        live=PUSH,
        joints={"default": coulomb(0.5)} if joints is None else joints,
        foundations=foundations or {},
        supports=supports or {},
    )


def at(joints: Joints, x: float, y: float) -> np.ndarray:
    """Points of the joints at a place."""
    return np.flatnonzero(np.abs(joints.position - [x, y]).max(axis=1) < 1e-9)


def two_blocks(angle: float) -> Structure:
    """A block on another on the ground, all turned; the joint is horizontal before."""
    drawing = grid_blocks(((0, 0), (1, 0.5), (4, 2)), ((0, 0.5), (1, 0.7), (4, 2)))
    drawing.facets = {"base": drawing.facets["bottom0"]}
    return Structure.build(on_ground(drawing.turned(angle).model(), coulomb(0.5)))


def moved(structure: Structure, displacement) -> tuple[np.ndarray, np.ndarray]:
    """Opening and slip at all points, for a displacement as function of (positions, bodies)."""
    nodes = node_positions(structure.elasticity.space)
    values = displacement(nodes, node_bodies(structure)).ravel()
    normal, tangential = joint_rows(structure)
    return normal @ values, tangential @ values


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("body", [0, 1])
def test_translation_of_one_block_opens_and_slips(angle, body):
    structure = two_blocks(angle)
    joints = structure.joints
    along, away = 3e-3, 2e-3  # of the joint, in its own directions
    shift = rotation(angle) @ [along, away]
    opening, slip = moved(structure, lambda x, b: np.where(b[:, None] == body, shift, 0.0))
    between = joints.bodies[:, 0] == 0
    on_rock = joints.bodies[:, 0] == GROUND
    assert np.count_nonzero(between) == np.count_nonzero(on_rock) == 5
    sign = 1.0 if body == 1 else -1.0
    # t is n turned anticlockwise: along a level joint, where n is upward, it points left.
    assert opening[between] == pytest.approx(np.full(5, sign * away), abs=1e-16)
    assert slip[between] == pytest.approx(np.full(5, -sign * along), abs=1e-16)
    assert opening[on_rock] == pytest.approx(np.full(5, away * (body == 0)), abs=1e-16)
    assert slip[on_rock] == pytest.approx(np.full(5, -along * (body == 0)), abs=1e-16)


@pytest.mark.parametrize("angle", ANGLES)
def test_rotation_of_the_upper_block_opens_like_a_wedge(angle):
    structure = two_blocks(angle)
    joints = structure.joints
    spin = 1e-3
    edge = rotation(angle) @ [0.0, 0.5]  # the left end of the joint

    def turn(x, body):
        arm = x - edge
        return np.where(body[:, None] == 1, spin * np.column_stack([-arm[:, 1], arm[:, 0]]), 0.0)

    opening, slip = moved(structure, turn)
    between = joints.bodies[:, 0] == 0
    distance = np.linalg.norm(joints.position[between] - edge, axis=1)
    assert distance.max() == pytest.approx(1.0, rel=1e-12)
    assert opening[between] == pytest.approx(spin * distance, abs=1e-16)
    assert np.abs(slip).max() < 1e-16
    assert np.abs(opening[~between]).max() == 0.0


@pytest.mark.parametrize("angle", ANGLES)
def test_motion_of_the_whole_strains_no_joint_but_those_of_the_ground(angle):
    structure = two_blocks(angle)
    whole_body = [2e-3, -1e-3, 5e-3]

    def motion(x, body):
        a, b, c = whole_body
        return np.column_stack([a - c * x[:, 1], b + c * x[:, 0]])

    opening, slip = moved(structure, motion)
    between = structure.joints.bodies[:, 0] != GROUND
    assert np.abs(opening[between]).max() < 1e-16
    assert np.abs(slip[between]).max() < 1e-16
    here = motion(structure.joints.position, None)
    assert opening[~between] == pytest.approx(
        np.sum(here * structure.joints.normal, axis=1)[~between], abs=1e-16
    )
    assert slip[~between] == pytest.approx(
        np.sum(here * structure.joints.tangent, axis=1)[~between], abs=1e-16
    )


@pytest.mark.parametrize("degree", [1, 2])
def test_rows_give_the_jump_of_any_displacement(degree):
    model = wall([[1, 1], [0.5, 1, 0.5]], elements=1)
    structure = Structure.build(on_ground(model, coulomb(0.5), degree=degree))
    joints = structure.joints

    def displacement(x, body):
        return np.column_stack([np.sin(3 * x[:, 0] + body), x[:, 1] ** 2 * np.cos(body)])

    first, second = (displacement(joints.position, joints.bodies[:, side]) for side in (0, 1))
    first[joints.bodies[:, 0] == GROUND] = 0.0
    opening, slip = moved(structure, displacement)
    assert opening == pytest.approx(np.sum(joints.normal * (second - first), axis=1), abs=1e-14)
    assert slip == pytest.approx(np.sum(joints.tangent * (second - first), axis=1), abs=1e-14)


def test_rows_agree_with_the_dense_coefficients():
    structure = two_blocks(0.3)
    operators = structure.operators
    normal, tangential = joint_rows(structure)
    for matrix, rows in ((normal, operators.normal_rows), (tangential, operators.tangential_rows)):
        for point, dofs, row in zip(operators.points, operators.dofs, rows, strict=True):
            expected = np.zeros(matrix.shape[1])
            expected[dofs[dofs >= 0]] = row[dofs >= 0]
            assert np.array_equal(matrix[point], expected)


def test_rows_on_an_inclined_roller_are_in_its_coordinates():
    # The left sides of both blocks roll on one inclined line; the joint ends there.
    angle = np.radians(30.0)
    drawing = grid_blocks(((0, 0), (1, 1), (2, 2)), ((0, 1), (1, 1), (2, 2)))
    drawing.facets["side"] = np.concatenate([drawing.facets[name] for name in ("left0", "left1")])
    scene = Scene(
        mesh_of(drawing.turned(angle).model()),
        {"default": STONE},
        live=PUSH,
        joints={"default": coulomb(0.5)},
        foundations={"bottom0": coulomb(0.5)},
        supports={"side": "roller"},
    )
    structure = Structure.build(scene)
    assert structure.supports.inclined
    shift = rotation(angle) @ [0.0, 1e-3]  # along the roller
    upper = (node_bodies(structure) == 1)[:, None]
    vector = vector_like(structure.problem.dead, np.where(upper, shift, 0.0))
    structure.supports.to_supports(vector)
    normal, tangential = joint_rows(structure)
    between = structure.joints.bodies[:, 0] == 0
    assert (normal @ whole(vector))[between] == pytest.approx(np.full(3, 1e-3), abs=1e-16)
    assert np.abs(tangential @ whole(vector)).max() < 1e-16
    # What the roller holds moves no joint.
    held = (2 * structure.supports.nodes[:, None] + np.arange(2))[structure.supports.held]
    assert len(held) == 6
    assert np.abs(normal[:, held]).max() == np.abs(tangential[:, held]).max() == 0.0


@pytest.mark.parametrize("elements", [1, 3])
def test_lengths_of_points_sum_to_the_joints(elements):
    model = wall([[1, 1], [0.5, 1, 0.5]], (0.4, 0.2), elements)
    joints = joints_of(on_ground(model, coulomb(0.5)))
    level = np.abs(joints.normal[:, 1]) > 0.5
    on_rock = joints.bodies[:, 0] == GROUND
    assert joints.length[on_rock].sum() == pytest.approx(0.8, rel=1e-12)
    assert joints.length[level & ~on_rock].sum() == pytest.approx(0.8, rel=1e-12)
    assert joints.length[~level].sum() == pytest.approx(3 * 0.2, rel=1e-12)


def test_weights_are_those_of_the_trapezoidal_and_of_simpsons_rule():
    model = wall([[1], [1]], (0.4, 0.2), 1)  # two facets of 0.2
    scene = free_scene(model)
    linear, quadratic = joints_of(scene), joints_of(replace(scene, degree=2))
    order = np.argsort(linear.position[:, 0])
    assert linear.length[order] == pytest.approx([0.1, 0.2, 0.1], rel=1e-12)
    order = np.argsort(quadratic.position[:, 0])
    assert quadratic.position[order, 0] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4], abs=1e-15)
    sixth = 0.2 / 6
    assert quadratic.length[order] == pytest.approx(
        [sixth, 4 * sixth, 2 * sixth, 4 * sixth, sixth], rel=1e-12
    )


def test_three_blocks_meet_in_three_points():
    model = wall([[2], [1, 1]], (0.4, 0.2), 1)
    joints = joints_of(free_scene(model))
    points = at(joints, 0.4, 0.2)
    pairs = [tuple(pair) for pair in joints.bodies[points]]
    assert sorted(pairs) == [(0, 1), (0, 2), (1, 2)]
    normal = dict(zip(pairs, joints.normal[points], strict=True))
    length = dict(zip(pairs, joints.length[points], strict=True))
    assert normal[0, 1] == pytest.approx([0, 1], abs=1e-15)
    assert normal[0, 2] == pytest.approx([0, 1], abs=1e-15)
    assert normal[1, 2] == pytest.approx([1, 0], abs=1e-15)
    assert length == pytest.approx({(0, 1): 0.1, (0, 2): 0.1, (1, 2): 0.1}, rel=1e-12)


def test_four_blocks_meet_in_four_points_and_not_across_the_corner():
    joints = joints_of(free_scene(wall([[1, 1], [1, 1]], (0.4, 0.2), 1)))
    points = at(joints, 0.4, 0.2)
    assert sorted(tuple(pair) for pair in joints.bodies[points]) == [(0, 1), (0, 2), (1, 3), (2, 3)]
    assert len(np.unique(joints.nodes[points])) == 4


def test_first_side_is_the_lower_body_and_the_normal_points_to_the_second():
    joints = joints_of(on_ground(wall([[1, 1], [1, 1]], (0.4, 0.2), 1), coulomb(0.5)))
    assert np.all(joints.bodies[:, 0] < joints.bodies[:, 1])
    centre = np.array([[0.2, 0.1], [0.6, 0.1], [0.2, 0.3], [0.6, 0.3]])
    ahead = np.sum((centre[joints.bodies[:, 1]] - joints.position) * joints.normal, axis=1)
    assert np.all(ahead > 0.05)
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    assert joints.tangent == pytest.approx(joints.normal @ quarter.T, abs=1e-15)


def test_points_on_the_ground():
    joints = joints_of(on_ground(wall([[1, 1]], (0.4, 0.2), 1), coulomb(0.5)))
    on_rock = joints.bodies[:, 0] == GROUND
    assert np.count_nonzero(on_rock) == 6  # three under every block
    assert np.all(joints.nodes[on_rock, 0] == GROUND)
    assert joints.normal[on_rock] == pytest.approx(np.tile([0.0, 1.0], (6, 1)), abs=1e-15)


def test_joint_around_a_corner_has_a_point_for_each_side():
    angle_iron = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    joints = joints_of(free_scene(polygons([angle_iron, rectangle(1, 1, 2, 2)], 1.0)))
    corner = at(joints, 1.0, 1.0)
    normals = sorted(tuple(np.round(normal, 12) + 0.0) for normal in joints.normal[corner])
    assert normals == [(0.0, 1.0), (1.0, 0.0)]
    assert joints.length[corner] == pytest.approx([0.5, 0.5], rel=1e-12)
    assert len(joints.length) == 4


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


def test_segments_are_the_facets():
    joints = joints_of(on_ground(wall([[1, 1], [0.5, 1, 0.5]], (0.4, 0.2), 1), coulomb(0.5)))
    ends = joints.position[joints.segments]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert length.sum() == pytest.approx(joints.length.sum(), rel=1e-12)
    assert len(length) == 4 + 4 + 3
    # Both ends of a segment are points of one pair of bodies.
    assert np.array_equal(
        joints.bodies[joints.segments[:, 0]], joints.bodies[joints.segments[:, 1]]
    )


def test_laws_of_groups():
    scene = on_ground(
        wall([[1, 1], [1, 1]], (0.4, 0.2), 1),
        coulomb(0.3),
        foundations={"base": JointLaw("frictionless")},
    )
    scene = Scene(
        scene.mesh,
        scene.materials,
        live=PUSH,
        joints={"default": coulomb(0.3), "bed": tresca(5e3)},
        foundations=scene.foundations,
    )
    joints = joints_of(scene)
    assert joints.names == ("default", "bed", "base")
    on_rock = joints.bodies[:, 0] == GROUND
    bed = (np.abs(joints.normal[:, 1]) > 0.5) & ~on_rock
    head = ~bed & ~on_rock
    assert set(joints.law[bed]) == {1} and set(joints.law[head]) == {0}
    assert set(joints.law[on_rock]) == {2}
    assert joints.friction == pytest.approx(np.where(head, 0.3, 0.0))
    assert joints.shear_strength == pytest.approx(np.where(bed, 5e3 * joints.length, 0.0))
    assert joints.shear_strength.sum() == pytest.approx(5e3 * 0.8, rel=1e-12)


@pytest.mark.parametrize("side", ["top0", "bottom1"])
def test_group_on_one_side_is_enough(side):
    drawing = grid_blocks(((0, 0), (1, 1), (2, 1)), ((0, 1), (1, 1), (2, 1)))
    laws = {"default": coulomb(0.3), side: tresca(2e3)}
    joints = joints_of(free_scene(drawing.model(), laws))
    assert set(joints.law) == {1}
    assert joints.shear_strength.sum() == pytest.approx(2e3, rel=1e-12)


def test_joints_do_not_depend_on_numbers():
    drawing = Drawing.of(wall([[1, 1], [0.5, 1, 0.5]], elements=1))
    tables = []
    for seed in (None, 5):
        changed = drawing if seed is None else drawing.renumbered(seed)
        joints = joints_of(on_ground(changed.model(), coulomb(0.5)))
        rows = np.column_stack([joints.position, np.abs(joints.normal), joints.length])
        tables.append(rows[np.lexsort(np.round(rows, 9).T)])
    assert tables[0] == pytest.approx(tables[1], abs=1e-12)


def test_blocks_apart_have_no_joint():
    drawing = grid_blocks(((0, 0), (1, 1), (1, 1)), ((0, 1.01), (1, 1), (1, 1)))
    joints = joints_of(free_scene(drawing.model()))
    assert len(joints.length) == 0
    assert joints.segments.shape == (0, 2)


def test_joint_group_with_no_facet_opposite():
    model = wall([[1], [1]], (0.4, 0.2), 1)
    scene = free_scene(model, {"default": coulomb(0.5), "base": coulomb(0.5)})
    with pytest.raises(InputError, match="joint group 'base': 2 facets have no facet opposite"):
        joints_of(scene)


@pytest.mark.parametrize(("divisions", "shift"), [(3, 0.0), (2, 0.25), (2, 0.05), (7, 0.3)])
def test_facets_that_touch_without_matching_nodes(divisions, shift):
    drawing = grid_blocks(((0, 0), (1, 1), (2, 2)), ((shift, 1), (1, 1), (divisions, 2)))
    with pytest.raises(InputError, match="touch another block without matching nodes"):
        joints_of(free_scene(drawing.model()))


def test_group_of_facets_without_matching_nodes():
    drawing = grid_blocks(((0, 0), (1, 1), (2, 2)), ((0, 1), (1, 1), (3, 2)))
    with pytest.raises(InputError, match="'top0': 2 facets have no facet opposite"):
        joints_of(free_scene(drawing.model(), {"top0": coulomb(0.5)}))


def test_blocks_that_touch_at_a_corner_only_are_fine():
    drawing = grid_blocks(((0, 0), (1, 1), (2, 2)), ((1, 1), (1, 1), (3, 3)))
    assert len(joints_of(free_scene(drawing.model())).length) == 0


def test_blocks_that_touch_with_no_law():
    scene = free_scene(wall([[1], [1]], (0.4, 0.2), 1), joints={})
    with pytest.raises(InputError, match=r"no joint group of their own; add \[joints\.default\]"):
        joints_of(scene)


def test_sides_of_a_joint_in_different_groups():
    drawing = grid_blocks(((0, 0), (1, 1), (2, 1)), ((0, 1), (1, 1), (2, 1)))
    laws = {"top0": coulomb(0.5), "bottom1": coulomb(0.6)}
    with pytest.raises(InputError, match="'top0' and 'bottom1' are the two sides of 2 facets"):
        joints_of(free_scene(drawing.model(), laws))


def test_foundation_that_touches_a_block():
    scene = free_scene(wall([[1], [1]], (0.4, 0.2), 1), foundations={"bed": coulomb(0.5)})
    with pytest.raises(InputError, match="foundation 'bed': 4 facets touch another block"):
        joints_of(scene)


def test_blocks_that_lie_on_each_other():
    # Two blocks in one place face a third.
    drawing = grid_blocks(
        ((0, 0), (1, 1), (1, 1)), ((0, 1), (1, 1), (1, 1)), ((0, 1), (1, 1), (1, 1))
    )
    with pytest.raises(InputError, match="three or more facets coincide"):
        joints_of(free_scene(drawing.model()))


def test_facet_in_a_joint_and_a_foundation():
    drawing = Drawing.of(wall([[1], [1]], (0.4, 0.2), 1))
    drawing.facets["foot"] = drawing.facets["base"]
    scene = free_scene(drawing.model(), foundations={"base": coulomb(0.5), "foot": coulomb(0.5)})
    with pytest.raises(InputError, match="'base' and 'foot' share 2 facets"):
        joints_of(scene)


def test_scene_of_one_block_with_no_joint_at_all():
    scene = Scene(
        mesh_of(wall([[1]], elements=1)),
        {"default": Material(1e9, 0.2, 1.0)},
        live=Load((1.0, 0.0)),
        dead=WEIGHT,
    )
    assert len(joints_of(scene).length) == 0
