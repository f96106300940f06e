"""Pictures of a result: how the blocks move, what the joints carry, the capacity curve."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact.analysis.hinges import hinges
from fenics_contact.analysis.history import CapacityPoint
from fenics_contact.analysis.joint_values import Contact, JointValues
from fenics_contact.analysis.rigid_blocks import straight_faces
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.mesh import Array, Indices

#: Largest displacement in the picture, as a fraction of the structure's size.
AMPLITUDE = 0.08
#: Width of the axes of a structure, and limits of their height, inches.
WIDTH, HEIGHTS = 6.0, (2.5, 9.0)
#: Blocks that are numbered in a picture.
LEGIBLE = 60
RED, ORANGE, BLUE, PURPLE = "#d62728", "#ff7f0e", "#1f77b4", "#7b2d8b"


def draw_collapse(
    discretization: Discretization,
    mode: Array,
    values: JointValues,
    live: Array,
    title: str,
    path: Path,
) -> None:
    """Draw the collapse mode, and the joint forces at collapse, into a .png file. Collective.

    `mode` is this rank's part in the supports' coordinates, `live` are the resultants of the live
    load on the bodies, as it acts, shape (bodies, 2).
    """
    boundary, joints = discretization.boundary, discretization.joints
    velocity = discretization.cartesian(mode)
    at_facets = _at_nodes(discretization, velocity, boundary.nodes[:, :2])
    at_joints = _at_nodes(discretization, velocity, joints.nodes)
    if discretization.scene.comm.rank != 0:
        return
    figure, (left, right) = _figure_of(boundary)
    fastest = float(np.linalg.norm(at_facets, axis=2).max()) or 1.0
    scale = AMPLITUDE * float(_size(boundary).max()) / fastest
    _draw_blocks(left, boundary, scale * at_facets)
    _draw_joints(left, joints, values, scale * at_joints)
    _draw_hinges(left, joints, values, scale * at_joints)
    _draw_joint_legend(left)
    _draw_live_load(left, live)
    left.set_title("collapse mode (grey outline: at rest; shaded: moving)", fontsize=10)
    _draw_forces(right, discretization, values)
    right.set_title("joint forces at collapse (length by size)", fontsize=10)
    figure.suptitle(title, fontsize=13)
    figure.savefig(path, dpi=150)


def draw_blocks(
    discretization: Discretization,
    blocks: Indices,
    title: str,
    path: Path,
    mode: Array | None = None,
) -> None:
    """Draw some blocks with their numbers among all, into a .png file. Collective.

    With a mode, this rank's part in the supports' coordinates, the blocks move by it.
    """
    boundary = discretization.boundary
    motion = np.zeros((len(boundary.nodes), 2, 2))
    if mode is not None:
        velocity = discretization.cartesian(mode)
        motion = _at_nodes(discretization, velocity, boundary.nodes[:, :2])
        fastest = float(np.linalg.norm(motion, axis=2).max()) or 1.0
        motion *= AMPLITUDE * float(_size(boundary).max()) / fastest
    if discretization.scene.comm.rank != 0:
        return
    figure, (axes,) = _figure_of(boundary, 1)
    marked = np.zeros(int(boundary.body.max()) + 1)
    marked[blocks] = 1.0
    _draw_blocks(axes, boundary, motion, marked)
    for block in blocks[:LEGIBLE]:
        place = boundary.points[boundary.body == block, :2] + motion[boundary.body == block]
        axes.text(*place.mean(axis=(0, 1)), str(block), fontsize=7, ha="center", va="center")
    axes.set_title("shaded: blocks, by number; grey outline: at rest", fontsize=10)
    figure.suptitle(title, fontsize=13)
    figure.savefig(path, dpi=150)


def draw_capacity(points: Sequence[CapacityPoint], limit: float, title: str, path: Path) -> None:
    """Draw the capacity curve, load factor over displacement, into a .png file, on this rank."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = figure.subplots()
    curve = [(1e3 * point.displacement, point.load_factor) for point in points]
    axes.plot(*np.transpose(curve), "o-", color=BLUE, markersize=4, label="equilibrium states")
    if np.isfinite(limit):
        axes.axhline(limit, color=RED, linestyle="--", label=f"limit load {limit:.5g}")
    axes.set(title=title or "Capacity curve", ylabel="load factor")
    axes.set_xlabel("mean displacement along the live load (mm)")
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    figure.savefig(path, dpi=150)


