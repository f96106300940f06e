"""The blocks' boundary facets as one table, the same on every rank.

Everything about joints, supports and outlines is decided on this table, by the same code on every
rank; only boundary data is exchanged, once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx.mesh import exterior_facet_indices

from fenics_contact import compat
from fenics_contact.errors import InputError
from fenics_contact.mesh import Array, BlockMesh, Flags, Indices, Labels


@dataclass(frozen=True)
class Boundary:
    """Facets with one cell, of all ranks, sorted by their nodes in the input.

    Attributes:
        nodes: Displacement nodes of every facet, its two ends first, shape (facets, 2 or 3).
        points: Their coordinates, shape (facets, 2 or 3, 2), m.
        normal: Outward unit normals, shape (facets, 2).
        length: Shape (facets,), m.
        body: Body of every facet, shape (facets,).
        groups: Physical groups as an index into `facet_sets`, -1 for none.
        facet_sets: The sets of group names that occur.
        local: Rows of this rank's facets.
        local_facets: Facet indices of those rows in the mesh.
        interior: Number of tagged facets that lie inside a body, by name of their group.
    """

    nodes: Indices
    points: Array
    normal: Array
    length: Array
    body: Labels
    groups: Labels
    facet_sets: tuple[frozenset[str], ...]
    local: Indices
    local_facets: Labels
    interior: Mapping[str, int]

    def in_group(self, name: str) -> Flags:
        """Which facets are in a physical group, shape (facets,)."""
        member = np.array([name in groups for groups in self.facet_sets] + [False])
        return member[self.groups]

    def role(self, names: Iterable[str]) -> Indices:
        """Position in `names` of the group each facet is in, -1 where none, shape (facets,).

        Raises:
            InputError: If a facet is in two of the groups, or inside a body.
        """
        role = np.full(len(self.length), -1)
        names = list(names)
        for position, name in enumerate(names):
            if name in self.interior:
                raise InputError(
                    f"group '{name}': {self.interior[name]} facets lie inside a body; give the"
                    " blocks on both sides nodes of their own"
                )
            member = self.in_group(name)
            twice = np.flatnonzero(member & (role >= 0))
            if len(twice):
                raise InputError(
                    f"groups '{names[role[twice[0]]]}' and '{name}' share {len(twice)} facets;"
                    " a facet can be in one of them only"
                )
            role[member] = position
        return role


def collect_boundary(mesh: BlockMesh, space: Any) -> Boundary:
    """Boundary facets of all ranks, with the nodes of a displacement space of degree 1 or 2."""
    mine, local_facets = _local_facets(mesh, space)
    parts = mesh.comm.allgather(mine)
    table = {name: np.concatenate([part[name] for part in parts]) for name in mine}
    inputs = table.pop("inputs")
    order = np.lexsort((inputs[:, 1], inputs[:, 0]))
    groups, interior = _groups(mesh, inputs[order])
    start = sum(len(part["length"]) for part in parts[: mesh.comm.rank])
    return Boundary(
        **{name: values[order] for name, values in table.items()},
        groups=groups,
        facet_sets=mesh.facet_sets,
        local=np.argsort(order)[start : start + len(local_facets)],
        local_facets=local_facets,
        interior=interior,
    )


def _local_facets(mesh: BlockMesh, space: Any) -> tuple[dict[str, Any], Labels]:
    """Columns of `Boundary` for this rank, and "inputs", its ends as sorted nodes of the input.

    Also returns the facets' indices in the mesh.
    """
    domain = mesh.domain
    facets, cell, side = _exterior_facets(domain.topology)
    corner = compat.facet_vertices(domain.topology)[side]
    geometry = compat.geometry_dofs(domain)[cell]
    ends = np.take_along_axis(geometry, corner, axis=1)
    nodes = np.take_along_axis(compat.cell_dofs(space)[cell], _facet_dofs(space)[side], axis=1)
    points = space.tabulate_dof_coordinates()[nodes][:, :, :2]
    global_nodes = space.dofmap.index_map.local_to_global(nodes.ravel().astype(np.int32))
    along = points[:, 1] - points[:, 0]
    length = np.linalg.norm(along, axis=1)
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
    centre = domain.geometry.x[geometry][:, :, :2].mean(axis=1)
    normal[np.sum(normal * (points[:, 0] - centre), axis=1) < 0.0] *= -1.0
    table = {
        "inputs": np.sort(np.asarray(domain.geometry.input_global_indices)[ends], axis=1),
        "nodes": np.asarray(global_nodes).reshape(nodes.shape),
        "points": points,
        "normal": normal,
        "length": length,
        "body": mesh.body[cell],
    }
    return table, facets


def _facet_dofs(space: Any) -> Indices:
    """Cell-local dofs of every facet of a cell, its two ends first."""
    dofs, sides = space.dofmap.dof_layout.entity_dofs, compat.facet_vertices(space.mesh.topology)
    return np.array(
        [[*dofs(0, a), *dofs(0, b), *dofs(1, side)] for side, (a, b) in enumerate(sides)]
    )


def _exterior_facets(topology: Any) -> tuple[Labels, Labels, Indices]:
    """Local facets with one cell, that cell, and the facet's number in it."""
    topology.create_entities(1)
    topology.create_connectivity(1, 2)
    topology.create_connectivity(2, 1)
    facets = np.asarray(exterior_facet_indices(topology), dtype=np.int32)
    to_cell = topology.connectivity(1, 2)
    cell = to_cell.array[to_cell.offsets[facets]]
    sides = compat.facets_of_cells(topology)[cell]
    return facets, cell, np.argmax(sides == facets[:, None], axis=1)


def _groups(mesh: BlockMesh, inputs: Indices) -> tuple[Labels, Counter[str]]:
    """Group of every boundary facet, found by its input nodes; and what is tagged elsewhere."""
    groups = np.full(len(inputs), -1, dtype=np.int32)
    stride = 1 + max(int(inputs.max()), int(mesh.facets.max(initial=0)))
    tagged = mesh.facets[:, 0] * stride + mesh.facets[:, 1]
    keys = inputs[:, 0] * stride + inputs[:, 1]  # sorted
    where = np.minimum(np.searchsorted(keys, tagged), len(keys) - 1)
    found = keys[where] == tagged
    groups[where[found]] = mesh.facet_groups[found]
    inside = mesh.facet_groups[~found]
    return groups, Counter(name for index in inside for name in mesh.facet_sets[index])
