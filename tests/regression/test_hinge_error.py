"""What load factors owe to the mesh: hinges, and joints that slide over a length."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from mpi4py import MPI

from fenics_contact import Load, limit_load
from fenics_contact.collapse.strategy import COULOMB
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.console import summary
from fenics_contact.mesh_error.nearby import (
    Softened,
    collapse_and_rate,
    near,
    rates,
    same_mode,
)
from fenics_contact.output.files import result_record
from tests.bank import BANK, WEIGHT, Variant, coulomb, wall_recipe
from tests.core.problems import load_case
from tests.property.scenes import Draw

#: Limits for point hinges: extrapolated from meshes graded to the hinges.
W4, W3 = 0.27952, 0.36195


def wall_error(name, elements, **options):
    """Load factor and estimate of its error for a wall with friction 0.65."""
    result = limit_load(
        wall_recipe(name, coulomb(0.65)).scene(elements, **{"fast": False, **options})
    )
    assert result.status == "limit"
    return result.load_factor, result.positive.mesh_error


@pytest.mark.parametrize(
    "elements",
    [pytest.param(2, marks=pytest.mark.mpi), 4, pytest.param(8, marks=pytest.mark.slow)],
)
def test_point_hinges_of_w4_from_every_mesh(elements):
    load_factor, error = wall_error("W4", elements, error=True)
    assert error.load_factor_point_hinges == pytest.approx(W4, abs=3e-5)
    assert wall_error("W4", elements)[1].estimate == pytest.approx(error.estimate, rel=5e-3)
    assert error.hinge_error == pytest.approx(W4 / load_factor - 1.0, abs=2e-4)
    assert error.algebraic_error == 0.0  # nothing slides but hinges
    assert error.estimate == error.hinge_error
    assert not error.state_changes
    assert error.hinge_length == pytest.approx(0.2 / elements)


@pytest.mark.mpi
def test_rate_of_the_load_factor_with_shorter_hinges():
    """That of a state is the slope between states with a little less and a little more."""
    with load_case(wall_recipe("W4", coulomb(0.65)).scene(2)) as case:
        end = find_collapse(case, COULOMB["auto"], 1e-8)
        points = end.joints.hinges(case.discretization.joints.neighbours)
        states = [
            collapse_and_rate(case, end, Softened(points, m), near) for m in (29.0, 30.0, 31.0)
        ]
    (before, _), (_, rate), (after, _) = states
    slope = 0.5 * (after.load_factor - before.load_factor)
    assert slope > 2e-5
    assert rate == pytest.approx(slope, rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "variant", [Variant(degree=2), Variant(mirrored=True, angle=30.0)], ids=str
)
def test_point_hinges_of_w4_however_written(variant):
    _, error = wall_error("W4", 2, variant=variant)
    assert error.load_factor_point_hinges == pytest.approx(W4, abs=5e-5)


@pytest.mark.parametrize(
    "variant",
    [
        Variant(one_by_one=1),
        pytest.param(Variant(one_by_one=2, degree=2, quadrilaterals=True), marks=pytest.mark.slow),
        pytest.param(Variant(one_by_one=3, quadrilaterals=True), marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_w4_from_blocks_meshed_one_by_one_is_within_its_estimate(variant):
    load_factor, error = wall_error("W4", 2, variant=variant, error=True)
    assert load_factor < W4 - 5e-3
    assert error.estimate == pytest.approx(W4 / load_factor - 1.0, abs=2e-4)
    assert error.load_factor_point_hinges == pytest.approx(W4, abs=5e-5)
    assert not error.state_changes


@pytest.mark.parametrize("elements", [2, 4])
def test_another_state_of_w3_is_told_apart_from_the_error(elements):
    load_factor, error = wall_error("W3", elements, error=True)
    assert error.load_factor_point_hinges == pytest.approx(W3, abs=1e-4)
    first, *_, last = error.state_changes[0], *error.state_changes
    assert first.before == pytest.approx(load_factor, rel=1e-6)
    assert last.after == pytest.approx(W3, abs=1e-4)
    assert error.hinge_error < 2e-3


@pytest.mark.parametrize("elements", [2, 4])
def test_w2_changes_from_more_halvings_on_than_meshes_show(elements):
    """Up to six nothing changes; a chain of states next to each other then rises to 0.56407."""
    load_factor, error = wall_error("W2", elements)
    (change,) = error.state_changes
    assert change.before == load_factor == pytest.approx(0.56288, abs=1e-5)
    assert change.after == pytest.approx(0.56407, abs=2e-5)
    assert error.load_factor_point_hinges == pytest.approx(0.56446, abs=3e-5)
    with load_case(wall_recipe("W2", coulomb(0.65)).scene(elements)) as case:
        end = find_collapse(case, COULOMB["auto"], 1e-6)
        points = end.joints.hinges(case.discretization.joints.neighbours)
        few = collapse_and_rate(case, end, Softened(points, 4.0), near)[0]
        more = collapse_and_rate(case, few, Softened(points, 8.0), near)[0]
    assert few.load_factor == pytest.approx(load_factor, rel=1e-5)
    assert same_mode(rates(end.joints), rates(more.joints))
    assert load_factor + 2e-4 < more.load_factor < change.after


@pytest.mark.parametrize(
    "name",
    [
        *("W1 coulomb 0.65", "4x5 coulomb 0.4", "4x5 coulomb 0.75"),
        *("4x6 coulomb 0.75", "arch 7 0.15"),
        *("arch 15 0.15", "block 0.2", "wedge 0.3", "W1 tresca 2 kPa"),
    ],
)
def test_determinate_states_do_not_depend_on_hinges(name):
    result = limit_load(BANK[name].scene(fast=False))
    error = result.positive.mesh_error
    assert error.hinge_error == error.estimate == 0.0
    assert error.load_factor_point_hinges == result.load_factor
    assert error.algebraic_error == 0.0
    assert not error.state_changes
    assert "the load factor does not depend on the mesh" in summary(result)


@pytest.mark.parametrize(
    "name",
    [
        *("4x5 coulomb 0.75", "arch 15 0.15"),
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("W1 coulomb 0.65", "4x6 coulomb 0.75")
        ),
    ],
)
def test_finest_and_coarsest_mesh_agree_where_no_dependence_is_claimed(name):
    factors = []
    for elements in (2, 8):
        result = limit_load(BANK[name].scene(elements, tolerance=1e-8, fast=False))
        assert result.positive.mesh_error.estimate == 0.0
        factors.append(result.load_factor)
    assert factors[1] == pytest.approx(factors[0], rel=1e-7)


@pytest.mark.parametrize("name", ["4x5 coulomb 0.4", "arch 15 0.15", "block 0.2", "wedge 0.3"])
def test_statics_alone_tell_determinate_states(name):
    """No second solve: as many factorisations as without an estimate."""
    counts = {limit_load(BANK[name].scene(error=error)).factorizations for error in (True, False)}
    assert len(counts) == 1


def side_pushed(elements, **options):
    """W4 pushed by tractions on its side: its joints slide while they are closed over a length."""
    recipe = wall_recipe("W4", coulomb(0.65))
    recipe = replace(recipe, parts={"live": Load(traction={"left": (1e3, 0.0)})})
    return limit_load(recipe.scene(elements, **{"fast": False, **options}))


#: W4 pushed from the side: from degree 1 with 8 and 16, and degree 2 with 4 and 8 elements.
SIDE_PUSHED = 4.9658


@pytest.mark.parametrize("elements", [pytest.param(2, marks=pytest.mark.mpi), 4])
def test_algebraic_error_of_joints_that_slide(elements):
    result = side_pushed(elements)
    error = result.positive.mesh_error
    true = SIDE_PUSHED / result.load_factor - 1.0
    assert 0.7 * true < error.algebraic_error < 1.5 * true
    assert error.estimate == error.hinge_error + error.algebraic_error
    assert not error.state_changes


def test_algebraic_error_of_degree_2():
    result = side_pushed(2, variant=Variant(degree=2))
    true = SIDE_PUSHED / result.load_factor - 1.0
    assert 0.3 * true < result.positive.mesh_error.algebraic_error < 2.0 * true


def test_where_joints_crush_the_load_factor_depends_on_no_mesh():
    law = replace(coulomb(0.65), compressive_strength=1e7)
    options = {"error": True, "accuracy": 1e-4, "lowest": False}
    coarse, fine = (limit_load(wall_recipe("W4", law).scene(n, **options)) for n in (1, 2))
    assert fine.load_factor == pytest.approx(coarse.load_factor, rel=1e-6)
    assert fine.positive.mesh_error.estimate == 0.0
    assert len(fine.passes) == 1 and not fine.inaccurate
    assert "no error by a mesh" in summary(fine)


@pytest.mark.slow
def test_an_error_of_5_percent_is_told():
    """W4 under a load on its top: elements of degree 2 slide elsewhere."""
    recipe = wall_recipe("W4", coulomb(0.65))
    dead = replace(WEIGHT, traction={"top": (0.0, -2e4)})
    loaded = replace(recipe, parts={"dead": dead})
    coarse = limit_load(loaded.scene(4, error=True)).positive
    fine = limit_load(loaded.scene(16))
    far = coarse.load_factor / fine.load_factor - 1.0
    assert far > 0.04
    assert far < coarse.mesh_error.estimate < 1.5 * far


def test_load_control_and_reversed_load_have_an_estimate():
    recipe = wall_recipe("W4", coulomb(0.65))
    error = limit_load(recipe.scene(2, control="load", fast=False)).positive.mesh_error
    assert error.load_factor_point_hinges == pytest.approx(W4, abs=3e-5)


def test_reversed_load_and_record():
    recipe = wall_recipe("W4", coulomb(0.65))
    mirrored = limit_load(recipe.scene(2, variant=Variant(mirrored=True), fast=False))
    result = limit_load(recipe.scene(2, direction="negative", fast=False))
    factors = [end.mesh_error.load_factor_point_hinges for end in result.ends.values()]
    assert factors == pytest.approx([-W4], abs=3e-5)
    record = result_record(mirrored)["discretization"]
    assert record["load_factor_point_hinges"] == pytest.approx(W4, abs=3e-5)
    assert record["algebraic_error"] == 0.0
    assert record["state_changes"] == []
    assert "0.2637 for hinges of 100 mm; 0.2795 for point hinges" in summary(mirrored)


def test_open_points_with_a_strength_carry_shear():
    """Cohesion acts where nothing presses: this mechanism is not determinate."""
    recipe = Draw.of_seed(225).recipe()
    coarse, fine = limit_load(recipe.scene(2, error=True)), limit_load(recipe.scene(6, error=False))
    change = abs(fine.load_factor / coarse.load_factor - 1.0)
    assert change > 1e-2
    estimate = coarse.positive.mesh_error.estimate
    assert math.isnan(estimate) or estimate > 0.5 * change


#: Largest cost of an estimate that nobody asked for, and of one that is asked for.
UNASKED, ASKED = 24.0, 120.0


@pytest.mark.parametrize("name", ["W2 coulomb 0.65", "10x10 coulomb 0.75"])
def test_what_costs_too_much_is_not_known_and_says_what_to_do(name):
    scene = BANK[name].scene(fast=False)
    result, alone = limit_load(scene), limit_load(BANK[name].scene(error=False))
    structure = result.factorizations - result.mode_factorizations
    assert 0 < structure - (alone.factorizations - alone.mode_factorizations) <= UNASKED
    error, record = result.positive.mesh_error, result_record(result)["discretization"]
    assert bool(error.unknown) == math.isnan(error.estimate)
    assert record["unknown"] == (error.unknown or None)
    if error.unknown:
        assert "limit of 24 factorisations" in error.unknown
        assert "solve.error = true" in error.unknown
        assert error.unknown in summary(result)


def test_an_estimate_that_is_asked_for_goes_on():
    """Running bond at a high friction, where the load factor falls before it rises."""
    result = limit_load(BANK["10x10 coulomb 0.75"].scene(error=True))
    error = result.positive.mesh_error
    assert error.load_factor_point_hinges == pytest.approx(0.52361, abs=2e-5)
    assert 0.0 < error.estimate < 1e-3
    assert not error.unknown
    structure = result.factorizations - result.mode_factorizations
    assert structure <= 20 + ASKED


def test_factorisations_for_the_other_degree_are_counted():
    result = side_pushed(2)
    alone = side_pushed(2, error=False)
    assert result.positive.mesh_error.algebraic_error > 0.0
    assert result.factorizations >= alone.factorizations + 8


def test_estimate_is_switched_off():
    result = limit_load(BANK["W1 coulomb 0.65"].scene(error=False, comm=MPI.COMM_SELF))
    assert result.positive.mesh_error is None
    assert result_record(result)["discretization"] is None
    assert "mesh:" not in summary(result)
