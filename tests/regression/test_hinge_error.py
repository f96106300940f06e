"""What load factors owe to the mesh: the range of a mechanism, and hinges of other lengths."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from mpi4py import MPI

from fenics_contact import limit_load
from fenics_contact.console import summary
from fenics_contact.output.files import result_record
from tests.bank import BANK, Variant, coulomb, wall_recipe
from tests.property.scenes import Draw
from tests.quick import slow

#: Limits for point hinges: extrapolated from meshes graded to the hinges.
W4, W3 = 0.27952, 0.36195
#: Load factors of W4's mechanism, whatever the mesh and the stiffness.
RANGE = 0.2637363, 0.3069810


def wall(name, elements, **options):
    """The collapse of a wall with friction 0.65."""
    result = limit_load(
        wall_recipe(name, coulomb(0.65)).scene(elements, **{"fast": False, **options})
    )
    assert result.status == "limit"
    return result.positive


@pytest.mark.parametrize(
    "elements",
    [pytest.param(2, marks=pytest.mark.mpi), *slow(4, 8)],
)
def test_point_hinges_of_w4_from_every_mesh(elements):
    end = wall("W4", elements)
    assert end.hinges.points == pytest.approx(W4, abs=3e-5)
    assert end.hinges.length == pytest.approx(0.2 / elements)
    assert end.load_factor < end.hinges.physical < end.hinges.points
    assert (end.range.lower, end.range.upper) == pytest.approx(RANGE, abs=1e-6)


@pytest.mark.parametrize(
    "variant",
    [
        Variant(one_by_one=1),
        *(
            pytest.param(variant, marks=pytest.mark.slow)
            for variant in (
                Variant(degree=2),
                Variant(mirrored=True, angle=30.0),
                Variant(one_by_one=2, degree=2, quadrilaterals=True),
                Variant(one_by_one=3, quadrilaterals=True),
            )
        ),
    ],
    ids=str,
)
def test_point_hinges_of_w4_however_written(variant):
    end = wall("W4", 2, variant=variant)
    assert end.load_factor < W4 - 4e-3
    assert end.hinges.points == pytest.approx(W4, abs=5e-5)
    assert end.range.lower - 1e-6 <= end.load_factor < end.hinges.points <= end.range.upper


@pytest.mark.parametrize("elements", [2, *slow(4)])
def test_another_state_of_w3_that_no_uniform_mesh_shows(elements):
    end = wall("W3", elements)
    assert end.load_factor == pytest.approx(0.3558174, abs=1e-6)
    assert end.hinges.points == pytest.approx(W3, abs=1e-4)


@pytest.mark.parametrize("elements", slow(2, 4))
def test_w2_changes_from_more_halvings_on_than_meshes_show(elements):
    """Up to six nothing changes; a chain of states next to each other then rises."""
    end = wall("W2", elements)
    assert end.load_factor == pytest.approx(0.56288, abs=1e-5)
    assert end.hinges.points == pytest.approx(0.56446, abs=3e-5)


@pytest.mark.parametrize(
    "name",
    [
        *("arch 7 0.15", "block 0.2", "W1 tresca 2 kPa"),
        *slow("4x5 coulomb 0.4", "arch 15 0.15", "wedge 0.3"),
    ],
)
def test_statics_alone_give_load_factors_that_no_mesh_changes(name):
    """No second solve: as many factorisations as without."""
    result, other = (limit_load(BANK[name].scene(error=error)) for error in (True, False))
    end = result.positive
    assert end.range.is_one and end.range.lower == pytest.approx(end.load_factor, rel=1e-6)
    assert end.hinges.points == end.hinges.physical == result.load_factor
    assert result.factorizations == other.factorizations
    assert "the load factor does not depend on the mesh" in summary(result, verbose=True)
    fine = limit_load(BANK[name].scene(4, error=False, lowest=False, peak=False))
    assert fine.load_factor == pytest.approx(result.load_factor, rel=1e-5)


@pytest.mark.parametrize("name", ["4x5 coulomb 0.75", *slow("W1 coulomb 0.65", "4x6 coulomb 0.75")])
def test_hinges_that_change_nothing(name):
    result = limit_load(BANK[name].scene(fast=False))
    assert result.hinges.points == result.load_factor
    assert result.range.lower <= result.load_factor <= result.range.upper


def test_where_joints_crush_no_mesh_plays_a_part():
    law = replace(coulomb(0.65), compressive_strength=1e7)
    options = {"error": True, "accuracy": 1e-4, "lowest": False}
    coarse, fine = (limit_load(wall_recipe("W4", law).scene(n, **options)) for n in (1, 2))
    assert fine.load_factor == pytest.approx(coarse.load_factor, rel=1e-6)
    assert fine.hinges.points == fine.load_factor and fine.range is None
    assert len(fine.passes) == 1 and not fine.inaccurate
    assert "no error by a mesh" in summary(fine, verbose=True)


@pytest.mark.slow
def test_load_control_has_hinges_too():
    assert wall("W4", 2, control="load").hinges.points == pytest.approx(W4, abs=3e-5)


def test_reversed_load_and_record():
    recipe = wall_recipe("W4", coulomb(0.65))
    result = limit_load(recipe.scene(2, direction="negative", fast=False)).with_brackets()
    record = result_record(result)
    assert record["hinges"]["points"] == {"length": 0.0, "load_factor": result.hinges.points}
    assert record["hinges"]["status"] == "known" and record["hinges"]["reason"] is None
    assert result.hinges.points == pytest.approx(-W4, abs=3e-5)
    assert record["hinges"]["mesh"]["load_factor"] == result.load_factor_negative
    assert (record["range"]["lower"], record["range"]["upper"]) == pytest.approx(
        (-RANGE[1], -RANGE[0]), abs=1e-6
    )
    mirrored = recipe.scene(2, variant=Variant(mirrored=True), fast=False)
    told = summary(limit_load(mirrored), verbose=True)
    assert "load factor 0.2637, hinges of 100 mm as on this mesh; 0.27" in told
    assert "with 1 mm; 0.2795 with points" in told
    assert "mesh and stiffness: 0.2637 to 0.307 while this mechanism stays" in told


def test_open_points_with_a_strength_carry_shear():
    """Cohesion acts where nothing presses: this mechanism is not determinate."""
    recipe = Draw.of_seed(225).recipe()
    coarse, fine = limit_load(recipe.scene(2, fast=False)), limit_load(recipe.scene(6))
    change = abs(fine.load_factor / coarse.load_factor - 1.0)
    assert change > 1e-2
    assert coarse.range.lower <= fine.load_factor <= coarse.range.upper
    assert coarse.hinges.points == coarse.load_factor  # there are none


@pytest.mark.slow
def test_a_path_from_afar_that_is_begun_comes_to_its_end():
    """It takes a little more than is allowed, which would be lost just before its end."""
    result = limit_load(wall_recipe("W3", coulomb(1.0)).scene(2, fast=False))
    assert result.hinges.points == pytest.approx(W3, abs=1e-4)


@pytest.mark.slow
def test_what_costs_too_much_is_not_known_and_says_what_to_do():
    scene = wall_recipe("5x16", coulomb(0.6)).scene(4, fast=False, lowest=False)
    plain = replace(scene, solve=replace(scene.solve, error=False))
    result, alone = limit_load(scene), limit_load(plain)
    assert result.cost - alone.cost <= 0.5 * alone.cost
    if result.hinges.status == "not_known":
        assert "solve.error = true" in result.hinges.reason
        assert result.hinges.reason in summary(result, verbose=True)
        assert math.isnan(result.hinges.points)


@pytest.mark.slow
def test_running_bond_at_a_high_friction():
    """Where the load factor falls before it rises."""
    result = limit_load(BANK["10x10 coulomb 0.75"].scene(error=True))
    assert result.hinges.points == pytest.approx(0.52361, abs=2e-5)


def test_estimate_is_switched_off():
    result = limit_load(BANK["W1 coulomb 0.65"].scene(error=False, comm=MPI.COMM_SELF))
    assert result.positive.hinges is None
    assert result_record(result)["hinges"] is None
    assert "mesh:" not in summary(result, verbose=True)
