"""Statuses in space are those of the plane: what stands, falls, is crushed, wedges or cancels."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.cli.command_line import main
from fenics_contact.spatial import Scene, limit_load, standing
from fenics_contact.spatial.standing import state_of
from tests.quick import each_once

DOWN, UP, X, Y = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
WEIGHT = 2000.0 * 9.81  # of 1 m3, N


def scene(blocks, friction=0.6, live=X, dead=(0.0, 0.0, -9.81), joint=None, **tables):
    """Blocks of 2000 kg/m3 under their weight; the live load is a direction or a table."""
    given = {"direction": list(live)} if isinstance(live, tuple) else live
    return Scene.from_tables(
        {
            "dimension": 3,
            "blocks": blocks,
            "materials": {"default": {"density": 2000.0}},
            "joints": {"default": {"friction": friction, **(joint or {})}},
            "loads": {"dead": {"body": list(dead)} if dead else {}, "live": given},
            **tables,
        },
        Path(),
    )


def box(low, high, fixed=False):
    return {"box": [list(map(float, low)), list(map(float, high))], "fixed": fixed}


def prism(corners, fixed=False, depth=1.0):
    """A body along y, from its corners in x and z."""
    return {"vertices": [[x, y, z] for y in (0.0, depth) for x, z in corners], "fixed": fixed}


def arch(count):
    """A semicircle of voussoirs, the first and the last one of them ground."""
    angle = np.linspace(0.0, math.pi, count + 1)
    at = [[(r * math.cos(a), r * math.sin(a)) for a in angle] for r in (1.0, 1.3)]
    return {
        f"v{k}": prism([at[0][k], at[1][k], at[1][k + 1], at[0][k + 1]], k in (0, count - 1))
        for k in range(count)
    }


def between(degrees):
    """A stone between fixed walls that lean towards each other, or apart."""
    d = math.tan(math.radians(degrees))
    return {
        "left": prism([(-2, 0), (-0.5, 0), (-0.5 + d, 1), (-2, 1)], True),
        "right": prism([(0.5, 0), (2, 0), (2, 1), (0.5 - d, 1)], True),
        "stone": prism([(-0.5, 0), (0.5, 0), (0.5 - d, 1), (-0.5 + d, 1)]),
    }


CUBE = {"a": box((0, 0, 0), (1, 1, 1))}
STACK = CUBE | {"b": box((0, 0, 1), (1, 1, 2))}


@pytest.mark.parametrize(
    "blocks, friction, live",
    [
        (arch(5), 0.3, DOWN),
        (arch(7), 0.5, {"body": [0.0, 0.0, -25.0]}),
        (STACK, 0.5, DOWN),
        (arch(7), 0.5, {"force": {"crown": {"block": "v3", "force": [0.0, 0.0, -100.0]}}}),
    ],
)
def test_more_of_the_weight_is_carried_without_end(blocks, friction, live):
    given = scene(blocks, friction, live)
    assert standing(given).status == "equilibrium"
    found = limit_load(given)
    assert (found.status, found.load_factor) == ("unbounded", np.inf)


@pytest.mark.parametrize("blocks", [arch(5), STACK])
def test_all_weight_taken_away_is_a_limit(blocks):
    reverse = replace(scene(blocks, 0.4, DOWN).solve, direction="negative")
    found = limit_load(replace(scene(blocks, 0.4, DOWN), solve=reverse))
    assert (found.status, found.load_factor_negative) == ("limit", pytest.approx(-1.0, abs=1e-5))
    lifted = limit_load(scene(blocks, 0.4, UP))
    assert (lifted.status, lifted.load_factor) == ("limit", pytest.approx(1.0, abs=1e-5))


def test_without_a_dead_load():
    inside = limit_load(scene(CUBE, 0.5, {"body": [3.0, 0.0, -9.81]}, dead=None))
    assert inside.status == "unbounded"
    outside = limit_load(scene(CUBE, 0.2, {"body": [3.0, 0.0, -9.81]}, dead=None))
    assert (outside.status, outside.load_factor) == ("limit", 0.0)


#: Two columns, and a beam between them that only friction holds.
HELD = {
    "left": box((0, 0, 0), (1, 1, 2)),
    "right": box((2, 0, 0), (3, 1, 2)),
    "beam": box((1, 0, 1), (2, 1, 1.4)),
}


@pytest.mark.parametrize(
    ("live", "blocks"), each_once([DOWN, UP, X, Y], [between(0.0), between(10.0), HELD])
)
def test_what_self_stress_alone_holds_does_not_rest(blocks, live):
    """A stone between upright walls, a wedge in a roof, a beam between columns."""
    given = scene(blocks, 0.62, live)
    assert standing(given).status == "no_equilibrium"
    found = limit_load(given)
    assert found.status == "no_equilibrium"
    assert math.isnan(found.load_factor)
    assert "no equilibrium was found under its dead load" in found.summary()


GROOVE = {
    "rock": prism([(-2, -0.5), (2, -0.5), (2, 2), (0, 0)], True, 3.0)
    | {"vertices": [[x, y, z] for y in (-3.0, 4.0) for x, z in ((0, 0), (2, 2), (2, 0))]},
    "side": {"vertices": [[x, y, z] for y in (-3.0, 4.0) for x, z in ((0, 0), (-2, 2), (-2, 0))],
             "fixed": True},
    "wedge": prism([(0, 0), (1, 1), (-1, 1)]),
}  # fmt: skip


@pytest.mark.parametrize("degrees", [10.0, 22.0, 24.0, 33.0])
def test_wedge_slides_along_a_groove(degrees):
    """E. Hoek, J.W. Bray, Rock slope engineering: tan(phi) / (sin(45) tan(plunge)) is safe from 1.

    The weight is turned in place of the groove of 90 degrees. Friction across the groove, which
    they leave out, changes the normal forces a little.
    """
    plunge = math.radians(degrees)
    weight = (0.0, 9.81 * math.sin(plunge), -9.81 * math.cos(plunge))
    given = scene(GROOVE, 0.3, Y, weight)
    left = 0.3 * math.sqrt(2.0) * math.cos(plunge) - math.sin(plunge)
    found = limit_load(given)
    if left < 0.0:
        assert standing(given).status in ("unstable", "no_equilibrium")
        assert found.status in ("unstable", "no_equilibrium")
    else:
        assert found.status == "limit"
        assert found.load_factor == pytest.approx(left, rel=1e-2)


@pytest.mark.parametrize(
    "blocks, falling",
    [
        ({"wall": box((0, 0, 0), (0.5, 1, 2)), "strut": box((0.5, 0, 1), (1.5, 1, 1.2))}, [1]),
        (STACK | {"c": box((0.7, 0, 2), (1.7, 1, 3)), "d": box((3, 0, 0), (4, 1, 1))}, [2]),
        (CUBE | {"b": box((0.7, 0, 1), (1.7, 1, 2)), "air": box((5, 0, 3), (6, 1, 4))}, [1, 2]),
        (
            CUBE
            | {"other": box((4, 0, 0), (5, 1, 1)), "top": box((4.8, 0, 1), (5.8, 1, 2))}
            | {"higher": box((5, 0, 2), (5.8, 1, 2.5))},
            [2, 3],
        ),
    ],
)
def test_only_what_falls_is_named(blocks, falling):
    found = limit_load(scene(blocks, 0.6))
    assert found.status == "unstable"
    assert list(found.collapse.falling) == falling
    names = ", ".join(list(blocks)[k] for k in falling)
    assert f"block{'s' * (len(falling) > 1)} {names} fall" in found.summary()


@pytest.mark.parametrize(
    "height, strength, status",
    # Weight over area is 19.62 kPa per metre of height.
    [(1.2, 2.0e4, "unstable"), (1.2, 2.4e4, "limit"), (3.0, 5.8e4, "unstable")],
)
def test_a_block_that_its_own_weight_crushes(height, strength, status):
    pytest.importorskip("clarabel")
    blocks = {"a": box((0, 0, 0), (0.5, 0.5, height)), "firm": box((2, 0, 0), (3, 1, 0.5))}
    given = scene(blocks, 0.6, joint={"compressive_strength": strength})
    found = limit_load(given)
    assert found.status == status
    assert standing(given).status == ("equilibrium" if status == "limit" else "unstable")
    if status == "unstable":
        assert found.summary().endswith("block a falls by crushing")
    else:  # about the edge of the block of pressure: N / (f_c b) wide
        weight = WEIGHT * 0.25 * height
        arm = 0.25 - 0.5 * weight / (strength * 0.5)
        assert found.load_factor == pytest.approx(arm / (0.5 * height), rel=2e-3)


def test_blocks_that_can_wedge_are_told_beside_the_state():
    """A key that its own weight presses into its seat, pushed aside and up."""
    key = between(-10.0)
    push = {"force": {"a": {"block": "stone", "force": [1000.0, 0.0, 1200.0]}}}
    found = limit_load(scene(key, 0.75, push))
    assert found.status in ("limit", "unbounded")
    assert "stone wedges" in found.summary()


def test_load_factors_and_ends_agree():
    """A slope of almost the angle of friction: what is left is 5.2e-7."""
    blocks = {"a": box((0, 0, 0), (1, 1, 0.3))}
    dead = (0.4999994 * 8.774332777806967, 0.0, -8.774332777806967)
    found = limit_load(scene(blocks, 0.5, {"body": [9.81, 0.0, 0.0]}, dead)).collapse
    exact = (0.5 * -dead[2] - dead[0]) / 9.81
    assert found.status == "limit"
    assert found.load_factor <= found.upper
    assert found.load_factor == pytest.approx(exact, abs=1e-8)
    assert found.load_factor <= found.certificate.kinematic_factor


#: Their sum is 0 but for rounding.
PARTS = 0.1, 0.2, -0.3
SIDES = {"front": {"normal": [0, 1, 0]}, "back": {"normal": [0, -1, 0]}}


PAIRS = {
    name: {"block": "a", "force": [0, y, 0.1 * y]} for name, y in zip("pqr", PARTS, strict=True)
}


@pytest.mark.parametrize(
    "live", [{"traction": {"front": [0, 1e3, 0], "back": [0, -1e3, 0]}}, {"force": PAIRS}]
)
def test_a_load_that_cancels_is_refused(live):
    text = r"loads.live: what is given cancels on every block: loads.live.\w+.\w+ on"
    with pytest.raises(InputError, match=text):
        limit_load(scene(CUBE, 0.6, live, sides=SIDES))


def test_a_couple_is_a_load():
    live = {"traction": {"front": [0, 0, 700], "back": [0, 0, -700]}}
    found = limit_load(scene(CUBE, 0.6, live, sides=SIDES))
    # About an edge: weight times half the side against a couple of 700 N on an arm of 1 m.
    assert found.load_factor == pytest.approx(0.5 * WEIGHT / 700.0, rel=1e-5)


def test_a_dead_load_that_cancels_is_refused():
    blocks = {"a": box((0, 0, 0), (1, 1, 1))}
    load = {"body": [0.0, 0.0, -9.81], "force": {"lift": {"block": "a", "force": [0, 0, WEIGHT]}}}
    tables = {"loads": {"dead": load, "live": {"body": [1.0, 0.0, 0.0]}}}
    with pytest.raises(InputError, match=r"loads\.dead: what is given cancels"):
        standing(scene(blocks, **tables))


def test_nothing_is_proved_to_fall_while_there_are_doubts():
    blocks = CUBE | {"b": box((0.7, 0, 1), (1.7, 1, 2))}
    doubted = replace(scene(blocks).structure(), doubts=("edge of 'b' on 'a' is not understood",))
    found = state_of(doubted)
    assert (found.status, found.falling) == ("no_equilibrium", ())
    assert "edge of 'b'" in found.reason


FILE = """
dimension = 3
[blocks.stone]
box = [[0, 0, 0], [1, 1, 2]]
[blocks.roof]
box = [[{roof}, 0, 2], [{end}, 1, 2.2]]
[materials.default]
density = 2000.0
[joints.default]
friction = 0.6
[loads.dead]
body = [0, 0, -9.81]
[loads.live.force.thrust]
block = "stone"
at = [0.5, 0.5, 1.999]
force = [1e4, 0, 0]
[output]
paraview = false
pictures = false
"""


@pytest.mark.parametrize(
    "roof, factor, code, told",
    [
        (0.0, "0", 0, "it stands under its dead load (verified)"),
        (0.0, "0.3", 0, "it stands at 0.3 times the live load (verified)"),
        (0.0, "3", 3, "it does not stand at 3 times the live load: blocks stone"),
        (0.8, "0", 3, "it does not stand under its dead load: block roof falls"),
    ],
)
def test_stands_answers_its_own_question(tmp_path, capsys, roof, factor, code, told):
    path = tmp_path / "thrust.toml"
    path.write_text(FILE.format(roof=roof, end=roof + 1.0))
    assert main(["stands", str(path), "--load-factor", factor]) == code
    assert told in capsys.readouterr().out
    record = json.loads((tmp_path / "thrust_state" / "result.json").read_text())
    assert [one["outcome"] for one in record["attempts"]]


@pytest.mark.parametrize(
    "change", ["solve.time=1e-6", "solve.gap=1e-15", "blocks.roof.box=[[0.8,0,2],[1.8,1,2.2]]"]
)
def test_report_of_a_run_with_any_answer(tmp_path, change):
    path = tmp_path / "thrust.toml"
    path.write_text(FILE.format(roof=0.0, end=1.0))
    main(["solve", "-q", str(path), "--set", change])
    assert main(["report", "-q", str(tmp_path / "thrust")]) == 0
    assert (tmp_path / "thrust" / "report.html").is_file()


def test_check_lists_what_loads_act_on(tmp_path, capsys):
    path = tmp_path / "thrust.toml"
    more = "[loads.live.traction]\nfront = [0, 500, 0]\n[sides.front]\nnormal = [0, 1, 0]\n"
    floor = "[floors.slab]\nz = 2.2\nforce = 1000.0\n"
    path.write_text(FILE.format(roof=0.0, end=1.0) + more + floor)
    assert main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert "loads.live.traction.front: on 2 sides, area 2.2 m2, resultant (0, 1100, 0) N" in out
    assert re.search(r"force\.thrust: on block stone( at .*)?, resultant \(10000, 0, 0\) N", out)
    assert "floor slab: 1000 N/m2 at z = 2.2 m" in out
    assert "on 1 side, area 1 m2, resultant (0, 0, -1000) N" in out


def test_state_without_the_movement_of_the_ground_is_told(monkeypatch):
    """Where no state is found with the ground moved, another one proves that blocks stand."""
    source = import_module("fenics_contact.spatial.standing")
    under = source.state_under

    def blind(model, factor):
        return None if model.offset is not None else under(model, factor)

    blocks = {"base": box((0, 0, -1), (1, 1, 0), fixed=True), "stone": box((0, 0, 0), (1, 1, 1))}
    sinks = {"base": {"displacement": [0.0, 0.0, -1.0]}}
    moved = {"dead": {"body": [0.0, 0.0, -9.81], "movement": sinks}}
    tables = {"loads": moved | {"live": {"direction": [1.0, 0.0, 0.0]}}}
    assert "(verified)" in standing(scene(blocks, **tables)).summary()
    monkeypatch.setattr(source, "state_under", blind)
    told = standing(scene(blocks, **tables)).summary()
    assert "it stands under its dead load (verified; not with the ground moved" in told


@pytest.mark.parametrize(
    ("factor", "question", "title"),
    [
        ("0", "Does it stand under its dead load?", "stands under its dead load"),
        (
            "0.3",
            "Does it stand at 0.3 times the live load?",
            "stands under 0.3 times the live load",
        ),
        (
            "3",
            "Does it stand at 3 times the live load?",
            "does not stand under 3 times the live load",
        ),
    ],
)
def test_files_tell_a_state_and_no_collapse(factor, question, title, tmp_path):
    path = tmp_path / "thrust.toml"
    path.write_text(FILE.format(roof=0.0, end=1.0).replace("pictures = false", ""))
    main(["stands", str(path), "--load-factor", factor])
    written = (tmp_path / "thrust_state" / "result.json").read_text()
    record = json.loads(written)
    assert record["answer"]["question"] == question
    for end in record["directions"].values():
        assert end["proof"].startswith("stands: forces in equilibrium and within friction")
    assert not re.search("collapses at|no collapse state|not verified|limit load", written)
    assert f'"caption":"{title}"' in (tmp_path / "thrust_state" / "viewer.html").read_text()
