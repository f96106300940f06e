"""What ties bring: the collapse without them, and the yield at which a seismic demand is met."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from fenics_contact.answers.question import Asked
from fenics_contact.answers.seismic import seismic_check
from fenics_contact.errors import SolverError, Stopped, require
from fenics_contact.results.result import Collapse
from fenics_contact.results.values import TieState
from fenics_contact.results.wording import Line, Wording
from fenics_contact.scene.units import Units
from fenics_contact.spatial.limit import searched_for
from fenics_contact.spatial.other_states import LowestOfBlocks
from fenics_contact.spatial.question import BlockQuestion
from fenics_contact.spatial.result import ANOTHER, ties_of
from fenics_contact.spatial.ties import part_of

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
    load_factor: float = math.nan
    yields: tuple[float, float] = (math.nan, math.nan)
    lowest: tuple[float, ...] = ()
    needed: float | None = None
    reason: str = ""


class WithoutTiesAnswer(Asked):
    """What ties bring, a `WithoutTies`."""

    value: WithoutTies
    name = key = "without_ties"
    seconds = "ties"
    place = 8
    asks = BlockQuestion
    begins = "the collapse without ties"
    option = "what ties bring looked for"
    by_direction = True

    @classmethod
    def concerns(cls, question: BlockQuestion) -> bool:
        """Whether there are ties."""
        return bool(question.structure.bars)

    @classmethod
    def run(cls, question: BlockQuestion) -> tuple[Self | None, Collapse]:
        """What ties bring to a collapse."""
        end = question.end
        bare = _with_yields(question, 0.0)
        given = [tie.yield_ for tie in question.scene.ties.values()]
        found = WithoutTies(bare.end.status, bare.end.load_factor, (min(given), max(given)))
        less = end.sign * (bare.end.load_factor - end.load_factor) > ANOTHER * end.size
        if bare.end.status == "limit" and less and LowestOfBlocks.concerns(question):
            found = replace(found, lowest=(_lowest(question), _lowest(bare)))
        if question.scene.seismic is not None and question.scene.seismic.demand is not None:
            try:
                found = replace(found, needed=_needed(question, bare))
            except SolverError as error:
                found = replace(found, reason=str(error))
            except Stopped as stop:
                found, end = replace(found, reason=str(stop)), replace(end, stopped=str(stop))
        return cls(found), end

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


def _with_yields(question: BlockQuestion, factor: float) -> BlockQuestion:
    """The collapse with yields and prestresses that are multiplied; without ties for 0.

    Raises:
        Stopped: If the run is to end.
    """
    structure, end = question.structure, question.end
    bars = [replace(bar, tie=part_of(bar.tie, factor)) for bar in structure.bars if factor]
    structure = replace(structure, bars=tuple(bars))
    asked = question.options.asked_gap
    found, search = searched_for(structure, end.sign, asked, question.check_stop)
    require(not found.stopped, found.stopped, Stopped)
    return replace(question, structure=structure, end=found, search=search or question.search)


def _lowest(question: BlockQuestion) -> float:
    """Load factor of the lowest state found; nan if it is not known."""
    known: Any = question.end.answers.get("lowest") or LowestOfBlocks.run(question)[0]
    return float(known.value.load_factor) if known is not None else math.nan


def _acceleration(question: BlockQuestion) -> float:
    """a0* of a collapse, m/s2: 0 where it does not stand, infinite where nothing limits it.

    Raises:
        SolverError: If no collapse was found.
    """
    scene, end = question.scene, question.end
    if end.status != "limit":
        known = {"unstable": 0.0, "no_equilibrium": 0.0, "unbounded": math.inf}
        require(end.status in known, f"with other yields {end.reason}", SolverError)
        return known[end.status]
    gravity, push = (math.hypot(*one.acceleration) for one in (scene.dead, scene.live))
    check = seismic_check(question.view, scene.seismic, end.load_factor, gravity, push)
    return math.inf if check is None else check.acceleration


def _yields(question: BlockQuestion) -> bool:
    """Whether a tie yields in a collapse."""
    return bool(np.any(ties_of(question.structure, question.end).get("state") == TieState.YIELDS))


def _needed(question: BlockQuestion, bare: BlockQuestion) -> float:
    """The least multiple of all yields with which a0* reaches the demand, see `WithoutTies`.

    A state in which no tie yields is one of stronger ties, too. Secants follow, of which the end
    that stays counts half (Illinois; M. Dowell, P. Jarratt, BIT 11 (1971) 168).
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
        strong = _with_yields(question, high)
        over = _acceleration(strong) - demand
    while high - low > PRECISION * high:
        share = under / (under - over) if math.isfinite(over) else 0.5
        least = 0.9 * PRECISION * high  # away from both ends, so that one more point may do
        middle = float(np.clip(low + share * (high - low), low + least, high - least))
        found = _acceleration(_with_yields(question, middle)) - demand
        if found >= 0.0:
            high, over, under = middle, found, 0.5 * under
        else:
            low, under, over = middle, found, 0.5 * over
    return high
