"""Finite element fields of a result, and the ParaView files that hold them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Comment, Element, ElementTree, SubElement

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.discretization.forms import stress_expression
from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.materials import cell_field
from fenics_contact.discretization.rigid_motions import ground_motion
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.output.folder import writing
from fenics_contact.results.history import CapacityPoint
from fenics_contact.results.joint_values import Contact, JointValues

#: Type of a straight line in VTK files.
VTK_LINE = 3
#: Largest displacement of a collapse mode in pictures and files, over the structure's size.
AMPLITUDE = 0.08


def displacement_function(layout: Layout, values: Array, name: str) -> fem.Function:
    """Displacement field in x and y, from this rank's part in the supports' coordinates."""
    function = fem.Function(layout.space, name=name)
    function.x.array[: len(values)] = layout.cartesian(values).ravel()
    function.x.scatter_forward()
    return function


def at_nodes(layout: Layout, values: Array, nodes: Indices) -> Array:
    """Displacements at a table of nodes, on all ranks, shape (*nodes.shape, 2); 0 on the ground.

    Collective. `values` are this rank's in the supports' coordinates.
    """
    displacement = layout.cartesian(values)
    first = layout.first_node
    end = first + len(displacement)
    mine = (nodes >= first) & (nodes < end)
    found = np.zeros((*nodes.shape, 2))
    found[mine] = displacement[nodes[mine] - first]
    layout.scene.comm.Allreduce(MPI.IN_PLACE, found, MPI.SUM)
    return found


def at_sides(layout: Layout, values: Array) -> Array:
    """Displacements of both sides at all joint points and ties, on all ranks, (points, 2, 2).

    They are zero on rigid ground. Collective; `values` as for `at_nodes`.
    """
    stencil = layout.joints.stencil
    of_nodes = at_nodes(layout, values, stencil.nodes)
    return np.asarray(np.einsum("psk,pskd->psd", stencil.weights, of_nodes))


def middle(joints: Joints, sides: Array, ground: Array | float = 0.0) -> Array:
    """Mean displacement of both sides at joint points; on rigid ground that of `ground`."""
    on_ground = joints.bodies[:, :1] == GROUND
    return np.where(on_ground, ground, sides.mean(axis=1))


def mode_scale(layout: Layout, mode: Array) -> float:
    """Factor that makes the largest displacement of a mode `AMPLITUDE` of the structure's size."""
    boundary = layout.boundary
    fastest = np.linalg.norm(at_nodes(layout, mode, boundary.nodes), axis=2).max()
    size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
    return AMPLITUDE * size / (float(fastest) or 1.0)


def cell_stresses(layout: Layout, displacement: Array) -> Array:
    """sigma_xx, sigma_yy, sigma_xy and von Mises stress in this rank's cells, Pa, shape (cells, 4).

    At the centres of the cells. In plane strain, von Mises has the stress out of the plane,
    nu (sigma_x + sigma_y). With a stress law of the scene it is left out, shape (cells, 3).
    """
    scene = layout.scene
    law = layout.law
    function = displacement_function(layout, displacement, "displacement")
    expression, space = stress_expression(function, law, scene.plane)
    together = fem.Function(space)
    together.interpolate(expression)
    return together.x.array.reshape(-1, space.dofmap.bs)[compat.cell_dofs(space)[:, 0]]


def principal_stresses(stress: Array) -> tuple[Array, Array]:
    """Principal stresses in the plane, the larger first, and the direction of the first.

    From sigma_xx, sigma_yy, sigma_xy, shape (..., 3); both results have the shape (..., 2). The
    second direction is normal to the first.
    """
    xx, yy, xy = np.moveaxis(stress, -1, 0)
    mean = 0.5 * (xx + yy)
    radius = np.hypot(0.5 * (xx - yy), xy)
    angle = 0.5 * np.arctan2(xy, 0.5 * (xx - yy))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.stack([mean + radius, mean - radius], axis=-1), direction


def write_blocks(
    path: Path, layout: Layout, displacement: Array, elastic: Array, mode: Array | None
) -> None:
    """Write displacement and collapse mode by node, stresses and numbers by cell, as a .pvd file.

    Collective. `elastic` is the displacement without a large motion, in which digits of stresses
    would be lost. The mode is scaled by `mode_scale`, which is in the files too; without a mode
    both are left out.

    Raises:
        OutputError: On all ranks, with the reason, if a file cannot be written.
    """
    comm = layout.scene.comm
    moving = {"displacement": displacement}
    numbers = {}
    if mode is not None:
        scale = mode_scale(layout, mode)
        moving["collapse_mode"] = scale * mode
        numbers["mode_scale"] = scale
    functions = [displacement_function(layout, u, name) for name, u in moving.items()]
    functions += _cell_functions(layout, elastic)
    _write(path, comm, [(0.0, functions)], [numbers])


def write_series(path: Path, layout: Layout, points: Sequence[CapacityPoint]) -> None:
    """Write the displacements along a capacity curve as a .pvd file with a time for every point.

    Collective. The time is the mean displacement along the live load, mm, or the number of the
    point where that does not rise; "load_factor" is in the files too.

    Raises:
        OutputError: On all ranks, with the reason, if a file cannot be written.
    """
    points = [point for point in points if point.motion is not None]
    comm = layout.scene.comm
    times = [1e3 * point.displacement for point in points]
    if np.any(np.diff(times) <= 0.0):
        times = [float(number) for number in range(len(points))]
    steps = (
        (time, [displacement_function(layout, point.motion, "displacement")])
        for time, point in zip(times, points, strict=True)
        if point.motion is not None
    )
    _write(path, comm, steps, [{"load_factor": point.load_factor} for point in points])


