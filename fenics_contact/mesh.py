"""Meshes of blocks: a short way to `fenics_contact.geometry.mesh`."""

from fenics_contact.geometry.gmsh_mesh import GmshMesh, gmsh_session
from fenics_contact.geometry.mesh import BlockMesh

__all__ = [
    "BlockMesh",
    "GmshMesh",
    "gmsh_session",
]
