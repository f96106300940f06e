"""Meshes of blocks, distributed body by body; `gmsh_mesh` reads them on one rank.

A mesh is kept with the arrays that it was made of, from which it can be made again. dolfinx numbers
cells and nodes anew, in a way that depends on these arrays alone: the mesh made again has the
numbers of the first one, and so have all values by node and by cell. That is checked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.errors import InputError, checked, raised_together
from fenics_contact.geometry.dolfinx_reader import TagNames
from fenics_contact.geometry.dolfinx_reader import contents as dolfinx_contents
from fenics_contact.geometry.gmsh_mesh import (
    GmshMesh,
    TaggedMesh,
    bodies_of_cells,
    extract,
    joined_surfaces,
    mesh_of,
    read_file,
    with_blocks,
)
from fenics_contact.geometry.planar_cells import check_apart

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Labels = npt.NDArray[np.int32]
Flags = npt.NDArray[np.bool_]
Names = frozenset[str]

#: Largest load of a rank over the mean load at which bodies are still kept whole.
BODY_IMBALANCE = 1.3


@dataclass(frozen=True, eq=False)
class StoredMesh:
    """A dolfinx mesh that can be pickled. It never changes, so that a copy is the mesh itself.

    Attributes:
        comm: Communicator.
        cell_name: "triangle" or "quadrilateral".
        cells: Nodes of the cells that this rank gives, in gmsh order, shape (cells, nodes).
        points: Coordinates that this rank gives, m, shape (points, 2).
        partition: Ranks of these cells; None: triangles that stay where they are, and that count
            the points of all ranks.
        numbering: Input numbers of this rank's cells, then of its nodes.
    """

    comm: MPI.Comm
    cell_name: str
    cells: Indices
    points: Array
    partition: compat.Partition | None = None
    numbering: Indices = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @classmethod
    def distributed(
        cls, comm: MPI.Comm, cell_name: str, cells: Indices, points: Array, ranks: Labels | None
    ) -> StoredMesh:
        """A mesh that one rank gives (the others pass empty arrays), made. Collective.

        `ranks` are those of the cells given here; None for graph partitioning.
        """
        wished = None if ranks is None else compat.Partition.to(ranks)
        domain, partition = compat.create_mesh(comm, cell_name, cells, points, wished)
        return cls(comm, cell_name, cells, points, partition)._made(domain)

    @classmethod
    def in_place(cls, comm: MPI.Comm, cells: Indices, points: Array) -> StoredMesh:
        """A mesh of triangles that stay on the rank that gives them, made. Collective.

        `cells` count the points of all ranks.
        """
        domain = compat.create_mesh_in_place(comm, cells, points)
        return cls(comm, "triangle", cells, points)._made(domain)

    @cached_property
    def domain(self) -> Any:
        """The dolfinx mesh; collective where it is first asked for after it was stored.

        Raises:
            InputError: On all ranks, if this dolfinx numbers its cells or nodes otherwise.
        """
        if self.partition is None:
            made = compat.create_mesh_in_place(self.comm, self.cells, self.points)
        else:
            arrays = self.cells, self.points, self.partition
            made, _ = compat.create_mesh(self.comm, self.cell_name, *arrays)
        with raised_together(self.comm):
            if not np.array_equal(self.numbering, _numbering(made)):
                problem = "stored mesh: this dolfinx numbers it otherwise than that which stored it"
                raise InputError(f"{problem}; solve the scene again here")
        return made

    def _made(self, domain: Any) -> StoredMesh:
        # The mesh has a communicator of its own, which lives as long as it does.
        new = replace(self, comm=domain.comm, numbering=_numbering(domain))
        vars(new)["domain"] = domain
        return new

    def __getstate__(self) -> dict[str, Any]:
        """The arrays, and this rank's number and that of all, in place of objects of MPI."""
        state = {name: value for name, value in vars(self).items() if name != "domain"}
        return state | {"comm": (self.comm.rank, self.comm.size)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the arrays, on the rank that stored them.

        Raises:
            InputError: On another rank, or one of more or fewer; one rank alone is any one.
        """
        stored = state["comm"]
        comm = compat.comm_of(stored[1])
        if (comm.rank, comm.size) != stored:
            here = f"this is rank {comm.rank} of {comm.size}"
            problem = f"stored mesh: it is of rank {stored[0]} of {stored[1]}, and {here}"
            raise InputError(f"{problem}; load on as many ranks, each its own")
        vars(self).update(state, comm=comm)

    def __deepcopy__(self, _: object) -> StoredMesh:
        return self


def _numbering(domain: Any) -> Indices:
    """Input numbers of this rank's cells, then of its nodes."""
    parts = domain.topology.original_cell_index, domain.geometry.input_global_indices
    return np.concatenate([np.asarray(part, dtype=np.int64) for part in parts])


@dataclass(frozen=True, repr=False)
class BlockMesh(TaggedMesh):
    """A distributed mesh whose bodies (connected sets of cells) share no node.

    Attributes:
        stored: The dolfinx mesh and what it was made of.
        body: Body of every local cell; bodies are numbered by first cell.
        body_count: Number of bodies on all ranks.
        cell_groups: Physical groups of every local cell, as an index into `cell_sets`.
        joined: Number of surfaces that are in one body with others of the same groups; 0 where
            surfaces are blocks.
    """

    stored: StoredMesh
    body: Labels
    body_count: int
    cell_groups: Labels
    joined: int

    def __repr__(self) -> str:
        return f"<BlockMesh: {self.body_count} blocks, from {self.source}>"

    @property
    def domain(self) -> Any:
        """The dolfinx mesh; of a mesh that was unpickled, made when first asked for: collective."""
        return self.stored.domain

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.stored.comm

    @classmethod
    @checked
    def from_file(
        cls, path: str | Path, comm: MPI.Comm | None = None, blocks: str = "connected"
    ) -> BlockMesh:
        """Read a planar gmsh file on rank 0 and distribute it, by default on PETSc's communicator.

        Args:
            path: The .msh file.
            comm: By default, the communicator that PETSc was started with.
            blocks: "connected": blocks have nodes of their own. "surfaces": every gmsh surface is a
                block, and nodes that surfaces share are split, as after gmsh's `occ.fragment`.

        Raises:
            InputError: On all ranks, if the file is missing, not gmsh's, or not a mesh of blocks.
        """
        return cls._distribute(lambda: with_blocks(read_file(Path(path)), blocks), comm)

    @classmethod
    @checked
    def from_model(
        cls, model: Any, comm: MPI.Comm | None = None, blocks: str = "connected"
    ) -> BlockMesh:
        """Distribute the current gmsh model of rank 0, as builders return it; see `from_file`."""
        source = "the gmsh model"
        return cls._distribute(lambda: with_blocks(extract(model, source), blocks), comm)

    @classmethod
    @checked
    def from_dolfinx(
        cls,
        mesh: Any,
        cell_tags: Any,
        facet_tags: Any,
        names: TagNames,
        blocks: str = "connected",
    ) -> BlockMesh:
        """Make blocks of a dolfinx mesh, serial or distributed, on its communicator. Collective.

        Rank 0 collects cells and tags, as it reads a file. The blocks get a mesh of their own,
        `domain`: nodes are split and cells distributed, and `mesh` is left as it is.

        Args:
            mesh: Straight triangles or quadrilaterals with points in the plane (gdim 2).
            cell_tags: Tag of every cell.
            facet_tags: Tags of facets that have a role: joints, foundations, supports, loads.
            names: Name of the group by the tag's number, or by (dimension, number) where cells and
                facets have the same numbers; several numbers can have one name. Tags without a
                name are called by their number.
            blocks: "connected": blocks have nodes of their own. "surfaces": cells of one tag and no
                others are a block (or several, if they are apart), and nodes that tags share are
                split; a tagged facet between two blocks is on both sides.

        Raises:
            InputError: On all ranks, if mesh, tags or names do not fit together, or are no blocks.
        """
        source = "the dolfinx mesh"
        found = dolfinx_contents(mesh, cell_tags, facet_tags, names, source)
        return cls._distribute(lambda: with_blocks(mesh_of(found, source), blocks), mesh.comm)

    @classmethod
    def _distribute(cls, read: Callable[[], GmshMesh], comm: MPI.Comm | None) -> BlockMesh:
        """Read a mesh on rank 0, split it into bodies and send their cells to all ranks."""
        comm = compat.default_comm() if comm is None else comm
        rest: Any = None
        mesh = None
        body = np.empty(0, dtype=np.int32)
        rank = None
        joined = 0
        with raised_together(comm):
            if comm.rank == 0:
                mesh = read()
                body = bodies_of_cells(mesh)
                check_apart(mesh.points, mesh.cells, body, mesh.source)
                rank = ranks_of_bodies(mesh, body, comm.size)
                joined = joined_surfaces(mesh, body)
                arrays = ("points", "cells", "cell_groups", "cell_surfaces")
                rest = replace(mesh, **{name: getattr(mesh, name)[:0] for name in arrays})
        rest, whole, joined = comm.bcast((rest, rank is not None, joined))
        mesh = mesh or rest
        rank = rank if comm.rank == 0 or not whole else body
        given = mesh.cells, mesh.points, rank
        stored = StoredMesh.distributed(comm, mesh.cell_name, *given)
        numbers = np.column_stack([body, mesh.cell_groups])
        input_cells = comm.gather(np.asarray(stored.domain.topology.original_cell_index))
        body, groups = comm.scatter([numbers[cells] for cells in input_cells or ()]).T
        count = comm.allreduce(int(body.max(initial=-1)), MPI.MAX) + 1
        tags = {item.name: getattr(mesh, item.name) for item in fields(TaggedMesh)}
        of_bodies = {"body": body, "body_count": count, "joined": joined}
        return cls(**tags, **of_bodies, stored=stored, cell_groups=groups)


def ranks_of_bodies(mesh: GmshMesh, body: Labels, ranks: int) -> Labels | None:
    """Rank of every cell such that bodies stay whole, or None where that would not balance."""
    cells = np.bincount(body)
    centre = mesh.points[mesh.cells].mean(axis=1)
    position = np.column_stack([np.bincount(body, centre[:, d]) / cells for d in range(2)])
    rank = np.zeros(len(cells), dtype=np.int32)

    def bisect(members: Indices, first: int, count: int) -> None:
        """Recursive coordinate bisection of bodies onto ranks first, ..., first + count - 1."""
        if count == 1 or len(members) == 0:
            rank[members] = first
            return
        axis = int(np.argmax(np.ptp(position[members], axis=0)))
        order = members[np.lexsort((position[members, 1 - axis], position[members, axis]))]
        total = np.cumsum(cells[order])
        left = count // 2
        cut = int(np.searchsorted(total - 0.5 * cells[order], total[-1] * left / count))
        bisect(order[:cut], first, left)
        bisect(order[cut:], first + left, count - left)

    bisect(np.arange(len(cells)), 0, ranks)
    load = np.bincount(rank, cells, minlength=ranks)
    return None if load.max() > BODY_IMBALANCE * load.mean() else rank[body]
