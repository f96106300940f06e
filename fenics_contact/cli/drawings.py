"""What the command `mesh` does; apart from the others, because it needs no solver."""

from __future__ import annotations

import argparse

from mpi4py import MPI

from fenics_contact.errors import raised_together
from fenics_contact.geometry.dxf.command import MeshOrder, mesh_drawing
from fenics_contact.geometry.dxf.roles import LayerRoles


def mesh(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Mesh a drawing on rank 0 and say what was made."""
    given = {role: getattr(options, role) for role in ("blocks", "lines", "voids", "ignore")}
    roles = LayerRoles(**{role: _layers(texts) for role, texts in given.items()})
    order = MeshOrder(
        options.drawing,
        options.output,
        options.size,
        options.unit,
        roles,
        options.picture,
        options.scene,
        options.close,
        options.snap,
    )
    with raised_together(comm):
        if comm.rank == 0:
            lines = mesh_drawing(order).lines
            if not options.quiet:
                print("\n".join(lines))
    return 0


def _layers(texts: list[str]) -> tuple[str, ...]:
    """Names of layers, given with commas between them or one by one."""
    return tuple(name.strip() for text in texts for name in text.split(",") if name.strip())
