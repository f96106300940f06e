"""Straight faces between two blocks or a block and the ground; relative motions at their points.

A face presses with 0 <= p <= f_c. The resultant N of the largest moment M about the middle of the
face is a block of pressure f_c at its end, a = N / f_c long. So it stays a / 2 inside that end,

    |M| <= N (L - N / f_c) / 2                                               (one length L),

a convex set: crushing is associative (J. Heyman, The masonry arch (1982), section 2.4; R.K.
Livesley, Int. J. Numer. Meth. Eng. 12 (1978) 1853). It is a law of the face engine (`faces.model`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fenics_contact.discretization.facets import GROUND
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.rigid_motions import RigidBodies, motions
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.scene.scene import Scene
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


def straight_faces(joints: Joints) -> Faces:
    """Faces: joint points grouped by bodies, law and line."""
    law = joints.point_laws
    if len(joints.length) == 0:
        none = np.empty(0, dtype=np.int64)
        return Faces(none.reshape(0, 2), law, none)
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


@dataclass(frozen=True)
class CrushedPlace:
    """End of a joint that crushes.

    Attributes:
        position: m.
        group: Joint or foundation.
        length: Of the block of pressure, m.
        normal_force: N per metre of thickness.
    """

    position: tuple[float, float]
    group: str
    length: float
    normal_force: float


def strength_of(scene: Scene, joints: Joints) -> Array:
    """f_c at all joint points: of the joint, or else the lesser of both blocks', Pa."""
    material = [
        scene.material(groups).compressive_strength or np.inf for groups in scene.mesh.cell_sets
    ]
    of_body = np.full(scene.mesh.body_count + 1, np.inf)  # the last one is rigid ground
    np.minimum.at(of_body, scene.mesh.body, np.array(material)[scene.mesh.cell_groups])
    scene.comm.Allreduce(MPI.IN_PLACE, of_body, MPI.MIN)
    of_law = np.array([law.compressive_strength or np.nan for law in joints.laws])[joints.law]
    return np.where(np.isnan(of_law), of_body[joints.bodies].min(axis=1, initial=np.inf), of_law)
