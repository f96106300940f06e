"""Rigid blocks without dilation, by a sequence of linear programs.

M. Gilbert, C. Casapulla, H.M. Ahmed, Computers & Structures 84 (2006) 873: every joint has a
fictitious cohesion and a shallower friction angle, which together give Coulomb's shear strength at
the normal force of the program before. Refined by the change of the load factor at which it stops.

Settings that suit it: slopes halved from the full friction down to 1e-3 of it, normal forces 0.6
of the new ones and 0.4 of those before, at most 100 programs; HiGHS' dual simplex, whose vertices
let it settle. Joint forces are not unique: what it ends in depends on which of them a program
returns; where it does not settle the mean of the last 20 load factors is the answer.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, diags, hstack, identity, vstack

from benchmarks.peers import rigid_lp
from benchmarks.peers.blocks import Answer, Blocks

Array = npt.NDArray[np.float64]

#: Solves one of the linear programs; see `program`.
Program = Callable[[csr_matrix, Array, float, Array], "Array | None"]

RESOLUTIONS = (1e-1, 1e-2, 1e-4, 1e-6)
version = rigid_lp.version

SLOPE, WEIGHT, PROGRAMS, LAST = 1e-3, 0.6, 100, 20


def solve(
    blocks: Blocks,
    resolution: float = 1e-6,
    deadline: float = math.inf,
    by: Program | None = None,
) -> Answer:
    """Iterate until the load factor stands still; variables: factor, normal forces, shear."""
    by = by or program
    faces, count = blocks.faces, len(blocks.faces.bodies)
    columns = [blocks.forces(end, faces.normal) for end in (0, 1)]
    live = csr_matrix(blocks.load(1.0, 0.0)[:, None])
    equilibrium = hstack([live, *columns, blocks.forces(0, faces.tangent)]).tocsr()
    dead = blocks.load(0.0, 1.0)
    normal, slope, factors = np.zeros(count), 1.0, [math.inf]
    while len(factors) <= PROGRAMS:
        if time.perf_counter() > deadline:
            return Answer("time-out")
        cohesion = (1.0 - slope) * blocks.friction * normal
        found = by(equilibrium, dead, slope * blocks.friction, cohesion)
        if found is None:
            return Answer("not converged")
        first, last, _ = found[1:].reshape(3, -1)
        weight = WEIGHT if len(factors) > 1 else 1.0
        normal = weight * (first + last) + (1.0 - weight) * normal
        factors.append(float(found[0]))
        still = abs(factors[-1] - factors[-2]) <= resolution * abs(factors[-1])
        if still and slope <= max(SLOPE, resolution):
            return Answer("limit", factors[-1])
        slope = max(0.5 * slope, SLOPE)
    return Answer("not converged", float(np.mean(factors[-LAST:])))


def program(equilibrium: csr_matrix, dead: Array, slope: float, cohesion: Array) -> Array | None:
    """Variables at the largest load factor with |t| <= cohesion + slope n."""
    count = len(cohesion)
    column, inclined = csr_matrix((count, 1)), diags(np.full(count, -slope))
    rows = [hstack([column, inclined, inclined, sign * identity(count)]) for sign in (1.0, -1.0)]
    cost = np.zeros(1 + 3 * count)
    cost[0] = -1.0
    free, pressed = (None, None), (0.0, None)
    limits = [free] + [pressed] * (2 * count) + [free] * count
    bound = np.tile(cohesion, 2)
    answer = linprog(cost, vstack(rows).tocsr(), bound, equilibrium, dead, limits, "highs-ds")
    return answer.x if answer.status == 0 else None
