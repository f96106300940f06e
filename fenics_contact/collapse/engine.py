"""Which engine finds a collapse: a table, from the first row that applies and answers.

The path starts without stress and ends in an exact state. Below 100 blocks it is the answer. Where
joints have a compressive strength, from 100 blocks on unless it soon comes to its end, and where it
comes to none, the face engine is: its state has a proved gap, and self-stress is free in it. From
100 blocks on the engine is asked first, so that there is a state whenever the run is stopped.
"""

from __future__ import annotations

import logging
import math
from concurrent.futures import Future
from dataclasses import replace

from fenics_contact.collapse.face_collapse import Searched, begun_search, face_collapse
from fenics_contact.collapse.followed_path import FOLLOW
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.load_control import raise_load
from fenics_contact.collapse.strategy import strategy_of
from fenics_contact.collapse.work_control import find_collapse, growth
from fenics_contact.errors import Stopped
from fenics_contact.faces.limit import SearchWay, applicable
from fenics_contact.results.history import alike_as_one
from fenics_contact.results.result import Collapse
from fenics_contact.search_options import SEARCH
from fenics_contact.workers import InPlace

_log = logging.getLogger("fenics_contact")

FEW = f"it is asked below {SEARCH.large_wall} blocks"


class Run:
    """The search for one collapse: the facts that decide on engines, and what these found.

    Attributes:
        asked: Name of the engine that alone is asked; empty for all that apply.
        end: Of the path.
        search: By the face engine, begun beside the path.
        found: By the face engine.
        answered: Which engine has answered, in words; empty while none has.
    """

    def __init__(self, case: LoadCase) -> None:
        """Take the facts of a load case."""
        self.case = case
        self.options = case.discretization.scene.solve
        self.effort = case.discretization.effort
        self.strategy = strategy_of(case.discretization.scene)
        self.many = case.block_count >= SEARCH.large_wall
        # The dead load alone stands: what needs the live load to stand is another state.
        self.least = -self.options.tolerance * case.scales.load_factor
        self.asked = self._asked()
        self.end: Collapse | None = None
        self.search: Future[Searched] | None = None
        self.found: Collapse | None = None
        self.answered = ""

    def _asked(self) -> str:
        asked = self.options.engine
        if asked == "follow":
            asked = "faces" if self.many else "follow"
        if self.case.blocks.has_strength and asked != "path":
            asked = "faces"
        if asked in ("auto", "path") and self.options.control == "load":
            return "rising load"
        return asked if asked != "auto" else "path" * (self.options.method != "auto")

    def refusal(self, engine: SearchWay) -> str:
        """Why an engine is not asked; empty where it is."""
        alone = f"{self.asked} alone is asked for" * (engine.name != self.asked)
        return (alone if self.asked else engine.refuses(self)) or self.answered

    def is_answer(self, end: Collapse) -> bool:
        """Whether no other engine need be asked."""
        lost = end.status == "not_converged" or end.load_factor < self.least
        return bool(self.asked) or not lost


def collapse_by_engine(case: LoadCase) -> Collapse:
    """The collapse of a load case by the engine that its scene asks for, or that fits it.

    Raises:
        Stopped: If the run is to end; the record of the load case has what was found.
    """
    run = Run(case)
    reasons = []
    for engine in applicable(ENGINES, run.refusal, "engine "):
        end: Collapse = engine.goes(run)
        _log.info("  engine %s: %s %.6g", engine.name, end.status, end.load_factor)
        reasons.append(end.reason)
        if run.is_answer(end):
            run.answered = f"{engine.name} has answered"
    if run.answered:
        return end
    reason = "; ".join(filter(None, dict.fromkeys(reasons)))
    return replace(run.end or end, status="not_converged", reason=reason)


def _by_path(run: Run) -> Collapse:
    """The end of the loading path; from 100 blocks on, with that of the face engine beside it."""
    case, options, strategy = run.case, run.options, run.strategy
    if run.asked:
        return find_collapse(case, strategy, options.tolerance)
    wanted = run.many and not options.fast and options.lowest is not False
    search = run.search = begun_search(case) if wanted else None
    in_place = isinstance(case.beside, InPlace)
    found = face_collapse(case, search) if search is not None and in_place else None
    limited = found is not None and found.status == "limit"
    if limited:
        case.record.best = found
    # Where a limit is known, or looked for beside, no program is asked whether there is one.
    asking = replace(strategy, asks=strategy.asks and not limited and (search is None or in_place))
    try:
        with run.effort.at_most(SEARCH.soon if run.many else math.inf):
            end = find_collapse(case, asking, options.tolerance)
    except Stopped:
        if search is not None and found is None and search.done():
            case.record.best = face_collapse(case, search)
        raise
    if search is not None and found is None:
        found = face_collapse(case, search)
        if found.status != "limit" and end.status == "not_converged":
            with run.effort.at_most(SEARCH.soon):
                end = find_collapse(case, strategy, options.tolerance)
    run.end, run.found = end, found
    if end.status == "limit" and not run.is_answer(end) and found is None:
        case.record.best = None
    if end.status != "limit" or found is None or found.status != "limit":
        return end
    return replace(end, states=alike_as_one((end.as_state, found.as_state), end.size))


def _followed(run: Run) -> Collapse:
    """The collapse at the end of the path as the kernel of faces follows it."""
    end = find_collapse(run.case, FOLLOW, run.options.tolerance)
    return _limit_alone(run, replace(end, way="follow"))


def _limit_alone(run: Run, end: Collapse) -> Collapse:
    """A limit; where it is none and others are asked, too, what it says is of no account."""
    if run.asked or end.status == "limit":
        return end
    return Collapse("not_converged", math.nan, run.case.blocks.bounds)


def _by_faces(run: Run) -> Collapse:
    """The collapse by the face engine, or that nothing limits the load where it came to none."""
    case = run.case
    end = run.found or face_collapse(case)
    if end.status != "limit" and growth(case) is not None:
        end = Collapse("unbounded", math.inf, case.blocks.bounds, engine="faces")
        end = replace(end, wedging=case.blocks.wedging())
    return end if run.end is None else replace(end, history=run.end.history)


def _by_rising_load(run: Run) -> Collapse:
    """The collapse under a load that rises step by step: the dearest way."""
    if run.asked:
        return raise_load(run.case)
    with run.effort.at_most(run.strategy.options.collapse_cost):
        return _limit_alone(run, raise_load(run.case))


def _refuses_follow(run: Run) -> str:
    return FEW if run.many else "" if run.case.problem.coulomb else "it is of Coulomb's law"


def _refuses_rising_load(run: Run) -> str:
    return FEW if run.many else "" if run.case.has_dead_load else "it needs a dead load"


#: All engines, in the order in which they are asked.
ENGINES = (
    SearchWay("path", lambda run: "", _by_path),
    SearchWay("follow", _refuses_follow, _followed),
    SearchWay("faces", lambda run: "", _by_faces),
    SearchWay("rising load", _refuses_rising_load, _by_rising_load),
)
