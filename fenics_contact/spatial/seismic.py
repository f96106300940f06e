"""The seismic check of a mechanism in space, by the formulas of `answers.seismic`."""

from __future__ import annotations

import numpy as np

from fenics_contact.answers.seismic import AS_ONE, SeismicCheck
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.results.result import Collapse
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.certificate import relative_motions
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import Structure


def rigid_parts(structure: Structure, mode: Array) -> Indices:
    """Numbers of parts that move as one in a mode, by blocks, shape (blocks,)."""
    points = structure.points
    rate = np.linalg.norm(relative_motions(structure, mode)[: len(points.area)], axis=1)
    largest = np.zeros(len(structure.contacts))
    np.maximum.at(largest, points.contact, rate)
    joined = np.flatnonzero(largest <= AS_ONE * largest.max(initial=0.0))
    pairs = np.array([(c.first, c.second) for c in structure.contacts])[joined]
    return connected(pairs, len(structure.blocks))


def seismic_check(
    structure: Structure, collapse: Collapse, scene: BlockScene
) -> SeismicCheck | None:
    """The check of a collapse; None where the scene asks for none, or no mass moves."""
    mode = collapse.mode
    gravity, acceleration = (np.linalg.norm(load.acceleration) for load in (scene.dead, scene.live))
    if scene.seismic is None or mode is None or not gravity * acceleration:
        return None
    speed = np.linalg.norm(mode[:, :3], axis=1)
    moving = (speed > SEARCH.slight * speed.max()) & (structure.number >= 0)
    part = rigid_parts(structure, mode)[moving]
    work = np.bincount(part, np.einsum("bi,bi->b", structure.live, mode)[moving])
    force = np.bincount(part, np.linalg.norm(structure.live[moving, :3], axis=1))
    pushed = force > 0.0
    if not np.any(pushed):
        return None
    return SeismicCheck.of(
        float(abs(collapse.load_factor) * acceleration / gravity),
        float(gravity),
        scene.seismic,
        len(np.unique(part)),
        force[pushed] / acceleration,
        work[pushed] / force[pushed],
    )
