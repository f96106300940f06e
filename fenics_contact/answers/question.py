"""What is asked of a collapse: the interface of all answers that are looked for.

A new answer is a class derived from `Asked`, in a file of its own in this folder.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.results.result import Answer, Collapse
from fenics_contact.scene.scene import SolveOptions


@dataclass(frozen=True)
class Question:
    """A collapse of which something is asked.

    Attributes:
        case: Its load case.
        end: The collapse; load factors have the sign of the load case.
        cost: Of the collapse, in units of one factorisation of the structure.
        by_curve: Whether a capacity curve is traced, so that the path is followed anyway.
    """

    case: LoadCase
    end: Collapse
    cost: float
    by_curve: bool = False

    @property
    def options(self) -> SolveOptions:
        """What the scene asks for."""
        return self.case.discretization.scene.solve

    @property
    def unrecorded(self) -> Question:
        """The same, such that the record of the search for the collapse stays as it is."""
        return replace(self, case=self.case.unrecorded)

    def by_faces(self) -> bool:
        """Whether the forces of joint faces led to the collapse, and no path."""
        return self.end.engine == "faces"

    def by_rising_load(self) -> bool:
        """Whether a load that rises step by step led to it."""
        return self.end.path is not None

    def loses_strength(self) -> bool:
        """Whether joints lose their strengths where they open."""
        return bool(np.any(self.case.discretization.joints.losing))

    def driven_by_dead_load(self) -> bool:
        """Whether the live load does negative work in the collapse."""
        problem = self.case.problem
        return self.end.mode is not None and problem.dot(problem.live, self.end.mode) < 0.0

    def is_fast(self) -> bool:
        """Whether the load factor and its bracket alone are asked for."""
        return self.options.fast


class Asked(Answer):
    """An answer that is looked for once a collapse is found.

    Class attributes besides those of `Answer`:
        may_replace: Whether another collapse may take the place of the one that is asked of; it is
            asked before the others then.
        with_fast: Whether it is asked with `fast` too.
        unless: Reasons why it is not known, by what holds of the question; an empty reason leaves
            the answer out.
        of_curve: Whether it is asked again, at any cost, where a capacity curve is traced.
    """

    may_replace: ClassVar[bool] = False
    with_fast: ClassVar[bool] = False
    unless: ClassVar[tuple[tuple[Callable[[Question], bool], str], ...]] = ()
    of_curve: ClassVar[bool] = False

    @classmethod
    def is_asked(cls, options: SolveOptions) -> bool:
        """Whether a scene asks for it: neither `fast` nor its own option leaves it out."""
        asked = getattr(options, cls.seconds, None) is not False
        return asked and (cls.with_fast or not options.fast)

    @classmethod
    def concerns(cls, question: Question) -> bool:
        """Whether a verified collapse has such an answer at all."""
        return True

    @classmethod
    def not_known(cls, reason: str) -> Self | None:
        """That it is not known, for a reason; None for answers that are left out then."""
        return None

    @classmethod
    @abstractmethod
    def run(cls, question: Question) -> tuple[Self | None, Collapse]:
        """The answer, or None, and the collapse with what else was found of it. Collective.

        Raises:
            Stopped: If the run is to end.
        """
