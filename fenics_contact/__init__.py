"""Limit loads of planar systems of elastic blocks with unilateral contact and Coulomb friction."""

from fenics_contact.equilibrium import Equilibrium, equilibrium
from fenics_contact.errors import ContactError, InputError, OutputError, SolverError
from fenics_contact.limit_load import LimitLoad, limit_load
from fenics_contact.mesh import BlockMesh
from fenics_contact.scene import (
    EarthPressure,
    EdgeForce,
    JointLaw,
    Load,
    Material,
    Movement,
    OutputOptions,
    Scene,
    SolveOptions,
)
from fenics_contact.sweeps.points import Point
from fenics_contact.sweeps.sweep import Sweep, sweep
from fenics_contact.version import __version__

__all__ = [
    "BlockMesh",
    "ContactError",
    "EarthPressure",
    "EdgeForce",
    "Equilibrium",
    "InputError",
    "JointLaw",
    "LimitLoad",
    "Load",
    "Material",
    "Movement",
    "OutputError",
    "OutputOptions",
    "Point",
    "Scene",
    "SolveOptions",
    "SolverError",
    "Sweep",
    "__version__",
    "equilibrium",
    "limit_load",
    "sweep",
]
