"""Meshes of simple structures: a short way to `fenics_contact.geometry.meshing`."""

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
    "default_size",
    "model_from_arrays",
    "polygons",
    "running_bond",
    "wall",
    "wedge",
]
