"""Pictures of a result: how the blocks move, what the joints carry, the capacity curve."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.analysis.rigid_blocks import straight_faces
from fenics_contact.output.joint_fields import OPEN, SLIP, SLIPPING, STICK, JointFields
from fenics_contact.discretization.discretization import Structure

if TYPE_CHECKING:
    from fenics_contact.limit_load import Collapse, LimitLoad

Array = npt.NDArray[np.float64]

#: Largest displacement in the picture, as a fraction of the structure's size.
AMPLITUDE = 0.08

COLOURS = {OPEN: "#d62728", SLIP: "#ff7f0e", STICK: "#1f77b4"}


def draw_collapse(
    result: LimitLoad, collapse: Collapse, fields: JointFields, path: Path, reverse: bool
) -> None:
    """Draw the collapse mode, and the joint forces at collapse.

    Collective; drawn on rank 0.

    Args:
        result: Whose structure it is.
        collapse: A collapse with a mode.
        fields: Its joints.
        path: A file name ending in .png.
        reverse: Whether it is that of the live load reversed.
    """
    if collapse.mode is None:
        return
    structure = result.structure
    motion = _at_boundary(structure, collapse.mode)
    if structure.scene.comm.rank != 0:
        return
    figure, (left, right) = _axes(structure, 2)
    _draw_mode(left, structure, fields, motion, reverse)
    _draw_forces(right, structure, fields)
    sign = " (live load reversed)" if reverse else ""
    head = f"{result.scene.title}: " if result.scene.title else ""
    value = f"load factor {collapse.load_factor:.5g}{sign}"
    if collapse.status != "limit":
        value = f"{collapse.status.replace('_', ' ')}, {value}"
    figure.suptitle(f"{head}{value}   ({collapse.bounds})", fontsize=13)
    figure.savefig(path, dpi=150)
    _close(figure)


def draw_capacity(result: LimitLoad, path: Path) -> None:
    """Draw load factor against displacement, on the rank that calls.

    Args:
        result: A result with a capacity curve.
        path: A file name ending in .png.
    """
    plt = _pyplot()
    figure, axes = plt.subplots(figsize=(7.0, 4.5), layout="constrained")
    displacement = [1e3 * point.displacement for point in result.capacity]
    factor = [point.load_factor for point in result.capacity]
    axes.plot(displacement, factor, "o-", color="#1f77b4", markersize=4, label="equilibrium states")
    collapse = result.collapse
    if collapse is not None and np.isfinite(collapse.load_factor):
        limit = abs(collapse.load_factor)
        axes.axhline(limit, color="#d62728", linestyle="--", label=f"limit load {limit:.5g}")
    axes.set_xlabel("mean displacement along the live load (mm)")
    axes.set_ylabel("load factor")
    axes.set_title(result.scene.title or "Capacity curve")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=150)
    _close(figure)


def _pyplot() -> Any:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def _close(figure: Any) -> None:
    _pyplot().close(figure)


def _axes(structure: Structure, count: int) -> tuple[Any, Any]:
    """Axes of the structure's shape side by side."""
    points = structure.boundary.points.reshape(-1, 2)
    width, height = np.ptp(points, axis=0)
    each = 6.0
    tall = float(np.clip(each * height / width, 2.5, 9.0))
    figure, axes = _pyplot().subplots(
        1, count, figsize=(each * count, tall + 1.4), layout="constrained"
    )
    margin = 1.3 * AMPLITUDE * max(width, height)
    for one in axes:
        one.set_aspect("equal")
        one.axis("off")
        one.set_xlim(points[:, 0].min() - margin, points[:, 0].max() + margin)
        one.set_ylim(points[:, 1].min() - margin, points[:, 1].max() + margin)
    return figure, axes


