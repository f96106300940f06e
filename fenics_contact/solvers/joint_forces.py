"""States with given friction from their joint forces: normal and shear forces in turn, or at once.

The elastic blocks as their joints see them (the Delassus operator) have the joint forces as
unknowns. Nothing but contact holds a block that stands on others, so that its displacements are
held near those of the step before, u', by a small stiffness rho:

    K_rho u = f_D + lambda f_L + B^T r + rho u',    K_rho = K + rho I,    r = (r_N, r_T).

With u eliminated, opening and slip are B u = A_rr r + A_rl lambda - b_r and the work of the live
load is f_L.u = A_lr r + A_ll lambda + ..., together A x - b with x = (r_N, r_T, lambda) and

    A = S K_rho^-1 S^T,   S = (B, f_L),   b = (0, w_0, T) - S u_0,   u_0 = K_rho^-1 (f_D + rho u'),

symmetric positive semi-definite; w_0 is the origin of slip. A state with given friction g under
work control, f_L.u = T, minimises

    1/2 x.A x - b.x   subject to   r_N >= 0,  |r_T| <= g

(`bound_qp`). *Splitting* (L.A. Mihai, M. Ainsworth, Comput. Struct. 88 (2010) 859) minimises over
(r_N, lambda) with the shear forces prescribed, then over (r_T, lambda) with the normal forces
prescribed. Where these sweeps contract slowly, a step that minimises over all of x ends them.

All this happens inside a proximal point iteration (R.T. Rockafellar, SIAM J. Control Optim. 14
(1976) 877): at the solution u = u' the small stiffness has no part. Where several blocks meet
forces are not unique; a small multiple of A's diagonal D holds them near those of the step before,
x': A + D in place of A, b + D x' in place of b.

A block of A couples joint points of one body only: A is sparse, and all bodies are solved for at
once, one joint point of each at a time.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import SolverError
from fenics_contact.parallel import PETSc
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.bound_qp import BoundQP
from fenics_contact.solvers.problem import (
    Array,
    Closing,
    ContactProblem,
    Owner,
    Scales,
    SparseMap,
    State,
    sparse_rows,
)

Integers = npt.NDArray[np.integer]
Entries = Iterator[tuple[Integers, Integers, Array]]

#: What a state misses of its conditions with a given bound, by name, relative to typical sizes.
Residuals = Callable[[ContactProblem, State, Scales, Array], Mapping[str, float]]

#: Kinds of joint forces that a program is solved for, beside the load factor.
NORMAL = (0,)
TANGENTIAL = (1,)
BOTH = (0, 1)
#: Prefixes of PETSc options by these kinds, and of those for K_rho.
PREFIXES = {NORMAL: "normal_", TANGENTIAL: "shear_", BOTH: "joint_"}
HOLD_PREFIX = "hold_"

#: Relative rounding of programs: no tolerance is smaller.
ROUNDING = 1e-12

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class JointPoints:
    """Joint points of this rank's rows of B_N and B_T.

    Attributes:
        sides: Bodies of the first and second side, -1: rigid ground, shape (rows, 2).
        dofs: Global displacements, half of them of either side, first side first, -1: none, shape
            (rows, n).
        normal: Coefficients of B_N on those, shape (rows, n).
        tangential: Coefficients of B_T, likewise.
    """

    sides: Integers
    dofs: Integers
    normal: Array
    tangential: Array


class DelassusOperator(Closing):
    """A + D for one rho, its programs, and displacements of joint forces; to use in a `with`.

    Attributes:
        matrix: A + D; every rank's rows are r_N of its points, r_T of its points, and on the last
            rank lambda.
        hold: D, this rank's part.
        points: Number of this rank's joint points.
    """

    def __init__(self, problem: ContactProblem, points: JointPoints, rho: float) -> None:
        """Factor K_rho, rho in N/m per metre, and compute A."""
        self.points = problem.points
        self._problem = problem
        self._rho = rho
        self._last = problem.comm.rank == problem.comm.size - 1
        self._programs: dict[tuple[int, ...], tuple[Integers, BoundQP]] = {}
        with Owner() as owner:
            stiffness = owner.own(problem.stiffness.matrix.copy())
            stiffness.shift(rho)
            stiffness.setOption(PETSc.Mat.Option.SPD, True)
            self._solver = owner.own(PETSc.KSP().create(stiffness.comm))
            self._solver.setType(PETSc.KSP.Type.PREONLY)
            self._solver.getPC().setType(PETSc.PC.Type.CHOLESKY)
            self._solver.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
            self._solver.setOptionsPrefix(HOLD_PREFIX)
            self._solver.setFromOptions()
            self._solver.setOperators(stiffness)
            self._solver.getPC().setUp()
            self._vectors = [owner.own(v) for v in problem.stiffness.matrix.createVecs()]
            self.matrix = SparseMap(self._assembled(points))
            owner.callback(self.matrix.close)
            added = SEARCH.regularization
            self.hold = added / (1.0 + added) * self.matrix.diagonal()
            self._owner = owner.pop_all()

    def right(self, near: Array, held: Array, work: float) -> tuple[Array, Array]:
        """Right-hand side b + D x', and displacements u_0 without joint forces and live load.

        Args:
            near: u', m, shape (this rank's displacements,).
            held: x', this rank's part.
            work: T, N m per metre of thickness.
        """
        problem = self._problem
        free = self._response(problem.dead + self._rho * near)
        right = self.join(
            -problem.openings(free),
            -problem.slips(free),
            work - problem.dot(problem.live, free),
        )
        return right + self.hold * held, free

    def displacement(self, x: Array, free: Array) -> Array:
        """Displacements u of joint forces and load factor x, with u_0 as `free`."""
        pressure, shear, load_factor = self.split(x)
        problem = self._problem
        forces = problem.joint_forces(pressure, shear) + load_factor * problem.live
        return free + self._response(forces)

    def join(self, pressure: Array, shear: Array, load_factor: float) -> Array:
        """Unknowns x of their parts, this rank's."""
        return np.concatenate([pressure, shear, [load_factor] * self._last])

    def split(self, x: Array) -> tuple[Array, Array, float]:
        """Normal and shear forces at this rank's points, and the load factor."""
        pressure, shear, rest = np.split(x, [self.points, 2 * self.points])
        factor = float(rest[0]) if self._last else 0.0
        comm = self._problem.comm
        return pressure, shear, comm.bcast(factor, root=comm.size - 1)

    def program(self, kinds: tuple[int, ...]) -> tuple[Integers, BoundQP]:
        """This rank's rows, and bound-constrained program, of the load factor and some forces.

        Args:
            kinds: Of joint forces: 0 normal, 1 tangential.
        """
        if kinds not in self._programs:
            parts = [k * self.points + np.arange(self.points) for k in kinds]
            rows = np.concatenate([*parts, np.arange(2 * self.points, len(self.hold))])
            with Owner() as owner:
                chosen = self.matrix.first_row + rows
                comm = self.matrix.matrix.comm
                places = owner.own(PETSc.IS().createGeneral(chosen.astype(PETSc.IntType), comm))
                block = owner.own(self.matrix.matrix.createSubMatrix(places, places))
                program = BoundQP(block, PREFIXES[kinds])
                self._programs[kinds] = rows, self._owner.enter_context(program)
        return self._programs[kinds]

    def _response(self, forces: Array) -> Array:
        """K_rho^-1 f, this rank's part."""
        right, solution = self._vectors
        right.array[:] = forces
        self._solver.solve(right, solution)
        return solution.array_r.copy()

    def _assembled(self, points: JointPoints) -> PETSc.Mat:
        """A + D from the entries of A."""
        from scipy.sparse import coo_matrix

        comm = self._problem.comm
        size = 2 * self.points + self._last
        sizes = comm.allgather(size)
        start = sum(sizes[: comm.rank])
        total = sum(sizes)
        entries = [*self._flexibility(points, start), *self._border(start, total)]
        rows, columns, values = (np.concatenate(part) for part in zip(*entries, strict=True))
        values = np.where(rows == columns, 1.0 + SEARCH.regularization, 1.0) * values
        table = coo_matrix((values, (rows - start, columns)), (size, total)).tocsr()
        csr = table.indptr.astype(PETSc.IntType), table.indices.astype(PETSc.IntType), table.data
        matrix = PETSc.Mat().createAIJ(((size, total), (size, total)), csr=csr, comm=comm)
        matrix.assemble()
        return matrix

    def _flexibility(self, points: JointPoints, start: int) -> Entries:
        """Rows, columns and values of A_rr, from unit forces at one point of every body at once."""
        count = self.points
        # Row of r_N of the points of all ranks; that of r_T is `shift` further.
        parts = self._problem.comm.allgather((points.sides, start))
        row = np.concatenate([first + np.arange(len(sides)) for sides, first in parts])
        shift = np.concatenate([np.full(len(sides), len(sides)) for sides, _ in parts])
        places, table = _places(np.concatenate([sides for sides, _ in parts]))
        place = places[int(np.searchsorted(row, start)) :][:count]
        with Owner() as owner:
            stiffness = self._problem.stiffness.matrix
            force = self._vectors[0]
            sides = [owner.own(_one_side(points, side, stiffness)) for side in (0, 1)]
            unit = owner.own(sides[0].createVecLeft())
            for slot, direction in np.ndindex(table.shape[1], 2):
                force.zeroEntries()
                for side, matrix in enumerate(sides):
                    unit.array[:] = 0.0
                    unit.array[direction * count :][:count] = place[:, side] == slot
                    matrix.multTransposeAdd(unit, force, force)
                self._solver.solve(force, self._vectors[1])
                for side, matrix in enumerate(sides):
                    matrix.mult(self._vectors[1], unit)
                    # The point with this place on the body at that side of every row.
                    body = points.sides[:, side]
                    other = np.where(body >= 0, table[body, slot], -1)
                    at = np.flatnonzero(other >= 0)
                    column = row[other[at]] + direction * shift[other[at]]
                    for k in (0, count):
                        yield start + k + at, column, unit.array_r[k + at]

    def _border(self, start: int, total: int) -> Entries:
        """Rows, columns and values of A_rl, A_lr and A_ll; lambda is the last of all unknowns."""
        problem = self._problem
        response = self._response(problem.live)
        joints = np.concatenate([problem.normal @ response, problem.tangential @ response])
        here = start + np.arange(len(joints))
        yield here, np.full(len(joints), total - 1), joints
        flexibility = problem.dot(problem.live, response)
        for rows, values in problem.comm.gather((here, joints), problem.comm.size - 1) or ():
            yield np.full(len(rows), total - 1), rows, values
        if self._last:
            yield np.array([total - 1]), np.array([total - 1]), np.array([flexibility])


