"""The loading path of blocks with springs at faces or points, rigid or not, followed by its length.

At fixed products mu of slacks and multipliers the elastic state with Coulomb's law is a smooth
function of the load factor, or of the work beyond its folds:

    s o z = mu e  for every unit,   H d + e + C x + w - G_s^T z = 0,   H^T x + f_D + lambda f_L = 0.

Unknowns of a unit are p = n / f - y / d and q = t / f - w / d, f and d a typical force and
displacement, y and w the multipliers of n >= 0 and of the bound on t. Forces and multipliers follow
from them such that s o z = mu e holds whatever the step: no step ends at a boundary. Newton's
matrix A is that of `kernel`; one factor gives the correction and the tangent. Corrections are at
right angles to the tangent (E. Riks, Int. J. Solids Struct. 15 (1979) 529).

The work is free: at folds of the load factor and of the work nothing more is needed. The load
factor changes with the sign of det A. The path begins at rest, under the dead load, and ends at a
work at which the elastic state is near a collapse. There the products fall to nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.cones import TINY, Array
from fenics_contact.faces.kernel import (
    Arrays,
    FaceIterate,
    FacePoint,
    FaceTolerances,
    Method,
    Newton,
    Program,
    elastic_response,
    solve,
)
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.system import Equations
from fenics_contact.search_options import SEARCH


@dataclass(frozen=True)
class Place:
    """A point of the path, or a change of it.

    Attributes:
        units: (p, q) of units, shape (units, m).
        motion: d, shape (motions,).
        load_factor: lambda.
    """

    units: Array
    motion: Array
    load_factor: float

    def plus(self, other: Place, weight: float = 1.0) -> Place:
        """The sum with a multiple of another one."""
        return Place(
            self.units + weight * other.units,
            self.motion + weight * other.motion,
            self.load_factor + weight * other.load_factor,
        )


@dataclass(frozen=True)
class UnitLaw:
    """Coulomb's law of units at fixed products, as a function of p and q.

    Attributes:
        model: The units.
        strength: c, positive, shape (units,).
        force: f.
        displacement: d.
        mu: The products.
    """

    model: FaceModel
    strength: Array
    force: float
    displacement: float
    mu: float

    @property
    def small(self) -> float:
        """Mu over f d."""
        return self.mu / (self.force * self.displacement)

    def state(self, units: Array) -> tuple[Array, Arrays, Arrays]:
        """Forces, multipliers and slacks of units at (p, q)."""
        model = self.model
        count = model.pressing
        e = self.small
        slack, pressed = self._pressed(units[:, :count])
        shear = units[:, count:]
        size = np.linalg.norm(shear, axis=1)
        bound = self.strength / self.force + model.friction * pressed.sum(axis=1)
        left = _left(size - bound, bound, e)
        along = shear / np.maximum(size, TINY)[:, None]
        slid = (bound - left)[:, None] * along
        force = self.force * np.hstack([pressed, slid])
        far = 2.0 * bound - left
        if model.shears == 1:
            ahead = shear[:, 0] >= 0.0
            both = np.where(ahead, left, far), np.where(ahead, far, left)
            slacks: Arrays = (self.force * np.column_stack([slack, *both]),)
            return force, (self.mu / slacks[0],), slacks
        cone = np.column_stack([bound, slid])
        dual = 2.0 * self.mu / (self.force * left * far)[:, None] * cone
        dual[:, 1:] *= -1.0
        return (
            force,
            (self.mu / (self.force * slack), dual),
            (self.force * slack, self.force * cone),
        )

    def _pressed(self, p: Array) -> tuple[Array, Array]:
        """Slacks and pressing forces over f at p.

        n - e / s = p where pressure has no limit, s = n; else the minimum of the convex function

            |n|^2 / 2 - p . n - e sum log s_i,   s_i = n_i - kappa N^2.
        """
        e = self.small
        root = np.sqrt(p * p + 4.0 * e)
        pressed = np.where(p > 0.0, 0.5 * (p + root), 2.0 * e / np.maximum(root - p, TINY))
        slack = pressed.copy()
        limited = self.model.kappa > 0.0
        if np.any(limited):
            kappa = self.force * self.model.kappa[limited]
            slack[limited], pressed[limited] = _below_strength(p[limited], kappa, e)
        return slack, pressed

    def units(self, force: Array, duals: Arrays) -> Array:
        """(p, q) of forces and multipliers; linear in both where pressure has no limit."""
        count = self.model.pressing
        if self.model.shears == 1:
            slip = (duals[0][:, count + 1] - duals[0][:, count])[:, None]
        else:
            slip = duals[1][:, 1:]
        opened = np.hstack([duals[0][:, :count], slip])
        return force / self.force - opened / self.displacement

    def _turned(self, normal: Array, opened: Array) -> Array:
        """What the strength adds to p: 2 kappa N sum y / d, shape (units, 1)."""
        return np.asarray(2.0 * self.model.kappa * normal * opened / self.displacement)[:, None]

    def change(self, at: FacePoint, step: FacePoint) -> Array:
        """Change of (p, q) with forces and multipliers, to first order."""
        changed = self.units(step.force, step.duals)
        if np.any(self.model.kappa):
            normal, opened, dn, dy = (
                values[:, : self.model.pressing].sum(axis=1)
                for values in (at.force, at.duals[0], step.force, step.duals[0])
            )
            changed[:, : self.model.pressing] += self._turned(normal, dy) + self._turned(dn, opened)
        return changed

    def at(self, force: Array) -> Array:
        """(p, q) of forces inside all bounds."""
        slacks = self.model.slacks(force, self.strength, self.model.friction)
        duals = [self.mu / slacks[0]]
        if self.model.shears > 1:
            cone = slacks[1]
            left = cone[:, 0] ** 2 - np.sum(cone[:, 1:] ** 2, axis=1)
            dual = 2.0 * self.mu / left[:, None] * cone
            dual[:, 1:] *= -1.0
            duals.append(dual)
        units = self.units(force, tuple(duals))
        count = self.model.pressing
        opened = duals[0][:, :count].sum(axis=1)
        units[:, :count] += self._turned(self.model.normal(force), opened)
        return units


def _below_strength(p: Array, kappa: Array, e: float) -> tuple[Array, Array]:
    """Slacks and pressing forces of units with a compressive strength, see `UnitLaw._pressed`.

    With u = kappa N^2 + 2 kappa N Y, Y = sum e / s_i, slacks have s_i - e / s_i = p_i - u, and

        N = (u / kappa) / (Y + sqrt(Y^2 + u / kappa)),   sum s_i = N - 2 kappa N^2

    is one equation for u: its left side is larger at 0, and less far away.
    """

    def at(u: Array) -> tuple[Array, Array, Array, Array]:
        """Slacks, N, what is missing of the equation, and its derivative."""
        v = p - u[:, None]
        root = np.sqrt(v * v + 4.0 * e)
        slack = np.where(v > 0.0, 0.5 * (v + root), 2.0 * e / np.maximum(root - v, TINY))
        opened = (e / slack).sum(axis=1)
        normal = (u / kappa) / (opened + np.sqrt(opened**2 + u / kappa))
        rate = (1.0 / kappa - 2.0 * normal * (e / (slack * root)).sum(axis=1)) / (normal + opened)
        missing = slack.sum(axis=1) - normal + 2.0 * kappa * normal**2
        slope = (2.0 * kappa * normal - 0.5) * rate - (slack / root).sum(axis=1)
        return slack, normal, missing, slope

    low = np.zeros(len(p))
    high = np.ones(len(p))
    while np.any(more := at(high)[2] > 0.0):
        high[more] *= 4.0
    u = 0.5 * high
    for _ in range(SEARCH.interior_steps):
        slack, normal, missing, slope = at(u)
        low = np.where(missing > 0.0, u, low)
        high = np.where(missing > 0.0, high, u)
        better = u - missing / slope
        inside = (better > low) & (better < high)
        # Between ends of different size the middle is a geometric one.
        middle = np.maximum(np.sqrt(low * high), SEARCH.slight * high)
        before, u = u, np.where(inside, better, middle)
        if np.all(np.abs(u - before) <= 1e-15 * u):
            break
    return slack, slack + (kappa * normal**2)[:, None]


def _left(beyond: Array, bound: Array, e: float) -> Array:
    """Distance l of the shear force to its bound b, with e / l - l - e / (2 b - l) = |q| - b.

    The left side is convex and falls; Newton's steps from below stay below.
    """

    def root(v: Array) -> Array:
        size = np.sqrt(v * v + 4.0 * e)
        return np.where(v > 0.0, 2.0 * e / np.maximum(v + size, TINY), 0.5 * (size - v))

    left = np.minimum(root(beyond + e / bound), bound)
    for _ in range(SEARCH.interior_steps):
        far = 2.0 * bound - left
        value = e / left - left - e / far - beyond
        step = value / (e / left**2 + 1.0 + e / far**2)
        step = np.clip(step, -0.5 * left, bound - left)
        left = left + step
        if np.all(np.abs(step) <= 1e-14 * left):
            break
    return left


class FacePath:
    """The path of one model at fixed products.

    Attributes:
        law: Of the units, with the products.
        equations: Of the model; they count factorisations.
        unit: Works are in units of it: that of a typical live load on closed faces.
        places: That were passed, as far as the path was followed.
    """

    def __init__(
        self,
        model: FaceModel,
        equations: Equations,
        way: Way,
        effort: float,
        check_stop: Callable[[], None],
    ) -> None:
        """Take a model, how to follow, factorisations at most; `check_stop` may raise `Stopped`.

        Raises:
            SolverError: If the faces do not hold the blocks.
        """
        self._model = model
        self.places: list[Place] = []
        self._way = way
        self.equations = equations
        self.allow(effort)
        self._check_stop = check_stop
        self._response = elastic_response(model, self.equations)
        pressed = self._response.dead_force[:, : model.pressing]
        typical = max(
            np.sqrt(self._response.dead_work / self._response.work),
            SEARCH.small_factor * model.force / model.load,
        )
        self.unit = float(typical * self._response.work)
        self._displacement = self.unit / float(np.abs(model.live).sum())
        laws = model.strength, model.friction, model.dilatancy
        program = Program(model, self.equations, *laws, self.unit, elastic=True)
        self._method = Method(program, replace(SEARCH, regularization=0.0))
        self.law = UnitLaw(
            model,
            self._method.strength,
            float(pressed.max(initial=0.0)) or model.force,
            SEARCH.follow_works * self._displacement,
            0.0,
        )
        self._set_products(way.products)

    @property
    def reached(self) -> float:
        """Work of the last place that was passed, in units of `unit`."""
        return self.work(self.places[-1]) / self.unit if self.places else 0.0

    def allow(self, effort: float) -> None:
        """So many factorisations from now on."""
        self._most = self.equations.factorizations + effort

    def _set_products(self, products: float) -> None:
        self.law = replace(self.law, mu=products * self.law.force * self._displacement)

    @property
    def _products(self) -> float:
        return self.law.mu / (self.law.force * self._displacement)

    def work(self, at: Place | FaceIterate) -> float:
        """W of a place, or of a state."""
        return float(self._model.live @ at.motion)

    def iterate(self, at: Place) -> FaceIterate:
        """A place in terms of the kernel."""
        return self._system(at).iterate

    def _system(self, at: Place) -> Newton:
        force, duals, slacks = self.law.state(at.units)
        none = np.zeros(0)
        point = FacePoint(at.motion, at.load_factor, force, (*duals, none), (*slacks, none))
        return Newton(self._method, point, point.slacks)

    def _newton(self, at: Place) -> tuple[Place, Place, float]:
        """Newton's correction at a load factor, the tangent, and the sign of det A."""
        self._check_stop()
        if self.equations.factorizations > self._most:
            raise TooLong("the path is too long")
        here = self._system(at)
        here.factor()
        step, tangent = (
            Place(self.law.change(here.iterate, one), one.motion, one.load_factor)
            for one in (here.correction(), here.tangent())
        )
        return step, tangent, here.solver.sign

    def _sizes(self, units: Array) -> Array:
        """Lengths of p and q, in which changes of them are told."""
        count = self._model.pressing
        least = max(3.0 * np.sqrt(self.law.small), self._way.short)
        shear = np.linalg.norm(units[:, count:], axis=1)[:, None] + least
        sizes = [np.abs(units[:, :count]) + least, *([shear] * self._model.shears)]
        return np.hstack(sizes)

    def _length(self, step: Array, units: Array) -> float:
        """Largest relative change of p and q."""
        return float(np.abs(step / self._sizes(units)).max())

    def _corrected(self, at: Place, work: float | None, rounds: int, close: float = 1e-2) -> Place:
        """Newton's method at a work, or at the load factor of the place (None)."""
        for _ in range(rounds):
            step, tangent, _ = self._newton(at)
            if work is not None:
                rise = np.divide(work - self.work(at.plus(step)), self.work(tangent))
                step = step.plus(tangent, float(rise))
            length = self._length(step.units, at.units)
            if not np.isfinite(length):
                break
            at = at.plus(step, SEARCH.path_change / max(length, SEARCH.path_change))
            if length < close:
                return at
        raise SolverError("Newton's method does not settle")

    def start(self) -> Place:
        """The state at rest under the dead load."""
        model = self._model
        force = np.zeros(model.shape)
        pressed = self._response.dead_force[:, : model.pressing]
        least = SEARCH.small_factor * self.law.force
        force[:, : model.pressing] = np.maximum(pressed, least)
        if np.any(model.kappa):  # inside the strengths
            most = (0.125 / np.where(model.kappa > 0.0, model.kappa, TINY))[:, None]
            beyond = model.kappa * model.normal(force) > 0.25
            force[:, : model.pressing] = np.where(beyond[:, None], most, force[:, : model.pressing])
        at = Place(self.law.at(force), np.zeros_like(model.live), 0.0)
        return self._corrected(at, None, 60)

    def beside(self, other: FaceIterate) -> Place:
        """The place of the same work next to a state of other blocks with the same units."""
        at = Place(self.law.at(other.force), other.motion, other.load_factor)
        return self._corrected(at, self.work(at), 40)

    def points(
        self, at: Place, works: float, length: float = 0.3, before: Array | None = None
    ) -> Iterator[Place]:
        """Places of the path after one, in order, until a work.

        Args:
            at: Where to begin.
            works: In units of `unit`.
            length: Of the first step.
            before: Change of p and q until there; None: load factors rise at first.

        Raises:
            SolverError: If the path is lost, or needs too many factorisations.
        """
        end = works * self.unit
        turned = 1.0
        _, tangent, sign = self._newton(at)
        turned = sign if before is None else 1.0
        while True:
            weights = self._sizes(at.units) ** -2
            ahead = turned * sign
            if before is not None:
                size = np.sqrt(np.sum(before**2 * weights) * np.sum(tangent.units**2 * weights))
                cosine = float(np.sum(before * tangent.units * weights) / size)
                if ahead * cosine < -SEARCH.decade:  # det A changes sign at a branch point
                    turned, ahead = -turned, -ahead
            rate = ahead / max(self._length(tangent.units, at.units), TINY)
            while True:
                rise = rate * length
                more = rise * self.work(tangent)
                last = self.work(at) + more >= end and more > 0.0
                try:
                    if last:
                        part = (end - self.work(at)) / more
                        yield self._corrected(at.plus(tangent, part * rise), end, 12)
                        return
                    found = self._across(at.plus(tangent, rise), tangent.units * weights)
                    if self._length(found[0].units - at.units, at.units) < 4.0 * length + 0.1:
                        break
                except TooLong:
                    raise
                except SolverError:
                    pass
                length *= SEARCH.follow_shorter
                if length < SEARCH.verified:
                    raise SolverError(f"the path is lost at load factor {at.load_factor:.6g}")
            before = ahead * tangent.units
            at, tangent, sign, rounds = found
            yield at
            length = min(SEARCH.follow_longest, length * (2.0, 2.0, 1.3, 0.8, 0.8, 0.8)[rounds])

    def followed(self, works: float) -> list[Place]:
        """Places of the path from its start to some works; in shorter steps from where it is lost.

        Raises:
            SolverError: If it comes to no end.
        """
        way = self._way
        self._way = replace(way, short=0.3 * way.short)
        places = self.places = [self.start()]
        before: Array | None = None
        lost = ""
        for part, length in ((1.0, 0.3), (0.3, 0.1)):
            self._way = replace(way, short=part * way.short)
            try:
                for place in self.points(places[-1], works, length, before):
                    places.append(place)
            except TooLong:
                raise
            except SolverError as error:
                lost = str(error)
            else:
                return places
            self.places = max(self.places, places, key=lambda some: self.work(some[-1]))
            places = places[: max(1, len(places) - SEARCH.no_progress + 1)]
            before = places[-1].units - places[-2].units if len(places) > 1 else None
        raise SolverError(lost)

    def _across(self, at: Place, across: Array) -> tuple[Place, Place, float, int]:
        """The place of the path in the plane across its tangent, its tangent, and corrections.

        Raises:
            SolverError: If Newton's method does not soon come there.
        """
        goal = float(np.sum(across * at.units))
        last = np.inf
        for rounds in range(SEARCH.no_progress):
            step, tangent, sign = self._newton(at)
            lacks = goal - float(np.sum(across * (at.units + step.units)))
            step = step.plus(tangent, float(np.divide(lacks, np.sum(across * tangent.units))))
            length = self._length(step.units, at.units)
            if not (length < max(2.0 * last, 0.5) and length < 5.0):
                break
            at = at.plus(step)
            last = length
            if length < self._way.short:
                return at, tangent, sign, rounds
        raise SolverError("the path is not near")

    def settled(self, at: Place, least: float, work: float | None) -> Place:
        """The state at a work, or at the load factor of the place (None), with small products.

        The products fall as far as Newton's method follows.
        """
        usual = ratio = 0.2
        while self._products > 1.01 * least and ratio < 0.9:
            law = self.law
            self._set_products(max(ratio * self._products, least))
            try:
                at = self._corrected(at, work, 25)
                ratio = max(usual, ratio**1.5)
            except TooLong:
                self.law = law
                break
            except SolverError:
                self.law = law
                ratio **= 0.5
        try:
            return self._corrected(at, work, 12, SEARCH.rounding)
        except SolverError:
            return at

    def at_load(self, at: Place) -> FaceIterate:
        """The state at the load factor of a place, products as small as they become.

        Raises:
            SolverError: If Newton's method does not find it.
        """
        return self.iterate(self.settled(self._corrected(at, None, 25), SEARCH.face_gap, None))

    def without_products(self, at: Place, work: float | None = None) -> FaceIterate:
        """The state at a work, that of the place, products as small as they become.

        The interior point method comes there in a few steps, or not at all; then products fall
        step by step.

        Raises:
            SolverError: If Newton's method does not find it.
        """
        if work is None:
            work = self.work(at)
        else:
            at = self._corrected(at, work, 25)
        laws = self.law.strength, self._model.friction, self._model.dilatancy
        program = Program(self._model, self.equations, *laws, work, elastic=True)
        found = solve(program, self.iterate(at), FaceTolerances(SEARCH.face_gap))
        if found.gap <= SEARCH.face_gap:
            return found
        products = self._products
        end = self.iterate(self.settled(at, SEARCH.face_gap, work))
        self._set_products(products)
        return end


