"""The matrices A = H^T M^-1 H + S of one model: a fixed pattern, ordered once, factored for each M.

H has rows of a few motions for every unit, so that A is a sum of small dense matrices. M^-1, of
the units' springs, is got without subtraction: M is a sum of weighted squares,

    M = sum_k w_k l_k r_k^T,   M^-1 = adj M / det M,   det M = sum_J w_J det L_J det R_J,

J all choices of m vectors (Cauchy-Binet), and adj M likewise by choices of m - 1 of them, whose
generalised cross products c_J have c_J . v = det [v_J, v]. The weights of an interior point method
range over many powers of ten: elimination cancels digits that this sum keeps.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from itertools import combinations
from typing import Any

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.cones import Array
from fenics_contact.faces.model import FaceModel
from fenics_contact.solvers import compiled

#: Added to the diagonal of the scaled matrix, in steps only: residuals are recomputed.
SHIFT = 1e-13
#: Steps of iterative refinement.
REFINED = 2
#: SuperLU's ordering for symmetric patterns.
ORDERING = "MMD_AT_PLUS_A"


class ScaledFactor:
    """A factor of A."""

    def __init__(self, factor: Any, matrix: Any, scale: Array, order: Any) -> None:
        """Take SuperLU's factor of the scaled matrix, the matrix, scale, and order."""
        self._factor = factor
        self._matrix = matrix
        self._scale = scale
        self._order = order
        self._back = np.argsort(order)

    def __call__(self, right: Array) -> Array:
        """Solve A x = b, refined; b of shape (motions,) or (motions, k)."""
        scaled_right = (right[self._back].T * self._scale).T
        x = self._factor.solve(scaled_right)
        for _ in range(REFINED):
            x += self._factor.solve(scaled_right - self._matrix @ x)
        return np.asarray((x.T * self._scale).T[self._order])

    @property
    def sign(self) -> float:
        """Of det A: -1.0 or 1.0."""
        factor = self._factor
        negative = int(np.count_nonzero(factor.U.diagonal() < 0.0))
        if not np.array_equal(factor.perm_r, factor.perm_c):
            negative += _transpositions(factor.perm_r) + _transpositions(factor.perm_c)
        return -1.0 if negative % 2 else 1.0


