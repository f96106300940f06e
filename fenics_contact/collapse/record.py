"""What is done for one load case, as data: attempts, the path that is followed, its last point."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from fenics_contact.errors import SolverError, Stopped
from fenics_contact.results.history import TracePoint, Trial
from fenics_contact.solvers.arclength import PathPoint
from fenics_contact.solvers.effort import Effort
from fenics_contact.solvers.problem import State


def name_of(attempt: Callable[..., Any]) -> str:
    """Name of an attempt: that of its function, in words."""
    name: str = getattr(attempt, "func", attempt).__name__
    return name.replace("_", " ")


class Listener:
    """Is told how the search for a collapse goes, on all ranks; this one does not listen."""

    def phase(self, name: str) -> None:
        """Something else begins."""

    def passed(self, point: TracePoint) -> None:
        """A point of the path was passed; its load factor has the user's sign."""


#: Ratio of the works of states that a way keeps, at least.
APART = 1.6


@dataclass
class Way:
    """A path that was followed, for others to take up.

    Attributes:
        states: Some of the points passed, with works that rise.
        last: Load factor of the last point passed.
        fallen: By how much the load factor was below its highest so far, at most.
    """

    states: list[State] = field(default_factory=list)
    last: float = np.nan
    fallen: float = 0.0
    _highest: float = -np.inf

    def passed(self, point: PathPoint) -> None:
        """Take note of a point."""
        if not self.states or point.work >= APART * self.states[-1].work:
            self.states.append(point.state)
        self.last = point.iterate.load_factor
        self._highest = max(self._highest, self.last)
        self.fallen = max(self.fallen, self._highest - self.last)


class Record:
    """Attempts and path of one load case, while it is solved.

    Attributes:
        attempts: In order.
        trace: Points passed, in order.
        last: Makes a state of the point passed last; None before the first.
        best: The `Collapse` that a search had found when it was stopped; else None.
        ways: The last path of every phase.
        exhausted: Limit that ended the search, in units of one factorisation; 0 if none did.
    """

    def __init__(
        self,
        unit: float = 1.0,
        sign: float = 1.0,
        listener: Listener | None = None,
    ) -> None:
        """Begin with nothing.

        Args:
            unit: sum |f_L|, N per metre of thickness.
            sign: Of the live load in this load case: load factors in words have the user's sign.
            listener: Is told how it goes.
        """
        self._unit = unit
        self._sign = sign
        self._listener = listener or Listener()
        self.attempts: list[Trial] = []
        self.trace: list[TracePoint] = []
        self.last: Callable[[], State] | None = None
        self.best: Any = None
        self.ways: dict[str, Way] = {}
        self.exhausted = 0.0

    def reversed(self) -> Record:
        """A record for the reversed live load: it shares the attempts, not the path."""
        new = Record(self._unit, -self._sign)
        new.attempts = self.attempts
        return new

    @contextmanager
    def attempt(
        self, name: str, work: float, count: Callable[[], int], effort: Effort
    ) -> Iterator[Any]:
        """Record what is done inside as one attempt.

        Args:
            name: Of the attempt.
            work: T of the state that is looked for.
            count: Number of factorisations so far.
            effort: Their cost so far.

        Yields:
            A function to be called with the outcome in words, once a state is found.
        """
        before = count()
        spent = effort.spent
        points = len(self.trace)
        found: list[str] = []
        outcome = "ended early"
        try:
            yield found.append
            outcome = found[-1]
        except SolverError as error:
            outcome = f"{self._where(points)}{error}"
            raise
        except Stopped as stop:
            outcome = f"{self._where(points)}{stop}"
            raise
        finally:
            costs = count() - before, effort.spent - spent
            self.attempts.append(Trial(name, work, outcome, bool(found), *costs))

    def along(
        self, phase: str, prolonged: Callable[[State], State] = lambda state: state
    ) -> Callable[[PathPoint], None]:
        """A function that records every point of a path that it is called with.

        Args:
            phase: What is followed.
            prolonged: Makes a state of the structure of one of the path's.
        """
        way = self.ways[phase] = Way()

        def passed(point: PathPoint) -> None:
            way.passed(point)
            found = partial(prolonged, point.state)
            self.passed(phase, point.iterate.load_factor, point.work, found)

        return passed

    @property
    def rise_on_modes(self) -> Way | None:
        """The rise on block modes that led to the collapse; None if something else did."""
        led = [trial.name for trial in self.attempts if trial.found][-1:] == ["along block modes"]
        return self.ways.get("block modes, rising work") if led else None

    def passed(
        self, phase: str, load_factor: float, work: float, state: Callable[[], State]
    ) -> None:
        """Record a point of a path; `state` makes a state of it, if it is asked for."""
        self.trace.append(TracePoint(phase, load_factor, work, work / self._unit))
        self.last = state
        self._listener.passed(replace(self.trace[-1], load_factor=self._sign * load_factor))

    def phase(self, name: str) -> None:
        """Tell the listener that something else begins."""
        self._listener.phase(name)

    def _where(self, first: int) -> str:
        """Phase and place of the last point passed, if any was since the first."""
        if len(self.trace) <= first:
            return ""
        last = self.trace[-1]
        factor = f"{self._sign * last.load_factor:.4g}"
        return f"{last.phase}, at load factor {factor}, displacement {last.displacement:.3g} m: "
