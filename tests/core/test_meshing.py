"""The gmsh builders: what is drawn has the blocks, areas, nodes and groups asked for."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.joints import find_joints
from fenics_contact.discretization.materials import displacement_space
from fenics_contact.geometry.gmsh_mesh import GmshMesh, bodies_of_cells, extract, gmsh_session
from fenics_contact.meshing import (
    arch,
    buttress,
    polygons,
    running_bond,
    wall,
    wedge,
)
from tests.helpers import cell_areas, coulomb, group_lengths, on_ground, rectangle

L, H = 0.4, 0.175


def joint_length(model) -> float:
    """Length of all joints between blocks; facets that do not match raise."""
    scene = on_ground(model, coulomb(0.5), foundations={})
    boundary = collect_boundary(scene.mesh, displacement_space(scene))
    return float(find_joints(scene, boundary).length.sum())


def body_count(drawn: GmshMesh) -> int:
    return int(bodies_of_cells(drawn).max()) + 1


def group_areas(drawn: GmshMesh) -> dict[str, float]:
    """Area of the cells of every two-dimensional group."""
    area = np.bincount(drawn.cell_groups, cell_areas(drawn))
    return {name: area[k] for k, names in enumerate(drawn.cell_sets) for name in names}


def facet_lengths(drawn: GmshMesh) -> np.ndarray:
    ends = drawn.points[drawn.facets]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


TWO_COURSES = [[1, 1], [0.5, 1, 0.5]]
OF_TWO_COURSES = {"base": 2 * L, "top": 2 * L, "left": 2 * H, "right": 2 * H, "bed": 2 * (2 * L),
                  "head": 2 * (3 * H)}  # fmt: skip  # joints: both sides
WITH_VOID = {"base": 3 * L, "top": 3 * L, "left": 3 * H, "right": 3 * H, "bed": 2 * (4 * L),
             "head": 2 * (4 * H), "opening": 2 * L + 2 * H}  # fmt: skip
OFF_GRID = {"base": 2 * L, "top": L, "left": 2 * H, "right": H, "bed": 2 * L, "head": 2 * (2 * H),
            "opening": L + H}  # fmt: skip
STAIR = {"base": 2 * L, "top": L, "bed": 2 * L, "head": 2 * H, "opening": L + H}
BOND = {"base": 3 * L, "top": 3 * L, "left": 4 * H, "right": 4 * H, "bed": 2 * (9 * L),
        "head": 2 * (10 * H)}  # fmt: skip


@pytest.mark.parametrize(
    ("draw", "blocks", "area", "lengths"),
    [
        *((lambda n=n: wall(TWO_COURSES, (L, H), n), 5, 4, OF_TWO_COURSES) for n in (1, 2, 3)),
        (lambda: wall([[1, 1, 1], [1, -1, 1], [1, 1, 1]], (L, H), 1), 8, 8, WITH_VOID),
        # A void at the end of a course is a step, not the top.
        (lambda: wall([[1, 1], [1, -1]], (L, H), 1), 3, 3, STAIR | {"left": 2 * H, "right": H}),
        (lambda: wall([[1, 1], [-1, 1]], (L, H), 1), 3, 3, STAIR | {"left": H, "right": 2 * H}),
        *(
            (lambda q=q: wall([[1 / 3, 2 / 3, 1], [1, -1]], (L, H), 1, q), 4, 3, OFF_GRID)
            for q in (False, True)
        ),
        (lambda: running_bond(3, 4, (L, H), 1), 2 * 3 + 2 * 4, 12, BOND),
    ],
)
def test_walls(draw, blocks, area, lengths):
    model = draw()
    drawn = extract(model, "wall")
    assert body_count(drawn) == blocks
    assert group_areas(drawn) == pytest.approx({"blocks": area * L * H}, rel=1e-12)
    assert group_lengths(drawn) == pytest.approx(lengths, rel=1e-9)
    joints = 0.5 * (lengths["bed"] + lengths["head"])
    assert joint_length(model) == pytest.approx(joints, rel=1e-9)


# Two blocks side by side on a longer one: their common corner lies on its side.
T_JOINT = [rectangle(0, 0, 2, 1), rectangle(0, 1, 0.7, 2), rectangle(0.7, 1, 2, 2)]


def test_groups_take_sides_on_their_segments():
    groups = {
        "ends": [((0, 0), (0, 2)), ((2, 0), (2, 2))],
        "short": [((0, 1), (0.7, 1))],  # both sides of the joint, cut at its T
        "most": [((0, 1), (1.9, 1))],  # its end divides both sides
        "beside": [((-1, 2), (0.5, 2))],
    }
    lengths = group_lengths(extract(polygons(T_JOINT, 0.5, groups=groups), "polygons"))
    assert lengths == pytest.approx(
        {"ends": 4.0, "short": 1.4, "most": 3.8, "beside": 0.5}, rel=1e-12
    )


def test_corners_that_nearly_coincide_are_one():
    off = 3e-7  # of a drawing with six digits
    blocks = [rectangle(0, 0, 2, 1), rectangle(0, 1 + off, 0.7, 2), rectangle(0.7 + off, 1, 2, 2)]
    assert joint_length(polygons(blocks, 0.3)) == pytest.approx(3.0, rel=1e-5)


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ([(0, 0), (2, 2), (2, 0), (0, 3)], r"block 0 crosses itself at \(1\.2, 1\.2\)"),
        ([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)], "crosses itself"),  # touches its own side
        ([(0, 0), (2, 0), (2, 2), (2, 3), (2, 2), (0, 2)], "crosses itself"),  # a spike
        ([(0, 0), (2, 0), (1, 0)], "no area"),
        ([(0, 0), (2, 0), (np.nan, 1)], "not finite"),
        ([(0, 0), (2, 0)], "three corners"),
    ],
)
def test_outline_that_is_no_block(corners, message):
    for first in range(len(corners)):
        with pytest.raises(InputError, match=message if not first else "block 0"):
            polygons([corners[first:] + corners[:first]], 1.0)


def test_outlines_that_only_look_wrong():
    notch = [(0, 0), (3, 0), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)]
    straight = [(0, 0), (1, 0), (2, 0), (2, 1), (0, 1), (0, 1)]
    for corners, area in ((notch, 5.0), (straight, 2.0)):
        drawn = extract(polygons([corners], 0.5), "x")
        assert cell_areas(drawn).sum() == pytest.approx(area, rel=1e-12)


def test_base_is_the_lowest_level():
    feet = [rectangle(0, 0, 1, 1), rectangle(2, 0, 3, 1), rectangle(0, 1, 3, 2)]
    lengths = group_lengths(extract(polygons(feet, 1.0), "polygons"))
    assert lengths == pytest.approx({"base": 2.0}, rel=1e-12)


def test_element_size_is_respected_or_a_quarter_of_the_blocks():
    given = extract(polygons([rectangle(0, 0, 1, 1)], 0.3), "one square")
    assert facet_lengths(given) == pytest.approx(np.full(4, 0.25), rel=1e-9)
    chosen = extract(polygons([rectangle(0, 0, 2, 2), rectangle(2, 0, 4, 2)]), "two squares")
    assert facet_lengths(chosen) == pytest.approx(np.full(8, 0.5), rel=1e-9)


def test_quadrilaterals_do_not_stick_to_the_next_drawing():
    assert extract(polygons(T_JOINT, 0.5, quadrilaterals=True), "x").cell_name == "quadrilateral"
    with gmsh_session() as gmsh:
        options = ("Mesh.RecombineAll", "Mesh.SubdivisionAlgorithm", "Mesh.MeshSizeMax")
        assert [gmsh.option.getNumber(name) for name in options] == [0.0, 0.0, 1e22]
    assert extract(polygons(T_JOINT, 0.5), "x").cell_name == "triangle"


HALF = 0.5 * np.tan(np.radians(25.0))  # width of the wedge
STEP = np.radians(150.0) / 7


@pytest.mark.parametrize(
    ("draw", "blocks", "areas", "lengths", "joints"),
    [
        *(
            (lambda q=q: arch(7, 0.2, 1.0, 150.0, 2, q), 7,
             {"blocks": 7 * 0.5 * np.sin(STEP) * (1.1**2 - 0.9**2)},
             {"springings": 0.4, "intrados": 14 * np.sin(STEP / 2) * 0.9,
              "extrados": 14 * np.sin(STEP / 2) * 1.1}, 6 * 0.2)
            for q in (False, True)
        ),
        (lambda: wedge(25.0, 0.5, 2.0, 0.5), 3,
         {"wedge": 0.5 * HALF, "blocks": 2.0 - 0.5 * HALF},
         {"base": 4.0, "top": 2 * HALF, "flanks": 4 * np.hypot(HALF, 0.5)},
         2 * np.hypot(HALF, 0.5)),
        *(
            (lambda n=n: buttress(n, 0.8, 1.2, 0.5, 0.4), 2 * n,
             {"wall": 0.4 * n, "buttress": 0.3 * n}, {"base": 2.0, "left": 0.5 * n, "back": n},
             (n - 1) * 0.8 + (1.2 * np.arange(1, n) / n).sum() + 0.5 * n)
            for n in (1, 3)
        ),
    ],
)  # fmt: skip
def test_arches_wedges_and_buttresses(draw, blocks, areas, lengths, joints):
    model = draw()
    drawn = extract(model, "structure")
    assert body_count(drawn) == blocks
    assert group_areas(drawn) == pytest.approx(areas, rel=1e-9)
    assert group_lengths(drawn) == pytest.approx(lengths, rel=1e-9)
    assert joint_length(model) == pytest.approx(joints, rel=1e-9)


OUTLINES = [
    ([], {}, "at least one block"),
    (T_JOINT, {"size": 0.0}, "positive size"),
    (T_JOINT, {"names": ["a"]}, "1 names for 3 blocks"),
    ([[(0, 0), (1, 0)]], {}, "block 0 needs at least three corners"),
    ([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]], {}, "block 0 needs at least three corners"),
    ([rectangle(0, 0, 1, 1), [(3, 0), (4, 1), (5, 2)]], {}, "block 1 has no area"),
    (T_JOINT, {"groups": {"roof": [((0, 3), (2, 3))]}}, "'roof'"),
]


@pytest.mark.parametrize(
    ("builder", "arguments", "options", "message"),
    [
        (wall, ([],), {}, "every course"),
        (wall, ([[1, 0]],), {}, "other than zero"),
        (wall, ([[-1, -1]],), {}, "no block"),
        (wall, ([[]],), {}, "wall: "),
        *((wall, ([[1]], *rest), {}, "positive") for rest in
          (((0.0, 1.0),), ((1.0, -1.0),), ((1.0, 1.0), 0))),
        *((running_bond, counts, {}, "at least one") for counts in
          ((0, 1), (0, 2), (-1, 2), (2, 0))),
        *((polygons, (blocks,), {"size": 0.5} | rest, text) for blocks, rest, text in OUTLINES),
        *((arch, values, {}, "arch: ") for values in
          ((0, 0.2), (7, 0.0), (7, 2.0), (7, 0.2, 1.0, 0.0), (7, 0.2, 1.0, 361.0),
           (7, 0.2, 1.0, 180.0, 0))),
        *((wedge, values, {}, "positive") for values in
          ((0.0,), (90.0,), (30.0, -1.0), (80.0, 1.0, 1.0), (30.0, 0.5, 3.0, 0.0))),
        *((buttress, values, {}, "positive") for values in
          ((0,), (2, 0.0), (2, 1.0, -1.0), (2, 1.0, 1.0, 0.0), (2, 1.0, 1.0, 0.5, 0.0))),
    ],
)  # fmt: skip
def test_builders_refuse(builder, arguments, options, message):
    with pytest.raises(InputError, match=message):
        builder(*arguments, **options)
