"""What is told of the way after the peak, and where it ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fenics_contact.errors import Stopped
from fenics_contact.motion.answer import twists
from fenics_contact.motion.check import Spectrum, nonlinear_check
from tests.motion.structures import box, in_plane, turned, way_down

#: A lintel that bears 0.2 m on either side of a door, and where it lies.
LINTEL = [box(0, 0, 2.0, 0.3), box(-1.0, -1.0, 0.2, 0), box(1.8, -1.0, 3.0, 0)]


@pytest.fixture(scope="module")
def wall():
    return way_down(in_plane([box(0, 0, 0.5, 5.0)]))


def test_first_point_is_the_limit(wall):
    assert wall.fine.points[0].load_factor == pytest.approx(0.1, abs=1e-7)
    assert wall.fine.points[0].displacement == 0.0


def test_sentence_tells_the_way(wall):
    assert f"{wall.head} {wall.text}" == (
        "after the peak: 0.1 at once, 0.0597 at 0.2 m, nothing at 0.498 m (block b0 at (0.5, 5))"
    )
    assert "the energy closes to" in wall.checks


def test_record_and_rows_have_every_point(wall):
    record = wall.record()
    assert record["zero"] == wall.end
    assert record["end"]["why"] == "nothing left"
    assert len(record["points"]) == len(wall.fine.points)
    rows = list(wall.rows())
    assert len(rows) == 1 + len(wall.fine.points)
    assert rows[0].startswith("displacement,load_factor")


def test_every_point_has_a_proved_gap(wall):
    assert max(point.gap for point in wall.fine.points) < 1e-3


def test_path_ends_where_it_is_asked_to():
    found = way_down(in_plane([box(0, 0, 0.5, 5.0)]), until=0.1)
    assert found.fine.why == "displacement"
    assert 0.1 <= found.end < 0.2


def test_control_point_can_be_chosen(wall):
    found = way_down(in_plane([box(0, 0, 0.5, 5.0)]), control=[0.0, 5.0])
    assert found.place == pytest.approx((0.0, 5.0))
    assert found.end == pytest.approx(0.5, abs=1e-3)
    assert found.end > wall.end


def test_lintel_loses_its_bearing():
    """It is proved that no load factor holds it behind the end."""
    found = way_down(in_plane(LINTEL, fixed=[1, 2], friction=0.3))
    assert found.fine.why == "support lost"
    assert found.end == pytest.approx(0.2, abs=2e-3)
    assert found.lost == ("b0",)
    assert found.text.endswith(
        "0.3 at 0.199 m, where block b0 loses its support (block b0 at (2, 0.3))"
    )
    assert [point.load_factor for point in found.fine.points] == pytest.approx(
        [0.3] * len(found.fine.points), abs=1e-6
    )


def test_cohesion_is_lost_where_it_slips():
    """F + c A / W as drawn, then F alone."""
    blocks = [box(0, 0, 1, 1), box(-5, -0.5, 6, 0)]
    joints = {"default": {"friction": 0.3, "cohesion": 2e3}}
    found = way_down(in_plane(blocks, fixed=[1], joints=joints), until=0.1)
    first, *others = [point.load_factor for point in found.fine.points]
    assert first == pytest.approx(0.3 + 2e3 / (2000.0 * 9.81), abs=1e-6)
    assert others == pytest.approx([0.3] * len(others), abs=1e-6)
    assert found.fine.points[1].event == "jump"
    assert found.left_out == ()


def test_tensile_strength_is_lost_where_it_opens():
    """The far edge holds with f_t b / 2 as drawn; then the wall rocks as without."""
    joints = {"default": {"friction": 0.7, "cohesion": 1e4, "tensile_strength": 1e4}}
    found = way_down(in_plane([box(0, 0, 0.5, 5.0)], joints=joints), until=0.3)
    first, *others = found.fine.points
    weight = 2000.0 * 0.5 * 5.0 * 9.81
    assert first.load_factor == pytest.approx(0.1 * (1.0 + 1e4 * 0.5 / weight), abs=1e-6)
    for point in others:
        exact = math.tan(math.atan(0.1) - turned(point))
        assert point.load_factor == pytest.approx(exact, abs=1e-6)


def test_stopped_path_keeps_its_points():
    asked = []

    def check_stop():
        asked.append(1)
        if len(asked) > 6:
            raise Stopped("enough")

    found = way_down(in_plane([box(0, 0, 0.5, 5.0)]), check_stop=check_stop)
    assert found.fine.why == "enough"
    assert len(found.fine.points) > 3
    assert not found.agrees
    assert found.zero is None
    assert found.trusted == ()
    assert "stopped before it was followed twice" in found.text


def test_second_path_that_is_stopped_verifies_nothing():
    asked = []

    def check_stop():
        asked.append(1)
        if len(asked) > 40:
            raise Stopped("enough")

    found = way_down(in_plane([box(0, 0, 0.5, 5.0)]), check_stop=check_stop)
    assert found.fine.why == "nothing left"
    assert found.zero is None
    assert "no end is told" in found.text


def test_law_of_blocks_that_do_not_touch_as_drawn():
    """A block slides against another one: it is held there; where the joint is off, it passes."""
    blocks = [box(0, 0, 1, 1), box(-5, -0.5, 6, 0), box(1.3, 0, 2, 1)]
    joints = {"default": {"friction": 0.3}, "b": {"between": ["b0", "b2"], "off": True}}
    free = way_down(in_plane(blocks, fixed=[1, 2], joints=joints), until=0.6)
    assert free.agrees
    assert [p.load_factor for p in free.fine.points] == pytest.approx(
        [0.3] * len(free.fine.points), abs=1e-6
    )
    held = way_down(in_plane(blocks, fixed=[1, 2], friction=0.3), until=0.6)
    assert held.end < 0.31 or held.fine.points[-1].load_factor > 0.31


@pytest.mark.parametrize(
    ("state", "displacement", "period", "ground"),
    [("SLV", 0.09950, 2.5229, 0.1529), ("SLC", 0.14926, 3.5140, 0.2198)],
)
def test_check_of_the_code_by_hand(wall, state, displacement, period, ground):
    """A wall of 0.5 x 5 m with FC 1.35 on a soil with S 1.2, F_0 2.5, T_C 0.45 s."""
    shift, factor = wall.fine.curve
    check = nonlinear_check(
        0.5 * shift,
        factor * 9.81 / 1.35,
        Spectrum(0.16 * 9.81, 1.2, 2.5, 0.45),
        gravity=9.81,
        limit_state=state,
    )
    assert check.zero == pytest.approx(0.24876, abs=5e-6)
    assert check.displacement == pytest.approx(displacement, abs=5e-6)
    assert check.period == pytest.approx(period, abs=1e-4)
    assert check.ground / 9.81 == pytest.approx(ground, abs=5e-5)
    assert check.start / 9.81 == pytest.approx(0.0617, abs=5e-5)
    asked = "0.16 g asked for: NOT enough" if state == "SLV" else "0.16 g asked for: enough"
    assert asked in check.verdict
    assert check.text.startswith(f"d_{state} ")
    assert len(check.table()) == 7


def test_start_of_free_elements_by_hand(wall):
    """T_0 = 6.2 (h / t) h sqrt(W / (E g)) with E = 1 GPa, W = 17.66 kN/m3 [C8.7.1.7]."""
    period = 6.2 * 10.0 * 5.0 * math.sqrt(1800.0 / 1e9)
    shift, factor = wall.fine.curve
    given = 0.5 * shift, factor * 9.81 / 1.35, Spectrum(0.16 * 9.81, 1.2, 2.5, 0.45)
    rigid = nonlinear_check(*given, gravity=9.81, limit_state="SLD")
    assert rigid.ground / 9.81 == pytest.approx(0.1 / 1.35 / 1.2, abs=1e-6)
    free = nonlinear_check(*given, gravity=9.81, limit_state="SLD", free=period)
    stiff = (2.0 * math.pi / period) ** 2
    yields = 0.726667 / (stiff + 0.726667 / 0.25)  # on the straight line
    assert free.displacement == pytest.approx(yields, rel=2e-3)
    assert free.acceleration == pytest.approx(stiff * yields, rel=2e-3)
    # on the plateau of the spectrum: a_y = a_g S F_0
    assert free.ground == pytest.approx(free.acceleration / (1.2 * 2.5), rel=1e-6)
    assert free.ground < rigid.ground
    later = nonlinear_check(*given, gravity=9.81, free=period)
    assert later.ground / 9.81 == pytest.approx(0.1529, abs=5e-5)


def test_mechanisms_that_twist_are_told():
    parallel = np.array([[0.0, 1.0, 0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 0.3, -0.2, 0.0, 0.0]])
    assert not twists(parallel, 1.0)
    parallel[0, 5] = 0.4
    assert twists(parallel, 1.0)
