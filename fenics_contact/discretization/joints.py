"""Joints: facets that face each other, and the points at which they exchange forces.

A joint point is a pair of coinciding nodes of two blocks, or a node on rigid ground. With n the
unit normal from the first side to the second and t = n turned by 90 degrees anticlockwise,

    w_N = n . (u_second - u_first) >= 0   opening,      w_T = t . (u_second - u_first)   slip;

on rigid ground the first side does not move. w_N = B_N u and w_T = B_T u, one row per point.
Nodal weights are the exact integrals of the Lagrange functions on a facet (degree 1: trapezoidal
rule, degree 2: Simpson's).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.discretization.facets import Boundary
from fenics_contact.errors import InputError
from fenics_contact.scene import JointLaw, Scene
from fenics_contact.discretization.supports import SMOOTH_ANGLE, Supports

#: Facets face each other when their nodes agree to this fraction of their length.
MATCHING = 1e-4

#: Weight of a facet's nodes in units of its length, by number of nodes.
NODAL_WEIGHTS = {2: (0.5, 0.5), 3: (1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0)}

GROUND = -1


@dataclass(frozen=True)
class Joints:
    """Joint points and the facets between them; the same on all ranks.

    Attributes:
        nodes: Nodes of the first and second side, `GROUND` for rigid ground, shape (points, 2).
        bodies: Their bodies, likewise.
        position: Shape (points, 2), m.
        normal: Unit normal from first to second side, shape (points, 2).
        length: Length of joint that belongs to the point, shape (points,), m.
        law: Law of every point as an index into `laws`, shape (points,).
        laws: The scene's laws.
        names: The names of their groups.
        segments: Joint points at the ends of every facet of a joint, shape (facets, 2).
    """

    nodes: npt.NDArray[np.int64]
    bodies: npt.NDArray[np.int32]
    position: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    length: npt.NDArray[np.float64]
    law: npt.NDArray[np.int64]
    laws: tuple[JointLaw, ...]
    names: tuple[str, ...]
    segments: npt.NDArray[np.int64]

    @property
    def tangent(self) -> npt.NDArray[np.float64]:
        """Unit tangents, shape (points, 2)."""
        return np.column_stack([-self.normal[:, 1], self.normal[:, 0]])

    @property
    def friction(self) -> npt.NDArray[np.float64]:
        """Coefficient of friction of every point, 0 where the law is not Coulomb's."""
        return np.array([law.friction or 0.0 for law in self.laws] + [0.0])[self.law]

    @property
    def shear_strength(self) -> npt.NDArray[np.float64]:
        """Given bound on the shear force at every point, N/m; 0 where the law is not Tresca's."""
        return np.array([law.bound or 0.0 for law in self.laws] + [0.0])[self.law] * self.length


@dataclass(frozen=True)
class Slots:
    """The joint points of every body, in a row; the same on all ranks.

    Attributes:
        body: Bodies of both sides of every joint point, -1 for ground, shape (points, 2).
        slot: Places of the joint point among those of either body, shape (points, 2).
        table: Joint point in every place of every body, -1: none, shape (bodies, places).
    """

    body: npt.NDArray[np.int64]
    slot: npt.NDArray[np.int64]
    table: npt.NDArray[np.int64]

    @classmethod
    def of(cls, body: npt.NDArray[np.int32]) -> Slots:
        """Slots from the bodies of both sides of all joint points."""
        flat = np.asarray(body, dtype=np.int64).ravel()
        order = np.argsort(flat, kind="stable")
        owner = flat[order]
        place = np.arange(len(flat)) - np.searchsorted(owner, owner)
        slot = np.empty_like(flat)
        slot[order] = place
        held = owner != GROUND
        count = int(owner.max(initial=-1)) + 1, int(place[held].max(initial=-1)) + 1
        table = np.full(count, -1)
        table[owner[held], place[held]] = order[held] // 2
        slot[flat == GROUND] = -1
        return cls(flat.reshape(-1, 2), slot.reshape(-1, 2), table)


