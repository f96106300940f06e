"""Wrong scenes in space: exit code 2, one message that names the thing, nothing written."""

from __future__ import annotations

import pytest

from tests.system.program import files, run_here

PORTAL = """
dimension = 3
[blocks.left]
box = [[0, 0, 0], [1, 1, 3]]
group = "walls"
[blocks.right]
hexahedron = [[3,0,0], [4,0,0], [4,1,0], [3,1,0], [3,0,3], [4,0,3], [4,1,3], [3,1,3]]
group = "walls"
[blocks.lintel]
vertices = [[0,0,3], [4,0,3], [4,1,3], [0,1,3], [0,0,4], [4,0,4], [4,1,4], [0,1,4]]
faces = [[0,3,2,1], [4,5,6,7], [0,1,5,4], [1,2,6,5], [2,3,7,6], [3,0,4,7]]
[materials.default]
density = 2000.0
[joints.default]
friction = 0.6
[foundations.ground]
friction = 0.8
z = 0.0
[sides.front]
group = "walls"
normal = [0, -1, 0]
[floors.roof]
z = 4.0
force = 1e3
[ties.anchor]
from = [0, 0.5, 2.0]
yield = 1e4
ground = [-1, 0.5, 0]
[loads.dead]
body = [0, 0, -9.81]
[loads.live]
direction = [1, 0, 0]
traction.front = [0, 1e3, 0]
force.push = {force = [1e3, 0, 0], block = "lintel"}
"""

