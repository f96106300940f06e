"""Drawings of blocks: a short way to `fenics_contact.geometry.meshing` and `geometry.dxf`."""

from fenics_contact.geometry.dxf.blocks import DxfContents, read_dxf
from fenics_contact.geometry.dxf.roles import LayerRoles
from fenics_contact.geometry.meshing import Drawing

__all__ = [
    "Drawing",
    "DxfContents",
    "LayerRoles",
    "read_dxf",
]
