"""What is done for one load case, as data: attempts, the path that is followed, its last point."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from fenics_contact.errors import SolverError, Stopped
from fenics_contact.solvers.arclength import PathPoint
from fenics_contact.solvers.effort import Effort
from fenics_contact.solvers.problem import State


@dataclass(frozen=True)
class Trial:
    """One attempt to find a state.

    Attributes:
        name: Of the attempt.
        work: T of the state that was looked for, N m per metre of thickness.
        outcome: How it ended, in words.
        found: Whether a state was found, verified or not.
        factorizations: Numeric factorisations spent.
        cost: The same in units of one factorisation of the structure.
    """

    name: str
    work: float
    outcome: str
    found: bool
    factorizations: int
    cost: float


@dataclass(frozen=True)
class TracePoint:
    """Point of a path on the way to a collapse; its products are not zero, so it is no state yet.

    Attributes:
        phase: What is followed: on block modes or on the structure, with what varying.
        load_factor: lambda.
        work: T = f_L.u, N m per metre of thickness.
        displacement: T / sum |f_L|, m: mean displacement along the live load as it acts.
    """

    phase: str
    load_factor: float
    work: float
    displacement: float


class Record:
    """Attempts and path of one load case, while it is solved.

    Attributes:
        attempts: In order.
        trace: Points passed, in order.
        last: Makes a state of the point passed last; None before the first.
    """

    def __init__(
        self,
        unit: float = 1.0,
        sign: float = 1.0,
        told: Callable[[TracePoint], None] = lambda point: None,
    ) -> None:
        """Begin with nothing.

        Args:
            unit: sum |f_L|, N per metre of thickness.
            sign: Of the live load in this load case: load factors in words have the user's sign.
            told: Called with every point passed, its load factor in the user's sign.
        """
        self._unit, self._sign, self._told = unit, sign, told
        self.attempts: list[Trial] = []
        self.trace: list[TracePoint] = []
        self.last: Callable[[], State] | None = None

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
        before, spent, points = count(), effort.spent, len(self.trace)
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

        def passed(point: PathPoint) -> None:
            factor, work = point.iterate.load_factor, point.work
            self.trace.append(TracePoint(phase, factor, work, work / self._unit))
            self.last = partial(prolonged, point.state)
            self._told(replace(self.trace[-1], load_factor=self._sign * factor))

        return passed

    def _where(self, first: int) -> str:
        """Phase and place of the last point passed, if any was since the first."""
        if len(self.trace) <= first:
            return ""
        last = self.trace[-1]
        factor = f"{self._sign * last.load_factor:.4g}"
        return f"{last.phase}, at load factor {factor}, displacement {last.displacement:.3g} m: "
