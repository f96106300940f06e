"""The discrete contact problem, as all solvers see it: sparse maps and arrays, no mesh.

    K u = f_D + lambda f_L + B_N^T r_N + B_T^T r_T,

with the law of the joint points (`joint_law`) between B_N u, B_T u and r_N, r_T.

Arrays hold this rank's part of a distributed vector: displacements where the rank owns the node,
joint values where it owns the joint point. PETSc objects stay inside `SparseMap`.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self, TypeVar

import numpy as np
import numpy.typing as npt

from fenics_contact.parallel import MPI, PETSc
from fenics_contact.solvers.compiled import call
from fenics_contact.solvers.joint_law import PointLaws

Array = npt.NDArray[np.float64]
_Item = TypeVar("_Item", bound="PETSc.Object")
_Value = TypeVar("_Value")


class Owner(ExitStack):
    """Frees PETSc objects, on all ranks in the same order, on leaving."""

    def own(self, item: _Item) -> _Item:
        """Take over an object."""
        self.callback(item.destroy)
        return item


class Closing:
    """Closes its owner of PETSc objects on leaving a `with`."""

    _owner: Owner

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the objects, on all ranks together."""
        self._owner.close()


class SparseMap:
    """A distributed sparse matrix that maps arrays: `A @ x` and `A.T @ y`.

    Attributes:
        matrix: The assembled PETSc matrix, owned by this object and freed by `close`.
        comm: Its ranks.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        self.matrix = matrix
        self.comm: MPI.Comm = matrix.comm.tompi4py()
        self._right, self._left = matrix.createVecs()

    @property
    def first_row(self) -> int:
        """Global number of this rank's first row."""
        return int(self.matrix.getOwnershipRange()[0])

    def __matmul__(self, x: Array) -> Array:
        """A x, this rank's rows."""
        self._right.array[:] = x
        self.matrix.mult(self._right, self._left)
        return self._left.array_r.copy()

    @property
    def T(self) -> _Transposed:
        """The transposed map."""
        return _Transposed(self.matrix, self._left, self._right)

    def diagonal(self) -> Array:
        """Diagonal of a square map, this rank's part."""
        self.matrix.getDiagonal(self._left)
        return self._left.array_r.copy()

    def times(self, columns: PETSc.Mat, unit: float, found: Array) -> None:
        """Unit times A X for a dense matrix X: each column becomes a row of `found`."""
        if self.comm.size > 1:
            product = self.matrix.matMult(columns)
            found[:] = unit * product.getDenseArray().T
            product.destroy()
            return
        x = columns.getDenseArray()
        call("motions", len(found.T), *self._csr, *x.shape, x.T, unit, found)

    @cached_property
    def _csr(self) -> tuple[Array, ...]:
        """Starts of the rows, columns and values, as C takes them."""
        start, columns, values = self.matrix.getValuesCSR()
        return start.astype(np.int64), columns.astype(np.int64), values

    def close(self) -> None:
        """Free the matrix, on all ranks together."""
        for item in (self._right, self._left, self.matrix):
            item.destroy()


@dataclass(frozen=True)
class _Transposed:
    """A^T of a map A, with its vectors."""

    matrix: PETSc.Mat
    left: PETSc.Vec
    right: PETSc.Vec

    def __matmul__(self, y: Array) -> Array:
        """A^T y, this rank's part."""
        self.left.array[:] = y
        self.matrix.multTranspose(self.left, self.right)
        return self.right.array_r.copy()


def sparse_rows(stiffness: PETSc.Mat, dofs: npt.NDArray[np.integer], rows: Array) -> PETSc.Mat:
    """A matrix with the stiffness's columns from coefficients of global dofs, -1: none."""
    kept = dofs >= 0
    indptr = np.concatenate([[0], np.cumsum(kept.sum(axis=1))]).astype(PETSc.IntType)
    csr = indptr, dofs[kept].astype(PETSc.IntType), rows[kept]
    sizes = (len(rows), PETSc.DETERMINE), stiffness.getSizes()[1]
    matrix = PETSc.Mat().createAIJ(sizes, csr=csr, comm=stiffness.comm)
    matrix.assemble()
    return matrix


@dataclass(frozen=True)
class Scales:
    """Typical sizes, so that no tolerance depends on units.

    Attributes:
        displacement: Largest displacements expected, m.
        force: Nodal joint force, N per metre of thickness.
        load_factor: Typical load factor.
        elastic: Displacement that strains the blocks, m.
    """

    displacement: float
    force: float
    load_factor: float
    elastic: float

    @property
    def elastic_part(self) -> float:
        """Part of the displacements that strains the blocks, at most 1."""
        return min(self.elastic / self.displacement, 1.0)


