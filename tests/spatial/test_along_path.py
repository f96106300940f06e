"""What the loading path in space carries: peak, capacity curve, states at a load factor."""

from __future__ import annotations

import csv
import json
import logging
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fenics_contact.cli.command_line import main
from fenics_contact.spatial import Scene, builders, limit_load, standing

LIVE = {"direction": [1.0, 0.0, 0.0]}
ROW = {"builder": "wall", "length": 3.0, "height": 1.5, "thickness": 0.5, "brick": [1.0, 0.5]}
#: A wall whose path is higher than its end.
DIPS = {"builder": "wall", "length": 3.0, "height": 3.0, "thickness": 0.5, "brick": [0.6, 0.3]}
#: From a stone of the top course to the ground.
TIE = {"from": [0.5, 0.25, 1.25], "ground": [-1.0, 0.25, 0.0], "yield": 1.5e3}


@pytest.fixture(scope="module", autouse=True)
def _logger():
    """Other tests hear warnings after the program was run in this process."""
    log = logging.getLogger("fenics_contact")
    known = log.propagate, log.handlers[:], log.level
    yield
    log.propagate, log.handlers[:] = known[:2]
    log.setLevel(known[2])


def tables(blocks=ROW, friction=0.65, **more):
    """A wall pushed along its length."""
    return {
        "dimension": 3,
        "blocks": blocks,
        "materials": {"default": {"density": 2000.0}},
        "joints": {"default": {"friction": friction}},
        "loads": {"dead": {"body": [0.0, 0.0, -9.81]}, "live": LIVE},
        "solve": {"lowest": False},
        **more,
    }


def scene(*arguments, **more):
    return Scene.from_tables(tables(*arguments, **more), Path())


@pytest.mark.slow
def test_peak_is_above_the_collapse_and_stands():
    asked = scene(DIPS, 0.7)
    end = limit_load(asked).ends["positive"]
    assert (end.way, end.peak.status) == ("follow", "found")
    assert 1.002 * end.load_factor < end.peak.load_factor <= end.upper
    assert standing(asked, end.peak.load_factor * (1.0 - 1e-4)).status == "equilibrium"


@cache
def row():
    """The collapse of the row with its curve, solved once."""
    return limit_load(scene(output={"capacity": 10})).ends["positive"]


def test_path_that_rises_has_no_peak():
    assert row().peak.status == "none"


def test_fast_and_unasked_leave_the_peak_out():
    for solve in ({"fast": True}, {"peak": False, "lowest": False}):
        assert limit_load(scene(solve=solve)).ends["positive"].peak is None


@pytest.mark.parametrize(
    "more",
    [
        {},
        pytest.param(
            {"joints": {"default": {"friction": 0.65, "cohesion": 2e3}}}, marks=pytest.mark.slow
        ),
        {"ties": {"t": TIE}},
    ],
    ids=["dry", "cohesion", "tie"],
)
def test_curve_rises_from_rest_to_the_collapse(more):
    end = limit_load(scene(output={"capacity": 10}, **more)).ends["positive"] if more else row()
    factors = np.array([point.load_factor for point in end.curve])
    moved = np.array([point.displacement for point in end.curve])
    assert len(factors) == 10
    assert np.all(np.diff(moved) > 0.0)
    assert np.all(np.diff(factors) > -1e-6)
    assert factors[0] < 0.9 * end.load_factor
    assert factors[-1] == pytest.approx(end.load_factor, rel=1e-3)


def test_displacements_are_those_of_contacts_of_young():
    soft, stiff = (
        limit_load(
            scene(
                output={"capacity": 4},
                materials={"default": {"density": 2000.0, "young": young}},
            )
        ).ends["positive"]
        for young in (1e9, 1e10)
    )
    for one, other in zip(soft.curve, stiff.curve, strict=True):
        assert one.load_factor == pytest.approx(other.load_factor, rel=1e-6)
        assert one.displacement == pytest.approx(10.0 * other.displacement, rel=1e-6)


def test_both_directions_of_a_mirrored_wall_have_mirrored_curves():
    other_way = {"direction": "negative", "lowest": False}
    mirrored = limit_load(scene(solve=other_way, output={"capacity": 10})).ends["negative"]
    for one, other in zip(row().curve, mirrored.curve, strict=True):
        assert one.load_factor == pytest.approx(-other.load_factor, rel=1e-5)
        assert one.displacement == pytest.approx(other.displacement, rel=1e-4)


def test_states_below_the_collapse_are_equilibria_and_none_is_above_the_upper_end():
    asked, end = scene(), row()
    for part in (0.3, 0.99):
        found = standing(asked, part * end.load_factor).ends["positive"]
        assert found.status == "equilibrium"
        assert max(found.residuals.values()) < 1e-6
    assert standing(asked, 1.01 * end.upper).status == "unstable"


def write(folder, **more):
    """A scene file."""
    lines = ["dimension = 3", f'title = "row"\nblocks = {{{_inline(ROW)}}}']
    lines += ["materials.default.density = 2000.0", "joints.default.friction = 0.65"]
    lines += ["loads.dead.body = [0.0, 0.0, -9.81]", "loads.live.direction = [1.0, 0.0, 0.0]"]
    path = folder / "row.toml"
    path.write_text("\n".join([*lines, *more.get("lines", [])]) + "\n")
    return path


def _inline(table):
    return ", ".join(f"{key} = {json.dumps(value)}" for key, value in table.items())


def test_files_of_the_curve(tmp_path, capsys):
    path = write(
        tmp_path, lines=["output.capacity = 6", "output.report = true", "solve.lowest = false"]
    )
    assert main(["solve", str(path)]) == 0
    folder = tmp_path / "row"
    with (folder / "capacity.csv").open() as file:
        rows = list(csv.DictReader(file))
    record = json.loads((folder / "result.json").read_text())
    assert len(rows) == 6
    assert float(rows[-1]["load_factor"]) == pytest.approx(record["load_factor"], rel=1e-3)
    assert record["peak"]["status"] == "none"
    assert record["capacity"]["points"] == 6
    assert "capacity.png" in record["files"]
    assert "Capacity curve" in (folder / "report.html").read_text()


def test_state_at_a_load_factor_by_command(tmp_path, capsys):
    path = write(tmp_path)
    assert main(["stands", str(path), "--load-factor", "0.2"]) == 0
    assert "stands" in capsys.readouterr().out
    assert main(["stands", str(path), "--load-factor", "5"]) == 3


@pytest.mark.slow
def test_dome_of_the_builder_has_verified_points():
    dome = builders.dome(radius=3.0, thickness=0.5, meridians=8, rings=3)
    asked = Scene(
        blocks=tuple(dome),
        materials=scene().materials,
        joints=scene().joints,
        live=scene().live,
        dead=scene().dead,
        output=scene(output={"capacity": 4}).output,
    )
    end = limit_load(asked).ends["positive"]
    known = [point for point in end.curve if point.converged]
    assert len(known) >= 3
    assert all(point.load_factor <= end.upper * (1.0 + 1e-9) for point in known)
