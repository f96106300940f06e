"""Grids of VTK with arrays in base64, packed by zlib (VTK file formats, https://docs.vtk.org).

Convex pieces of blocks are polyhedra of VTK; contacts in space are polygons, lines or points,
facets of joints in the plane are lines.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from fenics_contact.discretization.layout import Layout, ground_motion, straight_faces
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.fields import at_sides, facet_contact, middle, mode_scale
from fenics_contact.output.folder import writing
from fenics_contact.output.view import view_of
from fenics_contact.results.block_view import JOINT_STATES, BlockView, ContactState
from fenics_contact.results.values import JointValues

#: Types of cells in VTK files.
POLYGON, POLYHEDRON = 7, 42
#: Of contacts in corners and edges, by how many corners they have.
VERTEX, LINE = 1, 3
#: VTK's names of types.
TYPES = {"f": "Float64", "i": "Int32", "u": "UInt8"}
#: What files begin and end with, around their content.
FILE = '<?xml version="1.0"?>\n<VTKFile type="{}" version="0.1" {}>{}</VTKFile>\n'
PACKED = 'byte_order="LittleEndian" header_type="UInt32" compressor="vtkZLibDataCompressor"'

#: Arrays by name, by VTK's places of them.
Grid = dict[str, dict[str, Any]]


def write_contacts(path: Path, view: BlockView) -> None:
    """Write the contacts with what they carry and do, on this rank.

    By corner, as vectors, m: "displacement" (mean of both sides), "opening" and "slip".

    Raises:
        OSError: If the file cannot be written.
    """
    at = view.touching
    counts = np.array(list(map(len, at.corners)))
    corners = np.vstack(at.corners)
    first, second = (view.displacements(corners, side.repeat(counts)) for side in at.pairs.T)
    normal = at.normal.repeat(counts, axis=0)
    opening = np.sum((second - first) * normal, axis=1)[:, None] * normal
    kinds = np.select([counts == 1, counts == 2], [VERTEX, LINE], POLYGON)
    known = vars(view.contacts)
    at_cells = {name: known[name] for name in ("pressure", "shear_stress", "utilisation", "state")}
    grid = grid_of(kinds, corners, counts, at_cells | {"normal": at.normal, "blocks": at.pairs})
    grid["PointData"] = {
        "displacement": 0.5 * (first + second),
        "opening": opening,
        "slip": second - first - opening,
    }
    grid["FieldData"] = {"states": tuple(state.name.lower() for state in ContactState)}
    write_grid(path, grid)


def write_joints(
    path: Path,
    layout: Layout,
    values: JointValues,
    displacement: Array,
    mode: Array | None,
    about: str = "",
) -> None:
    """Write the joints as lines, on rank 0. Collective.

    By point: "pressure" and "shear" in Pa, "gap" and "slip" in m, "displacement" (mean of both
    sides) and "collapse_mode", which moves the lines with the blocks; it and the rates are scaled
    by "mode_scale"; without a mode they are left out. By line: "state" 0 open, 1 slip, 2 stick;
    "group" and "friction" of its law, "utilisation" of that and "opening" of its straight face. A
    comment has what there is to say `about` the state.

    Raises:
        OutputError: On all ranks, with the reason, if the file cannot be written.
    """
    joints = layout.joints.without_ties()
    count = joints.joint_count
    of_faces = view_of(layout, mode, values).blocks
    values = values.first(count)
    points = {name: getattr(values, name) for name in ("pressure", "shear", "gap", "slip")}
    points |= {"normal": joints.normal, "force": values.force(joints.normal, joints.tangent)}
    ground = ground_motion(layout.scene, layout.boundary, joints)
    moved = at_sides(layout, displacement)[:count]
    points |= {"displacement": middle(joints, moved, ground)}
    numbers = {}
    if mode is not None:
        scale = mode_scale(layout, mode)
        points |= {name: scale * getattr(values, name) for name in ("opening_rate", "slip_rate")}
        points |= {"collapse_mode": scale * middle(joints, at_sides(layout, mode)[:count])}
        numbers = {"mode_scale": np.array([scale])}
    face = straight_faces(joints).of_point
    first = joints.segments[:, 0]
    lines = {
        "state": facet_contact(values, joints.segments),
        "group": joints.law[first],
        "friction": joints.friction[first],
        "utilisation": of_faces.contacts.utilisation[face[first]],
        "opening": of_faces.contacts.opening[face[first]],
    }
    grid = grid_of(LINE, _flat(joints.position), np.full(len(first), 2), lines)
    grid["Cells"]["connectivity"] = joints.segments.ravel()
    grid["PointData"] = {
        name: _flat(values) if values.ndim == 2 else values for name, values in points.items()
    }
    grid["FieldData"] = numbers
    states = ", ".join(f"{contact.value} {contact.name.lower()}" for contact in JOINT_STATES[::-1])
    groups = ", ".join(f"{k} {name}" for k, name in enumerate(joints.names))
    told = "; ".join(filter(None, (about, f"state: {states}", f"group: {groups}")))
    with writing(layout.scene.comm):
        if layout.scene.comm.rank == 0:
            write_grid(path, grid, told)


def _flat(vectors: Array) -> Array:
    """Places or directions (x, y) as (x, y, 0)."""
    return np.column_stack([vectors, np.zeros(len(vectors))])


def grid_of(kind: int | Array, points: Array, counts: Any, at_cells: Mapping[str, Any]) -> Grid:
    """Cells of a kind, or of one each, of as many of the points each, in turn."""
    cells = {
        "connectivity": np.arange(len(points)),
        "offsets": np.cumsum(counts),
        "types": np.full(len(counts), kind, dtype=np.uint8),
    }
    return {"CellData": dict(at_cells), "Points": {"Points": points}, "Cells": cells}


def write_grid(path: Path, grid: Grid, about: str = "") -> None:
    """Write an unstructured grid, with a comment of what there is to say about it."""
    counts = {"Points": len(grid["Points"]["Points"]), "Cells": len(grid["Cells"]["types"])}
    piece = " ".join(f'NumberOf{name}="{count}"' for name, count in counts.items())
    parts = {
        place: f"<{place}>{''.join(_array(*one) for one in arrays.items())}</{place}>"
        for place, arrays in grid.items()
    }
    field = parts.pop("FieldData", "")
    told = about and f"<!-- {escape(about).replace('--', '- -')} -->"  # XML allows no two hyphens
    whole = f"{told}<UnstructuredGrid>{field}<Piece {piece}>{''.join(parts.values())}</Piece>"
    path.write_text(
        FILE.format("UnstructuredGrid", PACKED, f"{whole}</UnstructuredGrid>"), encoding="utf-8"
    )


def _array(name: str, values: Any) -> str:
    """An array, packed, as XML; names become those of the components of 0, 1, 2 ..."""
    labels = ""
    if isinstance(values, tuple):  # not strings of VTK, which meshio refuses
        shown = ("".join(c if c.isprintable() else " " for c in name) for name in values)
        labels = "".join(f" ComponentName{k}={quoteattr(n)}" for k, n in enumerate(shown))
        values = np.arange(len(values))[None]
    kind = TYPES[values.dtype.kind]
    data = np.ascontiguousarray(values, dtype=kind.lower()).tobytes()
    packed = zlib.compress(data)
    header = np.array([1, len(data), len(data), len(packed)], dtype="<u4").tobytes()
    text = (base64.b64encode(header) + base64.b64encode(packed)).decode("ascii")
    shape = f'NumberOfTuples="{len(values)}"'
    shape += f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    head = f'type="{kind}" Name="{name}" {shape}{labels}'
    return f'<DataArray {head} format="binary">{text}</DataArray>'
