"""Ties, anchors and cables: hand values of their forces and of load factors, ranks, messages."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import (
    InputError,
    Load,
    Material,
    Scene,
    SolveOptions,
    Tie,
    equilibrium,
    limit_load,
    sweep,
)
from fenics_contact.meshing import polygons
from fenics_contact.results.values import tie_arrays
from tests.bank import GRAVITY
from tests.helpers import STONE, coulomb, mesh_of, on_ground
from tests.quick import each_once
from tests.vtu import values_of

#: Weight of a square metre, N per metre of thickness.
UNIT = STONE.density * GRAVITY
FRICTION = 0.4
BOTH = SolveOptions(direction="both", fast=True)

#: Tie arguments that change forces on the way, but not the collapse of a tie that stretches.
ELASTIC: list[dict[str, float]] = [{}, {"stiffness": 1e6}, {"stiffness": 1e6, "prestress": 4e3}]


def flat() -> Any:
    """A block of 2 m x 0.5 m."""
    return polygons([[(0.0, 0.0), (2.0, 0.0), (2.0, 0.5), (0.0, 0.5)]], 0.25)


def pier() -> Any:
    """A block of 0.5 m x 2 m."""
    lines = {"base": [((0.0, 0.0), (0.5, 0.0))], "left": [((0.0, 1.0), (0.0, 2.0))]}
    corners = [(0.0, 0.0), (0.5, 0.0), (0.5, 2.0), (0.0, 2.0), (0.0, 1.0)]
    return polygons([corners], 0.25, groups=lines)


def two(gap: float = 0.0) -> Any:
    """Two blocks of 1 m x 0.5 m beside each other."""
    lines = {
        "base": [((0.0, 0.0), (1.0, 0.0)), ((1.0 + gap, 0.0), (2.0 + gap, 0.0))],
        "right": [((2.0 + gap, 0.0), (2.0 + gap, 0.5))],
        "top": [((0.0, 0.5), (1.0, 0.5)), ((1.0 + gap, 0.5), (2.0 + gap, 0.5))],
    }
    blocks = [[(x, 0.0), (x + 1.0, 0.0), (x + 1.0, 0.5), (x, 0.5)] for x in (0.0, 1.0 + gap)]
    return polygons(blocks, 0.25, groups=lines)


def tied(model: Any, tie: Tie, friction: float = FRICTION, **options: Any) -> Scene:
    return on_ground(model, coulomb(friction), ties={"north": tie}, **options)


def agrees(found: Any, expected: float) -> None:
    """The state, both programs and the certificate have a value that is known by hand."""
    assert found.certificate.passed
    values = [found.load_factor, found.bounds.upper]
    values += [found.certificate.static_factor, found.certificate.kinematic_factor]
    assert values == pytest.approx([expected] * len(values), rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("elastic", ELASTIC)
def test_anchored_block_slides(elastic):
    """lambda W = F W + Y away from the anchor, and F W towards it, where the tie goes slack."""
    force = 5e3
    tie = Tie((0.3, 0.2), force, ground=(-3.0, 0.2), **elastic)
    result = limit_load(tied(flat(), tie, solve=BOTH))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(FRICTION + force / UNIT, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(-FRICTION, rel=1e-6)
    for end, tension in ((result.positive, force), (result.negative, 0.0)):
        agrees(end, end.load_factor)
        assert end.bounds.lower == pytest.approx(end.load_factor, rel=1e-6)
        assert tie_arrays(result.layout, end.joints)["force"] == pytest.approx(
            [tension], abs=1e-6 * force
        )
    assert result.ties["state"] == [2]
    assert tie_arrays(result.layout, result.negative.joints)["state"] == [0]


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("place", [(0.12, 1.87), (0.0, 1.93), (0.0, 2.0)])
def test_pier_held_by_an_inclined_anchor_rocks(place, degree):
    """About its toe, by hand: in a block, on its edge, and at its corner."""
    force, ground = 3e3, (-1.5, 0.0)
    along = np.subtract(ground, place) / math.dist(ground, place)
    arm = np.subtract(place, (0.5, 0.0))
    moment = force * (arm[0] * along[1] - arm[1] * along[0])
    tie = Tie(place, force, ground=ground, stiffness=1e6, prestress=1e3)
    result = limit_load(tied(pier(), tie, friction=2.0, degree=degree))
    assert result.status == "limit"
    agrees(result.positive, 0.25 + moment / UNIT)
    assert result.ties["force"] == pytest.approx([force], rel=1e-6)


def test_pier_with_an_anchor_whose_toe_crushes(recwarn):
    """About the middle of the block of pressure, N / f_c wide, with N the weight."""
    force = 3e3
    strength = 1e6
    scene = tied(pier(), Tie("left", force, ground=(-2.0, 1.5)), friction=2.0)
    stone = replace(STONE, compressive_strength=strength)
    result = limit_load(replace(scene, materials={"default": stone}))
    lever = 0.25 - 0.5 * UNIT / strength
    assert result.load_factor == pytest.approx(lever + 1.5 * force / UNIT, rel=1e-6)
    assert not [one for one in recwarn if "invalid value" in str(one.message)]


@pytest.mark.mpi
def test_pier_held_at_a_group_rocks():
    """The force acts at the middle of the group."""
    force = 3e3
    tie = Tie("left", force, ground=(-2.0, 1.5))
    result = limit_load(tied(pier(), tie, friction=2.0))
    agrees(result.positive, 0.25 + 1.5 * force / UNIT)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("force", "ends"), each_once([1e3, 3e3, 2e4], [((0.7, 0.25), "right"), ("right", (0.7, 0.25))])
)
def test_two_blocks_tied_over_a_crack(force, ends):
    """The tie takes the other block along, or yields before."""
    slides = FRICTION * 0.5 * UNIT
    tie = Tie(ends[0], force, to=ends[1], stiffness=1e7)
    result = limit_load(tied(two(), tie, live=Load(traction={"right": (1e4, 0.0)})))
    carried = min(force, slides)
    assert result.status == "limit"
    agrees(result.positive, (slides + carried) / 5e3)
    assert result.ties["force"] == pytest.approx([carried], rel=1e-6)
    assert result.ties["state"] == [2 if force < slides else 1]


def test_prestress_that_clamps_a_joint():
    """A tie across a joint that slides does not stretch: lambda = F (1 + t / W), t near P."""
    tie = Tie((1.0, 0.4), 5e4, ground=(1.0, -3.0), stiffness=1e6)
    table = sweep(tied(flat(), tie), {"ties.north.prestress": [0.0, 1e4, 4e4]})
    factors = [point.load_factor for point in table]
    assert factors == pytest.approx([FRICTION * (1.0 + p / UNIT) for p in (0, 1e4, 4e4)], rel=1e-3)
    result = limit_load(tied(flat(), replace(tie, prestress=4e4)))
    tension = float(result.ties["force"][0])
    assert result.load_factor == pytest.approx(FRICTION * (1.0 + tension / UNIT), rel=1e-6)
    assert result.load_factor == pytest.approx(factors[-1], rel=1e-6)
    assert result.ties["state"] == [1]


@pytest.mark.mpi
def test_equilibrium_of_a_tie_by_hand():
    """A stiff block on smooth ground hangs on its tie: t = lambda Q, e = (t - P) / k."""
    stiff = Material(1e14, 0.2, 2000.0)
    lines = {"base": [((0.0, 0.0), (2.0, 0.0))], "right": [((2.0, 0.0), (2.0, 0.5))]}
    model = polygons([[(0.0, 0.0), (2.0, 0.0), (2.0, 0.5), (0.0, 0.5)]], 0.25, groups=lines)
    tie = Tie((0.0, 0.25), 2e4, ground=(-1.0, 0.25), stiffness=1e6, prestress=2e3)
    live = Load(traction={"right": (2e4, 0.0)})
    scene = tied(model, tie, friction=0.0, live=live)
    scene = replace(scene, materials={"default": stiff})
    for factor in (0.1, 0.5, 1.5):
        found = equilibrium(scene, factor)
        assert found.status == "equilibrium"
        tension = factor * 1e4
        stretched = (tension - 2e3) / 1e6
        assert found.ties["force"] == pytest.approx([tension], rel=1e-6)
        assert found.ties["elongation"] == pytest.approx([stretched], rel=1e-6)
        assert found.blocks["displacement"][0, 0] == pytest.approx(stretched, rel=1e-6)
    assert equilibrium(scene, 2.1).status == "no_equilibrium"
    assert limit_load(scene).load_factor == pytest.approx(2.0, rel=1e-6)


def test_force_is_that_of_the_elongation_after_a_tie_was_slack():
    """Steps that load and unload end where one step does: the law is one of the elongation."""
    tie = Tie((0.3, 0.2), 5e3, ground=(-3.0, 0.2), stiffness=1e6)
    scene = tied(flat(), tie)
    one, many = (equilibrium(scene, 0.5, steps) for steps in (1, 7))
    assert one.status == many.status == "equilibrium"
    assert many.ties["force"] == pytest.approx(one.ties["force"], rel=1e-6)


def test_load_steps_keep_what_yielded():
    scene = tied(
        flat(),
        Tie((0.3, 0.2), 5e3, ground=(-3.0, 0.2), stiffness=1e6, prestress=1e3),
        solve=SolveOptions(control="load", slip="load-steps"),
    )
    result = limit_load(scene)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(FRICTION + 5e3 / UNIT, rel=1e-6)


@pytest.mark.parametrize("method", ["monolithic", "fixed-point"])
def test_methods_agree(method):
    tie = Tie((0.3, 0.2), 5e3, ground=(-3.0, 0.2), stiffness=1e6)
    result = limit_load(tied(flat(), tie, solve=SolveOptions(method=method)))
    assert result.load_factor == pytest.approx(FRICTION + 5e3 / UNIT, rel=1e-6)


def test_ties_with_a_spacing_are_given_one_by_one():
    tie = Tie((0.3, 0.2), 5e3, ground=(-3.0, 0.2), stiffness=1e6, prestress=1e3)
    one = Tie((0.3, 0.2), 1e4, ground=(-3.0, 0.2), stiffness=2e6, prestress=2e3, spacing=2.0)
    found, again = (limit_load(tied(flat(), each)) for each in (tie, one))
    assert again.load_factor == pytest.approx(found.load_factor, rel=1e-9)
    assert again.ties["force"] == pytest.approx(found.ties["force"], rel=1e-9)


@pytest.mark.mpi
def test_group_on_two_blocks_has_a_bar_to_each():
    """An anchor straight above the middle of both tops that holds what a push at 45 degrees lifts.

    Both bars are alike by symmetry, and the blocks lift off under a live load upwards.
    """
    force = 2e3
    tie = Tie("top", force, ground=(1.0, -50.0))
    live = Load((0.0, GRAVITY))
    result = limit_load(tied(two(), tie, live=live))
    half = math.hypot(50.5, 0.5)
    held = force * 50.5 / half
    assert result.ties["name"].tolist() == ["north", "north"]
    assert result.load_factor == pytest.approx(1.0 + held / UNIT, rel=1e-6)
    assert result.ties["force"] == pytest.approx([0.5 * force] * 2, rel=1e-6)


def test_tie_holds_what_does_not_stand_alone():
    """A pier of which the dead load pulls the head, by hand: N = Q - M / h."""
    dead = Load((1.0 * GRAVITY, -GRAVITY))
    free = on_ground(pier(), coulomb(2.0), dead=dead)
    assert limit_load(free).status == "unstable"
    force = 3e4
    tie = Tie((0.0, 2.0), force, ground=(-1.0, 2.0))
    held = limit_load(tied(pier(), tie, friction=2.0, dead=dead))
    assert held.status == "limit"
    assert held.load_factor == pytest.approx(0.25 - 1.0 + 2.0 * force / UNIT, rel=1e-6)


def test_files_of_a_wall_with_a_tie(tmp_path):
    """ParaView's joints are those between blocks, whatever ties there are beside them."""
    result = limit_load(tied(flat(), Tie((0.0, 0.5), 5e3, ground=(-1.0, 0.5))))
    result.write(tmp_path)
    arrays = {one.get("Name"): one for one in ElementTree.parse(tmp_path / "joints.vtu").iter()}
    pressure = values_of(arrays["pressure"])
    assert len(pressure) == len(result.joints["pressure"])
    assert pressure == pytest.approx(result.joints["pressure"])


