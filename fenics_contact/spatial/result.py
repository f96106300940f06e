"""What is known of a structure in space once its limit load was looked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.spatial.structure import Structure


@dataclass(frozen=True)
class SpatialCollapse:
    """The limit of one direction of the live load.

    Attributes:
        status: "limit", "unbounded", "unstable" or "not_converged".
        load_factor: That of a state inside all laws; nan without one.
        gap: Proved distance to what its own friction forces allow, relative.
        upper: Nothing carries more with any friction forces; infinite where nothing is known.
        mode: Motions of all blocks in the collapse: velocities of centroids and rotations, shape
            (blocks, 6), scaled to a largest velocity of 1; None without a limit.
        force: Forces of the points along their contact's axes, N, shape (points, 3).
        lowest: Load factor of the lowest collapse state found; nan where none was looked for.
        sign: Of the live load.
        reason: Why there is no limit.
        falling: Numbers of blocks that fall or are wedged, where there is none.
    """

    status: str
    load_factor: float = np.nan
    gap: float = np.nan
    upper: float = np.inf
    mode: Array | None = None
    force: Array | None = None
    lowest: float = np.nan
    sign: float = 1.0
    reason: str = ""
    falling: tuple[int, ...] = ()


@dataclass(frozen=True)
class SpatialLimit:
    """Limit loads of a structure in space.

    Attributes:
        scene: What was asked for.
        structure: Its blocks, contacts and loads.
        directions: By "positive" and "negative".
        factorizations: Of face systems.
        seconds: By what they were spent on.
    """

    scene: Any
    structure: Structure
    directions: dict[str, SpatialCollapse]
    factorizations: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def collapse(self) -> SpatialCollapse:
        """The first direction's."""
        return next(iter(self.directions.values()))

    @property
    def status(self) -> str:
        """The first direction's."""
        return self.collapse.status

    @property
    def load_factor(self) -> float:
        """The first direction's."""
        return self.collapse.load_factor
