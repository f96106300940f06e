"""The limit load of a structure in space."""

from __future__ import annotations

import numpy as np

from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.result import SpatialCollapse
from fenics_contact.spatial.structure import Structure

#: Gap of elastic states beside which collapse states are looked for. Points of a face share its
#: pressure in many ways: a twisted block carries 30 % more in a state beside one of 1e-2.
NEAR = 1e-4


def collapse_of(structure: Structure, sign: float = 1.0, asked: float = 1e-3) -> SpatialCollapse:
    """The collapse under the live load, or under the reverse of it (sign -1)."""
    search = FaceSearch(structure.face_model(sign), asked, near=NEAR)
    state = search.run()
    if state is None or state.gap > SEARCH.rough_gap:
        return SpatialCollapse("not_converged", sign=sign, reason="no state was found")
    return as_collapse(structure, state, sign)


def as_collapse(structure: Structure, state: FaceState, sign: float) -> SpatialCollapse:
    """A certified state in the terms of the structure."""
    mode = np.zeros((len(structure.blocks), 6))
    mode[structure.number >= 0] = state.mode.reshape(-1, 6)
    mode[:, 3:] /= structure.size
    mode /= np.linalg.norm(mode[:, :3], axis=1).max(initial=1e-300)
    force = structure.point_forces(state.force)
    return SpatialCollapse("limit", state.load_factor, state.gap, mode=mode, force=force, sign=sign)
