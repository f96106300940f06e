"""Joints with a tensile strength that stays: hand values, forces, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fenics_contact import InputError, JointLaw, Load, Scene, SolveOptions, equilibrium, limit_load
from fenics_contact.meshing import polygons
from tests.bank import GRAVITY, PUSH, WEIGHT, wall_recipe
from tests.helpers import STONE, mesh_of, on_ground

STRENGTH, FRICTION = 2e5, 0.6
WEIGHT_OF_1 = STONE.density * GRAVITY


def bonded(strength: float = STRENGTH, **more: Any) -> JointLaw:
    """A bond that shears off later than it opens."""
    return JointLaw(friction=FRICTION, cohesion=10.0 * strength, tensile_strength=strength, **more)


def cantilever(law: JointLaw, sign: float = 1.0, degree: int = 1) -> Scene:
    """Three blocks of 1 m x 1 m in a row, bonded to a wall and to each other."""
    ends = [(sign * k, sign * (k + 1.0)) for k in range(3)]
    blocks = [[(a, 0.0), (b, 0.0), (b, 1.0), (a, 1.0)] for a, b in ends]
    model = polygons(blocks, 0.25, groups={"wall": [((0.0, 0.0), (0.0, 1.0))]})
    return Scene(
        mesh_of(model),
        {"default": STONE},
        live=Load((0.0, -GRAVITY)),
        dead=WEIGHT,
        joints={"default": law},
        foundations={"wall": law},
        degree=degree,
        solve=SolveOptions(fast=True),
    )


@pytest.mark.mpi
@pytest.mark.parametrize(("sign", "degree"), [(1.0, 1), (-1.0, 1), (1.0, 2)])
def test_cantilever_of_blocks(sign, degree):
    """The bond at the wall is torn about its lower end: (1 + lambda) w l^2 h / 2 = t h^2 / 2."""
    result = limit_load(cantilever(bonded(), sign, degree))
    assert result.status == "limit"
    expected = STRENGTH / (9.0 * WEIGHT_OF_1) - 1.0
    assert result.load_factor == pytest.approx(expected, rel=1e-7)
    assert result.bounds.meet and result.bounds.upper == pytest.approx(expected, rel=1e-9)
    joints = result.joints
    wall = joints["group"] == "wall"
    length, pressure = joints["length"][wall], joints["pressure"][wall]
    assert pressure.min() == pytest.approx(-STRENGTH, rel=1e-6)
    assert length @ pressure == pytest.approx(0.0, abs=1e-5 * STRENGTH)
    assert np.count_nonzero(joints["state"][wall]) == 1  # the hinge
    assert np.mean(joints["state"][~wall] == 2) > 0.7  # but for corners, where the bond yields


def test_without_its_bond_the_cantilever_falls():
    assert limit_load(cantilever(JointLaw(friction=FRICTION))).status == "unstable"
    weaker = 9.0 * WEIGHT_OF_1
    assert limit_load(cantilever(bonded(0.99 * weaker))).status == "unstable"
    assert limit_load(cantilever(bonded(1.01 * weaker))).load_factor == pytest.approx(0.01)


@pytest.mark.parametrize("law", [bonded(), JointLaw("frictionless", tensile_strength=STRENGTH)])
def test_block_that_hangs_from_a_ceiling(law):
    model = polygons(
        [[(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]],
        0.5,
        groups={"top": [((0.0, 1.0), (2.0, 1.0))]},
    )
    scene = Scene(
        mesh_of(model),
        {"default": STONE},
        dead=WEIGHT,
        live=WEIGHT,
        foundations={"top": law},
    )
    result = limit_load(scene)
    assert result.load_factor == pytest.approx(STRENGTH / WEIGHT_OF_1 - 1.0, rel=1e-7)
    state = equilibrium(scene, 0.5 * result.load_factor)
    assert state.status == "equilibrium"
    force = state.joints["length"] @ state.joints["pressure"]
    weight = 2.0 * WEIGHT_OF_1 * (1.0 + 0.5 * result.load_factor)
    assert force == pytest.approx(-weight, rel=1e-7)
    assert np.all(state.joints["pressure"] < 0.0)
    assert equilibrium(scene, 1.01 * result.load_factor).status == "no_equilibrium"


def block(law: JointLaw, width: float, height: float, live: Load = PUSH) -> Scene:
    corners = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)]
    return on_ground(polygons([corners], 0.25), law, live=live)


@pytest.mark.mpi
@pytest.mark.parametrize("dilatancy", [0.0, 10.0])
def test_block_that_tips_tears_its_bond_and_one_that_slides_does_not(dilatancy):
    law = bonded(2e4, dilatancy=dilatancy)
    slender = limit_load(block(law, 0.5, 2.0))
    expected = 0.25 + 2e4 * 0.5 / (2.0 * 2.0 * WEIGHT_OF_1)
    assert slender.load_factor == pytest.approx(expected, rel=1e-7)
    law = replace(law, cohesion=FRICTION * 2e4)
    flat = limit_load(block(law, 2.0, 0.25))
    sliding = FRICTION + FRICTION * 2e4 / (0.25 * WEIGHT_OF_1)
    assert flat.load_factor == pytest.approx(sliding, rel=1e-7)


def test_bonds_hold_walls_together():
    """Each pascal counts; without cohesion beyond the least the load factor is lower."""
    factors = []
    for strength, cohesion in ((0.0, 0.0), (1e3, 650.0), (1e3, 1e3)):
        law = JointLaw(friction=0.65, cohesion=cohesion, tensile_strength=strength)
        result = limit_load(wall_recipe("W4", law).scene(1))
        assert result.status == "limit"
        assert result.bounds.lower <= result.load_factor <= result.bounds.upper
        factors.append(result.load_factor)
    assert np.all(np.diff(factors) > 0.0)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: JointLaw(friction=0.6, tensile_strength=1e5), "cohesion of at least .* 60000 Pa"),
        (lambda: JointLaw("frictionless", tensile_strength=-1.0), "tensile_strength = -1.0"),
        (lambda: bonded(gap=1e-3), "a joint with a gap takes no tensile_strength"),
        (
            lambda: cantilever(bonded(compressive_strength=1e6)),
            "joints.default.tensile_strength, foundations.wall.tensile_strength: joints that crush",
        ),
    ],
)
def test_what_is_refused(wrong, words):
    with pytest.raises(InputError, match=words):
        wrong()
