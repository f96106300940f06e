"""What is said of a collapse beside its load factor: the peak of its path.

Each has a hard limit on its cost, in units of that of the collapse. Where a run is stopped, what
was found before stays, and the rest is not known.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.load_control import OPTIONS as RISING
from fenics_contact.collapse.load_control import raised_path
from fenics_contact.collapse.peak import (
    ABOVE,
    CLIMB,
    NOT_ASKED,
    TOO_DEAR,
    Above,
    Limits,
    find_peak,
    peak_of,
)
from fenics_contact.collapse.service_state import service_state
from fenics_contact.collapse.strategy import strategy_of
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.results.history import Peak
from fenics_contact.results.result import Collapse

_log = logging.getLogger("fenics_contact")

#: Why something is not known.
NOT_REACHED = "a load that rises step by step does not reach the collapse"
FAST = "solve.fast = true leaves it out"
NO_PATH = "the loading path was not followed to its end"
TEARS = "what joints carry before they tear depends on the way of the load"


def with_peak(case: LoadCase, end: Collapse, cost: float) -> Collapse:
    """A collapse with the peak of the path to it, as far as the scene asks for it."""
    options = case.discretization.scene.solve
    if options.peak:
        return with_peak_at_any_cost(case, end, cost)

    def search(above: Above) -> Peak:
        if options.fast or options.peak is False:
            return Peak("not_known", reason=FAST if options.fast else NOT_ASKED)
        return _searched(case, above, Limits.usual(cost, case.block_count))

    return _with_peak(case, end, search)


def with_peak_at_any_cost(case: LoadCase, end: Collapse, cost: float) -> Collapse:
    """A collapse with the peak of the path to it, with hundreds of factorisations if need be."""
    limits = Limits.asked(cost)

    def search(above: Above) -> Peak:
        found = _searched(case, above, limits)
        if found.status == "found":
            return _beyond(case.unrecorded, above, found)
        return _raised(case.unrecorded, above, found, limits)

    return _with_peak(case, end, search)


def _with_peak(case: LoadCase, end: Collapse, search: Callable[[Above], Peak]) -> Collapse:
    """A collapse with the peak that a search finds above it, where there may be one to find."""
    if end.status != "limit" or end.state is None or not case.problem.coulomb:
        return end
    above = Above(end.load_factor, end.size, end.state.work)
    return replace(end, peak=_peak(end, above, search))


def _peak(end: Collapse, above: Above, search: Callable[[Above], Peak]) -> Peak:
    """The peak of the path to a collapse, or why it is not known."""
    if end.engine == "faces":
        return Peak("not_known", reason=NO_PATH)
    if end.torn is not None:
        return Peak("not_known", reason=TEARS)
    if end.path is not None:
        return peak_of(end.path, above)
    try:
        return search(above)
    except Stopped as stop:
        return Peak("not_known", reason=str(stop))


def _searched(case: LoadCase, above: Above, limits: Limits) -> Peak:
    """The peak as `find_peak` finds it."""
    tolerance = case.discretization.scene.solve.tolerance
    return find_peak(case.unrecorded, above, tolerance, limits, case.record.rise_on_modes)


def _beyond(case: LoadCase, above: Above, found: Peak) -> Peak:
    """A peak with the next load factor, if `equilibrium()` finds no state there either.

    Its search is taken to its end, which may cost as much as a load that rises to a collapse.
    """
    target = found.load_factor + CLIMB.beyond * above.size
    effort = case.discretization.effort
    with effort.at_most(RISING.cost):
        state = service_state(case, target)
        tried = state.status != "equilibrium" and effort.left >= 1.0
    return replace(found, not_found_at=target) if tried else found


def _raised(case: LoadCase, above: Above, before: Peak, limits: Limits) -> Peak:
    """The peak of a load that rises step by step, where another search has not found one.

    The block modes that it follows do not have every peak of the structure. This costs hundreds of
    factorisations.
    """
    scene = case.discretization.scene
    with case.discretization.effort.at_most(limits.found):
        try:
            path = raised_path(case, strategy_of(scene), scene.solve)
        except SolverError as error:
            return replace(before, status="not_known", reason=str(error))
    found = peak_of(path, above)
    if found.status == "none" and not above(path.upper) <= ABOVE:
        return Peak("not_known", reason=TOO_DEAR)  # more may be carried
    if found.status == "none" and above(path.lower) < -ABOVE:
        return Peak("not_known", reason=NOT_REACHED)
    return found
