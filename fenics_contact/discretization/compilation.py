"""Compilation of the forms and of the laws of joint points, before all other work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.discretization import forms
from fenics_contact.scene.scene import Scene
from fenics_contact.solvers import compiled_laws
from fenics_contact.solvers.compiled_laws import CompiledLaws

#: What finds compiled laws in a folder, or compiles them there.
LoadLaws = Callable[[Path], CompiledLaws]

#: Corners of a cell in gmsh's order, by the cell's name.
_CORNERS = {"triangle": [(0, 0), (1, 0), (0, 1)], "quadrilateral": [(0, 0), (1, 0), (1, 1), (0, 1)]}


@dataclass(frozen=True)
class _Kind:
    """What the forms of a scene depend on.

    Attributes:
        cell: Name of the mesh's cells.
        degree: Of the displacements.
        plane: "strain" or "stress".
        moved: Whether supports move.
        given: Whether the stress law is the user's.
    """

    cell: str
    degree: int
    plane: str
    moved: bool
    given: bool


def compile_forms(scene: Scene) -> None:
    """Compile all forms, so that later work finds them in the cache; on all ranks.

    The compiler prints nothing. What an earlier run compiled is only looked up.
    """
    kind = _Kind(
        cell=scene.mesh.domain.topology.cell_type.name,
        degree=scene.degree,
        plane=scene.plane,
        moved=bool(scene.dead.movement),
        given=scene.stress is not None,
    )
    for turn in (True, False):  # ranks that share a cache must not write it at the same time
        if turn == (scene.comm.rank == 0):
            _compile(kind)
        scene.comm.barrier()


def compile_laws(comm: MPI.Comm, load: LoadLaws = compiled_laws.load) -> tuple[str, ...]:
    """Compile the laws of joint points, as forms are; a warning where that fails on any rank.

    All ranks then compute them in Python: the same numbers, in more time.
    """
    reason = ""
    for turn in (True, False):  # as the forms
        if turn == (comm.rank == 0):
            laws, reason = _loaded(load)
        comm.barrier()
    reason = next(filter(None, comm.allgather(reason)), "")
    compiled_laws.use(None if reason else laws)
    slower = "joint laws are not compiled, solves take longer: is there a C compiler?"
    return (f"{slower} ({reason})",) if reason else ()


@cache
def _loaded(load: LoadLaws) -> tuple[CompiledLaws | None, str]:
    """The compiled laws, or why there are none."""
    try:
        with compat.quiet_compiler(), compat.form_cache() as folder:
            return load(folder), ""
    except Exception as error:  # compilers and the packages around them fail in many ways
        return None, " ".join(str(error).split()) or type(error).__name__


@cache
def _compile(kind: _Kind) -> None:
    """Compile the forms for a mesh of one cell: code does not depend on the mesh."""
    corners = np.array(_CORNERS[kind.cell], dtype=float)
    cells = np.arange(len(corners))[None, :]
    here = compat.Partition.to(np.zeros(1, dtype=np.int32))
    with compat.quiet_compiler(), compat.form_cache():
        domain, _ = compat.create_mesh(MPI.COMM_SELF, kind.cell, cells, corners, here)
        domain.topology.create_connectivity(1, 2)
        space = compat.function_space(domain, "Lagrange", kind.degree, (2,))
        by_cell = compat.function_space(domain, "DG", 0)
        density, first, second = (fem.Function(by_cell) for _ in range(3))
        law: forms.Law = first, second
        if kind.given:
            law = fem.Function(compat.function_space(domain, "DG", 0, (9,)))
        forms.stiffness(space, law)
        if kind.moved:
            forms.internal_forces(fem.Function(space), law)
        forms.BodyLoad(space, density)
        forms.edge_load(space, np.zeros(1, dtype=np.int32), (0.0, 0.0))
        forms.stress_expression(fem.Function(space), law, kind.plane)
