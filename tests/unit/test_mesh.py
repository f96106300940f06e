"""Meshes of blocks: bodies, groups, and what is refused with a message that says why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import BlockMesh, InputError, compat
from fenics_contact.geometry.gmsh_mesh import (
    ReadLimits,
    bodies_of_cells,
    extract,
    gmsh_session,
    read,
    with_blocks,
)
from fenics_contact.meshing import model_from_arrays, polygons, wall
from tests.helpers import mesh_of, rectangle

SQUARE = rectangle(0.0, 0.0, 1.0, 1.0)
ONE_CELL = {"blocks": [[0, 1, 2, 3]]}


def write(text: str, path: Path) -> Path:
    """Write a text file, on rank 0."""
    if MPI.COMM_WORLD.rank == 0:
        path.write_text(text)
    MPI.COMM_WORLD.barrier()
    return path


def bodies_by_place(mesh: BlockMesh) -> set[frozenset[tuple[float, float]]]:
    """The bodies as sets of their cells' centres, whatever the numbers."""
    geometry = mesh.domain.geometry
    dofs = compat.geometry_dofs(mesh.domain)
    centre = np.round(geometry.x[dofs][:, :, :2].mean(axis=1), 9)
    bodies: dict[int, set[tuple[float, float]]] = {}
    for centres, numbers in mesh.comm.allgather((centre, mesh.body)):
        for (x, y), number in zip(centres, numbers, strict=True):
            bodies.setdefault(int(number), set()).add((float(x), float(y)))
    return {frozenset(cells) for cells in bodies.values()}


def test_bodies_are_connected_cells_numbered_by_first_cell():
    # Cells of two squares, each of two triangles, given in turns, the right square's first.
    points = SQUARE + [(x + 3.0, y) for x, y in SQUARE]
    cells = [[4, 5, 6], [0, 1, 2], [4, 6, 7], [0, 2, 3]]
    mesh = mesh_of(model_from_arrays(points, {"blocks": cells}, {}))
    assert mesh.body_count == 2
    original = np.asarray(mesh.domain.topology.original_cell_index)
    parts = mesh.comm.allgather((original, mesh.body))
    body = np.empty(4, dtype=int)
    body[np.concatenate([part[0] for part in parts])] = np.concatenate([part[1] for part in parts])
    assert body.tolist() == [0, 1, 0, 1]


def test_cells_that_share_a_facet_are_one_body_across_groups():
    points = [*SQUARE, (2.0, 0.0), (2.0, 1.0)]
    mesh = mesh_of(model_from_arrays(points, {"soft": [[0, 1, 2, 3]], "hard": [[1, 4, 5, 2]]}, {}))
    assert mesh.body_count == 1
    assert set(mesh.cell_names) == {"soft", "hard"}
    groups = [g for part in mesh.comm.allgather(mesh.cell_groups) for g in part]
    assert sorted(sorted(mesh.cell_sets[g]) for g in groups) == [["hard"], ["soft"]]


@pytest.mark.parametrize(
    ("facets", "expected"),
    [
        ({"a": [[0, 1]], "b": [[1, 0], [1, 2]], "c": [[2, 3]]},
         {(0, 1): {"a", "b"}, (1, 2): {"b"}, (2, 3): {"c"}}),
        ({"a": [[0, 1]], "b": [[0, 1]], "c": [[1, 0]]}, {(0, 1): {"a", "b", "c"}}),
    ],
)  # fmt: skip
def test_facet_in_several_groups_has_all_of_them(facets, expected):
    drawn = extract(model_from_arrays(SQUARE, ONE_CELL, facets), "square")
    groups = [drawn.facet_sets[group] for group in drawn.facet_groups]
    assert dict(zip(map(tuple, drawn.facets.tolist()), groups, strict=True)) == expected
    assert drawn.facet_names == ("a", "b", "c")


