"""The limit load of a scene: the one function that most users call."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from dolfinx import fem

from fenics_contact.accuracy import to_accuracy
from fenics_contact.answers.question import answered, of_curve
from fenics_contact.collapse.engine import collapse_by_engine
from fenics_contact.collapse.least_forces import least_forces
from fenics_contact.collapse.load_case import SIGNS, LoadCase
from fenics_contact.collapse.load_control import capacity_curve
from fenics_contact.collapse.reasons import explained, unfinished, within
from fenics_contact.collapse.record import Listener
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.collapse.service_state import rests, service_state
from fenics_contact.collapse.strategy import strategy_of
from fenics_contact.collapse.torn import torn_collapse
from fenics_contact.console import Progress, summary
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.warnings import pressed_too_much, turn_in
from fenics_contact.errors import InputError, SolverError, Stopped, checked
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.fields import displacement_function
from fenics_contact.output.files import write_result
from fenics_contact.output.pictured import Pictured
from fenics_contact.output.plotting import check_axes, draw_capacity, new_axes
from fenics_contact.output.view import View, caption_of, view_of
from fenics_contact.results.bounds import LimitBounds, rounded, signed
from fenics_contact.results.history import CapacityPoint, Step, TracePoint
from fenics_contact.results.result import (
    NOT_KNOWN,
    Collapse,
    Result,
    known_bounds,
    skipped,
    skipped_iterations,
)
from fenics_contact.scene.scene import Scene

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

    @property
    def displacement(self) -> fem.Function | None:
        """Displacements at the state reached, m, a dolfinx function; None if there is none."""
        if self.collapse is None or self.collapse.state is None:
            return None
        values = self.layout.with_imposed(self.collapse.state).displacement
        return displacement_function(self.layout, values, "displacement")

    def _elastic(self) -> Array | None:
        if self.collapse is None or self.collapse.state is None:
            return None
        return self.layout.with_imposed(self.collapse.state).elastic

    def summary(self) -> str:
        """Load factors, brackets and verification as text. Collective: it solves for brackets."""
        return summary(self.with_brackets())

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
            kind = strategy_of(made.scene).kind
            sign = end.sign
            found: Collapse = signed(end, sign)
            curve: list[CapacityPoint] = []  # stays empty where it is stopped before its first one
            with suppress(Stopped):
                case = LoadCase.of(made, made.bonded(kind), sign, kind, lambda step: None)
                found = of_curve(case, found, CURVE_SOLVE)
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
        if self._view().values is None:
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
            falling = self.layout.rigid_motion(self.fall)
            return replace(view_of(self.layout, falling), marked=self.falling)
        end = self.collapse
        if end is None or end.mode is None or end.joints is None or end.status == "unbounded":
            raise SolverError(f"there is no collapse to draw: the status is '{self.status}'")
        sign = -1.0 if self.positive is None else 1.0
        view = view_of(self.layout, end.mode, end.joints, sign)
        return replace(view, caption=caption_of(self.status, end.engine))

    @checked
    def write(self, folder: str | Path, hurry: Callable[[], bool] = lambda: False) -> None:
        """Write result.json, and what the scene's output options say; the folder is made.

        It solves for the brackets, and traces the capacity curve where the scene asks for one, if
        the result is without. Once `hurry` is true, on all ranks, only result.json and the report
        are written.
        """
        curve = self.scene.output.capacity and not (self.capacity or self.stopped)
        whole = self.with_capacity() if curve else self
        write_result(whole.with_brackets(), Path(folder), hurry)


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


class _Silent(Monitor):
    """A monitor that says nothing."""


class _Direction(Listener):
    """Tells a monitor of the path in one direction, on rank 0 with the end of the bracket."""

    def __init__(self, monitor: Monitor, name: str, cases: Mapping[str, LoadCase]) -> None:
        self._monitor = monitor
        self._name = name
        self._cases = cases

    def phase(self, name: str) -> None:
        """Something else begins."""
        self._monitor.phase(name)

    def passed(self, point: TracePoint) -> None:
        """A point of the path was passed."""
        if isinstance(self._monitor, _Silent):
            return
        case = self._cases[self._name]
        limit = case.blocks.limit_so_far() if case.problem.comm.rank == 0 else None
        upper = None if limit is None else case.sign * limit
        self._monitor.passed(self._name, point, upper)


@checked
def limit_load(
    scene: Scene,
    monitor: Monitor | None = None,
    *,
    progress: bool = False,
    stop: Callable[[], str] = lambda: "",
) -> LimitLoad:
    """Compute the limit load of a scene.

    Args:
        scene: What to solve.
        monitor: Told how the run goes: has the methods of `fenics_contact.limit_load.Monitor`, from
            which it can be derived.
        progress: Print how it goes, on rank 0, where there is no monitor.
        stop: Asked now and then, on every rank, who wants the run to end, in words; empty while
            nobody does. What is known by then is the result.

    Returns:
        The result; look at its status.

    Raises:
        InputError: If joints, supports or loads of the scene do not fit its mesh.
    """
    start = time.perf_counter()
    if progress and monitor is None and scene.comm.rank == 0:
        monitor = Progress(scene.solve.tolerance)
    asked = within(scene.solve.time, stop)
    for item in skipped(scene):
        _log.info("skipped: %s", item)
    with Discretization(scene) as discretization:
        for text in discretization.warnings if scene.comm.rank == 0 else ():
            _log.warning("warning: %s", text)
        result = limit_load_of(discretization, monitor, asked)
    if scene.solve.accuracy is not None and result.status == "limit":

        def on(finer: Scene) -> LimitLoad:
            with Discretization(finer) as discretization:
                return limit_load_of(discretization, monitor, asked)

        result = to_accuracy(result, on)
    total = {"total": time.perf_counter() - start}
    return replace(result, seconds={**result.seconds, **total})


def limit_load_of(
    discretization: Discretization,
    monitor: Monitor | None = None,
    asked: Callable[[], str] | None = None,
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
        return _solved(discretization, monitor, seconds)
    except Stopped as stop:
        reason = f"{stop}, before any state was looked for"
        unknown = partial(known_bounds, LimitBounds(None, None))
        nothing = Collapse("not_converged", math.nan, unknown, reason=reason)
        return _result(discretization, dict.fromkeys(_directions(scene), nothing), seconds)


def _directions(scene: Scene) -> tuple[str, ...]:
    """Directions of the live load that are asked for."""
    direction = scene.solve.direction
    return tuple(SIGNS) if direction == "both" else (direction,)


def _solved(
    discretization: Discretization, monitor: Monitor, seconds: dict[str, float]
) -> LimitLoad:
    """The limit load of a discretised scene; `seconds` gets the time of every phase.

    Raises:
        Stopped: If the run is to end before any collapse is looked for.
    """
    scene = discretization.scene
    asked = _directions(scene)
    start = time.perf_counter()
    blocks = RigidBlocks.of(discretization, check_stop=discretization.effort.wait)
    lower = 0.0 if blocks.frictionless.stands() else None
    fall = blocks.fall() if lower is None else None
    seconds["bounds"] = time.perf_counter() - start
    if fall is not None:
        return _result(discretization, {}, seconds, fall)
    kind = strategy_of(scene).kind
    monitor.phase("one elastic solve with closed joints")
    bonded = discretization.bonded(kind)
    seconds["bonded"] = bonded.seconds
    start = time.perf_counter()
    cases: dict[str, LoadCase] = {}
    for name, sign in SIGNS.items():
        listener = _Direction(monitor, name, cases) if name in asked else None
        told = partial(monitor.step, name)
        cases[name] = LoadCase.of(discretization, bonded, sign, kind, told, listener)
    found, cost = _collapses(cases, asked, lower)
    seconds["solve"] = time.perf_counter() - start
    found = answered(cases, found, cost, monitor.phase, seconds)
    for name, end in found.items():
        if end.status == "limit" and not blocks.crushes:
            least = end.joints and least_forces(cases[name].discretization, end.joints)
            found[name] = replace(end, joints=least)
        if end.status == "limit" and end.joints is not None:
            turned = turn_in(discretization.joints.without_ties(), end.joints.normal_force)
            pressed = pressed_too_much(scene, discretization.joints, end.joints.normal_force)
            found[name] = replace(found[name], rolling=turned, pressed=pressed)
        if discretization.effort.watch.reason:  # as far as it is known without a long program
            so_far = LimitBounds(lower, cases[name].blocks.limit_so_far(), lower)
            program = partial(known_bounds, scene.comm.bcast(so_far))
            found[name] = replace(found[name], program=program)
    ends = {name: signed(found[name], SIGNS[name]) for name in asked}
    return _result(discretization, ends, seconds)


def _collapses(
    cases: dict[str, LoadCase],
    asked: Sequence[str],
    lower: float | None,
) -> tuple[dict[str, Collapse], float]:
    """Collapses by direction, and the cost of one; what is known, where the run is stopped.

    `cases` become those whose joints are torn as at the collapse. `lower` is 0 where the dead load
    stands without friction, and None where it does not.
    """
    first = cases[asked[0]]
    effort = first.discretization.effort
    tears = bool(np.any(first.discretization.joints.losing))
    before = effort.spent
    found: dict[str, Collapse] = {}
    try:
        stands = lower is not None or rests(first.discretization)
        if not stands and service_state(first, 0.0).status != "equilibrium":
            for name in asked:
                bounds = cases[name].blocks.bounds
                found[name] = Collapse("no_equilibrium", math.nan, bounds, reason=NOT_KNOWN)
            return found, effort.spent - before
        before = effort.spent
        for name in asked:
            if tears:
                found[name], cases[name] = torn_collapse(cases[name], collapse_by_engine)
            else:
                found[name] = collapse_by_engine(cases[name])
    except Stopped as stop:
        found = {name: found.get(name) or unfinished(cases[name], str(stop)) for name in asked}
    cost = (effort.spent - before) / max(len(found), 1)
    return {name: explained(cases[name], found[name]) for name in asked}, cost


def _result(
    discretization: Discretization,
    ends: dict[str, Collapse],
    seconds: dict[str, float],
    fall: Array | None = None,
) -> LimitLoad:
    ends = {name: _rounded(end, end.size) for name, end in ends.items()}
    spared = skipped_iterations([one for end in ends.values() for one in end.history])
    for item in spared:
        _log.info("skipped: %s", item)
    return LimitLoad(
        discretization.layout,
        ends,
        (*skipped(discretization.scene), *spared),
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
