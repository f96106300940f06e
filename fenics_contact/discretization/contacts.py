"""Where facets of two blocks face each other, corners that meet sides, and the laws of both.

Contacts at a point are corners that meet a side of another block. The node of the corner meets the
side at one place, and the normal is that of the side: node to segment. At a node of a curved side,
drawn with chords, it is the mean of those of its two chords. Which way two corners push each other
is not determined; they are refused.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from fenics_contact.discretization.facets import CLOSED, GROUND, INSIDE, Boundary, Stretches
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.geometry.planar_cells import (
    SMOOTH_ANGLE,
    arc_heights,
    connected,
    near_pairs,
    turns,
)
from fenics_contact.scene.scene import Scene

#: Angle up to which sides go straight on, and facets lie along each other, rad.
STRAIGHT = CLOSED
#: A side so many times longer than the next one is straight beside an arc, no chord of it.
LONG = 3.0
#: Nodes closer than this are one place, as a fraction of their shortest facet.
MATCHING = 1e-4
#: Facets are meant to be apart from this distance on, in the same unit.
APART = 5e-3
#: Cosine of the largest angle between facets that face each other.
PARALLEL = float(np.cos(np.radians(20.0)))


def by_edges(scene: Scene) -> list[str]:
    """Names of the joints that are groups of edges."""
    joints = scene.joints.items()
    return [name for name, law in joints if name != "default" and law.between is None]


@dataclass(frozen=True)
class Gaps:
    """Distances up to which facets face each other by the laws of their joints.

    Attributes:
        role: Joint group of every facet as an index into `gap`, -1 for none, shape (facets,).
        gap: m, by joint group; the last is that of facets in no group.
    """

    role: Indices
    gap: Array

    @classmethod
    def of(cls, scene: Scene, boundary: Boundary) -> Gaps:
        """Those of a scene's laws."""
        named = by_edges(scene)
        laws = [scene.joints.get(name) for name in [*named, "default"]]
        return cls(boundary.role(named), np.array([law.gap if law else 0.0 for law in laws]))

    def of_pairs(self, facets: Indices) -> Array:
        """Of facets that face each other, by the group that any is in, shape (facets, pairs)."""
        return self.gap[self.role[facets].max(axis=0)]


@dataclass(frozen=True)
class Vertices:
    """Nodes at which two facets of a body meet.

    Attributes:
        node: Their numbers.
        facets: The two facets, shape (vertices, 2).
        point: m, shape (vertices, 2).
        others: Other ends of the facets, m, shape (vertices, 2, 2).
        turn: Angle by which the outline turns, rad, above 0 where it is convex.
    """

    node: Indices
    facets: Indices
    point: Array
    others: Array
    turn: Array

    @classmethod
    def of(cls, boundary: Boundary) -> Vertices:
        """Those of all bodies."""
        places, turn = turns(boundary.points[:, :2], boundary.nodes[:, :2], boundary.normal)
        facets = places.T // 2
        end = places.T % 2
        node = boundary.nodes[facets[:, 0], end[:, 0]]
        point = boundary.points[facets[:, 0], end[:, 0]]
        return cls(node, facets, point, boundary.points[facets, 1 - end], turn)


def straight_sides(boundary: Boundary) -> tuple[Array, Array]:
    """Lengths of the straight sides, or chords, that facets are part of, and their curvatures.

    Returns:
        Lengths, m; curvatures, 1/m, above 0 where convex, 0 but for chords that turn smoothly into
        others at both ends, and not a number with one such end: the last chord of an arc; by
        facets.
    """
    vertices = Vertices.of(boundary)
    turning = np.abs(vertices.turn)
    side = connected(vertices.facets[turning <= STRAIGHT], len(boundary.length))
    length = np.bincount(side, boundary.length)
    smooth = (turning > STRAIGHT) & (turning <= SMOOTH_ANGLE)
    both = length[side[vertices.facets]]
    smooth &= both.max(axis=1) <= LONG * both.min(axis=1)
    ends = side[vertices.facets[smooth]]
    total = np.bincount(ends.ravel(), np.repeat(vertices.turn[smooth], 2), len(length))
    count = np.bincount(ends.ravel(), minlength=len(length))
    curvature = np.where(count == 2, 0.5 * total / length, np.where(count == 1, np.nan, 0.0))
    return length[side].astype(float), curvature[side]


