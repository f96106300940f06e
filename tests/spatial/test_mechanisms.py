"""The table of mechanisms against values by hand, from Python and by the command."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from math import degrees, radians, sin, sqrt

import pytest

import fenics_contact
from fenics_contact.spatial import Scene
from tests.quick import slow
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


def names_of(row):
    """Parts and ways that have led to a row."""
    return f"{row.part} {row.way}", *row.also


def factors(found):
    """Load factors by part and way, by all that have led to a row; every one is proved."""
    for row in found.rows:
        assert row.end.status == "limit" and row.end.gap <= 1e-3
        assert row.end.certificate.passed
    return {name: row.end.load_factor for row in found.rows for name in names_of(row)}


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


def test_a_mechanism_has_one_row(tmp_path):
    """Two walls, four ways each; the whole, and the next of it, find the same ones again."""
    found = fenics_contact.mechanisms(scene_of(tmp_path, WALLS))
    mechanisms = [(row.moves, row.result.scene.live.body) for row in found.rows]
    assert len(mechanisms) == len(set(mechanisms)) == 8
    assert sum(len(row.also) for row in found.rows) == 8
    assert "also: " in repr(found)


def stack(name, y, t, *courses):
    """Stones of a wall 1 m long, by their lower and upper ends, m."""
    return "".join(
        f"[blocks.{name}_{n}_0]\nbox = [[0, {y}, {low}], [1, {y + t}, {high}]]\n"
        for n, (low, high) in enumerate(courses)
    )


def test_a_next_mechanism_that_a_part_has_before_is_no_row(tmp_path):
    """The low wall is repaired with what it touches, so that of the other one stone turns at .8.

    The whole of that wall turns before; the far wall is none by itself.
    """
    courses = (0.0, 0.5), (0.5, 1.0)
    stones = stack("low", 0.0, 0.1, courses[0]) + stack("high", 0.1, 0.4, *courses)
    stones += stack("far", 5.0, 0.9, *courses)
    rest = REST.replace("0.6", "1.2")
    rows = []
    scene = scene_of(tmp_path, f"dimension = 3\n{stones}{rest}")
    told = factors(
        fenics_contact.mechanisms(
            scene, tell=lambda done, total, row: rows.extend([row] * bool(row))
        )
    )
    assert told["whole -y"] == pytest.approx(0.2, rel=2e-3)
    assert 0.4 < told["high outwards -y"] < 0.5
    (left_out,) = (row for row in rows if f"{row.part} {row.way}" not in told)
    assert (left_out.part, left_out.way) == ("whole, next", "-y")
    assert left_out.end.load_factor == pytest.approx(0.8, rel=2e-3)
    assert told["whole, next +y"] == pytest.approx(0.9, rel=2e-3)


def test_a_next_mechanism_that_no_part_has_is_a_row(tmp_path):
    """A stack slides at its upper joint; once that is repaired it turns about its foot."""
    stones = stack("low", 0.0, 0.4, (0.0, 0.5), (0.5, 1.0))
    ground = "[foundations.ground]\nfriction = 0.9\n"
    scene = scene_of(tmp_path, f"dimension = 3\n{stones}{REST.replace('0.6', '0.3')}{ground}")
    found = fenics_contact.mechanisms(scene)
    told = factors(found)
    assert told["whole +y"] == pytest.approx(0.3, rel=2e-3)
    assert told["whole, next +y"] == pytest.approx(0.4, rel=2e-3)


def test_ties_are_told_where_they_take_part(tmp_path):
    """An anchor of the thick wall is told where that moves, slack or not, and nowhere else."""
    tie = "[ties.held]\nfrom = [0.5, 3.2, 0.8]\nground = [0.5, 9.0, 0.8]\nyield = 500.0\n"
    found = fenics_contact.mechanisms(scene_of(tmp_path, WALLS + tie))
    ties = {name: row.record()["ties"] for row in found.rows for name in names_of(row)}
    assert ties["thick inwards -y"] == "held 500 N (yields)"
    assert ties["thick outwards +y"] == "held (slack)"
    assert {text for name, text in ties.items() if name.startswith("thin")} == {""}


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


def test_wall_held_at_its_top_bends_upright(tmp_path):
    """Vertical bending: three stones turn out about the foot, the one with the tie's end back.

    With stones of thickness t up to z = h and one above of height b, whose middle is held, the
    virtual work is f h^2 / 2 = h t / 2 + b t + h t, of weights per height.
    """
    stones = "".join(
        f"[blocks.wall_{k}]\nbox = [[0.0, 0.0, {0.5 * k}], [1.0, 0.2, {0.5 * k + 0.5}]]\n"
        for k in range(4)
    )
    tie = "[ties.head]\nfrom = [0.5, 0.1, 1.75]\nground = [0.5, -4.0, 1.75]\nyield = 1.0e6\n"
    scene = scene_of(tmp_path, f"dimension = 3\n{stones}{tie}{REST}")
    found = fenics_contact.mechanisms(scene)
    told = factors(found)
    t, h, b = 0.2, 1.5, 0.5
    assert told["whole +y"] == pytest.approx((1.5 * h + b) * t / (0.5 * h**2), rel=2e-3)
    assert told["whole -y"] == pytest.approx(t / (h + b), rel=2e-3)  # the tie is slack
    (row,) = (row for row in found.rows if row.way == "+y")
    assert row.record()["ties"].startswith("head") and "elastic" in row.record()["ties"]


@pytest.mark.parametrize("friction", [0.2, *slow(0.02)])
def test_wall_held_at_both_ends_bends_level(tmp_path, friction):
    """Horizontal bending: the halves turn about their held ends, and a tie along it yields.

    Y e = f W (L / 4 - a), with the tie's arm e about the inner edge, ends held at a, weight W of a
    half; the ground resists with its friction times W (L / 2 - a) at most.
    """
    length, t, h, a, yields = 4.0, 0.2, 0.5, 0.1, 2000.0
    stones = "".join(
        f"[blocks.wall_{k}]\nbox = [[{2.0 * k}, 0.0, 0.0], [{2.0 * k + 2.0}, {t}, {h}]]\n"
        for k in range(2)
    )
    held = "".join(
        f"[ties.end_{k}]\nfrom = [{x}, 0.1, 0.25]\nground = [{x}, -4.0, 0.25]\nyield = 1.0e6\n"
        for k, x in enumerate((a, length - a))
    )
    along = f"[ties.along]\nfrom = [0.5, 0.19, 0.25]\nto = [3.5, 0.19, 0.25]\nyield = {yields}\n"
    ground = f"[foundations.ground]\nfriction = {friction}\n"
    scene = scene_of(tmp_path, f"dimension = 3\n{stones}{held}{along}{ground}{REST}")
    found = fenics_contact.mechanisms(scene)
    factor = factors(found)["whole +y"]
    weight = 2000.0 * 9.81 * 0.5 * length * t * h
    by_hand = yields * 0.19 / (weight * (0.25 * length - a))
    adds = friction * (0.5 * length - a) / (0.25 * length - a)
    assert by_hand < factor < by_hand + adds
    (row,) = (row for row in found.rows if row.way == "+y")
    assert "tie along yields" in row.moves


#: A free stone, 1 m x 0.2 m, 1 m high.
STONE = "[blocks.stone]\nbox = [[0.0, 0.0, 0.0], [1.0, 0.2, 1.0]]\n"


def by_hand(angle):
    """Load factor of the free stone in a direction: it turns about its long edge, or slides."""
    return min(0.6, 0.2 / max(abs(sin(radians(angle))), 1e-9))


def test_whole_goes_at_angles(tmp_path):
    scene = scene_of(tmp_path, f"dimension = 3\n{STONE}{REST}")
    found = fenics_contact.mechanisms(scene, angles=[0, 30, 45.5, 90])
    told = factors(found)
    assert set(told) == {f"whole {a} degrees" for a in ("0", "30", "45.5", "90")}
    for name, factor in told.items():
        assert factor == pytest.approx(by_hand(float(name.split()[1])), rel=2e-3)


def test_sweep_of_directions(tmp_path, monkeypatch, capsys):
    """Angle, load factor, a0* and mechanism in every row; one warning; worst.png."""
    text = f"dimension = 3\n{STONE}{REST}".replace("density", "young = 5.0\ndensity")
    (tmp_path / "stone.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    line = ["sweep", "stone.toml", "--vary", "loads.live.angle=0:330:12"]
    run = run_here(line, capsys)
    assert run.code == 0, run
    assert run.out.count("is very soft") == 1 and not run.err
    folder = tmp_path / "stone_sweep"
    record = json.loads((folder / "sweep.json").read_text())
    with (folder / "sweep.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(record["rows"]) == 12
    for row, one in zip(table, record["rows"], strict=True):
        angle = float(row["loads.live.angle"])
        assert float(row["load_factor"]) == pytest.approx(by_hand(angle), rel=2e-3)
        assert float(row["a0"]) == pytest.approx(9.81 * by_hand(angle), rel=5e-3)
        assert ("slides" if by_hand(angle) == 0.6 else "turns about its foot") in row["moves"]
        assert (one["a0"], one["moves"]) == (float(row["a0"]), row["moves"])
    assert {"sweep.png", "worst.png"} <= {path.name for path in folder.iterdir()}
    assert "12 of 12 points are there already" in run_here(line, capsys).out
    assert run_here(["report", "stone_sweep"], capsys).code == 0
    page = (folder / "report.html").read_text()
    assert "a0*, m/s2" in page and "turns about its foot" in page and page.count("<img") == 2


def test_sweep_tells_the_lowest_start_apart_from_the_lowest_factor(tmp_path, monkeypatch, capsys):
    """FC divides a0* alone, friction is the load factor of a flat stone."""
    flat = STONE.replace("0.2, 1.0]", "1.0, 0.2]")
    (tmp_path / "stone.toml").write_text(f"dimension = 3\n{flat}{REST}")
    monkeypatch.chdir(tmp_path)
    line = ["sweep", "stone.toml", "--vary", "joints.default.friction=0.2,0.3"]
    run = run_here([*line, "--vary", "seismic.confidence_factor=1,2"], capsys)
    assert "lowest load factor 0.2 at 0.2, 1, lowest a0* 0.981 m/s2 at 0.2, 2" in run.out
    run_here(["report", "stone_sweep"], capsys)
    page = (tmp_path / "stone_sweep/report.html").read_text()
    where = "joints.default.friction = 0.2, seismic.confidence_factor = 2"
    assert f"The lowest a0* is 0.981 m/s2 at {where}." in page


@pytest.mark.parametrize("units", ["SI", "m"])
def test_sweep_of_a_force_tells_it(tmp_path, monkeypatch, capsys, units):
    """A stone of 3924 N, .2 m thick, turns about its edge by a force at height z: W t / (2 z)."""
    force = '[loads.live.force.push]\nblock = "stone"\nforce = [0.0, 100.0, 0.0]\n'
    rest = REST.replace("[loads.live]\ndirection = [0.0, 1.0, 0.0]\n", force)
    rest = rest.partition("[seismic]")[0] + f'[output]\nunits = "{units}"\n'
    (tmp_path / "stone.toml").write_text(f"dimension = 3\n{STONE}{rest}")
    monkeypatch.chdir(tmp_path)
    at = "loads.live.force.push.at=[0.5,0.1,0.5],[0.5,0.1,0.8]"
    run = run_here(["sweep", "stone.toml", "--vary", at], capsys)
    carried = {"SI": ["784.8 N", "490.5 N"], "m": ["0.7848 kN", "0.4905 kN"]}[units]
    assert all(f": {text}" in run.out for text in carried)
    with (tmp_path / "stone_sweep/sweep.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["load"] for row in table] == carried
    run_here(["report", "stone_sweep"], capsys)
    page = (tmp_path / "stone_sweep/report.html").read_text()
    assert f"It carries {carried[1]}." in page and carried[0] in page


def test_sweep_of_directions_is_polar(tmp_path):
    (tmp_path / "stone.toml").write_text(f"dimension = 3\n{STONE}{REST}")
    vary = {"loads.live.angle": [0.0, 90.0, 180.0, 270.0], "solve.direction": ["both"]}
    found = fenics_contact.sweep(tmp_path / "stone.toml", vary)
    axes = found.plot()
    assert axes.name == "polar"
    curves = [line.get_xydata() for line in axes.get_lines() if len(line.get_xdata()) > 1]
    for curve in curves[:2]:  # the reverse of a direction is its opposite
        for angle, radius in curve:
            assert radius == pytest.approx(by_hand(degrees(angle)), rel=2e-3)
    assert axes.get_rmin() == 0.0


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("loads.live.angle=400", "must lie in -360 ... 360 degrees"),
        ("loads.dead.angle=30", "loads.dead.angle is that of a level body force"),
    ],
)
def test_angle_is_refused(tmp_path, monkeypatch, capsys, more, says):
    (tmp_path / "stone.toml").write_text(f"dimension = 3\n{STONE}{REST}")
    monkeypatch.chdir(tmp_path)
    run = run_here(["check", "stone.toml", "--set", more], capsys)
    assert run.code == 2 and says in run.err, run


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
        tell=lambda done, total, row: rows.extend([row] * bool(row)),
    )
    told = {f"{row.part} {row.way}": row for row in rows}
    # Volumes of courses over their height: the facade's, and those above the lowest at the sides.
    moves = {0: [(0.6, 0.15)], 1: [(0.42, 0.15), (0.72, 0.6)], 2: [(0.6, 0.15), (0.54, 0.75)]}
    holds = sum(volume * y for course in moves.values() for volume, y in course)
    turns = sum(volume * (0.25 + 0.5 * k) for k, course in moves.items() for volume, _ in course)
    factor = told["whole -y"].end.load_factor
    assert told["whole -y"].end.certificate.passed
    assert factor == pytest.approx(holds / turns, rel=2e-3)
    alone = told["facade across -y"]
    assert alone.end.certificate.passed
    assert 0.3 / 1.5 < alone.end.load_factor < factor  # stones that are not pushed hold it less


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
        scene,
        stop=lambda: "enough" * (len(rows) > 2),
        tell=lambda done, total, row: rows.extend([row] * bool(row)),
    )
    assert 2 < len(found.rows) < 9
    assert found.stopped == "enough; parts that were not asked may be worse"


def test_command_and_report(tmp_path, monkeypatch, capsys):
    (tmp_path / "walls.toml").write_text(WALLS)
    monkeypatch.chdir(tmp_path)
    run = run_here(["mechanisms", "walls.toml", "--exclude", "thin", "-o", "out"], capsys)
    assert run.code == 0, run
    assert "thick outwards +y: 0.4 g  a0* = 3.924 m/s2 = 0.4 g (1.57 times the" in run.out
    assert "also: whole +y" in run.out
    assert "8 of 8  thick along -x: 0.6 g  a0* = 5.886 m/s2" in run.out and "s left)" in run.out
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
    first, _, rest = page.partition("All mechanisms")
    assert "The worst of 4: " in first and first.count("<img") == 1 and "1.57 times the" in first
    assert "<thead>" in rest and "confidence factor" in first
    assert "Computed on 20" in page and "Torsion is not limited" in page  # solve.quick
    for text in ("2000 kg/m3", "Coulomb friction 0.6", "confidence factor", "2.5 m/s2"):
        assert text in page.partition("Assumptions")[2]


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
