"""The limit load of a scene: bounds, fixed point at growing work, verification."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.bounds import LimitBounds, RigidBlocks
from fenics_contact.capacity import CapacityPoint, capacity_curve
from fenics_contact.certificate import Certificate, certify, joint_displacements
from fenics_contact.coulomb import CoulombFriction, FixedPointHistory, FixedPointStep
from fenics_contact.errors import SolverError
from fenics_contact.interior_point import PathPoint, Scales, State, WorkControl
from fenics_contact.plan import Plan
from fenics_contact.problem import ContactProblem
from fenics_contact.scene import Scene
from fenics_contact.structure import Bonded, Structure

Array = npt.NDArray[np.float64]

_log = logging.getLogger("fenics_contact")

#: First work of the live load in units of its work on the bonded structure, and largest.
FIRST_WORK, LAST_WORK = 300.0, 1e12

#: Growth of the work, and by how much more at once where the load factor rises slowly.
WORK_GROWTH, LARGEST_STRIDE = 4.0, 1e3

#: Where more work does not help, because digits are lost, less is tried: factor, and how often.
WORK_DECREASE, DECREASES = 0.1, 3

#: The gap between load factor and rigid-block program must fall by this factor to go on.
GAP_FALLS = 0.7

#: A load factor that grows at least like this power of the work, this often, is not limited.
GROWING, GROWN = 0.9, 2


@dataclass(frozen=True)
class Collapse:
    """One end of the range of load factors.

    Attributes:
        status: "limit", "unbounded" or "not_converged".
        load_factor: Signed; nan if no state was found.
        bounds: From the rigid-block programs, for this direction.
        state: The state reached, None if there is none.
        mode: Collapse mode v in the supports' coordinates, f_L.v = 1.
        certificate: Verification of the state.
        history: Of the fixed point, over all T.
        work_ratio: T in units of the live load's work on the bonded structure.
    """

    status: str
    load_factor: float
    bounds: LimitBounds
    state: State | None = None
    mode: PETSc.Vec | None = None
    certificate: Certificate | None = None
    history: tuple[FixedPointHistory, ...] = ()
    work_ratio: float = 0.0


@dataclass
class LimitLoad:
    """Result of `limit_load`.

    Attributes:
        scene: What was solved.
        structure: Its discretisation.
        status: "limit", "unbounded", "unstable" or "not_converged".
        positive: Collapse with the live load as given; None if not asked for.
        negative: Collapse with the live load reversed; None if not asked for.
        plan: What the scene did not need.
        seconds: Time by phase, s.
        factorizations: Numeric factorisations in all.
        capacity: Points of the capacity curve.
    """

    scene: Scene
    structure: Structure
    status: str
    positive: Collapse | None
    negative: Collapse | None
    plan: Plan
    seconds: dict[str, float]
    factorizations: int
    capacity: list[CapacityPoint] = field(default_factory=list)

    @property
    def collapse(self) -> Collapse | None:
        """The collapse that pictures and fields show: the positive one if there is one."""
        return self.positive if self.positive is not None else self.negative

    @property
    def load_factor(self) -> float:
        """Limit load factor; infinite if unbounded, nan if there is none."""
        return float("nan") if self.positive is None else self.positive.load_factor

    @property
    def load_factor_negative(self) -> float:
        """Limit load factor with the live load reversed, not above 0; nan if not asked for."""
        return float("nan") if self.negative is None else self.negative.load_factor

    @property
    def bounds(self) -> LimitBounds | None:
        """Bracket of the rigid-block programs for the collapse shown, in the sign of its factor."""
        return None if self.collapse is None else self.collapse.bounds

    @property
    def mode(self):  # type: ignore[no-untyped-def]
        """Displacement field of the collapse, a dolfinx function; None without a limit."""
        from fenics_contact.fields import displacement_function

        if self.collapse is None or self.collapse.mode is None:
            return None
        return displacement_function(self.structure, self.collapse.mode, "collapse_mode")

    @property
    def displacement(self):  # type: ignore[no-untyped-def]
        """Displacements at the state reached, m, a dolfinx function; None if there is none."""
        from fenics_contact.fields import displacement_function

        if self.collapse is None or self.collapse.state is None:
            return None
        state = self.collapse.state
        return displacement_function(self.structure, state.displacement, "displacement")

    def write(self, folder: str | Path) -> None:
        """Write result.json, and files and pictures as the scene's output options say."""
        from fenics_contact.output import write_result

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
    plan = scene.plan()
    for item in plan.skipped:
        _log.info("skipped: %s", item)
    driver = _Driver(structure, plan, monitor)
    result = driver.run()
    result.seconds["total"] = time.perf_counter() - start
    return result


