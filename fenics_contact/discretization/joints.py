"""Joint points, at which blocks exchange forces, and their opening and slip B_N u and B_T u.

A joint is where facets of two blocks touch, a joint point a pair of nodes there, or a node on rigid
ground; where nodes do not match, what `mortar` says. With n the unit normal from the first side to
the second and t = n turned by 90 degrees anticlockwise,

    w_N = n . (u_second - u_first) >= 0   opening,      w_T = t . (u_second - u_first)   slip;

on rigid ground the first side does not move. w_N = B_N u and w_T = B_T u, one row per point.
Nodal weights are the exact integrals of the Lagrange functions on a facet (degree 1: trapezoidal
rule, degree 2: Simpson's). Ties are more points, after these: they slide, and press nothing
(`ties`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenics_contact.discretization.contacts import Corners, find_contacts, straight_sides
from fenics_contact.discretization.facets import (
    GROUND,
    INSIDE,
    NO_NODE,
    SHARES,
    Boundary,
    Stencil,
    lagrange,
)
from fenics_contact.discretization.mortar import Pieces, pieces_of, stencil_of
from fenics_contact.discretization.supports import Supports
from fenics_contact.discretization.ties import Ties
from fenics_contact.geometry.mesh import Array, Flags, Indices, Labels
from fenics_contact.geometry.planar_cells import SMOOTH_ANGLE, arc_heights
from fenics_contact.parallel import PETSc
from fenics_contact.scene.scene import JointLaw, Scene
from fenics_contact.solvers.joint_law import PointLaws
from fenics_contact.solvers.problem import sparse_rows

#: Arrays of `Joints` over all points.
PER_POINT = ("nodes", "bodies", "position", "sides", "normal", "length", "law", "gap", "curvature")
#: Sides whose curvatures differ by less than this part lie along each other.
ALIKE = 0.25


@dataclass(frozen=True)
class Joints:
    """Joint points and the facets between them, and then ties; the same on all ranks.

    Attributes:
        nodes: Nodes of the first and second side at the point, -1 where none is there: on rigid
            ground, and inside a facet; shape (points, 2).
        bodies: Bodies of both sides, `GROUND` for rigid ground, shape (points, 2).
        position: m, shape (points, 2).
        sides: Where the first and second side carry the force of the point: their nodes' mean with
            the weights of `stencil`, m, shape (points, 2, 2). Across a gap these are two places; on
            rigid ground it is the point's own.
        normal: Unit normal from first to second side, zero at ties, shape (points, 2).
        length: Length of joint that belongs to the point, m, shape (points,); the share of a bar in
            its tie.
        law: Law of every point as an index into `laws`.
        laws: Those of the scene's joints, then of its foundations, then of its ties.
        names: Their groups.
        segments: Points at the ends of every facet, or piece of one, shape (segments, 2).
        middle: With degree 2, the points inside these, shape (segments,); else none.
        stencil: How displacements of nodes give those of both sides at the points.
        gap: Initial opening of every point, m; 0 where the law gives no gap.
        curvature: Of one side relative to the other, 1/m; 0 unless sides are curved and unlike.
        crushes: f_c of every point, Pa: of its law, or else the least of the cells there; infinite
            where none is given.
        offset: Largest gap or overlap of the blocks that is taken for closed, m.
        corners: Number of points before ties, in no segment, at which a corner meets a side.
        unbonded: Points that have lost cohesion and tensile strength; none if left out.
        ties: The last points; None: there are none.
    """

    nodes: Indices
    bodies: Labels
    position: Array
    sides: Array
    normal: Array
    length: Array
    law: Indices
    laws: tuple[JointLaw, ...]
    names: tuple[str, ...]
    segments: Indices
    stencil: Stencil
    middle: Indices
    gap: Array
    curvature: Array
    crushes: Array
    offset: float
    corners: int
    unbonded: Flags | None = None
    ties: Ties | None = None

    def without_ties(self) -> Joints:
        """The joint points alone."""
        if self.ties is None:
            return self
        count = self.joint_count
        laws = len(self.laws) - len(self.ties.names)
        return replace(
            self,
            **{name: getattr(self, name)[:count] for name in (*PER_POINT, "crushes")},
            stencil=Stencil(self.stencil.nodes[:count], self.stencil.weights[:count]),
            laws=self.laws[:laws],
            names=self.names[:laws],
            unbonded=None if self.unbonded is None else self.unbonded[:count],
            ties=None,
        )

    def with_yields(self, factor: float) -> Joints:
        """The points with all forces of ties, not those of soil, times a factor."""
        if self.ties is None:
            return self
        times = np.where(self.ties.part(True)[0], 1.0, factor)
        yields, prestress = times * self.ties.yields, times * self.ties.prestress
        ties = replace(self.ties, yields=yields, prestress=prestress)
        return replace(self, ties=ties, laws=(*self.laws[: -len(ties.names)], *ties.laws))

    @property
    def joint_count(self) -> int:
        """Number of points without those of ties."""
        return len(self.length) - (0 if self.ties is None else len(self.ties.tie))

    @property
    def neighbours(self) -> Indices:
        """Pairs of points that follow each other along a joint, shape (pairs, 2)."""
        if not len(self.middle):
            return self.segments
        return np.concatenate([np.column_stack([end, self.middle]) for end in self.segments.T])

    @property
    def tangent(self) -> Array:
        """Unit tangents, those of ties along the bars, shape (points, 2)."""
        turned = np.column_stack([-self.normal[:, 1], self.normal[:, 0]])
        if self.ties is not None:
            turned[self.joint_count :] = self.ties.direction
        return turned

    @property
    def point_laws(self) -> PointLaws:
        """Law of every point, with openings and slips from where the joints are drawn."""
        dilation = self._by_law(lambda law: law.dilation)
        law = PointLaws(self.friction, self.shear_strength, dilation).bonded(self.bond)
        return law if self.ties is None else replace(law, apart=self._of_ties("length"))

    @property
    def compliance(self) -> Array:
        """Compliance of the points along their tangents, that of ties, m per N/m."""
        return self._of_ties("compliance")

    @property
    def origin(self) -> Array:
        """Slip of the structure as drawn, of ties, m (`ties`)."""
        return self._of_ties("origin")

    @property
    def friction(self) -> Array:
        """Coefficient of friction of every point, 0 where the law is not Coulomb's."""
        return self._by_law(lambda law: law.friction or 0.0)

    @property
    def bond(self) -> Array:
        """Tensile force that every point carries, N/m."""
        return self._by_law(lambda law: law.tensile_strength) * self._whole_length

    @property
    def shear_strength(self) -> Array:
        """Shear force that every point carries without pressure, N/m: Tresca's bound, cohesion."""
        return self._by_law(lambda law: law.bound or law.cohesion) * self._whole_length

    @property
    def losing(self) -> Flags:
        """Points that lose their strengths where they open."""
        return self._by_law(lambda law: law.loses) > 0.0

    def _by_law(self, value: Callable[[JointLaw], float]) -> Array:
        """A value of the laws at all points."""
        return np.array([value(law) for law in self.laws], dtype=float)[self.law]

    def _of_ties(self, name: str) -> Array:
        """Values of ties as those of all points, zero at joints."""
        values = [] if self.ties is None else [getattr(self.ties, name)]
        return np.concatenate([np.zeros(self.joint_count), *values])

    @property
    def _whole_length(self) -> Array:
        """Length of joint of every point that carries strengths: bonded, no corner, m."""
        length = self.length.copy()
        if self.unbonded is not None:
            length[self.unbonded] = 0.0
        length[self.joint_count - self.corners : self.joint_count] = 0.0
        return length


