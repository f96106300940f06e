"""Exit codes: 0 for an answer, 3 without an equilibrium, 4 for a load factor not verified."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.quick import slow
from tests.system.program import LEFT_OUT, QUIET, Run, result, run, run_here, write_scene

DOWN = {"loads.live.body": [0.0, -9.81]}
ROUGH = {"joints.default.friction": 0.8, "foundations.base.friction": 0.8}
TRESCA = {"law": "tresca", "bound": 1e4}
STEEP = {"foundations.base.friction": 0.3, "joints": {}}

#: Scenes with a limit load known by hand: changes, mesh, load factor.
SOLVED = {
    "sliding block": ({}, "block", 0.3),
    "toppling tower": (ROUGH, "tower", 0.5),
    # Weight and load turn with the slope: tan(atan(0.3) - atan(0.2)).
    "block on an incline": (STEEP, "gentle", (0.3 - 0.2) / (1.0 + 0.3 * 0.2)),
    # 2000 Pa on 1 m of ground against 0.5 m2 of 1000 kg/m3.
    "block held by a shear strength": (
        {"foundations.base": TRESCA | {"bound": 2000.0}},
        "block",
        2000.0 / (0.5 * 1000.0 * 9.81),
    ),
}

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


#: A stiffness of which floating point numbers hold no digit, whatever the method.
HOPELESS = {"materials.default.poisson": 0.4999999999999999}


def solved_here(
    folder: Path, capsys: Any, changes: Mapping[str, Any], mesh: str = "block"
) -> tuple[Run, dict[str, Any]]:
    """Run `solve` on a scene within this process; returns what it printed and result.json."""
    write_scene(folder, QUIET | changes, mesh)
    found = run_here(["solve", "scene.toml"], capsys)
    return found, result(folder / "scene")


@pytest.mark.parametrize("name", SOLVED)
def test_0_for_a_limit_load(name, folder, capsys):
    changes, mesh, expected = SOLVED[name]
    found, record = solved_here(folder, capsys, changes, mesh)
    assert (found.code, found.err) == (0, "")
    assert record["status"] == "limit" and "verified" in found.out
    assert record["load_factor"] == pytest.approx(expected, rel=1e-5)
    told = re.match(r"it collapses at (\S+) g to the right \(verified\)\n", found.out)
    assert float(told[1]) == pytest.approx(record["load_factor"], rel=2e-4)


@pytest.mark.parametrize("name", UNBOUNDED)
def test_0_for_a_load_that_nothing_limits(name, folder, capsys):
    found, record = solved_here(folder, capsys, UNBOUNDED[name])
    assert (record["status"], record["load_factor"]) == ("unbounded", None), found.out
    assert record["bounds"]["upper"] is None
    assert record["wedged_blocks"] == [0]
    assert re.match("nothing limits the live load(| to the right): block 0 at", found.out)
    assert (found.code, found.err) == (0, "")


@pytest.mark.parametrize("name", UNSTABLE)
def test_3_for_a_structure_that_cannot_stand(name, folder, capsys):
    found, record = solved_here(folder, capsys, *UNSTABLE[name])
    assert (found.code, found.err) == (3, "")
    assert found.out.startswith("it does not stand under its dead load: block")
    assert record["status"] == "unstable"
    assert record["load_factor"] is record["load_factor_negative"] is None
    assert record["reason"].partition(": ")[2] in found.out and record["falling_blocks"]


JAMMED = {
    "foundations": {"left": {"friction": 0.5}, "right": {"friction": 0.5}},
    "joints": LEFT_OUT,
}


def test_3_where_only_rigid_blocks_with_associative_friction_stand(folder, capsys):
    """A block between two walls that nothing presses on it: only its weight lifted holds it."""
    changes = JAMMED | {"loads.live.body": [0.0, 9.81]}
    found, record = solved_here(folder, capsys, changes)
    assert (found.code, record["status"]) == (3, "no_equilibrium")
    assert "no equilibrium was found under the dead load alone" in record["reason"]
    no_proof = "no equilibrium was found under its dead load, which is no proof that there is none"
    assert found.out.startswith(f"{no_proof}\n") and record["falling_blocks"] == []
    asked = run_here(["stands", "scene.toml", "-o", "alone"], capsys)
    assert asked.code == 3 and "it does not stand" not in asked.out
    assert asked.out.startswith(f"{no_proof}\n")
    both = result(folder / "alone")
    assert (both["status"], both["reason"]) == (record["status"], record["reason"])


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("engine", ["faces", *slow("auto")])
@pytest.mark.parametrize("direction", ["positive", "both"])
def test_4_for_a_load_factor_that_is_not_found(direction, engine, folder, capsys):
    changes = {"solve.direction": direction, "solve.engine": engine}
    found, record = solved_here(folder, capsys, HOPELESS | changes)
    assert (found.code, record["status"]) == (4, "not_converged")
    lines = [line for line in found.out.splitlines() if "no collapse was found" in line]
    assert len(lines) == (2 if direction == "both" else 1) and "verified" not in found.out
    for line, way in zip(lines, ("right", "left"), strict=False):
        assert re.match(
            f"no collapse was found to the {way}; all collapse states are at 0.3 g; try what", line
        )


def test_fast_leaves_out_the_capacity_curve(folder, capsys):
    write_scene(folder, {"output.capacity": 3, "output.paraview": False}, "block")
    found = run_here(["solve", "scene.toml", "--fast"], capsys)
    assert found.code == 0 and "capacity: 1 of 3" not in found.out
    assert (
        re.search("^no other collapse state exists$", found.out, re.M) and "peak" not in found.out
    )
    found = run_here(["solve", "scene.toml", "--fast", "-v"], capsys)
    assert "peak: not known, solve.fast = true leaves it out" in found.out
    assert "capacity.csv" not in result(folder / "scene")["files"]


@pytest.mark.parametrize(
    ("ranks", "changes", "mesh", "code", "status"),
    [
        (1, {}, "block", 0, "limit"),
        (2, *UNSTABLE["stack that hangs over"], 3, "unstable"),
        *(
            pytest.param(*more, marks=pytest.mark.slow)
            for more in (
                (2, UNBOUNDED["pressed on strong ground"], "block", 0, "unbounded"),
                (2, HOPELESS, "block", 4, "not_converged"),
            )
        ),
    ],
)
def test_codes_of_the_program(ranks, changes, mesh, code, status, tmp_path):
    write_scene(tmp_path, QUIET | changes, mesh)
    found = run(["solve", "scene.toml"], tmp_path, ranks)
    assert found.code == code, found.err
    assert result(tmp_path / "scene")["status"] == status
    words = {
        "limit": "it collapses at",
        "not_converged": "no collapse was found",
        "unstable": "it does not stand",
        "unbounded": "nothing limits",
    }
    assert found.out.count(words[status]) == 1
