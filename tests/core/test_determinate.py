"""Mechanisms whose load factor statics alone give."""

from __future__ import annotations

import pytest

from fenics_contact import limit_load
from fenics_contact.mesh_error.determinate import is_determinate
from tests.bank import BANK
from tests.property.scenes import Draw


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        *((name, True) for name in ("block 0.2", "block 0.7", "arch 15 0.15", "wedge 0.3")),
        *((name, True) for name in ("4x5 coulomb 0.4", "stack of 5 0.7", "trilith 0.1")),
        *((name, False) for name in ("W3 coulomb 0.65", "W4 coulomb 0.65")),
    ],
)
def test_determinate_mechanisms(name, expected):
    result = limit_load(BANK[name].scene(error=False))
    whole = result.layout
    assert is_determinate(whole.joints, result.positive.joints, whole.bodies) is expected


@pytest.mark.parametrize(("seed", "expected"), [(24, True), (53, True), (225, False)])
def test_shear_of_open_joints_with_a_strength(seed, expected):
    """Blocks with given strengths, with load factors that are the same on finer meshes, or not."""
    recipe, factors = Draw.of_seed(seed).recipe(), []
    for elements in (2, 4):
        result = limit_load(recipe.scene(elements, error=False))
        whole, values = result.layout, result.positive.joints
        assert is_determinate(whole.joints, values, whole.bodies) is expected
        factors.append(result.load_factor)
    assert (factors[1] == pytest.approx(factors[0], rel=1e-6)) is expected
