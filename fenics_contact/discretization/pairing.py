"""Stretches along which facets of two blocks face each other, and the laws of these joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.facets import GROUND, Boundary
from fenics_contact.errors import InputError
from fenics_contact.mesh import Array, Flags, Indices
from fenics_contact.planar_cells import near_pairs, sagittas
from fenics_contact.scene import Scene

#: In place of a node where a stretch ends inside a facet.
INSIDE = GROUND


@dataclass(frozen=True)
class PairingOptions:
    """When facets face each other.

    Attributes:
        matching: Nodes closer than this are one place, as a fraction of their shortest facet.
        closed: Facets closer than this touch, as a fraction of the shorter one: an angle at a block
            of the order of the strains, and what drawings and meshes of blocks have as rounding.
            Facets of curved sides may be apart by the heights of their arcs besides.
        apart: Facets are meant to be apart from this distance on, in the same unit.
        parallel: Cosine of the largest angle between facets that touch.
    """

    matching: float = 1e-4
    closed: float = 1e-3
    apart: float = 5e-3
    parallel: float = float(np.cos(np.radians(20.0)))


OPTIONS = PairingOptions()


@dataclass(frozen=True)
class Stretches:
    """Stretches on which one facet of a body faces one of another; the same on all ranks.

    A facet's parameter is 0 at the first of its nodes and 1 at the second.

    Attributes:
        facets: Facet of the lower body and of the other, shape (2, stretches).
        span: Parameters at start and end of the stretch on either facet, shape (2, stretches, 2).
        nodes: Nodes there, `INSIDE` for none, likewise.
        normal: Unit normal from the first facet to the second, shape (stretches, 2).
        offset: Distance from first to second at start and end, m, shape (stretches, 2).
    """

    facets: Indices
    span: Array
    nodes: Indices
    normal: Array
    offset: Array

    def take(self, rows: Indices | Flags) -> Stretches:
        """Some of them."""
        of_both = self.facets[:, rows], self.span[:, rows], self.nodes[:, rows]
        return Stretches(*of_both, self.normal[rows], self.offset[rows])

    def and_those(self, other: Stretches) -> Stretches:
        """These and others, sorted by facets and start."""
        two = ("facets", "span", "nodes")
        both = {name: (getattr(self, name), getattr(other, name)) for name in self.__annotations__}
        joined = {name: np.concatenate(pair, axis=int(name in two)) for name, pair in both.items()}
        every = Stretches(**joined)
        return every.take(np.lexsort((every.span[0].min(axis=1), *every.facets[::-1])))


def joint_stretches(scene: Scene, boundary: Boundary) -> tuple[Stretches, Indices]:
    """Stretches of all joints, and their law as a position in `scene.joints`.

    Raises:
        InputError: If facets of a joint group have none opposite, have no law or two, almost touch,
            or if both sides of a joint carry a traction.
    """
    named = [name for name in scene.joints if name != "default"]
    joint_role, ground_role = boundary.role(named), boundary.role(scene.foundations)
    found = facing_facets(boundary, scene.mesh.source)
    paired = np.zeros(len(boundary.length), dtype=bool)
    paired[found.facets] = True
    for position, name in enumerate(named):
        alone = np.flatnonzero((joint_role == position) & ~paired)
        if len(alone):
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
    return found, _laws(scene, boundary, found.facets, joint_role)


def foundation_facets(scene: Scene, boundary: Boundary) -> tuple[Indices, Indices]:
    """Facets on rigid ground, and their law as a position in `scene.foundations`."""
    role = boundary.role(scene.foundations)
    facets = np.flatnonzero(role >= 0)
    return facets, role[facets]


def facing_facets(boundary: Boundary, source: str) -> Stretches:
    """Stretches along which facets of two bodies touch; `source` is the mesh's, for messages.

    Raises:
        InputError: If three facets coincide, or facets almost touch.
    """
    found = _coinciding(boundary)
    alone = np.ones(len(boundary.length), dtype=bool)
    alone[found.facets] = False
    return found.and_those(_partly_facing(boundary, np.flatnonzero(alone), source))


def _coinciding(boundary: Boundary) -> Stretches:
    """Facets of two bodies that have their nodes in the same places."""
    from scipy.spatial import cKDTree

    near = OPTIONS.matching * boundary.length
    middle = boundary.points[:, :2].mean(axis=1)
    pairs = cKDTree(middle).query_pairs(near.max(initial=0.0), output_type="ndarray")
    first, second = pairs.T
    ends, other = boundary.points[first, :2], boundary.points[second, :2]
    straight, crossed = (
        np.linalg.norm(ends - them, axis=2).max(axis=1) for them in (other, other[:, ::-1])
    )
    close = np.minimum(straight, crossed) <= np.minimum(near[first], near[second])
    facing = np.sum(boundary.normal[first] * boundary.normal[second], axis=1) < 0.0
    apart = boundary.body[first] != boundary.body[second]
    keep = apart & facing & close
    pairs, turned = pairs[keep], (crossed < straight)[keep]
    swap = boundary.body[pairs[:, 0]] > boundary.body[pairs[:, 1]]
    pairs[swap] = pairs[swap, ::-1]
    seen, count = np.unique(pairs, return_counts=True)
    if np.any(count > 1):
        place = _place(boundary, seen[count > 1][0])
        raise InputError(f"three or more facets coincide at {place}; blocks overlap there")
    order = np.where(turned[:, None], [1, 0], [0, 1])
    nodes = boundary.nodes[pairs.T, :2]
    nodes[1] = np.take_along_axis(nodes[1], order, axis=1)
    ends = boundary.points[pairs, :2]  # of both facets, first ends first
    other = np.take_along_axis(ends[:, 1], order[:, :, None], axis=1)
    normal = boundary.normal[pairs[:, 0]]
    offset = np.einsum("nek,nk->ne", other - ends[:, 0], normal)
    span = np.stack([np.broadcast_to([0.0, 1.0], order.shape), order.astype(float)])
    return Stretches(pairs.T, span, nodes, normal, offset)


def _partly_facing(boundary: Boundary, alone: Indices, source: str) -> Stretches:
    """Stretches among facets that coincide with none."""
    middle, length = boundary.points[:, :2].mean(axis=1), boundary.length
    arc = sagittas(boundary.nodes[:, :2], boundary.normal, length)
    reach = (0.5 + OPTIONS.apart) * length + arc
    pairs = [np.empty((0, 2), dtype=np.int64)]
    for one, other in near_pairs(middle, reach, alone, alone):
        keep = boundary.body[one] < boundary.body[other]
        keep[keep] = _against(boundary, one[keep], other[keep]) > OPTIONS.parallel
        pairs.append(np.column_stack([one[keep], other[keep]]))
    found = _common_stretches(boundary, np.concatenate(pairs).T)
    one, other = found.facets
    shorter, far = np.minimum(length[one], length[other]), np.abs(found.offset).max(axis=1)
    height = arc[one] + arc[other]
    closed = far <= OPTIONS.closed * shorter + height
    doubtful = np.flatnonzero(~closed & (far <= OPTIONS.apart * shorter + height))
    if len(doubtful):
        first = doubtful[0]
        what = "overlap by" if found.offset[first].min() < 0.0 else "are apart by"
        raise InputError(
            f"{source}: blocks {what} up to {far[first]:.3g} m at {_place(boundary, one[first])}"
            f"{_groups_of(boundary, found.facets[:, first])}, too much for a joint and too little"
            " to be meant; move them together or apart"
        )
    return found.take(closed)


def _against(boundary: Boundary, one: Indices, other: Indices) -> Array:
    """Cosine of the angle between one facet's normal and the reversed one of another."""
    return -np.sum(boundary.normal[one] * boundary.normal[other], axis=1)


