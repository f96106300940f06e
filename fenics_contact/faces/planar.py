"""Straight faces of a planar structure as units of the face engine, and forces back on its points.

A face has a pressing force at each end and one shear force along it. Its points share them like
springs without tension,

    p_i = l_i min(max(a + b s_i, 0), f_c),   sum p_i = N,   sum p_i s_i = n_1 s_1 + n_2 s_2,

s the place along the face and l the points' lengths; shear follows the points' strengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.layout import (
    Faces,
    Layout,
    RigidBodies,
    relative_motions,
    straight_faces,
)
from fenics_contact.faces.model import FaceModel
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.search_options import SEARCH


@dataclass(frozen=True)
class PlanarFaces:
    """The faces of a structure under its dead load and one direction of the live load.

    Attributes:
        model: What the engine sees.
        faces: Straight faces of the joint points.
        joints: All joint points.
        bodies: Blocks, with the dead load less the forces that bonds and ties carry.
        used: Motions among three of each block that supports leave free.
        compressive_strength: f_c of the faces, Pa; infinite where none is given.
    """

    model: FaceModel
    faces: Faces
    joints: Joints
    bodies: RigidBodies
    used: Flags
    compressive_strength: Array

    @classmethod
    def of(cls, layout: Layout, sign: float = 1.0) -> PlanarFaces:
        """Those of a structure, with its live load or the reverse of it (sign -1)."""
        from scipy.sparse import csr_matrix, vstack

        joints = layout.joints
        bodies = _loaded(joints, layout.bodies, sign)
        faces = straight_faces(joints)
        used = np.any(bodies.free != 0.0, axis=1).ravel()
        count = len(faces.ends)
        rows = [
            relative_motions(joints, bodies, faces.ends[:, end], along)[:, used]
            for end, along in ((0, joints.normal), (1, joints.normal), (0, joints.tangent))
        ]
        order = np.arange(3 * count).reshape(3, count).T.ravel()
        motion = csr_matrix(vstack(rows).tocsr()[order])
        length = np.linalg.norm(np.diff(joints.position[faces.ends], axis=1)[:, 0], axis=1)
        strength = _strengths(layout, faces, length)
        limited = np.isfinite(strength)
        safe = np.where(limited, strength, 1.0) * np.where(limited, length, 1.0)
        dead, live, weights = (
            np.einsum("bmk,bm->bk", bodies.free, load).ravel()[used]
            for load in (bodies.dead, bodies.live, layout.bodies.dead)
        )
        model = FaceModel(
            motion,
            2,
            dead,
            live,
            faces.law.strength,
            faces.law.friction,
            faces.law.dilatancy,
            _compliance(layout, faces, length),
            np.where(limited, 0.5 / safe, 0.0),
            weights=weights,
            block=np.repeat(np.arange(len(bodies.dead)), 3)[used],
        )
        return cls(model, faces, joints, bodies, used, strength)

    def motions(self, motion: Array) -> Array:
        """Rigid motions (a, b, c) of all blocks about their centres, from those of the model."""
        every = np.zeros(len(self.used))
        every[self.used] = motion
        found = np.einsum("bmk,bk->bm", self.bodies.free, every.reshape(-1, 3))
        found[:, 2] /= self.bodies.size
        return np.asarray(found)

    def point_forces(self, force: Array) -> tuple[Array, Array]:
        """Normal and shear forces at all joint points, N/m, from forces of the faces (faces, 3)."""
        pressed = self._pressures(force[:, :2])
        law = self.joints.point_laws
        face = self.faces.of_point
        bound = law.bound(pressed)
        total = np.bincount(face, bound, len(force))
        part = np.divide(force[:, 2], total, out=np.zeros(len(force)), where=total > 0.0)
        return pressed, part[face] * bound

    def _pressures(self, ends: Array) -> Array:
        """Normal forces at all joint points from those at the ends of faces."""
        face = self.faces.of_point
        count = len(ends)
        place, half = self._places()
        length = self.joints.length
        normal = ends.sum(axis=1)
        loaded = normal > 0.0
        safe = np.where(loaded, normal, 1.0)
        middle = np.where(loaded, half * (ends[:, 1] - ends[:, 0]) / safe, 0.0)
        scale = np.where(half > 0.0, half, 1.0)
        lever = place / scale[face]
        target = np.column_stack([normal, normal * middle / scale])
        total = np.bincount(face, length, count)
        most = np.minimum(self.compressive_strength, 1e300)
        pressure = np.column_stack([normal / np.maximum(total, 1e-300), np.zeros(count)])
        shares = np.column_stack([np.ones(len(lever)), lever])
        for _ in range(SEARCH.interior_steps):
            raw = np.sum(pressure[face] * shares, axis=1)
            carried = length * np.clip(raw, 0.0, most[face])
            missing = target - _sums(face, carried[:, None] * shares, count)
            if np.all(np.abs(missing).max(axis=1) <= 1e-12 * np.maximum(normal, 1e-300)):
                break
            active = length * ((raw >= 0.0) & (raw <= most[face]))
            products = shares[:, :, None] * shares[:, None, :]
            matrix = _sums(face, active[:, None] * products.reshape(-1, 4), count).reshape(-1, 2, 2)
            matrix += 1e-12 * total[:, None, None] * np.eye(2)
            pressure = pressure + np.linalg.solve(matrix, missing[:, :, None])[:, :, 0]
        raw = np.sum(pressure[face] * shares, axis=1)
        carried = length * np.clip(raw, 0.0, most[face])
        missing = target - _sums(face, carried[:, None] * shares, count)
        failed = np.abs(missing).max(axis=1) > 1e-9 * np.maximum(normal, 1e-300)
        carried[failed[face]] = 0.0
        for end in (0, 1):
            np.add.at(carried, self.faces.ends[failed, end], ends[failed, end])
        return np.asarray(carried)

    def _places(self) -> tuple[Array, Array]:
        """Places of the points from the middle of their faces, and half the faces' lengths, m."""
        joints, ends = self.joints, self.faces.ends
        along = np.sum(joints.tangent * joints.position, axis=1)
        middle = 0.5 * (along[ends[:, 0]] + along[ends[:, 1]])
        half = 0.5 * (along[ends[:, 1]] - along[ends[:, 0]])
        return along - middle[self.faces.of_point], half