#: Two surfaces on a third, which share its nodes.
T_POINTS = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (0, 2), (1, 2), (2, 2)]
T_CELLS = {"sill": [[0, 1, 4, 3], [1, 2, 5, 4]], "left": [[3, 4, 7, 6]], "right": [[4, 5, 8, 7]]}


def test_surfaces_as_blocks_have_nodes_of_their_own_and_both_sides_of_tagged_lines():
    facets = {"bed": [[3, 4], [4, 5]], "base": [[0, 1]], "inside": [[1, 4]], "nowhere": [[0, 4]]}
    model = model_from_arrays(T_POINTS, T_CELLS, facets)
    shared, drawn = extract(model, "blocks"), with_blocks(extract(model, "blocks"), "surfaces")
    assert (len(shared.points), len(drawn.points)) == (9, 6 + 4 + 4)
    assert np.allclose(drawn.points[drawn.cells], shared.points[shared.cells])
    assert bodies_of_cells(drawn).tolist() == [0, 0, 1, 2]
    names = [name for group in drawn.facet_groups for name in drawn.facet_sets[group]]
    assert {name: names.count(name) for name in facets} == {
        "bed": 4, "base": 1, "inside": 1, "nowhere": 1,
    }  # fmt: skip
    before = {tuple(ends) for ends in shared.points[shared.facets].reshape(-1, 4).tolist()}
    after = {tuple(ends) for ends in drawn.points[drawn.facets].reshape(-1, 4).tolist()}
    assert {frozenset([e[:2], e[2:]]) for e in before} == {frozenset([e[:2], e[2:]]) for e in after}


@pytest.mark.mpi
def test_surfaces_that_touch_are_one_body_unless_they_are_blocks():
    model = model_from_arrays(T_POINTS, T_CELLS, {})
    for blocks, count in (("connected", 1), ("surfaces", 3)):
        mesh = BlockMesh.from_model(model, MPI.COMM_WORLD, blocks)
        assert (mesh.body_count, mesh.joined) == (count, 0)
        assert len(bodies_by_place(mesh)) == count
    with pytest.raises(InputError, match="blocks = 'all' must be one of connected, surfaces"):
        BlockMesh.from_model(model, MPI.COMM_WORLD, "all")


def test_group_without_name_goes_by_its_number():
    model = model_from_arrays(SQUARE, ONE_CELL, {"base": [[0, 1]]})
    (dim, entity), *_ = model.getEntities(2)
    model.addPhysicalGroup(dim, [entity], 77)
    drawn = extract(model, "square")
    assert set(drawn.cell_names) == {"blocks", "77"}
    assert drawn.cell_sets == ({"blocks", "77"},)


def test_lines_apart_from_the_cells_are_left_out():
    points = [*SQUARE, (5.0, 0.0), (6.0, 0.0)]
    facets = {"base": [[0, 1]], "axis": [[4, 5]]}
    drawn = extract(model_from_arrays(points, ONE_CELL, facets), "square")
    assert drawn.facets.tolist() == [[0, 1]]
    assert len(drawn.points) == 4


def test_file_gives_the_same_mesh_as_its_model_and_leaves_the_current_one(folder):
    model = wall([[1, 1], [0.5, 1, 0.5]])
    usual = mesh_of(model)
    path = folder / "wall.msh"
    if MPI.COMM_WORLD.rank == 0:
        with gmsh_session() as gmsh:
            gmsh.write(str(path))
    MPI.COMM_WORLD.barrier()
    model_from_arrays(SQUARE, ONE_CELL, {}, "the caller's")
    mesh = BlockMesh.from_file(path, MPI.COMM_WORLD)
    with gmsh_session() as gmsh:
        assert gmsh.model.getCurrent() == "the caller's"
    assert bodies_by_place(mesh) == bodies_by_place(usual)
    assert len(mesh.facets) == len(usual.facets)
    assert set(mesh.facet_names) == set(usual.facet_names)
    assert "wall.msh" in mesh.source


