"""The files a run writes: result.json, ParaView files, pictures, the capacity curve."""

from __future__ import annotations

import csv
import itertools
import math
import struct
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fenics_contact
from tests.system.program import Run, files, result, run, run_here, write_scene

# A wall of 5 blocks (64 cells) of 0.8 m x 0.4 m; it slides on its base, all joints are rougher.
FRICTION, WEIGHT, BODIES, CELLS = 0.3, 0.8 * 0.4 * 1000.0 * 9.81, 5, 64

ROUGH = 0.6
WALL = {"title": "A wall", "joints.default.friction": ROUGH}

POINT_ARRAYS = {"displacement", "collapse_mode"}
CELL_ARRAYS = {"stress_xx", "stress_yy", "stress_xy", "von_mises", "body"}
JOINT_ARRAYS = {"pressure", "shear", "gap", "slip", "state"}
PARAVIEW = {"blocks.pvd", "blocks000000.pvtu", "blocks_p0_000000.vtu", "joints.vtu"}

OUTPUT_OFF = ["--set", "output.paraview=false", "--set", "output.pictures=false"]

#: Kinds of what result.json must hold.
KINDS = {
    "status": str,
    "load_factor": float,
    "load_factor_negative": type(None),
    "bounds.lower": float,
    "bounds.upper": float,
    "method": str,
    "error_estimate": float,
    "residuals.equilibrium": float,
    "residuals.penetration": float,
    "residuals.complementarity": float,
    "residuals.friction": float,
    "iterations.fixed_point": int,
    "iterations.factorizations": int,
    "iterations.mode_factorizations": int,
    "mesh.bodies": int,
    "mesh.cells": int,
    "mesh.dofs": int,
    "mesh.joint_points": int,
    "skipped": list,
    "seconds.total": float,
    "seconds.read": float,
    "seconds.assemble": float,
    "seconds.bonded": float,
    "seconds.solve": float,
    "seconds.write": float,
    "ranks": int,
    "version": str,
}


@dataclass(frozen=True)
class Solved:
    """A run of the wall and what it wrote."""

    run: Run
    folder: Path
    output: Path

    @property
    def record(self) -> dict[str, Any]:
        return result(self.output)


def solve_wall(folder: Path, ranks: int) -> Solved:
    write_scene(folder, WALL, "wall", "wall.toml")
    return Solved(run(["solve", "wall.toml"], folder, ranks), folder, folder / "wall")


@pytest.fixture(scope="module")
def solved(tmp_path_factory) -> Solved:
    return solve_wall(tmp_path_factory.mktemp("one_rank"), 1)


@pytest.fixture(scope="module")
def on_two_ranks(tmp_path_factory) -> Solved:
    return solve_wall(tmp_path_factory.mktemp("two_ranks"), 2)


def arrays(parent: ET.Element | None) -> dict[str, np.ndarray]:
    """Data arrays below an element by name, a row for every point or cell."""
    assert parent is not None
    found = {}
    for array in parent.findall("DataArray"):
        values = np.array((array.text or "").split(), dtype=float)
        width = int(array.get("NumberOfComponents") or 1)
        found[array.get("Name", "")] = values.reshape(-1, width) if width > 1 else values
    return found


def piece(path: Path) -> ET.Element:
    """The one piece of a .vtu file."""
    (only,) = ET.parse(path).getroot().iter("Piece")
    return only


def pieces(folder: Path) -> list[ET.Element]:
    """The pieces of the ranks, found as ParaView finds them: .pvd, .pvtu, .vtu."""
    (parallel,) = ET.parse(folder / "blocks.pvd").getroot().iter("DataSet")
    listed = ET.parse(folder / parallel.attrib["file"]).getroot().iter("Piece")
    return [piece(folder / p.attrib["Source"]) for p in listed]


def own_cells(part: ET.Element) -> dict[str, np.ndarray]:
    """Cell arrays of a rank's own cells."""
    values = arrays(part.find("CellData"))
    ghost = values.get("vtkGhostType", np.zeros(int(part.attrib["NumberOfCells"])))
    return {name: values[name][ghost == 0] for name in CELL_ARRAYS}