def _transpositions(permutation: Any) -> int:
    """How many make a permutation: its length less its number of cycles."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(permutation)
    links = csr_matrix((np.ones(count), (np.arange(count), permutation)), (count, count))
    return count - int(connected_components(links, directed=False)[0])


class Springs:
    """M^-1 for left and right vectors, shape (units, k, m), m = 2 or 3, and any weights."""

    def __init__(self, left: Array, right: Array) -> None:
        self._right = np.ascontiguousarray(right)
        self._left = self._right if left is right else np.ascontiguousarray(left)

    def inverse(self, weights: Array) -> Array:
        """M^-1, shape (units, m, m), with weights of shape (units, k)."""
        if not compiled.is_there():
            return self._inverse(weights)
        units, count, size = self._right.shape
        found = np.empty((units, size, size))
        compiled.call("unit_springs", units, size, count, self._left, self._right, weights, found)
        return found

    def _inverse(self, weights: Array) -> Array:
        """The same by numpy."""
        choices, bases, last = self._choices
        right, left, volumes = self._crossed
        chosen = np.prod(weights[:, choices], axis=2)
        determinant = np.einsum("uj,uj->u", chosen[:, bases] * weights[:, last], volumes)
        scaled = right * (chosen / determinant[:, None])[:, :, None]
        return np.asarray(np.matmul(scaled.transpose(0, 2, 1), left))

    @cached_property
    def _choices(self) -> tuple[Any, Any, Any]:
        return _choices(self._right.shape[1], self._right.shape[2])

    @cached_property
    def _crossed(self) -> tuple[Array, Array, Array]:
        """c_J of right and left vectors, and det L_J det R_J."""
        choices, bases, last = self._choices
        vectors = self._right, self._left
        right, left = (cross_products(one, choices) for one in vectors)
        pairs = zip((right, left), vectors, strict=True)
        first, second = (np.einsum("ujm,ujm->uj", c[:, bases], v[:, last]) for c, v in pairs)
        return right, left, first * second


@lru_cache(maxsize=8)
def _choices(count: int, size: int) -> tuple[Any, Any, Any]:
    """Choices of m - 1 vectors; for choices of m: that of all but the last one, and the last."""
    fewer = list(combinations(range(count), size - 1))
    place = {choice: k for k, choice in enumerate(fewer)}
    bases = list(combinations(range(count), size))
    return (
        np.array(fewer),
        np.array([place[base[:-1]] for base in bases]),
        np.array([base[-1] for base in bases]),
    )


def cross_products(vectors: Array, choices: Any) -> Array:
    """Generalised cross products of choices of vectors, shape (units, choices, m)."""
    if vectors.shape[2] == 2:
        v = vectors[:, choices[:, 0]]
        return np.stack([-v[..., 1], v[..., 0]], axis=-1)
    (x, y, z), (u, v, w) = (np.moveaxis(vectors[:, choices[:, k]], -1, 0) for k in (0, 1))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


class Equations:
    """Pattern, ordering and number of factorisations of one model, which others count, too."""

    def __init__(self, model: FaceModel, counted: Equations | None = None) -> None:
        self._counted = counted
        self.factorizations = 0
        self.response: Any = None
        units, size = model.shape
        count = model.motion.shape[1]
        table = model.motion.tocoo()
        used = table.data != 0.0
        unit, component = np.divmod(table.row[used], size)
        pairs = np.unique(np.column_stack([unit, table.col[used]]), axis=0)
        first = np.searchsorted(pairs[:, 0], np.arange(units))
        place = np.arange(len(pairs)) - first[pairs[:, 0]]
        width = int(place.max(initial=0)) + 1
        columns = np.full((units, width), -1)
        columns[pairs[:, 0], place] = pairs[:, 1]
        key = pairs[:, 0] * count + pairs[:, 1]
        place_of = place[np.searchsorted(key, unit * count + table.col[used])]
        self._local = np.zeros((units, size, width))
        self._local[unit, component, place_of] = table.data[used]
        self._set_pattern(columns, count, model.stiffness)

    def _set_pattern(self, columns: Array, count: int, stiffness: Any) -> None:
        """Where the entries of the units' matrices are in A, in SuperLU's ordering."""
        from scipy.sparse import csc_matrix, csr_matrix, identity
        from scipy.sparse.linalg import splu

        shape = (*columns.shape, columns.shape[1])
        row = np.broadcast_to(columns[:, :, None], shape)
        column = np.broadcast_to(columns[:, None, :], shape)
        used = (row >= 0) & (column >= 0)
        diagonal = np.arange(count)
        more = csr_matrix((count, count)) if stiffness is None else stiffness
        more = more.tocoo()
        rows = np.concatenate([row[used], diagonal, more.row])
        cols = np.concatenate([column[used], diagonal, more.col])
        ones = csc_matrix((np.ones(len(rows)), (rows, cols)), (count, count))
        ordered = splu(
            ones + (ones.nnz + 1.0) * identity(count, format="csc"),
            permc_spec=ORDERING,
            options={"SymmetricMode": True},
        )
        self._order = ordered.perm_c
        rows, cols = self._order[rows], self._order[cols]
        keys, place = np.unique(cols.astype(np.int64) * count + rows, return_inverse=True)
        self._place = np.full(shape, -1, dtype=np.int32)
        places, on_diagonal, of_more = np.split(place, np.cumsum([used.sum(), count]))
        self._place[used] = places
        self._diagonal = on_diagonal[np.argsort(self._order)]
        self._entries = len(keys)
        self._given = None
        if stiffness is not None:
            self._given = np.bincount(of_more, more.data, len(keys))
        self._rows = (keys % count).astype(np.int32)
        self._cols = (keys // count).astype(np.int32)
        self._start = np.searchsorted(self._cols, np.arange(count + 1)).astype(np.int32)

    def _matrix(self, inverse: Array) -> Array:
        """The entries of A."""
        local = self._local
        units, size, width = local.shape
        if not compiled.is_there():
            each = np.matmul(np.matmul(local.transpose(0, 2, 1), inverse), local)
            every = self._place.ravel() + 1
            return np.asarray(np.bincount(every, each.ravel(), self._entries + 1)[1:], float)
        entries = np.zeros(self._entries)
        compiled.call("unit_matrices", units, size, width, local, inverse, self._place, entries)
        return entries

    def factored(self, inverse: Array, pivots: float) -> ScaledFactor:
        """The factor of A; pivots are diagonal ones from a part of the column's largest entry on.

        Raises:
            SolverError: If A is singular or not finite.
        """
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import splu

        self.factorizations += 1
        if self._counted is not None:
            self._counted.factorizations += 1
        entries = self._matrix(inverse)
        if not np.all(np.isfinite(entries)):
            raise SolverError("face forces: springs are not finite")
        diagonal = entries[self._diagonal]
        if self._given is not None:  # friction of oblique joints may make it negative
            given = self._given[self._diagonal]
            entries += self._given
            diagonal = np.maximum(np.abs(diagonal + given), given)
        scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
        scaled = entries * scale[self._rows] * scale[self._cols]
        shifted = scaled.copy()
        shifted[self._diagonal] += SHIFT
        size = (len(scale), len(scale))
        matrix = csc_matrix((scaled, self._rows, self._start), size)
        try:
            factor = splu(
                csc_matrix((shifted, self._rows, self._start), size),
                permc_spec="NATURAL",
                diag_pivot_thresh=pivots,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise SolverError(f"face forces: {error}") from None

        return ScaledFactor(factor, matrix, scale, self._order)