@dataclass(frozen=True)
class JointOperators:
    """B_N and B_T with this rank's rows, and the joint points that those rows are.

    Attributes:
        normal: B_N, shape (points, dofs).
        tangential: B_T, shape (points, dofs).
        points: Joint point of every local row.
        dofs: Global dofs of every local row, first side then second, shape (rows, 4); -1: none.
        normal_rows: Coefficients of B_N on those dofs, shape (rows, 4).
        tangential_rows: Coefficients of B_T, likewise.
        slots: The joint points of every body.
    """

    normal: PETSc.Mat
    tangential: PETSc.Mat
    points: npt.NDArray[np.int64]
    dofs: npt.NDArray[np.int32]
    normal_rows: npt.NDArray[np.float64]
    tangential_rows: npt.NDArray[np.float64]
    slots: Slots


def find_joints(scene: Scene, boundary: Boundary) -> Joints:
    """Pair the facets of the blocks and collect the points of all joints and foundations.

    Raises:
        InputError: If facets of a joint group have none opposite, touch without matching nodes,
            or have no law or two.
    """
    names = (*scene.joints, *scene.foundations)
    laws = (*scene.joints.values(), *scene.foundations.values())
    joint_role = boundary.role([name for name in scene.joints if name != "default"])
    ground_role = boundary.role(scene.foundations)
    pairs = _pair_facets(boundary)
    _check_pairs(scene, boundary, pairs, joint_role, ground_role)
    law = _laws_of_pairs(scene, boundary, pairs, joint_role)
    ground = np.flatnonzero(ground_role >= 0)
    return _points(
        boundary, pairs, law, ground, len(scene.joints) + ground_role[ground], laws, names
    )


def _pair_facets(boundary: Boundary) -> npt.NDArray[np.int64]:
    """Facets of two bodies that coincide, lower body first, shape (pairs, 2)."""
    from scipy.spatial import cKDTree

    near = MATCHING * boundary.length
    middle = boundary.points[:, :2].mean(axis=1)
    pairs = cKDTree(middle).query_pairs(near.max(initial=0.0), output_type="ndarray")
    first, second = pairs.T
    ends, other = boundary.points[first, :2], boundary.points[second, :2]
    close = np.minimum(near[first], near[second])
    # Both facets run with their block on one side or other: compare either way round.
    straight = np.linalg.norm(ends - other, axis=2).max(axis=1)
    crossed = np.linalg.norm(ends - other[:, ::-1], axis=2).max(axis=1)
    facing = np.sum(boundary.normal[first] * boundary.normal[second], axis=1) < 0.0
    apart = boundary.body[first] != boundary.body[second]
    pairs = pairs[apart & facing & (np.minimum(straight, crossed) <= close)]
    swap = boundary.body[pairs[:, 0]] > boundary.body[pairs[:, 1]]
    pairs[swap] = pairs[swap, ::-1]
    pairs = pairs[np.lexsort(pairs.T[::-1])]
    seen, count = np.unique(pairs, return_counts=True)
    if np.any(count > 1):
        x, y = middle[seen[count > 1][0]]
        raise InputError(f"three or more facets coincide at ({x:g}, {y:g}); blocks overlap there")
    return pairs


def _check_pairs(
    scene: Scene,
    boundary: Boundary,
    pairs: npt.NDArray[np.int64],
    joint_role: npt.NDArray[np.int64],
    ground_role: npt.NDArray[np.int64],
) -> None:
    paired = np.zeros(len(boundary.length), dtype=bool)
    paired[pairs] = True
    groups = [name for name in scene.joints if name != "default"]
    for position, name in enumerate(groups):
        alone = int(np.count_nonzero((joint_role == position) & ~paired))
        if alone:
            raise InputError(
                f"joint group '{name}': {alone} facets have no facet opposite; mesh both sides"
                " with the same nodes, or make the group a foundation or support"
            )
    for position, name in enumerate(scene.foundations):
        both = int(np.count_nonzero((ground_role == position) & paired))
        if both:
            raise InputError(
                f"foundation '{name}': {both} facets touch another block; a foundation is rigid"
                " ground, make the group a joint"
            )
    _check_overlaps(boundary, np.flatnonzero(~paired))


