"""Blocks of a DXF drawing: closed curves, or faces between lines.

The length below which points are the same is 1e-6 of the drawing, as in `meshing`. A drawing in map
coordinates is moved to its own origin, because its digits would not do for the mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import InputError
from fenics_contact.errors.checks import checked
from fenics_contact.geometry.closing import ClosedJoints, Mortar
from fenics_contact.geometry.drawing import Drawing
from fenics_contact.geometry.dxf import doubts
from fenics_contact.geometry.dxf.chords import as_ring, chains_of_chords
from fenics_contact.geometry.dxf.faces import (
    Faces,
    faces_between,
    on_lines,
    openings,
)
from fenics_contact.geometry.dxf.reader import UNITS, Curve, Curves, read_curves
from fenics_contact.geometry.dxf.returns import end_where_they_return
from fenics_contact.geometry.dxf.roles import MANY, CurveRoles, LayerRoles, curve_roles
from fenics_contact.geometry.dxf.slips import Slips, slips_between, values_to_try
from fenics_contact.geometry.dxf.snap import snapped_curves
from fenics_contact.geometry.meshing import COINCIDENT, Segments, lowest_level, outline_problem
from fenics_contact.geometry.outlines import equal_outlines, inside_outlines
from fenics_contact.geometry.planar_cells import PENETRATION, Array

#: Distance from the origin from which a drawing is moved there, and distance of a block from the
#: others which is a mistake, both in sizes of the drawing.
FAR = 100.0
APART = 100.0
#: Most places that a warning lists.
PLACES = 10


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
        return _place((np.array([x, y]) + self.origin) / UNITS[self.unit], self.unit)


def _place(point: Array, unit: str) -> str:
    return f"({point[0]:.10g}, {point[1]:.10g}) {unit}"


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
    if not found.curves:
        raise InputError(f"{found.source} has no lines; {_listed_notes(found.notes)}")
    if not 0.0 <= snap < np.inf:
        raise InputError(f"snap = {snap:g} must be a length in the drawing's unit")
    end_where_they_return(found)
    origin, size = _own_origin(found)
    near = COINCIDENT * size
    chains = chains_of_chords(found.curves, near)
    by_role = curve_roles(found, chains, roles or LayerRoles(), near)

    def attempt(reach: float) -> _Reading:
        curves = snapped_curves(found.curves, by_role.bounding, reach) if reach else found.curves
        return _Reading(replace(found, curves=curves), by_role, near, origin, reach)

    return _with_slips_told(attempt, snap, close)


def _with_slips_told(attempt: Callable[[float], _Reading], snap: float, close: bool) -> DxfContents:
    """Contents of a drawing read with a `snap`, and what a larger one mends; see `read_dxf`."""
    read = attempt(snap)
    failure = None
    try:
        read.take_blocks()
    except InputError as error:
        failure = error
    slips = _slips(read, attempt)
    try:
        if failure is not None:
            raise failure
        if close:
            read.close_joints()
        return read.contents(slips)
    except InputError as error:
        if not slips.snap:
            raise
        raise InputError(
            f"{error}; ends of lines miss each other: --snap {slips.snap:g} may mend them"
        ) from None


def _slips(read: _Reading, attempt: Callable[[float], _Reading]) -> Slips:
    """What a drawing loses by ends that miss each other, by the smallest `snap` that mends most."""
    mended = read
    for value in read.values_to_try():
        other = attempt(value)
        try:
            other.take_blocks()
        except InputError:
            continue
        if len(other.blocks) + len(other.voids) > len(mended.blocks) + len(mended.voids):
            mended = other
    if mended is read:
        return Slips()
    return slips_between(read.blocks, (mended.blocks, mended.voids), mended.snap)


def _listed_notes(notes: Sequence[str]) -> str:
    return "; ".join(notes) or "it is empty"


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


class _Reading:
    """A drawing while its blocks are found.

    Attributes:
        blocks: Outlines of blocks, in the drawing's unit.
        names: Their groups.
        voids: Outlines of openings.
        notes: What is said.
        marks: Suspicious places in the drawing's unit, with texts.
    """

    def __init__(
        self,
        found: Curves,
        by_role: CurveRoles,
        near: float,
        origin: Array,
        snap: float,
    ) -> None:
        self.found = found
        self.chains = chains_of_chords(found.curves, near)
        self.by_role = by_role
        self.near = near
        self.origin = origin
        self.snap = snap
        self.faces: Faces | None = None
        self.blocks: list[Array] = []
        self.names: list[str] = []
        self.voids: list[Array] = []
        self.notes = [*found.notes, *by_role.notes]
        self.marks: list[tuple[Array, str]] = []

    def _curve(self, number: int) -> Curve:
        return self.found.curves[number]

    def _rings(self, numbers: Sequence[int]) -> list[Array]:
        """Chains of curves that end as they begin, if closed."""
        return [as_ring(self._curve(k), self.chains[k]) for k in numbers]

    def _place(self, point: Array) -> str:
        return _place(point + self.origin, self.found.unit)

    # ---- blocks

    def take_blocks(self) -> None:
        """Take the blocks: faces between lines, or closed curves."""
        if self.by_role.lines:
            self.take_faces()
        else:
            self.take_closed_curves()

    def take_closed_curves(self) -> None:
        """Take every closed curve of blocks as a block, but for those within openings."""
        self.voids = [self.chains[k] for k in self.by_role.voids if self._curve(k).closed]
        for k in self.by_role.blocks:
            curve = self._curve(k)
            if problem := outline_problem(self.chains[k]):
                place = self._place(self.chains[k][0])
                raise InputError(
                    f"{self.found.source}: the block on layer '{curve.layer}' at {place} {problem}"
                )
            self.blocks.append(self.chains[k])
            self.names.append(curve.layer)
        if not self.blocks:
            raise InputError(
                f"{self.found.source} has no closed polyline, which would be a block; give layers"
                " of closed curves with --blocks, or of lines between blocks with --lines"
                f" ({_listed_notes(self.notes)})"
            )
        self._leave_out(_in_openings(self.blocks, self.voids, self.near), "within openings")
        self._leave_out(self._drawn_twice(), "drawn twice: each is one block")
        depth = PENETRATION * self.near / COINCIDENT
        self.marks += doubts.openings_over_blocks(self.blocks, self.voids, depth)

    def take_faces(self) -> None:
        """Take faces between lines as blocks, but for those within openings."""
        roles = self.by_role
        closed = [self.chains[k] for k in roles.blocks]
        faces = self.faces = self._faces()
        drawn = on_lines(faces.edges, self._rings(roles.voids), self.near)
        self.voids = openings(faces, drawn)
        by_lines = self._bounded_by_lines(faces)
        owner = np.full(len(faces.outlines), -1)
        void = np.zeros(len(faces.outlines), dtype=bool)
        if closed or self.voids:
            inner = np.array([doubts.inner_point(outline) for outline in faces.outlines])
            owner = inside_outlines(inner.reshape(-1, 2), closed)
            void = inside_outlines(inner.reshape(-1, 2), self.voids) >= 0
        for k, outline in enumerate(faces.outlines):
            if void[k] or (owner[k] < 0 and not by_lines[k]):
                continue
            if faces.holes[k]:
                place = self._place(doubts.inner_point(outline))
                raise InputError(
                    f"{self.found.source}: the face at {place} has lines within"
                    " that do not touch its outline: it would be a block with a hole; draw a joint"
                    " from there to the outline, or name the layer with --voids or --ignore"
                )
            self.blocks.append(outline)
            self.names.append(
                self._curve(roles.blocks[owner[k]]).layer if owner[k] >= 0 else "blocks"
            )
        if not self.blocks:
            raise InputError(
                f"{self.found.source}: the lines on layers {self._layers(roles.lines)} enclose no"
                f" face, which would be a block ({_listed_notes(self.notes)})"
            )
        self.notes.append(
            f"faces between lines: {len(self.blocks)} blocks, {len(self.voids)} openings"
        )

    def _faces(self) -> Faces:
        """Faces between lines and closed curves, but for those that only name blocks."""
        roles = self.by_role
        rings = self._rings([*roles.lines, *roles.voids])
        closed = self._rings(roles.blocks)
        faces = faces_between(rings, self.near)
        if closed and len(faces.outlines) >= MANY * len(closed):
            closed = [ring for ring in closed if doubts.bounds_faces(ring, faces, self.near)]
        return faces_between([*rings, *closed], self.near) if closed else faces

    def values_to_try(self) -> list[float]:
        """Larger values of `snap` with which an end in the air might meet another line."""
        missed = doubts.missed_ends(self.faces, self.near)[1] if self.faces else np.zeros(0)
        return [value for value in values_to_try(missed) if value > self.snap]

    def _bounded_by_lines(self, faces: Faces) -> list[bool]:
        """Which faces have a side on a line between blocks."""
        edges = faces.edges[on_lines(faces.edges, self._rings(self.by_role.lines), self.near)]
        known = {tuple(sorted(map(tuple, edge))) for edge in edges.tolist()}
        found = []
        for outline in faces.outlines:
            corners = [tuple(corner) for corner in outline.tolist()]
            sides = pairwise([*corners, corners[0]])
            found.append(any(tuple(sorted(side)) in known for side in sides))
        return found

    def _layers(self, numbers: Sequence[int]) -> str:
        return ", ".join(sorted({self._curve(k).layer for k in numbers}))

    def _drawn_twice(self) -> set[int]:
        """Blocks with the outline of one before, which are marked."""
        twice = equal_outlines(self.blocks, self.near)
        for first, second in twice:
            layers = " and ".join(sorted({self.names[first], self.names[second]}))
            text = f"a block on layer {layers} is drawn twice"
            self.marks.append((doubts.inner_point(self.blocks[first]), text))
        return {second for _, second in twice}

    def _leave_out(self, numbers: set[int], why: str) -> None:
        if numbers:
            self.notes.append(f"left out: {len(numbers)} closed curves {why}")
            keep = [k for k in range(len(self.blocks)) if k not in numbers]
            self.blocks = [self.blocks[k] for k in keep]
            self.names = [self.names[k] for k in keep]

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
            if problem := outline_problem(grown):
                raise InputError(
                    f"{self.found.source}: the joints around the block on layer '{name}' at"
                    f" {self._place(doubts.inner_point(block))} cannot be closed, its outline then"
                    f" {problem}; draw it up to the middle of its joints, or leave out --close"
                )
        self.blocks = list(closed.outlines)
        self.chains = [
            chain if self._curve(k).closed else closed.moved(chain)
            for k, chain in enumerate(self.chains)
        ]
        self.notes.append(
            f"joints of {mortar.said(1.0, self.found.unit)} closed: blocks reach to their middle"
        )

    # ---- contents

    def contents(self, slips: Slips) -> DxfContents:
        """The drawing in m, with its groups, and what it loses by slips."""
        scale = UNITS[self.found.unit]
        self._refuse_far_blocks()
        self._add_doubts(slips)
        self._move_to_blocks()
        lengths: dict[str, float] = {}
        groups = self._groups(lengths)
        by_text: dict[str, list[Array]] = {}
        for point, text in self.marks:
            by_text.setdefault(text, []).append(point)
        self.notes += [
            f"warning: at {', '.join(map(self._place, points[:PLACES]))} {text}"
            + (f" (and at {len(points) - PLACES} more places)" if len(points) > PLACES else "")
            for text, points in by_text.items()
        ]
        return DxfContents(
            Drawing([scale * block for block in self.blocks], self.names, groups),
            self.found.unit,
            tuple(self.notes),
            scale * self.origin,
            [scale * void for void in self.voids],
            [Mark(scale * point[0], scale * point[1], text) for point, text in self.marks],
            lengths,
            slips.text,
        )

    def _add_doubts(self, slips: Slips) -> None:
        """Add what looks wrong."""
        found = self.found
        if self.faces is not None:
            stub = max(self.snap, slips.snap)
            self.marks += doubts.free_ends(self.faces, self.blocks, self.near, stub)
        rings = [np.concatenate([block, block[:1]]) for block in self.blocks]
        for k in self.by_role.sides:
            chain = self.chains[k]
            if self._curve(k).layer in self.names and len(chain) > 2 and not self._curve(k).closed:
                edges = np.stack([chain[:-1], chain[1:]], axis=1)
                inner = doubts.inner_point(chain)[None]
                on_sides = on_lines(edges, rings, self.near).all()
                if not on_sides or inside_outlines(inner, self.blocks)[0] < 0:
                    self.marks.append(doubts.open_polyline(chain, self._curve(k).layer))
        self.marks += doubts.small_blocks(self.blocks, self.names)
        self.notes += doubts.large_blocks(self.blocks, self.names)
        self.notes += doubts.unit(self.blocks, found.unit, found.unit_given)

    def _move_to_blocks(self) -> None:
        """Move the origin of a drawing that was moved to the lower left corner of its blocks."""
        if not np.any(self.origin):
            return
        corner = np.concatenate(self.blocks).min(axis=0)
        self.origin = self.origin + corner
        self.blocks = [block - corner for block in self.blocks]
        self.voids = [void - corner for void in self.voids]
        self.chains = [chain - corner for chain in self.chains]
        self.marks = [(point - corner, text) for point, text in self.marks]
        place = self._place(np.zeros(2))
        self.notes.append(f"moved: map coordinates, the new origin is {place} of the drawing")

    def _groups(self, lengths: dict[str, float]) -> Segments:
        """Groups of the lines on which sides of blocks lie, or the lowest level.

        `lengths` of the sides of each group, m, are added.
        """
        scale = UNITS[self.found.unit]
        roles = self.by_role
        faces = bool(roles.lines)
        drawn = not faces and any(not self._curve(k).closed for k in roles.sides)
        lines: dict[str, list[npt.ArrayLike]] = {}
        for k in [*roles.sides, *(roles.lines + roles.voids if faces else ())]:
            (ring,) = self._rings([k])
            lines.setdefault(self._curve(k).layer, []).extend(pairwise(scale * ring))
        blocks = [scale * block for block in self.blocks]
        level: Segments = {} if "base" in map(str.lower, lines) else lowest_level(blocks)
        every = Drawing(blocks, self.names, {**lines, **level}).lengths()
        self.notes += [
            f"left out: layer '{name}', on whose lines no side of a block lies"
            for name in lines
            if every[name] == 0.0
        ]
        groups: Segments = {name: lines[name] for name in sorted(lines) if every[name] > 0.0}
        if not groups or (not drawn and "base" not in map(str.lower, groups)):
            why = "" if groups else "no lines on sides of blocks: "
            self.notes.append(f'{why}the group "base" is the lowest level')
            if not level:  # a layer of that name has no side
                level = lowest_level(blocks)
                every |= Drawing(blocks, self.names, level).lengths()
            groups = {**groups, **level}
            self._refuse_without_base(every["base"])
        lengths.update({name: every[name] for name in groups})
        return groups

    def _refuse_without_base(self, length: float) -> None:
        """Refuse a drawing that stands on nothing."""
        if length == 0.0:
            lowest = min(self.blocks, key=lambda block: block[:, 1].min())
            place = self._place(lowest[np.argmin(lowest[:, 1])])
            raise InputError(
                f"{self.found.source}: no side of a block lies on the lowest level, at {place}, to"
                " stand on; draw lines on a layer of their own where the structure stands"
            )

    def _refuse_far_blocks(self) -> None:
        """Refuse a block so far from the others that the digits of all would not do."""
        points = np.array([block.mean(axis=0) for block in self.blocks])
        middle = np.median(points, axis=0)
        away = np.linalg.norm(points - middle, axis=1)
        worst = int(np.argmax(away))
        block = np.median([np.ptp(block, axis=0).max() for block in self.blocks])
        size = 2.0 * float(np.median(away)) + block
        if away[worst] > APART * size:
            raise InputError(
                f"{self.found.source}: the block on layer '{self.names[worst]}' at"
                f" {self._place(points[worst])} is {away[worst] / size:.3g} times the size of the"
                " drawing away from the others; delete it or name its layer with --ignore"
            )


def _in_openings(blocks: Sequence[Array], voids: Sequence[Array], near: float) -> set[int]:
    """Blocks that lie within openings, but for a distance."""
    from shapely.geometry import Polygon

    if not voids:
        return set()
    inner = np.array([doubts.inner_point(block) for block in blocks])
    owner = inside_outlines(inner, voids)
    return {
        k
        for k in np.flatnonzero(owner >= 0).tolist()
        if Polygon(blocks[k]).within(Polygon(voids[owner[k]]).buffer(near))
    }
