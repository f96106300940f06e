"""Axis-aligned boxes in any number of dimensions d, as the face engine sees them.

Gravity acts against the last axis. Boxes touch over boxes of dimension d - 1; every corner of
these carries a force, normal first (`FaceModel` with one pressing force a unit). Weight and size
are 1 for an average box, so that load factors are pure numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix, vstack

from fenics_contact.faces.model import FaceModel
from tests.bank import WALLS

Array = npt.NDArray[np.float64]

#: Boxes that overlap by less than this, in their units, touch or are apart.
TOUCHING = 1e-9
#: Shear stiffness of faces over their normal one.
SHEAR = 0.4


def box_model(
    boxes: npt.ArrayLike,
    ground: npt.ArrayLike,
    friction: float,
    push: npt.ArrayLike | None = None,
) -> FaceModel:
    """Boxes that are pushed by their weight.

    Args:
        boxes: Their lower and upper corners, shape (boxes, 2, d).
        ground: Boxes that do not move.
        friction: F of all faces.
        push: Direction of the live load, shape (d,); by default along the first axis.
    """
    boxes = np.asarray(boxes, dtype=float)
    count, _, d = boxes.shape
    every = np.concatenate([boxes, np.asarray(ground, dtype=float)])
    volumes = np.prod(boxes[:, 1] - boxes[:, 0], axis=1)
    size = float(np.mean(volumes)) ** (1.0 / d)
    centres = boxes.mean(axis=1)
    rows, compliance = [], []
    for one, other, low, high in touching(every, count):
        axis = int(np.argmin(high - low))
        along = [k for k in range(d) if k != axis]
        axes = np.eye(d)[[axis, *along]]
        axes[0] *= np.sign(np.sum(every[other] - every[one], axis=0)[axis])  # from one to other
        corners = list(product(*(sorted({low[k], high[k]}) for k in range(d))))
        spring = len(corners) * size ** (d - 1) / float(np.prod((high - low)[along]))
        for corner in corners:
            row = np.zeros((d, count, d * (d + 1) // 2))
            for block, sign in ((one, -1.0), (other, 1.0)):
                if block < count:
                    arm = (np.array(corner) - centres[block]) / size
                    row[:, block] = sign * axes @ rigid_motions(arm)
            rows.append(csr_matrix(row.reshape(d, -1)))
            compliance.append([spring, *[spring / SHEAR] * (d - 1)])
    units = len(compliance)
    gravity, live = -np.eye(d)[-1], np.eye(d)[0] if push is None else np.asarray(push, dtype=float)
    dead, pushed = (_loads(volumes / volumes.mean(), force) for force in (gravity, live))
    return FaceModel(
        vstack(rows).tocsr(),
        1,
        dead,
        pushed,
        np.zeros(units),
        np.full(units, friction),
        np.zeros(units),
        np.array(compliance),
        np.zeros(units),
    )


def touching(boxes: Array, movable: int) -> Iterator[tuple[int, int, Array, Array]]:
    """Pairs of boxes that share a face, its lower and upper corner; the first one can move."""
    for first in range(movable):
        low = np.maximum(boxes[first, 0], boxes[first + 1 :, 0])
        high = np.minimum(boxes[first, 1], boxes[first + 1 :, 1])
        thin = np.abs(high - low) < TOUCHING
        shared = (thin.sum(axis=1) == 1) & np.all(thin | (high > low), axis=1)
        for k in np.flatnonzero(shared):
            lower = np.where(thin[k], 0.5 * (low[k] + high[k]), low[k])
            yield first, first + 1 + int(k), lower, np.where(thin[k], lower, high[k])


def rigid_motions(arm: Array) -> Array:
    """Velocity at an arm from the centre, by d translations and d (d - 1) / 2 rotations."""
    d = len(arm)
    turned = []
    for i, j in combinations(range(d), 2):
        velocity = np.zeros(d)
        velocity[i], velocity[j] = -arm[j], arm[i]
        turned.append(velocity)
    return np.column_stack([np.eye(d), *turned])


def _loads(volumes: Array, force: Array) -> Array:
    """Forces at the centres of boxes, in their motions."""
    d = len(force)
    loads = np.zeros((len(volumes), d * (d + 1) // 2))
    loads[:, :d] = volumes[:, None] * force
    return loads.ravel()


def extruded(outlines: Array, depth: float | None) -> Array:
    """Rectangles, shape (boxes, 2, 2), as they are or as boxes of a depth along the second axis."""
    if depth is None:
        return outlines
    sides = np.broadcast_to(np.array([0.0, depth])[None, :, None], (len(outlines), 2, 1))
    return np.concatenate([outlines[..., :1], sides, outlines[..., 1:]], axis=-1)


def coursed(courses: Sequence[Sequence[float]], block: tuple[float, float]) -> tuple[Array, Array]:
    """A wall of courses, lengths in blocks, voids negative: its blocks and the ground."""
    width, height = block
    blocks, x = [], 0.0
    for level, course in enumerate(courses):
        x = 0.0
        for length in course:
            end = x + abs(length) * width
            if length > 0.0:
                blocks.append([[x, level * height], [end, (level + 1) * height]])
            x = end
    return np.array(blocks), np.array([[[0.0, -height], [x, 0.0]]])


def box_wall(
    name: str, friction: float, d: int = 2, push: npt.ArrayLike | None = None
) -> FaceModel:
    """A wall of the bank, or "20x20"; in space it is as deep as a block is long, 0.4 m."""
    if name in WALLS:
        wall = coursed(WALLS[name], (0.4, 0.175))
    else:
        bricks, courses = map(int, name.split("x"))
        whole, shifted = [1.0] * bricks, [0.5, *[1.0] * (bricks - 1), 0.5]
        wall = coursed([[whole, shifted][level % 2] for level in range(courses)], (0.4, 0.2))
    blocks, ground = (extruded(part, None if d == 2 else 0.4) for part in wall)
    return box_model(blocks, ground, friction, push)
