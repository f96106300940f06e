"""Straight faces between two blocks, or a block and the ground, with all their joint points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fenics_contact.discretization.joints import Joints
from fenics_contact.geometry.mesh import Array

#: Difference of direction, and of offset and gap over the structure's size, of one straight face.
COLLINEAR = 1e-6


@dataclass(frozen=True)
class Faces:
    """Straight faces between two bodies.

    Attributes:
        ends: Joint points at their two ends, shape (faces, 2); equal if there is one.
        friction: Coulomb's coefficient, shape (faces,).
        strength: Given bound on the shear force of the whole face, shape (faces,), N/m.
        of_point: Face of every joint point.
    """

    ends: npt.NDArray[np.int64]
    friction: Array
    strength: Array
    of_point: npt.NDArray[np.int64]


def straight_faces(joints: Joints, strength: Array) -> Faces:
    """Faces: joint points grouped by bodies, law and line; with strengths of the points, N/m."""
    if len(joints.length) == 0:
        none = np.empty(0, dtype=np.int64)
        return Faces(none.reshape(0, 2), np.empty(0), np.empty(0), none)
    size = np.ptp(joints.position, axis=0).max() or 1.0
    offset = np.sum(joints.normal * (joints.position - joints.position[0]), axis=1) / size
    across = (joints.sides[:, 1] - joints.sides[:, 0]) / size
    line = np.column_stack([joints.normal, offset, across])
    line = np.round(line / COLLINEAR).astype(np.int64)
    keys = np.column_stack([joints.bodies, joints.law, line])
    face = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    order = np.lexsort((np.sum(joints.tangent * joints.position, axis=1), face))
    starts = np.flatnonzero(np.diff(face[order], prepend=-1))
    stops = np.append(starts[1:], len(order)) - 1
    ends = np.column_stack([order[starts], order[stops]])
    return Faces(ends, joints.friction[ends[:, 0]], np.bincount(face, strength).astype(float), face)
