"""Picture of what was read of a drawing: blocks with numbers, layers, suspicious places."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import InputError, plain
from fenics_contact.geometry.dxf.blocks import DxfContents, Mark

#: Fill colours of blocks by layer, and colours of lines by layer (Okabe and Ito).
FILLS = ("#d9e3ec", "#f3e3c3", "#cfdcc5", "#e2cdd6", "#d5d5da", "#eedfae")
LINES = ("#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
SUSPICIOUS = "#D55E00"
#: Width of a picture, inches; most blocks that are numbered one by one.
WIDTH = 12.0
NUMBERED = 3000


def write_picture(read: DxfContents, marks: Sequence[Mark], target: Path) -> None:
    """Write a picture of a drawing, its ending says in which format.

    Raises:
        InputError: If the file cannot be written or its ending is unknown.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.figure import Figure

    drawing = read.drawing
    corners = np.concatenate(drawing.blocks)
    width, height = np.ptp(corners, axis=0)
    tall = float(np.clip(WIDTH * height / width, 3.0, 2.0 * WIDTH))
    figure = Figure(figsize=(WIDTH, tall))
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()

    style: dict[str, Any] = {"edgecolors": "0.35", "linewidths": 0.5}
    for fill, name in zip(cycle(FILLS), dict.fromkeys(drawing.names), strict=False):
        some = [b for b, own in zip(drawing.blocks, drawing.names, strict=True) if own == name]
        label = plain(f"{name}: {len(some)} blocks")
        axes.add_collection(PolyCollection(some, label=label, facecolors=fill, **style))
    if read.voids:
        style = {"facecolors": "none", "edgecolors": "0.6", "hatch": "///", "linewidths": 0.8}
        label = f"openings: {len(read.voids)}"
        axes.add_collection(PolyCollection(read.voids, label=label, **style))
    for number, block in enumerate(drawing.blocks if len(drawing.blocks) <= NUMBERED else ()):
        low, high = block.min(axis=0), block.max(axis=0)
        points = 72.0 * min(WIDTH / width, tall / height) * (high - low)
        font = min(9.0, 0.6 * points[1], points[0] / (0.8 * len(str(number))))
        middle = 0.5 * (low + high) if len(block) < 5 else block.mean(axis=0)
        if font > 1.0:
            axes.text(*middle, str(number), size=font, ha="center", va="center", color="0.25")

    style = {"linewidths": 1.6, "alpha": 0.8}
    for colour, (name, segments) in zip(cycle(LINES), drawing.groups.items(), strict=False):
        lines = [np.reshape(segment, (2, 2)) for segment in segments]
        label = plain(f"sides of {name}: {read.lengths[name]:.4g} m")
        axes.add_collection(LineCollection(lines, label=label, colors=colour, **style))

    kinds: dict[str, list[Mark]] = {}
    for mark in marks:
        kinds.setdefault(mark.text, []).append(mark)
    style = {"facecolors": "none", "edgecolors": SUSPICIOUS, "linewidths": 1.2, "zorder": 5}
    beside = {"size": 6, "textcoords": "offset points", "color": SUSPICIOUS, "zorder": 6}
    for number, (text, alike) in enumerate(kinds.items(), start=1):  # its number in the legend
        x, y = np.array([(mark.x, mark.y) for mark in alike]).T
        label = text if len(text) < 70 else f"{text[:67]}..."
        axes.scatter(x, y, s=60, label=plain(f"{number}: {label} ({len(alike)} places)"), **style)
        for place in zip(x, y, strict=True):
            axes.annotate(str(number), place, (4, 3), **beside)

    margin = 0.04 * max(width, height)
    axes.set_xlim(corners[:, 0].min() - margin, corners[:, 0].max() + margin)
    axes.set_ylim(corners[:, 1].min() - margin, corners[:, 1].max() + margin)
    axes.set_aspect("equal")
    axes.set_xlabel("x in m")
    axes.set_ylabel("y in m")
    axes.set_title(f"{len(drawing.blocks)} blocks, {width:.4g} m x {height:.4g} m")
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.6 / tall)}
    axes.legend(ncol=3, fontsize=9, frameon=False, **below)
    try:
        with warnings.catch_warnings():  # characters of layers that the font lacks
            warnings.simplefilter("ignore", UserWarning)
            figure.savefig(target, dpi=150, bbox_inches="tight")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot write the picture to '{target}': {reason}") from None
