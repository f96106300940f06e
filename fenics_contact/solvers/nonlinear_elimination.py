"""The central path as few joint points bend it, while all others stay on their tangents.

A step along the tangent of the path (`central_path`) ends where the first joint point opens,
closes, sticks or slides. But few points do so at a time, and the factor at hand tells how the
structure answers forces at these, C. With all points on their tangents, x0 + part c + turn t, let D
be what the true laws (`smoothed_laws`) of the chosen points differ by from that. Those differences
are forces f(D) of their own, in excess of what the springs of the factor transmit, that the
structure answers by displacements:

    d(D(p, q)) - C f(D(p, q)) = 0,     D = x(p, q, mu exp(turn)) - x0 - part c - turn t,

twice as many equations as chosen points, for their p and q, exact where the other points' laws are
as good as linear. Their solutions are followed by length too, first across to the path, part from
0 to 1, at right angles to the tangent, or if that leads nowhere at the same mu; then along it, turn
from there, as far as the others' laws allow: those of points that come to move are watched on the
way, and all are looked at where it ends. Points that stop it are chosen in addition, and it goes on
from there. (Nonlinear elimination: P.J. Lanzkron, D.J. Rose, J.T. Wilkes, SIAM J. Sci.
Comput. 17 (1996) 538.)
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from enum import Enum, auto
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from fenics_contact.solvers.kkt import Iterate, State
from fenics_contact.solvers.smoothing import JointStates, SmoothedLaws

if TYPE_CHECKING:
    from fenics_contact.solvers.arclength import CentralPath, Place

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_log = logging.getLogger("fenics_contact")

#: Points chosen first, most of them, and how often others are chosen in addition.
FIRST, MOST, ROUNDS = 16, 32, 3

#: Distance from its law, relative to its p and q, from which on a point is chosen, and the largest
#: that is left.
SERIOUS, LEFT = 0.15, 0.3

#: Distance from which on a point is watched along a curve. Others are looked at where it ends.
NOTICED = 0.02

#: Change of log mu for which points are chosen, that is far enough for none to be added, and the
#: largest.
AIMED, ENOUGH, LARGEST_CHANGE = 2.0, 0.4, 3.0

#: Steps along the curve of few points, at most, and how often the place is halved up to which it
#: is to lead.
CURVE_STEPS, HALVINGS = 80, 6

#: Lengths of these steps, the largest relative change of p, q and the parameter: the first, the
#: shortest, the shortest before a point that is not chosen, the longest.
FIRST_LENGTH, SHORTEST, CLOSE_TO_OTHERS, LONGEST = 1.0, 1e-4, 0.1, 3.0

#: By how much they are shortened where Newton's method fails, and made longer where it is quick.
SHORTER, LONGER, QUICK = 0.4, 3.0, 3

#: By how much they are shortened, at most and at least, where a point that is not chosen leaves its
#: law, and from which part of the distance that ends a curve on none is tried again.
LESS, NEARLY = (0.1, 0.5), 0.5

#: Newton steps of each, and what they leave, relative to p and q.
NEWTON_STEPS, SOLVED = 7, 1e-2

#: Part below which a curve that turns back is left.
BACK = -0.5

#: Part of the products asked for at which a path ends, so that rounding does not make them larger.
PAST = 0.999

#: Places of part and turn among the unknowns.
PART, TURN = -2, -1

#: Columns of C that are solved for at once.
COLUMNS = 16


class Course(Enum):
    """What is followed: the way across to the path, at right angles or at its mu, and the path."""

    ACROSS = auto()
    LEVEL = auto()
    ALONG = auto()


@dataclass(frozen=True)
class LinearStates:
    """Joint points on the tangents of their laws, in typical units.

    Attributes:
        start: States x0, shape (4, points).
        across: The step c to the path, likewise.
        along: The tangent t, likewise.
        springs: Those that the blocks feel, normal, tangential and coupling, shape (3, points).
        give: Compliance of the points themselves, normal and tangential, shape (2, points).
    """

    start: Array
    across: Array
    along: Array
    springs: Array
    give: Array

    def moved(self, part: float, turn: float) -> Array:
        """x0 + part c + turn t."""
        return self.start + part * self.across + turn * self.along

    def answer(self, opening: Array, slip: Array) -> Array:
        """States that change with displacements of blocks: springs answer."""
        k_n, k_t, coupling = self.springs
        r, shear = -k_n * opening, -k_t * slip - coupling * opening
        return np.array([opening + self.give[0] * r, r, slip + self.give[1] * shear, shear])

    def displacements(self, states: Array) -> Array:
        """Openings and slips by displacements of blocks alone, shape (2, ..., points)."""
        y, r, w, shear = states
        return np.array([y - self.give[0] * r, w - self.give[1] * shear])

    def excess(self, states: Array, displacements: Array) -> Array:
        """Forces in excess of those of the springs, normal ones first, shape (2, ..., points)."""
        k_n, k_t, coupling = self.springs
        (opening, slip), r, shear = displacements, states[1], states[3]
        return np.array([r + k_n * opening, shear + k_t * slip + coupling * opening])

    def at(self, points: Integers | slice) -> LinearStates:
        """Those of some points."""
        return LinearStates(*(getattr(self, field.name)[:, points] for field in fields(self)))


@dataclass(frozen=True)
class _Others:
    """Points on their tangents, with forces at the chosen ones.

    Attributes:
        laws: Their laws.
        linear: Their states on the tangents.
        answers: Openings and slips for unit forces at the chosen points, normal and shear in turn,
            shape (2, 2 chosen points, points).
        products: mu at x0, in typical units.
    """

    laws: SmoothedLaws
    linear: LinearStates
    answers: Array
    products: float

    def values(self, part: float, turn: float, forces: Array | None = None) -> Array:
        """States for forces, normal ones first."""
        moved = self.linear.moved(part, turn)
        if forces is None:
            return moved
        in_turn = forces.reshape(2, -1).T.ravel()
        return moved + self.linear.answer(*(in_turn @ answer for answer in self.answers))

    def distances(self, part: float, turn: float, forces: Array | None = None) -> Array:
        """Distances from the laws."""
        mu = self.products * float(np.exp(turn))
        distances = self.laws.distances(self.values(part, turn, forces), mu)
        return np.nan_to_num(distances, nan=np.inf)


@dataclass(frozen=True)
class _OnCurve:
    """A point on or near the curve of the chosen points.

    Attributes:
        x: p and q of the chosen points, part and turn.
        rest: What is left of the equations.
        forces: Forces in excess of those of the springs.
        sizes: By which changes of x are measured.
        slopes: Derivatives of `rest` by x, shape (2 points, 2 points + 2).
        excess: Those of a point's two forces by part and turn, and by its p and q, shape
            (2, 4, points).
    """

    x: Array
    rest: Array
    forces: Array
    sizes: Array
    slopes: Array
    excess: Array

    def force_slope(self, row: Array) -> Array:
        """Derivative of the product of a row with the forces by x."""
        normal, shear = row.reshape(2, -1)
        part, turn, p, q = normal * self.excess[0] + shear * self.excess[1]
        return np.concatenate([p, q, (part.sum(), turn.sum())])

    @property
    def left(self) -> float:
        """The largest part of what is left, relative."""
        return float(np.max(np.abs(self.rest) / self.sizes[:-2], initial=0.0))


@dataclass(frozen=True)
class _Traced:
    """Where a curve led.

    Attributes:
        last: The last point.
        furthest: That with the largest part.
        complete: Whether the last one is the end asked for.
        forward: Row whose product with the direction there is positive.
        stopped: The point at which other points' laws ended it, or None.
    """

    last: _OnCurve
    furthest: _OnCurve
    complete: bool
    forward: Array
    stopped: _OnCurve | None

    @property
    def turn(self) -> float:
        """Turn at the last point."""
        return float(self.last.x[TURN])


@dataclass(frozen=True)
class FewEquations:
    """The equations of the chosen points, the same on all ranks.

    Attributes:
        laws: Their laws.
        linear: Their states on the tangents.
        compliance: C, openings and slips for normal and shear forces, in typical units, shape
            (2 points, 2 points).
        products: mu at x0, in typical units.
    """

    laws: SmoothedLaws
    linear: LinearStates
    compliance: Array
    products: float

    @property
    def start(self) -> Array:
        """The numbers p and q of x0, and no part or turn."""
        states = JointStates(self.linear.start)
        return np.concatenate([states.p, states.q, np.zeros(2)])

    def at(self, x: Array) -> _OnCurve:
        """What is left at p and q, part and turn, and its derivatives."""
        count = len(x) // 2 - 1
        p, q, part, turn = x[:count], x[count:-2], float(x[PART]), float(x[TURN])
        mu = self.products * float(np.exp(turn))
        states, by = self.laws.linearised(p, q, mu)
        difference = states.values - self.linear.moved(part, turn)
        changes = np.array([difference, -self.linear.across, by.mu - self.linear.along, by.p, by.q])
        changes = changes.swapaxes(0, 1)
        moved = self.linear.displacements(changes)
        excess = self.linear.excess(changes, moved) * self._carried
        rest, of_part, of_turn = (
            moved[:, k].ravel() - self.compliance @ excess[:, k].ravel() for k in range(3)
        )
        slopes = np.empty((2 * count, 2 * count + 2))
        slopes[:, PART], slopes[:, TURN] = of_part, of_turn
        # A point's p and q change its own forces alone, part and turn those of all.
        normal, shear = self._compliances
        by_states = normal * excess[0, 3:] + shear * excess[1, 3:]
        slopes[:, :PART] = -by_states.reshape(2 * count, 2 * count)
        slopes.ravel()[self._own] += moved[:, 3:].ravel()
        sizes = np.append(self.laws.sizes(states, mu).ravel(), (1.0, 1.0))
        return _OnCurve(x, rest, excess[:, 0].ravel(), sizes, slopes, excess[:, 1:])

    def continued(self, last: _OnCurve) -> Array:
        """Where the first few of these points led, with the others on their tangents."""
        before = len(last.x) // 2 - 1
        forces = np.zeros((2, len(self.laws.sticky)))
        forces[:, :before] = last.forces.reshape(2, -1)
        opening, slip = np.split(self.compliance @ forces.ravel(), 2)
        values = self.linear.moved(*last.x[[PART, TURN]]) + self.linear.answer(opening, slip)
        states = JointStates(values)
        p, q = np.split(last.x[:-2], 2)
        return np.concatenate([p, states.p[before:], q, states.q[before:], last.x[-2:]])

    def turned(self, start: _OnCurve, last: _OnCurve) -> float:
        """Sign of the determinant of their derivatives, relative to that at the start."""
        signs = (np.linalg.slogdet(at.slopes[:, :-2])[0] for at in (start, last))
        return float(np.prod(list(signs))) or 1.0

    @cached_property
    def _compliances(self) -> tuple[Array, Array]:
        """C for normal and for shear forces, shape (2 points, 1, points)."""
        count = len(self.laws.sticky)
        return self.compliance[:, None, :count], self.compliance[:, None, count:]

    @cached_property
    def _own(self) -> Integers:
        """Places in `slopes` of a point's opening and slip by its own p and q."""
        count = len(self.laws.sticky)
        side, number, point = np.ogrid[:2, :2, :count]
        places = (side * count + point) * (2 * count + 2) + number * count + point
        return np.asarray(places.ravel())

    @cached_property
    def _carried(self) -> Array:
        """Whether there is a force, normal or shear: none where slip is free; shape (2, 1, n)."""
        sticky = self.laws.sticky
        return np.array([np.ones(len(sticky)), sticky])[:, None]


