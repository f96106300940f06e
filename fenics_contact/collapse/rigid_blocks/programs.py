"""Limit loads of rigid blocks as linear programs: bounds on, and a check of, the elastic ones.

    max lambda   subject to   R^T (f_D + lambda f_L + B_N^T r_N + B_T^T r_T) = 0   (every body),
                              r_N >= 0,   |r_T| <= C r_N + g.

The multipliers of equilibrium are rigid motions that open joints by C |slip| at least (R.K.
Livesley, Int. J. Numer. Meth. Eng. 12 (1978) 1853). With the dilatancy C = D and given friction g
(`joint_law`) the value is the limit load, of rigid and of elastic blocks, and they are its
collapse. With C = F and g = c it is the limit load for associative slip, an upper bound; without
friction it is a lower bound (D.C. Drucker, J. Appl. Mech. 21 (1954) 71).

HiGHS may leave open whether a program has a solution. Then the least missing forces are asked for,

    min |s|_1   subject to   R^T (f + B_N^T r_N + B_T^T r_T) + s = 0,   r_N, r_T as above,

which have an answer: f = f_D tells whether the dead load has an equilibrium, f = f_L with g = 0
whether nothing limits the live load. The multipliers of missing forces are motions of the blocks
by which the loads do work and no joint resists (Farkas' lemma): how the blocks fall.

On a straight face between two bodies only the resultants matter: the normal forces at its two ends,
with their friction, and one shear force by given strengths are enough, whatever the mesh. Each side
carries them where its nodes are: across a gap these are two lines, as far apart all along.

Where joints crush the programs are no longer linear, and the face engine solves them (`faces`): its
mode proves the end. Whether loads stand is asked as the largest part of them that does.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.collapse.rigid_blocks.linear_program import LinearProgram, least_missing
from fenics_contact.collapse.rigid_blocks.lower_end import GivenFriction, LeastForces, lower_end
from fenics_contact.discretization.faces import Faces, relative_motions, straight_faces
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.rigid_motions import RigidBodies
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.associative import associative_end, crushed_by
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.results.bounds import LimitBounds
from fenics_contact.solvers.highs import Beside
from fenics_contact.solvers.problem import Array

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class ProgramOptions:
    """Numbers of the linear programs.

    Attributes:
        rounding: Missing forces in units of the largest dead load, summed, that count as none.
        large: Unknowns above which a program is solved in a process of its own: a second or more.
    """

    rounding: float = 1e-8
    large: int = 5000


OPTIONS = ProgramOptions()

#: The interior point method is ten times as fast as the simplex method on large walls.
FIRST_METHOD = "highs-ipm"


@dataclass(frozen=True)
class _Optimum:
    """Load factor as `limit` gives it; if finite, rigid motions."""

    factor: float | None = None
    motion: Array | None = None


@dataclass(frozen=True)
class _Program:
    """Equilibrium E x + f_D + lambda f_L = 0 of the bodies in their free motions.

    The unknowns x are, at both ends of every face, multiples of the edges (1, F) and (1, -F) of
    Coulomb's cone, one of them where F = 0; then the shear force that a face's strength bounds.
    `carried` is the most N of every face, infinite where it does not crush; None: nowhere.
    """

    joints: Joints
    bodies: RigidBodies
    faces: Faces
    carried: Array | None = None

    @cached_property
    def _ends(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Ends of faces; those of them with friction."""
        return self.faces.ends.T.ravel(), np.flatnonzero(np.tile(self.faces.law.friction, 2))

    @cached_property
    def _used(self) -> npt.NDArray[np.bool_]:
        """Motions that supports leave free, among three of every body."""
        return np.any(self.bodies.free != 0.0, axis=1).ravel()

    @property
    def equations(self) -> int:
        """Number of equations of equilibrium."""
        return int(np.count_nonzero(self._used))

    @cached_property
    def forces(self) -> Any:
        """E, sparse."""
        from scipy.sparse import diags, hstack

        (ends, rough), whole = self._ends, (self.joints, self.bodies)
        normal = relative_motions(*whole, ends, self.joints.normal).T
        shear = relative_motions(*whole, ends, self.joints.tangent).T.tocsc()
        sliding = shear @ diags(np.tile(self.faces.law.friction, 2))
        given = shear[:, : len(self.faces.ends)]
        columns = hstack([normal + sliding, (normal - sliding).tocsc()[:, rough], given])
        return columns.tocsr()[self._used]

    def load(self, resultants: Array) -> Array:
        """A load in the rows of E, from its resultants on the bodies, shape (bodies, 3)."""
        return np.einsum("bmk,bm->bk", self.bodies.free, resultants).ravel()[self._used]

    def limits(self, unit: float) -> list[tuple[float | None, float | None]]:
        """Least and largest x, forces in a unit; an infinite one leaves the strengths out.

        Then faces that crush carry nothing.
        """
        ends, rough = self._ends
        strength = self.faces.law.strength / unit
        most: list[float | None] = [None] * (len(ends) + len(rough))
        if self.carried is not None:
            crushes = self.carried < np.inf
            carried = np.tile(np.where(crushes, 0.0, -1.0), 2)
            carried[np.tile(crushes, 2)] = np.tile(self.carried[crushes] / unit, 2)
            most = [one if one >= 0.0 else None for one in [*carried, *carried[rough]]]
        return [(0.0, one) for one in most] + [*zip(-strength, strength, strict=True)]

    def point_forces(self, x: Array) -> Array:
        """Normal and shear forces at the ends of faces, as an array of all points (2, points)."""
        ends, rough = self._ends
        forward, edges, bound = np.split(x, [len(ends), len(ends) + len(rough)])
        backward = np.bincount(rough, edges, len(ends)).astype(float)
        shear = np.tile(self.faces.law.friction, 2) * (forward - backward)
        shear[: len(bound)] += bound
        count = len(self.joints.length)
        return np.stack([np.bincount(ends, f, count) for f in (forward + backward, shear)])

    def pressing(self, weights: Array) -> Array:
        """Weighted sum of the faces' normal forces, as coefficients of x."""
        _, rough = self._ends
        ends = np.tile(weights, 2)
        return np.concatenate([ends, ends[rough], np.zeros(len(weights))])

    def face_forces(self, x: Array) -> Array:
        """Normal forces of the faces, in the unit of x."""
        ends, rough = self._ends
        forward, edges, _ = np.split(x, [len(ends), len(ends) + len(rough)])
        normal = forward + np.bincount(rough, edges, len(ends))
        return np.asarray(normal.reshape(2, -1).sum(axis=0))

    def motions(self, multipliers: Array) -> Array:
        """Rigid motions (a, b, c) of all bodies from multipliers of equilibrium."""
        motion = np.zeros(len(self._used))
        motion[self._used] = multipliers
        motion = np.einsum("bmk,bk->bm", self.bodies.free, motion.reshape(-1, 3))
        motion[:, 2] /= self.bodies.size
        return motion


