"""The central path of a state under work control, followed past its folds.

With Coulomb friction the solutions of the path's equations (`path_equations`) for falling products
mu are a curve that may turn back: mu has to rise for a while before it can fall to zero. An
interior point method, which only lowers mu, stalls there. The curve itself goes on, so it is
followed by its length, with mu as one unknown more (H.B. Keller, in Applications of Bifurcation
Theory (1977) 359; E.L. Allgower, K. Georg, Numerical Continuation Methods (1990)).

The unknowns are those in which all products equal mu whatever the step, so that no step ends at a
boundary (B. Chen, P.T. Harker, SIAM J. Matrix Anal. Appl. 14 (1993) 1168; C. Kanzow, SIAM J.
Matrix Anal. Appl. 17 (1996) 851): with typical force f and displacement d

    p = r_N/f - y/d,   q = r_T/f - (z2 - z1)/d,   of which r_N, y, r_T, z1, z2 follow.

One factor of the springs gives Newton's step c to the path at this mu and the tangent
t = dx/dlog mu. A step goes along the tangent, and towards the path at right angles to it,

    dx = c + a t + ds t,   a = -(t.c)/(t.t),

(products of the relative changes of p and q at all points, with log mu counted once per point), mu
falling where the determinant of the equations is positive, and rising where it is not. Friction may
grow along the path, as a function of mu.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.path_equations import (
    LARGEST_SPRING,
    PROXIMAL_SPRING,
    Array,
    Iterate,
    PathEquations,
    Residual,
    State,
)

_log = logging.getLogger("fenics_contact")

MAX_STEPS = 250

#: Steps are measured by the largest relative change of p and q. Length of the first and of the
#: shortest and longest step, and by how much the length grows after one that was not shortened.
FIRST_LENGTH, LENGTHS, GROWTH = 1.0, (0.2, 100.0), 2.5

#: Size of p and q by which changes are measured, at least: smaller ones are of no consequence.
SMALLEST = 1e-3

#: A step is shortened, at most so often, where it leaves more than this of p or q, relative, and
#: more than so much of what was left before.
LEFT, REDUCED, SHORTER = 0.7, 0.7, 6

#: No step is taken along the tangent where more than this is left; largest corrector.
FAR, LARGEST_CORRECTOR = 2.0, 4.0

#: At the end no more than this is left, or so many steps were taken across the path alone.
CLOSE, CORRECTIONS = 0.1, 6

#: Largest change of log mu in a step.
LARGEST_CHANGE = 3.0

#: Products to which the path may lead back, in units of force times displacement.
BACK = 1e2


@dataclass(frozen=True)
class _Rate:
    """Relative rates of p and q at this rank's points along a direction."""

    p: Array
    q: Array


