"""Blocks in the plane without a mesh: hand values, the same states as with one, files, words."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.scenes import outlines
from fenics_contact import InputError, JointLaw, limit_load
from fenics_contact import spatial as rigid
from fenics_contact.geometry import builders
from fenics_contact.geometry.meshing import model_from_arrays
from fenics_contact.output.report.page import write_report
from fenics_contact.scene.scene import OutputOptions
from fenics_contact.scene.toml_tables import is_of_blocks
from fenics_contact.spatial import prism
from fenics_contact.spatial.block_tables import prisms
from fenics_contact.spatial.check import description
from fenics_contact.sweeps.sweep import sweep
from tests.bank import WALLS, coulomb, wall_recipe
from tests.quick import quick
from tests.system.program import environment, toml
from tests.system.test_drawing import write_dxf

BLOCK = {
    "blocks": {"stone": {"polygon": [[0, 0], [1, 0], [1, 2], [0, 2]]}},
    "materials": {"default": {"density": 2000.0}},
    "joints": {"default": {"friction": 0.3}},
    "loads": {"dead": {"body": [0.0, -9.81]}, "live": {"body": [9.81, 0.0]}},
    "output": {"paraview": False, "pictures": False},
}


def scene_of(tmp_path, **changes):
    """The scene of one block with some tables in place of its own."""
    return rigid.Scene.from_tables(BLOCK | changes, tmp_path)


def factor_of(tmp_path, **changes):
    return rigid.limit_load(scene_of(tmp_path, **changes)).load_factor


def wall_of(name, mirrored=False, direction="positive"):
    """A wall of polygons under the weight acting sideways."""
    shapes = [
        shape * [-1.0 if mirrored else 1.0, 1.0] for shape in outlines(WALLS[name], (0.4, 0.175))
    ]
    return rigid.Scene(
        blocks=prisms(shapes, ["wall"] * len(shapes)),
        dimension=2,
        materials={"default": rigid.Material(density=2000.0)},
        joints={"default": JointLaw(friction=0.65)},
        dead=rigid.Load(body=(0.0, -9.81)),
        live=rigid.Load(body=(9.81, 0.0)),
        solve=rigid.SolveOptions(direction=direction),
    )


@cache
def bare_wall(name):
    return rigid.limit_load(wall_of(name))


def test_a_block_slides_tilts_and_crushes(tmp_path):
    """F; w / h; and (w - N / f_c) / h, J. Heyman, The masonry arch (1982), section 2.4."""
    assert factor_of(tmp_path) == pytest.approx(0.3, rel=1e-6)
    rough = {"default": {"friction": 0.9}}
    assert factor_of(tmp_path, joints=rough) == pytest.approx(0.5, rel=1e-6)
    weak = {"default": {"density": 2000.0, "compressive_strength": 2e5}}
    crushed = 0.5 * (1.0 - 2.0 * 2000.0 * 9.81 / 2e5)
    assert factor_of(tmp_path, joints=rough, materials=weak) == pytest.approx(crushed, rel=1e-6)


def test_cohesion_tension_and_ties(tmp_path):
    """c A / W beside F; f_t A / 2 more about the edge; a tie of 5 kN at the top."""
    weight = 2.0 * 2000.0 * 9.81
    glued = {"default": {"friction": 0.3, "cohesion": 5e3}}
    assert factor_of(tmp_path, joints=glued) == pytest.approx(0.3 + 5e3 / weight, rel=1e-6)
    bonded = {"default": {"friction": 0.9, "cohesion": 2e4, "tensile_strength": 1e4}}
    found = factor_of(tmp_path, joints=bonded)
    assert found == pytest.approx(0.5 + 0.5 * 1e4 / weight, rel=1e-6)
    rough = {"default": {"friction": 0.9}}
    ties = {"top": {"from": [0.5, 2.0], "ground": [-1.0, 2.0], "yield": 5e3}}
    tied = factor_of(tmp_path, joints=rough, ties=ties)
    assert tied == pytest.approx(0.5 + 2.0 * 5e3 / weight, rel=1e-6)


def test_forces_tractions_floors_and_profiles(tmp_path):
    weight = 2.0 * 2000.0 * 9.81
    top = {"force": {"top": {"at": [0.5, 2.0], "force": [1000.0, 0.0]}}}
    rough = {"default": {"friction": 0.9}}
    dead = BLOCK["loads"]["dead"]
    found = factor_of(tmp_path, joints=rough, loads={"dead": dead, "live": top})
    assert found == pytest.approx(weight / 4.0 / 1000.0, rel=1e-6)
    side = {"sides": {"side": {"normal": [-1.0, 0.0]}}}
    live = {"traction": {"side": [100.0, 0.0]}}
    found = factor_of(tmp_path, joints=rough, loads={"dead": dead, "live": live}, **side)
    assert found == pytest.approx(weight / 2.0 / 200.0, rel=1e-6)
    floors = {"roof": {"y": 2.0, "force": weight}}
    found = factor_of(tmp_path, joints=rough, floors=floors)
    assert found == pytest.approx(1.0, rel=1e-6)
    live = {"body": [9.81, 0.0], "profile": "triangular"}
    found = factor_of(tmp_path, joints=rough, loads={"dead": dead, "live": live})
    assert found == pytest.approx(0.5 / (4.0 / 3.0), rel=1e-6)


@pytest.mark.parametrize("name", quick(WALLS, "W3"))
def test_walls_end_as_with_a_mesh(name):
    """The rigid end is the same; the state is that of faces' springs, not of elastic blocks."""
    bare = bare_wall(name)
    meshed = limit_load(wall_recipe(name, coulomb(0.65)).scene(2))
    assert bare.ends["positive"].bounds.upper == pytest.approx(meshed.bounds.upper, rel=1e-5)
    assert bare.load_factor == pytest.approx(meshed.load_factor, rel=5e-3)
    end = bare.ends["positive"]
    assert end.way == "follow"
    assert end.residuals["limit"] < 1e-6
    assert end.residuals["equilibrium"] < 1e-7


