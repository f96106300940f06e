"""Stretches along which facets of two blocks face each other, and the laws of these joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.corners import Corners, find_corners, straight_sides
from fenics_contact.discretization.facets import (
    CLOSED,
    GROUND,
    INSIDE,
    Boundary,
    Gaps,
    Stretches,
)
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import arc_heights, near_pairs
from fenics_contact.scene.scene import Scene


@dataclass(frozen=True)
class PairingOptions:
    """When facets face each other.

    Attributes:
        matching: Nodes closer than this are one place, as a fraction of their shortest facet.
        apart: Facets are meant to be apart from this distance on, in the same unit.
        parallel: Cosine of the largest angle between facets that face each other.
    """

    matching: float = 1e-4
    apart: float = 5e-3
    parallel: float = float(np.cos(np.radians(20.0)))


OPTIONS = PairingOptions()


def find_contacts(scene: Scene, boundary: Boundary) -> tuple[Stretches, Indices, Corners, Indices]:
    """Stretches of all joints and foundations, and their law: of the scene's joints, then others.

    And corners that meet sides, and their law.

    Raises:
        InputError: If facets of a joint group have none opposite, have no law or two, almost touch,
            or if both sides of a joint carry a traction.
    """
    named = [name for name in scene.joints if name != "default"]
    gaps = Gaps.of(scene, boundary)
    ground_role = boundary.role(scene.foundations)
    found, doubtful = _facing(boundary, gaps)
    _check_doubtful(scene.mesh.source, boundary, doubtful)
    grounded = np.flatnonzero(ground_role >= 0)
    stretches = _with_ground(boundary, found, grounded)
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
    _check_tractions(scene, boundary, found.facets)
    law = _laws(scene, boundary, found.facets, gaps.role)
    law = np.concatenate([law, len(scene.joints) + ground_role[grounded]])
    sides = _sides_at_corners(scene, corners, gaps.role)
    of_corners = _laws(scene, boundary, sides, gaps.role)
    return stretches, law, corners, of_corners


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


def _with_ground(boundary: Boundary, found: Stretches, facets: Indices) -> Stretches:
    """Stretches of joints, then those of facets that stand on rigid ground over their length."""
    ours = boundary.nodes[facets, :2]
    whole = np.broadcast_to([0.0, 1.0], (2, *ours.shape))
    sides = np.stack([facets, np.full_like(facets, GROUND)])
    return Stretches(
        facets=np.hstack([found.facets, sides]),
        span=np.hstack([found.span, whole]),
        nodes=np.hstack([found.nodes, np.stack([ours, np.full_like(ours, INSIDE)])]),
        offset=np.concatenate([found.offset, np.zeros(ours.shape)]),
        slave=np.concatenate([found.slave, np.ones_like(facets)]),
    )


def facing_facets(boundary: Boundary, gaps: Gaps | None = None) -> Stretches:
    """Stretches along which facets of two bodies touch, or face each other within a law's gap."""
    return _facing(boundary, gaps or Gaps(np.full(len(boundary.length), -1), np.zeros(1)))[0]


def _facing(boundary: Boundary, gaps: Gaps) -> tuple[Stretches, Stretches]:
    """Those of `facing_facets`, and others that almost touch."""
    pairs = _candidates(gaps, boundary)
    first_side = np.zeros(pairs.shape[1], dtype=np.int64)
    found, doubtful = _touching(gaps, boundary, _common_stretches(boundary, pairs, first_side))
    # The side with more facets is the slave; stretches are seen along its normals.
    count = len(found.slave)
    slave = _slaves(boundary, np.hstack([found.facets, pairs]), count)[count:]
    if np.any(slave):
        found, doubtful = _touching(gaps, boundary, _common_stretches(boundary, pairs, slave))
    return found.take(np.lexsort((found.span[0].min(axis=1), *found.facets[::-1]))), doubtful


def _candidates(gaps: Gaps, boundary: Boundary) -> Indices:
    """Pairs of facets of two bodies, near and against each other, shape (2, pairs)."""
    middle = boundary.points[:, :2].mean(axis=1)
    length = boundary.length
    reach = (0.5 + OPTIONS.apart) * length + _arc_heights(boundary) + 0.5 * gaps.gap.max()
    pairs = [np.empty((2, 0), dtype=np.int64)]
    every = np.arange(len(length))
    for found in near_pairs(middle, reach, every, every):
        one, other = boundary.body[np.stack(found)]
        facets = np.stack(found)[:, one < other]
        pairs.append(facets[:, _against(boundary, *facets) > OPTIONS.parallel])
    return np.hstack(pairs)