def _size(boundary: Boundary) -> Array:
    """Width and height of the structure, m."""
    return np.ptp(boundary.points.reshape(-1, 2), axis=0)


def _figure_of(boundary: Boundary, count: int = 2) -> tuple[Any, Any]:
    """A figure with axes of the structure's shape side by side."""
    from matplotlib.figure import Figure

    width, height = _size(boundary)
    tall = float(np.clip(WIDTH * height / width, *HEIGHTS))
    figure = Figure(figsize=(count * WIDTH, tall + 1.4), layout="constrained")
    margin = 1.3 * AMPLITUDE * max(width, height)
    low, high = boundary.points.min(axis=(0, 1)), boundary.points.max(axis=(0, 1))
    x, y = np.column_stack([low - margin, high + margin])
    shape = {"aspect": "equal", "xlim": x, "ylim": y}
    row = figure.subplots(1, count, squeeze=False, subplot_kw=shape)[0]
    for axes in row:
        axes.axis("off")
    return figure, row


def _at_nodes(discretization: Discretization, velocity: Array, nodes: Indices) -> Array:
    """Velocities of this rank's nodes at a table of nodes, on all ranks; zero on the ground."""
    first, end = discretization.elasticity.space.dofmap.index_map.local_range
    mine = (nodes >= first) & (nodes < end)
    found = np.zeros((*nodes.shape, 2))
    found[mine] = velocity[nodes[mine] - first]
    discretization.scene.comm.Allreduce(MPI.IN_PLACE, found, MPI.SUM)
    return found


def _draw_outlines(axes: Any, boundary: Boundary, ends: Array, **style: Any) -> None:
    """Closed paths around all bodies, for given ends of the facets, shape (facets, 2, 2)."""
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Outline

    # Run along every facet with the block on the left.
    along = boundary.points[:, 1] - boundary.points[:, 0]
    forward = np.linalg.det(np.stack([boundary.normal, along], axis=1)) > 0.0
    order = np.where(forward[:, None], [0, 1], [1, 0])
    nodes = np.take_along_axis(boundary.nodes[:, :2], order, axis=1)
    points = np.take_along_axis(ends, order[:, :, None], axis=1)
    leaving = dict(zip(nodes[:, 0].tolist(), range(len(nodes)), strict=True))
    loops: list[list[Outline]] = [[] for _ in range(int(boundary.body.max()) + 1)]
    while leaving:  # a loop of facets; a body with a hole has more than one
        node, row = next(iter(leaving.items()))
        corners = [points[row, 0]]
        while node in leaving:
            row = leaving.pop(node)
            node = int(nodes[row, 1])
            corners.append(points[row, 1])
        loops[boundary.body[row]].append(Outline(np.array(corners)))
    outlines = [Outline.make_compound_path(*of_body) for of_body in loops]
    axes.add_collection(PathCollection(outlines, **style))


def _draw_blocks(axes: Any, boundary: Boundary, motion: Array, size: Array | None = None) -> None:
    """Outlines at rest, and the blocks displaced, shaded by a size: how far they move."""
    from matplotlib import colormaps

    rest = boundary.points[:, :2]
    if size is None:
        size = np.zeros(int(boundary.body.max()) + 1)
        np.maximum.at(size, boundary.body, np.linalg.norm(motion, axis=2).max(axis=1))
    relative = size / (size.max() or 1.0)
    shade = colormaps["YlGnBu"](0.05 + 0.4 * relative)
    shade[relative < 1e-3] = (0.88, 0.88, 0.88, 1.0)
    _draw_outlines(axes, boundary, rest, facecolor="none", edgecolor="0.75", linewidth=0.6)
    moved = rest + motion
    _draw_outlines(axes, boundary, moved, facecolor=shade, edgecolor="0.35", linewidth=0.5)


#: Joint facets by what they do: colour and line width.
JOINT_STYLES = {
    "closed": (BLUE, 0.8),
    "open, at rest": (RED, 0.8),
    "slips": (ORANGE, 2.2),
    "opens": (RED, 2.2),
}
#: Rings around hinges.
HINGE_STYLE = {"marker": "o", "ls": "", "mfc": "white", "mec": "black", "mew": 0.9, "ms": 4.5}


