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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.joints import GROUND, coefficients
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.results.values import JointValues
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.joint_law import PointLaws

#: Singular values below this part of the largest one are zero; others are above 1e-2.
RANK = 1e-9
#: Forces may miss their bounds by this part of the largest one at the place.
ROUNDING = 1e-12


def least_forces(whole: Discretization, values: JointValues) -> JointValues:
    """Joint values with the least forces that load the nodes alike; the same on all ranks."""
    joints = whole.joints
    forces = np.column_stack([values.normal_force, values.shear_force])
    laws = joints.point_laws
    # Forces that are not at their bounds,
    least = SEARCH.verified * np.abs(forces).max(initial=0.0)
    pressed = forces[:, 0] + laws.bond > least
    sticks = laws.bound(forces[:, 0] + laws.bond) - np.abs(forces[:, 1]) > least
    free = np.column_stack([pressed & (sticks | ~laws.frictional), pressed & sticks])
    # at points that have neither opened nor slipped, and do not in the collapse mode.
    moved = np.maximum(values.gap, np.abs(values.slip))
    still = moved <= SEARCH.verified * max(moved.max(initial=0.0), 0.0)
    free &= (still & ~values.opens & ~values.slips)[:, None]
    dofs, *of_point = coefficients(joints, whole.supports, np.arange(len(joints.length)))
    rows = _NodalRows(dofs, np.stack(of_point, axis=1))
    held = ~np.all(np.any(rows.values != 0.0, axis=2), axis=1)
    places = _places(joints.nodes, np.any(free, axis=1))
    places = [points for points in places if len(points) > 1 or held[points[0]]]
    for points, loops in _loops(rows, joints.length, free, places):
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


@dataclass(frozen=True)
class _NodalRows:
    """Nodal forces B^T r of joint forces r.

    Attributes:
        dofs: Displacements that a point moves, -1 for none, shape (points, width).
        values: Coefficients of B_N and B_T on them, shape (points, 2, width).
    """

    dofs: Indices
    values: Array

    def at(self, places: Indices) -> Array:
        """B^T for the joint points of several places, shape (places, dofs, points, 2).

        `places` has the points of each place, shape (places, points).
        """
        dofs = self.dofs[places]
        place, point, entry = np.nonzero(dofs >= 0)
        key = np.stack([place, dofs[place, point, entry]])
        found, row = np.unique(key, axis=1, return_inverse=True)
        first = np.searchsorted(found[0], np.arange(len(places) + 1))
        row = row.ravel() - first[place]
        table = np.zeros((len(places), int(np.diff(first).max()), places.shape[1], 2))
        np.add.at(table, (place, row, point), self.values[places[place, point], :, entry])
        return table


def _loops(
    rows: _NodalRows, length: Array, free: Flags, places: Sequence[Indices]
) -> Iterator[tuple[Indices, Array]]:
    """Places and forces there of pressures of norm 1 that load no node, where there are any.

    These are orthogonal, of shape (points, 2, loops).

    Args:
        rows: Coefficients of all joint points.
        length: Length of joint that belongs to the points, m, shape (points,).
        free: Forces that may change, shape (points, 2).
        places: Points of each place.
    """
    alike: dict[tuple[int, int], list[Indices]] = {}
    for points in places:
        alike.setdefault((len(points), np.count_nonzero(free[points])), []).append(points)
    for (_, count), some in alike.items():
        points = np.array(some)
        root = np.sqrt(length[points])[:, :, None] * np.ones(2)
        nodal = np.moveaxis(rows.at(points) * root[:, None], 1, -1)
        may = free[points]
        forces = nodal[may].reshape(len(points), count, -1)
        basis, singular, _ = np.linalg.svd(forces)
        ranks = np.sum(singular > RANK * singular.max(axis=1, keepdims=True, initial=0.0), axis=1)
        for k, rank in enumerate(ranks):
            if rank < count:
                loops = np.zeros((*may[k].shape, count - rank))
                loops[may[k]] = root[k][may[k]][:, None] * basis[k, :, rank:]
                yield some[k], loops


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

    if np.all(least <= ROUNDING):
        return np.zeros(rows.shape[1])
    table = np.vstack([rows.T, least])
    wanted = np.append(np.zeros(rows.shape[1]), 1.0)
    missed = wanted - table @ nnls(table, wanted)[0]
    return np.asarray(-missed[:-1] / missed[-1])
