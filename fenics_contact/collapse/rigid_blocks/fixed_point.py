"""Collapse states of rigid blocks by the fixed point on friction, with linear programs alone.

    N_{k+1} = N_k + omega (N(F N_k + s) - N_k),

N(g) the normal forces of straight faces at the limit load with given friction g (`rigid_blocks`), F
their coefficients of friction, s their strengths. It takes no factorisation. Rigid blocks leave
some normal forces open, so that the iteration may not end, and where it ends nothing is proved: it
tells with which friction a state of elastic blocks is worth looking for (`lowest`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fenics_contact.collapse.rigid_blocks.lower_end import FacePrograms
from fenics_contact.errors import SolverError
from fenics_contact.solvers.problem import Array


@dataclass(frozen=True)
class RigidFixedPointOptions:
    """Numbers of the iteration.

    Attributes:
        relaxation: omega.
        programs: Linear programs at most.
        pivots: Iterations of HiGHS times equations at most, which bounds the time.
        each: Iterations by equations that a program takes at least; the fixed point is not begun
            where `last` of them are too many.
        settled: The load factor has settled where its last values differ by less, relative, or
            those that they lead to if N(g) stays as it is.
        last: So many values.
        stays: So many values, and those that they lead to, tell that the load factor stays above
            what is asked for. In 195 random scenes no lower state was lost.
    """

    relaxation: float = 0.5
    programs: int = 30
    pivots: int = 50_000
    each: float = 2.0
    settled: float = 1e-3
    last: int = 3
    stays: int = 2


OPTIONS = RigidFixedPointOptions()


class PointPrograms(FacePrograms, Protocol):
    """Linear programs that also know the joint points of the faces, as `RigidBlocks` does."""

    def of_faces(self, values: Array) -> Array:
        """Sums over the joint points of every face."""


@dataclass(frozen=True)
class RigidState:
    """Where the iteration ended.

    Attributes:
        load_factor: lambda.
        pressure: Normal forces at all joint points, at the ends of faces, N/m.
    """

    load_factor: float
    pressure: Array


def rigid_fixed_point(programs: PointPrograms, pressure: Array, low: float = np.inf) -> RigidState:
    """The fixed point from normal forces at all joint points, N/m; on this rank alone.

    It ends early, above `low`, where the load factor begins above that and stays there.

    Raises:
        SolverError: If the load factor does not settle, or nothing limits it, or the structure is
            too large.
    """
    size = programs.equations
    if OPTIONS.last * OPTIONS.each * size**2 > OPTIONS.pivots:
        raise SolverError(f"fixed point of rigid blocks: too dear with {size} equations")
    normal = programs.of_faces(pressure)
    factors = list[float]()
    pivots = 0
    for _ in range(OPTIONS.programs):
        left = (OPTIONS.pivots - pivots) // size
        if left < 1:
            break
        strength = programs.friction * normal + programs.strength
        found = programs.given_friction(strength, left)
        pivots += found.iterations * size
        if not np.isfinite(found.factor):
            raise SolverError("fixed point of rigid blocks: no limit load with given friction")
        factors.append(found.factor)
        end = _end(np.array(factors), low)
        if end is not None:
            return RigidState(end, found.pressure)
        normal = normal + OPTIONS.relaxation * (programs.of_faces(found.pressure) - normal)
    raise SolverError(f"fixed point of rigid blocks: not settled by {len(factors)} programs")


def _end(values: Array, low: float) -> float | None:
    """Where load factors end, if they have settled or stay above `low`; else None."""
    # With N(g) as it is, every step leaves 1 - omega of the change.
    ahead = values[1:] + np.diff(values) * (1.0 - OPTIONS.relaxation) / OPTIONS.relaxation
    if len(values) == OPTIONS.stays and min(values.min(), ahead.min()) >= low:
        return float(values[-1])
    for last in (values[-OPTIONS.last :], ahead[-OPTIONS.last :]):
        if len(last) == OPTIONS.last and np.ptp(last) <= OPTIONS.settled * abs(last[-1]):
            return float(last[-1])
    return None
