"""Collapse states next to another one, on a structure that differs a little.

What differs is the compliance of hinges (`hinge_nodes`), or the degree of the displacements
(`other_degree`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from fenics_contact.collapse.load_case import Attempt, LoadCase, Task
from fenics_contact.collapse.strategy import (
    Strategy,
    WarmStart,
    WorkOptions,
    along_block_modes,
    falling,
    monolithic,
    moved_on,
    next_to,
)
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.joints import GROUND
from fenics_contact.errors import SolverError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.mesh_error.hinge_nodes import HingeNodes
from fenics_contact.results.joint_values import JointValues
from fenics_contact.results.result import Collapse
from fenics_contact.solvers.arclength import ArclengthOptions
from fenics_contact.solvers.interior_point import (
    InteriorPointOptions,
    Solution,
    Tolerances,
    solve_interior_point,
)
from fenics_contact.solvers.joint_stiffness import GENERAL
from fenics_contact.solvers.kkt import COLD, KKTOptions, Residual
from fenics_contact.solvers.nonlinear_elimination import EliminationOptions
from fenics_contact.solvers.problem import Owner, State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class Settling:
    """Numbers of the way to more compliant hinges.

    Joints go to the central path with large products, a few at a time on their laws (`arclength`):
    which of them open and slide changes at once. From there the interior point method is short.

    Attributes:
        products: Of that path, in units of force times elastic displacement.
        give: Displacements that change joint forces by their own size, in units of those at the
            work: those of hinges. In larger units they would look settled from the start.
        path: Steps to the path: most joints stay as they are, few have to be followed. Where one
            is left farther from its law than a step allows, no state is near.
        close: Distance from the path that is near enough, relative to p and q.
        tolerances: How exact the state has to be: an estimate needs three digits.
        tolerance: On its load factor, relative; changes below it are none. One work is enough.
        kkt: Of the Newton steps. Equilibrium is as exact as the certificate asks; five digits that
            a direction loses are left to the next one.
        finish: When the interior point method stops: it succeeds soon or not at all.
    """

    products: float = 1e-2
    give: float = 3e-3
    path: ArclengthOptions = field(
        default_factory=lambda: ArclengthOptions(
            corrections=2, elimination=EliminationOptions(points=12, late=8, rounds=4)
        )
    )
    close: float = 0.2
    tolerances: Tolerances = field(default_factory=lambda: Tolerances(1e-8, 1e-5))
    tolerance: float = 1e-5
    kkt: KKTOptions = field(
        default_factory=lambda: KKTOptions(cancellation=1e5, equilibrium_weight=2e-2)
    )
    finish: InteriorPointOptions = field(default_factory=lambda: InteriorPointOptions(40, window=3))


@dataclass(frozen=True)
class NearbyOptions:
    """Numbers of the search for a state next to another one.

    Attributes:
        near: Where the interior point method starts, how exact its states are, and when it stops:
            it succeeds soon or not at all.
        hinges: How joints settle where hinges are more compliant.
        work: How the work grows: where no state is near, none is looked for.
        same_mode: Cosine of the angle between two modes that are those of one collapse state.
        rate: Products with which a state changes with its hinges, in units of force times
            displacement.
    """

    near: WarmStart = field(
        default_factory=lambda: WarmStart(
            (3e-3,), (), Tolerances(1e-9, 1e-6), InteriorPointOptions(40, window=8)
        )
    )
    hinges: Settling = field(default_factory=Settling)
    work: WorkOptions = field(
        default_factory=lambda: WorkOptions(first_of_many=0.0, largest=10.0, missing=1, asks=False)
    )
    same_mode: float = 0.9999
    rate: float = 1e-10


OPTIONS = NearbyOptions()


@dataclass(frozen=True)
class Start:
    """How a collapse is looked for from another one, on a structure that differs.

    Attributes:
        name: For the log.
        attempt: At one work, from the other collapse.
        work: How the work grows.
        more_work: The first work grows by this for each halving: hinges store elastic energy.
        tolerance: On the load factor, relative.
    """

    name: str
    attempt: Callable[[Collapse], Attempt]
    work: WorkOptions
    more_work: float = 1.0
    tolerance: float = 1e-6


def _near(last: Collapse) -> Attempt:
    """The interior point method from the collapse."""
    if last.state is None:
        raise SolverError("no state to start from")
    return next_to(last.state, last.mode, OPTIONS.near)


def _softer(last: Collapse) -> Attempt:
    """The same where hinges are more compliant: joints settle first."""
    if last.state is None:
        raise SolverError("no state to start from")
    return partial(_settled_next_to, state=last.state, direction=last.mode)


@monolithic
def _settled_next_to(task: Task, state: State, direction: Array | None) -> Solution:
    """The state next to another one, from the central path with large products."""
    options = OPTIONS.hinges
    kkt = task.kkt
    give = replace(kkt.scales, displacement=options.give * kkt.scales.displacement)
    path = falling(replace(kkt, scales=give), options=options.path)
    mu = task.mu(options.products)
    point = path.begin(moved_on(task, state, direction), mu / options.give)
    point = path.settled(point, options.close)
    if path.distance(point) > options.path.elimination.allowed:
        raise SolverError("joints do not settle next to the state")
    kkt = replace(kkt, options=options.kkt)
    return solve_interior_point(kkt, point.state, mu, options.tolerances, options.finish)


def _from_afar(_: Collapse) -> Attempt:
    """The ordinary way from the bonded structure."""
    return along_block_modes


near = Start("near", _near, OPTIONS.work)
#: One work is enough, where the last state had it.
softer = Start(
    "softer", _softer, replace(OPTIONS.work, largest=1.0), tolerance=OPTIONS.hinges.tolerance
)
#: Paths to less work are shorter.
from_afar = Start("from afar", _from_afar, OPTIONS.work, more_work=0.1)


@dataclass(frozen=True)
class Softened:
    """Hinges with the compliance of so many halvings of their elements.

    Attributes:
        points: Joint points.
        halvings: m.
    """

    points: Indices
    halvings: float = 0.0

    @property
    def anywhere(self) -> bool:
        """Whether some hinge is more compliant than its mesh."""
        return len(self.points) > 0 and self.halvings > 0.0

    def nodes(self, whole: Discretization) -> HingeNodes:
        """Nodes at the hinges."""
        nodes = whole.joints.nodes[self.points]
        return HingeNodes.of(whole, nodes[nodes != GROUND])


@contextmanager
def softened(case: LoadCase, soft: Softened) -> Iterator[LoadCase]:
    """A load case with more compliant hinges, that tells nobody how its solves go."""
    silent = replace(case, monitor=lambda step: None)
    if not soft.anywhere:
        yield silent
        return
    with _with_nodes(silent, soft.nodes(case.discretization), soft.halvings) as softer:
        yield softer


@contextmanager
def _with_nodes(case: LoadCase, hinge_nodes: HingeNodes, halvings: float) -> Iterator[LoadCase]:
    """A load case with the compliance of so many halvings at nodes."""
    with Owner() as owner:
        problem = hinge_nodes.soften(case.problem, halvings, owner)
        stiffness = owner.enter_context(
            case.discretization.stiffness_with(problem.stiffness, GENERAL)
        )
        yield replace(case, kind=GENERAL, problem=problem, stiffness=stiffness)


def on_mesh(case: LoadCase, end: Collapse, soft: Softened) -> Collapse:
    """A collapse with compliant hinges, with the displacements of the blocks' meshes.

    Those of the state found are of the joints' side of the hinges: beside a node with the
    compliance of many halvings they would give stresses that no block has.
    """
    if end.state is None:
        return end
    forces = case.problem.acting_forces(end.state)
    first = case.problem.stiffness.first_row // 2
    give = soft.nodes(case.discretization).indentation(forces, soft.halvings, first)
    u = end.state.displacement - give
    elastic = end.state.elastic - case.problem.elastic_part(give)
    return replace(end, state=replace(end.state, displacement=u, elastic=elastic))


def collapse_next_to(case: LoadCase, last: Collapse, soft: Softened, start: Start) -> Collapse:
    """The verified collapse next to another one, with the compliance of hinges."""
    with softened(case, soft) as softer:
        return _next_to(softer, last, soft, start)


def collapse_and_rate(
    case: LoadCase, last: Collapse, soft: Softened, start: Start
) -> tuple[Collapse, float]:
    """The collapse as `collapse_next_to` finds it, and d(lambda)/dm there.

    The rate is nan where the load factor does not change, and where it is not known.
    """
    silent = replace(case, monitor=lambda step: None)
    hinge_nodes = soft.nodes(case.discretization)
    with _with_nodes(silent, hinge_nodes, soft.halvings) as softer:
        found = _next_to(softer, last, soft, start)
        change = abs(found.load_factor - last.load_factor)
        if found.status != "limit" or change <= OPTIONS.hinges.tolerance * last.size:
            return found, np.nan
        try:
            return found, _rate(case, softer, found, hinge_nodes)
        except SolverError as error:
            _log.info("  no rate: %s", error)
            return found, np.nan


def _next_to(case: LoadCase, last: Collapse, soft: Softened, start: Start) -> Collapse:
    """The verified collapse next to another one, in a case with more compliant hinges."""
    first = start.work.first * (1.0 + start.more_work * soft.halvings)
    work = replace(start.work, first=max(last.work_ratio, first))
    strategy = Strategy((start.attempt(last),), GENERAL, work=work)
    found = find_collapse(case, strategy, start.tolerance)
    text = "  %g halvings, degree %d, %s: %s, load factor %.8g"
    degree = case.discretization.scene.degree
    _log.info(text, soft.halvings, degree, start.name, found.status, found.load_factor)
    return found


def _rate(case: LoadCase, softer: LoadCase, found: Collapse, hinge_nodes: HingeNodes) -> float:
    """d(lambda)/dm of a collapse for m halvings of the elements at all its hinges.

    One halving more indents the nodes of hinges by C f, f the joint forces on them. That opens and
    shifts joints by B_N C f and B_T C f: a residual of the conditions, which Newton's equations at
    the state take away. They are those of a state along the mode: at the onset a joint is about to
    close, or to stick.

    Raises:
        SolverError: If the equations are singular.
    """
    state = found.state
    mode = found.mode
    problem = softer.problem
    if state is None or mode is None:
        return np.nan
    forces = case.problem.acting_forces(state)
    give = hinge_nodes.indentation(forces, 1.0, problem.stiffness.first_row // 2)
    work = found.work_ratio * softer.bonded_work
    u = state.displacement + (work - state.work) * mode
    along = problem.state(u, state.load_factor, state.pressure, state.shear)
    kkt = softer.coulomb(work, softer.scales_at(work, abs(state.load_factor)))
    linear = kkt.linearize(kkt.on_central_path(along, OPTIONS.rate, COLD))
    moved = -(problem.normal @ give), -(problem.tangential @ give)
    residual = Residual(np.zeros_like(u), *moved, 0.0)
    (change,) = linear.directions([(residual, np.zeros((3, len(moved[0]))))])
    return change.load_factor


def same_mode(one: Array, other: Array) -> bool:
    """Whether the joints of two collapse states move alike, by their rates."""
    cosine = float(np.sum(one * other)) / (np.linalg.norm(one) * np.linalg.norm(other))
    return bool(cosine > OPTIONS.same_mode)


def rates(values: JointValues) -> Array:
    """Opening and slip rates of all joint points, shape (2, points)."""
    return np.stack([values.opening_rate, values.slip_rate])
