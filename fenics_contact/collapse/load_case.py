"""A load case and its path: the load factor lambda(T) as the work T of the live load rises.

A load case is one direction of the live load on a structure, as all ways to its collapse see it.
It has one path for all that is asked. Its points have small products mu > 0 (`kkt`), on block modes
or on the structure itself; a point is *settled* where the products go to zero on the structure. The
collapse is settled at the end of the path, the most it carries at its top, and the capacity curve
at given works.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from fenics_contact.collapse.record import Listener, PathSample, Record
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.discretization.discretization import Bonded, Discretization, typical_sizes
from fenics_contact.geometry.mesh import Flags
from fenics_contact.results.history import History, Step
from fenics_contact.results.values import JointValues
from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers.arclength import (
    FALLING_PRODUCTS,
    RISING_WORK,
    Continuation,
    PathPoint,
)
from fenics_contact.solvers.block_modes import BlockModes
from fenics_contact.solvers.interior_point import Solution, Tolerances
from fenics_contact.solvers.joint_stiffness import JointStiffness
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import Array, ContactProblem, Scales, State
from fenics_contact.workers import InPlace, check_asked_to_stop

#: Continuation of conditions `PerturbedKKT`; to replace the method, replace it here.
falling = partial(Continuation, path=FALLING_PRODUCTS)
rising = partial(Continuation, path=RISING_WORK)

#: Displacements expected, in units of the largest movement of a support: mechanisms multiply it.
MOVED = 10.0


@dataclass(frozen=True)
class LoadCase:
    """A structure under its dead load and one direction of its live load.

    Attributes:
        discretization: The scene's matrices.
        problem: The structure with the live load in this direction.
        blocks: Rigid-block programs of this direction.
        bonded: Response with all joints closed, to the live load in this direction.
        scales: Typical sizes on the elastic part of the path.
        monitor: Told every iteration.
        stiffness: K with joint springs.
        sign: 1 for the live load as given, -1 for that load reversed.
        record: What is tried for this load case.
        beside: Does tasks beside it.
    """

    discretization: Discretization
    problem: ContactProblem
    blocks: RigidBlocks
    bonded: Bonded
    scales: Scales
    monitor: Callable[[Step], None]
    stiffness: JointStiffness
    sign: float = 1.0
    record: Record = field(default_factory=Record)
    beside: Executor = field(default_factory=InPlace)

    @classmethod
    def of(
        cls,
        discretization: Discretization,
        bonded: Bonded,
        sign: float,
        monitor: Callable[[Step], None],
        listener: Listener | None = None,
    ) -> LoadCase:
        """The live load as given (sign 1), like that of `bonded`, or reversed (-1), here only.

        The monitor is told every iteration, the listener every point of a path.
        """
        problem = replace(discretization.problem, live=sign * discretization.problem.live)
        loads = replace(discretization.problem, dead=discretization.elasticity.dead)
        scales = typical_sizes(loads, bonded)
        if discretization.scene.dead.movement:
            moved = MOVED * problem.max(np.abs(problem.law.origins))
            scales = replace(scales, displacement=max(scales.displacement, moved))
        # A tie may stretch by far more than the blocks strain before it yields.
        stretched = 2.0 * problem.max(problem.law.pull * problem.compliance[1])
        scales = replace(scales, displacement=max(scales.displacement, stretched))
        bonded = replace(bonded, live=sign * bonded.live)
        blocks = RigidBlocks.of(discretization, sign, discretization.effort.wait)
        stiffness = discretization.stiffness
        made = cls(discretization, problem, blocks, bonded, scales, monitor, stiffness, sign)
        return replace(made, record=Record(problem.sum(np.abs(problem.live)), sign, listener))

    def reversed(self) -> LoadCase:
        """The same structure under the opposite live load."""
        given = replace(self.bonded, live=self.sign * self.bonded.live)
        case = LoadCase.of(self.discretization, given, -self.sign, self.monitor)
        problem = case.problem.with_law(slip_origin=self.problem.law.slip_origin)
        record = self.record.reversed()
        return replace(case, problem=problem, record=record)

    def with_unbonded(self, unbonded: Flags) -> LoadCase:
        """The load case with joint points that have lost their strengths, of all points."""
        whole = self.discretization.with_(unbonded=unbonded)
        given = replace(self.bonded, live=self.sign * self.bonded.live)
        case = LoadCase.of(whole, given, self.sign, self.monitor)
        return replace(case, record=self.record)

    @property
    def unrecorded(self) -> LoadCase:
        """The same with a record of its own, which nobody reads."""
        return replace(self, record=Record())

    @property
    def wait(self) -> Callable[[], None]:
        """What tasks ask now and then whether to go on; it raises `Stopped`."""
        here = isinstance(self.beside, InPlace)
        return self.discretization.effort.wait if here else check_asked_to_stop

    def written(self, state: State) -> State:
        """A state with its displacements u in place of u - u_d, and the work on these."""
        if not self.discretization.scene.dead.movement:
            return state
        state = self.discretization.with_imposed(state)
        return replace(state, work=self.problem.dot(self.problem.live, state.displacement))

    @property
    def bonded_work(self) -> float:
        """Work of the live load on the bonded structure, times the typical load factor: a unit."""
        return self.scales.load_factor * self.problem.dot(self.problem.live, self.bonded.live)

    @property
    def block_count(self) -> int:
        """Number of blocks."""
        return len(self.discretization.bodies.centre)

    @property
    def has_dead_load(self) -> bool:
        """Whether loads act, or supports move, without the live load."""
        loaded = self.problem.max(np.abs(self.problem.dead)) > 0.0
        return loaded or bool(self.discretization.scene.dead.movement)

    @property
    def first_pressure(self) -> Array:
        """Normal forces for the first bound on friction: of the dead load if it causes any."""
        if self.problem.max(self.bonded.dead_pressure) > 0.0:
            return self.bonded.dead_pressure
        return self.bonded.live_pressure

    def scales_at(self, work: float, largest_factor: float = 0.0) -> Scales:
        """Typical sizes at a work T of the live load; joint forces grow with the largest factor."""
        displacement = work / self.problem.sum(np.abs(self.problem.live))
        larger = max(1.0, largest_factor / self.scales.load_factor)
        return replace(self.scales, displacement=displacement, force=larger * self.scales.force)

    def bonded_state(self, work: float) -> State:
        """The bonded response to the live load that does work T, with the dead load's pressure."""
        u = work / self.bonded_work * self.scales.load_factor * self.bonded.live
        pressure = self.bonded.dead_pressure
        none = np.zeros_like(pressure)
        return State(u, self.problem.elastic_part(u), 0.0, pressure, none, work)

    def coulomb(
        self, work: float, scales: Scales, load_factor: float | None = None
    ) -> PerturbedKKT:
        """Conditions of a state with the friction of the scene's laws."""
        problem = self.problem
        if not problem.coulomb:
            return self.given(problem.law.strength, work, scales, load_factor)
        return PerturbedKKT.coulomb(problem, self.stiffness, scales, work, load_factor)

    def given(
        self, bound: Array, work: float, scales: Scales, load_factor: float | None = None
    ) -> PerturbedKKT:
        """Conditions of a state with a given bound on friction, N per metre of thickness."""
        problem = self.problem
        stiffness = self.stiffness
        return PerturbedKKT.given_friction(problem, stiffness, scales, bound, work, load_factor)


