"""The peak of the loading path: found, none and not known; mirror, sign, and load control."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fenics_contact import Load, Material, OutputOptions, Scene, SolveOptions, limit_load
from fenics_contact.answers.peak import NOT_ASKED
from fenics_contact.console import summary
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.equilibrium import equilibrium
from fenics_contact.meshing import polygons
from fenics_contact.results.history import Peak
from fenics_contact.sweeps.points import KeptStructure, solve
from tests.bank import BANK, GRAVITY, block_recipe, coulomb, tresca, wall_recipe
from tests.helpers import mesh_of
from tests.property.scenes import Draw
from tests.quick import slow

A, B, C, D = (0.454286, 0.399982), (0.611674, 0.675854), (0.441754, 0.887746), (0.0, 0.429899)
E, F, G = (0.0, 0.844656), (0.574139, 0.0), (1.135223, 0.687643)
LOW, CUT, RIGHT, TOP = (0.0, 0.0), (0.540937, 1.389453), (1.135223, 0.0), (0.0, 1.389453)
#: Five blocks of a cut rectangle, corners in m, the first and the last of lighter stone.
RUBBLE = (
    [E, C, CUT, TOP],
    [LOW, F, A, D],
    [D, A, B, C, E],
    [B, G, (1.135223, 1.389453), CUT, C],
    [F, RIGHT, G, B, A],
)
#: Its load factor and its peak; load control finds equilibrium up to the peak, and none beyond.
COLLAPSE, PEAK = 0.3723447, 0.49228


def rubble(mirrored: bool = False, **options: Any) -> Scene:
    """The blocks, pushed to the right by a multiple of their weight; mirrored, to the left."""
    sign = -1.0 if mirrored else 1.0
    outlines = [[(sign * x, y) for x, y in block] for block in RUBBLE]
    names = ["light", "heavy", "heavy", "heavy", "light"]
    return Scene(
        mesh_of(polygons(outlines, 0.4, names)),
        {"heavy": Material(2.83e9, 0.22, 2737.0), "light": Material(2.83e9, 0.0, 1089.0)},
        live=Load((GRAVITY, 0.0)),
        dead=Load((0.0, -GRAVITY)),
        joints={"default": coulomb(0.638)},
        foundations={"base": coulomb(0.825)},
        solve=SolveOptions(error=False, **options),
        output=OutputOptions(paraview=False, pictures=False),
    )


@pytest.fixture(scope="module")
def result():
    return limit_load(rubble(peak=True))


def test_peak_is_found_above_the_collapse(result):
    peak = result.positive.peak
    assert result.load_factor == pytest.approx(COLLAPSE, rel=1e-6)
    assert peak.status == "found"
    assert peak.load_factor == pytest.approx(PEAK, rel=3e-4)
    assert peak.load_factor < peak.not_found_at < 1.001 * peak.load_factor
    with Discretization(result.scene) as made:
        unit = np.abs(made.problem.live).sum()
    assert peak.displacement_m == pytest.approx(peak.work / unit)
    assert 0.0 < peak.work < result.positive.state.work
    assert "at least 0.492" in summary(result, verbose=True)


@pytest.mark.slow
def test_equilibrium_agrees_with_the_peak(result):
    peak = result.positive.peak.load_factor
    assert equilibrium(rubble(), 0.999 * peak).status == "equilibrium"
    assert equilibrium(rubble(), 1.001 * peak).status != "equilibrium"
    assert equilibrium(rubble(), result.positive.peak.not_found_at).status != "equilibrium"


@pytest.mark.slow
def test_mirror_image_and_reversed_load_have_the_peak_of_the_opposite_sign(result):
    scene = rubble(mirrored=True, peak=True, direction="negative")
    mirrored = limit_load(scene)
    peak, given = mirrored.negative.peak, result.positive.peak
    assert mirrored.load_factor_negative == pytest.approx(-COLLAPSE, rel=1e-6)
    assert peak.load_factor == pytest.approx(-given.load_factor, rel=3e-4)
    assert peak.not_found_at == pytest.approx(-given.not_found_at, rel=3e-4)
    assert peak.displacement_m > 0.0 > peak.state.load_factor


def test_none_on_a_path_that_rises_to_its_plateau():
    result = limit_load(BANK["W1 coulomb 0.65"].scene(elements=1, peak=True, error=False))
    assert result.positive.peak == Peak("none")
    assert "peak: none" in summary(result, verbose=True)


def test_a_peak_that_larger_products_hide():
    """The path to this collapse stays below it; with products zero it is above."""
    draw = Draw.of_seed(21)
    end = limit_load(draw.recipe().scene(draw.elements, fast=False, error=False)).positive
    assert max(point.load_factor for point in end.trace) < end.load_factor
    assert end.peak.status == "found"
    assert end.peak.load_factor == pytest.approx(0.3112, rel=1e-3)


@pytest.mark.parametrize("name", ["W2", *slow("10x10")])
def test_none_by_the_path_to_the_collapse_without_a_factorisation(name):
    options = {"fast": False, "error": False, "lowest": False}
    recipe = wall_recipe(name, coulomb(0.65))
    result, alone = (limit_load(recipe.scene(2, peak=peak, **options)) for peak in (None, False))
    assert result.positive.peak == Peak("none")
    assert result.factorizations == alone.factorizations
    assert result.load_factor == alone.load_factor


def test_not_looked_for():
    given = replace(block_recipe(0.4, 1.0, 0.7), law=tresca(1e4)).scene(1)
    assert limit_load(given).positive.peak is None
    off = limit_load(rubble(peak=False)).positive.peak
    assert (off.status, off.reason) == ("not_known", NOT_ASKED)
    assert "solve.peak = true" in NOT_ASKED
    other = limit_load(rubble(method="fixed-point")).positive.peak
    assert other is None or (other.status == "not_known" and "method" in other.reason)
    with_structure = KeptStructure()
    try:
        swept = solve(rubble(), with_structure).positive.peak
    finally:
        with_structure.close()
    assert swept.reason == NOT_ASKED


def test_files_hold_the_peak_and_the_curve_passes_it(result, tmp_path):
    result = result.with_capacity(points=6)
    result.write(tmp_path)
    record = json.loads((tmp_path / "result.json").read_text())
    given = result.positive.peak
    assert record["peak"]["status"] == "found"
    for name in ("load_factor", "not_found_at", "work", "displacement_m"):
        assert record["peak"][name] == getattr(given, name)
    found = [point.load_factor for point in result.capacity if point.converged]
    assert given.load_factor in found
    assert record["capacity"]["load_factor"] == pytest.approx(found[-1])
    assert record["capacity"]["points"] + record["capacity"]["not_found"] == 7
    works = [point.work for point in result.capacity]
    assert works == sorted(works)
