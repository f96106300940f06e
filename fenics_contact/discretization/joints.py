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

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.discretization.contacts import Corners, find_contacts, straight_sides
from fenics_contact.discretization.facets import GROUND, INSIDE, Boundary
from fenics_contact.discretization.mortar import (
    SHARES,
    Pieces,
    Stencil,
    lagrange,
    pieces_of,
    stencil_of,
)
from fenics_contact.discretization.supports import Supports
from fenics_contact.discretization.ties import Ties
from fenics_contact.geometry.mesh import Array, Flags, Indices, Labels
from fenics_contact.geometry.planar_cells import SMOOTH_ANGLE, arc_heights
from fenics_contact.scene.scene import JointLaw, Scene
from fenics_contact.solvers.joint_law import PointLaws
from fenics_contact.solvers.problem import sparse_rows

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
        offset: Largest gap or overlap of the blocks that is taken for closed, m.
        torn: Points that have lost cohesion and tensile strength; none if left out.
        ties: The last points; None: there are none.
        corners: Number of points before them, in no segment, at which a corner meets a side.
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
    offset: float = 0.0
    torn: Flags | None = None
    ties: Ties | None = None
    corners: int = 0

    def with_ties(self, ties: Ties) -> Joints:
        """Joint points, and the bars of ties after them."""
        count = len(ties.tie)
        if not count:
            return self
        half = [0.5 * float(np.sum(ties.yields[ties.tie == k])) for k in range(len(ties.names))]
        none = np.full((count, 2), GROUND)
        columns = {
            "nodes": none,
            "bodies": ties.bodies,
            "position": ties.sides.mean(axis=1),
            "sides": ties.sides,
            "normal": np.zeros((count, 2)),
            "length": ties.share,
            "law": len(self.laws) + ties.tie,
            "gap": np.zeros(count),
            "curvature": np.zeros(count),
        }
        return replace(
            self.followed_by(columns, ties.stencil),
            laws=(*self.laws, *(JointLaw("tresca", bound=bound) for bound in half)),
            names=(*self.names, *(f"ties.{name}" for name in ties.names)),
            ties=ties,
        )

    def followed_by(self, columns: Mapping[str, Any], stencil: Stencil) -> Joints:
        """These points and then others, with arrays over them by name."""
        both = {name: np.concatenate([getattr(self, name), of]) for name, of in columns.items()}
        return replace(self, **both, stencil=self.stencil.followed_by(stencil))

    def without_ties(self) -> Joints:
        """The joint points alone."""
        if self.ties is None:
            return self
        count = self.joint_count
        laws = len(self.laws) - len(self.ties.names)
        where = "nodes", "bodies", "position", "sides", "normal", "length"
        per_point = *where, "law", "gap", "curvature"
        return replace(
            self,
            **{name: getattr(self, name)[:count] for name in per_point},
            stencil=Stencil(self.stencil.nodes[:count], self.stencil.weights[:count]),
            laws=self.laws[:laws],
            names=self.names[:laws],
            torn=None if self.torn is None else self.torn[:count],
            ties=None,
        )

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
        dilation = np.array([law.dilation for law in self.laws])[self.law]
        law = PointLaws(self.friction, self.shear_strength, dilation).bonded(self.bond)
        return law if self.ties is None else replace(law, apart=self._of_ties(self.ties.length))

    @property
    def compliance(self) -> Array:
        """Compliance of the points along their tangents, that of ties, m per N/m."""
        none = np.zeros(len(self.length))
        return none if self.ties is None else self._of_ties(self.ties.compliance)

    @property
    def origin(self) -> Array:
        """Slip of the structure as drawn, of ties, m (`ties`)."""
        none = np.zeros(len(self.length))
        return none if self.ties is None else self._of_ties(self.ties.origin)

    def _of_ties(self, values: Array) -> Array:
        """Values of ties as those of all points, zero at joints."""
        return np.concatenate([np.zeros(self.joint_count), values])

    @property
    def friction(self) -> Array:
        """Coefficient of friction of every point, 0 where the law is not Coulomb's."""
        return np.array([law.friction or 0.0 for law in self.laws])[self.law]

    @property
    def bond(self) -> Array:
        """Tensile force that every point carries, N/m."""
        strength = np.array([law.tensile_strength for law in self.laws])[self.law]
        return strength * self._whole_length

    @property
    def shear_strength(self) -> Array:
        """Shear force that every point carries without pressure, N/m: Tresca's bound, cohesion."""
        strength = np.array([law.bound or law.cohesion for law in self.laws])[self.law]
        return strength * self._whole_length

    @property
    def losing(self) -> Flags:
        """Points that lose their strengths where they open."""
        return np.array([law.loses for law in self.laws], dtype=bool)[self.law]

    @property
    def _whole_length(self) -> Array:
        """Length of joint of every point that carries strengths: not torn, no corner, m."""
        length = self.length if self.torn is None else np.where(self.torn, 0.0, self.length)
        length = length.copy()
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


