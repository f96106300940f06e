"""Contacts at a point: corners of blocks that meet a side of another block; curved sides.

The node of the corner meets the side at one place, and the normal is that of the side: node to
segment. At a node of a curved side, drawn with chords, it is the mean of those of its two chords.
Which way two corners push each other is not determined; they are refused.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from fenics_contact.discretization.facets import CLOSED, GROUND, INSIDE, Boundary, Gaps, Stretches
from fenics_contact.discretization.mortar import lagrange
from fenics_contact.discretization.stencil import NO_NODE, Stencil
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, Flags, Indices, Labels
from fenics_contact.geometry.planar_cells import SMOOTH_ANGLE, connected, near_pairs, turns

#: Angle up to which sides go straight on, and facets lie along each other, rad.
STRAIGHT = CLOSED
#: A side so many times longer than the next one is straight beside an arc, no chord of it.
LONG = 3.0


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
        Lengths, m; curvatures, 1/m, above 0 where convex, 0 but for chords that turn smoothly at
        both ends, and not a number with one such end: the last chord of an arc, or a straight
        side; by facets.
    """
    vertices = Vertices.of(boundary)
    turning = np.abs(vertices.turn)
    side = connected(vertices.facets[turning <= STRAIGHT], len(boundary.length))
    length = np.bincount(side, boundary.length)
    smooth = (turning > STRAIGHT) & (turning <= SMOOTH_ANGLE)
    ends = side[vertices.facets[smooth]]
    total = np.bincount(ends.ravel(), np.repeat(vertices.turn[smooth], 2), len(length))
    count = np.bincount(ends.ravel(), minlength=len(length))
    shortest = np.full(len(length), np.inf)  # of the sides next to it
    np.minimum.at(shortest, ends, length[ends[:, ::-1]])
    chord = (count == 2) & (length <= LONG * shortest)
    curvature = np.where(chord, 0.5 * total / length, np.where(count == 1, np.nan, 0.0))
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

    def bodies(self, boundary: Boundary) -> Labels:
        """Body of the corner, and the one that it meets, shape (corners, 2)."""
        return boundary.body[self.facets[:, 1:]]

    def stencil(self, boundary: Boundary) -> Stencil:
        """Nodes of both sides; the first side is the body with the lower number."""
        rows = np.arange(len(self.node))
        own, met = self.bodies(boundary).T
        nodes = np.full((len(rows), 2, boundary.nodes.shape[1]), NO_NODE)
        weights = np.zeros(nodes.shape)
        nodes[rows, (own > met).astype(int), 0] = self.node
        weights[rows, (own > met).astype(int), 0] = 1.0
        nodes[rows, (met > own).astype(int)] = boundary.nodes[self.facets[:, 2]]
        weights[rows, (met > own).astype(int)] = lagrange(self.place, boundary.nodes.shape[1])
        return Stencil(nodes, weights)


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
    vertex, facet = _near(boundary, vertices, float(gaps.gap.max()))
    count = int(boundary.body.max(initial=0)) + 1
    across = found.facets[::-1, :, None]
    ends = found.nodes != INSIDE
    keys = (found.nodes * count + boundary.body[across])[ends & (across != GROUND)]
    faced = np.isin(vertices.node[vertex] * count + boundary.body[facet], keys)
    corners, other = _before_sides(boundary, gaps, vertices, vertex[~faced], facet[~faced])
    meets = other < 0
    free = ~np.isin(np.stack([corners.node, -1 - other]), found.nodes[ends]).any(axis=0)
    free &= ~np.isin(corners.node, corners.node[~meets])
    bad = np.flatnonzero(meets & free)
    if len(bad):
        first, second = np.sort(corners.bodies(boundary)[bad[0]])
        x, y = np.round(corners.position[bad[0]], 9) + 0.0
        raise InputError(
            f"{source}: corners of blocks {first} and {second} meet at ({x:g}, {y:g}). Which way"
            " they push each other is not determined: draw one to meet a side of the other, or"
            " move them apart"
        )
    # A node between two facets meets it once.
    pairs = np.sort(np.column_stack([corners.node, other])[~meets], axis=1)
    return corners.take(np.flatnonzero(~meets)[np.unique(pairs, axis=0, return_index=True)[1]])


def _near(boundary: Boundary, vertices: Vertices, gap: float) -> tuple[Indices, Indices]:
    """Pairs of convex vertices and facets of other bodies that may be within a gap."""
    count = len(boundary.length)
    centre = np.concatenate([boundary.points[:, :2].mean(axis=1), vertices.point])
    depth = CLOSED * boundary.length[vertices.facets].max(axis=1)
    size = np.concatenate([(0.5 + CLOSED) * boundary.length, depth + 2.0 * gap])
    convex = count + np.flatnonzero(vertices.turn > STRAIGHT)
    pairs = [np.empty((2, 0), dtype=np.int64)]
    pairs += [np.stack(pair) for pair in near_pairs(centre, size, convex, np.arange(count))]
    vertex, facet = np.hstack(pairs) - [[count], [0]]
    apart = boundary.body[vertices.facets[vertex, 0]] != boundary.body[facet]
    return vertex[apart], facet[apart]


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
