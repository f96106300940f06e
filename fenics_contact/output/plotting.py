"""Pictures of a result: collapse mode, joint forces, lines of thrust, stresses, capacity curve.

Every `draw_...` draws on given matplotlib axes, on this rank, and returns them; `save` makes files.
Colours are those of M. Okabe and K. Ito, which the colour-blind tell apart; line widths and double
lines tell the same in grey. Matplotlib is imported where it is used: that takes .4 s.
"""

from __future__ import annotations

import io
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fenics_contact.errors import InputError, check_like, plain
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.output.fields import principal_stresses
from fenics_contact.output.thrust import LOADED, Resultants, ThrustLines, thrust_lines
from fenics_contact.output.view import AT_REST, Loads, View
from fenics_contact.results.block_view import ContactState
from fenics_contact.results.history import CapacityPoint
from fenics_contact.results.result import Collapse
from fenics_contact.results.values import TieState
from fenics_contact.scene.units import rounded_alike

BLACK, ORANGE, BLUE, VERMILLION = "#000000", "#E69F00", "#0072B2", "#D55E00"
GREEN = "#007A5A"
PALE_ORANGE = "#F2C766"
#: Tints of the materials, repeated if there are more; they differ in grey too.
TINTS = ("#c3d5e3", "#faf0d2", "#a9b79b", "#b98f9d", "#80868f", "#d8bf94")
#: Length of arrows over the structure's size: tractions, forces at places, body force; line widths.
LENGTHS = (0.07, 0.11, 0.16)
WIDTHS = (1.0, 1.6, 2.2)
#: Entries of a legend in one row.
IN_A_ROW = 5
#: Width of the axes of a structure, and limits of their width and height, inches.
WIDTH = 6.0
NARROWEST = 3.2
HEIGHTS = (1.2, 9.0)
#: How notebooks show pictures.
INLINE = "matplotlib_inline.backend_inline"
#: Pixels per inch of files, and what is left free around a picture, inches.
DPI, MARGIN = 150, 0.08
#: Blocks that are numbered in a picture.
LEGIBLE = 60
#: Squares of the stress raster to a cross; the stress that ends the colours is this quantile of
#: all, and crosses are drawn from this part of it.
PER_CROSS, LARGEST, LEAST = 8, 0.98, 0.1
FORCE = "#7b2d8b"
#: Colours of contacts, and what they do; those that do nothing are thin.
MARKS: Mapping[int, tuple[str, str]] = {
    ContactState.CRUSHES: (FORCE, "crushes"),  # below what else it does
    ContactState.STICK: (BLACK, "closed"),
    AT_REST: (PALE_ORANGE, "open, at rest"),
    ContactState.ROCKS: (ORANGE, "opens along an edge"),
    ContactState.OPEN: (VERMILLION, "opens"),
    ContactState.SLIP: (BLUE, "slides"),
}
QUIET = ContactState.STICK, AT_REST
#: What ties do, and how their lines are drawn.
TIES: Mapping[int, tuple[str, Mapping[str, Any]]] = {
    TieState.YIELDS: ("tie yields", {"color": "#D81B8C", "lw": 2.6, "ls": "-"}),
    TieState.ELASTIC: ("tie", {"color": GREEN, "lw": 1.4, "ls": "-"}),
    TieState.SLACK: ("tie slack", {"color": GREEN, "lw": 1.2, "ls": (0, (4, 3))}),
}
#: Length of the strokes below what does not move, over the structure's size, and their number.
STROKE, STROKES = 0.018, 40
#: Colours of joint groups, repeated if there are more, of the dead load and of foundations.
GROUPS = (BLUE, ORANGE, "#56B4E9", "#CC79A7", "#009E73")
DEAD, HELD = "0.45", "#5b4636"
#: Blocks that fall or wedge, and ground.
FALLS, GROUND = (0.93, 0.75, 0.45), (0.86, 0.85, 0.83)

#: Draws on axes what a view shows.
Draw = Callable[[Any, View], Any]


