"""Parts of pictures: outlines, blocks by material, joints by what they do, loads, scales.

Colours are those of M. Okabe and K. Ito, which the colour-blind tell apart; line widths and double
lines tell the same in grey. Matplotlib is imported where it is used: that takes .4 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_contact.errors import plain
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.fields import facet_contact
from fenics_contact.output.view import Loads, View, outlines
from fenics_contact.results.values import Contact, TieState

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


def extent(view: View, *more: Array) -> Array:
    """Corners, low and high, m, of the blocks at rest, arrows of loads, more points, a margin."""
    ties = [] if view.ties is None else [view.ties.bars.sides]
    tables = [view.rest, *ties, *more, *arrow_ends(view, view.live)]
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


def tints(view: View) -> Array:
    """Colour of every block by its material, RGB."""
    from matplotlib.colors import to_rgb

    return np.array([to_rgb(tint) for tint in TINTS])[view.material % len(TINTS)]


def draw_outlines(axes: Any, view: View, ends: Array, **style: Any) -> Any:
    """Closed paths around all blocks, for given ends of the facets, by material; the artist."""
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Outline

    paths = [
        Outline.make_compound_path(*(Outline([*loop, loop[0]], closed=True) for loop in of_body))
        for of_body in outlines(view.boundary, ends)
    ]
    style = {"facecolor": tints(view), "edgecolor": "0.4", "linewidth": 0.5} | style
    return axes.add_collection(PathCollection(paths, **style))


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
        for colour, width in strokes:
            add_lines(axes, position[joints.segments[chosen]], colors=colour, linewidths=width)
        lines = [axes.plot([], [], color=colour, lw=width)[0] for colour, width in strokes]
        entries.append((label, tuple(lines)))
    points = view.values.hinges(joints.neighbours)
    if len(points):
        style = {"mfc": "white", "mec": "black", "mew": 0.8, "ms": max(4.5 * fine, 2.0)}
        entries += axes.plot(*position[points].T, "o", label="hinge", **style)
    return entries


def draw_ties(axes: Any, view: View, motion: Array | float = 0.0) -> list[Any]:
    """Ties, displaced by a motion, (bars, 2, 2), by what they do; entries of a legend."""
    if view.ties is None:
        return []
    entries: list[Any] = []
    for label, state, style in (
        ("tie yields", TieState.YIELDS, {"lw": 2.6, "ls": "-"}),
        ("tie", TieState.ELASTIC, {"lw": 1.4, "ls": "-"}),
        ("tie slack", TieState.SLACK, {"lw": 1.2, "ls": (0, (4, 3))}),
    ):
        ends = (view.ties.bars.sides + motion)[view.ties.state == state]
        for tie in ends:
            (line,) = axes.plot(*tie.T, marker="s", ms=4.0, color=GREEN, zorder=4, **style)
        if len(ends):
            entries.append((label, line))
    return entries


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
    from matplotlib.path import Path as Outline
    from matplotlib.textpath import TextPath

    ends = arrow_ends(view, loads)
    halo = [patheffects.withStroke(linewidth=4.0, foreground="white")]
    for arrows, width in zip(ends, WIDTHS, strict=True):
        arrow = {"arrowstyle": "-|>", "mutation_scale": 6.0 + 4.0 * width, "color": colour}
        arrow |= {"lw": width, "shrinkA": 0.0, "shrinkB": 0.0, "path_effects": halo, "zorder": 5}
        for tail, tip in arrows:
            axes.annotate("", tip, tail, arrowprops=arrow)
    if not sum(map(len, ends)):
        return []
    # An arrow to the right as a marker; as mathematics it would cost .1 s.
    text = TextPath((0.0, 0.0), "\N{RIGHTWARDS ARROW}", size=10.0)
    middle = 0.5 * (text.vertices.min(axis=0) + text.vertices.max(axis=0))
    marker = Outline(text.vertices - middle, text.codes)
    entries: list[Any] = axes.plot(
        [], [], label=label, marker=marker, ms=15, ls="none", color=colour
    )
    return entries


def nice(value: float, steps: Sequence[float] = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)) -> float:
    """The largest of some steps times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    table = np.array(steps)
    return float(table[table <= value / power * (1.0 + 1e-9)].max(initial=1.0) * power)


def force_text(force: float) -> str:
    """A force in kN per metre of thickness, or in N or MN where that has fewer digits."""
    factor, prefix = (1e6, "M") if force >= 1e6 else (1e3, "k") if force >= 1e3 else (1.0, "")
    return f"{force / factor:.4g} {prefix}N/m"


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
