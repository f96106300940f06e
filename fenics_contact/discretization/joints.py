"""Joint points, at which blocks exchange forces, and their opening and slip B_N u and B_T u.

A joint is where facets of two blocks coincide, a joint point a pair of nodes there, or a node on
rigid ground. With n the unit normal from the first side to the second and t = n turned by 90
degrees anticlockwise,

    w_N = n . (u_second - u_first) >= 0   opening,      w_T = t . (u_second - u_first)   slip;

on rigid ground the first side does not move. w_N = B_N u and w_T = B_T u, one row per point.
Nodal weights are the exact integrals of the Lagrange functions on a facet (degree 1: trapezoidal
rule, degree 2: Simpson's).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from fenics_contact.discretization.facets import GROUND, Boundary
from fenics_contact.discretization.pairing import distances_of_ends, joint_facets
from fenics_contact.discretization.supports import SMOOTH_ANGLE, Supports
from fenics_contact.mesh import Array, Indices, Labels
from fenics_contact.scene import JointLaw, Scene

#: Weights of a facet's nodes relative to each other, by number of nodes.
NODAL_WEIGHTS = {2: (1, 1), 3: (1, 1, 4)}


@dataclass(frozen=True)
class Joints:
    """Joint points and the facets between them; the same on all ranks.

    Attributes:
        nodes: Nodes of the first and second side, `GROUND` for rigid ground, shape (points, 2).
        bodies: Their bodies, likewise.
        position: m, shape (points, 2).
        normal: Unit normal from first to second side, shape (points, 2).
        length: Length of joint that belongs to the point, m, shape (points,).
        law: Law of every point as an index into `laws`.
        laws: Those of the scene's joints, then of its foundations.
        names: Their groups.
        segments: Joint points at the ends of every facet of a joint, shape (facets, 2).
    """

    nodes: Indices
    bodies: Labels
    position: Array
    normal: Array
    length: Array
    law: Indices
    laws: tuple[JointLaw, ...]
    names: tuple[str, ...]
    segments: Indices

    @property
    def tangent(self) -> Array:
        """Unit tangents, shape (points, 2)."""
        return np.column_stack([-self.normal[:, 1], self.normal[:, 0]])

    @property
    def friction(self) -> Array:
        """Coefficient of friction of every point, 0 where the law is not Coulomb's."""
        return np.array([law.friction or 0.0 for law in self.laws])[self.law]

    @property
    def shear_strength(self) -> Array:
        """Shear force that every point carries without pressure, N/m: Tresca's bound, cohesion."""
        return np.array([law.bound or law.cohesion for law in self.laws])[self.law] * self.length


@dataclass(frozen=True)
class JointOperators:
    """B_N and B_T, with what this rank's rows are.

    Attributes:
        normal: B_N, shape (points, displacements).
        tangential: B_T.
        points: Joint point of every row.
        sides: Bodies of both sides, `GROUND` for rigid ground, shape (rows, 2).
        dofs: Global dofs, first side then second, -1 for none, shape (rows, 4).
        normal_rows: Coefficients of B_N on those dofs, shape (rows, 4).
        tangential_rows: Those of B_T.
    """

    normal: PETSc.Mat
    tangential: PETSc.Mat
    points: Indices
    sides: Labels
    dofs: Labels
    normal_rows: Array
    tangential_rows: Array