def draw_mode(axes: Any, view: View) -> Any:
    """Blocks displaced, joints by what they do, and the live load; or some blocks, marked.

    The blocks are the paler the less they move.
    """
    if view.marked is not None:
        return draw_marked(axes, view)
    draw_moved(axes, view, view.caption.motion.format(f"{float(f'{view.scale:.3g}'):g}"))
    entries = [*draw_joints(axes, view), *draw_ties(axes, view, 1.0)]
    entries += draw_load(axes, view, view.live, BLACK, "live load")
    draw_bar(axes, view)
    legend(axes, [*entries, *material_entries(axes, view)])
    return axes


def draw_marked(axes: Any, view: View) -> Any:
    """The marked blocks, shaded and with their numbers, among all, displaced as the view says."""
    draw_moved(axes, view, f"shaded: {view.caption.motion}, by number")
    style = {"fontsize": max(8.0 * fineness(axes, view), 4.5), "ha": "center", "va": "center"}
    for block in [] if view.marked is None else view.marked[:LEGIBLE].tolist():
        axes.text(*view.moved[view.block == block].mean(axis=0), str(block), **style)
    return axes


def draw_moved(axes: Any, view: View, title: str) -> None:
    """Blocks displaced, and at rest."""
    rest = " (grey outline: at rest)" * bool(np.any(view.motion))
    axes.set_title(f"{title}{rest}", fontsize=10)
    frame(axes, view, view.moved)
    size = np.zeros(len(view.fixed))
    if view.marked is None:
        np.maximum.at(size, view.block, np.linalg.norm(view.motion, axis=1))
    shade = shades(view.material, size / (size.max() or 1.0), view.fixed, view.marked)
    draw_outlines(axes, view, view.rest, facecolor="none", edgecolor="0.7")
    draw_outlines(axes, view, view.moved, facecolor=shade)


def draw_forces(axes: Any, view: View) -> Any:
    """Resultant of the joint forces on every face, through its centre of pressure, to scale.

    The scale is a nice number of N/m per m of drawing, or of N where the thickness is given. Nine
    in ten forces are shorter than 1.2 times a block, and all than 0.35 times the structure. Forces
    of ties stand beside their bars.

    Raises:
        ValueError: If the view has no joint forces.
    """
    faces = known_faces(view)
    size = np.linalg.norm(faces.force, axis=1) * (view.thickness or 1.0)
    acts = size > LOADED * size.max(initial=0.0)
    size, centre = size[acts], faces.centre[acts]
    total = faces.force[acts] * (view.thickness or 1.0)
    frame(axes, view)
    draw_outlines(axes, view, view.rest)
    if len(total):
        largest = float(size.max())
        typical = float(np.quantile(size, 0.9)) / (1.2 * view.block_size)
        per_metre = nice(1.5 * max(typical, largest / (0.35 * view.size)))
        lines = centre[:, None] + np.array([[-0.5], [0.5]]) * (total / per_metre)[:, None]
        frame(axes, view, lines)
        fine = fineness(axes, view)
        add_lines(axes, lines, colors=FORCE, linewidths=2.4 * fine * (0.4 + 0.6 * size / largest))
        axes.plot(*centre.T, ".", color=FORCE, markersize=5.0 * fine**1.5)
        force = nice(min(largest, 0.3 * view.size * per_metre))
        unit = "N" if view.thickness else "N/m"
        text = f"{force_text(force, unit)}   (1 m = {force_text(per_metre, unit)})"
        draw_bar(axes, view, force / per_metre, text, FORCE)
    if "force" in view.ties:
        legend(axes, draw_ties(axes, view))
        style = {"fontsize": 8, "color": GREEN, "ha": "center", "va": "bottom", **_halo()}
        for ends, force in zip(view.ties["ends"], view.ties["force"], strict=True):
            along = ends[1] - ends[0]
            angle = np.degrees(np.arctan2(along[1], along[0]))
            style |= {"rotation": angle - 180.0 * np.round(angle / 180.0)}
            style |= {"rotation_mode": "anchor"}
            force *= view.thickness or 1.0
            told = force_text(float(force), "N" if view.thickness else "N/m")
            axes.text(*ends.mean(axis=0), told, **style)
    axes.set_title(f"joint forces {view.caption.state}", fontsize=10)
    return axes


