"""MPI and PETSc; where they are not installed, one rank, and a PETSc that says what to install.

Rigid blocks without a mesh need neither, so `pip install` is enough for them.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from fenics_contact.requirements import check_requirements

__all__ = ["MPI", "PETSc"]


class OneRank:
    """The communicator of a run without MPI: what one rank has is what all have."""

    rank, size = 0, 1

    def barrier(self) -> None:
        """Wait for nobody."""

    def bcast(self, value: Any, root: int = 0) -> Any:
        """The value of the only rank."""
        return value

    def allreduce(self, value: Any, op: Any = None) -> Any:
        """The value of the only rank, whatever the operation."""
        return value

    def allgather(self, value: Any) -> list[Any]:
        """The values of all ranks."""
        return [value]


class _NoPetsc:
    """PETSc where it is not installed: it knows one rank; all else says how to install it."""

    Sys = SimpleNamespace(
        getDefaultComm=lambda: SimpleNamespace(tompi4py=OneRank), getVersion=lambda: ()
    )

    def __getattr__(self, name: str) -> Any:
        check_requirements()
        raise AttributeError(name)


if TYPE_CHECKING:
    from mpi4py import MPI
    from petsc4py import PETSc
else:
    try:
        from mpi4py import MPI
        from petsc4py import PETSc
    except ImportError:
        kinds = {"Comm": OneRank, "Intracomm": OneRank}
        values = {"COMM_WORLD": OneRank(), "COMM_SELF": OneRank()}
        operations = dict.fromkeys(("MAX", "MIN", "SUM", "LOR", "IN_PLACE"))
        MPI = SimpleNamespace(**kinds, **values, **operations)
        PETSc = _NoPetsc()
