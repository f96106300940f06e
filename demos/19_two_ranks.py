"""One wall on several ranks, which share out its mesh, against the same on each rank alone.

mpirun -n 2 python3 demos/19_two_ranks.py
"""

from pathlib import Path

from mpi4py import MPI

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, SolveOptions, limit_load
from fenics_contact.meshing import running_bond

FOLDER = Path(__file__).parent / "output" / "two_ranks"
WORLD = MPI.COMM_WORLD


def wall(comm: MPI.Comm) -> Scene:
    """The scene with its mesh on the ranks of a communicator."""
    law = JointLaw("coulomb", friction=0.65)
    model = running_bond(bricks=3, courses=4) if comm.rank == 0 else None  # gmsh on one rank
    return Scene(
        mesh=BlockMesh.from_model(model, comm),
        materials={"default": Material(young=1.0e9, poisson=0.2, density=1019.368)},
        dead=Load(body=(0.0, -9.81)),
        live=Load(body=(9.81, 0.0)),
        joints={"default": law},
        foundations={"base": law},
        solve=SolveOptions(method="fixed-point"),
    )


together = limit_load(wall(WORLD))
alone = limit_load(wall(MPI.COMM_SELF))
cells = WORLD.gather(together.scene.mesh.domain.topology.index_map(2).size_local)
together.write(FOLDER)
if WORLD.rank == 0:
    print(f"cells by rank: {cells}")
    print(f"load factor {together.load_factor:.8f}, on one rank {alone.load_factor:.8f}")
if abs(together.load_factor - alone.load_factor) > 1e-6 * alone.load_factor:
    raise SystemExit("ranks disagree")
if WORLD.rank == 0:
    print(f"pictures: {FOLDER}/collapse.png")
