"""Limit loads of systems of blocks with unilateral contact and Coulomb friction.

Names are imported when they are first used: the command line answers `--help` without dolfinx,
and what needs it says what to install.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from fenics_contact.errors import ContactError, InputError, OutputError, SolverError
from fenics_contact.requirements import check_requirements
from fenics_contact.version import __version__

if TYPE_CHECKING:
    from fenics_contact.answers.seismic import SeismicCheck
    from fenics_contact.equilibrium import Equilibrium, equilibrium, stands
    from fenics_contact.geometry.mesh import BlockMesh
    from fenics_contact.limit_load import LimitLoad, limit_load
    from fenics_contact.scene.scene import (
        EarthPressure,
        EdgeForce,
        Floor,
        JointLaw,
        Load,
        Material,
        Movement,
        OutputOptions,
        Scene,
        Seismic,
        Soil,
        SolveOptions,
        Tie,
    )
    from fenics_contact.sweeps.mechanisms import Mechanism, Mechanisms, mechanisms
    from fenics_contact.sweeps.points import Point
    from fenics_contact.sweeps.sweep import Sweep, sweep

__all__ = [
    "BlockMesh",
    "ContactError",
    "EarthPressure",
    "EdgeForce",
    "Equilibrium",
    "Floor",
    "InputError",
    "JointLaw",
    "LimitLoad",
    "Load",
    "Material",
    "Mechanism",
    "Mechanisms",
    "Movement",
    "OutputError",
    "OutputOptions",
    "Point",
    "Scene",
    "Seismic",
    "SeismicCheck",
    "Soil",
    "SolveOptions",
    "SolverError",
    "Sweep",
    "Tie",
    "__version__",
    "equilibrium",
    "limit_load",
    "mechanisms",
    "stands",
    "sweep",
]

#: Modules that have the names above, but those of the scene and of exceptions.
_HOMES = dict.fromkeys(set(__all__) - set(globals()), "scene.scene") | {
    "BlockMesh": "geometry.mesh",
    "Equilibrium": "equilibrium",
    "LimitLoad": "limit_load",
    "Mechanism": "sweeps.mechanisms",
    "Mechanisms": "sweeps.mechanisms",
    "Point": "sweeps.points",
    "SeismicCheck": "answers.seismic",
    "Sweep": "sweeps.sweep",
    "equilibrium": "equilibrium",
    "limit_load": "limit_load",
    "mechanisms": "sweeps.mechanisms",
    "stands": "equilibrium",
    "sweep": "sweeps.sweep",
}


class _Face(ModuleType):
    """This package, in which a function goes before the module of the same name."""

    def __getattr__(self, name: str) -> Any:
        if name not in _HOMES:
            raise AttributeError(f"module 'fenics_contact' has no attribute '{name}'")
        check_requirements(mesh=False)
        found = getattr(import_module(f"fenics_contact.{_HOMES[name]}"), name)
        setattr(self, name, found)
        return found

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *_HOMES})

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
