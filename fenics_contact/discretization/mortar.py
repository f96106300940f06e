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

from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.facets import (
    CLOSED,
    GROUND,
    INSIDE,
    NODES,
    NOTHING,
    SHARES,
    Boundary,
    Stencil,
    Stretches,
    lagrange,
)
from fenics_contact.geometry.mesh import Array, Indices, Labels

#: Integrals of the products of a facet's Lagrange functions over its length, by number of nodes.
PRODUCTS = {
    2: np.array([[2, 1], [1, 2]]) / 6,
    3: np.array([[4, -1, 2], [-1, 4, 2], [2, 2, 16]]) / 30,
}


@dataclass(frozen=True)
class Pieces:
    """Pieces of the slaves' facets that carry joint points; the same on all ranks.

    Attributes:
        facet: Facet of the slave.
        span: Its parameters at start and end, ascending, shape (pieces, 2).
        nodes: Node of the slave, and of the other side, at every joint point of the piece, -1 for
            none, shape (2, pieces, points of a piece).
        side: 0 where the slave is the first side, 1 where the second.
        bodies: Bodies of the first and second side, shape (pieces, 2).
        law: Law of the joint.
        normal: Unit normal from first to second side, shape (pieces, 2).
        length: m.
        stretches: Those the pieces are joined of.
        of_stretch: Piece of every stretch.
    """

    facet: Indices
    span: Array
    nodes: Indices
    side: Indices
    bodies: Labels
    law: Indices
    normal: Array
    length: Array
    stretches: Stretches
    of_stretch: Indices

    @property
    def places(self) -> Array:
        """Parameters of the joint points on the slave's facets, shape (pieces, points)."""
        extent = self.span[:, 1:] - self.span[:, :1]
        return self.span[:, :1] + extent * NODES[self.nodes.shape[2]]


def pieces_of(boundary: Boundary, stretches: Stretches, law: Indices) -> Pieces:
    """Join stretches to pieces of facets of the slaves, in the order of these, on ground last."""
    bodies = stretches.bodies(boundary)
    slave = stretches.facets[0]
    keys = stretches.span[0, :, 0], law, bodies[:, 1], bodies[:, 0], slave, bodies[:, 0] == GROUND
    order = np.lexsort(keys)
    made = stretches.take(order)
    law = law[order]
    bodies = bodies[order]
    # A piece goes on where the next facet of the other side begins at the node of the last one.
    joint = np.column_stack([made.facets[0], bodies, law])
    node = made.nodes[1]
    goes_on = np.all(joint[1:] == joint[:-1], axis=1) & (node[1:, 0] == node[:-1, 1])
    goes_on &= node[1:, 0] != INSIDE
    begins = np.concatenate([np.ones(min(1, len(law)), dtype=bool), ~goes_on])
    first = np.flatnonzero(begins)
    last = np.flatnonzero(np.roll(begins, -1))
    facet = made.facets[0, first]
    side = made.slave[first]
    span = np.column_stack([made.span[0, first, 0], made.span[0, last, 1]])
    # Nodes of both sides at the joint points, from the first stretch to the last.
    facets = made.facets[:, first]
    count = boundary.nodes.shape[1]
    nodes = np.full((*facets.shape, count), INSIDE)
    nodes[:, :, 0] = made.nodes[:, first, 0]
    nodes[:, :, 1] = made.nodes[:, last, 1]
    # Before a slave's node is one of the other side only if it is in the same place.
    gap = np.abs(np.column_stack([made.offset[first, 0], made.offset[last, 1]]))
    apart = gap > CLOSED * boundary.length[facets[0], None]
    nodes[1, :, :2][apart & (nodes[0, :, :2] != INSIDE)] = INSIDE
    if count == 3:  # mid nodes of whole facets
        whole = np.all(nodes[:, :, :2] != INSIDE, axis=2)
        whole[1] &= first == last
        nodes[whole, 2] = boundary.nodes[facets[whole], 2]
    return Pieces(
        facet=facet,
        span=span,
        nodes=nodes,
        side=side,
        bodies=bodies[first],
        law=law[first],
        normal=(1.0 - 2.0 * side)[:, None] * boundary.normal[facet],
        length=boundary.length[facet] * (span[:, 1] - span[:, 0]),
        stretches=made,
        of_stretch=np.cumsum(begins) - 1,
    )


def stencil_of(boundary: Boundary, pieces: Pieces, point: Indices) -> Stencil:
    """Stencil of joint points; `point` is that of every place, shape (pieces, places)."""
    from scipy.sparse import coo_matrix

    stretches = pieces.stretches
    of = pieces.of_stretch
    count = boundary.nodes.shape[1]
    slave = pieces.length[:, None] * SHARES[count]
    slave = slave[:, :, None] * lagrange(pieces.places, count)
    # Integrals of psi_j N_i over every stretch, N_i of the other side, m, shape (stretches, points
    # of a piece, nodes of a facet).
    span = stretches.span
    bounds = pieces.span[of]
    length = pieces.length[of]
    local = (span[0] - bounds[:, :1]) / (bounds[:, 1:] - bounds[:, :1])
    # One facet opposite: N_i are combinations of N_j, with their values at the points.
    other = span[1, :, :1] + (span[1, :, 1:] - span[1, :, :1]) * NODES[count]
    integrals = length[:, None, None] * SHARES[count][:, None] * lagrange(other, count)
    several = np.bincount(of, minlength=len(pieces.length))[of] > 1
    local = local[several]
    span = span[1, several]
    gauss, weight = np.polynomial.legendre.leggauss(3)
    gauss = 0.5 * (1.0 + gauss)
    weight = 0.5 * weight
    here, there = (ends[:, :1] + (ends[:, 1:] - ends[:, :1]) * gauss for ends in (local, span))
    dual = SHARES[count][:, None] * np.linalg.inv(PRODUCTS[count])
    psi = lagrange(here, count) @ dual.T
    size = length[several] * (local[:, 1] - local[:, 0])
    integrals[several] = np.einsum(
        "s,g,sgj,sgi->sji", size, weight, psi, lagrange(there, count), optimize=True
    )
    values = np.concatenate([slave, integrals])
    side = np.concatenate([pieces.side, 1 - pieces.side[of]])
    rows = 2 * np.concatenate([point, point[of]]) + side[:, None]
    facets = np.concatenate([pieces.facet, stretches.facets[1]])
    keep = np.abs(values) > NOTHING * values.max(initial=0.0)
    keep[facets == GROUND] = False
    rows = np.broadcast_to(rows[:, :, None], keep.shape)[keep]
    columns = np.broadcast_to(boundary.nodes[facets, None], keep.shape)[keep]
    size = 2 * (int(point.max(initial=-1)) + 1), int(boundary.nodes.max(initial=-1)) + 1
    return Stencil.of_rows(coo_matrix((values[keep], (rows, columns)), size).tocsr())
