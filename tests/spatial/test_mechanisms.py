"""The table of mechanisms against values by hand, from Python and by the command."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from math import sqrt

import pytest

import fenics_contact
from fenics_contact.spatial import Scene
from tests.system.program import run_here

REST = """
[materials.default]
density = 2000.0
[joints.default]
friction = 0.6
[loads.dead]
body = [0.0, 0.0, -9.81]
[loads.live]
direction = [0.0, 1.0, 0.0]
[seismic]
confidence_factor = 1.0
demand = 2.5
[solve]
quick = true
"""
#: Two free walls of stacked stones, 1 m high, .2 and .4 m thick.
STONES = "".join(
    f"[blocks.{name}_{course}_{n}]\nbox = [[{n}, {y}, {z}], [{n + 1}, {y + t}, {z + 0.5}]]\n"
    for name, y, t in (("thin", 0.0, 0.2), ("thick", 3.0, 0.4))
    for course, z in ((1, 0.0), (2, 0.5))
    for n in range(1)
)
WALLS = f'dimension = 3\ntitle = "Two walls"\n{STONES}{REST}'


def scene_of(folder, text, **options):
    """The scene of a text."""
    (folder / "scene.toml").write_text(text)
    scene = Scene.from_file(folder / "scene.toml")
    return replace(scene, solve=replace(scene.solve, **options))


def factors(found):
    """Load factors by part and way; every one is proved."""
    for row in found.rows:
        assert row.end.status == "limit" and row.end.gap <= 1e-3
        assert row.end.certificate.passed
    return {f"{row.part} {row.way}": row.end.load_factor for row in found.rows}


def test_free_walls_overturn_one_after_the_other(tmp_path):
    """t / h each; once the thinner one is repaired the thicker one is the next of the whole."""
    found = fenics_contact.mechanisms(scene_of(tmp_path, WALLS))
    told = factors(found)
    for name, by_hand in {
        "thin outwards -y": 0.2,
        "thin inwards +y": 0.2,
        "thick outwards +y": 0.4,
        "whole +y": 0.2,
        "whole, next +y": 0.4,
        "thin along +x": 0.6,  # its upper course slides
    }.items():
        assert told[name] == pytest.approx(by_hand, rel=2e-3), name
    worst = found.rows[0]
    assert worst.check.acceleration == pytest.approx(0.2 * 9.81, rel=2e-3)
    assert "NOT enough" in repr(found).splitlines()[0]
    assert "turns about its foot" in worst.moves
    order = [row.check.acceleration for row in found.rows]
    assert order == sorted(order)


def test_what_is_repaired_is_not_asked(tmp_path):
    found = fenics_contact.mechanisms(scene_of(tmp_path, WALLS), ["thin_*"])
    told = factors(found)
    assert not any(name.startswith("thin") for name in told)
    assert told["whole -y"] == pytest.approx(0.4, rel=2e-3)


def test_corner_of_straight_joints(tmp_path):
    """Pieces of two walls that only touch: the corner turns out of one wall, sqrt(2) t / h."""
    stones = "".join(
        f"[blocks.{name}_{n}]\nbox = [{low}, {high}]\n"
        for n in range(3)
        for name, low, high in (
            ("west", [0.0, 0.2 + n, 0.0], [0.2, 1.2 + n, 1.0]),
            ("south", [1.0 * n, 0.0, 0.0], [1.0 + n, 0.2, 1.0]),
        )
    )
    scene = scene_of(tmp_path, f"dimension = 3\n{stones}{REST}")
    told = factors(fenics_contact.mechanisms(scene))
    (corner,) = (name for name in told if name.startswith("corner"))
    assert told[corner] == pytest.approx(sqrt(2.0) * 0.2, rel=5e-3)
    assert told["south part outwards -y"] == pytest.approx(0.2, rel=2e-3)


def test_facade_takes_the_stones_of_side_walls_with_it(tmp_path):
    """It turns as one with all stones but the lowest ones of the side walls, above a free wall."""
    builder = """[blocks]
