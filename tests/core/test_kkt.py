"""The perturbed conditions: points with equal products, and Newton's directions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.core.problems import BOND, FAR, Array, conditions, noisy, prepared, solved

case = prepared(BOND)


def same(one: Array, other: Array, rel: float = 1e-8) -> None:
    assert one == pytest.approx(other, abs=rel * np.abs(other).max())


@pytest.mark.parametrize("compliance", [0.0, 1.0], ids=["stiff points", "points with compliance"])
@pytest.mark.parametrize("control", ["work", "load"])
@pytest.mark.parametrize("dilatancy", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("given", [False, True])
def test_directions_are_those_of_differences(case, given, dilatancy, control, compliance):
    """Residuals fall in proportion to a step, and products change as asked, to first order."""
    random, kkt = np.random.default_rng(5), conditions(case)
    count, d, f = case.problem.points, kkt.scales.displacement, kkt.scales.force
    problem = case.problem
    problem = replace(problem, compliance=compliance * d / f * random.uniform(0.1, 10, (2, count)))
    problem = problem.with_law(dilatancy=dilatancy * problem.law.friction)
    kkt = replace(kkt, problem=problem, load_factor=None if control == "work" else 0.3)
    kkt = replace(kkt, law=problem.law)
    if given:
        kkt = replace(kkt, law=problem.law.with_given(np.full(count, f)))
    now = noisy(kkt.on_central_path(case.bonded_state(kkt.work), 0.1), 1)
    residual = kkt.residual(now)
    asked = d * f * random.normal(size=(3, count))
    linear = kkt.linearize(now)
    step, other = linear.directions([(residual, asked), (residual, 0.5 * asked)])
    (again,) = linear.directions([(residual, asked)])
    same(again.u, step.u)
    assert not np.allclose(other.u, step.u)
    for part in (0.5, 1e-5):
        left = kkt.residual(now.moved(part, step))
        for name, size in (("opening", d), ("slip", d), ("equilibrium", f)):
            expected = (1.0 - part) * getattr(residual, name)
            assert getattr(left, name) == pytest.approx(expected, abs=1e-9 * size)
        assert left.work == pytest.approx((1.0 - part) * residual.work, abs=1e-9 * kkt.work)
    ahead, behind = (kkt.products(now.moved(h, step)) for h in (part, -part))
    for more, less, change in zip(ahead, behind, asked, strict=True):
        same((more - less) / (2.0 * part), change, 1e-6)
    same(step.s1, kkt.law.friction * step.pressure - step.shear)
    same(step.s2, kkt.law.friction * step.pressure + step.shear)
    assert control == "work" or step.load_factor == 0.0
    same(step.elastic, problem.elastic_part(step.u))


@pytest.mark.parametrize("larger", [1e2, 1e3, 1e4])
def test_large_motion_takes_no_digits_from_equilibrium(case, larger):
    """A^-1 b and A^-1 f_L are as large as the motion; what is left of both balances the forces."""
    kkt, found = conditions(case, larger * FAR), solved(case, larger * FAR)
    state, problem = found.state, case.problem
    assert found.residuals["equilibrium"] <= 1e-12
    rest = problem.stiffness @ state.elastic - problem.dead - state.load_factor * problem.live
    rest -= problem.joint_forces(state.pressure, state.shear)
    assert np.abs(rest).max() <= 1e-9 * kkt.scales.force
    strains = problem.elastic_part(state.displacement)
    assert np.abs(strains - state.elastic).max() <= 1e-15 * np.abs(state.displacement).max()
