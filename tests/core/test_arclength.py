"""Continuation of the central path: products equal at every point, folds passed, where it ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import SolverError
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.arclength import (
    FALLING_PRODUCTS,
    RISING_WORK,
    Continuation,
    PathPoint,
)
from fenics_contact.solvers.interior_point import Tolerances, solve_interior_point
from fenics_contact.solvers.problem import State
from tests.bank import coulomb, wall_recipe
from tests.core.problems import (
    FAR,
    conditions,
    load_case,
    misses,
    prepared,
    solved,
)

#: All points are chosen, and solved for to many digits.
ALL = replace(SEARCH, points=10**6, chosen_from=-1.0, points_solved=1e-9)

#: A wall with so much friction that its path turns back, and one whose path has no folds.
folded, plain = (
    prepared(wall_recipe(name, coulomb(friction)), elements)
    for name, friction, elements in (("W1", 1.0, 2), ("W4", 0.4, 1))
)


def fallen(case: LoadCase, end: float, ratio: float = FAR, **options: object) -> PathPoint:
    """The point where products have fallen from 1 under constant work."""
    kkt = conditions(case, ratio)
    path = Continuation(kkt, FALLING_PRODUCTS, replace(SEARCH, **options))
    return path.follow(path.begin(case.bonded_state(kkt.work), 1.0), end)


def finished(case: LoadCase, point: PathPoint) -> State:
    """The state next to a point."""
    kkt = case.coulomb(point.work, case.scales_at(point.work))
    return solve_interior_point(kkt, point.state, point.mu, Tolerances(1e-9, 1e-9)).state


def test_all_products_are_equal_along_the_path(plain):
    kkt, point = (
        conditions(plain),
        fallen(plain, 1e-2, points=10**6, chosen_from=-1.0, points_solved=1e-9),
    )
    now, unit = point.iterate, kkt.scales.displacement * kkt.scales.force
    for product in kkt.products(now):
        assert product == pytest.approx(np.full_like(product, point.mu * unit), rel=1e-9)
    assert now.s1 + now.s2 == pytest.approx(2.0 * kkt.law.friction * now.pressure, rel=1e-12)
    sizes = kkt.sizes(now, kkt.residual(now))
    assert sizes.pop("complementarity") == pytest.approx(point.mu, rel=1e-9)
    assert max(sizes.values()) <= 1e-6
    assert point.state.work == kkt.work


@pytest.mark.parametrize("times", [1.5, 30.0])
def test_rising_work_ends_at_the_work_asked_for(plain, times):
    """With the products that it began with."""
    first = fallen(plain, 1e-2, ratio=10.0)
    last, scales = times * first.work, plain.scales_at(first.work)
    risen = Continuation(plain.coulomb(last, scales), RISING_WORK).follow(first, last)
    assert risen.mu == first.mu
    assert risen.work == pytest.approx(last, rel=2e-3)
    work = plain.problem.dot(plain.problem.live, risen.iterate.u)
    assert work == pytest.approx(risen.work, rel=1e-9)
    assert risen.state.work == risen.work
    exact = solved(plain, risen.work / plain.bonded_work).state.load_factor
    assert finished(plain, risen).load_factor == pytest.approx(exact, rel=1e-7)


# ---- folds


@pytest.mark.parametrize(
    ("wall", "friction", "elements"), [("W1", 1.0, 2), ("W3", 0.65, 1), ("W3", 1.0, 1)]
)
def test_folds_that_stall_the_interior_point_method_are_passed(wall, friction, elements):
    with load_case(wall_recipe(wall, coulomb(friction)).scene(elements)) as case:
        with pytest.raises(SolverError, match="interior point: residual"):
            solved(case)
        state = finished(case, fallen(case, 1e-6))
        left = misses(case, state)
    assert max(left.values()) < 1e-6, left
    if wall == "W1":  # by an independent fixed point
        assert state.load_factor == pytest.approx(0.645963, abs=2e-6)
