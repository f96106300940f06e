"""Whether blocks in some poses can be in equilibrium at all, whatever the load factor."""

from __future__ import annotations

import numpy as np

from fenics_contact.faces.model import FaceModel
from fenics_contact.geometry.mesh import Array

#: Friction in space: so many tangents about the circle, outside of it.
TANGENTS = 16
#: Work of the dead load above this part of a typical force, in motions up to 1, is a proof.
PROVED = 1e-6


def fall(model: FaceModel) -> Array | None:
    """Motion of the blocks that no forces and no load factor hold; None if there is none.

    The linear program, with slip s of units,

        max f_D . v - c . s,   f_L . v = 0,   |v_T| <= s,   F s <= v_N,   |v| <= 1:

    any forces would do the work -f_D . v in such a motion, and they do c . s at most. Slip is
    measured by a polygon outside of its circle, so that it is not too small.
    """
    from scipy.optimize import linprog
    from scipy.sparse import bmat, csr_matrix, diags, identity, kron

    units, size = model.shape
    ways = np.array([[1.0], [-1.0]])
    if model.shears > 1:
        angles = np.arange(TANGENTS) * 2.0 * np.pi / TANGENTS
        ways = np.column_stack([np.cos(angles), np.sin(angles)]) / np.cos(np.pi / TANGENTS)
    along = np.hstack([np.zeros((len(ways), 1)), ways])
    across = np.eye(1, size)
    one = identity(units)
    cones = bmat(
        [
            [kron(one, along) @ model.motion, -kron(one, np.ones((len(ways), 1)))],
            [-kron(one, across) @ model.motion, diags(model.friction)],
        ]
    )
    none = np.zeros(units)
    found = linprog(
        np.append(-model.dead, model.strength) / model.force,
        A_ub=cones,
        b_ub=np.zeros(cones.shape[0]),
        A_eq=csr_matrix(np.append(model.live / model.load, none)[None]),
        b_eq=[0.0],
        bounds=[(-1.0, 1.0)] * len(model.dead) + [(0.0, None)] * units,
        method="highs",
    )
    if found.status != 0 or found.fun > -PROVED:
        return None
    return np.asarray(found.x[: len(model.dead)])
