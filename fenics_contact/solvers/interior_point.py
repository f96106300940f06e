"""States by a primal-dual interior point method.

A predictor-corrector method (S. Mehrotra, SIAM J. Optim. 2 (1992) 575) drives the products of the
perturbed conditions (`kkt`) to zero. With given friction the problem is convex and the method finds
its solution. With Coulomb friction it may stall, where the central path turns back (`arclength`).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.parallel import MPI
from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers.kkt import Iterate, PerturbedKKT, Residual
from fenics_contact.solvers.problem import Array, State

_log = logging.getLogger("fenics_contact")


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
    options: SearchOptions = SEARCH,
) -> Solution:
    """State of the conditions with products zero.

    Args:
        kkt: The conditions.
        start: State to start from; its joint forces need not be admissible.
        mu: Products of the first iterate, in units of force times displacement; below 1 for a
            state next to the solution.
        tolerances: How exact the state has to be.
        options: When to stop: `interior_steps`, `interior_window`, `digits`.

    Raises:
        SolverError: If neither the tolerance nor `digits` is reached.
    """
    asked = tolerances.residual
    anything = tolerances.load_factor == np.inf
    typical = SEARCH.small_factor * kkt.scales.load_factor
    now = best = kkt.on_central_path(start, mu, SEARCH.digits if mu >= 1.0 else 0.0)
    reached = np.inf  # error of the best iterate
    best_sizes: dict[str, float] = {}
    best_is_last = False
    settled = False  # whether the load factor hardly changed in the step to the best, or from it
    errors: list[float] = []
    since_exact = 0
    last, last_change, last_products = np.inf, 1.0, 1.0  # load factor, its change, mean product
    for step in range(options.interior_steps + 1):
        residual = kkt.residual(now)
        sizes = kkt.sizes(now, residual)
        error = float(np.max(list(sizes.values())))  # nan where any is nan
        _log.debug("    %2d  %.12g  %s", step, now.load_factor, sizes)
        # The rest of the load factor's change is to the last one as that is to the one before, or
        # as the products are.
        allowed = tolerances.load_factor * (abs(now.load_factor) + typical)
        change = abs(now.load_factor - last)
        products = sizes["complementarity"]
        falls = max(products / last_products, change / last_change if last_change else 0.0)
        quiet = anything or change <= allowed
        at_rest = anything or change * min(falls, 1.0) <= allowed
        last, last_change, last_products = now.load_factor, change, products
        exact = error <= asked
        if error < reached or exact:
            best = now
            best_sizes = sizes
            reached = error
            settled = quiet
            best_is_last = True
        else:
            settled = settled or (best_is_last and quiet)
            best_is_last = False
        since_exact += reached <= asked
        # Equilibrium loses digits while springs are stiff: it does not tell progress.
        joints = max(size for name, size in sizes.items() if name != "equilibrium")
        errors.append(float(np.nan_to_num(min([joints, *errors[-1:]]), nan=np.inf)))
        window = options.interior_window
        stalled = len(errors) > window and errors[-1] > 0.5 * errors[-1 - window]
        if (
            (exact and at_rest)
            or since_exact > SEARCH.resting_steps
            or stalled
            or not np.isfinite(error)
        ):
            break
        if step == options.interior_steps:
            break
        try:
            now = next_iterate(kkt, now, residual, SEARCH.least_products * asked)
        except SolverError as failure:
            _log.debug("    %s", failure)
            break
    if not reached <= max(asked, options.digits):
        raise SolverError(
            f"interior point: residual {reached:.1e} after {step} steps, asked {asked:.1e}"
        )
    if reached > asked and not settled:
        raise SolverError(f"interior point: load factor not settled after {step} steps")
    return Solution(kkt.state(best), best_sizes, step)


def next_iterate(kkt: PerturbedKKT, now: Iterate, residual: Residual, least: float) -> Iterate:
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
    (part,) = _lengths(kkt, towards[None])
    second = kkt.products(step)
    here = kkt.total(products)
    ahead = (1.0 - part) * here + part**2 * kkt.total(second)
    unit = kkt.scales.force * kkt.scales.displacement
    target = max(here / kkt.count * max(ahead / here, 0.0) ** 3, least * unit)
    rest = Residual(np.zeros_like(now.u), none, none, 0.0)
    (corrector,) = linear.directions([(rest, target - second)])
    weights = np.linspace(1.0, min(part, 1.0) ** 2, SEARCH.corrector_weights)
    ratios = towards + weights[:, None] * (corrector.positive / now.positive)
    lengths = _lengths(kkt, ratios)
    longest = int(np.argmax(lengths))
    length = float(lengths[longest])
    step = step.moved(float(weights[longest]), corrector)
    if length < SEARCH.decade:
        (step,) = linear.directions([(residual, here / kkt.count - products)])
        length = float(_lengths(kkt, (step.positive / now.positive)[None])[0])
    return now.moved(min(1.0, SEARCH.step_fraction * length), step)


def _lengths(kkt: PerturbedKKT, ratios: Array) -> Array:
    """Longest steps, at most 1 / step fraction, for directions relative to the iterate."""
    largest = np.max(-ratios, axis=1, initial=0.0)
    kkt.problem.comm.Allreduce(MPI.IN_PLACE, largest, MPI.MAX)
    return np.asarray(1.0 / np.maximum(largest, SEARCH.step_fraction))
