"""The lower end of the bracket: friction that all collapse states have for sure.

A collapse state is one of equilibrium with a rigid motion v that the laws of its joints allow as a
rate and by which the live load does work, f_L . v = 1. Let N_f be the normal force of a straight
face f between two bodies in such a state, F_f its coefficient of friction, s_f its strength. Where
it dilates, F_f is less by the dilatancy, which is part of the program P (`joint_law`).

1. All points of f have one slip rate. Friction takes up (F_f N_f + s_f) |slip of f|: the state's
   load factor is P(F N + s), the limit load with given friction, for v proves that there is no
   larger one (`programs`). P(g) does not fall where any g_f grows: more forces are admissible.
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
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from fenics_contact.collapse.rigid_blocks.model import (
    BlockModel,
    LinearProgram,
    wedging_forces,
)
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.geometry.mesh import Indices
from fenics_contact.results.bounds import meet
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.problem import Array

_log = logging.getLogger("fenics_contact")


class GivenFriction(NamedTuple):
    """Limit load with given friction.

    Attributes:
        factor: Not above it by rounding; infinite where nothing limits the load, minus infinity
            without equilibrium.
        slip: Slip rates of the faces in the collapse mode, where f_L.v = 1, not negative, shape
            (faces,); those of the motion that proves that there is no equilibrium, up to a factor.
        iterations: Of HiGHS.
    """

    factor: float
    slip: Array
    iterations: int


def given_friction(model: BlockModel, iterations: int) -> GivenFriction:
    """Limit load P of the faces' laws.

    Let x be what HiGHS finds, s = A x - b what it misses, and y the multipliers. As a function of b
    the limit load is concave with the slope y: it is not less than lambda - |y|.|s|.

    Args:
        model: Blocks with dilatancy as their friction, and given bounds on shear forces.
        iterations: Of HiGHS, at most.

    Raises:
        SolverError: If HiGHS finds no answer in as many iterations.
    """
    largest = model.largest()
    answer = largest.answer("highs-ds", {"maxiter": iterations})
    if answer.status == 0:
        x = np.clip(answer.x, *largest.ends.T)
        multipliers = answer.eqlin.marginals
        lost = np.abs(multipliers) @ np.abs(largest.columns @ x - largest.right)
        factor = float(x[0] - lost) * model.load
    elif answer.status == 1:
        raise SolverError(f"rigid-block linear program failed: {answer.message}")
    else:
        missing, multipliers, _ = largest.least_missing()
        factor = -np.inf if missing > SEARCH.rounding else np.inf
        if factor > 0.0 and wedging_forces(model) is None:
            raise SolverError(f"rigid-block linear program failed: {answer.message}")
    slip = np.abs(largest.columns.T @ multipliers)[-len(model.strength) :]
    return GivenFriction(factor, slip, int(answer.nit))


class LeastForces(NamedTuple):
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


def least_forces(
    model: BlockModel, weights: Array, factors: tuple[float, float], iterations: int
) -> LeastForces:
    """Least weighted sums of normal forces of faces, with associative friction, as one program.

    With multipliers y of equilibrium, costs c are not less than b.y + min (c - A^T y).x over all x
    within their limits, whatever HiGHS' tolerance; x without a limit are held to be no larger than
    the largest found.

    Args:
        model: Blocks with associative friction.
        weights: Of the faces, not negative, shape (sums, faces).
        factors: Least and largest load factor.
        iterations: Of HiGHS, at most.

    Raises:
        SolverError: If HiGHS finds no answer in as many iterations.
    """
    from scipy.sparse import block_diag

    count = len(weights)
    largest = model.largest()
    ends = np.vstack([np.array(factors) / model.load, largest.ends[1:]])
    single = replace(largest, cost=np.zeros(len(ends)), ends=ends)
    costs = np.hstack([np.zeros((count, 1)), model.pressing(weights)])
    columns = block_diag([single.columns] * count, "csr")
    right = np.tile(single.right, count)
    all_sums = LinearProgram(costs.ravel(), columns, right, np.tile(ends, (count, 1)))
    answer = all_sums.answer("highs-ds", {"maxiter": iterations})
    spent = int(answer.nit)
    if answer.status == 2 and single.least_missing()[0] > SEARCH.rounding:
        return LeastForces(np.full(count, np.inf), np.empty(0), np.empty((0, 0)), spent)
    if answer.status != 0:
        raise SolverError(f"rigid-block linear program failed: {answer.message}")
    x, multipliers = (v.reshape(count, -1) for v in (answer.x, answer.eqlin.marginals))
    rest = costs - multipliers @ single.columns
    largest_x = float(np.abs(x).max())
    least, most = np.nan_to_num(ends.T, posinf=largest_x, neginf=-largest_x)
    values = multipliers @ single.right + np.minimum(rest * least, rest * most).sum(axis=1)
    at_ends = np.array([model.at_ends(row[1:])[0] for row in x])
    normal = at_ends.reshape(count, 2, -1).sum(axis=1)
    return LeastForces(values * model.unit, x[:, 0] * model.load, normal * model.unit, spent)


def lower_end(model: BlockModel, upper: float, check_stop: Callable[[], None]) -> float:
    """No collapse state has a load factor below this; minus infinity if nothing is proved.

    Args:
        model: Blocks with associative friction.
        upper: u.
        check_stop: Called before every program; may raise `Stopped`.
    """
    dilatancy = model.planar.model.dilatancy
    given = BlockModel.of(model.planar, dilatancy, model.strength)
    search = _Search(model, given, check_stop, upper + SEARCH.rounding * abs(upper))
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
        model: Blocks with associative friction.
        given: Blocks with dilatancy as their friction.
        check_stop: Called before every program.
        upper: u.
        lower: No collapse state is below.
        solved: Number of programs.
        pivots: Iterations times equations.
        found: Admissible forces: load factors, and normal forces of all faces.
        last: Normal forces for which P was asked last, and the answer.
    """

    model: BlockModel
    given: BlockModel
    check_stop: Callable[[], None]
    upper: float
    lower: float = -np.inf
    solved: int = 0
    pivots: int = 0
    found: list[tuple[float, Array]] = field(default_factory=list)
    last: tuple[Array, GivenFriction] | None = None

    def run(self) -> None:
        """Raise the lower end with all load factors up to u as far as it goes, then by slices."""
        least = np.zeros_like(self.model.strength)
        self.lower = self._limit(least).factor
        while not self._closed:
            part = self._slice(self.upper, least)
            factor = self._raised(part)
            least = part.least
            size = self.upper - self.lower if np.isfinite(self.upper) else abs(self.lower)
            enough = (
                factor > self.lower + SEARCH.least_gain * size or self.lower == -np.inf < factor
            )
            self.lower = max(self.lower, factor)
            if not enough:
                break
        if not (np.isfinite(self.lower) and np.isfinite(self.upper)):
            return
        width = thinnest = SEARCH.thinnest_slice * (self.upper - self.lower)
        while not self._closed:
            end = min(self.lower + width, self.upper)
            factor = min(self._raised(self._slice(end, least)), end)
            gain = factor - self.lower
            self.lower = max(factor, self.lower)
            if factor == end:
                width /= SEARCH.slice_shrinks
            elif gain <= SEARCH.least_gain * width:
                if width <= thinnest:
                    return
                width = max(SEARCH.slice_shrinks * width, thinnest)

    @property
    def _closed(self) -> bool:
        """Whether the ends meet, or nothing limits the load."""
        return self.lower == np.inf or meet(self.lower, self.upper)

    def _slice(self, end: float, least: Array) -> _Slice:
        """The slice from the lower end on, with the forces found that are in it."""
        inside = [normal for factor, normal in self.found if self.lower <= factor <= end]
        most = np.min([np.full_like(least, np.inf), *inside], axis=0)
        return _Slice((self.lower, end), least.copy(), most)

    def _raised(self, part: _Slice) -> float:
        """No collapse state of a slice is below this, as far as it is worth while."""
        low, high = part.ends
        worthwhile = low + SEARCH.least_gain * (high - low) if high < np.inf else low
        for step in itertools.count():
            limit = self._limit(part.least)
            if limit.factor > high:
                return limit.factor
            # Faces that slip and whose n is not known yet, those with the most power first.
            power = self.model.planar.model.free_friction * limit.slip * self._doubt(part)
            order = np.argsort(-power, kind="stable")
            faces = order[power[order] > SEARCH.unloaded * power.max(initial=0.0)]
            if not len(faces):
                return limit.factor
            # At first the slice may turn out to be no gain.
            known = step < 2 and bool(np.all(np.isfinite(part.most)))
            if known and self._limit(part.most).factor <= worthwhile:
                return limit.factor
            self._minimise(part, faces)
            if part.empty:
                break
        return np.inf

    def _doubt(self, part: _Slice) -> Array:
        """Differences of what n may be, N/m, up to the unit of forces; 0 where it is known."""
        unit = self.model.unit
        doubt = np.minimum(part.most - part.least, unit)
        return np.where(doubt > SEARCH.unloaded * unit, doubt, 0.0)

    def _minimise(self, part: _Slice, faces: Indices) -> None:
        """Find n of faces of a slice, all together while that halves the doubt."""
        doubt = self._doubt(part)[faces].sum()
        while len(faces) > 1:
            before = doubt
            together = np.zeros((1, len(part.least)))
            together[0, faces] = 1.0
            self._least(part, together)
            faces = faces[self._doubt(part)[faces] > 0.0]
            doubt = self._doubt(part)[faces].sum()
            if doubt > 0.5 * before:
                break
        while len(faces) and not part.empty:
            first = faces[: SEARCH.faces_at_once]
            values = self._least(part, np.eye(len(part.least))[first])
            part.least[first] = np.maximum(values, part.least[first])
            part.most[first] = part.least[first]
            faces = faces[self._doubt(part)[faces] > 0.0]

    def _least(self, part: _Slice, weights: Array) -> Array:
        """Least sums of normal forces in a slice, N/m; it learns from the forces."""
        found = least_forces(self.model, weights, part.ends, self._iterations())
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
        strength = self.model.planar.model.free_friction * normal + self.model.strength
        limit = given_friction(replace(self.given, strength=strength), self._iterations())
        self._count(limit.iterations)
        self.last = normal.copy(), limit
        return limit

    def _iterations(self) -> int:
        """Iterations of HiGHS that are left to the next program."""
        left = (SEARCH.pivots - self.pivots) // self.model.forces.shape[0]
        if left < 1 or self.solved >= SEARCH.programs:
            raise _SpentError(f"{self.solved} linear programs did not bring it to an end")
        self.check_stop()
        return left

    def _count(self, iterations: int) -> None:
        self.solved += 1
        self.pivots += iterations * self.model.forces.shape[0]
