"""Other collapse states than the one at the end of the path, and the lowest of those found.

Collapse states with Coulomb friction are not unique (M.C. Ferris, F. Tin-Loi, Int. J. Mech. Sci. 43
(2001) 209). Each one is a fixed point of g -> F r_N(g), r_N(g) the normal forces at the limit load
for given friction g. Searches from elsewhere than the path tell whether others are lower:

- friction that grows as the products fall (`growing_friction`), which meets low states first;
- the fixed point itself (`coulomb`) from several bounds g, one of them that of rigid blocks
  (`rigid_fixed_point`), which takes linear programs alone.

They go along the block modes (`block_modes`), whose load factors are those of the structure to
1e-6 in the median. A state there that is below the collapse of the path is finished on the
structure and verified like that one (`work_control`). No search proves that there is no other
state: that is what the bracket is for.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from fenics_contact.collapse.coulomb import FixedPoint, FixedPointOptions
from fenics_contact.collapse.load_case import LoadCase, Task
from fenics_contact.collapse.strategy import (
    COULOMB,
    OPTIONS,
    WorkOptions,
    falling,
    monolithic,
    to_end,
)
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.errors import EffortError, SolverError
from fenics_contact.results.history import CollapseState, Lowest
from fenics_contact.results.result import Collapse
from fenics_contact.solvers.arclength import ArclengthOptions, Continuation, PathPoint
from fenics_contact.solvers.block_modes import BlockModes
from fenics_contact.solvers.growing_friction import GROWTH, FrictionGrowth, with_growing_friction
from fenics_contact.solvers.interior_point import (
    InteriorPointOptions,
    Solution,
    Tolerances,
    solve_interior_point,
)
from fenics_contact.solvers.joint_stiffness import GENERAL
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.nonlinear_elimination import EliminationOptions
from fenics_contact.solvers.problem import Array, ContactProblem, State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class LowestOptions:
    """Numbers of the searches. Costs are limits, in units of that of the collapse of the path.

    Attributes:
        search: Cost of the search of a second opinion, until a known state is recognised or another
            one found next to its end.
        follow: Cost of following the path from there where none is found.
        searches: Cost of all of that.
        finish: Cost of finishing and verifying another state on the structure.
        start: Cost of one search where several states are asked for.
        growths: Products at the start and power with which friction grows, where several states
            are asked for.
        second: The same for a second opinion, the next one where the one before is stuck: it has
            more friction at the start. Many arches do not stand with a quarter of theirs.
        stuck: Products at the end of a growth above which it is stuck, in units of force times
            displacement.
        below: A load factor on block modes is lower by this part of its size at least.
        same: Load factors of one state differ by less, relative.
        small: Load factors are judged relative to themselves, or this part of the typical one.
        aligned: Cosine of the angle between modes of one state at least, and
        closely: where several states are asked for (those of W3, 0.356 and 0.384, have 0.9995).
        iterations: Of the fixed point at most, and
        tolerance: its tolerance on bound and load factor, relative: states below are finished.
        products: With which the interior point method begins at the end of a search, in units of
            those there: what is tried. Where it stalls with those it often ends with larger ones.
        exact: How exact that state is, and
        directly: when the method gives it up; its steps cost less than half of those of a path.
        bracket: Equations of rigid blocks up to which the bracket is asked where no search comes to
            an end: its programs take longer than the solve on larger structures, and seldom tell.
        path: Of the path that is followed where it does. Fewer points are chosen, and less often,
            than on the path to the collapse: of paths that lead somewhere, most need no more.
    """

    search: float = 0.8
    follow: float = 0.4
    searches: float = 1.0
    finish: float = 2.0
    start: float = 1.0
    growths: tuple[tuple[float, float], ...] = ((1.0, 0.2), (0.3, 0.2), (1.0, 0.1), (1.0, 0.0))
    second: tuple[tuple[float, float], ...] = ((1.0, 0.2), (1.0, 0.05))
    stuck: float = 1e-2
    below: float = 2e-3
    same: float = 1e-4
    small: float = 1e-3
    aligned: float = 0.99
    closely: float = 0.9999
    iterations: int = 30
    tolerance: float = 1e-3
    products: tuple[float, ...] = (1.0, 30.0)
    exact: Tolerances = field(default_factory=lambda: Tolerances(1e-5, 1e-4))
    directly: InteriorPointOptions = field(
        default_factory=lambda: InteriorPointOptions(window=4, acceptable=3e-4)
    )
    bracket: int = 100
    path: ArclengthOptions = field(
        default_factory=lambda: ArclengthOptions(
            elimination=EliminationOptions(points=8, late=8, rounds=2)
        )
    )


LOWEST = LowestOptions()

#: Why a second opinion is not known, and what to do, for people.
NO_STATE = "the search found no state within its limit; solve.states = 'lowest' does more searches"

#: Where a search leads on block modes: a state near the central path, and its products in units of
#: force times displacement. It may end where displacements are those of a known state, and raises
#: `SolverError` if it leads nowhere.
Search = Callable[[BlockModes, PerturbedKKT, Task, Callable[[Array], bool]], tuple[State, float]]


def second_opinion(case: LoadCase, end: Collapse, tolerance: float, cost: float) -> Collapse:
    """A verified collapse with what cheap searches for a lower state have found.

    Where the searches come to no end, the bracket may still prove that no state is lower.

    Args:
        case: The load case that led to the collapse.
        end: The collapse.
        tolerance: On load factors, relative.
        cost: Of the collapse, in units of one factorisation of the structure.
    """
    case = _general(case).unrecorded
    limit = end.load_factor - LOWEST.below * end.size
    effort = case.discretization.effort
    lower = dict[str, State]()
    ended = list[str]()
    task = _task(case, end.work_ratio, tolerance, end)
    for name, look in SECOND.items():
        try:
            with effort.at_most(LOWEST.searches * cost):
                state = look(task, end, limit, (LOWEST.search * cost, LOWEST.follow * cost))
        except SolverError as error:
            _log.info("second opinion: %s", error)
            continue
        ended.append(name)
        if state is not None and state.load_factor < limit:
            lower[name] = state
            break
    if not lower and next(iter(SECOND)) not in ended:  # rigid blocks alone tell too little
        small = case.blocks.equations <= LOWEST.bracket
        proved = case.blocks.proved_lower() if small and end.load_factor > 0.0 else None
        if proved is not None and proved >= limit:
            return replace(end, lowest=Lowest("none", end.load_factor, 0))
        return replace(end, lowest=Lowest("not_known", reason=NO_STATE))
    return _confirmed(case, end, lower, len(ended), tolerance, cost)


def _grown(task: Task, end: Collapse, limit: float, budget: tuple[float, float]) -> State | None:
    """What growing friction leads to, as `_other`.

    `budget` is the cost of the search and of following where it leads, at most.
    """
    return _other(task, by_enough_friction, end.mode, budget, limit)


def _rigid(task: Task, end: Collapse, limit: float, budget: tuple[float, float]) -> State | None:
    """A state next to that of rigid blocks, as `_other`; None if theirs is not low."""
    case = task.case
    whole = task.case.discretization
    rigid = case.blocks.rigid_state(whole.all_points(case.first_pressure), limit)
    _log.info("second opinion: rigid blocks settle at %.8g", rigid.load_factor)
    if rigid.load_factor >= limit:
        return None
    bound = case.problem.law.given(rigid.pressure[whole.operators.points])
    search = partial(by_fixed_point, bound=bound, iterations=1)  # more may lead away from it
    return _other(task, search, end.mode, budget, limit)


#: Searches of a second opinion, by name, the first of which has to come to an end.
SECOND = {"growing friction": _grown, "fixed point of rigid blocks": _rigid}


def _confirmed(
    case: LoadCase,
    end: Collapse,
    lower: Mapping[str, State],
    starts: int,
    tolerance: float,
    cost: float,
) -> Collapse:
    """A collapse with what searches have found, finished on the structure and verified."""
    none = replace(end, lowest=Lowest("none", end.load_factor, starts))
    for name, state in lower.items():
        with case.discretization.effort.at_most(LOWEST.finish * cost):
            found = _finished(case, state, tolerance)
        if found.status != "limit":
            reason = f"a state at {case.sign * state.load_factor:.6g} was met, but is not verified"
            return replace(end, lowest=Lowest("not_known", starts=starts, reason=reason))
        if found.load_factor < end.load_factor - LOWEST.same * end.size:
            states = _told({"path": end, name: found})
            return replace(end, states=states, lowest=Lowest("lower", found.load_factor, starts))
    return none


def find_lowest(case: LoadCase, tolerance: float) -> Collapse:
    """The lowest verified collapse of those that several starts lead to, with Coulomb friction.

    Its `states` are all that were found and verified, the lowest first.
    """
    case = _general(case)
    effort = case.discretization.effort
    before = case.discretization.effort.spent
    path = find_collapse(case, COULOMB["auto"], tolerance)
    cost = effort.spent - before
    ends = {"path": path} if path.status == "limit" else {}
    case = case.unrecorded
    met, recognised = _met(case, path, tolerance, cost)
    known = {name: (end.load_factor, end.mode) for name, end in ends.items()}
    moving = {name: (state.load_factor, state.displacement) for name, state in met.items()}
    groups = _grouped(case, known | moving, LOWEST.below)
    if ends:
        groups["path"] += recognised
    for name in [name for name in groups if name not in ends]:
        with effort.at_most(LOWEST.finish * cost):
            end = _finished(case, met[name], tolerance)
        if end.status == "limit":
            ends[name] = end
    if not ends:
        return path
    found = {name: (end.load_factor, end.mode) for name, end in ends.items()}
    names = {
        name: [start for one in same for start in groups[one]]
        for name, same in _grouped(case, found, LOWEST.same).items()
    }
    lowest_first = sorted(names, key=lambda name: ends[name].load_factor)
    first = ends[lowest_first[0]]
    count = 1 + len(met) + len(recognised)
    states = _told({"; ".join(names[name]): ends[name] for name in lowest_first})
    return replace(first, states=states, lowest=Lowest("none", first.load_factor, count))


# ---- searches


def by_growing_friction(
    modes: BlockModes,
    kkt: PerturbedKKT,
    task: Task,
    known: Callable[[Array], bool],
    growth: FrictionGrowth,
) -> tuple[State, float]:
    """State near the central path on block modes, met with growing friction."""
    start = modes.restricted(task.case.bonded_state(task.work))
    return with_growing_friction(kkt, start, growth, known)


def by_enough_friction(
    modes: BlockModes, kkt: PerturbedKKT, task: Task, known: Callable[[Array], bool]
) -> tuple[State, float]:
    """As `by_growing_friction`, with more friction where there is no state with less."""
    for begin, power in LOWEST.second:
        growth = replace(GROWTH, begin=begin, power=power)
        state, mu = by_growing_friction(modes, kkt, task, known, growth)
        if mu <= LOWEST.stuck or known(state.displacement):
            break
    return state, mu


def by_fixed_point(
    modes: BlockModes,
    kkt: PerturbedKKT,
    task: Task,
    known: Callable[[Array], bool],
    bound: Array,
    iterations: int = LOWEST.iterations,
) -> tuple[State, float]:
    """State by so many iterations of the fixed point on block modes, from a first bound g."""
    case = task.case

    def solve(bound: Array, start: State, mu: float, tolerance: float) -> Solution:
        given = modes.reduced, kkt.stiffness, task.scales, bound, task.work
        conditions = PerturbedKKT.given_friction(*given)
        return solve_interior_point(conditions, start, mu, Tolerances(tolerance))

    told = case.monitor, case.discretization.factorizations
    options = FixedPointOptions(max_iterations=iterations)
    iteration = FixedPoint(modes.reduced, solve, LOWEST.tolerance, *told, options)
    start = modes.restricted(case.bonded_state(task.work))
    return iteration.run(start, modes.of_points(bound))[0].state, task.mu(OPTIONS.ends[0])


def _searches(case: LoadCase) -> Iterator[tuple[str, Search]]:
    """Names and searches."""
    for begin, power in LOWEST.growths:
        growth = replace(GROWTH, begin=begin, power=power)
        name = f"friction growing from {growth.part(begin):.2g} at products of {begin:g}"
        yield name, partial(by_growing_friction, growth=growth)
    for name, bound in _bounds(case).items():
        yield f"fixed point from {name}", partial(by_fixed_point, bound=bound)


def _bounds(case: LoadCase) -> dict[str, Array]:
    """First bounds on friction of the fixed point, N per metre of thickness, by name."""
    problem = case.problem
    bounds = {"the dead load": problem.law.given(case.first_pressure)}
    associative = case.blocks.associative_pressure()
    if associative is not None:
        points = case.discretization.operators.points
        bounds["the associative program"] = problem.law.given(associative[points])
    return bounds


# ---- states


def _general(case: LoadCase) -> LoadCase:
    """The load case with a factorisation that takes Coulomb friction in the equations."""
    return replace(case, stiffness=case.discretization.stiffness(GENERAL), kind=GENERAL)


def _met(
    case: LoadCase, path: Collapse, tolerance: float, cost: float
) -> tuple[dict[str, State], list[str]]:
    """States on block modes that searches lead to, by name, and searches that end in the path's."""
    met = dict[str, State]()
    recognised = list[str]()
    first = COULOMB["auto"].work.begin(case.block_count, tolerance)
    task = _task(case, path.work_ratio or first, tolerance, path)
    mode = path.mode if path.status == "limit" else None
    budget = LOWEST.start * cost, LOWEST.start * cost
    for name, search in _searches(case):
        try:
            state = _other(task, search, mode, budget, aligned=LOWEST.closely)
        except SolverError as error:
            _log.info("  %s: %s", name, error)
            continue
        if state is None:
            recognised.append(name)
        else:
            met[name] = state
    return met, recognised


