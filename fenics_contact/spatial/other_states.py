"""Other collapse states of rigid blocks: the lowest one, and that of one solve, without a path."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

from fenics_contact.answers.lowest import FOUND, FoundStates, LowestAnswer, searched
from fenics_contact.answers.question import Asked
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.lowest import STARTS, Start
from fenics_contact.results.history import CollapseState, trials
from fenics_contact.results.result import Collapse
from fenics_contact.scene.scene import SolveOptions
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.certificate import as_collapse
from fenics_contact.spatial.question import BlockQuestion

#: Start from a state with forces at the corners of contacts alone.
CORNERS = "corners"


class LowestOfBlocks(LowestAnswer):
    """The lowest state, where a scene asks for it."""

    asks = BlockQuestion
    begins = "lower collapse states"
    reported = FOUND
    unless = ()

    @classmethod
    def is_asked(cls, options: SolveOptions) -> bool:
        """Only by its own options."""
        return bool(options.lowest) or options.states == "lowest"

    @classmethod
    def concerns(cls, question: Any) -> bool:
        """Whether the kernel knows all laws."""
        return question.search.model.further is None

    @classmethod
    def found(cls, question: Any) -> FoundStates:
        """States of several starts, one of them that of fewer points."""
        model = question.search.model
        every = question.options.states == "lowest"
        starts: dict[str, Start] = dict(list(STARTS.items())[: None if every else 1])
        corners = replace(question.structure, quick=True).face_model(question.end.sign)
        wait = question.check_stop
        if corners.shape != model.shape:
            starts[CORNERS] = FaceSearch(corners, question.options.asked_gap, check_stop=wait)
        return searched(model, starts, wait)

    @classmethod
    def collapse_of(cls, question: Any, state: FaceState) -> Collapse:
        """A state as a collapse of the structure."""
        parts = question.structure, question.search.model, state, question.end.sign
        return as_collapse(*parts, question.options.asked_gap)


class AnotherState(Asked):
    """The state that one solve leads to, beside that of the loading path."""

    asks = BlockQuestion
    place = 5
    begins = "another state"
    seconds = "lowest"

    @classmethod
    def concerns(cls, question: BlockQuestion) -> bool:
        """Whether a path of rigid blocks led to the collapse."""
        rigid = question.structure.strained is None
        return rigid and question.end.way == "follow" and question.path is not None

    @classmethod
    def run(cls, question: BlockQuestion) -> tuple[Self | None, Collapse]:
        """The collapse with that state, if it is one."""
        end = question.end
        asked = question.options.asked_gap
        steps: dict[str, Any] = {"check_stop": question.check_stop, "near": SEARCH.side_accuracy}
        search = FaceSearch(question.search.model, asked, **steps)
        state = search.run()
        spent = end.factorizations + search.equations.factorizations
        attempts = (*end.attempts, *trials(search.attempts))
        end = replace(end, factorizations=spent, attempts=attempts)
        if state is None or state.gap > asked:
            return None, end
        one = CollapseState(search.way, "limit", end.sign * state.load_factor, abs(state.gap))
        return None, replace(end, states=(*end.states, one))
