"""Blocks from files of other programs: COMPAS, OBJ, STL, DXF and gmsh.

Formats: COMPAS, `compas.data` (compas.dev); Wavefront, Advanced Visualizer manual, appendix B1; 3D
Systems, StereoLithography interface specification; Autodesk, DXF reference; gmsh's reference
manual, "MSH file format".
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import InputError, checked, require
from fenics_contact.geometry.dxf.reader import UNITS, visible_entities
from fenics_contact.geometry.gmsh_mesh import read_volumes
from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.polyhedra import Block
from fenics_contact.spatial.surfaces import Surface, blocks_of

#: Faces in a file; 2 000 blocks have less than a tenth of them.
MOST_FACES = 500_000
#: Attributes that make a block of COMPAS ground.
GROUND = ("is_support", "is_fixed")
#: What of a COMPAS file is no block: contacts and their surfaces.
NO_BLOCKS = {"edge", "edgedata", "interface", "interfaces", "interactions", "contacts", "features"}
#: Attributes that move a block of COMPAS.
PLACES = ("frame", "transformation")
#: Names that COMPAS gives by itself.
OF_TYPES = {"Assembly", "Block", "BlockElement", "BlockModel", "Box", "Graph", "Mesh", "Model"}


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
    numbers: dict[str, Iterator[int]] = defaultdict(lambda: count(1))
    return tuple(
        replace(b, name=f"{b.name} {next(numbers[b.name])}") if uses[b.name] > 1 else b
        for b in blocks
    )


def _surfaces(path: Path, unit: str | None) -> list[Surface]:
    """Surfaces of a file, in m."""
    source = f"'{path}'"
    try:
        require(path.stat().st_size > 0, f"{source} is empty; save it again")
        scale = 1.0 if path.suffix.lower() == ".dxf" else UNITS[unit or "m"]
        surfaces = [
            replace(s, faces=[scale * np.array(f, float).reshape(len(f), 3) for f in s.faces])
            for s in READERS[path.suffix.lower()](path, unit)
        ]
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{source} cannot be read: {error.strerror or error}") from None
    except Exception as error:  # damaged contents fail anywhere
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InputError(f"{source} is damaged ({reason}); save it again") from None
    faces = sum(len(surface.faces) for surface in surfaces)
    require(faces > 0, f"{source} has no faces; save the blocks as meshes")
    require(faces <= MOST_FACES, f"{source} has {faces} faces; at most {MOST_FACES} are read")
    return surfaces


def _compas(path: Path, _: str | None) -> Iterator[Surface]:
    """Meshes of an assembly or model of COMPAS, but for those of contacts."""
    data = json.loads(path.read_bytes().decode("utf-8-sig"))
    yield from _meshes(data, Surface(path.stem, []), f"'{path}'")


def _meshes(data: Any, around: Surface, source: str) -> Iterator[Surface]:
    """Meshes in a table, with what the tables around them say of name, group, support."""
    if isinstance(data, list):
        for item in data:
            yield from _meshes(item, around, source)
    if not isinstance(data, dict):
        return
    attributes = data.get("attributes")
    table = data | attributes if isinstance(attributes, dict) else data
    name = table.get("name")
    around = Surface(
        str(name) if name and name not in OF_TYPES else around.name,
        [],
        str(table.get("group") or around.group),
        around.fixed or any(bool(table.get(key)) for key in GROUND),
    )
    for key in PLACES:
        text = f"block '{around.name}' has a {key}; save its corners where they are"
        require(not _contents(data.get(key)), f"{source}: {text}")
    corners = data.get("vertex", data.get("vertices"))
    faces = data.get("face", data.get("faces"))
    if corners and faces:
        yield replace(around, faces=_mesh(corners, faces))
        return
    for key, item in data.items():
        if key not in NO_BLOCKS:
            named = replace(around, name=key) if key.isdecimal() else around
            yield from _meshes(item, named, source)


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


def _obj(path: Path, _: str | None) -> Iterator[Surface]:
    """Objects of an OBJ file, or groups if it has none; a block's group is that of its material."""
    text = path.read_text("utf-8-sig", "replace").replace("\\\n", " ")
    begins = "o" if text.startswith("o ") or "\no " in text else "g"
    points: list[Any] = [None]  # they count from 1
    surfaces: dict[str, Surface] = {}
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
            surfaces.setdefault(name, Surface(name, [], group)).faces.append(corners)
    yield from surfaces.values()


def _stl(path: Path, _: str | None) -> Iterator[Surface]:
    """Solids of an STL file, binary or text."""
    data = path.read_bytes()
    if len(data) > 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        yield Surface(path.stem, list(np.frombuffer(data, record, offset=84)["corners"]))
        return
    lines = data.decode("utf-8", "replace").strip().splitlines()
    ended = lines[-1].split()[:1] == ["endsolid"]
    require(ended, f"'{path}' is no STL file, or its end is missing; save it again")
    solids: list[tuple[str, list[Any]]] = []
    for line in lines:
        key, *words = line.split() or [""]
        if key == "solid":
            solids.append((" ".join(words) or path.stem, []))
        elif key == "vertex":
            solids[-1][1].append([float(word) for word in words])
    for name, corners in solids:
        if corners:
            yield Surface(name, [corners[k : k + 3] for k in range(0, len(corners), 3)])


def _dxf(path: Path, unit: str | None) -> Iterator[Surface]:
    """3DFACE, MESH and polyface mesh entities of a DXF file, in m; a layer is a group."""
    surfaces: list[Surface] = []
    drawn: dict[str, Surface] = {}
    others = Counter[str]()
    with visible_entities(path, unit) as (entities, known, _):
        from ezdxf.render import MeshBuilder

        readers = {"MESH": MeshBuilder.from_mesh, "POLYLINE": MeshBuilder.from_polyface}
        for entity, layer in entities.visible():
            kind = entity.dxftype()
            is_mesh = kind == "MESH" or (kind == "POLYLINE" and "Mesh" in entity.get_mode())
            if kind == "3DFACE":
                drawn.setdefault(layer, Surface(layer, [], layer))
                drawn[layer].faces.append(UNITS[known] * np.array(entity.wcs_vertices()))
            elif is_mesh:
                mesh = readers[kind](entity)
                points = UNITS[known] * np.array(mesh.vertices)
                surfaces.append(Surface(layer, [points[[*face]] for face in mesh.faces], layer))
            else:
                others[kind] += 1
    listed = ", ".join(f"{n} {kind}" for kind, n in others.items()) or "nothing"
    text = "has no 3DFACE, MESH or polyface mesh on a visible layer"
    require(bool(surfaces or drawn), f"'{path}' {text}, but {listed}; turn solids into meshes")
    yield from (*surfaces, *drawn.values())


def _msh(path: Path, _: str | None) -> Iterator[Surface]:
    """Volumes of a gmsh file; the group is the name of the first physical volume."""
    volumes, tags, coordinates = read_volumes(path)
    place = dict(zip(tags.tolist(), coordinates, strict=True))
    for tag, group, loops in volumes:
        faces = [np.array([place[node] for node in loop]) for loop in loops]
        yield Surface(f"{group or 'volume'} {tag}", faces, group or "default")


#: What reads a kind of file.
READERS: dict[str, Callable[[Path, str | None], Iterator[Surface]]] = {
    ".json": _compas,
    ".obj": _obj,
    ".stl": _stl,
    ".dxf": _dxf,
    ".msh": _msh,
}
