"""Random files of blocks with faults, and whether all that they name is read or told.

As a script: `python -m tests.spatial.dirty_files 200` writes and reads so many.
"""

from __future__ import annotations

import json
import random
import re
import struct
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import ezdxf
import numpy as np

from fenics_contact.errors import InputError
from fenics_contact.scene.scene import JointLaw
from fenics_contact.spatial import Material, Scene
from fenics_contact.spatial.readers import read_blocks

SIDES = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
TOP = SIDES[1:2]
#: From x, y, z to x, z, -y: y is up.
TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class Body:
    """What a file has by one name.

    Attributes:
        name: Its name or layer.
        points: Corners of a hexahedron, in the file's unit.
        faces: Loops of corners, none of a body that is empty.
        fixed: Whether the file says that it is a support.
        hidden: Whether its layer is off.
        solid: Whether it is no mesh, in a drawing.
    """

    name: str
    points: np.ndarray
    faces: list = field(default_factory=lambda: list(SIDES))
    fixed: bool = False
    hidden: bool = False
    solid: bool = False


def box(name, low, high, fixed=False):
    plan = ((0, 0), (1, 0), (1, 1), (0, 1))
    points = [np.where([x, y, z], high, low) for z in (0, 1) for x, y in plan]
    return Body(name, np.array(points, dtype=float), fixed=fixed)


def wall(dice):
    """A slab, and courses of stones on it."""
    length, depth, height = dice.uniform(0.3, 0.8), dice.uniform(0.2, 0.5), dice.uniform(0.15, 0.4)
    count = dice.randint(1, 3)
    bodies = [box("slab", [-1, -1, -0.4], [count * length + 1, depth + 1, 0], fixed=True)]
    for course in range(dice.randint(1, 3)):
        for k in range(count):
            low = np.array([(k + 0.3 * (course % 2)) * length, 0, course * height])
            bodies.append(box(f"s{course}{k}", low, np.add(low, [length, depth, height])))
    return bodies


# Writers: each gives every body its name.


def rows(points):
    return [" ".join(repr(float(x)) for x in p) for p in points]


def write_obj(path, bodies, dice):
    lines, count = [], 1
    for body in bodies:
        lines += [f"{dice.choice('og') if len(bodies) == 1 else 'o'} {body.name}"]
        lines += [f"v {row}" for row in rows(body.points)]
        lines += ["f " + " ".join(str(count + k) for k in loop) for loop in body.faces]
        count += len(body.points)
    path.write_text("\n".join(lines) + "\n")


def triangles(body):
    return [body.points[[f[0], f[k], f[k + 1]]] for f in body.faces for k in range(1, len(f) - 1)]


def write_stl(path, bodies, dice):
    text = ""
    for body in bodies:
        facets = ("\n".join(f"vertex {row}" for row in rows(t)) for t in triangles(body))
        inner = "".join(f"facet normal 0 0 0\nouter loop\n{f}\nendloop\nendfacet\n" for f in facets)
        text += f"solid {body.name}\n{inner}endsolid {body.name}\n"
    path.write_text(text)


def write_binary(path, bodies, dice):
    facets = [t for body in bodies for t in triangles(body)]
    data = b"binary".ljust(80) + struct.pack("<I", len(facets))
    path.write_bytes(data + b"".join(struct.pack("<12fH", 0, 0, 0, *t.ravel(), 0) for t in facets))


def mesh(body):
    points = {str(k): dict(zip("xyz", p, strict=True)) for k, p in enumerate(body.points.tolist())}
    faces = {str(k): list(loop) for k, loop in enumerate(body.faces)}
    return {"attributes": {"name": body.name}, "vertex": points, "face": faces}


def write_beside(path, bodies, dice):
    """As before COMPAS 1.0: a network says which blocks are supports."""
    kind = dice.choice(["vertex", "node"])
    nodes = {str(k): {"x": 0.0, "is_support": body.fixed} for k, body in enumerate(bodies)}
    network = {kind: nodes, **({"edge": {}} if dice.random() < 0.5 else {})}
    blocks = {str(k): mesh(body) for k, body in enumerate(bodies)}
    path.write_text(json.dumps({"blocks": blocks, "assembly": network}))