@dataclass
class SplittingHistory:
    """What was done over all states solved for.

    Attributes:
        residuals: After every proximal step.
        contractions: By what the residual fell in every sweep, a pair of subproblems.
        joint_steps: Number of steps that ended with one for both kinds of forces at once.
    """

    residuals: list[float] = field(default_factory=list)
    contractions: list[float] = field(default_factory=list)
    joint_steps: int = 0

    @property
    def steps(self) -> int:
        """Number of proximal steps."""
        return len(self.residuals)

    @property
    def sweeps(self) -> int:
        """Number of pairs of subproblems."""
        return len(self.contractions)

    @property
    def contraction(self) -> float | None:
        """Factor by which the residual fell per sweep, geometric mean; None without sweeps."""
        return float(np.exp(np.mean(np.log(self.contractions)))) if self.sweeps else None


@dataclass(frozen=True)
class ProximalStep:
    """The program of one proximal step.

    Attributes:
        operator: A + D.
        right: b + D x', this rank's part like all arrays here.
        bounds: Lower and upper bounds on x.
        change: Change of the displacements in the last step, relative.
        displacement: Typical displacement, m.
        history: Counts.
    """

    operator: DelassusOperator
    right: Array
    bounds: tuple[Array, Array]
    change: float
    displacement: float
    history: SplittingHistory

    def minimise(self, kinds: tuple[int, ...], x: Array) -> Array:
        """Minimiser over some kinds of forces, and the load factor, from x."""
        rows, program = self.operator.program(kinds)
        found = x.copy()
        found[rows] = 0.0
        rest = self.right - self.operator.matrix @ found
        accuracy = SEARCH.decade * SEARCH.bound_precision
        tolerance = float(np.clip(accuracy * self.change, ROUNDING, accuracy))
        lower, upper = self.bounds
        found[rows] = program.solve(rest[rows], lower[rows], upper[rows], x[rows], tolerance)
        return found

    def residual(self, x: Array) -> float:
        """Openings and slips that x misses the joint laws by, relative to typical ones."""
        lower, upper = self.bounds
        gradient = self.operator.matrix @ x - self.right
        unit = self.operator.hold / SEARCH.regularization
        miss = np.minimum((x - lower) * unit, np.maximum((x - upper) * unit, gradient))
        miss = np.abs(miss[: 2 * self.operator.points])
        largest = self.operator.matrix.comm.allgather(float(np.max(miss, initial=0.0)))
        return float(np.max(largest)) / self.displacement


