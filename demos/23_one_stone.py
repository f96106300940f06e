"""A lintel over a door: its stresses as the wall falls, and the way to them in ParaView."""

from pathlib import Path

from fenics_contact.spatial import (
    JointLaw,
    Load,
    Material,
    OutputOptions,
    Scene,
    builders,
    limit_load,
)

FOLDER = Path(__file__).parent / "output" / "one_stone"
GRAVITY = 9.81  # m/s2

scene = Scene(
    title="Wall with a door",
    blocks=builders.wall(
        length=3.0, height=3.0, thickness=0.4, brick=(0.6, 0.3), openings=((1.2, 2.1, 0.0, 2.1),)
    ),
    materials={"default": Material(young=2e10, density=2000.0, tensile_strength=3e6)},
    joints={"default": JointLaw(friction=0.6)},
    dead=Load(body=(0.0, 0.0, -GRAVITY)),
    live=Load(body=(GRAVITY, 0.0, 0.0)),
    output=OutputOptions(stress=True),
)
result = limit_load(scene)
result.write(FOLDER)
print(result.summary())
stresses = result.stress
numbers = {one.name: number for number, one in enumerate(stresses.blocks)}
blocks = result.structure.blocks
lintel = next(one for one in stresses.blocks if blocks[one.block].group == "lintels")
tension, place = lintel.tension
print(f"{lintel.name}: tension up to {1e-6 * tension:.3g} MPa at {place}")
print(f"ParaView: {FOLDER}/stresses.vtu, filter Threshold, block = {numbers[lintel.name]}")
if not lintel.missing < 1e-6:
    raise SystemExit("the forces of a stone should balance")