def placed(body, dice, inner, outer):
    """A table of a body in its own frame, of the version of COMPAS before or after 2."""
    turn = np.linalg.qr(np.array([[dice.gauss(0, 1) for _ in range(3)] for _ in range(3)]))[0]
    turn[:, 2] = np.cross(turn[:, 0], turn[:, 1])
    point = np.array([dice.uniform(-1, 1) for _ in range(3)])
    local = replace(body, points=(body.points - point) @ turn)
    frame = {"point": point.tolist(), "xaxis": turn[:, 0].tolist(), "yaxis": turn[:, 1].tolist()}
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = turn, point
    place = {
        0: {},
        1: {"frame": {"dtype": "compas.geometry/Frame", inner: frame}},
        2: {"transformation": {"dtype": "compas.geometry/Transformation"}},
    }[outer]
    if outer == 2:
        place["transformation"][inner] = {"matrix": moved.tolist()}
    return place, mesh(local if outer else body)


def write_model(path, bodies, dice):
    """As compas_model: elements, some with a place of their own; as in COMPAS 1 or 2."""
    inner = dice.choice(["value", "data"])
    elements = {}
    for k, body in enumerate(bodies):
        place, table = placed(body, dice, inner, dice.choice([0, 1, 2]))
        item = {"name": body.name, "is_support": body.fixed, **place, "geometry": {inner: table}}
        elements[f"guid-{k}"] = {"dtype": "compas_model.elements/BlockElement", inner: item}
    tree = {"root": {"children": [{"element": key} for key in elements]}}
    table = {"elements": elements, "tree": tree}
    path.write_text(json.dumps({"dtype": "compas_model.models/Model", inner: table}))


def write_graph(path, bodies, dice):
    nodes = {
        str(k): {"block": {"dtype": "a/Block", "data": mesh(b)}, "is_support": b.fixed}
        for k, b in enumerate(bodies)
    }
    path.write_text(json.dumps({"data": {"graph": {"data": {"node": nodes, "edge": {}}}}}))


def write_dxf(path, bodies, dice):
    document = ezdxf.new(units=6)
    space = document.modelspace()
    for body in bodies:
        layer = document.layers.add(body.name)
        if body.hidden:
            layer.off()
        named = {"layer": body.name}
        if body.solid and dice.random() < 0.5:
            space.add_lwpolyline(body.points[:4, :2], dxfattribs={"thickness": 0.3, **named})
        elif body.solid:
            space.add_3dsolid(dxfattribs=named)
        elif dice.random() < 0.5 and body.faces and not body.hidden:
            for loop in body.faces:
                space.add_3dface(body.points[list(loop)], dxfattribs=named)
        else:
            with space.add_mesh(dxfattribs=named).edit_data() as data:
                data.vertices = [tuple(p) for p in body.points.tolist()]
                data.faces = [list(loop) for loop in body.faces]
    document.saveas(path)


def write_msh(path, bodies, dice):
    names = [f'3 {k} "{body.name}"' for k, body in enumerate(bodies, 1)]
    nodes = [row for body in bodies for row in rows(body.points)]
    full = [k for k, body in enumerate(bodies, 1) if body.faces]
    cells = [
        f"{n} 5 2 {k} {k} " + " ".join(str(8 * (k - 1) + j) for j in range(1, 9))
        for n, k in enumerate(full, 1)
    ]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names)), *names]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(nodes))]
    lines += [f"{k} {row}" for k, row in enumerate(nodes, 1)]
    lines += ["$EndNodes", "$Elements", str(len(cells)), *cells, "$EndElements"]
    path.write_text("\n".join(lines) + "\n")


def write_folder(path, bodies, dice):
    path.mkdir()
    for body in bodies:
        write_obj(path / f"{body.name}.obj", [body], dice)
    (path / "settings.json").write_text('{"mu": 0.5}')


WRITERS = {
    "beside.json": write_beside,
    "model.json": write_model,
    "graph.json": write_graph,
    "obj": write_obj,
    "stl": write_stl,
    "binary.stl": write_binary,
    "dxf": write_dxf,
    "folder": write_folder,
    "msh": write_msh,
}
FAULTS = ("none gap overlap open twice empty mm up same far plate hidden solid").split()


