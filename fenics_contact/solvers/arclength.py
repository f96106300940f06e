"""The central path of a state under work control, followed past its folds.

With Coulomb friction the solutions of the path's equations (`path_equations`) for falling products
mu are a curve that may turn back: mu has to rise for a while before it can fall to zero. An
interior point method, which only lowers mu, stalls there. The curve itself goes on, so it is
followed by its length, with mu as one unknown more (H.B. Keller, in Applications of Bifurcation
Theory (1977) 359; E.L. Allgower, K. Georg, Numerical Continuation Methods (1990)).

The unknowns are those in which all products equal mu whatever the step, so that no step ends at a
boundary (`smoothed_laws`): p and q at every joint point. One factor of the springs gives Newton's
step c to the path at this mu and the tangent t = dx/dlog mu. A step goes to the path at right
angles to the tangent, and then along it,

    dx = c + a t + ds t,   a = -(t.c)/(t.t),

(products of the relative changes of p and q at all points, with log mu counted once per point), mu
falling where the determinant of the equations is positive, and rising where it is not. A few points
whose laws bend on the way are taken as they are (`few_points`), all others on their tangents. Where
the next step does not reach the path, this one led too far, and is made again with all points
nearer to their laws. Friction may grow along the path, as a function of mu.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.solvers.nonlinear_elimination import LEFT, FewPoints, Step
from fenics_contact.solvers.kkt import (
    Array,
    Iterate,
    PathEquations,
    Residual,
)

_log = logging.getLogger("fenics_contact")

MAX_STEPS = 200

#: Size of p and q by which changes are measured, at least: smaller ones are of no consequence.
SMALLEST = 1e-3

#: Steps in a row that do not reach the path, until it is lost.
LOST = 6

#: By how much less far from the laws a step leads that is taken back, and when none is any more.
SHORTER, LEAST = 0.3, 0.01

#: Part of the last step within which one that leads back ends.
RETURNED = 0.5

#: Relative difference of load factors, and that of the logarithms of products, up to which places
#: are the same; how many times as far it must have been in between to have left one, and how often
#: the path may meet itself.
SAME_FACTOR, SAME_PRODUCTS, AWAY, MEETINGS = 3e-7, 1e-2, 10.0, 3

#: At the end no more than this is left, or so many steps were taken across the path alone.
CLOSE, CORRECTIONS = 0.1, 6

#: Products to which the path may lead back, in units of force times displacement.
BACK = 1e2


@dataclass(frozen=True)
class Place:
    """Where the path has led, and what a factorisation there tells.

    Attributes:
        iterate: Point with equal products.
        products: Its mu.
        springs: k_N, k_T and q of the factor.
        to_path: The step c to the path at this mu.
        tangent: t.
        sign: Of the way along the tangent to smaller mu, or, past a fold, to larger.
    """

    iterate: Iterate
    products: float
    springs: tuple[Array, Array, Array]
    to_path: Iterate
    tangent: Iterate
    sign: float

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

    #: On the way a tenth of p and q is near enough.
    keeps_digits = False

    #: The last place from which the path was reached, and how far from the laws a step may lead.
    _trusted: FewPoints | None = None
    _limit = LEFT

    def follow(
        self,
        now: Iterate,
        products: float,
        end: float,
        close: float = CLOSE,
        patience: float = np.inf,
    ) -> tuple[Iterate, float]:
        """Follow the path until the products are small.

        Args:
            now: Iterate with equal products, near the path; not to be used any more.
            products: mu there, in units of force times displacement.
            end: mu at which to stop.
            close: How much may be left there, relative to p and q.
            patience: Steps at most in which the smallest mu so far has to halve.

        Returns:
            An iterate near the path, and mu, which is larger than `end` after `MAX_STEPS` steps.

        Raises:
            SolverError: If the path leads back, in a circle, or nowhere for too long, or is lost.
        """
        left, corrections, astray, met = self._left(now), 0, 0, 0
        places: list[tuple[float, float]] = []
        smallest, halved = products, 0
        try:
            for step in range(MAX_STEPS):
                ending = products <= end
                if ending and (left <= close or corrections == CORRECTIONS):
                    break
                corrections += ending
                if not products <= BACK:
                    raise SolverError(f"central path: leads back after {step} steps")
                found = self._step(now, products, end, ending)
                astray = 0 if found.reached else astray + 1
                now, products = found.iterate, found.products
                left = self._left(now)
                _log.debug(
                    "    %3d  %.12g  mu %.2e, left %.1e, limit %.1e",
                    *(step, now.load_factor, products, left, self._limit),
                )
                met += not ending and _meets(places, now.load_factor, products)
                places.append((now.load_factor, products))
                if met >= MEETINGS:
                    raise SolverError(f"central path: leads in a circle after {step + 1} steps")
                if products <= 0.5 * smallest:
                    smallest, halved = products, step
                if not ending and step - halved >= patience:
                    raise SolverError(f"central path: wanders, after {step + 1} steps")
                if not np.isfinite(left) or astray > LOST:
                    raise SolverError(f"central path: lost after {step + 1} steps")
        except SolverError:
            now.destroy()
            raise
        return now, products

    def forget(self) -> None:
        """Free what the last steps left; others from elsewhere may follow."""
        self._trust(None)
        self._limit = LEFT

    def _trust(self, here: FewPoints | None) -> None:
        if self._trusted is not None:
            self._trusted.destroy()
        self._trusted = here

    def _step(self, now: Iterate, products: float, end: float, ending: bool) -> Step:
        """A step on from a point, or the last one again where that led too far."""
        here = FewPoints(self, self.place(now, products))
        found = here.follow(end, not ending, self._limit)
        lost = not found.reached or self._leads_back(now, found.iterate)
        if lost and self._trusted is not None and self._limit > LEAST:
            found.iterate.destroy()
            here.destroy()
            self._limit *= SHORTER
            return self._trusted.again(end, self._limit)
        self._limit = min(LEFT, self._limit / SHORTER)
        if found.reached and not ending:
            self._trust(here)
            return found
        if not found.reached:
            self._trust(None)
        here.destroy()
        return found

    def _leads_back(self, now: Iterate, new: Iterate) -> bool:
        """Whether a step leads to where the last one began."""
        if self._trusted is None:
            return False
        before, sizes = self._trusted.place.iterate, self._sizes(now)

        def distance(one: Iterate) -> float:
            changes = zip(self._numbers(one), self._numbers(before), sizes, strict=True)
            return self.problem.sum(sum(((a - b) / size) ** 2 for a, b, size in changes))

        return distance(new) < RETURNED**2 * distance(now)

    def _numbers(self, now: Iterate) -> tuple[Array, Array]:
        """The numbers p and q of all points."""
        d, f = self.scales.displacement, self.scales.force
        slip = np.where(self.sticky, now.shear / f - (now.z2 - now.z1) / d, 0.0)
        return now.pressure / f - now.y / d, slip

    def place(self, now: Iterate, products: float) -> Place:
        """Factor the equations of a point with equal products."""
        springs, to_path, tangent, sign = self._directions(now, products)
        return Place(now, products, springs, to_path, tangent, sign)

    def back_to(self, place: Place) -> None:
        """Factor the equations of a place again, after those of others."""
        self.grown(place.products)
        self.factor(place.iterate)
        self.springs.solve(self.problem.live, self.workspace.border)

    def grown(self, products: float) -> float:
        """Set the friction that is there at some products; its rate."""
        if self.growth is None:
            return 0.0
        self.mobilise(self.growth.part(products))
        return self.growth.rate(products)

    def _directions(
        self, now: Iterate, products: float
    ) -> tuple[tuple[Array, Array, Array], Iterate, Iterate, float]:
        """Springs of a factor, c and t, and the sign of dmu/ds."""
        rate = self.grown(products)
        springs = self.factor(now)
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
        sign = -self.springs.determinant_sign * float(np.sign(flexibility))
        return springs, to_path, tangent, sign

    def _sizes(self, now: Iterate) -> tuple[Array, Array]:
        d, f = self.scales.displacement, self.scales.force
        size_q = 0.5 * (now.s1 + now.s2) / f + np.abs(now.z2 - now.z1) / d
        return np.maximum(now.pressure / f + now.y / d, self.smallest), np.maximum(
            size_q, self.smallest
        )

    def _left(self, now: Iterate) -> float:
        """Largest distance from the path, relative to p and q."""
        residual = self.residual(now)
        size_p, size_q = self._sizes(now)
        slip = np.where(self.sticky, residual.slip / size_q, 0.0)
        left = np.maximum(np.abs(residual.opening / size_p), np.abs(slip))
        return self.problem.max(left) / self.scales.displacement


def _meets(places: list[tuple[float, float]], load_factor: float, products: float) -> bool:
    """Whether a path comes to where it was, and was not in between."""
    factors, mu = np.array(places).reshape(-1, 2).T
    apart = np.abs(load_factor - factors), np.abs(np.log(products / mu))
    same, close = (
        (apart[0] <= times * SAME_FACTOR * np.abs(factors)) & (apart[1] <= times * SAME_PRODUCTS)
        for times in (1.0, AWAY)
    )
    away = np.flatnonzero(~close)
    return bool(len(away) and np.any(same[: away[-1]]))
