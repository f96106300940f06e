"""The sequence of linear programs of `gilbert`, solved by Clarabel's interior point method.

Its joint forces are in the middle of what a program allows, so that the sequence settles in fewer
programs than from vertex to vertex, at a higher load factor. Settings: Clarabel's own.
"""

from __future__ import annotations

import math
from importlib import metadata, util

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_matrix, csr_matrix, diags, hstack, identity, vstack

from benchmarks.peers import gilbert
from benchmarks.peers.blocks import Answer, Blocks

Array = npt.NDArray[np.float64]

RESOLUTIONS = gilbert.RESOLUTIONS


def version() -> str:
    """Version of the solver; empty where there is none."""
    return f"Clarabel {metadata.version('clarabel')}" if util.find_spec("clarabel") else ""


def solve(blocks: Blocks, resolution: float = 1e-6, deadline: float = math.inf) -> Answer:
    """Iterate until the load factor stands still."""
    return gilbert.solve(blocks, resolution, deadline, program)


def program(equilibrium: csr_matrix, dead: Array, slope: float, cohesion: Array) -> Array | None:
    """Variables at the largest load factor with |t| <= cohesion + slope n and n >= 0."""
    import clarabel

    count = len(cohesion)
    column, inclined = csr_matrix((count, 1)), diags(np.full(count, -slope))
    rows = [hstack([column, inclined, inclined, sign * identity(count)]) for sign in (1.0, -1.0)]
    pressed = hstack(
        [csr_matrix((2 * count, 1)), -identity(2 * count), csr_matrix((2 * count, count))]
    )
    size = equilibrium.shape[1]
    cost = np.zeros(size)
    cost[0] = -1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    answer = clarabel.DefaultSolver(
        csc_matrix((size, size)),
        cost,
        vstack([equilibrium, *rows, pressed]).tocsc(),
        np.concatenate([dead, np.tile(cohesion, 2), np.zeros(2 * count)]),
        [clarabel.ZeroConeT(len(dead)), clarabel.NonnegativeConeT(4 * count)],
        settings,
    ).solve()
    solved = "Solved" in str(answer.status)
    return np.array(answer.x) if solved else None