class CentralPath(PathEquations):
    """Steps along the central path of the equations of one solve under work control.

    Attributes:
        smallest: Size of p and q by which changes are measured, at least.
    """

    smallest = SMALLEST

    def follow(self, now: Iterate, products: float, end: float) -> tuple[Iterate, float]:
        """Follow the path until the products are small.

        Args:
            now: Iterate with equal products, near the path; not to be used any more.
            products: mu there, in units of force times displacement.
            end: mu at which to stop.

        Returns:
            An iterate near the path, and mu, which is larger than `end` after `MAX_STEPS` steps.

        Raises:
            SolverError: If the path leads back, or is lost.
        """
        length, left, since = FIRST_LENGTH, self._left(now), 0
        for step in range(MAX_STEPS):
            there = products <= end
            if there and (left <= CLOSE or since == CORRECTIONS):
                return now, products
            since += there
            if not products <= BACK:
                now.destroy()
                raise SolverError(f"central path: leads back after {step} steps")
            try:
                to_path, tangent, sign = self._directions(now, products)
            except SolverError:
                now.destroy()
                raise
            rate, change = self._rate(now, tangent), self._rate(now, to_path)
            steepness = max(self._largest(rate), 1.0)
            square = self.problem.sum(rate.p**2 + rate.q**2 + 1.0)
            back = -self.problem.sum(rate.p * change.p + rate.q * change.q) / square
            across = self._largest(_Rate(change.p + back * rate.p, change.q + back * rate.q))
            part = min(1.0, LARGEST_CORRECTOR / across) if across > 0.0 else 1.0
            for shortened in range(SHORTER + 1):
                ahead = sign * length / steepness if left < FAR and not there else 0.0
                turn = float(np.clip(part * back + ahead, -LARGEST_CHANGE, LARGEST_CHANGE))
                new, new_products = self._moved(now, products, part, to_path, turn, tangent)
                new_left = self._left(new)
                if new_left < max(LEFT, REDUCED * left) or ahead == 0.0 or shortened == SHORTER:
                    break
                new.destroy()
                length *= 0.5
            for iterate in (now, to_path, tangent):
                iterate.destroy()
            if not np.isfinite(new_left):
                new.destroy()
                raise SolverError(f"central path: lost after {step + 1} steps")
            now, products, left = new, new_products, new_left
            length = max(length * (GROWTH if shortened == 0 else 1.0), LENGTHS[0])
            length = min(length, LENGTHS[1])
            _log.debug("    %3d  %.12g  mu %.2e, left %.1e", step, now.load_factor, products, left)
        return now, products

    def _grown(self, products: float) -> float:
        """Set the friction that is there at some products; its rate."""
        if self.growth is None:
            return 0.0
        self.mobilise(self.growth.part(products))
        return self.growth.rate(products)

    def _directions(self, now: Iterate, products: float) -> tuple[Iterate, Iterate, float]:
        """Both c and t, and the sign of dmu/ds, on one factor."""
        rate = self._grown(products)
        springs = self.factor(now, LARGEST_SPRING * self.springs.mean_diagonal, PROXIMAL_SPRING)
        mu = np.full_like(now.y, products * self.unit)
        more = rate * self.friction * now.pressure  # of the bound: of s1 and s2
        none = np.zeros_like(now.y)
        across = self.residual(now), (none, none, none)
        along = (
            Residual(self.workspace.zero, none, none, 0.0),
            (mu, mu - now.z1 * more, mu - now.z2 * more),
        )
        to_path, tangent = self.directions(now, springs, [across, along], first=True)
        # The determinant of A bordered by f_L is that of A times -f_L.A^-1 f_L.
        flexibility = self.problem.live.dot(self.workspace.border)
        return to_path, tangent, -self.springs.determinant_sign * float(np.sign(flexibility))

    def _rate(self, now: Iterate, direction: Iterate) -> _Rate:
        """Changes of p and q relative to the forces and displacements that they are made of."""
        d, f = self.scales.displacement, self.scales.force
        p = direction.pressure / f - direction.y / d
        q = direction.shear / f - (direction.z2 - direction.z1) / d
        size_p, size_q = self._sizes(now)
        return _Rate(p / size_p, np.where(self.sticky, q / size_q, 0.0))

    def _sizes(self, now: Iterate) -> tuple[Array, Array]:
        d, f = self.scales.displacement, self.scales.force
        size_q = 0.5 * (now.s1 + now.s2) / f + np.abs(now.z2 - now.z1) / d
        return np.maximum(now.pressure / f + now.y / d, self.smallest), np.maximum(
            size_q, self.smallest
        )

    def _largest(self, rate: _Rate) -> float:
        return self.problem.max(np.maximum(np.abs(rate.p), np.abs(rate.q)))

    def _left(self, now: Iterate) -> float:
        """Largest distance from the path, relative to p and q."""
        residual = self.residual(now)
        size_p, size_q = self._sizes(now)
        slip = np.where(self.sticky, residual.slip / size_q, 0.0)
        return self._largest(_Rate(residual.opening / size_p, slip)) / self.scales.displacement

    def _moved(
        self,
        now: Iterate,
        products: float,
        part: float,
        to_path: Iterate,
        turn: float,
        tangent: Iterate,
    ) -> tuple[Iterate, float]:
        """The point with equal products at now + part c + turn t, and its mu."""
        moved = now.copy()
        moved.move(part, to_path)
        moved.move(turn, tangent)
        products *= float(np.exp(turn))
        state = State(moved.u, moved.load_factor, moved.pressure, moved.shear, self.work)
        self._grown(products)
        new = self.centred(state, products, moved.strained)
        moved.u.destroy()
        return new, products
