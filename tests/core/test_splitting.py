"""States with given friction by joint forces: load factors known from statics, and residuals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from fenics_contact import Scene, SolverError
from fenics_contact.discretization.discretization import Discretization, typical_sizes
from fenics_contact.meshing import running_bond, wall
from fenics_contact.results.certificate import state_residuals
from fenics_contact.solvers.joint_forces import JointForceSolver, JointPoints, alternately, at_once
from fenics_contact.solvers.joint_stiffness import SYMMETRIC
from fenics_contact.solvers.problem import ContactProblem, Scales, State
from tests.core.problems import qp_options
from tests.helpers import numbers, on_ground, tresca

WAYS = (alternately, at_once)


@dataclass(frozen=True)
class Loaded:
    """A structure, its joint points, and the bonded state at many times the bonded work."""

    problem: ContactProblem
    points: JointPoints
    start: State
    scales: Scales

    @property
    def ask(self) -> tuple[np.ndarray, float, State, Scales]:
        """What a solver is asked for: bound, work, start and typical sizes."""
        return self.problem.law.strength, self.start.work, self.start, self.scales

    def solver(self, minimise=alternately) -> JointForceSolver:
        return JointForceSolver(self.problem, self.points, state_residuals, minimise)


def loaded(scene: Scene, ratio: float = 100.0) -> Iterator[Loaded]:
    with Discretization(scene) as structure:
        problem, bonded, rows = structure.problem, structure.bonded(SYMMETRIC), structure.operators
        points = JointPoints(rows.sides, rows.dofs, rows.normal_rows, rows.tangential_rows)
        scales = typical_sizes(problem, bonded)
        u = ratio * scales.load_factor * bonded.live
        none = np.zeros_like(bonded.dead_pressure)
        start = problem.state(u, 0.0, bonded.dead_pressure, none)
        size = start.work / problem.sum(np.abs(problem.live))
        yield Loaded(problem, points, start, replace(scales, displacement=size))


@pytest.fixture(scope="module")
def block() -> Iterator[Loaded]:
    """A block that slides before it tips."""
    yield from loaded(on_ground(wall([[1]], (0.4, 0.4), 2), tresca(2e3)))


@pytest.fixture(scope="module")
def bond() -> Iterator[Loaded]:
    """A small wall in running bond."""
    yield from loaded(on_ground(running_bond(2, 3, elements=1), tresca(1e3)))


@pytest.mark.mpi
@pytest.mark.parametrize("minimise", WAYS)
@pytest.mark.parametrize(
    "chosen", [{}, {"tao_type": "bnls"}, {"snes_type": "vinewtonrsls"}], ids=str
)
def test_sliding_block(block, minimise, chosen):
    """By any solver of bound-constrained programs that PETSc has."""
    with qp_options(**chosen), block.solver(minimise) as solver:
        state, residuals = solver.solve(*block.ask, 1e-9)
        history = solver.history
    weight = 0.4 * 0.4 * 2000.0 * 9.81
    assert state.load_factor == pytest.approx(2e3 * 0.4 / weight, rel=1e-7)
    assert max(residuals.values()) <= 1e-9
    assert (history.sweeps > 0) == (minimise is alternately)
    assert history.joint_steps == history.steps or minimise is alternately


@pytest.mark.mpi
def test_failure_says_how_far_it_came(bond):
    with numbers(finish_acceptable=0.0), bond.solver() as solver:
        with pytest.raises(SolverError, match=r"residual .* after \d+ steps, asked 1.0e-30"):
            solver.solve(*bond.ask, 1e-30)
