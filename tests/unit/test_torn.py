"""Joints that lose cohesion and tensile strength where they open in the collapse."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import InputError, JointLaw, Load, OutputOptions, equilibrium, limit_load
from fenics_contact.meshing import polygons
from tests.bank import GRAVITY, Variant, wall_recipe
from tests.helpers import STONE, coulomb, on_ground
from tests.quick import slow

WEIGHT_OF_1 = STONE.density * GRAVITY


def bonded(strength: float, opened: str = "lost", friction: float = 0.65) -> JointLaw:
    return JointLaw(friction=friction, cohesion=strength, tensile_strength=strength, opened=opened)


def slender(law: JointLaw, direction: float = 1.0) -> object:
    """A block of 0.5 m x 2 m on the ground."""
    model = polygons([[(0.0, 0.0), (0.5, 0.0), (0.5, 2.0), (0.0, 2.0)]], 0.125)
    output = OutputOptions(paraview=False, pictures=False, report=True)
    return on_ground(model, law, live=Load((direction * GRAVITY, 0.0)), output=output)


@pytest.mark.mpi
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_block_that_has_torn_its_bond_tips_as_without(direction, tmp_path):
    result = limit_load(slender(bonded(2e4), direction))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.25, rel=1e-7)
    torn = result.positive.torn
    assert torn.load_factor_whole == pytest.approx(0.25 + 2e4 / (8.0 * WEIGHT_OF_1), rel=1e-7)
    assert torn.length_m == pytest.approx(0.5 - 0.0625)  # all but the hinge
    assert np.count_nonzero(result.joints["state"]) == 1
    assert "m of joints have lost their strength" in result.summary()
    result.write(tmp_path)
    if MPI.COMM_WORLD.rank == 0:
        record = json.loads((tmp_path / "result.json").read_text())
        assert record["torn"]["length_m"] == pytest.approx(torn.length_m)
        assert "with these joints torn" in (tmp_path / "report.html").read_text()


@pytest.mark.mpi
def test_blocks_that_do_not_stand_once_their_bond_is_torn():
    """A slender block that leans: its bond alone holds it."""
    model = polygons([[(0.0, 0.0), (0.5, 0.0), (1.5, 2.0), (1.0, 2.0)]], 0.125)
    result = limit_load(on_ground(model, bonded(1e5)))
    assert result.status == "no_equilibrium"
    assert "the blocks do not stand" in result.positive.reason
    kept = limit_load(on_ground(model, bonded(1e5, "kept")))
    assert kept.status == "limit" and kept.load_factor > 0.0
    assert result.positive.torn.load_factor_whole == pytest.approx(kept.load_factor, rel=1e-6)


def test_a_block_that_slides_tears_nothing():
    model = polygons([[(0.0, 0.0), (2.0, 0.0), (2.0, 0.25), (0.0, 0.25)]], 0.125)
    result = limit_load(on_ground(model, bonded(1e4)))
    assert result.load_factor == pytest.approx(0.65 + 1e4 / (0.25 * WEIGHT_OF_1), rel=1e-7)
    assert result.positive.torn.length_m == 0.0


@pytest.mark.parametrize("tension", [*slow(0.0), pytest.param(1e3, marks=pytest.mark.mpi)])
def test_a_wall_carries_less_once_its_joints_are_torn(tension):
    """But not less than with friction alone; cohesion may be lost by itself."""
    factors = {}
    for opened in ("kept", "lost"):
        law = JointLaw(friction=0.65, cohesion=2e3, tensile_strength=tension, opened=opened)
        result = limit_load(wall_recipe("W4", law).scene(1, variant=Variant(young=10.0)))
        assert result.status == "limit"
        assert result.bounds.lower <= result.load_factor <= result.bounds.upper
        factors[opened] = result.load_factor
        torn = result.positive.torn
    bare = limit_load(wall_recipe("W4", coulomb(0.65)).scene(1)).load_factor
    assert torn.length_m > 0.0
    assert torn.load_factor_whole == pytest.approx(factors["kept"], rel=1e-6)
    assert bare < factors["lost"] < 0.95 * factors["kept"]


def test_both_directions_tear_their_own_joints():
    scene = wall_recipe("W4", bonded(1e4)).scene(1, direction="both", lowest=True, error=True)
    result = limit_load(scene)
    whole = [end.torn.load_factor_whole for end in (result.positive, result.negative)]
    assert whole[0] > result.load_factor > 0.0 > result.load_factor_negative > whole[1]
    assert result.positive.peak.status == result.positive.lowest.status == "not_known"
    assert result.positive.hinges is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"control": "load"}, "solve.control = 'load'"),
        ({"states": "lowest"}, "solve.states = 'lowest'"),
        ({"accuracy": 1e-3}, "solve.accuracy"),
        ({"peak": True}, "solve.peak = true"),
    ],
)
def test_what_is_refused(options, words):
    with pytest.raises(InputError, match=f"default.opened.*cannot be used with {words}"):
        wall_recipe("W1", bonded(1e3)).scene(1, **options)


def test_a_state_at_a_load_factor_is_refused():
    with pytest.raises(InputError, match="equilibrium"):
        equilibrium(slender(bonded(2e4)), 0.1)
    with pytest.raises(InputError, match="opened = 'torn' must be one of kept, lost"):
        bonded(1e3, "torn")
