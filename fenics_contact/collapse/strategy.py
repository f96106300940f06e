"""Which solver is tried when: the one list, at the end of this file.

An attempt looks for the state of a load case at one work T of its live load, and raises
`SolverError` where it finds none. A method is a tuple of attempts; the next one is tried where the
one before found nothing (`work_control`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial, wraps

import numpy as np

from fenics_contact.collapse.collapse_mode import is_collapse
from fenics_contact.collapse.coulomb import FixedPoint, GivenFriction
from fenics_contact.collapse.load_case import Answer, Attempt, LoadingPath, Task, falling
from fenics_contact.collapse.record import PathSample
from fenics_contact.errors import EffortError, SolverError
from fenics_contact.results.certificate import state_residuals
from fenics_contact.results.history import History, Step
from fenics_contact.scene.scene import Scene
from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers.arclength import PathPoint
from fenics_contact.solvers.interior_point import (
    Solution,
    Tolerances,
    solve_interior_point,
)
from fenics_contact.solvers.joint_forces import (
    JointForceSolver,
    JointPoints,
    ProximalStep,
    alternately,
    at_once,
)
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import Array, State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class WarmStart:
    """Interior point method from a state next to the one sought.

    Attributes:
        products: Where it starts, in units of force times elastic displacement: what is tried.
        from_afar: What is tried after that, in units of force times displacement.
        tolerances: How exact the state has to be.
        options: When the method stops.
    """

    products: tuple[float, ...] = field(
        default_factory=lambda: (
            SEARCH.end_products / SEARCH.decade,
            SEARCH.end_products * SEARCH.decade,
        )
    )
    from_afar: tuple[float, ...] = (1.0,)
    tolerances: Tolerances = field(default_factory=Tolerances)
    options: SearchOptions = SEARCH


#: When the interior point method stops next to a state: it succeeds soon or not at all.
FINISHING = replace(
    SEARCH,
    interior_window=SEARCH.no_progress,
    digits=SEARCH.digits / SEARCH.decade**2,
)

Minimiser = Callable[[ProximalStep, Array], Array]


def rising_mu(task: Task) -> float:
    """Products while the work rises, in units of force times displacement."""
    larger = max(1.0, task.case.block_count / SEARCH.large_wall) ** SEARCH.products_of_many
    return task.mu(SEARCH.rising_products * larger)


def monolithic(solve: Callable[[Task], Solution]) -> Attempt:
    """An attempt without iterations on the friction bound: its history has one step."""

    @wraps(solve)
    def attempt(task: Task) -> Answer:
        count = task.case.discretization.factorizations
        before = count()
        solution = solve(task)
        step = Step(solution.state.load_factor, 0.0, 1.0, count() - before)
        task.case.monitor(step)
        return solution, History((step,), 0, "monolithic", True)

    return attempt


# ---- monolithic attempts: friction is in the equations


@monolithic
def interior_point(task: Task) -> Solution:
    """State by the interior point method from the bonded response."""
    start = task.case.bonded_state(task.work)
    return solve_interior_point(task.kkt, start, 1.0, task.tolerances)


@monolithic
def further_along_rising_work(task: Task) -> Solution:
    """State by continuation of the structure from the last state, as the work rises."""
    if task.last is None:
        raise SolverError("no state at less work")
    path = LoadingPath(task, name="structure")
    *_, end = path.points(path.next_to(task.last, task.mu(SEARCH.end_products)))
    return to_end(task, end.state, end.point.mu)


@monolithic
def along_falling_products(task: Task) -> Solution:
    """State by continuation of the structure from products of 1 under the whole work."""
    return to_end(task, task.case.bonded_state(task.work), 1.0)


@monolithic
def along_block_modes(task: Task) -> Solution:
    """State by continuation in block modes: the work rises to T, then the products fall.

    Where the structure does not follow from the end of that path, it takes over before the products
    fall: with larger products its own path is nearer. Then the same with smaller products, which
    lead past other folds. The record of the load case has the samples of the rise.
    """
    path = LoadingPath.on_modes(task, "block modes")
    record = task.case.record
    options = task.case.discretization.scene.solve
    levels = options.peak is not False and not options.fast
    first = min(task.case.bonded_work, task.work)
    failed = SolverError("block modes: no end of a path")

    def fails(what: str, error: SolverError) -> None:
        nonlocal failed
        if isinstance(error, EffortError):
            raise error
        _log.info("  %s: %s", what, error)
        failed = error

    for part in (1.0, SEARCH.decade):
        risen: list[PathSample] = []
        record.risen = risen
        start = path.begin(first, part * rising_mu(task))
        try:
            risen.extend(path.points(start, task.work, levels=levels))
            point = risen.pop().point
        except SolverError as error:
            fails("block modes", error)
            continue
        ends = [point]
        try:
            ends.insert(0, path.with_products(point, task.mu(SEARCH.end_products)))
        except SolverError as error:
            fails("block modes", error)
        for end in ends:
            try:
                return to_end(task, path.prolonged(end.state), end.mu)
            except SolverError as error:
                fails("structure", error)
    raise failed


def next_to(state: State, direction: Array | None, warm: WarmStart | None = None) -> Attempt:
    """An attempt that starts from another state, moved on by displacements with f_L.v = 1."""

    @monolithic
    def next_to_another_state(task: Task) -> Solution:
        if direction is None:
            raise SolverError("no direction in which to go on")
        u = state.displacement + (task.work - state.work) * direction
        start = task.case.problem.state(u, state.load_factor, state.pressure, state.shear)
        return from_next_to(task, task.kkt, start, warm)

    return next_to_another_state


def coulomb_equilibrium(
    task: Task, start: State, load_factor: float, warm: WarmStart | None = None
) -> State:
    """State at a prescribed load factor next to another one, or `SolverError`."""
    kkt = task.case.coulomb(start.work, task.scales, load_factor)
    return from_next_to(task, kkt, start, warm).state


def from_next_to(
    task: Task, kkt: PerturbedKKT, start: State, warm: WarmStart | None = None
) -> Solution:
    """Solution of some conditions next to a state, or else from afar, or `SolverError`."""
    warm = warm or WarmStart()
    for mu in (*map(task.mu, warm.products), *warm.from_afar):
        try:
            return solve_interior_point(kkt, start, mu, warm.tolerances, warm.options)
        except SolverError as error:
            failed = error
    raise failed


def to_end(task: Task, state: State, mu: float) -> Solution:
    """The state at the end of the structure's central path, from a point near it.

    Where the path is lost before its end, the last point at which the products fell to the next end
    answers, settled on its path, if its load factor is known to the tolerance; else `SolverError`.
    The load factor changes less and less as the products fall: from the last point on it is taken
    to change by no more than between that and the one before.
    """
    path = LoadingPath(task, name="structure")
    kkt = replace(task.kkt, work=state.work)
    point = path.next_to(state, mu)
    passed: list[PathPoint] = []
    try:
        end = SEARCH.end_products
        while end > SEARCH.usual_tolerance:
            point = path.with_products(point, task.mu(end))
            passed.append(point)
            end *= SEARCH.decade
            try:
                return solve_interior_point(kkt, point.state, point.mu, task.tolerances, FINISHING)
            except SolverError as error:
                failed = error
    except SolverError as error:
        failed = error
    if len(passed) < 2:
        raise failed
    before, last = (point.iterate.load_factor for point in passed[-2:])
    change = abs(last - before) / max(abs(last), 1e-3 * task.scales.load_factor)
    if not change <= task.tolerance:
        known = "  load factor %.6g, which the last decade of products changed by %.1e"
        _log.info(known, last, change)
        raise failed
    iterate = falling(kkt).settled(passed[-1], 1e-6).iterate
    return Solution(kkt.state(iterate), kkt.sizes(iterate, kkt.residual(iterate)), 0, change)


# ---- attempts by the fixed point on the friction bound


def fixed_point(task: Task) -> Answer:
    """State by the fixed point, by the interior point method.

    The first bound is F times the dead load's normal forces, N per metre of thickness.
    """
    bound = task.case.problem.law.given(task.case.first_pressure)
    return _iterated(task, task.case.bonded_state(task.work), bound)


def fixed_point_equilibrium(task: Task, start: State, load_factor: float) -> State:
    """State at a prescribed load factor next to another one, or `SolverError`."""
    bound = task.case.problem.law.given(np.maximum(start.pressure, 0.0))
    solution, history = _iterated(task, start, bound, load_factor)
    if not history.converged:
        raise SolverError("the fixed point on the friction bound does not converge")
    return solution.state


def _iterated(task: Task, start: State, bound: Array, load_factor: float | None = None) -> Answer:
    """What the fixed point leads to, under the work of the task or a load factor."""
    case = task.case

    def solve(bound: Array, start: State, mu: float, change: float) -> Solution:
        # To second order in the change of the bound, which costs little.
        tolerance = max((SEARCH.bound_precision * change) ** 2, Tolerances().residual)
        work = task.work if load_factor is None else start.work
        kkt = case.given(bound, work, task.scales, load_factor)
        return solve_interior_point(kkt, start, mu, Tolerances(tolerance))

    def judge(state: State) -> bool:
        return load_factor is None and _is_collapse(task, state)

    count = case.discretization.factorizations
    return _passes(task, solve, judge, count).run(start, bound)


def _passes(
    task: Task,
    solve: GivenFriction,
    judge: Callable[[State], bool],
    count: Callable[[], int],
) -> FixedPoint:
    """The iteration of a task."""
    case = task.case
    omega = case.discretization.scene.solve.relaxation
    return FixedPoint(case.problem, solve, task.tolerance, judge, case.monitor, count, omega)


def _is_collapse(task: Task, state: State) -> bool:
    """Whether the certificate of a state says that it is the collapse, to the task's tolerance."""
    gap = SEARCH.work_gap * task.tolerance
    return is_collapse(task.case, state, task.scales, task.tolerance, gap)


