"""Blocks from files of other programs: COMPAS, OBJ, STL, DXF and gmsh.

Formats: COMPAS, `compas.data` (compas.dev); Wavefront, Advanced Visualizer manual, appendix B1; 3D
Systems, StereoLithography interface specification; Autodesk, DXF reference; gmsh's reference
manual, "MSH file format".
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import InputError, checked, require
from fenics_contact.geometry.dxf.reader import UNITS, visible_entities
from fenics_contact.geometry.gmsh_mesh import read_volumes
from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.polyhedra import Block
from fenics_contact.spatial.surfaces import Surface, blocks_of

#: Bytes of a file, and faces in it; 2 000 blocks have less than a tenth of them.
LARGEST_FILE = 200_000_000
MOST_FACES = 500_000
#: Attributes that make a block of COMPAS ground.
GROUND = ("is_support", "is_fixed")
#: What of a COMPAS file is no block: contacts and their surfaces.
NO_BLOCKS = {"edge", "edgedata", "interface", "interfaces", "interactions", "contacts", "features"}
#: Names that COMPAS gives by itself.
OF_TYPES = {"Assembly", "Block", "BlockElement", "BlockModel", "Box", "Graph", "Mesh", "Model"}
#: What damaged contents raise.
DAMAGED = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)


@checked
def blocks_from_file(path: str | Path, unit: str | None = None) -> tuple[Block, ...]:
    """Blocks that a file describes, or all files of a folder.

    Args:
        path: A COMPAS assembly or model (.json), .obj, .stl, .dxf or .msh, or a folder of them; a
            file of one block in a folder gives it its name.
        unit: Unit of the coordinates, one of `UNITS`; by default that of a DXF file, else m.

    Raises:
        InputError: If a file cannot be read or a block is none; the message names both.
    """
    require(unit is None or unit in UNITS, f"unit = '{unit}' must be one of {', '.join(UNITS)}")
    kinds = ", ".join(READERS)
    path = Path(path)
    files = [path]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in READERS)
        require(bool(files), f"folder '{path}' has no files of blocks; give some of {kinds}")
    blocks = []
    for file in files:
        text = "does not exist or is no file of blocks"
        known = file.is_file() and file.suffix.lower() in READERS
        require(known, f"'{file}' {text}; give one of {kinds}")
        surfaces = _surfaces(file, unit)
        for surface in surfaces:
            only = path.is_dir() and len(surfaces) == 1
            name = file.stem if only else surface.name
            blocks += blocks_of(replace(surface, name=name), f"'{file}'")
    uses = Counter(block.name for block in blocks)
    numbers = Counter[str]()
    for k, block in enumerate(blocks):
        if uses[block.name] > 1:
            numbers[block.name] += 1
            blocks[k] = replace(block, name=f"{block.name} {numbers[block.name]}")
    return tuple(blocks)


def _surfaces(path: Path, unit: str | None) -> list[Surface]:
    """Surfaces of a file, in m."""
    source = f"'{path}'"
    try:
        size = path.stat().st_size
        text = f"{source} has {size} bytes; a file of blocks has at most {LARGEST_FILE}"
        require(0 < size <= LARGEST_FILE, text if size else f"{source} is empty; save it again")
        with np.errstate(all="ignore"):
            surfaces = list(READERS[path.suffix.lower()](path, unit))
    except OSError as error:
        raise InputError(f"{source} cannot be read: {error.strerror or error}") from None
    except DAMAGED as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InputError(f"{source} is damaged ({reason}); save it again") from None
    count = sum(len(surface.loops) for surface in surfaces)
    require(count > 0, f"{source} has no faces; save the blocks as meshes")
    require(count <= MOST_FACES, f"{source} has {count} faces; at most {MOST_FACES} are read")
    scale = 1.0 if path.suffix.lower() == ".dxf" else UNITS[unit or "m"]
    return [replace(surface, points=surface.points * scale) for surface in surfaces]


def _surface(name: str, faces: Any, group: str = "default") -> Surface:
    """A surface of faces that are given by their corners."""
    ends = np.cumsum([0, *map(len, faces)]).tolist()
    points = np.array([corner for face in faces for corner in face], dtype=float)
    return Surface(name, points, [range(start, end) for start, end in pairwise(ends)], group)


def _compas(path: Path, _: str | None) -> Iterator[Surface]:
    """Meshes of an assembly or model of COMPAS 0.x, 1.x and 2.x, but for those of contacts."""
    data = json.loads(path.read_bytes().decode("utf-8-sig"))
    if isinstance(data, dict) and "assembly" in data:  # supports are beside the blocks
        assembly = data["assembly"]
        for key, node in (assembly.get("node") or assembly["vertex"]).items():
            data["blocks"][key] |= {name: node.get(name) for name in GROUND}
    yield from _meshes(data, path.stem, "default", False, np.eye(4))


def _meshes(data: Any, name: str, group: str, fixed: bool, matrix: Array) -> Iterator[Surface]:
    """Meshes in a table, with what the tables around them say of name, group, support, place."""
    if isinstance(data, list):
        for item in data:
            yield from _meshes(item, name, group, fixed, matrix)
    if not isinstance(data, dict):
        return
    for table in (data.get("attributes"), data):
        if isinstance(table, dict):
            given = table.get("name")
            name = given if given and given not in OF_TYPES else name
            group = table.get("group") or group
            fixed = fixed or any(bool(table.get(key)) for key in GROUND)
    matrix = matrix @ data.get("parents", np.eye(4)) @ _matrix(data)
    corners = data.get("vertex", data.get("vertices"))
    faces = data.get("face", data.get("faces"))
    if corners and faces:
        yield _mesh(corners, faces, Surface(str(name), matrix, (), str(group), fixed))
        return
    if "tree" in data and "elements" in data:
        items = data["elements"]
        items = items.values() if isinstance(items, dict) else items
        _tell_parents({item["guid"]: item for item in items}, data["tree"]["root"], np.eye(4))
    for key, item in data.items():
        if key not in NO_BLOCKS:
            yield from _meshes(item, key if key.isdecimal() else name, group, fixed, matrix)


def _tell_parents(elements: dict[str, Any], node: Any, matrix: Array) -> None:
    """Give elements of a model the place of what holds them in its tree."""
    for child in node.get("children") or ():
        element = elements.get(child.get("element"), {"data": {}})
        element["parents"] = matrix
        _tell_parents(elements, child, matrix @ _matrix(element["data"]))


def _matrix(table: dict[str, Any]) -> Array:
    """What the frame and the transformation of a table do with its contents, shape (4, 4)."""
    matrix = np.eye(4)
    frame = _contents(table.get("frame"))
    if isinstance(frame, dict) and "xaxis" in frame:
        point, x, y = (np.array(_contents(frame[k]), float) for k in ("point", "xaxis", "yaxis"))
        z = np.cross(x, y)
        axes = [x, np.cross(z, x), z]
        matrix[:3] = np.column_stack([*(axis / np.linalg.norm(axis) for axis in axes), point])
    moved = _contents(table.get("transformation"))
    if isinstance(moved, dict) and "matrix" in moved:
        matrix = matrix @ np.array(moved["matrix"], float).reshape(4, 4)
    return matrix


def _contents(item: Any) -> Any:
    """What is inside the wrapping that says its type."""
    return item.get("data", item.get("value", item)) if isinstance(item, dict) else item


def _mesh(corners: Any, faces: Any, place: Surface) -> Surface:
    """A mesh: tables or lists of its vertices and faces; `points` of its place are a matrix."""
    if not isinstance(corners, dict):
        corners = {k: dict(zip("xyz", _contents(v), strict=True)) for k, v in enumerate(corners)}
    number = {str(key): k for k, key in enumerate(corners)}
    points = np.array([[v.get(axis, 0.0) for axis in "xyz"] for v in corners.values()], float)
    loops = faces.values() if isinstance(faces, dict) else faces
    points = points @ place.points[:3, :3].T + place.points[:3, 3]
    return replace(place, points=points, loops=[[number[str(k)] for k in x] for x in loops])


def _obj(path: Path, _: str | None) -> Iterator[Surface]:
    """Objects of an OBJ file, or groups if it has none; a block's group is that of its material."""
    text = path.read_text("utf-8-sig", "replace").replace("\\\n", " ")
    begins = "o" if text.startswith("o ") or "\no " in text else "g"
    points: list[Any] = [None]  # they count from 1
    faces: dict[str, list[Any]] = {}
    groups: dict[str, str] = {}
    name, group = path.stem, "default"
    for line in text.splitlines():
        key, *words = line.split() or [""]
        if key == "v":
            points.append([float(word) for word in words[:3]])
        elif key == begins:
            name = " ".join(words) or path.stem
        elif key in ("g", "usemtl"):
            group = " ".join(words) or "default"
        elif key == "f":
            corners = [points[int(word.split("/")[0])] for word in words]
            faces.setdefault(name, []).append(corners)
            groups.setdefault(name, group)
    for name, some in faces.items():
        yield _surface(name, some, groups[name])


