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
are a curve that may turn back, so that it is followed by its length too (`curve.c`).

The points of all ranks are on every rank, and every rank follows the same curves.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers.compiled import CStructure, call, structure
from fenics_contact.solvers.kkt import Iterate, Linearization
from fenics_contact.solvers.problem import Array

Integers = npt.NDArray[np.int64]

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class Rates:
    """How products vary along a path.

    Attributes:
        mu: Product where a step begins, in typical units.
        log_mu_rate: d(log mu)/ds.
        smallest: Size of p and q by which changes are measured, at least, in typical units.
    """

    mu: float
    log_mu_rate: float
    smallest: float


@dataclass(frozen=True)
class EliminationStep:
    """Where a step leads: displacements and joint states, still without a new factor.

    Attributes:
        moved: The iterate on the tangents with the answers to the excess forces.
        states: y, r_N, w, r_T and dilation of this rank's points, typical units, shape (5, points).
        s: Change of the path's parameter.
        reached: Whether the corrector reached the path.
    """

    moved: Iterate
    states: Array
    s: float
    reached: bool = False


@dataclass(frozen=True)
class _Curve:
    """A place on the curve of the chosen points on a line, where it was left.

    Attributes:
        x: p and q of the chosen points, and tau.
        line: (part, s) at tau = 0, and their change by tau.
        forward: Row whose product with the direction of the curve is positive there.
        forces: Excess forces at the chosen points, normal and shear ones, shape (2 points,).
        bends: Whether a point that is not chosen bends beyond.
    """

    x: Array
    line: tuple[float, float, float, float]
    forward: Array
    forces: Array
    bends: bool

    @property
    def place(self) -> tuple[float, float]:
        """Part and s."""
        part, s, of_part, of_s = self.line
        return part + float(self.x[-1]) * of_part, s + float(self.x[-1]) * of_s


