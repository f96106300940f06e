"""Rigid blocks, associative friction (slip opens the joint), by one linear program.

Another problem than Coulomb's: an upper bound, exact where hinges alone decide. Normal forces act
at both ends of a face, inside Coulomb's cone (R.K. Livesley, Int. J. Numer. Meth. Eng. 12 (1978)
1853). Settings: scipy's HiGHS with its own defaults, forces in units of the heaviest block's
weight. There is nothing to refine.
"""

from __future__ import annotations

import numpy as np
import scipy
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, hstack

from benchmarks.peers.blocks import Answer, Blocks

RESOLUTIONS, STATUS = (1,), {0: "limit", 2: "unstable", 3: "unbounded"}


def version() -> str:
    """Version of scipy, whose HiGHS solves the program."""
    return f"scipy {scipy.__version__}"


def solve(blocks: Blocks, resolution: float = 1, deadline: float = np.inf) -> Answer:
    """Largest load factor with equilibrium inside the cones."""
    del resolution, deadline
    faces = blocks.faces
    edges = [
        blocks.forces(end, faces.normal + sign * blocks.friction * faces.tangent)
        for end in (0, 1)
        for sign in (1.0, -1.0)
    ]
    equilibrium = hstack([csr_matrix(blocks.load(1.0, 0.0)[:, None]), *edges]).tocsr()
    cost = np.zeros(equilibrium.shape[1])
    cost[0] = -1.0
    limits = [(None, None)] + [(0.0, None)] * (len(cost) - 1)
    weight = blocks.load(0.0, 1.0)
    answer = linprog(cost, A_eq=equilibrium, b_eq=weight, bounds=limits, method="highs")
    status = STATUS.get(answer.status, "not converged")
    return Answer(status, float(answer.x[0]) if status == "limit" else np.nan)
