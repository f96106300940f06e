"""Blocks of a DXF drawing: closed curves, or faces between lines.

The length below which points are the same is 1e-6 of the drawing, as in `meshing`. A drawing in map
coordinates is moved to its own origin, because its digits would not do for the mesh.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import InputError, checked, require
from fenics_contact.geometry.closing import ClosedJoints, Mortar
from fenics_contact.geometry.dxf.curves import (
    as_ring,
    chains_of_chords,
    end_where_they_return,
    openings_onto_lines,
    snapped_curves,
)
from fenics_contact.geometry.dxf.faces import (
    DrawnFaces,
    bounds_faces,
    faces_between,
    missed_ends,
    on_lines,
    openings,
)
from fenics_contact.geometry.dxf.reader import UNITS, Curves, read_curves
from fenics_contact.geometry.dxf.roles import MANY, CurveRoles, LayerRoles, curve_roles
from fenics_contact.geometry.meshing import Drawing, ground_level
from fenics_contact.geometry.outlines import (
    COINCIDENT,
    Segments,
    equal_outlines,
    inner_points,
    inside_outlines,
    outline_area,
    outline_problem,
    overlaps,
)
from fenics_contact.geometry.planar_cells import PENETRATION, Array

#: The level on which a structure stands, in words.
LEVEL = "the lowest level"
#: Distance from the origin from which a drawing is moved there, and distance of a block from the
#: others which is a mistake, both in sizes of the drawing.
FAR = 100.0
APART = 100.0
#: Most places that a warning lists.
PLACES = 10

# From where on something is suspicious.
#: Area of a block over the median one below which it might be a mistake.
SMALL = 1e-3
#: Mean area of the blocks of a layer over the median one above which they might be openings.
LARGE = 4.0
#: Widths of the median block, m, outside which its unit is doubtful, and for which one is proposed.
SIZES = 0.02, 3.0
USUAL = 0.08, 2.0


@dataclass(frozen=True)
class Mark:
    """A suspicious place: x and y, m, and what is there."""

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class DxfContents:
    """A DXF file as a drawing, with what is to be told of it.

    Attributes:
        drawing: Closed curves or faces between lines as blocks, lines as groups.
        unit: Unit of the file's coordinates.
        notes: What was guessed, left out and moved.
        origin: Where the origin of the drawing of blocks lies in the file, m, shape (2,).
        voids: Outlines of openings, m.
        marks: Suspicious places.
        lengths: Of the sides in every group, m, both sides where blocks touch.
        slips: What is lost because ends of lines miss each other; empty if nothing is.
    """

    drawing: Drawing
    unit: str
    notes: tuple[str, ...]
    origin: Array = field(default_factory=lambda: np.zeros(2))
    voids: Sequence[Array] = ()
    marks: Sequence[Mark] = ()
    lengths: Mapping[str, float] = field(default_factory=dict)
    slips: str = ""

    def place(self, x: float, y: float) -> str:
        """A place in the file's unit, as a CAD program shows it."""
        x, y = (np.array([x, y]) + self.origin) / UNITS[self.unit]
        return f"({x:.10g}, {y:.10g}) {self.unit}"


