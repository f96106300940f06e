"""The peak: the most that the loading path carries before it falls to the collapse.

It is told beside the collapse, which is never above it, wherever a path of elastic blocks leads to
the collapse.

With Coulomb friction the load factor lambda(T) need not rise to its plateau: joints that stick at
first slip later, and it falls. A slowly raised load ends at the highest point of that path. Between
two changes of contact the structure is linear, so lambda(T) is made of straight pieces of slope

    d(lambda)/dT = 1 / (f_L . A^-1 f_L),   A as in `kkt`,

and a peak is where the slope changes its sign, or where the path turns back.

1. The path on block modes that led to the collapse has load factors with products zero, to first
   order. If none is above the collapse, there is no peak.
2. No state is above the associative program of rigid blocks (D.C. Drucker, J. Appl. Mech. 21
   (1954) 71): where the collapse reaches it there is none. Else the path of block modes is followed
   with small products.
3. Where that is above the collapse, the structure's path is followed from a point before, with
   smaller and smaller products, until it has fallen or turned back. The highest point is settled,
   and tangents on both sides lead to the summit. Where a state has a slightly higher load factor
   the climb goes on there, over small dips.

The peak depends on stiffness and mesh, and a path may have several: it is a lower bound of what
the model carries.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from fenics_contact.answers.question import Asked, MeshQuestion, Reasons
from fenics_contact.collapse.collapse_mode import rates
from fenics_contact.collapse.load_case import LoadCase, LoadingPath, Task
from fenics_contact.collapse.record import PathSample, Sample
from fenics_contact.collapse.service_state import service_state
from fenics_contact.collapse.strategy import (
    FINISHING,
    WarmStart,
    coulomb_equilibrium,
    from_next_to,
    next_to,
)
from fenics_contact.errors import EffortError, SolverError
from fenics_contact.results.bounds import alike
from fenics_contact.results.certificate import state_residuals, tolerances
from fenics_contact.results.history import Peak
from fenics_contact.results.result import Collapse
from fenics_contact.results.wording import Line, Wording, four
from fenics_contact.scene.scene import BY_FIXED_POINT, SolveOptions
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.arclength import PathPoint
from fenics_contact.solvers.interior_point import Tolerances
from fenics_contact.solvers.problem import Array, State

_log = logging.getLogger("fenics_contact")

#: Why a peak is not known, for people.
NOT_ASKED = "solve.peak = false; solve.peak = true looks for it"
FAST = "solve.fast = true leaves it out"
NO_PATH = "the loading path was not followed to its end"
TEARS = "what joints carry before they tear depends on the way of the load"
TOO_DEAR = "the search takes more work than allowed; solve.peak = true allows more"
OTHER_METHOD = "this method does not look for it; solve.method = 'auto' does"
FELL = "the load factor fell on the way to the collapse: more may have been carried"
MODES_ONLY = "block modes carry more than the collapse, and the structure was not found to"

#: Phase of the path to the collapse on block modes.
ON_THE_WAY = "block modes, rising work"
#: Products on block modes where the path is lost with smaller ones; on the structure they are a
#: decade smaller, and two to the peak.
LARGER = SEARCH.rising_products * SEARCH.decade
#: Steps of the work on block modes: peaks are narrow;
ON_MODES = replace(SEARCH, path_change=SEARCH.peak_change)
#: and on the structure, whose path is followed for a short way only.
ON_STRUCTURE = replace(SEARCH, path_change=SEARCH.decade)


def _unforced(question: MeshQuestion) -> bool:
    """Whether neither a capacity curve nor a load that rises step by step tells it anyway."""
    return not question.by_curve and not question.by_rising_load()


class PeakAnswer(Asked):
    """The most that the loading path carries, a `Peak`.

    None with given friction, where it is the load factor itself, and where there is no limit.
    """

    value: Peak
    name = key = seconds = "peak"
    place = 3
    begins = "peak of the loading path"
    option = "peak of the loading path looked for"
    of_curve = True
    unless: ClassVar[Reasons] = (
        (lambda question: question.end.engine == "faces", NO_PATH),
        (MeshQuestion.loses_strength, TEARS),
        (lambda question: _unforced(question) and question.options.fast, FAST),
        (lambda question: _unforced(question) and question.options.peak is False, NOT_ASKED),
        (lambda question: question.options.method in BY_FIXED_POINT, OTHER_METHOD),
    )

    @property
    def of_path(self) -> bool:
        """Unless a path was followed."""
        return self.value.status == "not_known"

    @classmethod
    def is_asked(cls, options: SolveOptions) -> bool:
        """Always: where it is left out it is said to be not known."""
        return True

    @classmethod
    def concerns(cls, question: MeshQuestion) -> bool:
        """Whether friction is Coulomb's."""
        return question.end.state is not None and question.case.problem.coulomb

    @classmethod
    def not_known(cls, reason: str) -> Self:
        """That the peak is not known."""
        return cls(Peak("not_known", reason=reason))

    @classmethod
    def run(cls, question: MeshQuestion) -> tuple[Self | None, Collapse]:
        """The peak of the path to a collapse; if it is asked for, at any cost."""
        end = question.end
        case = question.case
        if end.path is not None:
            last = end.path.steps[-1]
            if end.path.lower - end.load_factor <= SEARCH.higher * end.size:
                return cls(Peak("none")), end
            carried = end.path.lower, end.path.upper, last.work, last.displacement
            return cls(Peak("found", *carried)), end
        at_any_cost = question.by_curve or bool(question.options.peak)
        peak = find_peak(case, end, question.cost, at_any_cost)
        if at_any_cost and peak.status == "found":
            # It comes with the next load factor, if `equilibrium()` finds no state there either:
            # its search is taken to its end, which may cost as much as a rising load.
            beyond = peak.load_factor + 5.0 * SEARCH.side_accuracy * end.size
            effort = case.discretization.effort
            with effort.at_most(SEARCH.iterated_cost):
                state = service_state(case.unrecorded, beyond)
                if state.status != "equilibrium" and effort.left >= 1.0:
                    peak = replace(peak, not_found_at=beyond)
        return cls(peak), end

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """What is carried on the way to the collapse."""
        peak = self.value
        only_more = self.seconds not in words.asked
        if peak.status == "none":
            none = "none found, the load factor rises to that of the collapse"
            return [Line("peak:", none, verbose=only_more)]
        if peak.status == "not_known":
            return [Line("peak:", f"not known, {peak.reason}", verbose=only_more)]
        carried = four(words.number(peak.load_factor, end.sign))
        unit = words.unit if words.unit != "times" else f"times the {words.noun}"
        told = (
            f"on the way at least {carried} {unit} was carried at"
            f" {words.units.small(peak.displacement_m)} (it depends on stiffness and mesh)"
        )
        return [Line("peak:", told)]

    def marks(self, end: Collapse) -> Iterator[tuple[str, float, float]]:
        """Its place on the capacity curve."""
        peak = self.value
        if peak.status == "found":
            text = f"peak, at least {alike(peak.load_factor, end.load_factor)}"
            yield text, peak.displacement_m, peak.load_factor


