"""Programs with associative friction: upper ends, and loads that crush what they rest on.

With dilatancy F slip is normal to Coulomb's cone and the program is convex: its mode v opens by
F |v_T| at least, so that nothing carries more than c . |v_T| + sigma - f_D . v (D.C. Drucker, J.
Appl. Mech. 21 (1954) 71).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_contact.faces.cones import Array
from fenics_contact.faces.kernel import Iterate, Program, solve
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.system import Equations

#: Relative error of equilibrium above which there is none.
NO_EQUILIBRIUM = 1e-7
#: By how much a mode may close, in units of its largest relative motion.
CLOSING = 1e-6
#: Searches at most.
SEARCHES = 4


def associative_state(model: FaceModel, equations: Equations) -> Iterate:
    """The state of the largest load factor."""
    friction = model.friction
    return solve(Program(model, equations, model.strength, friction, friction))


def associative_end(model: FaceModel) -> float | None:
    """A load factor that nothing exceeds, by the mode of that state; None if none was found.

    A search that comes to no end is made again from the live load that it has reached.
    """
    loaded = model
    for _ in range(SEARCHES):
        found = associative_state(loaded, Equations(loaded))
        work = float(model.live @ found.motion)
        if found.missing <= NO_EQUILIBRIUM and work > 0.0:
            mode = found.motion / work
            power = replace(model, dilatancy=model.friction).power(mode)
            opens = power.closing.max(initial=0.0) <= CLOSING * np.abs(model.relative(mode)).max()
            return power.bound(model.strength) if opens else None
        loaded = replace(loaded, dead=loaded.dead + found.load_factor * loaded.live)
    return None


def crushed_by(model: FaceModel, load_factor: float) -> Array | None:
    """Motion by which dead load and a multiple of the live load crush faces; None if they stand.

    The largest part of these loads that has an equilibrium is looked for.
    """
    loads = model.dead + load_factor * model.live
    whole = replace(model, dead=np.zeros_like(loads), live=loads, dilatancy=model.friction)
    if not np.any(loads):
        return None

    def enough(iterate: Iterate) -> bool:
        return iterate.load_factor >= 1.0 and iterate.missing < 1e-9

    program = Program(whole, Equations(whole), model.strength, model.friction, model.friction)
    found = solve(program, enough=enough)
    work = float(loads @ found.motion)
    if enough(found) or work <= 0.0:
        return None
    motion = found.motion / work
    return motion if whole.power(motion).bound(model.strength) < 1.0 else None
