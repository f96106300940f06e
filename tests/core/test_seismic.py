"""The seismic check against mechanisms by hand: M*, e* and a_0* of Circolare 7/2019, C8.7.1.2.1.

Run on ranks, too, by `make test-mpi`.
"""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from fenics_contact import (
    EarthPressure,
    EdgeForce,
    InputError,
    Load,
    Scene,
    Seismic,
    SeismicCheck,
    SolveOptions,
    Tie,
    limit_load,
)
from fenics_contact.console import description, summary
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons
from fenics_contact.output.files import result_record
from fenics_contact.results.wording import Wording
from fenics_contact.scene.units import Units
from tests.bank import GRAVITY, PUSH, coulomb
from tests.drawing import rectangle
from tests.helpers import STONE, on_ground

pytestmark = pytest.mark.mpi

LC1, LC3 = Seismic(), Seismic(1.0)
FAST = SolveOptions(fast=True, tolerance=1e-9)
BOTH = SolveOptions(fast=True, tolerance=1e-9, direction="both")


def scene(
    blocks: list[Any], seismic: Seismic | None = LC1, size: float = 0.4, **options: Any
) -> Scene:
    """Rough blocks of stone on the ground, pushed to the right by their weight."""
    model = polygons(blocks, size)
    return on_ground(model, coulomb(2.0), seismic=seismic, **{"solve": FAST, **options})


def check(given: Scene, direction: str = "positive") -> SeismicCheck:
    result = limit_load(given)
    assert result.status == "limit"
    return result.seismic[direction]


def participating(mass: list[float], displacement: list[float]) -> float:
    """(sum m d)^2 / sum m d^2, by hand."""
    m, d = np.array(mass), np.array(displacement)
    return float((m @ d) ** 2 / (m @ d**2))


def assert_checked(found: SeismicCheck, multiplier: float, mass: list[float], star: float) -> None:
    """All numbers, from alpha_0, the masses that move, and M*."""
    fraction = star / sum(mass)
    activation = multiplier * GRAVITY / (fraction * found.confidence_factor)
    assert found.multiplier == pytest.approx(multiplier, rel=1e-6)
    assert found.moving_mass == pytest.approx(sum(mass), rel=1e-9)
    assert found.participating_mass == pytest.approx(star, rel=1e-6)
    assert found.mass_fraction == pytest.approx(fraction, rel=1e-6)
    assert found.acceleration == pytest.approx(activation, rel=1e-6)
    assert found.acceleration_g == pytest.approx(activation / GRAVITY, rel=1e-6)


@pytest.mark.parametrize("confidence", [1.0, 1.2, 1.35])
def test_block_that_rocks(confidence):
    """One block has one centre: e* = 1, and a_0* = b / h g / FC."""
    width, height = 0.5, 2.0
    found = check(scene([rectangle(0, 0, width, height)], Seismic(confidence)))
    assert found.confidence_factor == confidence
    mass = STONE.density * width * height
    assert_checked(found, width / height, [mass], mass)


@pytest.mark.parametrize("heights", [[2.0], [0.8, 1.2], [0.5, 0.2, 0.4, 0.6, 0.3]])
def test_wall_that_overturns_on_a_plinth(heights):
    """Its courses tip as one: e* = 1, however many; the plinth stays and does not count."""
    width, levels = 0.4, np.cumsum([0.0, *heights])
    wall = [rectangle(0, a, width, b) for a, b in pairwise(levels)]
    found = check(scene([rectangle(-1.0, -1.0, 1.0, 0.0), *wall], LC3))
    mass = [STONE.density * width * 2.0]
    assert_checked(found, width / 2.0, mass, mass[0])
    assert found.parts == 1


def test_wall_that_an_anchor_holds():
    """It bends at a joint, h, below the anchor, A: two parts, their displacements and M* by hand.

    The part below turns about the toe by 1, that above back by h / (A - h) about the hinge at the
    other face.
    """
    width, levels, anchor = 0.4, [0.0, 0.7, 1.6, 2.4], 2.2
    wall = [rectangle(0, a, width, b) for a, b in pairwise(levels)]
    tie = Tie((width / 2.0, anchor), 1e9, ground=(-3.0, anchor))
    found = check(scene(wall, ties={"anchor": tie}))
    exact: list[tuple[float, list[float], float]] = []
    for hinge in levels[1:-1]:
        turn = hinge / (anchor - hinge)
        mass = [STONE.density * width * h for h in (hinge, levels[-1] - hinge)]
        moved = [hinge / 2.0, hinge - turn * (levels[-1] - hinge) / 2.0]
        lift = [width / 2.0, width * (1.0 + turn / 2.0)]
        alpha = float(np.dot(mass, lift) / np.dot(mass, moved))
        exact.append((alpha, mass, participating(mass, moved)))
    alpha, mass, star = min(exact)
    assert star < 0.99 * sum(mass)
    assert_checked(found, alpha, mass, star)
    assert found.parts == 2


def test_wall_that_slides_moves_as_a_whole():
    wall = scene([rectangle(0, 0, 2, 1), rectangle(0, 1, 2, 2)])
    law = coulomb(0.3)
    low = Scene(wall.mesh, wall.materials, PUSH, wall.dead, joints={"default": coulomb(0.8)},
                foundations={"base": law}, seismic=LC1, solve=FAST)  # fmt: skip
    mass = [STONE.density * 2.0] * 2
    assert_checked(check(low), 0.3, mass, sum(mass))


