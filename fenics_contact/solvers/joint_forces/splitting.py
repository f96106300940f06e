"""States with given friction from their joint forces: normal and shear forces in turn, or at once.

With displacements eliminated (`delassus`) a state with given friction g minimises

    1/2 x.A x - b.x   subject to   r_N >= 0,  |r_T| <= g,      x = (r_N, r_T, lambda).

*Splitting* (L.A. Mihai, M. Ainsworth, Comput. Struct. 88 (2010) 859) minimises over (r_N, lambda)
with the shear forces prescribed, then over (r_T, lambda) with the normal forces prescribed. Where
these sweeps contract slowly, a step that minimises over all of x ends them.

All this happens inside a proximal point iteration (R.T. Rockafellar, SIAM J. Control Optim. 14
(1976) 877) on displacements and forces, which are held near those of the last step. The hold has no
part in the solution.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.solvers.joint_forces.bound_qp import BoundQPOptions
from fenics_contact.solvers.joint_forces.delassus import DelassusOperator, JointPoints
from fenics_contact.solvers.problem import Array, Closing, ContactProblem, Owner, Scales, State

_log = logging.getLogger("fenics_contact")

#: Kinds of joint forces that a program is solved for, beside the load factor.
NORMAL = (0,)
TANGENTIAL = (1,)
BOTH = (0, 1)

#: What a state misses of its conditions with a given bound, by name, relative to typical sizes.
Residuals = Callable[[ContactProblem, State, Scales, Array], Mapping[str, float]]


@dataclass(frozen=True)
class JointForceOptions:
    """Constants of the method.

    Attributes:
        hold: First rho, in units of typical joint force over displacement: larger ones take more
            proximal steps, smaller ones programs that are harder to solve.
        hold_factor: From one rho to the next.
        holds: Number of different rho: with smaller ones digits are lost.
        balance: Joint laws missed by this times more than equilibrium call for a larger rho.
        slow_step: A step that contracts less is followed by one with a smaller rho.
        force_hold: Hold on the forces, in units of A's diagonal: makes programs definite.
        patience: Steps without half the residual after which the best state is judged.
        acceptable: Residual up to which it is returned.
        solver: Back end for programs, see `bound_qp`.
        accuracy: Tolerance on programs, relative to the change in the last step, and its limits.
        slow_sweep: Sweeps that contract less are ended by a step for all forces.
        sweep_accuracy: Sweeps end at this residual, relative to the change in the last step.
    """

    hold: float = 0.1
    hold_factor: float = 0.2
    holds: int = 7
    balance: float = 1e2
    slow_step: float = 0.3
    force_hold: float = 1e-7
    patience: int = 12
    acceptable: float = 1e-7
    solver: str = "faces"
    accuracy: tuple[float, float, float] = (1e-3, 1e-12, 1e-3)
    slow_sweep: float = 0.1
    sweep_accuracy: float = 0.1


@dataclass
class SplittingHistory:
    """Counts over all states solved for.

    Attributes:
        steps: Proximal steps.
        joint_steps: Those that ended with a step for both kinds of forces at once.
        sweeps: Pairs of subproblems.
        log_contraction: Sum over the sweeps of the logarithms of what the residual fell by.
    """

    steps: int = 0
    joint_steps: int = 0
    sweeps: int = 0
    log_contraction: float = 0.0

    @property
    def contraction(self) -> float | None:
        """Factor by which the residual fell per sweep, geometric mean; None without sweeps."""
        return float(np.exp(self.log_contraction / self.sweeps)) if self.sweeps else None


@dataclass(frozen=True)
class ProximalStep:
    """The program of one proximal step.

    Attributes:
        operator: A + D.
        right: b + D x', this rank's part like all arrays here.
        bounds: Lower and upper bounds on x.
        change: Change of the displacements in the last step, relative.
        displacement: Typical displacement, m.
        options: Constants.
        history: Counts.
    """

    operator: DelassusOperator
    right: Array
    bounds: tuple[Array, Array]
    change: float
    displacement: float
    options: JointForceOptions
    history: SplittingHistory

    def minimise(self, kinds: tuple[int, ...], x: Array) -> Array:
        """Minimiser over some kinds of forces, and the load factor, from x."""
        rows, program = self.operator.program(kinds)
        found = x.copy()
        found[rows] = 0.0
        rest = self.right - self.operator.matrix @ found
        part, least, largest = self.options.accuracy
        how = BoundQPOptions(
            self.options.solver, float(np.clip(part * self.change, least, largest))
        )
        lower, upper = self.bounds
        found[rows] = program.solve(rest[rows], lower[rows], upper[rows], x[rows], how).x
        return found

    def residual(self, x: Array) -> float:
        """Openings and slips that x misses the joint laws by, relative to typical ones."""
        lower, upper = self.bounds
        gradient = self.operator.matrix @ x - self.right
        unit = self.operator.hold / self.options.force_hold
        miss = np.minimum((x - lower) * unit, np.maximum((x - upper) * unit, gradient))
        miss = np.abs(miss[: 2 * self.operator.points])
        largest = self.operator.matrix.comm.allgather(float(np.max(miss, initial=0.0)))
        return float(np.max(largest)) / self.displacement


def at_once(step: ProximalStep, x: Array) -> Array:
    """Minimiser over normal and shear forces at once, from x."""
    step.history.joint_steps += 1
    return step.minimise(BOTH, x)


def alternately(step: ProximalStep, x: Array) -> Array:
    """Minimiser by sweeps, ended by a step for all forces where they contract slowly, from x."""
    options = step.options
    history = step.history
    residual = step.residual(x)
    while residual > options.sweep_accuracy * step.change:
        x = step.minimise(TANGENTIAL, step.minimise(NORMAL, x))
        before = residual
        residual = step.residual(x)
        history.sweeps += 1
        history.log_contraction += float(np.log(max(residual / before, options.accuracy[1])))
        if not residual <= options.slow_sweep * before:
            return at_once(step, x)
    return x


class JointForceSolver(Closing):
    """Solves for states with given friction by joint forces; frees its objects in a `with`.

    Attributes:
        history: Counts.
        factorizations: Of stiffnesses so far.
    """

    def __init__(
        self,
        problem: ContactProblem,
        points: JointPoints,
        residuals: Residuals,
        minimise: Callable[[ProximalStep, Array], Array] = alternately,
        options: JointForceOptions | None = None,
    ) -> None:
        """Choose how to minimise: `alternately` or `at_once`."""
        self.history = SplittingHistory()
        self.factorizations = 0
        self._problem = problem
        self._points = points
        self._residuals = residuals
        self._minimise = minimise
        self._options = options or JointForceOptions()
        self._owner = Owner()
        self._operators: dict[float, DelassusOperator] = {}

    def solve(
        self, bound: Array, work: float, start: State, scales: Scales, tolerance: float
    ) -> tuple[State, dict[str, float]]:
        """State with friction bound g under given work, and its residuals, recomputed.

        Args:
            bound: g at this rank's points, N per metre of thickness.
            work: T, N m per metre of thickness.
            start: State to start from.
            scales: Typical sizes.
            tolerance: On the residuals of the state.

        Raises:
            SolverError: If neither the tolerance nor what is acceptable is reached.
        """
        state = self._within(start, bound, work)
        best: tuple[float, State, dict[str, float]] = np.inf, state, {}
        errors: list[float] = []
        level = 0
        last = 1.0
        patience = self._options.patience
        while not best[0] <= tolerance:
            near = state
            state = self._step(level, near, bound, scales, last)
            residuals = dict(self._residuals(self._problem, state, scales, bound))
            errors.append(float(np.max(list(residuals.values()))))
            best = min(best, (errors[-1], state, residuals), key=lambda found: found[0])
            if not min(errors[-patience:]) < 0.5 * min([np.inf, *errors[:-patience]]):
                break
            level, last = self._adapted(level, last, near, state, residuals)
        self.history.steps += len(errors)
        reached = f"joint forces: residual {best[0]:.1e} after {len(errors)} steps"
        _log.debug(reached)
        if not best[0] <= max(tolerance, self._options.acceptable):
            raise SolverError(f"{reached}, asked {tolerance:.1e}")
        return best[1], best[2]

    def _adapted(
        self, level: int, last: float, near: State, state: State, residuals: Mapping[str, float]
    ) -> tuple[int, float]:
        """Level and accuracy for the next step.

        rho falls where it delays equilibrium, and rises where programs, badly conditioned with a
        small rho, miss the joint laws.
        """
        size = self._problem.max(np.abs(state.displacement)) or 1.0
        change = self._problem.max(np.abs(state.displacement - near.displacement)) / size
        joints = max(value for name, value in residuals.items() if name != "equilibrium")
        if joints > self._options.balance * residuals["equilibrium"]:
            level = max(level - 1, 0)
        elif last < 1.0 and change > self._options.slow_step * last:
            level = min(level + 1, self._options.holds - 1)
        return level, min(change, last, joints + residuals["equilibrium"])

    def _within(self, start: State, bound: Array, work: float) -> State:
        """A state with forces within bounds, at the work asked for."""
        u = start.displacement * (work / self._problem.dot(self._problem.live, start.displacement))
        pressure = np.maximum(start.pressure, 0.0)
        shear = np.clip(start.shear, -bound, bound)
        return State(u, start.elastic, start.load_factor, pressure, shear, work)

    def _step(self, level: int, near: State, bound: Array, scales: Scales, change: float) -> State:
        """The state one proximal step from another, by a rho, after a change."""
        options = self._options
        history = self.history
        size = scales.displacement
        operator = self._operator(options.hold * scales.force / size * options.hold_factor**level)
        none = np.full_like(bound, np.inf)
        held = operator.join(near.pressure, near.shear, near.load_factor)
        right, alone = operator.right(near.displacement, held, near.work)
        box = operator.join(0.0 * bound, -bound, -np.inf), operator.join(none, bound, np.inf)
        step = ProximalStep(operator, right, box, change, size, options, history)
        x = self._minimise(step, held)
        pressure, shear, factor = operator.split(x)
        state = self._problem.state(operator.displacement(x, alone), factor, pressure, shear)
        return replace(state, work=near.work)

    def _operator(self, rho: float) -> DelassusOperator:
        """A + D."""
        if rho not in self._operators:
            hold = self._options.force_hold
            operator = DelassusOperator(self._problem, self._points, rho, hold)
            self._operators[rho] = self._owner.enter_context(operator)
            self.factorizations += 1
        return self._operators[rho]
