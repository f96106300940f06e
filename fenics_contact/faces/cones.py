r"""Cones of the forces at joint faces, in the scaling of Nesterov and Todd.

A slack s and its multiplier z are in the same self-dual cone and complementary, s o z = 0, where o
is the cone's Jordan product. On the central path s o z = mu e. With the scaling W, W z = W^-1 s =
l, a Newton step of these conditions is

    dz = V - W^-2 ds,    V = W^-1 (l \ r),    r the change of the product wished for

(Y.E. Nesterov, M.J. Todd, SIAM J. Optim. 8 (1998) 324). W^-2 is given as a sum of squares, weights
times vectors, from which `springs` inverts without differences of nearly equal numbers.

All arrays have a unit (a face, or a point of one) as their first axis: slacks have the shape
(units, r).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.solvers.compiled import call, is_there

Array = npt.NDArray[np.float64]

#: Smallest number that a determinant is divided by.
TINY = 1e-300


class ScaledPositive:
    """A pair s, z > 0 in its scaling: W^-2 = z / s.

    Attributes:
        weights: Of the squares of W^-2, shape (units, k).
        frame: Their vectors, shape (units, k, r); None where these are the unit vectors.
        products: l o l, shape (units, r).
    """

    frame: Array | None = None

    def __init__(self, slack: Array, dual: Array) -> None:
        self._slack = slack
        self._dual = dual
        self.weights = dual / slack
        self.products = slack * dual

    def shift(self, change: Array) -> Array:
        """V for a change of the products."""
        return np.asarray(change / self._slack)

    def cross(self, ds: Array, dz: Array) -> Array:
        """(W^-1 ds) o (W dz), the second-order part of the products after a step."""
        return ds * dz

    def linear(self, ds: Array, dz: Array) -> Array:
        """L o (W^-1 ds + W dz), the first-order part."""
        return self._slack * dz + self._dual * ds

    def stretch(self, ds: Array) -> Array:
        """W^-2 ds."""
        return self.weights * ds


class Positive:
    """The orthant: every component is positive. A self-dual cone in R^r, once for every unit."""

    def degree(self, slack: Array) -> int:
        """Number of products that tend to zero: one for every component."""
        return slack.size

    def identity(self, slack: Array) -> Array:
        """Unit e, with products of 1 each."""
        return np.ones_like(slack)

    def scaled(self, slack: Array, dual: Array) -> ScaledPositive:
        """A pair in its scaling."""
        return ScaledPositive(slack, dual)

    def longest(self, place: Array, step: Array) -> float:
        """The longest step that stays in the cone, infinite where all do."""
        ratio = float(np.min(step / place, initial=0.0))
        return -1.0 / ratio if ratio < 0.0 else np.inf

    def margin(self, slack: Array) -> Array:
        """Least eigenvalue of every unit's slack, positive inside the cone."""
        return np.asarray(slack.min(axis=1, initial=np.inf))

    def raised(self, slack: Array, dual: Array, mu: float) -> Array:
        """A multiplier with products of mu or more."""
        return np.maximum(dual, mu / np.maximum(slack, TINY))

    def pushed(self, products: Array, least: float, most: float) -> Array:
        """What brings eigenvalues of products into a range, from above by at most `most`."""
        down = np.maximum(most - products, -most)
        return np.where(products < least, least - products, np.where(products > most, down, 0.0))


