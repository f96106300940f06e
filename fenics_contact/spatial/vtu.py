"""Files for ParaView: blocks with the collapse mode, contacts with what they carry, the motion.

VTU is XML with arrays in base64, packed by zlib (VTK file formats, https://docs.vtk.org). Convex
pieces are polyhedra of VTK, contacts polygons.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Comment, Element, ElementTree, SubElement

import numpy as np

from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.spatial.result import SpatialLimit
from fenics_contact.spatial.view import ContactState, SpatialView, views_of

#: Types of cells in VTK files.
POLYGON, POLYHEDRON = 7, 42
#: Files of the motion, after that at rest.
STEPS = 10
#: VTK's names of types.
TYPES = {"f": "Float64", "i": "Int32", "u": "UInt8"}


@dataclass(frozen=True, eq=False)
class Grid:
    """Cells of one kind.

    Attributes:
        kind: VTK's type of all.
        points: m, shape (points, 3).
        cells: Numbers of the points of each.
        at_cells: Arrays by name.
        at_points: Arrays by name.
        faces: Of polyhedra: how many, and of each how many points and which.
        comment: What numbers mean.
    """

    kind: int
    points: Array
    cells: Sequence[Indices]
    at_cells: Mapping[str, Any]
    at_points: Mapping[str, Array] = field(default_factory=dict)
    faces: Sequence[Sequence[int]] = ()
    comment: str = ""


def write_fields(result: SpatialLimit, folder: Path) -> None:
    """Write what ParaView shows of a result, on this rank, for every direction of the live load.

    blocks.vtu has the blocks at rest with the collapse mode, contacts.vtu the contacts, and
    collapse.pvd the motion in steps; with two directions, likewise blocks_negative.vtu, and so on.

    Args:
        result: What was found.
        folder: Where to, which is there.

    Raises:
        OSError: If a file cannot be written.
    """
    for suffix, view in views_of(result).items():
        blocks = _blocks(view)
        _write_grid(folder / f"blocks{suffix}.vtu", blocks)
        _write_grid(folder / f"contacts{suffix}.vtu", _contacts(view))
        if not view.motion.any():
            continue
        root = Element("VTKFile", type="Collection", version="0.1")
        series = SubElement(root, "Collection")
        for step in range(STEPS + 1):
            share = step / STEPS
            name = f"collapse{suffix}_{step:02d}.vtu"
            moved = view.bodies.corner + share * view.displacement
            _write_grid(folder / name, replace(blocks, points=moved))
            SubElement(series, "DataSet", timestep=f"{share:g}", part="0", file=name)
        ElementTree(root).write(folder / f"collapse{suffix}.pvd", xml_declaration=True)


def _blocks(view: SpatialView) -> Grid:
    """Cells of the blocks' pieces with what is known of them."""
    bodies = view.bodies
    blocks = [view.structure.blocks[number] for number in bodies.of_piece]
    groups = list(dict.fromkeys(block.group for block in view.structure.blocks))
    faces: list[list[int]] = [[] for _ in blocks]
    for loop, piece in zip(bodies.sides, bodies.side_piece, strict=True):
        faces[piece] += [len(loop), *loop.tolist()]
    sides = np.bincount(bodies.side_piece)
    streams = [[int(count), *of_piece] for count, of_piece in zip(sides, faces, strict=True)]
    return Grid(
        comment=_meanings("group", groups),
        points=bodies.corner,
        cells=np.split(np.arange(len(bodies.corner)), np.flatnonzero(np.diff(bodies.piece)) + 1),
        kind=POLYHEDRON,
        faces=streams,
        at_points={"displacement": view.displacement},
        at_cells={
            "block": bodies.of_piece,
            "group": np.array([groups.index(block.group) for block in blocks]),
            "fixed": np.array([block.fixed for block in blocks], dtype=int),
            "movement": view.share[bodies.of_piece],
            "utilisation": view.utilisation[bodies.of_piece],
            "falls": np.isin(bodies.of_piece, view.marked).astype(int),
        },
    )


def _contacts(view: SpatialView) -> Grid:
    """Cells of the contacts with what they carry and do."""
    contacts = view.structure.contacts
    values = view.contacts
    counts = [len(contact.corners) for contact in contacts]
    return Grid(
        comment=_meanings("state", [state.name.lower() for state in ContactState]),
        points=np.vstack([contact.corners for contact in contacts]),
        cells=np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1]),
        kind=POLYGON,
        at_cells={
            "pressure": values.pressure,
            "shear_stress": values.shear,
            "utilisation": values.utilisation,
            "opening": values.opening,
            "slip": values.slip,
            "state": values.state,
            "normal": np.array([contact.axes[0] for contact in contacts]),
            "blocks": np.array([(contact.first, contact.second) for contact in contacts]),
        },
    )


def _meanings(name: str, words: Sequence[str]) -> str:
    """What the numbers of an array mean, as a comment of XML may have it."""
    told = ", ".join(f"{number} {word}" for number, word in enumerate(words))
    return f" {name}: {told} ".replace("--", "- -")


def _write_grid(path: Path, grid: Grid) -> None:
    """Write cells of one kind as an unstructured grid."""
    versions = {"version": "1.0", "byte_order": "LittleEndian", "header_type": "UInt32"}
    kinds = {"type": "UnstructuredGrid", "compressor": "vtkZLibDataCompressor"}
    root = Element("VTKFile", kinds | versions)
    root.append(Comment(grid.comment))
    counts = {
        "NumberOfPoints": str(len(grid.points)),
        "NumberOfCells": str(len(grid.cells)),
    }
    piece = SubElement(SubElement(root, "UnstructuredGrid"), "Piece", counts)
    for where, values in (("PointData", grid.at_points), ("CellData", grid.at_cells)):
        place = SubElement(piece, where)
        for name, value in values.items():
            _add(place, name, value)
    _add(SubElement(piece, "Points"), "Points", grid.points)
    place = SubElement(piece, "Cells")
    _add(place, "connectivity", np.concatenate(grid.cells))
    _add(place, "offsets", np.cumsum([len(cell) for cell in grid.cells]))
    _add(place, "types", np.full(len(grid.cells), grid.kind, dtype=np.uint8))
    if grid.faces:
        _add(place, "faces", np.concatenate(grid.faces))
        _add(place, "faceoffsets", np.cumsum([len(stream) for stream in grid.faces]))
    ElementTree(root).write(path, xml_declaration=True)


def _add(place: Element, name: str, values: Any) -> None:
    """Add an array, packed."""
    kind = TYPES[values.dtype.kind]
    data = np.ascontiguousarray(values, dtype=kind.lower()).tobytes()
    packed = zlib.compress(data)
    header = np.array([1, len(data), len(data), len(packed)], dtype="<u4").tobytes()
    kinds = {"type": kind, "format": "binary"}
    if values.ndim == 2:
        kinds["NumberOfComponents"] = str(values.shape[1])
    array = SubElement(place, "DataArray", {"Name": name, **kinds})
    array.text = (base64.b64encode(header) + base64.b64encode(packed)).decode("ascii")