def warm(*products: float) -> WarmStart:
    """How states are found, soon or not at all, from products that fit the way to them."""
    exact = Tolerances(SEARCH.digits, SEARCH.usual_tolerance)
    return WarmStart(products, (), exact, FINISHING)


def find_peak(case: LoadCase, end: Collapse, cost: float, at_any_cost: bool = False) -> Peak:
    """The peak of the loading path of a load case with Coulomb friction.

    Args:
        case: The load case; its record has the path of block modes to the collapse, if known.
        end: Its collapse.
        cost: Of the collapse, in units of one factorisation of the structure.
        at_any_cost: Whether hundreds of factorisations may be made, and the path of the structure
            itself is followed where block modes have no peak.
    """
    path = np.array([one.load_factor for one in case.record.trace if one.phase == ON_THE_WAY])
    fell = np.max(np.maximum.accumulate(path) - path, initial=0.0) > SEARCH.dip * end.size
    search = _PeakSearch(case, end)
    stays_below = search.stays_below(case.record.risen)
    if stays_below and not (fell or at_any_cost):
        return Peak("none")
    upper = case.blocks.limit()
    if upper is not None:
        if search.above(upper) <= SEARCH.higher:
            return Peak("none")
        search.upper = upper
    effort = case.discretization.effort
    seen = SEARCH.peak_asked if at_any_cost else SEARCH.peak_seen
    if case.block_count >= SEARCH.peak_blocks and not at_any_cost:
        seen = 0.0
    seen_at = effort.spent + seen * cost
    found_at = effort.spent + SEARCH.peak_asked * cost
    none = Peak("not_known", reason=FELL) if fell else Peak("none")
    tries = [
        (True, SEARCH.end_products * SEARCH.decade),
        (True, LARGER),
    ]
    tries = [] if stays_below else tries
    if at_any_cost:
        tries.append((False, LARGER * SEARCH.decade))
    peak = none
    for on_modes, products in tries:
        try:
            with effort.at_most(seen_at - effort.spent):
                points = search.seen(products, on_modes)
            if points:
                with effort.at_most(found_at - effort.spent):
                    return search.peak(points)
            peak = none if on_modes else Peak("none")
            if not at_any_cost:
                return peak
        except EffortError:
            return Peak("not_known", reason=TOO_DEAR)
        except SolverError as error:
            _log.info("  peak: %s", error)
            peak = Peak("not_known", reason=str(error))
    return peak


