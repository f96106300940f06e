"""The lower end of the bracket: friction that all collapse states have for sure.

A collapse state is one of equilibrium with a rigid motion v that the laws of its joints allow as a
rate and by which the live load does work, f_L . v = 1. Let N_f be the normal force of a straight
face f between two bodies in such a state, F_f its coefficient of friction, s_f its strength. Where
it dilates, F_f is less by the dilatancy, which is part of the program P (`joint_law`).

1. All points of f have one slip rate. Friction takes up (F_f N_f + s_f) |slip of f|: the state's
   load factor is P(F N + s), the limit load with given friction, for v proves that there is no
   larger one (`rigid_blocks`). P(g) does not fall where any g_f grows: more forces are admissible.
2. The state's forces are admissible with associative friction. If a <= lambda <= b, then N_f is not
   less than n_f(a, b), the least normal force of f over all forces that are admissible with some
   load factor from a to b: a linear program for every face.
3. So lambda >= P(F n(a, b) + s) =: c. A collapse state in [a, b] is in [c, b]; c > b proves that
   there is none. With b = u, the associative upper end, no collapse state at all is below c.

This is repeated with c in place of a, at first with b = u. Where it ends, smaller slices [a, b] are
tried, as their n are larger: no state of a slice is below min(b, c). It begins with
a = P(s), which is minus infinity if the dead load has no equilibrium without friction.

Most n_f need not be known. Let m_f be the least normal force of f in any forces found: n_f <= m_f.
If P(F m + s) is no gain, none is to be had from [a, b]. Else n_f is asked for where a face slips in
the mode of the n known so far, 0 at first, and m_f > n_f; if there is none, P is exact. Normal
forces of many faces are minimised together first, which tells most of those without any.

Friction of several faces may not be replaced by the least sum of their normal forces: that holds
only for modes in which they slip alike. Motions with f_L . v < 0, in which the dead load moves the
blocks against the live load, belong to the opposite direction.
"""

from __future__ import annotations

import itertools
import logging
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from fenics_contact.errors import SolverError, Stopped
from fenics_contact.geometry.mesh import Indices
from fenics_contact.results.bounds import meet
from fenics_contact.solvers.problem import Array

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class LowerEndOptions:
    """Numbers of the search for the lower end.

    Attributes:
        programs: Linear programs at most.
        pivots: Iterations of HiGHS times equations at most, which bounds the time on large walls.
        gain: Least gain of a step, in units of the slice: for less, slices get smaller.
        shrinks: Factor by which slices get smaller, and larger again.
        thinnest: Slices are not thinner than this part of the first bracket.
        judged: Steps of a slice, at first, in which it may turn out to be no gain.
        at_once: Faces for each of which n is found by one program.
        together: Faces are minimised together while this leaves less of their least normal forces.
        unloaded: Normal forces that count as none, and slip rates, in units of the largest one.
        rounding: Of u, which HiGHS found too: it is raised by so much, relative.
    """

    programs: int = 120
    pivots: int = 2_500_000
    gain: float = 0.05
    shrinks: float = 0.25
    thinnest: float = 0.01
    judged: int = 2
    at_once: int = 8
    together: float = 0.5
    unloaded: float = 1e-9
    rounding: float = 1e-8


OPTIONS = LowerEndOptions()


@dataclass(frozen=True)
class GivenFriction:
    """Limit load with given friction.

    Attributes:
        factor: Not above it by rounding; infinite where nothing limits the load, minus infinity
            without equilibrium.
        slip: Slip rates of the faces in the collapse mode, where f_L.v = 1, not negative, shape
            (faces,); those of the motion that proves that there is no equilibrium, up to a factor.
        pressure: Normal forces at all joint points, at the ends of faces, N/m; none without a
            finite factor.
        iterations: Of HiGHS.
    """

    factor: float
    slip: Array
    pressure: Array
    iterations: int


