"""What commands ask of scenes of rigid blocks; `meshed` has the same for scenes with a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from importlib.util import find_spec
from typing import Any

import numpy as np

from fenics_contact.requirements import missing_requirements
from fenics_contact.spatial.check import description
from fenics_contact.spatial.crushing import NO_CLARABEL
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
    """What is in it, and warnings; with what `solve` would refuse."""
    structure = scene.structure()
    stresses = missing_requirements(key=scene.strained) if scene.strained else ""
    crushes = scene.dimension == 3 and np.any(structure.limited)
    lacking = NO_CLARABEL if crushes and find_spec("clarabel") is None else ""
    return description(scene, structure), [*structure.warnings, *filter(None, (stresses, lacking))]


def solved(
    scene: BlockScene, monitor: Any, stop: Callable[[], str], beside: Executor
) -> BlockLimitLoad:
    """Its limit load."""
    return limit_load(scene, monitor, stop=stop, beside=beside)