@dataclass(frozen=True)
class State:
    """Displacements and joint forces.

    Attributes:
        displacement: u in the supports' coordinates, m, shape (this rank's displacements,).
        elastic: Its part that strains the blocks, summed up for itself: beside a large motion u
            has too few digits of it.
        load_factor: lambda.
        pressure: r_N at this rank's points, N per metre of thickness, with the bond (`joint_law`).
        shear: r_T, likewise.
        work: T = f_L.u, N m per metre of thickness.
    """

    displacement: Array
    elastic: Array
    load_factor: float
    pressure: Array
    shear: Array
    work: float

    @property
    def forces(self) -> tuple[Array, Array]:
        """Normal and shear forces r_N and r_T."""
        return self.pressure, self.shear


@dataclass(frozen=True)
class ContactProblem:
    """Stiffness, loads and joint operators on one parallel layout.

    Attributes:
        stiffness: K, N/m per metre of thickness.
        dead: f_D, N per metre of thickness, this rank's part.
        live: f_L, likewise.
        normal: B_N, shape (points, displacements).
        tangential: B_T, likewise.
        law: Law of this rank's points.
        rigid: R, rigid motions of blocks without supports as orthonormal columns: K R = 0.
        compliance: Compliance of the joint points themselves that K lacks, normal and tangential,
            m per N/m, shape (2, points): openings and slips are B u + compliance r. Ties have one.
    """

    stiffness: SparseMap
    dead: Array
    live: Array
    normal: SparseMap
    tangential: SparseMap
    law: PointLaws
    rigid: SparseMap
    compliance: Array

    def with_law(self, **constants: Array) -> ContactProblem:
        """The problem with other constants of the law, by their names."""
        return replace(self, law=replace(self.law, **constants))

    @property
    def points(self) -> int:
        """Number of this rank's joint points."""
        return len(self.law.friction)

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of all maps."""
        return self.stiffness.comm

    @property
    def size(self) -> int:
        """Number of displacements on all ranks."""
        return int(self.stiffness.matrix.getSize()[0])

    @property
    def coulomb(self) -> bool:
        """Whether friction takes up power by the pressure at some point of some rank.

        Else the states are those of a convex problem.
        """
        return self.max(self.law.dissipative) > 0.0

    def gather(self, value: _Value) -> list[_Value]:
        """Values of all ranks, on all ranks. One rank alone packs nothing to send."""
        return [value] if self.comm.size == 1 else self.comm.allgather(value)

    def whole(self, values: Array) -> Array:
        """Arrays of all ranks, on all ranks, one after the other along the last axis."""
        if self.comm.size == 1:
            return values
        return np.concatenate(self.comm.allgather(values), axis=-1)

    def sum(self, values: Array) -> float:
        """Sum of this rank's values over all ranks."""
        total = float(np.sum(values))
        return total if self.comm.size == 1 else float(self.comm.allreduce(total))

    def dot(self, a: Array, b: Array) -> float:
        """Scalar product of two distributed arrays."""
        total = float(a @ b)
        return total if self.comm.size == 1 else float(self.comm.allreduce(total))

    def max(self, values: Array, initial: float = 0.0) -> float:
        """Maximum of this rank's values and `initial` over all ranks; nan where any is nan."""
        # MPI.MAX may drop a nan that one rank holds.
        return float(np.max(self.gather(float(np.max(values, initial=initial)))))

    def openings(self, u: Array) -> Array:
        """Openings of this rank's points, m."""
        return self.normal @ u - self.law.opening_origin + self.law.apart

    def slips(self, u: Array) -> Array:
        """Slips of this rank's points, m."""
        return self.tangential @ u - self.law.slip_origin

    def joint_motion(self, u: Array, pressure: Array, shear: Array) -> tuple[Array, Array]:
        """Openings and slips of this rank's points, with those of the points' own compliance."""
        c_n, c_t = self.compliance
        return self.openings(u) + c_n * pressure, self.slips(u) + c_t * shear

    def motion_of(self, state: State) -> tuple[Array, Array]:
        """Openings and slips of a state at this rank's points, m."""
        return self.joint_motion(state.displacement, state.pressure, state.shear)

    def clearance_rates(self, mode: Array) -> Array:
        """Rates of the clearances of this rank's points in a motion."""
        return self.law.clearance(self.normal @ mode, self.tangential @ mode)

    def joint_forces(self, pressure: Array, shear: Array) -> Array:
        """B_N^T r_N + B_T^T r_T, N per metre of thickness."""
        return self.normal.T @ pressure + self.tangential.T @ shear

    def elastic_part(self, u: Array) -> Array:
        """The part of u that strains the blocks, (I - R R^T) u.

        Projected twice: once leaves motions of the size of rounding in the sums over blocks.
        """
        once = u - self.rigid @ (self.rigid.T @ u)
        return once - self.rigid @ (self.rigid.T @ once)

    def state(self, u: Array, load_factor: float, pressure: Array, shear: Array) -> State:
        """A state from its displacements and forces."""
        work = self.dot(self.live, u)
        return State(u, self.elastic_part(u), load_factor, pressure, shear, work)
