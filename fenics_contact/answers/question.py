"""What is asked of a collapse: the interface of all answers, and the loop over them.

A new answer is a class derived from `Asked`, in a file of its own in this folder.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.errors import Stopped
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
        begun: What was begun before the collapse was known; None for nothing.
    """

    case: LoadCase
    end: Collapse
    cost: float
    by_curve: bool = False
    begun: Future[Any] | None = None

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

    def has_many_blocks(self) -> bool:
        """Whether programs for HiGHS would take minutes."""
        return self.case.blocks.model.units.has_many_blocks

    def loses_strength(self) -> bool:
        """Whether joints lose their strengths where they open."""
        return bool(np.any(self.case.discretization.joints.losing))

    def driven_by_dead_load(self) -> bool:
        """Whether the live load does negative work in the collapse."""
        problem = self.case.problem
        return self.end.mode is not None and problem.dot(problem.live, self.end.mode) < 0.0


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
    def begin(cls, case: LoadCase) -> Future[Any] | None:
        """Begin beside the search for the collapse what needs none; None for nothing."""
        return None

    @classmethod
    @abstractmethod
    def run(cls, question: Question) -> tuple[Self | None, Collapse]:
        """The answer, or None, and the collapse with what else was found of it. Collective.

        Raises:
            Stopped: If the run is to end.
        """


def kinds() -> list[type[Asked]]:
    """Kinds of answers that are looked for: what may lead to another collapse comes first."""
    found = [kind for kind in Answer.kinds.values() if issubclass(kind, Asked)]
    return sorted(found, key=lambda kind: not kind.may_replace)


def begun(case: LoadCase) -> dict[str, Future[Any]]:
    """What of the answers that a scene asks for needs no collapse, by name."""
    asked = [kind for kind in kinds() if kind.is_asked(case.discretization.scene.solve)]
    tasks = {kind.name: kind.begin(case) for kind in asked}
    return {name: task for name, task in tasks.items() if task is not None}


def answered(
    case: LoadCase,
    end: Collapse,
    cost: float,
    tasks: Mapping[str, Future[Any]],
    begin: Callable[[str], None],
    seconds: dict[str, float],
) -> Collapse:
    """A collapse with all that its scene asks for beside the load factor. Collective.

    Args:
        case: Its load case.
        end: The collapse.
        cost: Of it, in units of one factorisation of the structure.
        tasks: What was begun before it was known, see `begun`.
        begin: Told what begins.
        seconds: Gets the time of every answer.
    """
    made = case.discretization
    options = made.scene.solve
    for kind in kinds():
        if not kind.is_asked(options):
            continue
        start = time.perf_counter()
        if kind.begins and not (options.fast or made.effort.watch.reason):
            begin(kind.begins)
        end = asked(kind, Question(case, end, cost, begun=tasks.get(kind.name)))
        if kind.seconds:
            spent = seconds.get(kind.seconds, 0.0)
            seconds[kind.seconds] = spent + time.perf_counter() - start
    return end


def asked(kind: type[Asked], question: Question) -> Collapse:
    """A collapse with one answer; it is not known why, where something stands against it."""
    end = question.end
    answer: Answer | None = None
    if end.status == "limit" and end.mode is not None and kind.concerns(question):
        reasons = [reason for holds, reason in kind.unless if holds(question)]
        stopped = question.case.discretization.effort.watch.reason
        try:
            if reasons:
                answer = kind.not_known(reasons[0]) if reasons[0] else None
            elif stopped and kind.begins:
                answer = kind.not_known(stopped)
            else:
                answer, end = kind.run(question)
        except Stopped as stop:
            answer = kind.not_known(str(stop))
    return end if answer is None else end.with_answer(answer)


def of_curve(case: LoadCase, end: Collapse, cost: float) -> Collapse:
    """A collapse with the answers that a capacity curve needs, at any cost."""
    for kind in kinds():
        known = end.answers.get(kind.name)
        if kind.of_curve and known is not None and known.value.status == "not_known":
            end = asked(kind, Question(case, end, cost, by_curve=True))
    return end
