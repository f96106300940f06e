"""Load factors in the words of their load: in g, in degrees, or as multiples."""

from __future__ import annotations

import pytest

from fenics_contact.results.wording import Line, Wording, meant
from fenics_contact.scene.units import Units

DOWN = {"body": (0.0, -9.81), "traction": {}}


def wording(live, dead=DOWN, floors=None, resultant=(0.0, -1e4), **more):
    """Words for loads as a scene file has them."""
    return Wording.of({"dead": dead, "live": live}, floors or {}, resultant, Units("m"), **more)


ROOF = {**DOWN, "traction": {"top": (0.0, -1e4)}}
#: Live load, dead load, floors, what 0.3 of it is in both directions.
LOADS = {
    "weight to the right": ({"body": (9.81, 0.0)}, DOWN, {}, "0.3000 g to the right"),
    "weight to the left": ({"body": (-9.81, 0.0)}, DOWN, {}, "0.3000 g to the left"),
    "a tenth of it": ({"body": (0.981, 0.0)}, DOWN, {}, "0.03000 g to the right"),
    "a roof as a traction": (
        {"body": (9.81, 0.0), "traction": {"top": (1e4, 0.0)}},
        ROOF,
        {},
        "0.3000 g to the right",
    ),
    "a traction that is no weight": (
        {"body": (9.81, 0.0), "traction": {"top": (3e3, 0.0)}},
        ROOF,
        {},
        "0.3000 times the live load of 10 kN/m",
    ),
    "a floor with its mass": (
        {"body": (9.81, 0.0)},
        DOWN,
        {"first": {"mass": True}},
        "0.3000 g to the right",
    ),
    "a floor without": (
        {"body": (9.81, 0.0)},
        DOWN,
        {"first": {"mass": False}},
        "0.3000 times the live load of 10 kN/m",
    ),
    "an axle": (
        {"body": (0.0, 0.0), "force": {"axle": {}}},
        DOWN,
        {},
        "0.3000 times the live load of 10 kN/m: 3 kN/m",
    ),
    "a tilting table": (
        {"body": (9.81, 0.0), "tilt": True},
        DOWN,
        {},
        "a tilt of 16.70 degrees, down to the right",
    ),
}


@pytest.mark.parametrize("name", LOADS)
def test_unit_and_way_are_those_of_the_load(name):
    live, dead, floors, told = LOADS[name]
    assert wording(live, dead, floors).amount(0.3, "positive") == told


def test_bounds_are_rounded_outwards_and_no_further_than_they_must():
    words = wording({"body": (9.81, 0.0)})
    assert words.beside(0.4036, 0.3558, 1.0, 1) == "0.404"
    assert words.beside(0.4031, 0.3558, 1.0, 1) == "0.404"
    assert words.beside(0.3001, 0.3558, 1.0, -1) == "0.300"
    assert words.beside(-0.35581, -0.3558, -1.0, 1) == "0.3559"
    assert words.beside(0.25, 0.25, 1.0, 1) == "0.2500"
    assert words.beside(0.0, 0.25, 1.0, -1) == "0"
    assert words.beside(1234.5, 900.0, 1.0, 1) == "1240"


def test_lines_of_both_directions_are_one():
    words = wording({"body": (9.81, 0.0)}, both=True)
    ways = ("positive", "negative")
    same = [(way, Line("ties:", "none")) for way in ways]
    assert words.merged(same, ways) == ["ties: none"]
    apart = [(way, Line("mesh:", text, " here")) for way, text in zip(ways, "12", strict=True)]
    assert words.merged(apart, ways) == ["mesh: 1 to the right, 2 to the left here"]
    assert words.merged(apart[1:], ways) == ["mesh: 2 to the left here"]
    lists = [(way, Line("ties:", text)) for way, text in zip(ways, ("a, b", "c"), strict=True)]
    assert words.merged(lists, ways) == ["ties: to the right a, b; to the left c"]
    assert words.merged(apart[1:], ways[1:]) == ["mesh: 2 here"]


@pytest.mark.parametrize(
    ("gap", "others", "told"),
    [
        (1e-4, [0.35582], "0.3558 g to the right"),
        (5e-3, [], "0.356 g to the right"),
        (1e-4, [0.35582, 0.38], "0.356 g to the right"),
        (1e-4, [0.35582, 0.3559], "0.3558 g to the right"),
    ],
)
def test_digits_end_at_the_gap_and_at_other_states(gap, others, told):
    digits = meant(0.35582, gap, others, 0.35582)
    assert wording({"body": (9.81, 0.0)}).amount(0.35582, "positive", digits) == told
