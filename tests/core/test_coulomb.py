"""The fixed point on the friction bound: convergence, relaxation, cycles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.collapse.coulomb import FixedPoint
from fenics_contact.collapse.load_case import LoadCase, Task
from fenics_contact.collapse.strategy import fixed_point
from fenics_contact.meshing import running_bond
from fenics_contact.results.history import History, Step
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.interior_point import Solution
from tests.bank import Recipe, block_recipe, coulomb
from tests.core.problems import FAR, Array, misses, prepared, solved

bond = prepared(Recipe(lambda n, quads: running_bond(2, 3, elements=n), coulomb(0.45)))

#: Three points with one coefficient of friction.
block = prepared(block_recipe(0.4, 0.4, 0.5))


def task_of(case: LoadCase) -> Task:
    work = FAR * case.bonded_work
    return Task(case, work, case.scales_at(work), 1e-8)


@pytest.mark.parametrize("first", [1.0, 2.0])
def test_fixed_point_is_coulombs_law_and_the_interior_point_methods_state(bond, first):
    """Whatever bound it starts from, where there is one state."""
    bound = first * bond.problem.law.bound(bond.first_pressure)
    told: list[Step] = []
    case, count = replace(bond, monitor=told.append), bond.discretization.factorizations
    before = count()
    solution, history = fixed_point(task_of(case), bound)
    assert tuple(told) == history.steps
    assert sum(step.factorizations for step in told) == count() - before
    assert history.converged and history.method == "fixed-point" and len(history.steps) > 2
    assert history.steps[-1].bound_change <= 1e-8
    assert 0.0 < history.contraction < 1.0
    assert max(misses(bond, solution.state).values()) < 1e-7
    exact = solved(bond).state.load_factor
    assert solution.state.load_factor == pytest.approx(exact, rel=1e-8)


# ---- with pressures that follow a made-up map of the bound; the load factor is their mean


def iterated(
    case: LoadCase,
    answer: Callable[[Array, float], Array],
    first: Array | float = 0.3,
    tolerance: float = 1e-8,
) -> tuple[Array, History]:
    """F r_N of the last state, and the history; maps are told the products they start with."""
    state, friction = case.bonded_state(1.0), case.problem.law.friction

    def solve(bound: Array, start: object, mu: float, exact: float) -> Solution:
        pressure = answer(bound, mu) / friction
        factor = float(np.mean(friction * pressure))
        return Solution(replace(state, pressure=pressure, load_factor=factor), {}, 1)

    bound = np.broadcast_to(first, 3).astype(float)
    told = (lambda step: None), (lambda: 0)
    iteration = FixedPoint(case.problem, solve, tolerance, *told)
    solution, history = iteration.run(state, bound)
    return friction * solution.state.pressure, history


@pytest.mark.parametrize("slope", [0.4, -0.5, -0.9, -3.0])
def test_relaxation_finds_the_slope_of_a_linear_map(block, slope):
    found, history = iterated(block, lambda g, _: slope * (g - 1.0) + 1.0, 1.2)
    assert history.converged and history.cycles == 0 and len(history.steps) <= 6
    assert found == pytest.approx(np.ones(3), rel=1e-7)
    first, second = history.steps[:2]
    assert (first.relaxation, second.relaxation) == pytest.approx((1.0, 1.0 / (1.0 - slope)))
    assert second.secant == pytest.approx(1.0 - slope)


def test_rotation_converges(block):
    """Plain iteration circles about the fixed point for ever."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    found, history = iterated(block, lambda g, _: 10.0 + turn @ (g - 10.0), [11.0, 10.0, 10.0])
    assert history.converged and history.cycles == 0
    assert found == pytest.approx(np.full(3, 10.0), rel=1e-7)
    relaxations = [step.relaxation for step in history.steps[1:-1]]
    assert relaxations == pytest.approx([0.5] * len(relaxations), rel=1e-6)
    assert history.contraction == pytest.approx(np.sqrt(0.5), rel=0.05)


def test_cycles_are_damped_and_counted(block):
    """A map without fixed point: it jumps over the diagonal at one half."""
    _, history = iterated(block, lambda g, _: np.where(g < 0.5, 1.0, 0.1))
    assert not history.converged and history.cycles >= 2
    assert len(history.steps) == SEARCH.bound_iterations
    omega = [step.relaxation for step in history.steps]
    assert min(omega) >= SEARCH.least_relaxation
    assert max(omega[-20:]) <= 0.5 < max(omega)
