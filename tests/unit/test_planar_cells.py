"""Cells by their corners: orientation, and blocks that lie over each other."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.geometry.planar_cells import check_apart


def grid(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and square cells of a unit square."""
    x, y = np.meshgrid(*2 * (np.linspace(0.0, 1.0, count + 1),))
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    cells = first[:, None] + np.array([0, 1, count + 2, count + 1])
    return np.column_stack([x.ravel(), y.ravel()]), cells


SQUARE, CELLS = grid(20)
SMALL = 0.02 * grid(1)[0] + 0.515  # within the cell about (0.525, 0.525)
HOLE = np.abs(SQUARE[CELLS].mean(axis=1) - 0.525).max(axis=1) < 0.01


def check_two(second: np.ndarray, cells: np.ndarray = CELLS, angle: float = 0.0) -> None:
    """Check the square and a block of one cell, both turned."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = np.vstack([SQUARE, second]) @ turn.T
    table = np.vstack([cells, len(SQUARE) + np.array([0, 1, 3, 2])])
    body = np.append(np.zeros(len(cells), dtype=np.int32), np.int32(1))
    check_apart(points, table, body, "drawing")


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.0])
@pytest.mark.parametrize(
    ("width", "shift", "apart"),
    [
        (1.0, (1.0, 0.0), True),
        (1.0, (1.0, 0.37), True),
        (1.0, (1.0, 1.0), True),
        (1.0, (1.0 - 1e-6, 0.0), True),  # nodes match to some digits
        (100.0, (1.0, -50.0), True),  # a large cell beside small ones
        (100.0, (0.999, -50.0), False),
        (1.0, (0.999, 0.37), False),
        (1.0, (0.999, 0.999), False),
        (1.0, (0.0, 0.0), False),
        (3.0, (-1.0, -1.0), False),
        (0.02, (0.515, 0.515), False),  # inside, far from the outline
        (1e-4, (0.5, 0.5), False),
    ],
)
def test_blocks_overlap_or_do_not(width, shift, apart, angle):
    second = width * grid(1)[0] + shift
    if apart:
        check_two(second, angle=angle)
    else:
        with pytest.raises(InputError, match=r"drawing: blocks overlap at \("):
            check_two(second, angle=angle)


def test_block_in_a_hole_overlaps_nothing():
    check_two(SMALL, CELLS[~HOLE])
