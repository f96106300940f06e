"""Random scenes as hypothesis draws them: few blocks before many, one element before two."""

from __future__ import annotations

from hypothesis import strategies as st

from tests.property.scenes import KINDS, Draw

SEEDS = 2**31 - 1


def draws(most: int = 40) -> st.SearchStrategy[Draw]:
    """Scenes of all kinds with 2 to `most` blocks."""
    sizes = st.integers(2, most), st.integers(1, 2), st.integers(0, SEEDS)
    return st.builds(Draw, st.sampled_from(sorted(KINDS)), *sizes)
