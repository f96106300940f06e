"""Blocks that strain in the search, and where the ground moves: `blocks.elastic`."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fenics_contact.cli import main
from fenics_contact.elastic.strains import with_strains
from fenics_contact.errors import InputError
from fenics_contact.scene.scene import JointLaw, Movement, SolveOptions
from fenics_contact.spatial import Load, Material, Scene, builders, limit_load, standing
from fenics_contact.spatial.limit import collapse_of
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.workers import Processes
from tests.spatial.test_loading_path import extruded

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
HIGHER = [[0.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]
STONE = Material(young=1e9, poisson=0.2, density=2000.0)


def scene_of(blocks: Any, friction: float, live: Any, **options: Any) -> Scene:
    laws = {"default": JointLaw(friction=friction)}
    loads = {"dead": Load(body=(0.0, 0.0, -10.0)), "live": Load(direction=live)}
    parts = {"materials": {"default": STONE}, "joints": laws, **loads}
    return Scene(blocks=tuple(blocks), **(parts | options))


def corner(**options: Any) -> Scene:
    size = {"length_x": 1.5, "length_y": 1.5, "height": 1.0, "thickness": 0.5, "brick": (1.0, 0.5)}
    return scene_of(builders.corner(**size), 0.6, (0.0, 1.0, 0.0), **options)


def arch(**options: Any) -> Scene:
    size = {"span": 2.0, "rise": 1.0, "thickness": 0.3, "length": 0.3, "voussoirs": 7, "strips": 1}
    return scene_of(builders.barrel_vault(**size), 0.6, (1.0, 0.0, 0.0), **options)


def stiffer(scene: Scene, factor: float) -> Any:
    """The structure with blocks that strain, their Young's modulus over that of springs larger."""
    structure = with_strains(scene, scene.structure())
    return replace(structure, young=structure.young / factor)


def beam(sinks: float, **options: Any) -> Scene:
    """A slender block on three narrow supports, the middle one of which sinks, m."""
    span, height, width = 4.0, 0.4, 0.05
    blocks = [Block((Polyhedron.box((0.0, 0.0, 0.0), (span, height, height)),), "beam")]
    for name, x in (("left", 0.0), ("middle", 0.5 * (span - width)), ("right", span - width)):
        low, high = (x, -0.1, -0.5), (x + width, height + 0.1, 0.0)
        blocks.append(Block((Polyhedron.box(low, high),), name, fixed=True))
    moved = {"middle": Movement(displacement=(0.0, 0.0, -sinks))}
    dead = Load(body=(0.0, 0.0, -10.0), movement=moved if sinks else {})
    return scene_of(blocks, 0.01, (1.0, 0.0, 0.0), dead=dead, mesh_size=0.2, **options)


def carried(scene: Scene) -> tuple[float, float]:
    """Force on the middle support, N, and the span between those on the others, m."""
    end = standing(scene).positive
    assert end is not None and end.status == "equilibrium"
    x, normal = scene.structure().points.position[:, 0], np.asarray(end.force)[:, 0]
    left, right = (np.average(x[one], weights=normal[one]) for one in (x < 1.0, x > 3.0))
    return float(normal[np.abs(x - 2.0) < 0.1].sum()), float(right - left)


def test_support_that_sinks_sheds_load_by_the_stiffness_of_the_beam():
    """By d / (L^3 / (48 E I) + 1.2 L / (4 G A)) of S.P. Timoshenko."""
    settled, height = 1e-3, 0.4
    before, _ = carried(beam(0.0, elastic=True))
    after, span = carried(beam(settled, elastic=True))
    inertia, shear = height**4 / 12.0, STONE.young / 2.4
    flexible = span**3 / (48.0 * STONE.young * inertia) + 1.2 * span / (4.0 * shear * height**2)
    whole = 2e4 * 4.0 * height**2
    assert before == pytest.approx(0.625 * whole, rel=0.05)
    assert before - after == pytest.approx(settled / flexible, rel=0.03)
    assert carried(beam(settled))[0] == pytest.approx(0.0, abs=1e-6 * whole)  # rigid


@pytest.mark.parametrize(("make", "close"), [(arch, 1e-6), (corner, 1e-3)])
def test_stiff_blocks_collapse_as_rigid_ones(make, close):
    scene = make()
    rigid, stiff = collapse_of(scene.structure()), collapse_of(stiffer(scene, 1e4))
    assert (stiff.status, stiff.way) == ("limit", "follow")
    assert stiff.load_factor == pytest.approx(rigid.load_factor, rel=close)


