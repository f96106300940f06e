"""Collapse states next to another one, on a structure that differs a little.

What differs is the compliance of hinges (`hinge_nodes`), or the degree of the displacements
(`other_degree`).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from fenics_contact.analysis.collapse_mode import elastic_mode
from fenics_contact.analysis.joint_values import JointValues, joint_values
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.result import Collapse
from fenics_contact.analysis.strategy import (
    Attempt,
    Strategy,
    Task,
    WarmStart,
    WorkOptions,
    next_to,
)
from fenics_contact.analysis.work_control import find_collapse
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.hinge_nodes import HingeNodes
from fenics_contact.discretization.joints import GROUND
from fenics_contact.errors import SolverError
from fenics_contact.mesh import Array, Indices
from fenics_contact.solvers.interior_point import InteriorPointOptions, Tolerances
from fenics_contact.solvers.joint_stiffness import GENERAL
from fenics_contact.solvers.problem import Owner

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class NearbyOptions:
    """Numbers of the search for a state next to another one.

    Attributes:
        warm: Where the interior point method starts, and how exact its states are.
        farther: Products from which it starts where it finds nothing.
        rough: The same where a tenth of the change of the load factor is exact enough.
        more_work: The first work grows by this for each halving: hinges store elastic energy.
        work: How the work grows: where no state is near, none is looked for.
        tolerance: On the load factor, relative.
        same_mode: Cosine of the angle between two modes that are those of one collapse state.
    """

    warm: WarmStart = field(
        default_factory=lambda: WarmStart(
            (3e-3,), (), Tolerances(1e-10, 1e-7), InteriorPointOptions(40, window=12)
        )
    )
    farther: float = 1e-1
    rough: WarmStart = field(
        default_factory=lambda: WarmStart(
            (1e-2,),
            (),
            Tolerances(1e-7, 1e-6),
            InteriorPointOptions(18, window=10, acceptable=1e-7),
        )
    )
    work: WorkOptions = field(
        default_factory=lambda: WorkOptions(first_of_many=0.0, largest=10.0, missing=1)
    )
    more_work: float = 0.1
    tolerance: float = 1e-6
    same_mode: float = 0.9999


OPTIONS = NearbyOptions()


@dataclass(frozen=True)
class Softened:
    """Hinges with the compliance of so many halvings of their elements.

    Attributes:
        points: Joint points.
        halvings: m of all of them, or of each.
    """

    points: Indices
    halvings: Array | float = 0.0

    @property
    def most(self) -> float:
        """The largest number of halvings."""
        return float(np.max(self.halvings, initial=0.0)) if len(self.points) else 0.0


@contextmanager
def softened(case: LoadCase, soft: Softened) -> Iterator[LoadCase]:
    """A load case with more compliant hinges, that tells nobody how its solves go."""
    silent = replace(case, monitor=lambda step: None)
    if not soft.most > 0.0:
        yield silent
        return
    whole = case.discretization
    hinge_nodes, halvings = _nodes_of(whole, soft)
    with Owner() as owner:
        problem = hinge_nodes.soften(case.problem, halvings, owner)
        stiffness = owner.enter_context(whole.stiffness_with(problem.stiffness, GENERAL))
        yield replace(silent, kind=GENERAL, problem=problem, stiffness=stiffness)


def on_mesh(case: LoadCase, end: Collapse, soft: Softened) -> Collapse:
    """A collapse with compliant hinges, with the displacements of the blocks' meshes.

    Those of the state found are of the joints' side of the hinges: beside a node with the
    compliance of many halvings they would give stresses that no block has.
    """
    if end.state is None:
        return end
    hinge_nodes, halvings = _nodes_of(case.discretization, soft)
    forces = case.problem.joint_forces(end.state.pressure, end.state.shear)
    give = hinge_nodes.indentation(forces, halvings, case.problem.stiffness.first_row // 2)
    u, elastic = end.state.displacement - give, end.state.elastic - case.problem.elastic_part(give)
    return replace(end, state=replace(end.state, displacement=u, elastic=elastic))


def _nodes_of(whole: Discretization, soft: Softened) -> tuple[HingeNodes, Array]:
    """Nodes at hinges, and the halvings of each."""
    nodes = whole.joints.nodes[soft.points]
    used = nodes != GROUND
    each = np.broadcast_to(soft.halvings, len(nodes))[:, None] * np.ones(nodes.shape)
    hinge_nodes = HingeNodes.of(whole, nodes[used])
    halvings = np.zeros(len(hinge_nodes.nodes))
    np.maximum.at(halvings, np.searchsorted(hinge_nodes.nodes, nodes[used]), each[used])
    return hinge_nodes, halvings


def collapse_next_to(
    case: LoadCase, last: Collapse, soft: Softened, from_afar: tuple[Attempt, ...] = ()
) -> Collapse:
    """The verified collapse next to another one, with the compliance of hinges.

    The attempts `from_afar` are made where it is lost.
    """
    if last.state is None:
        return last
    work = replace(OPTIONS.work, first=_first_work(last, soft))
    near, farther = (
        next_to(last.state, last.mode, warm)
        for warm in (OPTIONS.warm, replace(OPTIONS.warm, products=(OPTIONS.farther,)))
    )
    attempts = (near, *from_afar, farther)
    strategy = Strategy(attempts, GENERAL, work=work)
    with softened(case, soft) as softer:
        return find_collapse(softer, strategy, OPTIONS.tolerance)


def state_next_to(
    case: LoadCase, last: Collapse, soft: Softened, from_afar: Attempt
) -> tuple[float, JointValues]:
    """Load factor and joint values of the state next to a collapse, which is not verified.

    The attempt `from_afar` is made where it is lost.

    Raises:
        SolverError: If none is found.
    """
    if last.state is None:
        raise SolverError("no state to start from")
    with softened(case, soft) as softer:
        work = _first_work(last, soft) * case.bonded_work
        scales = softer.scales_at(work, abs(last.load_factor))
        task = Task(softer, work, scales, OPTIONS.tolerance)
        try:
            state = next_to(last.state, last.mode, OPTIONS.rough)(task)[0].state
        except SolverError as error:
            _log.info("  no state nearby: %s", error)
            state = from_afar(task)[0].state
        mode = elastic_mode(softer.coulomb(work, scales), state)
        return state.load_factor, joint_values(softer.problem, case.discretization, state, mode)


def same_mode(one: Array, other: Array) -> bool:
    """Whether the joints of two collapse states move alike, by their rates."""
    cosine = float(np.sum(one * other)) / (np.linalg.norm(one) * np.linalg.norm(other))
    return bool(cosine > OPTIONS.same_mode)


def rates(values: JointValues) -> Array:
    """Opening and slip rates of all joint points, shape (2, points)."""
    return np.stack([values.opening_rate, values.slip_rate])


def _first_work(last: Collapse, soft: Softened) -> float:
    return max(last.work_ratio, OPTIONS.work.first * (1.0 + OPTIONS.more_work * soft.most))