def joints_of(folder: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Arrays of the joints, and which points are on the ground."""
    part = piece(folder / "joints.vtu")
    values, points = arrays(part.find("PointData")), arrays(part.find("Points"))["points"]
    # The lowest point of a joint between two blocks is at that height too.
    return values, (np.abs(points[:, 1]) < 1e-12) & (np.abs(values["normal"][:, 1]) > 0.5)


def at(record: dict[str, Any], key: str) -> Any:
    for name in key.split("."):
        record = record[name]
    return record


def numbers(value: Any) -> list[float]:
    """All numbers in a record."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for item in value for number in numbers(item)]
    return [value] if isinstance(value, (int, float)) else []


@pytest.mark.parametrize("key", KINDS)
def test_result_has_key(key, solved):
    assert type(at(solved.record, key)) is KINDS[key]


def test_result_is_the_answer(solved):
    record = solved.record
    assert (solved.run.code, solved.run.err) == (0, "")
    assert record["status"] == "limit"
    assert record["title"] == "A wall"
    assert record["load_factor"] == pytest.approx(FRICTION, rel=1e-5)
    assert record["bounds"]["lower"] <= record["load_factor"] * (1.0 + 1e-9)
    assert record["load_factor"] <= record["bounds"]["upper"] * (1.0 + 1e-6)
    assert 0.0 <= record["error_estimate"] <= 1e-4
    assert record["method"] in ("fixed-point", "monolithic")
    assert max(record["residuals"].values()) <= 1e-4


def test_result_counts_the_mesh(solved):
    mesh = solved.record["mesh"]
    # 21 points between the blocks and 10 on the ground: nodes are shared by no two blocks.
    assert (mesh["bodies"], mesh["cells"], mesh["joint_points"]) == (BODIES, CELLS, 31)
    (part,) = {p.attrib["NumberOfPoints"]: p for p in pieces(solved.output)}.values()
    assert mesh["dofs"] == 2 * int(part.attrib["NumberOfPoints"])


def test_result_says_how_it_came_about(solved):
    record = solved.record
    assert record["ranks"] == 1
    assert record["version"] == fenics_contact.__version__
    assert 1 <= record["iterations"]["fixed_point"] < record["iterations"]["factorizations"]
    assert all(isinstance(item, str) for item in record["skipped"])
    for what in ("dead tractions", "live tractions", "negative direction", "capacity curve"):
        assert sum(what in item for item in record["skipped"]) == 1
    assert all(map(math.isfinite, numbers(record)))


@pytest.mark.parametrize(
    ("direction", "positive", "negative"),
    [("both", FRICTION, -FRICTION), ("negative", None, -FRICTION)],
)
def test_load_factor_of_the_reversed_load(direction, positive, negative, tmp_path, capsys):
    scene = write_scene(tmp_path, {"solve.direction": direction})
    assert run_here(["solve", scene, "-q", *OUTPUT_OFF], capsys).code == 0
    record = result(tmp_path / "scene")
    assert record["load_factor"] == pytest.approx(positive, rel=1e-5)
    assert record["load_factor_negative"] == pytest.approx(negative, rel=1e-5)


def test_nothing_else_is_written(solved):
    assert files(solved.output) == PARAVIEW | {"collapse.png", "result.json"}
    assert files(solved.folder) - {f"wall/{name}" for name in files(solved.output)} == {
        "wall",
        "wall.toml",
        "wall.msh",
    }
    assert f"written to {solved.output.name}" in solved.run.out


def check_picture(path: Path) -> None:
    content = path.read_bytes()
    width, height = struct.unpack(">II", content[16:24])
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    assert width >= 600 and height >= 300
    from matplotlib.image import imread

    shades = imread(path)[..., :3].mean(axis=2)
    assert np.mean(shades < 0.9) > 0.005, "an empty picture"


def test_collapse_is_drawn(solved):
    check_picture(solved.output / "collapse.png")


@pytest.mark.parametrize("ranks", [1, 2])
def test_every_piece_is_listed_once(ranks, solved, on_two_ranks):
    # ParaView reads a piece as often as it is listed, and its cells then lie over one another.
    output = (solved if ranks == 1 else on_two_ranks).output
    listed = ET.parse(output / "blocks000000.pvtu").getroot().iter("Piece")
    names = sorted(p.attrib["Source"] for p in listed)
    assert names == [f"blocks_p{rank}_000000.vtu" for rank in range(ranks)]


def test_fields_of_the_blocks(solved):
    for part in pieces(solved.output):
        points, cells = arrays(part.find("PointData")), arrays(part.find("CellData"))
        assert points.keys() >= POINT_ARRAYS
        assert cells.keys() >= CELL_ARRAYS
        for name in POINT_ARRAYS:
            assert points[name].shape == (int(part.attrib["NumberOfPoints"]), 3)
            assert np.all(np.isfinite(points[name]))
        for name in CELL_ARRAYS:
            assert cells[name].shape == (CELLS,)
            assert np.all(np.isfinite(cells[name]))
        assert sorted(np.unique(cells["body"])) == list(range(BODIES))


def test_fields_are_declared_for_all_pieces(solved):
    root = ET.parse(solved.output / "blocks000000.pvtu").getroot()
    assert {a.get("Name") for a in root.iterfind(".//PPointData/PDataArray")} >= POINT_ARRAYS
    assert {a.get("Name") for a in root.iterfind(".//PCellData/PDataArray")} >= CELL_ARRAYS


def test_mode_is_the_wall_sliding_as_a_whole(solved):
    mode = arrays(pieces(solved.output)[0].find("PointData"))["collapse_mode"]
    assert mode[:, 0].min() > 0.0
    assert np.ptp(mode[:, 0]) <= 1e-3 * mode[:, 0].max()
    assert np.abs(mode[:, 1:]).max() <= 1e-3 * mode[:, 0].max()


def test_stresses_carry_the_weight(solved):
    cells = arrays(pieces(solved.output)[0].find("CellData"))
    xx, yy, xy = (cells[f"stress_{name}"] for name in ("xx", "yy", "xy"))
    # Cells have one area; the mean of stress_yy is minus half the pressure at the base.
    assert yy.mean() == pytest.approx(-0.5 * WEIGHT / 0.8, rel=1e-5)
    zz = 0.2 * (xx + yy)  # plane strain
    mises = np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * xy**2)
    np.testing.assert_allclose(cells["von_mises"], mises, rtol=1e-6)


