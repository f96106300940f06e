"""Certificates of the face engine, each of them recomputed by HiGHS or, with crushing, by Clarabel.

A state with the load factor lambda tells `upper`: with its own strengths nothing carries more. So
another solver must find a limit between these two with the same strengths.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Load, Material
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.model import FaceModel
from tests.bank import Recipe, coulomb, outlined, stack_recipe, wall_recipe
from tests.helpers import planar_faces
from tests.property.crushing import crushing_blocks, voussoirs
from tests.property.scenes import Draw
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


@pytest.mark.parametrize("name", ["W1", "W2", "W3", "W4", "10x10"])
@pytest.mark.parametrize("friction", [0.4, 0.65, 0.8])
def test_walls(name, friction):
    certified(planar_faces(wall_recipe(name, coulomb(friction)).scene(1)).model)


@pytest.mark.parametrize("name", ["W1", "W3", "W4"])
@pytest.mark.parametrize("strength", [3e5, 1e6])
def test_walls_that_crush(name, strength):
    law = replace(coulomb(0.65), compressive_strength=strength)
    certified(planar_faces(wall_recipe(name, law).scene(1)).model)


@pytest.mark.parametrize("seed", range(44))
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


def pushed(recipe: Recipe, strength: float, weight: float = 1e4) -> FaceModel:
    """Blocks that crush, pushed by their weight."""
    stone = {"default": Material(1e9, 0.2, weight / 10.0, strength)}
    loads = {"materials": stone, "dead": Load((0.0, -10.0)), "live": Load((10.0, 0.0))}
    return planar_faces(replace(recipe, parts={**recipe.parts, **loads}).scene(1)).model


def ring_recipe(sizes: tuple[int, float, float, float]) -> Recipe:
    """Voussoirs, thickness, radius and embrace, on rough ground."""
    blocks, faces = voussoirs(*sizes)
    ends = [(low, high) for one, _, low, high in (faces[0], faces[-1])]
    return outlined(blocks, coulomb(0.9), 0.2, groups={"base": ends})


@pytest.mark.parametrize(
    ("count", "height", "weight", "strength", "expected"),
    [(1, 0.8, 19.6e3, 1e5, 0.4216), (1, 0.8, 19.6e3, 1e6, 0.49216), (2, 0.2, 1e4, 16e3, 0.75)],
    ids=["column, 0.1 MPa", "column, 1 MPa", "two blocks"],
)
def test_columns(count, height, weight, strength, expected):
    """(b - N / f_c) / h, where all of N is at the strength beside the edge."""
    model = pushed(stack_recipe(count, 5.0, (0.4, height)), strength, weight)
    by_hand = (0.4 - 0.4 * count * height * weight / strength) / (count * height)
    assert certified(model).load_factor == pytest.approx(by_hand, rel=1e-5)
    assert by_hand == pytest.approx(expected, rel=1e-6)


#: Oppenheim's arch, a semicircle, a ring: voussoirs, thickness, radius, embrace.
ARCHES = {
    "oppenheim": (7, 0.15, 1.0, 157.5),
    "semicircle": (11, 0.5, 2.0, 180.0),
    "ring": (9, 0.25, 1.125, 180.0),
}


@pytest.mark.parametrize(
    ("name", "strength", "expected"),
    [
        ("oppenheim", 1e5, 0.30976),
        ("oppenheim", 1e6, 0.36687),
        ("semicircle", 1e5, 0.26620),
        ("semicircle", 1e6, 0.39445),
        ("ring", 2e5, 0.316914),
    ],
)
def test_arches(name, strength, expected):
    """Friction .9 lets hinges open only; against a program of resultants, too."""
    found = certified(pushed(ring_recipe(ARCHES[name]), strength))
    assert found.load_factor == pytest.approx(expected, abs=6e-6)
    independent = crushing_blocks(*voussoirs(*ARCHES[name]), strength, 1e4)
    assert found.load_factor == pytest.approx(independent, rel=1e-5)