def _write(
    path: Path,
    comm: MPI.Comm,
    steps: Iterable[tuple[float, list[fem.Function]]],
    numbers: Sequence[Mapping[str, float]],
) -> None:
    """Write functions at times as a .pvd file, with numbers of every time. Collective."""
    with writing(comm):
        compat.write_vtk(path, comm, steps)
    with writing(comm):
        if comm.rank == 0:
            compat.tidy_vtk(path, numbers)


def _cell_functions(layout: Layout, elastic: Array) -> list[fem.Function]:
    """Stresses, principal stresses with the direction of the second, block and material."""
    mesh = layout.scene.mesh
    stress = cell_stresses(layout, elastic)
    values, first = principal_stresses(stress[:, :3])
    names = "stress_xx", "stress_yy", "stress_xy", "von_mises"
    columns = dict(zip(names[: stress.shape[1]], stress.T, strict=True))
    columns |= {"principal_1": values[:, 0], "principal_2": values[:, 1]}
    # dolfinx 0.5 writes no vectors by cell.
    columns |= {"direction_2_x": -first[:, 1], "direction_2_y": first[:, 0]}
    columns |= {"body": mesh.body, "material": material_numbers(layout)[mesh.cell_groups]}
    return [cell_field(mesh, name, value) for name, value in columns.items()]


def material_numbers(layout: Layout) -> Indices:
    """Number of the material, in the scene's order, for every set of groups of cells."""
    scene = layout.scene
    names = list(scene.materials)
    found = [names.index(scene.material_name(groups)) for groups in scene.mesh.cell_sets]
    return np.array(found, dtype=np.int64)


def facet_contact(values: JointValues, segments: Indices) -> npt.NDArray[np.int64]:
    """`Contact` of joint facets: open if an end is open, else slipping if an end slips."""
    contact = values.contact[segments]
    state = np.where(np.any(contact == Contact.SLIP, axis=1), Contact.SLIP, Contact.STICK)
    return np.where(np.any(contact == Contact.OPEN, axis=1), Contact.OPEN, state)


def write_joints(
    path: Path,
    layout: Layout,
    values: JointValues,
    displacement: Array,
    mode: Array | None,
    about: str = "",
) -> None:
    """Write the joints as lines, an XML file of VTK, on rank 0. Collective.

    By point: "pressure" and "shear" in Pa, "gap" and "slip" in m, "displacement" (mean of both
    sides) and "collapse_mode", which moves the lines with the blocks; it and the rates are scaled
    by "mode_scale"; without a mode they are left out. By line: "state" 0 open, 1 slip, 2 stick;
    "group" and "friction" of its law. A comment has what there is to say `about` the state.

    Raises:
        OutputError: On all ranks, with the reason, if the file cannot be written.
    """
    joints = layout.joints.without_ties()
    count = joints.joint_count
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
    first = joints.segments[:, 0]
    lines = {"state": facet_contact(values, joints.segments), "group": joints.law[first]}
    lines |= {"friction": joints.friction[first]}
    cells = {"connectivity": joints.segments.ravel(), "offsets": 2 * np.arange(1, len(first) + 1)}
    cells["types"] = np.full(len(first), VTK_LINE, dtype=np.uint8)
    file = Element("VTKFile", type="UnstructuredGrid", version="0.1", byte_order="LittleEndian")
    file.append(Comment(f" {about};" * bool(about) + _numbers_in_words(joints)))
    grid = SubElement(file, "UnstructuredGrid")
    _add_arrays(grid, "FieldData", numbers)
    sizes = {"NumberOfPoints": str(len(joints.position)), "NumberOfCells": str(len(first))}
    piece = SubElement(grid, "Piece", sizes)
    _add_arrays(piece, "Points", {"points": joints.position})
    for section, columns in (("Cells", cells), ("PointData", points), ("CellData", lines)):
        _add_arrays(piece, section, columns)
    with writing(layout.scene.comm):
        if layout.scene.comm.rank == 0:
            ElementTree(file).write(path, encoding="us-ascii", xml_declaration=True)


def _numbers_in_words(joints: Joints) -> str:
    """What the numbers of states and groups mean."""
    states = ", ".join(f"{contact.value} {contact.name.lower()}" for contact in Contact)
    groups = ", ".join(f"{k} {name}" for k, name in enumerate(joints.names))
    # XML allows no two hyphens in a comment.
    return f" state: {states}; group: {groups.replace('--', '- -')} "


def _add_arrays(parent: Element, section: str, columns: Mapping[str, npt.NDArray[Any]]) -> None:
    """Add a section with arrays of numbers; those with two columns are vectors in the plane."""
    added = SubElement(parent, section)
    for name, values in columns.items():
        table = values.reshape(len(values), -1)
        if table.shape[1] == 2:
            table = np.column_stack([table, np.zeros(len(table))])
        kind = {"i": "Int64", "u": "UInt8", "f": "Float64"}[values.dtype.kind]
        form = {"type": kind, "Name": name, "format": "ascii"}
        form |= {"NumberOfTuples": str(len(table)), "NumberOfComponents": str(table.shape[1])}
        array = SubElement(added, "DataArray", form)
        array.text = " ".join(f"{value:.12g}" for value in table.ravel())
