"""Contact laws whose products all equal mu: smooth functions of one number per point and side.

With forces and displacements in typical units, opening y and slip w = z2 - z1, every p and q
belong to one state of a joint point:

    p = r_N - y   with   r_N y = mu,
    q = r_T - w   with   s1 z1 = s2 z2 = mu,   s1, s2 = g -+ r_T,   g = F r_N + given strength

(B. Chen, P.T. Harker, SIAM J. Matrix Anal. Appl. 14 (1993) 1168; C. Kanzow, SIAM J. Matrix Anal.
Appl. 17 (1996) 851). As mu falls to zero they become Signorini's and Coulomb's laws.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Newton steps that leave nothing but rounding of a distance from the bound, or 1e-6 of it.
NEWTON_STEPS, FEWER = 6, 4


@dataclass(frozen=True)
class Growth:
    """Friction that grows to its full size as the products fall.

    Collapse states are not unique, and those met with little friction first are low ones.

    Attributes:
        full_at: Products, in units of force times displacement, from which on all of it is there.
        power: Before that it is (products / full_at)^-power of it.
    """

    full_at: float
    power: float

    def part(self, products: float) -> float:
        """Part of the friction that is there."""
        if products <= self.full_at:  # zero where a tangent leads anywhere
            return 1.0
        return (self.full_at / products) ** self.power

    def rate(self, products: float) -> float:
        """Its derivative with respect to the logarithm of the products, in units of itself."""
        return -self.power if products > self.full_at else 0.0


@dataclass(frozen=True)
class JointStates:
    """States of joint points in typical units, or changes of them.

    Attributes:
        values: Opening y, normal force r_N, slip w and shear force r_T, shape (4, points).
    """

    values: Array

    @property
    def p(self) -> Array:
        """r_N - y."""
        return np.asarray(self.values[1] - self.values[0])

    @property
    def q(self) -> Array:
        """r_T - w."""
        return np.asarray(self.values[3] - self.values[2])

    def at(self, points: npt.NDArray[np.int64]) -> JointStates:
        """Those of some points."""
        return JointStates(self.values[:, points])


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of `JointStates.values` with respect to p, q and log mu, shape (4, points)."""

    p: Array
    q: Array
    mu: Array


