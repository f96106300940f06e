"""Rigid blocks with straight faces as arrays, and the linear programs that these make.

    E x + f_D + lambda f_L = 0,   l <= x <= u          (every body, in its free motions).

On a straight face between two bodies only the resultants matter: the normal forces at its two ends,
with their friction, and one shear force by given strengths are enough, whatever the mesh. So x are,
at both ends of every face, multiples of the edges (1, F) and (1, -F) of Coulomb's cone, one of them
where F = 0; then the shear forces that the strengths bound. Each side of a face carries them where
its nodes are: across a gap these are two lines, as far apart all along.

Programs are solved by HiGHS. Where it leaves open whether there is an x with A x = b, the least
missing forces s, A x + s = b, tell.

The lower end of the bracket: friction that all collapse states have for sure.

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
from functools import cached_property, partial
from typing import Any, NamedTuple, TypeVar

import numpy as np

from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.geometry.mesh import Indices
from fenics_contact.results.bounds import meet
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.problem import Array

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class LinearProgram:
    """min c.x subject to A x = b, l <= x <= u.

    Attributes:
        cost: c, shape (unknowns,).
        columns: A, sparse, shape (equations, unknowns).
        right: b, shape (equations,).
        ends: l and u, infinite where there is none, shape (unknowns, 2).
    """

    cost: Array
    columns: Any
    right: Array
    ends: Array

    def answer(self, method: str, options: dict[str, Any] | None = None) -> Any:
        """HiGHS' answer with the least cost; its status is 0 where it has one."""
        from scipy.optimize import linprog

        names = "primal_feasibility_tolerance", "dual_feasibility_tolerance"
        steps = SEARCH.program_iterations * sum(self.columns.shape)
        exact = dict.fromkeys(names, SEARCH.decade * SEARCH.digits)
        options = exact | {"maxiter": steps} | (options or {})
        equations = self.columns, self.right
        return linprog(self.cost, None, None, *equations, self.ends, method, None, options)

    def least_missing(self) -> tuple[float, Array, Array]:
        """Least sum of forces missing to the equilibrium, its multipliers, and unknowns.

        Raises:
            SolverError: If HiGHS finds no answer.
        """
        from scipy.sparse import eye, hstack

        rows, unknowns = self.columns.shape
        missing = eye(rows, format="csr")
        cost = np.repeat([0.0, 1.0], [unknowns, 2 * rows])
        ends = np.vstack([self.ends, np.tile([0.0, np.inf], (2 * rows, 1))])
        whole = LinearProgram(cost, hstack([self.columns, missing, -missing]), self.right, ends)
        for method in ("highs-ds", "highs-ipm"):
            answer = whole.answer(method)
            if answer.status == 0:
                return float(answer.fun), answer.eqlin.marginals, answer.x[:unknowns]
        raise SolverError(f"rigid-block linear program failed: {answer.message}")