def test_mirrored_walls_mirror():
    one = bare_wall("W3").load_factor
    other = rigid.limit_load(
        wall_of("W3", mirrored=True, direction="negative")
    ).load_factor_negative
    assert other == pytest.approx(-one, rel=1e-7)


def test_a_block_may_have_any_outline(tmp_path):
    """An L of two squares and one on it, around a hook: as heavy, and pieces move as one."""
    hook = prism([[0, 0], [2, 0], [2, 1], [1, 1], [1, 0.5], [0, 0.5]], "hook")
    assert hook.volume == pytest.approx(1.5)
    assert hook.centroid == pytest.approx([7.0 / 6.0, 0.0, 5.0 / 12.0])
    blocks = {
        "low": {"polygon": [[0, 0], [2, 0], [2, 1], [1, 1], [1, 0.5], [0, 0.5]]},
        "high": {"polygon": [[0, 0.5], [1, 0.5], [1, 1], [2, 1], [2, 2], [0, 2]]},
    }
    structure = scene_of(tmp_path, blocks=blocks).structure()
    assert len(structure.contacts) == 4  # with the ground
    result = rigid.limit_load(scene_of(tmp_path, blocks=blocks))
    assert result.load_factor == pytest.approx(0.3, rel=1e-6)  # the hook holds the upper one


def test_ground_that_moves_keeps_the_limit(tmp_path):
    moved = {"ground": {"displacement": [0.01, 0.0], "rotation": 0.1}}
    dead = {**BLOCK["loads"]["dead"], "movement": moved}
    loads = {"dead": dead, "live": BLOCK["loads"]["live"]}
    assert factor_of(tmp_path, loads=loads) == pytest.approx(0.3, rel=1e-6)


def test_a_block_in_the_air_falls(tmp_path):
    blocks = {**BLOCK["blocks"], "loose": {"polygon": [[3, 3], [4, 3], [4, 4]]}}
    result = rigid.limit_load(scene_of(tmp_path, blocks=blocks))
    assert result.status == "unstable"
    assert "loose" in result.reason()


