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

Where joints have a compressive strength the programs are no longer linear, and the face engine
solves them (`faces`): its mode proves the end. Whether loads stand is asked as the largest part of
them that does. On large walls it is many times as fast as HiGHS, and is asked first.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.collapse.rigid_blocks.model import (
    BlockModel,
    lower_end,
    wedging_forces,
)
from fenics_contact.discretization.layout import Layout
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.kernel import Program, solve
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.faces.programs import associative_end, motion_under, proved_fall
from fenics_contact.faces.system import Equations
from fenics_contact.parallel import MPI
from fenics_contact.results.bounds import NOT_AT_THIS_SIZE, LimitBounds
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.problem import Array
from fenics_contact.workers import check_asked_to_stop, result_of

_log = logging.getLogger("fenics_contact")

#: The interior point method is ten times as fast as the simplex method on large walls.
FIRST_METHOD = "highs-ipm"


def falling_motion(model: BlockModel, load_factor: float) -> Array | None:
    """Rigid motions (a, b, c) of the bodies by which the loads fall; None if they stand.

    Raises:
        SolverError: If HiGHS finds no answer.
    """
    if model.is_large:  # twenty times as fast as HiGHS
        try:
            motion = proved_fall(model.units, load_factor)
        except SolverError:
            if model.units.has_many_blocks:
                raise
        else:
            return None if motion is None else model.planar.motions(motion)
    standing = model.standing(load_factor)
    # Any equilibrium will do: the simplex method with Dantzig's plain pricing is fastest.
    plain = {"simplex_dual_edge_weight_strategy": "dantzig"}
    if standing.answer("highs-ds", plain).status != 0:
        missing, multipliers, _ = standing.least_missing()
        if missing > SEARCH.rounding:
            return model.planar.motions(-multipliers)
    motion = motion_under(model.units, load_factor) if model.has_strength else None
    return None if motion is None else model.planar.motions(motion)


def largest_load(model: BlockModel) -> tuple[float | None, Array | None]:
    """Largest load factor, infinite without a limit, None without equilibrium; collapse mode.

    The mode consists of the bodies' rigid motions (a, b, c) about their centres, shape (bodies, 3),
    with f_L.v = 1; None unless the load factor is finite.

    Raises:
        SolverError: If HiGHS finds no answer.
    """
    largest = model.largest()
    for method in (FIRST_METHOD, "highs-ds"):
        answer = largest.answer(method)
        if answer.status == 0:
            multipliers = answer.eqlin.marginals
            work = float(model.planar.model.live @ multipliers)
            motion = model.planar.motions(multipliers) / work if work else None
            return float(answer.x[0]) * model.load, motion
    if largest.least_missing()[0] > SEARCH.rounding:
        return None, None
    if wedging_forces(model) is not None:
        return np.inf, None
    raise SolverError(f"rigid-block linear program failed: {answer.message}")


def given_load(model: BlockModel) -> tuple[float | None, Array | None]:
    """The same with given friction; None where the kernel, asked of large models, finds none."""
    if not model.is_large:
        return largest_load(model)
    laws = model.units.strength, model.units.friction, model.units.friction
    found = solve(Program(model.units, Equations(model.units), *laws))
    return (found.load_factor, model.planar.motions(found.motion)) if found.solved else (None, None)


def wait_on() -> None:
    """Wait for a program, however long it takes."""


def bracket_of(blocks: RigidBlocks) -> LimitBounds:
    """A task: the bracket of some blocks."""
    return blocks.bounds()


