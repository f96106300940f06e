"""Blocks that are equal up to a rigid motion: they share a mesh, a stiffness and its factor."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.polyhedra import SAME, Block

#: Digits of distances from the middle, in parts of their size, by which shapes are sorted.
DIGITS = 5


@dataclass(frozen=True, eq=False)
class Placed:
    """Where a block is, seen from the first block of its shape: x = rotation y + shift.

    Attributes:
        block: Number of the block.
        like: Number of the first block of its shape.
        rotation: Shape (3, 3).
        shift: m, shape (3,).
    """

    block: int
    like: int
    rotation: Array
    shift: Array

    def inside(self, places: Array) -> Array:
        """Places of the block, m, shape (., 3), as they are in the first block."""
        return np.asarray((places - self.shift) @ self.rotation)

    def outside(self, places: Array) -> Array:
        """Places in the first block, m, shape (., 3), as they are in the block."""
        return np.asarray(places @ self.rotation.T + self.shift)


def shapes_of(
    blocks: Sequence[Block], kinds: Mapping[int, Hashable], turned: bool = True
) -> list[list[Placed]]:
    """Blocks by their shapes; the first one of each stands for it.

    Args:
        blocks: All blocks.
        kinds: What must be equal besides, of those that are sorted, by their numbers.
        turned: Whether blocks may be turned against each other.
    """
    known: dict[Hashable, list[list[Placed]]] = defaultdict(list)
    for number, kind in kinds.items():
        arms, _ = _corners(blocks[number])
        reach = np.linalg.norm(arms, axis=1)
        digits = np.round(reach / reach.max(), DIGITS).tobytes()
        sides = tuple(piece.sides for piece in blocks[number].pieces)
        alike = known[kind, sides, digits]
        for shape in alike:
            if placed := _placed(blocks, number, shape[0].block, turned):
                shape.append(placed)
                break
        else:
            alike.append([Placed(number, number, np.eye(3), np.zeros(3))])
    return [shape for alike in known.values() for shape in alike]


def _corners(block: Block) -> tuple[Array, Array]:
    """Corners of a block from their middle, and this, m."""
    corners = np.vstack([piece.corners for piece in block.pieces])
    return corners - corners.mean(axis=0), corners.mean(axis=0)


def _placed(blocks: Sequence[Block], number: int, first: int, turned: bool) -> Placed | None:
    """Where a block is, as a motion of the first of a shape; None: it is of another one.

    W. Kabsch, Acta Cryst. A 32 (1976) 922.
    """
    (arms, middle), (drawn, centre) = _corners(blocks[number]), _corners(blocks[first])
    left, _, right = np.linalg.svd(arms.T @ drawn)
    sides = [1.0, 1.0, np.linalg.det(left @ right)]  # no mirror
    rotation = (left * sides) @ right if turned else np.eye(3)
    if np.abs(drawn @ rotation.T - arms).max() > SAME * np.abs(arms).max():
        return None
    return Placed(number, first, rotation, middle - rotation @ centre)