def test_places_have_two_numbers(tmp_path):
    """In the plane x-y of what people give, x-z of the blocks; angles are counterclockwise."""
    moved = {"ground": {"displacement": [0.01, 0.0], "rotation": 0.5}}
    force = {"p": {"at": [0.5, 2.0], "force": [3.0, 4.0]}}
    given = {
        "loads": {
            "dead": {"body": [0.0, -9.81], "movement": moved},
            "live": {"force": force},
        },
        "floors": {"roof": {"y": 2.0, "x": [0.0, 1.0], "force": 1.0}},
        "ties": {"t": {"from": [0.0, 1.0], "ground": [-2.0, 1.0], "yield": 1.0}},
    }
    scene = scene_of(tmp_path, **given)
    structure = scene.structure()
    assert structure.live[0, :3] == pytest.approx([3.0, 0.0, 4.0])
    assert structure.bars[0].ends == pytest.approx(np.array([[0, 0, 1], [-2, 0, 1]]))
    expected = [0.01, 0.0, 0.0, 0.0, -np.radians(0.5), 0.0]
    assert structure.moved[-1] == pytest.approx(expected)
    tables = json.loads(json.dumps(scene.tables()))
    assert tables["loads"]["dead"]["movement"] == moved
    assert tables["loads"]["live"]["force"] == force
    assert tables["floors"]["roof"] == given["floors"]["roof"] | {"mass": False}
    assert tables["ties"]["t"] == given["ties"]["t"] | {"prestress": 0.0}
    again = rigid.Scene.from_tables({"blocks": BLOCK["blocks"], **tables}, tmp_path)
    assert again.tables() == scene.tables()


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"loads": {"live": {"body": [9.81, 0.0, 0.0]}}}, "loads.live.body = .* two numbers"),
        ({"loads": {"live": {"direction": [1, 0, 0]}}}, "loads.live.direction = .* two numbers"),
        ({"output": {"stress": True}}, "output.stress is of scenes in space; leave it out"),
        ({"blocks": {"a": {"polygon": [[0, 0], [1, 1], [1, 0], [0, 1]]}}}, "block 'a' has no area"),
        ({"blocks": {"a": {"polygon": [[0, 0], [1, 1]]}}}, "block 'a' needs at least three"),
        ({"blocks": {"builder": "wal"}}, "'wal' must be one of 'facade'"),
        ({"blocks": {"builder": "wall", "length": 1.0}}, "blocks.height is missing"),
        ({"blocks": {"builder": "facade", "bay": 3}}, "blocks.bay"),
        (
            {"floors": {"roof": {"z": 2.0, "force": 1.0}}},
            "floors.roof.z is of scenes in space; give y",
        ),
        ({"floors": {"roof": {"y": 3.5, "force": 1.0}}}, "no block has a top side at y = 3.5"),
        ({"floors": {"roof": {"y": 2.0, "x": [9, 10], "force": 1.0}}}, "within x; .* x = 0 to 1$"),
        ({"foundations": {"ground": {"friction": 1.0, "y": -1.0}}}, "see its y or plane"),
        ({"ties": {"t": {"from": [9, 9], "ground": [0, 0], "yield": 1.0}}}, r"at \(9, 9\)"),
        ({"solve": {"engine": "path"}}, "solve.engine is of scenes with a mesh"),
        ({"plane": {"state": "stress"}}, "plane.state is of scenes with a mesh"),
        ({"blocks": {}}, "blocks is missing"),
        ({"sides": {"top": {"lines": [[[0, 2]]]}}}, "sides.top.lines"),
        ({"sides": {"top": {"lines": [1, 2]}}}, "sides.top.lines"),
        ({"sides": {"top": {"lines": []}}}, "no side is named"),
    ],
)
def test_bad_input_is_named(tmp_path, changes, text):
    with pytest.raises(InputError, match=text):
        scene_of(tmp_path, **changes).structure()


def test_a_scene_has_a_mesh_or_blocks():
    assert is_of_blocks({"blocks": {}})
    assert is_of_blocks({"dimension": 3})
    assert not is_of_blocks({"mesh": {}})
    with pytest.raises(InputError, match=r"either \[mesh\], or \[blocks\]"):
        is_of_blocks({"mesh": {}, "blocks": {}})
    with pytest.raises(InputError, match="dimension = 4 must be 2 or 3"):
        is_of_blocks({"dimension": 4})


@pytest.mark.parametrize(
    ("blocks", "count"),
    [
        ({"builder": "wall", "length": 0.8, "height": 0.4}, 5),
        ({"builder": "facade", "storeys": 1, "bays": 1}, 47),
        ({"builder": "retaining_wall", "height": 2.0, "base": 1.0, "top": 0.6}, 25),
        ({"builder": "arch", "span": 2.0, "rise": 1.0, "thickness": 0.3, "voussoirs": 9}, 9),
    ],
)
def test_builders_draw_in_the_plane(tmp_path, blocks, count):
    structure = scene_of(tmp_path, blocks=blocks).structure()
    assert np.count_nonzero(structure.number >= 0) == count
    assert structure.points.position[:, 1] == pytest.approx(0.0)
    assert structure.face_model().shape == (len(structure.contacts), 3)


def test_a_drawing_is_read_without_a_mesh(tmp_path):
    stones = [([[0, 0], [1000, 0], [1000, 500], [0, 500]], "stone")]
    stones += [([[0, 500], [1000, 500], [1000, 1000], [0, 1000]], "cap")]
    write_dxf(tmp_path / "stack.dxf", stones)
    scene = scene_of(tmp_path, blocks={"file": "stack.dxf", "unit": "mm"})
    assert [block.name for block in scene.blocks] == ["stone_1", "cap_1"]
    assert rigid.limit_load(scene).load_factor == pytest.approx(0.3, rel=1e-6)


