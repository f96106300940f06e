"""The central path: products equal at every point, folds passed, and where it ends."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fenics_contact import SolverError, limit_load
from fenics_contact.central_path import AIMED, BACK, CHANGES, CLOSE, LOST, CentralPath, _Place
from fenics_contact.coulomb import CoulombFriction
from fenics_contact.interior_point import PathPoint, WorkControl
from fenics_contact.path_equations import Growth, Iterate, Scales, Workspace, _distance
from fenics_contact.search import FIRST_WORK, WORK_OF_MANY, first_work
from fenics_contact.springs import SpringStiffness
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
        now, products = path._moved(path._place(now, products, 0.0), 1.0, 0.0)
    part = 1.0 if growth is None else growth.part(products)
    assert (part < 1.0) == (growth is not None)
    bound = part * structure.problem.friction * now.pressure
    assert now.s1 + now.s2 == pytest.approx(2.0 * bound, rel=1e-12)
    assert path._left(now) < 1e-8
    here = path._place(now, products, 0.0)
    left = []
    for turn in (-1e-2, -1e-3):
        moved, _ = path._moved(here, 1.0, turn)
        left.append(path._left(moved))
    assert left[0] < 1e-3
    assert left[1] < 0.02 * left[0]


def test_step_that_led_away_is_taken_back_and_shortened(folded, monkeypatch):
    """The next one starts from the same point, on the same factor."""
    steps: list[tuple[Iterate, float, float]] = []
    places: list[float] = []
    place, step = CentralPath._place, CentralPath._step

    def counted(self, *args):
        here = place(self, *args)
        places.append(here.across)
        return here

    def noted(self, here, length):
        steps.append((here.iterate, here.across, length))
        return step(self, here, length)

    monkeypatch.setattr(CentralPath, "_place", counted)
    monkeypatch.setattr(CentralPath, "_step", noted)
    monkeypatch.setattr("fenics_contact.central_path.NEAR", 1.0)
    monkeypatch.setattr("fenics_contact.central_path.AIMED", 0.4)
    path, now = path_of(folded)
    _, products = path.follow(now, 1.0, 1e-4)
    assert products <= 1e-4
    assert len(places) == len(steps)
    again = [
        (first[2], second[2])
        for first, second in itertools.pairwise(steps)
        if second[0] is first[0]
    ]
    away = [led for led, taken in zip(places, steps, strict=True) if led != taken[1]]
    assert len(again) == len(away) > 0
    assert min(away) > 1.0
    assert all(0.25 * before <= after < before for before, after in again)


def test_path_that_is_never_near_is_lost(plain, monkeypatch):
    monkeypatch.setattr("fenics_contact.central_path.NEAR", -1.0)
    path, now = path_of(plain)
    before = plain.structure.springs.factorizations
    with pytest.raises(SolverError, match=f"lost after {LOST + 1} steps"):
        path.follow(now, 1.0, 1e-4)
    assert plain.structure.springs.factorizations - before == LOST + 1


@pytest.mark.parametrize(
    ("across", "change"), [(AIMED, 1.0), (4.0 * AIMED, 0.5), (1e3, CHANGES[0]), (0.0, CHANGES[1])]
)
def test_length_that_leads_as_near_as_aimed_at(across, change):
    place = _Place(None, 1.0, None, None, 0.0, across, 1.0, -1.0, 0.0)  # type: ignore[arg-type]
    assert place.change_of_length == pytest.approx(change)


def test_growth_of_friction():
    growth = Growth(1e-3, 0.5)
    assert growth.part(1e-1) == pytest.approx(0.1)
    assert growth.part(1e-4) == 1.0
    step = 1e-6
    slope = (growth.part(1e-1 * (1.0 + step)) / growth.part(1e-1) - 1.0) / step
    assert growth.rate(1e-1) == pytest.approx(slope, rel=1e-5)
    assert growth.rate(1e-4) == 0.0


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
    monkeypatch.setattr("fenics_contact.central_path.MAX_STEPS", 2)
    path, now = path_of(plain)
    _, products = path.follow(now, 1.0, 1e-4)
    assert products > 1e-4
    with pytest.raises(SolverError, match="after all steps"):
        solved(plain, "follow")


def test_interior_point_method_is_tried_again_where_the_path_leads_nowhere(plain, monkeypatch):
    """It was too impatient the first time."""
    monkeypatch.setattr("fenics_contact.central_path.MAX_STEPS", 0)
    monkeypatch.setattr("fenics_contact.interior_point.FOLD_STEPS", 1)
    point = solved(plain, "solve", past_folds=True)
    assert not point.followed
    assert point.state.load_factor == solved(plain, "solve").state.load_factor


@pytest.mark.parametrize("products", [1.0, 1e-6, 1e-12])
def test_distance_of_shear_from_its_bound(products):
    gamma, q = (array.ravel() for array in np.meshgrid([1e-6, 1e-2, 1.0, 50.0], [0.0, 1e-3, 1, 9]))
    s = _distance(q, gamma, products)
    assert np.all(s > 0.0) and np.all(s <= gamma)
    left = s - products / s + products / (2.0 * gamma - s)
    size = products / s + gamma + q
    assert (gamma - q - left) / size == pytest.approx(np.zeros_like(s), abs=1e-12)


@pytest.mark.parametrize(("method", "many"), [("auto", True), ("fixed-point", False)])
def test_many_blocks_start_further_along(method, many):
    def never() -> None:
        raise AssertionError("no bound is needed")

    scales = Scales(1.0, 1.0, 0.5)
    expected = WORK_OF_MANY * 201**2 if many else FIRST_WORK
    assert first_work(method, never, scales, 201) == expected > FIRST_WORK * (2 if many else 0.5)
    assert first_work(method, never, scales, 200) == FIRST_WORK


def test_many_blocks_try_less_work_before_the_fixed_point(monkeypatch):
    """Here a wall of few blocks that counts as one of many, and whose first path leads nowhere."""
    monkeypatch.setattr("fenics_contact.search.MANY_BLOCKS", 10)
    monkeypatch.setattr("fenics_contact.search.WORK_OF_MANY", 1e4 / 33**2)
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
    monkeypatch.setattr("fenics_contact.search.MANY_BLOCKS", 10)
    monkeypatch.setattr("fenics_contact.search.WORK_OF_MANY", 1e4 / 33**2)
    tried, from_modes = [], []

    def fails(self, start, work, centring, *rest, **options):
        tried.append(centring)

    def follow(*_, modes=False):
        if modes:
            from_modes.append(1)

    monkeypatch.setattr(CoulombFriction, "_monolithic", fails)
    monkeypatch.setattr(CoulombFriction, "_follow", follow)
    result = limit_load(wall_scene("W1", coulomb(0.4), elements=1))
    assert result.positive.history[0].method == "fixed-point"
    assert [centring for centring in tried if centring == 1.0] == [1.0, 1.0]
    assert len(from_modes) == 2
