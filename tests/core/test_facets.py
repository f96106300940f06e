"""The table of boundary facets: the same on every rank, with outward normals and groups."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import mesh as dolfinx_mesh

from fenics_contact import BlockMesh, InputError, compat
from fenics_contact.discretization.facets import Boundary, collect_boundary
from fenics_contact.meshing import polygons, wall
from tests.helpers import Drawing, grid_blocks, mesh_of, rectangle, rotation


def boundary_of(mesh: BlockMesh, degree: int = 1) -> Boundary:
    return collect_boundary(mesh, compat.function_space(mesh.domain, "Lagrange", degree, (2,)))


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
