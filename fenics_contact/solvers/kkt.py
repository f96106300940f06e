"""The perturbed optimality (KKT) conditions of one state, and Newton's method on them.

Prescribe the work of the live load, f_L.u = T; its multiplier is the load factor. With given
friction g this is a convex problem, for joints without dilatancy

    min 1/2 u.Ku - f_D.u + g.|B_T u|   subject to   B_N u >= 0,   f_L.u = T;

with Coulomb friction only its optimality conditions remain,

    K u = f_D + lambda f_L + B_N^T r_N + B_T^T r_T,   f_L.u = T,
    y r_N = mu,   s1 z1 = mu,   s2 z2 = mu,   all six >= 0,

with the slacks of the joint law (`joint_law`) and products mu = 0. The solutions for mu > 0 are the
central path. Eliminating all but (u, lambda), every Newton step is an elastic solve in which the
joints are springs, bordered by f_L; with Coulomb friction they couple shear to opening.
(S.J. Wright, Primal-Dual Interior-Point Methods (1997).)

The motion of a mechanism may be so much larger than what strains the blocks that u has no digits
left for K u. So the part of u that strains the blocks is summed up step by step for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers.compiled import call
from fenics_contact.solvers.joint_law import LinearLaws, PointLaws, Slacks
from fenics_contact.solvers.joint_stiffness import Factor, JointStiffness
from fenics_contact.solvers.problem import Array, ContactProblem, Scales, State

#: Points whose given bound is below this part of the typical force transmit no shear.
NO_FRICTION = 1e-12


@dataclass(frozen=True)
class Iterate(Slacks):
    """Variables of the perturbed conditions, or a direction in their space.

    Attributes:
        u: Displacements, this rank's part, m.
        elastic: The part of u that strains the blocks, with digits that u itself has lost.
        load_factor: lambda.
    """

    u: Array
    elastic: Array
    load_factor: float

    def moved(self, length: float, direction: Iterate) -> Iterate:
        """The iterate a step along a direction."""
        change = vars(direction)
        return Iterate(**{n: value + length * change[n] for n, value in vars(self).items()})


@dataclass(frozen=True)
class Residual:
    """Residual of the linear conditions at an iterate: equilibrium, opening, slip and work."""

    equilibrium: Array
    opening: Array
    slip: Array
    work: float


@dataclass(frozen=True)
class PerturbedKKT:
    """Conditions of one state under prescribed work or load, with Coulomb or given friction.

    Attributes:
        problem: The structure.
        stiffness: Its stiffness with joint springs.
        scales: Typical sizes.
        work: T, N m per metre of thickness; not used with a load factor.
        load_factor: If given, lambda is prescribed, not the work.
        law: That of the points: the problem's own, or associative friction and a given bound.
        least_strength: Points without friction whose strength is not above this transmit no shear,
            N per metre of thickness.
        options: Numbers of the Newton steps.
    """

    problem: ContactProblem
    stiffness: JointStiffness
    scales: Scales
    work: float
    load_factor: float | None
    law: PointLaws
    least_strength: float = 0.0
    options: SearchOptions = SEARCH

    @classmethod
    def coulomb(
        cls,
        problem: ContactProblem,
        stiffness: JointStiffness,
        scales: Scales,
        work: float,
        load_factor: float | None = None,
    ) -> PerturbedKKT:
        """The conditions with Coulomb friction: g = F r_N is one of the equations."""
        return cls(problem, stiffness, scales, work, load_factor, problem.law)

    @classmethod
    def given_friction(
        cls,
        problem: ContactProblem,
        stiffness: JointStiffness,
        scales: Scales,
        bound: Array,
        work: float,
        load_factor: float | None = None,
    ) -> PerturbedKKT:
        """The conditions with given friction g."""
        law = problem.law.with_given(bound)
        least = NO_FRICTION * scales.force
        return cls(problem, stiffness, scales, work, load_factor, law, least)

    @cached_property
    def frictional(self) -> npt.NDArray[np.bool_]:
        """Points that transmit shear; the others' shear stays zero and their slip is free."""
        return (self.law.friction > 0.0) | (self.law.strength > self.least_strength)

    @cached_property
    def count(self) -> float:
        """Number of products, at least 1."""
        return max(self.problem.sum(1.0 + 2.0 * self.frictional), 1.0)

    def on_central_path(self, start: State, mu: float, nearest: float = 0.0) -> Iterate:
        """The point with all products equal to mu next to a state.

        It keeps p = r_N/f - y/d and q = r_T/f - w_T/d (`joint_law`).

        Args:
            start: The state; its joint forces need not be admissible.
            mu: In units of force times displacement.
            nearest: Least distance of shear from its bound, in units of the bound. Above zero for
                a state from elsewhere, where no spring may vanish.
        """
        law = self.law.compiled(self.scales.force, self.frictional)
        state = *self.problem.motion_of(start), *start.forces
        values = np.empty((7, self.problem.points))
        call("slacks_next_to", law, mu, self.scales.displacement, nearest, *state, values)
        factor = start.load_factor if self.load_factor is None else self.load_factor
        slacks = Slacks(*values)
        return Iterate(
            **vars(slacks), u=start.displacement, elastic=start.elastic, load_factor=factor
        )

    def residual(self, now: Iterate) -> Residual:
        """Residual of the linear conditions."""
        p = self.problem
        equilibrium = (
            p.stiffness @ now.elastic
            - p.dead
            - now.load_factor * p.live
            - p.joint_forces(now.pressure, now.shear)
        )
        opening, slip = p.joint_motion(now.u, now.pressure, now.shear)
        work = p.dot(p.live, now.u) - self.work if self.load_factor is None else 0.0
        clearance = now.y + self.law.dilation(now.z1, now.z2)
        return Residual(equilibrium, clearance - opening, now.slip - slip, work)

    def sizes(self, now: Iterate, residual: Residual) -> dict[str, float]:
        """Relative sizes of the residuals, and the mean product."""
        d = self.scales.displacement
        f = self.scales.force
        p = self.problem
        equilibrium = p.max(np.abs(residual.equilibrium)) / f
        return {
            "equilibrium": self.options.equilibrium_weight * equilibrium,
            "opening": p.max(np.abs(residual.opening)) / d,
            "slip": p.max(np.abs(residual.slip[self.frictional])) / d,
            "work": abs(residual.work) / abs(self.work) if residual.work else 0.0,
            "complementarity": self.mean_product(now),
        }

    def products(self, now: Iterate) -> Array:
        """Products y r_N, s1 z1 and s2 z2, N m per metre of thickness, shape (3, points)."""
        return np.array([now.y * now.pressure, now.s1 * now.z1, now.s2 * now.z2])

    def total(self, products: Array) -> float:
        """Sum of products over all points and ranks."""
        normal, lower, upper = products
        return self.problem.sum(normal + np.where(self.frictional, lower + upper, 0.0))

    def mean_product(self, now: Iterate) -> float:
        """Mu as the mean of the products, in units of force times displacement."""
        unit = self.scales.force * self.scales.displacement
        return self.total(self.products(now)) / (self.count * unit)

    def state(self, now: Iterate) -> State:
        """An iterate as a state, its displacements with the digits of the elastic part."""
        u = now.u + (now.elastic - self.problem.elastic_part(now.u))
        work = self.problem.dot(self.problem.live, u) if self.load_factor is not None else self.work
        return State(u, now.elastic, now.load_factor, now.pressure, now.shear, work)

    def linearize(self, now: Iterate) -> Linearization:
        """Newton's equations at an iterate: springs, and A factored.

        Raises:
            SolverError: If A is singular.
        """
        return Linearization(self, now)


