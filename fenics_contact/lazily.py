"""The parts of FEniCSx that are imported when they are first used: rigid blocks need none."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class Lazily:
    """A module that is imported when something of it is asked for."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, item: str) -> Any:
        return getattr(import_module(self._name), item)


ufl = Lazily("ufl")
cpp = Lazily("dolfinx.cpp")
fem = Lazily("dolfinx.fem")
fem_petsc = Lazily("dolfinx.fem.petsc")
dolfinx_graph = Lazily("dolfinx.graph")
dolfinx_mesh = Lazily("dolfinx.mesh")
io = Lazily("dolfinx.io")
jit = Lazily("dolfinx.jit")
la = Lazily("dolfinx.la")