def _task(case: LoadCase, ratio: float, tolerance: float, path: Collapse) -> Task:
    """States at a work in units of that on the bonded structure, near a collapse."""
    work = ratio * case.bonded_work
    factor = abs(path.load_factor)
    return Task(case, work, case.scales_at(work, factor if factor < np.inf else 0.0), tolerance)


def _on_block_modes(task: Task) -> tuple[BlockModes, PerturbedKKT]:
    """Block modes of the task's structure, and the conditions of its state on them."""
    case = task.case
    modes = case.discretization.block_modes.changed(case.problem)
    stiffness = modes.stiffness(GENERAL, case.discretization.mode_tally)
    return modes, PerturbedKKT.coulomb(modes.reduced, stiffness, task.scales, task.work)


def _other(
    task: Task,
    search: Search,
    mode: Array | None,
    budget: tuple[float, float],
    below: float = np.inf,
    aligned: float = LOWEST.aligned,
) -> State | None:
    """State of block modes that a search leads to; None if it is a known one, or not low.

    Args:
        task: At which work.
        search: Leads near it.
        mode: The known mode; None if none is known.
        budget: Cost of the search, and of following where it leads, at most.
        below: Load factor below which it is low.
        aligned: Cosine of the angle to the known mode at which a state is a known one.

    Raises:
        SolverError: If there is none, or the budget does not suffice.
    """
    effort = task.case.discretization.effort
    modes, kkt = _on_block_modes(task)
    known = None if mode is None else modes.motion(mode)

    def recognised(u: Array) -> bool:
        return known is not None and _aligned(kkt.problem, u, known, aligned)

    with effort.at_most(budget[0]):
        state, mu = search(modes, kkt, task, recognised)
        if recognised(state.displacement):
            return None
        found = _directly(kkt, state, mu)
    if found is None:
        with effort.at_most(budget[1]):
            passed = partial(_end_at_known, recognised, below)
            path = falling(kkt, passed=passed, options=LOWEST.path)
            point = _low_point(path, path.begin(state, mu), task.mu(OPTIONS.ends[0]), below)
            if point is None:
                return None
            # The products that are left may have lowered the load factor.
            found = to_end(task, point.state, point.mu, kkt)
    low = found.state.load_factor < below and not recognised(found.state.displacement)
    return modes.prolonged(found.state) if low else None


