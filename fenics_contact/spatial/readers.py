"""Blocks from files of other programs: COMPAS, OBJ, STL, DXF and gmsh.

Formats: COMPAS, `compas.data` (compas.dev); Wavefront, Advanced Visualizer manual, appendix B1; 3D
Systems, StereoLithography interface specification; Autodesk, DXF reference; gmsh's reference
manual, "MSH file format".
"""

from __future__ import annotations

import json
import logging
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import reduce
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import InputError, checked, require
from fenics_contact.geometry.dxf.reader import UNITS, visible_entities
from fenics_contact.geometry.gmsh_mesh import read_volumes
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.bounds import counted
from fenics_contact.scene.rules import listed
from fenics_contact.spatial.polyhedra import Block, ReadBlocks
from fenics_contact.spatial.surfaces import Surface, blocks_of, ground_of, is_flat

_log = logging.getLogger(__name__)

#: Faces in a file; 2 000 blocks have less than a tenth of them.
MOST_FACES = 500_000
#: Attributes that make a block of COMPAS ground.
GROUND = ("is_support", "is_fixed")
#: Keys that `_joined` adds: it is a body; the place of what it is in; which elements are held.
NAMED, PARENTS, HELD = "(named)", "(parents)", "(held)"
#: What of a COMPAS file is no block: defaults, contacts and their surfaces, hulls.
NO_BLOCKS = set(
    "dva dna dea default_node_attributes node_attributes edge_attributes edge edgedata interface"
    " interfaces interactions contacts features aabb obb collision_mesh geometry_simplified"
    " boundary_conditions contact_properties materials frame transformation".split()
)
#: What COMPAS wraps the contents of a table in, and what networks have beside vertices.
WRAPPINGS = ("data", "value", "attributes")
NETWORK = {"edge", "halfedge", "adjacency"}
#: Types of COMPAS that are bodies, with faces or without.
BODIES = set(
    "Block BlockElement Part Mesh VolMesh Polyhedron Brep OCCBrep RhinoBrep Box Sphere Cylinder"
    " Cone Capsule Torus".split()
)
#: Names that COMPAS gives by itself.
OF_TYPES = {"Assembly", "Block", "BlockElement", "BlockModel", "Box", "Graph", "Mesh", "Model"}
#: Bodies of a DXF file that are no meshes, and what of an OBJ file is no face.
SOLIDS = re.compile("3DSOLID|BODY|.*SURFACE")
NO_FACES = {"l", "p", "curv", "curv2", "surf"}


def blocks_from_file(path: str | Path, unit: str | None = None) -> tuple[Block, ...]:
    """Blocks of `read_blocks`; its notes are logged as warnings."""
    found = read_blocks(path, unit)
    for text in found.notes:
        _log.warning("warning: %s", text)
    return found.blocks


@checked
def read_blocks(path: str | Path, unit: str | None = None) -> ReadBlocks:
    """Blocks that a file describes, or all files of a folder.

    Args:
        path: A COMPAS assembly or model (.json), .obj, .stl, .dxf or .msh, or a folder of them; a
            file of one block in a folder gives it its name.
        unit: Unit of the coordinates, one of `UNITS`; by default that of a DXF file, else m.

    Raises:
        InputError: If a file cannot be read or a block is none; the message names both.
    """
    require(unit is None or unit in UNITS, f"unit = '{unit}' must be one of {', '.join(UNITS)}")
    files, others = _files(Path(path))
    blocks: list[Block] = []
    flat = []
    notes = []
    lost = named = 0
    for file in files:
        source = f"'{file}'"
        left_out = Counter[str]()
        surfaces = _surfaces(file, unit, left_out)
        if len(files) > 1 and not surfaces and file.suffix.lower() == ".json":
            others.append(file.name)  # settings beside the blocks
            continue
        require(bool(surfaces), f"{source} has no faces; save the blocks as meshes")
        if Path(path).is_dir() and len(surfaces) == 1:
            surfaces = [replace(surfaces[0], name=file.stem)]
        flat += [(surface, source) for surface in surfaces if is_flat(surface)]
        for surface in surfaces:
            blocks += [] if is_flat(surface) else blocks_of(surface, source, left_out)
        named += len(surfaces)
        lost += left_out.total()
        if +left_out:
            listing = ", ".join(f"{n} {what}" for what, n in (+left_out).items())
            notes.append(f"{source}: left out: {listing}")
    if others:
        names = listed(others[:6]) + (", ..." if len(others) > 6 else "")
        notes.append(f"folder '{path}': left out: {counted(len(others), 'file')} ({names})")
    blocks += [ground_of(surface, blocks, source) for surface, source in flat]
    notes += [f"{source}: '{s.name}' is one face that blocks lie on: ground" for s, source in flat]
    uses = Counter(block.name for block in blocks)
    numbers: dict[str, Iterator[int]] = defaultdict(lambda: count(1))
    unique = tuple(
        replace(b, name=f"{b.name} {next(numbers[b.name])}") if uses[b.name] > 1 else b
        for b in blocks
    )
    read = f"{named} named, {len(blocks)} read, {lost + len(others)} left out"
    return ReadBlocks(unique, f"'{path}': {read}", tuple(notes))


