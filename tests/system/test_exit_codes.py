"""Exit codes: 0 for an answer, 3 without an equilibrium, 4 for a load factor not verified."""

from __future__ import annotations

import math

import pytest

from fenics_contact.analysis import certificate
from tests.system.program import LEFT_OUT, result, run, run_here, write_scene

DOWN = {"loads.live.body": [0.0, -9.81]}
STEEP = {"foundations.base.friction": 0.3, "joints": {}}

#: Scenes with a limit load known by hand: changes, mesh, load factor.
SOLVED = {
    "sliding block": ({}, "block", 0.3),
    "toppling tower": (
        {"joints.default.friction": 0.8, "foundations.base.friction": 0.8},
        "tower",
        0.5,
    ),
    # Weight and load turn with the slope: tan(atan(0.3) - atan(0.2)).
    "block on an incline": (STEEP, "gentle", (0.3 - 0.2) / (1.0 + 0.3 * 0.2)),
    # 2000 Pa on 1 m of ground against 0.5 m2 of 1000 kg/m3.
    "block held by a shear strength": (
        {"foundations.base": {"law": "tresca", "bound": 2000.0}},
        "block",
        2000.0 / (0.5 * 1000.0 * 9.81),
    ),
}

TRESCA = {"law": "tresca", "bound": 1e4}
SMOOTH = {"law": "frictionless"}
UNBOUNDED = {
    "pressed on strong ground": DOWN | {"foundations.base": TRESCA, "joints": LEFT_OUT},
    "pressed on smooth ground": DOWN | {"foundations.base": SMOOTH, "joints": LEFT_OUT},
    "pressed on rough ground": DOWN,
    "a law for joints that the mesh has not": DOWN | {"foundations.base": TRESCA},
    "pressed at a slant": {"loads.live.body": [0.5, -9.81]},
    "pushed against a smooth wall": {"foundations.right": SMOOTH},
}

UNSTABLE = {
    "stack that hangs over": ({}, "overhang"),
    "block on an incline steeper than its friction": (STEEP, "steep"),
    "block on a smooth incline": ({"foundations.base": SMOOTH}, "gentle"),
}


@pytest.mark.parametrize("name", SOLVED)
def test_0_for_a_limit_load(name, tmp_path):
    changes, mesh, expected = SOLVED[name]
    write_scene(tmp_path, changes, mesh)
    found = run(["solve", "scene.toml"], tmp_path)
    assert (found.code, found.err) == (0, "")
    record = result(tmp_path / "scene")
    assert record["status"] == "limit"
    assert record["load_factor"] == pytest.approx(expected, rel=1e-5)
    assert f"load factor = {record['load_factor']:.8g}" in found.out
    assert "verified" in found.out


@pytest.mark.parametrize("name", UNBOUNDED)
def test_0_for_a_load_that_nothing_limits(name, tmp_path):
    write_scene(tmp_path, UNBOUNDED[name])
    found = run(["solve", "scene.toml"], tmp_path)
    record = result(tmp_path / "scene")
    assert (record["status"], record["load_factor"]) == ("unbounded", None), found.out
    assert record["bounds"]["upper"] is None
    assert "unbounded" in found.out
    assert (found.code, found.err) == (0, "")


@pytest.mark.parametrize("name", UNSTABLE)
def test_3_for_a_structure_that_cannot_stand(name, tmp_path):
    write_scene(tmp_path, *UNSTABLE[name])
    found = run(["solve", "scene.toml"], tmp_path)
    assert (found.code, found.err) == (3, "")
    assert "unstable" in found.out
    assert "load factor =" not in found.out
    record = result(tmp_path / "scene")
    assert record["status"] == "unstable"
    assert record["load_factor"] is record["load_factor_negative"] is None


@pytest.mark.parametrize(
    ("changes", "mesh", "code", "status"),
    [
        (UNBOUNDED["pressed on strong ground"], "block", 0, "unbounded"),
        (*UNSTABLE["stack that hangs over"], 3, "unstable"),
    ],
)
def test_codes_on_two_ranks(changes, mesh, code, status, tmp_path):
    write_scene(tmp_path, changes, mesh)
    found = run(["solve", "scene.toml"], tmp_path, ranks=2)
    assert found.code == code
    assert found.out.count(status) == 1
    assert result(tmp_path / "scene")["status"] == status


@pytest.mark.parametrize("failing", ["equilibrium", "friction", "mode_power", "bracket"])
def test_4_for_a_result_that_fails_its_verification(failing, tmp_path, monkeypatch, capsys):
    # No residual is that small: as if the solver had returned a wrong state.
    strict = {**certificate.TOLERANCES, failing: -1.0}
    monkeypatch.setattr(certificate, "TOLERANCES", strict)
    scene = write_scene(tmp_path)
    found = run_here(["solve", scene, "-o", tmp_path / "out"], capsys)
    assert found.code == 4
    record = result(tmp_path / "out")
    assert record["status"] == "not_converged"
    assert record["failures"] == [failing]
    assert math.isfinite(record["load_factor"])
    loud = [line for line in found.out.splitlines() if "NOT CONVERGED" in line]
    assert len(loud) == 1
    assert failing in loud[0]
    assert not any(line.startswith("verified") for line in found.out.splitlines())


def test_4_does_not_stick_to_one_direction(tmp_path, monkeypatch, capsys):
    strict = {**certificate.TOLERANCES, "equilibrium": -1.0}
    monkeypatch.setattr(certificate, "TOLERANCES", strict)
    scene = write_scene(tmp_path, {"solve.direction": "both"})
    found = run_here(["solve", scene, "-o", tmp_path / "out"], capsys)
    assert found.code == 4
    assert found.out.count("NOT CONVERGED") == 2
    assert result(tmp_path / "out")["negative"]["status"] == "not_converged"


def test_solver_that_finds_no_state_is_not_an_answer(tmp_path, monkeypatch, capsys):
    from fenics_contact.errors import SolverError
    from fenics_contact.solvers.interior_point import WorkControl

    def fail(*_, **__):
        raise SolverError("interior point: broken on purpose")

    for way in ("solve", "from_modes", "directly"):
        monkeypatch.setattr(WorkControl, way, fail)
    scene = write_scene(tmp_path)
    found = run_here(["solve", scene, "-o", tmp_path / "out"], capsys)
    assert found.code == 4
    assert "NOT CONVERGED" in found.out
    record = result(tmp_path / "out")
    assert (record["status"], record["load_factor"]) == ("not_converged", None)


def test_set_changes_the_answer(tmp_path):
    write_scene(tmp_path, {"joints": LEFT_OUT})
    found = run(["solve", "scene.toml", "--set", "foundations.base.friction=0.2"], tmp_path)
    assert found.code == 0
    assert result(tmp_path / "scene")["load_factor"] == pytest.approx(0.2, rel=1e-5)
