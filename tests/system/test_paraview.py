"""The screenshot that ParaView makes of a result."""

from __future__ import annotations

import shutil

import pytest
from matplotlib.image import imread

from tests.system.program import ROOT, run, run_command, write_scene


@pytest.mark.skipif(shutil.which("pvpython") is None, reason="ParaView (pvpython) is not installed")
def test_screenshot(tmp_path):
    write_scene(tmp_path, {"output.pictures": False}, "wall")
    assert run(["solve", "scene.toml", "-o", "out"], tmp_path).code == 0
    script = str(ROOT / "demos" / "paraview.py")
    found = run_command(["pvpython", "--force-offscreen-rendering", script, "out"], tmp_path)
    assert found.code == 0, found.out + found.err
    picture = imread(tmp_path / "out" / "paraview.png")
    assert picture.shape[1] == 1600 and picture[..., :3].std() > 0.02
