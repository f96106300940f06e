"""Compiled laws: the same numbers as those of the Python text, bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.forms import compile_laws
from fenics_contact.limit_load import limit_load_of
from fenics_contact.scene import Scene
from fenics_contact.solvers.compiled_laws import CompiledLaws, compiled_laws, use
from fenics_contact.solvers.joint_law import (
    Asked,
    LinearLaws,
    PointLaws,
    Slacks,
    Units,
    slacks_next_to,
)
from fenics_contact.solvers.nonlinear_elimination import (
    ChosenPoints,
    EliminationOptions,
    Line,
    TangentModel,
)
from fenics_contact.solvers.problem import Array
from tests.bank import BANK, coulomb, wall_recipe

POINTS = 17

#: What a tangent may lead to.
EXTREME = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 1e308, -1e308, 1e-308])


@pytest.fixture(autouse=True)
def compiled() -> Iterator[CompiledLaws]:
    assert compile_laws(MPI.COMM_WORLD) == ()
    laws = compiled_laws()
    assert laws is not None
    yield laws
    use(laws)


def some(random: np.random.Generator, extreme: bool, *shape: int) -> Array:
    """Random values of any sign; of all sizes, and some that are none, where asked for."""
    values = random.normal(size=shape)
    if extreme:
        values *= 10.0 ** random.integers(-12, 12, size=shape)
        values = np.where(random.random(shape) < 0.1, random.choice(EXTREME, shape), values)
    return values


def random_law(random: np.random.Generator) -> PointLaws:
    """Points with friction, a given strength, both or neither."""
    friction, strength = random.random((2, POINTS)) * (random.random((2, POINTS)) < 0.5)
    return PointLaws(friction, strength, friction * random.choice([0.0, 0.5, 1.0], POINTS))


def random_model(random: np.random.Generator, extreme: bool) -> TangentModel:
    """Points of all laws, all of them chosen."""
    law = random_law(random)
    return TangentModel(
        law.smoothed(1.0, law.frictional, smallest=1e-3),
        *(some(random, extreme, 5, POINTS) for _ in range(3)),
        springs=10.0 ** random.uniform(-6, 6, (5, POINTS)),
        compliance=random.random((2, POINTS)),
        answers=some(random, extreme, 2, 2 * POINTS, POINTS),
        mu=float(10.0 ** random.uniform(-12, 1)),
        log_mu_rate=-1.0,
    )


@pytest.mark.parametrize("extreme", [False, True])
@pytest.mark.parametrize("seed", range(50))
def test_compiled_laws_are_those_in_python_bit_for_bit(seed, extreme, compiled):
    random = np.random.default_rng(seed)
    model = random_model(random, extreme)
    part, s, forces = 1.0, random.normal(), some(random, extreme, 2 * POINTS)
    curve = ChosenPoints(model, Line((0.3, 0.1), (0.7, -0.2)), EliminationOptions())
    x = some(random, extreme, 2 * POINTS + 1)
    found = []
    with np.errstate(all="ignore"):
        for laws in (None, compiled):
            use(laws)
            at = curve.at(x)
            distances = model.distances(part, s), model.distances(part, s, forces)
            found.append([*distances, at.rest, at.forces, at.sizes, at.slopes])
    for python, c in zip(*found, strict=True):
        assert np.array_equal(python, c, equal_nan=True)
    assert not np.any(np.isnan(found[1][0]))


@pytest.mark.parametrize("seed", range(50))
def test_compiled_curves_are_those_in_python(seed, compiled):
    """The end of a curve, and its point next to another one."""
    random = np.random.default_rng(seed)
    model = random_model(random, False)
    root = random.normal(size=(2 * POINTS, 2 * POINTS))
    c = 1e-6 * (root @ root.T).reshape(2, POINTS, 2, POINTS)
    model = replace(model, answers=c.transpose(0, 3, 2, 1).reshape(2, -1, POINTS))
    curve = ChosenPoints(model, Line((0.0, 0.0), (1.0, 0.1)), EliminationOptions())
    x = some(random, False, 2 * POINTS + 1)
    found = []
    with np.errstate(all="ignore"):
        for laws in (None, compiled):
            use(laws)
            near = curve.near(x)
            found.append(None if near is None else near.x)
    assert (found[0] is None) == (found[1] is None)
    assert found[0] is None or np.array_equal(found[0], found[1])


@pytest.mark.parametrize("seed", range(50))
def test_compiled_linearised_laws_are_those_in_python_bit_for_bit(seed, compiled):
    random = np.random.default_rng(seed)
    law = random_law(random)
    units = Units(1e-3, 1e4)
    state = tuple(some(random, False, 4, POINTS) * [[1e-3], [1e-3], [1e4], [1e4]])
    asked = Asked(*some(random, False, 2, POINTS), some(random, False, 3, POINTS))
    moved = some(random, False, 2, POINTS)
    compliance = 1e-7 * random.random((2, POINTS))
    found = []
    for laws in (None, compiled):
        use(laws)
        slacks = slacks_next_to(law, law.frictional, state, 1e-2, units, 1e-9)
        linear = LinearLaws.of(law, slacks, law.frictional, compliance, 1e12, 1e-7)
        changes = linear.changes(asked, *moved)
        found.append([*vars(slacks).values(), *linear.forces(asked), *vars(changes).values()])
    assert len(found[0]) == len(vars(Slacks(*np.zeros(7)))) * 2 + 2
    for python, c in zip(*found, strict=True):
        assert np.array_equal(python, c, equal_nan=True)


def test_points_that_a_tangent_leads_nowhere_are_infinitely_far(compiled):
    model = random_model(np.random.default_rng(0), False)
    model.tangent[:, 3] = np.nan
    for laws in (None, compiled):
        use(laws)
        distances = model.distances(1.0, 0.5)
        assert np.isinf(distances[3]) and np.all(np.isfinite(np.delete(distances, 3)))


def test_there_may_be_no_points(compiled):
    none = np.zeros((5, 0))
    laws = PointLaws(none[0], none[0]).smoothed(1.0, none[0] > 0.0, smallest=1e-3)
    rest = {"springs": none, "compliance": none[:2], "answers": np.zeros((2, 0, 0))}
    model = TangentModel(laws, none, none, none, **rest, mu=1.0, log_mu_rate=-1.0)
    at = ChosenPoints(model, Line((0.0, 0.0), (1.0, 0.0)), EliminationOptions()).at(np.zeros(1))
    assert model.distances(1.0, 0.5).shape == (0,)
    assert at.slopes.shape == (0, 1) and at.error == 0.0


def both(scene: Scene, compiled: CompiledLaws) -> list[tuple[float, int, int]]:
    """Load factor and factorisations, of structure and modes, in Python and compiled."""
    found = []
    for laws in (None, compiled):
        with Discretization(scene) as discretization:
            use(laws)
            made = limit_load_of(discretization)
        found.append((made.load_factor, made.factorizations, made.mode_factorizations))
    return found


WALL = wall_recipe("W1", coulomb(0.65))


def test_solves_in_python_and_compiled_take_the_same_steps(compiled):
    python, c = both(WALL.scene(1, fast=True), compiled)
    assert python == c and python[2] > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["W3 coulomb 0.65", "W4 coulomb 0.65", "10x10 coulomb 0.75", "20x20 coulomb 0.4"]
)
def test_walls_in_python_and_compiled_take_the_same_steps(name, compiled):
    python, c = both(BANK[name].scene(fast=True), compiled)
    assert python == c


@pytest.mark.mpi
def test_ranks_find_the_same_in_python_and_compiled(compiled):
    """MUMPS on several ranks does not add in the same order twice."""
    python, c = both(WALL.scene(1, MPI.COMM_WORLD, fast=True), compiled)
    assert python[0] == pytest.approx(c[0], rel=1e-9)


@pytest.mark.mpi
def test_where_one_rank_cannot_compile_all_run_in_python_and_say_why():
    comm = MPI.COMM_WORLD

    def missing(folder):
        raise OSError("no compiler")

    told = compile_laws(comm, missing) if comm.rank == 0 else compile_laws(comm)
    assert compiled_laws() is None
    assert told == (
        "joint laws are not compiled, solves take longer: is there a C compiler? (no compiler)",
    )
