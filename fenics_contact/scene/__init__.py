"""What the user describes: materials, joint laws, loads, options."""

from fenics_contact.scene.scene import (
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

__all__ = [
    "EarthPressure",
    "EdgeForce",
    "JointLaw",
    "Load",
    "Material",
    "Movement",
    "OutputOptions",
    "Scene",
    "SolveOptions",
]