def _directly(kkt: PerturbedKKT, state: State, mu: float) -> Solution | None:
    """The state next to one near the central path; None if the interior point method stalls."""
    for larger in LOWEST.products:
        products = min(larger * mu, 1.0)
        try:
            return solve_interior_point(kkt, state, products, LOWEST.exact, LOWEST.directly)
        except EffortError:
            raise
        except SolverError as error:
            _log.info("  next to the end of a search: %s", error)
    return None


def _low_point(path: Continuation, start: PathPoint, end: float, below: float) -> PathPoint | None:
    """Point of a path at its end; None if it leads to a known state, or to none that is low."""
    try:
        point = path.follow(start, end)
    except _KnownError:
        return None
    return point if point.state.load_factor < below else None


class _KnownError(Exception):
    """A path leads to a known state."""


def _end_at_known(recognised: Callable[[Array], bool], below: float, point: PathPoint) -> None:
    """Raise `_KnownError` at a point of a path that moves like a known state and is not low."""
    if point.state.load_factor >= below and recognised(point.state.displacement):
        raise _KnownError


def _aligned(
    problem: ContactProblem, one: Array, other: Array, least: float = LOWEST.aligned
) -> bool:
    """Whether two motions point the same way."""
    sizes = problem.dot(one, one) * problem.dot(other, other)
    return problem.dot(one, other) >= least * np.sqrt(sizes)


