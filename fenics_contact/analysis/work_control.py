"""The search for a collapse in one direction of the live load: states at growing work, verified."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.analysis.rigid_blocks import LimitBounds, RigidBlocks
from fenics_contact.analysis.certificate import (
    Certificate,
    certify,
    kinematic_factor,
)
from fenics_contact.analysis.coulomb import CoulombFriction, FixedPointHistory, FixedPointStep
from fenics_contact.analysis.joint_values import joint_values
from fenics_contact.analysis.result import Collapse, CollapseState
from fenics_contact.errors import SolverError
from fenics_contact.solvers.interior_point import (
    COARSE,
    FEW_BLOCKS,
    ZERO_FACTOR,
    PathPoint,
    WorkControl,
)
from fenics_contact.solvers.kkt import Scales, State
from fenics_contact.solvers.problem import ContactProblem
from fenics_contact.solvers.problem import State as ReportedState
from fenics_contact.solvers.splitting import JointForces
from fenics_contact.discretization.discretization import Structure

Array = npt.NDArray[np.float64]

_log = logging.getLogger("fenics_contact")

#: Methods that take Coulomb friction into the equations.
MONOLITHIC = ("auto", "monolithic")

#: First work of the live load in units of its work on the bonded structure, and largest.
FIRST_WORK, LAST_WORK = 300.0, 1e12

#: The load factor of structures of more than a few blocks still rises there: their first work is
#: the first of these times the cube of their number, at most the second times its square.
WORK_OF_MANY = 5e-4, 2.0

#: Elastic modes that penetrate by more than this part of their size are one of many, of which
#: others do no better.
NOT_UNIQUE = 0.1

#: Growth of the work, and by how much more at once where the load factor rises slowly.
WORK_GROWTH, LARGEST_STRIDE = 10.0, 1e3

#: The same for methods on joint forces, in units of the work at the upper bound.
FIRST_JOINT_WORK = 30.0

#: Where there is no state so far ahead the stride is halved, as a power, down to this; it is
#: doubled again when it did twice in a row.
SHORTEST_STRIDE = 0.125

#: A state is taken for that of the collapse at a gap of this part of the tolerance: the gap is
#: that of its own friction bound, and as this follows the load factor still changes by 10 to 40
#: times as much.
COLLAPSED = 2.5e-2

#: Below a gap of this part of the tolerance, which rounding may cause, more work is tried only
#: once, and at no great cost.
NEARLY = 0.1

#: Strides that may be taken along a state without a smaller gap.
STRIDES_ALONG = 3

#: Where more work does not help, because digits are lost, less is tried: factor, and how often.
WORK_DECREASE, DECREASES = 0.1, 3

#: The gap between load factor and rigid-block program must fall by this factor to go on.
GAP_FALLS = 0.7

#: At a gap of this part of the tolerance more work is not asked what the load factor changes by.
CLOSED = 1e-4

#: A load factor that grows at least like this power of the work, this often, is not limited.
GROWING, GROWN = 0.9, 2


@dataclass(frozen=True)
class _Found:
    """A state at one T, its mode and its verification."""

    ratio: float
    point: PathPoint
    mode: PETSc.Vec
    certificate: Certificate
    history: FixedPointHistory
    bound: Array
    slope: float = 0.0  # d lambda/dT
    rest: float = 0.0  # what lambda is still to change by, relative

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


class Search:
    """States of one direction at different T, and the best of them."""

    def __init__(
        self,
        structure: Structure,
        problem: ContactProblem,
        blocks: RigidBlocks,
        scales: Scales,
        per_ratio: float,
        method: str,
        monitor: Callable[[FixedPointStep], None] | None,
        at_once: bool = True,
        past_folds: bool = True,
    ) -> None:
        """Prepare to solve.

        Args:
            structure: What is loaded.
            problem: With the live load in the direction looked at.
            blocks: Rigid-block programs of that direction.
            scales: Typical sizes on the elastic part of the path.
            per_ratio: Work of the live load on the bonded structure, the unit of T.
            method: As in the scene's options.
            monitor: Called after every fixed-point iteration.
            at_once: Whether to try the monolithic step before the fixed point.
            past_folds: Whether to follow its path past folds, to a state that may be far from the
                first one.
        """
        self.structure = structure
        self.problem = problem
        self.blocks = blocks
        self.scales = scales
        self.per_ratio = per_ratio
        self.live_size = problem.live.norm(PETSc.NormType.N1)
        self.options = structure.scene.solve
        self.monitor = monitor
        self.control = WorkControl(problem, structure.springs, lambda: structure.block_modes)
        self.method = method
        self.monolithic = method in MONOLITHIC
        self.patience = STRIDES_ALONG if self.monolithic else 0
        self.gap_asked = self.options.tolerance * (COLLAPSED if self.monolithic else 1.0)
        self.at_once = at_once and self.monolithic
        self.past_folds = past_folds
        self.part, self.kept = 1.0, True  # of a stride, as a power; whether the last one was
        self.solver = new_solver(structure, problem, self.control, method)
        self.best: _Found | None = None
        self.history: list[FixedPointHistory] = []
        self.path: list[tuple[float, float]] = []
        self.slope = 0.0

    def run(self, start: State, bound: Array) -> Collapse:
        """Look for a verified collapse state at more work, then at less."""
        self.start = start  # where a path that is followed afresh begins
        first_ratio, first = start.work / self.per_ratio, None
        if self.at_once and len(self.structure.bodies.centre) > FEW_BLOCKS:
            # With more than a few blocks the fixed point takes very long: sooner less work.
            for ratio in (first_ratio, WORK_DECREASE * first_ratio):
                if first is None:
                    beginning = self._beginning(ratio * self.per_ratio)
                    first = self.at(ratio, beginning, bound, iterate=False)
            self.at_once = first is not None
        if first is None:
            first = self.at(first_ratio, start, bound)
        if not self.settled and self._unlimited:
            return self.result("unbounded")
        if first is None:
            return self.result("not_converged")
        last, ratio, worse = first, first.ratio, 0
        while not self.settled and ratio < LAST_WORK:
            found = self._further(last)
            if self.growing and self._no_upper:
                return self.result("unbounded")
            # Soft structures rise slowly. Gaps are infinite, and no reason to stop, until a state
            # converges.
            if found is None:
                break
            rises = found.rises_from(last) and not self.verified
            worse = 0 if found.gap <= GAP_FALLS * last.gap or rises else worse + 1
            if worse > (0 if self.nearly_settled else self.patience):
                break
            last, ratio = found, found.ratio
        last, ratio = first, first.ratio
        for _ in range(DECREASES if self.best is first else 0):
            if self.nearly_settled:
                break
            ratio *= WORK_DECREASE
            found = self.at(ratio, self._moved(last, ratio * self.per_ratio), last.bound)
            if found is None or found.gap > GAP_FALLS * last.gap:
                break
            last = found
        return self.result("limit" if self.verified else "not_converged")

    def destroy(self) -> None:
        """Free the solvers."""
        self.control.destroy()
        self.solver.destroy()

    def _further(self, last: _Found) -> _Found | None:
        """A state at more work: followed from the last one, if need be in shorter strides.

        Only where no state is verified yet, and none can be followed, is it iterated for afresh.
        """
        stride = self._stride(last)

        def ahead(part: float, **how: bool) -> _Found | None:
            ratio = min(last.ratio * stride**part, LAST_WORK)
            return self.at(ratio, self._moved(last, ratio * self.per_ratio), last.bound, **how)

        follow, first = last.history.converged and self.monolithic, self.part
        while follow and self.part >= SHORTEST_STRIDE:
            afresh = self.past_folds and self.part == 1.0 and not self.nearly_settled
            found = ahead(self.part, iterate=False, afresh=afresh)
            if found is not None:
                kept = self.part == first
                if kept and self.kept:
                    self.part = min(2.0 * self.part, 1.0)
                self.kept = kept
                return found
            if self.nearly_settled:
                break
            self.part *= 0.5
        return None if self.verified else ahead(1.0, follow=not follow)

    def at(
        self,
        ratio: float,
        start: State,
        bound: Array,
        follow: bool = True,
        iterate: bool = True,
        afresh: bool = False,
    ) -> _Found | None:
        """Find and verify the state at one T; None if there is none.

        Args:
            ratio: T in units of the live load's work on the bonded structure.
            start: State to start from.
            bound: First g, where it is iterated for.
            follow: Whether to look for a state next to `start`, unless that is the first.
            iterate: Whether to iterate for one if there is none.
            afresh: Whether else to follow the central path from where the search began.
        """
        work = ratio * self.per_ratio
        # Forces are judged by what the joints carry, which a locked structure lets grow.
        larger = max(1.0, self.largest_factor / self.scales.load_factor)
        scales = replace(
            self.scales,
            displacement=work / self.live_size,
            force=larger * self.scales.force,
            elastic=self.scales.displacement,
        )
        friction = CoulombFriction(
            self.solver,
            scales,
            self.options.tolerance,
            self.monolithic,
            self.monitor,
            at_once=self.at_once,
            attracting=self.method == "auto",
            past_folds=self.past_folds,
            small=self._small,
        )
        try:
            growth, warm = self._growth(work), bool(self.history)
            if iterate or not warm:
                point, history = friction.solve(start, bound, work, warm, growth, follow, iterate)
            else:
                beginning = self._beginning(work) if afresh else None
                point, history = friction.go_on(start, work, growth, beginning)
        except SolverError as error:
            _log.info("no state with T = %.3g: %s", work, error)
            return None
        work = point.state.work  # more, where there is no path to a state at what was asked for
        mode, slope, certificate = self._verify(point, scales)
        new_bound = self.problem.bound(point.state.pressure)
        rest = self._rest(work, point.state.load_factor)
        found = _Found(
            work / self.per_ratio, point, mode, certificate, history, new_bound, slope, rest
        )
        self.slope = slope
        self.history.append(history)
        self.path.append((work, point.state.load_factor))
        _log.info(
            "  T = %.3g: load factor %.8g, gap %.1e",
            work,
            point.state.load_factor,
            certificate.gap,
        )
        if self.best is None or self._better(found, self.best):
            self.best = found
        return found

    def _better(self, found: _Found, best: _Found) -> bool:
        """Whether a state is to be reported rather than one found before."""
        if not best.history.converged:
            return True
        if best.verified and not found.verified:  # more work costs digits
            return False
        return found.gap < max(best.gap, self.gap_asked)

    def _verify(self, point: PathPoint, scales: Scales) -> tuple[PETSc.Vec, float, Certificate]:
        """The collapse mode of a state, d lambda/dT along it, and the state's certificate.

        The mode is that of the elastic structure if it passes; else, with slow elastic motions
        mixed in, or singular in its sliding joints, that of rigid blocks with the same friction.
        """

        def certified(mode: PETSc.Vec, limit: float) -> Certificate:
            points, tolerance = self.structure.operators.points, self.options.tolerance
            return certify(self.problem, point.state, mode, scales, None, limit, points, tolerance)

        mode, slope, certificate = self._elastic_mode(point, scales, certified)
        confirmed = replace(certificate, static_factor=point.state.load_factor)
        if mode is not None and certificate.mode_passed and certificate.gap <= self.gap_asked:
            return mode, slope, confirmed
        strength = self.structure.all_points(self.problem.bound(point.state.pressure))
        rigid_limit, motion = np.nan, None
        try:
            limit, motion = self.blocks.collapse(strength)
            rigid_limit = np.nan if limit is None else limit
        except SolverError as error:
            _log.info("  no rigid mode: %s", error)
            if mode is not None and certificate.mode_passed:
                return mode, slope, confirmed
        if mode is not None:
            certificate = certified(mode, rigid_limit)
            if certificate.mode_passed or motion is None:
                return mode, slope, certificate
            mode.destroy()
        if motion is None:
            motion = np.zeros((len(self.structure.bodies.centre), 3))  # certifies nothing
        mode = self.structure.rigid_motion(motion)
        return mode, slope, certified(mode, rigid_limit)

    def _elastic_mode(
        self,
        point: PathPoint,
        scales: Scales,
        certified: Callable[[PETSc.Vec, float], Certificate],
    ) -> tuple[PETSc.Vec | None, float, Certificate]:
        """The better of the modes of a state with a bound that follows and with one that stays.

        A mode that dissipates at the state's load factor what the loads do bounds the
        given-friction limit from above, and the state's forces bound it from below.
        """

        def worth(of: Certificate) -> tuple[bool, float]:
            return not of.mode_passed, of.gap if np.isfinite(of.gap) else np.inf

        best: tuple[PETSc.Vec | None, float, Certificate] = None, 0.0, Certificate({}, np.nan)
        for bound in self._bounds(point):
            try:
                mode, slope = self.control.rate(point.state, bound, scales)
            except SolverError as error:
                _log.info("  no elastic mode: %s", error)
                continue
            certificate = certified(mode, kinematic_factor(self.problem, point.state, mode))
            if best[0] is not None:
                if worth(certificate) >= worth(best[2]):
                    mode.destroy()
                    break
                best[0].destroy()
            best = mode, slope, certificate
            enough = certificate.mode_passed and certificate.gap <= self.gap_asked
            if enough or not certificate.residuals["mode_penetration"] <= NOT_UNIQUE:
                break
        return best

    def _bounds(self, point: PathPoint) -> list[Array | None]:
        """Bounds on friction for modes of a state: Coulomb's, which follows, and its own.

        The first mode is nearer to that of the collapse, unless the other's equations are factored
        already.
        """
        given = point.bound
        if not (self.monolithic and self.problem.max(self.problem.friction) > 0.0):
            return [given]
        return [given, None] if self.control.linearised(point.state, given) else [None, given]

    @property
    def _small(self) -> bool:
        """Whether blocks are few, and coarsely meshed."""
        blocks = len(self.structure.bodies.centre)
        return blocks <= FEW_BLOCKS and self.problem.live.getSize() <= COARSE * blocks

    @property
    def _no_upper(self) -> bool:
        """Whether associative friction does not limit the load."""
        return self.blocks.limit() == np.inf

    @property
    def _unlimited(self) -> bool:
        """Whether the programs say that nothing limits the load.

        Without Coulomb friction the upper bound is exact; the lower one is a bound in any case.
        """
        if not np.any(self.structure.joints.friction):
            return self._no_upper
        return self.blocks.limit(friction=False) == np.inf

    @property
    def verified(self) -> bool:
        """Whether the best state is a collapse state."""
        return self.best is not None and self.best.verified

    @property
    def nearly_settled(self) -> bool:
        """Whether it is one but for what may be rounding."""
        best, asked = self.best, NEARLY * self.options.tolerance
        return best is not None and best.verified and best.gap <= max(asked, self.gap_asked)

    @property
    def settled(self) -> bool:
        """Whether it is one to the tolerance asked for."""
        return (
            self.best is not None
            and self.best.verified
            and self.best.gap <= self.gap_asked
            and (
                self.best.rest <= self.options.tolerance
                or self.best.gap <= CLOSED * self.options.tolerance
            )
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
        """How much further the load factor would rise along the last secant, or tangent."""
        if not self.path or not self.path[-1][0] < work:
            return 0.0
        last, high = self.path[-1]
        slope = self.slope
        if len(self.path) > 1 and self.path[-2][0] < last:
            first, low = self.path[-2]
            slope = (high - low) / (last - first)
        return max(slope * (work - last), 0.0)

    def _rest(self, work: float, factor: float) -> float:
        """What a load factor is still to change by if that falls like 1/T, relative.

        Zero where there is none at less work to tell.
        """
        if not self.path or not self.path[-1][0] < work:
            return 0.0
        last, before = self.path[-1]
        size = abs(factor) + ZERO_FACTOR * self.scales.load_factor
        return abs(factor - before) / (work / last - 1.0) / size

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
        strained = None
        if found.state.strained is not None:
            strained = self.problem.strained(found.mode)
            strained.aypx(work - found.state.work, found.state.strained)
        return replace(found.state, displacement=displacement, work=work, strained=strained)

    def _beginning(self, work: float) -> State:
        """Where the search began, scaled to another T."""
        displacement = self.start.displacement.copy()
        displacement.scale(work / self.start.work)
        return replace(self.start, displacement=displacement, work=work, strained=None)

    def _onset(self, found: _Found) -> State:
        """A state moved back along its mode to where the collapse began.

        Every state further along the mode has the same stresses and joint forces; at the first,
        some joint is about to close, or to stick.
        """
        opening, slip = self.problem.joint_displacements(found.state.displacement)
        opening_rate, slip_rate = self.problem.joint_displacements(found.mode)
        slip = slip - self.problem.slip_origin
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
        found, history = self.best, tuple(history.finished() for history in self.history)
        if found is None:
            return Collapse(
                status,
                np.inf if status == "unbounded" else float("nan"),
                self.blocks.bounds,
                history=history,
            )
        if status == "not_converged":
            _log.warning("not verified: %s", found.certificate.failures or "not converged")
        elif status == "limit" and found.gap > self.options.tolerance:
            _log.warning("the load factor is known to %.1e, not to the tolerance asked", found.gap)
        state = reported_state(self.problem, self._onset(found) if status == "limit" else found.state)
        mode = found.mode.array_r.copy()
        return Collapse(
            status,
            np.inf if status == "unbounded" else found.state.load_factor,
            self.blocks.bounds,
            state,
            mode,
            joint_values(self.structure, state, mode),
            found.certificate,
            history,
            found.ratio,
            self.solver.history if isinstance(self.solver, JointForces) else None,
        )


def reported_state(problem: ContactProblem, state: State) -> ReportedState:
    """A state as arrays."""
    elastic = problem.strained(state.displacement) if state.strained is None else state.strained
    return ReportedState(
        state.displacement.array_r.copy(),
        elastic.array_r.copy(),
        state.load_factor,
        state.pressure,
        state.shear,
        state.work,
    )


def new_solver(
    structure: Structure, problem: ContactProblem, control: WorkControl, method: str
) -> WorkControl | JointForces:
    """What solves for states with given friction."""
    if method not in ("splitting", "active-set"):
        return control
    return JointForces(problem, structure.operators, structure.springs, method == "splitting")


def first_work(
    method: str, program: Callable[[], LimitBounds], scales: Scales, blocks: int = 1
) -> float:
    """First T in units of the live load's work on the bonded structure, by number of blocks.

    Joint forces, unlike interior points, take many steps to a state far along the mode: they start
    at `FIRST_JOINT_WORK` times the work that belongs to the bound on the load factor.
    """
    if method not in ("splitting", "active-set"):
        many = blocks > FEW_BLOCKS and method in MONOLITHIC
        cube, square = WORK_OF_MANY
        return min(cube * blocks, square) * blocks**2 if many else FIRST_WORK
    upper = program().upper
    upper = np.inf if upper is None else upper
    return FIRST_JOINT_WORK * float(np.clip(upper / scales.load_factor, 1e-3, 1.0))
