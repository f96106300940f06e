"""What the command `mesh` does; apart from the others, because it needs no solver."""

from __future__ import annotations

import argparse

from mpi4py import MPI

from fenics_contact.errors import raised_together
from fenics_contact.geometry.dxf.command import MeshOrder, mesh_drawing
from fenics_contact.geometry.dxf.roles import LayerRoles


def mesh(options: argparse.Namespace, comm: MPI.Comm) -> int:
    """Mesh a drawing on rank 0 and say what was made."""
    layers = {
        role: tuple(
            name.strip()
            for text in getattr(options, role)  # names with commas between them, or one by one
            for name in text.split(",")
            if name.strip()
        )
        for role in ("blocks", "lines", "voids", "ignore")
    }
    order = MeshOrder(
        options.drawing,
        options.output,
        options.size,
        options.unit,
        LayerRoles(**layers),
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
