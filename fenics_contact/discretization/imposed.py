"""Imposed displacements: what moves the structure besides loads: gaps and moving supports.

With initial openings g of joints, displacements d of supports (u = d where they hold), and jumps
p_N, p_T of d across the joints there or on moving ground, openings and slips are

    w_N = B_N u + p_N + g >= 0,   w_T = B_T u + p_T,

B being the rows of what is free. Choose a field u_g with B_N u_g = g + p_N at all joint points and
u_g = -d where supports hold, and let u' = u + u_g be unknown. The joints' laws are then those
without gaps, held displacements are zero, and the dead load and the origin of slip change,

    K u' = (f_D + K u_g) + lambda f_L + B_N^T r_N + B_T^T r_T,
    w_N = B_N u',   w_T = B_T u' - (B_T u_g - p_T).

What is written are the displacements u = u' - u_g. The choice of u_g changes nothing else; taken
is the least one, which is zero but at the nodes of joints, with B_T u_g = p_T where there is one.
"""

from __future__ import annotations

import numpy as np

from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.joints import Joints, coefficients
from fenics_contact.discretization.supports import Supports
from fenics_contact.errors import InputError
from fenics_contact.mesh import Array, Flags
from fenics_contact.scene import Movement, Scene

#: Largest error of openings, relative to the largest one; joints that meet may contradict.
PRECISION = 1e-9
#: Steps of the least-squares solver; rows of joint points far apart share no displacements.
ITERATIONS = 2000


def facet_motion(scene: Scene, boundary: Boundary) -> Array:
    """Displacements of the nodes of facets with what supports them, m, shape of their points."""
    motion = np.zeros(boundary.points.shape)
    for name, movement in scene.dead.movement.items():
        mine = boundary.in_group(name)
        motion[mine] = _rigid_motion(movement, boundary, mine, boundary.points[mine])
    return motion


def ground_motion(scene: Scene, boundary: Boundary, joints: Joints) -> Array:
    """Displacements of rigid ground at all joint points, m, zero elsewhere, shape (points, 2)."""
    motion = np.zeros(joints.position.shape)
    for name, movement in scene.dead.movement.items():
        mine = joints.law == (*joints.names, name).index(name)
        edges = boundary.in_group(name)
        motion[mine] = _rigid_motion(movement, boundary, edges, joints.position[mine])
    return motion


def _rigid_motion(movement: Movement, boundary: Boundary, edges: Flags, points: Array) -> Array:
    """Displacements of points that move with some facets, m, shape of the points."""
    middle, length = boundary.points[edges, :2].mean(axis=1), boundary.length[edges]
    arm = points - np.average(middle, axis=0, weights=length)
    turn = np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
    return np.asarray(movement.displacement + np.radians(movement.rotation) * turn)


def imposed_field(
    joints: Joints, supports: Supports, ground: Array, owned: range
) -> tuple[Array, Array]:
    """u_g of what is free, and p_T.

    Args:
        joints: Joint points, with their gaps g.
        supports: With held displacements d.
        ground: Displacements of rigid ground at the joint points, m, shape (points, 2).
        owned: Displacements that this rank owns.

    Returns:
        u_g of these, zero where held, in the supports' coordinates, m; p_T of all points, m.

    Raises:
        InputError: If there is no such field: openings of joints that meet contradict each other.
    """
    from scipy.sparse import coo_matrix, vstack
    from scipy.sparse.linalg import lsqr

    jump = _held_jump(joints, supports, ground)
    opening, slip = (np.sum(axis * jump, axis=1) for axis in (joints.normal, joints.tangent))
    opening += joints.gap
    field, largest = np.zeros(len(owned)), np.abs([opening, slip]).max(initial=0.0)
    if largest == 0.0:
        return field, slip
    count = len(joints.gap)
    dofs, *parts = coefficients(joints, supports, np.arange(count))
    used = np.unique(dofs[dofs >= 0])
    row, place = np.nonzero(dofs >= 0)
    column = np.searchsorted(used, dofs[row, place])
    normal, tangential = (
        coo_matrix((part[row, place], (row, column)), (count, len(used))).tocsr() for part in parts
    )
    slips = vstack([normal, tangential]), np.append(opening, slip)
    for jumps, wanted in (slips, (normal, opening)):
        found = lsqr(jumps, wanted, atol=1e-15, btol=1e-15, conlim=0.0, iter_lim=ITERATIONS)[0]
        missed = np.abs(jumps @ found - wanted)
        if missed.max() <= PRECISION * largest:
            break
    else:
        x, y = np.round(joints.position[np.argmax(missed) % count], 9) + 0.0
        raise InputError(
            f"joints that meet at ({x:g}, {y:g}) have initial gaps that contradict each other or a"
            " support; give all of them a gap. Foundations that move apart must not share a node"
        )
    mine = (used >= owned.start) & (used < owned.stop)
    field[used[mine] - owned.start] = found[mine]
    return field, slip


def _held_jump(joints: Joints, supports: Supports, ground: Array) -> Array:
    """Jump across joints of what supports and ground prescribe, m, shape (points, 2)."""
    nodes = joints.stencil.nodes, supports.nodes
    held = np.zeros((1 + max(int(some.max(initial=0)) for some in nodes), 2))
    held[supports.nodes] = supports.motion
    return joints.stencil.jump(held) - ground
