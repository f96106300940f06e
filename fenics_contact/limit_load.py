"""The limit load of a scene: bounds, fixed point at growing work, verification."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from petsc4py import PETSc

from fenics_contact.analysis.rigid_blocks import LimitBounds, RigidBlocks
from fenics_contact.analysis.capacity import capacity_curve
from fenics_contact.analysis.result import CapacityPoint, Collapse, CollapseState, Result
from fenics_contact.analysis.result import LoadPath as LoadPathRecord
from fenics_contact.analysis.load_control import LoadPath, follow_load
from fenics_contact.analysis.coulomb import CoulombFriction, FixedPointStep
from fenics_contact.errors import SolverError
from fenics_contact.solvers.interior_point import WorkControl
from fenics_contact.solvers.kkt import Scales, State
from fenics_contact.analysis.plan import skipped, skipped_iterations
from fenics_contact.solvers.problem import ContactProblem
from fenics_contact.scene import Scene
from fenics_contact.analysis.work_control import (
    MONOLITHIC,
    Search,
    first_work,
    new_solver,
)
from fenics_contact.discretization.discretization import Bonded, Structure
from fenics_contact.output.fields import displacement_function
from fenics_contact.output.files import write_result

Array = npt.NDArray[np.float64]

_log = logging.getLogger("fenics_contact")

#: The continuation brackets the limit load to this relative width, or the tolerance if larger.
BRACKET_WIDTH = 1e-4


class LimitLoad(Result):
    """Result of `limit_load`, with its fields and files."""

    @property
    def structure(self) -> Structure:
        """Discretisation of the scene."""
        return self.discretization

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
        """Write result.json, and files and pictures as the scene's output options say."""
        self.hold_against_brackets()
        write_result(self, Path(folder))


class Monitor(Protocol):
    """Is told how a run goes, on all ranks."""

    def step(self, direction: str, step: FixedPointStep) -> None:
        """After a fixed-point iteration in direction "positive" or "negative"."""

    def point(self, done: int, total: int, point: CapacityPoint) -> None:
        """After a point of the capacity curve."""


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
    structure = Structure.build(scene)
    for item in skipped(scene):
        _log.info("skipped: %s", item)
    driver = _Driver(structure, monitor)
    result = driver.run()
    result.seconds["total"] = time.perf_counter() - start
    return result


