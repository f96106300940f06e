"""What files name is read or told: supports, places, bodies without faces, layers, units."""

from __future__ import annotations

import json
import logging
from dataclasses import replace

import ezdxf
import numpy as np
import pytest

from fenics_contact.errors import InputError
from fenics_contact.spatial import Scene, limit_load
from fenics_contact.spatial.check import description
from fenics_contact.spatial.readers import blocks_from_file, read_blocks
from tests.quick import some
from tests.spatial.dirty_files import (
    FAULTS,
    SIDES,
    TOP,
    box,
    lost,
    mesh,
    write_binary,
    write_dxf,
    write_msh,
    write_obj,
    write_stl,
)

LAWS = {"materials": {"default": {"density": 2000.0}}, "joints": {"default": {"friction": 0.3}}}
LOADS = {"dead": {"body": [0.0, 0.0, -9.81]}, "live": {"direction": [1.0, 0.0, 0.0]}}
TOWER = [box("B0", (0, 0, 0), (0.5, 0.5, 2)), box("B1", (0, 0, 2), (0.5, 0.5, 2.5))]


def scene_of(path, **blocks):
    table = {"dimension": 3, "blocks": {"file": path.name, **blocks}, "loads": LOADS, **LAWS}
    return Scene.from_tables(table, path.parent)


def factor(path, **blocks):
    found = limit_load(scene_of(path, **blocks)).ends["positive"]
    assert found.status == "limit"
    return found.load_factor


def written(path, table):
    path.write_text(json.dumps(table))
    return path


@pytest.mark.parametrize("part", some(range(4), 4))
def test_dirty_files_lose_nothing_silently(part, tmp_path):
    for seed in range(1000 + 10 * part, 1010 + 10 * part):
        kind, fault, _, wrong = lost(seed, tmp_path)
        assert fault in FAULTS
        assert not wrong, f"{seed} {kind} {fault}: {wrong}"


# Supports.


@pytest.mark.parametrize("kind", ["vertex", "node"])
@pytest.mark.parametrize("inner", [None, "data", "value"])
def test_supports_beside_the_blocks(kind, inner, tmp_path):
    """The upper block slides on the lower one, which is held: 0.3. It would tip alone at 1."""
    nodes = {"0": {"x": 0.0, "is_support": True}, "1": {"x": 0.0, "is_support": False}}
    network = {kind: nodes} if inner is None else {"dtype": "a/Network", inner: {kind: nodes}}
    blocks = {str(k): mesh(body) for k, body in enumerate(TOWER)}
    path = written(tmp_path / "tower.json", {"blocks": blocks, "assembly": network})
    assert factor(path) == pytest.approx(0.3, rel=1e-6)
    nodes["7"] = {"is_support": True}
    with pytest.raises(InputError, match="json': there are no blocks of the supports '7'"):
        read_blocks(written(path, {"blocks": blocks, "assembly": network}))


def test_a_support_that_is_no_block_is_refused(tmp_path):
    table = {"stones": [mesh(body) for body in TOWER], "marks": [{"id": 3, "is_support": True}]}
    with pytest.raises(InputError, match="something is_support, and no block became ground"):
        read_blocks(written(tmp_path / "a.json", table))
    nodes = {"0": {"block": mesh(TOWER[0])}, "1": {"block": None, "is_support": True}}
    with pytest.raises(InputError, match=r"block '1' has no faces|became ground"):
        read_blocks(written(tmp_path / "b.json", {"graph": {"data": {"node": nodes}}}))


def test_a_mesh_beside_the_blocks_is_a_block(tmp_path):
    table = {"blocks": {"0": mesh(TOWER[0])}, "cap": mesh(TOWER[1])}
    names = [block.name for block in blocks_from_file(written(tmp_path / "a.json", table))]
    assert names == ["B0", "B1"]
    table["elements"] = [{"guid": "g", "geometry": mesh(STONE)}, {"guid": "g"}]
    with pytest.raises(InputError, match="'g' twice"):
        read_blocks(written(tmp_path / "a.json", table))


