"""The perturbed optimality (KKT) conditions of one state, and Newton's method on them.

Prescribe the work of the live load, f_L.u = T; its multiplier is the load factor. With given
friction g this is a convex problem,

    min 1/2 u.Ku - f_D.u + g.|B_T u|   subject to   B_N u >= 0,   f_L.u = T;

with Coulomb friction, g = F r_N, only its optimality conditions remain. With slacks y = B_N u,
s1 = g - r_T, s2 = g + r_T and slip split as B_T u = -z1 + z2 they are

    K u = f_D + lambda f_L + B_N^T r_N + B_T^T r_T,   f_L.u = T,
    y r_N = mu,   s1 z1 = mu,   s2 z2 = mu,   all six >= 0,

with products mu = 0. The solutions for mu > 0 are the central path. Eliminating all but
(u, lambda), every Newton step is an elastic solve in which the joints are springs, bordered by
f_L:

    k_N = r_N / y,    k_T = 1 / (z1/s1 + z2/s2),    coupling  q k_N,  q = F k_T (z1/s1 - z2/s2),

the coupling with Coulomb friction only. Joint points with a compliance of their own (`problem`)
are springs in series with these. (S.J. Wright, Primal-Dual Interior-Point Methods (1997).)

The motion of a mechanism may be so much larger than what strains the blocks that u has no digits
left for K u. So the part of u that strains the blocks is summed up step by step for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fenics_contact.solvers.joint_stiffness import Factor, JointStiffness
from fenics_contact.solvers.problem import Array, ContactProblem, Scales, State
from fenics_contact.solvers.smoothing import distance_from_bound, normal_law

#: Least distance of shear from its bound, in units of the bound, at a state from elsewhere.
COLD = 1e-9


@dataclass(frozen=True)
class KKTOptions:
    """Numbers of the Newton steps.

    Attributes:
        largest_spring: Cap on springs, in units of the mean diagonal of K; larger ones would
            cancel digits.
        sliding_spring: Spring that resists steps, not slip, at points without friction, in units
            of force over displacement: without it blocks on frictionless joints have no stiffness.
        no_friction: Points whose given bound is below this part of the typical force transmit no
            shear.
        cancellation: A direction is solved for once more if its two parts are larger than their
            sum by this factor: its digits have cancelled.
        equilibrium_weight: Of the equilibrium residual. Stiff springs cancel some of its digits
            while the iterates still move; it recovers as they come to rest.
    """

    largest_spring: float = 1e10
    sliding_spring: float = 1e-8
    no_friction: float = 1e-12
    cancellation: float = 10.0
    equilibrium_weight: float = 1e-3


@dataclass(frozen=True)
class Iterate:
    """Variables of the perturbed conditions, or a direction in their space.

    Attributes:
        u: Displacements, this rank's part, m.
        elastic: The part of u that strains the blocks, with digits that u itself has lost.
        load_factor: lambda.
        y: Openings at this rank's points, m.
        pressure: r_N, N per metre of thickness.
        shear: r_T, likewise.
        s1: Distance g - r_T of the shear force from its bound.
        s2: g + r_T.
        z1: Slip towards negative values, m.
        z2: Slip towards positive values, m.
    """

    u: Array
    elastic: Array
    load_factor: float
    y: Array
    pressure: Array
    shear: Array
    s1: Array
    s2: Array
    z1: Array
    z2: Array

    def moved(self, length: float, direction: Iterate) -> Iterate:
        """The iterate a step along a direction."""
        change = vars(direction)
        return Iterate(**{n: value + length * change[n] for n, value in vars(self).items()})

    @property
    def slip(self) -> Array:
        """Slip z2 - z1, m."""
        return self.z2 - self.z1

    @property
    def positive(self) -> Array:
        """The six quantities that stay positive, shape (6 points,)."""
        return np.concatenate([self.y, self.pressure, self.s1, self.s2, self.z1, self.z2])


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
        given: Given friction bound g at this rank's points, N per metre; None: Coulomb's.
        friction: Coulomb's coefficient in the equations, zero with a given bound.
        options: Numbers of the Newton steps.
    """

    problem: ContactProblem
    stiffness: JointStiffness
    scales: Scales
    work: float
    load_factor: float | None
    given: Array | None
    friction: Array
    options: KKTOptions = field(default_factory=KKTOptions)

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
        return cls(problem, stiffness, scales, work, load_factor, None, problem.friction)

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
        none = np.zeros_like(problem.friction)
        return cls(problem, stiffness, scales, work, load_factor, bound, none)

    @cached_property
    def frictional(self) -> npt.NDArray[np.bool_]:
        """Points that transmit shear; the others' shear stays zero and their slip is free."""
        if self.given is None:
            return self.problem.frictional
        return self.given > self.options.no_friction * self.scales.force

    @cached_property
    def count(self) -> float:
        """Number of products, at least 1."""
        return max(self.problem.sum(1.0 + 2.0 * self.frictional), 1.0)

    def bound(self, pressure: Array) -> Array:
        """Friction bound g for given normal forces, N per metre."""
        if self.given is not None:
            return self.given
        return self.friction * pressure + self.problem.strength

    def on_central_path(self, start: State, mu: float, nearest: float = 0.0) -> Iterate:
        """The point with all products equal to mu next to a state.

        It keeps p = r_N/f - w_N/d and q = r_T/f - w_T/d (`smoothing`).

        Args:
            start: The state; its joint forces need not be admissible.
            mu: In units of force times displacement.
            nearest: Least distance of shear from its bound, in units of the bound. Above zero for
                a state from elsewhere, where no spring may vanish.
        """
        d = self.scales.displacement
        f = self.scales.force
        opening, slip = self._joint_motion(start.displacement, start.pressure, start.shear)
        y, pressure = normal_law(start.pressure / f - opening / d, mu)
        y = y * d
        pressure = pressure * f
        gamma = np.where(self.frictional, self.bound(pressure) / f, 1.0)
        q = start.shear / f - slip / d
        near = np.maximum(distance_from_bound(np.abs(q), gamma, mu), nearest * gamma)
        far = 2.0 * gamma - near
        s1 = np.where(q > 0.0, near, far) * f
        s2 = np.where(q > 0.0, far, near) * f
        z1 = mu * f * d / s1
        z2 = mu * f * d / s2
        shear = np.where(self.frictional, 0.5 * (s2 - s1), 0.0)
        factor = start.load_factor if self.load_factor is None else self.load_factor
        u = start.displacement
        elastic = start.elastic
        return Iterate(u, elastic, factor, y, pressure, shear, s1, s2, z1, z2)

    def residual(self, now: Iterate) -> Residual:
        """Residual of the linear conditions."""
        p = self.problem
        equilibrium = (
            p.stiffness @ now.elastic
            - p.dead
            - now.load_factor * p.live
            - p.joint_forces(now.pressure, now.shear)
        )
        opening, slip = self._joint_motion(now.u, now.pressure, now.shear)
        work = p.dot(p.live, now.u) - self.work if self.load_factor is None else 0.0
        return Residual(equilibrium, now.y - opening, now.slip - slip, work)

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

    def _joint_motion(self, u: Array, pressure: Array, shear: Array) -> tuple[Array, Array]:
        """Openings and slips of this rank's points, with those of the points' own compliance."""
        p = self.problem
        c_n, c_t = p.compliance
        return p.openings(u) + c_n * pressure, p.slips(u) + c_t * shear