@dataclass(frozen=True)
class BlockModel:
    """Equilibrium of rigid blocks with some friction and strengths of their faces.

    Attributes:
        planar: Faces, joint points and blocks, with the loads.
        friction: F of every face, shape (faces,).
        strength: Bounds on the shear forces of the faces, N/m.
        forces: E, sparse.
    """

    planar: PlanarFaces
    friction: Array
    strength: Array
    forces: Any

    @classmethod
    def of(cls, planar: PlanarFaces, friction: Array, strength: Array) -> BlockModel:
        """The faces with laws of their own."""
        from scipy.sparse import diags, hstack

        motion = planar.model.transposed.tocsc()
        shear = motion[:, 2::3]
        normal = hstack([motion[:, 0::3], motion[:, 1::3]]).tocsc()
        sliding = hstack([shear, shear]) @ diags(np.tile(friction, 2))
        rough = np.flatnonzero(np.tile(friction, 2))
        columns = [normal + sliding, (normal - sliding).tocsc()[:, rough], shear]
        return cls(planar, friction, strength, hstack(columns).tocsr())

    @cached_property
    def unit(self) -> float:
        """Force that is 1 in the programs, N/m: the largest of the dead load."""
        bodies = self.planar.bodies
        force = float(np.abs(bodies.dead).max(initial=0.0))
        strength = float(self.planar.joints.shear_strength.max(initial=0.0))
        return force or strength or float(np.abs(bodies.live).max(initial=0.0)) or 1.0

    @cached_property
    def load(self) -> float:
        """Load factor that is 1 in the programs."""
        live = float(np.abs(self.planar.bodies.live).max(initial=0.0))
        return self.unit / live if live else 1.0

    @property
    def has_strength(self) -> bool:
        """Whether some face has a compressive strength."""
        return bool(np.any(self.planar.model.kappa))

    @property
    def is_large(self) -> bool:
        """Whether HiGHS takes a second or more for a program, and the kernel is asked first."""
        return bool(self.forces.shape[1] > SEARCH.large_program) or self.units.has_many_blocks

    @property
    def units(self) -> FaceModel:
        """The faces for the face engine, with these laws."""
        laws = {"strength": self.strength, "friction": self.friction}
        dilatancy = np.minimum(self.planar.model.dilatancy, self.friction)
        return replace(self.planar.model, **laws, dilatancy=dilatancy)

    @cached_property
    def _rough(self) -> Indices:
        """Ends of faces with friction, among the first ends of all and then the second ones."""
        return np.flatnonzero(np.tile(self.friction, 2))

    def ends(self, unit: float) -> Array:
        """Least and largest x, forces in a unit, shape (unknowns, 2).

        An infinite one leaves the strengths out. Then faces with a finite one carry nothing.
        """
        kappa = self.planar.model.kappa
        carried = np.full(len(kappa), np.inf)
        np.divide(0.5 / unit, kappa, out=carried, where=kappa > 0.0)
        both = np.tile(carried, 2)
        pressing = np.concatenate([both, both[self._rough]])
        bound = self.strength / unit
        least = np.concatenate([np.zeros(len(pressing)), -bound])
        return np.column_stack([least, np.concatenate([pressing, bound])])

    def at_ends(self, x: Array) -> tuple[Array, Array]:
        """Normal and shear forces at the first ends of all faces, then the second ones."""
        count = len(self.friction)
        forward, edges, bound = np.split(x, [2 * count, 2 * count + len(self._rough)])
        backward = np.bincount(self._rough, edges, 2 * count).astype(float)
        shear = np.tile(self.friction, 2) * (forward - backward)
        shear[:count] += bound
        return forward + backward, shear

    def pressing(self, weights: Array) -> Array:
        """Weighted sums of the faces' normal forces, as coefficients of x, by rows."""
        ends = np.hstack([weights, weights])
        return np.hstack([ends, ends[:, self._rough], np.zeros_like(weights)])

    def standing(self, load_factor: float) -> LinearProgram:
        """Any forces in equilibrium with the loads."""
        unit = max(self.unit, abs(load_factor) * self.unit / self.load)
        loads = self.planar.model.dead + load_factor * self.planar.model.live
        ends = self.ends(unit)
        return LinearProgram(np.zeros(len(ends)), self.forces, -loads / unit, ends)

    def largest(self) -> LinearProgram:
        """The largest load factor; unknowns are (lambda, x), in units of load and force."""
        from scipy.sparse import hstack

        live = self.planar.model.live * (self.load / self.unit)
        ends = np.vstack([[-np.inf, np.inf], self.ends(self.unit)])
        columns = hstack([live[:, None], self.forces]).tocsr()
        cost = -np.eye(1, len(ends)).ravel()
        return LinearProgram(cost, columns, -self.planar.model.dead / self.unit, ends)


def wedging_forces(model: BlockModel) -> Array | None:
    """Forces at all joint points, few and small, that balance the live load alone; or None.

    Shape (2, points): normal and shear, N/m for a load factor of 1.

    Raises:
        SolverError: If HiGHS finds no answer.
    """
    unit = model.unit / model.load
    ends = model.ends(np.inf)
    right = -model.planar.model.live / unit
    balance = LinearProgram(np.ones(len(ends)), model.forces, right, ends)
    missing, _, x = balance.least_missing()
    if missing > SEARCH.rounding:
        return None
    least = balance.answer("highs-ds")
    x = least.x if least.status == 0 else x
    at = model.planar.faces.ends.T.ravel()
    count = len(model.planar.joints.length)
    return np.stack([np.bincount(at, force, count) for force in model.at_ends(unit * x)])


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


_Answer = TypeVar("_Answer", GivenFriction, LeastForces)


