"""The limit load of a scene: the one function that most users call."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol

from dolfinx import fem

from fenics_contact.analysis.dead_load import reaching_zero
from fenics_contact.analysis.hinges import estimate_mesh_error
from fenics_contact.analysis.history import CapacityPoint, Step
from fenics_contact.analysis.load_case import SIGNS, LoadCase
from fenics_contact.analysis.load_control import capacity_curve, raise_load
from fenics_contact.analysis.plan import skipped, skipped_iterations
from fenics_contact.analysis.result import Collapse, Result
from fenics_contact.analysis.rigid_blocks import RigidBlocks
from fenics_contact.analysis.strategy import strategy_of
from fenics_contact.analysis.work_control import find_collapse, find_lowest
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.mesh import Array
from fenics_contact.output.fields import displacement_function
from fenics_contact.output.files import write_result
from fenics_contact.scene import Scene

_log = logging.getLogger("fenics_contact")


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
        values = self.collapse.state.displacement
        return displacement_function(self.discretization, values, "displacement")

    def hold_against_brackets(self) -> None:
        """Solve the rigid-block programs for the brackets, and see that load factors are inside.

        `write` does so. Not done by `limit_load`: the programs may take longer than the limit load
        of a large wall, and the forces of a verified state imply what they say.
        """
        start = time.perf_counter()
        self.ends = {name: end.held_against_bracket() for name, end in self.ends.items()}
        self.seconds["bounds"] += time.perf_counter() - start

    def write(self, folder: str | Path) -> None:
        """Write result.json, and what the scene's output options say; the folder is made."""
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


def limit_load(scene: Scene, monitor: Monitor | None = None) -> LimitLoad:
    """Compute the limit load of a scene.

    Args:
        scene: What to solve.
        monitor: Told how the run goes.

    Returns:
        The result; look at its status.

    Raises:
        InputError: If joints, supports or loads of the scene do not fit its mesh.
    """
    start = time.perf_counter()
    for item in skipped(scene):
        _log.info("skipped: %s", item)
    with Discretization(scene) as discretization:
        for text in discretization.warnings if scene.comm.rank == 0 else ():
            _log.warning("warning: %s", text)
        result = _solved(discretization, monitor or _Silent())
    result.seconds["total"] = time.perf_counter() - start
    return result


def _solved(discretization: Discretization, monitor: Monitor) -> LimitLoad:
    """The limit load of a discretised scene."""
    scene = discretization.scene
    seconds = {"compile": discretization.compile_seconds, "assemble": discretization.seconds}
    start = time.perf_counter()
    blocks = RigidBlocks(discretization.joints, discretization.bodies, scene.comm)
    stands_frictionless = blocks.stands(friction=False)
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
    # Where the dead load needs friction to stand, the range of load factors must reach to either
    # side of zero, whichever end of it was asked for.
    cases = {
        name: LoadCase.of(discretization, bonded, SIGNS[name], kind, partial(monitor.step, name))
        for name in (asked if stands_frictionless else SIGNS)
    }
    found = {name: _collapse(case) for name, case in cases.items()}
    found = reaching_zero(cases, found, asked)
    seconds["solve"] = time.perf_counter() - start
    if scene.solve.error:
        start = time.perf_counter()
        found |= {name: _with_mesh_error(cases[name], found[name]) for name in asked}
        seconds["error"] = time.perf_counter() - start
    ends = {name: found[name] if SIGNS[name] > 0.0 else found[name].reversed() for name in asked}
    result = _result(discretization, ends, seconds)
    if scene.output.capacity and result.status == "limit":
        start, first = time.perf_counter(), asked[0]
        count = scene.output.capacity
        curve = capacity_curve(cases[first], found[first], count, monitor.point)
        result.capacity = tuple(replace(p, load_factor=SIGNS[first] * p.load_factor) for p in curve)
        seconds["capacity"] = time.perf_counter() - start
        result.factorizations = discretization.factorizations()
    return result


def _collapse(case: LoadCase) -> Collapse:
    """The collapse of one direction, as the scene's options ask for it."""
    scene = case.discretization.scene
    options = scene.solve
    if options.control == "load":
        return raise_load(case, strategy_of(scene), options, find_collapse)
    if options.states == "lowest" and case.problem.coulomb:
        return find_lowest(case, options.tolerance)
    return find_collapse(case, strategy_of(scene), options.tolerance)


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
        found = _with_error(case.reversed(), end.reversed(), tolerance).reversed()
        return replace(end, mesh_error=found.mesh_error)
    return _with_error(case, end, tolerance)


def _with_error(case: LoadCase, end: Collapse, tolerance: float) -> Collapse:
    return replace(end, mesh_error=estimate_mesh_error(case, end, tolerance))


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