class _Driver:
    """One run of `limit_load`."""

    def __init__(self, structure: Structure, monitor: Monitor | None) -> None:
        self.structure = structure
        self.scene = structure.scene
        self.monitor = monitor
        self.seconds = {"assemble": structure.seconds}

    def run(self) -> LimitLoad:
        structure, options = self.structure, self.scene.solve
        start = time.perf_counter()
        blocks = RigidBlocks(structure.joints, structure.bodies, self.scene.comm)
        stands_frictionless = blocks.stands(friction=False)
        stands = stands_frictionless or blocks.stands()
        self.seconds["bounds"] = time.perf_counter() - start
        if not stands:
            return self._result({})
        bonded = structure.bonded(coupled=bool(np.any(structure.joints.friction)) and options.method in MONOLITHIC)
        self.seconds["bonded"] = bonded.seconds
        start = time.perf_counter()
        scales = typical_sizes(structure.problem, bonded)
        asked = {"both": ("positive", "negative")}.get(options.direction, (options.direction,))
        # Where the dead load needs friction to stand, the range of load factors must reach to
        # either side of zero, whichever end of it was asked for.
        needed = asked if stands_frictionless else ("positive", "negative")
        found: dict[str, Collapse] = {}
        if "positive" in needed:
            found["positive"] = self._collapse(
                "positive", structure.problem, blocks, bonded, scales
            )
        if "negative" in needed:
            bodies = replace(structure.bodies, live=-structure.bodies.live)
            blocks = RigidBlocks(structure.joints, bodies, self.scene.comm)
            mirrored = self._collapse("negative", structure.reversed(), blocks, bonded, scales)
            found["negative"] = mirrored.reversed()
        self.seconds["solve"] = time.perf_counter() - start
        if _excludes_zero(found, options.tolerance * scales.load_factor):
            return self._result({})
        result = self._result({direction: found[direction] for direction in asked})
        if self.scene.output.capacity and result.status == "limit":
            start = time.perf_counter()
            reverse = asked[0] == "negative"
            capacity = self._capacity(found[asked[0]], reverse, bonded, scales)
            result.capacity = tuple(capacity)
            self.seconds["capacity"] = time.perf_counter() - start
            result.factorizations = self.structure.factorizations
        return result

    def _capacity(
        self, end: Collapse, reverse: bool, bonded: Bonded, scales: Scales
    ) -> list[CapacityPoint]:
        """Points of the capacity curve towards one collapse."""
        if end.path is not None:  # the continuation has gone along it already
            sign = -1.0 if reverse else 1.0
            return [
                CapacityPoint(step.displacement, sign * step.load_factor, step.work, converged=True)
                for step in end.path.steps
            ]
        if end.state is None:
            return []
        problem = self.structure.reversed() if reverse else self.structure.problem
        pressure = _first_pressure(problem, bonded)
        factor = -scales.load_factor if reverse else scales.load_factor
        work = scales.load_factor * self.structure.problem.live.dot(bonded.live)
        return capacity_curve(
            problem,
            self.structure.springs,
            scales,
            _scaled_state(bonded.live, pressure, factor, work),
            abs(end.state.work),
            self.scene.output.capacity,
            self.scene.solve.tolerance,
            None if self.monitor is None else self.monitor.point,
        )

    def _result(self, ends: dict[str, Collapse]) -> LimitLoad:
        spared = skipped_iterations([one for end in ends.values() for one in end.history])
        for item in spared:
            _log.info("skipped: %s", item)
        return LimitLoad(
            self.structure,
            ends,
            (*skipped(self.scene), *spared),
            self.seconds,
            self.structure.factorizations,
            self.structure.mode_factorizations,
        )

    def _collapse(
        self,
        direction: str,
        problem: ContactProblem,
        blocks: RigidBlocks,
        bonded: Bonded,
        scales: Scales,
    ) -> Collapse:
        """Follow one direction of the live load to its plateau."""
        exact = not np.any(self.structure.joints.friction)
        problem.slip_origin[:] = 0.0
        run = partial(self._search, direction, problem, blocks, bonded, scales)
        bound = problem.bound(_first_pressure(problem, bonded))
        if self.scene.solve.control == "load":
            return self._continued(direction, problem, blocks, bonded, scales, run)
        if exact or self.scene.solve.states == "first":
            return run(bound)
        return self._lowest(run(bound, at_once=False), run, problem, blocks)

    def _search(
        self,
        direction: str,
        problem: ContactProblem,
        blocks: RigidBlocks,
        bonded: Bonded,
        scales: Scales,
        bound: Array,
        method: str = "",
        path: LoadPath | None = None,
        at_once: bool = True,
    ) -> Collapse:
        """Search from a first bound on friction, and from the end of a path if there is one.

        With `at_once` the first bound matters only if the monolithic step fails.
        """
        per_ratio = scales.load_factor * self.structure.problem.live.dot(bonded.live)
        method = method or self.scene.solve.method
        monitor = self._steps(direction)
        search = Search(
            self.structure,
            problem,
            blocks,
            scales,
            per_ratio,
            method,
            monitor,
            at_once,
            past_folds=path is None,  # the state sought is the one at the end of that path
        )
        ratio = first_work(method, blocks.bounds, scales, len(self.structure.bodies.centre))
        if path is None or path.direction is None:
            sign = 1.0 if problem is self.structure.problem else -1.0
            factor, pressure = sign * ratio * scales.load_factor, bonded.dead_pressure
            start = _scaled_state(bonded.live, pressure, factor, ratio * per_ratio)
        else:
            ratio = max(ratio, 10.0 * path.state.work / per_ratio)
            displacement = path.state.displacement.copy()
            displacement.axpy(ratio * per_ratio - path.state.work, path.direction)
            start = replace(
                path.state, displacement=displacement, work=ratio * per_ratio, strained=None
            )
        try:
            return search.run(start, bound)
        finally:
            search.destroy()

    def _continued(
        self,
        direction: str,
        problem: ContactProblem,
        blocks: RigidBlocks,
        bonded: Bonded,
        scales: Scales,
        run: Callable[..., Collapse],
    ) -> Collapse:
        """Raise the load factor from zero; then search for the collapse from the last state."""
        options, monitor = self.scene.solve, self._steps(direction)
        control = WorkControl(problem, self.structure.springs)
        solver = new_solver(self.structure, problem, control, options.method)
        monolithic = options.method in MONOLITHIC

        def friction(sizes: Scales, load_factor: float) -> CoulombFriction:
            return CoulombFriction(
                solver, sizes, options.tolerance, monolithic, monitor, load_factor
            )

        pressure = _first_pressure(problem, bonded)
        work = problem.live.dot(bonded.dead)
        start = State(bonded.dead, 0.0, pressure, np.zeros_like(pressure), work)
        bounds = problem.comm.bcast(blocks.bounds())
        if bounds.lower == np.inf:
            return Collapse("unbounded", np.inf, blocks.bounds)
        upper = np.inf if bounds.upper is None else bounds.upper
        try:
            path = follow_load(
                problem,
                friction,
                start,
                scales,
                upper,
                max(options.tolerance, BRACKET_WIDTH),
                options.slip == "load-steps",
            )
        except SolverError as error:
            _log.warning("continuation: %s", error)
            return Collapse("not_converged", float("nan"), blocks.bounds)
        finally:
            control.destroy()
            solver.destroy()
        found = run(problem.bound(path.state.pressure), path=path)
        # States are as exact as the tolerance; so close to the limit their load factors are less.
        margin = 10.0 * options.tolerance * max(abs(path.lower), scales.load_factor)
        if not path.lower - margin <= found.load_factor <= path.upper + margin:
            _log.warning(
                "the collapse found at %.8g is not between the load factors %.8g and %.8g with and"
                " without equilibrium on the path: another state",
                found.load_factor,
                path.lower,
                path.upper,
            )
        return replace(found, path=LoadPathRecord(path.steps, path.lower, path.upper))

    def _lowest(
        self,
        first: Collapse,
        run: Callable[..., Collapse],
        problem: ContactProblem,
        blocks: RigidBlocks,
    ) -> Collapse:
        """The lowest verified collapse of those found from several first bounds on friction."""
        friction, points = problem.friction, self.structure.operators.points
        found = {"dead load": first}
        if first.state is not None:
            half = 0.5 * problem.bound(first.state.pressure)
            found["half of that"] = run(half, at_once=False)
        found["no friction"] = run(problem.strength, at_once=False)
        associative = blocks.associative_pressure()
        if associative is not None:
            bound = friction * associative[points] + problem.strength
            found["associative program"] = run(bound, at_once=False)
        found["monolithic"] = run(problem.bound(np.ones_like(friction)), method="monolithic")
        states = tuple(
            CollapseState(name, end.status, end.load_factor) for name, end in found.items()
        )
        limits = [end for end in found.values() if end.status == "limit"]
        lowest = min(limits, key=lambda end: end.load_factor, default=first)
        return replace(lowest, states=states)

    def _steps(self, direction: str) -> Callable[[FixedPointStep], None] | None:
        """The monitor as a function of the step."""
        monitor = self.monitor
        if monitor is None:
            return None
        return partial(monitor.step, direction)


