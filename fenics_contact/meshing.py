"""Meshes of simple structures: a short way to `fenics_contact.geometry.meshing` and `closing`."""

from fenics_contact.geometry.closing import closed_joints
from fenics_contact.geometry.meshing import (
    arch,
    buttress,
    default_size,
    model_from_arrays,
    polygons,
    running_bond,
    wall,
    wedge,
)

__all__ = [
    "arch",
    "buttress",
    "closed_joints",
    "default_size",
    "model_from_arrays",
    "polygons",
    "running_bond",
    "wall",
    "wedge",
]