def _wait_on() -> None:
    """Wait for a program, however long it takes."""


class RigidBlocks:
    """The linear programs of one structure, solved on rank 0."""

    @classmethod
    def of(
        cls, whole: Layout, sign: float = 1.0, patient: Callable[[], None] = _wait_on
    ) -> RigidBlocks:
        """Those of a structure, with its live load or the reverse of it (sign -1)."""
        planar = PlanarFaces.of(whole, sign)
        crushes = planar.model if np.any(planar.model.crushing) else None
        comm = whole.scene.comm
        return cls(planar.joints, planar.bodies, comm, planar.faces, crushes, patient)

    def __init__(
        self,
        joints: Joints,
        bodies: RigidBodies,
        comm: MPI.Comm,
        faces: Faces | None = None,
        model: FaceModel | None = None,
        patient: Callable[[], None] = _wait_on,
    ) -> None:
        """Take all joint points, the bodies' motions and loads, and the ranks to share results.

        Faces have the friction of the scene where none are given. Where some crush, `model` has
        them for the face engine.
        `patient` is called now and then on rank 0 while a large program is solved, and may raise
        `Stopped`.
        """
        faces = faces or straight_faces(joints)
        self._joints = joints
        self._bodies = bodies
        self._comm = comm
        self._patient = patient
        self._begun: Beside | None = None
        self._model = model
        carried = None
        if model is not None:
            carried = np.full(len(model.crushing), np.inf)
            np.divide(0.5, model.crushing, out=carried, where=model.crushing > 0.0)
        self._program = _Program(joints, bodies, faces, carried)
        dead, live = (float(np.abs(load).max(initial=0.0)) for load in (bodies.dead, bodies.live))
        self._force = dead or float(joints.shear_strength.max(initial=0.0)) or live or 1.0
        self._load = self._force / live if live else 1.0

    def __getstate__(self) -> dict[str, Any]:
        """The programs and what was solved of them, without ranks and processes."""
        alone = {"_comm": self._comm.size, "_patient": _wait_on, "_begun": None}
        return vars(self) | alone

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _comm=compat.comm_of(state["_comm"]))

    def __deepcopy__(self, _: object) -> RigidBlocks:
        return self  # nothing changes them

    @cached_property
    def frictionless(self) -> RigidBlocks:
        """The same blocks without friction."""
        faces = self._program.faces
        faces = replace(faces, law=faces.law.frictionless())
        model = self._model
        if model is not None:
            law = faces.law
            none = law.friction
            model = replace(model, strength=law.strength, friction=none, dilatancy=none)
        whole = self._joints, self._bodies, self._comm
        return RigidBlocks(*whole, faces, model, self._patient)

    @property
    def crushes(self) -> bool:
        """Whether some face has a compressive strength."""
        return self._model is not None

    def limit(self) -> float | None:
        """Largest load factor: infinite where nothing limits it, None without equilibrium.

        Coulomb's friction is taken as associative.
        """
        return self._on_root(lambda: self._limit)

    def is_unlimited(self) -> bool:
        """Whether it is proved that nothing limits the load; HiGHS may find no answer at all."""
        try:
            return self.limit() == np.inf
        except SolverError as error:
            _log.info("  not proved unlimited: %s", error)
            return False

    def begin(self) -> None:
        """Begin to solve for the limit beside other work, if the program is large; on rank 0."""
        if self._comm.rank == 0 and self._is_large:
            largest = self._largest_program(self._program)
            self._begun = Beside(*largest.arguments(FIRST_METHOD))

    def limit_so_far(self) -> float | None:
        """The limit, on this rank alone, if it is known or takes no time; else None."""
        begun = self._begun is not None and self._begun.is_solved
        if begun or "_upper" in vars(self) or not self._is_large:
            return self._upper
        return None

    @cached_property
    def _upper(self) -> float | None:
        """The limit to be shown."""
        return self._shown()

    @property
    def _is_large(self) -> bool:
        """Whether the program takes longer than to start a process for it."""
        return len(self._program.limits(1.0)) > OPTIONS.large

    def stands(self) -> bool:
        """Whether the dead load alone has an equilibrium."""
        return self.fall() is None

    def fall(self, load_factor: float = 0.0) -> Array | None:
        """Rigid motions (a, b, c) of the bodies by which the loads fall; None if they stand.

        Shape (bodies, 3), about their centres. No joint resists them, with associative friction:
        they prove that there is no equilibrium under the dead load and this multiple of the live
        load.
        """
        if load_factor == 0.0:
            return self._on_root(lambda: self._fall)
        return self._on_root(lambda: self._fall_under(load_factor))

    def wedging(self) -> Array | None:
        """Forces (normal, shear) at all joint points that balance the live load alone, or None.

        Shape (2, points), N/m for a load factor of 1, on all ranks. Any multiple of them may be
        added, with associative friction, so that nothing limits the load.
        """
        return self._on_root(lambda: self._wedging(self._program))

    def collapse(self, strength: Array) -> tuple[float | None, Array | None]:
        """Limit load as `limit` gives it, and collapse mode, with given friction.

        The mode consists of the bodies' rigid motions (a, b, c) about their centres, shape
        (bodies, 3), with f_L.v = 1; None unless the load factor is finite. `strength` is the
        given bound g at all joint points (`joint_law`), N/m, on all ranks.
        """
        program = self._program
        faces = straight_faces(program.joints, program.joints.point_laws.with_given(strength))
        found = self._on_root(lambda: self._largest(replace(program, faces=faces)))
        return found.factor, found.motion

    def bounds(self) -> LimitBounds:
        """The bracket, its lower end as in `lower_end` where that is better than no friction.

        Solved on rank 0, once, when it is first asked for; collective, as all that is solved here.
        """
        return self._on_root(lambda: self._bounds)

    def classical_bounds(self) -> LimitBounds:
        """Drucker's bounds, without friction and with associative friction; else as `bounds`.

        A program that fails leaves its bound unknown: by then there is a result to be shown.
        """
        return self._on_root(lambda: self._classical_bounds)

    @cached_property
    def _bounds(self) -> LimitBounds:
        bounds = self._classical_bounds
        stands = bounds.lower is not None or self._fall is None
        if bounds.upper is None or bounds.meet or not stands or self.crushes:
            return bounds  # the lower end's programs are linear
        lower = lower_end(self, bounds.upper)
        if bounds.lower is not None:
            lower = max(lower, bounds.lower)
        return bounds if lower == -np.inf else replace(bounds, lower=min(lower, bounds.upper) + 0.0)

    @cached_property
    def _classical_bounds(self) -> LimitBounds:
        bare = self.frictionless._fall is None
        stands = bare or self._fall is None
        lower = self.frictionless._shown() if bare else None
        lower = None if lower is None else max(lower, 0.0)
        return LimitBounds(lower, self._upper if stands else np.inf, lower)

    @property
    def friction(self) -> Array:
        """Coefficients F - D of the faces' friction that takes up power, shape (faces,)."""
        return self._program.faces.law.dissipative

    @property
    def strength(self) -> Array:
        """Given bounds on the shear forces of the faces, N/m, shape (faces,)."""
        return self._program.faces.law.strength

    @property
    def unit(self) -> float:
        """Force that is 1 in the programs, N/m: of the largest dead load."""
        return self._force

    @property
    def equations(self) -> int:
        """Number of equations of equilibrium."""
        return self._program.equations

    def given_friction(self, strength: Array, iterations: int) -> GivenFriction:
        """Limit load where the shear forces of the faces have given bounds, on this rank alone.

        Let x be what HiGHS finds, s = A x - b what it misses, and y the multipliers. As a function
        of b the limit load is concave with the slope y: it is not less than lambda - |y|.|s|.

        Args:
            strength: Bounds, N/m, shape (faces,).
            iterations: Of HiGHS, at most.

        Raises:
            SolverError: If HiGHS finds no answer in as many iterations.
        """
        self._patient()
        faces = self._bare.faces
        faces = replace(faces, law=faces.law.with_given(strength))
        program = replace(self._bare, faces=faces)
        columns, right = self._bare_equilibrium
        largest = self._largest_in(program, columns, right)
        pressure = np.zeros(len(self._joints.length))
        answer = largest.answer("highs-ds", {"maxiter": iterations})
        if answer.status == 0:
            pressure = program.point_forces(answer.x[1:] * self._force)[0]
            x = np.clip(answer.x, *largest.ends)
            multipliers = answer.eqlin.marginals
            lost = np.abs(multipliers) @ np.abs(columns @ x - right)
            factor = float(x[0] - lost) * self._load
        elif answer.status == 1:
            raise SolverError(f"rigid-block linear program failed: {answer.message}")
        else:
            missing, multipliers, _ = least_missing(largest)
            factor = -np.inf if missing > OPTIONS.rounding else np.inf
            if factor > 0.0 and self._wedging(program) is None:
                raise SolverError(f"rigid-block linear program failed: {answer.message}")
        slip = np.abs(columns.T @ multipliers)[-len(strength) :]
        return GivenFriction(factor, slip, pressure, int(answer.nit))

    def least_forces(
        self, weights: Array, factors: tuple[float, float], iterations: int
    ) -> LeastForces:
        """Least weighted sums of normal forces of faces, with associative friction.

        Solved on this rank alone, as one program. The sums are the values of its dual, in which
        unbounded x are held to be no larger than the largest found.

        Args:
            weights: Of the faces, not negative, shape (sums, faces).
            factors: Least and largest load factor.
            iterations: Of HiGHS, at most.

        Raises:
            SolverError: If HiGHS finds no answer in as many iterations.
        """
        from scipy.sparse import block_diag

        self._patient()
        program = self._program
        count = len(weights)
        columns, right = self._whole_equilibrium
        low, high = (factor / self._load if np.isfinite(factor) else None for factor in factors)
        limits = [(low, high), *program.limits(self._force)]
        costs = np.array([[0.0, *program.pressing(one)] for one in weights])
        single = LinearProgram(np.zeros(len(limits)), columns, right, limits)
        whole = block_diag([columns] * count, "csr")
        all_sums = LinearProgram(costs.ravel(), whole, np.tile(right, count), limits * count)
        answer = all_sums.answer("highs-ds", {"maxiter": iterations})
        spent = int(answer.nit)
        if answer.status == 2 and least_missing(single)[0] > OPTIONS.rounding:
            return LeastForces(np.full(count, np.inf), np.empty(0), np.empty((0, 0)), spent)
        if answer.status != 0:
            raise SolverError(f"rigid-block linear program failed: {answer.message}")
        x, multipliers = (v.reshape(count, -1) for v in (answer.x, answer.eqlin.marginals))
        values = single.dual_values(costs, multipliers, float(np.abs(x).max()))
        normal = np.array([program.face_forces(one[1:]) for one in x])
        factors_found = x[:, 0] * self._load
        return LeastForces(values * self._force, factors_found, normal * self._force, spent)

    @cached_property
    def _bare(self) -> _Program:
        """The program with given friction."""
        faces = self._program.faces
        bare = faces.law.with_given(np.zeros_like(self.strength))
        return replace(self._program, faces=replace(faces, law=bare))

    @cached_property
    def _bare_equilibrium(self) -> tuple[Any, Array]:
        return self._equilibrium(self._bare)

    @cached_property
    def _whole_equilibrium(self) -> tuple[Any, Array]:
        return self._equilibrium(self._program)

    def _equilibrium(self, program: _Program) -> tuple[Any, Array]:
        """Columns and right side of equilibrium in (lambda, x), in units of force and load."""
        from scipy.sparse import hstack

        loads = -program.bodies.dead, program.bodies.live
        right, live = (program.load(load) / self._force for load in loads)
        return hstack([self._load * live[:, None], program.forces]).tocsr(), right

    def _shown(self) -> float | None:
        """A load factor to be shown, no -0.0; None if the program fails."""
        try:
            factor = self._limit
        except (SolverError, Stopped) as error:
            _log.warning("a bound on the load factor is not known: %s", error)
            return None
        return None if factor is None else factor + 0.0

    @cached_property
    def _limit(self) -> float | None:
        """Load factor, solved for on this rank alone."""
        if self._model is None:
            return self._largest(self._program).factor
        return np.inf if self._wedging(self._program) is not None else associative_end(self._model)

    @cached_property
    def _fall(self) -> Array | None:
        """Motions by which the dead load falls, solved for on this rank alone."""
        return self._fall_under(0.0)

    def _fall_under(self, load_factor: float) -> Array | None:
        """Motions by which the loads fall, solved for on this rank alone."""
        program = self._program
        standing = self._standing(load_factor)
        # Any equilibrium will do: the simplex method with Dantzig's plain pricing is fastest.
        plain = {"simplex_dual_edge_weight_strategy": "dantzig"}
        if standing.answer("highs-ds", plain).status != 0:
            missing, multipliers, _ = least_missing(standing)
            if missing > OPTIONS.rounding:
                return program.motions(-multipliers)
        if self._model is None:
            return None
        motion = crushed_by(self._model, load_factor)
        return None if motion is None else program.motions(motion)

    def _standing(self, load_factor: float) -> LinearProgram:
        """The program of any forces in equilibrium with the loads."""
        program = self._program
        unit = max(self._force, abs(load_factor) * self._force / self._load)
        right = -program.load(self._bodies.dead + load_factor * self._bodies.live) / unit
        limits = program.limits(unit)
        return LinearProgram(np.zeros(len(limits)), program.forces, right, limits)

    def _wedging(self, program: _Program) -> Array | None:
        """Forces that balance the live load alone, N/m for a load factor of 1: small and few."""
        unit = self._force / self._load
        limits = program.limits(np.inf)
        right = -program.load(self._bodies.live) / unit
        balance = LinearProgram(np.ones(len(limits)), program.forces, right, limits)
        missing, _, x = least_missing(balance)
        if missing > OPTIONS.rounding:
            return None
        least = balance.answer("highs-ds")
        return program.point_forces(unit * (least.x if least.status == 0 else x))

    def _largest_program(self, program: _Program) -> LinearProgram:
        """The linear program of the largest load factor."""
        return self._largest_in(program, *self._equilibrium(program))

    def _largest_in(self, program: _Program, columns: Any, right: Array) -> LinearProgram:
        """The linear program of the largest load factor, with an equilibrium of (lambda, x)."""
        limits = [(None, None), *program.limits(self._force)]
        return LinearProgram(-np.eye(1, len(limits)).ravel(), columns, right, limits)

    def _largest(self, program: _Program) -> _Optimum:
        """The largest load factor of a program."""
        largest = self._largest_program(program)
        for method in (FIRST_METHOD, "highs-ds"):
            answer = self._answer_beside(program, largest, method)
            if answer.status == 0:
                factor = float(answer.x[0]) * self._load
                multipliers = answer.eqlin.marginals
                work = float(program.load(program.bodies.live) @ multipliers)
                return _Optimum(factor, program.motions(multipliers) / work if work else None)
        if least_missing(largest)[0] > OPTIONS.rounding:
            return _Optimum(None)
        if self._wedging(program) is not None:
            return _Optimum(np.inf)
        raise SolverError(f"rigid-block linear program failed: {answer.message}")

    def _answer_beside(self, program: _Program, largest: LinearProgram, method: str) -> Any:
        """HiGHS' answer, from a process of its own if the program is large."""
        if not self._is_large:
            return largest.answer(method)
        is_begun = program is self._program and method == FIRST_METHOD
        begun, self._begun = (self._begun, None) if is_begun else (None, self._begun)
        answer = (begun or Beside(*largest.arguments(method))).answer(self._patient)
        return largest.answer(method) if answer is None else answer

    def _on_root(self, solve: Callable[[], Any]) -> Any:
        """What a function returns on rank 0, on all ranks; its `SolverError` or `Stopped` too."""
        answer: Any = None
        failure: SolverError | Stopped | None = None
        if self._comm.rank == 0:
            try:
                answer = solve()
            except (SolverError, Stopped) as error:
                failure = type(error)(str(error))
        answer, failure = self._comm.bcast((answer, failure))
        if failure is not None:
            raise failure
        return answer
