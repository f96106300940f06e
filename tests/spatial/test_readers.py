"""Blocks from files of other programs: every format, what is mended, and one line for the rest."""

from __future__ import annotations

import json
import random
import re
import struct
from dataclasses import replace

import ezdxf
import numpy as np
import pytest
from ezdxf.render import MeshBuilder
from scipy.spatial import ConvexHull

from fenics_contact.errors import InputError
from fenics_contact.geometry.gmsh_mesh import gmsh_session
from fenics_contact.spatial import Scene
from fenics_contact.spatial.contacts import checked_contacts
from fenics_contact.spatial.limit import collapse_of
from fenics_contact.spatial.polyhedra import HEXAHEDRON, Block, Polyhedron
from fenics_contact.spatial.readers import blocks_from_file
from fenics_contact.spatial.structure import ContactLaw, Structure
from tests.quick import some

TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])


def hexahedron(corners, name, group="stones", fixed=False):
    return Block((Polyhedron.hexahedron(np.array(corners)),), name, group, fixed)


def box(low, high, name, group="stones", fixed=False):
    return Block((Polyhedron.box(np.array(low), np.array(high)),), name, group, fixed)


def stack():
    """A pillar of two blocks on the ground."""
    return [
        box([-1, -1, -0.5], [1, 1, 0], "base", "ground", True),
        box([-0.2, -0.3, 0], [0.2, 0.3, 0.5], "low"),
        box([-0.2, -0.3, 0.5], [0.2, 0.3, 1.1], "high"),
    ]


def arch(count=9):
    """A half circle of voussoirs between two fixed ones, turned in space and moved."""
    angles = np.linspace(0.0, np.pi, count + 1)
    blocks = []
    for k in range(count):
        plan = [
            (radius * np.cos(a), radius * np.sin(a))
            for a, radius in zip(angles[[k, k + 1, k + 1, k]], (1, 1, 1.2, 1.2), strict=True)
        ]
        corners = [(x, y, z) for y in (0.0, 0.5) for x, z in plan]
        fixed = k in (0, count - 1)
        blocks.append(hexahedron(corners, f"v{k}", "ground" if fixed else "stones", fixed))
    turned = []
    for block in blocks:
        body = block.pieces[0]
        moved = Polyhedron(body.corners @ TURN.T + [3.0, -2.0, 5.0], body.sides)
        turned.append(Block((moved,), block.name, block.group, block.fixed))
    return turned


def factor_of(blocks, down=(0.0, 0.0, -1.0), along=(1.0, 0.0, 0.0)):
    """Load factor of weights 1 a volume pushed along a direction."""
    contacts = checked_contacts(blocks)[0]
    dead, live = np.zeros((2, len(blocks), 6))
    for k, block in enumerate(blocks):
        dead[k, :3] = block.volume * np.array(down)
        live[k, :3] = block.volume * np.array(along)
    laws = (ContactLaw(0.7),) * len(contacts)
    return collapse_of(Structure(tuple(blocks), contacts, laws, dead, live)).load_factor


def faces_of(block, triangles=False):
    """Faces by their corners."""
    (body,) = block.pieces
    faces = [body.corners[list(side)] for side in body.sides]
    if triangles:
        faces = [f[[0, k, k + 1]] for f in faces for k in range(1, len(f) - 1)]
    return faces


def mesh_table(block):
    (body,) = block.pieces
    vertices = {
        str(k): dict(zip("xyz", p, strict=True)) for k, p in enumerate(body.corners.tolist())
    }
    return {"vertex": vertices, "face": {str(k): list(s) for k, s in enumerate(body.sides)}}


def write_obj(path, blocks):
    lines, count = ["# blocks"], 1
    for block in blocks:
        lines += [f"o {block.name}", f"usemtl {block.group}"]
        for face in faces_of(block):
            lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in face.tolist()]
            lines.append("f " + " ".join(f"{count + k}//{k + 1}" for k in range(len(face))))
            count += len(face)
    path.write_text("\n".join(lines) + "\n")


def write_stl(path, blocks):
    text = ""
    for block in blocks:
        text += f"solid {block.name}\n"
        for face in faces_of(block, triangles=True):
            text += " facet normal 0 0 0\n  outer loop\n"
            text += "".join(f"   vertex {x!r} {y!r} {z!r}\n" for x, y, z in face.tolist())
            text += "  endloop\n endfacet\n"
        text += f"endsolid {block.name}\n"
    path.write_text(text)


def write_binary_stl(path, blocks):
    faces = [face for block in blocks for face in faces_of(block, triangles=True)]
    data = b"solid but binary".ljust(80) + struct.pack("<I", len(faces))
    for face in faces:
        data += struct.pack("<12fH", 0, 0, 0, *face.ravel(), 0)
    path.write_bytes(data)


