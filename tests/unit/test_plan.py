"""What a scene spares, and that it says so."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fenics_contact import JointLaw, Load, OutputOptions, Scene, SolveOptions
from fenics_contact.meshing import wall
from fenics_contact.results.result import skipped
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


@pytest.mark.parametrize(
    ("joint", "ground", "fixed_point", "shear"),
    [
        (coulomb(0.5), SMOOTH, True, True),
        (SMOOTH, coulomb(0.5), True, True),
        (tresca(1e3), coulomb(0.5), True, True),
        (tresca(1e3), SMOOTH, False, True),
        (coulomb(0.0), coulomb(0.0), False, False),
        (tresca(0.0), tresca(0.0), False, False),
        (SMOOTH, SMOOTH, False, False),
    ],
)
def test_fixed_point_and_shear_are_for_friction_only(full, joint, ground, fixed_point, shear):
    found = names(replace(full, joints={"default": joint}, foundations={"base": ground}))
    assert ("fixed point on the friction bound" in found) == (not fixed_point)
    assert ("shear forces" in found) == (not shear)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, []),
        ({"dead": Load()}, ["dead tractions", "dead body force"]),
        ({"live": PUSH}, ["live tractions"]),
        ({"live": Load(traction={"left": (1.0, 0.0)})}, ["live body force"]),
        ({"solve": SolveOptions(direction="positive")}, ["negative direction"]),
        ({"solve": SolveOptions(direction="negative")}, ["positive direction"]),
        ({"output": replace(EVERYTHING, capacity=0)}, ["capacity curve"]),
        ({"output": replace(EVERYTHING, paraview=False)}, ["stress recovery and ParaView files"]),
        ({"output": replace(EVERYTHING, pictures=False)}, ["pictures"]),
    ],
)
def test_what_is_not_given_or_not_asked_for(full, changes, expected):
    assert names(replace(full, **changes)) == expected