#: Settings, and what the message must name.
CASES = [
    ("dimension=4", "dimension = 4", "2 or 3"),
    ("blocks={}", "blocks is missing", "builder"),
    ("block.left.box=[]", "unknown key 'block'", "blocks"),
    ("blocks.left.boks=[]", "unknown key 'blocks.left.boks'", "box"),
    ("blocks.left.box=[[0,0,0],[1,1]]", "blocks.left.box[1]", "three numbers, [x, y, z]"),
    ("blocks.left.box=[[0,0,0],[1,1,nan]]", "block 'left'", "finite"),
    ("blocks.left.box=[[0,0,0]]", "blocks.left: box has 1 corner", "2"),
    ("blocks.left.box=[[0,0,0],[1,0,3]]", "block 'left'"),
    ("blocks.left.box=1", "blocks.left.box = 1", "list"),
    ("blocks.left.hexahedron=[[0,0,0]]", "blocks.left", "one of box, hexahedron"),
    ("blocks.right.hexahedron=[[3,0,0]]", "blocks.right", "hexahedron has 1 corner", "8"),
    ("blocks.right.group=1", "blocks.right.group = 1", "string"),
    ("blocks.right.fixed=1", "blocks.right.fixed = 1", "true or false"),
    ("blocks.lintel.faces=[[0,1,99]]", "block 'lintel'", "99"),
    ("blocks.lintel.faces=[[0,1,2.5]]", "blocks.lintel.faces[0][2]", "whole number"),
    ("blocks.lintel.vertices=[[0,0,3],[4,0,3]]", "block 'lintel'", "corners"),
    ("blocks.lintel.pieces=[]", "blocks.lintel", "either pieces or vertices"),
    ("blocks.more={}", "blocks.more", "box, hexahedron"),
    ("blocks.more=3", "blocks.more = 3", "table"),
    ("blocks.more.box=[[0,0,0],[1,1,1]]", "'left' and 'more'", "overlap"),
    ("blocks.file=a.json", "unknown key 'blocks.left'"),
    ("blocks.builder=wall", "unknown key 'blocks.left'"),
    ("blocks={builder='barn'}", "blocks.builder = 'barn'", "wall"),
    ("materials={}", "materials is missing"),
    ("materials.density=1", "materials.density = 1", "[materials.NAME]"),
    ("materials.default.density=-1", "materials.default.density", ">= 0"),
    ("materials.default.density=1e40", "materials.default.density", "1e+30"),
    ("materials={walls={density=1}}", "'lintel'", "[materials.default]"),
    ("joints={}", "'left' and 'lintel'", "[joints.default]"),
    ("joints.default.friction=-1", "joints.default.friction"),
    ("joints.default.friction=0.6.5", "joints.default.friction", "number"),
    ("joints.default.dilatancy=60", "joints.default.dilatancy", "30.9638"),
    ("joints.default.glued=true", "joints.default.glued", "pieces"),
    ("joints.default.gap=0.1", "joints.default.gap", "closed"),
    ("joints.default.tensile_strength=1e3", "joints.default.tensile_strength", "cohesion"),
    ("joints.nowhere.friction=1", "joints.nowhere", "'walls'"),
    ("joints.a={friction=1,between=['walls','roof']}", "joints.a", "'roof'", "'walls'"),
    ("joints.a={friction=1,between=['walls']}", "joints.a.between", "two"),
    ("foundations.ground.z=0.5", "foundations.ground", "z"),
    ("foundations.ground.plane={point=[0,0,0]}", "foundations.ground.z", "plane"),
    ("foundations.ground.plane.normal=[0,0,0]", "foundations.ground.plane"),
    ("sides.front={}", "sides.front", "group"),
    ("sides.front.normal=[0,0,0]", "sides.front.normal", "not zero"),
    ("sides.front.group=nowhere", "loads.live.traction.front", "[sides.front]"),
    ("floors.roof.z=3.5", "floors.roof", "z = 3.5"),
    ("floors.roof.x=[9,10]", "floors.roof", "within x and y"),
    ("floors.roof.thrust=[nan,0]", "floors.roof.thrust", "finite"),
    ("floors.roof.thrust=1.0", "floors.roof.thrust", "two numbers"),
    ("floors.roof.x=[1,0]", "floors.roof.x", "rise"),
    ("ties.anchor.from=[9,9,9]", "ties.anchor.from", "(9, 9, 9)"),
    ("ties.anchor.from=[0.5,0.5,3]", "ties.anchor.from", "'left', 'lintel'"),
    ("ties.anchor.to=[0,0.5,1]", "ties.anchor.to", "either to or ground"),
    ("ties.anchor.plate=-1", "ties.anchor.plate", "positive"),
    ("ties.anchor.line=[[0,0]]", "ties.anchor.line", "to"),
    ("ties.anchor.prestress=1e5", "ties.anchor.prestress", "yield"),
    ("loads.dead.movement.nowhere.displacement=[0,0,1]", "loads.dead.movement.nowhere", "'ground'"),
    ("loads.dead.movement.ground.rotation=[0,0,9]", "loads.dead.movement.ground.rotation", "5"),
    ("loads.live.movement.ground.displacement=[0,0,1]", "loads.live.movement", "loads.dead"),
    ("loads.dead.profile=triangular", "loads.dead.profile", "live"),
    ("loads.live.profile=round", "loads.live.profile", "triangular"),
    ("loads.dead.body=[1,0]", "loads.dead.body", "three numbers"),
    ("loads.live.body=[1,0,0]", "loads.live.direction", "either body or direction"),
    ("loads.live.traction.back=[1,0,0]", "loads.live.traction.back", "'front'"),
    ("loads.live.force.push.block=beam", "loads.live.force.push", "'beam'"),
    ("loads.live.force.push.sides=front", "loads.live.force.push", "either block or at, or sides"),
    ("loads={}", "loads.live is missing"),
    ("solve.direction=up", "solve.direction", "positive"),
    ("solve.gap=0", "solve.gap", "0.1"),
    ("seismic={demand=-1}", "seismic.demand"),
    ("tolerance=0", "tolerance = 0", "positive"),
    ("output.units=inch", "output.units", "SI"),
    ("seismic.confidence_factor=0.5", "seismic.confidence_factor", "1 ... 10"),
]


def test_the_scene_is_right_without_them(folder, capsys):
    (folder / "scene.toml").write_text(PORTAL)
    found = run_here(["check", "scene.toml"], capsys)
    assert (found.code, found.err) == (0, "")


@pytest.mark.parametrize(("override", "names"), [(case, names) for case, *names in CASES])
def test_message_names_what_is_wrong(override, names, folder, capsys):
    (folder / "scene.toml").write_text(PORTAL)
    found = run_here(["check", "scene.toml", "--set", override], capsys)
    assert found.code == 2, found.out
    assert found.err.startswith("fenics-contact: ") and found.err.count("\n") == 1, found.err
    for name in names:
        assert name in found.err
    assert files(folder) == {"scene.toml"}
