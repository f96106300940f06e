"""What tests of the analysis start from: load cases, and states of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

from fenics_contact import Scene
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import running_bond
from fenics_contact.solvers.interior_point import Solution, Tolerances, solve_interior_point
from fenics_contact.solvers.kkt import PerturbedKKT
from tests.bank import Recipe, coulomb

Array = npt.NDArray[np.float64]

#: Work of the live load far along a collapse mode, in units of that on the bonded structure.
FAR = 300.0

#: Two bricks long and two courses high.
BOND = Recipe(lambda n, quads: running_bond(2, 2, elements=n), coulomb(0.5))


@contextmanager
def load_case(scene: Scene) -> Iterator[LoadCase]:
    """A scene discretised, with its live load as given."""
    with Discretization(scene) as discretization:
        bonded = discretization.bonded()
        yield LoadCase.of(discretization, bonded, 1.0, [].append)


def conditions(case: LoadCase, given: Array | None = None) -> PerturbedKKT:
    """Conditions of a state at much work, with Coulomb friction or a given bound."""
    work = FAR * case.bonded_work
    scales = case.scales_at(work)
    return case.coulomb(work, scales) if given is None else case.given(given, work, scales)


def solved(case: LoadCase, given: Array | None = None) -> Solution:
    """State at much work by the interior point method from the bonded response."""
    kkt = conditions(case, given)
    return solve_interior_point(kkt, case.bonded_state(kkt.work), 1.0, Tolerances(load_factor=1e-9))
