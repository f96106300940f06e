"""Parts of pictures: outlines, blocks by material, joints by what they do, loads, scales.

Colours are those of M. Okabe and K. Ito, which the colour-blind tell apart; line widths and double
lines tell the same in grey. Matplotlib is imported where it is used: that takes .4 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_contact.discretization.facets import Boundary
from fenics_contact.errors.texts import plain
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.fields import facet_contact
from fenics_contact.output.view import Arrows, View
from fenics_contact.results.joint_values import Contact
from fenics_contact.results.tie_values import TieState

BLACK, ORANGE, BLUE, VERMILLION = "#000000", "#E69F00", "#0072B2", "#D55E00"
GREEN = "#007A5A"
PALE_ORANGE = "#F2C766"
#: Tints of the materials, repeated if there are more; they differ in grey too.
TINTS = ("#c3d5e3", "#faf0d2", "#a9b79b", "#b98f9d", "#80868f", "#d8bf94")
#: Length of arrows over the structure's size: tractions, forces at places, body force.
LENGTHS = 0.07, 0.11, 0.16
#: Entries of a legend in one row.
IN_A_ROW = 5

#: Tractions and earth pressure, forces at places, resultant of the body force.
Loads = tuple[Arrows, Arrows, Arrows]


def extent(view: View, *more: Array) -> Array:
    """Corners, low and high, m, of the blocks at rest, arrows of loads, more points, a margin."""
    ties = [] if view.ties is None else [view.ties.bars.sides]
    loads = view.tractions, view.forces, view.body
    tables = [view.rest, *ties, *more, *(end for ends in arrow_ends(view, loads) for end in ends)]
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


def draw_outlines(axes: Any, boundary: Boundary, ends: Array, **style: Any) -> None:
    """Closed paths around all bodies, for given ends of the facets, shape (facets, 2, 2)."""
    from matplotlib.collections import PathCollection

    style = {"edgecolor": "0.4", "linewidth": 0.5} | style
    axes.add_collection(PathCollection(outlines(boundary, ends), **style))


def outlines(boundary: Boundary, ends: Array) -> list[Any]:
    """A matplotlib path around every body."""
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
        corners = []
        while node in leaving:
            row = leaving.pop(node)
            node = int(nodes[row, 1])
            corners.append(points[row, 1])
        loops[boundary.body[row]].append(Outline([*corners, corners[0]], closed=True))
    return [Outline.make_compound_path(*of_body) for of_body in loops]


def draw_rest(axes: Any, view: View) -> None:
    """Outlines of the blocks at rest, by material."""
    draw_outlines(axes, view.boundary, view.rest, facecolor=_tints(view))


def draw_moved(axes: Any, view: View) -> None:
    """Outlines at rest, and the blocks displaced, by material, the paler the less they move."""
    size = np.zeros(len(view.centre))
    np.maximum.at(size, view.boundary.body, np.linalg.norm(view.motion, axis=2).max(axis=1))
    share = (size / (size.max() or 1.0))[:, None]
    shade = 1.0 - np.where(share > 1e-3, 0.45 + 0.55 * share, 0.25) * (1.0 - _tints(view))
    draw_outlines(axes, view.boundary, view.rest, facecolor="none", edgecolor="0.7")
    draw_outlines(axes, view.boundary, view.moved, facecolor=shade)


def _tints(view: View) -> Array:
    """Colour of every block, RGB."""
    from matplotlib.colors import to_rgb

    return np.array([to_rgb(tint) for tint in TINTS])[view.material % len(TINTS)]


def material_entries(axes: Any, view: View) -> list[Any]:
    """Entries of a legend for the materials that occur, if there is more than one."""
    found = np.unique(view.material)
    style = {"marker": "s", "ms": 10.0, "mec": "0.4", "ls": "none"}
    entries = [
        axes.plot([], [], color=TINTS[n % len(TINTS)], label=view.materials[n], **style)[0]
        for n in found
    ]
    return entries if len(found) > 1 else []


def draw_joints(axes: Any, view: View) -> list[Any]:
    """Joint facets by what they do, between their displaced sides; entries of a legend."""
    if view.values is None:
        return []
    joints = view.joints
    position = joints.position + view.joint_motion
    state = facet_contact(view.values, joints.segments)
    opens = np.any(view.values.opens[joints.segments], axis=1) & (state == Contact.OPEN)
    fine = fineness(axes, view)
    thin = 0.8 * max(fine, 0.5)
    wide = max(2.6 * fine, 1.4)
    core = [("white", 0.3 * wide)] if fine > 0.7 else []  # two lines where they can be seen
    entries: list[Any] = []
    for label, chosen, strokes in (
        ("closed", state == Contact.STICK, [(BLACK, thin)]),
        ("open, at rest", (state == Contact.OPEN) & ~opens, [(PALE_ORANGE, thin)]),
        ("opens", opens, [(ORANGE, wide)]),
        ("slides", state == Contact.SLIP, [(BLUE, wide), *core]),
    ):
        if not np.any(chosen):
            continue
        segments = position[joints.segments[chosen]]
        for colour, width in strokes:
            add_lines(axes, segments, colors=colour, linewidths=width)
        lines = [axes.plot([], [], color=colour, lw=width)[0] for colour, width in strokes]
        entries.append((label, tuple(lines)))
    points = view.values.hinges(joints.neighbours)
    if len(points):
        style = {"mfc": "white", "mec": "black", "mew": 0.8, "ms": max(4.5 * fine, 2.0)}
        entries += axes.plot(*position[points].T, "o", label="hinge", **style)
    return entries


def draw_ties(axes: Any, view: View, ends: Array) -> list[Any]:
    """Ties between given ends, shape (bars, 2, 2), by what they do; entries of a legend."""
    if view.ties is None:
        return []
    entries: list[Any] = []
    state = view.ties.state
    for label, which, style in (
        ("tie yields", TieState.YIELDS, {"lw": 2.6, "ls": "-"}),
        ("tie", TieState.ELASTIC, {"lw": 1.4, "ls": "-"}),
        ("tie slack", TieState.SLACK, {"lw": 1.2, "ls": (0, (4, 3))}),
    ):
        for tie in ends[state == which]:
            (line,) = axes.plot(*tie.T, marker="s", ms=4.0, color=GREEN, zorder=4, **style)
        if np.any(state == which):
            entries.append((label, line))
    return entries


def name_tie_forces(axes: Any, view: View) -> None:
    """Forces of ties beside the middle of the bars, at rest."""
    from matplotlib import patheffects

    if view.ties is None:
        return
    halo = [patheffects.withStroke(linewidth=2.5, foreground="white")]
    style = {"fontsize": 8, "color": GREEN, "zorder": 6, "path_effects": halo}
    style |= {"ha": "center", "va": "bottom", "rotation_mode": "anchor"}
    for ends, force in zip(view.ties.bars.sides, view.ties.force, strict=True):
        along = ends[1] - ends[0]
        angle = np.degrees(np.arctan2(along[1], along[0]))
        upright = angle - 180.0 * np.round(angle / 180.0)
        axes.text(*ends.mean(axis=0), force_text(float(force)), rotation=upright, **style)


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
    place: dict[str, Any] = {"bbox_to_anchor": (0.5, axes.get_ylim()[0]), "loc": "upper center"}
    place |= {"bbox_transform": axes.get_yaxis_transform(), "borderaxespad": 0.2}
    style = {"fontsize": 9, "frameon": False}
    room = _room(axes)
    for rows in range(-(-len(pairs) // IN_A_ROW), len(pairs) + 1):
        columns = -(-len(pairs) // rows)
        made = axes.legend(handles, labels, ncols=columns, **place, **style)
        box = made.get_window_extent()
        if box.width <= room:
            break
    if axes.figure.get_layout_engine() is None:
        _show_below(axes, box.height)


def _room(axes: Any) -> float:
    """Width around the middle of axes that is theirs in their figure, pixels."""
    box = axes.get_window_extent()
    place = axes.get_subplotspec()
    if place is None:
        return float(box.width)
    columns = place.get_gridspec().ncols
    whole = axes.figure.bbox.width
    if axes.figure.get_layout_engine() is not None:  # it moves the axes to the middle of their part
        return float(whole * len(place.colspan) / columns)
    middle = 0.5 * (box.x0 + box.x1)
    left = whole * place.colspan.start / columns
    right = whole * place.colspan.stop / columns
    return float(2.0 * min(middle - left, right - middle))


def _show_below(axes: Any, height: float) -> None:
    """Let axes with one scale in x and y show more below, by a height in pixels."""
    box = axes.get_window_extent()
    low, high = axes.get_ylim()
    per_pixel = abs(np.diff(axes.get_xlim())[0]) / box.width
    shown = high - low + height * per_pixel
    if shown > box.height * per_pixel:  # the height of the axes limits the scale
        shown = max(shown, (high - low) / max(1.0 - height / box.height, 0.1))
    axes.set_ylim(high - shown, high)


def arrow_ends(view: View, loads: Loads) -> list[tuple[Array, Array]]:
    """Tails and tips of the arrows of tractions, forces and the body force of a load."""
    ends = []
    for arrows, length in zip(loads, LENGTHS, strict=True):
        largest = np.linalg.norm(arrows.vector, axis=1).max(initial=0.0) or 1.0
        reach = length * view.size * arrows.vector / largest
        behind = np.where(arrows.pushes, 1.0, 0.0)
        if arrows is loads[-1]:  # inside the structure: its middle is where it acts
            behind[:] = 0.5
        tail = arrows.place - behind[:, None] * reach
        ends.append((tail, tail + reach))
    return ends


def draw_live_load(axes: Any, view: View) -> list[Any]:
    """Arrows where the live load acts; entry of a legend."""
    return draw_load(axes, view, (view.tractions, view.forces, view.body), BLACK, "live load")


def draw_load(axes: Any, view: View, loads: Loads, colour: str, label: str) -> list[Any]:
    """Arrows where a load acts; entry of a legend."""
    from matplotlib import patheffects

    ends = arrow_ends(view, loads)
    halo = [patheffects.withStroke(linewidth=4.0, foreground="white")]
    for (tails, tips), width in zip(ends, (1.0, 1.6, 2.2), strict=True):
        arrow = {"arrowstyle": "-|>", "mutation_scale": 6.0 + 4.0 * width, "color": colour}
        arrow |= {"lw": width, "shrinkA": 0.0, "shrinkB": 0.0, "path_effects": halo, "zorder": 5}
        for tail, tip in zip(tails, tips, strict=True):
            axes.annotate("", tip, tail, arrowprops=arrow)
    if not sum(len(tails) for tails, _ in ends):
        return []
    style = {"marker": _arrow_marker(), "ms": 15, "ls": "none", "color": colour}
    entries: list[Any] = axes.plot([], [], label=label, **style)
    return entries


def _arrow_marker() -> Any:
    """An arrow to the right as a marker; as mathematics it would cost .1 s."""
    from matplotlib.path import Path as Outline
    from matplotlib.textpath import TextPath

    arrow = TextPath((0.0, 0.0), "\N{RIGHTWARDS ARROW}", size=10.0)
    low = arrow.vertices.min(axis=0)
    high = arrow.vertices.max(axis=0)
    return Outline(arrow.vertices - 0.5 * (low + high), arrow.codes)


def nice(value: float, steps: Sequence[float] = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)) -> float:
    """The largest of some steps times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    table = np.array(steps)
    return float(table[table <= value / power * (1.0 + 1e-9)].max(initial=1.0) * power)


