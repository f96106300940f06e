"""The path of a structure after its peak: equilibrium in every pose, until no strength is left.

Each point is a limit load in its own geometry with a proved gap. The state of a point gives the
way; blocks move along it by so much work of the live load that no corner moves farther than the
step, then Newton's method puts them onto the chain: units that press keep a gap of 0, those that
stick their places, and the work is that of the step. The energy that the live load brings in is
what the dead load and ties take up and what friction uses: a check from geometry alone.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.certificate import FaceState
from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.motion.poses import Poses
from fenics_contact.motion.step import MovingBlocks, Past, Scenery, given_state, state_of
from fenics_contact.motion.support import fall

#: The first step, the largest and the least one, in sizes of blocks and in first steps.
FIRST = 0.02
LARGEST, LEAST = 8.0, 1.0 / 64.0
#: Sides as near as so many steps may touch within one.
REACH = 3.0
#: Change of the load factor in a step, over the first one: a step is taken again, half as long,
#: above the larger one; the next step is longer below the smaller one.
CHANGE, JUMP = 0.05, 0.125
#: So many steps at most, and tries to end a step where nothing is left.
MOST, LANDINGS = 400, 5
#: Load factors below this part of the first one are 0.
NOTHING = 1e-7
#: Newton's method ends at this part of a block's size.
EXACT = 1e-12
#: Units overlap by this part of a step at most in its program: they part again within it.
OVERLAP = 0.2
#: Units touch that are as near as this, in block sizes.
TOUCH = 1e-5
#: Moves of blocks at most until held ties have the tensions of a state, to this part of a force;
#: gap of states with the tensions of free ties.
SETTLED, EQUAL, STRICT = 8, 1e-6, 1e-5
#: Ends of paths.
SUPPORT_LOST, NO_STATE, NOTHING_LEFT = "support lost", "no state found", "nothing left"
ASKED = "displacement"


@dataclass(frozen=True)
class BeyondPoint:
    """A point of the path.

    Attributes:
        displacement: Of the control point, m.
        load_factor: Carried in this pose.
        work: Of the live load since the start, J.
        gap: Proved, over the size of the load factor.
        overlap: Of blocks, m.
        stored: Work against the dead load and into ties since the start, J.
        friction: Work of friction, and of ties that yield, since the start, J.
        event: What happens in the step before, in words; empty for nothing.
        poses: Of the blocks.
        pressed: Places that carry force, m, shape (places, 3).
    """

    displacement: float
    load_factor: float
    work: float
    gap: float
    overlap: float
    stored: float
    friction: float
    event: str
    poses: Poses = field(repr=False)
    pressed: Array = field(repr=False)


@dataclass(frozen=True)
class Trace:
    """A path and how it ended.

    Attributes:
        points: From the structure as drawn on.
        why: "nothing left", "support lost", "no state found", "displacement", "steps" or why it
            was stopped.
        lost: Numbers of blocks that nothing holds behind the last point: a proof.
        stopped: Whether somebody, or the time, ended it.
    """

    points: tuple[BeyondPoint, ...]
    why: str
    lost: tuple[int, ...] = ()
    stopped: bool = False

    @property
    def curve(self) -> tuple[Array, Array]:
        """Displacements, m, and load factors, shape (points,)."""
        pairs = [(point.displacement, point.load_factor) for point in self.points]
        return np.array(pairs)[:, 0], np.array(pairs)[:, 1]

    @property
    def energy(self) -> float:
        """By how much the balance of energy is missed, over what the live load brings in."""
        factor, work, stored, friction = (
            np.array([getattr(point, name) for point in self.points])
            for name in ("load_factor", "work", "stored", "friction")
        )
        each = 0.5 * (factor[1:] + factor[:-1]) * np.diff(work)
        brought = np.append(0.0, np.cumsum(each))
        missing = np.abs(brought - stored - friction).max()
        return float(missing / max(np.abs(brought).max(), 1e-300))

    @property
    def overlap(self) -> float:
        """The largest of all points, m."""
        return max((point.overlap for point in self.points), default=0.0)


class PathEnds(SolverError):
    """Why a path ends, and numbers of the blocks that nothing holds."""

    def __init__(self, why: str, lost: tuple[int, ...] = ()) -> None:
        super().__init__(why)
        self.lost = lost


@dataclass(frozen=True)
class Stage:
    """A pose, the state of a step from it, and the size of the step, m.

    Attributes:
        scenery: Units in the pose.
        past: What the way to it has left.
        gaps: Of units, m, shape (units + ties,).
        state: Of the step.
        work: Of the live load in the step, J.
        step: m.
        change: Of the load factor in the step before, over the first load factor.
        held: Whether ties with a stiffness are, see `Follower._settled`.
    """

    scenery: Scenery
    past: Past
    gaps: Array
    state: FaceState
    work: float
    step: float
    change: float = CHANGE
    held: bool = False

    @property
    def force(self) -> Array:
        """Of units and ties, N, shape (units + ties, d)."""
        return np.asarray(self.state.force + self.scenery.given)

    def force_in(self, scenery: Scenery) -> Array:
        """Its forces as the engine's in other poses."""
        units = self.scenery.units
        place, axes, _ = units.at(scenery.poses)
        force, ties = np.split(self.force, [len(units)])
        vectors = np.einsum("uk,uki->ui", force, axes[:, : force.shape[1]])
        return scenery.carried(place, units.plane, units.point, vectors, -ties[:, 1])


