"""Finite element fields of a result, and the ParaView files that hold them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Comment, Element, ElementTree, SubElement, indent

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from fenics_contact import compat
from fenics_contact.analysis.joint_values import Contact, JointValues
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.elasticity import cell_field
from fenics_contact.discretization.forms import stress_expression
from fenics_contact.discretization.joints import Joints
from fenics_contact.mesh import Array
from fenics_contact.output.folder import writing


def displacement_function(discretization: Discretization, values: Array, name: str) -> fem.Function:
    """Displacement field in x and y, from this rank's part in the supports' coordinates."""
    function = fem.Function(discretization.elasticity.space, name=name)
    function.x.array[: len(values)] = discretization.cartesian(values).ravel()
    function.x.scatter_forward()
    return function


def stress_fields(discretization: Discretization, displacement: fem.Function) -> list[fem.Function]:
    """Stress components and von Mises stress at the centre of every cell, Pa, and body number.

    In plane strain, von Mises has the stress out of the plane, nu (sigma_x + sigma_y).
    """
    scene, lame = discretization.scene, discretization.elasticity.lame
    expression, space = stress_expression(displacement, lame, scene.plane)
    together = fem.Function(space)
    together.interpolate(expression)
    columns = together.x.array.reshape(-1, 4)[compat.cell_dofs(space)[:, 0]].T
    names = ("stress_xx", "stress_yy", "stress_xy", "von_mises", "body")
    values = zip(names, [*columns, scene.mesh.body], strict=True)
    return [cell_field(scene.mesh, name, value) for name, value in values]


def write_blocks(
    path: Path, discretization: Discretization, displacement: Array, elastic: Array, mode: Array
) -> None:
    """Write displacement and collapse mode by node, and stress and body by cell, as a .pvd file.

    Collective. `elastic` is the displacement without a large motion, in which digits of stresses
    would be lost.

    Raises:
        OutputError: On all ranks, with the reason, if a file cannot be written.
    """
    named = {"displacement": displacement, "collapse_mode": mode, "elastic": elastic}
    *moving, strained = (displacement_function(discretization, u, n) for n, u in named.items())
    functions = [*moving, *stress_fields(discretization, strained)]
    comm = discretization.scene.comm
    with writing(comm):
        compat.write_vtk(path, functions)
    with writing(comm):
        if comm.rank == 0:
            compat.tidy_vtk(path)


def write_joints(path: Path, joints: Joints, values: JointValues) -> None:
    """Write the joints as lines with values at their points, an XML file of VTK, on this rank.

    "pressure" and "shear" are in Pa, "gap" and "slip" in m; "state" is 0 open, 1 slip, 2 stick.
    """
    names = ("pressure", "shear", "gap", "slip", "opening_rate", "slip_rate")
    columns = {name: getattr(values, name) for name in names}
    columns |= {"state": values.contact, "normal": joints.normal, "force": values.force(joints)}
    count = len(joints.segments)
    cells = {
        "connectivity": joints.segments.ravel(),
        "offsets": 2 * np.arange(1, count + 1),
        "types": np.full(count, 3, dtype=np.uint8),  # lines
    }
    file = Element("VTKFile", type="UnstructuredGrid", version="0.1", byte_order="LittleEndian")
    states = ", ".join(f"{contact.value} {contact.name.lower()}" for contact in Contact)
    file.append(Comment(f" state: {states} "))
    sizes = {"NumberOfPoints": str(len(joints.length)), "NumberOfCells": str(count)}
    piece = SubElement(SubElement(file, "UnstructuredGrid"), "Piece", sizes)
    _add_arrays(SubElement(piece, "Points"), {"points": joints.position})
    _add_arrays(SubElement(piece, "Cells"), cells)
    _add_arrays(SubElement(piece, "PointData"), columns)
    indent(file)
    ElementTree(file).write(path, encoding="us-ascii", xml_declaration=True)


def _add_arrays(parent: Element, columns: Mapping[str, npt.NDArray[Any]]) -> None:
    """Add arrays of numbers; those with two columns are vectors in the plane."""
    for name, values in columns.items():
        if values.ndim == 2:
            values = np.column_stack([values, np.zeros(len(values))])
        kind = {"i": "Int64", "u": "UInt8", "f": "Float64"}[values.dtype.kind]
        width = "1" if values.ndim == 1 else "3"
        form = {"type": kind, "Name": name, "NumberOfComponents": width, "format": "ascii"}
        array = SubElement(parent, "DataArray", form)
        array.text = " ".join(f"{value:.12g}" for value in values.ravel())