@dataclass(frozen=True)
class LeastForces:
    """Admissible forces that press some faces least.

    Attributes:
        values: Sums of their normal forces, weighted, N/m, not above them by rounding; infinite if
            no forces are admissible.
        factors: Load factors.
        normal: Normal forces of all faces, N/m, shape (sums, faces).
        iterations: Of HiGHS.
    """

    values: Array
    factors: Array
    normal: Array
    iterations: int


class FacePrograms(Protocol):
    """Linear programs of rigid blocks with straight faces, as `RigidBlocks` has them."""

    @property
    def friction(self) -> Array:
        """F - D, of the friction that takes up power, shape (faces,)."""

    @property
    def strength(self) -> Array:
        """s, N/m, shape (faces,)."""

    @property
    def unit(self) -> float:
        """A large force, N/m."""

    @property
    def equations(self) -> int:
        """Number of equations of equilibrium."""

    def given_friction(self, strength: Array, iterations: int) -> GivenFriction:
        """P of given bounds on shear forces, N/m."""

    def least_forces(
        self, weights: Array, factors: tuple[float, float], iterations: int
    ) -> LeastForces:
        """Least weighted sums of normal forces with load factors between two."""


def lower_end(programs: FacePrograms, upper: float) -> float:
    """No collapse state has a load factor below this; minus infinity if nothing is proved.

    Args:
        programs: Linear programs.
        upper: u.
    """
    search = _Search(programs, upper + OPTIONS.rounding * abs(upper))
    try:
        search.run()
    except (SolverError, Stopped, _SpentError) as error:
        _log.info("  lower end of the bracket: %s", error)
    _log.info("  lower end of the bracket: %.8g by %d programs", search.lower, search.solved)
    return search.lower


class _SpentError(Exception):
    """As many linear programs as are allowed are solved."""


@dataclass
class _Slice:
    """Load factors from a to b, and what is known of the normal forces of states with them.

    Attributes:
        ends: a and b.
        least: Not above n, N/m, shape (faces,).
        most: Not below n: the least found, N/m; infinite as long as none are known.
        empty: Whether no forces are admissible.
    """

    ends: tuple[float, float]
    least: Array
    most: Array
    empty: bool = False