@checked
def read_dxf(
    path: str | Path,
    unit: str | None = None,
    roles: LayerRoles | None = None,
    close: bool = False,
    snap: float = 0.0,
) -> DxfContents:
    """Read a DXF drawing: its blocks are closed curves, or faces between lines.

    The layer of a closed polyline is the two-dimensional group of its block; faces between lines
    have that of the closed curve around them, or "blocks". The layer of a line is the
    one-dimensional group of the sides that lie on it. Without such lines, "base" is the lowest
    level. Arcs become straight sides of at most 5 degrees, which leave the arc by 0.1 % of its
    radius, the same for all blocks along an arc. Layers that are off or frozen are left out.

    Args:
        path: The file.
        unit: One of `UNITS`; by default that of the file ($INSUNITS).
        roles: Layers of blocks, lines, openings, and those left out; others are guessed.
        close: Whether stones grow to the middle of the mortar joints between them; see `closing`.
        snap: Largest way, in the drawing's unit, by which ends of lines between blocks are moved
            along their own line to where they meet another; ends that near each other become one.

    Raises:
        InputError: If ezdxf or shapely is missing, the file is no DXF, has no unit, or no block, or
            a block has no area or crosses itself.
    """
    found = read_curves(Path(path), unit)
    text = f"{found.source} has no lines; {'; '.join(found.notes) or 'it is empty'}"
    require(bool(found.curves), text)
    require(0.0 <= snap < np.inf, f"snap = {snap:g} must be a length in the drawing's unit")
    end_where_they_return(found)
    origin, size = _own_origin(found)
    near = COINCIDENT * size
    chains = chains_of_chords(found.curves, near)
    given = roles or LayerRoles()
    by_role = curve_roles(found, chains, given, near)

    def attempt(reach: float, some: CurveRoles = by_role) -> _Reading:
        """The drawing with a `snap`, before its blocks are found."""
        bounding = [*some.lines, *some.voids, *some.blocks]
        curves = found.curves
        if reach:
            curves = openings_onto_lines(curves, some.voids, some.lines, reach)
            curves = snapped_curves(curves, bounding, reach)
        return _Reading(replace(found, curves=curves), some, near, origin, reach)

    read = attempt(snap)
    slips = ""
    mend = 0.0
    try:
        try:
            read.take_blocks()
        finally:
            slips, mend = _slips(read, attempt)
        layers = by_role.layers_of_both(found.curves)
        if layers and not given.blocks:
            asked = replace(given, blocks=[found.curves[k].layer for k in by_role.blocks])
            other = curve_roles(found, chains, asked, near)
            slips = slips or _stones_by_lines(read, layers, lambda reach: attempt(reach, other))
        if close:
            read.close_joints()
        return read.contents(slips, mend)
    except InputError as error:
        if not mend:
            raise
        raise InputError(
            f"{error}; ends of lines miss each other: --snap {mend:g} may mend them"
        ) from None


def _slips(read: _Reading, attempt: Callable[[float], _Reading]) -> tuple[str, float]:
    """What a drawing loses by ends that miss each other, and the smallest `snap` that mends most.

    Lengths of one digit are tried that are as large as those missed.

    Returns:
        All of it in a line, empty if nothing is lost; the length in the drawing's unit, else 0.
    """
    missed = missed_ends(read.faces, read.near)[1] if read.faces else np.zeros(0)
    missed = missed[np.isfinite(missed)]
    step = 10.0 ** np.floor(np.log10(missed))
    mended = read
    for value in sorted({float(f"{v:.1g}") for v in np.ceil(missed / step - 1e-9) * step}):
        if value > read.snap:
            other = attempt(value)
            with suppress(InputError):
                other.take_blocks()
                if len(other.blocks) + len(other.voids) > len(mended.blocks) + len(mended.voids):
                    mended = other
    if mended is read:
        return "", 0.0
    stones, filled = (
        inside_outlines(inner_points(some), read.blocks) for some in (mended.blocks, mended.voids)
    )
    count = np.bincount(np.concatenate([stones, filled]) + 1, minlength=len(read.blocks) + 1)
    joined = np.sum((stones >= 0) & (count[stones + 1] > 1))
    parts = [
        f"{number} {what}"
        for number, what in (
            (joined, "stones are joined to their neighbours"),
            (np.sum(stones < 0), "stones are lost"),
            (np.sum(filled >= 0), "openings filled"),
        )
        if number
    ]
    return f"{', '.join(parts)}: --snap {mended.snap:g} mends them", mended.snap