def _loaded(joints: Joints, bodies: RigidBodies, sign: float) -> RigidBodies:
    """Blocks, the dead load less the forces of bonds and ties, the live load by its sign."""
    law = joints.point_laws
    dead = bodies.dead.copy()
    points = np.arange(len(joints.length))
    for force, along in ((law.bond, joints.normal), (law.pull, joints.tangent)):
        if np.any(force):
            moved = relative_motions(joints, bodies, points, along)
            loaded = np.asarray(moved.T @ force).reshape(-1, 3)
            dead -= np.einsum("bmk,bk->bm", bodies.free, loaded)
    return replace(bodies, dead=dead, live=sign * bodies.live)


def _strengths(layout: Layout, faces: Faces, length: Array) -> Array:
    """f_c of the faces, Pa, in contact all along; infinite where none is given.

    A face that is interrupted has less, in proportion: so it carries no more than its pieces.
    """
    joints = layout.joints
    strength = np.full(len(length), np.inf)
    np.minimum.at(strength, faces.of_point, joints.crushes)
    strength[length == 0.0] = np.inf
    contact = np.bincount(faces.of_point, joints.length, len(length))
    part = np.divide(contact, length, out=np.ones(len(length)), where=length > 0.0)
    return np.asarray(strength * np.minimum(part, 1.0))


def _compliance(layout: Layout, faces: Faces, length: Array) -> Array:
    """Compliance of the faces' springs: those of a block as long as faces are, shape (faces, 3)."""
    joints = layout.joints
    used = length[length > 0.0]
    typical = float(np.median(used)) if len(used) else 1.0
    young = max(material.young for material in layout.scene.materials.values())
    length = np.maximum(length, SEARCH.small_factor * typical)
    normal = typical / (0.5 * young * length)
    shear = typical / (0.4 * young * length)
    own = joints.compliance[faces.ends[:, 0]]
    shear = np.where(own > 0.0, own, shear)
    return np.column_stack([normal, normal, shear])


def _sums(face: Indices, values: Array, count: int) -> Array:
    """Sums of the points' values by faces, shape (faces, columns)."""
    return np.column_stack([np.bincount(face, column, count) for column in values.T])
