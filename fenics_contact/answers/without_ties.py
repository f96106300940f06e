"""What ties bring: the collapse without them, and the yield at which a seismic demand is met."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from fenics_contact.answers.lowest import LowestAnswer
from fenics_contact.answers.question import Asked, MeshQuestion, Question, Reasons, asked
from fenics_contact.answers.seismic import SeismicAnswer
from fenics_contact.collapse.face_collapse import rigid_collapse
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.errors import SolverError, Stopped, require
from fenics_contact.results.bounds import LoadFactor, rounded
from fenics_contact.results.result import ANOTHER, Collapse
from fenics_contact.results.values import TieState
from fenics_contact.results.wording import Line, Wording
from fenics_contact.scene.units import Units

#: Accuracy of the yield that is needed, relative, and largest multiple of the given one tried.
PRECISION, MOST = 0.01, 64.0


@dataclass(frozen=True)
class WithoutTies:
    """A structure without its ties, and with stronger or weaker ones.

    Attributes:
        status: Without ties, as that of a collapse.
        load_factor: Without ties; nan if there is none.
        yields: Smallest and largest yield of ties, N, in the plane per metre of thickness.
        lowest: Load factors of the lowest states found with and without ties, where ties lead to a
            lower state than that without; nan if not known, empty where they do not.
        needed: Yields with which a0* reaches the demand, over those given: 0 if it does so without
            ties, infinite if stronger ties bring no more; None: no demand is given, or none was
            found.
        reason: Why none was found.
    """

    status: str
    load_factor: LoadFactor = math.nan
    yields: tuple[float, float] = (math.nan, math.nan)
    lowest: tuple[LoadFactor, ...] = ()
    needed: float | None = None
    reason: str = ""


class WithoutTiesAnswer(Asked):
    """What ties bring, a `WithoutTies`."""

    value: WithoutTies
    name = key = "without_ties"
    seconds = "ties"
    place = 8
    begins = "the collapse without ties"
    option = "what ties bring looked for"
    by_direction = True
    unless: ClassVar[Reasons] = ((MeshQuestion.loses_strength, ""),)
    #: How lower states are looked for.
    lower: ClassVar[type[LowestAnswer]] = LowestAnswer

    @classmethod
    def concerns(cls, question: Question) -> bool:
        """Whether there are ties."""
        return bool(question.scene.ties)

    @classmethod
    def with_yields(cls, question: Any, factor: float) -> Any:
        """The collapse of rigid blocks with forces of ties times a factor. Collective.

        Raises:
            Stopped: If the run is to end.
        """
        case = question.case
        whole = case.discretization
        layout = replace(whole.layout, joints=whole.joints.with_yields(factor))
        case = replace(case, blocks=RigidBlocks.of(layout, case.sign))
        return replace(question, case=case, begun=None, end=rigid_collapse(case, question.end))

    @classmethod
    def run(cls, question: Any) -> tuple[Self | None, Collapse]:
        """What ties bring to a collapse."""
        end = question.end
        bare = cls.with_yields(question, 0.0)
        given = [tie.per_metre * tie.yield_ for tie in question.scene.ties.values()]
        factor = rounded(bare.end.load_factor, end.size)
        found = WithoutTies(bare.end.status, factor, (min(given), max(given)))
        less = end.sign * (bare.end.load_factor - end.load_factor) > ANOTHER * end.size
        if bare.end.status == "limit" and less and cls.lower.concerns(question):
            found = replace(found, lowest=(cls._lowest(question), cls._lowest(bare)))
        if question.scene.seismic is not None and question.scene.seismic.demand is not None:
            try:
                found = replace(found, needed=cls._needed(question, bare))
            except SolverError as error:
                found = replace(found, reason=str(error))
            except Stopped as stop:
                found, end = replace(found, reason=str(stop)), replace(end, stopped=str(stop))
        return cls(found), end

    @classmethod
    def _lowest(cls, question: Question) -> float:
        """Load factor of the lowest state found; nan if it is not known."""
        end = question.end if question.end.lowest else asked(cls.lower, question)
        return float(end.lowest.load_factor) if end.lowest else math.nan

    @classmethod
    def _needed(cls, question: Question, bare: Question) -> float:
        """The least multiple of all yields with which a0* reaches the demand, see `WithoutTies`.

        A state in which no tie yields is one of stronger ties, too. Secants follow, of which the
        end that stays counts half (Illinois; M. Dowell, P. Jarratt, BIT 11 (1971) 168).
        """
        demand, strong = question.scene.seismic.demand, question
        low, high = 0.0, 1.0
        under, over = _acceleration(bare) - demand, _acceleration(question) - demand
        if under >= 0.0:
            return 0.0
        while over < 0.0:
            if over <= under or high == MOST or not _yields(strong):
                return math.inf
            further = high - over * (high - low) / (over - under)
            low, under, high = high, over, min((1.0 + 0.5 * PRECISION) * further, MOST)
            strong = cls.with_yields(question, high)
            over = _acceleration(strong) - demand
        while high - low > PRECISION * high:
            share = under / (under - over) if math.isfinite(over) else 0.5
            least = 0.9 * PRECISION * high  # away from both ends, so that one more point may do
            middle = float(np.clip(low + share * (high - low), low + least, high - least))
            found = _acceleration(cls.with_yields(question, middle)) - demand
            if found >= 0.0:
                high, over, under = middle, found, 0.5 * under
            else:
                low, under, over = middle, found, 0.5 * over
        return high

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """Load factors without and with ties, lowest states, and the yield that is needed."""
        found = self.value
        factors = (found.load_factor, end.load_factor, *found.lowest)
        between = 0.5 * sum(factors[:2])
        bare, tied, *lowest = (words.beside(one, between, end.sign) for one in factors)
        others = {"unbounded": "no limit", "not_converged": "what is not known"}
        bare = {"limit": bare, **others}.get(found.status, "no equilibrium")
        head = f"ties of {_forces(found, 1.0, words.units)}:"
        lines = [Line(head, f"from {bare} to {tied} {words.unit}")]
        if lowest:
            text = f"lowest states found: {lowest[0]} with them, {lowest[1]} without"
            lines.append(Line("ties lead to a lower state than the one without:", text))
        if found.reason:
            lines.append(Line("needed for the demand:", f"not known: {found.reason}"))
        if found.needed is not None:
            few = {0.0: "no ties", math.inf: "not reached by stronger ties"}
            text = few.get(found.needed) or _forces(found, found.needed, words.units)
            lines.append(Line("needed for the demand:", text))
        return lines


def _forces(found: WithoutTies, factor: float, units: Units) -> str:
    """Yields of ties, times a factor."""
    few, most = (units.force(float(f"{factor * one:.4g}"), 6) for one in found.yields)
    return few if few == most else f"{few} to {most}"


def _acceleration(question: Question) -> float:
    """a0* of a collapse, m/s2: 0 where it does not stand, infinite where nothing limits it.

    Raises:
        SolverError: If no collapse was found.
    """
    end = question.end
    if end.status != "limit":
        known = {"unstable": 0.0, "no_equilibrium": 0.0, "unbounded": math.inf}
        require(end.status in known, f"with other yields {end.reason}", SolverError)
        return known[end.status]
    check = SeismicAnswer.run(question)[0]
    return math.inf if check is None else check.value.acceleration


def _yields(question: Question) -> bool:
    """Whether a tie yields in a collapse, or that is not known."""
    return bool(np.any(question.view.ties.get("state", TieState.YIELDS) == TieState.YIELDS))
