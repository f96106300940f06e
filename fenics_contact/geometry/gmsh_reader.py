"""Contents of gmsh models and files as arrays; run as a program, those of a file, for another.

Text files (MSH 4.1) that are plainly well formed are read here, without gmsh, which takes .3 s to
start: straight lines, triangles and quadrilaterals, every number where the format has it. All else
is left to gmsh, and so is every complaint. gmsh can crash, hang or ask for all memory on a damaged
file, so it reads in a process of its own. This module imports nothing of the package: mpi4py would
start MPI in that process. Format: gmsh's reference manual, "MSH file format".
"""

from __future__ import annotations

import os
import pickle
import re
import resource
import signal
import subprocess
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Tags = npt.NDArray[np.uint64]

#: Cell name and nodes of a cell, by gmsh's element type, for the straight-sided planar cells.
CELL_TYPES = {2: ("triangle", 3), 3: ("quadrilateral", 4)}


#: Elements of text files: gmsh's number, nodes, gmsh's name.
ELEMENTS = {1: (2, "Line 2"), 2: (3, "Triangle 3"), 3: (4, "Quadrilateral 4"), 15: (1, "Point")}
#: Sections, in the order in which gmsh writes them; the second may be left out.
SECTIONS = ("MeshFormat", "PhysicalNames", "Entities", "Nodes", "Elements")
#: Section after all others with what is wrong with the drawing; gmsh passes over it.
REMARK = "\n$Comments\nfenics-contact: {}\n$EndComments\n"
_REMARK_HEAD, _, _REMARK_END = REMARK.partition("{}")
#: Version 4.1, text, with numbers of 8 bytes.
FORMAT = ["4.1", "0", "8"]
#: Whole numbers above this are not exact as floating point numbers.
EXACT = 2.0**53
_SECTION = re.compile(r"\$(\w+)\n(.*?\n)\$End\1\n", re.DOTALL)
_NAME = re.compile(r'([0-3]) ([1-9]\d{0,8}) "([^"]{1,100})"')


@dataclass(frozen=True)
class ReadLimits:
    """What reading a file by gmsh may take.

    Attributes:
        seconds: Time of the processor, s, of which more is given by size; 30 times what gmsh needs
            to start.
        seconds_per_megabyte: gmsh reads more than 10 MB/s.
        patience: Time by the clock over that of the processor, on a busy machine.
        memory: Address space, bytes, of which more is given by size; gmsh and its libraries take
            2e8.
        memory_per_byte: Of the file.
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
        failure = "it finds no end"
    except (EOFError, pickle.UnpicklingError):  # it was ended before it could answer
        no_end = done.returncode == -signal.SIGXCPU
        failure = "it finds no end" if no_end else f"it crashes (exit code {done.returncode})"
    if failure:
        raise ValueError(failure)
    return GmshContents(**columns)


# ---- text files without gmsh


def text_contents(path: Path) -> GmshContents | None:
    """Contents of a text file as `read` returns them; None where gmsh has to read it.

    Raises:
        OSError: If the file cannot be read.
    """
    try:
        return _of_text(path.read_text(encoding="utf-8").partition(_REMARK_HEAD)[0])
    except (ValueError, IndexError, DeprecationWarning):
        return None


def remark_of(path: Path) -> str:
    """What `REMARK` says at the end of a file, as one printable line; empty without one."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 2000))
        end = file.read().decode("utf-8", "replace")
    text = end.rpartition(_REMARK_HEAD)[2] if _REMARK_HEAD in end else ""
    return "".join(c for c in text.removesuffix(_REMARK_END) if c.isprintable())


def _require(condition: bool) -> None:
    """Leave the file to gmsh where a condition does not hold."""
    if not condition:
        raise ValueError("gmsh has to read this file")


