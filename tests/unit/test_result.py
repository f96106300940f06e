"""Results: signs, status, what the joints do, and what is spared until it is asked for."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fenics_contact import (
    LimitLoad,
    Load,
    OutputOptions,
    Scene,
    SolveOptions,
    SolverError,
    limit_load,
)
from fenics_contact.answers.lowest import LowestAnswer
from fenics_contact.meshing import running_bond
from fenics_contact.output.files import result_record, strict
from fenics_contact.results.block_view import ContactState
from fenics_contact.results.bounds import LimitBounds, signed
from fenics_contact.results.certificate import Certificate
from fenics_contact.results.history import (
    CollapseState,
    History,
    LoadPath,
    LoadStep,
    Lowest,
    Step,
)
from fenics_contact.results.result import Collapse, Result
from tests.helpers import coulomb, notebook_picture, on_ground


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
        answers={"lowest": LowestAnswer(Lowest("lower", 0.25, 1))},
    )


def test_load_factors_of_the_reversed_load():
    end = signed(collapse(), -1.0)
    assert end.load_factor == -0.5
    assert (end.bounds.lower, end.bounds.upper) == (-1.0, -0.25)
    assert (end.certificate.static_factor, end.certificate.kinematic_factor) == (-0.5, -0.75)
    assert end.history[0].steps[0].load_factor == -0.5
    assert (end.path.lower, end.path.upper) == (-0.25, -0.75)
    assert end.path.steps == (LoadStep(-0.25, 1e-3, 2.0),)
    assert end.states == (CollapseState("dead load", "limit", -0.5),)
    assert end.lowest == Lowest("lower", -0.25, 1)


def by_faces(load_factor: float, limit: float, **known: Any) -> Collapse:
    """A collapse by the forces of joint faces, which allow a load factor `limit`."""
    certificate = Certificate({"limit": 1e-3}, math.nan, kinematic_factor=limit)
    end = replace(collapse(), load_factor=load_factor, certificate=certificate, answers={})
    return replace(end, engine="faces", gap=1e-3, **known)


@pytest.mark.parametrize(
    ("load_factor", "limit", "told"),
    [
        (0.347, 0.34726, ("0.3470", "nothing carries more than 0.3473")),
        (0.34704, 0.34731, ("0.3470", "nothing carries more than 0.3474")),
        (-0.347, -0.34726, ("-0.3470", "nothing carries more than -0.3473")),
        (12.3, 12.3000000001, ("12.3", "that is the limit load")),
        (12.3, 12.2999999999, ("12.3", "that is the limit load")),
        (0.3, 0.3, ("0.3", "that is the limit load")),
        (0.3, 0.2951, ("0.3000", "nothing carries less than 0.2951")),
        (0.0, 1e-3, ("0", "nothing carries more than 0.001")),
    ],
)
def test_what_faces_prove_in_words(load_factor, limit, told):
    here, end = told
    text = by_faces(load_factor, limit).proof
    assert text == (
        f"collapses at {here}: there is an equilibrium inside the friction cone at {here}, and with"
        f" its friction forces {end}"
    )
    assert collapse().proof == ""


def test_a_gap_above_the_one_asked_for_is_warned_of():
    wide = by_faces(0.3, 0.301, asked=1e-4).contradiction
    assert "the gap is 0.001, above the 0.0001 asked for (solve.gap)" in wide
    assert by_faces(0.3, 0.301, asked=1e-3).contradiction == ""


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
    joints, end = result.layout.joints, result.ends[direction]
    values, ground = end.joints, joints.law == 1
    weight = np.abs(result.layout.bodies.dead[:, 1].sum())
    x, y = values.force(joints.normal, joints.tangent)[ground].sum(axis=0)
    assert (x, y) == pytest.approx((-sign * 0.3 * weight, weight), rel=1e-6)
    assert values.pressure * joints.length == pytest.approx(values.normal_force)
    assert values.shear * joints.length == pytest.approx(values.shear_force)
    assert values.gap.min() >= -1e-12
    loaded = values.pressure > 1e-3 * values.pressure.max()
    assert set(values.contact[ground & loaded]) == {ContactState.SLIP}
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
    assert record["directions"]["negative"]["kinematic_factor"] == pytest.approx(-0.3, rel=1e-6)


def test_bracket_is_found_where_it_is_written(tmp_path):
    result = limit_load(sliding_wall())
    before = result.positive.certificate.residuals
    assert "bracket" not in before
    result.write(tmp_path)
    assert result.positive.certificate.residuals == before
    held = result.with_brackets()
    assert held.positive.certificate.residuals == {**before, "bracket": 0.0}
    assert held.seconds["bounds"] > result.seconds["bounds"]
    record = json.loads((tmp_path / "result.json").read_text())
    assert record["residuals"] == held.positive.certificate.residuals
    assert record["bounds"]["upper"] == result.bounds.upper == pytest.approx(0.3, rel=1e-6)


@pytest.mark.parametrize("upper", [0.29, None])
def test_bracket_that_excludes_the_load_factor_or_is_not_known(upper, result, tmp_path):
    """Both are told; the status that was returned stays."""
    known = LimitBounds(None, upper)
    ends = {"positive": replace(result.positive, program=lambda: known)}
    changed = replace(result, ends=ends)
    changed.write(tmp_path)
    record = json.loads((tmp_path / "result.json").read_text())
    assert record["status"] == changed.status == "limit"
    unknown = {"lower": None, "frictionless": None, "meet": False, "reason": ""}
    assert record["bounds"] == unknown | {"upper": upper}
    assert record["failures"] == ([] if upper is None else ["bracket"])
    assert record["load_factor"] == result.load_factor
    told = f"the load factor {result.load_factor:.6g} is outside its bracket (at most 0.29)"
    told += ": one of them is wrong, do not rely on it"
    assert (told in record["warnings"]) is (upper is not None)
    assert (told in changed.summary()) is (upper is not None)
    held = changed.hold_against_brackets()
    assert held.status == ("limit" if upper is None else "not_converged")
    assert held.reason() == ("" if upper is None else told)


def test_no_capacity_curve():
    with_curve, without = (limit_load(sliding_wall(capacity=count)) for count in (3, 0))
    assert (with_curve.capacity, without.capacity) == ((), ())
    assert with_curve.factorizations == without.factorizations
    traced = with_curve.with_capacity()
    assert len(with_curve.trace_capacity()) == len(traced.capacity) == 3
    assert with_curve.capacity == ()
    assert without.load_factor == pytest.approx(with_curve.load_factor, rel=1e-9)
    assert without.factorizations < traced.factorizations


def test_a_capacity_curve_shows_how_the_load_rises():
    """A wall that slides long before its collapse has come to its end."""
    *rising, last = limit_load(sliding_wall()).trace_capacity(points=10)
    assert sum(point.load_factor < 0.299 for point in rising) > 3
    assert last.load_factor == pytest.approx(0.3, rel=1e-4)


def test_result_is_one_line_and_a_summary_is_more(result):
    assert repr(result) == f"<LimitLoad: limit, load factor {result.load_factor:.8g}," + (
        f" load factor {result.load_factor_negative:.8g}>"
    )
    found = limit_load(sliding_wall())
    first, other = found.summary().splitlines()
    assert first == "it collapses at 0.3000 g to the right (verified)"
    assert other.startswith("lowest collapse state found, with any self-stress: this one; nothing")
    lines = found.summary(verbose=True).splitlines()
    assert lines[:3] == [first, other, ""]
    assert lines[3].startswith("load factor = 0.3") and "between" in lines[3]
    assert lines[4].startswith("verified")


def test_what_a_result_knows_has_the_names_of_the_record(result):
    known = result.with_brackets()
    record = result_record(known)
    assert known.residuals == record["residuals"] and known.tolerances == record["tolerances"]
    assert known.peak.status == record["peak"]["status"]
    assert known.lowest.starts == record["lowest"]["starts"]
    assert known.hinges.points == record["hinges"]["points"]["load_factor"]
    assert known.range.lower == record["range"]["lower"]
    assert known.states == known.positive.states
    assert "bracket" in known.residuals and "bracket" not in result.residuals
    assert repr(known.positive) == f"<Collapse: limit, load factor {known.load_factor:.8g}>"


def test_load_without_a_limit_has_no_residuals():
    unbounded = replace(collapse("unbounded"), certificate=Certificate({"equilibrium": 1e-9}, 0.0))
    for ends in ({"positive": unbounded}, {}):
        result = LimitLoad(None, ends, (), {}, 0)
        assert result.residuals == result.tolerances == {}
        assert result.peak is result.range is result.hinges is None
    assert result.lowest is None and result.states == ()


def test_joints_by_name(result):
    joints, whole = result.joints, result.layout.joints
    points = len(whole.length)
    assert {len(joints[name]) for name in joints} == {points}
    ground = joints["group"] == "base"
    assert np.array_equal(ground, joints["blocks"][:, 0] == -1)
    assert set(joints["friction"][ground]) == {0.3}
    weight = -result.blocks["dead_load"][:, 1].sum()
    force = joints["force"][ground].sum(axis=0)
    assert force == pytest.approx([-0.3 * weight, weight], rel=1e-6)
    normal = joints["pressure"] * joints["length"]
    assert np.sum(joints["force"] * joints["normal"], axis=1) == pytest.approx(normal)
    assert repr(joints).startswith("<joints: position, normal")
    with pytest.raises(KeyError, match="no 'presure' of joints; there is position, normal"):
        joints["presure"]
    with pytest.raises(ValueError, match="read-only"):
        joints["length"][0] = 1.0
    assert whole.length.flags.writeable


def test_blocks_by_name(result):
    blocks = result.blocks
    bricks = [0.4 * 0.2] * 2 + [0.2 * 0.2] * 2
    assert len(blocks["area"]) == len(blocks["centre"])
    assert blocks["area"].sum() == pytest.approx(result.layout.bodies_area(), rel=1e-12)
    assert blocks["area"].max() == pytest.approx(max(bricks), rel=1e-9)
    assert blocks["dead_load"][:, 1] == pytest.approx(-9.81 * 2000.0 * blocks["area"], rel=1e-9)
    # All slide as one; the live load does work 1.
    speed = 1.0 / blocks["live_load"][:, 0].sum()
    assert blocks["mode"] == pytest.approx(
        np.tile([speed, 0.0], (len(blocks["area"]), 1)), abs=1e-12
    )
    assert blocks["mode_rotation"] == pytest.approx(0.0, abs=1e-10)
    assert {"displacement", "rotation"} < set(blocks)


def test_pictures_return_their_axes(result):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    axes = pyplot.subplots()[1]
    assert result.plot(axes) is axes
    assert result.plot_forces().get_title().startswith("joint forces")
    single = limit_load(sliding_wall(capacity=3))
    assert single.capacity == () and len(single.plot_capacity().lines[0].get_xdata()) == 3
    traced = single.with_capacity(points=2)
    assert len(traced.plot_capacity().lines[0].get_xdata()) == len(traced.capacity) == 2
    assert notebook_picture(result).startswith(b"\x89PNG")
    pyplot.close("all")


def test_nothing_to_draw_without_a_collapse():
    uplift = replace(sliding_wall(), live=Load((0.0, -9.81)))
    found = limit_load(uplift)
    assert (found.status, notebook_picture(found)) == ("unbounded", None)
    with pytest.raises(SolverError, match="no collapse to draw: the status is 'unbounded'"):
        found.plot()


def test_progress_is_printed_where_it_is_asked_for(capsys):
    limit_load(sliding_wall())
    assert capsys.readouterr().out == ""
    limit_load(sliding_wall(), progress=True)
    assert "positive: pass   1  load factor 0.3" in capsys.readouterr().out


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
