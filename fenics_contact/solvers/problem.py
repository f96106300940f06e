"""The discrete contact problem that the solvers see: PETSc objects and joint arrays, no mesh.

K u = f_D + lambda f_L + B_N^T r_N + B_T^T r_T,
0 <= r_N _|_ B_N u >= 0,    |r_T| <= g,    slip against r_T where |r_T| = g.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc


Array = npt.NDArray[np.float64]


class SparseMap:
    """A distributed sparse matrix that maps arrays: `A @ x` and `A.T @ y`.

    Attributes:
        matrix: The PETSc matrix, owned by this object.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Take over a matrix.

        Args:
            matrix: Assembled; freed by `close`.
        """
        self.matrix = matrix
        self._right, self._left = matrix.createVecs()

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the matrix."""
        return self.matrix.comm.tompi4py()

    def __matmul__(self, x: Array) -> Array:
        """A x, this rank's rows."""
        self._right.array[:] = x
        self.matrix.mult(self._right, self._left)
        return self._left.array_r.copy()

    @property
    def T(self) -> _Transposed:  # noqa: N802
        """The transposed map."""
        return _Transposed(self)

    def transposed_product(self, y: Array) -> Array:
        """A^T y, this rank's part."""
        self._left.array[:] = y
        self.matrix.multTranspose(self._left, self._right)
        return self._right.array_r.copy()

    def diagonal(self) -> Array:
        """Diagonal of a square map, this rank's part."""
        self.matrix.getDiagonal(self._left)
        return self._left.array_r.copy()

    def close(self) -> None:
        """Free the matrix, on all ranks together."""
        for item in (self._right, self._left, self.matrix):
            item.destroy()


@dataclass(frozen=True)
class _Transposed:
    """A^T of a map A."""

    of: SparseMap

    def __matmul__(self, y: Array) -> Array:
        """A^T y."""
        return self.of.transposed_product(y)


@dataclass(frozen=True)
class State:
    """Displacements and joint forces.

    Attributes:
        displacement: u in the supports' coordinates, m, shape (this rank's displacements,).
        elastic: Its part that strains the blocks, summed up for itself: beside a large motion u
            has too few digits of it.
        load_factor: lambda.
        pressure: r_N at this rank's points, N per metre of thickness.
        shear: r_T, likewise.
        work: T = f_L.u, N m per metre of thickness.
    """

    displacement: Array
    elastic: Array
    load_factor: float
    pressure: Array
    shear: Array
    work: float


@dataclass(frozen=True)
class ContactProblem:
    """Stiffness, loads and joint operators on one parallel layout.

    Attributes:
        stiffness: K, N/m per metre of thickness.
        dead: f_D, N per metre of thickness.
        live: f_L, likewise.
        normal: B_N, shape (points, dofs).
        tangential: B_T, likewise.
        friction: Coulomb's coefficient at this rank's points; 0 where the law is another.
        strength: Given bound on the shear force at this rank's points, N/m (Tresca).
        slip_origin: B_T u from which slip is measured, m; zero: the stress-free state.
        rigid: R, rigid motions of blocks without supports as orthonormal columns: K R = 0.
        give: Compliance of the joint points themselves, normal and tangential, that K lacks, so
            that openings and slips are B u + give r, m per N/m, shape (2, points); zero by default.
    """

    stiffness: PETSc.Mat
    dead: PETSc.Vec
    live: PETSc.Vec
    normal: PETSc.Mat
    tangential: PETSc.Mat
    friction: npt.NDArray[np.float64]
    strength: npt.NDArray[np.float64]
    rigid: PETSc.Mat
    slip_origin: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    give: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, 0)))

    def __post_init__(self) -> None:
        if len(self.slip_origin) != len(self.friction):
            object.__setattr__(self, "slip_origin", np.zeros(len(self.friction)))
        if self.give.shape[1] != len(self.friction):
            object.__setattr__(self, "give", np.zeros((2, len(self.friction))))

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of all objects."""
        return self.stiffness.comm.tompi4py()

    def sum(self, values: npt.NDArray[np.float64]) -> float:
        """Sum of an array of this rank's points over all ranks."""
        return float(self.comm.allreduce(float(np.sum(values))))

    def max(self, values: npt.NDArray[np.float64], initial: float = 0.0) -> float:
        """Maximum of this rank's values and `initial` over all ranks; nan where any is nan."""
        # MPI.MAX may drop a nan that one rank holds.
        return float(np.max(self.comm.allgather(float(np.max(values, initial=initial)))))

    def bound(self, pressure: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Bound g on the shear forces for given normal forces: F r_N, or the given strength."""
        return self.friction * pressure + self.strength

    def measure_slip_from(self, u: PETSc.Vec) -> None:
        """Measure slip from displacements u from now on."""
        slip = self.tangential.createVecLeft()
        self.tangential.mult(u, slip)
        self.slip_origin[:] = slip.array_r
        slip.destroy()

    def joint_displacements(
        self, u: PETSc.Vec
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Opening B_N u and B_T u at this rank's points, m."""
        values = []
        for matrix in (self.normal, self.tangential):
            joint = matrix.createVecLeft()
            matrix.mult(u, joint)
            values.append(joint.array.copy())
            joint.destroy()
        return values[0], values[1]

    def add_joint_forces(
        self,
        vector: PETSc.Vec,
        pressure: npt.NDArray[np.float64],
        shear: npt.NDArray[np.float64],
    ) -> None:
        """Add B_N^T r_N + B_T^T r_T of forces at this rank's points, N/m."""
        for matrix, force in ((self.normal, pressure), (self.tangential, shear)):
            joint = matrix.createVecLeft()
            joint.array[:] = force
            matrix.multTransposeAdd(joint, vector, vector)
            joint.destroy()

    def strained(self, u: PETSc.Vec) -> PETSc.Vec:
        """The part of u that strains the blocks, (I - R R^T) u.

        Twice, as the first time leaves motions of the size of rounding in the sums over blocks.
        """
        rest, motion = u.copy(), self.rigid.createVecRight()
        for _ in range(2):
            self.rigid.multTranspose(rest, motion)
            motion.scale(-1.0)
            self.rigid.multAdd(motion, rest, rest)
        motion.destroy()
        return rest

    def replace_strained(self, u: PETSc.Vec, strained: PETSc.Vec) -> None:
        """Replace the part of u that strains the blocks by one with more digits."""
        lost = self.strained(u)
        u.axpy(-1.0, lost)
        u.axpy(1.0, strained)
        lost.destroy()
