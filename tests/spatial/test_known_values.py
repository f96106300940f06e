"""Walls, vaults and domes whose limit loads are known."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fenics_contact.faces.programs import associative_end, state_under
from fenics_contact.spatial import builders
from fenics_contact.spatial.limit import collapse_of
from tests.bank import WALLS
from tests.quick import each_once, slow, slow_rows
from tests.spatial.bank import Pushed, barrel, extruded, towards


def limit_of(scene, quick=True, least=1e-6):
    """Load factor, and how far it may be from the exact one."""
    found = collapse_of(scene.structure(quick))
    assert found.status == "limit"
    return found.load_factor, max(found.gap, least) * found.load_factor


@pytest.mark.parametrize(("degrees", "quick"), each_once([90.0, 60.0, 45.0], [True, False]))
def test_free_wall_turns_about_its_foot(degrees, quick):
    """Thickness over height, whatever the push along the wall: it cannot turn that way."""
    make = partial(builders.wall, length=2.0, height=0.875, thickness=0.2, brick=(0.4, 0.175))
    factor, error = limit_of(Pushed(make, 0.6, towards(degrees)), quick)
    by_hand = 0.2 / 0.875 / np.sin(np.radians(degrees))
    assert factor == pytest.approx(by_hand, abs=error)


@pytest.mark.parametrize("strips", [1, 3, *slow(10)])
def test_barrel_vault_is_an_arch(strips):
    factor, error = limit_of(Pushed(partial(barrel, strips), 0.6, towards(0.0)))
    assert factor == pytest.approx(0.307755, abs=error + 1e-6)


@pytest.mark.slow
def test_long_barrel_vault_is_an_arch():
    factor, error = limit_of(Pushed(partial(barrel, 19), 0.6, towards(0.0)))
    assert factor == pytest.approx(0.307755, abs=error + 1e-6)


@pytest.mark.parametrize(
    ("wall", "lowest", "highest"),
    [
        ("W3", 0.3558, 0.4045),
        *slow_rows(("W1", 0.63881, 0.6431), ("W2", 0.5571, 0.5805), ("W4", 0.2637, 0.3325)),
    ],
)
def test_planar_walls_with_a_thickness(wall, lowest, highest):
    """Between the lowest collapse state known in the plane and the limit of associative slip."""
    make = partial(extruded, WALLS[wall], 0.2)
    factor, error = limit_of(Pushed(make, 0.65, towards(0.0)))
    assert lowest - error <= factor <= highest + error


@pytest.mark.slow
def test_thickness_of_a_hemisphere():
    """0.042 of the radius (J. Heyman, Int. J. Solids Struct. 3 (1967) 227), without sliding.

    This dome of plane stones is proved to fall at 0.042, and stands at 0.043.
    """
    models = {}
    for thickness in (0.042, 0.043):
        make = partial(
            builders.dome, radius=1.0, thickness=thickness, meridians=12, rings=16, oculus=0.02
        )
        model = Pushed(make, 3.0).structure(quick=True).face_model()
        models[thickness] = replace(model, dead=np.zeros_like(model.dead), live=model.dead)
    largest = associative_end(models[0.042])  # part of the weight that it carries
    assert largest is not None and largest < 1e-6
    standing = state_under(models[0.043], 1.0)
    assert standing is not None and standing.missing < 1e-9
