"""Records of how a collapse was found: iterations, load paths, capacity curves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fenics_contact.faces.limit import FaceAttempt
from fenics_contact.results.bounds import LoadFactor
from fenics_contact.solvers.joint_forces import SplittingHistory
from fenics_contact.solvers.problem import Array, State

#: States whose load factors differ by less than this part of their size are told as one.
SAME = 1e-3


@dataclass(frozen=True)
class Step:
    """One iteration of the fixed point on the friction bound g.

    Attributes:
        load_factor: lambda of the state with the given bound.
        bound_change: |F r_N - g| / |F r_N|, Euclidean norms.
        relaxation: omega.
        factorizations: Numeric factorisations spent.
        secant: Estimate of 1 - c, c the contraction without relaxation.
        contraction: `bound_change` over that of the iteration before; nan where there is none.
    """

    load_factor: LoadFactor
    bound_change: float
    relaxation: float
    factorizations: int
    secant: float = 1.0
    contraction: float = math.nan


@dataclass(frozen=True)
class History:
    """Iterations for the state at one work T of the live load.

    Attributes:
        steps: Iterations, in order.
        cycles: How often a cycle was recognised and damped.
        method: "fixed-point" or "monolithic", whichever made the last step.
        converged: Whether load factor and bound stand still.
        splitting: Counts of a method on joint forces; None for other methods.
    """

    steps: tuple[Step, ...] = ()
    cycles: int = 0
    method: str = "fixed-point"
    converged: bool = False
    splitting: SplittingHistory | None = None

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
        load_factor: lambda.
        displacement: f_L.u / sum |f_L|, m: mean displacement along the live load as it acts.
        work: T = f_L.u, N m per metre of thickness.
        motion: u, this rank's part in the supports' coordinates, m; None if it was not kept.
    """

    load_factor: LoadFactor
    displacement: float
    work: float
    motion: Array | None = field(default=None, repr=False, compare=False)


@dataclass(frozen=True)
class CapacityPoint(LoadStep):
    """Point of the capacity curve: a state between rest and collapse.

    Attributes:
        converged: Whether it was found; its load factor is nan if not.
    """

    converged: bool = True


@dataclass(frozen=True)
class CurveEnd:
    """How complete a capacity curve is.

    Attributes:
        points: Number of its points that were found.
        not_found: Number of those that were not.
        load_factor: Of the last point found; nan if there is none.
        on_plateau: Whether that is the load factor of the collapse.
    """

    points: int
    not_found: int
    load_factor: LoadFactor
    on_plateau: bool

    @classmethod
    def of(cls, curve: Sequence[CapacityPoint], limit: float, apart: float = 1e-3) -> CurveEnd:
        """The end of a curve to a load factor, on its plateau up to a relative distance."""
        found = [point.load_factor for point in curve if point.converged]
        last = found[-1] if found else math.nan
        on_plateau = bool(abs(last - limit) <= apart * abs(limit))
        return cls(len(found), len(curve) - len(found), last, on_plateau)

    def __str__(self) -> str:
        missing = f", {self.not_found} not found" if self.not_found else ""
        end = "" if self.on_plateau else f"; it ends at {self.load_factor:.6g}, not at the collapse"
        return f"capacity curve: {self.points} points{missing}{end}"


@dataclass(frozen=True)
class LoadPath:
    """Load factors with and without equilibrium, from load control.

    Attributes:
        steps: States of equilibrium, that of the dead load first.
        lower: Load factor furthest from zero with a state of equilibrium.
        upper: Load factor nearest to zero at which none was found; infinite if none failed.
    """

    steps: tuple[LoadStep, ...]
    lower: LoadFactor
    upper: LoadFactor


