"""What a structure carries after its peak: the way down, followed twice.

Where blocks turn, paths by steps of a size and of half of it agree to many digits. Where they slide
an interval of collapse states opens at every point, and the two part: what is told then ends there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.geometry.mesh import Array
from fenics_contact.motion.path import (
    FIRST,
    NO_STATE,
    NOTHING_LEFT,
    SUPPORT_LOST,
    Follower,
    Trace,
    control_corner,
    displacement_of,
)
from fenics_contact.motion.step import Bodies, forces_as
from fenics_contact.spatial.structure import Structure

#: Two paths agree as long as their curves are as near as this, in units of the end and of the
#: first load factor.
AGREE = 0.04
SMALLEST = 1e-300
#: Ends of two paths are one if displacements differ by less than this part.
SAME_END = 0.02
#: Components of a live load below this part of its size say nothing of its direction.
RESULTANT = 1e-6


@dataclass(frozen=True)
class Beyond:
    """The way down after the peak.

    Attributes:
        block: Name of the block of the control point.
        place: Control point as drawn, m.
        along: Unit vector of its displacement, that of the live load.
        fine: Path by steps half as long: what is told.
        coarse: Path by the others.
        left_out: Laws that are not followed, in words.
        lost: Names of blocks that nothing holds at the end.
    """

    block: str
    place: tuple[float, ...]
    along: tuple[float, ...]
    fine: Trace
    coarse: Trace
    left_out: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()

    @property
    def curve(self) -> tuple[Array, Array]:
        """Displacements, m, and load factors."""
        return self.fine.curve

    @property
    def end(self) -> float:
        """Displacement at the last point, m."""
        return self.fine.points[-1].displacement

    @property
    def zero(self) -> float | None:
        """Displacement at which nothing is left, m; None where the path ends otherwise."""
        return self.end if self.fine.why == NOTHING_LEFT and self.agrees else None

    @property
    def agrees(self) -> bool:
        """Whether both paths come to one end by one way."""
        other = self.coarse.points[-1].displacement
        same = abs(self.end - other) <= SAME_END * max(abs(self.end), abs(other))
        return same and self.until >= self.end

    @property
    def until(self) -> float:
        """Displacement up to which both paths agree, m."""
        scale = np.array([max(self.end, SMALLEST), abs(self.fine.points[0].load_factor) or 1.0])
        here, there = (np.column_stack(one.curve) / scale for one in (self.fine, self.coarse))
        apart = _distance(here, there) > AGREE
        last = int(np.argmax(apart)) - 1 if apart.any() else len(here) - 1
        return float(self.fine.points[max(last, 0)].displacement)

    def at(self, displacement: float) -> float:
        """Load factor at a displacement, by straight lines between points."""
        return float(np.interp(displacement, *self.curve))

    def sentences(self) -> list[str]:
        """What people are told."""
        told = [self.sentence, self.checks]
        if self.left_out:
            told.append(f"after the peak without {' and '.join(self.left_out)}")
        return told

    @property
    def sentence(self) -> str:
        """The way down in one sentence."""
        first = self.at(0.0)
        goes = f"after the peak: {first:.3g} at once"
        end = self.end if self.agrees else self.until
        if end > 0.0:
            middle = _round(0.4 * end)
            goes += f", {self.at(middle):.3g} at {middle:g} m"
        if not self.agrees:
            others = sorted([self.end, self.coarse.points[-1].displacement])
            return (
                f"{goes}, {self.at(end):.3g} at {end:.3g} m; from there blocks that slide may go"
                f" several ways: two paths end at {others[0]:.3g} and {others[1]:.3g} m"
                f" ({self.where})"
            )
        ends = {
            NOTHING_LEFT: f"nothing at {end:.3g} m",
            SUPPORT_LOST: f"{self.at(end):.3g} at {end:.3g} m, where {_names(self.lost)}",
            NO_STATE: f"{self.at(end):.3g} at {end:.3g} m; no state was found behind it",
        }
        usual = f"{self.at(end):.3g} at {end:.3g} m"
        return f"{goes}, {ends.get(self.fine.why, usual)} ({self.where})"

    @property
    def where(self) -> str:
        """The control point in words."""
        return f"block {self.block} at ({', '.join(f'{x:.3g}' for x in self.place)})"

    @property
    def checks(self) -> str:
        """How far the path is to be trusted, in words."""
        gap = max(point.gap for point in self.fine.points)
        return (
            f"{len(self.fine.points)} points, gaps up to {gap:.0e}, blocks overlap by"
            f" {self.fine.overlap:.0e} m at most, the energy closes to {100 * self.fine.energy:.2g} %;"
            f" with steps twice as long the end is at {self.coarse.points[-1].displacement:.4g} m"
        )

    def record(self) -> dict[str, Any]:
        """For result.json."""
        names = "displacement", "load_factor", "work", "gap", "overlap", "event"
        return {
            "control": {"block": self.block, "place": self.place, "along": self.along},
            "points": [{n: getattr(p, n) for n in names} for p in self.fine.points],
            "zero": self.zero,
            "end": {"why": self.fine.why, "displacement": self.end, "blocks": self.lost},
            "other_end": {
                "why": self.coarse.why,
                "displacement": self.coarse.points[-1].displacement,
            },
            "agree_until": self.until,
            "energy": self.fine.energy,
            "overlap": self.fine.overlap,
            "left_out": self.left_out,
        }

    def rows(self) -> Iterator[str]:
        """Lines of beyond.csv."""
        yield "displacement,load_factor,work,gap,overlap,stored,friction,event"
        for p in self.fine.points:
            numbers = p.displacement, p.load_factor, p.work, p.gap, p.overlap, p.stored, p.friction
            yield ",".join([*(f"{number:.10g}" for number in numbers), p.event])


def beyond(
    structure: Structure,
    collapse: Any,
    *,
    until: float = np.inf,
    control: Sequence[float] | None = None,
    check_stop: Callable[[], None] = lambda: None,
) -> Beyond | None:
    """The way down of a structure from its collapse; None where no state was found at all.

    Args:
        structure: As drawn.
        collapse: Its limit, with forces and ties' tensions: where the path begins.
        until: Displacement of the control point at which it ends, m.
        control: Place of the control point, m; None: the highest corner that moves.
        check_stop: May raise `Stopped`: what is known by then is the answer.
    """
    bodies = Bodies(structure, sign=collapse.sign)
    first = forces_as(structure, collapse.force, collapse.tension, bodies)
    follower = Follower(bodies, lambda poses: 0.0, first, until=until, check_stop=check_stop)
    step = FIRST * bodies.size
    try:
        mode = follower.drawn(step).state.mode
    except SolverError:
        return None
    along = _direction(bodies)
    if control is None:
        block, arm = control_corner(bodies, mode, along)
    else:
        block, arm = _nearest(bodies, np.array(control))
    follower.control = displacement_of(bodies, block, arm, along)
    coarse = follower.trace(step)
    fine = follower.trace(0.5 * step)
    if not fine.points:
        return None
    place = structure.told(bodies.start.centroid[block] + arm)
    names = [structure.blocks[k].name or str(k) for k in range(len(structure.blocks))]
    return Beyond(
        names[block],
        tuple(place.tolist()),
        tuple(structure.told(along).tolist()),
        fine,
        coarse if coarse.points else fine,
        tuple(_left_out(structure)),
        tuple(names[k] for k in fine.lost),
    )


def _direction(bodies: Bodies) -> Array:
    """Unit vector of the live load's resultant; x where it has none."""
    force = bodies.loads["live"].force
    total = force.sum(axis=0)
    size = float(np.linalg.norm(total))
    if size <= RESULTANT * float(np.linalg.norm(force, axis=1).sum()):
        return np.eye(3)[0]
    return np.asarray(total / size)


