"""Elastic blocks with springs at the joint points, factored on one symbolic analysis.

    A = K + B_N^T diag(k_N) B_N + B_T^T diag(k_T) B_T + B_T^T diag(c) B_N + B_N^T diag(d) B_T

The coupling c of shear to opening occurs with Coulomb friction, d with dilatancy. Where they differ
A is unsymmetric; else it is symmetric positive definite. The sparsity of A does not depend on the
springs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import SolverError
from fenics_contact.parallel import PETSc
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.compiled import call
from fenics_contact.solvers.effort import Tally
from fenics_contact.solvers.problem import Array, Closing, Owner, SparseMap

Integers = npt.NDArray[np.int32]

#: MUMPS: no pivoting, no scaling, no permutation, the determinant, and so many right-hand sides at
#: once. A is nearly symmetric with springs of very different size on its diagonal: off-diagonal
#: pivots would cancel digits that plain elimination keeps, and plain elimination needs no scaling.
PLAIN = {"icntl_6": 0, "cntl_1": 0.0, "icntl_8": 0, "icntl_33": 1, "icntl_27": 64}
#: Least pivot, in units of the mean diagonal of K. A smaller one is rounding next to a mechanism;
#: the work of the live load limits the mechanism.
SMALLEST_PIVOT = 1e-20
#: MUMPS' number of the minimum fill ordering.
MINIMUM_FILL = 2


@dataclass(frozen=True)
class JointRows:
    """Rows of B_N and B_T at this rank's joint points, in groups on the same displacements.

    Attributes:
        dofs: Global dofs of every group, -1: none, shape (groups, n).
        normal: Coefficients of B_N on those dofs, shape (groups, points of a group, n); zero where
            a group has fewer points than another.
        tangential: Coefficients of B_T, likewise.
        place: Place of every point among those of all groups in a row.
    """

    dofs: Integers
    normal: Array
    tangential: Array
    place: npt.NDArray[np.int64]

    @classmethod
    def single(cls, dofs: Integers, normal: Array, tangential: Array) -> JointRows:
        """Rows of points that have dofs of their own; arguments as those of `grouped`."""
        first = np.argsort(dofs < 0, axis=1, kind="stable")
        first = first[:, : int(np.sum(dofs >= 0, axis=1).max(initial=1))]  # columns in use
        dofs = np.take_along_axis(dofs, first, axis=1)
        normal = np.take_along_axis(normal, first, axis=1)
        tangential = np.take_along_axis(tangential, first, axis=1)
        return cls(dofs, normal[:, None], tangential[:, None], np.arange(len(normal)))

    @classmethod
    def grouped(cls, dofs: Integers, normal: Array, tangential: Array) -> JointRows:
        """Rows of points many of which share their dofs.

        Args:
            dofs: Global dofs of every point, -1: none, shape (points, n).
            normal: Coefficients of B_N on those dofs, shape (points, n).
            tangential: Coefficients of B_T, likewise.
        """
        shared, group, count = np.unique(dofs, axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(group.ravel(), kind="stable")
        # Groups of a middling size, so that one long joint does not make all others as large.
        most = int(np.ceil(count.mean())) if len(count) else 1
        parts = -(-count // most)
        within = np.arange(len(order)) - np.repeat(np.cumsum(count) - count, count)
        place = np.empty_like(order)
        place[order] = most * np.repeat(np.cumsum(parts) - parts, count) + within
        padded = np.zeros((2, most * int(parts.sum()), dofs.shape[1]))
        padded[:, place] = normal, tangential
        rows = padded.reshape(2, -1, most, dofs.shape[1])
        return cls(np.repeat(shared, parts, axis=0), rows[0], rows[1], place)

    @cached_property
    def indices(self) -> npt.NDArray[np.integer]:
        """The dofs as PETSc takes them."""
        return np.ascontiguousarray(self.dofs, dtype=PETSc.IntType)

    @cached_property
    def transposed(self) -> Array:
        """Coefficients of B_N^T and B_T^T, shape (groups, n, 2 points of a group)."""
        both = np.concatenate([self.normal, self.tangential], axis=1)
        return np.ascontiguousarray(np.swapaxes(both, 1, 2))

    def spread(self, values: Array) -> Array:
        """Values of points as factors of the groups' rows."""
        spread = np.zeros((*self.normal.shape[:2], 1))
        spread.flat[self.place] = values
        return spread


