"""A retaining wall of dry stone: what surcharge on the earth behind it pushes it over.

The earth presses on the back with K times its weight above (dead load), a surcharge with K times
itself at all depths (live load). A wall of through stones is a stack: its limit is the least over
all bed joints of what slides there and what tips about the face. A wall of three stones through
the thickness falls apart earlier.
"""

from pathlib import Path

import numpy as np

from fenics_contact import BlockMesh, EarthPressure, JointLaw, Load, Material, Scene, limit_load
from fenics_contact.builders import retaining_wall

FOLDER = Path(__file__).parent / "output" / "retaining_wall"
HEIGHT, BASE, TOP, COURSES, FRICTION = 2.4, 1.2, 0.6, 8, 0.75
EARTH, STONE, K, SURCHARGE = 17e3, 22e3, 0.3, 1e3  # N/m3, N/m3, 1, Pa


def least_surcharge() -> float:
    """Factor on the surcharge at which through stones slide or tip at the weakest joint."""
    found = []
    for level in np.linspace(0.0, HEIGHT, COURSES, endpoint=False):
        depth, face = HEIGHT - level, (BASE - TOP) * level / HEIGHT
        # The part above: a rectangle at the back and a triangle at the face.
        weight = STONE * depth * np.array([TOP, 0.5 * (BASE - face - TOP)])
        centre = np.array([BASE - 0.5 * TOP, (face + 2.0 * (BASE - TOP)) / 3.0])
        push, surcharge = 0.5 * K * EARTH * depth**2, K * SURCHARGE * depth
        found.append((FRICTION * weight.sum() - push) / surcharge)
        found.append((weight @ (centre - face) - push * depth / 3.0) / (surcharge * depth / 2.0))
    return min(found)


def limit(stones: int) -> float:
    """Factor on the surcharge of a wall with so many stones through its thickness."""
    drawing = retaining_wall(HEIGHT, BASE, TOP, COURSES, stones)
    law = JointLaw("coulomb", FRICTION)
    scene = Scene(
        mesh=BlockMesh.from_model(drawing.mesh(size=0.15)),
        materials={"default": Material(young=5e9, poisson=0.2, density=STONE / 9.81)},
        dead=Load((0.0, -9.81), earth={"back": EarthPressure(HEIGHT, EARTH, coefficient=K)}),
        live=Load(traction={"back": (-K * SURCHARGE, 0.0)}),
        joints={"default": law},
        foundations={"base": law},
        title=f"Retaining wall, stones through its thickness: {stones}",
    )
    result = limit_load(scene)
    result.write(FOLDER / f"stones_{stones}")
    if result.status != "limit":
        raise SystemExit(f"{result.status}, should be a limit")
    return result.load_factor


through, exact, bonded = limit(1), least_surcharge(), limit(3)
if abs(through - exact) > 1e-5 * exact or bonded > through:
    raise SystemExit(f"through stones: {through}, should be {exact}; bonded: {bonded}, less")
print(f"through stones: a surcharge of {through * SURCHARGE / 1e3:.3f} kPa")
print(f"three stones through the thickness: {bonded * SURCHARGE / 1e3:.3f} kPa")
print(f"pictures: {FOLDER}/*/collapse.png")