def draw_thrust(axes: Any, view: View) -> Any:
    """Lines of thrust, the wider the larger the force, with the joints that they cross.

    Those that do not reach the ground are left out, and all where most do not.

    Raises:
        ValueError: If the view has no joint forces.
    """
    lines = whole_thrust(view)
    frame(axes, view)
    draw_outlines(axes, view, view.rest)
    fine = fineness(axes, view)
    add_lines(axes, lines.ends, colors="0.3", linewidths=0.9 * fine)
    widths = 0.6 + 2.4 * fine * lines.force / (lines.force.max(initial=0.0) or 1.0)
    style = {"colors": VERMILLION, "linewidths": widths, "capstyle": "round", "zorder": 3}
    add_lines(axes, lines.segments, **style)
    style = {"color": "white", "mec": BLACK, "mew": 0.7 * fine, "ls": "none", "zorder": 4}
    style |= {"marker": "o", "ms": 4.0 * max(fine, 0.5), "label": "centre of pressure"}
    entries: list[Any] = []
    title = "few lines of thrust reach the ground: forces branch"
    if len(lines.segments):
        entries += axes.plot([], [], color=VERMILLION, lw=2.5, label="line of thrust")
        entries += axes.plot(*lines.centre.T, **style)
        title = f"line of thrust {view.caption.state} (width: force)"
    entries += draw_ties(axes, view)
    draw_bar(axes, view)
    entries += draw_load(axes, view, view.live, BLACK, "live load")
    legend(axes, [*entries, *material_entries(axes, view)])
    axes.set_title(title, fontsize=10)
    return axes


def whole_thrust(view: View) -> ThrustLines:
    """Lines of thrust that reach the ground, none where most do not.

    Raises:
        ValueError: If the view has no joint forces.
    """
    return thrust_lines(known_faces(view), view.centre)


def known_faces(view: View) -> Resultants:
    """Resultants of the joint forces.

    Raises:
        ValueError: If the view has none.
    """
    if view.faces is None:
        raise ValueError("there are no joint forces: no state was found")
    return view.faces


def draw_stress(axes: Any, view: View) -> Any:
    """The larger compressive principal stress in colour, and crosses of both.

    Crosses are means over squares, as long as the stresses are large: black for compression, wide
    and red for tension.

    Raises:
        ValueError: If the view has no stresses.
    """
    from matplotlib.colors import LinearSegmentedColormap

    raster = view.stress
    if raster is None:
        raise ValueError("there are no stresses: no state was found")
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
    paths = draw_outlines(axes, view, view.rest, facecolor="none").get_paths()
    image.set_clip_path(type(paths[0]).make_compound_path(*paths), axes.transData)
    coarse = raster.coarser(PER_CROSS)
    full = coarse.area > 0.5 * coarse.step**2
    row, column = np.nonzero(full)
    centre = coarse.corner + coarse.step * (np.column_stack([column, row]) + 0.5)
    value, first = principal_stresses(coarse.stress[full])
    second = np.column_stack([-first[:, 1], first[:, 0]])
    value = value.T.ravel()
    reach = np.clip(np.abs(value) / largest, 0.0, 1.0)[:, None] * np.vstack([first, second])
    half = 0.5 * coarse.step * reach
    crosses = np.tile(centre, (2, 1))[:, None] + np.stack([-half, half], axis=1)
    tension = value > LEAST * largest
    add_lines(axes, crosses[value < -LEAST * largest], colors=BLACK, linewidths=0.8)
    add_lines(axes, crosses[tension], colors=VERMILLION, linewidths=1.6)
    draw_bar(axes, view)
    words = "black: compression" + (", red and wide: tension" if np.any(tension) else "")
    style = {"location": "bottom", "extend": "max", "shrink": 0.7, "aspect": 35, "pad": 0.02}
    label = f"larger compressive principal stress ({unit})\n{words}"
    axes.figure.colorbar(image, ax=axes, panchor=False, **style).set_label(label, fontsize=9)
    axes.set_title(f"principal stresses {view.caption.stress or view.caption.state}", fontsize=10)
    return axes


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


