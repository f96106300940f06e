"""Local refinement of a mesh of blocks: marked triangles in four, their neighbours as needed.

A marked triangle is cut at the middles of its sides into four similar ones. A triangle with one or
two cut sides is first halved from the middle of its longest side, so that no angle gets small over
many refinements (C. Carstensen, Constr. Approx. 20 (2004) 549). The marking is closed for this over
the cells of a body, over ranks, and over joints: facets that coincide are cut on both sides.

Children stay on their parent's rank. Only what lies on boundaries is exchanged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from dolfinx.mesh import exterior_facet_indices
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.mesh import Array, BlockMesh, Flags, Indices

#: Facets coincide when their middles agree to this fraction of their length.
COINCIDING = 1e-4
#: Sides are equally long up to this, relative; the first one is then the longest.
EQUALLY_LONG = 1e-9

#: Children of a triangle by its cut sides. Its corners a, b, c are 0, 1, 2; the middles of bc (its
#: longest side), ca and ab are 3, 4, 5. Keys: whether bc, ca, ab are cut.
CHILDREN = {
    (False, False, False): [[0, 1, 2]],
    (True, False, False): [[0, 1, 3], [0, 3, 2]],
    (True, True, False): [[0, 1, 3], [0, 3, 4], [3, 2, 4]],
    (True, False, True): [[0, 3, 2], [5, 1, 3], [0, 5, 3]],
    (True, True, True): [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]],
}


def refine(mesh: BlockMesh, cells: Flags) -> BlockMesh:
    """The mesh with marked cells refined; quadrilaterals are cut into triangles first, all of them.

    Args:
        mesh: Blocks.
        cells: Which of this rank's cells to refine, shape (cells,).
    """
    if compat.geometry_dofs(mesh.domain).shape[1] == 4:
        mesh, parent = _triangles(mesh)
        cells = cells[parent]
    table = _Sides.of(mesh)
    cut = _closed(table, mesh.comm, cells)
    nodes, middles, points = _numbered(table, cut)
    turned = (table.longest[:, None] + np.arange(3)) % 3  # of corners and of the sides opposite
    sides = np.take_along_axis(table.of_cell, turned, axis=1)
    corners = nodes[np.take_along_axis(table.corners, turned, axis=1)]
    numbers, state = np.hstack([corners, middles[sides]]), cut[sides]
    children, parents = [], []
    for key, pattern in CHILDREN.items():
        rows = np.flatnonzero(np.all(state == key, axis=1))
        children.append(numbers[rows][:, pattern].reshape(-1, 3))
        parents.append(np.repeat(rows, len(pattern)))
    parent = np.concatenate(parents)
    order = np.argsort(parent, kind="stable")
    made, _ = _remade(mesh, np.concatenate(children)[order], points, parent[order])
    inputs = np.asarray(mesh.domain.geometry.input_global_indices)[table.ends]
    return _with_facets(made, inputs, nodes[table.ends], middles)


@dataclass(frozen=True)
class _Sides:
    """Sides of this rank's triangles; nodes and sides are local numbers, side i is opposite to i.

    Attributes:
        domain: dolfinx mesh.
        corners: Nodes of every cell, shape (cells, 3).
        of_cell: Sides of every cell, shape (cells, 3).
        longest: Which of them is the longest, shape (cells,).
        ends: Nodes at the ends of every side, shape (sides, 2).
        exterior: Sides at the blocks' boundaries.
    """

    domain: Any
    corners: Indices
    of_cell: Indices
    longest: Indices
    ends: Indices
    exterior: Indices

    @classmethod
    def of(cls, mesh: BlockMesh) -> _Sides:
        """Those of a mesh of triangles."""
        topology = mesh.domain.topology
        corners = compat.geometry_dofs(mesh.domain).astype(np.int64)
        for dims in ((2, 1), (1, 2)):
            topology.create_connectivity(*dims)
        of_cell = topology.connectivity(2, 1).array.reshape(-1, 3)
        pairs = corners[:, [[1, 2], [2, 0], [0, 1]]]
        index_map = topology.index_map(1)
        ends = np.zeros((index_map.size_local + index_map.num_ghosts, 2), dtype=np.int64)
        ends[of_cell] = pairs
        along = np.diff(mesh.domain.geometry.x[pairs], axis=2)
        length = np.linalg.norm(along, axis=(2, 3))
        far = length >= (1.0 - EQUALLY_LONG) * length.max(axis=1, keepdims=True, initial=0.0)
        exterior = np.asarray(exterior_facet_indices(topology), dtype=np.int64)
        return cls(mesh.domain, corners, of_cell, np.argmax(far, axis=1), ends, exterior)

    def end_points(self, sides: Indices) -> Array:
        """Coordinates of the ends of sides, shape (sides, 2, 2), m."""
        return np.asarray(self.domain.geometry.x[self.ends[sides], :2])


def _closed(table: _Sides, comm: MPI.Comm, cells: Flags) -> Flags:
    """Sides to cut: all of the marked cells, and those that follow, shape (sides,)."""
    sides = np.arange(len(table.of_cell))
    longest = table.of_cell[sides, table.longest]
    partners = _Partners.of(table, comm)
    index_map = table.domain.topology.index_map(1)
    cut = np.zeros(len(table.ends), dtype=bool)
    cut[table.of_cell[cells]] = True
    while True:
        before = cut.copy()
        cut[longest[cut[table.of_cell].any(axis=1)]] = True
        cut = compat.summed(index_map, cut[:, None].astype(float))[:, 0] > 0.0
        partners.join(cut, table.exterior)
        if not comm.allreduce(bool(np.any(cut != before)), MPI.LOR):
            return cut


@dataclass(frozen=True)
class _Partners:
    """Sides at boundaries, of all ranks in a row, that coincide.

    Attributes:
        comm: All ranks.
        first: Number of this rank's first one.
        partner: That opposite to each, or itself, shape (sides of all ranks,).
    """

    comm: MPI.Comm
    first: int
    partner: Indices

    @classmethod
    def of(cls, table: _Sides, comm: MPI.Comm) -> _Partners:
        """Those that coincide with another one."""
        from scipy.spatial import cKDTree

        ends = table.end_points(table.exterior)
        parts = comm.allgather(ends)
        ends = np.concatenate(parts)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        middle, near = ends.mean(axis=1), COINCIDING * length
        pairs = cKDTree(middle).query_pairs(near.max(initial=0.0), output_type="ndarray")
        one, other = pairs.T
        distance = np.linalg.norm(middle[one] - middle[other], axis=1)
        unlike = np.abs(length[one] - length[other])
        close = np.maximum(distance, unlike) <= np.minimum(near[one], near[other])
        partner = np.arange(len(length))
        partner[one[close]], partner[other[close]] = other[close], one[close]
        return cls(comm, sum(map(len, parts[: comm.rank])), partner)

    def join(self, cut: Flags, exterior: Indices) -> None:
        """Mark, in `cut`, the sides of this rank that are cut on the other side of a joint."""
        everywhere = np.zeros(len(self.partner), dtype=bool)
        mine = slice(self.first, self.first + len(exterior))
        everywhere[mine] = cut[exterior]
        self.comm.Allreduce(MPI.IN_PLACE, everywhere, MPI.LOR)
        cut[exterior] |= everywhere[self.partner[mine]]


def _numbered(table: _Sides, cut: Flags) -> tuple[Indices, Indices, Array]:
    """New numbers of nodes and of middles of sides (-1: none), and this rank's new points."""
    index_map = table.domain.topology.index_map(1)
    mine = np.flatnonzero(cut[: index_map.size_local])
    nodes, points = _node_numbers(table.domain, len(mine))
    numbers = np.full(index_map.size_local, -1)
    first = _before(table.domain.comm, len(points) + len(mine)) + len(points)
    numbers[mine] = first + np.arange(len(mine))
    points = np.concatenate([points, table.end_points(mine).mean(axis=1)])
    return nodes, compat.with_ghosts(index_map, numbers), points


