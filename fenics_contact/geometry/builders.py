"""Facades, bridges and retaining walls as drawings of blocks, with their parts as groups.

Every builder returns a `Drawing`: outlines of blocks in m, in numpy alone. Its `mesh(size)` draws
them with gmsh, and `with_group(...)` names more sides, as the place of a load:

    bridge = bridge(span=6.0, rise=1.5, ring=0.4).with_group("axle", ((1.2, 2.2), (1.5, 2.2)))
    mesh = BlockMesh.from_model(bridge.mesh(size=0.2))

All raise `InputError` for sizes or numbers that make no structure.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import require
from fenics_contact.errors.checks import check_types, checked
from fenics_contact.geometry.drawing import Drawing
from fenics_contact.geometry.meshing import blocks_between
from fenics_contact.geometry.planar_cells import Array

Pair = tuple[float, float]


@dataclass
class _Parts:
    """Blocks and segments of a drawing under way."""

    blocks: list[Array] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    groups: dict[str, list[npt.ArrayLike]] = field(default_factory=dict)

    def add(self, name: str, *outlines: npt.ArrayLike) -> None:
        """Blocks of a part of the structure."""
        self.blocks += [np.asarray(outline, dtype=float) for outline in outlines]
        self.names += [name] * len(outlines)

    def course(self, name: str, x: Pair, y: Pair, length: float, shifted: int) -> None:
        """A course from x[0] to x[1]: whole blocks, or one more with halves at the ends."""
        count = max(1, round((x[1] - x[0]) / length))
        at = np.arange(count + 1.0)
        if shifted:
            at = np.concatenate([[0.0], np.arange(count) + 0.5, [count]])
        self.row(name, x[0] + (x[1] - x[0]) * at / count, y)

    def row(self, name: str, joints: npt.ArrayLike, y: Pair) -> None:
        """Upright blocks with joints at x between two levels."""
        x = np.asarray(joints, dtype=float)
        low, high = (np.column_stack([x, np.full(len(x), level)]) for level in y)
        self.add(name, *blocks_between(low, high))

    def side(self, name: str, *segments: npt.ArrayLike) -> None:
        """Sides of a group."""
        self.groups.setdefault(name, []).extend(segments)

    def framed(self, corners: list[Pair], names: str = "base right top left") -> Drawing:
        """The drawing, with groups along the sides of a frame."""
        sides = itertools.pairwise([*corners, corners[0]])
        self.groups |= {name: [side] for name, side in zip(names.split(), sides, strict=True)}
        return Drawing(self.blocks, self.names, self.groups)


def _box(x: Pair, y: Pair) -> list[Pair]:
    return [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]


@checked
def facade(
    storeys: int = 2,
    bays: int = 3,
    opening: Pair = (1.0, 1.25),
    pier: float = 1.0,
    block: Pair = (0.5, 0.25),
    sill: float = 0.75,
) -> Drawing:
    """A facade of courses with an opening in every bay of every storey.

    A storey has, from below, a band of spandrels in running bond (none for `sill` = 0: doors), the
    piers between the openings, a course with lintels, and a floor. Lintels bear on the piers by
    half a block, at most a third of a pier. The floor is a course of slabs from pier to pier, whose
    density may include what stands on it. The corner at the ground on the left is at (0, 0).

    The groups are "spandrels", "piers", "lintels" and "floors", and of facets "base", "top",
    "left" and "right".

    Args:
        storeys: Number of storeys.
        bays: Number of openings in a storey; there is one pier more.
        opening: Width and height of an opening, m.
        pier: Width of a pier, m.
        block: Length and height of a block, m; courses are made to fit.
        sill: Height of the band below an opening, m.
    """
    sizes = (*opening, pier, *block)
    require(storeys >= 1 and bays >= 1, "facade: give at least one storey and one bay")
    require(min(sizes) > 0.0 <= sill, "facade: sizes must be positive, sill 0 or more")
    parts = _Parts()
    storey = _Storey(bays, opening, pier, block, sill)
    low = 0.0
    for _ in range(storeys):
        low = storey.drawn(parts, low)
    return parts.framed(_box((0.0, storey.length), (0.0, low)))


@dataclass(frozen=True)
class _Storey:
    """A storey of a facade; attributes as arguments of `facade`."""

    bays: int
    opening: Pair
    pier: float
    block: Pair
    sill: float

    @property
    def step(self) -> float:
        """From one pier to the next, m."""
        return self.opening[0] + self.pier

    @property
    def length(self) -> float:
        """Of the facade, m."""
        return self.bays * self.step + self.pier

    @property
    def starts(self) -> Array:
        """Left ends of the piers, m, shape (bays + 1,)."""
        return self.step * np.arange(self.bays + 1)

    def drawn(self, parts: _Parts, low: float) -> float:
        """Draw the storey from a level up, m; returns the level of its top."""
        length, height = self.block
        levels = _levels(low, self.sill, height)
        for k, y in enumerate(itertools.pairwise(levels)):
            parts.course("spandrels", (0.0, self.length), y, length, k % 2)
        levels = _levels(levels[-1], self.opening[1], height)
        for k, y in enumerate(itertools.pairwise(levels)):
            for start in self.starts.tolist():
                parts.course("piers", (start, start + self.pier), y, length, k % 2)
        floor = levels[-1] + height
        self._draw_lintels(parts, (levels[-1], floor))
        joints = [0.0, *(self.starts[1:-1] + 0.5 * self.pier), self.length]
        parts.row("floors", joints, (floor, floor + height))
        return floor + height

    def _draw_lintels(self, parts: _Parts, y: Pair) -> None:
        """Draw the course of the lintels between two levels, with the piers beside them."""
        bearing = min(0.5 * self.block[0], self.pier / 3.0)
        piers = self.starts[:-1].tolist()
        lintels = [(x + self.pier - bearing, x + self.step + bearing) for x in piers]
        ends = [0.0, *itertools.chain(*lintels), self.length]
        parts.add("lintels", *[_box(x, y) for x in lintels])
        parts.add("piers", *[_box(x, y) for x in zip(ends[::2], ends[1::2], strict=True)])


def _levels(low: float, height: float, course: float) -> list[float]:
    """Levels of courses of about the height of a course; `low` alone if there is no height."""
    count = max(1, round(height / course)) if height > 0.0 else 0
    return [low, *(low + height * (k + 1) / count for k in range(count))]


@dataclass(frozen=True)
class BridgeParts:
    """Parts of a bridge besides its arches.

    Attributes:
        rings: Number of rings, one on the other, each as thick as the first.
        pier: Width and height of piers and abutments, m; of no height, the arches spring from the
            ground.
        cover: Height of the spandrels over the crown, m.
        parapet: Height of the parapet, m; 0 for none.
    """

    rings: int = 1
    pier: Pair = (1.5, 2.0)
    cover: float = 0.3
    parapet: float = 0.0

    def __post_init__(self) -> None:
        check_types(self)


@checked
def bridge(
    span: float,
    rise: float,
    ring: float,
    voussoirs: int = 15,
    spans: int = 1,
    parts: BridgeParts | None = None,
) -> Drawing:
    """A bridge of segmental arches on piers, with spandrels of upright blocks up to a level road.

    The arches spring at y = 0 from the abutment, whose face is at x = 0. Over every voussoir stands
    one block of the spandrels. Where the arches are no semicircles, skewbacks on piers and
    abutments carry them.

    The groups are "voussoirs", "skewbacks", "piers" (with the abutments), "spandrels" and
    "parapets", and of facets "base", "top" (of the parapets or the road), "left" and "right" (backs
    of the abutments), "intrados", "springings" (below the rings) and "rings" (between them).

    Args:
        span: Clear width of an arch, m.
        rise: Of the intrados above its springings, at most half the span, m.
        ring: Thickness of a ring, m.
        voussoirs: Number of blocks along a ring.
        spans: Number of arches.
        parts: The other sizes.
    """
    parts = parts or BridgeParts()
    _check_bridge((span, rise, ring), (voussoirs, spans), parts)
    curves = _ring_curves(span, rise, ring * np.arange(parts.rings + 1), voussoirs)
    road = float(curves[-1][:, 1].max()) + parts.cover
    drawn = _Parts()
    wide, high = parts.pier
    for k in range(spans):
        _arch(drawn, [np.add(curve, (k * (span + wide), 0.0)) for curve in curves], road)
    _piers(drawn, (span, spans), curves[-1][0], parts.pier, road)
    ends = (-wide, spans * (span + wide))
    top_level = road + parts.parapet
    if parts.parapet > 0.0:
        drawn.course("parapets", ends, (road, top_level), 2.0 * parts.parapet, 0)
    return drawn.framed(_box(ends, (-high, top_level)))


def _check_bridge(sizes: tuple[float, float, float], counts: Pair, parts: BridgeParts) -> None:
    span, rise, ring = sizes
    require(min(*counts, parts.rings) >= 1, "bridge: give one of each part at least")
    require(0.0 < rise <= 0.5 * span and ring > 0.0, "bridge: 0 < rise <= span / 2, and ring > 0")
    require(parts.cover > 0.0, "bridge: the cover must be positive")
    require(parts.parapet >= 0.0, "bridge: the parapet must be 0 or more")
    require(parts.pier[1] >= 0.0, "bridge: the height of piers must be 0 or more")


def _ring_curves(span: float, rise: float, above: Array, voussoirs: int) -> list[Array]:
    """Corners of voussoirs along the intrados and so much above it, shape (voussoirs + 1, 2)."""
    radius = 0.5 * (0.25 * span**2 / rise + rise)
    half = np.arctan2(0.5 * span, radius - rise)
    angles = np.linspace(-half, half, voussoirs + 1)
    ray = np.column_stack([np.sin(angles), np.cos(angles)])
    return [(radius + one) * ray + (0.5 * span, rise - radius) for one in above]


def _arch(drawn: _Parts, curves: list[Array], road: float) -> None:
    """Rings between curves, each of shape (points, 2), from below; spandrels up to the road."""
    for low, high in itertools.pairwise(curves):
        drawn.add("voussoirs", *blocks_between(low, high))
    above = np.column_stack([curves[-1][:, 0], np.full(len(curves[-1]), road)])
    drawn.add("spandrels", *blocks_between(curves[-1], above))
    drawn.side("intrados", *itertools.pairwise(curves[0]))
    drawn.side("springings", *[(curves[0][k], curves[-1][k]) for k in (0, -1)])
    for curve in curves[1:-1]:
        drawn.side("rings", *itertools.pairwise(curve))


def _piers(
    drawn: _Parts, spans: tuple[float, int], springing: Array, pier: Pair, road: float
) -> None:
    """The piers and abutments of a bridge.

    `spans` are the clear width of an arch, m, and their number; `springing` is the outer end of the
    first arch, `pier` the width and height of a pier, m.
    """
    span, count = spans
    wide, high = pier
    reach = -float(springing[0])
    least = 2.0 * reach if count > 1 else reach
    require(wide >= least, f"bridge: piers must be {least:.4g} m wide, for the springings")
    for k in range(count + 1):
        right = k * (span + wide)
        foot = right - wide, right
        top = foot[0] + (reach if k > 0 else 0.0), right - (reach if k < count else 0.0)
        _pier(drawn, foot, top, (-high, float(springing[1]), road))


def _pier(drawn: _Parts, foot: Pair, top: Pair, levels: tuple[float, float, float]) -> None:
    """A pier of courses up to y = 0, the skewback on it, and the spandrel from there to the road.

    `foot` and `top` are the sides of the pier and of the upper end of the skewback; `levels` are
    those of the ground, of that end, and of the road, m.
    """
    ground, level, road = levels
    wide = foot[1] - foot[0]
    courses = itertools.pairwise(_levels(ground, -ground, 0.5 * wide))
    drawn.add("piers", *[_box(foot, y) for y in courses])
    tip = top[1] - top[0] <= 1e-9 * wide  # no room for a spandrel
    if level > 1e-9 * wide:  # else a semicircle, which needs none
        upper = [(top[1], level), (top[0], level)]
        drawn.add("skewbacks", [(foot[0], 0.0), (foot[1], 0.0), *upper[: 1 if tip else 2]])
    if not tip:
        drawn.add("spandrels", _box(top, (level, road)))


@checked
def retaining_wall(
    height: float, base: float, top: float, courses: int = 8, stones: int = 3
) -> Drawing:
    """A wall of dry stone that holds back earth on its right, with a battered face on its left.

    The face begins at (0, 0); the back is upright at x = `base`. Every second course is shifted by
    half a stone. The last course is the coping, of one stone.

    The groups are "stones" and "coping", and of facets "base", "top", "back" (where the earth
    is) and "face".

    Args:
        height: m.
        base: Thickness at the ground, m.
        top: Thickness at the top, m, at most `base`.
        courses: Number of courses.
        stones: Number of stones through the thickness; 1 for through stones.
    """
    require(courses >= 1 and stones >= 1, "retaining_wall: give at least one course and stone")
    good = height > 0.0 and 0.0 < top <= base
    require(good, "retaining_wall: height and top must be positive, and top at most base")
    parts = _Parts()
    levels = height * np.arange(courses + 1) / courses
    face = np.column_stack([(base - top) * levels / height, levels])
    for k in range(courses):
        last = k == courses - 1
        count = 1 if last else stones
        at = np.arange(count) + 0.5 if k % 2 and count > 1 else np.arange(1.0, count)
        joints = (base - (base - face[k + 1, 0]) * at / count)[::-1]
        low, high = (
            np.array([(x, y), *((joint, y) for joint in joints), (base, y)])
            for x, y in face[k : k + 2]
        )
        parts.add("coping" if last else "stones", *blocks_between(low, high))
    corners = [(0.0, 0.0), (base, 0.0), (base, height), (base - top, height)]
    return parts.framed(corners, "base back top face")
