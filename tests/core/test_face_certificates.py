"""Certificates of the face engine, each of them recomputed by HiGHS or, with crushing, by Clarabel.

A state with the load factor lambda tells `upper`: with its own strengths nothing carries more. So
another solver must find a limit between these two with the same strengths.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.model import FaceModel
from tests.bank import coulomb, wall_recipe
from tests.helpers import planar_faces
from tests.property.scenes import Draw
from tests.quick import each_once, some
from tests.second_solver import limit, misses, own_limit

GAP = 1e-3
#: Of the second solvers, in units of the load factor's size.
SOLVED = 1e-6


def certified(model: FaceModel, known: float = GAP) -> FaceState:
    """A state with a gap, judged."""
    found = FaceSearch(model, known).run()
    assert found is not None and found.gap <= known
    missed = misses(model, found)
    assert max(missed.values()) <= 1e-8, missed
    judge(model, found)
    return found


def judge(model: FaceModel, found: FaceState) -> None:
    """See that the limit with a state's strengths is what its certificate says."""
    size = model.size(found.load_factor)
    own = own_limit(model, found)
    above, below = found.sign * (own - found.load_factor), found.sign * (found.upper - own)
    assert min(above, below) >= -SOLVED * size
    assert above + below == pytest.approx(found.gap * size, abs=1e-12 * size)


@pytest.mark.parametrize(
    ("name", "friction"), each_once(["W1", "W2", "W3", "W4", "10x10"], [0.4, 0.65, 0.8])
)
def test_walls(name, friction):
    certified(planar_faces(wall_recipe(name, coulomb(friction)).scene(1)).model)


@pytest.mark.parametrize("name", ["W1", "W3", "W4"])
@pytest.mark.parametrize("strength", [3e5, 1e6])
def test_walls_that_crush(name, strength):
    law = replace(coulomb(0.65), compressive_strength=strength)
    certified(planar_faces(wall_recipe(name, law).scene(1)).model)


@pytest.mark.parametrize("seed", some(range(44), 4))
def test_random_blocks(seed):
    """Where nothing limits associative friction, there may be no state with a small gap."""
    model = planar_faces(Draw.of_seed(seed).recipe().scene(1)).model
    associative = limit(model, model.strength, model.friction)
    found = FaceSearch(model, GAP).run()
    if found is None:
        assert math.isnan(associative)  # no equilibrium at all
        return
    missed = misses(model, found)
    assert max(missed[name] for name in ("equilibrium", "friction", "pressing")) <= 1e-8
    assert found.load_factor <= associative + SOLVED * model.size(associative)
    if associative < np.inf or found.gap <= GAP:
        assert found.gap <= GAP and max(missed.values()) <= 1e-8
        judge(model, found)
