"""A stack of blocks: the friction decides whether it slides at the bottom or tips as one."""

from pathlib import Path

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, limit_load
from fenics_contact.meshing import wall

BLOCK, COUNT = (0.5, 0.2), 4
FOLDER = Path(__file__).parent / "output" / "stack"

scenes = [
    Scene(
        mesh=BlockMesh.from_model(wall([[1.0]] * COUNT, block=BLOCK, elements=2)),
        materials={"default": Material(young=5e9, poisson=0.2, density=2400.0)},
        dead=Load(body=(0.0, -9.81)),
        live=Load(body=(9.81, 0.0)),
        joints={"default": JointLaw("coulomb", friction)},
        foundations={"base": JointLaw("coulomb", friction)},
        title=f"Stack, friction {friction}",
    )
    for friction in (0.3, 0.7)
]
for scene in scenes:
    friction = scene.joints["default"].friction
    exact = min(friction, BLOCK[0] / (COUNT * BLOCK[1]))
    result = limit_load(scene)
    result.write(FOLDER / f"friction_{friction}")
    if abs(result.load_factor - exact) > 1e-6 * exact:
        raise SystemExit(f"friction {friction}: {result.load_factor}, should be {exact}")
    print(f"friction {friction}: load factor {result.load_factor:.8f} = min(F, b / (n a))")
print(f"pictures: {FOLDER}/*/collapse.png")
