"""An arch of voussoirs: how much of its weight it stands sideways, and how thin it can be.

The weight acting sideways breaks it at 0.15047 of the weight (rigid blocks). The thinnest
semicircle of 27 voussoirs has t / R = 0.106721 (Cocchetti, Rizzi, Frattura ed Integrita
Strutturale 51 (2020) 356-375).
"""

from pathlib import Path

from fenics_contact import BlockMesh, JointLaw, Load, Material, OutputOptions, Scene, limit_load
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import arch

FOLDER = Path(__file__).parent / "output" / "arch"


def arch_scene(voussoirs: int, thickness: float, elements: int) -> Scene:
    """A semicircle of radius 1 m on rigid ground."""
    law = JointLaw("coulomb", friction=1.0)
    return Scene(
        mesh=BlockMesh.from_model(arch(voussoirs, thickness, elements=elements)),
        materials={"default": Material(young=5e9, poisson=0.2, density=2400.0)},
        dead=Load(body=(0.0, -9.81)),
        live=Load(body=(9.81, 0.0)),
        joints={"default": law},
        foundations={"springings": law},
        title=f"Arch of {voussoirs} voussoirs, t/R = {thickness}",
        output=OutputOptions(pictures="all"),
    )


def stands(thickness: float) -> bool:
    """Whether 27 rigid voussoirs of this thickness carry their weight."""
    with Discretization(arch_scene(27, thickness, elements=1)) as blocks:
        return RigidBlocks.of(blocks).stands()


result = limit_load(arch_scene(15, 0.15, elements=4))
result.write(FOLDER)
if abs(result.load_factor - 0.15047) > 1e-5:
    raise SystemExit(f"load factor {result.load_factor}, should be 0.15047")
print(f"15 voussoirs, t/R = 0.15: falls sideways at {result.load_factor:.5f} of its weight")

thin, thick = 0.1, 0.12
while thick - thin > 1e-6:
    middle = 0.5 * (thin + thick)
    thin, thick = (thin, middle) if stands(middle) else (middle, thick)
if abs(thick - 0.106721) > 2e-6:
    raise SystemExit(f"least thickness {thick}, should be 0.106721")
print(f"27 voussoirs: the thinnest that stands has t/R = {thick:.6f}")
print(f"pictures: {FOLDER}/collapse.png, thrust.png")