def test_joints_file(solved):
    part = piece(solved.output / "joints.vtu")
    values = arrays(part.find("PointData"))
    count = solved.record["mesh"]["joint_points"]
    assert int(part.attrib["NumberOfPoints"]) == count
    assert len(arrays(part.find("Points"))["points"]) == count
    assert values.keys() >= JOINT_ARRAYS
    assert all(values[name].shape == (count,) for name in JOINT_ARRAYS)
    assert set(values["state"]) <= {0.0, 1.0, 2.0}
    ends = arrays(part.find("Cells"))
    assert len(ends["connectivity"]) == 2 * int(part.attrib["NumberOfCells"])
    assert set(ends["connectivity"]) == set(range(count))


def test_joints_obey_their_law(solved):
    values, ground = joints_of(solved.output)
    largest = values["pressure"].max()
    friction = np.where(ground, FRICTION, ROUGH)
    assert values["pressure"].min() >= 0.0
    assert np.all(np.abs(values["shear"]) <= friction * values["pressure"] + 1e-5 * largest)
    assert values["gap"].min() >= -1e-9
    assert np.all(values["pressure"][values["gap"] > 1e-7] <= 1e-4 * largest)


def test_ground_carries_weight_and_load(solved):
    values, ground = joints_of(solved.output)
    x, y = np.abs(values["force"][ground, :2].sum(axis=0))
    assert (x, y) == pytest.approx((FRICTION * WEIGHT, WEIGHT), rel=1e-5)
    loaded = values["pressure"] > 1e-3 * values["pressure"].max()
    assert set(values["state"][ground & loaded]) == {1.0}  # slips


