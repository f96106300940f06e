"""Structures of rigid blocks without a mesh, in space or in the plane: the engine of `faces`.

Blocks are convex polyhedra, or several that move as one. Where plane sides of two blocks touch, a
contact carries pressure and Coulomb friction at points. Blocks are rigid; faces are elastic.
"""

from fenics_contact.scene.scene import (
    Floor,
    Force,
    JointLaw,
    Load,
    Material,
    Movement,
    OutputOptions,
    Seismic,
    SolveOptions,
    Tie,
)
from fenics_contact.spatial.block_tables import prism
from fenics_contact.spatial.limit import limit_load, standing
from fenics_contact.spatial.loads import Sides
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.record import BlockLimitLoad as LimitLoad
from fenics_contact.spatial.scene import BlockScene as Scene
from fenics_contact.spatial.scene import Foundation, Plane

__all__ = [
    "Block",
    "Floor",
    "Force",
    "Foundation",
    "JointLaw",
    "LimitLoad",
    "Load",
    "Material",
    "Movement",
    "OutputOptions",
    "Plane",
    "Polyhedron",
    "Scene",
    "Seismic",
    "Sides",
    "SolveOptions",
    "Tie",
    "limit_load",
    "prism",
    "standing",
]
