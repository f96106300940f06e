"""What no state of rigid blocks exceeds: the upper end of the bracket, or blocks that can wedge."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

from fenics_contact.answers.question import Asked
from fenics_contact.faces.programs import associative_end
from fenics_contact.results.bounds import rounded
from fenics_contact.results.result import Collapse, up_to
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.certificate import certified
from fenics_contact.spatial.question import BlockQuestion
from fenics_contact.spatial.standing import wedged_blocks


class UpperEnd(Asked):
    """The load factor of associative friction; a state above it is none."""

    asks = BlockQuestion
    place = 6
    begins = "what nothing exceeds"

    @classmethod
    def is_of(cls, end: Collapse) -> bool:
        """Also of states that were not verified."""
        return end.status in ("limit", "not_converged")

    @classmethod
    def run(cls, question: BlockQuestion) -> tuple[Self | None, Collapse]:
        """The collapse with its upper end, if one is proved."""
        question.check_stop()
        structure, model, found = question.structure, question.search.model, question.end
        end = associative_end(model)
        if end is None:
            return None, replace(found, falling=wedged_blocks(structure, model, stressed=True))
        found = replace(found, program=up_to(rounded(end, found.size)))
        above = found.sign * (found.load_factor - found.upper) / found.size
        if above <= 0.0:
            return None, found
        rounding = SEARCH.agrees * max(1.0, model.force / (model.load * found.size))
        if above <= (found.gap or 0.0) + rounding:
            asked = found.certificate.tolerance if found.certificate else 0.0
            found = replace(found, load_factor=found.upper)
            return None, certified(structure, found, found.size, asked)
        reason = (
            f"the best state, {found.load_factor:.6g}, is above {found.upper:.6g}, a proved end"
        )
        return None, replace(found, status="not_converged", reason=reason)