def problem(**conditions):
    keys = ["one", "two"]
    elements = {
        key: {"dtype": "compas_dem.elements/Block", "data": {"geometry": {"data": mesh(body)}}}
        for key, body in zip(keys, TOWER, strict=True)
    }
    nodes = {str(k): {"element": key} for k, key in enumerate(keys)}
    tree = {"root": {"children": [{"element": key} for key in keys]}}
    model = {"elements": elements, "graph": {"node": nodes, "edge": {}}, "tree": tree}
    table = {"model": {"data": model}, "boundary_conditions": {"data": conditions}}
    return {"dtype": "compas_dem.problem/Problem", "data": table}


def test_supports_and_loads_of_a_problem(tmp_path):
    held = {"block_index": 0, "translation": [0.0, 0.0, 0.0], "rotation": [0.0, 0.0, 0.0]}
    moved = {"block_index": 1, "translation": [0.0, None, 0.1], "rotation": None}
    table = problem(displacements=[held, moved], point_loads=[{}, {}], gravity=True)
    table["data"]["contact_properties"] = {"data": {"mu": 0.5}}
    found = read_blocks(written(tmp_path / "p.json", table))
    assert [block.fixed for block in found.blocks] == [True, False]
    (note,) = found.notes
    for text in ("1 displacements that are no", "2 point_loads", "1 gravity", "1 contact_prop"):
        assert text in note
    halves = [{**held, "rotation": None}, {**held, "translation": None}]
    found = read_blocks(written(tmp_path / "p.json", problem(displacements=halves)))
    assert [block.fixed for block in found.blocks] == [True, False]
    assert found.notes == ()


# Frames and transformations of COMPAS.

