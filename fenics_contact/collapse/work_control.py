"""The collapse of one load case: states at growing work of the live load until one is verified.

As the work T grows the load factor lambda(T) rises to the limit load and stays. A state is that of
the collapse if its certificate passes; the gap of the certificate, between the load factor and the
rigid-block program with the state's friction forces, tells how far the plateau is.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mpi4py import MPI

from fenics_contact.collapse.collapse_mode import Verified, verify
from fenics_contact.collapse.load_case import Attempt, LoadCase, Task, joint_values
from fenics_contact.collapse.reasons import missed
from fenics_contact.collapse.record import name_of
from fenics_contact.collapse.strategy import Strategy, first_work
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.faces.programs import stiffness_alone
from fenics_contact.results.certificate import Certificate, state_residuals, worst_joint
from fenics_contact.results.history import History
from fenics_contact.results.result import Collapse
from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers.problem import State

_log = logging.getLogger("fenics_contact")


def find_collapse(case: LoadCase, strategy: Strategy, tolerance: float) -> Collapse:
    """The collapse of a load case, to a relative tolerance on the load factor.

    Raises:
        Stopped: If the run is to end; the record of the load case has what was found.
    """
    search = _Search(case, strategy, tolerance)
    case.record.exhausted = 0.0
    try:
        with case.discretization.effort.at_most(strategy.options.collapse_cost):
            status = _at_growing_work(search, strategy.options, case.block_count)
        found = search.result(status)
        if status == "limit":
            case.record.best = case.record.best or found
        return found
    except Stopped:
        if search.verified or (search.best is not None and case.record.best is None):
            status = "limit" if search.verified else "not_converged"
            case.record.best = search.result(status)
        raise


def _at_growing_work(search: _Search, options: SearchOptions, blocks: int) -> str:
    """The status that states by the attempts of a search lead to."""
    ratio = first = first_work(options, blocks, search.tolerance)
    missing = 0
    while ratio <= SEARCH.largest * first and missing < options.works:
        found = search.at(ratio)
        missing = missing + 1 if found is None else 0
        if search.done(found):
            break
        if search.unlimited:
            return "unbounded"
        ratio *= options.work_growth
    return "limit" if search.verified else "not_converged"


@dataclass(frozen=True)
class _Found:
    """A verified state at a work T, in units of that on the bonded structure."""

    verified: Verified
    history: History
    ratio: float

    @property
    def load_factor(self) -> float:
        return self.verified.state.load_factor

    @property
    def outcome(self) -> str:
        """Whether it is verified, in words."""
        if self.passed:
            return "a state, verified"
        text = missed(self.verified.certificate) or "load factor and friction not settled"
        return f"a state, not verified: {text}"

    @property
    def passed(self) -> bool:
        return self.history.converged and self.verified.certificate.passed

    @property
    def gap(self) -> float:
        gap = self.verified.certificate.gap if self.history.converged else np.inf
        return gap if np.isfinite(gap) else np.inf


def growth(case: LoadCase) -> float | None:
    """Load factor per ratio of works under the live load alone; None if that has no state.

    The state is that of joint faces, with Coulomb's law. Associative friction must not limit the
    load either. Collective.
    """
    if not case.blocks.is_unlimited():
        return None
    faces = PlanarFaces.of(case.discretization, case.sign)
    stiff = stiffness_alone(faces.model) if case.problem.comm.rank == 0 else None
    stiff = case.problem.comm.bcast(stiff)
    return None if stiff is None else stiff * case.scales.load_factor


class _Search:
    """States of a load case at different works, and the best of them."""

    def __init__(self, case: LoadCase, strategy: Strategy, tolerance: float) -> None:
        self.case = case
        self.strategy = strategy
        self.options = strategy.options
        self.tolerance = tolerance
        self.gap = strategy.options.work_gap * tolerance
        self.found: list[_Found] = []
        self._last_found = False

    def at(self, ratio: float) -> _Found | None:
        """The verified state at a work T, in units of that on the bonded structure, if any."""
        case = self.case
        work = ratio * self.case.bonded_work
        scales = case.scales_at(work, max((abs(one.load_factor) for one in self.found), default=0))
        last = self.found[-1].verified.state if self.found else None
        task = Task(case, work, scales, self.tolerance, last)
        self._last_found = False
        for attempt in self._attempts():
            if case.discretization.effort.left < 1.0:
                case.record.exhausted = case.discretization.effort.allowed
                return None
            count = case.discretization.factorizations
            try:
                with case.record.attempt(
                    name_of(attempt), work, count, case.discretization.effort
                ) as ended:
                    with case.discretization.effort.at_most(self.options.attempt_cost):
                        solution, history = attempt(task)
                    self._last_found = True
                    ended("a state, not yet verified")
                    case.record.phase("verification")
                    verified = verify(case, solution.state, scales, self.tolerance, self.gap)
                    verified = verified.known_to(solution.change)
                    reached = solution.state.work / case.bonded_work
                    self.found.append(_Found(verified, history, reached))
                    ended(self.found[-1].outcome)
            except SolverError as error:
                _log.info("  no state with T = %.3g: %s", work, error)
                continue
            gap = verified.certificate.gap
            factor = solution.state.load_factor
            outcome = self.found[-1].outcome
            _log.info("  T = %.3g: load factor %.8g, gap %.1e, %s", work, factor, gap, outcome)
            return self.found[-1]
        return None

    def _attempts(self) -> Iterator[Attempt]:
        """What is tried: from the last state, and from afar as long as none is verified."""
        strategy = self.strategy
        if self.best is not None and strategy.further is not None:
            yield strategy.further
            if self.verified:
                return
        yield from strategy.attempts

    @property
    def best(self) -> _Found | None:
        """The state to be reported: verified rather than not, then the one with the least gap."""
        if not self.found:
            return None
        return min(self._of_one_state, key=lambda one: (not one.passed, one.gap))

    @property
    def _of_one_state(self) -> list[_Found]:
        """States found, up to the first that is another collapse state than a verified one before.

        More work leaves the load factor of a collapse state as it is. At large works, rounding may
        lead to another one.
        """
        for count, (before, after) in enumerate(itertools.pairwise(self.found), start=1):
            allowed = SEARCH.same_state * before.gap * before.verified.certificate.size
            if before.passed and abs(after.load_factor - before.load_factor) > allowed:
                return self.found[:count]
        return self.found

    @property
    def verified(self) -> bool:
        """Whether the best state passes its certificate."""
        return self.best is not None and self.best.passed

    def done(self, last: _Found | None) -> bool:
        """Whether the best state is the collapse to the tolerance, or the last one no better."""
        best = self.best
        if best is None or not best.passed:
            return False
        if last is None or best.gap <= self.gap or len(self._of_one_state) < len(self.found):
            return True
        before = min((one.gap for one in self.found[:-1]), default=np.inf)
        return last.gap > before

    @property
    def unlimited(self) -> bool:
        """Whether nothing limits the load, by the load factors found and the rigid-block programs.

        Without Coulomb friction the upper bound is exact; the lower one is a bound in any case.
        Where the upper one is infinite, a state under the live load alone holds at all its sizes.
        Then a large load does without the dead load, if no state was found; and a load factor that
        follows that line is on it.
        """
        if not self.strategy.asks:
            return False
        blocks = self.case.blocks
        if not self.case.problem.coulomb:
            return blocks.is_unlimited()
        if blocks.frictionless.is_unlimited():
            return True
        if self._line is None:
            return self._grows and blocks.is_unlimited()
        last = self.found[-1] if self._last_found else None
        return last is None or last.load_factor > SEARCH.on_line * self._line * last.ratio

    @property
    def _grows(self) -> bool:
        """Whether the last load factors have grown with their works."""
        factors = np.array([one.load_factor for one in self.found[-3:]])
        if len(factors) < 3 or not np.all(factors > 0.0):
            return False
        works = np.array([one.ratio for one in self.found[-3:]])
        grown = np.diff(np.log(factors)) >= SEARCH.grows * np.diff(np.log(works))
        return bool(np.all(grown))

    @cached_property
    def _line(self) -> float | None:
        return growth(self.case)

    def result(self, status: str) -> Collapse:
        """Report the best state."""
        case = self.case
        best = self.best
        wedging = case.blocks.wedging() if status == "unbounded" else None
        histories = tuple(one.history for one in self.found)
        if best is None:
            factor = np.inf if status == "unbounded" else np.nan
            return Collapse(
                status, float(factor), case.blocks.bounds, history=histories, wedging=wedging
            )
        state = best.verified.state
        certificate = best.verified.certificate
        if status == "not_converged":
            _log.info("not verified: %s", certificate.failures or "not converged")
        elif status == "limit":
            if best.gap > self.tolerance:
                text = "the load factor is known to %.1e, not to the tolerance asked"
                _log.warning(text, best.gap)
            state, certificate = _at_onset(case, best.verified)
        mode = best.verified.mode
        return Collapse(
            status,
            np.inf if status == "unbounded" else state.load_factor,
            case.blocks.bounds,
            state,
            mode,
            joint_values(case.problem, case.discretization, state, mode),
            certificate,
            histories,
            best.ratio,
            wedging=wedging,
        )


def _at_onset(case: LoadCase, verified: Verified) -> tuple[State, Certificate]:
    """The state where the collapse begins, and its certificate on its own scale.

    They are those far along the mode where the digits at the onset do not suffice.
    """
    state = _onset(case, verified)
    certificate = verified.certificate
    work = max(abs(state.work), case.bonded_work)
    scales = case.scales_at(work, abs(state.load_factor))
    certificate = replace(
        certificate,
        residuals=certificate.residuals | state_residuals(case.problem, state, scales),
        worst_joint=worst_joint(case.problem, state, scales, case.discretization.operators.points),
    )
    if certificate.passed:
        return state, certificate
    _log.info("  the state is left far along its mode: %s", sorted(certificate.failures))
    return verified.state, verified.certificate


def _onset(case: LoadCase, verified: Verified) -> State:
    """The state moved back along its mode to where the collapse began.

    Every state further along the mode has the same stresses and joint forces; at the first, some
    joint is about to close, or to stick.
    """
    problem = case.problem
    state = verified.state
    mode = verified.mode
    opening, slip = problem.motion_of(state)
    opening = problem.law.clearance(opening, slip)
    opening_rate = problem.clearance_rates(mode)
    slip_rate = problem.tangential @ mode
    # The work by which a joint that moves in the mode has moved so far.
    tiny = 1e-6 * problem.max(np.maximum(np.abs(opening_rate), np.abs(slip_rate)))
    opens = opening_rate > tiny
    slips = np.abs(slip_rate) > tiny
    slips &= (state.pressure > 0.0) | (problem.law.dilatancy > 0.0) | (problem.law.apart > 0.0)
    moved = [opening[opens] / opening_rate[opens], slip[slips] / slip_rate[slips]]
    least = min(float(np.min(m, initial=np.inf)) for m in moved)
    least = problem.comm.allreduce(least, MPI.MIN)
    if not 0.0 < least < np.inf:
        return state
    # A mechanism does not strain the blocks: their strains keep the digits that they have.
    u = state.displacement - least * mode
    u += state.elastic - problem.elastic_part(u)
    return replace(state, displacement=u, work=problem.dot(problem.live, u))
