"""The blocks' boundary facets as one table, the same on every rank.

Joints, supports and outlines are found on this table, by the same code on every rank. Shape
functions of facets and cells, and stencils of nodes, give displacements between the nodes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, BlockMesh, Flags, Indices, Labels
from fenics_contact.lazily import dolfinx_mesh

#: In place of a facet, node or body where rigid ground is.
GROUND = -1
#: In place of a node where a stretch ends inside a facet.
INSIDE = GROUND
#: Facets closer than this touch, as a fraction of the shorter one: an angle at a block of the order
#: of the strains, and what drawings and meshes of blocks have as rounding. Facets of curved sides
#: may be apart by the heights of their arcs besides.
CLOSED = 1e-3


@dataclass(frozen=True)
class Boundary:
    """Facets with one cell, of all ranks, sorted by their nodes in the input.

    Attributes:
        nodes: Displacement nodes of every facet, its two ends first, shape (facets, 2 or 3).
        points: Their coordinates, shape (facets, 2 or 3, 2), m.
        normal: Outward unit normals, shape (facets, 2).
        length: m, shape (facets,).
        body: Body of every facet.
        piece: Body of every facet as drawn: glued ones have one body.
        cell_groups: Groups of its cell as an index into `cell_sets`.
        cell_sets: The sets of names of two-dimensional groups that occur.
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
    piece: Labels
    cell_groups: Labels
    cell_sets: tuple[frozenset[str], ...]
    groups: Labels
    facet_sets: tuple[frozenset[str], ...]
    local: Indices
    local_facets: Labels
    interior: Mapping[str, int]

    def in_group(self, name: str) -> Flags:
        """Which facets are in a physical group, shape (facets,)."""
        member = np.array([name in groups for groups in self.facet_sets] + [False])
        return member[self.groups]

    def areas(self, centre: Array) -> Array:
        """Area of every body, m2, 1/2 int (x - centre).n ds, shape (bodies,)."""
        arm = self.points[:, :2].mean(axis=1) - centre[self.body]
        flux = np.sum(arm * self.normal, axis=1) * self.length
        return 0.5 * np.bincount(self.body, flux, len(centre))

    def centroids(self, centre: Array) -> Array:
        """Centre of area of every body, m, shape (bodies, 2); a point near each is given."""
        arm = self.points[:, :2].mean(axis=1) - centre[self.body]
        flux = np.sum(arm * self.normal, axis=1) * self.length
        moments = [np.bincount(self.body, flux * part, len(centre)) / 3.0 for part in arm.T]
        return centre + np.column_stack(moments) / self.areas(centre)[:, None]

    def nearest(self, place: Array) -> Array:
        """The place on every facet that is nearest to a place, m, shape (facets, 2)."""
        first, second = self.points[:, :2].swapaxes(0, 1)
        along = second - first
        s = np.clip(np.sum((place - first) * along, axis=1) / self.length**2, 0.0, 1.0)
        return np.asarray(first + s[:, None] * along)

    def of_block(self, where: tuple[float, float] | str) -> Flags:
        """Facets of cells in a two-dimensional group, or of the block as drawn at a place."""
        if isinstance(where, str):
            return np.array([where in groups for groups in self.cell_sets])[self.cell_groups]
        # A block is around a place where a ray from there meets an odd number of its facets.
        x, y = where
        (left, low), (right, high) = (self.points[:, end].T for end in (0, 1))
        between = (low > y) != (high > y)
        slope = np.divide(right - left, high - low, out=np.zeros(len(low)), where=between)
        crossed = between & (left + slope * (y - low) > x)
        inside = np.bincount(self.piece[crossed], minlength=int(self.piece.max()) + 1) % 2 == 1
        return inside[self.piece]

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
                    ' blocks on both sides nodes of their own, or set mesh.blocks = "surfaces"'
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


@dataclass(frozen=True)
class Stretches:
    """Stretches on which a facet of one body faces one of another, or stands on rigid ground.

    The nodes of one side, the slave, carry the joint points. A facet's parameter is 0 at the first
    of its nodes and 1 at the second. The same on all ranks.

    Attributes:
        facets: Facet of the slave and of the other side, `GROUND` for rigid ground, shape
            (2, stretches).
        span: Parameters at start and end of the stretch on either facet, ascending on the slave's,
            shape (2, stretches, 2).
        nodes: Nodes there, `INSIDE` for none, likewise.
        offset: Distance of the other side at start and end, m, shape (stretches, 2).
        slave: Side, 0 or 1, that is the slave; the body with the lower number is side 0, and rigid
            ground is; shape (stretches,).
    """

    facets: Indices
    span: Array
    nodes: Indices
    offset: Array
    slave: Indices

    def take(self, rows: Indices | Flags) -> Stretches:
        """Some of them."""
        of_both = self.facets[:, rows], self.span[:, rows], self.nodes[:, rows]
        return Stretches(*of_both, self.offset[rows], self.slave[rows])

    def bodies(self, boundary: Boundary) -> Labels:
        """Bodies of side 0 and side 1, shape (stretches, 2)."""
        body = np.where(self.facets == GROUND, GROUND, boundary.body[self.facets])
        return np.where(self.slave == 0, body, body[::-1]).T


