"""One point of the load path under work control, by a primal-dual interior point method.

Prescribe the work of the live load, f_L.u = T; its multiplier is the load factor. With given
friction g this is a convex problem,

    min 1/2 u.Ku - f_D.u + g.|B_T u|   subject to   B_N u >= 0,   f_L.u = T;

with Coulomb friction, g = F r_N, only its optimality conditions remain. With slacks y = B_N u,
s1 = g - r_T, s2 = g + r_T and slip split as B_T u = -z1 + z2 they are

    K u = f_D + lambda f_L + B_N^T r_N + B_T^T r_T,   f_L.u = T,
    y r_N = 0,   s1 z1 = 0,   s2 z2 = 0,   all six >= 0.

A predictor-corrector method (S. Mehrotra, SIAM J. Optim. 2 (1992) 575) drives the products to
zero. Eliminating all but (u, lambda), every step is an elastic solve in which the joints are
springs, bordered by f_L:

    k_N = r_N / y,    k_T = 1 / (z1/s1 + z2/s2),    coupling  q k_N,  q = F k_T (z1/s1 - z2/s2),

the coupling with Coulomb friction only. As T grows, lambda(T) rises to the limit load and stays;
du/dT is then the collapse mode and d lambda/dT = 1 / (f_L . A^-1 f_L) is zero.

The motion of a mechanism may be so much larger than what strains the blocks that u has no digits
left for K u. So the part of u without rigid motions of blocks is summed up step by step for itself.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.errors import SolverError
from fenics_contact.problem import ContactProblem
from fenics_contact.springs import SpringStiffness

Array = npt.NDArray[np.float64]

_log = logging.getLogger("fenics_contact")

#: Largest spring, in units of the mean diagonal of K; larger ones would cancel digits.
LARGEST_SPRING = 1e10

#: Springs of the collapse mode: products of open and sliding joints, in units of force times
#: displacement, and the cap on closed ones, in units of the mean diagonal of K. No forces arise
#: in a mechanism, so that a moderate cap lets nothing penetrate and keeps its digits.
MODE_CENTRING, MODE_SPRING = 1e-12, 1e3

#: Springs that resist the steps, not the slip, of points that transmit no shear, in units of force
#: over displacement: without them blocks on frictionless joints would have no stiffness.
PROXIMAL_SPRING = 1e-8

#: Points whose bound is below this fraction of the typical force transmit no shear.
NO_FRICTION = 1e-12

#: Fraction of the way to the boundary that a step may go.
STEP_FRACTION = 0.995

MAX_STEPS = 80

#: Steps without progress after which the best iterate so far is judged: after a warm start, and
#: after a cold one, where the products may grow while the residuals fall.
PATIENCE, COLD_PATIENCE = 6, 25

#: Steps, warm and cold, over which the error has to fall to this part of itself.
SLOW_STEPS, COLD_SLOW_STEPS, SLOW = 10, 20, 0.5

#: The same after an iterate that is good enough, but whose load factor still changes.
RESTING = 3

#: The best iterate of a stalled solve is accepted up to this error where less was asked for.
ACCEPTABLE = 1e-9

#: Friction that grows is (mean product / the first)^-(the second) of what it is, at most all.
MOBILE_AT, MOBILE_POWER = 1e-3, 0.1

#: Vectors of the Krylov space in which the contraction of the fixed point is estimated, and the
#: eigenvalue from which on a state repels.
KRYLOV, REPELS = 15, 1.0 + 1e-3

#: Load factors below this fraction of the typical one are zero.
ZERO_FACTOR = 1e-3

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
    """

    displacement: float
    force: float
    load_factor: float


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


@dataclass(frozen=True)
class PathPoint:
    """A state on the load path.

    Attributes:
        state: The state.
        bound: g at this rank's points, N/m.
        residuals: Of the optimality conditions, relative to `Scales`, recomputed at the end.
        steps: Interior point steps, each one factorisation.
    """

    state: State
    bound: Array
    residuals: dict[str, float]
    steps: int


