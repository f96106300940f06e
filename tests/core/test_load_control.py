"""Load factors raised step by step, and the capacity curve."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fenics_contact import Load, SolveOptions, limit_load
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.load_control import capacity_curve, raise_load
from fenics_contact.collapse.strategy import COULOMB, Strategy
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.results.history import CapacityPoint
from fenics_contact.results.result import Collapse
from fenics_contact.search_options import SEARCH
from tests.bank import BANK, GRAVITY, block_recipe, coulomb, wall_recipe
from tests.core.problems import load_case, prepared

block = prepared(block_recipe(0.4, 1.0, 0.3))


def raised(case: LoadCase, strategy: Strategy = COULOMB["auto"], **options: str) -> Collapse:
    return raise_load(case, strategy, SolveOptions(control="load", **options))


@pytest.mark.parametrize("slip", ["stress-free", "load-steps"])
@pytest.mark.parametrize("name", ["block 0.2", "block 0.7", "wedge 0.3"])
def test_path_brackets_the_limit_load(name, slip):
    item = BANK[name]
    with load_case(item.scene(elements=1)) as case:
        found, unit = raised(case, slip=slip), case.problem.sum(np.abs(case.problem.live))
        path, upper = found.path, min(found.path.upper, case.blocks.limit())
    assert found.status == "limit"
    assert found.load_factor == pytest.approx(item.expected, rel=1e-6)
    assert path.lower <= item.expected * (1 + 1e-6) <= path.upper * (1 + 1e-5)
    assert upper - path.lower <= 1.01e-4 * path.lower
    factor, moved, work = np.transpose(
        [(step.load_factor, step.displacement, step.work) for step in path.steps]
    )
    assert factor[0] == 0.0 and factor[-1] == path.lower
    assert np.all(np.diff(factor) > 0.0) and np.all(np.diff(moved) > 0.0)
    assert work == pytest.approx(unit * moved, rel=1e-12)


# ---- with equilibrium at made-up load factors


# ---- the capacity curve


@pytest.mark.parametrize("name", ["block", "W4"])
def test_capacity_curve_rises_to_the_limit_load_and_ends_beyond_the_onset(name):
    recipe = block_recipe(0.4, 1.0, 0.7) if name == "block" else wall_recipe("W4", coulomb(0.4))
    told: list[tuple[int, int, CapacityPoint]] = []
    with load_case(recipe.scene(1)) as case:
        end = find_collapse(case, COULOMB["auto"], 1e-6)
        curve = capacity_curve(case, end, 8, lambda *args: told.append(args))
        unit = case.problem.sum(np.abs(case.problem.live))
    assert told == [(number, 8, point) for number, point in enumerate(curve, 1)]
    factors, works = np.transpose([(point.load_factor, point.work) for point in curve])
    assert np.all(np.diff(factors) > -1e-6 * end.load_factor) and np.all(np.diff(works) > 0.0)
    assert factors[0] < 0.7 * end.load_factor
    assert factors[-1] == pytest.approx(end.load_factor, rel=1e-5)
    assert works[-1] == pytest.approx(SEARCH.beyond_onset * end.state.work, rel=5e-3)
    assert works == pytest.approx([unit * point.displacement for point in curve])


@pytest.mark.slow
@pytest.mark.parametrize("lean", [0.05, 0.2])
def test_live_load_that_relieves_a_sliding_joint_does_negative_work(lean):
    """The block slides down its slope of 20 degrees as the live load g (-lean, 1) lifts it.

    With friction 0.5: 0.5 (cos 20 - lambda) = sin 20 - lean lambda.
    """
    sine, cosine = math.sin(math.radians(20.0)), math.cos(math.radians(20.0))
    dead, live = Load((GRAVITY * sine, -GRAVITY * cosine)), Load((-GRAVITY * lean, GRAVITY))
    recipe = block_recipe(4.0, 0.5, 0.5, dead=dead, live=live)
    result = limit_load(recipe.scene(2))
    assert result.status == "limit"
    exact = (0.5 * cosine - sine) / (0.5 - lean)
    assert result.load_factor == pytest.approx(exact, rel=1e-8)
    with Discretization(result.scene) as made:
        work = result.collapse.mode @ made.problem.live
    assert work == pytest.approx(-1.0, rel=1e-9)