def find_joints(scene: Scene, boundary: Boundary) -> Joints:
    """Points of all joints and foundations.

    Raises:
        InputError: As `find_contacts` says.
    """
    stretches, law_of_stretch, corners, law_of_corner = find_contacts(scene, boundary)
    pieces = pieces_of(boundary, stretches, law_of_stretch)
    per_piece = pieces.nodes.shape[2]
    piece, rows, point = _merge(boundary, pieces)
    share = pieces.length[:, None] * SHARES[per_piece]
    columns = share.ravel(), *(share * pieces.normal.T[:, :, None]).reshape(2, -1)
    length, *mean = (np.bincount(point, column, len(rows)).astype(float) for column in columns)
    normal = np.column_stack(mean) / np.linalg.norm(mean, axis=0)[:, None]
    point = point.reshape(share.shape)
    stencil = stencil_of(boundary, pieces, point)
    position = lagrange(pieces.places, per_piece) @ boundary.points[pieces.facet]
    position = position.reshape(-1, 2)[rows]
    nodes = np.where((pieces.side == 0)[:, None], pieces.nodes, pieces.nodes[::-1])
    laws = (*scene.joints.values(), *scene.foundations.values())
    law = pieces.law[piece[rows]]
    gapped = np.array([one.gap > 0.0 for one in laws], dtype=bool)
    closed = pieces.stretches.offset[~gapped[pieces.law[pieces.of_stretch]]]
    joints = Joints(
        nodes=nodes.reshape(2, -1).T[rows],
        bodies=pieces.bodies[piece[rows]],
        position=position,
        sides=_sides(boundary, stencil, position),
        normal=normal,
        length=length,
        law=law,
        laws=laws,
        names=(*scene.joints, *scene.foundations),
        segments=point[:, :2],
        middle=point[:, 2] if per_piece == 3 else point[:0, 0],
        stencil=stencil,
        gap=_gaps(boundary, stencil, normal, gapped[law]),
        curvature=_curvatures(boundary, pieces, point),
        offset=float(np.abs(closed).max(initial=0.0)),
    )
    if not len(corners.node):
        return joints
    return _with_corners(joints, boundary, corners, law_of_corner)


def _with_corners(joints: Joints, boundary: Boundary, corners: Corners, law: Indices) -> Joints:
    """Joint points, and then corners that meet sides of other blocks."""
    count = len(corners.node)
    bodies = corners.bodies(boundary)
    first = bodies[:, :1] < bodies[:, 1:]  # whether the corner is the first side
    stencil = corners.stencil(boundary)
    nodes = np.column_stack([np.full(count, INSIDE), corners.node])
    gapped = np.array([one.gap > 0.0 for one in joints.laws], dtype=bool)[law]
    share = SHARES[boundary.nodes.shape[1]][0]
    columns = {
        "nodes": np.where(first, nodes[:, ::-1], nodes),
        "bodies": np.sort(bodies, axis=1),
        "position": corners.position,
        "sides": stencil.means(_node_positions(boundary)),
        "normal": np.where(first, -1.0, 1.0) * corners.normal,
        "length": share * boundary.length[corners.facets[:, :2]].min(axis=1),
        "law": law,
        "gap": np.where(gapped, np.maximum(corners.distance, 0.0), 0.0),
        "curvature": np.zeros(count),
    }
    return replace(joints.followed_by(columns, stencil), corners=count)


def _gaps(boundary: Boundary, stencil: Stencil, normal: Array, gapped: Flags) -> Array:
    """Initial gaps of joint points: the distance of the sides where the law has one, else 0, m."""
    if not np.any(gapped):
        return np.zeros(len(gapped))
    return np.where(gapped, np.maximum(_distances(boundary, stencil, normal), 0.0), 0.0)


def _curvatures(boundary: Boundary, pieces: Pieces, point: Indices) -> Array:
    """`Joints.curvature` of joint points; `point` is that of every place, as for `stencil_of`."""
    facets = pieces.stretches.facets
    sides = np.where(facets == GROUND, 0.0, straight_sides(boundary)[1][facets])
    relative = sides.sum(axis=0)
    unlike = (facets[1] != GROUND) & (relative > ALIKE * np.abs(sides).max(axis=0))
    curvature = np.zeros(int(point.max(initial=-1)) + 1)
    np.maximum.at(curvature, point[pieces.of_stretch], np.where(unlike, relative, 0.0)[:, None])
    return curvature


def _distances(boundary: Boundary, stencil: Stencil, normal: Array) -> Array:
    """Distance of the sides at joint points, B_N of the nodes' positions, m.

    Mid nodes of curved sides are where their arcs are: pressures would follow the facets else.
    """
    position = _node_positions(boundary)
    if boundary.nodes.shape[1] == 3:
        ends = boundary.points[:, :2], boundary.nodes[:, :2]
        height = arc_heights(*ends, boundary.normal)
        position[boundary.nodes[:, 2]] += height[:, None] * boundary.normal
    return np.asarray(np.sum(normal * stencil.jump(position), axis=1))


def _node_positions(boundary: Boundary) -> Array:
    """Positions of the boundary's nodes by their numbers, m, shape (nodes, 2)."""
    position = np.zeros((int(boundary.nodes.max(initial=-1)) + 1, 2))
    position[boundary.nodes] = boundary.points
    return position


def _sides(boundary: Boundary, stencil: Stencil, position: Array) -> Array:
    """`Joints.sides` of joint points at some positions."""
    on_ground = np.all(stencil.nodes == GROUND, axis=2)
    mean = stencil.means(_node_positions(boundary))
    return np.where(on_ground[:, :, None], position[:, None], mean)


def _merge(boundary: Boundary, pieces: Pieces) -> tuple[Indices, Indices, Indices]:
    """Piece of every place, first place of every joint point, joint point of every place.

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
    keys = np.column_stack([keys, _direction(keys, pieces.normal[piece])])
    _, rows, point = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(rows)
    return piece, rows[order], np.argsort(order)[point.ravel()]


def _direction(keys: Indices, normal: Array) -> Indices:
    """0, or 1 where the joint kinks at a point and this piece comes second."""
    order = np.lexsort(keys.T[::-1])
    one = order[:-1]
    two = order[1:]
    kink = np.sum(normal[one] * normal[two], axis=1) < np.cos(SMOOTH_ANGLE)
    direction = np.zeros(len(keys), dtype=np.int64)
    direction[two[kink & np.all(keys[one] == keys[two], axis=1)]] = 1
    return direction


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