@dataclass(frozen=True)
class _Settled(Sample):
    """A verified state of the structure with products zero, and its rate du/dT."""

    rate: Array


class _PeakSearch:
    """The search for the highest point of one path, on block modes and then on the structure.

    Attributes:
        upper: No state has a higher load factor.
        best: The highest verified state so far; None if there is none.
    """

    def __init__(self, case: LoadCase, end: Collapse) -> None:
        self.case = replace(case.unrecorded, monitor=lambda step: None)
        self._load_factor = end.load_factor
        self._size = end.size
        self._onset = 0.0 if end.state is None else end.state.work
        # The path is on its plateau there, as far as it is worth looking.
        self._end = max(SEARCH.first_work * case.bonded_work, 2.0 * self._onset)
        self.upper = math.inf
        self.best: _Settled | None = None

    def above(self, load_factor: float) -> float:
        """How much higher than the collapse a load factor is, relative."""
        return (load_factor - self._load_factor) / self._size

    def stays_below(self, samples: Sequence[PathSample]) -> bool:
        """Whether a path of block modes to the collapse, with products zero, is never above it.

        It ends on the plateau, which lasts: past the onset the collapse goes on as it is.
        """
        if len(samples) < 3 or self.above(samples[-1].load_factor) < -SEARCH.far_apart:
            return False  # nothing was seen of it, or it led elsewhere
        for sample in samples[1:]:
            height = self.above(sample.level)
            if sample.work >= self._onset and abs(height) <= SEARCH.far_apart:
                return True
            if height > SEARCH.higher:
                return False
        return True

    def _task(self, work: float) -> Task:
        scales = self.case.scales_at(work, self._load_factor)
        return Task(self.case, work, scales, tolerance=SEARCH.usual_tolerance)

    def seen(self, products: float, on_modes: bool = True) -> list[PathSample]:
        """Points of a path from which that of the structure may be followed, the best first.

        They go back from the highest point, or the last rising one before it. Empty if no point is
        above the collapse, with products zero.

        Raises:
            SolverError: If the path is lost, or ends at another collapse state.
        """
        case = self.case
        above = self.above
        task = self._task(self._end)
        path = LoadingPath.on_modes(task) if on_modes else LoadingPath(task)
        # Nothing is stiffer than the bonded structure, and joints are open by then.
        first = max(1.5 * self._load_factor / case.scales.load_factor, 0.1) * case.bonded_work
        samples: list[PathSample] = []
        for sample in path.points(path.begin(first, task.mu(products)), None, ON_MODES, True):
            if sample.on_the_way:
                samples.append(sample)
            flat = [abs(above(one.load_factor)) <= SEARCH.higher for one in samples[-2:]]
            past = any(flat[-1:]) and sample.work > 1.05 * self._onset
            if past or sum(flat) > 1:
                break
        if len(samples) < 2:
            raise SolverError("the path of block modes ends where it begins")
        bias = max(samples[-1].load_factor - self._load_factor, 0.0)
        if above(samples[-1].load_factor) < -SEARCH.far_apart:
            raise SolverError("the path of block modes ends at another collapse state")
        heights = [above(min(one.level, one.load_factor - bias)) for one in samples]
        k = int(np.argmax(heights[1:])) + 1
        if heights[k] <= SEARCH.higher:
            return []
        while k > 1 and samples[k].slope <= 0.0:
            k -= 1
        return [replace(one, state=path.prolonged(one.state)) for one in samples[k:0:-1]]

    def peak(self, points: Sequence[PathSample]) -> Peak:
        """The summit next to points of block modes, over small dips."""
        beyond = 5.0 * SEARCH.side_accuracy * self._size
        try:
            here = self._begun(points)
            while self._found(self._summit(here)) and self.best is not None:
                target = self.best.load_factor + beyond
                if target >= self.upper:
                    break
                near = self._task(self.best.work), self.best.state
                here = self._verified(
                    coulomb_equilibrium(*near, target, warm(SEARCH.end_products * SEARCH.decade))
                )
        except SolverError as error:
            if not self._found(self.best):
                raise
            _log.info("  peak: %s", error)
        if self.best is None or not self._found(self.best):
            return Peak("not_known", reason=MODES_ONLY)
        state = self.best.state
        work = self.case.written(state).work
        moved = work / self.case.problem.sum(np.abs(self.case.problem.live))
        return Peak("found", state.load_factor, work=work, displacement_m=moved, state=state)

    def _found(self, state: Sample | None) -> bool:
        return state is not None and self.above(state.load_factor) > SEARCH.higher

    def _begun(self, points: Sequence[PathSample]) -> _Settled:
        """A state next to the highest point of the structure's path.

        That path begins at the first of some points from which it can be followed.
        """
        for near in points:
            task = self._task(near.work)
            path = LoadingPath(task)
            far = task.mu(LARGER * SEARCH.decade)
            close = SEARCH.decade * far
            try:
                start = path.with_products(path.next_to(near.state, far), close)
                highest = self._highest(path, start)
                top = self._task(highest.work)
                first = warm(SEARCH.end_products * SEARCH.decade**2, SEARCH.end_products)
                return self._verified(from_next_to(top, top.kkt, highest.state, first).state)
            except SolverError as error:
                self.case.discretization.effort.require(1.0)
                failed = error
        raise failed

    def _highest(self, path: LoadingPath, start: PathPoint) -> PathSample:
        """Where the structure's path is highest before it falls or turns back, by tangents.

        Raises:
            SolverError: If the path is lost at once, or not above the collapse.
        """
        size = self._size
        points: list[PathSample] = []
        top = 0
        try:
            for new in path.points(start, self._end, ON_STRUCTURE):
                points.append(new)
                if new.load_factor > points[top].load_factor:
                    top = len(points) - 1
                fallen = (points[top].load_factor - new.load_factor) / size
                plateau = abs(self.above(new.load_factor)) <= SEARCH.higher
                plateau &= abs(new.slope * new.work) <= 1e-2 * size
                turned = fallen > 0.0 and new.work < points[top].work
                if turned or plateau or fallen > SEARCH.higher:
                    break
        except SolverError as error:
            self.case.discretization.effort.require(1.0)
            _log.info("  peak: %s", error)
        if not points or not self._found(points[top]):
            raise SolverError("the path of the structure is not above the collapse")
        *_, before = points[:1] + [one for one in points[: top + 1] if one.slope > 0.0]
        for after in points[top + 1 : top + 2]:
            if before.slope > 0.0 > after.slope and before.work < after.work:
                return replace(before, work=before.meets(after))
        return before

    def _summit(self, low: _Settled) -> _Settled:
        """The highest state next to one; tangents on both sides lead to it."""
        best = low
        step = 0.01
        high = math.inf  # work at which the path is past its summit, and
        right: _Settled | None = None  # the state there if it is still on the path
        while True:
            if low.slope <= 0.0:
                high = low.work
                right = low
                top = low.at(0.0)
                work = (1.0 - 5.0 * step) * low.work
                step *= 4.0
            elif high == math.inf:
                top = low.at(2.0 * low.work)
                work = (1.0 + step) * low.work
                step *= 4.0
            elif right is None:
                top = low.at(high)
                work = 0.5 * (low.work + high)
            else:
                work = low.meets(right)
                top = low.at(work)
                inside = 0.02 * (high - low.work)
                work = min(max(work, low.work + inside), high - inside)
            if top <= best.load_factor + SEARCH.side_accuracy * self._size or work <= 0.0:
                break
            try:
                far = abs(work - low.work) / max(work, low.work)
                start = warm(max(0.1 * far, SEARCH.end_products * SEARCH.decade))
                solution, _ = next_to(low.state, low.rate, start)(self._task(work))
                new = self._verified(solution.state)
            except SolverError:
                self.case.discretization.effort.require(1.0)
                if low.slope <= 0.0:
                    break
                high = work
                right = None
                continue
            best = max(best, new, key=lambda one: one.load_factor)
            if low.slope <= 0.0 or (new.slope > 0.0 and new.load_factor >= low.load_factor):
                low = new
            else:  # with a slope above 0 it is on another piece of the path, past a fold
                high = work
                right = new if new.slope <= 0.0 else None
        return best

    def _verified(self, state: State) -> _Settled:
        """A state with its slope; `SolverError` if it is no state of equilibrium."""
        problem = self.case.problem
        scales = self._task(state.work).scales
        residuals = state_residuals(problem, state, scales)
        allowed = tolerances()
        missed = [name for name, value in residuals.items() if not value <= allowed[name]]
        if missed:
            raise SolverError(f"not verified: {', '.join(missed)}")
        rate, slope = rates(self.case.coulomb(state.work, scales), state)
        _log.info("  peak: T = %.6g, load factor %.8g", state.work, state.load_factor)
        found = _Settled(state.work, state.load_factor, slope, state, rate)
        if self.best is None or found.load_factor > self.best.load_factor:
            self.best = found
        return found