class _Driver:
    """One run of `limit_load`."""

    def __init__(self, structure: Structure, plan: Plan, monitor: Monitor | None) -> None:
        self.structure = structure
        self.scene = structure.scene
        self.plan = plan
        self.monitor = monitor
        self.seconds = {"assemble": structure.seconds}

    def run(self) -> LimitLoad:
        structure, options = self.structure, self.scene.solve
        start = time.perf_counter()
        blocks = RigidBlocks(structure.joints, structure.bodies, self.scene.comm)
        bounds = blocks.bounds()
        self.seconds["bounds"] = time.perf_counter() - start
        if not bounds.stands:
            return self._result("unstable", None, None)
        bonded = structure.bonded()
        self.seconds["bonded"] = bonded.seconds
        start = time.perf_counter()
        scales = typical_sizes(structure.problem, bonded)
        asked = {"both": ("positive", "negative")}.get(options.direction, (options.direction,))
        # Where the dead load needs friction to stand, the range of load factors must reach to
        # either side of zero, whichever end of it was asked for.
        needed = asked if bounds.stands_frictionless else ("positive", "negative")
        found: dict[str, Collapse] = {}
        if "positive" in needed:
            found["positive"] = self._collapse(
                "positive", structure.problem, blocks, bounds, bonded, scales
            )
        if "negative" in needed:
            bodies = replace(structure.bodies, live=-structure.bodies.live)
            blocks = RigidBlocks(structure.joints, bodies, self.scene.comm)
            mirrored = self._collapse(
                "negative", structure.reversed(), blocks, blocks.bounds(), bonded, scales
            )
            found["negative"] = replace(
                mirrored,
                load_factor=-mirrored.load_factor,
                bounds=mirrored.bounds.reversed(),
            )
        self.seconds["solve"] = time.perf_counter() - start
        if _excludes_zero(found, options.tolerance * scales.load_factor):
            return self._result("unstable", None, None)
        ends = [found[direction] for direction in asked]
        status = ends[0].status if len({end.status for end in ends}) == 1 else "limit"
        if any(end.status == "not_converged" for end in ends):
            status = "not_converged"
        reported = {direction: found[direction] for direction in asked}
        result = self._result(status, reported.get("positive"), reported.get("negative"))
        if self.scene.output.capacity and status == "limit":
            start = time.perf_counter()
            reverse = asked[0] == "negative"
            result.capacity = self._capacity(ends[0], reverse, bonded, scales)
            self.seconds["capacity"] = time.perf_counter() - start
            result.factorizations = self.structure.springs.factorizations
        return result

    def _capacity(
        self, end: Collapse, reverse: bool, bonded: Bonded, scales: Scales
    ) -> list[CapacityPoint]:
        """Points of the capacity curve towards one collapse."""
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
            end.state.work,
            self.scene.output.capacity,
            self.scene.solve.tolerance,
            None if self.monitor is None else self.monitor.point,
        )

    def _result(
        self, status: str, positive: Collapse | None, negative: Collapse | None
    ) -> LimitLoad:
        return LimitLoad(
            self.scene,
            self.structure,
            status,
            positive,
            negative,
            self.plan,
            self.seconds,
            self.structure.springs.factorizations,
        )

    def _collapse(
        self,
        direction: str,
        problem: ContactProblem,
        blocks: RigidBlocks,
        bounds: LimitBounds,
        bonded: Bonded,
        scales: Scales,
    ) -> Collapse:
        """Follow one direction of the live load to its plateau."""
        # Without Coulomb friction the upper bound is exact; the lower one is a bound in any case.
        exact = not np.any(self.structure.joints.friction)
        if bounds.lower == np.inf or (exact and bounds.upper == np.inf):
            return Collapse("unbounded", np.inf, bounds)
        per_ratio = scales.load_factor * self.structure.problem.live.dot(bonded.live)
        search = _Search(
            self.structure, problem, blocks, bounds, scales, per_ratio, self._steps(direction)
        )
        sign = 1.0 if problem is self.structure.problem else -1.0
        start = _scaled_state(
            bonded.live,
            bonded.dead_pressure,
            sign * FIRST_WORK * scales.load_factor,
            FIRST_WORK * per_ratio,
        )
        try:
            return search.run(start, problem.bound(_first_pressure(problem, bonded)))
        finally:
            search.control.destroy()

    def _steps(self, direction: str) -> Callable[[FixedPointStep], None] | None:
        """The monitor as a function of the step."""
        monitor = self.monitor
        if monitor is None:
            return None
        return partial(monitor.step, direction)


