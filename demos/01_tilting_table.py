"""A block on a tilting table: it slides at the friction angle or tips over its corner.

On a table tilted by an angle the weight has the components of a dead load and a horizontal load
in the ratio tan(angle); the block falls where that ratio reaches min(F, width / height).
"""

import math
from pathlib import Path

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, limit_load
from fenics_contact.meshing import polygons

WIDTH, HEIGHT = 0.4, 1.0
FOLDER = Path(__file__).parent / "output" / "tilting_table"


def tilt(friction: float) -> float:
    """Tangent of the angle at which the block falls."""
    corners = [(0.0, 0.0), (WIDTH, 0.0), (WIDTH, HEIGHT), (0.0, HEIGHT)]
    scene = Scene(
        mesh=BlockMesh.from_model(polygons([corners], size=0.1)),
        materials={"default": Material(young=1e9, poisson=0.2, density=2000.0)},
        dead=Load(body=(0.0, -9.81)),
        live=Load(body=(9.81, 0.0)),
        foundations={"base": JointLaw("coulomb", friction)},
        title=f"Tilting table, friction {friction}",
    )
    result = limit_load(scene)
    result.write(FOLDER / f"friction_{friction}")
    return result.load_factor


for friction in (0.2, 0.35, 0.45, 0.8):
    found, exact = tilt(friction), min(friction, WIDTH / HEIGHT)
    how = "slides" if friction < WIDTH / HEIGHT else "tips"
    if abs(found - exact) > 1e-6 * exact:
        raise SystemExit(f"friction {friction}: {found}, should be {exact}")
    print(f"friction {friction:4}: {how} at {math.degrees(math.atan(found)):.4f} degrees")
print(f"pictures: {FOLDER}/*/collapse.png")
