"""Which engine finds a collapse: the loading path of elastic blocks, or the forces of their faces.

The path starts without stress and ends in an exact state. Below 100 blocks it is the answer. Where
joints have a compressive strength, from 100 blocks on unless it soon comes to its end, and where it
comes to none, the face engine is: its state has a proved gap, and self-stress is free in it. From
100 blocks on the engine is asked first, so that there is a state whenever the run is stopped.
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace

from fenics_contact.collapse.face_collapse import begun_search, face_collapse
from fenics_contact.collapse.followed_path import FOLLOW
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.load_control import raise_load
from fenics_contact.collapse.strategy import strategy_of
from fenics_contact.collapse.work_control import find_collapse, growth
from fenics_contact.errors import Stopped
from fenics_contact.results.history import alike_as_one
from fenics_contact.results.result import Collapse
from fenics_contact.search_options import SEARCH
from fenics_contact.workers import InPlace

_log = logging.getLogger("fenics_contact")


def collapse_by_engine(case: LoadCase) -> Collapse:
    """The collapse of a load case by the engine that its scene asks for, or that fits it.

    Raises:
        Stopped: If the run is to end; the record of the load case has what was found.
    """
    options = case.discretization.scene.solve
    effort = case.discretization.effort
    strategy = strategy_of(case.discretization.scene)
    limited = case.blocks.has_strength
    many = case.block_count >= SEARCH.large_wall
    follow = options.engine == "follow"
    by_faces = options.engine == "faces" or (follow and many)
    if by_faces or (limited and options.engine != "path"):
        return _unless_unlimited(case, face_collapse(case))
    if follow:
        return _followed(case)
    if options.control == "load":
        return raise_load(case)
    if options.engine == "path" or options.method != "auto":
        return find_collapse(case, strategy, options.tolerance)
    wanted = many and not options.fast and options.lowest is not False
    search = begun_search(case) if wanted else None
    in_place = isinstance(case.beside, InPlace)
    found = face_collapse(case, search) if search is not None and in_place else None
    limited = found is not None and found.status == "limit"
    if limited:
        case.record.best = found
    # Where a limit is known, or looked for beside, no program is asked whether there is one.
    asking = replace(strategy, asks=strategy.asks and not limited and (search is None or in_place))
    try:
        with effort.at_most(SEARCH.soon if many else math.inf):
            end = find_collapse(case, asking, options.tolerance)
    except Stopped:
        if search is not None and found is None and search.done():
            case.record.best = face_collapse(case, search)
        raise
    if search is not None and found is None:
        found = face_collapse(case, search)
        if found.status != "limit" and end.status == "not_converged":
            with effort.at_most(SEARCH.soon):
                end = find_collapse(case, strategy, options.tolerance)
    least = -options.tolerance * case.scales.load_factor
    # The dead load alone stands: what needs the live load to stand is another state.
    lost = end.status == "not_converged" or end.load_factor < least
    if end.status == "limit" and not lost and found is not None and found.status == "limit":
        return replace(end, states=alike_as_one((end.as_state, found.as_state), end.size))
    if not lost:
        return end
    if end.status == "limit" and found is None:
        case.record.best = None
    if not many and case.problem.coulomb:
        followed = _followed(case)
        if followed.status == "limit" and followed.load_factor >= least:
            return followed
    _log.info("  the path comes to no end; the forces of the faces are the answer")
    found = _unless_unlimited(case, found or face_collapse(case))
    if found.status != "not_converged" and found.load_factor >= least:
        return replace(found, history=end.history)
    if not many and case.has_dead_load:
        with effort.at_most(strategy.options.collapse_cost):  # the dearest way, at last
            raised = raise_load(case)
        if raised.status == "limit" and raised.load_factor >= least:
            return raised
    reason = "; ".join(filter(None, [end.reason, found.reason]))
    return replace(end, status="not_converged", reason=reason)


def _followed(case: LoadCase) -> Collapse:
    """The collapse at the end of the path as the kernel of faces follows it."""
    end = find_collapse(case, FOLLOW, case.discretization.scene.solve.tolerance)
    return replace(end, way="follow")


def _unless_unlimited(case: LoadCase, end: Collapse) -> Collapse:
    """A collapse by the face engine, or that nothing limits the load where it came to none."""
    if end.status == "limit" or growth(case) is None:
        return end
    nothing = Collapse("unbounded", math.inf, case.blocks.bounds, engine="faces")
    return replace(nothing, wedging=case.blocks.wedging())
