"""Pictures of a result: collapse mode, joint forces, lines of thrust, stresses, capacity curve.

Every `draw_...` draws on given matplotlib axes, on this rank, and returns them; `save` makes files.
"""

from __future__ import annotations

import io
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fenics_contact.errors import InputError
from fenics_contact.errors.checks import check_like
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.drawing import (
    BLACK,
    BLUE,
    VERMILLION,
    add_lines,
    draw_joints,
    draw_length,
    draw_live_load,
    draw_moved,
    draw_outlines,
    draw_rest,
    draw_scale,
    draw_ties,
    extent,
    fineness,
    force_scale,
    frame,
    legend,
    material_entries,
    name_tie_forces,
    outlines,
)
from fenics_contact.output.fields import principal_stresses
from fenics_contact.output.stress_raster import StressRaster
from fenics_contact.output.thrust import ThrustLines, face_resultants, thrust_lines
from fenics_contact.output.view import View
from fenics_contact.results.history import CapacityPoint
from fenics_contact.results.joint_values import JointValues
from fenics_contact.results.result import Collapse
from fenics_contact.scene.units import rounded_alike

#: Width of the axes of a structure, and limits of their width and height, inches.
WIDTH = 6.0
NARROWEST = 3.2
HEIGHTS = (1.2, 9.0)
#: Pixels per inch of files, and what is left free around a picture, inches.
DPI, MARGIN = 150, 0.08
#: Blocks that are numbered in a picture.
LEGIBLE = 60
#: Squares of the stress raster to a cross; the stress that ends the colours is this quantile of
#: all, and crosses are drawn from this part of it.
PER_CROSS, LARGEST, LEAST = 8, 0.98, 0.1
FORCE = "#7b2d8b"

#: Draws on axes what a view shows.
Draw = Callable[[Any, View], Any]


def draw_mode(axes: Any, view: View) -> Any:
    """Blocks displaced, joints by what they do, and the live load; or some blocks, marked."""
    if view.marked is not None:
        return draw_marked(axes, view)
    frame(axes, view, view.moved)
    draw_moved(axes, view)
    entries = [*draw_joints(axes, view), *draw_ties(axes, view, view.moved_ties)]
    entries += draw_live_load(axes, view)
    draw_length(axes, view)
    legend(axes, [*entries, *material_entries(axes, view)])
    motion = view.caption.motion.format(f"{float(f'{view.scale:.3g}'):g}")
    axes.set_title(f"{motion} (grey outline: at rest)", fontsize=10)
    return axes


def draw_forces(axes: Any, view: View) -> Any:
    """Resultant of the joint forces on every face, through its centre of pressure, to scale.

    Raises:
        ValueError: If the view has no joint values.
    """
    faces = face_resultants(view.joints, _values(view))
    total = faces.force[faces.acting]
    centre = faces.centre[faces.acting]
    frame(axes, view)
    draw_rest(axes, view)
    if len(total):
        size = np.linalg.norm(total, axis=1)
        per_metre = force_scale(size, view)
        lines = centre[:, None] + np.array([[-0.5], [0.5]]) * (total / per_metre)[:, None]
        frame(axes, view, lines)
        fine = fineness(axes, view)
        widths = 2.4 * fine * (0.4 + 0.6 * size / size.max())
        add_lines(axes, lines, colors=FORCE, linewidths=widths)
        axes.plot(*centre.T, ".", color=FORCE, markersize=5.0 * fine**1.5)
        draw_scale(axes, view, per_metre, float(size.max()), FORCE)
    if view.ties is not None:
        legend(axes, draw_ties(axes, view, view.ties.bars.sides))
        name_tie_forces(axes, view)
    axes.set_title(f"joint forces {view.caption.state}", fontsize=10)
    return axes


def draw_thrust(axes: Any, view: View) -> Any:
    """Lines of thrust, the wider the larger the force, with the joints that they cross.

    Those that do not reach the ground are left out, and all where most do not.

    Raises:
        ValueError: If the view has no joint values.
    """
    lines = whole_thrust(view)
    frame(axes, view)
    draw_rest(axes, view)
    fine = fineness(axes, view)
    add_lines(axes, lines.ends, colors="0.3", linewidths=0.9 * fine)
    widths = 0.6 + 2.4 * fine * lines.force / (lines.force.max(initial=0.0) or 1.0)
    style = {"colors": VERMILLION, "linewidths": widths, "capstyle": "round", "zorder": 3}
    add_lines(axes, lines.segments, **style)
    style = {"color": "white", "mec": BLACK, "mew": 0.7 * fine, "ls": "none", "zorder": 4}
    style |= {"marker": "o", "ms": 4.0 * max(fine, 0.5), "label": "centre of pressure"}
    entries: list[Any] = []
    if len(lines.segments):
        entries += axes.plot([], [], color=VERMILLION, lw=2.5, label="line of thrust")
        entries += axes.plot(*lines.centre.T, **style)
    if view.ties is not None:
        entries += draw_ties(axes, view, view.ties.bars.sides)
    draw_length(axes, view)
    legend(axes, [*entries, *draw_live_load(axes, view), *material_entries(axes, view)])
    title = f"line of thrust {view.caption.state} (width: force)"
    none = "few lines of thrust reach the ground: forces branch"
    axes.set_title(title if len(lines.segments) else none, fontsize=10)
    return axes