def _nearest(bodies: Bodies, place: Array) -> tuple[int, Array]:
    """Block and arm of the corner that is nearest to a place, of those that move."""
    sides = bodies.sides
    found = []
    for k, block in enumerate(sides.owner.tolist()):
        if block in bodies.moves:
            places = sides.corners[k] + bodies.start.centroid[block]
            away = np.linalg.norm(places - place, axis=1)
            corner = int(away.argmin())
            found.append((float(away[corner]), block, sides.corners[k][corner]))
    _, block, arm = min(found, key=lambda one: one[:2])
    return block, arm


def _left_out(structure: Structure) -> Iterator[str]:
    """Laws of contacts that a path does not follow."""
    laws = structure.laws
    if any(law.cohesion or law.tensile_strength for law in laws):
        yield "cohesion and tensile strength"
    if any(law.dilatancy for law in laws):
        yield "dilatancy"
    if np.any(structure.crushes):
        yield "crushing"
    if any(len(contact.corners) < 3 for contact in structure.contacts):
        yield "contacts in edges"


def _distance(points: Array, line: Array) -> Array:
    """Least distances of points from a line through others, shape (points,)."""
    start, edge = line[:-1], np.diff(line, axis=0)
    length = np.maximum(np.einsum("ei,ei->e", edge, edge), SMALLEST)
    away = points[:, None] - start
    part = np.clip(np.einsum("pei,ei->pe", away, edge) / length, 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - part[:, :, None] * edge, axis=2).min(axis=1))


def _names(blocks: Sequence[str]) -> str:
    if len(blocks) == 1:
        return f"block {blocks[0]} loses its support"
    return f"blocks {', '.join(blocks[:4])}{', ...' * (len(blocks) > 4)} lose their support"


def _round(value: float) -> float:
    """To two digits."""
    return float(f"{value:.2g}")
