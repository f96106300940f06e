"""Rigid motions of the blocks: those that supports leave free, and those that they impose.

A body's rigid motion is (a, b, c): u(x) = (a, b) + c (-(y - y0), x - x0) about its centre.

Supports and rigid ground move by d with the dead load; joints have initial gaps g. Let u = u_d + u'
with a field u_d that is d where supports hold. Then u' is zero there, and

    K u' = (f_D - K u_d) + lambda f_L + B_N^T r_N + B_T^T r_T,
    w_N = B_N u' - o_N >= 0,   w_T = B_T u' - o_T,

with o_N = -([u_d]_N + g) and o_T = -[u_d]_T by the jumps of u_d across the joints, on ground those
against d. On every block with supports u_d is the rigid motion nearest to d, which strains nothing,
and the rest of d at the held nodes alone. Results do not depend on this choice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.elasticity import Elasticity
from fenics_contact.discretization.facets import GROUND, Boundary
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.supports import Supports, displacements
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, Flags, Labels
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.scene.scene import Scene

#: Motions held less than the square root of this, relative to the best held one, are free.
FREE = 1e-13


@dataclass(frozen=True)
class RigidBodies:
    """Bodies as the rigid-block programs see them; on all ranks.

    Attributes:
        centre: Reference point of every body, m, shape (bodies, 2).
        size: Length by which rotations are scaled, m.
        free: Orthonormal motions (a, b, c size) of every body that supports leave free, as columns
            beside zero ones, shape (bodies, 3, 3).
        dead: Forces, and moment / size, of the dead load, shape (bodies, 3).
        live: Those of the live load.
    """

    centre: Array
    size: float
    free: Array
    dead: Array
    live: Array

    @property
    def floating(self) -> Flags:
        """Bodies that supports alone do not hold."""
        return np.any(self.free != 0.0, axis=(1, 2))


def rigid_bodies(elasticity: Elasticity, supports: Supports, boundary: Boundary) -> RigidBodies:
    """Motions that supports leave free, and resultants of the loads."""
    size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
    scale = np.array([1.0, 1.0, 1.0 / size])
    centre = elasticity.centre
    motion = motions(supports.points - centre[supports.body], size)
    gram = _held(motion, supports.frame, supports.held, supports.body, len(centre))
    dead = elasticity.dead_resultant * scale
    return RigidBodies(centre, size, _null_space(gram), dead, elasticity.live_resultant * scale)


def motions(arm: Array, size: float) -> Array:
    """Displacement at a point per motion (a, b, c size), shape (points, 2, 3)."""
    motion = np.zeros((len(arm), 2, 3))
    motion[:, 0, 0] = motion[:, 1, 1] = 1.0
    motion[:, 0, 2], motion[:, 1, 2] = -arm[:, 1] / size, arm[:, 0] / size
    return motion


def _held(motion: Array, frame: Array, held: Flags, label: Labels, count: int) -> Array:
    """Gram matrices, by label, of the motions of points in the held directions."""
    rows = np.einsum("nks,nkm->nsm", frame, motion) * held[:, :, None]
    gram = np.zeros((count, 3, 3))
    np.add.at(gram, label, np.einsum("nsi,nsj->nij", rows, rows))
    return gram


def _null_space(gram: Array) -> Array:
    """Orthonormal motions that nothing holds as columns, those held zero."""
    size, direction = np.linalg.eigh(gram)
    held = size > FREE * np.maximum(size[:, -1:], 1e-300)
    return np.where(held[:, None, :], 0.0, direction)


def check_held(
    sides: Labels, position: Array, supports: Supports, bodies: RigidBodies, source: str
) -> None:
    """Check that the structure cannot move as a whole with all its joints closed.

    `sides` and `position` are `Joints.bodies` and `Joints.position`; `source` names the mesh.

    Raises:
        InputError: If some blocks touch nothing that holds them, or can move all together.
    """
    on_ground = sides[:, 0] == GROUND
    cluster = connected(sides[~on_ground], len(bodies.centre))
    stands = position[on_ground]
    points = np.concatenate([supports.points, stands])
    body = np.concatenate([supports.body, sides[on_ground, 1]])
    frame = np.concatenate([supports.frame, np.tile(np.eye(2), (len(stands), 1, 1))])
    held = np.concatenate([supports.held, np.ones((len(stands), 2), dtype=bool)])
    motion = motions(points - bodies.centre.mean(axis=0), bodies.size)
    gram = _held(motion, frame, held, cluster[body], int(cluster.max()) + 1)
    loose = np.flatnonzero(np.any(_null_space(gram) != 0.0, axis=(1, 2)))
    if not len(loose):
        return
    untouched = loose[~np.any(gram[loose], axis=(1, 2))]
    members = np.flatnonzero(np.isin(cluster, untouched if len(untouched) else loose))
    x, y = bodies.centre[members[0]]
    apart = f" in {len(untouched)} places" if len(untouched) > 1 else ""
    where = f"{source}: {len(members)} blocks{apart}, the first around ({x:g}, {y:g}),"
    if not len(untouched):
        raise InputError(f"{where} can move all together even with closed joints; add supports")
    raise InputError(
        f"{where} touch neither a support nor a foundation, nor blocks that do; add [supports] or"
        " [foundations], or check that the blocks touch: fenics-contact mesh --close closes mortar"
        " joints of a drawing, joints.default.gap gaps that must close first"
    )


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


def imposed_motions(
    supports: Supports, bodies: RigidBodies, joints: Joints, ground: Array
) -> tuple[Array, Array, Array]:
    """The field u_d by the held displacements of supports, and those of rigid ground; on all ranks.

    Returns:
        Rigid motions (a, b, c) of the bodies, shape (bodies, 3); what supports hold besides, at
        their nodes, m, shape (nodes, 2); jumps at the joint points, second side less first, m,
        shape (points, 2).
    """
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
    return scaled / [1.0, 1.0, bodies.size], rest, jump