def _stones_by_lines(
    read: _Reading, layers: Sequence[str], attempt: Callable[[float], _Reading]
) -> str:
    """What is lost where some stones of a layer are closed curves and others lie between lines.

    Args:
        read: The drawing with its closed curves as blocks.
        layers: With closed curves that are blocks, and lines.
        attempt: The drawing with a `snap` and faces between these lines, before blocks are found.

    Returns:
        All of it in a line, empty if nothing is lost.
    """
    other = attempt(read.snap)
    try:
        other.take_blocks()
        mend = _slips(other, attempt)[1]
        if mend:
            other = attempt(mend)
            other.take_blocks()
    except InputError:
        return ""
    count = int(np.sum(inside_outlines(inner_points(other.blocks), read.blocks) < 0))
    if not count:
        return ""
    blocks = ",".join(dict.fromkeys(read.names))
    cure = f"--blocks {shlex.quote(blocks)}{f' --snap {mend:g}' if mend else ''}"
    what = "outline" if count == 1 else "outlines"
    return (
        f"{count} {what} of lines on layer {', '.join(layers)} left out, beside closed polylines"
        f" there: if they are stones, {cure} takes them"
    )


def _own_origin(found: Curves) -> tuple[Array, float]:
    """First origin of a drawing and its size, in its unit; curves that lie far are moved there.

    The size is that of nine tenths of all points: a stray line changes nothing.
    """
    points = np.concatenate([curve.points for curve in found.curves])
    low, high = np.quantile(points, [0.05, 0.95], axis=0)
    size = float((high - low).max()) or float(np.ptp(points, axis=0).max())
    if np.abs(low).max() <= FAR * size:
        return np.zeros(2), size
    close = np.all((points >= low - size) & (points <= high + size), axis=1)
    origin = points[close].min(axis=0)
    found.curves = [replace(curve, points=curve.points - origin) for curve in found.curves]
    return origin, size