class _Entries:
    """Entries of A on one rank, where the springs are added without a search for their places.

    Attributes:
        matrix: A; it reads and writes these entries.
    """

    def __init__(self, elastic: PETSc.Mat, rows: Sequence[JointRows]) -> None:
        """Entries with the sparsity of K, which has places for all springs."""
        start, columns, self._elastic = elastic.getValuesCSR()
        self._values = self._elastic.copy()
        size = elastic.getSize()
        first = np.repeat(np.arange(size[0], dtype=np.int64) * size[1], np.diff(start))
        self._places = []  # of what springs add by sets of rows, -1: none
        for some in rows:
            row, column = some.dofs[:, :, None].astype(np.int64), some.dofs[:, None, :]
            place = np.searchsorted(first + columns, row * size[1] + column)
            self._places.append(np.where((row >= 0) & (column >= 0), place, -1))
        csr = start, columns, self._values
        self.matrix = PETSc.Mat().createAIJWithArrays(size, csr, comm=elastic.comm)
        self.matrix.setBlockSizes(*elastic.getBlockSizes())  # help MUMPS to order the unknowns

    def set(self, blocks: Sequence[Array]) -> None:
        """Add what springs add to K."""
        self._values[:] = self._elastic
        for place, added in zip(self._places, blocks, strict=True):
            call("add_at", place.size, place, added, self._values)


