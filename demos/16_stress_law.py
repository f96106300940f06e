"""A pier of thin layers: the law of its brickwork in place of Young's modulus, and layer by layer.

Layers of stone and mortar share the strain along them and the stresses across them. Their mean is
an orthotropic law (G.E. Backus, J. Geophys. Res. 67 (1962) 4427), given here as a function that
UFL understands. The same pier with all its layers as cells of two materials, tagged in a dolfinx
mesh, settles alike. What tips it is a matter of statics, and does not depend on the law.
"""

from pathlib import Path

import numpy as np
import ufl
from dolfinx import mesh
from mpi4py import MPI

from fenics_contact import (
    BlockMesh,
    JointLaw,
    Load,
    Material,
    OutputOptions,
    Scene,
    equilibrium,
    limit_load,
)

FOLDER = Path(__file__).parent / "output" / "stress_law"
WIDTH, HEIGHT, LAYERS, PRESSURE, PUSH = 0.5, 2.0, 80, 1e6, 1e4  # m, m, 1, Pa, Pa
STONE = Material(young=2e10, poisson=0.2)
MORTAR = Material(young=1e9, poisson=0.2)  # every other layer


def layered(strain, material):
    """Stress of the layers, half stone and half mortar, in plane stress."""
    parts = STONE, MORTAR
    along = np.array([part.young / (1.0 - part.poisson**2) for part in parts])
    poisson = np.array([part.poisson for part in parts])
    shear = np.array([part.young / (2.0 * (1.0 + part.poisson)) for part in parts])
    d_yy = 1.0 / np.mean(1.0 / along)
    d_xy = d_yy * np.mean(poisson)
    d_xx = np.mean(along * (1.0 - poisson**2)) + d_yy * np.mean(poisson) ** 2
    g = 1.0 / np.mean(1.0 / shear)
    xx = d_xx * strain[0, 0] + d_xy * strain[1, 1]
    yy = d_xy * strain[0, 0] + d_yy * strain[1, 1]
    xy = 2.0 * g * strain[0, 1]
    return ufl.as_matrix([[xx, xy], [xy, yy]])


comm = MPI.COMM_WORLD
size = [(0.0, 0.0), (WIDTH, HEIGHT)]
pier = mesh.create_rectangle(comm, size, (8, 2 * LAYERS), mesh.CellType.quadrilateral)
index_map = pier.topology.index_map(2)
cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
height = mesh.compute_midpoints(pier, 2, cells)[:, 1]
layer = np.floor(height * LAYERS / HEIGHT).astype(np.int32) % 2
ends = [
    mesh.locate_entities_boundary(pier, 1, lambda x, y=y: np.isclose(x[1], y))
    for y in (0.0, HEIGHT)
]
facets = np.concatenate(ends)
numbers = np.repeat(np.array([10, 11], dtype=np.int32), [len(end) for end in ends])
order = np.argsort(facets)
blocks = BlockMesh.from_dolfinx(
    pier,
    mesh.meshtags(pier, 2, cells, layer),
    mesh.meshtags(pier, 1, facets[order], numbers[order]),
    {0: "stone", 1: "mortar", 10: "base", 11: "top"},
)


def scene(stress=None) -> Scene:
    """The pier under pressure on its top, which is pushed to the right."""
    return Scene(
        mesh=blocks,
        materials={"stone": STONE, "mortar": MORTAR},
        dead=Load(traction={"top": (0.0, -PRESSURE)}),
        live=Load(traction={"top": (PUSH, 0.0)}),
        foundations={"base": JointLaw("coulomb", 0.7)},
        plane="stress",
        stress=stress,
        title="A pier of thin layers",
        output=OutputOptions(pictures="all"),
    )


by_law, by_layers = (
    equilibrium(scene(law), load_factor=0.0).blocks["displacement"][0, 1] for law in (layered, None)
)
result = limit_load(scene(layered))
result.write(FOLDER)
exact = PRESSURE * WIDTH / (2.0 * PUSH * HEIGHT)  # moments about the toe
if abs(by_law / by_layers - 1.0) > 1.0 / LAYERS:  # the lowest is stone, the highest mortar
    raise SystemExit(f"settlement {by_law} m, layer by layer {by_layers} m")
if result.status != "limit" or abs(result.load_factor - exact) > 1e-5 * exact:
    raise SystemExit(f"{result.status} {result.load_factor}, should be {exact}")
if comm.rank == 0:
    print(f"mean settlement {-1e3 * by_law:.4f} mm, layer by layer {-1e3 * by_layers:.4f} mm")
    print(f"load factor {result.load_factor:.8f}, by statics {exact:.8f}")
    print(f"pictures: {FOLDER}/collapse.png, thrust.png, stress.png")
