"""Lower collapse states: what is found of them by default and where they are asked for."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from mpi4py import MPI

from fenics_contact import BlockMesh, LimitLoad, Load, Material, Scene, SolveOptions, limit_load
from fenics_contact.console import summary
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.lowest import STARTS, lowest_from
from fenics_contact.meshing import polygons
from fenics_contact.output.files import result_record
from tests.bank import BANK, PUSH, WEIGHT, coulomb, wall_recipe
from tests.helpers import planar_faces
from tests.quick import quick
from tests.second_solver import misses

#: Rubble of five stones, corners in m. It has two collapse states, on every mesh tried.
A, B, C = (0.323988, 1.506131), (0.425815, 1.574813), (0.400683, 0.972991)
D, E, F = (0.383685, 1.972832), (0.709650, 1.544337), (0.709650, 0.905352)
STONES = [
    [A, B, D, (0.0, 1.972832), (0.0, 1.551175)],
    [D, B, E, (0.709650, 1.972832)],
    [F, E, B, A, C],
    [(0.0, 0.0), (0.709650, 0.0), F, C, (0.0, 0.877022)],
    [(0.0, 1.551175), (0.0, 0.877022), C, A],
]
#: That of the path, a state of elastic blocks, and the least with any self-stress, gap 1e-4.
HIGH, LOW = 0.355824, 0.301976


def stones(mirrored: bool = False, **options: object) -> Scene:
    """The five stones, pushed to the right, or their mirror image, pushed to the left."""
    sign = -1.0 if mirrored else 1.0
    outlines = [[(sign * x, y) for x, y in stone] for stone in STONES]
    model = polygons(outlines, 0.3, ["soft", *["hard"] * 4])
    return Scene(
        BlockMesh.from_model(model),
        {"soft": Material(1.67e8, 0.19, 1619.25), "hard": Material(2.25e9, 0.29, 1288.86)},
        plane="stress",
        dead=WEIGHT,
        live=Load((sign * PUSH.body[0], 0.0)),
        joints={"default": coulomb(0.755)},
        foundations={"base": coulomb(1.166)},
        solve=SolveOptions(error=False, **options),
    )


@cache
def solved(**options: object) -> LimitLoad:
    """The limit load of the five stones."""
    return limit_load(stones(**options))


#: The least load factor with a gap of 1e-4, against a state of gap 0.
NEAR = 5e-4


def test_a_lower_state_is_told_with_its_gap():
    result = solved()
    end = result.positive
    assert end.load_factor == pytest.approx(HIGH, rel=1e-5)
    assert end.lowest.status == "lower" and 0.0 <= end.lowest.gap <= 1.5e-4
    assert end.lowest.load_factor == pytest.approx(LOW, rel=NEAR)
    assert [state.status for state in end.states] == ["limit", "limit"]
    assert end.states[0].load_factor == end.load_factor
    assert end.states[1].load_factor == end.lowest.load_factor
    assert "with any self-stress in the blocks, is at 0.30" in summary(result, verbose=True)
    record = result_record(result)
    assert record["lowest"]["load_factor"] == end.lowest.load_factor
    assert [state["gap"] for state in record["states"]][1] == end.lowest.gap


@pytest.mark.parametrize("direction", ["negative", "both"])
def test_a_lower_state_of_the_reversed_load(direction):
    scene = stones(mirrored=True, direction=direction)
    end = limit_load(replace(scene, live=PUSH)).negative
    assert end.load_factor == pytest.approx(-HIGH, rel=1e-5)
    assert end.lowest.load_factor == pytest.approx(-LOW, rel=NEAR)
    assert end.states[1].load_factor == end.lowest.load_factor


def test_the_lowest_is_the_load_factor_where_it_is_asked_for():
    end = solved(states="lowest").positive
    assert end.status == "limit" and end.certificate.passed
    assert (end.engine, end.lowest.status) == ("faces", "lower")
    assert end.load_factor == end.lowest.load_factor == pytest.approx(LOW, rel=NEAR)
    assert end.lowest.starts >= 2 and end.gap == end.lowest.gap
    assert end.states[0].load_factor == pytest.approx(HIGH, rel=1e-5)


def test_the_lowest_state_does_not_collapse_at_its_load_factor():
    result = solved(states="lowest")
    record = result_record(result)
    for text in (
        summary(result, verbose=True),
        record["answer"]["found"][0],
        record["directions"]["positive"]["proof"],
    ):
        assert "lowest collapse state found, with any self-stress in the blocks" in text
        assert "ollapses at" not in text and "structure stands" not in text
    assert "none found below the one reported; states were found from 0.30" in summary(
        result, verbose=True
    )


def test_no_lower_state_is_told_where_the_path_is_as_low():
    end = limit_load(BANK["W1 coulomb 0.65"].scene(lowest=True)).positive
    assert (end.lowest.status, end.lowest.load_factor) == ("none", end.load_factor)


#: Walls, and states that a search of the product has found, which the lowest one is not above.
KNOWN = {"W1": 0.6390, "W2": 0.5576, "W3": 0.3577, "W4": 0.2638}


@pytest.mark.parametrize("name", quick(KNOWN, "W3"))
def test_lowest_states_of_the_walls(name):
    end = limit_load(wall_recipe(name, coulomb(0.65)).scene(1, states="lowest")).positive
    assert min(state.load_factor for state in end.states) <= KNOWN[name]
    assert end.load_factor >= end.bounds.lower
    assert all(state.gap is None or state.gap <= 1.5e-4 for state in end.states)


def test_what_is_not_looked_for():
    given = limit_load(BANK["W1 tresca 2 kPa"].scene(error=False))
    assert given.positive.lowest is None  # one limit load
    left_out = limit_load(stones(lowest=False))
    assert left_out.positive.lowest is None and not left_out.positive.states
    raised = limit_load(stones(control="load"))
    assert raised.positive.lowest.status == "not_known"
    assert "step by step" in raised.positive.lowest.reason


@pytest.mark.mpi
@pytest.mark.parametrize("options", [{}, {"states": "lowest"}], ids=str)
def test_ranks_agree_on_states(options):
    together = solved(**options).positive
    factors = [state.load_factor for state in together.states]
    assert sorted(factors) == pytest.approx([LOW, HIGH], rel=NEAR)
    assert all(found == factors for found in MPI.COMM_WORLD.allgather(factors))


@pytest.mark.parametrize("name", ["2x3", "4x4"])
def test_with_much_friction_states_of_less_are_found(name):
    """They are inside its cones; next to elastic states with so much of it blocks only turn."""
    factors = []
    for friction in (1.0, 100.0):
        model = planar_faces(wall_recipe(name, coulomb(friction)).scene(1)).model
        found = lowest_from(FaceSearch(model, 1e-4), STARTS["little friction"])
        assert found.gap <= 1.5e-4 and max(misses(model, found).values()) <= 1e-8
        factors.append(found.load_factor)
    assert factors[1] <= factors[0] * (1.0 + 3e-4)
