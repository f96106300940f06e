"""The verification of a collapse state: what is right passes, every tampering is found."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from fenics_contact.analysis.certificate import (
    TOLERANCES,
    Certificate,
    WorstJoint,
    certify,
    kinematic_factor,
    outside_bracket,
    state_residuals,
    worst_joint,
)
from fenics_contact.analysis.collapse_mode import verify
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.solvers.problem import Scales, State
from tests.bank import block_recipe
from tests.unit.core import BOND, Array, conditions, load_case, solved


@dataclass(frozen=True)
class Collapse:
    """A collapse state of a structure and its mode."""

    case: LoadCase
    state: State
    mode: Array
    scales: Scales

    def certificate(self, **changes) -> Certificate:
        """Of the state, with a rigid-block limit as exact as the solver's."""
        changed = {"rigid_limit": self.state.load_factor, **changes}
        given = {"state": self.state, "mode": self.mode, **changed}
        return certify(self.case.problem, scales=self.scales, **given)

    def at(self, name: str, point: int, value: float) -> State:
        """The state with another pressure or shear at one point."""
        values = getattr(self.state, name).copy()
        values[point] = value
        return replace(self.state, **{name: values})

    def displaced(self, *motion: float) -> State:
        """The state with its first body displaced by a rigid motion (a, b, c)."""
        motions = np.zeros((self.case.block_count, 3))
        motions[0] = np.array(motion) * self.scales.displacement
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
    assert set(certificate.residuals) == set(TOLERANCES) - {"bracket"}
    assert certificate.failures == {}
    assert certificate.passed and certificate.mode_passed
    assert certificate.gap == certificate.residuals["limit"] == 0.0
    assert certificate.kinematic_factor == pytest.approx(collapse.state.load_factor, rel=1e-6)


