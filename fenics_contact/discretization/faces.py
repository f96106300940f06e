"""Straight faces between two blocks or a block and the ground; relative motions at their points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.discretization.facets import GROUND
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.rigid_motions import RigidBodies, motions
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.solvers.joint_law import PointLaws

#: Difference of direction, and of offset and gap over the structure's size, of one straight face.
COLLINEAR = 1e-6


@dataclass(frozen=True)
class Faces:
    """Straight faces between two bodies.

    Attributes:
        ends: Joint points at their two ends, shape (faces, 2); equal if there is one.
        law: Of the faces, with the strength of the whole face, N/m.
        of_point: Face of every joint point.
    """

    ends: npt.NDArray[np.int64]
    law: PointLaws
    of_point: npt.NDArray[np.int64]


def straight_faces(joints: Joints, law: PointLaws | None = None) -> Faces:
    """Faces: joint points grouped by bodies, law, friction and line; with other laws of points."""
    law = law or joints.point_laws
    if len(joints.length) == 0:
        none = np.empty(0, dtype=np.int64)
        return Faces(none.reshape(0, 2), law, none)
    size = np.ptp(joints.position, axis=0).max() or 1.0
    offset = np.sum(joints.normal * (joints.position - joints.position[0]), axis=1) / size
    across = (joints.sides[:, 1] - joints.sides[:, 0]) / size
    line = np.column_stack([joints.normal, offset, across])
    line = np.round(line / COLLINEAR).astype(np.int64)
    # Points of a face have one friction: those with another are a face of their own.
    of_point = np.column_stack([law.friction, law.dilatancy])
    friction = np.unique(of_point, axis=0, return_inverse=True)[1].ravel()
    keys = np.column_stack([joints.bodies, joints.law, friction, line])
    face = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    order = np.lexsort((np.sum(joints.tangent * joints.position, axis=1), face))
    starts = np.flatnonzero(np.diff(face[order], prepend=-1))
    stops = np.append(starts[1:], len(order)) - 1
    ends = np.column_stack([order[starts], order[stops]])
    of_faces = law.at(ends[:, 0])
    strength = np.bincount(face, law.strength).astype(float)
    return Faces(ends, replace(of_faces, strength=strength), face)


def relative_motions(joints: Joints, bodies: RigidBodies, points: Indices, along: Array) -> Any:
    """Matrix that gives relative motions at joint points, second side less first, along directions.

    Each side moves where its nodes are (`Joints.sides`), as in B_N and B_T. Its transpose gives the
    generalised forces of unit forces there.

    Args:
        joints: All joint points.
        bodies: All bodies.
        points: Numbers of joint points.
        along: Directions at all joint points, shape (points, 2).

    Returns:
        Sparse, of shape (chosen points, 3 bodies); columns are the bodies' free motions.
    """
    from scipy.sparse import csr_matrix

    row, side = np.nonzero(joints.bodies[points] != GROUND)
    point = points[row]
    body = joints.bodies[point, side]
    sign = 2.0 * side - 1.0
    motion = motions(joints.sides[point, side] - bodies.centre[body], bodies.size)
    moved = sign[:, None] * np.einsum("nim,ni->nm", motion, along[point])
    moved = np.einsum("nmk,nm->nk", bodies.free[body], moved)
    columns = 3 * body[:, None] + np.arange(3)
    indices = np.repeat(row, 3), columns.ravel()
    return csr_matrix((moved.ravel(), indices), (len(points), 3 * len(bodies.centre)))