class TooLong(SolverError):
    """The path needs more factorisations than it may."""


@dataclass(frozen=True)
class Way:
    """How a path is begun and followed.

    Attributes:
        products: mu in units of f and the typical displacement.
        short: Length of p and q, over f, to which changes are relative at least; and length of
            the last correction.
    """

    products: float
    short: float = 0.1


#: Ways, the usual one first. Larger products and short steps lead to an end where it does not, but
#: a path with them takes another branch now and then.
WAYS = (Way(1e-3), Way(1e-2), Way(1e-2, short=0.03))
#: Those of walls of `SEARCH.large_wall` blocks and more.
LARGE_WAYS = (Way(1e-2), Way(1e-3))


@dataclass(frozen=True)
class Followed:
    """A path that was followed to its end.

    Attributes:
        path: How.
        places: Of the path, in order.
        iterate: The state at the work of the last place, without products.
        is_whole: Whether that is the work asked for; else the path is lost there.
    """

    path: FacePath
    places: list[Place]
    iterate: FaceIterate
    is_whole: bool = True

    @property
    def work(self) -> float:
        """W at the end."""
        return self.path.work(self.places[-1])

    def state(self, work: float) -> FaceIterate:
        """The state of the path at a work, where it first comes there.

        Raises:
            SolverError: If Newton's method does not find it.
        """
        self.path.allow(SEARCH.follow_large_effort)
        works = [self.path.work(place) for place in self.places]
        k = next(k for k in range(len(works)) if works[k] >= work or k == len(works) - 1)
        low, high = self.places[max(k - 1, 0)], self.places[k]
        part = (work - works[max(k - 1, 0)]) / ((works[k] - works[max(k - 1, 0)]) or 1.0)
        for near in (between(low, high, part), low):
            with suppress(SolverError):
                return self.path.without_products(near, work)
        return self.path.without_products(high, work)

    def top(self, higher: float) -> FaceIterate | None:
        """The highest state of the path, if it is higher than the end by a relative part.

        Between places beside the highest one the summit is looked for by its load factor.
        """
        factors = [place.load_factor for place in self.places]
        top = int(np.argmax(factors))
        least = self.iterate.load_factor + higher * abs(self.iterate.load_factor)
        if factors[top] <= least or top == len(factors) - 1:
            return None
        sides = self.places[max(top - 1, 0)], self.places[top], self.places[top + 1]
        low, middle, high = (self.path.work(place) for place in sides)
        best: FaceIterate | None = None
        known: dict[float, float] = {}
        works = [middle]
        if low < middle < high:
            works += [0.5 * (low + middle), 0.5 * (middle + high)]
        for _ in range(SEARCH.works):
            for work in works:
                with suppress(SolverError):
                    found = self.state(work)
                    known[work] = found.load_factor
                    best = max(filter(None, (best, found)), key=lambda one: one.load_factor)
            if best is None or len(known) < 3:
                break
            order = sorted(known)
            k = min(max(order.index(max(known, key=known.__getitem__)), 1), len(order) - 2)
            works = [0.5 * (order[k - 1] + order[k]), 0.5 * (order[k] + order[k + 1])]
        return best if best is not None and best.load_factor > least else None


