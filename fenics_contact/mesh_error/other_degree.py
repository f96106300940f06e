"""What the load factor owes to the degree of the displacements: the algebraic error.

Where joints slide while they are closed over a length, the load factor converges like a power of h.
The state is followed to displacements of degree 2, or from these to degree 1, on the same mesh.
Hinges get the compliance of many halvings on both, so that their own error has no part in this.

Joint points at the ends of facets have counterparts; those of degree 2 between them do not.
Displacements are interpolated. A middle point takes the force of a linear pressure between the ends
of its facet, with the lesser pressure of both: next to a hinge it takes nothing.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from dolfinx import fem

from fenics_contact.collapse.load_case import LoadCase, Task
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.collapse.strategy import WarmStart, next_to
from fenics_contact.discretization.discretization import Bonded, Discretization
from fenics_contact.errors import EffortError, SolverError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.mesh_error.nearby import (
    Softened,
    collapse_next_to,
    near,
    rates,
    same_mode,
    softened,
)
from fenics_contact.results.result import Collapse
from fenics_contact.solvers.effort import ROUNDING
from fenics_contact.solvers.interior_point import InteriorPointOptions, Tolerances
from fenics_contact.solvers.joint_stiffness import GENERAL

_log = logging.getLogger("fenics_contact")

#: Part of a facet's length that belongs to its middle point, by Simpson's rule.
MIDDLE = 2.0 / 3.0


@dataclass(frozen=True)
class OtherDegreeOptions:
    """Numbers of the comparison.

    Attributes:
        cost: Of a factorisation for the other degree, in those for the given one, 1 and 2.
        products: Where the first look starts, in units of force times elastic displacement.
        steps: Of the interior point method, in the first look.
    """

    cost: tuple[float, float] = (3.0, 1.0 / 3.0)
    products: float = 3e-3
    steps: int = 8


OPTIONS = OtherDegreeOptions()


@dataclass(frozen=True)
class OtherDegree:
    """Load factor for the other degree; nan: not found.

    Attributes:
        load_factor: lambda.
        another_state: Whether it is that of another collapse state, or of none.
    """

    load_factor: float
    another_state: bool = False


def first_look_cost(case: LoadCase) -> float:
    """Cost of the first look, in factorisations of the structure."""
    return OPTIONS.steps * OPTIONS.cost[case.discretization.scene.degree - 1]


def with_other_degree(case: LoadCase, end: Collapse, soft: Softened, large: float) -> OtherDegree:
    """The load factor for the other degree, with the compliance of hinges.

    Some steps towards the state tell the change roughly. If it is above `large`, and the effort
    allows, the state is found and verified.

    Raises:
        EffortError: If the effort does not allow the first look.
    """
    given = case.discretization
    effort = given.effort
    cost = OPTIONS.cost[given.scene.degree - 1]
    if first_look_cost(case) > effort.left + ROUNDING:
        raise EffortError("the other degree is beyond the limit of the estimate")
    with _other_case(case) as other:
        counterparts = Counterparts.of(given, other.discretization)
        soft = replace(soft, points=counterparts.points(soft.points))
        start = counterparts.start(end, other)
        rough = _first_look(other, start, soft)
        _log.info("  the other degree: load factor %.8g at a first look", rough)
        if abs(rough - end.load_factor) <= large or effort.left < first_look_cost(case):
            return OtherDegree(rough, math.isnan(rough))
        found = collapse_next_to(other, start, soft, near)
        if found.status != "limit" and effort.left < cost and not math.isnan(rough):
            return OtherDegree(rough)
        if found.joints is None or end.joints is None:
            return OtherDegree(found.load_factor, True)
        ours, theirs = counterparts.ends
        same = same_mode(rates(end.joints)[:, ours], rates(found.joints)[:, theirs])
        return OtherDegree(found.load_factor, not same)


def _first_look(case: LoadCase, start: Collapse, soft: Softened) -> float:
    """Load factor after steps of the interior point method; nan where they lead nowhere."""
    options = InteriorPointOptions(OPTIONS.steps, acceptable=np.inf)
    warm = WarmStart((OPTIONS.products,), (), Tolerances(), options)
    with softened(case, soft) as softer:
        work = start.work_ratio * softer.bonded_work
        task = Task(softer, work, softer.scales_at(work, abs(start.load_factor)), 1.0)
        if start.state is None:
            return math.nan
        try:
            return next_to(start.state, start.mode, warm)(task)[0].state.load_factor
        except SolverError as error:
            _log.info("  the other degree: %s", error)
            return math.nan


@contextmanager
def _other_case(case: LoadCase) -> Iterator[LoadCase]:
    """The same structure and live load with displacements of the other degree.

    Its bonded response is not solved for: that of the given case is interpolated.
    """
    given = case.discretization
    with Discretization(replace(given.scene, degree=3 - given.scene.degree)) as whole:
        whole.charge_to(given, OPTIONS.cost[given.scene.degree - 1])
        carried = Counterparts.of(given, whole)
        bonded = case.bonded
        none = np.zeros_like(case.bonded.dead_pressure)
        dead, live = (carried.displacement(u) for u in (bonded.dead, bonded.live))
        of_dead, of_live = (
            carried.forces(np.stack([r, none]))[0]
            for r in (bonded.dead_pressure, bonded.live_pressure)
        )
        yield replace(
            case,
            discretization=whole,
            problem=replace(whole.problem, live=case.sign * whole.problem.live),
            blocks=RigidBlocks.of(whole, case.sign, whole.effort.wait),
            bonded=Bonded(dead, live, of_dead, of_live, bonded.seconds),
            kind=GENERAL,
            stiffness=whole.stiffness(GENERAL),
        )


@dataclass(frozen=True)
class Counterparts:
    """What two discretisations of one mesh, of different degree, have in common.

    Attributes:
        given: From which values are carried over.
        other: To which they are.
        middle: Joint points of degree 2 between the ends of every facet.
    """

    given: Discretization
    other: Discretization
    middle: Indices

    @classmethod
    def of(cls, given: Discretization, other: Discretization) -> Counterparts:
        """Those of two discretisations, one of which has degree 2."""
        middle = max((given.joints.middle, other.joints.middle), key=len)
        return cls(given, other, middle)

    @property
    def ends(self) -> tuple[Indices, Indices]:
        """Points at the ends of facets, of both discretisations."""
        ours, first = np.unique(self.given.joints.segments, return_index=True)
        return ours, self.other.joints.segments.ravel()[first]

    def points(self, points: Indices) -> Indices:
        """Counterparts of points at the ends of facets."""
        ours, theirs = self.ends
        return theirs[np.searchsorted(ours, points)]

    def start(self, end: Collapse, case: LoadCase) -> Collapse:
        """A collapse as a start in a case of the other discretisation: its state and mode."""
        if end.state is None or end.mode is None:
            return end
        problem = case.problem
        state = self.given.with_imposed(end.state)
        u, mode = (self.displacement(v) for v in (state.displacement, end.mode))
        u -= self.other.imposed
        forces = self.forces(np.stack([state.pressure, state.shear]))
        started = problem.state(u, state.load_factor, *forces)
        return replace(end, state=started, mode=mode / problem.dot(problem.live, mode))

    def displacement(self, values: Array) -> Array:
        """Displacements in the supports' coordinates, interpolated; this rank's part."""
        source, target = (fem.Function(one.elasticity.space) for one in (self.given, self.other))
        source.x.array[: len(values)] = self.given.cartesian(values).ravel()
        source.x.scatter_forward()
        target.interpolate(source)
        first, end = self.other.problem.stiffness.matrix.getOwnershipRange()
        values = target.x.array[: end - first].copy()
        return self.other.supports.to_supports(values, first // 2)

    def forces(self, forces: Array) -> Array:
        """Forces (normal, shear) at this rank's joint points, N/m, shape (2, rows)."""
        everywhere = np.stack([self.given.all_points(r) for r in forces])
        if self.given.scene.degree == 1:
            found = self._spread(everywhere)
        else:
            found = self._gathered(everywhere)
        # Corners and ties have counterparts.
        ours, theirs = (
            one.joints.joint_count - one.joints.corners for one in (self.given, self.other)
        )
        found[:, theirs:] = everywhere[:, ours:]
        return found[:, self.other.operators.points]

    def _spread(self, forces: Array) -> Array:
        """Forces at points of degree 2."""
        joints = self.given.joints
        facets = self.given.joints.segments
        pressure = forces[0] / joints.length
        loaded = forces[0] > 0.0
        length = np.linalg.norm(
            joints.position[facets[:, 1]] - joints.position[facets[:, 0]], axis=1
        )
        inner = MIDDLE * length * pressure[facets].min(axis=1)
        part = np.zeros_like(pressure)  # of the forces at the ends
        np.add.at(part, facets, np.repeat(0.5 * inner[:, None], 2, axis=1))
        part = np.divide(part, forces[0], out=np.zeros_like(part), where=loaded)
        ratio = np.divide(forces, forces[0], out=np.zeros_like(forces), where=loaded)
        found = np.zeros((2, len(self.other.joints.length)))
        found[:, self.other.joints.segments] = (forces * (1.0 - part))[:, facets]
        found[:, self.middle] = inner * ratio[:, facets].mean(axis=2)
        return found

    def _gathered(self, forces: Array) -> Array:
        """Forces at points of degree 1."""
        facets = self.other.joints.segments
        found = np.zeros((2, len(self.other.joints.length)))
        found[:, facets] = forces[:, self.given.joints.segments]
        for component, inner in zip(found, forces[:, self.middle], strict=True):
            np.add.at(component, facets, np.repeat(0.5 * inner[:, None], 2, axis=1))
        return found