def test_floor_whose_mass_is_pushed_along():
    """A floor weighs on the top of a block; its inertia is a force there, its mass is counted."""
    width, height, floor = 0.5, 2.0, 3e3
    top = {"base": [((0, 0), (width, 0))], "top": [((0, height), (width, height))]}
    model = polygons([rectangle(0, 0, width, height)], 0.4, groups=top)
    dead = Load((0.0, -GRAVITY), traction={"top": (0.0, -floor / width)})
    live = Load((GRAVITY, 0.0), force={"floor": EdgeForce((floor, 0.0), width / 2.0)})
    found = check(on_ground(model, coulomb(2.0), dead, live, seismic=LC3, solve=FAST))
    weight = STONE.density * GRAVITY * width * height
    exact = (weight + floor) * width / 2.0 / (weight * height / 2.0 + floor * height)
    mass = [weight / GRAVITY, floor / GRAVITY]
    assert_checked(found, exact, mass, sum(mass))


def test_both_directions_and_another_unit_of_the_live_load():
    """A stack that leans to the left tips about either toe; half the push, twice the factor."""
    blocks = [rectangle(0, 0, 0.6, 0.8), rectangle(-0.1, 0.8, 0.4, 1.6)]
    result = limit_load(scene(blocks, LC3, solve=BOTH, live=Load((0.5 * GRAVITY, 0.0))))
    mass = [STONE.density * 0.8 * width for width in (0.6, 0.5)]
    heights = [0.4, 1.2]
    for direction, arms in (("positive", [0.3, 0.45]), ("negative", [0.3, 0.15])):
        exact = float(np.dot(mass, arms) / np.dot(mass, heights))
        assert_checked(result.seismic[direction], exact, mass, sum(mass))
    assert result.seismic["positive"].multiplier == pytest.approx(result.load_factor / 2.0)
    assert copy.deepcopy(result).seismic == result.seismic


def test_files_and_texts_have_the_check():
    given = scene([rectangle(0, 0, 0.5, 2.0)])
    result = limit_load(given)
    record = result_record(result)
    found = result.seismic["positive"]
    kept = {
        name: value for name, value in vars(found).items() if name not in ("nonlinear", "missing")
    }
    assert record["seismic"] == {"positive": kept}
    assert record["scene"]["seismic"] == {"confidence_factor": 1.35}
    line = "a0* comes of alpha0 = 0.25, e* = 1, FC = 1.35, M* = "
    mass = "2000 kg per metre of thickness"
    rest = f" of {mass} that move in 1 rigid part"
    assert line + mass + rest in summary(result.with_brackets(), verbose=True)
    line = "seismic check: it starts at a spectral acceleration a0* of 1.817 m/s2 = 0.1852 g"
    assert line in summary(result.with_brackets()).splitlines()
    answer = result.positive.answers["seismic"]
    _, line = answer.lines(result.positive, Wording(Units("m", thickness=0.4)))
    assert "M* = 0.8 t of 0.8 t that move" in line.text and line.verbose
    with Discretization(given) as made:
        assert "seismic check with FC = 1.35" in description(made)


@pytest.mark.parametrize(
    ("demand", "verdict"),
    [
        (1.5, "1.21 times the 1.5 m/s2 asked for: enough"),
        (2.0, "0.908 times the 2 m/s2 asked for: NOT enough"),
    ],
)
def test_demand_gives_a_verdict(demand, verdict):
    result = limit_load(scene([rectangle(0, 0, 0.5, 2.0)], Seismic(demand=demand)))
    assert f"a0* of 1.817 m/s2 = 0.1852 g ({verdict})" in result.summary()
    assert result_record(result)["seismic"]["positive"]["demand"] == demand


def test_nothing_is_checked_unasked_or_without_a_limit():
    blocks = [rectangle(0, 0, 0.5, 2.0)]
    plain = limit_load(scene(blocks, None))
    assert plain.seismic == {}
    assert result_record(plain)["seismic"] is None
    fallen = scene([rectangle(0, 0, 0.5, 1.0), rectangle(0.4, 1, 3, 2)])
    assert limit_load(fallen).seismic == {}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dead": Load()}, r"give loads\.dead\.body"),
        (
            {"live": Load(force={"jack": EdgeForce((1e3, 0.0), 0.0, 1.0)})},
            r"give loads\.live\.body",
        ),
        ({"live": Load((GRAVITY, 0.0), profile="triangular")}, r"loads\.live\.profile"),
        ({"live": Load((GRAVITY, 0.0), earth={"base": EarthPressure(1.0, 1e4)})}, r"live\.earth"),
        ({"live": Load((GRAVITY, 0.0), form=lambda v, dx, ds: v[0] * dx)}, r"live\.form"),
        ({"live": Load((GRAVITY, 1.0))}, r"loads\.live\.body must be horizontal"),
        (
            {"live": Load((GRAVITY, 0.0), {"base": (1e3, 1.0)})},
            r"traction\.base must be horizontal",
        ),
        ({"live": Load((GRAVITY, 0.0), {"base": (-1e3, 0.0)})}, r"traction\.base acts against"),
    ],
)
def test_loads_that_are_no_inertia_are_refused(options, message):
    with pytest.raises(InputError, match=f"seismic.*{message}"):
        scene([rectangle(0, 0, 0.5, 2.0)], **options)


@pytest.mark.parametrize("value", [0.9, 11.0, float("nan"), "1.35"])
def test_confidence_factors_out_of_range_are_refused(value):
    with pytest.raises(InputError, match="confidence_factor"):
        Seismic(value)