@dataclass(frozen=True)
class Step:
    """Where a step leads.

    Attributes:
        iterate: A point with equal products.
        products: Its mu.
        reached: Whether the step reached the path itself.
    """

    iterate: Iterate
    products: float
    reached: bool


class FewPoints:
    """A step of the central path from one place, on the factor there.

    Attributes:
        back: Part a of the tangent that makes the step c + a t to the path as short as it can be.
    """

    def __init__(self, path: CentralPath, place: Place) -> None:
        """Describe all points by their tangents.

        Args:
            path: The path.
            place: Where it has led; the factor is that of its equations.
        """
        self.path = path
        self.place = place
        self.problem = problem = path.problem
        d, f = path.scales.displacement, path.scales.force
        units = np.array([d, f, d, f])[:, None]

        def states(of: Iterate) -> Array:
            return np.stack([of.y, of.pressure, of.z2 - of.z1, of.shear]) / units

        self.linear = LinearStates(
            states(place.iterate),
            states(place.to_path),
            states(place.tangent),
            np.stack(path.felt(place.springs)) * d / f,
            problem.give * f / d,
        )
        self.laws = SmoothedLaws(
            problem.friction, problem.strength / f, path.sticky, path.smallest, path.growth
        )
        self._sizes = self.laws.sizes(JointStates(self.linear.start), place.products)
        along, across = self._rates(self.linear.along), self._rates(self.linear.across)
        #: t.t and t.c, with log mu counted once per point.
        self._square = problem.sum(np.sum(along**2, axis=0) + 1.0)
        self._product = problem.sum(np.sum(along * across, axis=0))
        self.back = -self._product / self._square
        self._chosen: Integers
        self._others: npt.NDArray[np.bool_]
        #: Openings and slips of this rank's points for forces at the chosen ones, normal and shear
        #: in turn, shape (2, 2 times as many as may be chosen, points), filled as they are chosen.
        self._answers = np.empty((2, 2 * max(FIRST, MOST), len(self.laws.sticky)))
        self._watched = np.zeros(len(self.laws.sticky), dtype=bool)
        self._choose_none()

    def follow(self, end: float, along: bool = True, limit: float = LEFT) -> Step:
        """Go to the path and along it.

        Args:
            end: Products at which to stop.
            along: Whether to go on along the path.
            limit: Distance of points from their laws at which going along ends.
        """
        with np.errstate(all="ignore"):  # tangents may lead anywhere, and are then not followed
            self._answer(self._choose(along))
            step = self._led(end, along, limit, ROUNDS)
            if not step.reached and self.problem.max(self._distances(1.0, self.back)) <= LEFT:
                step.iterate.destroy()
                self._choose_none()
                step = self._led(end, along, limit, 0)
            return step

    def again(self, end: float, limit: float) -> Step:
        """The same step, but not as far, after others were made: the place is factored again."""
        self.path.back_to(self.place)
        with np.errstate(all="ignore"):
            return self._led(end, True, limit, 0, limit)

    def destroy(self) -> None:
        """Free the vectors of the place."""
        self.place.destroy()

    def _led(
        self, end: float, along: bool, limit: float, rounds: int, across: float = LEFT
    ) -> Step:
        """Where the chosen points lead, and those that are chosen in addition in some rounds."""
        equations = self._equations()
        curve = self._curve(Course.ACROSS, equations)
        here, forward, furthest = curve.begin, curve.fixed, curve.begin
        while True:
            on_path = curve.course is Course.ALONG
            reach = self._reach(self.back, end) if on_path else (BACK, 1.0)
            traced = self._trace(curve, here, forward, reach, limit if on_path else across)
            if traced.complete and along and not on_path:
                sign = self.place.sign * equations.turned(curve.begin, traced.last)
                curve, here = self._curve(Course.ALONG, equations, traced.last), traced.last
                forward = sign * curve.fixed
                continue
            enough = traced.complete or (on_path and abs(traced.turn - self.back) > ENOUGH)
            new = self._chosen[:0]
            if rounds and traced.stopped is not None and not enough:
                distances = self._distances_on(traced.stopped)
                new = self._worst(distances, MOST - len(self._chosen))
            if len(new):
                rounds -= 1
                self._answer(new)
                equations = self._equations()
                curve, here, forward = self._gone_on(equations, curve.course, traced)
            elif on_path or traced.complete:
                return self._moved(traced.last, equations, True)
            elif curve.course is Course.LEVEL:
                if furthest.x[PART] < traced.furthest.x[PART]:
                    furthest = traced.furthest
                there = equations.at(equations.continued(furthest))
                return self._moved(there, equations, False)
            else:
                furthest = traced.furthest
                curve = self._curve(Course.LEVEL, equations)
                here, forward = curve.begin, curve.fixed

    def _curve(
        self, course: Course, equations: FewEquations, begin: _OnCurve | None = None
    ) -> _Curve:
        """The curve of a course, from the place itself if no other point is given."""
        begin = equations.at(equations.start) if begin is None else begin
        rows, none = np.eye(len(begin.x)), np.zeros_like(begin.forces)
        if course is Course.ACROSS:
            return _Curve(course, equations, begin, *self._at_right_angles(equations, begin))
        return _Curve(
            course, equations, begin, rows[PART if course is Course.ALONG else TURN], none
        )

    def _gone_on(
        self, equations: FewEquations, course: Course, before: _Traced
    ) -> tuple[_Curve, _OnCurve, Array]:
        """How more points go on from where the first of them led, or else from the beginning."""
        there = equations.at(equations.continued(before.last))
        curve = self._curve(course, equations, there if course is Course.ALONG else None)
        here = curve.corrected(there)
        if here is None:
            curve = self._curve(Course.ACROSS, equations)
            return curve, curve.begin, curve.fixed
        p, q = np.split(before.forward[:-2], 2)
        none = np.zeros(len(equations.laws.sticky) - len(p))
        return curve, here, np.concatenate([p, none, q, none, before.forward[-2:]])

    def _rates(self, change: Array) -> Array:
        """Relative changes of p and q, shape (2, points)."""
        states = JointStates(change)
        return np.stack([states.p, np.where(self.laws.sticky, states.q, 0.0)]) / self._sizes

    def _at_right_angles(self, equations: FewEquations, start: _OnCurve) -> tuple[Array, Array]:
        """The tangent as rows for changes of the chosen points, part and turn, and for forces.

        The other points' part is in those of part and turn, and in that of the forces that move
        them.
        """
        sizes = start.sizes[:-2]
        carried = np.append(np.ones_like(equations.laws.sticky), equations.laws.sticky)
        along, across = (
            np.append(states.p, states.q) * carried / sizes
            for states in (
                JointStates(equations.linear.along),
                JointStates(equations.linear.across),
            )
        )
        of_others = self._product - along @ across, self._square - along @ along
        p, q = np.where(self._others, self._rates(self.linear.along) / self._sizes, 0.0)
        (k_n, k_t, coupling), (give_n, give_t) = self.linear.springs, self.linear.give
        p_r, q_r = (1.0 - give_n) * p, (1.0 - give_t) * q  # by the force that answers
        by_opening, by_slip = -p - k_n * p_r - coupling * q_r, -q - k_t * q_r
        openings, slips = self._answers[:, : 2 * len(self._chosen)]
        forces = self.problem.comm.allreduce(openings @ by_opening + slips @ by_slip)
        return np.append(along / sizes, of_others), np.asarray(forces.reshape(-1, 2).T.ravel())

    def _reach(self, turn: float, end: float) -> tuple[float, float]:
        """Smallest and largest turn from some turn on."""
        lowest = min(np.log(PAST * end / self.place.products), turn - SHORTEST)
        return max(turn - LARGEST_CHANGE, lowest), turn + LARGEST_CHANGE

    def _of(self, points: Integers | slice) -> _Others:
        """Some of this rank's points on their tangents."""
        answers = self._answers[:, : 2 * len(self._chosen), points]
        return _Others(self.laws.at(points), self.linear.at(points), answers, self.place.products)

    def _distances(self, part: float, turn: float, forces: Array | None = None) -> Array:
        """Distances of this rank's points, as linear as they are, from their laws."""
        return self._of(slice(None)).distances(part, turn, forces)

    def _distances_on(self, here: _OnCurve) -> Array:
        """The same on a curve; those of the chosen points mean nothing."""
        part, turn = here.x[[PART, TURN]]
        return self._distances(part, turn, here.forces)

    def _choose_none(self) -> None:
        """Leave all points on their tangents."""
        count = len(self.laws.sticky)
        self._chosen = np.zeros((0, 2), dtype=np.int64)  # rank and place there
        self._others = np.ones(count, dtype=bool)

    def _choose(self, along: bool) -> Integers:
        """Points whose laws bend first on the way across, and then along."""
        back, sign = self.back, self.place.sign
        found = reached = self._distances(1.0, back)

        def across(logarithm: float, points: Integers | slice) -> Array:
            part = np.exp(logarithm)
            return self._of(points).distances(part, part * back)

        def on(logarithm: float, points: Integers | slice) -> Array:
            turn = back + sign * np.exp(logarithm)
            return np.maximum(reached[points], self._of(points).distances(1.0, turn))

        if self._serious(reached) > FIRST:
            found = self._up_to(across, -10.0, 0.0)
        elif along:
            found = self._up_to(on, np.log(1e-5), np.log(AIMED))
        self._watched = found > NOTICED
        return self._worst(found, FIRST)

    def _serious(self, errors: Array) -> float:
        return self.problem.sum(np.where(errors > SERIOUS, 1.0, 0.0))

    def _up_to(
        self, distances: Callable[[float, Integers | slice], Array], low: float, high: float
    ) -> Array:
        """Distances from the laws about where no more points are far from them than are chosen."""
        found = distances(high, slice(None))
        if self._serious(found) <= FIRST:
            return found
        noticed = np.flatnonzero(found > NOTICED)  # on the way there no others are
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            tried = np.zeros_like(found)
            tried[noticed] = distances(middle, noticed)
            if self._serious(tried) > FIRST:
                high, found = middle, tried
            else:
                low = middle
        return found

    def _worst(self, errors: Array, count: int) -> Integers:
        """Points of all ranks furthest from their laws: their ranks and places there."""
        comm = self.problem.comm
        place = np.flatnonzero((errors > SERIOUS) & self._others)
        place = place[np.argsort(-errors[place], kind="stable")[: max(count, 0)]]
        found = comm.allgather((errors[place], place))
        size = np.concatenate([sizes for sizes, _ in found])
        rank = np.repeat(np.arange(comm.size), [len(places) for _, places in found])
        places = np.concatenate([places for _, places in found])
        order = np.lexsort((places, rank, -size))[: max(count, 0)]
        return np.stack([rank[order], places[order]], axis=1)

    def _answer(self, new: Integers) -> None:
        """Solve for what forces at more points do to all."""
        before = 2 * len(self._chosen)
        for first in range(0, 2 * len(new), COLUMNS):
            some = new[first // 2 : (first + COLUMNS) // 2]
            self._solve(some, self._answers[:, before + first : before + first + 2 * len(some)])
        self._chosen = np.concatenate([self._chosen, new])
        self._others[new[new[:, 0] == self.problem.comm.rank, 1]] = False

    def _solve(self, points: Integers, answers: Array) -> None:
        """Set openings and slips of this rank's points for unit forces at some.

        The displacements themselves are not kept: they take much memory, and one solve gives those
        that are needed in the end.
        """
        problem, path = self.problem, self.path
        live, border = problem.live.array_r, path.workspace.border
        mine = {}
        for k, (rank, point) in enumerate(points):
            if rank == problem.comm.rank:
                for side, matrix in enumerate((problem.normal, problem.tangential)):
                    mine[2 * k + side] = matrix.getRow(matrix.getOwnershipRange()[0] + int(point))
        columns = {k: row for some in problem.comm.allgather(mine) for k, row in some.items()}
        solutions = path.springs.solve_columns([columns[k] for k in range(2 * len(points))])
        displacements = solutions.getDenseArray().T
        works = problem.comm.allreduce(displacements @ live)
        load_factors = -works / border.dot(problem.live)  # the work of the live load stays
        for row, load_factor in zip(displacements, load_factors, strict=True):
            row += load_factor * border.array_r
        for matrix, rows in zip((problem.normal, problem.tangential), answers, strict=True):
            product = matrix.matMult(solutions)
            unit = path.scales.force / path.scales.displacement
            np.multiply(product.getDenseArray().T, unit, out=rows)
            product.destroy()
        solutions.destroy()

    def _equations(self) -> FewEquations:
        """The chosen points' equations, gathered from their ranks."""
        comm, chosen = self.problem.comm, self._chosen
        mine = np.flatnonzero(chosen[:, 0] == comm.rank)
        points = chosen[mine, 1]
        linear, laws = self.linear.at(points), self.laws.at(points)
        parts = [getattr(linear, field.name) for field in fields(linear)]
        # Normal forces first, then shear forces.
        shape = 2, len(chosen), 2, len(points)
        answers = self._answers[:, : 2 * len(chosen), points].reshape(shape)
        answers = answers.swapaxes(1, 2).reshape(2, 2 * len(chosen), len(points))
        rows = [
            *(row for part in parts for row in part),
            *(laws.friction, laws.strength, laws.sticky),
            *answers[0],
            *answers[1],
        ]
        gathered = comm.allgather((mine, np.array(rows)))
        values = np.empty((len(rows), len(chosen)))
        for places, some in gathered:
            values[:, places] = some
        ends = np.cumsum([len(part) for part in parts])
        linear = LinearStates(*np.split(values[: ends[-1]], ends[:-1]))
        friction, strength, sticky = values[ends[-1] : ends[-1] + 3]
        laws = replace(laws, friction=friction, strength=strength, sticky=sticky > 0.5)
        opening, slip = np.split(values[ends[-1] + 3 :], 2)
        compliance = np.concatenate([opening.T, slip.T])
        return FewEquations(laws, linear, compliance, self.place.products)

    def _trace(
        self,
        curve: _Curve,
        here: _OnCurve,
        forward: Array,
        reach: tuple[float, float],
        limit: float,
    ) -> _Traced:
        """Follow a curve by its length, until it ends or other points do not follow.

        Args:
            curve: Of the chosen points.
            here: Where it begins.
            forward: Row whose product with the direction there is positive. The curve may turn
                back, and forth again.
            reach: Coordinates between which it is followed.
            limit: Distance of other points from their laws at which it ends.
        """
        while True:
            traced = self._watching(curve, here, forward, reach, limit)
            if traced.last is here:
                return traced
            distances = self._distances_on(traced.last)
            missed = np.where(self._others & ~self._watched, distances, 0.0)
            if not self.problem.max(missed) > limit:
                return traced
            self._watched |= missed > min(NOTICED, limit)

    def _watching(
        self,
        curve: _Curve,
        here: _OnCurve,
        forward: Array,
        reach: tuple[float, float],
        limit: float,
    ) -> _Traced:
        """The same, of other points as far as they are watched."""
        watched = self._of(np.flatnonzero(self._watched & self._others))
        furthest = here
        stopped: _OnCurve | None = None
        length, near, steps, ended = FIRST_LENGTH, 0.0, 0, False
        while not ended and steps < CURVE_STEPS:
            steps += 1
            rejected = None
            along = curve.tangent(here, forward)
            found: tuple[_OnCurve, int] | None = None
            while along is not None and length > SHORTEST:
                found = curve.step(here, along, length, reach)
                if found is None:
                    length *= SHORTER
                    continue
                tried = found[0]
                part, turn = tried.x[[PART, TURN]]
                distances = watched.distances(part, turn, tried.forces)
                leaving = self.problem.max(distances)
                if leaving <= limit:
                    break
                found, rejected = None, tried
                length *= float(np.clip((limit - near) / (leaving - near), *LESS))
                if length < CLOSE_TO_OTHERS * limit / LEFT:
                    break
            if along is None or found is None:
                stopped = rejected
                break
            here, corrections = found
            forward = along / here.sizes**2
            if here.x[curve.coordinate] > furthest.x[curve.coordinate]:
                furthest = here
            length = min(length * (LONGER if corrections <= QUICK else 1.0), LONGEST)
            near = leaving
            ended = not reach[0] < here.x[curve.coordinate] < reach[1]
            if not ended and rejected is not None and near >= NEARLY * limit:
                stopped = rejected
                break
        _log.debug(
            "         few points: %d, %d steps, part %.2g, turn %.2g",
            *(len(here.x) // 2 - 1, steps, *here.x[[PART, TURN]]),
        )
        complete = here.x[curve.coordinate] >= reach[1]
        return _Traced(here, furthest, complete, forward, stopped)

    def _moved(self, last: _OnCurve, equations: FewEquations, reached: bool) -> Step:
        """The step to the point with equal products of the states there."""
        place, path = self.place, self.path
        part, turn = float(last.x[PART]), float(last.x[TURN])
        f = path.scales.force
        moved = place.iterate.copy()
        moved.move(part, place.to_path)
        moved.move(turn, place.tangent)
        mine = np.flatnonzero(self._chosen[:, 0] == self.problem.comm.rank)
        forces = np.zeros((2, len(self._others)))
        forces[:, self._chosen[mine, 1]] = f * last.forces.reshape(2, -1)[:, mine]
        right, change = path.problem.dead.duplicate(), path.problem.dead.duplicate()
        if len(self._chosen):
            path.add_joint_forces(right, *forces)
            path.springs.solve(right, change)
            moved.load_factor += path.hold_work(change)
        moved.u.axpy(1.0, change)
        strained = self.problem.strained(change)
        moved.strained.axpy(1.0, strained)
        values = self._of(slice(None)).values(part, turn, last.forces)
        products = place.products * float(np.exp(turn))
        p, q = np.split(last.x[:-2], 2)
        values[:, self._chosen[mine, 1]] = equations.laws.states(p, q, products).values[:, mine]
        state = State(moved.u, moved.load_factor, values[1] * f, values[3] * f, path.work)
        path.grown(products)
        new = path.centred(state, products, moved.strained)
        for vector in (right, change, strained, moved.u):
            vector.destroy()
        return Step(new, products, reached)


class _Curve:
    """States of the chosen points, part and turn that one linear condition makes a curve.

    Attributes:
        course: What it is.
        coordinate: Place of the coordinate in x that tells how far it leads: part or turn.
    """

    def __init__(
        self,
        course: Course,
        equations: FewEquations,
        begin: _OnCurve,
        row: Array,
        forces: Array,
    ) -> None:
        """Set the condition.

        Args:
            course: What it is.
            equations: Of the chosen points.
            begin: Where it begins.
            row: The product of this with x,
            forces: and of this with the forces, which together stay as they are there.
        """
        self.course = course
        self.equations = equations
        self.begin = begin
        self.row = row
        self.forces = forces
        self.coordinate = TURN if course is Course.ALONG else PART

    def tangent(self, here: _OnCurve, forward: Array) -> Array | None:
        """Direction on from a point, the largest relative change one; None where there is none.

        Args:
            here: The point.
            forward: Row whose product with it is positive.
        """
        along = self._solved(here, forward, np.zeros(len(here.rest) + 1), 1.0)
        if along is None or not np.all(np.isfinite(along)):
            return None
        return np.asarray(along / np.max(np.abs(along / here.sizes)))

    def step(
        self, here: _OnCurve, along: Array, length: float, reach: tuple[float, float]
    ) -> tuple[_OnCurve, int] | None:
        """The point a step on, not beyond some coordinates, and Newton's steps; None: not found."""
        coordinate = here.x[self.coordinate]
        ahead = coordinate + length * along[self.coordinate]
        end = float(np.clip(ahead, *reach))
        forward = along / here.sizes**2
        x = here.x + length * along
        if end != ahead:
            x = here.x + length * (end - coordinate) / (ahead - coordinate) * along
            x[self.coordinate], forward = end, self.fixed
        return self._newton(self.equations.at(x), here.x[TURN], forward, end, reach)

    def corrected(self, near: _OnCurve) -> _OnCurve | None:
        """The point of the curve at the coordinate of another; None: not found."""
        end = float(near.x[self.coordinate])
        found = self._newton(near, near.x[TURN], self.fixed, end, (end, end))
        return None if found is None else found[0]

    def _newton(
        self, new: _OnCurve, turn: float, forward: Array, end: float, reach: tuple[float, float]
    ) -> tuple[_OnCurve, int] | None:
        """The point of the curve in a plane, or at the end of reach if that is beyond."""
        for corrections in range(NEWTON_STEPS + 1):
            if new.left <= SOLVED:
                if reach[0] <= new.x[self.coordinate] <= reach[1]:
                    return new, corrections
                new.x[self.coordinate] = end = float(np.clip(new.x[self.coordinate], *reach))
                new, forward = self.equations.at(new.x), self.fixed
                continue
            away = abs(new.x[self.coordinate] - end)
            if not np.isfinite(new.left) or away > LONGEST or corrections == NEWTON_STEPS:
                return None
            change = self._solved(new, forward, np.append(-new.rest, -self._changed(new)), 0.0)
            if change is None or not abs(new.x[TURN] + change[TURN] - turn) <= LONGEST:
                return None
            new = self.equations.at(new.x + change)
        return None

    @property
    def fixed(self) -> Array:
        """Row of the coordinate itself."""
        return np.eye(len(self.row))[self.coordinate]

    def _changed(self, here: _OnCurve) -> float:
        """By how much the condition is missed."""
        change = self.row @ (here.x - self.begin.x)
        return float(change + self.forces @ (here.forces - self.begin.forces))

    def _solved(self, at: _OnCurve, forward: Array, rest: Array, product: float) -> Array | None:
        """A change of x by which rest, condition and the product with a row change as asked for."""
        row = self.row + at.force_slope(self.forces)
        matrix = np.vstack([at.slopes, row, forward])
        try:
            return np.linalg.solve(matrix, np.append(rest, product))
        except np.linalg.LinAlgError:
            return None
