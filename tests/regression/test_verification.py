"""Problems with known answers, as docs/verification.md shows them: the quick ones."""

from __future__ import annotations

import pytest

from benchmarks import verification as known
from benchmarks.curved_bodies import cattaneo, cattaneo_figures, hertz, hertz_figures
from benchmarks.known_answers import Figure
from benchmarks.manufactured import THEORY, errors


def missed(figures: list[Figure]) -> list[str]:
    return [figure.row() for figure in figures if not figure.passed]


@pytest.mark.mpi
def test_uniform_pressure_goes_through_joints():
    assert missed(known.patch_figures()) == []


@pytest.mark.mpi
def test_hertz():
    assert missed(hertz_figures(hertz(10), 10)) == []


@pytest.mark.slow
def test_cattaneo_and_mindlin():
    assert missed(cattaneo_figures(cattaneo(15), 15)) == []


@pytest.mark.parametrize("friction", [0.2, 0.3, 0.5])
def test_block_is_pushed_up_an_incline(friction):
    assert missed(known.incline(friction)) == []


@pytest.mark.mpi
def test_rod_slips_over_the_length_that_friction_allows():
    assert missed(known.rod_figures(known.rod(200))) == []


@pytest.mark.parametrize("quadrilaterals", [True, False])
def test_plate_moves_as_by_code_aster(quadrilaterals):
    assert missed(known.plate_figures(known.plate(quadrilaterals=quadrilaterals))) == []


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("degree", "elements", "matching"),
    [
        (1, 16, False),
        pytest.param(1, 16, True, marks=pytest.mark.slow),
        pytest.param(2, 16, False, marks=pytest.mark.slow),
        pytest.param(2, 16, True, marks=pytest.mark.slow),
    ],
)
def test_orders_of_convergence(degree, elements, matching):
    """Of displacement, energy, traction and load factor: at least 0.9 of theory."""
    rows = [errors(count, degree, matching) for count in (elements, 2 * elements)]
    orders = {name: known.order([row[name] for row in rows]) for name in THEORY}
    assert {n: found for n, found in orders.items() if found < 0.9 * THEORY[n](degree)} == {}