def _files(path: Path) -> tuple[list[Path], list[str]]:
    """A file of blocks, or those of a folder; and names of the other files there."""
    kinds = ", ".join(READERS)
    if not path.is_dir():
        known = path.is_file() and path.suffix.lower() in READERS
        require(known, f"'{path}' does not exist or is no file of blocks; give one of {kinds}")
        return [path], []
    every = sorted(file for file in path.iterdir() if not file.name.startswith("."))
    files = [file for file in every if file.is_file() and file.suffix.lower() in READERS]
    require(bool(files), f"folder '{path}' has no files of blocks; give some of {kinds}")
    return files, [file.name for file in every if file not in files]


def _surfaces(path: Path, unit: str | None, left_out: Counter[str]) -> list[Surface]:
    """Surfaces of a file, in m."""
    source = f"'{path}'"
    try:
        require(path.stat().st_size > 0, f"{source} is empty; save it again")
        scale = 1.0 if path.suffix.lower() == ".dxf" else UNITS[unit or "m"]
        surfaces = [
            replace(
                s,
                faces=[scale * np.array(f, float).reshape(len(f), 3) for f in s.faces],
                rounding=scale * s.rounding,
                cells=None if s.cells is None else scale * s.cells,
            )
            for s in READERS[path.suffix.lower()](path, unit, left_out)
        ]
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(source) else f"{source}: {text}") from None
    except OSError as error:
        raise InputError(f"{source} cannot be read: {error.strerror or error}") from None
    except Exception as error:  # damaged contents fail anywhere
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InputError(f"{source} is damaged ({reason}); save it again") from None
    faces = sum(len(surface.faces) for surface in surfaces)
    require(faces <= MOST_FACES, f"{source} has {faces} faces; at most {MOST_FACES} are read")
    empty = [surface.name for surface in surfaces if not surface.faces]
    more = f" (and {len(empty) - 1} more: {listed(empty[1:6])})" if empty[1:] else ""
    text = f"block {listed(empty[:1])}{more} has no faces; delete it, or draw its surface"
    require(not empty, f"{source}: {text}")
    return surfaces