@dataclass
class Follower:
    """Follows the path of some bodies.

    Attributes:
        bodies: Blocks as drawn.
        control: Displacement of the control point in some poses, m.
        first: Forces of the collapse to begin from, as a function of scenery.
        asked: Gap of each point that is enough.
        until: Displacement at which the path ends, m.
        check_stop: May raise `Stopped`: the points found until then are the path.
    """

    bodies: MovingBlocks
    control: Callable[[Poses], float] = lambda poses: 0.0
    first: Callable[[Scenery], Array] | None = None
    asked: float = 1e-3
    until: float = np.inf
    check_stop: Callable[[], None] = lambda: None

    def __post_init__(self) -> None:
        self._sign = 1.0 if self.bodies.driven is None else -1.0

    def trace(self, step: float) -> Trace:
        """The path by steps that begin with a size, m."""
        points: list[BeyondPoint] = []
        used, event = 0.0, ""
        try:
            stage = self.drawn
            scale = abs(stage.state.load_factor) or 1.0
            while True:
                points.append(self._point(stage, used, event))
                if why := self._ended(points, scale):
                    return Trace(tuple(points), why)
                if not stage.step:
                    stage = self._stage(stage.scenery.poses, step, stage)
                self.check_stop()
                gone, stage, work, then = self._following(stage, scale, step)
                if len(points) > 1 and gone.state.gap <= 10.0 * self.asked:
                    points[-1] = self._point(gone, used, event)  # less closes in a shorter step
                    if why := self._ended(points, scale):
                        return Trace(tuple(points), why)
                used, event = used + work, then
        except Stopped as stopped:
            return Trace(tuple(points), str(stopped), stopped=True)
        except PathEnds as end:
            return Trace(tuple(points), str(end), end.lost)
        except SolverError:
            return Trace(tuple(points), NO_STATE)

    def _ended(self, points: list[BeyondPoint], scale: float) -> str:
        """Why the path ends at its last point; empty where it goes on."""
        here = points[-1]
        if here.load_factor <= NOTHING * scale and self.bodies.driven is None:
            return NOTHING_LEFT
        if abs(here.displacement) >= self.until:
            return ASKED
        return "steps" if len(points) >= MOST else ""

    @cached_property
    def drawn(self) -> Stage:
        """The collapse of the structure as drawn: units that touch, whatever the step.

        Raises:
            SolverError: If no state was found.
        """
        scenery = self._touching(self.bodies.start, self.bodies.past)
        model = scenery.model
        begin = None if self.first is None else self.first(scenery)
        state = None if begin is None else given_state(model, begin, self._sign)
        state = state or state_of(model, None, begin, self.asked, self._sign)
        if state.gap > 10.0 * self.asked:  # as where the dead load drives the collapse
            raise SolverError(NO_STATE)
        none = np.zeros(model.shape[0])
        return Stage(scenery, self.bodies.past, none, state, work=0.0, step=0.0)

    def _touching(self, poses: Poses, past: Past) -> Scenery:
        """Units that touch in some poses."""
        units = self.bodies.sides.near(poses, TOUCH * self.bodies.size)
        if not len(units):
            raise PathEnds(SUPPORT_LOST, tuple(self.bodies.moves.tolist()))
        return Scenery.of(self.bodies, units, poses, past)

    def _settled(self, poses: Poses, step: float, before: Stage) -> Stage:
        """The state of a step from some poses, or from poses near these.

        Where no state has the tensions of ties with a stiffness, as where two mechanisms share the
        motion, these ties are held: they have tensions of a state, and blocks move until these are
        those of their lengths. Then ties stay held as long as there are such poses.

        Raises:
            SolverError: If there is no such state.
        """
        if not self.bodies.ties.elastic.any():
            return self._stage(poses, step, before)
        if before.held:
            with suppress(SolverError):
                return self._held(poses, step, before)
        with suppress(SolverError):
            stage = self._stage(poses, step, before)
            if abs(stage.state.gap) <= STRICT:
                return stage
        return self._held(poses, step, before)

    def _held(self, poses: Poses, step: float, before: Stage) -> Stage:
        """The state of a step with held ties, from poses near some ones."""
        ties = self.bodies.ties
        for _ in range(SETTLED):
            stage = self._stage(poses, step, before, held=True)
            pull = -stage.force[len(stage.scenery.units) :, 1]
            off = np.abs(pull - ties.tension(poses, stage.past.longest)) * ties.elastic
            moves = off > EQUAL * stage.scenery.model.force
            if not moves.any():
                return stage
            lengths = np.where(moves, ties.length(pull, before.past.longest), np.nan)
            poses, _ = self._moved(replace(stage, work=0.0), 0.0, lengths)
        raise SolverError("ties do not settle")

    def _stage(self, poses: Poses, step: float, before: Stage, held: bool = False) -> Stage:
        """The state of a step from some poses, from the forces of the stage before."""
        bodies = self.bodies
        units = bodies.sides.near(poses, REACH * step)
        if not len(units):
            raise PathEnds(SUPPORT_LOST, tuple(bodies.moves.tolist()))
        past = bodies.remembered(before.past, poses)
        scenery = Scenery.of(bodies, units, poses, past, held)
        gaps = np.zeros(scenery.model.shape[0])
        gaps[: len(units)] = units.at(poses)[2][:, 0]
        begin = before.force_in(scenery)
        closing = np.maximum(gaps, -OVERLAP * step)
        speed = bodies.speed(before.state.mode).max()
        for _ in range(3):
            work = step / speed
            state = state_of(scenery.model, closing / work, begin, self.asked, self._sign)
            speed = bodies.speed(state.mode).max()
            if speed * work < 2.0 * step:
                break
        return Stage(scenery, past, gaps, state, work, step, held=held)

    def _following(
        self, stage: Stage, scale: float, first: float
    ) -> tuple[Stage, Stage, float, str]:
        """The stage of the step, the next one, the work of friction, J, and what happened.

        A step is shorter where the load factor jumps, no state is behind it, or nothing is left.

        Raises:
            PathEnds: If there is none behind the shortest step.
        """
        least = LEAST * first
        here = stage
        landings = 0
        used = 0.0
        lost: tuple[int, ...] = ()
        while True:
            part = 0.5
            poses: Poses | None = None
            found: Stage | None = None
            try:
                poses, used = self._moved(here, least)
                lost = lost and self._lost(poses)  # before the programs, which take longer
                if not lost:
                    size = self._next_step(stage, here, first)
                    found = self._settled(poses, size, here)
            except SolverError:
                lost = () if poses is None else self._lost(poses)
            shortest = here.step < 1.01 * least
            if found is not None and found.state.gap <= 10.0 * self.asked:
                before, after = (one.state.load_factor for one in (here, found))
                change = abs(after - before) / scale
                jumps = change > JUMP
                passes = self.bodies.driven is None and after < -NOTHING * scale and before > 0.0
                lands = passes and not jumps and landings < LANDINGS
                if not lands and (shortest or not jumps):
                    return here, replace(found, change=change), used, "jump" * jumps
                if lands:  # onto the place where nothing is left
                    part = before / (before - after)
                    landings += 1
            elif shortest:
                raise PathEnds(SUPPORT_LOST if lost else NO_STATE, lost)
            step = max(part * here.step, 0.0 if landings else least)
            here = self._shorter(here, step)

    def _shorter(self, stage: Stage, step: float) -> Stage:
        """The state of a shorter step from the same poses; a part of the step if none is found."""
        part = replace(stage, step=step, work=step / stage.step * stage.work)
        try:
            found = self._stage(stage.scenery.poses, step, stage, stage.held)
        except SolverError:
            return part
        return found if found.state.gap <= 10.0 * self.asked else part

    def _lost(self, poses: Poses) -> tuple[int, ...]:
        """Blocks that nothing holds in some poses, whatever the load factor; empty if all are."""
        bodies = self.bodies
        units = bodies.sides.near(poses, TOUCH * bodies.size)
        if not len(units):
            return tuple(bodies.moves.tolist())
        motion = fall(Scenery.of(bodies, units, poses, bodies.past, held=True).model)
        if motion is None:
            return ()
        speed = np.linalg.norm(bodies.motions(motion)[:-1, :3], axis=1)
        return tuple(np.flatnonzero(speed > 0.1 * speed.max()).tolist())

    def _next_step(self, stage: Stage, here: Stage, first: float) -> float:
        """The step from the next stage, by how the load factor changed before this one."""
        if here.step < stage.step or stage.change >= CHANGE:
            return max(0.7 * here.step, LEAST * first)
        return min((1.5 if stage.change < 0.5 * CHANGE else 1.0) * here.step, LARGEST * first)

    def _point(self, stage: Stage, friction: float, event: str) -> BeyondPoint:
        bodies = self.bodies
        scenery = stage.scenery
        pressed = stage.force[: len(scenery.units), 0] > 1e-6 * scenery.model.force
        return BeyondPoint(
            self.control(scenery.poses),
            stage.state.load_factor,
            bodies.work(scenery.poses),
            stage.state.gap,
            float(-stage.gaps.min(initial=0.0)),
            bodies.stored(scenery.poses, stage.past),
            friction,
            event,
            scenery.poses,
            scenery.units.at(scenery.poses)[0][pressed],
        )

    def _moved(
        self, stage: Stage, least: float, lengths: Array | None = None
    ) -> tuple[Poses, float]:
        """Poses behind the step of a stage, and the work of friction in it, J.

        Raises:
            SolverError: If contacts contradict each other.
        """
        model = stage.scenery.model
        count = len(stage.scenery.units)
        unknowns = stage.work * stage.state.mode
        relative = model.relative(unknowns)
        normal = np.maximum(stage.state.force[:, 0], 0.0)
        shear = np.linalg.norm(stage.state.force[:, 1:], axis=1)
        opening = np.maximum(stage.gaps + relative[:, 0], 0.0)
        active = (normal > 1e-7 * model.force) & (normal / model.force > opening / stage.step)
        slip = np.linalg.norm(relative[:, 1:], axis=1)
        left = np.maximum(model.strength + model.friction * normal - shear, 0.0)
        sticks = active & (slip / stage.step < left / model.force)
        pull = stage.force[count:, 1] * ~self.bodies.ties.elastic
        used = float(shear[:count] @ slip[:count] - pull @ relative[count:, 1])
        bodies = self.bodies
        first = stage.scenery.poses.moved(bodies.motions(unknowns))
        for keep in (sticks, np.zeros_like(sticks)):  # hinges; else gaps alone
            poses, missed = self._on_chain(stage, first, active[:count], keep[:count], lengths)
            away = np.abs(bodies.sides.placed(first) - bodies.sides.placed(poses)).max()
            near = lengths is not None or away < 0.5 * stage.step
            if missed < 1e-2 * stage.step and near:
                return poses, used
        if stage.step > 1.01 * least:
            raise SolverError("contacts contradict each other")
        return first, used

    def _on_chain(
        self,
        stage: Stage,
        poses: Poses,
        active: Flags,
        sticks: Flags,
        lengths: Array | None = None,
    ) -> tuple[Poses, float]:
        """Poses near some with gaps 0, places kept, the work of the step; what is missed, m.

        Newton's method; units that would overlap more are kept closed, too.
        """
        from scipy.sparse import csr_matrix, identity, vstack
        from scipy.sparse.linalg import splu

        bodies = self.bodies
        units = stage.scenery.units
        dimension = bodies.structure.dimension
        before = units.at(stage.scenery.poses)[2][:, :dimension]
        wanted = np.where(np.arange(dimension) == 0, 0.0, before)
        lowest = np.minimum(before[:, 0], 0.0) - 1e-10 * bodies.size
        goal = bodies.work(stage.scenery.poses) + self._sign * stage.work
        active = active.copy()
        lengths = np.full(len(bodies.ties.drawn), np.nan) if lengths is None else lengths
        ties = np.isfinite(lengths)
        none = np.zeros_like(ties)
        missed = np.inf
        for tried in range(24):
            placed = units.at(poses)[2][:, :dimension]
            keep = np.column_stack([active, *[sticks] * (dimension - 1)])
            live = bodies.live_load(poses)
            size = float(np.linalg.norm(live))
            off = np.append(
                (placed - wanted)[keep],
                [
                    *(bodies.ties.lines(poses)[2] - lengths)[ties],
                    (bodies.work(poses) - goal) / size,
                ],
            )
            missed = float(np.abs(off).max(initial=0.0))
            if missed < EXACT * bodies.size or tried % 6 == 5:
                overlap = (placed[:, 0] < lowest) & ~active
                if not overlap.any() or tried > 18:
                    break
                active |= overlap
                continue
            keep = np.vstack([keep, np.column_stack([none, ties, *[none] * (dimension - 2)])])
            rows = bodies.relative_motion(units, poses)[keep.ravel()]
            matrix = vstack([rows, csr_matrix(live / size)])
            normal = matrix.T @ matrix + 1e-9 * identity(matrix.shape[1])
            change = -splu(normal.tocsc()).solve(matrix.T @ off)
            poses = poses.moved(bodies.motions(change))
        return poses, missed
