"""Load factors raised step by step: the bracket of the limit load, where slip is measured from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from fenics_contact import JointLaw, SolverError
from fenics_contact.analysis.load_control import LARGEST, LoadPath, LoadStep, follow_load
from fenics_contact.analysis.coulomb import CoulombFriction, FixedPointHistory
from fenics_contact.solvers.interior_point import PathPoint, WorkControl
from fenics_contact.meshing import wall
from fenics_contact.solvers.kkt import Scales, State
from tests.helpers import GRAVITY, STONE, Loaded, coulomb, on_ground, tresca, whole

B, H = 0.4, 1.0
STRENGTH = 2000.0

#: Blocks B wide and H high on the ground with their limit loads.
BLOCKS = {
    "slides": (coulomb(0.3), 0.3),
    "tips": (coulomb(0.8), B / H),
    "given strength": (tresca(STRENGTH), STRENGTH / (STONE.density * GRAVITY * H)),
}


def loaded_block(law: JointLaw) -> Loaded:
    return Loaded.of(on_ground(wall([[1]], (B, H), 1), law))


def dead_state(loaded: Loaded) -> State:
    """The bonded state under the dead load, to start from."""
    bonded, live = loaded.bonded, loaded.structure.problem.live
    pressure = bonded.dead_pressure
    return State(bonded.dead.copy(), 0.0, pressure, np.zeros_like(pressure), live.dot(bonded.dead))


@dataclass
class Followed:
    """A path and all that was asked for and told on the way."""

    loaded: Loaded
    path: LoadPath
    asked: list[float]
    told: list[LoadStep]


def follow(law: JointLaw, upper: float = np.inf, by_steps: bool = False, width=1e-3) -> Followed:
    """Follow the load on a block by the interior point method."""
    loaded = loaded_block(law)
    problem = loaded.structure.problem
    control = WorkControl(problem, loaded.structure.springs)
    asked: list[float] = []
    told: list[LoadStep] = []

    def friction(sizes: Scales, load_factor: float) -> CoulombFriction:
        asked.append(load_factor)
        return CoulombFriction(control, sizes, 1e-6, True, None, load_factor)

    start = dead_state(loaded)
    path = follow_load(problem, friction, start, loaded.scales, upper, width, by_steps, told.append)
    return Followed(loaded, path, asked, told)


@pytest.fixture(scope="module", params=[False, True], ids=["stress-free", "load-steps"])
def by_steps(request) -> bool:
    return request.param


@pytest.fixture(scope="module", params=BLOCKS)
def followed(request, by_steps) -> tuple[Followed, float, bool]:
    """A path without an upper bound, the closed form, and how slip is measured."""
    law, exact = BLOCKS[request.param]
    return follow(law, by_steps=by_steps), exact, by_steps


def test_bracket_contains_the_closed_form(followed):
    run, exact, _ = followed
    assert run.path.lower <= exact <= run.path.upper
    assert run.path.upper - run.path.lower <= 1e-3 * run.path.lower
    # What is called the upper end was looked at, from close by, and not found.
    assert run.path.upper in run.asked
    assert run.path.upper not in [step.load_factor for step in run.path.steps]


def test_steps_rise_from_the_dead_load(followed):
    run, _, _ = followed
    factor, displacement, work = np.transpose(
        [(step.load_factor, step.displacement, step.work) for step in run.path.steps]
    )
    assert factor[0] == run.asked[0] == 0.0
    assert factor[-1] == run.path.lower == run.path.state.load_factor
    assert np.all(np.diff(factor) > 0.0)
    assert np.all(np.diff(displacement) > 0.0)
    unit = np.abs(whole(run.loaded.structure.problem.live)).sum()
    assert work == pytest.approx(unit * displacement, rel=1e-12)


def test_last_state_is_that_of_the_last_step(followed):
    run, _, _ = followed
    live, last = whole(run.loaded.structure.problem.live), run.path.steps[-1]
    assert live @ whole(run.path.state.displacement) == pytest.approx(last.work, rel=1e-12)
    assert live @ whole(run.path.direction) == pytest.approx(1.0, rel=1e-9)


def test_states_carry_weight_and_load(followed):
    # The sums of the forces on the ground.
    run, _, _ = followed
    problem, state = run.loaded.structure.problem, run.path.state
    weight = STONE.density * GRAVITY * B * H
    assert problem.sum(state.pressure) == pytest.approx(weight, rel=1e-4)
    assert abs(problem.sum(state.shear)) == pytest.approx(run.path.lower * weight, rel=1e-4)
    bound = problem.bound(state.pressure)
    assert problem.max(np.abs(state.shear) - bound) <= 1e-5 * weight


def test_where_slip_is_measured_from(followed):
    run, _, by_steps = followed
    problem = run.loaded.structure.problem
    _, slip = problem.joint_displacements(run.path.state.displacement)
    assert problem.max(np.abs(slip)) > 0.0
    if by_steps:
        assert np.array_equal(problem.slip_origin, slip)
    else:
        assert not np.any(problem.slip_origin)


def test_every_state_found_is_told(followed):
    run, _, _ = followed
    assert run.told == list(run.path.steps)
    assert len(run.asked) > len(run.told)


@pytest.mark.parametrize("law", [coulomb(0.3), tresca(STRENGTH)], ids=["coulomb", "tresca"])
@pytest.mark.parametrize("part", [1.0, 0.5])
def test_upper_bound_is_not_exceeded(part, law):
    exact = 0.3 if law.friction else BLOCKS["given strength"][1]
    run = follow(law, upper=part * exact)
    assert max(run.asked) < part * exact
    assert run.path.upper == np.inf
    assert part * exact * (1.0 - 2e-3) <= run.path.lower <= part * exact


def test_upper_bound_far_above_the_limit_load():
    run = follow(coulomb(0.3), upper=2.0)
    assert max(run.asked) < 2.0
    assert run.path.lower <= 0.3 <= run.path.upper <= run.path.lower * (1.0 + 1e-3)


@pytest.mark.parametrize("width", [0.1, 1e-2])
def test_bracket_is_as_narrow_as_asked(width):
    wide, narrow = (follow(coulomb(0.8), width=w) for w in (width, 0.1 * width))
    for run, asked in ((wide, width), (narrow, 0.1 * width)):
        assert run.path.lower <= 0.4 <= run.path.upper
        assert run.path.upper - run.path.lower <= asked * run.path.lower
    assert len(wide.asked) < len(narrow.asked)


# ---- with a solver that is made up


@dataclass
class Made:
    """A solver that finds the states whose load factors it is asked for, or not.

    Attributes:
        loaded: A structure; its bonded response stands for the states.
        found: Whether there is a state at a load factor, next to a state at another.
        raises: Whether one that is not there is an error or does not converge.
        asked: Load factors, in order.
        sizes: Typical sizes they were asked with.
        warm: Whether the state before was called near.
    """

    loaded: Loaded
    found: Callable[[float, float], bool]
    raises: bool = True
    asked: list[float] = field(default_factory=list)
    sizes: list[Scales] = field(default_factory=list)
    warm: list[bool] = field(default_factory=list)

    def friction(self, sizes: Scales, load_factor: float) -> Made:
        self.asked.append(load_factor)
        self.sizes.append(sizes)
        return self

    def solve(
        self, start: State, bound, work: float, warm: bool = False, growth: float = 0.0
    ) -> tuple[PathPoint, FixedPointHistory]:
        load_factor = self.asked[-1]
        self.warm.append(warm)
        there = self.found(load_factor, start.load_factor)
        if self.raises and not there:
            raise SolverError("made up")
        displacement = self.loaded.bonded.dead.copy()
        displacement.axpy(load_factor, self.loaded.bonded.live)
        pressure = np.full_like(start.pressure, 1.0 + load_factor)
        state = State(displacement, load_factor, pressure, np.zeros_like(pressure), work)
        return PathPoint(state, bound, {}, steps=1), FixedPointHistory(converged=there)

    def follow(self, upper: float = np.inf, width: float = 1e-2, **options) -> LoadPath:
        loaded = self.loaded
        return follow_load(
            loaded.structure.problem,
            self.friction,  # type: ignore[arg-type]
            dead_state(loaded),
            loaded.scales,
            upper,
            width,
            options.pop("by_steps", False),
            **options,
        )


@pytest.fixture(scope="module")
def block() -> Loaded:
    return loaded_block(coulomb(0.3))


@pytest.mark.parametrize("raises", [True, False])
@pytest.mark.parametrize("limit", [0.01, 0.3, 7.0])
def test_made_up_limit(limit, raises, block):
    made = Made(block, lambda factor, _: factor <= limit, raises)
    path = made.follow()
    assert path.lower <= limit < path.upper
    assert path.upper - path.lower <= max(1e-2 * path.lower, 1e-5 * block.scales.load_factor)
    # The upper end was tried twice, the second time from the lower one.
    assert made.asked[-1] == path.upper
    assert made.asked.count(path.upper) == 2
    assert [step.load_factor for step in path.steps] == sorted(
        factor for factor in made.asked if factor <= limit
    )
    assert path.steps[0].load_factor == 0.0


def test_solver_is_told_what_it_starts_from(block):
    made = Made(block, lambda factor, _: factor <= 0.3)
    path = made.follow()
    assert made.warm == [False] + [True] * (len(made.asked) - 1)
    assert made.sizes[0] == block.scales
    live = block.structure.problem.live
    moved = live.dot(path.state.displacement) / np.abs(whole(live)).sum()
    usual = block.scales.displacement
    assert made.sizes[-1].displacement == pytest.approx(max(usual, moved), rel=1e-12)


@pytest.mark.parametrize("raises", [True, False])
def test_step_that_was_too_long_is_tried_again_from_close_by(raises, block):
    # Beyond 0.1 only states close by lead on, for once: the solver then finds its way.
    too_long: list[float] = []

    def found(factor: float, last: float) -> bool:
        if factor > 0.1 and not too_long:
            too_long.append(factor)
        if too_long and factor >= too_long[0] > last:
            return factor - last <= 1e-2 * factor
        return factor <= 1.0

    made = Made(block, found, raises)
    path = made.follow()
    assert len(too_long) == 1
    assert made.asked.count(too_long[0]) == 2
    assert too_long[0] in [step.load_factor for step in path.steps]
    assert path.lower <= 1.0 < path.upper <= 1.0 + 2e-2
    assert np.all(np.diff([step.load_factor for step in path.steps]) > 0.0)


def test_nothing_under_the_dead_load_is_an_error(block):
    for raises in (True, False):
        made = Made(block, lambda factor, _: False, raises)
        with pytest.raises(SolverError, match="dead load"):
            made.follow()
        assert made.asked == [0.0]


def test_nothing_but_the_dead_load(block):
    path = Made(block, lambda factor, _: factor == 0.0).follow()
    assert path.lower == 0.0 < path.upper <= 1e-5 * block.scales.load_factor
    assert [step.load_factor for step in path.steps] == [0.0]
    assert path.direction is None


def test_load_that_nothing_limits_is_not_followed_for_ever(block):
    made = Made(block, lambda factor, _: True)
    path = made.follow()
    assert path.upper == np.inf
    assert path.lower > LARGEST * block.scales.load_factor
    assert len(path.steps) == len(made.asked) < 40


@pytest.mark.parametrize("upper", [0.0, 1e-3, 0.3, 50.0])
def test_made_up_path_ends_at_the_upper_bound(upper, block):
    made = Made(block, lambda factor, _: True)
    path = made.follow(upper=upper)
    assert max(made.asked) <= upper
    assert path.upper == np.inf
    assert upper - path.lower <= max(1e-2 * path.lower, 1e-5 * block.scales.load_factor)


def test_monitor_is_told_every_state(block):
    told: list[LoadStep] = []
    path = Made(block, lambda factor, _: factor <= 0.3).follow(monitor=told.append)
    assert tuple(told) == path.steps


def test_made_up_states_move_the_origin_of_slip(block):
    problem = block.structure.problem
    try:
        path = Made(block, lambda factor, _: factor <= 0.3).follow(by_steps=True)
        _, slip = problem.joint_displacements(path.state.displacement)
        assert np.array_equal(problem.slip_origin, slip)
    finally:
        problem.slip_origin[:] = 0.0