def test_layers_that_are_guessed_name_what_works_here(tmp_path):
    stones = [([[0, 0], [1, 0], [1, 1], [0, 1]], "a"), ([[0, 1], [1, 1], [1, 2], [0, 2]], "b")]
    write_dxf(tmp_path / "stack.dxf", stones)
    scene = scene_of(tmp_path, blocks={"file": "stack.dxf", "unit": "m"})
    (note,) = (note for note in scene.notes if "--voids" in note)
    assert note.endswith("here freeze layers that are no stones)")


def test_a_result_has_bounds_and_says_where_other_values_are(tmp_path):
    result = rigid.limit_load(scene_of(tmp_path))
    assert result.bounds == result.positive.bounds and result.residuals["equilibrium"] < 1e-6
    with pytest.raises(AttributeError, match=r"'mode'; result\.positive\.mode is there"):
        _ = result.mode


@pytest.mark.parametrize("thickness", [0.6, None])
def test_volume_and_mass_are_of_the_same_thickness(tmp_path, thickness):
    scene = replace(scene_of(tmp_path), thickness=thickness)
    text = description(scene, scene.structure())
    volume = sum(block.volume for block in scene.blocks) * (thickness or 1.0)
    per = "" if thickness else " per metre of thickness"
    assert f"volume {volume:.6g} m3{per}, mass {volume * 2000:.4g} kg{per}" in text


@pytest.mark.parametrize("way", [[-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]])
def test_a_direction_is_told_as_the_key_of_its_angle(tmp_path, way):
    box = {"stone": {"box": [[0, 0, 0], [1, 1, 1]]}}
    loads = {"dead": {"body": [0.0, 0.0, -9.81]}, "live": {"direction": way}}
    result = rigid.limit_load(scene_of(tmp_path, dimension=3, blocks=box, loads=loads))
    assert f"at {225 if way[1] < 0.0 else 135} degrees from +x towards +y" in result.summary()


def test_a_sweep_tells_where_it_does_not_stand(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(
        """[blocks]
base = { polygon = [[0, 0], [1, 0], [1, 1], [0, 1]], fixed = true }
top = { polygon = [[0, 1], [1, 1], [1, 2], [0, 2]] }
[materials.default]
density = 2000.0
[joints.default]
friction = 0.4
[loads]
dead.body = [3.2, -9.81]
live.body = [9.81, 0.0]
"""
    )
    found = sweep(path, {"joints.default.friction": [0.3, 0.4]})
    assert "at 0.4, does not stand at 0.3" in repr(found)


def test_files_have_components_of_the_plane(tmp_path):
    scene = scene_of(tmp_path, joints={"default": {"friction": 0.9}})
    scene = replace(scene, output=OutputOptions(capacity=4, report=True), thickness=0.5)
    result = rigid.limit_load(scene)
    result.write(tmp_path / "out")
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["dimension"] == 2
    assert record["scene"]["resultants"]["live"] == pytest.approx([39240.0, 0.0])
    assert record["scene"]["loads"]["live"]["body"] == [9.81, 0.0]
    assert set(record["scene"]["size"]) == {"width", "height"}
    mechanism = record["directions"]["positive"]["mechanism"]
    assert np.shape(mechanism["motion"]) == (2, 3)
    told = "the block rocks to the right about its lower right corner"
    assert mechanism["words"] == told
    assert "to the right" in result.summary()
    names = {"collapse.png", "capacity.png", "blocks.vtu", "viewer.html"}
    assert names <= set(record["files"])
    assert write_report(tmp_path / "out")


def test_a_sweep_goes_over_blocks(tmp_path):
    (tmp_path / "block.toml").write_text(toml(BLOCK))
    found = sweep(tmp_path / "block.toml", {"joints.default.friction": [0.2, 0.4, 0.8]})
    assert [point.load_factor for point in found] == pytest.approx([0.2, 0.4, 0.5], rel=1e-6)


def test_no_mesh_needs_no_dolfinx(tmp_path):
    (tmp_path / "block.toml").write_text(toml(BLOCK))
    script = (
        "import sys; from fenics_contact.cli.command_line import main;"
        f"sys.argv = ['fenics-contact', 'solve', {str(tmp_path / 'block.toml')!r}];"
        "code = main(); print(sorted({'dolfinx', 'ufl', 'gmsh'} & set(sys.modules)), code)"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], env=environment(), capture_output=True, text=True
    )
    assert run.stdout.splitlines()[-1] == "[] 0", run.stderr


