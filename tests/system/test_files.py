"""The files a run writes: result.json, ParaView files, pictures, the capacity curve."""

from __future__ import annotations

import csv
import functools
import itertools
import math
import shutil
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

import fenics_contact
from tests.quick import slow, slow_rows
from tests.system.program import Run, files, result, run, run_here, write_scene
from tests.vtu import values_of

# A wall of 5 blocks (64 cells) of 0.8 m x 0.4 m; it slides on its base, all joints are rougher.
FRICTION, ROUGH, WEIGHT, BODIES, CELLS = 0.3, 0.6, 0.8 * 0.4 * 1000.0 * 9.81, 5, 64
WALL = {"title": "A wall", "joints.default.friction": ROUGH}

POINT_ARRAYS = {"displacement", "collapse_mode"}
CELL_ARRAYS = {"stress_xx", "stress_yy", "stress_xy", "von_mises", "body", "material"}
CELL_ARRAYS |= {"principal_1", "principal_2", "direction_2_x", "direction_2_y"}
JOINT_ARRAYS = {"pressure", "shear", "gap", "slip"}
JOINT_VECTORS = {"displacement", "collapse_mode"}
FACET_ARRAYS = {"state", "group", "friction", "utilisation", "opening"}
PICTURES = {"collapse.png", "forces.png", "scene.png", "stress.png", "thrust.png"}
DRAWN = {"collapse.png", "figures.npz", "viewer.html"}
PARAVIEW = {"blocks.pvd", "blocks000000.pvtu", "blocks_p0_000000.vtu", "joints.vtu"}

FORMATS = ("svg", "pdf")

OUTPUT_OFF = ["--set", "output.paraview=false", "--set", "output.pictures=false"]

#: Kinds of what result.json must hold.
KINDS = {
    str: "status method version control slip_reference title",
    float: "load_factor bounds.lower bounds.upper error_estimate static_factor kinematic_factor"
    " residuals.equilibrium residuals.penetration residuals.complementarity residuals.friction"
    " seconds.total seconds.read seconds.compile seconds.assemble seconds.bonded seconds.solve"
    " seconds.write",
    int: "iterations.fixed_point iterations.factorizations iterations.mode_factorizations"
    " mesh.bodies mesh.cells mesh.dofs mesh.joint_points ranks",
    list: "skipped failures",
    dict: "worst_joint",
    type(None): "load_factor_negative",
}


@dataclass(frozen=True)
class Solved:
    """A run of the wall and what it wrote."""

    run: Run
    folder: Path

    @property
    def output(self) -> Path:
        return self.folder / "wall"

    @property
    def record(self) -> dict[str, Any]:
        return result(self.output)

    @property
    def pieces(self) -> list[ET.Element]:
        """The ranks' parts of the blocks, found as ParaView finds them: .pvd, .pvtu, .vtu."""
        (parallel,) = ET.parse(self.output / "blocks.pvd").getroot().iter("DataSet")
        listed = ET.parse(self.output / parallel.attrib["file"]).getroot().iter("Piece")
        return [piece(self.output / part.attrib["Source"]) for part in listed]

    @property
    def joints(self) -> dict[str, np.ndarray]:
        return arrays(piece(self.output / "joints.vtu"), "PointData")

    @property
    def facets(self) -> dict[str, np.ndarray]:
        return arrays(piece(self.output / "joints.vtu"), "CellData")

    @property
    def on_ground(self) -> np.ndarray:
        points = arrays(piece(self.output / "joints.vtu"), "Points")["Points"]
        # The lowest point of a joint between two blocks is at that height too.
        return (np.abs(points[:, 1]) < 1e-12) & (np.abs(self.joints["normal"][:, 1]) > 0.5)


def piece(path: Path) -> ET.Element:
    """The one piece of a .vtu file."""
    (only,) = ET.parse(path).getroot().iter("Piece")
    return only


def arrays(part: ET.Element, section: str) -> dict[str, np.ndarray]:
    """Data arrays of a piece by name, a row for every point or cell."""
    found = {}
    for array in part.findall(f"{section}/DataArray"):
        found[array.get("Name", "")] = values_of(array)
    return found


