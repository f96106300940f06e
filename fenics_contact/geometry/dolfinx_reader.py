"""Cells, facets and tags of a dolfinx mesh on rank 0, in the form of what gmsh's reader finds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from dolfinx.mesh import Mesh

from fenics_contact import compat
from fenics_contact.errors import InputError, raised_together
from fenics_contact.geometry.gmsh_reader import CELL_TYPES, GmshContents

#: Names by number of a tag, or by dimension and number.
TagNames = Mapping[Any, str]

#: Element type of gmsh by the cell's name, and that of a straight line.
_KINDS = {name: kind for kind, (name, _) in CELL_TYPES.items()}
_LINE = 1
#: Order of a cell's nodes round it: dolfinx numbers those of quadrilaterals row by row.
_ROUND = {"triangle": [0, 1, 2], "quadrilateral": [0, 1, 3, 2]}
_KINDS_OF_TAGS = {2: "cells", 1: "facets"}


def contents(
    domain: Any, cell_tags: Any, facet_tags: Any, names: TagNames, source: str
) -> GmshContents:
    """Nodes, tagged cells and tagged facets of all ranks, on rank 0. Collective.

    Args:
        domain: The dolfinx mesh.
        cell_tags: Number of every cell.
        facet_tags: Numbers of some facets.
        names: Names of the numbers; those without one are called by the number.
        source: For messages.

    Raises:
        InputError: On all ranks, if this is not a planar mesh, its tags or their names.
    """
    if not isinstance(domain, Mesh):
        raise InputError(f"mesh = {type(domain).__name__} must be a dolfinx.mesh.Mesh")
    topology = domain.topology
    cell = topology.cell_type.name
    dim = domain.geometry.dim
    if cell not in _KINDS:
        known = " or ".join(_KINDS)
        raise InputError(f"{source} has cells of kind {cell}; make it of cells of kind {known}")
    if dim != 2:
        problem = f"has points in {dim} dimensions; make it with gdim=2, for example gmshio's"
        raise InputError(f"{source} {problem} model_to_mesh(model, comm, 0, gdim=2)")
    degree = domain.geometry.cmap.degree
    if degree != 1:
        raise InputError(f"{source} has curved cells of degree {degree}; make it of degree 1")
    comm = domain.comm
    with raised_together(comm):
        _check_tags(domain, cell_tags, "cell_tags", 2)
        _check_tags(domain, facet_tags, "facet_tags", 1)

    nodes = compat.geometry_dofs(domain)
    owned = topology.index_map(2).size_local
    mine = cell_tags.indices < owned
    untagged = comm.allreduce(owned - len(np.unique(cell_tags.indices[mine])))
    if untagged:
        raise InputError(f"cell_tags: {untagged} cells have no tag; give every cell one")
    for dims in ((1, 0), (2, 0)):
        topology.create_connectivity(*dims)
    vertices = topology.connectivity(2, 0).array.reshape(nodes.shape)
    node = np.zeros(int(vertices.max(initial=-1)) + 1, dtype=np.int32)
    node[vertices] = nodes
    ends = topology.connectivity(1, 0).array.reshape(-1, 2)[facet_tags.indices]
    index_map = domain.geometry.index_map()
    tagged = {}  # nodes, by their numbers on all ranks, and tags
    for number, some, values in (
        (2, nodes[:, _ROUND[cell]][cell_tags.indices[mine]], cell_tags.values[mine]),
        (1, node[ends], facet_tags.values),
    ):
        everywhere = index_map.local_to_global(some.ravel().astype(np.int32))
        tagged[number] = (
            np.reshape(everywhere, some.shape).astype(np.int64),
            values.astype(np.int64),
        )

    sets = comm.allgather({dim: set(values.tolist()) for dim, (_, values) in tagged.items()})
    numbers = {dim: sorted(set().union(*(part[dim] for part in sets))) for dim in tagged}
    groups = _named(names, numbers)
    points = domain.geometry.x[: index_map.size_local]
    parts = comm.gather((tagged, points)) or [(tagged, points)]  # only rank 0 makes blocks of them
    elements = []
    for dim, of_gmsh in ((1, _LINE), (2, _KINDS[cell])):
        table, tags = (np.concatenate([part[0][dim][k] for part in parts]) for k in (0, 1))
        for number in numbers[dim]:
            flat = table[tags == number].ravel().astype(np.uint64)
            elements.append((dim, [number], of_gmsh, flat))
    coordinates = np.concatenate([part[1] for part in parts])
    return GmshContents(
        groups, np.arange(len(coordinates), dtype=np.uint64), coordinates, elements, {}
    )


def _check_tags(domain: Any, tags: Any, name: str, dim: int) -> None:
    """Refuse tags of other entities than those of this dimension of this mesh."""
    try:
        found = tags.dim
        of_mesh = compat.same_topology(tags, domain)
    except AttributeError:
        problem = "must be dolfinx mesh tags, made by dolfinx.mesh.meshtags"
        raise InputError(f"{name} = {type(tags).__name__} {problem}") from None
    if found != dim:
        things = _KINDS_OF_TAGS[dim]
        raise InputError(f"{name} has tags of dimension {found}; give the tags of {things}, {dim}")
    if not of_mesh:
        raise InputError(f"{name} are those of another mesh; make them with meshtags of this one")
    if not np.issubdtype(tags.values.dtype, np.integer):
        raise InputError(f"{name} has tags of type {tags.values.dtype}; give whole numbers (int32)")


def _named(names: TagNames, numbers: Mapping[int, list[int]]) -> dict[tuple[int, int], str | None]:
    """Name of every dimension and number that occurs.

    Raises:
        InputError: If a name is of no number, or of one that both cells and facets have.
    """
    found: dict[tuple[int, int], str | None] = {
        (dim, number): str(number) for dim, some in numbers.items() for number in some
    }
    there = "; ".join(f"{_KINDS_OF_TAGS[dim]} have {some}" for dim, some in numbers.items())
    for key, name in names.items():
        asked = [key] if isinstance(key, tuple) else [(dim, key) for dim in numbers]
        pairs = [pair for pair in found if pair in asked]
        if not pairs:
            raise InputError(f"names[{key}] = '{name}' is the number of no tag: {there}")
        if len(pairs) > 1:
            problem = f"is of cells and of facets; give names[2, {key}] and names[1, {key}] instead"
            raise InputError(f"names[{key}] = '{name}' {problem}")
        found[pairs[0]] = name
    return found