def whole_thrust(view: View) -> ThrustLines:
    """Lines of thrust that reach the ground, none where most do not.

    Raises:
        ValueError: If the view has no joint values.
    """
    return thrust_lines(face_resultants(view.joints, _values(view)), view.centre).whole()


def draw_stress(axes: Any, view: View, raster: StressRaster) -> Any:
    """The larger compressive principal stress in colour, and crosses of both.

    Crosses are means over squares: black for compression, wide and red for tension.
    """
    from matplotlib.colors import LinearSegmentedColormap

    frame(axes, view)
    pressure = -principal_stresses(raster.stress)[0][..., 1]
    known = np.maximum(pressure[np.isfinite(pressure)], 0.0)
    largest = float(np.quantile(known, LARGEST)) or float(known.max()) or 1.0
    factor, unit = (1e6, "MPa") if largest >= 1e6 else (1e3, "kPa") if largest >= 1e3 else (1, "Pa")
    colours = LinearSegmentedColormap.from_list("pressure", ["#f7f7f2", "#8fbbdb", "#3d7fb5"])
    size = raster.step * np.array(raster.area.shape[::-1])
    x, y = np.column_stack([raster.corner, raster.corner + size])
    style = {"cmap": colours, "vmin": 0.0, "vmax": largest / factor, "origin": "lower"}
    style |= {"extent": (*x, *y), "interpolation": "nearest"}
    image = axes.imshow(pressure / factor, **style)
    paths = outlines(view.boundary, view.rest)
    image.set_clip_path(type(paths[0]).make_compound_path(*paths), axes.transData)
    draw_outlines(axes, view.boundary, view.rest, facecolor="none")
    compression, tension = _crosses(raster, largest)
    add_lines(axes, compression, colors=BLACK, linewidths=0.8)
    add_lines(axes, tension, colors=VERMILLION, linewidths=1.6)
    draw_length(axes, view)
    crosses = "black: compression" + (", red and wide: tension" if len(tension) else "")
    style = {"location": "bottom", "extend": "max", "shrink": 0.7, "aspect": 35, "pad": 0.02}
    label = f"larger compressive principal stress ({unit})\n{crosses}"
    axes.figure.colorbar(image, ax=axes, panchor=False, **style).set_label(label, fontsize=9)
    axes.set_title(f"principal stresses {view.caption.stress or view.caption.state}", fontsize=10)
    return axes


def _crosses(raster: StressRaster, largest: float) -> tuple[Array, Array]:
    """Lines along principal stresses in compression and in tension, as long as these are large."""
    coarse = raster.coarser(PER_CROSS)
    full = coarse.area > 0.5 * coarse.step**2
    row, column = np.nonzero(full)
    centre = coarse.corner + coarse.step * (np.column_stack([column, row]) + 0.5)
    value, first = principal_stresses(coarse.stress[full])
    second = np.column_stack([-first[:, 1], first[:, 0]])
    value = value.T.ravel()
    centre = np.tile(centre, (2, 1))
    reach = np.clip(np.abs(value) / largest, 0.0, 1.0)[:, None] * np.vstack([first, second])
    half = 0.5 * coarse.step * reach
    lines = np.stack([centre - half, centre + half], 1)
    long = np.abs(value) > LEAST * largest
    return lines[long & (value < 0.0)], lines[long & (value > 0.0)]


def draw_capacity(
    axes: Any,
    points: Sequence[CapacityPoint],
    end: Collapse,
) -> Any:
    """The capacity curve to a collapse: load factor over displacement, with what answers mark."""
    limit = end.load_factor
    curve = [(1e3 * point.displacement, point.load_factor) for point in points if point.converged]
    missing = len(points) - len(curve)
    label = f"equilibrium states ({missing} not found)" if missing else "equilibrium states"
    axes.plot(*np.transpose(curve), "o-", color=BLUE, markersize=4, label=label)
    if np.isfinite(limit):
        text = f"limit load {rounded_alike([limit])[0]}"
        axes.axhline(limit, color=VERMILLION, linestyle="--", label=text)
    for answer in end.told:
        for text, displacement, load_factor in answer.marks(end):
            axes.plot(1e3 * displacement, load_factor, "^", color=BLACK, markersize=8, label=text)
    axes.update_datalim([(0.0, 0.0)])
    axes.autoscale_view()
    axes.set(ylabel="load factor", xlabel="mean displacement along the live load (mm)")
    axes.grid(alpha=0.3)
    axes.legend(loc="best")
    return axes


