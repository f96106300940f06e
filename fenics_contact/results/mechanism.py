"""What a collapse mode does, counted: which blocks move, and which joints open or slide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact.discretization.faces import straight_faces
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.layout import Layout
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.results.joint_values import Contact, JointValues

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
    speed, reach = _largest(layout, mode)
    velocity = motion[:, :2]
    edge_speed = np.abs(motion[:, 2]) * reach
    fastest = int(np.argmax(speed))
    least = MOVES * speed[fastest]
    pace = float(np.linalg.norm(velocity[fastest]))
    direction = velocity[fastest] / pace if pace > least else np.zeros(2)
    return Mechanism(
        np.flatnonzero(speed > least),
        np.flatnonzero(edge_speed > least),
        fastest,
        layout.centroid[fastest],
        direction,
        *_counts(layout.joints.without_ties(), values.first(layout.joints.joint_count)),
    )


def _largest(layout: Layout, mode: Array) -> tuple[Array, Array]:
    """Of all bodies: largest speed of a node, and largest distance of one from their mean."""
    size = [np.linalg.norm(table, axis=1) for table in (layout.cartesian(mode), layout.arm)]
    largest = np.zeros((len(layout.bodies.centre), 2))
    np.maximum.at(largest, layout.node_body, np.column_stack(size))
    layout.scene.comm.Allreduce(MPI.IN_PLACE, largest, MPI.MAX)
    return largest[:, 0], largest[:, 1]


def _counts(joints: Joints, values: JointValues) -> tuple[int, int, int, int]:
    """Number of joints, and of those that part, rock and slide."""
    face = straight_faces(joints).of_point
    count = int(face.max(initial=-1)) + 1

    def points(chosen: Flags) -> Indices:
        return np.bincount(face[chosen], minlength=count)

    is_open = values.contact == Contact.OPEN
    opening = points(is_open & values.opens) > 0
    closed = points(~is_open) > 0
    slipping = points(values.contact == Contact.SLIP) > 0
    parting = opening & ~closed
    rocking = opening & closed
    sliding = ~opening & slipping
    return count, int(parting.sum()), int(rocking.sum()), int(sliding.sum())
