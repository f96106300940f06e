"""Factorisations: how many were done, how many more may be done, and who may stop a run there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from fenics_contact.errors import EffortError, Stopped
from fenics_contact.parallel import MPI

#: Part of a factorisation by which sums of costs may be rounded.
ROUNDING = 1e-6


class Watch:
    """Ends a run before a factorisation, on all ranks together.

    Attributes:
        reason: Why it ended, the same on all ranks; empty while it may go on.
    """

    def __init__(self, comm: MPI.Comm | None = None, asked: Callable[[], str] = lambda: "") -> None:
        """Begin to watch.

        Args:
            comm: Ranks that end together; None for this one alone.
            asked: Says why this rank wants the run to end; empty while it does not.
        """
        self._comm = comm
        self._asked = asked
        self.reason = ""

    def __call__(self) -> None:
        """Collective.

        Raises:
            Stopped: On all ranks, if any of them has a reason.
        """
        if not self.reason:
            self.reason = self._asked()
            if self._comm is not None and self._comm.size > 1:
                self.reason = self._of_all_ranks(self._comm)
        if self.reason:
            raise Stopped(self.reason)

    def alone(self) -> None:
        """As a call, for this rank alone: somebody has to tell the others."""
        reason = self.reason or self._asked()
        if reason:
            raise Stopped(reason)

    def _of_all_ranks(self, comm: MPI.Comm) -> str:
        """The reason of the first rank that has one."""
        if not comm.allreduce(bool(self.reason), MPI.LOR):
            return ""
        return next(filter(None, comm.allgather(self.reason)))


class Effort:
    """Cost of all factorisations of a run, with a hard limit.

    Attributes:
        spent: Cost so far, in units of one factorisation of the structure.
        watch: Asked before every factorisation, on all ranks.
        allowed: Cost that the tightest limit allows in all; infinite where there is none.
    """

    def __init__(self) -> None:
        self.spent = 0.0
        self.watch = Watch()
        self._limit = math.inf
        self.allowed = math.inf

    @property
    def left(self) -> float:
        """Cost that may still be spent."""
        return self._limit - self.spent

    def spend(self, cost: float) -> None:
        """Ask for one more factorisation, before it is done.

        Args:
            cost: In units of one factorisation of the structure.

        Raises:
            EffortError: If the limit does not allow it.
            Stopped: If the run is to end.
        """
        self.watch()
        self.require(cost)
        self.spent += cost

    def require(self, cost: float) -> None:
        """Raise `EffortError` unless so much may still be spent.

        Asked after a `SolverError`, as loops may take the limit for a failure of their own.
        """
        if cost > self.left + ROUNDING:
            raise EffortError(f"the limit of {self.allowed:.4g} factorisations is reached")

    def wait(self) -> None:
        """Ask whether to wait on for something that this rank does alone; raises `Stopped`."""
        self.watch.alone()

    @contextmanager
    def unwatched(self) -> Iterator[None]:
        """Nothing inside is ended: what was found before the run was stopped is put together."""
        watch = self.watch
        self.watch = Watch()
        try:
            yield
        finally:
            self.watch = watch

    @contextmanager
    def at_most(self, cost: float) -> Iterator[None]:
        """Limit what is spent inside; limits nest, and the tightest one counts."""
        before = self._limit, self.allowed
        if self.spent + cost < self._limit:
            self._limit = self.spent + cost
            self.allowed = cost
        try:
            yield
        finally:
            self._limit, self.allowed = before


@dataclass
class Tally:
    """Number of numeric factorisations of one kind so far.

    Attributes:
        cost: Of one, in units of one factorisation of the structure.
        effort: Where the cost is summed up and limited.
        count: How many.
    """

    cost: float
    effort: Effort
    count: int = 0

    def add(self) -> None:
        """Count one more; raises as `Effort.spend` does."""
        self.effort.spend(self.cost)
        self.count += 1

    def restart(self) -> None:
        """Count from 0."""
        self.count = 0
