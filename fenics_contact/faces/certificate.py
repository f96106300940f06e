"""Exact states of face forces near a rough one, with a proved gap.

A state has equilibrium and is inside all cones, with the load factor lambda. A mode v has
f_L . v = 1 and opens: v_N >= D |v_T|. With the state's own strengths g = c + (F - D) N no state of
the same strengths carries more than

    hi = g . |v_T| + sigma(v_N - D |v_T|) - f_D . v,

sigma the work at the compressive strengths: multiply equilibrium of any other state by v. So the
gap hi - lambda is not negative, and it is the sum of (strength left) times slip and pressure times
opening. It needs (a) a mode, of the limit with the strengths of a state, and (b) the state of least
gap for a mode,

    min g(N) . |v_T| - lambda   over all states near the load factor.

Live loads may do negative work in the collapse (the dead load drives it): then f_L . v = -1, and
lambda is as small as these strengths allow. `sign` says which.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.faces.cones import TINY, Array
from fenics_contact.faces.kernel import FaceIterate, FaceTolerances, Program, Row, solve
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.system import Equations
from fenics_contact.search_options import SEARCH


@dataclass(frozen=True)
class FaceState:
    """A certified state, and the mode that bounds it.

    Attributes:
        load_factor: lambda.
        force: x, shape (units, m).
        mode: v, shape (motions,).
        upper: With the friction forces of this state nothing carries more.
        gap: upper - lambda in units of the load factor's size, see `FaceModel.size`.
        missing: Of equilibrium, over the largest force.
        closing: By how much the mode closes at most, in units of its largest relative motion.
        sign: Of the live load's work in the mode.
        iterate: State (b) as it came from the kernel, for other programs to start from.
    """

    load_factor: float
    force: Array
    mode: Array
    upper: float
    gap: float
    missing: float
    closing: float
    sign: float
    iterate: FaceIterate


def to_least_gap() -> FaceTolerances:
    """What ends (b), which has a mode of its own: its multipliers matter little."""
    return FaceTolerances(10.0 * SEARCH.face_gap, motion=SEARCH.rough_gap)


@dataclass(frozen=True)
class Certifier:
    """Programs (a) and (b) of one model.

    Attributes:
        model: The units of contact.
        equations: Of the model.
        sign: Of the live load's work.
        asked: Gap that is enough, by which programs on many blocks end.
        gaps: Of units that are open, over the work of a step, shape (units,): a unit may close by
            so much, v_N + gap >= D |v_T|, and its pressing force costs gap N. None: all are closed.
    """

    model: FaceModel
    equations: Equations
    sign: float = 1.0
    asked: float = SEARCH.gap
    gaps: Array | None = None

    def near(self, elastic: FaceIterate, work: float) -> tuple[FaceState | None, float]:
        """A state near an elastic one under some work; the limit with its strengths.

        The second is nan if none was found.
        """
        size = self.model.size(elastic.load_factor)
        moves = max(SEARCH.moves * elastic.gap, SEARCH.gap), SEARCH.rough_gap, SEARCH.part_gap
        middle = elastic.load_factor
        boxes = [(middle - part * size, middle + part * size) for part in moves]
        start = replace(
            elastic,
            motion=elastic.motion / work,
            duals=tuple(dual / work for dual in elastic.duals),
            mu=elastic.mu / work,
        )
        mode = self.mode(elastic.force, start)
        if mode is None:
            return None, np.nan
        mu = max(start.mu, 1e-6 * size / self.model.shape[0]) / SEARCH.decade**2
        state = self.least_gap(elastic, mode.motion, mu, boxes[0])
        for box in (*boxes[1:], None):
            state = state or self.least_gap(None, mode.motion, box=box)
        return state, mode.load_factor

    def exact(self, elastic: FaceIterate) -> FaceState | None:
        """An elastic state with its own forces, where these are a state with next to no gap."""
        mode = self.mode(elastic.force)
        found = None if mode is None else self.state(elastic, mode.motion)
        return found if found is not None and abs(found.gap) < SEARCH.agrees else None

    def of(self, force: Array) -> FaceState | None:
        """The state of least gap for the mode of the strengths of some forces."""
        mode = self.mode(force)
        return None if mode is None else self.least_gap(None, mode.motion)

    def mode(self, force: Array, start: FaceIterate | None = None) -> FaceIterate | None:
        """(a): the limit with the strengths of a state; its motion is the mode, f_L . v = sign."""
        model = self.model
        strength = model.own_strength(force) + SEARCH.regularization * model.unit_sizes[:, 0]
        program = self._program(strength, model.dilatancy)
        near = None
        least, best = np.inf, None

        def passed(iterate: FaceIterate) -> bool:
            """Note the mode that bounds the load factor most, for where the end is not reached."""
            nonlocal least, best
            work = self.sign * float(model.live @ iterate.motion)
            mode = iterate.motion / work
            power = model.power(mode)
            bound = power.bound(strength)
            closing = self._closing(mode, power.slip)
            closes = np.any(closing > SEARCH.verified * self._largest(mode))
            if work > 0.0 and bound < least and not closes:
                least, best = bound, replace(iterate, motion=mode)
            return False

        if start is not None:
            tolerances = FaceTolerances(10.0 * SEARCH.face_gap)
            near = solve(program, start, tolerances, start.mu / SEARCH.decade, passed)
        if near is None or not near.within(1e-5):
            rough = FaceTolerances(SEARCH.part_gap * self.asked) if model.has_many_blocks else None
            near = solve(program, tolerances=rough, enough=passed)
        if near.solved or near.within(1e-5):
            return replace(near, motion=near.motion / abs(float(model.live @ near.motion)))
        return best

    def least_gap(
        self,
        near: FaceIterate | None,
        mode: Array,
        mu: float | None = None,
        box: tuple[float, float] | None = None,
    ) -> FaceState | None:
        """(b): the state of least gap for a mode, from a state near it and products of mu."""
        model = self.model
        power = model.power(mode)
        rows: tuple[Row, ...] = ()
        if box is not None:
            none = np.zeros(model.shape[0])
            rows = Row(none, 1.0, box[0]), Row(none, -1.0, -box[1])
        program = self._program(model.strength, model.friction)
        cost = model.free_friction * power.slip + self._gaps
        program = replace(program, cost=cost, rows=rows)
        found: FaceIterate | None = None
        known = power.bound(model.strength)

        def left(iterate: FaceIterate) -> float:
            """The gap that it proves, absolute."""
            own = known + float(cost @ model.normal(iterate.force))
            return own - self.sign * iterate.load_factor

        balanced: FaceIterate | None = None  # equilibrium loses digits as products fall
        least = SEARCH.rough_gap

        def enough(iterate: FaceIterate) -> bool:
            """Of many blocks: as good as asked for, or so near that it gets no better."""
            nonlocal balanced, least
            gap = left(iterate) / model.size(iterate.load_factor)
            if iterate.missing < 10.0 * SEARCH.digits and gap < least:
                balanced, least = iterate, gap
            if not model.has_many_blocks or iterate.missing > 5.0 * SEARCH.digits:
                return False
            return gap < 0.5 * self.asked or iterate.gap < SEARCH.part_gap * max(gap, self.asked)

        if near is not None:
            goal = 10.0 * SEARCH.face_gap * model.size(near.load_factor)

            def as_near(iterate: FaceIterate) -> bool:
                inside = box is None or box[0] <= iterate.load_factor <= box[1]
                return inside and iterate.missing <= 1e-9 and left(iterate) < goal

            start = replace(near, motion=mode, duals=self._duals(mode))
            found = solve(program, start, to_least_gap(), mu, as_near)
            if not (found.missing < 1e-7 and (found.gap < 1e-2 or found.solved)):
                found = None
        if found is None:
            found = solve(program, None, to_least_gap(), enough=enough)
            if balanced is not None and found.missing >= 10.0 * SEARCH.digits:
                found = balanced
        return self.state(found, mode)

    def state(self, found: FaceIterate, mode: Array) -> FaceState | None:
        """An iterate as a certified state; None without equilibrium, or with a mode that closes."""
        model = self.model
        if not (found.missing < 10.0 * SEARCH.digits and np.isfinite(found.load_factor)):
            return None
        power = model.power(mode)
        closes = self._closing(mode, power.slip)
        closing = float(closes.max(initial=0.0)) / self._largest(mode)
        if closing > SEARCH.verified:  # it bounds nothing
            return None
        pressed = np.maximum(found.force[:, : model.pressing], 0.0)
        upper = power.bound(model.own_strength(found.force)) + float(np.sum(closes * pressed))
        upper += float(np.sum(self._gaps * model.normal(found.force)))
        return FaceState(
            found.load_factor,
            found.force,
            mode,
            self.sign * upper,
            (upper - self.sign * found.load_factor) / model.size(found.load_factor),
            found.missing,
            closing,
            self.sign,
            found,
        )

    def _program(self, strength: Array, friction: Array) -> Program:
        laws = strength, friction, friction
        return Program(self.model, self.equations, *laws, self.sign, cost=self.gaps)

    @property
    def _gaps(self) -> Array | float:
        return 0.0 if self.gaps is None else self.gaps

    def _largest(self, mode: Array) -> float:
        """The largest relative motion; where blocks roll on edges alone, next to none of theirs."""
        rolls = SEARCH.small_factor * float(np.abs(mode).max(initial=0.0))
        return max(float(np.abs(self.model.relative(mode)).max(initial=0.0)), rolls, TINY)

    def _closing(self, mode: Array, slip: Array) -> Array:
        """By how much units of infinite strength close in a mode, shape (units, k)."""
        model = self.model
        opening = model.relative(mode)[:, : model.pressing] - (model.dilatancy * slip)[:, None]
        if self.gaps is not None:
            opening = opening + self.gaps[:, None]
        free = np.logical_or(model.kappa > 0.0, model.tensile)
        return np.where(free[:, None], 0.0, np.maximum(-opening, 0.0))

    def _duals(self, mode: Array) -> tuple[Array, ...]:
        """Multipliers that a mode has: openings, and slips on their side."""
        model = self.model
        relative = model.relative(mode)
        count = model.pressing
        slip = np.linalg.norm(relative[:, count:], axis=1)
        open_by = 0.0 if self.gaps is None else self.gaps[:, None]
        opening = relative[:, :count] - (model.dilatancy * slip)[:, None] + open_by
        opening = np.maximum(opening, 0.0)
        shear = relative[:, count:]
        if model.shears == 1:
            return (np.hstack([opening, np.maximum(-shear, 0.0), np.maximum(shear, 0.0)]),)
        return opening, np.hstack([slip[:, None], shear])