@dataclass
class _Reading:
    """A drawing while its blocks are found.

    Attributes:
        found: Its curves.
        by_role: Their roles.
        near: Distance within which points are the same.
        origin: Of the curves in the drawing.
        snap: By how much ends of lines were moved, at most.
        faces: DrawnFaces between lines; None where closed curves are the blocks.
        blocks: Outlines of blocks, in the drawing's unit.
        names: Their groups.
        voids: Outlines of openings.
        marks: Suspicious places in the drawing's unit, with texts.
    """

    found: Curves
    by_role: CurveRoles
    near: float
    origin: Array
    snap: float
    faces: DrawnFaces | None = None
    blocks: list[Array] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    voids: list[Array] = field(default_factory=list)
    marks: list[tuple[Array, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Divide arcs of the curves; take over what was said of them."""
        self.chains = chains_of_chords(self.found.curves, self.near)
        self.notes = [*self.found.notes, *self.by_role.notes]

    def _rings(self, numbers: Sequence[int]) -> list[Array]:
        """Chains of curves that end as they begin, if closed."""
        return [as_ring(self.found.curves[k], self.chains[k]) for k in numbers]

    def _place(self, point: Array) -> str:
        x, y = point + self.origin
        return f"({x:.10g}, {y:.10g}) {self.found.unit}"

    # ---- blocks

    def take_blocks(self) -> None:
        """Take the blocks: faces between lines, or closed curves."""
        if self.by_role.lines:
            self._take_faces()
        else:
            self._take_closed_curves()

    def _take_closed_curves(self) -> None:
        """Take closed curves of blocks, each once, but for those within openings."""
        from shapely.geometry import Polygon

        curves = self.found.curves
        self.voids = [self.chains[k] for k in self.by_role.voids if curves[k].closed]
        self.blocks = [self.chains[k] for k in self.by_role.blocks]
        self.names = [curves[k].layer for k in self.by_role.blocks]
        for block, name in zip(self.blocks, self.names, strict=True):
            problem = outline_problem(block)
            text = f"the block on layer '{name}' at {self._place(block[0])} {problem}"
            require(not problem, f"{self.found.source}: {text}")
        text = (
            f"{self.found.source} has no closed polyline, which would be a block; give layers of"
            " closed curves with --blocks, or of lines between blocks with --lines"
            f" ({'; '.join(self.notes) or 'it is empty'})"
        )
        require(bool(self.blocks), text)
        if self.voids:
            owner = inside_outlines(inner_points(self.blocks), self.voids)
            within = {
                k
                for k in np.flatnonzero(owner >= 0).tolist()
                if Polygon(self.blocks[k]).within(Polygon(self.voids[owner[k]]).buffer(self.near))
            }
            self._leave_out(within, "within openings")
        twice = equal_outlines(self.blocks, self.near)
        for second, first in twice.items():
            layers = " and ".join(sorted({self.names[first], self.names[second]}))
            text = f"a block on layer {layers} is drawn twice"
            self.marks.append((inner_points([self.blocks[first]])[0], text))
        self._leave_out(set(twice), "drawn twice: each is one block")
        if self.voids:
            count = len(self.blocks)
            depth = PENETRATION * self.near / COINCIDENT
            pairs, places = overlaps([*self.blocks, *self.voids], depth)
            text = (
                "an opening lies over a block, which is not cut: draw the block around it, or give"
                " --lines for the lines around blocks"
            )
            over = (pairs.min(axis=1) < count) & (pairs.max(axis=1) >= count)
            self.marks += [(place, text) for place in places[over]]

    def _leave_out(self, numbers: set[int], why: str) -> None:
        if numbers:
            self.notes.append(f"left out: {len(numbers)} closed curves {why}")
            keep = [k for k in range(len(self.blocks)) if k not in numbers]
            self.blocks = [self.blocks[k] for k in keep]
            self.names = [self.names[k] for k in keep]

    def _take_faces(self) -> None:
        """Take faces between lines as blocks, but for those within openings."""
        roles = self.by_role
        curves = self.found.curves
        lines = self._rings(roles.lines)
        voids = self._rings(roles.voids)
        closed = self._rings(roles.blocks)
        faces = faces_between([*lines, *voids], self.near)
        if closed:  # those that only name blocks bound none
            if len(faces.outlines) >= MANY * len(closed):
                closed = [ring for ring in closed if bounds_faces(ring, faces, self.near)]
            faces = faces_between([*lines, *voids, *closed], self.near)
        self.faces = faces
        self.voids = openings(faces, on_lines(faces.edges, voids, self.near))
        drawn: dict[frozenset[complex], str] = {}  # layers of lines, those of closed blocks last
        stones = {curves[k].layer for k in roles.blocks}
        for layer in sorted({curves[k].layer for k in roles.lines}, key=stones.__contains__):
            some = self._rings([k for k in roles.lines if curves[k].layer == layer])
            edges = faces.edges[on_lines(faces.edges, some, self.near)]
            drawn |= {frozenset(side): layer for side in (edges @ [1.0, 1.0j]).tolist()}
        inner = inner_points(faces.outlines)
        owner = inside_outlines(inner, [self.chains[k] for k in roles.blocks])
        void = inside_outlines(inner, self.voids) >= 0
        for k, outline in enumerate(faces.outlines):
            corners = (outline @ [1.0, 1.0j]).tolist()
            sides = [frozenset[complex](side) for side in pairwise([*corners, corners[0]])]
            layers = {drawn[side] for side in sides if side in drawn}
            if void[k] or (owner[k] < 0 and not layers):
                continue
            if faces.holes[k]:
                raise InputError(
                    f"{self.found.source}: the face at {self._place(inner[k])} has lines within"
                    " that do not touch its outline: it would be a block with a hole; draw a joint"
                    " from there to the outline, or name the layer with --voids or --ignore"
                )
            self.blocks.append(outline)
            if owner[k] >= 0:
                self.names.append(curves[roles.blocks[owner[k]]].layer)
            else:  # stones of one layer, some as closed curves, others as lines
                self.names.append(
                    *(layers if len(layers) == 1 and layers <= stones else ["blocks"])
                )
        listed = ", ".join(sorted({curves[k].layer for k in roles.lines}))
        text = (
            f"the lines on layers {listed} enclose no face, which would be a block"
            f" ({'; '.join(self.notes) or 'it is empty'})"
        )
        require(bool(self.blocks), f"{self.found.source}: {text}")
        count = f"{len(self.blocks)} blocks, {len(self.voids)} openings"
        self.notes.append(f"faces between lines: {count}")

    # ---- mortar joints

    def close_joints(self) -> None:
        """Let blocks grow to the middle of the joints between them, with the lines on their sides.

        Raises:
            InputError: If a block would cross itself.
        """
        mortar = Mortar.of(self.blocks)
        if mortar.usual == 0.0:
            self.notes.append("no joint is open that --close could close")
            return
        closed = ClosedJoints(mortar)
        for block, name, grown in zip(self.blocks, self.names, closed.outlines, strict=True):
            problem = outline_problem(grown)
            text = (
                f"{self.found.source}: the joints around the block on layer '{name}' at"
                f" {self._place(inner_points([block])[0])} cannot be closed, its outline then"
                f" {problem}; draw it up to the middle of its joints, or leave out --close"
            )
            require(not problem, text)
        self.blocks = list(closed.outlines)
        self.chains = [
            chain if curve.closed else closed.moved(chain)
            for curve, chain in zip(self.found.curves, self.chains, strict=True)
        ]
        self.notes.append(
            f"joints of {mortar.said(1.0, self.found.unit)} closed: blocks reach to their middle"
        )

    # ---- contents

    def contents(self, slips: str, mend: float) -> DxfContents:
        """The drawing in m, with its groups, and what it loses by slips; see `_slips`."""
        scale = UNITS[self.found.unit]
        # A block far from the others: the digits of all would not do.
        points = np.array([block.mean(axis=0) for block in self.blocks])
        away = np.linalg.norm(points - np.median(points, axis=0), axis=1)
        worst = int(np.argmax(away))
        block = np.median([np.ptp(block, axis=0).max() for block in self.blocks])
        size = 2.0 * float(np.median(away)) + block
        text = (
            f"{self.found.source}: the block on layer '{self.names[worst]}' at"
            f" {self._place(points[worst])} is {away[worst] / size:.3g} times the size of the"
            " drawing away from the others; delete it or name its layer with --ignore"
        )
        require(away[worst] <= APART * size, text)
        self._add_doubts(mend)
        self._add_doubtful_sizes()
        if np.any(self.origin):  # to the lower left corner of the blocks
            corner = np.concatenate(self.blocks).min(axis=0)
            self.origin = self.origin + corner
            self.blocks = [block - corner for block in self.blocks]
            self.voids = [void - corner for void in self.voids]
            self.chains = [chain - corner for chain in self.chains]
            self.marks = [(point - corner, text) for point, text in self.marks]
            place = self._place(np.zeros(2))
            self.notes.append(f"moved: map coordinates, the new origin is {place} of the drawing")
        drawing = Drawing([scale * block for block in self.blocks], self.names)
        groups, lengths = self._groups(drawing, scale)
        by_text: dict[str, list[Array]] = {}
        for point, text in self.marks:
            by_text.setdefault(text, []).append(point)
        self.notes += [
            f"warning: at {', '.join(map(self._place, points[:PLACES]))} {text}"
            + (f" (and at {len(points) - PLACES} more places)" if len(points) > PLACES else "")
            for text, points in by_text.items()
        ]
        return DxfContents(
            replace(drawing, groups=groups),
            self.found.unit,
            tuple(self.notes),
            scale * self.origin,
            [scale * void for void in self.voids],
            [Mark(scale * point[0], scale * point[1], text) for point, text in self.marks],
            lengths,
            slips,
        )

    def _add_doubts(self, mend: float) -> None:
        """Mark ends of lines that stop short of another, or within a block, and open blocks."""
        found = self.found
        if self.faces is not None:
            ends, distance = missed_ends(self.faces, self.near, max(self.snap, mend))
            others = ends[np.isinf(distance)]
            within = others[inside_outlines(others, self.blocks) >= 0]
            for some, text in (
                (
                    ends[np.isfinite(distance)],
                    "ends short of another: extend it, or blocks are one",
                ),
                (within, "ends within a block, which it does not divide: extend it"),
            ):
                self.marks += [(end, f"a line {text}") for end in some]
        rings = [np.concatenate([block, block[:1]]) for block in self.blocks]
        for k in self.by_role.sides:
            chain = self.chains[k]
            layer = found.curves[k].layer
            if layer in self.names and len(chain) > 2 and not found.curves[k].closed:
                edges = np.stack([chain[:-1], chain[1:]], axis=1)
                inside = inside_outlines(inner_points([chain]), self.blocks)[0] >= 0
                if not (inside and on_lines(edges, rings, self.near).all()):
                    text = f"an open polyline on layer '{layer}' is no block: close it if it is one"
                    self.marks.append((chain[0], text))

    def _add_doubtful_sizes(self) -> None:
        """Mark blocks much smaller than most; warn of layers of large ones, and of the unit."""
        areas = np.array([abs(outline_area(block)) for block in self.blocks])
        median = float(np.median(areas))
        self.marks += [
            (
                inner_points([self.blocks[k]])[0],
                f"a block on layer '{self.names[k]}' has less than a thousandth of the median area:"
                " a sliver between lines that do not meet?",
            )
            for k in np.flatnonzero(areas < SMALL * median).tolist()
        ]
        for name, count in Counter(self.names).items():
            large = areas[np.array(self.names) == name].mean() / median
            if large > LARGE and count < 0.5 * len(self.names):
                one = count == 1
                self.notes.append(
                    f"warning: the {'block' if one else f'{count} blocks'} on layer '{name}'"
                    f" {'is' if one else 'are'} {large:.1f} times as large as the median; if"
                    f" {'it is an opening' if one else 'they are openings'}, give --voids {name}"
                )
        unit = self.found.unit
        width = float(np.sqrt(median))
        size = width * UNITS[unit]
        # A file that says inch may not have set it.
        unsaid = unit == "in" and not self.found.unit_given
        if unsaid or not SIZES[0] <= size <= SIZES[1]:
            likely = [
                f"--unit {name} makes it {width * metres:.3g} m"
                for name, metres in UNITS.items()
                if name != unit and USUAL[0] <= width * metres <= USUAL[1]
            ]
            self.notes.append(
                f"warning: is the unit {unit}? The median block is {size:.3g} m wide (the root of"
                f" its area); {', '.join(likely) or 'if not, give --unit'}"
            )

    def _groups(self, drawing: Drawing, scale: float) -> tuple[Segments, dict[str, float]]:
        """Groups of the lines on which sides of blocks lie, or of the ground; their lengths, m.

        Raises:
            InputError: If the drawing stands on nothing.
        """
        roles = self.by_role
        curves = self.found.curves
        faces = bool(roles.lines)
        drawn = not faces and any(not curves[k].closed for k in roles.sides)
        lines: dict[str, list[npt.ArrayLike]] = {}
        numbers = [*roles.sides, *(roles.lines + roles.voids if faces else ())]
        for k, ring in zip(numbers, self._rings(numbers), strict=True):
            lines.setdefault(curves[k].layer, []).extend(pairwise(scale * ring))
        every = replace(drawing, groups=lines).lengths()
        self.notes += [
            f"left out: lines on layer '{name}', as no side of a block lies on them"
            for name in lines
            if every[name] == 0.0
        ]
        groups: Segments = {name: lines[name] for name in sorted(lines) if every[name] > 0.0}
        if not groups or (not drawn and "base" not in map(str.lower, groups)):
            why = "" if groups else "no lines on sides of blocks: "
            self.notes.append(f'{why}the group "base" is {LEVEL}')
            level = ground_level(list(drawing.blocks))
            every |= replace(drawing, groups=level).lengths()
            groups = {**groups, **level}
            corners = np.concatenate(self.blocks)
            place = self._place(corners[np.argmin(corners[:, 1])])
            text = "to stand on; draw lines on a layer of their own where the structure stands"
            text = f"no side of a block lies on {LEVEL}, at {place}, {text}"
            require(every["base"] > 0.0, f"{self.found.source}: {text}")
        return groups, {name: every[name] for name in groups}
