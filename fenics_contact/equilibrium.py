"""The state of a scene at a given load factor: service loads, and contact without a limit load."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dolfinx import fem

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.collapse.service_state import (
    ServiceState,
    service_state,
    without_equilibrium,
)
from fenics_contact.collapse.stopping import within
from fenics_contact.collapse.strategy import strategy_of
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.layout import Layout
from fenics_contact.errors import InputError, Stopped
from fenics_contact.output.fields import displacement_function
from fenics_contact.results.named_arrays import NamedArrays, block_arrays, joint_arrays, tie_arrays
from fenics_contact.scene.scene import Scene


@dataclass(frozen=True, kw_only=True, repr=False)
class Equilibrium(ServiceState):
    """Result of `equilibrium`, with its fields.

    Attributes:
        layout: Blocks, joints and supports of the scene as arrays.
        factorizations: Numeric factorisations.
    """

    layout: Layout
    factorizations: int

    def __repr__(self) -> str:
        return f"<Equilibrium: {self.status}, load factor {self.load_factor:.8g}>"

    @property
    def joints(self) -> NamedArrays:
        """Arrays over all joint points by name, the same on all ranks; see `joint_arrays`."""
        return joint_arrays(self.layout, self.joint_values)

    @property
    def ties(self) -> NamedArrays:
        """Arrays over the bars of all ties by name, the same on all ranks; see `tie_arrays`."""
        return tie_arrays(self.layout, self.joint_values)

    @property
    def blocks(self) -> NamedArrays:
        """Arrays over all blocks by name, the same on all ranks; see `block_arrays`. Collective."""
        moved = None if self.state is None else self.state.displacement
        return block_arrays(self.layout, moved, None)

    @property
    def displacement(self) -> fem.Function | None:
        """Displacements, m, a dolfinx function; None if there is no state."""
        if self.state is None:
            return None
        values = self.state.displacement
        return displacement_function(self.layout, values, "displacement")


def equilibrium(scene: Scene, load_factor: float = 1.0, steps: int = 1) -> Equilibrium:
    """Find the state of a scene under its dead load and a multiple of its live load.

    With `slip = "stress-free"` friction resists the slip from the stress-free state, and the number
    of steps does not matter. With `slip = "load-steps"` it resists the slip of each step, the dead
    load being the first.

    Args:
        scene: What to solve.
        load_factor: Multiple of the live load.
        steps: Equal steps of the live load; they are halved where no state is found.

    Returns:
        The state; look at its status.

    Raises:
        InputError: If joints, supports or loads of the scene do not fit its mesh, the load factor
            is not finite, or there is no step.
    """
    _check(scene, load_factor, steps)
    strategy = strategy_of(scene)
    sign = math.copysign(1.0, load_factor)
    with Discretization(scene) as made:
        blocks = RigidBlocks.of(made.original, sign, made.effort.wait)
        proved = without_equilibrium(blocks, abs(load_factor), sign)
        if proved is not None:
            return Equilibrium(**vars(proved), layout=made.layout, factorizations=0)
        made.end_when(within(scene.solve.time))
        try:
            bonded = made.bonded(strategy.kind)
            case = LoadCase.of(made, bonded, sign, strategy.kind, lambda step: None)
            found = service_state(case, strategy, scene.solve, abs(load_factor), steps)
        except Stopped as stop:
            found = ServiceState("not_converged", load_factor, reason=str(stop))
        count = made.factorizations()
    return Equilibrium(**vars(found), layout=made.layout, factorizations=count)


def _check(scene: Scene, load_factor: float, steps: int) -> None:
    """Raise `InputError` for what `equilibrium` cannot be asked."""
    if not math.isfinite(load_factor):
        raise InputError(f"load_factor = {load_factor} must be finite")
    if steps < 1:
        raise InputError(f"steps = {steps} must be 1 or more")
    if any(law.loses for law in (*scene.joints.values(), *scene.foundations.values())):
        raise InputError("equilibrium() knows no opened = 'lost'; give joints opened = 'kept'")