def collect_boundary(mesh: BlockMesh, space: Any) -> Boundary:
    """Boundary facets of all ranks, with the nodes of a displacement space of degree 1 or 2."""
    domain = mesh.domain
    layout = space.dofmap.dof_layout
    topology = domain.topology
    for dims in ((1, 2), (2, 1)):
        topology.create_connectivity(*dims)
    local_facets = np.asarray(dolfinx_mesh.exterior_facet_indices(topology), dtype=np.int32)
    to_cell = topology.connectivity(1, 2)
    cell = to_cell.array[to_cell.offsets[local_facets]]
    geometry = compat.geometry_dofs(domain)[cell]
    count = geometry.shape[1]  # of sides, as of corners
    sides = topology.connectivity(2, 1).array.reshape(-1, count)[cell]
    # The two ends come first; they are numbered like the corners of the cell.
    dofs = np.array([layout.entity_closure_dofs(1, side) for side in range(count)])
    dofs = dofs[np.argmax(sides == local_facets[:, None], axis=1)]
    ends = np.take_along_axis(geometry, dofs[:, :2], axis=1)
    nodes = np.take_along_axis(compat.cell_dofs(space)[cell], dofs, axis=1)
    points = space.tabulate_dof_coordinates()[nodes][:, :, :2]
    global_nodes = space.dofmap.index_map.local_to_global(nodes.ravel().astype(np.int32))
    along = points[:, 1] - points[:, 0]
    length = np.linalg.norm(along, axis=1)
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
    centre = domain.geometry.x[geometry][:, :, :2].mean(axis=1)
    normal[np.sum(normal * (points[:, 0] - centre), axis=1) < 0.0] *= -1.0
    mine: dict[str, Any] = {
        "inputs": np.sort(np.asarray(domain.geometry.input_global_indices)[ends], axis=1),
        "nodes": np.asarray(global_nodes).reshape(nodes.shape),
        "points": points,
        "normal": normal,
        "length": length,
        "body": mesh.body[cell],
        "piece": mesh.pieces[cell],
        "cell_groups": mesh.cell_groups[cell],
    }
    parts = mesh.comm.allgather(mine)
    table = {name: np.concatenate([part[name] for part in parts]) for name in mine}
    inputs = table.pop("inputs")
    order = np.lexsort((inputs[:, 1], inputs[:, 0]))
    # Groups of boundary facets by their input nodes; and what is tagged elsewhere.
    inputs = inputs[order]
    stride = 1 + max(int(inputs.max()), int(mesh.facets.max(initial=0)))
    keys = inputs[:, 0] * stride + inputs[:, 1]  # sorted
    tagged = mesh.facets[:, 0] * stride + mesh.facets[:, 1]
    where = np.minimum(np.searchsorted(keys, tagged), len(keys) - 1)
    found = keys[where] == tagged
    groups = np.full(len(inputs), -1, dtype=np.int32)
    groups[where[found]] = mesh.facet_groups[found]
    inside = [name for group in mesh.facet_groups[~found] for name in mesh.facet_sets[group]]
    start = sum(len(part["length"]) for part in parts[: mesh.comm.rank])
    return Boundary(
        **{name: values[order] for name, values in table.items()},
        groups=groups,
        cell_sets=mesh.cell_sets,
        facet_sets=mesh.facet_sets,
        local=np.argsort(order)[start : start + len(local_facets)],
        local_facets=local_facets,
        interior=Counter(inside),
    )


#: Integrals of a facet's Lagrange functions over its length, by number of nodes.
SHARES = {2: np.array([1, 1]) / 2, 3: np.array([1, 1, 4]) / 6}
#: Weights below this are rounding.
NOTHING = 1e-13
#: In the place of a node: none.
NO_NODE = -1


