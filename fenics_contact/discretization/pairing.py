"""Facets that face each other across a joint, or stand on rigid ground, and their laws."""

from __future__ import annotations

import numpy as np

from fenics_contact.discretization.facets import Boundary
from fenics_contact.errors import InputError
from fenics_contact.mesh import Array, Indices
from fenics_contact.scene import Scene

#: Facets face each other when their nodes agree to this fraction of their length.
MATCHING = 1e-4

GROUND = -1


def joint_facets(scene: Scene, boundary: Boundary) -> tuple[Indices, Indices]:
    """Facets of all joints, and then of all foundations, with their laws; the same on all ranks.

    Returns:
        Facets of both sides, that of the lower body first, or `GROUND`, shape (facets, 2), and the
        position of their law among those of the scene's joints and then foundations.

    Raises:
        InputError: If facets of a joint group have none opposite, touch without matching nodes,
            or have no law or two.
    """
    named = [name for name in scene.joints if name != "default"]
    joint_role, ground_role = boundary.role(named), boundary.role(scene.foundations)
    pairs = _pair_facets(boundary)
    paired = np.zeros(len(boundary.length), dtype=bool)
    paired[pairs] = True
    for position, name in enumerate(named):
        if alone := np.count_nonzero((joint_role == position) & ~paired):
            raise InputError(
                f"joint group '{name}': {alone} facets have no facet opposite; mesh both sides"
                " with the same nodes, or make the group a foundation or support"
            )
    for position, name in enumerate(scene.foundations):
        if both := np.count_nonzero((ground_role == position) & paired):
            raise InputError(
                f"foundation '{name}': {both} facets touch another block; a foundation is rigid"
                " ground, make the group a joint"
            )
    _check_overlaps(boundary, np.flatnonzero(~paired))
    law = _laws_of_pairs(scene, boundary, pairs, joint_role)
    ground = np.flatnonzero(ground_role >= 0)
    standing = np.column_stack([np.full(len(ground), GROUND), ground])
    of_ground = len(scene.joints) + ground_role[ground]
    return np.concatenate([pairs, standing]), np.concatenate([law, of_ground])


def distances_of_ends(boundary: Boundary, first: Indices, second: Indices) -> tuple[Array, Array]:
    """Distances of the ends of facets, taken either way round, each of shape (facets, 2), m."""
    ends, other = boundary.points[first, :2], boundary.points[second, :2]
    straight = np.linalg.norm(ends - other, axis=2)
    crossed = np.linalg.norm(ends - other[:, ::-1], axis=2)
    return straight, crossed


def _pair_facets(boundary: Boundary) -> Indices:
    """Facets of two bodies that coincide, lower body first, shape (pairs, 2)."""
    from scipy.spatial import cKDTree

    near = MATCHING * boundary.length
    middle = boundary.points[:, :2].mean(axis=1)
    pairs = cKDTree(middle).query_pairs(near.max(initial=0.0), output_type="ndarray")
    first, second = pairs.T
    straight, crossed = (d.max(axis=1) for d in distances_of_ends(boundary, first, second))
    close = np.minimum(straight, crossed) <= np.minimum(near[first], near[second])
    facing = np.sum(boundary.normal[first] * boundary.normal[second], axis=1) < 0.0
    apart = boundary.body[first] != boundary.body[second]
    pairs = pairs[apart & facing & close]
    swap = boundary.body[pairs[:, 0]] > boundary.body[pairs[:, 1]]
    pairs[swap] = pairs[swap, ::-1]
    pairs = pairs[np.lexsort(pairs.T[::-1])]
    seen, count = np.unique(pairs, return_counts=True)
    if np.any(count > 1):
        x, y = middle[seen[count > 1][0]]
        raise InputError(f"three or more facets coincide at ({x:g}, {y:g}); blocks overlap there")
    return pairs


def _check_overlaps(boundary: Boundary, alone: Indices) -> None:
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
    overlap = common * np.sqrt(square[:, 0]) > 0.01 * shorter
    bad = np.unique(one[overlap & (off.max(axis=1) <= MATCHING * shorter)])
    if len(bad):
        x, y = middle[bad[0]]
        raise InputError(
            f"{len(bad)} facets touch another block without matching nodes, the first at"
            f" ({x:g}, {y:g}); mesh both sides with the same nodes"
        )


def _laws_of_pairs(
    scene: Scene, boundary: Boundary, pairs: Indices, joint_role: Indices
) -> Indices:
    """Law of every pair as a position in `scene.joints`: of the group either side is in."""
    order = list(scene.joints)
    position = np.array([k for k, name in enumerate(order) if name != "default"] + [-1])
    sides = position[joint_role[pairs]].reshape(-1, 2)
    differ = np.flatnonzero((sides.min(axis=1) >= 0) & (sides[:, 0] != sides[:, 1]))
    if len(differ):
        first, second = (order[k] for k in sides[differ[0]])
        raise InputError(
            f"joint groups '{first}' and '{second}' are the two sides of {len(differ)} facets;"
            " put both sides into one group"
        )
    law = sides.max(axis=1, initial=-1)
    if "default" in order:
        return np.where(law < 0, order.index("default"), law)
    if np.any(law < 0):
        x, y = boundary.points[pairs[law < 0][0, 0]].mean(axis=0)
        raise InputError(
            f"blocks touch at ({x:g}, {y:g}) with no joint group of their own; add [joints.default]"
        )
    return law
