"""A dolfinx mesh with the arrays that it was made of, from which it can be made again.

dolfinx numbers cells and nodes anew, in a way that depends on these arrays alone: the mesh made
again has the numbers of the first one, and so have all values by node and by cell. That is checked.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.errors import InputError, raised_together

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Ranks = npt.NDArray[np.int32]


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
    cells: Numbers
    points: Array
    partition: compat.Partition | None = None
    numbering: Numbers = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @classmethod
    def distributed(
        cls, comm: MPI.Comm, cell_name: str, cells: Numbers, points: Array, ranks: Ranks | None
    ) -> StoredMesh:
        """A mesh that one rank gives (the others pass empty arrays), made. Collective.

        `ranks` are those of the cells given here; None for graph partitioning.
        """
        wished = None if ranks is None else compat.Partition.to(ranks)
        domain, partition = compat.create_mesh(comm, cell_name, cells, points, wished)
        return cls(comm, cell_name, cells, points, partition)._made(domain)

    @classmethod
    def in_place(cls, comm: MPI.Comm, cells: Numbers, points: Array) -> StoredMesh:
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


def _numbering(domain: Any) -> Numbers:
    """Input numbers of this rank's cells, then of its nodes."""
    parts = domain.topology.original_cell_index, domain.geometry.input_global_indices
    return np.concatenate([np.asarray(part, dtype=np.int64) for part in parts])
