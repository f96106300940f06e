"""The gmsh builders: what is drawn has the blocks, areas, nodes and groups asked for."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.elasticity import displacement_space
from fenics_contact.discretization.joints import find_joints
from fenics_contact.mesh import extract, gmsh_session
from fenics_contact.meshing import (
    arch,
    buttress,
    model_from_arrays,
    polygons,
    running_bond,
    wall,
    wedge,
)
from tests.helpers import (
    Drawing,
    cell_areas,
    coulomb,
    group_lengths,
    mesh_of,
    on_ground,
    rectangle,
)

LENGTH, HEIGHT = 0.4, 0.175


def joint_length(model) -> float:
    """Length of all joints between blocks; facets that do not match raise."""
    scene = on_ground(model, coulomb(0.5), foundations={})
    boundary = collect_boundary(scene.mesh, displacement_space(scene))
    return float(find_joints(scene, boundary).length.sum())


@pytest.mark.parametrize("elements", [1, 2, 3])
def test_wall_in_two_courses(elements):
    model = wall([[1, 1], [0.5, 1, 0.5]], (LENGTH, HEIGHT), elements)
    drawn = extract(model, "wall")
    assert mesh_of(model).body_count == 5
    assert cell_areas(drawn).sum() == pytest.approx(4 * LENGTH * HEIGHT, rel=1e-12)
    assert drawn.cell_names == ("blocks",)
    assert group_lengths(drawn) == pytest.approx(
        {
            "base": 2 * LENGTH,
            "top": 2 * LENGTH,
            "left": 2 * HEIGHT,
            "right": 2 * HEIGHT,
            "bed": 2 * (2 * LENGTH),  # both sides of the joint
            "head": 2 * (3 * HEIGHT),
        },
        rel=1e-12,
    )


def test_wall_with_a_void_has_an_opening():
    model = wall([[1, 1, 1], [1, -1, 1], [1, 1, 1]], (LENGTH, HEIGHT), 1)
    drawn = extract(model, "wall")
    assert mesh_of(model).body_count == 8
    assert cell_areas(drawn).sum() == pytest.approx(8 * LENGTH * HEIGHT, rel=1e-12)
    assert group_lengths(drawn) == pytest.approx(
        {
            "base": 3 * LENGTH,
            "top": 3 * LENGTH,
            "left": 3 * HEIGHT,
            "right": 3 * HEIGHT,
            "bed": 2 * (4 * LENGTH),
            "head": 2 * (4 * HEIGHT),
            "opening": 2 * LENGTH + 2 * HEIGHT,
        },
        rel=1e-12,
    )


@pytest.mark.parametrize("course", [[1, -1], [-1, 1]])
def test_void_at_the_end_of_a_course_is_a_step_not_the_top(course):
    lengths = group_lengths(extract(wall([[1, 1], course], (LENGTH, HEIGHT), 1), "wall"))
    assert lengths["top"] == pytest.approx(LENGTH, rel=1e-12)
    assert lengths["opening"] == pytest.approx(LENGTH + HEIGHT, rel=1e-12)
    side, other = ("left", "right") if course[0] > 0 else ("right", "left")
    assert lengths[side] == pytest.approx(2 * HEIGHT, rel=1e-12)
    assert lengths[other] == pytest.approx(HEIGHT, rel=1e-12)


def test_elements_count_along_half_a_block_and_keep_their_shape():
    # Two elements of 0.1 along half a block; 0.175 is divided in two as well.
    triangles = extract(wall([[1]], (0.4, 0.175), 2), "wall")
    squares = extract(wall([[1]], (0.4, 0.175), 2, quadrilaterals=True), "wall")
    assert (triangles.cell_name, len(triangles.cells)) == ("triangle", 16)
    assert (squares.cell_name, len(squares.cells)) == ("quadrilateral", 8)
    assert len(triangles.points) == len(squares.points) == 15
    assert cell_areas(triangles) == pytest.approx(np.full(16, 0.1 * 0.0875 / 2), rel=1e-12)
    assert cell_areas(squares) == pytest.approx(np.full(8, 0.1 * 0.0875), rel=1e-12)


def test_diagonals_alternate():
    drawn = extract(wall([[1]], (0.4, 0.4), 2), "wall")
    sides = np.concatenate([drawn.cells[:, [0, 1]], drawn.cells[:, [1, 2]], drawn.cells[:, [2, 0]]])
    step = drawn.points[sides[:, 1]] - drawn.points[sides[:, 0]]
    slope = step[:, 0] * step[:, 1]
    rising, falling = int((slope > 1e-9).sum()), int((slope < -1e-9).sum())
    assert rising == falling == 16  # every diagonal is a side of two triangles


def test_blocks_of_a_wall_share_no_node():
    drawn = extract(wall([[1, 1], [1, 1]], (LENGTH, HEIGHT), 1), "wall")
    middle = np.abs(drawn.points - [LENGTH, HEIGHT]).max(axis=1) < 1e-12
    assert int(middle.sum()) == 4


def test_joint_facets_of_a_wall_match():
    model = wall([[1, 1], [0.5, 1, 0.5]], (LENGTH, HEIGHT), 2)
    assert joint_length(model) == pytest.approx(2 * LENGTH + 3 * HEIGHT, rel=1e-12)


@pytest.mark.parametrize("quadrilaterals", [False, True])
def test_lengths_off_the_grid_are_drawn_as_polygons(quadrilaterals):
    model = wall([[1 / 3, 2 / 3], [1]], (LENGTH, HEIGHT), 1, quadrilaterals)
    drawn = extract(model, "wall")
    assert drawn.cell_name == ("quadrilateral" if quadrilaterals else "triangle")
    assert mesh_of(model).body_count == 3
    assert cell_areas(drawn).sum() == pytest.approx(2 * LENGTH * HEIGHT, rel=1e-12)
    assert joint_length(model) == pytest.approx(LENGTH + HEIGHT, rel=1e-9)


def test_lengths_off_the_grid_have_the_same_groups():
    drawn = extract(wall([[1 / 3, 2 / 3, 1], [1, -1]], (LENGTH, HEIGHT), 1), "wall")
    assert group_lengths(drawn) == pytest.approx(
        {
            "base": 2 * LENGTH,
            "top": LENGTH,
            "left": 2 * HEIGHT,
            "right": HEIGHT,
            "bed": 2 * LENGTH,
            "head": 2 * (2 * HEIGHT),
            "opening": LENGTH + HEIGHT,
        },
        rel=1e-9,
    )


def test_running_bond_has_half_bricks_in_every_second_course():
    model = running_bond(3, 4, (LENGTH, HEIGHT), 1)
    drawn = extract(model, "bond")
    assert mesh_of(model).body_count == 2 * 3 + 2 * 4
    assert cell_areas(drawn).sum() == pytest.approx(12 * LENGTH * HEIGHT, rel=1e-12)
    lengths = group_lengths(drawn)
    assert lengths["head"] == pytest.approx(2 * (2 * 2 + 2 * 3) * HEIGHT, rel=1e-12)
    assert lengths["bed"] == pytest.approx(2 * 3 * (3 * LENGTH), rel=1e-12)
    assert lengths["left"] == pytest.approx(4 * HEIGHT, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([],), "every course"),
        (([[1, 0]],), "other than zero"),
        (([[-1, -1]],), "no block"),
        (([[]],), "wall: "),
        (([[1]], (0.0, 1.0)), "positive"),
        (([[1]], (1.0, -1.0)), "positive"),
        (([[1]], (1.0, 1.0), 0), "positive"),
    ],
)
def test_wall_refuses(arguments, message):
    with pytest.raises(InputError, match=message):
        wall(*arguments)


@pytest.mark.parametrize(("bricks", "courses"), [(0, 1), (0, 2), (-1, 2), (2, 0)])
def test_running_bond_refuses_what_has_no_bricks(bricks, courses):
    with pytest.raises(InputError):
        running_bond(bricks, courses)


# Two blocks side by side on a longer one: their common corner lies on its side.
T_JOINT = [rectangle(0, 0, 2, 1), rectangle(0, 1, 0.7, 2), rectangle(0.7, 1, 2, 2)]


@pytest.mark.parametrize("size", [0.45, 5.0])
@pytest.mark.parametrize("quadrilaterals", [False, True])
def test_t_joint_has_matching_nodes_on_both_sides(size, quadrilaterals):
    model = polygons(T_JOINT, size, quadrilaterals=quadrilaterals)
    drawn = extract(model, "polygons")
    # Along the bed joint every node is there twice, and thrice where three blocks meet.
    x = np.sort(drawn.points[np.abs(drawn.points[:, 1] - 1.0) < 1e-9, 0])
    at, count = np.unique(np.round(x, 9), return_counts=True)
    assert np.array_equal(count, np.where(at == 0.7, 3, 2))
    halves = 2 if quadrilaterals else 1
    expected = 1 + halves * (int(np.ceil(0.7 / size)) + int(np.ceil(1.3 / size)))
    assert len(at) == expected
    assert joint_length(model) == pytest.approx(3.0, rel=1e-9)
    assert cell_areas(drawn).sum() == pytest.approx(4.0, rel=1e-12)
    assert mesh_of(model).body_count == 3


def test_clockwise_corners_draw_the_same_blocks():
    drawn = [extract(polygons([o[::d] for o in T_JOINT], 0.5), "polygons") for d in (1, -1)]
    for mesh in drawn:
        assert np.all(cell_areas(mesh) > 0.0)
        assert cell_areas(mesh).sum() == pytest.approx(4.0, rel=1e-12)
        assert group_lengths(mesh) == pytest.approx({"base": 2.0}, rel=1e-12)


def test_names_are_the_groups_of_blocks():
    drawn = extract(polygons(T_JOINT, 0.5, names=["sill", "post", "post"]), "polygons")
    assert set(drawn.cell_names) == {"sill", "post"}
    area = {
        name: cell_areas(drawn)[drawn.cell_groups == k].sum()
        for k, groups in enumerate(drawn.cell_sets)
        for name in groups
    }
    assert area == pytest.approx({"sill": 2.0, "post": 2.0}, rel=1e-12)


def test_groups_take_sides_on_their_segments():
    groups = {
        "ends": [((0, 0), (0, 2)), ((2, 0), (2, 2))],
        "short": [((0, 1), (0.7, 1))],  # both sides of the joint, cut at its T
        "most": [((0, 1), (1.9, 1))],  # its end lies inside a side, which does not count
    }
    lengths = group_lengths(extract(polygons(T_JOINT, 0.5, groups=groups), "polygons"))
    assert lengths == pytest.approx({"ends": 4.0, "short": 1.4, "most": 1.4}, rel=1e-12)


def test_base_is_the_lowest_level():
    feet = [rectangle(0, 0, 1, 1), rectangle(2, 0, 3, 1), rectangle(0, 1, 3, 2)]
    lengths = group_lengths(extract(polygons(feet, 1.0), "polygons"))
    assert lengths == pytest.approx({"base": 2.0}, rel=1e-12)


def test_element_size_is_respected():
    drawn = extract(polygons([rectangle(0, 0, 1, 1)], 0.3), "polygons")
    facets = drawn.points[drawn.facets]
    lengths = np.linalg.norm(facets[:, 1] - facets[:, 0], axis=1)
    assert lengths == pytest.approx(np.full(4, 0.25), rel=1e-9)


def test_quadrilaterals_do_not_stick_to_the_next_drawing():
    assert extract(polygons(T_JOINT, 0.5, quadrilaterals=True), "x").cell_name == "quadrilateral"
    with gmsh_session() as gmsh:
        options = ("Mesh.RecombineAll", "Mesh.SubdivisionAlgorithm", "Mesh.MeshSizeMax")
        assert [gmsh.option.getNumber(name) for name in options] == [0.0, 0.0, 1e22]
    assert extract(polygons(T_JOINT, 0.5), "x").cell_name == "triangle"


@pytest.mark.parametrize(
    ("outlines", "options", "message"),
    [
        ([], {}, "at least one block"),
        (T_JOINT, {"size": 0.0}, "positive size"),
        (T_JOINT, {"names": ["a"]}, "1 names for 3 blocks"),
        ([[(0, 0), (1, 0)]], {}, "block 0 needs at least three corners"),
        ([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]], {}, "block 0 needs at least three corners"),
        ([rectangle(0, 0, 1, 1), [(3, 0), (4, 1), (5, 2)]], {}, "block 1 has no area"),
        (T_JOINT, {"groups": {"roof": [((0, 3), (2, 3))]}}, "'roof'"),
    ],
)
def test_polygons_refuses(outlines, options, message):
    with pytest.raises(InputError, match=message):
        polygons(outlines, **({"size": 0.5} | options))


def test_model_from_arrays_names_its_groups():
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (2, 1)]
    model = model_from_arrays(
        points,
        {"left": [[0, 1, 2, 3]], "right": [[1, 4, 5, 2]], "none": []},
        {"base": [[0, 1], [1, 4]]},
        "two",
    )
    drawing = Drawing.of(model)
    assert np.array_equal(drawing.points, np.array(points, dtype=float))
    assert {name: cells.tolist() for name, cells in drawing.cells.items()} == {
        "left": [[0, 1, 2, 3]],
        "right": [[1, 4, 5, 2]],
    }
    assert drawing.facets["base"].tolist() == [[0, 1], [1, 4]]


@pytest.mark.parametrize("quadrilaterals", [False, True])
def test_arch_of_equal_voussoirs(quadrilaterals):
    count, thickness, radius, embrace = 7, 0.2, 1.0, 150.0
    model = arch(count, thickness, radius, embrace, 2, quadrilaterals)
    drawn = extract(model, "arch")
    assert drawn.cell_name == ("quadrilateral" if quadrilaterals else "triangle")
    assert mesh_of(model).body_count == count
    step = np.radians(embrace) / count
    inner, outer = radius - thickness / 2, radius + thickness / 2
    area = count * 0.5 * np.sin(step) * (outer**2 - inner**2)
    assert cell_areas(drawn).sum() == pytest.approx(area, rel=1e-9)
    chord = 2 * count * np.sin(step / 2)
    assert group_lengths(drawn) == pytest.approx(
        {"springings": 2 * thickness, "intrados": chord * inner, "extrados": chord * outer},
        rel=1e-9,
    )
    assert joint_length(model) == pytest.approx((count - 1) * thickness, rel=1e-9)
    reach = np.linalg.norm(drawn.points, axis=1)
    assert reach.max() == pytest.approx(outer, rel=1e-9)
    assert np.arctan2(drawn.points[:, 0], drawn.points[:, 1]).max() == pytest.approx(
        np.radians(embrace / 2), rel=1e-9
    )


def test_wedge_between_two_blocks():
    half_angle, height, length = 25.0, 0.5, 2.0
    model = wedge(half_angle, height, length, 0.5)
    drawn = extract(model, "wedge")
    half = height * np.tan(np.radians(half_angle))
    flank = np.hypot(half, height)
    assert mesh_of(model).body_count == 3
    assert set(drawn.cell_names) == {"blocks", "wedge"}
    area = {
        name: cell_areas(drawn)[drawn.cell_groups == k].sum()
        for k, names in enumerate(drawn.cell_sets)
        for name in names
    }
    blocks = 2 * length * height - half * height
    assert area == pytest.approx({"wedge": half * height, "blocks": blocks}, rel=1e-9)
    assert group_lengths(drawn) == pytest.approx(
        {"base": 2 * length, "top": 2 * half, "flanks": 4 * flank}, rel=1e-9
    )
    assert joint_length(model) == pytest.approx(2 * flank, rel=1e-9)


@pytest.mark.parametrize("courses", [1, 3])
def test_buttress_leans_on_a_wall(courses):
    width, foot, height = 0.8, 1.2, 0.5
    model = buttress(courses, width, foot, height, 0.4)
    drawn = extract(model, "buttress")
    total = courses * height
    assert mesh_of(model).body_count == 2 * courses
    assert cell_areas(drawn).sum() == pytest.approx((width + foot / 2) * total, rel=1e-9)
    assert group_lengths(drawn) == pytest.approx(
        {"base": width + foot, "left": total, "back": 2 * total}, rel=1e-9
    )
    cuts = foot * np.arange(1, courses) / courses
    beds = (courses - 1) * width + cuts.sum()
    assert joint_length(model) == pytest.approx(beds + total, rel=1e-9)


@pytest.mark.parametrize(
    ("builder", "arguments"),
    [
        (arch, (0, 0.2)),
        (arch, (7, 0.0)),
        (arch, (7, 2.0)),
        (arch, (7, 0.2, 1.0, 0.0)),
        (arch, (7, 0.2, 1.0, 361.0)),
        (arch, (7, 0.2, 1.0, 180.0, 0)),
        (wedge, (0.0,)),
        (wedge, (90.0,)),
        (wedge, (30.0, -1.0)),
        (wedge, (80.0, 1.0, 1.0)),
        (wedge, (30.0, 0.5, 3.0, 0.0)),
        (buttress, (0,)),
        (buttress, (2, 0.0)),
        (buttress, (2, 1.0, -1.0)),
        (buttress, (2, 1.0, 1.0, 0.0)),
        (buttress, (2, 1.0, 1.0, 0.5, 0.0)),
    ],
)
def test_builders_refuse(builder, arguments):
    with pytest.raises(InputError):
        builder(*arguments)


def test_polygons_choose_a_size_of_element():
    blocks = [[(x, 0.0), (x + 2.0, 0.0), (x + 2.0, 2.0), (x, 2.0)] for x in (0.0, 2.0)]
    drawn = extract(polygons(blocks), "two squares")
    sides = drawn.points[drawn.facets]
    length = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1)
    assert length == pytest.approx(np.full(8, 0.5), rel=1e-9)
