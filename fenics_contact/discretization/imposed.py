"""Imposed displacements: what moves the structure besides loads, here the initial gaps of joints.

With the openings w_N = B_N u + g >= 0 for initial openings g, choose a field u_g with B_N u_g = g
at all joint points, and let u' = u + u_g be unknown. The joints' laws are then those without gaps;
the dead load changes, and slip is measured from B_T u_g,

    K u' = (f_D + K u_g) + lambda f_L + B_N^T r_N + B_T^T r_T,
    w_N = B_N u',   w_T = B_T (u' - u_g).

What is written are the displacements u = u' - u_g. The choice of u_g changes nothing else; taken
is the least one, which is zero but at the nodes of joints, with B_T u_g = 0 where there is one.
"""

from __future__ import annotations

import numpy as np

from fenics_contact.discretization.joints import Joints, coefficients
from fenics_contact.discretization.supports import Supports
from fenics_contact.errors import InputError
from fenics_contact.mesh import Array

#: Largest error of openings, relative to the largest gap; joints that meet may contradict.
PRECISION = 1e-9
#: Steps of the least-squares solver; rows of joint points far apart share no displacements.
ITERATIONS = 2000


def gap_field(joints: Joints, supports: Supports, owned: range) -> Array:
    """u_g of some displacements, those this rank owns, in the supports' coordinates, m.

    Raises:
        InputError: If there is no such field: gaps of joints that meet contradict each other.
    """
    from scipy.sparse import coo_matrix, vstack
    from scipy.sparse.linalg import lsqr

    field, largest = np.zeros(len(owned)), joints.gap.max(initial=0.0)
    if largest == 0.0:
        return field
    count = len(joints.gap)
    dofs, *parts = coefficients(joints, supports, np.arange(count))
    used = np.unique(dofs[dofs >= 0])
    row, place = np.nonzero(dofs >= 0)
    column = np.searchsorted(used, dofs[row, place])
    normal, tangential = (
        coo_matrix((part[row, place], (row, column)), (count, len(used))).tocsr() for part in parts
    )
    slips = vstack([normal, tangential]), np.append(joints.gap, np.zeros(count))
    for jumps, wanted in (slips, (normal, joints.gap)):
        found = lsqr(jumps, wanted, atol=1e-15, btol=1e-15, conlim=0.0, iter_lim=ITERATIONS)[0]
        missed = np.abs(jumps @ found - wanted)
        if missed.max() <= PRECISION * largest:
            break
    else:
        x, y = joints.position[np.argmax(missed)]
        raise InputError(
            f"joints that meet at ({x:g}, {y:g}) have initial gaps that contradict each other or a"
            " support; give all of them a gap"
        )
    mine = (used >= owned.start) & (used < owned.stop)
    field[used[mine] - owned.start] = found[mine]
    return field