builder = "facade"
length = 2.0
side = 1.2
height = 1.5
thickness = 0.3
brick = [1.0, 0.5]
"""
    scene = scene_of(tmp_path, f"dimension = 3\n{builder}{REST}")
    rows = []
    fenics_contact.mechanisms(
        scene,
        stop=lambda: "found" * any(row.part == "facade" for row in rows),
        tell=rows.append,
    )
    told = {f"{row.part} {row.way}": row for row in rows}
    # Volumes of courses over their height: the facade's, and those above the lowest at the sides.
    moves = {0: [(0.6, 0.15)], 1: [(0.42, 0.15), (0.72, 0.6)], 2: [(0.6, 0.15), (0.54, 0.75)]}
    holds = sum(volume * y for course in moves.values() for volume, y in course)
    turns = sum(volume * (0.25 + 0.5 * k) for k, course in moves.items() for volume, _ in course)
    for name in ("whole -y", "facade across -y"):
        factor = told[name].end.load_factor
        assert told[name].end.certificate.passed
        assert factor == pytest.approx(holds / turns, rel=2e-3) and factor > 0.3 / 1.5


def test_blocks_in_the_plane(tmp_path):
    pillars = "".join(
        f"[blocks.{name}_{n}]\npolygon = [[{x}, {n}], [{x + b}, {n}], [{x + b}, {n + 1}],"
        f" [{x}, {n + 1}]]\n"
        for name, x, b in (("left", 0.0, 0.4), ("right", 3.0, 0.8))
        for n in range(2)
    )
    text = f"{pillars}{REST}".replace("quick = true", "").replace("0.0, 0.0, -9", "0.0, -9")
    found = fenics_contact.mechanisms(scene_of(tmp_path, text.replace("0.0, 1.0, 0.0", "1.0, 0.0")))
    told = factors(found)
    assert told["whole -x"] == pytest.approx(0.2, rel=2e-3)
    assert told["right part +x"] == pytest.approx(0.4, rel=2e-3)


def test_stopped_search_keeps_its_rows(tmp_path):
    rows = []
    scene = scene_of(tmp_path, WALLS)
    found = fenics_contact.mechanisms(
        scene, stop=lambda: "enough" * (len(rows) > 2), tell=rows.append
    )
    assert 2 < len(found.rows) < 9
    assert found.stopped == "enough"


def test_command_and_report(tmp_path, monkeypatch, capsys):
    (tmp_path / "walls.toml").write_text(WALLS)
    monkeypatch.chdir(tmp_path)
    run = run_here(["mechanisms", "walls.toml", "--exclude", "thin", "-o", "out"], capsys)
    assert run.code == 0, run
    assert "whole +y: 0.4 g  a0* = 3.924 m/s2, 1.57 of the demand: enough" in run.out
    record = json.loads((tmp_path / "out/mechanisms.json").read_text())
    with (tmp_path / "out/mechanisms.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(record["rows"])
    for row in table:
        assert (tmp_path / "out" / row["picture"]).is_file()
        assert float(row["gap"]) <= 1e-3
    assert run_here(["report", "out"], capsys).code == 0
    page = (tmp_path / "out/report.html").read_text()
    assert page.count("<img") == len(table)
    assert "a0* / demand" in page


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--exclude", "nort", "--exclude", "x*"], "no part, group or block 'nort', 'x*'"),
        (["--set", "loads.live.force.a={block='thin_1_0', force=[0.0, 1.0, 0.0]}"], "floors.NAME"),
    ],
)
def test_wrong_input(tmp_path, monkeypatch, capsys, more, says):
    (tmp_path / "walls.toml").write_text(WALLS)
    monkeypatch.chdir(tmp_path)
    run = run_here(["mechanisms", "walls.toml", *more], capsys)
    assert run.code == 2
    assert says in run.err
    assert not (tmp_path / "walls_mechanisms").exists()


def test_meshed_scene_is_refused(tmp_path, monkeypatch, capsys):
    (tmp_path / "wall.toml").write_text('[mesh]\nfile = "wall.msh"\n')
    monkeypatch.chdir(tmp_path)
    run = run_here(["mechanisms", "wall.toml"], capsys)
    assert run.code == 2
    assert "[blocks] in place of [mesh]" in run.err