@dataclass(frozen=True)
class JointOperators:
    """B_N and B_T, with what this rank's rows are.

    Attributes:
        normal: B_N, shape (points, displacements).
        tangential: B_T.
        points: Joint point of every row.
        sides: Bodies of both sides, `GROUND` for rigid ground, shape (rows, 2).
        dofs: Global dofs, half of them of either side, first side first, -1 for none, shape
            (rows, 4 times most nodes of a side).
        normal_rows: Coefficients of B_N on those dofs, likewise.
        tangential_rows: Those of B_T.
    """

    normal: PETSc.Mat
    tangential: PETSc.Mat
    points: Indices
    sides: Labels
    dofs: Labels
    normal_rows: Array
    tangential_rows: Array


def find_joints(
    scene: Scene, boundary: Boundary, ties: Ties | None = None, inside: bool = False
) -> Joints:
    """Points of all joints and foundations, corners that meet sides among them, and bars of ties.

    Or those `inside` blocks that are glued.

    Raises:
        InputError: As `find_contacts` says.
    """
    stretches, law_of_stretch, corners, law_of_corner = find_contacts(scene, boundary)
    if scene.mesh.drawn is not None:
        mine = np.equal(*stretches.bodies(boundary).T) == inside
        stretches = stretches.take(mine)
        law_of_stretch = law_of_stretch[mine]
        mine = np.subtract(*boundary.body[corners.facets[:, 1:]].T) != 0
        mine &= not inside
        corners = corners.take(mine)
        law_of_corner = law_of_corner[mine]
    laws = (*scene.joints.values(), *scene.foundations.values())
    names = (*scene.joints, *scene.foundations)
    gapped = np.array([law.gap > 0.0 for law in laws], dtype=bool)
    pieces = pieces_of(boundary, stretches, law_of_stretch)
    piece, rows, point = _merge(boundary, pieces)
    parts = [_points_of_pieces(boundary, pieces, piece[rows], rows, point, gapped)]
    if len(corners.node):
        parts.append(_points_of_corners(boundary, corners, law_of_corner, gapped))
    if ties is not None and len(ties.tie):
        count = len(ties.tie)
        none = np.zeros(count)
        ground = np.full((count, 2), GROUND)
        where = ties.sides.mean(axis=1), ties.sides, np.zeros((count, 2)), ties.share
        law = len(laws) + ties.tie
        parts.append((ties.stencil, ground, ties.bodies, *where, law, none, none))
        laws = (*laws, *ties.laws)
        names = (*names, *ties.keys)
    else:
        ties = None
    closed = pieces.stretches.offset[~gapped[pieces.law[pieces.of_stretch]]]
    stencils, *arrays = zip(*parts, strict=True)
    columns: dict[str, Any] = dict(zip(PER_POINT, map(np.concatenate, arrays), strict=True))
    # Of the cells at both sides of pieces, then at corners; the last facet is rigid ground.
    given = [scene.material(groups).compressive_strength or np.inf for groups in boundary.cell_sets]
    of_facet = np.append(np.array(given)[boundary.cell_groups], np.inf)
    crushes = np.full(len(columns["law"]), np.inf)
    beside = of_facet[pieces.stretches.facets].min(axis=0)
    np.minimum.at(crushes, point[pieces.of_stretch], beside[:, None])
    crushes[len(rows) :][: len(corners.node)] = of_facet[corners.facets].min(axis=1)
    of_law = np.array([law.compressive_strength or np.nan for law in laws])[columns["law"]]
    return Joints(
        **columns,
        crushes=np.where(np.isnan(of_law), crushes, of_law),
        laws=laws,
        names=names,
        segments=point[:, :2],
        middle=point[:, 2] if point.shape[1] == 3 else point[:0, 0],
        stencil=Stencil.joined(stencils),
        offset=float(np.abs(closed).max(initial=0.0)),
        ties=ties,
        corners=len(corners.node),
    )