def _check_overlaps(boundary: Boundary, alone: npt.NDArray[np.int64]) -> None:
    """A facet without partner must not lie on another body's facet: its contact would be lost."""
    from scipy.spatial import cKDTree

    if len(alone) == 0:
        return
    middle = boundary.points[:, :2].mean(axis=1)
    reach = 0.5 * (boundary.length[alone] + boundary.length.max())
    candidates = cKDTree(middle).query_ball_point(middle[alone], reach)
    count = np.array([len(c) for c in candidates])
    one = np.repeat(alone, count)
    other = np.concatenate([np.asarray(c, dtype=np.int64) for c in candidates])
    keep = boundary.body[one] != boundary.body[other]
    keep &= np.sum(boundary.normal[one] * boundary.normal[other], axis=1) < -0.99
    one, other = one[keep], other[keep]
    start = boundary.points[other, 0]
    along = boundary.points[other, 1] - start
    square = np.sum(along**2, axis=1)[:, None]
    arm = boundary.points[one, :2] - start[:, None]
    at = np.einsum("nek,nk->ne", arm, along) / square  # where the ends of `one` fall on `other`
    off = np.abs(np.einsum("nek,nk->ne", arm, boundary.normal[other]))
    shorter = np.minimum(boundary.length[one], boundary.length[other])
    common = np.minimum(at.max(axis=1), 1.0) - np.maximum(at.min(axis=1), 0.0)
    overlap = (common * np.sqrt(square[:, 0]) > 0.01 * shorter) & (
        off.max(axis=1) <= MATCHING * shorter
    )
    if np.any(overlap):
        bad = np.unique(one[overlap])
        x, y = middle[bad[0]]
        raise InputError(
            f"{len(bad)} facets touch another block without matching nodes, the first at"
            f" ({x:g}, {y:g}); mesh both sides with the same nodes"
        )


def _laws_of_pairs(
    scene: Scene,
    boundary: Boundary,
    pairs: npt.NDArray[np.int64],
    joint_role: npt.NDArray[np.int64],
) -> npt.NDArray[np.int64]:
    """Law of every pair as a position in `scene.joints`: of the group either side is in."""
    order = list(scene.joints)
    position = np.array([order.index(n) for n in order if n != "default"] + [-1])
    sides = position[joint_role[pairs]].reshape(-1, 2)
    differ = np.flatnonzero((sides.min(axis=1) >= 0) & (sides[:, 0] != sides[:, 1]))
    if len(differ):
        first, second = (order[k] for k in sides[differ[0]])
        raise InputError(
            f"joint groups '{first}' and '{second}' are the two sides of {len(differ)} facets;"
            " put both sides into one group"
        )
    law = sides.max(axis=1, initial=-1)
    if np.any(law < 0):
        if "default" not in scene.joints:
            x, y = boundary.points[pairs[law < 0][0, 0]].mean(axis=0)
            raise InputError(
                f"blocks touch at ({x:g}, {y:g}) with no joint group of their own; add"
                " [joints.default]"
            )
        law[law < 0] = order.index("default")
    return law


def _points(
    boundary: Boundary,
    pairs: npt.NDArray[np.int64],
    law: npt.NDArray[np.int64],
    ground: npt.NDArray[np.int64],
    ground_law: npt.NDArray[np.int64],
    laws: tuple[JointLaw, ...],
    names: tuple[str, ...],
) -> Joints:
    """Merge the nodes of facets into joint points: one per node pair, law and direction."""
    per_facet = boundary.nodes.shape[1]
    first, second = pairs.T
    # Order the second side's nodes like the first side's.
    ends, other = boundary.points[first, :2], boundary.points[second, :2]
    crossed = np.linalg.norm(ends - other, axis=2).sum(axis=1) > np.linalg.norm(
        ends - other[:, ::-1], axis=2
    ).sum(axis=1)
    swap = np.where(crossed[:, None], [1, 0, 2][:per_facet], [0, 1, 2][:per_facet])
    second_nodes = np.take_along_axis(boundary.nodes[second], swap, axis=1)
    on_ground = np.full((len(ground), per_facet), GROUND)
    nodes = np.stack(
        [
            np.concatenate([boundary.nodes[first], on_ground]),
            np.concatenate([second_nodes, boundary.nodes[ground]]),
        ],
        axis=2,
    )
    bodies = np.concatenate(
        [
            boundary.body[pairs],
            np.column_stack([np.full(len(ground), GROUND), boundary.body[ground]]),
        ]
    )
    normal = np.concatenate([boundary.normal[first], -boundary.normal[ground]])
    length = np.concatenate([boundary.length[first], boundary.length[ground]])
    facet_law = np.concatenate([law, ground_law]).astype(np.int64)
    position = np.concatenate([boundary.points[first], boundary.points[ground]])

    facet = np.repeat(np.arange(len(length)), per_facet)
    weight = np.outer(length, NODAL_WEIGHTS[per_facet]).ravel()
    keys = np.column_stack([nodes.reshape(-1, 2), facet_law[facet]])
    keys = np.column_stack([keys, _direction(keys, normal[facet])])
    _, rows, point = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    point, rows = _in_order_of_appearance(point.ravel(), rows)
    count = len(rows)
    total = np.bincount(point, weight, count).astype(float)
    mean = np.column_stack([np.bincount(point, weight * normal[facet, d], count) for d in range(2)])
    return Joints(
        nodes=nodes.reshape(-1, 2)[rows],
        bodies=bodies[facet[rows]],
        position=position.reshape(-1, 2)[rows],
        normal=mean / np.linalg.norm(mean, axis=1)[:, None],
        length=total,
        law=facet_law[facet[rows]],
        laws=laws,
        names=names,
        segments=point.reshape(-1, per_facet)[:, :2],
    )