@dataclass(frozen=True)
class Corners:
    """Corners that meet sides of other blocks; the same on all ranks.

    Attributes:
        node: Of the corner.
        facets: The two facets at the corner, and the one that it meets, shape (corners, 3).
        place: Parameter on the facet that it meets.
        position: m, shape (corners, 2).
        normal: Outward unit normal of the side that it meets, shape (corners, 2).
        distance: Of the corner from that side, below 0 where they overlap, m.
    """

    node: Indices
    facets: Indices
    place: Array
    position: Array
    normal: Array
    distance: Array

    def take(self, rows: Indices | Flags) -> Corners:
        """The corners of some rows."""
        return Corners(**{item.name: getattr(self, item.name)[rows] for item in fields(self)})


def find_corners(boundary: Boundary, gaps: Gaps, found: Stretches, source: str) -> Corners:
    """Corners that touch a side of another block, or face it within the gap of their law.

    Args:
        boundary: Facets of the blocks.
        gaps: Of the laws.
        found: Stretches of joints and on ground; where facets face each other no corner is meant.
        source: Name of the mesh, for messages.

    Raises:
        InputError: If two corners meet that are no nodes of joints.
    """
    vertices = Vertices.of(boundary)
    # Pairs of convex vertices and facets of other bodies that may be within a gap.
    count = len(boundary.length)
    centre = np.concatenate([boundary.points[:, :2].mean(axis=1), vertices.point])
    depth = CLOSED * boundary.length[vertices.facets].max(axis=1)
    size = np.concatenate([(0.5 + CLOSED) * boundary.length, depth + 2.0 * gaps.gap.max()])
    convex = count + np.flatnonzero(vertices.turn > STRAIGHT)
    near = [np.stack(pair) for pair in near_pairs(centre, size, convex, np.arange(count))]
    vertex, facet = np.hstack([np.empty((2, 0), dtype=np.int64), *near]) - [[count], [0]]
    apart = boundary.piece[vertices.facets[vertex, 0]] != boundary.piece[facet]
    vertex = vertex[apart]
    facet = facet[apart]
    count = int(boundary.piece.max(initial=0)) + 1
    across = found.facets[::-1, :, None]
    ends = found.nodes != INSIDE
    keys = (found.nodes * count + boundary.piece[across])[ends & (across != GROUND)]
    faced = np.isin(vertices.node[vertex] * count + boundary.piece[facet], keys)
    corners, other = _before_sides(boundary, gaps, vertices, vertex[~faced], facet[~faced])
    meets = other < 0
    free = ~np.isin(np.stack([corners.node, -1 - other]), found.nodes[ends]).any(axis=0)
    free &= ~np.isin(corners.node, corners.node[~meets])
    bad = np.flatnonzero(meets & free)
    if len(bad):
        first, second = np.sort(boundary.body[corners.facets[bad[0], 1:]])
        x, y = np.round(corners.position[bad[0]], 9) + 0.0
        raise InputError(
            f"{source}: corners of blocks {first} and {second} meet at ({x:g}, {y:g}). Which way"
            " they push each other is not determined: draw one to meet a side of the other, or"
            " move them apart"
        )
    # A node between two facets meets it once.
    pairs = np.sort(np.column_stack([corners.node, other])[~meets], axis=1)
    return corners.take(np.flatnonzero(~meets)[np.unique(pairs, axis=0, return_index=True)[1]])


