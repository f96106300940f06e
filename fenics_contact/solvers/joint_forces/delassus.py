"""Delassus operator: elastic blocks as their joints see them, with joint forces as unknowns.

Nothing but contact holds a block that stands on others, so that its displacements are held near
those of the step before, u', by a small stiffness rho:

    K_rho u = f_D + lambda f_L + B^T r + rho u',    K_rho = K + rho I,    r = (r_N, r_T).

With u eliminated, opening and slip are B u = A_rr r + A_rl lambda - b_r and the work of the live
load is f_L.u = A_lr r + A_ll lambda + ..., together A x - b with x = (r_N, r_T, lambda) and

    A = S K_rho^-1 S^T,   S = (B, f_L),   b = (0, w_0, T) - S u_0,   u_0 = K_rho^-1 (f_D + rho u'),

symmetric positive semi-definite; w_0 is the origin of slip. The joint laws are bounds on x, so that
the states under work control, f_L.u = T, are the solutions of a bound-constrained quadratic program
(`bound_qp`); at the solution u = u' the small stiffness has no part. Where several blocks meet
forces are not unique; a small multiple of A's diagonal D holds them near those of the step before,
x': A + D in place of A, b + D x' in place of b.

A block of A couples joint points of one body only: A is sparse, and all bodies are solved for at
once, one joint point of each at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.solvers.joint_forces.bound_qp import BoundQP
from fenics_contact.solvers.problem import (
    Array,
    Closing,
    ContactProblem,
    Owner,
    SparseMap,
    sparse_rows,
)

Integers = npt.NDArray[np.integer]
Entries = Iterator[tuple[Integers, Integers, Array]]


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

    def __init__(
        self, problem: ContactProblem, points: JointPoints, rho: float, force_hold: float = 0.0
    ) -> None:
        """Factor K_rho, rho in N/m per metre, and compute A; `force_hold` is D by A's diagonal."""
        self.points = problem.points
        self._problem = problem
        self._rho = rho
        self._last = problem.comm.rank == problem.comm.size - 1
        self._programs: dict[tuple[int, ...], tuple[Integers, BoundQP]] = {}
        with Owner() as owner:
            self._solver = _factored(problem.stiffness.matrix, rho, owner)
            self._vectors = [owner.own(v) for v in problem.stiffness.matrix.createVecs()]
            self.matrix = SparseMap(self._assembled(points, force_hold))
            owner.callback(self.matrix.close)
            self.hold = force_hold / (1.0 + force_hold) * self.matrix.diagonal()
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
                self._programs[kinds] = rows, self._owner.enter_context(BoundQP(block))
        return self._programs[kinds]

    def _response(self, forces: Array) -> Array:
        """K_rho^-1 f, this rank's part."""
        right, solution = self._vectors
        right.array[:] = forces
        self._solver.solve(right, solution)
        return solution.array_r.copy()

    def _assembled(self, points: JointPoints, force_hold: float) -> PETSc.Mat:
        """A + D from the entries of A."""
        from scipy.sparse import coo_matrix

        comm = self._problem.comm
        size = 2 * self.points + self._last
        sizes = comm.allgather(size)
        start = sum(sizes[: comm.rank])
        total = sum(sizes)
        entries = [*self._flexibility(points, start), *self._border(start, total)]
        rows, columns, values = (np.concatenate(part) for part in zip(*entries, strict=True))
        values = np.where(rows == columns, 1.0 + force_hold, 1.0) * values
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


def _factored(stiffness: PETSc.Mat, rho: float, owner: Owner) -> PETSc.KSP:
    """Solver with K + rho I."""
    with Owner() as local:
        matrix = local.own(stiffness.copy())
        matrix.shift(rho)
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        solver = owner.own(PETSc.KSP().create(matrix.comm))
        solver.setType(PETSc.KSP.Type.PREONLY)
        solver.getPC().setType(PETSc.PC.Type.CHOLESKY)
        solver.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        solver.setOperators(matrix)
        solver.getPC().setUp()
        return solver


def _one_side(points: JointPoints, side: int, stiffness: PETSc.Mat) -> PETSc.Mat:
    """The part of (B_N, B_T) that belongs to one side of the joints."""
    half = points.dofs.shape[1] // 2
    columns = slice(half * side, half * (side + 1))
    dofs = np.tile(points.dofs[:, columns], (2, 1))
    rows = np.concatenate([points.normal[:, columns], points.tangential[:, columns]])
    return sparse_rows(stiffness, dofs, rows)
