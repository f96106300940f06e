"""Coulomb friction by the fixed point on the friction bound.

    g^{k+1} = g^k + omega^k (F r_N(g^k) - g^k),

where r_N(g) are the normal forces of the state with given friction g (L.A. Mihai, M. Ainsworth,
Comput. Struct. 88 (2010) 859). The relaxation omega follows the observed contraction by Aitken's
formula for vectors (B.M. Irons, R.C. Tuck, Int. J. Numer. Meth. Eng. 1 (1969) 275); where the
iteration cycles, omega is capped, lower and lower.

Near the fixed point the bound can be taken with the pressure into one set of equations, which
Newton's method then solves ("monolithic"). That set has other solutions too, so its answer counts
only if it is the one that the fixed point was heading for.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, cast

import numpy as np
import numpy.typing as npt

from fenics_contact.analysis.result import History
from fenics_contact.analysis.result import Step as FixedPointStep
from fenics_contact.errors import SolverError
from fenics_contact.solvers.interior_point import ACCEPTABLE, PathPoint, WorkControl
from fenics_contact.solvers.kkt import Scales, State
from fenics_contact.solvers.problem import ContactProblem
from fenics_contact.solvers.joint_stiffness import SpringStiffness

Array = npt.NDArray[np.float64]

_log = logging.getLogger("fenics_contact")

MAX_ITERATIONS = 150

#: Relaxation is kept within these limits; the upper one falls where the iteration cycles.
RELAXATION = (0.05, 2.0)

#: Cosine of the angle between changes of one direction, and the largest relaxation there.
ALIGNED, FAST_RELAXATION = 0.9, 50.0

#: Iterations without a change of the bound smaller than before that make a cycle.
CYCLE = 6

#: Change of the bound at which the monolithic finish is tried, and the factor to the next try.
FINISH_AT, FINISH_AGAIN = 0.15, 0.2

#: Centring of the monolithic finish, by change of the bound, and its limits.
FINISH_CENTRING, FINISH_RANGE = 0.1, (1e-5, 1e-2)

#: Centrings of the monolithic solve at a larger T, in units of force times elastic displacement,
#: and another, of force times displacement, where the load factor rises by more than so much of
#: itself.
CONTINUE_CENTRINGS, RISING_CENTRING, RISING = (3e-2, 3e-4), 1e-2, 0.1

#: How far the load factor may move there, in parts of itself and of its rise along the tangent,
#: which is too low where joints close.
CONTINUE_NEAR, RISES = 1e-2, 3.0

#: The monolithic load factor may differ from the fixed point's by this times its last changes.
FINISH_NEAR = 5.0

#: Contractions closer to one than this count as this in the estimate of the error.
SLOWEST = 0.999

#: The slowest direction hides among others: what secants and last changes promise is multiplied by
#: this.
SAFETY = 3.0


#: Centring and tolerance of a warm-started solve, by change of the bound (and its square).
WARM_CENTRING, WARM_TOLERANCE = 1e-2, 1e-4

#: Tolerance of a final monolithic state, and of its load factor, relative to the one asked for.
FINAL_TOLERANCE, SETTLED = 1e-3, 5e-2

#: Limits of both.
CENTRING_RANGE, TOLERANCE_RANGE = (1e-8, 1e-2), (1e-12, 1e-4)


#: Methods of `WorkControl` that look for a state with Coulomb friction, and what they follow.
WAYS = {
    "directly": "interior point method",
    "from_modes": "modes of the blocks",
    "follow": "central path",
}


class GivenFriction(Protocol):
    """Solves for states with given friction, as `interior_point.WorkControl` does.

    Attributes:
        problem: The structure.
        springs: Its stiffness, which counts the factorisations.
    """

    problem: ContactProblem
    springs: SpringStiffness

    def solve(
        self,
        bound: Array | None,
        work: float,
        start: State,
        scales: Scales,
        centring: float = ...,
        tolerance: float = ...,
        load_factor: float | None = ...,
    ) -> PathPoint:
        """See `interior_point.WorkControl.solve`."""
        ...


@dataclass
class FixedPointHistory:
    """What the iteration did.

    Attributes:
        steps: Iterations, in order.
        cycles: How often a cycle was recognised and damped.
        method: "fixed-point" or "monolithic", whichever made the last step.
        converged: Whether load factor and bound stand still.
    """

    steps: list[FixedPointStep] = field(default_factory=list)
    cycles: int = 0
    method: str = "fixed-point"
    converged: bool = False

    def finished(self) -> History:
        """The history as it is reported."""
        return History(tuple(self.steps), self.cycles, self.method, self.converged)

    @property
    def at_once(self) -> bool:
        """Whether one monolithic step was all."""
        return self.method == "monolithic" and len(self.steps) == 1

    @property
    def contraction(self) -> float | None:
        """Factor by which the change of the bound fell per iteration, mean of the last half."""
        changes = [step.bound_change for step in self.steps]
        changes = changes[len(changes) // 2 :]
        if len(changes) < 2 or min(changes) <= 0.0:
            return None
        return float((changes[-1] / changes[0]) ** (1.0 / (len(changes) - 1)))

    @property
    def series(self) -> float:
        """Estimate of the sum of all further changes relative to the last: a geometric series.

        With relaxation the changes do not tell the contraction; secants do.
        """
        contraction = min(self.contraction or 0.5, SLOWEST)
        secant = min(step.secant for step in self.steps[len(self.steps) // 2 :])
        slow = SAFETY * (1.0 / max(secant, 1.0 - SLOWEST) - 1.0)
        return max(slow, contraction / (1.0 - contraction))

    @property
    def remaining(self) -> float:
        """Estimate of what the bound is still to change by, relative."""
        return self.steps[-1].bound_change * max(1.0, self.series)

    @property
    def error(self) -> float:
        """Estimate of the error of the load factor from its last changes.

        Where these keep their sign they are a series of their own: what creeps may be hidden in
        the bound by what converges faster.
        """
        steps = self.steps[-4:]
        changes = np.diff([step.load_factor for step in steps])
        if len(changes) == 0:
            return np.inf
        last = float(np.abs(changes).max())
        if len(changes) == 1:
            return last
        creeps = 0.0
        if np.all(changes > 0.0) or np.all(changes < 0.0):
            omega = np.array([step.relaxation for step in steps[:-1]])
            rates = changes / omega  # of the plain iteration, which relaxation speeds or slows
            secant = float(np.min((1.0 - rates[1:] / rates[:-1]) / omega[:-1]))
            creeps = abs(float(rates[-1])) * (1.0 / max(secant, 1.0 - SLOWEST) - 1.0)
        return max(last * self.series, SAFETY * creeps)


class CoulombFriction:
    """The fixed point at one value of T."""

    def __init__(
        self,
        control: GivenFriction,
        scales: Scales,
        tolerance: float,
        monolithic: bool,
        monitor: Callable[[FixedPointStep], None] | None = None,
        load_factor: float | None = None,
        at_once: bool = False,
        attracting: bool = False,
        past_folds: bool = True,
        small: bool = False,
    ) -> None:
        """Choose how to iterate.

        Args:
            control: Solver for given friction.
            scales: Typical sizes.
            tolerance: On the load factor and on the bound, relative.
            monolithic: Whether to finish with the bound in the equations.
            monitor: Called after every iteration.
            load_factor: If given, lambda is prescribed, not the work.
            at_once: Whether to try the bound in the equations from the start.
            attracting: Whether a state found so counts only if it attracts the fixed point; it is
                looked for with friction that grows, where low states are met first.
            past_folds: Whether its path may be followed past folds, to wherever it ends.
            small: Whether the interior point method alone is tried first.
        """
        self.control = control
        self.problem = control.problem
        self.scales = scales
        self.tolerance = tolerance
        self.final = float(np.clip(FINAL_TOLERANCE * tolerance, TOLERANCE_RANGE[0], ACCEPTABLE))
        self.monolithic = monolithic
        self.monitor = monitor
        self.load_factor = load_factor
        self.at_once = at_once
        self.attracting = attracting
        self.past_folds = past_folds
        self.small = small

    def solve(
        self,
        start: State,
        bound: Array,
        work: float,
        warm: bool = False,
        growth: float = 0.0,
        follow: bool = True,
        iterate: bool = True,
    ) -> tuple[PathPoint, FixedPointHistory]:
        """Iterate from a first bound.

        Args:
            start: State to start from.
            bound: First g at this rank's points, N/m.
            work: T.
            warm: Whether `start` is a state for a nearby bound and T.
            growth: By how much the load factor is expected to rise from that of `start`.
            follow: Whether to look for a state next to a warm `start` first, as `go_on` does.
            iterate: Whether to iterate where the bound in the equations leads to no state.

        Returns:
            The last state, and the history; see there whether it converged.

        Raises:
            SolverError: If not even the first state was found, or not without iterating.
        """
        history = FixedPointHistory()
        relaxed = _Relaxation(self.problem.sum)
        coulomb = self.problem.max(self.problem.friction) > 0.0
        change, finish_at = (0.1 if warm else np.inf), FINISH_AT
        point: PathPoint | None = None
        if warm and follow and coulomb and self.monolithic:
            point = self._continue(start, work, growth, history)
            if point is not None:
                return point, history
        if self.at_once and coulomb and not warm:
            anywhere = (np.inf, np.inf)
            if self.past_folds and self.attracting:
                for way in ("directly", "from_modes") if self.small else ("from_modes",):
                    if point is None:
                        before = start.load_factor
                        point = self._follow(start, work, before, anywhere, history, way)
            if point is None:
                point = self._monolithic(
                    start, work, 1.0, anywhere, history, self.attracting, self.past_folds
                )
            if point is not None:
                return point, history
            if not iterate:
                raise SolverError("none at once")
        for _ in range(MAX_ITERATIONS):
            try:
                point, steps = self._given_friction(point, start, bound, work, change, coulomb)
            except SolverError:
                if point is None:
                    raise
                _log.info("  fixed point stops: no state for the next bound")
                break
            target = self.problem.bound(point.state.pressure)
            difference = target - bound
            change = self._norm(difference) / (self._norm(target) or 1.0)
            omega = relaxed.next(difference, change) if coulomb else 1.0
            factor = point.state.load_factor
            history.steps.append(FixedPointStep(factor, change, omega, steps, relaxed.secant))
            history.cycles = relaxed.cycles
            self._report(history)
            if not coulomb or (
                history.remaining <= self.tolerance
                and history.error <= self.tolerance * abs(point.state.load_factor)
            ):
                history.converged = True
                break
            if self.monolithic and change <= finish_at and len(history.steps) > 2:
                finish_at = FINISH_AGAIN * change
                finished = self._finish(point, work, history)
                if finished is not None:
                    return finished, history
            bound = np.maximum(bound + omega * difference, 0.0)
        if point is None:
            raise SolverError("fixed point: no iteration was made")
        return point, history

    def go_on(
        self,
        start: State,
        work: float,
        growth: float = 0.0,
        afresh: State | None = None,
    ) -> tuple[PathPoint, FixedPointHistory]:
        """Follow a converged state to a larger T, without iterating for one if that fails.

        Args:
            start: The state, moved to T.
            work: T.
            growth: By how much the load factor is expected to rise from that of `start`.
            afresh: If given, the central path is followed from here where that fails; the state
                at its end counts if it is near `start` too.

        Raises:
            SolverError: If there is no state next to it.
        """
        history = FixedPointHistory()
        point = self._continue(start, work, growth, history) if self.monolithic else None
        if point is None and self.monolithic and afresh is not None:
            near = self._near(start, growth)
            way = "from_modes" if self.attracting else "follow"
            point = self._follow(afresh, work, start.load_factor, near, history, way)
        if point is None:
            raise SolverError("no state next to the last one")
        return point, history

    @property
    def _interior(self) -> WorkControl:
        """The solver as one that takes the bound into its equations, where that is asked for."""
        return cast(WorkControl, self.control)

    def _repels(self, point: PathPoint) -> bool:
        """Whether the fixed point moves away from a state, which is then given up."""
        repels = self._interior.repels(point.state, point.bound, self.scales)
        if repels:
            _log.info("  its state not used: the fixed point leaves it")
            point.state.destroy()
        return repels

    def _given_friction(
        self,
        point: PathPoint | None,
        start: State,
        bound: Array,
        work: float,
        change: float,
        coulomb: bool,
    ) -> tuple[PathPoint, int]:
        """A state with given bound, as exact as the change of the bound deserves."""
        warm = np.isfinite(change)
        centring = float(np.clip(WARM_CENTRING * change, *CENTRING_RANGE)) if warm else 1.0
        tolerance = float(np.clip(WARM_TOLERANCE * min(change, 1.0) ** 2, *TOLERANCE_RANGE))
        if not coulomb:
            tolerance = TOLERANCE_RANGE[0]
        state = start if point is None else point.state
        before = self.control.springs.factorizations
        while True:
            try:
                new = self.control.solve(
                    bound, work, state, self.scales, centring, tolerance, self.load_factor
                )
                break
            except SolverError:
                if centring >= 1.0:
                    raise
                centring = min(1.0, 1e2 * centring)
        if point is not None:
            point.state.destroy()
        return new, self.control.springs.factorizations - before

    def _continue(
        self, start: State, work: float, growth: float, history: FixedPointHistory
    ) -> PathPoint | None:
        """The monolithic state next to one at a smaller T, if there is one."""
        allowed = self._near(start, growth)
        rising = growth > RISING * abs(start.load_factor)
        part = self.scales.elastic_part
        for centring in (*(part * c for c in CONTINUE_CENTRINGS), *(RISING_CENTRING,) * rising):
            found = self._monolithic(start, work, centring, allowed, history)
            if found is not None:
                return found
        return None

    def _near(self, start: State, growth: float) -> tuple[float, float]:
        """How far the load factor may fall and rise from that of a state at a smaller T."""
        near = CONTINUE_NEAR * (abs(start.load_factor) + growth)
        return near, near + RISES * growth

    def _finish(
        self, point: PathPoint, work: float, history: FixedPointHistory
    ) -> PathPoint | None:
        """The monolithic state next to the fixed point's, if there is one."""
        centring = float(np.clip(FINISH_CENTRING * history.steps[-1].bound_change, *FINISH_RANGE))
        floor = self.tolerance * abs(point.state.load_factor)
        allowed = FINISH_NEAR * max(history.error, floor)
        finished = self._monolithic(point.state, work, centring, (10.0 * allowed, allowed), history)
        if finished is not None:
            point.state.destroy()
        return finished

    def _monolithic(
        self,
        start: State,
        work: float,
        centring: float,
        allowed: tuple[float, float],
        history: FixedPointHistory,
        growing: bool = False,
        past_folds: bool = False,
    ) -> PathPoint | None:
        """Solve with the bound in the equations; the load factor may fall and rise as allowed."""
        # Where the load factor is given, nothing but the displacements tells how near the limit is.
        tolerance = self.final if self.load_factor is None else TOLERANCE_RANGE[0]

        def solve() -> PathPoint:
            return self._interior.solve(
                None,
                work,
                start,
                self.scales,
                centring,
                tolerance,
                self.load_factor,
                SETTLED * self.tolerance,
                growing,
                past_folds,
            )

        # Which state a step across folds meets is chance; the path has a beginning.
        return self._taken(
            solve, "monolithic step", start.load_factor, allowed, history, attracting=growing
        )

    def _follow(
        self,
        start: State,
        work: float,
        before: float,
        allowed: tuple[float, float],
        history: FixedPointHistory,
        way: str,
    ) -> PathPoint | None:
        """The same from a load factor `before`, by one of `WAYS`."""
        solver = getattr(self._interior, way)

        def solve() -> PathPoint:
            settled = SETTLED * self.tolerance
            return cast(PathPoint, solver(work, start, self.scales, self.final, settled))

        alone = way == "directly"
        return self._taken(solve, WAYS[way], before, allowed, history, attracting=alone)

    def _taken(
        self,
        solve: Callable[[], PathPoint],
        name: str,
        before: float,
        allowed: tuple[float, float],
        history: FixedPointHistory,
        attracting: bool = False,
    ) -> PathPoint | None:
        """The state that a solver with the bound in its equations finds, if it is as allowed.

        With `attracting` only if the fixed point stays there, unless its path was followed.
        """
        spent = self._interior.factorizations
        try:
            found = solve()
        except SolverError as error:
            _log.info("  %s not used: %s", name, error)
            return None
        factor = found.state.load_factor
        rise = factor - before if self.load_factor is None else 0.0
        if not -allowed[0] <= rise <= allowed[1]:
            _log.info("  %s not used: it ends elsewhere, at %.6g", name, factor)
            found.state.destroy()
            return None
        steps = self._interior.factorizations - spent
        if attracting and not found.followed and self._repels(found):
            return None
        history.steps.append(FixedPointStep(factor, 0.0, 1.0, steps))
        history.method, history.converged = "monolithic", True
        self._report(history)
        return found

    def _norm(self, values: Array) -> float:
        return float(np.sqrt(self.problem.sum(values**2)))

    def _report(self, history: FixedPointHistory) -> None:
        if self.monitor is not None:
            self.monitor(history.steps[-1])


