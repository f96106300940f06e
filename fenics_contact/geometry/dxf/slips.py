"""What the slips of a drawing's lines cost: stones joined or lost and openings filled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.geometry.dxf.doubts import inner_point
from fenics_contact.geometry.outlines import inside_outlines
from fenics_contact.geometry.planar_cells import Array


@dataclass(frozen=True)
class Slips:
    """What a drawing loses because ends of lines miss each other.

    Attributes:
        joined: Stones that are one block with a neighbour or an opening.
        lost: Stones that are no block.
        filled: Openings that are stone.
        snap: What mends them, in the drawing's unit; 0 for none.
    """

    joined: int = 0
    lost: int = 0
    filled: int = 0
    snap: float = 0.0

    @property
    def text(self) -> str:
        """All of it in a line; empty if nothing is lost."""
        parts = [
            f"{count} {what}"
            for count, what in (
                (self.joined, "stones are joined to their neighbours"),
                (self.lost, "stones are lost"),
                (self.filled, "openings filled"),
            )
            if count
        ]
        return f"{', '.join(parts)}: --snap {self.snap:g} mends them" if self.snap else ""


def slips_between(
    blocks: Sequence[Array], mended: tuple[Sequence[Array], Sequence[Array]], snap: float
) -> Slips:
    """What blocks as drawn lack of the blocks and openings of the drawing mended by `snap`."""
    stones, openings = (
        inside_outlines(np.array([inner_point(o) for o in some]).reshape(-1, 2), blocks)
        for some in mended
    )
    count = np.bincount(np.concatenate([stones, openings]) + 1, minlength=len(blocks) + 1)
    joined = int(np.sum((stones >= 0) & (count[stones + 1] > 1)))
    return Slips(joined, int(np.sum(stones < 0)), int(np.sum(openings >= 0)), snap)


def values_to_try(missed: Array) -> list[float]:
    """Lengths of one digit that are as large as those missed, each once, from the smallest on."""
    missed = missed[np.isfinite(missed)]
    step = 10.0 ** np.floor(np.log10(missed))
    return sorted({float(f"{value:.1g}") for value in np.ceil(missed / step - 1e-9) * step})