def test_two_ranks_give_the_same_answer(solved, on_two_ranks):
    one, two = solved.record, on_two_ranks.record
    assert on_two_ranks.run.code == 0
    assert two["ranks"] == 2
    assert two["load_factor"] == pytest.approx(one["load_factor"], rel=1e-8)
    assert two["bounds"] == pytest.approx(one["bounds"], rel=1e-8, abs=1e-12)
    assert two["mesh"] == one["mesh"]


def test_two_ranks_write_all_pieces(solved, on_two_ranks):
    output = on_two_ranks.output
    assert files(output) == files(solved.output) | {"blocks_p1_000000.vtu"}
    cells = [own_cells(piece(output / f"blocks_p{rank}_000000.vtu")) for rank in (0, 1)]
    together = np.concatenate([part["body"] for part in cells])
    alone = own_cells(pieces(solved.output)[0])["body"]
    assert sorted(together) == sorted(alone)
    assert all(len(part["body"]) for part in cells)
    check_picture(output / "collapse.png")


def test_two_ranks_write_the_same_joints(solved, on_two_ranks):
    one, two = (
        arrays(piece(s.output / "joints.vtu").find("PointData")) for s in (solved, on_two_ranks)
    )
    # Points may come in another order.
    for name in ("pressure", "state"):
        assert len(one[name]) == len(two[name])
        assert np.sum(one[name]) == pytest.approx(np.sum(two[name]), rel=1e-3)


@pytest.mark.parametrize(
    ("switched_off", "expected"),
    [
        (("paraview",), {"result.json", "collapse.png"}),
        (("pictures",), {"result.json"} | PARAVIEW),
        (("paraview", "pictures"), {"result.json"}),
    ],
)
def test_output_switched_off(switched_off, expected, tmp_path, capsys):
    scene = write_scene(tmp_path, {f"output.{name}": False for name in switched_off})
    assert run_here(["solve", scene], capsys).code == 0
    assert files(tmp_path / "scene") == expected
    skipped = result(tmp_path / "scene")["skipped"]
    for name in switched_off:
        assert any(f"output.{name} = false" in item for item in skipped)