def lower_end(model: BlockModel, upper: float, check_stop: Callable[[], None]) -> float:
    """No collapse state has a load factor below this; minus infinity if nothing is proved.

    Args:
        model: Blocks with associative friction.
        upper: u.
        check_stop: Called before every program; may raise `Stopped`.
    """
    dilatancy = model.planar.model.dilatancy
    given = BlockModel.of(model.planar, dilatancy, model.strength)
    search = _SliceSearch(model, given, check_stop, upper + SEARCH.rounding * abs(upper))
    try:
        search.run()
    except (SolverError, Stopped) as error:
        _log.info("  lower end of the bracket: %s", error)
    _log.info(
        "  lower end of the bracket: %.8g by %d programs", search.lower, len(search.iterations)
    )
    return search.lower


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
class _SliceSearch:
    """Linear programs on the way to the lower end.

    Attributes:
        model: Blocks with associative friction.
        given: Blocks with dilatancy as their friction.
        check_stop: Called before every program.
        upper: u.
        lower: No collapse state is below.
        iterations: Of HiGHS, in every program.
        found: Admissible forces: load factors, and normal forces of all faces.
        last: Normal forces for which P was asked last, and the answer.
    """

    model: BlockModel
    given: BlockModel
    check_stop: Callable[[], None]
    upper: float
    lower: float = -np.inf
    iterations: list[int] = field(default_factory=list)
    found: list[tuple[float, Array]] = field(default_factory=list)
    last: tuple[Array, GivenFriction] | None = None

    def run(self) -> None:
        """Raise the lower end with all load factors up to u as far as it goes, then by slices."""
        least = np.zeros_like(self.model.strength)
        self.lower = self._limit(least).factor
        while not self._closed:
            factor, least = self._raised(self.upper, least)
            size = self.upper - self.lower if np.isfinite(self.upper) else abs(self.lower)
            enough = (
                factor > self.lower + SEARCH.least_gain * size or self.lower == -np.inf < factor
            )
            self.lower = max(self.lower, factor)
            if not enough:
                break
        if not (np.isfinite(self.lower) and np.isfinite(self.upper)):
            return
        width = thinnest = SEARCH.rough_gap * (self.upper - self.lower)
        while not self._closed:
            end = min(self.lower + width, self.upper)
            factor = min(self._raised(end, least)[0], end)
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

    def _raised(self, high: float, least: Array) -> tuple[float, Array]:
        """No collapse state of the slice from the lower end on is below this, and its n.

        As far as it is worth while; `least` is not above n. The forces found in the slice tell.
        """
        low = self.lower
        inside = [normal for factor, normal in self.found if low <= factor <= high]
        most = np.min([np.full_like(least, np.inf), *inside], axis=0)
        part = _Slice((low, high), least.copy(), most)
        worthwhile = low + SEARCH.least_gain * (high - low) if high < np.inf else low
        for step in itertools.count():
            limit = self._limit(part.least)
            if limit.factor > high:
                return limit.factor, part.least
            # Faces that slip and whose n is not known yet, those with the most power first.
            power = self.model.planar.model.free_friction * limit.slip * self._doubt(part)
            order = np.argsort(-power, kind="stable")
            faces = order[power[order] > SEARCH.digits * power.max(initial=0.0)]
            if not len(faces):
                return limit.factor, part.least
            # At first the slice may turn out to be no gain.
            known = step < 2 and bool(np.all(np.isfinite(part.most)))
            if known and self._limit(part.most).factor <= worthwhile:
                return limit.factor, part.least
            self._minimise(part, faces)
            if part.empty:
                break
        return np.inf, part.least

    def _doubt(self, part: _Slice) -> Array:
        """Differences of what n may be, N/m, up to the unit of forces; 0 where it is known."""
        unit = self.model.unit
        doubt = np.minimum(part.most - part.least, unit)
        return np.where(doubt > SEARCH.digits * unit, doubt, 0.0)

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
        found = self._answered(partial(least_forces, self.model, weights, part.ends))
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
        given = replace(self.given, strength=strength)
        limit = self._answered(partial(given_friction, given))
        self.last = normal.copy(), limit
        return limit

    def _answered(self, program: Callable[[int], _Answer]) -> _Answer:
        """What a program answers in the iterations of HiGHS that are left to it."""
        equations = self.model.forces.shape[0]
        left = SEARCH.pivots // equations - sum(self.iterations)
        if left < 1 or len(self.iterations) >= SEARCH.programs:
            raise SolverError(f"{len(self.iterations)} linear programs did not bring it to an end")
        self.check_stop()
        answer = program(left)
        self.iterations.append(answer.iterations)
        return answer
