"""The report on structures in space, from the files that `solve` writes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.system.program import run_here

SCENE = """
dimension = 3
title = "A <wall>"
[blocks]
builder = "wall"
length = 1.2
height = 1.0
thickness = 0.2
brick = [0.4, 0.25]
[materials.default]
density = 2000.0
[joints.default]
friction = 0.6
[loads.dead]
body = [0.0, 0.0, -9.81]
[loads.live]
direction = [0.0, 1.0, 0.0]
[floors.roof]
z = 1.0
force = 1e3
mass = true
[ties.stay]
from = [0.3, 0.1, 0.9]
ground = [0.3, -1.0, 0.0]
yield = 200.0
[seismic]
confidence_factor = 1.35
[solve]
direction = "both"
quick = true
"""


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """Folder of a result in both directions."""
    folder = tmp_path_factory.mktemp("report")
    (folder / "wall.toml").write_text(SCENE)
    return folder


def test_report_of_a_wall(solved, monkeypatch, capsys):
    monkeypatch.chdir(solved)
    assert run_here(["solve", "wall.toml"], capsys).code == 0
    record = json.loads((solved / "wall" / "result.json").read_text())
    assert record["directions"]["positive"]["mechanism"]["words"] == (
        "the whole structure turns about its foot to +y, tie stay yields"
    )
    assert {"collapse.png", "collapse_negative.png", "viewer.html", "blocks.vtu"} <= set(
        record["files"]
    )
    assert run_here(["report", "wall"], capsys).code == 0
    page = (solved / "wall" / "report.html").read_text()
    told = re.sub(r"<[^>]+>", " ", re.sub("<iframe.*</iframe>", "", page, flags=re.S))
    first, rest = re.sub(r"\s+", " ", told).split("The range of load factors", 1)
    for words in (
        "A &lt;wall&gt;",
        "At which horizontal acceleration of all masses does it collapse?",
        "The whole structure turns about its foot to",
        "torsion is not limited",
        "14, together 1.2 m wide, 0.2 m deep and 1 m high",
        "1 g sideways on all masses",
        "Coulomb friction 0.6 (31 degrees)",
        "yields at 0.2 kN",
        "1 kN/m2 at z = 1 m, with its mass",
    ):
        assert words.lower() in first.lower(), words
    for words in (
        "stay 0.2 kN 0.2 kN yields",
        "participating mass M*",
        "joint default",
        "Where the blocks touch",
        "moments on every block and node balance",
    ):
        assert words in rest, words
    assert "NO" not in rest.split()
    assert page.count("data:image/png") == 2
    assert "srcdoc=" in page
    assert not re.search(r"(src|href)=\"?https?:", page)


@pytest.mark.slow
def test_report_as_pdf(solved, monkeypatch, capsys):
    pytest.importorskip("weasyprint")
    monkeypatch.chdir(solved)
    if not (solved / "wall").exists():
        assert run_here(["solve", "wall.toml"], capsys).code == 0
    assert run_here(["report", "wall", "--pdf", "wall.pdf"], capsys).code == 0
    assert (solved / "wall.pdf").read_bytes().startswith(b"%PDF")


def test_page_1_has_the_verdict_and_all_loads(tmp_path, monkeypatch, capsys):
    """In the box whether the demand is met; below what presses on sides; one block as such."""
    monkeypatch.chdir(tmp_path)
    loads = """
[sides.back]
block = "upper"
normal = [0.0, -1.0, 0.0]
[loads.dead.traction]
back = [0.0, 50.0, 0.0]
[loads.dead.force.rafter]
force = [0.0, 20.0, 0.0]
block = "upper"
"""
    blocks = """[blocks]
lower.box = [[0.0, 0.0, 0.0], [1.0, 1.0, 0.5]]
upper.box = [[0.0, 0.3, 0.5], [1.0, 0.7, 1.5]]
[materials"""
    scene = re.sub(r"\[blocks\].*?\[materials", blocks, SCENE, flags=re.DOTALL)
    scene = re.sub(r"\[floors.*\[seismic", "[seismic", scene, flags=re.DOTALL)
    scene = scene.replace('"both"', '"positive"')
    text = f"{scene}{loads}".replace("factor = 1.35", "factor = 1.35\ndemand = 9.0")
    Path("stone.toml").write_text(text)
    assert run_here(["solve", "stone.toml"], capsys).code == 0
    assert run_here(["report", "stone"], capsys).code == 0
    page = Path("stone/report.html").read_text(encoding="utf-8")
    (box,) = re.findall(r'<p class="status limit">(.*?)</p>', page, flags=re.DOTALL)
    assert "asked for: NOT enough" in box
    assert page.count("NOT enough") == 2, "in the box, and in the table of the check"
    assert "A mechanism of one block alone: " in page
    first = page.partition("Assumptions")[2].partition("</table>")[0]
    for told in ("traction back, dead load", "force rafter, dead load"):
        assert told in first