def _before_sides(
    boundary: Boundary, gaps: Gaps, vertices: Vertices, vertex: Indices, facet: Indices
) -> tuple[Corners, Indices]:
    """Vertices that point at a facet of another body, or at a corner of it.

    Returns:
        The vertices; the node that each meets, -1 - node for another corner, or beyond all nodes a
        number of the facet.
    """
    point = vertices.point[vertex]
    start, stop = boundary.points[facet, :2].swapaxes(0, 1)
    length = boundary.length[facet]
    normal = boundary.normal[facet]
    distance = np.sum((point - start) * normal, axis=1)
    along = np.sum((point - start) * (stop - start), axis=1) / length
    depth = CLOSED * np.minimum(boundary.length[vertices.facets[vertex]].min(axis=1), length)
    facets = np.column_stack([vertices.facets[vertex], facet])
    reach = np.maximum(gaps.of_pairs(facets.T), depth)
    most = int(boundary.nodes.max(initial=0)) + 1
    at_node = np.full(most, -1)
    at_node[vertices.node] = np.arange(len(vertices.node))
    node = boundary.nodes[facet, (along > 0.5 * length).astype(int)]
    near = at_node[node]
    at_end = (np.minimum(along, length - along) <= depth) & (near >= 0)
    turn = np.where(near >= 0, vertices.turn[near], 0.0)
    mean = boundary.normal[vertices.facets[near]].sum(axis=1)
    smooth = at_end & (turn > STRAIGHT) & (turn <= SMOOTH_ANGLE)
    normal = np.where(smooth[:, None], mean / np.linalg.norm(mean, axis=1)[:, None], normal)
    rising = np.sum((vertices.others[vertex] - point[:, None]) * normal[:, None], axis=2)
    points_at = np.all(rising > STRAIGHT * boundary.length[facets[:, :2]], axis=1)
    # Chords of a convex side leave room between their normals.
    beside = depth + np.tan(0.5 * SMOOTH_ANGLE) * np.maximum(distance, 0.0)
    sharp = (turn > SMOOTH_ANGLE) & (vertices.turn[vertex] > SMOOTH_ANGLE)
    # Corners side by side along a common line, as of bricks, push each other nowhere.
    sides = boundary.normal[np.stack([vertices.facets[vertex], vertices.facets[near]])]
    sharp &= np.einsum("nik,njk->nij", *sides).min(axis=(1, 2)) > -np.cos(STRAIGHT)
    sharp &= np.linalg.norm(point - vertices.point[near], axis=1) <= reach
    meets = points_at & (distance >= -depth) & (distance <= reach)
    meets &= (np.minimum(along, length - along) >= -beside) & ~(at_end & (turn > SMOOTH_ANGLE))
    other = np.where(at_end & (turn >= -STRAIGHT), node, most + facet)
    corners = Corners(
        vertices.node[vertex], facets, np.clip(along / length, 0.0, 1.0), point, normal, distance
    )
    return corners.take(meets | sharp), np.where(meets, other, -1 - node)[meets | sharp]


def find_contacts(scene: Scene, boundary: Boundary) -> tuple[Stretches, Indices, Corners, Indices]:
    """Stretches of all joints and foundations, and their law: of the scene's joints, then others.

    And corners that meet sides, and their law.

    Raises:
        InputError: If facets of a joint group have none opposite, have no law or two, almost touch,
            or if both sides of a joint carry a traction.
    """
    named = by_edges(scene)
    gaps = Gaps.of(scene, boundary)
    ground_role = boundary.role(scene.foundations)
    found, doubtful = _facing(boundary, gaps)
    _check_doubtful(scene.mesh.source, boundary, doubtful)
    # After the joints, facets that stand on rigid ground over their length.
    grounded = np.flatnonzero(ground_role >= 0)
    ours = boundary.nodes[grounded, :2]
    whole = np.broadcast_to([0.0, 1.0], (2, *ours.shape))
    sides = np.stack([grounded, np.full_like(grounded, GROUND)])
    stretches = Stretches(
        facets=np.hstack([found.facets, sides]),
        span=np.hstack([found.span, whole]),
        nodes=np.hstack([found.nodes, np.stack([ours, np.full_like(ours, INSIDE)])]),
        offset=np.concatenate([found.offset, np.zeros(ours.shape)]),
        slave=np.concatenate([found.slave, np.ones_like(grounded)]),
    )
    corners = find_corners(boundary, gaps, stretches, scene.mesh.source)
    paired = np.zeros(len(boundary.length), dtype=bool)
    paired[found.facets] = True
    at_corners = set(gaps.role[corners.facets].ravel().tolist())
    for position, name in enumerate(named):
        mine = gaps.role == position
        alone = np.flatnonzero(mine & ~paired)
        # With a gap, facets further apart are free.
        everywhere = scene.joints[name].gap == 0.0 or not np.any(mine & paired)
        if len(alone) and everywhere and position not in at_corners:
            raise InputError(
                f"joint group '{name}': {len(alone)} facets have no facet opposite, the first at"
                f" {_place(boundary, alone[0])}; draw both sides on the same line, or make the"
                " group a foundation or support"
            )
    for position, name in enumerate(scene.foundations):
        if both := np.count_nonzero((ground_role == position) & paired):
            raise InputError(
                f"foundation '{name}': {both} facets touch another block; a foundation is rigid"
                " ground, make the group a joint"
            )
    for kind, load in (("dead", scene.dead), ("live", scene.live)):
        for name in load.traction:
            if both := np.count_nonzero(boundary.in_group(name)[found.facets].all(axis=0)):
                raise InputError(
                    f"loads.{kind}.traction.{name}: {both} facets are in the group with both sides"
                    " of a joint, and would carry the traction twice; leave joints out of the group"
                )
    law = _laws(scene, boundary, found.facets, gaps.role)
    met = _laws(scene, boundary, _sides_at_corners(scene, corners, gaps.role), gaps.role)
    for position, (name, joint) in enumerate(scene.joints.items()):
        if joint.between is not None and position not in (*law, *met):
            one, other = joint.between
            raise InputError(f"joints.{name}.between: no blocks of {one!r} and {other!r} touch")
    law = np.concatenate([law, len(scene.joints) + ground_role[grounded]])
    off = np.array([joint.off for joint in (*scene.joints.values(), *scene.foundations.values())])
    if np.any(off):
        stretches = stretches.take(~off[law])
        corners = corners.take(~off[met])
        law = law[~off[law]]
        met = met[~off[met]]
    return stretches, law, corners, met


