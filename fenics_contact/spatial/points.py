"""Points of contacts that carry forces, and the areas that they stand for.

Coulomb's disc at the 4 x 4 Lobatto points of a face limits its torque by the pressure of the state
itself: for a square under uniform pressure 0.391 F N a, where the continuum has 0.3826. Points lie
on the edges, so that hinges are exact. Discs at corners alone do not limit torsion.
"""

from __future__ import annotations

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.contacts import Contact, polygon_area

#: Lobatto's rule of four points on [0, 1]: places and weights.
PLACES = 0.5 + 0.5 * np.array([-1.0, -(5.0**-0.5), 5.0**-0.5, 1.0])
WEIGHTS = np.array([1.0, 5.0, 5.0, 1.0]) / 12.0


def points_of(contact: Contact, quick: bool = False) -> tuple[Array, Array]:
    """Points, m, shape (points, 3), and their areas, m2, which sum to that of the contact.

    A quadrilateral has 4 x 4 Lobatto points. Any other polygon is cut into a quadrilateral for
    every corner, of 2 x 2 points each: corners, middles of edges and the centroid.

    Args:
        contact: Where two blocks touch.
        quick: Take the corners alone; torsion is not limited then.
    """
    corners = contact.corners
    count = len(corners)
    if quick:
        return corners, np.full(count, contact.area / count)
    if count == 4:
        return _quadrilateral(corners)
    flat = contact.in_plane
    centre = polygon_centroid(flat)
    middle = contact.corners[0] + centre @ contact.axes[1:]
    halfway = 0.5 * (corners + np.roll(corners, -1, axis=0))
    halves = 0.5 * (flat + np.roll(flat, -1, axis=0))
    shares = np.zeros(2 * count + 1)
    for k in range(count):
        loop = np.array([flat[k], halves[k], centre, halves[k - 1]])
        numbers = [k, count + k, 2 * count, count + (k - 1) % count]
        shares[numbers] += 0.25 * polygon_area(loop)
    return np.vstack([corners, halfway, middle]), shares


def polygon_centroid(points: Array) -> Array:
    """Centroid of a polygon, shape (2,)."""
    following = np.roll(points, -1, axis=0)
    twice = points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]
    return np.asarray(((points + following) * twice[:, None]).sum(axis=0) / (3.0 * twice.sum()))


def _quadrilateral(corners: Array) -> tuple[Array, Array]:
    """Lobatto points of a convex quadrilateral, their areas by the map's determinant."""
    a, b, c, d = corners
    u, v = (grid.ravel() for grid in np.meshgrid(PLACES, PLACES, indexing="ij"))
    weights = np.outer(WEIGHTS, WEIGHTS).ravel()
    shape = np.column_stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
    points = shape @ corners
    by_u = np.outer(1 - v, b - a) + np.outer(v, c - d)
    by_v = np.outer(1 - u, d - a) + np.outer(u, c - b)
    return points, weights * np.linalg.norm(np.cross(by_u, by_v), axis=1)