@dataclass
class _Iterate:
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

    def move(self, length: float, direction: _Iterate) -> None:
        """Take a step along a direction."""
        self.u.axpy(length, direction.u)
        self.strained.axpy(length, direction.strained)
        for field in fields(self)[2:]:
            here, there = getattr(self, field.name), getattr(direction, field.name)
            setattr(self, field.name, here + length * there)

    def copy(self) -> _Iterate:
        """A copy with arrays of its own."""
        rest = (getattr(self, field.name) for field in fields(self)[3:])
        vectors = self.u.copy(), self.strained.copy()
        return _Iterate(*vectors, self.load_factor, *(array.copy() for array in rest))

    def destroy(self) -> None:
        """Free the vectors, which PETSc would otherwise keep for long."""
        self.u.destroy()
        self.strained.destroy()


@dataclass(frozen=True)
class _Residual:
    """What is left of the linear optimality conditions at an iterate."""

    equilibrium: PETSc.Vec
    opening: Array
    slip: Array
    work: float


@dataclass
class _Best:
    """The best iterate of some steps, its residuals, the largest of them, and their number."""

    iterate: _Iterate
    sizes: dict[str, float]
    error: float
    steps: int


@dataclass(frozen=True)
class _Last:
    """Load factor of the last iterate, its change, and the mean product."""

    load_factor: float = np.inf
    moved: float = 1.0
    products: float = 1.0


@dataclass(frozen=True)
class _Linearised:
    """The equations next to a state, on the factor with this number.

    `drive` is k_T (z1/s1 - z2/s2), `flexibility` f_L . A^-1 f_L.
    """

    state: State
    factorization: int
    run: _InteriorPoint
    k_n: Array
    drive: Array
    flexibility: float


