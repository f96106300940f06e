"""The loop over answers: what stands against one, and when a run ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from importlib import import_module
from pkgutil import iter_modules

from fenics_contact import answers
from fenics_contact.answers.question import Asked, Question
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.errors import Stopped
from fenics_contact.results.result import Answer, Collapse

for _file in iter_modules(answers.__path__):  # each has its kind of answer
    import_module(f"{answers.__name__}.{_file.name}")


def kinds() -> list[type[Asked]]:
    """Kinds of answers that are looked for: what may lead to another collapse comes first."""
    found = [kind for kind in Answer.kinds.values() if issubclass(kind, Asked)]
    return sorted(found, key=lambda kind: not kind.may_replace)


def answered(
    cases: Mapping[str, LoadCase],
    found: Mapping[str, Collapse],
    cost: float,
    begin: Callable[[str], None],
    seconds: dict[str, float],
) -> dict[str, Collapse]:
    """Collapses with all that their scene asks for beside the load factors. Collective.

    Args:
        cases: By direction.
        found: Collapses by direction.
        cost: Of one of them, in units of one factorisation of the structure.
        begin: Told what begins.
        seconds: Gets the time of every answer.
    """
    ends = dict(found)
    made = next(iter(cases.values())).discretization
    options = made.scene.solve
    for kind in kinds():
        if not kind.is_asked(options):
            continue
        start = time.perf_counter()
        if kind.begins and not (options.fast or made.effort.watch.reason):
            begin(kind.begins)
        for name, end in ends.items():
            ends[name] = asked(kind, Question(cases[name], end, cost))
        if kind.seconds:
            seconds[kind.seconds] = time.perf_counter() - start
    return ends


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
