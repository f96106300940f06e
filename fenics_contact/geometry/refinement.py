"""Local refinement of a mesh of blocks: marked triangles in four, neighbours as needed.

All sides of a marked triangle are cut. A triangle with a cut side is halved from the middle of its
longest side, and each half at another cut side, so that no angle gets small over many refinements
(M.C. Rivara, Int. J. Numer. Meth. Eng. 20 (1984) 745). The marking is closed for this over the
cells of a body, over ranks, and over joints: facets that coincide are cut on both sides.

Children stay on their parent's rank. Only what lies on boundaries is exchanged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.geometry.mesh import Array, BlockMesh, Flags, Indices, StoredMesh
from fenics_contact.lazily import dolfinx_mesh
from fenics_contact.parallel import MPI

#: Facets coincide when their middles and lengths agree to this fraction of their length.
COINCIDING = 1e-4
#: Sides are equally long up to this, relative; the first one is then the longest.
EQUALLY_LONG = 1e-9


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
    cut = _closed(table, cells)
    index_map = mesh.domain.topology.index_map(1)
    mine = np.flatnonzero(cut[: index_map.size_local])
    nodes, points, first = _node_numbers(mesh.domain, len(mine))
    numbers = np.zeros(index_map.size_local)
    numbers[mine] = first + np.arange(len(mine))
    middles = np.where(cut, compat.summed(index_map, numbers).astype(np.int64), -1)
    points = np.concatenate([points, table.points[mine].mean(axis=1)])
    children, parent = _halves(nodes[table.corners], middles[table.of_cell])
    made, _ = _remade(mesh, children, points, parent)
    return _with_facets(made, mesh, table.ends, nodes, middles)


def _halves(corners: Indices, middles: Indices) -> tuple[Indices, Indices]:
    """Triangles halved at up to three sides, the longest one first, and the parent of each.

    Args:
        corners: Nodes a, b, c, with bc the longest side, shape (triangles, 3).
        middles: Nodes at the middles of bc, ca, ab; -1 where a side is not cut, likewise.
    """
    # Columns: a, b, c, middles of bc, ca, ab, parent. Then: apex, base, its middle, parent.
    whole = np.column_stack([corners, middles, np.arange(len(corners))])
    cut = whole[:, 3] >= 0
    halves = [whole[cut][:, [3, 0, 1, 5, 6]], whole[cut][:, [3, 2, 0, 4, 6]]]
    table = np.concatenate([whole[~cut][:, [0, 1, 2, 3, 6]], *halves])
    cut = table[:, 3] >= 0
    halves = [table[cut][:, [0, 1, 3, 4]], table[cut][:, [0, 3, 2, 4]]]
    found = np.concatenate([table[~cut][:, [0, 1, 2, 4]], *halves])
    return found[:, :3], found[:, 3]


@dataclass(frozen=True)
class _Sides:
    """Sides of this rank's triangles; nodes and sides are local numbers.

    Attributes:
        domain: dolfinx mesh.
        corners: Nodes of every cell, that opposite to its longest side first, shape (cells, 3).
        of_cell: Sides of every cell, each opposite to its corner, shape (cells, 3).
        ends: Nodes at the ends of every side, shape (sides, 2).
        points: Coordinates of the ends, shape (sides, 2, 2), m.
    """

    domain: Any
    corners: Indices
    of_cell: Indices
    ends: Indices
    points: Array

    @classmethod
    def of(cls, mesh: BlockMesh) -> _Sides:
        """Those of a mesh of triangles."""
        topology = mesh.domain.topology
        for dims in ((2, 1), (1, 2)):
            topology.create_connectivity(*dims)
        corners = compat.geometry_dofs(mesh.domain).astype(np.int64)
        of_cell = topology.connectivity(2, 1).array.reshape(-1, 3)
        points = mesh.domain.geometry.x[corners]
        length = np.linalg.norm(points[:, [2, 0, 1]] - points[:, [1, 2, 0]], axis=2)
        far = length >= (1.0 - EQUALLY_LONG) * length.max(axis=1, keepdims=True, initial=0.0)
        turned = (np.argmax(far, axis=1)[:, None] + np.arange(3)) % 3
        corners, of_cell = (np.take_along_axis(old, turned, axis=1) for old in (corners, of_cell))
        index_map = topology.index_map(1)
        ends = np.zeros((index_map.size_local + index_map.num_ghosts, 2), dtype=np.int64)
        ends[of_cell] = corners[:, [[1, 2], [2, 0], [0, 1]]]
        return cls(mesh.domain, corners, of_cell, ends, mesh.domain.geometry.x[ends, :2])


def _closed(table: _Sides, cells: Flags) -> Flags:
    """Sides to cut: all of the marked cells, and those that follow, shape (sides,)."""
    from scipy.spatial import cKDTree

    comm = table.domain.comm
    topology = table.domain.topology
    exterior = np.asarray(dolfinx_mesh.exterior_facet_indices(topology), dtype=np.int64)
    # Of every side at boundaries, all ranks in a row, that which coincides with it, or itself.
    ends = table.points[exterior]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    parts = comm.allgather(np.column_stack([ends.mean(axis=1), length]))
    sides = np.concatenate(parts)
    near = COINCIDING * sides[:, 2]
    one, other = cKDTree(sides).query_pairs(near.max(initial=0.0), output_type="ndarray").T
    apart = np.linalg.norm(sides[one] - sides[other], axis=1)
    close = apart <= np.minimum(near[one], near[other])
    opposite = np.arange(len(sides))
    opposite[one[close]] = other[close]
    opposite[other[close]] = one[close]
    first = sum(map(len, parts[: comm.rank]))
    mine = slice(first, first + len(length))
    on_boundaries = np.zeros(len(opposite), dtype=bool)
    cut = np.zeros(len(table.ends), dtype=bool)
    cut[table.of_cell[cells]] = True
    while True:
        before = cut.copy()
        cut[table.of_cell[cut[table.of_cell].any(axis=1), 0]] = True
        cut = compat.summed(topology.index_map(1), cut) > 0.0
        on_boundaries[mine] = cut[exterior]
        comm.Allreduce(MPI.IN_PLACE, on_boundaries, MPI.LOR)
        cut[exterior] |= on_boundaries[opposite[mine]]
        if not comm.allreduce(bool(np.any(cut != before)), MPI.LOR):
            return cut


def _node_numbers(domain: Any, more: int) -> tuple[Indices, Array, int]:
    """New numbers of this rank's nodes, coordinates of those it owns, and the number after them.

    Numbers count the points of all ranks: of each its nodes, then so many more.
    """
    index_map = domain.geometry.index_map()
    count = index_map.size_local
    first = sum(domain.comm.allgather(count + more)[: domain.comm.rank])
    numbers = compat.summed(index_map, first + np.arange(count)).astype(np.int64)
    return numbers, domain.geometry.x[:count, :2], first + count


def _remade(
    mesh: BlockMesh, cells: Indices, points: Array, parent: Indices
) -> tuple[BlockMesh, Indices]:
    """A mesh of triangles on the same ranks, and the cell of `mesh` that each came from.

    Tagged facets are left as they are.
    """
    domain = compat.create_mesh_in_place(mesh.comm, cells, points)
    stored = StoredMesh.of(domain, cells, points)
    first = sum(mesh.comm.allgather(len(cells))[: mesh.comm.rank])
    parent = parent[np.asarray(domain.topology.original_cell_index) - first]
    labels = {"body": mesh.body[parent], "cell_groups": mesh.cell_groups[parent]}
    labels |= {} if mesh.drawn is None else {"drawn": mesh.drawn[parent]}
    return replace(mesh, stored=stored, **labels), parent


def _triangles(mesh: BlockMesh) -> tuple[BlockMesh, Indices]:
    """Quadrilaterals cut along a diagonal, and the cell that each triangle came from."""
    corners = compat.geometry_dofs(mesh.domain).astype(np.int64)
    nodes, points, _ = _node_numbers(mesh.domain, 0)
    # dolfinx numbers corners row by row, 0 1 / 2 3: both halves go round like the whole.
    halves = nodes[corners][:, [[0, 1, 3], [0, 3, 2]]].reshape(-1, 3)
    made, parent = _remade(mesh, halves, points, np.repeat(np.arange(len(corners)), 2))
    ends = corners[:, [[0, 1], [1, 3], [3, 2], [2, 0]]].reshape(-1, 2)
    return _with_facets(made, mesh, ends, nodes, np.full(len(ends), -1)), parent


def _with_facets(
    made: BlockMesh, mesh: BlockMesh, ends: Indices, nodes: Indices, middles: Indices
) -> BlockMesh:
    """A mesh made of another one with that one's tagged facets; what was cut is two facets.

    Args:
        made: The new mesh.
        mesh: The old one.
        ends: Nodes at the ends of this rank's sides in the old one, shape (sides, 2).
        nodes: New numbers of nodes.
        middles: New numbers of the nodes at the middles of sides; -1 where a side is not cut.
    """
    group = dict(zip(map(tuple, mesh.facets.tolist()), mesh.facet_groups.tolist(), strict=True))
    inputs = np.asarray(mesh.domain.geometry.input_global_indices)[ends]
    found = set()  # two ranks may have the same side
    for pair, (one, other), middle in zip(
        np.sort(inputs, axis=1).tolist(), nodes[ends].tolist(), middles.tolist(), strict=True
    ):
        if tuple(pair) in group:
            parts = [(one, other)] if middle < 0 else [(one, middle), (middle, other)]
            found |= {(min(part), max(part), group[tuple(pair)]) for part in parts}
    rows = np.array(sorted(set().union(*made.comm.allgather(found))), dtype=np.int64).reshape(-1, 3)
    return replace(made, facets=rows[:, :2].copy(), facet_groups=rows[:, 2].astype(np.int32))
