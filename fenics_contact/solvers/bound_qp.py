"""Bound-constrained quadratic programs by PETSc's TAO and SNES.

    min 1/2 x.A x - b.x   subject to   lower <= x <= upper,      A symmetric positive semi-definite.

The back ends see the program in units in which the diagonal of A is one and the largest entry of b
is one, so that no tolerance depends on units. Whatever they report, the residual

    max |min(x - lower, max(x - upper, A x - b))|

is recomputed here in these units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.errors import SolverError

Array = npt.NDArray[np.float64]

TAO_SOLVERS = ("tron", "bnls", "bntr", "bqnls", "blmvm", "bqpip", "gpcg")
SNES_SOLVERS = ("vinewtonrsls", "vinewtonssls")
SOLVERS = (*TAO_SOLVERS, *SNES_SOLVERS)

#: Options of the solvers are set under this prefix, and removed again.
PREFIX = "fenics_contact_qp_"

#: Bounds as large as this are none, for PETSc too.
UNBOUNDED = 1e20


@dataclass(frozen=True)
class BoundQPOptions:
    """How to solve.

    Attributes:
        solver: One of `SOLVERS`.
        tolerance: On the residual.
        max_iterations: Of the back end.
    """

    solver: str = "vinewtonrsls"
    tolerance: float = 1e-10
    max_iterations: int = 400


@dataclass(frozen=True)
class BoundSolution:
    """An answer.

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


class BoundQP:
    """The programs of one operator, with any b and bounds."""

    def __init__(self, operator: PETSc.Mat) -> None:
        """Scale the operator.

        Args:
            operator: A; assembled, or one that multiplies and knows its diagonal.

        Raises:
            SolverError: If its diagonal is not positive.
        """
        diagonal = operator.getDiagonal()
        if not diagonal.min()[1] > 0.0:
            raise SolverError("bound QP: the operator's diagonal is not positive")
        diagonal.sqrtabs()
        diagonal.reciprocal()
        self._unit = diagonal
        self.assembled = "aij" in operator.getType()
        if self.assembled:
            self._operator = operator.copy()
            self._operator.diagonalScale(diagonal, diagonal)
        else:
            self._operator = PETSc.Mat().createPython(
                operator.getSizes(), _Scaled(operator, diagonal), comm=operator.comm
            )
            self._operator.setUp()

    def solve(
        self,
        right: Array,
        lower: Array,
        upper: Array,
        start: Array | None = None,
        options: BoundQPOptions | None = None,
    ) -> BoundSolution:
        """Minimise 1/2 x.A x - b.x subject to lower <= x <= upper.

        Args: as those of `attempt`.

        Returns:
            The solution, with the residual recomputed here.

        Raises:
            SolverError: If that residual is above the tolerance, whatever PETSc reported, or if no
                back end has the name.
        """
        options = options or BoundQPOptions()
        answer = self.attempt(right, lower, upper, start, options)
        if not answer.residual <= options.tolerance:
            raise SolverError(
                f"bound QP: {options.solver} stopped for reason {answer.reason} after"
                f" {answer.iterations} iterations at a residual of {answer.residual:.1e}, asked"
                f" {options.tolerance:.1e}"
            )
        return answer

    def attempt(
        self,
        right: Array,
        lower: Array,
        upper: Array,
        start: Array | None = None,
        options: BoundQPOptions | None = None,
    ) -> BoundSolution:
        """What a back end makes of the program, good or bad.

        Args:
            right: b, this rank's part like all arrays here.
            lower: Lower bounds; -inf where there is none.
            upper: Upper bounds; inf where there is none.
            start: First x, moved into the bounds; zero when not given.
            options: Back end and tolerance.

        Returns:
            Its answer, with the residual recomputed here.

        Raises:
            SolverError: If no back end has the name.
        """
        options = options or BoundQPOptions()
        if options.solver not in SOLVERS:
            raise SolverError(
                f"bound QP: unknown solver '{options.solver}'; known: {', '.join(SOLVERS)}"
            )
        unit = self._unit.array_r
        b = self._vector(right * unit)
        size = b.norm(PETSc.NormType.INFINITY) or 1.0
        b.scale(1.0 / size)
        scale = unit * size  # x = scale * scaled x
        lower, upper = lower / scale, upper / scale
        low = self._vector(np.clip(lower, -UNBOUNDED, UNBOUNDED))
        high = self._vector(np.clip(upper, -UNBOUNDED, UNBOUNDED))
        x = self._vector(np.zeros_like(unit) if start is None else start / scale)
        x.pointwiseMax(x, low)
        x.pointwiseMin(x, high)
        run = _tao if options.solver in TAO_SOLVERS else _snes
        try:
            iterations, reason = run(self._operator, b, (low, high), x, options, self.assembled)
        except PETSc.Error as error:  # a singular matrix, for instance
            iterations, reason = 0, -error.ierr
        gradient = b.duplicate()
        self._operator.mult(x, gradient)
        # With the infinite bounds: what PETSc calls no bound is no place to come to rest.
        above = np.maximum(x.array_r - upper, gradient.array_r - b.array_r)
        gradient.array[:] = np.minimum(x.array_r - lower, above)
        residual = gradient.norm(PETSc.NormType.INFINITY)
        answer = x.array_r * scale
        for vector in (b, low, high, x, gradient):
            vector.destroy()
        return BoundSolution(answer, residual, iterations, reason)

    def destroy(self) -> None:
        """Free the scaled operator."""
        self._operator.destroy()
        self._unit.destroy()

    def _vector(self, values: Array) -> PETSc.Vec:
        vector = self._unit.duplicate()
        vector.array[:] = values
        return vector


