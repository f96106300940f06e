"""Pictures of a result: collapse mode, joint forces, lines of thrust, stresses, capacity curve.

Every `draw_...` draws on given matplotlib axes, on this rank, and returns them; `save_...` makes
the files of a result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fenics_contact.analysis.history import CapacityPoint
from fenics_contact.mesh import Array, Indices
from fenics_contact.output.drawing import (
    BLACK,
    BLUE,
    VERMILLION,
    Limits,
    draw_joints,
    draw_live_load,
    draw_moved,
    draw_outlines,
    draw_rest,
    draw_scale,
    fineness,
    force_scale,
    legend,
    material_handles,
    moved,
    outlines,
    prepare,
)
from fenics_contact.output.fields import principal_stresses
from fenics_contact.output.stress_raster import StressRaster
from fenics_contact.output.thrust import face_resultants, thrust_lines
from fenics_contact.output.view import View

#: Width of the axes of a structure, and limits of their height, inches.
WIDTH, HEIGHTS = 6.0, (1.2, 9.0)
#: Blocks that are numbered in a picture.
LEGIBLE = 60
#: Squares of the stress raster to a cross; stresses above this quantile have one colour.
PER_CROSS, LARGEST = 8, 0.98
FORCE = "#7b2d8b"


def draw_mode(axes: Any, view: View) -> Any:
    """The collapse mode: blocks displaced, joints by what they do, and the live load."""
    prepare(axes, Limits.of(view, moved(view)))
    draw_moved(axes, view)
    joints = draw_joints(axes, view)
    legend(axes, [*joints, *draw_live_load(axes, view), *material_handles(view)], 5)
    return axes


def draw_forces(axes: Any, view: View) -> Any:
    """Resultant of the joint forces on every face, through its centre of pressure, to scale.

    Raises:
        ValueError: If the view has no joint values.
    """
    from matplotlib.collections import LineCollection

    prepare(axes, Limits.of(view))
    draw_rest(axes, view)
    faces = face_resultants(view.joints, _values(view))
    total, centre = faces.force[faces.loaded], faces.centre[faces.loaded]
    if len(total):
        size = np.linalg.norm(total, axis=1)
        per_metre = force_scale(size, view)
        reach, fine = total / per_metre, fineness(axes, view)
        lines = np.stack([centre - 0.5 * reach, centre + 0.5 * reach], axis=1)
        widths = 2.4 * fine * (0.4 + 0.6 * size / size.max())
        axes.add_collection(LineCollection(lines, colors=FORCE, linewidths=widths))
        axes.plot(*centre.T, ".", color=FORCE, markersize=5.0 * fine**1.5)
        limits = Limits.of(view, lines)
        prepare(axes, limits)
        draw_scale(axes, view, limits.low, per_metre, float(size.max()), FORCE)
    legend(axes, material_handles(view))
    return axes


def draw_thrust(axes: Any, view: View) -> Any:
    """Lines of thrust, the wider the larger the force, with the joints that they cross.

    Raises:
        ValueError: If the view has no joint values.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    prepare(axes, Limits.of(view))
    draw_rest(axes, view)
    lines = thrust_lines(face_resultants(view.joints, _values(view)), view.centre)
    axes.add_collection(LineCollection(lines.ends, colors="0.3", linewidths=0.9))
    largest = float(lines.force.max(initial=0.0)) or 1.0
    widths = 0.6 + 2.4 * lines.force / largest
    style = {"colors": VERMILLION, "linewidths": widths, "capstyle": "round"}
    axes.add_collection(LineCollection(lines.segments, **style, zorder=3))
    axes.plot(*lines.centre.T, "o", color="white", mec=BLACK, mew=0.7, markersize=3.2, zorder=4)
    entries = [
        Line2D([], [], color=VERMILLION, lw=2.5, label="line of thrust"),
        Line2D([], [], color="white", marker="o", mec=BLACK, ls="none", label="centre of pressure"),
    ]
    legend(axes, [*entries, *draw_live_load(axes, view), *material_handles(view)])
    return axes