#: Name: what is wrong with a state, and which residuals say so.
WRONG: dict[str, tuple[Callable[[Collapse], State], set[str]]] = {
    "load factor too high": (
        lambda c: replace(c.state, load_factor=1.001 * c.state.load_factor),
        {"equilibrium", "mode_power"},
    ),
    "load factor too low": (
        lambda c: replace(c.state, load_factor=0.999 * c.state.load_factor),
        {"equilibrium", "mode_power"},
    ),
    "tension": (
        lambda c: c.at("pressure", c.pressed, -1e-3 * c.scales.force),
        {"tension", "equilibrium"},
    ),
    "shear above the cone": (
        lambda c: c.at("shear", c.pressed, c.state.pressure[c.pressed]),
        {"friction", "equilibrium"},
    ),
    "pushed into the ground": (
        lambda c: c.displaced(0.0, -1e-3, 0.0),
        {"penetration", "complementarity"},
    ),
    "lifted though pressed": (lambda c: c.displaced(0.0, 1e-3, 0.0), {"complementarity"}),
    "slid against its shear": (lambda c: c.displaced(-10.0, 0.0, 0.0), {"slip_direction", "work"}),
    "other work": (lambda c: replace(c.state, work=1.001 * c.state.work), {"work"}),
    "strained": (
        lambda c: replace(
            c.state,
            displacement=c.state.displacement
            + 1e-5 * c.scales.displacement * np.sin(np.arange(len(c.state.displacement))),
        ),
        {"equilibrium"},
    ),
    "not a number": (lambda c: c.at("shear", c.pressed, np.nan), {"equilibrium", "friction"}),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_states_fail_with_any_mode(collapse, name):
    """With the right mode, and with those that are looked for from the wrong state."""
    change, expected = WRONG[name]
    state = change(collapse)
    certificate = collapse.certificate(state=state)
    assert expected <= set(certificate.failures)
    assert not certificate.passed
    if name != "not a number":
        verified = verify(collapse.case, state, collapse.scales, 1e-6, 1e-6)
        assert expected - {"mode_power"} <= set(verified.certificate.failures)


@pytest.mark.parametrize("ratio", [0.1, 0.5])
def test_states_on_the_way_are_no_collapse(collapse, ratio):
    """All laws hold, but the load factor still rises."""
    case = collapse.case
    state, scales = solved(case, ratio).state, conditions(case, ratio).scales
    assert state.load_factor < 0.99 * collapse.state.load_factor
    assert max(state_residuals(case.problem, state, scales).values()) < 1e-6
    assert not verify(case, state, scales, 1e-6, 1e-6).certificate.passed


# ---- wrong modes


def test_wrong_modes_fail(collapse):
    problem, bodies = collapse.case.problem, collapse.case.block_count
    up = collapse.case.discretization.rigid_motion(np.tile([0.0, 1.0, 0.0], (bodies, 1)))
    up *= problem.max(np.abs(collapse.mode)) / 10.0
    elastic = collapse.case.bonded.live / problem.dot(problem.live, collapse.case.bonded.live)
    noise = np.random.default_rng(1).normal(size=len(up)) * 1e-3 * np.abs(collapse.mode).max()
    for mode, expected in (
        (-collapse.mode, {"mode_work", "mode_power"}),
        (0.5 * collapse.mode, {"mode_work"}),
        (0.0 * collapse.mode, {"mode_work"}),
        (collapse.mode - up, {"mode_penetration"}),
        (collapse.mode + up, {"mode_power"}),  # it lifts what need not be
        (elastic, {"mode_elastic", "mode_power"}),
        (collapse.mode + noise, {"mode_elastic"}),
    ):
        certificate = collapse.certificate(mode=mode)
        assert expected <= set(certificate.failures)
        assert not certificate.mode_passed and not certificate.passed


def test_kinematic_factor_is_an_upper_bound_that_knows_no_speed(collapse):
    problem, case = collapse.case.problem, collapse.case
    usual = kinematic_factor(problem, collapse.state, collapse.mode)
    assert kinematic_factor(problem, collapse.state, 3.0 * collapse.mode) == pytest.approx(usual)
    assert np.isnan(kinematic_factor(problem, collapse.state, 0.0 * collapse.mode))
    # Tipped as a whole about the lower right corner: width over height.
    joints, (x, y) = case.discretization.joints, case.discretization.bodies.centre.T
    corner = joints.position[joints.bodies[:, 0] < 0].max(axis=0)[0]
    tipped = np.column_stack([y, corner - x, np.full(len(x), -1.0)])
    tips = kinematic_factor(problem, collapse.state, case.discretization.rigid_motion(tipped))
    assert tips > usual
    if len(x) == 1:
        assert tips == pytest.approx(0.4 / 0.3, rel=1e-9)


# ---- what residuals mean


def test_gap_is_the_distance_from_the_program(collapse):
    factor = collapse.state.load_factor
    certificate = collapse.certificate(rigid_limit=1.1 * factor, tolerance=1e-3)
    assert certificate.static_factor == 1.1 * factor
    assert certificate.gap == pytest.approx(0.1, rel=1e-9)
    assert certificate.error_estimate == pytest.approx(0.1 * factor, rel=1e-9)
    assert set(certificate.failures) == {"limit"}
    assert "limit" in collapse.certificate(rigid_limit=np.nan).failures


@pytest.mark.parametrize(
    ("load_factor", "missed", "expected"),
    [(0.5, 0.0, 0.0), (1.1, 0.0, 0.1), (-0.2, 0.0, 0.2), (1.1, 0.2, 0.0), (1.1, 0.05, 0.05)],
)
def test_distance_from_a_bracket(load_factor, missed, expected):
    outside = outside_bracket(load_factor, (0.0, 1.0), missed, 1.0)
    assert outside == pytest.approx(expected, abs=1e-12)
    assert outside_bracket(load_factor, (None, None), missed, 1.0) == 0.0


@pytest.mark.parametrize("name", TOLERANCES)
def test_residual_at_its_tolerance_passes_and_above_fails(name):
    exact = dict(TOLERANCES)
    assert Certificate(exact, 1.0).passed
    above = Certificate(exact | {name: 1.001 * exact[name]}, 1.0)
    assert set(above.failures) == {name} and not above.passed
    assert above.mode_passed == (not name.startswith("mode_"))


@pytest.mark.parametrize(
    ("gap", "tolerance", "passed"),
    [(1e-6, 1e-6, True), (1e-5, 1e-6, False), (1e-5, 1e-4, True), (1e-3, 1e-4, False)],
)
def test_gap_counts_from_the_tolerance_asked_for(gap, tolerance, passed):
    assert Certificate({"limit": gap, "work": 0.0}, gap, tolerance=tolerance).passed is passed


# ---- the worst joint


def worst_of(collapse: Collapse, state: State) -> WorstJoint:
    points = collapse.case.discretization.operators.points
    return worst_joint(collapse.case.problem, state, collapse.scales, points)


def test_worst_joint_is_the_damaged_one(collapse):
    points, force = collapse.case.discretization.operators.points, collapse.scales.force
    still = 0.0 * collapse.state.displacement  # nothing has slipped
    collapse = replace(collapse, state=replace(collapse.state, displacement=still))
    for point in (0, len(points) - 1, collapse.pressed):
        for state, law in (
            (collapse.at("pressure", point, -1e2 * force), "tension"),
            (collapse.at("shear", point, 1e2 * force), "friction"),
            (collapse.at("shear", point, -1e2 * force), "friction"),
        ):
            worst = worst_of(collapse, state)
            assert (worst.point, worst.law) == (points[point], law)
            assert worst.residual == pytest.approx(1e2, rel=0.2)
            residuals = state_residuals(collapse.case.problem, state, collapse.scales)
            assert worst.residual == residuals[law]


def test_worst_joint_counts_in_units_of_what_may_be_missed(collapse):
    """Friction misses eight times as much, but ten times as much is allowed."""
    none, force = np.zeros_like(collapse.state.pressure), collapse.scales.force
    rest = replace(collapse.state, displacement=0.0 * collapse.state.displacement, pressure=none)
    damaged = replace(collapse, state=replace(rest, shear=none))
    damaged = replace(damaged, state=damaged.at("shear", 0, 8e-4 * force))
    state = damaged.at("pressure", len(none) - 1, -1e-4 * force)
    worst = worst_of(collapse, state)
    assert TOLERANCES["friction"] == pytest.approx(10.0 * TOLERANCES["tension"])
    points = collapse.case.discretization.operators.points
    assert (worst.point, worst.law) == (points[-1], "tension")
    certificate = collapse.certificate(state=state, points=points)
    assert certificate.worst_joint == worst
    assert collapse.certificate().worst_joint is None
