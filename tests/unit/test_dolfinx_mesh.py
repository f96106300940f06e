"""Blocks made of dolfinx meshes that are there already: the scenes of files, and what is refused.

Run on ranks, too, by `make test-mpi`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from dolfinx import mesh as dolfinx_mesh
from mpi4py import MPI

from fenics_contact import BlockMesh, InputError, Load, Scene, SolveOptions, limit_load
from fenics_contact.meshing import arch, model_from_arrays, running_bond
from tests.bank import PUSH, WEIGHT, coulomb
from tests.helpers import STONE

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
#: Two surfaces on a third, which share its nodes.
T_POINTS = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (0, 2), (1, 2), (2, 2)]
T_CELLS = {"sill": [[0, 1, 4, 3], [1, 2, 5, 4]], "left": [[3, 4, 7, 6]], "right": [[4, 5, 8, 7]]}
T_FACETS = {"base": [[0, 1], [1, 2]], "bed": [[3, 4], [4, 5]]}


def from_gmsh(model: Any) -> tuple[Any, Any, Any, dict[tuple[int, int], str]]:
    """A gmsh model as dolfinx distributes it, with tags, and the names of its groups."""
    gmshio = pytest.importorskip("dolfinx.io.gmshio")
    parts = gmshio.model_to_mesh(model, COMM, 0, gdim=2)[:3]
    groups = {group: model.getPhysicalName(*group) for group in model.getPhysicalGroups()}
    return (*parts, groups)


def scene(mesh: BlockMesh, live: Load = PUSH, ground: str = "base") -> Scene:
    """Stone on its ground, to be solved to all digits."""
    law = coulomb(0.65)
    return Scene(
        mesh,
        {"default": STONE},
        dead=WEIGHT,
        live=live,
        joints={"default": law},
        foundations={ground: law},
        solve=SolveOptions(tolerance=1e-11, fast=True),
    )


@pytest.mark.parametrize("quadrilaterals", [False, True], ids=["triangles", "quadrilaterals"])
@pytest.mark.parametrize(
    ("build", "ground"),
    [(lambda **cells: running_bond(2, 3, **cells), "base"),
     (lambda **cells: arch(5, 0.3, **cells), "springings")],
    ids=["wall", "arch"],
)  # fmt: skip
def test_load_factor_is_that_of_the_file(build, ground, quadrilaterals, tmp_path):
    gmsh = pytest.importorskip("gmsh")
    model = build(quadrilaterals=quadrilaterals)
    path = tmp_path / "blocks.msh"
    if COMM.rank == 0:
        gmsh.write(str(path))
    live = Load(body=(9.81, 0.0))
    of_file = limit_load(scene(BlockMesh.from_file(path, COMM), live, ground))
    mesh = BlockMesh.from_dolfinx(*from_gmsh(model))
    of_dolfinx = limit_load(scene(mesh, live, ground))
    assert of_file.status == of_dolfinx.status == "limit"
    assert of_dolfinx.load_factor == pytest.approx(of_file.load_factor, rel=1e-9)


def test_blocks_that_share_nodes_are_split_by_their_tags():
    model = model_from_arrays(T_POINTS, T_CELLS, T_FACETS)
    given = from_gmsh(model)
    assert BlockMesh.from_dolfinx(*given).body_count == 1
    split = BlockMesh.from_dolfinx(*given, blocks="surfaces")
    usual = BlockMesh.from_model(model, COMM, "surfaces")
    assert split.body_count == usual.body_count == 3
    names = [
        sorted(name for group in one.facet_groups for name in one.facet_sets[group])
        for one in (split, usual)
    ]
    assert names[0] == names[1]
    factors = [limit_load(scene(one)).load_factor for one in (split, usual)]
    assert factors[0] == pytest.approx(factors[1], rel=1e-9)


def tagged_square() -> tuple[Any, Any, Any]:
    """2 x 1 m of triangles in two halves, 1 and 2, on a facet group 3; from dolfinx alone."""
    domain = dolfinx_mesh.create_rectangle(COMM, [(0.0, 0.0), (2.0, 1.0)], [4, 2])
    index_map = domain.topology.index_map(2)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    right = dolfinx_mesh.locate_entities(domain, 2, lambda x: x[0] >= 1.0 - 1e-9)
    halves = 1 + np.isin(cells, right).astype(np.int32)
    base = np.sort(dolfinx_mesh.locate_entities_boundary(domain, 1, lambda x: x[1] < 1e-9))
    return (
        domain,
        dolfinx_mesh.meshtags(domain, 2, cells, halves),
        dolfinx_mesh.meshtags(domain, 1, base, np.full(len(base), 3, dtype=np.int32)),
    )


def test_numbers_can_share_a_name_and_are_names_without_one():
    given = tagged_square()
    mesh = BlockMesh.from_dolfinx(*given, {1: "stone", 2: "stone"}, blocks="surfaces")
    assert (mesh.body_count, mesh.cell_names, mesh.facet_names) == (2, ("stone",), ("3",))
    assert limit_load(scene(mesh, ground="3")).status == "limit"
    assert BlockMesh.from_dolfinx(*given, {1: "stone", 2: "stone"}).joined == 2


NAMES = {1: "left", 2: "right", 3: "base"}


def with_tags(domain: Any, dim: int, drop: int = 0, kind: Any = np.int32) -> Any:
    """Tags, all 1, of a mesh's entities but the first few of every rank."""
    domain.topology.create_entities(dim)
    mine = np.arange(drop, domain.topology.index_map(dim).size_local, dtype=np.int32)
    return dolfinx_mesh.meshtags(domain, dim, mine, np.ones(len(mine), dtype=kind))