# ---- the scene


def draw_scene(axes: Any, view: View) -> Any:
    """Blocks by material, groups with a role, ties and loads, each by its name."""
    room = 1.5 * STROKE * view.size  # for strokes outside the structure
    frame(axes, view, *arrow_ends(view, view.dead), view.rest - room, view.rest + room)
    draw_outlines(axes, view, view.rest)
    entries = [*_joint_entries(axes, view), *_held_entries(axes, view)]
    for ends in view.ties["ends"]:
        (line,) = axes.plot(*ends.T, marker="s", ms=4.0, color=GREEN, lw=1.6, zorder=4)
    if len(view.ties["ends"]):
        told = list(dict.fromkeys(view.ties.get("name", ())))
        names = ", ".join(told)
        names = names if len(names) <= 40 else f"{names[:36]} ..."
        entries.append((f"tie{'s' * (len(told) > 1)} {names}", line))
    for named, arrows, colour, label in (
        (view.dead_names, view.dead, DEAD, "dead load"),
        (view.live_names, view.live, BLACK, "live load"),
    ):
        entries += draw_load(axes, view, arrows, colour, label)
        style = {"fontsize": 9, "color": colour, "ha": "center", "va": "center", **_halo()}
        for name, place, away in zip(*named, strict=True):
            axes.text(*(place + 0.04 * view.size * away), plain(name), **style)
    draw_bar(axes, view)
    legend(axes, [*entries, *material_entries(axes, view)])
    axes.set_title("materials, groups and loads", fontsize=10)
    return axes


def _halo() -> dict[str, Any]:
    """Style of a text that lies on other things."""
    from matplotlib import patheffects

    return {"zorder": 6, "path_effects": [patheffects.withStroke(linewidth=2.5, foreground="w")]}


def _joint_entries(axes: Any, view: View) -> Iterator[Any]:
    """Joints between blocks by group, drawn if there is more than one group."""
    group = view.lines.group
    found = np.unique(group[group >= 0])
    width = max(1.8 * fineness(axes, view), 0.8)
    for rank, number in enumerate(found if len(found) > 1 else []):
        colour = GROUPS[rank % len(GROUPS)]
        add_lines(axes, view.lines.ends[group == number], colors=colour, linewidths=width)
        line = axes.plot([], [], color=colour, lw=2.0)[0]
        yield f"joints {view.lines.groups[number]}", line


def _held_entries(axes: Any, view: View) -> Iterator[Any]:
    """Edges on foundations and supports, with oblique strokes on the side of what does not move."""
    for rank, held in enumerate(view.held):
        colour = HELD if held.kind == "foundation" else VERMILLION
        style: dict[str, Any] = {"colors": colour, "zorder": 3}
        dashes = ("-", (0, (5, 1)), (0, (1, 1)), (0, (4, 1, 1, 1)))[rank % 4]
        add_lines(axes, held.ends, linewidths=2.8, linestyles=dashes, **style)
        strokes = []
        for (start, end), normal in zip(held.ends, held.normal, strict=True):
            count = max(round(float(np.linalg.norm(end - start)) * STROKES / view.size), 1)
            foot = start + (np.arange(count) + 0.5)[:, None] / count * (end - start)
            oblique = normal - np.array([-normal[1], normal[0]])
            strokes.append(np.stack([foot, foot + STROKE * view.size * oblique], axis=1))
        add_lines(axes, np.concatenate(strokes), linewidths=0.7, **style)
        yield f"{held.kind} {held.name}", axes.plot([], [], color=colour, lw=2.8, ls=dashes)[0]


# ---- parts of pictures


def extent(view: View, *more: Array) -> Array:
    """Corners, low and high, m, of the blocks at rest, arrows of loads, more points, a margin."""
    moves = view.rest[~view.fixed[view.block]]
    tables = [moves, view.ties["ends"], *more, *arrow_ends(view, view.live)]
    points = np.concatenate([table.reshape(-1, 2) for table in tables])
    margin = 0.02 * view.size
    return np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin])