@pytest.mark.parametrize("ranks", [1, 2])
def test_capacity_curve(ranks, tmp_path):
    # A tower that topples: its joints open bit by bit.
    rough = {"joints.default.friction": 0.8, "foundations.base.friction": 0.8}
    write_scene(tmp_path, rough | {"output.capacity": 5, "output.paraview": False}, "tower")
    found = run(["solve", "scene.toml", "-o", "out"], tmp_path, ranks)
    assert found.code == 0
    assert files(tmp_path / "out") == {
        "capacity.csv",
        "capacity.png",
        "collapse.png",
        "result.json",
    }
    with (tmp_path / "out" / "capacity.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    factor = np.array([float(row["load_factor"]) for row in rows])
    displacement = np.array([float(row["displacement_m"]) for row in rows])
    assert len(rows) == 5
    assert [row["converged"] for row in rows] == ["1"] * 5
    assert np.all(np.diff(displacement) > 0.0) and displacement[0] > 0.0
    assert np.all(np.diff(factor) >= -1e-6)
    assert 0.0 < factor[0] < 0.5 * factor[-1]
    assert factor[-1] == pytest.approx(result(tmp_path / "out")["load_factor"], rel=1e-5)
    check_picture(tmp_path / "out" / "capacity.png")


def test_output_is_next_to_the_scene(tmp_path):
    (tmp_path / "scenes").mkdir()
    write_scene(tmp_path / "scenes", name="my.block.toml")
    found = run(["solve", "scenes/my.block.toml", *OUTPUT_OFF], tmp_path)
    assert found.code == 0
    assert files(tmp_path / "scenes" / "my.block") == {"result.json"}


def test_output_option_makes_the_folder(tmp_path):
    write_scene(tmp_path)
    found = run(["solve", "scene.toml", "-o", "runs/first", *OUTPUT_OFF], tmp_path)
    assert found.code == 0
    assert files(tmp_path / "runs" / "first") == {"result.json"}
    assert not (tmp_path / "scene").exists()


def test_quiet_prints_nothing(tmp_path):
    write_scene(tmp_path)
    found = run(["solve", "scene.toml", "-q"], tmp_path)
    assert (found.code, found.out, found.err) == (0, "", "")
    assert result(tmp_path / "scene")["status"] == "limit"


@pytest.mark.parametrize("ranks", [1, 2])
def test_verbose_prints_more(ranks, solved, tmp_path):
    write_scene(tmp_path, WALL, "wall", "wall.toml")
    found = run(["solve", "wall.toml", "-v"], tmp_path, ranks)
    assert found.code == 0
    assert found.out.count("skipped: dead tractions") == 1
    assert "skipped" not in solved.run.out
    assert len(found.out.splitlines()) > len(solved.run.out.splitlines())


@pytest.mark.parametrize("ranks", [1, 2])
def test_check_says_what_is_in_a_scene(ranks, tmp_path):
    live = {"loads.live.traction": {"left": [500.0, 0.0]}}
    write_scene(tmp_path, live | {"title": "A wall", "supports.right": "roller"}, "wall")
    before = files(tmp_path)
    found = run(["check", "scene.toml"], tmp_path, ranks)
    assert (found.code, found.err) == (0, "")
    lines = found.out.splitlines()
    assert lines[0] == "A wall"
    expected = (
        # A vertical roller on the right: it leaves the blocks there a motion.
        ("blocks: 5 (5 floating, 0 held by supports)", "64 cells", "area 0.32 m2"),
        ("joint default: Coulomb friction 0.3", "length 1.4 m"),
        ("foundation base: Coulomb friction 0.3", "length 0.8 m"),
        ("support right: roller", "length 0.4 m"),
        (f"dead load: resultant (0, -{WEIGHT:.6g}) N",),
        (f"live load: resultant ({WEIGHT + 500.0 * 0.4:.6g}, 0) N",),
        ("skipped: dead tractions",),
        ("skipped: capacity curve",),
    )
    for start, *rest in expected:
        (line,) = [line for line in lines if line.startswith(start)]
        assert all(part in line for part in rest)
    assert "skipped: live tractions" not in found.out
    assert files(tmp_path) == before


def solve_with(folder: Path, capsys, *settings: str) -> dict[str, Any]:
    """result.json of the wall with other settings."""
    scene = write_scene(folder, WALL, "wall", "wall.toml")
    sets = [word for setting in settings for word in ("--set", setting)]
    out = run_here(
        ["solve", scene, "-o", folder / "out", "--set", "output.pictures=false", *sets], capsys
    )
    assert out.code == 0
    return result(folder / "out")


def test_continuation_in_the_result(tmp_path, capsys):
    record = solve_with(
        tmp_path,
        capsys,
        "solve.control=load",
        "solve.slip=load-steps",
        "solve.direction=both",
        "output.capacity=5",
    )
    assert record["control"] == "load"
    assert record["slip_reference"] == "previous load step"
    for part, sign in ((record, 1.0), (record["negative"], -1.0)):
        path = part["continuation"]
        factors = [sign * step["load_factor"] for step in path["steps"]]
        assert factors == sorted(factors)
        assert sign * path["equilibrium_up_to"] == pytest.approx(FRICTION, rel=1e-3)
        # The bound of the program is met before any load factor fails.
        assert path["none_found_at"] is None
        assert part["static_factor"] == pytest.approx(sign * FRICTION, rel=1e-6)
        assert part["kinematic_factor"] == pytest.approx(sign * FRICTION, rel=1e-6)
    with (tmp_path / "out" / "capacity.csv").open() as file:
        points = list(csv.DictReader(file))
    assert [float(p["load_factor"]) for p in points] == pytest.approx(
        [step["load_factor"] for step in record["continuation"]["steps"]]
    )


def test_states_and_worst_joint_in_the_result(tmp_path, capsys):
    record = solve_with(tmp_path, capsys, "solve.states=lowest")
    assert record["slip_reference"] == "stress-free state"
    assert {state["status"] for state in record["states"]} == {"limit"}
    assert record["load_factor"] == min(state["load_factor"] for state in record["states"])
    worst = record["worst_joint"]
    assert set(worst) == {"point", "position", "group", "law", "residual"}
    assert 0 <= worst["point"] < record["mesh"]["joint_points"]
    assert worst["group"] in {"default", "base"}


@pytest.mark.parametrize("method", ["splitting", "active-set", "monolithic"])
def test_methods_write_the_same_files(tmp_path, capsys, method):
    record = solve_with(tmp_path, capsys, f"solve.method={method}")
    assert record["method"] == method
    assert record["load_factor"] == pytest.approx(FRICTION, rel=1e-6)
    assert files(tmp_path / "out") >= PARAVIEW
    assert ("splitting" in record["iterations"]) == (method != "monolithic")


# ---- methods, control, slip and states

#: A dead push to the right of 400 Pa on 0.5 m of a block of 1 m x 0.5 m: the two ends differ.
PUSH = 400.0 * 0.5 / (0.5 * 1000.0 * 9.81)
PUSHED = {"loads.dead.traction": {"left": [400.0, 0.0]}, "solve.direction": "both"}


def capacity_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "capacity.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(
    ("options", "control", "reference"),
    [
        ({}, "work", "stress-free state"),
        ({"solve.control": "load"}, "load", "stress-free state"),
        (
            {"solve.control": "load", "solve.slip": "load-steps"},
            "load",
            "previous load step",
        ),
    ],
)
def test_result_says_what_was_prescribed(options, control, reference, tmp_path, capsys):
    scene = write_scene(tmp_path, options | PUSHED)
    assert run_here(["solve", scene, "-q", *OUTPUT_OFF], capsys).code == 0
    record = result(tmp_path / "scene")
    assert (record["control"], record["slip_reference"]) == (control, reference)
    exact = {1.0: FRICTION - PUSH, -1.0: -FRICTION - PUSH}
    assert record["load_factor"] == pytest.approx(exact[1.0], rel=1e-5)
    assert record["load_factor_negative"] == pytest.approx(exact[-1.0], rel=1e-5)
    for sign, end in ((1.0, record), (-1.0, record["negative"])):
        # The signs are those of the load factor.
        for name in ("static_factor", "kinematic_factor"):
            assert end[name] == pytest.approx(exact[sign], rel=1e-5)
        assert ("continuation" in end) == (control == "load")
        if control == "load":
            check_continuation(end["continuation"], sign, exact[sign])
        check_worst_joint(end["worst_joint"], record)


