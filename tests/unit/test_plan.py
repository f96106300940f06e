"""What a scene spares, and that it says so."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fenics_contact import JointLaw, Load, OutputOptions, Scene, SolveOptions
from fenics_contact.analysis.history import History, Step
from fenics_contact.analysis.plan import skipped, skipped_iterations
from fenics_contact.meshing import wall
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


def names(scene: Scene) -> list[str]:
    """The things skipped, without the reasons."""
    return [item.split(":")[0] for item in skipped(scene)]


def test_scene_that_needs_everything(full):
    assert skipped(full) == ()


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
    assert ("fixed point on the friction bound" in names(scene)) == (not needed)


@pytest.mark.parametrize(
    ("law", "shear"),
    [(coulomb(0.5), True), (tresca(1.0), True), (coulomb(0.0), False), (tresca(0.0), False),
     (SMOOTH, False)],
)  # fmt: skip
def test_shear_is_for_friction_only(full, law, shear):
    scene = replace(full, joints={"default": law}, foundations={"base": law})
    assert ("shear forces" in names(scene)) == (not shear)


def test_loads_not_given(full):
    assert names(replace(full, dead=Load())) == ["dead tractions", "dead body force"]
    assert names(replace(full, live=PUSH)) == ["live tractions"]
    assert names(replace(full, live=Load(traction={"left": (1.0, 0.0)}))) == ["live body force"]


@pytest.mark.parametrize(
    ("direction", "other"), [("positive", "negative"), ("negative", "positive")]
)
def test_direction_not_asked_for(full, direction, other):
    scene = replace(full, solve=SolveOptions(direction=direction))
    assert skipped(scene) == (f"{other} direction: solve.direction = '{direction}'",)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"capacity": 0}, "capacity curve"),
        ({"paraview": False}, "stress recovery and ParaView files"),
        ({"pictures": False}, "pictures"),
    ],
)
def test_output_not_asked_for(full, change, expected):
    assert names(replace(full, output=replace(EVERYTHING, **change))) == [expected]


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
    items = skipped(bare)
    assert len(items) == len(set(items)) == 9
    for item in items:
        what, reason = item.split(": ", 1)
        assert what and reason


@pytest.mark.parametrize(
    ("histories", "spared"),
    [
        ([], False),
        ([("monolithic", 1)], True),
        ([("monolithic", 1), ("monolithic", 1)], True),
        ([("monolithic", 1), ("monolithic", 4)], False),
        ([("fixed-point", 1)], False),
    ],
)
def test_iterations_that_one_step_spared(histories, spared):
    step = Step(load_factor=1.0, bound_change=0.0, relaxation=1.0, factorizations=5)
    done = [History((step,) * count, method=method) for method, count in histories]
    assert bool(skipped_iterations(done)) == spared
