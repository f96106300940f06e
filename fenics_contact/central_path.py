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
falling where the determinant of the equations is positive, and rising where it is not. A step that
led too far away, which only the next factor tells, is taken back: once off the path nothing leads
to it again but chance. Friction may grow along the path, as a function of mu.
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

MAX_STEPS = 1000

#: Steps are measured by the largest relative change of p and q. Length of the first, of the
#: shortest and longest.
FIRST_LENGTH, SHORTEST, LONGEST = 1.0, 0.02, 100.0

#: Size of p and q by which changes are measured, at least: smaller ones are of no consequence.
SMALLEST = 1e-3

#: A step is shortened, at most so often, where it leaves more than this of p or q, relative, and
#: more than so much of what was left before.
LEFT, REDUCED, SHORTER = 0.7, 0.7, 6

#: Distance c + a t from the path, relative, that a step aims at, and the largest at which it goes
#: along the tangent: one that led further away is taken back, and a shorter one tried.
AIMED, NEAR = 2.0, 5.0

#: By how much lengths may change, as this distance grows with their square.
CHANGES = 0.25, 2.5

#: Largest step across the path, where it is further away, and how often until it is lost.
LARGEST_CORRECTOR, LOST = 4.0, 25

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


@dataclass(frozen=True)
class _Place:
    """Where the path has led, and what a factorisation there tells.

    Attributes:
        iterate: Point with equal products.
        products: Its mu.
        to_path: The step c to the path at this mu.
        tangent: t.
        back: a, which takes the tangent out of c.
        across: Largest relative change in c + a t.
        steepness: Largest in t, at least 1.
        sign: Of the way along the tangent to smaller mu, or, past a fold, to larger.
        left: What is left of the equations, relative to p and q.
    """

    iterate: Iterate
    products: float
    to_path: Iterate
    tangent: Iterate
    back: float
    across: float
    steepness: float
    sign: float
    left: float

    @property
    def near(self) -> bool:
        """Whether the tangent is worth following from here."""
        return self.across <= NEAR

    @property
    def change_of_length(self) -> float:
        """Factor by which a step of another length would have led as near as aimed at."""
        factor = np.sqrt(AIMED / self.across) if self.across > 0.0 else np.inf
        return float(np.clip(factor, *CHANGES))

    def destroy(self) -> None:
        """Free the vectors."""
        for iterate in (self.iterate, self.to_path, self.tangent):
            iterate.destroy()


class CentralPath(PathEquations):
    """Steps along the central path of the equations of one solve under work control.

    Attributes:
        smallest: Size of p and q by which changes are measured, at least.
    """

    smallest = SMALLEST

    def follow(
        self, now: Iterate, products: float, end: float, close: float = CLOSE
    ) -> tuple[Iterate, float]:
        """Follow the path until the products are small.

        Args:
            now: Iterate with equal products, near the path; not to be used any more.
            products: mu there, in units of force times displacement.
            end: mu at which to stop.
            close: How much may be left there, relative to p and q.

        Returns:
            An iterate near the path, and mu, which is larger than `end` after `MAX_STEPS` steps.

        Raises:
            SolverError: If the path leads back, or is lost.
        """
        length, left = FIRST_LENGTH, self._left(now)
        corrections = away = 0
        last, along = None, False
        try:
            for step in range(MAX_STEPS):
                ending = products <= end
                if ending and (left <= close or corrections == CORRECTIONS):
                    break
                corrections += ending
                if not products <= BACK:
                    raise SolverError(f"central path: leads back after {step} steps")
                here = self._place(now, products, left)
                taken_back = along and not here.near and length > SHORTEST
                if along:
                    length = float(np.clip(length * here.change_of_length, SHORTEST, LONGEST))
                across = here.across
                if last is not None:
                    (here if taken_back else last).destroy()
                    here = last if taken_back else here
                last, along = here, here.near and not ending
                away = 0 if here.near else away + 1
                now, products, left, taken = self._step(here, length if along else 0.0)
                if not np.isfinite(left) or away > LOST:
                    raise SolverError(f"central path: lost after {step + 1} steps")
                length = taken if along else length
                _log.debug(
                    "    %3d  %.12g  mu %.2e, left %.1e, across %.1e, length %.2g",
                    *(step, now.load_factor, products, left, across, taken),
                )
        except SolverError:
            now.destroy()
            raise
        finally:
            if last is not None:
                last.destroy()
        return now, products

    def _place(self, now: Iterate, products: float, left: float) -> _Place:
        """Factor the equations of a point with equal products."""
        to_path, tangent, sign = self._directions(now, products)
        rate, change = self._rate(now, tangent), self._rate(now, to_path)
        square = self.problem.sum(rate.p**2 + rate.q**2 + 1.0)
        back = -self.problem.sum(rate.p * change.p + rate.q * change.q) / square
        across = self._largest(_Rate(change.p + back * rate.p, change.q + back * rate.q))
        steepness = max(self._largest(rate), 1.0)
        return _Place(now, products, to_path, tangent, back, across, steepness, sign, left)

    def _step(self, here: _Place, length: float) -> tuple[Iterate, float, float, float]:
        """A step across the path and along it, shortened where it leaves too much.

        Returns:
            The point with equal products that it leads to, its mu, what is left there, and the
            length of the step along.
        """
        part = min(1.0, LARGEST_CORRECTOR / here.across) if here.across > 0.0 else 1.0
        enough = max(LEFT, REDUCED * here.left)
        for shortened in range(SHORTER + 1):
            turn = part * here.back + here.sign * length / here.steepness
            turn = float(np.clip(turn, -LARGEST_CHANGE, LARGEST_CHANGE))
            new, products = self._moved(here, part, turn)
            left = self._left(new)
            if left < enough or length < SHORTEST or shortened == SHORTER:
                break
            new.destroy()
            length *= 0.5
        return new, products, left, length

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

    def _moved(self, here: _Place, part: float, turn: float) -> tuple[Iterate, float]:
        """The point with equal products at x + part c + turn t, and its mu."""
        moved = here.iterate.copy()
        moved.move(part, here.to_path)
        moved.move(turn, here.tangent)
        products = here.products * float(np.exp(turn))
        state = State(moved.u, moved.load_factor, moved.pressure, moved.shear, self.work)
        self._grown(products)
        new = self.centred(state, products, moved.strained)
        moved.u.destroy()
        return new, products
