"""Soil that pushes back: load factors by hand, what it presses with, ranks, messages."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fenics_contact import (
    EdgeForce,
    InputError,
    JointLaw,
    Load,
    Scene,
    Soil,
    SolveOptions,
    equilibrium,
    limit_load,
)
from fenics_contact.console import description, summary
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import arch, polygons
from fenics_contact.output.files import result_record
from tests.bank import GRAVITY, sides
from tests.drawing import rectangle
from tests.helpers import STONE, coulomb, on_ground
from tests.quick import each_once

UNIT, SURCHARGE, ANGLE = 1.8e4, 2e3, 30.0  # N/m3, Pa, degrees: k_a = 1/3, k_p = 3
LEAST, MOST = 1.0 / 3.0, 3.0
BOTH = SolveOptions(direction="both", fast=True)


def block(friction: float, width: float = 2.0, soil: Soil | None = None, **options: Any) -> Scene:
    """One of 1 m height with soil on its right side up to 0.8 m."""
    edges = sides(base=(0, 0, width, 0), right=(width, 0, width, 1))
    model = polygons([rectangle(0.0, 0.0, width, 1.0)], 0.25, groups=edges)
    soil = soil or Soil("right", 0.8, UNIT, ANGLE, surcharge=SURCHARGE)
    return on_ground(model, coulomb(friction), soil={"bank": soil}, **{"solve": BOTH, **options})


def pressure(depth: float = 0.8) -> tuple[float, float]:
    """Vertical stress summed over the height, N/m, and its moment about the foot."""
    force = SURCHARGE * depth + 0.5 * UNIT * depth**2
    return force, SURCHARGE * 0.5 * depth**2 + UNIT * depth**3 / 6.0


@pytest.mark.mpi
@pytest.mark.parametrize(("engine", "degree"), each_once(["path", "faces"], [1, 2]))
def test_block_slides_into_soil_and_away_from_it(engine, degree):
    """lambda W = F W + P_p into the soil; away from it the active pressure helps, F W - P_a."""
    weight = 2.0 * STONE.density * GRAVITY
    options = replace(BOTH, engine=engine)
    result = limit_load(block(0.3, solve=options, degree=degree))
    force, _ = pressure()
    into = 0.3 + MOST * force / weight
    away = -0.3 + LEAST * force / weight
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(into, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(away, rel=1e-6)
    for end, factor in ((result.positive, into), (result.negative, away)):
        assert end.certificate.passed
        assert end.bounds.upper == pytest.approx(max(factor, end.load_factor), rel=1e-6)
    record = result_record(result)
    assert [one.state for one in result.soil] == ["passive"]
    for direction, state, part in (("positive", "passive", MOST), ("negative", "active", LEAST)):
        (found,) = record["directions"][direction]["soil"]
        assert found["state"] == state
        assert found["force"] == pytest.approx(part * force, rel=1e-6)
    assert "soil: to the right bank" in summary(result)
    assert len(result.ties) == 0 or "state" not in result.ties


@pytest.mark.mpi
@pytest.mark.parametrize("engine", ["path", "faces"])
def test_block_topples_into_soil(engine):
    """About its toe: lambda W h/2 = W b/2 + M_p; away from it about the other, - M_a."""
    weight = 0.5 * STONE.density * GRAVITY
    result = limit_load(block(5.0, width=0.5, solve=replace(BOTH, engine=engine, gap=1e-7)))
    _, moment = pressure()
    assert result.load_factor == pytest.approx(0.5 + 2.0 * MOST * moment / weight, rel=1e-6)
    away = -0.5 + 2.0 * LEAST * moment / weight
    assert result.load_factor_negative == pytest.approx(away, rel=1e-6)


@pytest.mark.mpi
def test_soil_lies_on_a_battered_side():
    """lambda W = F (W + V) + P_p with the weight V of the soil on the side; or without it."""
    edges = sides(base=(0, 0, 2, 0), right=(2, 0, 1.5, 1))
    model = polygons([[(0.0, 0.0), (2.0, 0.0), (1.5, 1.0), (0.0, 1.0)]], 0.25, groups=edges)
    weight = 1.75 * STONE.density * GRAVITY
    force, _ = pressure()
    for lies in (True, False):
        soil = Soil("right", 0.8, UNIT, ANGLE, surcharge=SURCHARGE, weight=lies)
        result = limit_load(on_ground(model, coulomb(0.3), soil={"bank": soil}))
        expected = 0.3 * (weight + 0.5 * force * lies) + MOST * force
        assert result.load_factor == pytest.approx(expected / weight, rel=1e-6)


def test_portal_between_two_banks():
    """Both piers topple and carry the lintel along, into one bank and away from the other.

    lambda (W_p + W_l) H = (W_p + W_l) b + M_p - M_a, W_p of both piers.
    """
    edges = sides(base=(0, 0, 3, 0), left=(0, 0, 0, 2), right=(3, 0, 3, 2), bed=(0, 2, 3, 2))
    blocks = [
        rectangle(0.0, 0.0, 0.5, 2.0),
        rectangle(2.5, 0.0, 3.0, 2.0),
        rectangle(0.0, 2.0, 3.0, 2.4),
    ]
    model = polygons(blocks, 0.25, groups=edges)
    soils = {side: Soil(side, 0.8, UNIT, ANGLE, surcharge=SURCHARGE) for side in ("left", "right")}
    result = limit_load(on_ground(model, coulomb(5.0), soil=soils))
    piers, lintel = (area * STONE.density * GRAVITY for area in (2.0, 1.2))
    _, moment = pressure()
    stands = (0.5 * piers + lintel) * 0.5 + (MOST - LEAST) * moment
    assert result.load_factor == pytest.approx(
        stands / (0.5 * piers * 2.0 + lintel * 2.0), rel=1e-6
    )


def test_soil_as_a_load_is_its_active_end():
    """With k_p = k_a soil is a given pressure: that of loads.dead.earth."""
    soil = Soil("right", 0.8, UNIT, active=0.4, passive=0.4, surcharge=SURCHARGE)
    force, _ = pressure()
    weight = 2.0 * STONE.density * GRAVITY
    result = limit_load(block(0.3, soil=soil))
    assert result.load_factor == pytest.approx(0.3 + 0.4 * force / weight, rel=1e-6)


def test_coefficients():
    soil = Soil("a", 0.0, 1.0, 30.0)
    assert soil.coefficients == pytest.approx((1 / 3, 3.0), rel=1e-12)
    # Tables of Coulomb's theory: phi 30, delta 15 degrees: K_a 0.301, K_p 4.977.
    rough = replace(soil, wall_friction=15.0)
    level = math.cos(math.radians(15.0))
    assert rough.coefficients == pytest.approx((0.3014 * level, 4.9765 * level), rel=1e-3)


def shallow_arch(soil: Soil | None, **options: Any) -> Scene:
    """One of 15 voussoirs under its weight and a force at a quarter of its span."""
    model = arch(15, 0.15, 2.0, 180.0)
    springs = {"springings": coulomb(0.8)}
    soils = {} if soil is None else {"fill": soil}
    live = Load(force={"axle": EdgeForce((0.0, -1e3), -1.0)})
    scene = on_ground(model, coulomb(0.8), live=live, foundations=springs, soil=soils, **options)
    return replace(scene, solve=SolveOptions(fast=True, tolerance=1e-8))


def test_soil_behind_an_arch_carries():
    """Passive pressure holds the back: with it more than with the active one, and than without."""
    fill = Soil("extrados", 2.3, UNIT, 30.0)
    whole = limit_load(shallow_arch(fill))
    weak = limit_load(shallow_arch(replace(fill, passive=LEAST)))
    assert whole.status == weak.status == "limit"
    assert whole.load_factor > 1.5 * weak.load_factor > 0.0
    engine = SolveOptions(engine="faces", gap=1e-4)
    faces = limit_load(replace(shallow_arch(fill), solve=engine))
    assert faces.load_factor <= whole.bounds.upper * (1.0 + 1e-6)
    assert faces.bounds.upper == pytest.approx(whole.bounds.upper, rel=1e-6)


def test_arch_in_soil_by_the_power_of_its_mechanism():
    """lambda = what weights and soil take up in the mode, where hinges do not slide.

    The power of the soil, int max(k_p s w, k_a s w), by a thousand places on every side.
    """
    fill = Soil("extrados", 2.3, UNIT, ANGLE)
    scene = shallow_arch(fill)
    scene = replace(
        scene,
        joints={"default": coulomb(3.0)},
        foundations={"springings": coulomb(3.0)},
    )
    result = limit_load(scene)
    blocks, boundary = result.blocks, result.layout.boundary
    mode, turn, centre = (blocks[name] for name in ("mode", "mode_rotation", "centre"))
    area = blocks["area"]
    taken = float(np.sum(STONE.density * GRAVITY * area * mode[:, 1]))
    part = (np.arange(1000) + 0.5) / 1000.0
    for row in np.flatnonzero(boundary.in_group("extrados")):
        (first, second), (across, up) = boundary.points[row, :2], boundary.normal[row]
        place = first + part[:, None] * (second - first)
        arm = place - centre[boundary.body[row]]
        body = boundary.body[row]
        x, y = mode[body][:, None] + turn[body] * np.stack([-arm[:, 1], arm[:, 0]])
        into = x * np.sign(across)
        stress = UNIT * (2.3 - place[:, 1])
        level = stress * abs(across) * np.where(into > 0.0, MOST, LEAST) * into
        taken += boundary.length[row] * float(np.mean(level + stress * max(up, 0.0) * y))
    assert result.load_factor == pytest.approx(taken, rel=1e-4)
    assert result.bounds.lower == pytest.approx(result.load_factor, rel=1e-4)


def test_soil_at_rest_is_between_its_bounds():
    state = equilibrium(block(0.3), 0.0)
    assert state.status == "equilibrium"


def test_what_check_says():
    text = description(Discretization(block(0.3)).layout)
    assert "soil bank: on right, surface at 0.8 m, k_a 0.3333, k_p 3, presses with" in text


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"at": "none"}, r"soil.bank.at = 'none': .* has no one-dimensional group"),
        ({"at": "base"}, "facets touch another block or the ground"),
        ({"level": -1.0}, "no side of 'right' is below the surface"),
        ({"friction_angle": None}, "give friction_angle, or both active and passive"),
        ({"active": 4.0}, "active = 4 must not exceed passive = 3"),
        ({"wall_friction": 40.0}, "wall_friction = 40 must not exceed friction_angle"),
    ],
)
def test_messages(change, text):
    with pytest.raises(InputError, match=text):
        soil = Soil("right", 0.8, UNIT, ANGLE)
        Discretization(block(0.3, soil=replace(soil, **change)))


@pytest.mark.parametrize(("level", "cells"), each_once([1.5, 2.15, 2.7, 3.9], [1.0, 2.0]))
def test_pile_turns_between_soils_whatever_its_cells(level, cells):
    """It turns about a place at the height c, 0 < c < level, and lifts about its toe.

    Soil on both sides resists with (k_p - k_a) s |y - c|; least of all over c.
    """
    edges = sides(base=(0, 0, 0.6, 0), left=(0, 0, 0, 4), right=(0.6, 0, 0.6, 4))
    model = polygons([rectangle(0.0, 0.0, 0.6, 4.0)], cells, groups=edges)
    soil = {name: Soil(name, level, UNIT, active=0.271, passive=3.69) for name in ("left", "right")}
    force = 1e4
    live = Load(force={"top": EdgeForce((force, 0.0), 0.0, 4.0)})
    scene = on_ground(model, JointLaw("frictionless"), live=live, soil=soil)
    y, step = np.linspace(0.0, level, 20001, retstep=True)
    places = np.linspace(0.0, level, 2001)
    resists = [(3.69 - 0.271) * UNIT * step * np.sum((level - y) * abs(y - c)) for c in places]
    lifts = STONE.density * GRAVITY * 0.6 * 4.0 * 0.3
    exact = np.min((np.array(resists) + lifts) / (4.0 - places)) / force
    result = limit_load(scene)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(exact, rel=1e-3)