class NonlinearElimination:
    """A step of a path from one place, on the factor there.

    Attributes:
        back: s per part of the shortest way c + s t to the path: at right angles to t.
        answers: Openings and slips of all points for unit forces at the chosen points, normal and
            shear in turn, shape (2, 2 chosen, points).
    """

    def __init__(
        self,
        linear: Linearization,
        correction: Iterate,
        tangent: Iterate,
        rates: Rates,
        options: SearchOptions = SEARCH,
    ) -> None:
        """Take Newton's equations at the place, Newton's correction c and the tangent t by s."""
        self.options = options
        self._linear = linear
        self._correction = correction
        self._tangent = tangent
        self._rates = rates
        kkt = linear.kkt
        problem = self._problem = kkt.problem
        d = kkt.scales.displacement
        f = kkt.scales.force
        law = kkt.law
        units = np.array([d, f, d, f, d])[:, None]
        moved = [
            np.stack([at.y, at.pressure, at.slip, at.shear, law.dilation(at.z1, at.z2)]) / units
            for at in (linear.now, correction, tangent)
        ]
        constants = law.friction, law.strength / f, law.dilatancy, kkt.frictional.astype(float)
        k_n, k_t, coupling, slope, give = linear.laws.springs
        springs = k_n * d / f, k_t * d / f, coupling * d / f, slope, give * f / d
        # Rows as `curve.c` names them.
        self._table = problem.whole(
            np.concatenate([constants, *moved, springs, problem.compliance * f / d])
        )
        self._points = self._structure(self._table)
        count = self._table.shape[1]
        first = sum(problem.gather(problem.points)[: problem.comm.rank])
        self._mine = slice(first, first + problem.points)
        self._chosen = np.zeros(0, dtype=np.int64)
        self.answers = np.empty((2, 0, count))
        self._distances = np.zeros(count)  # of points that are not chosen, those last asked for
        self.back = self._shortest_way()

    def step(self, reach: tuple[float, float] | None, ahead: float) -> EliminationStep:
        """Go to the path, and along it.

        Args:
            reach: Least and largest s; None: only to the path, with s held.
            ahead: Change of s along the path for which the points are chosen that follow their
                laws; its sign tells where the path leads on.
        """
        if reach is None:
            self.back = 0.0
            ahead = 0.0
        back = self.back
        with np.errstate(all="ignore"):  # tangents may lead anywhere, and are then not followed
            self._choose(self._first_to_bend(ahead))
            last = self._to_path()
            reached = last.x[-1] >= 1.0
            if reached and reach is not None:
                x = np.append(last.x[:-1], back)
                room = SEARCH.path_room
                reach = min(reach[0], back - room), max(reach[1], back + room)
                forward = np.append(np.zeros(len(x) - 1), np.sign(ahead))
                last = self._trace((1.0, 0.0, 0.0, 1.0), x, forward, reach)
            return replace(self._arrived(last), reached=bool(reached))

    def distances(self, part: float, s: float, forces: Array | None = None) -> Array:
        """Distances of all points on their tangents from their laws; infinite where these end.

        `forces` are excess ones at the chosen points.
        """
        found = np.empty(self._table.shape[1])
        call("distances", self._points, part, s, self._motion(forces), found)
        return found

    def _structure(self, table: Array) -> CStructure:
        """Some points as `curve.c` takes them."""
        return structure("points", count=table.shape[1], table=table, **vars(self._rates))

    def _motion(self, forces: Array | None) -> Array:
        """Openings and slips of all points for excess forces at the chosen points."""
        if forces is None or not len(forces):
            return np.zeros((2, self._table.shape[1]))
        in_turn = forces.reshape(2, -1).T.ravel()
        return np.stack([in_turn @ self.answers[0], in_turn @ self.answers[1]])

    def _on_tangents(self, at: _Curve) -> Array:
        """States of all points on their tangents, shape (5, points)."""
        values = np.empty((5, self._table.shape[1]))
        call("on_tangents", self._points, *at.place, self._motion(at.forces), values)
        return values

    def _shortest_way(self) -> float:
        """-t.c / t.t, by relative changes of p and q, with s counted once per point."""
        friction, strength, _, carried = self._table[:4]
        y, r, w, _, _ = self._table[4:9]
        bound = np.where(carried > 0.0, friction * r + strength, 1.0)
        sizes = np.maximum([r + y, bound + np.abs(w)], self._rates.smallest)
        carried = np.stack([np.ones_like(carried), carried])
        across, along = (
            carried * np.stack([change[1] - change[0], change[3] - change[2]]) / sizes
            for change in (self._table[9:14], self._table[14:19])
        )
        square = np.sum(np.sum(along**2, axis=0) + 1.0)
        return -float(np.sum(along * across) / square) if square else 0.0

    def _first_to_bend(self, ahead: float) -> Integers:
        """Points that leave their laws first, on the way to the path, and then along it."""
        options = self.options
        back = self.back
        reached = self.distances(1.0, back)
        on_the_way = self._too_many(reached)

        def distances(part: float) -> Array:
            if on_the_way:
                return self.distances(part, part * back)
            return np.maximum(reached, self.distances(1.0, back + part * ahead))

        found = distances(1.0)
        if self._too_many(found):
            low = 1e-5
            high = 1.0
            first = np.zeros_like(found)
            for _ in range(SEARCH.no_progress):
                middle = float(np.sqrt(low * high))
                tried = distances(middle)
                if self._too_many(tried):
                    high = middle
                    found = tried
                else:
                    low = middle
                    first = tried
            # Distances end at about one. Farther on, points that bend first are no more the worst.
            found = np.where(first > 0.5 * SEARCH.allowed_distance, np.inf, found)
        return self._worst(found, options.points)

    def _too_many(self, distances: Array) -> bool:
        """Whether more points bend than may be chosen."""
        return np.count_nonzero(distances > 0.5 * SEARCH.allowed_distance) > self.options.points

    def _worst(self, distances: Array, most: int) -> Integers:
        """Points furthest from their laws, at most so many."""
        place = np.flatnonzero(
            distances > min(0.5 * SEARCH.allowed_distance, self.options.allowed_distance)
        )
        return place[np.argsort(-distances[place], kind="stable")[:most]]

    def _choose(self, points: Integers) -> None:
        """Choose more points, and solve for the answers of all to forces at them."""
        if len(points):
            new = self._answers_to(points)
            before = self.answers
            self.answers = np.concatenate([before, new], axis=1) if len(self._chosen) else new
        self._chosen = np.concatenate([self._chosen, points])

    def _answers_to(self, points: Integers) -> Array:
        """Answers of all to unit forces at some points, with the work of the live load held."""
        linear = self._linear
        problem = self._problem
        maps = problem.normal, problem.tangential
        mine = {
            2 * k + side: rows.matrix.getRow(rows.first_row + int(point) - self._mine.start)
            for k, point in enumerate(points)
            if self._mine.start <= point < self._mine.stop
            for side, rows in enumerate(maps)
        }
        columns = {k: row for some in problem.gather(mine) for k, row in some.items()}
        solutions = linear.factor.solve_sparse([columns[k] for k in range(2 * len(points))])
        displacements = solutions.getDenseArray().T
        works = sum(problem.gather(displacements @ problem.live))
        displacements -= np.outer(works / linear.flexibility, linear.live_response)
        unit = linear.kkt.scales.force / linear.kkt.scales.displacement
        answers = np.empty((2, len(displacements), problem.points))
        for rows, found in zip(maps, answers, strict=True):
            rows.times(solutions, unit, found)
        solutions.destroy()
        return problem.whole(answers)

    def _to_path(self) -> _Curve:
        """Where the curve of the chosen points on the line to the path ends.

        Points that end it by bending are chosen too, if that leads to the path. A shorter step
        before is better where there was one: a way from afar may lead to another path.
        """
        line = 0.0, 0.0, 1.0, self.back
        start = self._table[4:9, self._chosen]
        x = np.concatenate([start[1] - start[0], start[3] - start[2], [0.0]])
        forward = np.append(np.zeros(len(x) - 1), 1.0)
        few = end = self._trace(line, x, forward, (-1.0, 1.0))
        kept = self._chosen, self.answers
        for _ in range(self.options.late_rounds):
            if not end.bends:
                break
            self._choose(self._worst(self._distances, self.options.points // 2))
            x = self._with_more(end)
            if not call("near", self._curve(line, (-1.0, 1.0)), x):
                break
            end = self._trace(line, x, _longer(end.forward, len(x)), (-1.0, 1.0))
            if end.x[-1] >= 1.0:
                return end
        self._chosen, self.answers = kept
        return few

    def _with_more(self, last: _Curve) -> Array:
        """Values at a place on a curve of fewer points; new points, at the end, are on tangents."""
        forces = _longer(last.forces, 2 * len(self._chosen))
        states = self._on_tangents(replace(last, forces=forces))[:, self._chosen]
        before = len(last.x) // 2
        p, q = np.split(last.x[:-1], 2)
        more = states[:, before:]
        return np.concatenate([p, more[1] - more[0], q, more[3] - more[2], last.x[-1:]])

    def _curve(
        self, line: tuple[float, float, float, float], reach: tuple[float, float]
    ) -> CStructure:
        """The curve of the chosen points on a line, as `curve.c` takes it."""
        opening, slip = self.answers[:, :, self._chosen]
        c = np.concatenate([opening.T, slip.T])  # openings, then slips, for forces in turn
        by_normal_then_shear = np.concatenate([c[:, 0::2], c[:, 1::2]], axis=1)
        others = np.ones(self._table.shape[1], dtype=bool)
        others[self._chosen] = False
        return structure(
            "curve",
            chosen=self._structure(self._table[:, self._chosen]),
            all=self._points,
            c=by_normal_then_shear.T,
            answers=self.answers,
            others=others,
            allowed=self.options.allowed_distance,
            solved=self.options.points_solved,
            **dict(zip(("part", "s", "of_part", "of_s"), line, strict=True)),
            **dict(zip(("low", "high"), reach, strict=True)),
        )

    def _trace(
        self,
        line: tuple[float, float, float, float],
        x: Array,
        forward: Array,
        reach: tuple[float, float],
    ) -> _Curve:
        """Follow the curve by its length, until it ends or a point that is not chosen bends.

        Args:
            line: The line, as in `_Curve`.
            x: Where the curve begins.
            forward: Row whose product with the direction there is positive.
            reach: Values of tau at which the curve ends.
        """
        x = x.copy()
        forward = forward.copy()
        forces = np.empty(len(x) - 1)
        bends = call("trace", self._curve(line, reach), x, forward, forces, self._distances)
        return _Curve(x, line, forward, forces, bool(bends))

    def _arrived(self, last: _Curve) -> EliminationStep:
        """Where a place on the chosen points' curve moves the structure and all points."""
        kkt = self._linear.kkt
        problem = self._problem
        part, s = last.place
        moved = self._linear.now.moved(part, self._correction).moved(s, self._tangent)
        if len(self._chosen):
            forces = np.zeros((2, self._table.shape[1]))
            forces[:, self._chosen] = kkt.scales.force * last.forces.reshape(2, -1)
            right = problem.joint_forces(*forces[:, self._mine])
            change, factor = self._linear.hold_work(self._linear.factor.solve(right))
            moved = replace(
                moved,
                u=moved.u + change,
                elastic=moved.elastic + problem.elastic_part(change),
                load_factor=moved.load_factor + factor,
            )
        values = self._on_tangents(last)
        exact = np.empty((5, len(self._chosen)))
        call("on_laws", self._structure(self._table[:, self._chosen]), s, last.x, exact)
        values[:, self._chosen] = exact
        _log.debug("         %d points, part %.2g, s %.2g", len(self._chosen), part, s)
        return EliminationStep(moved, values[:, self._mine], s)


def _longer(values: Array, size: int) -> Array:
    """Values of p and q, or r and shear, with zeros for more points; a last odd one stays last."""
    both = values[: len(values) // 2 * 2].reshape(2, -1)
    more = np.zeros((2, size // 2 - both.shape[1]))
    return np.append(np.concatenate([both, more], axis=1), values[both.size :])
