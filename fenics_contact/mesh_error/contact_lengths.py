"""Lengths of hinges: that of the mesh, and N / f_c, which the compressive strength f_c leaves.

A hinge of the mesh acts like one of the length h of its element side for degree 1, and of a fifth
of that for degree 2: the load factors of walls that depend on hinges are then alike. A shorter one
of length N / f_c has the compliance of m = log2(h f_c / N) halvings more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.crushing import strength_of
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.faces import straight_faces
from fenics_contact.discretization.joints import Joints
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.results.joint_values import JointValues

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
        return cls(
            joints, OF_SIDE[whole.scene.degree] * shortest, strength_of(whole.scene, whole.joints)
        )

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

    def warnings(self, values: JointValues) -> tuple[str, ...]:
        """Where pressures exceed the strength of curved joints, whose crushing is not computed."""
        joints = self.joints
        face = straight_faces(self.joints).of_point
        curved = np.bincount(face)[face] == 1
        pressure = values.normal_force / joints.length
        beyond = np.flatnonzero(curved & (pressure > self.strength))
        if not len(beyond):
            return ()
        places = [
            f"{_place(joints.position[p])} ({1e-6 * pressure[p]:.3g} MPa, strength"
            f" {1e-6 * self.strength[p]:.3g} MPa)"
            for p in beyond[np.argsort(-pressure[beyond])]
        ]
        text = "the compressive strength is exceeded at curved joints, which do not crush here: at"
        return (f"{text} {_listed(places)}",)


def _place(point: Array) -> str:
    x, y = np.round(point, 9) + 0.0
    return f"({x:.3g}, {y:.3g})"


def _listed(places: list[str]) -> str:
    more = f" and {len(places) - NAMED} more" if len(places) > NAMED else ""
    return ", ".join(places[:NAMED]) + more
