"""Rigid blocks given by their outlines: faces between them, loads, equilibrium.

Blocks have unit weight per area. The dead load is their weight, the live load the load factor times
the weight of every block to the right. What lies on the lowest level stands on rigid ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csr_matrix

Array = npt.NDArray[np.float64]

#: Body number of the ground.
GROUND = -1

#: Lines agree if direction and offset do to this fraction.
COLLINEAR = 1e-6


class Answer(NamedTuple):
    """What a peer finds: "limit", "last converged", "unstable", "not converged", "time-out"."""

    status: str
    load_factor: float = float("nan")


@dataclass(frozen=True)
class Faces:
    """Straight faces between two blocks.

    Attributes:
        bodies: Block below or left of the face (or GROUND) and block on the other side, (faces, 2).
        ends: Both ends, m, shape (faces, 2, 2).
        tangent: Unit vector from the first end to the second, shape (faces, 2).
        normal: Unit vector from the first block to the second, shape (faces, 2).
    """

    bodies: npt.NDArray[np.int64]
    ends: Array
    tangent: Array
    normal: Array


@dataclass(frozen=True)
class Blocks:
    """Blocks, friction, and the length that programs with elements divide.

    Attributes:
        outlines: Corners of every block, anticlockwise, m, each of shape (corners, 2).
        friction: Coulomb's coefficient of all joints.
        unit: Length divided into `resolution` elements, m: half a brick, an arch's thickness.
    """

    outlines: Sequence[Array]
    friction: float
    unit: float

    @cached_property
    def faces(self) -> Faces:
        """Stretches that two blocks, or a block and the ground, have in common."""
        sides = [np.stack([c, np.roll(c, -1, axis=0)], axis=1) for c in self.outlines]
        body = np.repeat(np.arange(len(sides)), [len(side) for side in sides])
        ends = np.concatenate(sides)
        near = COLLINEAR * np.ptp(ends, axis=(0, 1)).max()
        way = ends[:, 1] - ends[:, 0]
        way /= np.linalg.norm(way, axis=1)[:, None]
        over = np.where(np.abs(way[:, 0]) < COLLINEAR, way[:, 1], way[:, 0]) > 0.0
        tangent = np.where(over[:, None], way, -way)
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
        offset = np.einsum("ni,ni->n", normal, ends[:, 0])
        line = np.round(np.column_stack([normal / COLLINEAR, offset / near])).astype(int).tolist()
        along = np.sort(np.einsum("nei,ni->ne", ends, tangent), axis=1)
        grounded = ends[:, :, 1].max(axis=1) <= ends[:, :, 1].min() + near
        under: dict[tuple[int, ...], list[int]] = {}
        for side in np.flatnonzero(~over):
            under.setdefault(tuple(line[side]), []).append(side)
        found = [(GROUND, body[side], side, *along[side]) for side in np.flatnonzero(grounded)]
        for side in np.flatnonzero(over):
            for other in under.get(tuple(line[side]), ()):
                start, stop = max(along[[side, other], 0]), min(along[[side, other], 1])
                if stop - start > near:
                    found.append((body[other], body[side], side, start, stop))
        first, second, side, start, stop = map(np.array, zip(*found, strict=True))
        base = offset[side, None] * normal[side]
        ends = np.stack([base + s[:, None] * tangent[side] for s in (start, stop)], axis=1)
        return Faces(np.column_stack([first, second]), ends, tangent[side], normal[side])

    @cached_property
    def moments(self) -> Array:
        """Area (the weight) and centre of gravity, m, of every block, shape (blocks, 3)."""
        found = []
        for corners in self.outlines:
            after = np.roll(corners, -1, axis=0)
            cross = corners[:, 0] * after[:, 1] - after[:, 0] * corners[:, 1]
            found.append([0.5 * cross.sum(), *(cross @ (corners + after) / (3.0 * cross.sum()))])
        return np.array(found)

    def load(self, x: float, y: float) -> Array:
        """Force and moment on every block of weights in a direction over the heaviest."""
        weight = self.moments[:, 0]
        return np.outer(weight / weight.max(), [x, y, 0.0]).ravel()

    def forces(self, end: int, direction: Array) -> csr_matrix:
        """Forces and moments of unit forces at one end of all faces, shape (3 blocks, faces)."""
        faces = self.faces
        rows, columns, values = [], [], []
        for side, sign in ((0, -1.0), (1, 1.0)):
            kept = np.flatnonzero(faces.bodies[:, side] != GROUND)
            of = faces.bodies[kept, side]
            arm, force = faces.ends[kept, end] - self.moments[of, 1:], sign * direction[kept]
            moment = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
            rows.append((3 * of[:, None] + np.arange(3)).ravel())
            columns.append(np.repeat(kept, 3))
            values.append(np.column_stack([force, moment / self.unit]).ravel())
        place = (np.concatenate(rows), np.concatenate(columns))
        shape = (3 * len(self.outlines), len(direction))
        return coo_matrix((np.concatenate(values), place), shape).tocsr()
