"""Dual mortar coupling of joints: how a joint point sees the nodes on both sides.

The nodes of one side, the *slave*, carry the joint points. Where the joint ends inside a facet of
the slave, at a corner of the other block, that end is one more point. So a joint is divided into
*pieces* of slave facets, each with its Lagrange functions N_j and their dual functions psi_j,

    int psi_j N_i = delta_ij l_j,    l_j = int N_j,    sum_j psi_j = 1,

and the jump of the displacements at the point j is its mean with the weight psi_j,

    [u]_j = (1 / l_j) int psi_j (u_master - u_slave) ds,

which on the slave side is u_slave at the point (B.I. Wohlmuth, SIAM J. Numer. Anal. 38 (2000) 989;
S. Hueeber, B.I. Wohlmuth, Comput. Methods Appl. Mech. Engrg. 194 (2005) 3147). The integrals are
exact, so that a uniform pressure passes through any joint; where nodes match this is node to node.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.discretization.facets import GROUND, Boundary
from fenics_contact.discretization.pairing import INSIDE, OPTIONS, Stretches
from fenics_contact.mesh import Array, Indices, Labels

#: Integrals of a facet's Lagrange functions over its length, by number of nodes.
SHARES = {2: np.array([1, 1]) / 2, 3: np.array([1, 1, 4]) / 6}
#: Their products, likewise.
PRODUCTS = {
    2: np.array([[2, 1], [1, 2]]) / 6,
    3: np.array([[4, -1, 2], [-1, 4, 2], [2, 2, 16]]) / 30,
}
#: Parameters of a facet's nodes.
NODES = {2: np.array([0.0, 1.0]), 3: np.array([0.0, 1.0, 0.5])}
#: Entries below this are rounding.
NOTHING = 1e-13


@dataclass(frozen=True)
class Stencil:
    """Nodes that give the displacement of both sides at joint points, by their weighted sum.

    Attributes:
        nodes: -1 for none, shape (points, 2, most nodes of a side).
        weights: Their sum is 1, but 0 on rigid ground.
    """

    nodes: Indices
    weights: Array


@dataclass(frozen=True)
class Pieces:
    """Pieces of facets that carry joint points; the same on all ranks.

    Attributes:
        facet: Facet of the slave.
        span: Its parameters at start and end, ascending, shape (pieces, 2).
        nodes: Node of the slave, and of the other side, at every joint point of the piece, -1 for
            none, shape (2, pieces, points of a piece).
        side: 0 where the slave is the first side, 1 where the second.
        bodies: Bodies of the first and second side, shape (pieces, 2).
        law: Law of the joint.
        normal: Mean normal from first to second side, shape (pieces, 2).
        stretch_piece: Piece of every stretch.
        stretches: Those, slave first and from start to end.
    """

    facet: Indices
    span: Array
    nodes: Indices
    side: Indices
    bodies: Labels
    law: Indices
    normal: Array
    stretch_piece: Indices
    stretches: Stretches


def pieces_of(boundary: Boundary, stretches: Stretches, law: Indices) -> Pieces:
    """Join the stretches of joints to pieces of facets of the slaves, in the order of these."""
    bodies = boundary.body[stretches.facets].T
    side = stretches.slave
    made = _slave_first(stretches)
    order = np.lexsort((made.span[0, :, 0], law, bodies[:, 1], bodies[:, 0], made.facets[0]))
    made, side, law, bodies = made.take(order), side[order], law[order], bodies[order]
    # A piece goes on where the next facet of the other side begins at the node of the last one.
    joint = np.column_stack([made.facets[0], bodies, law])
    node = made.nodes[1]
    goes_on = np.all(joint[1:] == joint[:-1], axis=1) & (node[1:, 0] == node[:-1, 1])
    goes_on &= node[1:, 0] != INSIDE
    bounds = np.concatenate([[True], ~goes_on, [True]])
    if not len(law):
        bounds = bounds[:1]
    piece = np.cumsum(bounds[:-1]) - 1
    first, last = np.flatnonzero(bounds[:-1]), np.flatnonzero(bounds[1:])
    count = boundary.nodes.shape[1]
    nodes = np.full((2, len(first), count), INSIDE)
    nodes[:, :, 0], nodes[:, :, 1] = made.nodes[:, first, 0], made.nodes[:, last, 1]
    # Before a slave's node is one of the other side only if it is in the same place.
    gap = np.abs(np.column_stack([made.offset[first, 0], made.offset[last, 1]]))
    apart = gap > OPTIONS.closed * boundary.length[made.facets[0, first]][:, None]
    nodes[1, :, :2][apart & (nodes[0, :, :2] != INSIDE)] = INSIDE
    if count == 3:  # mid nodes of whole facets
        for at, facets in zip(nodes, made.facets, strict=True):
            whole = np.all(at[:, :2] != INSIDE, axis=1) & (first == last)
            at[whole, 2] = boundary.nodes[facets[first[whole]], 2]
        whole = np.all(nodes[0, :, :2] != INSIDE, axis=1)
        nodes[0, whole, 2] = boundary.nodes[made.facets[0, first[whole]], 2]
    share = made.span[0, :, 1] - made.span[0, :, 0]
    sums = np.zeros((len(first), 3))
    np.add.at(sums, piece, share[:, None] * np.column_stack([np.ones(len(share)), made.normal]))
    return Pieces(
        facet=made.facets[0, first],
        span=np.column_stack([made.span[0, first, 0], made.span[0, last, 1]]),
        nodes=nodes,
        side=side[first],
        bodies=bodies[first],
        law=law[first],
        normal=sums[:, 1:] / sums[:, :1],
        stretch_piece=piece,
        stretches=made,
    )


def with_ground(boundary: Boundary, pieces: Pieces, facets: Indices, law: Indices) -> Pieces:
    """Pieces of joints, then whole facets on rigid ground, which is their first side."""
    ours = boundary.nodes[facets]
    none = np.full_like(facets, GROUND)
    ground = Pieces(
        facet=facets,
        span=np.tile([0.0, 1.0], (len(facets), 1)),
        nodes=np.stack([ours, np.full_like(ours, GROUND)]),
        side=np.ones_like(facets),
        bodies=np.column_stack([none, boundary.body[facets]]),
        law=law,
        normal=-boundary.normal[facets],
        stretch_piece=pieces.stretch_piece,
        stretches=pieces.stretches,
    )
    columns = {
        name: np.concatenate(
            [getattr(pieces, name), getattr(ground, name)], axis=int(name == "nodes")
        )
        for name in ("facet", "span", "nodes", "side", "bodies", "law", "normal")
    }
    return Pieces(**columns, stretch_piece=pieces.stretch_piece, stretches=pieces.stretches)


def stencil_of(boundary: Boundary, pieces: Pieces, point: Indices) -> Stencil:
    """Stencil of joint points; `point` is that of every place, shape (pieces, places)."""
    from scipy.sparse import coo_matrix

    count = boundary.nodes.shape[1]
    length = boundary.length[pieces.facet] * (pieces.span[:, 1] - pieces.span[:, 0])
    weight = length[:, None] * SHARES[count]
    places = pieces.span[:, :1] + (pieces.span[:, 1:] - pieces.span[:, :1]) * NODES[count]
    slave = weight[:, :, None] * lagrange(places, count)
    master = _mortar_integrals(pieces, length, count)
    of = pieces.stretch_piece
    entries = [(slave, point, pieces.side, boundary.nodes[pieces.facet])]
    entries += [
        (master, point[of], 1 - pieces.side[of], boundary.nodes[pieces.stretches.facets[1]])
    ]
    values = np.concatenate([table.ravel() for table, *_ in entries])
    rows = np.concatenate(
        [np.broadcast_to((2 * at + on[:, None])[:, :, None], t.shape).ravel()
         for t, at, on, _ in entries]
    )  # fmt: skip
    columns = np.concatenate(
        [np.broadcast_to(nodes[:, None], t.shape).ravel() for t, _, _, nodes in entries]
    )
    keep = np.abs(values) > NOTHING * values.max(initial=0.0)
    size = 2 * (int(point.max(initial=-1)) + 1), int(boundary.nodes.max(initial=-1)) + 1
    table = coo_matrix((values[keep], (rows[keep], columns[keep])), size).tocsr()
    filled = np.diff(table.indptr)
    nodes = np.full((size[0], max(1, int(filled.max(initial=0)))), GROUND)
    weights = np.zeros(nodes.shape)
    row = np.repeat(np.arange(size[0]), filled)
    place = np.arange(len(row)) - table.indptr[row]
    total = np.asarray(table.sum(axis=1)).ravel()  # the length of the point
    nodes[row, place], weights[row, place] = table.indices, table.data / total[row]
    shape = (-1, 2, nodes.shape[1])
    return Stencil(nodes.reshape(shape), weights.reshape(shape))


def lagrange(parameter: Array, count: int) -> Array:
    """Lagrange functions of a facet with so many nodes, shape (*parameter.shape, count)."""
    s = parameter[..., None]
    if count == 2:
        return np.concatenate([1.0 - s, s], axis=-1)
    ends = [(1.0 - s) * (1.0 - 2.0 * s), s * (2.0 * s - 1.0)]
    return np.concatenate([*ends, 4.0 * s * (1.0 - s)], axis=-1)


def _mortar_integrals(pieces: Pieces, length: Array, count: int) -> Array:
    """Integrals of psi_j N_i over every stretch, N_i of the other side, m.

    Shape (stretches, points of a piece, nodes of a facet).
    """
    stretches, of = pieces.stretches, pieces.stretch_piece
    bounds, span = pieces.span[of], stretches.span
    local = (span[0] - bounds[:, :1]) / (bounds[:, 1:] - bounds[:, :1])
    # One facet opposite: N_i are combinations of N_j, with their values at the points.
    other = span[1, :, :1] + (span[1, :, 1:] - span[1, :, :1]) * NODES[count]
    integrals = length[of, None, None] * SHARES[count][:, None] * lagrange(other, count)
    several = np.bincount(of, minlength=len(length))[of] > 1
    local, span, size = local[several], span[1, several], length[of[several]]
    gauss, weight = np.polynomial.legendre.leggauss(3)
    gauss, weight = 0.5 * (1.0 + gauss), 0.5 * weight
    here, there = (ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * gauss for ends in (local, span))
    dual = SHARES[count][:, None] * np.linalg.inv(PRODUCTS[count])
    psi = lagrange(here, count) @ dual.T
    size = size * (local[:, 1] - local[:, 0])
    integrals[several] = np.einsum(
        "s,g,sgj,sgi->sji", size, weight, psi, lagrange(there, count), optimize=True
    )
    return integrals


def _slave_first(stretches: Stretches) -> Stretches:
    """Stretches with the slave's column first, run through from its first node on."""
    swap = stretches.slave == 1
    facets, span, nodes = stretches.facets.copy(), stretches.span.copy(), stretches.nodes.copy()
    facets[:, swap] = facets[::-1, swap]
    span[:, swap], nodes[:, swap] = span[::-1, swap], nodes[::-1, swap]
    back = span[0, :, 0] > span[0, :, 1]
    offset = stretches.offset.copy()
    span[:, back], nodes[:, back] = span[:, back, ::-1], nodes[:, back, ::-1]
    offset[back] = offset[back, ::-1]
    return replace(stretches, facets=facets, span=span, nodes=nodes, offset=offset)
