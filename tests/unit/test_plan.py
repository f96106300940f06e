"""What a scene spares, and that it says so."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fenics_contact import JointLaw, Load, OutputOptions, Scene, SolveOptions
from fenics_contact.meshing import wall
from fenics_contact.analysis.plan import make_plan
from tests.helpers import PUSH, coulomb, on_ground, tresca

SMOOTH = JointLaw("frictionless")
EVERYTHING = OutputOptions(paraview=True, pictures=True, capacity=5)


@pytest.fixture(scope="module")
def full() -> Scene:
    """A scene that needs everything there is."""
    return on_ground(
        wall([[1], [1]], elements=1),
        coulomb(0.5),
        dead=Load((0.0, -9.81), {"top": (0.0, -1e3)}),
        live=Load((9.81, 0.0), {"left": (1e3, 0.0)}),
        solve=SolveOptions(direction="both"),
        output=EVERYTHING,
    )


def skipped(scene: Scene) -> list[str]:
    """The things skipped, without the reasons."""
    return [item.split(":")[0] for item in make_plan(scene).skipped]


def test_scene_that_needs_everything(full):
    plan = make_plan(full)
    assert plan.coulomb
    assert plan.skipped == ()


@pytest.mark.parametrize(
    ("joint", "ground", "needed"),
    [
        (coulomb(0.5), SMOOTH, True),
        (SMOOTH, coulomb(0.5), True),
        (tresca(1e3), coulomb(0.5), True),
        (coulomb(0.0), coulomb(0.0), False),
        (tresca(1e3), SMOOTH, False),
        (SMOOTH, SMOOTH, False),
    ],
)
def test_fixed_point_is_for_coulomb_friction_only(full, joint, ground, needed):
    scene = replace(full, joints={"default": joint}, foundations={"base": ground})
    plan = make_plan(scene)
    assert plan.coulomb == needed
    assert ("fixed point on the friction bound" in skipped(scene)) == (not needed)


@pytest.mark.parametrize(
    ("law", "shear"),
    [(coulomb(0.5), True), (tresca(1.0), True), (coulomb(0.0), False), (tresca(0.0), False),
     (SMOOTH, False)],
)  # fmt: skip
def test_shear_is_for_friction_only(full, law, shear):
    scene = replace(full, joints={"default": law}, foundations={"base": law})
    assert ("shear forces" in skipped(scene)) == (not shear)


def test_loads_not_given(full):
    assert skipped(replace(full, dead=Load())) == ["dead tractions", "dead body force"]
    assert skipped(replace(full, live=PUSH)) == ["live tractions"]
    assert skipped(replace(full, live=Load(traction={"left": (1.0, 0.0)}))) == ["live body force"]


@pytest.mark.parametrize(
    ("direction", "other"), [("positive", "negative"), ("negative", "positive")]
)
def test_direction_not_asked_for(full, direction, other):
    scene = replace(full, solve=SolveOptions(direction=direction))
    assert make_plan(scene).skipped == (f"{other} direction: solve.direction = '{direction}'",)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"capacity": 0}, "capacity curve"),
        ({"paraview": False}, "stress recovery and ParaView files"),
        ({"pictures": False}, "pictures"),
    ],
)
def test_output_not_asked_for(full, change, expected):
    assert skipped(replace(full, output=replace(EVERYTHING, **change))) == [expected]


def test_every_item_gives_its_reason(full):
    bare = replace(
        full,
        dead=Load(),
        live=PUSH,
        joints={"default": SMOOTH},
        foundations={"base": SMOOTH},
        solve=SolveOptions(),
        output=OutputOptions(paraview=False, pictures=False, capacity=0),
    )
    items = make_plan(bare).skipped
    assert len(items) == len(set(items)) == 9
    for item in items:
        what, reason = item.split(": ", 1)
        assert what and reason
