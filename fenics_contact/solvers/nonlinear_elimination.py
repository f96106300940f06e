"""One step of a path with a few joint points on their laws, and all others on their tangents.

A step along the tangent of a path (`arclength`) ends where the first joint point opens, closes,
sticks or slides. But few points do so at a time. The factor at hand tells how the structure answers
forces at these, C. With all points on their tangents, x0 + part c + s t, let D be what the laws
(`joint_law`) of the chosen points differ by from that. These differences are forces f(D) in excess
of those of the springs in the factor, and the structure answers them by displacements d(D):

    d(D(p, q)) - C f(D(p, q)) = 0,     D = x(p, q, mu(s)) - x0 - part c - s t,

two equations per chosen point for its p and q, exact where the laws of the others are as good as
linear (nonlinear elimination: P.J. Lanzkron, D.J. Rose, J.T. Wilkes, SIAM J. Sci. Comput. 17 (1996)
538). They are solved on two lines of (part, s): the corrector goes from (0, 0) to the path, the
predictor from there along it, as far as the laws of the other points allow. On a line the solutions
are a curve that may turn back, so that it is followed by its length too.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.solvers.compiled_laws import CompiledLaws, Structure, compiled_laws
from fenics_contact.solvers.joint_law import JointStates, SmoothedLaws
from fenics_contact.solvers.kkt import Iterate, Linearization, PerturbedKKT
from fenics_contact.solvers.problem import Array

Integers = npt.NDArray[np.int64]

#: Of what a product grows by: no number is larger.
_LARGEST_EXPONENT = 709.0

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class EliminationOptions:
    """Numbers of a step. Distances are those of points from their laws, relative to p and q.

    Attributes:
        points: Points chosen at most, before a step.
        late: Points at most that are chosen at once where they end the way to the path.
        rounds: How often points are chosen late in one step.
        chosen: Distance from which on a point is chosen.
        allowed: Largest distance of a point that is not chosen.
        bisections: Of the change of s up to which no more points bend than are chosen.
        curve_steps: Steps along a curve at most.
        longest: Longest step along a curve, in relative changes of p and q, and of s.
        shortest: Shortest step.
        room: Of s at least, on either side of where the path is reached.
        newton_steps: Newton steps at most of a step along a curve.
        solved: What they leave, relative to p and q.
        columns: Columns of C that are solved for at once.
    """

    points: int = 32
    late: int = 16
    rounds: int = 8
    chosen: float = 0.15
    allowed: float = 0.3
    bisections: int = 6
    curve_steps: int = 80
    longest: float = 3.0
    shortest: float = 3e-2
    room: float = 1e-4
    newton_steps: int = 7
    solved: float = 3e-2
    columns: int = 64


@dataclass(frozen=True)
class Line:
    """Values (part, s) = begin + tau direction."""

    begin: tuple[float, float]
    direction: tuple[float, float]

    def at(self, tau: float) -> tuple[float, float]:
        """Part and s."""
        (part, s), (of_part, of_s) = self.begin, self.direction
        return part + tau * of_part, s + tau * of_s


@dataclass(frozen=True)
class TangentModel:
    """Joint points on the tangents of their laws, in typical units.

    Attributes:
        laws: Their laws.
        start: x0, shape (5, points).
        correction: c, likewise.
        tangent: t, likewise.
        springs: Normal, tangential and coupling, then slope and give, of `LinearLaws`, shape
            (5, points).
        compliance: Of the points themselves, normal and tangential, shape (2, points).
        answers: Openings and slips for unit forces at the chosen points, normal and shear in turn,
            shape (2, 2 chosen points, points).
        mu: Product at x0.
        log_mu_rate: d(log mu)/ds.
    """

    laws: SmoothedLaws
    start: Array
    correction: Array
    tangent: Array
    springs: Array
    compliance: Array
    answers: Array
    mu: float
    log_mu_rate: float

    @classmethod
    def of(
        cls,
        linear: Linearization,
        correction: Iterate,
        tangent: Iterate,
        mu: float,
        log_mu_rate: float,
        smallest: float,
    ) -> TangentModel:
        """All points of this rank, without answers.

        Args:
            linear: Newton's equations at x0.
            correction: Newton's correction c.
            tangent: Tangent t with respect to s.
            mu: Product at x0, in typical units.
            log_mu_rate: d(log mu)/ds.
            smallest: Size of p and q by which changes are measured, at least.
        """
        kkt = linear.kkt
        d = kkt.scales.displacement
        f = kkt.scales.force
        laws = linear.laws
        springs = np.stack(laws.springs) * d / f
        return cls(
            kkt.law.smoothed(f, kkt.frictional, smallest),
            _in_typical_units(kkt, linear.now),
            _in_typical_units(kkt, correction),
            _in_typical_units(kkt, tangent),
            springs=np.concatenate([springs, [laws.slope, laws.give * f / d]]),
            compliance=kkt.problem.compliance * f / d,
            answers=np.empty((2, 0, kkt.problem.points)),
            mu=mu,
            log_mu_rate=log_mu_rate,
        )

    def mu_at(self, s: float) -> float:
        """Product at s."""
        return self.mu * math.exp(min(self.log_mu_rate * s, _LARGEST_EXPONENT))

    def moved(self, part: float, s: float) -> Array:
        """x0 + part c + s t."""
        return self.start + part * self.correction + s * self.tangent

    def states(self, part: float, s: float, forces: Array | None = None) -> JointStates:
        """States on the tangents, with excess forces at the chosen points, normal ones first."""
        moved = self.moved(part, s)
        motion = self._motion(forces)
        return JointStates(moved if motion is None else moved + self.response(*motion))

    def distances(self, part: float, s: float, forces: Array | None = None) -> Array:
        """Distances from the laws; infinite where a tangent leads nowhere."""
        compiled = compiled_laws()
        if compiled is None:
            distances = self.laws.distances(self.states(part, s, forces), self.mu_at(s))
            return np.where(np.isnan(distances), np.inf, distances)
        found = np.empty(len(self.laws.friction))
        motion = self._motion(forces)
        motion = np.zeros((2, len(found))) if motion is None else motion
        compiled.distances(self.structure, part, s, motion, found)
        return found

    @cached_property
    def structure(self) -> Structure | None:
        """The points as the compiled laws take them; None where there are none."""
        compiled = compiled_laws()
        if compiled is None:
            return None
        names = "start", "correction", "tangent", "springs", "compliance"
        fields = {name: np.ascontiguousarray(getattr(self, name)) for name in names}
        fields |= {n: getattr(self.laws, n) for n in ("friction", "strength", "dilatancy")}
        numbers = {n: getattr(self, n) for n in ("mu", "log_mu_rate")}
        return compiled.structure(
            "points",
            count=len(self.laws.friction),
            smallest=self.laws.smallest,
            carried=self.laws.carried[1],
            **numbers,
            **fields,
        )

    @cached_property
    def flexibility(self) -> Array:
        """C of chosen points: openings, then slips, for normal forces, then shear forces."""
        opening, slip = self.answers
        c = np.concatenate([opening.T, slip.T])
        return np.asfortranarray(np.concatenate([c[:, 0::2], c[:, 1::2]], axis=1))

    def _motion(self, forces: Array | None) -> Array | None:
        """Openings and slips for forces at the chosen points, normal ones first."""
        if forces is None or not len(forces):
            return None
        in_turn = forces.reshape(2, -1).T.ravel()
        return np.stack([in_turn @ self.answers[0], in_turn @ self.answers[1]])

    def response(self, opening: Array, slip: Array) -> Array:
        """Changes of states that displacements of the blocks cause: springs answer."""
        k_n, k_t, coupling, slope, give = self.springs
        moved = opening + slope * slip
        r = -k_n * moved
        shear = -k_t * slip - coupling * moved
        c_n, c_t = self.compliance
        dilation = -slope * slip - give * r
        return np.array([moved + (c_n + give) * r, r, slip + c_t * shear, shear, dilation])

    def displacements(self, states: Array) -> Array:
        """Openings and slips by displacements of blocks alone, shape (2, ..., points)."""
        y, r, w, shear, dilation = states
        c_n, c_t = self.compliance
        return np.array([y + dilation - c_n * r, w - c_t * shear])

    def excess(self, states: Array, displacements: Array) -> Array:
        """Forces in excess of those of the springs, normal ones first, shape (2, ..., points)."""
        k_n, k_t, coupling, slope, _ = self.springs
        (opening, slip), r, shear = displacements, states[1], states[3]
        moved = opening + slope * slip
        return np.array([r + k_n * moved, shear + k_t * slip + coupling * moved])


def _in_typical_units(kkt: PerturbedKKT, at: Iterate) -> Array:
    """Opening, r, slip, shear and dilation of joint points in typical units, shape (5, points)."""
    d = kkt.scales.displacement
    f = kkt.scales.force
    units = np.array([d, f, d, f, d])[:, None]
    dilation = kkt.law.dilation(at.z1, at.z2)
    return np.stack([at.y, at.pressure, at.slip, at.shear, dilation]) / units


@dataclass(frozen=True)
class CurvePoint:
    """A point on or near the curve of the chosen points on a line.

    Attributes:
        x: p and q of the chosen points, and tau.
        part: Of the correction.
        s: Change of the path's parameter.
        rest: What is left of the equations, shape (2 points,).
        forces: Excess forces, normal ones first.
        sizes: By which changes of x are measured.
        slopes: Derivatives of `rest` by x, shape (2 points, 2 points + 1).
    """

    x: Array
    part: float
    s: float
    rest: Array
    forces: Array
    sizes: Array
    slopes: Array

    @property
    def tau(self) -> float:
        """Place on the line."""
        return float(self.x[-1])

    @cached_property
    def error(self) -> float:
        """The largest rest, relative to p and q."""
        return float(np.max(np.abs(self.rest) / self.sizes[:-1], initial=0.0))


@dataclass(frozen=True)
class CurveStep:
    """A step along a curve of chosen points.

    Attributes:
        end: Where it leads; None where no step is short enough.
        corrections: Newton's steps that it took.
        length: Of the step, in units of the sizes of x.
        distance: Largest distance of the other points from their laws in the last step tried.
    """

    end: CurvePoint | None
    corrections: int
    length: float
    distance: float


@dataclass(frozen=True)
class CurveEnd:
    """Where a curve of chosen points was left.

    Attributes:
        point: On the curve.
        forward: Row whose product with the direction of the curve is positive there.
        bends: Whether a point that is not chosen bends beyond.
    """

    point: CurvePoint
    forward: Array
    bends: bool


@dataclass(frozen=True)
class ChosenPoints:
    """Equations of the chosen points on a line, the same on all ranks.

    Attributes:
        model: The points on their tangents.
        line: Values of part and s.
        options: Numbers of the curve.
    """

    model: TangentModel
    line: Line
    options: EliminationOptions

    def at(self, x: Array) -> CurvePoint:
        """What is left of the equations at x, with derivatives."""
        part, s = self.line.at(float(x[-1]))
        compiled = compiled_laws()
        moved, excess, sizes, slopes = (
            self._equations(x, part, s)
            if compiled is None
            else self._compiled_equations(compiled, x, part, s)
        )
        rest = moved[0] - self.model.flexibility @ excess[0]
        slopes[:, -1] = moved[1] - self.model.flexibility @ excess[1]
        return CurvePoint(x, part, s, rest, excess[0], sizes, slopes)

    def _equations(self, x: Array, part: float, s: float) -> tuple[Array, Array, Array, Array]:
        """Displacements, excess forces, sizes and slopes at x.

        The first two are of the laws' differences from the tangents, and of their change along the
        line, normal ones first, shape (2, 2 points). The last column of the slopes, shape
        (2 points, 2 points + 1), is left out.
        """
        model = self.model
        count = len(x) // 2
        p = x[:count]
        q = x[count:-1]
        of_part, of_s = self.line.direction
        states, (by_p, by_q, by_mu) = model.laws.linearized(p, q, model.mu_at(s))
        difference = states.values - model.moved(part, s)
        along = of_s * (model.log_mu_rate * by_mu - model.tangent) - of_part * model.correction
        changes = np.array([difference, along, by_p, by_q]).swapaxes(0, 1)
        moved = model.displacements(changes)
        excess = model.excess(changes, moved) * model.laws.carried[:, None]
        # A point's p and q change its own forces alone.
        normal = model.flexibility[:, None, :count]
        shear = model.flexibility[:, None, count:]
        by_pq = -(normal * excess[0, 2:] + shear * excess[1, 2:]).reshape(2, count, 2, count)
        np.einsum("skpk->spk", by_pq)[:] += moved[:, 2:]
        slopes = np.empty((2 * count, 2 * count + 1))
        slopes[:, :-1] = by_pq.reshape(2 * count, 2 * count)
        sizes = np.append(model.laws.sizes(states).ravel(), 1.0)
        moved, excess = (both[:, :2].swapaxes(0, 1).reshape(2, -1) for both in (moved, excess))
        return moved, excess, sizes, slopes

    def _compiled_equations(
        self, compiled: CompiledLaws, x: Array, part: float, s: float
    ) -> tuple[Array, Array, Array, Array]:
        """The results of `_equations`, compiled."""
        model = self.model
        count = len(x) // 2
        moved = np.empty((2, 2 * count))
        excess = np.empty((2, 2 * count))
        sizes = np.empty(2 * count + 1)
        columns = np.empty((2 * count + 1, 2 * count))
        given = model.structure, model.flexibility.T, part, s, *self.line.direction, x
        compiled.chosen_points(*given, moved, excess, sizes, columns)
        return moved, excess, sizes, columns.T

    def structure(self, compiled: CompiledLaws, **others: Any) -> Structure:
        """The curve as the compiled laws take it, with what they need of the other points."""
        names = "allowed", "longest", "shortest", "solved", "curve_steps", "newton_steps"
        numbers = {name: getattr(self.options, name) for name in names}
        (part, s), (of_part, of_s) = self.line.begin, self.line.direction
        line = {"part": part, "s": s, "of_part": of_part, "of_s": of_s}
        chosen = {"chosen": self.model.structure, "c": self.model.flexibility.T}
        return compiled.structure("curve", **chosen, **line, **numbers, **others)

    def direction(self, here: CurvePoint, forward: Array) -> Array | None:
        """Direction of the curve, largest relative change one; None where there is none."""
        along = _solved(here, forward, np.zeros(len(here.rest)), 1.0)
        if along is None or not np.all(np.isfinite(along)):
            return None
        return np.asarray(along / np.max(np.abs(along / here.sizes)))

    def step(
        self, here: CurvePoint, along: Array, length: float, reach: tuple[float, float]
    ) -> tuple[CurvePoint, int] | None:
        """Point a step on, not beyond some tau, and Newton's steps; None: not found."""
        ahead = here.tau + length * along[-1]
        end = _within(ahead, *reach)
        forward = along / here.sizes**2
        fixed = _tau(along)
        x = here.x + length * along
        if end != ahead:
            x = here.x + length * (end - here.tau) / (ahead - here.tau) * along
            x[-1], forward = end, fixed
        new = self.at(x)
        longest = self.options.longest
        for corrections in range(self.options.newton_steps + 1):
            if new.error <= self.options.solved:
                if reach[0] <= new.tau <= reach[1]:
                    return new, corrections
                new.x[-1] = end = _within(new.tau, *reach)
                new = self.at(new.x)
                forward = fixed
                continue
            if not np.isfinite(new.error) or abs(new.tau - end) > longest:
                return None
            change = _solved(new, forward, -new.rest, 0.0)
            if change is None or not abs(new.tau + change[-1] - here.tau) <= longest:
                return None
            new = self.at(new.x + change)
        return None

    def near(self, x: Array) -> CurvePoint | None:
        """Point of the curve next to x, with its tau; None where Newton's method finds none."""
        compiled = compiled_laws()
        if compiled is not None:
            x = x.copy()
            return self.at(x) if compiled.near(self.structure(compiled), x) else None
        here = self.at(x)
        fixed = _tau(x)
        for _ in range(self.options.newton_steps):
            if here.error <= self.options.solved:
                return here
            change = _solved(here, fixed, -here.rest, 0.0)
            if change is None or not np.all(np.isfinite(change)):
                return None
            here = self.at(here.x + change)
        return None

    def trace(
        self,
        x: Array,
        forward: Array,
        reach: tuple[float, float],
        distance: Callable[[CurvePoint], float],
    ) -> CurveEnd:
        """Follow the curve by its length, until it ends or a point that is not chosen bends.

        Args:
            x: Where the curve begins.
            forward: Row whose product with the direction there is positive.
            reach: Values of tau at which the curve ends.
            distance: Largest distance of the other points from their laws.
        """
        options = self.options
        here = self.at(x)
        length = 1.0
        near = 0.0
        for _ in range(options.curve_steps):
            along = self.direction(here, forward)
            if along is None:
                return CurveEnd(here, forward, False)
            step = self._step_near_laws(here, along, length, reach, near, distance)
            if step.end is None:
                return CurveEnd(here, forward, step.distance > options.allowed)
            here = step.end
            near = step.distance
            forward = along / here.sizes**2
            longer = 3.0 * step.length if step.corrections <= 3 else step.length
            length = min(longer, options.longest)
            if not reach[0] < here.tau < reach[1]:
                break
        return CurveEnd(here, forward, False)

    def _step_near_laws(
        self,
        here: CurvePoint,
        along: Array,
        length: float,
        reach: tuple[float, float],
        near: float,
        distance: Callable[[CurvePoint], float],
    ) -> CurveStep:
        """The step along the curve, shortened until the other points stay near their laws.

        Args:
            here: Where it begins.
            along: Direction of the curve there.
            length: That is tried first.
            reach: Values of tau at which the curve ends.
            near: Largest distance of the other points from their laws at `here`.
            distance: The same at other points.
        """
        options = self.options
        leaving = 0.0
        while length > options.shortest:
            found = self.step(here, along, length, reach)
            if found is None:
                length *= 0.4
                leaving = 0.0
                continue
            leaving = distance(found[0])
            if leaving <= options.allowed:
                return CurveStep(found[0], found[1], length, leaving)
            part = (options.allowed - near) / (leaving - near)
            length *= _within(part, 0.1, 0.5)
        return CurveStep(None, 0, length, leaving)