class WorkControl:
    """Solves for states of one structure under prescribed work of the live load."""

    def __init__(self, problem: ContactProblem, springs: SpringStiffness) -> None:
        """Prepare work vectors.

        Args:
            problem: The structure.
            springs: Its stiffness with joint springs.
        """
        self.problem = problem
        self.springs = springs
        self._right = problem.dead.duplicate()
        self._free = problem.dead.duplicate()
        self._border = problem.dead.duplicate()
        self._rest = problem.dead.duplicate()
        self._opening = problem.normal.createVecLeft()
        self._slip = problem.tangential.createVecLeft()
        self._last: _Linearised | None = None

    def destroy(self) -> None:
        """Free the work vectors."""
        for vector in (
            self._right, self._free, self._border, self._rest, self._opening, self._slip
        ):  # fmt: skip
            vector.destroy()

    def solve(
        self,
        bound: Array | None,
        work: float,
        start: State,
        scales: Scales,
        centring: float = 1.0,
        tolerance: float = 1e-12,
        load_factor: float | None = None,
        settled: float = np.inf,
        growing: bool = False,
    ) -> PathPoint:
        """Solve for given work, or for a given load factor.

        Args:
            bound: g at this rank's points, N/m; points with zero slide freely. None: Coulomb's.
            work: T, N m per metre of thickness; not used with a load factor.
            start: State to start from; its joint forces need not be admissible.
            scales: Typical sizes.
            centring: Complementarity products of the start, in units of force times displacement.
            tolerance: On the mean product and the joints' residuals, relative to `scales`.
            load_factor: If given, lambda is prescribed, not the work.
            settled: Change that the load factor may still make as the products go to zero,
                relative.
            growing: Whether Coulomb friction grows to its full size as the products fall; without
                a given bound only.

        Returns:
            The solution, with the residuals recomputed.

        Raises:
            SolverError: If neither the tolerance nor `ACCEPTABLE` is reached.
        """
        run = _InteriorPoint(self, bound, work, scales, load_factor, growing)
        if growing:
            run.mobilise(centring)
        best = run.converge(run.centred(start, centring), centring >= 1.0, tolerance, settled)
        if not best.error <= max(tolerance, ACCEPTABLE):
            best.iterate.destroy()
            raise SolverError(
                f"interior point: residual {best.error:.1e} after {best.steps} steps,"
                f" asked {tolerance:.1e}"
            )
        now = best.iterate
        if load_factor is not None:
            work = self.problem.live.dot(now.u)
        state = State(now.u, now.load_factor, now.pressure, now.shear, work, now.strained)
        return PathPoint(state, run.bound(now), best.sizes, best.steps)

    def repels(self, state: State, bound: Array, scales: Scales) -> bool:
        """Whether the iteration g -> F r_N(g) leaves the neighbourhood of a state.

        With springs as in `rate` a change dg of the bound changes the normal forces by

            A du = d lambda f_L + B_T^T k_T (z1/s1 - z2/s2) dg,   f_L.du = 0,   dr_N = -k_N B_N du.

        The relaxed iteration approaches a fixed point where all eigenvalues of dg -> F dr_N have a
        real part below one; those of largest size are found by Arnoldi's method (W.E. Arnoldi,
        Q. Appl. Math. 9 (1951) 17).

        Args:
            state: A solution with g = F r_N.
            bound: g at this rank's points, N/m.
            scales: Typical sizes.
        """
        problem = self.problem
        near = self._linearised(state, bound, scales)

        def change(bound_change: Array) -> Array:
            self._right.set(0.0)
            shear = near.drive * bound_change
            near.run.add_joint_forces(self._right, np.zeros_like(shear), shear)
            self.springs.solve(self._right, self._free)
            self._free.axpy(-self._free.dot(problem.live) / near.flexibility, self._border)
            problem.normal.mult(self._free, self._opening)
            return -problem.friction * near.k_n * self._opening.array_r

        values = _ritz_values(change, problem.friction * state.pressure, problem.sum)
        _log.info("  the fixed point's contraction: %s", np.round(values[:3], 4))
        return bool(values.real.max(initial=0.0) > REPELS)

    def rate(self, state: State, bound: Array, scales: Scales) -> tuple[PETSc.Vec, float]:
        """Derivatives of a state with respect to T while the bound on friction stays.

        Args:
            state: A solution.
            bound: g at this rank's points, N/m.
            scales: Typical sizes.

        Returns:
            du/dT, with f_L . du/dT = 1, and d lambda/dT. At the limit load the first is the
            collapse mode and the second zero.
        """
        flexibility = self._linearised(state, bound, scales).flexibility
        mode = self._border.copy()
        mode.scale(1.0 / flexibility)
        return mode, 1.0 / flexibility

    def _linearised(self, state: State, bound: Array, scales: Scales) -> _Linearised:
        """The equations next to a solution, factored, with A^-1 f_L in `_border`.

        Asked for twice in a row they are factored once.
        """
        last, count = self._last, self.springs.factorizations
        if last is not None and last.state is state and last.factorization == count:
            return last
        run = _InteriorPoint(self, bound, state.work, scales)
        now = run.centred(state, MODE_CENTRING)
        k_n, k_t, _ = run.factor(now, MODE_SPRING * self.springs.mean_diagonal, MODE_CENTRING)
        drive = k_t * (now.z1 / now.s1 - now.z2 / now.s2)
        now.destroy()
        self.springs.solve(self.problem.live, self._border)
        flexibility = self._border.dot(self.problem.live)
        factorization = self.springs.factorizations
        self._last = _Linearised(state, factorization, run, k_n, drive, flexibility)
        return self._last


