"""Polylines that come back to where they began and go on, as over their first side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from fenics_contact.geometry.dxf.chords import finely_divided
from fenics_contact.geometry.dxf.reader import Curve, Curves
from fenics_contact.geometry.meshing import outline_area
from fenics_contact.geometry.point_pairs import points_near_segments

#: Distance within which a polyline comes back, and runs over itself, over its size; arcs are
#: compared by chords.
BACK = 1e-6
OVER = 1e-4


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
    """A curve up to where it comes back to its start, if it does, and the rest likewise."""
    found = None if curve.closed or curve.smooth else _ring(curve)
    if found is None:
        yield curve
        return
    ring, rest = found
    yield ring
    if len(rest.points) > 1 and not _runs_over(rest, ring):
        yield from _parts(rest)


def _ring(curve: Curve) -> tuple[Curve, Curve] | None:
    """The part of a curve up to where it comes back, if that has an area, and the rest."""
    points, bulges = curve.points, curve.bulges
    near = BACK * float(np.ptp(points, axis=0).max())
    segments = np.stack([points[:-1], points[1:]], axis=1)
    pairs = points_near_segments(points[:1], segments, near)
    at_end = np.linalg.norm(points[pairs.segment + 1] - points[0], axis=1) <= near
    good = (pairs.segment > 0) & (at_end | (bulges[pairs.segment] == 0.0))
    for piece in sorted(pairs.segment[good].tolist()):
        ring = Curve(points[: piece + 1], bulges[: piece + 1], True, curve.layer, curve.kind)
        if abs(outline_area(finely_divided(ring))) > near**2 / BACK:
            on = piece + 1 + int(np.linalg.norm(points[piece + 1] - points[0]) <= near)
            rest = np.concatenate([points[:1], points[on:]])
            return ring, Curve(rest, bulges[on - 1 :], False, curve.layer, curve.kind)
    return None


def _runs_over(rest: Curve, ring: Curve) -> bool:
    """Whether all of a curve lies on a closed one."""
    chain = finely_divided(rest)
    places = np.concatenate([chain, 0.5 * (chain[:-1] + chain[1:])])
    sides = finely_divided(ring)
    reach = OVER * float(np.ptp(ring.points, axis=0).max())
    pairs = points_near_segments(places, np.stack([sides[:-1], sides[1:]], axis=1), reach)
    return len(np.unique(pairs.point)) == len(places)
