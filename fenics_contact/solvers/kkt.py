"""The equations of one state under work control, as Newton's method sees them.

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

the coupling with Coulomb friction only. Joint points that give of themselves (`problem`) are
springs in a row with these.

The motion of a mechanism may be so much larger than what strains the blocks that u has no digits
left for K u. So the part of u without rigid motions of blocks is summed up step by step for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.solvers.problem import ContactProblem
from fenics_contact.solvers.smoothing import Growth, distance_from_bound, normal_law
from fenics_contact.solvers.joint_stiffness import SpringStiffness

Array = npt.NDArray[np.float64]
Changes = tuple[Array, Array, Array]

#: Largest spring, in units of the mean diagonal of K; larger ones would cancel digits.
LARGEST_SPRING = 1e10

#: Springs that resist the steps, not the slip, of points that transmit no shear, in units of force
#: over displacement: without them blocks on frictionless joints would have no stiffness.
PROXIMAL_SPRING = 1e-8

#: Distance of shear from its bound at the start of a solve, at least, in parts of the bound.
NEAREST = 1e-9

#: Points whose bound is below this fraction of the typical force transmit no shear.
NO_FRICTION = 1e-12

#: By how much larger than their sum the parts of a direction are from which on digits are kept.
CANCELLING = 1e4

#: Weight of the equilibrium residual. Stiff springs cancel some of its digits while the iterates
#: still move; it recovers as they come to rest.
EQUILIBRIUM_WEIGHT = 1e-3


@dataclass(frozen=True)
class Scales:
    """Typical sizes, so that no tolerance depends on units.

    Attributes:
        displacement: m.
        force: Nodal joint force, N/m.
        load_factor: Typical load factor.
        elastic: Displacement that strains the blocks, m; 0: as large as all.
    """

    displacement: float
    force: float
    load_factor: float
    elastic: float = 0.0

    @property
    def elastic_part(self) -> float:
        """Part of the displacements that strains the blocks."""
        return min(self.elastic / self.displacement, 1.0) if self.elastic > 0.0 else 1.0


@dataclass(frozen=True)
class State:
    """Displacements and joint forces of a structure under work control.

    Attributes:
        displacement: u, in the supports' coordinates.
        load_factor: lambda.
        pressure: r_N at this rank's points, N/m.
        shear: r_T, likewise.
        work: T = f_L . u.
        strained: u without rigid motions of blocks, if more digits of it are known than u holds.
    """

    displacement: PETSc.Vec
    load_factor: float
    pressure: Array
    shear: Array
    work: float
    strained: PETSc.Vec | None = None

    def destroy(self) -> None:
        """Free the vectors."""
        self.displacement.destroy()
        if self.strained is not None:
            self.strained.destroy()


@dataclass
class Iterate:
    """Variables of the interior point method, or a direction in their space.

    `strained` is u without rigid motions of blocks, with digits that u itself has lost.
    """

    u: PETSc.Vec
    strained: PETSc.Vec
    load_factor: float
    y: Array
    pressure: Array
    shear: Array
    s1: Array
    s2: Array
    z1: Array
    z2: Array

    def move(self, length: float, direction: Iterate) -> None:
        """Take a step along a direction."""
        self.u.axpy(length, direction.u)
        self.strained.axpy(length, direction.strained)
        for field in fields(self)[2:]:
            here, there = getattr(self, field.name), getattr(direction, field.name)
            setattr(self, field.name, here + length * there)

    def copy(self) -> Iterate:
        """A copy with arrays of its own."""
        rest = (getattr(self, field.name) for field in fields(self)[3:])
        vectors = self.u.copy(), self.strained.copy()
        return Iterate(*vectors, self.load_factor, *(array.copy() for array in rest))

    def destroy(self) -> None:
        """Free the vectors, which PETSc would otherwise keep for long."""
        self.u.destroy()
        self.strained.destroy()


@dataclass(frozen=True)
class Residual:
    """What is left of the linear optimality conditions at an iterate."""

    equilibrium: PETSc.Vec
    opening: Array
    slip: Array
    work: float


class Workspace:
    """Vectors that all equations of one structure share."""

    def __init__(self, problem: ContactProblem) -> None:
        self.rights = problem.dead.duplicate(), problem.dead.duplicate()
        self.frees = problem.dead.duplicate(), problem.dead.duplicate()
        self.border, self.dual = problem.dead.duplicate(), problem.dead.duplicate()
        self.rest = problem.dead.duplicate()
        self.zero = problem.dead.duplicate()  # duplicates are zero
        self.opening = problem.normal.createVecLeft()
        self.slip = problem.tangential.createVecLeft()

    def destroy(self) -> None:
        """Free the vectors."""
        rest = self.border, self.dual, self.rest, self.zero, self.opening, self.slip
        for vector in (*self.rights, *self.frees, *rest):
            vector.destroy()


class PathEquations:
    """The equations of one solve: one bound, and one T or load factor.

    Attributes:
        keeps_digits: Whether directions are to keep digits that cancel, at the price of a solve.
    """

    keeps_digits = True

    def __init__(
        self,
        problem: ContactProblem,
        springs: SpringStiffness,
        workspace: Workspace,
        bound: Array | None,
        work: float,
        scales: Scales,
        load_factor: float | None = None,
        growth: Growth | None = None,
    ) -> None:
        self.problem = problem
        self.springs = springs
        self.workspace = workspace
        self.given = bound
        self.work = work
        self.load_factor = load_factor
        self.scales = scales
        self.unit = scales.force * scales.displacement
        #: Coulomb's coefficient where the bound follows the pressure: that of the problem, or
        #: where it grows, the part `mobile` of it.
        self.growth = growth
        self.mobile = 1.0 if growth is None else 0.0
        self.friction = np.zeros_like(problem.friction)
        if bound is None:
            self.friction = self.mobile * problem.friction
        #: Points that transmit shear; the others' shear stays zero and their slip is free.
        if bound is None:
            self.sticky = (problem.friction > 0.0) | (problem.strength > 0.0)
        else:
            self.sticky = bound > NO_FRICTION * scales.force
        products = np.ones(len(self.sticky)) + 2.0 * self.sticky
        self.count = max(problem.sum(products), 1.0)
        #: Whether digits of directions cancel, and are to be kept; the factor that `dual` is of.
        self.cancelling = False
        self._factor_of_dual = 0

    def mobilise(self, part: float) -> Array:
        """Set the part of Coulomb's coefficient that is there.

        Returns:
            The change of the coefficient.
        """
        before = self.friction
        self.mobile = part
        self.friction = part * self.problem.friction
        return self.friction - before

    def start(self, state: State, products: float) -> Iterate:
        """The iterate next to a state with equal products, and the friction that they call for."""
        if self.growth is not None:
            self.mobilise(self.growth.part(products))
        return self.centred(state, products)

    def bound(self, now: Iterate) -> Array:
        """Bound g of an iterate."""
        return self.problem.bound(now.pressure) if self.given is None else self.given

    def centred(self, start: State, centring: float, strained: PETSc.Vec | None = None) -> Iterate:
        """The point on the central path next to a state, all products equal to `centring`.

        Its part without rigid motions is `strained`, if given, else that of the displacements.

        It keeps p = r_N/f - w_N/d and q = r_T/f - w_T/d (`smoothed_laws`).
        """
        d, f = self.scales.displacement, self.scales.force
        opening, slip = self._moved(start.displacement, start.pressure, start.shear)
        p = start.pressure / f - opening / d
        y, pressure = normal_law(p, centring)
        y, pressure = y * d, pressure * f

        bound = self.friction * pressure + self.problem.strength
        if self.given is not None:
            bound = self.given
        gamma = np.where(self.sticky, bound / f, 1.0)
        q = start.shear / f - slip / d
        near = distance_from_bound(np.abs(q), gamma, centring)
        if strained is None:  # a cold start, or a mode: no spring may vanish
            near = np.maximum(near, NEAREST * gamma)
        far = 2.0 * gamma - near
        s1, s2 = np.where(q > 0.0, near, far) * f, np.where(q > 0.0, far, near) * f
        z1, z2 = centring * f * d / s1, centring * f * d / s2
        shear = np.where(self.sticky, 0.5 * (s2 - s1), 0.0)
        u = start.displacement.copy()
        load_factor = start.load_factor if self.load_factor is None else self.load_factor
        if strained is None:
            strained = self.problem.strained(u)
        return Iterate(u, strained, load_factor, y, pressure, shear, s1, s2, z1, z2)

    def residual(self, now: Iterate) -> Residual:
        """What is left of the linear conditions; its vector is shared and soon overwritten."""
        problem, equilibrium = self.problem, self.workspace.rest
        problem.stiffness.mult(now.strained, equilibrium)
        equilibrium.axpy(-1.0, problem.dead)
        equilibrium.axpy(-now.load_factor, problem.live)
        self.add_joint_forces(equilibrium, -now.pressure, -now.shear)
        opening, slip = self._moved(now.u, now.pressure, now.shear)
        work = problem.live.dot(now.u) - self.work if self.load_factor is None else 0.0
        return Residual(equilibrium, now.y - opening, now.z2 - now.z1 - slip, work)

    def sizes(self, now: Iterate, residual: Residual) -> dict[str, float]:
        """Relative sizes of residuals and mean product."""
        d, f = self.scales.displacement, self.scales.force
        problem, sticky = self.problem, self.sticky
        equilibrium = problem.max(np.abs(residual.equilibrium.array_r)) / f
        return {
            "equilibrium": EQUILIBRIUM_WEIGHT * equilibrium,
            "opening": problem.max(np.abs(residual.opening)) / d,
            "slip": problem.max(np.abs(residual.slip[sticky])) / d,
            "work": abs(residual.work) / abs(self.work) if residual.work else 0.0,
            "complementarity": self.mean_product(now),
        }

    def factor(
        self, now: Iterate, stiffest: float = LARGEST_SPRING, free: float = PROXIMAL_SPRING
    ) -> tuple[Array, Array, Array]:
        """Factor A with the springs of an iterate.

        Args:
            now: The iterate.
            stiffest: Cap on them, in units of the mean diagonal of K.
            free: Springs where there is no friction, in units of force over displacement.

        Returns:
            k_N, k_T (zero where there is no friction) and q.
        """
        largest = stiffest * self.springs.mean_diagonal
        k_n = np.minimum(now.pressure / now.y, largest)
        lower, upper = now.z1 / now.s1, now.z2 / now.s2
        k_t = np.where(self.sticky, np.minimum(1.0 / (lower + upper), largest), 0.0)
        q = self.friction * k_t * (lower - upper)
        unit = self.scales.force / self.scales.displacement
        normal, tangential, coupling = self.felt((k_n, k_t, q))
        self.springs.factor(
            normal,
            np.where(self.sticky, tangential, free * unit),
            coupling if self.given is None else None,
        )
        return k_n, k_t, q

    def felt(self, springs: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        """Springs that blocks feel: those of the laws, k_N, k_T and q, and what gives, in a row.

        Returns:
            Normal and tangential springs and the coupling of shear to opening.
        """
        k_n, k_t, q = springs
        normal, tangential = self._shares(k_n, k_t)
        return normal * k_n, tangential * k_t, tangential * q * normal * k_n

    def _shares(self, k_n: Array, k_t: Array) -> tuple[Array, Array]:
        """Parts of the displacements of blocks that are left to the laws' springs."""
        give_n, give_t = self.problem.give
        return 1.0 / (1.0 + give_n * k_n), 1.0 / (1.0 + give_t * k_t)

    def directions(
        self,
        now: Iterate,
        springs: tuple[Array, Array, Array],
        asked: Sequence[tuple[Residual, Changes]],
        first: bool = False,
    ) -> list[Iterate]:
        """Newton directions on the last factor, at most two.

        The first ones on a factor find A^-1 f_L too; all is then solved for at once.

        Under work control they are solutions of A u = b + d lambda f_L with f_L.u given. Next to a
        mechanism A^-1 b and A^-1 f_L are far larger than u, and cancel digits. With A^-T f_L
        d lambda is known before, from the directions on that did cancel some.

        Args:
            now: Where.
            springs: As `factor` gave them.
            asked: What is left of the linear conditions and to be taken away, and the changes of
                the products y r_N, s1 z1, s2 z2.
            first: Whether they are the first ones.
        """
        count, live, work = len(asked), self.problem.live, self.workspace
        rights, frees = work.rights[:count], work.frees[:count]
        drives = [
            self._right(now, *one, springs, right) for one, right in zip(asked, rights, strict=True)
        ]
        held, load_factors = self.load_factor is None, [0.0] * count
        if held and self.cancelling:
            if self._factor_of_dual != self.springs.factorizations:
                self.springs.solve_transposed(live, work.dual)
                self._factor_of_dual = self.springs.factorizations
            for k, ((residual, _), right) in enumerate(zip(asked, rights, strict=True)):
                missing = -residual.work - right.dot(work.dual)
                load_factors[k] = float(missing / live.dot(work.dual))
                right.axpy(load_factors[k], live)
        if first and held:
            self.springs.solve_together((*rights, live), (*frees, work.border))
        else:
            for right, free in zip(rights, frees, strict=True):
                self.springs.solve(right, free)
        found = [
            self._found(now, *one, springs, *answer)
            for one, *answer in zip(asked, drives, frees, load_factors, strict=True)
        ]
        if held and self.keeps_digits and not self.cancelling:
            border = work.border.norm(PETSc.NormType.INFINITY)
            self.cancelling = any(
                abs(one.load_factor) * border > CANCELLING * one.u.norm(PETSc.NormType.INFINITY)
                for one in found
            )
        return found

    def _right(
        self,
        now: Iterate,
        residual: Residual,
        changes: Changes,
        springs: tuple[Array, Array, Array],
        right: PETSc.Vec,
    ) -> Array:
        """Set a right-hand side; returns what drives slip."""
        (k_n, k_t, q), (c_n, c_1, c_2) = springs, changes
        residual.equilibrium.copy(right)
        right.scale(-1.0)
        normal, tangential = self._shares(k_n, k_t)
        push = normal * (c_n / now.y + k_n * residual.opening)
        drive = np.where(self.sticky, c_2 / now.s2 - c_1 / now.s1 + residual.slip, 0.0)
        self.add_joint_forces(right, push, tangential * (k_t * drive + q * push))
        return drive

    def _found(
        self,
        now: Iterate,
        residual: Residual,
        changes: Changes,
        springs: tuple[Array, Array, Array],
        drive: Array,
        free: PETSc.Vec,
        load_factor: float,
    ) -> Iterate:
        """The direction of a solution, with A^-1 f_L in `workspace.border`."""
        (k_n, k_t, q), (c_n, c_1, c_2) = springs, changes
        u = free.copy()
        if self.load_factor is None:
            load_factor += self.hold_work(u, residual.work)
        opening, slip = self.joint_displacements(u)
        give_n, give_t = self.problem.give
        normal, tangential = self._shares(k_n, k_t)
        pressure = normal * (c_n / now.y - k_n * (opening - residual.opening))
        y = opening + give_n * pressure - residual.opening
        shear = tangential * (k_t * np.where(self.sticky, drive - slip, 0.0) + q * pressure)
        slip += give_t * shear
        s1, s2 = self.friction * pressure - shear, self.friction * pressure + shear
        z1, z2 = (c_1 - now.z1 * s1) / now.s1, (c_2 - now.z2 * s2) / now.s2
        # Next to its bound the shear force has lost the digits that tell how far a point slides.
        slid, unit = slip - residual.slip, self.scales.displacement / self.scales.force
        lower, upper = now.z1 / now.s1, now.z2 / now.s2
        down, up = lower > np.maximum(upper, unit), upper > np.maximum(lower, unit)
        z1, z2 = np.where(down, z2 - slid, z1), np.where(up, z1 + slid, z2)
        s1 = np.where(down, (c_1 - now.s1 * z1) / now.z1, s1)
        s2 = np.where(up, (c_2 - now.s2 * z2) / now.z2, s2)
        s1, s2, z1, z2 = (np.where(self.sticky, change, 0.0) for change in (s1, s2, z1, z2))
        return Iterate(u, self.problem.strained(u), load_factor, y, pressure, shear, s1, s2, z1, z2)

    def hold_work(self, u: PETSc.Vec, excess: float = 0.0) -> float:
        """Add a multiple of A^-1 f_L to a change u, so that f_L.u takes excess work away.

        Returns:
            The multiple, which is the change of the load factor.
        """
        live, border = self.problem.live, self.workspace.border
        load_factor = float((-excess - u.dot(live)) / border.dot(live))
        u.axpy(load_factor, border)
        return load_factor

    def products(self, now: Iterate) -> float:
        """Sum of all complementarity products, N m per metre of thickness."""
        slip = np.where(self.sticky, now.s1 * now.z1 + now.s2 * now.z2, 0.0)
        return self.problem.sum(now.y * now.pressure + slip)

    def mean_product(self, now: Iterate) -> float:
        """Mean of the products, in units of force times displacement."""
        return self.products(now) / (self.count * self.unit)

    def joint_displacements(self, u: PETSc.Vec) -> tuple[Array, Array]:
        """B_N u and B_T u at this rank's points."""
        opening, slip = self.workspace.opening, self.workspace.slip
        self.problem.normal.mult(u, opening)
        self.problem.tangential.mult(u, slip)
        return opening.array.copy(), slip.array.copy()

    def _moved(self, u: PETSc.Vec, pressure: Array, shear: Array) -> tuple[Array, Array]:
        """Openings and slips, of blocks and of what gives, at this rank's points."""
        (opening, slip), (give_n, give_t) = self.joint_displacements(u), self.problem.give
        return opening + give_n * pressure, slip - self.problem.slip_origin + give_t * shear

    def add_joint_forces(self, vector: PETSc.Vec, pressure: Array, shear: Array) -> None:
        """Add B_N^T r_N + B_T^T r_T."""
        opening, slip = self.workspace.opening, self.workspace.slip
        opening.array[:] = pressure
        slip.array[:] = shear
        self.problem.normal.multTransposeAdd(opening, vector, vector)
        self.problem.tangential.multTransposeAdd(slip, vector, vector)