class Linearization:
    """Newton's equations at an iterate, on one factor of A.

    Attributes:
        kkt: The conditions.
        now: The iterate.
        k_n: Normal springs k_N of the laws, N/m.
        k_t: Tangential springs k_T, zero where there is no friction.
        q: Coupling of shear to normal forces.
        factor: A^-1.
    """

    def __init__(
        self,
        kkt: PerturbedKKT,
        now: Iterate,
        stiffest: float | None = None,
        sliding: float | None = None,
    ) -> None:
        """Factor A with the springs of an iterate.

        Args:
            kkt: The conditions.
            now: The iterate.
            stiffest: Cap on springs; that of the options when not given.
            sliding: Spring of points without friction, likewise.

        Raises:
            SolverError: If A is singular.
        """
        self.kkt = kkt
        self.now = now
        options = kkt.options
        frictional = kkt.frictional
        largest = (stiffest or options.largest_spring) * kkt.stiffness.mean_diagonal
        self.k_n = np.minimum(now.pressure / now.y, largest)
        lower = now.z1 / now.s1
        upper = now.z2 / now.s2
        self.k_t = np.where(frictional, np.minimum(1.0 / (lower + upper), largest), 0.0)
        self.q = kkt.friction * self.k_t * (lower - upper)
        #: Parts of the blocks' displacements that are left to the laws' springs.
        c_n, c_t = kkt.problem.compliance
        self._share_n = 1.0 / (1.0 + c_n * self.k_n)
        self._share_t = 1.0 / (1.0 + c_t * self.k_t)
        normal, tangential, coupling = self.springs
        free = (sliding or options.sliding_spring) * kkt.scales.force / kkt.scales.displacement
        self.factor: Factor = kkt.stiffness.factor(
            normal,
            np.where(frictional, tangential, free),
            coupling if kkt.given is None else None,
        )

    @property
    def springs(self) -> tuple[Array, Array, Array]:
        """Springs that the blocks feel: normal, tangential, and coupling of shear to opening."""
        normal = self._share_n * self.k_n
        return normal, self._share_t * self.k_t, self._share_t * self.q * normal

    @cached_property
    def live_response(self) -> Array:
        """A^-1 f_L."""
        return self.factor.solve(self.kkt.problem.live)

    @property
    def flexibility(self) -> float:
        """f_L.A^-1 f_L."""
        return self.kkt.problem.dot(self.kkt.problem.live, self.live_response)

    @property
    def orientation(self) -> float:
        """Sign of the determinant of A bordered by f_L, with the sign that it has at T = 0."""
        return self.factor.determinant_sign * float(np.sign(self.flexibility))

    def directions(self, asked: Sequence[tuple[Residual, Array]]) -> list[Iterate]:
        """Newton directions, all solved for at once.

        Args:
            asked: Residual to be taken away, and change of the products, shape (3, points).
        """
        drives, rights = zip(*(self._right_hand_side(*one) for one in asked), strict=True)
        with_work = self.kkt.load_factor is None
        if with_work and "live_response" not in vars(self):
            *found, self.live_response = self.factor.solve_all([*rights, self.kkt.problem.live])
        else:
            found = self.factor.solve_all(rights)
        directions = []
        for one, drive, right, u in zip(asked, drives, rights, found, strict=True):
            held = self._bordered(u, right, one[0].work) if with_work else (u, 0.0)
            directions.append(self._direction(*one, drive, *held))
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
        parts = abs(factor) * largest(np.abs(self.live_response))
        if parts > self.kkt.options.cancellation * largest(np.abs(held)):
            again = self.factor.solve(right + factor * self.kkt.problem.live)
            held, more = self.hold_work(again, excess)
            factor += more
        return held, factor

    def _right_hand_side(self, residual: Residual, change: Array) -> tuple[Array, Array]:
        """Drive of the slip, and right-hand side b."""
        now = self.now
        kkt = self.kkt
        of_normal, of_lower, of_upper = change
        push = self._share_n * (of_normal / now.y + self.k_n * residual.opening)
        drive = of_upper / now.s2 - of_lower / now.s1 + residual.slip
        drive = np.where(kkt.frictional, drive, 0.0)
        shear = self._share_t * (self.k_t * drive + self.q * push)
        return drive, kkt.problem.joint_forces(push, shear) - residual.equilibrium

    def _direction(
        self, residual: Residual, change: Array, drive: Array, u: Array, load_factor: float
    ) -> Iterate:
        """The direction with given displacements: what the eliminated equations say."""
        now = self.now
        kkt = self.kkt
        p = self.kkt.problem
        c_n, c_t = p.compliance
        of_normal, of_lower, of_upper = change
        opening = p.normal @ u
        slip = p.tangential @ u
        pressure = self._share_n * (of_normal / now.y - self.k_n * (opening - residual.opening))
        y = opening + c_n * pressure - residual.opening
        stuck = np.where(kkt.frictional, drive - slip, 0.0)
        shear = self._share_t * (self.k_t * stuck + self.q * pressure)
        slip = slip + c_t * shear
        s1 = kkt.friction * pressure - shear
        s2 = kkt.friction * pressure + shear
        z1 = (of_lower - now.z1 * s1) / now.s1
        z2 = (of_upper - now.z2 * s2) / now.s2
        # Next to its bound the shear force has lost the digits that tell how far a point slides.
        slid = slip - residual.slip
        unit = kkt.scales.displacement / kkt.scales.force
        lower = now.z1 / now.s1
        upper = now.z2 / now.s2
        down = lower > np.maximum(upper, unit)
        up = upper > np.maximum(lower, unit)
        z1, z2 = np.where(down, z2 - slid, z1), np.where(up, z1 + slid, z2)
        s1 = np.where(down, (of_lower - now.s1 * z1) / now.z1, s1)
        s2 = np.where(up, (of_upper - now.s2 * z2) / now.z2, s2)
        s1, s2, z1, z2 = (np.where(kkt.frictional, part, 0.0) for part in (s1, s2, z1, z2))
        return Iterate(u, p.elastic_part(u), load_factor, y, pressure, shear, s1, s2, z1, z2)