class Linearization:
    """Newton's equations at an iterate, on one factor of A.

    Attributes:
        kkt: The conditions.
        now: The iterate.
        laws: The law of the points, linearised.
        factor: A^-1.
    """

    def __init__(self, kkt: PerturbedKKT, now: Iterate) -> None:
        """Factor A with the springs of an iterate; raises `SolverError` if A is singular."""
        self.kkt = kkt
        self.now = now
        largest = kkt.options.largest_spring * kkt.stiffness.mean_diagonal
        unit = kkt.scales.displacement / kkt.scales.force
        law = kkt.law.compiled(kkt.scales.force, kkt.frictional)
        self.laws = LinearLaws(law, now, kkt.problem.compliance, largest, unit)
        normal, tangential, coupling, slope, _ = self.laws.springs
        free = kkt.options.sliding_spring * kkt.scales.force / kkt.scales.displacement
        self.factor: Factor = kkt.stiffness.factor(
            normal,
            np.where(kkt.frictional, tangential + coupling * slope, free),
            coupling if np.any(kkt.law.friction) else None,
            normal * slope if np.any(kkt.law.dilatancy) else None,
        )

    @cached_property
    def live_response(self) -> Array:
        """A^-1 f_L."""
        return self.factor.solve(self.kkt.problem.live)

    @cached_property
    def flexibility(self) -> float:
        """f_L.A^-1 f_L."""
        return self.kkt.problem.dot(self.kkt.problem.live, self.live_response)

    @property
    def orientation(self) -> float:
        """Sign of the determinant of A bordered by f_L, with the sign that it has at T = 0."""
        return self.factor.determinant_sign * float(np.sign(self.flexibility))

    def directions(self, asked: Sequence[tuple[Residual, Array]]) -> list[Iterate]:
        """Newton directions, all solved for at once: what the eliminated equations say.

        Args:
            asked: Residual to be taken away, and change of the products, shape (3, points).
        """
        p = self.kkt.problem
        rights = [
            p.joint_forces(*self.laws.forces(residual.opening, residual.slip, change))
            - residual.equilibrium
            for residual, change in asked
        ]
        with_work = self.kkt.load_factor is None
        if with_work and "live_response" not in vars(self):
            *solutions, self.live_response = self.factor.solve_all([*rights, p.live])
        else:
            solutions = self.factor.solve_all(rights)
        directions = []
        for (residual, change), right, u in zip(asked, rights, solutions, strict=True):
            factor = 0.0
            if with_work:
                u, factor = self._bordered(u, right, residual.work)
            moved = p.normal @ u, p.tangential @ u
            slacks = self.laws.changes(residual.opening, residual.slip, change, moved)
            elastic = p.elastic_part(u)
            directions.append(Iterate(**vars(slacks), u=u, elastic=elastic, load_factor=factor))
        return directions

    def hold_work(self, u: Array, excess: float = 0.0) -> tuple[Array, float]:
        """A change of displacements that takes excess work away, and of the load factor."""
        live = self.kkt.problem.live
        factor = -(excess + self.kkt.problem.dot(live, u)) / self.flexibility
        return u + factor * self.live_response, factor

    def _bordered(self, u: Array, right: Array, excess: float) -> tuple[Array, float]:
        """Solution of A u = b + d lambda f_L with f_L.u = -excess, from u = A^-1 b.

        Next to a mechanism A^-1 b and A^-1 f_L are far larger than their sum, and cancel digits.
        Then A u = b + d lambda f_L is solved once more, with d lambda known.
        """
        held, factor = self.hold_work(u, excess)
        largest = self.kkt.problem.max
        cancellation = self.kkt.options.cancellation
        if cancellation < np.inf and abs(factor) * largest(
            np.abs(self.live_response)
        ) > cancellation * largest(np.abs(held)):
            again = self.factor.solve(right + factor * self.kkt.problem.live)
            held, more = self.hold_work(again, excess)
            factor += more
        return held, factor
