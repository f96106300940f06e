"""Random structures in space, judged by a second program; and whether it would notice."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fenics_contact.results.bounds import LimitBounds
from fenics_contact.spatial import Scene, limit_load
from tests.quick import some
from tests.spatial.judge import Judge, judge
from tests.spatial.judge_case import Case, Piece, meeting, pieces_of
from tests.spatial.random_structures import KINDS, box, prism, structure

WHOLE = {"direction": [1.0, 0.0, 0.0]}
FLOOR = box((-3, -3, -1), (3, 3, 0), fixed=True)


def scene(blocks, friction=0.5, live=WHOLE, **more):
    return {
        "dimension": 3,
        "title": "drawn",
        "blocks": blocks,
        "materials": {"default": {"density": 2000.0}},
        "joints": {"default": {"friction": friction}},
        "loads": {"dead": {"body": [0.0, 0.0, -9.81]}, "live": live},
        **more,
    }


@cache
def column():
    """A column of two blocks that tips at 0.25, and its result."""
    blocks = {
        "floor": FLOOR,
        "low": box((0, 0, 0), (0.5, 1, 1)),
        "top": box((0, 0, 1), (0.5, 1, 2)),
    }
    tables = scene(blocks)
    return tables, limit_load(Scene.from_tables(tables, Path(".")))


@pytest.mark.parametrize("seed", some([6, 11, 12, 13, 14, 15, 18, 33, 59, 62, 74, 78], 6))
def test_random_structures_are_judged_right(seed):
    found, _ = judge(structure(seed))
    assert {name: (one.wrong, one.none) for name, one in found.items()} == dict.fromkeys(
        found, ([], "")
    )


def test_every_kind_of_structure_is_drawn_without_overlaps():
    for seed in range(len(KINDS)):
        case = Case(structure(seed))
        assert case.contacts and 4 <= len(case.bodies) <= 60


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"load_factor": 0.26}, "equilibrium missed"),
        ({"load_factor": -0.25}, "wrong sign"),
        ({"load_factor": 0.4}, "above what anything carries"),
        ({"program": lambda: LimitBounds(None, 0.2)}, "upper end"),
        ({"status": "unbounded", "load_factor": np.inf}, "nothing above 0.25"),
        ({"status": "unstable"}, "it stands"),
        ({"force": 1.1}, "equilibrium missed"),
        ({"force": -1.0}, "pressure missed"),
        ({"mode": -1.0}, "the mode closes"),
        ({"mode": "slides"}, "power over work"),
    ],
)
def test_what_is_wrong_is_noticed(change, told):
    tables, result = column()
    found = result.ends["positive"]
    slides = np.zeros_like(found.mode)
    slides[1:3, 0] = 1.0
    made = {
        name: slides if value == "slides" else getattr(found, name) * value
        for name, value in change.items()
        if name in ("force", "mode")
    }
    judging = Judge(tables, result)
    assert not judging.judged(found).wrong
    assert told in "; ".join(judging.judged(replace(found, **{**change, **made})).wrong)


def test_a_gap_that_is_not_true_is_noticed():
    """Half of the friction of a block that could slide at 0.5 and tips at 0.25 is no collapse."""
    blocks = {"floor": FLOOR, "block": box((0, 0, 0), (1, 1, 1))}
    tables = scene(blocks, 0.3, {"force": {"push": {"block": "block", "force": [2000.0, 0, 0]}}})
    result = limit_load(Scene.from_tables(tables, Path(".")))
    found = result.ends["positive"]
    exact = 0.3 * 2000.0 * 9.81 / 2000.0
    assert found.load_factor == pytest.approx(exact, rel=1e-5)
    half = 0.5 * found.load_factor
    force = found.force * [1.0, 0.5, 0.5]
    force[:, 0] = found.force[:, 0].mean()
    told = "; ".join(
        Judge(tables, result).judged(replace(found, load_factor=half, force=force)).wrong
    )
    assert "gap" in told


def test_forces_that_nothing_presses_are_no_state():
    """A stone between upright walls, carried by any friction if only something pressed it."""
    walls = {
        "left": box((-1, 0, 0), (0, 1, 1), fixed=True),
        "right": box((1, 0, 0), (2, 1, 1), fixed=True),
    }
    blocks = {**walls, "stone": box((0, 0, 0), (1, 1, 1))}
    tables = scene(blocks, 0.6)
    judging = Judge(tables, limit_load(Scene.from_tables(tables, Path("."))))
    assert not judging.falls
    assert not judging.has_state


@pytest.mark.parametrize(
    ("first", "second", "kind", "sure"),
    [
        (box((0, 0, 0), (1, 1, 1)), box((0.5, 0.5, 1), (2, 2, 2)), "Polygon", True),
        (
            box((0, 0, 0), (1, 1, 1)),
            prism([(0.5, 1), (0.7, 2), (0.3, 2)], (0.2, 3)),
            "LineString",
            True,
        ),
        (box((0, 0, 0), (1, 1, 1)), box((1, 0, 1), (2, 1, 2)), "LineString", False),
        (
            prism([(0, 0), (1, 0), (0.5, 1)], (0, 2)),
            box((0, 0.5, 1), (1, 1, 2)),
            "LineString",
            True,
        ),
    ],
)
def test_where_bodies_meet(first, second, kind, sure):
    found = meeting(*pieces_of(first), *pieces_of(second), 2.0)
    assert (found.shape.geom_type, found.sure) == (kind, sure)


def test_ridges_across_each_other_meet_in_a_point():
    low = Piece(np.array([(x, y, z) for y in (0.0, 2.0) for x, z in ((0, 0), (1, 0), (0.5, 1))]))
    top = Piece(np.array([(x, y, z) for x in (0.0, 2.0) for y, z in ((0, 2), (1, 2), (0.5, 1))]))
    found = meeting(low, top, 2.0)
    assert (found.shape.geom_type, found.sure) == ("Point", True)
    assert found.corners == pytest.approx(np.array([[0.5, 0.5, 1.0]]))
