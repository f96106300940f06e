"""Other collapse states than the one that is reported, and the lowest of those found.

Collapse states with Coulomb friction are not unique (M.C. Ferris, F. Tin-Loi, Int. J. Mech. Sci. 43
(2001) 209). The face engine goes down from several starts (`faces.lowest`); its states have a
proved gap. None proves that there is no lower one: that is what the bracket is for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from fenics_contact.collapse.face_collapse import MANY_BLOCKS, collapse_of
from fenics_contact.collapse.further import NO_PATH
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.lowest import OPTIONS as SEARCHES
from fenics_contact.faces.lowest import STARTS, lowest_from
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.results.history import CollapseState, Lowest, Peak, alike_as_one
from fenics_contact.results.result import Collapse

#: A state is lower by this part of the load factor's size at least.
LOWER = 2e-3
#: Why nothing is known.
NO_STATE = "the search found no state"
MORE = f"{NO_STATE}; solve.states = 'lowest' tries more starts"
TEARS = "in other states other joints tear"
DEAD_LOAD = "the dead load drives the collapse"
BY_LOAD = "lower states are not looked for where the load is raised step by step"


@dataclass(frozen=True)
class _Found:
    """States by their starts, and why the searches ended early; for all ranks."""

    states: dict[str, FaceState]
    stopped: str


def with_lowest(case: LoadCase, end: Collapse, cost: float) -> Collapse:
    """A collapse with the lowest state found beside it, where several may exist. Collective.

    With `states = "lowest"` more starts are tried, and the lowest state becomes the collapse.
    """
    if end.status != "limit" or end.mode is None or not case.problem.coulomb:
        return end
    for unknown, reason in (
        (end.torn is not None, TEARS),
        (end.path is not None, BY_LOAD),
        (case.problem.dot(case.problem.live, end.mode) < 0.0, DEAD_LOAD),
    ):
        if unknown:
            return replace(end, lowest=Lowest("not_known", reason=reason))
    options = case.discretization.scene.solve
    every = options.states == "lowest"
    if case.block_count >= MANY_BLOCKS and not (every or options.lowest):
        return end  # as dear as the collapse itself
    names = list(STARTS) if every else list(STARTS)[:1]
    faces = PlanarFaces.of(case.discretization, case.sign)
    found = case.problem.comm.bcast(_searched(case, faces, names))
    if found.stopped or not found.states:
        reason = found.stopped or (NO_STATE if every else MORE)
        known = end.states or (end.as_state,)
        return replace(end, lowest=Lowest("not_known", reason=reason), states=known)
    states = sorted(found.states.items(), key=lambda item: item[1].load_factor)
    best = states[0][1]
    lower = best.load_factor < end.load_factor - LOWER * end.size
    told = Lowest(
        "lower" if lower else "none",
        best.load_factor if lower else end.load_factor,
        len(states),
        gap=best.gap if lower else end.as_state.gap,
    )
    others = [CollapseState(name, "limit", one.load_factor, one.gap) for name, one in states]
    known = alike_as_one((*(end.states or (end.as_state,)), *others), end.size)
    if lower and every:
        collapse = collapse_of(case, faces, best, SEARCHES.allowed * SEARCHES.gap)
        peak = Peak("not_known", reason=NO_PATH)
        if collapse.status == "limit":
            end = replace(collapse, attempts=end.attempts, trace=end.trace, peak=peak)
    return replace(end, lowest=told, states=known)


def _searched(case: LoadCase, faces: PlanarFaces, names: list[str]) -> _Found | None:
    """The searches of rank 0."""
    if case.problem.comm.rank != 0:
        return None
    asked = case.discretization.scene.solve.states == "lowest"
    effort = SEARCHES.asked if asked else SEARCHES.usual
    wait = case.discretization.effort.wait
    states: dict[str, FaceState] = {}
    try:
        for name in names:
            search = FaceSearch(faces.model, SEARCHES.gap, effort, wait)
            state = lowest_from(search, STARTS[name])
            if state is not None:
                states[name] = state
    except Stopped as stop:
        return _Found(states, str(stop))
    except SolverError as error:  # faces that do not hold the blocks
        return _Found(states, str(error))
    return _Found(states, "")