def _at_boundary(structure: Structure, vector: PETSc.Vec) -> dict[str, Array]:
    """Displacement at the ends of boundary facets and at both sides of joint points.

    Returns:
        "facets" of shape (facets, 2, 2) and "joints" of shape (points, 2, 2); zero on the ground.
    """
    start, end = (bound // 2 for bound in vector.getOwnershipRange())
    values = structure.supports.to_cartesian(vector.array_r, start).reshape(-1, 2)
    motion = {}
    for name, nodes in (
        ("facets", structure.boundary.nodes[:, :2]),
        ("joints", structure.joints.nodes),
    ):
        mine = (nodes >= start) & (nodes < end)
        moved = np.zeros((*nodes.shape, 2))
        moved[mine] = values[nodes[mine] - start]
        structure.scene.comm.Allreduce(MPI.IN_PLACE, moved, MPI.SUM)
        motion[name] = moved
    return motion


def _outlines(structure: Structure, ends: Array) -> list[tuple[int, Any]]:
    """Closed paths around every body, (body, matplotlib path), for given facet ends."""
    from matplotlib.path import Path as Outline

    boundary = structure.boundary
    # Run along every facet with the block on the left: tangent = normal turned anticlockwise.
    along = boundary.points[:, 1] - boundary.points[:, 0]
    turned = np.column_stack([-boundary.normal[:, 1], boundary.normal[:, 0]])
    forward = np.sum(along * turned, axis=1) > 0.0
    order = np.where(forward[:, None], [0, 1], [1, 0])
    nodes = np.take_along_axis(boundary.nodes[:, :2], order, axis=1)
    points = np.take_along_axis(ends, order[:, :, None], axis=1)
    outlines = []
    for body in np.unique(boundary.body):
        rows = np.flatnonzero(boundary.body == body)
        leaving = {int(nodes[row, 0]): int(row) for row in rows}
        corners: list[Array] = []
        codes: list[int] = []
        while leaving:
            _, row = leaving.popitem()
            first = len(corners)
            corners.append(points[row, 0])
            while True:
                corners.append(points[row, 1])
                following = leaving.pop(int(nodes[row, 1]), None)
                if following is None:
                    break
                row = following
            codes += [int(Outline.MOVETO)] + [int(Outline.LINETO)] * (len(corners) - first - 1)
        outlines.append((int(body), Outline(np.array(corners), codes)))
    return outlines


def _draw_mode(
    axes: Any,
    structure: Structure,
    fields: JointFields,
    motion: dict[str, Array],
    reverse: bool,
) -> None:
    from matplotlib.collections import LineCollection, PathCollection
    from matplotlib.lines import Line2D

    boundary, joints = structure.boundary, structure.joints
    size = np.ptp(boundary.points.reshape(-1, 2), axis=0).max()
    largest = np.linalg.norm(motion["facets"], axis=2).max() or 1.0
    scale = AMPLITUDE * size / largest
    at_rest = _outlines(structure, boundary.points[:, :2])
    axes.add_collection(
        PathCollection([p for _, p in at_rest], facecolor="none", edgecolor="0.75", linewidth=0.6)
    )
    moved = _outlines(structure, boundary.points[:, :2] + scale * motion["facets"])
    speed = np.zeros(int(boundary.body.max()) + 1)
    np.maximum.at(speed, boundary.body, np.linalg.norm(motion["facets"], axis=2).max(axis=1))
    shade = _pyplot().get_cmap("YlGnBu")(0.05 + 0.4 * speed / largest)
    shade[speed < 1e-3 * largest] = (0.88, 0.88, 0.88, 1.0)
    axes.add_collection(
        PathCollection(
            [path for _, path in moved],
            facecolor=[shade[body] for body, _ in moved],
            edgecolor="0.35",
            linewidth=0.5,
        )
    )
    # A joint is drawn between its two sides.
    on_ground = joints.nodes[:, 0] < 0
    middle = motion["joints"].sum(axis=1) / 2.0
    middle[on_ground] = 0.0
    position = joints.position + scale * middle
    state = fields.state[joints.segments]
    kind = np.where(
        np.any(state == OPEN, axis=1), OPEN, np.where(np.any(state == SLIP, axis=1), SLIP, STICK)
    )
    fastest = max(np.abs(fields.opening_rate).max(), np.abs(fields.slip_rate).max())
    opening = np.any(fields.opening_rate[joints.segments] > SLIPPING * fastest, axis=1)
    handles = []
    for label, colour, width, chosen in (
        ("closed", COLOURS[STICK], 0.8, kind == STICK),
        ("open, at rest", COLOURS[OPEN], 0.8, (kind == OPEN) & ~opening),
        ("slips", COLOURS[SLIP], 2.2, kind == SLIP),
        ("opens", COLOURS[OPEN], 2.2, (kind == OPEN) & opening),
    ):
        segments = position[joints.segments[chosen]]
        axes.add_collection(LineCollection(segments, colors=colour, linewidths=width))
        handles.append(Line2D([], [], color=colour, lw=width, label=label))
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4, fontsize=9,
        frameon=False,
    )  # fmt: skip
    _draw_live_load(axes, structure, reverse)
    axes.set_title("collapse mode (grey outline: at rest; shaded: moving)", fontsize=10)


