"""The verification of a collapse state: what is right passes, every tampering is found."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from fenics_contact.collapse.collapse_mode import verify
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.results.certificate import (
    Certificate,
    certify,
    kinematic_factor,
    tolerances,
)
from fenics_contact.solvers.problem import Scales, State
from tests.bank import block_recipe
from tests.core.problems import BOND, Array, conditions, load_case, solved


@dataclass(frozen=True)
class Collapse:
    """A collapse state of a structure and its mode."""

    case: LoadCase
    state: State
    mode: Array
    scales: Scales

    def certificate(self, **changes: object) -> Certificate:
        """Of the state, with a rigid-block limit as exact as the solver's."""
        given = {"state": self.state, "mode": self.mode, "rigid_limit": self.state.load_factor}
        return certify(self.case.problem, scales=self.scales, **{**given, **changes})

    def at(self, name: str, point: int, value: float) -> State:
        """The state with another pressure or shear at one point."""
        values = getattr(self.state, name).copy()
        values[point] = value
        return replace(self.state, **{name: values})

    def times(self, name: str, factor: float) -> State:
        """The state with another load factor or work."""
        return replace(self.state, **{name: factor * getattr(self.state, name)})

    def moved(self, x: float, y: float) -> State:
        """The state with its first body displaced, in units of a typical displacement."""
        motions = np.zeros((self.case.block_count, 3))
        motions[0, :2] = np.array([x, y]) * self.scales.displacement
        u = self.state.displacement + self.case.discretization.rigid_motion(motions)
        return replace(self.state, displacement=u)

    @property
    def pressed(self) -> int:
        """The point with the largest pressure."""
        return int(np.argmax(self.state.pressure))


@pytest.fixture(scope="module", params=["block", "wall"])
def collapse(request) -> Iterator[Collapse]:
    recipe = block_recipe(0.4, 0.3, 0.4) if request.param == "block" else BOND
    with load_case(recipe.scene(1)) as case:
        scales = conditions(case).scales
        verified = verify(case, solved(case).state, scales, 1e-6, 1e-6)
        yield Collapse(case, verified.state, verified.mode, scales)


def test_correct_collapse_passes(collapse):
    certificate = collapse.certificate()
    assert set(certificate.residuals) == set(tolerances()) - {"bracket", "crushing"}
    assert certificate.failures == {}
    assert certificate.passed and certificate.mode_passed
    assert certificate.gap == certificate.residuals["limit"] == 0.0
    assert certificate.kinematic_factor == pytest.approx(collapse.state.load_factor, rel=1e-6)


def given(c: Collapse, times: float) -> State:
    """The state with so many times the friction as a given bound."""
    return solved(c.case, times * c.case.problem.law.bound(c.state.pressure)).state


def strained(c: Collapse) -> State:
    u = c.state.displacement
    return replace(
        c.state, displacement=u + 1e-5 * c.scales.displacement * np.sin(np.arange(len(u)))
    )


#: Ways to make a state wrong, and which residuals say so.
WRONG: dict[str, tuple[Callable[[Collapse], State], set[str]]] = {
    "load factor too high": (lambda c: c.times("load_factor", 1.001), {"equilibrium"}),
    "load factor too low": (lambda c: c.times("load_factor", 0.999), {"equilibrium"}),
    "tension": (lambda c: c.at("pressure", c.pressed, -1e-3 * c.scales.force),
                {"tension", "equilibrium"}),
    "shear above the cone": (lambda c: c.at("shear", c.pressed, c.state.pressure[c.pressed]),
                             {"friction", "equilibrium"}),
    "pushed into the ground": (lambda c: c.moved(0.0, -1e-3), {"penetration", "complementarity"}),
    "lifted though pressed": (lambda c: c.moved(0.0, 1e-3), {"complementarity"}),
    "slid against its shear": (lambda c: c.moved(-10.0, 0.0), {"slip_direction", "work"}),
    "other work": (lambda c: c.times("work", 1.001), {"work"}),
    "strained": (strained, {"equilibrium"}),
    "with more friction": (lambda c: given(c, 1.1), set()),
    "with less friction": (lambda c: given(c, 0.9), set()),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_wrong_states_fail_with_any_mode(collapse, name):
    """With the right mode, and with those that are looked for from the wrong state."""
    make, expected = WRONG[name]
    state = make(collapse)
    verified = verify(collapse.case, state, collapse.scales, 1e-6, 1e-6)
    for certificate in (collapse.certificate(state=state), verified.certificate):
        assert expected <= set(certificate.failures) and not certificate.passed


def test_gap_and_numbers_that_are_none_fail(collapse):
    factor = collapse.state.load_factor
    certificate = replace(collapse.certificate(rigid_limit=1.1 * factor), tolerance=1e-3)
    assert certificate.static_factor == 1.1 * factor and set(certificate.failures) == {"limit"}
    assert certificate.gap == pytest.approx(0.1) == certificate.error_estimate / factor
    certificate = collapse.certificate(state=collapse.at("shear", 0, np.nan))
    assert {"equilibrium", "friction"} <= set(certificate.failures)
    assert "limit" in collapse.certificate(rigid_limit=np.nan).failures


def test_wrong_modes_fail(collapse):
    case, problem, mode = collapse.case, collapse.case.problem, collapse.mode
    up = case.discretization.rigid_motion(np.tile([0.0, 1.0, 0.0], (case.block_count, 1)))
    up *= np.abs(mode).max() / 10.0
    elastic = case.bonded.live / problem.dot(problem.live, case.bonded.live)
    noise = np.random.default_rng(1).normal(size=len(up)) * 1e-3 * np.abs(mode).max()
    for wrong, expected in (
        (-mode, {"mode_work", "mode_power"}),
        (0.5 * mode, {"mode_work"}),
        (0.0 * mode, {"mode_work"}),
        (mode - up, {"mode_penetration"}),
        (mode + up, {"mode_power"}),  # it lifts what need not be
        (elastic, {"mode_elastic", "mode_power"}),
        (mode + noise, {"mode_elastic"}),
    ):
        certificate = collapse.certificate(mode=wrong)
        assert expected <= set(certificate.failures)
        assert not certificate.mode_passed and not certificate.passed
    usual = kinematic_factor(problem, collapse.state, mode)
    assert kinematic_factor(problem, collapse.state, 3.0 * mode) == pytest.approx(usual)
    assert np.isnan(kinematic_factor(problem, collapse.state, 0.0 * mode))
    assert kinematic_factor(problem, collapse.state, mode + up) > usual
