"""Displacements of facets whose supports move with the dead load."""

from __future__ import annotations

import numpy as np

from fenics_contact.discretization.facets import Boundary
from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.scene.scene import Movement, Scene


def facet_motion(scene: Scene, boundary: Boundary) -> Array:
    """Displacements of the nodes of facets with what supports them, m, shape of their points."""
    motion = np.zeros(boundary.points.shape)
    for name, movement in scene.dead.movement.items():
        mine = boundary.in_group(name)
        motion[mine] = displacements(movement, boundary, mine, boundary.points[mine])
    return motion


def displacements(movement: Movement, boundary: Boundary, edges: Flags, points: Array) -> Array:
    """Displacements of points that move with some facets, m, shape of the points."""
    middle = boundary.points[edges, :2].mean(axis=1)
    length = boundary.length[edges]
    arm = points - np.average(middle, axis=0, weights=length)
    turn = np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
    return np.asarray(movement.displacement + np.radians(movement.rotation) * turn)
