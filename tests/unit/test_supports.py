"""Supports: what they hold in which coordinates, and which rigid motions they leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import InputError, Load, Scene
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.elasticity import assemble, displacement_space
from fenics_contact.meshing import polygons, wall
from fenics_contact.discretization.rigid_motions import RigidBodies, rigid_bodies
from fenics_contact.discretization.discretization import Structure
from fenics_contact.discretization.supports import Supports, find_supports
from tests.helpers import (
    PUSH,
    STONE,
    Drawing,
    coulomb,
    dense,
    grid_blocks,
    mesh_of,
    rectangle,
    rotation,
    vector_like,
    whole,
)


def square(angle: float = 0.0, divisions: tuple[int, int] = (2, 2)) -> Drawing:
    """A block from (0, 0) to (1, 1), turned; its sides are groups."""
    return grid_blocks(((0, 0), (1, 1), divisions)).turned(angle)


def scene_with(drawing: Drawing, supports: dict[str, str]) -> Scene:
    return Scene(mesh_of(drawing.model()), {"default": STONE}, live=PUSH, supports=supports)


def supports_of(drawing: Drawing, supports: dict[str, str]) -> Supports:
    scene = scene_with(drawing, supports)
    return find_supports(scene, collect_boundary(scene.mesh, displacement_space(scene)))


def bodies_of(drawing: Drawing, supports: dict[str, str], centre) -> RigidBodies:
    centre = np.atleast_2d(np.asarray(centre, dtype=float))
    none = np.zeros((len(centre), 3))
    return rigid_bodies(centre, none, none, supports_of(drawing, supports), 1.0)


def free_motions(bodies: RigidBodies) -> list[int]:
    return [int(np.any(free != 0.0, axis=0).sum()) for free in bodies.free]


def held_at(supports: Supports, x: float, y: float) -> list[bool]:
    """What is held at the node at a place."""
    row = np.flatnonzero(np.abs(supports.points - [x, y]).max(axis=1) < 1e-12)
    assert len(row) == 1
    return supports.held[row[0]].tolist()


def test_fixed_support_holds_its_nodes():
    supports = supports_of(square(), {"bottom0": "fixed"})
    assert len(supports.nodes) == 3
    assert np.all(supports.held)
    assert np.array_equal(supports.frame, np.tile(np.eye(2), (3, 1, 1)))
    assert np.all(np.diff(supports.nodes) > 0)
    assert np.abs(supports.points[:, 1]).max() < 1e-15
    assert not supports.inclined


def test_support_of_degree_two_holds_the_nodes_in_the_middle_too():
    scene = replace(scene_with(square(), {"bottom0": "fixed", "left0": "roller"}), degree=2)
    supports = find_supports(scene, collect_boundary(scene.mesh, displacement_space(scene)))
    assert len(supports.nodes) == 5 + 4
    below = np.abs(supports.points[:, 1]) < 1e-12
    assert np.sort(supports.points[below, 0]) == pytest.approx([0, 0.25, 0.5, 0.75, 1], abs=1e-12)
    assert np.all(supports.held[below])
    assert supports.held[~below].tolist() == [[True, False]] * 4


@pytest.mark.parametrize(
    ("side", "held"),
    [
        ("bottom0", [False, True]),
        ("top0", [False, True]),
        ("left0", [True, False]),
        ("right0", [True, False]),
    ],
)
def test_roller_on_an_axis_holds_its_normal(side, held):
    supports = supports_of(square(), {side: "roller"})
    assert supports.held.tolist() == [held] * 3
    assert np.array_equal(supports.frame, np.tile(np.eye(2), (3, 1, 1)))
    assert not supports.inclined


@pytest.mark.parametrize("degrees", [30.0, -75.0, 135.0, 0.01])
def test_inclined_roller_turns_its_nodes(degrees):
    angle = np.radians(degrees)
    supports = supports_of(square(angle), {"bottom0": "roller"})
    assert supports.inclined
    assert supports.held.tolist() == [[True, False]] * 3
    normal = rotation(angle) @ [0.0, -1.0]
    for frame in supports.frame:
        assert abs(frame[:, 0] @ normal) == pytest.approx(1.0, abs=1e-14)
        assert frame.T @ frame == pytest.approx(np.eye(2), abs=1e-14)
        assert np.linalg.det(frame) == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("degrees", [0.0, 90.0, 20.0])
def test_corner_of_two_rollers_is_held(degrees):
    angle = np.radians(degrees)
    drawing = square(angle)
    supports = supports_of(drawing, {"bottom0": "roller", "left0": "roller"})
    assert len(supports.nodes) == 5
    assert held_at(supports, 0.0, 0.0) == [True, True]
    assert np.count_nonzero(supports.held) == 6


@pytest.mark.parametrize("divisions", [(2, 100), (100, 2)])
def test_corner_of_two_rollers_is_held_however_short_the_facets(divisions):
    drawing = square(divisions=divisions)
    supports = supports_of(drawing, {"bottom0": "roller", "left0": "roller"})
    assert held_at(supports, 0.0, 0.0) == [True, True]


@pytest.mark.parametrize("divisions", [(2, 100), (2, 2), (100, 2)])
def test_fixed_support_next_to_a_roller_holds_their_corner(divisions):
    drawing = square(divisions=divisions)
    supports = supports_of(drawing, {"bottom0": "roller", "left0": "fixed"})
    assert held_at(supports, 0.0, 0.0) == [True, True]


@pytest.mark.parametrize(
    ("kink", "both"), [(5.0, False), (14.0, False), (16.0, True), (40.0, True)]
)
def test_roller_along_a_curve_holds_the_mean_normal(kink, both):
    # Two sides of one roller group that meet at the origin, symmetric about the vertical.
    sag = np.tan(np.radians(0.5 * kink))
    outline = [(0, 0), (1, sag), (1, 2), (-1, 2), (-1, sag)]
    model = polygons([outline], 3.0, groups={"sole": [((0, 0), (1, sag)), ((-1, sag), (0, 0))]})
    scene = Scene(mesh_of(model), {"default": STONE}, live=PUSH, supports={"sole": "roller"})
    supports = find_supports(scene, collect_boundary(scene.mesh, displacement_space(scene)))
    assert held_at(supports, 0.0, 0.0) == ([True, True] if both else [False, True])


def test_facet_in_two_supports():
    drawing = square()
    drawing.facets["sole"] = drawing.facets["bottom0"][:1]
    with pytest.raises(InputError, match="'bottom0' and 'sole' share 1 facets"):
        supports_of(drawing, {"bottom0": "fixed", "sole": "roller"})


def test_free_directions_are_zero_where_held():
    supports = supports_of(square(np.radians(30.0)), {"bottom0": "roller"})
    free = np.setdiff1d(np.arange(9), supports.nodes)[:2]
    directions = supports.free_directions(np.array([supports.nodes[1], *free]))
    assert np.array_equal(directions[1:], np.tile(np.eye(2), (2, 1, 1)))
    assert np.array_equal(directions[0][:, 0], [0.0, 0.0])
    assert np.array_equal(directions[0][:, 1], supports.frame[1][:, 1])


def test_vectors_go_to_the_supports_coordinates_and_back():
    scene = scene_with(square(np.radians(30.0)), {"bottom0": "roller"})
    space = displacement_space(scene)
    boundary = collect_boundary(scene.mesh, space)
    supports = find_supports(scene, boundary)
    elasticity = assemble(scene, space, boundary, supports)
    values = np.random.default_rng(0).standard_normal(elasticity.dead.getSize())
    vector = vector_like(elasticity.dead, values)
    supports.to_supports(vector)
    turned = whole(vector).reshape(-1, 2)
    there = values.reshape(-1, 2)[supports.nodes]
    expected = np.einsum("nij,ni->nj", supports.frame, there)
    assert turned[supports.nodes] == pytest.approx(expected, abs=1e-15)
    supports.to_cartesian(vector)
    assert whole(vector) == pytest.approx(values, abs=1e-15)
    supports.constrain_vector(vector)
    constrained = whole(vector).reshape(-1, 2)[supports.nodes]
    assert np.array_equal(constrained[:, 0], np.zeros(3))
    assert constrained[:, 1] == pytest.approx(expected[:, 1], abs=1e-15)


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_constrained_matrix_is_turned_and_cleared(degrees):
    drawing = square(np.radians(degrees))
    unsupported = scene_with(drawing, {})
    scene = replace(unsupported, supports={"bottom0": "roller", "top0": "fixed"})
    space = displacement_space(scene)
    boundary = collect_boundary(scene.mesh, space)
    none = find_supports(unsupported, boundary)
    supports = find_supports(scene, boundary)
    bare = dense(assemble(unsupported, space, boundary, none).stiffness)
    constrained = dense(assemble(scene, space, boundary, supports).stiffness)
    turn = np.eye(len(bare))
    for node, frame in zip(supports.nodes, supports.frame, strict=True):
        turn[2 * node : 2 * node + 2, 2 * node : 2 * node + 2] = frame
    expected = turn.T @ bare @ turn
    mean = np.trace(bare) / len(bare)
    held = (2 * supports.nodes[:, None] + np.arange(2))[supports.held]
    assert len(held) == 9
    expected[held] = expected[:, held] = 0.0
    expected[held, held] = mean
    assert constrained == pytest.approx(expected, abs=1e-12 * mean)


@pytest.mark.parametrize("degrees", [0.0, 30.0])
@pytest.mark.parametrize(
    ("kinds", "free"),
    [
        ({}, 3),
        ({"bottom0": "roller"}, 1),
        ({"bottom0": "roller", "top0": "roller"}, 1),
        ({"bottom0": "roller", "left0": "roller"}, 0),
        ({"bottom0": "fixed"}, 0),
    ],
)
def test_number_of_free_motions(kinds, free, degrees):
    bodies = bodies_of(square(np.radians(degrees)), kinds, [0.3, 0.4])
    assert free_motions(bodies) == [free]
    assert bodies.floating.tolist() == [free > 0]
    gram = bodies.free[0].T @ bodies.free[0]
    assert gram == pytest.approx(np.diag(np.diag(gram)), abs=1e-14)
    assert np.trace(gram) == pytest.approx(free, abs=1e-14)


def test_block_on_a_roller_is_free_along_it():
    angle = np.radians(30.0)
    bodies = bodies_of(square(angle), {"bottom0": "roller"}, [0.3, 0.4])
    motion = bodies.free[0][:, np.any(bodies.free[0] != 0.0, axis=0)].ravel()
    along = np.array([*(rotation(angle) @ [1.0, 0.0]), 0.0])
    assert abs(motion @ along) == pytest.approx(1.0, abs=1e-12)


def test_wheel_on_rollers_all_around_is_free_to_turn():
    angles = 2 * np.pi * np.arange(32) / 32
    rim = np.column_stack([np.cos(angles), np.sin(angles)])
    around = list(zip(rim, np.roll(rim, -1, axis=0), strict=True))
    model = polygons([rim], 3.0, groups={"rim": around})
    bodies = bodies_of(Drawing.of(model), {"rim": "roller"}, [0.0, 0.0])
    assert free_motions(bodies) == [1]
    motion = bodies.free[0][:, np.any(bodies.free[0] != 0.0, axis=0)].ravel()
    assert np.abs(motion) == pytest.approx([0.0, 0.0, 1.0], abs=1e-7)


def test_bodies_are_held_one_by_one():
    blocks = [((3.0 * k, 0), (1, 1), (1, 1)) for k in range(3)]
    drawing = grid_blocks(*blocks)
    kinds = {"bottom0": "fixed", "left2": "roller"}
    bodies = bodies_of(drawing, kinds, [[0.5, 0.5], [3.5, 0.5], [6.5, 0.5]])
    assert free_motions(bodies) == [0, 3, 1]


def test_moments_are_scaled_by_the_size():
    dead, live = np.array([[1.0, 2.0, 3.0]]), np.array([[4.0, 5.0, 6.0]])
    supports = supports_of(square(), {})
    bodies = rigid_bodies(np.array([[0.5, 0.5]]), dead, live, supports, 2.0)
    assert np.array_equal(bodies.dead, [[1.0, 2.0, 1.5]])
    assert np.array_equal(bodies.live, [[4.0, 5.0, 3.0]])


def build(model, supports=None, foundations=None) -> Structure:
    scene = Scene(
        mesh_of(model),
        {"default": STONE},
        live=PUSH,
        joints={"default": coulomb(0.5)},
        supports=supports or {},
        foundations=foundations or {},
    )
    return Structure.build(scene)


def test_blocks_that_nothing_holds():
    with pytest.raises(InputError, match=r"2 blocks, .* touch neither a support"):
        build(wall([[1], [1]], elements=1))


def test_blocks_beside_a_held_structure():
    drawing = grid_blocks(
        ((0, 0), (1, 1), (1, 1)), ((0, 1), (1, 1), (1, 1)), ((5, 0), (1, 1), (1, 1))
    )
    with pytest.raises(
        InputError, match=r"1 blocks, the first around \(5\.5, 0\.5\), touch neither"
    ):
        build(drawing.model(), foundations={"bottom0": coulomb(0.5)})


def test_blocks_that_can_move_all_together():
    model = wall([[1], [1]], elements=1)
    with pytest.raises(InputError, match="can move all together even with closed joints"):
        build(model, supports={"base": "roller"})


def test_stack_between_rollers_is_held_as_a_whole():
    model = wall([[1], [1]], elements=1)
    structure = build(model, supports={"base": "roller", "left": "roller"})
    assert structure.bodies.floating.tolist() == [False, True]


def test_foundation_holds_what_stands_on_it():
    structure = build(wall([[1], [1]], elements=1), foundations={"base": coulomb(0.5)})
    assert structure.bodies.floating.tolist() == [True, True]


def test_live_load_on_held_blocks_only():
    drawing = grid_blocks(((0, 0), (1, 1), (1, 1)), ((0, 1), (1, 1), (1, 1)))
    drawing.cells = {"rock": drawing.cells["blocks"][:1], "stone": drawing.cells["blocks"][1:]}
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        live=Load(traction={"left0": (1.0, 0.0)}),
        joints={"default": coulomb(0.5)},
        supports={"bottom0": "fixed"},
    )
    with pytest.raises(InputError, match="live load is zero on every free body"):
        Structure.build(scene)


def test_rectangle_block_of_triangles_is_held_like_one_of_quadrilaterals():
    model = polygons([rectangle(0, 0, 1, 1)], 0.5)
    supports = supports_of(Drawing.of(model), {"base": "fixed"})
    assert len(supports.nodes) == 3
    assert np.all(supports.held)


def test_rigid_motions_of_blocks_that_no_support_touches():
    blocks = [((0, k), (1, 1), (1, 1)) for k in range(3)]
    problem = build(
        grid_blocks(*blocks).model(), supports={"bottom0": "roller", "left0": "roller"}
    ).problem
    rigid, stiffness = dense(problem.rigid), dense(problem.stiffness)
    gram = rigid.T @ rigid
    assert gram == pytest.approx(np.diag([0.0] * 3 + [1.0] * 6), abs=1e-14)
    assert np.abs(stiffness @ rigid).max() < 1e-13 * np.abs(stiffness).max()
