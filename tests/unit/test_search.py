"""How states are looked for: options, first works, several starts, rising loads, both ends."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from fenics_contact import (
    InputError,
    LimitLoad,
    Load,
    Scene,
    SolveOptions,
    SolverError,
    limit_load,
)
from fenics_contact.analysis.rigid_blocks import LimitBounds, RigidBlocks
from fenics_contact.analysis.coulomb import SETTLED, FixedPointStep
from fenics_contact.meshing import running_bond, wall
from fenics_contact.solvers.kkt import Scales
from fenics_contact.scene import CONTROLS, DIRECTIONS, METHODS, SLIPS, STATES
from fenics_contact.analysis.work_control import (
    FIRST_JOINT_WORK,
    FIRST_WORK,
    CollapseState,
    Search,
    first_work,
)
from tests.helpers import GRAVITY, STONE, Drawing, coulomb, mesh_of, on_ground, tresca
from tests.regression.scenes import wall_scene, wedge_scene

B, H = 0.4, 1.0
WEIGHT = STONE.density * GRAVITY * B * H

#: Starts of the search for the lowest of several states.
STARTS = ["dead load", "half of that", "no friction", "associative program", "monolithic"]


def block(friction: float, dead: Load | None = None, **options: str) -> Scene:
    dead = dead or Load((0.0, -GRAVITY))
    solve = SolveOptions(**options)
    return on_ground(wall([[1]], (B, H), 1), coulomb(friction), dead, solve=solve)


def bond(friction: float, **options: str) -> Scene:
    """Three courses whose blocks lean on each other in more than one way."""
    return on_ground(
        running_bond(2, 3, (0.4, 0.2), elements=1), coulomb(friction), solve=SolveOptions(**options)
    )


# ---- options


def allowed(control: str, slip: str, states: str) -> bool:
    if control == "work":
        return slip == "stress-free"
    return states == "first"


@pytest.mark.parametrize(
    ("control", "slip", "states"), list(itertools.product(CONTROLS, SLIPS, STATES))
)
def test_combinations_of_options(control, slip, states):
    for method, direction in itertools.product(METHODS, DIRECTIONS):
        options = {"control": control, "slip": slip, "states": states}
        options |= {"method": method, "direction": direction}
        if allowed(control, slip, states):
            assert SolveOptions(**options).control == control
            continue
        with pytest.raises(InputError) as caught:
            SolveOptions(**options)
        assert "needs control" in str(caught.value)


def test_options_left_out():
    options = SolveOptions()
    assert (options.method, options.direction) == ("auto", "positive")
    assert (options.control, options.slip, options.states) == ("work", "stress-free", "first")


@pytest.mark.parametrize("name", ["method", "direction", "control", "slip", "states"])
@pytest.mark.parametrize("wrong", ["", "Load", "load ", "newton"])
def test_unknown_options(name, wrong):
    with pytest.raises(InputError, match=f"{name} = '{wrong}' must be one of"):
        SolveOptions(**{name: wrong})


# ---- first work


def bounds(upper: float | None) -> LimitBounds:
    return LimitBounds(0.0, upper, stands=True, stands_frictionless=True)


@pytest.mark.parametrize("method", ["auto", "fixed-point", "monolithic"])
def test_first_work_of_interior_points_is_far_along_the_mode(method):
    def program():
        raise AssertionError("no program is needed")

    assert first_work(method, program, Scales(1.0, 1.0, 0.5)) == FIRST_WORK


@pytest.mark.parametrize("method", ["splitting", "active-set"])
@pytest.mark.parametrize(
    ("upper", "expected"),
    [(0.25, 0.5), (0.5, 1.0), (3.0, 1.0), (np.inf, 1.0), (None, 1.0), (1e-5, 1e-3), (0.0, 1e-3)],
)
def test_first_work_of_joint_forces_is_that_of_the_bound(method, upper, expected):
    found = first_work(method, lambda: bounds(upper), Scales(1.0, 1.0, 0.5))
    assert found == pytest.approx(expected * FIRST_JOINT_WORK, rel=1e-12)


# ---- several states


@pytest.fixture(scope="module")
def lowest() -> LimitLoad:
    return limit_load(bond(1.0, states="lowest"))


def test_lowest_of_several_states(lowest):
    # The courses roll off at 5/7; the state of the associative program slides, at the friction.
    found = {state.start: state for state in lowest.positive.states}
    assert lowest.status == "limit"
    assert list(found) == STARTS
    assert all(isinstance(state, CollapseState) for state in found.values())
    assert all(state.status == "limit" for state in found.values())
    assert lowest.load_factor == min(state.load_factor for state in found.values())
    assert lowest.load_factor == pytest.approx(5.0 / 7.0, rel=1e-6)
    assert found["associative program"].load_factor == pytest.approx(1.0, rel=1e-6)
    assert lowest.positive.certificate.passed


def test_first_state_is_that_of_the_dead_load(lowest):
    first = limit_load(bond(1.0))
    assert first.positive.states == ()
    # Both settle to this part of the tolerance, on ways that need not be the same.
    rel = SETTLED * first.scene.solve.tolerance
    assert first.load_factor == pytest.approx(lowest.positive.states[0].load_factor, rel=rel)


def test_all_states_lie_between_the_bounds(lowest):
    for state in lowest.positive.states:
        assert lowest.bounds.lower <= state.load_factor <= lowest.bounds.upper * (1.0 + 1e-6)


def test_states_of_both_directions():
    result = limit_load(block(0.3, states="lowest", direction="both"))
    for end in (result.positive, result.negative):
        assert [state.start for state in end.states] == STARTS
        # Load factors of a direction are positive within it.
        assert [state.load_factor for state in end.states] == pytest.approx([0.3] * 5, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(-0.3, rel=1e-6)


def test_given_friction_has_one_state():
    scene = on_ground(wall([[1]], (B, H), 1), tresca(2000.0), solve=SolveOptions(states="lowest"))
    result = limit_load(scene)
    assert result.positive.states == ()
    assert result.load_factor == pytest.approx(2000.0 * B / WEIGHT, rel=1e-6)


# ---- methods


def test_monolithic_from_the_start():
    result = limit_load(bond(1.0, method="monolithic"))
    history = result.positive.history
    assert result.status == "limit"
    assert [step.method for step in history] == ["monolithic"] * len(history)
    assert len(history[0].steps) == 1
    assert history[0].steps[0].change == 0.0
    # Another state than the one that the fixed point finds; it is one all the same.
    assert result.load_factor == pytest.approx(1.0, rel=1e-6)
    assert result.positive.certificate.passed


def test_growing_friction_meets_the_low_state():
    result = limit_load(bond(1.0))
    assert result.positive.history[0].method == "monolithic"
    assert len(result.positive.history[0].steps) == 1
    assert result.load_factor == pytest.approx(5.0 / 7.0, rel=1e-6)


def test_fixed_point_is_not_monolithic():
    result = limit_load(bond(1.0, method="fixed-point"))
    assert result.load_factor == pytest.approx(5.0 / 7.0, rel=1e-5)
    assert {history.method for history in result.positive.history} == {"fixed-point"}
    assert len(result.positive.history[0].steps) > 2


@pytest.mark.parametrize("control", ["work", "load"])
@pytest.mark.parametrize("method", METHODS)
def test_block_by_every_method(method, control):
    low = on_ground(
        wall([[1]], (B, B), 1),
        coulomb(0.3),
        solve=SolveOptions(method=method, control=control),
    )
    result = limit_load(low)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.3, rel=1e-6)
    assert (result.positive.splitting is None) == (method not in ("splitting", "active-set"))
    assert (result.positive.path is None) == (control == "work")


# ---- rising loads


@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize(("friction", "exact"), [(0.3, 0.3), (0.8, B / H)])
def test_block_under_a_rising_load(friction, exact, slip):
    result = limit_load(block(friction, control="load", slip=slip))
    path = result.positive.path
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(exact, rel=1e-6)
    assert exact * (1.0 - 2e-4) <= path.lower <= exact < path.upper
    assert [path.steps[0].load_factor, path.steps[-1].load_factor] == [0.0, path.lower]


@pytest.mark.parametrize("slip", SLIPS)
def test_wedge_that_locks_under_a_rising_load(slip):
    scene = wedge_scene(0.8)
    scene = Scene(
        scene.mesh,
        scene.materials,
        scene.live,
        scene.dead,
        scene.joints,
        scene.foundations,
        solve=SolveOptions(control="load", slip=slip),
    )
    result = limit_load(scene)
    assert (result.status, result.load_factor) == ("unbounded", np.inf)
    path = result.positive.path
    assert path.upper == np.inf
    assert path.lower > 100.0 and path.lower == path.steps[-1].load_factor


def test_pressed_block_has_no_path_without_friction():
    # That nothing limits the load is known from the programs.
    scene = on_ground(
        wall([[1]], (B, H), 1),
        tresca(1e3),
        live=Load((0.0, -GRAVITY)),
        solve=SolveOptions(control="load"),
    )
    result = limit_load(scene)
    assert (result.status, result.load_factor) == ("unbounded", np.inf)
    assert result.positive.path is None


@pytest.mark.parametrize("control", CONTROLS)
def test_both_ends_of_an_unsymmetric_scene(control):
    # A dead push to the right, 1000 Pa on the left side.
    push = 1000.0 * H / WEIGHT
    dead = Load((0.0, -GRAVITY), {"left": (1000.0, 0.0)})
    result = limit_load(block(0.3, dead, control=control, direction="both"))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.3 - push, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(-0.3 - push, rel=1e-6)
    if control == "load":
        # Within a direction the load factor rises.
        for end, exact in ((result.positive, 0.3 - push), (result.negative, 0.3 + push)):
            assert end.path.steps[0].load_factor == 0.0
            assert exact * (1.0 - 2e-4) <= end.path.lower <= exact * (1.0 + 1e-9)


@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_block_on_a_slope_that_needs_its_friction(direction, slip):
    angle = np.radians(10.0)
    drawing = Drawing.of(wall([[1]], (B, B), 1)).turned(-angle)
    scene = on_ground(
        drawing.model(),
        coulomb(0.3),
        live=Load((GRAVITY * np.cos(angle), -GRAVITY * np.sin(angle))),
        solve=SolveOptions(control="load", direction=direction, slip=slip),
    )
    result = limit_load(scene)
    assert result.status == "limit"
    if direction != "negative":
        down = 0.3 * np.cos(angle) - np.sin(angle)
        assert result.load_factor == pytest.approx(down, rel=1e-6)
    if direction != "positive":
        up = -0.3 * np.cos(angle) - np.sin(angle)
        assert result.load_factor_negative == pytest.approx(up, rel=1e-6)
    assert (result.positive is None) == (direction == "negative")


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_dead_load_that_does_not_stand(friction, direction):
    # 4000 Pa push the block off or over: half its weight.
    dead = Load((0.0, -GRAVITY), {"left": (4000.0, 0.0)})
    result = limit_load(block(friction, dead, control="load", direction=direction))
    assert result.status == "unstable"
    assert result.positive is None and result.negative is None
    assert np.isnan(result.load_factor) and np.isnan(result.load_factor_negative)


def test_one_block_on_a_fixed_one_under_a_rising_load():
    drawing = Drawing.of(wall([[2], [1]], (0.5, 0.2), 1))
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        live=Load((GRAVITY, 0.0)),
        dead=Load((0.0, -GRAVITY)),
        joints={"default": coulomb(0.3)},
        supports={"base": "fixed"},
        solve=SolveOptions(control="load"),
    )
    assert limit_load(scene).load_factor == pytest.approx(0.3, rel=1e-6)


class Told:
    """A monitor that keeps what it is told."""

    def __init__(self) -> None:
        self.steps: list[tuple[str, FixedPointStep]] = []
        self.points: list[int] = []

    def step(self, direction: str, step: FixedPointStep) -> None:
        self.steps.append((direction, step))

    def point(self, done: int, total: int, point: object) -> None:
        self.points.append(done)


@pytest.mark.parametrize("control", CONTROLS)
def test_monitor_is_told_the_steps_of_both_directions(control):
    told = Told()
    result = limit_load(block(0.3, control=control, direction="both"), told)
    for direction, end in (("positive", result.positive), ("negative", result.negative)):
        mine = [step for name, step in told.steps if name == direction]
        last = [step for history in end.history for step in history.steps]
        assert mine[-len(last) :] == last
        assert (len(mine) > len(last)) == (control == "load")


@pytest.mark.parametrize(
    ("before", "expected"),
    [([], 0.0), ([(4.0, 0.9)], 0.0), ([(1.0, 0.9)], 0.1), ([(0.5, 1.1)], 0.1 / 3.0)],
)
def test_rest_of_a_load_factor_that_falls_like_one_over_the_work(before, expected):
    """lambda = 1 +- c/T: what is missing at T = 2 follows from the state before."""
    search = SimpleNamespace(path=before, scales=Scales(1.0, 1.0, 0.0))
    assert Search._rest(search, 2.0, 1.0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("found", "best", "expected"),
    [
        ((1e-9, True), (1e-12, True), True),  # both small enough: the one at more work
        ((1e-7, True), (1e-6, True), True),
        ((1e-6, True), (1e-7, True), False),
        ((1e-12, False), (1e-6, True), False),  # digits lost
        ((1e-7, True), (1e-9, False), False),
        ((1e-7, False), (1e-6, False), True),
    ],
)
def test_state_to_be_reported(found, best, expected):
    def state(gap: float, verified: bool) -> SimpleNamespace:
        converged = SimpleNamespace(converged=True)
        return SimpleNamespace(gap=gap, verified=verified, history=converged)

    search = SimpleNamespace(gap_asked=1e-8)
    assert Search._better(search, state(*found), state(*best)) is expected


@pytest.mark.parametrize(
    ("gap", "verified", "nearly"),
    [(1e-7, True, True), (1.1e-7, True, False), (1e-9, False, False), (np.inf, True, False)],
)
def test_state_that_is_all_but_settled(gap, verified, nearly):
    search = SimpleNamespace(
        best=SimpleNamespace(gap=gap, verified=verified),
        gap_asked=2.5e-8,
        options=SolveOptions(tolerance=1e-6),
    )
    assert Search.nearly_settled.fget(search) is nearly
    search.best = None
    assert Search.nearly_settled.fget(search) is False


@pytest.mark.parametrize(("nearly", "tried"), [(True, [1.0]), (False, [1.0, 0.5, 0.25, 0.125])])
def test_more_work_for_a_state_that_is_all_but_settled_is_tried_once(nearly, tried):
    """Else in shorter and shorter strides, the first of them along the central path too."""
    works, afresh = [], []

    def at(ratio, start, bound, **how):
        works.append(ratio)
        afresh.append(how["afresh"])

    search = SimpleNamespace(
        part=1.0,
        kept=True,
        monolithic=True,
        past_folds=True,
        verified=True,
        nearly_settled=nearly,
        per_ratio=1.0,
        _stride=lambda _: 16.0,
        _moved=lambda *_: None,
        at=at,
    )
    last = SimpleNamespace(ratio=1.0, bound=None, history=SimpleNamespace(converged=True))
    assert Search._further(search, last) is None
    assert works == pytest.approx([16.0**part for part in tried])
    assert afresh == [not nearly] + [False] * (len(tried) - 1)


class Mode:
    """A mode by what its certificate says."""

    def __init__(self, gap: float, penetration: float) -> None:
        self.gap, self.penetration, self.destroyed = gap, penetration, False

    def destroy(self) -> None:
        self.destroyed = True


FOLLOWS, STAYS, FAR = Mode(2e-7, 1e-6), Mode(1e-7, 1e-6), Mode(1e-1, 0.9)
EXACT, NEAR, NONE = Mode(1e-9, 1e-7), Mode(1e-4, 1e-2), None
THROUGH = Mode(1e-9, 1e-3)


@pytest.mark.parametrize(
    ("modes", "tried", "taken"),
    [
        ((EXACT, STAYS), 1, EXACT),
        ((FOLLOWS, STAYS), 2, STAYS),  # the smaller gap
        ((STAYS, FOLLOWS), 2, STAYS),
        ((NEAR, EXACT), 2, EXACT),
        ((THROUGH, STAYS), 2, STAYS),  # one that is a mode, before one that is not
        ((STAYS, THROUGH), 2, STAYS),
        ((FAR, EXACT), 1, FAR),  # no hope: neither is unique
        ((NONE, STAYS), 2, STAYS),
        ((NONE, NONE), 2, NONE),
    ],
)
def test_better_of_two_modes(modes, tried, taken, monkeypatch):
    """That of a bound that follows comes first; where it proves enough, or nothing, it is all."""
    bounds, given = [], np.zeros(3)

    def rate(state, bound, scales):
        bounds.append(bound)
        mode = modes[len(bounds) - 1]
        if mode is None:
            raise SolverError("singular")
        mode.destroyed = False
        return mode, float(len(bounds))

    def certified(mode, limit):
        passed, residuals = mode.penetration < 1e-5, {"mode_penetration": mode.penetration}
        return SimpleNamespace(mode_passed=passed, gap=mode.gap, residuals=residuals)

    monkeypatch.setattr("fenics_contact.analysis.work_control.kinematic_factor", lambda *_: 1.0)
    search = SimpleNamespace(
        control=SimpleNamespace(rate=rate),
        problem=None,
        gap_asked=2.5e-8,
        _bounds=lambda _: [None, given],
    )
    point = SimpleNamespace(state=None)
    mode, slope, _ = Search._elastic_mode(search, point, None, certified)
    assert bounds == [None, given][:tried]
    assert mode is taken
    made = [one for one in modes[:tried] if one is not None]
    assert [one.destroyed for one in made] == [one is not taken for one in made]
    assert slope == (0.0 if taken is None else 1.0 + modes.index(taken))


@pytest.mark.parametrize(
    ("monolithic", "friction", "factored", "follows"),
    [
        (True, 0.5, False, [True, False]),
        (True, 0.5, True, [False, True]),  # those of the bound that stays are factored already
        (True, 0.0, False, [False]),
        (False, 0.5, False, [False]),
    ],
)
def test_bounds_of_modes(monolithic, friction, factored, follows):
    """A bound that follows is none; with given friction, or by the fixed point, it stays."""
    search = SimpleNamespace(
        monolithic=monolithic,
        problem=SimpleNamespace(max=np.max, friction=np.array([friction])),
        control=SimpleNamespace(linearised=lambda *_: factored),
    )
    point = SimpleNamespace(bound=np.ones(1), state=None)
    assert [bound is None for bound in Search._bounds(search, point)] == follows


@pytest.mark.parametrize("answer", ["fails", "nothing limits it", "certifies"])
def test_program_where_no_mode_is_near_enough(answer, monkeypatch):
    """One that fails leaves the mode's own bound; what one that ends says counts."""
    monkeypatch.setattr("fenics_contact.analysis.work_control.COLLAPSED", 0.0)
    monkeypatch.setattr("fenics_contact.analysis.work_control.LAST_WORK", 0.0)

    def collapse(self, strength):
        if answer == "fails":
            raise SolverError("no luck")
        return (np.inf, None) if answer == "nothing limits it" else original(self, strength)

    original = RigidBlocks.collapse
    monkeypatch.setattr(RigidBlocks, "collapse", collapse)
    monkeypatch.setattr("fenics_contact.analysis.work_control.DECREASES", 0)
    end = limit_load(wall_scene("W1", coulomb(0.65), elements=1)).positive
    assert end.status == ("not_converged" if answer == "nothing limits it" else "limit")
    if answer == "fails":
        assert end.certificate.static_factor == end.load_factor
        assert end.certificate.gap <= 1e-6
