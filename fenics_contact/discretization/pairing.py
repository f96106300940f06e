"""Facets of two blocks that face each other, and the laws of the joints they make."""

from __future__ import annotations

import numpy as np

from fenics_contact.discretization.facets import GROUND, Boundary
from fenics_contact.errors import InputError
from fenics_contact.mesh import Array, Indices
from fenics_contact.scene import Scene

#: Facets face each other when their nodes agree to this fraction of their length.
MATCHING = 1e-4


def joint_facets(scene: Scene, boundary: Boundary) -> tuple[Indices, Indices]:
    """Both sides, shape (2, facets), and law of the facets of all joints, then foundations.

    Raises:
        InputError: If facets of a joint group have none opposite, touch without matching nodes,
            have no law or two, or if both sides of a joint carry a traction.
    """
    named = [name for name in scene.joints if name != "default"]
    joint_role, ground_role = boundary.role(named), boundary.role(scene.foundations)
    pairs = facing_facets(boundary)
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
    _check_tractions(scene, boundary, pairs)
    _check_overlaps(boundary, np.flatnonzero(~paired))
    law = _laws_of_pairs(scene, boundary, pairs, joint_role)
    ground = np.flatnonzero(ground_role >= 0)
    sides = np.hstack([pairs.T, [np.full_like(ground, GROUND), ground]])
    return sides, np.append(law, len(scene.joints) + ground_role[ground])


def distances_of_ends(boundary: Boundary, first: Indices, second: Indices) -> tuple[Array, Array]:
    """Distances of the ends of facets, taken either way round, each of shape (facets, 2), m."""
    ends, other = boundary.points[first, :2], boundary.points[second, :2]
    return np.linalg.norm(ends - other, axis=2), np.linalg.norm(ends - other[:, ::-1], axis=2)


def facing_facets(boundary: Boundary) -> Indices:
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


def _check_tractions(scene: Scene, boundary: Boundary, pairs: Indices) -> None:
    """Refuse a traction on both sides of a joint."""
    for kind, load in (("dead", scene.dead), ("live", scene.live)):
        for name in load.traction:
            if both := np.count_nonzero(boundary.in_group(name)[pairs].all(axis=1)):
                raise InputError(
                    f"loads.{kind}.traction.{name}: {both} facets are in the group with both sides"
                    " of a joint, and would carry the traction twice; leave joints out of the group"
                )


def _check_overlaps(boundary: Boundary, alone: Indices) -> None:
    """A facet without partner must not lie on another body's facet: its contact would be lost."""
    from scipy.spatial import cKDTree

    if len(alone) == 0:
        return
    middle = boundary.points[:, :2].mean(axis=1)
    reach = 0.5 * (boundary.length[alone] + boundary.length.max())
    candidates = cKDTree(middle).query_ball_point(middle[alone], reach)
    one = np.repeat(alone, [len(found) for found in candidates])
    other = np.concatenate(candidates).astype(np.int64)
    keep = boundary.body[one] != boundary.body[other]
    keep &= np.sum(boundary.normal[one] * boundary.normal[other], axis=1) < -0.99
    one, other = one[keep], other[keep]
    start, length = boundary.points[other, 0], boundary.length[other]
    along = (boundary.points[other, 1] - start) / length[:, None]
    arm = boundary.points[one, :2] - start[:, None]
    at = np.einsum("nek,nk->ne", arm, along)  # where the ends of `one` fall on `other`, m
    off = np.abs(np.einsum("nek,nk->ne", arm, boundary.normal[other])).max(axis=1)
    common = np.minimum(at.max(axis=1), length) - np.maximum(at.min(axis=1), 0.0)
    shorter = np.minimum(boundary.length[one], length)
    bad = np.unique(one[(common > 0.01 * shorter) & (off <= MATCHING * shorter)])
    if len(bad):
        x, y = middle[bad[0]]
        raise InputError(
            f"{len(bad)} facets touch another block without matching nodes, the first at"
            f" ({x:g}, {y:g}); mesh both sides with the same nodes"
        )


def _laws_of_pairs(
    scene: Scene, boundary: Boundary, pairs: Indices, joint_role: Indices
) -> Indices:
    """Law of every pair as a position in `scene.joints`, by the group that either side is in."""
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
