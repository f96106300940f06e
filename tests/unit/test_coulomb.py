"""The fixed point on the friction bound: convergence, relaxation, cycles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import SolverError
from fenics_contact.analysis.coulomb import FixedPointOptions, solve_fixed_point
from fenics_contact.analysis.history import History, Step
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.strategy import Task, fixed_point
from fenics_contact.meshing import running_bond
from fenics_contact.solvers.interior_point import Solution
from fenics_contact.solvers.joint_stiffness import SYMMETRIC
from tests.bank import Recipe, block_recipe, coulomb
from tests.unit.core import FAR, Array, load_case, misses, solved

BOND = Recipe(lambda n, quads: running_bond(2, 3, elements=n), coulomb(0.45))


@pytest.fixture(scope="module")
def bond() -> Iterator[LoadCase]:
    with load_case(BOND.scene(1)) as made:
        yield made


def task_of(case: LoadCase, tolerance: float = 1e-8) -> Task:
    work = FAR * case.bonded_work
    return Task(case, work, case.scales_at(work), tolerance)


# ---- on structures


def test_fixed_point_is_coulombs_law_and_the_interior_point_methods_state(bond):
    solution, history = fixed_point(task_of(bond))
    assert history.converged and history.method == "fixed-point"
    assert len(history.steps) > 2
    assert history.steps[-1].bound_change <= 1e-8
    assert 0.0 < history.contraction < 1.0
    state = solution.state
    left = misses(bond, state, bond.problem.bound(state.pressure))
    assert max(left.values()) < 1e-7, left
    assert state.load_factor == pytest.approx(solved(bond).state.load_factor, rel=1e-8)


@pytest.mark.parametrize("friction", [0.1, 0.6])
def test_sliding_block_is_told_step_by_step(friction):
    told: list[Step] = []
    with load_case(block_recipe(0.4, 0.4, friction).scene(1), SYMMETRIC, told) as case:
        before = case.discretization.factorizations()
        solution, history = fixed_point(task_of(case))
        spent = case.discretization.factorizations() - before
    assert solution.state.load_factor == pytest.approx(friction, rel=1e-8)
    assert tuple(told) == history.steps
    assert sum(step.factorizations for step in told) == spent


# ---- with pressures that follow a made-up map of the bound; the load factor is their mean


def iterated(
    case: LoadCase,
    answer: Callable[[Array, int], Array],
    first: Array | float = 0.3,
    tolerance: float = 1e-8,
    **options: float,
) -> tuple[Array, History]:
    """F r_N of the last state, and the history."""
    state, friction = case.bonded_state(1.0), case.problem.friction
    calls: list[float] = []

    def solve(bound: Array, start: object, mu: float, exact: float) -> Solution:
        calls.append(mu)
        pressure = answer(bound, len(calls)) / friction
        factor = float(np.mean(friction * pressure))
        return Solution(replace(state, pressure=pressure, load_factor=factor), {}, 1)

    bound = np.broadcast_to(first, friction.shape).astype(float)
    chosen = FixedPointOptions(**options)
    solution, history = solve_fixed_point(
        case.problem, solve, state, bound, tolerance, lambda step: None, lambda: 0, chosen
    )
    assert calls[0] == 1.0 and max(calls) <= 1.0
    return friction * solution.state.pressure, history


@pytest.fixture(scope="module")
def block() -> Iterator[LoadCase]:
    """Three points with one coefficient of friction."""
    with load_case(block_recipe(0.4, 0.4, 0.5).scene(1)) as made:
        yield made


@pytest.mark.parametrize("slope", [0.4, -0.5, -0.9, -3.0])
def test_relaxation_finds_the_slope_of_a_linear_map(block, slope):
    found, history = iterated(block, lambda g, _: slope * (g - 1.0) + 1.0, 1.2)
    assert history.converged and history.cycles == 0
    assert found == pytest.approx(np.ones_like(found), rel=1e-7)
    assert history.steps[0].relaxation == 1.0
    assert history.steps[1].relaxation == pytest.approx(1.0 / (1.0 - slope), rel=1e-9)
    assert history.steps[1].secant == pytest.approx(1.0 - slope, rel=1e-9)
    assert len(history.steps) <= 6


@pytest.mark.parametrize("slope", [0.99, 1.5, -99.0])
def test_relaxation_is_limited_and_grows_where_changes_grow(block, slope):
    options = FixedPointOptions()
    _, history = iterated(block, lambda g, _: 1.0 + slope * (g - 1.0), 1.01, max_iterations=4)
    omega = [step.relaxation for step in history.steps]
    if slope == 0.99:  # asks for 100, along one direction
        assert omega[1] == options.fast
    elif slope == 1.5:  # grows
        assert omega[:3] == [1.0, 2.0, 4.0]
    else:
        assert omega[1] == options.relaxation[0]


def test_contraction_that_is_slow_in_one_direction_is_not_stopped_early(block):
    """The estimate of the error covers what the slowest direction leaves."""
    rates = np.array([0.97, 0.1, -0.6])
    found, history = iterated(block, lambda g, _: 1.0 + rates * (g - 1.0), [1.3, 0.2, 2.0])
    assert history.converged
    assert np.abs(found - 1.0).max() <= 1e-7


def test_rotation_converges(block):
    """Plain iteration circles about the fixed point for ever."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    found, history = iterated(block, lambda g, _: 10.0 + turn @ (g - 10.0), [11.0, 10.0, 10.0])
    assert history.converged and history.cycles == 0
    assert found == pytest.approx(np.full(3, 10.0), rel=1e-7)
    assert [step.relaxation for step in history.steps[1:-1]] == pytest.approx(
        [0.5] * (len(history.steps) - 2), rel=1e-6
    )
    assert history.contraction == pytest.approx(np.sqrt(0.5), rel=0.05)


