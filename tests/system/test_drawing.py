"""From a drawing to a load factor: gmsh models as users draw them, and DXF files."""

from __future__ import annotations

import random
import re
import sys
import tomllib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks import fuzz
from fenics_contact.geometry.gmsh_mesh import gmsh_session
from tests.drawing import rectangle
from tests.quick import slow
from tests.system.program import changed, files, result, run, run_here, toml

ezdxf = pytest.importorskip("ezdxf")


def write_fragments(path: Path, *boxes: tuple[float, float, float, float]) -> None:
    """Draw rectangles (x, y, length, height) as gmsh surfaces that share curves; "base", "bed"."""
    with gmsh_session(MeshSizeMax=0.25) as gmsh:
        gmsh.model.add("fragments")
        occ = gmsh.model.occ
        occ.fragment([(2, occ.addRectangle(x, y, 0, a, b)) for x, y, a, b in boxes], [])
        occ.synchronize()
        surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, surfaces), "blocks")
        for name, level in (("base", 0.0), ("bed", 0.5)):
            strip = (-1.0, level - 0.01, -1.0, 10.0, level + 0.01, 1.0)
            curves = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*strip, dim=1)]
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, curves), name)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
        gmsh.model.remove()


#: Two blocks of 1 m x 0.5 m under a long one; the bed joint between them is the weakest.
TABLE = ((0, 0, 1, 0.5), (1, 0, 1, 0.5), (0, 0.5, 2, 0.5))
WEAK_BED = {"joints.bed": {"friction": 0.2}, "foundations.base.friction": 0.6}


@pytest.mark.parametrize(
    ("blocks", "code", "load_factor"), [("surfaces", 0, 0.2), ("connected", 2, None)]
)
def test_fragments_slide_on_the_joint_between_them(blocks, code, load_factor, folder, capsys):
    write_fragments(folder / "block.msh", *TABLE)
    scene = {**WEAK_BED, "mesh.blocks": blocks}
    (folder / "scene.toml").write_text(toml(changed(scene)))
    found = run_here(["solve", folder / "scene.toml", "-o", folder / "out"], capsys)
    assert found.code == code, found.err
    if load_factor:
        assert result(folder / "out")["load_factor"] == pytest.approx(load_factor, rel=1e-6)
    else:
        assert "group 'bed'" in found.err and 'mesh.blocks = "surfaces"' in found.err


# ---- DXF

SQUARE = rectangle(0, 0, 1000, 1000)
#: The blocks of `TABLE` in mm, with their bed joint and the ground as lines.
TABLE_MM = [(1000.0 * np.array(rectangle(x, y, x + a, y + b)), "stone") for x, y, a, b in TABLE]


def write_dxf(path: Path, blocks, lines=(), unit: int = 4, **options) -> Path:
    """Write closed polylines (corners, layer) and lines (start, end, layer)."""
    document = ezdxf.new()
    document.units = unit
    space = document.modelspace()
    for corners, layer in blocks:
        space.add_lwpolyline(corners, dxfattribs={"layer": layer}, **{"close": True, **options})
    for start, end, layer in lines:
        space.add_line(start, end, dxfattribs={"layer": layer})
    document.saveas(path)
    return path


def test_from_a_dxf_drawing_to_a_load_factor(folder, capsys):
    lines = [((0, 0), (2000, 0), "base"), ((0, 500), (2000, 500), "bed"), ((0, 9), (5, 9), "axis")]
    write_dxf(folder / "table.dxf", TABLE_MM, lines)
    found = run_here(["mesh", "table.dxf", "-o", "block.msh", "--size", "0.25"], capsys)
    assert (found.code, found.err) == (0, "")
    for text in ("3 blocks, 2 m x 1 m", "stone 3", "base 2 m, bed 4 m", "layer 'axis'", "next: "):
        assert text in found.out
    assert files(folder) == {"table.dxf", "block.msh"}
    (folder / "scene.toml").write_text(toml(changed(WEAK_BED)))
    found = run_here(["solve", "scene.toml", "-o", "out"], capsys)
    assert found.code == 0, found.err
    assert result(folder / "out")["load_factor"] == pytest.approx(0.2, rel=1e-6)


