"""Points of contacts that carry forces, and the areas that they stand for.

Coulomb's disc at 12 or more points of a face limits its torque by the pressure of the state itself:
for a square under uniform pressure 0.391 F N a, where the continuum has 0.3826. Points lie on the
edges, so that hinges are exact. Discs at corners alone do not limit torsion.
"""

from __future__ import annotations

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.contacts import Contact

#: Lobatto's rule of four points on [0, 1]: places and weights.
PLACES = 0.5 + 0.5 * np.array([-1.0, -(5.0**-0.5), 5.0**-0.5, 1.0])
WEIGHTS = np.array([1.0, 5.0, 5.0, 1.0]) / 12.0


def points_of(contact: Contact, quick: bool = False) -> tuple[Array, Array]:
    """Points, m, shape (points, 3), and their areas, m2.

    Areas are positive, sum to that of the contact, and have its centroid (but for `quick`). Edges
    and corners have their ends, without area.

    A quadrilateral has 4 x 4 Lobatto points. Any other polygon has a ring of points on its outline,
    corners and middles of edges (Simpson's rule), and one halfway to the centroid (Radau's rule):
    exact for second moments, and for distances from the centroid along rays.

    Args:
        contact: Where two blocks touch.
        quick: Take the corners alone, alike; torsion is not limited then.
    """
    if quick or len(contact.corners) < 3:
        return contact.corners, np.full(len(contact.corners), contact.area / len(contact.corners))
    flat = contact.in_plane
    following = np.roll(flat, -1, axis=0)
    centre = polygon_centroid(flat)
    a = (flat - centre).T
    b = (following - centre).T
    triangles = 0.5 * (a[0] * b[1] - a[1] * b[0])  # on the edges, with the centroid
    at_corners = 0.5 * (triangles + np.roll(triangles, 1))
    if len(flat) == 4:
        places, areas = _quadrilateral(flat)
    else:
        ring = np.vstack([flat, 0.5 * (flat + following)])
        shares = np.concatenate([at_corners, 2.0 * triangles]) / 3.0
        places = np.vstack([ring, 0.5 * (ring + centre)])
        areas = np.concatenate([shares, 2.0 * shares]) / 3.0
    return contact.corners[0] + places @ contact.axes[1:], areas


def ends_of(contact: Contact) -> tuple[Array, Array]:
    """Ends of a contact in the plane x-z along its first tangent, as `points_of` gives points."""
    along = contact.in_plane[:, 0]
    ends = contact.corners[[along.argmin(), along.argmax()]]
    ends[:, 1] = contact.corners[:, 1].mean()
    return ends, np.full(2, 0.5 * contact.area)


def polygon_centroid(points: Array) -> Array:
    """Centroid of a polygon, shape (2,)."""
    following = np.roll(points, -1, axis=0)
    twice = points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]
    return np.asarray(((points + following) * twice[:, None]).sum(axis=0) / (3.0 * twice.sum()))


def _quadrilateral(corners: Array) -> tuple[Array, Array]:
    """Lobatto points of a plane quadrilateral, their areas by the map's determinant."""
    a, b, c, d = corners
    u, v = (grid.ravel() for grid in np.meshgrid(PLACES, PLACES, indexing="ij"))
    shape = np.column_stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
    by_u = (np.outer(1 - v, b - a) + np.outer(v, c - d)).T
    by_v = (np.outer(1 - u, d - a) + np.outer(u, c - b)).T
    weights = np.outer(WEIGHTS, WEIGHTS).ravel()
    return shape @ corners, weights * (by_u[0] * by_v[1] - by_u[1] * by_v[0])
