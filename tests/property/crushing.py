"""An independent program for joints that crush: resultants N, V, M of every face, many tangents.

Blocks are polygons, faces are given by hand. |M| <= N (L - N / f_c) / 2 is cut by tangents at fixed
forces, closer together where these are small; nothing here is used by the package or uses it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog
from scipy.sparse import lil_matrix

Array = npt.NDArray[np.float64]
Face = tuple[int, int, Array, Array]

#: Tangents of a face on either side.
TANGENTS = 1500


def voussoirs(
    count: int, thickness: float, radius: float, embrace: float
) -> tuple[list[Array], list[Face]]:
    """Blocks of an arch, and its faces: first block (-1: ground), second block, both ends."""
    half = 0.5 * np.radians(embrace)
    angle = np.pi / 2.0 + np.linspace(half, -half, count + 1)
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    low, high = (radius - 0.5 * thickness) * ray, (radius + 0.5 * thickness) * ray
    blocks = [np.array([low[k], low[k + 1], high[k + 1], high[k]]) for k in range(count)]
    faces = [(k - 1, k, low[k], high[k]) for k in range(count)]
    return blocks, [*faces, (-1, count - 1, low[count], high[count])]


def crushing_blocks(
    blocks: Sequence[Array], faces: Sequence[Face], strength: float, weight: float, friction=np.inf
) -> float:
    """Largest load factor of horizontal loads in multiples of the weight, associative friction.

    Args:
        blocks: Corners of every block, shape (corners, 2).
        faces: As from `voussoirs`.
        strength: f_c, Pa.
        weight: Of the blocks, N/m3.
        friction: Coefficient of friction; infinite: no sliding.
    """
    area, centre = zip(*[_area_and_centre(block) for block in blocks], strict=True)
    unit = weight * max(area)
    equal = lil_matrix((3 * len(blocks), 1 + 3 * len(faces)))
    right = np.zeros(3 * len(blocks))
    for k, size in enumerate(area):
        equal[3 * k, 0] = weight * size / unit
        right[3 * k + 1] = weight * size / unit
    rows = lil_matrix((len(faces) * (2 * TANGENTS + 2), equal.shape[1]))
    most, row = np.zeros(rows.shape[0]), 0
    for number, (one, other, first, second) in enumerate(faces):
        length, middle = float(np.linalg.norm(second - first)), 0.5 * (first + second)
        along = (second - first) / length
        across = np.array([-along[1], along[0]])
        if across @ (centre[other] - middle) < 0.0:
            along, across = -along, -across
        normal, shear, moment = 1 + 3 * number + np.arange(3)
        for block, sign in ((other, 1.0), (one, -1.0)):
            if block < 0:
                continue
            arm = middle - centre[block]
            for column, axis in ((normal, across), (shear, along)):
                equal[3 * block, column] += sign * axis[0]
                equal[3 * block + 1, column] += sign * axis[1]
                equal[3 * block + 2, column] += sign * (arm[0] * axis[1] - arm[1] * axis[0])
            equal[3 * block + 2, moment] += sign  # along x across = 1
        for part in np.linspace(0.0, 1.0, TANGENTS) ** 2:
            force = part * strength * length
            for sign in (1.0, -1.0):
                rows[row, moment], rows[row, normal] = sign, force / strength - 0.5 * length
                most[row], row = 0.5 * force**2 / strength / unit, row + 1
        if np.isfinite(friction):
            for sign in (1.0, -1.0):
                rows[row, shear], rows[row, normal], row = sign, -friction, row + 1
    limits = [(None, None), *[(0.0, None), (None, None), (None, None)] * len(faces)]
    cost = -np.eye(1, equal.shape[1]).ravel()
    rows, equal = rows[:row].tocsr(), equal.tocsr()
    answer = linprog(cost, rows, most[:row], equal, right, limits, method="highs")
    assert answer.status == 0, answer.message
    return float(answer.x[0])


def _area_and_centre(corners: Array) -> tuple[float, Array]:
    """Area of a polygon, m2, and its centre of gravity."""
    after = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]
    centre = ((corners + after) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())
    return abs(float(0.5 * cross.sum())), centre
