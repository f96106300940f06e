"""Files of fields: forces at points; for ParaView blocks and their motion, contacts.

VTU is XML with arrays in base64, packed by zlib (VTK file formats, https://docs.vtk.org). Convex
pieces are polyhedra of VTK, contacts polygons.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.results.block_view import BlockView
from fenics_contact.results.result import Collapse
from fenics_contact.spatial.result import SpatialLimit
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.view import views_of

#: Types of cells in VTK files.
POLYGON, POLYHEDRON = 7, 42
#: Of contacts in corners and edges, by how many corners they have.
VERTEX, LINE = 1, 3
#: Files of the motion, after that at rest.
STEPS = 10
#: VTK's names of types.
TYPES = {"f": "Float64", "i": "Int32", "u": "UInt8"}
#: What files begin and end with, around their content.
FILE = '<?xml version="1.0"?>\n<VTKFile type="{}" version="0.1" {}>{}</VTKFile>\n'
PACKED = 'byte_order="LittleEndian" header_type="UInt32" compressor="vtkZLibDataCompressor"'

#: Arrays by name, by VTK's places of them.
Grid = dict[str, dict[str, Any]]


def write_fields(result: SpatialLimit, folder: Path) -> None:
    """Write what ParaView shows of a result, on this rank, for every direction of the live load.

    blocks.vtu has the blocks at rest with the collapse mode, contacts.vtu the contacts, points.npz
    the forces at their points, and collapse.pvd the motion in steps; with two directions, likewise
    blocks_negative.vtu, and so on.

    Args:
        result: What was found.
        folder: Where to, which is there.

    Raises:
        OSError: If a file cannot be written.
    """
    for name, view in views_of(result).items():
        _write_points(folder / f"points{view.suffix}.npz", result.structure, result.ends[name])
        blocks = _blocks(view)
        _write_grid(folder / f"blocks{view.suffix}.vtu", blocks)
        _write_grid(folder / f"contacts{view.suffix}.vtu", _contacts(view))
        steps = ""
        for step in range(STEPS + 1) if view.motion.any() else ():
            name = f"collapse{view.suffix}_{step:02d}.vtu"
            moved = view.bodies.corner + step / STEPS * view.displacement
            _write_grid(folder / name, blocks | {"Points": {"Points": moved}})
            steps += f'<DataSet timestep="{step / STEPS:g}" part="0" file="{name}"/>'
        if steps:
            series = FILE.format("Collection", "", f"<Collection>{steps}</Collection>")
            (folder / f"collapse{view.suffix}.pvd").write_text(series)


def _write_points(path: Path, structure: Structure, end: Collapse) -> None:
    """Write the forces at points, if any are known, with all that recomputes their equilibrium."""
    if end.force is None or end.tension is None:
        return
    count = len(end.force)
    blocks = np.column_stack([block for _, block, _ in structure.ends])
    np.savez_compressed(
        path,
        **vars(structure.points),
        axes=structure.axes[:count],
        force=end.force,
        blocks=blocks[:count],
        names=np.array([block.name for block in structure.blocks], dtype=str),
        centroid=np.array([block.centroid for block in structure.blocks]),
        dead=structure.dead,
        live=structure.live,
        load_factor=end.load_factor,
        tie_ends=np.array([bar.ends for bar in structure.bars]).reshape(-1, 2, 3),
        tie_blocks=blocks[count:],
        tension=end.tension,
    )


def _blocks(view: BlockView) -> Grid:
    """Cells of the blocks' pieces with what is known of them; groups are numbered in turn."""
    bodies = view.bodies
    groups = list(dict.fromkeys(bodies.groups))
    group = np.array([groups.index(name) for name in bodies.groups])
    faces = [[len(piece.sides)] for piece in bodies.pieces]
    for loop, piece in zip(bodies.sides, bodies.side_piece, strict=True):
        faces[piece] += [len(loop), *loop.tolist()]
    at_cells = {
        "block": bodies.of_piece,
        "group": group[bodies.of_piece],
        "fixed": bodies.fixed[bodies.of_piece].astype(int),
        "movement": view.share[bodies.of_piece],
        "utilisation": view.utilisation[bodies.of_piece],
        "falls": np.isin(bodies.of_piece, view.marked).astype(int),
    }
    grid = _grid(POLYHEDRON, bodies.corner, bodies.counts, at_cells)
    grid["Cells"]["faces"] = np.concatenate(faces)
    grid["Cells"]["faceoffsets"] = np.cumsum([len(stream) for stream in faces])
    grid["PointData"] = {"displacement": view.displacement}
    return grid


def _contacts(view: BlockView) -> Grid:
    """Cells of the contacts with what they carry and do."""
    corners = view.touching.corners
    normal = view.touching.normal
    at_cells = {**vars(view.contacts), "normal": normal, "blocks": view.touching.pairs}
    counts = np.array(list(map(len, corners)))
    kinds = np.select([counts == 1, counts == 2], [VERTEX, LINE], POLYGON)
    return _grid(kinds, np.vstack(corners), counts, at_cells)


def _grid(kind: int | Array, points: Array, counts: Any, at_cells: Mapping[str, Any]) -> Grid:
    """Cells of a kind, or of one each, of as many of the points each, in turn."""
    cells = {
        "connectivity": np.arange(len(points)),
        "offsets": np.cumsum(counts),
        "types": np.full(len(counts), kind, dtype=np.uint8),
    }
    return {"CellData": dict(at_cells), "Points": {"Points": points}, "Cells": cells}


def _write_grid(path: Path, grid: Grid) -> None:
    """Write an unstructured grid."""
    counts = {"Points": len(grid["Points"]["Points"]), "Cells": len(grid["Cells"]["types"])}
    piece = " ".join(f'NumberOf{name}="{count}"' for name, count in counts.items())
    parts = "".join(
        f"<{place}>{''.join(_array(*one) for one in arrays.items())}</{place}>"
        for place, arrays in grid.items()
    )
    whole = f"<UnstructuredGrid><Piece {piece}>{parts}</Piece></UnstructuredGrid>"
    path.write_text(FILE.format("UnstructuredGrid", PACKED, whole))


def _array(name: str, values: Any) -> str:
    """An array, packed, as XML."""
    kind = TYPES[values.dtype.kind]
    data = np.ascontiguousarray(values, dtype=kind.lower()).tobytes()
    packed = zlib.compress(data)
    header = np.array([1, len(data), len(data), len(packed)], dtype="<u4").tobytes()
    text = (base64.b64encode(header) + base64.b64encode(packed)).decode("ascii")
    shape = f'NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    return f'<DataArray type="{kind}" Name="{name}" {shape} format="binary">{text}</DataArray>'
