"""What is asked of a collapse: the interface of all answers, and the loop over them.

A new answer is a class derived from `Asked`, in a file of its own in this folder.
"""

from __future__ import annotations

import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.output.view import view_of
from fenics_contact.results.block_view import BlockView
from fenics_contact.results.result import Answer, Collapse
from fenics_contact.scene.scene import SolveOptions

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True, kw_only=True)
class Question(ABC):
    """A collapse of which something is asked, of blocks with a mesh or without.

    Attributes:
        scene: What was asked for.
        end: The collapse; empty as long as it is looked for.
        begun: What was begun before the collapse was known; None for nothing.
    """

    scene: Any
    end: Collapse = field(default_factory=Collapse)
    begun: Future[Any] | None = None

    @property
    @abstractmethod
    def view(self) -> BlockView:
        """What blocks and contacts do in the collapse."""

    @property
    @abstractmethod
    def stopped(self) -> str:
        """Why the run is to end, in words; empty while it goes on."""

    @property
    def options(self) -> SolveOptions:
        """What the scene asks for of the search."""
        options: SolveOptions = self.scene.solve
        return options


@dataclass(frozen=True, kw_only=True)
class MeshQuestion(Question):
    """A collapse of meshed blocks; load factors have the sign of the load case.

    Attributes:
        case: Its load case.
        cost: Of the collapse, in units of one factorisation of the structure.
        by_curve: Whether a capacity curve is traced, so that the path is followed anyway.
    """

    case: LoadCase
    cost: float = 0.0
    by_curve: bool = False

    @property
    def view(self) -> BlockView:
        """What blocks and joints do in the collapse."""
        mode = np.asarray(self.end.mode)
        return view_of(self.case.discretization.layout, mode, self.end.joints).blocks

    @property
    def stopped(self) -> str:
        """Why the run is to end, in words; empty while it goes on."""
        return self.case.discretization.effort.watch.reason

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


#: What may hold of a question, and why an answer is not known then.
Reasons = tuple[tuple[Callable[[Any], bool], str], ...]


class Asked(Answer):
    """An answer that is looked for once a collapse is found.

    One that only adds to the collapse, or corrects it, has no text of its own: `run` gives None.

    Class attributes besides those of `Answer`:
        every: All kinds; a class that says how it runs is one of them.
        asks: Of which collapses it is looked for.
        may_replace: Whether another collapse may take the place of the one that is asked of; it is
            asked before the others then.
        with_fast: Whether it is asked with `fast` too.
        unless: Reasons why it is not known, by what holds of the question; an empty reason leaves
            the answer out.
        of_curve: Whether it is asked again, at any cost, where a capacity curve is traced.
    """

    every: ClassVar[list[type[Asked]]] = []
    asks: ClassVar[type[Question]] = MeshQuestion
    may_replace: ClassVar[bool] = False
    with_fast: ClassVar[bool] = False
    unless: ClassVar[Reasons] = ()
    of_curve: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        """A kind that can be asked is one of all."""
        super().__init_subclass__()
        if "run" in vars(cls) or "asks" in vars(cls):
            Asked.every.append(cls)

    @classmethod
    def is_asked(cls, options: SolveOptions) -> bool:
        """Whether a scene asks for it: neither `fast` nor its own option leaves it out."""
        asked = getattr(options, cls.seconds, None) is not False
        return asked and (cls.with_fast or not options.fast)

    @classmethod
    def is_of(cls, end: Collapse) -> bool:
        """Whether such a collapse has answers of this kind: verified ones have."""
        return end.status == "limit" and end.mode is not None

    @classmethod
    def concerns(cls, question: Any) -> bool:
        """Whether a collapse has such an answer at all."""
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
    def run(cls, question: Any) -> tuple[Self | None, Collapse]:
        """The answer, or None, and the collapse with what else was found of it. Collective.

        Raises:
            SolverError: If it is not found.
            Stopped: If the run is to end.
        """


def kinds(of: type[Question]) -> list[type[Asked]]:
    """Kinds of answers for some questions: what may lead to another collapse comes first."""
    found = [kind for kind in Asked.every if issubclass(of, kind.asks)]
    return sorted(found, key=lambda kind: (not kind.may_replace, kind.place))


def begun(case: LoadCase) -> dict[str, Future[Any]]:
    """What of the answers that a scene asks for needs no collapse, by name."""
    options = case.discretization.scene.solve
    asked = [kind for kind in kinds(MeshQuestion) if kind.is_asked(options)]
    tasks = {kind.name: kind.begin(case) for kind in asked}
    return {name: task for name, task in tasks.items() if task is not None}


def answered(
    question: Question,
    tell: Callable[[str], None],
    seconds: dict[str, float],
    tasks: Mapping[str, Future[Any]] | None = None,
) -> Collapse:
    """A collapse with all that its scene asks for beside the load factor. Collective.

    Args:
        question: The collapse.
        tell: Told what begins.
        seconds: Gets the time of every answer.
        tasks: What was begun before it was known, see `begun`.
    """
    for kind in kinds(type(question)):
        if not kind.is_asked(question.options):
            continue
        start = time.perf_counter()
        task = tasks.get(kind.name) if tasks else None
        question = replace(question, end=asked(kind, replace(question, begun=task), tell))
        if kind.seconds:
            spent = seconds.get(kind.seconds, 0.0)
            seconds[kind.seconds] = spent + time.perf_counter() - start
    return question.end


def asked(
    kind: type[Asked], question: Question, tell: Callable[[str], None] = lambda text: None
) -> Collapse:
    """A collapse with one answer; it is not known why, where something stands against it."""
    end = question.end
    if not (kind.is_of(end) and kind.concerns(question)):
        return end
    answer: Answer | None = None
    reasons = [reason for holds, reason in kind.unless if holds(question)]
    if reasons:
        answer = kind.not_known(reasons[0]) if reasons[0] else None
    elif question.stopped and kind.begins:
        answer = kind.not_known(question.stopped)
    else:
        if kind.begins and not question.options.fast:
            tell(kind.begins)
        try:
            answer, end = kind.run(question)
        except SolverError as error:
            _log.info("  %s: %s", kind.begins or kind.name, error)
            answer = kind.not_known(str(error))
        except Stopped as stop:
            answer, end = kind.not_known(str(stop)), replace(end, stopped=str(stop))
    return end if answer is None else end.with_answer(answer)


def of_curve(question: Question) -> Collapse:
    """A collapse with the answers that a capacity curve needs, at any cost."""
    for kind in kinds(type(question)):
        known = question.end.answers.get(kind.name) if kind.of_curve else None
        if known is not None and known.value.status == "not_known":
            question = replace(question, end=asked(kind, question))
    return question.end