def test_groups_of_a_drawing_are_sides(tmp_path):
    """A force on the coping's top, half of it: builders and drawings name their sides."""
    blocks = {"builder": "retaining_wall", "height": 2.0, "base": 1.0, "top": 1.0, "stones": 1}
    dead = BLOCK["loads"]["dead"]
    live = {"traction": {"back": [-1000.0, 0.0]}}
    loads = {"dead": dead, "live": live}
    structure = scene_of(tmp_path, blocks=blocks, loads=loads).structure()
    assert structure.live[:, :3].sum(axis=0) == pytest.approx([-2000.0, 0.0, 0.0])
    part = {"sides": {"back": {"lines": [[[1.0, 0.5], [1.0, 1.5]]]}}}
    structure = scene_of(tmp_path, blocks=blocks, loads=loads, **part).structure()
    assert structure.live[:, :3].sum(axis=0) == pytest.approx([-1000.0, 0.0, 0.0])


def test_a_drawing_may_lie_on_its_side(tmp_path):
    write_dxf(tmp_path / "lies.dxf", [([[0, 0], [2000, 0], [2000, 1000], [0, 1000]], "stone")])
    scene = scene_of(tmp_path, blocks={"file": "lies.dxf", "unit": "mm", "up": "x"})
    low, high = scene.blocks[0].extent
    assert high - low == pytest.approx([1.0, 1.0, 2.0])


def test_blocks_of_a_mesh_file_are_its_outlines(tmp_path):
    gmsh = pytest.importorskip("gmsh")
    builders.facade(storeys=1, bays=1).mesh(0.3)
    gmsh.write(str(tmp_path / "drawn.msh"))
    laws = {"foundations": {"base": {"friction": 0.5}}, "joints": {"default": {"friction": 0.6}}}
    by_name = {"builder": "facade", "storeys": 1, "bays": 1}
    scenes = [scene_of(tmp_path, **laws, blocks=b) for b in (by_name, {"file": "drawn.msh"})]
    drawn, meshed = (sorted(scene.blocks, key=lambda b: b.centroid.tolist()) for scene in scenes)
    for one, two in zip(drawn, meshed, strict=True):
        assert one.group == two.group
        assert np.allclose(one.extent, two.extent, atol=1e-6)
        assert one.volume == pytest.approx(two.volume, rel=1e-6)
        assert [len(p.corners) for p in one.pieces] == [len(p.corners) for p in two.pieces]
    one, two = (rigid.limit_load(scene).load_factor for scene in scenes)
    assert one == pytest.approx(two, rel=1e-5)


def test_a_block_with_a_hole_is_told(tmp_path):
    gmsh = pytest.importorskip("gmsh")
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    ring = [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    model_from_arrays(np.vstack([2 * corners, corners]), {"ring": ring}, {"base": [[0, 1]]})
    gmsh.write(str(tmp_path / "ring.msh"))
    with pytest.raises(InputError, match="has a hole; draw it as two halves"):
        scene_of(tmp_path, blocks={"file": "ring.msh"})
    with pytest.raises(InputError, match=r"ring\.msh is in m"):
        scene_of(tmp_path, blocks={"file": "ring.msh", "unit": "mm"})


def test_builders_files_and_blocks_in_one_scene(tmp_path):
    write_dxf(tmp_path / "stone.dxf", [([(0, 0), (1, 0), (1, 2), (0, 2)], "stones")], unit=6)
    parts = {
        "cap": {"polygon": [[4.0, 2.0], [5.0, 2.0], [5.0, 3.0], [4.0, 3.0]]},
        "left": {"file": "stone.dxf"},
        "right": {"file": "stone.dxf", "at": [4.0, 0.0]},
    }
    scene = scene_of(tmp_path, blocks=parts, foundations={"base": {"friction": 0.6}})
    extents = {block.name: np.array(block.extent)[:, ::2].tolist() for block in scene.blocks}
    (left,) = (name for name in extents if name.startswith("left_"))
    (right,) = (name for name in extents if name.startswith("right_"))
    assert extents[left] == [[0.0, 0.0], [1.0, 2.0]]
    assert extents[right] == [[4.0, 0.0], [5.0, 2.0]]
    assert rigid.limit_load(scene).load_factor == pytest.approx(0.3, abs=1e-6)  # the cap slides
    wrong = {**parts, "right": {**parts["right"], "at": [4.0]}}
    with pytest.raises(InputError, match=r"blocks\.right\.at must be 2 numbers"):
        scene_of(tmp_path, blocks=wrong)
    with pytest.raises(InputError, match=r"blocks\.right: .*other\.dxf"):
        scene_of(tmp_path, blocks={"right": {"file": "other.dxf"}})