def _moved(joints: Joints, motion: Array) -> Array:
    """Joint points between their displaced sides."""
    middle = motion.mean(axis=1)
    middle[joints.nodes[:, 0] == GROUND] = 0.0
    return joints.position + middle


def _draw_joints(axes: Any, joints: Joints, values: JointValues, motion: Array) -> None:
    """Joint facets by what they do, drawn between their displaced sides."""
    from matplotlib.collections import LineCollection

    position = _moved(joints, motion)
    contact, opens = values.contact[joints.segments], values.opens[joints.segments]
    is_open = np.any(contact == Contact.OPEN, axis=1)
    slips = np.any(contact == Contact.SLIP, axis=1) & ~is_open
    opens = np.any(opens, axis=1) & is_open
    chosen = (~is_open & ~slips, is_open & ~opens, slips, opens)
    for (colour, width), facets in zip(JOINT_STYLES.values(), chosen, strict=True):
        segments = position[joints.segments[facets]]
        axes.add_collection(LineCollection(segments, colors=colour, linewidths=width))


def _draw_hinges(axes: Any, joints: Joints, values: JointValues, motion: Array) -> None:
    """Rings around the points that blocks turn about."""
    axes.plot(*_moved(joints, motion)[hinges(joints, values)].T, **HINGE_STYLE)


def _draw_joint_legend(axes: Any) -> None:
    """What the lines and rings of joints mean."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, lw=width, label=label)
        for label, (colour, width) in JOINT_STYLES.items()
    ]
    handles.append(Line2D([], [], label="hinge", **HINGE_STYLE))
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "ncols": len(handles)}
    axes.legend(handles=handles, **place, fontsize=9, frameon=False, columnspacing=1.2)


def _draw_live_load(axes: Any, force: Array) -> None:
    """An arrow along the resultant of forces on the bodies, at the corner it comes from."""
    resultant = force.sum(axis=0)
    size = np.linalg.norm(resultant)
    if size <= 1e-9 * np.abs(force).max():
        return
    along = resultant / size
    start = np.select([along > 0.3, along < -0.3], [0.02, 0.98], 0.06)
    if abs(along[0]) > 0.3:
        start[1] = 0.97
    end = start + 0.12 * along
    style = {"arrowstyle": "-|>", "color": "0.2", "lw": 1.6}
    axes.annotate("", end, start, xycoords="axes fraction", arrowprops=style)
    beside, align = (-0.02, "right") if along[0] < -0.3 else (0.02, "left")
    place = {"ha": align, "transform": axes.transAxes, "fontsize": 9}
    axes.text(end[0] + beside, end[1] - 0.01, "live load", **place)


def _draw_forces(axes: Any, discretization: Discretization, values: JointValues) -> None:
    """Resultant of every face, drawn through its centre of pressure, length by size."""
    from matplotlib.collections import LineCollection

    boundary, joints = discretization.boundary, discretization.joints
    rest = boundary.points[:, :2]
    _draw_outlines(axes, boundary, rest, facecolor="0.95", edgecolor="0.6", linewidth=0.5)
    face = straight_faces(joints, joints.length).of_point
    normal = values.normal_force[:, None]
    faces = np.zeros((int(face.max(initial=-1)) + 1, 5))
    np.add.at(faces, face, np.hstack([values.force(joints), normal, normal * joints.position]))
    faces = faces[faces[:, 2] > 1e-6 * faces[:, 2].max(initial=0.0)]
    if len(faces) == 0:
        return
    total, centre = faces[:, :2], faces[:, 3:] / faces[:, 2:3]
    size = np.linalg.norm(total, axis=1)
    block = np.sqrt(discretization.bodies_area() / discretization.scene.mesh.body_count)
    reach = 0.9 * block * total / size.max()
    lines = np.stack([centre - 0.5 * reach, centre + 0.5 * reach], axis=1)
    widths = 2.6 * (0.25 + 0.75 * size / size.max())
    axes.add_collection(LineCollection(lines, colors=PURPLE, linewidths=widths))
    axes.plot(*centre.T, ".", color=PURPLE, markersize=3)
