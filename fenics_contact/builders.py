"""Facades, bridges, walls: a short way to `fenics_contact.geometry.builders`."""

from fenics_contact.geometry.builders import (
    bridge,
    facade,
    retaining_wall,
)

__all__ = [
    "bridge",
    "facade",
    "retaining_wall",
]
