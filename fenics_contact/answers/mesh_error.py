"""What a load factor owes to the mesh: the length of hinges, and the rest (`mesh_error`)."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from typing import Any, Self

from fenics_contact.answers.question import Asked, Question
from fenics_contact.mesh_error.estimate import estimated
from fenics_contact.results.bounds import alike
from fenics_contact.results.mesh_error import MeshError
from fenics_contact.results.result import Answer, Collapse, Table
from fenics_contact.scene.scene import SolveOptions
from fenics_contact.scene.units import Units

_log = logging.getLogger("fenics_contact")


def _by_load_steps(question: Question) -> bool:
    """Whether slip is measured from the step before."""
    return question.by_rising_load() and question.options.slip == "load-steps"


class MeshErrorAnswer(Asked):
    """The estimate of the discretisation error, a `MeshError`; None where none is made."""

    value: MeshError
    name = "mesh_error"
    key = "discretization"
    seconds = "error"
    begins = "estimate of the error"
    of_path = True
    #: On other meshes other points tear; slip that is measured from the step before is no data.
    unless = (
        (Question.loses_strength, ""),
        (_by_load_steps, ""),
    )

    @classmethod
    def is_asked(cls, options: SolveOptions) -> bool:
        """Unless it is left out."""
        return options.error is not False and not options.fast

    @classmethod
    def not_known(cls, reason: str) -> Self:
        """That errors are not known."""
        return cls(MeshError(math.nan, math.nan, math.nan, unknown=reason))

    @classmethod
    def run(cls, question: Question) -> tuple[Self | None, Collapse]:
        """The estimate, and the collapse with that at point hinges."""
        end = question.end
        if end.engine == "faces":
            return cls(MeshError(math.nan, end.load_factor, 0.0, 0.0)), end
        error, finer, at_hinges = estimated(question.case.unrecorded, end)
        if finer is not None and at_hinges is not None:
            finer = finer.with_answer(cls.name, cls(at_hinges))
        return cls(error), replace(end, at_point_hinges=finer)

    def in_bracket(self, end: Collapse) -> Answer:
        """Errors that do not lead out of the bracket: all collapse states are in it."""
        bounds = end.bounds
        lower = -math.inf if bounds.lower is None else bounds.lower
        upper = math.inf if bounds.upper is None else bounds.upper
        ends = lower, upper
        return replace(self, value=self.value.within(end.load_factor, end.size, ends))

    def record(self) -> Any:
        """What the load factor owes to the mesh."""
        error = self.value
        errors = "hinge_error", "algebraic_error", "estimate"
        names = ("hinge_length", "load_factor_point_hinges", *errors)
        changes = [dict(vars(change)) for change in error.state_changes]
        found = {name: getattr(error, name) for name in names}
        return found | {"state_changes": changes, "unknown": error.unknown or None}

    def lines(self, end: Collapse, units: Units) -> list[str]:
        """What a load factor owes to the mesh, and other states that a finer one leads to."""
        error = self.value
        if math.isnan(error.load_factor_point_hinges):
            lines = ["mesh: what the length of hinges does to the load factor is not known"]
        elif error.hinge_length == 0.0:
            lines = [f"mesh: the hinges are almost points; {_other_errors(error)}"]
        elif error.estimate == 0.0 and not error.state_changes and error.algebraic_error == 0.0:
            lines = ["mesh: the load factor does not depend on the mesh"]
        elif error.load_factor_point_hinges == end.load_factor:
            hinges = "the load factor does not depend on the length of hinges"
            lines = [f"mesh: {hinges}; {_other_errors(error)}"]
        else:
            hinges = (
                f"load factor {end.load_factor:.4g} for hinges of {1e3 * error.hinge_length:.3g}"
                f" mm; {error.load_factor_point_hinges:.4g} for point hinges"
            )
            lines = [f"mesh: {hinges}; {_other_errors(error)}"]
        for one in error.state_changes:
            finer = one.halvings[0] == one.halvings[1]
            where = "on a finer mesh" if finer else "with shorter hinges"
            known = f"load factor {one.before:.4g} to {one.after:.4g}: no part of the errors"
            found = "not found: its load factor is not known" if math.isnan(one.after) else known
            lines.append(f"mesh: another collapse state {where}, {found}")
        return lines + ([f"mesh: {error.unknown}"] if error.unknown else [])

    def table(self, end: Collapse, units: Units) -> Table:
        """What is known of the error of a load factor."""
        error = self.value
        factor = end.load_factor
        percent = f"{100 * error.hinge_error:.2g} %"
        rows = [
            ("load factor for point hinges", alike(error.load_factor_point_hinges, factor)),
            (
                "error by the length of hinges",
                "not known" if math.isnan(error.hinge_error) else percent,
            ),
        ]
        if not math.isnan(error.hinge_length):
            rows.insert(0, ("length of hinges in this mesh", units.small(error.hinge_length)))
        if error.unknown:
            rows.append(("what is not known of the error by the mesh", error.unknown))
        for change in error.state_changes:
            states = f"{alike(change.before, factor)} to {alike(change.after, factor)}"
            rows.append(("another collapse state for shorter hinges", states))
        return Table(rows)


def _other_errors(error: MeshError) -> str:
    """The error that hinges have no part in."""
    if math.isnan(error.algebraic_error):
        return "other errors not known"
    return f"other errors {100.0 * error.algebraic_error:.2g} %"
