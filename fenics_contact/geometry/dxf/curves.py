"""Curves of a drawing: ends where polylines return, ends that miss others, arcs as chords.

An arc of bulge b between two points at the distance c has the radius c (1 + b^2) / (4 |b|) and the
angle 4 arctan b. Every arc has corners where other curves end on it, and between two corners chords
of at most `ANGLE`. The first arc between two corners gives its chords to all others between them,
so that two blocks have the same chords wherever they share an arc.

An end of an open curve that misses what it should meet goes along its last piece to the nearest
place where that meets another curve. An end that still hangs in the air goes to another end or to
the corner of a polyline near it. Ends on other lines stay: if they went to each other, their lines
would end beside those.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np

from fenics_contact.geometry.dxf.reader import Curve, Curves
from fenics_contact.geometry.outlines import outline_area, points_near_segments, snapped
from fenics_contact.geometry.planar_cells import Array, Flags, Indices, connected

#: Largest angle of a chord, radians; it leaves the arc by 0.1 % of the radius.
ANGLE = np.radians(5.0)
#: Part by which `ANGLE` may be exceeded: angles of arcs with bulges of few digits are not round.
ROUND = 0.01
#: Distance from an arc within which a point lies on it, over the largest distance of its chords.
#: Bulges written with four digits are that exact.
ON_ARC = 0.2
#: Distance within which a polyline comes back, and runs over itself, over its size; arcs are
#: compared by chords.
BACK = 1e-6
OVER = 1e-4
#: Least sine of the angle at which two lines meet: below it they run beside each other.
STEEP = 0.1
#: Places along a side of an opening at which lines beside it are looked for.
BESIDE = 32
#: Part of its last piece by which a line may become shorter.
SHORTER = 0.9
#: Part of the reach within which an end lies on a line that it was moved to; arcs are chords here.
ON_LINE = 0.1


# ---- chords


def chains_of_chords(curves: Sequence[Curve], near: float) -> list[Array]:
    """Corners of every curve, arcs divided, each of shape (corners, 2); closed ones end apart.

    Args:
        curves: The curves.
        near: Distance within which points are the same, in their unit.
    """
    if not any(curve.smooth or np.any(curve.bulges) for curve in curves):
        return [curve.points for curve in curves]
    ends = np.unique(snapped(np.concatenate([curve.ends for curve in curves]), near), axis=0)
    shared: dict[tuple[int, int, bool], Array] = {}  # chords between two ends

    def divided(start: Array, end: Array, bulge: float) -> Array:
        """Corners between the ends of an arc, shape (corners, 2)."""
        angle = 4.0 * float(np.arctan(bulge))
        along = end - start
        across = np.array([-along[1], along[0]])
        centre = 0.5 * (start + end + across / np.tan(0.5 * angle))
        arm = start - centre
        radius = float(np.linalg.norm(arm))
        leaves = radius * (1.0 - np.cos(0.5 * min(abs(angle), ANGLE)))
        off = np.abs(np.linalg.norm(ends - centre, axis=1) - radius)
        on = np.flatnonzero(off <= max(near, ON_ARC * leaves))
        turn = np.arctan2(*(ends[on] - centre).T[::-1]) - np.arctan2(arm[1], arm[0])
        part = (np.sign(bulge) * turn) % (2.0 * np.pi) / abs(angle)
        least = 1.5 * near / (radius * abs(angle))
        order = np.argsort(part)
        order = order[(part[order] > least) & (part[order] < 1.0 - least)]
        first, last = (int(np.argmin(np.sum((ends - p) ** 2, axis=1))) for p in (start, end))
        corners = [first, *on[order].tolist(), last]
        widths = np.diff([0.0, *part[order].tolist(), 1.0])
        rows = []
        for (one, other), width in zip(pairwise(corners), widths.tolist(), strict=True):
            key = (one, other, bulge > 0.0)
            if key not in shared:
                count = max(1, int(np.ceil(width * abs(angle) / ANGLE - ROUND)))
                shared[key] = _along_arc(ends[one], ends[other], width * angle, count)
                shared[other, one, bulge < 0.0] = shared[key][::-1]
            rows += [ends[one][None], shared[key]]
        return np.concatenate(rows)[1:]

    chains = []
    for curve in curves:
        if curve.smooth:
            chains.append(_smooth_chain(curve, ends, near))
            continue
        ring = as_ring(curve, curve.points)
        pieces = []
        for (start, end), bulge in zip(pairwise(ring), curve.bulges.tolist(), strict=False):
            pieces.append(start[None])
            if 0.5 * abs(bulge) * np.linalg.norm(end - start) > near:
                pieces.append(divided(start, end, bulge))
        chains.append(np.concatenate(pieces if curve.closed else [*pieces, ring[-1:]]))
    return chains


def _along_arc(start: Array, end: Array, angle: float, count: int) -> Array:
    """Points that divide an arc, or a straight line, into equal parts, shape (count - 1, 2).

    With the chord c as a complex number, that at the part t of the angle a is at
    start + c exp(i (t - 1) a / 2) sin(t a / 2) / sin(a / 2).
    """
    at = np.arange(1, count) / count
    half = 0.5 * angle / np.pi
    length = at * np.sinc(half * at) / np.sinc(half)
    way = complex(*(end - start)) * length * np.exp(0.5j * (at - 1.0) * angle)
    return np.asarray(start + np.column_stack([way.real, way.imag]))


def as_ring(curve: Curve, chain: Array) -> Array:
    """Corners of a curve, the first again at the end if it is closed."""
    return np.concatenate([chain, chain[:1]]) if curve.closed else chain


def finely_divided(curve: Curve) -> Array:
    """Points along a curve, its arcs in chords of a fifth of `ANGLE`; closed ones end as begun."""
    points = as_ring(curve, curve.points)
    rows = [points[:1]]
    for (start, end), bulge in zip(pairwise(points), curve.bulges.tolist(), strict=False):
        angle = 4.0 * float(np.arctan(bulge))
        rows += [_along_arc(start, end, angle, int(np.ceil(5.0 * abs(angle) / ANGLE))), end[None]]
    return np.concatenate(rows)


def _smooth_chain(curve: Curve, ends: Array, near: float) -> Array:
    """Chords of an ellipse or spline, one for every `ANGLE` of its turn at least.

    There are corners where other curves end on it.
    """
    points = as_ring(curve, curve.points)
    segments = np.stack([points[:-1], points[1:]], axis=1)
    size = float(np.ptp(points, axis=0).max())
    pairs = points_near_segments(ends, segments, max(near, ON_ARC * 1e-3 * size))
    _, first = np.unique(pairs.point, return_index=True)
    order = np.lexsort([pairs.at[first], pairs.segment[first]])
    after = pairs.segment[first][order] + 1
    corners = ends[pairs.point[first]][order]
    points = np.insert(points, after, corners, axis=0)
    keep = np.zeros(len(points), dtype=bool)
    keep[after + np.arange(len(corners))] = True
    apart = np.linalg.norm(points[:, None] - corners, axis=2).min(axis=1, initial=np.inf)
    far = keep | (apart > near)
    points = points[far]
    along = np.diff(points, axis=0)
    cross = along[:-1, 0] * along[1:, 1] - along[:-1, 1] * along[1:, 0]
    turn = np.abs(np.arctan2(cross, np.sum(along[:-1] * along[1:], axis=1)))
    turned = np.concatenate([[0.0], np.cumsum(turn), [turn.sum()]])
    fixed = np.unique([0, *np.flatnonzero(keep[far]).tolist(), len(points) - 1])
    chosen = [fixed]
    for start, end in pairwise(fixed.tolist()):
        total = turned[end] - turned[start]
        count = max(1, int(np.ceil(total / ANGLE - ROUND)))
        wanted = turned[start] + total * np.arange(1, count) / count
        at = np.searchsorted(turned[start:end], wanted) + start
        chosen.append(np.clip(at, start, end))
    chain = points[np.unique(np.concatenate(chosen))]
    return chain[:-1] if curve.closed else chain


# ---- polylines that come back to where they began and go on, as over their first side


def end_where_they_return(found: Curves) -> None:
    """End open polylines where they come back to their start; what runs on elsewhere is kept."""
    parts = [list(_parts(curve)) for curve in found.curves]
    pairs = zip(found.curves, parts, strict=True)
    returned = Counter(curve.layer for curve, some in pairs if some[0] is not curve)
    found.curves = [part for some in parts for part in some]
    found.notes += [
        f"{count} polylines on layer '{layer}' go around and on: they end where they come back"
        for layer, count in returned.items()
    ]


def _parts(curve: Curve) -> Iterator[Curve]:
    """A curve up to where it comes back, if it encloses an area there, and the rest likewise."""
    if curve.closed or curve.smooth or len(curve.points) < 3:
        yield curve
        return
    points = curve.points
    bulges = curve.bulges
    near = BACK * float(np.ptp(points, axis=0).max())
    pairs = points_near_segments(points[:1], np.stack([points[:-1], points[1:]], axis=1), near)
    at_end = np.linalg.norm(points[pairs.segment + 1] - points[0], axis=1) <= near
    good = (pairs.segment > 0) & (at_end | (bulges[pairs.segment] == 0.0))
    for piece in np.sort(pairs.segment[good]).tolist():
        ring = Curve(points[: piece + 1], bulges[: piece + 1], True, curve.layer, curve.kind)
        sides = finely_divided(ring)
        if abs(outline_area(sides)) <= near**2 / BACK:
            continue
        yield ring
        on = piece + 1 + int(np.linalg.norm(points[piece + 1] - points[0]) <= near)
        beyond = np.concatenate([points[:1], points[on:]])
        rest = replace(curve, points=beyond, bulges=bulges[on - 1 :])
        if len(rest.points) > 1:
            chain = finely_divided(rest)
            places = np.concatenate([chain, 0.5 * (chain[:-1] + chain[1:])])
            reach = OVER * float(np.ptp(ring.points, axis=0).max())
            segments = np.stack([sides[:-1], sides[1:]], axis=1)
            over = np.unique(points_near_segments(places, segments, reach).point)
            if len(over) < len(places):  # else it runs over the ring once more
                yield from _parts(rest)
        return
    yield curve


# ---- ends of lines that miss what they should meet


@dataclass(frozen=True)
class _Ends:
    """Ends of open curves.

    Attributes:
        curve: Number of the curve, shape (ends,).
        last: Whether it is the last point of the curve, else the first, shape (ends,).
        point: Where they are, shape (ends, 2).
        along: Direction in which the curve would go on, shape (ends, 2).
        length: Of the last piece, shape (ends,).
        angle: Of the last piece as an arc, radians, positive anticlockwise, shape (ends,).
    """

    curve: Indices
    last: Flags
    point: Array
    along: Array
    length: Array
    angle: Array

    @classmethod
    def of(cls, curves: Sequence[Curve], some: Sequence[int]) -> _Ends:
        """Ends of the open ones of some curves."""
        rows = []
        for k in some:
            points = curves[k].points
            bulges = curves[k].bulges
            if not curves[k].closed:
                rows.append((k, 0, *points[1], *points[0], -bulges[0]))
                rows.append((k, 1, *points[-2], *points[-1], bulges[len(points) - 2]))
        table = np.array(rows).reshape(-1, 7)
        table = table[np.any(table[:, 2:4] != table[:, 4:6], axis=1)]
        half = 2.0 * np.arctan(table[:, 6])
        direction = np.exp(1j * half) * ((table[:, 4:6] - table[:, 2:4]) @ [1.0, 1j])
        along = np.column_stack([direction.real, direction.imag]) / np.abs(direction)[:, None]
        length = np.abs(direction) / np.sinc(half / np.pi)
        number = table[:, 0].astype(np.int64)
        return cls(number, table[:, 1] > 0.0, table[:, 4:6], along, length, 2.0 * half)

    def moved(self, curves: Sequence[Curve], new: Array, angle: Array) -> list[Curve]:
        """Curves with new places of these ends, and angles of their last pieces."""
        found = list(curves)
        bulge = np.tan(0.25 * angle)
        for k, number in enumerate(self.curve.tolist()):
            points = found[number].points.copy()
            bulges = found[number].bulges.copy()
            points[-1 if self.last[k] else 0] = new[k]
            bulges[len(points) - 2 if self.last[k] else 0] = bulge[k] if self.last[k] else -bulge[k]
            found[number] = replace(found[number], points=points, bulges=bulges)
        return found


def snapped_curves(curves: Sequence[Curve], some: Sequence[int], reach: float) -> list[Curve]:
    """Curves of which ends of some meet each other.

    Args:
        curves: All curves.
        some: Numbers of those that are lines of the structure.
        reach: Largest way of an end along its line, and distance within which ends become one.
    """
    from scipy.spatial import cKDTree

    found = _extended(curves, some, _Ends.of(curves, some), reach)
    ends = _Ends.of(found, some)
    hangs = np.ones(len(ends.curve), dtype=bool)
    segments, owner = _segments_of(found, some)
    pairs = points_near_segments(ends.point, segments, ON_LINE * reach)
    along = ends.along[pairs.point]
    over = np.diff(segments[pairs.segment], axis=1)[:, 0]
    sine = np.abs(along[:, 0] * over[:, 1] - along[:, 1] * over[:, 0]) / np.hypot(*over.T)
    other = ends.curve[pairs.point] != owner[pairs.segment]
    hangs[pairs.point[other & (sine >= STEEP)]] = False
    corners = [curves[k].ends if curves[k].closed else curves[k].ends[1:-1] for k in some]
    # Ends near each other get one place: a fixed one, an arc's end, which would become another arc,
    # or the middle one.
    count = int(hangs.sum())
    every = np.concatenate([ends.point[hangs], ends.point[~hangs], *corners])
    rank = np.full(len(every), 2)
    rank[:count] = ends.angle[hangs] != 0.0
    near = cKDTree(every).query_pairs(reach, output_type="ndarray")
    label = connected(near[np.any(near < count, axis=1)], len(every))
    order = np.argsort(label, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        own = members[members < count]
        if len(members) > 1:
            some_ends = members[rank[members] == rank[members].max()]
            off = np.linalg.norm(every[some_ends] - every[own].mean(axis=0), axis=1)
            every[own] = every[some_ends[np.argmin(off)]]
    points = ends.point.copy()
    points[hangs] = every[:count]
    found = ends.moved(found, points, ends.angle)
    fixed = {*zip(ends.curve[~hangs], ends.last[~hangs], strict=True)}
    ends = _Ends.of(found, some)  # fewer where a curve has become a point
    kept = [end in fixed for end in zip(ends.curve, ends.last, strict=True)]
    touching = _Ends(*(getattr(ends, item.name)[kept] for item in fields(ends)))
    return _extended(found, some, touching, reach)  # on lines that have turned a little


def openings_onto_lines(
    curves: Sequence[Curve], voids: Sequence[int], lines: Sequence[int], reach: float
) -> list[Curve]:
    """Curves of which straight outlines of openings go to lines that run beside them.

    Else what is between the two would be a sliver of a block.
    """
    found = list(curves)
    outlines = [k for k in voids if curves[k].closed and not np.any(curves[k].bulges)]
    if not (lines and outlines):
        return found
    segments, _ = _segments_of(curves, lines)
    over = segments[:, 1] - segments[:, 0]
    over /= np.linalg.norm(over, axis=1, keepdims=True)
    part = ((np.arange(BESIDE) + 0.5) / BESIDE)[:, None]
    for k in outlines:
        points = curves[k].points
        sides = np.roll(points, -1, axis=0) - points
        way = sides / np.maximum(np.linalg.norm(sides, axis=1, keepdims=True), 1e-300)
        samples = (points[:, None] + part * sides[:, None]).reshape(-1, 2)
        pairs = points_near_segments(samples, segments, reach)
        side = pairs.point // BESIDE
        beside = np.abs(_cross(way[side], over[pairs.segment])) < STEEP
        base = points.copy()
        for number in np.unique(side[beside]).tolist():  # the line beside most of it
            line = np.bincount(pairs.segment[beside & (side == number)]).argmax()
            base[number], way[number] = segments[line, 0], over[line]
        # A corner is where a side meets the one before; of two in one line, it is on that.
        first, along = np.roll(base, 1, axis=0), np.roll(way, 1, axis=0)
        sine = _cross(along, way)
        meets = np.abs(sine) >= STEEP
        far = _cross(base - first, way) / np.where(meets, sine, 1.0)
        level = np.sum((points - base) * way, axis=1)
        corners = np.where(
            meets[:, None], first + far[:, None] * along, base + level[:, None] * way
        )
        if np.linalg.norm(corners - points, axis=1).max() <= 2.0 * reach:
            found[k] = replace(curves[k], points=corners)
    return found


def _cross(one: Array, other: Array) -> Array:
    """Cross products of vectors in the plane."""
    return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])


def _segments_of(curves: Sequence[Curve], some: Sequence[int]) -> tuple[Array, Indices]:
    """Straight pieces of some curves, short chords of their arcs, (n, 2, 2), and their curves."""
    chains = [finely_divided(curves[k]) for k in some]
    segments = np.concatenate([np.stack([chain[:-1], chain[1:]], axis=1) for chain in chains])
    owner = np.repeat(np.array(some), [len(chain) - 1 for chain in chains])
    keep = np.any(segments[:, 0] != segments[:, 1], axis=1)
    return segments[keep], owner[keep]


def _extended(
    curves: Sequence[Curve], some: Sequence[int], ends: _Ends, reach: float
) -> list[Curve]:
    """Curves of which ends are moved the shortest way along their own line to one of some."""
    segments, _ = _segments_of(curves, some)
    pairs = points_near_segments(ends.point, segments, 2.0 * reach)
    along = ends.along[pairs.point]
    start, end = segments[pairs.segment].transpose(1, 0, 2)
    length = np.linalg.norm(end - start, axis=1)
    over = (end - start) / length[:, None]
    arm = start - ends.point[pairs.point]
    sine = along[:, 0] * over[:, 1] - along[:, 1] * over[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel lines
        ways = (arm[:, 0] * over[:, 1] - arm[:, 1] * over[:, 0]) / sine
        at = (arm[:, 0] * along[:, 1] - arm[:, 1] * along[:, 0]) / sine
    keep = (np.abs(sine) >= STEEP) & (np.abs(ways) <= reach) & (at >= -reach)
    keep &= (at <= length + reach) & (ways > -SHORTER * ends.length[pairs.point])
    ways = ways[keep]
    order = np.argsort(np.abs(ways), kind="stable")
    point, first = np.unique(pairs.point[keep][order], return_index=True)
    way = np.zeros(len(ends.point))
    way[point] = ways[order][first]
    points = ends.point + way[:, None] * ends.along
    return ends.moved(curves, points, ends.angle * (1.0 + way / ends.length))
