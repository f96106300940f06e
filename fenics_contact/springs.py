"""Elastic blocks with springs at the joint points, factored on one symbolic analysis.

    A = K + B_N^T diag(k_N) B_N + B_T^T diag(k_T) B_T + B_T^T diag(c) B_N

The coupling c of shear to opening occurs with Coulomb friction and makes A unsymmetric; without it
A is symmetric positive definite. Its sparsity does not depend on the springs: it is laid out, and
analysed for either kind, once per scene.
"""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.errors import SolverError
from fenics_contact.joints import JointOperators

Array = npt.NDArray[np.float64]


class SpringStiffness:
    """A with its factor.

    Attributes:
        mean_diagonal: Mean diagonal of K, N/m, the unit in which springs are large or small.
        factorizations: Number of numeric factorisations so far.
        seconds: Time spent in them, s.
    """

    def __init__(self, stiffness: PETSc.Mat, joints: JointOperators) -> None:
        """Lay out A.

        Args:
            stiffness: K in the supports' coordinates.
            joints: Joint rows.
        """
        self._dofs = np.ascontiguousarray(joints.dofs, dtype=PETSc.IntType)
        normal, tangential = joints.normal_rows, joints.tangential_rows
        self._normal = normal[:, :, None] * normal[:, None, :]
        self._tangential = tangential[:, :, None] * tangential[:, None, :]
        self._coupling = tangential[:, :, None] * normal[:, None, :]
        self._elastic = self._with_spring_pattern(stiffness)
        self._factors: dict[str, tuple[PETSc.Mat, PETSc.KSP]] = {}
        self._pair: tuple[PETSc.Mat, ...] = ()
        self._current = ""
        diagonal = stiffness.getDiagonal()
        self.mean_diagonal = diagonal.sum() / diagonal.getSize()
        diagonal.destroy()
        self.factorizations = 0
        self.seconds = 0.0

    def factor(self, normal: Array, tangential: Array, coupling: Array | None = None) -> None:
        """Set the springs and factor A.

        Args:
            normal: k_N of this rank's joint points, N/m.
            tangential: k_T, likewise.
            coupling: c, likewise; when not given A is symmetric and factored as such.

        Raises:
            SolverError: If A is numerically singular.
        """
        start = time.perf_counter()
        self._current = PETSc.PC.Type.CHOLESKY if coupling is None else PETSc.PC.Type.LU
        if self._current not in self._factors:
            self._factors[self._current] = self._new_factor(self._current)
        matrix, solver = self._factors[self._current]
        self._elastic.copy(matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._add(matrix, normal, tangential, coupling)
        matrix.setOption(PETSc.Mat.Option.SPD, coupling is None)
        preconditioner = solver.getPC()
        preconditioner.setUp()  # KSP's own set-up would leave it to the next solve
        self.factorizations += 1
        self.seconds += time.perf_counter() - start
        error = preconditioner.getFactorMatrix().getMumpsInfog(1)
        if error < 0:
            self._drop(self._current)
            raise SolverError(f"MUMPS cannot factor the blocks with joint springs (error {error})")

    @property
    def determinant_sign(self) -> float:
        """Sign of the determinant of the last A with coupling; without, A is positive definite."""
        if self._current != PETSc.PC.Type.LU:
            return 1.0
        factor = self._factors[self._current][1].getPC().getFactorMatrix()
        return float(np.sign(factor.getMumpsRinfog(12)))

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """Solve A x = b with the last factor."""
        self._factors[self._current][1].solve(right, solution)

    def solve_pair(
        self, rights: tuple[PETSc.Vec, PETSc.Vec], solutions: tuple[PETSc.Vec, PETSc.Vec]
    ) -> None:
        """Solve A x = b for two b at once, which reads the factor only once."""
        if not self._pair:
            (rows, _), comm = self._elastic.getSizes(), self._elastic.comm
            columns = (2 if comm.rank == 0 else 0, 2)
            self._pair = tuple(PETSc.Mat().createDense((rows, columns), comm=comm) for _ in "bx")
            for matrix in self._pair:
                matrix.setUp()
                matrix.assemble()
        right, solution = self._pair
        for column, vector in enumerate(rights):
            right.getDenseArray()[:, column] = vector.array_r
        self._factors[self._current][1].getPC().getFactorMatrix().matSolve(right, solution)
        for column, vector in enumerate(solutions):
            vector.array[:] = solution.getDenseArray()[:, column]

    def destroy(self) -> None:
        """Free the matrices and factors, which PETSc would otherwise keep for long."""
        for kind in list(self._factors):
            self._drop(kind)
        for matrix in self._pair:
            matrix.destroy()
        self._elastic.destroy()

    def _drop(self, kind: str) -> None:
        """Forget a factor; MUMPS does not recover from a failure."""
        matrix, solver = self._factors.pop(kind)
        solver.destroy()
        matrix.destroy()

    def _new_factor(self, kind: str) -> tuple[PETSc.Mat, PETSc.KSP]:
        matrix = self._elastic.duplicate()
        solver = PETSc.KSP().create(matrix.comm)
        solver.setType(PETSc.KSP.Type.PREONLY)
        preconditioner = solver.getPC()
        preconditioner.setType(kind)
        preconditioner.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        solver.setOperators(matrix)
        if kind == PETSc.PC.Type.LU:
            # A is nearly symmetric with springs of very different size on the diagonal: searching
            # off-diagonal pivots cancels digits that plain elimination keeps.
            preconditioner.setFactorSetUpSolverType()
            factor = preconditioner.getFactorMatrix()
            factor.setMumpsIcntl(6, 0)
            factor.setMumpsCntl(1, 0.0)
            factor.setMumpsIcntl(33, 1)  # the determinant
        return matrix, solver

    def _add(
        self, matrix: PETSc.Mat, normal: Array, tangential: Array, coupling: Array | None = None
    ) -> None:
        blocks = self._normal * normal[:, None, None] + self._tangential * tangential[:, None, None]
        if coupling is not None:
            blocks += self._coupling * coupling[:, None, None]
        if len(blocks):  # petsc4py divides by the number of blocks
            matrix.setValuesRCV(self._dofs, self._dofs, blocks, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()

    def _with_spring_pattern(self, stiffness: PETSc.Mat) -> PETSc.Mat:
        springs = PETSc.Mat().create(stiffness.comm)
        springs.setSizes(stiffness.getSizes())
        springs.setType(PETSc.Mat.Type.AIJ)
        # A node has at most a handful of joint points, each with four displacements.
        springs.setPreallocationNNZ((24, 24))
        springs.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        zero = np.zeros(len(self._dofs))
        self._add(springs, zero, zero)
        padded = stiffness.copy()
        padded.axpy(1.0, springs, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        springs.destroy()
        return padded