def test_cycles_are_damped_and_counted(block):
    """A map without fixed point: it jumps over the diagonal at one half."""
    _, history = iterated(block, lambda g, _: np.where(g < 0.5, 1.0, 0.1))
    options = FixedPointOptions()
    assert not history.converged
    assert len(history.steps) == options.max_iterations
    assert history.cycles >= 2
    omega = [step.relaxation for step in history.steps]
    assert min(omega) >= options.relaxation[0]
    assert max(omega[-20:]) <= 0.5 < max(omega)


def test_load_factor_that_creeps_is_waited_for(block):
    """While the bound converges quickly at all points but a light one."""
    rates, target = np.array([0.95, 0.01, 0.01]), np.array([1e-3, 1.0, 1.0])
    first = [2e-3, 1.1, 1.1]
    found, history = iterated(block, lambda g, _: target + rates * (g - target), first, 1e-5)
    assert history.converged
    assert abs(found.mean() - target.mean()) <= 1e-5 * target.mean()


def test_last_state_is_kept_where_the_next_is_not_found(block):
    def answer(bound: Array, call: int) -> Array:
        if call > 3:
            raise SolverError("made up")
        return 1.0 + 0.1 * call + bound

    found, history = iterated(block, answer)
    assert not history.converged and len(history.steps) == 3
    assert found.mean() == pytest.approx(history.steps[-1].load_factor)


def test_no_state_at_all_is_an_error(block):
    def answer(bound: Array, call: int) -> Array:
        raise SolverError("made up")

    with pytest.raises(SolverError, match="made up"):
        iterated(block, answer)


def test_warm_start_that_fails_is_made_again_from_further_away(block):
    asked: list[float] = []

    def solve(bound: Array, start: object, mu: float, exact: float) -> Solution:
        asked.append(mu)
        if 0.0 < mu < 0.5 and len(asked) > 1:
            raise SolverError("too close")
        pressure = (1.0 + 0.4 * bound) / block.problem.friction
        state = replace(block.bonded_state(1.0), pressure=pressure, load_factor=1.0)
        return Solution(state, {}, 1)

    _, history = solve_fixed_point(
        block.problem, solve, block.bonded_state(1.0), np.ones(3), 1e-6, lambda _: None, lambda: 0
    )
    assert history.converged
    again = [mu for mu in asked if mu < 0.5]
    assert again and asked.count(1.0) > 1
