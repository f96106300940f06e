"""Limit loads in space: statuses and what proves them, answers, files and the command line."""

from __future__ import annotations

import json
import math
import re
import tomllib
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.cli.command_line import main
from fenics_contact.scene.scene import JointLaw, SolveOptions
from fenics_contact.spatial import Load, Material, Scene, Seismic, builders
from fenics_contact.spatial.certificate import residuals_of
from fenics_contact.spatial.limit import limit_load, standing
from fenics_contact.sweeps.sweep import sweep
from fenics_contact.workers import Processes
from tests import second_solver
from tests.quick import each_once, slow_rows

#: A block of 1 m x 1 m x 2 m on rigid ground, pushed along x.
BLOCK = """
dimension = 3
title = "Block"
[blocks.stone]
box = [[0, 0, 0], [1, 1, 2]]
[materials.default]
density = 2000.0
[joints.default]
friction = 0.7
[loads.dead]
body = [0, 0, -9.81]
[loads.live]
direction = [1, 0, 0]
[output]
paraview = false
pictures = false
"""


@pytest.fixture
def path(tmp_path):
    """The file of the block."""
    file = tmp_path / "block.toml"
    file.write_text(BLOCK)
    return file


def scene_of(blocks, friction=0.6, push=(1.0, 0.0, 0.0), **solve):
    """A scene of blocks under their weight, pushed."""
    return Scene(
        blocks=tuple(blocks),
        materials={"default": Material(density=2000.0)},
        joints={"default": JointLaw(friction=friction)},
        dead=Load((0.0, 0.0, -9.81)),
        live=Load(direction=push),
        solve=SolveOptions(**solve),
    )


def block_scene(**tables):
    """The block with other tables."""
    given = tomllib.loads(BLOCK)
    return Scene.from_tables({**given, **tables}, Path())


def box(name, low, high, fixed=False):
    return {name: {"box": [low, high], "fixed": fixed}}


def test_what_is_told_of_a_limit(path):
    scene = Scene.from_file(path, overrides=["solve.direction='both'"])
    result = limit_load(replace(scene, seismic=Seismic(1.35)))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.5, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(-0.5, rel=1e-6)
    lines = result.summary().splitlines()
    assert lines[0] == "it collapses at 0.5000 g along +x, 0.5000 g along -x (verified)"
    assert lines[1].startswith("nothing carries more than 0.500")
    assert "a0* of 3.633 m/s2 = 0.3704 g" in lines[2]  # one part: e* = 1, a0* = alpha0 g / FC
    assert "with its friction forces that is the limit load" in result.summary(verbose=True)


def test_quick_says_what_it_leaves_out(path):
    result = limit_load(Scene.from_file(path, overrides=["solve.quick=true"]))
    assert "torsion is not limited" in result.summary().splitlines()[-1]


def test_a_block_that_overhangs_falls():
    blocks = box("low", [0, 0, 0], [1, 1, 1]) | box("high", [0.6, 0, 1], [1.6, 1, 2])
    result = limit_load(block_scene(blocks=blocks))
    assert result.status == "unstable"
    assert result.summary().startswith("it does not stand under its dead load: block")
    assert "high" in result.summary()
    assert math.isnan(result.load_factor)


@pytest.mark.filterwarnings("error")
def test_blocks_that_nothing_holds_fall():
    """Two that touch each other alone, above a block that stands."""
    loose = box("a", [0, 0, 3], [1, 1, 4]) | box("b", [0, 0, 4], [1, 1, 5])
    result = limit_load(block_scene(blocks=box("stone", [0, 0, 0], [1, 1, 2]) | loose))
    assert (result.status, result.collapse.falling) == ("unstable", (1, 2))
    assert result.summary() == "it does not stand under its dead load: blocks a, b fall"


def test_a_block_that_hangs_on_a_tie_stands():
    """Rounding turns it without end; that is no proof that it falls."""
    ground = {"ground": {"friction": 0.6, "z": 0.0}}
    rope = {"from": [2.5, 0.5, 1.4], "ground": [2.5, 0.5, 4.0], "yield": 1e5}
    blocks = box("stone", [0, 0, 0], [1, 1, 2]) | box("hangs", [2, 0, 0.5], [3, 1, 1.5])
    scene = block_scene(blocks=blocks, foundations=ground, ties={"rope": rope})
    assert standing(scene).status == "equilibrium"
    pushed = limit_load(scene)
    assert pushed.status == "not_converged"
    assert "the faces do not hold the blocks" in pushed.summary()


def test_a_block_between_walls_is_wedged():
    walls = box("left", [-1, 0, 0], [0, 1, 2], True) | box("right", [1, 0, 0], [2, 1, 2], True)
    blocks = walls | box("stone", [0, 0, 0], [1, 1, 2]) | box("floor", [0, 0, -1], [1, 1, 0], True)
    result = limit_load(block_scene(blocks=blocks))
    assert result.status == "unbounded"
    assert math.isinf(result.load_factor)
    told = "nothing limits the live load along +x: block stone wedges; if it really acts so,"
    assert result.summary().splitlines()[0] == f"{told} give a compressive_strength"


