"""Whether blocks in some poses can be in equilibrium at all, whatever the load factor."""

from __future__ import annotations

import numpy as np

from fenics_contact.faces.model import FaceModel
from fenics_contact.geometry.mesh import Array

#: Friction in space: so many tangents about the circle, outside of it.
TANGENTS = 16
#: Missing forces above this part of a typical force are a proof.
MISSING = 1e-6


def fall(model: FaceModel) -> Array | None:
    """Motion of the blocks that no forces and no load factor hold; None if some forces do.

    The least sum of forces that are missing in equilibrium,

        min |r|_1,   H^T x + f_D + lambda f_L = r,   n >= 0,   |t| <= c + F n,

    a linear program; discs of friction are taken larger, as polygons around them, so that what is
    missing is missed with discs, too. Its multipliers are the motion.
    """
    from scipy.optimize import linprog
    from scipy.sparse import bmat, csr_matrix, diags, identity, kron

    units, size = model.shape
    shears = model.shears
    angles = np.arange(TANGENTS) * 2.0 * np.pi / TANGENTS
    ways = np.column_stack([np.cos(angles), np.sin(angles)])[:, :shears]
    ways = ways if shears > 1 else np.array([[1.0], [-1.0]])
    pressed = np.tile([[1.0, *np.zeros(shears)]], (len(ways), 1))
    sheared = np.hstack([np.zeros((len(ways), 1)), ways])
    cones = kron(identity(units), sheared) - kron(diags(model.friction), pressed)
    count = len(model.dead)
    typical = model.force
    one = identity(count)
    balance = bmat([[model.transposed, csr_matrix(model.live[:, None] / model.load), one, -one]])
    none = csr_matrix((cones.shape[0], 1 + 2 * count))
    found = linprog(
        np.concatenate([np.zeros(units * size + 1), np.ones(2 * count)]),
        A_ub=bmat([[cones, none]]),
        b_ub=np.repeat(model.strength / typical, len(ways)),
        A_eq=balance,
        b_eq=-model.dead / typical,
        bounds=[
            *[(0.0 if k % size == 0 else None, None) for k in range(units * size)],
            (None, None),
            *[(0.0, None)] * (2 * count),
        ],
        method="highs",
    )
    if found.status != 0 or found.fun <= MISSING:
        return None
    return np.asarray(found.eqlin.marginals)