def check_continuation(path: dict[str, Any], sign: float, exact: float) -> None:
    steps = [sign * step["load_factor"] for step in path["steps"]]
    assert steps[0] == 0.0
    assert all(first < second for first, second in itertools.pairwise(steps))
    assert sign * path["equilibrium_up_to"] == steps[-1]
    assert abs(exact) * (1.0 - 2e-4) <= steps[-1] <= abs(exact) * (1.0 + 1e-6)
    failed = path["none_found_at"]
    assert failed is None or sign * failed >= abs(exact) * (1.0 - 1e-6)
    assert all(math.isfinite(step["displacement"]) for step in path["steps"])


def check_worst_joint(worst: dict[str, Any], record: dict[str, Any]) -> None:
    assert worst.keys() == {"point", "position", "group", "law", "residual"}
    assert 0 <= worst["point"] < record["mesh"]["joint_points"]
    assert worst["group"] == "base"
    x, y = worst["position"]
    assert -1e-12 <= x <= 1.0 + 1e-12 and y == pytest.approx(0.0, abs=1e-12)
    assert worst["law"] in record["residuals"]
    assert abs(worst["residual"]) <= 1e-5


def test_continuation_says_where_no_equilibrium_was_found(tmp_path, capsys):
    # The wall tips at 1; associative friction would carry 1.5, which stops no steps.
    rough = {"joints.default.friction": 1.5, "foundations.base.friction": 1.5}
    scene = write_scene(tmp_path, rough | {"solve.control": "load"}, "wall")
    assert run_here(["solve", scene, "-q", *OUTPUT_OFF], capsys).code == 0
    record = result(tmp_path / "scene")
    path = record["continuation"]
    assert record["load_factor"] == pytest.approx(1.0, rel=1e-6)
    assert record["bounds"]["upper"] == pytest.approx(1.5, rel=1e-6)
    assert path["equilibrium_up_to"] <= 1.0 <= path["none_found_at"]
    assert path["none_found_at"] - path["equilibrium_up_to"] <= 1e-4


