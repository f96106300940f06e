"""A structure whose blocks only move, stretch and bend: where the search for a state begins.

Displacements u = P a, with the rigid motions, uniform strains and pure bendings of every block as
columns of P, turn the structure into one with eight unknowns per block and the same joint points,

    K_P = P^T K P,   f_P = P^T f,   B_P = B P.

What the blocks give next to a joint force is in none of these, and is added at the joint points.
Below a force on one node of a plane body it grows with the logarithm of the body's size over that
of an element (K.L. Johnson, Contact Mechanics (1985), section 2.2), in units of what the node would
give if all others were held, its entry of K:

    w = B P a + diag(B C B^T) r,    C_ii = c ln(nodes of the block / 3) / K_ii,

which is zero for a single triangle, whose modes are all that it has. The central path
(`central_path`) of this structure leads through the same folds at little cost: which joints open
and slide hangs on how blocks move, and how forces spread among the others on how they strain. Its
state, with the same joint forces and the displacements P a + C B^T r, is where the path of the
structure itself is taken up. As long as springs at the joints give way more than blocks do these
need not even strain, and three unknowns per block are enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.solvers.kkt import State
from fenics_contact.solvers.problem import ContactProblem
from fenics_contact.discretization.rigid_motions import numbered_by_rank
from fenics_contact.solvers.joint_stiffness import JointRows, SpringStiffness

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int32]

#: Motions of a block in the plane: three rigid ones, three strains, two bendings.
RIGID, MODES = 3, 8

#: c above: a fit to bricks of 6 to 561 nodes, linear triangles; within a third from 15 on.
LOCAL = 0.6

#: Combinations of a block's modes shorter than this, squared, are none: held, or on too few nodes.
DEPENDENT = 1e-10


@dataclass(frozen=True)
class BlockModes:
    """Modes of all blocks, and the structure that moves in these alone.

    Attributes:
        basis: P with orthonormal columns, equally many for every block, in the supports'
            coordinates; columns that are linear combinations of others are zero.
        full: The structure that it reduces.
        reduced: That of the modes; modes that are none have the mean diagonal of K_P.
        springs: K_P with joint springs.
        shapes: Displacements of this rank's nodes in every mode of their block, zero where held,
            shape (nodes, 2, modes).
        body: Block of every node of this rank, each rank's blocks numbered in a row.
        sides: Likewise those on both sides of this rank's joint points, -1: ground, shape
            (points, 2).
        local: C_ii, m per N/m; None: nothing gives.
    """

    basis: PETSc.Mat
    full: ContactProblem
    reduced: ContactProblem
    springs: SpringStiffness
    shapes: Array
    body: Integers
    sides: Integers
    local: PETSc.Vec | None

    @classmethod
    def build(
        cls,
        problem: ContactProblem,
        shapes: Array,
        body: Integers,
        blocks: int,
        sides: Integers,
        mean_diagonal: float = 0.0,
        gives: bool = True,
    ) -> BlockModes:
        """Reduce a structure.

        Args:
            problem: The structure.
            shapes: As the attribute; `modes` gives them.
            body: Block of every node of this rank, by any numbers.
            blocks: Number of blocks.
            sides: As the attribute, by the same numbers.
            mean_diagonal: To be taken for that of K_P, where that is zero but for rounding.
            gives: Whether joint points give.
        """
        number, mine = numbered_by_rank(problem.comm, body, blocks)
        body, sides = number[body], np.where(sides < 0, -1, number[sides])
        basis, is_mode = _orthonormal_columns(problem, shapes, body, blocks, mine)
        stiffness = problem.stiffness.ptap(basis)
        diagonal = stiffness.getDiagonal()
        stiffness.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)
        first, last = stiffness.getOwnershipRange()
        mean = mean_diagonal or diagonal.sum() / diagonal.getSize()
        for row in first + np.flatnonzero(~is_mode[first:last]):
            stiffness.setValue(row, row, mean)
        stiffness.assemble()
        diagonal.destroy()
        local = _local_compliance(problem, body, blocks) if gives else None
        reduced = ContactProblem(
            stiffness,
            _restricted(basis, problem.dead),
            _restricted(basis, problem.live),
            problem.normal.matMult(basis),
            problem.tangential.matMult(basis),
            problem.friction,
            problem.strength,
            basis.transposeMatMult(problem.rigid),
            problem.slip_origin,
            _give(problem, local),
        )
        springs = SpringStiffness(stiffness, _rows(reduced, sides, shapes.shape[2]))
        springs.mean_diagonal = mean_diagonal or springs.mean_diagonal
        return cls(basis, problem, reduced, springs, shapes, body, sides, local)

    @cached_property
    def rigid(self) -> BlockModes:
        """The same blocks, rigid; made when first asked for."""
        return self.build(
            self.full,
            self.shapes[:, :, :RIGID],
            self.body,
            self.count,
            self.sides,
            self.springs.mean_diagonal,
            gives=False,
        )

    @property
    def count(self) -> int:
        """Number of blocks."""
        return int(self.basis.getSize()[1]) // int(self.shapes.shape[2])

    @property
    def factorizations(self) -> int:
        """Numeric factorisations so far, those of rigid blocks among them."""
        rigid = self.rigid.factorizations if "rigid" in self.__dict__ else 0
        return self.springs.factorizations + rigid

    def of(self, problem: ContactProblem) -> ContactProblem:
        """The reduced structure with the live load of `problem`, which may be reversed."""
        if problem is self.full:
            return self.reduced
        live = _restricted(self.basis, problem.live)
        return replace(self.reduced, live=live, slip_origin=problem.slip_origin)

    def restricted(self, state: State) -> State:
        """A state in the modes: their part of the displacements, the same joint forces."""
        return replace(
            state, displacement=_restricted(self.basis, state.displacement), strained=None
        )

    def prolonged(self, state: State) -> State:
        """A state of the reduced structure as one of the structure itself."""
        displacement = self._prolonged(state.displacement)
        strained = None if state.strained is None else self._prolonged(state.strained)
        if self.local is not None:
            given = displacement.duplicate()
            self.full.add_joint_forces(given, state.pressure, state.shear)
            given.pointwiseMult(given, self.local)
            displacement.axpy(1.0, given)
            if strained is not None:
                strains = self.full.strained(given)
                strained.axpy(1.0, strains)
                strains.destroy()
            given.destroy()
        return replace(state, displacement=displacement, strained=strained)

    def _prolonged(self, amplitudes: PETSc.Vec) -> PETSc.Vec:
        """The displacements P a."""
        u = self.basis.createVecLeft()
        self.basis.mult(amplitudes, u)
        return u

    def destroy(self) -> None:
        """Free the PETSc objects, which would otherwise be kept for long."""
        if "rigid" in self.__dict__:
            self.rigid.destroy()
        self.springs.destroy()
        problem = self.reduced
        for item in (problem.stiffness, problem.normal, problem.tangential, problem.rigid):
            item.destroy()
        for vector in (problem.dead, problem.live, self.local):
            if vector is not None:
                vector.destroy()
        self.basis.destroy()


def modes(arm: Array) -> Array:
    """Displacements in every mode at points `arm` from a block's centre, shape (points, 2, 8).

    In pure bending with curvature 1, u = (xy, -x^2/2); contraction across is left out.
    """
    x, y = arm.T
    shapes = np.zeros((len(arm), 2, MODES))
    shapes[:, 0, 0] = shapes[:, 1, 1] = 1.0
    shapes[:, 0, 2], shapes[:, 1, 2] = -y, x
    shapes[:, 0, 3], shapes[:, 1, 4] = x, y
    shapes[:, 0, 5], shapes[:, 1, 5] = y, x
    shapes[:, 0, 6], shapes[:, 1, 6] = x * y, -0.5 * x**2
    shapes[:, 0, 7], shapes[:, 1, 7] = -0.5 * y**2, x * y
    return shapes


def _orthonormal_columns(
    problem: ContactProblem, shapes: Array, body: Integers, blocks: int, mine: range
) -> tuple[PETSc.Mat, npt.NDArray[np.bool_]]:
    """P, of which a block's columns span its modes, and which of all columns are not zero."""
    comm, motions = problem.comm, shapes.shape[2]
    gram = np.zeros((blocks, motions, motions))
    for k, m in combinations_with_replacement(range(motions), 2):
        products = np.sum(shapes[:, :, k] * shapes[:, :, m], axis=1)
        gram[:, k, m] = gram[:, m, k] = np.bincount(body, products, blocks)
    gram = comm.allreduce(gram)
    # Modes of unit length first: their sizes are powers of the block's.
    length = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
    scale = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
    size, direction = np.linalg.eigh(gram * scale[:, :, None] * scale[:, None, :])
    independent = size > DEPENDENT
    columns = scale[:, :, None] * direction / np.sqrt(np.where(independent, size, np.inf))[:, None]
    values = np.matmul(shapes, columns[body])
    sizes = problem.dead.getSizes(), (motions * len(mine), motions * blocks)
    indices = np.repeat(motions * body[:, None] + np.arange(motions), 2, axis=0)
    csr = [
        a.astype(PETSc.IntType) for a in (motions * np.arange(2 * len(body) + 1), indices.ravel())
    ]
    basis = PETSc.Mat().createAIJ(sizes, csr=(*csr, values.ravel()), comm=comm)
    return basis, independent.ravel()


