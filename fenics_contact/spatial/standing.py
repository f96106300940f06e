"""Whether loads in space have a state: forces inside the laws, or a motion that proves none.

Forces that contacts carry with any self-stress need not be those of a state from rest: a stone
between two upright walls is held by nothing. So an elastic state with Coulomb's law is asked for,
as in the plane (`collapse.service_state`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.follow import state_at
from fenics_contact.faces.kernel import FaceIterate
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.programs import motion_under, state_alone, state_under, widest_motion
from fenics_contact.geometry.mesh import Array
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.results.history import Trial
from fenics_contact.results.result import NOT_KNOWN, Collapse
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.certificate import held_against
from fenics_contact.spatial.result import named
from fenics_contact.spatial.structure import Structure

#: That a movement of the ground is not in a state.
UNMOVED = "not with the ground moved: no such state was found"


@lru_cache(maxsize=1)
def state_of(structure: Structure, load_factor: float = 0.0) -> Collapse:
    """The state under the dead load and a multiple of the live load, or why there is none.

    The status is "equilibrium", "unstable" where a motion proves that there is none,
    "no_equilibrium" where none was found, or "not_converged" if it misses a condition.

    Raises:
        InputError: If clarabel is missing, and the state crushes.
    """
    model = structure.face_model()
    tried = Trial("forces of the contacts", np.nan, "no state", False, 0, 0.0)
    nothing = Collapse(given=load_factor, attempts=(tried,))
    if fall := falling(structure, model, load_factor):
        return _fallen(structure, nothing, fall, "")
    elastic = structure.strained_model(model) or model
    # Ground as it moves; as drawn, if there is no state else. What only the live load holds falls.
    models = [(elastic, "")]
    if elastic.offset is not None:
        models.append((replace(elastic, offset=None), UNMOVED))
    state, told = _from_rest(models, 0.0)
    if state is not None and load_factor:
        path = _along_path(structure, load_factor)
        state, told = (path, "") if path else _from_rest(models, load_factor)
    if state is None:
        return replace(nothing, status="no_equilibrium", reason=NOT_KNOWN)
    nothing = replace(
        nothing, attempts=(replace(tried, outcome=f"a state with gap {state.gap:.1e}", found=True),)
    )
    found = held_against(structure, nothing, state.force)
    if found.status == "equilibrium":
        found = replace(found, reason=told)
    law = structure.pressed
    if law is not None and found.certificate and law.key in found.certificate.failures:
        with suppress(SolverError):
            loads = structure.generalised(structure.dead + load_factor * structure.live)
            given = model.dead - structure.generalised(structure.dead)
            whole = replace(model, dead=given, live=loads)
            part, force, motion = law.part(whole, structure.given_force)
            if part < 1.0 - SEARCH.verified:
                return _fallen(structure, nothing, _numbers(structure, motion), " by crushing")
            return held_against(structure, nothing, force)
    return found


def _along_path(structure: Structure, load_factor: float) -> FaceIterate | None:
    """The state of the loading path where it first comes to a load factor; None if it does not."""
    sign = math.copysign(1.0, load_factor)
    model = structure.face_model(sign)
    if model.has_many_blocks or not np.any(model.live):
        return None
    return state_at(structure.strained_model(model, sign) or model, abs(load_factor))


def _from_rest(
    models: Sequence[tuple[FaceModel, str]], load_factor: float
) -> tuple[FaceIterate | None, str]:
    """The state under loads from rest of the first model that has one, and what is told of it."""
    for model, told in models:
        if state := state_under(model, load_factor):
            return state, told
    return None, ""


def _fallen(structure: Structure, found: Collapse, fall: tuple[int, ...], does: str) -> Collapse:
    """That blocks fall; a proof only where all of the geometry is understood."""
    blocks = f"{named(structure, fall, 'fall')}{does}"
    if structure.doubts:
        reason = f"{blocks}, unless what is not understood holds: {'; '.join(structure.doubts)}"
        return replace(found, status="no_equilibrium", reason=reason)
    loads = "these loads" if found.given else "the dead load alone"
    reason = f"there is no equilibrium under {loads}: {blocks}"
    return replace(found, status="unstable", reason=reason, falling=fall)


def falling(structure: Structure, model: FaceModel, load_factor: float = 0.0) -> tuple[int, ...]:
    """Numbers of the blocks that fall under the dead load and some live load; none if they stand.

    The motion opens all contacts and the loads do work in it: no forces inside the cones resist.
    Blocks that neither contacts nor ties join to the ground fall as they are.
    """
    count = len(structure.blocks)
    ends = np.column_stack([block for _, block, _ in structure.ends])
    held = np.where(np.append(structure.number, -1) < 0, count, np.arange(count + 1))[ends]
    parts = connected(held, count + 1)
    loose = (parts[:count] != parts[count]) & (structure.number >= 0)
    motion = None if np.any(loose) else motion_under(model, load_factor)
    if motion is None and not np.any(loose):
        return ()
    widest = widest_motion(model, load_factor)
    motion = motion if widest is None else widest
    named = () if motion is None else _numbers(structure, motion)
    return tuple(sorted({*named, *np.flatnonzero(loose).tolist()}))


def wedged_blocks(
    structure: Structure, model: FaceModel, stressed: bool = False
) -> tuple[int, ...]:
    """Numbers of blocks that wedge where contacts carry the live load alone, of any size.

    They do so from rest, or where they are `stressed` with any forces inside the cones.
    """
    closes = structure.limited[structure.points.contact][:: structure.pressing]
    limited = np.append(closes, np.zeros(len(structure.bars)))
    dilatancy = model.friction if stressed else model.dilatancy
    state = state_alone(replace(model, kappa=model.kappa + limited, dilatancy=dilatancy))
    if state is None:
        return ()
    force = np.linalg.norm(state.force, axis=1)[: np.count_nonzero(~closes)]
    size = np.zeros(len(structure.blocks))
    for _, block, _ in structure.ends:
        of_faces = block[: len(structure.points.area) : structure.pressing]
        np.maximum.at(size, of_faces[~closes], force)
    return _numbers(structure, size[structure.number >= 0])


def _numbers(structure: Structure, size: Array) -> tuple[int, ...]:
    """Numbers of the moving blocks that have what is not small, of any number of components."""
    moving = np.count_nonzero(structure.number >= 0)
    size = np.linalg.norm(size.reshape(moving, -1), axis=1)
    slight = SEARCH.slight * size.max(initial=0.0)
    return tuple(np.flatnonzero(structure.number >= 0)[size > slight].tolist())
