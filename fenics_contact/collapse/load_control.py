"""Equilibrium states on the way to the collapse: load control, and the capacity curve.

Load control prescribes the load factor and raises it in steps from the dead load, each starting
from the state before. Where no equilibrium is found the step is shortened, until the last load
factor with a state of equilibrium and the first without are close. Slip is measured from the
stress-free state, or from the step before, the dead load first (L.A. Mihai, M. Ainsworth, Comput.
Struct. 88 (2010) 859). The capacity curve prescribes the work of the live load instead.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from fenics_contact.collapse.load_case import LoadCase, LoadingPath, Task
from fenics_contact.collapse.strategy import next_to, rising_mu, strategy_of, to_end
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.errors import EffortError, NoEquilibriumError, SolverError, Stopped
from fenics_contact.results.bounds import signed
from fenics_contact.results.history import CapacityPoint, LoadPath, LoadStep
from fenics_contact.results.result import NOT_KNOWN, Collapse
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.problem import Array, ContactProblem, State

_log = logging.getLogger("fenics_contact")

#: Distance from the load factor of the collapse, relative, below which a path is on its plateau.
PLATEAU = 1e-4


def raise_load(case: LoadCase) -> Collapse:
    """The collapse that is found from the last state under rising load factors.

    The first state is next to the bonded response to the dead load.
    """
    bounds = case.blocks.classical_bounds()
    if bounds.lower == np.inf:
        wedging = case.blocks.wedging()
        return Collapse("unbounded", float(np.inf), case.blocks.bounds, wedging=wedging)
    climb = _Climb(case)
    tolerance = climb.options.tolerance
    upper = np.inf if bounds.upper is None else bounds.upper
    try:
        with case.discretization.effort.at_most(SEARCH.iterated_cost):
            climb.bracket(upper)
    except EffortError as error:
        _log.info("  load control: %s", error)
    except SolverError as error:
        _log.warning("load control: %s", error)
        return Collapse("not_converged", float("nan"), case.blocks.bounds)
    margin = 10.0 * tolerance * max(climb.lower, case.scales.load_factor)
    low = climb.lower - margin
    high = min(climb.failed, upper) + margin
    attempts = (next_to(climb.state, climb.direction), *climb.strategy.attempts)
    found = find_collapse(climb.case, replace(climb.strategy, attempts=attempts), tolerance)
    if found.status != "limit" and case.problem.coulomb:
        against = _against_the_live_load(climb)
        if against.status == "limit" and low <= against.load_factor <= high:
            found = against
    if found.load_factor < low or found.load_factor > high:  # none is neither
        _log.warning(
            "the collapse found at %.8g is not between the load factors %.8g and %.8g with and"
            " without equilibrium on the path: another state",
            *(found.load_factor, climb.lower, climb.failed),
        )
    return replace(found, path=LoadPath(tuple(climb.steps), climb.lower, climb.failed))


def _against_the_live_load(climb: _Climb) -> Collapse:
    """The collapse next to the last state in which the live load does negative work.

    A live load that relieves sliding joints of their normal forces sets them off; the dead load
    then moves the blocks, against the live load perhaps. The work of the live load falls on the way
    there, and that of its reverse rises.
    """
    case = climb.case.reversed()
    last = climb.state
    state = case.problem.state(last.displacement, -last.load_factor, last.pressure, last.shear)
    strength = case.discretization.all_points(case.problem.law.given(state.pressure))
    motion = case.blocks.collapse(strength)[1]
    direction = None if motion is None else case.discretization.rigid_motion(motion)
    strategy = replace(climb.strategy, attempts=(next_to(state, direction),))
    found = signed(find_collapse(case, strategy, climb.options.tolerance), -1.0)
    # The lower end holds where the live load does positive work.
    return replace(found, program=climb.case.blocks.classical_bounds, sign=1.0)


def raise_load_to(case: LoadCase, load_factor: float, steps: int) -> tuple[ContactProblem, State]:
    """State of equilibrium at a load factor >= 0, reached in equal steps from the dead load.

    With the structure, which has the origin of slip at which it was found.

    Args:
        case: The load case.
        load_factor: Not negative.
        steps: Number of steps to it.

    Raises:
        NoEquilibriumError: If none is found under the dead load alone, with Coulomb friction.
        SolverError: If none is found otherwise, there or on the way.
    """
    climb = _Climb(case)
    if case.has_dead_load:  # its state is found soon or not at all
        rests = False
        with suppress(EffortError), case.discretization.effort.at_most(SEARCH.collapse_cost):
            rests = climb.reaches(0.0)
        if not rests and case.problem.coulomb:
            raise NoEquilibriumError(NOT_KNOWN)
        if not rests:  # though programs prove that there is one
            raise SolverError("no equilibrium was found under the dead load")
    step = load_factor / steps
    least = SEARCH.side_accuracy * step
    while climb.lower < load_factor:
        new = min(climb.lower + step, load_factor)
        # Equal steps end at the load factor, but for rounding.
        new = load_factor if load_factor - new < least else new
        if climb.reaches(new):
            continue
        if step <= least:
            where = f"up to a load factor of {climb.lower:.6g}, not at {new:.6g}"
            raise SolverError(f"equilibrium was found {where}")
        step *= 0.5
    state = climb.state
    elastic = case.scales.elastic
    if elastic < case.scales.displacement:  # supports move: closed joints have lost digits
        scales = replace(case.scales, displacement=elastic)
        near = replace(case, problem=climb.problem)
        with suppress(SolverError):
            task = Task(near, state.work, scales, climb.options.tolerance)
            state = climb.strategy.equilibrium(task, state, load_factor)
    return climb.problem, state


class _Climb:
    """States at rising load factors.

    Attributes:
        case: The load case, with the origin of slip.
        strategy: How states are found.
        options: Of the scene.
        problem: The structure as it was when the last state was found.
        state: The last state of equilibrium.
        direction: Displacements of the last step, f_L.v = 1; None with less than two states.
        steps: States of equilibrium.
        lower: Largest load factor with a state of equilibrium.
        failed: Least load factor at which none was found; infinite if none failed.
    """

    def __init__(self, case: LoadCase) -> None:
        """Begin next to the bonded response to the dead load."""
        self.case = case
        self.strategy = strategy_of(case.discretization.scene)
        self.options = case.discretization.scene.solve
        none = np.zeros_like(case.first_pressure)
        self.state = case.problem.state(case.bonded.dead, 0.0, case.first_pressure, none)
        self.problem = case.problem
        self.direction: Array | None = None
        self.steps: list[LoadStep] = []
        self.lower = 0.0
        self.failed = np.inf

    def bracket(self, upper: float) -> None:
        """Raise the load factor until the limit load, at most `upper`, is between two close ones.

        Raises:
            SolverError: If no equilibrium is found under the dead load.
            EffortError: If the limit of its cost is reached.
        """
        typical = self.case.scales.load_factor
        width = max(SEARCH.side_accuracy, self.options.tolerance)
        step = 0.25 * min(upper, typical)
        target = 0.0
        again = False
        while True:
            if self.reaches(target):
                if again:  # the step that failed before may have been too long for the solver alone
                    step = 2.0 * (target - self.steps[-2].load_factor)
                    self.failed = np.inf
                again = False
                step *= 1.5 if len(self.steps) > 2 else 1.0
            elif not self.steps:
                raise SolverError("no equilibrium was found under the dead load")
            else:
                self.failed = target
                if again:
                    return
            end = min(self.failed, upper)
            narrow = width * max(self.lower, SEARCH.small_factor * typical)
            if self.lower > SEARCH.largest * typical or upper - self.lower <= narrow:
                return
            again = end - self.lower <= narrow
            target = self.failed if again else self.lower + min(step, 0.5 * (end - self.lower))

    def reaches(self, target: float) -> bool:
        """Whether a state of equilibrium is found at a load factor; it becomes the last one."""
        case = self.case
        before = self.state
        unit = case.problem.sum(np.abs(case.problem.live))
        far = max(case.scales.displacement, abs(before.work) / unit)
        scales = replace(case.scales, displacement=far)
        task = Task(case, before.work, scales, self.options.tolerance)
        try:
            state = self.strategy.equilibrium(task, before, target)
            if abs(state.work) > 1e6 * case.scales.displacement * unit:
                raise SolverError("the blocks move as a mechanism")
        except EffortError:
            raise
        except SolverError as error:
            _log.info("  load factor %.8g: no equilibrium found (%s)", target, error)
            return False
        self.steps.append(LoadStep(target, *_moved(case, state)))
        _log.info("  load factor %.8g: equilibrium, f_L.u = %.4g", target, state.work)
        moved = state.work - before.work
        if len(self.steps) > 1 and moved > 0.0:
            self.direction = (state.displacement - before.displacement) / moved
        self.state = state
        self.lower = target
        self.problem = case.problem
        case.record.passed("rising load factor", target, state.work, lambda: state)
        if self.options.slip == "load-steps":
            origin = case.problem.law.slip_origin + case.problem.motion_of(state)[1]
            self.case = replace(case, problem=case.problem.with_law(slip_origin=origin))
        return True


def _moved(case: LoadCase, state: State) -> tuple[float, float, Array | None]:
    """Mean displacement along the live load, m, its work, and displacements, if asked for."""
    written = case.written(state)
    output = case.discretization.scene.output
    kept = output.paraview and output.capacity
    moved = written.work / case.problem.sum(np.abs(case.problem.live))
    return moved, written.work, written.displacement if kept else None


def capacity_curve(
    case: LoadCase,
    end: Collapse,
    points: int,
    monitor: Callable[[int, int, CapacityPoint], None],
) -> list[CapacityPoint]:
    """Load factors at rising work up to a collapse.

    Slip is measured from the stress-free state. With load control its steps are the points. Points
    at which no state was found have nan, and are not `converged`. The monitor is told the number
    of a point that was found, that of all, and the point. A curve that is stopped ends with the
    last point found.
    """
    if end.path is not None:
        return [CapacityPoint(**vars(step)) for step in end.path.steps]
    if end.state is None:
        return []
    unit = case.problem.sum(np.abs(case.problem.live))
    # Denser at first, where the path bends.
    fractions = (np.arange(1, points + 1) / points) ** 1.5
    last = end.state.work
    found: dict[int, CapacityPoint] = {}
    works: list[float] = []
    try:
        last = _early_plateau(case, end, end.state) or last
        works = [float(last * part) for part in fractions]
        for number, state in _states_at(case, works):
            found[number] = CapacityPoint(state.load_factor, *_moved(case, state))
            monitor(number, points, found[number])
    except Stopped as stop:
        _log.warning("capacity curve: %s", stop)
        works = works[: max(found, default=0)]
    none = (CapacityPoint(math.nan, work / unit, work, converged=False) for work in works)
    curve = [found.get(number, missing) for number, missing in enumerate(none, 1)]
    for answer in end.answers.values():
        if (carried := getattr(answer.value, "state", None)) is not None:
            curve.append(CapacityPoint(carried.load_factor, *_moved(case, carried)))
    return sorted(curve, key=lambda point: point.work)


def _states_at(case: LoadCase, works: Sequence[float]) -> Iterator[tuple[int, State]]:
    """States of the path at rising works, each with the number of its work; 1 is the first."""
    tolerance = case.discretization.scene.solve.tolerance
    task = Task(case.unrecorded, works[-1], case.scales_at(works[-1]), tolerance)
    path = LoadingPath(task)
    point = path.begin(min(case.bonded_work, works[0]), rising_mu(task))
    for number, work in enumerate(works, 1):
        try:
            *_, end_of_step = path.points(point, work)
            point = end_of_step.point
            yield number, to_end(replace(task, work=work), end_of_step.state, point.mu).state
        except SolverError as error:
            _log.info("capacity curve: no state with T = %.3g: %s", work, error)


def _early_plateau(case: LoadCase, end: Collapse, onset: State) -> float:
    """Work at twice that from which the path is on its plateau; 0 where this is near the onset.

    A path that passes above the collapse on its way is followed as far as the onset.
    """
    if any(getattr(one.value, "state", None) is not None for one in end.answers.values()):
        return 0.0
    count = max(int(math.log2(max(onset.work / case.bonded_work, 1.0))), 1)
    works = [case.bonded_work * 2.0**k for k in range(count)]
    flat = 0
    for number, state in _states_at(case, works):
        away = abs(state.load_factor - onset.load_factor) > PLATEAU * abs(onset.load_factor)
        flat = 0 if away else flat + 1
        if flat == 2:
            return works[number - 1]
    return 0.0
