"""Drawings of blocks: a short way to `fenics_contact.geometry.drawing` and `geometry.dxf`."""

from fenics_contact.geometry.drawing import Drawing
from fenics_contact.geometry.dxf.blocks import DxfContents, read_dxf
from fenics_contact.geometry.dxf.roles import LayerRoles

__all__ = [
    "Drawing",
    "DxfContents",
    "LayerRoles",
    "read_dxf",
]
