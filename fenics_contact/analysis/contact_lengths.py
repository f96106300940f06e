"""Lengths of hinges: that of the mesh, and N / f_c, which the compressive strength f_c leaves.

A hinge of the mesh acts like one of the length h of its element side for degree 1, and of a fifth
of that for degree 2: the load factors of walls that depend on hinges are then alike. A shorter one
of length N / f_c has the compliance of m = log2(h f_c / N) halvings more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact.analysis.joint_values import Contact, JointValues
from fenics_contact.analysis.rigid_blocks import straight_faces
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.joints import Joints
from fenics_contact.mesh import Array, Indices

#: Length of a hinge in units of its element side, by degree; measured.
OF_SIDE = {1: 1.0, 2: 0.2}
#: Places that a warning names.
NAMED = 3


@dataclass(frozen=True)
class ContactLengths:
    """Lengths of hinges at all joint points; the same on all ranks.

    Attributes:
        joints: Joint points.
        mesh: Length of a hinge there on the mesh, m.
        strength: f_c, Pa; infinite where none is given.
    """

    joints: Joints
    mesh: Array
    strength: Array

    @classmethod
    def of(cls, whole: Discretization) -> ContactLengths:
        """Those of a discretised scene."""
        joints = whole.joints
        ends = joints.position[joints.segments]
        side = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        shortest = np.full(len(joints.length), np.inf)
        for end in joints.segments.T:
            np.minimum.at(shortest, end, side)
        return cls(joints, OF_SIDE[whole.scene.degree] * shortest, _strength(whole))

    @property
    def given(self) -> bool:
        """Whether a compressive strength is given anywhere."""
        return bool(np.any(np.isfinite(self.strength)))

    def of_mesh(self, points: Indices, force: Array) -> float:
        """Length of the most loaded of some hinges on the mesh, m; nan without."""
        return float(self.mesh[points[np.argmax(force[points])]]) if len(points) else np.nan

    def by_strength(self, points: Indices, force: Array) -> float:
        """Length of the most loaded of some hinges by its strength, m; nan without."""
        if not len(points):
            return float(np.nan)
        worst = points[np.argmax(force[points])]
        return float(force[worst] / self.strength[worst])

    def halvings(self, points: Indices, force: Array) -> Array:
        """Halvings m of some hinges under normal forces at all points, N/m; at least 0."""
        length = np.maximum(force[points] / self.strength[points], 1e-300)
        return np.maximum(np.log2(self.mesh[points] / length), 0.0)

    def warnings(self, values: JointValues, points: Indices) -> tuple[str, ...]:
        """Where the strength does not suffice for the forces of a state with hinges at points."""
        force = values.normal_force
        length = force[points] / self.strength[points]
        beyond = points[length > self.mesh[points] * (1.0 + 1e-9)]
        hinges = [
            f"{_place(self.joints.position[p])} ({1e3 * force[p] / self.strength[p]:.3g} mm, mesh"
            f" {1e3 * self.mesh[p]:.3g} mm)"
            for p in beyond[np.argsort(-force[beyond] / self.strength[beyond])]
        ]
        found = []
        if hinges:
            found.append(
                "hinges need more length for their compressive strength than the mesh gives them,"
                f" the load factor holds for the mesh's: at {_listed(hinges)}"
            )
        if faces := self._crushed_faces(values, points):
            found.append(
                "the compressive strength is exceeded by the mean pressure over the closed length"
                f" of joints: around {_listed(faces)}"
            )
        return tuple(found)

    def _crushed_faces(self, values: JointValues, points: Indices) -> list[str]:
        """Faces whose mean pressure is above the strength, hinges apart, the worst first."""
        joints = self.joints
        face = straight_faces(joints, joints.length).of_point
        closed = values.contact != Contact.OPEN
        over_a_length = closed.copy()
        over_a_length[points] = False
        count = int(face.max(initial=-1)) + 1
        of_face = [
            np.bincount(face, weights, count)
            for weights in (
                values.normal_force * closed,
                joints.length * closed,
                values.normal_force * closed * joints.position[:, 0],
                values.normal_force * closed * joints.position[:, 1],
                over_a_length,
            )
        ]
        force, length, x, y, some = of_face
        strength = np.full(count, np.inf)
        np.minimum.at(strength, face, self.strength)
        mean = np.divide(force, length, out=np.zeros(count), where=length > 0.0)
        worst = np.argsort(-mean / strength)
        return [
            f"{_place(np.array([x[k], y[k]]) / force[k])} ({1e-6 * mean[k]:.3g} MPa,"
            f" strength {1e-6 * strength[k]:.3g} MPa)"
            for k in worst[(some > 0)[worst] & (mean > strength)[worst]]
        ]


def _strength(whole: Discretization) -> Array:
    """f_c at all joint points: of the joint, or else the lesser of both blocks', Pa."""
    scene, joints = whole.scene, whole.joints
    material = [
        scene.material(groups).compressive_strength or np.inf for groups in scene.mesh.cell_sets
    ]
    of_body = np.full(scene.mesh.body_count + 1, np.inf)  # the last one is rigid ground
    np.minimum.at(of_body, scene.mesh.body, np.array(material)[scene.mesh.cell_groups])
    scene.comm.Allreduce(MPI.IN_PLACE, of_body, MPI.MIN)
    of_law = np.array([law.compressive_strength or np.nan for law in joints.laws])[joints.law]
    return np.where(np.isnan(of_law), of_body[joints.bodies].min(axis=1, initial=np.inf), of_law)


def _place(point: Array) -> str:
    x, y = np.round(point, 9) + 0.0
    return f"({x:.3g}, {y:.3g})"


def _listed(places: list[str]) -> str:
    more = f" and {len(places) - NAMED} more" if len(places) > NAMED else ""
    return ", ".join(places[:NAMED]) + more