def _points_of_pieces(
    boundary: Boundary,
    pieces: Pieces,
    piece: Indices,
    rows: Indices,
    point: Indices,
    gapped: Flags,
) -> tuple[Any, ...]:
    """Stencil of the joint points of pieces, and arrays over them in the order of `PER_POINT`.

    Args:
        boundary: Facets of the blocks.
        pieces: Pieces of joints.
        piece: Piece of the first place of every point.
        rows: The first place of every point.
        point: Point of every place, shape (pieces, places).
        gapped: Laws with a gap.
    """
    count = point.shape[1]
    share = pieces.length[:, None] * SHARES[count]
    columns = share, *(share * pieces.normal.T[:, :, None])
    length, *mean = (
        np.bincount(point.ravel(), column.ravel(), len(rows)).astype(float) for column in columns
    )
    normal = np.column_stack(mean) / np.linalg.norm(mean, axis=0)[:, None]
    stencil = stencil_of(boundary, pieces, point)
    position = lagrange(pieces.places, count) @ boundary.points[pieces.facet]
    position = position.reshape(-1, 2)[rows]
    on_ground = np.all(stencil.nodes == GROUND, axis=2)
    of_nodes = _node_positions(boundary)
    sides = np.where(on_ground[:, :, None], position[:, None], stencil.means(of_nodes))
    law = pieces.law[piece]
    gap = np.zeros(len(rows))
    if np.any(gapped[law]):
        # Mid nodes of curved sides are where their arcs are: pressures would follow the facets.
        if count == 3:
            ends = boundary.points[:, :2], boundary.nodes[:, :2]
            height = arc_heights(*ends, boundary.normal)
            of_nodes[boundary.nodes[:, 2]] += height[:, None] * boundary.normal
        distance = np.sum(normal * stencil.jump(of_nodes), axis=1)
        gap = np.where(gapped[law], np.maximum(distance, 0.0), 0.0)
    facets = pieces.stretches.facets
    curved = np.where(facets == GROUND, 0.0, straight_sides(boundary)[1][facets])
    relative = curved.sum(axis=0)
    unlike = (facets[1] != GROUND) & (relative > ALIKE * np.abs(curved).max(axis=0))
    curvature = np.zeros(len(rows))
    np.maximum.at(curvature, point[pieces.of_stretch], np.where(unlike, relative, 0.0)[:, None])
    nodes = np.where((pieces.side == 0)[:, None], pieces.nodes, pieces.nodes[::-1])
    nodes = nodes.reshape(2, -1).T[rows]
    where = position, sides, normal, length
    return stencil, nodes, pieces.bodies[piece], *where, law, gap, curvature


