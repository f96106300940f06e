"""The seismic check of a facade that overturns: seen from the side, free, and held by an anchor.

The wall is a stack of courses as thick as itself, on the ground. Shaken out of its plane, it
overturns about its toe. An anchor that holds its top makes it bend instead, with a hinge at the
joint that needs the least push. The check divides the multiplier of the weights alpha0 by the
fraction e* of the mass that takes part and by the confidence factor (Circolare 7/2019,
C8.7.1.2.1). The third wall is free again, under a push that grows with the height.
"""

from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact import (
    BlockMesh,
    JointLaw,
    LimitLoad,
    Load,
    Material,
    OutputOptions,
    Scene,
    Seismic,
    Tie,
    limit_load,
)
from fenics_contact.meshing import wall

FOLDER = Path(__file__).parent / "output" / "seismic"
THICKNESS, COURSE, COURSES, ANCHOR = 0.6, 1.0, 6, 5.5  # m, m, 1, m
DENSITY, GRAVITY, CONFIDENCE = 1800.0, 9.81, 1.35  # kg/m3, m/s2, 1
HEIGHT = COURSE * COURSES


def activation(multiplier: float, mass: np.ndarray, displacement: np.ndarray) -> float:
    """a0*, in g, of rigid parts whose centres move by so much sideways."""
    fraction = (mass @ displacement) ** 2 / (mass.sum() * (mass @ displacement**2))
    return float(multiplier / (fraction * CONFIDENCE))


def overturning() -> tuple[float, float]:
    """alpha0 and a0* of the free wall: one part, that turns about its toe."""
    multiplier = THICKNESS / HEIGHT
    return multiplier, activation(multiplier, np.ones(1), np.ones(1))


def bending(hinge: float) -> tuple[float, float]:
    """Those of the wall that an anchor holds, with a hinge at this height.

    The part below turns by 1 about the toe, that above back by `turn` about the hinge, which is at
    the other face.
    """
    turn = hinge / (ANCHOR - hinge)
    mass = np.array([hinge, HEIGHT - hinge])
    sideways = np.array([hinge / 2.0, hinge - turn * (HEIGHT - hinge) / 2.0])
    lift = np.array([THICKNESS / 2.0, THICKNESS * (1.0 + turn / 2.0)])
    multiplier = float(mass @ lift / (mass @ sideways))
    return multiplier, activation(multiplier, mass, sideways)


def solved(name: str, title: str, **options: Any) -> LimitLoad:
    """The limit load of the wall, with its files."""
    law = JointLaw("coulomb", friction=0.7)
    given = {"live": Load(body=(GRAVITY, 0.0)), **options}
    scene = Scene(
        mesh=BlockMesh.from_model(wall([[1]] * COURSES, block=(THICKNESS, COURSE), elements=3)),
        materials={"default": Material(young=2e9, poisson=0.2, density=DENSITY)},
        dead=Load(body=(0.0, -GRAVITY)),
        joints={"default": law},
        foundations={"base": law},
        title=title,
        output=OutputOptions(paraview=False, report=True),
        **given,
    )
    result = limit_load(scene)
    result.write(FOLDER / name)
    return result


def agree(name: str, found: float, exact: float) -> None:
    """Leave where a number is not that by hand."""
    if not abs(found - exact) <= 1e-5 * exact:
        raise SystemExit(f"{name}: {found}, should be {exact}")


check = Seismic(confidence_factor=CONFIDENCE)
anchor = Tie((THICKNESS / 2.0, ANCHOR), yield_=1e6, ground=(-1.5, ANCHOR))
free = solved("free", "Facade, free", seismic=check)
held = solved("held", "Facade, held by an anchor", seismic=check, ties={"anchor": anchor})
joints = COURSE * np.arange(1, COURSES)
by_hand = {"free": overturning(), "held": min(map(bending, joints))}
for name, result in (("free", free), ("held", held)):
    multiplier, acceleration = by_hand[name]
    found = result.seismic["positive"]
    agree(f"{name}, alpha0", found.multiplier, multiplier)
    agree(f"{name}, a0*", found.acceleration_g, acceleration)
    if MPI.COMM_WORLD.rank == 0:
        star = f"e* = {found.mass_fraction:.4f}, a0* = {found.acceleration_g:.4f} g"
        print(f"{name}: alpha0 = {found.multiplier:.4f}, {star}, as by hand")

push = Load(body=(GRAVITY, 0.0), profile="triangular")
rising = solved("triangular", "Facade, free, push that grows with the height", live=push)
# The resultant of the push is at two thirds of the height.
agree("triangular", rising.load_factor, 0.75 * THICKNESS / HEIGHT)
if MPI.COMM_WORLD.rank == 0:
    print(f"push that grows with the height: {rising.load_factor:.4f} of the weight, as by hand")
    print(f"pictures: {FOLDER}/*/collapse.png")