def _node_numbers(domain: Any, more: int) -> tuple[Indices, Array]:
    """New numbers of this rank's nodes, and coordinates of those it owns, shape (nodes, 2).

    Numbers count the points of all ranks: of each its nodes, then so many more.
    """
    index_map = domain.geometry.index_map()
    count = index_map.size_local
    first = _before(domain.comm, count + more)
    numbers = compat.with_ghosts(index_map, first + np.arange(count))
    return numbers, domain.geometry.x[:count, :2]


def _before(comm: MPI.Comm, count: int) -> int:
    """Sum of the counts of the ranks before this one."""
    return sum(comm.allgather(count)[: comm.rank])


def _remade(
    mesh: BlockMesh, cells: Indices, points: Array, parent: Indices
) -> tuple[BlockMesh, Indices]:
    """A mesh of triangles on the same ranks, and the cell of `mesh` that each came from.

    Tagged facets are left as they are.
    """
    comm = mesh.comm
    domain = compat.create_mesh_in_place(comm, cells, points)
    first = _before(comm, len(cells))
    parent = parent[np.asarray(domain.topology.original_cell_index) - first]
    labels = {"body": mesh.body[parent], "cell_groups": mesh.cell_groups[parent]}
    return replace(mesh, domain=domain, **labels), parent