def _finished(case: LoadCase, state: State, tolerance: float) -> Collapse:
    """The collapse of the structure next to a state of its block modes."""

    @monolithic
    def attempt(task: Task) -> Solution:
        return to_end(task, state, task.mu(OPTIONS.ends[0]))

    ratio = state.work / case.bonded_work
    work = WorkOptions(first=ratio, first_of_many=0.0, missing=1)
    strategy = replace(COULOMB["auto"], attempts=(attempt,), once=(), work=work)
    return find_collapse(case, strategy, tolerance)


def _grouped(
    case: LoadCase, found: Mapping[str, tuple[float, Array | None]], same: float
) -> dict[str, list[str]]:
    """Names of states with the same load factor and motion, by the first of each group."""
    problem = case.problem
    groups = dict[str, list[str]]()
    least = LOWEST.small * case.scales.load_factor

    def alike(one: str, other: str) -> bool:
        (factor, motion), (of_other, other_motion) = found[one], found[other]
        if abs(factor - of_other) > same * max(abs(factor), least):
            return False
        if motion is None or other_motion is None:
            return motion is other_motion
        return _aligned(problem, motion, other_motion)

    for name in found:
        first = next((one for one in groups if alike(one, name)), name)
        groups.setdefault(first, []).append(name)
    return groups


def _told(ends: Mapping[str, Collapse]) -> tuple[CollapseState, ...]:
    """Records of collapse states, by the searches that led to them."""
    return tuple(
        CollapseState(name, end.status, end.load_factor, end.mode, end.joints)
        for name, end in ends.items()
    )