def joint_values(
    problem: ContactProblem, whole: Discretization, state: State, mode: Array
) -> JointValues:
    """Values at all joint points of a state and its mode, on all ranks together.

    Slips are measured from the origin that `whole` has, whichever `problem` has.
    """
    length = whole.joints.length
    gather = whole.all_points
    bond = gather(problem.law.bond)
    normal = gather(state.pressure) - bond
    shear = gather(state.shear)
    gap = problem.openings(state.displacement) - problem.law.apart
    slip = whole.problem.motion_of(state)[1]
    return JointValues(
        normal_force=normal,
        shear_force=shear,
        pressure=normal / length,
        shear=shear / length,
        gap=gather(gap),
        slip=gather(slip),
        opening_rate=gather(problem.normal @ mode),
        slip_rate=gather(problem.tangential @ mode),
        clearance_rate=gather(problem.clearance_rates(mode)),
        bond=bond,
    )


@dataclass(frozen=True)
class Task:
    """What an attempt is asked for.

    Attributes:
        case: The load case.
        work: T, N m per metre of thickness.
        scales: Typical sizes at that work.
        tolerance: On the load factor, relative.
        last: A state at less work, if there is one.
    """

    case: LoadCase
    work: float
    scales: Scales
    tolerance: float
    last: State | None = None

    def mu(self, products: float) -> float:
        """Products in units of force times displacement, given those by elastic displacement."""
        return products * self.scales.elastic_part

    @property
    def tolerances(self) -> Tolerances:
        """How exact the state has to be for the load factor."""
        if not self.case.problem.coulomb:
            return Tolerances()  # converges to rounding at once
        residual = float(np.clip(1e-3 * self.tolerance, 1e-12, 1e-9))
        return Tolerances(residual, 5e-2 * self.tolerance)

    @property
    def kkt(self) -> PerturbedKKT:
        """Conditions of the state."""
        return self.case.coulomb(self.work, self.scales)


#: What an attempt answers, and what leads from a task to it.
Answer = tuple[Solution, History]
Attempt = Callable[[Task], Answer]


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
            stiffness = modes.stiffness(task.case.discretization.mode_tally)
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