def glued_blocks(scene: Scene, boundary: Boundary) -> Indices:
    """Number of the block that every block as drawn is in: those that are glued are one.

    Raises:
        InputError: If a corner alone is glued; else as `find_contacts` says.
    """
    glued = np.array([law.glued for law in (*scene.joints.values(), *scene.foundations.values())])
    stretches, law, corners, met = find_contacts(scene, boundary)
    if np.any(glued[met]):
        x, y = corners.position[glued[met]][0]
        name = list(scene.joints)[met[glued[met]][0]]
        raise InputError(
            f"joints.{name}.glued: at ({x:g}, {y:g}) a corner meets a side; a point cannot be glued"
        )
    pairs = boundary.piece[stretches.facets[:, glued[law]]].T
    label = connected(pairs, int(boundary.piece.max(initial=-1)) + 1)
    first = np.unique(label, return_index=True)[1]
    return np.asarray(np.argsort(np.argsort(first))[label])


def _sides_at_corners(scene: Scene, corners: Corners, role: Indices) -> Indices:
    """One facet at every corner and the one that it meets, shape (2, corners).

    At a corner between two groups the one in the group of the other block, else one in a group.

    Raises:
        InputError: If the corner is between two groups, and the other block in neither.
    """
    one, two, met = corners.facets.T
    groups = role[corners.facets]
    unclear = (groups[:, :2].min(axis=1) >= 0) & (groups[:, 0] != groups[:, 1]) & (groups[:, 2] < 0)
    if np.any(unclear):
        x, y = corners.position[unclear][0]
        raise InputError(
            f"{scene.mesh.source}: the corner at ({x:g}, {y:g}) is between two joint groups, and"
            " meets a side in neither; put that side into the group whose law is meant"
        )
    second = (role[two] == role[met]) | ((role[one] != role[met]) & (role[two] > role[one]))
    second = np.where(role[met] < 0, role[two] > role[one], second)
    return np.stack([np.where(second, two, one), met])


def facing_facets(boundary: Boundary, gaps: Gaps | None = None) -> Stretches:
    """Stretches along which facets of two bodies touch, or face each other within a law's gap."""
    return _facing(boundary, gaps or Gaps(np.full(len(boundary.length), -1), np.zeros(1)))[0]


