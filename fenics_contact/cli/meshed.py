"""What commands ask of scenes with a mesh; `blocks` has the same for rigid blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Any

from fenics_contact.console import description
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.equilibrium import standing
from fenics_contact.limit_load import LimitLoad, limit_load
from fenics_contact.scene.scene import Scene

__all__ = ["checked", "count", "read", "solved", "standing"]


#: A scene from the tables of a file, its folder, and the ranks.
read = Scene.of_tables


def count(scene: Scene) -> int:
    """Number of its blocks."""
    return scene.mesh.body_count


def checked(scene: Scene, verbose: bool) -> tuple[str, Sequence[str]]:
    """What is in it, and warnings."""
    with Discretization(scene) as discretization:
        discretization.check_pushed()
        return description(discretization, verbose), discretization.warnings


def solved(scene: Scene, monitor: Any, stop: Callable[[], str], beside: Executor) -> LimitLoad:
    """Its limit load, with the capacity curve that it asks for, held against brackets."""
    result = limit_load(scene, monitor, stop=stop, beside=beside)
    if scene.output.capacity and not result.stopped:
        result = result.with_capacity(monitor, stop=stop)
    return result.hold_against_brackets()