def in_three_dimensions(given: list[Any]) -> None:
    gmshio = pytest.importorskip("dolfinx.io.gmshio")
    model = model_from_arrays(T_POINTS, T_CELLS, T_FACETS)
    given[:3] = gmshio.model_to_mesh(model, COMM, 0, gdim=3)[:3]


def change(place: int, make: Callable[[list[Any]], Any]) -> Callable[[list[Any]], None]:
    """What replaces one of the arguments."""

    def made(given: list[Any]) -> None:
        given[place] = make(given)

    return made


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (change(0, lambda given: None), "mesh = NoneType must be a dolfinx.mesh.Mesh"),
        (change(0, lambda given: dolfinx_mesh.create_unit_cube(COMM, 2, 2, 2)), "kind tetrahedron"),
        (in_three_dimensions, "3 dimensions; make it with gdim=2"),
        (change(1, lambda given: None), "cell_tags = NoneType must be dolfinx mesh tags"),
        (change(1, lambda given: given[2]), "cell_tags has tags of dimension 1; .* of cells, 2"),
        (change(2, lambda given: given[1]), "facet_tags has tags of dimension 2; .* of facets, 1"),
        (change(1, lambda given: tagged_square()[1]), "cell_tags are those of another mesh"),
        (change(2, lambda given: tagged_square()[2]), "facet_tags are those of another mesh"),
        (change(1, lambda given: with_tags(given[0], 2, drop=1)), "cells have no tag; give every"),
        (change(1, lambda given: with_tags(given[0], 2, kind=np.float64)), "type float64; give"),
        (change(3, lambda given: NAMES | {7: "door"}), r"names\[7\] = 'door' is the number of no"),
        (change(3, lambda given: {(2, 3): "base"}), r"names\[\(2, 3\)\] = 'base' is .* of no tag"),
        (change(3, lambda given: {1: 5}), r"names\[1\] = 5 must be a string"),
        (
            change(3, lambda given: ["left"]),
            "names = .* must be a table, .* in Python a dict",
        ),
    ],
)
def test_what_does_not_fit_is_refused_on_all_ranks(wrong, named):
    given = [*tagged_square(), NAMES]
    wrong(given)
    with pytest.raises(InputError, match=named):
        BlockMesh.from_dolfinx(*given)


def test_a_number_of_cells_and_of_facets_needs_the_dimension():
    domain, cells, _ = tagged_square()
    facets = with_tags(domain, 1)
    with pytest.raises(InputError, match=r"of cells and of facets; give names\[2, 1\] and"):
        BlockMesh.from_dolfinx(domain, cells, facets, {1: "left"})
    mesh = BlockMesh.from_dolfinx(domain, cells, facets, {(2, 1): "left", (1, 1): "edge"})
    assert (mesh.cell_names, mesh.facet_names) == (("left", "2"), ("edge",))


def test_curved_cells_are_refused():
    gmsh = pytest.importorskip("gmsh")
    model = arch(3, 0.2)
    model.mesh.setOrder(2)
    given = from_gmsh(model)
    gmsh.model.remove()
    with pytest.raises(InputError, match="curved cells of degree 2; make it of degree 1"):
        BlockMesh.from_dolfinx(*given)
