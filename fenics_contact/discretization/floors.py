"""Floors and roofs: the sides of blocks that they lie on."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fenics_contact.discretization.facets import CLOSED, Boundary
from fenics_contact.discretization.strips import Strips
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.scene.scene import Floor, Scene

#: Parts of facets, and of normals, below this are rounding.
NOTHING = 1e-9


def upward(body: tuple[float, float]) -> Array:
    """Unit vector against a body force; along y where there is none."""
    size = math.hypot(*body)
    return -np.array(body) / size if size > 0.0 else np.array([0.0, 1.0])


def floor_strips(scene: Scene, boundary: Boundary) -> Mapping[str, Strips]:
    """The top sides that every floor lies on.

    Raises:
        InputError: If a floor lies on none, or on sides inside a block.
    """
    found = {}
    looks_up = boundary.normal @ upward(scene.dead.body) > NOTHING
    gap = max((law.gap for law in scene.joints.values()), default=0.0)
    for name, floor in scene.floors.items():
        mine = looks_up if floor.at is None else looks_up & (boundary.role([floor.at]) == 0)
        strips = _between(boundary, mine, floor.x or (-np.inf, np.inf))
        found[name] = strips if floor.y is None else _at_height(boundary, strips, floor.y, gap)
        if len(found[name].facets) == 0:
            raise InputError(f"floors.{name}.{_missed(boundary, strips, floor)}")
    return found


def _between(boundary: Boundary, mine: Flags, x: tuple[float, float]) -> Strips:
    """Parts of some facets between two places x."""
    first, second = boundary.points[:, :2, 0].T
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.array(x) - first[:, None]) / (second - first)[:, None]
    start, end = np.clip(np.sort(ends, axis=1), 0.0, 1.0).T
    rows = np.flatnonzero(mine & (end - start > NOTHING))
    return Strips(rows, start[rows], end[rows])


def _at_height(boundary: Boundary, strips: Strips, y: float, gap: float) -> Strips:
    """Those at a height, or at the highest level below it within a gap of joints."""
    near = CLOSED * boundary.length[strips.facets, None]
    height = boundary.points[strips.facets, :2, 1]
    under = np.all((height <= y + near) & (height >= y - gap - near), axis=1)
    top = height[under].max(initial=-np.inf)
    return strips.take(under & np.all(height >= top - near, axis=1))


def _missed(boundary: Boundary, strips: Strips, floor: Floor) -> str:
    """That there is nothing below a floor, and what to do."""
    if floor.y is None:
        return f"at = '{floor.at}': no side of this group looks up; name top sides"
    height = boundary.points[strips.facets, :2, 1].ravel()
    missed = f"y = {floor.y:g}: no top side of a block is at this height there"
    if len(height) == 0:
        return f"{missed}; give x where blocks are"
    return f"{missed}; the nearest is at y = {height[np.argmin(np.abs(height - floor.y))]:g}"
