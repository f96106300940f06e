"""What a load factor owes to the length of hinges, which is that of the mesh (`mesh_error`)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Self

import numpy as np

from fenics_contact.answers.question import Asked, Question
from fenics_contact.mesh_error.hinges import HingeLengths, hinge_lengths
from fenics_contact.results.bounds import four_digits
from fenics_contact.results.result import Answer, Collapse, Table
from fenics_contact.scene.units import Units


def _by_load_steps(question: Question) -> bool:
    """Whether slip is measured from the step before."""
    return question.by_rising_load() and question.options.slip == "load-steps"


class HingesAnswer(Asked):
    """Load factors for hinges of other lengths, a `HingeLengths`; None where not looked for."""

    value: HingeLengths
    name = key = "hinges"
    seconds = "error"
    place = 6
    begins = "estimate of the error"
    option = "error by the mesh estimated"
    by_default = "yes, within a limit of work"
    of_path = True
    #: With other hinges other points tear; slip that is measured from the step before is no data.
    unless = ((Question.loses_strength, ""), (_by_load_steps, ""))

    @classmethod
    def not_known(cls, reason: str) -> Self:
        """That they are not known."""
        return cls(HingeLengths("not_known", math.nan, reason=reason))

    @classmethod
    def run(cls, question: Question) -> tuple[Self | None, Collapse]:
        """Load factors down to point hinges; joint faces have no mesh."""
        end = question.end
        if end.engine == "faces" or (end.range and end.range.is_one):
            return cls(HingeLengths.alike(end.load_factor)), end
        return cls(hinge_lengths(question.case.unrecorded, end, question.cost)), end

    def in_bracket(self, end: Collapse) -> Answer:
        """Load factors that do not leave the bracket: all collapse states are in it."""
        value = self.value
        bounds = end.bounds
        if bounds.meet and value.status == "not_known":
            return replace(self, value=HingeLengths.alike(end.load_factor))
        lower = -math.inf if bounds.lower is None else min(bounds.lower, end.load_factor)
        upper = math.inf if bounds.upper is None else max(bounds.upper, end.load_factor)
        physical, points = (float(x) for x in np.clip([value.physical, value.points], lower, upper))
        return replace(self, value=replace(value, physical=physical, points=points))

    def record(self) -> Any:
        """The three lengths with their load factors."""
        value = self.value
        lengths = {
            "mesh": (value.length, value.load_factor),
            "physical": (value.physical_length, value.physical),
            "points": (0.0, value.points),
        }
        found = {n: {"length": one[0], "load_factor": one[1]} for n, one in lengths.items()}
        return {"status": value.status, **found, "reason": value.reason or None}

    def lines(self, end: Collapse, units: Units) -> list[str]:
        """What hinges of other lengths do to the load factor."""
        value = self.value
        if value.status == "not_known":
            what = "mesh: what the length of hinges does to the load factor is not known"
            return [f"{what}; {value.reason}"]
        if value.points == value.load_factor:
            if end.range and end.range.is_one:
                return []
            return ["mesh: the load factor does not depend on the length of hinges"]
        mesh, physical, points = self._told()
        here = f"hinges of {units.small(value.length)} as on this mesh"
        if end.load_factor == value.points:
            return [f"mesh: the hinges are almost points; load factor {mesh}, {here}"]
        there = f"{physical} with {units.small(value.physical_length)}; {points} with points"
        return [f"mesh: load factor {mesh}, {here}; {there}"]

    def table(self, end: Collapse, units: Units) -> Table:
        """Load factors by length."""
        value = self.value
        if value.reason or value.points == value.load_factor:
            told = f"not known: {value.reason}" if value.reason else "the same"
            return Table([("load factor for hinges of other lengths", told)])
        mesh, physical = map(units.small, (value.length, value.physical_length))
        names = f"hinges of {mesh}, as in this mesh", f"hinges of {physical}", "point hinges"
        factors = zip(names, self._told(), strict=True)
        return Table([(f"load factor for {name}", factor) for name, factor in factors])

    def _told(self) -> list[str]:
        """The three load factors, rounded alike."""
        value = self.value
        factors = value.load_factor, value.physical, value.points
        return [four_digits(factor, value.load_factor) for factor in factors]
