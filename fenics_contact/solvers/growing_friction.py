"""Interior point steps on which Coulomb friction grows as the products fall.

    F(mu) = F (mu_full / mu)^p   while mu > mu_full,   F(mu) = F   from there on.

Collapse states with Coulomb friction are not unique. Every one is a state with given friction
g = F r_N, whose limit load grows with g. With little friction, joints slide that others with more
would hold; the state that is near then is a low one, and the iterates stay near it as friction
grows. With all of the friction from the start they may end in a high state. The steps are those of
the interior point method (`interior_point`); they only lead near the central path, which is then
followed to its end (`arclength`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.solvers.interior_point import InteriorPointOptions, next_iterate
from fenics_contact.solvers.kkt import COLD, Iterate, PerturbedKKT
from fenics_contact.solvers.problem import Array, State


@dataclass(frozen=True)
class FrictionGrowth:
    """How friction grows, and when the steps end.

    Attributes:
        begin: Products of the first iterate, in units of force times displacement.
        full_at: mu_full, in the same units.
        power: p; with 0 all of the friction acts from the start.
        known: Largest residual of the joints, relative, at which a state is recognised.
        near: That at which the path is near.
        window: Steps over which that residual has to halve; where it does not, the best iterate
            is where the path is begun.
        max_steps: Steps at most, each one factorisation.
        steps: Numbers of the interior point steps.
    """

    begin: float = 1.0
    full_at: float = 1e-3
    power: float = 0.2
    known: float = 3e-2
    near: float = 1e-3
    window: int = 8
    max_steps: int = 60
    steps: InteriorPointOptions = field(default_factory=InteriorPointOptions)

    def part(self, mu: float) -> float:
        """Part of the friction that acts at products mu."""
        return 1.0 if mu <= self.full_at else float((self.full_at / mu) ** self.power)


GROWTH = FrictionGrowth()


def with_growing_friction(
    kkt: PerturbedKKT, start: State, growth: FrictionGrowth, known: Callable[[Array], bool]
) -> tuple[State, float]:
    """State near the central path, and its products in units of force times displacement.

    Args:
        kkt: Conditions with Coulomb friction.
        start: State to start from; its joint forces need not be admissible.
        growth: How friction grows.
        known: Whether displacements are those of a known state, at which the steps end.

    Raises:
        SolverError: If no step leads to finite numbers.
    """
    part = growth.part(growth.begin)
    law = kkt.law
    here = replace(kkt, law=law.times(part))
    now = here.on_central_path(start, growth.begin, COLD)
    best: tuple[float, State, float] | None = None
    errors: list[float] = []
    for _ in range(growth.max_steps):
        residual = here.residual(now)
        sizes = here.sizes(now, residual)
        error = max(size for name, size in sizes.items() if name != "equilibrium")
        if not np.isfinite(error):
            break
        if best is None or error < best[0]:
            best = error, here.state(now), sizes["complementarity"]
        errors.append(best[0])
        slow = len(errors) > growth.window and errors[-1] > 0.5 * errors[-1 - growth.window]
        if error <= growth.near or slow or (error <= growth.known and known(now.u)):
            break
        now = next_iterate(here, now, residual, 0.0, growth.steps)
        grown = max(growth.part(here.mean_product(now)), part)
        now = _with_more(now, (grown - part) * law.friction * now.pressure)
        part = grown
        here = replace(kkt, law=law.times(part))
    if best is None:
        raise SolverError("growing friction: no finite iterate")
    return best[1], best[2]


def _with_more(now: Iterate, bound: Array) -> Iterate:
    """The iterate whose bound on the shear forces has grown, with these as they are."""
    return replace(now, s1=now.s1 + bound, s2=now.s2 + bound)
