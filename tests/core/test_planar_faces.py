"""Faces of planar structures: forces on their points, elastic states, associative ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import Material
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.faces.programs import associative_end, crushed_by
from tests.bank import BANK, Recipe, stack_recipe
from tests.helpers import planar_faces
from tests.property.scenes import Draw
from tests.second_solver import limit

# Elastic states at a given load


# Associative ends

ENDS = [
    "W1 bracket 0.65",
    "W2 bracket 0.3",
    "W3 bracket 0.8",
    "W4 bracket 0.5",
    "W3 tresca 2 kPa",
    "4x6 coulomb 0.75",
    "block 0.2",
    "block 0.7",
    "stack of 5 0.7",
    "trilith 0.1",
    "tilting table 16",
    "block pushed up an incline",
    "wedge 0.2",
    "buttress from behind",
    "arch 15 0.15",
]


@pytest.mark.parametrize("name", ENDS)
def test_associative_end_is_that_of_the_linear_program(name):
    with Discretization(BANK[name].scene(1)) as made:
        known = RigidBlocks.of(made).limit()
        found = associative_end(PlanarFaces.of(made).model)
    assert found is not None and -1e-9 * abs(known) <= found - known <= 1e-6 * abs(known)


def crushing_draw(seed: int, part: float) -> FaceModel:
    """A random scene whose blocks crush under so many times their weight on 2 m."""
    recipe = Draw.of_seed(seed).recipe()
    stones: dict[str, Material] = recipe.parts["materials"]
    strength = part * max(stone.density for stone in stones.values()) * 9.81 * 2.0
    crushing = {k: replace(m, compressive_strength=strength) for k, m in stones.items()}
    changed: Recipe = replace(recipe, parts={**recipe.parts, "materials": crushing})
    return planar_faces(changed.scene(1)).model


@pytest.mark.parametrize(
    ("seed", "part"),
    [(2, 100.0), (6, 100.0), (16, 100.0), (18, 10.0), (22, 100.0), (46, 10.0)]
    + [(seed, 10.0) for seed in (3, 4, 9, 13, 21)],
)
def test_associative_end_of_blocks_that_crush(seed, part):
    """By Clarabel; in the first ones the live load may be many times the weight."""
    model = crushing_draw(seed, part)
    known = limit(model, model.strength, model.friction)
    assert associative_end(model) == pytest.approx(known, rel=1e-4)


@pytest.mark.parametrize("seed", [2, 16, 18, 39, 46])
def test_no_end_is_told_where_nothing_limits_the_load(seed):
    """A motion that closes joints proves nothing."""
    model = planar_faces(Draw.of_seed(seed).recipe().scene(1)).model
    assert limit(model, model.strength, model.friction) == np.inf
    assert associative_end(model) is None


def test_what_crushes_under_a_load():
    """A column on f_c b = 0.4 m x f_c, with the weight 6272 N/m and so many times it from above."""
    column = stack_recipe(1, 5.0, (0.4, 0.8))
    parts = {"materials": {"default": Material(1e9, 0.2, 1960.0, 1e5)}}
    model = planar_faces(replace(column, parts=parts).scene(1)).model
    down = replace(model, live=model.dead)
    most = 0.4 * 1e5 / model.force - 1.0
    assert crushed_by(down, 0.999 * most) is None
    motion = crushed_by(down, 1.001 * most)
    assert motion is not None and float((1.0 + 1.001 * most) * model.dead @ motion) > 0.0
