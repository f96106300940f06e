"""From a DXF file to a gmsh file: what was made, in words and in a picture."""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import InputError, plain, require
from fenics_contact.geometry.closing import Mortar
from fenics_contact.geometry.dxf.blocks import PLACES, DxfContents, Mark, read_dxf
from fenics_contact.geometry.dxf.reader import UNITS
from fenics_contact.geometry.dxf.roles import LayerRoles
from fenics_contact.geometry.dxf.starter import GroupRoles, starter_text, with_ground
from fenics_contact.geometry.gmsh_mesh import REMARK, gmsh_session
from fenics_contact.geometry.meshing import Drawing, default_size
from fenics_contact.geometry.outlines import overlaps, sides_of_outlines
from fenics_contact.geometry.planar_cells import PENETRATION, Array, Indices

#: Largest number of cells; a limit load of more takes days.
CELLS = 2e6
#: Fill colours of blocks by layer, and colours of lines by layer (Okabe and Ito).
FILLS = ("#d9e3ec", "#f3e3c3", "#cfdcc5", "#e2cdd6", "#d5d5da", "#eedfae")
LINES = ("#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
SUSPICIOUS = "#D55E00"
#: Width of a picture, inches; most blocks that are numbered one by one.
WIDTH = 12.0
NUMBERED = 3000


@dataclass(frozen=True)
class MeshOrder:
    """What `fenics-contact mesh` is asked for.

    Attributes:
        drawing: The DXF file; see `read_dxf`.
        output: The .msh file; by default beside the drawing, with its name.
        size: Largest length of an element along the sides, m; see `meshing.polygons`.
        unit: See `read_dxf`.
        roles: See `read_dxf`.
        picture: File for a picture of what was read, or none.
        scene: File that a scene for the mesh will be written to, or none: the drawing gets a ground
            then.
        close: See `read_dxf`.
        snap: See `read_dxf`.
    """

    drawing: Path
    output: Path | None = None
    size: float | None = None
    unit: str | None = None
    roles: LayerRoles = field(default_factory=LayerRoles)
    picture: Path | None = None
    scene: Path | None = None
    close: bool = False
    snap: float = 0.0

    @property
    def mesh(self) -> Path:
        """The .msh file."""
        return self.drawing.with_suffix(".msh") if self.output is None else self.output

    def check(self) -> None:
        """Refuse names of files that cannot be written, or not without loss, and sizes."""
        require(self.mesh.suffix == ".msh", f"'{self.mesh}' must end with .msh, for gmsh")
        good = self.size is None or 0.0 < self.size < np.inf
        require(good, f"size = {self.size or 0.0:g} must be a positive length, m")
        if self.scene is not None:
            name = f"'{self.scene}'"
            require(self.scene.suffix == ".toml", f"{name} must end with .toml, as scenes do")
            there = self.scene.parent.is_dir()
            require(there, f"cannot write to {name}: its folder does not exist")
            new = not os.path.lexists(self.scene)
            require(new, f"{name} is there already; give --scene another name")


@dataclass(frozen=True)
class MeshedDrawing:
    """A drawing whose mesh was written.

    Attributes:
        read: The drawing.
        lines: What was made and guessed and what to do next, for people.
        closing_gap: `joints.default.gap` that closes gaps between blocks, m, as text; empty if
            there are none.
        mortar: Thickness of the joints that --close closes, as text; empty if there are none.
    """

    read: DxfContents
    lines: Sequence[str]
    closing_gap: str
    mortar: str


def mesh_drawing(order: MeshOrder) -> MeshedDrawing:
    """Mesh a DXF drawing and write it for gmsh, with a scene to begin with if it is asked for.

    Raises:
        InputError: If the drawing is wrong or blocks overlap, or the mesh cannot be written; no
            mesh is written then.
    """
    order.check()
    read = read_dxf(order.drawing, order.unit, order.roles, order.close, order.snap)
    roles = None
    if order.scene is not None:
        read, roles = with_ground(read)
    drawing = read.drawing
    blocks = list(drawing.blocks)
    size = order.size or default_size(blocks)
    smallest = min(float(np.ptp(block, axis=0).min()) for block in blocks) or 1.0
    pairs, places = overlaps(blocks, PENETRATION * min(size, smallest))
    mortar = Mortar.of(blocks)
    most = float(mortar.range[1])
    gaps = drawing.gaps(most)
    if order.close:  # corners of the outline beside a joint that was closed face nothing
        gaps = gaps[gaps[:, 3] > 0.0]
    if order.picture is not None:
        marks = [*read.marks, *(Mark(x, y, "gap") for x, y in gaps[:, :2].tolist())]
        marks += [Mark(x, y, "overlap") for x, y in places.tolist()]
        write_picture(read, marks, order.picture)
    if len(pairs):
        raise InputError(_overlap_message(read, pairs, places, f"'{order.drawing}'"))
    width, height = np.ptp(np.concatenate(blocks), axis=0)
    text = f"larger than the drawing, {width:g} m x {height:g} m; give --size in m"
    require(size <= max(width, height), f"elements of {size:g} m are {text}")
    # Two triangles or more for each square, and the squares of four elements by default.
    cells = 32.0 * len(blocks) * (default_size(blocks) / size) ** 2
    sides = np.diff(sides_of_outlines(blocks), axis=1)[:, 0]
    cells = max(cells, float(np.linalg.norm(sides, axis=1).sum()) / size)
    text = f"elements of {size:g} m would be {cells:.1g} cells; give a larger --size"
    require(cells <= CELLS, text)
    triangles = _meshed(drawing, size, order.mesh, read.slips)
    by_layer = [f"{name} {count}" for name, count in Counter(drawing.names).items()]
    lengths = [f"{name} {length:g} m" for name, length in read.lengths.items()]
    thickness = mortar.said(UNITS[read.unit], read.unit)
    gap, warnings = _gap_warning(read, gaps, most, thickness)
    lines = [
        f"{order.drawing}: {len(blocks)} blocks, {width:g} m x {height:g} m ({read.unit})",
        f"blocks by layer: {', '.join(by_layer) or 'none'}",
        f"sides by layer: {', '.join(lengths) or 'none'}",
        f"mesh: {triangles} triangles, elements of at most {size:.3g} m along the sides",
        *read.notes,
        *warnings,
        *([f"picture of what was read: {order.picture}"] if order.picture else ()),
        f"written to {order.mesh}",
        *_next(order, read, roles, gap, thickness),
        *([read.slips] if read.slips else ()),
    ]
    return MeshedDrawing(read, lines, gap, thickness)


def _next(
    order: MeshOrder, read: DxfContents, roles: GroupRoles | None, gap: str, mortar: str
) -> list[str]:
    """Write the scene, if it is asked for; what was guessed in it and what to do next."""
    if order.scene is None or roles is None:
        write = f'write a scene with mesh.file = "{order.mesh.name}"'
        return [f"next: {write}, or let --scene FILE.toml do it; then: fenics-contact check SCENE"]
    mesh = Path(os.path.relpath(order.mesh, order.scene.parent)).as_posix()
    try:
        with order.scene.open("x", encoding="utf-8") as file:  # one that is there stays
            file.write(starter_text(order.drawing.stem, mesh, read, roles, gap, mortar))
    except OSError as error:
        raise InputError(f"cannot write to '{order.scene}': {error.strerror}") from None
    ground = ", ".join(f"'{name}'" for name in roles.ground)
    return [
        f"the ground is {ground}: guessed, {roles.why}",
        f"scene written to {order.scene}: materials, frictions and the live load are usual values,"
        " set them right",
        f"next: fenics-contact check {order.scene}, then: fenics-contact solve {order.scene}",
    ]


def _overlap_message(read: DxfContents, pairs: Indices, places: Array, source: str) -> str:
    names = read.drawing.names
    first, second = (names[k] for k in pairs[0])
    layers = Counter(" and ".join(sorted({names[a], names[b]})) for a, b in pairs.tolist())
    listed = ", ".join(f"{count} on {layer}" for layer, count in layers.most_common(3))
    more = f" ({len(pairs)} overlaps: {listed})" if len(pairs) > 1 else ""
    on = f"both on layer '{first}'"
    cure = "draw them side by side, each once"
    if len(set(names)) > 1:
        on = f"on layers '{first}' and '{second}'"
        cure = (
            "draw them side by side, or name layers of openings with --voids, of joints with"
            " --lines, and those that are no stones with --ignore"
        )
    shown = ", ".join(read.place(*place) for place in places[:PLACES])
    return f"{source}: blocks overlap at {shown}, {on}{more}; {cure}"


def _gap_warning(
    read: DxfContents, gaps: Array, thickest: float, mortar: str
) -> tuple[str, list[str]]:
    """How many corners lie beside another block, how far, and how to close the gaps.

    Args:
        read: The drawing.
        gaps: See `Drawing.gaps`.
        thickest: Of the mortar joints, m, 0 for none.
        mortar: Their thickness as text.

    Returns:
        A distance, m, that is a little larger than mortar joints, else than the largest gap, as
        text, and the warning; empty where there are no gaps.
    """
    if not len(gaps):
        return "", []
    facing = gaps[gaps[:, 3] > 0.0] if np.any(gaps[:, 3]) else gaps  # corner and side
    least = facing[:, 2].min()
    most = facing[:, 2].max()
    step = 10.0 ** (np.floor(np.log10(thickest or most)) - 1.0)
    gap = f"{np.ceil(1.05 * (thickest or most) / step) * step:.2g}"
    in_unit = " to ".join(dict.fromkeys(f"{d / UNITS[read.unit]:.3g}" for d in (least, most)))
    many = len(gaps) > len(read.drawing.blocks)
    lines = [
        f"warning: {len(gaps)} corners lie beside another block without touching it, {in_unit}"
        f" {read.unit} away ({facing[0, 2]:.2g} m at {read.place(*facing[0, :2])})"
        f"{': mortar joints?' if many else ''}"
    ]
    if mortar:
        lines.append(
            f"joints of {mortar} are open: if that is mortar, give --close, which lets the blocks"
            " reach to the middle of their joints; mortar has a height"
        )
    cure = "if they must close first" if mortar else "these joints are open; to close them"
    lines.append(
        f"{cure} write joints.default.gap = {gap} in the scene, or"
        f" fenics-contact solve SCENE --set joints.default.gap={gap}; or draw the blocks side by"
        " side"
    )
    return gap, lines


def _meshed(drawing: Drawing, size: float, output: Path, remark: str) -> int:
    """Mesh a drawing and write it, as a whole or not at all; returns the number of triangles."""
    part = output.with_name(f".{output.stem}.{os.getpid()}.msh")
    try:
        require(not output.is_dir(), f"cannot write to '{output}': it is a folder")
        part.touch()  # gmsh does not say why it cannot
        drawing.mesh(size)
        with gmsh_session() as gmsh:
            tags, _ = gmsh.model.mesh.getElementsByType(2)
            gmsh.write(str(part))
        if remark:
            with part.open("a", encoding="utf-8") as file:
                file.write(REMARK.format(remark))
        part.replace(output)
    except OSError as error:
        raise InputError(f"cannot write to '{output}': {error.strerror}") from None
    finally:
        with suppress(OSError):  # a disk that is read-only says so once more
            part.unlink(missing_ok=True)
    return len(tags)


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
