"""What is done for one load case, as data: attempts, the path that is followed, its last point."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from fenics_contact.errors import SolverError, Stopped
from fenics_contact.results.history import TracePoint, Trial
from fenics_contact.solvers.arclength import PathPoint
from fenics_contact.solvers.effort import Effort
from fenics_contact.solvers.problem import State


class Listener:
    """Is told how the search for a collapse goes, on all ranks; this one does not listen."""

    def phase(self, name: str) -> None:
        """Something else begins."""

    def passed(self, point: TracePoint) -> None:
        """A point of the path was passed; its load factor has the user's sign."""


@dataclass(frozen=True)
class Sample:
    """A point of the loading path: T, N m per metre of thickness, lambda, d(lambda)/dT, state."""

    work: float
    load_factor: float
    slope: float
    state: State

    def at(self, work: float) -> float:
        """Load factor on the tangent."""
        return self.load_factor + self.slope * (work - self.work)

    def meets(self, right: Sample) -> float:
        """Work at which the tangents of two samples meet, between them."""
        if not self.slope > right.slope:
            return 0.5 * (self.work + right.work)
        ahead = right.at(self.work) - self.load_factor
        return min(max(self.work + ahead / (self.slope - right.slope), self.work), right.work)


@dataclass(frozen=True)
class PathSample(Sample):
    """A sample with products above zero, of block modes or of the structure.

    Attributes:
        point: The point of the continuation.
        level: lambda with products zero, to first order; nan if it was not asked for.
    """

    point: PathPoint
    level: float = math.nan

    @classmethod
    def of(cls, point: PathPoint, level: float = math.nan) -> PathSample:
        """A point of a continuation, of its end without slope."""
        slope = point.rate / point.work
        return cls(point.work, point.iterate.load_factor, slope, point.state, point, level)

    @property
    def on_the_way(self) -> bool:
        """Whether the path goes on from it."""
        return math.isfinite(self.slope)


class Record:
    """Attempts and path of one load case, while it is solved.

    Attributes:
        attempts: In order.
        trace: Points passed, in order.
        last: Makes a state of the point passed last; None before the first.
        best: The `Collapse` that a search had found when it was stopped; else None.
        risen: Samples of the path on block modes that led to a state, as the work rose.
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
        self.risen: list[PathSample] = []
        self.exhausted = 0.0

    def reversed(self) -> Record:
        """A record for the reversed live load: it shares the attempts, not the path."""
        new = Record(self._unit, -self._sign)
        new.attempts = self.attempts
        return new

    @contextmanager
    def attempt(
        self, attempt: Callable[..., Any], work: float, count: Callable[[], int], effort: Effort
    ) -> Iterator[Any]:
        """Record what is done inside as one attempt.

        Args:
            attempt: Has the name of its function, in words.
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
        name = getattr(attempt, "func", attempt).__name__.replace("_", " ")
        try:
            yield found.append
            outcome = found[-1]
        except (SolverError, Stopped) as error:
            outcome = str(error)
            if len(self.trace) > points:  # phase and place of the last point passed
                last = self.trace[-1]
                at = f"{last.phase}, at load factor {self._sign * last.load_factor:.4g}"
                outcome = f"{at}, displacement {last.displacement:.3g} m: {error}"
            raise
        finally:
            costs = count() - before, effort.spent - spent
            self.attempts.append(Trial(name, work, outcome, bool(found), *costs))

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