@dataclass(eq=False)
class RigidBlocks:
    """What the programs of one structure say, solved on rank 0 when it is first asked for.

    All methods but `limit_so_far` are collective.

    Attributes:
        model: The blocks with associative friction.
        comm: Ranks that share the answers.
        check_stop: Called before the programs of the lower end on rank 0; may raise `Stopped`.
    """

    model: BlockModel
    comm: MPI.Comm
    check_stop: Callable[[], None] = wait_on
    _bracket: Future[LimitBounds] | None = None

    @classmethod
    def of(
        cls, whole: Layout, sign: float = 1.0, check_stop: Callable[[], None] = wait_on
    ) -> RigidBlocks:
        """Those of a structure, with its live load or the reverse of it (sign -1)."""
        planar = PlanarFaces.of(whole, sign)
        model = BlockModel.of(planar, planar.model.friction, planar.model.strength)
        return cls(model, whole.scene.comm, check_stop)

    def __getstate__(self) -> dict[str, Any]:
        """The programs and what was solved of them, without ranks and processes."""
        left_out = {"comm": self.comm.size, "check_stop": check_asked_to_stop, "_bracket": None}
        return vars(self) | left_out

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, comm=compat.comm_of(state["comm"]))

    def __deepcopy__(self, _: object) -> RigidBlocks:
        return self  # nothing changes them

    @cached_property
    def frictionless(self) -> RigidBlocks:
        """The same blocks without friction."""
        planar = self.model.planar
        law = planar.faces.law.frictionless()
        return RigidBlocks(
            BlockModel.of(planar, law.friction, law.strength), self.comm, self.check_stop
        )

    @property
    def has_strength(self) -> bool:
        """Whether some face has a compressive strength."""
        return self.model.has_strength

    def limit(self) -> float | None:
        """Largest load factor: infinite where nothing limits it, None without equilibrium.

        Coulomb's friction is taken as associative.
        """
        return self.on_root(lambda: self._limit)

    def is_unlimited(self) -> bool:
        """Whether it is proved that nothing limits the load; HiGHS may find no answer at all."""
        try:
            return self.limit() == np.inf
        except SolverError as error:
            _log.info("  not proved unlimited: %s", error)
            return False

    def limit_so_far(self) -> float | None:
        """The limit, on this rank alone, if it is known or takes no time; else None."""
        if self._bracket is not None:
            known = self._bracket.done() and self._bracket.exception() is None  # nor was it lost
            return self._bracket.result().upper if known else None
        return self._upper if "_upper" in vars(self) or not self.model.is_large else None

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
            return self.on_root(lambda: self._fall)
        return self.on_root(lambda: falling_motion(self.model, load_factor))

    def wedging(self) -> Array | None:
        """Forces (normal, shear) at all joint points that balance the live load alone, or None.

        Shape (2, points), N/m for a load factor of 1, on all ranks. Any multiple of them may be
        added, with associative friction, so that nothing limits the load.
        """
        return self.on_root(lambda: wedging_forces(self.model))

    def collapse(self, strength: Array) -> tuple[float | None, Array | None]:
        """Limit load and collapse mode, as `given_load` gives them.

        `strength` is the given bound g at all joint points (`joint_law`), N/m, on all ranks.
        """
        planar = self.model.planar
        dilatancy = planar.model.dilatancy
        given = np.bincount(planar.faces.of_point, strength, len(dilatancy)).astype(float)
        model = BlockModel.of(planar, dilatancy, given)
        return self.on_root(lambda: given_load(model))

    def begin(self, beside: Executor) -> None:
        """Solve for the bracket beside other work, on this rank."""
        if "_bounds" not in vars(self):
            self._bracket = beside.submit(bracket_of, self)

    def bounds(self) -> LimitBounds:
        """The bracket, its lower end as in `lower_end` where that is better than no friction."""
        return self.on_root(lambda: self._bounds)

    def classical_bounds(self) -> LimitBounds:
        """Drucker's bounds, without friction and with associative friction; else as `bounds`.

        A program that fails leaves its bound unknown: by then there is a result to be shown.
        """
        return self.on_root(lambda: self._classical_bounds)

    @cached_property
    def _fall(self) -> Array | None:
        """Motions by which the dead load falls, solved for on this rank alone."""
        return falling_motion(self.model, 0.0)

    @cached_property
    def _limit(self) -> float | None:
        """Load factor, solved for on this rank alone."""
        model = self.model
        end: float | None = None
        if self.has_strength or model.is_large:
            with suppress(SolverError):
                end = associative_end(model.units)
        if end is not None:
            # Without friction this is a lower end, too: 0 where nothing more is carried than what
            # stands.
            small = SEARCH.verified * model.units.size(0.0)
            rests = end <= small and not np.any(model.friction) and self._fall is None
            return 0.0 if rests else end
        if self.has_strength or model.units.has_many_blocks:
            return np.inf if wedging_forces(model) is not None else None
        with suppress(SolverError):  # as of HiGHS where masses are far apart
            return largest_load(model)[0]
        return associative_end(model.units)

    @cached_property
    def _upper(self) -> float | None:
        """The limit to be shown, no -0.0; None if the program fails."""
        try:
            return None if self._limit is None else self._limit + 0.0
        except (SolverError, Stopped) as error:
            _log.warning("a bound on the load factor is not known: %s", error)
            return None

    @cached_property
    def _classical_bounds(self) -> LimitBounds:
        bare = False
        with suppress(SolverError):  # not known of many blocks
            bare = self.frictionless._fall is None
        stands = bare or self._fall is None
        reason = NOT_AT_THIS_SIZE * self.model.units.has_many_blocks
        lower = self.frictionless._upper if bare and not reason else None
        lower = None if lower is None else max(lower, 0.0)
        return LimitBounds(lower, self._upper if stands else np.inf, lower, reason)

    @cached_property
    def _bounds(self) -> LimitBounds:
        if self._bracket is not None:
            return result_of(self._bracket, self.check_stop)
        bounds = self._classical_bounds
        stands = bounds.lower is not None or self._fall is None
        if bounds.upper is None or bounds.meet or not stands or self.has_strength or bounds.reason:
            return bounds  # the lower end's programs are linear
        lower = lower_end(self.model, bounds.upper, self.check_stop)
        if bounds.lower is not None:
            lower = max(lower, bounds.lower)
        return bounds if lower == -np.inf else replace(bounds, lower=min(lower, bounds.upper) + 0.0)

    def on_root(self, ask: Callable[[], Any]) -> Any:
        """The value of a function on rank 0, on all ranks; its `SolverError` or `Stopped` too."""
        answer: Any = None
        failure: SolverError | Stopped | None = None
        if self.comm.rank == 0:
            try:
                answer = ask()
            except (SolverError, Stopped) as error:
                failure = type(error)(str(error))
        answer, failure = self.comm.bcast((answer, failure))
        if failure is not None:
            raise failure
        return answer
