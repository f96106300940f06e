"""Lower collapse states: the second opinion, what it costs, and the list of states."""

from __future__ import annotations

from dataclasses import replace

import pytest
from mpi4py import MPI

from fenics_contact import BlockMesh, Load, Material, Scene, SolveOptions, limit_load
from fenics_contact.collapse import lowest
from fenics_contact.collapse.lowest import LOWEST, find_lowest, second_opinion
from fenics_contact.collapse.strategy import COULOMB
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.console import summary
from fenics_contact.meshing import polygons
from fenics_contact.results.certificate import state_residuals
from tests.bank import BANK, PUSH, WEIGHT, block_recipe, coulomb
from tests.core.problems import load_case

TOLERANCE = 1e-6

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


def test_a_lower_state_is_told_and_verified():
    result = limit_load(stones())
    end = result.positive
    assert end.load_factor == pytest.approx(HIGH, rel=1e-5)
    assert end.lowest.status == "lower"
    assert end.lowest.load_factor == pytest.approx(LOW, rel=1e-5)
    assert [state.status for state in end.states] == ["limit", "limit"]
    assert end.states[0].load_factor == end.load_factor
    assert end.states[1].load_factor == end.lowest.load_factor
    assert f"lower state: another collapse, verified, at {end.lowest.load_factor:.8g}" in (
        summary(result)
    )


@pytest.mark.parametrize("direction", ["negative", "both"])
def test_a_lower_state_of_the_reversed_load(direction):
    scene = stones(mirrored=True, direction=direction)
    end = limit_load(replace(scene, live=PUSH)).negative
    assert end.load_factor == pytest.approx(-HIGH, rel=1e-5)
    assert end.lowest.load_factor == pytest.approx(-LOW, rel=1e-5)
    assert end.states[1].load_factor == end.lowest.load_factor


def test_the_lowest_is_the_load_factor_where_it_is_asked_for():
    with load_case(stones()) as case:
        found = find_lowest(case, TOLERANCE)
        problem, state = case.problem, found.state
        residuals = state_residuals(problem, state, case.scales_at(state.work))
    assert found.status == "limit" and found.certificate.passed
    assert max(residuals.values()) < 1e-4
    factors = [state.load_factor for state in found.states]
    assert factors == sorted(factors) and factors[0] == found.load_factor
    assert found.load_factor == pytest.approx(LOW, rel=1e-5)
    assert factors[-1] == pytest.approx(HIGH, rel=1e-5)
    assert found.lowest.load_factor == found.load_factor and found.lowest.starts >= 3
    assert all(state.mode is not None and state.joints is not None for state in found.states)


def test_one_state_is_listed_once():
    with load_case(block_recipe(0.4, 1.0, 0.3).scene(1)) as case:
        found = find_lowest(case, TOLERANCE)
    (state,) = found.states
    assert (state.status, state.load_factor) == ("limit", pytest.approx(0.3, rel=1e-6))
    assert state.start.startswith("path; ") and found.lowest.starts == state.start.count(";") + 1


@pytest.mark.parametrize("name", ["W1 coulomb 0.65", "W1 bracket 1"])
def test_no_lower_state_at_half_of_the_cost(name):
    with load_case(BANK[name].scene()) as case:
        effort = case.discretization.effort
        first = effort.spent
        end = find_collapse(case, COULOMB["auto"], TOLERANCE)
        before = effort.spent
        cost = before - first
        found = second_opinion(case, end, TOLERANCE, cost)
        assert effort.spent - before <= cost / 2.0
    assert (found.lowest.status, found.lowest.load_factor) == ("none", end.load_factor)
    assert found.load_factor == end.load_factor and not found.states


def test_a_search_has_a_hard_limit(monkeypatch):
    monkeypatch.setattr(lowest, "LOWEST", replace(LOWEST, searches=0.1))
    with load_case(stones()) as case:
        effort = case.discretization.effort
        end = find_collapse(case, COULOMB["auto"], TOLERANCE)
        before = effort.spent
        found = second_opinion(case, end, TOLERANCE, 10.0)
        assert effort.spent - before <= 1.0 + 1e-6
    assert found.lowest.status == "not_known" and found.load_factor == end.load_factor


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
    together = limit_load(stones(**options)).positive
    factors = [state.load_factor for state in together.states]
    assert sorted(factors) == pytest.approx([LOW, HIGH], rel=1e-5)
    assert all(found == factors for found in MPI.COMM_WORLD.allgather(factors))


@pytest.mark.parametrize("method", ["fixed-point", "monolithic"])
def test_the_second_opinion_does_not_hang_on_the_method(method):
    end = limit_load(stones(method=method)).positive
    assert end.lowest.load_factor == pytest.approx(LOW, rel=1e-5)
