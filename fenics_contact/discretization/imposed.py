"""Supports and rigid ground that move by d with the dead load, and initial gaps g of joints.

Let u = u_d + u' with a field u_d that is d where supports hold. Then u' is zero there, and

    K u' = (f_D - K u_d) + lambda f_L + B_N^T r_N + B_T^T r_T,
    w_N = B_N u' - o_N >= 0,   w_T = B_T u' - o_T,

with o_N = -([u_d]_N + g) and o_T = -[u_d]_T by the jumps of u_d across the joints, on ground those
against d. On every block with supports u_d is the rigid motion nearest to d, which strains nothing,
and the rest of d at the held nodes alone. Results do not depend on this choice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.facets import GROUND, Boundary
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.movements import displacements
from fenics_contact.discretization.rigid_motions import RigidBodies, motions
from fenics_contact.discretization.supports import Supports
from fenics_contact.geometry.mesh import Array
from fenics_contact.scene.scene import Scene

#: Singular values of held rigid motions that count as zero, relative.
NOT_HELD = 1e-12


def ground_motion(scene: Scene, boundary: Boundary, joints: Joints) -> Array:
    """Displacements of rigid ground at all joint points, m, zero elsewhere, shape (points, 2)."""
    motion = np.zeros(joints.position.shape)
    for name, movement in scene.dead.movement.items():
        mine = joints.law == (*joints.names, name).index(name)
        edges = boundary.in_group(name)
        motion[mine] = displacements(movement, boundary, edges, joints.position[mine])
    return motion


@dataclass(frozen=True)
class Imposed:
    """The field u_d; on all ranks.

    Attributes:
        motion: Rigid motions (a, b, c) of the bodies, shape (bodies, 3).
        rest: What supports hold besides, at their nodes, m, shape (nodes, 2).
        jump: Jumps at the joint points, second side less first, m, shape (points, 2).
    """

    motion: Array
    rest: Array
    jump: Array

    @classmethod
    def of(
        cls,
        supports: Supports,
        bodies: RigidBodies,
        joints: Joints,
        ground: Array,
    ) -> Imposed:
        """By the held displacements of supports, and those of rigid ground at the joint points."""
        per_motion = motions(supports.points - bodies.centre[supports.body], bodies.size)
        rows = np.einsum("nks,nkm->nsm", supports.frame, per_motion) * supports.held[:, :, None]
        held = np.einsum("nks,nk->ns", supports.frame, supports.motion)
        gram = np.zeros((len(bodies.centre), 3, 3))
        right = np.zeros((len(bodies.centre), 3))
        np.add.at(gram, supports.body, np.einsum("nsi,nsj->nij", rows, rows))
        np.add.at(right, supports.body, np.einsum("nsi,ns->ni", rows, held))
        inverse = np.linalg.pinv(gram, rcond=NOT_HELD, hermitian=True)
        scaled = np.einsum("nij,nj->ni", inverse, right)
        missed = held - np.einsum("nsm,nm->ns", rows, scaled[supports.body])
        rest = np.einsum("nks,ns->nk", supports.frame, missed)
        moved = np.zeros((int(joints.stencil.nodes.max(initial=-1)) + 1, 2))
        here = supports.nodes < len(moved)
        moved[supports.nodes[here]] = rest[here]
        jump = joints.stencil.jump(moved) - ground
        # Both sides move with their bodies where their nodes are.
        for side, sign in enumerate((-1.0, 1.0)):
            body = joints.bodies[:, side]
            arm = joints.sides[:, side] - bodies.centre[body]
            turned = np.einsum("nkm,nm->nk", motions(arm, bodies.size), scaled[body])
            jump += sign * np.where(body[:, None] == GROUND, 0.0, turned)
        return cls(scaled / [1.0, 1.0, bodies.size], rest, jump)
