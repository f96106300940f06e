"""What the command `mesh` does; apart from the others, because it needs no solver."""

from __future__ import annotations

import argparse
import os
from collections import Counter
from pathlib import Path

from mpi4py import MPI

from fenics_contact.errors import raised_together
from fenics_contact.geometry.dxf.command import MeshedDrawing, MeshOrder, mesh_drawing
from fenics_contact.geometry.dxf.roles import LayerRoles
from fenics_contact.geometry.dxf.starter import Starter


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
            made = mesh_drawing(order)
            lines = [*made.lines, *_next(order, made), *filter(None, [made.read.slips])]
            if not options.quiet:
                print("\n".join(lines))
    return 0


def _next(order: MeshOrder, made: MeshedDrawing) -> list[str]:
    """Write the scene, if it is asked for; what was guessed in it and what to do next."""
    if order.scene is None or made.roles is None:
        write = f'write a scene with mesh.file = "{order.mesh.name}"'
        return [f"next: {write}, or let --scene FILE.toml do it; then: fenics-contact check SCENE"]
    read = made.read
    starter = Starter(
        order.drawing.stem,
        Path(os.path.relpath(order.mesh, order.scene.parent)).as_posix(),
        Counter(read.drawing.names),
        read.lengths,
        made.roles,
        made.closing_gap,
        made.mortar,
        read.slips,
    )
    starter.write(order.scene)
    ground = ", ".join(f"'{name}'" for name in made.roles.ground)
    return [
        f"the ground is {ground}: guessed, {made.roles.why}",
        f"scene written to {order.scene}: materials, frictions and the live load are usual values,"
        " set them right",
        f"next: fenics-contact check {order.scene}, then: fenics-contact solve {order.scene}",
    ]


def _layers(texts: list[str]) -> tuple[str, ...]:
    """Names of layers, given with commas between them or one by one."""
    return tuple(name.strip() for text in texts for name in text.split(",") if name.strip())