def test_wedged_load_is_bounded_by_no_tie():
    """A live load that friction carries in any size is unbounded with a tie as without one."""
    tie = Tie((1.0, 0.4), 5e3, ground=(1.0, -3.0), stiffness=1e6)
    pressing = Load((0.1 * GRAVITY, -GRAVITY))
    assert limit_load(tied(flat(), tie, live=pressing)).status == "unbounded"


@pytest.mark.parametrize(
    ("tie", "message"),
    [
        (Tie((0.3, 0.9), 1e3, to=(1.5, 0.2)), "north.from: there is no block at (0.3, 0.9)"),
        (Tie((0.3, 0.2), 1e3, to=(3.0, 0.2)), "north.to: there is no block at (3, 0.2)"),
        (Tie((1.0, 0.2), 1e3, to=(1.5, 0.2)), "is on a joint, of the blocks 0, 1"),
        (Tie((0.2, 0.2), 1e3, to=(0.8, 0.2)), "both ends are in one block"),
        (Tie((0.2, 0.2), 1e3, ground=(0.2, 0.2)), "a tie needs a length"),
    ],
)
def test_ends_that_are_wrong(tie, message):
    with pytest.raises(InputError) as error:
        limit_load(tied(two(), tie))
    assert message in str(error.value)
    assert "ties.north" in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"to": (1.0, 0.0), "ground": (1.0, 0.0)}, "either to or ground"),
        ({}, "either to or ground"),
        ({"to": (1.0, math.nan)}, "to = [1.0, nan] must be two finite numbers"),
        ({"to": "right", "yield_": 0.0}, "yield = 0.0 must be a positive number"),
        ({"to": "right", "stiffness": -1.0}, "stiffness = -1.0 must be a positive number"),
        ({"to": "right", "prestress": 2e3, "stiffness": 1e6}, "must not exceed yield"),
        ({"to": "right", "spacing": 0.0}, "spacing = 0.0 must be a positive number"),
        ({"to": 3.0}, "to = 3.0"),
    ],
)
def test_values_that_are_wrong(arguments, message):
    with pytest.raises(InputError) as error:
        Tie(**({"from_": (0.0, 0.0), "yield_": 1e3} | arguments))
    assert message in str(error.value)


