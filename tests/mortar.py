"""Drawings of brickwork with mortar between the bricks, each a closed polyline with bulges."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

#: Points (x, y, bulge) of a closed polyline, and its layer.
Stone = tuple[npt.NDArray[np.float64], str]


@dataclass(frozen=True)
class Facade:
    """A wall of bricks in running bond with windows under rings of voussoirs.

    Attributes:
        columns: Whole bricks in a course.
        courses: Their number, one above the other.
        brick: Length and height, m.
        joint: Thickness of the mortar, m.
        windows: Middle, sill and springing, m, and the radius of the arch, m, of every window.
        voussoirs: In every ring.
        ring: Thickness of the rings, m.
    """

    columns: int = 30
    courses: int = 51
    brick: tuple[float, float] = (0.25, 0.065)
    joint: float = 0.01
    windows: tuple[tuple[float, float, float, float], ...] = (
        (1.95, 0.75, 1.8, 0.5),
        (5.85, 0.75, 1.8, 0.5),
    )
    voussoirs: int = 25
    ring: float = 0.25

    @property
    def width(self) -> float:
        """Of the whole, m."""
        return self.columns * (self.brick[0] + self.joint) - self.joint

    @property
    def height(self) -> float:
        """Of the whole, m."""
        return self.courses * (self.brick[1] + self.joint) - self.joint

    def stones(self) -> list[Stone]:
        """All bricks and voussoirs."""
        return [*self._bricks(), *self._voussoirs()]

    def _bricks(self) -> list[Stone]:
        from shapely.geometry import Point, box

        step = self.brick[0] + self.joint
        taken = [box(x - r, sill, x + r, spring) for x, sill, spring, r in self.windows]
        for x, _, spring, r in self.windows:
            outer = r + self.ring + self.joint
            ring = Point(x, spring).buffer(outer, 90)
            taken.append(
                ring.intersection(box(x - outer, spring - 1e-3, x + outer, spring + outer))
            )
        found: list[Stone] = []
        for course in range(self.courses):
            low = course * (self.brick[1] + self.joint)
            starts = np.arange(self.columns + 1) * step - 0.5 * step * (course % 2)
            for start in starts:
                left = max(start, 0.0)
                right = min(start + self.brick[0], self.width)
                if right - left < 0.02:
                    continue
                stone = box(left, low, right, low + self.brick[1])
                for hole in taken:
                    stone = stone.difference(hole)
                for part in getattr(stone, "geoms", [stone]):
                    if part.area > 0.2 * self.brick[0] * self.brick[1]:
                        corners = np.asarray(part.exterior.coords)[:-1]
                        found.append((np.pad(corners, ((0, 0), (0, 1))), "brick"))
        return found

    def _voussoirs(self) -> list[Stone]:
        found: list[Stone] = []
        for x, _, spring, inner in self.windows:
            outer = inner + self.ring
            angles = np.linspace(0.0, np.pi, self.voussoirs + 1)
            for first, last in pairwise(angles):
                rows = []
                for radius, ends in ((inner, (last, first)), (outer, (first, last))):
                    half = 0.5 * self.joint / radius * np.sign(ends[1] - ends[0])
                    turns = (ends[0] + half, ends[1] - half)
                    bulge = np.tan(0.25 * (turns[1] - turns[0]))
                    for turn, b in zip(turns, (bulge, 0.0), strict=True):
                        rows.append((x + radius * np.cos(turn), spring + radius * np.sin(turn), b))
                found.append((np.array(rows), "voussoir"))
        return found


def rubble(seed: int, stones: int = 60) -> list[npt.NDArray[np.float64]]:
    """Stones of a wall of 2 m x 1.5 m with joints of 8 to 16 mm: cells of random places, shrunk."""
    from scipy.spatial import Voronoi
    from shapely.geometry import Polygon

    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 1.0, (stones, 2)) * [2.0, 1.5]
    mirrored = [places * [-1, 1], places * [1, -1], [4.0, 0.0] + places * [-1, 1]]
    found = Voronoi(np.concatenate([places, *mirrored, [0.0, 3.0] + places * [1, -1]]))
    regions = (found.regions[found.point_region[k]] for k in range(stones))
    shapes = [Polygon(found.vertices[region]) for region in regions]
    shrunk = [shape.buffer(-rng.uniform(0.004, 0.008), join_style=2) for shape in shapes]
    return [np.asarray(s.exterior.coords)[:-1] for s in shrunk if s.area > 5e-3]