def wall_on(ranks: int, *more: str) -> Any:
    """A fixture: the wall solved on so many ranks, for all tests."""

    @pytest.fixture(scope="module")
    def made(tmp_path_factory) -> Solved:
        folder = tmp_path_factory.mktemp("solved")
        write_scene(folder, WALL, "wall", "wall.toml")
        return Solved(run(["solve", "wall.toml", *more], folder, ranks), folder)

    return made


solved, on_two_ranks = wall_on(1), wall_on(2, "--fast", "-v")
on_two_ranks_by_mesh = wall_on(2, "--set", "solve.distribute=true", "--fast")


def numbers(value: Any) -> list[float]:
    """All numbers in a record."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for item in value for number in numbers(item)]
    return [value] if isinstance(value, (int, float)) else []


def check_picture(path: Path) -> None:
    picture = imread(path, "png")
    assert picture.shape[0] >= 300 and picture.shape[1] >= 600
    assert np.mean(picture[..., :3].mean(axis=2) < 0.9) > 0.005, "an empty picture"


# ---- result.json


def test_result_has_keys_of_a_kind(solved):
    for key, kind in ((key, kind) for kind, keys in KINDS.items() for key in keys.split()):
        value = functools.reduce(lambda table, name: table[name], key.split("."), solved.record)
        assert type(value) is kind, key


def test_result_is_the_answer(solved):
    record = solved.record
    assert (solved.run.code, solved.run.err) == (0, "")
    assert (record["status"], record["title"], record["failures"]) == ("limit", "A wall", [])
    assert record["load_factor"] == pytest.approx(FRICTION, rel=1e-5)
    assert record["bounds"]["lower"] <= record["load_factor"] * (1.0 + 1e-9)
    assert record["load_factor"] <= record["bounds"]["upper"] * (1.0 + 1e-6)
    assert 0.0 <= record["error_estimate"] <= 1e-4
    assert record["method"] in ("fixed-point", "monolithic")
    assert max(record["residuals"].values()) <= 1e-4


def test_result_says_how_it_came_about(solved):
    record, mesh = solved.record, solved.record["mesh"]
    # 21 points between the blocks and 10 on the ground: nodes are shared by no two blocks.
    assert (mesh["bodies"], mesh["cells"], mesh["joint_points"]) == (BODIES, CELLS, 31)
    assert mesh["dofs"] == 2 * int(solved.pieces[0].attrib["NumberOfPoints"])
    assert (record["ranks"], record["version"]) == (1, fenics_contact.__version__)
    assert 1 <= record["iterations"]["fixed_point"] < record["iterations"]["factorizations"]
    for what in ("dead tractions", "live tractions", "negative direction", "capacity curve"):
        assert sum(what in item for item in record["skipped"]) == 1
    assert all(map(math.isfinite, numbers(record)))
    assert not {"continuation", "negative"} & record.keys()  # not asked for


def test_nothing_else_is_written(solved):
    assert files(solved.output) == PARAVIEW | DRAWN | {"result.json"}
    besides = files(solved.folder) - {f"wall/{name}" for name in files(solved.output)}
    assert besides == {"wall", "wall.toml", "wall.msh"}
    assert solved.run.out.endswith(f"next: fenics-contact report {solved.output.name}\n")
    check_picture(solved.output / "collapse.png")


@pytest.mark.parametrize("options", [["--pictures", "--jobs", "2"], *slow(["--pictures"])])
def test_all_pictures_are_those_that_the_report_draws(options, solved, tmp_path, capsys):
    assert (
        run_here(["solve", solved.folder / "wall.toml", "-o", tmp_path, *options], capsys).code == 0
    )
    assert files(tmp_path) == PARAVIEW | PICTURES | {"result.json", "viewer.html"}
    later = tmp_path / "later"
    shutil.copytree(solved.output, later)
    assert run_here(["report", later], capsys).code == 0
    assert files(later) == files(solved.output) | PICTURES | {"report.html"}
    for picture in PICTURES:
        check_picture(tmp_path / picture)
        assert (later / picture).read_bytes() == (tmp_path / picture).read_bytes()


def test_pictures_in_other_formats(tmp_path, capsys):
    formats = {"output.formats": ["svg", "pdf"], "output.paraview": False}
    formats |= {"output.pictures": "all"}
    scene = write_scene(tmp_path, WALL | formats, "wall")
    assert run_here(["solve", scene], capsys).code == 0
    names = {f"{Path(name).stem}.{suffix}" for name in PICTURES for suffix in FORMATS}
    assert files(tmp_path / "scene") == names | {"result.json", "viewer.html"}
    for name in names:
        start = (tmp_path / "scene" / name).read_bytes()[:5]
        assert start == (b"<?xml" if name.endswith("svg") else b"%PDF-")


# ---- fields of the blocks


def test_fields_of_the_blocks(solved):
    (part,) = solved.pieces
    points, cells = arrays(part, "PointData"), arrays(part, "CellData")
    assert {points[name].shape for name in POINT_ARRAYS} == {
        (int(part.attrib["NumberOfPoints"]), 3)
    }
    assert {cells[name].shape for name in CELL_ARRAYS} == {(CELLS,)}
    for values in (*points.values(), *cells.values()):
        assert np.all(np.isfinite(values))
    assert sorted(np.unique(cells["body"])) == list(range(BODIES))
    # The wall slides as a whole; a warp by 1 moves it by 8 % of its size.
    assert np.linalg.norm(points["collapse_mode"], axis=1).max() == pytest.approx(0.08 * 0.8)
    x, *rest = points["collapse_mode"].T
    assert x.min() > 0.0
    assert max(np.ptp(x), np.abs(rest).max()) <= 1e-3 * x.max()


def test_stresses_carry_the_weight(solved):
    cells = arrays(solved.pieces[0], "CellData")
    xx, yy, xy = (cells[f"stress_{name}"] for name in ("xx", "yy", "xy"))
    # Cells have one area; the mean of stress_yy is minus half the pressure at the base.
    assert yy.mean() == pytest.approx(-0.5 * WEIGHT / 0.8, rel=1e-5)
    zz = 0.2 * (xx + yy)  # plane strain
    mises = np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * xy**2)
    np.testing.assert_allclose(cells["von_mises"], mises, rtol=1e-6)


# ---- joints


def test_joints_file(solved):
    part, count = piece(solved.output / "joints.vtu"), solved.record["mesh"]["joint_points"]
    assert int(part.attrib["NumberOfPoints"]) == count == len(arrays(part, "Points")["Points"])
    assert all(solved.joints[name].shape == (count,) for name in JOINT_ARRAYS)
    assert all(solved.joints[name].shape == (count, 3) for name in JOINT_VECTORS)
    lines = int(part.attrib["NumberOfCells"])
    assert all(solved.facets[name].shape == (lines,) for name in FACET_ARRAYS)
    assert set(solved.facets["state"]) <= {0.0, 1.0, 2.0}
    assert set(zip(solved.facets["group"], solved.facets["friction"], strict=True)) == {
        (0.0, ROUGH),
        (1.0, FRICTION),
    }
    ends = arrays(part, "Cells")
    assert len(ends["connectivity"]) == 2 * int(part.attrib["NumberOfCells"])
    assert set(ends["connectivity"]) == set(range(count))


def test_joints_obey_their_law_and_carry_weight_and_load(solved):
    values, ground = solved.joints, solved.on_ground
    pressure, largest = values["pressure"], values["pressure"].max()
    friction = np.where(ground, FRICTION, ROUGH)
    assert pressure.min() >= 0.0
    assert np.all(np.abs(values["shear"]) <= friction * pressure + 1e-5 * largest)
    assert values["gap"].min() >= -1e-9
    assert np.all(pressure[values["gap"] > 1e-7] <= 1e-4 * largest)
    x, y = np.abs(values["force"][ground, :2].sum(axis=0))
    assert (x, y) == pytest.approx((FRICTION * WEIGHT, WEIGHT), rel=1e-5)
    ends = arrays(piece(solved.output / "joints.vtu"), "Cells")["connectivity"].astype(int)
    loaded = np.all((ground & (pressure > 1e-3 * largest))[ends.reshape(-1, 2)], axis=1)
    assert set(solved.facets["state"][loaded]) == {1.0}  # slips


def test_meshio_knows_the_format_of_all_files(solved):
    for name in ("joints.vtu", "blocks_p0_000000.vtu"):
        assert ET.parse(solved.output / name).getroot().get("version") in ("0.1", "1.0")


def test_joints_move_with_the_blocks(solved):
    (part,) = solved.pieces
    (scale,) = (
        float(values_of(array)[0])
        for array in ET.parse(solved.output / "joints.vtu").getroot().iterfind(".//FieldData/*")
    )
    (other,) = (
        float(array.text or "")
        for array in ET.parse(solved.output / "blocks_p0_000000.vtu").iterfind(".//FieldData/*")
    )
    assert scale == pytest.approx(other, rel=1e-9)
    # Joints between blocks move as the wall does; on the ground they stay.
    mode, ground = solved.joints["collapse_mode"], solved.on_ground
    x = arrays(part, "PointData")["collapse_mode"][:, 0]
    assert mode[~ground, 0] == pytest.approx(x.mean(), rel=1e-3)
    assert not np.any(mode[ground])
    # The rates are those of the mode in the file.
    assert np.abs(solved.joints["slip_rate"][ground]) == pytest.approx(x.mean(), rel=1e-3)


def test_principal_stresses(solved):
    cells = arrays(solved.pieces[0], "CellData")
    tensor = np.array(
        [
            [cells["stress_xx"], cells["stress_xy"]],
            [cells["stress_xy"], cells["stress_yy"]],
        ]
    ).T
    exact = np.linalg.eigvalsh(tensor)
    tolerance = 1e-9 * np.abs(exact).max()
    np.testing.assert_allclose(cells["principal_2"], exact[:, 0], atol=tolerance)
    np.testing.assert_allclose(cells["principal_1"], exact[:, 1], atol=tolerance)
    direction = np.column_stack([cells["direction_2_x"], cells["direction_2_y"]])
    turned = np.einsum("cij,cj->ci", tensor, direction)
    scaled = cells["principal_2"][:, None] * direction
    np.testing.assert_allclose(turned, scaled, atol=10.0 * tolerance)


# ---- two ranks


def test_two_ranks_give_the_same_answer(solved, on_two_ranks):
    one, two = solved.record, on_two_ranks.record
    assert (on_two_ranks.run.code, two["ranks"]) == (0, 2)
    assert two["load_factor"] == pytest.approx(one["load_factor"], rel=1e-8)
    assert two["bounds"] == pytest.approx(one["bounds"], rel=1e-8, abs=1e-12)
    assert two["mesh"] == one["mesh"]
    for name in ("pressure", "state"):  # points may come in another order
        found = [each.joints | each.facets for each in (solved, on_two_ranks)]
        assert sum(found[1][name]) == pytest.approx(sum(found[0][name]), rel=1e-3)
        assert len(found[0][name]) == len(found[1][name])


def test_two_ranks_that_share_tasks_write_the_files_of_one(solved, on_two_ranks):
    assert files(on_two_ranks.output) == files(solved.output)
    check_picture(on_two_ranks.output / "collapse.png")


def test_two_ranks_that_share_the_mesh_write_all_pieces(solved, on_two_ranks_by_mesh):
    on_two_ranks = on_two_ranks_by_mesh
    assert on_two_ranks.record["load_factor"] == pytest.approx(solved.record["load_factor"])
    assert files(on_two_ranks.output) == files(solved.output) | {"blocks_p1_000000.vtu"}
    cells = [arrays(part, "CellData") for part in on_two_ranks.pieces]
    own = [c["body"][c.get("vtkGhostType", np.zeros(len(c["body"]))) == 0] for c in cells]
    assert all(len(part) for part in own)
    alone = arrays(solved.pieces[0], "CellData")["body"]
    assert sorted(np.concatenate(own)) == sorted(alone)
    check_picture(on_two_ranks.output / "collapse.png")


# ---- what is written, and where


OUTPUT = {"paraview": PARAVIEW, "pictures": DRAWN}


@pytest.mark.parametrize("off", [{"paraview"}, {"pictures"}])
def test_output_switched_off(off, tmp_path, capsys):
    scene = write_scene(tmp_path, {f"output.{name}": False for name in off})
    assert run_here(["solve", scene], capsys).code == 0
    assert files(tmp_path / "scene") == {"result.json"}.union(
        *(OUTPUT[name] for name in OUTPUT.keys() - off)
    )
    skipped = result(tmp_path / "scene")["skipped"]
    assert all(any(f"output.{name} = false" in item for item in skipped) for name in off)


@pytest.mark.parametrize(
    ("option", "folder"), [([], "scenes/my.block"), (["-o", "runs/first"], "runs/first")]
)
def test_quiet_output_next_to_the_scene_or_where_it_is_told(
    option, folder, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes").mkdir()
    write_scene(tmp_path / "scenes", name="my.block.toml")
    found = run_here(["solve", "scenes/my.block.toml", "-q", *option, *OUTPUT_OFF], capsys)
    assert (found.code, found.out, found.err) == (0, "", "")
    assert files(tmp_path / folder) == {"result.json"}
    assert len(list(tmp_path.rglob("result.json"))) == 1


def test_verbose_prints_more(solved, on_two_ranks):
    found = on_two_ranks.run
    assert found.code == 0
    assert "skipped" not in found.out + solved.run.out
    assert len(found.out.splitlines()) > len(solved.run.out.splitlines())


def test_check_says_what_is_in_a_scene(tmp_path, capsys):
    live = {"loads.live.traction": {"left": [500.0, 0.0]}}
    write_scene(tmp_path, live | {"title": "A wall", "supports.right": "roller"}, "wall")
    before = files(tmp_path)
    plain = run_here(["check", tmp_path / "scene.toml"], capsys).out
    assert not any(word in plain for word in ("skipped", "cells", "points"))
    assert plain.endswith(f"next: fenics-contact stands {tmp_path / 'scene.toml'}\n")
    found = run_here(["check", tmp_path / "scene.toml", "-v"], capsys)
    assert (found.code, found.err, files(tmp_path)) == (0, "", before)
    lines = found.out.splitlines()
    assert lines[0] == "A wall"
    for start, *rest in (
        # A vertical roller on the right: it leaves the blocks there a motion.
        ("blocks: 5 (5 floating, 0 held by supports)", "64 cells", "area 0.32 m2"),
        ("joint default: Coulomb friction 0.3", "length 1.4 m"),
        ("foundation base: Coulomb friction 0.3", "length 0.8 m"),
        ("support right: roller", "length 0.4 m"),
        (f"dead load: resultant (0, -{WEIGHT:.6g}) N",),
        (f"live load: resultant ({WEIGHT + 500.0 * 0.4:.6g}, 0) N",),
    ):
        (line,) = [line for line in lines if line.startswith(start)]
        assert all(part in line for part in rest)
    assert "skipped" not in found.out


def test_check_in_units_of_engineers(tmp_path, capsys):
    changes = {"joints.default.cohesion": 2e3, "plane.thickness": 0.5, "output.units": "mm"}
    scene = write_scene(tmp_path, changes, "wall")
    found = run_here(["check", scene], capsys)
    assert "joint default: Coulomb friction 0.3 (16.7 degrees), cohesion 0.002 MPa" in found.out
    assert "length 1400 mm" in found.out
    assert f"dead load: resultant (0, -{0.5e-3 * WEIGHT:.6g}) kN\n" in found.out
    found = run_here(["check", scene, "--set", "output.units=m"], capsys)
    assert "length 1.4 m" in found.out
    assert f"live load: resultant ({0.5e-3 * WEIGHT:.6g}, 0) kN\n" in found.out


# ---- directions, methods, control, slip and states


def solve_here(folder: Path, capsys, changes: dict[str, Any], mesh: str = "block") -> dict:
    """result.json of a scene with changes, solved in this process without fields and pictures."""
    scene = write_scene(folder, changes, mesh)
    assert run_here(["solve", scene, "-q", *OUTPUT_OFF], capsys).code == 0
    return result(folder / "scene")


REFERENCE = {"stress-free": "stress-free state", "load-steps": "previous load step"}


@pytest.mark.parametrize(
    ("control", "slip"),
    [("work", "stress-free"), *slow_rows(("load", "stress-free")), ("load", "load-steps")],
)
def test_result_says_what_was_prescribed(control, slip, tmp_path, capsys):
    # A dead push to the right of 400 Pa on 0.5 m of a block of 1 m x 0.5 m: the two ends differ.
    push = 400.0 * 0.5 / (0.5 * 1000.0 * 9.81)
    pushed = {"loads.dead.traction": {"left": [400.0, 0.0]}, "solve.direction": "both"}
    record = solve_here(tmp_path, capsys, {"solve.control": control, "solve.slip": slip} | pushed)
    assert (record["control"], record["slip_reference"]) == (control, REFERENCE[slip])
    for sign, end, factor in (
        (1.0, record, record["load_factor"]),
        (-1.0, record["directions"]["negative"], record["load_factor_negative"]),
    ):
        exact = sign * FRICTION - push
        for found in (factor, end["static_factor"], end["kinematic_factor"]):
            assert found == pytest.approx(exact, rel=1e-5)
        assert ("continuation" in end) == (control == "load")
        if control == "load":
            check_continuation(end["continuation"], sign, abs(exact))
        worst = end["worst_joint"]
        assert worst.keys() == {"point", "position", "group", "law", "residual"}
        assert worst["law"] in record["residuals"] and abs(worst["residual"]) <= 1e-5
        assert 0 <= worst["point"] < record["mesh"]["joint_points"] and worst["group"] == "base"
        x, y = worst["position"]
        assert -1e-12 <= x <= 1.0 + 1e-12 and y == pytest.approx(0.0, abs=1e-12)


def check_continuation(path: dict[str, Any], sign: float, exact: float) -> None:
    steps = [sign * step["load_factor"] for step in path["steps"]]
    assert steps[0] == 0.0
    assert all(first < second for first, second in itertools.pairwise(steps))
    assert sign * path["equilibrium_up_to"] == steps[-1]
    assert exact * (1.0 - 2e-4) <= steps[-1] <= exact * (1.0 + 1e-6)
    failed = path["none_found_at"]
    assert failed is None or sign * failed >= exact * (1.0 - 1e-6)
    assert all(math.isfinite(step["displacement"]) for step in path["steps"])


#: Keys of one collapse that result.json has at the top level, too, for the first direction.
OF_A_COLLAPSE = "residuals error_estimate static_factor peak lowest range hinges states".split()

#: A push with the weight to the right or up, against which the block does not slide.
BY_DIRECTION = {
    "pushed": {"loads.dead.traction": {"left": [400.0, 0.0]}},
    "lifted": {"loads.live.body": [0.0, -9.81]},
    "tipped": {"foundations.base.friction": 4.0, "loads.dead.body": [1.0, -9.81]},
}


@pytest.mark.parametrize("name", BY_DIRECTION)
def test_both_directions_have_all_that_one_has(name, tmp_path, capsys):
    """The negative one as where it is asked for alone; the first is at the top level."""
    (tmp_path / "alone").mkdir()
    changes = BY_DIRECTION[name]
    both = solve_here(tmp_path, capsys, {**changes, "solve.direction": "both"})
    alone = solve_here(tmp_path / "alone", capsys, {**changes, "solve.direction": "negative"})
    assert set(both["directions"]) == {"positive", "negative"}
    assert set(alone["directions"]) == {"negative"}
    for direction, end in both["directions"].items():
        suffix = "_negative" if direction == "negative" else ""
        assert end["load_factor"] == both[f"load_factor{suffix}"]
    first = both["directions"]["positive"]
    for key in OF_A_COLLAPSE:
        assert first.get(key, both[key] if key in both else None) == both.get(key), key
    negative = both["directions"]["negative"]
    other = alone["directions"]["negative"]
    assert negative.keys() == other.keys() and negative["status"] == other["status"] == "limit"
    assert negative["load_factor"] == pytest.approx(other["load_factor"], rel=1e-6)
    assert negative["peak"]["status"] == other["peak"]["status"]
    assert negative["lowest"]["status"] == other["lowest"]["status"] == "none"
    points = [end["hinges"]["points"]["load_factor"] for end in (negative, other)]
    assert points[0] == pytest.approx(points[1], rel=1e-6)
    assert negative["range"]["lower"] == pytest.approx(other["range"]["lower"], rel=1e-6)


@pytest.mark.parametrize("direction", ["positive", "negative", "both"])
def test_ends_and_states_found_are_listed(direction, tmp_path, capsys):
    changes = {"solve.states": "lowest", "solve.direction": direction}
    record = solve_here(tmp_path, capsys, changes)
    negative = record["directions"].get("negative", record)
    ends = {"load_factor": record, "load_factor_negative": negative}
    for (name, end), sign in zip(ends.items(), (1.0, -1.0), strict=True):
        if direction in ("both", "positive" if sign > 0.0 else "negative"):
            exact = pytest.approx(sign * FRICTION, rel=1e-5)
            (state,) = end["states"]  # one state, however many searches lead to it
            told = {"load_factor": exact, "gap": pytest.approx(0.0, abs=1e-3)}
            assert state == {"start": state["start"], "status": "limit", **told}
            starts = state["start"].split("; ")
            assert len(starts) == len(set(starts)) == end["lowest"]["starts"] + 1 >= 3
            assert starts[0] == "path" and "little friction" in starts
            told |= {"status": "none", "starts": len(starts) - 1, "reason": None}
            assert end["lowest"] == told
            assert record[name] == end["iterations"]["history"][-1]["load_factor"] == exact
            assert end["bounds"]["lower"] <= record[name] + 1e-6
            assert record[name] <= end["bounds"]["upper"] + 1e-6
        else:
            assert record[name] is None


# ---- load factors by the forces of joint faces


#: (b - N / f_c) / h of the block of 1 m x 0.5 m, f_c = 0.1 MPa.
CRUSHED = (1.0 - 4905.0 / 1e5) / 0.5
CRUSHES = {
    "materials.default.compressive_strength": 1e5,
    "joints.default.friction": 2.0,
    "foundations.base.friction": 2.0,
}


@pytest.mark.parametrize(
    ("changes", "exact"), [({"solve.engine": "faces"}, FRICTION), (CRUSHES, CRUSHED)], ids=str
)
def test_what_faces_prove_is_in_the_record(changes, exact, tmp_path, capsys):
    record = solve_here(tmp_path, capsys, changes | {"solve.direction": "both"})
    assert record["directions"].keys() == {"positive", "negative"}
    for name, end in record["directions"].items():
        sign = -1.0 if name == "negative" else 1.0
        assert end["engine"] == "faces" and 0.0 <= end["gap"] <= 1e-3
        assert sign * end["load_factor"] == pytest.approx(exact, rel=1e-3)
        assert sign * end["kinematic_factor"] >= sign * end["load_factor"] * (1.0 - 1e-12)
        assert end["error_estimate"] is None
        assert end["hinges"]["points"]["load_factor"] == end["load_factor"]
        assert end["peak"]["status"] == "not_known"
        assert end["proof"].startswith("collapses at ") and not end["is_lowest"]
        assert all(state["gap"] <= 1e-3 for state in end["states"])
    assert (record["engine"], record["gap"]) == ("faces", record["directions"]["positive"]["gap"])


def test_the_console_says_what_faces_prove(tmp_path, capsys):
    scene = write_scene(tmp_path, CRUSHES | {"output.capacity": 4, "solve.direction": "both"})
    found = run_here(["solve", scene, "-v"], capsys)
    assert (found.code, found.err) == (0, "")
    lines = found.out.splitlines()
    proofs = [line for line in lines if line.startswith("collapses at ")]
    assert len(proofs) == 2
    assert "an equilibrium inside the friction cone and the compressive strengths" in proofs[0]
    for line in proofs:
        here = float(line.split("collapses at")[1].split(":")[0])
        assert abs(here) == pytest.approx(CRUSHED, rel=1e-3)
        _, more, end = line.partition("nothing carries more than")
        assert abs(float(end)) >= abs(here) if more else line.endswith("that is the limit load")
    for once in ("rigid blocks with elastic faces", "warning: capacity curve: no loading path"):
        assert sum(once in line for line in lines) == 1
    assert not any(line.startswith(("peak:", "mesh:")) for line in lines)
    assert "accuracy" not in found.out and "solve.peak" not in found.out
    assert "capacity.csv" not in files(tmp_path / "scene")
    assert any("capacity curve" in item for item in result(tmp_path / "scene")["skipped"])


@pytest.mark.parametrize(
    ("changes", "lines"),
    [
        ({}, ["path: limit 0.3", "follow, faces, rising load: not asked: path has answered"]),
        (
            {"solve.engine": "faces"},
            ["path, follow, rising load: not asked: faces alone is asked", "faces: limit 0.3"],
        ),
        (
            {"solve.control": "load"},
            [
                "path, follow, faces: not asked: rising load alone is asked for",
                "rising load: limit 0.3",
            ],
        ),
    ],
    ids=str,
)
def test_the_console_says_which_engines_were_asked(changes, lines, tmp_path, capsys):
    found = run_here(["solve", write_scene(tmp_path, changes), "-v"], capsys)
    assert found.code == 0
    told = [line for line in found.out.splitlines() if line.startswith("  engine ")]
    assert len(told) == 2
    assert [any(line.startswith(f"  engine {one}") for line in told) for one in lines] == [True] * 2


def test_the_joints_file_says_of_which_state_it_is(tmp_path, capsys):
    scene = write_scene(tmp_path, {"solve.engine": "faces", "output.pictures": False})
    assert run_here(["solve", scene, "-q"], capsys).code == 0
    text = (tmp_path / "scene" / "joints.vtu").read_text()
    assert f"<!-- {result(tmp_path / 'scene')['directions']['positive']['proof']}; state: " in text


# ---- capacity curve


def capacity_of(folder: Path) -> dict[str, np.ndarray]:
    """Columns of capacity.csv; its picture is looked at too."""
    check_picture(folder / "capacity.png")
    with (folder / "capacity.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["displacement_m", "load_factor", "work", "converged"]
    assert [row["converged"] for row in rows] == ["1"] * len(rows)
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("ranks", [1, *slow(2)])
def test_capacity_curve(ranks, tmp_path, capsys):
    # A tower that topples: its joints open bit by bit.
    rough = {"joints.default.friction": 0.8, "foundations.base.friction": 0.8}
    scene = write_scene(tmp_path, rough | {"output.capacity": 5, "output.paraview": False}, "tower")
    output = tmp_path / "out"
    line = ["solve", scene, "-o", output]
    found = run_here(line, capsys) if ranks == 1 else run(line, tmp_path, ranks)
    assert (found.code, found.err) == (0, "")
    assert files(output) == DRAWN | {"capacity.png", "capacity.csv", "result.json"}
    curve = capacity_of(output)
    factor, displacement = curve["load_factor"], curve["displacement_m"]
    assert len(factor) == 5
    assert np.all(np.diff(displacement) > 0.0) and displacement[0] > 0.0
    assert np.all(np.diff(factor) >= -1e-6)
    assert 0.0 < factor[0] < 0.5 * factor[-1]
    assert factor[-1] == pytest.approx(result(output)["load_factor"], rel=1e-5)


@pytest.mark.slow
def test_capacity_curve_of_load_control_is_its_path(tmp_path):
    changes = WALL | {"solve.control": "load", "output.capacity": 4, "output.paraview": False}
    write_scene(tmp_path, changes, "wall")
    records = []
    for ranks in (1, 2):
        output = tmp_path / str(ranks)
        found = run(["solve", "scene.toml", "-o", str(ranks)], tmp_path, ranks)
        assert (found.code, found.err) == (0, "")
        record, curve = result(output), capacity_of(output)
        steps = record["continuation"]["steps"]
        assert len(steps) > 4  # all steps, however many points were asked for
        assert list(curve["load_factor"]) == [step["load_factor"] for step in steps]
        assert list(curve["displacement_m"]) == [step["displacement"] for step in steps]
        work = WEIGHT * curve["displacement_m"]
        assert curve["work"] == pytest.approx(work, rel=1e-9, abs=1e-15)
        records.append((record["load_factor"], record["continuation"]["equilibrium_up_to"]))
    assert records[0][0] == pytest.approx(FRICTION, rel=1e-6)
    assert records[1] == pytest.approx(records[0], rel=1e-8)


@pytest.mark.slow
def test_capacity_curve_as_a_time_series(tmp_path):
    rough = {"joints.default.friction": 0.8, "foundations.base.friction": 0.8}
    write_scene(tmp_path, rough | {"output.capacity": 3, "output.pictures": False}, "tower")
    by_mesh = ["--set", "solve.distribute=true"]
    assert run(["solve", "scene.toml", "-o", "out", *by_mesh], tmp_path, 2).code == 0
    output = tmp_path / "out"
    with (output / "capacity.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    steps = list(ET.parse(output / "capacity.pvd").getroot().iter("DataSet"))
    times = [float(step.attrib["timestep"]) for step in steps]
    assert times == pytest.approx([1e3 * float(row["displacement_m"]) for row in rows], rel=1e-9)
    for step, row in zip(steps, rows, strict=True):
        listed = list(ET.parse(output / step.attrib["file"]).getroot().iter("Piece"))
        assert len(listed) == 2
        for part in listed:
            path = output / part.attrib["Source"]
            assert np.all(np.isfinite(arrays(piece(path), "PointData")["displacement"]))
            (factor,) = ET.parse(path).iterfind(".//FieldData/DataArray")
            assert float(factor.text or "") == pytest.approx(float(row["load_factor"]), rel=1e-9)
