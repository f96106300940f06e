"""Continuation of the central path by its length.

The perturbed conditions (`kkt`) of one structure have a curve of solutions when one of their
numbers varies: products mu that fall, or work T of the live load that rises. With Coulomb friction
the curve may turn back. An interior point method stalls there; the curve itself goes on, so it is
followed by its length, with the number that varies as one unknown more (H.B. Keller, in
Applications of Bifurcation Theory (1977) 359; E.L. Allgower, K. Georg, Numerical Continuation
Methods (1990)).

The unknowns are those in which all products equal mu whatever the step, so that no step ends at a
boundary (`joint_law`): p and q at every joint point. One factor gives Newton's correction c to the
path and the tangent t = dx/ds. A step goes to the path at right angles to the tangent, and then
along it, ds > 0 where the determinant of the equations is positive, and < 0 where it is not. A few
points whose laws bend on the way follow these (`nonlinear_elimination`). Where the next step does
not reach the path, this one led too far, and is made again, shorter.
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers.kkt import Iterate, Linearization, PerturbedKKT, Residual
from fenics_contact.solvers.nonlinear_elimination import (
    NonlinearElimination,
    Rates,
)
from fenics_contact.solvers.problem import State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class Path:
    """How mu and T depend on the parameter s of a step.

    Attributes:
        log_mu_rate: d(log mu)/ds.
        work_rate: dT/ds, in units of T where the step begins.
    """

    log_mu_rate: float
    work_rate: float

    def mu(self, mu: float, s: float) -> float:
        """Mu after a change of s."""
        return mu * float(np.exp(self.log_mu_rate * s))

    def work(self, work: float, s: float) -> float:
        """T after a change of s: linear, as displacements are on one factor."""
        return work * (1.0 + self.work_rate * s)

    def progress(self, mu: float, work: float) -> float:
        """Logarithm of what varies, rising along the path."""
        return float(np.log(work)) if self.work_rate else -float(np.log(mu))

    def change_to(self, mu: float, work: float, end: float) -> float:
        """Change of s that leads to some progress."""
        left = end - self.progress(mu, work)
        return float(np.expm1(left)) if self.work_rate else left


#: The products fall under constant work; the work rises with constant products.
FALLING_PRODUCTS = Path(-1.0, 0.0)
RISING_WORK = Path(0.0, 1.0)


@dataclass(frozen=True)
class PathPoint:
    """A point on or near a path.

    Attributes:
        iterate: With all products equal to mu.
        mu: In units of force times displacement.
        work: T, N m per metre of thickness.
        rate: d(lambda)/ds there; nan where no factor was made, as at the end of a path.
    """

    iterate: Iterate
    mu: float
    work: float
    rate: float = math.nan

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Load factor, mu and T."""
        return self.iterate.load_factor, self.mu, self.work

    @property
    def state(self) -> State:
        """The point as a state."""
        now = self.iterate
        return State(now.u, now.elastic, now.load_factor, now.pressure, now.shear, self.work)


