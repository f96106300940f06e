"""Load factors do not depend on the number of ranks, nor on what each of them holds.

Run by `make test-mpi`: all ranks solve a scene together, and each of them once more alone.
"""

from __future__ import annotations

import math
from typing import Any

import pytest
from mpi4py import MPI

from fenics_contact import (
    BlockMesh,
    EdgeForce,
    JointLaw,
    Load,
    Material,
    Scene,
    SolveOptions,
    limit_load,
)
from fenics_contact.builders import bridge
from fenics_contact.meshing import model_from_arrays
from tests.bank import BANK, Recipe, Variant, block_recipe, coulomb, outlined
from tests.drawing import rectangle

pytestmark = [
    pytest.mark.mpi,
    pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="needs several ranks"),
]

EXACT, AGREED = 1e-9, 1e-8


def one_cell(elements: int, quadrilaterals: bool) -> Any:
    """A block of 1 m x 1 m that is one cell."""
    corners = rectangle(0.0, 0.0, 1.0, 1.0)
    return model_from_arrays(corners, {"blocks": [(0, 1, 2, 3)]}, {"base": [(0, 1)]})


#: Name: scene, and how it is written.
SCENES: dict[str, tuple[Recipe, Variant]] = {
    name: (BANK[name].recipe, Variant())
    for name in (
        *("W1 tresca 2 kPa", "W1 coulomb 0.65", "W3 coulomb 0.65", "W4 coulomb 0.65"),
        *("10x10 coulomb 0.75", "arch 15 0.15", "wedge 0.3"),
    )
}
SCENES |= {
    "quadratic": (BANK["W1 coulomb 0.65"].recipe, Variant(degree=2, quadrilaterals=True)),
    "quadratic tresca": (BANK["W1 tresca 2 kPa"].recipe, Variant(degree=2)),
    "meshed one by one": (BANK["W3 coulomb 0.65"].recipe, Variant(one_by_one=1)),
    "meshed one by one, quadratic": (
        BANK["arch 15 0.15"].recipe,
        Variant(one_by_one=1, degree=2, quadrilaterals=True),
    ),
    "renumbered": (BANK["W3 coulomb 0.65"].recipe, Variant(seed=3)),
    # One body, which is cut where it has many cells: some ranks own no joint point then.
    "block of many cells": (block_recipe(0.4, 2.0, 0.3), Variant()),
    "tall block": (block_recipe(0.2, 4.0, 0.3), Variant()),
    # Fewer bodies and cells than ranks: some own nothing.
    "block of four cells": (outlined([rectangle(0, 0, 0.4, 1)], coulomb(0.3), 1.0), Variant()),
    "block of one cell": (Recipe(one_cell, coulomb(0.3)), Variant()),
}


@pytest.mark.parametrize("name", SCENES)
def test_ranks_agree_with_one(name):
    recipe, variant = SCENES[name]
    alone = limit_load(recipe.scene(comm=MPI.COMM_SELF, variant=variant, tolerance=EXACT))
    together = limit_load(recipe.scene(variant=variant, tolerance=EXACT))
    assert together.status == alone.status == "limit"
    assert together.load_factor == pytest.approx(alone.load_factor, rel=AGREED)
    assert len(set(MPI.COMM_WORLD.allgather(together.load_factor))) == 1


@pytest.mark.parametrize(
    ("name", "variant"),
    [("W4 coulomb 0.65", Variant()), ("W3 coulomb 0.65", Variant(one_by_one=1))],
    ids=["nodes match", "nodes do not match"],
)
def test_ranks_agree_on_the_estimate(name, variant):
    recipe = BANK[name].recipe
    alone, together = (
        limit_load(recipe.scene(comm=comm, variant=variant, tolerance=EXACT, error=True)).positive
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    assert together.hinges.points == pytest.approx(alone.hinges.points, rel=1e-6)
    assert together.range.lower == pytest.approx(alone.range.lower, rel=1e-6)
    assert together.range.upper == pytest.approx(alone.range.upper, rel=1e-6)


@pytest.mark.parametrize(
    "name", ["tilting table 17.5", "wedge 0.5778 near locking", "overhang -0.001"]
)
def test_ranks_agree_that_there_is_no_limit(name):
    result = limit_load(BANK[name].scene())
    assert BANK[name].right(result.status, result.load_factor)


@pytest.mark.parametrize("method", ["fixed-point", "monolithic", "splitting", "active-set"])
def test_every_method_on_ranks(method):
    entry = BANK["stack of 2 0.7"]
    result = limit_load(entry.scene(method=method))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(entry.expected, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("stack of 2 0.7", {"control": "load"}),
        ("W1 tresca 2 kPa", {"states": "lowest"}),
        ("W1 tresca 2 kPa", {"direction": "both"}),
    ],
    ids=str,
)
def test_every_option_on_ranks(name, options):
    recipe = BANK[name].recipe
    alone = limit_load(recipe.scene(comm=MPI.COMM_SELF, tolerance=EXACT, **options))
    together = limit_load(recipe.scene(tolerance=EXACT, **options))
    assert together.load_factor == pytest.approx(alone.load_factor, rel=AGREED)
    negative = together.load_factor_negative, alone.load_factor_negative
    assert negative[0] == pytest.approx(negative[1], rel=AGREED, nan_ok=True)
    assert math.isnan(negative[0]) == ("direction" not in options)


def test_a_state_at_more_work_does_not_replace_a_verified_one():
    """At large works rounding, which differs with the ranks, leads this bridge to other states."""
    axle = EdgeForce((0.0, -1e4), x=2.5, width=0.3)
    law = JointLaw("coulomb", friction=0.7)
    found = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        model = bridge(6.0, rise=1.5, ring=0.4).mesh(size=0.2) if comm.rank == 0 else None
        scene = Scene(
            BlockMesh.from_model(model, comm=comm),
            {"default": Material(young=5e9, poisson=0.2, density=2000.0)},
            dead=Load(body=(0.0, -9.81)),
            live=Load(force={"axle": axle}),
            joints={"default": law},
            foundations={"base": law},
            solve=SolveOptions(error=False),
        )
        found.append(limit_load(scene))
    assert [result.status for result in found] == ["limit", "limit"]
    assert found[1].load_factor == pytest.approx(found[0].load_factor, rel=AGREED)


def test_some_ranks_hold_nothing():
    """The scene is what it is for."""
    recipe, variant = SCENES["block of one cell"]
    cells = recipe.scene(variant=variant).mesh.cell_groups.size
    assert sorted(MPI.COMM_WORLD.allgather(cells)) == [0] * (MPI.COMM_WORLD.size - 1) + [1]
