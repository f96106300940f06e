"""What commands ask of scenes of rigid blocks; `meshed` has the same for scenes with a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fenics_contact.spatial.check import description
from fenics_contact.spatial.limit import limit_load, standing
from fenics_contact.spatial.record import BlockLimitLoad
from fenics_contact.spatial.scene import BlockScene

__all__ = ["checked", "count", "read", "solved", "standing"]


def read(tables: dict[str, Any], folder: Path, comm: MPI.Comm) -> BlockScene:
    """A scene from the tables of a file in a folder."""
    return BlockScene.from_tables(tables, folder)


def count(scene: BlockScene) -> int:
    """Number of its blocks."""
    return len(scene.blocks)


def checked(scene: BlockScene, verbose: bool) -> tuple[str, Sequence[str]]:
    """What is in it, and warnings."""
    structure = scene.structure()
    return description(scene, structure), structure.warnings


def solved(
    scene: BlockScene, monitor: Any, stop: Callable[[], str], beside: Executor
) -> BlockLimitLoad:
    """Its limit load."""
    return limit_load(scene, monitor, stop=stop, beside=beside)
