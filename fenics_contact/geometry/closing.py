"""Mortar joints between stones that were drawn one by one, and outlines that close them.

Sides of two stones that face each other at a distance have a common *stretch*. Its middle line
becomes the joint of both. Stretches that follow each other around a stone, across to the next stone
and so on, go around a *pocket*: the cross of bed and head joint is one and becomes a point, which
is nearest to the middle lines that end there. Others are openings and the outside: their outline
stays, and joints end halfway between the corners of the two stones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fenics_contact.errors import checked
from fenics_contact.geometry.meshing import default_size
from fenics_contact.geometry.outlines import (
    COINCIDENT,
    Polygons,
    inside_outlines,
    outline_area,
    points_near_segments,
    sides_of_outlines,
)
from fenics_contact.geometry.planar_cells import Array, Flags, Indices, connected, near_pairs

# What a mortar joint is.
#: Largest thickness over the side of a square of the blocks' mean area; bricks of 250 mm x 65 mm
#: with joints of 15 mm have 0.12. FEW: likewise, where fewer are open.
REACH = 0.25
FEW = 0.06
#: Largest thickness over the most frequent one.
WIDE = 2.5
#: Part of the length of all joints from which open ones are mortar.
SHARE = 0.2
#: Part by which thicknesses that count as the same differ.
ALIKE = 0.1
#: Cosine of the largest angle between sides.
FACING = float(np.cos(np.radians(30.0)))
#: Length over thickness from which sides face each other.
SHORT = 0.5
#: Largest width of a pocket that becomes a point, over the thickness.
POCKET = 4.0
#: Distance over the thickness within which a joint on the outline ends at a corner.
CORNER = 2.0
#: Part of the thickness by which corners between joint and outline may be off.
STRAIGHT = 0.05
#: Part of the largest eigenvalue below which middle lines do not cross.
PARALLEL = 0.05


@dataclass(frozen=True)
class Mortar:
    """Stretches of joints between stones, and how thick they are.

    The ends of a stretch are in the order of its first stone's outline, anticlockwise.

    Attributes:
        outlines: Corners of the stones, anticlockwise, m.
        near: Distance within which stones touch, m.
        blocks: Both stones, the one with the lower number first, shape (stretches, 2).
        points: By stone and end, shape (stretches, 2, 2, 2).
        place: The same points as places on the outlines: number of the side, counted through all
            stones, and part of its length, shape (stretches, 2, 2).
        gap: Thickness at both ends, shape (stretches, 2).
    """

    outlines: Polygons
    near: float
    blocks: Indices
    points: Array
    place: Array
    gap: Array

    @classmethod
    def of(cls, outlines: Polygons) -> Mortar:
        """Stretches of joints between outlines, each of shape (corners, 2), either way round."""
        size = 4.0 * default_size(outlines)
        outlines = [o if outline_area(o) >= 0.0 else o[::-1] for o in outlines]
        near = COINCIDENT * float(np.ptp(np.concatenate(outlines), axis=0).max())
        every = cls(outlines, near, *_stretches(outlines, near, REACH * size))
        # No third stone may lie between the sides of a stretch: points across its middle.
        first, second = every.points.mean(axis=2).transpose(1, 0, 2)
        points = np.concatenate([first + at * (second - first) for at in (0.25, 0.5, 0.75)])
        between = (inside_outlines(points, outlines) >= 0).reshape(3, -1).any(axis=0)
        every = every._only((every.thickness <= 4.0 * near) | ~between)
        if every.length[every.open].sum() < SHARE * every.length.sum():
            every = every._only(every.thickness <= FEW * size)
        return every._only(every.thickness <= WIDE * every.usual + near)

    def _only(self, some: Flags) -> Mortar:
        arrays = "blocks", "points", "place", "gap"
        return replace(self, **{name: getattr(self, name)[some] for name in arrays})

    @cached_property
    def thickness(self) -> Array:
        """Mean thickness of every stretch, m; 0 where the stones touch."""
        return self.gap.mean(axis=1)

    @cached_property
    def length(self) -> Array:
        """Length of every stretch, m."""
        return np.linalg.norm(self.points[:, 0, 1] - self.points[:, 0, 0], axis=1)

    @cached_property
    def open(self) -> Indices:
        """Stretches along which the stones do not touch, the thinnest first."""
        order = np.argsort(self.thickness)
        return order[self.thickness[order] > self.near]

    @cached_property
    def usual(self) -> float:
        """Thickness of most open joints by their length, m; 0 if there are none."""
        if not len(self.open):
            return 0.0
        size = self.thickness[self.open]
        length = self.length[self.open]
        _, like = np.unique(np.round(np.log(size) / ALIKE), return_inverse=True)
        most = like == np.argmax(np.bincount(like, length))
        return float(np.average(size[most], weights=length[most]))

    @property
    def range(self) -> Array:
        """Thickness that nine tenths of the open joints are between, m, shape (2,); 0 if none."""
        if not len(self.open):
            return np.zeros(2)
        part = np.cumsum(self.length[self.open])
        return self.thickness[self.open][np.searchsorted(part, (0.05 * part[-1], 0.95 * part[-1]))]

    def said(self, scale: float, unit: str) -> str:
        """The thickness in a unit of `scale` m, for people; empty if there is none."""
        low, usual, high = (f"{t / scale:.3g}" for t in (self.range[0], self.usual, self.range[1]))
        if not self.usual:
            return ""
        return f"{usual} {unit}" + ("" if low == high else f" ({low} to {high} {unit})")


@checked
def closed_joints(outlines: Polygons) -> Polygons:
    """Outlines of stones drawn one by one, grown to the middle of the joints between them.

    Sides that face another stone move, with at most 30 degrees between them and no further apart
    than mortar joints are thick; the outline of the whole and of openings stays.

    Args:
        outlines: Corners of every stone in order, either way round, each of shape (corners, 2), m.

    Raises:
        InputError: If there is no stone, or one has no corners (x, y).
    """
    return ClosedJoints(Mortar.of([np.asarray(outline, float) for outline in outlines])).outlines


def _stretches(
    outlines: Polygons, near: float, reach: float
) -> tuple[Indices, Array, Array, Array]:
    """The arrays of `Mortar`, of sides that face each other within reach."""
    ends = sides_of_outlines(outlines)
    owner = np.repeat(np.arange(len(outlines)), [len(outline) for outline in outlines])
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    unit = along / np.where(length > 0.0, length, 1.0)[:, None]
    every = np.flatnonzero(length > near)
    pairs = [np.zeros((2, 0), dtype=np.int64)]
    for one, other in near_pairs(ends.mean(axis=1), 0.5 * (length + reach), every, every):
        facing = -np.sum(unit[one] * unit[other], axis=1) > FACING
        pairs.append(np.stack([one, other])[:, facing & (owner[one] < owner[other])])
    sides = np.hstack(pairs)
    way = unit[sides[0]] - unit[sides[1]]
    way /= np.linalg.norm(way, axis=1)[:, None]
    # By stone and end, in the order of the first stone; the second one runs back.
    corners = np.stack([ends[sides[0]], ends[sides[1], ::-1]], axis=1)
    at = np.einsum("nsek,nk->nse", corners, way)
    span = np.stack([at[:, :, 0].max(axis=1), at[:, :, 1].min(axis=1)], axis=1)
    part = (span[:, None] - at[:, :, :1]) / (at[:, :, 1:] - at[:, :, :1])
    points = corners[:, :, :1] + part[..., None] * (corners[:, :, 1:] - corners[:, :, :1])
    outward = np.stack([way[:, 1], -way[:, 0]], axis=1)
    gap = np.einsum("nek,nk->ne", points[:, 1] - points[:, 0], outward)
    keep = (gap.mean(axis=1) <= reach) & (gap.min(axis=1) >= -near)
    shortest = np.maximum(10.0 * near, SHORT * gap.mean(axis=1))
    keep &= span[:, 1] - span[:, 0] > shortest
    part[:, 1] = 1.0 - part[:, 1]
    place = sides.T[:, :, None] + part
    return owner[sides.T][keep], points[keep], place[keep], np.maximum(gap[keep], 0.0)


class ClosedJoints:
    """Outlines that have grown to the middle of their joints.

    A *turn* is an end of a stretch, where one of its stones leaves it, anticlockwise, and the other
    comes to it: turn 2 k + s where stone s of stretch k leaves. The turns around a pocket follow
    each other: along the outline to the next stretch, and across to its other stone.

    Attributes:
        outlines: Corners of the stones, m, in the order in which they were given.
    """

    def __init__(self, mortar: Mortar) -> None:
        """Close the joints that were found."""
        self._mortar = mortar
        self._count = 2 * len(mortar.blocks)
        turns = np.arange(self._count)
        self._stretch, side = np.divmod(turns, 2)
        self._gap = mortar.gap[self._stretch, 1 - side]
        own = [np.stack([side, 1 - side], axis=1), self._stretch[:, None], side[:, None]]
        self._place = mortar.place[own[1], own[2], own[0]]  # where its stone comes and leaves
        self._own = mortar.points[own[1], own[2], own[0]]
        stone = mortar.blocks.ravel()
        order = np.lexsort([self._place.mean(axis=1), stone])
        around = np.split(order, np.flatnonzero(np.diff(stone[order])) + 1)
        self._around = {int(stone[some[0]]): some for some in around if len(some)}
        self._after = np.empty(self._count, dtype=np.int64)
        for some in self._around.values():
            self._after[some] = np.roll(some, -1)
        self._before = np.argsort(self._after)
        self._first = np.cumsum([0, *map(len, mortar.outlines)])
        self._paths = [self._path(turn) for turn in range(self._count)]
        self._pocket = connected(np.column_stack([turns, self._after ^ 1]), self._count)
        self._is_point, self._joint = self._joints()
        self._kept = self._without_flat_joints()
        self.outlines = [self._grown(stone) for stone in range(len(mortar.outlines))]

    def _path(self, turn: int) -> Array:
        """Own outline from a turn to the next stretch, shape (points, 2).

        Where a corner is near an end of that stretch, the path ends there.
        """
        mortar = self._mortar
        after = self._after[turn]
        stone = mortar.blocks.ravel()[turn]
        first = self._first[stone]
        outline = mortar.outlines[stone]
        end = self._place[after, 0]
        if self._place[turn].mean() >= self._place[after].mean():
            end += len(outline)
        between = np.arange(np.ceil(self._place[turn, 1]), np.floor(end) + 1.0).astype(np.int64)
        path = [self._own[turn, 1], *outline[(between - first) % len(outline)], self._own[after, 0]]
        for k, reach in ((0, self._gap[turn]), (len(path) - 1, self._gap[after ^ 1])):
            corner = path[1] if k == 0 else path[-2]
            away = np.hypot(*(corner - path[k]))
            if len(between) and away <= CORNER * reach + mortar.near:
                path[k] = corner
        return _without_twins(np.array(path))

    def _joints(self) -> tuple[Flags, Array]:
        """Which turns are at pockets that become points, and where joints end at every turn."""
        mortar = self._mortar
        middle = mortar.points.mean(axis=1)[self._stretch, 1 - np.arange(self._count) % 2]
        points = np.concatenate([middle, *self._paths])
        lengths = [len(path) for path in self._paths]
        label = np.concatenate([self._pocket, np.repeat(self._pocket, lengths)])
        count = int(self._pocket.max(initial=-1)) + 1
        box = np.array([np.full((count, 2), np.inf), np.full((count, 2), -np.inf)])
        thick = np.zeros(count)
        np.maximum.at(thick, self._pocket, self._gap)
        np.minimum.at(box[0], label, points)
        np.maximum.at(box[1], label, points)
        width = np.ptp(box, axis=0).max(axis=1)
        along = np.diff(mortar.points.mean(axis=1), axis=1)[:, 0][self._stretch]
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        # The point nearest to the middle lines of every pocket.
        centre = np.zeros((count, 2))
        np.add.at(centre, self._pocket, middle)
        centre /= np.bincount(self._pocket, minlength=count)[:, None]
        matrix = np.zeros((count, 2, 2))
        np.add.at(matrix, self._pocket, normal[:, :, None] * normal[:, None])
        right = np.zeros((count, 2))
        off = np.sum(normal * (middle - centre[self._pocket]), axis=1)
        np.add.at(right, self._pocket, normal * off[:, None])
        inverse = np.linalg.pinv(matrix, rcond=PARALLEL, hermitian=True)
        way = np.einsum("nij,nj->ni", inverse, right)
        crossing = centre + way * (np.linalg.norm(way, axis=1) <= width)[:, None]
        # A point that is not between the sides of all its stretches would cut into stones.
        aside = np.abs(np.sum(normal * (crossing[self._pocket] - middle), axis=1))
        outside = self._pocket[aside > 0.5 * self._gap + 10.0 * mortar.near]
        is_point = width <= POCKET * thick + 10.0 * mortar.near
        is_point[outside] = False
        starts = np.array([path[0] for path in self._paths]).reshape(-1, 2)
        before = self._before[np.arange(self._count) ^ 1]
        ends = np.array([self._paths[k][-1] for k in before]).reshape(-1, 2)
        of_turn = is_point[self._pocket]
        return of_turn, np.where(of_turn[:, None], crossing[self._pocket], 0.5 * (starts + ends))

    def _without_flat_joints(self) -> Flags:
        """Turns whose points stay: not those along one joint that is almost straight there."""
        from shapely.geometry import LineString

        inner = self._is_point & (np.bincount(self._pocket)[self._pocket] == 2)
        kept = np.ones(self._count, dtype=bool)
        for turn in np.flatnonzero(
            inner & ~inner[self._before] & (np.arange(self._count) % 2 == 0)
        ).tolist():
            chain = [turn ^ 1, turn]
            while inner[chain[-1]]:
                chain.append(int(self._after[chain[-1]]))
            line = LineString(self._joint[chain].tolist())
            corners = set(line.simplify(STRAIGHT * self._gap[turn]).coords)
            flat = [k for k in chain[1:-1] if tuple(self._joint[k]) not in corners]
            kept[np.isin(self._pocket, self._pocket[flat])] = False
        return kept

    def _grown(self, stone: int) -> Array:
        """Outline of a stone."""
        if stone not in self._around:
            return self._mortar.outlines[stone]
        rows: list[Array] = []
        for turn in self._around[stone].tolist():
            rows += [self._joint[k] for k in (turn ^ 1, turn) if self._kept[k]]
            if self._is_point[turn]:
                continue
            # Corners of the stone's own outline from here to the next stretch.
            following = self._after[turn]
            own = [self._joint[turn], *self._paths[turn], self._joint[following ^ 1]]
            for at, gap in ((1, self._gap[turn]), (-2, self._gap[following ^ 1])):
                if len(own) > 2 and _off(*own[at - 1 : at + 2 or None]) <= STRAIGHT * gap:
                    del own[at]
            rows += own[1:-1]
        outline = _without_twins(np.array(rows))
        return outline[1:] if np.array_equal(outline[0], outline[-1]) else outline

    def moved(self, points: Array) -> Array:
        """Points, shape (points, 2), of which those on stretches are where these have moved."""
        pairs = points_near_segments(points, self._own, self._mortar.near)
        at = np.clip(pairs.at, 0.0, 1.0)[:, None]
        found = points.copy()
        starts = self._joint[pairs.segment ^ 1]
        found[pairs.point] = starts + at * (self._joint[pairs.segment] - starts)
        return found


def _without_twins(points: Array) -> Array:
    """Points without those that are the one before."""
    return points[np.any(np.diff(points, axis=0, prepend=np.nan) != 0.0, axis=1)]


def _off(start: Array, point: Array, end: Array) -> float:
    """Distance of a point from the line between two others; 0 where these are one."""
    along = end - start
    arm = point - start
    return abs(along[0] * arm[1] - along[1] * arm[0]) / max(np.hypot(*along), 1e-300)
