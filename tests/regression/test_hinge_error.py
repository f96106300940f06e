"""What load factors owe to the length of hinges."""

from __future__ import annotations

import math

import pytest
from mpi4py import MPI

from fenics_contact import limit_load
from fenics_contact.console import summary
from fenics_contact.output.files import result_record
from tests.bank import BANK, Variant, coulomb, wall_recipe

#: Limits for point hinges: extrapolated from meshes graded to the hinges.
W4, W3 = 0.27952, 0.36195


def wall_error(name, elements, **options):
    """Load factor and estimate of its error for a wall with friction 0.65."""
    result = limit_load(wall_recipe(name, coulomb(0.65)).scene(elements, **options))
    assert result.status == "limit"
    return result.load_factor, result.positive.mesh_error


@pytest.mark.mpi
@pytest.mark.parametrize("elements", [2, 4, pytest.param(8, marks=pytest.mark.slow)])
def test_point_hinges_of_w4_from_every_mesh(elements):
    load_factor, error = wall_error("W4", elements)
    assert error.load_factor_point_hinges == pytest.approx(W4, abs=3e-5)
    assert error.hinge_error == pytest.approx(W4 / load_factor - 1.0, abs=2e-4)
    assert error.estimate == error.hinge_error
    assert not error.state_changes
    assert error.hinge_length == pytest.approx(0.2 / elements)


@pytest.mark.slow
@pytest.mark.parametrize(
    "variant", [Variant(degree=2), Variant(mirrored=True, angle=30.0)], ids=str
)
def test_point_hinges_of_w4_however_written(variant):
    _, error = wall_error("W4", 2, variant=variant)
    assert error.load_factor_point_hinges == pytest.approx(W4, abs=5e-5)


@pytest.mark.parametrize("elements", [2, 4])
def test_another_state_of_w3_is_told_apart_from_the_error(elements):
    load_factor, error = wall_error("W3", elements)
    assert error.load_factor_point_hinges == pytest.approx(W3, abs=1e-4)
    first = error.state_changes[0]
    assert first.before == pytest.approx(load_factor, rel=1e-6)
    assert first.after > 0.361
    assert error.hinge_error < 2e-3


@pytest.mark.parametrize(
    "name",
    [
        *("W1 coulomb 0.65", "W2 coulomb 0.65", "4x5 coulomb 0.4", "4x5 coulomb 0.75"),
        *("arch 15 0.15", "block 0.2", "wedge 0.3", "W1 tresca 2 kPa"),
    ],
)
def test_determinate_states_do_not_depend_on_hinges(name):
    result = limit_load(BANK[name].scene())
    error = result.positive.mesh_error
    assert error.hinge_error == error.estimate == 0.0
    assert error.load_factor_point_hinges == result.load_factor
    assert not error.state_changes


def test_reversed_load_and_record():
    recipe = wall_recipe("W4", coulomb(0.65))
    mirrored = limit_load(recipe.scene(2, variant=Variant(mirrored=True)))
    result = limit_load(recipe.scene(2, direction="negative"))
    factors = [end.mesh_error.load_factor_point_hinges for end in result.ends.values()]
    assert factors == pytest.approx([-W4], abs=3e-5)
    record = result_record(mirrored)["discretization"]
    assert record["load_factor_point_hinges"] == pytest.approx(W4, abs=3e-5)
    assert math.isnan(record["algebraic_error"])
    assert record["state_changes"] == []
    assert "0.2637 for hinges of 100 mm; 0.2795 for point hinges" in summary(mirrored)


def test_estimate_is_switched_off():
    result = limit_load(BANK["W1 coulomb 0.65"].scene(error=False, comm=MPI.COMM_SELF))
    assert result.positive.mesh_error is None
    assert result_record(result)["discretization"] is None
    assert "hinges" not in summary(result)
