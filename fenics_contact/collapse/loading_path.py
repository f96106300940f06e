"""The loading path: the load factor lambda(T) as the work T of the live load rises.

There is one path for all that is asked. Its points have small products mu > 0 (`kkt`), on block
modes or on the structure itself; a point is *settled* where the products go to zero on the
structure. The collapse is settled at the end of the path, the most it carries at its top, and the
capacity curve at given works.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from fenics_contact.collapse.load_case import Task
from fenics_contact.collapse.record import PathSample
from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers.arclength import (
    FALLING_PRODUCTS,
    RISING_WORK,
    Continuation,
    PathPoint,
)
from fenics_contact.solvers.block_modes import BlockModes
from fenics_contact.solvers.joint_stiffness import GENERAL
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import State

#: Continuation of conditions `PerturbedKKT`; to replace the method, replace it here.
falling = partial(Continuation, path=FALLING_PRODUCTS)
rising = partial(Continuation, path=RISING_WORK)


class LoadingPath:
    """The path of one structure, which ends at the work of a task.

    Attributes:
        task: Its end, with the sizes by which steps are measured.
    """

    def __init__(self, task: Task, modes: BlockModes | None = None, name: str = "") -> None:
        """Take block modes, or else the structure itself; points are recorded under a name."""
        self.task = task
        self._modes = modes
        self._name = name
        self._kkt = task.kkt
        if modes is not None:
            stiffness = modes.stiffness(GENERAL, task.case.discretization.mode_tally)
            self._kkt = PerturbedKKT.coulomb(modes.reduced, stiffness, task.scales, task.work)

    @classmethod
    def on_modes(cls, task: Task, name: str = "") -> LoadingPath:
        """The path of the block modes of a task."""
        return cls(task, task.case.discretization.block_modes.changed(task.case.problem), name)

    def prolonged(self, state: State) -> State:
        """A state of the path as one of the structure."""
        return state if self._modes is None else self._modes.prolonged(state)

    def begin(self, work: float, mu: float) -> PathPoint:
        """The point next to the bonded response that does some work."""
        start = self.task.case.bonded_state(work)
        return self.next_to(start if self._modes is None else self._modes.restricted(start), mu)

    def next_to(self, state: State, mu: float) -> PathPoint:
        """The point with products mu next to a state."""
        return rising(self._kkt).begin(state, mu)

    def points(
        self,
        start: PathPoint,
        work: float | None = None,
        options: SearchOptions = SEARCH,
        levels: bool = False,
    ) -> Iterator[PathSample]:
        """Points at rising work, one for each step, recorded as they are passed.

        Args:
            start: A point near the path.
            work: T where the path ends; that of the task by default.
            options: Numbers of its steps.
            levels: Whether points tell their load factor with products zero.

        Yields:
            Points with d(lambda)/dT; the last one, without it, is the end.
        """
        path = rising(self._kkt, options=options)
        for point in self._recorded(path, start, self.task.work if work is None else work, "work"):
            on_the_way = levels and math.isfinite(point.rate)
            yield PathSample.of(point, path.without_products(point) if on_the_way else math.nan)

    def with_products(
        self, point: PathPoint, mu: float, options: SearchOptions = SEARCH
    ) -> PathPoint:
        """The point at the same work with smaller products."""
        path = falling(replace(self._kkt, work=point.work), options=options)
        *_, last = self._recorded(path, point, mu, "products")
        return last

    def _recorded(
        self, path: Continuation, start: PathPoint, end: float, varies: str
    ) -> Iterator[PathPoint]:
        record = self.task.case.record
        name = f"{self._name}, {'rising' if varies == 'work' else 'falling'} {varies}"
        for point in path.points(start, end):
            if self._name and math.isfinite(point.rate):
                state: Callable[[], State] = partial(self.prolonged, point.state)
                record.passed(name, point.iterate.load_factor, point.work, state)
            yield point