def _compas(path: Path, _: str | None, left_out: Counter[str]) -> Iterator[Surface]:
    """Meshes of an assembly or model of COMPAS, but for those of contacts."""
    data = json.loads(path.read_bytes().decode("utf-8-sig"), object_pairs_hook=_once)
    surfaces = list(_meshes(data, Surface(path.stem, []), [], left_out))
    lost = _says_support(data) and not any(surface.fixed for surface in surfaces)
    text = "something is_support, and no block became ground; give is_support to the blocks"
    require(not lost, text)
    yield from surfaces


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A table of a JSON file.

    Raises:
        InputError: If a key is there twice: one would be lost.
    """
    twice = [key for key, uses in Counter(key for key, _ in pairs).items() if uses > 1]
    require(not twice, f"one table has {listed(twice[:6])} twice; rename one")
    return dict(pairs)


def _says_support(data: Any) -> bool:
    """Whether a table, or one inside it, says that it is ground."""
    if isinstance(data, dict) and any(data.get(key) is True for key in GROUND):
        return True
    inside = data.values() if isinstance(data, dict) else data if isinstance(data, list) else ()
    return any(_says_support(item) for item in inside)


def _unwrapped(data: Any) -> dict[str, Any]:
    """A table with what its wrappings hold; an empty one of what is no table."""
    table = dict(data) if isinstance(data, dict) else {}
    while inner := [key for key in WRAPPINGS if isinstance(table.get(key), dict)]:
        more = table.pop(inner[0])
        table |= {key: item for key, item in more.items() if item is not None}
    return table


def _meshes(
    data: Any, around: Surface, within: list[dict[str, Any]], left_out: Counter[str]
) -> Iterator[Surface]:
    """Meshes in a table, with what the tables around them say of name, group, support, place.

    Bodies without a mesh are surfaces without faces.

    Args:
        data: A table of the file, or a list of them.
        around: Name, group and support of what is around it.
        within: Tables around it, which may have places.
        left_out: Takes what is not read.
    """
    if isinstance(data, list):
        for item in data:
            yield from _meshes(item, around, within, left_out)
    if not isinstance(data, dict):
        return
    table = _unwrapped(data)
    if isinstance(table.get("node"), dict):  # a network, whatever else is there
        table = {key: table[key] for key in ("name", "node", "blocks", "elements") if key in table}
    table = _joined(table, left_out)
    name = table.get("name")
    around = Surface(
        str(name) if name and name not in OF_TYPES else around.name,
        [],
        str(table.get("group") or around.group),
        around.fixed or any(bool(table.get(key)) for key in GROUND),
    )
    within = [*within, table]
    corners = table.get("vertex", table.get("vertices"))
    faces = table.get("face", table.get("faces"))
    if corners and faces:
        mesh = _mesh(corners, faces)
        matrix = reduce(np.matmul, map(_place, within))
        yield replace(around, faces=[face @ matrix[:3, :3].T + matrix[:3, 3] for face in mesh])
        return
    kind = str(table.get("dtype", table.get("datatype"))).rpartition("/")[2]
    body = NAMED in table or kind in BODIES or faces is not None
    body = body or (corners is not None and not NETWORK & set(table))
    for key, item in table.items():
        if key not in NO_BLOCKS:
            inside = replace(around, name=key) if key.isdecimal() else around
            for found in _meshes(item, inside, within, left_out):
                body = False
                yield found
    if body:
        yield around


def _joined(table: dict[str, Any], left_out: Counter[str]) -> dict[str, Any]:
    """A table whose blocks have what tables beside them say of them by key.

    The network of COMPAS before 1.0 says which are supports, the boundary conditions of a problem
    which are held, the tree of a model what elements are in.
    """
    left_out["contact_properties"] += "contact_properties" in table
    left_out["materials"] += len(table.get("materials") or ())
    held = table.pop(HELD, [])
    if "boundary_conditions" in table:
        model = _unwrapped(table["model"])
        node = _unwrapped(model["graph"])["node"]
        numbers = _held(_unwrapped(table["boundary_conditions"]), left_out)
        table["model"] = model | {HELD: [node[key]["element"] for key in numbers]}
    for key, item in {"": table, **table}.items() if "blocks" in table else ():
        network = _unwrapped(item)
        nodes = network.get("node", network.get("vertex"))
        if isinstance(nodes, dict) and not {"face", "faces"} & set(network):
            held += [k for k, node in nodes.items() if _says_support(node)]
            if key and any(GROUND[0] in _unwrapped(node) for node in nodes.values()):
                table[key] = None if "vertex" in network else item
    for kind in ("block", "blocks", "elements"):
        bodies = {"": table[kind]} if kind == "block" and kind in table else table.get(kind)
        if isinstance(bodies, list):
            keys = [str(_unwrapped(item).get("guid", k)) for k, item in enumerate(bodies)]
            bodies = _once(list(zip(keys, bodies, strict=True)))
        if not isinstance(bodies, dict):
            continue
        lost = [key for key in held if key not in bodies]
        require(not lost, f"there are no blocks of the supports {listed(lost[:6])}")
        places: dict[str, Array] = {}
        groups = _nested(_unwrapped(table.get("tree")).get("root"), bodies, np.eye(4), places)
        table[kind] = {
            key: {
                "value": item,
                "is_fixed": key in held,
                PARENTS: places.get(key, np.eye(4)),
                **({} if key in groups else {NAMED: True}),
            }
            for key, item in bodies.items()
        }
    return table


def _held(conditions: dict[str, Any], left_out: Counter[str]) -> list[str]:
    """Numbers of the blocks that a problem of compas_dem holds; what else it says is left out."""
    moved: dict[str, dict[str, Any]] = defaultdict(dict)
    for item in conditions.pop("displacements", ()):
        moved[str(item["block_index"])] |= {key: at for key, at in item.items() if at is not None}
    still = [0.0, 0.0, 0.0]
    held = [k for k, at in moved.items() if at.get("translation") == at.get("rotation") == still]
    left_out["displacements that are no supports"] += len(moved) - len(held)
    for key, load in conditions.items():
        if key == "gravity" or isinstance(load, list):
            left_out[key] += len(load) if isinstance(load, list) else bool(load)
    return held


def _nested(
    node: Any, elements: dict[str, Any], matrix: Array, places: dict[str, Array]
) -> set[str]:
    """Elements of a tree that have others in them; places get the matrix around every one."""
    node = _unwrapped(node)
    key = str(node.get("element"))
    places[key] = matrix
    matrix = matrix @ _place(_unwrapped(elements.get(key)))
    children = node.get("children") or ()
    inside = [_nested(child, elements, matrix, places) for child in children]
    return ({key} if children else set()).union(*inside)


def _place(table: dict[str, Any]) -> Array:
    """From the coordinates of a table to those around it: by its frame after its transformation.

    Shape (4, 4).
    """
    matrix = np.array(table.get(PARENTS, np.eye(4)))
    if table.get("frame"):
        frame = _unwrapped(table["frame"])
        point, x, y = (np.array(_contents(frame[k]), float) for k in ("point", "xaxis", "yaxis"))
        z = np.cross(x, y)
        axes = [axis / np.linalg.norm(axis) for axis in (x, np.cross(z, x), z)]
        matrix = matrix @ np.vstack([np.column_stack([*axes, point]), [0.0, 0.0, 0.0, 1.0]])
    if table.get("transformation"):
        given = table["transformation"]
        moved = np.array(given if isinstance(given, list) else _unwrapped(given)["matrix"], float)
        text = "a transformation has a matrix that is not of a motion in space; give [0, 0, 0, 1]"
        require(moved.shape == (4, 4) and np.array_equal(moved[3], [0, 0, 0, 1]), text)
        matrix = matrix @ moved
    return matrix


def _contents(item: Any) -> Any:
    """What is inside the wrapping that says its type."""
    return item.get("data", item.get("value", item)) if isinstance(item, dict) else item


def _mesh(corners: Any, faces: Any) -> list[Array]:
    """Faces of a mesh: tables or lists of its vertices and faces."""
    if not isinstance(corners, dict):
        corners = {k: dict(zip("xyz", _contents(v), strict=True)) for k, v in enumerate(corners)}
    number = {str(key): k for k, key in enumerate(corners)}
    points = np.array([[v.get(axis, 0.0) for axis in "xyz"] for v in corners.values()], float)
    loops = faces.values() if isinstance(faces, dict) else faces
    return [points[[number[str(key)] for key in loop]] for loop in loops]


def _obj(path: Path, _: str | None, left_out: Counter[str]) -> Iterator[Surface]:
    """Objects of an OBJ file, or groups if it has none; a block's group is that of its material."""
    text = path.read_text("utf-8-sig", "replace").replace("\\\n", " ")
    lines = [line.split() or [""] for line in text.splitlines()]
    begins = "o" if any(words[0] == "o" for words in lines) else "g"
    points: list[Any] = [None]  # they count from 1
    surfaces: dict[str, Surface] = {}
    groups: dict[str, bool] = {}  # whether they have faces, or name nothing
    name, group = path.stem, "default"
    for key, *words in lines:
        if key == "v":
            points.append([float(word) for word in words[:3]])
        elif key == begins:
            name = " ".join(words) or path.stem
            if words and (key, name) != ("g", "default"):
                surfaces.setdefault(name, Surface(name, []))
        elif key in ("g", "usemtl"):
            group = " ".join(words) or "default"
            groups.setdefault(group, key == "usemtl" or group == "default")
        elif key == "f":
            corners = [points[int(word.split("/")[0])] for word in words]
            if not surfaces.setdefault(name, Surface(name, [])).faces:
                surfaces[name] = Surface(name, [], group)
            surfaces[name].faces.append(corners)
            groups[group] = True
        elif key in NO_FACES:
            left_out[f"'{key}' that are no faces"] += 1
    left_out["groups without faces"] += list(groups.values()).count(False)
    yield from surfaces.values()