@dataclass(frozen=True)
class Stencil:
    """Nodes that give the displacement of both sides at joint points, by their weighted sum.

    Attributes:
        nodes: `NO_NODE` for none, shape (points, 2, most nodes of a side).
        weights: Their sum is 1, but 0 on rigid ground.
    """

    nodes: Indices
    weights: Array

    @classmethod
    def of_rows(cls, table: Any) -> Stencil:
        """From a sparse matrix of nodes' shares, in rows 2 * point + side, of any positive sums."""
        filled = np.diff(table.indptr)
        nodes = np.full((table.shape[0], max(1, int(filled.max(initial=0)))), NO_NODE)
        weights = np.zeros(nodes.shape)
        row = np.repeat(np.arange(table.shape[0]), filled)
        place = np.arange(len(row)) - table.indptr[row]
        total = np.asarray(table.sum(axis=1)).ravel()  # the length of the point
        nodes[row, place], weights[row, place] = table.indices, table.data / total[row]
        shape = (-1, 2, nodes.shape[1])
        return cls(nodes.reshape(shape), weights.reshape(shape))

    @classmethod
    def joined(cls, parts: Sequence[Stencil]) -> Stencil:
        """Points of several stencils, one after the other."""
        width = max(part.nodes.shape[2] for part in parts)
        nodes = []
        weights = []
        for part in parts:
            rest = (0, 0), (0, 0), (0, width - part.nodes.shape[2])
            nodes.append(np.pad(part.nodes, rest, constant_values=NO_NODE))
            weights.append(np.pad(part.weights, rest))
        return cls(np.concatenate(nodes), np.concatenate(weights))

    def jump(self, values: Array) -> Array:
        """Vectors of the second side minus those of the first, shape (points, 2), from nodes'."""
        means = self.means(values)
        return np.asarray(means[:, 1] - means[:, 0])

    def means(self, values: Array) -> Array:
        """Weighted sums of nodes' vectors on both sides, shape (points, 2 sides, 2)."""
        padded = np.vstack([values, np.zeros((1, 2))])  # the last for none
        return np.asarray(np.einsum("nsi,nsik->nsk", self.weights, padded[self.nodes]))


#: Parameters of a facet's nodes.
NODES = {2: np.array([0.0, 1.0]), 3: np.array([0.0, 1.0, 0.5])}


def lagrange(parameter: Array, count: int) -> Array:
    """Lagrange functions of a facet with so many nodes, shape (*parameter.shape, count)."""
    s = parameter[..., None]
    if count == 2:
        return np.concatenate([1.0 - s, s], axis=-1)
    ends = [(1.0 - s) * (1.0 - 2.0 * s), s * (2.0 * s - 1.0)]
    return np.concatenate([*ends, 4.0 * s * (1.0 - s)], axis=-1)


def shape_functions(space: Any, place: Array) -> Array:
    """Lagrange functions of a cell's nodes at reference places, shape (..., nodes)."""
    nodes = compat.interpolation_points(space)
    count = 2 if len(nodes) < 6 else 3
    simplex = len(nodes) in (3, 6)
    powers = [(i, j) for i in range(count) for j in range(count - i * simplex)]

    def monomials(at: Array) -> Array:
        return np.stack([at[..., 0] ** i * at[..., 1] ** j for i, j in powers], axis=-1)

    return np.asarray(monomials(place) @ np.linalg.inv(monomials(nodes)))


def reference_places(corners: Array, arm: Array) -> Array:
    """Places in the reference cell of places from the first corner, shape (rows, points, 2).

    These are b xi + c eta + d xi eta: what is left without c eta is along b + d eta, an equation of
    the second degree for eta.
    """
    b, c, d = cell_sides(corners)
    constant = cross(arm, b)
    linear = cross(arm, d) + cross(b, c)
    root = np.sqrt(np.maximum(linear**2 + 4.0 * cross(c, d) * constant, 0.0))
    eta = -2.0 * constant / (linear + np.sign(cross(b, c)) * root)
    side = b + d * eta[..., None]
    xi = np.sum((arm - c * eta[..., None]) * side, axis=-1) / np.sum(side**2, axis=-1)
    return np.stack([xi, eta], axis=-1)


def cell_sides(corners: Array) -> tuple[Array, Array, Array]:
    """Vectors b, c, d of x = a + b xi + c eta + d xi eta in cells, shape (cells, 1, 2)."""
    a, b, c = np.moveaxis(corners[:, :3, None], 1, 0)
    rest = corners[:, 3, None] - b - c + a if corners.shape[1] == 4 else 0.0 * a
    return b - a, c - a, rest


def cross(one: Array, other: Array) -> Array:
    """Cross products of vectors in the plane, shape without the last axis."""
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