def _stl(path: Path, _: str | None) -> Iterator[Surface]:
    """Solids of an STL file, binary or text."""
    data = path.read_bytes()
    if len(data) > 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        yield _surface(path.stem, np.frombuffer(data, record, offset=84)["corners"])
        return
    solids: list[tuple[str, list[list[float]]]] = []
    ended = False
    for line in data.decode("utf-8", "replace").splitlines():
        key, *words = line.split() or [""]
        if key == "solid":
            solids.append((" ".join(words) or path.stem, []))
        elif key == "vertex":
            solids[-1][1].append([float(word) for word in words])
        ended = key == "endsolid" or (ended and not key)
    require(ended, f"'{path}' is no STL file, or its end is missing; save it again")
    for name, corners in solids:
        if corners:
            yield _surface(name, np.array(corners).reshape(-1, 3, 3))


def _dxf(path: Path, unit: str | None) -> Iterator[Surface]:
    """3DFACE, MESH and polyface mesh entities of a DXF file, in m; a layer is a group."""
    found: list[Surface] = []
    faces: dict[str, list[Any]] = {}
    others = Counter[str]()
    with visible_entities(path, unit) as (entities, known, _):
        from ezdxf.render import MeshBuilder

        for entity, layer in entities.visible():
            kind = entity.dxftype()
            try:
                if kind == "3DFACE":
                    faces.setdefault(layer, []).append(entity.wcs_vertices())
                elif kind == "MESH":
                    mesh = MeshBuilder.from_mesh(entity)
                elif kind == "POLYLINE" and (entity.is_poly_face_mesh or entity.is_polygon_mesh):
                    mesh = MeshBuilder.from_polyface(entity)
                else:
                    others[kind] += 1
                if kind in ("MESH", "POLYLINE") and not others[kind]:
                    corners = [[mesh.vertices[k] for k in face] for face in mesh.faces]
                    found.append(_surface(layer, corners, layer))
            except Exception as error:  # damaged entities fail anywhere in ezdxf
                reason = f"{str(error) or type(error).__name__}; delete it or draw it anew"
                text = f"'{path}': the {kind} on layer '{layer}' cannot be read: {reason}"
                raise InputError(text) from None
    found += [_surface(layer, some, layer) for layer, some in faces.items()]
    listed = ", ".join(f"{count} {kind}" for kind, count in others.items()) or "nothing"
    text = "has no 3DFACE, MESH or polyface mesh on a visible layer"
    require(bool(found), f"'{path}' {text}, but {listed}; turn solids into meshes")
    for surface in found:
        yield replace(surface, points=surface.points * UNITS[known])


def _msh(path: Path, _: str | None) -> Iterator[Surface]:
    """Volumes of a gmsh file; the group is the name of the first physical volume."""
    volumes, tags, coordinates = read_volumes(path)
    place = dict(zip(tags.tolist(), coordinates, strict=True))
    for tag, group, loops in volumes:
        faces = [[place[node] for node in loop] for loop in loops]
        yield _surface(f"{group or 'volume'} {tag}", faces, group or "default")


#: What reads a kind of file.
READERS: dict[str, Callable[[Path, str | None], Iterator[Surface]]] = {
    ".json": _compas,
    ".obj": _obj,
    ".stl": _stl,
    ".dxf": _dxf,
    ".msh": _msh,
}