def _stl(path: Path, _: str | None, left_out: Counter[str]) -> Iterator[Surface]:
    """Solids of an STL file, binary or text."""
    data = path.read_bytes()
    if len(data) > 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        facets = np.frombuffer(data, record, offset=84)["corners"]
        yield Surface(path.stem, list(facets), rounding=float(np.spacing(np.abs(facets).max())))
        return
    lines = data.decode("utf-8", "replace").strip().splitlines()
    ended = lines[-1].lower().split()[:1] == ["endsolid"]
    require(ended, f"'{path}' is no STL file, or its end is missing; save it again")
    solids: list[tuple[str, list[Any]]] = []
    for line in lines:
        key, *words = line.split() or [""]
        if key.lower() == "solid":
            solids.append((" ".join(words) or path.stem, []))
        elif key.lower() == "vertex":
            solids[-1][1].append([float(word) for word in words])
    for name, corners in solids:
        require(len(corners) % 3 == 0, f"solid '{name}' has a facet without three corners")
        yield Surface(name, [corners[k : k + 3] for k in range(0, len(corners), 3)])


def _dxf(path: Path, unit: str | None, left_out: Counter[str]) -> Iterator[Surface]:
    """3DFACE, MESH and polyface mesh entities of a DXF file, in m; a layer is a group."""
    surfaces: list[Surface] = []
    drawn: dict[str, Surface] = {}
    others = Counter[str]()
    with visible_entities(path, unit) as (entities, known, said):
        from ezdxf.render import MeshBuilder

        readers = {"MESH": MeshBuilder.from_mesh, "POLYLINE": MeshBuilder.from_polyface}
        for entity, layer in entities.visible():
            kind = entity.dxftype()
            is_mesh = kind == "MESH" or (kind == "POLYLINE" and "Mesh" in entity.get_mode())
            thick = entity.dxf.is_supported("thickness") and entity.dxf.get("thickness", 0.0)
            if kind == "3DFACE":
                drawn.setdefault(layer, Surface(layer, [], layer))
                drawn[layer].faces.append(UNITS[known] * np.array(entity.wcs_vertices()))
            elif is_mesh:
                mesh = readers[kind](entity)
                points = UNITS[known] * np.array(mesh.vertices)
                surfaces.append(Surface(layer, [points[[*face]] for face in mesh.faces], layer))
            elif SOLIDS.fullmatch(kind) or thick:
                surfaces.append(Surface(f"{layer} ({kind})", [], layer))
            else:
                others[kind] += 1
                left_out[f"{kind} on layer '{layer}'"] += 1
    left_out += entities.left_out
    left_out += Counter(f"part that is damaged: {text}" for text in dict.fromkeys(said))
    listing = ", ".join(f"{n} {kind}" for kind, n in others.items()) or "nothing"
    text = "has no 3DFACE, MESH or polyface mesh on a visible layer"
    require(bool(surfaces or drawn), f"'{path}' {text}, but {listing}; turn solids into meshes")
    yield from (*surfaces, *drawn.values())


