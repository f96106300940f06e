"""Blocks that fall or wedge: their numbers, and a line that names them."""

from __future__ import annotations

import numpy as np

from fenics_contact.discretization.layout import Layout
from fenics_contact.geometry.mesh import Indices
from fenics_contact.solvers.problem import Array

#: Blocks fall, or wedge, from this part of the largest motion, or force, on.
MOVES = 1e-6
#: A block turns from this part of its motion on, and slides at this angle to its load.
OBLIQUE = 1e-3
#: Blocks that a line names.
NAMED = 5


def large(size: Array) -> Indices:
    """Numbers of the blocks for which something is not small."""
    return np.flatnonzero(size > MOVES * size.max(initial=0.0))


def falling_blocks(layout: Layout, fall: Array | None) -> Indices:
    """Numbers of the blocks that move in a fall, (a, b, c) by block about its centre; may be none.

    Args:
        layout: Of the blocks.
        fall: Shape (bodies, 3); None where nothing falls.
    """
    if fall is None:
        return np.empty(0, dtype=np.int64)
    turning = np.abs(fall[:, 2]) * layout.bodies.size
    return large(np.hypot(fall[:, 0], fall[:, 1]) + turning)


def fall_reason(layout: Layout, fall: Array | None) -> str:
    """That the dead load does not stand and what the blocks do, for people.

    They turn, or fall along their dead load, or else slide.
    """
    blocks = falling_blocks(layout, fall)
    motion = np.zeros((len(layout.centroid), 3)) if fall is None else fall
    shift = motion[blocks, :2]
    dead = layout.bodies.dead[blocks, :2]
    pace = np.linalg.norm(shift, axis=1)
    turning = np.abs(motion[blocks, 2]) * layout.bodies.size
    turns = turning > OBLIQUE * (pace + turning)
    cross = np.abs(shift[:, 0] * dead[:, 1] - shift[:, 1] * dead[:, 0])
    falls = ~turns & (cross <= OBLIQUE * np.sum(shift * dead, axis=1))
    kinds = {"fall": falls, "slide": ~turns & ~falls, "turn": turns}
    parts = [
        named_blocks(blocks[which], layout.centroid, what)
        for what, which in kinds.items()
        if np.any(which)
    ]
    return f"there is no equilibrium under the dead load alone: {', '.join(parts)}"


def named_blocks(blocks: Indices, centre: Array, what: str) -> str:
    """Blocks by number and place, as far as a line has room, and what they do."""
    names = [f"{block} at ({centre[block, 0]:.3g}, {centre[block, 1]:.3g})" for block in blocks]
    if len(names) == 1:
        return f"block {names[0]} {what}s"
    rest = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"blocks {', '.join(names[:NAMED])}{rest} {what}"