def find_joints(scene: Scene, boundary: Boundary) -> Joints:
    """Points of all joints and foundations.

    Raises:
        InputError: As `joint_facets` says.
    """
    (first, second), law = joint_facets(scene, boundary)
    ground = first == GROUND
    base = np.where(ground, second, first)  # gives the order of the nodes
    per_facet = boundary.nodes.shape[1]
    # Nodes of the second side in the order of the first's, shape (facets, nodes of a facet, 2).
    straight, crossed = (d.sum(axis=1) for d in distances_of_ends(boundary, base, second))
    order = np.where((crossed < straight)[:, None], [1, 0, 2], [0, 1, 2])[:, :per_facet]
    ours = np.where(ground[:, None], GROUND, boundary.nodes[base])
    nodes = np.stack([ours, np.take_along_axis(boundary.nodes[second], order, axis=1)], axis=2)
    normal = np.where(ground, -1.0, 1.0)[:, None] * boundary.normal[base]
    facet, rows, point = _merge(nodes, law, normal)
    share = np.array(NODAL_WEIGHTS[per_facet]) / sum(NODAL_WEIGHTS[per_facet])
    weight = np.outer(boundary.length[base], share).ravel()
    columns = (weight, *(weight[:, None] * normal[facet]).T)
    length, *mean = (np.bincount(point, column, len(rows)).astype(float) for column in columns)
    ours = np.where(ground, GROUND, boundary.body[first])
    return Joints(
        nodes=nodes.reshape(-1, 2)[rows],
        bodies=np.column_stack([ours, boundary.body[second]])[facet[rows]],
        position=boundary.points[base].reshape(-1, 2)[rows],
        normal=np.column_stack(mean) / np.linalg.norm(mean, axis=0)[:, None],
        length=length,
        law=law[facet[rows]],
        laws=(*scene.joints.values(), *scene.foundations.values()),
        names=(*scene.joints, *scene.foundations),
        segments=point.reshape(-1, per_facet)[:, :2],
    )


def _merge(nodes: Indices, law: Indices, normal: Array) -> tuple[Indices, Indices, Indices]:
    """Facet of every node of a facet, first node of every joint point, joint point of every node.

    There is one point per node pair, law and direction, in order of appearance.
    """
    facet = np.repeat(np.arange(len(law)), nodes.shape[1])
    keys = np.column_stack([nodes.reshape(-1, 2), law[facet]])
    keys = np.column_stack([keys, _direction(keys, normal[facet])])
    _, rows, point = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(rows)
    return facet, rows[order], np.argsort(order)[point.ravel()]


def _direction(keys: Indices, normal: Array) -> Indices:
    """0, or 1 where the joint kinks at a node pair and this facet comes second."""
    order = np.lexsort(keys.T[::-1])
    one, two = order[:-1], order[1:]
    kink = np.sum(normal[one] * normal[two], axis=1) < np.cos(SMOOTH_ANGLE)
    direction = np.zeros(len(keys), dtype=np.int64)
    direction[two[kink & np.all(keys[one] == keys[two], axis=1)]] = 1
    return direction


def joint_operators(joints: Joints, supports: Supports, stiffness: PETSc.Mat) -> JointOperators:
    """Build B_N and B_T in the supports' coordinates, on the layout of the stiffness.

    A point's row lives on the rank that owns its second node.
    """
    start, end = stiffness.getOwnershipRange()
    points = np.flatnonzero((joints.nodes[:, 1] >= start // 2) & (joints.nodes[:, 1] < end // 2))
    nodes = joints.nodes[points]
    dofs = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 4)
    dofs[np.repeat(nodes == GROUND, 2, axis=1)] = -1
    directions = np.stack([supports.free_directions(nodes[:, side]) for side in (0, 1)], axis=1)
    sign = np.where(nodes == GROUND, 0.0, np.array([-1.0, 1.0]))
    normal_rows, tangential_rows = (
        (np.einsum("nk,nskl->nsl", axis[points], directions) * sign[:, :, None]).reshape(-1, 4)
        for axis in (joints.normal, joints.tangent)
    )
    return JointOperators(
        normal=_sparse_rows(stiffness, dofs, normal_rows),
        tangential=_sparse_rows(stiffness, dofs, tangential_rows),
        points=points,
        sides=joints.bodies[points],
        dofs=dofs.astype(PETSc.IntType),
        normal_rows=normal_rows,
        tangential_rows=tangential_rows,
    )


def _sparse_rows(stiffness: PETSc.Mat, dofs: Indices, rows: Array) -> PETSc.Mat:
    """A matrix with the stiffness's columns from coefficients of global dofs, -1: none."""
    kept = dofs >= 0
    indptr = np.concatenate([[0], np.cumsum(kept.sum(axis=1))]).astype(PETSc.IntType)
    matrix = PETSc.Mat().createAIJ(
        ((len(rows), PETSc.DETERMINE), (stiffness.getLocalSize()[1], PETSc.DETERMINE)),
        csr=(indptr, dofs[kept].astype(PETSc.IntType), rows[kept]),
        comm=stiffness.comm,
    )
    matrix.assemble()
    return matrix
