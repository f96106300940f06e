"""Limit loads of rigid blocks as linear programs: bounds on, and a check of, the elastic ones.

    max lambda   subject to   R^T (f_D + lambda f_L + B_N^T r_N + B_T^T r_T) = 0   (every body),
                              r_N >= 0,   |r_T| <= F r_N + g.

With given friction (F = 0) its value is the limit load, of rigid and of elastic blocks, and the
multipliers of equilibrium are the rigid motions of a collapse (R.K. Livesley, Int. J. Numer. Meth.
Eng. 12 (1978) 1853). With Coulomb friction it is the limit load for associative slip, an upper
bound; without friction it is a lower bound (D.C. Drucker, J. Appl. Mech. 21 (1954) 71).

On a straight face between two bodies only the resultants matter: the normal forces at its two ends
and one shear force are enough, whatever the mesh.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.discretization.rigid_motions import RigidBodies, motions
from fenics_contact.errors import SolverError
from fenics_contact.solvers.problem import Array

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class ProgramOptions:
    """Numbers of the linear programs.

    Attributes:
        collinear: Difference of direction, and offset over the structure's size, of one line.
        feasibility: HiGHS' primal and dual tolerance, forces in units of the largest dead load.
    """

    collinear: float = 1e-6
    feasibility: float = 1e-10


OPTIONS = ProgramOptions()


@dataclass(frozen=True)
class Faces:
    """Straight faces between two bodies.

    Attributes:
        ends: Joint points at their two ends, shape (faces, 2); equal if there is one.
        friction: Coulomb's coefficient, shape (faces,).
        strength: Given bound on the shear force of the whole face, shape (faces,), N/m.
        of_point: Face of every joint point.
    """

    ends: npt.NDArray[np.int64]
    friction: Array
    strength: Array
    of_point: npt.NDArray[np.int64]


def straight_faces(joints: Joints, strength: Array) -> Faces:
    """Faces: joint points grouped by bodies, law and line; with strengths of the points, N/m."""
    if len(joints.length) == 0:
        none = np.empty(0, dtype=np.int64)
        return Faces(none.reshape(0, 2), np.empty(0), np.empty(0), none)
    size = np.ptp(joints.position, axis=0).max() or 1.0
    offset = np.sum(joints.normal * (joints.position - joints.position[0]), axis=1) / size
    line = np.round(np.column_stack([joints.normal, offset]) / OPTIONS.collinear).astype(np.int64)
    keys = np.column_stack([joints.bodies, joints.law, line])
    face = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    order = np.lexsort((np.sum(joints.tangent * joints.position, axis=1), face))
    starts = np.flatnonzero(np.diff(face[order], prepend=-1))
    stops = np.append(starts[1:], len(order)) - 1
    ends = np.column_stack([order[starts], order[stops]])
    return Faces(ends, joints.friction[ends[:, 0]], np.bincount(face, strength).astype(float), face)


@dataclass(frozen=True)
class LimitBounds:
    """Values of the linear programs for one direction of the live load.

    Attributes:
        lower: Frictionless, not below 0; None if the dead load needs friction to stand.
        upper: Associative; infinite if nothing limits the load, None if it is not known.
    """

    lower: float | None
    upper: float | None

    def reversed(self) -> LimitBounds:
        """The bounds in the opposite sign of the live load."""
        return LimitBounds(*(None if b is None else -b + 0.0 for b in (self.upper, self.lower)))

    def __str__(self) -> str:
        if self.lower is None and self.upper is None:
            return "with unknown bounds"
        if self.lower is None:
            return f"at most {self.upper:.6g}"
        if self.upper is None:
            return f"at least {self.lower:.6g}"
        return f"between {self.lower:.6g} and {self.upper:.6g}"


@dataclass(frozen=True)
class _Optimum:
    """Load factor as `limit` gives it; if finite, rigid motions and pressure of joint points."""

    factor: float | None = None
    motion: Array | None = None
    pressure: Array | None = None


class RigidBlocks:
    """The linear programs of one structure, solved on rank 0."""

    def __init__(self, joints: Joints, bodies: RigidBodies, comm: MPI.Comm) -> None:
        """Take all joint points, the bodies' motions and loads, and the ranks to share results."""
        self._joints, self._bodies, self._comm = joints, bodies, comm
        self._known: dict[tuple[bool, bool], float | None] = {}
        dead, live = (float(np.abs(load).max(initial=0.0)) for load in (bodies.dead, bodies.live))
        self._force = dead or float(joints.shear_strength.max(initial=0.0)) or live or 1.0
        self._load = self._force / live if live else 1.0

    def limit(self, friction: bool = True) -> float | None:
        """Largest load factor: infinite where nothing limits it, None without equilibrium.

        With the scene's friction, Coulomb's taken as associative, or without any.
        """
        return self._on_root(lambda: self._limit(friction))

    def stands(self, friction: bool = True) -> bool:
        """Whether the dead load alone has an equilibrium."""
        return self._on_root(lambda: self._limit(friction, dead_only=True)) is not None

    def collapse(self, strength: Array) -> tuple[float | None, Array | None]:
        """Limit load as `limit` gives it, and collapse mode, with given friction.

        The mode consists of the bodies' rigid motions (a, b, c) about their centres, shape
        (bodies, 3), with f_L.v = 1; None unless the load factor is finite. `strength` bounds the
        shear forces at all joint points, N/m, on all ranks.
        """
        faces = straight_faces(self._joints, strength)
        faces = replace(faces, friction=np.zeros_like(faces.friction))
        found = self._on_root(lambda: self._solve(faces))
        return found.factor, found.motion

    def associative_pressure(self) -> Array | None:
        """Normal forces of the associative limit state at all joint points, N/m, on all ranks.

        They act at the ends of straight faces; None unless the load factor is finite.
        """
        return self._on_root(lambda: self._solve(self._faces(friction=True)).pressure)

    def bounds(self) -> LimitBounds:
        """Both bounds, solved on this rank alone, where and when they are shown.

        A program that fails leaves its bound unknown: by then there is a result to be shown.
        """
        bare = self._limit(friction=False, dead_only=True) is not None
        stands = bare or self._limit(friction=True, dead_only=True) is not None
        lower = self._shown(friction=False) if bare else None
        upper = self._shown(friction=True) if stands else np.inf
        return LimitBounds(None if lower is None else max(lower, 0.0), upper)

    def _shown(self, friction: bool) -> float | None:
        """A load factor to be shown, no -0.0; None if the program fails."""
        try:
            factor = self._limit(friction)
        except SolverError as error:
            _log.warning("a bound on the load factor is not known: %s", error)
            return None
        return None if factor is None else factor + 0.0

    def _limit(self, friction: bool, dead_only: bool = False) -> float | None:
        """Load factor of a program, solved once and on this rank alone."""
        key = friction, dead_only
        if key not in self._known:
            self._known[key] = self._solve(self._faces(friction), dead_only).factor
        return self._known[key]

    def _faces(self, friction: bool) -> Faces:
        faces = straight_faces(self._joints, self._joints.shear_strength)
        none = np.zeros_like(faces.friction)
        return faces if friction else replace(faces, friction=none, strength=none)

    def _on_root(self, solve: Callable[[], Any]) -> Any:
        """What a function returns on rank 0, on all ranks; its `SolverError` likewise."""
        answer, message = None, ""
        if self._comm.rank == 0:
            try:
                answer = solve()
            except SolverError as error:
                message = str(error)
        answer, message = self._comm.bcast((answer, message))
        if message:
            raise SolverError(message)
        return answer

    def _solve(self, faces: Faces, dead_only: bool = False) -> _Optimum:
        """Build a program and solve it.

        Variables: load factor; at both ends of every face multiples of the edges (1, F) and (1, -F)
        of Coulomb's cone, one of them where F = 0; the shear force that a face's strength bounds.
        """
        from scipy.sparse import diags, hstack

        joints, bodies = self._joints, self._bodies
        ends = faces.ends.T.ravel()
        friction = np.tile(faces.friction, 2)
        rough = np.flatnonzero(friction)
        normal = self._columns(ends, joints.normal)
        shear = self._columns(faces.ends[:, 0], joints.tangent)
        sliding = hstack([shear, shear]) @ diags(friction)
        dead, live = (
            np.einsum("bmk,bm->bk", bodies.free, load).ravel()
            for load in (bodies.dead / self._force, bodies.live * self._load / self._force)
        )
        edges = hstack([normal + sliding, (normal - sliding).tocsc()[:, rough]])
        points = np.append(ends, ends[rough])
        equilibrium = hstack([live[:, None], edges, shear]).tocsr()
        used = np.any(bodies.free != 0.0, axis=1).ravel()
        strength = faces.strength / self._force
        limits = [(0.0, 0.0) if dead_only else (None, None), *[(0.0, None)] * len(points)]
        limits += zip(-strength, strength, strict=True)
        answer = _largest_first(equilibrium[used], -dead[used], limits, dead_only)
        if answer.status != 0:
            return _Optimum(np.inf if answer.status == 3 else None)
        motion = np.zeros(len(used))
        motion[used] = answer.eqlin.marginals
        motion = np.einsum("bmk,bk->bm", bodies.free, motion.reshape(-1, 3))
        work = float(np.sum(motion * bodies.live))
        motion[:, 2] /= bodies.size
        forces = answer.x[1 : 1 + len(points)] * self._force
        pressure = np.bincount(points, forces, len(joints.length)).astype(float)
        factor = float(answer.x[0]) * self._load
        return _Optimum(factor, motion / work if work else None, pressure)

    def _columns(self, points: npt.NDArray[np.int64], directions: Array) -> Any:
        """Generalised forces on the bodies' free motions of unit forces at joint points."""
        from scipy.sparse import csc_matrix

        bodies, joints = self._bodies, self._joints
        column, side = np.nonzero(joints.bodies[points] != GROUND)
        point = points[column]
        body, sign = joints.bodies[point, side], 2.0 * side - 1.0
        motion = motions(joints.position[point] - bodies.centre[body], bodies.size)
        force = sign[:, None] * np.einsum("nim,ni->nm", motion, directions[point])
        values = np.einsum("nmk,nm->nk", bodies.free[body], force)
        rows = 3 * body[:, None] + np.arange(3)
        indices = rows.ravel(), np.repeat(column, 3)
        return csc_matrix((values.ravel(), indices), (3 * len(bodies.centre), len(points)))


def _largest_first(equilibrium: Any, right: Array, limits: list[Any], any_will_do: bool) -> Any:
    """HiGHS' answer with the largest first variable: of status 0, 2 infeasible, or 3 unbounded."""
    from scipy.optimize import linprog

    cost = np.zeros(equilibrium.shape[1])
    cost[0] = -1.0
    names = "primal_feasibility_tolerance", "dual_feasibility_tolerance"
    options: dict[str, Any] = dict.fromkeys(names, OPTIONS.feasibility)
    program = cost, None, None, equilibrium, right, limits
    # The interior point method is ten times as fast on large walls, but not where any equilibrium
    # will do: there the simplex method with Dantzig's plain pricing is.
    if any_will_do:
        options["simplex_dual_edge_weight_strategy"] = "dantzig"
    else:
        answer = linprog(*program, "highs-ipm", options=options)
        if answer.status == 0:
            return answer
    answer = linprog(*program, "highs-ds", options=options)  # tells infeasible from unbounded
    if answer.status not in (0, 2, 3):
        raise SolverError(f"rigid-block linear program failed: {answer.message}")
    return answer
