"""Meshes of blocks: a short way to `fenics_contact.geometry.mesh`."""

from fenics_contact.geometry.mesh import (
    BlockMesh,
    GmshMesh,
    gmsh_session,
)

__all__ = [
    "BlockMesh",
    "GmshMesh",
    "gmsh_session",
]