def draw_marked(axes: Any, view: View) -> Any:
    """The marked blocks, shaded and with their numbers, among all, displaced as the view says."""
    blocks = np.empty(0, dtype=np.int64) if view.marked is None else view.marked
    frame(axes, view, view.moved)
    shade = np.full((len(view.centre), 3), 0.92)
    shade[blocks] = (0.93, 0.75, 0.45)
    draw_outlines(axes, view.boundary, view.rest, facecolor="none", edgecolor="0.7")
    draw_outlines(axes, view.boundary, view.moved, facecolor=shade)
    style = {"fontsize": max(8.0 * fineness(axes, view), 4.5), "ha": "center", "va": "center"}
    for block in blocks[:LEGIBLE]:
        place = view.moved[view.boundary.body == block].mean(axis=(0, 1))
        axes.text(*place, str(block), **style)
    axes.set_title("shaded: blocks, by number; grey outline: at rest", fontsize=10)
    return axes


def _values(view: View) -> JointValues:
    """Joint values of a view that has them."""
    if view.values is None:
        raise ValueError("there are no joint forces: no state was found")
    return view.values


# ---- files


def check_axes(axes: Any) -> None:
    """Refuse what is neither None nor axes to draw into.

    Raises:
        InputError: The message says what it must be.
    """
    if axes is not None:
        check_like("axes", axes, "get_autoscalex_on", "axes of matplotlib, or None")


def new_axes() -> Any:
    """Axes of a figure of their own, which a notebook shows.

    Raises:
        InputError: If the notebook's way to show pictures does not fit this matplotlib.
    """
    from matplotlib import pyplot

    try:
        return pyplot.subplots(figsize=(7.0, 4.5), layout="constrained")[1]
    except AttributeError as error:  # matplotlib-inline 0.2 asks old versions for what they lack
        cure = "in a notebook: pip install 'matplotlib-inline<0.2', and begin again"
        raise InputError(f"matplotlib cannot show a picture here ({error}); {cure}") from error


def structure_figure(view: View, panels: int) -> Any:
    """An empty figure with room for pictures of a structure side by side."""
    from matplotlib.figure import Figure

    width, height = np.ptp(extent(view, view.moved), axis=0)
    tall = float(np.clip(WIDTH * height / width, *HEIGHTS))
    wide = max(min(WIDTH, tall * width / height), NARROWEST)
    return Figure(figsize=(panels * wide, tall + 1.1), dpi=DPI, layout="constrained")


def save(
    view: View,
    title: str,
    paths: Sequence[Path | BinaryIO],
    *draws: Draw,
) -> None:
    """Pictures of a structure side by side, to one scale."""
    figure = structure_figure(view, len(draws))
    places = figure.subplots(1, len(draws), squeeze=False, sharex=True, sharey=True)
    for axes, draw in zip(places[0], draws, strict=True):
        draw(axes, view)
    _save(figure, title, paths)


def save_collapse(view: View, title: str, paths: Sequence[Path | BinaryIO]) -> None:
    """Collapse mode and joint forces."""
    save(view, title, paths, draw_mode, draw_forces)


def save_capacity(
    points: Sequence[CapacityPoint],
    end: Collapse,
    title: str,
    paths: Sequence[Path],
) -> None:
    """The capacity curve."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.5), dpi=DPI, layout="constrained")
    draw_capacity(figure.subplots(), points, end)
    _save(figure, title or "Capacity curve", paths)


def _save(figure: Any, title: str, paths: Sequence[Path | BinaryIO]) -> None:
    """Write a figure with its title and tight margins, laid out once for all files."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=11)
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine(None)  # "none" would draw once more, to nowhere
    box = figure.get_tightbbox().padded(MARGIN)
    for path in paths:
        if isinstance(path, Path) and path.suffix != ".png":
            figure.savefig(path, bbox_inches=box)
        else:
            _save_png(figure, box, path)


def _save_png(figure: Any, box: Any, path: Path | BinaryIO) -> None:
    """Write the part of a figure in a box, inches, as PNG.

    Without transparency, and packed by runs of equal pixels: a third of the time of `savefig`.
    """
    from PIL import Image

    raw = io.BytesIO()
    figure.savefig(raw, format="raw", bbox_inches=box)
    shape = -1, int(box.width * DPI), 4
    pixels = np.frombuffer(raw.getvalue(), dtype=np.uint8).reshape(shape)[..., :3]
    image = Image.fromarray(np.ascontiguousarray(pixels))
    image.save(path, format="png", dpi=(DPI, DPI), compress_type=zlib.Z_RLE)