def write_compas(path, blocks):
    """As compas_assembly 0.7 and COMPAS 1 write it."""
    nodes = {
        str(k): {
            "block": {
                "dtype": "compas_assembly.datastructures/Block",
                "value": {"attributes": {"name": b.name, "group": b.group}, **mesh_table(b)},
            },
            "is_support": b.fixed,
        }
        for k, b in enumerate(blocks)
    }
    side = {"0": {"x": 0.0}, "1": {"x": 1.0}, "2": {"y": 1.0}}
    contact = {"mesh": {"data": {"vertex": side, "face": {"0": [0, 1, 2]}}}}
    graph = {"dna": {"block": None, "is_support": False}, "node": nodes}
    graph["edge"] = {"0": {"1": {"interfaces": [contact]}}}
    table = {"attributes": {"name": "Assembly"}, "graph": graph}
    path.write_text(json.dumps({"dtype": "compas_assembly/Assembly", "value": table}))


def write_dxf(path, blocks, how="3dface"):
    document = ezdxf.new(units=6)
    for block in blocks:
        (body,) = block.pieces
        mesh = MeshBuilder()
        mesh.vertices, mesh.faces = [*map(tuple, body.corners)], [*body.sides]
        attributes = {"layer": block.group}
        if how == "3dface":
            mesh.render_3dfaces(document.modelspace(), dxfattribs=attributes)
        elif how == "mesh":
            mesh.render_mesh(document.modelspace(), dxfattribs=attributes)
        else:
            mesh.render_polyface(document.modelspace(), dxfattribs=attributes)
    document.saveas(path)


def write_msh(path, blocks):
    """Boxes, meshed together."""
    with gmsh_session(MeshSizeMax=0.5) as gmsh:
        gmsh.model.add("blocks")
        volumes = []
        for block in blocks:
            low, high = block.extent
            volumes.append((3, gmsh.model.occ.addBox(*low, *(high - low))))
        gmsh.model.occ.fragment(volumes, [])
        gmsh.model.occ.synchronize()
        for group in {block.group for block in blocks}:
            tags = [t for (_, t), b in zip(volumes, blocks, strict=True) if b.group == group]
            tag = gmsh.model.addPhysicalGroup(3, tags)
            gmsh.model.setPhysicalName(3, tag, group)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(path))
        gmsh.model.remove()


WRITERS = {
    "json": write_compas,
    "obj": write_obj,
    "stl": write_stl,
    "binary.stl": write_binary_stl,
    "dxf": write_dxf,
    "mesh.dxf": lambda path, blocks: write_dxf(path, blocks, "mesh"),
    "polyface.dxf": lambda path, blocks: write_dxf(path, blocks, "polyface"),
    "msh": write_msh,
}
#: Formats that keep names of blocks, and of groups.
NAMED = {"json", "obj", "stl"}
GROUPED = {"json", "obj", "dxf", "mesh.dxf", "polyface.dxf", "msh"}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_stack_has_the_same_load_factor(kind, tmp_path):
    path = tmp_path / f"stack.{kind}"
    WRITERS[kind](path, stack())
    blocks = sorted(blocks_from_file(path), key=lambda block: block.centroid[2])
    assert [len(block.pieces) for block in blocks] == [1, 1, 1]
    assert [block.fixed for block in blocks] == [kind == "json", False, False]
    blocks[0] = replace(blocks[0], fixed=True)
    assert [block.volume for block in blocks] == pytest.approx([2.0, 0.12, 0.144], rel=1e-6)
    assert all(len(block.pieces[0].sides) == 6 for block in blocks)
    assert factor_of(blocks) == pytest.approx(0.4 / 1.1, rel=1e-6)
    if kind in NAMED:
        assert [block.name for block in blocks] == ["base", "low", "high"]
    if kind in GROUPED:
        assert [block.group for block in blocks] == ["ground", "stones", "stones"]


@pytest.mark.parametrize("kind", some(sorted(set(WRITERS) - {"msh"}), 7))
def test_an_arch_turned_in_space_has_the_same_load_factor(kind, tmp_path):
    path = tmp_path / f"arch.{kind}"
    WRITERS[kind](path, arch())
    blocks = blocks_from_file(path)
    assert len(blocks) == 9
    if kind != "json":
        ends = sorted(blocks, key=lambda b: abs((b.centroid - [3, -2, 5]) @ TURN[:, 2]))[:2]
        blocks = [Block(b.pieces, b.name, b.group, any(b is e for e in ends)) for b in blocks]
    directions = -TURN[:, 2], TURN[:, 0]
    expected = factor_of(arch(), *directions)
    assert factor_of(blocks, *directions) == pytest.approx(expected, rel=1e-5)


