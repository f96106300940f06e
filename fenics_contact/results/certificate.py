"""Verification of a limit load from the problem itself, whatever solver found it.

A collapse state is right if it is in equilibrium, respects all joint laws, and if the motion that
follows, its mode v with f_L.v = 1, is admissible everywhere, costs no elastic energy, and
dissipates what the loads do on it:

    sum g |B_T v| = lambda f_L.v + f_D.v,    g as in `joint_law`.

Such a mode shows a true non-associative collapse state, one of possibly several. That the load
factor is the limit load for the friction forces of the state is then proved by the rigid-block
program with these forces, which knows nothing of elasticity: its value must be the load factor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from fenics_contact.results.bounds import LoadFactor
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.problem import Array, ContactProblem, Scales, State

#: Digits of u, relative: so much may `State.elastic` differ from that part of u.
ROUNDING = 1e-13


def tolerances() -> dict[str, float]:
    """What a converged result may miss, relative to typical force, displacement or power.

    For the state's own friction bound: as the bound follows, the load factor may still change by 10
    to 1 000 times the "limit". A larger gap counts where a larger tolerance is asked for.
    "crushing" is the moment of a joint beyond that of its compressive strength, in units of force
    times length.
    """
    state = "equilibrium", "tension", "penetration", "complementarity"
    return {
        **dict.fromkeys((*state, "mode_work", "bracket", "crushing"), SEARCH.verified),
        **dict.fromkeys(("friction", "slip_direction", "mode_penetration"), SEARCH.agrees),
        **dict.fromkeys(("mode_elastic", "mode_power"), SEARCH.agrees),
        "work": SEARCH.rounding,
        "limit": SEARCH.verified,
    }


@dataclass(frozen=True)
class WorstJoint:
    """Number of the joint point that misses most of a joint law, and that law's residual."""

    point: int
    law: str
    residual: float


@dataclass(frozen=True)
class Certificate:
    """Residuals of a collapse state.

    Attributes:
        residuals: By name; relative, zero for an exact state.
        error_estimate: Gap: load factor less the program's for the state's friction, absolute.
        worst_joint: Where the joint laws are missed most.
        kinematic_factor: (sum g |B_T v| - f_D.v) / f_L.v: upper bound on the limit load for the
            friction of the state.
        static_factor: Lower one: the rigid-block program's, or, where the mode confirms it, lambda.
        size: Load factor that differences of load factors are relative to.
        tolerance: On the load factor, as asked for.
        allowed: What residuals may be where a smaller tolerance is asked for, by name.
    """

    residuals: Mapping[str, float]
    error_estimate: float
    worst_joint: WorstJoint | None = None
    kinematic_factor: LoadFactor = float("nan")
    static_factor: LoadFactor = float("nan")
    size: float = 1.0
    tolerance: float = 0.0
    allowed: Mapping[str, float] = field(default_factory=tolerances)

    @property
    def tolerances(self) -> dict[str, float]:
        """What the residuals may be, by name."""
        products = SEARCH.least_products * self.tolerance
        asked = {"limit": self.tolerance, "complementarity": products}
        return {name: max(self.allowed[name], asked.get(name, 0.0)) for name in self.residuals}

    @property
    def failures(self) -> dict[str, float]:
        """Residuals above their tolerance, or not finite."""
        allowed = self.tolerances
        return {name: value for name, value in self.residuals.items() if not value <= allowed[name]}

    @property
    def missed(self) -> str:
        """Residuals above their tolerances, in words; empty where there are none."""
        allowed = self.tolerances
        return ", ".join(
            f"{name.replace('_', ' ')} ({value:.1e}, allowed {allowed[name]:.0e})"
            for name, value in self.failures.items()
        )

    @property
    def passed(self) -> bool:
        """Whether the state is what it claims to be."""
        return not self.failures

    @property
    def mode_passed(self) -> bool:
        """Whether the mode is a collapse mode of the state."""
        return not any(name.startswith("mode_") for name in self.failures)

    @property
    def gap(self) -> float:
        """Relative difference of the load factor and the program's for the state's friction."""
        return self.residuals["limit"]

    def known_to(self, change: float) -> Certificate:
        """This certificate with a gap of at least a change of the load factor, relative."""
        if change <= self.gap:
            return self
        residuals = {**self.residuals, "limit": change}
        return replace(self, residuals=residuals, error_estimate=change * self.size)


