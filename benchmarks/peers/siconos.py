"""Rigid blocks without dilation, by contact dynamics at rest: Siconos.

From rest its nonsmooth Gauss-Seidel method (fc2d NSGS) finds contact forces r and accelerations,
v = W r + q with W = H^T M^-1 H and Coulomb's law, at a given load factor. The largest factor at
which no block moves is found by bisection below the associative bound; refined by the bracket.

Settings that suit it: contacts at both ends of every face; any masses will do, as equilibrium alone
is asked for: M is the diagonal of H H^T; tolerance 1e-10, rounds of 5000 sweeps, at most 120, ended
when the unbalanced force is below 1e-4 of the heaviest block; started from the last forces that
stood. Sure signs are equilibrium, or the solver's convergence with blocks that move.
"""

from __future__ import annotations

import importlib.util
import math
import time
from importlib import metadata
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, diags, hstack

from benchmarks.peers import rigid_lp
from benchmarks.peers.blocks import Answer, Blocks

RESOLUTIONS = (1e-1, 1e-2, 1e-3)
MOVES, TOLERANCE, SWEEPS, ROUNDS = 1e-4, 1e-10, 5000, 120


def version() -> str:
    """Version of the library; empty where there is none."""
    found = importlib.util.find_spec("siconos")
    return f"Siconos {metadata.version('siconos')}" if found else ""


class ContactForces:
    """Contact forces at a given load factor."""

    def __init__(self, blocks: Blocks) -> None:
        """Set up W and the friction of all contacts."""
        import siconos.numerics

        self.library: Any = siconos.numerics
        faces = blocks.faces
        pairs = [(end, way) for end in (0, 1) for way in (faces.normal, faces.tangent)]
        columns = [blocks.forces(end, way) for end, way in pairs]
        order = np.arange(4 * len(faces.bodies)).reshape(4, -1).T.ravel()  # normal, shear, ...
        self.h = hstack(columns).tocsc()[:, order].tocsr()
        self.dead, self.live = blocks.load(0.0, -1.0), blocks.load(1.0, 0.0)
        self.mass = np.asarray(self.h.multiply(self.h).sum(axis=1)).ravel()
        compliance = csc_matrix(self.h.T @ diags(1.0 / self.mass) @ self.h)
        compliance.indices = compliance.indices.astype(np.int64)
        compliance.indptr = compliance.indptr.astype(np.int64)
        # The block matrix belongs to the library's other objects: keep all of them.
        _, self.block_matrix = self.library.SBM_from_csparse(2, compliance)
        self.matrix = self.library.NM_new_SBM(len(order), len(order), self.block_matrix)
        self.friction = np.full(len(order) // 2, blocks.friction)
        self.forces = np.zeros(len(order))

    def stands(self, factor: float, deadline: float) -> tuple[bool, bool]:
        """Whether no block moves, and whether that is sure."""
        library, load = self.library, self.dead + factor * self.live
        free = self.h.T @ (load / self.mass)
        problem = library.FrictionContactProblem(2, self.matrix, free, self.friction)
        options = library.SolverOptions(library.SICONOS_FRICTION_2D_NSGS)
        options.iparam[library.SICONOS_IPARAM_MAX_ITER] = SWEEPS
        options.dparam[library.SICONOS_DPARAM_TOL] = TOLERANCE
        forces = self.forces.copy()
        for _ in range(ROUNDS):
            failed = library.fc2d_driver(problem, forces, np.zeros_like(forces), options)
            if np.abs(load + self.h @ forces).max() < MOVES:
                self.forces = forces  # start from here next time
                return True, True
            if failed == 0 or time.perf_counter() > deadline:
                return False, failed == 0
        return False, False


def solve(blocks: Blocks, resolution: float = 1e-3, deadline: float = math.inf) -> Answer:
    """Bisect between no live load and the associative bound."""
    bound = rigid_lp.solve(blocks)
    if bound.status != "limit":
        return bound
    lower, upper, sure = 0.0, bound.load_factor, True
    contact = ContactForces(blocks)
    if not contact.stands(0.0, deadline)[0]:
        return Answer("not converged")
    while upper - lower > resolution * upper:
        middle = 0.5 * (lower + upper)
        stands, settled = contact.stands(middle, deadline)
        if time.perf_counter() > deadline:
            return Answer("time-out")
        lower, upper = (middle, upper) if stands else (lower, middle)
        sure = sure if stands else settled
    return Answer("limit" if sure else "not converged", 0.5 * (lower + upper))
