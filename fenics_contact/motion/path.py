"""The path of a structure after its peak: equilibrium in every pose, until no strength is left.

Each point is a limit load in its own geometry with a proved gap. The state of a point gives the
way; blocks move along it by so much work of the live load that no corner moves farther than the
step, then Newton's method puts them onto the chain: units that press keep a gap of 0, those that
stick their places, and the work is that of the step. The energy that the live load brings in is
what the dead load and ties take up and what friction uses: a check from geometry alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.model import FaceModel
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.motion.poses import Poses
from fenics_contact.motion.step import MovingBlocks, face_model, given_state, state_of
from fenics_contact.motion.support import fall
from fenics_contact.motion.touching import PointUnits

#: The first step, the largest and the least one, in sizes of blocks and in first steps.
FIRST = 0.02
LARGEST, LEAST = 8.0, 1.0 / 64.0
#: Sides as near as so many steps may touch within one.
REACH = 3.0
#: Change of the load factor in a step, over the first one: a step is taken again, half as long,
#: above the larger one; the next step is longer below the smaller one.
CHANGE = 0.05
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


class End(NamedTuple):
    """Why a path ends, and blocks that lose their support."""

    why: str
    lost: tuple[int, ...] = ()


@dataclass(frozen=True)
class Stage:
    """A pose, the state of a step from it, and the size of the step, m.

    `change` is that of the load factor in the step before, over the first load factor.
    """

    poses: Poses
    units: PointUnits
    model: FaceModel
    gaps: Array
    state: FaceState
    work: float
    step: float
    change: float = CHANGE

    @property
    def forces(self) -> dict[tuple[int, ...], Array]:
        """Of units, by their keys."""
        return dict(zip(self.units.key, self.state.force, strict=False))


class Following(NamedTuple):
    """The next stage, the work of friction on the way, J, and what happened, in words."""

    stage: Stage
    used: float
    event: str


@dataclass
class Follower:
    """Follows the path of some bodies.

    Attributes:
        bodies: Blocks as drawn.
        control: Displacement of the control point in some poses, m.
        first: Forces at places of the collapse to begin from, as a function of units.
        asked: Gap of each point that is enough.
        until: Displacement at which the path ends, m.
        check_stop: May raise `Stopped`: the points found until then are the path.
    """

    bodies: MovingBlocks
    control: Callable[[Poses], float]
    first: Callable[[PointUnits, Poses], Array] | None = None
    asked: float = 1e-3
    until: float = np.inf
    check_stop: Callable[[], None] = lambda: None

    def __post_init__(self) -> None:
        self._sign = 1.0 if self.bodies.driven is None else -1.0
        self._longest = self.bodies.ties.length  # that plastic ties have had

    def trace(self, step: float) -> Trace:
        """The path by steps that begin with a size, m."""
        points: list[BeyondPoint] = []
        end = End("")
        self._longest = self.bodies.ties.length
        try:
            stage = self.drawn
            scale = abs(stage.state.load_factor) or 1.0
            points.append(self._point(stage, 0.0, ""))
            end = End(self._ended(points, scale))
            if not end.why:
                stage = self._stage(stage.poses, step, stage)
            while not end.why:
                self.check_stop()
                following = self._following(stage, scale, step)
                if isinstance(following, End):
                    end = following
                else:
                    stage, used, event = following
                    length = self.bodies.ties.lines(stage.poses)[1]
                    self._longest = np.maximum(self._longest, length)
                    points.append(self._point(stage, points[-1].friction + used, event))
                    end = End(self._ended(points, scale))
        except Stopped as stopped:
            return Trace(tuple(points), str(stopped), stopped=True)
        except SolverError:
            end = End(NO_STATE)
        return Trace(tuple(points), end.why, end.lost)

    def _ended(self, points: list[BeyondPoint], scale: float) -> str:
        """Why the path ends at its last point; empty where it goes on."""
        here = points[-1]
        if self._sign * here.load_factor <= NOTHING * scale and self.bodies.driven is None:
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
        bodies = self.bodies
        units = bodies.sides.near(bodies.start, TOUCH * bodies.size)
        model = face_model(bodies, units, bodies.start, self._longest)
        gaps = np.zeros(model.shape[0])
        begin = None
        state = None
        if self.first is not None:
            begin = self.first(units, bodies.start)
            state = given_state(model, begin, self._sign)
        state = state or state_of(model, gaps, 1.0, begin, self.asked, self._sign)
        return Stage(bodies.start, units, model, gaps, state, work=0.0, step=0.0)

    def _stage(self, poses: Poses, step: float, before: Stage) -> Stage:
        """The state of a step from some poses, from the forces of the stage before."""
        bodies = self.bodies
        units = bodies.sides.near(poses, REACH * step)
        if not units.key:
            raise SolverError(SUPPORT_LOST)
        model = face_model(bodies, units, poses, self._longest)
        gaps = np.zeros(model.shape[0])
        gaps[: len(units.key)] = units.at(poses)[2][:, 0]
        known = before.forces
        none = np.zeros(model.shape[1])
        ties = before.state.force[len(before.units.key) :]
        begin = np.array([*(known.get(key, none) for key in units.key), *ties])
        speed = bodies.speed(before.state.mode)
        for _ in range(3):
            work = step / speed
            state = state_of(
                model, np.maximum(gaps, -OVERLAP * step), work, begin, self.asked, self._sign
            )
            speed = bodies.speed(state.mode)
            if speed * work < 2.0 * step:
                break
        return Stage(poses, units, model, gaps, state, work, step)

    def _following(self, stage: Stage, scale: float, first: float) -> Following | End:
        """The next stage; or the end, if there is none behind the shortest step."""
        least = LEAST * first
        here = stage
        landings = 0
        used = 0.0
        lost: tuple[int, ...] = ()
        why = ""
        while True:
            part = 0.5
            poses = None
            try:
                poses, used = self._moved(here, least)
                if lost:  # whether anything holds them is asked before the programs
                    lost = self._lost(poses)
                if lost:
                    raise SolverError(SUPPORT_LOST)
                step = self._next_step(stage, here, first)
                found = self._stage(poses, step, here)
            except SolverError as error:
                why = str(error)
                if poses is not None and not lost:
                    lost = self._lost(poses)
            else:
                change = abs(found.state.load_factor - stage.state.load_factor) / scale
                jumps = change > 2.5 * CHANGE
                why = "" if found.state.gap <= 10.0 * self.asked else NO_STATE
                left = found.state.load_factor if self._sign > 0.0 else np.inf
                if not why and not jumps and (left > -NOTHING * scale or landings == LANDINGS):
                    return Following(replace(found, change=change), used, "")
                if not why and not jumps:  # onto the place where nothing is left
                    part = stage.state.load_factor / (stage.state.load_factor - left)
                    landings += 1
            if not landings:
                part = max(part, least / here.step)
            if part > 0.9999 and not landings:
                break
            try:
                here = self._stage(here.poses, part * here.step, here)
            except SolverError:
                return End(NO_STATE)
        if why:
            return End(SUPPORT_LOST, lost) if lost else End(NO_STATE)
        return Following(replace(found, change=change), used, "jump")

    def _lost(self, poses: Poses) -> tuple[int, ...]:
        """Blocks that nothing holds in some poses, whatever the load factor; empty if all are."""
        bodies = self.bodies
        units = bodies.sides.near(poses, TOUCH * bodies.size)
        if not units.key:
            return tuple(bodies.moves.tolist())
        motion = fall(face_model(bodies, units, poses, self._longest))
        if motion is None:
            return ()
        speed = np.linalg.norm(bodies.motions(motion)[:, :3], axis=1)
        return tuple(np.flatnonzero(speed > 0.1 * speed.max()).tolist())

    def _next_step(self, stage: Stage, here: Stage, first: float) -> float:
        """The step from the next stage, by how the load factor changed before this one."""
        if here.step < stage.step or stage.change >= CHANGE:
            return max(0.7 * here.step, LEAST * first)
        return min((1.5 if stage.change < 0.5 * CHANGE else 1.0) * here.step, LARGEST * first)

    def _point(self, stage: Stage, friction: float, event: str) -> BeyondPoint:
        bodies = self.bodies
        count = len(stage.units.key)
        normal = stage.state.force[:count, 0]
        places = stage.units.at(stage.poses)[0]
        return BeyondPoint(
            self.control(stage.poses),
            stage.state.load_factor,
            self._live_work(stage.poses),
            stage.state.gap,
            float(-stage.gaps.min(initial=0.0)),
            bodies.stored(stage.poses),
            friction,
            event,
            stage.poses,
            places[normal > 1e-6 * stage.model.force],
        )

    def _live_work(self, poses: Poses) -> float:
        """Of the live load since the start, J; of driven ground against the unit force."""
        bodies = self.bodies
        if bodies.driven is None:
            return float(bodies.loads["live"].work(bodies.start, poses))
        return -self.driven_by(poses)

    def driven_by(self, poses: Poses) -> float:
        """How far ground that is driven has gone, m."""
        driven = self.bodies.driven
        if driven is None:
            return 0.0
        shift = (poses.centroid - self.bodies.start.centroid)[:-1]
        return float(np.vdot(shift, driven[:, :3]) / np.vdot(driven[:, :3], driven[:, :3]))

    def _moved(self, stage: Stage, least: float) -> tuple[Poses, float]:
        """Poses behind the step of a stage, and the work of friction in it, J.

        Raises:
            SolverError: If contacts contradict each other.
        """
        model = stage.model
        units = stage.units
        count = len(units.key)
        unknowns = stage.work * stage.state.mode
        relative = model.relative(unknowns)[:count]
        force = stage.state.force[:count]
        normal = np.maximum(force[:, 0], 0.0)
        opening = np.maximum(stage.gaps[:count] + relative[:, 0], 0.0)
        large = normal > 1e-7 * model.force
        active = large & (normal / model.force > opening / stage.step)
        slip = np.linalg.norm(relative[:, 1:], axis=1)
        shear = np.linalg.norm(force[:, 1:], axis=1)
        left = np.maximum(units.friction * normal - shear, 0.0)
        sticks = active & (slip / stage.step < left / model.force)
        first = stage.poses.moved(self.bodies.motions(unknowns))
        used = float(shear @ slip)
        stretched = model.relative(unknowns)[count:, 1]  # of ties that yield
        used += float((model.strength[count:] - stage.state.force[count:, 1]) @ stretched)
        for keep in (sticks, np.zeros(count, dtype=bool)):  # hinges; else gaps alone
            poses, missed = self._on_chain(stage, first, active, keep)
            if missed < 1e-2 * stage.step and self._apart(first, poses) < 0.5 * stage.step:
                return poses, used
        if stage.step > least * 1.01:
            raise SolverError("contacts contradict each other")
        return first, used

    def _apart(self, one: Poses, other: Poses) -> float:
        """Largest distance of corners in two poses, about, m."""
        shift = np.linalg.norm(one.centroid - other.centroid, axis=1)[:-1]
        turn = np.abs(one.rotation - other.rotation).max(axis=(1, 2))[:-1]
        return float((shift + turn * self.bodies.sides.reach)[self.bodies.moves].max())

    def _on_chain(
        self, stage: Stage, poses: Poses, active: Flags, sticks: Flags
    ) -> tuple[Poses, float]:
        """Poses near some with gaps 0, places kept, the work of the step; what is missed, m.

        Newton's method; units that would overlap more are kept closed, too.
        """
        from scipy.sparse import csr_matrix, identity, vstack
        from scipy.sparse.linalg import splu

        bodies = self.bodies
        units = stage.units
        count = len(units.key)
        dimension = bodies.structure.dimension
        before = units.at(stage.poses)[2][:, :dimension]
        wanted = np.where(np.arange(dimension) == 0, 0.0, before)
        goal = self._live_work(stage.poses) + self._sign * stage.work
        active = active.copy()
        missed = np.inf
        for tried in range(24):
            placed = units.at(poses)[2][:, :dimension]
            keep = np.zeros(placed.shape, dtype=bool)
            keep[active, 0] = True
            keep[sticks, 1:] = True
            live = bodies.live(poses)
            size = float(np.linalg.norm(live))
            off = np.append((placed - wanted)[keep], (self._live_work(poses) - goal) / size)
            missed = float(np.abs(off).max(initial=0.0))
            if missed < EXACT * bodies.size or tried % 6 == 5:
                lowest = np.minimum(before[:, 0], 0.0) - 1e-10 * bodies.size
                overlap = (placed[:, 0] < lowest) & ~active
                if not overlap.any() or tried > 18:
                    break
                active |= overlap
                continue
            rows = bodies.relative_motion(units, poses)[: count * dimension][keep.ravel()]
            matrix = vstack([rows, csr_matrix(live / size)])
            normal = matrix.T @ matrix + 1e-9 * identity(matrix.shape[1])
            change = -splu(normal.tocsc()).solve(matrix.T @ off)
            poses = poses.moved(bodies.motions(change))
        return poses, missed


def control_corner(bodies: MovingBlocks, mode: Array, along: Array) -> tuple[int, Array]:
    """The highest corner that moves, of these the farthest one along a direction.

    Returns:
        Its block, and its arm from the centroid as drawn, m.
    """
    sides = bodies.sides
    motions = bodies.motions(mode)
    turning = np.linalg.norm(motions[:, 3:], axis=1) * sides.reach
    speed = np.linalg.norm(motions[:, :3], axis=1) + turning
    moving = [k for k, block in enumerate(sides.owner) if speed[block] > 1e-3 * speed.max()]
    best: tuple[tuple[float, float], int, Array] | None = None
    for k in moving:
        block = int(sides.owner[k])
        places = sides.corners[k] + bodies.start.centroid[block]
        ranks = np.round(places @ np.column_stack([[0.0, 0.0, 1.0], along]) / bodies.size, 6)
        number = int(np.lexsort((ranks[:, 1], ranks[:, 0]))[-1])
        rank = float(ranks[number, 0]), float(ranks[number, 1])
        if best is None or rank > best[0]:
            best = rank, block, sides.corners[k][number]
    if best is None:
        raise SolverError("no block moves")
    return best[1], best[2]


def displacement_of(
    bodies: MovingBlocks, block: int, arm: Array, along: Array
) -> Callable[[Poses], float]:
    """Displacement of a place fixed to a block along a unit vector, m."""
    number: Indices = np.array([block])

    def displacement(poses: Poses) -> float:
        moved = poses.placed(number, arm[None]) - bodies.start.placed(number, arm[None])
        return float(moved[0] @ along)

    return displacement