def draw_stress(axes: Any, view: View, raster: StressRaster) -> Any:
    """The larger compressive principal stress in colour, and crosses of both.

    Crosses are means over squares: black for compression, red for tension.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LinearSegmentedColormap

    prepare(axes, Limits.of(view))
    pressure = -principal_stresses(raster.stress)[0][..., 1]
    known = np.maximum(pressure[np.isfinite(pressure)], 0.0)
    largest = float(np.quantile(known, LARGEST)) or float(known.max()) or 1.0
    factor, unit = (1e6, "MPa") if largest >= 1e6 else (1e3, "kPa") if largest >= 1e3 else (1, "Pa")
    colours = LinearSegmentedColormap.from_list("pressure", ["#f7f7f2", "#8fbbdb", "#3d7fb5"])
    rows, columns = raster.area.shape
    x, y = np.stack([raster.corner, raster.corner + raster.step * np.array([columns, rows])]).T
    style = {"cmap": colours, "vmin": 0.0, "vmax": largest / factor, "origin": "lower"}
    image = axes.imshow(pressure / factor, extent=(*x, *y), interpolation="nearest", **style)
    rest = view.boundary.points[:, :2]
    clip = type(outlines(view.boundary, rest)[0]).make_compound_path(*outlines(view.boundary, rest))
    image.set_clip_path(clip, axes.transData)
    draw_outlines(axes, view.boundary, rest, facecolor="none", edgecolor="0.45", linewidth=0.5)
    compression, tension = _crosses(raster, largest)
    axes.add_collection(LineCollection(compression, colors=BLACK, linewidths=0.8))
    axes.add_collection(LineCollection(tension, colors=VERMILLION, linewidths=1.2))
    crosses = "; black: compression" + (", red: tension" if len(tension) else "")
    prepare(axes, Limits.of(view))
    style = {"location": "bottom", "extend": "max", "shrink": 0.7, "aspect": 35, "pad": 0.02}
    label = f"larger compressive principal stress ({unit}){crosses}"
    axes.figure.colorbar(image, ax=axes, **style).set_label(label, fontsize=9)
    return axes


def _crosses(raster: StressRaster, largest: float) -> tuple[Array, Array]:
    """Lines along principal stresses in compression and in tension, as long as these are large."""
    coarse = raster.coarser(PER_CROSS)
    full = coarse.area > 0.5 * coarse.step**2
    row, column = np.nonzero(full)
    centre = coarse.corner + coarse.step * (np.column_stack([column, row]) + 0.5)
    value, first = principal_stresses(coarse.stress[full])
    second = np.column_stack([-first[:, 1], first[:, 0]])
    value, centre = value.T.ravel(), np.tile(centre, (2, 1))
    reach = np.clip(np.abs(value) / largest, 0.0, 1.0)[:, None] * np.vstack([first, second])
    lines = np.stack([centre - 0.45 * coarse.step * reach, centre + 0.45 * coarse.step * reach], 1)
    long = np.abs(value) > 0.05 * largest
    return lines[long & (value < 0.0)], lines[long & (value > 0.0)]


def draw_capacity(axes: Any, points: Sequence[CapacityPoint], limit: float = math.nan) -> Any:
    """The capacity curve: load factor over displacement."""
    curve = [(1e3 * point.displacement, point.load_factor) for point in points]
    axes.plot(*np.transpose(curve), "o-", color=BLUE, markersize=4, label="equilibrium states")
    if np.isfinite(limit):
        text = f"limit load {rounded_alike([limit])[0]}"
        axes.axhline(limit, color=VERMILLION, linestyle="--", label=text)
    axes.set(ylabel="load factor", xlabel="mean displacement along the live load (mm)")
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    return axes


def draw_marked(axes: Any, view: View, blocks: Indices) -> Any:
    """Some blocks, shaded and with their numbers, among all, displaced as the view says."""
    prepare(axes, Limits.of(view, moved(view)))
    boundary = view.boundary
    rest = boundary.points[:, :2]
    shade = np.full((len(view.centre), 3), 0.92)
    shade[blocks] = (0.93, 0.75, 0.45)
    draw_outlines(axes, boundary, rest, facecolor="none", edgecolor="0.7", linewidth=0.5)
    style = {"facecolor": shade, "edgecolor": "0.35", "linewidth": 0.5}
    draw_outlines(axes, boundary, moved(view), **style)
    for block in blocks[:LEGIBLE]:
        place = moved(view)[boundary.body == block]
        axes.text(*place.mean(axis=(0, 1)), str(block), fontsize=7, ha="center", va="center")
    return axes


def _values(view: View) -> Any:
    """Joint values of a view that has them."""
    if view.values is None:
        raise ValueError("there are no joint forces: no state was found")
    return view.values


def rounded_alike(numbers: Sequence[float], digits: int = 5) -> list[str]:
    """Numbers with as many decimals as the first one needs for its leading digits."""
    first = abs(numbers[0]) if math.isfinite(numbers[0]) else 0.0
    exponent = math.floor(math.log10(first)) if first > 0.0 else 0
    if exponent < -4 or exponent > 8:
        form = f".{digits - 1}e"
    else:
        form = f".{max(digits - 1 - exponent, 0)}f"
    return [format(number, form) if number else "0" for number in numbers]


# ---- files


def new_axes() -> Any:
    """Axes of a figure of their own, which a notebook shows."""
    from matplotlib import pyplot

    return pyplot.subplots(figsize=(7.0, 4.5), layout="constrained")[1]


def figure_of(limits: Limits, count: int = 1) -> tuple[Any, Any]:
    """A figure with axes of a structure's shape side by side."""
    from matplotlib.figure import Figure

    width, height = limits.shape
    tall = float(np.clip(WIDTH * height / width, *HEIGHTS))
    wide = min(WIDTH, tall * width / height)
    figure = Figure(figsize=(count * max(wide, 3.2), tall + 1.1), layout="constrained")
    return figure, figure.subplots(1, count, squeeze=False)[0]


