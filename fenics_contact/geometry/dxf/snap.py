"""Ends of lines that miss what they should meet: moved along their own line to where they meet it.

An end of an open curve goes along its last piece to the nearest place where that meets another
curve. An end that still hangs in the air goes to another end or to the corner of a polyline near
it. Ends on other lines stay: if they went to each other, their lines would end beside those.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fenics_contact.geometry.dxf.chords import finely_divided
from fenics_contact.geometry.dxf.reader import Curve
from fenics_contact.geometry.planar_cells import Array, Flags, Indices, connected
from fenics_contact.geometry.point_pairs import points_near_segments

#: Least sine of the angle at which two lines meet: below it they run beside each other.
STEEP = 0.1
#: Part of its last piece by which a line may become shorter.
SHORTER = 0.9
#: Part of the reach within which an end lies on a line that it was moved to; arcs are chords here.
ON_LINE = 0.1


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


def snapped_curves(curves: Sequence[Curve], some: Sequence[int], reach: float) -> list[Curve]:
    """Curves of which ends of some meet each other.

    Args:
        curves: All curves.
        some: Numbers of those that are lines of the structure.
        reach: Largest way of an end along its line, and distance within which ends become one.
    """
    found = _extended(curves, some, _ends_of(curves, some), reach)
    ends = _ends_of(found, some)
    hanging = _hanging(found, some, ends, ON_LINE * reach)
    corners = [curves[k].ends if curves[k].closed else curves[k].ends[1:-1] for k in some]
    fixed = np.concatenate([ends.point[~hanging], *corners])
    points = ends.point.copy()
    points[hanging] = _joined(points[hanging], fixed, ends.angle[hanging] != 0.0, reach)
    found = _with_ends(found, ends, points, ends.angle)
    ends = _ends_of(found, some)
    touching = _Ends(*(getattr(ends, item.name)[~hanging] for item in fields(ends)))
    return _extended(found, some, touching, reach)  # on lines that have turned a little


def _extended(
    curves: Sequence[Curve], some: Sequence[int], ends: _Ends, reach: float
) -> list[Curve]:
    """Curves of which ends are moved along their own line to where they meet one of some."""
    way = _ways(ends, _segments_of(curves, some)[0], reach)
    points = ends.point + way[:, None] * ends.along
    return _with_ends(curves, ends, points, ends.angle * (1.0 + way / ends.length))


def _hanging(curves: Sequence[Curve], some: Sequence[int], ends: _Ends, near: float) -> Flags:
    """Which ends of some curves lie on no other curve but along it, shape (ends,)."""
    segments, owner = _segments_of(curves, some)
    pairs = points_near_segments(ends.point, segments, near)
    hangs = np.ones(len(ends.curve), dtype=bool)
    along = ends.along[pairs.point]
    over = np.diff(segments[pairs.segment], axis=1)[:, 0]
    sine = np.abs(along[:, 0] * over[:, 1] - along[:, 1] * over[:, 0]) / np.hypot(*over.T)
    other = ends.curve[pairs.point] != owner[pairs.segment]
    hangs[pairs.point[other & (sine >= STEEP)]] = False
    return hangs


def _with_ends(curves: Sequence[Curve], ends: _Ends, new: Array, angle: Array) -> list[Curve]:
    """Curves with new places of their ends, and angles of their last pieces."""
    found = list(curves)
    bulge = np.tan(0.25 * angle)
    for k, number in enumerate(ends.curve.tolist()):
        points = found[number].points.copy()
        bulges = found[number].bulges.copy()
        points[-1 if ends.last[k] else 0] = new[k]
        bulges[len(points) - 2 if ends.last[k] else 0] = bulge[k] if ends.last[k] else -bulge[k]
        found[number] = replace(found[number], points=points, bulges=bulges)
    return found


def _ends_of(curves: Sequence[Curve], some: Sequence[int]) -> _Ends:
    """Ends of the open ones of some curves."""
    rows = []
    for k in some:
        points, bulges = curves[k].points, curves[k].bulges
        if not curves[k].closed:
            rows.append((k, 0, *points[1], *points[0], -bulges[0]))
            rows.append((k, 1, *points[-2], *points[-1], bulges[len(points) - 2]))
    table = np.array(rows).reshape(-1, 7)
    chord = table[:, 4:6] - table[:, 2:4]
    table, chord = (rows[np.any(chord != 0.0, axis=1)] for rows in (table, chord))
    half = 2.0 * np.arctan(table[:, 6])
    direction = np.exp(1j * half) * (chord @ [1.0, 1j])
    along = np.column_stack([direction.real, direction.imag]) / np.abs(direction)[:, None]
    length = np.abs(direction) / np.sinc(half / np.pi)
    number = table[:, 0].astype(np.int64)
    return _Ends(number, table[:, 1] > 0.0, table[:, 4:6], along, length, 2.0 * half)


def _segments_of(curves: Sequence[Curve], some: Sequence[int]) -> tuple[Array, Indices]:
    """Straight pieces of some curves, short chords of their arcs, (n, 2, 2), and their curves."""
    chains = [finely_divided(curves[k]) for k in some]
    segments = np.concatenate([np.stack([chain[:-1], chain[1:]], axis=1) for chain in chains])
    owner = np.repeat(np.array(some), [len(chain) - 1 for chain in chains])
    keep = np.any(segments[:, 0] != segments[:, 1], axis=1)
    return segments[keep], owner[keep]


def _ways(ends: _Ends, segments: Array, reach: float) -> Array:
    """Shortest way along its own line from every end to another curve, 0 if none is near."""
    pairs = points_near_segments(ends.point, segments, 2.0 * reach)
    along = ends.along[pairs.point]
    start, end = segments[pairs.segment].transpose(1, 0, 2)
    length = np.linalg.norm(end - start, axis=1)
    over = (end - start) / length[:, None]
    arm = start - ends.point[pairs.point]
    sine = along[:, 0] * over[:, 1] - along[:, 1] * over[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel lines
        way = (arm[:, 0] * over[:, 1] - arm[:, 1] * over[:, 0]) / sine
        at = (arm[:, 0] * along[:, 1] - arm[:, 1] * along[:, 0]) / sine
    keep = (np.abs(sine) >= STEEP) & (np.abs(way) <= reach) & (at >= -reach)
    keep &= (at <= length + reach) & (way > -SHORTER * ends.length[pairs.point])
    way = way[keep]
    order = np.argsort(np.abs(way), kind="stable")
    point, first = np.unique(pairs.point[keep][order], return_index=True)
    found = np.zeros(len(ends.point))
    found[point] = way[order][first]
    return found


def _joined(points: Array, fixed: Array, on_arc: Flags, reach: float) -> Array:
    """Ends with one place for those near each other: a fixed one, an arc's end or the middle one.

    Args:
        points: The ends, shape (ends, 2).
        fixed: Points that stay, shape (points, 2).
        on_arc: Which ends are those of arcs, which would become other arcs, shape (ends,).
        reach: Distance within which ends become one.
    """
    from scipy.spatial import cKDTree

    every = np.concatenate([points, fixed])
    rank = np.concatenate([np.where(on_arc, 1, 0), np.full(len(fixed), 2)])
    pairs = cKDTree(every).query_pairs(reach, output_type="ndarray")
    label = connected(pairs[np.any(pairs < len(points), axis=1)], len(every))
    order = np.argsort(label, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        own = members[members < len(points)]
        if len(members) > 1:
            some = members[rank[members] == rank[members].max()]
            off = np.linalg.norm(every[some] - every[own].mean(axis=0), axis=1)
            every[own] = every[some[np.argmin(off)]]
    return every[: len(points)]
