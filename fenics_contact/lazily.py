"""The parts of FEniCSx that are imported when they are first used: rigid blocks need none."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__all__ = ["Lazily", "dolfinx_graph", "dolfinx_mesh", "fem", "fem_petsc", "io", "jit", "la", "ufl"]


class Lazily:
    """A module that is imported when something of it is asked for."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, item: str) -> Any:
        return getattr(import_module(self._name), item)


if TYPE_CHECKING:
    import ufl
    from dolfinx import fem, io, jit, la
    from dolfinx import graph as dolfinx_graph
    from dolfinx import mesh as dolfinx_mesh
    from dolfinx.fem import petsc as fem_petsc
else:
    ufl = Lazily("ufl")
    fem = Lazily("dolfinx.fem")
    fem_petsc = Lazily("dolfinx.fem.petsc")
    dolfinx_graph = Lazily("dolfinx.graph")
    dolfinx_mesh = Lazily("dolfinx.mesh")
    io = Lazily("dolfinx.io")
    jit = Lazily("dolfinx.jit")
    la = Lazily("dolfinx.la")