def _triangles(mesh: BlockMesh) -> tuple[BlockMesh, Indices]:
    """Quadrilaterals cut along a diagonal, and the cell that each triangle came from."""
    geometry, corners = mesh.domain.geometry, compat.geometry_dofs(mesh.domain)
    nodes, points = _node_numbers(mesh.domain, 0)
    # dolfinx numbers corners row by row, 0 1 / 2 3: both halves go round like the whole.
    halves = nodes[corners][:, [[0, 1, 3], [0, 3, 2]]].reshape(-1, 3)
    made, parent = _remade(mesh, halves, points, np.repeat(np.arange(len(corners)), 2))
    ends = corners[:, [[0, 1], [1, 3], [3, 2], [2, 0]]].reshape(-1, 2)
    inputs = np.asarray(geometry.input_global_indices)[ends]
    return _with_facets(made, inputs, nodes[ends], np.full(len(ends), -1)), parent


def _with_facets(made: BlockMesh, inputs: Indices, ends: Indices, middles: Indices) -> BlockMesh:
    """A mesh made of another one, with that one's tagged facets: what was cut as two.

    Args:
        made: The mesh, with the facets of the other one.
        inputs: Input nodes of the ends of this rank's sides in the other mesh, shape (sides, 2).
        ends: Their input nodes in the new one, likewise.
        middles: Input nodes at their middles in the new one; -1 where a side is not cut.
    """
    if not len(made.facets):
        return made
    stride = 1 + max(int(inputs.max(initial=0)), int(made.facets.max()))
    tagged = made.facets[:, 0] * stride + made.facets[:, 1]
    keys = inputs.min(axis=1) * stride + inputs.max(axis=1)
    order = np.argsort(tagged)
    where = np.minimum(np.searchsorted(tagged, keys, sorter=order), len(order) - 1)
    row = order[where]
    found = tagged[row] == keys
    (one, other), middle, group = ends[found].T, middles[found], made.facet_groups[row[found]]
    cut = middle >= 0
    first = np.column_stack([one, np.where(cut, middle, other), group])
    second = np.column_stack([middle, other, group])[cut]
    rows = np.concatenate(made.comm.allgather(np.concatenate([first, second])))
    rows[:, :2].sort(axis=1)
    rows = np.unique(rows, axis=0)  # two ranks may have the same side
    return replace(made, facets=rows[:, :2].copy(), facet_groups=rows[:, 2].astype(np.int32))
