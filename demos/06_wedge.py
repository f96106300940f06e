"""A wedge pressed down between two blocks: the friction decides at what force they part.

With friction F = tan(phi) everywhere and half the angle at the tip a, the force is P / W =
2 F / (cot(a + phi) - F) with the weight W of one block; where cot(a + phi) < F the wedge locks.
"""

import math
from pathlib import Path

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, limit_load
from fenics_contact.meshing import wedge

ANGLE, HEIGHT, LENGTH, DENSITY, GRAVITY = math.radians(30.0), 0.5, 1.5, 2400.0, 9.81
HALF = HEIGHT * math.tan(ANGLE)  # half the width of the wedge
WEIGHT = DENSITY * GRAVITY * HEIGHT * (LENGTH - 0.5 * HALF)
FOLDER = Path(__file__).parent / "output" / "wedge"

for friction in (0.1, 0.2, 0.3, 0.8):
    law = JointLaw("coulomb", friction)
    scene = Scene(
        mesh=BlockMesh.from_model(wedge(30.0, HEIGHT, LENGTH, size=0.25)),
        materials={
            "blocks": Material(young=5e9, poisson=0.2, density=DENSITY),
            "wedge": Material(young=5e9, poisson=0.2),
        },
        dead=Load(body=(0.0, -GRAVITY)),
        live=Load(traction={"top": (0.0, -0.5 * WEIGHT / HALF)}),  # the weight of one block
        joints={"flanks": law},
        foundations={"base": law},
        title=f"Wedge between two blocks, friction {friction}",
    )
    result = limit_load(scene)
    if result.status == "limit":  # a locked wedge has no collapse to show
        result.write(FOLDER / f"friction_{friction}")
    play = 1.0 / math.tan(ANGLE + math.atan(friction)) - friction
    exact = 2.0 * friction / play if play > 0.0 else math.inf
    status = "limit" if play > 0.0 else "unbounded"
    if result.status != status or not math.isclose(result.load_factor, exact, rel_tol=1e-6):
        raise SystemExit(f"friction {friction}: {result.status} {result.load_factor}, not {exact}")
    print(f"friction {friction}: {result.status}, P / W = {result.load_factor:.8f}")
print(f"pictures: {FOLDER}/*/collapse.png")
