"""Coulomb friction by the fixed point on the friction bound.

    g^{k+1} = g^k + omega^k (F r_N(g^k) - g^k),

where r_N(g) are the normal forces of the state with given friction g (L.A. Mihai, M. Ainsworth,
Comput. Struct. 88 (2010) 859). The relaxation omega follows the observed contraction by Aitken's
formula for vectors (B.M. Irons, R.C. Tuck, Int. J. Numer. Meth. Eng. 1 (1969) 275); where the
iteration cycles, omega is capped, lower and lower. Or it is one number, which a user gives.

It ends where the certificate of a pass says that its state is one with Coulomb friction: forces
where nothing slips, and joints that carry next to nothing, may go on for long without a part in it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.results.history import History, Step
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.interior_point import Solution
from fenics_contact.solvers.problem import Array, ContactProblem, State

_log = logging.getLogger("fenics_contact")


Frozen = TypeVar("Frozen")
Found = TypeVar("Found")


def settled(
    solve: Callable[[Frozen], Found],
    renewed: Callable[[Frozen, Found], Frozen | None],
    frozen: Frozen,
    most: int,
) -> bool:
    """Whether a law that depends on the state settles: it is frozen, solved for, and renewed.

    The one loop for such laws: the bound on friction here, of joints that tear.

    Args:
        solve: The answer with the law frozen.
        renewed: The law by what was frozen and its answer; None where it stays.
        frozen: What the law is at first.
        most: Answers at most.
    """
    for _ in range(most):
        new = renewed(frozen, solve(frozen))
        if new is None:
            return True
        frozen = new
    return False


#: State with a friction bound g: `solve(g, start, mu, change)`, with g at this rank's points in
#: N per metre of thickness, products mu to start with (1 from afar), and the last change of the
#: bound, relative, which tells how exact a state has to be. Raises `SolverError` if there is none.
GivenFriction = Callable[[Array, State, float, float], Solution]


@dataclass(frozen=True)
class FixedPoint:
    """The iteration for one structure.

    Attributes:
        problem: The structure.
        solve: Finds states with given friction.
        tolerance: On the load factor and on the bound, relative.
        judge: Whether the state of a pass is a collapse state with Coulomb friction, by its own
            certificate.
        monitor: Told every iteration.
        factorizations: Number of factorisations so far.
        relaxation: omega of all steps; None: by the changes.
    """

    problem: ContactProblem
    solve: GivenFriction
    tolerance: float
    judge: Callable[[State], bool]
    monitor: Callable[[Step], None]
    factorizations: Callable[[], int]
    relaxation: float | None = None

    def run(self, start: State, bound: Array) -> tuple[Solution, History]:
        """State whose friction bound g is Coulomb's, and the history, which says if it converged.

        Args:
            start: State to start from.
            bound: First g at this rank's points, N per metre of thickness.

        Raises:
            SolverError: If `solve` finds no state for the first bound.
        """
        relaxation = _Relaxation(self.problem.sum, self.relaxation)
        steps: list[Step] = []
        found: list[Solution] = []
        counts = [self.factorizations()]

        def state(bound: Array) -> Solution:
            change = steps[-1].bound_change if steps else np.inf
            last = found[-1].state if found else start
            mu = float(np.clip(1e-2 * change, 1e-8, 1.0))
            while mu < 1.0:
                try:
                    return self.solve(bound, last, mu, min(change, 1.0))
                except SolverError:
                    mu *= 1e2
            return self.solve(bound, last, 1.0, min(change, 1.0))

        def norm(values: Array) -> float:
            return float(np.sqrt(self.problem.sum(values**2)))

        def renewed(bound: Array, solution: Solution) -> Array | None:
            found.append(solution)
            counts.append(self.factorizations())
            factor = solution.state.load_factor
            target = self.problem.law.given(solution.state.pressure)
            change = norm(target - bound) / (norm(target) or 1.0)
            omega = relaxation.next(target - bound, change)
            before = steps[-1].bound_change if steps else 0.0
            contraction = change / before if before else np.nan
            spent = counts[-1] - counts[-2]
            steps.append(Step(factor, change, omega, spent, relaxation.secant, contraction))
            self.monitor(steps[-1])
            if self.judge(solution.state) or self._converged(steps):
                return None
            return np.maximum(bound + omega * (target - bound), 0.0)

        converged = False
        try:
            converged = settled(state, renewed, bound, SEARCH.bound_iterations)
        except SolverError as error:
            if not found:
                raise
            _log.info("  fixed point stops: no state for the next bound (%s)", error)
        return found[-1], History(tuple(steps), relaxation.cycles, "fixed-point", converged)

    def _converged(self, steps: Sequence[Step]) -> bool:
        """Whether neither bound nor load factor will change by more than the tolerance.

        All further changes over the last are a geometric series, by changes and by secants. Changes
        of the load factor of one sign are a series of their own, which may creep where the bound
        converges fast.
        """
        contraction = min(History(tuple(steps)).contraction or 0.5, 1.0 - SEARCH.small_factor)
        secant = min(step.secant for step in steps[len(steps) // 2 :])
        slow = SEARCH.secant_safety * (1.0 / max(secant, SEARCH.small_factor) - 1.0)
        series = max(slow, contraction / (1.0 - contraction))
        last = steps[-4:]
        changes = np.diff([step.load_factor for step in last])
        if steps[-1].bound_change * max(1.0, series) > self.tolerance or len(changes) == 0:
            return False
        error = float(np.abs(changes).max())
        if len(changes) > 1:
            error *= series
            if np.all(changes > 0.0) or np.all(changes < 0.0):
                omega = np.array([step.relaxation for step in last[:-1]])
                rates = changes / omega  # of the plain iteration, which relaxation speeds or slows
                secant = float(np.min((1.0 - rates[1:] / rates[:-1]) / omega[:-1]))
                creeps = abs(float(rates[-1])) * (1.0 / max(secant, SEARCH.small_factor) - 1.0)
                error = max(error, SEARCH.secant_safety * creeps)
        return error <= self.tolerance * abs(steps[-1].load_factor)


class _Relaxation:
    """Irons and Tuck's omega, capped where the iteration cycles; or a given one.

    Attributes:
        cycles: How often a cycle was recognised.
        secant: Change of F r_N - g over that of g, 1 - c for a contraction c.
    """

    def __init__(self, total: Callable[[Array], float], given: float | None = None) -> None:
        """Start with omega = 1, or keep the given one; `total` sums an array over all ranks."""
        self._total = total
        self._given = given
        self._last: Array | None = None
        self._omega = given or 1.0
        self._cap = SEARCH.largest_relaxation
        self._best = np.inf
        self._since = 0
        self.cycles, self.secant = 0, 1.0

    def next(self, difference: Array, change: float) -> float:
        """Relaxation for a step with difference F r_N - g, of a size relative to F r_N."""
        before = self._omega
        aligned = False  # whether the change points where the last one did
        if self._last is not None:  # Irons and Tuck
            step = difference - self._last
            square = self._total(step * step)
            of_last = self._total(self._last * self._last)
            moved = before**2 * of_last
            self.secant = float(np.sqrt(square / moved)) if moved > 0.0 else 1.0
            if square > 0.0:
                self._omega = -before * self._total(self._last * step) / square
            sizes = self._total(difference**2) * of_last
            aligned = self._total(difference * self._last) > 0.9 * np.sqrt(sizes)
        if change < 0.9 * self._best:
            self._best = change
            self._since = 0
        elif not aligned:
            self._since += 1
        if self._since >= SEARCH.no_progress:
            self._cap = max(0.5 * min(self._cap, 1.0), SEARCH.decade)
            self._since = 0
            self.cycles += 1
        if self._omega <= 0.0:  # the change points the same way and grew: go on faster
            self._omega = 2.0 * before
        self._omega = float(np.clip(self._omega, SEARCH.decade, self._cap))
        self._omega = self._given or self._omega
        self._last = difference
        return self._omega