def certify(
    problem: ContactProblem,
    state: State,
    mode: Array,
    scales: Scales,
    rigid_limit: float,
    points: npt.NDArray[np.int64] | None = None,
) -> Certificate:
    """Recompute all conditions of a collapse state, relative to `scales`.

    Args:
        problem: Stiffness, loads and joints.
        state: Displacements, load factor and joint forces.
        mode: Collapse mode v.
        scales: Typical sizes.
        rigid_limit: Limit load of the rigid blocks with the friction of the state; nan: unknown.
        points: Numbers of this rank's joint points, by which to name the worst.
    """
    size = max(abs(state.load_factor), SEARCH.small_factor * scales.load_factor)
    missed = abs(rigid_limit - state.load_factor)
    unit = scales.displacement / abs(state.work)  # displacement of a mode with f_L.v = 1
    dissipation = _dissipation(problem, state, mode)
    live_work = problem.dot(problem.live, mode)
    power = state.load_factor * live_work + problem.dot(problem.dead, mode)
    straining = problem.elastic_part(mode)
    elastic = problem.dot(straining, problem.stiffness @ straining)
    residuals = {
        **state_residuals(problem, state, scales),
        "mode_work": abs(live_work - 1.0),
        "mode_penetration": problem.max(-problem.clearance_rates(mode)) / unit,
        # Change of the load factor, were the motion to go on as far again.
        "mode_elastic": elastic * abs(state.work) / size,
        "mode_power": abs(dissipation - power) / max(dissipation, abs(power), size),
        "limit": missed / size,
    }
    worst = None if points is None else worst_joint(problem, state, scales, points)
    kinematic = kinematic_factor(problem, state, mode)
    return Certificate(residuals, missed, worst, kinematic, rigid_limit, size)


def kinematic_factor(problem: ContactProblem, state: State, mode: Array) -> float:
    """Load factor at which a mode dissipates what the loads do on it; nan if they do nothing."""
    live = problem.dot(problem.live, mode)
    rest = _dissipation(problem, state, mode) - problem.dot(problem.dead, mode)
    return rest / live if live else float("nan")


def _dissipation(problem: ContactProblem, state: State, mode: Array) -> float:
    """The sum of g |B_T v|, W per metre of thickness."""
    return problem.sum(problem.law.dissipation(state.pressure, problem.tangential @ mode))


def state_residuals(
    problem: ContactProblem, state: State, scales: Scales, bound: Array | None = None
) -> dict[str, float]:
    """Residuals of equilibrium and joint laws, relative to `scales`.

    The bound on friction is the problem's own when it is not given.
    """
    forces = problem.dead + state.load_factor * problem.live
    forces += problem.joint_forces(state.pressure, state.shear)
    elastic = problem.elastic_part(state.displacement)
    rounding = ROUNDING * problem.max(np.abs(state.displacement))
    if problem.max(np.abs(state.elastic - elastic)) <= rounding:
        elastic = state.elastic  # has more digits
    joints = _joint_misses(problem, state, scales, bound)
    work = problem.dot(problem.live, state.displacement)
    unit = scales.displacement * problem.sum(np.abs(problem.live))
    return {
        "equilibrium": problem.max(np.abs(problem.stiffness @ elastic - forces)) / scales.force,
        **{name: problem.max(values) for name, values in joints.items()},
        "work": abs(work - state.work) / max(abs(state.work), unit),
    }


def worst_joint(
    problem: ContactProblem, state: State, scales: Scales, points: npt.NDArray[np.int64]
) -> WorstJoint | None:
    """Joint point that misses most of a joint law, in units of what may be missed; on all ranks.

    `points` are the numbers of this rank's joint points; None without joints.
    """
    worst = [
        WorstJoint(int(points[np.argmax(values)]), name, float(np.max(values)))
        for name, values in _joint_misses(problem, state, scales).items()
        if len(values)
    ]
    everywhere = [joint for part in problem.comm.allgather(worst) for joint in part]
    if not everywhere:
        return None
    allowed = tolerances()
    return max(everywhere, key=lambda one: one.residual / allowed[one.law])


def _joint_misses(
    problem: ContactProblem, state: State, scales: Scales, bound: Array | None = None
) -> dict[str, Array]:
    """What this rank's points miss of the joint laws, relative to `scales`."""
    d = scales.displacement
    f = scales.force
    opening, slip = problem.motion_of(state)
    law = problem.law if bound is None else problem.law.with_given(bound)
    units = {"tension": f, "penetration": d, "friction": f}
    missed = law.missed(opening, slip, state.pressure, state.shear)
    return {name: values / units.get(name, d * f) for name, values in missed.items()}
