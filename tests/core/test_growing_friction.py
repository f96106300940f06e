"""Interior point steps on which friction grows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.solvers.growing_friction import GROWTH, with_growing_friction
from fenics_contact.solvers.interior_point import Tolerances, solve_interior_point
from tests.core.problems import FAR, THREE_BLOCKS, load_case


def test_all_of_the_friction_acts_from_some_products_on():
    assert GROWTH.part(GROWTH.full_at) == GROWTH.part(0.0) == 1.0
    assert GROWTH.part(32.0 * GROWTH.full_at) == pytest.approx(32.0**-GROWTH.power)
    assert replace(GROWTH, power=0.0).part(1.0) == 1.0


@pytest.fixture(scope="module")
def case():
    with load_case(THREE_BLOCKS.scene(2)) as made:
        yield made


def test_steps_lead_near_a_state(case):
    work = FAR * case.bonded_work
    kkt = case.coulomb(work, case.scales_at(work))
    state, mu = with_growing_friction(kkt, case.bonded_state(work), GROWTH, lambda u: False)
    assert state.work == work and 0.0 < mu < GROWTH.full_at
    end = solve_interior_point(kkt, state, mu, Tolerances()).state
    assert end.load_factor == pytest.approx(state.load_factor, rel=1e-2)
    again = case.coulomb(work, case.scales_at(work))
    alone = solve_interior_point(again, case.bonded_state(work), 1.0, Tolerances()).state
    assert end.load_factor == pytest.approx(alone.load_factor, rel=1e-8)


def test_steps_end_where_a_state_is_known(case):
    work, seen = FAR * case.bonded_work, []
    kkt = case.coulomb(work, case.scales_at(work))

    def known(u: np.ndarray) -> bool:
        seen.append(u)
        return True

    before = case.discretization.tally.count
    with_growing_friction(kkt, case.bonded_state(work), GROWTH, known)
    stopped = case.discretization.tally.count - before
    with_growing_friction(kkt, case.bonded_state(work), GROWTH, lambda u: False)
    assert len(seen) == 1
    assert stopped < case.discretization.tally.count - before - stopped