@dataclass(frozen=True)
class _Found:
    """A state at one T, its mode and its verification."""

    ratio: float
    point: PathPoint
    mode: PETSc.Vec
    certificate: Certificate
    history: FixedPointHistory
    bound: Array

    @property
    def state(self) -> State:
        return self.point.state

    @property
    def gap(self) -> float:
        """Gap of the certificate; infinite where the fixed point did not converge."""
        gap = self.certificate.gap if self.history.converged else np.inf
        return gap if np.isfinite(gap) else np.inf

    @property
    def verified(self) -> bool:
        return self.history.converged and self.certificate.passed

    def rises_from(self, last: _Found) -> bool:
        """Whether its load factor is larger than that of another state."""
        return self.state.load_factor > last.state.load_factor


class _Search:
    """States of one direction at different T, and the best of them."""

    def __init__(
        self,
        structure: Structure,
        problem: ContactProblem,
        blocks: RigidBlocks,
        bounds: LimitBounds,
        scales: Scales,
        per_ratio: float,
        monitor: Callable[[FixedPointStep], None] | None,
    ) -> None:
        """Prepare to solve.

        Args:
            structure: What is loaded.
            problem: With the live load in the direction looked at.
            blocks: Rigid-block programs of that direction.
            bounds: Their bounds.
            scales: Typical sizes on the elastic part of the path.
            per_ratio: Work of the live load on the bonded structure, the unit of T.
            monitor: Called after every fixed-point iteration.
        """
        self.structure = structure
        self.problem = problem
        self.blocks = blocks
        self.bounds = bounds
        self.scales = scales
        self.per_ratio = per_ratio
        self.live_size = problem.live.norm(PETSc.NormType.N1)
        self.options = structure.scene.solve
        self.monitor = monitor
        self.control = WorkControl(problem, structure.springs)
        self.best: _Found | None = None
        self.history: list[FixedPointHistory] = []
        self.path: list[tuple[float, float]] = []

    def run(self, start: State, bound: Array) -> Collapse:
        """Look for a verified collapse state at more work, then at less."""
        first = self.at(FIRST_WORK, start, bound)
        if first is None:
            return self.result("not_converged")
        last, ratio = first, FIRST_WORK
        while not self.settled and ratio < LAST_WORK:
            ratio = min(ratio * self._stride(last), LAST_WORK)
            found = self.at(ratio, self._moved(last, ratio * self.per_ratio), last.bound)
            if self.growing and self.bounds.upper == np.inf:
                return self.result("unbounded")
            # Soft structures rise slowly. Gaps are infinite, and no reason to stop, until a state
            # converges.
            if found is None or not (
                found.gap <= GAP_FALLS * last.gap or (found.rises_from(last) and not self.verified)
            ):
                break
            last = found
        last, ratio = first, FIRST_WORK
        for _ in range(DECREASES if self.best is first else 0):
            if self.settled:
                break
            ratio *= WORK_DECREASE
            found = self.at(ratio, self._moved(last, ratio * self.per_ratio), last.bound)
            if found is None or found.gap > GAP_FALLS * last.gap:
                break
            last = found
        return self.result("limit" if self.verified else "not_converged")

    def at(self, ratio: float, start: State, bound: Array) -> _Found | None:
        """Find and verify the state at one T; None if there is none.

        Once there is a verified state, others are only followed from it, not iterated for afresh.
        """
        work = ratio * self.per_ratio
        # Forces are judged by what the joints carry, which a locked structure lets grow.
        growth = max(1.0, self.largest_factor / self.scales.load_factor)
        scales = replace(
            self.scales, displacement=work / self.live_size, force=growth * self.scales.force
        )
        friction = CoulombFriction(
            self.control,
            scales,
            self.options.tolerance,
            self.options.method != "fixed-point",
            self.monitor,
        )
        try:
            if self.verified:
                point, history = friction.go_on(start, work, self._growth(work))
            else:
                point, history = friction.solve(
                    start, bound, work, bool(self.history), self._growth(work)
                )
        except SolverError as error:
            _log.info("no state with T = %.3g: %s", work, error)
            return None
        mode, certificate = self._verify(point, scales)
        new_bound = self.problem.bound(point.state.pressure)
        found = _Found(ratio, point, mode, certificate, history, new_bound)
        self.history.append(history)
        self.path.append((work, point.state.load_factor))
        _log.info(
            "  T = %.3g: load factor %.8g, gap %.1e",
            work,
            point.state.load_factor,
            certificate.gap,
        )
        if self.best is None or found.gap < self.best.gap or not self.best.history.converged:
            self.best = found
        return found

    def _verify(self, point: PathPoint, scales: Scales) -> tuple[PETSc.Vec, Certificate]:
        """The collapse mode of a state and its certificate.

        The mode is that of the elastic structure if it passes; else, with slow elastic motions
        mixed in, or singular in its sliding joints, that of rigid blocks with the same friction.
        """
        strength = self.structure.all_points(self.problem.bound(point.state.pressure))
        try:
            limit, motion = self.blocks.collapse(strength)
        except SolverError as error:
            _log.info("  no rigid mode: %s", error)
            limit, motion = None, None
        rigid_limit = np.nan if limit is None else limit

        def certified(mode: PETSc.Vec) -> Certificate:
            return certify(self.problem, point.state, mode, scales, self.bounds, rigid_limit)

        mode: PETSc.Vec | None = None
        try:
            mode, _ = self.control.rate(point.state, point.bound, scales)
            certificate = certified(mode)
            if certificate.mode_passed or motion is None:
                return mode, certificate
        except SolverError as error:
            _log.info("  no elastic mode: %s", error)
        if mode is not None:
            mode.destroy()
        if motion is None:
            motion = np.zeros((len(self.structure.bodies.centre), 3))  # certifies nothing
        mode = self.structure.rigid_motion(motion)
        return mode, certified(mode)

    @property
    def verified(self) -> bool:
        """Whether the best state is a collapse state."""
        return self.best is not None and self.best.verified

    @property
    def settled(self) -> bool:
        """Whether it is one to the tolerance asked for."""
        return (
            self.best is not None and self.best.verified and self.best.gap <= self.options.tolerance
        )

    @property
    def largest_factor(self) -> float:
        """Largest load factor so far."""
        return max((abs(factor) for _, factor in self.path), default=0.0)

    def _stride(self, last: _Found) -> float:
        """Factor to the next work, well beyond where the secant meets the program's load factor."""
        growth = self._growth(2.0 * last.state.work)
        missing = last.certificate.error_estimate
        if growth > 0.0 and np.isfinite(missing):
            return WORK_GROWTH * min(1.0 + missing / growth, LARGEST_STRIDE)
        return WORK_GROWTH

    def _growth(self, work: float) -> float:
        """How much further the load factor would rise along the secant of the last two states."""
        if len(self.path) < 2 or not self.path[-2][0] < self.path[-1][0] < work:
            return 0.0
        (first, low), (last, high) = self.path[-2:]
        return max((high - low) / (last - first) * (work - last), 0.0)

    @property
    def growing(self) -> bool:
        """Whether the load factor grew like the work so often that it is called unlimited."""
        if len(self.path) <= GROWN or min(factor for _, factor in self.path) <= 0.0:
            return False
        work, factor = np.log(self.path[-GROWN - 1 :]).T
        return bool(np.all(np.diff(factor) >= GROWING * np.diff(work)))

    def _moved(self, found: _Found, work: float) -> State:
        """A state moved along its mode to another T."""
        displacement = found.state.displacement.copy()
        displacement.axpy(work - found.state.work, found.mode)
        strained = self.problem.strained(found.mode)
        strained.aypx(work - found.state.work, found.state.strained)
        return replace(found.state, displacement=displacement, work=work, strained=strained)

    def _onset(self, found: _Found) -> State:
        """A state moved back along its mode to where the collapse began.

        Every state further along the mode has the same stresses and joint forces; at the first,
        some joint is about to close, or to stick.
        """
        opening, slip = joint_displacements(self.problem, found.state.displacement)
        opening_rate, slip_rate = joint_displacements(self.problem, found.mode)
        # The work by which a joint that moves in the mode has moved so far.
        rates = np.maximum(np.abs(opening_rate), np.abs(slip_rate))
        tiny = 1e-6 * self.problem.max(rates)
        opens, slips = opening_rate > tiny, np.abs(slip_rate) > tiny
        slips &= found.state.pressure > 0.0
        moved = [opening[opens] / opening_rate[opens], slip[slips] / slip_rate[slips]]
        least = min(float(np.min(m, initial=np.inf)) for m in moved)
        least = self.problem.comm.allreduce(least, MPI.MIN)
        if not 0.0 < least < np.inf:
            return found.state
        return self._moved(found, found.state.work - least)

    def result(self, status: str) -> Collapse:
        """Report the best state."""
        found, history = self.best, tuple(self.history)
        if found is None:
            return Collapse(status, float("nan"), self.bounds, history=history)
        if status == "not_converged":
            _log.warning("not verified: %s", found.certificate.failures or "not converged")
        return Collapse(
            status,
            np.inf if status == "unbounded" else found.state.load_factor,
            self.bounds,
            self._onset(found) if status == "limit" else found.state,
            found.mode,
            found.certificate,
            history,
            found.ratio,
        )


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
