"""The central path: products equal at every point, folds passed, and where it ends."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fenics_contact import SolverError, limit_load
from fenics_contact.solvers.arclength import BACK, CLOSE, LOST, MEETINGS, SHORTER, CentralPath, _meets
from fenics_contact.analysis.coulomb import CoulombFriction
from fenics_contact.solvers.nonlinear_elimination import LEFT, FewPoints
from fenics_contact.solvers.interior_point import PathPoint, WorkControl
from fenics_contact.solvers.kkt import Iterate, Scales, Workspace
from fenics_contact.analysis.work_control import FIRST_WORK, first_work
from fenics_contact.solvers.smoothing import Growth
from fenics_contact.solvers.joint_stiffness import SpringStiffness
from tests.helpers import Loaded, coulomb
from tests.regression.scenes import wall_scene


@pytest.fixture(scope="module")
def folded() -> Loaded:
    """A wall with so much friction that its path turns back."""
    return Loaded.of(wall_scene("W1", coulomb(1.0), elements=2))


@pytest.fixture(scope="module")
def plain() -> Loaded:
    """A wall whose path has no folds."""
    return Loaded.of(wall_scene("W4", coulomb(0.4), elements=1))


def path_of(loaded: Loaded, ratio: float = FIRST_WORK) -> tuple[CentralPath, Iterate]:
    """Path equations, and their centred start."""
    structure = loaded.structure
    start, scales = loaded.start(ratio)
    workspace = Workspace(structure.problem)
    path = CentralPath(structure.problem, structure.springs, workspace, None, start.work, scales)
    return path, path.centred(start, 1.0)


def solved(loaded: Loaded, way: str, **options: object) -> PathPoint:
    start, scales = loaded.start(FIRST_WORK)
    control = WorkControl(loaded.structure.problem, loaded.structure.springs)
    if way == "follow":
        return control.follow(start.work, start, scales, 1e-9, 1e-9)
    return control.solve(None, start.work, start, scales, tolerance=1e-9, settled=1e-9, **options)


def test_all_products_are_equal_along_the_path(plain):
    path, now = path_of(plain)
    now, products = path.follow(now, 1.0, 1e-4)
    assert 1e-6 < products <= 1e-4
    mu = products * path.unit
    for first, second in (("y", "pressure"), ("s1", "z1"), ("s2", "z2")):
        product = getattr(now, first) * getattr(now, second)
        assert product == pytest.approx(np.full_like(product, mu), rel=1e-9)
    assert now.s1 + now.s2 == pytest.approx(2.0 * path.friction * now.pressure, rel=1e-12)
    residual = path.residual(now)
    d, f = path.scales.displacement, path.scales.force
    assert np.all(np.abs(residual.opening) / d <= CLOSE * (now.pressure / f + now.y / d))
    assert residual.work == pytest.approx(0.0, abs=1e-9 * path.work)


@pytest.mark.parametrize("growth", [None, Growth(1e-5, 0.2)])
def test_tangent_leaves_the_path_with_the_square_of_the_step(plain, growth):
    """Also where friction grows along the path, which is part of its derivative."""
    structure = plain.structure
    start, scales = plain.start(FIRST_WORK)
    workspace = Workspace(structure.problem)
    path = CentralPath(
        structure.problem, structure.springs, workspace, None, start.work, scales, growth=growth
    )
    now, products = path.follow(path.start(start, 1.0), 1.0, 1e-2)
    for _ in range(6):
        step = FewPoints(path, path.place(now, products)).follow(1e-9, along=False)
        now, products = step.iterate, step.products
    part = 1.0 if growth is None else growth.part(products)
    assert (part < 1.0) == (growth is not None)
    bound = part * structure.problem.friction * now.pressure
    assert now.s1 + now.s2 == pytest.approx(2.0 * bound, rel=1e-12)
    assert path._left(now) < 1e-8
    few = FewPoints(path, path.place(now, products))
    left = [few.problem.max(few._distances(1.0, turn)) for turn in (-1e-2, -1e-3)]
    assert left[0] < 1e-3
    assert left[1] < 0.02 * left[0]


def test_path_that_is_never_reached_is_lost(plain, monkeypatch):
    follow = FewPoints.follow

    def astray(self, end, along=True, limit=LEFT):
        return replace(follow(self, self.place.products, along=False), reached=False)

    monkeypatch.setattr(FewPoints, "follow", astray)
    path, now = path_of(plain)
    before = plain.structure.springs.factorizations
    with pytest.raises(SolverError, match=f"lost after {LOST + 1} steps"):
        path.follow(now, 1.0, 1e-4)
    assert plain.structure.springs.factorizations - before == LOST + 1


def test_step_that_led_too_far_is_taken_back(plain, monkeypatch):
    """From the next place the path is not reached: the step to it is made again, less far."""
    follow, again = FewPoints.follow, FewPoints.again
    limits, steps, left = [], [], []

    def bad_third(self, end, along=True, limit=LEFT):
        steps.append(follow(self, end, along, limit))
        left.append(path._left(steps[-1].iterate))
        return replace(steps[-1], reached=len(steps) != 3)

    def counted(self, end, limit):
        limits.append(limit)
        shorter = again(self, end, limit)
        assert steps[1].products <= shorter.products <= self.place.products
        assert path._left(shorter.iterate) < min(1.2 * limit, left[1])
        return shorter

    monkeypatch.setattr(FewPoints, "follow", bad_third)
    monkeypatch.setattr(FewPoints, "again", counted)
    path, now = path_of(plain)
    now, products = path.follow(now, 1.0, 1e-4)
    assert limits == [SHORTER * LEFT]
    assert products <= 1e-4
    assert path._left(now) <= CLOSE


def test_step_that_leads_to_where_the_last_one_began_is_taken_back(plain, monkeypatch):
    """It went there and back for ever; the next one from there is made again, less far."""
    follow, again = FewPoints.follow, FewPoints.again
    limits, steps = [], []

    def third_goes_back(self, end, along=True, limit=LEFT):
        steps.append(follow(self, end, along, limit))
        if len(steps) != 3:
            return steps[-1]
        assert path._leads_back(self.place.iterate, path._trusted.place.iterate)
        assert not path._leads_back(self.place.iterate, steps[-1].iterate)
        return replace(steps[-1], iterate=path._trusted.place.iterate.copy())

    def counted(self, end, limit):
        limits.append(limit)
        return again(self, end, limit)

    monkeypatch.setattr(FewPoints, "follow", third_goes_back)
    monkeypatch.setattr(FewPoints, "again", counted)
    path, now = path_of(plain)
    assert not path._leads_back(now, now)  # nothing is known before the first step
    now, products = path.follow(now, 1.0, 1e-4)
    assert limits == [SHORTER * LEFT]
    assert products <= 1e-4
    assert path._left(now) <= CLOSE


@pytest.mark.parametrize(
    ("load_factor", "products", "meets"),
    [
        (0.5, 1e-3, True),
        (0.5 * (1.0 + 1e-7), 1.005e-3, True),
        (0.5 * (1.0 + 1e-6), 1e-3, False),
        (0.5, 1.02e-3, False),
        (0.4, 1e-4, False),  # has not left: a path may stand all but still for a while
        (0.4 * (1.0 - 1e-6), 1e-4, False),
    ],
)
def test_place_where_the_path_was_before(load_factor, products, meets):
    places = [(0.6, 1e-2), (0.5, 1e-3), (0.4, 1e-4), (0.4 * (1.0 - 1e-6), 1e-4)]
    assert _meets(places, load_factor, products) is meets
    assert not _meets(places[:2], load_factor, products)
    assert not _meets([], load_factor, products)


def test_path_that_leads_in_a_circle(plain, monkeypatch):
    """A path that met itself a few times is left; at its end corrections may meet."""
    monkeypatch.setattr("fenics_contact.solvers.arclength._meets", lambda *_: True)
    path, now = path_of(plain)
    end, products = path.follow(now.copy(), 1.0, 0.9)
    assert products <= 0.9
    assert path._left(end) <= CLOSE
    with pytest.raises(SolverError, match=f"in a circle after {MEETINGS} steps"):
        path.follow(now, 1.0, 1e-4)


@pytest.mark.parametrize("patience", [1, 2, 3, 20])
def test_path_that_wanders(plain, monkeypatch, patience):
    """It is left where its smallest products do not halve in so many steps, but at its end."""
    path, now = path_of(plain)
    original, along = path._step, []

    def noted(*args):
        step = original(*args)
        along.append(step.products)
        return step

    monkeypatch.setattr(path, "_step", noted)
    path.follow(now.copy(), 1.0, 1e-4)
    path.forget()
    smallest, halved, waited = 1.0, 0, []
    for step, (before, after) in enumerate(pairwise([1.0, *along])):
        if after <= 0.5 * smallest:
            smallest, halved = after, step
        waited.append(step - halved if before > 1e-4 else 0)
    late = np.flatnonzero(np.array(waited) >= patience)
    if len(late):
        with pytest.raises(SolverError, match=f"wanders, after {late[0] + 1} steps"):
            path.follow(now, 1.0, 1e-4, patience=patience)
    else:
        assert patience > max(waited) > 0
        assert path.follow(now, 1.0, 1e-4, patience=patience)[1] <= 1e-4


def test_way_along_the_path_takes_no_solves_for_digits(plain, monkeypatch):
    monkeypatch.setattr("fenics_contact.solvers.kkt.CANCELLING", 0.0)
    monkeypatch.setattr(SpringStiffness, "solve_transposed", None)
    path, now = path_of(plain)
    assert path.follow(now, 1.0, 1e-4)[1] <= 1e-4
    with pytest.raises(TypeError):
        solved(plain, "solve")


def test_path_without_folds_ends_where_the_interior_point_method_does(plain):
    direct, followed = solved(plain, "solve"), solved(plain, "follow")
    assert not direct.followed and followed.followed
    assert followed.state.load_factor == pytest.approx(direct.state.load_factor, rel=1e-8)
    assert max(followed.residuals.values()) <= 1e-9


def test_interior_point_method_stalls_at_a_fold_that_the_path_passes(folded):
    with pytest.raises(SolverError, match="interior point: residual"):
        solved(folded, "solve")
    before = folded.structure.springs.factorizations
    point = solved(folded, "solve", past_folds=True)
    assert point.followed
    assert point.steps <= folded.structure.springs.factorizations - before
    assert max(point.residuals.values()) <= 1e-9
    assert point.state.load_factor == pytest.approx(0.645963, abs=1e-6)
    assert solved(folded, "follow").state.load_factor == pytest.approx(0.645963, abs=1e-6)


def test_limit_load_past_folds_is_verified():
    result = limit_load(wall_scene("W1", coulomb(1.0), elements=2))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.645963, abs=1e-6)
    assert result.positive.certificate.passed
    assert len(result.positive.history[0].steps) == 1


def test_products_rise_where_the_determinant_is_negative(plain, monkeypatch):
    path, now = path_of(plain)
    monkeypatch.setattr(SpringStiffness, "determinant_sign", property(lambda _: -1.0))
    with pytest.raises(SolverError, match="leads back"):
        path.follow(now, 0.5 * BACK, 1e-4)


def test_path_that_does_not_end(plain, monkeypatch):
    monkeypatch.setattr("fenics_contact.solvers.arclength.MAX_STEPS", 2)
    path, now = path_of(plain)
    _, products = path.follow(now, 1.0, 1e-4)
    assert products > 1e-4
    with pytest.raises(SolverError, match="after all steps"):
        solved(plain, "follow")


def test_interior_point_method_is_tried_again_where_the_path_leads_nowhere(plain, monkeypatch):
    """It was too impatient the first time."""
    monkeypatch.setattr("fenics_contact.solvers.arclength.MAX_STEPS", 0)
    monkeypatch.setattr("fenics_contact.solvers.interior_point.FOLD_STEPS", 1)
    point = solved(plain, "solve", past_folds=True)
    assert not point.followed
    assert point.state.load_factor == solved(plain, "solve").state.load_factor


@pytest.mark.parametrize(
    ("method", "blocks", "expected"),
    [
        ("auto", 100, FIRST_WORK),
        ("auto", 101, 5e-4 * 101**3),
        ("auto", 399, 5e-4 * 399**3),
        ("auto", 5000, 2.0 * 5000**2),
        ("fixed-point", 1000, FIRST_WORK),
    ],
)
def test_many_blocks_start_further_along(method, blocks, expected):
    def never() -> None:
        raise AssertionError("no bound is needed")

    first = first_work(method, never, Scales(1.0, 1.0, 0.5), blocks)
    assert first == pytest.approx(expected)
    assert first >= FIRST_WORK


def test_many_blocks_try_less_work_before_the_fixed_point(monkeypatch):
    """Here a wall of few blocks that counts as one of many, and whose first path leads nowhere."""
    monkeypatch.setattr("fenics_contact.analysis.work_control.FEW_BLOCKS", 0)
    monkeypatch.setattr("fenics_contact.analysis.work_control.WORK_OF_MANY", (np.inf, 1e4 / 33**2))
    tried = []

    def failing_first(original):
        def solve(self, start, work, *rest, **options):
            tried.append(work)
            return None if work == tried[0] else original(self, start, work, *rest, **options)

        return solve

    for name in ("_follow", "_monolithic"):
        original = getattr(CoulombFriction, name)
        monkeypatch.setattr(CoulombFriction, name, failing_first(original))
    monkeypatch.setattr(CoulombFriction, "_given_friction", None)
    result = limit_load(wall_scene("W1", coulomb(0.4), elements=1))
    assert result.status == "limit"
    assert tried[1] == tried[0]
    assert tried[2] == pytest.approx(0.1 * tried[0])
    assert result.positive.work_ratio >= 1e3 * (1.0 - 1e-12)


def test_many_blocks_try_no_path_twice(monkeypatch):
    """Two attempts from the modes and with the bound in the equations, then the fixed point."""
    monkeypatch.setattr("fenics_contact.analysis.work_control.FEW_BLOCKS", 0)
    monkeypatch.setattr("fenics_contact.analysis.work_control.WORK_OF_MANY", (np.inf, 1e4 / 33**2))
    tried, from_modes = [], []

    def fails(self, start, work, centring, *rest, **options):
        tried.append(centring)

    def follow(*asked):
        if asked[-1] == "from_modes":
            from_modes.append(1)

    monkeypatch.setattr(CoulombFriction, "_monolithic", fails)
    monkeypatch.setattr(CoulombFriction, "_follow", follow)
    result = limit_load(wall_scene("W1", coulomb(0.4), elements=1))
    assert result.positive.history[0].method == "fixed-point"
    assert [centring for centring in tried if centring == 1.0] == [1.0, 1.0]
    assert len(from_modes) == 2
