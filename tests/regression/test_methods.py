"""The methods against each other and against what is known; what they leave in result.json."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from fenics_contact import InputError, LimitLoad, OutputOptions, Scene, SolveOptions, limit_load
from tests.bank import BANK, coulomb, wall_recipe
from tests.quick import each_once, slow, slow_rows
from tests.system.program import ROOT, run, run_here, write_scene
from tests.system.program import result as outcome

METHODS = ("auto", "fixed-point", "monolithic", "splitting", "active-set")
JOINT_METHODS = ("splitting", "active-set")  # whose unknowns are joint forces
WALLS = ("W1", "W2", "W3", "W4")

#: What a verified result may miss at most, relative to typical sizes.
RESIDUALS = dict.fromkeys(("equilibrium", "penetration", "complementarity"), 1e-6)
RESIDUALS |= dict.fromkeys(("friction", "slip_direction"), 1e-5)


def solved(scene: Scene) -> LimitLoad:
    """The result, which must be verified. Its error estimate has tests of its own."""
    result = limit_load(replace(scene, solve=replace(scene.solve, error=False)))
    assert result.status == "limit"
    return result


def recorded(scene: Scene, folder: Path) -> dict[str, Any]:
    """result.json of a verified result."""
    options = OutputOptions(paraview=False, pictures=False, capacity=scene.output.capacity)
    solved(replace(scene, output=options)).write(folder)
    record = json.loads((folder / "result.json").read_text())
    assert (record["status"], record["failures"]) == ("limit", [])
    return record


@pytest.mark.parametrize(
    ("name", "method"),
    each_once(["W1 tresca 2 kPa", "wedge 0.2", "stack of 2 0.7"], METHODS)
    + slow_rows(*product(["4x5 coulomb 0.75"], METHODS)),
)
def test_every_method_finds_what_is_known(name, method, tmp_path):
    record = recorded(BANK[name].scene(method=method), tmp_path)
    assert record["load_factor"] == pytest.approx(BANK[name].expected, rel=3e-5)
    residuals = {law: record["residuals"][law] for law in RESIDUALS}
    assert all(residuals[law] <= most for law, most in RESIDUALS.items()), residuals


@pytest.mark.parametrize(
    ("name", "friction"),
    [
        pytest.param(name, f, marks=pytest.mark.slow)
        for name, f in (("4x4", 100.0), *product(("W1", "W2"), (3.0, 10.0)))
    ],
)
def test_high_friction_has_a_verified_state_within_its_bracket(name, friction):
    result = solved(wall_recipe(name, coulomb(friction)).scene(4))
    result = result.hold_against_brackets()
    assert result.status == "limit"
    lower, upper = result.bounds.lower, result.bounds.upper
    assert lower * (1.0 - 1e-6) <= result.load_factor <= upper * (1.0 + 1e-6)
    assert result.cost <= 750.0  # of both paths, which are lost, and of the faces


@pytest.mark.parametrize("method", JOINT_METHODS)
def test_arch_by_joint_forces(method):
    result = solved(BANK["arch 7 0.15"].scene(method=method))
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=2e-5)


@pytest.mark.parametrize("name", ["W1", *slow("W2", "W4")])
def test_fixed_point_alone_ends_in_the_same_state(name, tmp_path):
    wall = BANK[f"{name} coulomb 0.65"]
    record = recorded(wall.scene(method="fixed-point"), tmp_path)
    assert record["method"] == "fixed-point"
    assert record["load_factor"] == pytest.approx(solved(wall.scene()).load_factor, rel=1e-6)
    assert 0.0 < record["iterations"]["contraction"] < 1.0
    first, second, *_ = record["iterations"]["history"]
    assert first["contraction"] is None
    assert second["contraction"] * first["bound_change"] == pytest.approx(second["bound_change"])
    page = (ROOT / "docs" / "fixed_point.md").read_text()
    assert [key for key in {*record["iterations"], *second} if f"`{key}`" not in page] == []


@pytest.mark.parametrize(
    ("name", "friction", "elements", "most"),
    [
        ("W3", 0.65, 2, 18),
        pytest.param("W4", 0.65, 2, 30, marks=pytest.mark.slow),
        pytest.param("W2", 1.0, 1, 50, marks=pytest.mark.slow),
    ],
)
def test_fixed_point_ends_where_its_certificate_says_so(name, friction, elements, most):
    """The last digits of the friction bound, which the load factor does not need, may take 400."""
    recipe = wall_recipe(name, coulomb(friction))
    result = solved(recipe.scene(elements, method="fixed-point", fast=True))
    (history,) = result.positive.history
    assert len(history.steps) <= most
    assert history.steps[-1].contraction == pytest.approx(
        history.steps[-1].bound_change / history.steps[-2].bound_change
    )
    known = {"W3": 0.3558174, "W4": 0.2637363, "W2": 0.6056877}
    assert result.load_factor == pytest.approx(known[name], rel=1e-6)


@pytest.mark.parametrize("strength", [2, *slow(0.5, 8)])
def test_static_and_kinematic_bounds_meet_with_given_friction(strength, tmp_path):
    record = recorded(BANK[f"W1 tresca {strength} kPa"].scene(), tmp_path)
    assert record["static_factor"] == pytest.approx(record["kinematic_factor"], rel=1e-6)


# Options of PETSc


@pytest.mark.parametrize(
    ("options", "shown"),
    [
        (
            "-normal_tao_type bncg -normal_tao_view -shear_snes_type vinewtonrsls"
            " -shear_snes_view -joint_tao_view -hold_ksp_view",
            [
                "Tao Object: (normal_) .*\n  type: bncg",
                "(shear_) .*\n  type: vinewtonrsls",
                "Tao Object: (joint_) ",
                "KSP Object: (hold_) ",
            ],
        ),
        (
            "-fenics_contact_qp_tao_type bnls -shear_tao_view -options_left -normal_tao_typ tron",
            ["(shear_) .*\n  type: bnls", r"name:-normal_tao_typ "],
        ),
    ],
)
def test_petsc_options_of_both_subproblems(options, shown, tmp_path, monkeypatch):
    """The second ones show, too, that an option that no solver reads is named."""
    write_scene(tmp_path, {"solve.method": "splitting", "output.pictures": False}, mesh="wall")
    monkeypatch.setenv("PETSC_OPTIONS", options)
    found = run(["solve", "scene.toml", "--fast"], tmp_path)
    assert found.code == 0, found.out + found.err
    assert [
        one for one in shown if not re.search(re.sub(r"[()]", r"\\\g<0>", one), found.out)
    ] == []
    assert found.out.count("name:-") == options.count("-options_left")
    assert outcome(tmp_path / "scene")["load_factor"] == pytest.approx(0.3, rel=1e-5)


def test_a_solver_that_petsc_does_not_know_is_named(tmp_path, monkeypatch):
    write_scene(tmp_path, {"solve.method": "splitting", "output.pictures": False}, mesh="wall")
    monkeypatch.setenv("PETSC_OPTIONS", "-shear_tao_type fast")
    found = run(["solve", "scene.toml", "--fast"], tmp_path)
    assert found.code == 2
    assert "-shear_tao_type fast" in found.err


# A relaxation of the user's


def test_a_relaxation_needs_the_fixed_point():
    with pytest.raises(InputError, match="relaxation needs method = 'fixed-point' or"):
        SolveOptions(relaxation=0.5)
    with pytest.raises(InputError, match=r"must lie in 0 \.\.\. 2"):
        SolveOptions(method="fixed-point", relaxation=2.5)


@pytest.mark.parametrize("method", ["fixed-point", "splitting"])
def test_a_given_relaxation_is_that_of_all_passes(method, tmp_path, capsys):
    options = {"solve.method": method, "solve.relaxation": 0.8, "output.pictures": False}
    scene = write_scene(tmp_path, options, mesh="wall")
    assert run_here(["solve", scene, "--fast"], capsys).code == 0
    found = outcome(tmp_path / "scene")
    assert found["load_factor"] == pytest.approx(0.3, rel=1e-5)
    assert {one["relaxation"] for one in found["iterations"]["history"]} == {0.8}


# Load control


@pytest.mark.parametrize("name", ["W3", *slow("W1", "W2", "W4")])
def test_raising_the_load_ends_at_the_linear_program_with_given_friction(name, tmp_path):
    record = recorded(BANK[f"{name} tresca 2 kPa"].scene(control="load"), tmp_path)
    factor, path = record["load_factor"], record["continuation"]
    assert factor == pytest.approx(record["bounds"]["upper"], rel=1e-6)
    assert factor * (1.0 - 2e-4) <= path["equilibrium_up_to"] <= factor * (1.0 + 1e-6)


@pytest.mark.parametrize("name", slow("W1", "W2", "W3", "W4"))
def test_raising_the_load_ends_at_the_same_collapse(name, tmp_path):
    wall = BANK[f"{name} coulomb 0.65"]
    record = recorded(wall.scene(control="load"), tmp_path)
    assert record["load_factor"] == pytest.approx(solved(wall.scene()).load_factor, rel=1e-5)
    # It lies between the last load factor with equilibrium and the first without.
    low, high = (record["continuation"][key] for key in ("equilibrium_up_to", "none_found_at"))
    assert low <= record["load_factor"] * (1.0 + 1e-5)
    assert high >= record["load_factor"] * (1.0 - 1e-5)
    assert high - low <= 2e-4 * low


@pytest.mark.parametrize("name", slow("W4", "W2"))
def test_slip_measured_by_load_steps_ends_in_a_verified_state(name):
    wall = BANK[f"{name} coulomb 0.65"]
    stepped = solved(wall.scene(control="load", slip="load-steps"))
    assert stepped.load_factor <= stepped.bounds.upper
    # Another path, another state perhaps, but not far away.
    assert stepped.load_factor == pytest.approx(wall.expected, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["W2", "W4"])
def test_load_factor_is_on_the_plateau_of_the_capacity_curve(name, tmp_path):
    """With the last tenths of the prescribed work the load factor does not change any more."""
    scene = BANK[f"{name} coulomb 0.65"].scene()
    record = recorded(replace(scene, output=OutputOptions(capacity=8)), tmp_path)
    with (tmp_path / "capacity.csv").open(newline="") as file:
        *_, before, last = csv.DictReader(file)
    assert float(before["work"]) < 0.9 * float(last["work"])
    for point in (before, last):
        assert float(point["load_factor"]) == pytest.approx(record["load_factor"], rel=1e-6)


# Several collapse states


def test_lowest_of_several_states(tmp_path):
    """W3 has a state at 0.3558, and the monolithic method ends in one at 0.384."""
    wall = BANK["W3 coulomb 0.65"]
    record = recorded(wall.scene(states="lowest"), tmp_path)
    assert record["load_factor"] == pytest.approx(wall.expected, rel=1e-4)
    factors = [state["load_factor"] for state in record["states"]]
    assert record["load_factor"] == factors[0] == min(factors)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.4, 0.6, 0.75, 1.0])
@pytest.mark.parametrize("name", [*WALLS, "8x8"])
def test_methods_agree_on_a_verified_state_over_friction(name, friction):
    """The fixed point and the equations with the bound in them: both inside the bracket."""
    recipe = wall_recipe(name, coulomb(friction))
    for method in ("auto", "monolithic", "fixed-point"):
        result = solved(recipe.scene(method=method))
        assert 0.0 < result.load_factor <= result.bounds.upper * (1.0 + 1e-8), method


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.4, 0.75])
def test_a_loose_tolerance_is_kept_and_saves_factorisations(friction):
    recipe = wall_recipe("20x20", coulomb(friction))
    exact, loose = (limit_load(recipe.scene(2, tolerance=one)) for one in (1e-6, 1e-3))
    assert exact.status == loose.status == "limit"
    assert loose.load_factor == pytest.approx(exact.load_factor, rel=1e-3)
    assert loose.positive.certificate.gap <= 1e-3
    assert loose.factorizations < exact.factorizations
