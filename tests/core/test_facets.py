"""The table of boundary facets: the same on every rank, with outward normals and groups."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import mesh as dolfinx_mesh

from fenics_contact import BlockMesh, InputError, compat
from fenics_contact.discretization.facets import Boundary, collect_boundary
from fenics_contact.meshing import model_from_arrays, polygons, wall
from tests.helpers import Drawing, grid_blocks, mesh_of, node_positions, rectangle, rotation

TRIANGLE = [(0.0, 0.0), (3.0, 1.0), (1.0, 2.0)]


def boundary_of(mesh: BlockMesh, degree: int = 1) -> Boundary:
    return collect_boundary(mesh, compat.function_space(mesh.domain, "Lagrange", degree, (2,)))


@pytest.mark.parametrize("quadrilaterals", [False, True])
def test_facets_of_a_wall(quadrilaterals):
    # Blocks of 2 x 1 elements of 0.2 x 0.175 have six boundary facets each.
    boundary = boundary_of(mesh_of(wall([[1, 1], [1, 1]], (0.4, 0.175), 1, quadrilaterals)))
    assert np.bincount(boundary.body).tolist() == [6] * 4
    assert np.sort(boundary.length) == pytest.approx([0.175] * 8 + [0.2] * 16, rel=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.4, 2.0, -2.5])
def test_normals_point_out_of_the_blocks(angle):
    drawing = Drawing.of(polygons([rectangle(-1, 0, 1, 1), rectangle(-1, 1, 1, 3)], 0.5))
    boundary = boundary_of(mesh_of(drawing.turned(angle).model()))
    centre = np.array([[0.0, 0.5], [0.0, 2.0]]) @ rotation(angle).T
    along = boundary.points[:, 1] - boundary.points[:, 0]
    size = np.linalg.norm(boundary.normal, axis=1)
    assert size == pytest.approx(np.ones(len(size)), rel=1e-14)
    assert np.abs(np.sum(along * boundary.normal, axis=1)).max() < 1e-14
    # The blocks are rectangles about their centres: half a side away.
    middle = boundary.points.mean(axis=1)
    reach = np.sum((middle - centre[boundary.body]) * boundary.normal, axis=1)
    assert [reach.min(), reach.max()] == pytest.approx([0.5, 1.0], rel=1e-12)


def test_outline_of_every_body_is_closed():
    boundary = boundary_of(mesh_of(polygons([TRIANGLE, rectangle(5, 0, 6, 2)], 0.4)))
    for body, area in ((0, 2.5), (1, 2.0)):
        mine = boundary.body == body
        flux = boundary.normal[mine] * boundary.length[mine, None]
        assert np.abs(flux.sum(axis=0)).max() < 1e-13
        middle = boundary.points[mine].mean(axis=1)
        assert 0.5 * np.sum(flux * middle) == pytest.approx(area, rel=1e-12)


def test_groups_of_facets():
    boundary = boundary_of(mesh_of(wall([[1, 1], [1, -1]], (0.4, 0.2), 1)))
    expected = {"base": 0.8, "top": 0.4, "left": 0.4, "right": 0.2, "bed": 0.8, "head": 0.4}
    expected |= {"opening": 0.6, "elsewhere": 0.0}
    length = {name: boundary.length[boundary.in_group(name)].sum() for name in expected}
    assert length == pytest.approx(expected, rel=1e-12)
    down = boundary.normal[boundary.in_group("base")]
    assert down == pytest.approx(np.tile([0.0, -1.0], (len(down), 1)), abs=1e-15)


def test_facets_in_no_group():
    boundary = boundary_of(mesh_of(polygons([rectangle(0, 0, 1, 1)], 1.0)))
    assert sorted(boundary.groups.tolist()) == [-1, -1, -1, 0]
    assert boundary.facet_sets == (frozenset({"base"}),)


def test_role_is_the_position_of_the_group():
    boundary = boundary_of(mesh_of(wall([[1]], (0.4, 0.2), 1)))
    role = boundary.role(["right", "base"])
    assert np.array_equal(role == 0, boundary.in_group("right"))
    assert np.array_equal(role == 1, boundary.in_group("base"))
    assert np.count_nonzero(role == -1) == 3


def test_a_facet_has_one_role_only():
    facets = {"a": [[0, 1], [1, 2]], "b": [[1, 2]]}
    model = model_from_arrays(rectangle(0, 0, 1, 1), {"blocks": [[0, 1, 2, 3]]}, facets)
    boundary = boundary_of(mesh_of(model))
    assert np.count_nonzero(boundary.in_group("a") & boundary.in_group("b")) == 1
    assert np.count_nonzero(boundary.role(["a"]) == 0) == 2
    with pytest.raises(InputError, match="'a' and 'b' share 1 facets"):
        boundary.role(["a", "b"])


def test_tagged_facets_inside_a_body():
    # A line drawn through a block, but the block's two parts share its nodes.
    drawing = grid_blocks(((0, 0), (2, 2), (2, 2)))
    drawing.facets["seam"] = np.array([[3, 4], [4, 5]])
    boundary = boundary_of(mesh_of(drawing.model()))
    assert boundary.interior == {"seam": 2}
    assert not np.any(boundary.in_group("seam"))
    assert np.count_nonzero(boundary.role(["bottom0"]) == 0) == 2
    with pytest.raises(InputError, match="'seam': 2 facets lie inside a body"):
        boundary.role(["seam"])


def test_local_rows_are_the_facets_of_this_rank():
    mesh = mesh_of(wall([[1, 1], [0.5, 1, 0.5]], elements=1))
    boundary = boundary_of(mesh)
    rows = np.concatenate(mesh.comm.allgather(boundary.local))
    assert np.array_equal(np.sort(rows), np.arange(len(boundary.length)))
    middle = dolfinx_mesh.compute_midpoints(mesh.domain, 1, boundary.local_facets)[:, :2]
    assert boundary.points[boundary.local].mean(axis=1) == pytest.approx(middle, abs=1e-14)


def test_table_does_not_depend_on_the_order_of_cells():
    drawing = Drawing.of(wall([[1, 1]], elements=1))
    shuffled = Drawing(drawing.points, {"blocks": drawing.cells["blocks"][::-1]}, drawing.facets)
    one, other = (boundary_of(mesh_of(d.model())) for d in (drawing, shuffled))
    assert one.points.mean(axis=1) == pytest.approx(other.points.mean(axis=1), abs=1e-15)
    assert one.normal == pytest.approx(other.normal, abs=1e-15)


@pytest.mark.parametrize("degree", [1, 2])
def test_nodes_are_those_of_the_displacement_space(degree):
    mesh = mesh_of(wall([[1, 1]], (0.4, 0.2), 1))
    space = compat.function_space(mesh.domain, "Lagrange", degree, (2,))
    boundary = collect_boundary(mesh, space)
    assert boundary.nodes.shape == (12, degree + 1)
    assert node_positions(space)[boundary.nodes] == pytest.approx(boundary.points, abs=1e-14)
    ends, inner = boundary.points[:, :2], boundary.points[:, 2:]  # of degree two: in the middle
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) == pytest.approx(boundary.length)
    middle = ends.mean(axis=1, keepdims=True)
    assert inner == pytest.approx(np.repeat(middle, degree - 1, axis=1), abs=1e-15)
