"""The screenshot that ParaView makes of a result."""

from __future__ import annotations

import os
import shutil

import pytest
from matplotlib.image import imread

from tests.system.program import ROOT, run, run_command, write_scene

#: ParaView needs a display; xvfb-run is one that nobody sees.
DISPLAY = [] if "DISPLAY" in os.environ else ["xvfb-run", "-a"]
MISSING = [name for name in (*DISPLAY[:1], "pvpython") if shutil.which(name) is None]


@pytest.mark.skipif(len(MISSING) > 0, reason=f"not installed: {', '.join(MISSING)}")
def test_screenshot(tmp_path):
    write_scene(tmp_path, {"output.pictures": False}, "wall")
    assert run(["solve", "scene.toml", "-o", "out"], tmp_path).code == 0
    script = str(ROOT / "demos" / "screenshot.py")
    found = run_command([*DISPLAY, "pvpython", script, "out"], tmp_path)
    assert found.code == 0, found.out + found.err
    picture = imread(tmp_path / "out" / "paraview.png")[..., :3]
    assert picture.shape == (1200, 1200, 3)
    shown = picture.min(axis=2) < 0.95
    assert 0.2 < shown.mean() < 0.9  # blocks on white
    orange, blue = picture[..., 0] - picture[..., 2] > 0.5, picture[..., 2] - picture[..., 0] > 0.5
    assert orange.any() and blue.any()  # joints that are open, and that slip on the base
