"""Compliance of hinges: what finer meshes would let a block give way under a force on one node.

A force on one node presses it in by an amount that grows like log(1/h). A halving of the elements
at the node adds the compliance of an elastic wedge under a force at its apex, between two radii of
ratio 2 (J.H. Michell, Proc. London Math. Soc. 34 (1902) 134; S.P. Timoshenko, J.N. Goodier, Theory
of Elasticity (1951), sections 35 and 36),

    C = ln 2 / E' [ b b^T / (a + sin(2a)/2) + p p^T / (a - sin(2a)/2) ],

with the interior angle 2a of the block at the node, its bisector b, p normal to b, and E' = E in
plane stress, E / (1 - nu^2) in plane strain. A node with this compliance between its forces and
the mesh turns K and f into

    K - K_h M K_h^T,   f - K_h M f_h,   M = (C^-1 + K_hh)^-1,

with the columns K_h of all such nodes; this is (K^-1 + C)^-1 where K has an inverse. Openings,
slips, and rigid motions stay what they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.discretization import materials
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.solvers.problem import ContactProblem, Owner, SparseMap

#: Columns of a sparse matrix that are dense at once.
AT_ONCE = 64


def wedge_compliance(modulus: Array, angle: Array, bisector: Array) -> Array:
    """C of one halving at the apex of wedges, m per N/m, shape (wedges, 2, 2).

    Args:
        modulus: E', Pa, shape (wedges,).
        angle: Interior angle 2a, shape (wedges,).
        bisector: Unit vectors b, shape (wedges, 2).
    """
    across = np.column_stack([-bisector[:, 1], bisector[:, 0]])
    both = [np.einsum("ni,nj->nij", axis, axis) for axis in (bisector, across)]
    half = 0.5 * angle
    sine = 0.5 * np.sin(angle)
    parts = both[0].T / (half + sine) + both[1].T / (half - sine)
    return np.asarray((np.log(2.0) / modulus * parts).T)


@dataclass(frozen=True)
class HingeNodes:
    """Nodes of blocks at which a hinge acts; the same on all ranks.

    Attributes:
        nodes: Global numbers, ascending, shape (nodes,).
        compliance: C of one halving in the supports' coordinates, shape (nodes, 2, 2).
    """

    nodes: Indices
    compliance: Array

    @classmethod
    def of(cls, whole: Discretization, nodes: Indices) -> HingeNodes:
        """Those given, in any order and more than once."""
        nodes = np.unique(nodes)
        angle, bisector = _wedges(whole, nodes)
        if isinstance(whole.elasticity.law, tuple):
            compliance = wedge_compliance(_modulus(whole, nodes), angle, bisector)
        else:
            compliance = materials.wedge_compliance(_matrices(whole, nodes), angle, bisector)
        frame = whole.supports.free_directions(nodes)
        return cls(nodes, np.einsum("nji,njk,nkl->nil", frame, compliance, frame))

    def soften(self, problem: ContactProblem, halvings: float, owner: Owner) -> ContactProblem:
        """The problem with the compliance of so many halvings at the nodes.

        `owner` frees its stiffness.
        """
        comm = problem.comm
        count = 2 * len(self.nodes)
        stiffness = problem.stiffness.matrix
        first, last = stiffness.getOwnershipRange()
        mine = np.flatnonzero((2 * self.nodes >= first) & (2 * self.nodes < last))
        columns = (2 * mine[:, None] + np.arange(2)).ravel()
        rows = (2 * self.nodes[mine][:, None] + np.arange(2)).ravel() - first
        sizes = stiffness.getSizes()[0], (len(columns), count)
        start = np.searchsorted(rows, np.arange(last - first + 1))
        with Owner() as temporary:
            own = temporary.own
            selection = own(_matrix(sizes, start, columns, np.ones(len(columns)), comm))
            of_nodes = own(stiffness.matMult(selection))  # K_h
            between = own(selection.transposeMatMult(of_nodes))  # K_hh
            inner = self._inner(between, halvings)[columns]  # M, this rank's rows
            sizes = sizes[1], sizes[1]
            middle = own(_matrix(sizes, inner.indptr, inner.indices, inner.data, comm))
            transposed = own(of_nodes.transpose(PETSc.Mat()))
            less = own(middle.ptap(transposed))
            softened = stiffness.copy()
            softened.axpy(-1.0, less, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            result = SparseMap(softened)
            owner.callback(result.close)
            give = SparseMap(middle.matMult(transposed))  # M K_h^T
            temporary.callback(give.close)
            loads = [f - give.T @ f[rows] for f in (problem.dead, problem.live)]
        return replace(problem, stiffness=result, dead=loads[0], live=loads[1])

    def indentation(self, forces: Array, halvings: float, first: int) -> Array:
        """By how much the nodes give way under forces on them with so many halvings, m.

        Forces, N per metre of thickness, and displacements are this rank's part, in the supports'
        coordinates; its nodes count from `first`.
        """
        given = forces.reshape(-1, 2)
        result = np.zeros_like(given)
        mine = (self.nodes >= first) & (self.nodes < first + len(given))
        at = self.nodes[mine] - first
        result[at] = halvings * np.einsum("nij,nj->ni", self.compliance[mine], given[at])
        return result.ravel()

    def _inner(self, between: PETSc.Mat, halvings: float) -> Any:
        """M for K_hh, a scipy matrix on all ranks; held displacements have no compliance."""
        from scipy.sparse import bsr_matrix, csc_matrix, csr_matrix, hstack, identity, vstack
        from scipy.sparse.linalg import splu

        start, columns, values = between.getValuesCSR()
        mine = csr_matrix((values, columns, start), (len(start) - 1, between.getSize()[1]))
        between_nodes = vstack(between.comm.tompi4py().allgather(mine))
        place = np.arange(len(self.nodes) + 1)
        compliance = bsr_matrix((halvings * self.compliance, place[:-1], place)).tocsc()
        # C (1 + K_hh C)^-1 is symmetric.
        give = splu((identity(2 * len(self.nodes)) + compliance @ between_nodes).tocsc())
        several = (compliance[:, k : k + AT_ONCE] for k in range(0, 2 * len(self.nodes), AT_ONCE))
        inner = hstack([csc_matrix(give.solve(some.toarray())) for some in several])
        return (0.5 * (inner + inner.T)).tocsr()


def _wedges(whole: Discretization, nodes: Indices) -> tuple[Array, Array]:
    """Interior angle of the blocks at nodes of their boundary, and its bisector."""
    boundary = whole.boundary
    at = np.searchsorted(nodes, boundary.nodes[:, :2])
    at = np.minimum(at, len(nodes) - 1)
    facet, end = np.nonzero(nodes[at] == boundary.nodes[:, :2])
    place = at[facet, end]
    along = boundary.points[facet, 1 - end] - boundary.points[facet, end]
    along /= boundary.length[facet, None]
    inward, sides = np.zeros((2, len(nodes), 2))
    np.add.at(inward, place, -boundary.normal[facet])
    np.add.at(sides, place, along)
    inward /= np.maximum(np.linalg.norm(inward, axis=1), 1e-12)[:, None]  # no direction in a slit
    # A facet is at half the angle from the bisector: along . b = cos(a), summed over both.
    cosine = 0.5 * np.sum(sides * inward, axis=1)
    return 2.0 * np.arccos(np.clip(cosine, -1.0, 1.0)), inward


def _modulus(whole: Discretization, nodes: Indices) -> Array:
    """E' at nodes, Pa: the least of the cells there."""
    elasticity = whole.elasticity
    comm = whole.scene.comm
    first, mu = (field.x.array for field in elasticity.lame)
    cells = compat.cell_dofs(elasticity.lame[0].function_space)[:, 0]
    modulus = (4.0 * mu * (first + mu) / (first + 2.0 * mu))[cells]
    dofs = compat.cell_dofs(elasticity.space)
    index_map = elasticity.space.dofmap.index_map
    least = np.full(index_map.size_local + index_map.num_ghosts, np.inf)
    np.minimum.at(least, dofs, np.broadcast_to(modulus[:, None], dofs.shape))
    start, end = index_map.local_range
    mine = nodes[(nodes >= start) & (nodes < end)] - start
    return np.concatenate(comm.allgather(least[mine]))


def _matrices(whole: Discretization, nodes: Indices) -> Array:
    """D of a given law at nodes, Pa: that of the softest cell there, shape (nodes, 3, 3)."""
    elasticity = whole.elasticity
    matrices = elasticity.law_matrices()
    dofs = compat.cell_dofs(elasticity.space)
    order = np.argsort(-materials.mean_shear_modulus(matrices), kind="stable")
    softest = np.zeros(int(dofs.max(initial=-1)) + 1, dtype=np.int64)
    softest[dofs[order].ravel()] = np.repeat(order, dofs.shape[1])  # the last one stays
    start, end = elasticity.space.dofmap.index_map.local_range
    mine = nodes[(nodes >= start) & (nodes < end)] - start
    return np.concatenate(whole.scene.comm.allgather(matrices[softest[mine]]))


def _matrix(
    sizes: tuple[tuple[int, int], tuple[int, int]],
    start: Indices,
    columns: Indices,
    values: Array,
    comm: MPI.Comm,
) -> PETSc.Mat:
    """A distributed sparse matrix from this rank's rows."""
    csr = start.astype(PETSc.IntType), columns.astype(PETSc.IntType), values
    matrix = PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)
    matrix.assemble()
    return matrix