def _local_compliance(problem: ContactProblem, body: Integers, blocks: int) -> PETSc.Vec:
    """C_ii of all displacements, m per N/m."""
    nodes = problem.comm.allreduce(np.bincount(body, minlength=blocks))
    local = problem.stiffness.getDiagonal()
    local.reciprocal()
    local.array[:] *= np.repeat(LOCAL * np.log(np.maximum(nodes / 3.0, 1.0))[body], 2)
    return local


def _give(problem: ContactProblem, local: PETSc.Vec | None) -> Array:
    """diag(B C B^T) of this rank's joint points, normal and tangential."""
    give = np.zeros((2, len(problem.friction)))
    if local is not None:
        for side, matrix in enumerate((problem.normal, problem.tangential)):
            start, columns, values = matrix.getValuesCSR()
            squares = PETSc.Mat().createAIJ(
                matrix.getSizes(), csr=(start, columns, values**2), comm=matrix.comm
            )
            of_points = squares.createVecLeft()
            squares.mult(local, of_points)
            give[side] = of_points.array_r
            of_points.destroy()
            squares.destroy()
    return give


def _restricted(basis: PETSc.Mat, vector: PETSc.Vec) -> PETSc.Vec:
    """P^T f."""
    restricted = basis.createVecRight()
    basis.multTranspose(vector, restricted)
    return restricted


def _rows(reduced: ContactProblem, sides: Integers, motions: int) -> JointRows:
    """Rows of B_P, joint by joint: the points between the same two blocks together.

    Args:
        reduced: The reduced structure.
        sides: Blocks on both sides of this rank's joint points.
        motions: Modes per block.
    """
    per_point = []
    for matrix in (reduced.normal, reduced.tangential):
        start, columns, values = matrix.getValuesCSR()
        point = np.repeat(np.arange(len(sides)), np.diff(start))
        second = columns // motions == sides[point, 1]
        rows = np.zeros((len(sides), 2 * motions))
        rows[point, columns % motions + motions * second] = values
        per_point.append(rows)
    dofs = np.where(sides[:, :, None] < 0, -1, motions * sides[:, :, None] + np.arange(motions))
    return JointRows.grouped(dofs.reshape(-1, 2 * motions), *per_point)
