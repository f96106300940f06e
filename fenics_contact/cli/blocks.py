"""What commands ask of scenes of rigid blocks; `meshed` has the same for scenes with a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Any

from fenics_contact.spatial.check import description
from fenics_contact.spatial.limit import limit_load, standing
from fenics_contact.spatial.record import BlockLimitLoad
from fenics_contact.spatial.scene import BlockScene

__all__ = ["checked", "count", "read", "solved", "standing"]


#: A scene from the tables of a file, its folder, and the ranks.
read = BlockScene.of_tables


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
