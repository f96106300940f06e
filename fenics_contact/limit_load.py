"""The limit load of a scene: the one function that most users call."""

from __future__ import annotations

import io
import logging
import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from dolfinx import fem

from fenics_contact.analysis.accuracy import to_accuracy
from fenics_contact.analysis.crushed import CrushedJoints, crushed_collapse, crushed_like
from fenics_contact.analysis.dead_load import reaching_zero
from fenics_contact.analysis.hinges import with_mesh_error
from fenics_contact.analysis.history import CapacityPoint, Lowest, Step
from fenics_contact.analysis.joint_values import JointValues
from fenics_contact.analysis.least_forces import with_least_forces
from fenics_contact.analysis.load_case import SIGNS, LoadCase
from fenics_contact.analysis.load_control import capacity_curve, raise_load
from fenics_contact.analysis.lowest import find_lowest, second_opinion
from fenics_contact.analysis.nearby import Softened, collapse_next_to
from fenics_contact.analysis.nearby import near as start_near
from fenics_contact.analysis.peak import NOT_ASKED, Above, Limits, Peak, find_peak
from fenics_contact.analysis.plan import skipped, skipped_iterations
from fenics_contact.analysis.reasons import explained
from fenics_contact.analysis.result import Collapse, Result
from fenics_contact.analysis.rigid_blocks import RigidBlocks
from fenics_contact.analysis.service_state import service_state
from fenics_contact.analysis.strategy import strategy_of
from fenics_contact.analysis.work_control import find_collapse
from fenics_contact.console import Progress, summary
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import SolverError
from fenics_contact.mesh import Array
from fenics_contact.output.fields import displacement_function
from fenics_contact.output.files import write_result
from fenics_contact.output.plotting import (
    draw_capacity,
    draw_forces,
    draw_mode,
    new_axes,
    save_collapse,
)
from fenics_contact.output.view import View, view_of
from fenics_contact.scene import Scene

_log = logging.getLogger("fenics_contact")

#: Points of a capacity curve for which the scene gives no number.
CURVE = 25
#: Factorisations of a collapse, about: a unit for what the curve's peak may cost.
CURVE_SOLVE = 10.0