class ScaledDisc:
    """A pair s_0 > |s_1|, z_0 > |z_1| in its scaling."""

    def __init__(self, slack: Array, dual: Array) -> None:
        size, other = np.sqrt(_determinant(slack)), np.sqrt(_determinant(dual))
        unit, mirrored = slack / size[:, None], _mirrored(dual) / other[:, None]
        sharp = np.sqrt(0.5 * (1.0 + _dots(unit, _mirrored(mirrored))))
        point = (unit + mirrored) / (2.0 * sharp[:, None])
        self._eta = np.sqrt(size / other)
        self._first = point[:, :1]
        self._rest = point[:, 1:]
        self._value = self._apply(dual, 1.0)
        self.products = _product(self._value, self._value)
        self.weights, self.frame = self._squares()

    def _apply(self, v: Array, sign: float) -> Array:
        """W v, or W^-1 v for the sign -1."""
        along = _dots(self._rest, v[:, 1:])[:, None]
        applied = np.empty_like(v)
        applied[:, :1] = self._first * v[:, :1] + sign * along
        applied[:, 1:] = v[:, 1:] + (along / (1.0 + self._first) + sign * v[:, :1]) * self._rest
        applied *= (self._eta**sign)[:, None]
        return applied

    def _squares(self) -> tuple[Array, Array]:
        """W^-2 = eta^-2 (2 (J w)(J w)^T - J) by its eigenvectors."""
        size = _lengths(self._rest)[:, None]
        along = np.zeros_like(self._rest)
        along[:, 0] = 1.0  # any direction where there is none
        np.divide(self._rest, size, out=along, where=size > 0.0)
        large = (self._first + size) ** 2
        weights = np.hstack([large, 1.0 / large, np.ones_like(large)]) / self._eta[:, None] ** 2
        frame = np.zeros((len(along), 3, 3))
        frame[:, :2, 0] = np.sqrt(0.5)
        frame[:, 0, 1:] = -np.sqrt(0.5) * along
        frame[:, 1, 1:] = np.sqrt(0.5) * along
        frame[:, 2, 1] = -along[:, 1]
        frame[:, 2, 2] = along[:, 0]
        return weights, frame

    def shift(self, change: Array) -> Array:
        """As of the orthant."""
        value = self._value
        first = _dots(_mirrored(value), change) / _determinant(value)
        rest = (change[:, 1:] - first[:, None] * value[:, 1:]) / value[:, :1]
        return self._apply(np.column_stack([first, rest]), -1.0)

    def cross(self, ds: Array, dz: Array) -> Array:
        """As of the orthant."""
        return np.asarray(_product(self._apply(ds, -1.0), self._apply(dz, 1.0)))

    def linear(self, ds: Array, dz: Array) -> Array:
        """As of the orthant."""
        both = self._apply(ds, -1.0) + self._apply(dz, 1.0)
        return np.asarray(_product(self._value, both))

    def stretch(self, ds: Array) -> Array:
        """As of the orthant."""
        return self._apply(self._apply(ds, -1.0), -1.0)


class CompiledDisc:
    """The same, compiled: its arrays would pass through memory some hundred times in a step."""

    def __init__(self, slack: Array, dual: Array) -> None:
        count = len(slack)
        self._scaling = np.empty((count, 4))
        self._value = np.empty((count, 3))
        self.weights = np.empty((count, 3))
        self.frame = np.empty((count, 3, 3))
        found = self._scaling, self._value, self.weights, self.frame
        call("disc_scaled", count, slack, dual, *found)
        self.products = _product(self._value, self._value)

    def shift(self, change: Array) -> Array:
        """As of the orthant."""
        return self._asked("disc_shift", self._scaling, self._value, change)

    def cross(self, ds: Array, dz: Array) -> Array:
        """As of the orthant."""
        return self._asked("disc_products", 0, self._scaling, self._value, ds, dz)

    def linear(self, ds: Array, dz: Array) -> Array:
        """As of the orthant."""
        return self._asked("disc_products", 1, self._scaling, self._value, ds, dz)

    def stretch(self, ds: Array) -> Array:
        """As of the orthant."""
        return self._asked("disc_stretch", self._scaling, ds)

    def _asked(self, name: str, *arguments: Any) -> Array:
        found = np.empty_like(self._value)
        call(name, len(found), *arguments, found)
        return found


