"""Elastic blocks with springs at the joint points, factored on one symbolic analysis.

    A = K + B_N^T diag(k_N) B_N + B_T^T diag(k_T) B_T + B_T^T diag(c) B_N

The coupling c of shear to opening occurs with Coulomb friction and makes A unsymmetric; without it
A is symmetric positive definite. Its sparsity does not depend on the springs: it is laid out, and
analysed for either kind, once per scene.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.errors import SolverError
from fenics_contact.discretization.joints import JointOperators

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int32]

#: Options of MUMPS for A with coupling. It is nearly symmetric with springs of very different size
#: on the diagonal: searching off-diagonal pivots cancels digits that plain elimination keeps, and
#: that needs no scaling. The determinant is asked for.
PLAIN_ELIMINATION = {"icntl_6": 0, "cntl_1": 0.0, "icntl_8": 0, "icntl_33": 1}

#: MUMPS' error where a pivot is zero. Without a zero spring that is rounding, next to a mechanism
#: with large springs. From then on a pivot has at least this size, in units of the mean diagonal of
#: K: it only tells how far the mechanism would go, and the work of the live load does that.
SINGULAR, SMALLEST_PIVOT = -10, 1e-20

#: Ordering by approximate minimum fill, for up to so many unknowns: the automatic choice, PORD,
#: takes several times as long and saves nothing there.
MINIMUM_FILL, FILL_UNKNOWNS = 2, 100_000


@dataclass(frozen=True)
class JointRows:
    """Rows of B_N and B_T at this rank's joint points, those on the same displacements together.

    Attributes:
        dofs: Global dofs of every group, -1: none, shape (groups, n).
        normal: Coefficients of B_N on those dofs, shape (groups, points of a group, n); zero where
            a group has fewer points than another.
        tangential: Coefficients of B_T, likewise.
        place: Place of every point among those of all groups in a row.
    """

    dofs: npt.NDArray[np.int32]
    normal: Array
    tangential: Array
    place: npt.NDArray[np.int64]

    @classmethod
    def of(cls, joints: JointOperators) -> JointRows:
        """Every joint point for itself."""
        normal, tangential = joints.normal_rows, joints.tangential_rows
        return cls(joints.dofs, normal[:, None], tangential[:, None], np.arange(len(normal)))

    @classmethod
    def grouped(cls, dofs: npt.NDArray[np.int32], normal: Array, tangential: Array) -> JointRows:
        """Group points that have the same dofs.

        Args:
            dofs: Global dofs of every point, -1: none, shape (points, n).
            normal: Coefficients of B_N on those dofs, shape (points, n).
            tangential: Coefficients of B_T, likewise.
        """
        _, first, group, count = np.unique(
            dofs, axis=0, return_index=True, return_inverse=True, return_counts=True
        )
        order = np.argsort(group.ravel(), kind="stable")
        # Groups of a middling size, so that one long joint does not make all others as large.
        most = int(np.ceil(count.mean())) if len(count) else 1
        parts = -(-count // most)
        within = np.arange(len(order)) - np.repeat(np.cumsum(count) - count, count)
        place = np.empty_like(order)
        place[order] = most * np.repeat(np.cumsum(parts) - parts, count) + within
        rows = []
        for values in (normal, tangential):
            padded = np.zeros((most * int(parts.sum()), values.shape[1]))
            padded[place] = values
            rows.append(padded.reshape(-1, most, values.shape[1]))
        return cls(np.repeat(dofs[first], parts, axis=0), rows[0], rows[1], place)

    def spread(self, values: Array) -> Array:
        """Values of points as factors of the groups' rows."""
        groups, points, _ = self.normal.shape
        spread = np.zeros(groups * points)
        spread[self.place] = values
        return spread.reshape(groups, points, 1)


