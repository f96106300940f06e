"""The verification of a collapse state: what is right passes, every tampering is found."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from petsc4py import PETSc

from fenics_contact.analysis.rigid_blocks import LimitBounds, RigidBlocks
from fenics_contact.analysis.certificate import (
    TOLERANCES,
    Certificate,
    WorstJoint,
    certify,
    kinematic_factor,
    worst_joint,
)
from fenics_contact.analysis.coulomb import CoulombFriction
from fenics_contact.solvers.interior_point import WorkControl
from fenics_contact.meshing import running_bond, wall
from fenics_contact.solvers.kkt import Scales, State
from fenics_contact.analysis.work_control import FIRST_WORK
from tests.helpers import (
    Array,
    Loaded,
    coulomb,
    joint_rows,
    node_bodies,
    on_ground,
    vector_like,
    whole,
)


@dataclass(frozen=True)
class Collapse:
    """A collapse state of a structure and its mode."""

    loaded: Loaded
    state: State
    mode: PETSc.Vec
    scales: Scales
    bounds: LimitBounds
    rigid_limit: float

    @classmethod
    def of(cls, loaded: Loaded) -> Collapse:
        structure = loaded.structure
        start, scales = loaded.start(FIRST_WORK)
        control = WorkControl(structure.problem, structure.springs)
        friction = CoulombFriction(control, scales, 1e-9, monolithic=True)
        bound = structure.problem.bound(loaded.bonded.dead_pressure)
        point, history = friction.solve(start, bound, start.work)
        assert history.converged
        blocks = RigidBlocks(structure.joints, structure.bodies, structure.scene.comm)
        limit, motion = blocks.collapse(structure.all_points(point.bound))
        mode = structure.rigid_motion(motion)
        return cls(loaded, point.state, mode, scales, blocks.bounds(), limit)

    def certificate(self, **changes) -> Certificate:
        changed = replace(self, **changes)
        return certify(
            self.loaded.structure.problem,
            changed.state,
            changed.mode,
            changed.scales,
            changed.bounds,
            changed.rigid_limit,
        )

    def at_point(self, name: str, point: int, change) -> State:
        """The state with one entry of its pressure or shear changed."""
        values = getattr(self.state, name).copy()
        row = np.flatnonzero(self.loaded.structure.operators.points == point)
        values[row] = change(values[row])
        return replace(self.state, **{name: values})

    def displaced(self, body: int, motion: Array) -> State:
        """The state with one body displaced by a rigid motion (a, b, c)."""
        motions = np.zeros((len(self.loaded.structure.bodies.centre), 3))
        motions[body] = motion
        displacement = self.state.displacement.copy()
        displacement.axpy(1.0, self.loaded.structure.rigid_motion(motions))
        return replace(self.state, displacement=displacement)

    def all_points(self, values: Array) -> Array:
        return self.loaded.structure.all_points(values)

    def most_loaded(self) -> int:
        return int(np.argmax(self.all_points(self.state.pressure)))


@pytest.fixture(scope="module", params=["block", "wall"])
def collapse(request) -> Collapse:
    if request.param == "block":
        scene = on_ground(wall([[1]], (0.4, 0.3), 1), coulomb(0.4))
    else:
        scene = on_ground(running_bond(2, 2, elements=1), coulomb(0.45))
    return Collapse.of(Loaded.of(scene))


def test_correct_collapse_passes(collapse):
    certificate = collapse.certificate()
    assert set(certificate.residuals) >= set(TOLERANCES)
    assert certificate.failures == {}
    assert certificate.passed and certificate.mode_passed
    assert certificate.gap == certificate.residuals["limit"] < 1e-8
    assert certificate.error_estimate < 1e-6 * collapse.state.load_factor


@pytest.mark.parametrize("factor", [1.001, 0.999])
def test_changed_load_factor(collapse, factor):
    state = replace(collapse.state, load_factor=factor * collapse.state.load_factor)
    certificate = collapse.certificate(state=state)
    assert {"equilibrium", "mode_power"} <= set(certificate.failures)
    # The power balance misses just what the load factor was changed by.
    assert certificate.gap == pytest.approx(1e-3, rel=0.05)
    missed = 1e-3 * collapse.state.load_factor
    assert certificate.error_estimate == pytest.approx(missed, rel=1e-4)
    assert not certificate.mode_passed


def test_negative_pressure(collapse):
    point, force = collapse.most_loaded(), collapse.scales.force
    state = collapse.at_point("pressure", point, lambda r: -1e-3 * force)
    certificate = collapse.certificate(state=state)
    assert {"tension", "equilibrium"} <= set(certificate.failures)
    assert certificate.residuals["tension"] == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_shear_above_the_cone(collapse, sign):
    point = collapse.most_loaded()
    problem, force = collapse.loaded.structure.problem, collapse.scales.force
    bound = collapse.all_points(problem.bound(collapse.state.pressure))[point]
    excess = 1e-3 * force
    state = collapse.at_point("shear", point, lambda r: sign * (bound + excess))
    certificate = collapse.certificate(state=state)
    assert "friction" in certificate.failures
    assert certificate.residuals["friction"] == pytest.approx(1e-3, rel=1e-6)


def test_body_pushed_into_the_ground(collapse):
    depth = 1e-3 * collapse.scales.displacement
    clean = collapse.certificate().residuals
    state = collapse.displaced(0, [0.0, -depth, 0.0])
    certificate = collapse.certificate(state=state)
    assert {"penetration", "complementarity"} <= set(certificate.failures)
    assert certificate.residuals["penetration"] == pytest.approx(1e-3, rel=1e-3)
    # A rigid motion changes no stress and no force.
    assert "equilibrium" not in certificate.failures
    for name in ("tension", "friction"):
        assert certificate.residuals[name] == clean[name]


def test_body_lifted_off_though_it_is_pressed(collapse):
    state = collapse.displaced(0, [0.0, 1e-3 * collapse.scales.displacement, 0.0])
    assert "complementarity" in collapse.certificate(state=state).failures


def test_body_slid_against_its_shear(collapse):
    # Far to the left of where it was at rest, while friction still resists a slip to the right.
    state = collapse.displaced(0, [-10.0 * collapse.scales.displacement, 0.0, 0.0])
    assert {"slip_direction", "work"} <= set(collapse.certificate(state=state).failures)


def test_changed_work(collapse):
    state = replace(collapse.state, work=1.001 * collapse.state.work)
    certificate = collapse.certificate(state=state)
    assert set(certificate.failures) == {"work"}
    assert certificate.residuals["work"] == pytest.approx(1e-3 / 1.001, rel=1e-6)


def test_changed_displacement_is_not_in_equilibrium(collapse):
    u = whole(collapse.state.displacement)
    noise = np.random.default_rng(0).standard_normal(len(u)) * 1e-6 * np.abs(u).max()
    displacement = vector_like(collapse.state.displacement, u + noise)
    state = replace(collapse.state, displacement=displacement)
    assert "equilibrium" in collapse.certificate(state=state).failures


def scaled(vector: PETSc.Vec, factor: float) -> PETSc.Vec:
    result = vector.copy()
    result.scale(factor)
    return result


def test_mode_backwards(collapse):
    certificate = collapse.certificate(mode=scaled(collapse.mode, -1.0))
    assert "mode_power" in certificate.failures
    assert not certificate.mode_passed


def test_mode_into_the_ground(collapse):
    structure = collapse.loaded.structure
    motion = np.zeros((len(structure.bodies.centre), 3))
    motion[:, 1] = -1.0 / collapse.scales.force
    mode = collapse.mode.copy()
    mode.axpy(1.0, structure.rigid_motion(motion))
    assert "mode_penetration" in collapse.certificate(mode=mode).failures


def test_mode_that_lifts_what_need_not_be(collapse):
    # Admissible, but it costs the work of lifting: it proves a higher load factor only.
    structure = collapse.loaded.structure
    upward = np.zeros((len(structure.bodies.centre), 3))
    upward[:, 1] = 0.1 / collapse.scales.force
    mode = collapse.mode.copy()
    mode.axpy(1.0, structure.rigid_motion(upward))
    assert set(collapse.certificate(mode=mode).failures) == {"mode_power"}


def test_elastic_mode(collapse):
    # The bonded response to the live load: no mechanism at all.
    live = collapse.loaded.structure.problem.live
    mode = scaled(collapse.loaded.bonded.live, 1.0 / live.dot(collapse.loaded.bonded.live))
    failures = collapse.certificate(mode=mode).failures
    assert {"mode_elastic", "mode_power"} <= set(failures)


def test_mode_that_is_strained_a_little(collapse):
    u = whole(collapse.mode)
    noise = np.random.default_rng(1).standard_normal(len(u)) * 1e-3 * np.abs(u).max()
    failures = collapse.certificate(mode=vector_like(collapse.mode, u + noise)).failures
    assert "mode_elastic" in failures


@pytest.mark.parametrize("factor", [0.0, 1e-6, 0.5, 2.0])
def test_mode_whose_live_load_does_not_do_unit_work(collapse, factor):
    # By definition f_L.v = 1; no motion at all balances its power as well.
    certificate = collapse.certificate(mode=scaled(collapse.mode, factor))
    assert not certificate.mode_passed


@pytest.mark.parametrize(("lower", "upper"), [(2.0, 3.0), (0.0, 0.9)])
def test_load_factor_outside_its_bracket(collapse, lower, upper):
    factor = collapse.state.load_factor
    bounds = replace(collapse.bounds, lower=lower * factor, upper=upper * factor)
    certificate = collapse.certificate(bounds=bounds)
    assert set(certificate.failures) == {"bracket"}
    outside = max(lower - 1.0, 1.0 - upper)
    assert certificate.residuals["bracket"] == pytest.approx(outside, rel=1e-9)


def test_no_lower_bound(collapse):
    bounds = LimitBounds(lower=None, upper=np.inf, stands=True, stands_frictionless=False)
    assert collapse.certificate(bounds=bounds).passed


def test_not_a_number_is_a_failure(collapse):
    point = collapse.most_loaded()
    state = collapse.at_point("shear", point, lambda r: np.nan)
    certificate = collapse.certificate(state=state)
    assert {"equilibrium", "friction"} <= set(certificate.failures)
    assert not certificate.passed


def test_residual_at_its_tolerance_passes_and_above_fails():
    exact = dict(TOLERANCES)
    assert Certificate(exact, 1.0).passed
    for name in exact:
        above = exact | {name: 1.001 * exact[name]}
        certificate = Certificate(above, 1.0)
        assert certificate.failures == {name: above[name]}
        assert not certificate.passed
        assert certificate.mode_passed == (not name.startswith("mode_"))


def test_residuals_do_not_depend_on_the_order_of_joint_points(collapse):
    # The largest residuals, recomputed by dense algebra.
    structure = collapse.loaded.structure
    b_n, b_t = joint_rows(structure)
    u, v = whole(collapse.state.displacement), whole(collapse.mode)
    certificate = collapse.certificate()
    d = collapse.scales.displacement
    assert certificate.residuals["penetration"] == pytest.approx(
        max(0.0, -(b_n @ u).min()) / d, abs=1e-12
    )
    unit = d / collapse.state.work
    assert certificate.residuals["mode_penetration"] == pytest.approx(
        max(0.0, -(b_n @ v).min()) / unit, abs=1e-10
    )
    assert len(node_bodies(structure)) * 2 == len(u)
    bound = collapse.all_points(structure.problem.bound(collapse.state.pressure))
    power = collapse.state.load_factor * (whole(structure.problem.live) @ v)
    power += whole(structure.problem.dead) @ v
    dissipation = bound @ np.abs(b_t @ v)
    assert certificate.residuals["mode_power"] == pytest.approx(
        abs(dissipation - power) / max(dissipation, power, collapse.state.load_factor), abs=1e-10
    )


@pytest.fixture(scope="module")
def sliding() -> Collapse:
    """A block that slides at its coefficient of friction."""
    return Collapse.of(Loaded.of(on_ground(wall([[1]], (0.4, 0.4), 2), coulomb(0.3))))


@pytest.mark.parametrize(
    ("name", "law", "change"),
    [
        ("pressure", "tension", lambda force: -force - 1.0),
        ("shear", "friction", lambda force: 10.0 * force - 1.0),
    ],
)
@pytest.mark.parametrize("point", [0, 2])
def test_worst_joint_is_the_damaged_one(sliding, point, name, law, change):
    problem = sliding.loaded.structure.problem
    points = sliding.loaded.structure.operators.points
    worst = worst_joint(problem, sliding.at_point(name, point, change), sliding.scales, points)
    assert worst is not None
    assert (worst.point, worst.law) == (point, law)
    assert worst.residual > TOLERANCES[law]


def test_static_and_kinematic_factor_of_a_sliding_block(sliding):
    certificate = sliding.certificate()
    assert certificate.static_factor == pytest.approx(0.3, rel=1e-8)
    assert certificate.kinematic_factor == pytest.approx(0.3, rel=1e-6)
    assert certificate.worst_joint is None  # no numbers of joint points were given


# ---- the worst joint


def at_rest(collapse: Collapse) -> State:
    """No displacements and no forces: every joint law holds to the last digit."""
    displacement = collapse.state.displacement.duplicate()
    displacement.set(0.0)
    none = np.zeros_like(collapse.state.pressure)
    return State(displacement, 0.0, none, none.copy(), 0.0)


def with_entry(collapse: Collapse, state: State, name: str, point: int, value: float) -> State:
    """A state with another pressure or shear at one point."""
    return replace(collapse, state=state).at_point(name, point, lambda _: value)


def moved_at(collapse: Collapse, state: State, kind: str, point: int, by: float) -> State:
    """A state with the block above a point of the ground moved there, and nowhere else."""
    row = joint_rows(collapse.loaded.structure)[kind == "tangential"][point]
    moved = whole(state.displacement) + by * row / (row @ row)
    return replace(state, displacement=vector_like(state.displacement, moved))


def ground_points(collapse: Collapse) -> list[int]:
    """Points on the ground whose nodes no other joint touches."""
    b_n, b_t = joint_rows(collapse.loaded.structure)
    shared = np.abs(b_n) @ (np.abs(b_n) + np.abs(b_t)).T
    np.fill_diagonal(shared, 0.0)
    return [int(p) for p in np.flatnonzero(shared.sum(axis=1) == 0.0)]


def worst_of(collapse: Collapse, state: State) -> WorstJoint:
    structure = collapse.loaded.structure
    found = worst_joint(structure.problem, state, collapse.scales, structure.operators.points)
    assert found is not None
    return found


def points_to_damage(collapse: Collapse) -> list[int]:
    points = ground_points(collapse)
    assert len(points) >= 2
    return [points[0], points[len(points) // 2], points[-1]]


def test_worst_joint_of_a_tension(collapse):
    force = collapse.scales.force
    for point in points_to_damage(collapse):
        state = with_entry(collapse, at_rest(collapse), "pressure", point, -1e-3 * force)
        worst = worst_of(collapse, state)
        assert (worst.point, worst.law) == (point, "tension")
        assert worst.residual == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_worst_joint_of_a_shear_above_its_bound(sign, collapse):
    force = collapse.scales.force
    friction = collapse.loaded.structure.joints.friction
    for point in points_to_damage(collapse):
        state = with_entry(collapse, at_rest(collapse), "pressure", point, force)
        shear = sign * (friction[point] + 1e-3) * force
        worst = worst_of(collapse, with_entry(collapse, state, "shear", point, shear))
        assert (worst.point, worst.law) == (point, "friction")
        assert worst.residual == pytest.approx(1e-3, rel=1e-9)


def test_worst_joint_of_a_penetration(collapse):
    depth = 1e-3 * collapse.scales.displacement
    for point in points_to_damage(collapse):
        worst = worst_of(collapse, moved_at(collapse, at_rest(collapse), "normal", point, -depth))
        assert (worst.point, worst.law) == (point, "penetration")
        assert worst.residual == pytest.approx(1e-3, rel=1e-9)


def test_worst_joint_of_an_opening_under_pressure(collapse):
    gap, force = 1e-3 * collapse.scales.displacement, collapse.scales.force
    for point in points_to_damage(collapse):
        state = moved_at(collapse, at_rest(collapse), "normal", point, gap)
        worst = worst_of(collapse, with_entry(collapse, state, "pressure", point, 2.0 * force))
        assert (worst.point, worst.law) == (point, "complementarity")
        assert worst.residual == pytest.approx(2e-3, rel=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_worst_joint_of_a_slip_that_nothing_resists(sign, collapse):
    slip, force = sign * 1e-2 * collapse.scales.displacement, collapse.scales.force
    friction = collapse.loaded.structure.joints.friction
    for point in points_to_damage(collapse):
        state = moved_at(collapse, at_rest(collapse), "tangential", point, slip)
        worst = worst_of(collapse, with_entry(collapse, state, "pressure", point, force))
        assert (worst.point, worst.law) == (point, "slip_direction")
        assert worst.residual == pytest.approx(1e-2 * friction[point], rel=1e-9)


def test_worst_joint_counts_in_units_of_what_may_be_missed(collapse):
    # Friction misses eight times as much, but ten times as much is allowed.
    force = collapse.scales.force
    first, *_, last = points_to_damage(collapse)
    state = with_entry(collapse, at_rest(collapse), "shear", first, 8e-4 * force)
    state = with_entry(collapse, state, "pressure", last, -1e-4 * force)
    worst = worst_of(collapse, state)
    assert TOLERANCES["friction"] == pytest.approx(10.0 * TOLERANCES["tension"])
    assert (worst.point, worst.law) == (last, "tension")


def test_worst_joint_of_a_collapse_state(collapse):
    worst = worst_of(collapse, collapse.state)
    residuals = collapse.certificate().residuals
    assert worst.residual == residuals[worst.law] <= TOLERANCES[worst.law]
    laws = ("tension", "penetration", "complementarity", "friction", "slip_direction")
    assert max(residuals[law] / TOLERANCES[law] for law in laws) == pytest.approx(
        worst.residual / TOLERANCES[worst.law], rel=1e-12
    )


def test_worst_joint_of_a_damaged_collapse_state(collapse):
    point, force = collapse.most_loaded(), collapse.scales.force
    state = with_entry(collapse, collapse.state, "pressure", point, -100.0 * force)
    worst = worst_of(collapse, state)
    assert (worst.point, worst.law) == (point, "tension")
    assert worst.residual == pytest.approx(100.0, rel=1e-12)


def test_worst_joint_is_known_to_all_ranks(collapse):
    state = with_entry(collapse, at_rest(collapse), "pressure", 0, -collapse.scales.force)
    worst = worst_of(collapse, state)
    assert set(collapse.loaded.structure.scene.comm.allgather(worst)) == {worst}


def test_certificate_names_the_worst_joint(collapse):
    structure = collapse.loaded.structure
    state = with_entry(
        collapse, collapse.state, "shear", collapse.most_loaded(), 1e3 * collapse.scales.force
    )
    certificate = certify(
        structure.problem,
        state,
        collapse.mode,
        collapse.scales,
        collapse.bounds,
        collapse.rigid_limit,
        structure.operators.points,
    )
    assert certificate.worst_joint == worst_of(collapse, state)
    assert certificate.worst_joint.point == collapse.most_loaded()
    assert collapse.certificate().worst_joint is None


def test_slip_is_measured_from_its_origin(collapse):
    problem, point = collapse.loaded.structure.problem, points_to_damage(collapse)[0]
    slip, force = 1e-2 * collapse.scales.displacement, collapse.scales.force
    state = moved_at(collapse, at_rest(collapse), "tangential", point, slip)
    state = with_entry(collapse, state, "pressure", point, force)
    assert worst_of(collapse, state).law == "slip_direction"
    try:
        problem.measure_slip_from(state.displacement)
        assert worst_of(collapse, state).residual < 1e-12
    finally:
        problem.slip_origin[:] = 0.0


# ---- static and kinematic load factors


def test_static_and_kinematic_factor_of_a_sliding_structure(collapse):
    # Block and wall slide as a whole.
    exact = float(collapse.loaded.structure.joints.friction.max())
    certificate = collapse.certificate()
    assert certificate.static_factor == pytest.approx(exact, rel=1e-7)
    assert certificate.kinematic_factor == pytest.approx(exact, rel=1e-7)


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_kinematic_factor_does_not_depend_on_the_speed(factor, collapse):
    problem = collapse.loaded.structure.problem
    usual = kinematic_factor(problem, collapse.state, collapse.mode)
    mode = scaled(collapse.mode, factor)
    assert kinematic_factor(problem, collapse.state, mode) == pytest.approx(usual, rel=1e-12)


def test_kinematic_factor_of_other_modes_is_higher(collapse):
    # Tipped about its lower right corner the block has a load factor of width over height.
    structure = collapse.loaded.structure
    motion = np.zeros((len(structure.bodies.centre), 3))
    corner = structure.joints.position.max(axis=0)[0]
    x, y = structure.bodies.centre.T
    motion[:] = np.column_stack([y, corner - x, np.full(len(x), -1.0)])
    tipping = kinematic_factor(structure.problem, collapse.state, structure.rigid_motion(motion))
    sliding = kinematic_factor(structure.problem, collapse.state, collapse.mode)
    assert tipping > sliding
    if len(x) == 1:
        assert tipping == pytest.approx(0.4 / 0.3, rel=1e-9)


def test_kinematic_factor_of_no_motion_is_not_a_number(collapse):
    none = scaled(collapse.mode, 0.0)
    assert np.isnan(kinematic_factor(collapse.loaded.structure.problem, collapse.state, none))


def test_static_factor_is_that_of_the_program(collapse):
    certificate = collapse.certificate(rigid_limit=0.25)
    assert certificate.static_factor == 0.25
    missed = abs(0.25 - collapse.state.load_factor)
    assert certificate.error_estimate == pytest.approx(missed, rel=1e-12)


@pytest.mark.parametrize(
    ("gap", "tolerance", "passed"),
    [(1e-6, 1e-6, True), (1e-5, 1e-6, False), (1e-5, 1e-4, True), (1e-3, 1e-4, False)],
)
def test_gap_counts_from_the_tolerance_asked_for(gap, tolerance, passed):
    certificate = Certificate({"limit": gap, "work": 0.0}, gap, tolerance=tolerance)
    assert certificate.passed is passed
    assert list(certificate.failures) == ([] if passed else ["limit"])