@pytest.mark.parametrize(
    ("unit", "arguments", "width"),
    [(4, [], "1 m"), (6, [], "1000 m"), (1, [], "25.4 m"), (0, ["--unit", "cm"], "10 m")],
)
def test_unit_of_the_drawing(unit, arguments, width, folder, capsys):
    write_dxf(folder / "block.dxf", [(SQUARE, "stone")], unit=unit)
    found = run_here(["mesh", "block.dxf", *arguments], capsys)
    assert (found.code, found.err) == (0, "")
    assert f"1 blocks, {width} x {width}" in found.out
    assert 'the group "base" is the lowest level' in found.out
    assert files(folder) == {"block.dxf", "block.msh"}


BOW_TIE = [(0, 0), (1000, 1000), (1000, 0), (0, 1500)]
BAD_DRAWINGS = {
    "no blocks": ([], [((0, 0), (1, 0), "base")], ("lines on layers base enclose no face",)),
    "crossing": ([(BOW_TIE, "stone")], [], ("layer 'stone'", "crosses itself at (600, 600)")),
    "no area": ([([(0, 0), (1, 1), (2, 2)], "flat")], [], ("layer 'flat'", "no area")),
    "inside": ([(SQUARE, "a"), (rectangle(300, 300, 600, 600), "b")], [], ("blocks overlap at",)),
    "overlap": ([(SQUARE, "a"), (rectangle(900, 0, 2000, 1000), "a")], [], ("blocks overlap at",)),
}


@pytest.mark.parametrize("name", BAD_DRAWINGS)
def test_bad_drawing(name, folder, capsys):
    blocks, lines, names = BAD_DRAWINGS[name]
    write_dxf(folder / "bad.dxf", blocks, lines)
    refused(["mesh", "bad.dxf", "-o", "wall.msh"], ("bad.dxf", *names), folder, capsys)


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["nowhere.dxf"], ("nowhere.dxf", "does not exist")),
        (["text.dxf"], ("text.dxf", "save the drawing as DXF")),
        (["short.dxf"], ("short.dxf", "save the drawing as DXF")),
        (["unitless.dxf"], ("unitless.dxf", "--unit mm")),
        (["good.dxf", "--size", "0"], ("size = 0",)),
        (["good.dxf", "--size", "nan"], ("size = nan",)),
        (["good.dxf", "--size", "1e-6"], ("cells", "--size")),
        (["good.dxf", "--size", "1e3"], ("larger than the drawing", "--size in m")),
        (["good.dxf", "-o", "wall.vtk"], ("wall.vtk", ".msh")),
        (["good.dxf", "-o", "nowhere/wall.msh"], ("nowhere/wall.msh", "No such file")),
        (["good.dxf", "-o", "folder.msh"], ("folder.msh", "folder")),
    ],
)
def test_bad_arguments(arguments, names, folder, capsys):
    good = write_dxf(folder / "good.dxf", [(SQUARE, "stone")])
    write_dxf(folder / "unitless.dxf", [(SQUARE, "stone")], unit=0)
    (folder / "text.dxf").write_text("closed polyline")
    (folder / "short.dxf").write_bytes(good.read_bytes()[:3000])
    (folder / "folder.msh").mkdir()
    refused(["mesh", *arguments], names, folder, capsys)


def refused(arguments, names, folder, capsys) -> None:
    """Exit code 2, one message that says what is wrong, nothing written."""
    before = files(folder)
    found = run_here(arguments, capsys)
    assert (found.code, found.out) == (2, ""), found.err
    assert found.err.count("\n") == 1
    for name in names:
        assert name in found.err
    assert files(folder) == before


def test_missing_ezdxf_is_said(folder, capsys, monkeypatch):
    write_dxf(folder / "good.dxf", [(SQUARE, "stone")])
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    refused(["mesh", "good.dxf"], ("python3-ezdxf", "pip install ezdxf"), folder, capsys)


def test_gaps_between_blocks_are_warned_of(folder, capsys):
    write_dxf(folder / "gap.dxf", [(SQUARE, "a"), (rectangle(1000.2, 0, 2000, 1000), "a")])
    found = run_here(["mesh", "gap.dxf"], capsys)
    assert found.code == 0
    assert "warning: 4 corners lie beside another block" in found.out and "0.0002 m" in found.out


@pytest.mark.parametrize("ranks", [1, *slow(2)])
def test_mesh_command_as_a_user_runs_it(ranks, tmp_path):
    write_dxf(tmp_path / "block.dxf", [(SQUARE, "stone")])
    found = run(["mesh", "block.dxf", "--scene", "wall.toml", "-q"], tmp_path, ranks)
    assert (found.code, found.out) == (0, ""), found.err
    assert files(tmp_path) == {"block.dxf", "block.msh", "wall.toml"}
    found = run(["mesh", "nowhere.dxf"], tmp_path, ranks)
    assert found.code == 2
    assert found.err.count("fenics-contact: ") == 1


