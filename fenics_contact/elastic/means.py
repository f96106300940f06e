"""Displacements at points of a contact as means, so that forces there act as smooth tractions.

The points of a quadrilateral are Lobatto's, u, v in [0, 1]; those of any other polygon lie in
triangles from the centroid: Radau's along the rays, Simpson's along the edge. With the Lagrange
functions l_i of the points and their areas A_i = int l_i,

    [u]_i = (1 / A_i) int l_i u dA,      traction t = sum_i (r_i / A_i) l_i.

The l_i sum to 1: a uniform pressure is a uniform traction. Linear functions have their values at
the points as means: B R = H for rigid motions R. A triangle is a quadrilateral with two corners in
one, so that one map does for both.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from fenics_contact.elastic.body import ElasticBody
from fenics_contact.errors import SolverError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.spatial.contacts import Contact, clipped, frame
from fenics_contact.spatial.points import PLACES, points_of, polygon_centroid

#: Cosine of the angle up to which a facet faces a contact.
FACING = 0.99
#: Facets this far behind the nearest one are of another side, in parts of the contact's width.
BEHIND = 0.02
#: A contact of which less lies on facets is not on the mesh.
COVERED = 0.5
#: Gauss' points: products of two bicubic functions and quadratic ones are exact.
GAUSS = 5
#: Steps of Newton's method; it has all digits after a few.
STEPS = 8
#: Corners this near to a line are on it, in parts of the patch.
ROUNDING = 1e-13
#: Places along rays, and along edges.
RAYS, EDGE = np.array([0.5, 1.0]), np.array([0.0, 0.5, 1.0])


class Patch(NamedTuple):
    """A quadrilateral, perhaps with two corners in one, and points in it.

    Attributes:
        corners: m, counterclockwise, shape (4, 2).
        places: Of points, u and v.
        numbers: Of the points, u by u.
    """

    corners: Array
    places: tuple[Array, Array]
    numbers: Indices


class Surface(NamedTuple):
    """A polygon on the surface of a block, and points in it.

    Attributes:
        corners: m, counterclockwise about the normal, shape (corners, 3).
        axes: Normal and tangents, shape (3, 3).
        outwards: 1.0 where the normal points out of the block, -1.0 where it points into it.
        areas: Of the points, m2, as of `spatial.points.points_of`.
    """

    corners: Array
    axes: Array
    outwards: float
    areas: Array

    @classmethod
    def of_side(cls, corners: Array) -> Surface:
        """A side of a block, with corners in m, shape (corners, 3)."""
        along = corners[1] - corners[0]
        axes = frame(np.cross(along, corners[2] - corners[1]), along)
        return cls(corners, axes, 1.0, points_of(Contact(0, 0, axes, corners))[1])

    def patches(self) -> Iterator[Patch]:
        """Its patches, in its plane from the first corner."""
        flat = (self.corners - self.corners[0]) @ self.axes[1:].T
        count = len(flat)
        if count == 4:
            yield Patch(flat, (PLACES, PLACES), np.arange(16))
            return
        centre = polygon_centroid(flat)
        for k in range(count):
            ring = np.array([k, count + k, (k + 1) % count])
            corners = np.array([centre, flat[k], flat[(k + 1) % count], centre])
            yield Patch(corners, (RAYS, EDGE), np.concatenate([2 * count + ring, ring]))


def means(body: ElasticBody, surface: Surface) -> Any:
    """Means of a body's displacements for the points of a surface, sparse, shape (points, nodes).

    Raises:
        SolverError: If the surface is not that of the body.
    """
    from scipy.sparse import csr_matrix

    facets, cells, normals = body.surface
    corners, axes, outwards, areas = surface
    place = (body.points[facets] - corners[0]) @ axes.T
    away, flat = np.abs(place[..., 0]).mean(axis=1), place[..., 1:]
    edge = (corners - corners[0]) @ axes[1:].T
    here = outwards * (normals @ axes[0]) > FACING
    low, high = edge.min(axis=0), edge.max(axis=0)
    here &= np.all((flat.max(axis=1) > low) & (flat.min(axis=1) < high), axis=1)
    here &= away <= away[here].min(initial=np.inf) + BEHIND * np.sqrt(areas.sum())
    flat, cells = flat[here, :: int(outwards)], cells[here]
    found = np.zeros((len(areas), len(body.nodes)))
    covered = 0.0
    for patch in surface.patches():
        triangles, of = _parts(flat, patch.corners)
        places, weights = _rule(triangles)
        covered += weights.sum()
        cell = np.repeat(cells[of], weights.shape[1])
        places = places.reshape(-1, 2)
        u, v = _inverse(patch.corners, places).T
        first, second = (lagrange(*one) for one in zip(patch.places, (u, v), strict=True))
        at_points = np.einsum("q,qi,qj->qij", weights.ravel(), first, second)
        at_nodes = body.shape_functions(cell, corners[0] + places @ axes[1:])
        start = np.arange(len(places) + 1) * at_nodes.shape[1]
        entries = at_nodes.ravel(), body.cell_nodes[cell].ravel(), start
        table = csr_matrix(entries, (len(places), len(body.nodes)))
        found[patch.numbers] += (table.T @ at_points.reshape(len(places), -1)).T
    if covered < COVERED * areas.sum():
        raise SolverError(f"{covered / areas.sum():.0%} of a contact lies on its mesh")
    return csr_matrix(found / areas[:, None])


def lagrange(nodes: Array, at: Array) -> Array:
    """Lagrange functions of nodes, shape (places, nodes)."""
    others = [np.delete(nodes, k) for k in range(len(nodes))]
    parts = [(at[:, None] - o) / (x - o) for x, o in zip(nodes, others, strict=True)]
    return np.stack([part.prod(axis=1) for part in parts], axis=1)


def _parts(triangles: Array, patch: Array) -> tuple[Array, Indices]:
    """Parts of counterclockwise triangles in a patch, as triangles, and of which they are.

    Their areas may be negative: they have a polygon's centroid as second corner, along rays from
    which functions are polynomials.
    """
    loop = patch if np.any(patch[3] != patch[0]) else patch[:3]
    near = ROUNDING * float(np.ptp(patch, axis=0).max())
    parts, of = [], []
    for number, triangle in enumerate(triangles):
        part = clipped(triangle, loop, near)
        apex = patch[:1] if len(loop) == 3 else part[:1]
        for a, b in zip(part, np.roll(part, -1, axis=0), strict=True):
            parts.append([b, *apex, a])
            of.append(number)
    every = np.array(parts).reshape(-1, 3, 2)
    kept = np.linalg.det(every[:, 1:] - every[:, :1]) != 0.0
    return every[kept], np.array(of, dtype=np.int64)[kept]


def _rule(triangles: Array) -> tuple[Array, Array]:
    """Gauss' points on rays from second corners, (triangles, points, 2), and weights, m2."""
    node, weight = np.polynomial.legendre.leggauss(GAUSS)
    u, v = (0.5 + 0.5 * grid.ravel() for grid in np.meshgrid(node, node, indexing="ij"))
    share = 0.25 * np.outer(weight, weight).ravel() * (1.0 - u)
    part = np.column_stack([1.0 - u - v * (1.0 - u), u, v * (1.0 - u)])
    twice = np.linalg.det(triangles[:, 1:] - triangles[:, :1])
    return np.einsum("pk,tkd->tpd", part, triangles), np.outer(twice, share)


def _inverse(patch: Array, places: Array) -> Array:
    """(u, v) of places in a patch, by Newton's method, shape (places, 2)."""
    a, b, c, d = patch
    found = np.full(places.shape, 0.5)
    for _ in range(STEPS):
        u, v = found.T[:, :, None]
        missed = a * (1 - u) * (1 - v) + b * u * (1 - v) + c * u * v + d * (1 - u) * v - places
        by_u, by_v = (b - a) * (1 - v) + (c - d) * v, (d - a) * (1 - u) + (c - b) * u
        found = found - np.linalg.solve(np.stack([by_u, by_v], axis=2), missed[..., None])[..., 0]
    return found