def force_scale(size: Array, view: View) -> float:
    """Force per metre of drawing, N/m per m, a nice number, for forces of given sizes.

    Nine in ten are shorter than 1.2 times a block, and all than 0.35 times the structure.
    """
    typical = float(np.quantile(size, 0.9)) / (1.2 * view.block_size)
    return nice(1.5 * max(typical, float(size.max()) / (0.35 * view.size)))


def force_text(force: float) -> str:
    """A force in kN per metre of thickness, or in N or MN where that has fewer digits."""
    factor, prefix = (1e6, "M") if force >= 1e6 else (1e3, "k") if force >= 1e3 else (1.0, "")
    return f"{force / factor:.4g} {prefix}N/m"


def draw_scale(axes: Any, view: View, per_metre: float, largest: float, colour: str) -> None:
    """A bar below the lower left corner of a picture that says how long forces are drawn."""
    force = nice(min(largest, 0.3 * view.size * per_metre))
    text = f"{force_text(force)}   (1 m = {force_text(per_metre)})"
    _draw_bar(axes, view, force / per_metre, text, colour)


def draw_length(axes: Any, view: View) -> None:
    """A bar below the lower left corner of a picture that says how long a length is drawn."""
    length = nice(0.2 * view.size, (1.0, 2.0, 5.0))
    _draw_bar(axes, view, length, f"{length:g} m", "0.3")


def _draw_bar(axes: Any, view: View, length: float, text: str, colour: str) -> None:
    """A bar of a length in the drawing, m, below its lower left corner, with a text beside it."""
    x = axes.get_xlim()[0] + 0.02 * view.size
    y = axes.get_ylim()[0] - 0.02 * view.size
    axes.plot([x, x + length], [y, y], "|-", color=colour, lw=1.8, markersize=7, zorder=4)
    axes.text(x + length + 0.015 * view.size, y, text, va="center", fontsize=9)
    axes.set_ylim(y - 0.03 * view.size, None)
