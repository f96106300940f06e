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

from fenics_contact.errors import checked, require
from fenics_contact.geometry.meshing import Drawing, blocks_between
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
    length, height = block
    step = opening[0] + pier
    total = bays * step + pier
    starts = step * np.arange(bays + 1)  # left ends of the piers
    bearing = min(0.5 * length, pier / 3.0)
    lintels = [(x + pier - bearing, x + step + bearing) for x in starts[:-1].tolist()]
    ends = [0.0, *itertools.chain(*lintels), total]
    low = 0.0
    for _ in range(storeys):
        levels = _levels(low, sill, height)
        for k, y in enumerate(itertools.pairwise(levels)):
            parts.course("spandrels", (0.0, total), y, length, k % 2)
        levels = _levels(levels[-1], opening[1], height)
        for k, y in enumerate(itertools.pairwise(levels)):
            for start in starts.tolist():
                parts.course("piers", (start, start + pier), y, length, k % 2)
        floor = levels[-1] + height
        beside = zip(ends[::2], ends[1::2], strict=True)  # piers beside the lintels
        parts.add("lintels", *[_box(x, (levels[-1], floor)) for x in lintels])
        parts.add("piers", *[_box(x, (levels[-1], floor)) for x in beside])
        low = floor + height
        parts.row("floors", [0.0, *(starts[1:-1] + 0.5 * pier), total], (floor, low))
    return parts.framed(_box((0.0, total), (0.0, low)))


def _levels(low: float, height: float, course: float) -> list[float]:
    """Levels of courses of about the height of a course; `low` alone if there is no height."""
    count = max(1, round(height / course)) if height > 0.0 else 0
    return [low, *(low + height * (k + 1) / count for k in range(count))]


@checked
def bridge(
    span: float,
    rise: float,
    ring: float,
    voussoirs: int = 15,
    spans: int = 1,
    *,
    rings: int = 1,
    pier: Pair = (1.5, 2.0),
    cover: float = 0.3,
    parapet: float = 0.0,
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
        rings: Number of rings, one on the other, each as thick as the first.
        pier: Width and height of piers and abutments, m; of no height, the arches spring from the
            ground.
        cover: Height of the spandrels over the crown, m.
        parapet: Height of the parapet, m; 0 for none.
    """
    require(min(voussoirs, spans, rings) >= 1, "bridge: give one of each part at least")
    require(0.0 < rise <= 0.5 * span and ring > 0.0, "bridge: 0 < rise <= span / 2, and ring > 0")
    require(cover > 0.0, "bridge: the cover must be positive")
    require(parapet >= 0.0, "bridge: the parapet must be 0 or more")
    require(pier[1] >= 0.0, "bridge: the height of piers must be 0 or more")
    radius = 0.5 * (0.25 * span**2 / rise + rise)
    half = np.arctan2(0.5 * span, radius - rise)
    angles = np.linspace(-half, half, voussoirs + 1)
    ray = np.column_stack([np.sin(angles), np.cos(angles)])
    centre = (0.5 * span, rise - radius)
    curves = [(radius + above) * ray + centre for above in ring * np.arange(rings + 1)]
    road = float(curves[-1][:, 1].max()) + cover
    drawn = _Parts()
    wide, high = pier
    for k in range(spans):
        arches = [np.add(curve, (k * (span + wide), 0.0)) for curve in curves]
        for lower, upper in itertools.pairwise(arches):
            drawn.add("voussoirs", *blocks_between(lower, upper))
        above = np.column_stack([arches[-1][:, 0], np.full(voussoirs + 1, road)])
        drawn.add("spandrels", *blocks_between(arches[-1], above))
        drawn.side("intrados", *itertools.pairwise(arches[0]))
        drawn.side("springings", *[(arches[0][k], arches[-1][k]) for k in (0, -1)])
        for curve in arches[1:-1]:
            drawn.side("rings", *itertools.pairwise(curve))
    reach, level = (abs(float(x)) for x in curves[-1][0])  # of the rings onto the pier
    least = 2.0 * reach if spans > 1 else reach
    require(wide >= least, f"bridge: piers must be {least:.4g} m wide, for the springings")
    for k in range(spans + 1):
        right = k * (span + wide)
        left = right - wide
        top = left + (reach if k > 0 else 0.0), right - (reach if k < spans else 0.0)
        courses = itertools.pairwise(_levels(-high, high, 0.5 * wide))
        drawn.add("piers", *[_box((left, right), y) for y in courses])
        tip = top[1] - top[0] <= 1e-9 * wide  # no room for a spandrel
        if level > 1e-9 * wide:  # else a semicircle, which needs no skewback
            upper_end = [(top[1], level), (top[0], level)][: 1 if tip else 2]
            drawn.add("skewbacks", [(left, 0.0), (right, 0.0), *upper_end])
        if not tip:
            drawn.add("spandrels", _box(top, (level, road)))
    sides = (-wide, spans * (span + wide))
    top_level = road + parapet
    if parapet > 0.0:
        drawn.course("parapets", sides, (road, top_level), 2.0 * parapet, 0)
    return drawn.framed(_box(sides, (-high, top_level)))


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
