"""The peak: the most that the loading path carries before it falls to the collapse.

With Coulomb friction the load factor lambda(T) need not rise to its plateau: joints that stick at
first slip later, and it falls. A slowly raised load ends at the highest point of that path. Between
two changes of contact the structure is linear, so lambda(T) is made of straight pieces of slope

    d(lambda)/dT = 1 / (f_L . A^-1 f_L),   A as in `kkt`,

and a peak is where the slope changes its sign, or where the path turns back.

1. Where the path that led to the collapse is known, with larger products than here, these are taken
   to zero at some of its states: if none is above the collapse then, there is no peak.
2. No state is above the associative program of rigid blocks (D.C. Drucker, J. Appl. Mech. 21
   (1954) 71): where the collapse reaches it there is no peak. Else the path is followed on block
   modes with small products, settled at rising works, and where the tangent at one of these
   crosses the collapse before the next: a peak may be narrow.
3. A point above the collapse is finished with products zero. If it stays there, the path of the
   structure is followed from there until it has fallen or turned back. From the highest point the
   products go to zero, and slopes on both sides lead to the summit.

The peak depends on stiffness and mesh, and a path may have several: it is a lower bound of what
the model carries.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from fenics_contact.collapse.collapse_mode import rates
from fenics_contact.collapse.load_case import LoadCase, Task
from fenics_contact.collapse.record import Way
from fenics_contact.collapse.strategy import (
    WarmStart,
    at_work,
    coulomb_equilibrium,
    falling,
    next_to,
    rising,
    rising_mu,
)
from fenics_contact.errors import EffortError, SolverError
from fenics_contact.results.certificate import TOLERANCES, state_residuals
from fenics_contact.results.history import LoadPath, Peak
from fenics_contact.solvers.arclength import ArclengthOptions, PathPoint
from fenics_contact.solvers.block_modes import BlockModes
from fenics_contact.solvers.interior_point import (
    InteriorPointOptions,
    Tolerances,
    solve_interior_point,
)
from fenics_contact.solvers.joint_stiffness import GENERAL, JointStiffness
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import Array, State

_log = logging.getLogger("fenics_contact")

#: A peak is higher than the collapse by this, relative.
ABOVE = 2e-3

#: Why a peak is not known, for people.
TOO_DEAR = "the search takes more work than allowed; solve.peak = true allows more"
OTHER_METHOD = "this method does not look for it; solve.method = 'auto' does"
NOT_ASKED = "solve.peak = false; solve.peak = true looks for it"
FELL = "the load factor fell on the way to the collapse: more may have been carried"
MODES_ONLY = "block modes carry more than the collapse, and the structure was not found to"


@dataclass(frozen=True)
class Limits:
    """Most cost of the search, in units of one factorisation of the structure.

    Attributes:
        seen: Until something above the collapse was seen on block modes.
        found: In all.
    """

    seen: float
    found: float

    @classmethod
    def usual(cls, solve: float, blocks: int = 1) -> Limits:
        """Limits where the peak was not asked for, by the cost of the collapse and the blocks."""
        seen, found = OPTIONS.usual
        part = min(1.0, OPTIONS.few / blocks)
        return cls(part * seen * solve, found * solve)

    @classmethod
    def asked(cls, solve: float) -> Limits:
        """Limits where the peak was asked for, by the cost of the collapse."""
        seen, found = OPTIONS.asked
        return cls(seen * solve, found * solve)


@dataclass(frozen=True)
class PeakOptions:
    """Numbers of the search.

    Attributes:
        usual: Limits on the cost until something is seen, and in all, in units of that of the
            collapse.
        asked: The same where the peak was asked for.
        products: On the way, in units of force times elastic displacement; the second if the path
            is lost with the first. Larger ones round the path off.
        least: From where the interior point method takes them to zero.
        apart: Ratio of works at which the path is settled.
        first: First work, in units of that of the bonded structure at the collapse's load factor:
            nothing is stiffer than this, and joints are open by then; and in units of the bonded
            work at least.
        past: The path of block modes may end on its plateau from this multiple of the onset's work.
        last: It ends at this multiple of the bonded work, or of the onset's, whichever is more.
        promising: Tangents are followed to where they are higher than the collapse by this,
            relative.
        before: If that is before this part of the next work.
        another: A path that ends so far from the collapse, relative, ends on another one.
        dip: Where the load factor of the path to the collapse, with its larger products, fell by
            this, relative, block modes do not tell that there is no peak.
        fallen: A summit is passed where the path has fallen by this, relative.
        finish: When the interior point method stops with products zero.
        few: Blocks from which on the first limit is smaller, in proportion: steps on block modes
            then take longer, and the path has more of them.
    """

    usual: tuple[float, float] = (0.5, 5.0)
    asked: tuple[float, float] = (20.0, 50.0)
    products: tuple[float, ...] = (3e-4, 1e-3)
    apart: float = 1.8
    least: float = 3e-6
    first: tuple[float, float] = (1.5, 0.1)
    past: float = 1.05
    last: tuple[float, float] = (300.0, 2.0)
    promising: float = 4e-3
    before: float = 0.9
    another: float = 2e-2
    dip: float = 5e-2
    fallen: float = 5e-3
    finish: InteriorPointOptions = field(
        default_factory=lambda: InteriorPointOptions(window=4, acceptable=1e-7)
    )
    few: int = 100


#: How exact states of block modes are that tell whether the path is above the collapse.
NEARLY = Tolerances(1e-5, 1e-3)
BRIEF = InteriorPointOptions(max_steps=12, window=4, acceptable=1e-4)

#: How exact states are on the climb, and when the interior point method gives one up.
ROUGH = Tolerances(1e-9, 1e-6)
LONG = InteriorPointOptions(max_steps=20, window=8, acceptable=1e-7)
SHORT = InteriorPointOptions(max_steps=12, window=5, acceptable=1e-7)


@dataclass(frozen=True)
class ClimbOptions:
    """Numbers of the climb on the structure.

    Attributes:
        first: First step to more work, relative: a path may turn back there.
        back: First step to less work, relative.
        growth: Steps grow by this factor.
        accuracy: Of the load factor at the summit, relative.
        inside: Part of an interval that a new work keeps from its ends.
        beyond: The next load factor at which equilibrium is looked for is higher by this, relative.
        dips: Dips of the path that are stepped over so at most.
        products: Of the first iterate at other work, in units of force times elastic displacement
            and of the relative change of the work.
        least: Such products at least.
        way: Products of the path of the structure, in units of force times elastic displacement.
        far: Largest step of the work along the path of the structure, relative.
        small: Products with which it is followed once more, from before its summit.
        closer: Largest steps then; the second if the path turns back, to get nearer.
        fallen: It is then past its summit where it has fallen by this, relative.
        level: Points of one height differ by less than this, relative.
        at_summit: How a state is found where tangents of that path meet.
        before_it: How one is found at the last point before, if there is none.
        next_load: How one is found at a prescribed load factor: nothing is tried from afar.
    """

    first: float = 0.01
    back: float = 0.05
    growth: float = 4.0
    accuracy: float = 1e-4
    inside: float = 0.02
    beyond: float = 5e-4
    dips: int = 8
    products: float = 0.1
    least: float = 3e-4
    way: float = 1e-4
    far: float = 0.3
    closer: tuple[float, ...] = (0.15, 0.04)
    small: float = 1e-5
    fallen: float = 1e-3
    level: float = 1e-4
    at_summit: WarmStart = field(default_factory=lambda: WarmStart((3e-5,), (), ROUGH, SHORT))
    before_it: WarmStart = field(default_factory=lambda: WarmStart((3e-5, 3e-3), (), ROUGH, LONG))
    next_load: WarmStart = field(default_factory=lambda: WarmStart((3e-4,), (), ROUGH, SHORT))


OPTIONS = PeakOptions()
CLIMB = ClimbOptions()


@dataclass(frozen=True)
class Above:
    """What a peak is held against.

    Attributes:
        load_factor: That of the collapse.
        size: Load factor by which differences are divided.
        work: T at the onset of the collapse.
    """

    load_factor: float
    size: float
    work: float

    def __call__(self, load_factor: float) -> float:
        """How much higher a load factor is, relative."""
        return (load_factor - self.load_factor) / self.size

    def last_work(self, case: LoadCase) -> float:
        """Work at which a path is on its plateau, as far as it is worth looking."""
        of_bonded, of_onset = OPTIONS.last
        return max(of_bonded * case.bonded_work, of_onset * self.work)


def peak_of(path: LoadPath, above: Above) -> Peak:
    """What a path of load control carries, if that is above the collapse."""
    last = path.steps[-1]
    if above(path.lower) <= ABOVE:
        return Peak("none")
    return Peak("found", path.lower, path.upper, last.work, last.displacement)


def find_peak(
    case: LoadCase, above: Above, tolerance: float, limits: Limits, way: Way | None = None
) -> Peak:
    """The peak of the loading path of a load case with Coulomb friction.

    Args:
        case: The load case.
        above: Its collapse.
        tolerance: On load factors, relative.
        limits: On the cost.
        way: The path of block modes to the collapse, with larger products; None: not known.
    """
    if case.kind != GENERAL:
        return Peak("not_known", reason=OTHER_METHOD)
    fell = way is not None and way.fallen > OPTIONS.dip * above.size
    none = Peak("not_known", reason=FELL) if fell else Peak("none")
    below = way is not None and _stays_below(case, above, way, limits)
    if below and not fell:
        return none
    case = replace(case, monitor=lambda step: None)
    effort = case.discretization.effort
    begun = effort.spent
    try:
        upper = case.blocks.limit()
        upper = math.inf if upper is None else upper
        if above(upper) <= ABOVE:
            return Peak("none")
        with effort.at_most(limits.seen):
            seed = None if below else _seed(case, above)
        if seed is None:
            return none
        with effort.at_most(limits.found - (effort.spent - begun)):
            return _Summit(case, above, tolerance, upper).peak(seed)
    except EffortError:
        return Peak("not_known", reason=TOO_DEAR)
    except SolverError as error:
        return Peak("not_known", reason=str(error))


@dataclass(frozen=True)
class _OnPath(ABC):
    """A point of a path, and d(lambda)/dT there."""

    slope: float

    @property
    @abstractmethod
    def work(self) -> float:
        """T, N m per metre of thickness."""

    @property
    @abstractmethod
    def load_factor(self) -> float:
        """The load factor."""

    def tangent(self, work: float) -> float:
        """Load factor on the tangent."""
        return self.load_factor + self.slope * (work - self.work)

    def meets(self, right: _OnPath) -> float:
        """Work in between at which the tangents meet; that of the right point if they do not."""
        if self.slope <= right.slope:
            return right.work
        gap = right.tangent(self.work) - self.load_factor
        return min(max(self.work + gap / (self.slope - right.slope), self.work), right.work)


# ---- on block modes


def _stays_below(case: LoadCase, above: Above, way: Way, limits: Limits) -> bool:
    """Whether a path of block modes, known with larger products, stays below the collapse."""
    if len(way.states) < 2 or not above(way.last) >= -OPTIONS.another:
        return False  # nothing was seen of it, or it led elsewhere
    try:
        with case.discretization.effort.at_most(limits.seen):
            return all(height <= ABOVE for height in _heights(case, above, way))
    except SolverError as error:
        _log.info("  peak: %s", error)
        return False


def _heights(case: LoadCase, above: Above, way: Way) -> Iterator[float]:
    """How much higher than the collapse the states of a way are with products zero, relative.

    They end on the plateau, which lasts: past the onset the collapse goes on as it is. There alone
    the interior point method takes products to zero; before, it may lead past a narrow peak.
    """
    modes = case.discretization.block_modes.changed(case.problem)
    stiffness = modes.stiffness(GENERAL, case.discretization.mode_tally)
    for state in way.states[1:]:  # the first is where the path begins
        scales = case.scales_at(state.work, above.load_factor)
        kkt = PerturbedKKT.coulomb(modes.reduced, stiffness, scales, state.work)
        mu = rising_mu(Task(case, state.work, scales, tolerance=1e-6))
        height = above(_load_factor(kkt, state, mu))
        past_onset = state.work >= above.work
        if past_onset and height > ABOVE:
            settled = solve_interior_point(kkt, state, mu, NEARLY, BRIEF)
            height = above(settled.state.load_factor)
        if past_onset and abs(height) <= OPTIONS.another:
            return
        yield height


def _load_factor(kkt: PerturbedKKT, state: State, mu: float) -> float:
    """Load factor of a state on a path with products zero, to first order: one Newton step.

    With products it is lower where joints open, and higher on the plateau.
    """
    now = kkt.on_central_path(state, mu)
    (step,) = kkt.linearize(now).directions([(kkt.residual(now), -kkt.products(now))])
    return state.load_factor + step.load_factor


def _seed(case: LoadCase, above: Above) -> State | None:
    """A state on the way that block modes have above the collapse; None: no state.

    Raises:
        EffortError: If that takes too long.
        SolverError: If the path is lost, or ends elsewhere.
    """
    modes = case.discretization.block_modes.changed(case.problem)
    stiffness = modes.stiffness(GENERAL, case.discretization.mode_tally)
    for products in OPTIONS.products:
        path = _ModesPath(case, modes, stiffness, above, products)
        try:
            return path.first_above()
        except SolverError as error:
            case.discretization.effort.require(1.0)
            failed = error
    raise failed


@dataclass(frozen=True)
class _Sample(_OnPath):
    """A point on a path with small products."""

    point: PathPoint

    @property
    def work(self) -> float:
        return self.point.work

    @property
    def load_factor(self) -> float:
        return self.point.iterate.load_factor


class _ModesPath:
    """The loading path of the block modes, with small products."""

    def __init__(
        self,
        case: LoadCase,
        modes: BlockModes,
        stiffness: JointStiffness,
        above: Above,
        products: float,
    ) -> None:
        self._case = case
        self._modes = modes
        self._above = above
        last = above.last_work(case)
        scales = case.scales_at(last)
        self._task = Task(case, last, scales, tolerance=1e-6)
        self._mu = self._task.mu(products)
        self._kkt = PerturbedKKT.coulomb(modes.reduced, stiffness, scales, last)
        self._path = rising(self._kkt, factored=self._note)
        self._passed: list[_Sample] = []

    def first_above(self) -> State | None:
        """A state before the first one above the collapse that stays there with products zero.

        It is on the path, as one of the structure; None if nothing is above.

        Raises:
            SolverError: If the path is lost, or ends at another collapse state.
        """
        bias, last = 0.0, None
        for before, last in self._rise():
            seen = self._above(last.iterate.load_factor)
            if seen <= ABOVE + bias:
                continue
            left = self._above(self._finished(last).load_factor)
            _log.info("  peak: %.4g above the collapse, %.4g with products 0", seen, left)
            if left > ABOVE:
                return self._modes.prolonged(before.state)
            bias = seen - left
        if last is None or abs(self._above(last.iterate.load_factor)) <= OPTIONS.another + bias:
            return None
        if abs(self._above(self._finished(last).load_factor)) > OPTIONS.another:
            raise SolverError("the path of block modes ends at another collapse state")
        return None

    def _rise(self) -> Iterator[tuple[PathPoint, PathPoint]]:
        """Points at rising works up to the plateau, each with one before it.

        A path that goes on as at one point may be above the collapse before the next: there it is
        settled, too.
        """
        unit = self._case.bonded_work
        ends = self._above
        factor, least = OPTIONS.first
        work = max(factor * ends.load_factor / self._case.scales.load_factor, least) * unit
        start = self._modes.restricted(self._case.bonded_state(work))
        point = self._path.follow(self._path.begin(start, self._mu), work)
        yield point, point
        while work < self._task.work:
            work *= OPTIONS.apart
            self._passed.clear()
            after = self._path.follow(point, work)
            crossing = self._crossing(self._passed[0], after)
            if crossing is not None:
                yield point, crossing
            yield point, after
            level = [abs(ends(p.iterate.load_factor)) <= ABOVE for p in (point, after)]
            if all(level) or (level[1] and work > OPTIONS.past * ends.work):
                return
            point = after

    def _note(self, point: PathPoint, rate: float) -> None:
        """Take note of a point on the way, and of d(lambda)/ds there."""
        self._passed.append(_Sample(rate / point.work, point))

    def _crossing(self, left: _Sample, after: PathPoint) -> PathPoint | None:
        """The point at which the tangent at one point crosses the collapse well before another."""
        promising = self._above.load_factor + OPTIONS.promising * self._above.size
        highest = max(left.load_factor, after.iterate.load_factor)
        if highest > promising or left.tangent(OPTIONS.before * after.work) <= promising:
            return None
        work = left.work + (promising - left.load_factor) / left.slope
        return self._path.follow(left.point, work)

    def _finished(self, point: PathPoint) -> State:
        """The state with products zero at the work of a point."""
        kkt = replace(self._kkt, work=point.work)
        path = falling(kkt)
        mu = self._task.mu(OPTIONS.least)
        point = path.follow(path.begin(point.state, point.mu), mu)
        tolerances = self._task.tolerances
        return solve_interior_point(kkt, point.state, mu, tolerances, OPTIONS.finish).state


# ---- on the structure


@dataclass(frozen=True)
class _Point(_OnPath):
    """A verified state of the structure, and its rate of displacements du/dT."""

    rate: Array
    state: State

    @property
    def work(self) -> float:
        return self.state.work

    @property
    def load_factor(self) -> float:
        return self.state.load_factor


@dataclass(frozen=True)
class _Beyond:
    """Work at which the path is past its summit, and the state there if it is still on the path."""

    work: float
    point: _Point | None = None


class _Way:
    """Points along a path, which is left where it has fallen or turned back.

    Attributes:
        points: On the way, with their slopes.
        turned: Whether the path turned back.
    """

    def __init__(self, size: float, fallen: float) -> None:
        """Take load factors relative to a size, and as fallen by such a part."""
        self._size = size
        self._fallen = fallen
        self.points: list[_Sample] = []
        self.turned, self._rate = False, 0.0

    def factored(self, point: PathPoint, rate: float) -> None:
        """Take note of d(lambda)/ds at a point."""
        self._rate = rate

    def passed(self, point: PathPoint) -> None:
        """Take note of a point that is on the path."""
        self.points.append(_Sample(self._rate / point.work, point))
        highest = self.points[self._highest]
        fallen = highest.load_factor - self.points[-1].load_factor
        self.turned = point.work < highest.work and fallen > 0.0
        if self.turned or fallen > self._fallen * self._size:
            raise SolverError("the path has fallen")

    @property
    def _highest(self) -> int:
        """Number of the first of the highest points."""
        level = max(point.load_factor for point in self.points) - CLIMB.level * self._size
        return next(i for i, point in enumerate(self.points) if point.load_factor >= level)

    @property
    def before(self) -> PathPoint:
        """The last rising point with less work than those past the highest one."""
        place = self._highest + 1
        least = min((point.work for point in self.points[place:]), default=math.inf)
        rising = [p.point for p in self.points[:place] if p.slope > 0.0 and p.work < least]
        return rising[-1] if rising else self.points[0].point

    @property
    def highest(self) -> PathPoint:
        """The first of the highest points."""
        return self.points[self._highest].point

    @property
    def summit(self) -> tuple[PathPoint, float]:
        """A point next to the highest one, and the work at which tangents on both sides meet."""
        place = self._highest
        highest = self.points[place]
        if self.turned:
            return highest.point, highest.work
        left, *right = self.points[max(place - (highest.slope <= 0.0), 0) :][:2]
        if not right or not left.slope > 0.0 > right[0].slope or left.work >= right[0].work:
            return highest.point, highest.work
        return left.point, left.meets(right[0])


class _Summit:
    """The highest point of the path of the structure next to a state.

    Attributes:
        best: The highest verified state so far; None if there is none.
    """

    def __init__(self, case: LoadCase, above: Above, tolerance: float, upper: float) -> None:
        self._case = case
        self._above = above
        self._tolerance = tolerance
        self._upper = upper
        self._effort = case.discretization.effort
        self.best: State | None = None

    def peak(self, seed: State) -> Peak:
        """The peak next to a state that the block modes have above the collapse."""
        try:
            self._climb_from(self._begun(seed))
        except SolverError as error:
            if not self._found:
                raise
            _log.info("  peak: %s", error)
        if self.best is None or not self._found:
            return Peak("not_known", reason=MODES_ONLY)
        state = self.best
        work = self._case.written(state).work
        moved = work / self._case.problem.sum(np.abs(self._case.problem.live))
        return Peak("found", state.load_factor, work=work, displacement_m=moved, state=state)

    @property
    def _found(self) -> bool:
        return self.best is not None and self._above(self.best.load_factor) > ABOVE

    def _climb_from(self, point: _Point) -> None:
        """Climb to the summit, over small dips."""
        for _ in range(CLIMB.dips):
            best = self._summit(point)
            target = best.load_factor + CLIMB.beyond * self._above.size
            if not self._found or target >= self._upper:
                return
            point = self._at_load(best, target)

    def _summit(self, start: _Point) -> _Point:
        """The highest point next to one, by the slopes on both sides."""
        left, right = self._sides(start)
        best = max(start, left, key=lambda point: point.load_factor)
        step = CLIMB.first
        while (work := self._next_work(left, right, best, step)) is not None:
            step *= CLIMB.growth
            try:
                new = self._at(work, left)
            except SolverError:
                self._effort.require(1.0)
                right = _Beyond(work)
                continue
            best = max(best, new, key=lambda point: point.load_factor)
            if new.slope > 0.0 and new.load_factor >= left.load_factor:
                left = new
            else:  # with a slope above 0 it is on another piece of the path, past a fold
                right = _Beyond(work, new if new.slope <= 0.0 else None)
        return best

    def _sides(self, start: _Point) -> tuple[_Point, _Beyond | None]:
        """A rising point on the left of the summit, and one past it if `start` is."""
        left = start
        right = None
        step = CLIMB.back
        flat = CLIMB.accuracy * self._above.size
        while left.slope <= 0.0 and left.tangent(0.0) > left.load_factor + flat:
            right = _Beyond(left.work, left)
            left = self._at(left.work * (1.0 - step), left)
            step = CLIMB.growth * step
        return left, right

    def _next_work(
        self, left: _Point, right: _Beyond | None, best: _Point, step: float
    ) -> float | None:
        """Where to look next for something higher; None if there is nothing."""
        least = best.load_factor + CLIMB.accuracy * self._above.size
        if right is None:
            work = (1.0 + step) * left.work
            return work if left.tangent(2.0 * left.work) > least else None
        width = right.work - left.work
        if right.point is None:
            return left.work + 0.5 * width if left.tangent(right.work) > least else None
        work = left.meets(right.point)
        inside = CLIMB.inside * width
        if left.tangent(work) <= least:
            return None
        return min(max(work, left.work + inside), right.work - inside)

    def _begun(self, seed: State) -> _Point:
        """The state next to the summit of the path with small products, from the seed."""
        task = self._task(seed.work)
        start = rising(task.kkt).begin(seed, task.mu(CLIMB.way))
        start = rising(task.kkt).follow(start, seed.work)
        start = self._way(task, start, CLIMB.far, OPTIONS.fallen).before
        kkt = replace(task.kkt, work=start.work)
        start = falling(kkt).follow(start, task.mu(CLIMB.small))
        for change in CLIMB.closer:
            way = self._way(task, start, change, CLIMB.fallen)
            if not way.turned:
                break
            start = way.highest
        point, work = way.summit
        try:
            return self._point(at_work(self._task(work), point.state, CLIMB.at_summit))
        except SolverError:
            self._effort.require(1.0)
            return self._point(at_work(self._task(point.work), point.state, CLIMB.before_it))

    def _way(self, task: Task, start: PathPoint, change: float, fallen: float) -> _Way:
        """The path from a point to past its summit, in steps of the work of a relative size."""
        way = _Way(self._above.size, fallen)
        options = ArclengthOptions(largest_change=change)
        path = rising(task.kkt, options=options, factored=way.factored, passed=way.passed)
        try:
            path.follow(start, self._above.last_work(self._case))
        except SolverError as error:
            self._effort.require(1.0)
            _log.info("  peak: %s", error)
        if not way.points:
            raise SolverError("the path of the structure is lost")
        return way

    def _at(self, work: float, near: _Point) -> _Point:
        """The state at some work, from one next to it."""
        far = abs(work - near.work) / max(work, near.work)
        products = max(CLIMB.products * far, CLIMB.least)
        warm = WarmStart((products,), (), ROUGH, SHORT)
        solution, _ = next_to(near.state, near.rate, warm)(self._task(work))
        return self._point(solution.state)

    def _at_load(self, near: _Point, load_factor: float) -> _Point:
        """The state at a load factor, from one next to it."""
        task = self._task(near.work)
        return self._point(coulomb_equilibrium(task, near.state, load_factor, CLIMB.next_load))

    def _task(self, work: float) -> Task:
        scales = self._case.scales_at(work, self._above.load_factor)
        return Task(self._case, work, scales, self._tolerance)

    def _point(self, state: State) -> _Point:
        """A state with its slope, verified; `SolverError` if it is no state of equilibrium."""
        scales = self._task(state.work).scales
        problem = self._case.problem
        residuals = state_residuals(problem, state, scales)
        missed = [name for name, value in residuals.items() if not value <= TOLERANCES[name]]
        _log.info("  peak: T = %.6g, load factor %.8g", state.work, state.load_factor)
        if missed:
            raise SolverError(f"not verified: {', '.join(missed)}")
        if self.best is None or state.load_factor > self.best.load_factor:
            self.best = state
        rate, slope = rates(self._case.coulomb(state.work, scales), state)
        return _Point(slope, rate, state)
