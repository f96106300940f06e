"""Contact laws with all products equal to mu: smooth functions of one number per point and side.

With forces and displacements in typical units, opening y and slip w = z2 - z1, every p and q
belong to one state of a joint point:

    p = r_N - y   with   r_N y = mu,
    q = r_T - w   with   s1 z1 = s2 z2 = mu,   s1, s2 = g -+ r_T,   g = F r_N + given strength

(B. Chen, P.T. Harker, SIAM J. Matrix Anal. Appl. 14 (1993) 1168; C. Kanzow, SIAM J. Matrix Anal.
Appl. 17 (1996) 851). As mu falls to zero they become Signorini's and Coulomb's laws.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fenics_contact.solvers.problem import Array


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


@dataclass(frozen=True)
class SmoothedLaws:
    """Laws of some joint points.

    Attributes:
        friction: Coulomb's coefficient F.
        strength: Given bound on the shear force, in typical units.
        frictional: Points that transmit shear; the others slide freely.
        smallest: Size of p and q by which changes are measured, at least.
    """

    friction: Array
    strength: Array
    frictional: npt.NDArray[np.bool_]
    smallest: float

    @property
    def carried(self) -> Array:
        """1 where there is a force, normal or shear, 0 where there is none, shape (2, points)."""
        return np.array([np.ones(len(self.frictional)), self.frictional])

    def states(self, p: Array, q: Array, mu: float) -> JointStates:
        """States that belong to p and q."""
        y, r = normal_law(p, mu)
        gamma = self._bound(r)
        near = distance_from_bound(np.abs(q), gamma, mu)
        shear = np.where(self.frictional, np.copysign(gamma - near, q), 0.0)
        return JointStates(np.array([y, r, shear - q, shear]))

    def sizes(self, states: JointStates) -> Array:
        """Sizes of p and q of states, shape (2, points)."""
        y, r, w, _ = states.values
        return np.maximum(np.array([r + y, self._bound(r) + np.abs(w)]), self.smallest)

    def distances(self, states: JointStates, mu: float) -> Array:
        """Distances of any states from the states with equal p and q, relative to p and q.

        The larger of the differences of openings and of slips, to six digits, shape (points,).
        """
        opening, _, slip, _ = states.values
        y, r = normal_law(states.p, mu)
        q = states.q
        gamma = self._bound(r)
        near = distance_from_bound(np.abs(q), gamma, mu, newton_steps=4)
        w = np.copysign(gamma - near, q) - q
        of_p = np.abs(y - opening) / np.maximum(r + y, self.smallest)
        of_q = np.abs(w - slip) / np.maximum(gamma + np.abs(w), self.smallest)
        return np.asarray(np.maximum(of_p, np.where(self.frictional, of_q, 0.0)))

    def linearized(self, p: Array, q: Array, mu: float) -> tuple[JointStates, Array]:
        """States that belong to p and q, to six digits, and their derivatives.

        These are by p, q and log mu, shape (3, 4, points).
        """
        none = np.zeros_like(p)
        y, r = normal_law(p, mu)
        root = y + r
        gamma = self._bound(r)
        r_p = r / root
        y_p = -y / root
        r_mu = mu / root
        # F(s, gamma, mu) = s - mu/s + mu/(2 gamma - s) - gamma + |q| = 0 is s(p, q, mu).
        near = distance_from_bound(np.abs(q), gamma, mu, newton_steps=4)
        far = 2.0 * gamma - near
        of_near = mu / near
        of_far = mu / far
        by_s = 1.0 + of_near / near + of_far / far
        by_gamma = -1.0 - 2.0 * of_far / far
        side = np.where(self.frictional, np.copysign(1.0, q), 0.0)
        shear = side * (gamma - near)
        shear_r = side * (1.0 + by_gamma / by_s) * self.friction
        shear_p = shear_r * r_p
        shear_q = np.where(self.frictional, 1.0 / by_s, 0.0)
        shear_mu = shear_r * r_mu + side * (of_far - of_near) / by_s
        by_p = np.array([y_p, r_p, shear_p, shear_p])
        by_q = np.array([none, none, shear_q - 1.0, shear_q])
        by_mu = np.array([r_mu, r_mu, shear_mu, shear_mu])
        states = JointStates(np.array([y, r, shear - q, shear]))
        return states, np.array([by_p, by_q, by_mu])

    def _bound(self, pressure: Array) -> Array:
        """Bound g; 1 where there is none."""
        return np.where(self.frictional, self.friction * pressure + self.strength, 1.0)


def normal_law(p: Array, mu: float) -> tuple[Array, Array]:
    """Opening and normal force with product mu and difference p: (sqrt(p^2 + 4 mu) -+ p) / 2."""
    large = 0.5 * (np.sqrt(p**2 + 4.0 * mu) + np.abs(p))
    small = mu / large
    return np.where(p > 0.0, small, large), np.where(p > 0.0, large, small)


def distance_from_bound(q: Array, gamma: Array, mu: float, newton_steps: int = 6) -> Array:
    """Distance s of the shear force from the bound that it is nearer to.

    Solves s - mu/s + mu/(2 gamma - s) = gamma - q for 0 < s <= gamma, with |q| as `q` and the bound
    gamma above 0. Six Newton steps leave nothing but rounding, four 1e-6 of s.
    """
    # Without the third term s is larger, and the first step goes too far: the left-hand side is
    # concave. From there Newton's method climbs to the solution and never passes it.
    rest = gamma - q
    large = 0.5 * (np.sqrt(rest**2 + 4.0 * mu) + np.abs(rest))
    s = np.minimum(np.where(rest > 0.0, large, mu / large), gamma)
    for _ in range(newton_steps):
        other = 2.0 * gamma - s
        near = mu / s
        far = mu / other
        s = s - (s - near + far - rest) / (1.0 + near / s + far / other)
    return np.asarray(np.minimum(s, gamma))
