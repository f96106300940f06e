"""The fixed point on the friction bound: history, relaxation, and its monolithic finish."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import JointLaw, Scene, SolverError
from fenics_contact.analysis.coulomb import (
    CYCLE,
    FAST_RELAXATION,
    MAX_ITERATIONS,
    RELAXATION,
    CoulombFriction,
    FixedPointHistory,
    FixedPointStep,
    _Relaxation,
)
from fenics_contact.solvers.interior_point import PathPoint, WorkControl
from fenics_contact.meshing import running_bond, wall
from fenics_contact.solvers.kkt import State
from fenics_contact.analysis.work_control import FIRST_WORK
from tests.helpers import Loaded, coulomb, on_ground, tresca, whole


def history_of(factors, changes) -> FixedPointHistory:
    steps = [FixedPointStep(f, c, 1.0, 1) for f, c in zip(factors, changes, strict=True)]
    return FixedPointHistory(steps)


@pytest.mark.parametrize("rate", [0.1, 0.5, 0.9, 1.1])
@pytest.mark.parametrize("count", [3, 8, 9])
def test_contraction_of_a_geometric_history(rate, count):
    changes = 0.3 * rate ** np.arange(count)
    history = history_of(np.ones(count), changes)
    assert history.contraction == pytest.approx(rate, rel=1e-12)


def test_contraction_is_that_of_the_last_half():
    changes = [*(0.9 ** np.arange(4)), *(0.1 * 0.2 ** np.arange(4))]
    assert history_of(np.ones(8), changes).contraction == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize("changes", [[], [0.1], [0.1, 0.01], [0.1, 0.01, 0.0]])
def test_contraction_of_a_history_too_short_or_at_rest(changes):
    assert history_of(np.ones(len(changes)), changes).contraction is None


@pytest.mark.parametrize("rate", [0.1, 0.5, 0.9, -0.5])
def test_error_estimate_covers_the_error(rate):
    k = np.arange(8)
    history = history_of(2.0 + 0.1 * rate**k, np.abs(rate) ** k)
    error = abs(history.steps[-1].load_factor - 2.0)
    size = abs(rate)
    # The largest of the last three changes, summed up from the one after it; where the load factor
    # creeps its own series, times three.
    largest = 0.1 * size**4 * abs(1.0 - rate)
    expected = largest * size / (1.0 - size)
    if rate > 0.0:
        expected = max(expected, 3.0 * error)
    assert history.error == pytest.approx(expected, rel=1e-9)
    assert error < history.error


def test_error_estimate_sees_a_load_factor_that_creeps():
    """While the bound seems to converge, and with relaxation that hides how slowly."""
    omega = np.array([0.5, 2.0, 0.1, 1.0, 0.3, 1.0])
    left = 1e-3 * np.cumprod(np.concatenate([[1.0], 1.0 - 0.01 * omega[:-1]]))
    steps = [
        FixedPointStep(2.0 - rest, 0.1**k, w, 1)
        for k, (rest, w) in enumerate(zip(left, omega, strict=True))
    ]
    assert FixedPointHistory(steps).error == pytest.approx(3.0 * left[-1], rel=0.02)


def test_error_estimate_of_short_histories():
    assert history_of([], []).error == np.inf
    assert history_of([1.0], [0.1]).error == np.inf
    assert history_of([1.0, 1.25], [0.1, 0.1]).error == pytest.approx(0.25, rel=1e-12)


def test_error_estimate_of_a_history_that_does_not_contract_stays_finite():
    history = history_of([1.0, 1.1, 1.0, 1.1], [0.1] * 4)
    assert history.error == pytest.approx(0.1 * 0.999 / 0.001, rel=1e-9)


def relaxed(function, start, count: int) -> tuple[list[np.ndarray], list[float], _Relaxation]:
    """Iterate g + omega (f(g) - g); returns all g, all omega, and the relaxation."""
    relaxation = _Relaxation(lambda values: float(np.sum(values)))
    g, omegas = [np.asarray(start, dtype=float)], []
    for _ in range(count):
        target = function(g[-1])
        difference = target - g[-1]
        change = float(np.linalg.norm(difference) / (np.linalg.norm(target) or 1.0))
        omegas.append(relaxation.next(difference, change))
        g.append(g[-1] + omegas[-1] * difference)
    return g, omegas, relaxation


@pytest.mark.parametrize("slope", [0.4, -0.5, -0.9, -3.0])
def test_relaxation_finds_the_slope_of_a_linear_map(slope):
    g, omegas, _ = relaxed(lambda x: slope * (x - 1.0) + 1.0, [3.0], 2)
    assert omegas == pytest.approx([1.0, 1.0 / (1.0 - slope)], rel=1e-12)
    assert g[-1] == pytest.approx([1.0], abs=1e-12)


def test_relaxation_is_limited():
    # The slopes 0.99 and -99 ask for 100, along one direction, and for 0.01.
    for slope, limit in ((0.99, FAST_RELAXATION), (-99.0, RELAXATION[0])):
        _, omegas, _ = relaxed(lambda x, slope=slope: slope * x, [1.0], 2)
        assert omegas[1] == limit


def test_relaxation_is_doubled_where_the_change_grows():
    _, omegas, _ = relaxed(lambda x: 1.5 * x, [1.0], 3)
    assert omegas == [1.0, 2.0, 4.0]


def test_large_relaxation_needs_changes_of_one_direction():
    # Both entries contract slowly, but the larger one turns its sign.
    _, omegas, _ = relaxed(lambda x: np.array([0.95, -0.3]) * x, [1.0, 1.0], 12)
    assert max(omegas) <= FAST_RELAXATION
    _, omegas, _ = relaxed(lambda x: np.array([0.0, -0.9]) * x, [0.0, 1.0], 6)
    assert max(omegas) <= RELAXATION[1]


def test_relaxation_of_a_rotation_converges():
    # Plain iteration circles about the fixed point for ever.
    turn, centre = np.array([[0.0, -1.0], [1.0, 0.0]]), np.array([10.0, 20.0])
    g, omegas, relaxation = relaxed(lambda x: centre + turn @ (x - centre), [11.0, 20.0], 60)
    assert omegas == pytest.approx([1.0] + [0.5] * 59, rel=1e-6)
    assert relaxation.cycles == 0
    # Half a turn of half the way: every iteration shortens the radius by sqrt(2).
    assert np.linalg.norm(g[-1] - centre) == pytest.approx(0.5**29.5, rel=1e-3)


def jump(x: np.ndarray) -> np.ndarray:
    """A map without fixed point: it jumps over the diagonal at one half."""
    return np.where(x < 0.5, 1.0, 0.0)


def test_cap_falls_where_the_iteration_cycles():
    _, omegas, relaxation = relaxed(jump, [0.3], 60)
    assert relaxation.cycles >= 1
    assert max(omegas[-20:]) <= 0.5
    assert min(omegas) >= RELAXATION[0]


def test_cycles_are_counted_every_so_many_iterations_without_progress():
    relaxation = _Relaxation(lambda values: float(np.sum(values)))
    counted = []
    for number in range(3 * CYCLE + 1):
        relaxation.next(np.array([(-1.0) ** number]), 0.5)
        counted.append(relaxation.cycles)
    expected = [number // CYCLE for number in range(3 * CYCLE + 1)]
    assert counted == expected


def test_progress_is_no_cycle():
    relaxation = _Relaxation(lambda values: float(np.sum(values)))
    for number in range(40):
        relaxation.next(np.array([0.85**number]), 0.85**number)
    assert relaxation.cycles == 0


# ---- on structures


@pytest.fixture(scope="module")
def bond() -> Loaded:
    return Loaded.of(on_ground(running_bond(2, 3, elements=1), coulomb(0.45)))


def iterate(
    loaded: Loaded, tolerance: float, monolithic: bool, monitor=None
) -> tuple[PathPoint, FixedPointHistory, CoulombFriction]:
    problem = loaded.structure.problem
    start, scales = loaded.start(FIRST_WORK)
    control = WorkControl(problem, loaded.structure.springs)
    friction = CoulombFriction(control, scales, tolerance, monolithic, monitor)
    bound = problem.bound(loaded.bonded.dead_pressure)
    return *friction.solve(start, bound, start.work), friction


def test_fixed_point_is_one(bond):
    point, history, _ = iterate(bond, 1e-8, monolithic=False)
    assert history.converged
    assert history.method == "fixed-point"
    target = bond.structure.problem.bound(point.state.pressure)
    assert point.bound == pytest.approx(target, abs=1e-7 * target.max())
    assert history.steps[-1].change <= 1e-8
    assert history.error <= 1e-8 * point.state.load_factor
    assert len(history.steps) > 2


def test_fixed_point_equals_the_monolithic_solution(bond):
    slow, slow_history, _ = iterate(bond, 1e-9, monolithic=False)
    fast, fast_history, _ = iterate(bond, 1e-9, monolithic=True)
    assert slow_history.converged and fast_history.converged
    assert fast_history.method == "monolithic"
    assert fast.state.load_factor == pytest.approx(slow.state.load_factor, rel=1e-8)
    # All courses are about to slide: which of them does is open, and with it the last digits of
    # the forces.
    scale = slow.state.pressure.max(initial=1.0)
    assert fast.state.pressure == pytest.approx(slow.state.pressure, abs=1e-4 * scale)
    assert len(fast_history.steps) < len(slow_history.steps)


@pytest.mark.parametrize("monolithic", [False, True])
@pytest.mark.parametrize("friction", [0.1, 0.6])
def test_sliding_block(friction, monolithic):
    loaded = Loaded.of(on_ground(wall([[1]], (0.4, 0.4), 1), coulomb(friction)))
    point, history, _ = iterate(loaded, 1e-8, monolithic)
    assert history.converged
    assert point.state.load_factor == pytest.approx(friction, rel=1e-8)


def test_given_strength_needs_one_iteration():
    loaded = Loaded.of(on_ground(running_bond(2, 2, elements=1), tresca(1e3)))
    point, history, _ = iterate(loaded, 1e-8, monolithic=True)
    assert history.converged
    assert [step.change for step in history.steps] == pytest.approx([0.0], abs=1e-15)
    assert history.method == "fixed-point"
    assert point.bound == pytest.approx(loaded.structure.problem.strength)


def test_mixed_laws_keep_their_strength():
    usual = on_ground(wall([[1, 1]], (0.4, 0.4), 1), coulomb(0.3))
    scene = Scene(
        usual.mesh,
        usual.materials,
        dead=usual.dead,
        live=usual.live,
        joints={"head": JointLaw("tresca", bound=1e3)},
        foundations={"base": coulomb(0.3)},
    )
    loaded = Loaded.of(scene)
    point, history, _ = iterate(loaded, 1e-8, monolithic=True)
    assert history.converged
    assert point.state.load_factor == pytest.approx(0.3, rel=1e-8)
    bound = loaded.structure.all_points(point.bound)
    head = loaded.structure.joints.law == 0
    assert bound[head] == pytest.approx(1e3 * loaded.structure.joints.length[head], rel=1e-12)


def test_monitor_is_told_every_iteration(bond):
    told: list[FixedPointStep] = []
    _, history, _ = iterate(bond, 1e-6, monolithic=True, monitor=told.append)
    assert told == history.steps
    before = bond.structure.springs.factorizations
    _, history, _ = iterate(bond, 1e-6, monolithic=False)
    spent = bond.structure.springs.factorizations - before
    assert spent == sum(step.steps for step in history.steps)


def test_warm_start_at_a_larger_work_goes_on_at_once(bond):
    point, _, friction = iterate(bond, 1e-8, monolithic=True)
    on, history = friction.go_on(point.state, 1.2 * point.state.work)
    assert history.converged and history.method == "monolithic"
    assert len(history.steps) == 1
    assert on.state.load_factor == pytest.approx(point.state.load_factor, rel=1e-6)
    assert on.state.work == 1.2 * point.state.work
    live = whole(bond.structure.problem.live)
    assert live @ whole(on.state.displacement) == pytest.approx(on.state.work, rel=1e-10)


def test_going_on_while_the_load_factor_rises_needs_to_know_how_fast():
    # On the elastic branch, where the load factor of a block grows with the work.
    loaded = Loaded.of(on_ground(wall([[1]], (0.4, 0.3), 1), coulomb(0.9)))
    problem = loaded.structure.problem
    start, scales = loaded.start(0.5)
    friction = CoulombFriction(WorkControl(problem, loaded.structure.springs), scales, 1e-8, True)
    point, history = friction.solve(start, problem.bound(loaded.bonded.dead_pressure), start.work)
    assert history.converged
    more = 1.2 * start.work
    with pytest.raises(SolverError, match="no state next to the last one"):
        friction.go_on(point.state, more)
    on, _ = friction.go_on(point.state, more, growth=0.2 * point.state.load_factor)
    assert on.state.load_factor == pytest.approx(1.2 * point.state.load_factor, rel=1e-6)


def test_going_on_needs_the_monolithic_solve(bond):
    point, _, friction = iterate(bond, 1e-6, monolithic=False)
    with pytest.raises(SolverError, match="no state next to the last one"):
        friction.go_on(point.state, 1.2 * point.state.work)


class Made:
    """A solver whose pressures follow a made-up map of the bound; load factor is their mean."""

    def __init__(self, loaded: Loaded, answer) -> None:
        self.problem = loaded.structure.problem
        self.springs = loaded.structure.springs
        self.answer = answer
        self.calls = 0

    def solve(self, bound, work, start, scales, centring, tolerance, load_factor=None) -> PathPoint:
        self.calls += 1
        pressure = self.answer(bound, self.calls)
        vector = start.displacement.copy()
        mean = self.problem.sum(pressure) / self.problem.sum(np.ones_like(pressure))
        return PathPoint(
            State(vector, mean, pressure, np.zeros_like(pressure), work), bound, {}, steps=1
        )


def made_up(loaded: Loaded, answer) -> tuple[PathPoint, FixedPointHistory, Made]:
    control = Made(loaded, answer)
    start, scales = loaded.start(FIRST_WORK)
    friction = CoulombFriction(control, scales, 1e-8, monolithic=False)
    bound = np.full(len(loaded.structure.problem.friction), 0.3)
    return *friction.solve(start, bound, start.work), control


def test_made_up_contraction_converges(bond):
    # F r_N = 0.45 (1 + g): the fixed point is g = 0.45 / 0.55.
    point, history, _ = made_up(bond, lambda bound, call: 1.0 + bound)
    assert history.converged
    assert point.bound == pytest.approx(np.full(len(point.bound), 0.45 / 0.55), rel=1e-7)
    assert history.cycles == 0


def test_made_up_jump_ends_without_convergence_and_is_damped(bond):
    _, history, control = made_up(bond, lambda bound, call: np.where(bound < 0.5, 2.0, 0.1))
    assert not history.converged
    assert control.calls == len(history.steps) == MAX_ITERATIONS
    assert history.cycles >= 1
    assert history.steps[-1].relaxation <= 0.5


def test_last_state_is_kept_where_the_next_is_not_found(bond):
    def answer(bound, call):
        if call > 3:
            raise SolverError("made up")
        return 1.0 + 0.1 * call + bound

    point, history, _ = made_up(bond, answer)
    assert not history.converged
    assert len(history.steps) == 3
    assert point.state.load_factor == history.steps[-1].load_factor


def test_no_state_at_all_is_an_error(bond):
    def answer(bound, call):
        raise SolverError("made up")

    with pytest.raises(SolverError, match="made up"):
        made_up(bond, answer)
