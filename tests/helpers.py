"""What unit tests start from: scenes of stone blocks on the ground, discretised, as whole arrays.

Everything below `on_ground` knows the discretisation and the solvers; tests of other modules, of
the program and of load factors do without it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene
from fenics_contact.discretization.discretization import Bonded, Structure
from fenics_contact.limit_load import typical_sizes
from fenics_contact.meshing import wall
from fenics_contact.solvers.kkt import Scales, State
from tests.bank import GRAVITY, PUSH, WEIGHT, coulomb, tresca
from tests.drawing import Drawing, cell_areas, grid_blocks, group_lengths, rectangle, rotation

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

STONE = Material(1e9, 0.2, 2000.0)


def mesh_of(model: Any) -> BlockMesh:
    """Distribute the current gmsh model over all ranks."""
    return BlockMesh.from_model(model, MPI.COMM_WORLD)


def on_ground(
    model: Any,
    law: JointLaw,
    dead: Load = WEIGHT,
    live: Load = PUSH,
    foundations: Mapping[str, JointLaw] | None = None,
    **options: Any,
) -> Scene:
    """Blocks of stone on rigid ground "base" with one law everywhere."""
    return Scene(
        mesh_of(model),
        {"default": STONE},
        dead=dead,
        live=live,
        joints={"default": law},
        foundations={"base": law} if foundations is None else foundations,
        **options,
    )


def three_blocks(stands: str, elements: int, left: str) -> Structure:
    """Three blocks on rigid "ground"; or else on a roller under 30 degrees and a held left side."""
    drawing = Drawing.of(wall([[1], [0.5, 0.5]], elements=elements))
    if stands == "ground":
        return Structure.build(on_ground(drawing.model(), coulomb(0.5)))
    scene = Scene(
        mesh_of(drawing.turned(np.radians(30.0)).model()),
        {"default": STONE},
        live=PUSH,
        joints={"default": coulomb(0.5)},
        supports={"base": "roller", "left": left},
    )
    return Structure.build(scene)


def dense(matrix: PETSc.Mat) -> Array:
    """All rows of a matrix on every rank."""
    indptr, columns, values = matrix.getValuesCSR()
    rows = np.zeros((len(indptr) - 1, matrix.getSize()[1]))
    np.add.at(rows, (np.repeat(np.arange(len(rows)), np.diff(indptr)), columns), values)
    return np.concatenate(matrix.comm.tompi4py().allgather(rows))


def whole(vector: PETSc.Vec) -> Array:
    """All entries of a vector on every rank."""
    return np.concatenate(vector.comm.tompi4py().allgather(vector.array_r.copy()))


def vector_like(vector: PETSc.Vec, values: Array) -> PETSc.Vec:
    """A vector of the same layout with given entries, of which every rank takes its own."""
    result = vector.duplicate()
    start, end = vector.getOwnershipRange()
    result.array[:] = np.asarray(values).ravel()[start:end]
    return result


def node_positions(space: Any) -> Array:
    """Coordinates of all displacement nodes in the order of the dofs, on every rank."""
    owned = space.dofmap.index_map.size_local
    parts = space.mesh.comm.allgather(space.tabulate_dof_coordinates()[:owned, :2].copy())
    return np.concatenate(parts)


def node_bodies(structure: Structure) -> Indices:
    """Bodies of all displacement nodes in the order of the dofs, on every rank."""
    owned = structure.elasticity.space.dofmap.index_map.size_local
    return np.concatenate(structure.scene.comm.allgather(structure.elasticity.node_body[:owned]))


def joint_rows(structure: Structure) -> tuple[Array, Array]:
    """B_N and B_T with one row per joint point, in the order of `Joints`, on every rank."""
    points = np.concatenate(structure.scene.comm.allgather(structure.operators.points))
    order = np.argsort(points)
    operators = structure.operators
    return dense(operators.normal)[order], dense(operators.tangential)[order]


@dataclass(frozen=True)
class Loaded:
    """A structure ready to be pushed along its load path.

    Attributes:
        structure: The structure.
        bonded: Its response with closed joints.
        scales: Typical sizes.
    """

    structure: Structure
    bonded: Bonded
    scales: Scales

    @classmethod
    def of(cls, scene: Scene) -> Loaded:
        """Discretise a scene and close its joints."""
        structure = Structure.build(scene)
        bonded = structure.bonded()
        return cls(structure, bonded, typical_sizes(structure.problem, bonded))

    def start(self, ratio: float) -> tuple[State, Scales]:
        """A state to start from, and typical sizes, at a multiple of the bonded work."""
        live = self.structure.problem.live
        work = ratio * self.scales.load_factor * live.dot(self.bonded.live)
        displacement = self.bonded.live.copy()
        displacement.scale(ratio * self.scales.load_factor)
        pressure = self.bonded.dead_pressure
        state = State(displacement, 0.0, pressure, np.zeros_like(pressure), work)
        unit = work / live.norm(PETSc.NormType.N1)
        return state, replace(self.scales, displacement=unit, elastic=self.scales.displacement)