def between(low: Place, high: Place, part: float) -> Place:
    """The place at a part of the way from one to another."""
    change = Place(
        high.units - low.units, high.motion - low.motion, high.load_factor - low.load_factor
    )
    return low.plus(change, part)


def state_at(
    model: FaceModel, load_factor: float, check_stop: Callable[[], None] = lambda: None
) -> FaceIterate | None:
    """The state of the loading path where it first comes to a load factor; None if it does not."""
    for way in WAYS[:2]:
        path = FacePath(model, Equations(model), way, SEARCH.follow_large_effort, check_stop)
        with np.errstate(all="ignore"), suppress(SolverError):
            before = path.start()
            for place in path.points(before, SEARCH.follow_works):
                if place.load_factor >= load_factor:
                    rise = place.load_factor - before.load_factor
                    part = (load_factor - before.load_factor) / rise
                    return path.at_load(between(before, place, part))
                before = place
    return None


def followed(
    model: FaceModel,
    equations: Equations,
    effort: float,
    check_stop: Callable[[], None] = lambda: None,
    work: float | None = None,
    end: Callable[[FacePath, Place], FaceIterate] = FacePath.without_products,
) -> Followed:
    """The loading path of a model to its end, in the first way that leads there.

    Where none does, it ends where the one that came furthest is lost.

    Args:
        model: Its live load is not zero.
        equations: Of the model.
        effort: Factorisations of one way at most.
        check_stop: May raise `Stopped`.
        work: W at its end; None: `SearchOptions.follow_works`.
        end: The state at the last place; by default products fall to nothing there.

    Raises:
        SolverError: If no way leads to an end.
    """
    reasons = []
    ways: tuple[Way, ...] = WAYS
    large = model.blocks >= SEARCH.large_wall
    if large:  # a step is dear, and larger products are lost less often
        effort, ways = min(effort, SEARCH.follow_large_effort), LARGE_WAYS
    furthest: FacePath | None = None
    for way in ways:
        path = FacePath(model, equations, way, effort, check_stop)
        try:
            with np.errstate(all="ignore"):
                places = path.followed(SEARCH.follow_works if work is None else work / path.unit)
                return Followed(path, places, end(path, places[-1]))
        except SolverError as error:
            reasons.append(str(error))
        if path.reached > (furthest.reached if furthest else 0.0):
            furthest = path
        if large and furthest:
            break
    if furthest is None or work is not None:
        raise SolverError(", ".join(dict.fromkeys(reasons)))
    with np.errstate(all="ignore"):
        last = furthest.without_products(furthest.places[-1])
    return Followed(furthest, furthest.places, last, is_whole=False)
