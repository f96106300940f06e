"""Inverses of sums of weighted squares: by numpy, and in fractions where digits cancel."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from fenics_contact.faces.system import Springs

SHAPES = [(2, 2), (2, 5), (3, 3), (3, 7)]  # m, vectors


def exact_inverse(vectors: np.ndarray, weights: np.ndarray) -> list[list[Fraction]]:
    """By cofactors, in fractions."""
    m = vectors.shape[1]
    rows = [[Fraction(x) for x in row] for row in vectors.tolist()]
    given = [Fraction(w) for w in weights.tolist()]
    terms = list(zip(given, rows, strict=True))
    matrix = [[sum(w * r[i] * r[j] for w, r in terms) for j in range(m)] for i in range(m)]
    whole = determinant(matrix)
    return [
        [Fraction((-1) ** (i + j)) * determinant(minor(matrix, j, i)) / whole for j in range(m)]
        for i in range(m)
    ]


def minor(matrix: list[list[Fraction]], row: int, column: int) -> list[list[Fraction]]:
    kept = [one for k, one in enumerate(matrix) if k != row]
    return [[x for k, x in enumerate(one) if k != column] for one in kept]


def determinant(matrix: list[list[Fraction]]) -> Fraction:
    if not matrix:
        return Fraction(1)
    first = enumerate(matrix[0])
    return sum(
        (Fraction((-1) ** k) * x * determinant(minor(matrix, 0, k)) for k, x in first), Fraction(0)
    )


@pytest.mark.parametrize(("m", "count"), SHAPES)
def test_weights_over_thirty_powers_of_ten(m, count):
    """Every entry has most of its digits, however small it is beside the others.

    Vectors of small whole numbers: their cross products are exact.
    """
    random = np.random.default_rng(count)
    vectors = random.integers(-3, 4, (40, count, m)).astype(float)
    vectors = vectors[np.linalg.matrix_rank(vectors) == m]
    weights = 10.0 ** random.uniform(-15.0, 15.0, vectors.shape[:2])
    found = Springs(vectors, vectors).inverse(weights)
    assert len(vectors) > 20
    for k in range(len(vectors)):
        exact = exact_inverse(vectors[k], weights[k])
        largest = max(abs(x) for row in exact for x in row)
        for i in range(m):
            assert found[k, i, i] == pytest.approx(float(exact[i][i]), rel=1e-12)
            for j in range(m):
                error = abs(Fraction(found[k, i, j]) - exact[i][j])
                assert error <= Fraction(1e-12) * largest