def joint_forces(task: Task, minimise: Minimiser) -> Answer:
    """State by the fixed point on the friction bound, states with given friction by joint forces.

    Each digit of theirs costs sweeps: they are exact to first order in the change of the bound.
    `minimise` goes over normal and shear forces `alternately` or `at_once`.
    """
    case = task.case
    rows = case.discretization.operators
    points = JointPoints(rows.sides, rows.dofs, rows.normal_rows, rows.tangential_rows)
    with JointForceSolver(case.problem, points, state_residuals, minimise) as solver:

        def solve(bound: Array, start: State, mu: float, change: float) -> Solution:
            tolerance = SEARCH.digits
            if case.problem.coulomb:
                tolerance = max(SEARCH.bound_precision * change, SEARCH.digits)
            found = solver.solve(bound, task.work, start, task.scales, tolerance)
            return Solution(*found, 1)

        def count() -> int:
            return case.discretization.factorizations() + solver.factorizations

        start = case.bonded_state(task.work)
        bound = case.problem.law.given(case.first_pressure)
        judge = partial(_is_collapse, task)
        solution, history = _passes(task, solve, judge, count).run(start, bound)
        return solution, replace(history, splitting=solver.history)


# ---- the list


#: Iterations on the bound, which a user may ask for, take some 10 states with given friction.
ITERATED = replace(SEARCH, collapse_cost=SEARCH.iterated_cost)


