"""A dam in an earthquake: the pressure of the water is a load given as a UFL form.

Water at rest presses on the dam with rho g z at the depth z (dead load). When the ground shakes
with the acceleration a g, the dam is pushed by a times its weight, and the water presses with

    p = 7/8 a rho g sqrt(h z)     (H.M. Westergaard, Trans. ASCE 98 (1933) 418),

which no key of a scene describes. The limit is the least a for which the part above a joint slides
there or tips about its toe.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import ufl
from mpi4py import MPI

from fenics_contact import (
    BlockMesh,
    EarthPressure,
    JointLaw,
    Load,
    Material,
    OutputOptions,
    Scene,
    limit_load,
)
from fenics_contact.meshing import polygons

FOLDER = Path(__file__).parent / "output" / "form_load"
HEIGHT, WIDTH, LIFTS, FRICTION = 4.0, 3.0, 4, 1.0  # m, m, 1, 1
GRAVITY, WATER, CONCRETE = 9.81, 9810.0, 2400.0  # m/s2, N/m3, kg/m3


def westergaard(v, dx, ds):
    """Virtual work of the water's pressure for a = 1, against the normal of the face "water"."""
    domain = ds.ufl_domain()
    depth = HEIGHT - ufl.SpatialCoordinate(domain)[1]
    pressure = 0.875 * WATER * ufl.sqrt(HEIGHT * abs(depth))  # abs: rounding at the top
    face = ds(degree=12)("water")  # the root is no polynomial
    return -pressure * ufl.inner(ufl.FacetNormal(domain), v) * face


def least_acceleration() -> float:
    """Least a at which the part above a joint slides or tips, by statics."""
    depth = HEIGHT * np.arange(1, LIFTS + 1) / LIFTS
    weight = CONCRETE * GRAVITY * WIDTH * depth
    shaken = 0.875 * WATER * np.sqrt(HEIGHT)
    slides = (FRICTION * weight - WATER * depth**2 / 2.0) / (weight + shaken * depth**1.5 / 1.5)
    moment = weight * depth / 2.0 + shaken * depth**2.5 * 4.0 / 15.0
    tips = (weight * WIDTH / 2.0 - WATER * depth**3 / 6.0) / moment
    return float(min(slides.min(), tips.min()))


levels = np.linspace(0.0, HEIGHT, LIFTS + 1)
lifts = [[(0.0, low), (WIDTH, low), (WIDTH, high), (0.0, high)] for low, high in pairwise(levels)]
edges = {"base": [((0.0, 0.0), (WIDTH, 0.0))], "water": [((0.0, 0.0), (0.0, HEIGHT))]}
law = JointLaw("coulomb", FRICTION)
scene = Scene(
    mesh=BlockMesh.from_model(polygons(lifts, 0.25, groups=edges)),
    materials={"default": Material(young=2e10, poisson=0.2, density=CONCRETE)},
    dead=Load((0.0, -GRAVITY), earth={"water": EarthPressure(HEIGHT, WATER)}),
    live=Load((GRAVITY, 0.0), form=westergaard),
    joints={"default": law},
    foundations={"base": law},
    title="A dam in an earthquake",
    output=OutputOptions(pictures="all"),
)
result = limit_load(scene)
result.write(FOLDER)
exact = least_acceleration()
if result.status != "limit" or abs(result.load_factor - exact) > 1e-5 * exact:
    raise SystemExit(f"{result.status} {result.load_factor}, should be {exact}")
if MPI.COMM_WORLD.rank == 0:
    print(f"the dam stands up to {result.load_factor:.6f} g, by statics {exact:.6f} g")
    print(f"pictures: {FOLDER}/collapse.png, thrust.png, stress.png")
