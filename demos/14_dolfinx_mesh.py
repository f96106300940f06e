"""A wall cut out of one dolfinx mesh: tags say which cell is of which stone.

    python3 14_dolfinx_mesh.py            or            mpirun -n 2 python3 14_dolfinx_mesh.py

The mesh is a rectangle that dolfinx made and distributed. Every stone has a number, all have one
name, and cells of two numbers share no node any more: that is `blocks="surfaces"`. The limit load
is that of the same wall made by gmsh.
"""

from pathlib import Path

import numpy as np
from dolfinx import mesh
from mpi4py import MPI

from fenics_contact import BlockMesh, JointLaw, Load, Material, OutputOptions, Scene, limit_load
from fenics_contact.meshing import running_bond

FOLDER = Path(__file__).parent / "output" / "dolfinx_mesh"
BRICKS, COURSES, LENGTH, HEIGHT = 3, 4, 0.4, 0.2  # m

comm = MPI.COMM_WORLD
size = BRICKS * LENGTH, COURSES * HEIGHT
cells = 4 * BRICKS, 2 * COURSES
wall = mesh.create_rectangle(comm, [(0.0, 0.0), size], cells, mesh.CellType.quadrilateral)

# The stone of a cell, ghosts too: courses begin with a whole brick and with a half one in turn.
index_map = wall.topology.index_map(2)
every = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
x, y, _ = mesh.compute_midpoints(wall, 2, every).T
course = np.floor(y / HEIGHT)
stone = 100 * course + np.floor(x / LENGTH + 0.5 * (course % 2))
cell_tags = mesh.meshtags(wall, 2, every, stone.astype(np.int32))

base = np.sort(mesh.locate_entities_boundary(wall, 1, lambda x: np.isclose(x[1], 0.0)))
facet_tags = mesh.meshtags(wall, 1, base, np.full(len(base), 1000, dtype=np.int32))

numbers = sorted(set().union(*comm.allgather(set(cell_tags.values.tolist()))))
names = dict.fromkeys(numbers, "stones") | {1000: "base"}


def load_factor(blocks: BlockMesh, folder: Path | None = None) -> float:
    """The push, over the weight, that brings the wall down."""
    law = JointLaw("coulomb", 0.65)
    scene = Scene(
        mesh=blocks,
        materials={"default": Material(young=5e9, poisson=0.2, density=2000.0)},
        dead=Load((0.0, -9.81)),
        live=Load((9.81, 0.0)),
        joints={"default": law},
        foundations={"base": law},
        title="A wall cut out of one mesh",
        output=OutputOptions(pictures="all"),
    )
    result = limit_load(scene)
    if folder:
        result.write(folder)
    return result.load_factor


cut = BlockMesh.from_dolfinx(wall, cell_tags, facet_tags, names, blocks="surfaces")
of_dolfinx = load_factor(cut, FOLDER)
gmsh_model = running_bond(BRICKS, COURSES, (LENGTH, HEIGHT), quadrilaterals=True)
of_gmsh = load_factor(BlockMesh.from_model(gmsh_model, comm))
if abs(of_dolfinx - of_gmsh) > 1e-9 * of_gmsh:
    raise SystemExit(f"load factor {of_dolfinx}, should be {of_gmsh}")
if comm.rank == 0:
    print(f"{cut.body_count} blocks, load factor {of_dolfinx:.9f}")
    print(f"pictures: {FOLDER}/collapse.png, thrust.png, stress.png")
