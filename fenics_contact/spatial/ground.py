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


def lowest(block: Block, up: Array) -> float:
    """Least height of a block along a direction, m."""
    return min(float((piece.corners @ up).min()) for piece in block.pieces)


def ground_below(
    key: str,
    blocks: Sequence[Block],
    plane: tuple[Array, float],
    depth: float,
    tolerance: float | None,
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

    Raises:
        InputError: If nothing touches the plane; the message has the nearest block.
    """
    up, level = plane
    bodies = []
    off = []
    for block in blocks:
        for piece in block.pieces:
            thickness = block.thickness(piece)
            near = (APART * thickness if tolerance is None else tolerance) + piece.warp
            height = piece.corners @ up - level
            least = float(height.min())
            off.append((abs(least), abs(least) <= near, abs(least) < NEARLY * thickness, block))
            slope = piece.normals @ up
            loops = [list(side) for side in piece.sides]
            flat = [np.abs(height[loop]).max() <= near for loop in loops]
            below = depth
            tops = [piece.corners[loops[k]] for k in np.flatnonzero((slope < -FACING) & flat)]
            hovers = least < NEARLY * thickness and slope.min() < -INCLINED
            if not tops and least >= -near and (least <= near or hovers):
                rise = height - (least if least <= near else 0.0)
                shadow = piece.corners - np.outer(rise, up)
                middle = shadow.mean(axis=0)
                tops = [middle + WIDER * (shadow - middle)]
                below = max(depth, thickness)
            for top in tops:
                body = Polyhedron.hull(np.vstack([top, top - below * up]))
                body.under = piece
                bodies.append(body)
    distance, _, small, block = min(off, key=lambda one: one[0])
    cure = f", or set tolerance = {1.01 * distance:.3g}" * small
    text = f"{key}: no block touches the ground; see its z or plane"
    found = f"{text}; block '{block.name}' is {distance:.3g} m off it{cure}"
    require(any(touches for _, touches, _, _ in off), found)
    return tuple(bodies)
