"""Contents of gmsh models as arrays; run as a program, those of a file, for another.

gmsh can crash, hang or ask for all memory on a damaged file, so it reads in a process of its own.
This module imports nothing of the package: mpi4py would start MPI in that process.
"""

from __future__ import annotations

import os
import pickle
import resource
import sys
from itertools import product
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


def volumes(model: Any) -> tuple[Any, ...]:
    """Volumes of the current `gmsh.model`: number, groups, outer faces, tetrahedra; and all nodes.

    Outer faces are those of one element only; without elements, those of the volume's surfaces,
    if these have any. Tetrahedra, by the numbers of their corners, are told where all elements are.
    """
    corners = {4: 4, 11: 10}  # nodes of tetrahedra, of degree 1 and 2
    found = []
    for _, volume in model.getEntities(3):
        entities = [(3, volume)]
        if not model.mesh.getElementTypes(3, volume).size:
            entities = model.getBoundary(entities, oriented=False)
        uses: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
        for dim, tag in entities:
            for kind, width in product(model.mesh.getElementTypes(dim, tag), (3, 4)):
                flat = model.mesh.getElementFaceNodes(kind, width, tag, True)
                for loop in flat.reshape(-1, width).tolist():
                    uses.setdefault(tuple(sorted(loop)), []).append(tuple(loop))
        kinds, _, nodes = model.mesh.getElements(3, volume)
        alone = len(kinds) == 1 and kinds[0] in corners
        cells = nodes[0].reshape(-1, corners[kinds[0]])[:, :4] if alone else None
        groups = [abs(int(tag)) for tag in model.getPhysicalGroupsForEntity(3, volume)]
        names = [model.getPhysicalName(3, tag) or str(tag) for tag in groups]
        faces = [same[0] for same in uses.values() if len(same) == 1]
        found.append((volume, names, faces, cells))
    tags, coordinates, _ = model.mesh.getNodes()
    return found, tags, coordinates.reshape(-1, 3)


def _main(path: str, seconds: str, memory: str, what: str) -> None:
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
            columns = {"contents": contents, "volumes": volumes}[what](gmsh.model)
        except Exception as error:
            failure = str(error) or "the file is damaged"
        pickle.dump((failure, columns), answer, protocol=5)
    os._exit(0)  # without gmsh's own end, which takes time


if __name__ == "__main__":
    _main(*sys.argv[1:])
