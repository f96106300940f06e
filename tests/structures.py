"""Structures as people draw them: a facade from a DXF file, and walls that are no rectangles."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial import Voronoi, cKDTree

from fenics_contact.builders import bridge
from fenics_contact.drawing import Drawing, read_dxf

#: Two storeys of 383 stones of several sizes, with windows, lintels, an arched door, a buttress.
FACADE = Path(__file__).resolve().parents[1] / "meshes" / "facade.dxf"

#: Corners of rubble that are closer than this to each other, stones being of size 1, are one.
NEAR = 0.15


@cache
def facade() -> Drawing:
    """The facade, m; it stands on "base"."""
    return read_dxf(FACADE).drawing


@cache
def arch_wall() -> Drawing:
    """A segmental arch of 17 voussoirs in a wall with a parapet."""
    return bridge(3.0, 1.0, 0.35, 17, pier=(1.2, 2.0), cover=0.5, parapet=0.5)


def gable(bricks: int = 8, courses: int = 11) -> list[list[float]]:
    """Courses of a wall in running bond below a stepped gable, for `meshing.wall`."""
    rows = ([1.0] * bricks, [0.5] + [1.0] * (bricks - 1) + [0.5])
    steps = [[-0.5 * (bricks - n)] + [1.0] * n + [-0.5 * (bricks - n)] for n in range(bricks)]
    return [rows[level % 2] for level in range(courses)] + steps[:0:-1]


@cache
def rubble(columns: int = 20, courses: int = 15, seed: int = 1) -> Drawing:
    """Stones of all shapes, about 0.4 m x 0.25 m: what is nearest to points shaken out of rows."""
    random, block = np.random.default_rng(seed), np.array([0.4, 0.25])
    column, course = (index.ravel() for index in np.indices((columns, courses)))
    places = np.column_stack([column + 0.25 + 0.5 * (course % 2), course + 0.5])
    places = places + random.uniform(-0.2, 0.2, places.shape)
    size = np.array([columns, courses], dtype=float)
    mirrors = [places * [-1, 1], places * [1, -1]]
    mirrors += [mirror + 2.0 * size * (mirror < 0.0).any(axis=0) for mirror in mirrors]
    cells = Voronoi(np.concatenate([places, *mirrors]))
    corners = _merged(cells.vertices, size)
    blocks = []
    for region in cells.point_region[: len(places)]:
        ring = corners[cells.regions[region]]
        ring = ring[np.any(ring != np.roll(ring, 1, axis=0), axis=1)]
        blocks.append(ring * block)
    width = float(size[0] * block[0])
    base = [((0.0, 0.0), (width, 0.0))]
    return Drawing(blocks, ["stones"] * len(blocks), {"base": base})


def _merged(corners: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Corners of which those near each other are one, with those on the outline kept on it."""
    corners = np.where(np.abs(corners) < 1e-9, 0.0, corners)
    corners = np.where(np.abs(corners - size) < 1e-9, size, corners)
    merged = corners.copy()
    for first, second in sorted(cKDTree(corners).query_pairs(NEAR)):
        outside = (corners[second] == 0.0) | (corners[second] == size)
        place = np.where(outside, merged[second], merged[first])
        same = np.all(merged == merged[second], axis=1) | np.all(merged == merged[first], axis=1)
        merged[same] = place
    return merged
