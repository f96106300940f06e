"""The state at a given load factor as data; `equilibrium()` returns one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fenics_contact.results.joint_values import JointValues
from fenics_contact.solvers.problem import Array, State

#: The reason where the rigid-block program has an equilibrium under the dead load, and the elastic
#: structure was not found to have one.
NOT_KNOWN = (
    "no equilibrium was found under the dead load alone, though rigid blocks with associative"
    " friction stand: not known, held by self-stress if at all"
)


@dataclass(frozen=True)
class ServiceState:
    """State at a given load factor.

    Attributes:
        status: "equilibrium" if it is verified. "no_equilibrium" if rigid blocks with associative
            friction prove that there is none, or if joint faces have no elastic state under the
            dead load alone (then `proved` is false); "unstable" if they prove it of the dead
            load alone and that was asked for. Else "not_converged".
        load_factor: As asked for.
        state: State found, in the supports' coordinates; None if there is none.
        joint_values: Forces, openings and slips of the joints; its rates are those of a motion
            along the displacements.
        residuals: What the state misses of equilibrium and joint laws, by name, relative.
        reason: Why there is no verified state, for people.
        fall: With status "unstable" the proof: rigid motions (a, b, c) of the bodies about their
            centres by which they fall, shape (bodies, 3); no joint resists them.
        engine: What found the state: the "path" of elastic blocks from rest, or the forces of their
            "faces", whose blocks are strained by these forces.
    """

    status: str
    load_factor: float
    state: State | None = None
    joint_values: JointValues | None = None
    residuals: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""
    fall: Array | None = None
    engine: str = "path"

    @property
    def proved(self) -> bool:
        """Whether it is known that there is a state, or that there is none."""
        return self.status != "not_converged" and self.reason != NOT_KNOWN
