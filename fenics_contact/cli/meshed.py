"""What commands ask of scenes with a mesh; `blocks` has the same for rigid blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fenics_contact.console import description
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.equilibrium import standing
from fenics_contact.geometry.mesh import BlockMesh
from fenics_contact.limit_load import LimitLoad, limit_load
from fenics_contact.scene.scene import Scene

__all__ = ["checked", "count", "read", "solved", "standing"]


def read(tables: dict[str, Any], folder: Path, comm: MPI.Comm) -> Scene:
    """A scene from the tables of a file in a folder."""
    return Scene.from_tables(
        tables, lambda file, blocks: BlockMesh.from_file(folder / file, comm, blocks)
    )


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