def _common_stretches(boundary: Boundary, facets: Indices) -> Stretches:
    """Where pairs of facets lie before each other, seen along the mean of their normals."""
    one, other = facets
    normal = boundary.normal[one] - boundary.normal[other]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    along = np.column_stack([-normal[:, 1], normal[:, 0]])
    corners = boundary.points[facets, :2]  # of both sides, shape (2, pairs, 2 ends, 2)
    place = np.einsum("snek,nk->sne", corners - corners[0, :, :1], along)
    turned = place[:, :, 0] > place[:, :, 1]
    order = np.where(turned[:, :, None], [1, 0], [0, 1])
    place = np.take_along_axis(place, order, axis=2)
    nodes = np.take_along_axis(boundary.nodes[facets, :2], order, axis=2)
    near = OPTIONS.matching * _shortest_at_nodes(boundary)[nodes].min(axis=0)
    # Sides whose end is at the end of the stretch: the inner one, or both where nodes are close.
    inward = (place[0] - place[1]) * [1.0, -1.0]  # how far the first side ends further inside
    at_end = np.stack([inward >= -near, inward <= near])
    start, stop = place[:, :, 0].max(axis=0), place[:, :, 1].min(axis=0)
    keep = stop - start > near.min(axis=1)
    extent = place[:, :, 1] - place[:, :, 0]
    bounds = np.column_stack([start, stop])
    span = (bounds - place[:, :, :1]) / extent[:, :, None]
    span = np.where(at_end, [0.0, 1.0], span)
    nodes = np.where(at_end, nodes, INSIDE)
    span = np.where(turned[:, :, None], 1.0 - span, span)
    ends = corners[:, :, :1] + span[:, :, :, None] * (corners[:, :, 1:] - corners[:, :, :1])
    offset = np.einsum("nek,nk->ne", ends[1] - ends[0], normal)
    return Stretches(facets, span, nodes, normal, offset).take(keep)


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