def _direction(
    keys: npt.NDArray[np.int64], normal: npt.NDArray[np.float64]
) -> npt.NDArray[np.int64]:
    """0, or 1 where the joint kinks at a node pair and this facet comes second."""
    order = np.lexsort(keys.T[::-1])
    same = np.all(keys[order[1:]] == keys[order[:-1]], axis=1)
    kink = np.sum(normal[order[1:]] * normal[order[:-1]], axis=1) < np.cos(SMOOTH_ANGLE)
    direction = np.zeros(len(keys), dtype=np.int64)
    direction[order[1:][same & kink]] = 1
    return direction


def _in_order_of_appearance(
    label: npt.NDArray[np.int64], first: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Renumber labels by their first row, so that the order does not depend on node numbers."""
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[label], first[order]


def joint_operators(joints: Joints, supports: Supports, stiffness: PETSc.Mat) -> JointOperators:
    """Build B_N and B_T in the supports' coordinates, on the layout of the stiffness.

    A point's row lives on the rank that owns its second node.
    """
    start, end = stiffness.getOwnershipRange()
    points = np.flatnonzero((joints.nodes[:, 1] >= start // 2) & (joints.nodes[:, 1] < end // 2))
    nodes = joints.nodes[points]
    dofs = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, 4)
    dofs[np.repeat(nodes == GROUND, 2, axis=1)] = -1
    directions = np.stack([supports.free_directions(nodes[:, side]) for side in (0, 1)], axis=1)
    sign = np.where(nodes == GROUND, 0.0, np.array([-1.0, 1.0]))
    rows = [
        (np.einsum("nk,nskl->nsl", axis[points], directions) * sign[:, :, None]).reshape(-1, 4)
        for axis in (joints.normal, joints.tangent)
    ]
    matrices = [sparse_rows(stiffness, dofs, row) for row in rows]
    return JointOperators(
        normal=matrices[0],
        tangential=matrices[1],
        points=points,
        dofs=dofs.astype(PETSc.IntType),
        normal_rows=rows[0],
        tangential_rows=rows[1],
        slots=Slots.of(joints.bodies),
    )


def sparse_rows(
    stiffness: PETSc.Mat, dofs: npt.NDArray[np.int64], rows: npt.NDArray[np.float64]
) -> PETSc.Mat:
    """A matrix on the displacements.

    Args:
        stiffness: Whose columns it has.
        dofs: Global dofs of this rank's rows, shape (rows, n); -1: none.
        rows: Coefficients, likewise.
    """
    kept = dofs >= 0
    indptr = np.concatenate([[0], np.cumsum(kept.sum(axis=1))]).astype(PETSc.IntType)
    matrix = PETSc.Mat().createAIJ(
        ((len(rows), PETSc.DETERMINE), (stiffness.getLocalSize()[1], PETSc.DETERMINE)),
        csr=(indptr, dofs[kept].astype(PETSc.IntType), rows[kept]),
        comm=stiffness.comm,
    )
    matrix.assemble()
    return matrix
