"""Bound-constrained quadratic programs by PETSc's TAO and SNES.

    min 1/2 x.A x - b.x   subject to   lower <= x <= upper,      A symmetric positive semi-definite.

The back ends see the program in units in which the diagonal of A is one and the largest entry of b
is one, so that no tolerance depends on units. Whatever they report, the residual

    max |min(x - lower, max(x - upper, A x - b))|

is recomputed here in these units.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.errors import SolverError
from fenics_contact.solvers.problem import Array, Closing, Owner, SparseMap

TAO_SOLVERS = ("faces", "tron", "bnls", "bntr", "bqnls", "blmvm", "bqpip", "gpcg")
SNES_SOLVERS = ("vinewtonrsls", "vinewtonssls")
SOLVERS = (*TAO_SOLVERS, *SNES_SOLVERS)

#: Options of the solvers are set under this prefix, and removed again.
PREFIX = "fenics_contact_qp_"


@dataclass(frozen=True)
class BoundQPOptions:
    """How to solve.

    Attributes:
        solver: One of `SOLVERS`.
        tolerance: On the residual.
        max_iterations: Of the back end.
        unbounded: Bounds as large as this are none, for PETSc too.
        descent: "faces": part of the first-order descent that a projected step must bring.
        shorter: "faces": factor from one step to a shorter one.
        least_step: "faces": the shortest one tried.
    """

    solver: str = "faces"
    tolerance: float = 1e-10
    max_iterations: int = 400
    unbounded: float = 1e20
    descent: float = 1e-2
    shorter: float = 0.7
    least_step: float = 1e-14


@dataclass(frozen=True)
class BoundSolution:
    """An answer, good or bad: `residual` tells.

    Attributes:
        x: Minimiser, this rank's part.
        residual: As in the module's docstring.
        iterations: Of the back end.
        reason: What the back end reported; positive where it thinks that it converged; the negative
            of PETSc's error code where it broke down.
    """

    x: Array
    residual: float
    iterations: int
    reason: int


class BoundQP(Closing):
    """The programs of one operator, with any b and bounds; frees its objects in a `with`."""

    def __init__(self, operator: PETSc.Mat) -> None:
        """Scale the operator.

        Args:
            operator: A, assembled; it stays the caller's.

        Raises:
            SolverError: If its diagonal is not positive.
        """
        with Owner() as owner:
            unit = owner.own(operator.getDiagonal())
            if not unit.min()[1] > 0.0:
                raise SolverError("bound QP: the operator's diagonal is not positive")
            unit.sqrtabs()
            unit.reciprocal()
            self._unit = unit.array_r.copy()
            scaled = operator.copy()
            scaled.diagonalScale(unit, unit)
            self._operator = SparseMap(scaled)
            owner.callback(self._operator.close)
            # Back ends write into theirs: some scale it, or shift its diagonal.
            self._given = owner.own(scaled.copy())
            self._vectors = [owner.own(scaled.createVecLeft()) for _ in range(5)]
            self._owner = owner.pop_all()
        # PETSc's own factorisation is the faster for small matrices on one rank.
        parallel = {"pc_factor_mat_solver_type": "mumps"} if operator.comm.size > 1 else {}
        self._factor = {"pc_type": "lu", **parallel}

    def solve(
        self,
        right: Array,
        lower: Array,
        upper: Array,
        start: Array | None = None,
        options: BoundQPOptions | None = None,
    ) -> BoundSolution:
        """Minimiser x of 1/2 x.A x - b.x subject to lower <= x <= upper, with its residual.

        Args:
            right: b, this rank's part like all arrays here.
            lower: Lower bounds; -inf where there is none.
            upper: Upper bounds; inf where there is none.
            start: First x, moved into the bounds; zero when not given.
            options: Back end and tolerance.

        Raises:
            SolverError: If no back end has the name.
        """
        options = options or BoundQPOptions()
        b, low, high, x, _ = self._vectors
        scale = self._unit * self._set_right(right)  # x = scale * scaled x
        lower = lower / scale
        upper = upper / scale
        low.array[:] = np.clip(lower, -options.unbounded, options.unbounded)
        high.array[:] = np.clip(upper, -options.unbounded, options.unbounded)
        x.array[:] = np.clip(0.0 if start is None else start / scale, low.array_r, high.array_r)
        try:
            iterations, reason = self._run(options)
        except PETSc.Error as error:  # a singular matrix, for instance
            iterations = 0
            reason = -error.ierr
        # With the infinite bounds: what PETSc calls no bound is no place to come to rest.
        found = x.array_r.copy()
        gradient = self._operator @ found - b.array_r
        residual = _largest_miss(found, gradient, lower, upper, self._operator.comm)
        return BoundSolution(found * scale, residual, iterations, reason)

    def _set_right(self, right: Array) -> float:
        """Set the scaled b, whose largest entry is 1; returns the number it was divided by."""
        b = self._vectors[0]
        b.array[:] = right * self._unit
        size = float(b.norm(PETSc.NormType.INFINITY)) or 1.0
        b.scale(1.0 / size)
        return size

    def _run(self, options: BoundQPOptions) -> tuple[int, int]:
        """Iterations and reason of a solver; its answer becomes x.

        Raises:
            SolverError: If no back end has the name.
        """
        if options.solver in TAO_SOLVERS:
            return self._tao(options)
        if options.solver in SNES_SOLVERS:
            return self._snes(options)
        known = ", ".join(SOLVERS)
        raise SolverError(f"bound QP: unknown solver '{options.solver}'; known: {known}")

    def _tao(self, options: BoundQPOptions) -> tuple[int, int]:
        """Iterations and reason of a TAO solver; x becomes its answer."""
        right, low, high, x, _ = self._vectors
        # The Newton type methods ("bn...") solve with their free variables directly: conjugate
        # gradients lose the digits of nearly dependent joint points.
        linear = {f"tao_bnk_{name}": value for name, value in self._factor.items()}
        with Owner() as owner, _options(tao_bnk_ksp_rtol="1e-12", ksp_rtol="1e-12", **linear):
            tao = owner.own(PETSc.TAO().create(self._given.comm))
            tao.setOptionsPrefix(PREFIX)
            if options.solver == "faces":
                tao.createPython(
                    _Faces(self._operator, right.array_r, self._factor, options), tao.comm
                )
            else:
                tao.setType(options.solver)
            tao.setObjective(self._objective)
            tao.setGradient(self._gradient, None)
            tao.setHessian(self._renew, self._given, self._given)
            tao.setVariableBounds((low, high))
            tao.setMaximumIterations(options.max_iterations)
            tao.setTolerances(gatol=0.1 * options.tolerance, grtol=0.0, gttol=0.0)
            tao.setSolution(x)
            tao.setFromOptions()
            tao.solve()
            answer = tao.getIterationNumber(), tao.getConvergedReason()
        return answer

    def _snes(self, options: BoundQPOptions) -> tuple[int, int]:
        """Iterations and reason of a SNES solver; x becomes its answer."""
        _, low, high, x, value = self._vectors
        # The Newton step is often not one of descent at full length: of PETSc's line searches only
        # "bt" stops the active set from cycling.
        linear = {"snes_linesearch_type": "bt", "ksp_type": "preonly", **self._factor}
        with Owner() as owner, _options(**linear):
            snes = owner.own(PETSc.SNES().create(self._given.comm))
            snes.setOptionsPrefix(PREFIX)
            snes.setType(options.solver)
            snes.setFunction(self._gradient, value)
            snes.setJacobian(self._renew, self._given, self._given)
            snes.setVariableBounds(low, high)
            most = options.max_iterations
            tolerance = 0.1 * options.tolerance
            snes.setTolerances(rtol=0.0, atol=tolerance, stol=0.0, max_it=most)
            snes.setFromOptions()
            snes.solve(None, x)
            answer = snes.getIterationNumber(), snes.getConvergedReason()
        return answer

    def _objective(self, _solver: PETSc.TAO, at: PETSc.Vec) -> float:
        """1/2 x.A x - b.x."""
        x = at.array_r
        b = self._vectors[0].array_r
        total = float(x @ (0.5 * (self._operator @ x) - b))
        return float(self._operator.comm.allreduce(total))

    def _gradient(self, _solver: object, at: PETSc.Vec, gradient: PETSc.Vec) -> None:
        """A x - b."""
        self._operator.matrix.mult(at, gradient)
        gradient.axpy(-1.0, self._vectors[0])

    def _renew(self, _solver: object, _at: PETSc.Vec, given: PETSc.Mat, _pre: PETSc.Mat) -> None:
        """Make the matrix of the back end A again, for each step."""
        self._operator.matrix.copy(given, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)


class _Faces:
    """Minimisation face by face, as a type of TAO solver.

    A projected gradient step chooses a face of the box. Newton steps with projected searches, which
    may add bounds, find the minimum on it. Only then the next gradient step releases bounds
    (J.J. More, G. Toraldo, SIAM J. Optim. 1 (1991) 93; here with a direct solver). Types that may
    release bounds after every Newton step take many times as many where A is badly conditioned.
    """

    def __init__(
        self, operator: SparseMap, right: Array, factor: dict[str, str], options: BoundQPOptions
    ) -> None:
        self._operator = operator
        self._right = right
        self._factor = factor
        self._options = options

    def solve(self, tao: PETSc.TAO) -> None:
        """Minimise from TAO's solution, which becomes the answer."""
        low, high = self._box = tuple(bound.array_r for bound in tao.getVariableBounds())
        x = tao.getSolution().array_r.copy()
        steps = 0
        most = tao.getMaximumIterations()
        reason = PETSc.TAO.Reason.DIVERGED_MAXITS
        while steps < most:
            gradient = self._operator @ x - self._right
            miss = _largest_miss(x, gradient, low, high, self._operator.comm)
            if not miss > tao.getTolerances()[0]:
                reason = PETSc.TAO.Reason.CONVERGED_GATOL
                break
            free = ((x > low) | (gradient < 0.0)) & ((x < high) | (gradient > 0.0))
            down = np.where(free, -gradient, 0.0)
            length = self._dot(down, down) / self._dot(down, self._operator @ down)
            x, _ = self._projected_search(x, gradient, length * down)
            added = True
            while added and steps < most:
                gradient = self._operator @ x - self._right
                x, added = self._projected_search(x, gradient, self._newton_step(x, gradient))
                steps += 1
        tao.getSolution().array[:] = x
        tao.setIterationNumber(steps)
        tao.setConvergedReason(reason)

    def _projected_search(self, x: Array, gradient: Array, step: Array) -> tuple[Array, bool]:
        """New x along a projected step, and whether it meets bounds that x does not."""
        (low, high), options = self._box, self._options
        part = 1.0
        while True:
            new = np.clip(x + part * step, low, high)
            change = new - x
            slope = self._dot(gradient, change)
            descent = slope + 0.5 * self._dot(change, self._operator @ change)
            if not descent > options.descent * slope or part < options.least_step:
                break
            part *= options.shorter
        met = (x > low) & (x < high) & ((new <= low) | (new >= high))
        return new, bool(self._operator.comm.allreduce(bool(np.any(met)), MPI.LOR))

    def _newton_step(self, x: Array, gradient: Array) -> Array:
        """Step to the minimum on the face of x, with no regard to the other bounds."""
        low, high = self._box
        matrix = self._operator.matrix
        inside = np.flatnonzero((x > low) & (x < high))
        step = np.zeros_like(x)
        with Owner() as owner:
            rows = (self._operator.first_row + inside).astype(PETSc.IntType)
            face = owner.own(PETSc.IS().createGeneral(rows, comm=matrix.comm))
            if face.getSize() == 0:
                return step
            block = owner.own(matrix.createSubMatrix(face, face))
            right, solution = (owner.own(vector) for vector in block.createVecs())
            right.array[:] = -gradient[inside]
            solver = owner.own(PETSc.KSP().create(matrix.comm))
            solver.setOptionsPrefix(PREFIX)
            solver.setOperators(block)
            with _options(ksp_type="preonly", **self._factor):
                solver.setFromOptions()
            solver.solve(right, solution)
            if solver.getConvergedReason() > 0:  # or else there is no minimum
                step[inside] = solution.array_r
        return step

    def _dot(self, a: Array, b: Array) -> float:
        return float(self._operator.comm.allreduce(float(a @ b)))


def _largest_miss(x: Array, gradient: Array, lower: Array, upper: Array, comm: MPI.Comm) -> float:
    """Residual max |min(x - lower, max(x - upper, gradient))|; nan where any entry is."""
    miss = np.abs(np.minimum(x - lower, np.maximum(x - upper, gradient)))
    # MPI.MAX may drop a nan that one rank holds.
    return float(np.max(comm.allgather(float(np.max(miss, initial=0.0)))))


@contextmanager
def _options(**values: str) -> Iterator[None]:
    """PETSc options under this module's prefix, removed from PETSc's global table on leaving."""
    table = PETSc.Options(PREFIX)
    for name, value in values.items():
        table.setValue(name, value)
    try:
        yield
    finally:
        for name in values:
            table.delValue(name)
