"""Coulomb friction by the fixed point on the friction bound.

    g^{k+1} = g^k + omega^k (F r_N(g^k) - g^k),

where r_N(g) are the normal forces of the state with given friction g (L.A. Mihai, M. Ainsworth,
Comput. Struct. 88 (2010) 859). The relaxation omega follows the observed contraction by Aitken's
formula for vectors (B.M. Irons, R.C. Tuck, Int. J. Numer. Meth. Eng. 1 (1969) 275); where the
iteration cycles, omega is capped, lower and lower.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from fenics_contact.analysis.history import History, Step
from fenics_contact.errors import SolverError
from fenics_contact.solvers.interior_point import Solution
from fenics_contact.solvers.problem import Array, ContactProblem, State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class FixedPointOptions:
    """Numbers of the iteration.

    Attributes:
        max_iterations: Iterations at most.
        relaxation: Least and largest omega; the largest falls where the iteration cycles.
        aligned: Cosine of the angle between changes of one direction: growth, not a cycle.
        fast: Largest omega there.
        smaller: A change of the bound counts as smaller below this part of the smallest so far.
        cycle: Iterations without a smaller one that make a cycle.
        slowest: Contractions closer to one than this count as this in the estimate of the error.
        safety: The slowest direction hides among others: what secants promise is multiplied by it.
        centring: Products of a warm start, in units of the last change of the bound.
        least_centring: Least products of a warm start.
        further: Factor of the products where a warm start finds nothing.
        precision: Tolerance of a state, in units of a power of that change.
        order: The power.
        loosest: Largest tolerance of a state.
        tightest: Smallest.
    """

    max_iterations: int = 150
    relaxation: tuple[float, float] = (0.05, 2.0)
    aligned: float = 0.9
    fast: float = 50.0
    smaller: float = 0.9
    cycle: int = 6
    slowest: float = 0.999
    safety: float = 3.0
    centring: float = 1e-2
    least_centring: float = 1e-8
    further: float = 1e2
    precision: float = 1e-4
    order: float = 2.0
    loosest: float = 1e-4
    tightest: float = 1e-12


class GivenFriction(Protocol):
    """Finds states with given friction."""

    def __call__(self, bound: Array, start: State, mu: float, tolerance: float) -> Solution:
        """State with friction bound g at this rank's points, N per metre of thickness.

        Args:
            bound: g.
            start: State to start from.
            mu: Products to start with, in units of force times displacement; 1 from afar.
            tolerance: On the residuals, relative.

        Raises:
            SolverError: If none is found.
        """
        ...


def solve_fixed_point(
    problem: ContactProblem,
    solve: GivenFriction,
    start: State,
    bound: Array,
    tolerance: float,
    monitor: Callable[[Step], None],
    factorizations: Callable[[], int],
    options: FixedPointOptions | None = None,
) -> tuple[Solution, History]:
    """State whose friction bound g is Coulomb's, and the history, which says if it converged.

    Args:
        problem: The structure.
        solve: Finds states with given friction; its `SolverError` is raised for the first one.
        start: State to start from.
        bound: First g at this rank's points, N per metre of thickness.
        tolerance: On the load factor and on the bound, relative.
        monitor: Told every iteration.
        factorizations: Number of factorisations so far.
        options: Numbers of the iteration.
    """
    options = options or FixedPointOptions()
    iteration = _Iteration(problem, solve, start, _Relaxation(problem.sum, options), options)
    steps: list[Step] = []
    converged = False
    while len(steps) < options.max_iterations and not converged:
        before = factorizations()
        try:
            step, bound = iteration.next(bound)
        except SolverError as error:
            if not steps:
                raise
            _log.info("  fixed point stops: no state for the next bound (%s)", error)
            break
        steps.append(replace(step, factorizations=factorizations() - before))
        monitor(steps[-1])
        converged = _converged(steps, tolerance, options)
    cycles = iteration.relaxation.cycles
    return iteration.solution, History(tuple(steps), cycles, "fixed-point", converged)


@dataclass
class _Iteration:
    """g^{k+1} = g^k + omega (F r_N - g^k), one step at a time."""

    problem: ContactProblem
    solve: GivenFriction
    start: State
    relaxation: _Relaxation
    options: FixedPointOptions
    change: float = float(np.inf)
    solution: Solution = field(init=False)

    def next(self, bound: Array) -> tuple[Step, Array]:
        """The step at g^k, its factorisations not counted yet, and g^{k+1}."""
        self.solution = self._state(bound)
        self.start = state = self.solution.state
        target = self.problem.bound(state.pressure)
        self.change = self._norm(target - bound) / (self._norm(target) or 1.0)
        omega = self.relaxation.next(target - bound, self.change)
        step = Step(state.load_factor, self.change, omega, 0, self.relaxation.secant)
        return step, np.maximum(bound + omega * (target - bound), 0.0)

    def _state(self, bound: Array) -> Solution:
        """State with given bound, as exact as the last change of the bound deserves."""
        options, change = self.options, self.change
        tolerance = options.precision * min(change, 1.0) ** options.order
        tolerance = float(np.clip(tolerance, options.tightest, options.loosest))
        mu = float(np.clip(options.centring * change, options.least_centring, 1.0))
        while mu < 1.0:
            try:
                return self.solve(bound, self.start, mu, tolerance)
            except SolverError:
                mu *= options.further
        return self.solve(bound, self.start, 1.0, tolerance)

    def _norm(self, values: Array) -> float:
        return float(np.sqrt(self.problem.sum(values**2)))


def _converged(steps: Sequence[Step], tolerance: float, options: FixedPointOptions) -> bool:
    """Whether neither bound nor load factor will change by more than the tolerance."""
    last = steps[-1]
    if last.bound_change * max(1.0, _series(steps, options)) > tolerance:
        return False
    return _load_factor_error(steps, options) <= tolerance * abs(last.load_factor)


def _series(steps: Sequence[Step], options: FixedPointOptions) -> float:
    """Estimate of the sum of all further changes relative to the last: a geometric series.

    With relaxation the changes do not tell the contraction; secants do.
    """
    contraction = History(tuple(steps)).contraction
    contraction = min(contraction or 0.5, options.slowest)
    secant = min(step.secant for step in steps[len(steps) // 2 :])
    slow = options.safety * (1.0 / max(secant, 1.0 - options.slowest) - 1.0)
    return max(slow, contraction / (1.0 - contraction))


def _load_factor_error(steps: Sequence[Step], options: FixedPointOptions) -> float:
    """Estimate of the error of the load factor from its last changes.

    Changes of one sign are a series of their own, which may creep where the bound converges fast.
    """
    last = steps[-4:]
    changes = np.diff([step.load_factor for step in last])
    if len(changes) == 0:
        return float(np.inf)
    largest = float(np.abs(changes).max())
    if len(changes) == 1:
        return largest
    series = largest * _series(steps, options)
    if not (np.all(changes > 0.0) or np.all(changes < 0.0)):
        return series
    omega = np.array([step.relaxation for step in last[:-1]])
    rates = changes / omega  # of the plain iteration, which relaxation speeds or slows
    secant = float(np.min((1.0 - rates[1:] / rates[:-1]) / omega[:-1]))
    creeps = abs(float(rates[-1])) * (1.0 / max(secant, 1.0 - options.slowest) - 1.0)
    return max(series, options.safety * creeps)


class _Relaxation:
    """Irons and Tuck's omega, capped where the iteration cycles.

    Attributes:
        cycles: How often a cycle was recognised.
        secant: Change of F r_N - g over that of g, 1 - c for a contraction c.
    """

    def __init__(self, total: Callable[[Array], float], options: FixedPointOptions) -> None:
        """Start with omega = 1; `total` sums an array over all ranks."""
        self._total, self._options = total, options
        self._last: Array | None = None
        self._omega = 1.0
        self._cap = options.relaxation[1]
        self._best, self._since = np.inf, 0
        self.cycles, self.secant = 0, 1.0

    def next(self, difference: Array, change: float) -> float:
        """Relaxation for a step with difference F r_N - g, of a size relative to F r_N."""
        options, last = self._options, self._omega
        self._omega = self._irons_tuck(difference)
        aligned = self._aligned(difference)
        if change < options.smaller * self._best:
            self._best, self._since = change, 0
        elif not aligned:
            self._since += 1
        if self._since >= options.cycle:
            self._cap = max(0.5 * min(self._cap, 1.0), options.relaxation[0])
            self._since = 0
            self.cycles += 1
        if self._omega <= 0.0:  # the change points the same way and grew: go on faster
            self._omega = 2.0 * last
        cap = options.fast if aligned and self.cycles == 0 else self._cap
        self._omega = float(np.clip(self._omega, options.relaxation[0], cap))
        self._last = difference
        return self._omega

    def _irons_tuck(self, difference: Array) -> float:
        if self._last is None:
            return self._omega
        step = difference - self._last
        square = self._total(step * step)
        moved = self._omega**2 * self._total(self._last * self._last)
        self.secant = float(np.sqrt(square / moved)) if moved > 0.0 else 1.0
        if not square > 0.0:
            return self._omega
        return -self._omega * self._total(self._last * step) / square

    def _aligned(self, difference: Array) -> bool:
        """Whether the change points where the last one did."""
        if self._last is None:
            return False
        sizes = self._total(difference**2) * self._total(self._last**2)
        return self._total(difference * self._last) > self._options.aligned * np.sqrt(sizes)