def at_once(step: ProximalStep, x: Array) -> Array:
    """Minimiser over normal and shear forces at once, from x."""
    step.history.joint_steps += 1
    return step.minimise(BOTH, x)


def alternately(step: ProximalStep, x: Array) -> Array:
    """Minimiser by sweeps, ended by a step for all forces where they contract slowly, from x."""
    history = step.history
    residual = step.residual(x)
    while residual > SEARCH.decade * step.change:
        x = step.minimise(TANGENTIAL, step.minimise(NORMAL, x))
        before = residual
        residual = step.residual(x)
        history.contractions.append(max(residual / before, ROUNDING))
        if not residual <= SEARCH.decade * before:
            return at_once(step, x)
    return x


class JointForceSolver(Closing):
    """Solves for states with given friction by joint forces; frees its objects in a `with`.

    Attributes:
        history: Counts.
        factorizations: Of stiffnesses so far.
    """

    def __init__(
        self,
        problem: ContactProblem,
        points: JointPoints,
        residuals: Residuals,
        minimise: Callable[[ProximalStep, Array], Array] = alternately,
    ) -> None:
        """Choose how to minimise: `alternately` or `at_once`."""
        self.history = SplittingHistory()
        self.factorizations = 0
        self._problem = problem
        self._points = points
        self._residuals = residuals
        self._minimise = minimise
        self._owner = Owner()
        self._operators: dict[float, DelassusOperator] = {}
        # Of a smaller rho K_rho keeps too few digits.
        self._least = SEARCH.digits * problem.max(problem.stiffness.diagonal())

    def solve(
        self, bound: Array, work: float, start: State, scales: Scales, tolerance: float
    ) -> tuple[State, dict[str, float]]:
        """State with friction bound g under given work, and its residuals, recomputed.

        Args:
            bound: g at this rank's points, N per metre of thickness.
            work: T, N m per metre of thickness.
            start: State to start from.
            scales: Typical sizes.
            tolerance: On the residuals of the state.

        Raises:
            SolverError: If neither the tolerance nor what is acceptable is reached.
        """
        problem = self._problem
        u = start.displacement * (work / problem.dot(problem.live, start.displacement))
        shear = np.clip(start.shear, -bound, bound)
        pressure = np.maximum(start.pressure, 0.0)
        state = State(u, start.elastic, start.load_factor, pressure, shear, work)
        best: tuple[float, State, dict[str, float]] = np.inf, state, {}
        errors: list[float] = []
        patience = SEARCH.interior_window
        level = 0
        last = 1.0
        while not best[0] <= tolerance:
            near = state
            state = self._step(level, near, bound, scales, last)
            residuals = dict(self._residuals(self._problem, state, scales, bound))
            errors.append(float(np.max(list(residuals.values()))))
            best = min(best, (errors[-1], state, residuals), key=lambda found: found[0])
            if not min(errors[-patience:]) < 0.5 * min([np.inf, *errors[:-patience]]):
                break
            level, last = self._adapted(level, last, near, state, residuals)
            if self._rho(level, scales) < self._least:
                level -= 1
        self.history.residuals += errors
        reached = f"joint forces: residual {best[0]:.1e} after {len(errors)} steps"
        _log.debug(reached)
        if not best[0] <= max(tolerance, SEARCH.digits / SEARCH.decade**2):
            raise SolverError(f"{reached}, asked {tolerance:.1e}")
        return best[1], best[2]

    def _adapted(
        self, level: int, last: float, near: State, state: State, residuals: Mapping[str, float]
    ) -> tuple[int, float]:
        """Level and accuracy for the next step.

        rho falls where it delays equilibrium, and rises where programs, badly conditioned with a
        small rho, miss the joint laws.
        """
        size = self._problem.max(np.abs(state.displacement)) or 1.0
        change = self._problem.max(np.abs(state.displacement - near.displacement)) / size
        joints = max(value for name, value in residuals.items() if name != "equilibrium")
        if SEARCH.decade**2 * joints > residuals["equilibrium"]:
            level = max(level - 1, 0)
        elif last < 1.0 and change > SEARCH.decade * last:
            level = level + 1
        return level, min(change, last, joints + residuals["equilibrium"])

    def _rho(self, level: int, scales: Scales) -> float:
        """Small stiffness rho of a level, N/m per metre of thickness."""
        return SEARCH.decade ** (1 + level) * scales.force / scales.displacement

    def _step(self, level: int, near: State, bound: Array, scales: Scales, change: float) -> State:
        """The state one proximal step from another, by a rho, after a change."""
        size = scales.displacement
        rho = self._rho(level, scales)
        if rho not in self._operators:
            operator = DelassusOperator(self._problem, self._points, rho)
            self._operators[rho] = self._owner.enter_context(operator)
            self.factorizations += 1
        operator = self._operators[rho]
        none = np.full_like(bound, np.inf)
        held = operator.join(near.pressure, near.shear, near.load_factor)
        right, alone = operator.right(near.displacement, held, near.work)
        box = operator.join(0.0 * bound, -bound, -np.inf), operator.join(none, bound, np.inf)
        step = ProximalStep(operator, right, box, change, size, self.history)
        x = self._minimise(step, held)
        pressure, shear, factor = operator.split(x)
        state = self._problem.state(operator.displacement(x, alone), factor, pressure, shear)
        return replace(state, work=near.work)


def _places(sides: Integers) -> tuple[Integers, Integers]:
    """Place of every point among those of either body, and the point in every place of every body.

    Args:
        sides: Bodies of all points, -1: rigid ground, shape (points, 2).

    Returns:
        Shapes (points, 2) and (bodies, places), -1: none.
    """
    flat = sides.astype(np.int64).ravel()
    held = np.flatnonzero(flat >= 0)
    held = held[np.argsort(flat[held], kind="stable")]
    body = flat[held]
    place = np.full(len(flat), -1)
    place[held] = np.arange(len(held)) - np.searchsorted(body, body)
    table = np.full((body.max(initial=-1) + 1, place.max(initial=-1) + 1), -1)
    table[body, place[held]] = held // 2
    return place.reshape(-1, 2), table


def _one_side(points: JointPoints, side: int, stiffness: PETSc.Mat) -> PETSc.Mat:
    """The part of (B_N, B_T) that belongs to one side of the joints."""
    half = points.dofs.shape[1] // 2
    columns = slice(half * side, half * (side + 1))
    dofs = np.tile(points.dofs[:, columns], (2, 1))
    rows = np.concatenate([points.normal[:, columns], points.tangential[:, columns]])
    return sparse_rows(stiffness, dofs, rows)
