"""Contents of a gmsh model as arrays; run as a program, those of a file, for another process.

gmsh can crash, hang or ask for all memory on a damaged file, so files are read in a process of
their own. This module imports nothing of the package: mpi4py would start MPI in that process.
"""

from __future__ import annotations

import os
import pickle
import resource
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Tags = npt.NDArray[np.uint64]

#: Cell name and nodes of a cell, by gmsh's element type, for the straight-sided planar cells.
CELL_TYPES = {2: ("triangle", 3), 3: ("quadrilateral", 4)}


@dataclass(frozen=True)
class ReadLimits:
    """What reading a file may take.

    Attributes:
        seconds: Time of the processor, s; 30 times what gmsh needs to start.
        seconds_per_megabyte: More of it by size; gmsh reads more than 10 MB/s.
        patience: Time by the clock over that of the processor, on a busy machine.
        memory: Address space, bytes; gmsh and its libraries take 2e8.
        memory_per_byte: More of it by size of the file.
    """

    seconds: float = 10.0
    seconds_per_megabyte: float = 1.0
    patience: float = 6.0
    memory: float = 2e9
    memory_per_byte: float = 100.0


@dataclass(frozen=True)
class GmshContents:
    """Nodes, and the elements in physical groups of dimension 1 and 2, of a gmsh model.

    Attributes:
        groups: Names by dimension and number of the group; None for one that is not UTF-8.
        tags: Numbers of the nodes.
        coordinates: Their coordinates, shape (nodes, 3).
        elements: Dimension, numbers of the groups, gmsh's type and nodes (in a row) by entity.
        kinds: Names of gmsh's types.
    """

    groups: dict[tuple[int, int], str | None]
    tags: Tags
    coordinates: npt.NDArray[np.float64]
    elements: list[tuple[int, list[int], int, Tags]]
    kinds: dict[int, str]


def contents(model: Any) -> GmshContents:
    """Contents of the current `gmsh.model`."""
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
    return GmshContents(groups, tags, coordinates.reshape(-1, 3), elements, kinds)


def read(path: Path, limits: ReadLimits | None = None) -> GmshContents:
    """Contents of a gmsh file, read in a process of its own.

    Raises:
        ValueError: If gmsh cannot read the file, with its reason.
    """
    limits = limits or ReadLimits()
    size = path.stat().st_size
    seconds = limits.seconds + limits.seconds_per_megabyte * size / 1e6
    memory = limits.memory + limits.memory_per_byte * size
    numbers = [str(int(number)) for number in (seconds, memory)]
    launched = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")  # it is no rank of this run
    environment = {k: v for k, v in os.environ.items() if not k.startswith(launched)}
    environment["OPENBLAS_NUM_THREADS"] = "1"  # each takes address space
    try:
        done = subprocess.run(
            [sys.executable, "-P", __file__, str(path), *numbers],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=limits.patience * seconds,
            check=False,
        )
        failure, columns = pickle.loads(done.stdout)
    except subprocess.TimeoutExpired:
        raise ValueError("it finds no end") from None
    except (EOFError, pickle.UnpicklingError):  # it was ended before it could answer
        no_end = done.returncode == -signal.SIGXCPU
        failure = "it finds no end" if no_end else f"it crashes (exit code {done.returncode})"
        raise ValueError(failure) from None
    if failure:
        raise ValueError(failure)
    return GmshContents(**columns)


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
    columns = {}
    with os.fdopen(os.dup(1), "wb") as answer:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)  # what gmsh and its libraries have to say
        try:
            import gmsh

            gmsh.initialize(readConfigFiles=False)
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.open(path)
            columns = vars(contents(gmsh.model))
        except Exception as error:
            failure = str(error) or "the file is damaged"
        pickle.dump((failure, columns), answer, protocol=5)
    os._exit(0)  # without gmsh's own end, which takes time


if __name__ == "__main__":
    _main(*sys.argv[1:])