QUARTER = [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
FRAME = {"point": [5.0, 0.0, 0.0], "xaxis": [0.0, 0.0, 2.0], "yaxis": [0.0, 1.0, 1.0]}
STONE = box("stone", (0, 0, 0), (2, 1, 1))


@pytest.mark.parametrize("inner", ["data", "value"])
@pytest.mark.parametrize(
    ("place", "middle"),
    [
        ({"transformation": QUARTER}, (-0.5, 1.0, 0.5)),
        ({"frame": FRAME}, (4.5, 0.5, 1.0)),
        ({"frame": FRAME, "transformation": QUARTER}, (4.5, 1.0, -0.5)),
    ],
)
def test_places_of_blocks(inner, place, middle, tmp_path):
    """A quarter turn about z; a frame whose x is z; the frame after the turn."""
    place = {
        key: {"dtype": f"compas.geometry/{key}", inner: {"matrix": v} if key[0] == "t" else v}
        for key, v in place.items()
    }
    table = {"blocks": {"a": {"dtype": "x/Block", inner: {**mesh(STONE), **place}}}}
    (block,) = blocks_from_file(written(tmp_path / "a.json", table))
    assert block.centroid == pytest.approx(np.array(middle), abs=1e-12)
    assert block.volume == pytest.approx(2.0)


def test_places_of_a_tree_are_multiplied(tmp_path):
    """Model moved by 10 along x, group turned by a quarter, stone moved by 1 along x before."""

    def shift(x):
        return {"matrix": [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}

    stone = {"transformation": {"data": shift(1.0)}, "geometry": {"data": mesh(STONE)}}
    group = {"dtype": "m/Group", "data": {"transformation": {"data": {"matrix": QUARTER}}}}
    elements = {"s": {"dtype": "m/BlockElement", "data": stone}, "g": group}
    tree = {"root": {"children": [{"element": "g", "children": [{"element": "s"}]}]}}
    model = {"transformation": {"data": shift(10.0)}, "elements": elements, "tree": tree}
    (block,) = blocks_from_file(written(tmp_path / "m.json", {"data": model}))
    assert block.centroid == pytest.approx([10.0 - 0.5, 2.0, 0.5], abs=1e-12)
    stone["transformation"] = {"data": {"matrix": [[1, 0], [0, 1]]}}
    with pytest.raises(InputError, match="a matrix that is not of a motion in space"):
        blocks_from_file(written(tmp_path / "m.json", {"data": model}))


# Bodies without faces.


def without(kind, tmp_path):
    body = replace(TOWER[1], faces=[])
    bodies = [TOWER[0], body]
    path = tmp_path / f"a.{kind.rpartition(' ')[2]}"
    tables = {
        "face json": {"blocks": {"0": mesh(TOWER[0]), "1": mesh(body)}},
        "vertex json": [mesh(TOWER[0]), {"name": "B1", "face": mesh(TOWER[0])["face"]}],
        "shape json": [mesh(TOWER[0]), {"dtype": "compas.geometry/Box", "name": "B1"}],
    }
    if kind in tables:
        return written(path, tables[kind])
    if kind in ("solid dxf", "hidden dxf"):
        bodies[1] = replace(TOWER[1], **{kind.split()[0]: True})
    writers = {"obj": write_obj, "stl": write_stl, "dxf": write_dxf, "msh": write_msh}
    writers[path.suffix[1:]](path, bodies, np.random.RandomState(1))
    return path


class Dice:
    """Always the first choice."""

    def random(self):
        return 0.0

    def choice(self, items):
        return items[0]


@pytest.mark.parametrize(
    "kind", ["face json", "vertex json", "shape json", "obj", "stl", "msh", "solid dxf"]
)
def test_bodies_without_faces_are_refused_by_name(kind, tmp_path):
    with pytest.raises(InputError, match=r"block 'B1.*' has no faces; delete it, or draw") as told:
        read_blocks(without(kind, tmp_path))
    assert str(tmp_path / "a.") in str(told.value)


def test_layers_and_entities_left_out_are_one_warning(tmp_path):
    path = without("hidden dxf", tmp_path)
    document = ezdxf.readfile(path)
    for k in range(3):
        document.modelspace().add_line((k, 0), (k, 1), dxfattribs={"layer": "axes"})
    document.saveas(path)
    found = read_blocks(path)
    assert [block.name for block in found.blocks] == ["B0"]
    (note,) = found.notes
    assert "3 LINE on layer 'axes'" in note
    assert "1 on layer 'B1', which is off or frozen" in note
    assert found.told.endswith("1 named, 1 read, 4 left out")
    scene = scene_of(path)
    assert note in scene.structure().warnings
    assert f"file {found.told}" in description(scene, scene.structure())


def test_python_is_told_too(tmp_path, caplog):
    write_obj(tmp_path / "a.obj", [replace(STONE, faces=2 * SIDES)], Dice())
    with caplog.at_level(logging.WARNING):
        (block,) = blocks_from_file(tmp_path / "a.obj")
    assert block.volume == pytest.approx(2.0)
    assert "6 faces written again" in caplog.text


def test_bodies_that_share_a_face_keep_it(tmp_path):
    """Two cubes in one object: the face between them is there twice, and is one of each."""
    upper = box("b", (0, 0, 1), (1, 1, 2))
    faces = [f for body in (box("a", (0, 0, 0), (1, 1, 1)), upper) for f in body.points[SIDES]]
    points = np.vstack(faces)
    loops = [tuple(range(4 * k, 4 * k + 4)) for k in range(len(faces))]
    write_obj(tmp_path / "a.obj", [replace(upper, points=points, faces=loops)], Dice())
    found = read_blocks(tmp_path / "a.obj")
    assert [block.volume for block in found.blocks] == pytest.approx([1.0, 1.0])
    assert found.notes == ()


@pytest.mark.parametrize("text", ['{"a": {}, "a": {}}', '[{"name": "x", "name": "y"}]'])
def test_a_key_twice_is_refused(text, tmp_path):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=r"a.json': one table has '\w+' twice"):
        read_blocks(tmp_path / "a.json")


def test_a_folder_tells_of_its_other_files(tmp_path):
    for body in TOWER:
        write_obj(tmp_path / f"{body.name}.obj", [body], Dice())
    (tmp_path / "pose.json").write_text('{"frame": [1, 2, 3]}')
    (tmp_path / "part.3dm").write_text("")
    (tmp_path / "more").mkdir()
    found = read_blocks(tmp_path)
    assert [block.name for block in found.blocks] == ["B0", "B1"]
    (note,) = found.notes
    assert "left out: 3 files ('more', 'part.3dm', 'pose.json')" in note


# A single face as ground.


def on_face(tmp_path, face, *bodies):
    write_obj(tmp_path / "a.obj", [*bodies, face], Dice())
    return tmp_path / "a.obj"


GROUND = replace(box("plate", (-3, -3, -1), (3, 3, 0)), faces=TOP)


def test_a_single_face_that_blocks_lie_on_is_ground(tmp_path):
    path = on_face(tmp_path, GROUND, box("a", (0, 0, 0), (1, 1, 1)), box("b", (0, 0, 1), (1, 1, 2)))
    found = read_blocks(path)
    assert [(block.name, block.fixed) for block in found.blocks][2] == ("plate", True)
    assert found.notes == (f"'{path}': 'plate' is one face that blocks lie on: ground",)
    assert factor(path) == pytest.approx(0.3, rel=1e-6)


@pytest.mark.parametrize(
    "bodies",
    [
        [],
        [box("under", (0, 0, -1), (1, 1, 0))],
        [box("over", (0, 0, 0), (1, 1, 1)), box("under", (0, 0, -1), (1, 1, 0))],
        [box("beside", (5, 0, 0), (6, 1, 1))],
        [box("above", (0, 0, 0.1), (1, 1, 1))],
    ],
)
def test_other_single_faces_are_refused(bodies, tmp_path):
    far = box("far", (20, 0, 0.5), (21, 1, 1))
    with pytest.raises(InputError, match="block 'plate' has no volume; draw its whole surface"):
        read_blocks(on_face(tmp_path, GROUND, far, *bodies))


def test_a_face_that_is_no_ground_because_it_is_not_convex(tmp_path):
    plan = [(-3, -3), (3, -3), (3, 3), (2, 3), (2, -2), (-3, -2)]
    face = replace(
        GROUND, points=np.array([(*p, 0.0) for p in plan]), faces=[tuple(range(len(plan)))]
    )
    with pytest.raises(InputError, match="block 'plate' has a face that is not convex"):
        read_blocks(on_face(tmp_path, face, box("a", (0, -3, 0), (1, -2, 1))))


@pytest.mark.parametrize("corners", ["1", "1 2", "1 1 1"])
def test_a_face_of_a_point_or_a_line_is_no_block(corners, tmp_path):
    (tmp_path / "a.obj").write_text(f"o a\nv 0 0 0\nv 1 0 0\nf {corners}\n")
    with pytest.raises(InputError, match=r"a\.obj': block 'a' (has no faces with an area|is 0 m)"):
        read_blocks(tmp_path / "a.obj")


# Units, and numbers of seven digits.


@pytest.mark.parametrize(
    ("scale", "text"),
    [
        (1e3, "block 'B0' is 2e+03 m wide (and 1 more): are the numbers in m?"),
        (1e-3, "block 'B0' is 0.002 m wide (and 1 more): are the"),
        (24.0, "block 'B0' weighs"),
        (0.1, None),
        (1.0, None),
    ],
)
def test_blocks_of_odd_sizes_are_told(scale, text, tmp_path):
    wide = box("slab", (-90, -90, -1), (90, 90, 0)) if scale == 1.0 else None
    weights = {"default": {"density": 2e8 if scale == 24.0 else 2000.0}}
    bodies = [replace(body, points=scale * body.points) for body in TOWER]
    write_obj(tmp_path / "a.obj", [*bodies, wide] if wide else bodies, Dice())
    blocks = {"file": "a.obj", **({"fixed": ["slab"]} if wide else {})}
    table = {"dimension": 3, "blocks": blocks, "loads": LOADS, **LAWS, "materials": weights}
    warnings = Scene.from_tables(table, tmp_path).structure().warnings
    odd = [found for found in warnings if "blocks.unit" in found]
    assert len(odd) == (text is not None)
    assert not text or odd[0].startswith(text)


@pytest.mark.parametrize(("far", "right"), [(0.0, True), (100.0, True), (1e5, False), (4e6, False)])
def test_binary_stl_far_from_the_origin(far, right, tmp_path):
    stone = box("a", (0, 0, 0), (0.6, 0.4, 0.3))
    write_binary(tmp_path / "a.stl", [replace(stone, points=stone.points + far)], None)
    if right:
        assert blocks_from_file(tmp_path / "a.stl")[0].volume == pytest.approx(0.072, rel=1e-3)
    else:
        with pytest.raises(InputError, match=r"rounded to 0\.\d+ m, too far from the origin"):
            blocks_from_file(tmp_path / "a.stl")
    write_stl(tmp_path / "b.stl", [replace(stone, points=stone.points + far)], None)
    assert blocks_from_file(tmp_path / "b.stl")[0].volume == pytest.approx(0.072, rel=1e-3)
