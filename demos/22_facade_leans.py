"""A facade with side walls leans out of its plane until nothing of the load is left."""

from pathlib import Path

from fenics_contact.spatial import (
    JointLaw,
    Load,
    Material,
    OutputOptions,
    Scene,
    SolveOptions,
    builders,
    limit_load,
)

FOLDER = Path(__file__).parent / "output" / "facade_leans"
GRAVITY = 9.81  # m/s2

scene = Scene(
    title="Facade with side walls",
    blocks=builders.facade(length=3.0, side=1.5, height=2.4, thickness=0.4, brick=(0.6, 0.4)),
    materials={"default": Material(density=1800.0)},
    joints={"default": JointLaw(friction=0.6)},
    dead=Load(body=(0.0, 0.0, -GRAVITY)),
    live=Load(body=(0.0, -GRAVITY, 0.0)),
    solve=SolveOptions(quick=True, beyond=True),
    output=OutputOptions(paraview=False),
)
result = limit_load(scene)
result.write(FOLDER)
print(result.summary())
way = result.collapse.beyond
print(way.checks)
if not (
    way.agrees and way.zero and abs(way.fine.points[0].load_factor - result.load_factor) < 1e-6
):
    raise SystemExit("both paths should begin at the limit and come to one end")

print(f"pictures: {FOLDER}/beyond.png")