class Continuation:
    """Follows one path of one structure."""

    def __init__(self, kkt: PerturbedKKT, path: Path, options: SearchOptions = SEARCH) -> None:
        """Choose what varies; the work of the conditions is replaced as the path says."""
        # On the way a tenth of p and q is near enough: digits need not be kept.
        self.kkt = replace(kkt, options=replace(kkt.options, cancellation=np.inf))
        self.path = path
        self.options = options

    def begin(self, start: State, mu: float) -> PathPoint:
        """The point with all products equal to mu next to a state from elsewhere."""
        kkt = replace(self.kkt, work=start.work)
        return PathPoint(kkt.on_central_path(start, mu, SEARCH.digits), mu, start.work)

    def follow(self, point: PathPoint, end: float) -> PathPoint:
        """The point where the path ends that `points` follows."""
        *_, last = self.points(point, end)
        return last

    def points(self, point: PathPoint, end: float) -> Iterator[PathPoint]:
        """Points on the path, one for each step that reaches it, and the end of the path.

        Who has seen enough leaves the loop.

        Args:
            point: A point near the path.
            end: mu, or T, at which to stop.

        Yields:
            Points with d(lambda)/ds; the last one, without it, is the end.

        Raises:
            SolverError: If the path is lost, or wanders: it has not advanced by log 2 for too many
                steps.
        """
        options = self.options
        goal = self.path.progress(end, end) + options.small_factor
        usual = limit = options.allowed_distance
        before: PathPoint | None = None  # where the last step that reached the path began
        best = self._progress(point)
        best_step = astray = 0
        for step in itertools.count():
            progress = self._progress(point)
            if progress >= goal - 0.5 * options.small_factor:
                yield self.settled(point, options.decade)
                return
            if progress >= best + np.log(2.0):
                best = progress
                best_step = step
            if step - best_step >= options.path_patience:
                raise SolverError(f"central path: wanders, after {step} steps")
            earlier = before if limit > options.path_least * usual else None
            rounds = options.late_rounds if earlier is None else 0
            point, new, reached = self._next(point, goal, limit, rounds)
            if not reached and earlier is not None:
                limit *= options.path_shorter
                _, point, _ = self._next(earlier, goal, limit, 0)
            else:
                limit = min(limit / options.path_shorter, usual)
                astray = 0 if reached else astray + 1
                if reached:
                    yield point
                before = point if reached else None
                point = new
            _log.debug("    %3d  %.12g  mu %.2e, T %.4e", step, *point.numbers)
            if astray > options.no_progress or not np.all(np.isfinite(point.numbers)):
                raise SolverError(f"central path: lost after {step + 1} steps")

    def without_products(self, point: PathPoint) -> float:
        """Load factor with products zero at the point passed last, to first order.

        It is that of Newton's step, with the factor that was made there.
        """
        now = point.iterate
        kkt = self._linear.kkt
        (step,) = self._linear.directions([(kkt.residual(now), -kkt.products(now))])
        return now.load_factor + step.load_factor

    def settled(self, point: PathPoint, close: float) -> PathPoint:
        """The point after steps across the path alone, until it is close, relative to p and q."""
        allowed = self.options.allowed_distance
        for _ in range(self.options.no_progress):
            if self.distance(point) <= close:
                break
            _, point, _ = self._next(point, None, allowed, self.options.late_rounds)
        return point

    def _progress(self, point: PathPoint) -> float:
        """Logarithm of what varies, rising along the path."""
        return self.path.progress(point.mu, point.work)

    def distance(self, point: PathPoint) -> float:
        """Largest distance of a point from the path, relative to p and q."""
        kkt = replace(self.kkt, work=point.work)
        now = point.iterate
        least = self.options.small_factor
        d = kkt.scales.displacement
        f = kkt.scales.force
        residual = kkt.residual(now)
        of_p = np.maximum(now.pressure / f + now.y / d, least)
        of_q = np.maximum(0.5 * (now.s1 + now.s2) / f + np.abs(now.slip) / d, least)
        slip = np.where(kkt.frictional, residual.slip / of_q, 0.0)
        return kkt.problem.max(np.maximum(np.abs(residual.opening / of_p), np.abs(slip))) / d

    def _next(
        self, point: PathPoint, goal: float | None, limit: float, rounds: int
    ) -> tuple[PathPoint, PathPoint, bool]:
        """A point with d(lambda)/ds, the one a step on, and whether that step reached the path.

        It is not past the goal. Without a goal the step only goes to the path. No point that is not
        chosen ends farther from its law than a limit. Points are chosen on the way in so many
        rounds.
        """
        options = self.options
        path = self.path
        linear = self._linear = replace(self.kkt, work=point.work).linearize(point.iterate)
        correction, tangent = self._directions(linear, point)
        rates = Rates(point.mu, path.log_mu_rate, options.small_factor)
        numbers = replace(options, allowed_distance=limit, late_rounds=rounds)
        elimination = NonlinearElimination(linear, correction, tangent, rates, numbers)
        reach = None
        to_goal = 0.0
        largest = options.path_change
        back = -largest / (1.0 + largest) if path.work_rate else -largest
        if goal is not None:
            to_goal = path.change_to(point.mu, point.work, goal)
            reach = back, min(to_goal, largest)
        step = elimination.step(reach, linear.orientation * options.path_aimed)
        s = max(back, min(step.s, to_goal))
        moved = step.moved
        mu = path.mu(point.mu, s)
        work = path.work(point.work, s)
        _, pressure, _, shear, _ = self.kkt.scales.force * step.states
        state = State(moved.u, moved.elastic, moved.load_factor, pressure, shear, work)
        iterate = replace(self.kkt, work=work).on_central_path(state, mu)
        here = replace(point, rate=tangent.load_factor)
        return here, PathPoint(iterate, mu, work), step.reached

    def _directions(self, linear: Linearization, point: PathPoint) -> tuple[Iterate, Iterate]:
        """Correction c and tangent t."""
        path = self.path
        kkt = linear.kkt
        now = point.iterate
        none = np.zeros_like(now.y)
        across = kkt.residual(now), np.zeros((3, len(none)))
        product = path.log_mu_rate * point.mu * kkt.scales.force * kkt.scales.displacement
        rate = -path.work_rate * point.work
        along = Residual(np.zeros_like(now.u), none, none, rate), np.full((3, len(none)), product)
        correction, tangent = linear.directions([across, along])
        return correction, tangent