def test_a_scene_of_a_file_in_mm(tmp_path):
    write_obj(tmp_path / "stack.obj", stack())
    text = """
    dimension = 3
    [blocks]
    file = "stack.obj"
    unit = "mm"
    fixed = ["gr*"]
    groups.upper = ["hi*"]
    [materials.default]
    density = 2000.0
    [joints.default]
    friction = 0.7
    [loads.live]
    direction = [1, 0, 0]
    """
    (tmp_path / "scene.toml").write_text(text)
    blocks = Scene.from_file(tmp_path / "scene.toml").structure().blocks
    assert [block.fixed for block in blocks] == [True, False, False]
    assert [block.group for block in blocks] == ["ground", "stones", "upper"]
    assert blocks[0].volume == pytest.approx(2e-9)
    with pytest.raises(InputError, match="unit = 'yd' must be one of mm"):
        blocks_from_file(tmp_path / "stack.obj", "yd")


def test_a_folder_of_files(tmp_path):
    for block in stack():
        write_binary_stl(tmp_path / f"{block.name}.stl", [block])
    write_obj(tmp_path / "two.obj", stack()[1:])
    (tmp_path / "notes.txt").write_text("none")
    blocks = blocks_from_file(tmp_path)
    assert [block.name for block in blocks] == ["base", "high 1", "low 1", "low 2", "high 2"]


# COMPAS of several versions, written by hand.


def test_compas_model(tmp_path):
    """compas_model: elements beside a tree, and contacts in a graph."""
    elements = {
        block.name: {
            "dtype": "Block",
            "data": {
                "name": block.name,
                "is_support": block.fixed,
                "transformation": None,
                "geometry": {"dtype": "compas.datastructures/Mesh", "data": mesh_table(block)},
            },
        }
        for block in stack()
    }
    model = {
        "elements": elements,
        "tree": {"root": {"children": [{"element": name} for name in elements]}},
        "graph": {"node": {}, "edge": {"0": {"1": {"contacts": [mesh_table(stack()[0])]}}}},
    }
    path = tmp_path / "model.json"
    path.write_text(json.dumps({"dtype": "compas_model.models/Model", "data": model}))
    found = blocks_from_file(path)
    assert [(b.name, b.fixed) for b in found] == [("base", True), ("low", False), ("high", False)]


def test_lists_of_vertices_and_faces(tmp_path):
    tables = [
        {"name": b.name, "vertices": b.pieces[0].corners.tolist(), "faces": b.pieces[0].sides}
        for b in stack()
    ]
    path = tmp_path / "list.json"
    path.write_text(json.dumps(tables))
    assert [block.name for block in blocks_from_file(path)] == ["base", "low", "high"]


# What is mended.


def write_faces(path, faces, name="stone"):
    lines = [f"o {name}"]
    for face in faces:
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(face, float).tolist()]
        lines.append("f " + " ".join(str(k - len(face)) for k in range(len(face))))
    path.write_text("\n".join(lines))
    return path


CUBE = faces_of(box([0, 0, 0], [1, 1, 1], ""))


def test_sides_turned_cut_and_drawn_near_each_other(tmp_path):
    dice = random.Random(1)
    faces = [face[::-1] if dice.random() < 0.5 else face for face in CUBE[1:]]
    a, b, c, d = CUBE[0]
    middle = 0.5 * (a + b)
    faces += [[a, middle, d], [middle, c, d], [c, middle, b], [a, b, middle]]  # one of no area
    faces = [np.asarray(f) + 1e-8 * np.array([dice.random() for _ in range(3)]) for f in faces]
    (block,) = blocks_from_file(write_faces(tmp_path / "cube.obj", faces))
    (body,) = block.pieces
    assert len(body.sides) == 6
    assert block.volume == pytest.approx(1.0, rel=1e-6)
    assert block.centroid == pytest.approx([0.5] * 3, abs=1e-6)


@pytest.mark.parametrize("bend", [0.01, 0.1])
def test_bent_sides_are_made_plane_alike_on_both_blocks(bend, tmp_path):
    """Two blocks that share four corners not quite in a plane touch in one contact."""
    top = np.array([[0, 0, 1.0], [1, 0, 1.0 + bend], [1, 1, 1.0], [0, 1, 1.0 + bend]])
    low = np.vstack([top * [1, 1, 0], top])
    high = np.vstack([top, top * [1, 1, 0] + [0, 0, 2.0]])
    for name, corners in (("low", low), ("high", high)):
        write_faces(tmp_path / f"{name}.obj", [corners[list(side)] for side in HEXAHEDRON])
    blocks = blocks_from_file(tmp_path)
    (contact,) = checked_contacts(blocks)[0]
    assert contact.area == pytest.approx(1.0, rel=1e-3)
    assert sum(block.volume for block in blocks) == pytest.approx(2.0, rel=1e-6)