# ---- doubts and pictures


def wall_mm(mortar: float = 0.0) -> list[tuple[object, str]]:
    """A stone of 2 m x 1 m on two of 1 m x 1 m, in mm."""
    boxes = [(0, 0, 1000, 1000), (1000 + mortar, 0, 2000 + mortar, 1000)]
    boxes.append((0, 1000 + mortar, 2000 + mortar, 2000 + mortar))
    return [(rectangle(*box), "stone") for box in boxes]


def test_mortar_joints_are_closed_with_what_the_command_says(folder, capsys):
    write_dxf(folder / "block.dxf", wall_mm(10.0))
    found = run_here(["mesh", "block.dxf", "--size", "0.5"], capsys)
    assert "10 mm away" in found.out and "mortar joints?" in found.out
    suggested = re.search(r"--set (joints\.default\.gap=\S+)", found.out)[1].rstrip(";")
    assert suggested == "joints.default.gap=0.011"
    (folder / "scene.toml").write_text(toml(changed({"foundations.base.friction": 0.6})))
    assert run_here(["check", "scene.toml"], capsys).code == 2  # the upper stone hangs in the air
    found = run_here(["solve", "scene.toml", "--fast", "--set", suggested, "-o", "out"], capsys)
    assert found.code == 0, found.err


def bricks_mm(courses: int, joint: float = 10.0) -> list[tuple[object, str]]:
    """Bricks of 250 mm x 65 mm, one on the other."""
    boxes = ((0, k * (65 + joint), 250, k * (65 + joint) + 65) for k in range(courses))
    return [(rectangle(*box), "brick") for box in boxes]


def test_mortar_has_a_height_with_close(folder, capsys):
    write_dxf(folder / "a.dxf", bricks_mm(10))
    found = run_here(["mesh", "a.dxf", "--scene", "open.toml"], capsys)
    assert "joints of 10 mm are open: if that is mortar, give --close" in found.out
    text = (folder / "open.toml").read_text()
    assert "gap = 0.011" in text and "# If they are mortar, 10 mm, mesh with --close" in text
    found = run_here(["check", "open.toml"], capsys)
    assert "warning: 9 blocks hang in the air and fall by up to 0.09 m" in found.out
    found = run_here(["mesh", "a.dxf", "--close", "--scene", "closed.toml"], capsys)
    assert "joints of 10 mm closed" in found.out and "warning" not in found.out
    assert "gap" not in (folder / "closed.toml").read_text()
    line = ["solve", "closed.toml", "--fast", "--set", "joints.default.friction=0.8"]
    found = run_here([*line, "--set", "foundations.base.friction=0.8", "-o", "out"], capsys)
    assert found.code == 0, found.err
    assert result(folder / "out")["load_factor"] == pytest.approx(0.25 / 0.74, rel=1e-3)
    assert result(folder / "out")["warnings"] == []


def test_all_blocks_that_hang_are_counted(folder, capsys):
    write_dxf(folder / "block.dxf", bricks_mm(6, 20.0))
    assert run_here(["mesh", "block.dxf"], capsys).code == 0
    (folder / "scene.toml").write_text(toml(changed({"foundations.base.friction": 0.6})))
    found = run_here(["check", "scene.toml"], capsys)
    assert found.code == 2
    assert "5 blocks in 5 places, the first around (0.125" in found.err
    assert "mesh --close" in found.err


def test_overlap_names_layers_and_the_place_as_drawn(folder, capsys):
    window = (rectangle(800, 300, 1200, 700), "A-1")
    write_dxf(folder / "block.dxf", [*wall_mm(), window], unit=5)
    line = ["mesh", "block.dxf", "--picture", "seen.png"]
    found = run_here(line, capsys)
    assert found.code == 2
    assert ") cm, on layers 'stone' and 'A-1' (2 overlaps: 2 on A-1 and stone);" in found.err
    assert files(folder) == {"block.dxf", "seen.png"}  # the picture shows where
    found = run_here([*line, "--voids", "a-1"], capsys)
    assert found.code == 0
    assert "(1100, 500) cm an opening lies over a block, which is not cut" in found.out


