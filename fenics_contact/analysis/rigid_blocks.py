"""Limit loads of rigid blocks as linear programs: bounds on, and a check of, the elastic ones.

    max lambda   subject to   R^T (f_D + lambda f_L + B_N^T r_N + B_T^T r_T) = 0   (every body),
                              r_N >= 0,   |r_T| <= F r_N + g.

With given friction (F = 0) its value is the limit load, of rigid and of elastic blocks, and the
multipliers of equilibrium are the rigid motions of a collapse (E. Charnes, H.J. Greenberg's
duality; see R.K. Livesley, Int. J. Numer. Meth. Eng. 12 (1978) 1853). With
Coulomb friction it is the limit load for associative slip, an upper bound; without friction it is
a lower bound (D.C. Drucker, J. Appl. Mech. 21 (1954) 71).

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
from fenics_contact.discretization.rigid_motions import RigidBodies
from fenics_contact.errors import SolverError

Array = npt.NDArray[np.float64]

_log = logging.getLogger("fenics_contact")

#: Directions and offsets of faces on one line agree to this fraction.
COLLINEAR = 1e-6


@dataclass(frozen=True)
class Faces:
    """Straight faces between two bodies.

    Attributes:
        ends: Joint points at the two ends of every face, shape (faces, 2); equal if there is one.
        friction: Coulomb's coefficient, shape (faces,).
        strength: Given bound on the shear force of the whole face, shape (faces,), N/m.
        of_point: Face of every joint point.
    """

    ends: npt.NDArray[np.int64]
    friction: Array
    strength: Array
    of_point: npt.NDArray[np.int64]


def straight_faces(joints: Joints, strength: Array) -> Faces:
    """Group joint points by bodies, law and line.

    Args:
        joints: All joint points.
        strength: Given bound on the shear force at every point, N/m.
    """
    if len(joints.length) == 0:
        none = np.empty(0, dtype=np.int64)
        return Faces(none.reshape(0, 2), np.empty(0), np.empty(0), none)
    size = np.ptp(joints.position, axis=0).max() or 1.0
    offset = np.sum(joints.normal * (joints.position - joints.position[0]), axis=1) / size
    line = np.round(np.column_stack([joints.normal, offset]) / COLLINEAR).astype(np.int64)
    keys = np.column_stack([joints.bodies, joints.law, line])
    _, face = np.unique(keys, axis=0, return_inverse=True)
    face = face.ravel()
    along = np.sum(joints.tangent * joints.position, axis=1)
    order = np.lexsort((along, face))
    starts = np.flatnonzero(np.diff(face[order], prepend=-1))
    stops = np.append(starts[1:], len(order)) - 1
    ends = np.column_stack([order[starts], order[stops]])
    return Faces(ends, joints.friction[ends[:, 0]], np.bincount(face, strength).astype(float), face)


@dataclass(frozen=True)
class LimitBounds:
    """Values of the linear programs for one direction of the live load.

    Attributes:
        lower: Frictionless, not below 0; None if the dead load needs friction to stand.
        upper: Associative; infinite if nothing limits the load, None if it is not known. (With the
            live load reversed, the two change places and signs.)
        stands: Whether the dead load alone has an equilibrium with associative friction.
        stands_frictionless: Whether it has one without friction.
    """

    lower: float | None
    upper: float | None
    stands: bool
    stands_frictionless: bool

    def reversed(self) -> LimitBounds:
        """The bounds in the opposite sign of the live load."""
        return LimitBounds(
            lower=None if self.upper is None else -self.upper + 0.0,
            upper=None if self.lower is None else -self.lower + 0.0,
            stands=self.stands,
            stands_frictionless=self.stands_frictionless,
        )

    def __str__(self) -> str:
        if self.lower is None and self.upper is None:
            return "with unknown bounds"
        if self.lower is None:
            return f"at most {self.upper:.6g}"
        if self.upper is None:
            return f"at least {self.lower:.6g}"
        return f"between {self.lower:.6g} and {self.upper:.6g}"


class RigidBlocks:
    """The linear programs of one structure, solved on rank 0."""

    def __init__(self, joints: Joints, bodies: RigidBodies, comm: MPI.Comm) -> None:
        """Set up equilibrium of all bodies.

        Args:
            joints: All joint points.
            bodies: Rigid motions and loads.
            comm: Ranks that share the results.
        """
        self._joints = joints
        self._bodies = bodies
        self._comm = comm
        self._known: dict[tuple[bool, bool], float | None] = {}
        force = np.abs(bodies.dead).max(initial=0.0) or joints.shear_strength.max(initial=0.0)
        self._force = float(force) or float(np.abs(bodies.live).max(initial=0.0)) or 1.0
        live = float(np.abs(bodies.live).max(initial=0.0))
        self._load = self._force / live if live else 1.0

    def limit(self, friction: bool = True) -> float | None:
        """Largest load factor in the direction of the live load.

        Args:
            friction: With the scene's friction, Coulomb's taken as associative, or without any.

        Returns:
            The load factor; infinite where nothing limits it, None where there is no equilibrium.
        """
        return self._on_root(lambda: self._limit(friction))

    def collapse(self, strength: Array) -> tuple[float | None, Array | None]:
        """Limit load and collapse mode with given friction at all joint points.

        Args:
            strength: Bounds on the shear forces at all joint points, N/m, on all ranks.

        Returns:
            The load factor as `limit` gives it, and the bodies' rigid motions (a, b, c) about
            their centres, shape (bodies, 3), with f_L.v = 1; None unless the factor is finite.
        """
        faces = straight_faces(self._joints, strength)
        faces = replace(faces, friction=np.zeros_like(faces.friction))
        return self._on_root(lambda: self._solve(faces)[:2])

    def associative_pressure(self) -> Array | None:
        """Normal forces of the associative limit state at all joint points, N/m, on all ranks.

        They act at the ends of straight faces; None unless the load factor is finite.
        """
        return self._on_root(self._associative_pressure)

    def _associative_pressure(self) -> Array | None:
        faces = self._faces(friction=True)
        forces = self._solve(faces)[2]
        if forces is None:
            return None
        pressure = np.zeros(len(self._joints.length))
        count = len(faces.ends)
        for side in (0, 1):
            mine = forces[side * count : (side + 1) * count]
            np.add.at(pressure, faces.ends[:, side], mine)
        return pressure

    def stands(self, friction: bool = True) -> bool:
        """Whether the dead load alone has an equilibrium."""
        return self._on_root(lambda: self._limit(friction, dead_only=True)) is not None

    def _limit(self, friction: bool, dead_only: bool = False) -> float | None:
        """Load factor of a program, solved once and on this rank alone."""
        key = friction, dead_only
        if key not in self._known:
            self._known[key] = self._solve(self._faces(friction), dead_only)[0]
        return self._known[key]

    def _faces(self, friction: bool) -> Faces:
        faces = straight_faces(self._joints, self._joints.shear_strength)
        if friction:
            return faces
        none = np.zeros_like(faces.friction)
        return replace(faces, friction=none, strength=none)

    def bounds(self) -> LimitBounds:
        """All bounds at once, solved on this rank alone, where and when they are shown.

        A program that fails leaves its bound unknown: by then there is a result to be shown.
        """
        bare = self._limit(friction=False, dead_only=True) is not None
        stands = bare or self._limit(friction=True, dead_only=True) is not None
        lower = self._shown(friction=False) if bare else None
        upper = self._shown(friction=True) if stands else np.inf
        return LimitBounds(
            lower=None if lower is None else max(lower, 0.0) + 0.0,
            upper=None if upper is None else upper + 0.0,
            stands=stands,
            stands_frictionless=bare,
        )

    def _shown(self, friction: bool) -> float | None:
        """A load factor to be shown; None if the program fails."""
        try:
            return self._limit(friction)
        except SolverError as error:
            _log.warning("a bound on the load factor is not known: %s", error)
            return None

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

    def _solve(
        self, faces: Faces, dead_only: bool = False
    ) -> tuple[float | None, Array | None, Array | None]:
        """Load factor, rigid motions, and normal forces at the first and last ends of all faces.

        Variables: load factor; at both ends of every face multiples of the edges (1, +-F) of
        Coulomb's cone; and the shear force of every face that its strength bounds.
        """
        from scipy.sparse import coo_matrix, diags, hstack

        joints, bodies = self._joints, self._bodies
        first, last = faces.ends.T
        free = bodies.free
        live = np.einsum("bmk,bm->bk", free, bodies.live).ravel() * self._load / self._force
        dead = np.einsum("bmk,bm->bk", free, bodies.dead).ravel() / self._force
        normal = hstack([self._columns(end, joints.normal[end]) for end in (first, last)])
        shear = self._columns(first, joints.tangent[first])
        sliding = hstack([shear @ diags(faces.friction)] * 2).tocsc()
        rough = np.flatnonzero(np.tile(faces.friction, 2))  # elsewhere both edges are one
        up, down = (normal + sliding).tocsc(), (normal - sliding).tocsc()[:, rough]
        equilibrium = hstack([coo_matrix(live[:, None]), up, down, shear]).tocsr()
        used = np.any(free != 0.0, axis=1).ravel()
        strength = faces.strength / self._force
        edges = up.shape[1] + len(rough)
        limits = [(0.0, 0.0) if dead_only else (None, None), *[(0.0, None)] * edges]
        limits += zip(-strength, strength, strict=True)
        answer = self._linprog(equilibrium[used], -dead[used], limits)
        if answer is None or np.isinf(answer.x[0]):
            return (None if answer is None else np.inf), None, None
        motion = np.zeros(len(used))
        motion[used] = answer.eqlin.marginals
        motion = np.einsum("bmk,bk->bm", free, motion.reshape(-1, 3))
        work = float(np.sum(motion * bodies.live))
        motion[:, 2] /= bodies.size
        pressure, more = np.split(answer.x[1 : 1 + edges] * self._force, [up.shape[1]])
        pressure[rough] += more
        factor = float(answer.x[0]) * self._load
        return factor, motion / work if work else None, pressure

    def _linprog(self, equilibrium: Any, right: Array, limits: list[Any]) -> Any:
        """HiGHS' answer; None if there is no equilibrium, x infinite if nothing limits the load."""
        from scipy.optimize import linprog

        cost = np.zeros(equilibrium.shape[1])
        cost[0] = -1.0
        options: dict[str, Any] = {
            "primal_feasibility_tolerance": 1e-10,
            "dual_feasibility_tolerance": 1e-10,
        }
        # The interior point method is ten times as fast on large walls, but not where any
        # equilibrium will do: there Dantzig's plain pricing does, at down to an eighth of the price
        # of steepest edges. The simplex method tells infeasible from unbounded more surely.
        any_will_do = limits[0] == (0.0, 0.0)
        if any_will_do:
            options["simplex_dual_edge_weight_strategy"] = "dantzig"
        for method in ("highs-ds",) if any_will_do else ("highs-ipm", "highs-ds"):
            answer = linprog(cost, None, None, equilibrium, right, limits, method, options=options)
            if answer.status == 0:
                return answer
            if method == "highs-ipm":
                continue
            if answer.status == 2:
                return None
            if answer.status == 3:
                answer.x = np.array([np.inf])
                return answer
        raise SolverError(f"rigid-block linear program failed: {answer.message}")

    def _columns(self, points: npt.NDArray[np.int64], direction: Array) -> Any:
        """Generalised forces on the bodies' free motions of unit forces at joint points."""
        from scipy.sparse import coo_matrix

        bodies, joints = self._bodies, self._joints
        rows, columns, values = [], [], []
        for side, sign in ((0, -1.0), (1, 1.0)):
            kept = np.flatnonzero(joints.bodies[points, side] != GROUND)
            body = joints.bodies[points[kept], side]
            arm = joints.position[points[kept]] - bodies.centre[body]
            force = sign * direction[kept]
            moment = (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]) / bodies.size
            general = np.einsum("nmk,nm->nk", bodies.free[body], np.column_stack([force, moment]))
            rows.append((3 * body[:, None] + np.arange(3)).ravel())
            columns.append(np.repeat(kept, 3))
            values.append(general.ravel())
        shape = (3 * len(bodies.centre), len(points))
        indices = (np.concatenate(rows), np.concatenate(columns))
        return coo_matrix((np.concatenate(values), indices), shape)
