"""Bound-constrained quadratic programs by PETSc's TAO and SNES.

    min 1/2 x.A x - b.x   subject to   lower <= x <= upper,      A symmetric positive semi-definite.

They are solved in units in which the diagonal of A is one and the largest entry of b is one, so
that no tolerance depends on units, until the residual

    max |min(x - lower, max(x - upper, A x - b))|

is small, or no further: the states that they lead to are judged by their own residuals.

PETSc options choose another solver: `tao_type`, for instance `tron` or `bnls`, or `snes_type`,
`vinewtonrsls` or `vinewtonssls`, and what these know themselves. Each program reads them under its
own prefix, as in `-normal_tao_type tron`, and under `fenics_contact_qp_`, which is that of all.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np

from fenics_contact.errors import InputError, SolverError
from fenics_contact.parallel import MPI, PETSc
from fenics_contact.solvers.problem import Array, Closing, Owner, SparseMap

#: Prefix of options for all programs; those under a program's own come first.
ALL = "fenics_contact_qp_"

#: Iterations at most, and bounds that are none to PETSc.
MAX_ITERATIONS = 400
UNBOUNDED = 1e20


class BoundQP(Closing):
    """The programs of one operator, with any b and bounds; frees its objects in a `with`."""

    def __init__(self, operator: PETSc.Mat, prefix: str = ALL) -> None:
        """Scale the operator A, which is assembled and stays the caller's.

        Args:
            operator: A.
            prefix: Of the PETSc options that these programs read.

        Raises:
            SolverError: If its diagonal is not positive.
        """
        self._prefix = prefix
        self._asked: dict[str, str] = {}
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
            # Solvers write into theirs: some scale it, or shift its diagonal.
            self._given = owner.own(scaled.copy())
            self._vectors = [owner.own(scaled.createVecLeft()) for _ in range(5)]
            self._owner = owner.pop_all()
        # PETSc's own factorisation is the faster for small matrices on one rank.
        parallel = {"pc_factor_mat_solver_type": "mumps"} if operator.comm.size > 1 else {}
        self._factor = {"pc_type": "lu", **parallel}

    def solve(
        self, right: Array, lower: Array, upper: Array, start: Array, tolerance: float
    ) -> Array:
        """Minimiser x of 1/2 x.A x - b.x subject to lower <= x <= upper.

        Args:
            right: b, this rank's part like all arrays here.
            lower: Lower bounds; -inf where there is none.
            upper: Upper bounds; inf where there is none.
            start: First x, moved into the bounds.
            tolerance: On the residual.
        """
        b, low, high, x, _ = self._vectors
        b.array[:] = right * self._unit
        size = float(b.norm(PETSc.NormType.INFINITY)) or 1.0
        b.scale(1.0 / size)
        scale = self._unit * size
        low.array[:] = np.clip(lower / scale, -UNBOUNDED, UNBOUNDED)
        high.array[:] = np.clip(upper / scale, -UNBOUNDED, UNBOUNDED)
        x.array[:] = np.clip(start / scale, low.array_r, high.array_r)
        self._asked = _given(ALL) | _given(self._prefix)
        for name in _given(ALL):  # read here, in the name of solvers with other prefixes
            PETSc.Options(ALL).hasName(name)
        with Owner() as owner, _defaults(self._prefix, **self._asked):
            by = self._by_snes if "snes_type" in self._asked else self._by_tao
            by(owner, 0.1 * tolerance)
        return x.array_r * scale

    def _by_snes(self, owner: Owner, tolerance: float) -> None:
        """Solve with a variational inequality solver of SNES, from x, which becomes the answer.

        The Newton step is often not one of descent at full length: of PETSc's line searches only
        "bt" stops the active set from cycling.
        """
        _, low, high, x, value = self._vectors
        linear = {"ksp_type": "preonly", **self._factor}
        with _defaults(self._prefix, snes_linesearch_type="bt", **linear):
            snes = owner.own(PETSc.SNES().create(self._given.comm))
            snes.setOptionsPrefix(self._prefix)
            snes.setFunction(self._gradient, value)
            snes.setJacobian(self._renew, self._given, self._given)
            snes.setVariableBounds(low, high)
            snes.setTolerances(0.0, tolerance, 0.0, MAX_ITERATIONS)
            self._configure(snes)
            with suppress(PETSc.Error):  # a singular matrix, for instance
                snes.solve(None, x)

    def _by_tao(self, owner: Owner, tolerance: float) -> None:
        """Solve with TAO, from x, which becomes the answer.

        Its Newton types ("bn...") solve with their free variables directly: conjugate gradients
        lose the digits of nearly dependent joint points.
        """
        b, low, high, x, _ = self._vectors
        linear = {f"tao_bnk_{name}": text for name, text in self._factor.items()}
        exact = {"tao_bnk_ksp_rtol": "1e-12", "ksp_rtol": "1e-12"}
        with _defaults(self._prefix, **exact, **linear):
            faces = _Faces(self._operator, b.array_r, self._factor, self._prefix)
            tao = owner.own(PETSc.TAO().createPython(faces, self._given.comm))
            tao.setOptionsPrefix(self._prefix)
            tao.setObjective(self._objective)
            tao.setGradient(self._gradient, None)
            tao.setHessian(self._renew, self._given, self._given)
            tao.setVariableBounds((low, high))
            tao.setMaximumIterations(MAX_ITERATIONS)
            tao.setTolerances(gatol=tolerance, grtol=0.0, gttol=0.0)
            tao.setSolution(x)
            self._configure(tao)
            with suppress(PETSc.Error):
                tao.solve()

    def _configure(self, solver: PETSc.TAO | PETSc.SNES) -> None:
        """Take the user's options; `InputError` where PETSc does not know what they name."""
        try:
            solver.setFromOptions()
        except PETSc.Error as error:
            names = ", ".join(f"-{self._prefix}{name} {text}" for name, text in self._asked.items())
            raise InputError(f"PETSc does not take all of these options: {names}") from error

    def _objective(self, _solver: PETSc.TAO, at: PETSc.Vec) -> float:
        """1/2 x.A x - b.x."""
        x = at.array_r
        b = self._vectors[0].array_r
        return _total(self._operator, x, 0.5 * (self._operator @ x) - b)

    def _gradient(self, _solver: object, at: PETSc.Vec, gradient: PETSc.Vec) -> None:
        """A x - b."""
        self._operator.matrix.mult(at, gradient)
        gradient.axpy(-1.0, self._vectors[0])

    def _renew(self, _solver: object, _at: PETSc.Vec, given: PETSc.Mat, _pre: PETSc.Mat) -> None:
        """Make the matrix of the solver A again, for each step."""
        self._operator.matrix.copy(given, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)


