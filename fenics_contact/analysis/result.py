"""Limit loads as data: what an analysis hands on to its user, and to files and pictures.

Load factors have the user's sign: those of the live load reversed are not above zero. Arrays are
numpy's; nothing here holds a PETSc object.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from fenics_contact.analysis.certificate import Certificate, outside_bracket
from fenics_contact.analysis.joint_values import JointValues
from fenics_contact.analysis.rigid_blocks import LimitBounds
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.scene import Scene
from fenics_contact.solvers.problem import State

SplittingHistory = Any

Array = npt.NDArray[np.float64]

Item = TypeVar("Item", "Step", "LoadStep", "CollapseState")


@dataclass(frozen=True)
class Step:
    """One iteration of the fixed point on the friction bound g.

    Attributes:
        load_factor: lambda of the state with the given bound.
        bound_change: |F r_N - g| / |F r_N|, Euclidean norms.
        relaxation: omega.
        factorizations: Numeric factorisations spent.
        secant: Estimate of 1 - c, c the contraction without relaxation.
    """

    load_factor: float
    bound_change: float
    relaxation: float
    factorizations: int
    secant: float = 1.0


@dataclass(frozen=True)
class History:
    """Iterations for the state at one work T of the live load.

    Attributes:
        steps: Iterations, in order.
        cycles: How often a cycle was recognised and damped.
        method: "fixed-point" or "monolithic", whichever made the last step.
        converged: Whether load factor and bound stand still.
    """

    steps: tuple[Step, ...] = ()
    cycles: int = 0
    method: str = "fixed-point"
    converged: bool = False

    @property
    def at_once(self) -> bool:
        """Whether one monolithic step was all."""
        return self.method == "monolithic" and len(self.steps) == 1

    @property
    def contraction(self) -> float | None:
        """Factor by which the change of the bound fell per iteration, mean of the last half."""
        changes = [step.bound_change for step in self.steps[len(self.steps) // 2 :]]
        if len(changes) < 2 or min(changes) <= 0.0:
            return None
        return float((changes[-1] / changes[0]) ** (1.0 / (len(changes) - 1)))


@dataclass(frozen=True)
class LoadStep:
    """State of equilibrium on the path of load control.

    Attributes:
        load_factor: Prescribed lambda.
        displacement: f_L.u / sum |f_L|, m: mean displacement along the live load as it acts.
        work: T = f_L.u, N m per metre of thickness.
    """

    load_factor: float
    displacement: float
    work: float


@dataclass(frozen=True)
class LoadPath:
    """Load factors with and without equilibrium, from load control.

    Attributes:
        steps: States of equilibrium, that of the dead load first.
        lower: Load factor furthest from zero with a state of equilibrium.
        upper: Load factor nearest to zero at which none was found; infinite if none failed.
    """

    steps: tuple[LoadStep, ...]
    lower: float
    upper: float


@dataclass(frozen=True)
class CapacityPoint:
    """Point of the capacity curve: a state between rest and collapse.

    Attributes:
        displacement: f_L.u / sum |f_L|, m: mean displacement along the live load as it acts.
        load_factor: lambda, not above zero where the curve is that of the live load reversed.
        work: T = f_L.u, N m per metre of thickness.
        converged: Whether load factor and friction stand still there.
    """

    displacement: float
    load_factor: float
    work: float
    converged: bool


@dataclass(frozen=True)
class CollapseState:
    """One of several collapse states of a direction.

    Attributes:
        start: Where the search for it began.
        status: As that of `Collapse`.
        load_factor: nan if no state was found.
    """

    start: str
    status: str
    load_factor: float


@dataclass(frozen=True)
class Collapse:
    """One end of the range of load factors.

    Attributes:
        status: "limit", "unbounded" or "not_converged".
        load_factor: lambda; nan if no state was found.
        program: Solves the rigid-block programs for the bracket of this end.
        state: State reached, in the supports' coordinates; None if there is none.
        mode: Collapse mode v in the supports' coordinates, this rank's part; f_L.v = 1 with the
            live load as it acts.
        joints: Forces, openings and slips of the joints in this state and mode.
        certificate: Verification of the state.
        history: Iterations for all states, at rising T.
        work_ratio: T in units of the live load's work on the bonded structure.
        splitting: Counts of a method on joint forces; None for other methods.
        path: Load factors with equilibrium, under load control.
        states: Collapse states found from different first bounds, where they were looked for.
    """

    status: str
    load_factor: float
    program: Callable[[], LimitBounds]
    state: State | None = None
    mode: Array | None = None
    joints: JointValues | None = None
    certificate: Certificate | None = None
    history: tuple[History, ...] = ()
    work_ratio: float = 0.0
    splitting: SplittingHistory | None = None
    path: LoadPath | None = None
    states: tuple[CollapseState, ...] = ()

    @property
    def bounds(self) -> LimitBounds:
        """Bracket from the rigid-block programs, solved when it is first asked for."""
        return self.program()

    def held_against_bracket(self) -> Collapse:
        """With the load factor's distance from its bracket in the certificate, and what follows."""
        if self.status != "limit" or self.certificate is None:
            return self
        certificate = self.certificate
        outside = outside_bracket(
            self.load_factor, self.bounds, certificate.error_estimate, certificate.size
        )
        residuals = {**certificate.residuals, "bracket": outside}
        certificate = replace(certificate, residuals=residuals)
        status = "limit" if certificate.passed else "not_converged"
        return replace(self, status=status, certificate=certificate)

    def reversed(self) -> Collapse:
        """Collapse under the reversed live load, in multiples of the live load as given."""
        state, certificate, path = self.state, self.certificate, self.path
        if state is not None:
            state = replace(state, load_factor=-state.load_factor, work=-state.work)
        if certificate is not None:
            certificate = replace(
                certificate,
                static_factor=-certificate.static_factor,
                kinematic_factor=-certificate.kinematic_factor,
            )
        if path is not None:
            path = LoadPath(tuple(map(sign_reversed, path.steps)), -path.lower, -path.upper)
        return replace(
            self,
            load_factor=-self.load_factor,
            program=lambda: self.program().reversed(),
            state=state,
            certificate=certificate,
            history=tuple(
                replace(one, steps=tuple(map(sign_reversed, one.steps))) for one in self.history
            ),
            path=path,
            states=tuple(map(sign_reversed, self.states)),
        )