class LimitLoad(Result):
    """Result of `limit_load`, with its fields and files."""

    @property
    def mode(self) -> fem.Function | None:
        """Displacement field of the collapse, a dolfinx function; None without a limit."""
        if self.collapse is None or self.collapse.mode is None:
            return None
        return displacement_function(self.discretization, self.collapse.mode, "collapse_mode")

    @property
    def displacement(self) -> fem.Function | None:
        """Displacements at the state reached, m, a dolfinx function; None if there is none."""
        if self.collapse is None or self.collapse.state is None:
            return None
        values = self.discretization.with_imposed(self.collapse.state).displacement
        return displacement_function(self.discretization, values, "displacement")

    def hold_against_brackets(self) -> None:
        """Solve the rigid-block programs for the brackets, and see that load factors are inside.

        `write` does so. Not done by `limit_load`: the programs may take longer than the limit load
        of a large wall, and the forces of a verified state imply what they say.
        """
        start = time.perf_counter()
        self.ends = {name: end.held_against_bracket() for name, end in self.ends.items()}
        self.seconds["bounds"] += time.perf_counter() - start

    def summary(self) -> str:
        """Load factors, brackets and verification as text. Collective: it solves for brackets."""
        self.hold_against_brackets()
        return summary(self)

    def trace_capacity(
        self, monitor: Monitor | None = None, points: int = 0
    ) -> tuple[CapacityPoint, ...]:
        """Compute the capacity curve, hundreds of factorisations, and keep it as `capacity`.

        Collective. It is none of `limit_load`; `write` does so where the scene asks for a curve.

        Args:
            monitor: Told of every point.
            points: Number of points; by default those of the scene's output options.
        """
        start, scene = time.perf_counter(), self.scene
        direction, end = next(iter(self.ends.items()), ("", None))
        points = points or scene.output.capacity or CURVE
        if end is None or end.status != "limit":
            return ()
        sign, kind = SIGNS[direction], strategy_of(scene).kind
        monitor, end = monitor or _Silent(), end if sign > 0.0 else end.reversed()
        with Discretization(scene) as made:
            case = LoadCase.of(made, made.bonded(kind), sign, kind, lambda step: None)
            if end.peak is not None and end.peak.status == "not_known":
                end = _with_peak(case, end, CURVE_SOLVE, asked=True)
                known = end if sign > 0.0 else end.reversed()
                self.ends[direction] = replace(self.ends[direction], peak=known.peak)
            with crushed_like(case, end) as crushed:
                curve = capacity_curve(crushed, end, points, monitor.point)
            self.factorizations += made.factorizations()
            self.mode_factorizations += made.mode_tally.count
        self.capacity = tuple(replace(p, load_factor=sign * p.load_factor) for p in curve)
        self.seconds["capacity"] = seconds = time.perf_counter() - start
        self.seconds["total"] += seconds
        return self.capacity

    def plot(self, axes: Any = None) -> Any:
        """Draw the collapse mode. Collective; returns the axes on rank 0, else None.

        Raises:
            SolverError: If there is no collapse to draw.
        """
        return self._plotted(draw_mode, axes)

    def plot_forces(self, axes: Any = None) -> Any:
        """Draw the joint forces at collapse; as `plot`."""
        return self._plotted(draw_forces, axes)

    def plot_capacity(self, axes: Any = None) -> Any:
        """Draw the capacity curve, traced if it was not yet; as `plot`."""
        self._drawn()
        curve = self.capacity or self.trace_capacity()
        if self.scene.comm.rank != 0:
            return None
        axes = axes or new_axes()
        end = self.collapse
        limit, peak = (math.nan, None) if end is None else (end.load_factor, end.peak)
        draw_capacity(axes, curve, limit, peak)
        return axes

    def _repr_png_(self) -> bytes | None:
        """Collapse mode and joint forces, for a notebook. Collective."""
        if not self._can_be_drawn:
            return None
        file, view = io.BytesIO(), self._view()
        if self.scene.comm.rank == 0:
            save_collapse(view, repr(self)[1:-1], [file])
        return file.getvalue()

    def _plotted(self, draw: Callable[[Any, View], Any], axes: Any) -> Any:
        """Axes with a picture of the collapse, on rank 0."""
        view = self._view()
        if self.scene.comm.rank != 0:
            return None
        return draw(axes or new_axes(), view)

    def _view(self) -> View:
        """What pictures show of the collapse. Collective."""
        return view_of(self.discretization, *self._drawn(), self._sign)

    @property
    def _sign(self) -> float:
        """Sign of the live load at the collapse that fields show."""
        return -1.0 if self.positive is None else 1.0

    @property
    def _can_be_drawn(self) -> bool:
        end = self.collapse
        return end is not None and end.mode is not None and end.status != "unbounded"

    def _drawn(self) -> tuple[Array, JointValues]:
        """Mode and joint values of the collapse that pictures show."""
        end = self.collapse
        if end is None or end.mode is None or end.joints is None or not self._can_be_drawn:
            raise SolverError(f"there is no collapse to draw: the status is '{self.status}'")
        return end.mode, end.joints

    def write(self, folder: str | Path) -> None:
        """Write result.json, and what the scene's output options say; the folder is made."""
        if self.scene.output.capacity and not self.capacity:
            self.trace_capacity()
        self.hold_against_brackets()
        write_result(self, Path(folder))


class Monitor(Protocol):
    """Is told how a run goes, on all ranks."""

    def step(self, direction: str, step: Step) -> None:
        """After a step in direction "positive" or "negative"."""
        return

    def point(self, done: int, total: int, point: CapacityPoint) -> None:
        """After a point of the capacity curve."""
        return


class _Silent(Monitor):
    """A monitor that says nothing."""


