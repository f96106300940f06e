"""Block modes with hinges shorter than those of the mesh: what they let the blocks give way.

A force on one node presses it in by an amount that grows like log(1/h). A halving of the elements
at the node adds the compliance of an elastic wedge under a force at its apex, between two radii of
ratio 2 (J.H. Michell, Proc. London Math. Soc. 34 (1902) 134; S.P. Timoshenko, J.N. Goodier, Theory
of Elasticity (1951), sections 35 and 36; other laws: `materials`),

    C = ln 2 / E' [ b b^T / (a + sin(2a)/2) + p p^T / (a - sin(2a)/2) ],

with the interior angle 2a of the block at the node, its bisector b, p normal to b, and E' = E in
plane stress, E / (1 - nu^2) in plane strain. So m halvings are two more unknowns for every node of
a hinge, its displacement beside that of the mesh, with the stiffness (m C)^-1, next to the eight
unknowns of every block (`block_modes`):

    K = diag(K_P, (m C)^-1),   f = (f_P, 0),   B = (B_P, B_h),

B_h the columns of B_N and B_T of these nodes. No mesh is factored.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.joints import GROUND
from fenics_contact.discretization.materials import (
    law_matrices,
    mean_shear_modulus,
    wedge_compliance,
)
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.parallel import MPI, PETSc
from fenics_contact.solvers.joint_stiffness import JointRows, JointStiffness
from fenics_contact.solvers.problem import ContactProblem, Owner, SparseMap


@dataclass(frozen=True)
class SoftHinges:
    """The structure of block modes with hinges of their own; every rank has all of it.

    Attributes:
        problem: Its unknowns are those of the modes, then two for every node of a hinge.
        stiffness: K with joint springs.
        modes: Number of unknowns of the modes.
    """

    problem: ContactProblem
    stiffness: JointStiffness
    modes: int

    def widened(self, displacement: Array) -> Array:
        """Displacements in the modes alone, of a structure with other hinges or none."""
        widened = np.zeros(len(self.problem.dead))
        widened[: self.modes] = displacement[: self.modes]
        return widened


@contextmanager
def soft_hinges(case: LoadCase, points: Indices, halvings: float) -> Iterator[SoftHinges]:
    """The structure of a load case with so many halvings m at some joint points. Collective."""
    from scipy.sparse import block_diag, csr_matrix, hstack, vstack

    whole = case.discretization
    reduced = whole.block_modes.changed(case.problem).reduced
    nodes = np.unique(whole.joints.nodes[points])
    nodes = nodes[nodes > GROUND]
    # Maps of the modes, which every rank has, as scipy's matrices.
    stiffness, normal, tangential, rigid = (
        csr_matrix(operator.matrix.getValuesCSR()[::-1], operator.matrix.getSize())
        for operator in (reduced.stiffness, reduced.normal, reduced.tangential, reduced.rigid)
    )
    of_nodes = _columns(whole, nodes)
    hinges = np.linalg.inv(halvings * hinge_compliance(whole, nodes))
    none = np.zeros(2 * len(nodes))
    matrices = {
        "stiffness": block_diag([stiffness, *hinges]),
        "normal": hstack([normal, of_nodes[0]]),
        "tangential": hstack([tangential, of_nodes[1]]),
        "rigid": vstack([rigid, np.zeros((len(none), rigid.shape[1]))]),
    }
    with Owner() as owner:
        maps = {}
        for name, matrix in matrices.items():
            matrix = matrices[name] = matrix.tocsr()
            matrix.sort_indices()
            start, columns = (
                part.astype(PETSc.IntType) for part in (matrix.indptr, matrix.indices)
            )
            csr = start, columns, matrix.data
            maps[name] = SparseMap(PETSc.Mat().createAIJ(matrix.shape, csr=csr, comm=MPI.COMM_SELF))
            owner.callback(maps[name].close)
        loads = {name: np.append(getattr(reduced, name), none) for name in ("dead", "live")}
        problem = replace(reduced, **maps, **loads)
        rows = [_joint_rows(matrices["normal"], matrices["tangential"])]
        springs = JointStiffness(problem.stiffness, rows, whole.mode_tally)
        yield SoftHinges(problem, owner.enter_context(springs), len(reduced.dead))


def hinge_compliance(whole: Discretization, nodes: Indices) -> Array:
    """C of one halving at nodes of the blocks' boundary, m per N/m, shape (nodes, 2, 2).

    In the supports' coordinates, the same on all ranks; `nodes` ascend. Collective.
    """
    # Interior angle of the blocks at the nodes, and its bisector.
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
    angle = 2.0 * np.arccos(np.clip(cosine, -1.0, 1.0))
    # D of the softest cell at every node.
    space = whole.elasticity.space
    matrices = law_matrices(whole.law)
    dofs = compat.cell_dofs(space)
    order = np.argsort(-mean_shear_modulus(matrices), kind="stable")
    softest = np.zeros(int(dofs.max(initial=-1)) + 1, dtype=np.int64)
    softest[dofs[order].ravel()] = np.repeat(order, dofs.shape[1])  # the last one stays
    first, last = space.dofmap.index_map.local_range
    mine = nodes[(nodes >= first) & (nodes < last)] - first
    laws = np.concatenate(whole.scene.comm.allgather(matrices[softest[mine]]))
    frame = whole.supports.free_directions(nodes)
    return np.einsum("nji,njk,nkl->nil", frame, wedge_compliance(laws, angle, inward), frame)


def _columns(whole: Discretization, nodes: Indices) -> list[Any]:
    """Columns of B_N and B_T of some nodes, sparse, shape (all points, 2 nodes). Collective."""
    from scipy.sparse import csr_matrix

    rows = whole.operators
    at = np.minimum(np.searchsorted(nodes, rows.dofs // 2), len(nodes) - 1)
    theirs = (rows.dofs >= 0) & (nodes[at] == rows.dofs // 2)
    column = (2 * at + rows.dofs % 2)[theirs]
    point = rows.points[np.nonzero(theirs)[0]]
    mine = point, column, rows.normal_rows[theirs], rows.tangential_rows[theirs]
    parts = zip(*whole.scene.comm.allgather(mine), strict=True)
    point, column, *values = (np.concatenate(part) for part in parts)
    shape = len(whole.joints.length), 2 * len(nodes)
    return [csr_matrix((each, (point, column)), shape) for each in values]


def _joint_rows(normal: Any, tangential: Any) -> JointRows:
    """Rows of B_N and B_T on the unknowns that move each point."""
    pattern = (abs(normal) + abs(tangential)).tocsr()
    pattern.sort_indices()
    count = np.diff(pattern.indptr)
    row = np.repeat(np.arange(len(count)), count)
    slot = np.arange(len(row)) - pattern.indptr[row]
    dofs = np.full((len(count), int(count.max(initial=1))), -1, dtype=np.int32)
    dofs[row, slot] = pattern.indices
    values = np.zeros((2, *dofs.shape))
    for coefficients, operator in zip(values, (normal, tangential), strict=True):
        coefficients[row, slot] = np.asarray(operator[row, pattern.indices]).ravel()
    return JointRows.grouped(dofs, *values)
