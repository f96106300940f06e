"""The seismic check of a mechanism of rigid blocks."""

from __future__ import annotations

import numpy as np

from fenics_contact.answers import seismic
from fenics_contact.results.result import Collapse
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.view import view_of


def seismic_check(
    structure: Structure, collapse: Collapse, scene: BlockScene
) -> seismic.SeismicCheck | None:
    """The check of a collapse; None where the scene asks for none, or no mass moves."""
    if scene.seismic is None or collapse.mode is None:
        return None
    gravity, push = (float(np.linalg.norm(load.acceleration)) for load in (scene.dead, scene.live))
    view = view_of(structure, collapse)
    return seismic.seismic_check(view, scene.seismic, collapse.load_factor, gravity, push)