@dataclass(frozen=True)
class Peak:
    """The most that the loading path carries from the dead load on.

    Attributes:
        status: "found", "none" where the path rises to the collapse, or "not_known".
        load_factor: lambda of a verified state of equilibrium: at least that is carried; nan unless
            found.
        not_found_at: Load factor next to it at which no equilibrium was found, looked for as
            `equilibrium` does; nan if not tried.
        work: T of that state, of the live load as it acts, N m per metre of thickness.
        displacement_m: Mean displacement there along the live load as it acts, m.
        reason: Why it is not known, and what to do, for people.
        state: The state, in the supports' coordinates; None unless found.
    """

    status: str
    load_factor: LoadFactor = float("nan")
    not_found_at: LoadFactor = float("nan")
    work: float = float("nan")
    displacement_m: float = float("nan")
    reason: str = ""
    state: State | None = field(default=None, repr=False, compare=False)


@dataclass(frozen=True)
class CollapseState:
    """One of several collapse states of a direction; fields as those of `Collapse`."""

    start: str  # the searches that led to it
    status: str
    load_factor: LoadFactor
    gap: float | None = None


def alike_as_one(states: Iterable[CollapseState], size: float) -> tuple[CollapseState, ...]:
    """States with those of nearly equal load factors told as the first of them, by all names."""
    known: list[CollapseState] = []
    for state in states:
        apart = [abs(state.load_factor - one.load_factor) for one in known]
        nearest = int(np.argmin(apart)) if apart else 0
        if apart and apart[nearest] <= SAME * size:
            one = known[nearest]
            known[nearest] = replace(one, start=f"{one.start}; {state.start}")
        else:
            known.append(state)
    return tuple(known)


@dataclass(frozen=True)
class Lowest:
    """The least of the collapse states that several searches led to.

    Attributes:
        status: "lower" if one is below the collapse that is reported, "none" if there is none
            below it, "not_known".
        load_factor: Of the least verified one; nan if not known.
        starts: Number of searches that ended in a state.
        reason: Why it is not known, for people.
        gap: Its proved gap, relative; None where it was not computed.
    """

    status: str
    load_factor: LoadFactor = float("nan")
    starts: int = 0
    reason: str = ""
    gap: float | None = None


@dataclass(frozen=True)
class Trial:
    """One attempt to find a state.

    Attributes:
        name: Of the attempt.
        work: T of the state that was looked for, N m per metre of thickness.
        outcome: How it ended, in words.
        found: Whether a state was found, verified or not.
        factorizations: Numeric factorisations spent.
        cost: The same in units of one factorisation of the structure.
    """

    name: str
    work: float
    outcome: str
    found: bool
    factorizations: int
    cost: float


def trials(attempts: Iterable[FaceAttempt], of: str = "") -> tuple[Trial, ...]:
    """Attempts of a search on the forces of faces (`faces.limit.FaceAttempt`).

    Where these are named by what they are `of`, others are of the structure: the factorisations of
    small systems are not told beside theirs.
    """
    return tuple(
        Trial(
            of + a.name, math.nan, a.outcome, math.isfinite(a.gap), a.factorizations * (not of), 0.0
        )
        for a in attempts
    )


@dataclass(frozen=True)
class TracePoint:
    """Point of a path on the way to a collapse; its products are not zero, so it is no state yet.

    Attributes:
        phase: What is followed: on block modes or on the structure, with what varying.
        load_factor: lambda.
        work: T = f_L.u, N m per metre of thickness.
        displacement: T / sum |f_L|, m: mean displacement along the live load as it acts.
    """

    phase: str
    load_factor: LoadFactor
    work: float
    displacement: float


@dataclass(frozen=True)
class Pass:
    """A load factor on the way to the accuracy wished; nan: not known.

    Attributes:
        direction: Of the live load, "positive" or "negative".
        displacements: Their number.
        degree: Their degree.
        hinges: Of the length of the "mesh", or "points".
        load_factor: lambda.
        hinge_error: Change to point hinges, relative.
        algebraic_error: Change from the mesh before, relative, and not less than a quarter of that
            there; not known on the first mesh, but 0 where statics alone give the load factor.
        seconds: Wall time on this mesh.
    """

    direction: str
    displacements: int
    degree: int
    hinges: str
    load_factor: float
    hinge_error: float
    algebraic_error: float
    seconds: float

    @property
    def estimate(self) -> float:
        """Sum of both errors, relative; nan if one is not known."""
        return self.hinge_error + self.algebraic_error