def test_picture_shows_what_was_read(folder, capsys):
    lines = [((0, y), (3000, y), "JOINTS") for y in (0, 1000, 2000)]
    lines += [((x, 0), (x, 2000), "JOINTS") for x in (0, 1000, 3000)]
    lines += [((2000, 0), (2000, 500), "JOINTS"), ((0, 0), (3000, 0), "base")]
    write_dxf(folder / "block.dxf", [], lines)
    found = run_here(["mesh", "block.dxf", "--picture", "seen.svg"], capsys)
    assert (found.code, found.err) == (0, "")
    assert "picture of what was read: seen.svg" in found.out
    shown = (folder / "seen.svg").read_text()
    for text in (
        "4 blocks, 3 m x 2 m",
        "blocks: 4 blocks",
        "sides of base: 3 m",
        "extend it (1 places)",
    ):
        assert f"<!-- {text}" in shown or f"{text} -->" in shown
    assert "(2000, 500) mm" in found.out  # words are below the picture, not across it
    (folder / "folder.png").mkdir()
    for name, reason in (("folder.png", "Is a directory"), ("a.xyz", "not supported")):
        found = run_here(["mesh", "block.dxf", "--picture", name, "-o", "new.msh"], capsys)
        assert (found.code, found.err.count("\n")) == (2, 1)
        assert f"cannot write the picture to '{name}'" in found.err and reason in found.err
        assert not (folder / "new.msh").exists()


def test_damaged_files_are_told_in_one_line(folder, capsys):
    """Cases of benchmarks/fuzz.py, of which these found something wrong at first."""
    drawings = fuzz.sound_drawings()
    for seed in (12, 142, 152, 1188, *range(8)):
        dice = random.Random(seed)
        (folder / "a.dxf").write_bytes(fuzz.damaged_drawing(dice, dice.choice(drawings)))
        (folder / "a.msh").unlink(missing_ok=True)
        found = run_here(["mesh", "a.dxf", "--unit", "mm"], capsys)
        assert found.code in (0, 2)
        assert found.err.count("\n") == (found.code == 2), found.err
        assert (folder / "a.msh").exists() == (found.code == 0)


# ---- a scene to begin with


def test_from_a_drawing_to_a_solved_scene_in_two_commands(folder, capsys):
    """Flat stones, which slide on the ground at its friction."""
    lines = [((0, 500), (2000, 500), "Lager ä"), ((0, 1000), (2000, 1000), "top")]
    write_dxf(folder / "table.dxf", TABLE_MM, [*lines, ((0, 0), (2000, 0), "Ground floor")])
    (folder / "scenes").mkdir()
    found = run_here(["mesh", "table.dxf", "--scene", "scenes/wall.toml"], capsys)
    assert (found.code, found.err) == (0, "")
    said = found.out.splitlines()[-3:]
    assert said[0] == "the ground is 'Ground floor': guessed, the lowest level"
    assert said[1].startswith(
        "scene written to scenes/wall.toml: materials, frictions and the live"
    )
    assert said[2].startswith("next: fenics-contact check scenes/wall.toml, then: ")
    text = (folder / "scenes" / "wall.toml").read_text(encoding="utf-8")
    tables = tomllib.loads(text)
    assert tables["mesh"]["file"] == "../table.msh"
    assert list(tables["materials"]) == ["stone"]
    assert list(tables["joints"]) == ["default", "Lager ä"]
    assert list(tables["foundations"]) == ["Ground floor"]
    assert "# traction.top = " in text and "2 m of sides" in text
    found = run_here(["solve", "scenes/wall.toml", "-o", "out"], capsys)
    assert found.code == 0, found.err
    assert result(folder / "out")["load_factor"] == pytest.approx(0.6, rel=1e-6)


def test_scene_closes_the_mortar_joints_of_its_drawing(folder, capsys):
    write_dxf(folder / "block.dxf", wall_mm(10.0))
    line = ["mesh", "block.dxf", "--size", "0.5", "--scene", "wall.toml"]
    found = run_here(line, capsys)
    assert (found.code, found.err) == (0, "")
    assert "the ground is 'base': guessed, the lowest level" in found.out
    assert tomllib.loads((folder / "wall.toml").read_text())["joints"]["default"]["gap"] == 0.011
    assert run_here(["check", "wall.toml"], capsys).code == 0


def test_scene_without_a_drawn_ground_stands_on_the_lowest_level(folder, capsys):
    write_dxf(folder / "table.dxf", TABLE_MM, [((0, 500), (2000, 500), "bed")])
    found = run_here(["mesh", "table.dxf", "--scene", "wall.toml"], capsys)
    assert (found.code, found.err) == (0, "")
    assert "sides by layer: bed 4 m, base 2 m" in found.out
    assert run_here(["check", "wall.toml"], capsys).code == 0


