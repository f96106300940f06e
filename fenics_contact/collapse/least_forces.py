"""Joint forces of least size among those that load the nodes alike.

Where three blocks meet and stick, the jumps of their displacements depend on each other: a loop of
forces at that place, the head joint pressed and the beds sheared, loads no node. So nothing in the
problem tells its size, and a solver's answer has any. At each such place, with d the part of the
joint that belongs to a point, this takes the forces with

    min sum (r_N^2 + r_T^2) / d,   B_N^T r_N + B_T^T r_T as given,   r_N >= 0,   |r_T| <= F r_N + c,

the least in the norm of the pressures. Points at their bounds keep their forces, and so do points
that have opened or slipped, or do so in the collapse mode: complementarity, friction and
dissipation remain. In an orthonormal basis of the loops this
is a least distance program (C.L. Lawson, R.J. Hanson, Solving Least Squares Problems (1974), ch.
23).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.joints import GROUND, coefficients
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.results.joint_values import JointValues
from fenics_contact.results.result import Collapse
from fenics_contact.solvers.joint_law import PointLaws


@dataclass(frozen=True)
class LeastForcesOptions:
    """Numbers of the search for loops.

    Attributes:
        bound: A point is at a bound if it misses it by less than this part of the largest force.
        moved: It has opened or slipped by more than this part of the largest opening or slip.
        rank: Singular values below this part of the largest one are zero; others are above 1e-2.
        rounding: Forces may miss their bounds by this part of the largest one at the place.
    """

    bound: float = 1e-6
    moved: float = 1e-6
    rank: float = 1e-9
    rounding: float = 1e-12


OPTIONS = LeastForcesOptions()


def with_least_forces(whole: Discretization, end: Collapse) -> Collapse:
    """A collapse whose joint values, to be read by people, have the least forces."""
    joints = end.joints and least_forces(whole, end.joints)
    points = end.at_point_hinges and with_least_forces(whole, end.at_point_hinges)
    return replace(end, joints=joints, at_point_hinges=points)


def least_forces(whole: Discretization, values: JointValues) -> JointValues:
    """Joint values with the least forces that load the nodes alike; the same on all ranks."""
    joints = whole.joints
    forces = np.column_stack([values.normal_force, values.shear_force])
    laws = joints.point_laws
    free = _free(laws, forces) & _rests(values)[:, None]
    rows = _nodal_rows(whole)
    held = ~np.all(np.any(rows.values != 0.0, axis=2), axis=1)
    for points in _places(joints.nodes, np.any(free, axis=1)):
        if len(points) > 1 or held[points[0]]:
            loops = _loops(rows.at(points), joints.length[points], free[points])
            if loops.shape[2]:
                law = laws.at(points)
                forces[points] = _least(law, joints.length[points], forces[points], loops)
    normal, shear = forces.T
    pressures = {"pressure": normal / joints.length, "shear": shear / joints.length}
    return replace(values, normal_force=normal, shear_force=shear, **pressures)


def _places(nodes: Indices, wanted: Flags) -> list[Indices]:
    """Joint points of each place: those that have nodes in common, directly or through others.

    Args:
        nodes: Of both sides at every point, `GROUND` for none, shape (points, 2).
        wanted: Points, shape (points,); places with none of them are left out.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(nodes)
    points, sides = np.nonzero(nodes != GROUND)
    ends = points, count + nodes[points, sides]
    size = count + int(nodes.max(initial=-1)) + 1
    graph = coo_matrix((np.ones(len(points)), ends), (size, size))
    place = connected_components(graph, directed=False)[1][:count]
    chosen = np.bincount(place, wanted) > 0.0
    order = np.argsort(place, kind="stable")
    order = order[chosen[place[order]]]
    begins = np.flatnonzero(np.diff(place[order], prepend=-1))
    return [order[first:end] for first, end in pairwise([*begins, len(order)])]


def _free(law: PointLaws, forces: Array) -> Flags:
    """Forces (normal, shear) that are not at their bounds, shape (points, 2)."""
    normal, shear = forces.T
    least = OPTIONS.bound * np.abs(forces).max(initial=0.0)
    pressed = normal + law.bond > least
    sticks = law.bound(normal + law.bond) - np.abs(shear) > least
    return np.column_stack([pressed & (sticks | ~law.frictional), pressed & sticks])


def _rests(values: JointValues) -> Flags:
    """Points that have neither opened nor slipped, and do not in the collapse mode."""
    moved = np.maximum(values.gap, np.abs(values.slip))
    still = moved <= OPTIONS.moved * max(moved.max(initial=0.0), 0.0)
    return np.asarray(still & ~values.opens & ~values.slips)


@dataclass(frozen=True)
class _NodalRows:
    """Nodal forces B^T r of joint forces r.

    Attributes:
        dofs: Displacements that a point moves, -1 for none, shape (points, width).
        values: Coefficients of B_N and B_T on them, shape (points, 2, width).
    """

    dofs: Indices
    values: Array

    def at(self, points: Indices) -> Array:
        """B^T for the joint points of one place, shape (dofs, points, 2)."""
        dofs, row = np.unique(self.dofs[points], return_inverse=True)
        table = np.zeros((len(dofs), len(points), 2))
        each = np.arange(len(points))[:, None]
        np.add.at(table, (row.reshape(each.size, -1), each), self.values[points].transpose(0, 2, 1))
        return table[dofs >= 0]


def _nodal_rows(whole: Discretization) -> _NodalRows:
    """Coefficients of all joint points, on all ranks."""
    every = np.arange(len(whole.joints.length))
    dofs, normal, tangential = coefficients(whole.joints, whole.supports, every)
    return _NodalRows(dofs, np.stack([normal, tangential], axis=1))


def _loops(nodal: Array, length: Array, free: Flags) -> Array:
    """Forces of pressures of norm 1 that load no node, orthogonal, shape (points, 2, loops).

    Args:
        nodal: B^T, shape (dofs, points, 2).
        length: Length of joint that belongs to the points, m, shape (points,).
        free: Forces that may change, shape (points, 2).
    """
    root = np.sqrt(length)[:, None] * np.ones(2)
    _, singular, basis = np.linalg.svd((nodal * root)[:, free])
    rank = int(np.count_nonzero(singular > OPTIONS.rank * singular.max(initial=0.0)))
    loops = np.zeros((*free.shape, len(basis) - rank))
    loops[free] = root[free][:, None] * basis[rank:].T
    return loops


def _least(law: PointLaws, length: Array, forces: Array, loops: Array) -> Array:
    """Forces of least size at the points of one place, shape (points, 2)."""
    amount = np.einsum("pc,pcl->l", forces / length[:, None], loops)
    least = forces - loops @ amount
    slack = law.distances(least[:, 0] + law.bond, least[:, 1])
    change = law.homogeneous().distances(*loops.transpose(1, 2, 0)).transpose(0, 2, 1)
    moved = np.any(change != 0.0, axis=2)
    size = np.abs(forces).max()
    found = least + loops @ (size * _least_distance(change[moved], -slack[moved] / size))
    found[:, 0] = np.maximum(found[:, 0], -law.bond)
    return found


def _least_distance(rows: Array, least: Array) -> Array:
    """The least x with rows x >= least; there is one."""
    from scipy.optimize import nnls

    if np.all(least <= OPTIONS.rounding):
        return np.zeros(rows.shape[1])
    table = np.vstack([rows.T, least])
    wanted = np.append(np.zeros(rows.shape[1]), 1.0)
    missed = wanted - table @ nnls(table, wanted)[0]
    return np.asarray(-missed[:-1] / missed[-1])