class SpringStiffness:
    """A with its factor.

    Attributes:
        mean_diagonal: Mean diagonal of K, N/m, the unit in which springs are large or small.
        factorizations: Number of numeric factorisations so far.
        seconds: Time spent in them, s.
    """

    def __init__(self, stiffness: PETSc.Mat, rows: JointRows) -> None:
        """Lay out A.

        Args:
            stiffness: K in the supports' coordinates.
            rows: Joint rows.
        """
        self._dofs = np.ascontiguousarray(rows.dofs, dtype=PETSc.IntType)
        self._rows = rows
        both = np.concatenate([rows.normal, rows.tangential], axis=1)
        self._transposed = np.ascontiguousarray(np.swapaxes(both, 1, 2))
        self._elastic = self._with_spring_pattern(stiffness)
        self._factors: dict[str, tuple[PETSc.Mat, PETSc.KSP]] = {}
        self._together: dict[int, tuple[PETSc.Mat, ...]] = {}
        self._current = ""
        self._smallest_pivot = 0.0
        self._symmetric_before = False
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
            coupling: c, likewise; when not given A is symmetric and factored as such, but for a
                single one after others with coupling, which does with their analysis.

        Raises:
            SolverError: If A is numerically singular.
        """
        start = time.perf_counter()
        coupled_before = PETSc.PC.Type.LU in self._factors
        symmetric = coupling is None and (self._symmetric_before or not coupled_before)
        self._symmetric_before = coupling is None
        self._current = PETSc.PC.Type.CHOLESKY if symmetric else PETSc.PC.Type.LU
        if not symmetric and not coupled_before and PETSc.PC.Type.CHOLESKY in self._factors:
            self._drop(PETSc.PC.Type.CHOLESKY)  # its series is over, and two take much memory
        error = self._factored(normal, tangential, coupling)
        if error == SINGULAR and not symmetric and not self._smallest_pivot:
            softest = min(np.min(springs, initial=np.inf) for springs in (normal, tangential))
            if self._elastic.comm.tompi4py().allreduce(softest, MPI.MIN) > 0.0:
                self._smallest_pivot = SMALLEST_PIVOT * self.mean_diagonal
                error = self._factored(normal, tangential, coupling)
        self.factorizations += 1
        self.seconds += time.perf_counter() - start
        if error < 0:
            raise SolverError(f"MUMPS cannot factor the blocks with joint springs (error {error})")

    def _factored(self, normal: Array, tangential: Array, coupling: Array | None) -> int:
        """Factor A; MUMPS' error, below zero where it failed."""
        if self._current not in self._factors:
            self._factors[self._current] = self._new_factor(self._current)
        matrix, solver = self._factors[self._current]
        self._elastic.copy(matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._add(matrix, normal, tangential, coupling)
        matrix.setOption(PETSc.Mat.Option.SPD, self._current == PETSc.PC.Type.CHOLESKY)
        preconditioner = solver.getPC()
        preconditioner.setUp()  # KSP's own set-up would leave it to the next solve
        error = int(preconditioner.getFactorMatrix().getMumpsInfog(1))
        if error < 0:
            self._drop(self._current)
        return error

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

    def solve_transposed(self, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """Solve A^T x = b with the last factor."""
        self._factors[self._current][1].solveTranspose(right, solution)

    def solve_together(self, rights: Sequence[PETSc.Vec], solutions: Sequence[PETSc.Vec]) -> None:
        """Solve A x = b for several b at once, which reads the factor only once."""
        count = len(rights)
        if count not in self._together:
            (rows, _), comm = self._elastic.getSizes(), self._elastic.comm
            columns = (count if comm.rank == 0 else 0, count)
            pair = tuple(PETSc.Mat().createDense((rows, columns), comm=comm) for _ in "bx")
            for matrix in pair:
                matrix.setUp()
                matrix.assemble()
            self._together[count] = pair
        right, solution = self._together[count]
        for column, vector in enumerate(rights):
            right.getDenseArray()[:, column] = vector.array_r
        self._factors[self._current][1].getPC().getFactorMatrix().matSolve(right, solution)
        for column, vector in enumerate(solutions):
            vector.array[:] = solution.getDenseArray()[:, column]

    def solve_columns(self, columns: Sequence[tuple[Integers, Array]]) -> PETSc.Mat:
        """Solve A X = B for columns of B with few entries, with the last factor.

        Args:
            columns: Rows and values of the entries of every column, the same on all ranks.

        Returns:
            X, a dense matrix with all columns on rank 0 and rows as those of A.
        """
        (rows, size), comm = self._elastic.getSizes()[0], self._elastic.comm
        first = comm.rank == 0
        count, start = len(columns), np.cumsum([0, *(len(values) for _, values in columns)])
        # MUMPS wants sparse right-hand sides as rows, all on the first rank.
        places, values = (np.concatenate(part) for part in zip(*columns, strict=True))
        csr = (start.astype(PETSc.IntType), places.astype(PETSc.IntType), values)
        if not first:
            csr = (np.zeros(1, dtype=PETSc.IntType), csr[1][:0], csr[2][:0])
        sizes = (count if first else 0, count), (size if first else 0, size)
        transposed = PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)
        rights = PETSc.Mat().createTranspose(transposed)
        solutions = PETSc.Mat().createDense(((rows, size), sizes[0]), comm=comm)
        solutions.setUp()
        solutions.assemble()
        self._factors[self._current][1].getPC().getFactorMatrix().matSolve(rights, solutions)
        rights.destroy()
        transposed.destroy()
        return solutions

    def forget(self) -> None:
        """Free the factors; the next one is analysed afresh."""
        for kind in list(self._factors):
            self._drop(kind)

    def destroy(self) -> None:
        """Free the matrices and factors, which PETSc would otherwise keep for long."""
        self.forget()
        for matrices in self._together.values():
            for matrix in matrices:
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
            small = matrix.getSize()[0] <= FILL_UNKNOWNS
            prefix = "fenics_contact_small_" if small else "fenics_contact_large_"
            solver.setOptionsPrefix(prefix)
            options = PETSc.Options(prefix)  # PETSc overwrites orderings set in other ways
            for name, value in PLAIN_ELIMINATION.items():
                options[f"mat_mumps_{name}"] = value
            options["mat_mumps_cntl_4"] = self._smallest_pivot or -1.0  # below zero: none
            if small:
                options["mat_mumps_icntl_7"] = MINIMUM_FILL
        return matrix, solver

    def _add(
        self, matrix: PETSc.Mat, normal: Array, tangential: Array, coupling: Array | None = None
    ) -> None:
        rows = self._rows
        shear = rows.spread(tangential) * rows.tangential
        if coupling is not None:
            shear += rows.spread(coupling) * rows.normal
        forces = np.concatenate([rows.spread(normal) * rows.normal, shear], axis=1)
        blocks = np.matmul(self._transposed, forces)
        if len(blocks):  # petsc4py divides by the number of blocks
            matrix.setValuesRCV(self._dofs, self._dofs, blocks, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()

    def _with_spring_pattern(self, stiffness: PETSc.Mat) -> PETSc.Mat:
        springs = PETSc.Mat().create(stiffness.comm)
        springs.setSizes(stiffness.getSizes())
        springs.setType(PETSc.Mat.Type.AIJ)
        # A node, or a block, is joined to a handful of others.
        most = 6 * self._dofs.shape[1]
        springs.setPreallocationNNZ((most, most))
        springs.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        zero = np.zeros(len(self._rows.place))
        self._add(springs, zero, zero)
        padded = stiffness.copy()
        padded.axpy(1.0, springs, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        springs.destroy()
        return padded