def typical_sizes(problem: ContactProblem, bonded: Bonded) -> Scales:
    """Force, displacement and load factor typical of a structure.

    The load factor makes the live load's elastic energy in the bonded structure that of the dead
    load; where there is no dead load, its joint forces equal to the given strengths.
    """
    live_work = problem.live.dot(bonded.live)
    dead_work = problem.dead.dot(bonded.dead)
    live_force = problem.max(bonded.live_pressure)
    if dead_work > 0.0:
        factor = float(np.sqrt(dead_work / live_work))
        force = problem.max(bonded.dead_pressure) or factor * live_force
    else:
        force = problem.max(problem.strength) or live_force
        factor = force / live_force if live_force else 1.0
    displacement = factor * live_work / problem.live.norm(PETSc.NormType.N1)
    return Scales(displacement, force or 1.0, factor)


def _excludes_zero(found: Mapping[str, Collapse], margin: float) -> bool:
    """Whether the load factors found leave out zero, the dead load alone."""
    for direction, sign in (("positive", 1.0), ("negative", -1.0)):
        end = found.get(direction)
        if end is not None and end.status == "limit" and sign * end.load_factor < -margin:
            return True
    return False


def _scaled_state(response: PETSc.Vec, pressure: Array, factor: float, work: float) -> State:
    """A multiple of a bonded response, without shear."""
    displacement = response.copy()
    displacement.scale(factor)
    return State(displacement, 0.0, pressure, np.zeros_like(pressure), work)


def _first_pressure(problem: ContactProblem, bonded: Bonded) -> Array:
    """Normal forces for the first bound on friction: those of the dead load if there is one."""
    if problem.max(bonded.dead_pressure) > 0.0:
        return bonded.dead_pressure
    return bonded.live_pressure
