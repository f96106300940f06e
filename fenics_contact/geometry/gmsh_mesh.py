"""Meshes as gmsh has them, on one rank: cells and facets in physical groups, split into bodies.

Nothing here needs dolfinx, which takes a third of a second to import.

Text files (MSH 4.1) that are plainly well formed are read here, without gmsh, which takes .3 s to
start: straight lines, triangles and quadrilaterals, every number where the format has it. All else
is left to gmsh, and so is every complaint. Format: gmsh's reference manual, "MSH file format".
"""

from __future__ import annotations

import os
import pickle
import re
import signal
import stat
import subprocess
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import InputError, check_like, require
from fenics_contact.geometry import gmsh_reader
from fenics_contact.geometry.planar_cells import (
    Array,
    Indices,
    anticlockwise,
    check_coordinates,
    connected,
    sides_of,
)
from fenics_contact.requirements import GMSH_WAYS, RIGID

Labels = npt.NDArray[np.int32]
Names = frozenset[str]
Tags = npt.NDArray[np.uint64]
Volumes = tuple[list[tuple[int, list[str], list[tuple[int, ...]], Any]], Tags, Array]

#: What a block is: connected cells, or connected cells of one gmsh surface.
BLOCKS = ("connected", "surfaces")
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
class TaggedMesh:
    """Physical groups of a mesh; the same on all ranks that have it.

    Attributes:
        source: Where the mesh came from, for messages.
        facets: Input nodes of the tagged facets, smaller first, each once, shape (facets, 2).
        facet_groups: Physical groups of those facets, as an index into `facet_sets`.
        cell_sets: Sets of group names that occur on cells.
        facet_sets: Sets of group names that occur on facets.
        cell_names: Names of all two-dimensional groups.
        facet_names: Names of all one-dimensional groups.
        surfaces: Number of gmsh's surfaces that have cells.
        remark: What is wrong with the drawing that it was made of; empty if nothing is known.
    """

    source: str
    facets: Indices
    facet_groups: Labels
    cell_sets: tuple[Names, ...]
    facet_sets: tuple[Names, ...]
    cell_names: tuple[str, ...]
    facet_names: tuple[str, ...]
    surfaces: int
    remark: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class GmshMesh(TaggedMesh):
    """Planar cells and tagged facets of a gmsh model, on one rank.

    Attributes:
        cell_name: "triangle" or "quadrilateral".
        points: Coordinates of the nodes that cells use, shape (points, 2).
        cells: Node indices in gmsh order, shape (cells, nodes of a cell).
        cell_groups: Physical groups of every cell, as an index into `cell_sets`.
        cell_surfaces: gmsh's surface of every cell, from 0 on.
    """

    cell_name: str
    points: Array
    cells: Indices
    cell_groups: Labels
    cell_surfaces: Labels


#: Why a file is not read here; nobody sees it.
_LEFT = "gmsh has to read this file"
#: Why gmsh has to be there.
_GMSH = f"this needs gmsh, which is not installed: {GMSH_WAYS}"


