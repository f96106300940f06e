"""Sweeps: what varies, what is kept from scene to scene, rows, pictures."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fenics_contact import InputError, Load, Point, Scene, SolveOptions, limit_load, sweep
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.limit_load import limit_load_of
from fenics_contact.meshing import running_bond
from fenics_contact.sweeps.points import Parameter, grid
from fenics_contact.sweeps.sweep import Sweep, draw_sweep
from tests.helpers import coulomb, on_ground

BOTH = "joints.default.friction, foundations.base.friction"


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a.b=0.3:0.6:3", (0.3, 0.45, 0.6)),
        ("a.b=0.3:1.0:15", tuple(round(0.3 + 0.05 * k, 2) for k in range(15))),
        ("a.b=1:3:3", (1, 2, 3)),
        ("a.b=0:1:3", (0.0, 0.5, 1.0)),
        ("a.b=2:5:1", (2,)),
        ("a.b=[0, 1]:[4, 1]:3", ([0, 1], [2, 1], [4, 1])),
        ("a.b=0.3, 0.3, 0.5", (0.3, 0.5)),
        ("a.b=fixed,roller", ("fixed", "roller")),
        ('a.b="fixed", "roller"', ("fixed", "roller")),
        ("a.b=[9.81, 0.0],[0.0, -9.81]", ([9.81, 0.0], [0.0, -9.81])),
        ("a.b=true", (True,)),
        ("a.b=C:one:3", ("C:one:3",)),
    ],
)
def test_values_of_a_parameter(text, values):
    parameter = Parameter.parse(text)
    assert (parameter.keys, parameter.values) == (("a.b",), values)
    assert [type(v) for v in parameter.values] == [type(v) for v in values]


@pytest.mark.parametrize(
    "text",
    ["a.b", "a.b=", "=1", "a..b=1", "a,=1", "a=1:2:0", "a=[0,1]:[2]:3", "a=1:2:999999", "a=1:2"],
)
def test_parameter_is_refused(text):
    with pytest.raises(InputError, match=r"KEY|range|values"):
        Parameter.parse(text)


def test_arrays_and_paths_are_values_as_a_file_has_them():
    given = [np.float64(0.5), np.int64(2), np.array([1.0, 2.0]), (3, 4), Path("a/b.msh")]
    assert Parameter.of("a", given).values == (0.5, 2, [1.0, 2.0], [3, 4], "a/b.msh")


def test_grid_of_two_parameters():
    parameters = [Parameter.of("a, b", np.array([1.0, 2.0])), Parameter.of("c", ["x", "y"])]
    points = [tuple(point.items()) for point in grid(parameters)]
    assert points[:2] == [
        (("a", 1.0), ("b", 1.0), ("c", "x")),
        (("a", 1.0), ("b", 1.0), ("c", "y")),
    ]
    assert len(points) == 4
    with pytest.raises(InputError, match="'a' varies twice"):
        grid([*parameters, Parameter.of("a", [3.0])])
    with pytest.raises(InputError, match="nothing varies"):
        grid([])


def scene() -> Scene:
    """A wall of 2 x 2 bricks."""
    solve = SolveOptions(tolerance=1e-6, fast=True)
    return on_ground(running_bond(2, 2), coulomb(0.3), solve=solve)


@pytest.mark.mpi
def test_kept_matrices_give_the_numbers_of_new_ones():
    first = replace(scene(), foundations={"base": coulomb(0.2)})
    laws = replace(first, joints={"default": coulomb(0.7)}, foundations={"base": coulomb(0.4)})
    loads = replace(laws, dead=Load((0.0, -5.0)), live=Load((1.0, 0.5)))
    none = replace(loads, joints={"default": coulomb(0.0)})
    back = replace(first, title="again")
    with Discretization(first) as made:
        last = made
        for changed in (laws, loads, none, back):
            assert last.shares_matrices(changed)
            last = last.with_(scene=changed)
            kept, fresh = limit_load_of(last), limit_load(changed)
            assert kept.load_factor == pytest.approx(fresh.load_factor, rel=1e-12)
            assert kept.factorizations == fresh.factorizations
            if changed is not none:  # without friction every brick slides as it likes
                modes = kept.blocks["mode"], fresh.blocks["mode"]
                assert modes[0] == pytest.approx(
                    modes[1], rel=1e-6, abs=1e-9 * np.abs(modes[1]).max()
                )
            bounds = kept.bounds.upper, fresh.bounds.upper
            assert bounds[0] == pytest.approx(bounds[1], rel=1e-12)


@pytest.mark.mpi
def test_sweep_of_a_scene():
    found = sweep(scene(), {BOTH: [0.2, 0.3], "loads.live.body": [[9.81, 0.0], [4.905, 0.0]]})
    assert [list(point.values.values()) for point in found] == [
        [f, f, load] for f in (0.2, 0.3) for load in ([9.81, 0.0], [4.905, 0.0])
    ]
    assert found.column("load_factor") == pytest.approx([0.2, 0.4, 0.3, 0.6], rel=1e-6)
    assert found.column("upper") == pytest.approx([0.2, 0.4, 0.3, 0.6], rel=1e-6)
    assert {point.status for point in found} == {"limit"}
    assert found.worst is found[0]
    assert "4 points" in repr(found) and "0.2" in repr(found) and "\n" not in repr(found)


def test_sweep_of_a_scene_takes_every_key():
    values = {
        "materials.default.young": [2e9],
        "plane.state": ["strain", "stress"],
        "mesh.degree": "1:2:2",
        "solve.direction": ["both"],
    }
    found = sweep(scene(), values)
    assert len(found) == 4
    assert found.column("load_factor") == pytest.approx(0.3, rel=1e-6)
    assert found.column("load_factor_negative") == pytest.approx(-0.3, rel=1e-6)


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ({"joints.default.fricton": [0.3]}, "unknown key 'joints.default.fricton'; did you mean"),
        ({"joints.default.friction": [0.3, -1.0]}, "joints.default.friction = -1.0 must be"),
        ({"foundations.bse.friction": [0.3]}, "no one-dimensional group 'bse'"),
        ({"mesh.file": ["other.msh"]}, "for scenes of a file only"),
        ({"title.b": ["x"]}, "'title' is not a table"),
        ({"loads.live.body": [[0.0, 0.0]]}, "live load is zero"),
    ],
)
def test_sweep_is_refused(vary, message):
    with pytest.raises(InputError, match=message):
        sweep(replace(scene(), title="named"), vary)
    with pytest.raises(InputError, match="jobs"):
        sweep(scene(), {BOTH: [0.3]}, jobs=0)


def form_of_a_script(v, dx, ds):
    return 1e3 * v[0] * ds("base")


def test_scene_made_in_python_is_shared_among_processes(monkeypatch):
    values = {BOTH: [0.3, 0.4]}
    alone, shared = (sweep(scene(), values, jobs=jobs) for jobs in (1, 2))
    assert [p.values for p in shared] == [p.values for p in alone]
    np.testing.assert_array_equal(shared.column("load_factor"), alone.column("load_factor"))
    np.testing.assert_array_equal(shared.column(BOTH), [0.3, 0.4])
    with pytest.raises(InputError, match=r"stress: the function '.*<lambda>' cannot be pickled"):
        sweep(replace(scene(), stress=lambda strain, material: 1e9 * strain), values, jobs=2)
    monkeypatch.setattr(form_of_a_script, "__module__", "__main__")
    with pytest.raises(InputError, match="'form_of_a_script' is in the script that runs"):
        sweep(replace(scene(), dead=Load(form=form_of_a_script)), values, jobs=2)


def test_point_that_does_not_fit_is_a_row():
    found = sweep(scene(), {"loads.live.body": [[9.81, 0.0], [0.0, 0.0]]})
    assert [point.status for point in found] == ["limit", "wrong_input"]
    assert "live load is zero" in found[1].reason
    assert math.isnan(found[1].least)
    with pytest.raises(InputError, match=r"name = 'friction' must be one of 'loads\.live"):
        found.column("friction")


def points(values: list[dict], factor: float = 0.5) -> list[Point]:
    return [Point(v, "limit", factor + 0.01 * k, 0.0, 1.0) for k, v in enumerate(values)]


@pytest.mark.parametrize(
    ("vary", "label"),
    [
        ({"a.friction": "0:1:5"}, "friction of a"),
        ({"a.law": ["coulomb", "tresca"]}, "law of a"),
        ({"loads.at": "[0, 1]:[4, 1]:4"}, "at of loads, x"),
        ({"loads.at": "[0, 1]:[4, 2]:4"}, "at of loads, distance from the first"),
        ({"a": "0:1:4", "b": "0:1:3"}, "a"),
        ({"a": "0:1:9", "b": "0:1:9"}, "point"),
        ({"a": "0:1:3", "b": "0:1:3", "c": "0:1:3"}, "point"),
    ],
)
def test_picture_of_a_sweep(vary, label):
    parameters = [Parameter.of(key, values) for key, values in vary.items()]
    found = points(grid(parameters))
    found[0] = replace(found[0], status="not_converged", load_factor=math.nan)
    found[-1] = replace(found[-1], status="unbounded", load_factor=math.inf, upper=math.inf)
    axes = draw_sweep(parameters, found)
    assert axes.get_xlabel() == label
    axes.figure.canvas.draw()


def test_one_end_of_a_bracket_is_drawn_and_the_worst_place_named():
    parameters = [Parameter.parse("a=0:1:5")]
    found = [replace(point, lower=math.nan) for point in points(grid(parameters))]
    axes = draw_sweep(parameters, found)
    labels = axes.get_legend_handles_labels()[1]
    assert labels == ["load factor", "at most", "lowest: 0.5 at 0"]


def test_no_point_is_the_lowest_where_all_are_equal():
    parameters = [Parameter.parse("a=0:1:3")]
    found = [replace(point, load_factor=0.5) for point in points(grid(parameters))]
    assert "lowest: 0.5 at 0" not in draw_sweep(parameters, found).get_legend_handles_labels()[1]
    assert "load factor 0.5 at all" in repr(Sweep(parameters, found))