@dataclass(frozen=True)
class SmoothedLaws:
    """Laws of some joint points.

    Attributes:
        friction: Coulomb's coefficient F when all of it is there.
        strength: Given bound on the shear force, in typical units.
        sticky: Points that transmit shear; the others slide freely.
        smallest: Size of p and q by which changes are measured, at least.
        growth: How friction grows as the products fall; None: all of it is there.
    """

    friction: Array
    strength: Array
    sticky: npt.NDArray[np.bool_]
    smallest: float
    growth: Growth | None = None

    def at(self, points: npt.NDArray[np.int64] | slice) -> SmoothedLaws:
        """Those of some points."""
        friction, strength, sticky = (
            array[points] for array in (self.friction, self.strength, self.sticky)
        )
        return replace(self, friction=friction, strength=strength, sticky=sticky)

    def states(self, p: Array, q: Array, mu: float) -> JointStates:
        """The states that p and q belong to."""
        y, r = normal_law(p, mu)
        gamma = self._bound(r, mu)
        near = distance_from_bound(np.abs(q), gamma, mu)
        shear = np.where(self.sticky, np.copysign(gamma - near, q), 0.0)
        return JointStates(np.array([y, r, shear - q, shear]))

    def sizes(self, states: JointStates, mu: float) -> Array:
        """Sizes of p and q of such states, shape (2, points)."""
        y, r, w, _ = states.values
        of_q = self._bound(r, mu) + np.abs(w)
        return np.maximum(np.array([r + y, of_q]), self.smallest)

    def distances(self, values: Array, mu: float) -> Array:
        """Distances from the laws of other states with the same p and q, to six digits.

        Args:
            values: As those of `JointStates`.
            mu: The product.

        Returns:
            The larger of the differences of openings and slips, relative to p and q.
        """
        opening, pressure, slip, shear = values
        y, r = normal_law(pressure - opening, mu)
        q, gamma = shear - slip, self._bound(r, mu)
        near = distance_from_bound(np.abs(q), gamma, mu, FEWER)
        w = np.copysign(gamma - near, q) - q
        of_p = np.abs(y - opening) / np.maximum(r + y, self.smallest)
        of_q = np.abs(w - slip) / np.maximum(gamma + np.abs(w), self.smallest)
        return np.asarray(np.maximum(of_p, np.where(self.sticky, of_q, 0.0)))

    def linearised(self, p: Array, q: Array, mu: float) -> tuple[JointStates, Derivatives]:
        """The same states, to six digits, and their derivatives."""
        none = np.zeros_like(p)
        y, r = normal_law(p, mu)
        root = y + r
        part, rate = self._part(mu), self.growth.rate(mu) if self.growth is not None else 0.0
        gamma, gamma_r = self._bound(r, mu), part * self.friction
        r_p, y_p, r_mu = r / root, -y / root, mu / root
        # F(s, gamma, mu) = s - mu/s + mu/(2 gamma - s) - gamma + |q| = 0 is s(p, q, mu).
        near = distance_from_bound(np.abs(q), gamma, mu, FEWER)
        far = 2.0 * gamma - near
        of_near, of_far = mu / near, mu / far
        by_s = 1.0 + of_near / near + of_far / far
        by_gamma = -1.0 - 2.0 * of_far / far
        side = np.where(self.sticky, np.copysign(1.0, q), 0.0)
        shear = side * (gamma - near)
        shear_gamma_r = side * (1.0 + by_gamma / by_s) * gamma_r
        shear_p = shear_gamma_r * r_p
        shear_q = np.where(self.sticky, 1.0 / by_s, 0.0)
        shear_mu = shear_gamma_r * (r_mu + rate * r) + side * (of_far - of_near) / by_s
        rows = np.array(
            (
                *(y, r, shear - q, shear),
                *(y_p, r_p, shear_p, shear_p),
                *(none, none, shear_q - 1.0, shear_q),
                *(r_mu, r_mu, shear_mu, shear_mu),
            )
        )
        return JointStates(rows[:4]), Derivatives(rows[4:8], rows[8:12], rows[12:])

    def _part(self, mu: float) -> float:
        return 1.0 if self.growth is None else self.growth.part(mu)

    def _bound(self, pressure: Array, mu: float) -> Array:
        """Bound g; 1 where there is none."""
        bound = self._part(mu) * self.friction * pressure + self.strength
        return np.where(self.sticky, bound, 1.0)


def normal_law(p: Array, mu: float) -> tuple[Array, Array]:
    """Opening and normal force with product mu and difference p: (sqrt(p^2 + 4 mu) -+ p) / 2."""
    large = 0.5 * (np.sqrt(p**2 + 4.0 * mu) + np.abs(p))
    small = mu / large
    return np.where(p > 0.0, small, large), np.where(p > 0.0, large, small)


def distance_from_bound(q: Array, gamma: Array, mu: float, steps: int = NEWTON_STEPS) -> Array:
    """Distance s of the shear force from the bound that it is nearer to.

    Solves s - mu/s + mu/(2 gamma - s) = gamma - q for 0 < s <= gamma.

    Args:
        q: |q|.
        gamma: The bound, above 0.
        mu: The product.
        steps: Of Newton's method.
    """
    # Without the third term s is larger, and the first step goes too far: the left-hand side is
    # concave. From there Newton's method climbs to the solution and never passes it.
    rest = gamma - q
    large = 0.5 * (np.sqrt(rest**2 + 4.0 * mu) + np.abs(rest))
    s = np.minimum(np.where(rest > 0.0, large, mu / large), gamma)
    for _ in range(steps):
        other = 2.0 * gamma - s
        near, far = mu / s, mu / other
        s = s - (s - near + far - rest) / (1.0 + near / s + far / other)
    return np.asarray(np.minimum(s, gamma))