@dataclass(frozen=True)
class Step:
    """Where a step leads: displacements and joint states, still without a new factor.

    Attributes:
        moved: The iterate on the tangents with the answers to the excess forces.
        states: States of this rank's joint points, in typical units.
        s: Change of the path's parameter.
        reached: Whether the corrector reached the path.
    """

    moved: Iterate
    states: JointStates
    s: float
    reached: bool


class NonlinearElimination:
    """A step of a path from one place, on the factor there."""

    def __init__(
        self,
        linear: Linearization,
        correction: Iterate,
        tangent: Iterate,
        model: TangentModel,
        options: EliminationOptions | None = None,
    ) -> None:
        """Take Newton's equations at the place, c and t, and all points on their tangents."""
        self.options = options or EliminationOptions()
        self.linear = linear
        self.correction = correction
        self.tangent = tangent
        self.model = model
        self.problem = linear.kkt.problem
        self._chosen = np.zeros((0, 2), dtype=np.int64)  # rank and place there
        self._others = np.ones(self.problem.points, dtype=bool)
        self._distances = np.zeros(self.problem.points)  # those last asked for
        #: s per part of the shortest way c + s t to the path: at right angles to t.
        self.back = self._shortest_way()

    def step(self, reach: tuple[float, float] | None, ahead: float) -> Step:
        """Go to the path, and along it.

        Args:
            reach: Least and largest s; None: only to the path, with s held.
            ahead: Change of s along the path for which the points are chosen that follow their
                laws; its sign tells where the path leads on.
        """
        if reach is None:
            self.back, ahead = 0.0, 0.0
        options = self.options
        back = self.back
        with np.errstate(all="ignore"):  # tangents may lead anywhere, and are then not followed
            self._choose(self._first_to_bend(ahead))
            model, last = self._to_path()
            reached = last.tau >= 1.0
            if reached and reach is not None:
                curve = ChosenPoints(model, Line((1.0, 0.0), (0.0, 1.0)), options)
                begin = np.append(last.x[:-1], back)
                reach = min(reach[0], back - options.room), max(reach[1], back + options.room)
                last = self._trace(curve, begin, _tau(begin, float(np.sign(ahead))), reach).point
            return Step(*self._moved(model, last), last.s, reached)

    def _to_path(self) -> tuple[TangentModel, CurvePoint]:
        """The chosen points, and where their curve on the line to the path ends.

        Points that end it by bending are chosen too, if that leads to the path. A shorter step
        before is better where there was one: a way from afar may lead to another path.
        """
        line = Line((0.0, 0.0), (1.0, self.back))
        curve = ChosenPoints(self._gathered(), line, self.options)
        start = JointStates(curve.model.start)
        begin = np.concatenate([start.p, start.q, [0.0]])
        few = self._trace(curve, begin, _tau(begin), (-1.0, 1.0))
        end = few
        model = curve.model
        kept = self.model, self._chosen, self._others.copy()
        for _ in range(self.options.rounds):
            if not end.bends:
                break
            self._choose(self._worst(self._distances, self.options.late))
            curve = ChosenPoints(self._gathered(), line, self.options)
            near = curve.near(_with_more(curve.model, end.point))
            if near is None:
                break
            forward = _longer(end.forward, len(near.x))
            end = self._trace(curve, near.x, forward, (-1.0, 1.0))
            if end.point.tau >= 1.0:
                return curve.model, end.point
        self.model, self._chosen, self._others = kept
        return model, few.point

    def _trace(
        self, curve: ChosenPoints, begin: Array, forward: Array, reach: tuple[float, float]
    ) -> CurveEnd:
        """Where a curve is left that begins somewhere; arguments as of `ChosenPoints.trace`.

        It is compiled where all points are on this rank.
        """
        compiled = compiled_laws()
        if compiled is None or self.problem.comm.size > 1:
            return curve.trace(begin, forward, reach, self._distance)
        x = begin.copy()
        forward = forward.copy()
        low, high = reach
        others = {"all": self.model.structure, "answers": self.model.answers}
        others |= {"others": self._others}
        followed = curve.structure(compiled, low=low, high=high, **others)
        bends = compiled.trace(followed, x, forward, self._distances)
        return CurveEnd(curve.at(x), forward, bends)

    def _distance(self, at: CurvePoint) -> float:
        """Largest distance of the points that are not chosen from their laws, on all ranks."""
        distances = self.model.distances(at.part, at.s, at.forces)
        self._distances = np.where(self._others, distances, 0.0)
        return self.problem.max(self._distances)

    def _shortest_way(self) -> float:
        """-t.c / t.t, by relative changes of p and q, with s counted once per point."""
        model = self.model
        sizes = model.laws.sizes(JointStates(model.start))
        along, across = (
            model.laws.carried * np.stack([states.p, states.q]) / sizes
            for states in (JointStates(model.tangent), JointStates(model.correction))
        )
        square = self.problem.sum(np.sum(along**2, axis=0) + 1.0)
        return -self.problem.sum(along * across) / square if square else 0.0

    def _first_to_bend(self, ahead: float) -> Integers:
        """Points that leave their laws first, on the way to the path, and then along it."""
        model = self.model
        options = self.options
        back = self.back
        reached = model.distances(1.0, back)

        def to_path(part: float) -> Array:
            return model.distances(part, part * back)

        def along_path(part: float) -> Array:
            return np.maximum(reached, model.distances(1.0, back + part * ahead))

        on_the_way = self._too_many(reached)
        distances = to_path if on_the_way else along_path
        low = 1e-5
        high = 1.0
        found = reached if on_the_way else along_path(1.0)
        if on_the_way or self._too_many(found):
            first = np.zeros_like(found)
            for _ in range(options.bisections):
                middle = float(np.sqrt(low * high))
                tried = distances(middle)
                if self._too_many(tried):
                    high = middle
                    found = tried
                else:
                    low = middle
                    first = tried
            # Distances end at about one. Farther on, points that bend first are no more the worst.
            found = np.where(first > options.chosen, np.inf, found)
        return self._worst(found, options.points)

    def _too_many(self, distances: Array) -> bool:
        """Whether more points bend than may be chosen."""
        bending = np.count_nonzero(distances > self.options.chosen)
        return sum(self.problem.gather(bending)) > self.options.points

    def _worst(self, distances: Array, most: int) -> Integers:
        """Points of all ranks furthest from their laws: their ranks and places there."""
        rank = self.problem.comm.rank
        options = self.options
        place = np.flatnonzero(distances > min(options.chosen, options.allowed))
        place = place[np.argsort(-distances[place], kind="stable")[:most]]
        mine = [(-distances[k], rank, k) for k in place]
        worst = sorted(chain(*self.problem.gather(mine)))[:most]
        return np.array([found[1:] for found in worst], dtype=np.int64).reshape(-1, 2)

    def _choose(self, chosen: Integers) -> None:
        """Choose more points: openings and slips of this rank's points for unit forces at them."""
        width = self.options.columns // 2
        parts = [
            _answers_to(self.linear, chosen[first : first + width])
            for first in range(0, len(chosen), width)
        ]
        if len(self._chosen):
            parts = [self.model.answers, *parts]
        if parts:
            answers = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
            self.model = replace(self.model, answers=answers)
        self._chosen = np.concatenate([self._chosen, chosen])
        self._others[chosen[chosen[:, 0] == self.problem.comm.rank, 1]] = False

    def _gathered(self) -> TangentModel:
        """Model of the chosen points, gathered from their ranks."""
        problem = self.problem
        mine = np.flatnonzero(self._chosen[:, 0] == problem.comm.rank)
        order = np.argsort(np.concatenate(problem.gather(mine)))
        places = self._chosen[mine, 1]

        def whole(of: Any) -> Any:
            values = {field.name: getattr(of, field.name) for field in fields(of)}
            parts = problem.gather(
                {n: a.take(places, axis=-1) for n, a in values.items() if np.ndim(a)}
            )
            joined = {n: np.concatenate([part[n] for part in parts], axis=-1) for n in parts[0]}
            return replace(of, **{n: a.take(order, axis=-1) for n, a in joined.items()})

        return replace(whole(self.model), laws=whole(self.model.laws))

    def _moved(self, model: TangentModel, last: CurvePoint) -> tuple[Iterate, JointStates]:
        """Where a point of the chosen points' curve moves the structure and all points."""
        linear = self.linear
        kkt = self.linear.kkt
        problem = self.problem
        part = last.part
        s = last.s
        moved = linear.now.moved(part, self.correction).moved(s, self.tangent)
        mine = np.flatnonzero(self._chosen[:, 0] == problem.comm.rank)
        places = self._chosen[mine, 1]
        if len(self._chosen):
            forces = np.zeros((2, len(self._others)))
            forces[:, places] = kkt.scales.force * last.forces.reshape(2, -1)[:, mine]
            change = linear.factor.solve(problem.joint_forces(*forces))
            change, factor = linear.hold_work(change)
            moved = replace(
                moved,
                u=moved.u + change,
                elastic=moved.elastic + problem.elastic_part(change),
                load_factor=moved.load_factor + factor,
            )
        values = self.model.states(part, s, last.forces).values
        p, q = np.split(last.x[:-1], 2)
        exact = model.laws.states(p, q, model.mu_at(s)).values
        values[:, places] = exact[:, mine]
        _log.debug("         %d points, part %.2g, s %.2g", len(self._chosen), part, s)
        return moved, JointStates(values)


