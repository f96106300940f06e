"""The collapse of one load case: states at growing work of the live load until one is verified.

As the work T grows the load factor lambda(T) rises to the limit load and stays. A state is that of
the collapse if its certificate passes; the gap of the certificate, between the load factor and the
rigid-block program with the state's friction forces, tells how far the plateau is.
"""

from __future__ import annotations

import itertools
import logging
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fenics_contact.collapse.collapse_mode import Verified, verify
from fenics_contact.collapse.load_case import LoadCase, Task, joint_values
from fenics_contact.collapse.strategy import Strategy
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.programs import stiffness_alone
from fenics_contact.parallel import MPI
from fenics_contact.results.bounds import NOT_AT_THIS_SIZE
from fenics_contact.results.certificate import Certificate, state_residuals, worst_joint
from fenics_contact.results.history import History
from fenics_contact.results.result import Collapse
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.problem import State

_log = logging.getLogger("fenics_contact")


def find_collapse(case: LoadCase, strategy: Strategy, tolerance: float) -> Collapse:
    """The collapse of a load case, to a relative tolerance on the load factor.

    The plateau is the nearer the larger the work, and the longer the path. A tolerance that is
    looser than usual asks for less of both. Of thousands of blocks it is followed only if asked.

    Raises:
        Stopped: If the run is to end; the record of the load case has what was found.
    """
    solve = case.discretization.scene.solve
    if case.blocks.model.units.has_many_blocks and solve.engine == solve.method == "auto":
        why = f"the path of elastic blocks is {NOT_AT_THIS_SIZE}"
        return Collapse("not_converged", math.nan, case.blocks.bounds, reason=why)
    search = _Search(case, strategy, tolerance)
    options = strategy.options
    record = case.record
    record.exhausted = 0.0
    part = min(1.0, (SEARCH.usual_tolerance / tolerance) ** 0.5)
    first = max(options.first_work, options.work_of_many * case.block_count**2 * part)
    ratio = first
    missing = 0
    unlimited = False
    try:
        with case.discretization.effort.at_most(options.collapse_cost):
            while ratio <= SEARCH.largest * first and missing < options.works:
                found = search.at(ratio)
                missing = missing + 1 if found is None else 0
                if search.done(found):
                    break
                unlimited = search.unlimited
                if unlimited:
                    break
                ratio /= options.decade
        if unlimited:
            return search.result("unbounded")
        end = search.result("limit" if search.verified else "not_converged")
        if end.status == "limit":
            record.best = record.best or end
        return end
    except Stopped:
        if search.verified or (search.best is not None and record.best is None):
            record.best = search.result("limit" if search.verified else "not_converged")
        raise


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
    blocks = case.blocks
    stiff = blocks.on_root(lambda: stiffness_alone(blocks.model.planar.model))
    return None if stiff is None else stiff * case.scales.load_factor


class _Search:
    """States of a load case at different works, and the best of them."""

    def __init__(self, case: LoadCase, strategy: Strategy, tolerance: float) -> None:
        self.case = case
        self.strategy = strategy
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
        # From the last state, and from afar as long as none is verified.
        attempts = () if self.verified else self.strategy.attempts
        if self.best is not None:
            further = self.strategy.further
            attempts = (further, *attempts) if further is not None else self.strategy.attempts
        for attempt in attempts:
            if case.discretization.effort.left < 1.0:
                case.record.exhausted = case.discretization.effort.allowed
                return None
            count = case.discretization.factorizations
            try:
                with case.record.attempt(attempt, work, count, case.discretization.effort) as ended:
                    with case.discretization.effort.at_most(
                        0.5 * self.strategy.options.collapse_cost
                    ):
                        solution, history = attempt(task)
                    self._last_found = True
                    ended("a state, not yet verified")
                    case.record.phase("verification")
                    verified = verify(case, solution.state, scales, self.tolerance, self.gap)
                    certificate = verified.certificate.known_to(solution.change)
                    verified = replace(verified, certificate=certificate)
                    reached = solution.state.work / case.bonded_work
                    self.found.append(_Found(verified, history, reached))
                    outcome = "a state, verified"
                    if not self.found[-1].passed:
                        text = verified.certificate.missed
                        text = text or "load factor and friction not settled"
                        outcome = f"a state, not verified: {text}"
                    ended(outcome)
            except SolverError as error:
                _log.info("  no state with T = %.3g: %s", work, error)
                continue
            gap = verified.certificate.gap
            factor = solution.state.load_factor
            _log.info("  T = %.3g: load factor %.8g, gap %.1e, %s", work, factor, gap, outcome)
            return self.found[-1]
        return None

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
        # What is unlimited without friction is so with it: that program is needed anyway.
        if blocks.is_unlimited() and blocks.frictionless.is_unlimited():
            return True
        if self._line is None:  # does the load factor grow with the work?
            last = self.found[-3:]
            factors = np.array([one.load_factor for one in last])
            works = np.array([one.ratio for one in last])
            if len(last) < 3 or not np.all(factors > 0.0):
                return False
            grown = np.diff(np.log(factors)) >= (1.0 - SEARCH.decade) * np.diff(np.log(works))
            return bool(np.all(grown)) and blocks.is_unlimited()
        if not self._last_found:
            return True
        return self.found[-1].load_factor > SEARCH.decade * self._line * self.found[-1].ratio

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

    The state is moved back along its mode. Every state further along it has the same stresses and
    joint forces; at the first, some joint is about to close, or to stick. Where the digits there do
    not suffice, state and certificate are those far along the mode.
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
    if 0.0 < least < np.inf:
        # A mechanism does not strain the blocks: their strains keep the digits that they have.
        u = state.displacement - least * mode
        u += state.elastic - problem.elastic_part(u)
        state = replace(state, displacement=u, work=problem.dot(problem.live, u))
    scales = case.scales_at(max(abs(state.work), case.bonded_work), abs(state.load_factor))
    residuals = state_residuals(problem, state, scales)
    certificate = replace(
        verified.certificate,
        residuals=verified.certificate.residuals | residuals,
        worst_joint=worst_joint(problem, state, scales, case.discretization.operators.points),
    )
    if certificate.passed:
        return state, certificate
    _log.info("  the state is left far along its mode: %s", sorted(certificate.failures))
    return verified.state, verified.certificate
