"""States by a primal-dual interior point method.

A predictor-corrector method (S. Mehrotra, SIAM J. Optim. 2 (1992) 575) drives the products of the
perturbed conditions (`kkt`) to zero. With given friction the problem is convex and the method finds
its solution. With Coulomb friction it may stall, where the central path turns back (`arclength`).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact.errors import SolverError
from fenics_contact.solvers.kkt import COLD, Iterate, PerturbedKKT, Residual
from fenics_contact.solvers.problem import Array, State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class InteriorPointOptions:
    """When the method stops.

    Attributes:
        max_steps: Steps at most.
        window: Steps over which the error has to halve; else the method has stalled.
        acceptable: Error up to which a stalled state is accepted where less was asked for: at the
            limit load digits are lost. What it is worth the certificate tells.
        settled: Change of the load factor in the step to such a state at most, in units of that
            of `Tolerances`. The certificate takes the state's forces for given: it does not tell
            that they still change.
        resting: Steps at most from the first iterate that is exact enough, while its load factor
            still changes.
        small_factor: Load factors are judged relative to themselves, or to this part of the
            typical one.
        step_fraction: Part of the way to the boundary that a step goes.
        least: Products that are aimed at, at least, in units of the tolerance.
        short: Length up to which a step is replaced by one to equal products.
        weights: Number of corrector weights that are tried.
    """

    max_steps: int = 80
    window: int = 20
    acceptable: float = 1e-9
    settled: float = 20.0
    resting: int = 3
    small_factor: float = 1e-3
    step_fraction: float = 0.995
    least: float = 1e-2
    short: float = 0.1
    weights: int = 9


@dataclass(frozen=True)
class Tolerances:
    """How exact a state has to be.

    Attributes:
        residual: Of the largest residual, relative to `Scales`.
        load_factor: Change that the load factor may still make as the products go to zero,
            relative; infinite: any.
    """

    residual: float = 1e-12
    load_factor: float = np.inf


@dataclass(frozen=True)
class Solution:
    """A state and how exact it is.

    Attributes:
        state: The state.
        residuals: Relative sizes of all conditions at it, recomputed.
        steps: Steps taken, each one factorisation.
        change: Of the load factor, relative, that is left as the products go to zero.
    """

    state: State
    residuals: dict[str, float]
    steps: int
    change: float = 0.0

    @property
    def error(self) -> float:
        """The largest residual; nan where any is nan."""
        return float(np.max(list(self.residuals.values())))


def solve_interior_point(
    kkt: PerturbedKKT,
    start: State,
    mu: float,
    tolerances: Tolerances,
    options: InteriorPointOptions | None = None,
) -> Solution:
    """State of the conditions with products zero.

    Args:
        kkt: The conditions.
        start: State to start from; its joint forces need not be admissible.
        mu: Products of the first iterate, in units of force times displacement; below 1 for a
            state next to the solution.
        tolerances: How exact the state has to be.
        options: When to stop.

    Raises:
        SolverError: If neither the tolerance nor `options.acceptable` is reached.
    """
    options = options or InteriorPointOptions()
    now = kkt.on_central_path(start, mu, COLD if mu >= 1.0 else 0.0)
    progress = _Progress(kkt, now, tolerances, options)
    for step in range(options.max_steps + 1):
        residual = kkt.residual(now)
        if progress.ended(now, kkt.sizes(now, residual)) or step == options.max_steps:
            break
        try:
            now = next_iterate(kkt, now, residual, options.least * tolerances.residual, options)
        except SolverError as error:
            _log.debug("    %s", error)
            break
    progress.check(step)
    _, best, sizes = progress.best
    return Solution(kkt.state(best), sizes, step)


class _Progress:
    """The best iterate so far with its error and sizes, and whether more steps lead on."""

    def __init__(
        self,
        kkt: PerturbedKKT,
        start: Iterate,
        tolerances: Tolerances,
        options: InteriorPointOptions,
    ) -> None:
        self.best: tuple[float, Iterate, dict[str, float]] = np.inf, start, {}
        #: Whether the load factor hardly changed in the step to the best iterate, or from it.
        self.settled = False
        self._best_is_last = False
        self._tolerances = tolerances
        self._options = options
        self._typical = options.small_factor * kkt.scales.load_factor
        self._errors: list[float] = []
        self._since_exact = 0
        self._last = np.inf, 1.0, 1.0  # load factor, its change, products

    def ended(self, now: Iterate, sizes: dict[str, float]) -> bool:
        """Whether an iterate is good enough, or the method has stalled."""
        error = float(np.max(list(sizes.values())))  # nan where any is nan
        _log.debug("    %2d  %.12g  %s", len(self._errors), now.load_factor, sizes)
        exact = error <= self._tolerances.residual
        settled = self._change(now.load_factor) <= self._options.settled
        better = error < self.best[0] or exact
        if better:
            self.best = error, now, sizes
            self.settled = settled
        elif self._best_is_last:
            self.settled = self.settled or settled
        self._best_is_last = better
        # Equilibrium loses digits while springs are stiff: it does not tell progress.
        joints = max(size for name, size in sizes.items() if name != "equilibrium")
        self._errors.append(float(np.nan_to_num(min([joints, *self._errors[-1:]]), nan=np.inf)))
        at_rest = self._at_rest(now.load_factor, sizes["complementarity"])
        if exact and at_rest:
            return True
        if self.best[0] <= self._tolerances.residual:
            self._since_exact += 1
            if self._since_exact > self._options.resting:
                return True
        errors = self._errors
        window = self._options.window
        stalled = len(errors) > window and errors[-1] > 0.5 * errors[-1 - window]
        return stalled or not np.isfinite(error)

    def check(self, steps: int) -> None:
        """Raise `SolverError` if the best iterate after so many steps is not good enough."""
        reached = self.best[0]
        asked = self._tolerances.residual
        if not reached <= max(asked, self._options.acceptable):
            raise SolverError(
                f"interior point: residual {reached:.1e} after {steps} steps, asked {asked:.1e}"
            )
        if reached > asked and not self.settled:
            raise SolverError(f"interior point: load factor not settled after {steps} steps")

    def _change(self, factor: float) -> float:
        """Change of the load factor since the iterate before, in units of the one allowed."""
        if self._tolerances.load_factor == np.inf:
            return 0.0
        allowed = self._tolerances.load_factor * (abs(factor) + self._typical)
        return abs(factor - self._last[0]) / allowed if allowed else np.inf

    def _at_rest(self, factor: float, products: float) -> bool:
        """Whether the rest of the load factor's change is small.

        It is to the last change as that is to the one before, or as the products are.
        """
        last, moved_before, products_before = self._last
        moved = abs(factor - last)
        falls = max(products / products_before, moved / moved_before if moved_before else 0.0)
        self._last = factor, moved, products
        allowed = self._tolerances.load_factor
        return bool(
            allowed == np.inf or moved * min(falls, 1.0) <= allowed * (abs(factor) + self._typical)
        )


def next_iterate(
    kkt: PerturbedKKT, now: Iterate, residual: Residual, least: float, options: InteriorPointOptions
) -> Iterate:
    """The iterate one predictor-corrector step on.

    The corrector takes the second-order part of the whole predictor from the products, of which
    only a part may be taken. It has the weight, from 1 to the square of that part, with which the
    step is longest (M. Colombo, J. Gondzio, Comput. Optim. Appl. 41 (2008) 277). Where it is short
    all the same, the step is one to equal products. None aims at products below `least`: residuals
    that are left would no longer fall.
    """
    linear = kkt.linearize(now)
    products = kkt.products(now)
    none = np.zeros_like(now.y)
    (step,) = linear.directions([(residual, -products)])
    towards = step.positive / now.positive
    (part,) = _lengths(kkt, towards[None], options)
    second = kkt.products(step)
    here = kkt.total(products)
    ahead = (1.0 - part) * here + part**2 * kkt.total(second)
    unit = kkt.scales.force * kkt.scales.displacement
    target = max(here / kkt.count * max(ahead / here, 0.0) ** 3, least * unit)
    rest = Residual(np.zeros_like(now.u), none, none, 0.0)
    (corrector,) = linear.directions([(rest, target - second)])
    weights = np.linspace(1.0, min(part, 1.0) ** 2, options.weights)
    ratios = towards + weights[:, None] * (corrector.positive / now.positive)
    lengths = _lengths(kkt, ratios, options)
    longest = int(np.argmax(lengths))
    length = float(lengths[longest])
    step = step.moved(float(weights[longest]), corrector)
    if length < options.short:
        (step,) = linear.directions([(residual, here / kkt.count - products)])
        length = float(_lengths(kkt, (step.positive / now.positive)[None], options)[0])
    return now.moved(min(1.0, options.step_fraction * length), step)


def _lengths(kkt: PerturbedKKT, ratios: Array, options: InteriorPointOptions) -> Array:
    """Longest steps, at most 1 / step fraction, for directions relative to the iterate."""
    largest = np.max(-ratios, axis=1, initial=0.0)
    kkt.problem.comm.Allreduce(MPI.IN_PLACE, largest, MPI.MAX)
    return np.asarray(1.0 / np.maximum(largest, options.step_fraction))