def _facing(boundary: Boundary, gaps: Gaps) -> tuple[Stretches, Stretches]:
    """Those of `facing_facets`, and others that almost touch."""
    # Pairs of facets of two bodies, near and against each other.
    middle = boundary.points[:, :2].mean(axis=1)
    reach = (0.5 + APART) * boundary.length + _arc_heights(boundary) + 0.5 * gaps.gap.max()
    every = np.arange(len(middle))
    near = [np.stack(pair) for pair in near_pairs(middle, reach, every, every)]
    pairs = np.hstack([np.empty((2, 0), dtype=np.int64), *near])
    order = boundary.body * (int(boundary.piece.max(initial=0)) + 1) + boundary.piece
    pairs = pairs[:, np.subtract(*order[pairs]) < 0]
    pairs = pairs[:, _against(boundary, *pairs) > PARALLEL]
    slave = np.zeros(pairs.shape[1], dtype=np.int64)
    found, doubtful = _touching(gaps, boundary, _common_stretches(boundary, pairs, slave))
    # The side with more facets in all of two bodies is the slave, else the first; stretches are
    # seen along its normals.
    both = np.hstack([found.facets, pairs])
    joint = np.unique(boundary.piece[both].T, axis=0, return_inverse=True)[1].ravel()
    count = len(found.slave)
    facets = [np.unique([joint[:count], side[:count]], axis=1)[0] for side in both]
    first, second = (np.bincount(of, minlength=len(joint)) for of in facets)
    slave = (second > first).astype(np.int64)[joint[count:]]
    if np.any(slave):
        found, doubtful = _touching(gaps, boundary, _common_stretches(boundary, pairs, slave))
    return found.take(np.lexsort((found.span[0].min(axis=1), *found.facets[::-1]))), doubtful


def _touching(gaps: Gaps, boundary: Boundary, all_of: Stretches) -> tuple[Stretches, Stretches]:
    """Stretches that touch or are within the gap of their law; and those that almost touch."""
    facets = all_of.facets
    far = np.abs(all_of.offset).max(axis=1)
    shorter = boundary.length[facets].min(axis=0)
    height = _arc_heights(boundary)[facets].sum(axis=0)
    least = all_of.offset.min(axis=1)
    gap = gaps.of_pairs(facets)
    # Behind a thin block there are others: a facet that one lies on all along faces nothing else.
    exact = far <= MATCHING * shorter
    part = np.abs(np.diff(all_of.span, axis=2))[:, exact].ravel()
    covered = np.bincount(facets[:, exact].ravel(), part, len(boundary.length))
    alone = ~np.any(covered[facets] > 1.0 - MATCHING, axis=0)
    depth = CLOSED * shorter + height
    touching = exact | (alone & (far <= depth))
    across = alone & (gap > 0.0) & (least >= -depth) & (least <= gap)
    # Straight sides between which the distance changes by more than their gap meet at a corner.
    length, curvature = straight_sides(boundary)
    sine = np.sqrt(np.maximum(1.0 - _against(boundary, *facets) ** 2, 0.0))
    curved = np.any(np.abs(curvature[facets]) > 0.0, axis=0)
    touching |= across & (curved | (sine * length[facets].min(axis=0) <= gap))
    doubtful = alone & ~touching & (far <= APART * shorter + height)
    return all_of.take(touching), all_of.take(doubtful)


def _check_doubtful(source: str, boundary: Boundary, doubtful: Stretches) -> None:
    """Refuse blocks that almost touch."""
    if not len(doubtful.slave):
        return
    first = doubtful.offset[0]
    facets = doubtful.facets[:, 0]
    groups = boundary.groups[facets]
    names = sorted(set().union(*(boundary.facet_sets[group] for group in groups[groups >= 0])))
    of = f" (group {', '.join(repr(name) for name in names)})" if names else ""
    what = "overlap by" if first.min() < 0.0 else "are apart by"
    raise InputError(
        f"{source}: blocks {what} up to {np.abs(first).max():.3g} m at"
        f" {_place(boundary, facets[0])}{of}, too much for a joint and"
        " too little to be meant; move them together or apart, or give their joint a gap"
    )


def _arc_heights(boundary: Boundary) -> Array:
    """Bounds on the heights of the arcs of facets on curved sides, m."""
    points = boundary.points[:, :2]
    nodes = boundary.nodes[:, :2]
    return 2.0 * np.abs(arc_heights(points, nodes, boundary.normal))


