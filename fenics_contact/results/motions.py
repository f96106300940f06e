"""What blocks do in a collapse mode or a fall: counted, and named in a line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact.discretization.layout import Layout, straight_faces
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.results.values import Contact, JointValues

#: A block moves, or turns, from this part of the largest speed on. Elastic motions are smaller.
MOVES = 1e-3


@dataclass(frozen=True)
class Mechanism:
    """A collapse mode in numbers; alike on all ranks.

    A joint here is a straight face between two blocks, or between a block and the ground.

    Attributes:
        moving: Numbers of the blocks that move.
        turning: Numbers of those of them that turn.
        fastest: Number of the block that moves fastest.
        centre: Centre of that block, m, shape (2,).
        direction: Unit vector along the motion of that centre, shape (2,); zero if it only turns.
        joints: Number of joints.
        parting: Joints that open over their whole length.
        rocking: Joints that open over a part of their length.
        sliding: Joints that slide and stay closed.
    """

    moving: Indices
    turning: Indices
    fastest: int
    centre: Array
    direction: Array
    joints: int
    parting: int
    rocking: int
    sliding: int


def mechanism(layout: Layout, mode: Array, values: JointValues) -> Mechanism:
    """What a mode does; `mode` is this rank's part in the supports' coordinates. Collective."""
    motion = layout.centroid_motions(mode)
    # Of all bodies: largest speed of a node, and largest distance of one from their mean.
    size = [np.linalg.norm(table, axis=1) for table in (layout.cartesian(mode), layout.arm)]
    largest = np.zeros((len(motion), 2))
    np.maximum.at(largest, layout.node_body, np.column_stack(size))
    layout.scene.comm.Allreduce(MPI.IN_PLACE, largest, MPI.MAX)
    speed, reach = largest.T
    velocity = motion[:, :2]
    edge_speed = np.abs(motion[:, 2]) * reach
    fastest = int(np.argmax(speed))
    least = MOVES * speed[fastest]
    pace = float(np.linalg.norm(velocity[fastest]))
    values = values.first(layout.joints.joint_count)
    face = straight_faces(layout.joints.without_ties()).of_point
    count = int(face.max(initial=-1)) + 1
    is_open = values.contact == Contact.OPEN
    opening, closed, slipping = (  # joints with a point that does so
        np.bincount(face[points], minlength=count) > 0
        for points in (is_open & values.opens, ~is_open, values.contact == Contact.SLIP)
    )
    return Mechanism(
        moving=np.flatnonzero(speed > least),
        turning=np.flatnonzero(edge_speed > least),
        fastest=fastest,
        centre=layout.centroid[fastest],
        direction=velocity[fastest] / pace if pace > least else np.zeros(2),
        joints=count,
        parting=int(np.sum(opening & ~closed)),
        rocking=int(np.sum(opening & closed)),
        sliding=int(np.sum(~opening & slipping)),
    )


#: Blocks fall, or wedge, from this part of the largest motion, or force, on.
FALLS = 1e-6
#: A block turns from this part of its motion on, and slides at this angle to its load.
OBLIQUE = 1e-3
#: Blocks that a line names.
NAMED = 5


def large(size: Array) -> Indices:
    """Numbers of the blocks for which something is not small."""
    return np.flatnonzero(size > FALLS * size.max(initial=0.0))


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
    kinds = (("fall", falls), ("slide", ~turns & ~falls), ("turn", turns))
    parts = [named_blocks(blocks[k], layout.centroid, what) for what, k in kinds if np.any(k)]
    return f"there is no equilibrium under the dead load alone: {', '.join(parts)}"


def named_blocks(blocks: Indices, centre: Array, what: str) -> str:
    """Blocks by number and place, as far as a line has room, and what they do."""
    names = [f"{block} at ({centre[block, 0]:.3g}, {centre[block, 1]:.3g})" for block in blocks]
    if len(names) == 1:
        return f"block {names[0]} {what}s"
    rest = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"blocks {', '.join(names[:NAMED])}{rest} {what}"