@pytest.mark.slow
def test_walls_by_strains_of_their_blocks():
    """The planar wall 4 extruded: rigid 0.26374; by finite elements of degree 1 0.27."""
    scene = replace(extruded("w4", fast=True), elastic=True)
    end = limit_load(scene).ends["positive"]
    assert (end.status, end.way) == ("limit", "follow")
    assert end.load_factor == pytest.approx(0.2702, rel=5e-3)
    assert end.gap < 1e-5


def test_load_factor_does_not_change_with_units_of_stiffness():
    scenes = [
        corner(elastic=True, materials={"default": replace(STONE, young=young)})
        for young in (1e6, 1e11)
    ]
    soft = limit_load(scenes[0])
    stiff = limit_load(replace(scenes[1], solve=SolveOptions(fast=True)))
    assert soft.load_factor == pytest.approx(stiff.load_factor, rel=1e-6)
    told = soft.ends["positive"].rigid_blocks
    assert told.load_factor == pytest.approx(0.60756, rel=1e-4)
    assert soft.load_factor == pytest.approx(0.60571, rel=1e-3)


@pytest.mark.slow
def test_workers_find_the_same():
    scene = corner(elastic=True)
    scene = replace(scene, solve=replace(scene.solve, direction="both", fast=True))
    alone = limit_load(scene)
    with Processes(1) as beside:
        shared = limit_load(scene, beside=beside)
    for name, end in alone.ends.items():
        assert shared.ends[name].load_factor == pytest.approx(end.load_factor, rel=1e-9)


TABLE = """
dimension = 3
[blocks]
elastic = true
[blocks.stone]
box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
[blocks.sheet]
box = [[0.0, 0.0, 1.0], [1.0, 1.0, 1.001]]
[materials.default]
density = 2000.0
[joints.default]
friction = 0.3
[loads.dead]
body = [0.0, 0.0, -9.81]
[loads.live]
direction = [1.0, 0.0, 0.0]
"""


def test_what_stiffness_does_is_told_and_a_sliver_stays_rigid(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(TABLE)
    assert main(["solve", str(tmp_path / "scene.toml"), "--output", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "rigid blocks: 0.3000 g; the blocks' own stiffness changes it by" in told
    assert "blocks.elastic: block sheet stays rigid: edges of" in told
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["rigid_blocks"]["positive"]["load_factor"] == pytest.approx(0.3, rel=1e-6)


def test_planar_blocks_have_meshes_to_strain():
    text = TABLE.replace("dimension = 3", "dimension = 2")
    text = text.replace("box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]", f"polygon = {SQUARE}")
    text = text.replace("box = [[0.0, 0.0, 1.0], [1.0, 1.0, 1.001]]", f"polygon = {HIGHER}")
    text = text.replace("[0.0, 0.0, -9.81]", "[0.0, -9.81]").replace(
        "[1.0, 0.0, 0.0]", "[1.0, 0.0]"
    )
    with pytest.raises(InputError, match=r"blocks.elastic: is of scenes in space"):
        Scene.from_tables(tomllib.loads(text), Path())


def test_stands_tells_stresses_of_a_lintel_whose_middle_support_sinks(tmp_path, capsys):
    """An elastic one stays on it; a rigid one spans over it, and is pulled more."""
    tables = {"lintel": "[[0.0, 0.0, 0.0], [2.0, 0.3, 0.3]]"}
    for name, x in (("left", 0.0), ("middle", 0.9), ("right", 1.8)):
        tables[name] = f"[[{x}, -0.1, -0.5], [{x + 0.2}, 0.4, 0.0]]\nfixed = true"
    parts = [f"[blocks.{name}]\nbox = {box}\n" for name, box in tables.items()]
    head, _, tail = TABLE.partition("[blocks.stone]")
    tail = tail[tail.index("[materials") :].replace("2000.0", "2000.0\nyoung = 1e9")
    moved = "[loads.dead.movement.middle]\ndisplacement = [0.0, 0.0, -5e-4]\n"
    output = "[output]\nstress = true\nreport = true\n"
    (tmp_path / "lintel.toml").write_text("".join([head, *parts, tail, moved, output]))
    largest = {}
    for elastic in ("true", "false"):
        folder = tmp_path / elastic
        change = ["--set", f"blocks.elastic={elastic}", "--output", str(folder)]
        assert main(["stands", str(tmp_path / "lintel.toml"), *change]) == 0
        assert "stresses: pressure up to" in capsys.readouterr().out
        assert (folder / "stresses.vtu").exists() and (folder / "stresses.png").exists()
        record = json.loads((folder / "result.json").read_text())
        (lintel,) = record["stress"]["blocks"]
        largest[elastic] = lintel["tension"][0]
    assert largest["false"] == pytest.approx(1.58e5, rel=0.05)
    assert 0.3 * largest["false"] < largest["true"] < 0.7 * largest["false"]
