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
from fenics_contact.solvers.kkt import COLD, Iterate, Linearization, PerturbedKKT, Residual
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
        resting: Steps at most from the first iterate that is exact enough, while its load factor
            still changes.
        small_factor: Load factors are judged relative to themselves, or to this part of the
            typical one.
        step_fraction: Part of the way to the boundary that a step goes.
        least: Products that are aimed at, at least, in units of the tolerance.
        short: Length up to which a step is replaced by one to equal products.
        weights: Number of corrector weights that are tried.
        correctors: Centrality correctors at most, each one solve. With Coulomb friction only for
            the end of a central path: from elsewhere they may lead past folds to another state.
        longer: By how much they aim to make the step longer.
        central: Least and largest product that they leave alone, in units of the target.
        gain: Part of `longer` by which the step has to become longer for another one.
    """

    max_steps: int = 80
    window: int = 20
    acceptable: float = 1e-9
    resting: int = 3
    small_factor: float = 1e-3
    step_fraction: float = 0.995
    least: float = 1e-2
    short: float = 0.1
    weights: int = 9
    correctors: int = 0
    longer: float = 0.1
    central: tuple[float, float] = (0.1, 10.0)
    gain: float = 0.1


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
    """

    state: State
    residuals: dict[str, float]
    steps: int

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
    reached, best, sizes = progress.best
    if not reached <= max(tolerances.residual, options.acceptable):
        asked = f"{tolerances.residual:.1e}"
        raise SolverError(
            f"interior point: residual {reached:.1e} after {step} steps, asked {asked}"
        )
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
        self._tolerances, self._options = tolerances, options
        self._typical = options.small_factor * kkt.scales.load_factor
        self._errors: list[float] = []
        self._since_exact = 0
        self._last = np.inf, 1.0, 1.0  # load factor, its change, products

    def ended(self, now: Iterate, sizes: dict[str, float]) -> bool:
        """Whether an iterate is good enough, or the method has stalled."""
        error = float(np.max(list(sizes.values())))  # nan where any is nan
        _log.debug("    %2d  %.12g  %s", len(self._errors), now.load_factor, sizes)
        exact = error <= self._tolerances.residual
        if error < self.best[0] or exact:
            self.best = error, now, sizes
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
        errors, window = self._errors, self._options.window
        stalled = len(errors) > window and errors[-1] > 0.5 * errors[-1 - window]
        return stalled or not np.isfinite(error)

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
    step is longest (M. Colombo, J. Gondzio, Comput. Optim. Appl. 41 (2008) 277). Centrality
    correctors make it longer still. Where it is short all the same, the step is one to equal
    products. None aims at products below `least`: residuals that are left would no longer fall.
    """
    linear = kkt.linearize(now)
    products = kkt.products(now)
    (step,) = linear.directions([(residual, -products)])
    (part,) = _lengths(kkt, (step.positive / now.positive)[None], options)
    second = kkt.products(step)
    here = kkt.total(products)
    ahead = (1.0 - part) * here + part**2 * kkt.total(second)
    unit = kkt.scales.force * kkt.scales.displacement
    target = max(here / kkt.count * max(ahead / here, 0.0) ** 3, least * unit)
    corrector = _corrector(linear, target - second)
    weights = np.linspace(1.0, min(part, 1.0) ** 2, options.weights)
    step, length = _longest(kkt, now, step, corrector, weights, options)
    step, length = _centred(linear, step, length, target, options)
    if length < options.short:
        (step,) = linear.directions([(residual, here / kkt.count - products)])
        length = float(_lengths(kkt, (step.positive / now.positive)[None], options)[0])
    return now.moved(min(1.0, options.step_fraction * length), step)


def _centred(
    linear: Linearization,
    step: Iterate,
    length: float,
    target: float,
    options: InteriorPointOptions,
) -> tuple[Iterate, float]:
    """A step made longer by centrality correctors, and its length.

    A few products stop a step. At the end of one that is longer, those that are far smaller or
    larger than the target are brought back, on the same factor (J. Gondzio, Comput. Optim. Appl. 6
    (1996) 137).
    """
    kkt, now = linear.kkt, linear.now
    least, largest = (target * bound for bound in options.central)
    weights = np.linspace(1.0 / options.weights, 1.0, options.weights)
    for _ in range(options.correctors):
        if length >= 1.0:
            break
        ahead = kkt.products(now.moved(min(length + options.longer, 1.0), step))
        change = np.maximum(np.clip(ahead, least, largest) - ahead, -largest)
        corrector = _corrector(linear, change)
        better, reached = _longest(kkt, now, step, corrector, weights, options)
        if reached < length + options.gain * options.longer:
            break
        step, length = better, reached
    return step, length


def _corrector(linear: Linearization, change: Array) -> Iterate:
    """Direction that changes the products alone, shape (3, points)."""
    none = np.zeros_like(linear.now.y)
    rest = Residual(np.zeros_like(linear.now.u), none, none, 0.0)
    (corrector,) = linear.directions([(rest, change)])
    return corrector


def _longest(
    kkt: PerturbedKKT,
    now: Iterate,
    step: Iterate,
    corrector: Iterate,
    weights: Array,
    options: InteriorPointOptions,
) -> tuple[Iterate, float]:
    """The step with that weight of a corrector with which it is longest, and its length."""
    towards, further = step.positive / now.positive, corrector.positive / now.positive
    lengths = _lengths(kkt, towards + weights[:, None] * further, options)
    longest = int(np.argmax(lengths))
    return step.moved(float(weights[longest]), corrector), float(lengths[longest])


def _lengths(kkt: PerturbedKKT, ratios: Array, options: InteriorPointOptions) -> Array:
    """Longest steps, at most 1 / step fraction, for directions relative to the iterate."""
    largest = np.max(-ratios, axis=1, initial=0.0)
    kkt.problem.comm.Allreduce(MPI.IN_PLACE, largest, MPI.MAX)
    return np.asarray(1.0 / np.maximum(largest, options.step_fraction))
