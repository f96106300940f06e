"""The limit load of a scene: the one function that most users call."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fenics_contact.accuracy import to_accuracy
from fenics_contact.answers.question import MeshQuestion, answered, begun, of_curve
from fenics_contact.collapse.directions import SIGNS, directions, in_directions
from fenics_contact.collapse.engine import collapse_by_engine
from fenics_contact.collapse.least_forces import least_forces
from fenics_contact.collapse.load_case import Bonded, LoadCase
from fenics_contact.collapse.load_control import capacity_curve
from fenics_contact.collapse.reasons import explained, unfinished, within
from fenics_contact.collapse.record import Listener
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.collapse.service_state import rests, service_state
from fenics_contact.collapse.torn import torn_collapse
from fenics_contact.console import Progress, summary
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.warnings import pressed_too_much, turn_in
from fenics_contact.errors import InputError, SolverError, Stopped, checked
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.geometry.mesh import Array
from fenics_contact.lazily import fem
from fenics_contact.output.fields import displacement_function
from fenics_contact.output.files import write_result
from fenics_contact.output.pictured import Pictured
from fenics_contact.output.plotting import check_axes, draw_capacity, load_matplotlib, new_axes
from fenics_contact.output.view import View, view_of_collapse, view_of_fall
from fenics_contact.results.bounds import LimitBounds, rounded, signed
from fenics_contact.results.history import CapacityPoint, Step, TracePoint
from fenics_contact.results.result import (
    NOT_KNOWN,
    Collapse,
    Result,
    Shown,
    known_bounds,
    skipped,
    skipped_iterations,
)
from fenics_contact.results.words import mechanism_in_words
from fenics_contact.scene.scene import Scene
from fenics_contact.search_options import SEARCH
from fenics_contact.workers import (
    InPlace,
    asked_to_stop,
    ranks_of,
    workers_of,
)

_log = logging.getLogger("fenics_contact")

#: Points of a capacity curve for which the scene gives no number.
CURVE = 25
#: Points of a capacity curve, at most.
MOST_POINTS = 1000
#: Why a limit load by the forces of joint faces is without one.
NO_CURVE = "capacity curve: no loading path leads to a limit load by the forces of joint faces"
#: Factorisations of a collapse, about: a unit for what answers may cost that the curve needs.
CURVE_SOLVE = 10.0


class LimitLoad(Result, Pictured):
    """Result of `limit_load`, with its fields and files."""

    @property
    def mode(self) -> fem.Function | None:
        """Displacement field of the collapse, a dolfinx function; None without a limit."""
        if self.collapse is None or self.collapse.mode is None:
            return None
        return displacement_function(self.layout, self.collapse.mode, "collapse_mode")

    def _shown(self) -> Shown:
        end = self.collapse
        if end is None or end.state is None:
            return Shown(None if end is None else end.joints)
        return Shown(end.joints, self.layout.with_imposed(end.state), end.mode)

    def summary(self, verbose: bool = False) -> str:
        """The answer in some five lines. Collective: it solves for brackets.

        Args:
            verbose: With verification, what is not known and why, work and time.
        """
        return summary(self.with_brackets(), verbose)

    def mechanisms(self) -> dict[str, str]:
        """What moves in the collapse of each direction, in a sentence. Collective."""
        views = {name: view_of_collapse(self.layout, end) for name, end in self.limits.items()}
        return {name: mechanism_in_words(view.blocks) for name, view in views.items()}

    @checked
    def with_capacity(
        self,
        monitor: Monitor | None = None,
        points: int = 0,
        stop: Callable[[], str] = lambda: "",
    ) -> LimitLoad:
        """The result with its capacity curve, hundreds of factorisations. Collective.

        It is none of `limit_load`; `write` does so where the scene asks for a curve. It counts
        for `solve.time` like the solve before. Where the loading path was not followed to the
        collapse there is none, as `skipped` says.

        Args:
            monitor: Told of every point.
            points: Number of points; by default those of the scene's output options.
            stop: As of `limit_load`; points found by then are kept.
        """
        start = time.perf_counter()
        if not 0 <= points <= MOST_POINTS:
            raise InputError(f"points = {points} must lie in 0 ... {MOST_POINTS}")
        direction, end = next(iter(self.ends.items()), ("", None))
        points = points or self.scene.output.capacity or CURVE
        if end is None or end.status != "limit" or NO_CURVE in self.skipped:
            return self
        if end.changes_blocks:
            raise InputError("joints with opened = 'lost' have no capacity curve")
        if end.engine == "faces":
            if self.scene.comm.rank == 0:
                _log.warning("warning: %s", NO_CURVE)
            return replace(self, skipped=(*self.skipped, NO_CURVE))
        with Discretization(self.scene) as made:
            made.end_when(within(self.scene.solve.time, stop, self.seconds["total"]))
            sign = end.sign
            found: Collapse = signed(end, sign)
            curve: list[CapacityPoint] = []  # stays empty where it is stopped before its first one
            with suppress(Stopped):
                case = LoadCase.of(made, made.bonded(), sign, lambda step: None)
                question = MeshQuestion(scene=made.scene, case=case, end=found, cost=CURVE_SOLVE)
                found = of_curve(replace(question, by_curve=True))
                told = (monitor or _Silent()).point
                curve = capacity_curve(case, found, points, told)
            found = signed(found, sign)
        passed = time.perf_counter() - start
        seconds = {"capacity": passed, "total": self.seconds["total"] + passed}
        return replace(
            self,
            ends={**self.ends, direction: found},
            capacity=tuple(_rounded(point, found.size) for point in signed(tuple(curve), sign)),
            factorizations=self.factorizations + made.factorizations(),
            mode_factorizations=self.mode_factorizations + made.mode_tally.count,
            cost=self.cost + made.effort.spent,
            seconds={**self.seconds, **seconds},
        )

    @checked
    def trace_capacity(
        self,
        monitor: Monitor | None = None,
        points: int = 0,
        stop: Callable[[], str] = lambda: "",
    ) -> tuple[CapacityPoint, ...]:
        """Points of the capacity curve, traced at every call: `with_capacity` keeps them."""
        return self.with_capacity(monitor, points, stop).capacity

    def plot_capacity(self, axes: Any = None) -> Any:
        """Draw the capacity curve, as `plot`; it is traced if the result is without."""
        check_axes(axes)
        if self._view().faces is None:
            raise SolverError(f"there is no capacity curve: the status is '{self.status}'")
        curve = self.capacity or self.trace_capacity()
        if not curve:
            raise SolverError(NO_CURVE)
        if self.scene.comm.rank != 0:
            return None
        axes = new_axes() if axes is None else axes
        end = self.collapse
        if end is not None:
            draw_capacity(axes, curve, end)
        return axes

    def _view(self) -> View:
        """Collapse mode and joint forces, or the blocks that fall. Collective."""
        if self.fall is not None:
            return view_of_fall(self.layout, self.fall)
        end = self.collapse
        if end is None or end.mode is None or end.joints is None or end.status == "unbounded":
            raise SolverError(f"there is no collapse to draw: the status is '{self.status}'")
        return view_of_collapse(self.layout, end)

    @checked
    def write(
        self,
        folder: str | Path,
        hurry: Callable[[], bool] = lambda: False,
        beside: Executor | None = None,
    ) -> None:
        """Write result.json, and what the scene's output options say; the folder is made.

        It solves for the brackets, and traces the capacity curve where the scene asks for one, if
        the result is without. Once `hurry` is true, on all ranks, only result.json and the report
        are written. Pictures are drawn `beside` the other files, see `limit_load`.
        """
        curve = self.scene.output.capacity and not (self.capacity or self.stopped)
        whole = self.with_capacity() if curve else self
        write_result(whole.with_brackets(), Path(folder), hurry, beside)


class Monitor(Protocol):
    """Is told how a run goes, on all ranks."""

    def phase(self, name: str) -> None:
        """Something else begins."""
        return

    def passed(self, direction: str, point: TracePoint, upper: float | None) -> None:
        """A point of the path that leads to the collapse was passed.

        `upper` is the end of the bracket on this side of zero; None where it is not known yet.
        """
        return

    def step(self, direction: str, step: Step) -> None:
        """After a step in direction "positive" or "negative"."""
        return

    def point(self, done: int, total: int, point: CapacityPoint) -> None:
        """After a point of the capacity curve."""
        return

    def of_worker(self) -> Monitor | None:
        """What is told of another direction by another process; None for nobody."""
        return None


class _Silent(Monitor):
    """A monitor that says nothing."""


class _Direction(Listener):
    """Tells a monitor of the path in one direction, on rank 0 with the end of the bracket."""

    case: LoadCase | None = None

    def __init__(self, monitor: Monitor, name: str) -> None:
        self._monitor = monitor
        self._name = name

    def phase(self, name: str) -> None:
        """Something else begins."""
        self._monitor.phase(name)

    def passed(self, point: TracePoint) -> None:
        """A point of the path was passed."""
        if isinstance(self._monitor, _Silent) or self.case is None:
            return
        limit = self.case.blocks.limit_so_far() if self.case.problem.comm.rank == 0 else None
        self._monitor.passed(self._name, point, None if limit is None else self.case.sign * limit)


@checked
def limit_load(
    scene: Scene,
    monitor: Monitor | None = None,
    *,
    progress: bool = False,
    stop: Callable[[], str] = lambda: "",
    beside: Executor | None = None,
) -> LimitLoad:
    """Compute the limit load of a scene.

    Args:
        scene: What to solve.
        monitor: Told how the run goes: has the methods of `fenics_contact.limit_load.Monitor`, from
            which it can be derived.
        progress: Print how it goes, on rank 0, where there is no monitor.
        stop: Asked now and then, on every rank, who wants the run to end, in words; empty while
            nobody does. What is known by then is the result.
        beside: Does whole tasks beside this process, see `fenics_contact.workers`: the other
            direction, brackets, other collapse states. The answer is the same without.

    Returns:
        The result; look at its status.

    Raises:
        InputError: If joints, supports or loads of the scene do not fit its mesh.
    """
    start = time.perf_counter()
    if progress and monitor is None and scene.comm.rank == 0:
        monitor = Progress(scene.solve.tolerance)
    asked = within(scene.solve.time, stop)
    with Discretization(scene) as discretization:
        for text in discretization.warnings if scene.comm.rank == 0 else ():
            _log.warning("warning: %s", text)
        result = limit_load_of(discretization, monitor, asked, beside)
    if scene.solve.accuracy is not None and result.status == "limit":

        def on(finer: Scene) -> LimitLoad:
            with Discretization(finer) as discretization:
                return limit_load_of(discretization, monitor, asked, beside)

        result = to_accuracy(result, on)
    total = {"total": time.perf_counter() - start}
    return replace(result, seconds={**result.seconds, **total}, ranks=ranks_of(beside))


def limit_load_of(
    discretization: Discretization,
    monitor: Monitor | None = None,
    asked: Callable[[], str] | None = None,
    beside: Executor | None = None,
) -> LimitLoad:
    """The limit load of a discretised scene; see `limit_load`.

    `asked` says why the run is to end, as `stopping.within` does.
    """
    discretization.check_pushed()
    scene = discretization.scene
    monitor = monitor or _Silent()
    discretization.end_when(asked or within(scene.solve.time))
    seconds = {"compile": discretization.compile_seconds, "assemble": discretization.seconds}
    try:
        result = _solved(discretization, monitor, seconds, beside or InPlace())
        return result.hold_against_brackets() if _far_apart(discretization) else result
    except Stopped as stop:
        nothing = Collapse(reason=f"{stop}, before any state was looked for")
        names = directions(scene.solve.direction)
        return _result(discretization, dict.fromkeys(names, nothing), seconds)


def _far_apart(discretization: Discretization) -> bool:
    """Whether some block is so light that residuals over typical forces say nothing of it."""
    model = PlanarFaces.of(discretization).model
    return bool(model.sizes.min(initial=np.inf) < 10.0 * SEARCH.verified * model.force)


def _solved(
    discretization: Discretization, monitor: Monitor, seconds: dict[str, float], beside: Executor
) -> LimitLoad:
    """The limit load of a discretised scene; `seconds` gets the time of every phase.

    Raises:
        Stopped: If the run is to end before any collapse is looked for.
    """
    scene = discretization.scene
    start = time.perf_counter()
    blocks = RigidBlocks.of(discretization, check_stop=discretization.effort.wait)
    lower = None
    with suppress(SolverError):  # not known of many blocks
        lower = 0.0 if blocks.frictionless.stands() else None
    fall = blocks.fall() if lower is None else None
    seconds["bounds"] = time.perf_counter() - start
    if fall is not None:
        return _result(discretization, {}, seconds, fall)

    def begin(name: str, workers: Executor) -> Future[dict[str, Any]]:
        alone = replace(scene, solve=replace(scene.solve, direction=name))
        return workers.submit(solved_beside, alone, monitor.of_worker())

    shares = scene.solve.direction == "both" and workers_of(beside) > 0

    @cache
    def bonded() -> Bonded:
        monitor.phase("one elastic solve with closed joints")
        return discretization.bonded()

    def solve(name: str, own: Executor) -> Collapse:
        listener = _Direction(monitor, name)
        told = partial(monitor.step, name)
        listener.case = LoadCase.of(discretization, bonded(), SIGNS[name], told, listener)
        end = _collapse(replace(listener.case, beside=own), lower, monitor, seconds)
        if shares and not discretization.effort.watch.reason:  # not while others are waited for
            with suppress(Stopped):
                end.program()
        return signed(end, SIGNS[name])

    wait = discretization.effort.wait
    found = in_directions(scene.solve.direction, beside, begin, solve, wait)
    seconds["bonded"] = bonded().seconds
    here = {name: end for name, end in found.items() if isinstance(end, Collapse)}
    result = _result(discretization, here, seconds)
    for part in found.values():
        result = result if isinstance(part, Collapse) else _with_part(result, part)
    return result


def solved_beside(scene: Scene, monitor: Monitor | None) -> dict[str, Any]:
    """A task: collapse and bracket of a scene with one direction, as fields of a `LimitLoad`."""
    with Discretization(scene) as made:
        found = limit_load_of(made, monitor, within(scene.solve.time, asked_to_stop))
    for end in found.ends.values():
        end.program()
    return vars(found) | {"layout": None}


def _with_part(result: LimitLoad, part: dict[str, Any]) -> LimitLoad:
    """A result with what a worker found."""
    spent = "factorizations", "mode_factorizations", "cost"
    ends = {**result.ends, **part["ends"]}
    return replace(
        result,
        ends=ends,
        skipped=_skipped(result.scene, ends),
        stopped=result.stopped or part["stopped"],
        **{name: getattr(result, name) + part[name] for name in spent},
    )


def _collapse(
    case: LoadCase, lower: float | None, monitor: Monitor, seconds: dict[str, float]
) -> Collapse:
    """The collapse of a load case with all that its scene asks for.

    `lower` is 0 where the dead load stands without friction, and None where it does not. Where the
    run is stopped it is what is known.
    """
    whole = case.discretization
    effort = whole.effort
    before = effort.spent
    start = time.perf_counter()
    if not isinstance(case.beside, InPlace):
        case.blocks.begin(case.beside)
    tasks = begun(case)
    if whole.scene.output.pictures and not isinstance(case.beside, InPlace):
        case.beside.submit(load_matplotlib)  # last: pictures are drawn there
    try:
        stands = lower is not None or rests(whole)
        if not stands and service_state(case, 0.0).status != "equilibrium":
            end = Collapse("no_equilibrium", math.nan, case.blocks.bounds, reason=NOT_KNOWN)
        elif np.any(whole.joints.losing):
            before = effort.spent
            end, case = torn_collapse(case, collapse_by_engine)
        else:
            before = effort.spent
            end = collapse_by_engine(case)
    except Stopped as stop:
        end = unfinished(case, str(stop))
    seconds["solve"] = seconds.get("solve", 0.0) + time.perf_counter() - start
    cost = effort.spent - before
    question = MeshQuestion(scene=whole.scene, case=case, end=explained(case, end), cost=cost)
    end = answered(question, monitor.phase, seconds, tasks)
    if end.status == "limit" and (joints := end.joints) is not None:
        if not case.blocks.has_strength:
            joints = least_forces(case.discretization, joints)
        turned = turn_in(whole.joints.without_ties(), joints.normal_force)
        pressed = pressed_too_much(whole.joints, joints.normal_force)
        end = replace(end, joints=joints, rolling=turned, pressed=pressed)
    if effort.watch.reason:  # as far as it is known without a long program
        so_far = LimitBounds(lower, case.blocks.limit_so_far(), lower)
        end = replace(end, program=partial(known_bounds, whole.scene.comm.bcast(so_far)))
    return end


def _skipped(scene: Scene, ends: Mapping[str, Collapse]) -> tuple[str, ...]:
    """Parts of the analysis that were not needed, with the reasons."""
    histories = [one for end in ends.values() for one in end.history]
    return (*skipped(scene), *skipped_iterations(histories))


def _result(
    discretization: Discretization,
    ends: dict[str, Collapse],
    seconds: dict[str, float],
    fall: Array | None = None,
) -> LimitLoad:
    ends = {name: _rounded(end, end.size) for name, end in ends.items()}
    return LimitLoad(
        discretization.layout,
        ends,
        _skipped(discretization.scene, ends),
        seconds,
        discretization.factorizations(),
        discretization.mode_tally.count,
        discretization.effort.spent,
        stopped=discretization.effort.watch.reason,
        fall=fall,
    )


def _rounded(record: Any, size: float) -> Any:
    """A record whose load factor is 0 where it cannot be told from it; see `bounds.rounded`."""
    return replace(record, load_factor=rounded(record.load_factor, size))
