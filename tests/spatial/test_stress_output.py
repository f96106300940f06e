"""Stresses of blocks as users meet them: keys, result, files, console, report, workers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from fenics_contact.cli import main
from fenics_contact.console import summary
from fenics_contact.elastic.files import draw_stresses
from fenics_contact.errors import InputError
from fenics_contact.spatial import Scene, limit_load
from fenics_contact.spatial.view import views_of
from fenics_contact.workers import Processes
from tests.vtu import values_of

#: Two blocks, one of them with a stone that cracks early, that tip about an edge.
TOWER = """
title = "Tower"
dimension = 3
[blocks]
size = 0.4
[blocks.lower]
box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
[blocks.upper]
box = [[0.2, 0.2, 1.0], [0.8, 0.8, 3.0]]
group = "weak"
[materials.default]
density = 2000.0
poisson = 0.25
[materials.weak]
density = 2000.0
tensile_strength = 1e3
[joints.default]
friction = 0.9
[loads.dead]
body = [0.0, 0.0, -9.81]
[loads.live]
body = [9.81, 0.0, 0.0]
[output]
stress = true
report = true
"""


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Any, Path]:
    folder = tmp_path_factory.mktemp("tower")
    (folder / "tower.toml").write_text(TOWER)
    scene = Scene.from_file(folder / "tower.toml")
    result = limit_load(scene)
    result.write(folder / "out")
    return scene, result, folder / "out"


def test_result_has_stresses_of_all_blocks(solved):
    _, result, _ = solved
    found = result.stress
    assert [one.name for one in found.blocks] == ["lower", "upper"]
    assert not found.missed
    for one in found.blocks:
        assert one.missing < 1e-6
        assert one.principal.shape == (len(one.points), 3)
        assert one.pressure[0] > one.tension[0] > 0.0
    upper = found.blocks[1]
    assert upper.pressure[1] == pytest.approx([0.8, 0.5, 1.0], abs=0.31)  # where it tips
    assert [one.name for one in found.cracked] == ["upper"]


def test_console_and_report_tell_them(solved):
    _, result, folder = solved
    text = summary(result)
    assert "stresses: pressure up to " in text
    assert "under these forces" in text
    assert "warning: block upper cracks without iron: a tension of" in text
    assert "is above the tensile strength of 1000 Pa" in text
    page = (folder / "report.html").read_text()
    assert "Stresses under the forces of this state" in page
    assert "cracks" in page


def test_the_picture_has_outlines_of_blocks(solved, tmp_path):
    """Grey lines, as many as sides of triangles along edges of sides that are seen."""
    _, result, _ = solved
    (view,) = views_of(result).values()
    draw_stresses(result.stress, view, tmp_path, ["svg"])
    drawn = (tmp_path / "stresses.svg").read_text()
    assert drawn.count("stroke: #595959") >= 2 * 2 * 9  # two pictures of two boxes


def test_files_hold_them(solved):
    _, result, folder = solved
    record = json.loads((folder / "result.json").read_text())
    told = record["directions"]["positive"]["stress"]
    assert [one["name"] for one in told["blocks"]] == ["lower", "upper"]
    assert told["blocks"][1]["tension"][0] == result.stress.blocks[1].tension[0]
    assert told["cracked"] == ["upper"]
    assert (folder / "stresses.png").exists()
    arrays = ElementTree.parse(folder / "stresses.vtu").iter("DataArray")
    values = {array.get("Name"): values_of(array) for array in arrays}
    points = sum(len(one.points) for one in result.stress.blocks)
    assert len(values["tension"]) == points
    assert values["pressure"].max() == pytest.approx(
        max(one.pressure[0] for one in result.stress.blocks)
    )
    assert set(np.unique(values["block"])) == {0, 1}
    assert '"stresses":{"pressure":[' in (folder / "viewer.html").read_text()


def test_workers_share_the_blocks(solved):
    scene, result, _ = solved
    with Processes(1) as beside:
        shared = limit_load(scene, beside=beside)
    for one, two in zip(result.stress.blocks, shared.stress.blocks, strict=True):
        assert one.block == two.block
        np.testing.assert_allclose(two.stress, one.stress, atol=1e-12 * one.pressure[0])


def test_nothing_is_meshed_unless_asked(solved):
    scene, _, _ = solved
    quiet = replace(scene, output=replace(scene.output, stress=False))
    assert limit_load(quiet).stress is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("blocks.size=-1.0", "mesh_size = -1.0 must be a positive number"),
        ("solve.quick=true", "output.stress: needs forces all over contacts"),
        ("materials.weak.poisson=0.6", "poisson = 0.6 must lie in"),
    ],
)
def test_wrong_values_are_refused(change, message, tmp_path):
    (tmp_path / "tower.toml").write_text(TOWER)
    with pytest.raises(InputError, match=message):
        Scene.from_file(tmp_path / "tower.toml", overrides=[change])


def test_planar_scenes_have_none(tmp_path, capsys):
    text = """
    [blocks.one]
    polygon = [[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]]
    [materials.default]
    density = 2000.0
    [joints.default]
    friction = 0.9
    [loads.dead]
    body = [0.0, -9.81]
    [loads.live]
    body = [9.81, 0.0]
    [output]
    stress = true
    """
    (tmp_path / "block.toml").write_text(text)
    assert main(["solve", str(tmp_path / "block.toml")]) == 2
    assert "output.stress is of scenes in space" in capsys.readouterr().err
