"""Contents of gmsh models as arrays; run as a program, those of a file, for another.

gmsh can crash, hang or ask for all memory on a damaged file, so it reads in a process of its own.
This module imports nothing of the package: mpi4py would start MPI in that process.
"""

from __future__ import annotations

import os
import pickle
import resource
import sys
from typing import Any


def contents(model: Any) -> tuple[Any, ...]:
    """Contents of the current `gmsh.model`, as `gmsh_mesh.GmshContents` has them."""
    groups: dict[tuple[int, int], str | None] = {}
    for dim, tag in model.getPhysicalGroups():
        try:
            groups[dim, tag] = model.getPhysicalName(dim, tag) or str(tag)
        except UnicodeDecodeError:
            groups[dim, tag] = None
    tags, coordinates, _ = model.mesh.getNodes()
    elements = []
    for dim, entity in [*model.getEntities(1), *model.getEntities(2)]:
        # A number below zero says that the group has the entity reversed.
        of_entity = [abs(int(tag)) for tag in model.getPhysicalGroupsForEntity(dim, entity)]
        for tag in of_entity:
            groups.setdefault((dim, tag), str(tag))
        if of_entity:
            types, _, nodes = model.mesh.getElements(dim, entity)
            for kind, flat in zip(types, nodes, strict=True):
                elements.append((dim, of_entity, int(kind), flat))
    kinds = {kind: model.mesh.getElementProperties(kind)[0] for _, _, kind, _ in elements}
    return groups, tags, coordinates.reshape(-1, 3), elements, kinds


def _main(path: str, seconds: str, memory: str) -> None:
    """Read a file within limits; write (failure, contents) as a pickle to standard output."""
    for kind, most in ((resource.RLIMIT_CPU, seconds), (resource.RLIMIT_AS, memory)):
        limit = int(most)
        _, hard = resource.getrlimit(kind)
        if hard != resource.RLIM_INFINITY:
            limit = min(limit, hard)
        resource.setrlimit(kind, (limit, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    failure = ""
    columns: tuple[Any, ...] = ()
    with os.fdopen(os.dup(1), "wb") as answer:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)  # what gmsh and its libraries have to say
        try:
            import gmsh

            gmsh.initialize(readConfigFiles=False)
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.open(path)
            columns = contents(gmsh.model)
        except Exception as error:
            failure = str(error) or "the file is damaged"
        pickle.dump((failure, columns), answer, protocol=5)
    os._exit(0)  # without gmsh's own end, which takes time


if __name__ == "__main__":
    _main(*sys.argv[1:])
