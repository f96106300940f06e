"""Inverse of small matrices that are sums of weighted squares, without subtraction.

    M = sum_k w_k l_k r_k^T,   M^-1 = adj M / det M,   det M = sum_J w_J det L_J det R_J,

J all choices of m vectors (Cauchy-Binet), and adj M likewise by choices of m - 1 of them, whose
generalised cross products c_J have c_J . v = det [v_J, v]. The weights of an interior point method
range over many powers of ten: elimination cancels digits that this sum keeps.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np

from fenics_contact.faces.cones import Array


class Springs:
    """M^-1 for left and right vectors, shape (units, k, m), m = 2 or 3, and any weights."""

    def __init__(self, left: Array, right: Array) -> None:
        choices, bases, last = _choices(right.shape[1], right.shape[2])
        self._choices = choices
        self._bases = bases
        self._last = last
        self._right = cross_products(right, choices)
        same = left is right
        self._left = self._right if same else cross_products(left, choices)
        volume = np.einsum("ujm,ujm->uj", self._right[:, bases], right[:, last])
        other = volume
        if not same:
            other = np.einsum("ujm,ujm->uj", self._left[:, bases], left[:, last])
        self._volumes = volume * other

    def inverse(self, weights: Array) -> Array:
        """M^-1, shape (units, m, m), with weights of shape (units, k)."""
        chosen = np.prod(weights[:, self._choices], axis=2)
        determinant = np.einsum(
            "uj,uj->u", chosen[:, self._bases] * weights[:, self._last], self._volumes
        )
        scaled = self._right * (chosen / determinant[:, None])[:, :, None]
        return np.asarray(np.matmul(scaled.transpose(0, 2, 1), self._left))


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
    return np.cross(vectors[:, choices[:, 0]], vectors[:, choices[:, 1]])