@dataclass
class _Search:
    """Linear programs on the way to the lower end.

    Attributes:
        blocks: Linear programs.
        upper: u.
        lower: No collapse state is below.
        solved: Number of programs.
        pivots: Iterations times equations.
        found: Admissible forces: load factors, and normal forces of all faces.
        last: Normal forces for which P was asked last, and the answer.
    """

    blocks: FacePrograms
    upper: float
    lower: float = -np.inf
    solved: int = 0
    pivots: int = 0
    found: list[tuple[float, Array]] = field(default_factory=list)
    last: tuple[Array, GivenFriction] | None = None

    def run(self) -> None:
        """Raise the lower end as far as it goes."""
        self.lower = self._limit(np.zeros_like(self.blocks.friction)).factor
        least = self._with_all_load_factors()
        if np.isfinite(self.lower) and np.isfinite(self.upper):
            self._by_slices(least)

    def _with_all_load_factors(self) -> Array:
        """Raise the lower end with all load factors up to u; returns what is known of n there."""
        least = np.zeros_like(self.blocks.friction)
        while not self._closed:
            part = self._slice(self.upper, least)
            factor = self._raised(part)
            least = part.least
            size = self.upper - self.lower if np.isfinite(self.upper) else abs(self.lower)
            enough = factor > self.lower + OPTIONS.gain * size or self.lower == -np.inf < factor
            self.lower = max(self.lower, factor)
            if not enough:
                break
        return least

    def _by_slices(self, least: Array) -> None:
        """Raise the lower end slice by slice, from the least normal forces in all of them."""
        width = thinnest = OPTIONS.thinnest * (self.upper - self.lower)
        while not self._closed:
            end = min(self.lower + width, self.upper)
            factor = min(self._raised(self._slice(end, least)), end)
            gain = factor - self.lower
            self.lower = max(factor, self.lower)
            if factor == end:
                width /= OPTIONS.shrinks
            elif gain <= OPTIONS.gain * width:
                if width <= thinnest:
                    return
                width = max(OPTIONS.shrinks * width, thinnest)

    @property
    def _closed(self) -> bool:
        """Whether the ends meet, or nothing limits the load."""
        return self.lower == np.inf or meet(self.lower, self.upper)

    def _slice(self, end: float, least: Array) -> _Slice:
        """The slice from the lower end on, with the forces found that are in it."""
        part = _Slice((self.lower, end), least.copy(), np.full_like(least, np.inf))
        for factor, normal in self.found:
            if self.lower <= factor <= end:
                part.most = np.minimum(part.most, normal)
        return part

    def _raised(self, part: _Slice) -> float:
        """No collapse state of a slice is below this, as far as it is worth while."""
        low, high = part.ends
        worthwhile = low + OPTIONS.gain * (high - low) if high < np.inf else low
        for step in itertools.count():
            limit = self._limit(part.least)
            if limit.factor > high:
                return limit.factor
            faces = self._unknown(part, limit.slip)
            if not len(faces):
                return limit.factor
            known = step < OPTIONS.judged and bool(np.all(np.isfinite(part.most)))
            if known and self._limit(part.most).factor <= worthwhile:
                return limit.factor
            self._minimise(part, faces)
            if part.empty:
                break
        return np.inf

    def _unknown(self, part: _Slice, slip: Array) -> Indices:
        """Faces that slip and whose n is not known yet, those with the most power first."""
        power = self.blocks.friction * slip * self._doubt(part)
        order = np.argsort(-power, kind="stable")
        return order[power[order] > OPTIONS.unloaded * power.max(initial=0.0)]

    def _doubt(self, part: _Slice) -> Array:
        """Differences of what n may be, N/m, up to the unit of forces; 0 where it is known."""
        unit = self.blocks.unit
        doubt = np.minimum(part.most - part.least, unit)
        return np.where(doubt > OPTIONS.unloaded * unit, doubt, 0.0)

    def _minimise(self, part: _Slice, faces: Indices) -> None:
        """Find n of faces of a slice, all together as long as that leaves less and less of them."""
        doubt = self._doubt(part)[faces].sum()
        while len(faces) > 1:
            before = doubt
            together = np.zeros((1, len(part.least)))
            together[0, faces] = 1.0
            self._least(part, together)
            faces = faces[self._doubt(part)[faces] > 0.0]
            doubt = self._doubt(part)[faces].sum()
            if doubt > OPTIONS.together * before:
                break
        while len(faces) and not part.empty:
            first = faces[: OPTIONS.at_once]
            values = self._least(part, np.eye(len(part.least))[first])
            part.least[first] = np.maximum(values, part.least[first])
            part.most[first] = part.least[first]
            faces = faces[self._doubt(part)[faces] > 0.0]

    def _least(self, part: _Slice, weights: Array) -> Array:
        """Least sums of normal forces in a slice, N/m; it learns from the forces."""
        found = self.blocks.least_forces(weights, part.ends, self._iterations)
        self._count(found.iterations)
        part.empty = part.empty or bool(np.any(found.values == np.inf))
        if not part.empty:
            self.found += zip(found.factors, found.normal, strict=True)
            part.most = np.minimum(part.most, found.normal.min(axis=0))
        return found.values

    def _limit(self, normal: Array) -> GivenFriction:
        """P(F N + s) for given normal forces of the faces, N/m."""
        if self.last is not None and np.array_equal(self.last[0], normal):
            return self.last[1]
        strength = self.blocks.friction * normal + self.blocks.strength
        limit = self.blocks.given_friction(strength, self._iterations)
        self._count(limit.iterations)
        self.last = normal.copy(), limit
        return limit

    @property
    def _iterations(self) -> int:
        """Iterations of HiGHS that are left."""
        left = (OPTIONS.pivots - self.pivots) // self.blocks.equations
        if left < 1 or self.solved >= OPTIONS.programs:
            raise _SpentError(f"{self.solved} linear programs did not bring it to an end")
        return left

    def _count(self, iterations: int) -> None:
        self.solved += 1
        self.pivots += iterations * self.blocks.equations
