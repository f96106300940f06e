"""Given friction by joint forces: normal and tangential subproblems in turn, or both at once.

With displacements eliminated (`joint_operator`) a state with given friction g minimises

    1/2 x.A x - b.x   subject to   r_N >= 0,  |r_T| <= g,      x = (r_N, r_T, lambda).

*Splitting* (L.A. Mihai, M. Ainsworth, Comput. Struct. 88 (2010) 859) minimises over (r_N, lambda)
with the shear forces prescribed, then over (r_T, lambda) with the normal forces prescribed. The
second is a step of the proximal gradient method for the minimum over r_N as a function of r_T, in
the metric of A_TT, so that Nesterov's extrapolation of r_T, restarted where it points uphill
(B. O'Donoghue, E. Candes, Found. Comput. Math. 15 (2015) 715), carries over. Where the sweeps
contract slowly, a step that minimises over all of x ends them.

All this happens inside a proximal point iteration (R.T. Rockafellar, SIAM J. Control Optim. 14
(1976) 877) on displacements and forces: the blocks are held near the displacements of the last step
by rho, the forces near its forces by a small multiple of A's diagonal, which settles points where
several blocks meet and forces are not unique. Neither has a part in the solution.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.analysis.certificate import state_residuals
from fenics_contact.discretization.joints import JointOperators
from fenics_contact.errors import SolverError
from fenics_contact.solvers.bound_qp import BoundQP, BoundQPOptions
from fenics_contact.solvers.delassus import JointOperator
from fenics_contact.solvers.interior_point import PathPoint
from fenics_contact.solvers.joint_stiffness import SpringStiffness
from fenics_contact.solvers.kkt import Scales, State
from fenics_contact.solvers.problem import ContactProblem

Array = npt.NDArray[np.float64]

_log = logging.getLogger("fenics_contact")

#: First rho in units of typical joint force over displacement, factor between levels, least in
#: units of the mean diagonal of K.
RHO, RHO_FACTOR, RHO_LEAST = 1e-2, 0.2, 1e-7

LAST_LEVEL = int(np.log(RHO_LEAST) / np.log(RHO_FACTOR))

#: A proximal step that contracts less than this is followed by one with a smaller rho.
SLOW_STEP = 0.3

#: Hold on the forces, in units of A's diagonal.
FORCE_HOLD = 1e-7

#: Joint laws missed by this times more than equilibrium call for a larger rho.
BALANCE = 100.0

MAX_STEPS = 200

#: Steps without progress after which the best state is judged.
PATIENCE = 30

#: States are as exact as this at best, and accepted up to the second number.
BEST, ACCEPTABLE = 1e-10, 1e-8

#: Sweeps of one proximal step, and how exact they make it relative to the step before.
MAX_SWEEPS, SWEEP_TOLERANCE = 40, 0.1

#: Back ends of subproblems and of the step for both, in the order in which they are tried, and
#: tolerance relative to the last step, with limits.
SUBPROBLEM_SOLVERS, JOINT_SOLVERS = ("vinewtonrsls", "bnls"), ("bnls", "bntr")
QP_TOLERANCE, QP_RANGE = 1e-3, (1e-11, 1e-3)

#: A cold start goes by way of these fractions of T, the first ones no more exact than this.
COLD_START, ON_THE_WAY = (0.01, 0.1, 1.0), 1e-2


@dataclass
class SplittingHistory:
    """What the method did.

    Attributes:
        steps: Proximal steps.
        joint_steps: Those that ended with a step for both kinds of forces at once.
        sweeps: Pairs of subproblems.
        contractions: Factor by which the residual fell per sweep, for every proximal step.
    """

    steps: int = 0
    joint_steps: int = 0
    sweeps: int = 0
    contractions: list[float] = field(default_factory=list)

    @property
    def contraction(self) -> float | None:
        """Geometric mean of the contractions; None without sweeps."""
        if not self.contractions or min(self.contractions) <= 0.0:
            return None
        return float(np.exp(np.mean(np.log(self.contractions))))


@dataclass
class _Level:
    """The programs of one rho."""

    operator: JointOperator
    diagonal: Array
    matrix: PETSc.Mat
    programs: dict[tuple[bool, bool, bool], tuple[PETSc.IS, BoundQP]] = field(default_factory=dict)

    def program(self, normal: bool, tangential: bool, free: bool) -> tuple[PETSc.IS, BoundQP]:
        """Rows and program of some unknowns; `free`: with the load factor among them."""
        key = normal, tangential, free
        if key not in self.programs:
            rows = self.operator.block(*key)
            block = self.matrix.createSubMatrix(rows, rows)
            self.programs[key] = rows, BoundQP(block)
            block.destroy()
        return self.programs[key]

    def destroy(self) -> None:
        """Free everything."""
        for rows, program in self.programs.values():
            rows.destroy()
            program.destroy()
        self.matrix.destroy()
        self.operator.destroy()


class JointForces:
    """Solves for states with given friction by their joint forces."""

    def __init__(
        self,
        problem: ContactProblem,
        joints: JointOperators,
        springs: SpringStiffness,
        sweeps: bool = True,
        joint_steps: bool = True,
    ) -> None:
        """Choose how to minimise.

        Args:
            problem: The structure.
            joints: Its joint rows.
            springs: Its stiffness, for the unit of rho and the count of factorisations.
            sweeps: Whether to alternate between normal and tangential subproblem.
            joint_steps: Whether to minimise over both at once where sweeps do not suffice.
        """
        self.problem = problem
        self.springs = springs
        self.history = SplittingHistory()
        self._joints = joints
        self._sweeps, self._joint_steps = sweeps, joint_steps
        self._levels: dict[int, _Level] = {}

    def solve(
        self,
        bound: Array | None,
        work: float,
        start: State,
        scales: Scales,
        centring: float = 1.0,
        tolerance: float = BEST,
        load_factor: float | None = None,
    ) -> PathPoint:
        """Solve for given work, or for a given load factor.

        Args:
            bound: g at this rank's points, N/m.
            work: T, N m per metre of thickness; not used with a load factor.
            start: State to start from.
            scales: Typical sizes.
            centring: 1 for a cold start, less for a warm one.
            tolerance: On the residuals of the state, relative to `scales`.
            load_factor: If given, lambda is prescribed, not the work.

        Returns:
            The solution, with the residuals recomputed.

        Raises:
            SolverError: If neither the tolerance nor `ACCEPTABLE` is reached, or without a bound:
                the Coulomb problem is not one of minimisation.
        """
        if bound is None:
            raise SolverError("joint forces: the method needs a given bound on friction")
        cold = centring >= 1.0 and load_factor is None
        state = start
        for fraction in COLD_START if cold else (1.0,):
            sizes = replace(scales, displacement=fraction * scales.displacement)
            run = _Run(self, bound, fraction * work, sizes, load_factor)
            asked = max(tolerance, BEST) if fraction == 1.0 else ON_THE_WAY
            state, residuals, steps = run.solve(state, asked)
        error = max(residuals.values())
        if not error <= max(tolerance, ACCEPTABLE):
            state.displacement.destroy()
            raise SolverError(
                f"joint forces: residual {error:.1e} after {steps} steps, asked {tolerance:.1e}"
            )
        return PathPoint(state, bound, residuals, steps)

    def level(self, number: int) -> _Level:
        """The programs with rho = mean diagonal times `RHO_FACTOR` to the given power."""
        if number not in self._levels:
            rho = self.springs.mean_diagonal * RHO_FACTOR**number
            operator = JointOperator(self.problem, self._joints, rho)
            self.springs.factorizations += 1
            matrix = operator.matrix.copy()
            hold = matrix.getDiagonal()
            hold.scale(FORCE_HOLD)
            matrix.setDiagonal(hold, PETSc.InsertMode.ADD_VALUES)
            self._levels[number] = _Level(operator, hold.array.copy(), matrix)
            hold.destroy()
        return self._levels[number]

    def destroy(self) -> None:
        """Free all programs."""
        for level in self._levels.values():
            level.destroy()
        self._levels.clear()


class _Run:
    """One bound, and one T or load factor."""

    def __init__(
        self,
        method: JointForces,
        bound: Array,
        work: float,
        scales: Scales,
        load_factor: float | None,
    ) -> None:
        self.method = method
        self.problem = method.problem
        self.history = method.history
        self.bound = bound
        self.work = work
        self.scales = scales
        self.load_factor = load_factor
        #: Whether the last step was minimised as exactly as asked for.
        self.exact = False

    def solve(self, start: State, tolerance: float) -> tuple[State, dict[str, float], int]:
        """Proximal point iteration; the state, its residuals, and the number of steps."""
        problem, scales = self.problem, self.scales
        near = start.displacement.copy()
        if self.load_factor is None:
            near.scale(self.work / problem.live.dot(near))
        forces = (
            np.maximum(start.pressure, 0.0),
            np.clip(start.shear, -self.bound, self.bound),
            start.load_factor if self.load_factor is None else self.load_factor,
        )
        unit = self.method.springs.mean_diagonal
        rho = RHO * scales.force / scales.displacement
        number = int(np.clip(np.floor(np.log(rho / unit) / np.log(RHO_FACTOR)), 0, LAST_LEVEL))
        best: State | None = None
        best_residuals: dict[str, float] = {}
        best_error, best_step, last = np.inf, 0, 1.0
        step = 0
        for step in range(1, MAX_STEPS + 1):
            level = self.method.level(number)
            new, forces = self._step(level, near, forces, last)
            change = self._distance(new, near)
            near.destroy()
            near = new
            work = self.work if self.load_factor is None else problem.live.dot(near)
            state = State(near, forces[2], forces[0], forces[1], work)
            residuals = state_residuals(problem, state, scales, self.bound)
            error = float(np.max(list(residuals.values())))
            _log.debug(
                "    %2d  rho %d  %.12g  change %.1e  %s",
                step,
                number,
                forces[2],
                change,
                residuals,
            )
            if error < best_error:
                if best is not None:
                    best.displacement.destroy()
                held = near.copy()
                best = State(held, forces[2], forces[0], forces[1], state.work)
                best_residuals, best_error, best_step = residuals, error, step
            if error <= tolerance or step - best_step >= PATIENCE or not np.isfinite(error):
                break
            slow = self.exact and step > 1 and change > SLOW_STEP * last
            number = _next_level(number, residuals, slow)
            last = max(change, tolerance)
        self.history.steps += step
        near.destroy()
        if best is None:
            raise SolverError("joint forces: a residual is not a number")
        return best, best_residuals, step

    def _step(
        self, level: _Level, near: PETSc.Vec, forces: tuple[Array, Array, float], last: float
    ) -> tuple[PETSc.Vec, tuple[Array, Array, float]]:
        """One proximal step: joint forces, then the displacements that go with them."""
        operator = level.operator
        right, free = operator.right(near, self.work)
        x = operator.join(*forces)
        right.array[:] += level.diagonal * x.array_r
        target = float(np.clip(SWEEP_TOLERANCE * last, BEST, 1.0))
        tolerance = float(np.clip(QP_TOLERANCE * last, *QP_RANGE))
        done = False
        if self.method._sweeps:
            done = self._sweep(level, right, x, target, tolerance)
        self.exact = done or self.method._joint_steps
        if not done and self.method._joint_steps:
            self._minimise(level, (True, True), right, x, JOINT_SOLVERS, tolerance)
            self.history.joint_steps += 1
        u = operator.displacement(x, free)
        forces = operator.split(x)
        for vector in (right, free, x):
            vector.destroy()
        return u, forces

    def _sweep(
        self, level: _Level, right: PETSc.Vec, x: PETSc.Vec, target: float, tolerance: float
    ) -> bool:
        """Alternate between the subproblems; whether the residual fell below `target`."""
        points = level.operator.points
        shear = slice(points, 2 * points)
        before = x.array_r[shear].copy()
        momentum = 1.0
        residuals = [self._residual(level, right, x)]
        for sweep in range(1, MAX_SWEEPS + 1):
            here = x.array_r[shear].copy()
            grown = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
            ahead = here + (momentum - 1.0) / grown * (here - before)
            x.array[shear] = ahead
            self._minimise(level, (True, False), right, x, SUBPROBLEM_SOLVERS, tolerance)
            self._minimise(level, (False, True), right, x, SUBPROBLEM_SOLVERS, tolerance)
            after = x.array_r[shear]
            uphill = self.problem.sum((ahead - after) * (after - here)) > 0.0
            before, momentum = here, 1.0 if uphill else grown
            residuals.append(self._residual(level, right, x))
            self.history.sweeps += 1
            if residuals[-1] <= target:
                break
            if self.method._joint_steps and sweep >= 3:
                rate = (residuals[-1] / residuals[-4]) ** (1.0 / 3.0)
                if residuals[-1] * rate ** (MAX_SWEEPS - sweep) > target:
                    break
        if residuals[0] > 0.0:
            rate = (residuals[-1] / residuals[0]) ** (1.0 / (len(residuals) - 1))
            self.history.contractions.append(rate)
        return residuals[-1] <= target

    def _minimise(
        self,
        level: _Level,
        unknowns: tuple[bool, bool],
        right: PETSc.Vec,
        x: PETSc.Vec,
        solvers: Sequence[str],
        tolerance: float,
    ) -> None:
        """Minimise over some of the unknowns while the others stay."""
        rows, program = level.program(*unknowns, self.load_factor is None)
        rest = x.copy()
        part = rest.getSubVector(rows)
        part.zeroEntries()
        rest.restoreSubVector(rows, part)
        remainder = right.duplicate()
        level.matrix.mult(rest, remainder)
        remainder.aypx(-1.0, right)
        lower, upper = self._bounds(level)
        vectors = [vector.getSubVector(rows) for vector in (remainder, lower, upper, x)]
        b, low, high, start = (vector.array_r.copy() for vector in vectors)
        for vector, part in zip((remainder, lower, upper, x), vectors, strict=True):
            vector.restoreSubVector(rows, part)
        best, residual = start, np.inf
        for solver in solvers:
            answer = program.attempt(b, low, high, start, BoundQPOptions(solver, tolerance))
            if answer.residual < residual:
                best, residual = answer.x, answer.residual
            if residual <= tolerance:
                break
        else:
            _log.debug("      %s: residual %.1e, asked %.1e", solvers, residual, tolerance)
        part = x.getSubVector(rows)
        part.array[:] = best
        x.restoreSubVector(rows, part)
        for vector in (rest, remainder, lower, upper):
            vector.destroy()

    def _bounds(self, level: _Level) -> tuple[PETSc.Vec, PETSc.Vec]:
        """Bounds on x."""
        none = np.full_like(self.bound, np.inf)
        join = level.operator.join
        return (
            join(np.zeros_like(self.bound), -self.bound, -np.inf),
            join(none, self.bound, np.inf),
        )

    def _residual(self, level: _Level, right: PETSc.Vec, x: PETSc.Vec) -> float:
        """What x misses of the optimality conditions, as displacements relative to typical ones."""
        gradient = right.duplicate()
        level.matrix.mult(x, gradient)
        gradient.axpy(-1.0, right)
        lower, upper = self._bounds(level)
        unit = level.diagonal / FORCE_HOLD
        above = np.maximum((x.array_r - upper.array_r) * unit, gradient.array_r)
        miss = np.abs(np.minimum((x.array_r - lower.array_r) * unit, above))
        size = self.problem.max(miss[: 2 * level.operator.points])
        for vector in (gradient, lower, upper):
            vector.destroy()
        return size / self.scales.displacement

    def _distance(self, u: PETSc.Vec, other: PETSc.Vec) -> float:
        """Largest difference relative to the largest displacement."""
        other.axpy(-1.0, u)
        size = u.norm(PETSc.NormType.INFINITY)
        return float(other.norm(PETSc.NormType.INFINITY) / (size or 1.0))


def _next_level(number: int, residuals: Mapping[str, float], slow: bool) -> int:
    """Level of rho for the next step.

    A smaller rho where it delays equilibrium; a larger one where the programs, badly conditioned
    with a small rho, miss the joint laws.
    """
    equilibrium = residuals["equilibrium"]
    joints = max(value for name, value in residuals.items() if name != "equilibrium")
    if slow and equilibrium > joints:
        number += 1
    elif joints > BALANCE * equilibrium and joints > ACCEPTABLE:
        number -= 1
    return int(np.clip(number, 0, LAST_LEVEL))