def test_prestress_without_stiffness():
    with pytest.raises(InputError, match=r"ties\.north\.prestress needs stiffness"):
        tied(two(), Tie((0.2, 0.2), 1e3, to="right", prestress=10.0))


def test_group_that_the_mesh_lacks():
    with pytest.raises(InputError, match=r"ties\.north\.to = 'left'.* it has"):
        tied(two(), Tie((0.2, 0.2), 1e3, to="left"))


def test_methods_on_joint_forces_are_refused():
    with pytest.raises(InputError, match=r"ties\.north"):
        tied(two(), Tie((0.2, 0.2), 1e3, to="right"), solve=SolveOptions(method="splitting"))


def test_a_scene_file_and_its_tables():
    table = {"from": (0.3, 0.2), "ground": (-3.0, 0.2), "yield": 5e3, "stiffness": 1e6}
    usual = tied(flat(), Tie((0.3, 0.2), 5e3, ground=(-3.0, 0.2), stiffness=1e6))
    tables = usual.tables()
    assert tables["ties"] == {"north": table | {"prestress": 0.0}}
    again = Scene.from_tables(tables, lambda *_: usual.mesh)
    assert again.ties == usual.ties
    tables["ties"]["north"] |= {"yeild": 1.0}
    with pytest.raises(InputError, match=r"unknown key 'ties\.north\.yeild'; did you mean 'yield'"):
        Scene.from_tables(tables, lambda *_: usual.mesh)


@pytest.mark.mpi
def test_ranks_agree_with_one():
    def scene(comm: MPI.Comm) -> Scene:
        mesh = type(mesh_of(two())).from_model(two(), comm)
        ties = {
            "over": Tie("top", 1e3, ground=(-2.0, 1.5), stiffness=1e6, prestress=5e2),
            "crack": Tie((0.7, 0.25), 3e3, to="right", stiffness=1e7),
        }
        law = {"default": coulomb(FRICTION)}
        weight = Load((0.0, -GRAVITY))
        live = Load((GRAVITY, 0.0))
        stone = {"default": STONE}
        base = {"base": coulomb(FRICTION)}
        return Scene(mesh, stone, live, weight, joints=law, foundations=base, ties=ties)

    together, alone = (limit_load(scene(comm)) for comm in (MPI.COMM_WORLD, MPI.COMM_SELF))
    assert together.status == alone.status == "limit"
    assert together.load_factor == pytest.approx(alone.load_factor, rel=1e-7)
    assert together.ties["force"] == pytest.approx(alone.ties["force"], rel=1e-6)