def _draw_live_load(axes: Any, structure: Structure, reverse: bool) -> None:
    """An arrow along the resultant of the live load, through the corner it comes from."""
    resultant = structure.bodies.live[:, :2].sum(axis=0) * (-1.0 if reverse else 1.0)
    size = np.linalg.norm(resultant)
    if size <= 1e-9 * np.abs(structure.bodies.live).max():
        return
    along = resultant / size
    start = np.where(along > 0.3, 0.02, np.where(along < -0.3, 0.98, 0.06))
    if abs(along[0]) > 0.3:
        start[1] = 0.97
    end = start + 0.12 * along
    style = {"arrowstyle": "-|>", "color": "0.2", "lw": 1.6}
    axes.annotate("", end, start, xycoords="axes fraction", arrowprops=style)
    left = along[0] < -0.3
    axes.text(
        end[0] - 0.02 if left else end[0] + 0.02,
        end[1] - 0.01,
        "live load",
        ha="right" if left else "left",
        transform=axes.transAxes,
        fontsize=9,
    )


def _draw_forces(axes: Any, structure: Structure, fields: JointFields) -> None:
    """Resultant of every face, drawn through its centre of pressure, length by size."""
    from matplotlib.collections import LineCollection, PathCollection

    joints = structure.joints
    at_rest = _outlines(structure, structure.boundary.points[:, :2])
    axes.add_collection(
        PathCollection([p for _, p in at_rest], facecolor="0.95", edgecolor="0.6", linewidth=0.5)
    )
    force = (
        fields.normal_force[:, None] * joints.normal + fields.shear_force[:, None] * joints.tangent
    )
    face = straight_faces(joints, joints.length).of_point
    count = int(face.max(initial=-1)) + 1
    total = np.column_stack([np.bincount(face, force[:, d], count) for d in range(2)])
    weight = np.bincount(face, fields.normal_force, count)
    loaded = weight > 1e-6 * weight.max(initial=0.0)
    centre = (
        np.column_stack(
            [
                np.bincount(face, fields.normal_force * joints.position[:, d], count)
                for d in range(2)
            ]
        )[loaded]
        / weight[loaded, None]
    )
    size = np.linalg.norm(total, axis=1)[loaded]
    if len(size) == 0:
        return
    block = np.sqrt(structure.bodies_area() / structure.scene.mesh.body_count)
    reach = total[loaded] / size.max() * 0.9 * block
    shown = 0.25 + 0.75 * size / size.max()
    lines = np.stack([centre - 0.5 * reach, centre + 0.5 * reach], axis=1)
    axes.add_collection(LineCollection(lines, colors="#7b2d8b", linewidths=2.6 * shown))
    axes.plot(*centre.T, ".", color="#7b2d8b", markersize=3)
    axes.set_title("joint forces at collapse (length by size)", fontsize=10)
