"""How blocks move in a collapse, as data: outlines, and a rigid motion for every block.

The report's slider moves the blocks by it. Coordinates are those of the mesh, m; motions are scaled
as in the pictures, so that the largest displacement is a fixed part of the structure's size.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array, Labels
from fenics_contact.output.drawing import outlines
from fenics_contact.output.view import View

#: Corners that leave a straight line by less than this part of the structure's size are left out.
STRAIGHT = 1e-5
#: Digits of coordinates after the leading one of the structure's size.
DIGITS = 6


def motion_record(view: View) -> dict[str, Any]:
    """Outlines of the blocks, their centres, and their motions (u_x, u_y, angle) about these."""
    digits = DIGITS - int(np.floor(np.log10(view.size)))
    loops = [
        [
            _rounded(_corners(np.asarray(loop), STRAIGHT * view.size), digits)
            for loop in _loops(path)
        ]
        for path in outlines(view.boundary, view.rest)
    ]
    motion = rigid_motions(view.boundary.body, view.rest, view.motion, view.centre)
    return {
        "outlines": loops,
        "centres": _rounded(view.centre, digits),
        "motions": _rounded(motion, digits + 2),
    }


def rigid_motions(body: Labels, rest: Array, motion: Array, centre: Array) -> Array:
    """Best rigid motions, least squares over the ends of the facets, shape (blocks, 3).

    Translation of the centre and the angle, small. `rest` and `motion` have the shape
    (facets, 2, 2).
    """
    of_end = np.repeat(body, 2)
    arm = rest.reshape(-1, 2) - centre[of_end]
    moved = motion.reshape(-1, 2)
    count = np.bincount(of_end, minlength=len(centre))[:, None]

    def mean(values: Array) -> Array:
        columns = [np.bincount(of_end, column, len(centre)) for column in values.T]
        return np.column_stack(columns) / count

    middle = mean(arm)
    shift = mean(moved)
    arm = arm - middle[of_end]
    spin = arm[:, :1] * moved[:, 1:] - arm[:, 1:] * moved[:, :1]
    angle = mean(spin) / mean(np.sum(arm**2, axis=1, keepdims=True))
    turned = angle * np.column_stack([middle[:, 1], -middle[:, 0]])
    return np.column_stack([shift + turned, angle])


def _loops(path: Any) -> list[Array]:
    """Closed loops of a matplotlib path, each without its last corner, which is its first."""
    starts = np.flatnonzero(path.codes == path.MOVETO)
    parts = np.split(path.vertices, starts[1:])
    return [part[:-1] for part in parts]


def _corners(loop: Array, flat: float) -> Array:
    """Points of a loop at which it turns."""
    before = loop - np.roll(loop, 1, axis=0)
    after = np.roll(loop, -1, axis=0) - loop
    cross = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    length = np.linalg.norm(np.roll(loop, -1, axis=0) - np.roll(loop, 1, axis=0), axis=1)
    turns = cross > flat * np.maximum(length, flat)
    return loop[turns] if turns.sum() >= 3 else loop


def _rounded(values: Array, digits: int) -> list[Any]:
    """Nested lists of rounded numbers, without signs of zeros."""
    rounded: list[Any] = (np.round(values, digits) + 0.0).tolist()
    return rounded