def _msh(path: Path, _: str | None, left_out: Counter[str]) -> Iterator[Surface]:
    """Volumes of a gmsh file; the group is the name of the first physical volume."""
    volumes, tags, coordinates = read_volumes(path)
    place = dict(zip(tags.tolist(), coordinates, strict=True))
    used = set()
    for tag, groups, loops, tetrahedra in volumes:
        used.update(groups)
        faces = [np.array([place[node] for node in loop]) for loop in loops]
        group = groups[0] if groups else ""
        cells = None
        if tetrahedra is not None:
            cells = np.array([[place[node] for node in cell] for cell in tetrahedra.tolist()])
        yield Surface(f"{group or 'volume'} {tag}", faces, group or "default", cells=cells)
    head = path.read_bytes().partition(b"$PhysicalNames")[2].partition(b"$EndPhysicalNames")[0]
    for dimension, name in re.findall(
        r'^\s*(\d) +\d+ +"(.*)"', head.decode(errors="replace"), re.M
    ):
        if dimension == "3" and name not in used:
            yield Surface(name, [])
        elif dimension != "3":
            left_out["physical groups that are no volumes"] += 1


#: What reads a kind of file.
READERS: dict[str, Callable[[Path, str | None, Counter[str]], Iterator[Surface]]] = {
    ".json": _compas,
    ".obj": _obj,
    ".stl": _stl,
    ".dxf": _dxf,
    ".msh": _msh,
}