def test_layers_that_share_sides_are_the_ground_once(folder, capsys):
    """Lines between blocks, whose layers of the ground and of all else have the same sides."""
    lines = [((0, y), (2000, y), "joints") for y in (0, 500, 1000)]
    lines += [((x, 0), (x, 1000), "joints") for x in (0, 1000, 2000)]
    write_dxf(folder / "block.dxf", [], [*lines, ((0, 0), (2000, 0), "ground")])
    found = run_here(["mesh", "block.dxf", "--scene", "wall.toml"], capsys)
    assert (found.code, found.err) == (0, "")
    scene = tomllib.loads((folder / "wall.toml").read_text())
    assert (list(scene["joints"]), len(scene["foundations"])) == (["default"], 1)
    assert run_here(["check", "wall.toml"], capsys).code == 0


@pytest.mark.parametrize(
    ("scene", "names"),
    [
        ("wall.toml", ("wall.toml", "is there already")),
        ("wall.txt", ("wall.txt", ".toml")),
        ("nowhere/wall.toml", ("nowhere/wall.toml", "folder does not exist")),
    ],
)
def test_scene_that_cannot_be_written(scene, names, folder, capsys):
    write_dxf(folder / "block.dxf", [(SQUARE, "stone")])
    (folder / "wall.toml").write_text("mine")
    refused(["mesh", "block.dxf", "--scene", scene], names, folder, capsys)
    assert (folder / "wall.toml").read_text() == "mine"


def test_scene_of_a_drawing_without_ground_is_refused(folder, capsys):
    """A block that stands on a corner, with a line on its upper left side."""
    diamond = [(0, 0), (500, 500), (0, 1000), (-500, 500)]
    write_dxf(folder / "block.dxf", [(diamond, "stone")], [((0, 1000), (-500, 500), "wind")])
    names = ("no layer is the ground", "'ground'")
    refused(["mesh", "block.dxf", "--scene", "wall.toml"], names, folder, capsys)


# ---- the same facade, drawn in both ways


def facade_boxes() -> list[tuple[float, float, float, float]]:
    """Rectangles (x, y, length, height) of a facade of two storeys with six windows, m."""
    boxes = []
    for y in (0.0, 3.0):
        boxes += [(x, y, 3.5, 1.0) for x in (0.0, 3.5)]
        boxes += [(2.0 * k, y + 1.0, 1.0, 1.25) for k in range(4)]
        ends = [0.0, 0.75, 2.25, 2.75, 4.25, 4.75, 6.25, 7.0]  # lintels and what is between them
        boxes += [(a, y + 2.25, b - a, 0.25) for a, b in pairwise(ends)]
        boxes += [(x, y + 2.5, 3.5, 0.5) for x in (0.0, 3.5)]
    return boxes


@pytest.mark.slow
def test_facade_with_six_windows_by_gmsh_and_by_dxf(folder, capsys):
    write_fragments(folder / "block.msh", *facade_boxes())
    blocks = [(1e3 * np.array(rectangle(x, y, x + a, y + b)), "a") for x, y, a, b in facade_boxes()]
    write_dxf(folder / "facade.dxf", blocks, [((0, 0), (7000, 0), "base")])
    assert run_here(["mesh", "facade.dxf", "-o", "facade.msh", "--size", "0.25"], capsys).code == 0
    rough = {"joints.default.friction": 0.9, "foundations.base.friction": 0.9}
    by_gmsh = {**rough, "mesh.blocks": "surfaces"}
    results = []
    for name, changes in (("gmsh", by_gmsh), ("dxf", {**rough, "mesh.file": "facade.msh"})):
        (folder / f"{name}.toml").write_text(toml(changed(changes)))
        found = run_here(["solve", f"{name}.toml", "-o", name, "-v"], capsys)
        assert found.code == 0, found.err
        assert "30 blocks" in found.out
        results.append(result(folder / name))
    one, other = results
    assert one["bounds"] == pytest.approx(other["bounds"], rel=1e-9)
    assert one["load_factor"] == pytest.approx(other["load_factor"], rel=1e-3)  # other triangles
    limits = [found["hinges"]["points"]["load_factor"] for found in results]
    assert limits[0] == pytest.approx(limits[1], rel=1e-5)
