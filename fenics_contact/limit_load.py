"""The limit load of a scene: the one function that most users call."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol

from dolfinx import fem

from fenics_contact.analysis.history import CapacityPoint, Step
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.load_control import capacity_curve, raise_load
from fenics_contact.analysis.plan import skipped, skipped_iterations
from fenics_contact.analysis.result import Collapse, Result
from fenics_contact.analysis.rigid_blocks import RigidBlocks
from fenics_contact.analysis.strategy import strategy_of
from fenics_contact.analysis.work_control import find_collapse, find_lowest
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.output.fields import displacement_function
from fenics_contact.output.files import write_result
from fenics_contact.scene import Scene

_log = logging.getLogger("fenics_contact")

#: Sign of the live load by direction.
SIGNS = {"positive": 1.0, "negative": -1.0}


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
        """Write result.json, and files and pictures as the scene's output options say.

        Args:
            folder: Where to; made if need be.
        """
        self.hold_against_brackets()
        write_result(self, Path(folder))


class Monitor(Protocol):
    """Is told how a run goes, on all ranks."""

    def step(self, direction: str, step: Step) -> None:
        """After a step in direction "positive" or "negative"."""

    def point(self, done: int, total: int, point: CapacityPoint) -> None:
        """After a point of the capacity curve."""


class _Silent:
    """A monitor that says nothing."""

    def step(self, direction: str, step: Step) -> None:
        """Nothing."""

    def point(self, done: int, total: int, point: CapacityPoint) -> None:
        """Nothing."""


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
        result = _solved(discretization, monitor or _Silent())
    result.seconds["total"] = time.perf_counter() - start
    return result


def _solved(discretization: Discretization, monitor: Monitor) -> LimitLoad:
    """The limit load of a discretised scene."""
    scene, seconds = discretization.scene, {"assemble": discretization.seconds}
    start = time.perf_counter()
    blocks = RigidBlocks(discretization.joints, discretization.bodies, scene.comm)
    stands_frictionless = blocks.stands(friction=False)
    stands = stands_frictionless or blocks.stands()
    seconds["bounds"] = time.perf_counter() - start
    if not stands:
        return _result(discretization, {}, seconds)
    kind = strategy_of(scene).kind
    bonded = discretization.bonded(kind)
    seconds["bonded"] = bonded.seconds
    start = time.perf_counter()
    direction = scene.solve.direction
    asked = tuple(SIGNS) if direction == "both" else (direction,)
    # Where the dead load needs friction to stand, the range of load factors must reach to either
    # side of zero, whichever end of it was asked for.
    needed = asked if stands_frictionless else tuple(SIGNS)
    cases = {
        name: LoadCase.of(discretization, bonded, SIGNS[name], kind, partial(monitor.step, name))
        for name in needed
    }
    found = {name: _collapse(case) for name, case in cases.items()}
    seconds["solve"] = time.perf_counter() - start
    ends = {name: end if SIGNS[name] > 0.0 else end.reversed() for name, end in found.items()}
    margin = scene.solve.tolerance * next(iter(cases.values())).scales.load_factor
    if _excludes_zero(ends, margin):
        return _result(discretization, {}, seconds)
    result = _result(discretization, {name: ends[name] for name in asked}, seconds)
    if scene.output.capacity and result.status == "limit":
        start = time.perf_counter()
        points = capacity_curve(
            cases[asked[0]], found[asked[0]], scene.output.capacity, monitor.point
        )
        result.capacity = tuple(
            replace(point, load_factor=SIGNS[asked[0]] * point.load_factor) for point in points
        )
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


def _excludes_zero(ends: Mapping[str, Collapse], margin: float) -> bool:
    """Whether the load factors found leave out zero, the dead load alone."""
    return any(
        end.status == "limit" and SIGNS[name] * end.load_factor < -margin
        for name, end in ends.items()
    )


def _result(
    discretization: Discretization, ends: dict[str, Collapse], seconds: dict[str, float]
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
    )