def limit_load(
    scene: Scene, monitor: Monitor | None = None, *, progress: bool = False
) -> LimitLoad:
    """Compute the limit load of a scene.

    Args:
        scene: What to solve.
        monitor: Told how the run goes.
        progress: Print how it goes, on rank 0, where there is no monitor.

    Returns:
        The result; look at its status.

    Raises:
        InputError: If joints, supports or loads of the scene do not fit its mesh.
    """
    start = time.perf_counter()
    if progress and monitor is None and scene.comm.rank == 0:
        monitor = Progress(scene.solve.tolerance)
    for item in skipped(scene):
        _log.info("skipped: %s", item)
    with Discretization(scene) as discretization:
        for text in discretization.warnings if scene.comm.rank == 0 else ():
            _log.warning("warning: %s", text)
        result = limit_load_of(discretization, monitor)
    if scene.solve.accuracy is not None and result.status == "limit":
        result = to_accuracy(result, partial(_on_another_mesh, monitor))
    result.seconds["total"] = time.perf_counter() - start
    return result


def _on_another_mesh(monitor: Monitor | None, scene: Scene) -> LimitLoad:
    with Discretization(scene) as discretization:
        return limit_load_of(discretization, monitor)


def limit_load_of(discretization: Discretization, monitor: Monitor | None = None) -> LimitLoad:
    """The limit load of a discretised scene; see `limit_load`."""
    scene, monitor = discretization.scene, monitor or _Silent()
    seconds = {"compile": discretization.compile_seconds, "assemble": discretization.seconds}
    start = time.perf_counter()
    blocks = RigidBlocks.of(discretization)
    stands_frictionless = blocks.frictionless.stands()
    fall = None if stands_frictionless else blocks.fall()
    seconds["bounds"] = time.perf_counter() - start
    if fall is not None:
        return _result(discretization, {}, seconds, fall)
    kind = strategy_of(scene).kind
    bonded = discretization.bonded(kind)
    seconds["bonded"] = bonded.seconds
    start = time.perf_counter()
    direction = scene.solve.direction
    asked = tuple(SIGNS) if direction == "both" else (direction,)
    cases = {
        name: LoadCase.of(discretization, bonded, SIGNS[name], kind, partial(monitor.step, name))
        for name in SIGNS
    }
    # Where no state under the dead load alone is known, the range of load factors must reach to
    # either side of zero, whichever end of it was asked for.
    enough = stands_frictionless or direction == "both" or _stands(cases[direction])
    effort = discretization.effort
    before = effort.spent
    directions = asked if enough else tuple(SIGNS)
    crushed: dict[str, CrushedJoints] = {}
    if blocks.crushing is None:
        found = {name: _collapse(cases[name]) for name in directions}
    else:
        both = {name: crushed_collapse(cases[name], _collapse) for name in directions}
        found = {name: end for name, (end, _) in both.items()}
        crushed = {name: joints for name, (_, joints) in both.items()}
        cases |= {name: joints.case for name, joints in crushed.items()}
    found = reaching_zero(cases, found, asked)
    found = {name: explained(cases[name], found[name]) for name in asked}
    seconds["solve"] = time.perf_counter() - start
    start, cost = time.perf_counter(), (effort.spent - before) / len(directions)
    wanted = bool(scene.solve.peak)
    for name in asked:
        found[name] = _with_peak(cases[name].unrecorded, found[name], cost, wanted)
    seconds["peak"] = time.perf_counter() - start
    if scene.solve.lowest is not False:
        start = time.perf_counter()
        found |= {name: _with_lowest(cases[name], found[name], cost) for name in asked}
        seconds["lowest"] = time.perf_counter() - start
    if scene.solve.error is not False:
        start = time.perf_counter()
        found |= {name: _with_mesh_error(cases[name].unrecorded, found[name]) for name in asked}
        seconds["error"] = time.perf_counter() - start
    for name, joints in crushed.items():
        found |= {name: joints.on_joints(found[name])} if name in asked else {}
        joints.close()
    if blocks.crushing is None:  # else forces at a corner are bound by the strength of their faces
        found = {name: with_least_forces(discretization, found[name]) for name in asked}
    ends = {name: found[name] if SIGNS[name] > 0.0 else found[name].reversed() for name in asked}
    return _result(discretization, ends, seconds)