@pytest.mark.parametrize("direction", ["positive", "negative", "both"])
def test_states_found_are_listed(direction, tmp_path, capsys):
    scene = write_scene(tmp_path, {"solve.states": "lowest", "solve.direction": direction})
    assert run_here(["solve", scene, "-q", *OUTPUT_OFF], capsys).code == 0
    record = result(tmp_path / "scene")
    ends = [(record, -1.0 if direction == "negative" else 1.0)]
    if direction == "both":
        ends.append((record["negative"], -1.0))
    for end, sign in ends:
        names = [state["start"] for state in end["states"]]
        assert names[0] == "dead load" and len(names) == len(set(names)) == 5
        for state in end["states"]:
            assert state.keys() == {"start", "status", "load_factor"}
            assert state["status"] == "limit"
            assert state["load_factor"] == pytest.approx(sign * FRICTION, rel=1e-5)


def test_states_are_not_listed_where_the_first_will_do(solved):
    record = solved.record
    assert "states" not in record and "continuation" not in record
    assert (record["control"], record["slip_reference"]) == ("work", "stress-free state")


@pytest.fixture(scope="module")
def continued(tmp_path_factory) -> list[tuple[Run, Path]]:
    """Runs on one and two ranks with the load factor raised from zero, and a capacity curve."""
    changes = WALL | {"solve.control": "load", "output.capacity": 4, "output.paraview": False}
    found = []
    for ranks in (1, 2):
        folder = tmp_path_factory.mktemp("continued")
        write_scene(folder, changes, "wall")
        found.append((run(["solve", "scene.toml", "-o", "out"], folder, ranks), folder / "out"))
    return found


@pytest.mark.parametrize("ranks", [1, 2])
def test_capacity_curve_is_the_path(ranks, continued):
    found, output = continued[ranks - 1]
    assert (found.code, found.err) == (0, "")
    assert files(output) == {"capacity.csv", "capacity.png", "collapse.png", "result.json"}
    rows, steps = capacity_of(output), result(output)["continuation"]["steps"]
    assert list(rows[0]) == ["displacement_m", "load_factor", "work", "converged"]
    # All steps, however many points were asked for.
    assert len(rows) == len(steps) > 4
    assert [row["converged"] for row in rows] == ["1"] * len(rows)
    for row, step in zip(rows, steps, strict=True):
        assert float(row["load_factor"]) == step["load_factor"]
        assert float(row["displacement_m"]) == step["displacement"]
        work = WEIGHT * step["displacement"]
        assert float(row["work"]) == pytest.approx(work, rel=1e-9, abs=1e-15)
    check_picture(output / "capacity.png")


def test_load_factor_by_continuation_does_not_depend_on_the_ranks(continued):
    one, two = (result(output) for _, output in continued)
    assert (one["ranks"], two["ranks"]) == (1, 2)
    assert one["load_factor"] == pytest.approx(FRICTION, rel=1e-6)
    assert two["load_factor"] == pytest.approx(one["load_factor"], rel=1e-8)
    reached = [record["continuation"]["equilibrium_up_to"] for record in (one, two)]
    assert reached[1] == pytest.approx(reached[0], rel=1e-8)
