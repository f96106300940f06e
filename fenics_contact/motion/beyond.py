"""What a structure carries after its peak, or as its ground moves on: the way, followed twice.

Where blocks turn, paths by steps of a size and of half of it agree to many digits. Where they slide
an interval of collapse states opens at every point, and the two part: what is told then ends there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.geometry.mesh import Array
from fenics_contact.motion.path import (
    ASKED,
    FIRST,
    NO_STATE,
    NOTHING,
    NOTHING_LEFT,
    SUPPORT_LOST,
    BeyondPoint,
    Follower,
    Trace,
)
from fenics_contact.motion.poses import Poses
from fenics_contact.motion.step import MovingBlocks, Scenery
from fenics_contact.spatial.structure import Structure

#: Two paths agree as long as their curves are as near as this, in units of the end and of the
#: first load factor.
AGREE = 0.04
#: Ends of two paths are one if displacements differ by less than this part.
SAME_END = 0.02
#: Places between two points of a curve, for distances from it.
BETWEEN = 200
#: Components of a live load below this part of its size say nothing of its direction.
RESULTANT = 1e-6
#: Blocks that a sentence names.
NAMED = 4


@dataclass(frozen=True)
class ControlPoint:
    """A place fixed to a block, and the direction of its displacement.

    Attributes:
        block: Number of the block.
        arm: From its centroid as drawn, m.
        along: Unit vector.
    """

    block: int
    arm: Array
    along: Array

    @classmethod
    def of(cls, bodies: MovingBlocks, mode: Array, place: Sequence[float] | None) -> ControlPoint:
        """The corner that is nearest to a place, m, of blocks that move.

        By default the highest one, of these the farthest one along the live load; the ground that
        moves on fastest, if any does.

        Raises:
            SolverError: If no block moves.
        """
        along = _direction(bodies.live.force)
        if bodies.driven is not None:
            fastest = int(np.linalg.norm(bodies.driven[:, :3], axis=1).argmax())
            along = _direction(bodies.driven[[fastest], :3])
            if place is None:
                return cls(fastest, np.zeros(3), along)
        arms = bodies.sides.corners.reshape(-1, 3)
        corners = bodies.sides.placed(bodies.start).reshape(-1, 3)
        block = np.repeat(bodies.sides.owner, len(arms) // len(bodies.sides.owner))
        speed = bodies.speed(mode)
        moves = bodies.structure.number >= 0
        if place is None:
            moves &= speed > 1e-3 * speed.max()
            ranks = np.round(corners @ np.column_stack([along, [0.0, 0.0, 1.0]]) / bodies.size, 6)
        else:
            away = np.linalg.norm(bodies.structure.told(corners) - np.array(place), axis=1)
            ranks = -away[:, None]
        some = np.flatnonzero(moves[block])
        if not len(some):
            raise SolverError("no block moves")
        best = some[np.lexsort(ranks[some].T)[-1]]
        return cls(int(block[best]), arms[best], along)

    def displacement(self, start: Poses, poses: Poses) -> float:
        """Since the start, m."""
        number, arm = np.array([self.block]), self.arm[None]
        return float((poses.placed(number, arm) - start.placed(number, arm))[0] @ self.along)

    def velocity(self, mode: Array) -> float:
        """In a mode of all blocks, shape (blocks, 6)."""
        turned = np.cross(mode[self.block, 3:], self.arm)
        return float((mode[self.block, :3] + turned) @ self.along)


@dataclass(frozen=True)
class Beyond:
    """The way down after the peak, or of ground that moves on.

    Attributes:
        block: Name of the block of the control point.
        place: Control point as drawn, m.
        along: Unit vector of its displacement, that of the live load.
        control: The control point.
        driven: Whether the ground moves on: load factors are then what the structure presses it
            with along its way, N.
        fine: Path by steps half as long: what is told; the other one where this was stopped.
        coarse: Path by the others.
        left_out: Laws that are not followed, in words.
        lost: Names of blocks that nothing holds at the end.
    """

    block: str
    place: tuple[float, ...]
    along: tuple[float, ...]
    control: ControlPoint
    driven: bool
    fine: Trace
    coarse: Trace
    left_out: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()

    @property
    def end(self) -> float:
        """Displacement at the last point, m."""
        return self.fine.points[-1].displacement

    @property
    def other_end(self) -> float:
        """That of the path by longer steps, m."""
        return self.coarse.points[-1].displacement

    @property
    def zero(self) -> float | None:
        """Displacement at which nothing is left, m; None where the path ends otherwise."""
        return self.end if self.fine.why == NOTHING_LEFT and self.agrees else None

    @property
    def agrees(self) -> bool:
        """Whether both paths come to one end by one way."""
        ends = [trace.points[-1] for trace in (self.fine, self.coarse)]
        same = abs(self.end - self.other_end) <= SAME_END * max(abs(self.end), abs(self.other_end))
        same |= all(point.event == "jump" for point in ends)  # each behind its shortest step
        if self.fine.why == self.coarse.why == ASKED:
            return self.is_twice and self.until >= min(self.end, self.other_end)
        return self.is_twice and same and self.until >= self.end

    @property
    def is_twice(self) -> bool:
        """Whether the way was followed twice to its end."""
        return self.fine is not self.coarse and not self.coarse.stopped

    @property
    def trusted(self) -> tuple[BeyondPoint, ...]:
        """Points up to where both paths agree; none where it was followed once."""
        points = self.fine.points if self.is_twice else ()
        return tuple(point for point in points if point.displacement <= self.until)

    @cached_property
    def until(self) -> float:
        """Displacement up to which both paths agree, m."""
        from scipy.spatial import cKDTree

        scale = max(self.end, 1e-300), abs(self.fine.points[0].load_factor) or 1.0
        here, there = (np.column_stack(one.curve) / scale for one in (self.fine, self.coarse))
        number = np.linspace(0.0, len(there) - 1.0, BETWEEN * len(there))
        line = [np.interp(number, np.arange(len(there)), column) for column in there.T]
        apart = cKDTree(np.column_stack(line)).query(here)[0] > AGREE
        last = int(np.argmax(apart)) - 1 if apart.any() else len(here) - 1
        return float(self.fine.points[max(last, 0)].displacement)

    def at(self, displacement: float) -> float:
        """Load factor at a displacement, by straight lines between points."""
        return float(np.interp(displacement, *self.fine.curve))

    def sentences(self) -> list[str]:
        """What people are told: the way, how far it is to be trusted, what it leaves out."""
        without = f"this leaves out {' and '.join(self.left_out)}"
        return [f"{self.head} {self.text}", *[without] * bool(self.left_out), self.checks]

    def amount(self, displacement: float) -> str:
        """Load factor at a displacement, or the force on the ground, in words."""
        return f"{self.told(self.at(displacement)):.3g}{self.unit}"

    @property
    def unit(self) -> str:
        """Behind what is carried."""
        return " kN" if self.driven else ""

    def told(self, load_factor: float) -> float:
        """What is carried: a load factor, or a force in kN; 0 where next to nothing is left."""
        small = abs(load_factor) <= NOTHING * abs(self.fine.points[0].load_factor)
        return 0.0 if small else load_factor * (1e-3 if self.driven else 1.0)

    @property
    def head(self) -> str:
        """What the way is of, in words."""
        return "as the ground moves on it is pressed with" if self.driven else "after the peak:"

    @property
    def text(self) -> str:
        """The way in words, behind `head`."""
        end = self.end if self.agrees or not self.is_twice else self.until
        goes = f"{self.amount(0.0)} at once"
        here, factor = self.fine.curve
        most = float(here[factor.argmax()])
        rises = factor.max() > (1.0 + SAME_END) * abs(factor[0]) and most < end
        if end <= 0.0 and self.fine.why == NOTHING_LEFT:
            return "nothing"
        if len(self.fine.points) == 1 and self.is_twice:
            return f"{goes}; no state was found behind it"
        middle = most if rises else float(f"{0.4 * end:.2g}")
        goes += f", {self.amount(middle)} at {middle:.3g} m"
        last = f"{self.amount(end)} at {end:.3g} m"
        where = "" if self.driven else f" (block {self.block} at {_place(self.place)})"
        if not self.is_twice:
            return f"{goes}, {last}; stopped before it was followed twice: no end is told{where}"
        if not self.agrees:
            one, other = sorted([self.end, self.other_end])
            return (
                f"{goes}, {last}; from there blocks that slide may go several ways: two paths end"
                f" at {one:.3g} and {other:.3g} m{where}"
            )
        ends = {
            NOTHING_LEFT: f"nothing at {end:.3g} m",
            SUPPORT_LOST: f"{last}, where {_names(self.lost)}",
            NO_STATE: f"{last}; no state was found behind it",
        }
        return f"{goes}, {ends.get(self.fine.why, last)}{where}"

    @property
    def checks(self) -> str:
        """How far the path is to be trusted, in words."""
        gap = max(point.gap for point in self.fine.points)
        return (
            f"{len(self.fine.points)} points, gaps up to {gap:.0e}, blocks overlap by"
            f" {self.fine.overlap:.0e} m at most, the energy closes to"
            f" {100 * self.fine.energy:.2g} %"
            + f"; with steps twice as long the end is at {self.other_end:.4g} m"
            * self.is_twice
        )

    def record(self) -> dict[str, Any]:
        """For result.json."""
        names = "displacement", "load_factor", "work", "gap", "overlap", "event"
        return {
            "control": {"block": self.block, "place": self.place, "along": self.along},
            "driven": self.driven,
            "points": [{n: getattr(p, n) for n in names} for p in self.fine.points],
            "zero": self.zero,
            "end": {"why": self.fine.why, "displacement": self.end, "blocks": self.lost},
            "other_end": {"why": self.coarse.why, "displacement": self.other_end},
            "agree_until": self.until,
            "energy": self.fine.energy,
            "overlap": self.fine.overlap,
            "left_out": self.left_out,
        }

    def rows(self) -> Iterator[str]:
        """Lines of beyond.csv."""
        names = "displacement", "load_factor", "work", "gap", "overlap", "stored", "friction"
        yield ",".join([*names, "event"])
        for point in self.fine.points:
            numbers = (f"{getattr(point, name):.10g}" for name in names)
            yield ",".join([*numbers, point.event])


def beyond(
    structure: Structure,
    collapse: Any = None,
    *,
    until: float = np.inf,
    control: Sequence[float] | None = None,
    check_stop: Callable[[], None] = lambda: None,
) -> Beyond | None:
    """The way down of a structure from its collapse; None where no state was found at all.

    Where the ground moves with the dead load (`Structure.moved`) that goes on: no live load acts.

    Args:
        structure: As drawn.
        collapse: Its limit, with forces and ties' tensions: where the path begins.
        until: Displacement of the control point at which it ends, m.
        control: Place of the control point, m, of as many numbers as dimensions; None: the highest
            corner that moves.
        check_stop: May raise `Stopped`: what is known by then is the answer.
    """
    driven = structure.moved
    if driven is not None and (size := float(np.linalg.norm(driven[:, :3], axis=1).max())):
        driven = driven / size
    bodies = MovingBlocks(structure, driven, 1.0 if collapse is None else collapse.sign)
    follower = Follower(bodies, until=until, check_stop=check_stop)
    if driven is None and collapse is not None and collapse.force is not None:
        follower.first = partial(_forces_of, structure, collapse)
    try:
        point = ControlPoint.of(bodies, follower.drawn.state.mode, control)
    except SolverError:
        return None
    follower.control = partial(point.displacement, bodies.start)
    step = FIRST * bodies.size
    coarse = follower.trace(step)
    fine = coarse if coarse.stopped else follower.trace(0.5 * step)
    fine = coarse if fine.stopped else fine
    names = [one.name or str(k) for k, one in enumerate(structure.blocks)]
    return Beyond(
        names[point.block],
        tuple(structure.told(bodies.start.centroid[point.block] + point.arm).tolist()),
        tuple(structure.told(point.along).tolist()),
        point,
        driven is not None,
        fine,
        coarse,
        tuple(_left_out(structure)),
        tuple(names[k] for k in fine.lost),
    )


def _forces_of(structure: Structure, collapse: Any, scenery: Scenery) -> Array:
    """Forces of a collapse as the engine's in the poses as drawn."""
    count = len(collapse.force)
    vectors = np.einsum("pk,pki->pi", collapse.force, structure.axes[:count])
    first, second = (blocks[:count] for _, blocks, _ in structure.ends)
    return scenery.carried(
        structure.points.position, first, second, vectors, collapse.tension[: len(structure.bars)]
    )


def _direction(vectors: Array) -> Array:
    """Unit vector of a resultant; x where it is next to nothing."""
    total = vectors.sum(axis=0)
    size = float(np.linalg.norm(total))
    least = RESULTANT * float(np.linalg.norm(vectors, axis=1).sum())
    return np.asarray(total / size) if size > least else np.eye(3)[0]


def _left_out(structure: Structure) -> Iterator[str]:
    """Laws of contacts that a path does not follow."""
    if any(law.dilatancy for law in structure.laws):
        yield "dilatancy"
    if np.any(structure.limited):
        yield "crushing"
    if any(len(contact.corners) < 3 for contact in structure.contacts):
        yield "contacts in edges"


def _names(blocks: Sequence[str]) -> str:
    """Blocks and what they lose, in words."""
    if len(blocks) == 1:
        return f"block {blocks[0]} loses its support"
    more = ", ..." * (len(blocks) > NAMED)
    return f"blocks {', '.join(blocks[:NAMED])}{more} lose their support"


def _place(place: Sequence[float]) -> str:
    return f"({', '.join(f'{x:.3g}' for x in place)})"