class _InteriorPoint:
    """The equations of one solve: one bound, and one T or load factor."""

    def __init__(
        self,
        solver: WorkControl,
        bound: Array | None,
        work: float,
        scales: Scales,
        load_factor: float | None = None,
        growing: bool = False,
    ) -> None:
        self.problem = problem = solver.problem
        self.springs = solver.springs
        self.workspace = solver
        self.given = bound
        self.work = work
        self.load_factor = load_factor
        self.scales = scales
        self._unit = scales.force * scales.displacement
        #: Coulomb's coefficient where the bound follows the pressure: that of the problem, or
        #: where it grows, the part `mobile` of it.
        self.mobile = 0.0 if growing else 1.0
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

    def converge(
        self, now: _Iterate, cold: bool, tolerance: float, settled: float = np.inf
    ) -> _Best:
        """Take steps until an iterate is good enough, or they no longer lead on.

        Args:
            now: First iterate, not to be used any more.
            cold: Whether it is far from a solution, so that more steps may go without progress.
            tolerance: As those of `WorkControl.solve`.
            settled: Likewise.
        """
        best, last = _Best(now.copy(), {}, np.inf, 0), _Last()
        best_step, errors = 0, []
        patience, window = (COLD_PATIENCE, COLD_SLOW_STEPS) if cold else (PATIENCE, SLOW_STEPS)
        if self.load_factor is not None:  # slow close to the limit load, and no less a state
            window = MAX_STEPS
        for step in range(MAX_STEPS + 1):
            residual = self.residual(now)
            sizes = self.sizes(now, residual)
            error = float(np.max(list(sizes.values())))  # nan where any is nan
            _log.debug("    %2d  %.12g  %s", step, now.load_factor, sizes)
            if error < best.error:
                best.iterate.destroy()
                best, best_step = _Best(now.copy(), sizes, error, step), step
            if best.error <= tolerance:
                patience = min(patience, RESTING)
            errors.append(best.error)
            slow = step >= window and errors[step] > SLOW * errors[step - window]
            stalled = not np.isfinite(error) or slow or step - best_step >= patience
            # The rest of the load factor's change is to the last one as that is to the one before,
            # or as the products are.
            products, moved = sizes["complementarity"], abs(now.load_factor - last.load_factor)
            falls = max(products / last.products, moved / last.moved if last.moved else 0.0)
            rest = moved * min(falls, 1.0)
            size = abs(now.load_factor) + ZERO_FACTOR * self.scales.load_factor
            rests = settled == np.inf or rest <= settled * size
            if (error <= tolerance and rests) or stalled or step == MAX_STEPS:
                break
            last = _Last(now.load_factor, moved, products)
            try:
                self.step(now, residual)
            except SolverError:
                break
            if self.mobile < 1.0:
                more = self.mobilise(self._products(now) / (self.count * self._unit)) * now.pressure
                now.s1, now.s2 = now.s1 + more, now.s2 + more
        best.steps = step
        now.destroy()
        return best

    def mobilise(self, products: float) -> Array:
        """Raise Coulomb's coefficient to what the mean product calls for.

        Collapse states are not unique, and those met with little friction first are low ones.

        Returns:
            The change of the coefficient.
        """
        before = self.friction
        self.mobile = max(self.mobile, min((MOBILE_AT / products) ** MOBILE_POWER, 1.0))
        self.friction = self.mobile * self.problem.friction
        return self.friction - before

    def bound(self, now: _Iterate) -> Array:
        """Bound g of an iterate."""
        return self.problem.bound(now.pressure) if self.given is None else self.given

    def centred(self, start: State, centring: float) -> _Iterate:
        """The point on the central path next to a state, all products equal to `centring`.

        With p = r_N/f - w_N/d the pair y/d, r_N/f = (sqrt(p^2 + 4 mu) -+ p) / 2 has product mu and
        keeps r_N/f - y/d; the shear solves rho + 2 mu rho / (gamma^2 - rho^2) = r_T/f - w_T/d.
        """
        d, f = self.scales.displacement, self.scales.force
        opening, slip = self._joint_displacements(start.displacement)
        slip -= self.problem.slip_origin
        p = start.pressure / f - opening / d
        large = 0.5 * (np.sqrt(p**2 + 4.0 * centring) + np.abs(p))
        small = centring / large
        y, pressure = np.where(p > 0.0, small, large) * d, np.where(p > 0.0, large, small) * f

        bound = self.friction * pressure + self.problem.strength
        if self.given is not None:
            bound = self.given
        gamma = np.where(self.sticky, bound / f, 1.0)
        q = start.shear / f - slip / d
        low, high = -gamma, gamma.copy()
        for _ in range(60):  # bisection: the left-hand side increases
            rho = 0.5 * (low + high)
            room = gamma**2 - rho**2
            above = rho * room + 2.0 * centring * rho > q * room
            low, high = np.where(above, low, rho), np.where(above, rho, high)
        rho = np.clip(0.5 * (low + high), -gamma * (1.0 - 1e-9), gamma * (1.0 - 1e-9))
        s1, s2 = (gamma - rho) * f, (gamma + rho) * f
        z1, z2 = centring * f * d / s1, centring * f * d / s2
        shear = np.where(self.sticky, rho * f, 0.0)
        u = start.displacement.copy()
        load_factor = start.load_factor if self.load_factor is None else self.load_factor
        return _Iterate(
            u, self.problem.strained(u), load_factor, y, pressure, shear, s1, s2, z1, z2
        )

    def residual(self, now: _Iterate) -> _Residual:
        problem, equilibrium = self.problem, self.workspace._rest
        problem.stiffness.mult(now.strained, equilibrium)
        equilibrium.axpy(-1.0, problem.dead)
        equilibrium.axpy(-now.load_factor, problem.live)
        self.add_joint_forces(equilibrium, -now.pressure, -now.shear)
        opening, slip = self._joint_displacements(now.u)
        slip -= problem.slip_origin
        work = problem.live.dot(now.u) - self.work if self.load_factor is None else 0.0
        return _Residual(equilibrium, now.y - opening, now.z2 - now.z1 - slip, work)

    def sizes(self, now: _Iterate, residual: _Residual) -> dict[str, float]:
        """Relative sizes of residuals and mean product."""
        d, f = self.scales.displacement, self.scales.force
        problem, sticky = self.problem, self.sticky
        equilibrium = problem.max(np.abs(residual.equilibrium.array_r)) / f
        return {
            "equilibrium": EQUILIBRIUM_WEIGHT * equilibrium,
            "opening": problem.max(np.abs(residual.opening)) / d,
            "slip": problem.max(np.abs(residual.slip[sticky])) / d,
            "work": abs(residual.work) / abs(self.work) if residual.work else 0.0,
            "complementarity": self._products(now) / (self.count * self._unit),
        }

    def factor(self, now: _Iterate, largest: float, free: float) -> tuple[Array, Array, Array]:
        """Factor A with the springs of an iterate, and springs `free` where there is no friction.

        Returns:
            k_N, k_T (zero where there is no friction) and q.
        """
        k_n = np.minimum(now.pressure / now.y, largest)
        lower, upper = now.z1 / now.s1, now.z2 / now.s2
        k_t = np.where(self.sticky, np.minimum(1.0 / (lower + upper), largest), 0.0)
        q = self.friction * k_t * (lower - upper)
        unit = self.scales.force / self.scales.displacement
        self.springs.factor(
            k_n, np.where(self.sticky, k_t, free * unit), q * k_n if self.given is None else None
        )
        return k_n, k_t, q

    def step(self, now: _Iterate, residual: _Residual) -> None:
        """One predictor-corrector step on one factor."""
        springs = self.factor(now, LARGEST_SPRING * self.springs.mean_diagonal, PROXIMAL_SPRING)
        here = self._products(now)
        y, r, s1, s2, z1, z2 = now.y, now.pressure, now.s1, now.s2, now.z1, now.z2
        affine = self._direction(now, residual, springs, -y * r, -s1 * z1, -s2 * z2, first=True)
        ahead = now.copy()
        ahead.move(self._length(now, affine), affine)
        target = here / self.count * max(self._products(ahead) / here, 0.0) ** 3
        corrected = self._direction(
            now,
            residual,
            springs,
            target - y * r - affine.y * affine.pressure,
            target - s1 * z1 - affine.s1 * affine.z1,
            target - s2 * z2 - affine.s2 * affine.z2,
        )
        length = STEP_FRACTION * self._length(now, corrected)
        now.move(min(1.0, length), corrected)
        for iterate in (affine, ahead, corrected):
            iterate.destroy()

    def _direction(
        self,
        now: _Iterate,
        residual: _Residual,
        springs: tuple[Array, Array, Array],
        c_n: Array,
        c_1: Array,
        c_2: Array,
        first: bool = False,
    ) -> _Iterate:
        """Newton direction towards products changed by c_n, c_1, c_2 (module docstring).

        The first one on a factor finds A^-1 f_L too.
        """
        k_n, k_t, q = springs
        right, free, border = self.workspace._right, self.workspace._free, self.workspace._border
        residual.equilibrium.copy(right)
        right.scale(-1.0)
        push = c_n / now.y + k_n * residual.opening
        drive = np.where(self.sticky, c_2 / now.s2 - c_1 / now.s1 + residual.slip, 0.0)
        self.add_joint_forces(right, push, k_t * drive + q * push)
        live = self.problem.live
        if first and self.load_factor is None:
            self.springs.solve_pair((right, live), (free, border))
        else:
            self.springs.solve(right, free)
        u, load_factor = free.copy(), 0.0
        if self.load_factor is None:
            load_factor = (-residual.work - free.dot(live)) / border.dot(live)
            u.axpy(load_factor, border)
        opening, slip = self._joint_displacements(u)
        y = opening - residual.opening
        pressure = c_n / now.y - k_n * y
        shear = k_t * np.where(self.sticky, drive - slip, 0.0) + q * pressure
        s1, s2 = self.friction * pressure - shear, self.friction * pressure + shear
        z1 = np.where(self.sticky, (c_1 - now.z1 * s1) / now.s1, 0.0)
        z2 = np.where(self.sticky, (c_2 - now.z2 * s2) / now.s2, 0.0)
        s1, s2 = np.where(self.sticky, s1, 0.0), np.where(self.sticky, s2, 0.0)
        return _Iterate(
            u, self.problem.strained(u), load_factor, y, pressure, shear, s1, s2, z1, z2
        )

    def _length(self, now: _Iterate, direction: _Iterate) -> float:
        """Longest step that keeps all products' factors non-negative, at most 1 / STEP_FRACTION."""
        ratio = 0.0
        for name in ("y", "pressure", "s1", "s2", "z1", "z2"):
            here, there = getattr(now, name), getattr(direction, name)
            ratio = max(ratio, float(np.max(-there / here, initial=0.0)))
        return 1.0 / max(self.problem.comm.allreduce(ratio, MPI.MAX), STEP_FRACTION)

    def _products(self, now: _Iterate) -> float:
        """Sum of all complementarity products, N m per metre of thickness."""
        slip = np.where(self.sticky, now.s1 * now.z1 + now.s2 * now.z2, 0.0)
        return self.problem.sum(now.y * now.pressure + slip)

    def _joint_displacements(self, u: PETSc.Vec) -> tuple[Array, Array]:
        """B_N u and B_T u at this rank's points."""
        opening, slip = self.workspace._opening, self.workspace._slip
        self.problem.normal.mult(u, opening)
        self.problem.tangential.mult(u, slip)
        return opening.array.copy(), slip.array.copy()

    def add_joint_forces(self, vector: PETSc.Vec, pressure: Array, shear: Array) -> None:
        """Add B_N^T r_N + B_T^T r_T."""
        opening, slip = self.workspace._opening, self.workspace._slip
        opening.array[:] = pressure
        slip.array[:] = shear
        self.problem.normal.multTransposeAdd(opening, vector, vector)
        self.problem.tangential.multTransposeAdd(slip, vector, vector)


def _ritz_values(
    apply: Callable[[Array], Array], start: Array, total: Callable[[Array], float]
) -> npt.NDArray[np.complex128]:
    """Estimates of eigenvalues of a map of joint arrays, largest first.

    Args:
        apply: The map.
        start: First vector, this rank's part.
        total: Sums an array over all ranks.
    """
    size = np.sqrt(total(start**2))
    if not size > 0.0:
        return np.zeros(0, dtype=np.complex128)
    basis = [start / size]
    projection = np.zeros((KRYLOV + 1, KRYLOV))
    steps = 0
    for step in range(KRYLOV):
        vector = apply(basis[-1])
        scale = np.sqrt(total(vector**2))
        for k, direction in enumerate(basis):
            projection[k, step] = total(direction * vector)
            vector = vector - projection[k, step] * direction
        steps = step + 1
        rest = np.sqrt(total(vector**2))
        if not rest > 1e-10 * scale:
            break
        projection[steps, step] = rest
        basis.append(vector / rest)
    values = np.linalg.eigvals(projection[:steps, :steps])
    return values[np.argsort(-np.abs(values))]
