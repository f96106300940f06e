"""Results: signs, status, what the joints do, and what is spared until it is asked for."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fenics_contact import LimitLoad, OutputOptions, Scene, SolveOptions, limit_load
from fenics_contact.analysis.certificate import Certificate
from fenics_contact.analysis.history import CollapseState, History, LoadPath, LoadStep, Step
from fenics_contact.analysis.joint_values import Contact
from fenics_contact.analysis.result import Collapse, Result
from fenics_contact.analysis.rigid_blocks import LimitBounds
from fenics_contact.meshing import running_bond
from fenics_contact.output.files import result_record, strict
from tests.helpers import coulomb, on_ground


def bounds() -> LimitBounds:
    return LimitBounds(0.25, 1.0)


def collapse(status: str = "limit") -> Collapse:
    """A collapse whose load factors all have the sign of the load applied."""
    return Collapse(
        status,
        0.5,
        bounds,
        certificate=Certificate({}, 0.0, kinematic_factor=0.75, static_factor=0.5),
        history=(History((Step(0.5, 0.0, 1.0, 3),)),),
        path=LoadPath((LoadStep(0.25, 1e-3, 2.0),), 0.25, 0.75),
        states=(CollapseState("dead load", "limit", 0.5),),
    )


def test_load_factors_of_the_reversed_load():
    end = collapse().reversed()
    assert end.load_factor == -0.5
    assert (end.bounds.lower, end.bounds.upper) == (-1.0, -0.25)
    assert (end.certificate.static_factor, end.certificate.kinematic_factor) == (-0.5, -0.75)
    assert end.history[0].steps[0].load_factor == -0.5
    assert (end.path.lower, end.path.upper) == (-0.25, -0.75)
    assert end.path.steps == (LoadStep(-0.25, 1e-3, 2.0),)
    assert end.states == (CollapseState("dead load", "limit", -0.5),)


@pytest.mark.parametrize(
    ("statuses", "status"),
    [
        ([], "unstable"),
        (["limit"], "limit"),
        (["unbounded"], "unbounded"),
        (["unbounded", "unbounded"], "unbounded"),
        (["limit", "unbounded"], "limit"),
        (["unbounded", "not_converged"], "not_converged"),
    ],
)
def test_status_is_that_of_both_ends(statuses, status):
    names = ("positive", "negative")
    ends = {name: collapse(each) for name, each in zip(names, statuses, strict=False)}
    result = Result(None, ends, (), {}, 0)  # type: ignore[arg-type]
    assert result.status == status
    assert np.isnan(result.load_factor) == (not ends)


@pytest.mark.parametrize(("sign", "outside"), [(1.0, 0.0), (-1.0, 0.5)])
def test_load_factor_outside_its_bracket_is_no_limit_load(sign, outside):
    end = replace(collapse(), load_factor=sign * 0.5, certificate=Certificate({}, 0.25))
    held = end.held_against_bracket()
    assert held.certificate.residuals == {"bracket": outside}
    assert held.status == ("not_converged" if outside else "limit")


def test_contraction_is_that_of_the_last_half():
    changes = [1.0, 0.9, 0.1, 0.01, 0.001]
    steps = tuple(Step(1.0, change, 1.0, 1) for change in changes)
    assert History(steps).contraction == pytest.approx(0.1)
    assert History(steps[:1]).contraction is None


def test_numbers_of_the_record_are_strict_json():
    record = {"a": [np.inf, 1, {"b": float("nan"), "c": None}], "d": "text", "e": -0.0}
    expected = {"a": [None, 1, {"b": None, "c": None}], "d": "text", "e": 0.0}
    assert str(strict(record)) == str(expected)


def sliding_wall(direction: str = "positive", capacity: int = 0) -> Scene:
    """A wall of 2 x 2 bricks, of which nothing is drawn, that slides on its base at 0.3."""
    return on_ground(
        running_bond(2, 2),
        coulomb(0.6),
        foundations={"base": coulomb(0.3)},
        solve=SolveOptions(direction=direction),
        output=OutputOptions(paraview=False, pictures=False, capacity=capacity),
    )


@pytest.fixture(scope="module")
def result() -> LimitLoad:
    return limit_load(sliding_wall("both"))


@pytest.mark.parametrize(("direction", "sign"), [("positive", 1.0), ("negative", -1.0)])
def test_joint_values_of_a_sliding_wall(direction, sign, result):
    joints, end = result.discretization.joints, result.ends[direction]
    values, ground = end.joints, joints.law == 1
    weight = np.abs(result.discretization.bodies.dead[:, 1].sum())
    x, y = values.force(joints)[ground].sum(axis=0)
    assert (x, y) == pytest.approx((-sign * 0.3 * weight, weight), rel=1e-6)
    assert values.pressure * joints.length == pytest.approx(values.normal_force)
    assert values.shear * joints.length == pytest.approx(values.shear_force)
    assert values.gap.min() >= -1e-12
    loaded = values.pressure > 1e-3 * values.pressure.max()
    assert set(values.contact[ground & loaded]) == {Contact.SLIP}
    assert not np.any(values.opens)
    assert values.slip_rate[ground] == pytest.approx(values.slip_rate[ground][0], rel=1e-6)


def test_both_ends_are_of_the_same_problem(result):
    assert result.load_factor == pytest.approx(0.3, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(-0.3, rel=1e-6)
    for end in (result.positive, result.negative):
        assert end.state.load_factor == pytest.approx(end.load_factor, rel=1e-6)
        assert np.sign(end.state.work) == np.sign(end.load_factor)
        assert end.certificate.static_factor == pytest.approx(end.load_factor, rel=1e-6)
    record = result_record(result)
    assert record["negative"]["kinematic_factor"] == pytest.approx(-0.3, rel=1e-6)


def test_bracket_is_found_where_it_is_written(tmp_path):
    result = limit_load(sliding_wall())
    before = result.positive.certificate.residuals
    seconds = result.seconds["bounds"]
    assert "bracket" not in before
    result.write(tmp_path)
    assert result.positive.certificate.residuals == {**before, "bracket": 0.0}
    assert result.seconds["bounds"] > seconds
    record = json.loads((tmp_path / "result.json").read_text())
    assert record["bounds"]["upper"] == result.bounds.upper == pytest.approx(0.3, rel=1e-6)


@pytest.mark.parametrize(("upper", "status"), [(0.29, "not_converged"), (None, "limit")])
def test_bracket_that_excludes_the_load_factor_or_is_not_known(upper, status, result, tmp_path):
    known = LimitBounds(None, upper)
    ends = {"positive": replace(result.positive, program=lambda: known)}
    changed = LimitLoad(result.discretization, ends, (), {**result.seconds}, 0)
    changed.write(tmp_path)
    record = json.loads((tmp_path / "result.json").read_text())
    assert record["status"] == changed.status == status
    assert record["bounds"] == {"lower": None, "upper": upper}
    assert record["failures"] == ([] if upper is None else ["bracket"])
    assert record["load_factor"] == result.load_factor


def test_no_capacity_curve():
    with_curve, without = (limit_load(sliding_wall(capacity=count)) for count in (3, 0))
    assert (with_curve.capacity, without.capacity) == ((), ())
    assert with_curve.factorizations == without.factorizations
    assert len(with_curve.trace_capacity()) == len(with_curve.capacity) == 3
    assert without.load_factor == pytest.approx(with_curve.load_factor, rel=1e-9)
    assert without.factorizations < with_curve.factorizations


def test_libraries_are_imported_where_they_are_used(tmp_path):
    """A solve of a built mesh without pictures needs no matplotlib, and no gmsh but to mesh."""
    program = f"""
import sys
from fenics_contact import limit_load
assert not {{"gmsh", "matplotlib", "scipy"}} & set(sys.modules), "imported with the package"
from tests.unit.test_result import sliding_wall
limit_load(sliding_wall()).write({str(tmp_path)!r})
assert "matplotlib" not in sys.modules, "imported without pictures"
"""
    root = Path(__file__).parents[2]
    line = [sys.executable, "-c", program]
    done = subprocess.run(line, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