def test_broken_file(folder):
    text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 2 garbage\n"
    path = write(text, folder / "broken.msh")
    with pytest.raises(InputError, match=r"cannot read .*broken\.msh"):
        BlockMesh.from_file(path, MPI.COMM_WORLD)
    # gmsh must still be of use after a file it could not read.
    assert mesh_of(polygons([SQUARE], 1.0)).body_count == 1


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (ReadLimits(patience=1e-3), "no end"),
        (ReadLimits(seconds=0.0, seconds_per_megabyte=0.0, patience=1e9), "no end|crashes"),
        (ReadLimits(memory=3e7, memory_per_byte=0.0), "crashes|damaged|memory|object"),
    ],
)
def test_file_is_read_within_limits(limits, message, tmp_path):
    model_from_arrays(SQUARE, ONE_CELL, {})
    with gmsh_session() as gmsh:
        gmsh.write(str(tmp_path / "square.msh"))
    assert len(read(tmp_path / "square.msh").tags) == 4
    with pytest.raises(ValueError, match=message):
        read(tmp_path / "square.msh", limits)


@pytest.mark.parametrize("text", ["", "ply\nformat ascii 1.0\n", "<mesh/>"])
def test_file_missing_or_of_another_kind(folder, text):
    with pytest.raises(InputError, match=r"nowhere\.msh' does not exist"):
        BlockMesh.from_file(folder / "nowhere.msh", MPI.COMM_WORLD)
    with pytest.raises(InputError, match=r"mesh\.txt' is not a gmsh mesh file"):
        BlockMesh.from_file(write(text, folder / "mesh.txt"), MPI.COMM_WORLD)


def no_cells():
    """A square surface in a group, not meshed."""
    with gmsh_session() as gmsh:
        model = gmsh.model
        model.add("geometry only")
        surface = model.occ.addRectangle(0, 0, 0, 1, 1)
        model.occ.synchronize()
        model.addPhysicalGroup(2, [surface])
    return model


def second_order():
    model = polygons([SQUARE], 1.0)
    model.mesh.setOrder(2)
    return model


def lifted(*heights: float):
    """A square whose corners are not all at z = 0."""
    model = model_from_arrays(SQUARE, ONE_CELL, {})
    for node, ((x, y), z) in enumerate(zip(SQUARE, heights, strict=True), start=1):
        model.mesh.setNode(node, [x, y, z], [])
    return model


def flat_cell(far: float):
    points = np.array([*SQUARE, (0.5, 3.0), (1.5, 3.0), (2.5, 3.0)]) + far
    return model_from_arrays(points, {"blocks": [[0, 1, 2], [0, 2, 3], [4, 5, 6]]}, {})


def two_kinds():
    cells = {"square": [[0, 1, 2, 3]], "gable": [[1, 4, 2]]}
    return model_from_arrays([*SQUARE, (2.0, 0.5)], cells, {})


def one_node_in_common():
    points = [*SQUARE, (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)]
    return model_from_arrays(points, {"blocks": [[0, 1, 2, 3], [2, 4, 5, 6]]}, {})


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda: model_from_arrays(SQUARE, {}, {"base": [[0, 1]]}), "two-dimensional"),
        (no_cells, r"no cells .* mesh it first"),
        (second_order, "Triangle 6"),
        (two_kinds, "Triangle 3, Quadrilateral 4"),
        (lambda: lifted(0.0, 0.0, 0.25, 0.0), r"not planar: z varies by 0\.25"),
        (lambda: flat_cell(0.0), "1 cells have no area"),
        (lambda: flat_cell(1e5), "1 cells have no area"),
        (one_node_in_common, "share single nodes"),
    ],
)
def test_mesh_refuses(draw, message):
    with pytest.raises(InputError, match=message):
        mesh_of(draw())


def test_plane_parallel_to_x_and_y_and_small_cells_far_from_the_origin_are_fine():
    assert mesh_of(lifted(7.0, 7.0, 7.0, 7.0)).body_count == 1
    points = 1e-3 * np.array(SQUARE) + 1e3
    assert mesh_of(model_from_arrays(points, ONE_CELL, {})).body_count == 1