def frame(axes: Any, view: View, *more: Array) -> None:
    """Show what `extent` says beside what axes showed before, with one scale in x and y."""
    low, high = extent(view, *more)
    if not axes.get_autoscalex_on():
        x = axes.get_xlim()
        y = axes.get_ylim()
        low = np.minimum(low, [x[0], y[0]])
        high = np.maximum(high, [x[1], y[1]])
    axes.set(aspect="equal", anchor="N", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.axis("off")
    for axis in (axes.xaxis, axes.yaxis):  # its ticks would still be laid out
        axis.set_visible(False)


def fineness(axes: Any, view: View) -> float:
    """Factor on the width of lines: 1 where blocks are large in the picture, less for many."""
    box = axes.get_window_extent()
    points = 72.0 / axes.figure.dpi * np.array([box.width, box.height])
    scale = np.min(points / np.abs([np.diff(axes.get_xlim())[0], np.diff(axes.get_ylim())[0]]))
    return float(np.clip(scale * view.block_size / 30.0, 0.35, 1.0))


def add_lines(axes: Any, segments: Array, **style: Any) -> None:
    """Draw straight lines, shape (lines, 2, 2)."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(segments, **style))


def shades(group: Indices, share: Array, fixed: Flags, marked: Any = None) -> Array:
    """Colours of blocks by group, the paler the less they move, RGB; of ground, and marked ones."""
    from matplotlib.colors import to_rgb

    tint = np.array([to_rgb(tint) for tint in TINTS])[group % len(TINTS)]
    colours = 1.0 - np.where(share > 1e-3, 0.45 + 0.55 * share, 0.25)[:, None] * (1.0 - tint)
    colours[[] if marked is None else list(marked)] = FALLS
    return np.where(fixed[:, None], GROUND, colours)


def draw_outlines(axes: Any, view: View, places: Array, **style: Any) -> Any:
    """Closed paths around all blocks, for given places of the corners, by material; the artist."""
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Outline

    first = np.flatnonzero(np.diff(view.loop, prepend=-1))
    loops = zip(view.block[first].tolist(), np.split(places, first[1:]), strict=True)
    paths = [
        Outline.make_compound_path(*(Outline([*loop, loop[0]], closed=True) for _, loop in of_body))
        for _, of_body in groupby(loops, key=itemgetter(0))
    ]
    shade = shades(view.material, np.ones(len(view.fixed)), view.fixed)
    style = {"facecolor": shade, "edgecolor": "0.4", "linewidth": 0.5} | style
    return axes.add_collection(PathCollection(paths, **style))


def material_entries(axes: Any, view: View) -> list[Any]:
    """Entries of a legend for the materials that occur, if there is more than one."""
    found = np.unique(view.material[~view.fixed])
    style = {"marker": "s", "ms": 10.0, "mec": "0.4", "ls": "none"}
    entries = [
        axes.plot([], [], color=TINTS[n % len(TINTS)], label=view.materials[n], **style)[0]
        for n in found
    ]
    return entries if len(found) > 1 else []


def draw_joints(axes: Any, view: View) -> list[Any]:
    """Where blocks meet, by what they do there, between displaced sides; entries of a legend."""
    if view.faces is None:
        return []
    lines = view.lines
    fine = fineness(axes, view)
    thin = 0.8 * max(fine, 0.5)
    wide = max(2.6 * fine, 1.4)
    entries: list[Any] = []
    for state, (colour, label) in MARKS.items():
        crushes = state == ContactState.CRUSHES
        chosen = lines.crushes if crushes else np.flatnonzero(lines.state == state)
        if not len(chosen):
            continue
        width = thin if state in QUIET else 2.5 * wide if crushes else wide
        ends = lines.ends[chosen] + lines.motion[chosen]
        add_lines(axes, ends, colors=colour, linewidths=width)
        entries.append((label, axes.plot([], [], color=colour, lw=width)[0]))
    if len(view.hinges):
        style = {"mfc": "white", "mec": "black", "mew": 0.8, "ms": max(4.5 * fine, 2.0)}
        entries += axes.plot(*view.hinges.sum(axis=1).T, "o", label="hinge", **style)
    return entries


def draw_ties(axes: Any, view: View, share: float = 0.0) -> list[Any]:
    """Ties, displaced by a part of their motion, by what they do; entries of a legend."""
    entries: list[Any] = []
    for state, (label, style) in TIES.items():
        ends = view.ties["ends"] + share * view.ties["motion"]
        for tie in ends[view.ties["state"] == state] if "state" in view.ties else ():
            (line,) = axes.plot(*tie.T, marker="s", ms=4.0, zorder=4, **style)
            entries.append((label, line))
    return list(dict(entries).items())


def legend(axes: Any, entries: Sequence[Any]) -> None:
    """A legend below what axes show now, of artists with labels or pairs (label, artists).

    It is no wider than the axes' part of the figure. Where the figure has no layout of its own that
    makes room for it, the axes show more below, so that it does not lie on axes there.
    """
    if not entries:
        return
    pairs = [one if isinstance(one, tuple) else (one.get_label(), one) for one in entries]
    labels = [plain(label) for label, _ in pairs]
    handles = [handle for _, handle in pairs]
    low, high = axes.get_ylim()
    style = {"bbox_to_anchor": (0.5, low), "bbox_transform": axes.get_yaxis_transform()}
    style |= {"loc": "upper center", "borderaxespad": 0.2, "fontsize": 9, "frameon": False}
    has_layout = axes.figure.get_layout_engine() is not None
    box = axes.get_window_extent()
    # Width around the middle of the axes that is theirs in their figure, pixels.
    room = box.width
    place = axes.get_subplotspec()
    if place is not None:
        column = axes.figure.bbox.width / place.get_gridspec().ncols
        room = column * len(place.colspan)  # a layout moves them to the middle of their part
        if not has_layout:
            middle = 0.5 * (box.x0 + box.x1)
            left = middle - column * place.colspan.start
            room = 2.0 * min(left, column * place.colspan.stop - middle)
    for rows in range(-(-len(pairs) // IN_A_ROW), len(pairs) + 1):
        made = axes.legend(handles, labels, ncols=-(-len(pairs) // rows), **style)
        size = made.get_window_extent()
        if size.width <= room:
            break
    if has_layout:
        return
    per_pixel = abs(np.diff(axes.get_xlim())[0]) / box.width
    shown = high - low + size.height * per_pixel
    if shown > box.height * per_pixel:  # the height of the axes limits the scale
        shown = max(shown, (high - low) / max(1.0 - size.height / box.height, 0.1))
    axes.set_ylim(high - shown, high)


def arrow_ends(view: View, loads: Loads) -> list[Array]:
    """Tails and tips of the arrows of tractions, forces and the body force, (arrows, 2, 2) each."""
    ends = []
    for arrows, length in zip(loads, LENGTHS, strict=True):
        largest = np.linalg.norm(arrows.vector, axis=1).max(initial=0.0) or 1.0
        reach = length * view.size * arrows.vector / largest
        # The body force is inside the structure: the middle of its arrow is where it acts.
        behind = np.where(arrows.pushes, 0.5 if arrows is loads.body else 1.0, 0.0)
        tail = arrows.place - behind[:, None] * reach
        ends.append(np.stack([tail, tail + reach], axis=1))
    return ends


def draw_load(axes: Any, view: View, loads: Loads, colour: str, label: str) -> list[Any]:
    """Arrows where a load acts; entry of a legend."""
    from matplotlib import patheffects

    ends = arrow_ends(view, loads)
    halo = [patheffects.withStroke(linewidth=4.0, foreground="white")]
    for arrows, width in zip(ends, WIDTHS, strict=True):
        arrow = {"arrowstyle": "-|>", "mutation_scale": 6.0 + 4.0 * width, "color": colour}
        arrow |= {"lw": width, "shrinkA": 0.0, "shrinkB": 0.0, "path_effects": halo, "zorder": 5}
        for tail, tip in arrows:
            axes.annotate("", tip, tail, arrowprops=arrow)
    if not sum(map(len, ends)):
        return []
    entries: list[Any] = axes.plot([], [], label=label, marker=">", ms=7, lw=1.6, color=colour)
    return entries


def nice(value: float, steps: Sequence[float] = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)) -> float:
    """The largest of some steps times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    table = np.array(steps)
    return float(table[table <= value / power * (1.0 + 1e-9)].max(initial=1.0) * power)


def force_text(force: float, unit: str = "N/m") -> str:
    """A force in kN, per metre of thickness or not, or in N or MN where that has fewer digits."""
    factor, prefix = (1e6, "M") if force >= 1e6 else (1e3, "k") if force >= 1e3 else (1.0, "")
    return f"{force / factor:.4g} {prefix}{unit}"


def draw_bar(
    axes: Any, view: View, length: float = 0.0, text: str = "", colour: str = "0.3"
) -> None:
    """A bar below the lower left corner of a picture, of a length in it, m, with its text.

    By default it is a round length with its number of metres.
    """
    length = length or nice(0.2 * view.size, (1.0, 2.0, 5.0))
    x = axes.get_xlim()[0] + 0.02 * view.size
    y = axes.get_ylim()[0] - 0.02 * view.size
    axes.plot([x, x + length], [y, y], "|-", color=colour, lw=1.8, markersize=7, zorder=4)
    place = x + length + 0.015 * view.size
    axes.text(place, y, text or f"{length:g} m", va="center", fontsize=9)
    axes.set_ylim(y - 0.03 * view.size, None)


# ---- files


def load_matplotlib() -> None:
    """A task: import what draws pictures, before there is one."""
    for name in ("figure", "backends.backend_agg"):
        import_module(f"matplotlib.{name}")


def check_axes(axes: Any) -> None:
    """Refuse what is neither None nor axes to draw into.

    Raises:
        InputError: The message says what it must be.
    """
    if axes is not None:
        check_like("axes", axes, "get_autoscalex_on", "axes of matplotlib, or None")


def new_axes(polar: bool = False) -> Any:
    """Axes of a figure of their own, which a notebook shows.

    Raises:
        InputError: If the notebook's way to show pictures does not fit this matplotlib.
    """
    from matplotlib import get_backend, pyplot

    try:
        # matplotlib 3.6 loads the way of notebooks with the first figure, and does not show that.
        if INLINE in get_backend() and INLINE not in sys.modules:
            shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
            if shell is not None:
                shell.run_line_magic("matplotlib", "inline")
        style: dict[str, Any] = {"figsize": (7.0, 4.5), "layout": "constrained"}
        return pyplot.subplots(subplot_kw={"polar": polar}, **style)[1]
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


def save(view: View, title: str, paths: Sequence[Path | BinaryIO], *draws: Draw) -> None:
    """Pictures of a structure side by side, to one scale."""
    figure = structure_figure(view, len(draws))
    places = figure.subplots(1, len(draws), squeeze=False, sharex=True, sharey=True)
    for axes, draw in zip(places[0], draws, strict=True):
        draw(axes, view)
    save_figure(figure, title, paths)


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
    save_figure(figure, title or "Capacity curve", paths)


def save_figure(figure: Any, title: str, paths: Sequence[Path | BinaryIO]) -> None:
    """Write a figure with its title and tight margins, laid out once for all files.

    PNG is without transparency, and packed by runs of equal pixels: a third of the time of
    `savefig`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=11)
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine(None)  # "none" would draw once more, to nowhere
    box = figure.get_tightbbox().padded(MARGIN)
    for path in paths:
        if isinstance(path, Path) and path.suffix != ".png":
            figure.savefig(path, bbox_inches=box)
            continue
        raw = io.BytesIO()
        figure.savefig(raw, format="raw", bbox_inches=box)
        shape = -1, int(box.width * DPI), 4
        pixels = np.frombuffer(raw.getvalue(), dtype=np.uint8).reshape(shape)[..., :3]
        image = Image.fromarray(np.ascontiguousarray(pixels))
        image.save(path, format="png", dpi=(DPI, DPI), compress_type=zlib.Z_RLE)
