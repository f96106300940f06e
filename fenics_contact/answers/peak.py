"""The peak: the most that a slowly raised load reaches before joints slip and it falls.

It is told beside the collapse, which is never above it, wherever a path of elastic blocks leads to
the collapse (`collapse.peak`). It depends on stiffness and mesh.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Self

from fenics_contact.answers.question import Asked, Question
from fenics_contact.collapse.peak import Above, find_peak
from fenics_contact.collapse.service_state import service_state
from fenics_contact.results.bounds import alike
from fenics_contact.results.history import Peak
from fenics_contact.results.result import Collapse, Table
from fenics_contact.scene.scene import SolveOptions
from fenics_contact.scene.units import Units
from fenics_contact.search_options import SEARCH

#: Why it is not known.
NOT_ASKED = "solve.peak = false; solve.peak = true looks for it"
FAST = "solve.fast = true leaves it out"
NO_PATH = "the loading path was not followed to its end"
TEARS = "what joints carry before they tear depends on the way of the load"


def _left_out(question: Question) -> bool:
    return question.is_fast() and not question.by_curve and not question.by_rising_load()


def _not_asked(question: Question) -> bool:
    not_asked = question.options.peak is False
    return not_asked and not question.by_curve and not question.by_rising_load()


class PeakAnswer(Asked):
    """The most that the loading path carries, a `Peak`.

    None with given friction, where it is the load factor itself, and where there is no limit.
    """

    value: Peak
    name = key = seconds = "peak"
    place = 3
    begins = "peak of the loading path"
    option = "peak of the loading path looked for"
    by_default = "yes, within a limit of work"
    of_path = of_curve = True
    unless = (
        (Question.by_faces, NO_PATH),
        (Question.loses_strength, TEARS),
        (_left_out, FAST),
        (_not_asked, NOT_ASKED),
    )

    @classmethod
    def is_asked(cls, options: SolveOptions) -> bool:
        """Always: where it is left out it is said to be not known."""
        return True

    @classmethod
    def concerns(cls, question: Question) -> bool:
        """Whether friction is Coulomb's."""
        return question.end.state is not None and question.case.problem.coulomb

    @classmethod
    def not_known(cls, reason: str) -> Self:
        """That the peak is not known."""
        return cls(Peak("not_known", reason=reason))

    @classmethod
    def run(cls, question: Question) -> tuple[Self | None, Collapse]:
        """The peak of the path to a collapse; if it is asked for, at any cost."""
        end = question.end
        case = question.case
        work = 0.0 if end.state is None else end.state.work
        above = Above(end.load_factor, end.size, work)
        if end.path is not None:
            last = end.path.steps[-1]
            carried = end.path.lower, end.path.upper, last.work, last.displacement
            found = above(end.path.lower) > SEARCH.higher
            return cls(Peak("found", *carried) if found else Peak("none")), end
        at_any_cost = question.by_curve or bool(question.options.peak)
        peak = find_peak(case, above, question.cost, at_any_cost)
        if at_any_cost and peak.status == "found":
            peak = _beyond(question.unrecorded, above, peak)
        return cls(peak), end

    def lines(self, end: Collapse, units: Units) -> list[str]:
        """What is carried on the way to the collapse."""
        peak = self.value
        if peak.status == "none":
            return ["peak: none found, the load factor rises to that of the collapse"]
        if peak.status == "not_known":
            return [f"peak: not known, {peak.reason}"]
        return [
            f"peak: on the way at least {peak.load_factor:.4g} was carried, at"
            f" {1e3 * peak.displacement_m:.3g} mm; then joints slip and the load falls (it depends"
            " on stiffness and mesh: quote the load factor of the collapse)"
        ]

    def marks(self, end: Collapse) -> Iterator[tuple[str, float, float]]:
        """Its place on the capacity curve."""
        peak = self.value
        if peak.status == "found":
            text = f"peak, at least {alike(peak.load_factor, end.load_factor)}"
            yield text, peak.displacement_m, peak.load_factor

    def table(self, end: Collapse, units: Units) -> Table:
        """The same for the report; nothing where there is no peak."""
        peak = self.value
        name = "carried on the way to the collapse"
        if peak.status != "found":
            text = f"not known: {peak.reason}"
            return Table([(name, text)] if peak.status == "not_known" else [])
        text = (
            f"{alike(peak.load_factor, end.load_factor)}, at {units.small(peak.displacement_m)};"
            " then joints slip and the load falls. This depends on the stiffness and on the mesh:"
            " the load factor above is the one to quote."
        )
        return Table([(f"{name}, at least", text)])


def _beyond(question: Question, above: Above, found: Peak) -> Peak:
    """A peak with the next load factor, if `equilibrium()` finds no state there either.

    Its search is taken to its end, which may cost as much as a load that rises to a collapse.
    """
    case = question.case
    target = found.load_factor + 5.0 * SEARCH.side_accuracy * above.size
    effort = case.discretization.effort
    with effort.at_most(SEARCH.load_cost):
        state = service_state(case, target)
        tried = state.status != "equilibrium" and effort.left >= 1.0
    return replace(found, not_found_at=target) if tried else found
