"""Files of the way after the peak: the curve as a table and a picture, poses for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.motion.beyond import Beyond
from fenics_contact.motion.path import BeyondPoint
from fenics_contact.output.figures import picture_paths
from fenics_contact.output.folder import drawing
from fenics_contact.output.plotting import BLUE, DPI, VERMILLION, save_figure
from fenics_contact.results.block_view import BlockView
from fenics_contact.spatial.picture import VIEWS, axes_to, draw_view
from fenics_contact.spatial.polyhedra import Polyhedron
from fenics_contact.spatial.vtu import write_series

#: Poses that the picture shows, in parts of the way.
SHOWN = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
#: Poses that the viewer goes through.
VIEWED = 25
#: Inches.
CURVE, POSE, HIGH = 4.2, 2.4, 4.6


def write_table(beyond: Beyond, path: Path) -> None:
    """Write the points as CSV."""
    path.write_text("\n".join([*beyond.rows(), ""]), encoding="utf-8")


def posed(view: BlockView, point: BeyondPoint) -> BlockView:
    """The blocks of a view in the pose of a point, at rest."""
    bodies = view.bodies
    poses = point.poses
    pieces = [
        Polyhedron(poses.placed(np.full(len(piece.corners), block), arms), piece.sides)
        for piece, block in zip(bodies.pieces, bodies.of_piece.tolist(), strict=True)
        for arms in [piece.corners - bodies.centroid[block]]
    ]
    ends = view.tie_ends.copy()
    for end in (0, 1):
        numbers = view.tie_blocks[:, end]
        drawn = np.vstack([bodies.centroid, np.zeros(3)])[numbers]
        ends[:, end] = poses.placed(numbers, ends[:, end] - drawn)
    moved = replace(bodies, pieces=pieces, centroid=poses.centroid[:-1])
    nothing = {"motion": np.zeros_like(view.motion), "loads": {}}
    return replace(view, bodies=moved, tie_ends=ends, **nothing)


def with_way(beyond: Beyond, view: BlockView) -> BlockView:
    """A view with poses along the way."""
    from scipy.spatial.transform import Rotation

    way = []
    for point in shown_points(beyond, np.linspace(0.0, 1.0, VIEWED).tolist()):
        shift = point.poses.centroid[:-1] - view.bodies.centroid
        turn = Rotation.from_matrix(point.poses.rotation[:-1]).as_rotvec()
        carried = beyond.told(point.load_factor)
        way.append((point.displacement, carried, np.hstack([shift, turn])))
    return replace(view, way=way, way_unit=beyond.unit)


def shown_points(beyond: Beyond, parts: Sequence[float] = SHOWN) -> list[BeyondPoint]:
    """Points at parts of the way, each once."""
    points = beyond.fine.points
    here = np.array([point.displacement for point in points])
    numbers = [int(np.abs(here - part * here[-1]).argmin()) for part in parts]
    return [points[number] for number in dict.fromkeys(numbers)]


def write_poses(beyond: Beyond, view: BlockView, folder: Path) -> None:
    """Write beyond.pvd with the poses at tenths of the way, at their displacements."""
    shown = shown_points(beyond, np.linspace(0.0, 1.0, 11).tolist())
    poses = ((point.displacement, posed(view, point).bodies.corner) for point in shown)
    write_series(folder / f"beyond{view.suffix}", view, poses)


def draw_beyond(
    beyond: Beyond, view: BlockView, folder: Path, formats: Sequence[str] = ("png",)
) -> None:
    """Write beyond.png: the curve by both paths, and poses; in the plane what presses, too.

    Raises:
        OSError: If a file cannot be written.
        DrawingError: If matplotlib fails.
    """
    from matplotlib.figure import Figure

    name = f"beyond{view.suffix}"
    *_, eye = VIEWS[view.bodies.dimension].values()
    turn = axes_to(eye)
    points = shown_points(beyond)
    with drawing(name):
        figure = Figure(figsize=(CURVE + 2.0 * POSE, HIGH), dpi=DPI, layout="constrained")
        grid = figure.add_gridspec(2, 3, width_ratios=[CURVE, POSE, POSE])
        _draw_curve(figure.add_subplot(grid[:, 0]), beyond, points)
        for number, point in enumerate(points):
            axes = figure.add_subplot(grid[number // 2, 1 + number % 2])
            draw_view(axes, posed(view, point), turn)
            if len(VIEWS[view.bodies.dimension]) == 1:  # in space blocks are before the points
                axes.plot(*(point.pressed @ turn[:2].T).T, ".", color=VERMILLION, ms=3.0)
            axes.set_title(
                f"{point.displacement:.3g} m: {beyond.amount(point.displacement)}", fontsize=9
            )
        title = f"{view.title}\nafter the peak" if view.title else "after the peak"
        save_figure(figure, title, picture_paths(folder / name, formats))


def _draw_curve(axes: Any, beyond: Beyond, shown: Sequence[BeyondPoint]) -> None:
    """Load factor over displacement, by both paths."""
    scale = 1e-3 if beyond.driven else 1.0
    for trace, style, label in (
        (beyond.coarse, "--", "steps twice as long"),
        (beyond.fine, "-", "what is told"),
    ):
        here, factor = trace.curve
        axes.plot(here, scale * factor, style, color=BLUE, lw=1.4, label=label)
    marks = [(point.displacement, scale * point.load_factor) for point in shown]
    axes.plot(*np.transpose(marks), "o", color=VERMILLION, ms=4.0)
    if not beyond.agrees:
        axes.axvline(beyond.until, color="0.5", lw=0.8, ls=":", label="the two part")
    axes.set(
        xlabel="displacement of the control point (m)",
        ylabel="force along the ground's way (kN)" if beyond.driven else "load factor",
        ylim=(min(0.0, axes.get_ylim()[0]), None),
    )
    axes.locator_params(axis="x", nbins=6)
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