class JointStiffness(Closing):
    """A for any springs.

    Attributes:
        mean_diagonal: Mean diagonal of K, N/m, the unit in which springs are large or small.
        tally: Counts the factorisations.
    """

    def __init__(self, stiffness: SparseMap, rows: Sequence[JointRows], tally: Tally) -> None:
        """Lay out A; it is analysed with the first factor.

        Args:
            stiffness: K in the supports' coordinates.
            rows: Joint rows, one set of points after the other.
            tally: Counts the factorisations.
        """
        self.tally = tally
        self._rows = list(rows)
        diagonal = stiffness.diagonal()
        total, size = stiffness.comm.allreduce(np.array([diagonal.sum(), len(diagonal)]))
        self.mean_diagonal = float(total / size)
        self._owner = Owner()
        self._elastic = self._owner.own(self._with_spring_pattern(stiffness.matrix))
        alone = self._elastic.comm.size == 1
        self._entries = _Entries(self._elastic, self._rows) if alone else None
        made = self._entries.matrix if self._entries else self._elastic.duplicate()
        self._matrix = self._owner.own(made)
        self._vectors = [self._owner.own(vector) for vector in self._matrix.createVecs()]
        self._dense: dict[int, list[PETSc.Mat]] = {}
        self._made = 0
        self._solver = self._new_solver()
        self._owner.callback(lambda: self._solver.destroy())

    def factor(
        self,
        normal: Array,
        tangential: Array,
        coupling: Array | None = None,
        dilation: Array | None = None,
    ) -> Factor:
        """A^-1 for springs k_N, k_T, c and d; it replaces the last one.

        Springs are those of this rank's joint points, N/m.

        Raises:
            SolverError: If A is numerically singular, or no more factorisations are allowed.
        """
        self.tally.add()
        blocks = self._blocks(normal, tangential, coupling, dilation)
        if self._entries is not None:
            self._entries.set(blocks)
            self._matrix.stateIncrease()
        else:
            self._elastic.copy(self._matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            self._add(self._matrix, blocks)
        preconditioner = self._solver.getPC()
        preconditioner.setUp()  # KSP's own set-up would leave it to the next solve
        self._made += 1
        error = int(preconditioner.getFactorMatrix().getMumpsInfog(1))
        if error < 0:
            self._solver.destroy()  # MUMPS does not recover from a failure
            self._solver = self._new_solver()
            raise SolverError(f"MUMPS cannot factor the blocks with joint springs (error {error})")
        return Factor(self, self._made)

    def _new_solver(self) -> PETSc.KSP:
        solver = PETSc.KSP().create(self._matrix.comm)
        solver.setType(PETSc.KSP.Type.PREONLY)
        preconditioner = solver.getPC()
        preconditioner.setType(PETSc.PC.Type.LU)
        preconditioner.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        solver.setOperators(self._matrix)
        small = self._matrix.getSize()[0] <= SEARCH.large_system
        prefix = "fenics_contact_small_" if small else "fenics_contact_large_"
        solver.setOptionsPrefix(prefix)
        pivot = np.nan_to_num(SMALLEST_PIVOT * self.mean_diagonal)  # PETSc 3.22 checks
        values = {**PLAIN, "cntl_4": float(pivot)}
        if small:
            values["icntl_7"] = MINIMUM_FILL
        table = PETSc.Options(prefix)  # PETSc overwrites orderings set in other ways
        for name, value in values.items():
            table[f"mat_mumps_{name}"] = value
        return solver

    def _blocks(
        self, normal: Array, tangential: Array, coupling: Array | None, dilation: Array | None
    ) -> list[Array]:
        """What springs add to A by sets of rows and groups, on the dofs of each group."""
        made = []
        first = 0
        for rows in self._rows:
            here = slice(first, first + len(rows.place))
            first = here.stop
            shear = rows.spread(tangential[here]) * rows.tangential
            if coupling is not None:
                shear += rows.spread(coupling[here]) * rows.normal
            pressing = rows.spread(normal[here]) * rows.normal
            if dilation is not None:
                pressing += rows.spread(dilation[here]) * rows.tangential
            made.append(np.matmul(rows.transposed, np.concatenate([pressing, shear], axis=1)))
        return made

    def _add(self, matrix: PETSc.Mat, blocks: Sequence[Array]) -> None:
        """Add what springs add."""
        for rows, added in zip(self._rows, blocks, strict=True):
            if len(added):  # petsc4py divides by the number of blocks
                mode = PETSc.InsertMode.ADD_VALUES
                matrix.setValuesRCV(rows.indices, rows.indices, added, addv=mode)
        matrix.assemble()

    def _with_spring_pattern(self, stiffness: PETSc.Mat) -> PETSc.Mat:
        """K, with zeros stored where springs add."""
        # A node, or a block, is joined to a handful of others; those of ties are few.
        most = 6 * self._rows[0].dofs.shape[1]
        springs = PETSc.Mat().createAIJ(stiffness.getSizes(), nnz=(most, most), comm=stiffness.comm)
        springs.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        zero = np.zeros(sum(len(rows.place) for rows in self._rows))
        self._add(springs, self._blocks(zero, zero, None, None))
        padded = stiffness.copy()
        padded.axpy(1.0, springs, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        springs.destroy()
        return padded

    def _new_dense(self, count: int) -> PETSc.Mat:
        """Dense matrix with rows as those of A and so many columns, all on rank 0."""
        comm = self._elastic.comm
        rows = self._elastic.getSizes()[0]
        sizes = rows, (count if comm.rank == 0 else 0, count)
        matrix = PETSc.Mat().createDense(sizes, comm=comm)
        matrix.setUp()
        matrix.assemble()
        return matrix


class Factor:
    """A^-1 for one set of springs, until the next one is made."""

    def __init__(self, stiffness: JointStiffness, number: int) -> None:
        self._stiffness = stiffness
        self._number = number

    @property
    def current(self) -> bool:
        """Whether no other factor was made since."""
        return self._number == self._stiffness._made

    def _factor_matrix(self) -> Any:
        if not self.current:
            raise SolverError("a factor is used after another one was made")
        return self._stiffness._solver.getPC().getFactorMatrix()

    @property
    def determinant_sign(self) -> float:
        """Sign of det A."""
        return float(np.sign(self._factor_matrix().getMumpsRinfog(12)))

    def solve(self, right: Array) -> Array:
        """A^-1 b, this rank's part."""
        matrix = self._factor_matrix()
        x, b = self._stiffness._vectors
        b.array[:] = right
        matrix.solve(b, x)
        return x.array_r.copy()

    def solve_all(self, rights: Sequence[Array]) -> list[Array]:
        """A^-1 b for several b at once, which reads the factor only once."""
        if len(rights) == 1:
            return [self.solve(rights[0])]
        matrix = self._factor_matrix()
        made = self._stiffness
        count = len(rights)
        if count not in made._dense:
            made._dense[count] = [made._owner.own(made._new_dense(count)) for _ in "bx"]
        right, solution = made._dense[count]
        for column, values in enumerate(rights):
            right.getDenseArray()[:, column] = values
        matrix.matSolve(right, solution)
        return list(solution.getDenseArray().T.copy())

    def solve_sparse(self, columns: Sequence[tuple[npt.NDArray[np.integer], Array]]) -> PETSc.Mat:
        """A^-1 B for columns of B with few entries: a dense matrix, which the caller frees.

        All its columns are on rank 0, its rows are those of A.

        Args:
            columns: Rows and values of the entries of every column, the same on all ranks.
        """
        matrix = self._factor_matrix()
        comm = self._stiffness._elastic.comm
        # MUMPS wants sparse right-hand sides as rows, all on the first rank.
        mine = columns if comm.rank == 0 else columns[:0]
        start = np.cumsum([0, *(len(values) for _, values in mine)]).astype(PETSc.IntType)
        places = np.concatenate([np.empty(0), *(rows for rows, _ in mine)]).astype(PETSc.IntType)
        values = np.concatenate([np.empty(0), *(values for _, values in mine)])
        size = self._stiffness._elastic.getSize()[0]
        sizes = (len(mine), len(columns)), (size if comm.rank == 0 else 0, size)
        transposed = PETSc.Mat().createAIJ(sizes, csr=(start, places, values), comm=comm)
        rights = PETSc.Mat().createTranspose(transposed)
        solutions = self._stiffness._new_dense(len(columns))
        matrix.matSolve(rights, solutions)
        rights.destroy()
        transposed.destroy()
        return solutions