def _points_of_corners(
    boundary: Boundary, corners: Corners, law: Indices, gapped: Flags
) -> tuple[Any, ...]:
    """Stencil of corners that meet sides, and arrays over them in the order of `PER_POINT`."""
    count = len(corners.node)
    bodies = boundary.body[corners.facets[:, 1:]]
    first = bodies[:, :1] < bodies[:, 1:]  # whether the corner is the first side
    nodes = np.column_stack([np.full(count, INSIDE), corners.node])
    share = SHARES[boundary.nodes.shape[1]][0]
    nodes = np.where(first, nodes[:, ::-1], nodes)
    rows = np.arange(count)
    own = (bodies[:, 0] > bodies[:, 1]).astype(int)
    of_nodes = np.full((count, 2, boundary.nodes.shape[1]), NO_NODE)
    weights = np.zeros(of_nodes.shape)
    of_nodes[rows, own, 0] = corners.node
    weights[rows, own, 0] = 1.0
    of_nodes[rows, 1 - own] = boundary.nodes[corners.facets[:, 2]]
    weights[rows, 1 - own] = lagrange(corners.place, boundary.nodes.shape[1])
    stencil = Stencil(of_nodes, weights)
    sides = stencil.means(_node_positions(boundary))
    normal = np.where(first, -1.0, 1.0) * corners.normal
    length = share * boundary.length[corners.facets[:, :2]].min(axis=1)
    gap = np.where(gapped[law], np.maximum(corners.distance, 0.0), 0.0)
    where = corners.position, sides, normal, length
    return stencil, nodes, np.sort(bodies, axis=1), *where, law, gap, np.zeros(count)


