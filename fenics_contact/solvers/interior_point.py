"""States under work control by a primal-dual interior point method.

A predictor-corrector method (S. Mehrotra, SIAM J. Optim. 2 (1992) 575) drives the products of the
path's equations (`path_equations`) to zero. As T grows, lambda(T) rises to the limit load and
stays; du/dT is then the collapse mode and d lambda/dT = 1 / (f_L . A^-1 f_L) is zero. Where the
method stalls, and with many blocks or a fine mesh before it is tried alone, the central path is
followed (`central_path`), by default from where the modes of the blocks lead (`block_modes`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.solvers.block_modes import BlockModes
from fenics_contact.solvers.arclength import CLOSE, CentralPath
from fenics_contact.errors import SolverError
from fenics_contact.solvers.kkt import (
    Array,
    Iterate,
    PathEquations,
    Residual,
    Scales,
    State,
    Workspace,
)
from fenics_contact.solvers.problem import ContactProblem
from fenics_contact.solvers.smoothing import Growth
from fenics_contact.solvers.joint_stiffness import SpringStiffness

_log = logging.getLogger("fenics_contact")

#: Residual of the joints, of the blocks with modes alone, up to which a path may begin there.
NEAR_ENOUGH = 0.1

#: Springs of the collapse mode: products of open and sliding joints, in units of force times
#: displacement, and the cap on closed ones, in units of the mean diagonal of K. No forces arise
#: in a mechanism, so that a moderate cap lets nothing penetrate and keeps its digits.
MODE_CENTRING, MODE_SPRING = 1e-12, 1e3

#: Fraction of the way to the boundary that a step may go.
STEP_FRACTION = 0.995

#: Weights of the corrector that are tried.
WEIGHTS = 9

MAX_STEPS = 80

#: Steps without progress after which the best iterate so far is judged: after a warm start, and
#: after a cold one, where the products may grow while the residuals fall.
PATIENCE, COLD_PATIENCE = 6, 25

#: Steps, warm and cold, over which the error has to fall to this part of itself.
SLOW_STEPS, COLD_SLOW_STEPS, SLOW = 10, 20, 0.5

#: The same for a warm start with Coulomb friction, which is a try: there are other ways.
TRYING_STEPS = 6

#: Both where the central path can be followed instead, and for the last steps after it was.
FOLD_STEPS, FINISH_STEPS = 8, 4

#: And the part of itself that one of these last steps may leave of it, until it is small.
STUCK = 0.8

#: Steps towards equilibrium alone, at most, where only that is missing.
BALANCING = 3

#: Steps without progress after an iterate that is good enough, but whose load factor still changes.
RESTING = 3

#: The best iterate of a stalled solve is accepted up to this error where less was asked for.
ACCEPTABLE = 1e-9

#: The same at the end of a path that was followed: what it is worth the certificate tells.
FOLLOWED = 1e-7

#: Error of an interior point iterate from which on the central path is followed past its folds, and
#: products, in units of force times elastic displacement, at which the interior point method
#: finishes, or if need be is tried again; at the first so many no more than `ACCEPTABLE` is left.
HALFWAY, FOLLOW_TO, STRICT = 1e-3, (3e-3, 1e-3, 3e-4, 3e-5, 3e-6), 2

#: Products, in the same units, at which the path of the blocks' modes is left for the structure's:
#: the last, or where that leads nowhere one before.
TRANSFERS = 3e-1, 3e-2, 3e-3

#: Where the path of the modes does not lead to the last of these, or not to half of its products in
#: so many steps, the work is so many times as large, which makes it another path; at the last of
#: them there is no such limit. Few blocks have other ways.
WANDERING, AGAIN = 40, (1.0, 1.5, 2.25)

#: With many blocks, whose first work is large, they are rigid up to these products.
MANY_BLOCKS, RIGID_TO = 200, 1.0

#: With few blocks it is left at these products, and friction grows all the way, like this power:
#: the states found are lower, but with many blocks the path then has too many folds.
FEW_BLOCKS, GROWN, GROWING_POWER = 100, 3e-3, 0.2

#: With so few, and so few displacements per block that factors of modes cost little less, the
#: interior point method is tried alone before, with friction that grows from this coefficient to
#: its full size while the products fall to these, in units of force times displacement; its error
#: has to halve over so many steps.
COARSE, FIRST_FRICTION, FULL_AT, DIRECT_STEPS = 100, 0.1, 1e-4, 12

#: Smallest size of p and q by which changes along the path of the structure are measured, in parts
#: of the displacement that strains it.
SMALLEST_STRAIN = 3.0

#: Growth of friction in a solve without modes.
GROWTH = Growth(1e-3, 0.1)

#: Vectors of the Krylov space in which the contraction of the fixed point is estimated, and the
#: eigenvalue from which on a state repels.
KRYLOV, REPELS = 15, 1.0 + 1e-3

#: Load factors below this fraction of the typical one are zero.
ZERO_FACTOR = 1e-3


@dataclass(frozen=True)
class PathPoint:
    """A state on the load path.

    Attributes:
        state: The state.
        bound: g at this rank's points, N/m.
        residuals: Of the optimality conditions, relative to `Scales`, recomputed at the end.
        steps: Interior point steps, each one factorisation.
        followed: Whether the central path was followed past its folds.
    """

    state: State
    bound: Array
    residuals: dict[str, float]
    steps: int
    followed: bool = False


@dataclass
class _Best:
    """What some steps have led to.

    Attributes:
        iterate: The best one, or of those within the tolerance the last.
        sizes: Its residuals.
        error: The largest of them.
        steps: Number of steps.
        halfway: The first iterate with an error of `HALFWAY`, or else the best.
    """

    iterate: Iterate
    sizes: dict[str, float]
    error: float
    steps: int
    halfway: Iterate

    @property
    def joints(self) -> float:
        """The largest residual, of all but equilibrium."""
        return _largest_but_equilibrium(self.sizes)

    def destroy(self) -> None:
        """Free the vectors."""
        self.iterate.destroy()
        self.halfway.destroy()

    def state(self, work: float, halfway: bool = False) -> State:
        """One of the iterates as a state."""
        now = self.halfway if halfway else self.iterate
        return State(now.u, now.load_factor, now.pressure, now.shear, work, now.strained)


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
    run: PathEquations
    k_n: Array
    drive: Array
    flexibility: float


@dataclass(frozen=True)
class _Way:
    """How the path of the blocks' modes is followed.

    Attributes:
        ends: Products up to which it is, one after another, in units of force times elastic
            displacement.
        grows: Whether friction grows along it.
        patience: Steps at most in which the products have to halve.
    """

    ends: tuple[float, ...]
    grows: bool
    patience: float


class WorkControl:
    """Solves for states of one structure under prescribed work of the live load."""

    def __init__(
        self,
        problem: ContactProblem,
        springs: SpringStiffness,
        block_modes: Callable[[], BlockModes] | None = None,
    ) -> None:
        """Prepare work vectors.

        Args:
            problem: The structure.
            springs: Its stiffness with joint springs.
            block_modes: Reduces it to modes of its blocks, where `from_modes` is used.
        """
        self.problem = problem
        self.springs = springs
        self.workspace = Workspace(problem)
        self.block_modes = block_modes
        self._of_modes = 0
        self._last: _Linearised | None = None

    @property
    def _shared(self) -> tuple[ContactProblem, SpringStiffness, Workspace]:
        """What all equations of this structure have in common."""
        return self.problem, self.springs, self.workspace

    @property
    def factorizations(self) -> int:
        """Numeric factorisations so far, those of the blocks' modes among them."""
        return self.springs.factorizations + self._of_modes

    def destroy(self) -> None:
        """Free the work vectors."""
        self.workspace.destroy()

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
        past_folds: bool = False,
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
            past_folds: Whether to go on along the central path where the interior point method
                stalls, with Coulomb friction under work control.

        Returns:
            The solution, with the residuals recomputed.

        Raises:
            SolverError: If neither the tolerance nor `ACCEPTABLE` is reached.
        """
        growth = GROWTH if growing else None
        run = _InteriorPoint(*self._shared, bound, work, scales, load_factor, growth)
        cold = centring >= 1.0
        window = FOLD_STEPS if past_folds else 0
        best = run.converge(run.start(start, centring), cold, tolerance, settled, window)
        if not past_folds or best.error <= max(tolerance, ACCEPTABLE):
            return self._point(run, best, tolerance)
        try:
            best = self._past_folds(run, best, tolerance, settled)
            return self._point(run, best, tolerance, followed=True)
        except SolverError as error:
            _log.info("  central path: %s", error)
        return self.solve(
            bound, work, start, scales, centring, tolerance, load_factor, settled, growing
        )

    def directly(
        self, work: float, start: State, scales: Scales, tolerance: float, settled: float = np.inf
    ) -> PathPoint:
        """Solve with Coulomb friction that grows, by the interior point method alone.

        Arguments and what is returned are those of `follow`.

        Raises:
            SolverError: If it stalls.
        """
        largest = self.problem.max(self.problem.friction) / FIRST_FRICTION
        power = np.log(max(largest, 1.0)) / np.log(1.0 / FULL_AT)
        run = _InteriorPoint(*self._shared, None, work, scales, growth=Growth(FULL_AT, power))
        best = run.converge(run.start(start, 1.0), True, tolerance, settled, DIRECT_STEPS)
        return self._point(run, best, tolerance)

    def follow(
        self, work: float, start: State, scales: Scales, tolerance: float, settled: float = np.inf
    ) -> PathPoint:
        """Solve with Coulomb friction along the central path, wherever it turns back.

        Where the interior point method stalls this still leads to a state, with more steps.

        Args:
            work: T.
            start: State to start from, however far from a solution.
            scales: Typical sizes.
            tolerance: As in `solve`.
            settled: Likewise.

        Returns:
            The solution, with the residuals recomputed.

        Raises:
            SolverError: If the path leads to none.
        """
        run = _InteriorPoint(*self._shared, None, work, scales)
        best = run.converge(run.centred(start, 1.0), True, HALFWAY)
        best = self._past_folds(run, best, tolerance, settled)
        return self._point(run, best, tolerance, followed=True)

    def from_modes(
        self, work: float, start: State, scales: Scales, tolerance: float, settled: float = np.inf
    ) -> PathPoint:
        """Solve with Coulomb friction from where blocks that only move, stretch and bend lead.

        Arguments and what is returned are those of `follow`, but that the work may be more.

        Raises:
            SolverError: If the path of the modes leads to no state, or that of the structure from
                there to none.
        """
        if self.block_modes is None:
            raise SolverError("modes of the blocks: there are none")
        modes, before = self.block_modes(), self.factorizations
        few = modes.count <= FEW_BLOCKS
        near = self._near(modes, work, start, scales, few)
        work = near[-1][0].work
        run = _InteriorPoint(*self._shared, None, work, scales)
        path = self._path(work, scales)
        while True:
            state, products = near.pop()
            now = path.centred(state, products, state.strained)
            state.displacement.destroy()
            try:
                best = self._to_end(run, path, now, products, tolerance, settled)
                best.steps = self.factorizations - before
                found = self._point(run, best, tolerance, followed=True)
                for other, _ in near:
                    other.destroy()
                return found
            except SolverError as error:
                if not near:
                    raise
                _log.info("  from %.1e on the path of the modes: %s", products, error)

    def _near(
        self, modes: BlockModes, work: float, start: State, scales: Scales, few: bool
    ) -> list[tuple[State, float]]:
        """States along the path of the modes, and their products, the smallest last.

        Many blocks are rigid first. Where the path of more than a few does not lead to the end, but
        in a circle, say, it is another one that is followed, at more work.

        Raises:
            SolverError: If it leads nowhere.
        """
        made, found = modes.factorizations, list[tuple[State, float]]()
        ends, works = ((GROWN,), AGAIN[:1]) if few else (TRANSFERS, AGAIN)
        try:
            for times in works:
                way = _Way(ends, few, np.inf if times == works[-1] else WANDERING)
                try:
                    further = self._at_work(modes, times * work, start, scales, way)
                except SolverError as error:
                    if times == works[-1] and not found:
                        raise
                    _log.info("  modes of the blocks: %s", error)
                    continue
                shorter, found = sorted((found, further), key=len)
                for state, _ in shorter:
                    state.destroy()
                if len(found) == len(ends):
                    break
            return found
        finally:
            self._of_modes += modes.factorizations - made

    def _at_work(
        self,
        modes: BlockModes,
        work: float,
        start: State,
        scales: Scales,
        way: _Way,
    ) -> list[tuple[State, float]]:
        """The same at one work."""
        begin, products = start, np.inf
        if modes.count > MANY_BLOCKS:
            try:
                rigid = replace(way, ends=(RIGID_TO,), patience=np.inf)
                ((begin, products),) = self._led(modes.rigid, work, start, products, scales, rigid)
            except SolverError as error:
                _log.info("  rigid blocks: %s", error)
        try:
            return self._led(modes, work, begin, products, scales, way)
        finally:
            if begin is not start:
                begin.destroy()

    def _led(
        self,
        modes: BlockModes,
        work: float,
        start: State,
        products: float,
        scales: Scales,
        way: _Way,
    ) -> list[tuple[State, float]]:
        """The same for one kind of modes; arguments are those of `_along_modes`."""
        coarse, begin = WorkControl(modes.of(self.problem), modes.springs), modes.restricted(start)
        try:
            found = coarse._along_modes(work, begin, products, scales, way)
        finally:
            begin.destroy()
            coarse.destroy()
            modes.springs.forget()  # their memory is the structure's now
        near = [(modes.prolonged(state), products) for state, products in found]
        for state, _ in found:
            state.destroy()
        return near

    def _along_modes(
        self,
        work: float,
        start: State,
        products: float,
        scales: Scales,
        way: _Way,
    ) -> list[tuple[State, float]]:
        """The same, for blocks that have nothing but these modes.

        Args:
            work: T.
            start: State to start from.
            products: Those at which it is on the path, infinite where it is not.
            scales: Typical sizes.
            way: How it is followed; a state for each of its ends is returned, if there is a first.
        """
        growth = Growth(GROWN * scales.elastic_part, GROWING_POWER) if way.grows else None
        path = CentralPath(*self._shared, None, work, scales, growth=growth)
        if np.isfinite(products):
            now = path.start(start, products)
        else:
            run = _InteriorPoint(*self._shared, None, work, scales, growth=growth)
            tolerance = max(HALFWAY, way.ends[0] * scales.elastic_part)
            best = run.converge(run.start(start, 1.0), True, tolerance, window=FOLD_STEPS)
            error = best.joints  # of equilibrium a large T cancels digits
            if not error <= NEAR_ENOUGH:
                best.destroy()
                raise SolverError(f"interior point: joints' residual {error:.1e}, no path to begin")
            products = path.mean_product(best.iterate)
            now = path.start(best.state(work), products)
            best.destroy()
        found: list[tuple[State, float]] = []
        for end in way.ends:
            close = CLOSE if end == way.ends[-1] else np.inf
            try:
                now, products = path.follow(
                    now, products, end * scales.elastic_part, close, way.patience
                )
            except SolverError as error:
                path.forget()
                if not found:
                    raise
                _log.info("  modes of the blocks, from products %.1e: %s", found[-1][1], error)
                return found
            here = now.copy()
            forces = here.load_factor, here.pressure, here.shear
            found.append((State(here.u, *forces, work, here.strained), products))
        now.destroy()
        path.forget()
        return found

    def _past_folds(
        self, run: _InteriorPoint, best: _Best, tolerance: float, settled: float
    ) -> _Best:
        """What the central path leads to from halfway.

        Raises:
            SolverError: If that is nowhere.
        """
        before = self.springs.factorizations
        path = self._path(run.work, run.scales)
        products = path.mean_product(best.halfway)
        now, steps = path.centred(best.state(run.work, halfway=True), products), best.steps
        best.destroy()
        found = self._to_end(run, path, now, products, tolerance, settled)
        found.steps = steps + self.springs.factorizations - before
        return found

    def _path(self, work: float, scales: Scales) -> CentralPath:
        """The central path of the structure itself, which its strains are part of."""
        path = CentralPath(*self._shared, None, work, scales)
        path.smallest = min(path.smallest, SMALLEST_STRAIN * scales.elastic_part)
        return path

    def _to_end(
        self,
        run: _InteriorPoint,
        path: CentralPath,
        now: Iterate,
        products: float,
        tolerance: float,
        settled: float,
    ) -> _Best:
        """What the central path leads to from a point near it, finished from one of some ends.

        Raises:
            SolverError: If that is nowhere.
        """
        found: list[_Best] = []
        for end in FOLLOW_TO:
            try:
                now, products = path.follow(now, products, end * run.scales.elastic_part)
                if products > end * run.scales.elastic_part:
                    now.destroy()
                    raise SolverError(f"central path: products {products:.1e} after all steps")
            except SolverError:
                path.forget()
                if all(reached.error > FOLLOWED for reached in found):
                    for reached in found:
                        reached.destroy()
                    raise
                break
            found.append(run.converge(now.copy(), False, tolerance, settled, FINISH_STEPS))
            enough = ACCEPTABLE if end in FOLLOW_TO[:STRICT] else FOLLOWED
            if found[-1].error <= max(tolerance, enough) or end == FOLLOW_TO[-1]:
                now.destroy()
                break
        path.forget()
        found.sort(key=lambda reached: reached.error)
        for other in found[1:]:
            other.destroy()
        return found[0]

    def _point(
        self, run: _InteriorPoint, best: _Best, tolerance: float, followed: bool = False
    ) -> PathPoint:
        """The point of the load path that some steps have led to.

        Raises:
            SolverError: If neither the tolerance nor `ACCEPTABLE`, or `FOLLOWED`, is reached.
        """
        best.halfway.destroy()
        if not best.error <= max(tolerance, FOLLOWED if followed else ACCEPTABLE):
            best.iterate.destroy()
            raise SolverError(
                f"interior point: residual {best.error:.1e} after {best.steps} steps,"
                f" asked {tolerance:.1e}"
            )
        work = run.work if run.load_factor is None else self.problem.live.dot(best.iterate.u)
        bound = run.bound(best.iterate)
        # Both were summed up step by step, and rounding has parted them.
        self.problem.replace_strained(best.iterate.u, best.iterate.strained)
        return PathPoint(best.state(work), bound, best.sizes, best.steps, followed)

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
            vectors = self.workspace
            vectors.rights[0].set(0.0)
            shear = near.drive * bound_change
            near.run.add_joint_forces(vectors.rights[0], np.zeros_like(shear), shear)
            self.springs.solve(vectors.rights[0], vectors.frees[0])
            vectors.frees[0].axpy(
                -vectors.frees[0].dot(problem.live) / near.flexibility, vectors.border
            )
            problem.normal.mult(vectors.frees[0], vectors.opening)
            return -problem.friction * near.k_n * vectors.opening.array_r

        values = _ritz_values(change, problem.friction * state.pressure, problem.sum)
        _log.info("  the fixed point's contraction: %s", np.round(values[:3], 4))
        return bool(values.real.max(initial=0.0) > REPELS)

    def rate(self, state: State, bound: Array | None, scales: Scales) -> tuple[PETSc.Vec, float]:
        """Derivatives of a state with respect to T.

        Args:
            state: A solution.
            bound: g at this rank's points, N/m, which stays; None: Coulomb's, which follows.
            scales: Typical sizes.

        Returns:
            du/dT, with f_L . du/dT = 1, and d lambda/dT. At the limit load the first is the
            collapse mode and the second zero.
        """
        flexibility = self._linearised(state, bound, scales).flexibility
        mode = self.workspace.border.copy()
        mode.scale(1.0 / flexibility)
        return mode, 1.0 / flexibility

    def linearised(self, state: State, bound: Array | None) -> bool:
        """Whether the last factor is that of the equations next to a state with such a bound."""
        last = self._last
        if last is None or last.state is not state or (last.run.given is None) != (bound is None):
            return False
        return last.factorization == self.springs.factorizations

    def _linearised(self, state: State, bound: Array | None, scales: Scales) -> _Linearised:
        """The equations next to a solution, factored, with A^-1 f_L in `_border`.

        Asked for twice in a row they are factored once.
        """
        if self._last is not None and self.linearised(state, bound):
            return self._last
        run = PathEquations(*self._shared, bound, state.work, scales)
        now = run.centred(state, MODE_CENTRING)
        k_n, k_t, _ = run.factor(now, MODE_SPRING, MODE_CENTRING)
        drive = k_t * (now.z1 / now.s1 - now.z2 / now.s2)
        now.destroy()
        self.springs.solve(self.problem.live, self.workspace.border)
        flexibility = self.workspace.border.dot(self.problem.live)
        factorization = self.springs.factorizations
        self._last = _Linearised(state, factorization, run, k_n, drive, flexibility)
        return self._last


class _InteriorPoint(PathEquations):
    """Steps of the interior point method on the equations of one solve."""

    def converge(
        self,
        now: Iterate,
        cold: bool,
        tolerance: float,
        settled: float = np.inf,
        window: int = 0,
    ) -> _Best:
        """Take steps until an iterate is good enough, or they no longer lead on.

        Args:
            now: First iterate, not to be used any more.
            cold: Whether it is far from a solution, so that more steps may go without progress.
            tolerance: As those of `WorkControl.solve`.
            settled: Likewise.
            window: Steps over which the error has to halve where there is another way; 0: as long
                as there may be hope.
        """
        best, last = _Best(now.copy(), {}, np.inf, 0, now.copy()), _Last()
        errors: list[float] = []  # smallest so far, of all but what cancels digits of equilibrium
        best_step = 0
        patience, slow_steps = (COLD_PATIENCE, COLD_SLOW_STEPS) if cold else (PATIENCE, SLOW_STEPS)
        if self.given is None and not cold:
            slow_steps = TRYING_STEPS
        if window:
            patience, slow_steps = min(patience, window), window
        if self.load_factor is not None:  # slow close to the limit load, and no less a state
            slow_steps = MAX_STEPS
        for step in range(MAX_STEPS + 1):
            residual = self.residual(now)
            sizes = self.sizes(now, residual)
            error = float(np.max(list(sizes.values())))  # nan where any is nan
            _log.debug("    %2d  %.12g  %s", step, now.load_factor, sizes)
            if error < best.error:
                best_step = step
            if error < best.error or error <= tolerance:  # then the load factor still settles
                if best.error > HALFWAY:
                    best.halfway.destroy()
                    best.halfway = now.copy()
                best.iterate.destroy()
                best.iterate, best.sizes, best.error = now.copy(), sizes, error
            if best.error <= tolerance:
                patience = min(patience, RESTING)
            joints = _largest_but_equilibrium(sizes)
            if not errors or joints < errors[-1]:
                errors.append(joints)
                best_step = step
            else:
                errors.append(errors[-1])
            slow = step >= slow_steps and errors[step] > SLOW * errors[step - slow_steps]
            finishing = window > 0 and not cold and best.error > ACCEPTABLE
            stuck = finishing and step > 0 and joints > STUCK * errors[step - 1]
            stalled = not np.isfinite(error) or slow or stuck or step - best_step >= patience
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
                self.step(now, residual, close=not cold or error <= HALFWAY)
            except SolverError:
                break
            if self.growth is not None and self.mobile < 1.0:
                part = max(self.growth.part(self.mean_product(now)), self.mobile)
                more = self.mobilise(part) * now.pressure
                now.s1, now.s2 = now.s1 + more, now.s2 + more
        other = _Best(now, sizes, error, step, best.halfway.copy())
        if best.error > tolerance and other.joints < best.joints:  # only equilibrium is missing
            step += self.balance(other, tolerance)
            if other.error < best.error:
                best, other = other, best
        other.destroy()
        best.steps = step + self.balance(best, tolerance)
        return best

    def balance(self, best: _Best, tolerance: float) -> int:
        """Take steps towards equilibrium alone where only that is missing.

        Rounding of long steps with stiff springs leaves forces that short ones take away.

        Returns:
            Number of steps.
        """
        for step in range(BALANCING):
            equilibrium, rest = best.sizes.get("equilibrium", 0.0), best.joints
            if equilibrium <= tolerance or rest > max(tolerance, FOLLOWED):
                return step
            now, none = best.iterate.copy(), np.zeros_like(best.iterate.y)
            try:
                springs = self.factor(now)
            except SolverError:
                now.destroy()
                return step
            residual = self.residual(now)
            same = none, none, none
            self.cancelling = True
            (back,) = self.directions(now, springs, [(residual, same)], first=True)
            (length,) = self._lengths(self._rates(now, back)[None])
            now.move(min(1.0, STEP_FRACTION * float(length)), back)
            back.destroy()
            sizes = self.sizes(now, self.residual(now))
            error = float(np.max(list(sizes.values())))
            worse = _largest_but_equilibrium(sizes) > 2.0 * max(rest, tolerance)
            if worse or not sizes["equilibrium"] < equilibrium:
                now.destroy()
                return step + 1
            best.iterate.destroy()
            best.iterate, best.sizes, best.error = now, sizes, error
        return BALANCING

    def step(self, now: Iterate, residual: Residual, close: bool) -> None:
        """One predictor-corrector step on one factor.

        The corrector takes the second-order part of the whole predictor from the products, of
        which only a part may be taken. Close to a state it has the weight, from 1 to the square of
        that part, with which the step is longest (M. Colombo, J. Gondzio, Comput. Optim. Appl. 41
        (2008) 277); far from one longer steps lead past low states.
        """
        springs = self.factor(now)
        here, none = self.products(now), np.zeros_like(now.y)
        changes = -now.y * now.pressure, -now.s1 * now.z1, -now.s2 * now.z2
        (step,) = self.directions(now, springs, [(residual, changes)], first=True)
        towards = self._rates(now, step)
        (part,) = self._lengths(towards[None])
        ahead = (1.0 - part) * here + part**2 * self.products(step)
        target = here / self.count * max(ahead / here, 0.0) ** 3
        changes = (
            target - step.y * step.pressure,
            target - step.s1 * step.z1,
            target - step.s2 * step.z2,
        )
        rest = Residual(self.workspace.zero, none, none, 0.0)
        (corrector,) = self.directions(now, springs, [(rest, changes)])
        weights = np.linspace(1.0, min(part, 1.0) ** 2, WEIGHTS if close else 1)
        lengths = self._lengths(towards + weights[:, None] * self._rates(now, corrector))
        longest = int(np.argmax(lengths))
        step.move(float(weights[longest]), corrector)
        now.move(min(1.0, STEP_FRACTION * float(lengths[longest])), step)
        for direction in (step, corrector):
            direction.destroy()

    def _rates(self, now: Iterate, direction: Iterate) -> Array:
        """Rates at which a direction takes the products' factors to zero, of this rank's points."""
        names = "y", "pressure", "s1", "s2", "z1", "z2"
        return np.concatenate([-getattr(direction, name) / getattr(now, name) for name in names])

    def _lengths(self, rates: Array) -> Array:
        """Longest steps that keep all factors non-negative, at most 1 / STEP_FRACTION.

        Args:
            rates: A row for each step.
        """
        largest = np.max(rates, axis=1, initial=0.0)
        self.problem.comm.Allreduce(MPI.IN_PLACE, largest, MPI.MAX)
        return np.asarray(1.0 / np.maximum(largest, STEP_FRACTION))


def _largest_but_equilibrium(sizes: dict[str, float]) -> float:
    """The largest residual, of all but what cancels digits of equilibrium."""
    return max((size for name, size in sizes.items() if name != "equilibrium"), default=np.inf)


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