class _Scaled:
    """A in scaled units, for an operator that only multiplies."""

    def __init__(self, operator: PETSc.Mat, unit: PETSc.Vec) -> None:
        self._operator, self._unit = operator, unit
        self._work = unit.duplicate()

    def mult(self, _matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Y = D A D x."""
        self._work.pointwiseMult(self._unit, x)
        self._operator.mult(self._work, y)
        y.pointwiseMult(self._unit, y)

    def getDiagonal(self, _matrix: PETSc.Mat, y: PETSc.Vec) -> None:
        """One."""
        y.set(1.0)


Bounds = tuple[PETSc.Vec, PETSc.Vec]


def _tao(
    operator: PETSc.Mat,
    right: PETSc.Vec,
    bounds: Bounds,
    x: PETSc.Vec,
    options: BoundQPOptions,
    assembled: bool,
) -> tuple[int, int]:
    """Iterations and reason of a TAO solver; x becomes its answer."""

    def objective_gradient(_tao: PETSc.TAO, at: PETSc.Vec, gradient: PETSc.Vec) -> float:
        operator.mult(at, gradient)
        value = 0.5 * at.dot(gradient) - at.dot(right)
        gradient.axpy(-1.0, right)
        return value

    tao = PETSc.TAO().create(operator.comm)
    tao.setOptionsPrefix(PREFIX)
    tao.setType(options.solver)
    tao.setObjectiveGradient(objective_gradient, None)
    hessian = _given(operator, assembled)
    tao.setHessian(_renewed(operator, assembled), hessian, hessian)
    tao.setVariableBounds(bounds)
    tao.setMaximumIterations(options.max_iterations)
    tao.setTolerances(gatol=0.1 * options.tolerance, grtol=0.0, gttol=0.0)
    tao.setSolution(x)
    # The Newton type methods ("bn...") solve with their free variables directly where they can:
    # conjugate gradients lose the digits of nearly dependent joint points.
    linear = (
        {"tao_bnk_pc_type": "lu", "tao_bnk_pc_factor_mat_solver_type": "mumps"}
        if assembled
        else {"tao_subset_type": "matrixfree", "tao_bnk_pc_type": "none", "pc_type": "none"}
    )
    linear |= {"tao_bnk_ksp_rtol": "1e-12", "ksp_rtol": "1e-12"}
    with _Options(tao.setFromOptions, **linear):
        tao.solve()
    result = tao.getIterationNumber(), tao.getConvergedReason()
    tao.destroy()
    return result


def _snes(
    operator: PETSc.Mat,
    right: PETSc.Vec,
    bounds: Bounds,
    x: PETSc.Vec,
    options: BoundQPOptions,
    assembled: bool,
) -> tuple[int, int]:
    """Iterations and reason of a SNES solver; x becomes its answer."""

    def function(_snes: PETSc.SNES, at: PETSc.Vec, value: PETSc.Vec) -> None:
        operator.mult(at, value)
        value.axpy(-1.0, right)

    snes = PETSc.SNES().create(operator.comm)
    snes.setOptionsPrefix(PREFIX)
    snes.setType(options.solver)
    value = right.duplicate()
    snes.setFunction(function, value)
    jacobian = _given(operator, assembled)
    snes.setJacobian(_renewed(operator, assembled), jacobian, jacobian)
    snes.setVariableBounds(*bounds)
    snes.setTolerances(
        rtol=0.0, atol=0.1 * options.tolerance, stol=0.0, max_it=options.max_iterations
    )
    # The Newton step is often not one of descent at full length: of PETSc's line searches only
    # "bt" stops the active set from cycling.
    linear = (
        {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
        if assembled
        else {"ksp_type": "cg", "pc_type": "none", "ksp_rtol": "1e-12"}
    )
    with _Options(snes.setFromOptions, snes_linesearch_type="bt", **linear):
        snes.solve(None, x)
    result = snes.getIterationNumber(), snes.getConvergedReason()
    snes.destroy()
    value.destroy()
    return result


def _given(operator: PETSc.Mat, assembled: bool) -> PETSc.Mat:
    """The matrix that a back end may write into: some scale it, or shift its diagonal."""
    return operator.copy() if assembled else operator


def _renewed(operator: PETSc.Mat, assembled: bool) -> Callable[..., None]:
    """The callback that makes it the operator again, for each step."""

    def renew(_solver: object, _at: PETSc.Vec, given: PETSc.Mat, _preconditioner: object) -> None:
        if assembled:
            operator.copy(given, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)

    return renew


class _Options:
    """PETSc options under this module's prefix, removed from PETSc's global table on leaving."""

    def __init__(self, read: Callable[[], None], **values: str) -> None:
        self._table = PETSc.Options(PREFIX)
        self._read = read
        self._values = values

    def __enter__(self) -> None:
        for name, value in self._values.items():
            self._table.setValue(name, value)
        self._read()

    def __exit__(self, *_: object) -> None:
        for name in self._values:
            self._table.delValue(name)