def prism(plan, height=1.0):
    """Faces of a prism on a polygon."""
    low, high = (np.column_stack([plan, np.full(len(plan), z)]) for z in (0.0, height))
    sides = [np.array([low[k - 1], low[k], high[k], high[k - 1]]) for k in range(len(plan))]
    return [low[::-1], high, *sides]


@pytest.mark.parametrize(
    ("plan", "pieces"),
    [
        ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 2),
        ([(0, 0), (3, 0), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)], 3),
        ([(0, 0), (2, 1), (0, 2), (1, 1)], 2),
    ],
)
def test_blocks_that_are_not_convex_are_cut(plan, pieces, tmp_path):
    plan = np.array(plan, dtype=float)
    x, y = plan.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    (block,) = blocks_from_file(write_faces(tmp_path / "stone.obj", prism(plan)))
    assert block.volume == pytest.approx(area, rel=1e-9)
    assert len(block.pieces) == pieces


def test_random_bodies_keep_their_volume(tmp_path):
    """Hulls of random points, and prisms on random stars, in any place and position."""
    dice = np.random.default_rng(7)
    for _ in range(15):
        turn = np.linalg.qr(dice.normal(size=(3, 3)))[0]
        place = 10.0 * dice.normal(size=3)
        hull = ConvexHull(dice.normal(size=(dice.integers(4, 30), 3)) * dice.uniform(0.2, 3.0, 3))
        count = dice.integers(4, 12)
        angles = 2.0 * np.pi * (np.arange(count) + dice.uniform(-0.3, 0.3, count)) / count
        x, y = dice.uniform(0.4, 2.0, count) * [np.cos(angles), np.sin(angles)]
        area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
        faces = [face @ turn.T + place for face in prism(np.column_stack([x, y]))]
        triangles = [
            [face[k - 1], face[k], face.mean(axis=0) if len(face) == 4 else turn[:, 2] * z + place]
            for face, z in zip(faces, [0, 1] + [0] * count, strict=True)
            for k in range(len(face))
        ]
        for found, volume in (
            (hull.points[hull.simplices] @ turn.T + place, hull.volume),
            (faces, area),
            (triangles, area),
        ):
            (block,) = blocks_from_file(write_faces(tmp_path / "stone.obj", found))
            assert block.volume == pytest.approx(volume, rel=2e-5)


def test_a_block_with_a_hole_through_it(tmp_path):
    outer, inner = (np.array([(-a, -a), (a, -a), (a, a), (-a, a)]) for a in (2.0, 1.0))
    faces = []
    for z in (0.0, 1.0):
        for k in range(4):
            ring = [outer[k - 1], outer[k], inner[k], inner[k - 1]]
            faces.append([(*p, z) for p in ring])
    for loop in (outer, inner):
        faces += prism(loop)[2:]
    (block,) = blocks_from_file(write_faces(tmp_path / "ring.obj", faces))
    assert block.volume == pytest.approx(12.0, rel=1e-9)
    assert len(block.pieces) <= 8


# What is refused, in one line that names the file and the block.