def save_collapse(view: View, title: str, paths: Sequence[Path | BinaryIO]) -> None:
    """Collapse mode and joint forces, side by side."""
    figure, (left, right) = figure_of(Limits.of(view, moved(view)), 2)
    draw_mode(left, view).set_title("collapse mode (grey outline: at rest)", fontsize=10)
    draw_forces(right, view).set_title("joint forces at collapse", fontsize=10)
    _save(figure, title, paths)


def save_thrust(view: View, title: str, paths: Sequence[Path]) -> None:
    """Lines of thrust."""
    figure, (axes,) = figure_of(Limits.of(view))
    draw_thrust(axes, view).set_title("line of thrust at collapse (width: force)", fontsize=10)
    _save(figure, title, paths)


def save_stress(view: View, raster: StressRaster, title: str, paths: Sequence[Path]) -> None:
    """Principal stresses."""
    figure, (axes,) = figure_of(Limits.of(view))
    draw_stress(axes, view, raster).set_title("principal stresses at collapse", fontsize=10)
    _save(figure, title, paths)


def save_marked(view: View, blocks: Indices, title: str, paths: Sequence[Path]) -> None:
    """Some blocks with their numbers among all."""
    figure, (axes,) = figure_of(Limits.of(view, moved(view)))
    draw_marked(axes, view, blocks)
    axes.set_title("shaded: blocks, by number; grey outline: at rest", fontsize=10)
    _save(figure, title, paths)


def save_capacity(
    points: Sequence[CapacityPoint], limit: float, title: str, paths: Sequence[Path]
) -> None:
    """The capacity curve."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    draw_capacity(figure.subplots(), points, limit)
    _save(figure, title or "Capacity curve", paths)


def _save(figure: Any, title: str, paths: Sequence[Path | BinaryIO]) -> None:
    """Write a figure with its title and tight margins."""
    figure.suptitle(title, fontsize=12)
    for path in paths:
        figure.savefig(path, dpi=150, bbox_inches="tight", pad_inches=0.08)