def test_live_load_against_the_dead_load():
    """A block that the dead load pushes, too."""
    scene = block_scene(loads={"dead": {"body": [3, 0, -9.81]}, "live": {"body": [-1.0, 0, 0]}})
    both = replace(scene, solve=SolveOptions(direction="both"))
    result = limit_load(both)
    # Tilting about either edge: 0.5 g, less 3 m/s2 on one side.
    assert result.load_factor == pytest.approx(0.5 * 9.81 + 3.0, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(3.0 - 0.5 * 9.81, rel=1e-6)


def test_no_push_is_refused():
    with pytest.raises(InputError, match="live load is zero"):
        limit_load(block_scene(loads={"dead": {"body": [0, 0, -9.81]}, "live": {}}))


def test_time_that_is_over():
    blocks = builders.wall(length=2.0, height=1.0, thickness=0.2)
    result = limit_load(scene_of(blocks, push=(0.0, 1.0, 0.0), time=1e-6))
    assert result.status == "not_converged"
    assert result.stopped == "stopped after 1e-06 s (solve.time)"
    assert "stopped after" in result.summary()


def test_residuals_are_those_of_the_problem(path):
    """Forces that are changed miss equilibrium and friction by as much."""
    scene = Scene.from_file(path)
    result = limit_load(scene)
    found = result.collapse
    assert max(found.residuals.values()) < 1e-6
    structure = scene.structure()
    weight = 2.0 * 2000.0 * 9.81
    force = found.force.copy()
    force[0, 1] += 0.01 * weight
    residuals = residuals_of(structure, replace(found, force=force))
    assert residuals["equilibrium"] == pytest.approx(0.01, rel=1e-3)
    assert residuals["friction"] > 1e-3 or residuals["friction"] == 0.0
    force = found.force.copy()
    force[np.argmax(force[:, 0]), 0] -= 2.0 * force[:, 0].max()
    assert residuals_of(structure, replace(found, force=force))["pressure"] > 1e-3


@pytest.mark.slow
def test_lower_states(path):
    """A low wall in its plane has collapse states at several load factors."""
    blocks = builders.wall(length=1.0, height=0.8, thickness=0.2, brick=(0.4, 0.2))
    first = limit_load(scene_of(blocks, 0.5, quick=True, fast=True))
    lowest = limit_load(scene_of(blocks, 0.5, quick=True, states="lowest"))
    assert lowest.status == "limit"
    assert lowest.load_factor <= first.load_factor * (1.0 + 1e-6)
    assert lowest.collapse.lowest.load_factor == pytest.approx(lowest.load_factor)


SCENES = {
    "wall": lambda: builders.wall(length=1.2, height=0.8, thickness=0.2, brick=(0.4, 0.2)),
    "corner": lambda: builders.corner(
        length_x=1.2, length_y=1.2, height=0.6, thickness=0.2, brick=(0.4, 0.2)
    ),
    "dome": lambda: builders.dome(radius=2.0, thickness=0.3, meridians=8, rings=3),
    "vault": lambda: builders.barrel_vault(
        span=3.0, rise=1.2, thickness=0.4, length=1.0, voussoirs=7
    ),
    "cross vault": lambda: builders.cross_vault(
        span=3.0, thickness=0.4, length=4.0, voussoirs=6, pieces=1
    ),
}


@pytest.mark.parametrize(
    ("name", "quick"),
    each_once(["wall", "corner", "vault"], [True, False])
    + slow_rows(*product(["cross vault", "dome"], [True, False])),
)
def test_gap_by_a_second_solver(name, quick):
    """With the friction of the state, and associated with it, another solver finds the limit."""
    scene = scene_of(SCENES[name](), 0.7, (0.8, 0.6, 0.0), quick=quick, gap=1e-3)
    result = limit_load(scene)
    found = result.collapse
    assert found.status == "limit"
    assert found.gap <= 1e-3
    model = scene.structure().face_model()
    own = model.own_strength(found.force)
    assert own == pytest.approx(model.friction * found.force[:, 0], abs=1e-6 * model.force)
    least = second_solver.limit(model, own, model.dilatancy)
    allowed = found.load_factor * found.gap + 1e-5 * abs(found.load_factor)
    assert -1e-5 * least <= least - found.load_factor <= allowed
    most = second_solver.limit(model, model.strength, model.friction)
    assert found.upper == pytest.approx(most, rel=1e-4)


def test_the_other_direction_beside(path):
    scene = Scene.from_file(path, overrides=["solve.direction='both'"])
    alone = limit_load(scene)
    with Processes(1) as beside:
        shared = limit_load(scene, beside=beside)
    assert shared.load_factor == alone.load_factor
    assert shared.load_factor_negative == alone.load_factor_negative


def test_command_line(path, capsys):
    assert main(["solve", "-v", str(path), "--set", "solve.direction='both'"]) == 0
    out = capsys.readouterr().out
    assert "it collapses at 0.5000 g along +x" in out
    assert re.search("\nmechanism along \\+x: .*\nmechanism along -x: ", out)
    record = json.loads((path.with_suffix("") / "result.json").read_text())
    assert record["status"] == "limit"
    assert record["dimension"] == 3
    assert record["load_factor_negative"] == pytest.approx(-0.5, rel=1e-6)
    assert record["mesh"] == {
        "bodies": 2,
        "floating_bodies": 1,
        "contacts": 1,
        "joint_points": 16,
        "ties": 0,
    }
    assert set(record["directions"]) == {"positive", "negative"}
    assert record["residuals"]["equilibrium"] < 1e-7
    assert main(["stands", str(path)]) == 0
    assert "it stands under its dead load" in capsys.readouterr().out
    assert main(["stands", str(path), "--load-factor", "0.6"]) == 3
    assert "block stone falls" in capsys.readouterr().out


def test_standing_under_a_part_of_the_live_load(path):
    scene = Scene.from_file(path)
    assert standing(scene, 0.4).status == "equilibrium"
    assert standing(scene, 0.6).status == "unstable"


def test_sweep_over_friction(path, tmp_path):
    found = sweep(path, {"joints.default.friction": [0.3, 0.9]}, tmp_path / "sweep")
    assert found.column("load_factor") == pytest.approx([0.3, 0.5], rel=1e-6)
    assert (tmp_path / "sweep" / "sweep.csv").is_file()
