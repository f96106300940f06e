"""What unit tests start from: scenes of stone blocks on the ground, PETSc objects as arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from operator import methodcaller
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, SolveOptions
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.search_options import SEARCH
from tests.bank import GRAVITY, PUSH, WEIGHT, coulomb, tresca
from tests.drawing import Drawing, cell_areas, grid_blocks, group_lengths, rectangle, rotation

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

STONE = Material(1e9, 0.2, 2000.0)

#: The picture that a notebook shows of an object, by Jupyter's protocol.
notebook_picture = methodcaller("_repr_png_")


@contextmanager
def numbers(**values: float) -> Iterator[None]:
    """Other numbers of all searches for a while."""
    before = {name: getattr(SEARCH, name) for name in values}
    try:
        for name, value in values.items():
            object.__setattr__(SEARCH, name, value)
        yield
    finally:
        for name, value in before.items():
            object.__setattr__(SEARCH, name, value)


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
    """Blocks of stone on rigid ground "base" with one law everywhere.

    What is said of a collapse beside its load factor is left out if `solve` is not given.
    """
    options.setdefault("solve", SolveOptions(fast=True))
    return Scene(
        mesh_of(model),
        {"default": STONE},
        dead=dead,
        live=live,
        joints={"default": law},
        foundations={"base": law} if foundations is None else foundations,
        **options,
    )


def dense(matrix: PETSc.Mat) -> Array:
    """All rows of a matrix on every rank."""
    indptr, columns, values = matrix.getValuesCSR()
    rows = np.zeros((len(indptr) - 1, matrix.getSize()[1]))
    np.add.at(rows, (np.repeat(np.arange(len(rows)), np.diff(indptr)), columns), values)
    return np.concatenate(matrix.comm.tompi4py().allgather(rows))


def planar_faces(scene: Scene, sign: float = 1.0) -> PlanarFaces:
    """The faces of a scene as the face engine sees them."""
    with Discretization(scene) as made:
        return PlanarFaces.of(made, sign)


def node_positions(space: Any) -> Array:
    """Coordinates of all displacement nodes in the order of the dofs, on every rank."""
    owned = space.dofmap.index_map.size_local
    parts = space.mesh.comm.allgather(space.tabulate_dof_coordinates()[:owned, :2].copy())
    return np.concatenate(parts)