def _stands(case: LoadCase) -> bool:
    """Whether a state under the dead load alone was found, and verified."""
    scene = case.discretization.scene
    return service_state(case, strategy_of(scene), scene.solve, 0.0, 1).status == "equilibrium"


def _collapse(case: LoadCase, near: Collapse | None = None) -> Collapse:
    """The collapse of one direction, as the scene's options ask for it.

    It is looked for next to a verified collapse first, if one is given.
    """
    scene = case.discretization.scene
    options = scene.solve
    if near is not None and near.status == "limit":
        found = collapse_next_to(case, near, Softened.nowhere(), start_near)
        if found.status == "limit":
            return replace(found, history=near.history + found.history)
    if options.control == "load":
        return raise_load(case, strategy_of(scene), options, find_collapse)
    if options.states == "lowest" and case.problem.coulomb:
        return find_lowest(case, options.tolerance)
    return find_collapse(case, strategy_of(scene), options.tolerance)


def _with_peak(case: LoadCase, end: Collapse, cost: float, asked: bool) -> Collapse:
    """A collapse with the peak of the path to it, within limits by the cost of the collapse."""
    if end.status != "limit" or end.state is None or not case.problem.coulomb:
        return end
    options = case.discretization.scene.solve
    above = Above(end.load_factor, end.size, end.state.work)
    if end.crushed_ends is not None:
        peak = Peak("not_known", reason="on the way joints crush in other places than at the end")
    elif end.path is not None:
        peak = Peak.of_path(end.path, above)
    elif options.peak is False and not asked:
        peak = Peak("not_known", reason=NOT_ASKED)
    else:
        limits = Limits.of(cost, asked)
        peak = find_peak(case, above, options.tolerance, limits)
    return replace(end, peak=peak)


def _with_lowest(case: LoadCase, end: Collapse, cost: float) -> Collapse:
    """A collapse with a second opinion on it, where several collapse states may exist."""
    options = case.discretization.scene.solve
    coulomb, mode = case.problem.coulomb, end.mode
    if end.crushed_ends is not None:
        reason = "in other states joints crush in other places"
        return replace(end, states=(), lowest=Lowest("not_known", reason=reason))
    if end.status != "limit" or mode is None or not coulomb or end.lowest is not None:
        return end
    if end.path is not None:
        reason = "lower states are not looked for where the load is raised step by step"
        return replace(end, lowest=Lowest("not_known", reason=reason))
    if case.problem.dot(case.problem.live, mode) < 0.0:  # the dead load does the work
        return _with_lowest(case.reversed(), end.reversed(), cost).reversed()
    return second_opinion(case, end, options.tolerance, cost)


def _with_mesh_error(case: LoadCase, end: Collapse) -> Collapse:
    """A collapse with the estimate of its discretisation error, if its load case led to it."""
    scene = case.discretization.scene
    if end.status != "limit" or end.mode is None:
        return end
    if end.path is not None and scene.solve.slip == "load-steps":
        _log.info("no error estimate: slip is measured from the step before")
        return end
    tolerance = scene.solve.tolerance
    if case.problem.dot(case.problem.live, end.mode) < 0.0:  # the dead load does the work
        found = with_mesh_error(case.reversed(), end.reversed(), tolerance).reversed()
        return replace(end, mesh_error=found.mesh_error, at_point_hinges=found.at_point_hinges)
    return with_mesh_error(case, end, tolerance)


def _result(
    discretization: Discretization,
    ends: dict[str, Collapse],
    seconds: dict[str, float],
    fall: Array | None = None,
) -> LimitLoad:
    spared = skipped_iterations([one for end in ends.values() for one in end.history])
    for item in spared:
        _log.info("skipped: %s", item)
    return LimitLoad(
        discretization,
        ends,
        (*skipped(discretization.scene), *spared),
        seconds,
        discretization.factorizations(),
        discretization.mode_tally.count,
        fall=fall,
    )
