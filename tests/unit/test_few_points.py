"""Steps of the central path on which few joint points follow their laws, the others tangents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.solvers.arclength import CentralPath, Place
from fenics_contact.solvers.nonlinear_elimination import BACK, LEFT, MOST, PART, SOLVED, TURN, Course, FewPoints
from fenics_contact.solvers.kkt import Iterate, Workspace
from fenics_contact.analysis.work_control import FIRST_WORK
from tests.helpers import Loaded, coulomb
from tests.regression.scenes import wall_scene

#: Products at which the tests' steps begin.
BEGIN = 1e-3


@pytest.fixture(scope="module")
def stiff() -> Loaded:
    """A wall with so much friction that its path turns back."""
    return Loaded.of(wall_scene("W1", coulomb(1.0), elements=2))


@pytest.fixture(scope="module", params=[0.0, 0.3], ids=["stiff", "giving"])
def loaded(stiff, request) -> Loaded:
    """The same; its joint points may give."""
    problem, (_, scales) = stiff.structure.problem, stiff.start(FIRST_WORK)
    unit = scales.displacement / scales.force
    give = request.param * unit * np.linspace(0.5, 1.0, 2 * len(problem.friction)).reshape(2, -1)
    return replace(stiff, structure=replace(stiff.structure, problem=replace(problem, give=give)))


def path_of(loaded: Loaded) -> tuple[CentralPath, Iterate]:
    """The path, and its first point."""
    structure = loaded.structure
    start, scales = loaded.start(FIRST_WORK)
    workspace = Workspace(structure.problem)
    path = CentralPath(structure.problem, structure.springs, workspace, None, start.work, scales)
    return path, path.centred(start, 1.0)


def place_of(loaded: Loaded) -> tuple[CentralPath, Place]:
    """The path, and a place some way down."""
    path, now = path_of(loaded)
    now, products = path.follow(now, 1.0, BEGIN)
    return path, path.place(now, products)


def chosen_of(few: FewPoints, count: int = 4) -> None:
    """Choose some points."""
    few._answer(np.stack([np.zeros(count, dtype=int), 3 * np.arange(count)], axis=1))


def test_answers_are_displacements_for_unit_forces_that_do_no_work_on_the_live_load(loaded):
    path, place = place_of(loaded)
    few = FewPoints(path, place)
    chosen_of(few)
    d, f = path.scales.displacement, path.scales.force
    problem, none = path.problem, np.zeros(len(few._others))
    right, u = problem.dead.duplicate(), problem.dead.duplicate()
    unit = np.eye(len(none))
    for row, forces in {4: (unit[6], none), 3: (none, unit[3])}.items():
        right.set(0.0)
        path.add_joint_forces(right, *(f * force for force in forces))
        path.springs.solve(right, u)
        path.hold_work(u)
        assert problem.live.dot(u) == pytest.approx(0.0, abs=1e-9 * u.norm() * problem.live.norm())
        opening, slip = path.joint_displacements(u)
        size = max(np.abs(opening).max(), np.abs(slip).max())
        assert few._answers[0, row] * d == pytest.approx(opening, abs=1e-8 * size)
        assert few._answers[1, row] * d == pytest.approx(slip, abs=1e-8 * size)


def test_slopes_are_those_of_differences(loaded):
    path, place = place_of(loaded)
    few = FewPoints(path, place)
    chosen_of(few)
    equations = few._equations()
    x = equations.start
    x[:-2] *= 1.01
    x[PART], x[TURN] = 0.4, -0.1
    here = equations.at(x)
    force_slopes = np.array([here.force_slope(row) for row in np.eye(len(here.forces))])
    for k in range(len(x)):
        h = np.zeros_like(x)
        h[k] = 1e-6 * max(abs(x[k]), 1e-3)
        ahead, behind = equations.at(x + h), equations.at(x - h)
        step = 2.0 * h[k]
        for found, of in ((here.slopes, "rest"), (force_slopes, "forces")):
            slope = (getattr(ahead, of) - getattr(behind, of)) / step
            size = np.abs(found).max()
            assert found[:, k] == pytest.approx(slope, rel=1e-4, abs=1e-6 * size)


def test_start_solves_the_equations_without_forces(loaded):
    path, place = place_of(loaded)
    few = FewPoints(path, place)
    chosen_of(few)
    equations = few._equations()
    start = equations.at(equations.start)
    assert start.left < 1e-9
    assert np.abs(start.forces).max() < 1e-9
    tangents = few.linear.at(few._chosen[:, 1])
    assert np.array_equal(equations.linear.start, tangents.start)
    assert np.array_equal(equations.linear.springs, tangents.springs)
    assert equations.turned(start, start) == 1.0


@pytest.mark.parametrize("solved", [SOLVED, 1e-6])
def test_chosen_points_follow_their_laws_and_the_others_nearly(loaded, solved, monkeypatch):
    path, place = place_of(loaded)
    monkeypatch.setattr("fenics_contact.solvers.nonlinear_elimination.SOLVED", solved)
    few = FewPoints(path, place)
    step = few.follow(1e-9)
    new, products = step.iterate, step.products
    assert step.reached
    assert products < place.products
    assert 0 < len(few._chosen) <= MOST
    mu = products * path.unit
    assert new.y * new.pressure == pytest.approx(np.full_like(new.y, mu), rel=1e-9)
    residual = path.residual(new)
    size_p, size_q = path._sizes(new)
    d = path.scales.displacement
    opening, slip = np.abs(residual.opening) / d / size_p, np.abs(residual.slip) / d / size_q
    points = few._chosen[:, 1]
    # The last of Newton's steps is one of the first that are good enough, or far better.
    left = solved if solved == SOLVED else 0.1 * solved
    assert max(opening[points].max(), slip[points].max()) <= left
    assert max(opening.max(), slip.max()) <= LEFT * (1.0 + 1e-6)
    assert residual.work == pytest.approx(0.0, abs=1e-9 * path.work)
    # Nothing is out of balance but what forces changed by when all points were put on their laws,
    # with the same p and q.
    f = path.scales.force
    normal, shear = (
        missed / d * f / (1.0 - give * f / d)
        for missed, give in zip((residual.opening, residual.slip), path.problem.give, strict=True)
    )
    path.add_joint_forces(residual.equilibrium, normal, np.where(path.sticky, shear, 0.0))
    assert residual.equilibrium.norm() / f < 0.01 * solved


def test_step_without_chosen_points_is_one_along_tangents(loaded, monkeypatch):
    monkeypatch.setattr("fenics_contact.solvers.nonlinear_elimination.FIRST", 0)
    monkeypatch.setattr("fenics_contact.solvers.nonlinear_elimination.MOST", 0)
    path, place = place_of(loaded)
    before, along, across = place.iterate.load_factor, place.tangent, place.to_path
    few = FewPoints(path, place)
    step = few.follow(1e-9)
    assert len(few._chosen) == 0
    assert step.reached
    turn = np.log(step.products / place.products)
    expected = before + across.load_factor + turn * along.load_factor
    assert step.iterate.load_factor == pytest.approx(expected, rel=1e-12)


def test_step_made_again_is_less_far(loaded):
    path, place = place_of(loaded)
    few = FewPoints(path, place)
    far = few.follow(1e-9)
    solved = path.springs.factorizations
    path.place(far.iterate, far.products)  # another factor
    limit = 0.2 * LEFT
    near = few.again(1e-9, limit)
    assert path.springs.factorizations == solved + 2  # once more where it began
    assert near.reached
    assert far.products < near.products < place.products
    assert path._left(near.iterate) <= limit * (1.0 + 1e-6)
    same = few.again(1e-9, LEFT)
    assert same.products == pytest.approx(far.products, rel=1e-9)
    assert same.iterate.load_factor == pytest.approx(far.iterate.load_factor, rel=1e-12)
    assert same.iterate.pressure == pytest.approx(far.iterate.pressure, rel=1e-6)
    few.destroy()


def test_more_points_go_on_from_where_the_first_led(stiff):
    path, place = place_of(stiff)
    few = FewPoints(path, place)
    few._answer(few._choose(True))
    first = few._equations()
    across = few._curve(Course.ACROSS, first)
    reached = few._trace(across, across.begin, across.fixed, (BACK, 1.0), LEFT)
    assert reached.complete
    curve = few._curve(Course.ALONG, first, reached.last)
    traced = few._trace(curve, reached.last, -curve.fixed, few._reach(few.back, 1e-9), LEFT)
    assert traced.stopped is not None
    assert traced.turn < few.back
    tangents = few._of(slice(None)).values(1.0, traced.turn, traced.last.forces)
    new = few._worst(few._distances_on(traced.stopped), 5)
    assert len(new)
    few._answer(new)
    more = few._equations()
    x = more.continued(traced.last)
    p, q = np.split(x[:-2], 2)
    count = len(p) - len(new)
    assert np.array_equal(np.split(traced.last.x[:-2], 2), [p[:count], q[:count]])
    y, r, w, shear = tangents[:, new[:, 1]]
    assert p[count:] == pytest.approx(r - y, rel=1e-9)
    assert q[count:] == pytest.approx(shear - w, rel=1e-9)
    curve, here, forward = few._gone_on(more, Course.ALONG, traced)
    assert here.left <= SOLVED
    assert here.x[[PART, TURN]] == pytest.approx([1.0, traced.turn], rel=1e-12)
    further = few._trace(curve, here, forward, few._reach(few.back, 1e-9), LEFT)
    assert further.turn < traced.turn


def test_points_far_from_their_laws_are_chosen_first(loaded):
    path, place = place_of(loaded)
    few = FewPoints(path, place)
    errors = np.linspace(0.0, 1.0, len(few._others))
    worst = few._worst(errors, 3)
    assert worst[:, 1].tolist() == [len(errors) - k for k in (1, 2, 3)]
    chosen_of(few)
    few._others[:] = True
    few._others[worst[0, 1]] = False
    assert few._worst(errors, 1)[0, 1] == len(errors) - 2
    assert len(few._worst(0.0 * errors, 3)) == 0
    assert len(few._worst(errors, 0)) == 0


def test_path_ends_where_it_is_to_end(loaded):
    path, now = path_of(loaded)
    end = 1e-2
    _, products = path.follow(now, 1.0, end)
    assert 0.3 * end < products <= end


def test_chosen_points_save_factorisations(stiff, monkeypatch):
    """Past several folds: the same path with them and along tangents alone."""

    def followed() -> int:
        path, now = path_of(stiff)
        before = path.springs.factorizations
        path.follow(now, 1.0, 1e-6)[0].destroy()
        return path.springs.factorizations - before

    few = followed()
    monkeypatch.setattr("fenics_contact.solvers.nonlinear_elimination.FIRST", 0)
    monkeypatch.setattr("fenics_contact.solvers.nonlinear_elimination.MOST", 0)
    assert 0 < few < 0.5 * followed()


def test_of_two_ways_that_end_short_of_the_path_the_one_that_leads_further_is_taken(
    loaded, monkeypatch
):
    path, place = place_of(loaded)
    original, reached = FewPoints._trace, {}

    def short(self, curve, here, forward, reach, limit):
        """Up to a part of the way only, and at the same products not even that."""
        ends = {Course.ACROSS: 0.4, Course.LEVEL: 0.1}
        traced = original(self, curve, here, forward, (BACK, ends[curve.course]), limit)
        reached[curve.course] = traced.furthest
        return replace(traced, complete=False, stopped=None)

    monkeypatch.setattr(FewPoints, "_trace", short)
    few = FewPoints(path, place)
    step = few.follow(1e-9)
    across, level = reached[Course.ACROSS], reached[Course.LEVEL]
    assert across.x[PART] > level.x[PART]
    assert not step.reached
    assert step.products == pytest.approx(place.products * np.exp(across.x[TURN]), rel=1e-12)


@pytest.mark.parametrize("noticed", [0.0, 10.0], ids=["all", "none"])
def test_points_that_were_not_watched_are_found_where_a_curve_ends(loaded, noticed, monkeypatch):
    """No point ends further from its law than the limit, however few are watched at first."""
    monkeypatch.setattr("fenics_contact.solvers.nonlinear_elimination.NOTICED", noticed)
    path, place = place_of(loaded)
    few, traced = FewPoints(path, place), []
    original = FewPoints._watching

    def watching(self, *curve):
        traced.append(int(self._watched.sum()))
        return original(self, *curve)

    monkeypatch.setattr(FewPoints, "_watching", watching)
    few._answer(few._choose(True))
    across = few._curve(Course.ACROSS, few._equations())
    found = few._trace(across, across.begin, across.fixed, (BACK, 1.0), LEFT)
    curve = few._curve(Course.ALONG, across.equations, found.last)
    traced.clear()
    found = few._trace(curve, found.last, -curve.fixed, few._reach(few.back, 1e-9), LEFT)
    distances = few._distances_on(found.last)
    assert 0.0 < distances[few._others].max() <= LEFT
    if noticed:
        assert traced[0] == 0 < traced[-1] < len(distances)
    else:
        assert traced == [np.count_nonzero(few._watched)]


def test_a_curve_is_not_followed_again_for_points_that_were_watched(stiff, monkeypatch):
    """Rounding may put one of them beyond the limit where all are looked at."""
    path, place = place_of(stiff)
    few, traced = FewPoints(path, place), []
    original = FewPoints._watching

    def watching(self, *curve):
        assert not traced
        traced.append(original(self, *curve))
        return traced[0]

    few._answer(few._choose(True))
    few._watched[:] = True
    monkeypatch.setattr(FewPoints, "_watching", watching)
    monkeypatch.setattr(FewPoints, "_distances_on", lambda *_: np.ones(len(few._watched)))
    across = few._curve(Course.ACROSS, few._equations())
    found = few._trace(across, across.begin, across.fixed, (BACK, 1.0), LEFT)
    assert found is traced[0]
    assert found.last is not across.begin