@dataclass(frozen=True)
class Strategy:
    """How states of one kind of scene are found.

    Attributes:
        attempts: States at a prescribed work: what is tried, in order.
        further: State from one at less work, tried first where there is one; None: nothing.
        equilibrium: State at a prescribed load factor, next to another one.
        options: How the work grows, and what may be spent.
        asks: Whether programs are asked if anything limits the load; else that is known.
    """

    attempts: tuple[Attempt, ...]
    further: Attempt | None = None
    equilibrium: Callable[[Task, State, float], State] = coulomb_equilibrium
    options: SearchOptions = SEARCH
    asks: bool = True


#: Methods on joint forces, the same with Coulomb and with given friction.
JOINT_FORCES: dict[str, Strategy] = {
    name: Strategy(
        (partial(joint_forces, minimise=minimise),),
        equilibrium=fixed_point_equilibrium,
        # States far along the mode take many steps.
        options=replace(ITERATED, first_work=100.0, work_of_many=0.0, work_gap=1.0),
    )
    for name, minimise in (("splitting", alternately), ("active-set", at_once))
}

#: By method: with Coulomb friction, where the bound on friction depends on the pressure.
COULOMB: dict[str, Strategy] = {
    "auto": Strategy(
        (along_block_modes,),
        further_along_rising_work,
    ),
    "monolithic": Strategy((interior_point, along_falling_products)),
    "fixed-point": Strategy((fixed_point,), equilibrium=fixed_point_equilibrium, options=ITERATED),
    **JOINT_FORCES,
}

#: With given friction, or none, the problem is convex and the interior point method finds it.
GIVEN = Strategy((interior_point,))


def strategy_of(scene: Scene) -> Strategy:
    """How states of a scene are found."""
    laws = [*scene.joints.values(), *scene.foundations.values()]
    if any((law.friction or 0.0) > law.dilation for law in laws):
        return COULOMB[scene.solve.method]
    return JOINT_FORCES.get(scene.solve.method, GIVEN)
