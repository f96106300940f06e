"""A structure whose blocks only move, stretch and bend: where the search for a state begins.

Displacements u = P a, with the rigid motions, uniform strains and pure bendings of every block as
columns of P, turn the structure into one with eight unknowns per block and the same joint points,

    K_P = P^T K P,   f_P = P^T f,   B_P = B P.

The indentation of the blocks next to a joint force is in none of these, and is added at the joint
points. Below a force on one node of a plane body it grows with the logarithm of the body's size
over that of an element (K.L. Johnson, Contact Mechanics (1985), section 2.2), in units of what the
node would give if all others were held, its entry of K:

    w = B P a + diag(B C B^T) r,    C_ii = c ln(nodes of the block / 3) / K_ii,

which is zero for a single triangle, whose modes are all that it has. A path of this structure
(`arclength`) leads through the same folds at little cost: which joints open and slide hangs on how
blocks move, and how forces spread among the others on how they strain. Its state, with the same
joint forces and the displacements P a + C B^T r, is where the structure itself is taken up.

It is small: every rank has all of it and follows the same path, so that the ranks need not talk.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.parallel import MPI, PETSc
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.effort import Tally
from fenics_contact.solvers.joint_stiffness import JointRows, JointStiffness
from fenics_contact.solvers.problem import Array, Closing, ContactProblem, Owner, SparseMap, State

Integers = npt.NDArray[np.int32]

#: Motions of a block in the plane: three rigid ones, three strains, two bendings.
MODES = 8

#: Combinations of a block's modes shorter than this, squared, are none: held, or on too few nodes.
DEPENDENT = 1e-10


@dataclass(frozen=True)
class Blocks:
    """Blocks and joint points as the reduction sees them.

    Attributes:
        body: Block of every node of this rank.
        points: Numbers of this rank's joint points among all.
        sides: Blocks on both sides of all joint points, -1: ground, shape (all points, 2).
        count: Number of blocks.
    """

    body: Integers
    points: npt.NDArray[np.integer]
    sides: Integers
    count: int


@dataclass(frozen=True)
class Share:
    """The part of a whole array that is on this rank.

    Attributes:
        comm: Ranks that share the array.
        places: Of this rank's entries in the whole array.
        size: Of the whole array.
    """

    comm: MPI.Comm
    places: npt.NDArray[np.integer]
    size: int

    def whole(self, values: Array) -> Array:
        """The whole array, on all ranks, from this rank's entries along the last axis."""
        found = np.zeros((*values.shape[:-1], self.size))
        found[..., self.places] = values
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, found, MPI.SUM)
        return found

    def whole_matrix(self, matrix: PETSc.Mat, column: npt.NDArray[np.integer]) -> PETSc.Mat:
        """A whole matrix on every rank, in place of a distributed one whose rows are shared so.

        `column` is the place of every column of the matrix in the whole one.
        """
        start, columns, values = matrix.getValuesCSR()
        matrix.destroy()
        rows = np.repeat(self.places, np.diff(start))
        parts = self.comm.allgather((rows, column[columns], values))
        rows, columns, values = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        order = np.lexsort((columns, rows))
        begin = np.cumsum([0, *np.bincount(rows, minlength=self.size)])
        csr = begin.astype(PETSc.IntType), columns[order].astype(PETSc.IntType), values[order]
        return PETSc.Mat().createAIJ((self.size, len(column)), csr=csr, comm=MPI.COMM_SELF)


