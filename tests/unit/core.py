"""What tests of the solvers and the analysis start from: load cases, and whole arrays."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact import Scene
from fenics_contact.analysis.history import Step
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import running_bond, wall
from fenics_contact.solvers.interior_point import Solution, Tolerances, solve_interior_point
from fenics_contact.solvers.joint_stiffness import GENERAL
from fenics_contact.solvers.kkt import Iterate, Linearization, PerturbedKKT, Products, Residual
from fenics_contact.solvers.nonlinear_elimination import EliminationOptions, NonlinearElimination
from fenics_contact.solvers.nonlinear_elimination import Step as PathStep
from fenics_contact.solvers.problem import ContactProblem, SparseMap, State
from tests.bank import Recipe, coulomb

Array = npt.NDArray[np.float64]

#: Work of the live load far along a collapse mode, in units of that on the bonded structure.
FAR = 300.0

#: One course of a whole block, and of two halves on top.
THREE_BLOCKS = Recipe(lambda n, quads: wall([[1.0], [0.5, 0.5]], elements=n), coulomb(0.5))

#: Two bricks long and two courses high.
BOND = Recipe(lambda n, quads: running_bond(2, 2, elements=n), coulomb(0.5))


@contextmanager
def load_case(
    scene: Scene, kind: str = GENERAL, told: list[Step] | None = None
) -> Iterator[LoadCase]:
    """A scene discretised, with its live load as given.

    Args:
        scene: The scene.
        kind: Of factorisation.
        told: Gets every iteration.
    """
    with Discretization(scene) as discretization:
        bonded = discretization.bonded(kind)
        monitor = ([] if told is None else told).append
        yield LoadCase.of(discretization, bonded, 1.0, kind, monitor)


def conditions(case: LoadCase, ratio: float = FAR, given: Array | None = None) -> PerturbedKKT:
    """Conditions of a state at some work, with Coulomb friction or a given bound."""
    work = ratio * case.bonded_work
    scales = case.scales_at(work)
    return case.coulomb(work, scales) if given is None else case.given(given, work, scales)


def solved(case: LoadCase, ratio: float = FAR, given: Array | None = None) -> Solution:
    """State at some work by the interior point method from the bonded response."""
    kkt = conditions(case, ratio, given)
    return solve_interior_point(kkt, case.bonded_state(kkt.work), 1.0, Tolerances(load_factor=1e-9))


def dense(matrix: SparseMap) -> Array:
    """All rows of a map on every rank."""
    start, columns, values = matrix.matrix.getValuesCSR()
    rows = np.zeros((len(start) - 1, matrix.matrix.getSize()[1]))
    np.add.at(rows, (np.repeat(np.arange(len(rows)), np.diff(start)), columns), values)
    return np.concatenate(matrix.comm.allgather(rows))


def sparse(matrix: Array) -> SparseMap:
    """A map of this rank alone, with all entries stored."""
    rows, columns = matrix.shape
    start, places = columns * np.arange(rows + 1), np.tile(np.arange(columns), rows)
    csr = (start.astype(PETSc.IntType), places.astype(PETSc.IntType), matrix.ravel())
    return SparseMap(PETSc.Mat().createAIJ(matrix.shape, csr=csr, comm=PETSc.COMM_SELF))


def whole(problem: ContactProblem, values: Array) -> Array:
    """All entries of a distributed array on every rank, in the order of the ranks."""
    return np.concatenate(problem.comm.allgather(values))


def part(problem: ContactProblem, values: Array, like: Array) -> Array:
    """This rank's part of an array that all ranks have; as many as `like` has."""
    counts = problem.comm.allgather(len(like))
    first = sum(counts[: problem.comm.rank])
    return np.asarray(values[first : first + len(like)])


def misses(case: LoadCase, state: State, bound: Array) -> dict[str, float]:
    """What a state misses of equilibrium and the joint laws, by dense algebra, relative."""
    problem = case.problem
    b_n, b_t = dense(problem.normal), dense(problem.tangential)
    u, pressure, shear, g, dead, live, origin = (
        whole(problem, values)
        for values in (
            state.displacement,
            state.pressure,
            state.shear,
            bound,
            problem.dead,
            problem.live,
            problem.slip_origin,
        )
    )
    forces = dead + state.load_factor * live
    rest = dense(problem.stiffness) @ u - forces - b_n.T @ pressure - b_t.T @ shear
    opening, slip = b_n @ u, b_t @ u - origin
    force, moved = np.abs(forces).max(), np.abs(u).max()
    return {
        "equilibrium": np.abs(rest).max() / force,
        "penetration": max(0.0, -opening.min()) / moved,
        "tension": max(0.0, -pressure.min()) / force,
        "complementarity": np.abs(opening * pressure).max() / (force * moved),
        "friction": max(0.0, (np.abs(shear) - g).max()) / force,
        "slip": np.abs(g * np.abs(slip) + shear * slip).max() / (force * moved),
        "work": abs(live @ u / state.work - 1.0),
    }


def noisy(iterate: Iterate, seed: int, size: float = 0.3) -> Iterate:
    """An iterate with every positive quantity multiplied by random numbers around one."""
    random = np.random.default_rng(seed)
    names = [item.name for item in fields(iterate)][3:]
    values = {name: getattr(iterate, name) for name in names if name != "shear"}
    return replace(
        iterate,
        **{n: v * np.exp(size * random.normal(size=len(v))) for n, v in values.items()},
    )


@dataclass(frozen=True)
class Place:
    """A place near a path of falling products, with the factor there.

    Attributes:
        kkt: The conditions.
        mu: Products.
        linear: Newton's equations.
        across: Correction to the path.
        along: Tangent of the path.
    """

    kkt: PerturbedKKT
    mu: float
    linear: Linearization
    across: Iterate
    along: Iterate

    @classmethod
    def at(cls, kkt: PerturbedKKT, now: Iterate, mu: float) -> Place:
        """Factor the equations at an iterate with equal products."""
        linear, zero = kkt.linearize(now), np.zeros_like(now.y)
        fall = np.full_like(zero, -mu * kkt.scales.force * kkt.scales.displacement)
        rest = Residual(np.zeros_like(now.u), zero, zero, 0.0)
        asked = [
            (kkt.residual(now), Products(zero, zero, zero)),
            (rest, Products(fall, fall, fall)),
        ]
        return cls(kkt, mu, linear, *linear.directions(asked))

    def elimination(
        self, ahead: float, options: EliminationOptions | None = None
    ) -> NonlinearElimination:
        """A step from here, with points chosen."""
        here = self.linear, self.across, self.along
        made = NonlinearElimination(*here, self.mu, -1.0, 1e-3, options)
        made.choose(ahead)
        return made

    def arrived(self, at: PathStep) -> tuple[Iterate, float]:
        """The point with equal products where a step leads, and its products."""
        _, r, _, shear = at.states.values
        f, to, mu = self.kkt.scales.force, at.moved, self.mu * float(np.exp(-at.s))
        state = State(to.u, to.elastic, to.load_factor, r * f, shear * f, self.kkt.work)
        return self.kkt.on_central_path(state, mu), mu
