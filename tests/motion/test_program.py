"""The way after the peak as users ask for it: keys, files, words."""

from __future__ import annotations

import json
import math
import re

import pytest

from fenics_contact import InputError
from fenics_contact.console import Progress
from fenics_contact.spatial import limit_load
from tests.motion.structures import arch, box, in_plane
from tests.system.program import run_here, toml

WALL = {
    "dimension": 2,
    "blocks.wall.polygon": box(0, 0, 0.5, 5.0),
    "materials.default.density": 1800.0,
    "joints.default.friction": 0.7,
    "loads.dead.body": [0.0, -9.81],
    "loads.live.body": [9.81, 0.0],
    "solve.beyond": True,
    "solve.direction": "both",
    "output.report": True,
    "seismic.nonlinear": True,
    "seismic.limit_state": "SLC",
    "seismic.spectrum": {"ag": 0.16, "S": 1.2, "F0": 2.5, "TC": 0.45},
}


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """Folder and result.json of a free wall in both directions."""
    folder = tmp_path_factory.mktemp("wall")
    (folder / "wall.toml").write_text(toml(WALL))
    return folder


def test_files_and_words(solved, capsys):
    found = run_here(["solve", solved / "wall.toml", "-o", solved / "out"], capsys)
    assert found.code == 0
    assert "0.1 at once, " in found.out
    assert "non-linear check: d_SLC" in found.out
    written = {path.name for path in (solved / "out").iterdir()}
    for name in ("beyond", "beyond_negative"):
        assert {f"{name}.csv", f"{name}.png", f"{name}.pvd", f"{name}_00.vtu"} <= written
    record = json.loads((solved / "out" / "result.json").read_text())
    there, back = (record["directions"][name]["beyond"] for name in ("positive", "negative"))
    assert there["zero"] == pytest.approx(back["zero"], rel=1e-9)
    assert there["control"]["along"] == [1.0, 0.0]
    assert back["control"]["along"] == [-1.0, 0.0]
    check = record["directions"]["positive"]["seismic"]["nonlinear"]
    assert check["d_0"] == pytest.approx(0.25, abs=1e-6)  # of the centre of mass
    assert check["verdict"] == "enough"
    viewer = (solved / "out" / "viewer.html").read_text()
    shown = json.loads(re.search(r'application/json">(.*)</script>', viewer).group(1))
    way = shown["views"][0]["way"]
    assert [way[0]["at"], way[0]["carried"]] == pytest.approx([0.0, 0.1], abs=1e-6)
    assert way[-1]["at"] == pytest.approx(there["zero"], rel=1e-9)
    assert way[-1]["carried"] == 0.0
    wall = next(k for k, block in enumerate(shown["blocks"]) if not block["fixed"])
    assert way[-1]["pose"][wall][4] == pytest.approx(math.atan2(0.5, 5.0), abs=1e-4)
    page = (solved / "out" / "report.html").read_text()
    assert "After the peak" in page
    assert "ground acceleration that it stands" in page
    assert "What is left as the structure leans on, and its poses, live load reversed." in page


def test_ground_moves_on():
    blocks = arch(8, 0.2)
    movement = {"b9": {"displacement": [1e-3, 0.0]}}
    load = {"dead": {"body": [0.0, -9.81], "movement": movement}, "live": {"body": [9.81, 0.0]}}
    scene = in_plane(
        blocks, fixed=[8, 9], friction=1.0, loads=load, solve={"beyond": 0.02, "lowest": False}
    )
    result = limit_load(scene)
    way = result.collapse.beyond
    assert way.driven
    assert way.fine.why == "displacement"
    assert "as the ground moves on it is pressed with" in result.summary()


def test_table_is_written_in_a_hurry(tmp_path):
    scene = in_plane([box(0, 0, 0.5, 5.0)], solve={"beyond": 0.05})
    limit_load(scene).write(tmp_path, hurry=lambda: True)
    assert {path.name for path in tmp_path.iterdir()} == {"beyond.csv", "result.json"}
    last = (tmp_path / "beyond.csv").read_text().splitlines()[-1]
    assert float(last.split(",")[0]) >= 0.05


def test_way_that_is_stopped_says_why_no_check_is_made(tmp_path):
    begun, asked = [], []
    told = Progress(1e-6)
    told.phase = begun.append

    def stop():
        asked.extend(["way"] * ("after the peak" in begun))
        return "asked to end" if len(asked) > 20 else ""

    seismic = {key.partition(".")[2]: WALL[key] for key in WALL if key.startswith("seismic")}
    scene = in_plane([box(0, 0, 0.5, 5.0)], solve={"beyond": True}, seismic=seismic)
    result = limit_load(scene, told, stop=stop)
    why = "the way was stopped; give more solve.time, or solve.beyond = a displacement"
    assert f"non-linear check: not made: {why}" in result.summary()
    result.write(tmp_path, hurry=lambda: True)
    check = json.loads((tmp_path / "result.json").read_text())["directions"]["positive"]["seismic"]
    assert (check["nonlinear"], check["reason"]) == (None, why)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"solve": {"beyond": True, "fast": True}}, "beyond = true needs fast = false"),
        ({"solve": {"beyond": -1.0}}, "solve.beyond = -1.0 must be true, false or a displacement"),
        ({"output": {"control": [0.0, 1.0, 2.0]}}, "output.control"),
        ({"seismic": {"nonlinear": True}}, "seismic.nonlinear = true needs spectrum"),
        ({"seismic": {"spectrum": {"ag": 0.2}}}, "must have the keys ag, S, F0, TC"),
        ({"seismic": {"spectrum": [[0.1, 1.0], [1.0, 2.0]]}}, "rise from \\[0, above 0\\]"),
    ],
)
def test_wrong_keys_are_refused(tables, message):
    with pytest.raises(InputError, match=message):
        in_plane([box(0, 0, 0.5, 5.0)], **tables)