def dirty(bodies, fault, kind, dice):
    """Bodies with a fault, and whether a reader may refuse them; None where a file has none."""
    k = dice.randrange(1, len(bodies))
    body = bodies[k]
    change = dice.uniform(1e-5, 0.02) * (1 if fault == "gap" else -1)
    binary = kind == "binary.stl"
    if fault in ("gap", "overlap"):
        bodies[k] = replace(body, points=np.add(body.points, [0, 0, change]))
    elif fault == "open" and kind != "msh":
        bodies[k] = replace(body, faces=body.faces[: dice.randint(1, 5)])
    elif fault == "twice" and not binary and kind != "msh":
        bodies[k] = replace(body, faces=2 * body.faces)
    elif fault == "empty" and not binary:
        bodies[k] = replace(body, faces=[])
    elif fault == "same" and not binary and kind != "folder":
        bodies.append(replace(body, name=dice.choice(["copy", "Z", body.name])))
    elif fault in ("mm", "up", "far", "none"):
        shift = 10.0 ** dice.uniform(2.0, 6.6) if fault == "far" else 0.0
        scale = 1e3 if fault == "mm" else 1.0
        turn = TURN if fault == "up" else np.eye(3)
        bodies[:] = [replace(b, points=scale * (b.points @ turn.T) + shift) for b in bodies]
    elif fault == "plate" and not binary and kind != "msh":
        bodies[0] = replace(bodies[0], faces=TOP)
    elif fault in ("hidden", "solid") and kind == "dxf":
        bodies[k] = replace(body, **{fault: True})
    else:
        return None
    return fault in ("open", "empty", "solid") or (binary and fault == "far")


def lost(seed, folder):
    """Kind of file, fault, outcome, and what was lost without a word; empty if nothing was."""
    dice = random.Random(seed)
    kind = [*WRITERS][seed % 8] if seed % 40 else "msh"  # gmsh takes a second
    bodies = wall(dice)
    clean = {body.name for body in bodies}
    may_refuse = None
    while may_refuse is None:
        fault = dice.choice(FAULTS[-2:] if kind == "dxf" and dice.random() < 0.4 else FAULTS)
        may_refuse = dirty(bodies, fault, kind, dice)
    path = folder / f"{seed}.{kind}"
    WRITERS[kind](path, bodies, dice)
    try:
        found = read_blocks(path)
    except InputError as error:
        named = any(
            f"'{name}" in str(error) for name in {body.name for body in bodies} | {path.stem}
        )
        wrong = "" if may_refuse and named else f"refused: {error}"
        return kind, fault, "refused", wrong
    blocks, notes = found.blocks, found.notes
    told = sum(int(n) for text in notes for n in re.findall(r"(\d+) on layer '", text))
    told += fault == "same" and any("written again" in text for text in notes)
    wrong = []
    if len(blocks) + told != len(bodies):
        wrong.append(f"{len(bodies)} in the file, {len(blocks)} read, {told} told")
    if kind.endswith("json") or fault == "plate":
        supports = sum(body.fixed for body in bodies)
        fixed = sum(block.fixed for block in blocks)
        if fixed != supports:
            wrong.append(f"{supports} supports in the file, {fixed} read")
    shown = [body for body in bodies if not body.hidden and len(body.faces) > 1]
    middles = np.array([body.points.mean(axis=0) for body in shown])
    for block in blocks:
        size = np.ptp(block.extent, axis=0).max()
        near = np.abs(middles - block.centroid).max(axis=1).min() if len(middles) else 0.0
        if near > 1e-4 * size and not (fault == "plate" and block.fixed):
            wrong.append(f"block '{block.name}' is elsewhere")
    if fault in ("twice", "hidden", "plate") and not notes:
        wrong.append("no word of what was left out")
    if fault == "mm" and not unit_is_told(found):
        wrong.append("no word of the unit")
    if fault == "none" and notes and kind != "folder":
        wrong.append(f"a clean file is told of: {notes}")
    assert clean <= {body.name for body in bodies}
    return kind, fault, "read", "; ".join(wrong)


def unit_is_told(found):
    fixed = [replace(b, fixed=b.name.startswith("slab")) for b in found.blocks]
    laws = {
        "materials": {"default": Material(density=2000.0)},
        "joints": {"default": JointLaw(friction=0.6)},
    }
    scene = Scene(blocks=tuple(fixed), **laws)
    return any("blocks.unit" in text for text in scene.structure().warnings)


def main(count):
    outcomes: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(count):
            kind, fault, outcome, wrong = lost(seed, Path(folder))
            outcomes[outcome, "lost" if wrong else "all read or told"] += 1
            if wrong:
                print(f"{seed} {kind} {fault}: {wrong}")
    print(f"{count} files:", ", ".join(f"{n} {a}, {b}" for (a, b), n in outcomes.items()))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
