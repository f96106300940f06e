"""Weighted means of nodes: how a joint point, or the end of a tie, moves with the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array, Indices

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

    def followed_by(self, other: Stencil) -> Stencil:
        """These points and then others."""
        width = max(self.nodes.shape[2], other.nodes.shape[2])
        padding = [((0, 0), (0, 0), (0, width - one.nodes.shape[2])) for one in (self, other)]
        nodes = [
            np.pad(one.nodes, pad, constant_values=NO_NODE)
            for one, pad in zip((self, other), padding, strict=True)
        ]
        weights = [
            np.pad(one.weights, pad) for one, pad in zip((self, other), padding, strict=True)
        ]
        return Stencil(np.concatenate(nodes), np.concatenate(weights))

    @property
    def rows(self) -> Any:
        """The weights as such a matrix, as wide as the last node needs."""
        from scipy.sparse import coo_matrix

        row, column = np.nonzero(self.nodes.reshape(-1, self.nodes.shape[2]) != NO_NODE)
        flat = self.nodes.reshape(-1, self.nodes.shape[2])[row, column]
        weights = self.weights.reshape(-1, self.nodes.shape[2])[row, column]
        size = 2 * len(self.nodes), int(self.nodes.max(initial=0)) + 1
        return coo_matrix((weights, (row, flat)), size).tocsr()

    def jump(self, values: Array) -> Array:
        """Vectors of the second side minus those of the first, shape (points, 2), from nodes'."""
        means = self.means(values)
        return np.asarray(means[:, 1] - means[:, 0])

    def means(self, values: Array) -> Array:
        """Weighted sums of nodes' vectors on both sides, shape (points, 2 sides, 2)."""
        padded = np.vstack([values, np.zeros((1, 2))])  # the last for none
        return np.asarray(np.einsum("nsi,nsik->nsk", self.weights, padded[self.nodes]))
