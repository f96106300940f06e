"""The strength of joints under pressure, and where they crush.

A face presses with 0 <= p <= f_c. The resultant N of the largest moment M about the middle of the
face is a block of pressure f_c at its end, a = N / f_c long. So it stays a / 2 inside that end,

    |M| <= N (L - N / f_c) / 2                                               (one length L),

a convex set: crushing is associative (J. Heyman, The masonry arch (1982), section 2.4; R.K.
Livesley, Int. J. Numer. Meth. Eng. 12 (1978) 1853). It is a law of the face engine (`faces.model`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact.discretization.faces import straight_faces
from fenics_contact.discretization.joints import Joints
from fenics_contact.geometry.mesh import Array
from fenics_contact.scene.scene import Scene

#: Places that a warning names.
NAMED = 3


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


def pressed_too_much(scene: Scene, joints: Joints, force: Array) -> str:
    """Where pressures exceed the strength of curved joints, which do not crush, for people.

    `force` is normal, N/m, at all joint points. Collective.
    """
    strength = strength_of(scene, joints)
    face = straight_faces(joints).of_point
    pressure = force / joints.length
    beyond = np.flatnonzero((np.bincount(face)[face] == 1) & (pressure > strength))
    if not len(beyond):
        return ""
    beyond = beyond[np.argsort(-pressure[beyond])]
    places = []
    for point in beyond[:NAMED]:
        x, y = np.round(joints.position[point], 9) + 0.0
        pair = f"{1e-6 * pressure[point]:.3g} MPa, strength {1e-6 * strength[point]:.3g} MPa"
        places.append(f"({x:.3g}, {y:.3g}) ({pair})")
    more = f" and {len(beyond) - NAMED} more" if len(beyond) > NAMED else ""
    text = "the compressive strength is exceeded at curved joints, which do not crush here: at"
    return f"{text} {', '.join(places)}{more}"