class _Numbers:
    """Numbers of a section, taken from its start on."""

    def __init__(self, text: str) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # what is no number
            self.left = np.fromstring(text, sep=" ")
        _require(bool(np.all(np.isfinite(self.left))))

    def real(self, count: int) -> npt.NDArray[np.float64]:
        """The next numbers."""
        _require(0 <= count <= len(self.left))
        taken = self.left[:count]
        self.left = self.left[count:]
        return taken

    def whole(self, count: int) -> npt.NDArray[np.int64]:
        """The next numbers, which must be whole."""
        taken = self.real(count)
        _require(bool(np.all((taken == np.round(taken)) & (np.abs(taken) < EXACT))))
        return taken.astype(np.int64)


def _of_text(text: str) -> GmshContents:
    """Contents of the text of a file.

    Raises:
        ValueError, IndexError, DeprecationWarning: If gmsh has to read it.
    """
    found = list(_SECTION.finditer(text))
    names = [section[1] for section in found]
    _require("".join(section[0] for section in found) == text)
    _require(names in ([*SECTIONS], [SECTIONS[0], *SECTIONS[2:]]))
    sections = {section[1]: section[2] for section in found}
    _require(sections["MeshFormat"].split() == FORMAT)
    count, *lines = sections.get("PhysicalNames", "0\n").splitlines()
    named = [match for line in lines if (match := _NAME.fullmatch(line.rstrip()))]
    _require(len(named) == len(lines) == int(count) and all(m[3].isprintable() for m in named))

    numbers = _Numbers(sections["Entities"])
    of_entity: dict[tuple[int, int], list[int]] = {}
    for dim, entities in enumerate(numbers.whole(4).tolist()):
        for _ in range(entities):
            (entity,) = numbers.whole(1).tolist()
            numbers.real(3 if dim == 0 else 6)  # the box around it
            tags = numbers.whole(*numbers.whole(1))
            of_entity[dim, entity] = np.abs(tags).tolist()  # below 0 where it is reversed
            if dim > 0:
                numbers.whole(*numbers.whole(1))  # what bounds it
    _require(len(numbers.left) == 0 and all(dim < 3 for dim, _ in of_entity))

    numbers = _Numbers(sections["Nodes"])
    nodes = {}
    blocks, total, _, _ = numbers.whole(4)
    for _ in range(blocks):
        dim, entity, parametric, size = numbers.whole(4).tolist()
        _require(parametric == 0 and (dim, entity) in of_entity and (dim, entity) not in nodes)
        nodes[dim, entity] = numbers.whole(size), numbers.real(3 * size).reshape(-1, 3)
    _require(len(numbers.left) == 0)
    in_order = [nodes[key] for key in sorted(nodes)]
    known = np.concatenate([tags for tags, _ in in_order])
    _require(len(known) == total == len(np.unique(known)) and int(known.min()) > 0)

    numbers = _Numbers(sections["Elements"])
    flat: dict[tuple[int, int, int], Tags] = {}
    blocks, total, _, _ = numbers.whole(4)
    for _ in range(blocks):
        dim, entity, kind, size = numbers.whole(4).tolist()
        _require(kind in ELEMENTS and size > 0 and (dim, entity, kind) not in flat)
        _require((dim, entity) in of_entity and dim == min(ELEMENTS[kind][0] - 1, 2))
        rows = numbers.whole(size * (1 + ELEMENTS[kind][0])).reshape(size, -1)
        flat[dim, entity, kind] = rows[:, 1:].ravel().astype(np.uint64)
        total -= size
    _require(len(numbers.left) == 0 and total == 0)
    _require(bool(np.all(np.isin(np.concatenate(list(flat.values())), known))))

    used = sorted({(dim, tag) for (dim, _), tags in of_entity.items() for tag in tags})
    by_number = {(int(match[1]), int(match[2])): match[3] for match in named}
    groups: dict[tuple[int, int], str | None] = {
        key: by_number.get(key, str(key[1])) for key in used
    }
    elements = [
        (dim, of_entity[dim, entity], kind, flat[dim, entity, kind])
        for dim, entity, kind in sorted(flat)
        if dim > 0 and of_entity[dim, entity]
    ]
    kinds = {kind: ELEMENTS[kind][1] for _, _, kind, _ in elements}
    coordinates = np.concatenate([places for _, places in in_order])
    return GmshContents(groups, known.astype(np.uint64), coordinates, elements, kinds)


# ---- the process in which gmsh reads


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
