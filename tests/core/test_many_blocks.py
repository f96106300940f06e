"""What thousands of blocks are asked for: convex programs alone. Few blocks are taken as many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import limit_load
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.programs import proved_fall
from tests.bank import coulomb, wall_recipe
from tests.helpers import planar_faces
from tests.quick import slow
from tests.second_solver import limit, misses, own_limit


@pytest.fixture(autouse=True)
def _many(monkeypatch):
    monkeypatch.setattr(FaceModel, "has_many_blocks", True)


def model_of(name: str, friction: float) -> FaceModel:
    """The faces of a wall."""
    return planar_faces(wall_recipe(name, coulomb(friction)).scene(1)).model


@pytest.mark.parametrize("name", ["W1", "W3", "10x10", *slow("20x20")])
@pytest.mark.parametrize("friction", [0.4, 0.75])
def test_a_state_of_convex_programs(name, friction):
    """HiGHS finds the limit with the friction forces of the state where the certificate says."""
    model = model_of(name, friction)
    asked = 5e-3
    search = FaceSearch(model, asked)
    found = search.run()
    assert found.gap <= asked
    assert search.attempts[0].name.startswith("convex programs")
    assert max(misses(model, found).values()) <= 1e-8
    own = own_limit(model, found)
    size = model.size(found.load_factor)
    assert found.load_factor - 1e-6 * size <= own <= found.upper + 1e-6 * size


@pytest.mark.parametrize("name", ["W1", "10x10"])
def test_the_bracket_has_no_lower_end(name):
    """The upper end is that of HiGHS, and the way is told."""
    found = limit_load(wall_recipe(name, coulomb(0.6)).scene(1))
    assert found.status == "limit"
    assert found.positive.engine == "faces"
    assert found.bounds.lower is None
    assert found.load_factor <= found.bounds.upper * (1.0 + 1e-6)
    assert "not asked at this size" in found.summary()
    few = model_of(name, 0.6)
    known = limit(few, few.strength, few.friction)
    assert known * (1.0 - 1e-7) <= found.bounds.upper <= known * (1.0 + 2e-4)


def test_range_and_path_are_not_asked():
    """The record says so."""
    found = limit_load(wall_recipe("W1", coulomb(0.6)).scene(1, fast=False, lowest=False))
    assert "not asked at this size" in found.summary(verbose=True)
    assert found.positive.range.status == "not_known"


@pytest.mark.parametrize("name", ["W1", "W2", "10x10"])
def test_what_stands_is_proved(name):
    """Half of what nothing exceeds is carried, half more is not; a dead load turned round falls."""
    model = model_of(name, 0.6)
    upper = limit(model, model.strength, model.friction)
    for part in (0.0, 0.5, 0.999):
        assert proved_fall(model, part * upper) is None
    for turned, part in ((model, 1.001), (model, 1.5), (replace(model, dead=-model.dead), 0.0)):
        motion = proved_fall(turned, part * upper)
        loads = turned.dead + part * upper * turned.live
        opening = replace(turned, dilatancy=turned.friction).power(motion).closing.max()
        assert loads @ motion == pytest.approx(1.0)
        assert opening <= 1e-6 * np.abs(turned.relative(motion)).max()