SHIFTED = [face + np.array([1.0, 1.0, 0.0]) for face in CUBE]
DISORDERED = [face for both in zip(CUBE, SHIFTED, strict=True) for face in both]
SPIKE = prism(np.array([(0, 0), (4, 0), (4, 2), (3, 2), (1, 1), (3, 2.5), (4, 3), (0, 3)], float))


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        (CUBE[1:], "has faces of 5 m2 for a surface of 6 m2; draw those that are missing"),
        (
            [CUBE[0][[1, 2, 3]], *CUBE],
            "has faces of 6.5 m2 for a surface of 6 m2; delete those drawn twice",
        ),
        (prism(SPIKE[1][:, :2])[1:], "is not closed: the edge between .* is in 1 sides"),
        (DISORDERED, "between .1, 1, 0. and .1, 1, 1. is in 4 sides, not 2"),
        ([face * [1, 1, 0] for face in CUBE], "has no volume; draw its whole surface"),
        (CUBE[:1], "has no volume; draw its whole surface"),
        ([np.zeros((3, 3))], "is 0 m wide"),
        ([face + np.inf for face in CUBE], "has a coordinate that is no number"),
        ([face * 1e12 for face in CUBE], "is 1e.12 m wide, 1e.12 m from the origin"),
    ],
)
def test_surfaces_that_are_no_blocks(faces, message, tmp_path):
    path = write_faces(tmp_path / "stone.obj", faces)
    with pytest.raises(InputError, match=message) as caught:
        blocks_from_file(path)
    assert str(caught.value).startswith(f"'{path}': block 'stone' ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.obj", "", "is empty; save it again"),
        ("a.obj", "v 0 0 0\n", "has no faces; save the blocks as meshes"),
        ("a.obj", "v 0 0 x\n", "is damaged .ValueError: could not convert string to float: 'x'"),
        ("a.obj", "v 0 0 0\nf 1 2 3\n", "is damaged .IndexError"),
        ("a.obj", "v 0 0 0\nf 0 1 1\n", "is damaged"),
        ("a.stl", "solid a\n facet\n", "is no STL file, or its end is missing"),
        ("a.stl", "nonsense", "is no STL file, or its end is missing"),
        ("a.json", "[1, 2", "is damaged .JSONDecodeError: .* line 1 column"),
        ("a.json", "{}", "has no faces"),
        ("a.json", '{"vertex": {"0": {"x": 1}}, "face": {"0": [0, 1, 2]}}', "KeyError: '1'"),
        ("a.json", "[" * 100000, "is damaged .RecursionError"),
        ("a.dxf", "nonsense", "cannot be read: it is no DXF file"),
        ("a.msh", "nonsense", "is damaged"),
        ("a.ply", "ply", "does not exist or is no file of blocks; give one of .json, .obj, .stl"),
    ],
)
def test_files_that_are_none(name, text, message, tmp_path):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        blocks_from_file(path)
    assert str(caught.value).startswith(f"'{path}'")
    assert "\n" not in str(caught.value)


def test_a_folder_without_blocks_and_a_drawing_without_meshes(tmp_path):
    with pytest.raises(InputError, match=r"has no files of blocks; give some of \.json"):
        blocks_from_file(tmp_path)
    document = ezdxf.new(units=6)
    document.modelspace().add_line((0, 0), (1, 1))
    path = tmp_path / "lines.dxf"
    document.saveas(path)
    with pytest.raises(InputError, match="but 1 LINE; turn solids into meshes"):
        blocks_from_file(path)
    document.units = 0
    document.saveas(path)
    with pytest.raises(InputError, match="does not say its unit"):
        blocks_from_file(path)


# Damaged files: a block or one line.


def damaged(data: bytes, dice: random.Random) -> bytes:
    """A file cut off, with other bytes, other numbers, or lines lost, doubled and exchanged."""
    kind = dice.randrange(5)
    if kind == 0:
        return data[: dice.randrange(len(data))]
    if kind == 1:
        flipped = bytearray(data)
        for _ in range(dice.choice([1, 3, 30])):
            flipped[dice.randrange(len(data))] = dice.randrange(256)
        return bytes(flipped)
    if kind == 2:
        wild = [b"nan", b"1e400", b"-1", b"0", b"99999999999999999999", b"", b"null", b"1e9", b"[]"]
        numbers = list(re.finditer(rb"-?\d+(\.\d+)?", data))
        for found in sorted(dice.sample(numbers, min(2, len(numbers))), key=lambda m: -m.start()):
            data = data[: found.start()] + dice.choice(wild) + data[found.end() :]
        return data
    lines = data.splitlines(keepends=True) if b"\n" in data else re.split(rb"(?<=[,}])", data)
    for _ in range(dice.choice([1, 2, 5])):
        k, other = dice.randrange(len(lines)), dice.randrange(len(lines))
        if kind == 3:
            lines[k], lines[other] = lines[other], lines[k]
        else:
            lines[k] = lines[k] * dice.choice([0, 2])
    return b"".join(lines)


@pytest.mark.parametrize("kind", WRITERS)
def test_damaged_files(kind, tmp_path):
    source = tmp_path / f"stack.{kind}"
    WRITERS[kind](source, stack())
    data = source.read_bytes()
    refused = 0
    for seed in range(2 if kind == "msh" else 14):
        path = tmp_path / f"damaged.{kind}"
        path.write_bytes(damaged(data, random.Random(seed)))
        try:
            blocks = blocks_from_file(path)
        except InputError as error:
            refused += 1
            assert str(error).startswith(f"'{path}'"), error
            assert "\n" not in str(error)
            assert len(str(error)) < 500 + len(str(path))
        else:
            assert all(0.0 < block.volume < np.inf for block in blocks)
    assert refused > 0
