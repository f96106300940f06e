"""The elastic state of faces under the dead load and a given multiple of the live load.

The load factor is no unknown: min 1/2 x . C x under equilibrium and the cones of Coulomb's law,
without dilatancy. Where one solve does not settle, a part of the friction bound is given and
renewed, as in `limit`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_contact.faces.kernel import Iterate, Program, Tolerances, solve
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.system import Equations

#: Parts of Coulomb's law in the bound that are tried, and steps of each.
PARTS = (1.0, 0.5)
STEPS = 20
#: What ends a solve, and the change of the pressing forces that ends the steps.
SETTLED = Tolerances(1e-7, 1e-9, 1e-6)
CHANGE = 1e-6


def state_under(model: FaceModel, load_factor: float) -> Iterate | None:
    """The state at a load factor; None if none was found."""
    loads = model.dead + load_factor * model.live
    given = replace(model, dead=loads, live=np.zeros_like(loads))
    equations = Equations(given)
    for part in PARTS:
        pressed = np.zeros(model.shape[0])
        for _ in range(STEPS if part < 1.0 else 1):
            program = Program(
                given,
                equations,
                model.strength + (1.0 - part) * model.free_friction * pressed,
                model.dilatancy + part * model.free_friction,
                model.dilatancy,
                elastic=True,
            )
            found = solve(program, tolerances=SETTLED)
            if not found.solved:
                break
            own = np.maximum(model.normal(found.force), 0.0)
            change = float(np.abs(own - pressed).sum())
            pressed = own
            if part == 1.0 or change <= CHANGE * float(own.sum()):
                return replace(found, load_factor=load_factor)
    return None
