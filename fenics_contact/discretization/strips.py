"""Parts of facets, and the nodal forces of what acts on them.

With the Lagrange functions N_k of a facet of length L,

    f_k = L int_a^b N_k(s) t(x(s)) ds,   0 <= a < b <= 1,

by Gauss' rule with three points, exact for tractions t that are linear in x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.mortar import lagrange
from fenics_contact.geometry.mesh import Array, Flags, Indices


@dataclass(frozen=True)
class Strips:
    """Parts of facets.

    Attributes:
        facets: Rows of the boundary, shape (strips,).
        start: Where the part begins on the facet, 0 to 1, shape (strips,).
        end: Where it ends.
    """

    facets: Indices
    start: Array
    end: Array

    def take(self, rows: Indices | Flags) -> Strips:
        """Some of them."""
        return Strips(self.facets[rows], self.start[rows], self.end[rows])

    def length(self, boundary: Boundary) -> Array:
        """m, shape (strips,)."""
        return np.asarray(boundary.length[self.facets] * (self.end - self.start))

    def forces(self, boundary: Boundary, traction: Any) -> Array:
        """Forces on the nodes of the facets, N/m, shape (strips, nodes of a facet, 2).

        `traction` gives forces per area, shape (..., 2), at positions of shape (..., 2).
        """
        abscissa, weight = np.polynomial.legendre.leggauss(3)
        s = self.start[:, None] + np.outer(self.end - self.start, 0.5 * (1.0 + abscissa))
        first, second = boundary.points[self.facets, :2].swapaxes(0, 1)
        position = first[:, None] + s[:, :, None] * (second - first)[:, None]
        values = lagrange(s, boundary.nodes.shape[1])
        length = 0.5 * self.length(boundary)
        return np.einsum("f,g,fgk,fgd->fkd", length, weight, values, traction(position))

    def cut(self, boundary: Boundary, up: Array, levels: Array) -> Strips:
        """Strips that end where they cross levels of the height up . x, m."""
        first, second = (boundary.points[self.facets, :2] @ up).T
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = (levels - first[:, None]) / (second - first)[:, None]
        crossing = np.clip(np.nan_to_num(crossing), self.start[:, None], self.end[:, None])
        ends = np.sort(np.hstack([self.start[:, None], crossing, self.end[:, None]]), axis=1)
        row, number = np.nonzero(np.diff(ends, axis=1) > 0.0)
        return Strips(self.facets[row], ends[row, number], ends[row, number + 1])