def sign_reversed(item: Item) -> Item:
    """Record of a state, with its load factor in multiples of the opposite live load."""
    return replace(item, load_factor=-item.load_factor)


@dataclass
class Result:
    """Limit load of a scene, in one direction of the live load or both.

    Attributes:
        discretization: Scene, joints, supports and function space; its matrices may be gone.
        ends: Collapse by direction, "positive" (live load as given) before "negative" (reversed);
            empty where there is no equilibrium under the dead load.
        skipped: What the scene did not need and why, for people.
        seconds: Time by phase, s.
        factorizations: Numeric factorisations in all.
        mode_factorizations: Those of them that were of the blocks' modes only.
        capacity: Points of the capacity curve.
    """

    discretization: Discretization
    ends: dict[str, Collapse]
    skipped: tuple[str, ...]
    seconds: dict[str, float]
    factorizations: int
    mode_factorizations: int = 0
    capacity: tuple[CapacityPoint, ...] = ()

    @property
    def scene(self) -> Scene:
        """Scene that was solved."""
        return self.discretization.scene

    @property
    def status(self) -> str:
        """Status of all ends; "unstable" without equilibrium under the dead load alone."""
        found = {end.status for end in self.ends.values()}
        if not found:
            return "unstable"
        if "not_converged" in found:
            return "not_converged"
        return found.pop() if len(found) == 1 else "limit"

    @property
    def positive(self) -> Collapse | None:
        """Collapse with the live load as given; None if not asked for."""
        return self.ends.get("positive")

    @property
    def negative(self) -> Collapse | None:
        """Collapse with the live load reversed; None if not asked for."""
        return self.ends.get("negative")

    @property
    def collapse(self) -> Collapse | None:
        """Collapse that fields show: the positive one if there is one."""
        return self.positive or self.negative

    @property
    def load_factor(self) -> float:
        """Limit load factor; infinite if unbounded, nan if there is none."""
        return float("nan") if self.positive is None else self.positive.load_factor

    @property
    def load_factor_negative(self) -> float:
        """Limit load factor with the live load reversed, not above 0; nan if not asked for."""
        return float("nan") if self.negative is None else self.negative.load_factor

    @property
    def bounds(self) -> LimitBounds | None:
        """Bracket of the rigid-block programs for the collapse that fields show."""
        return None if self.collapse is None else self.collapse.bounds
