"""Rigid ground below blocks that lie on a plane, or nearly do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fenics_contact.errors import require
from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.contacts import APART, NEARLY
from fenics_contact.spatial.edges import FACING, INCLINED
from fenics_contact.spatial.polyhedra import Block, Polyhedron

#: Ground below edges and corners is as wide as their body, seen from above, so many times.
WIDER = 2.0
#: Its lower side, in parts of its upper one: no side of it looks as one of the blocks does.
NARROWER = 0.9


def lowest(block: Block, up: Array) -> float:
    """Least height of a block along a direction, m."""
    return min(float((piece.corners @ up).min()) for piece in block.pieces)


def ground_below(
    key: str,
    blocks: Sequence[Block],
    plane: tuple[Array, float],
    depth: float,
    tolerance: float | None,
    axis: str = "z",
) -> tuple[Polyhedron, ...]:
    """Bodies of ground, each for one piece of the blocks, up to a plane n . x = level.

    A side in the plane, by distance and angle of contacts, has a body of its own shape. What
    touches the plane in an edge or corner has a wider one; so has what is above it by a part of
    its thickness, and has a side that looks down: it is told of as other gaps are.

    Args:
        key: Of the ground in a scene file.
        blocks: What may lie on it.
        plane: Its unit normal, out of the ground, and level, m.
        depth: Of the bodies, m.
        tolerance: See `checked_contacts`.
        axis: Name of the axis that points upwards.

    Raises:
        InputError: If nothing touches the plane; the message has the nearest block.
    """
    up, level = plane
    bodies = []
    off = []
    pieces = [
        (piece, block.thickness(piece), block.name) for block in blocks for piece in block.pieces
    ]
    for piece, thickness, name in pieces:
        near = (APART * thickness if tolerance is None else tolerance) + piece.warp
        height = piece.corners @ up - level
        least = float(height.min())
        off.append((abs(least) - near, abs(least), thickness, name))
        slope = piece.normals @ up
        sides = [list(piece.sides[side]) for side in np.flatnonzero(slope < -FACING)]
        tops = [piece.corners[side] for side in sides if np.abs(height[side]).max() <= near]
        below = depth
        hovers = least < NEARLY * thickness and slope.min() < -INCLINED
        if not tops and least >= -near and (least <= near or hovers):
            shadow = piece.corners - np.outer(height - least * (least <= near), up)
            tops = [_scaled(shadow, WIDER)]
            below = max(depth, thickness)
        for top in tops:
            bodies.append(Polyhedron.hull(np.vstack([top, _scaled(top, NARROWER) - below * up])))
            bodies[-1].under = piece
    beyond, distance, thickness, name = min(off)
    cure = f", or set tolerance = {1.01 * distance:.3g}" * (distance < NEARLY * thickness)
    text = f"{key}: no block touches the ground; see its {axis} or plane; block '{name}' is"
    require(beyond <= 0.0, f"{text} {distance:.3g} m off it{cure}")
    return tuple(bodies)


def _scaled(points: Array, size: float) -> Array:
    """Points, larger or smaller about their mean."""
    middle = points.mean(axis=0)
    return np.asarray(middle + size * (points - middle))
