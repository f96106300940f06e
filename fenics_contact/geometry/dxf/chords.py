"""Curves as chains of chords, the same for all curves that share an arc.

An arc of bulge b between two points at the distance c has the radius c (1 + b^2) / (4 |b|) and the
angle 4 arctan b. Every arc has corners where other curves end on it, and between two corners chords
of at most `ANGLE`. The first arc between two corners gives its chords to all others between them,
so that two blocks have the same chords wherever they share an arc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fenics_contact.geometry.dxf.reader import Curve
from fenics_contact.geometry.planar_cells import Array, Flags, Indices
from fenics_contact.geometry.point_pairs import points_near_segments, snapped

#: Largest angle of a chord, radians; it leaves the arc by 0.1 % of the radius.
ANGLE = np.radians(5.0)
#: Part by which `ANGLE` may be exceeded: angles of arcs with bulges of few digits are not round.
ROUND = 0.01
#: Distance from an arc within which a point lies on it, over the largest distance of its chords.
#: Bulges written with four digits are that exact.
ON_ARC = 0.2


@dataclass(frozen=True)
class _Arc:
    """Part of a circle from one point to another, with the bulge of DXF."""

    start: Array
    end: Array
    bulge: float

    @property
    def angle(self) -> float:
        """Angle at the centre, radians, positive anticlockwise."""
        return 4.0 * float(np.arctan(self.bulge))

    @property
    def centre(self) -> Array:
        """Centre of the circle, shape (2,)."""
        along = self.end - self.start
        across = np.array([-along[1], along[0]])
        return 0.5 * (self.start + self.end + across / np.tan(0.5 * self.angle))

    def points(self, parts: Array) -> Array:
        """Points at parts of the way from start (0) to end (1), shape (parts, 2)."""
        centre = self.centre
        arm = self.start - centre
        turn = self.angle * parts[:, None]
        return centre + np.cos(turn) * arm + np.sin(turn) * np.array([-arm[1], arm[0]])

    def places(self, points: Array, near: float) -> tuple[Indices, Array]:
        """Which points lie on the arc between its ends, and at which parts of its way, in order."""
        centre = self.centre
        arm = self.start - centre
        radius = float(np.linalg.norm(arm))
        leaves = radius * (1.0 - np.cos(0.5 * min(abs(self.angle), ANGLE)))
        off = np.abs(np.linalg.norm(points - centre, axis=1) - radius)
        on = np.flatnonzero(off <= max(near, ON_ARC * leaves))
        turn = np.arctan2(*(points[on] - centre).T[::-1]) - np.arctan2(arm[1], arm[0])
        part = (np.sign(self.bulge) * turn) % (2.0 * np.pi) / abs(self.angle)
        least = 1.5 * near / (radius * abs(self.angle))
        inside = (part > least) & (part < 1.0 - least)
        order = np.argsort(part[inside])
        return on[inside][order], part[inside][order]


def chains_of_chords(curves: Sequence[Curve], near: float) -> list[Array]:
    """Corners of every curve, arcs divided, each of shape (corners, 2); closed ones end apart.

    Args:
        curves: The curves.
        near: Distance within which points are the same, in their unit.
    """
    if not any(curve.smooth or np.any(curve.bulges) for curve in curves):
        return [curve.points for curve in curves]
    ends = np.unique(snapped(np.concatenate([curve.ends for curve in curves]), near), axis=0)
    shared: dict[tuple[int, int, bool], Array] = {}
    return [
        _smooth_chain(curve, ends, near) if curve.smooth else _chain(curve, ends, near, shared)
        for curve in curves
    ]


def _chain(
    curve: Curve, ends: Array, near: float, shared: dict[tuple[int, int, bool], Array]
) -> Array:
    """Corners of a curve with arcs; `shared` are the chords between two of `ends`."""
    pieces = []
    following = np.roll(curve.points, -1, axis=0)
    last = len(curve.points) - 1
    for k, (start, end) in enumerate(zip(curve.points, following, strict=True)):
        pieces.append(start[None])
        bulge = float(curve.bulges[k])
        sagitta = 0.5 * abs(bulge) * float(np.linalg.norm(end - start))
        if sagitta > near and (curve.closed or k < last):
            pieces.append(_divided(_Arc(start, end, bulge), ends, near, shared))
    return np.concatenate(pieces)


def as_ring(curve: Curve, chain: Array) -> Array:
    """Corners of a curve, the first again at the end if it is closed."""
    return np.concatenate([chain, chain[:1]]) if curve.closed else chain


def finely_divided(curve: Curve) -> Array:
    """Points along a curve, its arcs in chords of a fifth of `ANGLE`; closed ones end as begun."""
    points = as_ring(curve, curve.points)
    rows = [points[:1]]
    for (start, end), bulge in zip(pairwise(points), curve.bulges.tolist(), strict=False):
        if bulge != 0.0 and np.any(start != end):
            arc = _Arc(start, end, bulge)
            count = int(np.ceil(5.0 * abs(arc.angle) / ANGLE))
            rows.append(arc.points(np.arange(1, count) / count))
        rows.append(end[None])
    return np.concatenate(rows)


def _divided(
    arc: _Arc, ends: Array, near: float, shared: dict[tuple[int, int, bool], Array]
) -> Array:
    """Corners between the ends of an arc, shape (corners, 2)."""
    on, part = arc.places(ends, near)
    first, last = (int(np.argmin(np.sum((ends - p) ** 2, axis=1))) for p in (arc.start, arc.end))
    corners = [first, *on.tolist(), last]
    parts = [0.0, *part.tolist(), 1.0]
    rows = []
    for k in range(len(corners) - 1):
        rows.append(ends[corners[k]][None])
        forward = (corners[k], corners[k + 1], arc.bulge > 0.0)
        backward = (corners[k + 1], corners[k], arc.bulge < 0.0)
        if forward not in shared:
            width = parts[k + 1] - parts[k]
            count = max(1, int(np.ceil(width * abs(arc.angle) / ANGLE - ROUND)))
            bulge = float(np.tan(0.25 * width * arc.angle))
            piece = _Arc(ends[corners[k]], ends[corners[k + 1]], bulge)
            shared[forward] = piece.points(np.arange(1, count) / count)
            shared[backward] = shared[forward][::-1]
        rows.append(shared[forward])
    return np.concatenate(rows)[1:]


def _smooth_chain(curve: Curve, ends: Array, near: float) -> Array:
    """Chords of an ellipse or spline, with corners where other curves end on it."""
    points = np.concatenate([curve.points, curve.points[:1]]) if curve.closed else curve.points
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
    far = np.ones(len(points), dtype=bool)
    far[~keep] = (
        np.linalg.norm(points[~keep, None] - corners, axis=2).min(axis=1, initial=np.inf) > near
    )
    chain = thinned(points[far], keep[far])
    return chain[:-1] if curve.closed else chain


def thinned(points: Array, keep: Flags) -> Array:
    """Points of a smooth chain, at least one for every `ANGLE` of its turn, and those to keep."""
    along = np.diff(points, axis=0)
    cross = along[:-1, 0] * along[1:, 1] - along[:-1, 1] * along[1:, 0]
    turn = np.abs(np.arctan2(cross, np.sum(along[:-1] * along[1:], axis=1)))
    turned = np.concatenate([[0.0], np.cumsum(turn), [turn.sum()]])
    fixed = np.unique([0, *np.flatnonzero(keep).tolist(), len(points) - 1])
    chosen = [fixed]
    for start, end in pairwise(fixed.tolist()):
        total = turned[end] - turned[start]
        count = max(1, int(np.ceil(total / ANGLE - ROUND)))
        wanted = turned[start] + total * np.arange(1, count) / count
        at = np.searchsorted(turned[start:end], wanted) + start
        chosen.append(np.clip(at, start, end))
    return points[np.unique(np.concatenate(chosen))]
