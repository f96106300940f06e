"""Other collapse states than the one that is reported, and the lowest of those found.

Pairs of programs on face forces go down from certified states of several starts, see
`faces.lowest`. Self-stress of the blocks is free in these states: elastic blocks may not reach them
from rest. None proves that there is no lower one: that is what the bracket is for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from fenics_contact.answers.question import Asked, MeshQuestion, Reasons
from fenics_contact.collapse.face_collapse import collapse_of
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.lowest import STARTS, Start, lowest_from
from fenics_contact.faces.model import FaceModel
from fenics_contact.results.bounds import NOT_FROM_REST, SELF_STRESS
from fenics_contact.results.history import CollapseState, Lowest, alike_as_one
from fenics_contact.results.result import Answer, Collapse
from fenics_contact.results.wording import Line, Wording
from fenics_contact.search_options import SEARCH
from fenics_contact.workers import result_of

#: Why nothing is known.
NO_STATE = "the search found no state"
MORE = f"{NO_STATE}; solve.states = 'lowest' tries more starts"
TEARS = "in other states other joints tear"
DEAD_LOAD = "the dead load drives the collapse"
#: What a state is that was searched for.
SEARCHED = f"lowest collapse state found, {SELF_STRESS}"
#: The same on the console.
FOUND = "lowest collapse state found, with any self-stress"
BY_LOAD = "lower states are not looked for where the load is raised step by step"


@dataclass(frozen=True)
class FoundStates:
    """States by their starts, why the searches ended early, and factorisations."""

    states: dict[str, FaceState]
    reason: str = ""
    stopped: bool = False
    factorizations: int = 0


class LowestAnswer(Asked):
    """The lowest collapse state found, a `Lowest`; None where it is not looked for."""

    value: Lowest
    name = key = seconds = "lowest"
    place = 4
    begins = "second opinion on the collapse"
    option = "lower collapse states looked for"
    may_replace = True
    #: What such a state is as the collapse.
    reported: ClassVar[str] = SEARCHED
    unless: ClassVar[Reasons] = (
        (MeshQuestion.loses_strength, TEARS),
        (MeshQuestion.by_rising_load, BY_LOAD),
        (MeshQuestion.driven_by_dead_load, DEAD_LOAD),
    )

    @classmethod
    def concerns(cls, question: MeshQuestion) -> bool:
        """Whether friction is Coulomb's; many blocks only if asked for, at the collapse's cost."""
        return _sought(question.case)

    @classmethod
    def begin(cls, case: LoadCase) -> Future[FoundStates] | None:
        """The searches: they need no collapse."""
        if not _sought(case) or np.any(case.discretization.joints.losing):
            return None
        every = case.discretization.scene.solve.states == "lowest"
        starts = dict(list(STARTS.items())[: None if every else 1])
        effort = SEARCH.collapse_cost if every else SEARCH.usual_effort
        model = case.blocks.model.planar.model
        return case.beside.submit(searched, model, starts, case.wait, effort)

    @classmethod
    def not_known(cls, reason: str) -> Self:
        """That lower states are not known."""
        return cls(Lowest("not_known", reason=reason))

    @classmethod
    def found(cls, question: MeshQuestion) -> FoundStates:
        """States of several starts, on all ranks."""
        case = question.case
        found: Any = None
        if case.problem.comm.rank == 0:
            task = question.begun or cls.begin(case)
            found = result_of(task, case.discretization.effort.wait) if task else None
        found = case.problem.comm.bcast(found)
        if found.stopped:
            case.discretization.effort.watch.reason = found.reason
        return found

    @classmethod
    def collapse_of(cls, question: MeshQuestion, state: FaceState) -> Collapse:
        """A state as a collapse of elastic blocks."""
        return collapse_of(question.case, state, SEARCH.lower_state_gap)

    @classmethod
    def run(cls, question: Any) -> tuple[Self | None, Collapse]:
        """The lowest state found beside a collapse, where several may exist.

        With `states = "lowest"` more starts are tried, and the lowest state becomes the collapse.
        """
        end = question.end
        every = question.options.states == "lowest"
        found = cls.found(question)
        spent = end.factorizations + found.factorizations
        end = replace(end, states=end.states or (end.as_state,), factorizations=spent)
        if found.reason or not found.states:
            return cls.not_known(found.reason or (NO_STATE if every else MORE)), end
        states = sorted(found.states.items(), key=lambda item: item[1].load_factor)
        factors = [end.sign * one.load_factor for _, one in states]
        best = states[0][1]
        lower = best.load_factor < end.sign * end.load_factor - SEARCH.higher * end.size
        told = Lowest("none", end.load_factor, len(states), gap=end.as_state.gap)
        if lower:
            told = replace(told, status="lower", load_factor=factors[0], gap=best.gap)
        ways = zip(states, factors, strict=True)
        others = [CollapseState(name, "limit", at, one.gap) for (name, one), at in ways]
        known = alike_as_one((*end.states, *others), end.size)
        if lower and every:
            collapse = cls.collapse_of(question, best)
            if collapse.status == "limit":
                found_by = {"attempts": end.attempts, "trace": end.trace, "factorizations": spent}
                end = replace(collapse, searched=cls.reported, **found_by)
        return cls(told), replace(end, states=known)

    def in_bracket(self, end: Collapse) -> Answer:
        """The lowest state moved into the bracket, by its gap; none if it is the collapse then."""
        bounds = end.bounds
        if self.value.status != "lower" or not end.in_bracket:
            return self
        least = -np.inf if bounds.lower is None else bounds.lower
        most = np.inf if bounds.upper is None else bounds.upper
        factor = float(np.clip(self.value.load_factor, least, most))
        status, gap = "lower", self.value.gap
        if abs(factor - end.load_factor) <= SEARCH.higher * end.size:
            status, factor, gap = "none", end.load_factor, end.as_state.gap
        return replace(self, value=replace(self.value, status=status, load_factor=factor, gap=gap))

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """Whether a lower collapse state was found, and all states where several are known."""
        lowest = self.value
        told = Line("lower state:", self._told(end), verbose=True)
        if lowest.status == "not_known" or end.bounds.meet or end.searched:
            return [told]
        found = "this one"
        if lowest.status == "lower":
            found = words.beside(lowest.load_factor, end.load_factor, end.sign)
        return [told, Line(f"{FOUND}:", found, states=True)]

    def _told(self, end: Collapse) -> str:
        """The same with all that is known of these states."""
        lowest = self.value
        if lowest.status == "not_known":
            return f"not known, {lowest.reason}"
        if end.bounds.meet:
            return "none, as the bracket proves"
        factors = [state.load_factor for state in end.states or (end.as_state,)]
        several = f"; states were found from {min(factors):.6g} to {max(factors):.6g}"
        others = several if len(factors) > 1 else ""
        if end.searched:
            return f"none found below the one reported{others}"
        if lowest.status == "lower":
            return (
                f"the lowest one found, {SELF_STRESS}, is at {lowest.load_factor:.6g}"
                f" with a gap of {lowest.gap or 0.0:.0e}; {NOT_FROM_REST}{others}"
            )
        searches = f"{lowest.starts} search{'es' * (lowest.starts != 1)}"
        return f"none found by {searches}, which is no proof{others}"


def _sought(case: LoadCase) -> bool:
    """Whether friction is Coulomb's; many blocks only if asked for, at the collapse's cost."""
    options = case.discretization.scene.solve
    asked = options.states == "lowest" or options.lowest
    return case.problem.coulomb and (bool(asked) or case.block_count < 10 * SEARCH.large_wall)


def searched(
    model: FaceModel,
    starts: Mapping[str, Start],
    wait: Callable[[], None],
    effort: float = SEARCH.collapse_cost,
) -> FoundStates:
    """A task: states from some starts, with so many factorisations each."""
    states: dict[str, FaceState] = {}
    spent = 0
    try:
        for name, start in starts.items():
            search = FaceSearch(model, SEARCH.side_accuracy, effort, wait)
            state = lowest_from(search, start)
            spent += search.equations.factorizations
            if state is not None:
                states[name] = state
    except (Stopped, SolverError) as error:  # a SolverError: faces that do not hold the blocks
        return FoundStates(states, str(error), isinstance(error, Stopped), spent)
    return FoundStates(states, factorizations=spent)
