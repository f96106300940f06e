"""Drawings of blocks: a short way to `fenics_contact.geometry.drawing`."""

from fenics_contact.geometry.drawing import (
    Drawing,
    read_dxf,
)

__all__ = [
    "Drawing",
    "read_dxf",
]