def _touching(gaps: Gaps, boundary: Boundary, all_of: Stretches) -> tuple[Stretches, Stretches]:
    """Stretches that touch or are within the gap of their law; and those that almost touch."""
    facets = all_of.facets
    far = np.abs(all_of.offset).max(axis=1)
    shorter = boundary.length[facets].min(axis=0)
    height = _arc_heights(boundary)[facets].sum(axis=0)
    least = all_of.offset.min(axis=1)
    gap = gaps.of_pairs(facets)
    # Behind a thin block there are others: a facet that one lies on all along faces nothing else.
    exact = far <= OPTIONS.matching * shorter
    part = np.abs(np.diff(all_of.span, axis=2))[:, exact].ravel()
    covered = np.bincount(facets[:, exact].ravel(), part, len(boundary.length))
    alone = ~np.any(covered[facets] > 1.0 - OPTIONS.matching, axis=0)
    depth = CLOSED * shorter + height
    touching = exact | (alone & (far <= depth))
    across = alone & (gap > 0.0) & (least >= -depth) & (least <= gap)
    touching |= across & (_wedges(boundary, facets) <= gap)
    doubtful = alone & ~touching & (far <= OPTIONS.apart * shorter + height)
    return all_of.take(touching), all_of.take(doubtful)


def _wedges(boundary: Boundary, facets: Indices) -> Array:
    """By how much the distance of two straight sides may change along them, m; 0 at curved sides.

    Sides between which this is more than their gap meet at a corner. `facets` are pairs of facets
    of such sides, shape (2, pairs).
    """
    length, curvature = straight_sides(boundary)
    sine = np.sqrt(np.maximum(1.0 - _against(boundary, *facets) ** 2, 0.0))
    curved = np.any(np.abs(curvature[facets]) > 0.0, axis=0)
    return np.where(curved, 0.0, sine * length[facets].min(axis=0))


def _check_doubtful(source: str, boundary: Boundary, doubtful: Stretches) -> None:
    """Refuse blocks that almost touch."""
    if not len(doubtful.slave):
        return
    first = doubtful.offset[0]
    facets = doubtful.facets[:, 0]
    what = "overlap by" if first.min() < 0.0 else "are apart by"
    raise InputError(
        f"{source}: blocks {what} up to {np.abs(first).max():.3g} m at"
        f" {_place(boundary, facets[0])}{_groups_of(boundary, facets)}, too much for a joint and"
        " too little to be meant; move them together or apart, or give their joint a gap"
    )


def _arc_heights(boundary: Boundary) -> Array:
    """Bounds on the heights of the arcs of facets on curved sides, m."""
    points = boundary.points[:, :2]
    nodes = boundary.nodes[:, :2]
    return 2.0 * np.abs(arc_heights(points, nodes, boundary.normal))


def _slaves(boundary: Boundary, facets: Indices, facing: int) -> Indices:
    """Side of the slave of pairs: that with more facets in all of two bodies, else the first.

    The first `facing` pairs count.
    """
    bodies = boundary.body[facets].T
    joint = np.unique(bodies, axis=0, return_inverse=True)[1].ravel()
    total = int(joint.max(initial=-1)) + 1
    count = [
        np.bincount(np.unique(np.column_stack([joint, side])[:facing], axis=0)[:, 0], None, total)
        for side in facets
    ]
    return (count[1] > count[0]).astype(np.int64)[joint]


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
    near = OPTIONS.matching * _shortest_at_nodes(boundary)[nodes].min(axis=0)
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


def _shortest_at_nodes(boundary: Boundary) -> Array:
    """Length of the shortest facet at every node, m; infinite at others."""
    shortest = np.full(int(boundary.nodes.max(initial=-1)) + 1, np.inf)
    for end in boundary.nodes[:, :2].T:
        np.minimum.at(shortest, end, boundary.length)
    return shortest


def _place(boundary: Boundary, facet: int) -> str:
    x, y = boundary.points[facet, :2].mean(axis=0)
    return f"({x:g}, {y:g})"


def _groups_of(boundary: Boundary, facets: Indices) -> str:
    """The groups of two facets, for messages."""
    groups = boundary.groups[facets]
    names = sorted(set().union(*(boundary.facet_sets[group] for group in groups[groups >= 0])))
    return f" (group {', '.join(repr(name) for name in names)})" if names else ""


def _check_tractions(scene: Scene, boundary: Boundary, pairs: Indices) -> None:
    """Refuse a traction on both sides of a joint."""
    for kind, load in (("dead", scene.dead), ("live", scene.live)):
        for name in load.traction:
            if both := np.count_nonzero(boundary.in_group(name)[pairs].all(axis=0)):
                raise InputError(
                    f"loads.{kind}.traction.{name}: {both} facets are in the group with both sides"
                    " of a joint, and would carry the traction twice; leave joints out of the group"
                )


def _laws(scene: Scene, boundary: Boundary, pairs: Indices, joint_role: Indices) -> Indices:
    """Law of every pair as a position in `scene.joints`, by the group that either side is in."""
    order = list(scene.joints)
    position = np.array([k for k, name in enumerate(order) if name != "default"] + [-1])
    sides = position[joint_role[pairs]]
    differ = np.flatnonzero((sides.min(axis=0) >= 0) & (sides[0] != sides[1]))
    if len(differ):
        first, second = (order[k] for k in sides[:, differ[0]])
        raise InputError(
            f"joint groups '{first}' and '{second}' are the two sides of {len(differ)} facets;"
            " put both sides into one group"
        )
    law = sides.max(axis=0)
    if "default" in order:
        return np.where(law < 0, order.index("default"), law)
    if np.any(law < 0):
        place = _place(boundary, pairs[0, np.flatnonzero(law < 0)[0]])
        raise InputError(
            f"blocks touch at {place} with no joint group of their own; add [joints.default]"
        )
    return law
