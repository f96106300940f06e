"""Supports: what they hold, and in which coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import InputError, Scene
from fenics_contact.discretization.elasticity import assemble
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.materials import displacement_space
from fenics_contact.discretization.supports import Supports, find_supports
from fenics_contact.meshing import polygons
from tests.helpers import PUSH, STONE, Drawing, dense, grid_blocks, mesh_of, rectangle, rotation


def square(angle: float = 0.0, divisions: tuple[int, int] = (2, 2)) -> Drawing:
    """A block from (0, 0) to (1, 1), turned; its sides are groups."""
    return grid_blocks(((0, 0), (1, 1), divisions)).turned(angle)


def scene_with(model, supports: dict[str, str]) -> Scene:
    return Scene(mesh_of(model), {"default": STONE}, live=PUSH, supports=supports)


def supports_in(scene: Scene) -> Supports:
    return find_supports(scene, collect_boundary(scene.mesh, displacement_space(scene)))


def supports_of(drawing: Drawing, supports: dict[str, str]) -> Supports:
    return supports_in(scene_with(drawing.model(), supports))


def held_at(supports: Supports, x: float, y: float) -> list[bool]:
    """What is held at the node at a place."""
    (row,) = np.flatnonzero(np.abs(supports.points - [x, y]).max(axis=1) < 1e-12)
    return supports.held[row].tolist()


def triangles() -> Drawing:
    return Drawing.of(polygons([rectangle(0, 0, 1, 1)], 0.5))


@pytest.mark.parametrize(("draw", "side"), [(square, "bottom0"), (triangles, "base")])
def test_fixed_support_holds_its_nodes(draw, side):
    supports = supports_of(draw(), {side: "fixed"})
    assert len(supports.nodes) == 3
    assert np.all(supports.held)
    assert np.array_equal(supports.frame, np.tile(np.eye(2), (3, 1, 1)))
    assert np.all(np.diff(supports.nodes) > 0)
    assert np.abs(supports.points[:, 1]).max() < 1e-15
    assert not supports.inclined


def test_support_of_degree_two_holds_the_nodes_in_the_middle_too():
    scene = scene_with(square().model(), {"bottom0": "fixed", "left0": "roller"})
    supports = supports_in(replace(scene, degree=2))
    assert len(supports.nodes) == 5 + 4
    below = np.abs(supports.points[:, 1]) < 1e-12
    assert np.sort(supports.points[below, 0]) == pytest.approx([0, 0.25, 0.5, 0.75, 1], abs=1e-12)
    assert np.all(supports.held[below])
    assert supports.held[~below].tolist() == [[True, False]] * 4


@pytest.mark.parametrize("side", ["bottom0", "top0", "left0", "right0"])
def test_roller_on_an_axis_holds_its_normal(side):
    supports = supports_of(square(), {side: "roller"})
    upright = side in ("left0", "right0")
    assert supports.held.tolist() == [[upright, not upright]] * 3
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


@pytest.mark.parametrize("left", ["roller", "fixed"])
@pytest.mark.parametrize(
    ("degrees", "divisions"),
    [(0.0, (2, 2)), (90.0, (2, 2)), (20.0, (2, 2)), (0.0, (2, 100)), (0.0, (100, 2))],
)
def test_corner_of_two_supports_is_held_however_short_the_facets(left, degrees, divisions):
    drawing = square(np.radians(degrees), divisions)
    supports = supports_of(drawing, {"bottom0": "roller", "left0": left})
    across, along = divisions
    assert len(supports.nodes) == across + along + 1
    assert held_at(supports, 0.0, 0.0) == [True, True]
    if left == "roller":
        assert np.count_nonzero(supports.held) == across + along + 2


@pytest.mark.parametrize(
    ("kink", "both"), [(5.0, False), (14.0, False), (16.0, True), (40.0, True)]
)
def test_roller_along_a_curve_holds_the_mean_normal(kink, both):
    # Two sides of one roller group that meet at the origin, symmetric about the vertical.
    sag = np.tan(np.radians(0.5 * kink))
    outline = [(0, 0), (1, sag), (1, 2), (-1, 2), (-1, sag)]
    model = polygons([outline], 3.0, groups={"sole": [((0, 0), (1, sag)), ((-1, sag), (0, 0))]})
    supports = supports_in(scene_with(model, {"sole": "roller"}))
    assert held_at(supports, 0.0, 0.0) == ([True, True] if both else [False, True])


def test_facet_in_two_supports():
    drawing = square()
    drawing.facets["sole"] = drawing.facets["bottom0"][:1]
    with pytest.raises(InputError, match="'bottom0' and 'sole' share 1 facets"):
        supports_of(drawing, {"bottom0": "fixed", "sole": "roller"})


def test_free_directions_are_zero_where_held():
    supports = supports_of(square(np.radians(30.0)), {"bottom0": "roller"})
    free = np.setdiff1d(np.arange(9), supports.nodes)[:2]
    held, *others = supports.free_directions(np.array([supports.nodes[1], *free]))
    assert np.array_equal(others, np.tile(np.eye(2), (2, 1, 1)))
    assert np.array_equal(held, supports.frame[1] * [0.0, 1.0])


@pytest.mark.parametrize("part", [slice(0, 9), slice(0, 4), slice(4, 9)])
def test_vectors_go_to_the_supports_coordinates_and_back(part):
    # Every rank has the supports of all nodes and the values of its own.
    supports = supports_of(square(np.radians(30.0)), {"bottom0": "roller"})
    everything = np.random.default_rng(0).standard_normal((9, 2))
    expected = everything.copy()
    expected[supports.nodes] = np.einsum("nij,ni->nj", supports.frame, expected[supports.nodes])
    constrained = expected.copy()
    constrained[supports.nodes, 0] = 0.0
    values = everything[part].ravel()
    turned = supports.to_supports(values, part.start)
    assert turned == pytest.approx(expected[part].ravel(), abs=1e-15)
    assert supports.to_cartesian(turned, part.start) == pytest.approx(values, abs=1e-15)
    forces = supports.constrain_vector(values, part.start)
    assert forces == pytest.approx(constrained[part].ravel(), abs=1e-15)
    assert np.array_equal(values, everything[part].ravel())  # what is given stays


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_constrained_matrix_is_turned_and_cleared(degrees):
    unsupported = scene_with(square(np.radians(degrees)).model(), {})
    scene = replace(unsupported, supports={"bottom0": "roller", "top0": "fixed"})
    space = displacement_space(scene)
    boundary = collect_boundary(scene.mesh, space)
    supports = find_supports(scene, boundary)
    none = find_supports(unsupported, boundary)
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
