"""Whether statics alone give the load factor of a collapse mechanism.

The virtual work of all forces in equilibrium vanishes for every rigid motion v of the blocks. Let
f_L.v = 1, and let no joint force do work in v, whatever its size: points that stick in the collapse
mode do not move in v, points without pressure that have a strength and do not slip obey B_T v = 0,
and points that slip with a friction force r_T = s F r_N obey

    B_N v + s F B_T v = 0.

Then lambda = -f_D.v - (work of given strengths), which no joint force and so no mesh changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.faces import relative_motions
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.rigid_motions import RigidBodies
from fenics_contact.geometry.mesh import Flags
from fenics_contact.results.joint_values import JointValues


@dataclass(frozen=True)
class DeterminateOptions:
    """Numbers of the search for a motion.

    Attributes:
        soft: Stiffness against motions, beside 1 against what joints resist.
        still: Largest motion at a joint, beside that of the blocks, that counts as none.
    """

    soft: float = 1e-11
    still: float = 1e-7


OPTIONS = DeterminateOptions()


def is_determinate(
    joints: Joints, values: JointValues, bodies: RigidBodies, loaded: Flags | None = None
) -> bool:
    """Whether no joint force changes the load factor of a mechanism; on this rank alone.

    All points that do not open count as `loaded` unless others are given: on another mesh they may
    be.
    """
    from scipy.sparse import identity, vstack
    from scipy.sparse.linalg import splu

    closed = ~values.opens if loaded is None else loaded
    slips = values.slips
    sticks = closed & ~slips
    slides = closed & slips
    friction = -np.sign(values.slip_rate) * joints.friction
    along = joints.normal + friction[:, None] * joints.tangent
    # Without pressure, a joint with a given strength carries any shear up to that.
    holds = ~closed & ~slips & (joints.point_laws.strength > 0.0)
    along = np.where(slides[:, None], along, joints.normal)
    rows = [
        relative_motions(joints, bodies, np.flatnonzero(closed), along),
        relative_motions(joints, bodies, np.flatnonzero(sticks | holds), joints.tangent),
    ]
    used = np.any(bodies.free != 0.0, axis=1).ravel()
    live = np.einsum("bmk,bm->bk", bodies.free, bodies.live).ravel()[used]
    resisted = vstack(rows).tocsc()[:, used]
    resists = resisted.T @ resisted + OPTIONS.soft * identity(len(live), format="csc")
    motion = splu(resists.tocsc()).solve(live / np.linalg.norm(live))
    moves = float(np.abs(resisted @ motion).max(initial=0.0))
    return moves <= OPTIONS.still * float(np.abs(motion).max())