class BlockModes(Closing):
    """The structure that moves in the modes of its blocks alone.

    Attributes:
        full: The structure.
        reduced: The structure of the modes.
    """

    def __init__(self, problem: ContactProblem, shapes: Array, blocks: Blocks) -> None:
        """Reduce a structure.

        Args:
            problem: The structure.
            shapes: Displacements of this rank's nodes in every mode of their block, zero where
                held, shape (nodes, 2, modes).
            blocks: Its blocks.
        """
        count = shapes.shape[2]
        comm = problem.comm
        self.full = problem
        self._blocks = blocks
        self._modes = count
        number, mine = numbered_by_rank(comm, blocks.body, blocks.count)
        basis, is_mode = _orthonormal_columns(problem, shapes, number[blocks.body], mine)
        self._basis = SparseMap(basis)
        # Places of the columns of P, which are by rank, among the unknowns, which are by block.
        places = (count * np.argsort(number)[:, None] + np.arange(count)).ravel()
        own = places[count * mine.start : count * mine.stop]
        self._unknowns = Share(comm, own, len(places))
        self._points = Share(comm, blocks.points, len(blocks.sides))
        # C_ii of this rank's displacements, m per N/m, and diag(B C B^T) of its joint points.
        nodes = comm.allreduce(np.bincount(blocks.body, minlength=blocks.count))
        refinement = np.log(np.maximum(nodes / 3.0, 1.0))[blocks.body]
        diagonal = problem.stiffness.diagonal()
        self._indentation = np.asarray(SEARCH.indentation * np.repeat(refinement, 2) / diagonal)
        of_points = []
        for operator in (problem.normal, problem.tangential):
            start, columns, values = operator.matrix.getValuesCSR()
            csr = start, columns, values**2
            sizes = operator.matrix.getSizes()
            squares = SparseMap(PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm))
            of_points.append(squares @ self._indentation)
            squares.close()
        self._point_indentation = np.array(of_points)
        # K_P, with the mean diagonal on rows of modes that move nothing, B_P and rigid motions.
        stiffness = self._unknowns.whole_matrix(problem.stiffness.matrix.ptap(basis), places)
        entries = stiffness.getDiagonal()
        entries.array[~is_mode[np.argsort(places)]] = entries.sum() / entries.getSize()
        stiffness.setDiagonal(entries)
        entries.destroy()
        normal, tangential = (
            self._points.whole_matrix(operator.matrix.matMult(basis), places)
            for operator in (problem.normal, problem.tangential)
        )
        rigid = basis.transposeMatMult(problem.rigid.matrix)
        motions = np.arange(rigid.getSize()[1])
        matrices = {
            "stiffness": stiffness,
            "normal": normal,
            "tangential": tangential,
            "rigid": self._unknowns.whole_matrix(rigid, motions),
        }
        maps = {name: SparseMap(matrix) for name, matrix in matrices.items()}
        self.reduced = self._loaded(problem, problem, **maps)
        self._stiffness: list[JointStiffness] = []  # shared by copies, once it is made
        self._owner = Owner()
        for item in (*maps.values(), self._basis):
            self._owner.callback(item.close)

    def _loaded(
        self, reduced: ContactProblem, problem: ContactProblem, **maps: Any
    ) -> ContactProblem:
        """The reduced structure under the loads, laws and ties of a problem of the structure."""
        return replace(
            reduced,
            dead=self.motion(problem.dead),
            live=self.motion(problem.live),
            law=problem.law.each(self._points.whole),
            compliance=self._points.whole(self._point_indentation + problem.compliance),
            **maps,
        )

    def stiffness(self, tally: Tally) -> JointStiffness:
        """K_P with joint springs, made when first asked for.

        It is the same one under other loads and laws, and has the tally that was given last.
        """
        if not self._stiffness:
            rows = _rows(self.reduced, self._blocks.sides, self._modes)
            stiffness = JointStiffness(self.reduced.stiffness, [rows], tally)
            self._stiffness.append(self._owner.enter_context(stiffness))
        self._stiffness[0].tally = tally
        return self._stiffness[0]

    def changed(self, problem: ContactProblem) -> BlockModes:
        """The same modes under other loads and laws; this object keeps maps and stiffnesses."""
        new = copy(self)
        new.full = problem
        new.reduced = self._loaded(self.reduced, problem)
        return new

    def restricted(self, state: State) -> State:
        """A state in the modes: their part of the displacements, the same joint forces."""
        u = self.motion(state.displacement)
        return replace(
            state,
            displacement=u,
            elastic=self.reduced.elastic_part(u),
            pressure=self._points.whole(state.pressure),
            shear=self._points.whole(state.shear),
        )

    def motion(self, displacement: Array) -> Array:
        """Part of displacements of the structure, or of forces, that is in the modes."""
        return self._unknowns.whole(self._basis.T @ displacement)

    def prolonged(self, state: State) -> State:
        """A state of the reduced structure as one of the structure itself."""
        mine = self._unknowns.places
        points = self._points.places
        pressure = state.pressure[points]
        shear = state.shear[points]
        indented = self._indentation * self.full.joint_forces(pressure, shear)
        return replace(
            state,
            displacement=self._basis @ state.displacement[mine] + indented,
            elastic=self._basis @ state.elastic[mine] + self.full.elastic_part(indented),
            pressure=pressure,
            shear=shear,
        )


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


def numbered_by_rank(comm: MPI.Comm, body: Integers, count: int) -> tuple[Integers, range]:
    """New number of every body, by which each rank's are in a row, and the range of this rank's.

    A body belongs to the rank that has most of its nodes: its unknowns are where those of its
    nodes and joints are. `body` is that of every node of this rank, `count` the number of bodies.
    """
    home = np.argmax(comm.allgather(np.bincount(body, minlength=count)), axis=0)
    number = np.empty(count, dtype=np.int32)
    number[np.argsort(home, kind="stable")] = np.arange(count)
    first, last = np.cumsum([0, *np.bincount(home, minlength=comm.size)])[comm.rank :][:2]
    return number, range(first, last)


def _orthonormal_columns(
    problem: ContactProblem, shapes: Array, body: Integers, mine: range
) -> tuple[PETSc.Mat, npt.NDArray[np.bool_]]:
    """P, of which a block's columns span its modes, and which of all columns are not zero.

    `body` is the block of every node of this rank, numbered by rank, and `mine` are its blocks.
    """
    comm = problem.comm
    count = shapes.shape[2]
    blocks = comm.allreduce(len(mine))
    gram = np.zeros((blocks, count, count))
    for k, m in combinations_with_replacement(range(count), 2):
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
    sizes = (values.shape[0] * 2, PETSc.DETERMINE), (count * len(mine), count * blocks)
    indices = np.repeat(count * body[:, None] + np.arange(count), 2, axis=0)
    csr = [a.astype(PETSc.IntType) for a in (count * np.arange(2 * len(body) + 1), indices.ravel())]
    basis = PETSc.Mat().createAIJ(sizes, csr=(*csr, values.ravel()), comm=comm)
    return basis, independent.ravel()


def _rows(reduced: ContactProblem, sides: Integers, count: int) -> JointRows:
    """Rows of B_P, joint by joint: the points between the same two blocks together."""
    per_point = []
    for operator in (reduced.normal, reduced.tangential):
        start, columns, values = operator.matrix.getValuesCSR()
        point = np.repeat(np.arange(len(sides)), np.diff(start))
        second = columns // count == sides[point, 1]
        rows = np.zeros((len(sides), 2 * count))
        rows[point, columns % count + count * second] = values
        per_point.append(rows)
    dofs = np.where(sides[:, :, None] < 0, -1, count * sides[:, :, None] + np.arange(count))
    return JointRows.grouped(dofs.reshape(-1, 2 * count), *per_point)