def _node_positions(boundary: Boundary) -> Array:
    """Positions of the boundary's nodes by their numbers, m, shape (nodes, 2)."""
    position = np.zeros((int(boundary.nodes.max(initial=-1)) + 1, 2))
    position[boundary.nodes] = boundary.points
    return position


def _merge(boundary: Boundary, pieces: Pieces) -> tuple[Indices, Indices, Indices]:
    """Piece of every place, first place of every joint point, joint point of places by piece.

    Places of a piece are one joint point where they have the slave's node or facet, the node
    opposite, the body opposite, law and direction in common; points are in order of appearance.
    """
    count = pieces.nodes.shape[2]
    piece = np.repeat(np.arange(len(pieces.law)), count)
    slave, other = pieces.nodes.reshape(2, -1)
    most = int(boundary.nodes.max(initial=0)) + 1
    slave = np.where(slave == INSIDE, most + pieces.facet[piece], slave)
    mid = np.flatnonzero((slave >= most) & (np.arange(len(slave)) % count == 2))
    slave[mid] = most + len(boundary.length) + mid
    keys = np.column_stack([slave, other, pieces.bodies[piece], pieces.law[piece]])
    # Where the joint kinks at a point, the piece that comes second has a point of its own.
    order = np.lexsort(keys.T[::-1])
    one = order[:-1]
    two = order[1:]
    normal = pieces.normal[piece]
    kink = np.sum(normal[one] * normal[two], axis=1) < np.cos(SMOOTH_ANGLE)
    direction = np.zeros(len(keys), dtype=np.int64)
    direction[two[kink & np.all(keys[one] == keys[two], axis=1)]] = 1
    keys = np.column_stack([keys, direction])
    _, rows, point = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(rows)
    return piece, rows[order], np.argsort(order)[point.ravel()].reshape(-1, count)


def joint_operators(joints: Joints, supports: Supports, stiffness: PETSc.Mat) -> JointOperators:
    """Build B_N and B_T in the supports' coordinates, on the layout of the stiffness.

    A point's row lives on the rank that owns the first node of its second side.
    """
    start, end = stiffness.getOwnershipRange()
    owner = joints.stencil.nodes[:, 1, 0]
    points = np.flatnonzero((owner >= start // 2) & (owner < end // 2))
    dofs, normal_rows, tangential_rows = coefficients(joints, supports, points)
    return JointOperators(
        normal=sparse_rows(stiffness, dofs, normal_rows),
        tangential=sparse_rows(stiffness, dofs, tangential_rows),
        points=points,
        sides=joints.bodies[points],
        dofs=dofs.astype(PETSc.IntType),
        normal_rows=normal_rows,
        tangential_rows=tangential_rows,
    )


def coefficients(
    joints: Joints, supports: Supports, points: Indices
) -> tuple[Indices, Array, Array]:
    """Dofs of joint points, and coefficients of B_N and B_T on them, as in `JointOperators`."""
    nodes = joints.stencil.nodes[points]
    dofs = 2 * nodes[..., None] + np.arange(2)
    dofs[nodes == GROUND] = -1
    dofs = dofs.reshape(len(points), int(np.prod(dofs.shape[1:])))
    directions = supports.free_directions(nodes.ravel()).reshape(*nodes.shape, 2, 2)
    factor = joints.stencil.weights[points] * np.array([[-1.0], [1.0]])
    normal_rows, tangential_rows = (
        np.einsum("nk,nsikl,nsi->nsil", axis[points], directions, factor).reshape(dofs.shape)
        for axis in (joints.normal, joints.tangent)
    )
    return dofs, normal_rows, tangential_rows
