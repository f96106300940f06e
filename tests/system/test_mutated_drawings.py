"""Walls drawn with mistakes: none loses a stone or an opening without a word."""

from __future__ import annotations

import pytest

pytest.importorskip("ezdxf")
pytest.importorskip("shapely")

from tests.mutated_drawings import KINDS, mutated_drawing, read_again
from tests.quick import some


def check(seed: int, tmp_path) -> None:
    """A drawing as it is, and its lines mended."""
    drawn = mutated_drawing(seed, tmp_path / "wall.dxf")
    for snap in (0.0, 5.0) if seed % len(KINDS) in (0, 3) else (0.0,):
        read = read_again(drawn, snap)
        whole = (read.stones, read.openings) == (len(drawn.stones), len(drawn.openings))
        assert whole or read.told, (seed, snap, read)


@pytest.mark.parametrize("seed", some(range(8), 3))
def test_nothing_is_lost_without_a_word(seed, tmp_path):
    check(seed, tmp_path)


@pytest.mark.slow
def test_nothing_is_lost_without_a_word_in_many_drawings(tmp_path):
    for seed in range(8, 316):
        check(seed, tmp_path)