def _against(boundary: Boundary, one: Indices, other: Indices) -> Array:
    """Cosine of the angle between one facet's normal and the reversed one of another."""
    return -np.sum(boundary.normal[one] * boundary.normal[other], axis=1)


def _common_stretches(boundary: Boundary, pairs: Indices, slave: Indices) -> Stretches:
    """Where pairs of facets lie before each other, seen along the slave's normal.

    So facets of the other side that follow each other do so on the slave.
    """
    facets = np.where(slave == 0, pairs, pairs[::-1])
    corners = boundary.points[facets, :2]  # of both sides, shape (2, pairs, 2 ends, 2)
    along = (corners[0, :, 1] - corners[0, :, 0]) / boundary.length[facets[0], None]
    place = np.einsum("snek,nk->sne", corners - corners[0, :, :1], along)
    turned = place[:, :, :1] > place[:, :, 1:]
    order = np.where(turned, [1, 0], [0, 1])
    place = np.take_along_axis(place, order, axis=2)
    nodes = np.take_along_axis(boundary.nodes[facets, :2], order, axis=2)
    shortest = np.full(int(boundary.nodes.max(initial=-1)) + 1, np.inf)  # facet at a node
    for end in boundary.nodes[:, :2].T:
        np.minimum.at(shortest, end, boundary.length)
    near = MATCHING * shortest[nodes].min(axis=0)
    # Sides whose end is at the end of the stretch: the inner one, or both where nodes are close.
    inward = (place[0] - place[1]) * [1.0, -1.0]  # how far the first side ends further inside
    at_end = np.stack([inward >= -near, inward <= near])
    bounds = np.column_stack([place[:, :, 0].max(axis=0), place[:, :, 1].min(axis=0)])
    span = (bounds - place[:, :, :1]) / (place[:, :, 1:] - place[:, :, :1])
    span = np.where(at_end, [0.0, 1.0], span)
    span = np.where(turned, 1.0 - span, span)
    ends = corners[:, :, :1] + span[:, :, :, None] * (corners[:, :, 1:] - corners[:, :, :1])
    offset = np.einsum("nek,nk->ne", ends[1] - ends[0], boundary.normal[facets[0]])
    keep = bounds[:, 1] - bounds[:, 0] > near.min(axis=1)
    return Stretches(facets, span, np.where(at_end, nodes, INSIDE), offset, slave).take(keep)


def _place(boundary: Boundary, facet: int) -> str:
    x, y = boundary.points[facet, :2].mean(axis=0)
    return f"({x:g}, {y:g})"


def _laws(scene: Scene, boundary: Boundary, pairs: Indices, joint_role: Indices) -> Indices:
    """Law of every pair as a position in `scene.joints`, by the group that either side is in."""
    order = list(scene.joints)
    position = np.array([*map(order.index, by_edges(scene)), -1])
    sides = position[joint_role[pairs]]
    differ = np.flatnonzero((sides.min(axis=0) >= 0) & (sides[0] != sides[1]))
    if len(differ):
        first, second = (order[k] for k in sides[:, differ[0]])
        raise InputError(
            f"joint groups '{first}' and '{second}' are the two sides of {len(differ)} facets;"
            " put both sides into one group"
        )
    law = sides.max(axis=0)
    chosen = np.full(len(law), -1)
    for name, joint in scene.joints.items():
        if joint.between is None:
            continue
        one, other = (boundary.of_block(where)[pairs] for where in joint.between)
        mine = (one[0] & other[1]) | (one[1] & other[0])
        if np.any(twice := mine & (chosen >= 0)):
            place = _place(boundary, pairs[0, np.flatnonzero(twice)[0]])
            before = order[chosen[twice][0]]
            raise InputError(f"joints.{name}.between and joints.{before}.between share {place}")
        chosen[mine] = order.index(name)
    law = np.where(chosen < 0, law, chosen)
    if "default" in order:
        return np.where(law < 0, order.index("default"), law)
    if np.any(law < 0):
        place = _place(boundary, pairs[0, np.flatnonzero(law < 0)[0]])
        raise InputError(
            f"blocks touch at {place} with no joint group of their own; add [joints.default]"
        )
    return law
