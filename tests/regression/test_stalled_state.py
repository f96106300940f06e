"""States whose residuals are small, but whose load factor belongs to no state."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import limit_load
from tests.property.scenes import Draw


@pytest.mark.slow
def test_a_stalled_state_whose_load_factor_still_changes_is_not_taken():
    """Its residuals are small and its certificate passes, but its load factor belongs to no state.

    Two states are near: rounding leads to either. Both are found with a tolerance of 1e-9, too.
    """
    draw = Draw.of_seed(283)
    result = limit_load(draw.recipe().scene(draw.elements))
    assert result.status == "limit"
    states = np.array([1.0837441, 1.0842564])
    assert np.abs(result.load_factor / states - 1.0).min() <= 1e-6
    assert result.positive.certificate.residuals["equilibrium"] <= 1e-9
