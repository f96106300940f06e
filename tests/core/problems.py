"""What tests of the solvers and the analysis start from: load cases, and whole arrays."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from petsc4py import PETSc

from fenics_contact import Scene
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import running_bond, wall
from fenics_contact.results.history import Step
from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers import nonlinear_elimination as elimination
from fenics_contact.solvers.bound_qp import PREFIX
from fenics_contact.solvers.interior_point import Solution, Tolerances, solve_interior_point
from fenics_contact.solvers.joint_stiffness import GENERAL
from fenics_contact.solvers.kkt import Iterate, Linearization, PerturbedKKT, Residual
from fenics_contact.solvers.problem import ContactProblem, SparseMap, State
from tests.bank import PUSH, STONE, Recipe, coulomb
from tests.drawing import Drawing

Array = npt.NDArray[np.float64]

#: Work of the live load far along a collapse mode, in units of that on the bonded structure.
FAR = 300.0

#: One course of a whole block, and of two halves on top.
THREE_BLOCKS = Recipe(lambda n, quads: wall([[1.0], [0.5, 0.5]], elements=n), coulomb(0.5))

#: Two bricks long and two courses high.
BOND = Recipe(lambda n, quads: running_bond(2, 2, elements=n), coulomb(0.5))


def on_an_inclined_roller(elements: int, left: str) -> Scene:
    """The three blocks turned by 30 degrees, on a roller and with a support at their left."""
    usual = THREE_BLOCKS.scene(elements)
    turn = np.array([[np.sqrt(3.0), 1.0], [-1.0, np.sqrt(3.0)]]) / 2.0
    drawn = Drawing.of(THREE_BLOCKS.draw(elements, False)).moved(lambda points: points @ turn)
    mesh = type(usual.mesh).from_model(drawn.model(), usual.comm)
    supports = {"base": "roller", "left": left}
    return Scene(mesh, {"default": STONE}, PUSH, joints=usual.joints, supports=supports)


@contextmanager
def load_case(
    scene: Scene, kind: str = GENERAL, told: list[Step] | None = None
) -> Iterator[LoadCase]:
    """A scene discretised, with its live load as given; `told` gets every iteration."""
    with Discretization(scene) as discretization:
        bonded = discretization.bonded(kind)
        monitor = ([] if told is None else told).append
        yield LoadCase.of(discretization, bonded, 1.0, kind, monitor)


@contextmanager
def qp_options(**values: str) -> Iterator[None]:
    """PETSc options for bound-constrained programs."""
    table = PETSc.Options(PREFIX)
    for name, value in values.items():
        table.setValue(name, value)
    try:
        yield
    finally:
        for name in values:
            table.delValue(name)


def prepared(recipe: Recipe, elements: int = 1) -> Any:
    """A fixture: the load case of a recipe, for all tests of a module."""

    @pytest.fixture(scope="module")
    def made() -> Iterator[LoadCase]:
        with load_case(recipe.scene(elements)) as case:
            yield case

    return made


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


def sprung(problem: ContactProblem, normal: Array, shear: Array, coupling: Array) -> Array:
    """K with springs at all joint points, by dense algebra."""
    b_n, b_t = dense(problem.normal), dense(problem.tangential)
    matrix = dense(problem.stiffness) + b_n.T @ (normal[:, None] * b_n)
    return matrix + b_t.T @ (shear[:, None] * b_t + coupling[:, None] * b_n)


def whole(problem: ContactProblem, values: Array) -> Array:
    """All entries of a distributed array on every rank, in the order of the ranks."""
    return np.concatenate(problem.comm.allgather(values))


def part(problem: ContactProblem, values: Array, like: Array) -> Array:
    """This rank's part of an array that all ranks have; as many as `like` has."""
    first = sum(problem.comm.allgather(len(like))[: problem.comm.rank])
    return np.asarray(values[first : first + len(like)])


def misses(case: LoadCase, state: State, bound: Array | None = None) -> dict[str, float]:
    """What a state misses of equilibrium and the joint laws, relative."""
    problem, u, g = case.problem, state.displacement, bound
    g = problem.law.bound(state.pressure) if g is None else g
    pressure, shear, loads = state.pressure, state.shear, problem.dead
    loads = loads + state.load_factor * problem.live
    forces = loads + problem.joint_forces(pressure, shear)
    opening, slip = problem.normal @ u, problem.tangential @ u
    force, moved = np.abs(loads).max(), np.abs(u).max()
    return {
        "equilibrium": np.abs(problem.stiffness @ u - forces).max() / force,
        "penetration": max(0.0, -opening.min()) / moved,
        "tension": max(0.0, -pressure.min()) / force,
        "complementarity": np.abs(opening * pressure).max() / (force * moved),
        "friction": max(0.0, (np.abs(shear) - g).max()) / force,
        "slip": np.abs(g * np.abs(slip) + shear * slip).max() / (force * moved),
        "work": abs(problem.live @ u / state.work - 1.0),
    }


def noisy(iterate: Iterate, seed: int, size: float = 0.3) -> Iterate:
    """An iterate whose openings, forces and slips are multiplied by random numbers around one."""
    random, names = np.random.default_rng(seed), ("y", "pressure", "s1", "s2", "z1", "z2")
    values = {name: getattr(iterate, name) for name in names}
    noise = {n: v * np.exp(size * random.normal(size=len(v))) for n, v in values.items()}
    return replace(iterate, **noise, shear=0.5 * (noise["s2"] - noise["s1"]))


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
        fall = np.full((3, len(zero)), -mu * kkt.scales.force * kkt.scales.displacement)
        rest = Residual(np.zeros_like(now.u), zero, zero, 0.0)
        across = kkt.residual(now), np.zeros_like(fall)
        return cls(kkt, mu, linear, *linear.directions([across, (rest, fall)]))

    def elimination(self, options: SearchOptions = SEARCH) -> elimination.NonlinearElimination:
        """A step from here."""
        here = self.linear, self.across, self.along
        rates = elimination.Rates(self.mu, -1.0, 1e-3)
        return elimination.NonlinearElimination(*here, rates, options)

    def arrived(self, at: elimination.Step) -> tuple[Iterate, float]:
        """The point with equal products where a step leads, and its products."""
        _, r, _, shear, _ = at.states
        f, to, mu = self.kkt.scales.force, at.moved, self.mu * float(np.exp(-at.s))
        state = State(to.u, to.elastic, to.load_factor, r * f, shear * f, self.kkt.work)
        return self.kkt.on_central_path(state, mu), mu
