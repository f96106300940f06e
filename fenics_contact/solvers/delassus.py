"""Elastic blocks as their joints see them, for solvers whose unknowns are the joint forces.

Nothing but contact holds a block that stands on others, so that its displacements are held near
those of the step before, u', by a small stiffness rho:

    K_rho u = f_D + lambda f_L + B^T r + rho u',    K_rho = K + rho I,    r = (r_N, r_T).

With u eliminated, opening and slip are B u = A_rr r + A_rl lambda - b_r and the work of the live
load is f_L.u = A_lr r + A_ll lambda + ..., together A x - b with x = (r_N, r_T, lambda) and

    A = S K_rho^-1 S^T,   S = (B, f_L),   b = (0, w_0, T) - S u_0,   u_0 = K_rho^-1 (f_D + rho u'),

symmetric positive semi-definite; w_0 is the origin of slip. The joint laws are bounds on x, so that
the states under work control, f_L.u = T, are the solutions of a bound-constrained quadratic program
(`bound_qp`); at the solution u = u' the small stiffness has no part. A block of A couples joint
points of one body only: A is sparse, and all bodies are solved for at once, one joint point of each
at a time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.discretization.joints import GROUND, JointOperators, sparse_rows
from fenics_contact.solvers.problem import ContactProblem

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Slots:
    """The joint points of every body, in a row; the same on all ranks.

    Attributes:
        body: Bodies of both sides of every joint point, -1 for ground, shape (points, 2).
        slot: Places of the joint point among those of either body, shape (points, 2).
        table: Joint point in every place of every body, -1: none, shape (bodies, places).
    """

    body: npt.NDArray[np.int64]
    slot: npt.NDArray[np.int64]
    table: npt.NDArray[np.int64]

    @classmethod
    def of(cls, body: npt.NDArray[np.int32]) -> Slots:
        """Slots from the bodies of both sides of all joint points."""
        flat = np.asarray(body, dtype=np.int64).ravel()
        order = np.argsort(flat, kind="stable")
        owner = flat[order]
        place = np.arange(len(flat)) - np.searchsorted(owner, owner)
        slot = np.empty_like(flat)
        slot[order] = place
        held = owner != GROUND
        count = int(owner.max(initial=-1)) + 1, int(place[held].max(initial=-1)) + 1
        table = np.full(count, -1)
        table[owner[held], place[held]] = order[held] // 2
        slot[flat == GROUND] = -1
        return cls(flat.reshape(-1, 2), slot.reshape(-1, 2), table)


class JointOperator:
    """A and what goes with it, for one rho.

    Attributes:
        matrix: A; every rank's rows are r_N of its points, r_T of its points, and on the last rank
            lambda.
        points: Number of this rank's joint points.
        factorizations: Of K_rho: one.
    """

    def __init__(self, problem: ContactProblem, joints: JointOperators, rho: float) -> None:
        """Factor K_rho and compute A.

        Args:
            problem: Stiffness, loads and joints.
            joints: The joint rows, with the bodies they belong to.
            rho: N/m per metre of thickness.
        """
        self.problem = problem
        self.rho = rho
        self.points = len(problem.friction)
        self._solver = _factored(problem.stiffness, rho)
        comm = problem.comm
        self.has_factor = comm.rank == comm.size - 1
        self._joint = problem.normal.createVecLeft(), problem.tangential.createVecLeft()
        self._work = problem.dead.duplicate()
        self._live_response = problem.dead.duplicate()
        self._solver.solve(problem.live, self._live_response)
        self.matrix = self._assemble(joints)
        self.factorizations = 1

    def right(self, near: PETSc.Vec, work: float) -> tuple[PETSc.Vec, PETSc.Vec]:
        """b, and the displacements u_0.

        Args:
            near: u'.
            work: T.
        """
        right, free = self.matrix.createVecLeft(), near.duplicate()
        near.copy(self._work)
        self._work.scale(self.rho)
        self._work.axpy(1.0, self.problem.dead)
        self._solver.solve(self._work, free)
        self._to_joints(free, right.array)
        right.array[:] *= -1.0
        right.array[self.points : 2 * self.points] += self.problem.slip_origin
        rest = work - self.problem.live.dot(free)
        if self.has_factor:
            right.array[-1] = rest
        return right, free

    def displacement(self, x: PETSc.Vec, free: PETSc.Vec) -> PETSc.Vec:
        """U of joint forces and load factor.

        Args:
            x: Joint forces and load factor.
            free: u_0.
        """
        pressure, shear, load_factor = self.split(x)
        self._work.zeroEntries()
        self._work.axpy(load_factor, self.problem.live)
        for matrix, joint, force in zip(
            (self.problem.normal, self.problem.tangential), self._joint, (pressure, shear),
            strict=True,
        ):  # fmt: skip
            joint.array[:] = force
            matrix.multTransposeAdd(joint, self._work, self._work)
        u = free.duplicate()
        self._solver.solve(self._work, u)
        u.axpy(1.0, free)
        return u

    def join(self, pressure: Array, shear: Array, load_factor: float) -> PETSc.Vec:
        """X of its parts."""
        x = self.matrix.createVecLeft()
        x.array = np.concatenate([pressure, shear, [load_factor] * self.has_factor])
        return x

    def split(self, x: PETSc.Vec) -> tuple[Array, Array, float]:
        """Normal and shear forces at this rank's points, and the load factor."""
        pressure, shear, rest = np.split(x.array_r.copy(), [self.points, 2 * self.points])
        factor = float(rest[0]) if self.has_factor else 0.0
        comm = self.problem.comm
        return pressure, shear, comm.bcast(factor, root=comm.size - 1)

    def block(self, normal: bool, tangential: bool, load_factor: bool = True) -> PETSc.IS:
        """Rows of some of the unknowns."""
        start, end = self.matrix.getOwnershipRange()
        parts = (normal, tangential)
        rows = [start + k * self.points + np.arange(self.points) for k in (0, 1) if parts[k]]
        if self.has_factor and load_factor:
            rows.append(np.array([end - 1]))
        indices = np.concatenate([*rows, []]).astype(PETSc.IntType)
        return PETSc.IS().createGeneral(indices, comm=self.matrix.comm)

    def destroy(self) -> None:
        """Free matrix and factor."""
        self._solver.destroy()
        self.matrix.destroy()
        for vector in (*self._joint, self._work, self._live_response):
            vector.destroy()

    def _to_joints(self, u: PETSc.Vec, values: Array) -> None:
        """Put B_N u and B_T u into the first entries of an array."""
        for k, matrix in enumerate((self.problem.normal, self.problem.tangential)):
            matrix.mult(u, self._joint[k])
            values[k * self.points : (k + 1) * self.points] = self._joint[k].array_r

    def _assemble(self, joints: JointOperators) -> PETSc.Mat:
        """A, one unit joint force per body and solve."""
        from scipy.sparse import coo_matrix

        comm, points = self.problem.comm, self.points
        size = 2 * points + self.has_factor
        start = sum(comm.allgather(size)[: comm.rank])
        # Row of r_N of every joint point; that of r_T is `shift` further.
        parts = comm.allgather((joints.points, joints.sides, start))
        row, shift = np.empty((2, sum(len(part[0]) for part in parts)), dtype=np.int64)
        bodies = np.empty((len(row), 2), dtype=np.int32)
        for rank_points, sides_of_points, first in parts:
            bodies[rank_points] = sides_of_points
            row[rank_points] = first + np.arange(len(rank_points))
            shift[rank_points] = len(rank_points)
        slots = Slots.of(bodies)
        sides = [_side(joints, side, self.problem.stiffness) for side in (0, 1)]
        response = self.problem.dead.duplicate()
        rows, columns, values = [], [], []
        body = slots.body[joints.points]
        unit = [side.createVecLeft() for side in sides]
        for slot in range(slots.table.shape[1]):
            mine = slots.slot[joints.points] == slot
            # The joint point in this slot of the body on either side of every row.
            other = np.where(body >= 0, slots.table[body, slot], -1)
            for direction in (0, 1):
                self._work.zeroEntries()
                for side, matrix in enumerate(sides):
                    unit[side].array[:] = 0.0
                    unit[side].array[direction * points :][:points] = mine[:, side]
                    matrix.multTransposeAdd(unit[side], self._work, self._work)
                self._solver.solve(self._work, response)
                for side, matrix in enumerate(sides):
                    matrix.mult(response, unit[side])
                    at = np.flatnonzero(other[:, side] >= 0)
                    column = row[other[at, side]] + direction * shift[other[at, side]]
                    for k in (0, 1):
                        rows.append(start + k * points + at)
                        columns.append(column)
                        values.append(unit[side].array_r[k * points + at])
        border = np.empty(2 * points)
        self._to_joints(self._live_response, border)
        flexibility = self.problem.live.dot(self._live_response)
        total = comm.allreduce(size)
        rows.append(start + np.arange(2 * points))
        columns.append(np.full(2 * points, total - 1))
        values.append(border)
        borders = comm.gather((start, border), root=comm.size - 1)
        for first, part in borders or ():
            rows.append(np.full(len(part), total - 1))
            columns.append(first + np.arange(len(part)))
            values.append(part)
        if self.has_factor:
            rows.append(np.array([total - 1]))
            columns.append(np.array([total - 1]))
            values.append(np.array([flexibility]))
        table = coo_matrix(
            (np.concatenate(values), (np.concatenate(rows) - start, np.concatenate(columns))),
            (size, total),
        ).tocsr()
        matrix = PETSc.Mat().createAIJ(
            ((size, PETSc.DETERMINE), (size, PETSc.DETERMINE)),
            csr=(
                table.indptr.astype(PETSc.IntType),
                table.indices.astype(PETSc.IntType),
                table.data,
            ),
            comm=self.problem.stiffness.comm,
        )
        matrix.assemble()
        for item in (*sides, *unit, response):
            item.destroy()
        return matrix


def _factored(stiffness: PETSc.Mat, rho: float) -> PETSc.KSP:
    matrix = stiffness.copy()
    matrix.shift(rho)
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    solver = PETSc.KSP().create(matrix.comm)
    solver.setType(PETSc.KSP.Type.PREONLY)
    solver.getPC().setType(PETSc.PC.Type.CHOLESKY)
    solver.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    solver.setOperators(matrix)
    solver.getPC().setUp()
    matrix.destroy()
    return solver


def _side(joints: JointOperators, side: int, stiffness: PETSc.Mat) -> PETSc.Mat:
    """The part of (B_N, B_T) that belongs to one side of the joints."""
    columns = slice(2 * side, 2 * side + 2)
    dofs = np.tile(joints.dofs[:, columns], (2, 1))
    rows = np.concatenate([joints.normal_rows[:, columns], joints.tangential_rows[:, columns]])
    return sparse_rows(stiffness, dofs, rows)
