"""A facade of two storeys with six windows, pushed sideways as by an earthquake.

Its parts are groups, so that each can have its own material: in the second run the floors also
carry what stands on them, as density. Weight that pushes sideways does more harm than good.
"""

from pathlib import Path

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, limit_load
from fenics_contact.builders import facade

FOLDER = Path(__file__).parent / "output" / "facade"
STONE = {"young": 5e9, "poisson": 0.2}
mesh = BlockMesh.from_model(facade(storeys=2, bays=3, block=(1.0, 0.5)).mesh(size=0.25))
law = JointLaw("coulomb", friction=0.7)

found = []
for density in (2000.0, 8000.0):
    materials = {"default": Material(**STONE, density=2000.0)}
    scene = Scene(
        mesh=mesh,
        materials={**materials, "floors": Material(**STONE, density=density)},
        dead=Load(body=(0.0, -9.81)),
        live=Load(body=(9.81, 0.0)),
        joints={"default": law},
        foundations={"base": law},
        title=f"Facade, floors of {density:g} kg/m3",
    )
    result = limit_load(scene)
    result.write(FOLDER / f"floors_{density:g}")
    if result.status != "limit" or result.load_factor > result.bounds.upper:
        raise SystemExit(f"{result.status} {result.load_factor}, should be {result.bounds}")
    found.append(result.load_factor)
    print(f"floors of {density:g} kg/m3: falls at {found[-1]:.4f} of its weight, sideways")
if found[1] > found[0]:
    raise SystemExit("heavy floors should be worse")
print(f"pictures: {FOLDER}/*/collapse.png")