@contextmanager
def gmsh_session(**options: float) -> Iterator[Any]:
    """gmsh, started if need be, silent, without its hold on Ctrl-C, with options of meshing."""
    require(find_spec("gmsh") is not None, f"{_GMSH}; without it: {RIGID}")
    import gmsh

    handler = signal.getsignal(signal.SIGINT)
    gmsh.initialize(readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    before = {name: gmsh.option.getNumber(f"Mesh.{name}") for name in options}
    try:
        for name, value in options.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        yield gmsh
    finally:
        for name, value in before.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        signal.signal(signal.SIGINT, handler)


def read_file(path: Path) -> GmshMesh:
    """Mesh of a gmsh file.

    Raises:
        InputError: If it cannot be read, or is no mesh of triangles or quadrilaterals in groups.
    """
    try:
        regular = stat.S_ISREG(path.stat().st_mode)  # to open a pipe would wait for ever
        require(regular, f"'{path}' is a folder or device; give the path of a gmsh .msh file")
        with path.open("rb") as file:
            start = file.read(16)
    except (FileNotFoundError, NotADirectoryError, ValueError):  # a name with a NUL
        problem = "does not exist; give the path of a gmsh .msh file"
        raise InputError(f"mesh file '{path}' {problem}") from None
    except OSError as error:
        raise InputError(f"mesh file '{path}' cannot be read: {error.strerror}") from None
    known = start.startswith((b"$MeshFormat", b"$Comments"))
    require(known, f"'{path}' is not a gmsh mesh file; save the mesh from gmsh as .msh")
    try:
        found = text_contents(path)
        if found is None:
            require(find_spec("gmsh") is not None, _GMSH)
            found = read(path)
    except ValueError as error:
        raise InputError(f"gmsh cannot read '{path}': {error}; save it again as .msh") from None
    return replace(mesh_of(found, f"'{path}'"), remark=remark_of(path))


def read(path: Path, limits: ReadLimits | None = None) -> GmshContents:
    """Contents of a gmsh file, read in a process of its own.

    Raises:
        ValueError: If gmsh cannot read the file, with its reason.
    """
    return GmshContents(*_read(path, limits or ReadLimits(), "contents"))


def read_volumes(path: Path) -> Volumes:
    """Volumes of a gmsh file (number, groups, outer faces and tetrahedra by nodes), its nodes.

    Raises:
        ValueError: If gmsh cannot read the file, with its reason.
    """
    require(find_spec("gmsh") is not None, _GMSH)
    volumes, tags, coordinates = _read(path, ReadLimits(), "volumes")
    return volumes, tags, coordinates


def _read(path: Path, limits: ReadLimits, what: str) -> tuple[Any, ...]:
    """What a function of `gmsh_reader` returns, in a process of its own."""
    size = path.stat().st_size
    seconds = limits.seconds + limits.seconds_per_megabyte * size / 1e6
    memory = limits.memory + limits.memory_per_byte * size
    numbers = [str(int(number)) for number in (seconds, memory)]
    launched = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")  # it is no rank of this run
    environment = {k: v for k, v in os.environ.items() if not k.startswith(launched)}
    environment["OPENBLAS_NUM_THREADS"] = "1"  # each takes address space
    try:
        done = subprocess.run(
            [sys.executable, "-P", str(gmsh_reader.__file__), str(path), *numbers, what],
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
    return tuple(columns)


def text_contents(path: Path) -> GmshContents | None:
    """Contents of a text file as `read` returns them; None where gmsh has to read it.

    Raises:
        OSError: If the file cannot be read.
    """
    try:
        return _of_text(path.read_text(encoding="utf-8").partition(_REMARK_HEAD)[0])
    except (InputError, ValueError, IndexError, DeprecationWarning):
        return None


def remark_of(path: Path) -> str:
    """What `REMARK` says at the end of a file, as one printable line; empty without one."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 2000))
        end = file.read().decode("utf-8", "replace")
    text = end.rpartition(_REMARK_HEAD)[2] if _REMARK_HEAD in end else ""
    return "".join(c for c in text.removesuffix(_REMARK_END) if c.isprintable())


class _Numbers:
    """Numbers of a section, taken from its start on."""

    def __init__(self, text: str) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # what is no number
            self.left = np.fromstring(text, sep=" ")
        require(bool(np.all(np.isfinite(self.left))), _LEFT)

    def real(self, count: int) -> npt.NDArray[np.float64]:
        """The next numbers."""
        require(0 <= count <= len(self.left), _LEFT)
        taken = self.left[:count]
        self.left = self.left[count:]
        return taken

    def whole(self, count: int) -> npt.NDArray[np.int64]:
        """The next numbers, which must be whole."""
        taken = self.real(count)
        require(bool(np.all((taken == np.round(taken)) & (np.abs(taken) < EXACT))), _LEFT)
        return taken.astype(np.int64)


def _of_text(text: str) -> GmshContents:
    """Contents of the text of a file.

    Raises:
        InputError, ValueError, IndexError, DeprecationWarning: If gmsh has to read it.
    """
    found = list(_SECTION.finditer(text))
    names = [section[1] for section in found]
    require("".join(section[0] for section in found) == text, _LEFT)
    require(names in ([*SECTIONS], [SECTIONS[0], *SECTIONS[2:]]), _LEFT)
    sections = {section[1]: section[2] for section in found}
    require(sections["MeshFormat"].split() == FORMAT, _LEFT)
    count, *lines = sections.get("PhysicalNames", "0\n").splitlines()
    named = [match for line in lines if (match := _NAME.fullmatch(line.rstrip()))]
    require(
        len(named) == len(lines) == int(count) and all(m[3].isprintable() for m in named), _LEFT
    )

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
    require(len(numbers.left) == 0 and all(dim < 3 for dim, _ in of_entity), _LEFT)

    numbers = _Numbers(sections["Nodes"])
    nodes = {}
    blocks, total, _, _ = numbers.whole(4)
    for _ in range(blocks):
        dim, entity, parametric, size = numbers.whole(4).tolist()
        require(
            parametric == 0 and (dim, entity) in of_entity and (dim, entity) not in nodes, _LEFT
        )
        nodes[dim, entity] = numbers.whole(size), numbers.real(3 * size).reshape(-1, 3)
    require(len(numbers.left) == 0, _LEFT)
    in_order = [nodes[key] for key in sorted(nodes)]
    known = np.concatenate([tags for tags, _ in in_order])
    require(len(known) == total == len(np.unique(known)) and int(known.min()) > 0, _LEFT)

    numbers = _Numbers(sections["Elements"])
    flat: dict[tuple[int, int, int], Tags] = {}
    blocks, total, _, _ = numbers.whole(4)
    for _ in range(blocks):
        dim, entity, kind, size = numbers.whole(4).tolist()
        require(kind in ELEMENTS and size > 0 and (dim, entity, kind) not in flat, _LEFT)
        require((dim, entity) in of_entity and dim == min(ELEMENTS[kind][0] - 1, 2), _LEFT)
        rows = numbers.whole(size * (1 + ELEMENTS[kind][0])).reshape(size, -1)
        flat[dim, entity, kind] = rows[:, 1:].ravel().astype(np.uint64)
        total -= size
    require(len(numbers.left) == 0 and total == 0, _LEFT)
    require(bool(np.all(np.isin(np.concatenate(list(flat.values())), known))), _LEFT)

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


def extract(model: Any, source: str) -> GmshMesh:
    """Cells, tagged facets and group names of the current `gmsh.model`, `source` in messages.

    Raises:
        InputError: If it is not a planar mesh of triangles or quadrilaterals with area in groups.
    """
    check_like("model", model, "getPhysicalGroups", "a gmsh model, as builders return it")
    return mesh_of(GmshContents(*gmsh_reader.contents(model)), source)


def mesh_of(found: GmshContents, source: str) -> GmshMesh:
    """Cells, tagged facets and group names of what was read; see `extract`."""
    names = found.groups
    for (dim, tag), name in names.items():
        problem = f"the name of physical group {tag} of dimension {dim} is not UTF-8; rename it"
        require(name is not None, f"{source}: {problem}")
    by_dim = ([str(name) for (d, _), name in names.items() if d == dim] for dim in (2, 1))
    cell_names, facet_names = (tuple(dict.fromkeys(some)) for some in by_dim)
    problem = "has no two-dimensional physical group; put the blocks' surfaces into one"
    require(bool(cell_names), f"{source} {problem}")
    by_entity: list[tuple[Names, int, Tags]] = []  # groups, gmsh's type and nodes of cells
    by_facet: dict[tuple[int, int], Names] = {}
    for dim, numbers, kind, flat in found.elements:
        groups = frozenset(str(names[dim, number]) for number in numbers)
        if dim == 2:
            by_entity.append((groups, kind, flat))
        elif kind == 1:  # gmsh's number of a straight line
            for first, second in np.sort(flat.reshape(-1, 2), axis=1).tolist():
                by_facet[first, second] = by_facet.get((first, second), frozenset()) | groups
    kinds = {kind for _, kind, _ in by_entity}
    problem = "has no cells in its two-dimensional groups; mesh it first"
    require(bool(kinds), f"{source} {problem}")
    if len(kinds) > 1 or not kinds <= set(CELL_TYPES):
        listed = ", ".join(found.kinds[kind] for kind in sorted(kinds))
        raise InputError(
            f"{source} has cells of kind {listed}; mesh it with straight triangles only, or with"
            " straight quadrilaterals only"
        )
    cell_name, width = CELL_TYPES[kinds.pop()]
    counts = [len(flat) // width for *_, flat in by_entity]
    surface = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    nodes = np.concatenate([flat for *_, flat in by_entity]).reshape(-1, width)
    of_entity, cell_sets = _numbered(some for some, *_ in by_entity)
    used, node = np.unique(nodes, return_inverse=True)
    whole = bool(np.all(np.isin(used, found.tags)))
    require(whole, f"{source} has cells with nodes that it lacks; save it again as .msh")
    table = np.array(list(by_facet), dtype=used.dtype).reshape(-1, 2)
    index = np.minimum(np.searchsorted(used, table), len(used) - 1)
    known = np.all(used[index] == table, axis=1)
    labels, facet_sets = _numbered(by_facet.values())
    order = np.argsort(found.tags)
    points = found.coordinates[order[np.searchsorted(found.tags, used, sorter=order)]]
    check_coordinates(points, source)
    points = points[:, :2].copy()
    cells = anticlockwise(points, node.reshape(nodes.shape), source)
    facets = np.sort(index[known], axis=1), labels[known]
    tags = *facets, cell_sets, facet_sets, cell_names, facet_names, len(np.unique(surface))
    return GmshMesh(source, *tags, cell_name, points, cells, of_entity[surface], surface)


def _numbered(groups: Iterable[Names]) -> tuple[Labels, tuple[Names, ...]]:
    """Every set as an index into the different ones, and these."""
    index: dict[Names, int] = {}
    labels = [index.setdefault(names, len(index)) for names in groups]
    return np.array(labels, dtype=np.int32), tuple(index)


def with_blocks(mesh: GmshMesh, blocks: str) -> GmshMesh:
    """The mesh with blocks of a kind of `BLOCKS`: as it is, or with surfaces split.

    Every surface then has a copy of every node that it uses. A tagged facet between two surfaces
    becomes two facets, one of each, in the same groups.
    """
    require(blocks in BLOCKS, f"blocks = '{blocks}' must be one of {', '.join(BLOCKS)}")
    if blocks != "surfaces":
        return mesh
    count = len(mesh.points)
    width = mesh.cells.shape[1]
    surface = mesh.cell_surfaces.astype(np.int64)
    copies, cells = np.unique(surface[:, None] * count + mesh.cells, return_inverse=True)
    any_copy = np.zeros(count, dtype=np.int64)
    any_copy[copies % count] = np.arange(len(copies))
    ends = np.sort(sides_of(mesh.cells), axis=1)
    sides = np.column_stack([ends, np.repeat(surface, width)])
    sides = np.unique(sides, axis=0)  # once for each surface that has it
    key, tagged = (table[:, :2] @ [count, 1] for table in (sides, mesh.facets))
    order = np.argsort(tagged)
    found = np.isin(key, tagged)
    facet = order[np.searchsorted(tagged[order], key[found])]
    lost = ~np.isin(tagged, key)  # no side of a cell; kept for the message that says so
    both = np.searchsorted(copies, sides[found, 2:] * count + sides[found, :2])
    return replace(
        mesh,
        points=mesh.points[copies % count],
        cells=cells.reshape(mesh.cells.shape),
        facets=np.concatenate([both, np.sort(any_copy[mesh.facets[lost]], axis=1)]),
        facet_groups=np.concatenate([mesh.facet_groups[facet], mesh.facet_groups[lost]]),
    )


def bodies_of_cells(mesh: GmshMesh) -> Labels:
    """Body of every cell: sets of cells connected through facets, numbered by first cell.

    Raises:
        InputError: If a body hangs together at a single node only, which would be a hinge.
    """
    key = np.sort(sides_of(mesh.cells), axis=1) @ [len(mesh.points), 1]
    _, side = np.unique(key, return_inverse=True)
    count, width = mesh.cells.shape
    owner = np.repeat(np.arange(count), width)
    by_node, by_side = (  # sets of cells connected through what they share
        np.unique(
            connected(np.column_stack([owner, count + shared.ravel()]), count + shared.max() + 1)[
                :count
            ],
            return_inverse=True,
        )[1]
        for shared in (mesh.cells, side)
    )
    require(
        by_node.max() == by_side.max(),
        f"{mesh.source}: blocks share single nodes; every block needs nodes of its own (double"
        ' them, or set mesh.blocks = "surfaces")',
    )
    _, first, label = np.unique(by_side, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[label].astype(np.int32)