class Disc:
    """The second-order cone: the first component is larger than the length of two others."""

    def degree(self, slack: Array) -> int:
        """Two for every unit: the eigenvalues."""
        return 2 * len(slack)

    def identity(self, slack: Array) -> Array:
        """Twice the unit of the Jordan product."""
        unit = np.zeros_like(slack)
        unit[:, 0] = 2.0
        return unit

    def scaled(self, slack: Array, dual: Array) -> ScaledDisc | CompiledDisc:
        """As of the orthant."""
        return CompiledDisc(slack, dual) if is_there() else ScaledDisc(slack, dual)

    def longest(self, place: Array, step: Array) -> float:
        """As of the orthant."""
        if is_there():
            found = np.empty(1)
            call("disc_longest", len(place), place, step, found)
            return float(found[0])
        square = step[:, 0] ** 2 - _dots(step[:, 1:], step[:, 1:])
        half = place[:, 0] * step[:, 0] - _dots(place[:, 1:], step[:, 1:])
        inside = _determinant(place)
        root = half**2 - square * inside
        nearest = np.sqrt(np.maximum(root, 0.0)) - half
        leaves = (nearest > 0.0) & (root >= 0.0)
        with np.errstate(divide="ignore"):
            length = np.where(leaves, inside / nearest, np.inf)
            apex = np.where(step[:, 0] < 0.0, -place[:, 0] / step[:, 0], np.inf)
        return float(np.minimum(length, apex).min(initial=np.inf))

    def margin(self, slack: Array) -> Array:
        """The least eigenvalue."""
        return np.asarray(slack[:, 0] - _lengths(slack[:, 1:]))

    def raised(self, slack: Array, dual: Array, mu: float) -> Array:
        """As of the orthant."""
        short = self.margin(_product(slack, dual)) < 2.0 * mu
        inverse = 2.0 * mu * _mirrored(slack) / _determinant(slack)[:, None]
        return np.where(short[:, None], dual + inverse, dual)

    def pushed(self, products: Array, least: float, most: float) -> Array:
        """By the eigenvalues of the products."""
        size = _lengths(products[:, 1:])[:, None]
        along = np.divide(products[:, 1:], size, out=np.zeros_like(products[:, 1:]), where=size > 0)
        both = 0.5 * np.hstack([products[:, :1] + size, products[:, :1] - size])
        both = Positive().pushed(both, least, most)
        return np.hstack([both.sum(axis=1, keepdims=True), (both[:, :1] - both[:, 1:]) * along])


Cone = Positive | Disc


def times(matrices: Array, vectors: Array) -> Array:
    """Products M v of small matrices and vectors, one of each for every unit."""
    if not is_there():
        return np.asarray(np.matmul(matrices, vectors[:, :, None])[:, :, 0])
    units, rows, columns = matrices.shape
    found = np.empty((units, rows))
    call("unit_products", units, rows, columns, 0, matrices, vectors, found)
    return found


def transposed_times(matrices: Array, vectors: Array) -> Array:
    """Products M^T v of small matrices and vectors, one of each for every unit."""
    if not is_there():
        return np.asarray(np.matmul(vectors[:, None, :], matrices)[:, 0])
    units, rows, columns = matrices.shape
    found = np.empty((units, columns))
    call("unit_products", units, rows, columns, 1, matrices, vectors, found)
    return found


def _dots(v: Array, w: Array) -> Array:
    """Products of vectors, one for every unit."""
    return np.asarray(np.einsum("ui,ui->u", v, w))


def _lengths(v: Array) -> Array:
    return np.sqrt(_dots(v, v))


def _determinant(v: Array) -> Array:
    size = _lengths(v[:, 1:])
    return np.maximum((v[:, 0] - size) * (v[:, 0] + size), TINY)


def _mirrored(v: Array) -> Array:
    mirrored = -v
    mirrored[:, 0] = v[:, 0]
    return mirrored


def _product(v: Array, w: Array) -> Any:
    product = v[:, :1] * w + w[:, :1] * v
    product[:, 0] = _dots(v, w)
    return product