class _Faces:
    """Minimisation face by face, as a type of TAO solver.

    A projected gradient step chooses a face of the box. Newton steps with projected searches, which
    may add bounds, find the minimum on it. Only then the next gradient step releases bounds
    (J.J. More, G. Toraldo, SIAM J. Optim. 1 (1991) 93; here with a direct solver). Types that may
    release bounds after every Newton step take many times as many where A is badly conditioned.
    """

    def __init__(
        self, operator: SparseMap, right: Array, factor: dict[str, str], prefix: str
    ) -> None:
        self._prefix = prefix
        self._operator = operator
        self._right = right
        self._factor = factor

    def solve(self, tao: PETSc.TAO) -> None:
        """Minimise from TAO's solution, which becomes the answer."""
        operator = self._operator
        low, high = self._box = tuple(bound.array_r for bound in tao.getVariableBounds())
        x = tao.getSolution().array_r.copy()
        steps = 0
        most = tao.getMaximumIterations()
        reason = PETSc.TAO.Reason.DIVERGED_MAXITS
        while steps < most:
            gradient = operator @ x - self._right
            miss = np.abs(np.minimum(x - low, np.maximum(x - high, gradient)))
            # MPI.MAX may drop a nan that one rank holds.
            misses = operator.comm.allgather(float(np.max(miss, initial=0.0)))
            if not np.max(misses) > tao.getTolerances()[0]:
                reason = PETSc.TAO.Reason.CONVERGED_GATOL
                break
            free = ((x > low) | (gradient < 0.0)) & ((x < high) | (gradient > 0.0))
            down = np.where(free, -gradient, 0.0)
            length = _total(operator, down, down) / _total(operator, down, operator @ down)
            x, _ = self._projected_search(x, gradient, length * down)
            added = True
            while added and steps < most:
                gradient = operator @ x - self._right
                x, added = self._projected_search(x, gradient, self._newton_step(x, gradient))
                steps += 1
        tao.getSolution().array[:] = x
        tao.setIterationNumber(steps)
        tao.setConvergedReason(reason)

    def _projected_search(self, x: Array, gradient: Array, step: Array) -> tuple[Array, bool]:
        """New x along a projected step, and whether it meets bounds that x does not.

        The step is shortened until it brings a hundredth of the first-order descent.
        """
        low, high = self._box
        part = 1.0
        while True:
            new = np.clip(x + part * step, low, high)
            change = new - x
            slope = _total(self._operator, gradient, change)
            descent = slope + 0.5 * _total(self._operator, change, self._operator @ change)
            if not descent > 1e-2 * slope or part < 1e-14:
                break
            part *= 0.7
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
            solver.setOptionsPrefix(self._prefix)
            solver.setOperators(block)
            with _defaults(self._prefix, ksp_type="preonly", **self._factor):
                solver.setFromOptions()
            solver.solve(right, solution)
            if solver.getConvergedReason() > 0:  # or else there is no minimum
                step[inside] = solution.array_r
        return step


def _total(operator: SparseMap, a: Array, b: Array) -> float:
    """Scalar product of two arrays distributed like the operator's rows."""
    return float(operator.comm.allreduce(float(a @ b)))


def _given(prefix: str) -> dict[str, str]:
    """PETSc options that the user gives under a prefix, without it."""
    return dict(PETSc.Options(prefix).getAll())


@contextmanager
def _defaults(prefix: str, **values: str) -> Iterator[None]:
    """PETSc options under a prefix where the user gives none, removed again on leaving.

    Those that the user gives are not asked for here: `-options_left` tells which no solver read.
    """
    table = PETSc.Options(prefix)
    given = _given(prefix)
    new = {name: value for name, value in values.items() if name not in given}
    for name, value in new.items():
        table.setValue(name, value)
    try:
        yield
    finally:
        for name in new:
            table.delValue(name)