def _with_more(model: TangentModel, last: CurvePoint) -> Array:
    """Values at a point of a curve of fewer points; new points, at the end, are on tangents."""
    before = len(last.x) // 2
    forces = _longer(last.forces, 2 * len(model.laws.friction))
    states = JointStates(model.states(last.part, last.s, forces).values)
    p, q = np.split(last.x[:-1], 2)
    more = np.append(p, states.p[before:]), np.append(q, states.q[before:])
    return np.concatenate([*more, last.x[-1:]])


def _tau(x: Array, change: float = 1.0) -> Array:
    """A row whose product with a change of x is that of tau."""
    row = np.zeros(len(x))
    row[-1] = change
    return row


def _longer(values: Array, size: int) -> Array:
    """Values of p and q, or r and shear, with zeros for more points; a last odd one stays last."""
    both = values[: len(values) // 2 * 2].reshape(2, -1)
    more = np.zeros((2, size // 2 - both.shape[1]))
    return np.append(np.concatenate([both, more], axis=1), values[both.size :])


def _solved(at: CurvePoint, forward: Array, rest: Array, product: float) -> Array | None:
    """A change of x by which `rest` and the product with a row change as asked for."""
    matrix = np.empty((len(forward), len(forward)))
    right = np.empty(len(forward))
    matrix[:-1], matrix[-1] = at.slopes, forward
    right[:-1], right[-1] = rest, product
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return None


def _within(value: float, least: float, largest: float) -> float:
    """The value, or the end of a range that it is beyond; nan stays nan."""
    return min(max(float(value), least), largest)


def _answers_to(linear: Linearization, points: Integers) -> Array:
    """Answers of all to unit forces at some points, with the work of the live load held."""
    problem = linear.kkt.problem
    scales = linear.kkt.scales
    maps = problem.normal, problem.tangential
    mine = {}
    for k, (rank, point) in enumerate(points):
        if rank == problem.comm.rank:
            for side, rows in enumerate(maps):
                mine[2 * k + side] = rows.row(int(point))
    columns = {k: row for some in problem.gather(mine) for k, row in some.items()}
    solutions = linear.factor.solve_sparse([columns[k] for k in range(2 * len(points))])
    displacements = solutions.getDenseArray().T
    live = problem.live
    response = linear.live_response
    works = sum(problem.gather(displacements @ live))
    displacements -= np.outer(works / linear.flexibility, response)
    unit = scales.force / scales.displacement
    products = [rows.matrix.matMult(solutions) for rows in maps]
    answers = np.empty((2, len(displacements), problem.points))
    for side, product in enumerate(products):
        np.multiply(product.getDenseArray().T, unit, out=answers[side])
    for matrix in (solutions, *products):
        matrix.destroy()
    return answers
