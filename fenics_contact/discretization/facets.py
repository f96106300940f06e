"""The blocks' boundary facets as one table, the same on every rank.

Everything about joints, supports and outlines is decided on this table, by the same code on every
rank; only boundary data is exchanged, once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact import compat
from fenics_contact.errors import InputError
from fenics_contact.mesh import BlockMesh


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

    nodes: npt.NDArray[np.int64]
    points: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    length: npt.NDArray[np.float64]
    body: npt.NDArray[np.int32]
    groups: npt.NDArray[np.int32]
    facet_sets: tuple[frozenset[str], ...]
    local: npt.NDArray[np.int64]
    local_facets: npt.NDArray[np.int32]
    interior: Mapping[str, int]

    def in_group(self, name: str) -> npt.NDArray[np.bool_]:
        """Which facets are in a physical group, shape (facets,)."""
        member = np.array([name in groups for groups in self.facet_sets] + [False])
        return member[self.groups]

    def role(self, names: Iterable[str]) -> npt.NDArray[np.int64]:
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
    """Exchange the boundary facets of all ranks.

    Args:
        mesh: The blocks.
        space: Their displacement space, of degree 1 or 2.

    """
    domain = mesh.domain
    topology = domain.topology
    facets, cell, side = _exterior_facets(topology)
    vertices = compat.facet_vertices(topology)
    corner = vertices[side]
    geometry = compat.geometry_dofs(domain)[cell[:, None], corner]
    inputs = np.sort(np.asarray(domain.geometry.input_global_indices)[geometry], axis=1)

    layout = space.dofmap.dof_layout
    at_vertex = np.array([layout.entity_dofs(0, v)[0] for v in range(vertices.max() + 1)])
    columns = at_vertex[corner]
    inside = [layout.entity_dofs(1, s) for s in range(len(vertices))]
    if len(inside[0]):
        columns = np.column_stack([columns, np.array(inside)[side]])
    local_nodes = compat.cell_dofs(space)[cell[:, None], columns]
    nodes = space.dofmap.index_map.local_to_global(local_nodes.ravel().astype(np.int32))
    points = space.tabulate_dof_coordinates()[local_nodes][:, :, :2]
    centre = domain.geometry.x[compat.geometry_dofs(domain)[cell]][:, :, :2].mean(axis=1)
    normal, length = _outward_normals(points, centre)

    local = (
        inputs,
        np.asarray(nodes).reshape(local_nodes.shape),
        points,
        normal,
        length,
        mesh.body[cell],
    )
    gathered = mesh.comm.allgather(local)
    inputs, nodes, points, normal, length, body = (
        np.concatenate(parts) for parts in zip(*gathered, strict=True)
    )
    start = sum(len(parts[0]) for parts in gathered[: mesh.comm.rank])
    order = np.lexsort((inputs[:, 1], inputs[:, 0]))
    groups, interior = _groups(mesh, inputs[order])
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    return Boundary(
        nodes=nodes[order],
        points=points[order],
        normal=normal[order],
        length=length[order],
        body=body[order],
        groups=groups,
        facet_sets=mesh.facet_sets,
        local=place[start : start + len(facets)],
        local_facets=facets,
        interior=interior,
    )


def _exterior_facets(
    topology: Any,
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.int64]]:
    """Local facets with one cell, that cell, and the facet's number in it."""
    from dolfinx.mesh import exterior_facet_indices

    topology.create_entities(1)
    topology.create_connectivity(1, 2)
    topology.create_connectivity(2, 1)
    facets = np.asarray(exterior_facet_indices(topology), dtype=np.int32)
    to_cell = topology.connectivity(1, 2)
    cell = to_cell.array[to_cell.offsets[facets]]
    sides = compat.facets_of_cells(topology)[cell]
    return facets, cell, np.argmax(sides == facets[:, None], axis=1)


def _outward_normals(
    points: npt.NDArray[np.float64], centre: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    along = points[:, 1] - points[:, 0]
    length = np.linalg.norm(along, axis=1)
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
    inward = np.sum(normal * (points[:, 0] - centre), axis=1) < 0.0
    normal[inward] *= -1.0
    return normal, length


def _groups(
    mesh: BlockMesh, inputs: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int32], dict[str, int]]:
    """Group of every boundary facet, found by its input nodes; and what is tagged elsewhere."""
    groups = np.full(len(inputs), -1, dtype=np.int32)
    interior: dict[str, int] = {}
    if len(mesh.facets) == 0:
        return groups, interior
    stride = 1 + max(int(inputs.max()), int(mesh.facets.max()))
    tagged = mesh.facets[:, 0] * stride + mesh.facets[:, 1]
    keys = inputs[:, 0] * stride + inputs[:, 1]  # sorted
    where = np.minimum(np.searchsorted(keys, tagged), len(keys) - 1)
    found = keys[where] == tagged
    groups[where[found]] = mesh.facet_groups[found]
    for index in mesh.facet_groups[~found]:
        for name in mesh.facet_sets[index]:
            interior[name] = interior.get(name, 0) + 1
    return groups, interior
