"""Directions of the live load: which a scene asks for, and the others beside the first one."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

from fenics_contact.errors import Stopped
from fenics_contact.results.result import Collapse
from fenics_contact.workers import InPlace, last_result_of, result_of, workers_of

#: Signs of the live load.
SIGNS = {"positive": 1.0, "negative": -1.0}


def directions(asked: str) -> tuple[str, ...]:
    """Names of the directions that are asked for, "positive" first."""
    return tuple(SIGNS) if asked == "both" else (asked,)


def in_directions(
    asked: str,
    beside: Executor | None,
    begin: Callable[[str, Executor], Future[Any]],
    solve: Callable[[str, Executor], Any],
    check_stop: Callable[[], None],
) -> dict[str, Any]:
    """What is found in each direction, all but the first by workers, if there are any.

    Args:
        asked: As of `SolveOptions.direction`.
        beside: The workers; None for none.
        begin: Submits the task of one direction.
        solve: Solves for one direction here, with what does tasks beside it: nothing where all
            workers are busy with directions.
        check_stop: May raise `Stopped` while workers are waited for: what they know by then is
            found, or a `Collapse` that says why nothing is.
    """
    beside = beside or InPlace()
    first, *others = directions(asked)
    count = workers_of(beside)
    tasks = {name: begin(name, beside) for name in others if count}
    own = InPlace() if 0 < count <= len(tasks) else beside
    found = {name: solve(name, own) for name in (first, *others) if name not in tasks}
    for name, task in tasks.items():
        try:
            found[name] = result_of(task, check_stop)
        except Stopped as stop:
            nothing = Collapse(sign=SIGNS[name], reason=str(stop), stopped=str(stop))
            found[name] = last_result_of(task, beside) or nothing
    return found