class _Relaxation:
    """Irons and Tuck's omega, capped where the iteration cycles.

    Changes that keep their direction are slow growth, not a cycle, whatever their size.
    """

    def __init__(self, total: Callable[[Array], float]) -> None:
        self._total = total
        self._last: Array | None = None
        self._omega = 1.0
        self._cap = RELAXATION[1]
        self._best, self._since = np.inf, 0
        self.cycles = 0
        self.secant = 1.0

    def next(self, difference: Array, change: float) -> float:
        """Relaxation for the next step, from F r_N - g of this one."""
        last = self._omega
        if self._last is not None:
            step = difference - self._last
            square = self._total(step * step)
            moved = last**2 * self._total(self._last * self._last)
            self.secant = float(np.sqrt(square / moved)) if moved > 0.0 else 1.0
            if square > 0.0:
                self._omega *= -self._total(self._last * step) / square
        if self._omega <= 0.0:  # the change points the same way and grew: go on faster
            self._omega = 2.0 * last
        aligned = self._aligned(difference)
        if change < 0.9 * self._best:
            self._best, self._since = change, 0
        elif not aligned:
            self._since += 1
        if self._since >= CYCLE:
            self._cap = max(0.5 * min(self._cap, 1.0), RELAXATION[0])
            self._since = 0
            self.cycles += 1
        cap = FAST_RELAXATION if aligned and self.cycles == 0 else self._cap
        self._omega = float(np.clip(self._omega, RELAXATION[0], cap))
        self._last = difference.copy()
        return self._omega

    def _aligned(self, difference: Array) -> bool:
        """Whether the change points where the last one did."""
        if self._last is None:
            return False
        sizes = self._total(difference**2) * self._total(self._last**2)
        return self._total(difference * self._last) > ALIGNED * np.sqrt(sizes)
