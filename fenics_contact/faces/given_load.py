"""The elastic state of faces under the dead load and a given multiple of the live load.

The load factor is no unknown: min 1/2 x . C x under equilibrium and the cones of Coulomb's law,
without dilatancy. Where that stalls, the loads are asked for a multiple of them that does a work.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.kernel import Iterate, Program, Tolerances, elastic_response, solve
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.system import Equations

#: What ends a solve, and the relative gap up to which it answers where it stalls before (motions:
#: ten times the error).
SETTLED = Tolerances(1e-7, 1e-9, 1e-6)
ROUGH = 1e-2
#: Least load factor at which a load does the work that it does on closed faces at a factor of 1.
LEAST = 1e-4


def state_under(model: FaceModel, load_factor: float) -> Iterate | None:
    """The state at a load factor; None if none was found.

    It is in equilibrium and within friction. Where its gap is not zero, some joints slip, or open,
    by a little more than their forces allow.
    """
    loads = model.dead + load_factor * model.live
    given = replace(model, dead=loads, live=np.zeros_like(loads))
    try:
        found = _state(given, Equations(given), 1.0) or _by_work(given)
    except SolverError:  # faces do not hold the blocks
        return None
    return None if found is None else replace(found, load_factor=load_factor)


def _by_work(model: FaceModel) -> Iterate | None:
    """The state under the dead load as a part of that in which this load does some work.

    Without given strengths all conditions are homogeneous. Where the load does that work with a
    factor of 0, blocks move as a mechanism, which says nothing.
    """
    if np.any(model.strength) or np.any(model.crushing) or not np.any(model.dead):
        return None
    alone = replace(model, dead=np.zeros_like(model.dead), live=model.dead)
    equations = Equations(alone)
    work = elastic_response(alone, equations).work
    found = _state(alone, equations, work)
    if found is None or found.load_factor < LEAST:
        return None
    part = found.load_factor
    return replace(found, motion=found.motion / part, force=found.force / part)


def _state(model: FaceModel, equations: Equations, work: float) -> Iterate | None:
    """The elastic state in which the live load, if there is one, does some work."""
    laws = model.strength, model.friction, model.dilatancy
    found = solve(Program(model, equations, *laws, work, elastic=True), tolerances=SETTLED)
    near = found.within(ROUGH, SETTLED.equilibrium, 10.0 * SETTLED.motion)
    return found if near else None


def stiffness_alone(model: FaceModel) -> float | None:
    """How stiff faces are against the live load alone, of any size; None without such a state.

    In units of the stiffness with all faces closed. Far along the live load, the dead load, given
    strengths and faces that crush are nothing beside it: all conditions are homogeneous, and every
    multiple of a state is one.
    """
    kept = model.crushing == 0.0
    alone = replace(
        model,
        motion=model.motion[np.repeat(kept, model.shape[1])],
        dead=np.zeros_like(model.dead),
        strength=np.zeros(int(kept.sum())),
        friction=model.friction[kept],
        dilatancy=model.dilatancy[kept],
        compliance=model.compliance[kept],
        crushing=model.crushing[kept],
    )
    found = state_under(alone, 1.0)
    if found is None:
        return None
    moved = float(model.live @ found.motion)
    return elastic_response(model, Equations(model)).work / moved if moved > 0.0 else None
